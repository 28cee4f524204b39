//! Contact frames.
