//! What the step hands to the tick.
