//! What a monitor can be told of its actuator, and what it refuses.

use crate::flight::{Flight, Flown, HEALTHY, TestMonitor, WINDOW, config, feed, monitor};
use eha_monitor::link::station::{AnySteps, any_steps};
use eha_monitor::model::{Form, Model};
use eha_monitor::monitor::Monitor;
use eha_monitor::monitor::config::{Config, ConfigError, Fault};
use eha_monitor::monitor::report::Verdict;
use eha_monitor::parameter::{Parameter, Parameters, Reach};

/// The monitor for every rig.
type AnyMonitor = Monitor<AnySteps<1>, 1000, 2, 20>;

/// A configuration that watches a parameter beside the friction, over a range of it.
fn watching(parameter: Parameter, range: [f32; 2]) -> Config<2> {
    let mut config = config();
    let [lower, upper] = range;
    let (healthy, alarm) = (0.4 * lower + 0.6 * upper, 0.2 * lower + 0.8 * upper);
    config.faults[0] = Fault::new(parameter, range, healthy, alarm);
    config
}

#[test]
fn a_fault_that_the_steps_do_not_take_is_refused_wherever_its_effect_is_absent() {
    let mut plain = monitor();
    let mut any = Box::new(AnyMonitor::idle(any_steps()));
    let form = Form::default();
    let is_plain = |parameters: &Parameters<f32>| {
        let model = Model::new(form, parameters);
        model.is_affine() && model.order() == 5
    };
    let mut found = 0;
    for parameter in Parameter::all().filter(|&known| Model::<f32>::reach(form, known) != Reach::Dynamics) {
        let [lower, upper] = parameter.range::<f32>();
        let mut present = Parameters::default();
        present.set(parameter, 0.5 * upper);
        if is_plain(&present) {
            continue;
        }
        found += 1;
        let both_ways = [0.5 * lower, 0.5 * upper];
        for range in [both_ways, [0.0, 0.5 * upper], [lower, 0.0]] {
            if range[0] >= range[1] || !(range[0] >= lower && range[1] <= upper) {
                continue;
            }
            let config = watching(parameter, range);
            assert_eq!(plain.configure(&config), Err(ConfigError::Model), "{parameter:?} {range:?}");
            assert_eq!(any.configure(&config), Ok(()), "{parameter:?} {range:?}");
        }
    }
    // Hysteresis, play of the feedback, metering, Stribeck friction, thinning, cogging (both parts), drag.
    assert_eq!(found, 8);
    assert_eq!(plain.configure(&config()), Ok(()));
    // A range that does not reach the absence of its effect needs other steps all along.
    let stribeck = watching(Parameter::StribeckVelocity, [1e-3, 0.1]);
    assert_eq!(TestMonitor::idle(crate::flight::Steps::new()).configure(&stribeck), Err(ConfigError::Model));
}

#[test]
fn a_parameter_just_outside_its_range_is_refused_and_at_its_bounds_it_is_not() {
    for parameter in Parameter::all() {
        let refused = |value: f32| {
            let mut config = config();
            config.parameters.set(parameter, value);
            config.check()
        };
        let [lower, upper] = parameter.range::<f32>();
        for (bound, outwards) in [(lower, -1.0), (upper, 1.0)] {
            let expected = match parameter {
                // No step load at all.
                Parameter::StepLoad => ConfigError::Input,
                _ => ConfigError::Parameter(parameter),
            };
            for part in [1e-5, 1e-3, 1.0] {
                let beyond =
                    if bound == 0.0 { outwards * 1e-9 * part } else { outwards * bound.abs() * part };
                assert_eq!(refused(bound + beyond), Err(expected), "{parameter:?} {}", bound + beyond);
            }
            // A double-precision bound in single precision, and one that was calculated.
            let is_out = matches!(parameter, Parameter::StepLoad)
                || (parameter == Parameter::SensorDelay && outwards > 0.0);
            if !is_out {
                for value in [bound, bound * (1.0 + 2.0 * f32::EPSILON), bound * (1.0 - 2.0 * f32::EPSILON)] {
                    assert_ne!(refused(value), Err(expected), "{parameter:?} {value}");
                }
            }
        }
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(refused(value).is_err(), "{parameter:?} {value}");
        }
    }
}

