//! How like one series is to another, by the delay between them.

use crate::fit;

/// Longest delay of the position that is looked for, s.
const LONGEST_DELAY_S: f64 = 0.5;
/// Correlation with itself from which on a series repeats itself.
const PERIODIC: f64 = 0.9;
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

/// Correlation of a series with another one so many samples before, from none on; empty where that does not move. Where it
/// repeats itself, the last one is half a period before: nobody knows of which period the answer is.
pub(super) fn likeness(later: &[f64], earlier: &[f64], period: f64) -> Vec<f64> {
    let [low, high] = fit::extent(earlier);
    if low >= high {
        return Vec::new();
    }
    let most = ((LONGEST_DELAY_S / period) as usize).min(later.len() / 4);
    let half = repeats_after(earlier, 2 * most).map_or(most, |repeats| repeats / 2);
    fit::correlations(later, earlier, most.min(half) + 1)
}

/// After how many samples a series repeats itself, so many at most.
fn repeats_after(series: &[f64], most: usize) -> Option<usize> {
    let most = most.min(series.len() / 2);
    let mut alike = fit::correlations(series, series, most).into_iter().enumerate().skip(1);
    // It has to have been another one in between.
    alike.find(|(_, alike)| *alike < 0.0)?;
    let (mut best, mut highest) = alike.find(|(_, alike)| *alike > PERIODIC)?;
    for (delay, alike) in alike.take_while(|(_, alike)| *alike > PERIODIC) {
        if alike > highest {
            (best, highest) = (delay, alike);
        }
    }
    Some(best)
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

    #[test]
    fn a_likeness_is_the_correlation_over_the_samples_that_both_have() {
        let wave = |k: usize, of: f64| (of * k as f64).sin() + 0.3 * (of * 3.7 * k as f64).cos() + 40.0;
        // One moves in its first half only.
        let mut later: Vec<f64> = (0..1000).map(|k| wave(k.min(500), 0.031)).collect();
        let mut earlier: Vec<f64> = (0..900).map(|k| wave(k, 0.047)).collect();
        let all = |later: &[f64], earlier: &[f64]| fit::correlations(later, earlier, 700);
        let complete = all(&later, &earlier);
        for sample in (0..1000).filter(|k| k * k % 7 < 3) {
            later[sample] = f64::NAN;
            if let Some(value) = earlier.get_mut(sample * 5 % 900) {
                *value = f64::NAN;
            }
        }
        let alike = all(&later, &earlier);
        for delay in 0..700 {
            let direct = correlation(&later[delay..], &earlier);
            assert!((alike[delay] - direct).abs() < 1e-9, "{delay}: {} {direct}", alike[delay]);
        }
        let off = (0..500).map(|delay| (alike[delay] - complete[delay]).abs()).fold(0.0, f64::max);
        assert!(off > 0.01, "what is lost counts: {off}");
        assert!(
            alike[..400].iter().all(|alike| *alike != 0.0) && alike[510..].iter().all(|alike| *alike == 0.0)
        );
    }

    #[test]
    fn an_answer_to_what_repeats_itself_is_not_a_period_late() {
        let turns = |k: usize| std::f64::consts::TAU * 5.0 * k as f64 * 1e-3;
        let command: Vec<f64> = (0..5000).map(|k| turns(k).sin()).collect();
        // It starts from rest and goes too far at first, which makes the first period less alike than all others.
        let answer = |k: usize| match k.checked_sub(45) {
            Some(k) if k < 400 => 1.6 * turns(k).sin(),
            Some(k) => turns(k).sin(),
            None => 0.0,
        };
        let late = |by: usize| -> Vec<f64> {
            (0..5000).map(|k: usize| k.checked_sub(by).map_or(0.0, answer)).collect()
        };
        let delay = |position: &[f64]| response(&likeness(position, &command, 1e-3), 1e-3).unwrap().delay_s;
        assert!((delay(&late(0)) - 0.045).abs() < 1e-3, "{}", delay(&late(0)));
        // What is later than that is still told from it.
        assert!((delay(&late(40)) - 0.085).abs() < 1e-3, "{}", delay(&late(40)));
        assert_eq!(repeats_after(&command, 1000), Some(200));
        let sweep: Vec<f64> = (0..5000).map(|k| (turns(k) * k as f64 * 2e-4).sin()).collect();
        assert_eq!(repeats_after(&sweep, 1000), None);
    }
}
