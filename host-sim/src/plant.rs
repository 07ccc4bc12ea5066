//! The actuator as a source of data: a model run through a command, sampled, with sensor noise.

use crate::failure::Failure;
use crate::record::Record;
use crate::rig::Rig;
use eha_monitor::channel::Channel;
use eha_monitor::command::{Command, CommandInfo};
use eha_monitor::fit::problem::{Record as Flight, Start};
use eha_monitor::fit::walk::Walk;
use eha_monitor::integrate::Stepper;
use eha_monitor::integrate::midpoint::Midpoint;
use eha_monitor::model::drive::Law;
use eha_monitor::model::state::Outputs;
use eha_monitor::model::{Drive, Form, Model};
use rand_distr::{Distribution, Normal};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

/// What drives the actuator, one value a sample.
#[derive(Clone, Debug)]
pub struct Excitation {
    /// Sample period, s.
    pub sample_period: f64,
    /// Commanded position, m.
    pub command: Vec<f64>,
    /// External load against extension, N; empty where there is none.
    pub load: Vec<f64>,
    /// Driving force in place of the valve, N; empty where the valve drives.
    pub drive: Vec<f64>,
}

impl Excitation {
    /// A command of the table, sampled with a period in s, without load.
    ///
    /// # Errors
    /// No command has that name.
    pub fn of_command(name: &str, samples: usize, sample_period: f64) -> Result<Self, Failure> {
        let info = CommandInfo::named(name).ok_or_else(|| Failure::other(format!("no command {name}")))?;
        let command = Command::<f64>::new(info);
        Ok(Self {
            sample_period,
            command: (0..samples).map(|sample| command.at(sample as f64 * sample_period)).collect(),
            load: Vec::new(),
            drive: Vec::new(),
        })
    }
}

/// What the sensors do to the channels.
#[derive(Clone, Debug, Default)]
pub struct Sensing {
    /// Standard deviation of the noise of a channel, in its unit.
    pub noise: Vec<(Channel, f64)>,
    /// Step in which a channel is read, in its unit.
    pub quantum: Vec<(Channel, f64)>,
    /// Chance that a sample of a measured channel is missing.
    pub dropout: f64,
}

/// Runs a rig's model through an excitation, from rest at the first commanded position, in steps of at most `step` s.
/// A known controller drives it in place of the excitation's force.
pub fn run(rig: &Rig, excitation: &Excitation, step: f64) -> Vec<Outputs<f64>> {
    let drive = if rig.controller.is_some() { &[][..] } else { &excitation.drive };
    let value = |series: &[f64], sample: usize| series.get(sample).copied().unwrap_or(0.0);
    let force: Vec<f64> = (0..excitation.command.len())
        .map(|sample| value(drive, sample) - value(&excitation.load, sample))
        .collect();
    let start = Start { ram: value(&excitation.command, 0), ..Start::default() };
    let knots = rig.knots(&excitation.command);
    let flight = Flight {
        arriving: &knots.arriving,
        ahead: &knots.ahead,
        force: &force,
        holds: rig.drive_holds,
        law: rig.controller,
        ..Flight::new(excitation.sample_period, &knots.command, &start)
    };
    let mut stepper = Midpoint::new(step);
    stepper.begin(excitation.sample_period, true, true);
    let mut walk = Walk::new(&Model::new(rig.form, &rig.parameters), &flight);
    std::iter::from_fn(|| walk.next(&flight, &mut stepper)).map(|(_, outputs)| outputs).collect()
}

/// The step, s, that [`run`] takes with a sample period where it is asked for at most `longest`.
pub fn step(sample_period: f64, longest: f64) -> f64 {
    let mut stepper = Midpoint::new(longest);
    stepper.begin(sample_period, true, true);
    4.0 * stepper.unit()
}

/// The force that a known controller asked for along a run that started at rest, N.
pub fn asked(law: &Law<f64>, excitation: &Excitation, outputs: &[Outputs<f64>]) -> Vec<f64> {
    let before = [outputs.first(), outputs.first()].into_iter().flatten().chain(outputs);
    let samples = excitation.command.iter().zip(outputs).zip(before);
    samples
        .map(|((command, now), before)| {
            law.force(*command, now.ram, before.ram, 1.0 / excitation.sample_period)
        })
        .collect()
}

/// The record that the sensors make of a run.
///
/// # Errors
/// The record is not one (see [`Record::new`]): too short, or nothing moves.
pub fn record(
    name: &str,
    form: Form,
    excitation: &Excitation,
    outputs: &[Outputs<f64>],
    sensing: &Sensing,
    seed: u64,
) -> Result<Record, Failure> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut channels = vec![(Channel::Command, excitation.command.clone())];
    for (channel, series) in [(Channel::Load, &excitation.load), (Channel::Drive, &excitation.drive)] {
        if !series.is_empty() {
            channels.push((channel, series.clone()));
        }
    }
    let lookup = |list: &[(Channel, f64)], channel: Channel| {
        list.iter().find(|(known, _)| *known == channel).map_or(0.0, |&(_, value)| value)
    };
    for (index, channel) in Channel::MEASURED.into_iter().enumerate() {
        if form.drive == Drive::Force && matches!(channel, Channel::Current | Channel::Pressure) {
            continue;
        }
        let noise = Normal::new(0.0, lookup(&sensing.noise, channel)).map_err(Failure::usage)?;
        let quantum = lookup(&sensing.quantum, channel);
        let values = outputs.iter().map(|output| {
            let value = output.to_array()[index] + noise.sample(&mut random);
            let read = if quantum > 0.0 { (value / quantum).round() * quantum } else { value };
            let draw = (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
            if draw < sensing.dropout { f64::NAN } else { read }
        });
        channels.push((channel, values.collect()));
    }
    Ok(Record::new(name, excitation.sample_period, 0.0, channels)?)
}
