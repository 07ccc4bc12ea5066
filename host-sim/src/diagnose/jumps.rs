//! Commands that jump between two samples of their record.
//!
//! The record of a step shows after which sample it came, not when; what half a millisecond does to the answer of an
//! actuator is ten times the noise of a good sensor. So the time of each jump is one more unknown. It is found from the
//! answer to the jump, until the next one comes, in turn with what else is free.

use super::Case;
use super::hypothesis::Hypothesis;
use super::residual::MEASURED;
use crate::fit::{self, Prepared};
use eha_monitor::model::state::Outputs;
use std::iter;
use std::ops::Range;

/// Where a jump is looked for at first, as a share of the sample before it.
const AT_FIRST: f64 = 0.5;
/// Largest share: a jump that came a whole sample earlier would show there.
const LARGEST: f64 = 0.999;
/// Share by which a jump is moved to see what its time changes.
const MOVE: f64 = 0.02;
/// Time after a jump for which the answer to it is left out at first, s: where friction then holds the actuator depends on
/// the time of the jump, and would be put down to the friction.
const ANSWER_S: f64 = 0.5;
/// Most of the fitted records that is left out.
const MOST_LEFT_OUT: f64 = 0.75;
/// Most turns of times and model, and the fall of chi-square below which there are no more.
const MOST_TURNS: usize = 12;
const SETTLED: f64 = 0.1;
/// Least time between jumps in the mean, s: a command that goes in stairs is not of this kind.
const APART_S: f64 = 0.04;

/// The jumps of the commands of some records.
pub(super) struct Jumps {
    /// The samples that show them first, of each record.
    samples: Vec<Vec<usize>>,
}

/// A model and its records, the times of the jumps of their commands fitted to both.
pub(super) struct Timed {
    pub(super) records: Vec<Prepared>,
    pub(super) model: Hypothesis,
    /// The times, of each record, s after its first sample.
    pub(super) times: Vec<Vec<f64>>,
}

impl Jumps {
    /// The jumps of records whose commands are on a curve; none where no command jumps, or one does so all the time.
    pub(super) fn of(records: &[Prepared]) -> Option<Self> {
        let samples: Vec<Vec<usize>> = records.iter().map(Prepared::jumps).collect();
        let are_rare = |(jumps, record): (&Vec<usize>, &Prepared)| {
            jumps.len() as f64 * APART_S <= record.len() as f64 * record.sample_period
        };
        let has_any = samples.iter().any(|jumps| !jumps.is_empty());
        (has_any && iter::zip(&samples, records).all(are_rare)).then_some(Self { samples })
    }

    /// What their times cost beside a model.
    pub(super) fn price(&self, model: &Hypothesis, scale: f64) -> f64 {
        self.samples.iter().flatten().count() as f64 * model.price_of_parameter(scale)
    }

    /// Times the jumps of the records of a case in turn with a model, which is first fitted to what is not the answer to
    /// a jump.
    pub(super) fn timed(&self, case: &Case<'_>, fitted: impl Fn(&Case<'_>) -> Hypothesis) -> Timed {
        let with = |shares: &[Vec<f64>]| -> Vec<Prepared> {
            iter::zip(case.records, shares).map(|(record, shares)| record.with_jumps_ahead(shares)).collect()
        };
        let mut shares: Vec<Vec<f64>> =
            self.samples.iter().map(|jumps| vec![AT_FIRST; jumps.len()]).collect();
        let answers = self.samples[..case.fitted].iter().flatten().count() as f64 * ANSWER_S;
        let flown: f64 = case.train().iter().map(|record| record.len() as f64 * record.sample_period).sum();
        let left_out = if answers < MOST_LEFT_OUT * flown { ANSWER_S } else { 0.0 };
        let rest: Vec<Prepared> = iter::zip(case.records, &shares)
            .map(|(record, shares)| record.without_jumps(left_out).with_jumps_ahead(shares))
            .collect();
        let mut model = fitted(&Case { records: &rest, ..*case });
        let mut records = with(&shares);
        for _ in 0..MOST_TURNS {
            let before = model.joint.misfit.chi_square;
            let rig = model.joint.applied(&model.rig, &model.ranges);
            let moved: Vec<Vec<f64>> =
                shares.iter().map(|of| of.iter().map(|&share| share + inwards(share)).collect()).collect();
            let [here, there] = [&records, &with(&moved)].map(|records| fit::predict(&rig, records));
            self.turn(&mut shares, &records, [&here, &there]);
            records = with(&shares);
            model = model.refitted(&Case { records: &records, ..*case });
            if (before - model.joint.misfit.chi_square).abs() < SETTLED {
                break;
            }
        }
        let times = iter::zip(&self.samples, &shares).zip(case.records).map(|((jumps, shares), record)| {
            iter::zip(jumps, shares)
                .map(|(&jump, share)| (jump as f64 - share) * record.sample_period)
                .collect()
        });
        Timed { times: times.collect(), records, model }
    }

    /// Moves each jump to where the answer to it says that it is, as far as a straight line tells: between what is predicted
    /// with the jumps here, and there, a little inwards.
    fn turn(&self, shares: &mut [Vec<f64>], records: &[Prepared], [here, there]: [&[Vec<Outputs<f64>>]; 2]) {
        for (index, record) in records.iter().enumerate() {
            let jumps = &self.samples[index];
            let ends = jumps.iter().skip(1).copied().chain([record.len()]);
            for ((share, &jump), end) in shares[index].iter_mut().zip(jumps).zip(ends) {
                let by = inwards(*share) * times_shown(record, &here[index], &there[index], jump..end);
                *share = (*share + by).clamp(0.0, LARGEST);
            }
        }
    }
}

/// By how much a jump is moved to see what that changes: inwards.
fn inwards(share: f64) -> f64 {
    if share < AT_FIRST { MOVE } else { -MOVE }
}

/// How many times the change from one prediction of a record to another is what samples of it show.
fn times_shown(
    record: &Prepared,
    here: &[Outputs<f64>],
    there: &[Outputs<f64>],
    samples: Range<usize>,
) -> f64 {
    let (mut product, mut square) = (0.0, 0.0);
    for sample in samples.filter(|&sample| record.is_compared(sample)) {
        let [here, there] = [here, there].map(|outputs| outputs[sample].to_array());
        for channel in (0..MEASURED).filter(|&channel| record.noise[channel].is_finite()) {
            let change = (there[channel] - here[channel]) / record.noise[channel];
            let left = (record.measured(channel)[sample] - here[channel]) / record.noise[channel];
            if left.is_finite() {
                product += left * change;
                square += change * change;
            }
        }
    }
    if square > 0.0 { product / square } else { 0.0 }
}
