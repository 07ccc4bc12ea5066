//! Takes a model from one sample to the next.
//!
//! [`advance`] owns what every integrator needs: it steps, looks at the guards, goes to the crossing where one turned
//! negative, switches the mode and goes on. A [`Stepper`] owns the step inside one mode: [`exact::Exact`] by
//! transition matrices for piecewise affine models, [`collocation::Collocation`] by transition matrices and a
//! parabola for what is curved, [`midpoint::Midpoint`] by a second-order rule of fixed step for every model.

pub mod collocation;
mod crossing;
pub mod exact;
mod guards;
mod ladder;
pub mod midpoint;
pub mod observed;

use crate::model::Model;
use crate::model::corridor::{Corridor, Detour, Passage, Passing, WATCHED, Watched};
use crate::model::state::{FULL_ORDER, Input, InputSegment, Mode, State};
use crate::scalar::Real;
use crossing::{EVENTS_PER_STEP, cross};
use guards::Guards;

/// Error of a step, in units of what is allowed, below which one of the next level is tried: twice as long, it errs
/// some eight times as much.
const ROOM: f64 = 0.1;

/// A model's place in its motion: everything that changes as it runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Run<T> {
    /// State.
    pub state: State<T>,
    /// Mode.
    pub mode: Mode,
    /// Its number: whether it is the one that a stepper is in is asked at every sample.
    mode_number: u32,
    /// Guards at the state, kept from the step before.
    guards: Guards<T>,
    /// A quarter of what each guard fell by in a finest step on the way here; zero after an event.
    fall: Guards<T>,
    /// Are these two of the present place? Not where the last step kept to the corridor of its mode.
    has_guards: bool,
    /// What each watched quantity changed by on the way here, for a step of `stride` finest ones; zero after an event.
    swing: Watched<T>,
    stride: u32,
    /// Samples that are to be looked at one by one, because a look at all of them was not enough.
    wary: u32,
    /// Finest steps since the last event.
    calm: u32,
    /// Coarsest level with which the next sample may begin.
    entry: usize,
    /// Coarsest level of a step that the error of the last ones lets expect to be good.
    ceiling: usize,
    /// Mode changes so far.
    pub events: u32,
    /// Steps taken so far, rejected ones included.
    pub steps: u32,
}

impl<T: Real> Run<T> {
    /// What holds a run later: all zeros.
    pub const IDLE: Self = Self {
        state: State::from_array([T::ZERO; FULL_ORDER]),
        mode: Mode::INTERIOR,
        mode_number: 0,
        guards: Guards::NONE,
        fall: Guards::NONE,
        has_guards: false,
        swing: [T::ZERO; WATCHED],
        stride: 0,
        wary: 0,
        entry: 0,
        calm: 0,
        ceiling: 0,
        events: 0,
        steps: 0,
    };

    /// A run that starts from a state and mode.
    pub fn starting(model: &Model<T>, state: State<T>, mode: Mode, input: &Input<T>) -> Self {
        let mut run = Self {
            state,
            mode,
            mode_number: mode.number(),
            guards: Guards::NONE,
            fall: Guards::NONE,
            has_guards: true,
            swing: [T::ZERO; WATCHED],
            stride: 1,
            wary: 0,
            entry: usize::MAX,
            calm: u32::MAX,
            ceiling: usize::MAX,
            events: 0,
            steps: 0,
        };
        run.guards = Guards::at(model, &run.mode, &run.state, input, T::ZERO);
        run
    }

    /// Makes up for the guards of steps that kept to a corridor.
    fn catch_up(
        &mut self,
        model: &Model<T>,
        corridor: Option<&Corridor<T>>,
        segment: &InputSegment<T>,
        elapsed: T,
    ) {
        let (input, time) = (segment.at(elapsed), segment.time + elapsed);
        self.guards = Guards::at(model, &self.mode, &self.state, &input, time);
        self.fall = Guards::NONE;
        if let Some(corridor) = corridor {
            let (state, input) = corridor.before(&self.state, &input, &self.swing);
            let mut before = Guards::at(model, &self.mode, &state, &input, time);
            let now = self.guards;
            before.accept(&mut self.fall, &now, T::from_count(self.stride), false);
        }
        self.has_guards = true;
    }

    /// What the motion was like on the way here is not what it will be like.
    fn forget_motion(&mut self) {
        self.fall = Guards::NONE;
        self.swing = [T::ZERO; WATCHED];
    }

