//! The cost over two faults.

use crate::fit::engine::{FIT_TOLERANCE, Job, on_records};
use crate::fit::{self, Fit, Prepared};
use crate::rig::{Range, Rig};
use eha_monitor::fit::problem::Problem;
use eha_monitor::integrate::Stepper;
use rayon::prelude::*;

/// Samples that a surface may simulate where the model is affine, and where it is not, which is several times slower.
const AFFINE_SAMPLES: usize = 2_000_000;
const CURVED_SAMPLES: usize = 400_000;
/// How many times as many the coarsest surface may take before it is left out.
const TOO_LONG: usize = 4;
/// Cells along a side, at least and at most.
const CELLS: [usize; 2] = [9, 41];

/// Cost over two parameters, the others as they were fitted.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    /// Edges of the cells along the first parameter, in its unit.
    pub(super) columns: Vec<f64>,
    /// Edges along the second.
    pub(super) rows: Vec<f64>,
    /// Sum of the squares in units of the noise, in the middle of each cell, by rows.
    pub(super) chi_square: Vec<Vec<f64>>,
    /// Terms of that sum.
    pub(super) count: u32,
}

impl Surface {
    /// The surface over two ranges around a fit; none where it would take too long.
    pub(super) fn over(ranges: [Range; 2], rig: &Rig, fit: &Fit, records: &[Prepared]) -> Option<Self> {
        let rig = fit.applied(rig);
        let samples: usize = records.iter().map(Prepared::len).sum();
        let most = if fit::is_affine(&rig, &ranges) { AFFINE_SAMPLES } else { CURVED_SAMPLES };
        let side = ((most as f64 / samples.max(1) as f64).sqrt() as usize).clamp(CELLS[0], CELLS[1]);
        if side * side * samples > TOO_LONG * most {
            return None;
        }
        let rows: Vec<Vec<(f64, u32)>> = (0..side)
            .into_par_iter()
            .map(|row| on_records(&rig, &ranges, records, FIT_TOLERANCE, Line { row, side }))
            .collect();
        let edges = |range: &Range| -> Vec<f64> {
            (0..=side).map(|k| range.lower + (range.upper - range.lower) * k as f64 / side as f64).collect()
        };
        Some(Self {
            columns: edges(&ranges[0]),
            rows: edges(&ranges[1]),
            count: rows[0][0].1,
            chi_square: rows.into_iter().map(|row| row.into_iter().map(|cell| cell.0).collect()).collect(),
        })
    }

    /// Smallest and largest finite value.
    pub(super) fn extent(&self) -> [f64; 2] {
        let finite = || self.chi_square.iter().flatten().copied().filter(|value| value.is_finite());
        [finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max)]
    }
}

/// One row of a surface.
struct Line {
    row: usize,
    side: usize,
}

impl Job for Line {
    type Output = Vec<(f64, u32)>;

    fn run<S: Stepper<f64>>(self, problem: &Problem<'_, f64>, steppers: &mut [S]) -> Self::Output {
        let middle = |index: usize| (index as f64 + 0.5) / self.side as f64;
        (0..self.side)
            .map(|column| {
                let misfit = problem.misfit(&[middle(column), middle(self.row)], &mut steppers[0]);
                (misfit.chi_square, misfit.count)
            })
            .collect()
    }
}
