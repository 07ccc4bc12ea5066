//! A motion between its samples, as what lies behind the ram sees it.

use super::Model;
use super::play::play;
use super::state::State;
use crate::scalar::Real;

/// Where a motion is inside a sample. Between two of these that follow one another it is smooth, and does not turn back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Waypoint<T> {
    /// Share of the sample that has passed, from 0 to 1.
    pub share: T,
    /// What pushes the backlash: its position, m, and its velocity, m/s.
    pub pushing: [T; 2],
    /// What is added behind the backlash, m, and its velocity, m/s.
    pub behind: [T; 2],
}

impl<T: Real> Waypoint<T> {
    /// None: what holds one later.
    pub const NONE: Self = Self { share: T::ZERO, pushing: [T::ZERO; 2], behind: [T::ZERO; 2] };

    /// That of a state.
    #[inline(always)]
    pub fn of(model: &Model<T>, z: &State<T>, share: T) -> Self {
        Self {
            share,
            pushing: [model.play_input(z), model.play_input_velocity(z)],
            behind: [model.behind_play(z), model.behind_play_velocity(z)],
        }
    }

    /// User position at a share of the sample on the way from here to a later one, m, and whether that share is passed on
    /// this way. `user` is where the backlash, of a half width in m, has the user at its start, the period in s.
    #[inline]
    pub fn user_at(&self, to: &Self, share: T, period: T, [user, half]: [T; 2]) -> Option<T> {
        if !(self.share < share && share <= to.share) {
            return None;
        }
        let length = to.share - self.share;
        let (time, part) = (length * period, (share - self.share) / length);
        let pushing = between(self.pushing, to.pushing, time, part);
        Some(play(pushing, user, half) + between(self.behind, to.behind, time, part))
    }
}

/// A part of the way along the cubic through two places with the velocities there, some time apart, s.
#[inline(always)]
fn between<T: Real>(from: [T; 2], to: [T; 2], time: T, part: T) -> T {
    let change = to[0] - from[0];
    let (start, end) = (from[1] * time - change, to[1] * time - change);
    // The chord, and what the velocities bend it by.
    let rest = T::ONE - part;
    from[0] + part * (change + rest * (rest * start - part * end))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cubic_is_met_in_between() {
        let cubic = |t: f64| 1.0 + t * (2.0 + t * (-3.0 + 4.0 * t));
        let slope = |t: f64| 2.0 + t * (-6.0 + 12.0 * t);
        let place = |t: f64| [cubic(t), slope(t)];
        for part in [0.0, 0.2, 0.5, 0.9, 1.0] {
            let seen = between(place(0.3), place(0.7), 0.4, part);
            assert!((seen - cubic(0.3 + 0.4 * part)).abs() < 1e-15, "{part}");
        }
    }

    #[test]
    fn a_share_is_on_one_way_only_and_the_backlash_holds_there() {
        let at = |share: f64, position: f64| Waypoint { share, pushing: [position, 1.0], behind: [0.1, 0.0] };
        let (first, second, third) = (at(0.0, 0.0), at(0.25, 0.25), at(1.0, 1.0));
        let user = |from: &Waypoint<f64>, to, share| from.user_at(to, share, 1.0, [0.0, 0.2]);
        assert_eq!(user(&first, &second, 0.25).is_some(), user(&second, &third, 0.25).is_none());
        // Within the gap the user rests; beyond it, it is pushed.
        assert_eq!(user(&first, &second, 0.125), Some(0.1));
        assert!(user(&second, &third, 1.0).is_some_and(|user| (user - 0.9).abs() < 1e-15));
    }
}
