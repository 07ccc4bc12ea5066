//! The guards of a mode at a place: whether a step may have met an event, and where.

use crate::model::state::{Input, Mode, State};
use crate::model::{EXTRA_GUARDS, LOOP_GUARDS, Model};
use crate::scalar::Real;

/// The values of all guards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Guards<T> {
    plain: [T; LOOP_GUARDS],
    extra: [T; EXTRA_GUARDS],
}

impl<T: Real> Guards<T> {
    pub(super) const NONE: Self = Self { plain: [T::ZERO; LOOP_GUARDS], extra: [T::ZERO; EXTRA_GUARDS] };

    #[inline(never)]
    pub(super) fn at(model: &Model<T>, mode: &Mode, state: &State<T>, input: &Input<T>, time: T) -> Self {
        let extra = if model.has_extra_guards() {
            model.extra_guards(mode, state, input, time)
        } else {
            [T::ONE; EXTRA_GUARDS]
        };
        Self { plain: model.loop_guards(mode, state, input), extra }
    }

    /// Are all guards clear of a violation and of a dip below zero over a step, at a glance? The usual case.
    ///
    /// `fall` is that of the step before. Where this says no, [`must_refine`](Self::must_refine) looks closer.
    #[inline(always)]
    pub(super) fn all_clear(&self, fall: &Self, after: &Self, size: T, has_extra: bool) -> bool {
        let is_clear = |before: &[T], after: &[T], fall: &[T]| {
            before.iter().zip(after).zip(fall).all(|((&before, &after), &fall)| {
                let dip = (fall * size).magnitude();
                before >= dip && after >= dip
            })
        };
        is_clear(&self.plain, &after.plain, &fall.plain)
            && (!has_extra || is_clear(&self.extra, &after.extra, &fall.extra))
    }

    /// Is a guard violated after a step, or may it have been inside a step that can be divided?
    ///
    /// A parabola through three equally spaced points dips by an eighth of its fall over the first two; twice that is
    /// looked out for.
    #[cold]
    pub(super) fn must_refine(&self, fall: &Self, after: &Self, size: T, divisible: bool) -> bool {
        let before = self.plain.iter().chain(&self.extra);
        let after = after.plain.iter().chain(&after.extra);
        let fall = fall.plain.iter().chain(&fall.extra);
        before.zip(after).zip(fall).enumerate().any(|(index, ((&before, &after), &fall))| {
            Model::<T>::is_violated(index, before, after)
                || (divisible && before.smaller(after) + Model::<T>::slack(index) < fall * size)
        })
    }

    /// Takes over the guards after a step of `size` finest steps, and in `fall` a quarter of what they fell by for
    /// each finest step.
    #[inline(always)]
    pub(super) fn accept(&mut self, fall: &mut Self, after: &Self, size: T, has_extra: bool) {
        let weight = T::literal(0.25) / size;
        for index in 0..LOOP_GUARDS {
            fall.plain[index] = (self.plain[index] - after.plain[index]) * weight;
        }
        self.plain = after.plain;
        if has_extra {
            for index in 0..EXTRA_GUARDS {
                fall.extra[index] = (self.extra[index] - after.extra[index]) * weight;
            }
            self.extra = after.extra;
        }
    }

    pub(super) fn get(&self, index: usize) -> T {
        self.plain.iter().chain(&self.extra).nth(index).copied().unwrap_or(T::ONE)
    }

    /// A better fraction for the crossing of guard `index`, from its values at both ends and at a first guess.
    pub(super) fn secant(&self, at_guess: &Self, after: &Self, index: usize, guess: T) -> T {
        let value = at_guess.get(index);
        let (end, there) =
            if value < T::ZERO { (T::ZERO, self.get(index)) } else { (T::ONE, after.get(index)) };
        let slope = there - value;
        if guess <= T::ZERO || guess >= T::ONE || slope == T::ZERO || (value < T::ZERO) == (there < T::ZERO) {
            return guess;
        }
        guess - value * (end - guess) / slope
    }

    /// The guard that is crossed first, and the fraction of the step at which it is, by linear interpolation.
    pub(super) fn first_crossing(&self, after: &Self, has_extra: bool) -> Option<(usize, T)> {
        let mut first = None;
        Self::look_for_crossing(&mut first, 0, &self.plain, &after.plain);
        if has_extra {
            Self::look_for_crossing(&mut first, LOOP_GUARDS, &self.extra, &after.extra);
        }
        first
    }

    /// Looks for one that is crossed earlier among some of the guards, of which the first has a number.
    #[inline(never)]
    fn look_for_crossing(first: &mut Option<(usize, T)>, number: usize, before: &[T], after: &[T]) {
        for (index, (&before, &after)) in (number..).zip(before.iter().zip(after)) {
            if after < T::ZERO && Model::<T>::is_violated(index, before, after) {
                let fraction = if before > T::ZERO { before / (before - after) } else { T::ZERO };
                if first.is_none_or(|(_, earliest)| fraction < earliest) {
                    *first = Some((index, fraction));
                }
            }
        }
    }
}
