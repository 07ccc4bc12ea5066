//! How noisy a channel is, and how white a residual.

use super::limits::unclipped;
use super::periodogram::autocorrelations;
use crate::record::Record as Recorded;
use crate::rig::Rig;
use eha_monitor::channel::Channel;
use eha_monitor::fit::problem::Record;
use eha_monitor::model::state::Outputs;
use eha_monitor::trial::SensorNoise;

const MEASURED: usize = Channel::MEASURED.len();

/// Noise of the sensors that the design assumes, in the unit of each measured channel.
pub const TYPICAL_NOISE: [f64; MEASURED] = {
    let SensorNoise { user, current } = SensorNoise::<f64>::TYPICAL;
    [user, user, current, 2e4]
};

/// Noise below which a channel is not believed: 0.1 um of position, and what that is in the other channels of the
/// source's actuator.
pub const SMALLEST_NOISE: [f64; MEASURED] = [1e-7, 1e-7, 1e-3, 1e3];

/// Error of a model in each measured channel though nothing is missing: how far its steps, or those of the program that
/// made a record, may be off the solution of the equations. It repeats itself, and an effect that changes a prediction
/// by less does not matter.
pub const MODEL_ERROR: [f64; MEASURED] = [0.3e-6, 0.3e-6, 3e-3, 3e3];

/// A command that turns at fewer than one in so many samples goes in straight lines.
const SELDOM: usize = 20;

/// What fourth differences make of white noise: `sqrt(1 + 16 + 36 + 16 + 1)`.
const OF_FIVE: f64 = 8.366_600_265_340_756;

/// Relative standard error of a standard deviation that is the root mean square, or the median, of fourth differences, times the
/// root of their number. That of independent ones is `sqrt(1/2)`, or `sqrt(1.36)`; neighbours have most of their samples in
/// common, so that 2.63 of them say what one says, the sum of the squares of their correlations.
const ERROR_OF_RMS: f64 = 1.147;
const ERROR_OF_MEDIAN: f64 = 1.891;

/// Standard errors by which an estimate of noise may be too large.
const UNSURE: f64 = 2.0;

/// Part of the magnitudes of a noise, the smallest, that steps and reversals are not among, and their root mean square in
/// standard deviations of all of it.
const USUAL: f64 = 0.98;
const RMS_OF_USUAL: f64 = 0.934_6;

/// Step of a series, in standard deviations of all of its noise, from which on that does not hide it: white noise of a
/// quarter of a step.
pub const COARSE: f64 = 2.6;

/// Fourth differences of a series from which on their median tells its noise, to a fifth.
const FEW: usize = 30;

/// Where the noise of a channel comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoiseSource {
    /// The rig states it.
    Rig,
    /// It was estimated from the record.
    Estimated,
    /// No record has the channel.
    Absent,
}

impl NoiseSource {
    /// Name in results.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rig => "rig",
            Self::Estimated | Self::Absent => "record",
        }
    }
}

/// Standard deviation of the noise of each measured channel of a record, in its unit: the rig's, else what the record
/// shows; infinite where it lacks the channel.
pub fn noise_of(rig: &Rig, record: &Recorded) -> [f64; MEASURED] {
    std::array::from_fn(|index| {
        let channel = Channel::MEASURED[index];
        record.channel(channel).map_or(f64::INFINITY, |values| {
            rig.noise_of(channel).unwrap_or_else(|| shown_noise(index, values))
        })
    })
}

/// Standard deviation of the noise that the values of a measured channel, given by its place, show, in its unit.
pub fn shown_noise(channel: usize, values: &[f64]) -> f64 {
    noise_of_series(&unclipped(values)).max(SMALLEST_NOISE[channel])
}

/// The step in which a command was recorded, m; 0 where it shows none.
///
/// A command of straight lines has its values on a grid as well, but turns at corners only.
pub(super) fn command_step(command: &[f64]) -> f64 {
    let step = quantum(command);
    let turns = command.windows(3).filter(|w| (w[2] - 2.0 * w[1] + w[0]).abs() > 0.5 * step).count();
    if turns * SELDOM > command.len() { step } else { 0.0 }
}

