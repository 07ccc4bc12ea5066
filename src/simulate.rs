//! A model, its integrator and its sensors as one thing that answers: what would the channels show next?

use crate::integrate::{Run, Stepper, advance, advance_over_jump};
use crate::model::Drive;
use crate::model::Model;
use crate::model::play::play;
use crate::model::sensor::{Lvdt, LvdtState};
use crate::model::state::{Input, InputSegment, Mode, Outputs, State};
use crate::scalar::Real;

/// What is the same for a whole simulation: model and sensors.
#[derive(Clone, Copy, Debug)]
pub struct Actuator<T> {
    /// The model.
    pub model: Model<T>,
    lvdt: Lvdt<T>,
}

/// What changes from sample to sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion<T> {
    /// The loop's place in its motion.
    pub run: Run<T>,
    /// User position behind the backlash, m.
    pub user: T,
    lvdt: LvdtState<T>,
}

impl<T: Real> Motion<T> {
    /// A motion that goes on from a run, with the user at a position behind the backlash, m.
    pub const fn resuming(run: Run<T>, user: T) -> Self {
        Self { run, user, lvdt: LvdtState::at_rest(user) }
    }
}

/// Backlash and LVDT of another candidate behind the same ram: where candidates differ in their output only, one motion
/// serves them all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Follower<T> {
    half_backlash: T,
    lvdt: Lvdt<T>,
    user: T,
    /// What is added behind the backlash, m.
    behind: T,
    state: LvdtState<T>,
}

impl<T: Real> Follower<T> {
    /// The output of an actuator, at rest at zero.
    pub fn of(actuator: &Actuator<T>) -> Self {
        let half_backlash = actuator.model.half_backlash();
        Self {
            half_backlash,
            lvdt: actuator.lvdt,
            user: T::ZERO,
            behind: T::ZERO,
            state: LvdtState::at_rest(T::ZERO),
        }
    }

    /// Rests at a user position, m, from now on.
    pub fn restart(&mut self, user: T) {
        self.user = user;
        self.behind = T::ZERO;
        self.state = LvdtState::at_rest(user);
    }

    /// Follows the ram to a position, m.
    #[inline(always)]
    pub fn follow(&mut self, ram: T) {
        self.user = play(ram, self.user, self.half_backlash);
    }

    /// Takes over what a motion has behind the backlash at a sample, m.
    #[inline(always)]
    pub(crate) fn carry(&mut self, behind: T) {
        self.behind = behind;
    }

    /// What its LVDT shows. Call it once a sample.
    #[inline(always)]
    pub fn shown(&mut self) -> T {
        self.lvdt.sample(&mut self.state, self.user + self.behind)
    }
}

impl<T: Real> Actuator<T> {
    /// An actuator whose channels are sampled with a period in s.
    pub fn new(model: Model<T>, sample_period: T) -> Self {
        Self { model, lvdt: Lvdt::new(model.parameters(), sample_period) }
    }

    /// The motion that starts at rest at a ram position, the user centred behind the backlash.
    pub fn at_rest(&self, ram: T, input: &Input<T>) -> Motion<T> {
        Motion::resuming(Run::at_rest(&self.model, ram, input), ram)
    }

    /// Advances a motion by one sample.
    #[inline]
    pub fn advance<S: Stepper<T>>(&self, stepper: &mut S, motion: &mut Motion<T>, segment: &InputSegment<T>) {
        self.lead(stepper, motion, segment, &mut []);
    }

    /// Advances a motion by one sample, with followers, which see what the ram does.
    #[inline]
    pub fn lead<S: Stepper<T>>(
        &self,
        stepper: &mut S,
        motion: &mut Motion<T>,
        segment: &InputSegment<T>,
        followers: &mut [Option<Follower<T>>],
    ) {
        let half = self.model.half_backlash();
        let mut user = motion.user;
        advance(stepper, &self.model, &mut motion.run, segment, |ram| {
            user = play(ram, user, half);
            for follower in followers.iter_mut().flatten() {
                follower.follow(ram);
            }
        });
        motion.user = user;
    }

    /// Advances a motion by one sample inside of which the command jumps from one line to another, `part` of the sample
    /// before the jump, with followers.
    #[cold]
    pub fn lead_over_jump<S: Stepper<T>>(
        &self,
        stepper: &mut S,
        motion: &mut Motion<T>,
        lines: [&InputSegment<T>; 2],
        part: T,
        followers: &mut [Option<Follower<T>>],
    ) {
        let half = self.model.half_backlash();
        let Motion { run, user, .. } = motion;
        advance_over_jump(stepper, &self.model, run, lines, part, |ram| {
            *user = play(ram, *user, half);
            for follower in followers.iter_mut().flatten() {
                follower.follow(ram);
            }
        });
    }

    /// The command jumps at the sample at which a motion is.
    pub fn jump<S: Stepper<T>>(
        &self,
        stepper: &mut S,
        motion: &mut Motion<T>,
        from: &Input<T>,
        to: &Input<T>,
        time: T,
    ) {
        stepper.enter(&self.model, &motion.run);
        motion.run.jump(stepper, &self.model, from, to, time);
    }

    /// Takes a motion over samples in which nothing happens (see [`Stepper::glide`]), from a command (m) on, and shows
    /// the number of each and what the channels show; returns how many it were.
    #[inline(always)]
    pub fn glide<S: Stepper<T>>(
        &self,
        stepper: &mut S,
        motion: &mut Motion<T>,
        command: T,
        commands: &[T],
        mut show: impl FnMut(usize, T, &Outputs<T>),
    ) -> usize {
        let Motion { run, user, lvdt } = motion;
        let half = self.model.half_backlash();
        let mut sample = 0;
        stepper.enter(&self.model, run);
        let next = |done: u32| commands.get(done as usize).copied();
        let done = stepper.glide(run, command, u32::MAX, next, |passing| {
            *user = play(passing.ram, *user, half);
            let outputs = Outputs {
                user: self.lvdt.sample(lvdt, *user),
                ram: passing.ram,
                current: passing.current,
                pressure: passing.pressure,
            };
            show(sample, passing.ram, &outputs);
            sample += 1;
        });
        done as usize
    }

    /// What the channels show at the present place of a motion. Call it once a sample: the LVDT has a memory.
    #[inline]
    pub fn measure(&self, motion: &mut Motion<T>, input: &Input<T>) -> Outputs<T> {
        let Motion { run, user, lvdt } = motion;
        self.outputs(lvdt, *user + self.model.behind_play(&run.state), &run.mode, &run.state, input)
    }

    #[inline(always)]
    fn outputs(
        &self,
        lvdt: &mut LvdtState<T>,
        user: T,
        mode: &Mode,
        state: &State<T>,
        input: &Input<T>,
    ) -> Outputs<T> {
        let current = if self.model.form.drive == Drive::Force {
            T::ZERO
        } else {
            self.model.controller.current(mode.current, self.model.demand(mode, state, input), T::ONE)
        };
        Outputs {
            user: self.lvdt.sample(lvdt, user),
            ram: state.ground(),
            current,
            pressure: self.model.pressure(mode, state),
        }
    }
}
