//! The work of the background: never more than it is allowed, and the same result however it is cut.

use crate::flight::{Flight, Flown, HEALTHY, Steps, TestMonitor, WINDOW, config, monitor, timeless};
use eha_monitor::integrate::LONGEST_PIECE;
use eha_monitor::integrate::observed::Observed;
use eha_monitor::monitor::Monitor;
use eha_monitor::monitor::config::Config;
use eha_monitor::monitor::queue::SampleQueue;
use eha_monitor::monitor::report::Report;
use eha_monitor::parameter::Parameters;
use std::cell::Cell;

/// A configuration that explains nothing: the torque motor is said to have lost a third of its gain, and has not.
fn wrong() -> Config<2> {
    let source = Parameters::default();
    let parameters = Parameters { torque_motor_gain: 0.7 * source.torque_motor_gain, ..source };
    Config { parameters, ..config() }
}

/// Reports of a flight with some polls of a budget every so many samples, without what depends on the time that they took.
fn reports(config: &Config<2>, [budget, polls, every]: [u32; 3]) -> Vec<Report<2>> {
    let flown = Flown::new(21);
    let mut flight = Flight::new(|sample| flown.at(sample), 21);
    let mut queue = SampleQueue::<64>::new();
    let (mut inlet, mut outlet) = queue.split();
    let mut monitor: Box<TestMonitor> = monitor();
    monitor.configure(config).unwrap();
    let mut reports = Vec::new();
    for sample in 0..5 * WINDOW as u32 {
        assert!(inlet.push(flight.next(HEALTHY)));
        if sample % every == every - 1 {
            for number in 0..polls {
                let poll = monitor.poll(&mut outlet, budget);
                assert_eq!(poll.samples, if number == 0 { every } else { 0 });
                reports.extend(poll.report.map(timeless));
            }
        }
    }
    reports
}

#[test]
fn the_result_does_not_depend_on_how_the_work_is_cut() {
    let cuts = [
        [20, 12, 1],
        [LONGEST_PIECE, 12, 1],
        [LONGEST_PIECE + 1, 8, 1],
        [57, 1, 1],
        [1000, 1, 20],
        [100_000, 1, 7],
    ];
    // Searches that come to their end, and some that run out of steps: in the first look, in a descent, while they breed.
    let short = [1, 3, 9, 20, 24].map(|steps_per_sample| Config { steps_per_sample, ..wrong() });
    for config in [config()].iter().chain(&short) {
        let whole = reports(config, [u32::MAX, 1, 1]);
        assert_eq!(whole.len(), 4);
        for cut in cuts {
            assert_eq!(reports(config, cut)[..3], whole[..3], "{cut:?} of {}", config.steps_per_sample);
        }
        assert_eq!(reports(config, [0, 100, 1]), []);
    }
}

/// Of ten flights of a held command: the windows, those that were skipped, and the latest report, samples.
fn pace(config: &Config<2>, steps: u32) -> (u32, u32, u32) {
    let (mut windows, mut skipped, mut latest) = (0, 0, 0);
    for seed in 0..10 {
        let flown = Flown::lively(seed);
        let mut flight = Flight::new(|sample| flown.at(sample), seed);
        flight.holds = true;
        let mut monitor = monitor();
        monitor.configure(&Config { holds_command: true, ..*config }).unwrap();
        for _ in 0..6 * WINDOW + 100 {
            monitor.take(&flight.next(HEALTHY));
            let report = monitor.work(steps).1;
            latest = latest.max(report.map_or(0, |report| report.latency_samples));
        }
        windows += monitor.counters().windows;
        skipped += monitor.counters().skipped;
    }
    (windows, skipped, latest)
}

#[test]
fn a_search_ends_before_the_next_window_is_full() {
    // A command that is held, and a model that explains nothing: the dearest searches.
    for steps in [40, 60, 100, 200] {
        let (windows, skipped, latest) = pace(&Config { steps_per_sample: steps, ..wrong() }, steps);
        println!(
            "{steps} steps a sample: the latest report of {windows} is {latest} samples behind its window"
        );
        assert_eq!((windows, skipped), (60, 0), "{steps}");
        assert!(latest < WINDOW as u32, "{steps}: {latest}");
    }
    // What a search takes that nobody ends.
    let (_, skipped, latest) = pace(&Config { steps_per_sample: u32::MAX, ..wrong() }, 100);
    assert!(skipped > 20 && latest > 2 * WINDOW as u32, "{skipped} {latest}");
}

