//! Exact steps of a piecewise affine model.
//!
//! Inside a mode the model is `z' = A z + b u + c` with an input that is linear over a sample, so a step of any
//! length is one matrix product. A *ladder* holds the products for four lengths, each a quarter of the one above: a
//! whole sample where nothing happens, shorter ones around an event. `A`, `b` and `c` are read off
//! [`Model::affine_rate`]. They depend on the rig; `FDJ` and `BKL` do not change them, so one set of ladders serves
//! every candidate of a search.
//!
//! A ladder is kept as increments, `exp(A h) - 1`, which loses nothing to rounding where `exp(A h)` is close to 1:
//! in `f32` this keeps a simulated second within some nanometres of `f64`. For the same reason ram and command enter
//! as their difference: a loop that does not know where it is (no spring load) then has a column of exact zeros.

use super::{Run, Stepper};
use crate::model::Model;
use crate::model::state::{FULL_ORDER, Input, Mode, RAM, State};
use crate::scalar::Real;

/// Lengths of step on a ladder.
pub const LEVELS: usize = 4;
/// Finest steps in a coarsest one.
const FINEST_PER_COARSEST: u32 = 64;
/// Longest coarsest step, s; a sample that lasts longer is taken in several.
const LONGEST_STEP: f64 = 1.001e-3;
/// Terms of the series for the shortest step.
const TERMS: u32 = 14;

type Matrix<T, const N: usize> = [[T; N]; N];

/// One step length: what `z`, the inputs and the constant terms add to `z`.
#[derive(Clone, Copy, Debug)]
struct Rung<T, const N: usize> {
    /// `exp(A h) - 1`, but for the column of the ram: there, what a shift of ram and command together adds.
    transition: Matrix<T, N>,
    /// `integral of exp(A s)`, for constant rates.
    constant: Matrix<T, N>,
    /// Weight of the position error, command minus ram.
    error: [T; N],
    command_rate: [T; N],
    force: [T; N],
    force_rate: [T; N],
}

/// The steps of one mode.
#[derive(Clone, Copy, Debug)]
struct Ladder<T, const N: usize> {
    key: u16,
    rungs: [Rung<T, N>; LEVELS],
}

/// Exact steps for a model of `N` states, with ladders for `SLOTS` modes kept at a time.
///
/// The ladders are a cache: they are made when a mode is first entered, and results do not depend on `SLOTS`.
#[derive(Clone, Debug)]
pub struct Exact<T, const N: usize, const SLOTS: usize> {
    sample_period: T,
    finest: T,
    units: u32,
    ladders: [Option<Ladder<T, N>>; SLOTS],
    next: usize,
    slot: usize,
    has_force: bool,
    mode: Option<Mode>,
    /// What the constant terms of the mode add, for each step length.
    constants: [[T; N]; LEVELS],
}

impl<T: Real, const N: usize, const SLOTS: usize> Exact<T, N, SLOTS> {
    /// An empty cache.
    pub const fn new() -> Self {
        Self {
            sample_period: T::ZERO,
            finest: T::ZERO,
            units: 0,
            ladders: [None; SLOTS],
            next: 0,
            slot: 0,
            has_force: false,
            mode: None,
            constants: [[T::ZERO; N]; LEVELS],
        }
    }

    fn occupied(&self, slot: usize, key: u16) -> bool {
        self.ladders.get(slot).is_some_and(|ladder| ladder.as_ref().is_some_and(|ladder| ladder.key == key))
    }

    fn product(&self, state: &State<T>, input: &Input<T>, force_rate: T, level: usize) -> [T; N] {
        let z = state.leading::<N>();
        let mut change = [T::ZERO; N];
        let (Some(Some(ladder)), Some(constants)) = (self.ladders.get(self.slot), self.constants.get(level))
        else {
            return change;
        };
        let Some(rung) = ladder.rungs.get(level) else { return change };
        let error = (input.command - state.ram) - state.ram_rest;
        for row in 0..N {
            let mut sum = constants[row] + rung.error[row] * error;
            sum += rung.command_rate[row] * input.command_rate;
            for column in 0..N {
                sum += rung.transition[row][column] * z[column];
            }
            change[row] = sum;
        }
        if self.has_force {
            for row in 0..N {
                change[row] += rung.force[row] * input.force + rung.force_rate[row] * force_rate;
            }
        }
        change
    }
}

impl<T: Real, const N: usize, const SLOTS: usize> Default for Exact<T, N, SLOTS> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real, const N: usize, const SLOTS: usize> Stepper<T> for Exact<T, N, SLOTS> {
    const TOP: usize = LEVELS - 1;

