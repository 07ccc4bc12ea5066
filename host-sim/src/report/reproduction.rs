//! The report of `reproduce`.

use super::page::{Page, Tile, remarks, table};
use super::plot::{Layer, Plot, Role};
use super::records::{Compared, records};
use super::residual;
use super::rows::{Row, Rows, Shape};
use super::scale::{Axis, shown};
use super::search::search;
use crate::fit::{Fit, Prepared};
use crate::record::Record;
use crate::rig::Rig;
use crate::thesis::Case;
use eha_monitor::parameter::Parameter;
use maud::{Markup, html};
use serde_json::Value;

/// A case, and what was found of it.
pub(crate) struct Reproduced<'a> {
    /// The case.
    pub(crate) case: Case,
    /// Its record.
    pub(crate) record: &'a Record,
    /// The record as the last of the fits took it.
    pub(crate) prepared: &'a [Prepared],
    /// The fit with the monitor's bare model.
    pub(crate) before: &'a Fit,
    /// The fit with what the closed loop added; none where it was not closed.
    pub(crate) after: Option<&'a Fit>,
}

impl Reproduced<'_> {
    /// Mean errors of both faults, percent: the source's, ours before, ours after.
    fn errors(&self) -> [Option<f64>; 3] {
        let error = |fit: &Fit| {
            let value = |parameter| fit.estimate(parameter).map_or(f64::NAN, |estimate| estimate.value);
            self.case.mean_error_percent(value(Parameter::Backlash), value(Parameter::DryFriction))
        };
        let source = self.case.mean_error_percent(self.case.source_bkl, self.case.source_fdj);
        [Some(source), Some(error(self.before)), self.after.map(error)]
    }

    /// The error that the last of the fits leaves, percent.
    fn last_error(&self) -> f64 {
        self.errors().into_iter().flatten().last().unwrap_or(f64::NAN)
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

/// The report of the source's cases, as an HTML file; `rig` is that of the last of their fits.
pub(crate) fn reproduction(
    cases: &[Reproduced<'_>],
    rig: &Rig,
    portraits: &[Portrait],
    result: &Value,
) -> String {
    let worst = |which: usize| cases.iter().filter_map(|case| case.errors()[which]).fold(f64::NAN, f64::max);
    let tile = |name: &str, which: usize| {
        let value = worst(which);
        let text = if value.is_finite() { format!("{} %", percent(value)) } else { "-".to_owned() };
        Tile::new(name, text, "mean of both faults, worst of the cases")
    };
    let effects: Vec<&str> =
        result["added_effects"].as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let warnings: Vec<String> = result["warnings"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(Value::as_str)
        .map(str::to_owned)
        .collect();
    let errors = html! {
        (bars(cases))
        (case_table(cases))
        @if !warnings.is_empty() { (remarks("Notes", &warnings)) }
    };
    let mut sections = vec![("Errors", errors)];
    let worst_case = cases.iter().max_by(|one, other| one.last_error().total_cmp(&other.last_error()));
    let heading = worst_case.map(|worst| {
        let when = if worst.after.is_some() { " after" } else { "" };
        format!("Case {}, the one with the largest error{when}", worst.case.number)
    });
    sections.extend(heading.as_deref().zip(worst_case.map(|worst| closely(worst, rig))));
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
    let mut tiles = vec![tile("error of the source", 0)];
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

fn bars(cases: &[Reproduced<'_>]) -> Markup {
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

fn case_table(cases: &[Reproduced<'_>]) -> Markup {
    let known = |[bkl, fdj]: [f64; 2]| [shown(bkl, "m"), shown(fdj, "N")].join(", ");
    let found = |fit: &Fit| -> Vec<String> {
        let cells = fit.estimates.iter().map(|estimate| {
            let [value, low, high] = [estimate.value, estimate.ci95[0], estimate.ci95[1]]
                .map(|value| shown(value, estimate.parameter.info().unit));
            format!("{value} ({low} to {high})")
        });
        cells.collect()
    };
    let rows: Vec<Vec<String>> = cases
        .iter()
        .flat_map(|reproduced| {
            let case = &reproduced.case;
            let name = format!("{} {}", case.number, case.command);
            let (input, source) = (known([case.bkl, case.fdj]), known([case.source_bkl, case.source_fdj]));
            let before = [vec![name, input, source, "before".to_owned()], found(reproduced.before)].concat();
            let after = reproduced
                .after
                .map(|fit| [["", "", "", "after"].map(str::to_owned).to_vec(), found(fit)].concat());
            std::iter::once(before).chain(after)
        })
        .collect();
    let header =
        ["case", "input", "source", "ours", "backlash (95 % interval)", "dry friction (95 % interval)"];
    table("Backlash and dry friction", "", &header, &rows, true)
}

/// A case closely: its record against the models, what is left, the search.
fn closely(one: &Reproduced<'_>, rig: &Rig) -> Markup {
    let mut models = vec![(Role::Before, "before", one.before.predictions[0].as_slice())];
    models.extend(one.after.map(|after| (Role::After, "after", after.predictions[0].as_slice())));
    let name = format!("case {}, {}", one.case.number, one.case.command);
    let compared = [Compared { name, record: one.record, prepared: &one.prepared[0], models }];
    let fit = one.after.unwrap_or(one.before);
    html! {
        (records(&compared))
        (residual::tests(&compared, &fit.noise))
        @if one.after.is_some() { p.note.wide { "The search and the cost over the faults are those after." } }
        (search(fit, rig, &one.case.ranges(), one.prepared, one.case.population))
    }
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
