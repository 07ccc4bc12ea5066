//! One candidate, and its neighbours for the derivatives, walked along a window: some steps now, the rest later.
//!
//! Candidate and neighbours take turns, a few samples each, so that no trace is stored. A fault that acts on the output
//! alone (the backlash) needs no motion of its own: it taps the candidate's.

use super::config::Config;
use super::sums::{CHANNELS, Sums};
use super::window::{Packed, Scale, Window};
use crate::integrate::{Place, Run, Stepper, advance_some};
use crate::model::Model;
use crate::model::play::play;
use crate::model::sensor::{Lvdt, LvdtState};
use crate::model::state::{Input, InputSegment, Mode, State};
use crate::parameter::Reach;

/// Samples that one motion walks before the next one follows: more would save what a change of model costs, and take
/// more of the monitor's memory than its budget has.
const CHUNK: usize = 11;
/// Width of the forward difference, in genes.
const DIFFERENCE: f32 = 2e-3;

/// Where a motion starts, or where it has ended.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Start {
    pub(super) state: State<f32>,
    pub(super) mode: Mode,
    /// User position behind the backlash, m.
    pub(super) user: f32,
    /// Command one sample before the window, m; none where the motion starts with the window.
    pub(super) command: Option<f32>,
}

impl Start {
    /// At rest at a position.
    pub(super) fn at_rest(model: &Model<f32>, ram: f32) -> Self {
        Self { state: model.at_rest(ram), mode: model.mode_at_rest(), user: ram, command: None }
    }

    /// A state that an actuator can be in?
    pub(super) fn is_sound(&self) -> bool {
        self.state.to_array().iter().all(|value| value.is_finite()) && self.user.is_finite()
    }
}

/// What the user's sensor sees of a motion.
#[derive(Clone, Copy, Debug)]
struct Tap {
    half_backlash: f32,
    user: f32,
    lvdt: Lvdt<f32>,
    seen: LvdtState<f32>,
}

impl Tap {
    fn new(model: &Model<f32>, period: f32, user: f32) -> Self {
        Self {
            half_backlash: model.half_backlash(),
            user,
            lvdt: Lvdt::new(model.parameters(), period),
            seen: LvdtState::at_rest(user),
        }
    }
}

/// Predictions of one sample: those of the candidate and of its neighbours.
#[derive(Clone, Copy, Debug)]
struct Predicted<const GENES: usize> {
    base: [f32; CHANNELS],
    moved: [[f32; CHANNELS]; GENES],
}

/// How the ram went while it was compared, as the candidate has it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Path {
    /// Turns by more than [`Path::LEAST`].
    pub(super) reversals: u32,
    /// m.
    pub(super) travel: f32,
    last: f32,
    extreme: f32,
    direction: i8,
}

impl Path {
    /// A turn that is shorter than this is none, m.
    const LEAST: f32 = 2e-5;

    fn start(ram: f32) -> Self {
        Self { last: ram, extreme: ram, ..Self::default() }
    }

    /// Looks at the next sample, which is compared or not.
    fn look(&mut self, ram: f32, compared: bool) {
        if !compared {
            *self = Self::start(ram);
            return;
        }
        self.travel += (ram - self.last).abs();
        self.last = ram;
        let gone = ram - self.extreme;
        let way = if gone < 0.0 { -1 } else { 1 };
        if gone.abs() > Self::LEAST && way != self.direction {
            self.reversals += u32::from(self.direction != 0);
            self.direction = way;
        }
        if way == self.direction {
            self.extreme = ram;
        }
    }
}

/// A walk along a window in progress.
#[derive(Clone, Debug)]
pub(super) struct Pass<const GENES: usize> {
    pub(super) genes: [f32; GENES],
    widths: [f32; GENES],
    /// Are the derivatives wanted?
    with_neighbours: bool,
    /// The model whose turn it is. It is made anew at every turn: three would take a kilobyte more.
    model: Model<f32>,
    base: Run<f32>,
    moved: [Run<f32>; GENES],
    /// Has a neighbour a motion of its own?
    is_own: [bool; GENES],
    base_tap: Tap,
    moved_taps: [Tap; GENES],
    /// Whose turn it is: 0 the candidate's, then the neighbours'.
    turn: usize,
    /// First sample of the chunk.
    chunk: usize,
    /// Samples of the chunk that the motion whose turn it is has done.
    done: usize,
    place: Option<Place>,
    predicted: [Predicted<GENES>; CHUNK],
    sums: Sums<GENES>,
    path: Path,
}

/// What a pass needs besides itself.
pub(super) struct Scene<'a, const GENES: usize, const SAMPLES: usize> {
    pub(super) config: &'a Config<GENES>,
    pub(super) scale: Scale,
    pub(super) window: &'a Window<SAMPLES>,
    pub(super) start: &'a Start,
    /// Samples that are not compared, while the start is forgotten.
    pub(super) settle: usize,
}

