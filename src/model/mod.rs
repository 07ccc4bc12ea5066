//! The actuator: blocks of the loop, one file each, composed here.
//!
//! ```text
//! command --> controller --> torque motor, flapper, first stage --> spool --> fluid --> jack --> x --> play --> LVDT
//!                 ^                    valve.rs                     valve.rs  fluid.rs  jack.rs  |     play.rs  sensor.rs
//!                 +------------------------------- x_fb -------------------------------------------+
//! ```
//!
//! Every law is piecewise affine or smooth. A [`Mode`] names the active piece of each; inside a mode the model is a
//! smooth ordinary differential equation, and the functions in `events.rs` tell when the mode ends and what follows.
//! One set of equations serves the high-fidelity (HF) and the low-fidelity (LF) model: they differ in [`Form`] and in
//! parameters only.

pub mod controller;
pub mod corridor;
pub(crate) mod curved;
pub mod drive;
mod events;
pub mod fluid;
pub mod jack;
mod midpoint;
pub mod play;
pub mod sensor;
pub mod state;
pub mod valve;
pub mod waypoint;

use crate::parameter::{Parameter, Parameters, Reach};
use crate::scalar::Real;
use controller::{Controller, Seen};
use curved::Curved;
use events::Scales;
pub use events::{EXTRA_GUARDS, LOOP_GUARDS};
use fluid::Fluid;
use jack::Jack;
use play::in_contact;
use state::{BASE_ORDER, Input, Layout, Mode, State, side};
use valve::{PilotStage, Spool};

/// The servo valve's level of detail.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ValveForm {
    /// Flapper with mass, then spool: section 2 of the design.
    #[default]
    TwoStage,
    /// Flapper without mass and damping, then spool.
    StaticFlapper,
    /// The whole valve as one lag with a rate limit, as the source's conclusion proposes.
    FirstOrder,
}

/// Which position the controller sees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Feedback {
    /// The ram, before the backlash.
    #[default]
    Ram,
    /// The user, behind the backlash.
    User,
}

/// What moves the jack.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Drive {
    /// Controller, valve and fluid.
    #[default]
    Valve,
    /// A force that is an input (`drive_N`); the command is not used.
    Force,
}

/// The structure of a model: what its parameters cannot express.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Form {
    /// Detail of the valve.
    pub valve: ValveForm,
    /// Position that is fed back.
    pub feedback: Feedback,
    /// What moves the jack.
    pub drive: Drive,
}

/// An actuator with its parameters, ready to be integrated.
#[derive(Clone, Copy, Debug)]
pub struct Model<T> {
    /// Its structure.
    pub form: Form,
    parameters: Parameters<T>,
    /// Asked at every step, so found out once.
    has_extra_guards: bool,
    guards_see_command_rate: bool,
    /// The plain loop: the ram fed back in proportion, linear incompressible fluid, a spool whose opening is its position.
    is_plain: bool,
    /// Entries of the state behind the base model that move: a bit for each.
    moving: u8,
    scales: Scales<T>,
    /// Controller.
    pub controller: Controller<T>,
    /// Torque motor, flapper and first stage.
    pub pilot: PilotStage<T>,
    /// Spool.
    pub spool: Spool<T>,
    /// Second stage and chambers.
    pub fluid: Fluid<T>,
    /// Jack.
    pub jack: Jack<T>,
}

impl<T: Real> Model<T> {
    /// A model of a form with parameters.
    pub fn new(form: Form, parameters: &Parameters<T>) -> Self {
        let (controller, pilot) = (Controller::new(parameters), PilotStage::new(parameters));
        let spool = Spool::new(parameters);
        let fluid = Fluid::new(parameters, parameters.supply_ratio);
        let mut model = Self {
            form,
            parameters: *parameters,
            has_extra_guards: false,
            guards_see_command_rate: false,
            is_plain: false,
            moving: 0,
            scales: Scales::of(form, &controller, &pilot, &spool, &fluid),
            controller,
            pilot,
            spool,
            fluid,
            jack: Jack::new(parameters),
        };
        model.find_out();
        model
    }

    /// Changes parameters in place: the same as a new model with them, without moving it about in memory.
    pub fn change(&mut self, change: impl FnOnce(&mut Parameters<T>)) {
        change(&mut self.parameters);
        let parameters = &self.parameters;
        self.controller = Controller::new(parameters);
        self.pilot = PilotStage::new(parameters);
        self.spool = Spool::new(parameters);
        self.fluid = Fluid::new(parameters, parameters.supply_ratio);
        self.jack = Jack::new(parameters);
        self.scales = Scales::of(self.form, &self.controller, &self.pilot, &self.spool, &self.fluid);
        self.find_out();
    }

