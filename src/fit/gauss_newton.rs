//! Gauss-Newton finish with standard errors: what the search has found is brought to the bottom of its basin.
//!
//! Derivatives are forward differences in the genes. The model and its perturbed neighbours walk along the record
//! together, a few samples at a time, so no trace is stored. A neighbour that differs in its output only (backlash,
//! LVDT) follows the motion of the model and costs no simulation.

use super::problem::{Compared, MEASURED, Misfit, Offset, Problem, Record};
use super::walk::Walk;
use crate::integrate::Stepper;
use crate::model::Model;
use crate::model::state::Outputs;
use crate::scalar::Real;
use crate::simulate::Follower;
use nalgebra::{RealField, SMatrix, SVector};

/// Samples that one model walks before the next one follows: amortises what a change of model costs the stepper.
const CHUNK: usize = 16;

/// Most steps that are tried at one place, each shorter than the one before.
const ATTEMPTS: u32 = 6;

/// How a finish is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings<T> {
    /// Width of the forward difference, in genes.
    pub difference: T,
    /// Most steps.
    pub steps: u32,
    /// A step that promises to lower chi-square by less, in units of the mean square that is left where that is more than
    /// noise, is not made: the place is the bottom.
    pub tolerance: T,
}

impl<T: Real> Default for Settings<T> {
    /// 0.2 % of the range; in `f32` the model's rounding is then a hundredth of the difference for the friction.
    fn default() -> Self {
        Self { difference: T::literal(2e-3), steps: 12, tolerance: T::literal(1e-4) }
    }
}

/// Why a finish ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// No step promises anything.
    Bottom,
    /// No damping makes a step that helps: rounding, or an event that a candidate jumps over.
    Stuck,
    /// The steps were used up.
    Steps,
}

/// Normal equations at one place: misfit, half gradient and half curvature of chi-square, in genes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normal<T, const GENES: usize> {
    /// Misfit.
    pub misfit: Misfit<T>,
    /// `J^T r`.
    pub gradient: SVector<T, GENES>,
    /// `J^T J`; 1 on the diagonal of genes that are not in use.
    pub curvature: SMatrix<T, GENES, GENES>,
}

/// Rise of chi-square over all of a gene's range below which the records say nothing of it.
const UNTOLD: f64 = 1e-6;

/// Where a finish ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finish<T, const GENES: usize> {
    /// Genes.
    pub genes: [T; GENES],
    /// Normal equations there.
    pub normal: Normal<T, GENES>,
    /// Evaluations of the model that it took.
    pub evaluations: u32,
    /// Why it ended.
    pub ending: Ending,
}

/// The normal equations at a place.
///
/// `steppers` holds one stepper, shared in turns, or one for each model (`free + 1`): the latter is needed for speed
/// where a free parameter reaches the transition matrices. It must not be empty.
pub fn normal_equations<T, S, const GENES: usize>(
    problem: &Problem<'_, T>,
    genes: &[T; GENES],
    difference: T,
    steppers: &mut [S],
) -> Normal<T, GENES>
where
    T: Real + RealField,
    S: Stepper<T>,
{
    let active = problem.free.len().min(GENES);
    let mut normal = Normal {
        misfit: Misfit { chi_square: T::ZERO, count: 0 },
        gradient: SVector::from_element(T::ZERO),
        curvature: SMatrix::from_fn(
            |row, column| if row == column && row >= active { T::ONE } else { T::ZERO },
        ),
    };
    // Differences point inwards at the upper bound.
    let widths: [T; GENES] =
        core::array::from_fn(|gene| if genes[gene] + difference > T::ONE { -difference } else { difference });
    let base = problem.model(genes);
    let neighbours: [Model<T>; GENES] = core::array::from_fn(|gene| {
        let mut moved = *genes;
        moved[gene] += widths[gene];
        if gene < active { problem.model(&moved) } else { base }
    });
    let shared = steppers.len() <= active;
    let dynamic = problem.moves_dynamics();
    for (index, record) in problem.records.iter().enumerate() {
        let has_force = record.has_force();
        for stepper in steppers.iter_mut() {
            stepper.begin(record.sample_period, has_force, dynamic && (index == 0 || shared));
        }
        let mut walks: [Walk<T>; GENES] = core::array::from_fn(|gene| Walk::new(&neighbours[gene], record));
        let mut walk = Walk::new(&base, record);
        let mut followers: [Option<Follower<T>>; GENES] =
            walks.each_ref().map(|walk| Some(Follower::of(&walk.actuator().model, record.sample_period)));
        for (gene, follower) in followers.iter_mut().enumerate() {
            if !problem.is_output(gene) {
                *follower = None;
            }
        }
        let mut level = record.offset_unknown.then(Level::<T, GENES>::new);
        loop {
            let mut chunk = Chunk::<T, GENES>::new();
            chunk.fill_base(record, &mut walk, select(steppers, 0, shared), &mut followers);
            if chunk.filled == 0 {
                break;
            }
            for (gene, walk) in walks.iter_mut().enumerate().take(active) {
                if problem.is_output(gene) {
                    continue;
                }
                let stepper = select(steppers, gene + 1, shared);
                if shared {
                    stepper.begin(record.sample_period, has_force, dynamic);
                }
                chunk.fill_neighbour(record, walk, stepper, gene);
            }
            if shared {
                select(steppers, 0, shared).begin(record.sample_period, has_force, dynamic);
            }
            chunk.accumulate(&mut normal, level.as_mut(), &widths, active);
        }
        if let Some(level) = level {
            level.remove_from(&mut normal, active);
        }
    }
    normal
}

