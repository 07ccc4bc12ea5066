//! Values that stand for several samples: of a sensor that is read less often than it is recorded, or in coarse steps.
//!
//! A fit that took all samples of the first for measurements would find a delay of half of the time between two readings.
//! The second errs by the same as long as it stays on a step, and at each visit of the same place: as cogging does.

use crate::fit;
use crate::record::MIN_SAMPLES;

/// Share of the readings that may stand for fewer samples than is usual, less one.
const SHORTER: f64 = 0.05;
/// How far a reading is from the one before it, in steps of its channel, where it is not the channel's step that makes it
/// stay: the median.
const FAR: f64 = 3.0;

/// Share of the runs of a sensor with a common clock whose lengths may be no multiple of its beat.
const OFF_BEAT: f64 = 0.02;
/// Longest beat that is looked for, samples.
const SLOWEST: usize = 50;

/// How a sensor is read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Held {
    /// Samples from a reading to the next: the median.
    pub every: usize,
    /// Samples that are no readings: indices, in order.
    pub repeats: Vec<usize>,
}

/// How a sensor is read; none where each sample is a reading, for all that its values show.
///
/// A clock of its own may make a reading last a sample less or more; it is told by steps that are larger than those of the
/// channel. A common clock is told by its beat as well. A reading that comes out as the one before it, as at rest without
/// noise, is found by its time.
pub(super) fn held(values: &[f64]) -> Option<Held> {
    let runs: Vec<&[f64]> = values.chunk_by(|a, b| a == b).collect();
    // The first and the last may go on outside of the record.
    let inner = runs.get(1..runs.len().saturating_sub(1))?;
    if inner.len() < MIN_SAMPLES {
        return None;
    }
    let every = of_far_steps(inner).or_else(|| of_beat(inner))?;
    let mut repeats = Vec::new();
    let mut start = 0;
    for run in runs {
        let readings = ((run.len() + every / 2) / every).max(1);
        let is_reading = |within: usize| within.is_multiple_of(every) && within / every < readings;
        repeats.extend((0..run.len()).filter(|&within| !is_reading(within)).map(|within| start + within));
        start += run.len();
    }
    Some(Held { every, repeats })
}

/// Samples from a reading to the next, where hardly any is shorter than most, and most are far from the one before.
fn of_far_steps(runs: &[&[f64]]) -> Option<usize> {
    let mut lengths: Vec<usize> = runs.iter().map(|run| run.len()).collect();
    lengths.sort_unstable();
    let every = lengths[lengths.len() / 2];
    let shorter = lengths.partition_point(|&length| length < 2.max(every.saturating_sub(1)));
    let readings: Vec<f64> = runs.iter().map(|run| run[0]).collect();
    let mut steps: Vec<f64> = readings.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    steps.sort_by(f64::total_cmp);
    let is_far = steps[steps.len() / 2] >= FAR * fit::quantum(&readings);
    (every >= 2 && is_far && shorter as f64 <= SHORTER * lengths.len() as f64).then_some(every)
}

/// Samples from a reading to the next, where almost every length of a run is a multiple of it, and not all are the same:
/// what moves evenly from step to step is no slow sensor.
fn of_beat(runs: &[&[f64]]) -> Option<usize> {
    let is_beat = |&every: &usize| {
        let off = runs.iter().filter(|run| !run.len().is_multiple_of(every)).count();
        off as f64 <= OFF_BEAT * runs.len() as f64
    };
    let every = (2..=SLOWEST).rev().find(is_beat)?;
    let longer = runs.iter().filter(|run| run.len() > every).count();
    (longer as f64 > SHORTER * runs.len() as f64).then_some(every)
}

