//! The report of `diagnose` and `demo`.

use super::figures::{self, Compared};
use super::identification::{search, short_name};
use super::page::{Page, Tile, remarks, table};
use super::plot::Role;
use super::rows::{Row, Rows, Shape};
use super::scale::{Axis, shown};
use crate::diagnose::{Diagnosis, Score, Verdict};
use crate::fit::{self, Estimate, FitSettings, Prepared};
use crate::record::Record;
use crate::rig::{Range, Rig};
use eha_monitor::effect::EffectInfo;
use eha_monitor::model::state::Outputs;
use maud::{Markup, html};
use serde_json::Value;

/// What the report of a diagnosis shows.
pub(crate) struct Diagnosed<'a> {
    /// The rig before anything was added.
    pub(crate) rig: &'a Rig,
    /// Records that were fitted.
    pub(crate) train: &'a [Record],
    /// Records that were only predicted.
    pub(crate) holdout: &'a [Record],
    /// Names of both, in this order.
    pub(crate) names: &'a [String],
    /// The answer.
    pub(crate) diagnosis: &'a Diagnosis,
    /// The same as JSON: notes, next experiment, configuration.
    pub(crate) result: &'a Value,
}

/// The report of a diagnosis, as an HTML file.
pub(crate) fn diagnosis(case: &Diagnosed<'_>) -> String {
    let (diagnosis, result) = (case.diagnosis, case.result);
    let prepare = |records: &[Record]| -> Vec<Prepared> {
        records.iter().map(|record| fit::prepare(case.rig, record)).collect()
    };
    let (train, holdout) = (prepare(case.train), prepare(case.holdout));
    let before = Rig { parameters: diagnosis.before.parameters, ..case.rig.clone() };
    let held_out = [fit::predict(&before, &holdout), fit::predict(&diagnosis.rig, &holdout)];
    let changed = !diagnosis.found.is_empty();
    let compare = |records: &'static str, index: usize| {
        let (record, prepared, offset, outputs): (_, _, _, [&[Outputs<f64>]; 2]) = if records == "fitted" {
            let outputs = [&diagnosis.before.predictions[index], &diagnosis.predictions[index]];
            (&case.train[index], &train[index], 0, outputs.map(Vec::as_slice))
        } else {
            let outputs = [&held_out[0][index], &held_out[1][index]];
            (&case.holdout[index], &holdout[index], case.train.len(), outputs.map(Vec::as_slice))
        };
        let name = case.names.get(offset + index).map_or_else(String::new, |name| short_name(name));
        let mut models = vec![(Role::Before, "before", outputs[0])];
        if changed {
            models.push((Role::After, "after", outputs[1]));
        }
        let name = if name.contains(records) { name } else { format!("{name} ({records})") };
        Compared { name, record, prepared, models }
    };
    let fitted: Vec<Compared<'_>> = (0..case.train.len()).map(|index| compare("fitted", index)).collect();
    let predicted: Vec<Compared<'_>> =
        (0..case.holdout.len()).map(|index| compare("held out", index)).collect();
    let mut ranges = case.rig.faults.clone();
    ranges.extend(
        case.rig
            .free
            .iter()
            .filter(|free| case.rig.faults.iter().all(|fault| fault.parameter != free.parameter)),
    );
    let mut sections = vec![("What was found", found(diagnosis, result))];
    sections.push(("Faults", faults(diagnosis)));
    if !predicted.is_empty() {
        sections.push(("Held-out records", figures::records(&predicted)));
    }
    sections.push(("Fitted records", figures::records(&fitted)));
    sections.push(("What is left", figures::residual_tests(&fitted, 0, diagnosis.noise[0])));
    sections.push((
        "Search for the declared faults, before",
        before_search(diagnosis, case.rig, &ranges, &train),
    ));
    let (class, verdict) = badge(diagnosis.verdict);
    Page {
        title: "Diagnosis",
        badge: Some((class, verdict)),
        summary: summary(diagnosis),
        tiles: tiles(diagnosis),
        sections,
        config: &result["config"],
    }
    .render()
}

fn before_search(diagnosis: &Diagnosis, rig: &Rig, ranges: &[Range], train: &[Prepared]) -> Markup {
    html! {
        (search(&diagnosis.before, rig, ranges, train, FitSettings::default().population))
        @if diagnosis.before.estimates.len() > 1 { (figures::correlation_matrix(&diagnosis.before)) }
    }
}

const fn badge(verdict: Verdict) -> (&'static str, &'static str) {
    match verdict {
        Verdict::Adequate => ("after", verdict.name()),
        Verdict::Explained => ("model", verdict.name()),
        Verdict::Unexplained => ("before", verdict.name()),
    }
}

