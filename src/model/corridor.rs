//! The usual case at a glance: bounds between which no guard of the plain loop is violated.
//!
//! In a mode of the plain loop (a two-stage valve that meters linearly, the ram fed back in proportion, nothing outside
//! but a constant load) every guard of [`Model::loop_guards`] bounds one of six quantities. A mode sets the bounds when
//! it begins; a step then costs a comparison for each instead of the guards themselves. What is between the bounds
//! violates no guard; what is not need not violate one: the guards themselves decide.

use super::events::SPOOL_FORCE_TOLERANCE;
use super::state::{Input, Mode, State, side};
use super::{Model, ValveForm};
use crate::scalar::Real;

/// Quantities that the guards of the plain loop bound.
pub const WATCHED: usize = 6;

/// Place of the position error.
pub const ERROR: usize = 0;
const FLAPPER: usize = 1;
const SPOOL: usize = 2;
const RAM: usize = 3;
const RAM_VELOCITY: usize = 4;
const PRESSURE: usize = 5;

/// The quantities at one place: position error (command minus ram, m), flapper, spool and ram position (m), ram
/// velocity (m/s), and differential pressure of the linear form before its limit (Pa).
pub type Watched<T> = [T; WATCHED];

/// The bounds of one mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corridor<T> {
    lower: Watched<T>,
    upper: Watched<T>,
    /// Pressure of the linear form for each m of spool position, Pa/m, and for each m/s of ram velocity, Pa s/m.
    by_spool: T,
    by_velocity: T,
    /// Flapper position that rounding may make up, m.
    slack: T,
}

/// How a step went from one place to the next, the least first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Passage {
    /// Between the bounds.
    Clear,
    /// So close to a bound that the guards must be looked at.
    Close,
    /// Clearly through a bound.
    Left,
}

impl<T: Real> Corridor<T> {
    /// What is watched at a state under an input.
    #[inline(always)]
    pub fn watched(&self, z: &State<T>, input: &Input<T>) -> Watched<T> {
        let error = (input.command - z.ram) - z.ram_rest;
        let pressure = self.by_spool * z.spool + self.by_velocity * z.ram_velocity;
        [error, z.flapper, z.spool, z.ram, z.ram_velocity, pressure]
    }

    /// Does nothing leave its bounds on the way from one place to the next? At a glance, the usual case.
    ///
    /// What turns back between the two may have been further out than both. A parabola through three equally spaced
    /// points dips by an eighth of its fall over the first two; twice that is looked out for: with `swing`, the change
    /// over a step of the same length before, and with `change` on behalf of the step that follows.
    #[inline(always)]
    pub fn is_clear(&self, to: &Watched<T>, change: &Watched<T>, swing: &Watched<T>) -> bool {
        let margins = core::array::from_fn(|index| {
            (change[index].magnitude() + swing[index].magnitude()) * T::literal(0.25)
        });
        self.holds(to, &margins)
    }

    /// Has a place the margins that a step after a change asks for?
    #[inline(never)]
    pub fn has_margin(&self, place: &Watched<T>, change: &Watched<T>) -> bool {
        self.holds(place, &change.map(|value| value.magnitude() * T::literal(0.25)))
    }

    /// Is a step clear, as [`is_clear`](Self::is_clear) asks, when looked at closely? What moves away from its bound
    /// needs no margin, nor does a step that cannot be divided.
    #[inline(never)]
    pub fn passage(
        &self,
        from: &Watched<T>,
        to: &Watched<T>,
        swing: &Watched<T>,
        divisible: bool,
    ) -> Passage {
        let quarter = T::literal(0.25);
        let mut passage = Passage::Clear;
        let mut look = |before: T, after: T, fall: T, slack: T| {
            let has_dipped = divisible && before.smaller(after) + slack < fall * quarter;
            if after + slack >= T::ZERO && !has_dipped {
                return;
            }
            let has_left = before >= T::ZERO && after < -slack.larger((before - after) * quarter);
            passage = passage.max(if has_left { Passage::Left } else { Passage::Close });
        };
        for index in 0..WATCHED {
            let (from, to, swing) = (from[index], to[index], swing[index]);
            let (lower, upper) = (self.lower[index], self.upper[index]);
            let slack = if index == FLAPPER { self.slack } else { T::ZERO };
            look(from - lower, to - lower, -swing, slack);
            look(upper - from, upper - to, swing, slack);
        }
        passage
    }

    /// A state and an input of which `watched` is by so much less.
    pub fn before(&self, z: &State<T>, input: &Input<T>, less: &Watched<T>) -> (State<T>, Input<T>) {
        let mut earlier = *z;
        earlier.flapper -= less[FLAPPER];
        earlier.spool -= less[SPOOL];
        earlier.ram -= less[RAM];
        earlier.ram_velocity -= less[RAM_VELOCITY];
        (earlier, Input { command: input.command - less[ERROR] - less[RAM], ..*input })
    }

