//! `identify`: the declared faults from records.

use super::printouts::{self, Truth};
use super::{DEFAULT_RIG, FitOptions, Fitted, converged, fit_records, save_trace};
use crate::cli::Common;
use crate::failure::Failure;
use crate::fit::measured::USER;
use crate::fit::{self, Bounds, Fit, LoopScore, Prepared};
use crate::output::{self, SCHEMA, counted, quantity};
use crate::report::{self, Identified, REPORT_FILE};
use crate::rig::Range;
use crate::trace::Trace;
use eha_monitor::channel::Channel;
use eha_monitor::fit::identify::within_noise;
use eha_monitor::fit::problem::Offset;
use serde_json::{Value, json};

/// Name of the result in the directory of `--out`.
const RESULT_FILE: &str = "identify.json";

/// Part of a sum of squares that is most of it.
const MOSTLY: f64 = 0.5;

/// Options of `identify`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    fit: FitOptions,
    /// True values, where they are known, for the source's fault-parameter check: `bkl=2e-4,fdj=800`.
    #[arg(long, value_delimiter = ',', value_name = "NAME=VALUE")]
    truth: Vec<String>,
    /// Print the log of the search: a line for each generation, costs in units of the noise.
    #[arg(long)]
    log: bool,
}

/// Runs the verb.
///
/// # Errors
/// Usage, bad data, or no convergence.
pub fn run(common: &Common, options: &Options) -> Result<(), Failure> {
    let truth = Truth::parse(&options.truth)?;
    let writes = [RESULT_FILE, REPORT_FILE];
    let fitted = fit_records(common, &options.fit, DEFAULT_RIG, &writes, |rig| rig.faults.clone())?;
    let mut result = json(common, &fitted, "faults");
    truth.add_to(&fitted.fit, &mut result);
    let saved = save(common, &fitted, &result, RESULT_FILE, "Identification");
    if common.json {
        output::print_json(&result)?;
    } else {
        if options.log {
            output::print(&printouts::log(&fitted.fit, fitted.population).to_string())?;
        }
        print(common, &fitted)?;
        truth.print(&fitted.fit)?;
    }
    saved?;
    converged(&fitted)
}

/// Writes the trace, and the result as JSON and as a report, if there is a place for them.
pub(super) fn save(
    common: &Common,
    fitted: &Fitted,
    result: &Value,
    file: &str,
    title: &str,
) -> Result<(), Failure> {
    save_trace(common, fitted.trace.as_deref(), || {
        Trace::new(&fitted.records, &fitted.prepared, &[("model", &fitted.fit.predictions)])
    })?;
    output::save_result(common, file, result, || {
        report::identification(&Identified {
            title,
            rig: &fitted.rig,
            ranges: &fitted.ranges,
            records: &fitted.records,
            names: &fitted.names,
            prepared: &fitted.prepared,
            fit: &fitted.fit,
            noise_source: &fitted.noise_source,
            population: fitted.population,
            warnings: &notes(fitted),
            config: &result["config"],
        })
    })
}

/// Errors of the fitted model in closed loop and over open windows, where the controller is known.
fn loop_score(fitted: &Fitted) -> Option<LoopScore> {
    let rig = fitted.fit.applied(&fitted.rig);
    fit::loop_score(&rig, &fitted.records)
}

/// What the user should know of a fit.
fn notes(fitted: &Fitted) -> Vec<String> {
    let fit = &fitted.fit;
    let mut notes = fitted.record_notes.clone();
    notes.extend(fit::remarks(&fit.estimates, &fitted.ranges, Bounds::Option));
    notes.extend(output::correlation_warnings(fit));
    notes.extend(output::reading_notes(&fitted.rig, within_noise(&fit.misfit)));
    notes.extend(held_in_words(fitted));
    if !fitted.rig.calibration.beside(&fitted.ranges).is_empty() {
        notes.push("the intervals hold what the calibration of the rig leaves open, too".to_owned());
    }
    if fitted.reading_open {
        notes.push(output::OPEN_READING.to_owned());
    }
    if fit.interrupted {
        notes.push("interrupted: this is what was found so far, not the bottom of the search".to_owned());
    }
    if let Some(excess) = excess_in_words(fit) {
        notes.push(excess);
        notes.extend(constant_in_words(fitted));
    }
    notes
}

/// The faults that are not fitted, as in a calibration, and their values; none where all are.
fn held_in_words(fitted: &Fitted) -> Option<String> {
    let is_held = |fault: &&Range| fitted.ranges.iter().all(|range| range.parameter != fault.parameter);
    let held: Vec<String> = fitted
        .rig
        .faults
        .iter()
        .filter(is_held)
        .map(|fault| {
            let info = fault.parameter.info();
            format!("{} at {}", info.name, quantity(fitted.rig.parameters.get(fault.parameter), info.unit))
        })
        .collect();
    (!held.is_empty()).then(|| {
        format!(
            "held: {}; where the machine has another value, the others make up for it: `--bounds NAME=LOW..HIGH` fits it too",
            held.join(", ")
        )
    })
}

