//! A case: an actuator with faults and effects, recorded by the plant, and what the diagnosis makes of it.

use crate::common::{Rig as Truth, plant};
use crate::floor;
use eha_monitor::channel::Channel;
use eha_monitor::parameter::Parameter;
use host_sim::diagnose::{self, Diagnosis};
use host_sim::fit::{self, FitSettings, Prepared};
use host_sim::record::Record;
use host_sim::rig::Rig;
use reference_plant::{Command, Gauss, Tone, add_noise};
use std::fmt::Write as _;
use std::time::Instant;

/// Sample period, s.
pub(crate) const PERIOD: f64 = 1e-3;

/// A set of channels that a record has.
pub(crate) struct ChannelSet {
    pub(crate) name: &'static str,
    pub(crate) channels: &'static [Channel],
}

/// The sets that are studied.
pub(crate) const CHANNEL_SETS: [ChannelSet; 3] = [
    ChannelSet { name: "position", channels: &[Channel::UserPosition] },
    ChannelSet { name: "position, current", channels: &[Channel::UserPosition, Channel::Current] },
    ChannelSet { name: "all", channels: &Channel::MEASURED },
];

/// An actuator and how it is recorded.
pub(crate) struct Case {
    pub(crate) effects: Vec<String>,
    pub(crate) size: f64,
    pub(crate) set: &'static ChannelSet,
    pub(crate) seed: u64,
    bkl: f64,
    fdj: f64,
    /// Noise of each measured channel.
    pub(crate) noise: [f64; 4],
    quantum: f64,
    train: [(Command, usize); 2],
    held: (Command, usize),
}

pub(crate) struct Outcome {
    pub(crate) right: bool,
    pub(crate) diagnosis: Diagnosis,
    floor: f64,
    truth: Truth,
    seconds: f64,
    /// Held-out error of the true model.
    best: f64,
}

fn unit(random: &mut Gauss) -> f64 {
    // The integral of a normal deviate is uniform; a logistic one is near enough for a spread of cases.
    1.0 / (1.0 + (-1.702 * random.draw()).exp())
}

