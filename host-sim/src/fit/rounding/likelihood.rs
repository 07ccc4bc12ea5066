//! How likely the readings of a sensor are.
//!
//! Of a position `x` and noise of standard deviation `s`, the reading of a sensor with steps `q` is `y` where position and
//! noise are in the step around it: with the probability `Phi((y + q/2 - x)/s) - Phi((y - q/2 - x)/s)`. A sample in the middle of
//! a step says little of the position, and one at its edge all the more.

use libm::erfc;
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// Standard deviations from which on the tail of the normal distribution is the first terms of its series.
const FAR: f64 = 30.0;
/// How often the noise of a sensor is bracketed more closely: to 1 % of a range of 1 to 100.
const BRACKETS: usize = 13;
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// The sensor of a channel of a record.
pub(super) struct Sensor {
    /// In which it is read, in the channel's unit; none where it is read as finely as it is.
    step: Option<f64>,
    /// Standard deviation of its noise, in the channel's unit, without what the steps add.
    noise: f64,
}

/// What a sample says of its prediction.
#[derive(Clone, Copy)]
pub(super) struct Score {
    /// Slope of the logarithm of its likelihood, over the prediction.
    pub(super) slope: f64,
    /// Curvature of that, with the other sign.
    pub(super) told: f64,
}

impl Sensor {
    /// A sensor with the noise that it is known to have; infinite where it is not used.
    pub(super) const fn without_steps(noise: f64) -> Self {
        Self { step: None, noise }
    }

    /// A sensor with the noise that its readings speak for, `off` the predictions, from the smallest that counts to a step.
    pub(super) fn of_steps(step: f64, off: &[f64], smallest: f64) -> Self {
        let of = |logarithm: f64| Self { step: Some(step), noise: logarithm.exp() };
        let (mut low, mut high) = (smallest.min(step).ln(), step.ln());
        let likelihood = |logarithm: f64| of(logarithm).likelihood(off);
        let left = |low: f64, high: f64| high - GOLDEN * (high - low);
        let right = |low: f64, high: f64| low + GOLDEN * (high - low);
        let mut inner = [left(low, high), right(low, high)];
        let mut at_inner = inner.map(likelihood);
        for _ in 0..BRACKETS {
            if at_inner[0] > at_inner[1] {
                high = inner[1];
                inner = [left(low, high), inner[0]];
                at_inner = [likelihood(inner[0]), at_inner[0]];
            } else {
                low = inner[0];
                inner = [inner[1], right(low, high)];
                at_inner = [at_inner[1], likelihood(inner[1])];
            }
        }
        of(0.5 * (low + high))
    }

    /// Logarithm of the likelihood of readings that are off their predictions. Without steps, that of their density, up to a
    /// constant.
    pub(super) fn likelihood(&self, off: &[f64]) -> f64 {
        let of_one = |&off: &f64| match self.step {
            Some(step) => Rounded::new(off, step, self.noise).logarithm,
            None => -0.5 * (off / self.noise).powi(2),
        };
        off.iter().map(of_one).sum()
    }

    /// What each of them says of its prediction.
    pub(super) fn scores(&self, off: &[f64]) -> impl Iterator<Item = Score> {
        let Self { step, noise } = *self;
        off.iter().map(move |&off| match step {
            Some(step) => Rounded::new(off, step, noise).score(noise),
            None => Score { slope: off / noise.powi(2), told: noise.powi(-2) },
        })
    }
}

/// A reading that is rounded: where position and noise are, in standard deviations of the noise.
struct Rounded {
    /// Logarithm of the probability that they are in the step around the reading.
    logarithm: f64,
    /// Edges of the step from the position, towards the reading: the near one and the far one.
    edges: [f64; 2],
    /// Densities at them, over the probability.
    densities: [f64; 2],
    /// 1 where the reading is above the position, else -1.
    side: f64,
}

