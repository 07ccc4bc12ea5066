//! A case: an actuator with faults and effects, recorded by the plant, and what the diagnosis makes of it.

use super::floor::{self, Shape};
use crate::common::{Rig as Truth, plant};
use eha_monitor::channel::Channel;
use eha_monitor::effect::EffectInfo;
use host_sim::diagnose::{self, Diagnosis, Verdict};
use host_sim::fit::{self, FitSettings, Prepared};
use host_sim::inspect::screen::screen;
use host_sim::record::Record;
use host_sim::rig::{CommandPath, Rig};
use reference_plant::{Command, DEFAULT_STEP, Gauss, Gust, Plant, Rule, Tone, add_noise, quantise};

/// Sample period, s.
pub(crate) const PERIOD: f64 = 1e-3;
/// Share of the noise by which a held-out record may be missed for what is outside the catalogue to count as modelled.
const MODELLED: f64 = 1.5;

/// A set of channels that a record has.
pub(crate) struct ChannelSet {
    pub(crate) name: &'static str,
    pub(crate) channels: &'static [Channel],
}

/// The sets that are studied.
pub(crate) static CHANNEL_SETS: [ChannelSet; 3] = [
    ChannelSet { name: "position", channels: &[Channel::UserPosition] },
    ChannelSet { name: "position, current", channels: &[Channel::UserPosition, Channel::Current] },
    ChannelSet { name: "all", channels: &Channel::MEASURED },
];

/// Something outside the catalogue.
pub(crate) struct Outside {
    pub(crate) name: &'static str,
    /// How the plant gets it: so many times as strong, and changing so many times as fast in time or place.
    change: fn(&mut Plant, strength: f64, pace: f64),
}

fn tone(amplitude: f64, frequency: f64) -> Tone {
    Tone { amplitude, frequency, phase: 0.3 }
}

/// What is outside the catalogue, and has a row of its own in the table.
pub(crate) static OUTSIDE: [Outside; 7] = [
    Outside {
        name: "force of 800 N at 9 Hz",
        change: |plant, strength, pace| plant.effects.disturbance = tone(800.0 * strength, 9.0 * pace),
    },
    Outside {
        name: "force of 800 N at 2.2 Hz",
        change: |plant, strength, pace| plant.effects.disturbance = tone(800.0 * strength, 2.2 * pace),
    },
    Outside {
        name: "drift of the sensor of 10 um/s",
        change: |plant, strength, _| plant.effects.sensor_drift = 1e-5 * strength,
    },
    Outside {
        name: "load that grows by 300 N/s",
        change: |plant, strength, _| plant.effects.ramp_load = 300.0 * strength,
    },
    Outside {
        name: "hum of the sensor of 10 um at 50 Hz",
        change: |plant, strength, pace| plant.effects.sensor_hum = tone(1e-5 * strength, 50.0 * pace),
    },
    Outside {
        name: "load of 5e9 N/m3 times the cube of the position",
        change: |plant, strength, _| plant.effects.hardening_spring = 5e9 * strength,
    },
    Outside {
        name: "viscous friction that grows by 10 kN s/m for each s",
        change: |plant, strength, _| plant.effects.viscosity_growth = 1e4 * strength,
    },
];

/// More of it, which only drawn cases have.
pub(crate) static OUTSIDE_DRAWN: [Outside; 3] = [
    Outside {
        name: "dry friction that grows by 50 % for each s",
        change: |plant, strength, _| plant.effects.friction_growth = 0.5 * strength,
    },
    Outside {
        name: "gust of 600 N for 0.1 s",
        change: |plant, strength, pace| {
            plant.effects.gust = Gust { force: 600.0 * strength, start: 0.4 / pace, end: 0.4 / pace + 0.1 };
        },
    },
    Outside {
        name: "sensor error of 10 um that repeats every 2 mm",
        change: |plant, strength, pace| {
            (plant.effects.sensor_ripple, plant.effects.sensor_ripple_pitch) = (1e-5 * strength, 2e-3 / pace);
        },
    },
];

