//! Is a series of time stamps uniform, and what is its period?
//!
//! A step may differ from the typical step by 1 %, or by what the rounding of its two stamps explains if that is more:
//! half a unit of the last printed digit at either end, and both only if they are not rounded the same way,
//! so less than one unit. A whole unit is a fault: with as many decimals as the step needs it is a lost sample.

use super::error::Problem;
use std::f64::consts::TAU;

/// Longest gap of a record whose inputs are bridged, s.
pub(crate) const LONGEST_GAP_S: f64 = 0.02;

/// How far the median step may be from the period of a rate that is stated, as a part of it.
const OTHER_RATE: f64 = 0.2;

/// Stamps that tell the phase of a clock.
const PHASE_STAMPS: usize = 20;

/// Parts of a second to which the start of a clock is given: nanoseconds.
const START_PARTS: f64 = 1e9;

/// Share of what a stamp is off a clock by which it corrects it: stamps that jitter by a quarter of a sample move it by
/// 4 %.
const CLOCK_GAIN: f64 = 0.05;

/// Largest relative difference of a step from the typical step.
const STEP_TOLERANCE: f64 = 0.01;

/// Relative difference of two rates of one clock. A row in a thousand that is lost makes as much.
const SAME_RATE: f64 = 1e-3;

/// Largest effect of rounding on a step, units of the last digit: less than one.
const ROUNDING: f64 = 0.99;

/// Relative error of a period that is floating-point noise.
const PERIOD_NOISE: f64 = 1e-9;

/// Digits of a double, fewer than those of a count of nanoseconds since 1970.
const DOUBLE_DIGITS: i32 = 16;

/// How finely time stamps are given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Resolution {
    /// Unit of the last digit of the stamp with most decimals, s.
    absolute: f64,
    /// Significant digits of the stamp with most of them.
    digits: i32,
    /// Length of the unit in which the stamps are printed, s.
    scale: f64,
}

/// Counts the digits of printed time stamps.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Digits {
    /// Most decimals, once a stamp was seen; negative for stamps in tens, hundreds and so on.
    decimals: Option<i32>,
    /// Most significant digits.
    significant: i32,
}

impl Digits {
    /// Takes in a stamp as printed: a number that [`f64`] can parse.
    pub(super) fn add(&mut self, text: &str) {
        let (mantissa, exponent) = text.split_once(['e', 'E']).unwrap_or((text, "0"));
        let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
        let digits = whole.chars().chain(fraction.chars()).filter(char::is_ascii_digit);
        let significant = i32::try_from(digits.skip_while(|digit| *digit == '0').count()).unwrap_or(i32::MAX);
        let decimals = i32::try_from(fraction.len()).unwrap_or(i32::MAX);
        let decimals = decimals.saturating_sub(exponent.parse().unwrap_or(0));
        self.decimals = Some(self.decimals.map_or(decimals, |most| most.max(decimals)));
        self.significant = self.significant.max(significant);
    }

    /// The resolution of the stamps, printed in a unit of `scale` s.
    pub(super) fn resolution(self, scale: f64) -> Resolution {
        let scale = scale.abs();
        let absolute = 10_f64.powi(self.decimals.map_or(0, i32::saturating_neg)) * scale;
        Resolution { absolute, digits: self.significant.clamp(1, DOUBLE_DIGITS), scale }
    }
}

impl Resolution {
    /// Stamps in full double precision.
    pub(super) const EXACT: Self = Self { absolute: 0.0, digits: DOUBLE_DIGITS, scale: 1.0 };

    /// Stamps that are single-precision numbers.
    pub(super) fn of_singles(stamps: &[f64]) -> Self {
        let largest = stamps.iter().fold(0.0, |most: f64, stamp| most.max(stamp.abs()));
        Self { absolute: largest * f64::from(f32::EPSILON), ..Self::EXACT }
    }

