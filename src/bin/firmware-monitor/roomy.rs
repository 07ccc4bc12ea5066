//! Negative control of the budget of the monitor's state: a stepper that has more with it than the budget leaves room for.

use eha_monitor::integrate::{Run, Step, Stepper};
use eha_monitor::model::Model;
use eha_monitor::model::corridor::{Corridor, Passing, Watched};
use eha_monitor::model::state::{Input, Mode, State};

/// More than the state leaves free, words.
const WORDS: usize = 256;

/// A stepper with room around it.
pub(crate) struct Roomy<S> {
    stepper: S,
    room: [u32; WORDS],
}

impl<S> Roomy<S> {
    pub(crate) const fn new(stepper: S) -> Self {
        Self { stepper, room: [0; WORDS] }
    }
}

impl<S: Stepper<f32>> Stepper<f32> for Roomy<S> {
    const TOP: usize = S::TOP;
    const SHIFT: u32 = S::SHIFT;
    const ESTIMATES: bool = S::ESTIMATES;

    fn takes(&self, model: &Model<f32>) -> bool {
        self.stepper.takes(model)
    }

    fn begin(&mut self, sample_period: f32, has_force: bool, rig_changed: bool) {
        core::hint::black_box(&self.room);
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
    fn unit(&self) -> f32 {
        self.stepper.unit()
    }

    #[inline(always)]
    fn enter(&mut self, model: &Model<f32>, run: &Run<f32>) {
        self.stepper.enter(model, run);
    }

    #[inline(always)]
    fn corridor(&self) -> Option<&Corridor<f32>> {
        self.stepper.corridor()
    }

    #[inline(always)]
    fn answer(&self, corridor: &Corridor<f32>) -> Watched<f32> {
        self.stepper.answer(corridor)
    }

    #[inline(always)]
    fn glide(
        &self,
        run: &mut Run<f32>,
        command: f32,
        most: u32,
        commands: impl FnMut(u32) -> Option<f32>,
        see: impl FnMut(&Passing<f32>),
    ) -> u32 {
        self.stepper.glide(run, command, most, commands, see)
    }

    #[inline(always)]
    fn step(
        &self,
        model: &Model<f32>,
        mode: &Mode,
        state: &State<f32>,
        input: &Input<f32>,
        force_rate: f32,
        level: usize,
    ) -> Step<f32> {
        self.stepper.step(model, mode, state, input, force_rate, level)
    }
}
