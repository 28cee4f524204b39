//! Charts as SVG: panels side by side, series as lines or marks, one legend for all.

use std::error::Error;
use std::path::Path;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

pub(crate) use super::axis::Axis;
use super::axis::{logarithmic, number};
use super::legend::Legend;

/// Width of the legend (pixels).
const LEGEND: u32 = 250;

/// How a series is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mark {
    /// A line.
    Line,
    /// A dashed line: a bound, a theory.
    Dashed,
    /// A mark for each point, joined by a thin line.
    Joined,
    /// A mark for each point.
    Points,
}

/// Named points.
#[derive(Clone, Debug)]
pub(crate) struct Series {
    /// Name in the legend; series of one name in several panels look the same.
    pub(crate) name: String,
    /// How it is drawn.
    pub(crate) mark: Mark,
    /// Points (x, y); those that a logarithmic axis cannot show are left out.
    pub(crate) points: Vec<(f64, f64)>,
}

/// One coordinate system.
#[derive(Clone, Debug)]
pub(crate) struct Panel {
    /// Above the panel.
    pub(crate) title: String,
    /// Horizontal axis.
    pub(crate) x: Axis,
    /// Vertical axis.
    pub(crate) y: Axis,
    /// What it shows.
    pub(crate) series: Vec<Series>,
}

impl Panel {
    fn shows(&self, p: &(f64, f64)) -> bool {
        let fits = |v: f64, axis: &Axis| v.is_finite() && (!axis.log || v > 0.0);
        fits(p.0, &self.x) && fits(p.1, &self.y)
    }

    /// Limits of an axis over all points that it can show, with room; of something where there is no point.
    fn limits(&self, value: impl Fn(&(f64, f64)) -> f64, log: bool) -> (f64, f64) {
        let points = self.series.iter().flat_map(|s| &s.points).filter(|p| self.shows(p));
        let (low, high) = points.map(value).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        match (low <= high, log) {
            (false, true) => (1e-3, 1.0),
            (false, false) => (0.0, 1.0),
            (true, true) => (low / 1.3, high * 1.3),
            (true, false) => {
                let room = 0.06 * (high - low).max(1e-9 * high.abs()).max(f64::MIN_POSITIVE);
                (low - room, high + room)
            }
        }
    }
}

/// How panels lie on the sheet.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    /// Panels beside one another, at most.
    pub(crate) columns: usize,
    /// Width and height of a panel with its labels (pixels).
    pub(crate) panel: (u32, u32),
}

impl Layout {
    /// Panels of a chart, so many beside one another.
    pub(crate) fn columns(columns: usize) -> Self {
        Self { columns, panel: (470, 430) }
    }
}

/// Draws panels row by row, and their legend beside them.
pub(crate) fn draw(path: &Path, title: &str, panels: &[Panel], layout: Layout) -> Result<(), Box<dyn Error>> {
    let columns = layout.columns.clamp(1, panels.len().max(1));
    let rows = panels.len().div_ceil(columns).max(1);
    let legend = Legend::of(panels);
    let width = layout.panel.0 * columns as u32;
    // A short sheet must still hold its legend.
    let height = (layout.panel.1 * rows as u32 + 40).max(70 + legend.height());
    let root = SVGBackend::new(path, (width + LEGEND, height)).into_drawing_area();
    root.fill(&WHITE)?;
    let root = root.titled(title, ("sans-serif", 20))?;
    let (left, right) = root.split_horizontally(width);
    for (panel, area) in panels.iter().zip(left.split_evenly((rows, columns))) {
        draw_panel(&area, panel, &legend)?;
    }
    legend.draw(&right)?;
    root.present()?;
    Ok(())
}

fn draw_panel(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    panel: &Panel,
    legend: &Legend<'_>,
) -> Result<(), Box<dyn Error>> {
    let (x, y) = (panel.limits(|p| p.0, panel.x.log), panel.limits(|p| p.1, panel.y.log));
    match (panel.x.log, panel.y.log) {
        (true, true) => on(area, panel, legend, logarithmic(x), logarithmic(y)),
        (true, false) => on(area, panel, legend, logarithmic(x), y.0..y.1),
        (false, true) => on(area, panel, legend, x.0..x.1, logarithmic(y)),
        (false, false) => on(area, panel, legend, x.0..x.1, y.0..y.1),
    }
}