impl<const GENES: usize, const SAMPLES: usize> Scene<'_, GENES, SAMPLES> {
    /// The input where the motion starts.
    fn first_input(&self) -> Input<f32> {
        let first = self.window.get(0).command(self.scale);
        Input { command: self.start.command.unwrap_or(first), command_rate: 0.0, force: 0.0 }
    }

    /// The line of the command that leads to a sample; none where the motion starts there.
    fn segment(&self, sample: usize) -> Option<InputSegment<f32>> {
        let before = match sample.checked_sub(1) {
            Some(before) => Some(self.window.get(before).command(self.scale)),
            None => self.start.command,
        };
        let here = self.window.get(sample).command(self.scale);
        before.map(|before| {
            InputSegment::between([before, here], [0.0; 2], 0.0, 1.0 / self.config.sample_period)
        })
    }

    /// The input at a sample.
    fn input(&self, sample: usize) -> Input<f32> {
        let command = self.window.get(sample).command(self.scale);
        self.segment(sample).map_or(Input { command, command_rate: 0.0, force: 0.0 }, |segment| Input {
            command,
            ..segment.start
        })
    }
}

/// Widths of the differences; they point inwards at the upper bound.
fn widths<const GENES: usize>(genes: &[f32; GENES]) -> [f32; GENES] {
    genes.map(|gene| if gene + DIFFERENCE > 1.0 { -DIFFERENCE } else { DIFFERENCE })
}

impl<const GENES: usize> Pass<GENES> {
    /// The start of a walk of a candidate.
    #[inline(always)]
    pub(super) fn new<const SAMPLES: usize>(
        scene: &Scene<'_, GENES, SAMPLES>,
        genes: &[f32; GENES],
        with_neighbours: bool,
    ) -> Self {
        let Scene { config, start, .. } = scene;
        let model = config.model(genes);
        let base = Run::starting(&model, start.state, start.mode, &scene.first_input());
        let tap = Tap::new(&model, config.sample_period, start.user);
        let mut pass = Self {
            genes: *genes,
            widths: widths(genes),
            with_neighbours,
            model,
            base,
            moved: [base; GENES],
            is_own: [false; GENES],
            base_tap: tap,
            moved_taps: [tap; GENES],
            turn: 0,
            chunk: 0,
            done: 0,
            place: None,
            predicted: [Predicted { base: [0.0; CHANNELS], moved: [[0.0; CHANNELS]; GENES] }; CHUNK],
            sums: Sums::NONE,
            path: Path::start(start.state.ground()),
        };
        pass.restart(scene, genes, with_neighbours);
        pass
    }

    /// Genes of the candidate (turn 0) or of a neighbour.
    fn genes_of(&self, turn: usize) -> [f32; GENES] {
        core::array::from_fn(|gene| {
            if turn == gene + 1 { self.genes[gene] + self.widths[gene] } else { self.genes[gene] }
        })
    }

    /// Goes on by at most `allowance` steps, and takes what it has used off it. True at the end of the window.
    pub(super) fn advance<S: Stepper<f32>, const SAMPLES: usize>(
        &mut self,
        scene: &Scene<'_, GENES, SAMPLES>,
        stepper: &mut S,
        allowance: &mut u32,
    ) -> bool {
        while self.chunk < SAMPLES {
            let end = CHUNK.min(SAMPLES - self.chunk);
            while self.done < end {
                if !self.walk(scene, stepper, allowance) {
                    return false;
                }
                self.done += 1;
            }
            self.done = 0;
            let next = (self.turn..GENES)
                .find(|&gene| self.with_neighbours && self.is_own.get(gene).copied().unwrap_or(false));
            if let Some(gene) = next {
                self.turn = gene + 1;
            } else {
                self.turn = 0;
                self.gather(scene, end);
                self.chunk += CHUNK;
            }
            if self.with_neighbours {
                self.model = scene.config.model(&self.genes_of(self.turn));
            }
            // Another motion: its constant terms are others.
            stepper.begin(scene.config.sample_period, false, false);
        }
        true
    }