    /// The command jumps at a sample: what that violates changes the mode on the spot. The stepper has entered the mode.
    ///
    /// A jump that is so small that nothing can come of it, whatever it sets going, is taken in passing, such as each one
    /// of a smooth command that is held from sample to sample.
    #[inline(never)]
    pub fn jump<S: Stepper<T>>(
        &mut self,
        stepper: &S,
        model: &Model<T>,
        from: &Input<T>,
        to: &Input<T>,
        time: T,
    ) {
        if let Some(corridor) = stepper.corridor() {
            let (swing, answer) = (&self.swing, stepper.answer(corridor));
            // Margins are a quarter of the change: room for twice the answer.
            let jump = (to.command - from.command).magnitude() * T::literal(8.0);
            let change = core::array::from_fn(|index| swing[index].magnitude() + answer[index] * jump);
            if corridor.has_margin(&corridor.watched(&self.state, to), &change) {
                self.has_guards = false;
                return;
            }
        }
        self.meet(model, from, to, time);
    }

    /// The input jumps: what that violates changes the mode on the spot.
    #[cold]
    #[inline(never)]
    fn meet(&mut self, model: &Model<T>, from: &Input<T>, to: &Input<T>, time: T) {
        let at = |run: &Self, input: &Input<T>| Guards::at(model, &run.mode, &run.state, input, time);
        self.guards = at(self, to);
        for _ in 0..EVENTS_PER_STEP {
            let crossing = at(self, from).first_crossing(&self.guards, model.has_extra_guards());
            let Some((index, _)) = crossing else { break };
            model.switch(index, &mut self.mode, &mut self.state, to);
            self.events += 1;
            self.guards = at(self, to);
        }
        self.mode_number = self.mode.number();
        self.forget_motion();
        (self.stride, self.has_guards) = (1, true);
        // What a jump sets going, no step before tells of.
        (self.calm, self.entry) = (0, 0);
    }

    /// A run that starts at rest at a ram position.
    pub fn at_rest(model: &Model<T>, ram: T, input: &Input<T>) -> Self {
        Self::starting(model, model.at_rest(ram), model.mode_at_rest(), input)
    }
}

/// What a swing over steps of a length is over steps of another.
#[inline(never)]
fn rescaled<T: Real>(swing: &Watched<T>, [from, to]: [u32; 2]) -> Watched<T> {
    let ratio = T::from_count(to) / T::from_count(from);
    swing.map(|value| value * ratio)
}

/// A state at the end of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step<T> {
    /// The state.
    pub state: State<T>,
    /// Estimate of its error in units of what is allowed: above 1 the step is taken in shorter ones, if it can be.
    pub error: T,
}

impl<T: Real> Step<T> {
    /// A step whose error is not in question.
    #[inline(always)]
    pub const fn exact(state: State<T>) -> Self {
        Self { state, error: T::ZERO }
    }
}

/// A rule that takes a state over a step inside one mode.
pub trait Stepper<T: Real> {
    /// Coarsest level.
    const TOP: usize;
    /// A step of level `l` is `2^(SHIFT l)` finest steps long.
    const SHIFT: u32;
    /// Do its steps say how far they err? Otherwise they are exact, or of a fixed length.
    const ESTIMATES: bool = false;

    /// Can it step a model?
    fn takes(&self, model: &Model<T>) -> bool;

    /// Gets ready for a run: the sample period, s, whether a force input is ever not zero, and whether a parameter
    /// that reaches the dynamics has changed since the last run. Of a stepper that is handed from one rig to another it
    /// has: what it keeps would be taken for the other's.
    fn begin(&mut self, sample_period: T, has_force: bool, rig_changed: bool);

    /// Finest steps in one sample.
    fn units(&self) -> u32;

    /// Finest steps without an event after which coarser ones are taken again.
    fn calm(&self) -> u32;

    /// Length of a finest step, s.
    fn unit(&self) -> T;

    /// The mode of a run has changed (or the run is new here).
    fn enter(&mut self, model: &Model<T>, run: &Run<T>);

    /// The corridor of the mode that was entered last; none: the guards themselves are looked at.
    #[inline(always)]
    fn corridor(&self) -> Option<&Corridor<T>> {
        None
    }

    /// By how much what a corridor watches may move in a coarsest step after a jump of the command, for each m of it.
    #[inline(always)]
    fn answer(&self, _corridor: &Corridor<T>) -> Watched<T> {
        [T::ONE / T::ZERO; WATCHED]
    }

