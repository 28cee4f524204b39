//! A scene made ready: mesh, body, symbolic factorisation, tool. Nothing in it changes while a run lasts.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};
use palpate_collision::broad_phase::SurfaceGeometry;
use palpate_collision::contact::ContactSet;
use palpate_collision::detection::{DetectionConfig, DetectionWorkspace, detect};
use palpate_collision::shape::ToolShape;
use palpate_fem::block::{block, evenly};
use palpate_fem::closed_surface::ClosedSurface;
use palpate_fem::factor::SymbolicFactor;
use palpate_fem::format;
use palpate_fem::image::LabelImage;
use palpate_fem::material::MaterialError;
use palpate_fem::mesh::{BoundingBox, MeshQuality, MeshWarning, TetMesh};
use palpate_fem::model::{FemConfig, FemError, FemModel};
use palpate_fem::stuffing::{Stuffing, StuffingReport, stuff_image, stuff_surface};
use palpate_fem::surface::Surface;

use crate::scene::{NodeSelection, Scene, SceneDescription, SceneError, SceneFile};

/// A scene made ready to run.
pub struct World {
    scene: Scene,
    mesh: TetMesh,
    quality: MeshQuality,
    surface: Surface,
    model: FemModel,
    symbolic: Arc<SymbolicFactor>,
    geometry: SurfaceGeometry,
    detection: DetectionConfig,
    warnings: Vec<String>,
}

impl World {
    /// The scene that it was built from.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The description of that scene.
    pub fn description(&self) -> &SceneDescription {
        self.scene.description()
    }

    /// The step (s).
    pub fn dt(&self) -> f64 {
        1.0 / self.description().rates.step
    }

    /// The mesh of the body (m).
    pub fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    /// The boundary of that mesh.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// The body.
    pub fn model(&self) -> &FemModel {
        &self.model
    }

    /// The symbolic factorisation of its system matrix.
    pub fn symbolic(&self) -> &Arc<SymbolicFactor> {
        &self.symbolic
    }

    /// The boundary as detection sees it, at rest.
    pub fn geometry(&self) -> &SurfaceGeometry {
        &self.geometry
    }

    /// The shape of the tool.
    pub fn tool(&self) -> &ToolShape {
        &self.description().tools[0].shape
    }

    /// How contacts are found.
    pub fn detection(&self) -> &DetectionConfig {
        &self.detection
    }

    /// What is odd but no mistake.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The pose of the tool before the first step: where the hand's path begins.
    pub fn first_pose(&self) -> Isometry3<f64> {
        first_pose(self.description())
    }

    /// What was understood of the scene, as text for people.
    pub fn understood(&self) -> String {
        let d = self.description();
        let body = &d.bodies[0];
        let q = &self.quality;
        let mut text = String::new();
        let fixed = self.mesh.nodes.len() - self.model.free_nodes();
        // Writing to a string cannot fail.
        let _ = writeln!(text, "scene {}: {}", d.name, d.description);
        let _ = writeln!(
            text,
            "body {}: {} nodes ({fixed} fixed), {} tetrahedra, {:.1} cm³, {:.3} kg",
            body.name,
            self.mesh.nodes.len(),
            self.mesh.tetrahedra.len(),
            q.volume * 1e6,
            self.model.mass().iter().sum::<f64>(),
        );
        for (k, name) in self.mesh.region_names.iter().enumerate() {
            let count = self.mesh.regions.iter().filter(|&&r| usize::from(r) == k).count();
            let _ = writeln!(text, "  region {name}: {count} tetrahedra, {}", material_of(body, name));
        }
        let _ = writeln!(text, "  dihedral angles {:.1}° to {:.1}°", q.dihedral[0], q.dihedral[2]);
        let _ = writeln!(text, "tool {}: {}", d.tools[0].name, one_line(&d.tools[0].shape));
        let c = &d.contact;
        let _ = writeln!(
            text,
            "contact at {} within {:.1} mm, friction {}, at most {} contacts",
            format!("{:?}", c.at).to_lowercase(),
            c.margin * 1e3,
            c.friction,
            c.max_contacts
        );
        let _ = writeln!(
            text,
            "rates: step {} Hz, factor {} Hz, tick {} Hz; compliance {}",
            d.rates.step,
            d.rates.factor,
            d.rates.tick,
            format!("{:?}", body.compliance).to_lowercase()
        );
        let _ = write!(
            text,
            "factor: {:.2} million nonzeros, {:.0} million operations; device {}, hand {}, {} s",
            self.symbolic.nonzeros() as f64 / 1e6,
            self.symbolic.flops() / 1e6,
            d.device.kind,
            d.hand.preset,
            d.seconds
        );
        text
    }
}

