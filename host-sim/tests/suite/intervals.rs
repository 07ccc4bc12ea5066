//! What the intervals of the faults hold besides what the curvature at the fit makes of noise: the steps of a program, valleys
//! with many bottoms, the steps of a sensor, and how well the rig is known.

use eha_monitor::channel::Channel;
use eha_monitor::fit::identify::StopReason;
use eha_monitor::parameter::Parameter;
use host_sim::fit::{self, Fit, FitSettings, Polished, Prepared};
use host_sim::record::Record;
use host_sim::rig::{Calibration, Range, Rig};
use reference_plant::{Command, Gauss, Plant, Rule, SAMPLE_PERIOD};
use std::f64::consts::TAU;

const NOISE: f64 = 1.5e-6;
const TRUTH: [f64; 2] = [4e-4, 250.0];
/// Where the fits start: not at the truth, which would be found by staying there.
const START: [f64; 2] = [3.9e-4, 260.0];
const FDJ: usize = 1;

/// The position of an actuator over a long chirp, whose fast end tells its friction to a tenth of a newton: without
/// noise, so that nothing but the steps is off, but said to have some.
fn flown(rig: &Rig, rule: Rule) -> Prepared {
    let mut plant = Plant { rule, ..Plant::default() };
    [plant.parameters.backlash, plant.parameters.jack_friction] = TRUTH;
    let data = plant.record(&Command::Chirp { amplitude: 4.3e-3 }, 4300);
    let channels = vec![(Channel::Command, data.command), (Channel::UserPosition, data.lvdt)];
    let record = Record::new("flown", SAMPLE_PERIOD, 0.0, channels).unwrap();
    fit::prepare_with(rig, &record, [NOISE; Channel::MEASURED.len()])
}

#[test]
fn intervals_hold_what_the_steps_of_the_source_look_like() {
    let rig = Rig::load("eha").unwrap();
    let ranges = rig.declared();
    let [(own_error, own_noise, _), (error, by_noise, by_all)] = [Rule::Midpoint, Rule::SemiImplicitEuler]
        .map(|rule| {
            let records = [flown(&rig, rule)];
            let fit = fit::polish(&rig, &ranges, &START, &records).unwrap();
            let error = (fit.values[FDJ] - TRUTH[FDJ]).abs();
            let by_noise = fit.standard_error(FDJ);
            let by_all = fit::standard_errors(&rig, &ranges, &fit, &records)[FDJ];
            println!("{rule:?}: off by {error:.3} N, {by_noise:.3} N by noise, {by_all:.3} N by all");
            (error, by_noise, by_all)
        });
    assert!(error < 1.96 * by_all, "{error} N");
    // What noise alone would have said, and steps that are no error.
    assert!(error > 1.96 * by_noise, "{error} N");
    assert!(own_error < 0.5 * own_noise, "{own_error} N");
}

/// Records of a ram that stops and starts slowly: chi-square has many small bottoms along a valley that is far wider than
/// any of them.
const ACTUATORS: u32 = 20;
const SLOW_NOISE: f64 = 7e-6;
/// Of the intervals that say that they hold the truth in 95 of 100 cases, what must and what may hold it.
const MOST_HELD_BY_CURVATURE: f64 = 0.6;
const LEAST_HELD: f64 = 0.85;

/// Backlash, m, and friction, N, of one of them, and its noisy position over a slow ramp and a cosine.
fn slow(rig: &Rig, actuator: u32) -> ([f64; 2], Prepared) {
    let mut plant = Plant::default();
    let truth = [2.1e-4 + 2e-6 * f64::from(actuator), 990.0 + 14.0 * f64::from(actuator)];
    [plant.parameters.backlash, plant.parameters.jack_friction] = truth;
    plant.parameters.spool_sticks_below_breakaway = true;
    let command = |sample: u16| match f64::from(sample) * SAMPLE_PERIOD {
        time if time < 1.1 => 9e-3 * time / 1.1,
        time => 5e-3 + 4e-3 * (TAU * (time - 1.1) / 0.4).cos(),
    };
    let data = plant.record(&Command::Sampled((0..3800).map(command).collect(), SAMPLE_PERIOD), 3800);
    let mut noise = Gauss::new(u64::from(actuator));
    let position = data.lvdt.iter().map(|position| position + SLOW_NOISE * noise.draw()).collect();
    let channels = vec![(Channel::Command, data.command), (Channel::UserPosition, position)];
    let record = Record::new("slow", SAMPLE_PERIOD, 0.0, channels).unwrap();
    (truth, fit::prepare_with(rig, &record, [SLOW_NOISE; Channel::MEASURED.len()]))
}

