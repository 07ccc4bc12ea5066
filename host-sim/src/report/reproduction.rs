//! The report of `reproduce`.

use super::page::{Page, Tile, table};
use super::plot::{Layer, Plot, Role};
use super::rows::{Row, Rows, Shape};
use super::scale::Axis;
use crate::thesis::Case;
use maud::{Markup, html};
use serde_json::Value;

/// A case, and what was found of it: backlash, m, and dry friction, N.
pub(crate) struct Reproduced {
    /// The case.
    pub(crate) case: Case,
    /// With the monitor's bare model.
    pub(crate) before: [f64; 2],
    /// With what the closed loop added; none where it was not closed.
    pub(crate) after: Option<[f64; 2]>,
}

impl Reproduced {
    fn errors(&self) -> [Option<f64>; 3] {
        let error = |found: [f64; 2]| self.case.mean_error_percent(found[0], found[1]);
        [
            Some(error([self.case.source_bkl, self.case.source_fdj])),
            Some(error(self.before)),
            self.after.map(error),
        ]
    }
}

/// A healthy actuator by both models, flying one command.
pub(crate) struct Portrait {
    /// Name of the command.
    pub(crate) command: &'static str,
    /// Period of its samples, s.
    pub(crate) sample_period: f64,
    /// User position by the high-fidelity model, m.
    pub(crate) high: Vec<f64>,
    /// User position by the monitor's model, m.
    pub(crate) low: Vec<f64>,
}