    /// Unit of the last digit of the stamp `time`, s: fixed decimals or fixed significant digits, the coarser.
    fn unit(&self, time: f64) -> f64 {
        let printed = time.abs() / self.scale;
        if printed == 0.0 {
            return self.absolute;
        }
        let leading = printed.log10().floor();
        let relative = 10_f64.powf(leading + 1.0 - f64::from(self.digits)) * self.scale;
        self.absolute.max(relative)
    }
}

/// Start and period of uniform time stamps, s. `times` are at least two finite values.
///
/// # Errors
///
/// The index of the first stamp that does not follow its predecessor by one step, and why.
pub(super) fn uniform(times: &[f64], resolution: Resolution) -> Result<(f64, f64), (usize, Problem)> {
    let steps = increasing(times)?;
    let typical = typical_step(times);
    for (index, step) in steps.into_iter().enumerate() {
        let slack = (STEP_TOLERANCE * typical).max(ROUNDING * resolution.unit(times[index + 1]));
        if (step - typical).abs() > slack {
            return Err((index + 1, Problem::TimeNotUniform { step, typical }));
        }
    }
    Ok((times[0], period(times, resolution)))
}

/// The steps of a series of time stamps, s.
///
/// # Errors
/// The sample, and that its time does not increase.
fn increasing(times: &[f64]) -> Result<Vec<f64>, (usize, Problem)> {
    let steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    match steps.iter().position(|&step| step <= 0.0) {
        Some(index) => {
            let problem = Problem::TimeNotIncreasing { previous: times[index], found: times[index + 1] };
            Err((index + 1, problem))
        }
        None => Ok(steps),
    }
}

/// The median step of at least two time stamps, s.
pub(super) fn median_step(times: &[f64]) -> f64 {
    median(&mut times.windows(2).map(|pair| pair[1] - pair[0]).collect::<Vec<_>>())
}

/// Where the rows of a series of time stamps are on a grid.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Grid {
    /// Time of its first point, that of the first row, s.
    pub(super) start: f64,
    /// The point of each row.
    pub(super) points: Vec<usize>,
    /// How far a stamp is from its point, at most, s.
    pub(super) off: f64,
}

/// Puts stamps that jitter, and those around rows that were lost, on the grid of a clock of so many ticks a second. The
/// clock may drift: each stamp corrects it by a little.
///
/// # Errors
/// The row, and what is wrong: a time that does not increase, two rows at one point, a rate that is not that of the
/// stamps, more rows lost than [`LONGEST_GAP_S`] has.
pub(super) fn on_grid(times: &[f64], rate: f64) -> Result<Grid, (usize, Problem)> {
    let median = median(&mut increasing(times)?);
    if (median * rate - 1.0).abs() > OTHER_RATE {
        return Err((0, Problem::OtherRate { rate, median }));
    }
    // The mean direction of the first stamps on a circle that goes around once a tick.
    let turns = times.iter().take(PHASE_STAMPS).map(|time| TAU * ((time - times[0]) * rate));
    let (sine, cosine) =
        turns.fold((0.0, 0.0), |(sine, cosine), turn| (sine + turn.sin(), cosine + turn.cos()));
    // No offset comes out as one of rounding, of either sign.
    let start = times[0] + sine.atan2(cosine) / (TAU * rate);
    let start = (start * START_PARTS).round() / START_PARTS + 0.0;
    let mut grid = Grid { start, points: vec![0], off: (times[0] - start).abs() };
    let (mut point, mut clock) = (0, start);
    for (row, &stamp) in times.iter().enumerate().skip(1) {
        let ticks = ((stamp - clock) * rate).round() as usize;
        if ticks == 0 {
            return Err((row, Problem::TwoAtOnce { previous: times[row - 1], found: stamp, rate }));
        }
        let lost = ticks - 1;
        if lost as f64 > LONGEST_GAP_S * rate {
            return Err((row, Problem::LongGap { lost, most: (LONGEST_GAP_S * rate) as usize }));
        }
        let due = clock + ticks as f64 / rate;
        grid.off = grid.off.max((stamp - due).abs());
        clock = due + CLOCK_GAIN * (stamp - due);
        point += ticks;
        grid.points.push(point);
    }
    Ok(grid)
}

