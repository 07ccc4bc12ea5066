//! Every effect of the catalogue in the core against the same effect in the independent plant.

mod common;

use common::{PERIOD, Rig, Trace, command, rms, simulate_begun};
use eha_monitor::effect::{EFFECTS, EffectInfo};
use eha_monitor::integrate::Stepper;
use eha_monitor::integrate::exact::{Exact, FINE};
use eha_monitor::model::state::{BASE_ORDER, FULL_ORDER};
use eha_monitor::model::{Feedback, Model, ValveForm};
use eha_monitor::parameter::Parameter as P;
use eha_monitor::parameter::{PARAMETERS, Reach};

/// Samples compared.
const SAMPLES: usize = 320;
const VALVES: [ValveForm; 3] = [ValveForm::TwoStage, ValveForm::StaticFlapper, ValveForm::FirstOrder];
const FEEDBACKS: [Feedback; 2] = [Feedback::Ram, Feedback::User];

/// A row: effect, parameters at a clearly visible size, largest distance from the plant in um rms, and is the model
/// with the effect piecewise affine?
type Row = (&'static str, &'static [(P, f64)], f64, bool);

/// The design's bar is 0.3 um. A lag of the LVDT takes the way from sample to sample for a parabola, which the play may bend.
const TABLE: &[Row] = &[
    ("valve-offset", &[(P::CurrentOffset, 0.1)], 0.02, true),
    ("torque-motor-hysteresis", &[(P::TorqueMotorHysteresis, 0.1)], 0.3, true),
    ("torque-motor-gain", &[(P::TorqueMotorGain, 0.009)], 0.02, true),
    ("feedback-play", &[(P::FeedbackPlay, 5e-6)], 0.02, true),
    ("filter-clogging", &[(P::FilterClogging, 0.3)], 0.02, true),
    ("spool-friction", &[(P::SpoolFriction, 14.0)], 0.02, true),
    ("spool-overlap", &[(P::SpoolOverlap, 1e-5)], 0.02, true),
    ("flow-asymmetry", &[(P::FlowAsymmetry, 0.05)], 0.02, true),
    ("turbulent-metering", &[(P::MeteringBlend, 0.5)], 0.02, false),
    ("pressure-gain", &[(P::PressureGain, 5e10)], 0.02, true),
    ("leakage", &[(P::Leakage, 1e-12)], 0.02, true),
    ("supply-pressure", &[(P::SupplyRatio, 0.8)], 0.02, true),
    ("supply-sag", &[(P::SupplySag, 2.0), (P::SupplySagLag, 0.07)], 0.02, false),
    ("compressibility", &[(P::OilCompliance, 1e-9)], 0.02, true),
    ("stribeck", &[(P::StribeckVelocity, 5e-3)], 0.02, false),
    ("friction-asymmetry", &[(P::FrictionAsymmetry, 0.2)], 0.02, true),
    ("viscous-friction", &[(P::ViscousFriction, 5000.0)], 0.02, true),
    ("viscous-asymmetry", &[(P::RetractionViscosity, 5000.0)], 0.02, true),
    ("shear-thinning", &[(P::ThinningViscosity, 2e4), (P::ThinningVelocity, 0.02)], 0.02, false),
    ("quadratic-drag", &[(P::QuadraticDrag, 1e5)], 0.02, false),
    ("constant-load", &[(P::ConstantLoad, 500.0)], 0.02, true),
    ("spring-load", &[(P::SpringLoad, 2e4)], 0.02, true),
    ("step-load", &[(P::StepLoad, 500.0), (P::StepLoadTime, 0.1005)], 0.02, true),
    (
        "cogging",
        &[(P::CoggingCosine, 150.0), (P::CoggingSine, -200.0), (P::CoggingPitch, 1.5e-3)],
        0.02,
        false,
    ),
    ("load-mass", &[(P::LoadMass, 200.0)], 0.02, true),
    ("mount-compliance", MOUNT, 0.02, true),
    ("drive-lag", &[(P::DriveLag, 1e-3)], 0.02, true),
    ("sensor-offset", &[(P::SensorOffset, 1e-5)], 0.02, true),
    ("sensor-gain", &[(P::SensorGain, 0.01)], 0.02, true),
    ("sensor-lag", &[(P::SensorLag, 1e-3)], 0.05, true),
    ("sensor-delay", &[(P::SensorDelay, 1.3e-3)], 0.02, true),
    ("sensor-cubic", &[(P::SensorCubic, 100.0)], 0.02, true),
];