/// An effect of the catalogue in an actuator.
pub(crate) struct Presence {
    pub(crate) effect: &'static EffectInfo,
    /// Its size, in its floors.
    pub(crate) floors: f64,
    pub(crate) shape: Shape,
}

/// An actuator and how it is recorded.
pub(crate) struct Case {
    pub(crate) effects: Vec<Presence>,
    /// Something outside the catalogue, how strong, and how fast.
    pub(crate) outside: Option<(&'static Outside, [f64; 2])>,
    pub(crate) set: &'static ChannelSet,
    /// Seed of the noise.
    pub(crate) seed: u64,
    pub(crate) bkl: f64,
    pub(crate) fdj: f64,
    /// Noise of each measured channel.
    pub(crate) noise: [f64; Channel::MEASURED.len()],
    pub(crate) quantum: f64,
    pub(crate) train: [(Command, usize); 2],
    pub(crate) held: (Command, usize),
    pub(crate) program: Program,
}

/// How the program works that makes the records: others than the monitor's do as they please.
#[derive(Clone, Copy, Default)]
pub(crate) struct Program {
    /// What the commands do between the samples of their records.
    pub(crate) path: CommandPath,
    /// How much later than the first sample the command starts, s.
    pub(crate) later: f64,
    pub(crate) rule: Rule,
    /// Is there noise in the user position only, and none in the other channels?
    pub(crate) is_exact: bool,
    /// Last digit in which commands and positions are written, m; 0 where all are.
    pub(crate) last_digit: f64,
}

/// What the faults alone leave of noise-free records.
pub(crate) struct Left {
    pub(crate) chi_square: f64,
    pub(crate) count: u32,
    /// Largest residual of a channel, in units of the model's own error.
    pub(crate) largest: f64,
}

/// What a diagnosis says of a case.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// Nothing is claimed, and what is left is noise.
    Adequate,
    /// The right effects are named and no other, the widest class having so many members.
    Named(usize),
    /// The right effects are named, and others besides.
    Surplus,
    /// The right effects are not all among those named.
    Wrong,
    /// Something is left, and nothing is named.
    Unexplained,
    /// Terms bring the held-out record close to its noise.
    Modelled,
}

impl Outcome {
    /// Is something outside the catalogue called what it is, or modelled?
    pub(crate) fn is_right_of_outside(&self) -> bool {
        matches!(self, Self::Unexplained | Self::Modelled)
    }
}

/// A number between 0 and 1: a logistic curve is near enough to make a spread of cases of a normal deviate.
fn unit(random: &mut Gauss) -> f64 {
    1.0 / (1.0 + (-1.702 * random.draw()).exp())
}

impl Case {
    /// A case of effects (joined by `+`), of something of [`OUTSIDE`], or of nothing (empty). Faults, noise and the
    /// held-out command follow from the name and the seed.
    pub(crate) fn new(what: &'static str, size: f64, set: &'static ChannelSet, seed: u64) -> Self {
        let name: u64 = what.bytes().fold(7, |sum: u64, byte| sum.wrapping_mul(31) + u64::from(byte));
        let seed = name ^ (seed << 32);
        let mut random = Gauss::new(seed);
        let bkl = 5e-5 + 3e-4 * unit(&mut random);
        let fdj = 300.0 + 1200.0 * unit(&mut random);
        let position = 1e-6 + 9e-6 * unit(&mut random);
        let quantum = if unit(&mut random) > 0.7 { position } else { 0.0 };
        let commands = [Command::MixedStep, Command::Sine { amplitude: 3e-3, frequency: 2.5 }, Command::SINE];
        let held = commands[(unit(&mut random) * commands.len() as f64) as usize].clone();
        let effects = what.split('+').filter_map(EffectInfo::named);
        Self {
            effects: effects.map(|effect| Presence { effect, floors: size, shape: Shape::USUAL }).collect(),
            outside: OUTSIDE.iter().find(|outside| outside.name == what).map(|outside| (outside, [1.0; 2])),
            set,
            seed,
            bkl,
            fdj,
            noise: [position, position, 0.02, 5e4],
            quantum,
            train: [(Command::CHIRP, 1500), (Command::Mixed, 1500)],
            held: (held, 1200),
            program: Program::default(),
        }
    }

