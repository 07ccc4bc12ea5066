//! Normal equations of a window, gathered sample by sample, with the mean of each channel taken out.
//!
//! The offset of each sensor is a free parameter that nobody asks for. Projecting it out leaves what changes within the
//! window: backlash and friction show where the motion turns back, and not as an offset that a sensor may have as well.

use crate::fit::gauss_newton::Normal;
use crate::fit::problem::Misfit;
use nalgebra::{SMatrix, SVector};

/// Channels that are compared: user position and current.
pub(super) const CHANNELS: usize = 2;

/// Sums over one channel, of residuals in units of the noise and of what the genes add to the prediction.
#[derive(Clone, Copy, Debug)]
struct Channel<const GENES: usize> {
    count: u32,
    /// Residual and slope of the first sample. Sums are of differences from them: in single precision the sums of what
    /// is nearly constant would otherwise leave their rounding behind as if it were information.
    first_residual: f32,
    first_slope: [f32; GENES],
    residual: f32,
    square: f32,
    /// Products of neighbours in time.
    lagged: f32,
    last: Option<f32>,
    slope: [f32; GENES],
    slope_residual: [f32; GENES],
    slope_slope: [[f32; GENES]; GENES],
}

impl<const GENES: usize> Channel<GENES> {
    const NONE: Self = Self {
        count: 0,
        first_residual: 0.0,
        first_slope: [0.0; GENES],
        residual: 0.0,
        square: 0.0,
        lagged: 0.0,
        last: None,
        slope: [0.0; GENES],
        slope_residual: [0.0; GENES],
        slope_slope: [[0.0; GENES]; GENES],
    };

    /// Mean of the differences from the first residual.
    fn mean(&self) -> f32 {
        if self.count == 0 { 0.0 } else { self.residual / self.count as f32 }
    }

    /// Sum of squares about the mean; infinite where a prediction was no number. (`max` would make zero of
    /// that.) Not inlined: three places would hold it.
    #[inline(never)]
    fn about_mean(&self) -> f32 {
        let square = self.square - self.residual * self.mean();
        if square.is_finite() { square.max(0.0) } else { f32::INFINITY }
    }
}

/// Sums over a window.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sums<const GENES: usize>([Channel<GENES>; CHANNELS]);

impl<const GENES: usize> Sums<GENES> {
    pub(super) const NONE: Self = Self([Channel::NONE; CHANNELS]);

    /// Adds a residual, and how the prediction changes with each gene.
    pub(super) fn add(&mut self, channel: usize, residual: Option<f32>, slope: &[f32; GENES]) {
        let Some(sums) = self.0.get_mut(channel) else { return };
        let Some(residual) = residual else {
            sums.last = None;
            return;
        };
        if sums.count == 0 {
            sums.first_residual = residual;
            sums.first_slope = *slope;
        }
        let residual = residual - sums.first_residual;
        let slope: [f32; GENES] = core::array::from_fn(|gene| slope[gene] - sums.first_slope[gene]);
        sums.count += 1;
        sums.residual += residual;
        sums.square += residual * residual;
        sums.lagged += residual * sums.last.unwrap_or(0.0);
        sums.last = Some(residual);
        for row in 0..GENES {
            sums.slope[row] += slope[row];
            sums.slope_residual[row] += slope[row] * residual;
            for column in 0..=row {
                sums.slope_slope[row][column] += slope[row] * slope[column];
            }
        }
    }

    /// Chi-square about the means, and how many terms it is worth.
    pub(super) fn misfit(&self) -> Misfit<f32> {
        let mut misfit = Misfit { chi_square: 0.0, count: 0 };
        for sums in &self.0 {
            misfit.chi_square += sums.about_mean();
            misfit.count += sums.count.saturating_sub(1);
        }
        misfit
    }

    /// The normal equations about the means.
    pub(super) fn normal(&self) -> Normal<f32, GENES> {
        let mut normal = Normal {
            misfit: self.misfit(),
            gradient: SVector::from_element(0.0),
            curvature: SMatrix::from_element(0.0),
        };
        for sums in self.0.iter().filter(|sums| sums.count > 0) {
            let mean = sums.mean();
            for row in 0..GENES {
                normal.gradient[row] += sums.slope_residual[row] - sums.slope[row] * mean;
                for column in 0..=row {
                    let product = sums.slope[row] * sums.slope[column] / sums.count as f32;
                    normal.curvature[(row, column)] += sums.slope_slope[row][column] - product;
                }
            }
        }
        for row in 0..GENES {
            for column in 0..row {
                normal.curvature[(column, row)] = normal.curvature[(row, column)];
            }
        }
        normal
    }

    /// Mean of a channel's residual, and its rms about it, in units of the noise.
    pub(super) fn residual(&self, channel: usize) -> (f32, f32) {
        self.0.get(channel).filter(|sums| sums.count > 0).map_or((0.0, 0.0), |sums| {
            (sums.first_residual + sums.mean(), libm::sqrtf(sums.about_mean() / sums.count as f32))
        })
    }

    /// By what the variance of an estimate is larger than white noise of the stated size makes it: the mean square times
    /// the correlation time, in samples, of the residual; not below 1.
    pub(super) fn inflation(&self) -> f32 {
        let (mut square, mut lagged, mut count) = (0.0, 0.0, 0);
        for sums in &self.0 {
            let mean = sums.mean();
            square += sums.about_mean();
            lagged += sums.lagged - sums.residual * mean;
            count += sums.count;
        }
        if count == 0 || square <= 0.0 {
            return 1.0;
        }
        let correlation = saturated(lagged / square);
        (square / count as f32 * (1.0 + correlation) / (1.0 - correlation)).max(1.0)
    }
}

/// A correlation between 0 and 0.95. (`clamp` can panic, as far as the compiler sees.)
fn saturated(correlation: f32) -> f32 {
    if correlation > 0.95 { 0.95 } else { correlation.max(0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::identify::within_noise;

    #[test]
    fn a_prediction_that_is_no_number_is_the_worst_and_not_the_best() {
        for wild in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30] {
            for place in [0, 50, 99] {
                let mut sums = Sums::<1>::NONE;
                for sample in 0..100 {
                    let residual = if sample == place { wild } else { 0.5 };
                    sums.add(0, Some(residual), &[1.0]);
                    sums.add(1, Some(0.5), &[1.0]);
                }
                let misfit = sums.misfit();
                assert_eq!(misfit.chi_square, f32::INFINITY, "{wild} at {place}");
                assert!(!within_noise(&misfit), "{wild} at {place}");
                assert_eq!(sums.residual(0).1, f32::INFINITY, "{wild} at {place}");
                assert!(sums.residual(1).1 < 1e-3, "{wild} at {place}");
                assert_eq!(sums.inflation(), f32::INFINITY, "{wild} at {place}");
            }
        }
    }
}
