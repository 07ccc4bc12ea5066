//! One candidate, and its neighbours for the derivatives, walked along a window: some steps now, the rest later.
//!
//! Candidate and neighbours take turns, a few samples each, so that no trace is stored. A fault that acts on the output
//! alone (the backlash) needs no motion of its own: it taps the candidate's.

use super::config::Config;
use super::slot::Slot;
use super::sums::{CHANNELS, Sums};
use super::window::{Packed, Scale, Window};
use crate::integrate::{Place, Run, Stepper, advance_some};
use crate::model::Model;
use crate::model::state::{Input, InputSegment, Mode, State};
use crate::parameter::Reach;
use crate::simulate::Follower;

/// Samples that one motion walks before the next one follows: more would save what a change of model costs, and take
/// more of the monitor's memory than its budget has.
const CHUNK: usize = 40;
/// Width of the forward difference, in genes.
const DIFFERENCE: f32 = 2e-3;
/// Time that a valve takes to open or to close, s: where the spool is not known, the ram is as far off as it moves in that.
pub(super) const VALVE_TIME: f32 = 0.01;
/// Part of the noise by which motions from two starts may differ, and their starts count as forgotten.
pub(super) const ALIKE: f32 = 0.2;

/// Where a motion starts, or where it has ended.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Start {
    pub(super) state: State<f32>,
    pub(super) mode: Mode,
    /// User position behind the backlash, m.
    pub(super) user: f32,
    /// Command one sample before the window, m; none where the motion starts with the window.
    pub(super) command: Option<f32>,
    /// How far from here the ram may be instead, m: 0 where the motion has long been followed.
    pub(super) doubt: f32,
}

impl Start {
    /// At a position, m, in motion with a velocity, m/s: the spool lets through what that takes where no pressure drops.
    pub(super) fn moving(model: &Model<f32>, ram: f32, velocity: f32) -> Self {
        let mut state = State { ram_velocity: velocity, ..model.at_rest(ram) };
        let mut mode = model.mode_at_rest();
        mode.jack = i8::from(velocity > 0.0) - i8::from(velocity < 0.0);
        let parameters = model.parameters();
        let spool = parameters.jack_area * velocity / parameters.flow_gain;
        // A spool in its dead zone, or in the play of its feedback, starts in the middle.
        if spool.abs() < parameters.spool_stop && mode.overlap != 0 && mode.feedback_play != 0 {
            state.spool = spool;
        }
        Self { state, mode, user: ram, command: None, doubt: velocity * VALVE_TIME }
    }

    /// Is every entry a number? A model that has run away leaves none.
    pub(super) fn is_finite(&self) -> bool {
        self.state.to_array().iter().all(|value| value.is_finite()) && self.user.is_finite()
    }