fn material_of(body: &crate::scene::BodyDescription, region: &str) -> String {
    one_line(body.regions.get(region).unwrap_or(&body.material))
}

/// A value as a scene file would say it, on one line.
fn one_line(value: &impl serde::Serialize) -> String {
    toml::to_string(value).unwrap_or_default().trim_end().replace('\n', ", ")
}

fn first_pose(description: &SceneDescription) -> Isometry3<f64> {
    let [x, y, z] = description.hand.path[0].position;
    Isometry3::translation(x, y, z)
}

/// Builds the world of a checked scene.
pub(crate) fn build(scene: &Scene) -> Result<World, SceneError> {
    let Loaded { mesh, warnings, unit } = load(scene)?;
    // A wrong unit shows as tools inside the body, or as planes that hold every node.
    assemble(scene, mesh, warnings).map_err(|error| match &unit {
        Some(warning) => error.hint(&warning.to_string()),
        None => error,
    })
}

fn assemble(scene: &Scene, mesh: TetMesh, mut warnings: Vec<String>) -> Result<World, SceneError> {
    let description = scene.description();
    let body = &description.bodies[0];
    let quality = mesh.validate()?;
    warnings.extend(quality.warnings().iter().map(ToString::to_string));
    warnings.dedup();
    let surface = mesh.surface();
    let fixed = fixed_nodes(scene, &mesh)?;
    for name in body.regions.keys() {
        if !mesh.region_names.contains(name) {
            let known = mesh.region_names.join(", ");
            let message = format!("the mesh has no region `{name}`");
            return Err(scene.at(&format!("body.0.regions.{name}"), message, format!("its regions are {known}")));
        }
    }
    let config = FemConfig {
        material: body.material,
        region_materials: body.regions.clone(),
        density: body.density,
        total_mass: body.total_mass,
        rayleigh_mass: body.rayleigh_mass,
        rayleigh_stiffness: body.rayleigh_stiffness,
        gravity: Vector3::from(description.gravity),
        fixed,
        filter: body.definiteness_filter,
        ..FemConfig::default()
    };
    if config.fixed.is_empty() {
        warnings.push("no node is fixed: nothing holds the body; hold it with `fixed = [...]`".into());
    }
    let model = FemModel::new(&mesh, &config).map_err(|e| unusable_body(scene, &e))?;
    let positions: Vec<_> = model.node_of_free().iter().map(|&n| mesh.nodes[n as usize]).collect();
    let symbolic = SymbolicFactor::new(model.pattern(), &positions)
        .map_err(|e| scene.at("body.0", e.to_string(), "use a smaller mesh"))?;
    let contact = &description.contact;
    let detection = DetectionConfig {
        kind: contact.at,
        margin: contact.margin,
        reach: contact.reach,
        merge_distance: contact.merge_distance,
        max_contacts: contact.max_contacts,
        ..DetectionConfig::default()
    };
    detection.validate().map_err(|e| scene.at("contact", e.to_string(), "correct the value"))?;
    let geometry = SurfaceGeometry::new(surface.triangles.clone(), &mesh.nodes)
        .map_err(|e| scene.at("body.0", e.to_string(), "use a mesh with a closed boundary"))?;
    let world = World {
        scene: scene.clone(),
        mesh,
        quality,
        surface,
        model,
        symbolic: Arc::new(symbolic),
        geometry,
        detection,
        warnings,
    };
    tool_outside(&world)?;
    Ok(world)
}

/// The place of a mistake in the body.
fn unusable_body(scene: &Scene, error: &FemError) -> SceneError {
    let FemError::Material { place, error: material } = error else {
        return scene.at("body.0", error.to_string(), "correct the body's materials, density or fixed nodes");
    };
    let law = match place.strip_prefix("region `").and_then(|p| p.strip_suffix('`')) {
        Some(region) => format!("body.0.regions.{region}"),
        None => "body.0.material".to_string(),
    };
    let (key, remedy) = match material {
        MaterialError::Young(_) => ("young", "give a positive modulus in pascals, such as 5e3"),
        MaterialError::Poisson(_) => ("poisson", "give a ratio below 0.5, such as 0.45"),
        MaterialError::ShearModulus(_) => ("mu", "give a positive modulus in pascals, such as 2e3"),
        MaterialError::VolumeModulus { .. } => ("k0", "give a positive modulus in pascals, such as 2e4"),
        MaterialError::ParameterPair => ("law", "give `young` and `poisson`"),
    };
    scene.at(&format!("{law}.{key}"), error.to_string(), remedy)
}

/// Tetrahedra, what is odd about them, and whether their unit is.
struct Loaded {
    mesh: TetMesh,
    warnings: Vec<String>,
    unit: Option<MeshWarning>,
}

