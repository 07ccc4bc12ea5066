//! Runs the core and the independent reference plant on the same samples of a command.
#![allow(dead_code, reason = "every test binary compiles this module and uses its share of it")]

use eha_monitor::command::{Command, CommandInfo};
use eha_monitor::integrate::Stepper;
use eha_monitor::integrate::collocation::Collocation;
use eha_monitor::integrate::exact::{Exact, FINE};
use eha_monitor::integrate::midpoint::Midpoint;
use eha_monitor::model::state::{BASE_ORDER, FULL_ORDER, Input, InputSegment};
use eha_monitor::model::{Feedback, Form, Model, ValveForm};
use eha_monitor::parameter::Parameters;
use eha_monitor::scalar::Real;
use eha_monitor::simulate::Actuator;
use reference_plant::{DEFAULT_STEP, Effects, Mount, Plant, Valve};

/// Sample period of every test, s.
pub(crate) const PERIOD: f64 = 1e-3;

/// Structure and parameters that core and plant share.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Rig {
    pub(crate) form: Form,
    pub(crate) parameters: Parameters<f64>,
}

/// What a simulation shows at its samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Trace {
    pub(crate) user: Vec<f64>,
    pub(crate) ram: Vec<f64>,
    pub(crate) current: Vec<f64>,
    pub(crate) pressure: Vec<f64>,
    pub(crate) flapper: Vec<f64>,
    pub(crate) spool: Vec<f64>,
    pub(crate) velocity: Vec<f64>,
    /// Steps of the integrator; 0 for the plant.
    pub(crate) steps: u32,
}

/// Root mean square differences of two traces.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Distance {
    /// LVDT, um.
    pub(crate) user: f64,
    /// Ram, um.
    pub(crate) ram: f64,
    /// Current, mA.
    pub(crate) current: f64,
    /// Pressure, kPa.
    pub(crate) pressure: f64,
}

impl Rig {
    /// The source's parameters in a form.
    pub(crate) fn of(valve: ValveForm, feedback: Feedback) -> Self {
        Self { form: Form { valve, feedback, ..Form::default() }, ..Self::default() }
    }

    /// The source's parameters with a change.
    pub(crate) fn with(change: impl FnOnce(&mut Parameters<f64>)) -> Self {
        let mut rig = Self::default();
        change(&mut rig.parameters);
        rig
    }

    /// The core by its own stepper: exact where it is affine, else collocation.
    pub(crate) fn core(&self, command: &[f64]) -> Trace {
        if Model::new(self.form, &self.parameters).is_affine() {
            self.exact(command)
        } else {
            self.collocation(command)
        }
    }

    /// The core by collocation, with the tolerance of fits.
    pub(crate) fn collocation(&self, command: &[f64]) -> Trace {
        collocation(self.form, &self.parameters, 2e-9, command)
    }

    /// The core by exact steps of one sample.
    pub(crate) fn exact(&self, command: &[f64]) -> Trace {
        exact(self.form, &self.parameters, command)
    }

    /// The core by the midpoint rule.
    pub(crate) fn midpoint(&self, command: &[f64], step: f64) -> Trace {
        simulate(self.form, &self.parameters, &mut Midpoint::new(step), command)
    }

    /// The plant at its default step.
    pub(crate) fn plant(&self, command: &[f64]) -> Trace {
        self.plant_at(command, DEFAULT_STEP)
    }

    /// The plant at a step, s.
    pub(crate) fn plant_at(&self, command: &[f64], step: f64) -> Trace {
        let sampled = reference_plant::Command::Sampled(command.to_vec(), PERIOD);
        let record = plant(self).simulate(&sampled, command.len(), step);
        Trace {
            user: record.lvdt,
            ram: record.ram,
            current: record.current,
            pressure: record.pressure,
            flapper: record.flapper,
            spool: record.spool,
            velocity: Vec::new(),
            steps: 0,
        }
    }
}

