//! Arguments of a command line that take the place of values in a scene.

use std::fmt::Display;
use std::ops::Range;

/// A scene as it was before arguments changed it.
#[derive(Clone, Debug)]
pub(super) struct Before {
    pub(super) origin: String,
    pub(super) text: String,
    pub(super) arguments: Vec<Argument>,
}

/// An argument as it was given.
#[derive(Clone, Debug)]
pub(super) struct Argument {
    /// Its name and its value.
    pub(super) text: String,
    name: &'static str,
    /// Keys of the body that it decides.
    keys: &'static [&'static str],
}

impl Before {
    /// The scene of this text, without arguments.
    pub(super) fn new(origin: &str, text: &str) -> Self {
        Self { origin: origin.into(), text: text.into(), arguments: Vec::new() }
    }

    /// The last argument that decides the value at a key path.
    pub(super) fn argument(&self, path: &str) -> Option<&Argument> {
        let key = path.strip_prefix("body.0.")?.split('.').next()?;
        self.arguments.iter().rev().find(|argument| argument.keys.contains(&key))
    }
}

impl Argument {
    /// `name value` in the place of these keys of the body.
    pub(super) fn new(name: &'static str, value: impl Display, keys: &'static [&'static str]) -> Self {
        Self { text: format!("{name} {value}"), name, keys }
    }

    /// The bytes of its value in its text.
    pub(super) fn value(&self) -> Range<usize> {
        self.name.len() + 1..self.text.len()
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::{Scene, SceneError};

    /// A mistake in an argument is shown in the argument, one in the text in the text as it was read.
    #[test]
    fn mistakes_are_told_where_they_were_made() {
        let mut scene = Scene::bundled("liver").unwrap();
        scene.use_cell(0.02).unwrap();
        let Err(SceneError::Invalid(told)) = scene.use_cell(-0.5) else { panic!("a cell of -0.5 m") };
        assert_eq!((told.text.as_str(), &told.text[told.span.clone()]), ("--cell -0.5", "-0.5"));
        assert!(told.to_string().starts_with("command line:1:8: "), "{told}");
        assert_eq!(scene.description().bodies[0].cell, Some(0.02), "the scene is unchanged");

        let SceneError::Invalid(told) = scene.at("body.0.density", "too dense", "use less") else { unreachable!() };
        let density = told.text.lines().nth(told.line - 1).unwrap();
        assert!(told.origin == "liver.toml (bundled)" && density.starts_with("density = "), "{told}: {density}");
        // Of what code changes the text as read knows nothing.
        scene.edit(|description| description.seconds = 1.0).unwrap();
        let SceneError::Invalid(told) = scene.at("body.0.cell", "too coarse", "use less") else { unreachable!() };
        assert!(told.origin.ends_with("(as changed)") && told.text.contains("cell = 0.02"), "{told}");
    }
}
