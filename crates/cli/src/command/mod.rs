//! One file per command.

pub(crate) mod chart;
pub(crate) mod check;
pub(crate) mod devices;
pub(crate) mod equilibrium;
pub(crate) mod mesh;
pub(crate) mod plan;
pub(crate) mod replay;
pub(crate) mod run;
pub(crate) mod scenes;
pub(crate) mod solve;

use miette::{Diagnostic, LabeledSpan, NamedSource, Report};
use palpate::scene::{InvalidScene, SceneError};

/// A scene error with the place in the file, for miette to show.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
struct ScenePlace {
    message: String,
    remedy: Option<String>,
    source_code: NamedSource<String>,
    span: std::ops::Range<usize>,
}

impl Diagnostic for ScenePlace {
    fn help<'a>(&'a self) -> Option<Box<dyn std::fmt::Display + 'a>> {
        self.remedy.as_ref().map(|r| Box::new(r) as Box<dyn std::fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn miette::SourceCode> {
        Some(&self.source_code)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        Some(Box::new(std::iter::once(LabeledSpan::new_with_span(Some("here".into()), self.span.clone()))))
    }
}

/// Turns a scene error into a report that shows the place and the remedy.
pub(crate) fn report(error: SceneError) -> Report {
    match error {
        SceneError::Invalid(invalid) => {
            let InvalidScene { origin, text, span, message, remedy, .. } = *invalid;
            Report::new(ScenePlace { message, remedy, source_code: NamedSource::new(origin, text), span })
        }
        other => Report::msg(other.to_string()),
    }
}
