//! Each block of the core against its closed form.

mod common;

use common::{PERIOD, Rig, assert_close, command, simulate, simulate_begun};
use eha_monitor::integrate::Stepper;
use eha_monitor::integrate::exact::Exact;
use eha_monitor::integrate::midpoint::Midpoint;
use eha_monitor::model::fluid::Fluid;
use eha_monitor::model::play::play;
use eha_monitor::model::sensor::{Lvdt, LvdtState};
use eha_monitor::model::state::BASE_ORDER;
use eha_monitor::model::waypoint::Waypoint;
use eha_monitor::model::{Feedback, Form, Model, ValveForm};
use eha_monitor::parameter::{PARAMETERS, Parameters};

/// No dry and viscous friction anywhere.
fn frictionless() -> Rig {
    Rig::with(|p| (p.spool_friction, p.fdj, p.viscous_friction) = (0.0, 0.0, 0.0))
}

fn constant(value: f64, samples: usize) -> Vec<f64> {
    vec![value; samples]
}

fn ramp(rate: f64, samples: usize) -> Vec<f64> {
    (0..samples).map(|sample| rate * PERIOD * sample as f64).collect()
}

#[test]
fn flapper_follows_its_step_response() {
    let rig = Rig::with(|p| p.spool_friction = 400.0);
    let (omega, zeta, last) = (2513.0, 0.6_f64, 0.01 / 200.0);
    let root = (1.0 - zeta * zeta).sqrt();
    for (trace, tolerance) in [
        (rig.exact(&constant(1e-4, 10)), 1e-9),
        (rig.midpoint(&constant(1e-4, 10), 1e-6), 1e-5),
        (rig.midpoint(&constant(1e-4, 10), 1e-5), 1e-3),
    ] {
        for (sample, flapper) in trace.flapper.iter().enumerate() {
            let angle = omega * sample as f64 * PERIOD;
            let (sin, cos) = (root * angle).sin_cos();
            let expected = last * (1.0 - (-zeta * angle).exp() * (cos + zeta / root * sin));
            assert!((flapper - expected).abs() < tolerance * last, "{sample} ms: {flapper:e}, {expected:e}");
        }
    }
}

#[test]
fn saturated_spool_slews_at_19_4_mm_per_s() {
    for trace in
        [frictionless().exact(&constant(0.05, 20)), frictionless().midpoint(&constant(0.05, 20), 1e-5)]
    {
        assert_close((trace.spool[15] - trace.spool[10]) / 5e-3, 700.0 / 36_000.0, 1e-9);
        assert_close(trace.flapper[12], 1e-4, 1e-12);
    }
}

#[test]
fn no_load_rate_is_0_15_m_per_s() {
    let mut rig = frictionless();
    for (ratio, blend) in [(1.0, 0.0), (0.81, 0.0), (1.0, 1.0), (0.81, 1.0)] {
        // The supply enters once: the no-load rate goes with its root in either form.
        (rig.parameters.supply_ratio, rig.parameters.metering_blend) = (ratio, blend);
        let trace = rig.core(&constant(0.1, 400));
        assert_close(trace.spool[399], 0.6e-3, 1e-9);
        // The metering form's conductance passes a little of the flow against the leakage and viscous pressure only.
        assert_close((trace.ram[399] - trace.ram[300]) / 0.099, 0.15 * ratio.sqrt(), 1e-6);
    }
}

#[test]
fn stall_force_is_16_kn() {
    // The metering form stalls where the throttle passes what the conductance takes:
    // GQ XSM sqrt(1 - p) = (1/GPQ + Clk) PSR p, so p = 0.9005 of 16 kN.
    for (blend, below, above) in [(0.0, 15_950.0, 16_050.0), (1.0, 14_380.0, 14_430.0)] {
        let mut rig = frictionless();
        rig.parameters.metering_blend = blend;
        rig.parameters.step_load_time = 0.2;
        let motion = |load: f64| {
            let mut rig = rig;
            rig.parameters.step_load = load;
            let trace = rig.core(&constant(0.1, 260));
            (trace.ram[259] - trace.ram[258], trace.pressure[259])
        };
        assert!(motion(below).0 > 0.0);
        let (back, pressure) = motion(above);
        assert!(back < 0.0);
        if blend == 0.0 {
            assert_close(pressure, 2e7, 1e-12);
        }
    }
}

