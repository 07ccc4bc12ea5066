//! The test commands: position demands as continuous functions of time.
//!
//! One table, [`COMMANDS`], names them. Sines are computed from turns with a polynomial, so that host and MCU agree to
//! the bit and no double-precision routine is linked.

use crate::scalar::Real;

/// The shape of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Shape {
    /// Ramp, then two cosines: the source's main test.
    Mixed,
    /// Steps, ramp and cosine: the commented variant of the source's appendix A.
    MixedStep,
    /// Linear sweep of the frequency.
    Chirp,
    /// Sine.
    Sine,
    /// Step at 10 ms.
    Step,
    /// Ramp.
    Ramp,
}

/// A row of the table of commands.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct CommandInfo {
    /// Name that users type.
    pub name: &'static str,
    /// Its shape.
    pub shape: Shape,
    /// Amplitude, m (ramp: slope, m/s); 0 where the shape fixes it.
    pub amplitude: f64,
    /// Frequency, Hz (chirp: at its start); 0 where it does not apply.
    pub frequency: f64,
    /// Chirp: frequency at the end of the sweep, Hz.
    pub end_frequency: f64,
    /// Chirp: duration of the sweep, s; the frequency goes on rising after it.
    pub sweep: f64,
    /// One line for the user.
    pub description: &'static str,
}

/// Every command, in the order of the lists.
pub const COMMANDS: [CommandInfo; 7] = [
    row(
        "mixed",
        Shape::Mixed,
        0.0,
        0.0,
        0.0,
        0.0,
        "0.03 m/s ramp to 0.3 s; 5 mm + 4 mm cosine of period 0.35 s to 0.65 s; then 1.5 times that frequency",
    ),
    row(
        "mixed-step",
        Shape::MixedStep,
        3e-3,
        5.0,
        0.0,
        0.0,
        "10 ms zero, 3 mm to 0.2 s, zero to 0.4 s, 0.01 m/s ramp to 0.6 s, then a 3 mm cosine at 5 Hz",
    ),
    row("chirp", Shape::Chirp, 1e-2, 0.1, 1.5, 1.0, "1 cm sine, 0.1 to 1.5 Hz in 1 s, linear"),
    row("chirp-low", Shape::Chirp, 1e-3, 0.1, 1.5, 1.0, "1 mm sine, 0.1 to 1.5 Hz in 1 s, linear"),
    row("sine", Shape::Sine, 4e-3, 5.0, 0.0, 0.0, "4 mm sine at 5 Hz"),
    row("step", Shape::Step, 3e-3, 0.0, 0.0, 0.0, "3 mm step at 10 ms"),
    row("ramp", Shape::Ramp, 0.03, 0.0, 0.0, 0.0, "0.03 m/s ramp"),
];

const fn row(
    name: &'static str,
    shape: Shape,
    amplitude: f64,
    frequency: f64,
    end_frequency: f64,
    sweep: f64,
    description: &'static str,
) -> CommandInfo {
    CommandInfo { name, shape, amplitude, frequency, end_frequency, sweep, description }
}

impl CommandInfo {
    /// The command of a name.
    pub fn named(name: &str) -> Option<&'static Self> {
        COMMANDS.iter().find(|row| row.name == name)
    }
}

/// A command with its numbers, ready to be evaluated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command<T> {
    /// Shape.
    pub shape: Shape,
    /// Amplitude, m (ramp: slope, m/s).
    pub amplitude: T,
    /// Frequency, Hz (chirp: at its start).
    pub frequency: T,
    /// Chirp: frequency at the end of the sweep, Hz.
    pub end_frequency: T,
    /// Chirp: duration of the sweep, s.
    pub sweep: T,
}

impl<T: Real> Command<T> {
    /// The command of a row of the table.
    pub fn new(info: &CommandInfo) -> Self {
        Self {
            shape: info.shape,
            amplitude: T::literal(info.amplitude),
            frequency: T::literal(info.frequency),
            end_frequency: T::literal(info.end_frequency),
            sweep: T::literal(info.sweep),
        }
    }

    /// The commanded position at a time (s, >= 0), m.
    pub fn at(&self, t: T) -> T {
        let l = T::literal;
        match self.shape {
            Shape::Mixed => {
                let rate = l(1.0 / 0.35);
                let cosine = |turns: T| l(5e-3) + l(4e-3) * cosine_of_turns(turns);
                if t < l(0.3) {
                    l(0.03) * t
                } else if t < l(0.65) {
                    cosine((t - l(0.3)) * rate)
                } else {
                    cosine((t - l(0.65)) * rate * l(1.5))
                }
            }
            Shape::MixedStep => {
                if t < l(0.01) || (t >= l(0.2) && t < l(0.4)) {
                    T::ZERO
                } else if t < l(0.2) {
                    self.amplitude
                } else if t < l(0.6) {
                    l(0.01) * (t - l(0.4))
                } else {
                    self.amplitude * cosine_of_turns((t - l(0.6)) * self.frequency)
                }
            }
            Shape::Chirp => {
                let rate = (self.end_frequency - self.frequency) / self.sweep;
                self.amplitude * sine_of_turns((self.frequency + l(0.5) * rate * t) * t)
            }
            Shape::Sine => self.amplitude * sine_of_turns(self.frequency * t),
            Shape::Step => {
                if t < l(0.01) {
                    T::ZERO
                } else {
                    self.amplitude
                }
            }
            Shape::Ramp => self.amplitude * t,
        }
    }
}

/// `sin(2 pi turns)`.
pub fn sine_of_turns<T: Real>(turns: T) -> T {
    turns.circle_of_turns()[1]
}

/// `cos(2 pi turns)`.
pub fn cosine_of_turns<T: Real>(turns: T) -> T {
    turns.circle_of_turns()[0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_continuous_where_the_design_says_so() {
        for name in ["mixed", "chirp", "chirp-low", "sine", "ramp"] {
            let command = Command::<f64>::new(CommandInfo::named(name).unwrap());
            for k in 0..30_000 {
                let t = f64::from(k) * 1e-4;
                // The fastest is the chirp, whose frequency at 3 s is 4.3 Hz: 0.27 m/s.
                assert!((command.at(t + 1e-4) - command.at(t)).abs() < 2.8e-5, "{name} jumps at {t}");
            }
        }
    }
}
