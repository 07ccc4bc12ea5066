//! Transition matrices of one mode, for steps of several lengths.
//!
//! Inside a mode the affine part of the model is `z' = A z + b u + c` with an input that is linear over a sample, so a
//! step of any length is one matrix product. `A`, `b` and `c` are read off [`Model::affine_rate`].
//!
//! A product is kept as increments, `exp(A h) - 1`, which loses nothing to rounding where `exp(A h)` is close to 1:
//! in `f32` this keeps a simulated second within some nanometres of `f64`. For the same reason ram and command enter
//! as their difference: a loop that does not know where it is (no spring load) then has a column of exact zeros.
//!
//! The matrices depend on the rig; `FDJ` and `BKL` do not change them, so one [`Cache`] serves every candidate of a
//! search.

use super::Run;
use crate::model::Model;
use crate::model::corridor::{Corridor, WATCHED, Watched};
use crate::model::state::{
    BASE_ORDER, FLAPPER, FULL_ORDER, Input, Layout, Mode, RAM, RAM_VELOCITY, SPOOL, State,
};
use crate::scalar::Real;

/// Terms of the series for the shortest step.
const TERMS: u32 = 14;

/// Longest coarsest step, s; a sample that lasts longer is taken in several.
const LONGEST_STEP: f64 = 1.001e-3;

/// A matrix by columns: a product then adds whole columns, which a vector unit does side by side.
pub(super) type Columns<T, const N: usize> = [[T; N]; N];

/// One step length: what `z`, the inputs and the constant terms add to `z`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rung<T, const N: usize> {
    /// `exp(A h) - 1`, but for the column of the ram: there, what a shift of ram and command together adds.
    transition: Columns<T, N>,
    /// `integral of exp(A s)`, for constant rates.
    constant: Columns<T, N>,
    command_rate: [T; N],
    force_rate: [T; N],
}

/// What a step adds whatever the state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Terms<T, const N: usize> {
    /// Constant terms: friction, loads, offsets.
    constant: [T; N],
    /// Position error at the start (command minus ram), for each m.
    error: [T; N],
}

/// A force from outside.
#[derive(Clone, Copy, Debug)]
pub(super) struct Force<T, const N: usize> {
    /// What it adds to the rates of the state, for each N.
    effect: [T; N],
    /// Its rate, N/s.
    rate: T,
}

impl<T: Real, const N: usize> Rung<T, N> {
    pub(super) const EMPTY: Self = Self {
        transition: [[T::ZERO; N]; N],
        constant: [[T::ZERO; N]; N],
        command_rate: [T::ZERO; N],
        force_rate: [T::ZERO; N],
    };

    /// What a step adds to a state, given what it adds whatever the state.
    #[inline(always)]
    pub(super) fn change(
        &self,
        terms: &Terms<T, N>,
        layout: Layout,
        state: &State<T>,
        input: &Input<T>,
        force: Option<&Force<T, N>>,
    ) -> [T; N] {
        let error = (input.command - state.ram) - state.ram_rest;
        let mut change = self.change_anywhere(terms, layout, state, error, input.command_rate);
        let place = &self.transition[RAM];
        for row in 0..N {
            change[row] += place[row] * state.ram;
        }
        if let Some(force) = force {
            let constant = apply(&self.constant, &force.effect);
            for row in 0..N {
                change[row] += constant[row] * input.force + self.force_rate[row] * force.rate;
            }
        }
        change
    }

    /// Change of the state over a step, for a loop that does not know where it is: the column of the ram is zero, and
    /// left out. `error` is the position error at the start, m.
    #[inline(always)]
    pub(super) fn change_anywhere(
        &self,
        terms: &Terms<T, N>,
        layout: Layout,
        state: &State<T>,
        error: T,
        command_rate: T,
    ) -> [T; N] {
        let mut change = terms.constant;
        for row in 0..N {
            change[row] += terms.error[row] * error;
            change[row] += self.command_rate[row] * command_rate;
        }
        for (index, (column, value)) in self.transition.iter().zip(state.leading::<N>(&layout)).enumerate() {
            if index != RAM {
                for row in 0..N {
                    change[row] += column[row] * value;
                }
            }
        }
        change
    }
}

