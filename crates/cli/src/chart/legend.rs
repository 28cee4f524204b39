//! The legend of a chart: names, colours and marks of its series, by the panels that show them.

use std::error::Error;

use plotters::coord::Shift;
use plotters::element::DashedPathElement;
use plotters::prelude::*;

use super::plot::{Mark, Panel};

/// Distinguishable also without red or green (Okabe and Ito 2008), then grey.
const COLORS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
    RGBColor(130, 130, 130),
];

/// Colours times shapes.
const LOOKS: usize = 4 * COLORS.len();

/// Pixels from one line of a legend to the next.
const LINE: i32 = 22;

/// One name.
struct Entry<'a> {
    name: &'a str,
    mark: Mark,
    style: Style,
}

/// Series that the same panels show.
struct Group<'a> {
    /// Those panels, ascending.
    panels: Vec<usize>,
    heading: String,
    entries: Vec<Entry<'a>>,
}

/// Series of one name look the same wherever they are; colours begin anew where no panel shows both.
pub(super) struct Legend<'a> {
    groups: Vec<Group<'a>>,
}

impl<'a> Legend<'a> {
    pub(super) fn of(panels: &'a [Panel]) -> Self {
        // What has no title cannot be told apart by it.
        let titled = panels.iter().all(|panel| !panel.title.is_empty());
        let mut groups: Vec<Group<'a>> = Vec::new();
        for series in panels.iter().flat_map(|panel| &panel.series) {
            if groups.iter().flat_map(|group| &group.entries).any(|entry| entry.name == series.name) {
                continue;
            }
            let shows = |panel: &Panel| panel.series.iter().any(|other| other.name == series.name);
            let those: Vec<usize> = (0..panels.len()).filter(|&k| !titled || shows(&panels[k])).collect();
            let at = groups.iter().position(|group| group.panels == those).unwrap_or_else(|| {
                let heading = heading(&those, panels);
                groups.push(Group { panels: those.clone(), heading, entries: Vec::new() });
                groups.len() - 1
            });
            let beside = groups.iter().filter(|group| group.panels.iter().any(|panel| those.contains(panel)));
            let taken: Vec<Style> = beside.flat_map(|group| &group.entries).map(|entry| entry.style).collect();
            let free = (0..LOOKS).map(Style::of).find(|style| !taken.contains(style));
            let style = free.unwrap_or(Style::of(taken.len()));
            groups[at].entries.push(Entry { name: &series.name, mark: series.mark, style });
        }
        Self { groups }
    }

    /// Colour and shape of the series of this name.
    pub(super) fn style(&self, name: &str) -> Option<Style> {
        let mut entries = self.groups.iter().flat_map(|group| &group.entries);
        entries.find(|entry| entry.name == name).map(|entry| entry.style)
    }

    /// Whether it must be said which panels a name belongs to.
    fn has_headings(&self) -> bool {
        self.groups.len() > 1
    }

    /// Pixels from its first line to its last.
    pub(super) fn height(&self) -> u32 {
        let lines =
            self.groups.iter().map(|group| group.entries.len() + 2 * usize::from(self.has_headings())).sum::<usize>();
        LINE as u32 * lines as u32
    }

    pub(super) fn draw(&self, area: &DrawingArea<SVGBackend<'_>, Shift>) -> Result<(), Box<dyn Error>> {
        let mut y = 30;
        for group in &self.groups {
            if self.has_headings() {
                area.draw(&Text::new(
                    group.heading.clone(),
                    (10, y - 7),
                    ("sans-serif", 13).into_font().style(FontStyle::Bold),
                ))?;
                y += LINE;
            }
            for Entry { name, mark, style } in &group.entries {
                if *mark != Mark::Points {
                    stroke(area, *mark, style.color, &[(10, y), (40, y)])?;
                }
                if matches!(mark, Mark::Points | Mark::Joined) {
                    style.draw(area, (25, y))?;
                }
                area.draw(&Text::new(name.to_string(), (48, y - 7), ("sans-serif", 13)))?;
                y += LINE;
            }
            y += LINE * i32::from(self.has_headings());
        }
        Ok(())
    }
}

