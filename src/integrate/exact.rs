//! Exact steps of a piecewise affine model.
//!
//! Inside a mode a step of any length is one matrix product (see `ladder.rs`). A *ladder* holds the
//! products for a few lengths, each a quarter of the one above: a whole sample where nothing happens, shorter ones
//! around an event.

use super::ladder::{self, Cache, Growth, Rung};
use super::{LONGEST_PIECE, Run, Step, Stepper, rescaled};
use crate::model::Model;
use crate::model::corridor::{Corridor, Detour, ERROR, Passing, Watched};
use crate::model::state::{FLAPPER, Input, Mode, State};
use crate::scalar::Real;

/// Lengths of step on a ladder of the plain loop: 1, 1/4 and 1/16 ms.
pub const PLAIN: usize = 3;
/// Lengths on a ladder of a model with every state: a play of the current opens and closes within 1/16 ms.
pub const FINE: usize = 4;

/// Most samples between two looks at the corridor. They cannot be parted.
const LONGEST_STRIDE: u32 = 16;
const _: () = assert!(LONGEST_STRIDE <= LONGEST_PIECE);

/// The steps of one mode.
#[derive(Clone, Debug)]
struct Ladder<T, const N: usize, const LEVELS: usize>([Rung<T, N>; LEVELS]);

/// Exact steps of `LEVELS` lengths for a model of `N` states, with ladders for `SLOTS` modes kept at a time.
#[derive(Clone, Debug)]
pub struct Exact<T, const N: usize, const SLOTS: usize, const LEVELS: usize = PLAIN> {
    cache: Cache<T, Ladder<T, N, LEVELS>, N, LEVELS, SLOTS>,
    corridor: Option<Corridor<T>>,
}

impl<T: Real, const N: usize, const SLOTS: usize, const LEVELS: usize> Exact<T, N, SLOTS, LEVELS> {
    /// Finest steps in a coarsest one.
    const FINEST_PER_COARSEST: u32 = 1 << (2 * (LEVELS - 1));

    /// Steps without any matrices yet.
    pub const fn new() -> Self {
        Self { cache: Cache::new(), corridor: None }
    }

    /// Are samples taken whole, and may the next one be?
    #[inline(always)]
    fn may_glide(&self, run: &Run<T>) -> bool {
        self.cache.units == Self::FINEST_PER_COARSEST && run.entry >= Self::TOP
    }

    #[inline(always)]
    fn product(&self, state: &State<T>, input: &Input<T>, force_rate: T, level: usize) -> [T; N] {
        let rung = self.cache.ladder().and_then(|ladder| ladder.0.get(level));
        let (Some(rung), Some(terms)) = (rung, self.cache.terms.get(level)) else {
            return [T::ZERO; N];
        };
        rung.change(terms, self.cache.layout, state, input, self.cache.force(force_rate).as_ref())
    }
}

impl<T: Real, const N: usize, const SLOTS: usize, const LEVELS: usize> Default
    for Exact<T, N, SLOTS, LEVELS>
{
    fn default() -> Self {
        Self::new()
    }
}

