//! The report of `diagnose` and `demo`.

use super::estimates::{self, correlation_matrix};
use super::page::{Page, Tile, remarks, table};
use super::plot::Role;
use super::records::{Compared, records, short_name};
use super::residual;
use super::rows::{Row, Rows, Shape};
use super::scale::{Axis, shown, shown_by};
use super::search::search;
use crate::diagnose::description::Description;
use crate::diagnose::{Diagnosis, Fault, Score, Side, Verdict};
use crate::fit::{self, Estimate, FitSettings, LoopScore, Prepared};
use crate::record::Record;
use crate::rig::{Range, Rig};
use eha_monitor::channel::ChannelInfo;
use eha_monitor::model::state::Outputs;
use maud::{Markup, html};
use serde_json::Value;
use std::iter;

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
    /// Errors in closed loop and over open windows, before and after, of each of the parts; none where the controller
    /// is not known.
    pub(crate) loops: &'a OfParts<LoopScore>,
    /// The diagnosis as JSON: notes, next experiment, configuration.
    pub(crate) result: &'a Value,
}

/// The parts that the records of a diagnosis fall into.
pub(crate) const PARTS: [&str; 2] = ["fitted records", "held-out records"];
/// What a record of each of them is called.
pub(crate) const FITTED: &str = "fitted";
pub(crate) const HELD_OUT: &str = "held out";

/// Name of a record, of several, that is in one of the parts.
pub(crate) fn name_of(names: &[String], index: usize, part: &str) -> String {
    let name = short_name(names, index);
    if name.contains(part) { name } else { format!("{name} ({part})") }
}

/// A score of each part, before and after; none where there is none.
pub(crate) type OfParts<S> = [Option<[S; 2]>; 2];

/// The report of a diagnosis, as an HTML file.
pub(crate) fn diagnosis(case: &Diagnosed<'_>) -> String {
    let (diagnosis, result) = (case.diagnosis, case.result);
    let (train, holdout) = diagnosis.records.split_at(case.train.len());
    let before = diagnosis.before.applied(case.rig);
    let held_out = [fit::predict(&before, holdout), fit::predict(&diagnosis.foretelling, holdout)];
    let changed = !diagnosis.found.is_empty();
    let compare = |part: &'static str, index: usize| {
        let (record, prepared, offset, outputs): (_, _, _, [&[Outputs<f64>]; 2]) = if part == FITTED {
            let outputs = [&diagnosis.before.predictions[index], &diagnosis.predictions[index]];
            (&case.train[index], &train[index], 0, outputs.map(Vec::as_slice))
        } else {
            let outputs = [&held_out[0][index], &held_out[1][index]];
            (&case.holdout[index], &holdout[index], case.train.len(), outputs.map(Vec::as_slice))
        };
        let name = name_of(case.names, offset + index, part);
        let mut models = vec![(Role::Before, "before", outputs[0])];
        if changed {
            models.push((Role::After, "after", outputs[1]));
        }
        Compared { name, record, prepared, models }
    };
    let fitted: Vec<Compared<'_>> = (0..case.train.len()).map(|index| compare(FITTED, index)).collect();
    let predicted: Vec<Compared<'_>> =
        (0..case.holdout.len()).map(|index| compare(HELD_OUT, index)).collect();
    let ranges = case.rig.declared();
    let mut sections = vec![("What was found", found(case))];
    sections.push((headings(diagnosis).0, estimates(diagnosis)));
    if !predicted.is_empty() {
        sections.push(("Held-out records", records(&predicted)));
    }
    sections.push(("Fitted records", records(&fitted)));
    sections.push(("What is left", residual::tests(&fitted, &diagnosis.noise)));
    sections
        .push(("Search for the declared faults, before", before_search(diagnosis, case.rig, &ranges, train)));
    let verdict = diagnosis.verdict_in_words();
    Page {
        title: "Diagnosis",
        badge: Some((badge(diagnosis.verdict), &verdict)),
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
        @if diagnosis.before.estimates.len() > 1 {
            (correlation_matrix("Correlation of the estimates, before", &diagnosis.before.correlation()))
        }
    }
}

/// Class of the badge of a verdict.
const fn badge(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Adequate => "after",
        Verdict::Explained => "model",
        Verdict::Unexplained => "before",
    }
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
        Verdict::Unexplained if diagnosis.early.is_some() => {
            "The search ended early: what was tried by then does not explain the records. What was not is not ruled out."
                .to_owned()
        }
        Verdict::Unexplained if found.is_empty() => {
            let terms = if diagnosis.found.is_empty() {
                ""
            } else {
                " Empirical terms bring its prediction closer; they are no names for what is there."
            };
            format!("The model lacks something that no effect of the catalogue explains.{terms}")
        }
        Verdict::Unexplained => {
            format!("With {}, at least 99 % of the misfit beyond noise is gone; something is left.", found.join(" and "))
        }
    }
}

