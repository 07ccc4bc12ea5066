//! `check`: what records are worth, before any fit.

use super::files::Files;
use super::{DEFAULT_RIG, InputOptions, assignments};
use crate::cli::Common;
use crate::failure::Failure;
use crate::inspect::excitation::{SHOWN, grade, grades};
use crate::inspect::{ChannelFacts, Inspection};
use crate::output::{self, SCHEMA, quantity};
use crate::report::{self, REPORT_FILE};
use crate::rig::{Range, Rig};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Name of the result in the directory of `--out`.
const RESULT_FILE: &str = "check.json";

/// Options of `check`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Records (CSV, MAT, Parquet), each looked at alone.
    #[arg(required = true, value_name = "REC")]
    records: Vec<PathBuf>,
    #[command(flatten)]
    input: InputOptions,
    /// Value at which the faults are foreseen, in place of the rig's: `--at fdj=800`.
    #[arg(long = "at", value_delimiter = ',', value_name = "NAME=VALUE")]
    at: Vec<String>,
}

/// Runs the verb.
///
/// # Errors
/// Usage, or a file that is not a record.
pub fn run(common: &Common, options: &Options) -> Result<(), Failure> {
    Files::new(common).reads(&options.records).writes_in_out(&[RESULT_FILE, REPORT_FILE]).check()?;
    let mut rig = super::rig(common, DEFAULT_RIG)?;
    assignments(&mut rig.parameters, &options.at)?;
    let ranges = if rig.faults.is_empty() { rig.free.clone() } else { rig.faults.clone() };
    let records = options.input.read(common, &options.records)?;
    records.iter().try_for_each(|record| super::check_inputs(&rig, record))?;
    let checked: Vec<Inspection> =
        records.into_iter().map(|record| Inspection::new(&rig, &ranges, record)).collect();
    let mut result = json(common, &rig, &ranges, &checked);
    result["config"]["reading"] = options.input.json();
    let saved = output::save_result(common, RESULT_FILE, &result, || {
        report::inspection(&ranges, &checked, &result["config"])
    });
    if common.json {
        output::print_json(&result)?;
    } else {
        checked.iter().try_for_each(|one| print(&ranges, one))?;
        output::print(&format!(
            "host-sim {}; rig {}; seed {}",
            env!("CARGO_PKG_VERSION"),
            rig.name,
            common.seed
        ))?;
    }
    saved
}

fn errors_json(ranges: &[Range], standard_errors: &[f64]) -> Value {
    ranges
        .iter()
        .zip(standard_errors)
        .map(|(range, &error)| {
            let info = range.parameter.info();
            json!({ "name": info.name, "standard_error": output::number(error), "unit": info.unit, "grade": grade(range, error) })
        })
        .collect()
}

fn json(common: &Common, rig: &Rig, ranges: &[Range], checked: &[Inspection]) -> Value {
    let records: Vec<Value> = checked
        .iter()
        .map(|one| {
            let channels: Vec<Value> = one
                .facts
                .channels
                .iter()
                .map(|facts| {
                    let info = facts.channel.info();
                    let [spikes, stuck] = facts.defect_counts();
                    json!({
                        "name": info.column, "unit": info.unit, "range": facts.range, "noise": facts.noise,
                        "quantum": facts.quantum, "missing": facts.missing, "longest_gap_s": facts.longest_gap_s,
                        "spikes": spikes, "stuck": stuck, "new_value_every": facts.new_value_every(),
                        "saturated_share": facts.saturated_share,
                    })
                })
                .collect();
            let promises: Vec<Value> = one
                .promises
                .iter()
                .map(|promise| {
                    json!({
                        "channels": promise.channels.iter().map(|c| c.info().column).collect::<Vec<_>>(),
                        "recorded": promise.recorded,
                        "faults": errors_json(ranges, &promise.standard_errors),
                    })
                })
                .collect();
            let commands: Vec<Value> = one
                .trials
                .iter()
                .map(|trial| {
                    json!({
                        "command": trial.command.name, "amplitude": trial.amplitude,
                        "amplitude_unit": trial.amplitude_unit(), "duration_s": trial.duration_s, "saturated_share": trial.saturated_share,
                        "faults": errors_json(ranges, &trial.standard_errors),
                    })
                })
                .collect();
            json!({
                "record": one.record.name(),
                "samples": one.record.len(),
                "sample_period_s": one.record.sample_period_s(),
                "start_time_s": one.record.start_time_s(),
                "duration_s": one.record.len() as f64 * one.record.sample_period_s(),
                "channels": channels,
                "response": one.facts.response.map(|r| json!({ "delay_s": r.delay_s, "correlation": r.correlation })),
                "motion": {
                    "travel_m": one.facts.motion.travel_m, "top_speed_m_s": one.facts.motion.top_speed_m_s,
                    "reversals": one.facts.motion.reversals, "rest_share": one.facts.motion.rest_share,
                },
                "foreseen": promises,
                "commands": commands,
                "best_command_gain": one.best_gain.filter(|gain| gain.is_finite()),
                "notes": one.facts.notes,
            })
        })
        .collect();
    let names: Vec<String> = checked.iter().map(|one| one.record.name().to_owned()).collect();
    json!({
        "schema": SCHEMA, "records": records, "seed": common.seed,
        "config": output::config_json(common, rig, ranges, &names),
    })
}

