//! The report of `check`.

use super::page::{Page, Tile, remarks, table};
use super::plot::{Layer, Plot, Role, heights};
use super::records::{quantity_of, short_name};
use super::rows::{Row, Rows, Shape};
use super::scale::{Axis, shown};
use super::statistics::spectrum;
use crate::fit;
use crate::inspect::excitation::{SHOWN, grade, grades};
use crate::inspect::screen::{Defects, without};
use crate::inspect::{ChannelFacts, Inspection};
use crate::output::counted;
use crate::rig::Range;
use eha_monitor::channel::{Channel, ChannelRole};
use maud::{Markup, html};
use serde_json::Value;

/// The report of what records are worth, as an HTML file.
pub(crate) fn inspection(ranges: &[Range], all: &[Inspection], config: &Value) -> String {
    let paths: Vec<String> = all.iter().map(|one| one.record.name().to_owned()).collect();
    let names: Vec<String> = (0..paths.len()).map(|index| short_name(&paths, index)).collect();
    let tiles = match all {
        [one] => tiles(ranges, one),
        _ => all.iter().zip(&names).map(|(one, name)| tile(name, one)).collect(),
    };
    Page {
        title: "What records are worth",
        badge: None,
        summary: format!(
            "{} looked at before any fit: sampling, lost and cut-off samples, delay, noise, and how well each fault \
             would be known.",
            counted(all.len(), "record")
        ),
        tiles,
        sections: names.iter().map(String::as_str).zip(all.iter().map(|one| section(ranges, one))).collect(),
        config,
    }
    .render()
}

fn sampling(one: &Inspection) -> String {
    let (samples, period) = (one.record.len(), one.record.sample_period_s());
    format!("{samples} samples, {:.3} s", samples as f64 * period)
}

fn rate(one: &Inspection) -> String {
    format!("{} Hz", (1e3 / one.record.sample_period_s()).round() / 1e3)
}

fn tile(name: &str, one: &Inspection) -> Tile {
    Tile::new(name, rate(one), format!("{}; {}", sampling(one), counted(one.facts.notes.len(), "note")))
}

fn tiles(ranges: &[Range], one: &Inspection) -> Vec<Tile> {
    let mut tiles = vec![Tile::new("sampling", rate(one), sampling(one))];
    if let Some(response) = one.facts.response {
        let detail = format!("correlation {:.3}", response.correlation);
        tiles.push(Tile::new(
            "delay behind the command",
            format!("{:.1} ms", response.delay_s * 1e3),
            detail,
        ));
    }
    let own = one.own_promise().into_iter().flat_map(|own| &own.standard_errors);
    for (range, &error) in ranges.iter().zip(own) {
        let info = range.parameter.info();
        let detail = format!("{}; 95 % interval: {}", info.description, grade(range, error));
        tiles.push(Tile::new(
            format!("foreseen standard error of {}", info.name),
            shown(error, info.unit),
            detail,
        ));
    }
    tiles
}

fn section(ranges: &[Range], one: &Inspection) -> Markup {
    let notes = if one.facts.notes.is_empty() {
        vec!["Nothing stands out.".to_owned()]
    } else {
        one.facts.notes.clone()
    };
    html! {
        (remarks("What to look at", &notes))
        (channels(one))
        @for facts in &one.facts.channels {
            @if facts.channel != Channel::Command { (trace(one, facts)) }
        }
        (delay(one))
        @for facts in &one.facts.channels { (noise(one, facts)) }
        @for (index, range) in ranges.iter().enumerate() { (by_channels(one, range, index)) }
        @for (index, range) in ranges.iter().enumerate() { (by_command(one, range, index)) }
        @if !one.trials.is_empty() { (remarks("What to fly next", &[one.advice()])) }
    }
}

fn channels(one: &Inspection) -> Markup {
    let rows: Vec<Vec<String>> = one.facts.channels.iter().map(|facts| facts.cells(shown).to_vec()).collect();
    let note = format!("Motion: {}.", one.facts.motion.in_words(shown));
    table("Channels", &note, &ChannelFacts::COLUMNS, &rows, true)
}

/// Runs of lost samples that are marked: more would not be told apart.
const MOST_MARKS: usize = 400;

