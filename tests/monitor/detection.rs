//! How soon a growing fault is alarmed, and that a healthy actuator is not.

use crate::flight::{ALARMED, Flight, Flown, HEALTHY, WINDOW, config, feed, growing, monitor};
use eha_monitor::command::{COMMANDS, Command};
use eha_monitor::monitor::config::Config;
use eha_monitor::monitor::report::{Report, Verdict};
use eha_monitor::random::Random;
use std::thread;

/// Runs of each kind of growth.
const RUNS: u64 = 200;
/// Healthy windows.
const HEALTHY_WINDOWS: u32 = 10_000;
/// Windows of one healthy flight.
const FLIGHT_WINDOWS: u32 = 50;

/// Does a piece of work for each number, on two threads.
fn on_two_threads<T: Send>(count: u64, work: impl Fn(u64) -> T + Sync) -> Vec<T> {
    thread::scope(|scope| {
        let half = |odd: u64| {
            let work = &work;
            move || (0..count).filter(|number| number % 2 == odd).map(work).collect::<Vec<_>>()
        };
        let second = scope.spawn(half(1));
        let mut all = half(0)();
        all.extend(second.join().expect("a thread that ends"));
        all
    })
}

/// How long an alarm took after the end of a growth.
#[derive(Clone, Copy)]
struct Latency {
    /// Windows of time, the work of the analysis included.
    windows: f64,
    /// Windows that began after the growth and told of the fault, that of the alarm included.
    informative: u32,
}

/// Lets a fault grow over a second, from a random moment on; none where no alarm came within ten windows.
fn latency_of(fault: usize, seed: u64, flown: &Flown) -> Option<Latency> {
    let mut flight = Flight::new(|sample| flown.at(sample), seed);
    let mut monitor = monitor();
    let start = 2 * WINDOW as u32 + Random::new(seed ^ 0x9e37).below(WINDOW) as u32;
    let end = start + WINDOW as u32;
    let mut grown = HEALTHY;
    grown[fault] = ALARMED[fault];
    let mut informative = 0;
    for sample in 0..end + 10 * WINDOW as u32 {
        let faults = growing(sample, start, grown);
        let Some(report) = feed(&mut monitor, &flight.next(faults)) else { continue };
        informative += u32::from(report.first_tick >= end && report.faults[fault].informative);
        if report.faults.iter().any(|fault| fault.alarmed) {
            assert!(sample > start, "{seed}: alarmed before it grew");
            assert!(report.faults[fault].alarmed, "{seed}: the other fault is alarmed: {report:?}");
            let windows = (f64::from(sample) - f64::from(end)) / WINDOW as f64;
            return Some(Latency { windows, informative });
        }
    }
    None
}

const GROWTHS: [&str; 2] = ["backlash 0.1 to 0.2 mm", "friction 400 to 600 N"];

#[test]
fn a_growing_fault_is_alarmed_within_two_windows() {
    for (fault, name) in GROWTHS.into_iter().enumerate() {
        let latencies = on_two_threads(RUNS, |seed| latency_of(fault, seed, &Flown::lively(seed)));
        // Two windows, and the tenth of one that the analysis may take.
        let in_time = latencies.iter().flatten().filter(|latency| latency.windows <= 2.1).count();
        let worst = latencies.iter().flatten().map(|latency| latency.windows).fold(f64::MIN, f64::max);
        println!("{name}: {in_time} of {RUNS} alarmed within two windows, worst {worst:.2}");
        assert!(in_time as u64 * 100 >= 95 * RUNS, "{name}: {in_time} of {RUNS}");
    }
}

/// Where the aircraft flies straight there are windows that tell nothing; what counts is those that do.
#[test]
fn a_growing_fault_is_alarmed_in_two_windows_that_tell_of_it() {
    for (fault, name) in GROWTHS.into_iter().enumerate() {
        let latencies = on_two_threads(RUNS, |seed| latency_of(fault, seed, &Flown::new(seed)));
        let in_time = latencies.iter().flatten().filter(|latency| latency.informative <= 2).count();
        let by_time = latencies.iter().flatten().filter(|latency| latency.windows <= 2.1).count();
        println!(
            "{name}: {in_time} of {RUNS} in two windows that tell of it, {by_time} in two windows of any kind"
        );
        assert!(in_time as u64 * 100 >= 95 * RUNS, "{name}: {in_time} of {RUNS}");
    }
}

