//! A fit from given starts, without a global search: for a model that differs little from one that is fitted.

use super::engine::{FIT_TOLERANCE, Job, LOOK_TOLERANCE, on_records};
use super::{MAX_FREE, Prepared};
use crate::rig::{Range, Rig};
use eha_monitor::fit::gauss_newton::{Normal, Settings, finish, normal_equations};
use eha_monitor::fit::problem::{Misfit, Problem};
use eha_monitor::integrate::Stepper;
use nalgebra::{DMatrix, SMatrix};

/// The result of a polish.
#[derive(Clone, Debug)]
pub struct Polished {
    /// Value of each range's parameter.
    pub values: Vec<f64>,
    /// Misfit there.
    pub misfit: Misfit<f64>,
    /// Covariance of the values for white noise; not finite where the records say nothing.
    pub covariance: Vec<Vec<f64>>,
    /// Evaluations of the model that led there.
    pub evaluations: u32,
}

impl Polished {
    /// Standard error of a value for white noise.
    pub fn standard_error(&self, index: usize) -> f64 {
        self.covariance[index][index].sqrt()
    }

    /// Standard error of the first of some values for white noise, where the others are what they are.
    ///
    /// # Panics
    ///
    /// Without any value.
    pub fn standard_error_beside(&self, indices: &[usize]) -> f64 {
        let first = self.standard_error(indices[0]);
        if !first.is_finite() {
            return first;
        }
        // One of which the records say nothing has no part in it.
        let told: Vec<usize> =
            indices.iter().copied().filter(|&index| self.standard_error(index).is_finite()).collect();
        let shared = |row: usize, column: usize| self.covariance[told[row]][told[column]];
        let known = DMatrix::from_fn(told.len(), told.len(), shared).try_inverse();
        known.map_or(first, |known| known[(0, 0)].recip().sqrt())
    }

    /// The rig with the values in it.
    pub fn applied(&self, rig: &Rig, ranges: &[Range]) -> Rig {
        rig.with_values(ranges, &self.values)
    }
}

/// A step is made if it promises to lower chi-square by this much, in units of the mean square that is left.
const WORTH_A_STEP: f64 = 0.05;
/// Widest forward difference, in standard errors of the parameter: what is found with a wider one is fitted again in a
/// narrower range. An effect can be a ten-thousandth of the range in which it is looked for.
const WIDEST_DIFFERENCE: f64 = 0.5;
/// Half width of that range, in standard errors.
const NARROW: f64 = 100.0;
/// Most narrower ranges, one around what the last one gave: a record whose command amplifies an error that was within
/// the interval of the others may ask for a long way in its own.
const MOST_NARROWED: usize = 8;

/// Some steps towards the bottom of the basin, with the tolerance of a look.
pub fn approach(
    rig: &Rig,
    ranges: &[Range],
    start: &[f64],
    records: &[Prepared],
    steps: u32,
) -> Option<Polished> {
    on_records(rig, ranges, records, LOOK_TOLERANCE, Polish { start, steps })
}

/// Goes to the bottom of the basin; none where the records hold nothing to compare.
pub fn polish(rig: &Rig, ranges: &[Range], start: &[f64], records: &[Prepared]) -> Option<Polished> {
    let settings = Settings::<f64>::default();
    let go = |ranges: &[Range], start: &[f64]| {
        on_records(rig, ranges, records, FIT_TOLERANCE, Polish { start, steps: settings.steps })
    };
    let mut found = go(ranges, start)?;
    for _ in 0..MOST_NARROWED {
        let narrow: Vec<Range> =
            ranges.iter().enumerate().map(|(index, range)| narrowed(*range, &found, index)).collect();
        if narrow == ranges {
            break;
        }
        let before = found.evaluations;
        found = go(&narrow, &found.values)?;
        found.evaluations += before;
        let at_an_edge = ranges.iter().zip(&narrow).zip(&found.values).any(|((range, narrow), value)| {
            let [below, above] = narrow.at_edge(*value);
            (below && narrow.lower > range.lower) || (above && narrow.upper < range.upper)
        });
        if !at_an_edge {
            break;
        }
    }
    Some(found)
}

/// A range in which the forward difference of a fit is small against the error of what was found.
fn narrowed(range: Range, found: &Polished, index: usize) -> Range {
    let value = found.values[index];
    let error = found.standard_error(index) * found.misfit.mean_square().max(1.0).sqrt();
    let difference = Settings::<f64>::default().difference * (range.upper - range.lower);
    if error > 0.0 && difference > WIDEST_DIFFERENCE * error {
        let (lower, upper) = (value - NARROW * error, value + NARROW * error);
        Range { lower: lower.max(range.lower), upper: upper.min(range.upper), ..range }
    } else {
        range
    }
}

/// What the linear model at a start foresees, without going there: one evaluation of the normal equations. None where
/// the records say nothing about a parameter there.
pub fn foresee(rig: &Rig, ranges: &[Range], start: &[f64], records: &[Prepared]) -> Option<Polished> {
    on_records(rig, ranges, records, LOOK_TOLERANCE, Foresee { start })
}

/// The misfit of some values.
pub fn misfit(rig: &Rig, ranges: &[Range], values: &[f64], records: &[Prepared]) -> Misfit<f64> {
    misfit_within(rig, ranges, values, records, f64::INFINITY)
}