/// The steps of one mode.
pub(super) trait Ladder<T, const N: usize, const RUNGS: usize> {
    /// None yet.
    const EMPTY: Self;

    /// Makes the steps of a mode, the finest of a length in s, in place: it is too large for the stack of a
    /// microcontroller.
    fn make(&mut self, model: &Model<T>, mode: &Mode, finest: T);

    /// Its affine part, the shortest step first.
    fn rungs(&self) -> &[Rung<T, N>; RUNGS];
}

/// Ladders of up to `SLOTS` modes, made when a mode is first entered; results do not depend on `SLOTS`.
#[derive(Clone, Debug)]
pub(super) struct Cache<T, L, const N: usize, const RUNGS: usize, const SLOTS: usize> {
    sample_period: T,
    /// 1 over the sample period, 1/s.
    pub(super) sample_rate: T,
    /// Length of a finest step, s.
    pub(super) finest: T,
    /// Finest steps in a sample.
    pub(super) units: u32,
    /// Ladders, each with the key of its mode.
    slots: [(Option<u16>, L); SLOTS],
    /// Place of the next ladder that is made, and of the one in use.
    next: usize,
    slot: usize,
    /// Number of the mode in use.
    mode: Option<u32>,
    /// Order of the states of the model in use.
    pub(super) layout: Layout,
    /// Is a force from outside ever not zero?
    pub(super) has_force: bool,
    /// What it adds to the rates of the state, for each N.
    force: [T; N],
    /// What does not depend on the state in the mode in use, for each rung.
    pub(super) terms: [Terms<T, N>; RUNGS],
}

