//! What goes over the line. The lists have fixed capacities: nothing is allocated on either side.

use crate::model::{Drive, Feedback, Form, ValveForm};
use crate::monitor::config::{Config, ConfigError, Fault};
use crate::monitor::report::Report;
use crate::parameter::{PARAMETERS, Parameter, ParameterInfo, Parameters};
use crate::trial::SensorNoise;
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Version of the messages themselves.
const FORMAT: u32 = 4;
/// What both sides of a line must share: the messages, and the names in the table of parameters, since these are told by
/// their places in it.
pub const VERSION: u32 = version(PARAMETERS);

const fn version(table: &[ParameterInfo]) -> u32 {
    let checksum = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);
    let mut names = checksum.digest();
    names.update(&FORMAT.to_le_bytes());
    let mut row = 0;
    while row < table.len() {
        names.update(table[row].name.as_bytes());
        // No name has a zero in it.
        names.update(&[0]);
        row += 1;
    }
    names.finalize()
}

/// Faults of a monitor behind a line.
pub const FAULTS: usize = 2;
/// Samples in a message. Two messages that are lost in a row are still bridged by the monitor.
pub const SAMPLES: usize = 10;
/// Parameters of a rig that may differ from the source's.
pub const CHANGES: usize = 32;
/// Bytes of the longest message, the configuration, before it is framed.
pub const LONGEST_PLAIN: usize = 16 + 6 * CHANGES + FAULTS * 17 + 40;

/// A fault that is watched.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FaultSetup {
    /// Its parameter, as the place in the table of parameters.
    pub parameter: u8,
    /// Range: smallest and largest value.
    pub range: [f32; 2],
    /// Healthy value and the one to be alarmed.
    pub levels: [f32; 2],
}

/// Everything that a monitor is told of its actuator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// [`VERSION`].
    pub version: u32,
    /// Places of valve form, feedback and drive in [`VALVES`], [`FEEDBACKS`] and [`DRIVES`].
    pub form: [u8; 3],
    /// Parameters that differ from the source's: place in the table of parameters, and value.
    pub changes: Vec<(u8, f32), CHANGES>,
    /// Sample period, s.
    pub sample_period: f32,
    /// Is the command held (1) or joined by straight lines (0)? See [`Config::holds_command`].
    pub holds_command: u8,
    /// Noise of user position, m, and current, mA.
    pub noise: [f32; 2],
    /// The faults.
    pub faults: [FaultSetup; FAULTS],
    /// See [`Config::false_alarm_rate`].
    pub false_alarm_rate: f32,
    /// Seed of the search.
    pub seed: u64,
    /// See [`Config::steps_per_sample`].
    pub steps_per_sample: u16,
}

/// Valve forms, by their number on the line.
pub const VALVES: [ValveForm; 3] = [ValveForm::TwoStage, ValveForm::StaticFlapper, ValveForm::FirstOrder];
/// Feedbacks, by their number on the line.
pub const FEEDBACKS: [Feedback; 2] = [Feedback::Ram, Feedback::User];
/// Drives, by their number on the line.
pub const DRIVES: [Drive; 2] = [Drive::Valve, Drive::Force];

impl Setup {
    /// The configuration as a message. None where more parameters differ from the source's, or more steps are allowed for a
    /// sample, than a message can hold.
    pub fn of(config: &Config<FAULTS>) -> Option<Self> {
        let source = Parameters::<f32>::default();
        let mut changes = Vec::new();
        for parameter in Parameter::all() {
            let value = config.parameters.get(parameter);
            if value.to_bits() != source.get(parameter).to_bits() {
                changes.push((parameter as u8, value)).ok()?;
            }
        }
        let place = |found: Option<usize>| found.map(|place| place as u8);
        let Form { valve, feedback, drive } = config.form;
        Some(Self {
            version: VERSION,
            form: [
                place(VALVES.iter().position(|&known| known == valve))?,
                place(FEEDBACKS.iter().position(|&known| known == feedback))?,
                place(DRIVES.iter().position(|&known| known == drive))?,
            ],
            changes,
            sample_period: config.sample_period,
            holds_command: u8::from(config.holds_command),
            noise: [config.noise.user, config.noise.current],
            faults: config.faults.map(|Fault { free, healthy, alarm }| FaultSetup {
                parameter: free.parameter as u8,
                range: [free.lower, free.upper],
                levels: [healthy, alarm],
            }),
            false_alarm_rate: config.false_alarm_rate,
            seed: config.seed,
            steps_per_sample: u16::try_from(config.steps_per_sample).ok()?,
        })
    }

    /// The configuration that the message stands for.
    ///
    /// # Errors
    /// It is of another version, or names what is not known.
    pub fn config(&self) -> Result<Config<FAULTS>, Refusal> {
        if self.version != VERSION {
            return Err(Refusal::Version(VERSION));
        }
        self.known().ok_or(Refusal::Unknown)
    }

