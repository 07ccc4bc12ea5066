//! A rig: the actuator that a record comes from, as far as it is known.

mod builtin;
mod calibration;
mod command_path;
mod file;

pub use builtin::{BUILT_IN, BuiltIn};
pub use calibration::Calibration;
pub use command_path::{CommandPath, Knots};
pub use file::{read, spelled, write, write_whole};

use crate::failure::Failure;
use crate::output::own_range;
use eha_monitor::channel::{CHANNELS, Channel};
use eha_monitor::effect::{EFFECTS, EffectInfo};
use eha_monitor::model::drive::Law;
use eha_monitor::model::{Drive, Form, ValveForm};
use eha_monitor::parameter::{PARAMETERS, Parameter, Parameters};
use std::cmp::Reverse;

/// A parameter that a search may move, with its range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Which parameter.
    pub parameter: Parameter,
    /// Smallest value, in the parameter's unit.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
}

impl Range {
    /// A range after a check: inside the parameter's own range, and not empty.
    ///
    /// # Errors
    /// Names the parameter and the bound that is broken.
    pub fn new(parameter: Parameter, lower: f64, upper: f64) -> Result<Self, Failure> {
        let info = parameter.info();
        if !(lower < upper && lower >= info.lower && upper <= info.upper) {
            return Err(Failure::usage(format!(
                "range {lower} to {upper} of `{}`: expected lower < upper within {}",
                info.name,
                own_range(info)
            )));
        }
        Ok(Self { parameter, lower, upper })
    }

    /// What lies within a distance of a value and makes sense.
    pub fn around(parameter: Parameter, value: f64, half_width: f64) -> Self {
        let info = parameter.info();
        let (lower, upper) = ((value - half_width).max(info.lower), (value + half_width).min(info.upper));
        Self { parameter, lower, upper }
    }

    /// The same, wide enough to hold a value; none where that makes no sense.
    pub fn widened_to(&self, value: f64) -> Option<Self> {
        let info = self.parameter.info();
        let makes_sense = (info.lower..=info.upper).contains(&value);
        makes_sense.then(|| Self { lower: self.lower.min(value), upper: self.upper.max(value), ..*self })
    }

    /// A step of a width from a value, to the side on which the range goes on.
    pub fn inward(&self, value: f64, width: f64) -> f64 {
        if value + width > self.upper { -width } else { width }
    }

    /// Is a value that a search gave at the lower, at the upper edge, but for rounding?
    pub fn at_edge(&self, value: f64) -> [bool; 2] {
        let rounding = 1e-9 * (self.upper - self.lower);
        [value <= self.lower + rounding, value >= self.upper - rounding]
    }

    /// Is it at an edge beyond which the parameter may be?
    pub fn may_be_beyond(&self, value: f64) -> [bool; 2] {
        let ([below, above], info) = (self.at_edge(value), self.parameter.info());
        [below && self.lower > info.lower, above && self.upper < info.upper]
    }
}

/// Everything that is known of an actuator before a record is fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// Name, for the echo of a result.
    pub name: String,
    /// Structure of the model.
    pub form: Form,
    /// Values of all parameters.
    pub parameters: Parameters<f64>,
    /// How well those of them are known that were fitted to other records.
    pub calibration: Calibration,
    /// Known noise (standard deviation) of a channel, in the channel's unit; absent: estimated from the record.
    pub noise: Vec<(Channel, f64)>,
    /// Parameters that are declared as faults.
    pub faults: Vec<Range>,
    /// Parameters that stay free: `calibrate` frees them.
    pub free: Vec<Range>,
    /// Effects that were added to the model.
    pub effects: Vec<&'static EffectInfo>,
    /// The command of each record carries an unknown constant offset against the position: it is fitted with everything
    /// else, one for each record. False where such an offset would be a finding.
    pub command_offset: bool,
    /// What the command of a record does between its samples, where a valve drives: a known controller sees the samples
    /// alone.
    pub command_path: CommandPath,
    /// Open loop: the model starts anew from the measured state every so many seconds.
    pub restart_s: Option<f64>,
    /// The controller that drives a jack which a force moves, where it is known: the loop is closed then.
    pub controller: Option<Law<f64>>,
    /// Does the drive of a record keep the value of a sample until the next one, as that of a controller that samples
    /// does? If not it goes there in a straight line.
    pub drive_holds: bool,
}

