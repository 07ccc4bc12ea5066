//! Power over frequency of pieces of a series, and what its transform tells of the whole.

use realfft::num_complex::Complex;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use std::f64::consts::TAU;
use std::sync::Arc;

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
    let products = Products::over(2 * longest);
    let mut power = products.forward.make_output_vec();
    for one in all {
        let finite = one.iter().map(|&value| if value.is_finite() { value } else { 0.0 });
        for (sum, line) in power.iter_mut().zip(products.transformed(finite)) {
            sum.re += line.norm_sqr();
        }
    }
    products.back(power, longest)
}

/// Mean square about their mean of the samples of a stretch, in that of the whole series, below which they are taken to be at
/// rest: what sums of products lose to rounding is far less.
const STILL: f64 = 1e-9;

/// Correlations of a series with another one so many samples earlier as the index says, fewer than `count`, each over the
/// samples that both have; 0 where one of them does not move over those.
pub fn correlations(later: &[f64], earlier: &[f64], count: usize) -> Vec<f64> {
    let products = Products::over(later.len().max(earlier.len()) + count);
    let [later, earlier] = [later, earlier].map(|series| Moments::of(series, &products));
    let over = |later: &[Complex<f64>], earlier: &[Complex<f64>]| {
        let lines = later.iter().zip(earlier).map(|(later, earlier)| later * earlier.conj());
        products.back(lines.collect(), count)
    };
    let pairs = over(&later.there, &earlier.there);
    let sums = [over(&later.sum, &earlier.there), over(&later.there, &earlier.sum)];
    let squares = [over(&later.squares, &earlier.there), over(&later.there, &earlier.squares)];
    let both = over(&later.sum, &earlier.sum);
    let still = [later.mean_square, earlier.mean_square].map(|usual| STILL * usual);
    let correlation = |delay: usize| {
        let pairs = pairs[delay].round().max(1.0);
        let product = both[delay] - sums[0][delay] * sums[1][delay] / pairs;
        let spreads = [0, 1].map(|which| squares[which][delay] - sums[which][delay].powi(2) / pairs);
        let moves = |which: usize| spreads[which] > still[which] * pairs;
        if moves(0) && moves(1) { product / (spreads[0] * spreads[1]).sqrt() } else { 0.0 }
    };
    (0..count).map(correlation).collect()
}

/// Transforms of which of its samples a series has, of those samples and of their squares, about its mean.
struct Moments {
    there: Vec<Complex<f64>>,
    sum: Vec<Complex<f64>>,
    squares: Vec<Complex<f64>>,
    /// Mean of the squares.
    mean_square: f64,
}

impl Moments {
    fn of(series: &[f64], products: &Products) -> Self {
        let there = || series.iter().filter(|value| value.is_finite());
        let mean_of = |moment: &dyn Fn(f64) -> f64| {
            there().map(|&value| moment(value)).sum::<f64>() / there().count().max(1) as f64
        };
        let mean = mean_of(&|value| value);
        let of = |moment: &dyn Fn(f64) -> f64| {
            let or_nothing = |&value: &f64| if value.is_finite() { moment(value - mean) } else { 0.0 };
            products.transformed(series.iter().map(or_nothing))
        };
        Self {
            there: of(&|_| 1.0),
            sum: of(&|value| value),
            squares: of(&|value| value * value),
            mean_square: mean_of(&|value| (value - mean).powi(2)),
        }
    }
}

/// Transforms in which the sums of the products of two series, one later than the other, are products.
struct Products {
    forward: Arc<dyn RealToComplex<f64>>,
    inverse: Arc<dyn ComplexToReal<f64>>,
}

impl Products {
    /// Over so many samples, or more.
    fn over(samples: usize) -> Self {
        let length = samples.next_power_of_two();
        let mut planner = RealFftPlanner::<f64>::new();
        Self { forward: planner.plan_fft_forward(length), inverse: planner.plan_fft_inverse(length) }
    }

    /// A series, followed by nothing.
    fn transformed(&self, series: impl Iterator<Item = f64>) -> Vec<Complex<f64>> {
        let mut input = self.forward.make_input_vec();
        for (slot, value) in input.iter_mut().zip(series) {
            *slot = value;
        }
        let mut lines = self.forward.make_output_vec();
        let done = self.forward.process(&mut input, &mut lines);
        done.expect("both are as long as the transform");
        lines
    }

    /// Sums of products from their transform, for the first delays.
    fn back(&self, mut lines: Vec<Complex<f64>>, delays: usize) -> Vec<f64> {
        // Those of real series are real there; rounding may have made something else of it.
        let [first, last] = [0, lines.len() - 1];
        lines[first].im = 0.0;
        lines[last].im = 0.0;
        let mut sums = self.inverse.make_output_vec();
        let done = self.inverse.process(&mut lines, &mut sums);
        done.expect("both are as long as the transform");
        let length = sums.len() as f64;
        sums.iter().take(delays).map(|sum| sum / length).collect()
    }
}
