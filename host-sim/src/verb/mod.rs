//! The verbs of the program, one file each.

mod assignment;
pub mod budget;
pub mod calibrate;
pub mod check;
pub mod demo;
pub mod diagnose;
mod diagnosis_text;
mod files;
mod findings;
pub mod hil;
pub mod identify;
pub mod import;
pub mod lists;
mod printouts;
pub mod reproduce;
pub mod shell;
pub mod simulate;

use crate::cli::Common;
use crate::failure::Failure;
use crate::fit::{self, AsRead, Fit, FitSettings, NoiseSource, Prepared, Reading};
use crate::inspect::screen::{Screened, screen};
use crate::inspect::setup;
use crate::interrupt;
use crate::output::{self, Time, plain};
use crate::record::{self, Loaded, Mapping, Problem, ReadOptions, Record, RecordError};
use crate::rig::{BUILT_IN, Range, Rig};
use crate::table_file::table_path;
use crate::trace::{TRACE_FILE, Trace};
use assignment::Assignment;
use clap::Args;
use eha_monitor::channel::Channel;
use eha_monitor::fit::identify::StopReason;
use eha_monitor::model::Drive;
use eha_monitor::model::sensor::Lvdt;
use eha_monitor::parameter::{Parameter, Parameters};
use files::{Files, common_samples};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// How the files of records are read.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Reading records")]
pub struct InputOptions {
    /// Which column or variable is which channel, in which unit: `lvdt_m=pos[mm],command_m=ref[mm]`; of an array in a MAT
    /// file, `lvdt_m=data(:,2)[mm]`.
    #[arg(long, value_name = "CHANNEL=NAME[UNIT],...")]
    columns: Vec<String>,
    /// Sampling rate, Hz, where a file has no time, or stamps that jitter, or rows that were lost.
    #[arg(long, value_name = "HZ", allow_hyphen_values = true)]
    rate: Option<f64>,
    /// First time to keep, s.
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    from: Option<f64>,
    /// Time from which on nothing is kept, s.
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    to: Option<f64>,
}

impl InputOptions {
    /// Reads records (CSV, MAT v5 and v7.3, Parquet), logging their warnings.
    ///
    /// # Errors
    /// Usage: a wrong mapping, rate or window. Data: a file is not a record.
    fn load(&self, common: &Common, paths: &[PathBuf]) -> Result<Vec<Loaded>, Failure> {
        if let Some(rate) = self.rate.filter(|rate| !(rate.is_finite() && *rate > 0.0)) {
            return Err(Failure::usage(format!("--rate {rate}: expected a positive number")));
        }
        if let (Some(from), Some(to)) = (self.from, self.to)
            && (from.is_nan() || to.is_nan() || from >= to)
        {
            return Err(Failure::usage(format!("--from {from} --to {to}: expected the first to be earlier")));
        }
        let columns = Mapping::parse(self.entries()).map_err(Failure::usage)?;
        paths
            .iter()
            .map(|path| {
                let (path, own) = segment(path)?;
                let [from_s, to_s] = own.unwrap_or([self.from, self.to]);
                let options = ReadOptions {
                    columns: columns.clone(),
                    sample_rate_hz: self.rate,
                    from_s,
                    to_s,
                    ..ReadOptions::default()
                };
                let loaded = record::read(&path, &options)?;
                log_warnings(common, &loaded.warnings);
                Ok(loaded)
            })
            .collect()
    }

    /// What is said of columns, one channel each.
    fn entries(&self) -> impl Iterator<Item = &str> {
        self.columns.iter().flat_map(|list| Mapping::split(list))
    }

    /// These options as JSON, for the configuration of a result.
    fn json(&self) -> Value {
        json!({ "columns": self.entries().collect::<Vec<_>>(), "rate_Hz": self.rate, "from_s": self.from, "to_s": self.to })
    }

