//! Label images.
