//! Sensor trouble: found, counted, excluded, and without effect on the estimates.

use crate::flight::{Flight, Flown, HEALTHY, NOISE, WINDOW, config, feed, monitor};
use core::f32::consts::TAU;
use eha_monitor::monitor::Counters;
use eha_monitor::monitor::config::Config;
use eha_monitor::monitor::report::{Report, Verdict};
use eha_monitor::monitor::sample::Sample;
use eha_monitor::parameter::Parameters;
use eha_monitor::random::Random;
use eha_monitor::trial::SensorNoise;

/// A flight whose samples something happens to; none: the sample is lost.
fn troubled(
    windows: u32,
    mut trouble: impl FnMut(u32, Sample) -> Option<Sample>,
) -> (Vec<Report<2>>, Counters) {
    let flown = Flown::new(41);
    let mut flight = Flight::new(|sample| flown.at(sample), 41);
    let mut monitor = monitor();
    let mut reports = Vec::new();
    for number in 0..windows * WINDOW as u32 + 150 {
        if let Some(sample) = trouble(number, flight.next(HEALTHY)) {
            reports.extend(feed(&mut monitor, &sample));
        }
    }
    (reports, monitor.counters())
}

/// Every window is healthy, with estimates as good as without trouble.
fn all_healthy(reports: &[Report<2>]) {
    for report in reports {
        assert_eq!(report.verdict, Verdict::Healthy, "{report:?}");
        for (fault, truth) in report.faults.iter().zip(HEALTHY) {
            assert!((fault.value - truth).abs() < 4.5 * fault.standard_error, "{report:?}");
        }
        assert!(report.faults[1].standard_error < 10.0, "{report:?}");
    }
}

#[test]
fn a_quiet_stream_has_no_exclusions() {
    let (reports, counters) = troubled(3, |_, sample| Some(sample));
    all_healthy(&reports);
    assert_eq!(counters.exclusions.total(), 0, "{counters:?}");
}

#[test]
fn lost_samples_are_bridged() {
    let mut random = Random::new(1);
    let mut lost = 0;
    let (reports, counters) = troubled(4, |number, sample| {
        let is_lost = random.below(25) == 0 || (number % 500) < 8;
        lost += u32::from(is_lost && number > 0);
        (!is_lost).then_some(sample)
    });
    assert_eq!(reports.len(), 4);
    all_healthy(&reports);
    assert!(counters.exclusions.lost <= lost && counters.exclusions.lost + 10 > lost, "{counters:?} {lost}");
}

#[test]
fn a_jump_of_the_command_does_not_bend_the_bridge_behind_it() {
    for lost in [1, 5, 20] {
        let flown = Flown::lively(5);
        let jump = |sample| if sample >= 1600 { 1e-3 } else { 0.0 };
        let mut flight = Flight::new(|sample| flown.at(sample) + jump(sample), 5);
        let mut monitor = monitor();
        let mut reports = Vec::new();
        for number in 0..3 * WINDOW as u32 + 300 {
            let sample = flight.next(HEALTHY);
            if !(1601..=1600 + lost).contains(&number) {
                reports.extend(feed(&mut monitor, &sample));
            }
        }
        all_healthy(&reports);
    }
}

#[test]
fn values_that_are_none_are_left_out() {
    let mut random = Random::new(2);
    let mut counts = [0; 3];
    let (reports, counters) = troubled(4, |number, mut sample| {
        let kind = random.below(60);
        if kind < 3 && number > 10 {
            counts[kind] += 1;
        }
        match kind {
            0 if number > 10 => sample.user = f32::NAN,
            1 if number > 10 => sample.current = f32::INFINITY,
            2 if number > 10 => sample.command = f32::NAN,
            _ => {}
        }
        Some(sample)
    });
    all_healthy(&reports);
    let exclusions = counters.exclusions;
    assert_eq!([exclusions.not_a_number, exclusions.out_of_range, exclusions.bad_command], counts);
    assert_eq!(exclusions.total(), counts.iter().sum::<u32>(), "each is counted once: {exclusions:?}");
}

