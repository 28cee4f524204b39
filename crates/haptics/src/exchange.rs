//! Hand-over between threads: latest values and rings.
