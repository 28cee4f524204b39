//! Standard output, and the files that a command writes.

use std::fmt::Display;
use std::fs::OpenOptions;
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, Result, WrapErr, miette};
use palpate::scene::Scene;

use crate::arguments::RunArguments;

/// Prints a line on standard output. A reader that has gone away, as in `palpate scenes | head -1`, is no mistake.
pub(crate) fn say(text: impl Display) -> Result<()> {
    let mut out = io::stdout().lock();
    match writeln!(out, "{text}").and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(error).into_diagnostic().wrap_err("standard output cannot be written")
        }
        _ => Ok(()),
    }
}

/// `Ok` where a file can be written at `path`. A file that is there keeps its content, one that is not is not made.
pub(crate) fn writable(path: &Path) -> io::Result<()> {
    let existed = path.symlink_metadata().is_ok();
    OpenOptions::new().append(true).create(true).open(path)?;
    if existed { Ok(()) } else { std::fs::remove_file(path) }
}

/// A refusal of an output that cannot be written, before any work is done for it.
pub(crate) fn check_writable(option: &str, path: &Path) -> Result<()> {
    writable(path).map_err(|e| {
        miette!(
            help = "name a writable file in an existing folder",
            "{option} {}: cannot be written: {e}",
            path.display()
        )
    })
}

/// Refuses an output that is one of the files that are read.
pub(crate) fn check_kept<P: AsRef<Path>>(option: &str, path: &Path, inputs: &[P]) -> Result<()> {
    if inputs.iter().any(|input| same(input.as_ref(), path)) {
        return Err(miette!(help = "name another file", "{option} {} would overwrite an input", path.display()));
    }
    Ok(())
}

/// The files that are read for the scene that the command line calls `name`.
pub(crate) fn scene_files(name: &str, scene: &Scene) -> Vec<PathBuf> {
    let file = Path::new(name);
    let folder = file.parent().unwrap_or(Path::new(""));
    let named = scene.description().files().map(|name| folder.join(name));
    std::iter::once(file.to_path_buf()).chain(named).collect()
}

/// Makes a folder for outputs, if it is not there.
pub(crate) fn make_folder(option: &str, path: &Path) -> Result<()> {
    std::fs::create_dir_all(path).map_err(|e| {
        miette!(help = "name a folder that can be made", "{option} {}: cannot be made: {e}", path.display())
    })
}

/// The files that a run writes.
pub(crate) struct Outputs {
    pub(crate) trace: Option<PathBuf>,
    pub(crate) picture: Option<PathBuf>,
    pub(crate) csv: Option<PathBuf>,
    pub(crate) final_state: Option<PathBuf>,
}

impl Outputs {
    /// The files that the command line asks for, for the scene of this name.
    pub(crate) fn new(arguments: &RunArguments, scene: &str) -> Self {
        let default = || PathBuf::from(format!("{scene}.mcap"));
        let trace = (!arguments.no_trace).then(|| arguments.trace.clone().unwrap_or_else(default));
        Self {
            picture: trace.as_ref().map(|t| t.with_extension("svg")),
            trace,
            csv: arguments.csv.clone(),
            final_state: arguments.final_state.clone(),
        }
    }

    /// Refuses files that overwrite one another or an input, and tables and states that cannot be written.
    /// A trace that cannot be written does not keep the simulation from running: it is left out, and the message is
    /// the answer.
    pub(crate) fn check(&mut self, inputs: &[PathBuf]) -> Result<Option<String>> {
        let named = [
            ("--trace", &self.trace),
            ("the picture beside the trace", &self.picture),
            ("--csv", &self.csv),
            ("--final", &self.final_state),
        ];
        let named: Vec<_> = named.into_iter().filter_map(|(option, path)| Some((option, path.as_deref()?))).collect();
        for (k, (option, path)) in named.iter().enumerate() {
            if let Some((other, _)) = named[..k].iter().find(|(_, p)| same(p, path)) {
                let help = "give every output its own file; the picture is the trace with the ending .svg";
                return Err(miette!(help = help, "{other} and {option} are both {}", path.display()));
            }
            check_kept(option, path, inputs)?;
        }
        if let Some(path) = self.final_state.as_ref().filter(|p| p.extension().is_none_or(|e| e != "vtu")) {
            return Err(miette!(help = "name it FILE.vtu", "--final {}: only VTU is written", path.display()));
        }
        self.csv.iter().try_for_each(|path| check_writable("--csv", path))?;
        self.final_state.iter().try_for_each(|path| check_writable("--final", path))?;
        let refused = self.trace.iter().chain(&self.picture).find_map(|p| Some((p.clone(), writable(p).err()?)));
        Ok(refused.map(|(path, error)| {
            (self.trace, self.picture) = (None, None);
            format!(
                "no trace and no picture: {} cannot be written: {error}; the simulation goes on without",
                path.display()
            )
        }))
    }
}

/// True where both paths name the same file, whether it exists or not, be it by another link.
fn same(a: &Path, b: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let node = |p: &Path| p.metadata().ok().map(|m| (m.dev(), m.ino()));
        if node(a).is_some_and(|a| node(b) == Some(a)) {
            return true;
        }
    }
    let whole = |p: &Path| {
        let p = std::path::absolute(p).unwrap_or_else(|_| p.into());
        p.canonicalize().unwrap_or(p)
    };
    whole(a) == whole(b)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn asking_whether_a_file_can_be_written_leaves_no_trace() {
        let file = std::env::temp_dir().join(format!("palpate_writable_{}", std::process::id()));
        assert!(writable(&file).is_ok() && !file.exists());
        std::fs::write(&file, "kept").unwrap();
        assert!(writable(&file).is_ok());
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "kept");
        assert!(writable(&file.join("below a file")).is_err());
        std::fs::remove_file(&file).unwrap();
        assert!(writable(&std::env::temp_dir()).is_err(), "a folder is no file");
    }
}
