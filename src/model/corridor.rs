//! The usual case at a glance: bounds between which no guard of the plain loop is violated.
//!
//! In a mode of the plain loop (a two-stage valve that meters linearly, the ram fed back in proportion, nothing outside
//! but a constant load) every guard of [`Model::loop_guards`] bounds one of six quantities. A mode sets the bounds when
//! it begins; a step then costs a comparison for each instead of the guards themselves. What is between the bounds
//! violates no guard; what is not need not violate one: a step that ends there is divided, and of one that cannot be the
//! guards themselves decide.

use super::events::SPOOL_FORCE_TOLERANCE;
use super::state::{Input, Mode, State, side};
use super::waypoint::Waypoint;
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

/// The quantities at one place: position error (command minus ram, m), flapper position (m) or, where it is at its stop,
/// the force that holds it there (N), spool and ram position (m), ram velocity (m/s), and differential pressure of the
/// linear form before its limit (Pa).
pub type Watched<T> = [T; WATCHED];

/// What the channels see of a place in a mode that has a corridor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Passing<T> {
    /// Ram position, m.
    pub ram: T,
    /// Ram velocity, m/s.
    pub ram_velocity: T,
    /// Current, mA.
    pub current: T,
    /// Differential pressure, Pa.
    pub pressure: T,
}

impl<T: Real> Passing<T> {
    /// The end of a sample: what has a corridor has no mount.
    #[inline(always)]
    pub const fn waypoint(&self) -> Waypoint<T> {
        Waypoint { share: T::ONE, pushing: [self.ram, self.ram_velocity], behind: [T::ZERO; 2] }
    }
}

/// How much further than a straight way from one place to the next what is fast went in between: position error (m),
/// and what is watched of the flapper. The others follow the flapper in one direction as long as it stays in its bounds.
pub type Detour<T> = [T; 2];

/// A law of one quantity in one mode: its value at zero, and its slope.
type Line<T> = [T; 2];

/// The bounds of one mode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corridor<T> {
    lower: Watched<T>,
    upper: Watched<T>,
    /// Pressure of the linear form for each m of spool position, Pa/m, and for each m/s of ram velocity, Pa s/m.
    by_spool: T,
    by_velocity: T,
    /// What is watched of the flapper, for each m of its position, of the position error and of the spool position.
    flapper: [T; 3],
    /// Flapper position that rounding may make up, m.
    slack: T,
    /// Current by position error, mA; differential pressure by that of the linear form, Pa: at their limits the limits.
    current: Line<T>,
    pressure: Line<T>,
}