impl Case {
    pub(crate) fn new(effects: &str, size: f64, set: &'static ChannelSet, seed: u64) -> Self {
        let mut hash = 1469598103934665603_u64;
        for byte in effects.bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(1099511628211);
        }
        let mut random = Gauss::new(hash ^ seed.wrapping_mul(0x9e37));
        let bkl = 5e-5 + 3e-4 * unit(&mut random);
        let fdj = 300.0 + 1200.0 * unit(&mut random);
        let position = 1e-6 + 9e-6 * unit(&mut random);
        let quantum = if unit(&mut random) > 0.7 { position } else { 0.0 };
        let held = [Command::MixedStep, Command::Sine { amplitude: 3e-3, frequency: 2.5 }, Command::SINE]
            [(3.0 * unit(&mut random)) as usize]
            .clone();
        Self {
            effects: effects.split('+').map(str::to_owned).collect(),
            size,
            set,
            seed,
            bkl,
            fdj,
            noise: [position, position, 0.02, 5e4],
            quantum,
            train: [(Command::CHIRP, 1500), (Command::Mixed, 1500)],
            held: (held, 1200),
        }
    }

    pub(crate) fn truth(&self) -> Truth {
        let mut truth = Truth::default();
        truth.parameters.bkl = self.bkl;
        truth.parameters.fdj = self.fdj;
        truth
    }

    /// Misfit that the faults alone leave on noise-free training records of a truth, its number of terms, and the largest
    /// residual of a channel in units of the model's error.
    pub(crate) fn refit(&self, truth: &Truth) -> (f64, u32, f64) {
        let rig = Rig::load("eha").unwrap();
        let truth_rig = Rig { parameters: truth.parameters, ..rig.clone() };
        let prepared: Vec<Prepared> = self
            .train
            .iter()
            .map(|(command, samples)| {
                let command: Vec<f64> = (0..*samples).map(|k| command.value(k as f64 * PERIOD)).collect();
                let channels =
                    vec![(Channel::Command, command.clone()), (Channel::UserPosition, command.clone())];
                let blank = Record::new("blank", PERIOD, 0.0, channels).unwrap();
                let outputs = fit::predict(&truth_rig, &[fit::prepare(&rig, &blank, 1e-6)]).concat();
                let mut channels = vec![(Channel::Command, command)];
                for (index, channel) in Channel::MEASURED.into_iter().enumerate() {
                    if self.set.channels.contains(&channel) {
                        channels
                            .push((channel, outputs.iter().map(|output| output.to_array()[index]).collect()));
                    }
                }
                fit::prepare(&rig, &Record::new("noise-free", PERIOD, 0.0, channels).unwrap(), self.noise[0])
            })
            .collect();
        let noise = std::array::from_fn(|index| {
            if self.set.channels.contains(&Channel::MEASURED[index]) {
                self.noise[index]
            } else {
                f64::INFINITY
            }
        });
        let start = vec![truth.parameters.bkl, truth.parameters.fdj];
        let fit = fit::polish(&rig, &rig.faults, start, &prepared, noise).unwrap();
        let fitted = Rig { parameters: fit.applied(&rig, &rig.faults).parameters, ..rig.clone() };
        let residuals = diagnose::residual::of_channels(&prepared, &fit::predict(&fitted, &prepared));
        let matter = residuals.iter().zip(diagnose::residual::MODEL_ERROR);
        let largest =
            matter.map(|(residual, error)| residual.map_or(0.0, |r| r.rms / error)).fold(0.0, f64::max);
        (fit.misfit.chi_square, fit.misfit.count, largest)
    }

    fn record(&self, plant: &reference_plant::Plant, which: usize) -> Record {
        let (command, samples) = match which {
            2 => &self.held,
            which => &self.train[which],
        };
        let mut data = plant.record(&command.sampled(*samples, PERIOD), *samples);
        let seed = self.seed * 1000 + which as u64 * 10;
        if self.effects[0] == "rate-noise" {
            data.add_rate_noise(3e-4, PERIOD, seed + 7);
        }
        let mut channels = vec![(Channel::Command, data.command.clone())];
        let series = [&mut data.lvdt, &mut data.ram, &mut data.current, &mut data.pressure];
        for (index, (channel, values)) in Channel::MEASURED.into_iter().zip(series).enumerate() {
            add_noise(values, self.noise[index], seed + index as u64);
            if index < 2 && self.quantum > 0.0 {
                reference_plant::quantise(values, self.quantum);
            }
            if self.set.channels.contains(&channel) {
                channels.push((channel, values.clone()));
            }
        }
        Record::new(format!("record {which}"), PERIOD, 0.0, channels).unwrap()
    }

    pub(crate) fn diagnose(&self) -> Outcome {
        let mut truth = self.truth();
        let mut plant_effects = reference_plant::Effects::default();
        let mut floor = f64::NAN;
        let mut open = false;
        for effect in &self.effects {
            match effect.as_str() {
                "clean" => {}
                "tone" => {
                    plant_effects.disturbance =
                        Tone { amplitude: 800.0 * self.size, frequency: 9.0, phase: 0.3 }
                }
                "tone-slow" => {
                    plant_effects.disturbance =
                        Tone { amplitude: 800.0 * self.size, frequency: 2.2, phase: 0.3 }
                }
                "drift" => plant_effects.sensor_drift = 1e-5 * self.size,
                "detent" => {
                    plant_effects.detent_force = 800.0 * self.size;
                    plant_effects.detent_pitch = 2e-3;
                }
                "ramp-load" => plant_effects.ramp_load = 300.0 * self.size,
                "rate-noise" => {}
                name => {
                    let effect = eha_monitor::effect::EffectInfo::named(name).expect(name);
                    floor = floor::of(effect, self);
                    for (parameter, value) in floor::values(effect, floor * self.size) {
                        truth.parameters.set(parameter, value);
                    }
                    continue;
                }
            }
            open |= effect != "clean";
        }
        let mut plant = plant(&truth);
        plant.effects.disturbance = plant_effects.disturbance;
        plant.effects.sensor_drift = plant_effects.sensor_drift;
        plant.effects.detent_force = plant_effects.detent_force;
        plant.effects.detent_pitch = plant_effects.detent_pitch;
        plant.effects.ramp_load = plant_effects.ramp_load;
        let records: Vec<Record> = (0..3).map(|which| self.record(&plant, which)).collect();
        let started = Instant::now();
        let rig = Rig::load("eha").unwrap();
        let (noise, _) = fit::estimate(&rig, &records[..2]);
        let prepared: Vec<Prepared> =
            records.iter().map(|record| fit::prepare(&rig, record, noise[0])).collect();
        let case = diagnose::Case { rig: &rig, records: &prepared, fitted: 2, noise, known_noise: [None; 4] };
        let diagnosis = diagnose::diagnose(&case, &FitSettings::default(), &|_, _| {});
        let seconds = started.elapsed().as_secs_f64();
        let named = |wanted: &str| {
            diagnosis
                .found
                .iter()
                .any(|found| found.named && found.class.iter().any(|effect| effect.name == wanted))
        };
        let verdict = diagnosis.verdict.name();
        let none = !diagnosis.found.iter().any(|found| found.named);
        let after = diagnosis.holdout.unwrap()[1].position_rms;
        let right = if self.effects == ["clean"] {
            verdict == "adequate"
        } else if open {
            (verdict == "unexplained" && none) || after < 1.5 * noise[0]
        } else {
            self.effects.iter().all(|effect| named(effect)) && verdict == "explained"
        };
        let best = {
            let truth_rig = Rig { parameters: truth.parameters, ..rig.clone() };
            let predictions = fit::predict(&truth_rig, &prepared[2..]);
            let residual = diagnose::residual::series(&prepared[2..], &predictions, 0).concat();
            (residual.iter().map(|x| x * x).sum::<f64>() / residual.len() as f64).sqrt()
        };
        Outcome { right, diagnosis, floor, truth, seconds, best }
    }
}

