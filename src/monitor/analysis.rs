//! The faults of one window: a descent from the last estimate, and a search only where that does not explain it.
//!
//! Everything is cut into passes (see [`Pass`]), and a pass into steps, so that the work stops and goes on anywhere.

use super::config::Config;
use super::pass::{ALIKE, Aim, Pass, Path, Scene, Start};
use super::slot::Slot;
use super::sums::Sums;
use crate::fit::gauss_newton::Normal;
use crate::fit::identify::within_noise;
use crate::ga::{Settings, SteadyState};
use crate::integrate::{LONGEST_PIECE, Stepper};

/// Most steps of a descent.
const DESCENT_STEPS: u32 = 6;
/// How often a step that does not help is halved.
const HALVINGS: u32 = 3;
/// Promised fall of chi-square that is not worth a step.
const TOLERANCE: f32 = 0.05;
/// Evaluations after which no new generation is bred: with the one before them they stay within a window's budget.
const EVALUATIONS: u32 = 40;

/// A place in the space of the faults, and what the window says there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found<const GENES: usize> {
    pub(super) genes: [f32; GENES],
    pub(super) sums: Sums<GENES>,
    pub(super) path: Path,
    pub(super) end: Start,
}

impl<const GENES: usize> Found<GENES> {
    /// Chi-square about the means of the channels.
    fn chi_square(&self) -> f32 {
        self.sums.misfit().chi_square
    }

    /// Standard error of each gene that the equations predict; infinite where nothing is known.
    pub(super) fn standard_errors(&self) -> [f32; GENES] {
        let mut errors = [f32::INFINITY; GENES];
        // A gene that nothing depends on has no part in the matrix.
        let known = self.sums.normal();
        let mut normal = known;
        for gene in 0..GENES {
            if normal.curvature[(gene, gene)] <= 0.0 {
                normal.curvature[(gene, gene)] = 1.0;
            }
        }
        if let Some(standard) = normal.standard_errors() {
            for gene in 0..GENES {
                if known.curvature[(gene, gene)] > 0.0 && standard[gene].is_finite() {
                    errors[gene] = standard[gene];
                }
            }
        }
        errors
    }

    /// By what the standard errors are larger, since the residual is not noise; 1 where it is.
    pub(super) fn widening(&self) -> f32 {
        libm::sqrtf(self.sums.inflation())
    }

    /// Is the residual noise?
    pub(super) fn is_explained(&self) -> bool {
        within_noise(&self.sums.misfit())
    }

    /// The normal equations without the genes that the window says too little of to move them.
    fn without_quiet_genes(&self, config: &Config<GENES>) -> Normal<f32, GENES> {
        let mut normal = self.sums.normal();
        for gene in 0..GENES {
            let resolution = resolution(config, gene);
            if normal.curvature[(gene, gene)] * resolution * resolution < 1.0 {
                normal.gradient[gene] = 0.0;
                for other in 0..GENES {
                    normal.curvature[(gene, other)] = 0.0;
                    normal.curvature[(other, gene)] = 0.0;
                }
            }
        }
        normal
    }
}

/// Largest standard error of a gene that tells the alarmed value from the healthy one: with a quarter of their
/// distance, the value between them is two standard errors from either.
pub(super) fn resolution<const GENES: usize>(config: &Config<GENES>, gene: usize) -> f32 {
    config.faults.get(gene).map_or(0.0, |fault| 0.25 * (fault.alarm - fault.healthy) / fault.free.range())
}

/// What the analysis is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Looking how long it matters where the motion started.
    Settling,
    /// Going down to the bottom of a basin.
    Descent,
    /// Looking what the members of the last population are worth in this window.
    Score(usize),
    /// Breeding.
    Breed(usize),
    /// Back to the first bottom, which no other has beaten, or to the best place of a search that was cut short.
    Return,
}

/// The analysis of one window.
#[derive(Clone, Debug)]
pub(super) struct Analysis<const GENES: usize, const POPULATION: usize> {
    phase: Phase,
    pass: Pass<GENES>,
    here: Slot<Found<GENES>>,
    /// Bottom of the first descent: genes and chi-square.
    first: Option<([f32; GENES], f32)>,
    search: Slot<SteadyState<f32, GENES, POPULATION>>,
    steps_down: u32,
    halvings: u32,
    /// Evaluations of the model so far.
    pub(super) evaluations: u32,
    /// Steps so far.
    steps: u32,
    /// Most that it may take before it ends, or comes back from a search: no limit while nothing is known, or on its way back.
    most: u32,
    /// Steps of the dearest pass of a descent.
    dearest: u32,
    seed: u64,
}