impl<T: Real, const N: usize, const SLOTS: usize, const LEVELS: usize> Stepper<T>
    for Exact<T, N, SLOTS, LEVELS>
{
    const TOP: usize = LEVELS - 1;
    const SHIFT: u32 = 2;

    fn takes(&self, model: &Model<T>) -> bool {
        model.is_affine() && model.order() <= N
    }

    fn begin(&mut self, sample_period: T, has_force: bool, rig_changed: bool) {
        self.cache.begin(sample_period, has_force, rig_changed, Self::FINEST_PER_COARSEST);
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
        if self.cache.enter(model, run) {
            self.corridor = if self.cache.has_force { None } else { model.corridor(&run.mode) };
        }
    }

    #[inline(always)]
    fn corridor(&self) -> Option<&Corridor<T>> {
        self.corridor.as_ref()
    }

    #[inline(never)]
    fn answer(&self, corridor: &Corridor<T>) -> Watched<T> {
        self.cache.answer(corridor)
    }

    #[inline(always)]
    fn glide(
        &self,
        run: &mut Run<T>,
        mut command: T,
        most: u32,
        mut commands: impl FnMut(u32) -> Option<T>,
        mut see: impl FnMut(&Passing<T>),
    ) -> u32 {
        let (Some(corridor), Some(ladder)) = (&self.corridor, self.cache.ladder()) else { return 0 };
        let (Some(rung), Some(terms)) = (ladder.0.last(), self.cache.terms.last()) else { return 0 };
        if !self.may_glide(run) {
            return 0;
        }
        let mut stride = run.stride / Self::FINEST_PER_COARSEST;
        if stride * Self::FINEST_PER_COARSEST != run.stride {
            stride = 1;
            run.swing = rescaled(&run.swing, [run.stride, Self::FINEST_PER_COARSEST]);
        }
        let layout = self.cache.layout;
        let (mut state, mut swing, mut wary) = (run.state, run.swing, run.wary);
        let mut here = corridor.watched(&state, &Input { command, ..Input::default() });
        let mut passed = [Passing::default(); LONGEST_STRIDE as usize];
        let (mut done, mut steps) = (0, 0);
        while most - steps >= stride {
            let (mut there, mut at, mut error) = (state, command, here[ERROR]);
            let (mut count, mut way) = (0, [T::ZERO; 2]);
            for place in passed.iter_mut().take(stride as usize) {
                let Some(next) = commands(done + count) else { break };
                let command_rate = (next - at) * self.cache.sample_rate;
                // A mode with a corridor has no spring load.
                let step = rung.change_anywhere(terms, layout, &there, error, command_rate);
                there = there.moved(&step, &layout);
                at = next;
                let error_before = error;
                error = (at - there.ram) - there.ram_rest;
                way = [way[0] + (error - error_before).magnitude(), way[1] + step[FLAPPER].magnitude()];
                *place = corridor.passing(&there, error);
                count += 1;
            }
            steps += count;
            if count == 0 {
                break;
            }
            // Hidden, so that its bounds are not fetched ahead of the steps, to be kept on the stack.
            let corridor = core::hint::black_box(corridor);
            if count < stride {
                swing = rescaled(&{ swing }, [stride, count]);
                stride = count;
            }
            let after = corridor.watched(&there, &Input { command: at, ..Input::default() });
            let change: Watched<T> = core::array::from_fn(|index| after[index] - here[index]);
            let detour = if count > 1 {
                corridor.detour(way, [error - here[ERROR], there.flapper - state.flapper])
            } else {
                Detour::default()
            };
            // Copies, so that these live in registers elsewhere.
            let (from, to, before) = ({ here }, { after }, { swing });
            if !corridor.keeps(&from, &to, &before, &{ detour }) {
                if stride > 1 {
                    swing = rescaled(&before, [stride, 1]);
                    (wary, stride) = (stride, 1);
                    continue;
                }
                run.entry = Self::TOP.saturating_sub(1);
                // It counts where it is taken in parts.
                (steps, wary) = (steps - count, 0);
                break;
            }
            (command, state, here, swing) = (at, there, after, change);
            (done, wary) = (done + count, wary.saturating_sub(count));
            passed.iter().take(count as usize).for_each(&mut see);
            if wary == 0 && stride <= LONGEST_STRIDE / 2 && corridor.has_room(&{ here }, &{ swing }) {
                (swing, stride) = (swing.map(|change| change + change), stride + stride);
            }
        }
        (run.swing, run.wary) = (swing, wary);
        run.stride = stride * Self::FINEST_PER_COARSEST;
        if done > 0 {
            run.state.take_base(&state);
            run.has_guards = false;
        }
        run.steps = run.steps.wrapping_add(steps);
        done
    }

    #[inline(always)]
    fn piece(&self, run: &Run<T>) -> u32 {
        if self.corridor.is_some() && self.may_glide(run) { LONGEST_STRIDE } else { 1 }
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
        Step::exact(state.moved(&self.product(state, input, force_rate, level), &self.cache.layout))
    }
}

impl<T: Real, const N: usize, const LEVELS: usize> ladder::Ladder<T, N, LEVELS> for Ladder<T, N, LEVELS> {
    const EMPTY: Self = Self([Rung::EMPTY; LEVELS]);

    fn make(&mut self, model: &Model<T>, mode: &Mode, finest: T) {
        let (mut growth, _) = Growth::new(model, mode, finest, []);
        for (level, rung) in self.0.iter_mut().enumerate() {
            if level > 0 {
                growth.double(&mut []);
                growth.double(&mut []);
            }
            growth.lay(rung);
        }
    }

    fn rungs(&self) -> &[Rung<T, N>; LEVELS] {
        &self.0
    }
}