fn on<X, Y>(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    panel: &Panel,
    legend: &Legend<'_>,
    x: X,
    y: Y,
) -> Result<(), Box<dyn Error>>
where
    X: AsRangedCoord<Value = f64>,
    Y: AsRangedCoord<Value = f64>,
    X::CoordDescType: ValueFormatter<f64>,
    Y::CoordDescType: ValueFormatter<f64>,
{
    let mut chart = ChartBuilder::on(area);
    if !panel.title.is_empty() {
        chart.caption(&panel.title, ("sans-serif", 16));
    }
    let mut chart =
        chart.margin(8).margin_right(16).x_label_area_size(42).y_label_area_size(68).build_cartesian_2d(x, y)?;
    chart
        .configure_mesh()
        .light_line_style(WHITE)
        .x_desc(&panel.x.label)
        .y_desc(&panel.y.label)
        .x_label_formatter(&number)
        .y_label_formatter(&number)
        .x_labels(6)
        .y_labels(8)
        .label_style(("sans-serif", 12))
        .axis_desc_style(("sans-serif", 14))
        .draw()?;
    if !panel.series.iter().flat_map(|s| &s.points).any(|p| panel.shows(p)) {
        let grey = BLACK.mix(0.6);
        let centred = Pos::new(HPos::Center, VPos::Center);
        let words = TextStyle::from(("sans-serif", 14)).color(&grey).pos(centred);
        let area = chart.plotting_area();
        let (width, height) = area.dim_in_pixel();
        area.strip_coord_spec().draw(&Text::new(
            "nothing to show: see the table",
            (width as i32 / 2, height as i32 / 2),
            words,
        ))?;
    }
    for series in &panel.series {
        let Some(style) = legend.style(&series.name) else { continue };
        let points: Vec<(f64, f64)> = series.points.iter().copied().filter(|p| panel.shows(p)).collect();
        match series.mark {
            Mark::Line => {
                chart.draw_series(LineSeries::new(points.iter().copied(), style.color.stroke_width(2)))?;
            }
            Mark::Dashed => {
                let line = DashedLineSeries::new(points.iter().copied(), 6, 4, style.color.stroke_width(2));
                chart.draw_series(line)?;
            }
            Mark::Joined => {
                chart.draw_series(LineSeries::new(points.iter().copied(), style.color.mix(0.5).stroke_width(1)))?;
            }
            Mark::Points => {}
        }
        if matches!(series.mark, Mark::Points | Mark::Joined) {
            let area = chart.plotting_area();
            let (inner, origin) = (area.strip_coord_spec(), area.get_base_pixel());
            for point in &points {
                let at = area.map_coordinate(point);
                style.draw(&inner, (at.0 - origin.0, at.1 - origin.1))?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn panel(log: bool, points: &[(f64, f64)]) -> Panel {
        let axis = if log { Axis::log("time [s]") } else { Axis::linear("time [s]") };
        let marks = [Mark::Line, Mark::Dashed, Mark::Joined, Mark::Points];
        let series = marks.map(|mark| Series { name: format!("{mark:?}"), mark, points: points.to_vec() });
        Panel { title: "a panel".into(), x: axis.clone(), y: axis, series: series.into() }
    }

    #[test]
    fn every_mark_on_every_axis_is_drawn_and_points_that_cannot_be_shown_are_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("chart.svg");
        let sound = [(1.0, 2.0), (3.0, 1e-4), (100.0, 7.0)];
        let mut bad = sound.to_vec();
        bad.extend([(0.0, 1.0), (-1.0, 1.0), (f64::NAN, 1.0), (2.0, f64::INFINITY)]);
        draw(&path, "a chart", &[panel(true, &sound), panel(true, &[])], Layout::columns(2)).unwrap();
        let expected = std::fs::read_to_string(&path).unwrap();
        draw(&path, "a chart", &[panel(true, &bad), panel(true, &[])], Layout::columns(2)).unwrap();
        let drawn = std::fs::read_to_string(&path).unwrap();
        assert_eq!(drawn, expected, "a logarithmic axis shows what is positive and finite");
        for name in ["a chart", "a panel", "time [s]", "Line", "Dashed", "Joined", "Points"] {
            assert!(drawn.contains(name), "{name}");
        }
        draw(&path, "a chart", &[panel(false, &bad), panel(false, &[(1.0, 1.0)])], Layout::columns(1)).unwrap();
        assert!(!std::fs::read_to_string(&path).unwrap().contains("NaN"));
    }
}