#[test]
fn small_signal_velocity_gain_is_156_per_s() {
    let trace = frictionless().exact(&ramp(0.01, 400));
    let error = ramp(0.01, 400)[399] - trace.ram[399];
    assert_close(0.01 / error, 1e4 * 0.01 / 160.0 * 0.2 / 8e-4, 1e-6);
}

#[test]
fn jack_breaks_away_at_static_friction_and_slides_on_dynamic() {
    for asymmetry in [0.0, 0.2, -0.3] {
        for direction in [1.0, -1.0] {
            let mut rig = Rig::with(|p| (p.spool_friction, p.friction_asymmetry) = (1e9, asymmetry));
            rig.parameters.leakage = 0.0;
            // A load that grows by 4 N a sample pushes the ram in `direction`.
            let load: Vec<f64> = (0..200).map(|sample| -direction * 4.0 * f64::from(sample)).collect();
            let mut stepper = Exact::<f64, BASE_ORDER, 32>::new();
            stepper.begin(PERIOD, true, true);
            let trace = simulate_begun(rig.form, &rig.parameters, &mut stepper, &constant(0.0, 200), &load);
            let at = (400.0 * (1.0 + asymmetry * direction) / 4.0 + 1e-9) as usize;
            assert!(trace.ram[..=at].iter().all(|ram| *ram == 0.0), "{asymmetry} {direction}");
            assert!(trace.ram[at + 2] * direction > 0.0, "{asymmetry} {direction}");
            // Sliding against the closed valve: v (CJ + AJ^2 GPQ) = load - FDJ (1 + a), quasi-steady on the ramp.
            let damping = 50.0 + 8e-4 * 8e-4 * 5e11;
            let drive = 4.0 * 199.0 - 200.0 * (1.0 + asymmetry * direction);
            let lag = 20.0 / damping * 4000.0;
            assert_close(trace.velocity[199] * direction, (drive - lag) / damping, 1e-6);
        }
    }
}

#[test]
fn play_keeps_its_width_and_its_rest() {
    let mut output = 0.0;
    for step in 0..400 {
        let input = 3.0 * (0.05 * f64::from(step)).sin();
        let before = output;
        output = play(input, output, 0.5);
        assert!((input - output).abs() <= 0.5 + 1e-15);
        assert!(output == before || ((input - output).abs() - 0.5).abs() < 1e-15, "moves only when pushed");
        assert_eq!(play(input, output, 0.5), output, "the same input moves nothing");
    }
    let trace = Rig::with(|p| p.bkl = 1e-3).exact(&command("sine", 400));
    let gap = trace.ram.iter().zip(&trace.user).map(|(ram, user)| (ram - user).abs()).fold(0.0, f64::max);
    assert_close(gap, 0.5e-3, 1e-9);
}

fn lvdt(change: impl FnOnce(&mut Parameters<f64>)) -> Lvdt<f64> {
    let mut parameters = Parameters::default();
    change(&mut parameters);
    Lvdt::new(&parameters, PERIOD)
}

/// What an LVDT shows of a signal: its values and slopes, at which the LVDT looks at every sample and once in between.
fn sampled(lvdt: &Lvdt<f64>, signal: impl Fn(f64) -> [f64; 2], samples: usize) -> Vec<f64> {
    let place = |sample: usize, share: f64| Waypoint {
        share,
        pushing: signal((sample as f64 + share) * PERIOD),
        behind: [0.0; 2],
    };
    let mut state = LvdtState::at_rest(signal(0.0)[0], place(0, 0.0));
    let shown = |sample: usize| {
        if let Some(last) = sample.checked_sub(1) {
            for share in [0.4, 1.0] {
                lvdt.watch(&mut state, &place(last, share), [signal((last as f64) * PERIOD)[0], 0.0]);
            }
        }
        lvdt.sample(&mut state, place(sample, 0.0).pushing[0])
    };
    (0..samples).map(shown).collect()
}

