//! A plot with two axes as inline SVG.
//!
//! Colours come from the style sheet, by class, so that one drawing serves light, dark and paper. Title and legend are
//! text of the page above the drawing; inside are only the axes and the data.

use super::path::{decimated, outline};
use super::scale::Axis;
use maud::{Markup, PreEscaped, html};
use std::fmt::Write as _;

/// What a curve stands for: its class in the style sheet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// What was measured.
    Measured,
    /// What the model says.
    Model,
    /// Before something was added to the model.
    Before,
    /// After it.
    After,
    /// What noise alone would give, a limit, a command.
    Reference,
}

impl Role {
    /// Class of the style sheet.
    pub(super) const fn class(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Model => "model",
            Self::Before => "before",
            Self::After => "after",
            Self::Reference => "reference",
        }
    }
}

/// A part of a plot.
#[derive(Clone, Debug)]
pub(super) enum Layer {
    /// A curve through points; one that is not finite is a gap.
    Curve(Role, Vec<[f64; 2]>),
    /// Separate points.
    Dots(Role, Vec<[f64; 2]>),
    /// Lines from zero to points.
    Stems(Role, Vec<[f64; 2]>),
    /// The area between two curves: abscissa, low, high.
    Area(Vec<[f64; 3]>),
    /// A horizontal line.
    Level(f64),
    /// A horizontal line that is seen on top of everything.
    Limit(f64),
    /// Coloured cells: edges along both axes, and for each row from the lowest the class of each cell.
    Cells {
        /// Edges along the horizontal axis.
        columns: Vec<f64>,
        /// Edges along the vertical axis.
        rows: Vec<f64>,
        /// Class of the colour of each cell, by rows.
        classes: Vec<Vec<usize>>,
    },
    /// A closed outline.
    Outline(Vec<[f64; 2]>),
    /// One place that is to be seen.
    Mark([f64; 2]),
}

/// A plot.
#[derive(Clone, Debug)]
pub(super) struct Plot {
    /// What it shows.
    pub(super) title: String,
    /// Names of what is drawn.
    pub(super) legend: Vec<(Role, String)>,
    /// What the ends of the ramp of cell colours mean; empty where there are no cells.
    pub(super) ramp: Option<[String; 2]>,
    /// A sentence under it.
    pub(super) note: String,
    /// Horizontal axis.
    pub(super) x: Axis,
    /// Vertical axis.
    pub(super) y: Axis,
    /// What is drawn, the first lowest.
    pub(super) layers: Vec<Layer>,
    /// Does it span the page?
    pub(super) wide: bool,
}

/// Colours of the ramp for cells.
pub(super) const CLASSES: usize = 16;

/// Width and height of the drawing, in its own units: pixels at full size.
const WIDE: [f64; 2] = [1100.0, 270.0];
const HALF: [f64; 2] = [530.0, 270.0];
/// Characters that a wide drawing has room for beside its axis, at least.
const WIDE_LABEL: usize = 6;
/// Width of a digit in the labels where they are largest: on paper.
const DIGIT: f64 = 9.2;
/// Least distance of labels along the horizontal axis.
const LABEL_APART: f64 = 95.0;

/// What a legend shows beside a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Swatch {
    /// A piece of a line.
    Line,
    /// A dot.
    Dot,
    /// A piece of a bar.
    Bar,
}

impl Swatch {
    const fn class(self) -> &'static str {
        match self {
            Self::Line => "line",
            Self::Dot => "point",
            Self::Bar => "bar",
        }
    }
}

/// Title and legend of a figure; `swatch` is what its marks of a role look like.
pub(super) fn caption(title: &str, legend: &[(Role, String)], swatch: impl Fn(Role) -> Swatch) -> Markup {
    html! {
        figcaption {
            span.title { (title) }
            @if !legend.is_empty() {
                span.legend { @for (role, name) in legend {
                    span.item { i.(swatch(*role).class()).(role.class()) {} (name) }
                } }
            }
        }
    }
}

/// The drawing of a figure. A wide figure has a second one that suits a narrow window: the style sheet shows one of them.
pub(super) fn drawings(wide: bool, drawing: impl Fn(bool) -> Markup) -> Markup {
    html! {
        @if wide {
            div.drawing.broad { (drawing(true)) }
            div.drawing.slim { (drawing(false)) }
        } @else {
            div.drawing { (drawing(false)) }
        }
    }
}

/// Heights of all that is drawn at some.
pub(super) fn heights(layers: &[Layer]) -> impl Iterator<Item = f64> {
    layers.iter().flat_map(|layer| match layer {
        Layer::Curve(_, points) | Layer::Dots(_, points) | Layer::Stems(_, points) => {
            points.iter().map(|point| point[1]).collect::<Vec<_>>()
        }
        Layer::Area(bounds) => bounds.iter().flat_map(|bound| [bound[1], bound[2]]).collect(),
        Layer::Level(level) | Layer::Limit(level) => vec![*level],
        Layer::Cells { .. } | Layer::Outline(_) | Layer::Mark(_) => Vec::new(),
    })
}

