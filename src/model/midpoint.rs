//! One step of the model by the midpoint rule, inside a mode.

use super::fluid::Fluid;
use super::state::{Input, Mode, State, side};
use super::{Drive, Feedback, Model};
use crate::scalar::Real;

impl<T: Real> Model<T> {
    /// The fluid block at the supply that the state has.
    #[inline(always)]
    pub(crate) fn fluid_now(&self, z: &State<T>) -> Fluid<T> {
        if self.parameters.supply_sag == T::ZERO {
            self.fluid
        } else {
            Fluid::new(&self.parameters, self.parameters.supply_ratio * (T::ONE + z.sag))
        }
    }

    /// The state one step later.
    #[inline]
    pub(crate) fn midpoint_step(
        &self,
        mode: &Mode,
        z: &State<T>,
        input: &Input<T>,
        force_rate: T,
        step: T,
    ) -> State<T> {
        let half = step * T::literal(0.5);
        let middle_input = Input {
            command: input.command + input.command_rate * half,
            force: input.force + force_rate * half,
            ..*input
        };
        let start = self.pilot_point(mode, z, input);
        // Slow states at the middle of the step, from their rates at its start.
        let mut middle = State {
            flapper: z.flapper + half * z.flapper_velocity,
            spool: z.spool + half * self.spool_velocity(mode, z, start.motor_force, start.flapper, T::ONE),
            integral: z.integral + half * start.integral_rate,
            held_current: z.held_current + half * start.held_current_rate,
            ..*z
        };
        if mode.jack_slides() {
            middle.ram += half * z.ram_velocity;
        }
        if self.jack.is_mounted() {
            middle.base += half * z.base_velocity;
        }
        if mode.feedback_play != 0 {
            middle.sensed_spool += middle.spool - z.spool;
        }
        if mode.user_play == 0 && self.form.feedback == Feedback::User {
            middle.user_gap = z.user_gap - (self.play_input(&middle) - self.play_input(z));
        }
        let mut end = *z;
        self.step_jack(mode, z, &mut middle, &mut end, &middle_input, step);
        if self.form.drive == Drive::Force {
            return end;
        }
        let point = self.pilot_point(mode, &middle, &middle_input);
        let mut flapper = point.flapper;
        if self.form.valve.has_flapper_state() && mode.flapper == 0 {
            let force = self.pilot.static_force(point.motor_force, point.sensed, middle.flapper);
            let acceleration = self.pilot.mean_acceleration(force, z.flapper_velocity, step);
            let mean_velocity = z.flapper_velocity + half * acceleration;
            end.flapper_velocity = z.flapper_velocity + step * acceleration;
            end.flapper = z.flapper + step * mean_velocity;
            flapper = z.flapper + half * mean_velocity;
        }
        end.move_spool(step * self.spool_velocity(mode, &middle, point.motor_force, flapper, T::ONE));
        end.integral = z.integral + step * point.integral_rate;
        end.held_current = z.held_current + step * point.held_current_rate;
        if mode.feedback_play != 0 {
            end.sensed_spool = z.sensed_spool + (end.spool - z.spool);
        }
        if mode.user_play == 0 && self.form.feedback == Feedback::User {
            end.user_gap = z.user_gap - (self.play_input(&end) - self.play_input(z));
        }
        end
    }

    /// Rate of the supply's sag, 1/s, at a speed of the ram.
    #[inline(always)]
    pub(super) fn sag_rate(&self, speed: T, sag: T) -> T {
        (-self.parameters.supply_sag * speed - sag) / self.parameters.supply_sag_lag
    }

    /// Advances ram, pressure and supply; leaves the ram's velocity at the middle of the step in `middle`.
    fn step_jack(
        &self,
        mode: &Mode,
        z: &State<T>,
        middle: &mut State<T>,
        end: &mut State<T>,
        input: &Input<T>,
        step: T,
    ) {
        let half = step * T::literal(0.5);
        let step_load_on = mode.step_load != 0;
        if self.parameters.supply_sag != T::ZERO {
            middle.sag += half * self.sag_rate(z.ram_velocity.magnitude(), z.sag);
        }
        let fluid = self.fluid_now(middle);
        let opening = self.spool.opening(middle.spool, side(mode.overlap), T::ONE);
        if fluid.is_compressible() && mode.pressure == 0 {
            middle.pressure = z.pressure + half * fluid.pressure_rate(opening, z.ram_velocity, z.pressure);
        }
        if mode.jack_slides() {
            let direction = side(mode.jack);
            let (drive, inertia) = self.jack.midpoint_drive(z, middle, input.force, step_load_on, half);
            let constant = drive + self.jack.coulomb(direction);
            let mut velocity = z.ram_velocity;
            // The curved forces need a velocity at the middle of the step: guess it, then use the guess.
            let passes = if self.jack.is_affine() { 1 } else { 2 };
            for _ in 0..passes {
                let force = constant + self.jack.curved_force(middle.ram, velocity, direction).0;
                let (line, compliance) =
                    self.jack.midpoint_line(force, inertia, z.ram_velocity, direction, half);
                let pressure = if self.form.drive == Drive::Force {
                    T::ZERO
                } else if fluid.is_compressible() {
                    middle.pressure
                } else {
                    fluid.implicit_pressure(mode.pressure, opening, line, compliance)
                };
                velocity = line + compliance * pressure;
            }
            middle.ram_velocity = velocity;
            end.ram_velocity = velocity + velocity - z.ram_velocity;
            end.move_ram(step * velocity);
        }
        if self.jack.is_mounted() {
            self.jack.move_base(z, middle, end, input.force, step_load_on, half);
            middle.base_velocity = (z.base_velocity + end.base_velocity) * T::literal(0.5);
        }
        if fluid.is_compressible() && mode.pressure == 0 {
            end.pressure =
                z.pressure + step * fluid.pressure_rate(opening, middle.ram_velocity, middle.pressure);
        }
        if self.parameters.supply_sag != T::ZERO {
            end.sag = z.sag + step * self.sag_rate(middle.ram_velocity.magnitude(), middle.sag);
        }
    }

    /// Everything between the controller and the spool at one instant.
    #[inline(always)]
    fn pilot_point(&self, mode: &Mode, z: &State<T>, input: &Input<T>) -> PilotPoint<T> {
        let current = self.controller.current(mode.current, self.demand(mode, z, input), T::ONE);
        let motor_force = self.pilot.torque_motor_force(self.motor_current(mode, z, current, T::ONE), T::ONE);
        let sensed = self.sensed_spool(mode, z, T::ONE);
        let mut point = PilotPoint {
            motor_force,
            sensed,
            flapper: self.flapper_position(mode, z, motor_force, sensed, T::ONE),
            integral_rate: T::ZERO,
            held_current_rate: T::ZERO,
        };
        if !self.controller.is_proportional() && mode.integral == 0 {
            point.integral_rate = input.command - self.fed_back(z);
        }
        if self.pilot.hysteresis != T::ZERO {
            // The acceleration is left out: with a rate gain the play is then first order only.
            point.held_current_rate = self.held_current_rate(mode, z, input, [T::ZERO; 2]);
        }
        point
    }
}

struct PilotPoint<T> {
    motor_force: T,
    sensed: T,
    flapper: T,
    integral_rate: T,
    held_current_rate: T,
}
