//! Power over frequency of pieces of a series, and what its transform tells of the whole.

use realfft::RealFftPlanner;
use std::f64::consts::TAU;

/// Periodograms of the pieces of series (one for each record; NaN is a sample that is not compared), `length` samples
/// each, from 0 Hz to half the sampling rate: mean of the series removed, Hann window, half overlap (Welch 1967). Each
/// line of white noise is its variance on average.
pub fn periodograms(all: &[Vec<f64>], length: usize) -> Vec<Vec<f64>> {
    let window: Vec<f64> =
        (0..length).map(|k| 0.5 - 0.5 * (TAU * (k as f64 + 0.5) / length as f64).cos()).collect();
    let weight: f64 = window.iter().map(|w| w * w).sum();
    let transform = RealFftPlanner::<f64>::new().plan_fft_forward(length);
    let mut pieces = Vec::new();
    for one in all {
        let present = one.iter().filter(|value| value.is_finite());
        let mean = present.clone().sum::<f64>() / present.count().max(1) as f64;
        for piece in one.windows(length).step_by(length / 2) {
            let mut input: Vec<f64> = piece
                .iter()
                .zip(&window)
                .map(|(value, w)| if value.is_finite() { (value - mean) * w } else { 0.0 })
                .collect();
            let mut output = transform.make_output_vec();
            if transform.process(&mut input, &mut output).is_ok() {
                pieces.push(output.iter().map(|line| line.norm_sqr() / weight).collect());
            }
        }
    }
    pieces
}

/// Frequency, Hz, with the most power of a series (NaN adds nothing), and its share of all of it. From one period along the
/// series to half the sampling rate, in steps of half a period: one in between would be shared by two. None where there is
/// nothing.
pub fn strongest_tone(series: &[f64], sample_period: f64) -> Option<(f64, f64)> {
    let count = series.len();
    let present = || series.iter().filter(|value| value.is_finite());
    let mean = present().sum::<f64>() / present().count().max(1) as f64;
    let total: f64 = present().map(|value| value * value).sum();
    // As much again of nothing: lines are half a period apart.
    let mut input = vec![0.0; 2 * count];
    for (slot, value) in input.iter_mut().zip(series).filter(|(_, value)| value.is_finite()) {
        *slot = value - mean;
    }
    if total <= 0.0 {
        return None;
    }
    let transform = RealFftPlanner::<f64>::new().plan_fft_forward(input.len());
    let mut lines = transform.make_output_vec();
    transform.process(&mut input, &mut lines).ok()?;
    let share = |line: usize, power: f64| {
        // At half the sampling rate there is no line of the negative frequency.
        let sides = if line == count { 1.0 } else { 2.0 };
        (line as f64 / (2.0 * count as f64 * sample_period), sides * power / (count as f64 * total))
    };
    let shares = lines.iter().enumerate().skip(2).map(|(line, value)| share(line, value.norm_sqr()));
    shares.max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Sums of the products of series with themselves so many samples later as the index says; NaN adds nothing.
pub(super) fn autocorrelations(all: &[Vec<f64>]) -> Vec<f64> {
    let longest = all.iter().map(Vec::len).max().unwrap_or(0);
    // As much again of nothing: the end does not meet the beginning.
    let length = (2 * longest).next_power_of_two();
    let mut planner = RealFftPlanner::<f64>::new();
    let (forward, inverse) = (planner.plan_fft_forward(length), planner.plan_fft_inverse(length));
    let mut power = forward.make_output_vec();
    for one in all {
        let mut input = vec![0.0; length];
        for (slot, value) in input.iter_mut().zip(one).filter(|(_, value)| value.is_finite()) {
            *slot = *value;
        }
        let mut lines = forward.make_output_vec();
        if forward.process(&mut input, &mut lines).is_ok() {
            for (sum, line) in power.iter_mut().zip(lines) {
                sum.re += line.norm_sqr();
            }
        }
    }
    let mut products = inverse.make_output_vec();
    if inverse.process(&mut power, &mut products).is_err() {
        return Vec::new();
    }
    products.truncate(longest);
    products.iter().map(|product| product / length as f64).collect()
}
