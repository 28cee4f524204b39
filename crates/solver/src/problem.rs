//! The contact problem as a value.
