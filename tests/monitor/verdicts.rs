//! What the monitor says of windows that are not plain.

use crate::flight::{ALARMED, Flight, Flown, HEALTHY, WINDOW, config, feed, monitor};
use eha_monitor::command::{Command, CommandInfo};
use eha_monitor::fit::FRICTION_ERROR;
use eha_monitor::link::station::{AnySteps, any_steps};
use eha_monitor::monitor::Monitor;
use eha_monitor::monitor::config::{Config, ConfigError, Fault};
use eha_monitor::monitor::report::{Report, Verdict};
use eha_monitor::monitor::sample::Sample;
use eha_monitor::parameter::{Parameter, Parameters};
use reference_plant::{Command as Flyable, DEFAULT_STEP, Plant, add_noise};

fn reports(command: impl Fn(u32) -> f32, faults: impl Fn(u32) -> [f32; 2], windows: u32) -> Vec<Report<2>> {
    let mut flight = Flight::new(command, 3);
    let mut monitor = monitor();
    (0..windows * WINDOW as u32 + 300)
        .filter_map(|sample| feed(&mut monitor, &flight.next(faults(sample))))
        .collect()
}

fn verdicts(reports: &[Report<2>]) -> Vec<Verdict> {
    reports.iter().map(|report| report.verdict).collect()
}

#[test]
fn windows_that_ask_too_little_are_called_so() {
    let still = reports(|_| 0.01, |_| ALARMED, 4);
    assert_eq!(verdicts(&still), [Verdict::Uninformative; 4]);
    let ramp = reports(|sample| 5e-6 * sample as f32, |_| ALARMED, 4);
    // The ram starts from rest in the first.
    assert_eq!(verdicts(&ramp[1..]), [Verdict::Uninformative; 3]);
    let tremble = reports(|sample| if sample % 100 < 50 { 1e-6 } else { 0.0 }, |_| ALARMED, 3);
    assert_eq!(verdicts(&tremble), [Verdict::Uninformative; 3]);
    for report in still.iter().chain(&ramp[1..]).chain(&tremble) {
        for fault in &report.faults {
            assert!(!fault.informative && !fault.alarmed && fault.evidence == 0.0, "{report:?}");
        }
    }
}

#[test]
fn each_fault_is_named_and_measured() {
    for (faults, faulty) in
        [([2e-4, 400.0], [true, false]), ([1e-4, 700.0], [false, true]), ([4e-4, 900.0], [true; 2])]
    {
        let flown = Flown::new(11);
        for report in &reports(|sample| flown.at(sample), |_| faults, 4)[1..] {
            assert_eq!(report.verdict, Verdict::Fault, "{report:?}");
            for (index, fault) in report.faults.iter().enumerate() {
                assert_eq!(fault.alarmed, faulty[index], "{report:?}");
                assert!((fault.value - faults[index]).abs() < 4.5 * fault.standard_error, "{report:?}");
            }
        }
    }
}

#[test]
fn no_window_tells_the_friction_better_than_the_model_knows_it() {
    // A sine from rest: the ram stops and starts so often that noise alone would leave hundredths of a newton open.
    let sine = |sample: u32| 4e-3 * (0.01 * core::f32::consts::PI * sample as f32).sin();
    for report in reports(sine, |_| HEALTHY, 3) {
        let [backlash, friction] = &report.faults;
        assert!(friction.standard_error >= FRICTION_ERROR as f32, "{report:?}");
        assert!((friction.value - HEALTHY[1]).abs() < 4.5 * friction.standard_error, "{report:?}");
        assert!(backlash.standard_error < 1e-6, "{report:?}");
    }
}

#[test]
fn an_alarm_ends_when_the_fault_is_gone() {
    let flown = Flown::new(12);
    let repaired = 4 * WINDOW as u32;
    let reports =
        reports(|sample| flown.at(sample), |sample| if sample < repaired { ALARMED } else { HEALTHY }, 8);
    assert!(reports[3].faults.iter().all(|fault| fault.alarmed), "{:?}", reports[3]);
    assert!(reports[7].faults.iter().all(|fault| !fault.alarmed), "{:?}", reports[7]);
}

