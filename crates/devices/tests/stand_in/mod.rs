//! Vendors' libraries compiled from C, one copy for each test, so that each has its own device.

#![allow(dead_code, clippy::print_stdout)] // each test uses a part; why a test was skipped

use std::path::{Path, PathBuf};
use std::process::Command;

use palpate_devices::DriverConfig;
use palpate_haptics::device::TickTime;

/// A compiled stand-in, loaded a second time by the test to move its hand. The system gives both the same memory.
pub struct StandIn {
    pub path: PathBuf,
    library: libloading::Library,
    _folder: tempfile::TempDir,
}

impl StandIn {
    /// Compiles `name`.c with these definitions; `None`, with a printed reason, where there is no compiler.
    pub fn build(name: &str, definitions: &[&str]) -> Option<Self> {
        if !Command::new("cc").arg("--version").output().is_ok_and(|o| o.status.success()) {
            println!("skipped: there is no C compiler here");
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/stand_in/{name}.c"));
        let path = folder.path().join(format!("lib{name}.so"));
        let mut command = Command::new("cc");
        command.args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-O1", "-pthread"]);
        command.args(definitions).arg(&source).arg("-o").arg(&path).arg("-lm");
        let output = command.output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        // SAFETY: its initialisers do nothing.
        let library = unsafe { libloading::Library::new(&path) }.unwrap();
        Some(Self { path, library, _folder: folder })
    }

    pub fn config(&self) -> DriverConfig {
        DriverConfig { library: Some(self.path.clone()), ..DriverConfig::default() }
    }

    /// Calls one of the stand-in's own functions with a number.
    pub fn set(&self, function: &str, value: i32) {
        // SAFETY: the functions that are called so take one int and answer nothing.
        unsafe { self.library.get::<extern "C" fn(i32)>(function).unwrap()(value) };
    }

    /// Calls one of the stand-in's own functions that answers a number.
    pub fn get(&self, function: &str) -> i32 {
        // SAFETY: the functions that are called so take nothing and answer an int.
        unsafe { self.library.get::<extern "C" fn() -> i32>(function).unwrap()() }
    }

    /// How many frames the servo thread has made.
    pub fn frames(&self) -> i64 {
        // SAFETY: it takes nothing and answers a long.
        unsafe { self.library.get::<extern "C" fn() -> std::ffi::c_long>("stand_in_frames").unwrap()() }
    }

    /// Moves the hand (m).
    pub fn hand(&self, x: f64, y: f64, z: f64) {
        // SAFETY: it takes three doubles.
        unsafe { self.library.get::<extern "C" fn(f64, f64, f64)>("stand_in_hand").unwrap()(x, y, z) };
    }

    /// Force and torque that the motors were asked for last (N, N m).
    pub fn force(&self) -> [f64; 6] {
        let mut out = [0.0; 6];
        // SAFETY: it writes six doubles at most.
        unsafe { self.library.get::<extern "C" fn(*mut f64)>("stand_in_force").unwrap()(out.as_mut_ptr()) };
        out
    }
}

/// Tick `index` of a clock at 1 kHz.
pub fn tick(index: u64) -> TickTime {
    TickTime::regular(index, 1e-3)
}

/// A file that is a library of somebody else.
pub fn other_library(folder: &Path) -> PathBuf {
    let (source, path) = (folder.join("other.c"), folder.join("libother.so"));
    std::fs::write(&source, "int other(void) { return 1; }\n").unwrap();
    let status = Command::new("cc").args(["-shared", "-fPIC"]).arg(&source).arg("-o").arg(&path).status().unwrap();
    assert!(status.success());
    path
}
