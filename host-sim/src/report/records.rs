//! Records against what models say of them, and what is left.

use super::plot::{Layer, Plot, Role, heights};
use super::scale::{Axis, shown};
use crate::fit::{OF_95, Prepared};
use crate::record::Record;
use eha_monitor::channel::Channel;
use eha_monitor::model::state::Outputs;
use maud::{Markup, html};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A record with what a model, or two, say of it.
pub(super) struct Compared<'a> {
    /// Name of the record.
    pub(super) name: String,
    /// The record.
    pub(super) record: &'a Record,
    /// The record as it was fitted.
    pub(super) prepared: &'a Prepared,
    /// Models: their role, their name and what they predict.
    pub(super) models: Vec<(Role, &'static str, &'a [Outputs<f64>])>,
}

/// Length of an excerpt, s.
const EXCERPT_S: f64 = 0.5;
/// How many excerpts make a record long.
const LONG: usize = 8;

impl Compared<'_> {
    /// Measured minus predicted, one value a sample; NaN where nothing is compared.
    pub(super) fn residual(&self, outputs: &[Outputs<f64>], channel: usize) -> Vec<f64> {
        let record = self.prepared.as_core();
        let left = |(sample, (value, output)): (usize, (&f64, &Outputs<f64>))| {
            if record.is_compared(sample) { value - output.to_array()[channel] } else { f64::NAN }
        };
        self.prepared.measured(channel).iter().zip(outputs).enumerate().map(left).collect()
    }

    /// Does it have a measured channel?
    pub(super) fn has(&self, channel: usize) -> bool {
        !self.prepared.measured(channel).is_empty()
    }

    fn over_time(&self, part: &Range<usize>, values: &[f64]) -> Vec<[f64; 2]> {
        part.clone().filter_map(|sample| Some([self.record.time_s(sample), *values.get(sample)?])).collect()
    }

    fn time_axis(&self, part: &Range<usize>) -> Axis {
        let [from, to] = [part.start, part.end.saturating_sub(1)].map(|sample| self.record.time_s(sample));
        Axis::between("time", "s", from, to)
    }

    /// The samples of a long record in which the residual of its first model is largest.
    fn excerpt(&self, channel: usize) -> Option<Range<usize>> {
        let length = (EXCERPT_S / self.record.sample_period_s()).round() as usize;
        let last = self.record.len().checked_sub(length)?;
        if length < 2 || self.record.len() < LONG * length {
            return None;
        }
        let residual = self.residual(self.models.first()?.2, channel);
        let power = |&from: &usize| -> f64 {
            residual[from..from + length].iter().filter(|left| left.is_finite()).map(|left| left * left).sum()
        };
        let from = (0..=last).step_by(length / 2).max_by(|one, other| power(one).total_cmp(&power(other)))?;
        Some(from..from + length)
    }
}

/// A channel of a record against the last of its models, then what is left, of every model; of a long one an excerpt too.
fn record(compared: &Compared<'_>, channel: usize) -> Markup {
    let whole = 0..compared.record.len();
    html! {
        (traces(compared, channel, &whole, true))
        (left(compared, channel, &whole, true))
        @if let Some(part) = compared.excerpt(channel) {
            (traces(compared, channel, &part, false))
            (left(compared, channel, &part, false))
        }
    }
}

/// Quantity of a channel, in a word or two.
pub(super) fn quantity_of(channel: Channel) -> &'static str {
    let info = channel.info();
    info.description.split(',').next().and_then(|words| words.split(" of ").next()).unwrap_or(info.column)
}

/// What is said of an excerpt.
const EXCERPT: &str = "The half second in which the residual is largest.";

fn traces(compared: &Compared<'_>, channel: usize, part: &Range<usize>, is_whole: bool) -> Markup {
    let what = quantity_of(Channel::MEASURED[channel]);
    let (mut layers, mut legend) = (Vec::new(), Vec::new());
    // Behind the others, which a long record would hide.
    if channel == 0 {
        layers.push(Layer::Curve(Role::Reference, compared.over_time(part, compared.prepared.command())));
        legend.push((Role::Reference, "command".to_owned()));
    }
    layers.push(Layer::Curve(Role::Measured, compared.over_time(part, compared.prepared.measured(channel))));
    legend.push((Role::Measured, "measured".to_owned()));
    if let Some((role, name, outputs)) = compared.models.last() {
        let predicted: Vec<f64> = outputs.iter().map(|output| output.to_array()[channel]).collect();
        layers.push(Layer::Curve(*role, compared.over_time(part, &predicted)));
        legend.push((*role, (*name).to_owned()));
    }
    Plot {
        title: format!("{}: {what}", compared.name),
        legend,
        ramp: None,
        note: if is_whole { String::new() } else { EXCERPT.to_owned() },
        x: compared.time_axis(part),
        y: Axis::around(what, Channel::MEASURED[channel].info().unit, heights(&layers)),
        layers,
        wide: is_whole,
    }
    .figure()
}

