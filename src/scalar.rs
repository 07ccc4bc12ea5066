//! The scalar that the models are generic over.
//!
//! [`Scalar`] is what a block of the model needs: arithmetic and selection without a branch, so that a vector of
//! lanes can implement it. [`Real`] adds a total decision (`bool` comparisons) for the code that branches: event
//! location, search, estimation. It is implemented for `f32` and `f64`.

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// Arithmetic and branch-free selection.
pub trait Scalar:
    Copy
    + Debug
    + Default
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + 'static
{
    /// The result of a comparison, one truth value per lane.
    type Mask: Copy;

    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;

    /// A literal of the source code. Folded at compile time, so no double-precision code reaches an MCU.
    fn literal(value: f64) -> Self;
    /// Absolute value.
    fn magnitude(self) -> Self;
    /// Square root, correctly rounded.
    fn root(self) -> Self;
    /// `self < other`, lane by lane.
    fn is_less(self, other: Self) -> Self::Mask;
    /// `if_true` where `mask` holds, else `if_false`.
    fn select(mask: Self::Mask, if_true: Self, if_false: Self) -> Self;

    /// The smaller of two values.
    #[inline(always)]
    fn smaller(self, other: Self) -> Self {
        Self::select(other.is_less(self), other, self)
    }

    /// The larger of two values.
    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        Self::select(self.is_less(other), other, self)
    }

    /// `sat(self, limit)`: clamped to `[-limit, limit]`; `limit >= 0`.
    #[inline(always)]
    fn saturate(self, limit: Self) -> Self {
        self.smaller(limit).larger(-limit)
    }
}

/// A [`Scalar`] with one truth value: `f32` or `f64`.
pub trait Real: Scalar<Mask = bool> + PartialOrd {
    /// An unsigned count as a scalar (exact up to 2^24 in `f32`).
    fn from_count(count: u32) -> Self;
    /// A setting that is kept in single precision.
    fn literal_f32(value: f32) -> Self;
    /// Neither infinite nor NaN?
    fn finite(self) -> bool;
    /// Largest integer not above `self`, for magnitudes below 2^31.
    fn whole(self) -> Self;
    /// `exp(-self)` for `self >= 0`, by argument halving and a polynomial; relative error below 1e-6 (`f32`), 1e-13 (`f64`).
    #[inline]
    fn exp_negative(self) -> Self {
        // exp(-x) = exp(-x/64)^64; past 87 the result is below the smallest normal f32.
        let x = self.smaller(Self::literal(87.0));
        let y = -x * Self::literal(1.0 / 64.0);
        let mut sum = Self::ONE;
        let mut order: u32 = 14;
        while order > 0 {
            sum = Self::ONE + sum * y / Self::from_count(order);
            order -= 1;
        }
        let mut squarings = 0;
        while squarings < 6 {
            sum *= sum;
            squarings += 1;
        }
        sum
    }
    /// `sin(2 pi self)` for magnitudes below 2^31, by folding and a polynomial; error below 3e-7 (`f32`), 1e-14
    /// (`f64`) for arguments that are exact.
    #[inline]
    fn sine_of_turns(self) -> Self {
        let turn = self - (self + Self::literal(0.5)).whole();
        // sin(pi - y) = sin(y): a quarter turn on either side of zero is left.
        let folded = if turn.magnitude() > Self::literal(0.25) {
            let half = if turn < Self::ZERO { -Self::literal(0.5) } else { Self::literal(0.5) };
            half - turn
        } else {
            turn
        };
        let y = folded * Self::literal(core::f64::consts::TAU);
        let square = y * y;
        // 1 over n (n + 1), the highest order first.
        let factors = [420.0, 342.0, 272.0, 210.0, 156.0, 110.0, 72.0, 42.0, 20.0, 6.0].map(|n| 1.0 / n);
        let mut sum = Self::ONE;
        for factor in factors {
            sum = Self::ONE - sum * square * Self::literal(factor);
        }
        sum * y
    }
}

macro_rules! scalar {
    ($float:ty, $sqrt:path) => {
        impl Scalar for $float {
            type Mask = bool;
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;

            #[inline(always)]
            fn literal(value: f64) -> Self {
                value as Self
            }
            #[inline(always)]
            fn magnitude(self) -> Self {
                <$float>::abs(self)
            }
            #[inline(always)]
            fn root(self) -> Self {
                $sqrt(self)
            }
            #[inline(always)]
            fn is_less(self, other: Self) -> bool {
                self < other
            }
            #[inline(always)]
            fn select(mask: bool, if_true: Self, if_false: Self) -> Self {
                if mask { if_true } else { if_false }
            }
        }

        #[allow(
            clippy::cast_lossless,
            reason = "one text for both precisions; the cast is lossless for `f64` only"
        )]
        impl Real for $float {
            #[inline(always)]
            fn from_count(count: u32) -> Self {
                count as Self
            }
            #[inline(always)]
            fn literal_f32(value: f32) -> Self {
                value.into()
            }
            #[inline(always)]
            fn finite(self) -> bool {
                <$float>::is_finite(self)
            }
            #[inline(always)]
            fn whole(self) -> Self {
                let truncated = self as i32 as Self;
                if truncated > self { truncated - 1.0 } else { truncated }
            }
        }
    };
}

scalar!(f32, libm::sqrtf);
scalar!(f64, libm::sqrt);
