//! The whole search: genetic algorithm for the basin, Gauss-Newton for its bottom, and a reason for stopping.

use super::gauss_newton::{self, Ending, Finish, finish};
use super::problem::{Misfit, Problem};
use crate::ga::{Counters, Outcome, Settings as SearchSettings, SteadyState};
use crate::integrate::Stepper;
use crate::scalar::Real;
use nalgebra::RealField;

/// Part of a parameter's range by which a place is elsewhere.
const ELSEWHERE: f64 = 0.05;

/// Finishes that are made of the first population before the search goes on, beyond the first: a valley of the wrong friction
/// may look better than the right one from afar, but not at its bottom.
const MORE_FINISHES: usize = 4;

/// Motions over which a gene that changes the output only is swept, [`TOGETHER`] of its values along each.
const SWEEP: usize = 5;

/// How an identification is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings<T> {
    /// The genetic algorithm.
    pub search: SearchSettings,
    /// The finish.
    pub finish: gauss_newton::Settings<T>,
    /// Generations between two finishes; the first ones start at the best of the first population.
    pub generations_between_finishes: u32,
    /// Evaluations of the model after which the search gives up.
    pub budget: u32,
}

impl<T: Real> Default for Settings<T> {
    fn default() -> Self {
        Self {
            search: SearchSettings::default(),
            finish: gauss_newton::Settings::default(),
            generations_between_finishes: 2,
            budget: 400,
        }
    }
}

/// Why an identification ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StopReason {
    /// The residual is as small as the noise lets it be.
    NoiseReached,
    /// A finish from elsewhere found nothing better: the best there is, but above the noise.
    Settled,
    /// The budget of evaluations was used up first.
    Budget,
}

/// Members of the first population that share one motion, where any gene changes the output only.
pub const TOGETHER: usize = 4;

/// What one call of [`Identification::advance`] did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// Members of the first population that share one motion were evaluated.
    Filled,
    /// One child was evaluated.
    Child(Outcome),
    /// A finish was made.
    Finished,
    /// The identification has ended.
    Done(StopReason),
}

/// An identification in progress: one call, one child, one motion of the first population, or one finish.
#[derive(Clone, Debug)]
pub struct Identification<T, const GENES: usize, const SIZE: usize> {
    settings: Settings<T>,
    search: SteadyState<T, GENES, SIZE>,
    polished: Option<Finish<T, GENES>>,
    evaluations: u32,
    next_finish: u32,
    stop: Option<StopReason>,
    /// Values that are compared, as soon as a candidate has been evaluated to the end.
    count: Option<u32>,
    /// Which members have been given up as worse than the best? Their cost is a lower bound.
    given_up: [bool; SIZE],
    /// Where the first finishes with a sweep started.
    starts: [[T; GENES]; MORE_FINISHES],
    /// Finishes so far.
    finishes: usize,
    /// Has it been begun? Before, the steppers may be those of another rig.
    has_begun: bool,
}

impl<T: Real + RealField, const GENES: usize, const SIZE: usize> Identification<T, GENES, SIZE> {
    /// The start of an identification of `problem.free` from a seed. `None` where more parameters are free than there are
    /// genes.
    pub fn new(problem: &Problem<'_, T>, settings: Settings<T>, seed: u64) -> Option<Self> {
        if problem.free.len() > GENES {
            return None;
        }
        let search = SteadyState::new(settings.search, problem.free.len(), seed);
        // The best of the first population is often in the basin already; its finish is cheap, and tells.
        let next_finish = search.population() as u32;
        Some(Self {
            settings,
            search,
            polished: None,
            evaluations: 0,
            next_finish,
            stop: None,
            count: None,
            given_up: [false; SIZE],
            starts: [[T::ZERO; GENES]; MORE_FINISHES],
            finishes: 0,
            has_begun: false,
        })
    }

    /// Adds a place to the population that is worth a finish.
    pub fn suggest<S: Stepper<T>>(&mut self, problem: &Problem<'_, T>, genes: &[T; GENES], stepper: &mut S) {
        problem.turn_to_this_rig(stepper);
        let misfit = problem.misfit(genes, stepper);
        self.evaluations += 1;
        self.count = Some(misfit.count);
        self.search.insert(genes, misfit.mean_square());
    }

