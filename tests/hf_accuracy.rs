//! The high-fidelity form (metering fluid, second-order flapper) against the plant's metering form.

mod common;

use common::{Rig, collocation, command, simulate};
use eha_monitor::command::COMMANDS;
use eha_monitor::link::station::any_steps;
use eha_monitor::model::{Feedback, ValveForm};
use eha_monitor::parameter::Parameters;

/// Largest distance from the plant with both at 2 us, um rms over 0.45 s.
const LIMIT: f64 = 0.05;
/// The same by the midpoint rule at the step that simulations of the HF model use, 10 us.
const COARSE_LIMIT: f64 = 0.2;
/// The same by collocation, in steps of up to 1 ms.
const LONG_LIMIT: f64 = 0.02;
/// Most steps that collocation takes for 0.45 s.
const MOST_STEPS: u32 = 2500;

fn rig(fdj: f64, bkl: f64, feedback: Feedback) -> Rig {
    let mut rig = Rig::of(ValveForm::TwoStage, feedback);
    rig.parameters.metering_blend = 1.0;
    (rig.parameters.fdj, rig.parameters.bkl) = (fdj, bkl);
    rig
}

fn check(commands: &[&str]) {
    for name in commands {
        let samples = command(name, 450);
        for (fdj, bkl, feedback) in
            [(200.0, 0.0, Feedback::Ram), (800.0, 2e-4, Feedback::Ram), (6400.0, 1e-3, Feedback::User)]
        {
            let rig = rig(fdj, bkl, feedback);
            let plant = rig.plant(&samples);
            let fine = rig.midpoint(&samples, 2e-6).distance(&plant);
            let coarse = rig.midpoint(&samples, 1e-5).distance(&plant);
            let long = rig.collocation(&samples);
            let (steps, distance) = (long.steps, long.distance(&plant));
            println!(
                "{name:10} {fdj:6} N {feedback:?}: 2 us {fine}, 10 us {:.5} um, {steps} long steps {distance}",
                coarse.user
            );
            assert!(distance.user < LONG_LIMIT && distance.ram < LONG_LIMIT, "{name}, {fdj} N: {distance}");
            assert!(steps < MOST_STEPS, "{name}, {fdj} N: {steps} steps");
            assert!(fine.user < LIMIT && fine.ram < LIMIT, "{name}, {fdj} N: {fine}");
            assert!(fine.current < 1e-3 && fine.pressure < 2.0, "{name}, {fdj} N: {fine}");
            assert!(coarse.user < COARSE_LIMIT, "{name}, {fdj} N: {coarse}");
        }
    }
}

#[test]
fn metering_form_agrees_with_the_plant_on_smooth_commands() {
    check(&["mixed", "chirp", "chirp-low", "ramp"]);
}

#[test]
fn metering_form_agrees_with_the_plant_on_hard_commands() {
    check(&["mixed-step", "sine", "step"]);
    assert_eq!(COMMANDS.len(), 7, "a new command needs its place in these tests");
}

#[test]
fn everything_at_once_agrees_with_the_plant() {
    let samples = command("mixed", 450);
    let mut rig = rig(400.0, 1e-4, Feedback::User);
    let p = &mut rig.parameters;
    (p.torque_motor_hysteresis, p.current_offset, p.feedback_play) = (0.05, 0.05, 1e-6);
    (p.supply_ratio, p.supply_sag, p.spool_overlap) = (0.9, 0.5, 2e-6);
    (p.oil_compliance, p.leakage) = (1e-10, 2e-12);
    (p.stribeck_velocity, p.friction_asymmetry, p.quadratic_drag) = (0.01, 0.1, 1e4);
    (p.spring_load, p.constant_load, p.step_load, p.step_load_time) = (1e4, 100.0, 200.0, 0.2);
    (p.mount_compliance, p.mount_lag) = (1e-8, 5e-5);
    (p.sensor_gain, p.sensor_offset, p.sensor_cubic) = (0.01, 1e-5, 10.0);
    // No velocity gain: with it, and a curved force law, the core finds the hysteresis's turning points by the
    // acceleration of the linear laws only, which leaves some micrometres.
    p.integral_gain = 1e3;
    let distance = rig.midpoint(&samples, 2e-6).distance(&rig.plant(&samples));
    println!("{distance}");
    assert!(distance.user < LIMIT && distance.ram < LIMIT, "{distance}");
    let distance = rig.collocation(&samples).distance(&rig.plant(&samples));
    println!("{distance}");
    assert!(distance.user < LIMIT && distance.ram < LIMIT, "{distance}");
}

