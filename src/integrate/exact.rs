//! Exact steps of a piecewise affine model.
//!
//! Inside a mode a step of any length is one matrix product (see `ladder.rs`). A *ladder* holds the
//! products for a few lengths, each a quarter of the one above: a whole sample where nothing happens, shorter ones
//! around an event.

use super::ladder::{self, Cache, Growth, Rung};
use super::{Run, Step, Stepper};
use crate::model::Model;
use crate::model::corridor::{Corridor, ERROR, Passage, Watched};
use crate::model::state::{Input, Mode, State};
use crate::scalar::Real;

/// Lengths of step on a ladder of the plain loop: 1, 1/4 and 1/16 ms.
pub const PLAIN: usize = 3;
/// Lengths on a ladder of a model with every state: a play of the current opens and closes within 1/16 ms.
pub const FINE: usize = 4;

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
        mut commands: impl FnMut(u32) -> Option<T>,
        mut see: impl FnMut(&State<T>, &Input<T>),
    ) -> u32 {
        let (Some(corridor), Some(ladder)) = (&self.corridor, self.cache.ladder()) else { return 0 };
        let (Some(rung), Some(terms)) = (ladder.0.last(), self.cache.terms.last()) else { return 0 };
        if self.cache.units != Self::FINEST_PER_COARSEST || run.stride != Self::FINEST_PER_COARSEST {
            return 0;
        }
        let layout = self.cache.layout;
        let (mut state, mut swing, mut has_margin) = (run.state, run.swing, run.has_margin);
        let mut here = corridor.watched(&state, &Input { command, ..Input::default() });
        let mut done = 0;
        while let Some(next) = commands(done) {
            let command_rate = (next - command) * self.cache.sample_rate;
            // A mode with a corridor has no spring load.
            let there =
                state.moved(&rung.change_anywhere(terms, layout, &state, here[ERROR], command_rate), &layout);
            let input = Input { command: next, command_rate, force: T::ZERO };
            let after = corridor.watched(&there, &input);
            let change: Watched<T> = core::array::from_fn(|index| after[index] - here[index]);
            let is_clear = has_margin && corridor.is_clear(&after, &change, &swing);
            if !is_clear {
                // Copies, so that these live in registers elsewhere.
                let (here, after, swing, change) = ({ here }, { after }, { swing }, { change });
                match corridor.passage(&here, &after, &swing, true) {
                    Passage::Clear => has_margin = corridor.has_margin(&after, &change),
                    Passage::Close => break,
                    Passage::Left => {
                        run.entry = Self::TOP.saturating_sub(1);
                        break;
                    }
                }
            }
            (command, state, here, swing) = (next, there, after, change);
            done += 1;
            see(&state, &input);
        }
        if done > 0 {
            run.state.take_base(&state);
            (run.swing, run.has_margin) = (swing, has_margin);
            run.has_guards = false;
            run.steps = run.steps.wrapping_add(done);
        }
        done
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
