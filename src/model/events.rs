//! When a mode ends and what follows it.
//!
//! A *guard* is a function of the state that is not negative while its piece of the model is the valid one. An
//! integrator looks at the guards before and after a step; where one turns negative it goes to the crossing and calls
//! [`Model::switch`]. Guards of limits are relative to the limit, so one tolerance serves all.

use super::controller::Controller;
use super::fluid::Fluid;
use super::play::in_contact;
use super::state::{Input, Mode, State, side};
use super::valve::{PilotStage, Spool};
use super::{Drive, Form, Model, ValveForm};
use crate::scalar::Real;

/// Number of guards of the plain loop.
pub const LOOP_GUARDS: usize = 8;
/// Number of guards of plays, dead zone, integral limit, step load and mount.
pub const EXTRA_GUARDS: usize = 7;

const CURRENT: usize = 0;
const FLAPPER: usize = 1;
const FIRST_STAGE: usize = 2;
const PRESSURE: usize = 3;
const SPOOL: usize = 4;
const SPOOL_STOP: usize = 5;
const JACK: usize = 6;
const JACK_STOP: usize = 7;
const OVERLAP: usize = 8;
const INTEGRAL: usize = 9;
const HYSTERESIS: usize = 10;
const FEEDBACK_PLAY: usize = 11;
const USER_PLAY: usize = 12;
const STEP_LOAD: usize = 13;
/// Nothing changes but the direction: what lies behind the ram sees the turning point.
const PLAY_INPUT: usize = 14;

/// How far a limit may be passed by rounding, relative to the limit.
const LIMIT_TOLERANCE: f64 = 1e-5;
/// Force on the spool that rounding may make up, N; it moves the spool by less than 0.3 nm a second.
pub(super) const SPOOL_FORCE_TOLERANCE: f64 = 1e-5;

fn sign_of<T: Real>(value: T) -> i8 {
    if value < T::ZERO { -1 } else { 1 }
}

/// A limit on the magnitude of `value`: inside in mode 0, outside on the mode's side otherwise.
#[inline(always)]
fn limit_guard<T: Real>(mode: i8, value: T, limit: T, scale: T) -> T {
    let over = if mode == 0 { limit - value.magnitude() } else { side::<T>(mode) * value - limit };
    over * scale
}

/// 1 over the limits that are looked at in every step: a division there would be the slowest part of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scales<T> {
    current: T,
    /// Of the flapper's stop, or of the rate limit of the first-order valve.
    flapper: T,
    supply: T,
}

impl<T: Real> Scales<T> {
    /// The scales of a model's limits.
    pub(super) fn of(
        form: Form,
        controller: &Controller<T>,
        pilot: &PilotStage<T>,
        spool: &Spool<T>,
        fluid: &Fluid<T>,
    ) -> Self {
        let flapper = if form.valve == ValveForm::FirstOrder { spool.rate_limit } else { pilot.stop };
        Self {
            current: T::ONE / controller.current_limit,
            flapper: T::ONE / flapper,
            supply: T::ONE / fluid.supply,
        }
    }
}

impl<T: Real> Model<T> {
    /// Flapper position and torque-motor force in a mode. Not inlined: six places would hold it, none of them in the
    /// usual case.
    #[inline(never)]
    fn flapper_now(&self, mode: &Mode, z: &State<T>, input: &Input<T>) -> (T, T, T) {
        let current = self.controller.current(mode.current, self.demand(mode, z, input), T::ONE);
        let force = self.pilot.torque_motor_force(self.motor_current(mode, z, current, T::ONE), T::ONE);
        let sensed = self.sensed_spool(mode, z, T::ONE);
        (self.flapper_position(mode, z, force, sensed, T::ONE), force, sensed)
    }

    /// Differential pressure, Pa, of whichever fluid form is in use.
    #[inline(always)]
    pub fn pressure(&self, mode: &Mode, z: &State<T>) -> T {
        if self.is_plain {
            return self.fluid.limited_pressure(mode.pressure, z.spool, z.ram_velocity, T::ONE);
        }
        if self.fluid.is_linear() || self.fluid.is_compressible() || self.form.drive == Drive::Force {
            self.linear_pressure(&self.fluid_now(z), mode, z, T::ONE)
        } else {
            let opening = self.spool.opening(z.spool, side(mode.overlap), T::ONE);
            self.fluid_now(z).metering_pressure(opening, z.ram_velocity, T::ZERO)
        }
    }