    /// Finds out what follows from form and parameters, and is asked at every step.
    fn find_out(&mut self) {
        let is_mounted = self.jack.is_mounted();
        let moves = [
            !self.controller.is_proportional(),
            self.pilot.hysteresis != T::ZERO,
            self.pilot.feedback_play != T::ZERO,
            self.form.feedback == Feedback::User,
            self.fluid.is_compressible(),
            self.parameters.supply_sag != T::ZERO,
            is_mounted,
            is_mounted,
        ];
        self.moving = moves.into_iter().rev().fold(0, |moving, moves| moving << 1 | u8::from(moves));
        self.guards_see_command_rate = self.pilot.hysteresis != T::ZERO || self.controller.sees_rates();
        self.is_plain = self.order() == BASE_ORDER
            && self.form.drive == Drive::Valve
            && self.controller.sees_position_only()
            && self.fluid.is_linear()
            && !self.spool.has_sides();
        self.has_extra_guards =
            self.order() > BASE_ORDER || self.spool.has_sides() || self.jack.has_step_load();
    }

    /// Where a parameter acts in this form: the backlash is inside the loop where the user position is fed back.
    pub fn reach(form: Form, parameter: Parameter) -> Reach {
        match (parameter, form.feedback) {
            (Parameter::Backlash, Feedback::User) => Reach::Constant,
            _ => parameter.reach(),
        }
    }

    /// The parameters that it was made of.
    pub const fn parameters(&self) -> &Parameters<T> {
        &self.parameters
    }

    /// Is every law piecewise affine, so that transition matrices are exact?
    pub fn is_affine(&self) -> bool {
        self.fluid.is_linear() && self.jack.is_affine() && self.parameters.supply_sag == T::ZERO
    }

    /// Do transition matrices depend on directions, as those of a supply that sags with the speed of the ram, of a spool
    /// that opens more on one side, and of a jack that is damped more in one direction, do?
    pub fn has_directed_matrices(&self) -> bool {
        self.parameters.supply_sag != T::ZERO || self.spool.asymmetry != T::ZERO || self.jack.has_sides()
    }

    /// Number of entries of the state that this model moves.
    pub const fn order(&self) -> usize {
        BASE_ORDER + self.moving.count_ones() as usize
    }

    /// How an integrator carries the state of this model.
    pub fn layout(&self) -> Layout {
        Layout::of(self.moving)
    }

    /// Has the model guards beyond those of the plain loop (plays, overlap, integral limit, step load, mount)?
    #[inline(always)]
    pub const fn has_extra_guards(&self) -> bool {
        self.has_extra_guards
    }

    /// Do guards jump with the rate of the command?
    #[inline(always)]
    pub const fn guards_see_command_rate(&self) -> bool {
        self.guards_see_command_rate
    }

    /// The state of rest with the ram at a position, valve centred, every play in the middle of its gap.
    pub fn at_rest(&self, ram: T) -> State<T> {
        State { ram, ..State::default() }
    }

    /// The mode of the state of rest.
    pub fn mode_at_rest(&self) -> Mode {
        Mode {
            // The first-order valve has no friction: its spool is always free.
            spool: i8::from(self.form.valve == ValveForm::FirstOrder),
            // A play of no width is always in contact, so that its matrices are those of a play in contact.
            overlap: i8::from(self.spool.overlap == T::ZERO),
            hysteresis: i8::from(self.pilot.hysteresis == T::ZERO),
            feedback_play: i8::from(self.pilot.feedback_play == T::ZERO),
            user_play: i8::from(self.form.feedback == Feedback::User && self.parameters.bkl == T::ZERO),
            play_input: i8::from(self.jack.is_mounted()),
            ..Mode::default()
        }
    }

    /// Position that pushes the backlash, m.
    #[inline(always)]
    pub fn play_input(&self, z: &State<T>) -> T {
        z.ram + self.parameters.play_sees_base * z.base
    }

    /// Its velocity, m/s.
    #[inline(always)]
    pub(crate) fn play_input_velocity(&self, z: &State<T>) -> T {
        z.ram_velocity + self.parameters.play_sees_base * z.base_velocity
    }

    /// What of the base's motion is added behind the backlash, m.
    #[inline(always)]
    pub fn behind_play(&self, z: &State<T>) -> T {
        (T::ONE - self.parameters.play_sees_base) * z.base
    }

