//! The LVDT: what its offset, gain, cubic term, lag and delay make of the user position, outside the loop.

use super::waypoint::Waypoint;
use crate::parameter::Parameters;
use crate::scalar::Real;

/// Samples that the delay line holds.
pub const DELAY_LINE: usize = 32;

/// Constants of the LVDT at one sample period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lvdt<T> {
    offset: T,
    gain: T,
    cubic: T,
    /// Sample period, s.
    period: T,
    memory: Option<Memory<T>>,
    /// Does it show the position as it is?
    is_true: bool,
}

/// What an LVDT with a lag or a delay looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Memory<T> {
    /// Shares of a sample at which it looks: at the first it sees what it shows some whole samples later, the second is half
    /// a sample off.
    looks: [T; 2],
    /// Those whole samples.
    samples: usize,
    /// What the distance from the last output, the slope and the bend of the input over a sample add to the output: without
    /// a lag, all of them.
    lag: [T; 3],
}

/// What the LVDT remembers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LvdtState<T> {
    /// How far it has watched.
    place: Waypoint<T>,
    /// Positions at the looks of this sample, m, and at those of the last one.
    seen: [T; 2],
    before: [T; 2],
    lagged: T,
    line: [T; DELAY_LINE],
    newest: usize,
}

impl<T: Real> LvdtState<T> {
    /// At rest at a position, m, since long ago; from now on the user is on a way that begins at a place.
    pub const fn at_rest(position: T, place: Waypoint<T>) -> Self {
        Self {
            place,
            seen: [position; 2],
            before: [position; 2],
            lagged: position,
            line: [position; DELAY_LINE],
            newest: 0,
        }
    }
}

impl<T: Real> Lvdt<T> {
    /// What holds an LVDT later: all zeros.
    pub const IDLE: Self = Self {
        offset: T::ZERO,
        gain: T::ZERO,
        cubic: T::ZERO,
        period: T::ZERO,
        memory: None,
        is_true: false,
    };

    /// Longest delay at a sample period, s.
    pub fn longest_delay(sample_period: T) -> T {
        T::from_count(DELAY_LINE as u32 - 1) * sample_period
    }

    /// The LVDT of a set of parameters, sampled with a period in s; a delay is cut at the longest one.
    pub fn new(p: &Parameters<T>, sample_period: T) -> Self {
        let memory =
            (p.sensor_lag > T::ZERO || p.sensor_delay > T::ZERO).then(|| Memory::new(p, sample_period));
        Self {
            offset: p.sensor_offset,
            gain: T::ONE + p.sensor_gain,
            cubic: p.sensor_cubic,
            period: sample_period,
            memory,
            is_true: memory.is_none()
                && [p.sensor_offset, p.sensor_gain, p.sensor_cubic].iter().all(|&effect| effect == T::ZERO),
        }
    }

    /// Does it show the position as it is?
    #[inline(always)]
    pub const fn is_true(&self) -> bool {
        self.is_true
    }

    /// Has it a lag or a delay? Then it must [watch](Self::watch) the way from sample to sample.
    #[inline(always)]
    pub const fn has_memory(&self) -> bool {
        self.memory.is_some()
    }

    /// Sees the user on the way to the next place inside a sample, from where the backlash, of a half width in m, has it
    /// at the last one.
    pub fn watch(&self, state: &mut LvdtState<T>, to: &Waypoint<T>, backlash: [T; 2]) {
        let Some(memory) = &self.memory else { return };
        for (seen, &look) in state.seen.iter_mut().zip(&memory.looks) {
            if let Some(user) = state.place.user_at(to, look, self.period, backlash) {
                *seen = user;
            }
        }
        state.place = *to;
    }

    /// One sample of the LVDT, at a user position, m. One with a memory shows what it has watched.
    #[inline(always)]
    pub fn sample(&self, state: &mut LvdtState<T>, position: T) -> T {
        if self.is_true() {
            return position;
        }
        let seen = self.memory.as_ref().map_or(position, |memory| memory.shown(state));
        self.offset + self.gain * seen * (T::ONE + self.cubic * seen * seen)
    }
}

impl<T: Real> Memory<T> {
    fn new(p: &Parameters<T>, sample_period: T) -> Self {
        let delay = p.sensor_delay.smaller(Lvdt::longest_delay(sample_period)) / sample_period;
        let mut samples: usize = 0;
        while samples + 1 < DELAY_LINE && T::from_count(samples as u32 + 1) <= delay {
            samples += 1;
        }
        let look = T::ONE - (delay - T::from_count(samples as u32));
        let half = T::literal(0.5);
        let mut lag = [T::ONE; 3];
        if p.sensor_lag > T::ZERO {
            // The integral of exp(-(1 - s) r) r times 1, s and s^2 over a sample. For a sample that is much shorter than
            // the lag, the last two are small differences, hence the bound of the lag.
            let ratio = sample_period / p.sensor_lag;
            let constant = T::ONE - ratio.exp_negative();
            let slope = T::ONE - constant / ratio;
            lag = [constant, slope, T::ONE - (slope + slope) / ratio];
        }
        Self { looks: [look, if look > half { look - half } else { look + half }], samples, lag }
    }

    /// The position behind lag and delay.
    #[inline(never)]
    fn shown(&self, state: &mut LvdtState<T>) -> T {
        let ([end, look], [start, last_look]) = (state.seen, state.before);
        // Exact for an input that is a parabola from the look before to this one.
        let middle = if self.looks[1] < self.looks[0] { look } else { last_look };
        let (whole, half) = (end - start, middle - start);
        let bend = (whole - half) - half;
        let (slope, bend) = (whole - (bend + bend), bend + bend);
        let [constant, by_slope, by_bend] = self.lag;
        state.lagged += constant * (start - state.lagged) + by_slope * slope + by_bend * bend;
        state.before = state.seen;
        state.place.share = T::ZERO;
        if self.samples == 0 {
            return state.lagged;
        }
        let oldest = (state.newest + DELAY_LINE - self.samples + 1) % DELAY_LINE;
        let shown = state.line.get(oldest).copied().unwrap_or(state.lagged);
        state.newest = (state.newest + 1) % DELAY_LINE;
        if let Some(slot) = state.line.get_mut(state.newest) {
            *slot = state.lagged;
        }
        shown
    }
}
