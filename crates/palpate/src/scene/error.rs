//! Mistakes in a scene, found before anything runs.

use std::ops::Range;
use std::path::PathBuf;

/// Why a scene cannot be run, where in the file, and what to do about it.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The file cannot be read.
    #[error("{path}: {source}; name a scene file, or one of {}", bundled_names(), path = path.display())]
    Unreadable {
        /// The scene file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// Neither a file nor a bundled scene has this name.
    #[error("there is no scene file or bundled scene `{name}`; {remedy}")]
    Unknown {
        /// What was asked for.
        name: String,
        /// The nearest name, or how to list them.
        remedy: String,
    },
    /// The text is not a scene, or a value is outside its range.
    #[error(transparent)]
    Invalid(Box<InvalidScene>),
    /// The mesh cannot be used.
    #[error(transparent)]
    Mesh(#[from] palpate_fem::mesh::MeshError),
    /// The label image cannot be used.
    #[error(transparent)]
    Image(#[from] palpate_fem::image::ImageError),
    /// The closed surface cannot be used.
    #[error(transparent)]
    Surface(#[from] palpate_fem::closed_surface::SurfaceError),
    /// Tetrahedra cannot be made from the image or surface.
    #[error(transparent)]
    Stuffing(#[from] palpate_fem::stuffing::StuffingError),
}

/// A mistake in the text of a scene.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{origin}:{line}:{column}: {message}{}", remedy.as_deref().map(|r| format!("; {r}")).unwrap_or_default())]
pub struct InvalidScene {
    /// File name or name of the bundled scene.
    pub origin: String,
    /// The whole text, for reports that show the place.
    pub text: String,
    /// Bytes of `text` that the message is about.
    pub span: Range<usize>,
    /// Line, counted from 1.
    pub line: usize,
    /// Column, counted from 1.
    pub column: usize,
    /// What is wrong, with the value.
    pub message: String,
    /// What to do.
    pub remedy: Option<String>,
}

impl SceneError {
    /// An error about the bytes `span` of `text`.
    pub(crate) fn invalid(
        origin: &str,
        text: &str,
        span: Range<usize>,
        message: impl Into<String>,
        remedy: Option<String>,
    ) -> Self {
        let start = span.start.min(text.len());
        let before = text.get(..start).unwrap_or("");
        let line = before.matches('\n').count() + 1;
        let column = before.rsplit('\n').next().map_or(0, |l| l.chars().count()) + 1;
        let (origin, text, message) = (origin.into(), text.into(), message.into());
        Self::Invalid(Box::new(InvalidScene { origin, text, span, line, column, message, remedy }))
    }

    /// What is wrong and the remedy, without the place: for who has not written the text.
    pub(crate) fn reason(&self) -> String {
        match self {
            Self::Invalid(invalid) => {
                let remedy = invalid.remedy.as_deref().map(|r| format!("; {r}")).unwrap_or_default();
                format!("{}{remedy}", invalid.message)
            }
            other => other.to_string(),
        }
    }

    /// Adds something that may be behind the mistake to its remedy.
    pub(crate) fn hint(mut self, hint: &str) -> Self {
        if let Self::Invalid(invalid) = &mut self {
            let remedy = invalid.remedy.take().map(|r| format!("{r}; ")).unwrap_or_default();
            invalid.remedy = Some(format!("{remedy}{hint}"));
        }
        self
    }
}

/// Names of the bundled scenes, for messages.
pub(super) fn bundled_names() -> String {
    super::BUNDLED_SCENES.iter().map(|s| s.name).collect::<Vec<_>>().join(", ")
}

/// The candidate that is spelled most like `word`, if any is near.
pub(crate) fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .into_iter()
        .map(|c| (strsim::jaro_winkler(word, c), c))
        .filter(|(score, _)| *score > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, c)| c)
}
