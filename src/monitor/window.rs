//! A window of samples, eight bytes each.
//!
//! Position and command take 24 bits, the current 16: with the ranges of the actuator that is 0.03 um and 0.4 uA for
//! the source's, far below the noise. Whatever a sensor says, what comes out of a window is a number in range.

use super::screen::{Exclusions, Screened};
use crate::scalar::Real;

/// Counts on either side of zero of a position.
const POSITION_COUNTS: i32 = (1 << 23) - 1;
/// Counts on either side of zero of a current.
const CURRENT_COUNTS: i32 = (1 << 15) - 1;

/// Samples in a time, s.
pub(super) fn samples_in(time: f32, sample_period: f32) -> u32 {
    (time / sample_period + 0.5) as u32
}

/// What one count is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    /// m.
    position: f32,
    /// mA.
    current: f32,
}

impl Scale {
    /// For positions up to a largest one, m, and a quarter more than the limit of the current, mA.
    pub(super) fn of(position: f32, current_limit: f32) -> Self {
        Self {
            position: position / POSITION_COUNTS as f32,
            current: current_limit * 1.25 / CURRENT_COUNTS as f32,
        }
    }

    /// Largest position, m.
    pub(super) fn reach(self) -> f32 {
        self.position * POSITION_COUNTS as f32
    }

    /// Largest current, mA.
    pub(super) fn largest_current(self) -> f32 {
        self.current * CURRENT_COUNTS as f32
    }
}

/// The nearest count of a value; none where it is not in range.
fn count(value: f32, unit: f32, counts: i32) -> Option<i32> {
    let scaled = value / unit;
    let inside = scaled >= -(counts as f32) && scaled <= counts as f32;
    inside.then(|| (scaled + 0.5).whole() as i32)
}

/// A sample of a window; a value that is missing has the one count that no value has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Packed([u32; 2]);

impl Packed {
    pub(super) const NONE: Self = Self([0; 2]);

    fn new(sample: &Screened, scale: Scale) -> Self {
        let position = |value: Option<f32>| {
            let counts = value.and_then(|value| count(value, scale.position, POSITION_COUNTS));
            counts.unwrap_or(-POSITION_COUNTS - 1) as u32 & 0x00ff_ffff
        };
        let current = sample.current.and_then(|value| count(value, scale.current, CURRENT_COUNTS));
        let current = current.unwrap_or(-CURRENT_COUNTS - 1) as u32 & 0xffff;
        let (command, user) = (position(Some(sample.command)), position(sample.user));
        Self([command | current << 24, user | current >> 8 << 24])
    }

    const fn position(word: u32) -> i32 {
        (word << 8).cast_signed() >> 8
    }

    /// Command, m.
    pub(super) fn command(self, scale: Scale) -> f32 {
        Self::position(self.0[0]) as f32 * scale.position
    }

    /// User position, m.
    pub(super) fn user(self, scale: Scale) -> Option<f32> {
        let count = Self::position(self.0[1]);
        (count >= -POSITION_COUNTS).then_some(count as f32 * scale.position)
    }

    /// Current, mA.
    pub(super) fn current(self, scale: Scale) -> Option<f32> {
        let word = self.0[0] >> 24 | self.0[1] >> 24 << 8;
        let count = i32::from((word as u16).cast_signed());
        (count >= -CURRENT_COUNTS).then_some(count as f32 * scale.current)
    }

    /// The packed sample without the measured values that a flag names.
    fn without(self, user: bool, current: bool) -> Self {
        let [mut first, mut second] = self.0;
        if user {
            second = second & 0xff00_0000 | 0x0080_0000;
        }
        if current {
            first &= 0x00ff_ffff;
            second = second & 0x00ff_ffff | 0x8000_0000;
        }
        Self([first, second])
    }

    pub(super) fn words(&mut self) -> &mut [u32; 2] {
        &mut self.0
    }
}

