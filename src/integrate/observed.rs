//! A stepper that somebody looks at: what counts its steps, or takes room beside it.

use super::{Run, Step, Stepper};
use crate::model::Model;
use crate::model::corridor::{Corridor, Passing, Watched};
use crate::model::state::{Input, Mode, State};
use crate::scalar::Real;
use core::cell::Cell;

/// Who looks at a stepper.
pub trait Observer {
    /// A run begins.
    #[inline(always)]
    fn begins(&self) {}

    /// So many steps were taken.
    #[inline(always)]
    fn took(&self, _steps: u32) {}
}

/// Counts the steps.
impl Observer for Cell<u64> {
    #[inline(always)]
    fn took(&self, steps: u32) {
        self.set(self.get().wrapping_add(steps.into()));
    }
}

impl<O: Observer> Observer for &O {
    #[inline(always)]
    fn begins(&self) {
        (**self).begins();
    }

    #[inline(always)]
    fn took(&self, steps: u32) {
        (**self).took(steps);
    }
}

/// A stepper and who looks at it. It steps as it does alone.
pub struct Observed<S, O> {
    stepper: S,
    /// Who looks at it.
    pub observer: O,
}

impl<S, O> Observed<S, O> {
    /// A stepper that an observer looks at from now on.
    pub const fn new(stepper: S, observer: O) -> Self {
        Self { stepper, observer }
    }
}

impl<T: Real, S: Stepper<T>, O: Observer> Stepper<T> for Observed<S, O> {
    const TOP: usize = S::TOP;
    const SHIFT: u32 = S::SHIFT;
    const ESTIMATES: bool = S::ESTIMATES;

    fn takes(&self, model: &Model<T>) -> bool {
        self.stepper.takes(model)
    }

    fn begin(&mut self, sample_period: T, has_force: bool, rig_changed: bool) {
        self.observer.begins();
        self.stepper.begin(sample_period, has_force, rig_changed);
    }

    #[inline(always)]
    fn units(&self) -> u32 {
        self.stepper.units()
    }

    #[inline(always)]
    fn calm(&self) -> u32 {
        self.stepper.calm()
    }

    #[inline(always)]
    fn unit(&self) -> T {
        self.stepper.unit()
    }

    #[inline(always)]
    fn enter(&mut self, model: &Model<T>, run: &Run<T>) {
        self.stepper.enter(model, run);
    }

    #[inline(always)]
    fn corridor(&self) -> Option<&Corridor<T>> {
        self.stepper.corridor()
    }

    #[inline(always)]
    fn answer(&self, corridor: &Corridor<T>) -> Watched<T> {
        self.stepper.answer(corridor)
    }

    #[inline(always)]
    fn glide(
        &self,
        run: &mut Run<T>,
        command: T,
        most: u32,
        commands: impl FnMut(u32) -> Option<T>,
        see: impl FnMut(&Passing<T>),
    ) -> u32 {
        let samples = self.stepper.glide(run, command, most, commands, see);
        self.observer.took(samples);
        samples
    }

    #[inline(always)]
    fn piece(&self, run: &Run<T>) -> u32 {
        self.stepper.piece(run)
    }

    #[inline(always)]
    fn step(
        &self,
        model: &Model<T>,
        mode: &Mode,
        state: &State<T>,
        input: &Input<T>,
        force_rate: T,
        level: usize,
    ) -> Step<T> {
        self.observer.took(1);
        self.stepper.step(model, mode, state, input, force_rate, level)
    }
}