/// Is a period, s, that of a rate, Hz?
pub(super) fn is_rate_of(period: f64, rate: f64) -> bool {
    (period * rate - 1.0).abs() < SAME_RATE
}

/// The rate of stamps that are uniform but for their rounding, if it is lost rows that make some steps long: stamps of 900 Hz
/// in whole milliseconds are those of 1 kHz without every tenth.
pub(super) fn rate_if_lost(times: &[f64]) -> Option<f64> {
    let median = median_step(times);
    times.windows(2).any(|pair| pair[1] - pair[0] > 1.5 * median).then(|| median.recip())
}

/// The median over the record of the mean step of a quarter of it: finer than the digits, and blind to a gap.
fn typical_step(times: &[f64]) -> f64 {
    let lag = (times.len() / 4).max(1);
    median(&mut times.windows(lag + 1).map(|part| (part[lag] - part[0]) / lag as f64).collect::<Vec<_>>())
}

/// The mean step; the inverse of a whole rate where the digits cannot tell the two apart.
fn period(times: &[f64], resolution: Resolution) -> f64 {
    let last = times.len() - 1;
    let mean = (times[last] - times[0]) / last as f64;
    let whole = mean.recip().round().recip();
    let doubt = (resolution.unit(times[last]) / last as f64).max(PERIOD_NOISE * mean);
    if (whole - mean).abs() <= doubt { whole } else { mean }
}