#[test]
fn the_range_of_a_fault_is_one_in_which_its_parameter_makes_sense() {
    let refused = |parameter, range: [f32; 2]| watching(parameter, range).check().err();
    for parameter in
        Parameter::all().filter(|&known| Model::<f32>::reach(Form::default(), known) != Reach::Dynamics)
    {
        if matches!(parameter, Parameter::StepLoad | Parameter::StepLoadTime) {
            assert_eq!(refused(parameter, [0.0, 100.0]), Some(ConfigError::Input));
            continue;
        }
        if parameter == Parameter::DryFriction {
            // It is watched already.
            continue;
        }
        let [lower, upper] = parameter.range::<f32>();
        let range = Some(ConfigError::Range(parameter));
        for beyond in [f32::INFINITY, f32::NAN, upper + (upper.abs() * 1e-4).max(1e-9)] {
            assert_eq!(refused(parameter, [lower, beyond]), range, "{parameter:?} {beyond}");
        }
        for beyond in [f32::NEG_INFINITY, f32::NAN, lower - (lower.abs() * 1e-4).max(1e-9)] {
            assert_eq!(refused(parameter, [beyond, upper]), range, "{parameter:?} {beyond}");
        }
        if matches!(parameter, Parameter::SensorOffset | Parameter::CurrentOffset) {
            assert_eq!(refused(parameter, [lower, upper]), Some(ConfigError::Offset(parameter)));
        } else if parameter == Parameter::SensorLag {
            assert_eq!(refused(parameter, [lower, upper]), Some(ConfigError::SensorMemory));
        } else if parameter != Parameter::SensorDelay {
            assert_eq!(refused(parameter, [lower, upper]), None, "{parameter:?}");
        }
    }
    // At 1 kHz the delay line holds 31 ms.
    assert_eq!(refused(Parameter::SensorDelay, [0.0, 0.031]), None);
    assert_eq!(
        refused(Parameter::SensorDelay, [0.0, 0.0315]),
        Some(ConfigError::Range(Parameter::SensorDelay))
    );
}

/// A lag that settles within the start of a window changes nothing; a longer one is refused, or every window would be called
/// inadequate.
#[test]
fn a_sensor_lags_no_longer_than_a_window_settles() {
    let lagging = |lag, delay| {
        let mut config = config();
        (config.parameters.sensor_lag, config.parameters.sensor_delay) = (lag, delay);
        config
    };
    for (lag, delay) in [(0.01, 0.0), (6.9e-3, 0.031)] {
        let config = lagging(lag, delay);
        let mut monitor = monitor();
        assert_eq!(monitor.configure(&config), Ok(()));
        let flown = Flown::lively(3);
        let mut flight = Flight::of(&config.parameters, |sample| flown.at(sample), 4);
        let mut reports = 0;
        for _ in 0..6 * WINDOW + 300 {
            if let Some(report) = feed(&mut monitor, &flight.next(HEALTHY)) {
                assert_eq!(report.verdict, Verdict::Healthy, "{lag} {delay}: {report:?}");
                reports += 1;
            }
        }
        assert_eq!(reports, 6);
    }
    for (lag, delay) in [(0.0102, 0.0), (0.02, 0.0), (0.0072, 0.031)] {
        assert_eq!(lagging(lag, delay).check(), Err(ConfigError::SensorMemory), "{lag} {delay}");
    }
    // A window of 200 samples settles over 50 of them.
    let mut short = Box::new(Monitor::<crate::flight::Steps, 200, 2, 20>::idle(crate::flight::Steps::new()));
    assert_eq!(short.configure(&lagging(0.005, 0.0)), Ok(()));
    assert_eq!(short.configure(&lagging(0.006, 0.0)), Err(ConfigError::SensorMemory));
}