    /// A state that an actuator can be in?
    pub(super) fn is_sound(&self, bounds: &State<f32>) -> bool {
        let Self { state, mode, user, command, doubt } = self;
        let inside = |value: f32, bound: f32| value.abs() <= bound;
        // Bounds are a quarter beyond the stops.
        let stops = |piece: i8, value: f32, bound: f32| {
            piece.unsigned_abs() < 2 || value * f32::from(piece.signum()) >= 0.75 * bound
        };
        state.to_array().into_iter().zip(bounds.to_array()).all(|(value, bound)| inside(value, bound))
            && [state.ram_rest, state.spool_rest, *user, command.unwrap_or(0.0), 0.5 * doubt]
                .iter()
                .all(|&value| inside(value, bounds.ram))
            && stops(mode.spool, state.spool, bounds.spool)
            && stops(mode.jack, state.ram, bounds.ram)
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
    const IDLE: Self = Self { reversals: 0, travel: 0.0, last: 0.0, extreme: 0.0, direction: 0 };
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

/// What a walk along a window is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Aim {
    /// What the candidate leaves.
    Cost,
    /// That and its derivatives, of a neighbour for each gene.
    Slopes,
    /// When its motion has forgotten where it started. Its neighbour is the same candidate from as far off as the start may
    /// be.
    Settling,
}

/// A walk along a window in progress.
#[derive(Clone, Debug)]
pub(super) struct Pass<const GENES: usize> {
    pub(super) genes: [f32; GENES],
    widths: [f32; GENES],
    aim: Aim,
    /// Samples that are not compared, while the start is forgotten.
    settle: usize,
    /// How far from where it has ended the candidate may be instead, m.
    doubt: f32,
    /// The model whose turn it is. It is made anew at every turn: three would take a kilobyte more.
    model: Slot<Model<f32>>,
    base: Run<f32>,
    moved: [Run<f32>; GENES],
    sight: Sight<GENES>,
    /// Whose turn it is: 0 the candidate's, then the neighbours'.
    turn: usize,
    /// First sample of the chunk.
    chunk: usize,
    /// Samples of the chunk that the motion whose turn it is has done.
    done: usize,
    place: Place,
    sums: Sums<GENES>,
}

/// What is seen of the motions of a chunk.
#[derive(Clone, Debug)]
struct Sight<const GENES: usize> {
    /// Has a neighbour a motion of its own?
    is_own: [bool; GENES],
    base_user: Follower<f32>,
    moved_users: [Follower<f32>; GENES],
    predicted: [Predicted<GENES>; CHUNK],
    path: Path,
}

impl<const GENES: usize> Sight<GENES> {
    /// Lets what is behind the ram of the candidate (turn 0) or of a neighbour follow it.
    #[inline(always)]
    fn each_user(&mut self, turn: usize, follow: impl Fn(&mut Follower<f32>)) {
        if turn == 0 {
            follow(&mut self.base_user);
        }
        for (gene, user) in self.moved_users.iter_mut().enumerate() {
            if is_tapped(&self.is_own, turn, gene) {
                follow(user);
            }
        }
    }

    /// A motion has come to a sample of the chunk, which is compared or not: its ram over ground, m.
    #[inline(always)]
    fn look(&mut self, turn: usize, place: usize, ram: f32, current: f32, compared: bool) {
        let Some(place) = self.predicted.get_mut(place) else { return };
        if turn == 0 {
            self.path.look(ram, compared);
            place.base = [self.base_user.shown(), current];
        }
        for (gene, (user, predicted)) in self.moved_users.iter_mut().zip(&mut place.moved).enumerate() {
            if is_tapped(&self.is_own, turn, gene) {
                *predicted = [user.shown(), current];
            }
        }
    }
}

/// Does the motion whose turn it is move what a gene's neighbour shows?
#[inline(always)]
fn is_tapped<const GENES: usize>(is_own: &[bool; GENES], turn: usize, gene: usize) -> bool {
    let is_own = is_own.get(gene).copied().unwrap_or(true);
    if turn == 0 { !is_own } else { turn == gene + 1 }
}

/// What a pass needs besides itself.
pub(super) struct Scene<'a, const GENES: usize, const SAMPLES: usize> {
    pub(super) config: &'a Config<GENES>,
    pub(super) scale: Scale,
    pub(super) window: &'a Window<SAMPLES>,
    pub(super) start: &'a Start,
    /// Least number of samples that are not compared, while the start is forgotten.
    pub(super) settle: usize,
    /// Samples that the analysis has time for.
    pub(super) time: usize,
}

impl<const GENES: usize, const SAMPLES: usize> Scene<'_, GENES, SAMPLES> {
    /// The input where the motion starts.
    fn first_input(&self) -> Input<f32> {
        let first = self.command(0);
        Input { command: self.start.command.unwrap_or(first), command_rate: 0.0, force: 0.0 }
    }

    /// The command one sample before, m; none where the motion starts with the window.
    fn command_before(&self, sample: usize) -> Option<f32> {
        match sample.checked_sub(1) {
            Some(before) => Some(self.command(before)),
            None => self.start.command,
        }
    }

    /// The command at a sample, m.
    #[inline(always)]
    fn command(&self, sample: usize) -> f32 {
        self.window.get(sample).command(self.scale)
    }

    /// The command as it leads to a sample, before it may jump there; none where the motion starts there.
    fn segment(&self, sample: usize) -> Option<InputSegment<f32>> {
        self.command_before(sample).map(|before| {
            let arriving = if self.config.holds_command { before } else { self.command(sample) };
            InputSegment::between([before, arriving], [0.0; 2], 0.0, 1.0 / self.config.sample_period)
        })
    }

    /// The input at a sample.
    fn input(&self, sample: usize) -> Input<f32> {
        let command = self.command(sample);
        self.segment(sample).map_or(Input { command, command_rate: 0.0, force: 0.0 }, |segment| Input {
            command,
            ..segment.start
        })
    }

    /// Samples from one on, at most a number of them, at which the command does not jump from where it was.
    fn unbroken(&self, sample: usize, before: f32, most: u32) -> u32 {
        let jumps = |&done: &u32| self.command(sample + done as usize) != before;
        if self.config.holds_command { (0..most).find(jumps).unwrap_or(most) } else { most }
    }
}