    /// The records alone, as they are.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    fn read(&self, common: &Common, paths: &[PathBuf]) -> Result<Vec<Record>, Failure> {
        Ok(self.load(common, paths)?.into_iter().map(|loaded| loaded.record).collect())
    }

    /// The records as a fit takes them, what is wrong with their samples left out; and what the user should know of
    /// them.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    fn read_for_fit(
        &self,
        common: &Common,
        paths: &[PathBuf],
        rig: &Rig,
    ) -> Result<(Vec<Record>, Vec<String>), Failure> {
        let mut all_notes = Vec::new();
        let mut records = Vec::new();
        for Loaded { record, warnings } in self.load(common, paths)? {
            check_inputs(rig, &record)?;
            let Screened { record, mut notes, .. } = screen(rig, &record);
            let of_setup = setup::remarks(rig, &record);
            notes.extend(of_setup.iter().map(|remark| format!("{}: {remark}", record.name())));
            log_warnings(common, &notes);
            records.push(record);
            all_notes.extend(warnings);
            all_notes.extend(notes);
        }
        Ok((records, all_notes))
    }
}

/// Refuses a sensor's delay that the model cannot hold.
fn check_delay(rig: &Rig, sample_period: f64) -> Result<(), Failure> {
    let (delay, longest) = (rig.parameters.sensor_delay, Lvdt::longest_delay(sample_period));
    if delay > longest {
        return Err(Failure::usage(format!(
            "`sensor_delay` = {delay}: expected at most {longest} s with a sample every {sample_period} s"
        )));
    }
    Ok(())
}

/// Refuses a record that lacks what drives a rig, or whose sampling does not suit it.
fn check_inputs(rig: &Rig, record: &Record) -> Result<(), Failure> {
    check_delay(rig, record.sample_period_s())?;
    let is_driven = rig.form.drive == Drive::Valve || rig.controller.is_some();
    if is_driven || record.channel(Channel::Drive).is_some() {
        return Ok(());
    }
    let columns = record.channels().map(|(channel, _)| channel.info().column.to_owned());
    let problem = Problem::Missing {
        expected: vec![Channel::Drive.info().column.to_owned()],
        present: columns.collect(),
        hint: Some(format!(
            "the rig `{}` is driven by a force, and has no [controller] that gives it",
            rig.name
        )),
    };
    Err(RecordError::new(record.name(), problem).into())
}

fn log_warnings(common: &Common, warnings: &[String]) {
    for warning in warnings {
        output::log(common, &format!("warning: {warning}"));
    }
}

/// First and last time of a segment, s; none: the record's own.
type Segment = [Option<f64>; 2];

/// A path and the segment of its record that is meant, in s: `axis.csv@0..12.4`, `axis.csv@12.4..`; none where the path
/// has none, and where a file has the whole text as its name.
fn segment(path: &Path) -> Result<(PathBuf, Option<Segment>), Failure> {
    let text = path.to_string_lossy();
    let split = text.rsplit_once('@').and_then(|(file, times)| Some((file, times.split_once("..")?)));
    let Some((file, (from, to))) = split.filter(|_| !path.exists()) else {
        return Ok((path.to_path_buf(), None));
    };
    let wrong = || Failure::usage(format!("`{text}`: expected FILE@FROM..TO in s, such as {file}@0..12.5"));
    let time = |text: &str| match text.trim() {
        "" => Ok(None),
        text => text.parse::<f64>().map(Some).map_err(|_| wrong()),
    };
    let times = [time(from)?, time(to)?];
    match times {
        [Some(from), Some(to)] if from.is_nan() || to.is_nan() || from >= to => Err(wrong()),
        _ => Ok((PathBuf::from(file), Some(times))),
    }
}