    /// Takes a run over whole samples, each of them one step, as long as they keep to the corridor of the mode that was
    /// entered last; returns their number. `command` is that at the start, `commands` gives that at the end of each
    /// sample (none: enough), `see` is shown what there is to see. At most `most` steps are taken, those included that are
    /// taken again because a look at several samples was not enough. The usual case, at half its price elsewhere.
    #[inline(always)]
    fn glide(
        &self,
        _run: &mut Run<T>,
        _command: T,
        _most: u32,
        _commands: impl FnMut(u32) -> Option<T>,
        _see: impl FnMut(&Passing<T>),
    ) -> u32 {
        0
    }

    /// Steps without which [`glide`](Self::glide) does not go on from here.
    #[inline(always)]
    fn piece(&self, _run: &Run<T>) -> u32 {
        1
    }

    /// The state after a step of a level in the mode that was entered last.
    fn step(
        &self,
        model: &Model<T>,
        mode: &Mode,
        state: &State<T>,
        input: &Input<T>,
        force_rate: T,
        level: usize,
    ) -> Step<T>;
}

/// Advances a run by one sample.
///
/// `observe` is called with the share of the sample that has passed and the state at every turning point and at the end of
/// the sample, in order of time: what an operator behind the ram needs to see. Bounded: at most `2 * units` steps of the
/// stepper and three parts for each of the 8 events that one of its finest steps may hold.
#[inline]
pub fn advance<T: Real, S: Stepper<T>>(
    stepper: &mut S,
    model: &Model<T>,
    run: &mut Run<T>,
    segment: &InputSegment<T>,
    mut observe: impl FnMut(T, &State<T>),
) {
    if let Some(mut place) = start(stepper, model, run, segment) {
        divide(stepper, model, run, segment, &mut place, u32::MAX, &mut observe);
    } else {
        observe(T::ONE, &run.state);
    }
}

/// Advances a run by one sample inside of which the command jumps from one line to another: `part` of it comes before the
/// jump, from 0 to below 1. All of it is taken in finest steps.
#[cold]
pub fn advance_over_jump<T: Real, S: Stepper<T>>(
    stepper: &mut S,
    model: &Model<T>,
    run: &mut Run<T>,
    [before, after]: [&InputSegment<T>; 2],
    part: T,
    mut observe: impl FnMut(T, &State<T>),
) {
    stepper.enter(model, run);
    if model.guards_see_command_rate() {
        meet_rate(stepper, model, run, before);
    }
    let units = stepper.units();
    let at = part * T::from_count(units);
    let mut whole = 0;
    while whole + 1 < units && T::from_count(whole + 1) <= at {
        step_finely(stepper, model, run, before, whole, &mut observe);
        whole += 1;
    }
    let (elapsed, share) = (stepper.unit() * T::from_count(whole), at - T::from_count(whole));
    if !run.has_guards {
        run.catch_up(model, None, before, elapsed);
    }
    cross(stepper, model, run, before, elapsed, [T::ZERO, share], &mut observe);
    observe(part, &run.state);
    let jump = elapsed + stepper.unit() * share;
    run.meet(model, &before.at(jump), &after.at(jump), before.time + jump);
    stepper.enter(model, run);
    cross(stepper, model, run, after, elapsed, [share, T::ONE], &mut observe);
    observe(share_of(stepper, whole + 1), &run.state);
    for position in whole + 1..units {
        step_finely(stepper, model, run, after, position, &mut observe);
    }
}

/// Takes a run over one finest step.
fn step_finely<T: Real, S: Stepper<T>>(
    stepper: &mut S,
    model: &Model<T>,
    run: &mut Run<T>,
    segment: &InputSegment<T>,
    position: u32,
    observe: &mut impl FnMut(T, &State<T>),
) {
    if !attempt(stepper, model, run, segment, position, 0) {
        cross_all(stepper, model, run, segment, position, observe);
    }
    observe(share_of(stepper, position + 1), &run.state);
}

/// Share of a sample that has passed at a place inside it.
#[inline(always)]
fn share_of<T: Real, S: Stepper<T>>(stepper: &S, position: u32) -> T {
    T::from_count(position) / T::from_count(stepper.units())
}

/// Takes a run over the finest step at a position, which holds an event.
fn cross_all<T: Real, S: Stepper<T>>(
    stepper: &mut S,
    model: &Model<T>,
    run: &mut Run<T>,
    segment: &InputSegment<T>,
    position: u32,
    observe: &mut impl FnMut(T, &State<T>),
) {
    let elapsed = stepper.unit() * T::from_count(position);
    cross(stepper, model, run, segment, elapsed, [T::ZERO, T::ONE], observe);
    run.calm = 0;
}