impl Rig {
    /// The command of a record as the model takes it.
    pub fn knots(&self, command: &[f64]) -> Knots {
        let path = if self.form.drive == Drive::Valve { self.command_path } else { CommandPath::Lines };
        path.knots(command)
    }

    /// The rig of a name of [`BUILT_IN`] or of a TOML file.
    ///
    /// # Errors
    /// Usage: neither a built-in rig nor a readable file, or the file's content is wrong.
    pub fn load(name_or_path: &str) -> Result<Self, Failure> {
        if let Some(built_in) = BUILT_IN.iter().find(|built_in| built_in.name == name_or_path) {
            return Ok((built_in.make)());
        }
        read(std::path::Path::new(name_or_path))
    }

    /// Parameters that differ from the source's values.
    pub fn changed(&self) -> Vec<(Parameter, f64)> {
        Parameter::all()
            .map(|parameter| (parameter, self.parameters.get(parameter)))
            .filter(|&(parameter, value)| value != parameter.info().default)
            .collect()
    }

    /// Does it leave a parameter free?
    pub fn is_free(&self, parameter: Parameter) -> bool {
        self.free.iter().any(|range| range.parameter == parameter)
    }

    /// Does it declare a parameter as a fault, or leave it free?
    pub fn declares(&self, parameter: Parameter) -> bool {
        self.is_free(parameter) || self.faults.iter().any(|range| range.parameter == parameter)
    }

    /// What a diagnosis fits before it adds anything: the faults, then the other free parameters.
    pub fn declared(&self) -> Vec<Range> {
        let mut ranges = self.faults.clone();
        ranges.extend(
            self.free.iter().filter(|free| self.faults.iter().all(|fault| fault.parameter != free.parameter)),
        );
        ranges
    }

    /// The rig with a spool that sticks as soon as its driving force would not set it going; none where the rig does not
    /// leave open whether it does.
    pub fn with_sticking_spool(&self) -> Option<Self> {
        let p = &self.parameters;
        let is_free = self.declared().iter().any(|range| range.parameter == Parameter::SpoolRestRatio);
        let is_open = self.form.drive == Drive::Valve
            && self.form.valve != ValveForm::FirstOrder
            && p.spool_rest_ratio == Parameter::SpoolRestRatio.info().default
            && p.spool_friction_ratio > p.spool_rest_ratio
            && !is_free;
        let parameters = Parameters { spool_rest_ratio: p.spool_friction_ratio, ..*p };
        is_open.then(|| Self { parameters, ..self.clone() })
    }

    /// Does the spool stick as soon as its driving force would not set it going?
    pub fn has_sticking_spool(&self) -> bool {
        self.parameters.spool_rest_ratio >= self.parameters.spool_friction_ratio
    }

    /// The rig with values for the parameters of ranges.
    #[must_use]
    pub fn with_values(&self, ranges: &[Range], values: &[f64]) -> Self {
        let mut rig = self.clone();
        for (range, &value) in ranges.iter().zip(values) {
            rig.parameters.set(range.parameter, value);
        }
        rig
    }

    /// The rig with a spool that sticks when that of another one does.
    #[must_use]
    pub fn with_spool_of(&self, other: &Self) -> Self {
        let parameters =
            Parameters { spool_rest_ratio: other.parameters.spool_rest_ratio, ..self.parameters };
        Self { parameters, ..self.clone() }
    }

