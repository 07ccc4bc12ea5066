//! A diagnosis as text.

use super::diagnose::{Answer, Job};
use crate::diagnose::{Diagnosis, Score, residual, score};
use crate::fit::{self, Estimate, LoopScore};
use crate::output::{self, effects_in_words};
use crate::record::Record;
use crate::report::{FITTED, HELD_OUT, OfParts, PARTS, channel_rows, name_of};
use comfy_table::Table;
use serde_json::Value;
use std::fmt::Write as _;
use std::slice;

/// Marks of a residual over time, one for each of as many steps up to the largest.
const SHADES: &[u8; 8] = b".:-=+*#@";
/// In so many parts of its time.
const PARTS_OF_TIME: usize = 64;

impl Job<'_> {
    /// The position residual over the time of the record on which the model erred most before, of the held-out ones where
    /// there are any.
    fn residual_text(&self, diagnosis: &Diagnosis, text: &mut String) {
        let fitted = self.train.len();
        let (range, part) =
            if self.holdout.is_empty() { (0..fitted, FITTED) } else { (fitted..self.names.len(), HELD_OUT) };
        let before = diagnosis.before.applied(&self.rig);
        let error = |index: usize| score(&before, &diagnosis.records[index..=index]).position_rms();
        let Some(shown) = range.max_by(|&a, &b| error(a).total_cmp(&error(b))) else { return };
        let record = &diagnosis.records[shown];
        let left = [&before, &diagnosis.foretelling].map(|rig| {
            let outputs = fit::predict(rig, slice::from_ref(record)).concat();
            residual::over_time(record, &outputs, PARTS_OF_TIME)
        });
        let largest = left.iter().flatten().flatten().copied().fold(0.0, f64::max);
        let start = self.records().nth(shown).map_or(0.0, Record::start_time_s);
        let _ = writeln!(
            text,
            "\nits residual over {start:.3} to {:.3} s of {}, from . (none) to @ ({}):",
            start + record.duration(),
            name_of(&self.names, shown, part),
            output::quantity(largest, "m"),
        );
        for (when, left) in ["before", "after"].into_iter().zip(&left) {
            let marks: String = left.iter().map(|left| shade(*left, largest)).collect();
            let _ = writeln!(text, "  {when:<7} {marks}");
        }
    }

    /// The errors of an axis whose controller is known.
    fn closed_loop_text(&self, loops: &OfParts<LoopScore>, text: &mut String) {
        if loops.iter().all(Option::is_none) {
            return;
        }
        let window =
            self.rig.restart_s.map_or(String::new(), |seconds| format!("; open loop over {seconds} s"));
        let _ = writeln!(text, "\nforce in closed loop, error over recorded{window}:");
        for (part, scores) in PARTS.into_iter().zip(loops) {
            for (when, score) in ["before", "after"].into_iter().zip(scores.iter().flatten()) {
                let open = score
                    .open_loop_rms
                    .map_or(String::new(), |rms| format!("{:>15}", output::quantity(rms, "m")));
                let _ = writeln!(text, "  {part:<17} {when:<7}{:>8.2} %{open}", score.force_error * 100.0);
            }
        }
    }

    /// All of it.
    pub(super) fn text(&self, answer: &Answer) -> String {
        let Answer { diagnosis, loops, result } = answer;
        let mut text = String::new();
        let metres = |value: f64| output::quantity(value, "m");
        let _ = writeln!(text, "verdict: {}", diagnosis.verdict_in_words());
        for found in &diagnosis.found {
            let sizes: Vec<String> = found
                .estimates
                .iter()
                .map(|estimate| {
                    let info = estimate.parameter.info();
                    let q = output::in_digits_of(estimate);
                    format!(
                        "{} = {} ({} to {})",
                        info.name,
                        q(estimate.value),
                        q(estimate.ci95[0]),
                        q(estimate.ci95[1])
                    )
                })
                .collect();
            let what = if found.named { "effect" } else { "empirical term (not a name for what is there)" };
            let _ = writeln!(
                text,
                "{what}: {}: {}; {}",
                found.effect.name,
                found.effect.equation,
                sizes.join(", ")
            );
            if found.class.len() > 1 {
                let names = effects_in_words(&found.class[1..]);
                let _ = writeln!(text, "  these records cannot tell it from: {names}");
            }
        }
        let _ = writeln!(text, "\nerror of the user position (noise {}):", metres(diagnosis.noise[0]));
        let scores = [Some(diagnosis.train), diagnosis.holdout];
        let largest = scores.iter().flatten().flatten().map(Score::position_rms).fold(0.0, f64::max);
        for (part, scores) in PARTS.into_iter().zip(scores) {
            for (when, score) in ["before", "after"].into_iter().zip(scores.iter().flatten()) {
                let length = (score.position_rms() / largest * 40.0).round().max(1.0) as usize;
                let _ = writeln!(
                    text,
                    "  {part:<17} {when:<7}{:>12}  {}",
                    metres(score.position_rms()),
                    "#".repeat(length)
                );
            }
        }
        if let Some((columns, rows)) = channel_rows(diagnosis, output::quantity) {
            let mut table = output::table(columns);
            table.add_rows(rows);
            let _ = writeln!(text, "\nresidual of each channel, rms:\n{table}");
        }
        self.residual_text(diagnosis, &mut text);
        self.closed_loop_text(loops, &mut text);
        for table in tables(diagnosis) {
            let _ = writeln!(text, "\n{table}");
        }
        if let Some(left) = &diagnosis.left {
            let [from, to] = left.active;
            let of = match self.train.len() {
                1 => String::new(),
                _ => format!(" of {}", name_of(&self.names, left.record, FITTED)),
            };
            let _ = write!(text, "what is left{of}: half of its energy lies between {from:.3} and {to:.3} s");
            if let Some((name, correlation)) = left.follows {
                let _ = write!(text, "; it follows {name} (correlation {correlation:.2})");
            }
            if let Some((frequency, share)) = left.tone {
                let _ = write!(text, "; {:.0} % of it is a tone at {frequency:.1} Hz", share * 100.0);
            }
            let _ = writeln!(text);
            if let Some(side) = diagnosis.acts {
                let _ = writeln!(text, "it acts {}", side.in_words());
            }
        }
        for warning in result["warnings"].as_array().into_iter().flatten().filter_map(Value::as_str) {
            let _ = writeln!(text, "note: {warning}");
        }
        if let Some(next) = result["next_experiment"].as_str().filter(|next| !next.is_empty()) {
            let _ = writeln!(text, "next: {next}");
        }
        let _ = writeln!(
            text,
            "{:.2} s, effort {:.0} s by steps of the simulation, seed {}",
            result["seconds"].as_f64().unwrap_or(f64::NAN),
            diagnosis.effort_s().ceil(),
            self.common.seed
        );
        text
    }
}