#[test]
fn no_window_is_healthy_while_a_fault_is_alarmed() {
    // A friction at its alarmed value, which is hardly above the healthy one: a window tells little, and many an alarm.
    let alarmed = 414.0;
    let mut monitor = monitor();
    let friction = Fault::new(Parameter::DryFriction, [200.0, 4000.0], HEALTHY[1], alarmed);
    monitor.configure(&Config { faults: [config().faults[0], friction], ..config() }).unwrap();
    let flown = Flown::lively(11);
    let mut flight = Flight::new(|sample| flown.at(sample), 3);
    let reports: Vec<_> = (0..40 * WINDOW + 300)
        .filter_map(|_| feed(&mut monitor, &flight.next([HEALTHY[0], alarmed])))
        .filter(|report| report.faults[1].alarmed)
        .collect();
    assert!(reports.len() > 10, "{reports:?}");
    for report in &reports {
        assert_eq!(report.verdict, Verdict::Fault, "{report:?}");
    }
}

#[test]
fn what_the_model_lacks_is_no_fault() {
    // The monitor is told of a torque motor that has lost 30 % of its gain; this one has not.
    let mut monitor = monitor();
    let parameters = Parameters { torque_motor_gain: 0.007, ..Parameters::default() };
    monitor.configure(&Config { parameters, ..config() }).unwrap();
    let flown = Flown::new(13);
    let mut flight = Flight::new(|sample| flown.at(sample), 13);
    let reports: Vec<_> =
        (0..4 * WINDOW + 900).filter_map(|_| feed(&mut monitor, &flight.next(HEALTHY))).collect();
    assert_eq!(verdicts(&reports), [Verdict::ModelInadequate; 4]);
    for report in &reports {
        assert!(report.faults.iter().all(|fault| fault.evidence == 0.0), "{report:?}");
        assert!(report.residual_rms[0] > 2.0 * report.noise[0], "{report:?}");
        // The search was called in, and warm from the second window on.
        assert!((20..120).contains(&report.evaluations), "{report:?}");
    }
}

#[test]
fn a_model_that_runs_away_explains_nothing() {
    // A supply that sags without bound behind a soft mount, and cogging far beyond what the jack can push.
    let parameters = Parameters {
        mount_compliance: 5.7e-6,
        supply_sag: 5.0,
        metering_blend: 1.0,
        cogging_cosine: 1e5,
        ..Parameters::default()
    };
    let mut monitor = Box::new(Monitor::<AnySteps<4>, 300, 2, 20>::idle(any_steps()));
    monitor.configure(&Config { parameters, ..config() }).unwrap();
    let flown = Flown::lively(3);
    let mut flight = Flight::new(|sample| flown.at(sample), 3);
    let mut reports = Vec::new();
    for _ in 0..1000 {
        monitor.take(&flight.next(HEALTHY));
        reports.extend(monitor.work(4000).1);
    }
    assert!(reports.iter().any(|report| report.residual_rms[0] == f32::INFINITY), "{reports:?}");
    for report in &reports {
        assert_eq!(report.verdict, Verdict::ModelInadequate, "{report:?}");
        assert!(
            report.offset.iter().all(|offset| offset.is_finite()) && report.travel.is_finite(),
            "{report:?}"
        );
    }
}

#[test]
fn every_command_of_the_table_can_be_flown() {
    for row in &eha_monitor::command::COMMANDS {
        let info = CommandInfo::named(row.name).unwrap();
        let command = Command::<f32>::new(info);
        let said = reports(|sample| command.at(sample as f32 * 1e-3), |_| [2e-4, 800.0], 3);
        // A ramp never turns back, and a step comes to rest in the first window. Where hangs on less than a newton: the search
        // may stay beside the truth, and says so.
        let [fault, rest] = [Verdict::Fault, Verdict::Uninformative];
        let expected = match row.name {
            "ramp" => [rest; 3],
            "step" => [Verdict::ModelInadequate, rest, rest],
            _ => [fault; 3],
        };
        assert_eq!(verdicts(&said), expected, "{}: {said:?}", row.name);
        for report in said.iter().filter(|report| report.verdict == fault) {
            assert!(report.faults.iter().all(|fault| fault.informative), "{}: {report:?}", row.name);
            for (fault, truth) in report.faults.iter().zip([2e-4, 800.0]) {
                assert!((fault.value - truth).abs() < 5.0 * fault.standard_error, "{}: {report:?}", row.name);
            }
        }
    }
}

