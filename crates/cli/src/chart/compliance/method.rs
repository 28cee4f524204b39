//! The methods that are compared, and what a step by one of them came to.

/// How the contact forces move the body, and what the motion tells about them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Correction {
    /// By the inverse that gave `W`.
    Matching,
    /// By the step's own matrix.
    Exact,
    /// By the step's own matrix, and the forces once more for what that motion opens: what a run does.
    Refined,
}

impl Correction {
    pub(crate) const ALL: [Self; 3] = [Self::Matching, Self::Exact, Self::Refined];

    /// In a word.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Matching => "matching",
            Self::Exact => "exact",
            Self::Refined => "refined",
        }
    }
}

/// Where `W` comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Source {
    /// Half solves with a factor, carried along by the nodes' rotations.
    Warped,
    /// The same without rotations.
    Unwarped,
    /// Gathered from the precomputed inverse of the first matrix, with rotations.
    Gathered,
}

impl Source {
    /// In a few words.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Warped => "async, warped",
            Self::Unwarped => "async, not warped",
            Self::Gathered => "precomputed, warped",
        }
    }
}

/// A method and the age of its factor in steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Method {
    pub(crate) source: Source,
    pub(crate) correction: Correction,
    pub(crate) age: usize,
}

/// What a step by a method came to.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outcome {
    /// Relative error of the forces in the norm of the exact compliance: `‖λ - λ*‖_W / ‖λ*‖_W`.
    pub(crate) force: f64,
    /// Relative error of the correction of the motion, `‖Δv - Δv*‖ / ‖Δv*‖`.
    pub(crate) motion: f64,
    /// What the correction misses of the equations of motion, `‖A Δv - h Hᵀ λ‖ / ‖h Hᵀ λ‖` with its own forces.
    pub(crate) imbalance: f64,
    /// Iterations of the free motion, and of the exact correction.
    pub(crate) iterations: [usize; 2],
    /// Time that one core works for rotations, free motion, compliance, forces and correction (s); for the factorisation
    /// too by the exact method.
    pub(crate) time: f64,
}