#[test]
fn a_bad_command_is_not_lost_as_well() {
    // Some in a row, beside samples that never came, and over more than is bridged.
    let (reports, counters) = troubled(5, |number, mut sample| {
        let lost = number % 700 == 300 || number % 700 == 303;
        if (number % 700).abs_diff(302) < 2 || (4000..4040).contains(&number) {
            sample.command = f32::NAN;
        }
        (!lost).then_some(sample)
    });
    assert!(reports.len() >= 5, "{reports:?}");
    let exclusions = counters.exclusions;
    // Seven times two bad commands between two samples that did not come.
    assert_eq!((exclusions.bad_command, exclusions.lost), (7 * 2 + 40, 7 * 2), "{exclusions:?}");
    assert_eq!(exclusions.total(), 7 * 4 + 40, "{exclusions:?}");
}

#[test]
fn spikes_are_left_out() {
    let mut random = Random::new(3);
    let mut spikes = 0;
    let (reports, counters) = troubled(4, |number, mut sample| {
        if number % 50 == 25 {
            spikes += 1;
            let sign = if random.below(2) == 0 { 1.0 } else { -1.0 };
            if random.below(2) == 0 {
                sample.user += sign * 30.0 * NOISE.user;
            } else {
                sample.current += sign * 30.0 * NOISE.current;
            }
        }
        Some(sample)
    });
    all_healthy(&reports);
    let found = counters.exclusions.spikes;
    assert!(found <= spikes && found * 10 >= spikes * 9, "{found} of {spikes}");
}

#[test]
fn samples_out_of_order_are_left_out() {
    let mut held: Option<Sample> = None;
    let (reports, counters) = troubled(3, |number, sample| match number % 100 {
        50 => held.replace(sample),
        52 => held.take(),
        _ => Some(sample),
    });
    all_healthy(&reports);
    assert!((28..36).contains(&counters.exclusions.out_of_order), "{counters:?}");
}

#[test]
fn a_stuck_sensor_is_a_sensor_fault_and_not_a_fault() {
    for current in [false, true] {
        let mut stuck = None;
        let (reports, counters) = troubled(6, |number, mut sample| {
            if (2200..3900).contains(&number) {
                let first = stuck.get_or_insert(sample);
                if current { sample.current = first.current } else { sample.user = first.user }
            }
            Some(sample)
        });
        let verdicts: Vec<_> = reports.iter().map(|report| report.verdict).collect();
        assert_eq!(verdicts[..2], [Verdict::Healthy; 2], "{verdicts:?}");
        assert_eq!(verdicts[2..4], [Verdict::SensorFault; 2], "{verdicts:?}");
        all_healthy(&reports[4..]);
        assert!(counters.exclusions.stuck > 1500, "{counters:?}");
        assert!(reports.iter().all(|report| report.faults.iter().all(|fault| fault.evidence == 0.0)));
    }
}

#[test]
fn a_coarse_sensor_that_stands_still_in_a_wide_backlash_is_not_stuck() {
    // In steps of 20 um that no noise hides; the backlash is 1.2 mm of the 1.5 mm that are searched.
    let sine = |sample: u32| 4e-3 * (TAU * 5e-4 * sample as f32).sin();
    let mut flight = Flight::new(sine, 43);
    let mut monitor = monitor();
    monitor.configure(&Config { noise: SensorNoise { user: 1e-5, ..NOISE }, ..config() }).unwrap();
    let mut reports = Vec::new();
    for _ in 0..4 * WINDOW + 300 {
        let mut sample = flight.quiet([1.2e-3, 400.0]);
        sample.user = (sample.user / 2e-5).round() * 2e-5;
        reports.extend(feed(&mut monitor, &sample));
    }
    assert_eq!(monitor.counters().exclusions.total(), 0, "{reports:?}");
    assert_eq!(reports.len(), 4);
    for report in &reports[1..] {
        assert_eq!(report.verdict, Verdict::Fault, "{report:?}");
        assert!(report.faults[0].alarmed, "{report:?}");
    }
}

