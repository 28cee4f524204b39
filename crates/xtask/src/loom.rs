//! The hand-over between threads under loom, which runs two threads in every order that they can have.
//!
//! The buffers below `exchange.rs` are crates of others that know nothing of loom. So this builds, in a folder of its own
//! under `target`, a package of `exchange.rs`, its model tests, and copies of those two crates in which the paths of the
//! atomics lead to loom's: what is checked is the code that runs, with every other word as it was published.

use std::path::{Path, PathBuf};

use crate::guard::{Outcome, cargo, execute, root};

/// The crates that order memory.
const CRATES: [&str; 2] = ["triple_buffer", "rtrb"];

/// Where their atomics come from, and where they are to come from.
const PATHS: [(&str, &str); 2] = [
    ("use core::sync::atomic::", "use loom::sync::atomic::"),
    ("    sync::atomic::{AtomicU8, Ordering},\n};", "};\nuse loom::sync::atomic::{AtomicU8, Ordering};"),
];

const MANIFEST: &str = r#"[package]
name = "exchange_under_loom"
version = "0.0.0"
edition = "2024"
publish = false

[workspace]

[dependencies]
loom = "0.7"
triple_buffer = { path = "triple_buffer" }
rtrb = { path = "rtrb" }
"#;

/// Builds the package and runs its tests.
pub(crate) fn check() -> Outcome {
    let folder = root().join("target/loom");
    let haptics = root().join("crates/haptics");
    write(&folder.join("Cargo.toml"), MANIFEST)?;
    write(&folder.join("src/lib.rs"), "pub mod exchange;\n")?;
    copy(&haptics.join("src/exchange.rs"), &folder.join("src/exchange.rs"))?;
    copy(&haptics.join("tests/loom/exchange.rs"), &folder.join("tests/exchange.rs"))?;
    for name in CRATES {
        take(&published(name)?, &folder.join(name), name)?;
    }
    let mut command = cargo(&["test", "--release", "--manifest-path"]);
    command.arg(folder.join("Cargo.toml"));
    execute(command.env("RUSTFLAGS", "--cfg loom"))
}

/// The folder of a dependency's sources, as the lock file has it.
fn published(name: &str) -> Result<PathBuf, String> {
    let metadata = cargo(&["metadata", "--format-version", "1", "--locked"]).current_dir(root()).output();
    let metadata = metadata.map_err(|e| format!("cargo metadata: {e}"))?;
    let text = String::from_utf8_lossy(&metadata.stdout);
    // A path such as .../triple_buffer-9.0.0/Cargo.toml; backslashes are escaped in JSON.
    let manifest = text
        .split('"')
        .find(|part| part.ends_with("Cargo.toml") && part.contains(&format!("{name}-")) && !part.contains("target"));
    let manifest = manifest.ok_or_else(|| format!("cargo metadata knows no sources of {name}"))?.replace("\\\\", "\\");
    Path::new(&manifest).parent().map(Path::to_path_buf).ok_or_else(|| format!("{manifest} has no folder"))
}

/// Copies manifest and sources of a crate, its atomics replaced.
fn take(from: &Path, to: &Path, name: &str) -> Outcome {
    let manifest = needed_of(&read(&from.join("Cargo.toml"))?);
    write(&to.join("Cargo.toml"), &format!("{manifest}\n[dependencies.loom]\nversion = \"0.7\"\n"))?;
    let mut replaced = 0;
    let sources = std::fs::read_dir(from.join("src")).map_err(|e| format!("{}: {e}", from.display()))?;
    for source in sources.filter_map(Result::ok).map(|entry| entry.path()) {
        let mut text = read(&source)?;
        for (old, new) in PATHS {
            replaced += text.matches(old).count();
            text = text.replace(old, new);
        }
        write(&to.join("src").join(source.file_name().unwrap_or_default()), &text)?;
    }
    if replaced == 0 {
        return Err(format!("{name} takes its atomics from a place that this does not know: see PATHS"));
    }
    Ok(())
}

/// The sections of a manifest that a build of the library needs: its tests and benches ask for more than there is.
fn needed_of(manifest: &str) -> String {
    let mut keep = false;
    let lines = manifest.lines().filter(|line| {
        if line.starts_with('[') {
            keep = ["[package]", "[features]", "[lib]"].contains(line) || line.starts_with("[dependencies");
        }
        keep
    });
    lines.flat_map(|line| [line, "\n"]).collect()
}

fn read(path: &Path) -> Result<String, String> {
    std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))
}

fn write(path: &Path, text: &str) -> Outcome {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(path, text))
        .map_err(|e| format!("{}: {e}", path.display()))
}

fn copy(from: &Path, to: &Path) -> Outcome {
    write(to, &read(from)?)
}
