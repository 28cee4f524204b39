//! Detection: from a surface and a tool to contacts.