    fn begin(&mut self, sample_period: T, has_force: bool, rig_changed: bool) {
        if rig_changed || sample_period != self.sample_period {
            let mut repeats: u32 = 1;
            while repeats < 1024 && sample_period > T::literal(LONGEST_STEP) * T::from_count(repeats) {
                repeats += 1;
            }
            self.units = FINEST_PER_COARSEST * repeats;
            self.finest = sample_period / T::from_count(self.units);
            self.sample_period = sample_period;
            self.ladders = [None; SLOTS];
        }
        self.has_force = has_force;
        self.mode = None;
    }

    fn units(&self) -> u32 {
        self.units
    }

    #[inline(always)]
    fn calm(&self) -> u32 {
        0
    }

    fn unit(&self) -> T {
        self.finest
    }

    #[inline]
    fn enter(&mut self, model: &Model<T>, mode: &Mode) {
        if self.mode != Some(*mode) {
            self.prepare(model, mode);
        }
    }

    #[inline(always)]
    fn step(&self, _: &Model<T>, run: &Run<T>, input: &Input<T>, force_rate: T, level: usize) -> State<T> {
        run.state.changed(&self.product(&run.state, input, force_rate, level))
    }

    /// The parabola through both ends of the finest step, with the rate at its start: within the step's cube.
    #[inline]
    fn part(&self, model: &Model<T>, run: &Run<T>, input: &Input<T>, force_rate: T, fraction: T) -> State<T> {
        let mut change = self.product(&run.state, input, force_rate, 0);
        let rate = model.affine_rate(&run.mode, &run.state, input, T::ONE).leading::<N>();
        for (value, rate) in change.iter_mut().zip(rate) {
            let tangent = self.finest * rate;
            *value = fraction * (tangent + fraction * (*value - tangent));
        }
        run.state.changed(&change)
    }
}

impl<T: Real, const N: usize, const SLOTS: usize> Exact<T, N, SLOTS> {
    /// Finds or makes the ladder of a mode, and the constant terms of the mode on it.
    #[cold]
    fn prepare(&mut self, model: &Model<T>, mode: &Mode) {
        let key = mode.key();
        if !self.occupied(self.slot, key) {
            self.slot = (0..SLOTS).find(|&slot| self.occupied(slot, key)).unwrap_or_else(|| {
                let slot = self.next;
                self.next = (self.next + 1) % SLOTS;
                if let Some(place) = self.ladders.get_mut(slot) {
                    *place = Some(Ladder::new(model, mode, self.finest));
                }
                slot
            });
        }
        let rate = model.affine_rate(mode, &State::default(), &Input::default(), T::ONE);
        let rate = rate.leading::<N>();
        if let Some(Some(ladder)) = self.ladders.get(self.slot) {
            for (constants, rung) in self.constants.iter_mut().zip(&ladder.rungs) {
                *constants = apply(&rung.constant, &rate);
            }
        }
        self.mode = Some(*mode);
    }
}

impl<T: Real, const N: usize> Ladder<T, N> {
    fn new(model: &Model<T>, mode: &Mode, finest: T) -> Self {
        let System { a, shift, command, command_rate, force } = System::<T, N>::of(model, mode);
        let halvings = halvings(&a, finest);
        let mut step = finest;
        for _ in 0..halvings {
            step *= T::literal(0.5);
        }
        // ramp = integral of integral of exp(A s) = h^2/2 (1 + Ah/3 (1 + Ah/4 (...))),
        // constant = h + A ramp, transition = A constant.
        let mut ramp = identity::<T, N>(T::ONE);
        for term in (0..TERMS).rev() {
            ramp = multiply(&a, &ramp, step / T::from_count(term + 3));
            for (index, row) in ramp.iter_mut().enumerate() {
                row[index] += T::ONE;
            }
        }
        ramp = scaled(&ramp, step * step * T::literal(0.5));
        let mut constant = multiply(&a, &ramp, T::ONE);
        for (index, row) in constant.iter_mut().enumerate() {
            row[index] += step;
        }
        let mut transition = multiply(&a, &constant, T::ONE);
        let double = |transition: &mut Matrix<T, N>,
                      constant: &mut Matrix<T, N>,
                      ramp: &mut Matrix<T, N>,
                      step: &mut T| {
            let mut next = multiply(transition, ramp, T::ONE);
            accumulate(&mut next, ramp, T::literal(2.0));
            accumulate(&mut next, constant, *step);
            *ramp = next;
            let mut next = multiply(transition, constant, T::ONE);
            accumulate(&mut next, constant, T::literal(2.0));
            *constant = next;
            let mut next = multiply(transition, transition, T::ONE);
            accumulate(&mut next, transition, T::literal(2.0));
            *transition = next;
            *step *= T::literal(2.0);
        };
        for _ in 0..halvings {
            double(&mut transition, &mut constant, &mut ramp, &mut step);
        }
        let rungs = core::array::from_fn(|level| {
            if level > 0 {
                double(&mut transition, &mut constant, &mut ramp, &mut step);
                double(&mut transition, &mut constant, &mut ramp, &mut step);
            }
            let mut rate = apply(&ramp, &command);
            for (value, direct) in rate.iter_mut().zip(apply(&constant, &command_rate)) {
                *value += direct;
            }
            let mut relative = transition;
            for (row, shift) in relative.iter_mut().zip(apply(&constant, &shift)) {
                row[RAM] = shift;
            }
            Rung {
                transition: relative,
                constant,
                error: apply(&constant, &command),
                command_rate: rate,
                force: apply(&constant, &force),
                force_rate: apply(&ramp, &force),
            }
        });
        Self { key: mode.key(), rungs }
    }
}