fn left(compared: &Compared<'_>, channel: usize, part: &Range<usize>, is_whole: bool) -> Markup {
    let (noise, unit) = (compared.prepared.noise[channel], Channel::MEASURED[channel].info().unit);
    let (mut layers, mut legend) = (Vec::new(), Vec::new());
    for (role, name, outputs) in &compared.models {
        let residual = compared.residual(outputs, channel);
        layers.push(Layer::Curve(*role, compared.over_time(part, &residual)));
        legend.push((*role, (*name).to_owned()));
    }
    let stretch = compared.prepared.as_core().stretch;
    let restarts = if is_whole && stretch < compared.record.len() {
        let seconds = stretch as f64 * compared.record.sample_period_s();
        format!(
            " The model starts anew from the measured state every {seconds} s: what is left begins near none there, and \
             grows from there on like a saw tooth."
        )
    } else {
        String::new()
    };
    // On top, where a long record would hide a shading.
    let band = if noise.is_finite() {
        layers.extend([-OF_95, OF_95].map(|normal| Layer::Limit(normal * noise)));
        format!("Between the lines: 95 % of white noise of {}.", shown(noise, unit))
    } else {
        "No fit looked at this channel.".to_owned()
    };
    Plot {
        title: format!("{}: residual of the {}", compared.name, quantity_of(Channel::MEASURED[channel])),
        legend,
        ramp: None,
        note: format!("Measured minus predicted. {band}{restarts}"),
        x: compared.time_axis(part),
        y: Axis::around("residual", unit, heights(&layers)),
        layers,
        wide: is_whole,
    }
    .figure()
}

/// Every channel of every record, with its noise.
pub(super) fn records(all: &[Compared<'_>]) -> Markup {
    html! {
        @for compared in all.iter().take(MOST_RECORDS) {
            @for channel in (0..Channel::MEASURED.len()).filter(|&channel| compared.has(channel)) {
                (record(compared, channel))
            }
        }
        @if all.len() > MOST_RECORDS {
            p.note.wide { "The first " (MOST_RECORDS) " of " (all.len()) " records are shown; every figure below counts all." }
        }
    }
}

/// Records that are drawn.
const MOST_RECORDS: usize = 6;

/// The name of one of several records without its folder and ending, but with its segment. As many folders stay as tell it
/// from the others, or all of its path where these do not.
pub(crate) fn short_name(names: &[String], index: usize) -> String {
    let name = &names[index];
    let tells_apart = |depth: &usize| {
        let end = end_of(name, *depth);
        names.iter().all(|other| other == name || end_of(other, *depth) != end)
    };
    let depths = 1..=Path::new(name).components().count();
    depths.into_iter().find(tells_apart).map_or_else(|| name.clone(), |depth| end_of(name, depth))
}

/// The last parts of a path, so many at most, without its ending but with its segment.
fn end_of(name: &str, depth: usize) -> String {
    let (file, segment) = name.rsplit_once('@').map_or((name, None), |(file, segment)| (file, Some(segment)));
    let path = Path::new(file).with_extension("");
    let before = path.components().count().saturating_sub(depth);
    let end: PathBuf = path.components().skip(before).collect();
    let end = end.display();
    segment.map_or_else(|| end.to_string(), |segment| format!("{end}@{segment}"))
}

#[cfg(test)]
mod tests {
    use super::short_name;

    #[test]
    fn records_of_one_stem_are_told_apart_by_their_folders() {
        let short = |names: &[&str]| -> Vec<String> {
            let names: Vec<String> = names.iter().map(ToString::to_string).collect();
            (0..names.len()).map(|index| short_name(&names, index)).collect()
        };
        assert_eq!(short(&["a/rec.csv"]), ["rec"]);
        assert_eq!(short(&["-"]), ["-"]);
        assert_eq!(short(&["a/rec.csv", "b/rec.csv", "b/other.csv"]), ["a/rec", "b/rec", "other"]);
        assert_eq!(short(&["x/1/run/rec.csv", "x/2/run/rec.csv"]), ["1/run/rec", "2/run/rec"]);
        assert_eq!(short(&["rec.csv@..2", "rec.csv@3.."]), ["rec@..2", "rec@3.."]);
        assert_eq!(short(&["a/rec.csv@..2", "b/rec.csv@..2"]), ["a/rec@..2", "b/rec@..2"]);
        assert_eq!(short(&["rec.csv", "rec.mat"]), ["rec.csv", "rec.mat"]);
        assert_eq!(short(&["rec.csv", "a/rec.csv"]), ["rec.csv", "a/rec"]);
        // One that is there twice.
        assert_eq!(short(&["a/rec.csv", "a/rec.csv"]), ["rec", "rec"]);
    }
}
