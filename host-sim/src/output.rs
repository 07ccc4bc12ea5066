//! Results to stdout, log and progress to stderr, files whole or not at all.

use crate::cli::Common;
use crate::diagnose::progress::Stage;
use crate::failure::Failure;
use crate::fit::{Estimate, Fit, NoiseSource, Prepared, Standing};
use crate::record::{Record, write_csv};
use crate::report::REPORT_FILE;
use crate::rig::{self, CommandPath, Range, Rig};
use crate::table_file::{self, TableKind};
use crate::whole_file;
use comfy_table::{CellAlignment, ContentArrangement, Table, presets};
use eha_monitor::channel::Channel;
use eha_monitor::effect::{EFFECTS, EffectInfo};
use eha_monitor::fit::identify::StopReason;
use eha_monitor::parameter::ParameterInfo;
use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use serde_json::{Map, Value, json};
use std::io::Write;
use std::iter;
use std::path::{Path, PathBuf};

/// Version of the JSON results.
pub const SCHEMA: u32 = 1;

/// Most decimals of a value that is known well.
const MOST_DECIMALS: f64 = 9.0;

/// Writes a line to stdout. Nobody listens at a closed pipe: that is no failure.
///
/// # Errors
/// Stdout cannot be written.
pub fn print(text: &str) -> Result<(), Failure> {
    match writeln!(std::io::stdout(), "{text}") {
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        result => result.map_err(Failure::other),
    }
}

/// Prints one JSON object.
///
/// # Errors
/// Stdout cannot be written.
pub fn print_json(value: &Value) -> Result<(), Failure> {
    print(&serde_json::to_string_pretty(value).map_err(Failure::other)?)
}

/// Style of the word `warning` on a terminal.
const WARNING: anstyle::Style =
    anstyle::Style::new().bold().fg_color(Some(anstyle::Color::Ansi(anstyle::AnsiColor::Yellow)));

/// Logs a line to stderr unless the user asked for quiet.
pub fn log(common: &Common, line: &str) {
    if !common.quiet {
        match line.split_once("warning: ") {
            Some(("", rest)) => anstream::eprintln!("{WARNING}warning:{WARNING:#} {rest}"),
            _ => anstream::eprintln!("{line}"),
        }
    }
}

/// An empty table; columns from the second on are aligned to the right.
pub fn table<Header: AsRef<[Name]>, Name: ToString>(header: Header) -> Table {
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN).set_content_arrangement(ContentArrangement::Disabled);
    table.set_header(header.as_ref().iter().map(Name::to_string));
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
}

/// What a bar tells of time.
#[derive(Clone, Copy)]
pub enum Time {
    /// How much is left, of steps that take about as long as each other.
    Left,
    /// How much has gone by, where nobody knows what will have to be done.
    Gone,
}

/// A bar that counts steps; drawn on a terminal only.
pub fn bar(common: &Common, length: u64, what: &str, time: Time) -> ProgressBar {
    let target = if common.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(length), target);
    let style = ProgressStyle::with_template("{prefix} {bar:16} {pos}/{len}{time} {wide_msg}");
    let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
    // Before the first step nobody knows what is left.
    bar.set_style(style.with_key("time", move |state: &ProgressState, text: &mut dyn std::fmt::Write| {
        let _ = match time {
            Time::Left if state.pos() == 0 => Ok(()),
            Time::Left => write!(text, ", {} left:", HumanDuration(state.eta())),
            Time::Gone => write!(text, " after {}:", HumanDuration(state.elapsed())),
        };
    }));
    bar.set_prefix(what.to_owned());
    bar
}

/// Shows where a fit stands.
pub fn show_standing(bar: &ProgressBar, standing: Standing) {
    bar.set_length(u64::from(standing.budget));
    bar.set_position(u64::from(standing.evaluations.min(standing.budget)));
    bar.set_message(format!(
        "generation {}, best {:.3} times the noise",
        standing.generations, standing.best_sigma
    ));
}