/// All reports of a healthy flight.
fn healthy_flight(seed: u64) -> Vec<Report<2>> {
    let flown = Flown::new(seed);
    let mut flight = Flight::new(|sample| flown.at(sample), seed);
    let mut monitor = monitor();
    let samples = FLIGHT_WINDOWS * WINDOW as u32 + 200;
    (0..samples).filter_map(|_| feed(&mut monitor, &flight.next(HEALTHY))).collect()
}

/// Samples between the end of a growth and the alarm of every fault that has grown; none in ten windows.
fn alarmed_after(
    command: impl Fn(u32) -> f32,
    holds_command: bool,
    begin: u32,
    grown: [f32; 2],
) -> Option<u32> {
    let mut flight = Flight::new(command, u64::from(begin));
    flight.holds = holds_command;
    let mut monitor = monitor();
    monitor.configure(&Config { holds_command, ..config() }).unwrap();
    let end = begin + WINDOW as u32;
    let alarm = (0..end + 10 * WINDOW as u32).find(|&sample| {
        let said = feed(&mut monitor, &flight.next(growing(sample, begin, grown)));
        said.is_some_and(|report| {
            (0..2).all(|index| report.faults[index].alarmed == (grown[index] > HEALTHY[index]))
        })
    });
    assert_eq!(monitor.counters().skipped, 0);
    alarm.map(|sample| sample.saturating_sub(end))
}

#[test]
fn a_fault_that_grows_at_any_time_of_any_command_is_alarmed() {
    let mut delays = Vec::new();
    for row in &COMMANDS {
        let command = Command::<f32>::new(row);
        // Flown again and again, so that windows are cut anywhere.
        let again = |sample: u32| command.at((sample % 1150) as f32 * 1e-3);
        for (holds, grown) in [false, true]
            .into_iter()
            .flat_map(|holds| [[2e-4, 400.0], [1e-4, 600.0], [4e-4, 1500.0]].map(|grown| (holds, grown)))
        {
            for begin in (2000..3000).step_by(130) {
                let after = alarmed_after(again, holds, begin, grown);
                let after = after.unwrap_or_else(|| panic!("{} {holds} {begin} {grown:?}", row.name));
                delays.push(after);
            }
        }
    }
    delays.sort_unstable();
    let share = |part: usize| delays[(delays.len() - 1) * part / 100];
    let (half, most, all) = (share(50), share(95), share(100));
    println!("{} alarms, samples behind the growth: half {half}, 95 % {most}, all {all}", delays.len());
    assert!(most < 3 * WINDOW as u32 && all < 5 * WINDOW as u32);
}

/// No alarm in healthy windows; prints how they were called.
fn no_alarm_in(windows: u32) {
    let flights =
        on_two_threads(u64::from(windows.div_ceil(FLIGHT_WINDOWS)), |seed| healthy_flight(1000 + seed));
    let reports: Vec<_> = flights.into_iter().flatten().collect();
    assert!(reports.len() as u32 >= windows, "{} windows", reports.len());
    let count = |verdict: Verdict| reports.iter().filter(|report| report.verdict == verdict).count();
    for verdict in Verdict::ALL {
        println!("{} of {} windows are {}", count(verdict), reports.len(), verdict.name());
    }
    let alarms = reports.iter().filter(|report| report.faults.iter().any(|fault| fault.alarmed)).count();
    assert_eq!(alarms, 0);
    assert_eq!([count(Verdict::Fault), count(Verdict::SensorFault)], [0; 2]);
    assert!(count(Verdict::ModelInadequate) * 1000 <= reports.len());
    assert!(count(Verdict::Healthy) * 100 >= 95 * reports.len());
    // The intervals hold the truth as often as they say: 95 % of independent estimates, give or take four standard
    // deviations of that share.
    for fault in 0..2 {
        let pulls: Vec<f32> = reports
            .iter()
            .filter(|report| report.faults[fault].informative)
            .map(|report| (report.faults[fault].value - HEALTHY[fault]) / report.faults[fault].standard_error)
            .collect();
        let held = pulls.iter().filter(|pull| pull.abs() < 1.96).count() as f64 / pulls.len() as f64;
        let slack = 4.0 * (0.95 * 0.05 / pulls.len() as f64).sqrt() + 0.015;
        println!("fault {fault}: {:.1} % of the intervals hold the truth", held * 100.0);
        assert!((held - 0.95).abs() < slack, "fault {fault}: {held}");
    }
}

#[test]
fn a_healthy_actuator_is_not_alarmed_in_ten_thousand_windows() {
    no_alarm_in(HEALTHY_WINDOWS);
}
