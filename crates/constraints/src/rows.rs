//! Rows of contacts between tissue and tool.
