//! What the elements of a batch or a body met.

#![allow(non_snake_case)]

/// What happened in a batch of elements, or in a whole body; elements are counted from the first of the batch or body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatchReport {
    /// Elements whose tangent the filter changed.
    pub filtered: u32,
    /// Elements with `J <= 0`.
    pub inverted: u32,
    /// Smallest volume ratio `J`; infinity where there is no element.
    pub min_jacobian: f64,
    /// The element of the smallest `J` (the first, where several tie).
    pub min_jacobian_element: u32,
    /// First element whose force or stiffness is not finite.
    pub non_finite: Option<u32>,
}

impl Default for BatchReport {
    fn default() -> Self {
        Self { filtered: 0, inverted: 0, min_jacobian: f64::INFINITY, min_jacobian_element: u32::MAX, non_finite: None }
    }
}

impl BatchReport {
    /// Adds one element.
    #[inline]
    pub fn note(&mut self, element: u32, J: f64, filtered: bool, finite: bool) {
        self.filtered += u32::from(filtered);
        self.inverted += u32::from(J <= 0.0);
        if J < self.min_jacobian {
            (self.min_jacobian, self.min_jacobian_element) = (J, element);
        }
        if !finite && self.non_finite.is_none() {
            self.non_finite = Some(element);
        }
    }

    /// The same report with elements counted from `first` elements earlier.
    pub(crate) fn shifted(mut self, first: u32) -> Self {
        self.min_jacobian_element = self.min_jacobian_element.saturating_add(first);
        self.non_finite = self.non_finite.map(|e| e + first);
        self
    }

    /// Both reports together; independent of the order of merging.
    pub(crate) fn merged(self, other: Self) -> Self {
        let (a, b) = ((self.min_jacobian, self.min_jacobian_element), (other.min_jacobian, other.min_jacobian_element));
        let least = if b.0 < a.0 || (b.0 == a.0 && b.1 < a.1) { b } else { a };
        Self {
            filtered: self.filtered + other.filtered,
            inverted: self.inverted + other.inverted,
            min_jacobian: least.0,
            min_jacobian_element: least.1,
            non_finite: match (self.non_finite, other.non_finite) {
                (Some(a), Some(b)) => Some(a.min(b)),
                (a, b) => a.or(b),
            },
        }
    }
}