    /// Force on the resting ram other than friction, N.
    #[inline(never)]
    fn drive_at_rest(&self, mode: &Mode, z: &State<T>, input: &Input<T>) -> T {
        let pressure = self.pressure(mode, &State { ram_velocity: T::ZERO, ..*z });
        self.jack.drive(pressure, z, input.force, mode.step_load != 0, T::ONE) + self.jack.cogging(z.ram)
    }

    /// The guards of the plain loop.
    #[inline(always)]
    pub fn loop_guards(&self, mode: &Mode, z: &State<T>, input: &Input<T>) -> [T; LOOP_GUARDS] {
        let mut guards = [T::ONE; LOOP_GUARDS];
        if mode.jack_slides() {
            let direction = side::<T>(mode.jack);
            guards[JACK] = direction * z.ram_velocity;
            guards[JACK_STOP] = self.jack.stop - direction * z.ram;
        } else {
            let drive = self.drive_at_rest(mode, z, input);
            guards[JACK] = if mode.jack == 0 {
                self.jack.breakaway(side(sign_of(drive))) - drive.magnitude()
            } else {
                self.jack.breakaway(-side::<T>(mode.jack)) + side::<T>(mode.jack) * drive
            };
        }
        if self.form.drive == Drive::Force {
            return guards;
        }
        guards[CURRENT] = limit_guard(
            mode.current,
            self.demand(mode, z, input),
            self.controller.current_limit,
            self.scales.current,
        );
        if self.form.valve == ValveForm::FirstOrder {
            let (_, force, _) = self.flapper_now(mode, z, input);
            let rate = self.spool.bandwidth * (self.pilot.balanced_spool(force) - z.spool);
            guards[FLAPPER] = limit_guard(mode.flapper, rate, self.spool.rate_limit, self.scales.flapper);
            if mode.spool_slides() {
                guards[SPOOL_STOP] = self.spool.stop - z.spool.magnitude();
            } else {
                guards[SPOOL] = side::<T>(mode.spool) * rate;
            }
        } else {
            let flapper = self.flapper_guards(mode, z, input, &mut guards);
            guards[FIRST_STAGE] = limit_guard(
                mode.first_stage,
                self.pilot.pressure_gain * flapper,
                self.fluid_now(z).supply,
                self.scales.supply,
            );
            let spool_force = self.spool.area * self.first_stage_pressure(mode, z, flapper, T::ONE);
            match mode.spool {
                0 => guards[SPOOL] = self.spool.breakaway - spool_force.magnitude(),
                -1 | 1 => {
                    guards[SPOOL] = side::<T>(mode.spool) * spool_force - self.spool.rest;
                    guards[SPOOL_STOP] = self.spool.stop - side::<T>(mode.spool) * z.spool;
                }
                _ => guards[SPOOL] = self.spool.breakaway + side::<T>(mode.spool) * spool_force,
            }
        }
        guards[PRESSURE] = self.pressure_guard(mode, z);
        guards
    }

    /// Fills the guard of the flapper's stop; returns the flapper's position.
    #[inline(always)]
    fn flapper_guards(
        &self,
        mode: &Mode,
        z: &State<T>,
        input: &Input<T>,
        guards: &mut [T; LOOP_GUARDS],
    ) -> T {
        if self.form.valve.has_flapper_state() {
            guards[FLAPPER] = if mode.flapper == 0 {
                limit_guard(0, z.flapper, self.pilot.stop, self.scales.flapper)
            } else {
                let (_, force, sensed) = self.flapper_now(mode, z, input);
                side::<T>(mode.flapper) * self.pilot.static_force(force, sensed, z.flapper)
            };
            z.flapper
        } else {
            let (flapper, force, sensed) = self.flapper_now(mode, z, input);
            let balance = self.pilot.balanced_position(force, sensed);
            guards[FLAPPER] = limit_guard(mode.flapper, balance, self.pilot.stop, self.scales.flapper);
            flapper
        }
    }

    #[inline(never)]
    fn pressure_guard(&self, mode: &Mode, z: &State<T>) -> T {
        if self.is_plain {
            let pressure = self.fluid.linear_pressure(z.spool, z.ram_velocity);
            return limit_guard(mode.pressure, pressure, self.fluid.supply, self.scales.supply);
        }
        let opening = self.spool.opening(z.spool, side(mode.overlap), T::ONE);
        let fluid = self.fluid_now(z);
        if self.fluid.is_compressible() {
            let limit = if self.fluid.is_linear() { fluid.supply } else { fluid.cavitation_limit() };
            if mode.pressure == 0 {
                limit_guard(0, z.pressure, limit, self.scales.supply)
            } else {
                side::<T>(mode.pressure) * fluid.pressure_rate(opening, z.ram_velocity, z.pressure)
            }
        } else if self.fluid.is_linear() {
            let pressure = fluid.linear_pressure(opening, z.ram_velocity);
            limit_guard(mode.pressure, pressure, fluid.supply, self.scales.supply)
        } else {
            T::ONE
        }
    }

