//! Where the tetrahedra of a body come from: a mesh file, a label image, a closed surface or a block.

use std::path::Path;

use palpate_fem::block::{block, evenly};
use palpate_fem::closed_surface::ClosedSurface;
use palpate_fem::format;
use palpate_fem::image::LabelImage;
use palpate_fem::mesh::{MeshWarning, TetMesh};
use palpate_fem::stuffing::{Stuffing, StuffingError, StuffingReport, stuff_image, stuff_surface};

use crate::scene::{Scene, SceneError, SceneFile};

/// Tetrahedra, what is odd about them, and whether their unit is.
pub(super) struct Loaded {
    pub(super) mesh: TetMesh,
    pub(super) warnings: Vec<String>,
    pub(super) unit: Option<MeshWarning>,
}

/// Reads the mesh, or makes it from an image or a closed surface.
pub(super) fn load(scene: &Scene) -> Result<Loaded, SceneError> {
    let body = &scene.description().bodies[0];
    if let Some(name) = &body.mesh {
        let SceneFile::Path(path) = scene.file(name) else {
            return Err(scene.at(
                "body.0.mesh",
                format!("`{name}` is not a mesh"),
                "name it as `image`, with a `cell`",
            ));
        };
        scene.check_file("body.0.mesh", &path)?;
        let file = format::read(&path)?;
        let scaled = body.scale != 1.0;
        let of_units = |w: &MeshWarning| matches!(w, MeshWarning::Units { .. });
        let said = || file.warnings.iter().filter(|w| !(scaled && of_units(w)));
        let warnings = said().map(ToString::to_string).collect();
        let unit = said().find(|w| of_units(w)).cloned();
        return Ok(Loaded { mesh: file.mesh.scaled(body.scale)?, warnings, unit });
    }
    if let Some(b) = &body.block {
        let axis = |c: usize| evenly(b.min[c], b.max[c], b.cells[c]);
        let mesh = block(&axis(0), &axis(1), &axis(2)).scaled(body.scale)?;
        let unit = MeshWarning::of_width(mesh.bounding_box().diagonal());
        return Ok(Loaded { mesh, warnings: Vec::new(), unit });
    }
    let (Some(name), Some(cell)) = (&body.image, body.cell) else {
        return Err(scene.at("body.0", "the body has no geometry", "add `mesh` or `image` with `cell`"));
    };
    let stuffing = Stuffing::of_labels(cell, body.labels.iter().map(|(name, label)| (name.as_str(), *label)));
    let made = match scene.file(name) {
        SceneFile::Embedded(bytes) => {
            stuff_image(&LabelImage::from_inrimage_bytes(bytes)?, &stuffing).map_err(SceneError::from)
        }
        SceneFile::Path(path) => {
            scene.check_file("body.0.image", &path)?;
            make(&path, body.scale, &stuffing)
        }
    };
    let (mesh, report) = made.map_err(|error| match error {
        SceneError::Stuffing(absent @ StuffingError::NoSuchLabel { .. }) => {
            scene.at("body.0.labels", absent.to_string(), "name labels that the image has")
        }
        other => other,
    })?;
    let mut warnings = Vec::new();
    if report.dropped_bodies > 0 {
        let cubic_centimetres = 1e6 * report.dropped_volume;
        warnings.push(format!("{} smaller parts of {cubic_centimetres:.2} cm³ were left out", report.dropped_bodies));
    }
    // A few stray voxels are noise of the segmentation, not a region that somebody misses.
    let lost = report.regions.iter().filter(|r| r.tetrahedra == 0 && r.label_volume > 1e-4 * report.label_volume);
    warnings.extend(lost.map(|r| format!("the cells are too large for region {}: it has no tetrahedron", r.name)));
    Ok(Loaded { mesh, warnings, unit: None })
}

/// True for files of closed surfaces, by their ending; everything else is read as a label image.
pub fn is_surface(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    matches!(extension.as_str(), "stl" | "obj" | "ply")
}

/// Makes tetrahedra from a closed surface (STL, OBJ, PLY: in units of `scale` metres) or a label image.
///
/// # Errors
/// A file that cannot be read, a surface that is not closed, a cell that does not suit.
pub fn make(path: &Path, scale: f64, stuffing: &Stuffing) -> Result<(TetMesh, StuffingReport), SceneError> {
    Ok(if is_surface(path) {
        stuff_surface(&ClosedSurface::from_path(path, scale)?, stuffing)?
    } else {
        stuff_image(&LabelImage::from_path(path)?, stuffing)?
    })
}