    /// Its velocity, m/s.
    #[inline(always)]
    pub(crate) fn behind_play_velocity(&self, z: &State<T>) -> T {
        (T::ONE - self.parameters.play_sees_base) * z.base_velocity
    }

    /// Position that the controller sees, m: that of the user is over ground, of that of the ram the rig says how much it is.
    #[inline(always)]
    fn fed_back(&self, z: &State<T>) -> T {
        match self.form.feedback {
            Feedback::Ram => (z.ram + self.parameters.loop_sees_base * z.base) + z.ram_rest,
            Feedback::User => (z.ground() + z.user_gap) + z.ram_rest,
        }
    }

    /// The velocities (or accelerations) that the controller sees, from those of the ram in its cylinder and of the base.
    #[inline(never)]
    fn seen_rates(&self, mode: &Mode, ram_rate: T, base_rate: T) -> Seen<T> {
        let ram = ram_rate + self.parameters.loop_sees_base * base_rate;
        let fed_back = match self.form.feedback {
            Feedback::Ram => ram,
            Feedback::User if mode.user_play == 0 => (T::ONE - self.parameters.play_sees_base) * base_rate,
            Feedback::User => ram_rate + base_rate,
        };
        Seen { fed_back, ram }
    }

    /// Current before its limit, mA.
    #[inline(always)]
    pub fn demand(&self, mode: &Mode, z: &State<T>, input: &Input<T>) -> T {
        if self.is_plain {
            return self.controller.proportional_demand((input.command - z.ram) - z.ram_rest);
        }
        let velocity = self.seen_rates(mode, z.ram_velocity, z.base_velocity);
        self.controller.demand(input, self.fed_back(z), &velocity, z.integral)
    }

    /// Current behind the torque motor's hysteresis, mA.
    #[inline(always)]
    fn motor_current(&self, mode: &Mode, z: &State<T>, current: T, one: T) -> T {
        if self.pilot.hysteresis == T::ZERO {
            current
        } else if mode.hysteresis == 0 {
            z.held_current
        } else {
            in_contact(current, side(mode.hysteresis), self.pilot.hysteresis * one)
        }
    }

    /// Its rate, mA/s, at the accelerations of the ram in its cylinder and of the base, m/s2.
    #[inline(always)]
    fn held_current_rate(&self, mode: &Mode, z: &State<T>, input: &Input<T>, [ram, base]: [T; 2]) -> T {
        if mode.hysteresis == 0 || mode.current != 0 {
            return T::ZERO;
        }
        let velocity = self.seen_rates(mode, z.ram_velocity, z.base_velocity);
        let acceleration = self.seen_rates(mode, ram, base);
        self.controller.demand_rate(input, self.fed_back(z), &velocity, &acceleration)
    }

    /// Spool position that the feedback spring feels, m.
    #[inline(always)]
    fn sensed_spool(&self, mode: &Mode, z: &State<T>, one: T) -> T {
        if self.pilot.feedback_play == T::ZERO {
            z.spool
        } else if mode.feedback_play == 0 {
            z.sensed_spool
        } else {
            in_contact(z.spool, side(mode.feedback_play), self.pilot.feedback_play * one)
        }
    }

    /// Flapper position, m: its state, or its balance where it has none.
    #[inline(always)]
    fn flapper_position(&self, mode: &Mode, z: &State<T>, motor_force: T, sensed: T, one: T) -> T {
        if self.form.valve.has_flapper_state() {
            z.flapper
        } else if mode.flapper == 0 {
            self.pilot.balanced_position(motor_force, sensed)
        } else {
            side::<T>(mode.flapper) * self.pilot.stop * one
        }
    }

    /// First-stage pressure, Pa, in a mode of its limit.
    #[inline(always)]
    fn first_stage_pressure(&self, mode: &Mode, z: &State<T>, flapper: T, one: T) -> T {
        if mode.first_stage == 0 {
            self.pilot.pressure_gain * flapper
        } else {
            // The supply follows its sag in proportion, which is affine.
            side::<T>(mode.first_stage) * self.fluid.supply * (one + z.sag)
        }
    }

    /// Spool velocity, m/s.
    #[inline(always)]
    fn spool_velocity(&self, mode: &Mode, z: &State<T>, motor_force: T, flapper: T, one: T) -> T {
        if !mode.spool_slides() {
            return T::ZERO;
        }
        if self.form.valve == ValveForm::FirstOrder {
            return if mode.flapper == 0 {
                self.spool.bandwidth * (self.pilot.balanced_spool(motor_force) - z.spool)
            } else {
                side::<T>(mode.flapper) * self.spool.rate_limit * one
            };
        }
        self.spool.velocity(self.first_stage_pressure(mode, z, flapper, one), side(mode.spool), one)
    }

