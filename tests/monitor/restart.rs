//! The state survives a restart.

use crate::flight::{ALARMED, Flight, Flown, HEALTHY, TestMonitor, WINDOW, config, feed, monitor, timeless};
use eha_monitor::monitor::SnapshotError;
use eha_monitor::monitor::config::Config;
use eha_monitor::monitor::report::{Report, Verdict};
use eha_monitor::monitor::sample::Sample;
use eha_monitor::parameter::Parameters;
use eha_monitor::random::Random;

fn snapshot(monitor: &mut TestMonitor) -> Vec<u8> {
    let mut bytes = vec![0; TestMonitor::SNAPSHOT_BYTES];
    let length = monitor.snapshot(&mut bytes).expect("room for it");
    bytes.truncate(length);
    bytes
}

/// Reports of a flight with trouble, restarted at some samples; without what depends on the time that they took.
fn reports(restarts: &[u32]) -> Vec<Report<2>> {
    let flown = Flown::new(31);
    let mut flight = Flight::new(|sample| flown.at(sample), 31);
    let mut noise = Random::new(5);
    let mut monitor = monitor();
    let mut reports = Vec::new();
    for number in 0..6 * WINDOW as u32 {
        if restarts.contains(&number) {
            let bytes = snapshot(&mut monitor);
            monitor = self::monitor();
            monitor.restore(&bytes).expect("its own snapshot");
            assert!(snapshot(&mut monitor) == bytes, "a snapshot of what was restored is the same");
        }
        let faults = [HEALTHY[0] + 1e-8 * number as f32, HEALTHY[1]];
        let mut sample = flight.next(faults);
        match noise.below(50) {
            0 => sample.user = f32::NAN,
            1 => sample.user += 1e-3,
            2 => continue,
            _ => {}
        }
        reports.extend(feed(&mut monitor, &sample).map(timeless));
    }
    reports
}

#[test]
fn a_restored_monitor_goes_on_with_the_same_bits() {
    let whole = reports(&[]);
    assert_eq!(whole.len(), 5);
    assert_eq!(reports(&[1, 999, 1003, 1010, 2500, 4025]), whole);
}

#[test]
fn a_search_that_is_begun_anew_after_a_restart_ends_in_time() {
    // Nothing explains it, so that every search takes all that it may.
    let parameters = Parameters { torque_motor_gain: 7e-3, ..Parameters::default() };
    let config = Config { parameters, ..config() };
    let configured = || {
        let mut monitor = monitor();
        monitor.configure(&config).expect("a configuration that is right");
        monitor
    };
    for restart in [2030, 2200, 2400, 2600, 2800] {
        let flown = Flown::lively(31);
        let mut flight = Flight::new(|sample| flown.at(sample), 31);
        let mut monitor = configured();
        let mut windows = Vec::new();
        for number in 0..5 * WINDOW as u32 {
            if number == restart {
                let bytes = snapshot(&mut monitor);
                monitor = configured();
                monitor.restore(&bytes).expect("its own snapshot");
            }
            windows.extend(feed(&mut monitor, &flight.next(HEALTHY)).map(|report| report.window));
        }
        assert_eq!((windows, monitor.counters().skipped), (vec![0, 1, 2, 3], 0), "{restart}");
    }
}

/// A monitor that has seen the first samples of a flight with some faults.
fn after(samples: u32, flown: &Flown, seed: u64, faults: [f32; 2]) -> Box<TestMonitor> {
    let mut flight = Flight::new(|sample| flown.at(sample), seed);
    let mut monitor = monitor();
    for _ in 0..samples {
        feed(&mut monitor, &flight.next(faults));
    }
    monitor
}

#[test]
fn a_window_is_not_joined_to_what_comes_after_an_outage() {
    let bytes = snapshot(&mut after(2500, &Flown::lively(34), 34, ALARMED));
    // An hour later, at another place; the ticks go on after those of the snapshot, or nearly so.
    for missed in [1, 5, 20] {
        let mut monitor = monitor();
        monitor.restore(&bytes).expect("its own snapshot");
        let later = Flown::lively(35);
        let mut flight = Flight::new(|sample| 0.05 + later.at(sample), 35);
        let mut reports = Vec::new();
        for _ in 0..2300 {
            let sample = flight.next(ALARMED);
            let tick = sample.tick + 2500 + missed;
            // The first of them has a bad command: it came, but what is missing is missing still.
            let command = if sample.tick == 0 { f32::NAN } else { sample.command };
            reports.extend(feed(&mut monitor, &Sample { tick, command, ..sample }));
        }
        let verdicts: Vec<_> = reports.iter().map(|report| report.verdict).collect();
        assert_eq!(verdicts, [Verdict::SensorFault, Verdict::Fault, Verdict::Fault], "{missed}: {reports:?}");
        assert_eq!([reports[0].first_tick, reports[1].first_tick], [2000, 2501 + missed], "{missed}");
        assert!(
            reports[0].faults.iter().all(|fault| fault.evidence > 0.4),
            "what was known stays: {reports:?}"
        );
        assert!(reports[1].faults.iter().all(|fault| fault.alarmed), "{missed}: {reports:?}");
    }
}

#[test]
fn a_damaged_snapshot_is_refused_and_changes_nothing() {
    let mut monitor = after(1500, &Flown::new(32), 32, HEALTHY);
    let good = snapshot(&mut monitor);
    let mut other = self::monitor();
    let untouched = snapshot(&mut other);
    let mut refuse = |bytes: &[u8], error: SnapshotError| {
        assert_eq!(other.restore(bytes), Err(error));
        assert!(snapshot(&mut other) == untouched);
    };
    let mut random = Random::new(7);
    for _ in 0..300 {
        let mut bytes = good.clone();
        let place = 12 + random.below(bytes.len() - 12);
        bytes[place] ^= 1 << random.below(8);
        refuse(&bytes, SnapshotError::Checksum);
    }
    refuse(&[], SnapshotError::Length);
    refuse(&[0; 64], SnapshotError::Mark);
    refuse(&good[..good.len() - 4], SnapshotError::Checksum);
    let mut version = good.clone();
    version[4] += 1;
    refuse(&version, SnapshotError::Version);
    assert_eq!(monitor.snapshot(&mut [0; 100]), Err(SnapshotError::Length));

    let mut stranger = self::monitor();
    stranger.configure(&Config { seed: 2, ..config() }).unwrap();
    assert_eq!(stranger.restore(&good), Err(SnapshotError::Config));
    let mut idle = TestMonitor::idle(crate::flight::Steps::new());
    assert_eq!(idle.restore(&good), Err(SnapshotError::NotConfigured));
}
