//! What is wrong with samples is found here, counted, and never gets further.
//!
//! A sample waits for its successor, so that a spike can be told from a jump. A few lost samples are bridged: the
//! command by a parabola or a line, the measured values left out. Over more the stream is broken and a window starts anew.

use super::pass::VALVE_TIME;
use super::sample::Sample;
use super::slot::Slot;
use super::window::samples_in;

/// Longest time without samples that is bridged, s.
const LONGEST_BRIDGE: f32 = 0.02;
/// Samples in a row with ticks out of order after which the source is taken to count anew.
const NEW_COUNT: u32 = 8;
/// Departure from both neighbours, in standard deviations of the noise, that makes a spike.
const SPIKE: f32 = 10.0;
/// Time of the very same value after which a sensor is stuck, s, counted where the command has moved.
const STUCK: f32 = 0.1;
/// How far the command must have moved meanwhile, m: ten steps of an LVDT of 12 bits. A position behind a backlash stands
/// still for as much more.
const STUCK_COMMAND: f32 = 1e-3;

/// How many samples were excluded, and why.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Exclusions {
    /// Never came: a gap in the ticks, without the samples in it that came with a bad command.
    pub lost: u32,
    /// Came twice, or after a later one.
    pub out_of_order: u32,
    /// Had a command that is no number or out of range.
    pub bad_command: u32,
    /// Had a measured value that is no number.
    pub not_a_number: u32,
    /// Had a measured value that the actuator cannot reach.
    pub out_of_range: u32,
    /// Had a measured value far from both of its neighbours.
    pub spikes: u32,
    /// Had a measured value that stood still while the command moved.
    pub stuck: u32,
}

impl Exclusions {
    /// None.
    pub const NONE: Self = Self {
        lost: 0,
        out_of_order: 0,
        bad_command: 0,
        not_a_number: 0,
        out_of_range: 0,
        spikes: 0,
        stuck: 0,
    };

    /// Counts some more.
    pub(super) fn add(&mut self, count: u32, reason: Reason) {
        let counter = reason(self);
        *counter = counter.saturating_add(count);
    }

    /// All of them.
    pub fn total(&self) -> u32 {
        self.fields().iter().fold(0, |sum: u32, &&count| sum.saturating_add(count))
    }

    /// Each count, in the order of the fields.
    pub const fn fields(&self) -> [&u32; 7] {
        let Self { lost, out_of_order, bad_command, not_a_number, out_of_range, spikes, stuck } = self;
        [lost, out_of_order, bad_command, not_a_number, out_of_range, spikes, stuck]
    }

    pub(super) fn fields_mut(&mut self) -> [&mut u32; 7] {
        let Self { lost, out_of_order, bad_command, not_a_number, out_of_range, spikes, stuck } = self;
        [lost, out_of_order, bad_command, not_a_number, out_of_range, spikes, stuck]
    }
}

/// The counter of a reason.
pub(super) type Reason = fn(&mut Exclusions) -> &mut u32;

/// A sample that may be used.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Screened {
    /// Its tick.
    pub(super) tick: u32,
    /// Commanded position, m.
    pub(super) command: f32,
    /// User position, m.
    pub(super) user: Option<f32>,
    /// Current, mA.
    pub(super) current: Option<f32>,
}

/// Where the screen puts what it lets through.
pub(super) trait Sink {
    /// The next sample.
    fn accept(&mut self, sample: &Screened);
    /// The next sample does not follow the one before.
    fn interrupt(&mut self);
    /// Measured values of the last samples were none.
    fn take_back(&mut self, count: u32, user: bool, current: bool);
    /// Samples, or measured values of them, are excluded for a reason.
    fn exclude(&mut self, count: u32, reason: Reason);
}