/// Shows where a diagnosis stands.
pub fn show_stage(bar: &ProgressBar, stage: &Stage) {
    bar.set_position((stage.share * 100.0) as u64);
    let [done, of] = stage.fits;
    let counted = if of > 0 { format!(", {done} of {of}") } else { String::new() };
    let best = stage.best_sigma;
    let best = if best.is_finite() { format!("; best {best:.3} times the noise") } else { String::new() };
    bar.set_message(format!("{}{counted}{best}", stage.doing));
}

/// What is said of records whose commands come a sample late.
pub const LATE_COMMAND: &str =
    "with the command one sample earlier, only noise is left: was it recorded a sample late?";

/// Writes a file whole or not at all.
///
/// # Errors
/// The directory or the file cannot be written.
pub fn write_file(path: &Path, content: &[u8]) -> Result<(), Failure> {
    let fail = |error: std::io::Error| cannot_write(path, &error);
    path.parent().map_or(Ok(()), std::fs::create_dir_all).map_err(fail)?;
    whole_file::save(path, |out| out.write_all(content)).map_err(fail)
}

/// A file that cannot be written.
pub(crate) fn cannot_write(path: &Path, error: &std::io::Error) -> Failure {
    Failure::other(format!("cannot write {}: {error}", path.display()))
}

/// Writes a result as JSON and its report into the output directory, if there is one; `report` is not called otherwise.
///
/// # Errors
/// A file cannot be written.
pub fn save_result(
    common: &Common,
    name: &str,
    result: &Value,
    report: impl FnOnce() -> String,
) -> Result<(), Failure> {
    save(common, name, || serde_json::to_string_pretty(result).map_err(Failure::other))?;
    save(common, REPORT_FILE, || Ok(report()))
}

/// Writes a text into the output directory, if there is one; `text` is not called otherwise.
///
/// # Errors
/// The file cannot be written, or `text` fails.
pub fn save(
    common: &Common,
    name: &str,
    text: impl FnOnce() -> Result<String, Failure>,
) -> Result<(), Failure> {
    let Some(path) = out_path(common, name) else { return Ok(()) };
    write_file(&path, text()?.as_bytes())?;
    log(common, &format!("wrote {}", path.display()));
    Ok(())
}

/// Where a verb writes the record that it makes: to the user's file, else into the output directory, else to stdout,
/// which is `-` as well.
pub fn record_path(common: &Common, path: Option<&Path>) -> Option<PathBuf> {
    match path {
        Some(path) => Some(path.to_path_buf()).filter(|path| path.as_os_str() != "-"),
        None => out_path(common, "record.csv"),
    }
}

/// Writes a record that a verb made: to `path`, else to stdout. With `--json`, stdout gets one object: where the record
/// is, or its columns (null for a missing sample), and the configuration.
///
/// # Errors
/// The file or stdout cannot be written.
pub fn record(
    common: &Common,
    record: &Record,
    comments: &[String],
    path: Option<&Path>,
    mut config: Value,
) -> Result<(), Failure> {
    let csv = || {
        let mut text = Vec::new();
        write_csv(record, comments, &mut text).map_err(Failure::other).map(|()| text)
    };
    if let Some(path) = path {
        let bytes = if TableKind::of(path) == Some(TableKind::Parquet) {
            let times: Vec<f64> = (0..record.len()).map(|sample| record.time_s(sample)).collect();
            let channels = record.channels().map(|(channel, values)| (channel.info().column, values));
            let columns: Vec<_> =
                iter::once((Channel::Time.info().column, &times[..])).chain(channels).collect();
            table_file::parquet(&columns, comments).map_err(Failure::other)?
        } else {
            csv()?
        };
        write_file(path, &bytes)?;
        log(common, &format!("wrote {} samples to {}", record.len(), path.display()));
    } else if !common.json {
        return print(String::from_utf8_lossy(&csv()?).trim_end());
    }
    if !common.json {
        return Ok(());
    }
    config["version"] = json!(env!("CARGO_PKG_VERSION"));
    let mut result = json!({
        "schema": SCHEMA,
        "samples": record.len(),
        "sample_period_s": record.sample_period_s(),
        "start_time_s": record.start_time_s(),
        "seed": common.seed,
        "config": config,
    });
    if let Some(path) = path {
        result["file"] = json!(path.display().to_string());
    } else {
        let columns = record.channels().map(|(channel, values)| {
            (channel.info().column.to_owned(), values.iter().map(|&value| number(value)).collect())
        });
        result["columns"] = Value::Object(columns.collect());
    }
    print_json(&result)
}

