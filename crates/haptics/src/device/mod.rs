//! Haptic devices, one file each.
