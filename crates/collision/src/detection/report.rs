//! What a detection did.

/// What one detection did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectionReport {
    /// Features whose gap was computed.
    pub candidates: usize,
    /// Contacts handed out.
    pub contacts: usize,
    /// Features within the margin that were rejected because they face away from the side the tool came from.
    pub wrong_side: usize,
    /// Duplicates and near-duplicates that gave way to a deeper contact or to a held one.
    pub merged: usize,
    /// Contacts within the margin that the capacity had no room for; shallower than all that were kept.
    pub dropped: usize,
    /// Triangles left out because a coordinate is not finite or beyond 1e6 m, plus 1 if the pose is.
    pub non_finite: usize,
    /// Least gap \[m\]; infinite without contacts.
    pub deepest_gap: f64,
    /// The whole tool lies below the skin. At set-up: refuse. In a run: a fast tool has passed through; it is pushed out
    /// as long as the reach allows.
    pub tool_inside: bool,
}

impl DetectionReport {
    /// Of a detection that found nothing.
    pub const NONE: Self = Self {
        candidates: 0,
        contacts: 0,
        wrong_side: 0,
        merged: 0,
        dropped: 0,
        non_finite: 0,
        deepest_gap: f64::INFINITY,
        tool_inside: false,
    };
}