#[test]
fn lvdt_lags_delays_and_bends_as_its_closed_forms_say() {
    let omega = std::f64::consts::TAU * 5.0;
    let sine = |t: f64| [4e-3 * (omega * t).sin(), 4e-3 * omega * (omega * t).cos()];
    for tau in [2e-4, 1e-3, 5e-3, 0.05] {
        // Behind a ramp the lag's output is r (t - tau (1 - exp(-t/tau))).
        let seen = sampled(&lvdt(|p| p.sensor_lag = tau), |t| [0.03 * t, 0.03], 400);
        for (sample, value) in seen.iter().enumerate() {
            let t = sample as f64 * PERIOD;
            let expected = 0.03 * (t - tau * (1.0 - (-t / tau).exp()));
            assert!((value - expected).abs() < 1e-12, "{tau} s, {sample} ms: {value:e}, not {expected:e}");
        }
        // And behind a sine of 5 Hz its amplitude and phase, alone and delayed.
        for delay in [0.0, 3e-4, 6e-4, 2.4e-3] {
            let seen = sampled(&lvdt(|p| (p.sensor_lag, p.sensor_delay) = (tau, delay)), sine, 1000);
            for (sample, value) in seen.iter().enumerate().skip(700) {
                let angle = omega * (sample as f64 * PERIOD - delay) - (omega * tau).atan();
                let expected = 4e-3 / (1.0 + (omega * tau).powi(2)).sqrt() * angle.sin();
                assert!((value - expected).abs() < 2e-9, "{tau} s, {sample} ms: {:e}", value - expected);
            }
        }
    }
    for delay in [3e-4, 1e-3, 1.3e-3, 7.77e-3, 0.031] {
        let seen = sampled(&lvdt(|p| p.sensor_delay = delay), sine, 300);
        for (sample, value) in seen.iter().enumerate().skip(40) {
            let expected = sine(sample as f64 * PERIOD - delay)[0];
            assert!((value - expected).abs() < 1e-10, "{delay} s, {sample} ms: {:e}", value - expected);
        }
    }
    let line = |t: f64| [t, 1.0];
    let seen = sampled(&lvdt(|p| (p.sensor_gain, p.sensor_offset) = (0.01, 1e-4)), line, 50);
    assert!(seen.iter().enumerate().all(|(at, value)| (value - 1.01e-3 * at as f64 - 1e-4).abs() < 1e-15));
    let seen = sampled(&lvdt(|p| p.sensor_cubic = 100.0), line, 50);
    let cubic = |t: f64| t + 100.0 * t * t * t;
    assert!(seen.iter().enumerate().all(|(at, value)| (value - cubic(1e-3 * at as f64)).abs() < 1e-15));
}

#[test]
fn metering_pressure_satisfies_its_implicit_law() {
    for blend in [0.3, 1.0] {
        for ratio in [0.7, 1.0] {
            let p = Parameters { metering_blend: blend, ..Parameters::<f64>::default() };
            let fluid = Fluid::new(&p, ratio);
            let (ps, gq, gpq) = (2e7 * ratio, 0.2, 5e11 * ratio.sqrt());
            for opening in [-3e-4_f64, -1e-7, 0.0, 3e-5, 6e-4] {
                for free in [-0.15, -1e-3, 0.0, 0.05] {
                    for compliance in [0.0, 1e-10, 4e-9] {
                        let pressure = fluid.metering_pressure(opening, free, compliance);
                        assert!(pressure.abs() <= fluid.cavitation_limit());
                        if pressure.abs() >= fluid.cavitation_limit() * (1.0 - 1e-12) {
                            continue;
                        }
                        let sign = if opening < 0.0 { -1.0 } else { 1.0 };
                        let root = ((ps - sign * pressure) / 2e7).max(0.0).sqrt();
                        // The root holds the supply already: its flow gain is the rated one.
                        let flow = gq * opening * ((1.0 - blend) * ratio.sqrt() + blend * root);
                        let swept = 8e-4 * (free + compliance * pressure);
                        let residual = flow - (1.0 / gpq + 1e-13) * pressure - swept;
                        assert!(residual.abs() < 1e-15, "{blend} {ratio} {opening} {free}: {residual:e}");
                    }
                }
            }
        }
    }
}

#[test]
fn chamber_pressures_add_up_and_stop_at_vapour() {
    let fluid = Fluid::new(&Parameters::<f64>::default(), 1.0);
    for differential in [-1.5e7, 0.0, 4e6, 2e7] {
        let [a, b] = fluid.chamber_pressures(differential);
        assert_close(a + b, 2.2e7, 1e-12);
        assert!((a - b - differential).abs() < 1e-6);
    }
    let limit = fluid.cavitation_limit();
    assert_close(limit, 2e7 + 2.0 * (1e6 - 1e3), 1e-12);
    assert_close(fluid.chamber_pressures(limit)[1], 1e3, 1e-6);
    assert_eq!(fluid.chamber_pressures(1.1 * limit)[1], 1e3);
}

