//! Steady-state genetic algorithm in a static buffer.
//!
//! One child per call: [`SteadyState::ask`] proposes genes, the caller evaluates them, [`SteadyState::tell`] puts the
//! child in the place of the worst member if it is better. Genes are normalised to `[0, 1]`. All randomness comes from
//! the seed; nothing depends on the capacity of the buffers.

mod random;

use crate::scalar::Real;
use random::Random;

/// How the search is made; see [`Settings::default`] for the values in use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Members of the population, 4 to the capacity.
    pub population: usize,
    /// How far a child may lie outside its parents, relative to their distance (BLX-alpha).
    pub blend: f32,
    /// Chance that a child is mutated at all.
    pub mutation_chance: f32,
    /// Standard deviation of a mutation, relative to the gene's range, when the search starts.
    pub mutation_start: f32,
    /// The same when it has gone on for [`mutation_decay`](Self::mutation_decay) generations.
    pub mutation_end: f32,
    /// Generations over which the mutation shrinks (geometrically).
    pub mutation_decay: u32,
}

impl Default for Settings {
    /// Population 20 as in the source; BLX-0.5 (Eshelman and Schaffer 1993), mutations from 15 % to 1 % of the range.
    fn default() -> Self {
        Self {
            population: 20,
            blend: 0.5,
            mutation_chance: 0.35,
            mutation_start: 0.15,
            mutation_end: 0.01,
            mutation_decay: 10,
        }
    }
}

/// What became of a child.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The population was not full yet.
    Filled,
    /// It replaced the worst member and is now the best.
    Improved,
    /// It replaced the worst member.
    Replaced,
    /// It was worse than all, or its cost was not a number.
    Rejected,
}

/// What has happened so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Costs that were told.
    pub evaluations: u32,
    /// Children that replaced a member.
    pub replacements: u32,
    /// Children that became the best.
    pub improvements: u32,
    /// Genes that were cut to their range.
    pub clamps: u32,
}

/// A population of up to `SIZE` members with up to `GENES` genes, and the state of the search.
#[derive(Clone, Debug, PartialEq)]
pub struct SteadyState<T, const GENES: usize, const SIZE: usize> {
    settings: Settings,
    genes: [[T; GENES]; SIZE],
    costs: [T; SIZE],
    filled: usize,
    active: usize,
    /// Mutation of each gene relative to the others.
    scale: [T; GENES],
    random: Random,
    child: [T; GENES],
    mutation: T,
    mutation_factor: T,
    counters: Counters,
}

impl<T: Real, const GENES: usize, const SIZE: usize> SteadyState<T, GENES, SIZE> {
    /// An empty population for `active <= GENES` genes. The size is cut to the range 4 to `SIZE`.
    pub fn new(settings: Settings, active: usize, seed: u64) -> Self {
        let population = settings.population.clamp(4, SIZE);
        // Geometric decay by repeated multiplication: the root is found by bisection, once.
        let ratio = settings.mutation_end / settings.mutation_start;
        Self {
            settings: Settings { population, ..settings },
            genes: [[T::ZERO; GENES]; SIZE],
            costs: [T::ZERO; SIZE],
            filled: 0,
            active: active.min(GENES),
            scale: [T::ONE; GENES],
            random: Random::new(seed),
            child: [T::ZERO; GENES],
            mutation: T::literal_f32(settings.mutation_start),
            mutation_factor: T::literal_f32(decay(ratio, settings.mutation_decay * population as u32)),
            counters: Counters::default(),
        }
    }

    /// Makes mutations of one gene larger or smaller than those of the others (1 by default).
    pub fn set_mutation_scale(&mut self, gene: usize, scale: T) {
        if let Some(place) = self.scale.get_mut(gene) {
            *place = scale;
        }
    }

    /// Genes of the next child, each in `[0, 1]`. The first calls fill the population, evenly spread in every gene.
    pub fn ask(&mut self) -> [T; GENES] {
        let mut child = [T::ZERO; GENES];
        if self.filled < self.settings.population {
            self.scatter(&mut child);
        } else {
            self.breed(&mut child);
        }
        self.child = child;
        child
    }

    /// One member of an evenly spread first population: each gene's range is cut into as many strata as there are
    /// members, and a fixed stride deals the strata out (a Latin square), with a random place inside each.
    fn scatter(&mut self, child: &mut [T; GENES]) {
        let members = self.settings.population;
        for (gene, value) in child.iter_mut().take(self.active).enumerate() {
            let mut stride = 1 + gene * (members / 3).max(1);
            while common_divisor(stride, members) != 1 {
                stride += 1;
            }
            let stratum = (self.filled * stride + gene) % members;
            *value =
                (T::from_count(stratum as u32) + self.random.uniform::<T>()) / T::from_count(members as u32);
        }
    }

