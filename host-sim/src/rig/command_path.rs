//! How a command goes from one sample of its record to the next.

use serde::{Deserialize, Serialize};

/// What a command does between its samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CommandPath {
    /// That is not known: records may speak for a curve, or for held values where nothing else explains them; straight
    /// lines are taken where they do not.
    #[default]
    Open,
    /// It goes from one sample to the next in a straight line.
    Lines,
    /// It was a continuous function of time when it was recorded: smooth, with corners anywhere, and with jumps that come
    /// just before the sample that shows them.
    Curve,
    /// The computer that commands keeps the value of a sample until the next one: half a sample of delay, which a sensor may
    /// have as well.
    Held,
}

/// A difference is a jump, and a bend a corner, if it is this many times as large as those before and behind it.
const ISOLATED: f64 = 10.0;
/// Share of a sample by which a corner is off one to be between two.
const BETWEEN: f64 = 1e-3;
/// Part of the way from sample to sample that is none of a bend, but of the rounding of numbers.
const ROUNDING: f64 = 1e-9;
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
    /// Share of the sample before each one by which the next line starts before it: where there is a corner between the two.
    /// Empty where there is none.
    pub ahead: Vec<f64>,
}

impl Knots {
    /// The samples themselves.
    fn of_samples(samples: &[f64]) -> Self {
        Self { command: samples.to_vec(), arriving: Vec::new(), ahead: Vec::new() }
    }
}

impl CommandPath {
    /// The knots of the samples of a command, m.
    pub fn knots(self, samples: &[f64]) -> Knots {
        match self {
            Self::Open | Self::Lines => Knots::of_samples(samples),
            Self::Curve => curve(samples),
            Self::Held => {
                let before = samples.first().into_iter().chain(samples);
                Knots {
                    arriving: before.take(samples.len()).copied().collect(),
                    ..Knots::of_samples(samples)
                }
            }
        }
    }
}

/// Straight lines have the mean of the curve over every sample, which is what moves the loop; how the curve runs inside of
/// one is of higher order. A corner between two samples is where the lines on either side meet. Before its first sample
/// the command rests.
fn curve(samples: &[f64]) -> Knots {
    let at = |index: usize| samples.get(index).copied();
    // From the sample before to this one, and how that changes here; none at the ends.
    let rise = |index: usize| Some(at(index)? - at(index.checked_sub(1)?)?);
    let bend = |index: usize| Some(rise(index + 1)? - rise(index).unwrap_or(0.0));
    let size =
        |of: &dyn Fn(usize) -> Option<f64>, index: Option<usize>| index.and_then(of).map_or(0.0, f64::abs);
    // Are those from one sample to another so much larger than their neighbours?
    let are_isolated = |of: &dyn Fn(usize) -> Option<f64>, from: usize, to: usize| {
        let around = size(of, from.checked_sub(1)).max(size(of, Some(to + 1)));
        (from..=to).map(|index| size(of, Some(index))).sum::<f64>() > ISOLATED * around
    };
    let jumps = |index: usize| index > 0 && are_isolated(&rise, index, index);
    // How far before a sample there is a corner, if it is between this one and the one before.
    let corner = |index: usize| {
        let before = index.checked_sub(1)?;
        let (smooth_before, smooth_behind) = (before.checked_sub(1).and_then(bend), bend(index + 1));
        let [first, second] =
            [bend(before)? - smooth_before.unwrap_or(0.0), bend(index)? - smooth_behind.unwrap_or(0.0)];
        let ahead = first / (first + second);
        let is_between = (BETWEEN..=1.0 - BETWEEN).contains(&ahead) && are_isolated(&bend, before, index);
        let is_bent = (first + second).abs() > ROUNDING * size(&rise, Some(index));
        (is_between && is_bent && !jumps(index)).then_some(ahead)
    };
    let ahead: Vec<f64> = (0..samples.len()).map(|index| corner(index).unwrap_or(0.0)).collect();
    let is_broken = |index: usize| jumps(index) || ahead.get(index).is_some_and(|&ahead| ahead > 0.0);
    let is_smooth = |index: usize| {
        index > 0 && !is_broken(index) && !is_broken(index + 1) && !are_isolated(&bend, index, index)
    };
    let corrected = |index: usize| match bend(index) {
        Some(bend) if is_smooth(index) => samples[index] - BEND * bend,
        _ => samples[index],
    };
    let command: Vec<f64> = (0..samples.len()).map(corrected).collect();
    if !(1..samples.len()).any(is_broken) {
        return Knots { command, arriving: Vec::new(), ahead: Vec::new() };
    }
    let gone_on = |index: usize| {
        let before = index - 1;
        let bend = if before > 1 { bend(before - 1) } else { None };
        samples[before] + rise(before).unwrap_or(0.0) + bend.unwrap_or(0.0)
    };
    let arriving = |index: usize| if is_broken(index) { gone_on(index) } else { command[index] };
    let arriving = (0..samples.len()).map(arriving).collect();
    Knots { command, arriving, ahead }
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
        let Knots { command, arriving, ahead } = CommandPath::Curve.knots(&samples);
        assert_eq!(command, samples);
        assert_eq!(ahead, [0.0; 11]);
        assert_eq!(arriving, [0.0, 0.0, 0.0, 0.0, 3.0, 3.0, 4.0, 5.0, 6.0, 6.0, 6.0]);
        // A ramp has none, and neither has what is held by lines.
        let ramp: Vec<f64> = (0..10).map(f64::from).collect();
        assert_eq!(CommandPath::Curve.knots(&ramp), CommandPath::Lines.knots(&ramp));
        assert_eq!(CommandPath::Lines.knots(&samples), Knots::of_samples(&samples));
    }

    #[test]
    fn a_corner_between_two_samples_is_where_the_lines_on_either_side_meet() {
        // A fifth of a sample after its start a ramp sets in, and ends 0.7 of a sample before another one; a cosine follows.
        let command = |t: f64| match t {
            ..0.2 => 0.0,
            0.2..9.3 => t - 0.2,
            _ => 9.1 + 5.0 * (1.0 - (0.02 * (t - 9.3)).cos()),
        };
        let samples: Vec<f64> = (0..20).map(|sample| command(f64::from(sample))).collect();
        let Knots { command: knots, arriving, ahead } = CommandPath::Curve.knots(&samples);
        let corners: Vec<usize> = (0..20).filter(|&sample| ahead[sample] > 0.0).collect();
        assert_eq!(corners, [1, 10]);
        assert!((ahead[1] - 0.8).abs() < 1e-9 && (ahead[10] - 0.7).abs() < 1e-3, "{ahead:?}");
        assert!(arriving[1] == 0.0 && (arriving[10] - 9.8).abs() < 1e-9, "{arriving:?}");
        assert_eq!(knots[..10], samples[..10]);
        // One that is on a sample is no other, and rounding makes none.
        let on_sample: Vec<f64> = (0..20).map(|sample| f64::from(sample).min(7.0) * 0.1).collect();
        assert_eq!(CommandPath::Curve.knots(&on_sample), CommandPath::Lines.knots(&on_sample));
    }
}