/// That a fit leaves more than noise, and of which channel the most; none where chance may leave as much.
fn excess_in_words(fit: &Fit) -> Option<String> {
    if within_noise(&fit.misfit) {
        return None;
    }
    let times = |channel: usize| fit.residual_rms[channel].map(|left| left / fit.noise[channel]);
    let (channel, most) = (0..fit.noise.len())
        .filter_map(|channel| Some((channel, times(channel).filter(|times| times.is_finite())?)))
        .max_by(|(_, one), (_, other)| one.total_cmp(other))?;
    Some(format!(
        "the residual is {:.2} times the noise, that of {} {most:.2} times: more than chance leaves of {} values, so the \
         model lacks something, and the intervals do not hold what it does to the values; `diagnose` looks for it",
        fit.misfit.mean_square().sqrt(),
        Channel::MEASURED[channel].info().column,
        fit.misfit.count
    ))
}

/// That a constant is most of what a fit leaves of the user position: command and sensor may have zeros of their own.
fn constant_in_words(fitted: &Fitted) -> Option<String> {
    let records: Vec<_> = fitted.prepared.iter().map(Prepared::as_core).collect();
    let left = fit::residual_series(&records, &fitted.fit.predictions, USER);
    let (mut constant, mut squares, mut largest) = (0.0, 0.0, 0.0_f64);
    for series in left.iter().map(|series| fit::present(series)) {
        let mut offset = Offset::NONE;
        for value in series {
            offset.add(value);
            squares += value * value;
        }
        constant += offset.square();
        let mean = offset.mean();
        largest = if mean.abs() > largest.abs() { mean } else { largest };
    }
    (!fitted.rig.command_offset && constant > MOSTLY * squares).then(|| {
        format!(
            "most of what is left of lvdt_m is a constant, {}: where command and sensor have zeros of their own, say \
             `command-offset = true` in the rig",
            quantity(largest, "m")
        )
    })
}

/// The result as JSON; `list` names the list of estimates.
pub(super) fn json(common: &Common, fitted: &Fitted, list: &str) -> Value {
    let fit = &fitted.fit;
    let mut result = json!({
        "schema": SCHEMA,
        "residual_rms_m": output::number(fit.position_rms()),
        "channels": output::channels_json(fit, &fitted.noise_source, &fitted.prepared),
        "evaluations": fit.evaluations,
        "generations": fit.generations,
        "seconds": fit.seconds,
        "seconds_per_generation": fit.seconds_per_generation,
        "stop": output::end_words(fit),
        "mean_square": output::number(fit.misfit.mean_square()),
        "correlation": fit.correlation().json(),
        "warnings": notes(fitted),
        "seed": common.seed,
        "closed_loop": loop_score(fitted).map(|score| json!({
            "force_error": output::number(score.force_error),
            "open_loop_rms_m": score.open_loop_rms.map(output::number),
        })),
        "config": output::config_json(common, &fitted.rig, &fitted.ranges, &fitted.names),
    });
    result["config"]["reading"] = fitted.reading.clone();
    result["config"]["search"] = fitted.search.clone();
    result[list] = fit.estimates.iter().map(output::estimate_json).collect();
    result
}

/// The result as tables.
pub(super) fn print(common: &Common, fitted: &Fitted) -> Result<(), Failure> {
    let fit = &fitted.fit;
    output::print(&format!("{}\n", output::estimate_table(fit)))?;
    output::print(&output::residual_table(fit, &fitted.noise_source).to_string())?;
    output::print(&format!(
        "{} samples in {}; {}, {}, {:.2} ms a generation, {:.3} s in all; {}; seed {}",
        fitted.prepared.iter().map(Prepared::len).sum::<usize>(),
        counted(fitted.prepared.len(), "record"),
        counted(fit.evaluations as usize, "evaluation"),
        counted(fit.generations as usize, "generation"),
        fit.seconds_per_generation * 1e3,
        fit.seconds,
        output::end_words(fit),
        common.seed,
    ))?;
    if let Some(score) = loop_score(fitted) {
        let open = score.open_loop_rms.zip(fitted.rig.restart_s).map_or(String::new(), |(rms, seconds)| {
            format!("; open loop over {seconds} s: {} rms", quantity(rms, "m"))
        });
        let error = score.force_error * 1e2;
        output::print(&format!("force in closed loop: {error:.2} % of the recorded one is missed{open}"))?;
    }
    output::print(&configuration(fitted))?;
    notes(fitted).iter().try_for_each(|note| output::print(&format!("note: {note}")))
}

/// The resolved configuration in a line.
fn configuration(fitted: &Fitted) -> String {
    let ranges: Vec<String> = fitted
        .ranges
        .iter()
        .map(|range| {
            let info = range.parameter.info();
            format!(
                "{} {} to {}",
                info.name,
                quantity(range.lower, info.unit),
                quantity(range.upper, info.unit)
            )
        })
        .collect();
    format!("host-sim {}; rig {}; free {}", env!("CARGO_PKG_VERSION"), fitted.rig.name, ranges.join(", "))
}
