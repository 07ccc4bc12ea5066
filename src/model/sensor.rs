//! The LVDT: what its offset, gain, cubic term, lag and delay make of the user position, outside the loop.

use crate::parameter::Parameters;
use crate::scalar::Real;

/// Samples that the delay line holds.
pub const DELAY_LINE: usize = 34;

/// Constants of the LVDT at one sample period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lvdt<T> {
    offset: T,
    gain: T,
    cubic: T,
    /// Lag: weights of the last output, the last input, the input, and the second difference of the input.
    lag: Option<[T; 4]>,
    /// Delay in sample periods.
    delay: T,
    /// Does it remember anything: has it a lag or a delay?
    has_memory: bool,
    /// Does it show the position as it is?
    is_true: bool,
}

/// What the LVDT remembers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LvdtState<T> {
    lagged: T,
    last: T,
    before: T,
    line: [T; DELAY_LINE],
    newest: usize,
}

impl<T: Real> LvdtState<T> {
    /// At rest at a position since long ago.
    pub const fn at_rest(position: T) -> Self {
        Self { lagged: position, last: position, before: position, line: [position; DELAY_LINE], newest: 0 }
    }
}

impl<T: Real> Lvdt<T> {
    /// What holds an LVDT later: all zeros.
    pub const IDLE: Self = Self {
        offset: T::ZERO,
        gain: T::ZERO,
        cubic: T::ZERO,
        lag: None,
        delay: T::ZERO,
        has_memory: false,
        is_true: false,
    };

    /// Longest delay at a sample period, s: the cubic takes two samples before the wanted one and one after it.
    pub fn longest_delay(sample_period: T) -> T {
        T::from_count(DELAY_LINE as u32 - 3) * sample_period
    }

    /// The LVDT of a set of parameters, sampled with a period in s; a delay is cut at the longest one.
    pub fn new(p: &Parameters<T>, sample_period: T) -> Self {
        let lag = (p.sensor_lag > T::ZERO).then(|| {
            // Exact for an input that is linear over the sample: y1 = a y0 + (b - a) u0 + (1 - b) u1,
            // a = exp(-h/tau), b = (1 - a) tau/h; for h << tau both differences are small, hence the bound.
            // The last weight makes it exact for a parabola through the last three samples.
            let ratio = sample_period / p.sensor_lag;
            let a = ratio.exp_negative();
            let b = (T::ONE - a) / ratio;
            let curvature = T::literal(0.5) * b - (T::ONE - b) / ratio;
            [a, b - a, T::ONE - b, curvature]
        });
        let has_memory = lag.is_some() || p.sensor_delay > T::ZERO;
        Self {
            offset: p.sensor_offset,
            gain: T::ONE + p.sensor_gain,
            cubic: p.sensor_cubic,
            lag,
            delay: p.sensor_delay.smaller(Self::longest_delay(sample_period)) / sample_period,
            has_memory,
            is_true: !has_memory
                && [p.sensor_offset, p.sensor_gain, p.sensor_cubic].iter().all(|&effect| effect == T::ZERO),
        }
    }

    /// One sample of the LVDT.
    #[inline(always)]
    pub fn sample(&self, state: &mut LvdtState<T>, position: T) -> T {
        if self.is_true {
            return position;
        }
        let seen = if self.has_memory { self.remembered(state, position) } else { position };
        self.offset + self.gain * seen * (T::ONE + self.cubic * seen * seen)
    }

    /// The position behind lag and delay.
    #[inline(never)]
    fn remembered(&self, state: &mut LvdtState<T>, position: T) -> T {
        let mut seen = position;
        if let Some([a, b, c, d]) = self.lag {
            let bend = (seen - state.last) - (state.last - state.before);
            state.lagged = a * state.lagged + b * state.last + c * seen + d * bend;
            state.before = state.last;
            state.last = seen;
            seen = state.lagged;
        }
        if self.delay > T::ZERO {
            seen = self.delayed(state, seen);
        }
        seen
    }

    /// The delayed value by a cubic through the four samples around it.
    fn delayed(&self, state: &mut LvdtState<T>, value: T) -> T {
        state.newest = (state.newest + 1) % DELAY_LINE;
        if let Some(slot) = state.line.get_mut(state.newest) {
            *slot = value;
        }
        let past = |age: usize| {
            let at = (state.newest + DELAY_LINE - age) % DELAY_LINE;
            state.line.get(at).copied().unwrap_or(value)
        };
        let whole = self.delay.whole();
        let mut age: usize = 0;
        while age < DELAY_LINE - 3 && T::from_count(age as u32 + 1) <= whole {
            age += 1;
        }
        let f = self.delay - T::from_count(age as u32);
        let half = T::literal(0.5);
        if age == 0 {
            // No sample after the newest: a parabola through the three latest.
            let (p0, p1, p2) = (past(0), past(1), past(2));
            return p0 + f * (p1 - p0) + half * f * (f - T::ONE) * (p2 - p1 - p1 + p0);
        }
        // Lagrange's cubic through ages -1, 0, 1, 2 around the wanted one.
        let (a, b, c, d) = (past(age - 1), past(age), past(age + 1), past(age + 2));
        let third = T::literal(1.0 / 3.0);
        let (g, h, k) = (f + T::ONE, f - T::ONE, f - T::literal(2.0));
        -f * h * k * third * half * a + g * h * k * half * b - g * f * k * half * c
            + g * f * h * third * half * d
    }
}
