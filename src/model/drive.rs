//! The drive of a jack that a force moves: the controller that asks for the force, where it is known, and the lag of
//! the force behind what was asked for.

use super::state::State;
use crate::scalar::Real;

/// A known controller that samples: position and velocity in a cascade,
/// `force = Kf sat(Kv (Kp (command - x) - v), limit)` with `v` over the last two samples, kept until the next sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law<T> {
    /// Velocity asked for per position error `Kp`, 1/s.
    pub position_gain: T,
    /// Output per velocity error `Kv`, V s/m.
    pub velocity_gain: T,
    /// Limit of the output, V.
    pub limit: T,
    /// Force per output `Kf`, N/V.
    pub force_gain: T,
}

/// Samples over which a [`Law`] takes the velocity.
const VELOCITY_SAMPLES: u32 = 2;

impl<T: Real> Law<T> {
    /// The force that it asks for, N, at a position and what it was two samples before, m; `sample_rate` in Hz.
    #[inline]
    pub fn force(&self, command: T, position: T, before: T, sample_rate: T) -> T {
        let velocity = (position - before) * (sample_rate / T::from_count(VELOCITY_SAMPLES));
        let output = self.velocity_gain * (self.position_gain * (command - position) - velocity);
        self.force_gain * output.saturate(self.limit)
    }
}

/// A [`Law`] along a motion: what it remembers of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LawState<T> {
    /// Positions at the last two samples, m, the later one first.
    past: [T; VELOCITY_SAMPLES as usize],
}

impl<T: Real> LawState<T> {
    /// The memory of a ram that has come to a position, m, at a velocity, m/s.
    pub(crate) fn coming(position: T, velocity: T, sample_period: T) -> Self {
        let step = velocity * sample_period;
        Self { past: [position - step, position - step - step] }
    }

    /// What the law asks for at a sample, N.
    pub(crate) fn ask(&mut self, law: &Law<T>, command: T, z: &State<T>, sample_rate: T) -> T {
        let position = z.ground() + z.ram_rest;
        let [last, before] = self.past;
        self.past = [position, last];
        law.force(command, position, before, sample_rate)
    }
}

/// A force that follows its drive with a first-order lag.
///
/// Inside a sample the drive is a straight line, and the force that line, later, plus what is left of the past, which
/// fades. The line of the same impulse and the same first moment takes the place of the fading part: it moves a mass by
/// as much and gives it the same velocity.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lag<T> {
    time: T,
    sample_rate: T,
    /// What is left of the past after a sample.
    left: T,
    /// The line in the place of what fades from 1: its start, and its rise over the sample.
    start: T,
    rise: T,
}

impl<T: Real> Lag<T> {
    /// A lag of a time constant, s, over samples of a period, s; none where it is 0.
    pub(crate) fn new(time: T, sample_period: T) -> Option<Self> {
        (time > T::ZERO).then(|| {
            let ratio = time / sample_period;
            let left = (T::ONE / ratio).exp_negative();
            // In units of the sample: what fades has the impulse `r (1 - e)` and the moment `r^2 (1 - e) - r e`.
            let impulse = ratio * (T::ONE - left);
            let moment = ratio * (impulse - left);
            let rise = T::literal(12.0) * (moment - impulse * T::literal(0.5));
            let start = impulse - rise * T::literal(0.5);
            Self { time, sample_rate: T::ONE / sample_period, left, start, rise }
        })
    }

    /// Start and end of the line of force over a sample in which the drive goes from `first` to `last`, N; `force` is
    /// the force at the start, and becomes that at the end.
    pub(crate) fn follow(&self, force: &mut T, [first, last]: [T; 2]) -> [T; 2] {
        let behind = (last - first) * (self.time * self.sample_rate);
        let fading = *force - (first - behind);
        *force = last - behind + fading * self.left;
        let start = first - behind + fading * self.start;
        [start, start + (last - first) + fading * self.rise]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_law_is_a_limited_cascade() {
        let law = Law { position_gain: 100.0, velocity_gain: 20.0, limit: 10.0, force_gain: 35.0 };
        // 1 mm of error asks for 0.1 m/s; it moves with 0.04 m/s.
        let force = law.force(1e-3, 0.0, -0.08e-3, 1000.0);
        assert!((force - 35.0 * 20.0 * (0.1_f64 - 0.04)).abs() < 1e-9, "{force}");
        assert_eq!(law.force(1.0, 0.0, 0.0, 1000.0), 350.0);
        assert_eq!(law.force(-1.0, 0.0, 0.0, 1000.0), -350.0);
    }

    /// Velocity and position of 1 kg after `samples` of 1 ms under a drive, by small steps of the lag itself.
    fn brute(time: f64, drive: impl Fn(f64) -> f64, samples: usize) -> (f64, f64) {
        let step = 1e-7;
        let (mut force, mut velocity, mut position) = (drive(0.0), 0.0, 0.0);
        for k in 0..samples * 10_000 {
            let middle = drive((k as f64 + 0.5) * step);
            let next = middle + (force - middle) * (-step / time).exp();
            velocity += 0.5 * step * (force + next);
            position += step * velocity;
            force = next;
        }
        (velocity, position)
    }

    #[test]
    fn a_lagging_force_moves_a_mass_as_the_lag_itself_does() {
        for time in [1e-5, 3e-4, 5e-3] {
            for hold in [false, true] {
                let at = |k: usize| [0.0, 5.0, -3.0, 8.0, 8.0][k];
                let line = |k: usize| if hold { [at(k), at(k)] } else { [at(k), at(k + 1)] };
                let drive = |t: f64| {
                    let k = ((t * 1e3) as usize).min(3);
                    let [first, last] = line(k);
                    first + (last - first) * (t * 1e3 - k as f64)
                };
                let (velocity, position) = brute(time, drive, 4);
                let lag = Lag::new(time, 1e-3).unwrap();
                let (mut force, mut v, mut x) = (0.0, 0.0, 0.0);
                for k in 0..4 {
                    let [first, last] = lag.follow(&mut force, line(k));
                    x += 1e-3 * v + 1e-6 * (first / 3.0 + last / 6.0);
                    v += 1e-3 * 0.5 * (first + last);
                }
                assert!((v - velocity).abs() < 1e-7, "{time} {hold}: {v} {velocity}");
                assert!((x - position).abs() < 1e-9, "{time} {hold}: {x} {position}");
            }
        }
        assert!(Lag::new(0.0, 1e-3).is_none());
    }
}
