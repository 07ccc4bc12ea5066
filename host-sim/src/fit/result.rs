//! The result of a fit.

use super::engine::{self, FIT_TOLERANCE, Job, on_records};
use super::estimate::{Estimate, estimates};
use super::{Correlation, Polished, Prepared, Valley, Visit};
use super::{most_likely, noise, polish, systematic};
use crate::interrupt;
use crate::rig::{Calibration, Range, Rig};
use eha_monitor::channel::Channel;
use eha_monitor::fit::identify::StopReason;
use eha_monitor::fit::problem::{Misfit, Problem};
use eha_monitor::integrate::Stepper;
use eha_monitor::model::state::Outputs;
use eha_monitor::parameter::{Parameter, Parameters};

/// The result of a fit.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The free parameters.
    pub estimates: Vec<Estimate>,
    /// Covariance of the estimates, as far as it comes from noise.
    pub covariance: Vec<Vec<f64>>,
    /// All parameters, fitted ones included.
    pub parameters: Parameters<f64>,
    /// Misfit in units of the noise.
    pub misfit: Misfit<f64>,
    /// Root mean square of the residual of each measured channel, in its unit; none where no record has it.
    pub residual_rms: [Option<f64>; Channel::MEASURED.len()],
    /// What the fitted model predicts, sample by sample, for each record.
    pub predictions: Vec<Vec<Outputs<f64>>>,
    /// Noise that was assumed for each measured channel, rms over the records; not finite where it is not used.
    pub noise: [f64; Channel::MEASURED.len()],
    /// Evaluations of the model.
    pub evaluations: u32,
    /// Generations of the genetic algorithm.
    pub generations: u32,
    /// Duration of the whole fit, s.
    pub seconds: f64,
    /// Duration of a generation, s.
    pub seconds_per_generation: f64,
    /// Why the search ended.
    pub stop: StopReason,
    /// Did the user end the search before its end?
    pub interrupted: bool,
    /// Every child and every finish of the search, in their order; of all searches, where several readings of the records
    /// were tried.
    pub visits: Vec<Visit>,
    /// Which reading of the records it is, of those that were searched.
    pub reading: usize,
    /// What the covariance of white noise was multiplied by, because the residual is not noise.
    pub inflation: f64,
}

impl Fit {
    /// The rig with the parameters of the fit.
    pub fn applied(&self, rig: &Rig) -> Rig {
        Rig { parameters: self.parameters, ..rig.clone() }
    }

    /// The estimate of a parameter.
    pub fn estimate(&self, parameter: Parameter) -> Option<&Estimate> {
        self.estimates.iter().find(|estimate| estimate.parameter == parameter)
    }

    /// How the estimates hang together.
    pub fn correlation(&self) -> Correlation {
        Correlation::new(self.estimates.iter().map(|estimate| estimate.parameter), &self.covariance)
    }

    /// The fit at the bottom of its valley, and with the intervals that this leaves open, where it leaves noise. Where the
    /// user ends that early, the intervals are those of the part of the valley that was seen.
    pub(super) fn settled(self, rig: &Rig, ranges: &[Range], records: &[Prepared]) -> Self {
        if self.stop != StopReason::NoiseReached {
            return self;
        }
        let valley = Valley::around(rig, ranges, &self.polished(), records, ranges.len());
        let bottom = &valley.bottom;
        let mut settled = if bottom.misfit == self.misfit {
            self
        } else {
            on_records(rig, ranges, records, FIT_TOLERANCE, Moved { fit: self, there: bottom })
        };
        valley.widen(&mut settled.estimates);
        settled.evaluations += valley.evaluations;
        settled.interrupted |= interrupt::requested();
        settled
    }

    /// The fit at its most likely values, where it leaves noise and a sensor is read in steps. What its intervals hold besides
    /// those of the curvature, they hold still.
    #[must_use]
    pub fn likeliest(self, rig: &Rig, ranges: &[Range], records: &[Prepared]) -> Self {
        if self.stop != StopReason::NoiseReached {
            return self;
        }
        let Some(likeliest) = most_likely(rig, ranges, &self.polished(), records) else { return self };
        let before = self.estimates.clone();
        let mut moved =
            on_records(rig, ranges, records, FIT_TOLERANCE, Moved { fit: self, there: &likeliest });
        for ((estimate, before), range) in moved.estimates.iter_mut().zip(&before).zip(ranges) {
            let by_curvature = Estimate::new(range, before.value, before.standard_error);
            estimate.hold_beyond(before.ci95, by_curvature.ci95);
        }
        moved
    }

    /// The rig with the values of the fit, and how well they are known.
    pub fn calibrated(&self, rig: &Rig) -> Rig {
        let calibration = Calibration::of(&self.estimates, &self.correlation());
        Rig { calibration: calibration.after(&rig.calibration), ..self.applied(rig) }
    }

    /// What a fit without a search would have given there: the covariance that white noise would make.
    pub fn polished(&self) -> Polished {
        let of_white = |row: &Vec<f64>| row.iter().map(|entry| entry / self.inflation).collect();
        Polished {
            values: self.estimates.iter().map(|estimate| estimate.value).collect(),
            misfit: self.misfit,
            covariance: self.covariance.iter().map(of_white).collect(),
            evaluations: self.evaluations,
        }
    }

    /// Widens the intervals to hold those of another fit, which may be right as well; does one grow by more than its
    /// standard error?
    pub(super) fn hold(&mut self, other: &Self) -> bool {
        let mut grows = false;
        for (own, other) in self.estimates.iter_mut().zip(&other.estimates) {
            let before = own.ci95;
            own.hold(other);
            let growth = (before[0] - own.ci95[0]).max(own.ci95[1] - before[1]);
            grows |= growth > own.standard_error;
        }
        grows
    }

    /// Root mean square of the residual of the user position, m.
    pub fn position_rms(&self) -> f64 {
        self.residual_rms[0].unwrap_or(f64::NAN)
    }
}

/// A fit that leaves noise, moved to another place of its valley.
struct Moved<'a> {
    fit: Fit,
    there: &'a Polished,
}

impl Job for Moved<'_> {
    type Output = Fit;

    fn run<S: Stepper<f64>>(self, problem: &Problem<'_, f64>, steppers: &mut [S]) -> Fit {
        let Polished { values, misfit, covariance, .. } = self.there;
        let genes = polish::genes_of(problem, values);
        let of_genes = systematic::covariance_of_genes(problem, covariance);
        let systematic = systematic::of_genes(problem, &genes, &of_genes, steppers);
        let predictions = engine::trace(problem, &genes, &mut steppers[0]);
        Fit {
            estimates: estimates(problem, &genes, covariance, &systematic),
            covariance: covariance.clone(),
            parameters: problem.parameters_of(&genes),
            misfit: *misfit,
            residual_rms: noise::residual_rms(problem.records, &predictions),
            predictions,
            ..self.fit
        }
    }
}