impl Rounded {
    fn new(off: f64, step: f64, noise: f64) -> Self {
        let edges = [-0.5, 0.5].map(|half| (off.abs() + half * step) / noise);
        let [near, far] = edges;
        let side = 1.0_f64.copysign(off);
        let density = |edge: f64| (-0.5 * edge * edge).exp() / TAU.sqrt();
        if near > FAR {
            // The probability is the density at the edge over this; nothing is left of it at the other one.
            let slope = near + near.recip();
            let logarithm = -0.5 * near * near - (TAU.sqrt() * slope).ln();
            return Self { logarithm, edges, densities: [slope, 0.0], side };
        }
        let beyond = |edge: f64| 0.5 * erfc(FRAC_1_SQRT_2 * edge);
        let probability = beyond(near) - beyond(far);
        let densities = edges.map(|edge| density(edge) / probability);
        Self { logarithm: probability.ln(), edges, densities, side }
    }

    /// What it says of its prediction: mean and variance of a normal distribution that is cut to the step.
    fn score(&self, noise: f64) -> Score {
        let ([near, far], [at_near, at_far]) = (self.edges, self.densities);
        let mean = at_near - at_far;
        let variance = 1.0 + near * at_near - far * at_far - mean * mean;
        Score { slope: self.side * mean / noise, told: (1.0 - variance).clamp(0.0, 1.0) / noise.powi(2) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, Normal, Uniform};
    use rand_xoshiro::rand_core::SeedableRng;

    const STEP: f64 = 1e-5;

    /// Readings of positions all over the steps, off the positions.
    fn read(noise: f64, count: usize) -> Vec<f64> {
        let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(7);
        let (normal, place) = (Normal::new(0.0, noise).unwrap(), Uniform::new(0.0, 1e-3).unwrap());
        (0..count)
            .map(|_| {
                let position: f64 = place.sample(&mut random);
                ((position + normal.sample(&mut random)) / STEP).round() * STEP - position
            })
            .collect()
    }

    #[test]
    fn the_noise_behind_steps_is_found() {
        for noise in [1e-6, 2e-6, 4e-6] {
            let sensor = Sensor::of_steps(STEP, &read(noise, 20_000), 3e-7);
            assert!((sensor.noise / noise - 1.0).abs() < 0.05, "{noise}: {}", sensor.noise);
        }
        // None is found where there is none.
        assert!(Sensor::of_steps(STEP, &read(1e-9, 20_000), 3e-7).noise < 3.2e-7);
    }

    #[test]
    fn scores_are_the_slopes_of_the_likelihood() {
        let noise = 1.7e-6;
        let sensor = Sensor { step: Some(STEP), noise };
        let at = |off: f64| sensor.likelihood(&[off]);
        let width = 1e-3 * noise;
        for off in [-8e-5, -6.1e-5, -1.2e-5, -4e-6, 0.0, 3e-6, 5e-6, 2e-5, 5.4e-5, 9e-5] {
            let score = sensor.scores(&[off]).next().unwrap();
            // A reading is off by less where the prediction is larger.
            let slope = (at(off - width) - at(off + width)) / (2.0 * width);
            let told = (2.0 * at(off) - at(off - width) - at(off + width)) / (width * width);
            assert!(
                (score.slope - slope).abs() * noise < 1e-4 * (1.0 + slope.abs() * noise),
                "{off}: {slope}"
            );
            assert!((score.told - told).abs() * noise * noise < 2e-2, "{off}: {told} {}", score.told);
        }
    }

    #[test]
    fn what_is_told_is_the_spread_of_the_slopes() {
        // Both are the Fisher information: a check of either by the other, in which the rounding is real.
        for noise in [1e-6, 3e-6] {
            let sensor = Sensor { step: Some(STEP), noise };
            let off = read(noise, 50_000);
            let mean =
                |of: &dyn Fn(Score) -> f64| sensor.scores(&off).map(of).sum::<f64>() / off.len() as f64;
            let (bias, spread, told) =
                (mean(&|score| score.slope), mean(&|score| score.slope.powi(2)), mean(&|score| score.told));
            assert!((spread / told - 1.0).abs() < 0.03, "{noise}: {spread} {told}");
            assert!(bias.abs() < 4.0 * (spread / off.len() as f64).sqrt(), "{noise}: {bias}");
            assert!(told * noise * noise < 1.0);
        }
    }
}