    /// The guards of plays, dead zone, integral limit, step load and mount; `time` is since the start of the record, s.
    pub fn extra_guards(&self, mode: &Mode, z: &State<T>, input: &Input<T>, time: T) -> [T; EXTRA_GUARDS] {
        let mut guards = [T::ONE; EXTRA_GUARDS];
        if self.spool.overlap != T::ZERO {
            guards[OVERLAP - LOOP_GUARDS] =
                limit_guard(mode.overlap, z.spool, self.spool.overlap, T::ONE / self.spool.overlap);
        } else if self.spool.has_sides() {
            guards[OVERLAP - LOOP_GUARDS] = side::<T>(mode.overlap) * z.spool / self.spool.stop;
        }
        if self.jack.has_step_load() && mode.step_load == 0 {
            guards[STEP_LOAD - LOOP_GUARDS] = self.jack.step_load_time - time;
        }
        if self.form.drive == Drive::Force {
            return guards;
        }
        if !self.controller.is_proportional() {
            guards[INTEGRAL - LOOP_GUARDS] = if mode.integral == 0 {
                limit_guard(
                    0,
                    z.integral,
                    self.controller.integral_limit,
                    T::ONE / self.controller.integral_limit,
                )
            } else {
                side::<T>(mode.integral) * (input.command - self.fed_back(z))
            };
        }
        if self.pilot.hysteresis != T::ZERO {
            guards[HYSTERESIS - LOOP_GUARDS] = if mode.hysteresis == 0 {
                let current = self.controller.current(mode.current, self.demand(mode, z, input), T::ONE);
                (self.pilot.hysteresis - (current - z.held_current).magnitude()) / self.pilot.hysteresis
            } else {
                // Accelerations take all equations, and most controllers do not see them.
                let accelerations = if self.controller.sees_position_only() {
                    [T::ZERO; 2]
                } else {
                    let rate = self.rate(mode, z, input);
                    [rate.ram_velocity, rate.base_velocity]
                };
                side::<T>(mode.hysteresis) * self.held_current_rate(mode, z, input, accelerations)
            };
        }
        if self.pilot.feedback_play != T::ZERO {
            guards[FEEDBACK_PLAY - LOOP_GUARDS] = if mode.feedback_play == 0 {
                (self.pilot.feedback_play - (z.spool - z.sensed_spool).magnitude()) / self.pilot.feedback_play
            } else {
                let (flapper, force, _) = self.flapper_now(mode, z, input);
                side::<T>(mode.feedback_play) * self.spool_velocity(mode, z, force, flapper, T::ONE)
            };
        }
        if self.jack.is_mounted() {
            guards[PLAY_INPUT - LOOP_GUARDS] = side::<T>(mode.play_input) * self.play_input_velocity(z);
        }
        let half = self.half_backlash();
        if self.form.feedback == super::Feedback::User && half > T::ZERO {
            guards[USER_PLAY - LOOP_GUARDS] = if mode.user_play == 0 {
                (half - z.user_gap.magnitude()) / half
            } else {
                side::<T>(mode.user_play) * self.play_input_velocity(z)
            };
        }
        guards
    }

    /// Half of the backlash `BKL`, m.
    #[inline(always)]
    pub fn half_backlash(&self) -> T {
        self.parameters.bkl * T::literal(0.5)
    }

    /// Is a guard violated, given its values before and after a step?
    ///
    /// A guard of a limit may be negative by rounding just after its mode began, while it recovers.
    #[inline(always)]
    pub fn is_violated(index: usize, before: T, after: T) -> bool {
        if after >= T::ZERO {
            return false;
        }
        let limit =
            matches!(index, CURRENT | FLAPPER | FIRST_STAGE | PRESSURE | SPOOL_STOP | JACK_STOP | OVERLAP)
                || index == INTEGRAL;
        let is_falling = !limit || after < before;
        (is_falling && after < -Self::slack(index)) || after < -T::literal(LIMIT_TOLERANCE)
    }

    /// How far a guard may be negative without a meaning. The sliding spool comes to rest where its force is just the
    /// sliding friction: its guard then is rounding around zero, for as long as the spool rests.
    #[inline(always)]
    pub fn slack(index: usize) -> T {
        if index == SPOOL { T::literal(SPOOL_FORCE_TOLERANCE) } else { T::ZERO }
    }