impl<T: Real, L: Ladder<T, N, RUNGS>, const N: usize, const RUNGS: usize, const SLOTS: usize>
    Cache<T, L, N, RUNGS, SLOTS>
{
    /// A cache that holds nothing.
    pub(super) const fn new() -> Self {
        const {
            assert!(N >= BASE_ORDER && N <= FULL_ORDER, "a model has 5 to 13 states");
            assert!(SLOTS > 0, "the mode in use takes a slot");
        };
        Self {
            sample_period: T::ZERO,
            sample_rate: T::ZERO,
            finest: T::ZERO,
            units: 0,
            slots: [const { (None, L::EMPTY) }; SLOTS],
            next: 0,
            slot: 0,
            mode: None,
            layout: Layout::NONE,
            has_force: false,
            force: [T::ZERO; N],
            terms: [Terms { constant: [T::ZERO; N], error: [T::ZERO; N] }; RUNGS],
        }
    }

    /// Gets ready for a run; see [`Stepper::begin`](super::Stepper::begin). A coarsest step is a number of finest ones.
    pub(super) fn begin(
        &mut self,
        sample_period: T,
        has_force: bool,
        rig_changed: bool,
        finest_per_coarsest: u32,
    ) {
        self.has_force = has_force;
        if rig_changed || sample_period != self.sample_period {
            let mut repeats: u32 = 1;
            while repeats < 1024 && sample_period > T::literal(LONGEST_STEP) * T::from_count(repeats) {
                repeats += 1;
            }
            self.units = finest_per_coarsest * repeats;
            self.finest = sample_period / T::from_count(self.units);
            self.sample_period = sample_period;
            self.sample_rate = T::ONE / sample_period;
            self.forget();
        }
        self.mode = None;
    }

    fn forget(&mut self) {
        for (key, _) in &mut self.slots {
            *key = None;
        }
    }

    /// Enters the mode of a run; true if it is another one than before.
    #[inline(always)]
    pub(super) fn enter(&mut self, model: &Model<T>, run: &Run<T>) -> bool {
        let is_other = self.mode != Some(run.mode_number);
        if is_other {
            self.prepare(model, &run.mode);
            self.mode = Some(run.mode_number);
        }
        is_other
    }

    /// By how much a jump of the command moves what a corridor watches in steps up to the coarsest, for each m of it.
    pub(super) fn answer(&self, corridor: &Corridor<T>) -> Watched<T> {
        let mut most = [T::ZERO; WATCHED];
        for terms in &self.terms {
            let moved = State {
                flapper: terms.error[FLAPPER],
                spool: terms.error[SPOOL],
                ram: terms.error[RAM],
                ram_velocity: terms.error[RAM_VELOCITY],
                ..State::default()
            };
            for (most, moved) in most.iter_mut().zip(corridor.watched(&moved, &Input::default())) {
                *most = most.larger(moved.magnitude());
            }
        }
        most
    }

    /// The force from outside at a rate, where there is one.
    #[inline(always)]
    pub(super) fn force(&self, rate: T) -> Option<Force<T, N>> {
        self.has_force.then_some(Force { effect: self.force, rate })
    }

    /// The ladder of the mode that was entered last.
    #[inline(always)]
    pub(super) fn ladder(&self) -> Option<&L> {
        self.slots.get(self.slot).map(|(_, ladder)| ladder)
    }

    fn holds(&self, slot: usize, key: u16) -> bool {
        self.slots.get(slot).is_some_and(|(there, _)| *there == Some(key))
    }

    /// Finds or makes the ladder of a mode, and the constant terms of the mode on it.
    #[cold]
    fn prepare(&mut self, model: &Model<T>, mode: &Mode) {
        // What moves may differ between candidates: where a range begins at the absence of an effect.
        let layout = model.layout();
        if self.layout != layout {
            self.layout = layout;
            self.forget();
        }
        let key = mode.key(model.has_directed_matrices());
        if !self.holds(self.slot, key) {
            self.slot = (0..SLOTS).find(|&slot| self.holds(slot, key)).unwrap_or_else(|| {
                let slot = self.next;
                self.next = (self.next + 1) % SLOTS;
                if let Some((there, ladder)) = self.slots.get_mut(slot) {
                    *there = Some(key);
                    ladder.make(model, mode, self.finest);
                }
                slot
            });
        }
        self.lay_terms(model, mode);
    }

    /// What does not depend on the state in a mode. A function of its own: otherwise the stack would hold its frame
    /// while the mode's matrices are made.
    #[inline(never)]
    fn lay_terms(&mut self, model: &Model<T>, mode: &Mode) {
        let (none, layout) = (State::default(), self.layout);
        let rate = |input: Input<T>, one| model.affine_rate(mode, &none, &input, one).leading::<N>(&layout);
        let constant = rate(Input::default(), T::ONE);
        let error = rate(Input { command: T::ONE, ..Input::default() }, T::ZERO);
        if self.has_force {
            self.force = rate(Input { force: T::ONE, ..Input::default() }, T::ZERO);
        }
        if let Some((_, ladder)) = self.slots.get(self.slot) {
            for (terms, rung) in self.terms.iter_mut().zip(ladder.rungs()) {
                terms.constant = apply(&rung.constant, &constant);
                terms.error = apply(&rung.constant, &error);
            }
        }
    }
}

/// A system in a mode and its matrices for a step that can be doubled.
pub(super) struct Growth<T, const N: usize> {
    system: System<T, N>,
    /// Length of the step, s.
    pub(super) step: T,
    /// `exp(A h) - 1`.
    transition: Columns<T, N>,
    /// `integral of exp(A s)`.
    constant: Columns<T, N>,
    /// The integral of that.
    ramp: Columns<T, N>,
}