/// Path of a file in the output directory, if there is one.
pub fn out_path(common: &Common, name: &str) -> Option<PathBuf> {
    common.out.as_ref().map(|directory| directory.join(name))
}

/// A number of things, in words.
pub fn counted(count: usize, thing: &str) -> String {
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

/// Three or more significant digits with a unit that reads well: metres as mm or um, from 1 mm on.
pub fn quantity(value: f64, unit: &str) -> String {
    known_to(value, unit, f64::INFINITY)
}

/// The same, with as many digits as it takes to show two of an error of the value.
fn known_to(value: f64, unit: &str, error: f64) -> String {
    if !value.is_finite() {
        return "-".to_owned();
    }
    let magnitude = value.abs();
    let decimals = |least: usize, scale: f64| {
        let place = (error * scale).log10().floor();
        if place.is_finite() { least.max((1.0 - place).clamp(0.0, MOST_DECIMALS) as usize) } else { least }
    };
    let fixed = |least, scale, unit| format!("{:.*}{unit}", decimals(least, scale), value * scale);
    match unit {
        "m" if magnitude >= 1e-2 => fixed(3, 1e3, " mm"),
        "m" if magnitude >= 1e-3 => fixed(4, 1e3, " mm"),
        "m" => fixed(3, 1e6, " um"),
        "1" => fixed(4, 1.0, ""),
        _ if value != 0.0 && !(1e-2..1e6).contains(&magnitude) => {
            format!("{value:.*e} {unit}", decimals(4, 1.0 / 10_f64.powf(magnitude.log10().floor())))
        }
        _ => format!("{} {unit}", fixed(if value != 0.0 && magnitude < 0.1 { 4 } else { 3 }, 1.0, "")),
    }
}

/// Values of an estimate's parameter in words, with as many digits as its standard error asks for.
pub fn in_digits_of(estimate: &Estimate) -> impl Fn(f64) -> String {
    let (unit, error) = (estimate.parameter.info().unit, estimate.standard_error);
    move |value| known_to(value, unit, error)
}

/// A number in full, with an exponent where it is very large or very small.
pub fn plain(value: f64) -> String {
    if value != 0.0 && !(1e-6..=1e7).contains(&value.abs()) {
        format!("{value:e}")
    } else {
        value.to_string()
    }
}

/// The range in which values of a parameter make sense.
pub fn own_range(info: &ParameterInfo) -> String {
    let unit = if info.unit == "1" { String::new() } else { format!(" {}", info.unit) };
    format!("{} to {}{unit}", plain(info.lower), plain(info.upper))
}

/// A number for JSON: null where it is not finite.
pub fn number(value: f64) -> Value {
    if value.is_finite() { json!(value) } else { Value::Null }
}

/// An estimate as JSON.
pub fn estimate_json(estimate: &Estimate) -> Value {
    let info = estimate.parameter.info();
    json!({
        "name": info.name,
        "value": number(estimate.value),
        "standard_error": number(estimate.standard_error),
        "ci95": [number(estimate.ci95[0]), number(estimate.ci95[1])],
        "unit": info.unit,
    })
}

/// Estimates as a table.
pub fn estimate_table(fit: &Fit) -> Table {
    let mut table = table(["parameter", "symbol", "value", "95 % interval", "standard error"]);
    for estimate in &fit.estimates {
        let info = estimate.parameter.info();
        let q = in_digits_of(estimate);
        table.add_row([
            info.name.to_owned(),
            info.symbol.to_owned(),
            q(estimate.value),
            format!("{} to {}", q(estimate.ci95[0]), q(estimate.ci95[1])),
            q(estimate.standard_error),
        ]);
    }
    table
}

/// Residual and noise of each channel as a table.
pub fn residual_table(fit: &Fit, source: &[NoiseSource]) -> Table {
    let mut table = table(["channel", "residual rms", "noise", "noise from"]);
    for (index, channel) in Channel::MEASURED.into_iter().enumerate() {
        let (Some(rms), info) = (fit.residual_rms[index], channel.info()) else { continue };
        table.add_row([
            info.column.to_owned(),
            quantity(rms, info.unit),
            quantity(fit.noise[index], info.unit),
            source[index].name().to_owned(),
        ]);
    }
    table
}

/// The same in a result, with how many samples of each channel were compared.
pub fn channels_json(fit: &Fit, source: &[NoiseSource], records: &[Prepared]) -> Value {
    let row = |(index, channel): (usize, Channel)| {
        let (rms, info) = (fit.residual_rms[index]?, channel.info());
        let samples: usize = records.iter().map(|record| record.compared(index)).sum();
        Some(json!({
            "name": info.column,
            "unit": info.unit,
            "samples": samples,
            "residual_rms": number(rms),
            "noise": number(fit.noise[index]),
            "noise_from": source[index].name(),
        }))
    };
    Channel::MEASURED.into_iter().enumerate().filter_map(row).collect()
}

/// Why a search ended, in words.
fn stop_words(stop: StopReason) -> &'static str {
    match stop {
        StopReason::NoiseReached => "noise-reached",
        StopReason::Settled => "settled",
        StopReason::Budget => "budget",
    }
}