/// How a step that cannot be divided went from one place to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
        let [by_position, by_error, by_spool] = self.flapper;
        let flapper = by_position * z.flapper + by_error * error + by_spool * z.spool;
        [error, flapper, z.spool, z.ram, z.ram_velocity, self.linear_pressure(z)]
    }

    /// What the channels see at a state with a position error, m.
    #[inline(always)]
    pub fn passing(&self, z: &State<T>, error: T) -> Passing<T> {
        let ([current, by_error], [pressure, by_pressure]) = (self.current, self.pressure);
        Passing {
            ram: z.ram,
            ram_velocity: z.ram_velocity,
            current: current + by_error * error,
            pressure: pressure + by_pressure * self.linear_pressure(z),
        }
    }

    /// Differential pressure of the linear form before its limit, Pa.
    #[inline(always)]
    fn linear_pressure(&self, z: &State<T>) -> T {
        self.by_spool * z.spool + self.by_velocity * z.ram_velocity
    }

    /// The detour of a way of several steps, from the sums of what position error and flapper position (m) moved by in
    /// them, and from what they moved by in all. The flapper may turn back inside a step as well: a quarter more.
    #[inline(always)]
    pub fn detour(&self, way: [T; 2], change: [T; 2]) -> Detour<T> {
        let [error, position] = core::array::from_fn(|index| way[index] - change[index].magnitude());
        let [by_position, by_error, _] = self.flapper;
        let position = position + way[1] * T::literal(0.25);
        [error, by_position * position + by_error.magnitude() * error]
    }

    /// Has a place the margins that a step after a change asks for? What comes to rest on its bound has.
    #[inline(never)]
    pub fn has_margin(&self, place: &Watched<T>, change: &Watched<T>) -> bool {
        self.holds(place, &change.map(|value| value.magnitude() * T::literal(0.25)))
    }

    /// Is there room for a step twice as long as the one that changed this much, if it goes on like that?
    #[inline(never)]
    pub fn has_room(&self, place: &Watched<T>, change: &Watched<T>) -> bool {
        // Twice the change and the margin of such a step are three times the change, of which a margin is a quarter.
        self.has_margin(place, &change.map(|value| value * T::literal(12.0)))
    }

    /// Does nothing leave its bounds on the way from one place to the next? Asked of a step that can be divided.
    ///
    /// What turns back between the two may have been further out than both. A parabola through three equally spaced
    /// points dips by an eighth of its fall over the first two; twice that is looked out for, with `swing`, the change over
    /// a step of the same length before. What moves away from its bound needs no margin.
    #[inline(never)]
    pub fn keeps(&self, from: &Watched<T>, to: &Watched<T>, swing: &Watched<T>, detour: &Detour<T>) -> bool {
        let keeps = |index: usize, detour: T| {
            let (from, to, quarter) = (from[index], to[index], swing[index] * T::literal(0.25));
            let slack = self.slack_of(index);
            let (lower, upper) = (self.lower[index] - slack, self.upper[index] + slack);
            // What went to and fro on the way may have turned back anywhere on it. Rounding does, too.
            let detour = detour - (slack + slack);
            if detour > T::ZERO {
                let margin = quarter.magnitude() + detour;
                return from.smaller(to) - margin >= lower && from.larger(to) + margin <= upper;
            }
            // What moves away from a bound that it was within is further within it.
            if quarter < T::ZERO {
                to + quarter >= lower && from + quarter >= lower && to <= upper
            } else {
                to + quarter <= upper && from + quarter <= upper && to >= lower
            }
        };
        let [error, flapper] = *detour;
        keeps(ERROR, error)
            && keeps(FLAPPER, flapper)
            && keeps(SPOOL, T::ZERO)
            && keeps(RAM, T::ZERO)
            && keeps(RAM_VELOCITY, T::ZERO)
            && keeps(PRESSURE, T::ZERO)
    }

    /// How a step that cannot be divided went from one place to the next.
    #[inline(always)]
    pub fn passage(&self, from: &Watched<T>, to: &Watched<T>) -> Passage {
        let is_within = (0..WATCHED).all(|index| {
            let slack = self.slack_of(index);
            to[index] + slack >= self.lower[index] && to[index] - slack <= self.upper[index]
        });
        if is_within { Passage::Clear } else { self.way_out(from, to) }
    }

    /// How clearly a step that ends out of bounds went through one of them.
    #[inline(never)]
    fn way_out(&self, from: &Watched<T>, to: &Watched<T>) -> Passage {
        let has_left = |before: T, after: T, slack: T| {
            before >= T::ZERO && after < -slack.larger((before - after) * T::literal(0.25))
        };
        let has_left = (0..WATCHED).any(|index| {
            let (lower, upper, slack) = (self.lower[index], self.upper[index], self.slack_of(index));
            has_left(from[index] - lower, to[index] - lower, slack)
                || has_left(upper - from[index], upper - to[index], slack)
        });
        if has_left { Passage::Left } else { Passage::Close }
    }

    /// By how much what is watched may be out of bounds by rounding.
    #[inline(always)]
    fn slack_of(&self, index: usize) -> T {
        if index == FLAPPER { self.slack } else { T::ZERO }
    }

    /// A state and an input of which `watched` is by so much less.
    pub fn before(&self, z: &State<T>, input: &Input<T>, less: &Watched<T>) -> (State<T>, Input<T>) {
        let mut earlier = *z;
        earlier.flapper -= self.flapper[0] * less[FLAPPER];
        earlier.spool -= less[SPOOL];
        earlier.ram -= less[RAM];
        earlier.ram_velocity -= less[RAM_VELOCITY];
        (earlier, Input { command: input.command - less[ERROR] - less[RAM], ..*input })
    }

    /// Is everything between its bounds, by a margin for each, but for rounding?
    #[inline(always)]
    pub fn holds(&self, watched: &Watched<T>, margins: &Watched<T>) -> bool {
        (0..WATCHED).all(|index| {
            let (value, margin) = (watched[index], margins[index] - self.slack_of(index));
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
        let held = mode.jack_slides() || mode.pressure == 0;
        if !plain || mode.first_stage != 0 || !held {
            return None;
        }
        let infinity = T::ONE / T::ZERO;
        let slope = |spool: T, velocity: T| self.fluid.linear_pressure(spool, velocity);
        let mut corridor = Corridor {
            lower: [-infinity; WATCHED],
            upper: [infinity; WATCHED],
            by_spool: slope(T::ONE, T::ZERO),
            by_velocity: slope(T::ZERO, T::ONE),
            flapper: [T::ONE, T::ZERO, T::ZERO],
            slack: T::literal(SPOOL_FORCE_TOLERANCE) / (self.spool.area * self.pilot.pressure_gain),
            current: [
                self.controller.current(mode.current, T::ZERO, T::ONE),
                self.controller.current(mode.current, self.controller.proportional_demand(T::ONE), T::ZERO),
            ],
            pressure: [
                self.fluid.limited(mode.pressure, T::ZERO, T::ONE),
                self.fluid.limited(mode.pressure, T::ONE, T::ZERO),
            ],
        };
        corridor.limit(ERROR, mode.current, self.controller.error_at_limit());
        corridor.limit(FLAPPER, 0, self.pilot.stop);
        corridor.limit(FLAPPER, 0, self.fluid.supply / self.pilot.pressure_gain);
        corridor.limit(PRESSURE, mode.pressure, self.fluid.supply);
        // Flapper position for a force on the spool.
        let for_force = |force: T| force / (self.spool.area * self.pilot.pressure_gain);
        if mode.spool_slides() {
            corridor.limit(FLAPPER, mode.spool, for_force(self.spool.rest));
            corridor.stop(SPOOL, mode.spool, [-self.spool.stop, self.spool.stop]);
        } else {
            // At a stop only a force away from it moves the spool.
            let most = for_force(self.spool.breakaway);
            corridor.stop(FLAPPER, -mode.spool, [-most, most]);
        }
        if mode.flapper != 0 {
            self.watch_stop(&mut corridor, mode)?;
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

    /// Watches the force that holds the flapper at its stop in place of its position, which does not change; none where
    /// the mode is not valid with the flapper there.
    fn watch_stop(&self, corridor: &mut Corridor<T>, mode: &Mode) -> Option<()> {
        let direction = side::<T>(mode.flapper);
        let force = |error: T, spool: T, one: T| {
            let current =
                self.controller.current(mode.current, self.controller.proportional_demand(error), one);
            let motor = self.pilot.torque_motor_force(current, one);
            direction * self.pilot.static_force(motor, spool, direction * self.pilot.stop * one)
        };
        let position = direction * self.pilot.stop;
        let is_valid = position + corridor.slack >= corridor.lower[FLAPPER]
            && position - corridor.slack <= corridor.upper[FLAPPER];
        corridor.flapper = [T::ZERO, force(T::ONE, T::ZERO, T::ZERO), force(T::ZERO, T::ONE, T::ZERO)];
        corridor.lower[FLAPPER] = -force(T::ZERO, T::ZERO, T::ONE);
        corridor.upper[FLAPPER] = T::ONE / T::ZERO;
        corridor.slack = T::ZERO;
        is_valid.then_some(())
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
        for (current, flapper) in
            [(-1, 0), (0, 0), (1, 0), (-1, -1), (-1, 1), (1, 1), (1, -1), (0, 1), (0, -1)]
        {
            for spool in [-2, -1, 0, 1, 2] {
                for (jack, pressure) in [(-1, -1), (-1, 0), (1, 1), (1, 0), (0, 0), (2, 0), (-2, 0)] {
                    let mode = Mode { current, flapper, spool, pressure, jack, ..model.mode_at_rest() };
                    let corridor = model.corridor(&mode);
                    for _ in 0..2000 {
                        let (mut z, input) = place(&mut random, &mode, &p);
                        if jack.abs() == 2 {
                            z.ram = f64::from(jack.signum()) * p.jack_stop;
                        }
                        let guards = model.loop_guards(&mode, &z, &input);
                        let is_valid = guards.iter().all(|&guard| guard >= -1e-12);
                        let is_held = corridor.is_some_and(|corridor| {
                            corridor.holds(&corridor.watched(&z, &input), &[0.0; WATCHED])
                        });
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
    fn what_creeps_to_its_bound_has_room_once_it_is_there_but_for_rounding() {
        let model = Model::new(Form::default(), &Parameters::<f64>::default());
        // A hold: the spool slides ever more slowly, on its friction.
        let corridor = model.corridor(&Mode { spool: 1, ..model.mode_at_rest() }).unwrap();
        let slack = corridor.slack;
        let z = State { flapper: corridor.lower[FLAPPER], ..State::default() };
        let place = corridor.watched(&z, &Input::default());
        let moved = |change: f64| core::array::from_fn(|index| if index == FLAPPER { change } else { 0.0 });
        assert!(slack > 0.0 && corridor.has_room(&place, &moved(0.1 * slack)));
        assert!(!corridor.has_room(&place, &moved(slack)));
        let keeps = |detour: f64| corridor.keeps(&place, &place, &moved(0.0), &[0.0, detour]);
        assert!(keeps(2.0 * slack) && !keeps(4.0 * slack));
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
        assert!(!none(Form::default(), p, |mode| (mode.flapper, mode.spool) = (1, 1)));
        assert!(none(Form::default(), p, |mode| (mode.flapper, mode.spool) = (1, -1)));
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
