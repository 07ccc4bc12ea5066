//! `reproduce`: the source's twelve cases, its result beside ours, before and after the loop is closed, and its
//! findings about the search checked.
//!
//! To close the loop, `diagnose` sees two records of the *healthy* actuator and predicts a third. What it adds to the
//! monitor's model is then used for all twelve cases; or the user's rig is, which such a diagnosis wrote before.

use super::DEFAULT_RIG;
use super::diagnose::Job;
use super::files::Files;
use super::findings::{findings, print_findings};
use crate::cli::Common;
use crate::failure::Failure;
use crate::fit::{self, Bounds, Fit, FitSettings, Prepared};
use crate::interrupt;
use crate::output::{self, SCHEMA, Time};
use crate::plant::{self, Excitation, Sensing};
use crate::record::Record;
use crate::report::{self, Portrait, REPORT_FILE, Reproduced};
use crate::rig::{BUILT_IN, Rig, spelled};
use crate::thesis::{CASES, Case};
use eha_monitor::channel::Channel;
use eha_monitor::model::Form;
use eha_monitor::model::state::Outputs;
use eha_monitor::parameter::Parameter;
use rayon::prelude::*;
use serde_json::{Value, json};
use std::time::Instant;

/// Samples of a case: 1 s at 1 kHz.
const SAMPLES: usize = 1001;
/// Their period, s.
const SAMPLE_PERIOD: f64 = 1e-3;
/// Weights of the channels that are compared: the noise of the sensors that the design assumes.
pub(super) const NOISE: [f64; 4] =
    [fit::TYPICAL_NOISE[0], f64::INFINITY, fit::TYPICAL_NOISE[2], f64::INFINITY];
/// Longest step of the HF model, s.
const PLANT_STEP: f64 = 1e-6;

/// Name of the result in the directory of `--out`.
const RESULT_FILE: &str = "reproduce.json";

/// Options of `reproduce`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Make the data with the LF model, so that only the search is judged.
    #[arg(long)]
    lf_data: bool,
    /// Leave out the table of findings about the search.
    #[arg(long)]
    cases_only: bool,
}

/// Runs the verb.
///
/// # Errors
/// Stdout or a file cannot be written.
pub fn run(common: &Common, options: &Options) -> Result<(), Failure> {
    Files::new(common).writes_in_out(&[RESULT_FILE, REPORT_FILE]).check()?;
    interrupt::watch(common)?;
    let started = Instant::now();
    let monitor: Rig = (BUILT_IN[0].make)();
    let augmented = match &common.rig {
        Some(name) => Some(of_the_source(Rig::load(name)?)?),
        None if options.lf_data => None,
        None => Some(closed_loop(common)?),
    };
    // A loop that was not closed says nothing of what the model lacks.
    let augmented = augmented.filter(|_| common.rig.is_some() || !interrupt::requested());
    let bar = output::bar(common, CASES.len() as u64, "reproducing", Time::Left);
    let results: Vec<Outcome> = CASES
        .par_iter()
        .filter(|_| !interrupt::requested())
        .map(|case| {
            let record = record(case.command, case.bkl, case.fdj, !options.lf_data)?;
            let prepared = prepare(augmented.as_ref().unwrap_or(&monitor), &record);
            let before = identify(common.seed, case, &prepare(&monitor, &record), &monitor);
            let after = augmented.as_ref().map(|rig| identify(common.seed, case, &prepared, rig));
            bar.inc(1);
            Ok(Outcome { case: *case, record, prepared, before, after })
        })
        .collect::<Result<_, Failure>>()?;
    bar.finish_and_clear();
    // A case that was cut short says nothing.
    let whole = |outcome: &Outcome| {
        !outcome.before.interrupted && outcome.after.as_ref().is_none_or(|fit| !fit.interrupted)
    };
    let results: Vec<Outcome> = results.into_iter().filter(whole).collect();
    let findings =
        if options.cases_only || interrupt::requested() { Vec::new() } else { findings(common.seed)? };
    let seconds = started.elapsed().as_secs_f64();
    let cases: Vec<Value> = results.iter().map(Outcome::json).collect();
    let effects: Vec<&str> =
        augmented.iter().flat_map(|rig| &rig.effects).map(|effect| effect.name).collect();
    let findings_json: Vec<Value> = findings
        .iter()
        .map(|finding| {
            json!({ "question": finding.question, "setting": finding.setting,
                    "median_error_percent": finding.median, "worst_error_percent": finding.worst })
        })
        .collect();
    let mut warnings: Vec<String> = results.iter().flat_map(Outcome::warnings).collect();
    if interrupt::requested() {
        warnings.push(format!(
            "interrupted: {} of {} cases were fitted{}",
            results.len(),
            CASES.len(),
            if findings.is_empty() && !options.cases_only { ", and no finding was checked" } else { "" }
        ));
    }
    let rig = augmented.as_ref().unwrap_or(&monitor);
    let result = json!({
        "schema": SCHEMA, "cases": cases, "added_effects": effects, "findings": findings_json, "warnings": warnings,
        "interrupted": interrupt::requested(), "seconds": seconds, "seed": common.seed,
        "config": { "version": env!("CARGO_PKG_VERSION"), "seed": common.seed, "rig": common.rig.as_ref().unwrap_or(&rig.name),
                    "data": if options.lf_data { "lf" } else { "hf" },
                    "samples": SAMPLES, "plant_step_s": PLANT_STEP, "channels": ["lvdt_m", "current_mA"],
                    "search": { "population": CASES.map(|case| case.population), "budget": FitSettings::default().budget } },
    });
    let portraits = if common.out.is_some() { portraits()? } else { Vec::new() };
    let saved = output::save_result(common, RESULT_FILE, &result, || {
        let cases: Vec<Reproduced<'_>> = results.iter().map(Outcome::in_report).collect();
        report::reproduction(&cases, rig, &portraits, &result)
    });
    if common.json {
        output::print_json(&result)?;
        saved?;
        return interrupt::check();
    }
    if let Some(rig) = &augmented {
        let names: Vec<&str> = rig.effects.iter().map(|effect| effect.name).collect();
        let names = if names.is_empty() { "no effect".to_owned() } else { names.join(", ") };
        output::print(&match &common.rig {
            Some(given) => format!("after: with the rig {given}: {names}"),
            None => format!("after: with what two healthy records reveal: {names}"),
        })?;
    }
    print_cases(&results)?;
    if !findings.is_empty() {
        print_findings(&findings)?;
    }
    warnings.iter().try_for_each(|warning| output::print(&format!("note: {warning}")))?;
    output::print(&format!(
        "total {seconds:.2} s (the source: 3532 to 10208 s for one case); seed {}",
        common.seed
    ))?;
    saved?;
    interrupt::check()
}

