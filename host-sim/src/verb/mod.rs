//! The verbs of the program, one file each.

pub mod budget;
pub mod calibrate;
pub mod demo;
pub mod diagnose;
pub mod hil;
pub mod identify;
pub mod import;
pub mod lists;
pub mod reproduce;
pub mod simulate;

use crate::cli::Common;
use crate::failure::Failure;
use crate::fit::{self, Fit, FitSettings, NoiseSource, Prepared};
use crate::output;
use crate::record::{Record, read_csv};
use crate::rig::{BUILT_IN, Range, Rig, parameter_named};
use clap::Args;
use eha_monitor::fit::identify::StopReason;
use std::path::PathBuf;

/// Options of the verbs that fit records.
#[derive(Clone, Debug, Args)]
pub struct FitOptions {
    /// Records; several are fitted together.
    #[arg(required = true, value_name = "REC.csv")]
    records: Vec<PathBuf>,
    /// Range of a parameter, in its unit: `bkl=0..2e-3`. A parameter that is not free becomes free.
    #[arg(long = "bounds", value_name = "NAME=LOW..HIGH")]
    bounds: Vec<String>,
    /// Members of the population of the genetic algorithm.
    #[arg(long, default_value_t = FitSettings::default().population,
          value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(4..=fit::MAX_POPULATION as u64))]
    population: usize,
    /// Most evaluations of the model.
    #[arg(long, default_value_t = FitSettings::default().budget, value_parser = clap::value_parser!(u32).range(20..))]
    budget: u32,
}

/// The rig that the user names; the default is the first built-in one, or `default` where a verb has its own.
fn rig(common: &Common, default: &str) -> Result<Rig, Failure> {
    Rig::load(common.rig.as_deref().unwrap_or(default))
}

/// Reads records, logging their warnings.
fn read_records(common: &Common, paths: &[PathBuf]) -> Result<Vec<Record>, Failure> {
    paths
        .iter()
        .map(|path| {
            let loaded = read_csv(path)?;
            for warning in &loaded.warnings {
                output::log(common, &format!("warning: {warning}"));
            }
            for (channel, _) in loaded.record.channels() {
                let missing = loaded.record.missing_count(channel);
                if missing > 0 {
                    let column = channel.info().column;
                    output::log(
                        common,
                        &format!("{}: {missing} missing samples of {column}", path.display()),
                    );
                }
            }
            Ok(loaded.record)
        })
        .collect()
}

/// Ranges with the user's bounds in place of those of the same parameters.
fn with_bounds(ranges: &[Range], bounds: &[String]) -> Result<Vec<Range>, Failure> {
    let mut ranges = ranges.to_vec();
    for text in bounds {
        let wrong =
            || Failure::usage(format!("bounds `{text}`: expected NAME=LOW..HIGH, such as bkl=0..2e-3"));
        let (name, limits) = text.split_once('=').ok_or_else(wrong)?;
        let (lower, upper) = limits.split_once("..").ok_or_else(wrong)?;
        let number = |text: &str| text.trim().parse::<f64>().map_err(|_| wrong());
        let range = Range::new(parameter_named(name.trim())?, number(lower)?, number(upper)?)?;
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
    prepared: Vec<Prepared>,
    fit: Fit,
    names: Vec<String>,
}

/// Reads records and fits the ranges that `choose` takes from the rig.
fn fit_records(
    common: &Common,
    options: &FitOptions,
    default_rig: &str,
    choose: impl FnOnce(&Rig) -> Vec<Range>,
) -> Result<Fitted, Failure> {
    let rig = rig(common, default_rig)?;
    let ranges = with_bounds(&choose(&rig), &options.bounds)?;
    let records = read_records(common, &options.records)?;
    let (noise, noise_source) = fit::estimate(&rig, &records);
    let prepared: Vec<Prepared> = records.iter().map(|record| fit::prepare(&rig, record, noise[0])).collect();
    let settings = FitSettings { seed: common.seed, population: options.population, budget: options.budget };
    let bar = output::bar(common, u64::from(options.budget), "identifying");
    let fit = fit::fit(&rig, &ranges, &prepared, noise, &settings, |standing| {
        output::show_standing(&bar, standing);
    });
    bar.finish_and_clear();
    let names = options.records.iter().map(|path| path.display().to_string()).collect();
    Ok(Fitted { rig, ranges, noise_source, prepared, fit, names })
}

/// A search that used up its budget has not converged: its result is printed, and the exit code says so.
fn converged(fit: &Fit) -> Result<(), Failure> {
    if fit.stop == StopReason::Budget {
        return Err(Failure::convergence(format!(
            "no convergence within {} evaluations; allow more with --budget, or narrow the --bounds",
            fit.evaluations
        )));
    }
    Ok(())
}

/// Name of the default rig.
const DEFAULT_RIG: &str = BUILT_IN[0].name;