/// What a screen needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Limits {
    /// s.
    pub(super) sample_period: f32,
    /// Largest command, m.
    pub(super) command: f32,
    /// Largest reading of a position, m.
    pub(super) position: f32,
    /// Largest current, mA.
    pub(super) current: f32,
    /// Noise of user position and current.
    pub(super) noise: [f32; 2],
    /// Widest backlash, m.
    pub(super) backlash: f32,
    /// Current at its limit, mA: it stands still there.
    pub(super) saturation: f32,
    /// Does the command keep its value from sample to sample?
    pub(super) holds_command: bool,
}

/// How long a sensor has said the same, and where the command was meanwhile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Still {
    pub(super) value: f32,
    pub(super) count: u32,
    pub(super) lowest: f32,
    pub(super) highest: f32,
    /// Samples at which the command had moved.
    pub(super) away: u32,
}

impl Still {
    const NEW: Self = Self { value: 0.0, count: 0, lowest: 0.0, highest: 0.0, away: 0 };

    /// Looks at the next value. The command must have moved by more than `least`, m. `turns`: and must have turned back by
    /// as much, since this sensor stands still where the command moves evenly. `rests`: it is right to stand still. `most`:
    /// so often it may say the same. Returns how many samples turn out to be stuck: all that led to it, then one by one.
    fn look(&mut self, value: f32, command: f32, least: f32, [turns, rests]: [bool; 2], most: u32) -> u32 {
        if rests || value.to_bits() != self.value.to_bits() || self.count == 0 {
            *self = Self { value, count: 1, lowest: command, highest: command, away: 0 };
            return 0;
        }
        self.count = self.count.saturating_add(1);
        if self.away >= most {
            return 1;
        }
        self.lowest = self.lowest.min(command);
        self.highest = self.highest.max(command);
        let turned = self.highest - command > least && command - self.lowest > least;
        let moved = self.highest - self.lowest > least;
        self.away += u32::from(if turns { turned } else { moved });
        if self.away >= most { self.count } else { 0 }
    }
}

/// The screen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Screen {
    /// The newest sample, which waits for its successor.
    pub(super) newest: Slot<Screened>,
    /// User position and current of the one before it.
    pub(super) before: [Option<f32>; 2],
    /// By how much both had moved to there, m and mA: 0 where that is not known.
    pub(super) moved: [f32; 2],
    /// Commands of the two samples before the newest, the later one first, and how many of them there are.
    pub(super) commands: [f32; 2],
    pub(super) known: u32,
    /// Samples in a row with ticks out of order.
    pub(super) disorder: u32,
    /// Samples after the newest that had a bad command: they came, but leave a gap.
    pub(super) unusable: u32,
    /// For user position and current.
    pub(super) still: [Still; 2],
    /// Has a restart come after the newest?
    pub(super) restarted: bool,
}

impl Screen {
    /// Has seen nothing.
    pub(super) const NEW: Self = Self {
        newest: Slot::Empty,
        before: [None; 2],
        moved: [0.0; 2],
        commands: [0.0; 2],
        known: 0,
        disorder: 0,
        unusable: 0,
        still: [Still::NEW; 2],
        restarted: false,
    };

    /// Looks at a sample. Bounded: at most the samples of [`LONGEST_BRIDGE`] go to the sink besides it.
    pub(super) fn look(&mut self, sample: &Sample, limits: &Limits, sink: &mut impl Sink) {
        let (mut interrupted, mut is_counted) = (false, false);
        let mut gap = 0;
        if let Some(newest) = self.newest.get() {
            let step = sample.tick.wrapping_sub(newest.tick);
            if step == 0 || step > u32::MAX / 2 {
                self.disorder = self.disorder.saturating_add(1);
                sink.exclude(1, |counts| &mut counts.out_of_order);
                is_counted = true;
                if self.disorder < NEW_COUNT {
                    return;
                }
                interrupted = true;
            } else {
                gap = step - 1;
                // While it was off, nobody knows what the command did.
                let is_missed = self.restarted && gap > self.unusable;
                interrupted = gap > samples_in(LONGEST_BRIDGE, limits.sample_period) || is_missed;
            }
        }
        let is_in_range = sample.command.abs() <= limits.command;
        if !is_in_range {
            if !is_counted {
                self.unusable = self.unusable.saturating_add(1);
                sink.exclude(1, |counts| &mut counts.bad_command);
            }
            return;
        }
        self.disorder = 0;
        self.restarted = false;
        sink.exclude(gap.saturating_sub(core::mem::take(&mut self.unusable)), |counts| &mut counts.lost);
        let checked = self.checked(sample, limits, sink);
        if interrupted {
            *self = Self { newest: Slot::Full(checked), ..Self::NEW };
            sink.interrupt();
            return;
        }
        self.hand_on(&checked, gap, limits, sink);
        self.newest = Slot::Full(checked);
    }

