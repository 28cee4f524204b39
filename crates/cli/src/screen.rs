//! Tables on the screen.

use comfy_table::{ContentArrangement, Table, presets};

/// An empty table that wraps its cells where the terminal is narrower; in a file or a pipe nothing is wrapped.
pub(crate) fn table() -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED).set_content_arrangement(ContentArrangement::Dynamic);
    table
}
