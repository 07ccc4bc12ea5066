//! The plant against results that can be derived by hand.

use reference_plant::{Command, Mount, Parameters, Plant, blended_pressure, play};

/// The plant without dry and viscous friction on the jack and without friction on the spool.
fn frictionless() -> Plant {
    let parameters =
        Parameters { spool_friction: 0.0, jack_friction: 0.0, jack_viscosity: 0.0, ..Parameters::default() };
    Plant { parameters, ..Plant::default() }
}

fn assert_close(value: f64, expected: f64, relative: f64) {
    assert!((value - expected).abs() <= relative * expected.abs(), "{value:e} is not {expected:e}");
}

#[test]
fn saturated_spool_slews_at_19_4_mm_per_s() {
    let record = frictionless().record(&Command::Step { size: 0.05, time: 0.0 }, 20);
    let slew = (record.spool[15] - record.spool[10]) / 5e-3;
    assert_close(slew, 700.0 / 36_000.0, 1e-9);
    assert_eq!(record.flapper[12], 1e-4, "the flapper rests at its stop");
}

#[test]
fn no_load_rate_is_0_15_m_per_s() {
    let record = frictionless().record(&Command::Step { size: 0.1, time: 0.0 }, 400);
    assert_eq!(record.spool[399], 0.6e-3, "the spool rests at its stop");
    assert_close((record.ram[399] - record.ram[300]) / 0.099, 0.15, 1e-9);
}

#[test]
fn stall_force_is_16_kn() {
    let run = |load| {
        let mut plant = frictionless();
        plant.effects.step_load = load;
        plant.effects.step_load_time = 0.2;
        let record = plant.record(&Command::Step { size: 0.1, time: 0.0 }, 260);
        (record.ram[259] - record.ram[258], record.pressure[259])
    };
    assert!(run(15_900.0).0 > 0.0);
    let (motion, pressure) = run(16_500.0);
    assert!(motion < 0.0);
    assert_eq!(pressure, 2e7);
}

#[test]
fn small_signal_velocity_gain_is_156_per_s() {
    let record = frictionless().record(&Command::Ramp { rate: 0.01 }, 300);
    let error = record.command[299] - record.ram[299];
    assert_close(0.01 / error, 1e4 * 0.01 / 160.0 * 0.2 / 8e-4, 1e-6);
}

#[test]
fn flapper_follows_its_step_response() {
    let mut plant = Plant::default();
    plant.parameters.spool_friction = 1e9;
    let record = plant.simulate(&Command::Step { size: 1e-4, time: 0.0 }, 8, 2e-6);
    let (omega, zeta, last) = (2513.0, 0.6_f64, 0.01 / 200.0);
    let root = (1.0 - zeta * zeta).sqrt();
    for (i, flapper) in record.flapper.iter().enumerate() {
        let angle = omega * i as f64 * 1e-3;
        let (sin, cos) = (root * angle).sin_cos();
        let expected = last * (1.0 - (-zeta * angle).exp() * (cos + zeta / root * sin));
        assert!((flapper - expected).abs() < 1e-5 * last, "{i} ms: {flapper:e} is not {expected:e}");
    }
}

#[test]
fn jack_breaks_away_at_static_friction() {
    for asymmetry in [0.0, 0.2] {
        let mut plant = Plant::default();
        plant.parameters.spool_friction = 1e9;
        plant.effects.ramp_load = 4000.0;
        plant.effects.friction_asymmetry = asymmetry;
        // The load pushes backwards, where friction is 1 - a.
        let record = plant.record(&Command::Ramp { rate: 0.0 }, 130);
        let at = (400.0 * (1.0 - asymmetry) / 4.0) as usize;
        assert!(record.ram[..=at].iter().all(|x| *x == 0.0));
        assert!(record.ram[at + 1] < 0.0);
    }
}

#[test]
fn pressure_solves_the_blended_equation() {
    let (p0, k) = (2e7_f64, 2.1e-12);
    for b in [0.0, 0.3, 1.0] {
        for ps in [1.4e7, 2e7] {
            for opening in [-1.2e-4, -1e-7, 0.0, 3e-5] {
                for q in [-2e-4, -1e-6, 0.0, 5e-5] {
                    let p = blended_pressure(q, opening, opening, b, ps, p0, k);
                    let sign = if opening < 0.0 { -1.0 } else { 1.0 };
                    let root = ((ps - sign * p) / p0).max(0.0).sqrt();
                    let residual = opening * ((1.0 - b) + b * root) - k * p - q;
                    assert!(residual.abs() < 1e-12, "b {b} ps {ps} opening {opening} q {q}: {residual:e}");
                }
            }
        }
    }
}

#[test]
fn play_keeps_its_width_and_its_rest() {
    let mut state = 0.0;
    for i in 0..400 {
        let input = 3.0 * (0.05 * f64::from(i)).sin();
        let before = state;
        state = play(input, state, 0.5);
        assert!((input - state).abs() <= 0.5 + 1e-15);
        assert!(state == before || ((input - state).abs() - 0.5).abs() < 1e-15, "moves only when pushed");
        assert_eq!(play(input, state, 0.5), state, "the same input moves nothing");
    }
    let mut plant = Plant::default();
    plant.parameters.backlash = 1e-3;
    let record = plant.record(&Command::SINE, 400);
    let gap = record.ram.iter().zip(&record.lvdt).map(|(x, user)| (x - user).abs()).fold(0.0, f64::max);
    assert_close(gap, 0.5e-3, 1e-9);
}

#[test]
fn mount_gives_way_by_load_over_stiffness() {
    let mut plant = Plant::default();
    plant.parameters.spool_friction = 1e9;
    plant.effects.constant_load = 100.0;
    plant.effects.mount = Some(Mount { stiffness: 1e7, damping: 1e4, in_loop: false, ..Mount::default() });
    let record = plant.record(&Command::Ramp { rate: 0.0 }, 100);
    assert_close(record.ram[99], -1e-5, 1e-6);
}

#[test]
fn jack_rests_at_its_stop_and_leaves_it() {
    let mut plant = Plant::default();
    plant.parameters.jack_stop = 2e-3;
    let record = plant.record(&Command::Chirp { amplitude: 1e-2 }, 900);
    let top = record.ram.iter().copied().fold(0.0, f64::max);
    assert_eq!(top, 2e-3);
    assert!(record.ram[899] < 1e-3);
}

#[test]
fn supply_pressure_scales_the_no_load_rate_by_its_root() {
    for blend in [0.0, 1.0] {
        let mut plant = frictionless();
        plant.parameters.supply_pressure = 0.81 * plant.parameters.nominal_supply_pressure;
        plant.effects.turbulent_metering = blend;
        let record = plant.record(&Command::Step { size: 0.1, time: 0.0 }, 400);
        assert_close((record.ram[399] - record.ram[300]) / 0.099, 0.9 * 0.15, 1e-9);
    }
}