/// Genes of the candidate (turn 0) or of a neighbour.
fn moved_genes<const GENES: usize>(genes: &[f32; GENES], widths: &[f32; GENES], turn: usize) -> [f32; GENES] {
    core::array::from_fn(|gene| if turn == gene + 1 { genes[gene] + widths[gene] } else { genes[gene] })
}

/// The motion whose turn it is.
fn turned<'a, const GENES: usize>(
    base: &'a mut Run<f32>,
    moved: &'a mut [Run<f32>; GENES],
    turn: usize,
) -> Option<&'a mut Run<f32>> {
    match turn.checked_sub(1) {
        None => Some(base),
        Some(gene) => moved.get_mut(gene),
    }
}

/// Widths of the differences; they point inwards at the upper bound.
fn widths<const GENES: usize>(genes: &[f32; GENES]) -> [f32; GENES] {
    genes.map(|gene| if gene + DIFFERENCE > 1.0 { -DIFFERENCE } else { DIFFERENCE })
}

impl<const GENES: usize> Pass<GENES> {
    /// A pass that goes nowhere before it is [restarted](Self::restart): all zeros.
    pub(super) const IDLE: Self = Self {
        genes: [0.0; GENES],
        widths: [0.0; GENES],
        aim: Aim::Cost,
        settle: 0,
        doubt: 0.0,
        model: Slot::Empty,
        base: Run::IDLE,
        moved: [Run::IDLE; GENES],
        sight: Sight {
            is_own: [false; GENES],
            base_user: Follower::IDLE,
            moved_users: [Follower::IDLE; GENES],
            predicted: [Predicted { base: [0.0; CHANNELS], moved: [[0.0; CHANNELS]; GENES] }; CHUNK],
            path: Path::IDLE,
        },
        turn: 0,
        chunk: 0,
        done: 0,
        place: Place::BEFORE,
        sums: Sums::NONE,
    };

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
                self.enter(stepper);
                self.glide(scene, stepper, end, allowance);
                if self.done < end {
                    if !self.walk(scene, stepper, allowance) {
                        return false;
                    }
                    if scene.config.holds_command {
                        self.enter(stepper);
                        self.jump(scene, stepper);
                    }
                    self.look(scene);
                    self.done += 1;
                }
            }
            self.done = 0;
            let next = (self.turn..GENES).find(|&gene| self.sight.is_own.get(gene).copied().unwrap_or(false));
            if let Some(gene) = next {
                self.turn = gene + 1;
            } else {
                self.turn = 0;
                self.gather(scene, end);
                self.chunk += CHUNK;
            }
            if self.aim == Aim::Slopes {
                self.turn_to(scene.config);
            }
            // Another motion: its constant terms are others.
            stepper.begin(scene.config.sample_period, false, false);
        }
        true
    }

    /// Enters the mode of the motion whose turn it is. Not inlined: what makes matrices has a stack of its own.
    #[inline(never)]
    fn enter<S: Stepper<f32>>(&mut self, stepper: &mut S) {
        let run = turned(&mut self.base, &mut self.moved, self.turn);
        if let (Some(run), Some(model)) = (run, self.model.get()) {
            stepper.enter(model, run);
        }
    }

    /// Turns the model to the motion whose turn it is.
    #[inline(never)]
    fn turn_to(&mut self, config: &Config<GENES>) {
        let genes = moved_genes(&self.genes, &self.widths, self.turn);
        if let Some(model) = self.model.get_mut() {
            model.change(|parameters| config.set(parameters, &genes));
        }
    }

    /// Takes the motion whose turn it is to the next sample; false where the allowance ends before.
    #[inline(never)]
    fn walk<S: Stepper<f32>, const SAMPLES: usize>(
        &mut self,
        scene: &Scene<'_, GENES, SAMPLES>,
        stepper: &mut S,
        allowance: &mut u32,
    ) -> bool {
        let (Some(run), Some(model), Some(segment)) = (
            turned(&mut self.base, &mut self.moved, self.turn),
            self.model.get(),
            scene.segment(self.chunk + self.done),
        ) else {
            return true;
        };
        let (turn, sight) = (self.turn, &mut self.sight);
        let before = run.steps;
        let follow = |share, state: &State<f32>| {
            sight.each_user(turn, |user| user.follow(model, share, state));
        };
        let done = advance_some(stepper, model, run, &segment, &mut self.place, *allowance, follow);
        *allowance = allowance.saturating_sub(run.steps.wrapping_sub(before));
        done
    }

    /// Takes the motion whose turn it is over the jump of a command that is held, at the sample to which it has come.
    #[inline(never)]
    fn jump<S: Stepper<f32>, const SAMPLES: usize>(
        &mut self,
        scene: &Scene<'_, GENES, SAMPLES>,
        stepper: &S,
    ) {
        let sample = self.chunk + self.done;
        let run = turned(&mut self.base, &mut self.moved, self.turn);
        if let (Some(run), Some(model), Some(before)) = (run, self.model.get(), scene.command_before(sample))
        {
            let to = scene.input(sample);
            if to.command != before {
                run.jump(stepper, model, &Input { command: before, ..to }, &to, 0.0);
            }
        }
    }

    /// Shows the sample to which the motion whose turn it is has come.
    #[inline(never)]
    fn look<const SAMPLES: usize>(&mut self, scene: &Scene<'_, GENES, SAMPLES>) {
        let sample = self.chunk + self.done;
        if let (Some(run), Some(model)) =
            (turned(&mut self.base, &mut self.moved, self.turn), self.model.get())
        {
            let demand = model.demand(&run.mode, &run.state, &scene.input(sample));
            let current = model.controller.current(run.mode.current, demand, 1.0);
            let ram = run.state.ground();
            self.sight.look(self.turn, self.done, ram, current, sample >= self.settle);
        }
    }

    /// Takes the motion whose turn it is over the next samples of the chunk as long as nothing happens in them.
    #[inline(never)]
    fn glide<S: Stepper<f32>, const SAMPLES: usize>(
        &mut self,
        scene: &Scene<'_, GENES, SAMPLES>,
        stepper: &mut S,
        end: usize,
        allowance: &mut u32,
    ) {
        let first = self.chunk + self.done;
        let (Some(run), Some(model)) = (turned(&mut self.base, &mut self.moved, self.turn), self.model.get())
        else {
            return;
        };
        let (Some(before), false) = (scene.command_before(first), self.place.is_inside()) else { return };
        let most = scene.unbroken(first, before, end.saturating_sub(self.done) as u32);
        let (turn, settle, sight) = (self.turn, self.settle, &mut self.sight);
        let (mut place, mut sample) = (self.done, first);
        stepper.enter(model, run);
        let command = |done: u32| (done < most).then(|| scene.command(first + done as usize));
        let taken = run.steps;
        stepper.glide(run, before, *allowance, command, |passing| {
            sight.each_user(turn, |user| user.pass(passing));
            sight.look(turn, place, passing.ram, passing.current, sample >= settle);
            place += 1;
            sample += 1;
        });
        *allowance = allowance.saturating_sub(run.steps.wrapping_sub(taken));
        self.done = place;
    }

    /// Adds the residuals of a chunk to the sums, or looks how far its motions differ.
    #[inline(never)]
    fn gather<const SAMPLES: usize>(&mut self, scene: &Scene<'_, GENES, SAMPLES>, count: usize) {
        let noise = scene.config.believed_noise();
        for (offset, predicted) in self.sight.predicted.iter().enumerate().take(count) {
            let sample = self.chunk + offset;
            if sample < self.settle {
                continue;
            }
            if let (Aim::Settling, Some(other)) = (self.aim, predicted.moved.first()) {
                let apart = |channel: usize| other[channel] - predicted.base[channel];
                // What runs away is to be compared: nothing explains less.
                let differs =
                    |channel| (ALIKE * noise[channel]..f32::INFINITY).contains(&apart(channel).abs());
                if (0..CHANNELS).any(differs) {
                    self.settle = sample + 1;
                }
                self.doubt = apart(0);
                continue;
            }
            let packed: Packed = scene.window.get(sample);
            let measured = [packed.user(scene.scale), packed.current(scene.scale)];
            for channel in 0..CHANNELS {
                let weight = 1.0 / noise[channel];
                let residual = measured[channel].map(|value| (value - predicted.base[channel]) * weight);
                let slope = core::array::from_fn(|gene| {
                    let change = predicted.moved[gene][channel] - predicted.base[channel];
                    if self.aim == Aim::Slopes { change * weight / self.widths[gene] } else { 0.0 }
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
        &self.sight.path
    }

    /// Where the candidate's motion has ended, after the last sample of the window.
    pub(super) fn end<const SAMPLES: usize>(&self, scene: &Scene<'_, GENES, SAMPLES>) -> Start {
        Start {
            state: self.base.state,
            mode: self.base.mode,
            user: self.sight.base_user.position(),
            command: Some(scene.window.get(SAMPLES.saturating_sub(1)).command(scene.scale)),
            doubt: self.doubt,
        }
    }

    /// Begins a window: nothing is known of how long its start matters.
    pub(super) const fn begin(&mut self, settle: usize) {
        self.settle = settle;
        self.doubt = 0.0;
    }

    /// Starts with genes. Not inlined: see [`Analysis`](super::analysis::Analysis).
    #[inline(never)]
    pub(super) fn restart<const SAMPLES: usize>(
        &mut self,
        scene: &Scene<'_, GENES, SAMPLES>,
        genes: &[f32; GENES],
        aim: Aim,
    ) {
        let Scene { config, start, .. } = scene;
        self.genes = *genes;
        let neighbours = match aim {
            Aim::Cost => 0,
            Aim::Settling => 1,
            Aim::Slopes => GENES,
        };
        self.widths = if aim == Aim::Slopes { widths(genes) } else { [0.0; GENES] };
        self.aim = aim;
        self.model = Slot::Empty;
        let input = scene.first_input();
        self.sight.is_own = [false; GENES];
        self.sums = Sums::NONE;
        self.sight.path = Path::start(start.state.ground());
        self.place = Place::BEFORE;
        (self.turn, self.chunk, self.done) = (0, 0, 0);
        // The candidate last: its turn is the first.
        for turn in (0..=GENES).rev() {
            let (run, user) = match turn.checked_sub(1) {
                None => (&mut self.base, &mut self.sight.base_user),
                Some(gene) => {
                    let (Some(fault), Some(is_own), Some(run), Some(user), true) = (
                        config.faults.get(gene),
                        self.sight.is_own.get_mut(gene),
                        self.moved.get_mut(gene),
                        self.sight.moved_users.get_mut(gene),
                        gene < neighbours,
                    ) else {
                        continue;
                    };
                    *is_own = aim == Aim::Settling
                        || Model::<f32>::reach(config.form, fault.free.parameter) != Reach::Output;
                    (run, user)
                }
            };
            self.model = Slot::Full(config.model(&moved_genes(&self.genes, &self.widths, turn)));
            if let Some(model) = self.model.get() {
                let mut state = start.state;
                if aim == Aim::Settling && turn > 0 {
                    state.move_ram(start.doubt);
                }
                *run = Run::starting(model, state, start.mode, &input);
                *user = Follower::of(model, config.sample_period);
                user.start(model, &state, start.user);
            }
        }
    }

    /// Evaluations of the model that it is worth.
    pub(super) fn evaluations(&self) -> u32 {
        1 + self.sight.is_own.iter().filter(|&&is_own| is_own).count() as u32
    }

    /// Steps that it has taken.
    pub(super) fn steps(&self) -> u32 {
        let own = self.moved.iter().zip(self.sight.is_own).filter(|(_, is_own)| *is_own);
        own.fold(self.base.steps, |sum, (run, _)| sum.saturating_add(run.steps))
    }
}
