//! What a monitor is told of its actuator, checked once.

use super::SETTLE;
use super::window::Scale;
use crate::fit::problem::Free;
use crate::integrate::{LONGEST_PIECE, Stepper};
use crate::model::sensor::Lvdt;
use crate::model::state::{FULL_ORDER, State};
use crate::model::{Drive, Form, Model};
use crate::parameter::{Parameter, Parameters, Reach};
use crate::trial::SensorNoise;
use core::error::Error;
use core::fmt;
use serde::{Deserialize, Serialize};

/// Noise of a position sensor below which the model's own error would count, m.
const LEAST_USER_NOISE: f32 = 1e-7;
/// Noise of a current below which the model's own error would count, mA.
const LEAST_CURRENT_NOISE: f32 = 1e-3;

/// A gene at which every effect is present: at no end of its range, nor in the middle.
const PRESENT: f32 = 0.375;
/// Largest value of a state, in any of its units: pressures come to 1e9 Pa, nothing else comes near.
const LARGEST: f32 = 1e10;
/// What may be left of an entry that nothing moves: in metres, far below the noise.
const RESIDUE: f32 = 1e-6;
/// Lags after which a sensor has forgotten all but 5e-5 of where it was: 0.1 um where a ram at 0.2 m/s is 2 mm ahead.
const LAGS: f32 = 10.0;
/// Part of a bound by which a value may lie beyond it.
const ROUNDING: f32 = 1e-6;

/// A fault that is watched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fault {
    /// Parameter that grows with the fault, and its range.
    pub free: Free<f32>,
    /// Largest value of a healthy actuator, in the parameter's unit.
    pub healthy: f32,
    /// Value that must be alarmed: larger than `healthy`.
    pub alarm: f32,
}

impl Fault {
    /// A parameter that is watched within a range, lower and upper end: the largest healthy value and the one that must be
    /// alarmed, all in its unit. [`Config::check`] says whether they go together.
    pub const fn new(parameter: Parameter, [lower, upper]: [f32; 2], healthy: f32, alarm: f32) -> Self {
        Self { free: Free { parameter, lower, upper }, healthy, alarm }
    }
}

/// What a monitor is told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Config<const FAULTS: usize> {
    /// Structure of the model.
    pub form: Form,
    /// Parameters of the model, each in its range; the values of the faults are not used.
    pub parameters: Parameters<f32>,
    /// Sample period, s: 0.1 to 10 ms.
    pub sample_period: f32,
    /// Does the command keep the value of a sample until the next one, as a converter does? Otherwise it goes from sample
    /// to sample in straight lines.
    pub holds_command: bool,
    /// Noise of the sensors; a current whose noise is not finite is not used.
    ///
    /// One that is stated 8 % smaller than it is, in windows of 1000 samples with both channels, makes half of all windows
    /// [inadequate](super::report::Verdict::ModelInadequate), 12 % nearly all of them, and these are no evidence for an
    /// alarm: the mean square may be `1 + 5 sqrt(2/n)` for `n` compared values. One that is stated larger only costs sensitivity. The
    /// [residual](super::report::Report::residual_rms) of windows of a healthy actuator is what to state, and a few percent
    /// more.
    pub noise: SensorNoise<f32>,
    /// The faults.
    pub faults: [Fault; FAULTS],
    /// Chance of a false alarm in a window of a healthy actuator, 0 to 1 exclusive.
    pub false_alarm_rate: f32,
    /// Seed of the search.
    pub seed: u64,
    /// Steps of the model that it may take for each sample, at least 1: as many as [`Monitor::work`](super::Monitor::work) is
    /// allowed. An analysis ends before the next window is full, with what it has found by then, but for a first look, which
    /// it always takes. `u32::MAX` lets every search come to its end.
    pub steps_per_sample: u32,
}

