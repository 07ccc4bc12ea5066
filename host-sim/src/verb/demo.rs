//! `demo`: the main job on an embedded example.
//!
//! An HF actuator with a backlash and a raised friction flies two commands. Its spool meters by the square root of the
//! pressure drop, which nobody declared and the monitor's linear model lacks. The monitor identifies the faults,
//! `diagnose` names what is missing, and a third record that was not fitted shows the error before and after.

use super::DEFAULT_RIG;
use super::diagnose::{Job, WRITES};
use super::files::Files;
use crate::cli::Common;
use crate::failure::Failure;
use crate::fit::TYPICAL_NOISE;
use crate::interrupt;
use crate::output;
use crate::plant::{self, Excitation, Sensing};
use crate::record::{Record, write_csv};
use crate::report::{FITTED, HELD_OUT};
use crate::rig::Rig;
use eha_monitor::channel::Channel;
use eha_monitor::parameter::Parameter;

/// What the example's actuator has, and the monitor does not know.
const TRUTH: [(Parameter, f64); 3] =
    [(Parameter::Backlash, 2e-4), (Parameter::DryFriction, 800.0), (Parameter::MeteringBlend, 1.0)];
/// Noise of its sensors.
const NOISE: [(Channel, f64); 2] =
    [(Channel::UserPosition, TYPICAL_NOISE[0]), (Channel::Current, TYPICAL_NOISE[2])];
/// Records: command, role.
const FLIGHTS: [(&str, &str); 3] = [("chirp", FITTED), ("mixed", FITTED), ("mixed-step", HELD_OUT)];
/// Samples of a record: 1 s at 1 kHz.
const SAMPLES: usize = 1001;
/// Longest step of the HF model, s.
const PLANT_STEP: f64 = 2e-6;

/// Where the example's files go unless the user says otherwise.
const DIRECTORY: &str = "eha-demo";

/// Name of what is printed, in the directory.
const PRINTED_FILE: &str = "report.txt";

/// Name of a record, in the directory.
fn record_file(command: &str) -> String {
    format!("{command}.csv")
}

/// Options of `demo`.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Options {}

/// Runs the verb.
///
/// # Errors
/// A file cannot be written.
pub fn run(common: &Common, _: &Options) -> Result<(), Failure> {
    interrupt::watch(common)?;
    let directory = common.out.clone().unwrap_or_else(|| DIRECTORY.into());
    let common = &Common { out: Some(directory), ..common.clone() };
    let mut files = Files::new(common).writes_in_out(&WRITES).writes_in_out(&[PRINTED_FILE]);
    for (command, _) in FLIGHTS {
        files = files.writes_in_out(&[&record_file(command)]);
    }
    files.check()?;
    let rig = Rig::load(DEFAULT_RIG)?;
    let mut records = FLIGHTS
        .iter()
        .enumerate()
        .map(|(index, (command, _))| fly(&rig, command, common.seed.wrapping_add(index as u64)))
        .collect::<Result<Vec<_>, _>>()?;
    for record in &records {
        output::save(common, &record_file(record.name()), || {
            let comment = format!("host-sim {} demo, seed {}", env!("CARGO_PKG_VERSION"), common.seed);
            let mut text = Vec::new();
            write_csv(record, &[comment], &mut text).map_err(Failure::other)?;
            String::from_utf8(text).map_err(Failure::other)
        })?;
    }
    let holdout = records.split_off(2);
    let names = FLIGHTS.iter().map(|(command, role)| format!("{command} ({role})")).collect();
    let mut job =
        Job { common, rig, train: records, holdout, record_notes: Vec::new(), names, effort_s: None };
    let answer = job.run()?;
    let saved = job.save(&answer, None);
    if common.json {
        output::print_json(&answer.result)?;
        saved?;
        return job.check(&answer);
    }
    let truth: Vec<String> = TRUTH
        .iter()
        .map(|(parameter, value)| {
            format!("{} = {}", parameter.info().name, output::quantity(*value, parameter.info().unit))
        })
        .collect();
    let text = format!(
        "the actuator of the example (unknown to the monitor): {}\n\n{}",
        truth.join(", "),
        job.text(&answer).trim_end()
    );
    let saved = saved.and_then(|()| output::save(common, PRINTED_FILE, || Ok(text.clone())));
    output::print(&text)?;
    saved?;
    job.check(&answer)
}

fn fly(rig: &Rig, name: &str, seed: u64) -> Result<Record, Failure> {
    let mut rig = rig.clone();
    for (parameter, value) in TRUTH {
        rig.parameters.set(parameter, value);
    }
    let excitation = Excitation::of_command(name, SAMPLES, 1e-3)?;
    let outputs = plant::run(&rig, &excitation, PLANT_STEP);
    let sensing = Sensing { noise: NOISE.to_vec(), ..Sensing::default() };
    let record = plant::record(name, rig.form, &excitation, &outputs, &sensing, seed)?;
    // What a flight has: user position and current.
    let channels = record
        .channels()
        .filter(|(channel, _)| !matches!(channel, Channel::RamPosition | Channel::Pressure))
        .map(|(channel, values)| (channel, values.to_vec()))
        .collect();
    Ok(Record::new(name, excitation.sample_period, 0.0, channels)?)
}
