//! Steps of a model whose laws are not all affine: the affine part exact, the rest by collocation.
//!
//! Inside a mode the model is `z' = A z + b u + c + e r(z)`: the affine rate, and what metering, Stribeck friction and
//! the like add to it at one or two places. Over a step `r` is taken as the parabola through its values at the start,
//! the middle and the end, and the affine model answers a parabola exactly, by matrices (see
//! `ladder.rs`). The values at the middle and the end are those of the model at the states that follow
//! from them: Newton's method finds them. The fast balance of ram and oil needs no short steps so: it is in `A`, and
//! in Newton's slopes where metering changes it.
//!
//! A parabola differs from the straight line between its ends by the value in the middle. What that moves the ram by is
//! the estimate of the error: far above the error itself, which falls with the fourth power of the step.

use super::ladder::{self, Cache, Growth, Moments, Rung};
use super::{Run, Step, Stepper};
use crate::model::Model;
use crate::model::curved::{Curved, Term};
use crate::model::state::{Input, Mode, PRESSURE, RAM, RAM_VELOCITY, State};
use crate::scalar::Real;

/// Lengths of step on a ladder, each twice the one below: 1 ms down to 1/256 ms. Events are met inside the finest, to the
/// fourth power of its length. Friction that falls as a ram breaks away can outdo the oil's damping (`FDJ/vs` of 2e6 N s/m
/// is a growth within 11 us): with 1/32 ms that was up to 2.4 um off the plant, in the same time.
const LEVELS: usize = 9;
/// Most iterations of Newton's method in a step.
const ITERATIONS: usize = 5;
/// Where Newton's method ends: its last change moves the ram by this part of the allowed error.
const CONVERGED: f64 = 0.05;

/// Distance from the middle at which a ram is thought to be where it is asked what the scalar tells apart there, m.
const TRAVEL: f64 = 0.1;

/// What the nodes of a parabola (start, middle, end) add to the state.
#[derive(Clone, Copy, Debug)]
struct Weights<T, const N: usize>([[T; N]; 3]);

impl<T: Real, const N: usize> Weights<T, N> {
    /// The answer after a time to a parabola over a step, from what powers of time add by then.
    fn new(constant: &[T; N], ramp: &[T; N], parabola: &[T; N], step: T) -> Self {
        // r = r0 + (-3 r0 + 4 rm - r1) s/h + (2 r0 - 4 rm + 2 r1) (s/h)^2
        let (first, second) = (T::ONE / step, T::literal(2.0) / (step * step));
        let weigh = |c: T, r: T, p: T| {
            core::array::from_fn(|row| c * constant[row] + r * first * ramp[row] + p * second * parabola[row])
        };
        let count = T::literal;
        Self([
            weigh(T::ONE, count(-3.0), count(2.0)),
            weigh(T::ZERO, count(4.0), count(-4.0)),
            weigh(T::ZERO, count(-1.0), count(2.0)),
        ])
    }

    fn add(&self, change: &mut [T; N], nodes: [T; 3]) {
        for (weights, value) in self.0.iter().zip(nodes) {
            for (change, &weight) in change.iter_mut().zip(weights) {
                *change += weight * value;
            }
        }
    }
}

/// The answers of one place where curved laws act, for one step length.
#[derive(Clone, Copy, Debug)]
struct Answer<T, const N: usize> {
    middle: Weights<T, N>,
    end: Weights<T, N>,
}

/// Affine parts on a ladder, from half the finest step on: the half of a step is the whole of the one below.
const RUNGS: usize = LEVELS + 1;

impl<T: Real, const N: usize> Answer<T, N> {
    const EMPTY: Self = Self { middle: Weights([[T::ZERO; N]; 3]), end: Weights([[T::ZERO; N]; 3]) };
}

/// The steps of one mode.
#[derive(Clone, Debug)]
struct Ladder<T, const N: usize> {
    /// The affine part.
    rungs: [Rung<T, N>; RUNGS],
    /// What the curved laws add, for each step length.
    answers: [Curved<Answer<T, N>>; LEVELS],
}

