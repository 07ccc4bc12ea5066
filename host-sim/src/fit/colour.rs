//! Noise that a sensor's filter has coloured: neighbouring samples share a part of it.
//!
//! Behind a filter of first order with time constant `tau`, white noise that is sampled every `T` is
//! `x[k] = c x[k-1] + w[k]` with `c = exp(-T/tau)`. Its spectrum says so at frequencies that no actuator follows, whatever
//! a model may lack at lower ones: it has that shape at all times. What a model lacks comes and goes with the motion.

use super::periodogram::periodograms;
use std::f64::consts::TAU;

/// Samples of a piece of a series whose spectrum is taken.
const PIECE: usize = 256;
/// Lowest of its frequencies that is looked at: a sixteenth of the sampling rate.
const LOWEST: usize = PIECE / 16;
/// Neighbouring frequencies that are taken together where the shape of the spectrum is tested.
const BAND: usize = 14;
/// Standard deviations by which noise must differ from white noise, and may differ from coloured noise.
const SIGNIFICANT: f64 = 5.0;
/// How many neighbouring lines of a spectrum say the same thing under a Hann window.
const ALIKE: f64 = 1.94;
/// Steps of the search, and where it ends: noise that is longer correlated cannot be told from a drift.
const STEPS: u32 = 190;
const LONGEST: f64 = 0.95;

/// What neighbouring samples of residual series (one for each record; NaN where nothing is compared) share of their
/// noise, from 0 to 0.95: the most likely one by their spectrum (Whittle 1953). 0 where white noise may be it, or where
/// coloured noise is not: at some times or frequencies there is more than at others.
pub fn colour_of(all: &[Vec<f64>]) -> f64 {
    // Pieces that overlap by half say almost nothing twice under a Hann window.
    let pieces: Vec<Vec<f64>> =
        periodograms(all, PIECE).iter().map(|lines| lines[LOWEST..PIECE / 2].to_vec()).collect();
    let count = pieces.iter().map(Vec::len).sum::<usize>() as f64;
    let unlikelihood = |colour: f64| {
        let (mut power, mut logarithms) = (0.0, 0.0);
        for (index, line) in pieces.iter().flat_map(|piece| piece.iter().enumerate()) {
            power += whitening(index, colour) * line;
            logarithms += whitening(index, colour).ln();
        }
        2.0 * (count * (power / count).ln() - logarithms)
    };
    let colour = |step: u32| LONGEST * f64::from(step) / f64::from(STEPS);
    let tried = (0..=STEPS).map(|step| (colour(step), unlikelihood(colour(step))));
    let Some((colour, best)) = tried.min_by(|a, b| a.1.total_cmp(&b.1)) else { return 0.0 };
    let is_coloured = (unlikelihood(0.0) - best) / ALIKE > SIGNIFICANT * SIGNIFICANT;
    if is_coloured && is_stationary(&pieces, colour) { colour } else { 0.0 }
}

/// Are the lines of pieces of noise, the colour taken out, as strong in each piece and in each band as in all?
fn is_stationary(pieces: &[Vec<f64>], colour: f64) -> bool {
    let white: Vec<Vec<f64>> = pieces
        .iter()
        .map(|piece| piece.iter().enumerate().map(|(index, line)| whitening(index, colour) * line).collect())
        .collect();
    let mean = |lines: &[f64]| lines.iter().sum::<f64>() / lines.len() as f64;
    let expected = mean(&white.concat());
    let is_as_all = |lines: &[f64]| {
        (mean(lines) / expected - 1.0).abs() < SIGNIFICANT * (ALIKE / lines.len() as f64).sqrt()
    };
    let lines = white.first().map_or(0, Vec::len);
    let band = |from: usize| -> Vec<f64> {
        white.iter().flat_map(|piece| &piece[from..(from + BAND).min(lines)]).copied().collect()
    };
    white.iter().all(|piece| is_as_all(piece)) && (0..lines).step_by(BAND).all(|from| is_as_all(&band(from)))
}

/// Power of the white noise behind a line of a colour, as a part of the line's.
fn whitening(index: usize, colour: f64) -> f64 {
    let angle = TAU * (LOWEST + index) as f64 / PIECE as f64;
    1.0 + colour * (colour - 2.0 * angle.cos())
}

/// The factor by which white noise must be stronger than noise of this colour to disturb slow changes equally.
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
        assert_eq!(colour_of(&[vec![f64::NAN; 1000], Vec::new()]), 0.0);
    }

    #[test]
    fn what_comes_and_goes_or_has_a_tone_is_no_coloured_noise() {
        for seed in 0..10 {
            let noise = noisy(3000, seed, 0.6, 0.0);
            let found = colour_of(std::slice::from_ref(&noise));
            assert!((found - 0.6).abs() < 0.15, "{seed}: {found}");
            let louder = |(k, x): (usize, &f64)| x * if k > 1500 { 2.0 } else { 1.0 };
            assert_eq!(colour_of(&[noise.iter().enumerate().map(louder).collect()]), 0.0);
            let humming = |(k, x): (usize, &f64)| x + (0.6 * k as f64).sin();
            assert_eq!(colour_of(&[noise.iter().enumerate().map(humming).collect()]), 0.0);
        }
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