#[test]
fn intervals_hold_what_a_valley_with_many_bottoms_leaves_open() {
    let rig = Rig::load("eha").unwrap().with_sticking_spool().unwrap();
    let ranges = rig.declared();
    let (mut by_curvature, mut held, mut of_all) = (0, 0, 0);
    for actuator in 0..ACTUATORS {
        let (truth, record) = slow(&rig, actuator);
        let records = [record];
        let settings = FitSettings::default();
        let first = fit::fit(&rig, &ranges, &records, &settings, |_| {});
        let settled = fit::fit_from_seeds(&rig, &ranges, &records, &settings, 1, |_| {});
        assert_eq!(first.stop, StopReason::NoiseReached, "actuator {actuator}");
        assert!(settled.misfit.chi_square <= first.misfit.chi_square, "actuator {actuator}");
        for (fault, truth) in truth.iter().enumerate() {
            let holds = |fit: &Fit| {
                let [low, high] = fit.estimates[fault].ci95;
                u32::from((low..=high).contains(truth))
            };
            by_curvature += holds(&first);
            held += holds(&settled);
            of_all += 1;
        }
    }
    println!("the truth is in {held} of {of_all} intervals, in {by_curvature} by the curvature alone");
    let share = |count: u32| f64::from(count) / f64::from(of_all);
    assert!(share(held) > LEAST_HELD, "{held} of {of_all}");
    assert!(share(by_curvature) < MOST_HELD_BY_CURVATURE, "{by_curvature} of {of_all}");
}

/// A sensor that is read in steps, and its noise, which does not hide them.
const STEP: f64 = 2e-5;
const NOISE_OF_STEPS: f64 = 5e-7;
/// Errors of the most likely values, as a part of those of least squares.
const LIKELIER: f64 = 0.5;

/// Backlash, m, and friction, N, of an actuator, and its position over a sine, read in steps: at each of its turns, in the
/// same place of a step.
fn stepped(rig: &Rig, actuator: u32) -> ([f64; 2], Prepared) {
    let mut plant = Plant::default();
    let truth = [3.0e-4 + 7e-6 * f64::from(actuator), 600.0 + 23.0 * f64::from(actuator)];
    [plant.parameters.backlash, plant.parameters.jack_friction] = truth;
    let command = |sample: u16| 2.1e-3 * (TAU * f64::from(sample) * SAMPLE_PERIOD / 0.5).sin();
    let data = plant.record(&Command::Sampled((0..2100).map(command).collect(), SAMPLE_PERIOD), 2100);
    let mut noise = Gauss::new(u64::from(actuator));
    let read = |position: &f64| ((position + NOISE_OF_STEPS * noise.draw()) / STEP).round() * STEP;
    let position = data.lvdt.iter().map(read).collect();
    let channels = vec![(Channel::Command, data.command), (Channel::UserPosition, position)];
    (truth, fit::prepare(rig, &Record::new("stepped", SAMPLE_PERIOD, 0.0, channels).unwrap()))
}

#[test]
fn most_likely_values_know_that_a_sensor_is_read_in_steps() {
    let rig = Rig::load("eha").unwrap();
    let ranges = rig.declared();
    let (mut held, mut held_by_squares, mut of_all) = (0, 0, 0);
    let (mut errors, mut errors_of_squares) = (0.0_f64, 0.0_f64);
    for actuator in 0..ACTUATORS {
        let (truth, record) = stepped(&rig, actuator);
        let records = [record];
        let least = fit::polish(&rig, &ranges, &truth, &records).unwrap();
        let likeliest = fit::most_likely(&rig, &ranges, &least, &records).unwrap();
        for (fault, truth) in truth.iter().enumerate() {
            let off = |fit: &Polished| (fit.values[fault] - truth).abs();
            let holds = |fit: &Polished| {
                let error = fit::standard_errors(&rig, &ranges, fit, &records)[fault];
                u32::from(off(fit) < fit::OF_95 * error)
            };
            held += holds(&likeliest);
            held_by_squares += holds(&least);
            of_all += 1;
        }
        errors += (likeliest.values[FDJ] - truth[FDJ]).powi(2);
        errors_of_squares += (least.values[FDJ] - truth[FDJ]).powi(2);
    }
    let [error, of_squares] = [errors, errors_of_squares].map(|sum| (sum / f64::from(ACTUATORS)).sqrt());
    println!("the truth is in {held} of {of_all} intervals, in {held_by_squares} by least squares");
    println!("friction is off by {error:.0} N rms, by {of_squares:.0} N by least squares");
    let share = |count: u32| f64::from(count) / f64::from(of_all);
    assert!(share(held) > LEAST_HELD, "{held} of {of_all}");
    assert!(share(held_by_squares) < LEAST_HELD, "{held_by_squares} of {of_all}");
    assert!(error < LIKELIER * of_squares, "{error} N, {of_squares} N");
}