#[test]
fn a_breakaway_that_outdoes_the_damping_of_the_oil_agrees_with_the_plant() {
    // Friction falls by 2e6 N s/m as the ram breaks away, so that the motion grows within 11 us.
    let samples = command("mixed-step", 1500);
    let mut rig = Rig::of(ValveForm::TwoStage, Feedback::Ram);
    (rig.parameters.fdj, rig.parameters.stribeck_velocity) = (1332.0, 6.2e-4);
    let distance = rig.collocation(&samples).distance(&rig.plant(&samples));
    println!("{distance}");
    assert!(distance.ram < LONG_LIMIT, "{distance}");
}

#[test]
fn a_tolerance_steers_the_error() {
    // The acid test: the saturated spool amplifies differences. Too coarse a tolerance must show, or the estimate of the
    // error steers nothing.
    let samples = command("sine", 450);
    let rig = rig(6400.0, 0.0, Feedback::Ram);
    let plant = rig.plant(&samples);
    let by = |tolerance| collocation(rig.form, &rig.parameters, tolerance, &samples);
    let (fine, coarse) = (by(2e-9), by(1e-4));
    let errors = [&fine, &coarse].map(|trace| trace.distance(&plant).ram);
    println!("{errors:?} um in {} and {} steps", fine.steps, coarse.steps);
    assert!(errors[1] > 5.0 * errors[0] && coarse.steps < fine.steps, "{errors:?}");
}

#[test]
fn single_precision_follows_double() {
    for name in ["sine", "chirp", "mixed-step"] {
        let samples = command(name, 450);
        let rig = rig(800.0, 2e-4, Feedback::Ram);
        let double = rig.collocation(&samples);
        let single = collocation(rig.form, &rig.parameters.to_f32(), 2e-9, &samples);
        let distance = single.distance(&double);
        println!("{name}: {distance}, {} and {} steps", single.steps, double.steps);
        assert!(distance.user < 0.05, "{name}: {distance}");
    }
}

#[test]
fn the_linear_form_is_not_the_metering_form() {
    let samples = command("mixed", 450);
    let metering = rig(200.0, 0.0, Feedback::Ram);
    let mut linear = metering;
    linear.parameters.metering_blend = 0.0;
    assert!(linear.exact(&samples).distance(&metering.plant(&samples)).user > 3.0 * LIMIT);
}

#[test]
fn the_monitors_steps_for_every_rig_lose_nothing_to_single_precision() {
    type Change = fn(&mut Parameters<f64>);
    let lacking: [(&str, Change); 4] = [
        ("metering", |p| p.metering_blend = 1.0),
        ("stribeck", |p| p.stribeck_velocity = 5e-3),
        ("sag and oil", |p| (p.supply_sag, p.oil_compliance) = (0.5, 7e-10)),
        ("plays", |p| (p.torque_motor_hysteresis, p.feedback_play) = (0.1, 5e-6)),
    ];
    for (effect, change) in lacking {
        let mut rig = rig(800.0, 2e-4, Feedback::Ram);
        rig.parameters.metering_blend = 0.0;
        change(&mut rig.parameters);
        for name in ["mixed", "chirp", "mixed-step", "sine"] {
            let samples = command(name, 1000);
            let double = rig.collocation(&samples);
            let single =
                simulate(rig.form, &rig.parameters.to_f32(), &mut *Box::new(any_steps::<8>()), &samples);
            let distance = single.distance(&double);
            let (few, many) = (double.steps, single.steps);
            println!("{name:10} {effect:12}: {few} and {many} steps, {distance}");
            assert!(distance.user < 0.01 && distance.ram < 0.01, "{name}, {effect}: {distance}");
            assert!(many < 2 * few, "{name}, {effect}: {many} steps in place of {few}");
        }
    }
}
