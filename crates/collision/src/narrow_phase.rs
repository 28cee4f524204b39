//! Gap, normal and support of one tissue feature against one tool.
