//! Where what is left acts: behind the loop, on the force side of the jack, or on its drive.
//!
//! The channels tell. What leaves the ram and the current alone, and the position behind them not, is behind the loop. Of what
//! is inside, the balance of forces on the jack tells the side: with a measured pressure, the pressure's residual must be what
//! the residual of the motion asks for by inertia and viscous friction. If it is, the equations of the jack hold, and what is
//! missing is in what drives it; if not, a force is.

use super::case::Case;
use super::residual;
use crate::fit::measured::{CURRENT, PRESSURE, RAM, USER};
use crate::fit::{MODEL_ERROR, Prepared};
use crate::rig::Rig;
use eha_monitor::model::Drive;
use eha_monitor::model::state::Outputs;

/// Where something acts that the model lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Behind the loop: in the linkage or its sensor.
    Sensor,
    /// On the force side of the jack: load, friction, inertia, or what the cylinder is mounted on.
    Force,
    /// On what drives the jack: controller, valve, oil.
    Drive,
    /// Inside the loop: no measured pressure tells whether as a force or in the drive.
    Loop,
}

impl Side {
    /// Name in results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sensor => "sensor",
            Self::Force => "force",
            Self::Drive => "drive",
            Self::Loop => "loop",
        }
    }

    /// For a person.
    pub const fn in_words(self) -> &'static str {
        match self {
            Self::Sensor => {
                "behind the loop, in the linkage or its sensor: the loop's own channels leave noise"
            }
            Self::Force => "as a force on the jack: the pressure is not what the motion needs",
            Self::Drive => "in what drives the jack: the pressure is what the motion needs",
            Self::Loop => "inside the loop; a measured dp_Pa tells whether as a force or in the drive",
        }
    }
}

/// Half width, s, over which a balance of forces is taken: long enough that the noise of a position is no acceleration, short
/// against the motion of a flight control.
const HALF_WIDTH_S: f64 = 0.01;
/// Standard deviations that the mean square of noise may be off.
const LIMIT: f64 = 5.0;
/// Fewest independent balances that tell anything.
const FEWEST: f64 = 10.0;

/// Where what a model leaves of the fitted records acts; none where they do not tell.
pub(super) fn of(case: &Case<'_>, rig: &Rig, predictions: &[Vec<Outputs<f64>>]) -> Option<Side> {
    let records = case.train();
    let residuals = residual::of_channels(records, predictions);
    let leaves_noise = |channel: usize| residuals[channel].map(|left| case.is_noise(channel, &left));
    let inside = [RAM, CURRENT, PRESSURE].map(leaves_noise);
    if inside.contains(&Some(false)) {
        return Some(match rig.form.drive {
            Drive::Force => Side::Force,
            Drive::Valve => balance(rig, records, predictions).unwrap_or(Side::Loop),
        });
    }
    let [ram, current, _] = inside;
    let is_watched = ram.or(current).is_some();
    (is_watched && leaves_noise(USER) == Some(false)).then_some(Side::Sensor)
}

/// The side that the balance of forces on the jack speaks for; none where no pressure is measured, or too little of a steady
/// motion.
///
/// The declared dry friction may be off to make up for what is missing: what goes with the direction of motion is taken out.
fn balance(rig: &Rig, records: &[Prepared], predictions: &[Vec<Outputs<f64>>]) -> Option<Side> {
    let p = &rig.parameters;
    let mut all: Vec<Balance> = Vec::new();
    let mut independent = 0.0;
    for (record, outputs) in records.iter().zip(predictions) {
        let position = if record.noise[RAM].is_finite() { RAM } else { USER };
        if !record.noise[PRESSURE].is_finite() {
            continue;
        }
        let period = record.sample_period;
        let half = ((HALF_WIDTH_S / period).round() as usize).max(1);
        let left = |channel: usize, sample: usize| {
            record.measured(channel)[sample] - outputs[sample].to_array()[channel]
        };
        let count = all.len();
        for sample in 2 * half..outputs.len().saturating_sub(2 * half) {
            let moved = |sample: usize| outputs[sample + 1].ram - outputs[sample - 1].ram;
            let direction = moved(sample).signum();
            let around = sample + 1 - 2 * half..sample + 2 * half - 1;
            let is_steady =
                around.clone().all(|sample| record.is_compared(sample) && moved(sample) * direction > 0.0);
            if !is_steady {
                continue;
            }
            let [before, here, after] = [sample - half, sample, sample + half].map(|at| left(position, at));
            let span = half as f64 * period;
            let acceleration = (after - 2.0 * here + before) / (span * span);
            let velocity = (after - before) / (2.0 * span);
            // The same triangle that a second difference weighs accelerations with.
            let weight = |at: usize| (half - at.abs_diff(sample)) as f64 / (half * half) as f64;
            let triangle = sample + 1 - half..sample + half;
            let pressure: f64 = triangle.clone().map(|at| weight(at) * left(PRESSURE, at)).sum();
            let weights: f64 = triangle.map(|at| weight(at).powi(2)).sum();
            let of_pressure = p.jack_area * record.noise[PRESSURE] * weights.sqrt();
            let of_acceleration = p.load_mass * record.noise[position] / (span * span) * 6.0_f64.sqrt();
            let force = p.jack_area * pressure - p.load_mass * acceleration - p.viscous_friction * velocity;
            if force.is_finite() {
                let noise = of_pressure.hypot(of_acceleration);
                all.push(Balance { direction, force, noise });
            }
        }
        independent += (all.len() - count) as f64 / (2 * half) as f64;
    }
    if independent < FEWEST {
        return None;
    }
    let by_friction =
        all.iter().map(|balance| balance.direction * balance.force).sum::<f64>() / all.len() as f64;
    let off = |balance: &Balance| balance.force - by_friction * balance.direction;
    let mean = |of: &dyn Fn(&Balance) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
    let (square, noise) = (mean(&|balance| off(balance).powi(2)), mean(&|balance| balance.noise.powi(2)));
    let own = (p.jack_area * MODEL_ERROR[PRESSURE]).powi(2);
    let is_balanced = square <= noise * (1.0 + LIMIT * (2.0 / independent).sqrt()) + own;
    Some(if is_balanced { Side::Drive } else { Side::Force })
}

