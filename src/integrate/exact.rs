//! Exact steps of a piecewise affine model.
//!
//! Inside a mode a step of any length is one matrix product (see `ladder.rs`). A *ladder* holds the
//! products for four lengths, each a quarter of the one above: a whole sample where nothing happens, shorter ones
//! around an event.

use super::ladder::{self, Cache, Growth, Rung};
use super::{Step, Stepper};
use crate::model::Model;
use crate::model::state::{Input, Mode, State};
use crate::scalar::Real;

/// Lengths of step on a ladder.
pub const LEVELS: usize = 4;
/// Finest steps in a coarsest one.
const FINEST_PER_COARSEST: u32 = 64;

/// The steps of one mode.
#[derive(Clone, Debug)]
struct Ladder<T, const N: usize>([Rung<T, N>; LEVELS]);

/// Exact steps for a model of `N` states, with ladders for `SLOTS` modes kept at a time.
#[derive(Clone, Debug)]
pub struct Exact<T, const N: usize, const SLOTS: usize> {
    cache: Cache<T, Ladder<T, N>, N, LEVELS, SLOTS>,
    has_force: bool,
}

impl<T: Real, const N: usize, const SLOTS: usize> Exact<T, N, SLOTS> {
    /// Steps without any matrices yet.
    pub const fn new() -> Self {
        Self { cache: Cache::new(), has_force: false }
    }

    #[inline(always)]
    fn product(&self, state: &State<T>, input: &Input<T>, force_rate: T, level: usize) -> [T; N] {
        let rung = self.cache.ladder().and_then(|ladder| ladder.0.get(level));
        let (Some(rung), Some(constants)) = (rung, self.cache.constants.get(level)) else {
            return [T::ZERO; N];
        };
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
        self.cache.begin(sample_period, rig_changed, FINEST_PER_COARSEST);
        self.has_force = has_force;
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
    fn enter(&mut self, model: &Model<T>, mode: &Mode) {
        self.cache.enter(model, mode);
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

impl<T: Real, const N: usize> ladder::Ladder<T, N, LEVELS> for Ladder<T, N> {
    fn new(model: &Model<T>, mode: &Mode, finest: T) -> Self {
        let (mut growth, _) = Growth::new(model, mode, finest, []);
        Self(core::array::from_fn(|level| {
            if level > 0 {
                growth.double(&mut []);
                growth.double(&mut []);
            }
            growth.rung()
        }))
    }

    fn rungs(&self) -> &[Rung<T, N>; LEVELS] {
        &self.0
    }
}
