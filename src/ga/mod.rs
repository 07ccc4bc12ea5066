//! Steady-state genetic algorithm in a static buffer.
//!
//! One child per call: [`SteadyState::ask`] proposes genes, the caller evaluates them, [`SteadyState::tell`] puts the
//! child in the place of the worst member if it is better. Genes are normalised to `[0, 1]`. All randomness comes from
//! the seed; nothing depends on the capacity of the buffers.

use crate::random::Random;
use crate::scalar::Real;

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
    /// Standard deviation of a mutation when the search has gone on for [`mutation_decay`](Self::mutation_decay)
    /// generations.
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

/// Genes and what they cost.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Member<T, const GENES: usize> {
    genes: [T; GENES],
    cost: T,
}

/// A population of up to `SIZE` members with up to `GENES` genes, and the state of the search.
#[derive(Clone, Debug, PartialEq)]
pub struct SteadyState<T, const GENES: usize, const SIZE: usize> {
    settings: Settings,
    members: [Member<T, GENES>; SIZE],
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
        const { assert!(SIZE >= 4, "a population of fewer than 4 members cannot breed") };
        let population = settings.population.clamp(4, SIZE);
        // Geometric decay by repeated multiplication: the root is found by bisection, once.
        let ratio = settings.mutation_end / settings.mutation_start;
        Self {
            settings: Settings { population, ..settings },
            members: [Member { genes: [T::ZERO; GENES], cost: T::ZERO }; SIZE],
            filled: 0,
            active: active.min(GENES),
            scale: [T::ONE; GENES],
            random: Random::new(seed),
            child: [T::ZERO; GENES],
            mutation: T::literal_f32(settings.mutation_start),
            mutation_factor: T::literal_f32(decay(
                ratio,
                settings.mutation_decay.saturating_mul(population as u32),
            )),
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
            for (gene, value) in child.iter_mut().take(self.active).enumerate() {
                *value = self.scatter(gene, self.filled, self.population());
            }
        } else {
            self.breed(&mut child);
        }
        self.child = child;
        child
    }

    /// Genes of the next members of the first population, evenly spread in every gene, that are alike in all genes but
    /// those that `may_differ`. Their costs are told with [`insert`](Self::insert), in their order.
    pub fn ask_together<const MEMBERS: usize>(
        &mut self,
        may_differ: impl Fn(usize) -> bool,
    ) -> [[T; GENES]; MEMBERS] {
        let mut members = [[T::ZERO; GENES]; MEMBERS];
        let groups = self.population().div_ceil(MEMBERS.max(1));
        for gene in 0..self.active {
            let alike = self.scatter(gene, self.filled / MEMBERS.max(1), groups);
            for (place, member) in members.iter_mut().enumerate() {
                if let Some(value) = member.get_mut(gene) {
                    *value = if may_differ(gene) {
                        self.scatter(gene, self.filled + place, self.population())
                    } else {
                        alike
                    };
                }
            }
        }
        members
    }

    /// A gene of one of some places that are evenly spread: its range is cut into as many strata, and a fixed stride
    /// deals the strata out (a Latin square), with a random place inside each.
    fn scatter(&mut self, gene: usize, place: usize, places: usize) -> T {
        let places = places.max(1);
        let mut stride = 1 + gene * (places / 3).max(1);
        while common_divisor(stride, places) != 1 {
            stride += 1;
        }
        let stratum = (place * stride + gene) % places;
        (T::from_count(stratum as u32) + self.random.uniform::<T>()) / T::from_count(places as u32)
    }

    fn breed(&mut self, child: &mut [T; GENES]) {
        let (first, second) = (self.pick(), self.pick());
        let blend = T::literal_f32(self.settings.blend);
        let mutate = self.random.uniform::<f32>() < self.settings.mutation_chance;
        let parents = first.genes.into_iter().zip(second.genes);
        for ((value, scale), (a, b)) in child.iter_mut().zip(self.scale).zip(parents).take(self.active) {
            let reach = T::ONE + blend + blend;
            *value = a + (self.random.uniform::<T>() * reach - blend) * (b - a);
            if mutate {
                *value += self.random.bell::<T>() * self.mutation * scale;
            }
            if *value < T::ZERO || *value > T::ONE {
                self.counters.clamps += 1;
            }
            *value = value.larger(T::ZERO).smaller(T::ONE);
        }
        if self.mutation > T::literal_f32(self.settings.mutation_end) {
            self.mutation *= self.mutation_factor;
        }
    }

    /// The better of two random members.
    fn pick(&mut self) -> Member<T, GENES> {
        let (a, b) = (self.draw(), self.draw());
        if b.cost < a.cost { b } else { a }
    }

    /// A random member.
    fn draw(&mut self) -> Member<T, GENES> {
        // The bound of the buffer holds anyway; named here, it leaves no check that could fail.
        self.members[self.random.below(self.filled).min(SIZE - 1)]
    }

    /// Takes the cost of the child that was asked for last.
    pub fn tell(&mut self, cost: T) -> Outcome {
        let child = self.child;
        self.insert(&child, cost)
    }

    /// A member's cost becomes known better than when it was told.
    pub fn revise(&mut self, member: usize, cost: T) {
        if let Some(member) = self.members.get_mut(member) {
            member.cost = cost;
        }
    }

    /// Offers a member from outside (a polished solution, a warm start).
    pub fn insert(&mut self, genes: &[T; GENES], cost: T) -> Outcome {
        self.counters.evaluations += 1;
        if !cost.finite() {
            return Outcome::Rejected;
        }
        let filling = self.filled < self.settings.population;
        let best = self.best().map(|(_, cost)| cost);
        let place = if filling { self.filled } else { self.extreme(-T::ONE) };
        let Some(place) = self.members.get_mut(place) else { return Outcome::Rejected };
        if !filling && cost >= place.cost {
            return Outcome::Rejected;
        }
        *place = Member { genes: *genes, cost };
        if filling {
            self.filled += 1;
            return Outcome::Filled;
        }
        self.counters.replacements += 1;
        if best.is_none_or(|best| cost < best) {
            self.counters.improvements += 1;
            Outcome::Improved
        } else {
            Outcome::Replaced
        }
    }

    /// The first member of least cost, or of most where the sign is -1; 0 while the population is empty. Not inlined: three
    /// places would hold it.
    #[inline(never)]
    fn extreme(&self, sign: T) -> usize {
        let mut found = (0, T::ZERO);
        for (index, member) in self.present().iter().enumerate() {
            if index == 0 || sign * member.cost < found.1 {
                found = (index, sign * member.cost);
            }
        }
        found.0
    }

    /// The members that there are.
    fn present(&self) -> &[Member<T, GENES>] {
        self.members.get(..self.filled).unwrap_or(&[])
    }

    fn member(&self, place: usize) -> Option<(&[T; GENES], T)> {
        self.present().get(place).map(|member| (&member.genes, member.cost))
    }

    /// The best member and its cost; none while the population is empty.
    pub fn best(&self) -> Option<(&[T; GENES], T)> {
        self.member(self.extreme(T::ONE))
    }

    /// The cost from which on a child would be rejected; none while every child becomes a member.
    pub fn rejection_cost(&self) -> Option<T> {
        let worst = self.member(self.extreme(-T::ONE));
        worst.filter(|_| self.filled == self.settings.population).map(|(_, cost)| cost)
    }

    /// Genes of the child that was asked for last.
    pub const fn last_child(&self) -> &[T; GENES] {
        &self.child
    }

    /// Largest distance between members in any gene: 0 when all are alike, 1 when they span a whole range.
    pub fn spread(&self) -> T {
        let mut widest = T::ZERO;
        for gene in 0..self.active {
            let (mut low, mut high) = (T::ONE, T::ZERO);
            for (genes, _) in self.members() {
                low = low.smaller(genes[gene]);
                high = high.larger(genes[gene]);
            }
            widest = widest.larger(high - low);
        }
        widest
    }

    /// The members and their costs.
    pub fn members(&self) -> impl Iterator<Item = (&[T; GENES], T)> {
        self.present().iter().map(|member| (&member.genes, member.cost))
    }

    /// What has happened so far.
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// Members of a full population.
    pub fn population(&self) -> usize {
        // At least 4 since `new`; said again where a division can see it.
        self.settings.population.max(4)
    }

    /// Children bred so far, in generations: as many children as there are members.
    pub fn generations(&self) -> u32 {
        self.counters.evaluations / self.population() as u32
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
