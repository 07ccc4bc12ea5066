//! How much is simulated: what a search costs, on whatever machine it runs.

use eha_monitor::integrate::{Run, Step, Stepper};
use eha_monitor::model::Model;
use eha_monitor::model::corridor::{Corridor, Passing, Watched};
use eha_monitor::model::state::{Input, Mode, State};
use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// What was spent on a record and on all that is made of it, ns of one core. Steps are counted, not time: it is the same
/// whenever the same is done.
#[derive(Clone, Debug, Default)]
pub(super) struct Effort(Arc<AtomicU64>);

impl Effort {
    pub(super) fn add(&self, ns: u64) {
        self.0.fetch_add(ns, Ordering::Relaxed);
    }

    pub(super) fn spent_s(&self) -> f64 {
        self.0.load(Ordering::Relaxed) as f64 * 1e-9
    }
}

/// A stepper that counts its steps.
pub(super) struct Counting<S> {
    stepper: S,
    steps: Cell<u64>,
}

impl<S> Counting<S> {
    pub(super) const fn of(stepper: S) -> Self {
        Self { stepper, steps: Cell::new(0) }
    }

    pub(super) const fn steps(&self) -> u64 {
        self.steps.get()
    }

    fn count(&self, steps: u64) {
        self.steps.set(self.steps.get() + steps);
    }
}

impl<S: Stepper<f64>> Stepper<f64> for Counting<S> {
    const TOP: usize = S::TOP;
    const SHIFT: u32 = S::SHIFT;
    const ESTIMATES: bool = S::ESTIMATES;

    fn takes(&self, model: &Model<f64>) -> bool {
        self.stepper.takes(model)
    }

    fn begin(&mut self, sample_period: f64, has_force: bool, rig_changed: bool) {
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
    fn unit(&self) -> f64 {
        self.stepper.unit()
    }

    #[inline(always)]
    fn enter(&mut self, model: &Model<f64>, run: &Run<f64>) {
        self.stepper.enter(model, run);
    }

    #[inline(always)]
    fn corridor(&self) -> Option<&Corridor<f64>> {
        self.stepper.corridor()
    }

    #[inline(always)]
    fn answer(&self, corridor: &Corridor<f64>) -> Watched<f64> {
        self.stepper.answer(corridor)
    }

    #[inline(always)]
    fn glide(
        &self,
        run: &mut Run<f64>,
        command: f64,
        most: u32,
        commands: impl FnMut(u32) -> Option<f64>,
        see: impl FnMut(&Passing<f64>),
    ) -> u32 {
        let samples = self.stepper.glide(run, command, most, commands, see);
        self.count(samples.into());
        samples
    }

    #[inline(always)]
    fn step(
        &self,
        model: &Model<f64>,
        mode: &Mode,
        state: &State<f64>,
        input: &Input<f64>,
        force_rate: f64,
        level: usize,
    ) -> Step<f64> {
        self.count(1);
        self.stepper.step(model, mode, state, input, force_rate, level)
    }
}