/// Reads the mesh, or makes it from an image or a closed surface.
fn load(scene: &Scene) -> Result<Loaded, SceneError> {
    let body = &scene.description().bodies[0];
    if let Some(name) = &body.mesh {
        let SceneFile::Path(path) = scene.file(name) else {
            return Err(scene.at(
                "body.0.mesh",
                format!("`{name}` is not a mesh"),
                "name it as `image`, with a `cell`",
            ));
        };
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
        return Ok(Loaded { mesh, warnings: Vec::new(), unit: None });
    }
    let (Some(name), Some(cell)) = (&body.image, body.cell) else {
        return Err(scene.at("body.0", "the body has no geometry", "add `mesh` or `image` with `cell`"));
    };
    let stuffing = Stuffing { cell, ..Stuffing::default() };
    let (mesh, report) = match scene.file(name) {
        SceneFile::Embedded(bytes) => stuff_image(&LabelImage::from_inrimage_bytes(bytes)?, &stuffing)?,
        SceneFile::Path(path) => make(&path, body.scale, &stuffing)?,
    };
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

/// The nodes that the scene fixes.
fn fixed_nodes(scene: &Scene, mesh: &TetMesh) -> Result<Vec<u32>, SceneError> {
    let mut fixed = vec![false; mesh.nodes.len()];
    for (k, selection) in scene.description().bodies[0].fixed.iter().enumerate() {
        let place = format!("body.0.fixed.{k}");
        let mut count = 0;
        let mut mark = |node: usize| {
            fixed[node] = true;
            count += 1;
        };
        let within = |inside: &dyn Fn(&Vector3<f64>) -> bool, mark: &mut dyn FnMut(usize)| {
            mesh.nodes.iter().enumerate().filter(|(_, x)| inside(x)).for_each(|(i, _)| mark(i));
        };
        match selection {
            NodeSelection::NodeSet(name) => {
                let Some(nodes) = mesh.node_sets.get(name) else {
                    let known: Vec<_> = mesh.node_sets.keys().map(String::as_str).collect();
                    let message = format!("the mesh has no node set `{name}`");
                    return Err(scene.at(&place, message, format!("its node sets are: {}", known.join(", "))));
                };
                nodes.iter().for_each(|&n| mark(n as usize));
            }
            NodeSelection::Region(name) => {
                let Some(region) = mesh.region_names.iter().position(|r| r == name) else {
                    let message = format!("the mesh has no region `{name}`");
                    return Err(scene.at(&place, message, format!("its regions are {}", mesh.region_names.join(", "))));
                };
                let of_region = mesh.tetrahedra.iter().zip(&mesh.regions).filter(|(_, r)| usize::from(**r) == region);
                of_region.flat_map(|(t, _)| t).for_each(|&n| mark(n as usize));
            }
            NodeSelection::Below(p) => within(&|x| x[p.axis.index()] <= p.at, &mut mark),
            NodeSelection::Above(p) => within(&|x| x[p.axis.index()] >= p.at, &mut mark),
            NodeSelection::Box { min, max } => within(&|x| (0..3).all(|c| min[c] <= x[c] && x[c] <= max[c]), &mut mark),
            NodeSelection::Ball { center, radius } => {
                within(&|x| (x - Vector3::from(*center)).norm() <= *radius, &mut mark);
            }
        }
        if count == 0 {
            let BoundingBox { min: low, max: high } = mesh.bounding_box();
            let message = "this selection holds no node";
            let remedy = format!(
                "the body spans x {:.4}..{:.4}, y {:.4}..{:.4}, z {:.4}..{:.4} m",
                low.x, high.x, low.y, high.y, low.z, high.z
            );
            return Err(scene.at(&place, message, remedy));
        }
    }
    if fixed.iter().all(|&f| f) && !fixed.is_empty() {
        return Err(scene.at("body.0.fixed", "every node is fixed: nothing can move", "fix fewer nodes"));
    }
    Ok((0..fixed.len()).filter(|&n| fixed[n]).map(|n| n as u32).collect())
}

/// Refuses a tool that begins inside the body: there is no skin that it came through.
fn tool_outside(world: &World) -> Result<(), SceneError> {
    let mut ws = DetectionWorkspace::new(&world.geometry);
    let mut contacts = ContactSet::with_capacity(world.detection.max_contacts);
    let pose = world.first_pose();
    let report =
        detect(&world.geometry, &world.mesh.nodes, world.tool(), &pose, &world.detection, &mut ws, &mut contacts);
    if report.tool_inside {
        let p = pose.translation.vector;
        let message = format!("the tool begins inside the body, at {:.4}, {:.4}, {:.4} m", p.x, p.y, p.z);
        return Err(world.scene.at("hand.path.0", message, "begin outside the skin, then press"));
    }
    Ok(())
}
