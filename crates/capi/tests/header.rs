//! Is `include/palpate.h` what the source says? `cargo xtask header` writes it anew.

use std::path::Path;

/// The header of this source.
fn header() -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_file(folder.join("cbindgen.toml")).expect("cbindgen.toml is read");
    let files = ["status", "options", "statistics", "simulation", "input", "output", "port", "surface"];
    let builder = files.iter().fold(cbindgen::Builder::new().with_config(config), |builder, file| {
        builder.with_src(folder.join(format!("src/{file}.rs")))
    });
    let mut bytes = Vec::new();
    builder.generate().expect("the source is understood").write(&mut bytes);
    let text = String::from_utf8(bytes).expect("the source is UTF-8");
    // What Rust calls safety is what the caller answers for; the highest flag is no signed number.
    text.replace("# Safety\n", "The caller answers for this:\n").replace("(1 << ", "(1u << ")
}

#[test]
fn the_header_is_that_of_the_source() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("include/palpate.h");
    let text = header();
    if std::env::var_os("PALPATE_WRITE_HEADER").is_some() {
        std::fs::write(&path, &text).expect("the header can be written");
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    let line = text.lines().zip(committed.lines()).position(|(a, b)| a != b);
    assert!(committed == text, "include/palpate.h differs from line {line:?} on: run `cargo xtask header`");
}

#[test]
fn every_function_of_the_source_is_in_the_header_once() {
    let source = ["status", "simulation", "port", "surface"].map(|file| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("src/{file}.rs"));
        std::fs::read_to_string(path).expect("the source is there")
    });
    let names = source.iter().flat_map(|text| text.lines()).filter_map(|line| {
        let name = line.split("extern \"C\" fn ").nth(1)?;
        name.split('(').next()
    });
    let names: Vec<&str> = names.collect();
    assert!(names.len() >= 14, "{names:?}");
    let text = header();
    for name in names {
        let count = text.matches(&format!(" {name}(")).count() + text.matches(&format!("*{name}(")).count();
        assert_eq!(count, 1, "{name}");
    }
}
