//! Position commands as continuous functions of time.

use std::f64::consts::TAU;

/// A position command (m) over time (s).
#[derive(Debug, Clone, PartialEq)]
pub enum Command {
    /// Ramp of 0.03 m/s to 0.3 s, then 5 mm + 4 mm cosine of period 0.35 s to 0.65 s, then 1.5 times faster.
    Mixed,
    /// Zero, 3 mm from 10 ms, zero from 0.2 s, ramp of 0.01 m/s from 0.4 s, from 0.6 s 3 mm cosine at 5 Hz.
    MixedStep,
    /// Sine whose frequency grows linearly, 0.1 Hz at the start to 1.5 Hz at 1 s, and on at the same rate.
    Chirp {
        /// Amplitude (m).
        amplitude: f64,
    },
    /// `amplitude * sin(2*pi*frequency*t)`.
    Sine {
        /// Amplitude (m).
        amplitude: f64,
        /// Frequency (Hz).
        frequency: f64,
    },
    /// Zero, then `size` from `time` on.
    Step {
        /// Size (m).
        size: f64,
        /// Time of the step (s).
        time: f64,
    },
    /// Constant rate from the start.
    Ramp {
        /// Rate (m/s).
        rate: f64,
    },
    /// Samples from time zero on at a period (s), joined by straight lines, the last one held.
    Sampled(Vec<f64>, f64),
    /// Samples from time zero on at a period (s), each held until the next one.
    Held(Vec<f64>, f64),
    /// Another command, so much later (s).
    Later(Box<Self>, f64),
}

impl Command {
    /// The chirp of 1 cm.
    pub const CHIRP: Self = Self::Chirp { amplitude: 1e-2 };
    /// The chirp of low amplitude: 1 mm.
    pub const CHIRP_LOW: Self = Self::Chirp { amplitude: 1e-3 };
    /// The sine of 4 mm at 5 Hz.
    pub const SINE: Self = Self::Sine { amplitude: 4e-3, frequency: 5.0 };
    /// The step of 3 mm at 10 ms.
    pub const STEP: Self = Self::Step { size: 3e-3, time: 0.01 };
    /// The ramp of 0.03 m/s.
    pub const RAMP: Self = Self::Ramp { rate: 0.03 };

    /// Every named command, with its name.
    pub const NAMED: [(&'static str, Self); 7] = [
        ("mixed", Self::Mixed),
        ("mixed-step", Self::MixedStep),
        ("chirp", Self::CHIRP),
        ("chirp-low", Self::CHIRP_LOW),
        ("sine", Self::SINE),
        ("step", Self::STEP),
        ("ramp", Self::RAMP),
    ];

    /// The command at a time; at a jump, the value after it.
    pub fn value(&self, t: f64) -> f64 {
        match self {
            Self::Mixed => {
                let omega = TAU / 0.35;
                if t < 0.3 {
                    0.03 * t
                } else if t < 0.65 {
                    5e-3 + 4e-3 * (omega * (t - 0.3)).cos()
                } else {
                    5e-3 + 4e-3 * (1.5 * omega * (t - 0.65)).cos()
                }
            }
            Self::MixedStep => {
                if t < 0.01 {
                    0.0
                } else if t < 0.2 {
                    3e-3
                } else if t < 0.4 {
                    0.0
                } else if t < 0.6 {
                    0.01 * (t - 0.4)
                } else {
                    3e-3 * (TAU * 5.0 * (t - 0.6)).cos()
                }
            }
            Self::Chirp { amplitude } => amplitude * (TAU * (0.1 * t + 0.7 * t * t)).sin(),
            Self::Sine { amplitude, frequency } => amplitude * (TAU * frequency * t).sin(),
            Self::Step { size, time } => {
                if t < *time {
                    0.0
                } else {
                    *size
                }
            }
            Self::Ramp { rate } => rate * t,
            Self::Sampled(samples, period) => {
                let at = (t / period).max(0.0);
                let index = at as usize;
                match samples.get(index..index + 2) {
                    Some(pair) => pair[0] + (pair[1] - pair[0]) * (at - index as f64),
                    None => samples.last().copied().unwrap_or(0.0),
                }
            }
            Self::Later(command, by) => command.value((t - by).max(0.0)),
            Self::Held(samples, period) => {
                // A sample's time may be rounded down.
                let index = (t / period + 1e-10).max(0.0) as usize;
                samples.get(index).or(samples.last()).copied().unwrap_or(0.0)
            }
        }
    }

    /// The same command, so much later (s).
    #[must_use]
    pub fn later(self, by: f64) -> Self {
        Self::Later(Box::new(self), by)
    }

    /// The same command from a computer that gives `samples` samples every `period`, and holds each.
    #[must_use]
    pub fn held(&self, samples: usize, period: f64) -> Self {
        Self::Held(self.values(samples, period), period)
    }

    /// The same command as a recorder with `samples` samples every `period` knows it.
    #[must_use]
    pub fn sampled(&self, samples: usize, period: f64) -> Self {
        Self::Sampled(self.values(samples, period), period)
    }

    fn values(&self, samples: usize, period: f64) -> Vec<f64> {
        (0..samples).map(|i| self.value(crate::sample_time(i, period))).collect()
    }
}
