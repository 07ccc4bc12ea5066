//! Every effect acts, and those with a simple consequence have it.

use reference_plant::{
    Command, Effects, Feedback, Gauss, Gust, Mount, Parameters, Plant, Tone, add_noise, quantise,
    rms_difference,
};

#[test]
fn every_effect_changes_the_record() {
    type Change = fn(&mut Parameters, &mut Effects);
    let changes: [(&str, Change); 41] = [
        ("valve-offset", |p, _| p.valve_offset = 0.1),
        ("torque-motor-hysteresis", |p, _| p.motor_hysteresis = 0.1),
        ("torque-motor-gain", |p, _| p.motor_gain *= 0.9),
        ("feedback-play", |p, _| p.feedback_play = 5e-6),
        ("filter-clogging", |p, _| p.filter_clogging = 0.3),
        ("spool-friction", |p, _| p.spool_friction = 14.0),
        ("spool-overlap", |_, e| e.spool_overlap = 1e-5),
        ("flow-asymmetry", |_, e| e.flow_asymmetry = 0.05),
        ("turbulent-metering", |_, e| e.turbulent_metering = 0.5),
        ("pressure-gain", |p, _| p.pressure_gain *= 0.5),
        ("leakage", |p, _| p.leakage = 1e-12),
        ("supply-pressure", |p, _| p.supply_pressure *= 0.8),
        ("supply-sag", |_, e| (e.supply_sag, e.supply_sag_lag) = (2.0, 0.05)),
        ("compressibility", |_, e| e.bulk_modulus = Some(1e9)),
        ("stribeck", |_, e| e.stribeck_velocity = 5e-3),
        ("friction-asymmetry", |_, e| e.friction_asymmetry = 0.2),
        ("viscous-friction", |p, _| p.jack_viscosity = 5000.0),
        ("viscous-asymmetry", |_, e| e.retraction_viscosity = 5000.0),
        ("shear-thinning", |_, e| (e.thinning_viscosity, e.thinning_velocity) = (1e4, 0.02)),
        ("quadratic-drag", |_, e| e.quadratic_drag = 1e5),
        ("constant-load", |_, e| e.constant_load = 500.0),
        ("spring-load", |p, _| p.load_stiffness = 2e4),
        ("step-load", |_, e| (e.step_load, e.step_load_time) = (500.0, 0.1)),
        ("load-mass", |p, _| p.jack_mass = 200.0),
        ("mount-compliance", |_, e| {
            e.mount = Some(Mount::default());
        }),
        ("sensor-offset", |_, e| e.sensor_offset = 1e-5),
        ("sensor-gain", |_, e| e.sensor_gain = 0.01),
        ("sensor-lag", |_, e| e.sensor_lag = 1e-3),
        ("sensor-delay", |_, e| e.sensor_delay = 1e-3),
        ("sensor-cubic", |_, e| e.sensor_cubic = 100.0),
        ("disturbance", |_, e| e.disturbance = Tone { amplitude: 200.0, frequency: 17.0, phase: 0.0 }),
        ("drift", |_, e| e.sensor_drift = 1e-4),
        ("hardening spring", |_, e| e.hardening_spring = 1e11),
        ("growing viscous friction", |_, e| e.viscosity_growth = 1e5),
        ("growing dry friction", |_, e| e.friction_growth = 2.0),
        ("gust", |_, e| e.gust = Gust { force: 500.0, start: 0.1, end: 0.12 }),
        ("sensor ripple", |_, e| (e.sensor_ripple, e.sensor_ripple_pitch) = (1e-5, 1e-3)),
        ("cogging", |_, e| (e.detent_force, e.detent_pitch) = (200.0, 1e-3)),
        ("ramp and sine load", |_, e| {
            e.ramp_load = 1000.0;
            e.sine_load = Tone { amplitude: 100.0, frequency: 3.0, phase: 1.0 };
        }),
        ("feedback", |p, _| (p.feedback, p.backlash) = (Feedback::User, 1e-4)),
        ("controller", |p, _| (p.integral_gain, p.derivative_gain, p.velocity_gain) = (1e4, 10.0, 20.0)),
    ];
    let command = Command::SINE;
    let neutral = Plant::default().record(&command, 250);
    for (name, change) in changes {
        let mut plant = Plant::default();
        change(&mut plant.parameters, &mut plant.effects);
        let record = plant.record(&command, 250);
        let size = rms_difference(&record.lvdt, &neutral.lvdt);
        assert!(size > 1e-7 && size < 5e-3, "{name}: {size:e} m");
    }
}