fn tiles(diagnosis: &Diagnosis) -> Vec<Tile> {
    let error = |name: &str, scores: [Score; 2]| {
        let [before, after] = scores.map(|score| shown(score.position_rms(), "m"));
        Tile::new(name, after, format!("{before} before; noise {}", shown(diagnosis.noise[0], "m")))
    };
    let mut tiles: Vec<Tile> = diagnosis
        .faults
        .iter()
        .zip(&diagnosis.before.estimates)
        .map(|(fault, before)| {
            let info = fault.estimate.parameter.info();
            let q = shown_by(&fault.estimate);
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

fn found(case: &Diagnosed<'_>) -> Markup {
    let (diagnosis, result) = (case.diagnosis, case.result);
    let rows: Vec<Vec<String>> = diagnosis
        .found
        .iter()
        .flat_map(|found| {
            let name = if found.named {
                found.effect.name.to_owned()
            } else {
                format!("{} (empirical)", found.effect.name)
            };
            let others = if found.named {
                diagnosis.names_or(&found.class[1..], "nothing else")
            } else {
                "not a name".to_owned()
            };
            // What is said of the effect stands once.
            let of_effect = iter::once([name, found.effect.port.name().to_owned(), others])
                .chain(iter::repeat([const { String::new() }; 3]));
            found.estimates.iter().zip(of_effect).map(|(estimate, [name, port, others])| {
                let info = estimate.parameter.info();
                let q = shown_by(estimate);
                let interval = format!("{} to {}", q(estimate.ci95[0]), q(estimate.ci95[1]));
                vec![name, port, info.name.to_owned(), q(estimate.value), interval, others]
            })
        })
        .collect();
    let equations: Vec<String> = diagnosis
        .found
        .iter()
        .map(|found| format!("{}: {}", found.effect.name, found.effect.equation))
        .collect();
    let notes: Vec<String> = result["warnings"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|warning| warning.as_str().map(str::to_owned))
        .collect();
    let next = result["next_experiment"].as_str().filter(|next| !next.is_empty());
    let nothing_open = match diagnosis.early {
        Some(_) => "The search ended early: let it come to its end first.",
        None => "Nothing is open.",
    };
    html! {
        (errors(diagnosis))
        (channels(diagnosis))
        (closed_loop(case.loops))
        (remarks("What to measure next", &[next.unwrap_or(nothing_open).to_owned()]))
        @if !rows.is_empty() {
            (table("Effects that were added", &equations.join("; "),
                &["effect", "acts on", "parameter", "value", "95 % interval", "could as well be"], &rows, true))
        }
        @if !notes.is_empty() { (remarks("Notes", &notes)) }
        @if let Some(left) = &diagnosis.left {
            (remarks(&left_title(case, left), &left_words(left, diagnosis.acts)))
        }
    }
}

fn left_title(case: &Diagnosed<'_>, left: &Description) -> String {
    match case.train.len() {
        1 => "What is left, and when".to_owned(),
        _ => format!("What is left of {}, and when", name_of(case.names, left.record, FITTED)),
    }
}

fn left_words(left: &Description, acts: Option<Side>) -> Vec<String> {
    let [from, to] = left.active;
    let mut words = vec![format!("Half of its energy lies between {from:.3} and {to:.3} s.")];
    if let Some((name, correlation)) = left.follows {
        words.push(format!("It follows {name} (correlation {correlation:.2})."));
    }
    if let Some((frequency, share)) = left.tone {
        words.push(format!("{:.0} % of it is a tone at {frequency:.1} Hz.", share * 100.0));
    }
    words.extend(acts.map(|side| format!("It acts {}.", side.in_words())));
    words
}

/// What there is before and after, of each part that has it.
fn of_parts<S: Copy, N>(scores: &OfParts<S>, number: impl Fn(S) -> Option<N>) -> Vec<(&'static str, [N; 2])> {
    let numbers = |scores: &Option<[S; 2]>| {
        let [before, after] = (*scores)?;
        Some([number(before)?, number(after)?])
    };
    PARTS.into_iter().zip(scores).filter_map(|(part, scores)| Some((part, numbers(scores)?))).collect()
}

fn errors(diagnosis: &Diagnosis) -> Markup {
    let groups = of_parts(&[Some(diagnosis.train), diagnosis.holdout], |score| Some(score.position_rms()));
    let noise = Some(diagnosis.noise[0]);
    bars("Error of the user position, before and after", ("residual, rms", "m"), &groups, noise, true)
}

/// What is left of each channel, before and after, beside its noise: the columns and a row for each channel, as `quantity`
/// writes a value in a unit. None where the user position is all that was compared.
pub(crate) fn channel_rows(
    diagnosis: &Diagnosis,
    quantity: fn(f64, &str) -> String,
) -> Option<(Vec<String>, Vec<Vec<String>>)> {
    let parts = of_parts(&[Some(diagnosis.train), diagnosis.holdout], Some);
    let of_part = |(part, _): &(&str, [Score; 2])| {
        let part = part.trim_end_matches(" records");
        ["before", "after"].map(|when| format!("{part}, {when}"))
    };
    let columns = ["channel", "noise"].map(str::to_owned).into_iter().chain(parts.iter().flat_map(of_part));
    let row = |(channel, info, noise): (usize, &ChannelInfo, f64)| {
        let left = parts.iter().flat_map(|(_, scores)| scores.map(|score| score.rms[channel]));
        let numbers = iter::once(noise).chain(left).map(|value| quantity(value, info.unit));
        iter::once(info.column.to_owned()).chain(numbers).collect()
    };
    let rows: Vec<Vec<String>> = diagnosis.channels().map(row).collect();
    (rows.len() > 1).then(|| (columns.collect(), rows))
}

fn channels(diagnosis: &Diagnosis) -> Markup {
    html! {
        @if let Some((columns, rows)) = channel_rows(diagnosis, shown) {
            (table("Residual of each channel, rms", "", &columns.iter().map(String::as_str).collect::<Vec<_>>(), &rows, true))
        }
    }
}

/// Errors of an axis whose controller is known.
fn closed_loop(loops: &OfParts<LoopScore>) -> Markup {
    let force = of_parts(loops, |score| Some(score.force_error * 100.0));
    let open = of_parts(loops, |score| score.open_loop_rms);
    html! {
        @if !force.is_empty() {
            (bars("Force in closed loop, before and after", ("error over recorded force", "%"), &force, None, open.is_empty()))
        }
        @if !open.is_empty() {
            (bars("Open loop, before and after", ("residual of the user position, rms", "m"), &open, None, false))
        }
    }
}

/// Errors before and after, as bars.
fn bars(
    title: &str,
    (quantity, unit): (&str, &str),
    groups: &[(&str, [f64; 2])],
    noise: Option<f64>,
    wide: bool,
) -> Markup {
    let bar = |name: &str, role: Role, value: f64| Row {
        name: name.to_owned(),
        role,
        shape: Shape::Bar(value),
        text: shown(value, unit),
    };
    let mut rows: Vec<Row> = groups
        .iter()
        .flat_map(|&(name, [before, after])| [bar(name, Role::Before, before), bar("", Role::After, after)])
        .collect();
    rows.extend(noise.map(|noise| bar("noise", Role::Reference, noise)));
    let values = groups.iter().flat_map(|(_, values)| *values).chain(noise);
    Rows {
        title: title.to_owned(),
        legend: vec![(Role::Before, "before".to_owned()), (Role::After, "after".to_owned())],
        note: String::new(),
        axis: Axis::from_zero(quantity, unit, values),
        entries: rows,
        wide,
    }
    .figure()
}

/// Faults, and the other free parameters, before and after.
fn estimates(diagnosis: &Diagnosis) -> Markup {
    let after: Vec<&Estimate> =
        diagnosis.faults.iter().map(|fault| &fault.estimate).chain(&diagnosis.free).collect();
    let before: Vec<&Estimate> = diagnosis.before.estimates.iter().collect();
    let rows: Vec<Vec<String>> = after
        .iter()
        .zip(&before)
        .enumerate()
        .map(|(index, (after, before))| {
            let info = after.parameter.info();
            let q = shown_by(after);
            let mixed_up = |fault: &Fault| diagnosis.names_or(&fault.confounded_with, "-");
            vec![
                info.name.to_owned(),
                q(before.value),
                q(after.value),
                format!("{} to {}", q(after.ci95[0]), q(after.ci95[1])),
                diagnosis.faults.get(index).map_or_else(|| "-".to_owned(), mixed_up),
            ]
        })
        .collect();
    let (title, first) = headings(diagnosis);
    html! {
        (estimates::estimates(&[(Role::Before, "before", before), (Role::After, "after", after)]))
        (table(title, "", &[first, "before", diagnosis.after_in_words(), "95 % interval", "mixed up with"], &rows, true))
        @if diagnosis.correlation.parameters.len() > 1 {
            (correlation_matrix("Correlation of the estimates, after", &diagnosis.correlation))
        }
    }
}

/// What the declared parameters are, and what one of them is.
fn headings(diagnosis: &Diagnosis) -> (&'static str, &'static str) {
    if diagnosis.free.is_empty() { ("Faults", "fault") } else { ("Free parameters", "parameter") }
}