/// The area of the data inside a drawing.
struct Area {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
}

impl Plot {
    /// The figure.
    pub(super) fn figure(&self) -> Markup {
        html! {
            figure.card .wide[self.wide] {
                (caption(&self.title, &self.legend, |role| self.swatch(role)))
                (drawings(self.wide, |broad| self.drawing(broad)))
                @if let Some([low, high]) = &self.ramp {
                    p.ramp { (low) @for class in 0..CLASSES { i.{ "c" (class) } {} } (high) }
                }
                @if !self.note.is_empty() { p.note { (self.note) } }
            }
        }
    }

    fn swatch(&self, role: Role) -> Swatch {
        let is_dots = |layer: &Layer| matches!(layer, Layer::Dots(of, _) if *of == role);
        if self.layers.iter().any(is_dots) { Swatch::Dot } else { Swatch::Line }
    }

    fn drawing(&self, broad: bool) -> Markup {
        let [width, height] = if broad { WIDE } else { HALF };
        let y_ticks = self.y.ticks(5);
        let longest = y_ticks.iter().map(|(_, label)| label.chars().count()).max().unwrap_or(0);
        // Plots that stand below each other have their axes below each other.
        let least = if broad { WIDE_LABEL } else { 0 };
        let left = 40.0 + longest.max(least) as f64 * DIGIT;
        let area = Area { left, top: 10.0, width: width - left - 20.0, height: height - 10.0 - 48.0 };
        let x_ticks = self.x.ticks((area.width / LABEL_APART) as usize);
        html! {
            svg viewBox=(format!("0 0 {width} {height}")) role="img" aria-label=(self.title) {
                (area.axes(&x_ticks, &y_ticks, &self.x.title, &self.y.title))
                (PreEscaped(self.data(&area)))
            }
        }
    }

    fn data(&self, area: &Area) -> String {
        let mut svg = String::new();
        let _ = write!(
            svg,
            r#"<svg x="{:.1}" y="{:.1}" width="{:.1}" height="{:.1}" class="data">"#,
            area.left, area.top, area.width, area.height
        );
        for layer in &self.layers {
            self.draw(area, layer, &mut svg);
        }
        svg.push_str("</svg>");
        svg
    }

    /// Place inside the area, from its upper left corner.
    fn place(&self, area: &Area, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        Some([self.x.place(x)? * area.width, (1.0 - self.y.place(y)?) * area.height])
    }

