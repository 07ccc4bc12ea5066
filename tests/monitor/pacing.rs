//! The work of the background: never more than it is allowed, and the same result however it is cut.

use crate::flight::{Flight, Flown, HEALTHY, Steps, TestMonitor, WINDOW, config, monitor};
use eha_monitor::integrate::LONGEST_PIECE;
use eha_monitor::integrate::observed::Observed;
use eha_monitor::monitor::Monitor;
use eha_monitor::monitor::queue::SampleQueue;
use eha_monitor::monitor::report::Report;
use std::cell::Cell;

/// Reports of a flight with some polls of a budget every so many samples, without what depends on the time that they took.
fn reports(budget: u32, polls: u32, every: u32) -> Vec<Report<2>> {
    let flown = Flown::new(21);
    let mut flight = Flight::new(|sample| flown.at(sample), 21);
    let mut queue = SampleQueue::<64>::new();
    let (mut inlet, mut outlet) = queue.split();
    let mut monitor: Box<TestMonitor> = monitor();
    let mut reports = Vec::new();
    for sample in 0..5 * WINDOW as u32 {
        assert!(inlet.push(flight.next(HEALTHY)));
        if sample % every == every - 1 {
            for number in 0..polls {
                let poll = monitor.poll(&mut outlet, budget);
                assert_eq!(poll.samples, if number == 0 { every } else { 0 });
                reports.extend(poll.report.map(|report| Report { latency_samples: 0, ..report }));
            }
        }
    }
    reports
}

#[test]
fn the_result_does_not_depend_on_how_the_work_is_cut() {
    let whole = reports(u32::MAX, 1, 1);
    assert_eq!(whole.len(), 4);
    for (budget, polls, every) in [
        (20, 12, 1),
        (LONGEST_PIECE, 12, 1),
        (LONGEST_PIECE + 1, 8, 1),
        (57, 1, 2),
        (1000, 1, 50),
        (100_000, 1, 7),
    ] {
        assert_eq!(
            reports(budget, polls, every)[..3],
            whole[..3],
            "{polls} times {budget} steps, {every} samples"
        );
    }
    assert_eq!(reports(0, 100, 1), []);
}

#[test]
fn a_small_budget_is_saved_up_and_never_exceeded_in_sum() {
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
            reports += u32::from(report.is_some());
            assert!(
                steps <= LONGEST_PIECE && taken < allowed + LONGEST_PIECE,
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