#[test]
fn ram_rests_at_its_stop_and_leaves_it() {
    let rig = Rig::with(|p| p.jack_stop = 2e-3);
    for trace in [rig.exact(&command("chirp", 900)), rig.midpoint(&command("chirp", 900), 1e-5)] {
        assert_eq!(trace.ram.iter().copied().fold(0.0, f64::max), 2e-3);
        assert!(trace.ram[899] < 1e-3);
    }
}

#[test]
fn first_order_valve_lags_and_slews() {
    let mut rig = Rig::of(ValveForm::FirstOrder, Feedback::Ram);
    rig.parameters.fdj = 1e5;
    // The ram is stuck, so the valve sees a constant current of 1 mA (a target of 62.5 um: below its rate limit).
    let trace = rig.exact(&constant(1e-4, 40));
    for (sample, spool) in trace.spool.iter().enumerate() {
        let expected = 0.01 / 160.0 * (1.0 - (-155.0 * PERIOD * sample as f64).exp());
        assert!((spool - expected).abs() < 1e-12, "{sample} ms: {spool:e}");
    }
    // 8 mA ask for 0.5 mm: at the rate limit until 155 (target - spool) falls to it.
    let trace = rig.exact(&constant(8e-4, 60));
    assert_close((trace.spool[15] - trace.spool[5]) / 10e-3, 19.4e-3, 1e-9);
    let left: f64 = 0.5e-3 - trace.spool[40];
    let at_limit: f64 = (0.5e-3 - 19.4e-3 / 155.0) / 19.4e-3;
    assert_close(left, 19.4e-3 / 155.0 * (-155.0 * (0.04 - at_limit)).exp(), 1e-4);
}

#[test]
fn mount_gives_way_by_load_over_stiffness_and_rings_at_its_frequency() {
    let rig = Rig::with(|p| {
        (p.spool_friction, p.constant_load, p.mount_compliance) = (400.0, 100.0, 1e-7);
        p.mount_lag = (1e-7_f64 * 5.0).sqrt();
    });
    for trace in [rig.exact(&constant(0.0, 200)), rig.midpoint(&constant(0.0, 200), 1e-5)] {
        assert_close(trace.ram[199], -1e-5, 1e-6);
    }
    // Load and base move as one while friction holds: the step response of 25 kg on 1e7 N/m.
    let trace = rig.exact(&constant(0.0, 20));
    let (mass, damping, stiffness) = (25.0, (1e7_f64 * 5.0).sqrt(), 1e7);
    let (decay, omega) =
        (damping / (2.0 * mass), (stiffness / mass - (damping / (2.0 * mass)).powi(2)).sqrt());
    for (sample, ram) in trace.ram.iter().enumerate() {
        let t = sample as f64 * PERIOD;
        let expected =
            -1e-5 * (1.0 - (-decay * t).exp() * ((omega * t).cos() + decay / omega * (omega * t).sin()));
        assert!((ram - expected).abs() < 1e-12, "{sample} ms: {ram:e}, {expected:e}");
    }
}

#[test]
fn midpoint_divides_a_sample_as_it_says() {
    let rig = Rig::default();
    let samples = command("ramp", 50);
    let mut stepper = Midpoint::new(1e-4);
    let trace = simulate(rig.form, &rig.parameters, &mut stepper, &samples);
    // Ten steps of 0.1 ms, each of which an event may cut into four.
    assert_eq!(stepper.units(), 40);
    assert_eq!(trace.ram.len(), 50);
}

#[test]
fn a_model_that_is_changed_is_the_model_that_would_be_made() {
    let form = Form::default();
    for row in PARAMETERS {
        let before = Parameters::<f64>::default();
        let mut after = before;
        after.set(row.parameter, row.lower + 0.3 * (row.upper - row.lower));
        let mut model = Model::new(form, &before);
        assert_ne!(format!("{model:?}"), format!("{:?}", Model::new(form, &after)), "{}", row.name);
        model.change(|parameters| *parameters = after);
        assert_eq!(format!("{model:?}"), format!("{:?}", Model::new(form, &after)), "{}", row.name);
    }
}