impl<const GENES: usize, const POPULATION: usize> Analysis<GENES, POPULATION> {
    /// An analysis that has not [begun](Self::begin): all zeros.
    pub(super) const IDLE: Self = Self {
        phase: Phase::Settling,
        pass: Pass::IDLE,
        here: Slot::Empty,
        first: None,
        search: Slot::Empty,
        steps_down: 0,
        halvings: 0,
        evaluations: 0,
        steps: 0,
        most: 0,
        dearest: 0,
        seed: 0,
    };

    /// Begins the analysis of a window at a guess, in place: it is too large for the stack.
    pub(super) fn begin<const SAMPLES: usize>(
        &mut self,
        scene: &Scene<'_, GENES, SAMPLES>,
        guess: &[f32; GENES],
        seed: u64,
    ) {
        self.here = Slot::Empty;
        self.first = None;
        self.search = Slot::Empty;
        (self.steps_down, self.halvings, self.evaluations) = (0, 0, 0);
        (self.steps, self.most, self.dearest) = (0, u32::MAX, 0);
        self.seed = seed;
        self.pass.begin(scene.settle);
        let is_known = scene.start.doubt.abs() <= ALIKE * scene.config.believed_noise()[0];
        let aim;
        (self.phase, aim) =
            if is_known { (Phase::Descent, Aim::Slopes) } else { (Phase::Settling, Aim::Settling) };
        self.pass.restart(scene, guess, aim);
    }

    /// Goes on by at most `allowance` steps, and takes what it has used off it. True at the end.
    pub(super) fn advance<S: Stepper<f32>, const SAMPLES: usize>(
        &mut self,
        scene: &Scene<'_, GENES, SAMPLES>,
        seeds: &[[f32; GENES]],
        stepper: &mut S,
        allowance: &mut u32,
    ) -> bool {
        loop {
            let left = self.left();
            let given = left.min(*allowance);
            let mut share = given;
            let has_ended = self.pass.advance(scene, stepper, &mut share);
            let taken = given.saturating_sub(share);
            *allowance = allowance.saturating_sub(taken);
            self.steps = self.steps.saturating_add(taken);
            if !has_ended && given < left {
                return false;
            }
            match if has_ended { self.next(scene, seeds) } else { self.cut_short() } {
                Some((genes, aim)) => self.pass.restart(scene, &genes, aim),
                None => return true,
            }
        }
    }

    /// Steps that are left.
    const fn left(&self) -> u32 {
        self.most.saturating_sub(self.steps)
    }

    /// What to walk once no steps are left: none where the best place that is known is the last one.
    #[inline(never)]
    fn cut_short(&mut self) -> Option<([f32; GENES], Aim)> {
        let (_, first) = self.first?;
        if self.here.get().is_some_and(|here| is_less(here.chi_square(), first)) {
            return None;
        }
        let (&best, _) = self.search.get()?.best()?;
        Some(self.come_back(best))
    }

    /// Back to a place that is known to be the best.
    fn come_back(&mut self, genes: [f32; GENES]) -> ([f32; GENES], Aim) {
        self.phase = Phase::Return;
        self.here = Slot::Empty;
        self.most = u32::MAX;
        (genes, Aim::Slopes)
    }

    /// What to walk after a pass has ended, and what for. None: the end.
    ///
    /// Not inlined: what it copies would lie on the stack below the whole simulation.
    #[inline(never)]
    fn next<const SAMPLES: usize>(
        &mut self,
        scene: &Scene<'_, GENES, SAMPLES>,
        seeds: &[[f32; GENES]],
    ) -> Option<([f32; GENES], Aim)> {
        self.evaluations += self.pass.evaluations();
        match self.phase {
            Phase::Settling => {
                self.phase = Phase::Descent;
                Some((self.pass.genes, Aim::Slopes))
            }
            Phase::Descent => {
                self.dearest = self.dearest.max(self.pass.steps());
                // What follows leaves what it takes to come back.
                self.most = scene.config.most_steps(scene.time).saturating_sub(self.dearest);
                let next = self.descend(scene).map(|genes| (genes, Aim::Slopes));
                next.or_else(|| self.conclude(seeds))
            }
            Phase::Score(index) => {
                let cost = self.pass.sums().misfit().mean_square();
                let genes = self.pass.genes;
                if let Some(search) = self.search.get_mut() {
                    search.insert(&genes, cost);
                }
                match seeds.get(index + 1) {
                    Some(&genes) => {
                        self.phase = Phase::Score(index + 1);
                        Some((genes, Aim::Cost))
                    }
                    None => self.breed(0),
                }
            }
            Phase::Return => {
                self.here = Slot::Full(self.there(scene));
                None
            }
            Phase::Breed(children) => {
                let cost = self.pass.sums().misfit().mean_square();
                if let Some(search) = self.search.get_mut() {
                    search.tell(cost);
                }
                self.breed(children + 1)
            }
        }
    }