/// Which panels a group is shown by, in words that fit the legend; several, and one with a long title, by their numbers in the
/// order of reading.
fn heading(those: &[usize], panels: &[Panel]) -> String {
    const LONGEST: usize = 30;
    match those {
        all if all.len() == panels.len() => "all panels".into(),
        [] => String::new(),
        [one] if panels[*one].title.chars().count() <= LONGEST => panels[*one].title.clone(),
        [one] => format!("panel {}", one + 1),
        [first, .., last] if last - first + 1 == those.len() => format!("panels {} to {}", first + 1, last + 1),
        some => format!("panels {}", some.iter().map(|k| (k + 1).to_string()).collect::<Vec<_>>().join(", ")),
    }
}

/// Colour and shape of a series: colours go round first, then shapes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Style {
    pub(super) color: RGBColor,
    shape: usize,
}

impl Style {
    fn of(k: usize) -> Self {
        Self { color: COLORS[k % COLORS.len()], shape: (k + k / COLORS.len()) % 4 }
    }

    pub(super) fn draw(
        self,
        area: &DrawingArea<SVGBackend<'_>, Shift>,
        (x, y): (i32, i32),
    ) -> Result<(), Box<dyn Error>> {
        let fill = self.color.filled();
        match self.shape {
            0 => area.draw(&Circle::new((x, y), 4, fill))?,
            1 => area.draw(&TriangleMarker::new((x, y), 6, fill))?,
            2 => area.draw(&Rectangle::new([(x - 4, y - 4), (x + 4, y + 4)], fill))?,
            _ => area.draw(&Cross::new((x, y), 4, self.color.stroke_width(2)))?,
        }
        Ok(())
    }
}

/// A straight piece in the legend.
fn stroke(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    mark: Mark,
    color: RGBColor,
    ends: &[(i32, i32); 2],
) -> Result<(), Box<dyn Error>> {
    match mark {
        Mark::Dashed => area.draw(&DashedPathElement::new(*ends, 6, 4, color.stroke_width(2)))?,
        Mark::Joined => area.draw(&PathElement::new(*ends, color.mix(0.5).stroke_width(1)))?,
        _ => area.draw(&PathElement::new(*ends, color.stroke_width(2)))?,
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::plot::{Axis, Series};
    use super::*;

    fn panel(title: &str, names: &[&str]) -> Panel {
        let series =
            names.iter().map(|name| Series { name: name.to_string(), mark: Mark::Line, points: vec![(0.0, 0.0)] });
        Panel { title: title.into(), x: Axis::linear("x"), y: Axis::linear("y"), series: series.collect() }
    }

    /// No two names of one panel look the same, and one name looks the same in all.
    #[test]
    fn names_are_grouped_by_their_panels_and_told_apart_within_each() {
        let panels = [
            panel("first", &["a", "b"]),
            panel("second, of which there is more to say", &["c", "a"]),
            panel("third", &["d"]),
            panel("fourth", &["d"]),
        ];
        let legend = Legend::of(&panels);
        let headings: Vec<_> = legend.groups.iter().map(|group| group.heading.as_str()).collect();
        assert_eq!(headings, ["panels 1 to 2", "first", "panel 2", "panels 3 to 4"]);
        let look = |name: &str| legend.style(name).map(|style| (style.color, style.shape)).unwrap();
        assert!(look("a") != look("b") && look("a") != look("c"));
        assert_eq!(look("d"), look("a"), "no panel shows both");
        assert!(legend.style("e").is_none());
        assert!(!Legend::of(&panels[..1]).has_headings());
        let untitled = [panel("", &["a"]), panel("", &["b"])];
        let legend = Legend::of(&untitled);
        assert!(!legend.has_headings() && legend.style("a") != legend.style("b"));
    }
}