    /// Is everything between its bounds, by a margin for each?
    #[inline(always)]
    pub fn holds(&self, watched: &Watched<T>, margins: &Watched<T>) -> bool {
        (0..WATCHED).all(|index| {
            let (value, margin) = (watched[index], margins[index]);
            value - margin >= self.lower[index] && value + margin <= self.upper[index]
        })
    }

    /// Narrows a bound.
    fn within(&mut self, index: usize, lower: T, upper: T) {
        self.lower[index] = self.lower[index].larger(lower);
        self.upper[index] = self.upper[index].smaller(upper);
    }

    /// Narrows a bound to a limit of the magnitude (mode 0), or to what is beyond it on the side of the mode.
    fn limit(&mut self, index: usize, mode: i8, limit: T) {
        let infinity = T::ONE / T::ZERO;
        match mode {
            0 => self.within(index, -limit, limit),
            i8::MIN..=-1 => self.within(index, -infinity, -limit),
            _ => self.within(index, limit, infinity),
        }
    }

    /// Narrows a bound to what is not beyond a limit on the side of the mode; in mode 0 on both sides.
    fn stop(&mut self, index: usize, mode: i8, limits: [T; 2]) {
        let infinity = T::ONE / T::ZERO;
        let [lower, upper] = limits;
        self.within(index, if mode > 0 { -infinity } else { lower }, if mode < 0 { infinity } else { upper });
    }
}

