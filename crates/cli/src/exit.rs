//! The exit codes of the program; `palpate --help` prints [`HELP`].

/// Done as asked, but a file could not be written whole, or not be read whole where that does not keep from the work.
pub(crate) const FILE_LOST: u8 = 1;

/// A mistake in the command line or in a file that it names.
pub(crate) const MISTAKE: u8 = 2;

/// The body failed during a run: it was rolled back, the force set to zero, and the trace is complete.
pub(crate) const BODY_FAILED: u8 = 3;

/// A replay differs from its trace.
pub(crate) const DIFFERENT: u8 = 4;

/// A mesh can be read but not simulated.
pub(crate) const UNUSABLE: u8 = 5;

/// A contact problem was not solved to the tolerance.
pub(crate) const NOT_SOLVED: u8 = 6;

/// No static equilibrium was found under the whole load.
pub(crate) const NO_EQUILIBRIUM: u8 = 7;

/// Above this the number of the signal that ended the work, as a shell reports it for a program that a signal ended.
pub(crate) const SIGNALLED: u8 = 128;

/// Ended by HUP, as where the terminal was closed; everything was written up to there.
pub(crate) const HUNG_UP: u8 = SIGNALLED + 1;

/// Ended by Ctrl-C; everything was written up to there.
pub(crate) const INTERRUPTED: u8 = SIGNALLED + 2;

/// Ended by TERM; everything was written up to there.
pub(crate) const TERMINATED: u8 = SIGNALLED + 15;

/// The codes as text.
pub(crate) const HELP: &str = "Exit codes:
    0  done
    1  done, but a file could not be written, or a part of a trace is damaged
    2  a mistake in the command line, a scene, a mesh or a problem; nothing was run and no file was written
    3  the body failed during a run: rolled back, zero force, complete trace
    4  a replay differs from its trace
    5  a mesh can be read but not simulated
    6  a contact problem was not solved to the tolerance
    7  no static equilibrium was found under the whole load
  129  ended by HUP; everything was written up to there, as for the next two
  130  ended by Ctrl-C (INT)
  143  ended by TERM";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_is_in_the_help_once() {
        let codes = [0, FILE_LOST, MISTAKE, BODY_FAILED, DIFFERENT, UNUSABLE, NOT_SOLVED, NO_EQUILIBRIUM];
        let codes: Vec<_> = codes.into_iter().chain([HUNG_UP, INTERRUPTED, TERMINATED]).collect();
        let listed: Vec<u8> = HELP.lines().skip(1).filter_map(|l| l.split_whitespace().next()?.parse().ok()).collect();
        assert_eq!(listed, codes);
    }
}