impl<T: Real, const N: usize> Growth<T, N> {
    /// A mode's matrices for a step, s, and those of rates that grow as a power of time (see [`Moments`]).
    #[inline(never)]
    pub(super) fn new<const EXTRA: usize>(
        model: &Model<T>,
        mode: &Mode,
        length: T,
        columns: [[T; N]; EXTRA],
    ) -> (Self, [Moments<T, N>; EXTRA]) {
        let system = System::<T, N>::of(model, mode);
        let a = &system.a;
        let halvings = halvings(a, length);
        let mut step = length;
        for _ in 0..halvings {
            step *= T::literal(0.5);
        }
        // ramp = integral of integral of exp(A s) = h^2/2 (1 + Ah/3 (1 + Ah/4 (...))),
        // constant = h + A ramp, transition = A constant.
        let mut ramp = [[T::ZERO; N]; N];
        add_diagonal(&mut ramp, T::ONE);
        for term in (0..TERMS).rev() {
            ramp = multiply(a, &ramp, step / T::from_count(term + 3));
            add_diagonal(&mut ramp, T::ONE);
        }
        let half_square = step * step * T::literal(0.5);
        for value in ramp.iter_mut().flatten() {
            *value *= half_square;
        }
        let mut constant = multiply(a, &ramp, T::ONE);
        add_diagonal(&mut constant, step);
        let transition = multiply(a, &constant, T::ONE);
        let mut moments = columns.map(|column| {
            // h^3/6 (1 + Ah/4 (1 + Ah/5 (...)))
            let mut parabola = column;
            for term in (0..TERMS).rev() {
                let scale = step / T::from_count(term + 4);
                parabola = apply(a, &parabola);
                for (value, &unit) in parabola.iter_mut().zip(&column) {
                    *value = unit + *value * scale;
                }
            }
            let scale = step * step * step * T::literal(1.0 / 6.0);
            Moments { column, parabola: parabola.map(|value| value * scale) }
        });
        let mut growth = Self { system, step, transition, constant, ramp };
        for _ in 0..halvings {
            growth.double(&mut moments);
        }
        (growth, moments)
    }

    /// Doubles the step.
    #[inline(never)]
    pub(super) fn double(&mut self, moments: &mut [Moments<T, N>]) {
        let two = T::literal(2.0);
        for moment in moments {
            let mut next = apply(&self.transition, &moment.parabola);
            let (constant, ramp) = (self.constant_of(&moment.column), self.ramp_of(&moment.column));
            let half_square = self.step * self.step * T::literal(0.5);
            for row in 0..N {
                next[row] += two * moment.parabola[row] + self.step * ramp[row] + half_square * constant[row];
            }
            moment.parabola = next;
        }
        let mut next = multiply(&self.transition, &self.ramp, T::ONE);
        accumulate(&mut next, &self.ramp, two);
        accumulate(&mut next, &self.constant, self.step);
        self.ramp = next;
        let mut next = multiply(&self.transition, &self.constant, T::ONE);
        accumulate(&mut next, &self.constant, two);
        self.constant = next;
        let mut next = multiply(&self.transition, &self.transition, T::ONE);
        accumulate(&mut next, &self.transition, two);
        self.transition = next;
        self.step *= two;
    }

    /// What a constant rate adds.
    pub(super) fn constant_of(&self, rate: &[T; N]) -> [T; N] {
        apply(&self.constant, rate)
    }

    /// What a rate that grows as the time adds.
    pub(super) fn ramp_of(&self, rate: &[T; N]) -> [T; N] {
        apply(&self.ramp, rate)
    }

    /// Lays the step down as a rung.
    #[inline(never)]
    pub(super) fn lay(&self, rung: &mut Rung<T, N>) {
        let system = &self.system;
        rung.command_rate = self.ramp_of(&system.command);
        for (value, direct) in rung.command_rate.iter_mut().zip(self.constant_of(&system.command_rate)) {
            *value += direct;
        }
        rung.transition = self.transition;
        rung.transition[RAM] = self.constant_of(&system.shift());
        rung.constant = self.constant;
        rung.force_rate = self.ramp_of(&system.force);
    }
}

