//! The scalar that the models are generic over: `f32` on a microcontroller, `f64` on a host.

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// What the model, the search and the estimates need of a scalar: `f32` or `f64`.
pub trait Real:
    Copy
    + Debug
    + Default
    + PartialOrd
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

    /// The smaller of two values; this one where one of them is no number.
    #[inline(always)]
    fn smaller(self, other: Self) -> Self {
        if other < self { other } else { self }
    }

    /// The larger of two values; this one where one of them is no number.
    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        if self < other { other } else { self }
    }

    /// `sat(self, limit)`: clamped to `[-limit, limit]`; `limit >= 0`.
    #[inline(always)]
    fn saturate(self, limit: Self) -> Self {
        self.smaller(limit).larger(-limit)
    }

    /// An unsigned count as a scalar (exact up to 2^24 in `f32`).
    fn from_count(count: u32) -> Self;
    /// A setting that is kept in single precision.
    fn literal_f32(value: f32) -> Self;
    /// Neither infinite nor NaN?
    fn finite(self) -> bool;
    /// Largest integer not above `self`, for magnitudes below 2^31.
    fn whole(self) -> Self;

    /// Distance from 1 to the next larger number. A constant of the type, as those below, so that no double-precision code
    /// reaches an MCU however the compiler is set.
    const RESOLUTION: Self;
    /// Series of `exp(x)`.
    const EXPONENTIAL: [Self; 16];
    /// Series of `cos(x)` in `x^2`.
    const COSINE: [Self; 8];
    /// Series of `sin(x)/x` in `x^2`.
    const SINE: [Self; 8];

    /// `exp(-self)` for `self >= 0`, by argument halving and a polynomial; relative error up to 87 below
    /// 3e-5 (`f32`) and 2e-9 (`f64`, 1e-13 up to 40); from there on the value at 87.
    #[inline]
    fn exp_negative(self) -> Self {
        // exp(-x) = exp(-x/64)^64; past 87 the result is below the smallest normal f32.
        let x = self.smaller(Self::literal(87.0));
        let mut power = polynomial(Self::EXPONENTIAL, -x * Self::literal(1.0 / 64.0));
        let mut squarings = 0;
        while squarings < 6 {
            power *= power;
            squarings += 1;
        }
        power
    }
    /// `cos(2 pi self)` and `sin(2 pi self)` for magnitudes below 2^29, by folding and polynomials; error below 3e-7
    /// (`f32`), 2e-15 (`f64`) for arguments that are exact.
    #[inline]
    fn circle_of_turns(self) -> [Self; 2] {
        // What is left of a turn after the nearest quarter.
        let quarters = self * Self::literal(4.0);
        let nearest = (quarters + Self::literal(0.5)).whole();
        let y = (quarters - nearest) * Self::literal(core::f64::consts::FRAC_PI_2);
        let square = y * y;
        let (cosine, sine) = (polynomial(Self::COSINE, square), y * polynomial(Self::SINE, square));
        let halves = nearest * Self::literal(0.5);
        let turns = halves.whole() * Self::literal(0.5);
        let sign = if turns.whole() == turns { Self::ONE } else { -Self::ONE };
        if halves.whole() == halves { [sign * cosine, sign * sine] } else { [-sign * sine, sign * cosine] }
    }
}

/// The sum of `sums[k] x^k`, in pairs, pairs of pairs and so on: no long chain of sums that wait for each other.
#[inline(always)]
fn polynomial<T: Real, const N: usize>(mut sums: [T; N], x: T) -> T {
    let (mut power, mut count) = (x, N);
    while count > 1 {
        count /= 2;
        for pair in 0..count {
            sums[pair] = sums[2 * pair] + sums[2 * pair + 1] * power;
        }
        power *= power;
    }
    sums[0]
}

macro_rules! series {
    ($name:ident, $float:ty) => {
        /// `sign^k/(start + step k)!` for `k` from 0 on: the series of a function.
        const fn $name<const N: usize>(sign: f64, start: u32, step: u32) -> [$float; N] {
            let mut coefficients = [0.0; N];
            let (mut factorial, mut order, mut power, mut k) = (1.0, 0, 1.0, 0);
            while k < N {
                while order < start + step * k as u32 {
                    order += 1;
                    factorial *= order as f64;
                }
                coefficients[k] = (power / factorial) as $float;
                power *= sign;
                k += 1;
            }
            coefficients
        }
    };
}

series!(single_series, f32);
series!(double_series, f64);

macro_rules! scalar {
    ($float:ty, $sqrt:path, $series:ident) => {
        #[allow(
            clippy::cast_lossless,
            reason = "one text for both precisions; the cast is lossless for `f64` only"
        )]
        impl Real for $float {
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

            const RESOLUTION: Self = <$float>::EPSILON;
            const EXPONENTIAL: [Self; 16] = $series(1.0, 0, 1);
            const COSINE: [Self; 8] = $series(-1.0, 0, 2);
            const SINE: [Self; 8] = $series(-1.0, 1, 2);

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

scalar!(f32, libm::sqrtf, single_series);
scalar!(f64, libm::sqrt, double_series);

#[cfg(test)]
mod tests {
    use super::*;
    extern crate std;

    #[test]
    fn sine_and_cosine_agree_with_the_standard_library() {
        for k in -4000..4000 {
            let turns = f64::from(k) * 1.7e-3;
            let (sine, cosine) = f64::sin_cos(turns * core::f64::consts::TAU);
            let [own_cosine, own_sine] = turns.circle_of_turns();
            assert!((own_sine - sine).abs() < 1e-14 && (own_cosine - cosine).abs() < 1e-14, "{turns}");
            let [own_cosine, own_sine] = (turns as f32).circle_of_turns().map(f64::from);
            assert!((own_sine - sine).abs() < 3e-6 && (own_cosine - cosine).abs() < 3e-6, "{turns}");
        }
    }

    #[test]
    fn the_exponential_agrees_with_the_standard_library() {
        for k in 0..=87_000 {
            let x = (k as f32 * 1e-3).min(87.0);
            let (single, double) = (f64::from(x.exp_negative()), f64::from(x).exp_negative());
            let exact = (-f64::from(x)).exp();
            assert!((single / exact - 1.0).abs() < 3e-5, "{x}");
            assert!((double / exact - 1.0).abs() < if x <= 40.0 { 1e-13 } else { 2e-9 }, "{x}");
        }
        assert_eq!(200_f32.exp_negative(), 87_f32.exp_negative());
        assert_eq!(200_f64.exp_negative(), 87_f64.exp_negative());
    }
}
