//! Reference plant: the equations of the actuator, written a second time and integrated by brute force.
//!
//! It is used by tests only and shares no code with the monitor, so that agreement between the two means something.
//!
//! The method is the explicit midpoint rule at 2 µs. The stiffest mode of the source's parameters is
//! `MJ/(AJ²·GPQ)` = 62 µs, so every mode is resolved. Stick, slide and reversal are located within a step, which
//! keeps the second order across events; `tests/convergence.rs` holds the measured error. Other programs step as the
//! source does: [`Rule::SemiImplicitEuler`] stands for them.
mod command;
mod parameters;
mod physics;
mod record;
mod simulate;

pub use command::Command;
pub use parameters::{Effects, Feedback, Gust, Mount, Parameters, Tone, Valve};
pub use physics::{blended_pressure, play};
pub use record::{Gauss, Record, add_filtered_noise, add_noise, quantise, rms_difference};
pub use simulate::{DEFAULT_STEP, Rule, SAMPLE_PERIOD};

/// An actuator: the source's parameters, and the effects that its model leaves out.
///
/// ```
/// use reference_plant::{Command, Parameters, Plant};
/// let mut plant = Plant::default();
/// plant.parameters.jack_friction = 800.0;
/// let record = plant.record(&Command::CHIRP, 50);
/// assert_eq!(record.lvdt.len(), 50);
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plant {
    /// The source's parameters.
    pub parameters: Parameters,
    /// Everything else; neutral by default.
    pub effects: Effects,
    /// How it steps.
    pub rule: Rule,
}

impl Plant {
    /// The high-fidelity plant of the source: second-order flapper and metering fluid.
    #[must_use]
    pub fn high_fidelity() -> Self {
        Self {
            parameters: Parameters::default(),
            effects: Effects { turbulent_metering: 1.0, ..Effects::default() },
            ..Self::default()
        }
    }
}

/// Time of a sample (s).
pub(crate) fn sample_time(index: usize, period: f64) -> f64 {
    index as f64 * period
}