/// The matrix and the columns of `z' = A z + b u` in a mode, read off the model's rate.
struct System<T, const N: usize> {
    a: Matrix<T, N>,
    /// Rate when ram and command are shifted together by 1.
    shift: [T; N],
    command: [T; N],
    command_rate: [T; N],
    force: [T; N],
}

impl<T: Real, const N: usize> System<T, N> {
    fn of(model: &Model<T>, mode: &Mode) -> Self {
        let rate = |state: &State<T>, input: Input<T>| {
            model.affine_rate(mode, state, &input, T::ZERO).leading::<N>()
        };
        let none = Input::default();
        let mut a = [[T::ZERO; N]; N];
        for column in 0..N {
            let mut unit = [T::ZERO; FULL_ORDER];
            unit[column] = T::ONE;
            for (row, value) in rate(&State::from_array(unit), none).into_iter().enumerate() {
                a[row][column] = value;
            }
        }
        let rest = State::default();
        let command = Input { command: T::ONE, ..none };
        Self {
            a,
            shift: rate(&State { ram: T::ONE, ..rest }, command),
            command: rate(&rest, command),
            command_rate: rate(&rest, Input { command_rate: T::ONE, ..none }),
            force: rate(&rest, Input { force: T::ONE, ..none }),
        }
    }
}

/// How often a step must be halved before the series converges fast: until `h` times the rates on the diagonal and
/// the frequencies of pairs of states (`sqrt(A_ij A_ji)`) is below one half.
fn halvings<T: Real, const N: usize>(a: &Matrix<T, N>, step: T) -> u32 {
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

fn identity<T: Real, const N: usize>(value: T) -> Matrix<T, N> {
    let mut matrix = [[T::ZERO; N]; N];
    for (index, row) in matrix.iter_mut().enumerate() {
        row[index] = value;
    }
    matrix
}

fn multiply<T: Real, const N: usize>(left: &Matrix<T, N>, right: &Matrix<T, N>, factor: T) -> Matrix<T, N> {
    let mut product = [[T::ZERO; N]; N];
    for (row, coefficients) in product.iter_mut().zip(left) {
        for (&coefficient, terms) in coefficients.iter().zip(right) {
            if coefficient != T::ZERO {
                let scaled = coefficient * factor;
                for (sum, &term) in row.iter_mut().zip(terms) {
                    *sum += scaled * term;
                }
            }
        }
    }
    product
}

fn scaled<T: Real, const N: usize>(matrix: &Matrix<T, N>, factor: T) -> Matrix<T, N> {
    matrix.map(|row| row.map(|value| value * factor))
}

fn accumulate<T: Real, const N: usize>(sum: &mut Matrix<T, N>, matrix: &Matrix<T, N>, factor: T) {
    for (row, terms) in sum.iter_mut().zip(matrix) {
        for (value, &term) in row.iter_mut().zip(terms) {
            *value += factor * term;
        }
    }
}

fn apply<T: Real, const N: usize>(matrix: &Matrix<T, N>, vector: &[T; N]) -> [T; N] {
    matrix.map(|row| row.iter().zip(vector).fold(T::ZERO, |sum, (&a, &b)| sum + a * b))
}