/// Where the noise of each measured channel of records comes from.
pub fn noise_source(rig: &Rig, records: &[Recorded]) -> [NoiseSource; MEASURED] {
    Channel::MEASURED.map(|channel| {
        if records.iter().all(|record| record.channel(channel).is_none()) {
            NoiseSource::Absent
        } else if rig.noise_of(channel).is_some() {
            NoiseSource::Rig
        } else {
            NoiseSource::Estimated
        }
    })
}

/// Root mean square, over records, of the noise of each channel; infinite where no record has the channel.
pub fn pooled(records: impl Iterator<Item = [f64; MEASURED]>) -> [f64; MEASURED] {
    let mut sums = [(0.0, 0_usize); MEASURED];
    for noise in records {
        for ((sum, count), noise) in sums.iter_mut().zip(noise).filter(|(_, noise)| noise.is_finite()) {
            *sum += noise * noise;
            *count += 1;
        }
    }
    sums.map(|(sum, count)| if count == 0 { f64::INFINITY } else { (sum / count as f64).sqrt() })
}

/// Standard deviation of the white part of a series.
///
/// Fourth differences take out what is smooth over five samples; their spread over that of white noise is
/// `sqrt(1 + 16 + 36 + 16 + 1)`. The median absolute value ignores steps and reversals. A quantised series at rest has
/// mostly zero differences: the noise is then not below that of the quantum, `q/sqrt(12)`. Where the samples that are not
/// missing are [sparse](is_sparse), they are taken for neighbours.
pub fn noise_of_series(values: &[f64]) -> f64 {
    shown_by(values, |spread| spread.deviation)
}

/// What that is at least: no scatter of the differences makes more of less.
pub(super) fn least_noise_of_series(values: &[f64]) -> f64 {
    shown_by(values, |spread| spread.deviation * (1.0 - UNSURE * spread.relative_error).max(0.0))
}

/// What is taken for the standard deviation of the white part of a series, given how its differences spread.
fn shown_by(values: &[f64], deviation: impl Fn(Spread) -> f64) -> f64 {
    let present = present(values);
    let values = if is_sparse(values) { &present } else { values };
    let quantum = quantum(values);
    deviation(spread(values, quantum)).max(quantum / 12.0_f64.sqrt())
}

/// Are hardly any five samples in a row there, as where a sensor is read at every second one?
pub fn is_sparse(values: &[f64]) -> bool {
    fourth_differences(values).take(FEW).count() < FEW
}

/// The samples of a series that are not missing.
pub fn present(values: &[f64]) -> Vec<f64> {
    values.iter().copied().filter(|value| value.is_finite()).collect()
}

/// White noise as fourth differences tell it.
struct Spread {
    /// Its standard deviation.
    deviation: f64,
    /// Standard error of that, as a part of it.
    relative_error: f64,
}

/// Standard deviation of the white part of a series from its fourth differences alone, those of values that are
/// multiples of a quantum (0: of any). Where that is larger than the noise, a rest or a slow motion makes patterns of them:
/// those are looked at then over which the motion goes on by two steps, where it does so at one in ten.
fn spread(values: &[f64], quantum: f64) -> Spread {
    let mut differences: Vec<f64> = fourth_differences(values).collect();
    if differences.is_empty() {
        return Spread { deviation: 0.0, relative_error: 0.0 };
    }
    let of_all = rms(differences.iter().copied()) / OF_FIVE;
    if quantum > of_all {
        let moves = |w: &&[f64]| (w[4] - w[0]).abs() > 1.5 * quantum;
        let mut moving: Vec<f64> = values.windows(5).filter(moves).flat_map(fourth_differences).collect();
        if 10 * moving.len() > differences.len() {
            moving.sort_by(f64::total_cmp);
            let usual = (USUAL * moving.len() as f64) as usize;
            return Spread {
                deviation: rms(moving[..usual].iter().copied()) / RMS_OF_USUAL / OF_FIVE,
                relative_error: ERROR_OF_RMS / (moving.len() as f64).sqrt(),
            };
        }
    }
    differences.sort_by(f64::total_cmp);
    let of_most = median(&differences, quantum) / 0.674_489_75 / OF_FIVE;
    Spread {
        deviation: if quantum > COARSE * of_all { of_most.min(of_all) } else { of_most },
        relative_error: ERROR_OF_MEDIAN / (differences.len() as f64).sqrt(),
    }
}

