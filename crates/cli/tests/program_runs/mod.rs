//! Runs the built program in a folder of its own.
#![allow(dead_code)] // each test file uses its part

use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

/// A small block under a ball that presses, slides and lets go within a second.
pub(crate) const SCENE: &str = r#"name = "small"
seconds = 1
gravity = [0, 0, 0]

[[body]]
name = "block"
block = { min = [-0.03, -0.03, 0.0], max = [0.03, 0.03, 0.03], cells = [3, 3, 2] }
density = 1060
rayleigh_stiffness = 0.005
material = { law = "neo_hookean", young = 10e3, poisson = 0.4 }
fixed = [{ node_set = "z_min" }]

[[tool]]
name = "ball"
shape = { kind = "sphere", radius = 0.01 }

[contact]
friction = 0.3
at = "faces"

[hand]
preset = "arm"
path = [
    { time = 0.0, position = [0.0, 0.0, 0.042] },
    { time = 0.4, position = [0.0, 0.0, 0.036] },
    { time = 0.7, position = [0.005, 0.0, 0.036] },
    { time = 1.0, position = [0.005, 0.0, 0.045] },
]
"#;

/// Nodes of the block of [`SCENE`].
pub(crate) const NODES: usize = 4 * 4 * 3;

/// A folder with `scene.toml` in it; removed when it is dropped.
pub(crate) struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    pub(crate) fn new() -> Self {
        Self::with(SCENE)
    }

    /// A folder whose scene is `text`.
    pub(crate) fn with(text: &str) -> Self {
        let place = Self { folder: tempfile::tempdir().unwrap() };
        place.write("scene.toml", text);
        place
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    pub(crate) fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    pub(crate) fn text(&self, name: &str) -> String {
        String::from_utf8(self.read(name)).unwrap()
    }

    /// Names of all files, sorted.
    pub(crate) fn files(&self) -> Vec<String> {
        let mut names: Vec<_> = std::fs::read_dir(self.folder.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    /// The program with these arguments, separated by spaces, in this folder.
    pub(crate) fn command(&self, arguments: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_palpate"));
        command.args(arguments.split_whitespace()).current_dir(self.folder.path()).stdin(Stdio::null());
        command
    }

    pub(crate) fn run(&self, arguments: &str) -> Outcome {
        Outcome::new(self.command(arguments).output().unwrap())
    }
}

/// What a run of the program answered.
#[derive(Debug)]
pub(crate) struct Outcome {
    pub(crate) code: Option<i32>,
    pub(crate) out: String,
    pub(crate) err: String,
}

impl Outcome {
    pub(crate) fn new(output: Output) -> Self {
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Self { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
    }
}