/// Samples of a channel that say nothing new because it is read in coarse steps, larger than a model is wrong: all that
/// stay on a step but the one or two in the middle, which are in the middle of the step as well where the motion goes on;
/// those too where it turns. Where the noise takes it to and fro between two steps, their mean says more than the steps.
pub(super) fn on_coarse_steps(values: &[f64], model_error: f64) -> Vec<usize> {
    let quantum = fit::quantum(values);
    if quantum < fit::COARSE * fit::noise_of_series(values) || quantum < model_error {
        return Vec::new();
    }
    let runs: Vec<&[f64]> = values.chunk_by(|a, b| a == b).collect();
    let value = |run: usize| runs.get(run).map(|run| run[0]);
    let returns: Vec<bool> = (0..runs.len())
        .map(|run| run.checked_sub(1).and_then(value).is_some_and(|before| value(run + 1) == Some(before)))
        .collect();
    let mut found = Vec::new();
    let mut start = 0;
    for (index, run) in runs.iter().enumerate() {
        let beside = [index.checked_sub(1), Some(index + 1)].into_iter().flatten();
        let is_to_and_fro =
            returns[index] && beside.filter_map(|run| returns.get(run)).any(|&returns| returns);
        let is_middle = |within: usize| within == run.len() / 2 || within == (run.len() - 1) / 2;
        let says_nothing =
            |within: &usize| run.len() > 2 && !is_to_and_fro && (returns[index] || !is_middle(*within));
        found.extend((0..run.len()).filter(says_nothing).map(|within| start + within));
        start += run.len();
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A motion with noise, recorded every millisecond and read at a rate.
    fn read_at(rate_hz: f64, noise: f64, quantum: f64) -> Vec<f64> {
        use rand_distr::{Distribution, Normal};
        use rand_xoshiro::rand_core::SeedableRng;
        let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(5);
        let normal = Normal::new(0.0, noise).unwrap();
        let (mut reading, mut value) = (-1, 0.0);
        (0..2000)
            .map(|sample| {
                let time = f64::from(sample) * 1e-3;
                if (time * rate_hz + 1e-9) as i32 != reading {
                    reading = (time * rate_hz + 1e-9) as i32;
                    let exact = 4e-3 * (31.4 * time).sin() + normal.sample(&mut random);
                    value = if quantum > 0.0 { (exact / quantum).round() * quantum } else { exact };
                }
                value
            })
            .collect()
    }

    #[test]
    fn a_sensor_that_is_read_less_often_is_told() {
        for noise in [0.0, 5e-6] {
            for quantum in [0.0, 1e-6, 1e-5] {
                for (rate, every) in [(500.0, 2), (200.0, 5), (100.0, 10), (190.0, 5)] {
                    let values = read_at(rate, noise, quantum);
                    let held = held(&values).unwrap_or_else(|| panic!("{rate} Hz, {noise} m, {quantum} m"));
                    assert_eq!(held.every, every);
                    let readings = values.len() as f64 * 1e-3 * rate;
                    let fresh = (values.len() - held.repeats.len()) as f64;
                    assert!((fresh / readings - 1.0).abs() < 0.06, "{rate} Hz: {fresh} of {readings}");
                    assert!(held.repeats.iter().all(|&sample| values[sample] == values[sample - 1]));
                }
                assert_eq!(held(&read_at(1000.0, noise, quantum)), None, "{noise} m, {quantum} m");
            }
        }
    }

    #[test]
    fn a_slow_sensor_is_told_by_its_beat_where_its_steps_are_coarse() {
        for (every, noise) in [(5, 0.0), (5, 8e-6), (2, 2e-6)] {
            let fresh = read_at(1000.0, noise, 2e-5);
            let values: Vec<f64> = (0..fresh.len()).map(|sample| fresh[sample - sample % every]).collect();
            let found = held(&values).map(|held| held.every);
            assert_eq!(found, Some(every), "{noise}");
        }
    }

    #[test]
    fn a_coarse_step_or_rest_is_no_slow_sensor() {
        for quantum in [5e-5, 2e-4, 1e-3] {
            for noise in [0.0, 5e-6, 5e-5] {
                assert_eq!(held(&read_at(1000.0, noise, quantum)), None, "{quantum} m, {noise} m");
            }
        }
        let ramp: Vec<f64> = (0..2000).map(|sample| f64::from(sample / 4) * 1e-5).collect();
        assert_eq!(held(&ramp), None);
        assert_eq!(held(&[0.0; 500]), None);
        assert_eq!(held(&[]), None);
    }

    #[test]
    fn of_a_coarse_step_the_middle_counts_where_the_motion_goes_on() {
        let values: Vec<f64> = [3, 3, 4, 4, 4, 4, 4, 5, 6, 6, 6, 5, 5, 5, 4, 3, 3, 3, 3]
            .into_iter()
            .cycle()
            .take(190)
            .map(|step| f64::from(step) * 1e-5)
            .collect();
        let found = on_coarse_steps(&values, 3e-7);
        let first: Vec<usize> = found.into_iter().take_while(|&sample| sample < 19).collect();
        assert_eq!(first, [2, 3, 5, 6, 8, 9, 10, 11, 13, 15, 16, 17, 18]);
    }

    #[test]
    fn the_middle_of_coarse_steps_errs_like_noise() {
        let exact = read_at(1000.0, 0.0, 0.0);
        let slow: Vec<f64> = exact.iter().map(|x| 0.02 * x).collect();
        for (noise, gain, fewest) in [(1e-9, 0.4, 1000), (2e-6, 1.0, 300)] {
            let step = 1e-5;
            let noisy = read_at(1000.0, noise, 0.0);
            let read = |k: usize| ((slow[k] + noisy[k] - exact[k]) / step).round() * step;
            let read: Vec<f64> = (0..slow.len()).map(read).collect();
            let left_out = on_coarse_steps(&read, 3e-7);
            let errors = |is_left: &dyn Fn(usize) -> bool| -> Vec<f64> {
                (0..read.len()).filter(|&k| is_left(k)).map(|k| read[k] - slow[k]).collect()
            };
            let mean_of_many =
                |errors: Vec<f64>| fit::rms(errors.iter().copied()) * fit::correlation_time(&[errors]).sqrt();
            let [thinned, all] =
                [errors(&|k| left_out.binary_search(&k).is_err()), errors(&|_| true)].map(mean_of_many);
            assert!(thinned < gain * all && left_out.len() > fewest, "{noise}: {thinned} {all}");
        }
        assert_eq!(on_coarse_steps(&read_at(1000.0, 5e-6, 1e-5), 3e-7), [0; 0]);
        assert_eq!(on_coarse_steps(&exact, 3e-7), [0; 0]);
    }
}
