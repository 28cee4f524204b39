//! Forces carried from step to step by contact feature.
