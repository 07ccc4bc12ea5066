//! Takes a model from one sample to the next.
//!
//! [`advance`] owns what every integrator needs: it steps, looks at the guards, goes to the crossing where one turned
//! negative, switches the mode and goes on. A [`Stepper`] owns the step inside one mode: [`exact::Exact`] by
//! transition matrices for piecewise affine models, [`midpoint::Midpoint`] by a second-order rule for every model.

pub mod exact;
pub mod midpoint;

use crate::model::state::{Input, InputSegment, Mode, State};
use crate::model::{EXTRA_GUARDS, LOOP_GUARDS, Model};
use crate::scalar::Real;

/// Events that one finest step may hold; more are left to the next step.
const EVENTS_PER_STEP: usize = 8;

/// A model's place in its motion: everything that changes as it runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Run<T> {
    /// State.
    pub state: State<T>,
    /// Mode.
    pub mode: Mode,
    /// Guards at the state, kept from the step before.
    guards: Guards<T>,
    /// A quarter of what each guard fell by in a finest step on the way here; zero after an event.
    fall: Guards<T>,
    /// Finest steps since the last event.
    calm: u32,
    /// Mode changes so far.
    pub events: u32,
    /// Steps taken so far, rejected ones included.
    pub steps: u32,
}

impl<T: Real> Run<T> {
    /// A run that starts from a state and mode.
    pub fn starting(model: &Model<T>, state: State<T>, mode: Mode, input: &Input<T>) -> Self {
        let mut run = Self {
            state,
            mode,
            guards: Guards::default(),
            fall: Guards::default(),
            calm: u32::MAX,
            events: 0,
            steps: 0,
        };
        run.guards = Guards::at(model, &run.mode, &run.state, input, T::ZERO);
        run
    }

