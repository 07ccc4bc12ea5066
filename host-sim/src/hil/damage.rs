//! A line that loses, damages, repeats and reorders bytes: seeded, so that a run can be repeated.

use rand_core::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// What happened on the line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Injected {
    /// Bytes that never came.
    pub lost: u32,
    /// Bytes with a bit that was turned over.
    pub flipped: u32,
    /// Bytes that came twice.
    pub repeated: u32,
    /// Bytes that came after their successor.
    pub reordered: u32,
}

/// Damages bytes at a rate.
#[derive(Clone, Debug)]
pub struct Damage {
    random: Xoshiro256PlusPlus,
    rate: f64,
    injected: Injected,
}

impl Damage {
    /// Damages each byte with a chance of `rate`.
    pub fn new(rate: f64, seed: u64) -> Self {
        Self { random: Xoshiro256PlusPlus::seed_from_u64(seed), rate, injected: Injected::default() }
    }

    /// The bytes as they arrive.
    pub fn pass(&mut self, bytes: &[u8]) -> Vec<u8> {
        let mut arrived = Vec::with_capacity(bytes.len() + 2);
        let mut late = None;
        for &byte in bytes {
            let draw = self.random.next_u64();
            let unlucky = ((draw >> 11) as f64 / (1_u64 << 53) as f64) < self.rate;
            match (unlucky, draw % 4) {
                (false, _) => arrived.push(byte),
                (true, 0) => self.injected.lost += 1,
                (true, 1) => {
                    self.injected.flipped += 1;
                    arrived.push(byte ^ 1 << (draw >> 2 & 7));
                }
                (true, 2) => {
                    self.injected.repeated += 1;
                    arrived.extend([byte; 2]);
                }
                (true, _) => {
                    self.injected.reordered += 1;
                    arrived.extend(late.replace(byte));
                    continue;
                }
            }
            arrived.extend(late.take());
        }
        arrived.extend(late);
        arrived
    }

    /// What happened so far.
    pub const fn injected(&self) -> Injected {
        self.injected
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_without_damage_passes_everything_and_each_kind_happens() {
        let bytes: Vec<u8> = (0..=255).cycle().take(100_000).collect();
        assert_eq!(Damage::new(0.0, 1).pass(&bytes), bytes);
        let mut damage = Damage::new(0.01, 1);
        assert_ne!(damage.pass(&bytes), bytes);
        let Injected { lost, flipped, repeated, reordered } = damage.injected();
        for count in [lost, flipped, repeated, reordered] {
            assert!((200..300).contains(&count), "{count}");
        }
    }
}