/// The upper median of values that are not empty; sorts them.
fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Start and period of stamps as printed.
    fn printed(texts: &[String]) -> Result<(f64, f64), usize> {
        let times: Vec<f64> = texts.iter().map(|text| text.parse().expect("a number")).collect();
        let mut digits = Digits::default();
        for text in texts {
            digits.add(text);
        }
        uniform(&times, digits.resolution(1.0)).map_err(|(index, _)| index)
    }

    fn decimals(count: usize, period: f64, decimals: usize) -> Vec<String> {
        (0..count).map(|k| format!("{:.decimals$}", k as f64 * period)).collect()
    }

    #[test]
    fn rounding_of_the_text_is_not_jitter() {
        for (rate, digits) in [(1024.0, 4), (1000.0 / 3.0, 3), (600.0, 3), (900.0, 3), (1500.0, 4)] {
            let (start, period) = printed(&decimals(400, 1.0 / rate, digits)).expect("uniform");
            assert_eq!(start, 0.0);
            let error = (period * rate - 1.0).abs();
            assert!(error < 2e-3, "{rate} Hz with {digits} decimals: off by {error}");
        }
    }

    #[test]
    fn rounding_may_look_like_lost_rows() {
        let stamps =
            |rate: f64| decimals(400, 1.0 / rate, 3).iter().map(|text| text.parse().unwrap()).collect();
        let rates = [(1000.0, false), (900.0, true), (600.0, false), (128.0, false)];
        for (rate, may_be) in rates {
            let times: Vec<f64> = stamps(rate);
            let found = rate_if_lost(&times).map(f64::round);
            assert_eq!(found, may_be.then_some(1000.0), "{rate}");
        }
        // One row in a hundred is lost.
        assert!(is_rate_of(1.0001e-3, 1000.0) && !is_rate_of(1.0 / 990.0, 1000.0));
    }

    #[test]
    fn six_significant_digits_are_enough() {
        let texts: Vec<String> = (0..2000)
            .map(|k| {
                let time = 99.0 + f64::from(k) * 0.0025;
                if time < 100.0 { format!("{time:.4}") } else { format!("{time:.3}") }
            })
            .map(|text| text.trim_end_matches('0').trim_end_matches('.').to_owned())
            .collect();
        assert!(printed(&texts).is_ok());
    }

    #[test]
    fn a_lost_row_is_found_at_every_number_of_decimals() {
        for digits in 3..7 {
            let mut texts = decimals(200, 1e-3, digits);
            texts.remove(77);
            assert_eq!(printed(&texts), Err(77), "{digits} decimals");
        }
    }

    #[test]
    fn one_percent_is_the_limit() {
        let mut times: Vec<f64> = (0..100).map(|k| f64::from(k) * 1e-3).collect();
        times[40] += 0.9e-5;
        assert!(uniform(&times, Resolution::EXACT).is_ok());
        times[40] += 0.3e-5;
        assert_eq!(uniform(&times, Resolution::EXACT).map_err(|(index, _)| index), Err(40));
    }

    #[test]
    fn slow_drift_of_the_clock_is_uniform() {
        let times: Vec<f64> =
            (0..5000).map(f64::from).map(|k| k * 1e-3 * (1.0 + 1e-3 * (k / 800.0).sin())).collect();
        assert!(uniform(&times, Resolution::EXACT).is_ok());
    }

    #[test]
    fn whole_rates_are_exact() {
        let times: Vec<f64> = (0..1000).map(|k| 5.0 + f64::from(k) * 1e-3).collect();
        assert_eq!(uniform(&times, Resolution::EXACT).map_err(|(index, _)| index), Ok((5.0, 1e-3)));
    }

    #[test]
    fn single_precision_stamps_are_uniform() {
        let times: Vec<f64> = (0..2000).map(|k| f64::from(1000.0_f32 + k as f32 * 1e-3)).collect();
        assert!(uniform(&times, Resolution::EXACT).is_err());
        assert!(uniform(&times, Resolution::of_singles(&times)).is_ok());
    }

    #[test]
    fn stamps_that_jitter_and_lost_rows_are_put_on_a_grid() {
        use rand_distr::{Distribution, Normal};
        use rand_xoshiro::rand_core::SeedableRng;
        let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(5);
        let jitter = Normal::new(0.0, 1e-4).unwrap();
        let lost = [0, 1, 77, 78, 79, 1500];
        // A clock that is 200 ppm slow: one sample in five seconds.
        for drift in [0.0, 2e-4, -2e-4] {
            let points: Vec<usize> = (0..5000).filter(|point| !lost.contains(point)).collect();
            let stamp =
                |&point: &usize| 7.0 + point as f64 * 1e-3 * (1.0 + drift) + jitter.sample(&mut random);
            let times: Vec<f64> = points.iter().map(stamp).collect();
            let grid = on_grid(&times, 1000.0).unwrap();
            assert!(grid.points.iter().zip(&points).all(|(found, point)| found + 2 == *point), "{drift}");
            assert!((grid.start - 7.002).abs() < 1e-4, "{}", grid.start);
            assert!(grid.off > 2e-4 && grid.off < 5e-4, "{}", grid.off);
        }
    }

    #[test]
    fn a_grid_of_exact_stamps_starts_at_the_first_one() {
        for first in [0, 3, 12_345] {
            let lost = |point: &i32| *point != first + 30;
            let times: Vec<f64> =
                (first..first + 100).filter(lost).map(|point| f64::from(point) / 1000.0).collect();
            let grid = on_grid(&times, 1000.0).unwrap();
            assert_eq!(grid.start.to_string(), times[0].to_string());
        }
    }

    #[test]
    fn stamps_that_are_of_no_grid_are_refused() {
        let mut times: Vec<f64> = (0..100).map(|k| f64::from(k) * 1e-3).collect();
        assert!(matches!(on_grid(&times, 500.0), Err((0, Problem::OtherRate { .. }))));
        assert!(matches!(on_grid(&times, 2000.0), Err((0, Problem::OtherRate { .. }))));
        times[40] = times[41] - 1e-5;
        assert!(matches!(on_grid(&times, 1000.0), Err((41, Problem::TwoAtOnce { .. }))));
        for time in &mut times[40..] {
            *time += 0.022;
        }
        assert!(matches!(on_grid(&times, 1000.0), Err((40, Problem::LongGap { lost: 23, most: 20 }))));
    }

    #[test]
    fn time_that_stands_still_is_refused() {
        let times = [0.0, 1.0, 1.0, 2.0];
        let found = uniform(&times, Resolution::EXACT);
        assert!(matches!(found, Err((2, Problem::TimeNotIncreasing { .. }))), "{found:?}");
    }
}