const MOUNT: &[(P, f64)] = &[
    (P::MountCompliance, 5e-8),
    (P::MountLag, 1e-4),
    (P::BaseMass, 3.0),
    (P::LoadFollowsBase, 1.0),
    (P::LoopSeesBase, 1.0),
    (P::PlaySeesBase, 1.0),
];

fn faulty(valve: ValveForm, feedback: Feedback) -> Rig {
    let mut rig = Rig::of(valve, feedback);
    (rig.parameters.bkl, rig.parameters.fdj) = (1e-4, 400.0);
    rig
}

fn with_effect(mut rig: Rig, values: &[(P, f64)]) -> Rig {
    for &(parameter, value) in values {
        rig.parameters.set(parameter, value);
    }
    rig
}

#[test]
fn the_table_covers_the_catalogue() {
    let table: Vec<_> = TABLE.iter().map(|row| row.0).collect();
    let mut catalogue: Vec<_> = EFFECTS.iter().map(|entry| entry.name).collect();
    for (entry, row) in EFFECTS.iter().zip(TABLE) {
        let parameters: Vec<_> = row.1.iter().map(|&(parameter, _)| parameter).collect();
        assert_eq!(entry.parameters, parameters, "{}", entry.name);
    }
    assert_eq!(table, catalogue);
    catalogue.sort_unstable();
    catalogue.dedup();
    assert_eq!(catalogue.len(), EFFECTS.len(), "a name appears twice");
}

fn check_on(name: &str) {
    let samples = command(name, SAMPLES);
    for valve in VALVES {
        for feedback in FEEDBACKS {
            let plain = faulty(valve, feedback);
            let without = plain.core(&samples);
            for &(effect, values, limit, affine) in TABLE {
                let rig = with_effect(plain, values);
                assert_eq!(Model::new(rig.form, &rig.parameters).is_affine(), affine, "{effect}");
                let core = rig.core(&samples);
                let distance = core.distance(&rig.plant(&samples));
                let size = core.distance(&without).user;
                println!("{name:10} {effect:24} {valve:?} {feedback:?}: size {size:.2} um, {distance}");
                // The first-order valve has no spool and no first stage; a valve drives without a recorded drive.
                let absent = effect == "drive-lag"
                    || valve == ValveForm::FirstOrder
                        && ["feedback-play", "filter-clogging", "spool-friction"].contains(&effect);
                assert!(
                    absent || size > 0.3,
                    "{effect} on {name}, {valve:?}, {feedback:?} is not visible: {size} um"
                );
                assert!(
                    distance.user < limit && distance.ram < limit,
                    "{effect} on {name}, {valve:?}, {feedback:?}: {distance}"
                );
                assert!(
                    distance.current < 2e-2 * limit.max(0.1) && distance.pressure < 4.0,
                    "{effect}: {distance}"
                );
            }
        }
    }
}

#[test]
fn effects_agree_with_the_plant_on_mixed_step() {
    check_on("mixed-step");
}

#[test]
fn effects_agree_with_the_plant_on_the_sine() {
    check_on("sine");
}