/// Steps for a model of `N` states, with matrices for `SLOTS` modes kept at a time.
#[derive(Clone, Debug)]
pub struct Collocation<T, const N: usize, const SLOTS: usize> {
    /// What is asked for, m, and what is allowed: no less than the scalar tells apart.
    tolerance: T,
    allowed: T,
    cache: Cache<T, Ladder<T, N>, N, RUNGS, SLOTS>,
}

impl<T: Real, const N: usize, const SLOTS: usize> Collocation<T, N, SLOTS> {
    /// Steps that err by less than some metres of ram position by their own estimate; by no more than the scalar tells
    /// apart, where that is more.
    pub const fn new(tolerance: T) -> Self {
        Self { tolerance, allowed: T::ZERO, cache: Cache::new() }
    }
}

impl<T: Real, const N: usize> ladder::Ladder<T, N, RUNGS> for Ladder<T, N> {
    const EMPTY: Self = Self {
        rungs: [Rung::EMPTY; RUNGS],
        answers: [Curved { force: Answer::EMPTY, pressure_rate: Answer::EMPTY }; LEVELS],
    };

    fn make(&mut self, model: &Model<T>, mode: &Mode, finest: T) {
        let (rest, layout) = (State::default(), model.layout());
        let column = |curved: Curved<T>| {
            model.rate_with(mode, &rest, &Input::default(), T::ZERO, &curved).leading::<N>(&layout)
        };
        let columns = [
            column(Curved { force: T::ONE, ..Curved::default() }),
            column(Curved { pressure_rate: T::ONE, ..Curved::default() }),
        ];
        let (mut growth, mut moments) = Growth::new(model, mode, finest * T::literal(0.5), columns);
        let [first, rungs @ ..] = &mut self.rungs;
        growth.lay(first);
        for (answers, rung) in self.answers.iter_mut().zip(rungs) {
            let step = growth.step + growth.step;
            let powers = |growth: &Growth<T, N>, moment: &Moments<T, N>| {
                let (constant, ramp) = (growth.constant_of(&moment.column), growth.ramp_of(&moment.column));
                Weights::new(&constant, &ramp, &moment.parabola, step)
            };
            let middle = [powers(&growth, &moments[0]), powers(&growth, &moments[1])];
            growth.double(&mut moments);
            let end = [powers(&growth, &moments[0]), powers(&growth, &moments[1])];
            let answer = |place: usize| Answer { middle: middle[place], end: end[place] };
            growth.lay(rung);
            *answers = Curved { force: answer(0), pressure_rate: answer(1) };
        }
    }

    fn rungs(&self) -> &[Rung<T, N>; RUNGS] {
        &self.rungs
    }
}

impl<T: Real, const N: usize, const SLOTS: usize> Stepper<T> for Collocation<T, N, SLOTS> {
    const TOP: usize = LEVELS - 1;
    const SHIFT: u32 = 1;
    const ESTIMATES: bool = true;

    fn takes(&self, model: &Model<T>) -> bool {
        model.order() <= N
    }

    fn begin(&mut self, sample_period: T, has_force: bool, rig_changed: bool) {
        self.allowed = self.tolerance.larger(T::RESOLUTION * T::literal(TRAVEL));
        self.cache.begin(sample_period, has_force, rig_changed, 1 << Self::TOP);
    }

    fn units(&self) -> u32 {
        self.cache.units
    }

    #[inline(always)]
    fn calm(&self) -> u32 {
        0
    }

    fn unit(&self) -> T {
        self.cache.finest
    }

    #[inline]
    fn enter(&mut self, model: &Model<T>, run: &Run<T>) {
        self.cache.enter(model, run);
    }

