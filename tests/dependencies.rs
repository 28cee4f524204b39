//! Do dependencies point down only, from one place for versions, under licences that allow any use?

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use cargo_metadata::{DependencyKind, Metadata, MetadataCommand, Package};

/// What each of our crates may know of the others. Not listed: knows none of them.
const MAY_KNOW: &[(&str, &[&str])] = &[
    ("palpate-constraints", &["palpate-fem", "palpate-collision"]),
    ("palpate-solver", &["palpate-constraints"]),
    ("palpate-haptics", &["palpate-solver", "palpate-constraints", "palpate-collision"]),
    ("palpate-devices", &["palpate-haptics", "palpate-trace"]),
    (
        "palpate",
        &[
            "palpate-fem",
            "palpate-collision",
            "palpate-rigid",
            "palpate-constraints",
            "palpate-solver",
            "palpate-haptics",
            "palpate-trace",
            "palpate-devices",
        ],
    ),
    ("palpate-cli", &["palpate"]),
    ("palpate-capi", &["palpate"]),
];

/// Licences without a condition on programs that link the work. MPL-2.0 binds the licensed files only.
const ALLOWED: &[&str] = &[
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-1-Clause",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "ISC",
    "MIT",
    "MIT-0",
    "MPL-2.0",
    "Unicode-3.0",
    "Unicode-DFS-2016",
    "Unlicense",
    "Zlib",
];

/// The resolved packages of this platform, from the lock file and without the network: what was built here is there.
fn metadata() -> Metadata {
    let version = Command::new(option_env!("RUSTC").unwrap_or("rustc")).arg("-vV").output().expect("rustc answers");
    let text = String::from_utf8(version.stdout).expect("rustc speaks UTF-8");
    let host = text.lines().find_map(|line| line.strip_prefix("host: ")).expect("rustc names its host").to_owned();
    let arguments = ["--locked", "--offline", "--filter-platform", &host].map(str::to_owned);
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml");
    MetadataCommand::new().manifest_path(manifest).other_options(arguments.to_vec()).exec().expect("cargo answers")
}

fn ours(metadata: &Metadata) -> BTreeMap<&str, &Package> {
    metadata.workspace_packages().into_iter().map(|p| (p.name.as_str(), p)).collect()
}

#[test]
fn our_crates_know_only_what_lies_below_them() {
    let metadata = metadata();
    let ours = ours(&metadata);
    for expected in MAY_KNOW.iter().flat_map(|(name, below)| below.iter().chain([name])) {
        assert!(ours.contains_key(expected), "the workspace has no crate {expected}");
    }
    for (name, package) in &ours {
        let allowed = MAY_KNOW.iter().find(|(crate_name, _)| crate_name == name).map_or(&[][..], |(_, below)| below);
        // Tests and build scripts too: a crate whose tests need what lies above it is not below it.
        for dependency in package.dependencies.iter().filter(|d| ours.contains_key(d.name.as_str())) {
            let known = dependency.name.as_str();
            assert!(allowed.contains(&known), "{name} must not know {known}; it may know {allowed:?}");
        }
    }
}

#[test]
fn every_edge_of_the_drawing_is_used() {
    let metadata = metadata();
    let ours = ours(&metadata);
    for (name, below) in MAY_KNOW {
        let used: BTreeSet<_> = ours[name]
            .dependencies
            .iter()
            .filter(|d| d.kind == DependencyKind::Normal)
            .map(|d| d.name.as_str())
            .collect();
        let idle: Vec<_> = below.iter().filter(|b| !used.contains(**b)).collect();
        // A permission that nobody needs hides the day on which somebody takes it by mistake.
        assert!(idle.is_empty(), "{name} does not depend on {idle:?}: take the permission away");
    }
}

/// Whether an SPDX expression can be met by [`ALLOWED`] alone. `/` is the old way of writing `OR`.
fn is_allowed(expression: &str) -> bool {
    let expression = expression.replace('/', " OR ");
    let mut rest = expression.trim().to_owned();
    // Innermost parentheses first: each is replaced by a licence that is allowed, or by one that is not.
    while let Some(open) = rest.rfind('(') {
        let Some(length) = rest[open..].find(')') else { return false };
        let verdict = if is_allowed(&rest[open + 1..open + length]) { "MIT" } else { "refused" };
        rest.replace_range(open..=open + length, verdict);
    }
    let all = |term: &str| term.split(" AND ").all(|licence| ALLOWED.contains(&licence.trim()));
    rest.split(" OR ").any(all)
}

#[test]
fn licences_are_read_as_they_are_meant() {
    for good in ["MIT", "MIT/Apache-2.0", "GPL-3.0 OR MIT", "(MIT OR GPL-2.0) AND Unicode-3.0", "Apache-2.0 / MIT"] {
        assert!(is_allowed(good), "{good}");
    }
    for bad in ["GPL-3.0", "LGPL-2.1 AND MIT", "AGPL-3.0-only", "(GPL-2.0 OR LGPL-3.0) AND MIT", "", "MIT AND (GPL-2.0"]
    {
        assert!(!is_allowed(bad), "{bad}");
    }
}

#[test]
fn no_third_party_licence_binds_a_user() {
    let metadata = metadata();
    let others: Vec<_> = metadata.packages.iter().filter(|p| p.source.is_some()).collect();
    assert!(others.len() > 50, "only {} packages: the lock file is not what was read", others.len());
    let refused: Vec<_> = others
        .iter()
        .filter(|p| !p.license.as_deref().is_some_and(is_allowed))
        .map(|p| format!("{} {}: {:?}", p.name, p.version, p.license))
        .collect();
    assert!(refused.is_empty(), "{}", refused.join("\n"));
}

#[test]
fn ours_share_version_licence_and_edition() {
    let metadata = metadata();
    for (name, package) in ours(&metadata) {
        assert_eq!(package.license.as_deref(), Some("MIT OR Apache-2.0"), "{name}");
        assert_eq!(package.version, ours(&metadata)["palpate"].version, "{name}");
        assert_eq!(package.edition, ours(&metadata)["palpate"].edition, "{name}");
        assert_eq!(package.rust_version, ours(&metadata)["palpate"].rust_version, "{name}");
    }
}

#[test]
fn every_version_is_written_once_in_the_workspace() {
    let metadata = metadata();
    let manifests: Vec<PathBuf> = ours(&metadata).values().map(|p| p.manifest_path.clone().into()).collect();
    for path in manifests {
        let manifest: toml::Table = std::fs::read_to_string(&path).unwrap().parse().unwrap();
        let mut tables: Vec<&toml::Table> = Vec::new();
        let kinds = ["dependencies", "dev-dependencies", "build-dependencies"];
        let mut gather = |table: &'static str| tables.extend(manifest.get(table).and_then(toml::Value::as_table));
        kinds.into_iter().for_each(&mut gather);
        let targets = manifest.get("target").and_then(toml::Value::as_table);
        for target in targets.into_iter().flat_map(|t| t.values()).filter_map(toml::Value::as_table) {
            tables.extend(kinds.iter().filter_map(|kind| target.get(*kind)).filter_map(toml::Value::as_table));
        }
        for (name, dependency) in tables.into_iter().flatten() {
            let inherited = dependency.get("workspace").and_then(toml::Value::as_bool) == Some(true);
            assert!(inherited, "{}: {name} names its own version; move it to the workspace", path.display());
        }
    }
}
