//! The exit codes of the program; `palpate --help` prints [`HELP`].

/// Done as asked, but a file could not be written whole.
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

/// Ended by Ctrl-C; the trace is complete up to there. What a shell reports for a program that SIGINT ended.
pub(crate) const INTERRUPTED: u8 = 130;

/// The codes as text.
pub(crate) const HELP: &str = "Exit codes:
    0  done
    1  done, but a file could not be written
    2  a mistake in the command line, a scene, a mesh or a problem; nothing was run and no file was written
    3  the body failed during a run: rolled back, zero force, complete trace
    4  a replay differs from its trace
    5  a mesh can be read but not simulated
    6  a contact problem was not solved to the tolerance
    7  no static equilibrium was found under the whole load
  130  ended by Ctrl-C, TERM or HUP; everything was written up to there";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_is_in_the_help_once() {
        let codes = [0, FILE_LOST, MISTAKE, BODY_FAILED, DIFFERENT, UNUSABLE, NOT_SOLVED, NO_EQUILIBRIUM, INTERRUPTED];
        let listed: Vec<u8> = HELP.lines().skip(1).filter_map(|l| l.split_whitespace().next()?.parse().ok()).collect();
        assert_eq!(listed, codes);
    }
}