    /// The actuator with its faults and no effect.
    pub(crate) fn truth(&self) -> Truth {
        let mut truth = Truth::default();
        (truth.parameters.bkl, truth.parameters.fdj) = (self.bkl, self.fdj);
        truth
    }

    /// What the faults alone leave of noise-free training records of a truth.
    pub(crate) fn refit(&self, truth: &Truth) -> Left {
        let rig = Rig::load("eha").unwrap();
        let truth_rig = Rig { parameters: truth.parameters, ..rig.clone() };
        let noise = std::array::from_fn(|index| {
            if self.set.channels.contains(&Channel::MEASURED[index]) {
                self.noise[index]
            } else {
                f64::INFINITY
            }
        });
        let prepared: Vec<Prepared> = self
            .train
            .iter()
            .map(|(command, samples)| {
                let command: Vec<f64> = (0..*samples).map(|k| command.value(k as f64 * PERIOD)).collect();
                let channels =
                    vec![(Channel::Command, command.clone()), (Channel::UserPosition, command.clone())];
                let blank = Record::new("blank", PERIOD, 0.0, channels).unwrap();
                let outputs = fit::predict(
                    &truth_rig,
                    &[fit::prepare_with(&rig, &blank, [1e-6; Channel::MEASURED.len()])],
                )
                .concat();
                let mut channels = vec![(Channel::Command, command)];
                for (index, channel) in Channel::MEASURED.into_iter().enumerate() {
                    if self.set.channels.contains(&channel) {
                        let values = outputs.iter().map(|output| output.to_array()[index]).collect();
                        channels.push((channel, values));
                    }
                }
                let record = Record::new("noise-free", PERIOD, 0.0, channels).unwrap();
                fit::prepare_with(&rig, &record, noise)
            })
            .collect();
        let start = [truth.parameters.bkl, truth.parameters.fdj];
        let fit = fit::polish(&rig, &rig.faults, &start, &prepared).unwrap();
        let predictions = fit::predict(&fit.applied(&rig, &rig.faults), &prepared);
        let residuals = diagnose::residual::of_channels(&prepared, &predictions);
        let largest = residuals
            .iter()
            .zip(fit::MODEL_ERROR)
            .map(|(residual, error)| residual.map_or(0.0, |residual| residual.rms / error))
            .fold(0.0, f64::max);
        Left { chi_square: fit.misfit.chi_square, count: fit.misfit.count, largest }
    }

    /// The actuator with its faults and the effects that are of the catalogue.
    fn with_effects(&self) -> Truth {
        let mut truth = self.truth();
        for Presence { effect, floors, shape } in &self.effects {
            let size = floors * floor::of(effect, shape, self);
            for (parameter, value) in shape.values(effect, size) {
                truth.parameters.set(parameter, value);
            }
        }
        truth
    }

    fn plant(&self, truth: &Truth) -> Plant {
        let mut plant = Plant { rule: self.program.rule, ..plant(truth) };
        if let Some((outside, [strength, pace])) = self.outside {
            (outside.change)(&mut plant, strength, pace);
        }
        plant
    }

    /// The records: those that are fitted, and one that is held out.
    pub(crate) fn records(&self) -> [Record; 3] {
        let plant = self.plant(&self.with_effects());
        [0, 1, 2].map(|index| self.record(&plant, index))
    }