/// Why a fit ended, in words.
pub fn end_words(fit: &Fit) -> &'static str {
    if fit.interrupted { "interrupted" } else { stop_words(fit.stop) }
}

/// Strong correlations of the estimates, in words.
pub fn correlation_warnings(fit: &Fit) -> Vec<String> {
    let mut warnings = Vec::new();
    let correlation = fit.correlation().matrix;
    for (row, first) in fit.estimates.iter().enumerate() {
        for (column, second) in fit.estimates.iter().enumerate().take(row) {
            let correlation = correlation[row][column];
            if correlation.abs() > 0.95 {
                warnings.push(format!(
                    "{} and {} are strongly correlated ({correlation:.3}): these records hardly separate them",
                    second.parameter.info().name,
                    first.parameter.info().name
                ));
            }
        }
    }
    warnings
}

/// Part of the catalogue from which on effects are not listed one by one.
const NEARLY_EVERY: f64 = 0.75;

/// Names of effects, for people; nearly all of them are no list.
pub fn effects_in_words(effects: &[&'static EffectInfo]) -> String {
    if effects.len() as f64 > NEARLY_EVERY * EFFECTS.len() as f64 {
        return "nearly every effect".to_owned();
    }
    effects.iter().map(|effect| effect.name).collect::<Vec<_>>().join(", ")
}

/// Said where another reading of the records does as well.
pub const OPEN_READING: &str = "these records do not tell how the command goes from sample to sample, or when the spool \
    sticks: the intervals hold every answer";

/// What the user should know of how records were read. Where they are not explained, the reading is the one in which least is
/// left, which makes it no fact.
pub fn reading_notes(rig: &Rig, is_explained: bool) -> Vec<String> {
    let command = match rig.command_path {
        CommandPath::Open | CommandPath::Lines => None,
        CommandPath::Curve => Some("goes from sample to sample on a curve, not in straight lines"),
        CommandPath::Held => Some(
            "keeps the value of a sample until the next one; a sensor that is half a sample late looks nearly the same to the \
             position alone",
        ),
    };
    let spool = rig.has_sticking_spool().then_some(
        "the spool sticks as soon as its driving force is below the breakaway friction, not only when it has fallen to the \
         sliding friction: no fault, but how its friction works",
    );
    let read =
        if is_explained { "the records are read so" } else { "least is left where the records are read so" };
    let command = command.map(|how| format!("the command {how}"));
    command.into_iter().chain(spool.map(str::to_owned)).map(|how| format!("{read}: {how}")).collect()
}

/// The configuration that a result was made with, resolved.
pub fn config_json(common: &Common, rig: &Rig, ranges: &[Range], records: &[String]) -> Value {
    let parameters: Map<String, Value> = rig
        .changed()
        .into_iter()
        .map(|(parameter, value)| (parameter.info().name.to_owned(), json!(value)))
        .collect();
    let (valve, feedback, drive) = rig::spelled(rig.form);
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "seed": common.seed,
        "rig": rig.name,
        "model": {
            "valve": valve,
            "feedback": feedback,
            "drive": drive,
            "command_path": rig.command_path,
            "command_offset": rig.command_offset,
            "drive_holds": rig.drive_holds,
            "restart_s": rig.restart_s,
        },
        "controller": rig.controller.map(|law| json!({
            "position_gain": law.position_gain, "velocity_gain": law.velocity_gain, "limit": law.limit,
            "force_gain": law.force_gain,
        })),
        "noise": rig.noise.iter().map(|(channel, noise)| (channel.info().column.to_owned(), json!(noise))).collect::<Map<_, _>>(),
        "parameters": parameters,
        "calibration": iter::zip(&rig.calibration.parameters, &rig.calibration.standard_errors)
            .map(|(parameter, error)| (parameter.info().name.to_owned(), json!(error)))
            .collect::<Map<_, _>>(),
        "effects": rig.effects.iter().map(|effect| effect.name).collect::<Vec<_>>(),
        "free": ranges.iter().map(|range| json!({
            "name": range.parameter.info().name, "lower": range.lower, "upper": range.upper,
        })).collect::<Vec<_>>(),
        "records": records,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_number_is_a_row_of_zeros() {
        for (value, text) in [
            (0.0, "0"),
            (-1e7, "-10000000"),
            (2.5e7, "2.5e7"),
            (1e300, "1e300"),
            (1e-6, "0.000001"),
            (1e-13, "1e-13"),
            (f64::INFINITY, "inf"),
        ] {
            assert_eq!(plain(value), text);
        }
    }

    #[test]
    fn lengths_have_one_scale_for_each_size() {
        for (metres, text) in [
            (0.012_696_835, "12.697 mm"),
            (-0.0015, "-1.5000 mm"),
            (1e-3, "1.0000 mm"),
            (0.9994e-3, "999.400 um"),
            (0.0, "0.000 um"),
        ] {
            assert_eq!(quantity(metres, "m"), text);
        }
    }

    #[test]
    fn what_is_known_well_is_shown_to_two_digits_of_its_error() {
        for (value, unit, error, text) in [
            (1.2e-2, "N/mA", 3e-7, "0.01200000 N/mA"),
            (0.25, "m2/s", 4e-4, "0.25000 m2/s"),
            (2e-4, "m", 3.4e-7, "200.000 um"),
            (2e-4, "m", 3.4e-10, "200.00000 um"),
            (1.5e11, "Pa/m", 2e5, "1.5000000e11 Pa/m"),
            (800.0, "N", 0.0, "800.000 N"),
            (800.0, "N", f64::NAN, "800.000 N"),
            (0.5, "1", 1e-20, "0.500000000"),
        ] {
            assert_eq!(known_to(value, unit, error), text);
        }
    }
}