    /// The sample without the values that are none by themselves.
    fn checked(&mut self, sample: &Sample, limits: &Limits, sink: &mut impl Sink) -> Screened {
        let mut values = [Some(sample.user), Some(sample.current)];
        let largest = [limits.position, limits.current];
        let least = [STUCK_COMMAND + limits.backlash, STUCK_COMMAND];
        let mut back = [0; 2];
        for channel in 0..2 {
            let Some(value) = values[channel] else { continue };
            if !limits.noise[channel].is_finite() {
                values[channel] = None;
            } else if value.is_nan() {
                values[channel] = None;
                sink.exclude(1, |counts| &mut counts.not_a_number);
            } else if value.abs() > largest[channel] {
                values[channel] = None;
                sink.exclude(1, |counts| &mut counts.out_of_range);
            } else {
                let is_current = channel == 1;
                let rests = is_current && value.abs() >= limits.saturation - limits.noise[channel];
                let most = samples_in(STUCK, limits.sample_period);
                let still = &mut self.still[channel];
                let stuck = still.look(value, sample.command, least[channel], [is_current, rests], most);
                if stuck > 0 {
                    values[channel] = None;
                    back[channel] = stuck - 1;
                    sink.exclude(stuck, |counts| &mut counts.stuck);
                }
            }
        }
        for channel in 0..2 {
            if back[channel] > 0 {
                // The newest of them still waits here.
                sink.take_back(back[channel] - 1, channel == 0, channel == 1);
                self.before[channel] = None;
                if let Some(newest) = self.newest.get_mut() {
                    if channel == 0 { newest.user = None } else { newest.current = None }
                }
            }
        }
        Screened { tick: sample.tick, command: sample.command, user: values[0], current: values[1] }
    }

    /// Hands the waiting sample on, and a bridge to its successor over a gap.
    fn hand_on(&mut self, next: &Screened, gap: u32, limits: &Limits, sink: &mut impl Sink) {
        let Some(mut newest) = self.newest.get().copied() else { return };
        if gap == 0 {
            let neighbours = [(self.before[0], next.user), (self.before[1], next.current)];
            let values = [&mut newest.user, &mut newest.current];
            // What moves turns back in no less than the time of a valve: of its last step, a part of that.
            let turn = (limits.sample_period / VALVE_TIME).min(1.0);
            let least = [0, 1].map(|channel| SPIKE * limits.noise[channel] + turn * self.moved[channel]);
            for ((value, (before, after)), least) in values.into_iter().zip(neighbours).zip(least) {
                if let (Some(here), Some(before), Some(after)) = (*value, before, after)
                    && is_spike(here, before, after, least)
                {
                    *value = None;
                    sink.exclude(1, |counts| &mut counts.spikes);
                }
            }
        }
        sink.accept(&newest);
        let now = [newest.user, newest.current];
        self.moved = [0, 1].map(|channel| match (now[channel], self.before[channel]) {
            (Some(now), Some(before)) => (now - before).abs(),
            _ => 0.0,
        });
        self.before = now;
        let bridge = Bridge::over(
            newest.command,
            self.commands,
            self.known,
            next.command,
            gap + 1,
            limits.holds_command,
        );
        for lost in 1..=gap {
            let command = bridge.at(lost).max(-limits.command).min(limits.command);
            sink.accept(&Screened {
                tick: newest.tick.wrapping_add(lost),
                command,
                user: None,
                current: None,
            });
            self.before = [None; 2];
        }
        (self.commands, self.known) = if gap == 0 {
            ([newest.command, self.commands[0]], (self.known + 1).min(2))
        } else {
            ([0.0; 2], 0)
        };
    }
}