fn names(effects: &[&'static EffectInfo]) -> String {
    effects.iter().map(|effect| effect.name).collect::<Vec<_>>().join(", ")
}

fn summary(diagnosis: &Diagnosis) -> String {
    let found: Vec<&str> = diagnosis.found.iter().filter(|f| f.named).map(|f| f.effect.name).collect();
    match diagnosis.verdict {
        Verdict::Adequate => {
            "The declared faults explain the records down to the noise. Nothing else is claimed.".to_owned()
        }
        Verdict::Explained => {
            format!("With {}, the model explains the records down to the noise.", found.join(" and "))
        }
        Verdict::Unexplained if found.is_empty() => {
            "The model lacks something that no effect of the catalogue explains.".to_owned()
        }
        Verdict::Unexplained => {
            format!("{} explains the better part of the misfit; something is left.", found.join(" and "))
        }
    }
}

fn tiles(diagnosis: &Diagnosis) -> Vec<Tile> {
    let error = |name: &str, scores: [Score; 2]| {
        let [before, after] = scores.map(|score| shown(score.position_rms, "m"));
        Tile::new(name, after, format!("{before} before; noise {}", shown(diagnosis.noise[0], "m")))
    };
    let mut tiles: Vec<Tile> = diagnosis
        .faults
        .iter()
        .zip(&diagnosis.before.estimates)
        .map(|(fault, before)| {
            let info = fault.estimate.parameter.info();
            let q = |value| shown(value, info.unit);
            let [low, high] = fault.estimate.ci95;
            Tile::new(
                info.description,
                q(fault.estimate.value),
                format!("{} to {}; {} before", q(low), q(high), q(before.value)),
            )
        })
        .collect();
    tiles.extend(diagnosis.holdout.map(|scores| error("error, held-out records", scores)));
    tiles.push(error("error, fitted records", diagnosis.train));
    tiles
}

fn found(diagnosis: &Diagnosis, result: &Value) -> Markup {
    let rows: Vec<Vec<String>> = diagnosis
        .found
        .iter()
        .flat_map(|found| {
            found.estimates.iter().map(move |estimate| {
                let info = estimate.parameter.info();
                let q = |value| shown(value, info.unit);
                vec![
                    if found.named {
                        found.effect.name.to_owned()
                    } else {
                        format!("{} (empirical)", found.effect.name)
                    },
                    found.effect.port.name().to_owned(),
                    info.name.to_owned(),
                    q(estimate.value),
                    format!("{} to {}", q(estimate.ci95[0]), q(estimate.ci95[1])),
                    if found.class.len() > 1 { names(&found.class[1..]) } else { "nothing else".to_owned() },
                ]
            })
        })
        .collect();
    let equations: Vec<String> = diagnosis
        .found
        .iter()
        .map(|found| format!("{}: {}", found.effect.name, found.effect.equation))
        .collect();
    let could_be: Vec<String> = result["warnings"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|warning| warning.as_str().map(str::to_owned))
        .collect();
    let next = result["next_experiment"].as_str().filter(|next| !next.is_empty());
    html! {
        (errors(diagnosis))
        (remarks("What to measure next", &[next.unwrap_or("Nothing is open.").to_owned()]))
        @if !rows.is_empty() {
            (table("Effects that were added", &equations.join("; "),
                &["effect", "acts on", "parameter", "value", "95 % interval", "could as well be"], &rows, true))
        }
        @if !could_be.is_empty() { (remarks("What else it could be", &could_be)) }
        @if let Some(left) = &diagnosis.left {
            (remarks("What is left, and when", &left_words(left)))
        }
    }
}

fn left_words(left: &crate::diagnose::residual::Description) -> Vec<String> {
    let mut words = vec![format!("Half of it acts from {:.3} to {:.3} s.", left.active[0], left.active[1])];
    if let Some((name, correlation)) = left.follows {
        words.push(format!("It follows {name} (correlation {correlation:.2})."));
    }
    if let Some((frequency, share)) = left.tone {
        words.push(format!("{:.0} % of it is a tone at {frequency:.1} Hz.", share * 100.0));
    }
    words
}

fn errors(diagnosis: &Diagnosis) -> Markup {
    let mut groups = vec![("fitted records", diagnosis.train)];
    groups.extend(diagnosis.holdout.map(|scores| ("held-out records", scores)));
    let bar = |name: &str, role: Role, value: f64| Row {
        name: name.to_owned(),
        role,
        shape: Shape::Bar(value),
        text: shown(value, "m"),
    };
    let mut rows = Vec::new();
    for (name, [before, after]) in groups {
        rows.push(bar(name, Role::Before, before.position_rms));
        rows.push(bar("", Role::After, after.position_rms));
    }
    rows.push(bar("noise", Role::Reference, diagnosis.noise[0]));
    let ends = rows.iter().map(|row| match row.shape {
        Shape::Bar(value) | Shape::Point(value, _) => value,
    });
    Rows {
        title: "Error of the user position, before and after".to_owned(),
        legend: vec![(Role::Before, "before".to_owned()), (Role::After, "after".to_owned())],
        note: String::new(),
        axis: Axis::from_zero("residual, rms", "m", ends),
        entries: rows.clone(),
        wide: true,
    }
    .figure()
}

fn faults(diagnosis: &Diagnosis) -> Markup {
    let after: Vec<Estimate> = diagnosis.faults.iter().map(|fault| fault.estimate).collect();
    let before: Vec<&Estimate> = diagnosis.before.estimates.iter().take(after.len()).collect();
    let rows: Vec<Vec<String>> = diagnosis
        .faults
        .iter()
        .zip(&before)
        .map(|(fault, before)| {
            let info = fault.estimate.parameter.info();
            let q = |value| shown(value, info.unit);
            vec![
                info.name.to_owned(),
                q(before.value),
                q(fault.estimate.value),
                format!("{} to {}", q(fault.estimate.ci95[0]), q(fault.estimate.ci95[1])),
                if fault.confounded_with.is_empty() { "-".to_owned() } else { names(&fault.confounded_with) },
            ]
        })
        .collect();
    html! {
        (figures::estimates(&[(Role::Before, "before", before), (Role::After, "after", after.iter().collect())]))
        (table("Faults", "", &["fault", "before", "after", "95 % interval", "mixed up with"], &rows, true))
    }
}