/// What an unknown offset takes away of normal equations: the means of a record's user position.
struct Level<T, const GENES: usize> {
    residual: Offset<T>,
    /// Slope of the residual along each gene, summed.
    slope: [T; GENES],
}

impl<T: Real + RealField, const GENES: usize> Level<T, GENES> {
    const fn new() -> Self {
        Self { residual: Offset::NONE, slope: [T::ZERO; GENES] }
    }

    fn add(&mut self, residual: T, slope: &[T; GENES]) {
        self.residual.add(residual);
        for (sum, &slope) in self.slope.iter_mut().zip(slope) {
            *sum += slope;
        }
    }

    fn remove_from(&self, normal: &mut Normal<T, GENES>, active: usize) {
        normal.misfit.chi_square -= self.residual.square();
        for row in 0..active {
            normal.gradient[row] -= self.slope[row] * self.residual.mean();
            for column in 0..active {
                normal.curvature[(row, column)] -=
                    self.slope[row] * self.residual.mean_of(self.slope[column]);
            }
        }
    }
}

fn select<S>(steppers: &mut [S], model: usize, shared: bool) -> &mut S {
    let index = if shared { 0 } else { model };
    &mut steppers[index]
}

/// Residuals of one sample, channel by channel.
#[derive(Clone, Copy)]
struct Residuals<T, const GENES: usize> {
    /// Of the base model, and whether the channel is compared.
    base: [(T, bool); MEASURED],
    /// Of its neighbours.
    neighbours: [[T; GENES]; MEASURED],
}

impl<T: Real, const GENES: usize> Residuals<T, GENES> {
    /// Notes what a gene's neighbour predicts.
    fn compare(&mut self, compared: &Compared<'_, T>, sample: usize, gene: usize, outputs: &Outputs<T>) {
        let residuals = compared.residuals(sample, outputs);
        for (neighbours, (residual, _)) in self.neighbours.iter_mut().zip(residuals) {
            if let Some(neighbour) = neighbours.get_mut(gene) {
                *neighbour = residual;
            }
        }
    }
}

/// Residuals of a few samples.
struct Chunk<T, const GENES: usize> {
    filled: usize,
    samples: [Residuals<T, GENES>; CHUNK],
}

impl<T: Real + RealField, const GENES: usize> Chunk<T, GENES> {
    const fn new() -> Self {
        let none = Residuals { base: [(T::ZERO, false); MEASURED], neighbours: [[T::ZERO; GENES]; MEASURED] };
        Self { filled: 0, samples: [none; CHUNK] }
    }

