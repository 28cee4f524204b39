//! Contact laws, one file each.
