//! The virtual hand that holds the virtual device.