/// The command over a gap: a parabola from the slope before it to the value behind it, where the command turns that way
/// already. A line would be off by tens of micrometres there, and the model with it; a parabola from a jump, by millimetres.
struct Bridge {
    start: f32,
    slope: f32,
    bend: f32,
}

impl Bridge {
    /// From the last command before a gap, and the two before that as far as they are known, to the one behind it. A command
    /// that is `held` and stood still before the gap is taken to jump at its end, any other to go straight where it is not
    /// known how it turns.
    fn over(start: f32, before: [f32; 2], known: u32, end: f32, samples: u32, held: bool) -> Self {
        let length = samples as f32;
        let even = if held && known > 0 && start == before[0] { 0.0 } else { (end - start) / length };
        let turn = start - 2.0 * before[0] + before[1];
        let slope = start - before[0] + 0.5 * turn;
        // A parabola has a second difference of twice its bend.
        let bend = (end - start - slope * length) / (length * length);
        let turns = known > 1 && (2.0 * bend - turn).abs() <= turn.abs();
        if turns { Self { start, slope, bend } } else { Self { start, slope: even, bend: 0.0 } }
    }

    fn at(&self, sample: u32) -> f32 {
        let time = sample as f32;
        self.start + time * (self.slope + time * self.bend)
    }
}

/// Does a value lie outside two neighbours by more than the least, and farther than they lie apart?
fn is_spike(here: f32, before: f32, after: f32, least: f32) -> bool {
    let nearest = (here - before).abs().min((here - after).abs());
    (here > before) == (here > after) && nearest > least && (before - after).abs() < nearest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest error of a bridge, m, over samples that a command has lost from one on.
    fn error(command: impl Fn(u32) -> f32, first: u32, lost: u32, held: bool) -> f32 {
        let before = [command(first - 2), command(first - 3)];
        let bridge = Bridge::over(command(first - 1), before, 2, command(first + lost), lost + 1, held);
        let errors = (0..=lost).map(|sample| (bridge.at(sample) - command(first - 1 + sample)).abs());
        errors.fold(0.0, f32::max)
    }

    #[test]
    fn a_command_that_turns_is_bridged_by_its_curve_and_one_that_has_jumped_by_a_line() {
        // 4 Hz and 1 mm: the line between the ends of 20 lost samples is 35 um off where the command turns most.
        let sine = |sample: u32| 1e-3 * libm::sinf(core::f32::consts::TAU * 4e-3 * sample as f32);
        for held in [false, true] {
            assert!((100..350).all(|first| error(sine, first, 20, held) < 1.6e-5));
        }
        for lost in 1..=20 {
            for jump in [1e-3, -1e-2] {
                for place in 0..4 {
                    // It rests, or goes evenly, at most three samples behind a jump.
                    let rest = |sample: u32| if sample >= 100 { jump } else { 0.0 };
                    let even = |sample: u32| rest(sample) + 2e-6 * sample as f32;
                    for held in [false, true] {
                        assert!(error(rest, 101 + place, lost, held) == 0.0);
                        assert!(error(even, 101 + place, lost, held) < 1e-7);
                    }
                }
            }
        }
    }

    #[test]
    fn a_command_that_is_held_over_samples_jumps_behind_a_gap() {
        // Over a bus that brings one every 20 samples.
        let held = |sample: u32| 1e-3 * (sample / 20) as f32;
        assert!((4..=20).all(|first| error(held, first, 20 - first, true) == 0.0));
        assert!(error(held, 10, 10, false) > 4e-4, "what a line makes of it");
    }
}