#[test]
fn sensor_effects_act_on_a_ramp_as_expected() {
    let run = |effects: Effects| {
        let record = Plant { effects, ..Plant::default() }.record(&Command::RAMP, 200);
        (record.ram[199], record.lvdt[199])
    };
    // The ram still settles by some 40 µm/s.
    let close = |(ram, lvdt): (f64, f64), expected: f64| {
        assert!((lvdt - ram - expected).abs() < 0.2e-6, "{:e} is not {expected:e}", lvdt - ram);
    };
    let x = run(Effects::default()).0;
    close(run(Effects::default()), 0.0);
    close(run(Effects { sensor_lag: 2e-3, ..Effects::default() }), -0.03 * 2e-3);
    close(run(Effects { sensor_delay: 1.5e-3, ..Effects::default() }), -0.03 * 1.5e-3);
    close(run(Effects { sensor_gain: 0.01, ..Effects::default() }), 0.01 * x);
    close(run(Effects { sensor_cubic: 50.0, ..Effects::default() }), 50.0 * x.powi(3));
    close(run(Effects { sensor_offset: 1e-5, ..Effects::default() }), 1e-5);
    close(run(Effects { sensor_drift: 1e-4, ..Effects::default() }), 1e-4 * 0.199);
    let ripple = Effects { sensor_ripple: 1e-5, sensor_ripple_pitch: 4.0 * x, ..Effects::default() };
    close(run(ripple), 1e-5);
}

#[test]
fn a_gust_comes_and_goes() {
    let gust = Gust { force: 500.0, start: 0.1, end: 0.12 };
    let effects = Effects { gust, ..Effects::default() };
    let record = Plant { effects, ..Plant::default() }.record(&Command::RAMP, 200);
    let blown: Vec<usize> = (0..200).filter(|&sample| record.load[sample] != 0.0).collect();
    assert_eq!(blown, (100..120).collect::<Vec<_>>());
}

#[test]
fn stiff_oil_tends_to_the_incompressible_fluid() {
    let run =
        |beta| {
            Plant { effects: Effects { bulk_modulus: beta, ..Effects::default() }, ..Plant::default() }
                .simulate(&Command::Mixed, 400, 1e-6)
        };
    let rigid = run(None);
    let far = rms_difference(&run(Some(1e11)).ram, &rigid.ram);
    let near = rms_difference(&run(Some(1e12)).ram, &rigid.ram);
    assert!(near < 0.3 * far && near < 1e-7, "{far:e} {near:e}");
}

#[test]
fn noise_has_its_moments_and_repeats() {
    let draws = |seed| {
        let mut gauss = Gauss::new(seed);
        (0..40_000).map(|_| gauss.draw()).collect::<Vec<_>>()
    };
    let (a, n) = (draws(1), 40_000.0);
    let moment = |k| a.iter().map(|x: &f64| x.powi(k)).sum::<f64>() / n;
    assert!(moment(1).abs() < 0.02 && (moment(2) - 1.0).abs() < 0.03 && (moment(4) - 3.0).abs() < 0.2);
    assert_eq!(a, draws(1));
    assert_ne!(a, draws(2));

    let mut channel = vec![0.0; 5000];
    add_noise(&mut channel, 2e-6, 7);
    assert!((rms_difference(&channel, &vec![0.0; 5000]) / 2e-6 - 1.0).abs() < 0.05);
    let fine = channel.clone();
    quantise(&mut channel, 1e-6);
    assert!(channel.iter().zip(&fine).all(|(a, b)| (a - b).abs() <= 0.5e-6 * 1.000_001));

    let mut record = Plant::default().record(&Command::STEP, 50);
    let clean = record.lvdt.clone();
    record.add_rate_noise(1e-4, 1e-3, 3);
    let touched = (0..50).filter(|&i| record.lvdt[i] != clean[i]).collect::<Vec<_>>();
    assert_eq!(touched, [10], "only the sample after the step");
}

#[test]
fn commands_are_what_the_design_says() {
    let close = |command: &Command, t: f64, x: f64| {
        assert!((command.value(t) - x).abs() < 1e-12, "{t} s: {}", command.value(t));
    };
    for (t, x) in [(0.2, 6e-3), (0.3, 9e-3), (0.475, 1e-3), (0.65, 9e-3), (0.65 + 0.35 / 3.0, 1e-3)] {
        close(&Command::Mixed, t, x);
    }
    for (t, x) in [(0.005, 0.0), (0.01, 3e-3), (0.2, 0.0), (0.5, 1e-3), (0.6, 3e-3), (0.7, -3e-3)] {
        close(&Command::MixedStep, t, x);
    }
    close(&Command::CHIRP, 1.0, 1e-2 * (std::f64::consts::TAU * 0.8).sin());
    let sampled = Command::STEP.sampled(20, 1e-3);
    close(&sampled, 0.0095, 1.5e-3);
    close(&sampled, 5.0, 3e-3);
}