    fn fill_base<S: Stepper<T>>(
        &mut self,
        record: &Record<'_, T>,
        walk: &mut Walk<T>,
        stepper: &mut S,
        followers: &mut [Option<Follower<T>>; GENES],
    ) {
        let compared = record.compared();
        let (mut places, mut filled) = (self.samples.iter_mut(), 0);
        walk.lead_on(record, stepper, followers, CHUNK, |sample, outputs, followers| {
            let Some(place) = places.next() else { return };
            for (gene, follower) in followers.iter_mut().enumerate() {
                if let Some(follower) = follower {
                    let user = follower.shown();
                    place.compare(&compared, sample, gene, &Outputs { user, ..*outputs });
                }
            }
            if record.is_compared(sample) {
                place.base = compared.residuals(sample, outputs);
            }
            filled += 1;
        });
        self.filled = filled;
    }

    fn fill_neighbour<S: Stepper<T>>(
        &mut self,
        record: &Record<'_, T>,
        walk: &mut Walk<T>,
        stepper: &mut S,
        gene: usize,
    ) {
        let compared = record.compared();
        let mut places = self.samples.iter_mut();
        walk.lead_on(record, stepper, &mut [], self.filled, |sample, outputs, _| {
            if let Some(place) = places.next() {
                place.compare(&compared, sample, gene, outputs);
            }
        });
    }

    fn accumulate(
        &self,
        normal: &mut Normal<T, GENES>,
        mut level: Option<&mut Level<T, GENES>>,
        widths: &[T; GENES],
        active: usize,
    ) {
        for place in self.samples.iter().take(self.filled) {
            for (channel, (&(residual, used), neighbours)) in
                place.base.iter().zip(&place.neighbours).enumerate()
            {
                if !used {
                    continue;
                }
                normal.misfit.chi_square += residual * residual;
                normal.misfit.count += 1;
                let slope: [T; GENES] = core::array::from_fn(|gene| {
                    if gene < active { (residual - neighbours[gene]) / widths[gene] } else { T::ZERO }
                });
                if channel == Offset::<T>::CHANNEL
                    && let Some(level) = &mut level
                {
                    level.add(residual, &slope);
                }
                for row in 0..active {
                    normal.gradient[row] += slope[row] * residual;
                    for column in 0..=row {
                        normal.curvature[(row, column)] += slope[row] * slope[column];
                    }
                }
            }
        }
        for row in 0..active {
            for column in 0..row {
                normal.curvature[(column, row)] = normal.curvature[(row, column)];
            }
        }
    }
}

impl<T: Real + RealField, const GENES: usize> Normal<T, GENES> {
    /// A damped step that stays in the box `[0, 1]`, and the fall of chi-square that it promises.
    fn step(&self, genes: &[T; GENES], damping: T, active: usize) -> Option<([T; GENES], T)> {
        // The gene that the step would push through a bound first goes to the bound, and the rest is solved again around
        // it: cutting it off alone would leave the valley that strongly correlated genes lie in, and holding all that
        // are pushed through would hold some that only follow the first.
        let mut held: [Option<T>; GENES] = [None; GENES];
        for _ in 0..=active {
            let mut matrix = self.curvature;
            let mut side = self.gradient;
            for gene in 0..GENES {
                matrix[(gene, gene)] *= T::ONE + damping;
            }
            for gene in 0..GENES {
                let silent = matrix[(gene, gene)] <= T::ZERO;
                if let Some(change) = held[gene].or(if silent { Some(T::ZERO) } else { None }) {
                    for other in 0..GENES {
                        side[other] -= matrix[(other, gene)] * change;
                    }
                    isolate(&mut matrix, gene);
                    side[gene] = change;
                }
            }
            let change = matrix.cholesky()?.solve(&side);
            let mut first: Option<(usize, T, T)> = None;
            for gene in 0..GENES {
                let value = genes[gene] + change[gene];
                if held[gene].is_none() && (value < T::ZERO || value > T::ONE) {
                    let way = if value < T::ZERO { -genes[gene] } else { T::ONE - genes[gene] };
                    let share = way / change[gene];
                    if first.is_none_or(|(_, _, earliest)| share < earliest) {
                        first = Some((gene, way, share));
                    }
                }
            }
            if let Some((gene, way, _)) = first {
                held[gene] = Some(way);
                continue;
            }
            let mut moved = *genes;
            let mut actual = change;
            for gene in 0..GENES {
                moved[gene] = (genes[gene] + change[gene]).larger(T::ZERO).smaller(T::ONE);
                actual[gene] = moved[gene] - genes[gene];
            }
            let two = T::ONE + T::ONE;
            let promised = two * self.gradient.dot(&actual) - (self.curvature * actual).dot(&actual);
            return Some((moved, promised));
        }
        None
    }