/// Magnitudes of the fourth differences of a series, where none of their samples is missing: what is smooth over five
/// samples is not in them.
pub fn fourth_differences(values: &[f64]) -> impl Iterator<Item = f64> + '_ {
    let difference = |w: &[f64]| (w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]).abs();
    values.windows(5).map(difference).filter(|difference| difference.is_finite())
}

/// Median of magnitudes in order, some of them. Those that are multiples of a quantum stand for all that lies half of
/// it around each: the middle one alone would err by that much.
fn median(magnitudes: &[f64], quantum: f64) -> f64 {
    let middle = magnitudes[magnitudes.len() / 2];
    let below = magnitudes.partition_point(|&magnitude| magnitude < middle - 0.5 * quantum);
    let up_to = magnitudes.partition_point(|&magnitude| magnitude <= middle + 0.5 * quantum);
    let edges = [(middle - 0.5 * quantum).max(0.0), middle + 0.5 * quantum];
    let share = (0.5 * magnitudes.len() as f64 - below as f64) / (up_to - below) as f64;
    edges[0] + share * (edges[1] - edges[0])
}

/// How far a difference may be from a whole number of steps, as a part of the largest value: what a file's digits round
/// away.
const DIGITS: f64 = 1e-8;
/// The same, as a part of the difference.
const RELATIVE: f64 = 1e-6;

/// Most digits behind the point that are looked for.
const DECIMALS: i32 = 12;

/// The place of the last digit of values that are written with a fixed number of them behind the point; 0 where they are not.
fn last_digit(values: &[f64]) -> f64 {
    let are_whole = |scale: &f64| {
        let mut scaled = values.iter().filter(|value| value.is_finite()).map(|value| value * scale);
        scaled.all(|value| (value - value.round()).abs() < DIGITS * value.abs().max(1.0))
    };
    (0..=DECIMALS).map(|digits| 10.0_f64.powi(digits)).find(are_whole).map_or(0.0, f64::recip)
}

/// The step in which a series is quantised; 0 where it is not (fewer than nine in ten of its differences are whole numbers
/// of one). Small differences tell the step roughly, and larger ones then better: the numbers of a file are rounded.
pub fn quantum(values: &[f64]) -> f64 {
    let mut steps: Vec<f64> =
        values.windows(2).map(|w| (w[1] - w[0]).abs()).filter(|step| step.is_finite()).collect();
    steps.sort_by(f64::total_cmp);
    let moving = &steps[steps.partition_point(|&step| step == 0.0)..];
    let Some(&smallest) = moving.first() else { return 0.0 };
    let largest = values.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
    let off = |step: f64, quantum: f64| (step - (step / quantum).round() * quantum).abs();
    let (mut way, mut count) = (smallest, 1.0);
    for &step in &moving[1..] {
        let quantum = way / count;
        if off(step, quantum) < 0.1 * quantum {
            (way, count) = (way + step, count + (step / quantum).round());
        }
    }
    let quantum = way / count;
    let rounded = last_digit(values).max(DIGITS * largest);
    let is_whole = |step: f64| off(step, quantum) < (RELATIVE * step).max(rounded).min(0.01 * quantum);
    let whole = steps.iter().filter(|&&step| is_whole(step)).count();
    if whole * 10 > steps.len() * 9 { quantum } else { 0.0 }
}