#[test]
fn a_small_budget_is_saved_up_and_used_to_the_last_step() {
    for budget in [1, 7, 20, LONGEST_PIECE - 1] {
        let flown = Flown::new(21);
        let mut flight = Flight::new(|sample| flown.at(sample), 21);
        let mut monitor = monitor();
        let (mut allowed, mut taken, mut reports) = (0, 0, 0_u32);
        for sample in 0..5 * WINDOW as u32 {
            monitor.take(&flight.next(HEALTHY));
            // What is saved before there is work to do is less than a piece of it.
            if sample < WINDOW as u32 {
                assert_eq!(monitor.work(budget), (0, None));
                continue;
            }
            let (steps, report) = monitor.work(budget);
            (allowed, taken) = (allowed + budget, taken + steps);
            // Nor is anything lost while there is work.
            let is_used = reports > 0 || report.is_some() || allowed < taken + LONGEST_PIECE;
            reports += u32::from(report.is_some());
            assert!(
                steps < 2 * LONGEST_PIECE && taken < allowed + LONGEST_PIECE && is_used,
                "{budget}: {taken} of {allowed}"
            );
        }
        // The first analysis takes between 4000 and 28,000 steps.
        assert_eq!(reports > 0, budget > 1, "{budget}: {reports} reports of {allowed} steps");
    }
}

#[test]
fn windows_are_skipped_where_the_work_cannot_keep_up() {
    let flown = Flown::new(22);
    let mut flight = Flight::new(|sample| flown.at(sample), 22);
    let mut monitor = monitor();
    let mut reports = Vec::new();
    for sample in 0..20 * WINDOW as u32 {
        monitor.take(&flight.next(HEALTHY));
        // A step or two for each sample: a third of what an analysis needs.
        let budget = if sample % 20 == 0 { 2 * LONGEST_PIECE } else { 0 };
        reports.extend(monitor.work(budget).1);
    }
    assert!(monitor.counters().skipped >= 3, "{:?}", monitor.counters());
    assert!(reports.len() >= 2, "{reports:?}");
    for report in &reports {
        assert!(report.latency_samples > WINDOW as u32, "{report:?}");
        let pull = (report.faults[1].value - HEALTHY[1]) / report.faults[1].standard_error;
        assert!(pull.abs() < 5.0, "a window after a skipped one starts anew: {report:?}");
    }
}

/// Most steps that a stepper was asked for in a poll of a budget, less those that it may be; steps count so many times.
fn excess(budget: u32, times: u64) -> i64 {
    let flown = Flown::new(21);
    let mut flight = Flight::new(|sample| flown.at(sample), 21);
    let mut queue = SampleQueue::<64>::new();
    let (mut inlet, mut outlet) = queue.split();
    let steps = Cell::new(0_u64);
    let observed = Observed::new(Steps::new(), &steps);
    let mut monitor = Box::new(Monitor::<_, WINDOW, 2, 20>::idle(observed));
    monitor.configure(&config()).expect("a configuration that is right");
    let (mut excess, mut reports) = (i64::MIN, 0);
    for _ in 0..3 * WINDOW as u32 {
        assert!(inlet.push(flight.next(HEALTHY)));
        let poll = monitor.poll(&mut outlet, budget);
        excess = excess.max((times * steps.take()).cast_signed() - i64::from(budget));
        reports += u32::from(poll.report.is_some());
    }
    assert!(reports >= 2, "{budget}");
    excess
}

#[test]
fn no_poll_takes_more_steps_than_its_budget_as_the_stepper_counts_them() {
    for budget in [2 * LONGEST_PIECE, 57, 100, 333] {
        let excess = excess(budget, 1);
        assert!(excess <= 0, "{excess} steps above {budget}");
    }
    // What would be seen of a poll that takes twice its budget.
    assert!(excess(100, 2) > 0);
}

#[test]
fn a_poll_leaves_little_of_its_budget_while_there_is_work() {
    const BUDGET: u32 = 100;
    let flown = Flown::new(21);
    let mut flight = Flight::new(|sample| flown.at(sample), 21);
    let mut monitor = monitor();
    let (mut taken, mut polls) = (0, 0);
    for _ in 0..4 * WINDOW {
        monitor.take(&flight.next(HEALTHY));
        let (steps, report) = monitor.work(BUDGET);
        if steps > 0 && report.is_none() {
            (taken, polls) = (taken + steps, polls + 1);
        }
    }
    let left = f64::from(BUDGET) - f64::from(taken) / f64::from(polls);
    println!("of {BUDGET} steps a poll leaves {left:.1}");
    // Half of what cannot be parted; it left 21 where that was kept back before every piece.
    assert!(left < 0.5 * f64::from(LONGEST_PIECE), "{left}");
}