    /// Goes on by one child or one finish; see [`gauss_newton::normal_equations`] for the steppers.
    pub fn advance<S: Stepper<T>>(&mut self, problem: &Problem<'_, T>, steppers: &mut [S]) -> Progress {
        if let Some(reason) = self.stop {
            return Progress::Done(reason);
        }
        if !self.has_begun {
            for stepper in steppers.iter_mut() {
                problem.turn_to_this_rig(stepper);
            }
            self.has_begun = true;
        }
        if self.search.counters().evaluations < self.next_finish && self.evaluations < self.settings.budget {
            let Some(stepper) = steppers.first_mut() else { return Progress::Done(StopReason::Budget) };
            return self.evaluate(problem, stepper);
        }
        let Some((mut start, cost)) = self.next_start(problem) else {
            self.stop = Some(StopReason::Budget);
            return Progress::Done(StopReason::Budget);
        };
        if let (Some(last), Some(stepper)) = (self.finishes.checked_sub(1), steppers.first_mut()) {
            if let Some(place) = self.starts.get_mut(last) {
                *place = start;
            }
            self.sweep(problem, &mut start, cost, stepper);
        }
        let are_first = self.finishes < MORE_FINISHES;
        self.finishes += 1;
        let found = finish(problem, &start, &self.settings.finish, steppers);
        self.evaluations += found.evaluations;
        let settled = self.polished.is_some_and(|last| !is_better(&found, &last));
        if self.polished.is_none_or(|last| found.normal.misfit.chi_square < last.normal.misfit.chi_square) {
            self.polished = Some(found);
        }
        // A finish that was stuck in noise may have been so on the way down.
        let is_bottom = found.ending == Ending::Bottom || settled;
        let best = self.polished.as_ref().unwrap_or(&found);
        self.stop = if is_bottom && within_noise(&best.normal.misfit) {
            Some(StopReason::NoiseReached)
        } else if settled && !are_first {
            Some(StopReason::Settled)
        } else if self.evaluations >= self.settings.budget {
            Some(StopReason::Budget)
        } else {
            None
        };
        if self.stop.is_none()
            && let Some(stepper) = steppers.first_mut()
        {
            self.complete(problem, stepper);
        }
        self.search.insert(&found.genes, found.normal.misfit.mean_square());
        let generations = if are_first { 0 } else { self.settings.generations_between_finishes };
        let children = (self.search.population() as u32).saturating_mul(generations);
        self.next_finish = self.search.counters().evaluations.saturating_add(children);
        Progress::Finished
    }

    /// Where the next finish starts, and its cost: at the best member, but in a motion that is away from those of the first
    /// finishes, and of where the best one ended, which would only be found again.
    fn next_start(&self, problem: &Problem<'_, T>) -> Option<([T; GENES], T)> {
        let differ = |genes: &[T; GENES], other: &[T; GENES]| {
            genes.iter().zip(other).enumerate().take(problem.free.len()).any(|(gene, (a, b))| {
                (*a - *b).magnitude() > T::literal(ELSEWHERE) && !problem.is_output(gene)
            })
        };
        let swept = self.starts.iter().take(self.finishes.saturating_sub(1));
        let known = swept.chain(self.polished.as_ref().map(|last| &last.genes));
        let is_elsewhere = |genes: &[T; GENES]| known.clone().all(|known| differ(genes, known));
        let mut start: Option<(&[T; GENES], T)> = None;
        for (genes, cost) in self.search.members().filter(|(genes, _)| is_elsewhere(genes)) {
            if start.is_none_or(|(_, least)| cost < least) {
                start = Some((genes, cost));
            }
        }
        start.or_else(|| self.search.best()).map(|(genes, cost)| (*genes, cost))
    }

    /// Moves a start to the best of its output alone, over the whole range of each of its genes: a backlash has valleys of
    /// its own, from which no slope leads.
    fn sweep<S: Stepper<T>>(
        &mut self,
        problem: &Problem<'_, T>,
        start: &mut [T; GENES],
        mut cost: T,
        stepper: &mut S,
    ) {
        for gene in (0..problem.free.len()).filter(|&gene| problem.is_output(gene)) {
            for motion in 0..SWEEP {
                let places = T::from_count((SWEEP * TOGETHER) as u32);
                let group: [[T; GENES]; TOGETHER] = core::array::from_fn(|member| {
                    let mut genes = *start;
                    if let Some(value) = genes.get_mut(gene) {
                        *value =
                            (T::from_count((motion * TOGETHER + member) as u32) + T::literal(0.5)) / places;
                    }
                    genes
                });
                self.evaluations += 1;
                for (genes, misfit) in
                    group.iter().zip(misfits_of(problem, &group, stepper, T::ONE / T::ZERO))
                {
                    if misfit.mean_square() < cost {
                        (*start, cost) = (*genes, misfit.mean_square());
                    }
                }
            }
        }
    }

    /// Evaluates the next child, or the next members of the first population, no further than it takes to see that they do
    /// not matter.
    ///
    /// Of the first population the first finish wants the best only, so a member that is worse is given up; should the
    /// search go on, it is [completed](Self::complete). Later, a child that is worse than all members is rejected in any
    /// case.
    fn evaluate<S: Stepper<T>>(&mut self, problem: &Problem<'_, T>, stepper: &mut S) -> Progress {
        let rejection = self.search.rejection_cost();
        let limit = rejection.or_else(|| self.search.best().map(|(_, cost)| cost));
        let bound = match (limit, self.count) {
            // The margin is for rounding: what is given up is worse, and not as good.
            (Some(limit), Some(count)) => limit * T::from_count(count) * T::literal(1.0 + 1e-5),
            _ => T::ONE / T::ZERO,
        };
        self.evaluations += 1;
        if rejection.is_some() || !(0..problem.free.len()).any(|gene| problem.is_output(gene)) {
            let genes = self.search.ask();
            let misfit = problem.misfit_within(&genes, stepper, bound);
            return Progress::Child(self.admit(&genes, misfit, bound));
        }
        let group: [_; TOGETHER] = self.search.ask_together(|gene| problem.is_output(gene));
        // What is left over has not been evaluated to the end: it must not take the place of another.
        let room = self.search.population().saturating_sub(self.search.members().count());
        for (genes, misfit) in group.iter().zip(misfits_of(problem, &group, stepper, bound)).take(room) {
            self.admit(genes, misfit, bound);
        }
        Progress::Filled
    }