#[test]
fn a_quiet_sensor_is_not_stuck_where_the_command_steps_after_a_rest() {
    // No ram has moved by the sample at which the command jumps.
    let mut flight = Flight::new(|sample| if sample < 1500 { 0.0 } else { 0.02 }, 44);
    let mut monitor = monitor();
    for _ in 0..2 * WINDOW + 300 {
        feed(&mut monitor, &flight.quiet(HEALTHY));
    }
    assert_eq!(monitor.counters().exclusions.total(), 0, "{:?}", monitor.counters());
}

#[test]
fn a_quiet_current_at_its_limit_is_not_stuck() {
    // The valve stays wide open for a tenth of a second and more after the command has turned back.
    let mut flight = Flight::new(|sample| 0.08 * (TAU * 1e-3 * sample as f32).sin(), 45);
    let mut random = Random::new(45);
    let mut monitor = monitor();
    let mut reports = Vec::new();
    for _ in 0..4 * WINDOW + 300 {
        // What was sent to the valve, without noise; the position has its own.
        let sample = flight.quiet(HEALTHY);
        let user = sample.user + NOISE.user * random.bell::<f32>();
        reports.extend(feed(&mut monitor, &Sample { user, ..sample }));
    }
    assert_eq!(monitor.counters().exclusions.total(), 0, "{:?}", monitor.counters());
    assert_eq!(reports.len(), 4);
    all_healthy(&reports);
}

#[test]
fn what_the_sensor_of_the_rig_makes_of_a_position_is_in_range() {
    // Near the stop: readings of some 0.28 m for 0.18, as of 0.27, and 0.28.
    let [offset, gain, cubic] = [
        Parameters { sensor_offset: 0.1, ..Parameters::default() },
        Parameters { sensor_gain: 0.5, ..Parameters::default() },
        Parameters { sensor_gain: 0.2, sensor_cubic: 10.0, ..Parameters::default() },
    ];
    for parameters in [offset, gain, cubic] {
        let flown = Flown::lively(46);
        let mut flight = Flight::of(&parameters, |sample| 0.17 + flown.at(sample), 46);
        let mut monitor = monitor();
        monitor.configure(&Config { parameters, ..config() }).unwrap();
        let reports: Vec<_> =
            (0..3 * WINDOW + 300).filter_map(|_| feed(&mut monitor, &flight.next(HEALTHY))).collect();
        assert_eq!(monitor.counters().exclusions.total(), 0, "{:?}", monitor.counters());
        assert_eq!(reports.len(), 3);
        // In the first one the model starts at rest where the sensor shows the ram: beyond its stop.
        assert_ne!(reports[0].verdict, Verdict::SensorFault, "{reports:?}");
        all_healthy(&reports[1..]);
    }
}

#[test]
fn a_sensor_that_fails_for_good_is_called_so() {
    for value in [f32::NAN, f32::INFINITY, 1.0, -1e20] {
        let (reports, _) = troubled(4, |number, mut sample| {
            if number >= 1300 {
                sample.user = value;
            }
            Some(sample)
        });
        let verdicts: Vec<_> = reports.iter().map(|report| report.verdict).collect();
        assert_eq!(verdicts[1..], [Verdict::SensorFault; 3], "{value}: {verdicts:?}");
    }
}

#[test]
fn a_long_gap_ends_the_window_and_a_new_count_is_followed() {
    let (reports, counters) = troubled(6, |number, mut sample| {
        // A gap of half a second; then the source starts to count anew.
        if number >= 3800 {
            sample.tick = sample.tick.wrapping_add(u32::MAX - 3000);
        }
        (!(1500..2000).contains(&number)).then_some(sample)
    });
    let verdicts: Vec<_> = reports.iter().map(|report| report.verdict).collect();
    assert_eq!(
        verdicts.iter().filter(|&&verdict| verdict == Verdict::SensorFault).count(),
        2,
        "{verdicts:?}"
    );
    let others: Vec<_> =
        reports.iter().filter(|report| report.verdict != Verdict::SensorFault).copied().collect();
    assert!(others.len() >= 3, "{verdicts:?}");
    all_healthy(&others);
    assert!(counters.exclusions.lost >= 500, "{counters:?}");
}
