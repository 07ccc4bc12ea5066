//! What a monitor says of a window.

use super::screen::Exclusions;

/// What a window says of the actuator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Verdict {
    /// The model explains the window, no fault is alarmed, and of none is the alarmed value more likely than the healthy
    /// one by half of what an alarm takes. That is of the faults that the window tells, one at least: of the others it says
    /// nothing ([`Estimate::informative`]).
    Healthy = 0,
    /// The model explains the window, and a fault is alarmed, or its alarmed value is more likely than the healthy one by
    /// half of what an alarm takes.
    Fault = 1,
    /// The model does not explain the window, whatever the faults: they are not to be believed.
    ModelInadequate = 2,
    /// The window asked too little of the actuator: it would show an alarmed fault no better than by chance.
    Uninformative = 3,
    /// More than a tenth of the samples of a sensor were excluded, or the stream broke.
    SensorFault = 4,
}

impl Verdict {
    /// Every verdict, in the order of their numbers.
    pub const ALL: [Self; 5] =
        [Self::Healthy, Self::Fault, Self::ModelInadequate, Self::Uninformative, Self::SensorFault];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Healthy => "healthy",
            Self::Fault => "fault",
            Self::ModelInadequate => "model inadequate",
            Self::Uninformative => "uninformative",
            Self::SensorFault => "sensor fault",
        }
    }
}

/// What a window says of one fault.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Estimate {
    /// Value, in the parameter's unit. Where the window is not informative: that of the last one that was.
    pub value: f32,
    /// Standard error that this window has, or would have, of it; infinite where it says nothing. That of the dry friction is
    /// at least [`FRICTION_ERROR`](crate::fit::FRICTION_ERROR).
    pub standard_error: f32,
    /// Does the window tell the alarmed value from the healthy one?
    pub informative: bool,
    /// Evidence for the fault over the windows so far, as a part of what an alarm takes: 0 to 1.
    pub evidence: f32,
    /// Is it alarmed?
    pub alarmed: bool,
}

/// What a monitor says of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Report<const FAULTS: usize> {
    /// Number of the window, from 0; windows that were skipped count.
    pub window: u32,
    /// Tick of its first sample.
    pub first_tick: u32,
    /// What it says.
    pub verdict: Verdict,
    /// The faults.
    pub faults: [Estimate; FAULTS],
    /// Residual of user position, m, and current, mA, rms about its mean; 0 where nothing was compared, infinite where the
    /// model runs away. Offset and path may be zero then.
    pub residual_rms: [f32; 2],
    /// Noise of both as it is believed: as it was stated, but not below the model's own error, 0.1 um and 1 uA.
    pub noise: [f32; 2],
    /// Mean of the residual of both: the offset of a sensor, or a constant load. Taken out before the fit.
    pub offset: [f32; 2],
    /// How often the ram turned back by more than 20 um.
    pub reversals: u32,
    /// Path of the ram, m.
    pub travel: f32,
    /// What was excluded.
    pub exclusions: Exclusions,
    /// Evaluations of the model that the analysis took.
    pub evaluations: u32,
    /// Steps of the model that it took.
    pub steps: u32,
    /// Samples that came between the end of the window and this report.
    pub latency_samples: u32,
    /// Windows that were skipped since the start, because the analysis of another was still at work: also those that were full
    /// while this one was analysed.
    pub skipped: u32,
}