    /// The rig that reads records as another one does: what commands do between samples, and when a spool sticks.
    #[must_use]
    pub fn reading_as(&self, other: &Self) -> Self {
        Self { command_path: other.command_path, ..self.with_spool_of(other) }
    }

    /// The rig without its controller: in open loop.
    #[must_use]
    pub fn opened(&self) -> Self {
        Self { controller: None, ..self.clone() }
    }

    /// The channels that its model can say something of: behind a force there is neither a current nor a pressure.
    pub fn measurable(&self) -> &'static [Channel] {
        match self.form.drive {
            Drive::Valve => &Channel::MEASURED,
            Drive::Force => &Channel::POSITIONS,
        }
    }

    /// Known noise of a channel, in its unit.
    pub fn noise_of(&self, channel: Channel) -> Option<f64> {
        self.noise.iter().find(|(known, _)| *known == channel).map(|&(_, noise)| noise)
    }
}

/// The parameter of a name or symbol.
///
/// # Errors
/// Usage: no such parameter; the message suggests the nearest name.
pub fn parameter_named(name: &str) -> Result<Parameter, Failure> {
    Parameter::named(name).ok_or_else(|| {
        let names = PARAMETERS.iter().flat_map(|row| [row.name, row.symbol]);
        Failure::usage(unknown("parameter", name, names))
    })
}

/// The channel of a column name.
///
/// # Errors
/// Usage: no such column.
pub fn channel_named(column: &str) -> Result<Channel, Failure> {
    CHANNELS
        .iter()
        .find(|row| row.column == column)
        .map(|row| row.channel)
        .ok_or_else(|| Failure::usage(unknown("channel", column, CHANNELS.iter().map(|row| row.column))))
}

/// The effect of a name.
///
/// # Errors
/// Usage: no such effect; the message suggests the nearest name.
pub fn effect_named(name: &str) -> Result<&'static EffectInfo, Failure> {
    EffectInfo::named(name)
        .ok_or_else(|| Failure::usage(unknown("effect", name, EFFECTS.iter().map(|row| row.name))))
}

/// Most names that a message lists.
const MOST_LISTED: usize = 12;

/// Says that a name is not known, and which known one is nearest; where none is near, all of them if they are few.
pub fn unknown<'a>(kind: &str, name: &str, known: impl Iterator<Item = &'a str>) -> String {
    let message = format!("unknown {kind} `{name}`");
    let names: Vec<&str> = known.collect();
    if let Some(nearest) = nearest(name, names.iter().copied()) {
        return format!("{message}; did you mean `{nearest}`?");
    }
    if names.len() > MOST_LISTED {
        message
    } else {
        format!("{message}, expected one of {}", names.join(", "))
    }
}

/// A message about a name, with the known one that is nearest, if it is near.
fn with_nearest<'a>(message: String, name: &str, known: impl Iterator<Item = &'a str>) -> String {
    match nearest(name, known) {
        Some(nearest) => format!("{message}; did you mean `{nearest}`?"),
        None => message,
    }
}

/// The known name that is nearest to another one, if it is near: that starts with it, or that a slip of the fingers or
/// two make of it, at most one in three letters.
fn nearest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let lower = name.to_lowercase();
    let is_start = |known: &str| lower.chars().count() >= 3 && known.to_lowercase().starts_with(&lower);
    let distance = |known: &str| strsim::osa_distance(&lower, &known.to_lowercase());
    let is_near = |known: &&str| {
        let letters = lower.chars().count().max(known.chars().count());
        is_start(known) || 3 * distance(known) <= letters
    };
    known.filter(|known| !known.is_empty()).filter(is_near).min_by_key(|known| {
        let common = lower.chars().zip(known.to_lowercase().chars()).take_while(|(a, b)| a == b).count();
        // Of names that are equally near, the first letters decide, then the case.
        (!is_start(known), distance(known), Reverse(common), strsim::osa_distance(name, known))
    })
}