/// What is left of the forces on the jack at a sample.
struct Balance {
    /// Direction of motion, -1 or 1.
    direction: f64,
    /// N.
    force: f64,
    /// Standard deviation of that by the noise of the sensors, N.
    noise: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::signature::tests::with;
    use crate::fit;
    use crate::record::Record;
    use eha_monitor::channel::Channel;
    use eha_monitor::parameter::Parameter;
    use rand_distr::{Distribution, Normal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    const PERIOD: f64 = 1e-3;
    const NOISE: [f64; 4] = [5e-6, 5e-6, 0.02, 2e4];

    /// Three seconds of a rig, with some of the channels.
    fn record(rig: &Rig, channels: &[Channel]) -> Prepared {
        let command: Vec<f64> = (0..3000).map(|k| 6e-3 * (8.0 * PERIOD * f64::from(k)).sin()).collect();
        let prepared = |columns: Vec<(Channel, Vec<f64>)>| {
            let all = [vec![(Channel::Command, command.clone())], columns].concat();
            let record = Record::new("made", PERIOD, 0.0, all).unwrap();
            let noise = std::array::from_fn(|index| {
                let is_there = record.channel(Channel::MEASURED[index]).is_some();
                if is_there { NOISE[index] } else { f64::INFINITY }
            });
            fit::prepare_with(rig, &record, noise)
        };
        let bare = prepared(vec![(Channel::UserPosition, command.clone())]);
        let outputs = fit::predict(rig, &[bare]).concat();
        let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
        let mut measured = |channel: Channel| {
            let index = Channel::MEASURED.iter().position(|known| *known == channel).unwrap();
            let normal = Normal::new(0.0, NOISE[index]).unwrap();
            let values = outputs.iter().map(|output| output.to_array()[index] + normal.sample(&mut random));
            (channel, values.collect())
        };
        prepared(channels.iter().map(|&channel| measured(channel)).collect())
    }

    #[test]
    fn the_channels_tell_where_something_acts() {
        use Channel::{Current, Pressure, RamPosition, UserPosition};
        let mut rig = Rig::load("eha").unwrap();
        (rig.parameters.bkl, rig.parameters.fdj) = (2e-4, 800.0);
        let acts = |parameter: Parameter, change: f64, channels: &[Channel]| {
            let records = [record(&with(&rig, parameter, change), channels)];
            let case = Case::new(&rig, &records, 1);
            of(&case, &rig, &fit::predict(&rig, &records))
        };
        let all = [UserPosition, RamPosition, Current, Pressure];
        for (parameter, change, side) in [
            (Parameter::SensorGain, 0.02, Side::Sensor),
            (Parameter::SensorOffset, 5e-5, Side::Sensor),
            (Parameter::ConstantLoad, 400.0, Side::Force),
            (Parameter::SpringLoad, 1e5, Side::Force),
            (Parameter::QuadraticDrag, 2e5, Side::Force),
            (Parameter::TorqueMotorHysteresis, 0.5, Side::Drive),
            (Parameter::TorqueMotorGain, -2e-3, Side::Drive),
            (Parameter::CurrentOffset, 0.5, Side::Drive),
        ] {
            assert_eq!(acts(parameter, change, &all), Some(side), "{parameter:?}");
            // Without a pressure it is not told which side of the jack, and without more than a position, nothing.
            let inside = if side == Side::Sensor { side } else { Side::Loop };
            assert_eq!(acts(parameter, change, &[UserPosition, Current]), Some(inside), "{parameter:?}");
            assert_eq!(acts(parameter, change, &[UserPosition]), None, "{parameter:?}");
        }
        // What makes up for a friction that is off is no force, and where noise is left, nothing acts.
        assert_eq!(acts(Parameter::CurrentOffset, 0.0, &all), None);
    }
}
