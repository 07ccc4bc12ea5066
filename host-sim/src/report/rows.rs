//! Named rows with a bar from zero, or a point with its interval, along one axis, as inline SVG.

use super::plot::{Role, Swatch, caption, drawings};
use super::scale::Axis;
use maud::{Markup, html};

/// What a row shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape {
    /// A bar from the left end.
    Bar(f64),
    /// A point with an interval.
    Point(f64, [f64; 2]),
}

/// A row.
#[derive(Clone, Debug)]
pub(super) struct Row {
    /// Name at the left; empty to share that of the row above.
    pub(super) name: String,
    /// Colour.
    pub(super) role: Role,
    /// Bar or point.
    pub(super) shape: Shape,
    /// Value in words, at the right.
    pub(super) text: String,
}

/// Named rows along an axis.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    /// What they show.
    pub(super) title: String,
    /// Names of the colours.
    pub(super) legend: Vec<(Role, String)>,
    /// A sentence under them.
    pub(super) note: String,
    /// The axis.
    pub(super) axis: Axis,
    /// The rows, the first at the top.
    pub(super) entries: Vec<Row>,
    /// Does it span the page?
    pub(super) wide: bool,
}

/// Height of a row.
const ROW: f64 = 22.0;
/// Space above a row that starts a group.
const GROUP: f64 = 8.0;
/// Mean width of a character where they are largest: on paper.
const CHARACTER: f64 = 8.7;
/// Least share of a drawing that its axis takes: with longer names, those stand above their rows.
const LEAST_SPAN: f64 = 0.35;
/// Height of a name that does.
const NAME: f64 = 17.0;

impl Rows {
    /// The figure.
    pub(super) fn figure(&self) -> Markup {
        let is_bar = self.entries.iter().any(|row| matches!(row.shape, Shape::Bar(_)));
        let swatch = if is_bar { Swatch::Bar } else { Swatch::Dot };
        html! {
            figure.card .wide[self.wide] {
                (caption(&self.title, &self.legend, |_| swatch))
                (drawings(self.wide, |broad| self.drawing(if broad { 1100.0 } else { 530.0 })))
                @if !self.note.is_empty() { p.note { (self.note) } }
            }
        }
    }

    fn drawing(&self, width: f64) -> Markup {
        let longest = |text: fn(&Row) -> &str| {
            self.entries.iter().map(|row| text(row).chars().count()).max().unwrap_or(0) as f64 * CHARACTER
        };
        let (names, texts) = (longest(|row| &row.name), longest(|row| &row.text));
        let is_above = width - names - texts - 36.0 < LEAST_SPAN * width;
        let left = if is_above { 12.0 } else { 12.0 + names };
        let span = width - left - texts - 24.0;
        let mut bottom = 4.0;
        let places: Vec<f64> = self
            .entries
            .iter()
            .map(|row| {
                let first = if is_above { GROUP + NAME } else { GROUP };
                bottom += if row.name.is_empty() { 0.0 } else { first };
                let middle = bottom + ROW / 2.0;
                bottom += ROW;
                middle
            })
            .collect();
        let ticks = self.axis.ticks(((span / 95.0) as usize).max(2));
        let at =
            |value: f64| self.axis.place(value).map_or(left, |place| left + place.clamp(0.0, 1.0) * span);
        html! {
            svg viewBox=(format!("0 0 {width} {:.0}", bottom + 50.0)) role="img" aria-label=(self.title) {
                @for (place, label) in &ticks {
                    @let x = left + place * span;
                    path.rule d=(format!("M{x:.1} 2V{bottom:.1}")) {}
                    text.tick text-anchor="middle" x=(format!("{x:.1}")) y=(bottom + 19.0) { (label) }
                }
                path.frame d=(format!("M{left:.1} 2V{bottom:.1}H{:.1}", left + span)) {}
                text.axis text-anchor="middle" x=(left + span / 2.0) y=(bottom + 41.0) { (self.axis.title) }
                @for (row, y) in self.entries.iter().zip(&places) {
                    @if is_above && !row.name.is_empty() {
                        text.name x=(left + 4.0) y=(y - 12.0) { (row.name) }
                    } @else if !row.name.is_empty() {
                        text.name text-anchor="end" x=(left - 8.0) y=(y + 4.0) { (row.name) }
                    }
                    @match row.shape {
                        Shape::Bar(value) => {
                            rect.bar.(row.role.class()) x=(left) y=(y - 7.0) height="14" rx="1.5"
                                width=(format!("{:.1}", (at(value) - left).max(1.5))) {}
                        }
                        Shape::Point(value, [low, high]) => {
                            path.whisker.(row.role.class())
                                d=(format!("M{0:.1} {1:.1}v8M{0:.1} {2:.1}H{3:.1}M{3:.1} {1:.1}v8",
                                    at(low), y - 4.0, y, at(high))) {}
                            circle.point.(row.role.class()) cx=(format!("{:.1}", at(value))) cy=(y) r="4.5" {}
                        }
                    }
                    text.value x=(left + span + 10.0) y=(y + 4.0) { (row.text) }
                }
            }
        }
    }
}