/// Noise of position and current, and the supply of a machine whose supply is not known, as a part of the rated one.
const USUAL_NOISE: [f64; 4] = [5e-6, f64::INFINITY, 0.02, f64::INFINITY];
const SUPPLY: f64 = 0.9;
/// Commands of the record that the supply is calibrated on, and of the one with the faults: amplitude, m.
const HEALTHY: Command = Command::Chirp { amplitude: 2e-3 };
const SUSPECT: Command = Command::Chirp { amplitude: 8e-3 };

/// A second of position and current of a machine with faults, backlash, m, and friction, N.
fn supplied(rig: &Rig, command: &Command, faults: [f64; 2], seed: u64) -> Prepared {
    let mut plant = Plant::default();
    plant.parameters.supply_pressure *= SUPPLY;
    [plant.parameters.backlash, plant.parameters.jack_friction] = faults;
    let data = plant.record(command, 1001);
    let mut noise = Gauss::new(seed);
    let mut noisy = |values: Vec<f64>, sigma: f64| -> Vec<f64> {
        values.into_iter().map(|value| value + sigma * noise.draw()).collect()
    };
    let (position, current) = (noisy(data.lvdt, USUAL_NOISE[0]), noisy(data.current, USUAL_NOISE[2]));
    let channels = vec![
        (Channel::Command, data.command),
        (Channel::UserPosition, position),
        (Channel::Current, current),
    ];
    fit::prepare_with(rig, &Record::new("supplied", SAMPLE_PERIOD, 0.0, channels).unwrap(), USUAL_NOISE)
}

#[test]
fn intervals_hold_what_the_calibration_of_the_rig_leaves_open() {
    let rig = Rig::load("eha").unwrap();
    let supply = [Range::new(Parameter::SupplyRatio, 0.5, 1.5).unwrap()];
    let healthy = [rig.parameters.bkl, rig.parameters.fdj];
    let (mut held, mut held_if_exact, mut of_all) = (0, 0, 0);
    for actuator in 0..ACTUATORS {
        let seed = u64::from(2 * actuator);
        let settings = FitSettings::default();
        let fit = |rig: &Rig, ranges: &[Range], record: Prepared| {
            fit::fit_as_read(rig, ranges, &[record], &settings, |_| {}, |_| {}).fit
        };
        let calibrated = fit(&rig, &supply, supplied(&rig, &HEALTHY, healthy, seed)).calibrated(&rig);
        let exact = Rig { calibration: Calibration::default(), ..calibrated.clone() };
        let truth = [2e-4, 700.0 + 20.0 * f64::from(actuator)];
        let record = supplied(&rig, &SUSPECT, truth, seed + 1);
        let holds = |rig: &Rig| {
            let fit = fit(rig, &rig.faults, record.clone());
            let held = fit.estimates.iter().zip(truth);
            held.filter(|(estimate, truth)| (estimate.ci95[0]..=estimate.ci95[1]).contains(truth)).count()
        };
        held += holds(&calibrated);
        held_if_exact += holds(&exact);
        of_all += truth.len();
    }
    println!(
        "the truth is in {held} of {of_all} intervals, in {held_if_exact} if the supply were known exactly"
    );
    let share = |count: usize| count as f64 / of_all as f64;
    assert!(share(held) > LEAST_HELD, "{held} of {of_all}");
    assert!(share(held_if_exact) < LEAST_HELD, "{held_if_exact} of {of_all}");
}