#[test]
fn a_mount_agrees_whatever_follows_and_sees_its_base() {
    use Feedback::{Ram, User};
    let mut seen: Vec<Trace> = Vec::new();
    // A user who is fed back is over ground.
    for (feedback, follows, sees, passed) in [
        (Ram, 1.0, 1.0, 1.0),
        (Ram, 0.0, 1.0, 1.0),
        (Ram, 1.0, 0.0, 1.0),
        (Ram, 0.0, 0.0, 1.0),
        (Ram, 1.0, 1.0, 0.0),
        (Ram, 0.0, 0.0, 0.0),
        (User, 1.0, 1.0, 1.0),
        (User, 1.0, 1.0, 0.0),
    ] {
        let shares = [(P::LoadFollowsBase, follows), (P::LoopSeesBase, sees), (P::PlaySeesBase, passed)];
        let rig = with_effect(with_effect(faulty(ValveForm::TwoStage, feedback), MOUNT), &shares);
        for name in ["mixed-step", "sine"] {
            let samples = command(name, SAMPLES);
            let core = rig.core(&samples);
            let distance = core.distance(&rig.plant(&samples));
            println!("{name:10} {feedback:?} {shares:?}: {distance}");
            assert!(distance.user < 0.02 && distance.ram < 0.02, "{name}, {shares:?}: {distance}");
            if name == "sine" {
                for other in &seen {
                    let apart = core.distance(other).user;
                    assert!(apart > 0.3, "{shares:?}: {apart} um from another form");
                }
                seen.push(core);
            }
        }
    }
}

#[test]
fn neutral_values_change_nothing() {
    // With the effect absent its parameters have their defaults: zero, or the source's value.
    let samples = command("mixed", 300);
    let base = faulty(ValveForm::TwoStage, Feedback::Ram);
    let expected = base.core(&samples);
    for entry in EFFECTS {
        let mut rig = base;
        for parameter in entry.parameters {
            rig.parameters.set(*parameter, parameter.info().default);
        }
        assert_eq!(rig.core(&samples), expected, "{}", entry.name);
    }
    // What an absent effect is shaped by has no influence either.
    for parameter in [
        P::SupplySagLag,
        P::MountLag,
        P::BaseMass,
        P::LoadFollowsBase,
        P::LoopSeesBase,
        P::PlaySeesBase,
        P::StepLoadTime,
        P::VapourPressure,
        P::ReturnPressure,
        P::ThinningVelocity,
        P::CoggingPitch,
        P::DriveLag,
    ] {
        let rig = with_effect(base, &[(parameter, 0.5 * parameter.info().upper)]);
        assert_eq!(rig.core(&samples), expected, "{parameter:?}");
    }
}

#[test]
fn a_vanishing_size_vanishes() {
    // No effect jumps when it appears.
    let samples = command("mixed", 300);
    let base = faulty(ValveForm::TwoStage, Feedback::Ram);
    let expected = base.core(&samples);
    for &(effect, values, ..) in TABLE {
        let neutral = values[0].0.info().default;
        let small: Vec<_> = match effect {
            // Its friction tends to Coulomb's as its velocity tends to zero, with a jump at rest only.
            "stribeck" => vec![(P::StribeckVelocity, 1e-9)],
            _ => values
                .iter()
                .map(|&(p, value)| (p, p.info().default + 1e-5 * (value - p.info().default)))
                .collect(),
        };
        let distance = with_effect(base, &small).core(&samples).distance(&expected);
        assert!(distance.user < 0.05, "{effect} next to {neutral}: {distance}");
    }
}

#[test]
fn twins_are_the_same_model() {
    let samples = command("mixed", 300);
    let base = with_effect(faulty(ValveForm::TwoStage, Feedback::Ram), &[(P::SupplyRatio, 0.9)]);
    for (effect, parameter, value) in [
        ("leakage", P::Leakage, 4e-13),
        ("pressure-gain", P::PressureGain, 3e10),
        ("pressure-gain", P::PressureGain, 1.02e11),
    ] {
        let one = with_effect(base, &[(parameter, value)]);
        let (twin, same) =
            EffectInfo::named(effect).unwrap().twin(&one.parameters, &base.parameters).unwrap();
        let distance = |value: f64| {
            with_effect(base, &[(twin.parameters[0], value)]).core(&samples).distance(&one.core(&samples)).ram
        };
        println!("{effect}: {} um, {} um at a value 1 % higher", distance(same), distance(1.01 * same));
        assert!(distance(same) < 1e-6, "{effect}: {}", distance(same));
        assert!(distance(1.01 * same) > 1e-3, "the check sees 1 %: {}", distance(1.01 * same));
    }
    // A leak can only add to the conductance, and no other effect has a twin.
    let tighter = with_effect(base, &[(P::PressureGain, 2e11)]).parameters;
    assert_eq!(EffectInfo::named("pressure-gain").unwrap().twin(&tighter, &base.parameters), None);
    assert_eq!(EffectInfo::named("spring-load").unwrap().twin(&tighter, &base.parameters), None);
}