/// What a rate along a column adds if it grows as half the square of time.
pub(super) struct Moments<T, const N: usize> {
    /// The column.
    pub(super) column: [T; N],
    /// `integral of exp(A (h - s)) s^2/2`, times the column.
    pub(super) parabola: [T; N],
}

/// The matrix and the columns of `z' = A z + b u` in a mode, read off the model's rate.
struct System<T, const N: usize> {
    a: Columns<T, N>,
    command: [T; N],
    command_rate: [T; N],
    force: [T; N],
}

impl<T: Real, const N: usize> System<T, N> {
    #[inline(never)]
    fn of(model: &Model<T>, mode: &Mode) -> Self {
        let layout = model.layout();
        let rate = |state: &State<T>, input: Input<T>| {
            model.affine_rate(mode, state, &input, T::ZERO).leading::<N>(&layout)
        };
        let none = Input::default();
        let mut a = [[T::ZERO; N]; N];
        for (index, column) in a.iter_mut().enumerate() {
            let mut unit = [T::ZERO; FULL_ORDER];
            if let Some(entry) = unit.get_mut(layout.place(index)) {
                *entry = T::ONE;
            }
            *column = rate(&State::from_array(unit), none);
        }
        let rest = State::default();
        Self {
            a,
            command: rate(&rest, Input { command: T::ONE, ..none }),
            command_rate: rate(&rest, Input { command_rate: T::ONE, ..none }),
            force: rate(&rest, Input { force: T::ONE, ..none }),
        }
    }

    /// Rate when ram and command are shifted together by 1: exactly 0 but for a spring load.
    fn shift(&self) -> [T; N] {
        core::array::from_fn(|row| self.a[RAM][row] + self.command[row])
    }
}

/// How often a step must be halved before the series converges fast: until `h` times the rates on the diagonal and
/// the frequencies of pairs of states (`sqrt(A_ij A_ji)`) is below one half.
fn halvings<T: Real, const N: usize>(a: &Columns<T, N>, step: T) -> u32 {
    let mut largest = T::ZERO;
    for row in 0..N {
        for column in 0..=row {
            largest = largest.larger((a[row][column] * a[column][row]).magnitude());
        }
    }
    let mut square = largest * step * step;
    let mut count = 0;
    while square > T::literal(0.25) && count < 24 {
        square *= T::literal(0.25);
        count += 1;
    }
    count
}

fn add_diagonal<T: Real, const N: usize>(matrix: &mut Columns<T, N>, value: T) {
    for (index, column) in matrix.iter_mut().enumerate() {
        column[index] += value;
    }
}

fn multiply<T: Real, const N: usize>(
    left: &Columns<T, N>,
    right: &Columns<T, N>,
    factor: T,
) -> Columns<T, N> {
    let mut product = [[T::ZERO; N]; N];
    for (sum, column) in product.iter_mut().zip(right) {
        for (&coefficient, terms) in column.iter().zip(left) {
            if coefficient != T::ZERO {
                let scaled = coefficient * factor;
                for (sum, &term) in sum.iter_mut().zip(terms) {
                    *sum += scaled * term;
                }
            }
        }
    }
    product
}

fn accumulate<T: Real, const N: usize>(sum: &mut Columns<T, N>, matrix: &Columns<T, N>, factor: T) {
    for (column, terms) in sum.iter_mut().zip(matrix) {
        for (value, &term) in column.iter_mut().zip(terms) {
            *value += factor * term;
        }
    }
}

fn apply<T: Real, const N: usize>(matrix: &Columns<T, N>, vector: &[T; N]) -> [T; N] {
    let mut product = [T::ZERO; N];
    for (column, &value) in matrix.iter().zip(vector) {
        // Rates act on few of the states.
        if value != T::ZERO {
            for (sum, &term) in product.iter_mut().zip(column) {
                *sum += term * value;
            }
        }
    }
    product
}
