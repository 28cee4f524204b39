//! The picture of a run: force on the hand and depth of the tool over time.

use std::error::Error;
use std::path::Path;

use crate::chart::plot::{Axis, Layout, Mark, Panel, Series, draw as sheet};

/// Width and height of a panel (pixels).
const PANEL: (u32, u32) = (780, 290);

/// Points drawn at most per line; more would only make the file larger.
const POINTS: usize = 2500;

/// Curves over time (s).
#[derive(Debug, Default)]
pub(crate) struct Curves {
    /// Force on the device (N), one point per tick.
    pub(crate) force: Vec<(f64, f64)>,
    /// Part of the contact force along the skin (N), one point per step.
    pub(crate) friction: Vec<(f64, f64)>,
    /// Depth of the touched skin below its place at rest (m), one point per step.
    pub(crate) depth: Vec<(f64, f64)>,
}

/// Draws force and depth over time as SVG.
pub(crate) fn draw(path: &Path, title: &str, curves: &Curves) -> Result<(), Box<dyn Error>> {
    let line = |name: &str, points| Series { name: name.into(), mark: Mark::Line, points };
    let panel =
        |y: &str, series| Panel { title: String::new(), x: Axis::linear("time [s]"), y: Axis::linear(y), series };
    let millimetres = curves.depth.iter().map(|&(t, d)| (t, 1e3 * d)).collect();
    let force = vec![
        line("force on the hand, every tick", thin(&curves.force)),
        line("force along the skin (friction)", curves.friction.clone()),
    ];
    let depth = vec![line("depth of the touched skin", millimetres)];
    let panels = [panel("force [N]", force), panel("indentation [mm]", depth)];
    sheet(path, title, &panels, Layout { columns: 1, panel: PANEL })
}

/// At most [`POINTS`] points: of each bunch the largest, so that no peak is lost.
fn thin(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let bunch = points.len().div_ceil(POINTS).max(1);
    points.chunks(bunch).filter_map(|c| c.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))).collect()
}