impl<T: Real> Model<T> {
    /// The bounds of a mode, where no force drives the jack from outside; none where a guard looks at something else.
    pub fn corridor(&self, mode: &Mode) -> Option<Corridor<T>> {
        let plain = self.form.valve == ValveForm::TwoStage
            && self.is_plain
            && self.jack.is_affine()
            && !self.jack.has_step_load()
            && !self.jack.has_spring();
        // The force on a flapper at its stop depends on the spool alone where the current is at its limit.
        let is_limited = (mode.flapper != 0 && mode.current == 0) || mode.first_stage != 0;
        let held = mode.jack_slides() || mode.pressure == 0;
        if !plain || is_limited || !held {
            return None;
        }
        let infinity = T::ONE / T::ZERO;
        let slope = |spool: T, velocity: T| self.fluid.linear_pressure(spool, velocity);
        let mut corridor = Corridor {
            lower: [-infinity; WATCHED],
            upper: [infinity; WATCHED],
            by_spool: slope(T::ONE, T::ZERO),
            by_velocity: slope(T::ZERO, T::ONE),
            slack: T::literal(SPOOL_FORCE_TOLERANCE) / (self.spool.area * self.pilot.pressure_gain),
        };
        corridor.limit(ERROR, mode.current, self.controller.error_at_limit());
        corridor.limit(FLAPPER, 0, self.pilot.stop);
        corridor.limit(FLAPPER, 0, self.fluid.supply / self.pilot.pressure_gain);
        if mode.flapper != 0 {
            let current = self.controller.current(mode.current, T::ZERO, T::ONE);
            let force = self.pilot.torque_motor_force(current, T::ONE);
            let balance = self.pilot.balanced_sensed_spool(force, side::<T>(mode.flapper) * self.pilot.stop);
            corridor.stop(SPOOL, mode.flapper, [balance, balance]);
        }
        corridor.limit(PRESSURE, mode.pressure, self.fluid.supply);
        // Flapper position for a force on the spool.
        let for_force = |force: T| force / (self.spool.area * self.pilot.pressure_gain);
        if mode.spool_slides() {
            corridor.limit(FLAPPER, mode.spool, for_force(self.spool.sliding));
            corridor.stop(SPOOL, mode.spool, [-self.spool.stop, self.spool.stop]);
        } else {
            // At a stop only a force away from it moves the spool.
            let most = for_force(self.spool.breakaway);
            corridor.stop(FLAPPER, -mode.spool, [-most, most]);
        }
        if mode.jack_slides() {
            corridor.limit(RAM_VELOCITY, mode.jack, T::ZERO);
            corridor.stop(RAM, mode.jack, [-self.jack.stop, self.jack.stop]);
        } else {
            let load = self.jack.drive(T::ZERO, &State::default(), T::ZERO, false, T::ONE);
            let balance = |direction: T| (direction * self.jack.breakaway(direction) - load) / self.jack.area;
            corridor.stop(PRESSURE, -mode.jack, [balance(-T::ONE), balance(T::ONE)]);
        }
        Some(corridor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Drive, Feedback, Form};
    use crate::parameter::Parameters;
    use crate::random::Random;

    /// A state and an input that a mode may have.
    fn place(random: &mut Random, mode: &Mode, p: &Parameters<f64>) -> (State<f64>, Input<f64>) {
        let mut about = |most: f64| most * random.bell::<f64>();
        let z = State {
            flapper: if mode.flapper == 0 {
                about(p.flapper_stop)
            } else {
                side::<f64>(mode.flapper) * p.flapper_stop
            },
            flapper_velocity: about(0.1),
            spool: if mode.spool_slides() || mode.spool == 0 {
                about(p.spool_stop)
            } else {
                side::<f64>(mode.spool) * p.spool_stop
            },
            ram: about(0.01),
            ram_velocity: if mode.jack_slides() { about(0.2) } else { 0.0 },
            ..State::default()
        };
        (z, Input { command: z.ram + about(2e-3), ..Input::default() })
    }

    #[test]
    fn the_corridor_holds_only_where_no_guard_is_violated_and_nearly_everywhere_there() {
        let mut random = Random::new(1);
        let p = Parameters {
            constant_load: 300.0,
            friction_asymmetry: 0.2,
            fdj: 3000.0,
            ..Parameters::default()
        };
        let model = Model::new(Form::default(), &p);
        let (mut held, mut missed) = (0, 0);
        for (current, flapper) in [(-1, 0), (0, 0), (1, 0), (-1, -1), (-1, 1), (1, 1), (1, -1)] {
            for spool in [-2, -1, 0, 1, 2] {
                for (jack, pressure) in [(-1, -1), (-1, 0), (1, 1), (1, 0), (0, 0), (2, 0), (-2, 0)] {
                    let mode = Mode { current, flapper, spool, pressure, jack, ..model.mode_at_rest() };
                    let corridor = model.corridor(&mode).unwrap();
                    for _ in 0..2000 {
                        let (mut z, input) = place(&mut random, &mode, &p);
                        if jack.abs() == 2 {
                            z.ram = f64::from(jack.signum()) * p.jack_stop;
                        }
                        let guards = model.loop_guards(&mode, &z, &input);
                        let is_valid = guards.iter().all(|&guard| guard >= -1e-12);
                        let watched = corridor.watched(&z, &input);
                        let is_held = corridor.holds(&watched, &[0.0; WATCHED]);
                        assert!(is_valid || !is_held, "{mode:?}, {z:?}, {input:?}: {guards:?}");
                        held += u32::from(is_held);
                        missed += u32::from(is_valid && !is_held);
                    }
                }
            }
        }
        assert!(held > 1000, "{held}");
        assert_eq!(missed, 0);
    }

    #[test]
    fn a_margin_narrows_the_corridor() {
        let model = Model::new(Form::default(), &Parameters::<f64>::default());
        let mode = Mode { jack: 1, spool: 1, ..model.mode_at_rest() };
        let corridor = model.corridor(&mode).unwrap();
        let z = State { flapper: 5e-5, spool: 5e-5, ram_velocity: 0.01, ..State::default() };
        let watched = corridor.watched(&z, &Input { command: 1e-4, ..Input::default() });
        let mut margins = [0.0; WATCHED];
        assert!(corridor.holds(&watched, &margins));
        margins[RAM_VELOCITY] = 0.011;
        assert!(!corridor.holds(&watched, &margins));
    }

    #[test]
    fn guards_that_look_elsewhere_have_no_corridor() {
        let none = |form: Form, parameters: Parameters<f64>, change: fn(&mut Mode)| {
            let model = Model::new(form, &parameters);
            let mut mode = model.mode_at_rest();
            change(&mut mode);
            model.corridor(&mode).is_none()
        };
        let p = Parameters::default();
        assert!(!none(Form::default(), p, |_| ()));
        assert!(!none(Form::default(), p, |mode| (mode.current, mode.flapper) = (1, 1)));
        assert!(none(Form::default(), p, |mode| mode.flapper = 1));
        assert!(none(Form::default(), p, |mode| (mode.pressure, mode.jack) = (1, 0)));
        assert!(none(Form { valve: ValveForm::StaticFlapper, ..Form::default() }, p, |_| ()));
        assert!(none(Form { feedback: Feedback::User, ..Form::default() }, p, |_| ()));
        assert!(none(Form { drive: Drive::Force, ..Form::default() }, p, |_| ()));
        assert!(none(Form::default(), Parameters { metering_blend: 1.0, ..p }, |_| ()));
        assert!(none(Form::default(), Parameters { spring_load: 1e5, ..p }, |_| ()));
        assert!(none(Form::default(), Parameters { derivative_gain: 1.0, ..p }, |_| ()));
        assert!(none(Form::default(), Parameters { spool_overlap: 1e-5, ..p }, |_| ()));
        assert!(none(Form::default(), Parameters { step_load: 100.0, ..p }, |_| ()));
    }
}
