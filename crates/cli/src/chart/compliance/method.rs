//! The methods that are compared, and what a step by one of them came to.

use palpate::constraints::compliance::MotionCorrection;

/// How the contact forces move the body: both choices of a scene. Where the exact one finds that `W` misses what the forces
/// open, the step refines these.
pub(crate) const CORRECTIONS: [MotionCorrection; 2] = [MotionCorrection::Matching, MotionCorrection::Exact];

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
    pub(crate) correction: MotionCorrection,
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
    /// Whether the step has refined the forces.
    pub(crate) refined: bool,
    /// Iterations of the free motion, and of the exact correction.
    pub(crate) iterations: [usize; 2],
    /// Time that one core works for rotations, free motion, compliance, forces and correction (s); for the factorisation
    /// too by the exact method.
    pub(crate) time: f64,
}