/// Options of the verbs that fit records.
#[derive(Clone, Debug, Args)]
pub struct FitOptions {
    /// Records (CSV, MAT, Parquet; `-` is stdin); several are fitted together. `FILE@FROM..TO` is a segment of one, in s.
    #[arg(required = true, value_name = "REC")]
    records: Vec<PathBuf>,
    #[command(flatten)]
    input: InputOptions,
    /// Range of a parameter, in its unit: `bkl=0..2e-3`. A parameter that is not free becomes free.
    #[arg(long = "bounds", value_delimiter = ',', value_name = "NAME=LOW..HIGH")]
    bounds: Vec<String>,
    /// Members of the population of the genetic algorithm.
    #[arg(long, default_value_t = FitSettings::default().population, allow_negative_numbers = true,
          value_parser = clap::builder::RangedI64ValueParser::<usize>::new().range(4..=i64::from(fit::MAX_POPULATION as u32)))]
    population: usize,
    /// Most evaluations of the model in one search; what is begun is ended. Records that are not explained are searched in
    /// each reading that the rig leaves open, in the best of these from more seeds, and in the others near what that
    /// found, each with this budget.
    #[arg(long, default_value_t = FitSettings::default().budget, allow_negative_numbers = true,
          value_parser = clap::value_parser!(u32).range(20..))]
    budget: u32,
    /// Where to write what was measured, predicted and left, sample by sample (CSV, or Parquet if it ends so);
    /// `trace.csv` in the directory of `--out` by default.
    #[arg(long, value_name = "FILE.csv|.parquet", value_parser = table_path())]
    trace: Option<PathBuf>,
}

/// The rig that the user names; the default is the first built-in one, or `default` where a verb has its own.
fn rig(common: &Common, default: &str) -> Result<Rig, Failure> {
    Rig::load(common.rig.as_deref().unwrap_or(default))
}

/// Sets parameters from texts such as `fdj=800`.
fn assignments(parameters: &mut Parameters<f64>, texts: &[String]) -> Result<(), Failure> {
    texts.iter().try_for_each(|text| {
        let (parameter, value) = Assignment::of_parameter(text)?;
        set(parameters, parameter, value)
    })
}

/// Sets a parameter after a check of its range.
fn set(parameters: &mut Parameters<f64>, parameter: Parameter, value: f64) -> Result<(), Failure> {
    check_value(parameter, value)?;
    parameters.set(parameter, value);
    Ok(())
}

/// Refuses a value outside of the range of a parameter.
fn check_value(parameter: Parameter, value: f64) -> Result<(), Failure> {
    let info = parameter.info();
    if (info.lower..=info.upper).contains(&value) {
        return Ok(());
    }
    let (name, value, expected) = (info.name, plain(value), output::own_range(info));
    Err(Failure::usage(format!("`{name}` = {value}: expected {expected}")))
}

/// Ranges with the user's bounds in place of those of the same parameters.
fn with_bounds(ranges: &[Range], bounds: &[String]) -> Result<Vec<Range>, Failure> {
    let mut ranges = ranges.to_vec();
    for text in bounds {
        let bounds = Assignment::new(text, "NAME=LOW..HIGH, such as bkl=0..2e-3")?;
        let [lower, upper] = bounds.two_numbers("..")?;
        let range = Range::new(bounds.parameter()?, lower, upper)?;
        match ranges.iter_mut().find(|known| known.parameter == range.parameter) {
            Some(known) => *known = range,
            None => ranges.push(range),
        }
    }
    if ranges.is_empty() || ranges.len() > fit::MAX_FREE {
        return Err(Failure::usage(format!(
            "{} free parameters: expected 1 to {}; declare them in the rig or with --bounds",
            ranges.len(),
            fit::MAX_FREE
        )));
    }
    Ok(ranges)
}

/// A fit of the user's records, with what it was made of.
struct Fitted {
    rig: Rig,
    ranges: Vec<Range>,
    noise_source: [NoiseSource; 4],
    records: Vec<Record>,
    record_notes: Vec<String>,
    prepared: Vec<Prepared>,
    fit: Fit,
    reading_open: bool,
    population: usize,
    budget: u32,
    /// How the records were read, and the search: as in the configuration of the result.
    reading: Value,
    search: Value,
    names: Vec<String>,
    trace: Option<PathBuf>,
}

