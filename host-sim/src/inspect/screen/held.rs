//! A sensor that is read less often than it is recorded: each value stands for several samples.
//!
//! A fit that took them all for measurements would find a delay of half of the time between two readings.

use crate::fit;
use crate::record::MIN_SAMPLES;

/// Share of the readings that may stand for fewer samples than is usual, less one.
const SHORTER: f64 = 0.05;
/// How far a reading is from the one before it, in steps of its channel, where it is not the channel's step that makes it
/// stay: the median.
const FAR: f64 = 3.0;

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
/// A clock of its own may make a reading last a sample less or more. One that comes out as the one before it, as at rest
/// without noise, is found by its time.
pub(super) fn held(values: &[f64]) -> Option<Held> {
    let runs: Vec<&[f64]> = values.chunk_by(|a, b| a == b).collect();
    // The first and the last may go on outside of the record.
    let inner = runs.get(1..runs.len().saturating_sub(1))?;
    if inner.len() < MIN_SAMPLES {
        return None;
    }
    let mut lengths: Vec<usize> = inner.iter().map(|run| run.len()).collect();
    lengths.sort_unstable();
    let every = lengths[lengths.len() / 2];
    let shorter = lengths.partition_point(|&length| length < 2.max(every.saturating_sub(1)));
    if every < 2 || shorter as f64 > SHORTER * lengths.len() as f64 {
        return None;
    }
    let readings: Vec<f64> = runs.iter().map(|run| run[0]).collect();
    let mut steps: Vec<f64> = readings.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    steps.sort_by(f64::total_cmp);
    if steps[steps.len() / 2] < FAR * fit::quantum(&readings) {
        return None;
    }
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
}
