//! The picture of a run: force on the hand and depth of the tool over time.

use std::error::Error;
use std::path::Path;

use crate::chart::plot::{Axis, Layout, Mark, Panel, Series, draw as sheet};

/// Width and height of a panel (pixels).
const PANEL: (u32, u32) = (780, 290);

/// Points drawn at most per line; more would only make the file larger, and a long run the memory.
const POINTS: usize = 4096;

/// Curves over time (s).
#[derive(Debug, Default)]
pub(crate) struct Curves {
    /// Force on the device (N), by tick.
    pub(crate) force: Curve,
    /// Part of the contact force along the skin (N), by step.
    pub(crate) friction: Curve,
    /// Depth of the touched skin below its place at rest (m), by step.
    pub(crate) depth: Curve,
}

/// A curve of at most [`POINTS`] points: of each bunch of samples the largest, so that no peak is lost.
#[derive(Debug)]
pub(crate) struct Curve {
    points: Vec<(f64, f64)>,
    /// Samples to a point.
    bunch: usize,
    /// Samples in the last point.
    filled: usize,
}

impl Default for Curve {
    fn default() -> Self {
        Self { points: Vec::new(), bunch: 1, filled: 1 }
    }
}

impl Curve {
    /// Takes the next sample.
    pub(crate) fn push(&mut self, time: f64, value: f64) {
        if self.filled < self.bunch
            && let Some(last) = self.points.last_mut()
        {
            *last = larger(*last, (time, value));
            self.filled += 1;
            return;
        }
        if self.points.len() == POINTS {
            for k in 0..POINTS / 2 {
                self.points[k] = larger(self.points[2 * k], self.points[2 * k + 1]);
            }
            self.points.truncate(POINTS / 2);
            self.bunch *= 2;
        }
        self.points.push((time, value));
        self.filled = 1;
    }
}

fn larger(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    if b.1 > a.1 { b } else { a }
}

/// Draws force and depth over time as SVG.
pub(crate) fn draw(path: &Path, title: &str, curves: &Curves) -> Result<(), Box<dyn Error>> {
    let line = |name: &str, points| Series { name: name.into(), mark: Mark::Line, points };
    let panel =
        |y: &str, series| Panel { title: String::new(), x: Axis::linear("time [s]"), y: Axis::linear(y), series };
    let millimetres = curves.depth.points.iter().map(|&(t, d)| (t, 1e3 * d)).collect();
    let force = vec![
        line("force on the hand, every tick", curves.force.points.clone()),
        line("force along the skin (friction)", curves.friction.points.clone()),
    ];
    let depth = vec![line("depth of the touched skin", millimetres)];
    let panels = [panel("force [N]", force), panel("indentation [mm]", depth)];
    sheet(path, title, &panels, Layout { columns: 1, panel: PANEL })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_of_any_length_keeps_its_peaks_in_bounded_memory() {
        let mut curve = Curve::default();
        let peaks = [3, 40_000, 99_999];
        for k in 0..100_000 {
            curve.push(k as f64, if peaks.contains(&k) { 10.0 + k as f64 } else { 1.0 });
        }
        assert!((POINTS / 2..=POINTS).contains(&curve.points.len()), "{}", curve.points.len());
        let kept: Vec<_> = curve.points.iter().filter(|point| point.1 > 1.0).map(|point| point.0 as usize).collect();
        assert_eq!(kept, peaks);
        assert!(curve.points.is_sorted_by(|a, b| a.0 < b.0));
    }
}