    /// Enters the mode that follows when guard `index` turns negative, at the state of the crossing.
    pub fn switch(&self, index: usize, mode: &mut Mode, z: &mut State<T>, input: &Input<T>) {
        let toggled = |mode: i8, value: T| if mode == 0 { sign_of(value) } else { 0 };
        match index {
            CURRENT => mode.current = toggled(mode.current, self.demand(mode, z, input)),
            FLAPPER => self.switch_flapper(mode, z, input),
            FIRST_STAGE => {
                let (flapper, ..) = self.flapper_now(mode, z, input);
                mode.first_stage = toggled(mode.first_stage, flapper);
            }
            PRESSURE => {
                let opening = self.spool.opening(z.spool, side(mode.overlap), T::ONE);
                let pressure = if self.fluid.is_compressible() {
                    z.pressure
                } else {
                    self.fluid_now(z).linear_pressure(opening, z.ram_velocity)
                };
                mode.pressure = toggled(mode.pressure, pressure);
            }
            SPOOL => self.switch_spool(mode, z, input),
            SPOOL_STOP => {
                mode.spool = 2 * sign_of(z.spool);
                z.spool = side::<T>(mode.spool) * self.spool.stop;
                z.spool_rest = T::ZERO;
            }
            JACK => {
                // From a slide the ram comes to rest; from rest or a stop it leaves in the direction of the force.
                let slid = mode.jack_slides();
                z.ram_velocity = T::ZERO;
                let drive = self.drive_at_rest(mode, z, input);
                let direction = sign_of(drive);
                let held = slid && drive.magnitude() <= self.jack.breakaway(side(direction));
                mode.jack = if held { 0 } else { direction };
            }
            JACK_STOP => {
                mode.jack = 2 * sign_of(z.ram);
                z.ram = side::<T>(mode.jack) * self.jack.stop;
                z.ram_rest = T::ZERO;
                z.ram_velocity = T::ZERO;
            }
            // Without a dead zone the other side follows at once.
            OVERLAP if self.spool.overlap == T::ZERO => mode.overlap = -mode.overlap,
            OVERLAP => mode.overlap = toggled(mode.overlap, z.spool),
            INTEGRAL => {
                mode.integral = toggled(mode.integral, z.integral);
                if mode.integral != 0 {
                    z.integral = side::<T>(mode.integral) * self.controller.integral_limit;
                }
            }
            HYSTERESIS => {
                let current = self.controller.current(mode.current, self.demand(mode, z, input), T::ONE);
                if mode.hysteresis != 0 {
                    z.held_current = in_contact(current, side(mode.hysteresis), self.pilot.hysteresis);
                }
                mode.hysteresis = toggled(mode.hysteresis, current - z.held_current);
            }
            FEEDBACK_PLAY => {
                if mode.feedback_play != 0 {
                    z.sensed_spool = in_contact(z.spool, side(mode.feedback_play), self.pilot.feedback_play);
                }
                mode.feedback_play = toggled(mode.feedback_play, z.spool - z.sensed_spool);
            }
            USER_PLAY => {
                if mode.user_play != 0 {
                    z.user_gap = -side::<T>(mode.user_play) * self.half_backlash();
                }
                mode.user_play = toggled(mode.user_play, -z.user_gap);
            }
            PLAY_INPUT => mode.play_input = -mode.play_input,
            _ => mode.step_load = 1,
        }
    }

    fn switch_flapper(&self, mode: &mut Mode, z: &mut State<T>, input: &Input<T>) {
        if mode.flapper != 0 {
            mode.flapper = 0;
            return;
        }
        let (flapper, force, _) = self.flapper_now(mode, z, input);
        mode.flapper = match self.form.valve {
            ValveForm::TwoStage => sign_of(z.flapper),
            ValveForm::StaticFlapper => sign_of(flapper),
            ValveForm::FirstOrder => sign_of(self.pilot.balanced_spool(force) - z.spool),
        };
        if self.form.valve.has_flapper_state() {
            z.flapper = side::<T>(mode.flapper) * self.pilot.stop;
            z.flapper_velocity = T::ZERO;
        }
    }

    fn switch_spool(&self, mode: &mut Mode, z: &State<T>, input: &Input<T>) {
        if self.form.valve == ValveForm::FirstOrder {
            mode.spool = 1;
            return;
        }
        let (flapper, ..) = self.flapper_now(mode, z, input);
        let force = self.spool.area * self.first_stage_pressure(mode, z, flapper, T::ONE);
        let held = mode.spool_slides() && force.magnitude() <= self.spool.breakaway;
        mode.spool = if held { 0 } else { sign_of(force) };
    }
}