    /// Where the pass that has ended was.
    fn there<const SAMPLES: usize>(&self, scene: &Scene<'_, GENES, SAMPLES>) -> Found<GENES> {
        let sums = *self.pass.sums();
        Found { genes: self.pass.genes, sums, path: *self.pass.path(), end: self.pass.end(scene) }
    }

    /// The next place of a descent; none at its bottom.
    fn descend<const SAMPLES: usize>(&mut self, scene: &Scene<'_, GENES, SAMPLES>) -> Option<[f32; GENES]> {
        let there = self.there(scene);
        match &mut self.here {
            Slot::Full(here) if !is_less(there.chi_square(), here.chi_square()) => {
                self.halvings += 1;
                let halfway = core::array::from_fn(|gene| 0.5 * (here.genes[gene] + there.genes[gene]));
                return (self.halvings <= HALVINGS).then_some(halfway);
            }
            here => *here = Slot::Full(there),
        }
        self.halvings = 0;
        self.steps_down += 1;
        if self.steps_down > DESCENT_STEPS {
            return None;
        }
        let normal = there.without_quiet_genes(scene.config);
        let (genes, promised) = normal.foreseen(&there.genes, GENES)?;
        // Also where the promise is no number.
        (there.chi_square() - promised > TOLERANCE).then_some(genes)
    }

    /// What follows the bottom of a descent: the end, or a search for a better basin.
    fn conclude(&mut self, seeds: &[[f32; GENES]]) -> Option<([f32; GENES], Aim)> {
        let here = self.here.get()?;
        let chi_square = here.chi_square();
        let settled = self.first.is_some_and(|(_, first)| first - chi_square <= (1e-3 * first).max(1.0));
        if let Some((genes, first)) = self.first
            && first < chi_square
        {
            return Some(self.come_back(genes));
        }
        let says_nothing = here.path.reversals == 0;
        let is_done = here.is_explained() || settled || says_nothing || self.evaluations >= EVALUATIONS;
        if is_done || self.left() < LONGEST_PIECE {
            return None;
        }
        self.first = Some((here.genes, chi_square));
        let mut search =
            SteadyState::new(Settings { population: POPULATION, ..Settings::default() }, GENES, self.seed);
        search.insert(&here.genes, here.sums.misfit().mean_square());
        self.search = Slot::Full(search);
        if let Some(&genes) = seeds.first() {
            self.phase = Phase::Score(0);
            Some((genes, Aim::Cost))
        } else {
            self.breed(0)
        }
    }

    /// The next child, or after a generation the descent from the best.
    fn breed(&mut self, children: usize) -> Option<([f32; GENES], Aim)> {
        let search = self.search.get_mut()?;
        if children < POPULATION {
            self.phase = Phase::Breed(children);
            return Some((search.ask(), Aim::Cost));
        }
        let (&best, _) = search.best()?;
        self.phase = Phase::Descent;
        self.here = Slot::Empty;
        (self.steps_down, self.halvings) = (0, 0);
        Some((best, Aim::Slopes))
    }

    /// The best place found.
    pub(super) const fn found(&self) -> Option<&Found<GENES>> {
        self.here.get()
    }

    /// Steps in all.
    pub(super) const fn steps(&self) -> u32 {
        self.steps
    }

    /// Puts the last population in `seeds`: how many there are, which is fewer where the search was cut short. None if there
    /// was no search.
    pub(super) fn leave_seeds(&self, seeds: &mut [[f32; GENES]; POPULATION]) -> Option<u32> {
        let mut count = 0;
        for (seed, (genes, _)) in seeds.iter_mut().zip(self.search.get()?.members()) {
            *seed = *genes;
            count += 1;
        }
        Some(count)
    }
}

/// Is a chi-square smaller than another? Not where it is no number.
fn is_less(chi_square: f32, other: f32) -> bool {
    chi_square < other
}
