//! Scenes: a description in TOML or in code, checked before anything is built.

mod argument;
mod bundled;
mod check;
mod culprit;
mod description;
mod error;
mod parse;
mod readable;

use std::path::{Path, PathBuf};

pub use bundled::{BUNDLED_SCENES, BundledScene};
pub(crate) use check::{MOST_SUBSTEPS, Staleness, staleness};
pub use description::{
    Axis, BlockDescription, BodyDescription, ContactDescription, ContactLawKind, ContactMethod, DeviceDescription,
    EventDescription, ExplicitDescription, FixedBodyDescription, HandDescription, IntegratorKind, IsGiven,
    NewtonDescription, NodeSelection, Plane, RatesDescription, Refactor, RigidBodyDescription, SceneDescription,
    SolidShape, SolverDescription, TickDescription, TickMethod, TissueDescription, ToolDescription,
};
pub use error::{InvalidScene, SceneError};

use palpate_fem::mesh::TetMesh;

use crate::world::World;
use argument::{Argument, Before};
use parse::Source;
pub(crate) use readable::Readable;

/// What follows the origin of a scene that was changed after it was read.
const CHANGED: &str = " (as changed)";

/// Where the files that a scene names are looked for.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Files {
    /// Beside the scene file.
    Folder(PathBuf),
    /// In the program.
    Embedded,
}

/// A description that has been checked, with its text for reports and traces.
#[derive(Clone, Debug)]
pub struct Scene {
    description: SceneDescription,
    origin: String,
    text: String,
    /// What it was before arguments of a command line took the place of some values.
    before: Option<Before>,
    files: Files,
}

impl Scene {
    /// Opens a scene file, or the bundled scene of this name where no such file exists.
    ///
    /// # Errors
    /// As [`Scene::load`] and [`Scene::bundled`].
    pub fn open(name: &str) -> Result<Self, SceneError> {
        let path = Path::new(name);
        if path.is_file() || path.extension().is_some() {
            return Self::load(path);
        }
        if path.is_dir() {
            let remedy = format!("{name} is a folder: name a scene file in it");
            return Err(SceneError::Unknown { name: name.into(), remedy });
        }
        Self::bundled(name)
    }

    /// Reads and checks a scene file.
    ///
    /// # Errors
    /// An unreadable file, an unknown key or value, a value outside its range: with the place and the remedy.
    pub fn load(path: &Path) -> Result<Self, SceneError> {
        let unreadable = |source| SceneError::Unreadable { path: path.into(), source };
        let bytes = std::fs::read(path).map_err(unreadable)?;
        let text =
            String::from_utf8(bytes).map_err(|_| unreadable(std::io::Error::other("this is not a text file")))?;
        let folder = path.parent().unwrap_or(Path::new("")).to_path_buf();
        Self::parse(text, path.display().to_string(), Files::Folder(folder))
    }

    /// A scene that the program carries.
    ///
    /// # Errors
    /// An unknown name, with the nearest known one.
    pub fn bundled(name: &str) -> Result<Self, SceneError> {
        let Some(scene) = BUNDLED_SCENES.iter().find(|s| s.name == name) else {
            let remedy = match error::nearest(name, BUNDLED_SCENES.iter().map(|s| s.name)) {
                Some(best) => format!("did you mean `{best}`?"),
                None => format!("the bundled ones are {}", error::bundled_names()),
            };
            return Err(SceneError::Unknown { name: name.into(), remedy });
        };
        Self::parse(scene.text.into(), format!("{name}.toml (bundled)"), Files::Embedded)
    }

    /// Checks a scene from TOML text; files that it names are looked for in `folder`.
    ///
    /// # Errors
    /// As [`Scene::load`].
    pub fn from_toml(text: &str, folder: &Path) -> Result<Self, SceneError> {
        Self::parse(text.into(), "scene".into(), Files::Folder(folder.into()))
    }

    /// Checks a scene that was described in code.
    ///
    /// # Errors
    /// As [`Scene::load`]; places refer to the description written as TOML.
    pub fn new(description: &SceneDescription, folder: &Path) -> Result<Self, SceneError> {
        let text = toml::to_string(description)
            .map_err(|e| SceneError::invalid("scene", "", 0..0, format!("not expressible as TOML: {e}"), None))?;
        Self::parse(text, "scene".into(), Files::Folder(folder.into()))
    }

    /// Checks the scene that a trace carries: its files may be those of the program or of `folder`.
    pub(crate) fn from_trace(text: &str, embedded: bool, folder: &Path) -> Result<Self, SceneError> {
        let files = if embedded { Files::Embedded } else { Files::Folder(folder.into()) };
        Self::parse(text.into(), "scene of the trace".into(), files)
    }

    fn parse(text: String, origin: String, files: Files) -> Result<Self, SceneError> {
        Self::parse_after(None, text, origin, files)
    }

    fn parse_after(before: Option<Before>, text: String, origin: String, files: Files) -> Result<Self, SceneError> {
        let source = Source { origin: &origin, text: &text, before: before.as_ref() };
        let description = source.parse()?;
        check::check(&description, &source)?;
        Ok(Self { description, origin, text, before, files })
    }

    /// The checked description.
    pub fn description(&self) -> &SceneDescription {
        &self.description
    }

    /// Name of the scene.
    pub fn name(&self) -> &str {
        &self.description.name
    }

    /// Length of a run (s) when the caller names none.
    pub fn seconds(&self) -> f64 {
        self.description.seconds
    }

    /// The text of the scene as TOML.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// True where the files of the scene are part of the program.
    pub(crate) fn is_embedded(&self) -> bool {
        self.files == Files::Embedded
    }

