//! Where a window begins: what the monitor makes of an actuator that was in motion before.

use crate::flight::{Flight, Flown, HEALTHY, WINDOW, feed, growing, monitor};
use eha_monitor::command::{Command, CommandInfo};
use eha_monitor::monitor::report::{Report, Verdict};
use std::ops::Range;

/// A sine at which the valve is at its limit all the time: there the loop hardly forgets where it was.
fn saturating() -> impl Fn(u32) -> f32 {
    let sine = Command::<f32>::new(CommandInfo::named("sine").unwrap());
    move |sample| sine.at(sample as f32 * 1e-3)
}

/// What a monitor says of four windows of a flight that it joins at a sample.
fn joined(command: impl Fn(u32) -> f32, seed: u64, at: u32, faults: [f32; 2]) -> Vec<Report<2>> {
    joined_blind(command, seed, at, faults, 0..0)
}

/// The same where some of the samples from there on have no position.
fn joined_blind(
    command: impl Fn(u32) -> f32,
    seed: u64,
    at: u32,
    faults: [f32; 2],
    blind: Range<u32>,
) -> Vec<Report<2>> {
    let mut flight = Flight::new(command, seed);
    let mut monitor = monitor();
    let mut said = Vec::new();
    for sample in 0..at + 4 * WINDOW as u32 + 900 {
        let mut seen = flight.next(faults);
        if sample >= at {
            if blind.contains(&(sample - at)) {
                seen.user = f32::NAN;
            }
            said.extend(feed(&mut monitor, &seen));
        }
    }
    assert_eq!((said.len(), monitor.counters().skipped), (4, 0));
    said
}

fn is_right(report: &Report<2>, verdict: Verdict, faults: [f32; 2]) -> bool {
    let close = |(index, truth): (usize, f32)| {
        let fault = &report.faults[index];
        (fault.value - truth).abs() < 4.5 * fault.standard_error
    };
    report.verdict == verdict && faults.into_iter().enumerate().all(close)
}

#[test]
fn a_flight_that_is_joined_is_told_of_from_its_first_window_on() {
    for seed in 0..20 {
        let flown = Flown::lively(seed);
        let said = joined(|sample| flown.at(sample), seed, 1000 + 37 * seed as u32, HEALTHY);
        assert!(said.iter().all(|report| is_right(report, Verdict::Healthy, HEALTHY)), "{seed}: {said:?}");
    }
}

#[test]
fn the_speed_at_the_start_of_a_window_is_that_between_the_samples_that_there_are() {
    // A period of 0.2 s.
    let places = (1000..1200).step_by(10);
    let at_once = |blind: &Range<u32>| {
        let said = |at| joined_blind(saturating(), 1, at, HEALTHY, blind.clone());
        places.clone().filter(|&at| is_right(&said(at)[0], Verdict::Healthy, HEALTHY)).count()
    };
    let whole = at_once(&(0..0));
    for blind in [0..20, 1..20, 5..20, 3..8] {
        let right = at_once(&blind);
        println!(
            "right in the first window: {right} of {}, blind in {blind:?}; {whole} without",
            places.len()
        );
        // What is extrapolated over 20 ms of such a sine is up to a millimetre off; taken for the movement of a shorter or a
        // longer time, it is right in none or two of them.
        assert!(2 * right >= whole, "{blind:?}: {right}, {whole}");
    }
}

#[test]
fn nothing_is_compared_before_a_saturated_actuator_has_forgotten_its_start() {
    let mut late = 0;
    for (faults, verdict) in [(HEALTHY, Verdict::Healthy), ([2e-4, 800.0], Verdict::Fault)] {
        // A period of 0.2 s.
        for at in (1000..1200).step_by(10) {
            let said = joined(saturating(), 1, at, faults);
            let (first, rest) = said.split_at(2);
            // What is carried on from a window that says nothing is the motion of a healthy actuator.
            let may_be = [verdict, Verdict::Uninformative, Verdict::ModelInadequate];
            assert!(first.iter().all(|report| may_be.contains(&report.verdict)), "{at}: {said:?}");
            late += u32::from(!rest.iter().all(|report| is_right(report, verdict, faults)));
        }
    }
    println!("{late} of 40 are not right from the third window on");
    // Such a sine has two motions. At one place of the period what is measured of the start may lead to the wrong one.
    assert!(late <= 2, "{late} of 40");
}

#[test]
fn a_fault_that_grows_in_a_saturated_actuator_is_alarmed() {
    for (index, value) in [(0, 2e-4), (1, 800.0)] {
        let mut flight = Flight::new(saturating(), 1);
        let mut monitor = monitor();
        let mut grown = HEALTHY;
        grown[index] = value;
        let mut said = Vec::new();
        for sample in 0..6 * WINDOW as u32 {
            said.extend(feed(&mut monitor, &flight.next(growing(sample, 1300, grown))));
        }
        assert_eq!((said.len(), monitor.counters().skipped), (5, 0));
        assert_eq!(said[4].faults.map(|fault| fault.alarmed), [index == 0, index == 1], "{said:?}");
    }
}