#[test]
fn exact_steps_agree_with_the_midpoint_rule() {
    // At 1 us wherever the model is affine. A plain loop crosses inside a finest step of 1/16 ms, others of 1/64 ms.
    let samples = command("mixed-step", 230);
    for &(effect, values, _, affine) in TABLE {
        if affine {
            let rig = with_effect(faulty(ValveForm::TwoStage, Feedback::Ram), values);
            let distance = rig.exact(&samples).distance(&rig.midpoint(&samples, 1e-6));
            println!("{effect:24} {distance}");
            let is_plain = Model::new(rig.form, &rig.parameters).order() == BASE_ORDER;
            let limit = match effect {
                "torque-motor-hysteresis" => 0.02,
                _ if is_plain => 5e-3,
                _ => 1e-3,
            };
            assert!(distance.ram < limit, "{effect}: {distance}");
        }
    }
}

/// The trace of a rig by a stepper that another rig has filled, told that the matrices still hold.
fn after<const N: usize>(first: &Rig, second: &Rig, changed: bool, samples: &[f64]) -> Trace {
    let mut stepper = Exact::<f64, N, 32, FINE>::new();
    stepper.begin(PERIOD, false, true);
    simulate_begun(first.form, &first.parameters, &mut stepper, samples, &[]);
    stepper.begin(PERIOD, false, changed);
    simulate_begun(second.form, &second.parameters, &mut stepper, samples, &[])
}

#[test]
fn the_reach_of_every_parameter_is_what_the_table_says() {
    let samples = command("mixed", 250);
    let mut seen_dynamics = 0;
    for feedback in FEEDBACKS {
        let mut base = faulty(ValveForm::TwoStage, feedback);
        base.parameters.proportional_gain = 1.1e4;
        (base.parameters.torque_motor_hysteresis, base.parameters.integral_gain) = (0.05, 1e3);
        for row in PARAMETERS {
            let value = base.parameters.get(row.parameter);
            let moved = if value == 0.0 { 1e-3 * row.upper } else { value * 1.03 };
            let second = with_effect(base, &[(row.parameter, moved)]);
            if !Model::new(second.form, &second.parameters).is_affine() {
                continue;
            }
            let same = after::<FULL_ORDER>(&base, &second, false, &samples)
                == after::<FULL_ORDER>(&base, &second, true, &samples);
            if Model::<f64>::reach(base.form, row.parameter) == Reach::Dynamics {
                seen_dynamics += usize::from(!same);
            } else {
                assert!(same, "{} reaches the dynamics ({feedback:?})", row.name);
            }
        }
    }
    assert!(seen_dynamics > 20, "the check sees stale matrices: {seen_dynamics}");
    let (base, order) = (faulty(ValveForm::TwoStage, Feedback::Ram), BASE_ORDER);
    assert_eq!(Model::new(base.form, &base.parameters).order(), order);
    for parameter in [P::DryFriction, P::Backlash, P::ConstantLoad, P::SpoolFriction, P::CurrentOffset] {
        let second = with_effect(base, &[(parameter, 1.5 * base.parameters.get(parameter).max(1e-2))]);
        let [kept, anew] =
            [false, true].map(|changed| after::<BASE_ORDER>(&base, &second, changed, &samples));
        assert_eq!(kept, anew, "{parameter:?}");
        assert!(rms(&kept.user, &base.exact(&samples).user) > 0.0, "{parameter:?} acts");
    }
}