    /// Takes the motion whose turn it is to the next sample; false where the allowance ends before.
    fn walk<S: Stepper<f32>, const SAMPLES: usize>(
        &mut self,
        scene: &Scene<'_, GENES, SAMPLES>,
        stepper: &mut S,
        allowance: &mut u32,
    ) -> bool {
        let sample = self.chunk + self.done;
        let own = self.turn.checked_sub(1);
        let Some(run) = own.map_or(Some(&mut self.base), |gene| self.moved.get_mut(gene)) else {
            return true;
        };
        let (base_tap, moved_taps, is_own) = (&mut self.base_tap, &mut self.moved_taps, &self.is_own);
        let shares = |gene: usize| own.is_none() && !is_own.get(gene).copied().unwrap_or(true);
        if let Some(segment) = scene.segment(sample) {
            let before = run.steps;
            let done =
                advance_some(stepper, &self.model, run, &segment, &mut self.place, *allowance, |ram| {
                    for (gene, tap) in moved_taps.iter_mut().enumerate() {
                        if own == Some(gene) || shares(gene) {
                            tap.user = play(ram, tap.user, tap.half_backlash);
                        }
                    }
                    if own.is_none() {
                        base_tap.user = play(ram, base_tap.user, base_tap.half_backlash);
                    }
                });
            *allowance = allowance.saturating_sub(run.steps.wrapping_sub(before));
            if !done {
                return false;
            }
        }
        let demand = self.model.demand(&run.mode, &run.state, &scene.input(sample));
        let current = self.model.controller.current(run.mode.current, demand, 1.0);
        if own.is_none() {
            self.path.look(run.state.ground(), sample >= scene.settle);
        }
        let Some(place) = self.predicted.get_mut(self.done) else { return true };
        let see = |tap: &mut Tap| [tap.lvdt.sample(&mut tap.seen, tap.user), current];
        if own.is_none() {
            place.base = see(base_tap);
        }
        for (gene, (tap, predicted)) in moved_taps.iter_mut().zip(&mut place.moved).enumerate() {
            if own == Some(gene) || shares(gene) {
                *predicted = see(tap);
            }
        }
        true
    }

    /// Adds the residuals of a chunk to the sums.
    fn gather<const SAMPLES: usize>(&mut self, scene: &Scene<'_, GENES, SAMPLES>, count: usize) {
        let noise = scene.config.believed_noise();
        for (offset, predicted) in self.predicted.iter().enumerate().take(count) {
            let sample = self.chunk + offset;
            if sample < scene.settle {
                continue;
            }
            let packed: Packed = scene.window.get(sample);
            let measured = [packed.user(scene.scale), packed.current(scene.scale)];
            for channel in 0..CHANNELS {
                let weight = 1.0 / noise[channel];
                let residual = measured[channel].map(|value| (value - predicted.base[channel]) * weight);
                let slope = core::array::from_fn(|gene| {
                    let change = predicted.moved[gene][channel] - predicted.base[channel];
                    if self.with_neighbours { change * weight / self.widths[gene] } else { 0.0 }
                });
                self.sums.add(channel, residual, &slope);
            }
        }
    }

    /// What the walk has gathered.
    pub(super) const fn sums(&self) -> &Sums<GENES> {
        &self.sums
    }

    /// How the ram went.
    pub(super) const fn path(&self) -> &Path {
        &self.path
    }

    /// Where the candidate's motion has ended, after the last sample of the window.
    pub(super) fn end<const SAMPLES: usize>(&self, scene: &Scene<'_, GENES, SAMPLES>) -> Start {
        Start {
            state: self.base.state,
            mode: self.base.mode,
            user: self.base_tap.user,
            command: Some(scene.window.get(SAMPLES.saturating_sub(1)).command(scene.scale)),
        }
    }

    /// Starts again with other genes. Not inlined: see [`Analysis`](super::analysis::Analysis).
    #[inline(never)]
    pub(super) fn restart<const SAMPLES: usize>(
        &mut self,
        scene: &Scene<'_, GENES, SAMPLES>,
        genes: &[f32; GENES],
        with_neighbours: bool,
    ) {
        let Scene { config, start, .. } = scene;
        self.genes = *genes;
        self.widths = widths(genes);
        self.with_neighbours = with_neighbours;
        self.model = config.model(genes);
        let input = scene.first_input();
        self.base = Run::starting(&self.model, start.state, start.mode, &input);
        self.base_tap = Tap::new(&self.model, config.sample_period, start.user);
        self.is_own = [false; GENES];
        self.sums = Sums::NONE;
        self.path = Path::start(start.state.ground());
        self.place = None;
        (self.turn, self.chunk, self.done) = (0, 0, 0);
        for gene in 0..GENES {
            if with_neighbours {
                let model = config.model(&self.genes_of(gene + 1));
                self.is_own[gene] =
                    Model::<f32>::reach(config.form, config.faults[gene].free.parameter) != Reach::Output;
                self.moved[gene] = Run::starting(&model, start.state, start.mode, &input);
                self.moved_taps[gene] = Tap::new(&model, config.sample_period, start.user);
            }
        }
    }

    /// Evaluations of the model that it is worth.
    pub(super) fn evaluations(&self) -> u32 {
        1 + self.is_own.iter().filter(|&&is_own| is_own).count() as u32
    }

    /// Steps that it has taken.
    pub(super) fn steps(&self) -> u32 {
        let own = self.moved.iter().zip(self.is_own).filter(|(_, is_own)| *is_own);
        own.fold(self.base.steps, |sum, (run, _)| sum.saturating_add(run.steps))
    }
}
