//! Damaged files of every format end in a mesh or an error: no panic, and no memory beyond a multiple of the file.

use std::path::Path;

use crate::format_samples::all;
use palpate_fem::format::{MeshFile, inspect_bytes, inspect_tetgen};
use palpate_fem::mesh::MeshError;
use proptest::prelude::*;
use proptest::sample::Index;

/// One way to damage a file.
#[derive(Clone, Debug)]
enum Damage {
    Truncate(Index),
    Byte(Index, u8),
    Bit(Index, u8),
    Insert(Index, &'static str),
    Remove(Index, usize),
    Repeat(Index, usize),
    /// Replaces the number (text) that starts at or after the place.
    Number(Index, &'static str),
}

/// Words that hurt: counts beyond memory, negative and huge numbers, words that are not numbers, keywords.
const WORDS: [&str; 16] = [
    "99999999999",
    "18446744073709551615",
    "4294967296",
    "-1",
    "0",
    "nan",
    "inf",
    "1e400",
    "x",
    "$Nodes",
    "<Piece NumberOfPoints=\"1\" NumberOfCells=\"99999999999\">",
    "</DataArray>",
    "_",
    "=",
    "\u{0}\u{0}\u{0}",
    "\u{7f}\u{7f}\u{7f}\u{7f}\u{7f}\u{7f}\u{7f}\u{7f}",
];

fn damage() -> impl Strategy<Value = Damage> {
    let place = any::<Index>;
    let word = || prop::sample::select(&WORDS[..]);
    prop_oneof![
        1 => place().prop_map(Damage::Truncate),
        3 => (place(), any::<u8>()).prop_map(|(at, byte)| Damage::Byte(at, byte)),
        3 => (place(), 0..8_u8).prop_map(|(at, bit)| Damage::Bit(at, bit)),
        2 => (place(), word()).prop_map(|(at, word)| Damage::Insert(at, word)),
        1 => (place(), 1..40_usize).prop_map(|(at, length)| Damage::Remove(at, length)),
        1 => (place(), 1..200_usize).prop_map(|(at, length)| Damage::Repeat(at, length)),
        4 => (place(), word()).prop_map(|(at, word)| Damage::Number(at, word)),
    ]
}

fn apply(bytes: &mut Vec<u8>, damage: &Damage) {
    if bytes.is_empty() {
        return;
    }
    let length = bytes.len();
    match *damage {
        Damage::Truncate(at) => bytes.truncate(at.index(length)),
        Damage::Byte(at, byte) => bytes[at.index(length)] = byte,
        Damage::Bit(at, bit) => bytes[at.index(length)] ^= 1 << bit,
        Damage::Insert(at, word) => {
            let at = at.index(length);
            bytes.splice(at..at, word.bytes());
        }
        Damage::Remove(at, removed) => {
            let at = at.index(length);
            bytes.drain(at..(at + removed).min(length));
        }
        Damage::Repeat(at, repeated) => {
            let at = at.index(length);
            let part = bytes[at..(at + repeated).min(length)].to_vec();
            bytes.splice(at..at, part);
        }
        Damage::Number(at, word) => {
            let start = bytes.iter().skip(at.index(length)).position(u8::is_ascii_digit).map(|i| i + at.index(length));
            let Some(start) = start else { return };
            let digits = bytes[start..].iter().take_while(|byte| byte.is_ascii_digit()).count();
            bytes.splice(start..start + digits, word.bytes());
        }
    }
}

/// What is read must hold together, and must be refused exactly if validation refuses it.
fn hold_together(name: &str, result: Result<MeshFile, MeshError>) -> Result<(), TestCaseError> {
    let file = match result {
        Ok(file) => file,
        Err(error) => {
            prop_assert!(error.to_string().starts_with(name.split('.').next().unwrap_or(name)), "{error}");
            return Ok(());
        }
    };
    let mesh = &file.mesh;
    prop_assert!(mesh.nodes.iter().all(|x| x.iter().all(|value| value.is_finite())));
    prop_assert!(mesh.tetrahedra.iter().flatten().all(|&node| (node as usize) < mesh.nodes.len()));
    prop_assert_eq!(mesh.regions.len(), mesh.tetrahedra.len());
    prop_assert!(mesh.regions.iter().all(|&region| (region as usize) < mesh.region_names.len()));
    prop_assert!(mesh.node_sets.values().flatten().all(|&node| (node as usize) < mesh.nodes.len()));
    prop_assert_eq!(file.refusal.is_none(), mesh.validate().is_ok());
    Ok(())
}

/// The most address space that this process had so far (bytes). Reserved memory counts, touched or not.
fn peak_address_space() -> Option<usize> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmPeak:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<usize>().ok()? * 1024)
}

#[test]
fn damaged_files_of_every_format_end_in_a_mesh_or_an_error_without_much_memory() {
    let samples = all();
    for sample in &samples {
        hold_together(sample.name, inspect_bytes(Path::new(sample.name), &sample.bytes)).ok();
    }
    let before = peak_address_space();
    let case = (0..samples.len(), any::<bool>(), prop::collection::vec(damage(), 1..4));
    let config = ProptestConfig { cases: 30_000, failure_persistence: None, ..ProptestConfig::default() };
    proptest!(config, |((which, in_second, damages) in case)| {
        let sample = &samples[which];
        let mut bytes = sample.bytes.clone();
        let Some(mut ele) = sample.ele.clone() else {
            damages.iter().for_each(|damage| apply(&mut bytes, damage));
            return hold_together(sample.name, inspect_bytes(Path::new(sample.name), &bytes));
        };
        let damaged = if in_second { &mut ele } else { &mut bytes };
        damages.iter().for_each(|damage| apply(damaged, damage));
        let (node_path, ele_path) = (Path::new("tetgen.node"), Path::new("tetgen.ele"));
        hold_together(sample.name, inspect_tetgen(node_path, &bytes, ele_path, &ele))?;
    });
    // Samples are below 4 KiB. A count of 2^32 that was believed would reserve 16 GiB or more. What remains is for the
    // allocator, which reserves up to 128 MiB of addresses for each thread.
    if let (Some(before), Some(after)) = (before, peak_address_space()) {
        assert!(after - before < 1 << 30, "{} MiB were reserved", (after - before) >> 20);
    }
}

#[test]
fn every_truncation_of_every_sample_ends_in_a_mesh_or_an_error() {
    for sample in all() {
        for length in 0..sample.bytes.len() {
            let cut = &sample.bytes[..length];
            let result = match &sample.ele {
                Some(ele) => inspect_tetgen(Path::new(sample.name), cut, Path::new("tetgen.ele"), ele),
                None => inspect_bytes(Path::new(sample.name), cut),
            };
            hold_together(sample.name, result).unwrap();
        }
    }
}
