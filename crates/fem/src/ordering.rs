//! Fill-reducing ordering by nested dissection of node positions.