/// Why a configuration is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum ConfigError {
    /// The sample period is not between 0.1 and 10 ms.
    SamplePeriod,
    /// A noise is not positive.
    Noise,
    /// The rate of false alarms is not between 0 and 1.
    FalseAlarmRate,
    /// The range of a fault is empty, or leaves that in which its parameter makes sense, or its healthy and alarmed values do
    /// not lie in it in this order. A delay of the sensor goes no further than the delay line.
    Range(Parameter),
    /// The parameter of a fault reaches the transition matrices, which would have to be made anew for each candidate.
    Reach(Parameter),
    /// The parameter of a fault is the offset of a sensor, which is taken out before the fit: no window would tell of it.
    Offset(Parameter),
    /// No step of the model is allowed for a sample: nothing would ever be said.
    Steps,
    /// The model needs an input that a stream does not have: a driving force, or the time of a step load, which is no fault
    /// either.
    Input,
    /// A parameter is not in the range in which it makes sense.
    Parameter(Parameter),
    /// Two faults are the same parameter.
    Twice(Parameter),
    /// The monitor's steps cannot take the model.
    Model,
    /// The sensor remembers longer than a window settles, which starts as if it had been at rest: its lag may be 10 ms less
    /// a tenth of its delay, each at its largest, and less where a window is short.
    SensorMemory,
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::SamplePeriod => f.write_str("the sample period is not between 0.1 and 10 ms"),
            Self::Noise => {
                f.write_str("the noise of the position is not a positive number, or that of the current")
            }
            Self::FalseAlarmRate => f.write_str("the rate of false alarms is not between 0 and 1"),
            Self::Steps => f.write_str("no step of the model is allowed for a sample"),
            Self::Range(parameter) => {
                let name = parameter.info().name;
                write!(
                    f,
                    "the healthy value of `{name}` is not below the alarmed one, or they leave its range, or that makes no sense"
                )
            }
            Self::Reach(parameter) => {
                let name = parameter.info().name;
                write!(
                    f,
                    "`{name}` cannot be watched: every value of it needs transition matrices of its own"
                )
            }
            Self::Offset(parameter) => {
                let name = parameter.info().name;
                write!(f, "`{name}` cannot be watched: the offsets of sensors are taken out of each window")
            }
            Self::Input => {
                f.write_str("the model is driven by a force, or has a step load: a stream has neither")
            }
            Self::Parameter(parameter) => {
                write!(f, "the value of `{}` is out of its range", parameter.info().name)
            }
            Self::Twice(parameter) => write!(f, "`{}` is watched twice", parameter.info().name),
            Self::Model => f.write_str("the steps of this monitor cannot take the model"),
            Self::SensorMemory => f.write_str(
                "`sensor_lag` is more than 10 ms less a tenth of `sensor_delay`, each at its largest: a window does not settle",
            ),
        }
    }
}

impl Error for ConfigError {}

/// Is a value in the range of its parameter?
fn makes_sense(parameter: Parameter, value: f32) -> bool {
    let [lower, upper] = parameter.range::<f32>();
    // What single precision makes of a bound may lie beyond it by a few parts in ten million; of zero it makes zero.
    value >= lower - ROUNDING * lower.abs() && value <= upper + ROUNDING * upper.abs()
}

impl<const FAULTS: usize> Config<FAULTS> {
    /// Chance of a false alarm in a window unless another is stated: one in 12 days of windows of a second.
    pub const FALSE_ALARM_RATE: f32 = 1e-6;