/// Takes a run over one sample in one step, the usual case; where that cannot be, the place to go on from.
#[inline(always)]
fn start<T: Real, S: Stepper<T>>(
    stepper: &mut S,
    model: &Model<T>,
    run: &mut Run<T>,
    segment: &InputSegment<T>,
) -> Option<Place> {
    stepper.enter(model, run);
    if model.guards_see_command_rate() {
        meet_rate(stepper, model, run, segment);
    }
    // Straight code, not the first round of a loop: there the compiler would fetch all that the model is made of ahead.
    let level = if run.calm < stepper.calm() {
        0
    } else if S::ESTIMATES {
        S::TOP.min(run.ceiling)
    } else {
        S::TOP
    };
    let entry = core::mem::replace(&mut run.entry, usize::MAX);
    if level < S::TOP || stepper.units() != size::<T, S>(S::TOP) {
        return Some(Place::first(level.min(entry)));
    }
    if entry >= S::TOP && attempt(stepper, model, run, segment, 0, S::TOP) {
        return None;
    }
    Some(Place::first(S::TOP.saturating_sub(1).min(entry).min(run.ceiling)))
}

/// The rate of the command may have jumped with the sample, and ended a mode on the spot.
#[inline(never)]
fn meet_rate<T: Real, S: Stepper<T>>(
    stepper: &mut S,
    model: &Model<T>,
    run: &mut Run<T>,
    segment: &InputSegment<T>,
) {
    let here = |run: &Run<T>| Guards::at(model, &run.mode, &run.state, &segment.start, segment.time);
    let guards = here(run);
    if let Some((index, _)) = run.guards.first_crossing(&guards, model.has_extra_guards()) {
        model.switch(index, &mut run.mode, &mut run.state, &segment.start);
        run.mode_number = run.mode.number();
        run.events += 1;
        run.forget_motion();
        run.guards = here(run);
        stepper.enter(model, run);
    } else {
        run.guards = guards;
    }
}

/// A place inside a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Finest steps from the start of the sample.
    position: u32,
    /// Level of the next step.
    level: usize,
    /// Does that hold an event? It is a finest one then.
    is_crossed: bool,
    /// Is it a place at all? A flag, not an `Option` around: what holds a place is all zeros before there is one.
    is_inside: bool,
}

impl Place {
    /// None: before a sample.
    pub const BEFORE: Self = Self { position: 0, level: 0, is_crossed: false, is_inside: false };

    /// From the start of a sample on.
    const fn first(level: usize) -> Self {
        Self { level, is_inside: true, ..Self::BEFORE }
    }

    /// Is it inside a sample?
    pub const fn is_inside(&self) -> bool {
        self.is_inside
    }
}

/// Most steps that cannot be parted: those over a finest step that is full of events.
pub const LONGEST_PIECE: u32 = 3 * EVENTS_PER_STEP as u32;

/// Advances a run by one sample as [`advance`] does, but by at most `allowance` steps now.
///
/// True at the end of the sample. Otherwise `place` says where it goes on with the next call. It begins no sample that
/// [`Stepper::glide`] might take on a larger allowance, and goes nowhere on none.
#[inline]
pub fn advance_some<T: Real, S: Stepper<T>>(
    stepper: &mut S,
    model: &Model<T>,
    run: &mut Run<T>,
    segment: &InputSegment<T>,
    place: &mut Place,
    allowance: u32,
    mut observe: impl FnMut(T, &State<T>),
) -> bool {
    if !place.is_inside && allowance < stepper.piece(run) {
        return false;
    }
    let most = run.steps.saturating_add(allowance);
    if place.is_inside {
        stepper.enter(model, run);
    } else if let Some(first) = start(stepper, model, run, segment) {
        *place = first;
    } else {
        observe(T::ONE, &run.state);
        return true;
    }
    let done = divide(stepper, model, run, segment, place, most, &mut observe);
    if done {
        *place = Place::BEFORE;
    }
    done
}

/// Finest steps in a step of a level.
const fn size<T: Real, S: Stepper<T>>(level: usize) -> u32 {
    1 << (S::SHIFT * level as u32)
}