    /// A run that starts at rest at a ram position.
    pub fn at_rest(model: &Model<T>, ram: T, input: &Input<T>) -> Self {
        Self::starting(model, model.at_rest(ram), model.mode_at_rest(), input)
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Guards<T> {
    plain: [T; LOOP_GUARDS],
    extra: [T; EXTRA_GUARDS],
}

impl<T: Real> Guards<T> {
    #[inline(always)]
    fn at(model: &Model<T>, mode: &Mode, state: &State<T>, input: &Input<T>, time: T) -> Self {
        let extra = if model.has_extra_guards() {
            model.extra_guards(mode, state, input, time)
        } else {
            [T::ONE; EXTRA_GUARDS]
        };
        Self { plain: model.loop_guards(mode, state, input), extra }
    }

    #[inline(always)]
    fn any_violated(&self, after: &Self) -> bool {
        let mut violated = false;
        let mut index = 0;
        while index < LOOP_GUARDS {
            violated |= Model::<T>::is_violated(index, self.plain[index], after.plain[index]);
            index += 1;
        }
        let mut index = 0;
        while index < EXTRA_GUARDS {
            violated |= Model::<T>::is_violated(LOOP_GUARDS + index, self.extra[index], after.extra[index]);
            index += 1;
        }
        violated
    }

    /// May a guard that is positive at both ends of a step have been negative inside? A parabola through three
    /// equally spaced points dips by an eighth of its fall over the first two; twice that is looked out for.
    #[inline(always)]
    fn may_dip(&self, fall: &Self, after: &Self, size: T) -> bool {
        let mut dips = false;
        let mut index = 0;
        while index < LOOP_GUARDS {
            dips |= self.plain[index].smaller(after.plain[index]) < fall.plain[index] * size;
            index += 1;
        }
        let mut index = 0;
        while index < EXTRA_GUARDS {
            dips |= self.extra[index].smaller(after.extra[index]) < fall.extra[index] * size;
            index += 1;
        }
        dips
    }

    /// A quarter of the fall from here to `after` for each finest step of `size` of them.
    #[inline(always)]
    fn fall(&self, after: &Self, size: T) -> Self {
        let weight = T::literal(0.25) / size;
        let mut fall = Self::default();
        let mut index = 0;
        while index < LOOP_GUARDS {
            fall.plain[index] = (self.plain[index] - after.plain[index]) * weight;
            index += 1;
        }
        let mut index = 0;
        while index < EXTRA_GUARDS {
            fall.extra[index] = (self.extra[index] - after.extra[index]) * weight;
            index += 1;
        }
        fall
    }

    fn get(&self, index: usize) -> T {
        self.plain.iter().chain(&self.extra).nth(index).copied().unwrap_or(T::ONE)
    }

    /// A better fraction for the crossing of guard `index`, from its values at both ends and at a first guess.
    fn secant(&self, at_guess: &Self, after: &Self, index: usize, guess: T) -> T {
        let value = at_guess.get(index);
        let (end, there) =
            if value < T::ZERO { (T::ZERO, self.get(index)) } else { (T::ONE, after.get(index)) };
        let slope = there - value;
        if guess <= T::ZERO || guess >= T::ONE || slope == T::ZERO || (value < T::ZERO) == (there < T::ZERO) {
            return guess;
        }
        guess - value * (end - guess) / slope
    }

    /// The guard that is crossed first, and the fraction of the step at which it is, by linear interpolation.
    fn first_crossing(&self, after: &Self) -> Option<(usize, T)> {
        let before = self.plain.iter().chain(&self.extra);
        let mut first: Option<(usize, T)> = None;
        for (index, (&before, &after)) in before.zip(after.plain.iter().chain(&after.extra)).enumerate() {
            if Model::<T>::is_violated(index, before, after) {
                let fraction = if before > T::ZERO { before / (before - after) } else { T::ZERO };
                if first.is_none_or(|(_, earliest)| fraction < earliest) {
                    first = Some((index, fraction));
                }
            }
        }
        first
    }
}

/// A rule that takes a state over a step inside one mode.
pub trait Stepper<T: Real> {
    /// Finest steps without an event after which coarser ones are taken again.
    const CALM: u32;

    /// Coarsest level: a step of level `l` is `4^l` finest steps long.
    const TOP: usize;

    /// Gets ready for a run: the sample period, s, whether a force input is ever not zero, and whether a parameter
    /// that reaches the dynamics has changed since the last run.
    fn begin(&mut self, sample_period: T, has_force: bool, rig_changed: bool);

    /// Finest steps in one sample.
    fn units(&self) -> u32;

    /// Length of a finest step, s.
    fn unit(&self) -> T;

    /// The mode of a run has changed (or the run is new here).
    fn enter(&mut self, model: &Model<T>, mode: &Mode);

    /// The state after a step of a level.
    fn step(&self, model: &Model<T>, run: &Run<T>, input: &Input<T>, force_rate: T, level: usize)
    -> State<T>;

    /// The state after a fraction (0 to 1) of a finest step.
    fn part(&self, model: &Model<T>, run: &Run<T>, input: &Input<T>, force_rate: T, fraction: T) -> State<T>;
}

/// Advances a run by one sample.
///
/// `observe` is called with the ram position over ground at every turning point and at the end of the sample, in order of time:
/// what a rate-independent operator behind the ram needs to see. Bounded: at most `2 * units` steps of the stepper
/// and three parts for each of the 8 events that one of its finest steps may hold.
#[inline]
pub fn advance<T: Real, S: Stepper<T>>(
    stepper: &mut S,
    model: &Model<T>,
    run: &mut Run<T>,
    segment: &InputSegment<T>,
    mut observe: impl FnMut(T),
) {
    let (units, unit) = (stepper.units(), stepper.unit());
    stepper.enter(model, &run.mode);
    if model.guards_see_command_rate() {
        // The rate may have jumped with the sample.
        run.guards = Guards::at(model, &run.mode, &run.state, &segment.start, segment.time);
    }
    let mut position: u32 = 0;
    let mut level = if run.calm < S::CALM { 0 } else { S::TOP };
    while position < units {
        let size = 1_u32 << (2 * level);
        let elapsed = unit * T::from_count(position);
        let input = segment.at(elapsed);
        let state = stepper.step(model, run, &input, segment.force_rate, level);
        run.steps += 1;
        let end = unit * T::from_count(position + size);
        let guards = Guards::at(model, &run.mode, &state, &segment.at(end), segment.time + end);
        let length = T::from_count(size);
        let violated = run.guards.any_violated(&guards);
        if violated || (level > 0 && run.guards.may_dip(&run.fall, &guards, length)) {
            if level > 0 {
                level -= 1;
                continue;
            }
            cross(stepper, model, run, segment, elapsed, &mut observe);
            run.calm = 0;
        } else {
            run.calm = run.calm.saturating_add(size);
            run.state = state;
            if S::TOP > 0 {
                run.fall = run.guards.fall(&guards, length);
            }
            run.guards = guards;
        }
        observe(run.state.ground());
        position += size;
        while level < S::TOP && run.calm >= S::CALM && position.is_multiple_of(4 << (2 * level)) {
            level += 1;
        }
    }
}

/// Takes a run over one finest step that holds at least one event.
#[cold]
fn cross<T: Real, S: Stepper<T>>(
    stepper: &mut S,
    model: &Model<T>,
    run: &mut Run<T>,
    segment: &InputSegment<T>,
    elapsed: T,
    observe: &mut impl FnMut(T),
) {
    let unit = stepper.unit();
    run.fall = Guards::default();
    let mut done = T::ZERO;
    for _ in 0..EVENTS_PER_STEP {
        let input = segment.at(elapsed + unit * done);
        let left = T::ONE - done;
        let state = stepper.part(model, run, &input, segment.force_rate, left);
        let end = elapsed + unit;
        let guards = Guards::at(model, &run.mode, &state, &segment.at(end), segment.time + end);
        let Some((index, guess)) = run.guards.first_crossing(&guards) else {
            run.state = state;
            run.guards = guards;
            return;
        };
        // One secant step towards the crossing from the straight-line guess.
        let at = |fraction: T| {
            let done = done + left * fraction;
            let state = stepper.part(model, run, &input, segment.force_rate, left * fraction);
            (state, segment.at(elapsed + unit * done), elapsed + unit * done)
        };
        let (state, there, time) = at(guess);
        let halfway = Guards::at(model, &run.mode, &state, &there, segment.time + time);
        let fraction = run.guards.secant(&halfway, &guards, index, guess);
        let (state, input, now) = at(fraction);
        done += left * fraction;
        run.state = state;
        run.steps += 3;
        run.events += 1;
        observe(run.state.ground());
        model.switch(index, &mut run.mode, &mut run.state, &input);
        run.guards = Guards::at(model, &run.mode, &run.state, &input, segment.time + now);
        stepper.enter(model, &run.mode);
    }
    // Too many events in one step (a rig that chatters): finish it in the mode that it is in.
    let input = segment.at(elapsed + unit * done);
    run.state = stepper.part(model, run, &input, segment.force_rate, T::ONE - done);
    let end = elapsed + unit;
    run.guards = Guards::at(model, &run.mode, &run.state, &segment.at(end), segment.time + end);
}