impl Outcome {
    pub(crate) fn line(&self, case: &Case) -> String {
        let d = &self.diagnosis;
        let mut text = format!(
            "{} {:<26} x{:<4} {:<18} seed {} noise {:.1}{} floor {:<9.3e} {:<11} ",
            if self.right { "ok " } else { "BAD" },
            case.effects.join("+"),
            case.size,
            case.set.name,
            case.seed,
            case.noise[0] * 1e6,
            if case.quantum > 0.0 { "q" } else { " " },
            self.floor,
            d.verdict.name(),
        );
        let held = d.holdout.unwrap();
        let _ = write!(
            text,
            "held {:.2}->{:.2} (truth {:.2}) um ",
            held[0].position_rms * 1e6,
            held[1].position_rms * 1e6,
            self.best * 1e6
        );
        for (parameter, fault) in [Parameter::Backlash, Parameter::DryFriction].into_iter().zip(&d.faults) {
            let truth = self.truth.parameters.get(parameter);
            let e = &fault.estimate;
            let _ = write!(
                text,
                "{} {:+.2}% ({:+.1}s) ",
                e.parameter.info().name,
                (e.value / truth - 1.0) * 100.0,
                (e.value - truth) / e.standard_error
            );
        }
        for found in &d.found {
            let names: Vec<&str> = found.class.iter().map(|effect| effect.name).collect();
            let _ = write!(
                text,
                "[{}{} ev {:.0} {:.3e}] ",
                if found.named { "" } else { "~" },
                names.join(" "),
                found.evidence,
                found.estimates[0].value
            );
        }
        let _ = write!(text, "{:.1} s", self.seconds);
        text
    }
}