/// The plant that a rig describes.
pub(crate) fn plant(rig: &Rig) -> Plant {
    let p = &rig.parameters;
    let parameters = reference_plant::Parameters {
        error_integral_limit: p.integral_limit,
        proportional_gain: p.proportional_gain,
        integral_gain: p.integral_gain,
        derivative_gain: p.derivative_gain,
        velocity_gain: p.velocity_gain,
        current_limit: p.current_limit,
        motor_hysteresis: p.torque_motor_hysteresis,
        motor_gain: p.torque_motor_gain,
        valve_offset: p.current_offset,
        flapper_stiffness: p.flapper_stiffness,
        feedback_stiffness: p.feedback_stiffness,
        flapper_frequency: p.flapper_frequency,
        flapper_damping: p.flapper_damping,
        flapper_stop: p.flapper_stop,
        feedback_play: p.feedback_play,
        first_stage_pressure_gain: p.first_stage_pressure_gain,
        first_stage_flow_gain: p.first_stage_flow_gain,
        filter_clogging: p.filter_clogging,
        spool_area: p.spool_area,
        spool_viscosity: p.spool_viscosity,
        spool_friction: p.spool_friction,
        spool_friction_ratio: p.spool_friction_ratio,
        spool_sticks_below_breakaway: p.spool_rest_ratio >= p.spool_friction_ratio,
        spool_stop: p.spool_stop,
        supply_pressure: p.supply_pressure * p.supply_ratio,
        nominal_supply_pressure: p.supply_pressure,
        return_pressure: p.return_pressure,
        vapour_pressure: p.vapour_pressure,
        leakage: p.leakage,
        pressure_gain: p.pressure_gain,
        flow_gain: p.flow_gain,
        jack_area: p.jack_area,
        jack_viscosity: p.viscous_friction,
        jack_mass: p.load_mass,
        jack_stop: p.jack_stop,
        jack_friction: p.fdj,
        jack_friction_ratio: p.breakaway_ratio,
        backlash: p.bkl,
        load_stiffness: p.spring_load,
        feedback: match rig.form.feedback {
            Feedback::Ram => reference_plant::Feedback::Ram,
            Feedback::User => reference_plant::Feedback::User,
        },
        valve: match rig.form.valve {
            ValveForm::TwoStage => Valve::SecondOrderFlapper,
            ValveForm::StaticFlapper => Valve::StaticFlapper,
            ValveForm::FirstOrder => {
                Valve::FirstOrder { bandwidth: p.valve_bandwidth, rate_limit: p.valve_rate_limit }
            }
        },
    };
    let effects = Effects {
        spool_overlap: p.spool_overlap,
        flow_asymmetry: p.flow_asymmetry,
        turbulent_metering: p.metering_blend,
        supply_sag: p.supply_sag,
        supply_sag_lag: p.supply_sag_lag,
        bulk_modulus: (p.oil_compliance > 0.0).then(|| 1.0 / p.oil_compliance),
        stribeck_velocity: p.stribeck_velocity,
        friction_asymmetry: p.friction_asymmetry,
        quadratic_drag: p.quadratic_drag,
        retraction_viscosity: p.retraction_viscosity,
        thinning_viscosity: p.thinning_viscosity,
        thinning_velocity: p.thinning_velocity,
        detent_force: p.cogging_cosine.hypot(p.cogging_sine),
        detent_pitch: p.cogging_pitch,
        detent_phase: p.cogging_cosine.atan2(p.cogging_sine),
        constant_load: p.constant_load,
        step_load: p.step_load,
        step_load_time: p.step_load_time,
        mount: (p.mount_compliance > 0.0).then(|| {
            let stiffness = 1.0 / p.mount_compliance;
            Mount {
                stiffness,
                damping: p.mount_lag * stiffness,
                mass: p.base_mass,
                in_loop: p.loop_sees_base == 1.0,
                load_follows: p.load_follows_base == 1.0,
                play_over_ground: p.play_sees_base == 1.0,
            }
        }),
        sensor_offset: p.sensor_offset,
        sensor_gain: p.sensor_gain,
        sensor_lag: p.sensor_lag,
        sensor_delay: p.sensor_delay,
        sensor_cubic: p.sensor_cubic,
        ..Effects::default()
    };
    Plant { parameters, effects, ..Plant::default() }
}

/// The core by exact steps, with the number of states that it needs.
pub(crate) fn exact<T: Real + Into<f64>>(form: Form, parameters: &Parameters<T>, command: &[f64]) -> Trace {
    if Model::new(form, parameters).order() == BASE_ORDER {
        simulate(form, parameters, &mut Exact::<T, BASE_ORDER, 32>::new(), command)
    } else {
        simulate(form, parameters, &mut Exact::<T, FULL_ORDER, 32, FINE>::new(), command)
    }
}