    fn step(
        &self,
        model: &Model<T>,
        mode: &Mode,
        state: &State<T>,
        input: &Input<T>,
        force_rate: T,
        level: usize,
    ) -> Step<T> {
        let Some(ladder) = self.cache.ladder() else { return Step::exact(*state) };
        let Some(answers) = ladder.answers.get(level) else { return Step::exact(*state) };
        let (force, layout) = (self.cache.force(force_rate), self.cache.layout);
        let affine = |rung: usize| {
            let (rung, terms) = ladder.rungs.get(rung).zip(self.cache.terms.get(rung))?;
            Some(rung.change(terms, layout, state, input, force.as_ref()))
        };
        let (Some(middle), Some(end)) = (affine(level), affine(level + 1)) else {
            return Step::exact(*state);
        };
        let start = model.curved(mode, state);
        let mut force = Nodes::constant(start.force);
        let mut pressure = Nodes::constant(start.pressure_rate);
        let mut moved = T::ZERO;
        let pressure_index = layout.index(PRESSURE);
        let allowed = self.allowed * T::literal(CONVERGED);
        for _ in 0..ITERATIONS {
            let (mut there, mut then) = (middle, end);
            answers.force.middle.add(&mut there, force.values);
            answers.force.end.add(&mut then, force.values);
            if pressure_index.is_some() {
                answers.pressure_rate.middle.add(&mut there, pressure.values);
                answers.pressure_rate.end.add(&mut then, pressure.values);
            }
            let there = model.curved(mode, &state.moved(&there, &layout));
            let then = model.curved(mode, &state.moved(&then, &layout));
            moved = force.improve(&answers.force, RAM_VELOCITY, [there.force, then.force]);
            if let Some(index) = pressure_index {
                moved += pressure.improve(
                    &answers.pressure_rate,
                    index,
                    [there.pressure_rate, then.pressure_rate],
                );
            }
            if moved <= allowed {
                break;
            }
        }
        let mut change = end;
        answers.force.end.add(&mut change, force.values);
        let mut error = force.bend(&answers.force) + moved;
        if pressure_index.is_some() {
            answers.pressure_rate.end.add(&mut change, pressure.values);
            error += pressure.bend(&answers.pressure_rate);
        }
        Step { state: state.moved(&change, &layout), error: error / self.allowed }
    }
}

/// The values of a curved term at the start, the middle and the end of a step.
struct Nodes<T> {
    values: [T; 3],
}

impl<T: Real> Nodes<T> {
    fn constant(term: Term<T>) -> Self {
        Self { values: [term.value; 3] }
    }

    /// One step of Newton's method towards the terms that the states have; `place` is the entry of the state that the
    /// slopes refer to. Returns by how much it moves the ram, m.
    fn improve<const N: usize>(&mut self, answer: &Answer<T, N>, place: usize, terms: [Term<T>; 2]) -> T {
        let [middle, end] = terms;
        let [_, by_middle, by_end] = &answer.middle.0;
        let [_, end_by_middle, end_by_end] = &answer.end.0;
        // Not an index: a place that is known at run time only would leave a panic behind.
        let at = |row: &[T; N]| row.get(place).copied().unwrap_or(T::ZERO);
        let (a, b) = (T::ONE - middle.slope * at(by_middle), -middle.slope * at(by_end));
        let (c, d) = (-end.slope * at(end_by_middle), T::ONE - end.slope * at(end_by_end));
        let (p, q) = (middle.value - self.values[1], end.value - self.values[2]);
        let factor = T::ONE / (a * d - b * c);
        let (first, second) = ((p * d - b * q) * factor, (a * q - c * p) * factor);
        self.values[1] += first;
        self.values[2] += second;
        (end_by_middle[RAM] * first).magnitude() + (end_by_end[RAM] * second).magnitude()
    }

    /// How far the ram moves because the parabola is not straight, m.
    fn bend<const N: usize>(&self, answer: &Answer<T, N>) -> T {
        let [start, middle, end] = self.values;
        (answer.end.0[1][RAM] * (middle - (start + end) * T::literal(0.5))).magnitude()
    }
}