    /// Looks for what a monitor could not work with.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn check(&self) -> Result<(), ConfigError> {
        if !(self.sample_period >= 0.99e-4 && self.sample_period <= 1.01e-2) {
            return Err(ConfigError::SamplePeriod);
        }
        if !(self.noise.user > 0.0 && self.noise.user.is_finite() && self.noise.current > 0.0) {
            return Err(ConfigError::Noise);
        }
        if !(self.false_alarm_rate > 0.0 && self.false_alarm_rate < 1.0) {
            return Err(ConfigError::FalseAlarmRate);
        }
        if self.steps_per_sample == 0 {
            return Err(ConfigError::Steps);
        }
        if self.form.drive == Drive::Force || self.parameters.step_load != 0.0 {
            return Err(ConfigError::Input);
        }
        for parameter in Parameter::all() {
            if !makes_sense(parameter, self.parameters.get(parameter)) {
                return Err(ConfigError::Parameter(parameter));
            }
        }
        if self.parameters.sensor_delay > Lvdt::longest_delay(self.sample_period) {
            return Err(ConfigError::Parameter(Parameter::SensorDelay));
        }
        for Fault { free, healthy, alarm } in &self.faults {
            let is_step = matches!(free.parameter, Parameter::StepLoad | Parameter::StepLoadTime);
            if is_step {
                return Err(ConfigError::Input);
            }
            let makes_sense = [free.lower, free.upper].iter().all(|&end| makes_sense(free.parameter, end));
            let inside = |value: f32| value >= free.lower && value <= free.upper;
            let is_ordered = free.lower < free.upper && healthy < alarm && inside(*healthy) && inside(*alarm);
            let is_too_late = free.parameter == Parameter::SensorDelay
                && free.upper > Lvdt::longest_delay(self.sample_period);
            if !makes_sense || !is_ordered || is_too_late {
                return Err(ConfigError::Range(free.parameter));
            }
            if Model::<f32>::reach(self.form, free.parameter) == Reach::Dynamics {
                return Err(ConfigError::Reach(free.parameter));
            }
            if matches!(free.parameter, Parameter::SensorOffset | Parameter::CurrentOffset) {
                return Err(ConfigError::Offset(free.parameter));
            }
            if self.faults.iter().filter(|other| other.free.parameter == free.parameter).count() > 1 {
                return Err(ConfigError::Twice(free.parameter));
            }
        }
        if self.forgets_sensor(SETTLE) { Ok(()) } else { Err(ConfigError::SensorMemory) }
    }

    /// Largest magnitude that a parameter may have, in its unit.
    #[inline(never)]
    pub(super) fn largest(&self, parameter: Parameter) -> f32 {
        let fault = self.faults.iter().find(|fault| fault.free.parameter == parameter);
        let known = self.parameters.get(parameter);
        let [lower, upper] = fault.map_or([known; 2], |fault| [fault.free.lower, fault.free.upper]);
        upper.abs().max(lower.abs())
    }

    /// Most steps of the model that the analysis of a window of a number of samples takes: nine tenths of what comes with them.
    /// A call may leave what is less than the longest piece, and saves that only where it is allowed less.
    pub(super) fn most_steps(&self, samples: usize) -> u32 {
        const LEFT: u32 = LONGEST_PIECE - 1;
        let allowed = self.steps_per_sample;
        let taken = if allowed > LEFT { allowed - LEFT } else { allowed };
        taken.saturating_mul(samples as u32) / 10 * 9
    }

    /// How far the ram may be from zero, m: a quarter beyond its stop.
    pub(super) fn reach(&self) -> f32 {
        1.25 * self.parameters.jack_stop
    }

    /// What a window takes: all that the sensor may make of a user position.
    #[inline(never)]
    pub(super) fn scale(&self) -> Scale {
        // The quarter holds most backlashes.
        let user = self.reach().max(self.parameters.jack_stop + self.largest(Parameter::Backlash));
        let gain = 1.0 + self.largest(Parameter::SensorGain);
        let bent = 1.0 + self.largest(Parameter::SensorCubic) * user * user;
        let position = self.largest(Parameter::SensorOffset) + gain * user * bent;
        Scale::of(position, self.parameters.current_limit)
    }

    /// Has the sensor forgotten where it was at the start of a window, a time (s) after it?
    pub(super) fn forgets_sensor(&self, settle: f32) -> bool {
        let (lag, delay) = (self.largest(Parameter::SensorLag), self.largest(Parameter::SensorDelay));
        // Half a sample is what the number of them that settle is rounded by.
        LAGS * lag + delay <= settle + 0.5 * self.sample_period
    }

    /// Can steps take the model, whatever the faults? An effect may be absent at one value of its parameter, and curves the
    /// model or adds a state at every other: at an end of the range, or in the middle of one that goes both ways.
    #[inline]
    pub fn suits<S: Stepper<f32>>(&self, stepper: &S) -> bool {
        self.suits_at(0.0, stepper) && self.suits_at(PRESENT, stepper) && self.suits_at(1.0, stepper)
    }

    /// The same where every gene has a value. Not inlined: otherwise the stack would hold a model while the rest is done.
    #[inline(never)]
    fn suits_at<S: Stepper<f32>>(&self, gene: f32, stepper: &S) -> bool {
        stepper.takes(&self.model(&[gene; FAULTS]))
    }

    /// How far each entry of a state may be from zero: a quarter beyond its stop; base and sag next to nothing where no
    /// effect moves them, since the model looks at them all the same.
    #[inline(never)]
    pub(super) fn bounds(&self) -> State<f32> {
        let model = self.model(&[PRESENT; FAULTS]);
        let base = if model.jack.is_mounted() { LARGEST } else { RESIDUE };
        let sag = if model.parameters().supply_sag == 0.0 { RESIDUE } else { LARGEST };
        State {
            spool: 1.25 * self.parameters.spool_stop,
            ram: self.reach(),
            sag,
            base,
            base_velocity: base,
            ..State::from_array([LARGEST; FULL_ORDER])
        }
    }

    /// Noise of user position and current, not below the model's own error.
    pub(super) fn believed_noise(&self) -> [f32; 2] {
        [self.noise.user.max(LEAST_USER_NOISE), self.noise.current.max(LEAST_CURRENT_NOISE)]
    }

    /// The model of a set of genes. Not inlined: two places would hold it.
    #[inline(never)]
    pub(super) fn model(&self, genes: &[f32; FAULTS]) -> Model<f32> {
        let mut parameters = self.parameters;
        self.set(&mut parameters, genes);
        Model::new(self.form, &parameters)
    }

    /// Sets the parameters that are faults to a set of genes.
    pub(super) fn set(&self, parameters: &mut Parameters<f32>, genes: &[f32; FAULTS]) {
        for (fault, &gene) in self.faults.iter().zip(genes) {
            parameters.set(fault.free.parameter, fault.free.value(gene));
        }
    }
}