/// Mean square of the residual, in units of the noise, above which it is asked whether the command was recorded late.
const SUSPECT: f64 = 2.0;

/// Reads records and fits the ranges that `choose` takes from the rig; `writes` are the files of the result in the
/// directory of `--out`.
fn fit_records(
    common: &Common,
    options: &FitOptions,
    default_rig: &str,
    writes: &[&str],
    choose: impl FnOnce(&Rig) -> Vec<Range>,
) -> Result<Fitted, Failure> {
    interrupt::watch(common)?;
    let trace = trace_path(common, options.trace.as_deref());
    Files::new(common).reads(&options.records).writes_in_out(writes).writes(trace.clone()).check()?;
    let rig = rig(common, default_rig)?;
    let ranges = with_bounds(&choose(&rig), &options.bounds)?;
    let (records, mut record_notes) = options.input.read_for_fit(common, &options.records, &rig)?;
    let given: Vec<_> = options.records.iter().zip(&records).collect();
    record_notes.extend(common_samples(common, &given, records.len())?);
    let noise_source = fit::noise_source(&rig, &records);
    let prepared: Vec<Prepared> = records.iter().map(|record| fit::prepare(&rig, record)).collect();
    let settings = FitSettings { seed: common.seed, population: options.population, budget: options.budget };
    let bar = output::bar(common, u64::from(options.budget), "identifying", Time::Left);
    let show = |standing| output::show_standing(&bar, standing);
    let tell = |what: &str| bar.suspend(|| output::log(common, what));
    let AsRead { reading: Reading { rig, records: prepared }, mut fit, is_open: reading_open } =
        fit::fit_as_read(&rig, &ranges, &prepared, &settings, show, tell);
    let is_late = !fit.interrupted
        && fit.misfit.mean_square() > SUSPECT
        && fit::is_command_late(&rig, &ranges, &records, &settings, &mut fit);
    if is_late {
        record_notes.push(output::LATE_COMMAND.to_owned());
    }
    bar.finish_and_clear();
    let names = options.records.iter().map(|path| path.display().to_string()).collect();
    let population = options.population;
    Ok(Fitted {
        rig,
        ranges,
        noise_source,
        records,
        record_notes,
        prepared,
        fit,
        reading_open,
        population,
        budget: options.budget,
        reading: options.input.json(),
        search: json!({ "population": options.population, "budget": options.budget }),
        names,
        trace,
    })
}

/// Where a trace goes: where the user wants it, else into the directory of `--out`, else nowhere.
fn trace_path(common: &Common, path: Option<&Path>) -> Option<PathBuf> {
    path.map(Path::to_path_buf).or_else(|| output::out_path(common, TRACE_FILE))
}

/// Writes a trace, if there is a path for it.
fn save_trace(common: &Common, path: Option<&Path>, trace: impl FnOnce() -> Trace) -> Result<(), Failure> {
    let Some(path) = path else { return Ok(()) };
    trace().save(path)?;
    output::log(common, &format!("wrote {}", path.display()));
    Ok(())
}

/// Says that the rig is not written, where there is a place for it.
fn log_no_rig(common: &Common, file: &str) {
    if let Some(path) = output::out_path(common, file) {
        let path = path.display();
        let line = format!("warning: {path} is not written: a rig is the result of a search that has ended");
        output::log(common, &line);
    }
}

/// A search that was interrupted or used up its budget has not converged: its result is printed, and the exit code says
/// so.
fn converged(fitted: &Fitted) -> Result<(), Failure> {
    if fitted.fit.interrupted {
        return interrupt::check();
    }
    if fitted.fit.stop == StopReason::Budget {
        return Err(Failure::convergence(format!(
            "no convergence within the budget of {} evaluations for each search ({} made in all); allow more with \
             --budget, or narrow the --bounds",
            fitted.budget, fitted.fit.evaluations
        )));
    }
    Ok(())
}

/// Name of the default rig.
const DEFAULT_RIG: &str = BUILT_IN[0].name;
