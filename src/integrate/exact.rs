//! Exact steps of a piecewise affine model.
//!
//! Inside a mode a step of any length is one matrix product (see `ladder.rs`). A *ladder* holds the
//! products for four lengths, each a quarter of the one above: a whole sample where nothing happens, shorter ones
//! around an event. The matrices depend on the rig; `FDJ` and `BKL` do not change them, so one set of ladders serves
//! every candidate of a search.

use super::ladder::{Growth, Rung};
use super::{Step, Stepper};
use crate::model::Model;
use crate::model::state::{Input, Mode, State};
use crate::scalar::Real;

/// Lengths of step on a ladder.
pub const LEVELS: usize = 4;
/// Finest steps in a coarsest one.
const FINEST_PER_COARSEST: u32 = 64;
/// Longest coarsest step, s; a sample that lasts longer is taken in several.
pub(super) const LONGEST_STEP: f64 = 1.001e-3;

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
        let (Some(Some(ladder)), Some(constants)) = (self.ladders.get(self.slot), self.constants.get(level))
        else {
            return [T::ZERO; N];
        };
        let Some(rung) = ladder.rungs.get(level) else { return [T::ZERO; N] };
        rung.change(constants, state, input, self.has_force.then_some(force_rate))
    }
}

impl<T: Real, const N: usize, const SLOTS: usize> Default for Exact<T, N, SLOTS> {
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real, const N: usize, const SLOTS: usize> Stepper<T> for Exact<T, N, SLOTS> {
    const TOP: usize = LEVELS - 1;
    const SHIFT: u32 = 2;

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
    fn step(
        &self,
        _: &Model<T>,
        _: &Mode,
        state: &State<T>,
        input: &Input<T>,
        force_rate: T,
        level: usize,
    ) -> Step<T> {
        Step::exact(state.changed(&self.product(state, input, force_rate, level)))
    }
}

impl<T: Real, const N: usize, const SLOTS: usize> Exact<T, N, SLOTS> {
    /// Finds or makes the ladder of a mode, and the constant terms of the mode on it.
    #[cold]
    fn prepare(&mut self, model: &Model<T>, mode: &Mode) {
        let key = mode.key(model.has_directed_matrices());
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
                *constants = rung.of_constants(&rate);
            }
        }
        self.mode = Some(*mode);
    }
}

impl<T: Real, const N: usize> Ladder<T, N> {
    fn new(model: &Model<T>, mode: &Mode, finest: T) -> Self {
        let (mut growth, _) = Growth::new(model, mode, finest, []);
        let rungs = core::array::from_fn(|level| {
            if level > 0 {
                growth.double(&mut []);
                growth.double(&mut []);
            }
            growth.rung()
        });
        Self { key: mode.key(model.has_directed_matrices()), rungs }
    }
}
