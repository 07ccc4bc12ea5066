//! The finest step that holds an event: to the crossing, through it into the next mode, and on. And the one in which the
//! command jumps: up to there, and on.

use super::guards::Guards;
use super::{Run, Step, Stepper, ceiling};
use crate::model::Model;
use crate::model::state::{FULL_ORDER, Input, InputSegment, State};
use crate::scalar::Real;

/// Events that one finest step may hold; more are left to the next step.
pub(super) const EVENTS_PER_STEP: usize = 8;

/// Takes a run over a part of one finest step, from a share of it to another, that may hold events.
///
/// Its parts are functions of their own: otherwise the stack would hold one while a mode's matrices are made.
#[cold]
pub(super) fn cross<T: Real, S: Stepper<T>>(
    stepper: &mut S,
    model: &Model<T>,
    run: &mut Run<T>,
    segment: &InputSegment<T>,
    elapsed: T,
    [mut done, until]: [T; 2],
    observe: &mut impl FnMut(T, &State<T>),
) {
    run.forget_motion();
    for _ in 0..EVENTS_PER_STEP {
        if !meet(stepper, model, run, segment, elapsed, &mut done, until, observe) {
            return;
        }
        stepper.enter(model, run);
    }
    finish(stepper, model, run, segment, elapsed, [done, until]);
}

/// Takes a run to the next event within a finest step, of which a part is done, and through it; without one until
/// another part is. True if there was one.
#[inline(never)]
#[expect(clippy::too_many_arguments, reason = "what a step needs, and its two ends")]
fn meet<T: Real, S: Stepper<T>>(
    stepper: &S,
    model: &Model<T>,
    run: &mut Run<T>,
    segment: &InputSegment<T>,
    elapsed: T,
    done: &mut T,
    until: T,
    observe: &mut impl FnMut(T, &State<T>),
) -> bool {
    let unit = stepper.unit();
    let input = segment.at(elapsed + unit * *done);
    let left = until - *done;
    let arc = Arc::ahead(stepper, model, run, &input, segment.force_rate);
    let state = run.state.changed(&arc.after(left));
    let end = elapsed + unit * until;
    let guards = Guards::at(model, &run.mode, &state, &segment.at(end), segment.time + end);
    let crossing = run.guards.first_crossing(&guards, model.has_extra_guards());
    let Some((index, guess)) = crossing else {
        run.state = state;
        run.guards = guards;
        run.ceiling = ceiling::<T, S>(0, arc.error);
        return false;
    };
    let at = |fraction: T| {
        let elapsed = elapsed + unit * (*done + left * fraction);
        (run.state.changed(&arc.after(left * fraction)), segment.at(elapsed), segment.time + elapsed)
    };
    // One secant step towards the crossing from the straight-line guess.
    let (state, there, time) = at(guess);
    let halfway = Guards::at(model, &run.mode, &state, &there, time);
    let fraction = run.guards.secant(&halfway, &guards, index, guess);
    let (state, input, now) = at(fraction);
    *done += left * fraction;
    run.state = state;
    run.steps += 3;
    run.events += 1;
    let share = (elapsed + unit * *done) / (unit * T::from_count(stepper.units()));
    observe(share, &run.state);
    model.switch(index, &mut run.mode, &mut run.state, &input);
    // What meets a stop has another velocity now.
    observe(share, &run.state);
    run.mode_number = run.mode.number();
    run.guards = Guards::at(model, &run.mode, &run.state, &input, now);
    true
}

/// Takes a run to the end of a part of a finest step that holds too many events (a rig that chatters), in the mode that
/// it is in.
#[inline(never)]
fn finish<T: Real, S: Stepper<T>>(
    stepper: &S,
    model: &Model<T>,
    run: &mut Run<T>,
    segment: &InputSegment<T>,
    elapsed: T,
    [done, until]: [T; 2],
) {
    let unit = stepper.unit();
    let input = segment.at(elapsed + unit * done);
    let arc = Arc::ahead(stepper, model, run, &input, segment.force_rate);
    run.state = run.state.changed(&arc.after(until - done));
    let end = elapsed + unit * until;
    run.guards = Guards::at(model, &run.mode, &run.state, &segment.at(end), segment.time + end);
}

/// The motion over a finest step, between its ends: the cubic through both, with the rates there. It is within the
/// step's fourth power.
struct Arc<T> {
    /// What the fraction of the step, its square and its cube add to each state.
    powers: [[T; FULL_ORDER]; 3],
    error: T,
}

impl<T: Real> Arc<T> {
    fn ahead<S: Stepper<T>>(
        stepper: &S,
        model: &Model<T>,
        run: &Run<T>,
        input: &Input<T>,
        force_rate: T,
    ) -> Self {
        let Step { state, error } = stepper.step(model, &run.mode, &run.state, input, force_rate, 0);
        let unit = stepper.unit();
        let end = Input {
            command: input.command + input.command_rate * unit,
            force: input.force + force_rate * unit,
            ..*input
        };
        let mut powers = [
            model.rate(&run.mode, &run.state, input).to_array(),
            state.since(&run.state).to_array(),
            model.rate(&run.mode, &state, &end).to_array(),
        ];
        let [first, second, third] = &mut powers;
        for ((first, second), third) in first.iter_mut().zip(second).zip(third) {
            *first *= unit;
            let bend = *second - *first;
            *third = (*third * unit - *second) - bend;
            *second = bend - *third;
        }
        Self { powers, error }
    }

    /// What a fraction of the step adds to the state at its start.
    fn after(&self, fraction: T) -> [T; FULL_ORDER] {
        let [first, second, third] = &self.powers;
        let mut change = [T::ZERO; FULL_ORDER];
        for (((change, first), second), third) in change.iter_mut().zip(first).zip(second).zip(third) {
            *change = fraction * (*first + fraction * (*second + fraction * *third));
        }
        change
    }
}