    /// Where the linear model puts the bottom, from `genes`, and the chi-square that it promises there.
    pub fn foreseen(&self, genes: &[T; GENES], active: usize) -> Option<([T; GENES], T)> {
        let (there, promised) = self.step(genes, T::literal(1e-6), active)?;
        Some((there, self.misfit.chi_square - promised))
    }

    /// Covariance of the genes for residuals whose noise is white and known: `(J^T J)^-1`. A gene that moves chi-square by
    /// next to nothing over all of its range has an infinite variance, and shares nothing with the others.
    pub fn covariance(&self) -> Option<SMatrix<T, GENES, GENES>> {
        let mut told = self.curvature;
        let is_silent = |gene: &usize| self.curvature[(*gene, *gene)] < T::literal(UNTOLD);
        for gene in (0..GENES).filter(is_silent) {
            isolate(&mut told, gene);
        }
        let mut covariance = told.cholesky()?.inverse();
        for gene in (0..GENES).filter(is_silent) {
            covariance[(gene, gene)] = T::ONE / T::ZERO;
        }
        Some(covariance)
    }

    /// Standard error of each gene, in genes: the roots of the [covariance](Self::covariance)'s diagonal.
    pub fn standard_errors(&self) -> Option<[T; GENES]> {
        let variances = self.covariance()?.diagonal();
        Some(variances.data.0[0].map(Real::root))
    }
}

/// Takes a gene out of equations with the others.
fn isolate<T: Real + RealField, const GENES: usize>(matrix: &mut SMatrix<T, GENES, GENES>, gene: usize) {
    for other in 0..GENES {
        matrix[(gene, other)] = T::ZERO;
        matrix[(other, gene)] = T::ZERO;
    }
    matrix[(gene, gene)] = T::ONE;
}

/// The damping of a shorter step, closer to the gradient.
fn shorter<T: Real>(damping: T) -> T {
    damping.larger(T::literal(1e-3)) * T::literal(10.0)
}

/// Goes from `genes` to the bottom of the basin (Levenberg-Marquardt).
pub fn finish<T, S, const GENES: usize>(
    problem: &Problem<'_, T>,
    genes: &[T; GENES],
    settings: &Settings<T>,
    steppers: &mut [S],
) -> Finish<T, GENES>
where
    T: Real + RealField,
    S: Stepper<T>,
{
    let active = problem.free.len().min(GENES);
    let cost_of_normal = 1 + (0..active).filter(|&gene| !problem.is_output(gene)).count() as u32;
    let mut here = *genes;
    let mut normal = normal_equations(problem, &here, settings.difference, steppers);
    let mut evaluations = cost_of_normal;
    let mut damping = T::literal(1e-4);
    let mut ending = Ending::Steps;
    // Where the model bends more than its slopes say, step after step leads uphill: after the first of them, a place is
    // looked at before its slopes are taken.
    let mut is_wary = false;
    'steps: for _ in 0..settings.steps {
        let left = normal.misfit;
        for attempt in 1..=ATTEMPTS {
            let Some((moved, promised)) = normal.step(&here, damping, active) else {
                damping *= T::literal(100.0);
                continue;
            };
            if promised < T::ZERO {
                // The way around the bounds leads uphill: closer to the gradient it does not.
                damping = shorter(damping);
                continue;
            }
            if promised <= settings.tolerance * left.mean_square().larger(T::ONE) {
                ending = Ending::Bottom;
                break 'steps;
            }
            let is_lower = |there: Misfit<T>| there.chi_square < left.chi_square;
            let mut look = || problem.misfit_within(&moved, select(steppers, 0, true), left.chi_square);
            evaluations += u32::from(is_wary);
            if !is_wary || is_lower(look()) {
                let next = normal_equations(problem, &moved, settings.difference, steppers);
                evaluations += cost_of_normal;
                if is_lower(next.misfit) {
                    here = moved;
                    normal = next;
                    damping *= T::literal(0.1);
                    continue 'steps;
                }
            }
            is_wary = true;
            damping = shorter(damping);
            if attempt == ATTEMPTS {
                ending = Ending::Stuck;
                break 'steps;
            }
        }
    }
    Finish { genes: here, normal, evaluations, ending }
}
