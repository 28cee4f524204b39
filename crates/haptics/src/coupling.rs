//! Virtual coupling between the device and the tool.