    fn draw(&self, area: &Area, layer: &Layer, svg: &mut String) {
        // Writing to a string does not fail.
        let _ = match layer {
            Layer::Curve(role, points) => {
                let places = points.iter().map(|&point| self.place(area, point));
                let path = decimated(places, area.width, area.height);
                write!(svg, r#"<path class="curve {}" d="{path}"/>"#, role.class())
            }
            Layer::Dots(role, points) => {
                for [x, y] in points.iter().filter_map(|&point| self.place(area, point)) {
                    let _ = write!(
                        svg,
                        r#"<circle class="dot {}" cx="{x:.1}" cy="{y:.1}" r="2.6"/>"#,
                        role.class()
                    );
                }
                Ok(())
            }
            Layer::Stems(role, points) => {
                for &[x, y] in points {
                    let (Some([x, y]), Some([_, zero])) =
                        (self.place(area, [x, y]), self.place(area, [x, 0.0]))
                    else {
                        continue;
                    };
                    let _ =
                        write!(svg, r#"<path class="stem {}" d="M{x:.1} {zero:.1}V{y:.1}"/>"#, role.class());
                }
                Ok(())
            }
            Layer::Area(bounds) => {
                let upper = bounds.iter().map(|&[x, _, high]| [x, high]);
                let lower = bounds.iter().rev().map(|&[x, low, _]| [x, low]);
                let path = outline(upper.chain(lower).filter_map(|point| self.place(area, point)));
                write!(svg, r#"<path class="area" d="{path}"/>"#)
            }
            Layer::Level(level) => self.level(area, *level, &["level"], svg),
            // Twice: a thin line on a broad one of the colour of the page.
            Layer::Limit(level) => self.level(area, *level, &["halo", "limit"], svg),
            Layer::Cells { columns, rows, classes } => {
                self.cells(area, columns, rows, classes, svg);
                Ok(())
            }
            Layer::Outline(points) => {
                let path = outline(points.iter().filter_map(|&point| self.place(area, point)));
                write!(svg, r#"<path class="outline" d="{path}"/>"#)
            }
            Layer::Mark(point) => match self.place(area, *point) {
                Some([x, y]) => write!(
                    svg,
                    r#"<path class="mark" d="M{:.1} {y:.1}h14M{x:.1} {:.1}v14"/>"#,
                    x - 7.0,
                    y - 7.0
                ),
                None => Ok(()),
            },
        };
    }

    fn level(&self, area: &Area, level: f64, classes: &[&str], svg: &mut String) -> std::fmt::Result {
        let Some(place) = self.y.place(level) else { return Ok(()) };
        let y = (1.0 - place) * area.height;
        classes
            .iter()
            .try_for_each(|class| write!(svg, r#"<path class="{class}" d="M0 {y:.1}H{:.1}"/>"#, area.width))
    }

    /// One rectangle for each run of cells of a row that share a colour.
    fn cells(&self, area: &Area, columns: &[f64], rows: &[f64], classes: &[Vec<usize>], svg: &mut String) {
        for (row, edges) in classes.iter().zip(rows.windows(2)) {
            let mut first = 0;
            for run in row.chunk_by(|a, b| a == b) {
                let corners = (
                    self.place(area, [columns[first], edges[1]]),
                    self.place(area, [columns[first + run.len()], edges[0]]),
                );
                first += run.len();
                if let (Some([left, top]), Some([right, bottom])) = corners {
                    // A hair wider than they are: no seams.
                    let (width, height) = (right - left + 0.4, bottom - top + 0.4);
                    let class = run[0];
                    let _ = write!(
                        svg,
                        r#"<rect class="c{class}" x="{left:.1}" y="{top:.1}" width="{width:.1}" height="{height:.1}"/>"#
                    );
                }
            }
        }
    }
}

impl Area {
    fn axes(&self, x_ticks: &[(f64, String)], y_ticks: &[(f64, String)], x: &str, y: &str) -> Markup {
        let (bottom, right) = (self.top + self.height, self.left + self.width);
        let middle = self.top + self.height / 2.0;
        html! {
            @for (place, label) in y_ticks {
                @let y = bottom - place * self.height;
                path.rule d=(format!("M{:.1} {y:.1}H{right:.1}", self.left)) {}
                text.tick text-anchor="end" x=(self.left - 7.0) y=(format!("{:.1}", y + 4.0)) { (label) }
            }
            @for (place, label) in x_ticks {
                @let x = self.left + place * self.width;
                path.rule d=(format!("M{x:.1} {:.1}V{bottom:.1}", self.top)) {}
                text.tick text-anchor="middle" x=(format!("{x:.1}")) y=(bottom + 19.0) { (label) }
            }
            path.frame d=(format!("M{:.1} {:.1}V{bottom:.1}H{right:.1}", self.left, self.top)) {}
            text.axis text-anchor="middle" x=(self.left + self.width / 2.0) y=(bottom + 41.0) { (x) }
            text.axis text-anchor="middle" transform=(format!("translate(19 {middle:.1}) rotate(-90)")) { (y) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(points: Vec<[f64; 2]>) -> Plot {
        Plot {
            title: "title".to_owned(),
            legend: Vec::new(),
            ramp: None,
            note: String::new(),
            x: Axis::around("time", "s", points.iter().map(|p| p[0])),
            y: Axis::around("position", "m", points.iter().map(|p| p[1])),
            layers: vec![Layer::Curve(Role::Measured, points)],
            wide: true,
        }
    }

    fn curve(points: Vec<[f64; 2]>) -> String {
        let page = plot(points).figure().into_string();
        let start = page.find(r#"d="M"#).and_then(|_| page.find(r#"class="curve"#)).expect("a curve");
        page[start..].split("d=\"").nth(1).and_then(|rest| rest.split('"').next()).expect("a path").to_owned()
    }

    #[test]
    fn a_long_curve_keeps_its_spikes_and_a_bounded_size() {
        let spike = 31_417;
        let points: Vec<[f64; 2]> = (0..60_000)
            .map(|k| [f64::from(k) * 1e-3, if k == spike { 1.0 } else { 1e-3 * f64::from(k % 7) }])
            .collect();
        let path = curve(points);
        assert!(path.len() < 60_000, "{} bytes", path.len());
        let heights: Vec<f64> =
            path.split(['M', 'L']).filter_map(|place| place.split(' ').nth(1)?.parse().ok()).collect();
        let highest = heights.iter().copied().fold(f64::INFINITY, f64::min);
        assert!(highest < 12.0, "the spike is drawn near the top: {highest}");
        assert_eq!(heights.iter().filter(|&&y| y < 100.0).count(), 1, "and only once");
    }

    #[test]
    fn a_missing_sample_is_a_gap() {
        let mut points: Vec<[f64; 2]> = (0..20).map(|k| [f64::from(k), f64::from(k)]).collect();
        assert_eq!(curve(points.clone()).matches('M').count(), 1);
        points[10][1] = f64::NAN;
        assert_eq!(curve(points).matches('M').count(), 2);
    }

    #[test]
    fn text_is_escaped() {
        let mut plot = plot(vec![[0.0, 0.0], [1.0, 1.0]]);
        plot.title = "<script>".to_owned();
        assert!(!plot.figure().into_string().contains("<script>"));
    }
}
