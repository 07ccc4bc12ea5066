//! Seeded randomness: the same draws in every precision and on every machine.

use crate::scalar::Real;
use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro128PlusPlus;

/// xoshiro128++: 32-bit words, 16 bytes of state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Random(Xoshiro128PlusPlus);

impl Random {
    /// The sequence of a seed.
    pub fn new(seed: u64) -> Self {
        Self(Xoshiro128PlusPlus::seed_from_u64(seed))
    }

    /// Uniform in `[0, 1)`, a multiple of 2^-24, which every precision holds exactly.
    pub fn uniform<T: Real>(&mut self) -> T {
        T::from_count(self.0.next_u32() >> 8) * T::literal(1.0 / 16_777_216.0)
    }

    /// Bell-shaped with mean 0 and standard deviation 1: the sum of four uniforms.
    pub fn bell<T: Real>(&mut self) -> T {
        let sum = self.uniform::<T>() + self.uniform::<T>() + self.uniform::<T>() + self.uniform::<T>();
        (sum - T::literal(2.0)) * T::literal(1.732_050_807_568_877_2)
    }

    /// Uniform in `0..count`; `count` is at least 1.
    pub fn below(&mut self, count: usize) -> usize {
        ((u64::from(self.0.next_u32()) * count as u64) >> 32) as usize
    }
}