/// Noise-free record of the source's actuator.
pub(super) fn record(command: &str, bkl: f64, fdj: f64, high_fidelity: bool) -> Result<Record, Failure> {
    let (excitation, outputs, form) = fly(command, bkl, fdj, high_fidelity)?;
    plant::record(command, form, &excitation, &outputs, &Sensing::default(), 0)
}

/// Flies the source's actuator.
fn fly(
    command: &str,
    bkl: f64,
    fdj: f64,
    high_fidelity: bool,
) -> Result<(Excitation, Vec<Outputs<f64>>, Form), Failure> {
    let mut rig = (BUILT_IN[0].make)();
    rig.parameters.bkl = bkl;
    rig.parameters.fdj = fdj;
    rig.parameters.metering_blend = if high_fidelity { 1.0 } else { 0.0 };
    let excitation = Excitation::of_command(command, SAMPLES, SAMPLE_PERIOD)?;
    let outputs = plant::run(&rig, &excitation, PLANT_STEP);
    Ok((excitation, outputs, rig.form))
}

/// The record as it is fitted.
fn prepare(rig: &Rig, record: &Record) -> [Prepared; 1] {
    [fit::prepare_with(rig, record, NOISE)]
}

fn identify(seed: u64, case: &Case, prepared: &[Prepared], rig: &Rig) -> Fit {
    let settings = FitSettings { seed, population: case.population, ..FitSettings::default() };
    fit::fit(rig, &case.ranges(), prepared, &settings, |_| {})
}

fn faults(fit: &Fit) -> (f64, f64) {
    let value = |parameter| fit.estimate(parameter).map_or(f64::NAN, |estimate| estimate.value);
    (value(Parameter::Backlash), value(Parameter::DryFriction))
}

/// What became of a case.
struct Outcome {
    case: Case,
    record: Record,
    /// As the last of the fits took it.
    prepared: [Prepared; 1],
    before: Fit,
    after: Option<Fit>,
}

impl Outcome {
    fn error(&self, fit: &Fit) -> f64 {
        let (bkl, fdj) = faults(fit);
        self.case.mean_error_percent(bkl, fdj)
    }