    /// Takes a child into the search, with what it cost, or had cost when it was given up.
    fn admit(&mut self, genes: &[T; GENES], mut misfit: Misfit<T>, bound: T) -> Outcome {
        let is_given_up = misfit.chi_square > bound;
        if is_given_up {
            misfit.count = self.count.unwrap_or(misfit.count);
        } else {
            self.count = Some(misfit.count);
        }
        let place = self.search.members().count();
        let outcome = self.search.insert(genes, misfit.mean_square());
        if outcome == Outcome::Filled
            && let Some(given_up) = self.given_up.get_mut(place)
        {
            *given_up = is_given_up;
        }
        outcome
    }

    /// Evaluates the members that were given up to the end, together where they share a motion.
    fn complete<S: Stepper<T>>(&mut self, problem: &Problem<'_, T>, stepper: &mut S) {
        let share_motion = |genes: &[T; GENES], other: &[T; GENES]| {
            genes.iter().zip(other).enumerate().all(|(gene, (a, b))| a == b || problem.is_output(gene))
        };
        for place in 0..SIZE {
            let is_given_up = self.given_up.get_mut(place).is_some_and(core::mem::take);
            let genes = self.search.members().nth(place).map(|(genes, _)| *genes);
            let (true, Some(genes)) = (is_given_up, genes) else { continue };
            let (mut places, mut group, mut count) = ([place; TOGETHER], [genes; TOGETHER], 1);
            for ((other, (genes, _)), given_up) in
                self.search.members().enumerate().zip(&mut self.given_up).skip(place + 1)
            {
                if *given_up
                    && share_motion(&group[0], genes)
                    && let (Some(at), Some(member)) = (places.get_mut(count), group.get_mut(count))
                {
                    (*given_up, *at, *member) = (false, other, *genes);
                    count += 1;
                }
            }
            self.evaluations += 1;
            let misfits = misfits_of(problem, &group, stepper, T::ONE / T::ZERO);
            for (&place, misfit) in places.iter().zip(misfits).take(count) {
                self.search.revise(place, misfit.mean_square());
            }
        }
    }

    /// Runs to the end.
    pub fn run<S: Stepper<T>>(&mut self, problem: &Problem<'_, T>, steppers: &mut [S]) -> StopReason {
        loop {
            if let Progress::Done(reason) = self.advance(problem, steppers) {
                return reason;
            }
        }
    }

    /// The best finish so far.
    pub const fn result(&self) -> Option<&Finish<T, GENES>> {
        self.polished.as_ref()
    }

    /// Evaluations of the model so far, those of finishes included, and those that were given up.
    pub const fn evaluations(&self) -> u32 {
        self.evaluations
    }

    /// The population.
    pub const fn search(&self) -> &SteadyState<T, GENES, SIZE> {
        &self.search
    }

    /// Counters of the genetic algorithm.
    pub const fn counters(&self) -> Counters {
        self.search.counters()
    }
}

/// Misfits of candidates that share one motion, given up as soon as all are above a bound.
fn misfits_of<T: Real, S: Stepper<T>, const GENES: usize>(
    problem: &Problem<'_, T>,
    group: &[[T; GENES]; TOGETHER],
    stepper: &mut S,
    bound: T,
) -> [Misfit<T>; TOGETHER] {
    let [first, second, third, fourth] = group.each_ref().map(<[T; GENES]>::as_slice);
    let (leader, [a, b, c]) = problem.misfits_within(first, [second, third, fourth], stepper, bound);
    [leader, a, b, c]
}

/// Is the mean square within five standard deviations (`sqrt(2/n)`) of what noise alone gives?
pub fn within_noise<T: Real>(misfit: &Misfit<T>) -> bool {
    let excess = misfit.mean_square() - T::ONE;
    let count = T::from_count(misfit.count);
    excess <= T::ZERO || excess * excess * count <= T::literal(25.0 * 2.0)
}

/// Is a finish better than another one by more than a thousandth of its chi-square, and by more than 1?
fn is_better<T: Real, const GENES: usize>(new: &Finish<T, GENES>, known: &Finish<T, GENES>) -> bool {
    let (new, known) = (new.normal.misfit.chi_square, known.normal.misfit.chi_square);
    known - new > (known * T::literal(1e-3)).larger(T::ONE)
}