/// A window.
#[derive(Clone, Debug)]
pub(super) struct Window<const SAMPLES: usize> {
    samples: [Packed; SAMPLES],
    /// Samples in it.
    pub(super) filled: u32,
    /// Tick of its first sample.
    pub(super) first_tick: u32,
    /// Does it begin where the window before it ended?
    pub(super) follows: bool,
    /// What was excluded from it.
    pub(super) exclusions: Exclusions,
}

impl<const SAMPLES: usize> Window<SAMPLES> {
    pub(super) const EMPTY: Self = Self {
        samples: [Packed::NONE; SAMPLES],
        filled: 0,
        first_tick: 0,
        follows: false,
        exclusions: Exclusions::NONE,
    };

    /// Forgets every sample. `follows`: the next sample is the one after the last of another window.
    pub(super) fn clear(&mut self, follows: bool) {
        self.filled = 0;
        self.follows = follows;
        self.exclusions = Exclusions::NONE;
    }

    /// Takes a sample; true if the window is full with it.
    pub(super) fn take(&mut self, sample: &Screened, scale: Scale) -> bool {
        if self.filled == 0 {
            self.first_tick = sample.tick;
        }
        if let Some(place) = self.samples.get_mut(self.filled as usize) {
            *place = Packed::new(sample, scale);
            self.filled += 1;
        }
        self.filled as usize >= SAMPLES
    }

    /// Takes measured values back from the last `count` samples.
    pub(super) fn take_back(&mut self, count: usize, user: bool, current: bool) {
        let end = (self.filled as usize).min(SAMPLES);
        for place in self.samples.iter_mut().take(end).skip(end.saturating_sub(count)) {
            *place = place.without(user, current);
        }
    }

    /// A sample.
    pub(super) fn get(&self, sample: usize) -> Packed {
        self.samples.get(sample).copied().unwrap_or(Packed::NONE)
    }

    /// The first sample from one on that has a user position, and that, m.
    #[inline(never)]
    pub(super) fn user_from(&self, sample: usize, scale: Scale) -> Option<(usize, f32)> {
        let mut later = self.samples.iter().enumerate().skip(sample);
        later.find_map(|(at, packed)| Some((at, packed.user(scale)?)))
    }

    /// Samples from one on that have a user position, and that have a current.
    pub(super) fn present(&self, from: usize, scale: Scale) -> [u32; 2] {
        let mut present = [0; 2];
        for sample in self.samples.iter().skip(from) {
            present[0] += u32::from(sample.user(scale).is_some());
            present[1] += u32::from(sample.current(scale).is_some());
        }
        present
    }

    pub(super) fn samples_mut(&mut self) -> &mut [Packed; SAMPLES] {
        &mut self.samples
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_comes_out_within_half_a_count() {
        let scale = Scale::of(0.25, 10.0);
        for (command, user, current) in
            [(0.0, 0.0, 0.0), (0.2, -0.2, 10.0), (-0.2, 0.2, -10.0), (1e-7, -1e-7, 1e-3)]
        {
            let sample = Screened { tick: 0, command, user: Some(user), current: Some(current) };
            let packed = Packed::new(&sample, scale);
            assert!((packed.command(scale) - command).abs() < 2.5e-8);
            assert!((packed.user(scale).unwrap() - user).abs() < 2.5e-8);
            assert!((packed.current(scale).unwrap() - current).abs() < 3e-4);
            let without = packed.without(true, false);
            assert_eq!((without.user(scale), without.current(scale)), (None, packed.current(scale)));
            assert_eq!(without.command(scale), packed.command(scale));
            let without = packed.without(false, true);
            assert_eq!((without.user(scale), without.current(scale)), (packed.user(scale), None));
            assert_eq!(without.command(scale), packed.command(scale));
        }
    }

    #[test]
    fn what_is_no_value_in_range_is_missing() {
        let scale = Scale::of(0.25, 10.0);
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30] {
            let sample = Screened { tick: 0, command: 0.0, user: Some(value), current: Some(value) };
            let packed = Packed::new(&sample, scale);
            assert_eq!((packed.user(scale), packed.current(scale)), (None, None), "{value}");
        }
    }
}