/// Residual series of a measured channel, one for each record: measured minus predicted, over the samples that are
/// compared; NaN where a sample is missing, empty where the channel is absent.
pub fn residual_series(
    records: &[Record<'_, f64>],
    predictions: &[Vec<Outputs<f64>>],
    channel: usize,
) -> Vec<Vec<f64>> {
    records
        .iter()
        .zip(predictions)
        .map(|(record, outputs)| {
            outputs
                .iter()
                .zip(record.measured[channel])
                .enumerate()
                .filter(|(sample, _)| record.is_compared(*sample))
                .map(|(_, (output, value))| value - output.to_array()[channel])
                .collect()
        })
        .collect()
}

/// Root mean square of the residual of each measured channel, in its unit.
pub(super) fn residual_rms(
    records: &[Record<'_, f64>],
    predictions: &[Vec<Outputs<f64>>],
) -> [Option<f64>; MEASURED] {
    std::array::from_fn(|channel| {
        let (mut sum, mut count) = (0.0, 0_usize);
        for value in residual_series(records, predictions, channel).iter().flatten().filter(|x| x.is_finite())
        {
            sum += value * value;
            count += 1;
        }
        (count > 0).then(|| (sum / count as f64).sqrt())
    })
}

/// Root mean square of the values that are finite.
pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values
        .filter(|value| value.is_finite())
        .fold((0.0, 0_usize), |(sum, count), value| (sum + value * value, count + 1));
    (sum / count.max(1) as f64).sqrt()
}

/// One prediction of a record minus another one, sample by sample, in a measured channel.
pub fn differences<'a>(
    one: &'a [Outputs<f64>],
    other: &'a [Outputs<f64>],
    channel: usize,
) -> impl Iterator<Item = f64> + 'a {
    one.iter().zip(other).map(move |(one, other)| one.to_array()[channel] - other.to_array()[channel])
}

/// How many samples of a residual say the same thing: its integrated autocorrelation time, in samples that are not
/// missing, at least 1. The sum ends at the first lag whose correlation is within its own noise.
pub fn correlation_time(all: &[Vec<f64>]) -> f64 {
    let all: Vec<Vec<f64>> = all.iter().map(|one| present(one)).collect();
    let count: usize = all.iter().map(Vec::len).sum();
    let mut products = LaggedProducts::new(&all);
    let power: f64 = all.iter().flatten().map(|value| value * value).sum();
    if power == 0.0 {
        return 1.0;
    }
    let mut time = 1.0;
    for lag in 1..count / 10 {
        let correlation = products.at(lag) / power;
        if correlation < 2.0 / (count as f64).sqrt() {
            break;
        }
        time += 2.0 * correlation;
    }
    time
}

/// How many samples of what a model leaves say the same thing: the longest correlation time of a measured channel, whose
/// residuals are given by its place.
pub fn longest_correlation_time(residuals: impl Fn(usize) -> Vec<Vec<f64>>) -> f64 {
    (0..MEASURED).map(|channel| correlation_time(&residuals(channel))).fold(1.0, f64::max)
}

/// Sums of the products of series with themselves some samples later. The first ones are summed; all of those that
/// follow come out of one transform, because what drifts is correlated over its whole length.
#[derive(Debug)]
pub struct LaggedProducts<'a> {
    all: &'a [Vec<f64>],
    rest: Option<Vec<f64>>,
}

impl<'a> LaggedProducts<'a> {
    /// Lags that are summed one by one.
    const FEW: usize = 256;

    /// Of series, one for each record; NaN adds nothing.
    pub const fn new(all: &'a [Vec<f64>]) -> Self {
        Self { all, rest: None }
    }

