//! Stand-in for the monitor's run: seeded noise through a logistic map, and square roots.

use crate::Platform;
use core::hint::black_box;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

/// Steps of the stand-in.
const STEPS: u32 = 10_000;

/// Runs the workload and reports its results.
pub(crate) fn run(platform: &mut impl Platform) {
    let mean_root = platform.measure("workload", || logistic_roots(black_box(STEPS)));
    platform.result_f32("mean_root", mean_root);
    platform.result_count("steps", u64::from(STEPS));
    #[cfg(feature = "negative-control-panic")]
    platform.result_count("negative_control_panic", reachable_panic());
    #[cfg(feature = "negative-control-f64")]
    platform.result_f32("negative_control_f64", double_precision());
}

/// Mean of the square roots of `steps` values of a logistic map that noise perturbs.
fn logistic_roots(steps: u32) -> f32 {
    let mut rng = Xoshiro128PlusPlus::seed_from_u64(1);
    let mut value = 0.5_f32;
    let mut sum = 0.0_f32;
    for _ in 0..steps {
        // 24 random bits: exact in an f32, in [0, 1).
        let noise = (rng.next_u32() >> 8) as f32 * (1.0 / 16_777_216.0);
        value = 3.9 * value * (1.0 - value) * (0.99 + 0.01 * noise);
        sum += libm::sqrtf(value);
    }
    sum / steps as f32
}

/// An index that the compiler cannot prove to be in bounds: the release image must not link.
#[cfg(feature = "negative-control-panic")]
fn reachable_panic() -> u64 {
    [1, 2, 3][black_box(1_usize)]
}

/// A sum and a product in double precision: on a part without a double-precision unit they call `__aeabi_d*`.
#[cfg(feature = "negative-control-f64")]
fn double_precision() -> f32 {
    (black_box(1.5_f64) * black_box(2.0_f64) + 1.0) as f32
}
