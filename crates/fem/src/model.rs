//! Description, state and workspace of a soft body.
