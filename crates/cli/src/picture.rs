//! The picture of a run: force on the hand and depth of the tool over time.

use std::error::Error;
use std::ops::Range;
use std::path::Path;

use plotters::coord::Shift;
use plotters::prelude::*;

const SIZE: (u32, u32) = (1000, 620);
const FORCE: RGBColor = RGBColor(192, 57, 43);
const SIDEWAYS: RGBColor = RGBColor(41, 98, 155);
const DEPTH: RGBColor = RGBColor(39, 118, 82);

/// Height of the strip that names the lines, and where it begins (pixels).
const NAMES: i32 = 26;
const LEFT: i32 = 82;

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
    let root = SVGBackend::new(path, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let root = root.titled(title, ("sans-serif", 20))?;
    let (top, bottom) = root.split_vertically(295);
    let end = curves.force.last().map_or(1.0, |p| p.0).max(1e-3);
    let millimetres = curves.depth.iter().map(|&(t, d)| (t, 1e3 * d)).collect();
    panel(
        &top,
        end,
        "force [N]",
        "",
        &[
            ("on the hand, every tick", FORCE, thin(&curves.force)),
            ("along the skin (friction), every step", SIDEWAYS, curves.friction.clone()),
        ],
    )?;
    panel(
        &bottom,
        end,
        "indentation [mm]",
        "time [s]",
        &[("depth of the touched skin below its place at rest, every step", DEPTH, millimetres)],
    )?;
    root.present()?;
    Ok(())
}

type Line<'a> = (&'a str, RGBColor, Vec<(f64, f64)>);

fn panel(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    end: f64,
    y_label: &str,
    x_label: &str,
    lines: &[Line<'_>],
) -> Result<(), Box<dyn Error>> {
    let (names, area) = area.split_vertically(NAMES);
    legend(&names, lines)?;
    let mut chart = ChartBuilder::on(&area)
        .margin_left(10)
        .margin_right(25)
        .margin_bottom(5)
        .x_label_area_size(40)
        .y_label_area_size(70)
        .build_cartesian_2d(0.0..end, range(lines))?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .y_desc(y_label)
        .x_desc(x_label)
        .label_style(("sans-serif", 14))
        .axis_desc_style(("sans-serif", 15))
        .draw()?;
    for (_, color, points) in lines {
        chart.draw_series(LineSeries::new(points.iter().copied(), color.stroke_width(2)))?;
    }
    Ok(())
}

/// The names of the lines in a strip of their own above the chart, where they cover no curve.
fn legend(area: &DrawingArea<SVGBackend<'_>, Shift>, lines: &[Line<'_>]) -> Result<(), Box<dyn Error>> {
    let mut x = LEFT;
    for (name, color, _) in lines {
        let y = NAMES / 2;
        area.draw(&PathElement::new([(x, y), (x + 22, y)], color.stroke_width(3)))?;
        area.draw(&Text::new(*name, (x + 30, y - 7), ("sans-serif", 14)))?;
        x += 60 + 8 * i32::try_from(name.len())?;
    }
    Ok(())
}

/// The range of all finite values, from 0, with a tenth of headroom.
fn range(lines: &[Line<'_>]) -> Range<f64> {
    let values = || lines.iter().flat_map(|(_, _, points)| points.iter().map(|p| p.1)).filter(|v| v.is_finite());
    let low = values().fold(0.0, f64::min);
    let high = values().fold(0.0, f64::max);
    let room = 0.1 * (high - low).max(1e-3);
    (if low < 0.0 { low - room } else { 0.0 })..high + room
}

/// At most [`POINTS`] points: of each bunch the largest, so that no peak is lost.
fn thin(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let bunch = points.len().div_ceil(POINTS).max(1);
    points.chunks(bunch).filter_map(|c| c.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))).collect()
}
