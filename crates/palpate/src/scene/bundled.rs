//! The scenes that the program carries.

/// A scene and the files it names, embedded in the program.
pub struct BundledScene {
    /// Name for `palpate run NAME`.
    pub name: &'static str,
    /// The text of the scene file.
    pub text: &'static str,
}

/// All bundled scenes.
pub const BUNDLED_SCENES: &[BundledScene] = &[
    BundledScene { name: "liver", text: include_str!("../../../../examples/scenes/liver.toml") },
    BundledScene { name: "block", text: include_str!("../../../../examples/scenes/block.toml") },
    BundledScene { name: "cut", text: include_str!("../../../../examples/scenes/cut.toml") },
    BundledScene { name: "grasp", text: include_str!("../../../../examples/scenes/grasp.toml") },
];

/// A file that bundled scenes name, embedded in the program.
pub(super) fn bundled_file(name: &str) -> Option<&'static [u8]> {
    match name {
        "liver.inr.gz" => Some(include_bytes!("../../../../examples/scenes/liver.inr.gz")),
        _ => None,
    }
}