/// The misfit of some values, given up as soon as chi-square is above a bound: what has been summed by then.
pub fn misfit_within(
    rig: &Rig,
    ranges: &[Range],
    values: &[f64],
    records: &[Prepared],
    bound: f64,
) -> Misfit<f64> {
    on_records(rig, ranges, records, FIT_TOLERANCE, There { values, bound })
}

type Genes = [f64; MAX_FREE];

pub(super) fn genes_of(problem: &Problem<'_, f64>, values: &[f64]) -> Genes {
    std::array::from_fn(|gene| {
        problem.free.get(gene).zip(values.get(gene)).map_or(0.0, |(free, &value)| free.gene(value))
    })
}

/// By what part of it the curvature is stiffened where some parameters make up for each other wholly: the error of each is
/// then some ten thousand times what it would be were the others known, and that of the rest as it is.
const STIFFENING: f64 = 1e-9;

/// Covariance of the genes for white noise; not finite where the records say nothing.
pub(super) fn covariance_of(normal: &Normal<f64, MAX_FREE>) -> SMatrix<f64, MAX_FREE, MAX_FREE> {
    let stiffened = || {
        let mut normal = *normal;
        for gene in 0..MAX_FREE {
            normal.curvature[(gene, gene)] *= 1.0 + STIFFENING;
        }
        normal.covariance()
    };
    normal.covariance().or_else(stiffened).unwrap_or_else(|| SMatrix::from_element(f64::NAN))
}

fn polished(
    problem: &Problem<'_, f64>,
    genes: &Genes,
    normal: &Normal<f64, MAX_FREE>,
    misfit: Misfit<f64>,
    evaluations: u32,
) -> Polished {
    let covariance = covariance_of(normal);
    let count = problem.free.len();
    let entry = |row: usize, column: usize| {
        let scale = problem.free[row].range() * problem.free[column].range();
        covariance[(row, column)] * scale
    };
    Polished {
        values: problem.free.iter().zip(genes).map(|(free, &gene)| free.value(gene)).collect(),
        misfit,
        covariance: (0..count).map(|row| (0..count).map(|column| entry(row, column)).collect()).collect(),
        evaluations,
    }
}

struct There<'a> {
    values: &'a [f64],
    bound: f64,
}

impl Job for There<'_> {
    type Output = Misfit<f64>;

    fn run<S: Stepper<f64>>(self, problem: &Problem<'_, f64>, steppers: &mut [S]) -> Misfit<f64> {
        problem.misfit_within(&genes_of(problem, self.values), &mut steppers[0], self.bound)
    }
}

struct Foresee<'a> {
    start: &'a [f64],
}

impl Job for Foresee<'_> {
    type Output = Option<Polished>;

    fn run<S: Stepper<f64>>(self, problem: &Problem<'_, f64>, steppers: &mut [S]) -> Self::Output {
        let count = problem.free.len();
        let genes = genes_of(problem, self.start);
        let normal = normal_equations(problem, &genes, Settings::default().difference, steppers);
        let (there, chi_square) = normal.foreseen(&genes, count)?;
        let misfit = Misfit { chi_square, count: normal.misfit.count };
        Some(polished(problem, &there, &normal, misfit, 1 + count as u32))
    }
}

struct Polish<'a> {
    start: &'a [f64],
    /// Most steps.
    steps: u32,
}

impl Job for Polish<'_> {
    type Output = Option<Polished>;

    fn run<S: Stepper<f64>>(self, problem: &Problem<'_, f64>, steppers: &mut [S]) -> Self::Output {
        let genes = genes_of(problem, self.start);
        let settings = Settings { tolerance: WORTH_A_STEP, steps: self.steps, ..Settings::default() };
        let found = finish(problem, &genes, &settings, steppers);
        let misfit = found.normal.misfit;
        (misfit.count > 0).then(|| polished(problem, &found.genes, &found.normal, misfit, found.evaluations))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_trades_off_with_a_value_does_not_widen_its_error_beside_it() {
        // A size of 2 that a scale makes up for: each is told badly, the size at that scale ten times better.
        let (size, scale, correlation) = (1.5_f64, 3.0_f64, 0.995_f64);
        let shared = correlation * size * scale;
        let polished = Polished {
            values: vec![0.0, 2.0, 1.0],
            misfit: Misfit { chi_square: 1.0, count: 1 },
            covariance: vec![
                vec![4.0, 0.0, 0.0],
                vec![0.0, size * size, shared],
                vec![0.0, shared, scale * scale],
            ],
            evaluations: 0,
        };
        let beside = polished.standard_error_beside(&[1, 2]);
        assert!((beside - size * (1.0 - correlation * correlation).sqrt()).abs() < 1e-9, "{beside}");
        assert!(beside < 0.11 * polished.standard_error(1), "{beside}");
        assert!((polished.standard_error_beside(&[1]) - size).abs() < 1e-12);
        // What the records say nothing of has no part in it.
        let mut silent = polished.clone();
        silent.covariance[0] = vec![f64::INFINITY, 0.0, 0.0];
        assert!((silent.standard_error_beside(&[1, 2, 0]) - beside).abs() < 1e-12);
        assert!(silent.standard_error_beside(&[0, 1]).is_infinite());
        // What is told independently widens nothing either way.
        assert!((polished.standard_error_beside(&[1, 0]) - size).abs() < 1e-12);
    }
}