/// Takes a run a step further, unless that step must be refined. A finest step is refused only where it holds an event.
#[inline(never)]
fn attempt<T: Real, S: Stepper<T>>(
    stepper: &S,
    model: &Model<T>,
    run: &mut Run<T>,
    segment: &InputSegment<T>,
    position: u32,
    level: usize,
) -> bool {
    let size = size::<T, S>(level);
    let begin = stepper.unit() * T::from_count(position);
    let input = if position == 0 { segment.start } else { segment.at(begin) };
    let Step { state, error } = stepper.step(model, &run.mode, &run.state, &input, segment.force_rate, level);
    run.steps += 1;
    if S::ESTIMATES && level > 0 && error > T::ONE {
        run.ceiling = level - 1;
        return false;
    }
    let end = stepper.unit() * T::from_count(position + size);
    // What only the guards need is made where they are looked at, not ahead of it.
    let inspect = |run: &mut Run<T>, corridor| {
        inspect(model, run, segment, &state.clone(), &Span { begin, end, size, level }, corridor)
    };
    if let Some(corridor) = stepper.corridor() {
        let before = corridor.watched(&run.state, &input);
        let after = corridor.watched(&state, &segment.at(end));
        let change: Watched<T> = core::array::from_fn(|index| after[index] - before[index]);
        let is_clear = if level > 0 {
            let swing = rescaled(&run.swing, [run.stride, size]);
            if !corridor.keeps(&before, &after, &swing, &Detour::default()) {
                return false;
            }
            true
        } else {
            match corridor.passage(&before, &after) {
                Passage::Clear => true,
                Passage::Close if inspect(run, Some(corridor)) => false,
                Passage::Close => return false,
                Passage::Left => {
                    run.catch_up(model, None, segment, begin);
                    return false;
                }
            }
        };
        if is_clear {
            run.state.take_base(&state);
            run.has_guards = false;
        }
        (run.swing, run.stride) = (change, size);
    } else if !inspect(run, None) {
        return false;
    }
    if stepper.calm() > 0 {
        run.calm = run.calm.saturating_add(size);
    }
    if S::ESTIMATES {
        run.ceiling = ceiling::<T, S>(level, error);
    }
    true
}

/// A step inside a sample.
struct Span<T> {
    /// Its ends, s after the start of the sample.
    begin: T,
    end: T,
    /// Its length in finest steps.
    size: u32,
    level: usize,
}

/// Takes a run to the end of a step, unless the guards say that the step must be refined.
#[inline(never)]
fn inspect<T: Real>(
    model: &Model<T>,
    run: &mut Run<T>,
    segment: &InputSegment<T>,
    state: &State<T>,
    span: &Span<T>,
    corridor: Option<&Corridor<T>>,
) -> bool {
    if !run.has_guards {
        run.catch_up(model, corridor, segment, span.begin);
    }
    let guards = Guards::at(model, &run.mode, state, &segment.at(span.end), segment.time + span.end);
    let length = T::from_count(span.size);
    let has_extra = model.has_extra_guards();
    if !run.guards.all_clear(&run.fall, &guards, length, has_extra)
        && run.guards.must_refine(&run.fall, &guards, length, span.level > 0)
    {
        return false;
    }
    run.state = *state;
    run.guards.accept(&mut run.fall, &guards, length, has_extra);
    true
}

/// Coarsest level of the next step, after one of a level with an error.
#[inline(always)]
fn ceiling<T: Real, S: Stepper<T>>(level: usize, error: T) -> usize {
    if error == T::ZERO {
        S::TOP
    } else if error < T::literal(ROOM) {
        level + 1
    } else {
        level
    }
}

/// Takes a run over one sample in several steps from a place on, until `most` steps may have been taken. True at the end of
/// the sample.
#[inline(never)]
fn divide<T: Real, S: Stepper<T>>(
    stepper: &mut S,
    model: &Model<T>,
    run: &mut Run<T>,
    segment: &InputSegment<T>,
    place: &mut Place,
    most: u32,
    observe: &mut impl FnMut(T, &State<T>),
) -> bool {
    let units = stepper.units();
    let Place { mut position, mut level, mut is_crossed, is_inside } = *place;
    while position < units {
        if !is_crossed {
            if run.steps >= most {
                *place = Place { position, level, is_crossed, is_inside };
                return false;
            }
            if !attempt(stepper, model, run, segment, position, level) {
                if level > 0 {
                    level = run.ceiling.min(level - 1);
                    continue;
                }
                is_crossed = true;
            }
        }
        if is_crossed {
            if most.saturating_sub(run.steps) < LONGEST_PIECE {
                *place = Place { position, level, is_crossed, is_inside };
                return false;
            }
            cross_all(stepper, model, run, segment, position, observe);
            is_crossed = false;
        }
        position += size::<T, S>(level);
        observe(share_of(stepper, position), &run.state);
        while level < S::TOP.min(run.ceiling)
            && run.calm >= stepper.calm()
            && position.is_multiple_of(size::<T, S>(level + 1))
        {
            level += 1;
        }
    }
    if !S::ESTIMATES {
        run.ceiling = S::TOP;
    }
    true
}
