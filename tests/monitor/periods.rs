//! Sample periods other than a millisecond: what the screen excludes is a matter of time, and of the motion.

use crate::flight::{Flight, HEALTHY, Steps, config};
use eha_monitor::monitor::Monitor;
use eha_monitor::monitor::config::Config;
use eha_monitor::monitor::report::{Report, Verdict};
use eha_monitor::monitor::screen::Exclusions;
use eha_monitor::parameter::Parameters;
use std::f64::consts::TAU;

/// Reports on some windows of `SAMPLES` samples of a healthy actuator that follows a sine, Hz and m, and what was excluded of
/// them; some samples are lost.
fn reports<const SAMPLES: usize>(
    period: f32,
    [frequency, amplitude]: [f64; 2],
    windows: usize,
    is_lost: impl Fn(u32) -> bool,
) -> (Vec<Report<2>>, Exclusions) {
    let sine =
        |sample: u32| (amplitude * (TAU * frequency * f64::from(sample) * f64::from(period)).sin()) as f32;
    let mut flight = Flight::sampled(period, &Parameters::default(), sine, 3);
    let mut monitor = Box::new(Monitor::<Steps, SAMPLES, 2, 20>::idle(Steps::new()));
    let steps_per_sample = 1000;
    let config = Config { sample_period: period, steps_per_sample, ..config() };
    monitor.configure(&config).expect("a configuration that is right");
    let mut reports = Vec::new();
    for _ in 0..windows * SAMPLES + SAMPLES / 2 {
        let sample = flight.next(HEALTHY);
        if !is_lost(sample.tick) {
            monitor.take(&sample);
        }
        reports.extend(monitor.work(steps_per_sample).1);
    }
    (reports, monitor.counters().exclusions)
}

fn all_healthy(reports: &[Report<2>], windows: usize) {
    assert_eq!(reports.len(), windows, "{reports:?}");
    assert!(reports.iter().all(|report| report.verdict == Verdict::Healthy), "{reports:?}");
}

#[test]
fn the_turns_of_an_actuator_that_is_sampled_slowly_are_no_spikes() {
    // 0.1 m/s and more between two samples: a turn is up to 0.3 mm off both of its neighbours.
    for [frequency, amplitude] in [[4.3, 3e-3], [3.1, 3e-3], [2.0, 4e-3]] {
        let (reports, exclusions) = reports::<100>(1e-2, [frequency, amplitude], 6, |_| false);
        assert_eq!(exclusions.total(), 0, "{frequency} Hz: {exclusions:?}");
        all_healthy(&reports, 6);
    }
    let (reports, exclusions) = reports::<200>(5e-3, [7.3, 3e-3], 6, |_| false);
    assert_eq!(exclusions.total(), 0, "{exclusions:?}");
    assert_eq!(reports.len(), 6);
}

#[test]
fn what_is_bridged_is_a_time() {
    // 10 ms are bridged at every rate; 0.15 s are not, and end the window.
    for lost in [1, 15] {
        let (said, exclusions) =
            reports::<100>(1e-2, [2.0, 3e-3], 9, |sample| sample >= 250 && sample < 250 + lost);
        assert_eq!(exclusions.lost, lost);
        let broken = said.iter().filter(|report| report.verdict == Verdict::SensorFault).count();
        assert_eq!(broken, usize::from(lost > 2), "{said:?}");
        assert!(said.iter().all(|report| report.verdict != Verdict::ModelInadequate), "{said:?}");
    }
    let (said, exclusions) = reports::<4000>(2.5e-4, [2.0, 3e-3], 2, |sample| (5000..5040).contains(&sample));
    assert_eq!(exclusions.lost, 40);
    all_healthy(&said, 2);
}