    /// Where the files of the scene are looked for; empty for a bundled scene.
    pub(crate) fn folder(&self) -> PathBuf {
        match &self.files {
            Files::Folder(folder) => std::path::absolute(folder).unwrap_or_else(|_| folder.clone()),
            Files::Embedded => PathBuf::new(),
        }
    }

    /// Takes the body's tetrahedra from another file. Materials of regions that this mesh does not have are left out;
    /// the answer names these regions. A mistake in path or scale is told as one of `--mesh` or `--scale`, others at their
    /// place in the scene's own text.
    ///
    /// # Errors
    /// A mesh that cannot be read, a scale that is not a positive number.
    pub fn use_mesh(&mut self, path: &Path, scale: f64) -> Result<Vec<String>, SceneError> {
        let known = palpate_fem::format::read(path)?.mesh.region_names;
        let path = std::path::absolute(path).unwrap_or_else(|_| path.into());
        let absent = |name: &String| !known.contains(name);
        let left_out = self.description.bodies[0].regions.keys().filter(|name| absent(name)).cloned().collect();
        let mut arguments = vec![Argument::new("--mesh", path.display(), &["mesh", "image", "block", "cell"])];
        if scale != 1.0 {
            arguments.push(Argument::new("--scale", scale, &["scale"]));
        }
        self.take(arguments, |description| {
            let body = &mut description.bodies[0];
            body.regions.retain(|name, _| !absent(name));
            (body.mesh, body.image, body.block, body.cell) = (Some(path.display().to_string()), None, None, None);
            body.scale = scale;
        })?;
        Ok(left_out)
    }

    /// Changes the lattice constant (m) of the body's generated tetrahedra. A mistake in it is told as one of `--cell`.
    ///
    /// # Errors
    /// A cell that is not positive, or a body that is read from a mesh.
    pub fn use_cell(&mut self, cell: f64) -> Result<(), SceneError> {
        self.take(vec![Argument::new("--cell", Readable(cell), &["cell"])], |body| body.bodies[0].cell = Some(cell))
    }

    /// Changes the description and checks it again.
    ///
    /// # Errors
    /// As [`Scene::new`]; the scene is unchanged then.
    pub fn edit(&mut self, change: impl FnOnce(&mut SceneDescription)) -> Result<(), SceneError> {
        self.change(None, change)
    }

    /// Changes the description by arguments of a command line: mistakes in what they say point at them, others at the
    /// text as it was.
    fn take(&mut self, new: Vec<Argument>, change: impl FnOnce(&mut SceneDescription)) -> Result<(), SceneError> {
        let mut before = self.before.clone().unwrap_or_else(|| Before::new(&self.origin, &self.text));
        before.arguments.extend(new);
        self.change(Some(before), change)
    }

    fn change(&mut self, before: Option<Before>, by: impl FnOnce(&mut SceneDescription)) -> Result<(), SceneError> {
        let unchanged = self.description.clone();
        by(&mut self.description);
        self.rewrite(before).inspect_err(|_| self.description = unchanged)
    }

    fn rewrite(&mut self, before: Option<Before>) -> Result<(), SceneError> {
        let text = toml::to_string(&self.description)
            .map_err(|e| SceneError::invalid(&self.origin, "", 0..0, format!("not expressible as TOML: {e}"), None))?;
        // The places of later mistakes are places in the new text.
        let origin = match self.origin.strip_suffix(CHANGED) {
            Some(_) => self.origin.clone(),
            None => format!("{}{CHANGED}", self.origin),
        };
        *self = Self::parse_after(before, text, origin, self.files.clone())?;
        Ok(())
    }

    /// Builds everything that a run needs and that never changes while it runs.
    ///
    /// # Errors
    /// Mesh, image or material trouble, an empty selection of fixed nodes, a tool that starts inside the body.
    pub fn build(&self) -> Result<World, SceneError> {
        crate::world::build(self)
    }

    /// As [`Scene::build`], with the body's tetrahedra given in place of the scene's own `mesh`, `image` or `block`: for
    /// programs that make their own. A trace of such a run does not hold what a replay needs.
    ///
    /// # Errors
    /// As [`Scene::build`].
    pub fn build_on(&self, mesh: TetMesh) -> Result<World, SceneError> {
        crate::world::build_on(self, mesh)
    }

    /// The bytes of a file that the scene names, and its path for messages.
    pub(crate) fn file(&self, name: &str) -> SceneFile {
        let path = match &self.files {
            Files::Embedded => PathBuf::from(name),
            Files::Folder(folder) => folder.join(name),
        };
        // A scene copied from a bundled one finds the embedded image where it brought none along.
        match bundled::bundled_file(name) {
            Some(bytes) if self.files == Files::Embedded || !path.exists() => SceneFile::Embedded(bytes),
            _ => SceneFile::Path(path),
        }
    }

    /// Refuses a file that the scene names under this key and that is not there.
    pub(crate) fn check_file(&self, key: &str, path: &Path) -> Result<(), SceneError> {
        let absent = || format!("there is no file {}", path.display());
        let remedy = "check the path; it begins in the folder of the scene";
        if path.exists() { Ok(()) } else { Err(self.at(key, absent(), remedy)) }
    }

    /// An error about a key of this scene.
    pub(crate) fn at(&self, path: &str, message: impl Into<String>, remedy: impl Into<String>) -> SceneError {
        Source { origin: &self.origin, text: &self.text, before: self.before.as_ref() }.at(path, message, remedy)
    }
}

/// A file that a scene names.
pub(crate) enum SceneFile {
    /// On disk.
    Path(PathBuf),
    /// In the program.
    Embedded(&'static [u8]),
}