    /// The sum for so many samples later.
    pub fn at(&mut self, lag: usize) -> f64 {
        let all = self.all;
        if lag > Self::FEW {
            let rest = self.rest.get_or_insert_with(|| autocorrelations(all));
            return rest.get(lag).copied().unwrap_or(0.0);
        }
        let product = |(a, b): (&f64, &f64)| a * b;
        let one = |one: &Vec<f64>| -> f64 {
            one.iter().zip(one.iter().skip(lag)).map(product).filter(|product| product.is_finite()).sum()
        };
        all.iter().map(one).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noisy(count: usize, sigma: f64, signal: impl Fn(f64) -> f64) -> Vec<f64> {
        drawn(5, count, sigma, signal)
    }

    fn drawn(seed: u64, count: usize, sigma: f64, signal: impl Fn(f64) -> f64) -> Vec<f64> {
        use rand_distr::{Distribution, Normal};
        use rand_xoshiro::rand_core::SeedableRng;
        let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(seed);
        let normal = Normal::new(0.0, sigma).unwrap();
        (0..count).map(|k| signal(k as f64 * 1e-3) + normal.sample(&mut random)).collect()
    }

    #[test]
    fn noise_of_a_moving_signal_is_found_to_five_percent() {
        let values = noisy(5000, 5e-6, |t| 4e-3 * (31.4 * t).sin());
        assert!((noise_of_series(&values) / 5e-6 - 1.0).abs() < 0.05);
    }

    #[test]
    fn noise_of_a_signal_that_is_read_seldom_is_found() {
        let values = noisy(2000, 5e-6, |t| 4e-3 * (12.0 * t).sin());
        let read = |is_read: &dyn Fn(usize) -> bool| -> f64 {
            let seen = values.iter().enumerate().map(|(k, &value)| if is_read(k) { value } else { f64::NAN });
            noise_of_series(&seen.collect::<Vec<_>>())
        };
        for every in 2..=5 {
            for first in 0..2 {
                let noise = read(&|k| k % every == first);
                assert!((noise / 5e-6 - 1.0).abs() < 0.15, "{every}: {noise}");
            }
        }
        // Three in ten are missing anywhere: what is there of five in a row tells.
        let anywhere = noisy(2000, 1.0, |_| 0.0);
        let noise = read(&|k| anywhere[1999 - k] < 0.52);
        assert!((noise / 5e-6 - 1.0).abs() < 0.15, "{noise}");
    }

    #[test]
    fn a_coarse_quantum_does_not_hide_the_noise() {
        let fine = noisy(20_000, 5e-6, |t| 4e-3 * (31.4 * t).sin());
        let mut worst = [0.0_f64; 2];
        for quantum in [1e-6, 2e-6, 3.3e-6, 5e-6, 7.7e-6, 1e-5, 1.3e-5] {
            let values: Vec<f64> = fine.iter().map(|x| (x / quantum).round() * quantum).collect();
            let truth = (5e-6_f64.powi(2) + quantum.powi(2) / 12.0).sqrt();
            for (worst, found) in
                worst.iter_mut().zip([noise_of_series(&values), spread(&values, 0.0).deviation])
            {
                *worst = worst.max((found / truth - 1.0).abs());
            }
        }
        // The second is the control: the middle difference alone, as if there were no quantum.
        assert!(worst[0] < 0.05 && worst[1] > 0.08, "{worst:?}");
    }

    #[test]
    fn where_a_motion_crosses_coarse_steps_they_show_the_noise() {
        let rest_and_sweep = |t: f64| if t < 1.0 { 0.0 } else { 4e-3 * (6.0 * (t - 1.0).powi(2)).sin() };
        for sigma in [1e-6, 2e-6, 5e-6] {
            let fine = noisy(4000, sigma, rest_and_sweep);
            for quantum in [2.0, 3.5, 5.0, 8.0].map(|steps| steps * sigma) {
                let values: Vec<f64> = fine.iter().map(|x| (x / quantum).round() * quantum).collect();
                let truth = (sigma.powi(2) + quantum.powi(2) / 12.0).sqrt();
                let found = noise_of_series(&values);
                assert!((found / truth - 1.0).abs() < 0.1, "{quantum} {sigma}: {found} {truth}");
            }
        }
    }

    #[test]
    fn the_least_noise_of_a_series_is_not_more_than_there_is() {
        for quantum in [1e-9, 1.5, 3.0, 4.5] {
            let truth = 1.0_f64.hypot(quantum / 12.0_f64.sqrt());
            let shown = (0..200).map(|seed| {
                let fine = drawn(seed, 800, 1.0, |t| 800.0 * (31.4 * t + seed as f64).sin());
                let values: Vec<f64> = fine.iter().map(|x| (x / quantum).round() * quantum).collect();
                [noise_of_series(&values), least_noise_of_series(&values)]
            });
            let shown: Vec<[f64; 2]> = shown.collect();
            let too_much = [0, 1].map(|which| shown.iter().filter(|noise| noise[which] > truth).count());
            // The likeliest is the control.
            assert!(too_much[0] > 60 && too_much[1] <= 12, "{quantum}: {too_much:?}");
            let in_errors =
                rms(shown.iter().map(|[noise, least]| UNSURE * (noise - truth) / (noise - least)));
            assert!((in_errors - 1.0).abs() < 0.25, "{quantum}: {in_errors}");
        }
    }

    #[test]
    fn a_quantised_series_at_rest_shows_the_noise_of_its_quantum() {
        let values: Vec<f64> =
            noisy(5000, 1e-9, |t| 1e-3 * t).iter().map(|x| (x / 1e-6).round() * 1e-6).collect();
        let noise = noise_of_series(&values);
        assert!(noise > 0.28e-6 && noise < 0.5e-6, "{noise}");
        assert_eq!(quantum(&noisy(500, 5e-6, |_| 0.0)), 0.0);
    }

    #[test]
    fn a_quantum_is_found_behind_the_rounding_of_a_file() {
        let step = 8.870_738_58e-7;
        let exact = noisy(2000, 4e-6, |t| 4e-3 * (31.4 * t).sin());
        for digits in [8, 9, 12] {
            let written =
                |value: &f64| format!("{:.digits$e}", (value / step).round() * step).parse().unwrap();
            let values: Vec<f64> = exact.iter().map(written).collect();
            let found = quantum(&values);
            assert!((found / step - 1.0).abs() < 1e-4, "{digits} digits: {found}");
        }
        // A step that is no whole number of the last digit, behind the point.
        for (step, decimals) in [(16.730_2e-6, 9_u8), (16.730_2e-6, 8), (4.387e-6, 9), (1.234_56e-6, 10)] {
            let digits = usize::from(decimals);
            let written =
                |value: &f64| format!("{:.digits$}", (value / step).round() * step).parse().unwrap();
            let values: Vec<f64> = exact.iter().map(written).collect();
            let found = quantum(&values);
            assert!((found / step - 1.0).abs() < 1e-3, "{step} in {decimals} decimals: {found}");
            // Numbers that are written so are in steps of their last digit, if of any.
            let fine: Vec<f64> =
                exact.iter().map(|value| format!("{value:.digits$}").parse().unwrap()).collect();
            let found = quantum(&fine);
            assert!(found < 1.5 * 10.0_f64.powi(-i32::from(decimals)), "{decimals} decimals: {found}");
        }
    }

    #[test]
    fn products_of_few_and_of_many_samples_apart_are_the_same() {
        let mut all = [noisy(3000, 1.0, |t| 3.0 * t), noisy(900, 1.0, |t| -2.0 * t)];
        all[0][100] = f64::NAN;
        let transformed = autocorrelations(&all);
        let mut summed = LaggedProducts::new(&all);
        for lag in 0..LaggedProducts::FEW {
            let (one, other) = (summed.at(lag), transformed[lag]);
            assert!((one - other).abs() < 1e-9 * transformed[0], "{lag}: {one} {other}");
        }
        // A drift is correlated over a third of its length and more.
        assert!(correlation_time(&all) > 300.0);
    }

    #[test]
    fn the_step_of_a_command_is_found_and_a_grid_of_straight_lines_is_none() {
        let (step, sine) = (5e-6, |t: f64| 4e-3 * (31.4 * t).sin());
        let sampled = |command: &dyn Fn(f64) -> f64| -> Vec<f64> {
            (0..1000).map(|sample| command(1e-3 * f64::from(sample))).collect()
        };
        let found = command_step(&sampled(&|t| (sine(t) / step).round() * step));
        assert!((found / step - 1.0).abs() < 1e-6, "{found}");
        assert_eq!(command_step(&sampled(&sine)), 0.0);
        // On a grid of 10 um, turning twice.
        let lines = sampled(&|t| {
            if t < 0.3 {
                0.01 * t
            } else if t < 0.6 {
                3e-3
            } else {
                3e-3 + 0.02 * (t - 0.6)
            }
        });
        assert!(quantum(&lines) > 0.0);
        assert_eq!(command_step(&lines), 0.0);
    }
}