/// What a monitor says of an actuator of the independent plant that flies a command, faults of 0.2 mm and 800 N.
fn reports_of_plant(command: &Flyable, holds_command: bool) -> Vec<Report<2>> {
    let mut plant = Plant::default();
    (plant.parameters.backlash, plant.parameters.jack_friction) = (2e-4, 800.0);
    let mut record = plant.simulate(command, 4 * WINDOW - 50, DEFAULT_STEP);
    add_noise(&mut record.lvdt, f64::from(config().noise.user), 5);
    add_noise(&mut record.current, f64::from(config().noise.current), 6);
    let mut monitor = monitor();
    monitor.configure(&Config { holds_command, ..config() }).unwrap();
    let channels = record.command.iter().zip(&record.lvdt).zip(&record.current).enumerate();
    channels
        .filter_map(|(tick, ((&command, &user), &current))| {
            let [command, user, current] = [command, user, current].map(|value| value as f32);
            feed(&mut monitor, &Sample { tick: tick as u32, command, user, current })
        })
        .collect()
}

#[test]
fn a_command_that_is_held_is_followed_where_the_monitor_is_told() {
    // At the rate of the samples, with jumps of millimetres, and over a bus that brings a command every 20 ms.
    let fast = |command: Flyable| command.held(4 * WINDOW, 1e-3);
    for command in [fast(Flyable::Mixed), fast(Flyable::MixedStep), Flyable::Mixed.held(200, 0.02)] {
        // Jumps of a millimetre cost so many steps that the first search may have to end before it has found both faults.
        let told = reports_of_plant(&command, true);
        let is_fault = |&verdict: &Verdict| verdict == Verdict::Fault;
        assert_eq!(told.len(), 3);
        assert!(told[0].verdict == Verdict::ModelInadequate || told[0].verdict == Verdict::Fault, "{told:?}");
        assert!(verdicts(&told[1..]).iter().all(is_fault), "{told:?}");
        let found = told.iter().filter(|report| report.verdict == Verdict::Fault);
        for (fault, truth) in found.flat_map(|report| report.faults.iter().zip([2e-4, 800.0])) {
            assert!((fault.value - truth).abs() < 4.5 * fault.standard_error, "{told:?}");
        }
        // What lines would make of it.
        let lines = verdicts(&reports_of_plant(&command, false));
        assert_eq!(lines.first(), Some(&Verdict::ModelInadequate));
        assert!(!lines.iter().any(is_fault), "{lines:?}");
    }
}

#[test]
fn a_configuration_that_cannot_work_is_refused() {
    let mut monitor = monitor();
    let good = config();
    let mut bad = good;
    bad.sample_period = f32::NAN;
    assert_eq!(monitor.configure(&bad), Err(ConfigError::SamplePeriod));
    bad = good;
    bad.noise.user = 0.0;
    assert_eq!(monitor.configure(&bad), Err(ConfigError::Noise));
    bad = good;
    bad.false_alarm_rate = 1.0;
    assert_eq!(monitor.configure(&bad), Err(ConfigError::FalseAlarmRate));
    bad = good;
    bad.faults[0].alarm = bad.faults[0].healthy;
    assert_eq!(monitor.configure(&bad), Err(ConfigError::Range(Parameter::Backlash)));
    bad = good;
    bad.faults[1].free.parameter = Parameter::LoadMass;
    assert!(monitor.configure(&bad).is_err());
    bad = good;
    bad.faults[1] = bad.faults[0];
    assert_eq!(monitor.configure(&bad), Err(ConfigError::Twice(Parameter::Backlash)));
    bad = good;
    bad.parameters.load_mass = f32::NAN;
    assert_eq!(monitor.configure(&bad), Err(ConfigError::Parameter(Parameter::LoadMass)));
    bad = good;
    bad.parameters.sensor_delay = 0.05;
    assert_eq!(monitor.configure(&bad), Err(ConfigError::Parameter(Parameter::SensorDelay)));
    bad = good;
    bad.parameters.step_load = 100.0;
    assert_eq!(monitor.configure(&bad), Err(ConfigError::Input));
    assert_eq!(monitor.config(), Some(&good));
}
