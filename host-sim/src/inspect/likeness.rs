//! How like one series is to another, by the delay between them.

use crate::fit;

/// Longest delay of the position that is looked for, s.
const LONGEST_DELAY_S: f64 = 0.5;
/// Difference of correlations that does not count.
const ABOUT_AS_HIGH: f64 = 0.02;

/// How the position follows the command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Delay at which the position is most like the command, s.
    pub delay_s: f64,
    /// Correlation at that delay.
    pub correlation: f64,
}

/// Correlation of a series with another one so many samples before, from none on; empty where that does not move.
pub(super) fn likeness(later: &[f64], earlier: &[f64], period: f64) -> Vec<f64> {
    let [low, high] = fit::extent(earlier);
    if low >= high {
        return Vec::new();
    }
    let most = ((LONGEST_DELAY_S / period) as usize).min(later.len() / 4);
    (0..=most).map(|delay| correlation(&later[delay..], earlier)).collect()
}

/// The delay at which they are most alike.
pub(super) fn response(likeness: &[f64], period: f64) -> Option<Response> {
    let highest = likeness.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    // Of a periodic command every period is as good: the first top that is about as high.
    let is_top = |&delay: &usize| {
        let next = likeness.get(delay + 1).copied().unwrap_or(f64::NEG_INFINITY);
        likeness[delay] >= next && likeness[delay] > highest - ABOUT_AS_HIGH
    };
    let best = (0..likeness.len()).find(is_top)?;
    // The top of the parabola through the best delay and its neighbours.
    let shift = match (best.checked_sub(1).map(|before| likeness[before]), likeness.get(best + 1)) {
        (Some(before), Some(after)) if before + after < 2.0 * likeness[best] => {
            0.5 * (before - after) / (before + after - 2.0 * likeness[best])
        }
        _ => 0.0,
    };
    Some(Response { delay_s: (best as f64 + shift) * period, correlation: likeness[best] })
}

/// Correlation of two series, over the samples that both have.
pub(super) fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let [product, square_a, square_b] = moments(a, b);
    product / (square_a * square_b).sqrt().max(f64::MIN_POSITIVE)
}

/// Slope of the straight line through one series over another one; not finite where the latter does not move.
pub(super) fn slope(a: &[f64], b: &[f64]) -> f64 {
    let [product, _, square_b] = moments(a, b);
    product / square_b
}

/// Sums of the product of two series and of their squares, about their means, over the samples that both have.
fn moments(a: &[f64], b: &[f64]) -> [f64; 3] {
    let pairs = || a.iter().zip(b).filter(|(a, b)| a.is_finite() && b.is_finite());
    let count = pairs().count().max(1) as f64;
    let (mean_a, mean_b) =
        (pairs().map(|(a, _)| a).sum::<f64>() / count, pairs().map(|(_, b)| b).sum::<f64>() / count);
    let (mut product, mut square_a, mut square_b) = (0.0, 0.0, 0.0);
    for (a, b) in pairs() {
        product += (a - mean_a) * (b - mean_b);
        square_a += (a - mean_a) * (a - mean_a);
        square_b += (b - mean_b) * (b - mean_b);
    }
    [product, square_a, square_b]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_delay_is_found_between_the_samples() {
        let wave = |t: f64| (std::f64::consts::TAU * 2.0 * t).sin();
        let command: Vec<f64> = (0..2000).map(|k| wave(f64::from(k) * 1e-3)).collect();
        let position: Vec<f64> = (0..2000).map(|k| 0.9 * wave(f64::from(k) * 1e-3 - 0.0123)).collect();
        let found = response(&likeness(&position, &command, 1e-3), 1e-3).unwrap();
        assert!((found.delay_s - 0.0123).abs() < 2e-4 && found.correlation > 0.999, "{found:?}");
        assert!(likeness(&position, &[0.0; 2000], 1e-3).is_empty());
    }
}