/// A channel over the time, with what is lost and cut off.
fn trace(one: &Inspection, facts: &ChannelFacts) -> Markup {
    let record = &one.record;
    let values = record.channel(facts.channel).unwrap_or_default();
    let info = facts.channel.info();
    let what = quantity_of(facts.channel);
    let timed = |series: &[f64]| -> Vec<[f64; 2]> {
        series.iter().enumerate().map(|(sample, &value)| [record.time_s(sample), value]).collect()
    };
    let (mut layers, mut legend) = (Vec::new(), Vec::new());
    if facts.channel == Channel::UserPosition {
        layers
            .push(Layer::Curve(Role::Reference, timed(record.channel(Channel::Command).unwrap_or_default())));
        legend.push((Role::Reference, "command".to_owned()));
    }
    if info.role == ChannelRole::Measured && facts.saturated_share > 0.0 {
        let resting: Vec<f64> = values
            .iter()
            .zip(fit::at_ends(values))
            .map(|(&value, rests)| if rests { value } else { f64::NAN })
            .collect();
        layers.push(Layer::Curve(Role::Measured, timed(&resting)));
        legend.push((Role::Measured, "at min/max (clipped?)".to_owned()));
    }
    layers.push(Layer::Curve(Role::Model, timed(values)));
    legend.push((Role::Model, what.to_owned()));
    let lost = lost(values);
    if !lost.is_empty() {
        let every = lost.len().div_ceil(MOST_MARKS);
        let marks = lost.into_iter().step_by(every).map(|(sample, value)| [record.time_s(sample), value]);
        layers.push(Layer::Dots(Role::Before, marks.collect()));
        legend.push((Role::Before, "lost, at the last value before".to_owned()));
    }
    if let Some(defects) = &facts.defects {
        let marks = defects.samples().map(|sample| [record.time_s(sample), values[sample]]);
        layers.push(Layer::Dots(Role::After, marks.collect()));
        legend.push((Role::After, "spikes and stuck samples".to_owned()));
    }
    let end = record.time_s(record.len().saturating_sub(1));
    Plot {
        title: format!("{}: {what}", info.column),
        legend,
        ramp: None,
        note: String::new(),
        x: Axis::between("time", "s", record.time_s(0), end),
        y: Axis::around(what, info.unit, heights(&layers)),
        layers,
        wide: true,
    }
    .figure()
}

/// Where runs of lost samples begin, with the last value before.
fn lost(values: &[f64]) -> Vec<(usize, f64)> {
    let begins = |&sample: &usize| values[sample].is_nan() && (sample == 0 || !values[sample - 1].is_nan());
    let first = values.iter().copied().find(|value| !value.is_nan()).unwrap_or(0.0);
    (0..values.len())
        .filter(begins)
        .map(|sample| (sample, sample.checked_sub(1).map_or(first, |before| values[before])))
        .collect()
}

/// How like the command the position is, by delay.
fn delay(one: &Inspection) -> Markup {
    let Some(response) = one.facts.response else { return html! {} };
    let period = one.record.sample_period_s();
    let points: Vec<[f64; 2]> = one
        .facts
        .likeness
        .iter()
        .enumerate()
        .map(|(delay, &correlation)| [delay as f64 * period * 1e3, correlation])
        .collect();
    let end = points.last().map_or(1.0, |point| point[0]);
    let layers =
        vec![Layer::Curve(Role::Model, points), Layer::Mark([response.delay_s * 1e3, response.correlation])];
    Plot {
        title: "Delay of the position behind the command".to_owned(),
        legend: Vec::new(),
        ramp: None,
        note: format!("Cross: the delay at which the two are most alike, {:.1} ms.", response.delay_s * 1e3),
        x: Axis::between("delay", "ms", 0.0, end.max(1e-3)),
        y: Axis::around("correlation", "1", heights(&layers)),
        layers,
        wide: false,
    }
    .figure()
}