    fn record(&self, plant: &Plant, index: usize) -> Record {
        let (command, samples) = self.train.get(index).unwrap_or(&self.held);
        let command = &command.clone().later(self.program.later);
        let mut data = match self.program.path {
            CommandPath::Open | CommandPath::Lines => {
                plant.record(&command.sampled(*samples, PERIOD), *samples)
            }
            CommandPath::Curve => plant.simulate(command, *samples, DEFAULT_STEP),
            CommandPath::Held => plant.simulate(&command.held(*samples, PERIOD), *samples, DEFAULT_STEP),
        };
        let written = |values: &mut Vec<f64>| {
            if self.program.last_digit > 0.0 {
                quantise(values, self.program.last_digit);
            }
        };
        written(&mut data.command);
        let mut channels = vec![(Channel::Command, data.command.clone())];
        let series = [&mut data.lvdt, &mut data.ram, &mut data.current, &mut data.pressure];
        for (channel, (values, noise)) in
            Channel::MEASURED.into_iter().zip(series.into_iter().zip(self.noise))
        {
            let is_exact = self.program.is_exact && channel != Channel::UserPosition;
            let noise = if is_exact { 0.0 } else { noise };
            add_noise(values, noise, self.seed.wrapping_mul(1000) + index as u64 * 10 + channel as u64);
            if noise == self.noise[0] && self.quantum > 0.0 {
                quantise(values, self.quantum);
            }
            if Channel::POSITIONS.contains(&channel) {
                written(values);
            }
            if self.set.channels.contains(&channel) {
                channels.push((channel, values.clone()));
            }
        }
        Record::new(format!("record {index}"), PERIOD, 0.0, channels).unwrap()
    }

    /// Records the actuator and diagnoses it.
    pub(crate) fn diagnosed(&self) -> Diagnosed {
        let truth = self.with_effects();
        let rig = Rig::load("eha").unwrap();
        let records = self.records().map(|record| fit::prepare(&rig, &screen(&rig, &record).record));
        let case = diagnose::Case::new(&rig, &records, self.train.len());
        let diagnosis = diagnose::diagnose(&case, &FitSettings::default(), &|_| {});
        let flown = Rig { command_path: self.program.path, ..rig };
        let ahead = if self.program.later > 0.0 { 1.0 - self.program.later / PERIOD } else { 0.0 };
        let told = |record: &Prepared| {
            let record = record.along(&flown);
            record.with_jumps_ahead(record.jumps().into_iter().map(|jump| (jump, ahead)))
        };
        let records = records.iter().map(told).collect();
        Diagnosed { diagnosis, truth, records }
    }

    /// What a diagnosis says, judged by what is true; `asked` says which of the effects it must name.
    pub(crate) fn outcome(&self, diagnosis: &Diagnosis, asked: &[bool]) -> Outcome {
        let named: Vec<Vec<&str>> = diagnosis
            .found
            .iter()
            .filter(|found| found.named)
            .map(|found| found.class.iter().map(|effect| effect.name).collect())
            .collect();
        let is_named = |presence: &Presence| named.iter().any(|class| class.contains(&presence.effect.name));
        if diagnosis.verdict == Verdict::Adequate {
            Outcome::Adequate
        } else if named.is_empty() {
            Outcome::Unexplained
        } else if self.outside.is_some() {
            let held_out = diagnosis.holdout.map_or(f64::INFINITY, |[_, after]| after.position_rms());
            if held_out < MODELLED * diagnosis.noise[0] { Outcome::Modelled } else { Outcome::Wrong }
        } else {
            let mut missed =
                self.effects.iter().zip(asked).filter(|(present, asked)| **asked && !is_named(present));
            match (missed.next().is_none(), named.len() > self.effects.len()) {
                (false, _) => Outcome::Wrong,
                (true, true) => Outcome::Surplus,
                (true, false) => Outcome::Named(named.iter().map(Vec::len).max().unwrap_or(0)),
            }
        }
    }
}

/// A case that was diagnosed.
pub(crate) struct Diagnosed {
    pub(crate) diagnosis: Diagnosis,
    /// The actuator that was recorded, apart from what is outside the catalogue.
    pub(crate) truth: Truth,
    /// The records, their commands as they were: two that were fitted, and one that was held out.
    pub(crate) records: Vec<Prepared>,
}
