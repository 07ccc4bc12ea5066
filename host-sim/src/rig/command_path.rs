//! How a command goes from one sample of its record to the next.

use serde::{Deserialize, Serialize};

/// What a command does between its samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CommandPath {
    /// It goes from one sample to the next in a straight line.
    #[default]
    Lines,
    /// It was a continuous function of time when it was recorded: smooth, with corners at samples, and with jumps that come
    /// just before the sample that shows them.
    Curve,
    /// The computer that commands keeps the value of a sample until the next one. Only a rig can say so: half a sample of
    /// delay is what a sensor may have as well.
    Held,
}

/// A difference is a jump, and a bend a corner, if it is this many times as large as those before and behind it.
const ISOLATED: f64 = 10.0;
/// Weight of the bend of a command at a sample that takes a straight line between samples to the mean of a curve: a line is
/// off by `h^2/12 x''` in the mean.
const BEND: f64 = 1.0 / 12.0;

/// A command as the model takes it: the ends of straight lines between samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Knots {
    /// Where the line behind each sample starts, m.
    pub command: Vec<f64>,
    /// Where the line before each sample ends, m; empty where that is always where the next one starts.
    pub arriving: Vec<f64>,
}

impl CommandPath {
    /// The knots of the samples of a command, m.
    pub fn knots(self, samples: &[f64]) -> Knots {
        match self {
            Self::Lines => Knots { command: samples.to_vec(), arriving: Vec::new() },
            Self::Curve => curve(samples),
            Self::Held => {
                let before = samples.first().into_iter().chain(samples);
                Knots { command: samples.to_vec(), arriving: before.take(samples.len()).copied().collect() }
            }
        }
    }
}

/// Straight lines have the mean of the curve over every sample, which is what moves the loop; how the curve runs inside of
/// one is of higher order.
fn curve(samples: &[f64]) -> Knots {
    let at = |index: usize| samples.get(index).copied();
    // From the sample before to this one, and how that changes here; none at the ends.
    let rise = |index: usize| Some(at(index)? - at(index.checked_sub(1)?)?);
    let bend = |index: usize| Some(rise(index + 1)? - rise(index)?);
    let is_isolated = |of: &dyn Fn(usize) -> Option<f64>, index: usize| {
        let size = |index: Option<usize>| index.and_then(of).map_or(0.0, f64::abs);
        size(Some(index)) > ISOLATED * size(index.checked_sub(1)).max(size(Some(index + 1)))
    };
    let jumps = |index: usize| is_isolated(&rise, index);
    let corrected = |index: usize| match bend(index) {
        Some(bend_here) if !jumps(index) && !jumps(index + 1) && !is_isolated(&bend, index) => {
            samples[index] - BEND * bend_here
        }
        _ => samples[index],
    };
    let command: Vec<f64> = (0..samples.len()).map(corrected).collect();
    let has_jumps = (1..samples.len()).any(jumps);
    let before_jump = |index: usize| samples[index - 1] + rise(index - 1).unwrap_or(0.0);
    let arriving = |index: usize| if jumps(index) { before_jump(index) } else { command[index] };
    let arriving = if has_jumps { (0..samples.len()).map(arriving).collect() } else { Vec::new() };
    Knots { command, arriving }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_have_the_mean_of_the_curve() {
        let (frequency, period) = (10.0, 1e-3);
        let omega = std::f64::consts::TAU * frequency;
        let samples: Vec<f64> = (0..200).map(|sample| (omega * f64::from(sample) * period).sin()).collect();
        let means = |path: CommandPath| -> f64 {
            let knots = path.knots(&samples).command;
            let error = |at: usize| {
                let [from, to] = [at, at + 1].map(|sample| omega * sample as f64 * period);
                let mean = (from.cos() - to.cos()) / (to - from);
                (0.5 * (knots[at] + knots[at + 1]) - mean).abs()
            };
            (2..197).map(error).fold(0.0, f64::max)
        };
        assert!(means(CommandPath::Curve) < 2e-6, "{}", means(CommandPath::Curve));
        assert!(means(CommandPath::Lines) > 3e-4, "{}", means(CommandPath::Lines));
    }

    #[test]
    fn a_jump_stays_a_jump_and_a_corner_a_corner() {
        let samples = [0.0, 0.0, 0.0, 3.0, 3.0, 3.0, 4.0, 5.0, 6.0, 6.0, 6.0];
        let Knots { command, arriving } = CommandPath::Curve.knots(&samples);
        assert_eq!(command, samples);
        assert_eq!(arriving, [0.0, 0.0, 0.0, 0.0, 3.0, 3.0, 4.0, 5.0, 6.0, 6.0, 6.0]);
        // A ramp has none, and neither has what is held by lines.
        let ramp: Vec<f64> = (0..10).map(f64::from).collect();
        assert_eq!(CommandPath::Curve.knots(&ramp), CommandPath::Lines.knots(&ramp));
        assert_eq!(
            CommandPath::Lines.knots(&samples),
            Knots { command: samples.to_vec(), arriving: Vec::new() }
        );
    }
}