/// Spectrum of a measured channel beside that of its noise.
fn noise(one: &Inspection, facts: &ChannelFacts) -> Markup {
    let Some(noise) = facts.noise else { return html! {} };
    let info = facts.channel.info();
    let defects = facts.defects.iter().flat_map(Defects::samples);
    let values = bridged(&without(one.record.channel(facts.channel).unwrap_or_default(), defects));
    let Some(found) = spectrum(&[values], one.record.sample_period_s(), noise) else { return html! {} };
    let frequencies: Vec<f64> = found.points.iter().map(|point| point[0]).collect();
    let [low, high] = found.white;
    let layers = vec![
        Layer::Area([1e-9, 1e9].map(|frequency| [frequency, low, high]).to_vec()),
        Layer::Curve(Role::Model, found.points),
    ];
    Plot {
        title: format!("{}: spectrum and noise", info.column),
        legend: Vec::new(),
        ramp: None,
        note: format!(
            "Amplitude density (Welch); samples that are lost or left out are bridged by straight lines for it. \
             Shaded: 95 % band of white noise of {}, which the curve should reach where the motion ends.",
            shown(noise, info.unit)
        ),
        x: Axis::decades("frequency", "Hz", frequencies.into_iter()),
        y: Axis::decades("density", &format!("{}/√Hz", info.unit), heights(&layers)),
        layers,
        wide: false,
    }
    .figure()
}

/// A series whose gaps are straight lines.
fn bridged(values: &[f64]) -> Vec<f64> {
    let mut bridged = values.to_vec();
    let present: Vec<usize> = (0..values.len()).filter(|&sample| values[sample].is_finite()).collect();
    for ends in present.windows(2) {
        let &[from, to] = ends else { continue };
        for sample in from + 1..to {
            let part = (sample - from) as f64 / (to - from) as f64;
            bridged[sample] = values[from] + part * (values[to] - values[from]);
        }
    }
    bridged
}

/// What each set of channels promises of a parameter.
fn by_channels(one: &Inspection, range: &Range, index: usize) -> Markup {
    let rows = one.promises.iter().map(|promise| {
        let names: Vec<&str> = promise.channels.iter().map(|channel| channel.info().column).collect();
        let role = if promise.recorded { Role::Model } else { Role::Reference };
        (names.join(" + "), role, promise.standard_errors[index])
    });
    errors(
        format!("Standard error of {} by channels", range.parameter.info().name),
        [(Role::Model, "recorded"), (Role::Reference, "not recorded")],
        "Foreseen by the model's sensitivities at the rig's values, on this command.",
        range,
        rows.collect(),
        true,
    )
}

/// What the best commands promise of a parameter.
fn by_command(one: &Inspection, range: &Range, index: usize) -> Markup {
    if one.trials.is_empty() {
        return html! {};
    }
    let own =
        one.own_promise().map(|own| ("this record".to_owned(), Role::Model, own.standard_errors[index]));
    let trials = one
        .trials
        .iter()
        .take(SHOWN)
        .map(|trial| (trial.name().replace(" um", " µm"), Role::After, trial.standard_errors[index]));
    errors(
        format!("Standard error of {} by command", range.parameter.info().name),
        [(Role::Model, "this record"), (Role::After, "built-in command")],
        "Each repeated to this record's length, with its channels; the best for all faults first.",
        range,
        own.into_iter().chain(trials).collect(),
        false,
    )
}

fn errors(
    title: String,
    legend: [(Role, &str); 2],
    note: &str,
    range: &Range,
    errors: Vec<(String, Role, f64)>,
    wide: bool,
) -> Markup {
    let info = range.parameter.info();
    let sizes: Vec<f64> = errors.iter().map(|(.., error)| *error).collect();
    Rows {
        title,
        legend: legend.map(|(role, name)| (role, name.to_owned())).to_vec(),
        note: format!("{note} {} Logarithmic.", grades()),
        axis: Axis::decades("standard error", info.unit, sizes.into_iter()),
        entries: errors
            .into_iter()
            .map(|(name, role, error)| Row {
                name,
                role,
                shape: Shape::Point(error, [error; 2]),
                text: format!("{}, {}", shown(error, info.unit), grade(range, error)),
            })
            .collect(),
        wide,
    }
    .figure()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_bridged_and_marked_where_they_begin() {
        let values = [f64::NAN, 1.0, f64::NAN, f64::NAN, 4.0, 5.0, f64::NAN];
        assert_eq!(bridged(&values)[1..6], [1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!(lost(&values), [(0, 1.0), (2, 1.0), (6, 5.0)]);
    }
}