    fn breed(&mut self, child: &mut [T; GENES]) {
        let (first, second) = (self.pick(), self.pick());
        let blend = T::literal_f32(self.settings.blend);
        let mutate = self.random.uniform::<f32>() < self.settings.mutation_chance;
        for gene in 0..self.active {
            let (a, b) = (self.genes[first][gene], self.genes[second][gene]);
            let reach = T::ONE + blend + blend;
            let mut value = a + (self.random.uniform::<T>() * reach - blend) * (b - a);
            if mutate {
                value += self.random.bell::<T>() * self.mutation * self.scale[gene];
            }
            if value < T::ZERO || value > T::ONE {
                self.counters.clamps += 1;
            }
            child[gene] = value.larger(T::ZERO).smaller(T::ONE);
        }
        if self.mutation > T::literal_f32(self.settings.mutation_end) {
            self.mutation *= self.mutation_factor;
        }
    }

    /// The better of two random members.
    fn pick(&mut self) -> usize {
        let a = self.random.below(self.filled);
        let b = self.random.below(self.filled);
        if self.costs[b] < self.costs[a] { b } else { a }
    }

    /// Takes the cost of the child that was asked for last.
    pub fn tell(&mut self, cost: T) -> Outcome {
        let child = self.child;
        self.insert(&child, cost)
    }

    /// Offers a member from outside (a polished solution, a warm start).
    pub fn insert(&mut self, genes: &[T; GENES], cost: T) -> Outcome {
        self.counters.evaluations += 1;
        if !cost.finite() {
            return Outcome::Rejected;
        }
        let best = self.best().map(|(_, cost)| cost);
        if self.filled < self.settings.population {
            self.genes[self.filled] = *genes;
            self.costs[self.filled] = cost;
            self.filled += 1;
            return Outcome::Filled;
        }
        let worst = self.extreme(|candidate, worst| candidate > worst);
        if cost >= self.costs[worst] {
            return Outcome::Rejected;
        }
        self.genes[worst] = *genes;
        self.costs[worst] = cost;
        self.counters.replacements += 1;
        if best.is_none_or(|best| cost < best) {
            self.counters.improvements += 1;
            Outcome::Improved
        } else {
            Outcome::Replaced
        }
    }

    fn extreme(&self, better: impl Fn(T, T) -> bool) -> usize {
        let mut found = 0;
        for member in 1..self.filled {
            if better(self.costs[member], self.costs[found]) {
                found = member;
            }
        }
        found
    }

    /// The best member and its cost; none while the population is empty.
    pub fn best(&self) -> Option<(&[T; GENES], T)> {
        if self.filled == 0 {
            return None;
        }
        let best = self.extreme(|candidate, best| candidate < best);
        Some((&self.genes[best], self.costs[best]))
    }

    /// Largest distance between members in any gene: 0 when all are alike, 1 when they span a whole range.
    pub fn spread(&self) -> T {
        let mut widest = T::ZERO;
        for gene in 0..self.active {
            let (mut low, mut high) = (T::ONE, T::ZERO);
            for member in self.genes.iter().take(self.filled) {
                low = low.smaller(member[gene]);
                high = high.larger(member[gene]);
            }
            widest = widest.larger(high - low);
        }
        widest
    }

    /// The members and their costs.
    pub fn members(&self) -> impl Iterator<Item = (&[T; GENES], T)> {
        self.genes.iter().zip(self.costs.iter().copied()).take(self.filled)
    }

    /// What has happened so far.
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// Members of a full population.
    pub const fn population(&self) -> usize {
        self.settings.population
    }

    /// Children bred so far, in generations: as many children as there are members.
    pub const fn generations(&self) -> u32 {
        self.counters.evaluations / self.settings.population as u32
    }
}

/// The factor whose `count`-th power is `ratio` (0 < ratio <= 1), by bisection in `f32`.
fn decay(ratio: f32, count: u32) -> f32 {
    let (mut low, mut high) = (0.0_f32, 1.0_f32);
    let mut halvings = 0;
    while halvings < 24 {
        let middle = 0.5 * (low + high);
        let mut power = 1.0_f32;
        let mut base = middle;
        let mut left = count;
        while left > 0 {
            if left & 1 == 1 {
                power *= base;
            }
            base *= base;
            left >>= 1;
        }
        if power < ratio {
            low = middle;
        } else {
            high = middle;
        }
        halvings += 1;
    }
    high
}

fn common_divisor(a: usize, b: usize) -> usize {
    let (mut a, mut b) = (a, b);
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

#[cfg(test)]
mod tests;