/// The mark of a residual of which the largest is known; blank where there is none.
fn shade(left: Option<f64>, largest: f64) -> char {
    left.map_or(' ', |left| {
        let step = (left / largest * SHADES.len() as f64) as usize;
        char::from(SHADES[step.min(SHADES.len() - 1)])
    })
}

/// The faults and the other free parameters, as far as there are any.
fn tables(diagnosis: &Diagnosis) -> impl Iterator<Item = Table> {
    let row = |before: &Estimate, after: &Estimate| {
        let info = after.parameter.info();
        let q = output::in_digits_of(after);
        let [lower, upper] = after.ci95.map(&q);
        vec![info.name.to_owned(), q(before.value), q(after.value), format!("{lower} to {upper}")]
    };
    let (faults_before, free_before) = diagnosis.before.estimates.split_at(diagnosis.faults.len());
    let after = diagnosis.after_in_words();
    let mut faults = output::table(["fault", "before", after, "95 % interval", "mixed up with"]);
    for (fault, before) in diagnosis.faults.iter().zip(faults_before) {
        let names = diagnosis.names_or(&fault.confounded_with, "-");
        faults.add_row([row(before, &fault.estimate), vec![names]].concat());
    }
    let mut free = output::table(["free parameter", "before", after, "95 % interval"]);
    for (after, before) in diagnosis.free.iter().zip(free_before) {
        free.add_row(row(before, after));
    }
    [faults, free].into_iter().filter(|table| !table.is_empty())
}

#[cfg(test)]
mod tests {
    use super::shade;

    #[test]
    fn more_is_left_where_the_mark_is_darker() {
        let marks = |left: [f64; 5]| left.map(|left| shade(Some(left), 8e-6)).iter().collect::<String>();
        assert_eq!(marks([0.0, 0.9e-6, 1.1e-6, 7.1e-6, 8e-6]), "..:@@");
        assert_eq!(shade(None, 8e-6), ' ');
        // A model that leaves nothing at all.
        assert_eq!(shade(Some(0.0), 0.0), '.');
    }
}