/// The report of the source's cases, as an HTML file.
pub(crate) fn reproduction(cases: &[Reproduced], portraits: &[Portrait], result: &Value) -> String {
    let worst = |which: usize| cases.iter().filter_map(|case| case.errors()[which]).fold(f64::NAN, f64::max);
    let tile = |name: &str, which: usize| {
        let value = worst(which);
        let text = if value.is_finite() { format!("{} %", percent(value)) } else { "-".to_owned() };
        Tile::new(name, text, "worst of the cases")
    };
    let effects: Vec<&str> =
        result["added_effects"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let mut sections = vec![("Errors", html! { (bars(cases)) (case_table(cases)) })];
    if !portraits.is_empty() {
        sections.push(("High fidelity against low fidelity", pictures(portraits)));
    }
    let findings = findings(result);
    if !findings.is_empty() {
        let note = "Genetic algorithm alone, without the Gauss-Newton finish.";
        let header = ["what the source varied", "setting", "median error %", "worst error %"];
        sections.push((
            "Findings about the search",
            table("What the source varied", note, &header, &findings, true),
        ));
    }
    let seconds = result["seconds"].as_f64().unwrap_or(f64::NAN);
    let mut tiles = vec![tile("mean error of the source", 0)];
    if cases.iter().any(|case| case.after.is_some()) {
        tiles.extend([tile("ours before", 1), tile("ours after", 2)]);
    } else {
        tiles.push(tile("ours", 1));
    }
    let detail = "the source: 3532 to 10208 s for one";
    tiles.push(Tile::new("time, all cases", format!("{seconds:.2} s"), detail));
    Page {
        title: "The source's twelve cases",
        badge: None,
        summary: if effects.is_empty() {
            "Backlash and dry friction of the source's actuator, found again.".to_owned()
        } else {
            format!(
                "Before and after the monitor's model was given what two healthy records reveal: {}.",
                effects.join(", ")
            )
        },
        tiles,
        sections,
        config: &result["config"],
    }
    .render()
}

/// Errors below this are all the same to a reader, percent.
const LEAST: f64 = 1e-4;

fn percent(value: f64) -> String {
    match value {
        _ if value < LEAST => format!("below {LEAST}"),
        _ if value >= 10.0 => format!("{value:.0}"),
        _ if value >= 0.1 => format!("{value:.2}"),
        _ => format!("{value:.4}"),
    }
}

fn bars(cases: &[Reproduced]) -> Markup {
    let closed = cases.iter().any(|case| case.after.is_some());
    let mut roles = vec![(Role::Measured, "source"), (Role::Before, if closed { "before" } else { "ours" })];
    if closed {
        roles.push((Role::After, "after"));
    }
    let mut rows = Vec::new();
    for case in cases {
        let mut name = format!("{} {}", case.case.number, case.case.command);
        for (error, &(role, _)) in case.errors().into_iter().zip(&roles) {
            let Some(error) = error else { continue };
            rows.push(Row {
                name: std::mem::take(&mut name),
                role,
                shape: Shape::Bar(error.max(LEAST)),
                text: format!("{} %", percent(error)),
            });
        }
    }
    let ends = rows.iter().map(|row| match row.shape {
        Shape::Bar(value) | Shape::Point(value, _) => value,
    });
    Rows {
        title: "Mean error of both faults, by case".to_owned(),
        legend: roles.iter().map(|&(role, name)| (role, name.to_owned())).collect(),
        note: "Logarithmic. Mean of the magnitudes of both relative errors, as the source counts them."
            .to_owned(),
        axis: Axis::decades("mean error", "%", ends),
        entries: rows.clone(),
        wide: true,
    }
    .figure()
}

fn case_table(cases: &[Reproduced]) -> Markup {
    let pair = |[bkl, fdj]: [f64; 2]| format!("{:.4} mm, {fdj:.1} N", bkl * 1e3);
    let rows: Vec<Vec<String>> = cases
        .iter()
        .map(|reproduced| {
            let case = &reproduced.case;
            vec![
                format!("{} {}", case.number, case.command),
                pair([case.bkl, case.fdj]),
                pair([case.source_bkl, case.source_fdj]),
                pair(reproduced.before),
                reproduced.after.map_or_else(|| "-".to_owned(), pair),
            ]
        })
        .collect();
    table("Backlash and dry friction", "", &["case", "input", "source", "before", "after"], &rows, true)
}

fn pictures(portraits: &[Portrait]) -> Markup {
    html! { @for portrait in portraits {
        @let points = |values: &[f64]| -> Vec<[f64; 2]> {
            values.iter().enumerate().map(|(k, value)| [k as f64 * portrait.sample_period, *value]).collect()
        };
        @let end = portrait.high.len().saturating_sub(1) as f64 * portrait.sample_period;
        @let difference: Vec<f64> = portrait.high.iter().zip(&portrait.low).map(|(high, low)| high - low).collect();
        @let plot = |title: String, name: &str, legend: Vec<(Role, String)>, layers: Vec<Layer>, heights: Vec<f64>| {
            Plot {
                title, legend, layers, ramp: None, note: String::new(), wide: false,
                x: Axis::between("time", "s", 0.0, end),
                y: Axis::around(name, "m", heights.into_iter()),
            }.figure()
        };
        (plot(
            format!("{}: user position", portrait.command),
            "position",
            vec![(Role::Measured, "high fidelity".to_owned()), (Role::Model, "low fidelity".to_owned())],
            vec![Layer::Curve(Role::Measured, points(&portrait.high)), Layer::Curve(Role::Model, points(&portrait.low))],
            [portrait.high.clone(), portrait.low.clone()].concat(),
        ))
        (plot(
            format!("{}: high minus low fidelity", portrait.command),
            "difference",
            Vec::new(),
            vec![Layer::Curve(Role::Before, points(&difference))],
            difference.clone(),
        ))
    } }
}

fn findings(result: &Value) -> Vec<Vec<String>> {
    let number = |value: &Value| value.as_f64().map_or_else(|| "-".to_owned(), |value| format!("{value:.3}"));
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    result["findings"]
        .as_array()
        .into_iter()
        .flatten()
        .map(|row| {
            vec![
                text(&row["question"]),
                text(&row["setting"]),
                number(&row["median_error_percent"]),
                number(&row["worst_error_percent"]),
            ]
        })
        .collect()
}
