//! A model, its integrator and its sensors as one thing that answers: what would the channels show next?

use crate::integrate::{Run, Stepper, advance, advance_over_jump};
use crate::model::Drive;
use crate::model::Model;
use crate::model::corridor::Passing;
use crate::model::play::play;
use crate::model::sensor::{Lvdt, LvdtState};
use crate::model::state::{Input, InputSegment, Outputs, State};
use crate::model::waypoint::Waypoint;
use crate::scalar::Real;

/// What is the same for a whole simulation: model and sensors.
#[derive(Clone, Copy, Debug)]
pub struct Actuator<T> {
    /// The model.
    pub model: Model<T>,
    user_side: UserSide<T>,
}

/// What changes from sample to sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion<T> {
    /// The loop's place in its motion.
    pub run: Run<T>,
    user: User<T>,
}

/// What is behind a ram: backlash and LVDT.
#[derive(Clone, Copy, Debug, PartialEq)]
struct UserSide<T> {
    half_backlash: T,
    lvdt: Lvdt<T>,
}

/// The user, and what its LVDT remembers.
#[derive(Clone, Copy, Debug, PartialEq)]
struct User<T> {
    /// Position behind the backlash, m.
    position: T,
    /// What is added there, m.
    behind: T,
    seen: LvdtState<T>,
}

/// Backlash and LVDT of another candidate behind the same ram: where candidates differ in their output only, one motion
/// serves them all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Follower<T> {
    side: UserSide<T>,
    user: User<T>,
}

impl<T: Real> UserSide<T> {
    fn new(model: &Model<T>, sample_period: T) -> Self {
        Self { half_backlash: model.half_backlash(), lvdt: Lvdt::new(model.parameters(), sample_period) }
    }

    /// Follows the ram to the next place inside a sample: to a state of its model, at a share of the sample.
    #[inline(always)]
    fn follow(&self, user: &mut User<T>, model: &Model<T>, share: T, state: &State<T>) {
        if self.lvdt.has_memory() {
            self.watch(user, Waypoint::of(model, state, share));
        }
        user.position = play(model.play_input(state), user.position, self.half_backlash);
        user.behind = model.behind_play(state);
    }

    /// Follows the ram over a whole sample in which nothing happens.
    #[inline(always)]
    fn pass(&self, user: &mut User<T>, passing: &Passing<T>) {
        if self.lvdt.has_memory() {
            self.watch(user, passing.waypoint());
        }
        user.position = play(passing.ram, user.position, self.half_backlash);
    }

    #[cold]
    #[inline(never)]
    fn watch(&self, user: &mut User<T>, to: Waypoint<T>) {
        self.lvdt.watch(&mut user.seen, &to, [user.position, self.half_backlash]);
    }

    /// What the LVDT shows. Call it once a sample.
    #[inline(always)]
    fn shown(&self, user: &mut User<T>) -> T {
        self.lvdt.sample(&mut user.seen, user.position + user.behind)
    }
}

impl<T: Real> User<T> {
    const IDLE: Self =
        Self { position: T::ZERO, behind: T::ZERO, seen: LvdtState::at_rest(T::ZERO, Waypoint::NONE) };

    /// Behind a state of a model, at a position, m, with the sensor at rest there.
    fn starting(model: &Model<T>, state: &State<T>, position: T) -> Self {
        let place = Waypoint::of(model, state, T::ZERO);
        let behind = place.behind[0];
        Self { position, behind, seen: LvdtState::at_rest(position + behind, place) }
    }
}

impl<T: Real> Follower<T> {
    /// What holds a follower later: all zeros.
    pub const IDLE: Self =
        Self { side: UserSide { half_backlash: T::ZERO, lvdt: Lvdt::IDLE }, user: User::IDLE };

    /// The output of a model, sampled with a period in s, at rest at zero.
    pub fn of(model: &Model<T>, sample_period: T) -> Self {
        Self { side: UserSide::new(model, sample_period), user: User::IDLE }
    }

    /// Starts behind a state of a model, with the user at a position, m, and its sensor at rest there.
    pub fn start(&mut self, model: &Model<T>, state: &State<T>, position: T) {
        self.user = User::starting(model, state, position);
    }