fn print(ranges: &[Range], one: &Inspection) -> Result<(), Failure> {
    let (record, facts) = (&one.record, &one.facts);
    output::print(&format!(
        "{}: {} samples, {} Hz, {:.3} s from {} s",
        record.name(),
        record.len(),
        (1.0 / record.sample_period_s() * 1e3).round() / 1e3,
        record.len() as f64 * record.sample_period_s(),
        record.start_time_s()
    ))?;
    let mut table = output::table(ChannelFacts::COLUMNS);
    for channel in &facts.channels {
        table.add_row(channel.cells(quantity));
    }
    output::print(&table.to_string())?;
    let delay = facts.response.map_or_else(
        || "-".to_owned(),
        |response| format!("{:.1} ms (correlation {:.3})", response.delay_s * 1e3, response.correlation),
    );
    output::print(&format!("response behind the command: {delay}; {}", facts.motion.in_words(quantity)))?;
    for note in &facts.notes {
        output::print(&format!("note: {note}"))?;
    }
    if one.promises.is_empty() {
        return output::print(&format!("next: {}\n", one.advice()));
    }
    output::print("\nforeseen standard errors, from the model's sensitivities:")?;
    let mut header = vec!["channels".to_owned(), "recorded".to_owned()];
    for range in ranges {
        header.extend([range.parameter.info().name.to_owned(), "interval".to_owned()]);
    }
    let row = |start: Vec<String>, standard_errors: &[f64]| -> Vec<String> {
        let errors = ranges.iter().zip(standard_errors).flat_map(|(range, &error)| {
            [quantity(error, range.parameter.info().unit), grade(range, error).to_owned()]
        });
        start.into_iter().chain(errors).collect()
    };
    let mut table = output::table(&header);
    for promise in &one.promises {
        let names: Vec<&str> = promise.channels.iter().map(|channel| channel.info().column).collect();
        let recorded = if promise.recorded { "yes" } else { "no" };
        table.add_row(row(vec![names.join(" + "), recorded.to_owned()], &promise.standard_errors));
    }
    output::print(&format!("{table}\n{}", grades()))?;
    if one.trials.is_empty() {
        return Ok(());
    }
    output::print(
        "\neach built-in command, repeated to this record's length, with its channels, best first:",
    )?;
    header.splice(0..2, ["command".to_owned(), "amplitude".to_owned(), "current at its limit".to_owned()]);
    let mut table = output::table(&header);
    for trial in one.trials.iter().take(SHOWN) {
        let limit = format!("{:.1} %", trial.saturated_share * 100.0);
        table.add_row(row(
            vec![trial.command.name.to_owned(), trial.amplitude_text(), limit],
            &trial.standard_errors,
        ));
    }
    output::print(&table.to_string())?;
    output::print(&format!("next: {}\n", one.advice()))
}