    /// Differential pressure of the linear form, Pa, of a fluid.
    #[inline(always)]
    fn linear_pressure(&self, fluid: &Fluid<T>, mode: &Mode, z: &State<T>, one: T) -> T {
        if self.form.drive == Drive::Force {
            T::ZERO
        } else if self.fluid.is_compressible() {
            z.pressure
        } else {
            let opening = self.spool.opening(z.spool, side(mode.overlap), one);
            fluid.limited_pressure(mode.pressure, opening, z.ram_velocity, one)
        }
    }

    /// Rate of change of the state in a mode.
    pub fn rate(&self, mode: &Mode, z: &State<T>, input: &Input<T>) -> State<T> {
        let curved =
            if self.is_affine() { Curved::default() } else { self.curved(mode, z).map(|term| term.value) };
        self.rate_with(mode, z, input, T::ONE, &curved)
    }

    /// Rate of change of the state in a mode, for the affine laws: those of linear fluid at its nominal supply.
    ///
    /// It is linear in `(z, input, one)`: `one` is 1 for the rate itself, and every constant term is multiplied by it.
    /// So the columns of the system matrix are the rates of unit vectors with `one = 0`, and the constant term is the
    /// rate of zero with `one = 1`: the matrices are derived from the equations, never written twice.
    pub fn affine_rate(&self, mode: &Mode, z: &State<T>, input: &Input<T>, one: T) -> State<T> {
        self.rate_with(mode, z, input, one, &Curved::default())
    }

    /// The affine rate with what the laws that are not affine add; linear in that too.
    pub(crate) fn rate_with(
        &self,
        mode: &Mode,
        z: &State<T>,
        input: &Input<T>,
        one: T,
        curved: &Curved<T>,
    ) -> State<T> {
        let pressure = self.linear_pressure(&self.fluid, mode, z, one);
        let direction = side(mode.jack);
        let (velocity, acceleration) = if mode.jack_slides() {
            let drive = self.jack.drive(pressure, z, input.force, mode.step_load != 0, one) + curved.force;
            (z.ram_velocity, self.jack.affine_acceleration(drive, z.ram_velocity, direction, one))
        } else {
            (T::ZERO, T::ZERO)
        };
        let mut rate = State { ram: velocity, ram_velocity: acceleration, ..State::default() };
        if self.jack.is_mounted() {
            rate.base = z.base_velocity;
            rate.base_velocity =
                self.jack.base_acceleration(z, input.force, mode.step_load != 0, acceleration, one);
        }
        if self.form.drive == Drive::Force {
            return rate;
        }
        let current = self.controller.current(mode.current, self.demand(mode, z, input), one);
        let motor_current = self.motor_current(mode, z, current, one);
        let motor_force = self.pilot.torque_motor_force(motor_current, one);
        let sensed = self.sensed_spool(mode, z, one);
        let flapper = self.flapper_position(mode, z, motor_force, sensed, one);
        rate.spool = self.spool_velocity(mode, z, motor_force, flapper, one);
        if self.form.valve.has_flapper_state() && mode.flapper == 0 {
            rate.flapper = z.flapper_velocity;
            let force = self.pilot.static_force(motor_force, sensed, z.flapper);
            rate.flapper_velocity = self.pilot.acceleration(force, z.flapper_velocity);
        }
        if self.is_plain {
            return rate;
        }
        if mode.integral == 0 {
            rate.integral = input.command - self.fed_back(z);
        }
        rate.held_current = self.held_current_rate(mode, z, input, [acceleration, rate.base_velocity]);
        if mode.feedback_play != 0 {
            rate.sensed_spool = rate.spool;
        }
        if mode.user_play == 0 && self.form.feedback == Feedback::User {
            rate.user_gap = -(velocity + self.parameters.play_sees_base * rate.base);
        }
        if self.fluid.is_compressible() && mode.pressure == 0 {
            let opening = self.spool.opening(z.spool, side(mode.overlap), one);
            rate.pressure =
                self.fluid.linear_pressure_rate(opening, velocity, z.pressure) + curved.pressure_rate;
        }
        if self.parameters.supply_sag != T::ZERO {
            rate.sag = self.sag_rate(direction * velocity, z.sag);
        }
        rate
    }
}
