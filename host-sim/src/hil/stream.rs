//! Samples for the line: a simulated actuator whose faults may grow, or a record.

use crate::failure::Failure;
use crate::record::Record;
use crate::rig::unknown;
use eha_monitor::channel::Channel;
use eha_monitor::command::{COMMANDS, Command, CommandInfo};
use eha_monitor::integrate::Stepper;
use eha_monitor::integrate::midpoint::Midpoint;
use eha_monitor::model::state::{Input, InputSegment};
use eha_monitor::model::{Form, Model};
use eha_monitor::parameter::{Parameter, Parameters};
use eha_monitor::simulate::Actuator;
use rand_distr::{Distribution, Normal};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;

/// Longest step of the simulated actuator, s.
const STEP: f64 = 2e-5;
/// Time over which a fault grows, s.
const GROWTH: f64 = 1.0;

/// A parameter that grows to another value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Growth {
    /// Which.
    pub parameter: Parameter,
    /// Value that it reaches, in its unit.
    pub value: f64,
    /// When it begins to grow, s; it takes a second.
    pub start: f64,
}

/// An actuator to be simulated.
#[derive(Clone, Debug)]
pub struct Simulated {
    /// Structure of its model.
    pub form: Form,
    /// Its parameters at the start.
    pub parameters: Parameters<f64>,
    /// What grows.
    pub growths: Vec<Growth>,
    /// Its command, by name.
    pub command: String,
    /// How long it runs, s.
    pub seconds: f64,
    /// Sample period, s.
    pub sample_period: f64,
    /// Does the command keep the value of a sample until the next one? Otherwise it goes from sample to sample in straight
    /// lines.
    pub holds_command: bool,
    /// Noise of user position, m, and current, mA.
    pub noise: [f64; 2],
    /// Seed of the noise.
    pub seed: u64,
}

impl Simulated {
    /// Its parameters at a time.
    fn at(&self, time: f64) -> Parameters<f64> {
        let mut parameters = self.parameters;
        for growth in &self.growths {
            let part = ((time - growth.start) / GROWTH).clamp(0.0, 1.0);
            let from = self.parameters.get(growth.parameter);
            parameters.set(growth.parameter, from + (growth.value - from) * part);
        }
        parameters
    }

    /// Command, user position and current, sample by sample.
    ///
    /// # Errors
    /// No command has that name, or a noise is no standard deviation.
    pub fn samples(&self) -> Result<Vec<[f32; 3]>, Failure> {
        let info = CommandInfo::named(&self.command).ok_or_else(|| {
            Failure::usage(unknown("command", &self.command, COMMANDS.iter().map(|row| row.name)))
        })?;
        let command = Command::<f64>::new(info);
        let noise = |deviation| Normal::new(0.0, deviation).map_err(Failure::usage);
        let noise = [noise(self.noise[0])?, noise(self.noise[1])?];
        let mut random = Xoshiro256PlusPlus::seed_from_u64(self.seed);
        let period = self.sample_period;
        let count = (self.seconds / period).round() as u32;
        let mut stepper = Midpoint::new(STEP);
        stepper.begin(period, false, true);
        let actuator = |time: f64| Actuator::new(Model::new(self.form, &self.at(time)), period);
        let rest = Input { command: command.at(0.0), command_rate: 0.0, force: 0.0 };
        let mut motion = actuator(0.0).at_rest(rest.command, &rest);
        let mut samples = Vec::with_capacity(count as usize);
        for sample in 0..count {
            let time = f64::from(sample) * period;
            let actuator = actuator(time);
            let mut input = Input { command: command.at(time), ..rest };
            if sample > 0 {
                let [before, here] = [command.at(time - period), input.command];
                let arriving = if self.holds_command { before } else { here };
                let segment =
                    InputSegment::between([before, arriving], [0.0; 2], time - period, 1.0 / period);
                actuator.advance(&mut stepper, &mut motion, &segment);
                let from = Input { command: arriving, ..segment.start };
                input = Input { command: here, ..from };
                if arriving != here {
                    actuator.jump(&mut stepper, &mut motion, &from, &input, time);
                }
            }
            let outputs = actuator.measure(&mut motion, &input);
            let [user, current] = [outputs.user, outputs.current];
            samples.push([
                input.command as f32,
                (user + noise[0].sample(&mut random)) as f32,
                (current + noise[1].sample(&mut random)) as f32,
            ]);
        }
        Ok(samples)
    }
}

/// The samples of a record; what is missing in it is no number.
///
/// # Errors
/// The record has no user position.
pub fn of_record(record: &Record) -> Result<Vec<[f32; 3]>, Failure> {
    let series = |channel: Channel| {
        record.channels().find(|(known, _)| *known == channel).map(|(_, values)| values.to_vec())
    };
    let (Some(command), Some(user)) = (series(Channel::Command), series(Channel::UserPosition)) else {
        return Err(Failure::data("the record has no command or no user position"));
    };
    let current = series(Channel::Current).unwrap_or_else(|| vec![f64::NAN; command.len()]);
    let samples = command.iter().zip(user).zip(current);
    Ok(samples.map(|((&command, user), current)| [command as f32, user as f32, current as f32]).collect())
}
