//! Noise that a sensor's filter has coloured: neighbouring samples share a part of it.
//!
//! Behind a filter of first order with time constant `tau`, white noise that is sampled every `T` is
//! `x[k] = c x[k-1] + w[k]` with `c = exp(-T/tau)`. Its spectrum says so at frequencies that no actuator follows, whatever
//! a model may lack at lower ones.

use realfft::RealFftPlanner;
use std::f64::consts::TAU;

/// Lowest frequency that is looked at, as a part of the sampling rate.
const LOWEST: f64 = 1.0 / 16.0;
/// Standard deviations by which noise must differ from white noise.
const SIGNIFICANT: f64 = 5.0;
/// How many neighbouring lines of a spectrum say the same thing under a Hann window.
const ALIKE: f64 = 1.94;
/// Steps of the search, and where it ends: noise that is longer correlated cannot be told from a drift.
const STEPS: u32 = 190;
const LONGEST: f64 = 0.95;

/// What neighbouring samples of residual series (one for each record; NaN where nothing is compared) share of their
/// noise, from 0 to 0.95: the most likely one by their spectrum (Whittle 1953); 0 where white noise may be it.
pub fn colour_of(all: &[Vec<f64>]) -> f64 {
    let lines: Vec<[f64; 2]> = all.iter().flat_map(|one| spectrum(one)).collect();
    if lines.is_empty() {
        return 0.0;
    }
    let count = lines.len() as f64;
    let unlikelihood = |colour: f64| {
        let (mut power, mut logarithms) = (0.0, 0.0);
        for [cosine, line] in &lines {
            let whitening = 1.0 + colour * (colour - 2.0 * cosine);
            power += whitening * line;
            logarithms += whitening.ln();
        }
        2.0 * (count * (power / count).ln() - logarithms)
    };
    let tried = (0..=STEPS).map(|step| {
        let colour = LONGEST * f64::from(step) / f64::from(STEPS);
        (colour, unlikelihood(colour))
    });
    let Some((colour, best)) = tried.min_by(|a, b| a.1.total_cmp(&b.1)) else { return 0.0 };
    if (unlikelihood(0.0) - best) / ALIKE > SIGNIFICANT * SIGNIFICANT { colour } else { 0.0 }
}

/// The lines of a series' periodogram that no actuator follows: cosine of the angle in a sample, power.
fn spectrum(series: &[f64]) -> Vec<[f64; 2]> {
    let count = series.len();
    let mut input: Vec<f64> = series
        .iter()
        .enumerate()
        .map(|(k, value)| {
            let window = 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / count as f64).cos();
            if value.is_finite() { value * window } else { 0.0 }
        })
        .collect();
    let transform = RealFftPlanner::<f64>::new().plan_fft_forward(count);
    let mut output = transform.make_output_vec();
    if transform.process(&mut input, &mut output).is_err() {
        return Vec::new();
    }
    let lowest = (LOWEST * count as f64).ceil() as usize;
    let line = |(index, value): (usize, &realfft::num_complex::Complex<f64>)| {
        [(TAU * index as f64 / count as f64).cos(), value.norm_sqr()]
    };
    let lines: Vec<[f64; 2]> =
        output.iter().enumerate().take(count / 2).skip(lowest.max(1)).map(line).collect();
    if lines.iter().all(|[_, power]| *power == 0.0) { Vec::new() } else { lines }
}

/// How much stronger white noise is that weighs as much on what changes slowly as noise of a colour does.
pub fn as_white(colour: f64) -> f64 {
    ((1.0 + colour) / (1.0 - colour)).sqrt()
}

/// What fourth differences, which take white noise for granted, make of noise of a colour: as a part of its strength.
pub(super) fn in_differences(colour: f64) -> f64 {
    let [c2, c3, c4] = [2, 3, 4].map(|power| colour.powi(power));
    ((70.0 - 112.0 * colour + 56.0 * c2 - 16.0 * c3 + 2.0 * c4) / 70.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::rand_core::SeedableRng;

    /// A slow motion that a model misses, and noise of strength 1 and some colour.
    fn noisy(count: usize, seed: u64, colour: f64, missed: f64) -> Vec<f64> {
        let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut state: f64 = StandardNormal.sample(&mut random);
        (0..count)
            .map(|k| {
                let white: f64 = StandardNormal.sample(&mut random);
                state = colour * state + (1.0 - colour * colour).sqrt() * white;
                state + missed * (0.0314 * k as f64).sin()
            })
            .collect()
    }

    #[test]
    fn the_colour_of_noise_is_found_whatever_is_missed_and_white_noise_has_none() {
        for colour in [0.3, 0.6, 0.8] {
            let mean = (0..10).map(|seed| colour_of(&[noisy(3000, seed, colour, 5.0)])).sum::<f64>() / 10.0;
            assert!((mean - colour).abs() < 0.05, "{colour}: {mean}");
        }
        for seed in 0..50 {
            assert_eq!(colour_of(&[noisy(1500, seed, 0.0, 20.0)]), 0.0);
        }
        assert_eq!(colour_of(&[vec![f64::NAN; 100], Vec::new()]), 0.0);
    }

    #[test]
    fn fourth_differences_see_as_much_of_coloured_noise_as_is_said() {
        for colour in [0.0, 0.3, 0.6, 0.9] {
            let values = noisy(200_000, 3, colour, 0.0);
            let fourth = values.windows(5).map(|w| w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]);
            let power = fourth.map(|difference| difference * difference).sum::<f64>() / values.len() as f64;
            let seen = (power / 70.0).sqrt();
            assert!((seen / in_differences(colour) - 1.0).abs() < 0.01, "{colour}: {seen}");
        }
    }

    #[test]
    fn slow_sums_of_coloured_noise_are_those_of_the_white_noise_that_stands_for_it() {
        let colour = 0.6;
        let sums: Vec<f64> =
            noisy(400_000, 4, colour, 0.0).chunks(400).map(|chunk| chunk.iter().sum()).collect();
        let spread = (sums.iter().map(|sum| sum * sum).sum::<f64>() / sums.len() as f64 / 400.0).sqrt();
        assert!((spread / as_white(colour) - 1.0).abs() < 0.08, "{spread}");
    }
}