/// The core by collocation, with the number of states that it needs.
pub(crate) fn collocation<T: Real + Into<f64>>(
    form: Form,
    parameters: &Parameters<T>,
    tolerance: f64,
    command: &[f64],
) -> Trace {
    let tolerance = T::literal(tolerance);
    if Model::new(form, parameters).order() == BASE_ORDER {
        simulate(form, parameters, &mut Collocation::<T, BASE_ORDER, 32>::new(tolerance), command)
    } else {
        simulate(form, parameters, &mut Collocation::<T, FULL_ORDER, 16>::new(tolerance), command)
    }
}

/// The core by any stepper, from rest at zero.
pub(crate) fn simulate<T: Real + Into<f64>, S: Stepper<T>>(
    form: Form,
    parameters: &Parameters<T>,
    stepper: &mut S,
    command: &[f64],
) -> Trace {
    stepper.begin(T::literal(PERIOD), false, true);
    simulate_begun(form, parameters, stepper, command, &[])
}

/// The same by a stepper that has begun already, with a load on the ram, N (empty: none).
pub(crate) fn simulate_begun<T: Real + Into<f64>, S: Stepper<T>>(
    form: Form,
    parameters: &Parameters<T>,
    stepper: &mut S,
    command: &[f64],
    load: &[f64],
) -> Trace {
    let actuator = Actuator::new(Model::new(form, parameters), T::literal(PERIOD));
    let command: Vec<T> = command.iter().map(|&value| T::literal(value)).collect();
    let force = |sample: usize| load.get(sample).map_or(T::ZERO, |&value| T::literal(-value));
    let first = Input { command: command[0], command_rate: T::ZERO, force: force(0) };
    let mut motion = actuator.at_rest(T::ZERO, &first);
    let mut trace = Trace::default();
    let mut input = first;
    for sample in 0..command.len() {
        if sample > 0 {
            let segment = InputSegment::between(
                [command[sample - 1], command[sample]],
                [force(sample - 1), force(sample)],
                T::literal(PERIOD) * T::from_count(sample as u32 - 1),
                T::ONE / T::literal(PERIOD),
            );
            actuator.advance(stepper, &mut motion, &segment);
            input = Input { command: command[sample], force: force(sample), ..segment.start };
        }
        let outputs = actuator.measure(&mut motion, &input);
        trace.user.push(outputs.user.into());
        trace.ram.push(outputs.ram.into());
        trace.current.push(outputs.current.into());
        trace.pressure.push(outputs.pressure.into());
        trace.flapper.push(motion.run.state.flapper.into());
        trace.spool.push(motion.run.state.spool.into());
        trace.velocity.push(motion.run.state.ram_velocity.into());
    }
    trace.steps = motion.run.steps;
    trace
}

/// A command of the table by name, as a 1 ms recorder knows it.
pub(crate) fn command(name: &str, samples: usize) -> Vec<f64> {
    let command = Command::<f64>::new(CommandInfo::named(name).expect("a command of the table"));
    (0..samples).map(|sample| command.at(sample as f64 * PERIOD)).collect()
}

impl Trace {
    /// How far another trace is.
    pub(crate) fn distance(&self, other: &Self) -> Distance {
        Distance {
            user: 1e6 * rms(&self.user, &other.user),
            ram: 1e6 * rms(&self.ram, &other.ram),
            current: rms(&self.current, &other.current),
            pressure: 1e-3 * rms(&self.pressure, &other.pressure),
        }
    }
}

impl Distance {
    /// Is every channel within a limit?
    pub(crate) fn within(&self, limit: &Self) -> bool {
        self.user <= limit.user
            && self.ram <= limit.ram
            && self.current <= limit.current
            && self.pressure <= limit.pressure
    }

    /// The larger distance in each channel.
    pub(crate) fn worst(&self, other: &Self) -> Self {
        Self {
            user: self.user.max(other.user),
            ram: self.ram.max(other.ram),
            current: self.current.max(other.current),
            pressure: self.pressure.max(other.pressure),
        }
    }
}

impl std::fmt::Display for Distance {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { user, ram, current, pressure } = self;
        write!(
            f,
            "user {user:9.5} um  ram {ram:9.5} um  current {current:9.6} mA  pressure {pressure:9.4} kPa"
        )
    }
}

/// Root mean square difference.
pub(crate) fn rms(a: &[f64], b: &[f64]) -> f64 {
    reference_plant::rms_difference(a, b)
}

/// Fails unless a value is within a relative distance of what is expected.
pub(crate) fn assert_close(value: f64, expected: f64, relative: f64) {
    assert!((value - expected).abs() <= relative * expected.abs(), "{value:e} is not {expected:e}");
}