    /// User position behind the backlash, m.
    pub const fn position(&self) -> T {
        self.user.position
    }

    /// Follows the ram to the next place inside a sample: to a state of its model, at a share of the sample.
    #[inline(always)]
    pub fn follow(&mut self, model: &Model<T>, share: T, state: &State<T>) {
        self.side.follow(&mut self.user, model, share, state);
    }

    /// Follows the ram over a whole sample in which nothing happens.
    #[inline(always)]
    pub fn pass(&mut self, passing: &Passing<T>) {
        self.side.pass(&mut self.user, passing);
    }

    /// What its LVDT shows. Call it once a sample.
    #[inline(always)]
    pub fn shown(&mut self) -> T {
        self.side.shown(&mut self.user)
    }
}

impl<T: Real> Actuator<T> {
    /// An actuator whose channels are sampled with a period in s.
    pub fn new(model: Model<T>, sample_period: T) -> Self {
        Self { model, user_side: UserSide::new(&model, sample_period) }
    }

    /// The motion that starts at rest at a ram position, the user centred behind the backlash.
    pub fn at_rest(&self, ram: T, input: &Input<T>) -> Motion<T> {
        self.resuming(Run::at_rest(&self.model, ram, input), ram)
    }

    /// A motion that goes on from a run, with the user at a position behind the backlash, m.
    pub fn resuming(&self, run: Run<T>, position: T) -> Motion<T> {
        Motion { run, user: User::starting(&self.model, &run.state, position) }
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
        let Motion { run, user } = motion;
        advance(stepper, &self.model, run, segment, |share, state| {
            self.reach(share, state, user, followers);
        });
    }

    /// The ram has come to a state, at a share of the sample.
    #[inline(always)]
    fn reach(&self, share: T, state: &State<T>, user: &mut User<T>, followers: &mut [Option<Follower<T>>]) {
        self.user_side.follow(user, &self.model, share, state);
        for follower in followers.iter_mut().flatten() {
            follower.follow(&self.model, share, state);
        }
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
        let Motion { run, user } = motion;
        advance_over_jump(stepper, &self.model, run, lines, part, |share, state| {
            self.reach(share, state, user, followers);
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
    /// the number of each, how it was passed, and what the channels show; returns how many it were.
    #[inline(always)]
    pub fn glide<S: Stepper<T>>(
        &self,
        stepper: &mut S,
        motion: &mut Motion<T>,
        command: T,
        commands: &[T],
        mut show: impl FnMut(usize, &Passing<T>, &Outputs<T>),
    ) -> usize {
        let Motion { run, user } = motion;
        let mut sample = 0;
        stepper.enter(&self.model, run);
        // Of a sensor that shows what is, copies: so that they live in registers.
        let UserSide { half_backlash, lvdt } = self.user_side;
        let (is_true, mut position) = (lvdt.is_true(), user.position);
        let next = |done: u32| commands.get(done as usize).copied();
        let done = stepper.glide(run, command, u32::MAX, next, |passing| {
            let shown = if is_true {
                position = play(passing.ram, position, half_backlash);
                position
            } else {
                self.user_side.pass(user, passing);
                self.user_side.shown(user)
            };
            let outputs = Outputs {
                user: shown,
                ram: passing.ram,
                current: passing.current,
                pressure: passing.pressure,
            };
            show(sample, passing, &outputs);
            sample += 1;
        });
        if is_true {
            user.position = position;
        }
        done as usize
    }

    /// What the channels show at the present place of a motion. Call it once a sample: the LVDT has a memory.
    #[inline]
    pub fn measure(&self, motion: &mut Motion<T>, input: &Input<T>) -> Outputs<T> {
        let (mode, state) = (&motion.run.mode, &motion.run.state);
        let current = if self.model.form.drive == Drive::Force {
            T::ZERO
        } else {
            self.model.controller.current(mode.current, self.model.demand(mode, state, input), T::ONE)
        };
        Outputs {
            user: self.user_side.shown(&mut motion.user),
            ram: state.ground(),
            current,
            pressure: self.model.pressure(mode, state),
        }
    }
}
