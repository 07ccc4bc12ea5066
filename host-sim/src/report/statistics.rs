//! What a residual series has to say about itself: spectrum, correlation with itself and with the motion.
//!
//! Series are given one for each record; NaN is a sample that is not compared.

use crate::fit::{self, OF_95};

/// A spectrum and what white noise of the same power would show.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Spectrum {
    /// Frequency, Hz, and amplitude density, unit per root of hertz.
    pub(super) points: Vec<[f64; 2]>,
    /// Amplitude density of white noise of a given standard deviation: low and high end of its 95 % band.
    pub(super) white: [f64; 2],
}

/// Longest segment of the spectrum, samples.
const LONGEST_SEGMENT: usize = 2048;
/// Segments that one record is cut into, but for their overlap.
const SEGMENTS: usize = 4;

/// Amplitude density by Welch's method (Hann window, half overlap, mean removed), and the band of white noise of the
/// standard deviation `noise`. None where the records are too short.
pub(super) fn spectrum(all: &[Vec<f64>], sample_period: f64, noise: f64) -> Option<Spectrum> {
    let longest = all.iter().map(Vec::len).max().unwrap_or(0);
    let length = (longest / SEGMENTS).min(LONGEST_SEGMENT) & !1;
    if length < 16 {
        return None;
    }
    let pieces = fit::periodograms(all, length);
    let count = pieces.len().max(1) as f64;
    let scale = 2.0 * sample_period / count;
    let density = |bin: usize| (pieces.iter().map(|piece| piece[bin]).sum::<f64>() * scale).sqrt();
    let points =
        (1..=length / 2).map(|bin| [bin as f64 / (length as f64 * sample_period), density(bin)]).collect();
    // Half overlapped Hann segments count as 18 K^2/(19 K - 1) independent ones (Welch 1967), two degrees each.
    let freedom = 2.0 * 18.0 * count * count / (19.0 * count - 1.0);
    let level = 2.0 * noise * noise * sample_period;
    Some(Spectrum {
        points,
        white: [-OF_95, OF_95].map(|normal| (level * chi_square_mean(freedom, normal)).sqrt()),
    })
}

/// Quantile of chi-square over its degrees of freedom, from that of the normal distribution (Wilson and Hilferty).
fn chi_square_mean(freedom: f64, normal: f64) -> f64 {
    let spread = 2.0 / (9.0 * freedom);
    (1.0 - spread + normal * spread.sqrt()).max(0.0).powi(3)
}

/// Correlation of a series with itself at lags 1 to `lags` samples.
pub(super) fn autocorrelation(all: &[Vec<f64>], lags: usize) -> Vec<f64> {
    let power: f64 = all.iter().flatten().filter(|value| value.is_finite()).map(|value| value * value).sum();
    let mut products = fit::LaggedProducts::new(all);
    (1..=lags).map(|lag| products.at(lag) / power.max(f64::MIN_POSITIVE)).collect()
}

/// Correlation of a series with another one that is `lag` samples earlier, for lags from `-reach` to `reach`.
pub(super) fn cross_correlation(all: &[Vec<f64>], others: &[Vec<f64>], reach: usize) -> Vec<[f64; 2]> {
    let norm = |series: &[Vec<f64>]| {
        series
            .iter()
            .flatten()
            .filter(|value| value.is_finite())
            .map(|value| value * value)
            .sum::<f64>()
            .sqrt()
    };
    let scale = (norm(all) * norm(others)).max(f64::MIN_POSITIVE);
    (0..=2 * reach)
        .map(|index| {
            let (later, earlier) = (index.saturating_sub(reach), reach.saturating_sub(index));
            let mut sum = 0.0;
            for (one, other) in all.iter().zip(others) {
                let pairs = one.iter().skip(later).zip(other.iter().skip(earlier));
                sum += pairs.map(|(a, b)| a * b).filter(|x| x.is_finite()).sum::<f64>();
            }
            [index as f64 - reach as f64, sum / scale]
        })
        .collect()
}

/// Number of samples that are compared.
pub(super) fn present(all: &[Vec<f64>]) -> usize {
    all.iter().flatten().filter(|value| value.is_finite()).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, Normal};
    use rand_xoshiro::rand_core::SeedableRng;

    fn white(count: usize, sigma: f64) -> Vec<f64> {
        let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(3);
        let normal = Normal::new(0.0, sigma).unwrap();
        (0..count).map(|_| normal.sample(&mut random)).collect()
    }

    fn outside(spectrum: &Spectrum) -> f64 {
        let [low, high] = spectrum.white;
        let count = spectrum.points.iter().filter(|point| !(low..=high).contains(&point[1])).count();
        count as f64 / spectrum.points.len() as f64
    }

    #[test]
    fn white_noise_stays_in_its_band_as_often_as_the_band_says() {
        let spectrum = spectrum(&[white(60_000, 5e-6)], 1e-3, 5e-6).unwrap();
        assert!((0.02..0.09).contains(&outside(&spectrum)), "{}", outside(&spectrum));
        let correlations = autocorrelation(&[white(60_000, 5e-6)], 200);
        let band = 1.96 / 60_000_f64.sqrt();
        let out = correlations.iter().filter(|c| c.abs() > band).count();
        assert!((3..=20).contains(&out), "{out} of 200");
    }

    #[test]
    fn the_band_of_another_noise_is_left() {
        let spectrum = spectrum(&[white(60_000, 10e-6)], 1e-3, 5e-6).unwrap();
        assert!(outside(&spectrum) > 0.95);
    }

    #[test]
    fn a_tone_shows_at_its_frequency_and_a_delay_at_its_lag() {
        let tone: Vec<f64> =
            (0..8000).map(|k| (std::f64::consts::TAU * 50.0 * f64::from(k) * 1e-3).sin()).collect();
        let found = spectrum(&[tone], 1e-3, 1.0).unwrap();
        let peak = found.points.iter().max_by(|a, b| a[1].total_cmp(&b[1])).unwrap();
        assert!((peak[0] - 50.0).abs() < 1.0, "{peak:?}");
        let noise = white(5000, 1.0);
        let late: Vec<f64> = (0..5000).map(|k: usize| k.checked_sub(7).map_or(0.0, |k| noise[k])).collect();
        let found = cross_correlation(&[late], &[noise], 20);
        let peak = found.iter().max_by(|a, b| a[1].total_cmp(&b[1])).unwrap();
        assert_eq!(peak[0], 7.0);
    }
}