    fn in_report(&self) -> Reproduced<'_> {
        Reproduced {
            case: self.case,
            record: &self.record,
            prepared: &self.prepared,
            before: &self.before,
            after: self.after.as_ref(),
        }
    }

    /// What the user should know of its fits.
    fn warnings(&self) -> Vec<String> {
        let fits = [("before", Some(&self.before)), ("after", self.after.as_ref())];
        let of_fit = |(when, fit): (&str, Option<&Fit>)| -> Vec<String> {
            let remarks =
                fit::remarks(fit.iter().flat_map(|fit| &fit.estimates), &self.case.ranges(), Bounds::Source);
            remarks.iter().map(|remark| format!("case {}, {when}: {remark}", self.case.number)).collect()
        };
        fits.into_iter().flat_map(of_fit).collect()
    }

    fn json(&self) -> Value {
        let case = &self.case;
        let ours = |fit: &Fit| {
            let (bkl, fdj) = faults(fit);
            json!({
                "bkl": bkl, "fdj": fdj, "mean_error_percent": self.error(fit),
                "residual_rms_m": fit.position_rms(), "seconds": fit.seconds, "evaluations": fit.evaluations,
                "generations": fit.generations, "seconds_per_generation": fit.seconds_per_generation,
            })
        };
        json!({
            "case": case.number,
            "command": case.command,
            "input": { "bkl": case.bkl, "fdj": case.fdj },
            "source": {
                "bkl": case.source_bkl, "fdj": case.source_fdj,
                "mean_error_percent": case.mean_error_percent(case.source_bkl, case.source_fdj),
            },
            "before": ours(&self.before),
            "after": self.after.as_ref().map(ours),
        })
    }
}

/// The healthy actuator by both models, flying each command of the cases.
fn portraits() -> Result<Vec<Portrait>, Failure> {
    let position = |command: &str, high_fidelity: bool| -> Result<Vec<f64>, Failure> {
        let (_, outputs, _) = fly(command, 0.0, Parameter::DryFriction.info().default, high_fidelity)?;
        Ok(outputs.iter().map(|output| output.user).collect())
    };
    ["chirp", "mixed"]
        .into_iter()
        .map(|command| {
            let (high, low) = (position(command, true)?, position(command, false)?);
            Ok(Portrait { command, sample_period: SAMPLE_PERIOD, high, low })
        })
        .collect()
}

/// A rig that the source's cases can be fitted with.
fn of_the_source(rig: Rig) -> Result<Rig, Failure> {
    if rig.form == Form::default() {
        return Ok(rig);
    }
    let (valve, feedback, drive) = spelled(rig.form);
    Err(Failure::usage(format!(
        "rig `{}` is another actuator than the source's (valve {valve}, feedback {feedback}, drive {drive}), expected \
         `{DEFAULT_RIG}` or what a diagnosis made of it",
        rig.name
    )))
}

/// The monitor's rig with what two healthy HF records reveal, validated on a third.
fn closed_loop(common: &Common) -> Result<Rig, Failure> {
    let healthy = |command: &str, seed: u64| {
        let (excitation, outputs, form) = fly(command, 0.0, Parameter::DryFriction.info().default, true)?;
        let sensing = Sensing {
            noise: vec![(Channel::UserPosition, NOISE[0]), (Channel::Current, NOISE[2])],
            ..Sensing::default()
        };
        plant::record(command, form, &excitation, &outputs, &sensing, seed)
    };
    let mut job = Job {
        common,
        rig: (BUILT_IN[0].make)(),
        train: vec![healthy("chirp", common.seed)?, healthy("mixed", common.seed.wrapping_add(1))?],
        holdout: vec![healthy("mixed-step", common.seed.wrapping_add(2))?],
        record_notes: Vec::new(),
        names: Vec::new(),
        effort_s: None,
    };
    Ok(job.run()?.diagnosis.rig)
}

fn print_cases(results: &[Outcome]) -> Result<(), Failure> {
    let mut table = output::table([
        "case",
        "command",
        "BKL mm",
        "FDJ N",
        "source BKL",
        "FDJ",
        "error %",
        "before BKL",
        "FDJ",
        "error %",
        "after BKL",
        "FDJ",
        "error %",
        "evals",
        "gens",
        "ms/gen",
        "s",
    ]);
    for outcome in results {
        let case = &outcome.case;
        let mut row = vec![
            case.number.to_string(),
            case.command.to_owned(),
            format!("{:.3}", case.bkl * 1e3),
            format!("{:.0}", case.fdj),
            format!("{:.4}", case.source_bkl * 1e3),
            format!("{:.1}", case.source_fdj),
            format!("{:.2}", case.mean_error_percent(case.source_bkl, case.source_fdj)),
        ];
        for fit in [Some(&outcome.before), outcome.after.as_ref()] {
            row.extend(fit.map_or_else(
                || ["-", "-", "-"].map(str::to_owned),
                |fit| {
                    let (bkl, fdj) = faults(fit);
                    [format!("{:.4}", bkl * 1e3), format!("{fdj:.1}"), format!("{:.3}", outcome.error(fit))]
                },
            ));
        }
        let last = outcome.after.as_ref().unwrap_or(&outcome.before);
        row.extend([
            last.evaluations.to_string(),
            last.generations.to_string(),
            format!("{:.2}", last.seconds_per_generation * 1e3),
            format!("{:.3}", last.seconds),
        ]);
        table.add_row(row);
    }
    output::print(&table.to_string())
}