    fn known(&self) -> Option<Config<FAULTS>> {
        let [valve, feedback, drive] = self.form.map(usize::from);
        let form = Form {
            valve: *VALVES.get(valve)?,
            feedback: *FEEDBACKS.get(feedback)?,
            drive: *DRIVES.get(drive)?,
        };
        let parameter = |place: u8| Parameter::at(place.into());
        let mut parameters = Parameters::default();
        for &(place, value) in &self.changes {
            parameters.set(parameter(place)?, value);
        }
        let fault = |setup: &FaultSetup| {
            let [healthy, alarm] = setup.levels;
            Some(Fault::new(parameter(setup.parameter)?, setup.range, healthy, alarm))
        };
        let [first, second] = &self.faults;
        Some(Config {
            form,
            parameters,
            sample_period: self.sample_period,
            holds_command: *[false, true].get(usize::from(self.holds_command))?,
            noise: SensorNoise { user: self.noise[0], current: self.noise[1] },
            faults: [fault(first)?, fault(second)?],
            false_alarm_rate: self.false_alarm_rate,
            seed: self.seed,
            steps_per_sample: self.steps_per_sample.into(),
        })
    }
}

/// To the monitor.
#[allow(clippy::large_enum_variant, reason = "nothing is allocated, and one message lives at a time")]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum ToMonitor {
    /// What the actuator is. The monitor starts anew and answers with [`FromMonitor::Ready`]; one that
    /// [refuses](FromMonitor::Refused) it goes on as it was.
    Setup(Setup),
    /// Samples: the tick of the first, and command, m, user position, m, and current, mA, of each.
    Samples(u32, Vec<[f32; 3], SAMPLES>),
    /// Asks for [`FromMonitor::Status`].
    Status,
    /// Ends the run, where the firmware can end.
    End,
}

/// A report as it goes over the line; see [`Report`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReportMessage {
    /// [`Report::window`], [`Report::first_tick`], [`Report::latency_samples`], [`Report::steps`],
    /// [`Report::evaluations`], [`Report::reversals`] and [`Report::skipped`].
    pub counts: [u32; 7],
    /// [`Report::verdict`].
    pub verdict: u8,
    /// Of each fault: value, standard error and evidence.
    pub faults: [[f32; 3]; FAULTS],
    /// Of each fault: is it informative, and alarmed?
    pub flags: [[bool; 2]; FAULTS],
    /// [`Report::residual_rms`], [`Report::noise`], [`Report::offset`].
    pub residual: [[f32; 2]; 3],
    /// [`Report::travel`].
    pub travel: f32,
    /// [`Report::exclusions`], in the order of its fields.
    pub exclusions: [u32; 7],
}

impl ReportMessage {
    /// A report as a message.
    pub fn of(report: &Report<FAULTS>) -> Self {
        Self {
            counts: [
                report.window,
                report.first_tick,
                report.latency_samples,
                report.steps,
                report.evaluations,
                report.reversals,
                report.skipped,
            ],
            verdict: report.verdict as u8,
            faults: report.faults.map(|fault| [fault.value, fault.standard_error, fault.evidence]),
            flags: report.faults.map(|fault| [fault.informative, fault.alarmed]),
            residual: [report.residual_rms, report.noise, report.offset],
            travel: report.travel,
            exclusions: report.exclusions.fields().map(|&count| count),
        }
    }
}

/// Why a monitor does not take a setup.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// It is of another version than the monitor's, which is this.
    Version(u32),
    /// It names a form or a parameter that the monitor does not know.
    Unknown,
    /// The monitor cannot work with the configuration.
    Config(ConfigError),
}

/// From the monitor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum FromMonitor {
    /// The monitor is configured.
    Ready,
    /// It does not take the configuration, and goes on as it was.
    Refused(Refusal),
    /// A window.
    Report(ReportMessage),
    /// What has happened so far.
    Status {
        /// Bytes, whole frames and damaged frames.
        received: [u32; 3],
        /// Samples, windows and skipped windows.
        monitor: [u32; 3],
        /// What was excluded, in the order of the fields of [`Exclusions`](crate::monitor::screen::Exclusions).
        exclusions: [u32; 7],
        /// Is each fault alarmed?
        alarms: [bool; FAULTS],
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    extern crate std;

    #[test]
    fn another_table_is_another_version() {
        let mut table = PARAMETERS.to_vec();
        assert_eq!(version(&table), VERSION);
        for row in 0..table.len() {
            for other in 0..row {
                table.swap(row, other);
                assert_ne!(version(&table), VERSION, "{row} {other}");
                table.swap(row, other);
            }
            let name = core::mem::replace(&mut table[row].name, "another");
            assert_ne!(version(&table), VERSION, "{name}");
            table[row].name = name;
        }
        assert_ne!(version(&table[1..]), VERSION);
    }
}
