//! Commands that jump between two samples of their record.
//!
//! The record of a step shows after which sample it came, not when; what half a millisecond does to the answer of an
//! actuator is ten times the noise of a good sensor. So the time of each jump is one more unknown. It is found from the
//! answer to the jump, together with what else is free.

use super::Case;
use super::hypothesis::{self, Hypothesis};
use super::residual;
use super::search::{GROWING_SHARE, Rival};
use crate::fit::{self, Polished, Prepared};
use crate::rig::{self, Rig};
use eha_monitor::fit::identify::within_noise;
use eha_monitor::model::state::Outputs;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::iter;
use std::slice;

/// Where a jump is looked for at first, as a share of the sample before it.
const AT_FIRST: f64 = 0.5;
/// Largest share: a jump that came a whole sample earlier would show there.
const LARGEST: f64 = 0.999;
/// Places in its sample at which a jump is looked for then.
const LOOKS: usize = 8;
/// Share by which a jump is moved to see what its time changes.
const MOVE: f64 = 0.02;
/// Time after a jump for which the answer to it is left out at first, s: where friction then holds the actuator depends on
/// the time of the jump, and would be put down to the friction.
const ANSWER_S: f64 = 0.5;
/// Most of the fitted records that is left out.
const MOST_LEFT_OUT: f64 = 0.75;
/// Most steps of times and model, and the fall of chi-square below which there are no more.
const MOST_STEPS: usize = 12;
const SETTLED: f64 = 0.1;
/// Width of the difference that shows what a value changes, in its standard errors.
const DIFFERENCE: f64 = 0.3;
/// What is known of a share before a record is seen, the inverse of its variance: it is as likely anywhere in its sample.
const KNOWN_BEFORE: f64 = 12.0;
/// Least time between jumps in the mean, s: a command that goes in stairs is not of this kind.
const APART_S: f64 = 0.04;

/// A jump of a command.
#[derive(Clone, Copy)]
struct Jump {
    /// The sample that shows it first.
    sample: usize,
    /// How far ahead of that it comes, as a share of the sample before.
    share: f64,
}

impl Jump {
    /// By how much it is moved to see what its time changes: inwards.
    fn step(self) -> f64 {
        if self.share < AT_FIRST { MOVE } else { -MOVE }
    }
}

/// The jumps of the commands of some records, those of each record.
#[derive(Clone)]
pub(super) struct Jumps(Vec<Vec<Jump>>);

/// A model and its records, the times of the jumps of their commands fitted to both.
#[derive(Clone)]
pub(super) struct Timed {
    pub(super) records: Vec<Prepared>,
    pub(super) model: Hypothesis,
    pub(super) jumps: Jumps,
}

impl Timed {
    /// Goes on to where the times and all that is free fit best together.
    pub(super) fn settled(mut self, case: &Case<'_>) -> Self {
        for _ in 0..MOST_STEPS {
            let Some((jumps, values)) = self.foreseen() else { break };
            let moved = jumps.with(case, |case| self.model.moved_from(values.clone(), case));
            let fall = self.model.joint.misfit.chi_square - moved.model.joint.misfit.chi_square;
            if fall > 0.0 {
                self = moved;
            }
            if fall < SETTLED {
                break;
            }
        }
        self
    }

    /// The jumps, and all that is free, where the linear model says that they are.
    fn foreseen(&self) -> Option<(Jumps, Vec<f64>)> {
        let Hypothesis { rig, ranges, joint, .. } = &self.model;
        let slopes = self.jumps.slopes(rig, ranges, joint, &self.records);
        let change = slopes.told().cholesky()?.solve(&-slopes.columns.tr_mul(&slopes.left));
        let mut jumps = self.jumps.clone();
        for (jump, change) in jumps.0.iter_mut().flatten().zip(change.iter().skip(ranges.len())) {
            jump.share = (jump.share + change).clamp(0.0, LARGEST);
        }
        let values = iter::zip(ranges, &joint.values)
            .zip(&change)
            .map(|((range, value), change)| (value + change).clamp(range.lower, range.upper))
            .collect();
        Some((jumps, values))
    }

    /// The case that is left: with the times known, and the model.
    pub(super) fn case<'a>(&'a self, case: &Case<'a>) -> Case<'a> {
        Case { records: &self.records, timed: Some(self), ..*case }
    }

    /// What the model costs, in units of what is left, and the times beside it; none where the records do not tell what is
    /// free.
    pub(super) fn cost(&self, scale: f64) -> Option<f64> {
        Some(self.model.cost(scale) + self.price()?)
    }

    /// The same as an explanation of the records of a case beside which others are looked for.
    pub(super) fn rival(&self, case: &Case<'_>) -> Option<Rival> {
        let (model, price) = (&self.model, self.price()?);
        let scale = model.scale();
        Some(Rival {
            scale,
            cost: model.cost(scale) + price,
            cost_of_fitted: model.cost_of_fitted(scale) + price,
            leaves_noise: model.leaves_noise(&self.case(case)),
            effects: model.added.len(),
        })
    }

    /// What the times must gain beside the model; none where the records do not tell what is free.
    pub(super) fn price(&self) -> Option<f64> {
        let Hypothesis { rig, ranges, joint, .. } = &self.model;
        self.jumps.cost(rig, ranges, joint, &self.records).map(|cost| cost.price)
    }
}

/// What a fit leaves, in units of the noise, and what each value that is free and then each time would change about it,
/// one a column.
struct Slopes {
    left: DVector<f64>,
    columns: DMatrix<f64>,
    /// How many are values.
    values: usize,
}

impl Slopes {
    /// What is known of all of them: the inverse of their covariance.
    fn told(&self) -> DMatrix<f64> {
        let mut told = self.columns.tr_mul(&self.columns);
        for time in self.values..told.nrows() {
            told[(time, time)] += KNOWN_BEFORE;
        }
        told
    }
}

/// What it means for a fit that the times of jumps are fitted as well.
pub(super) struct Cost {
    /// What the times must gain to be believed: twice the logarithm of the odds that they were somewhere else in their
    /// samples.
    pub(super) price: f64,
    /// Factor by which the standard error of each value is larger than at given times.
    pub(super) widening: Vec<f64>,
}

impl Jumps {
    /// The jumps of records whose commands are on a curve; none where no command jumps, or one does so all the time.
    pub(super) fn of(records: &[Prepared]) -> Option<Self> {
        let of_one = |record: &Prepared| -> Vec<Jump> {
            record.jumps().into_iter().map(|sample| Jump { sample, share: AT_FIRST }).collect()
        };
        let jumps: Vec<Vec<Jump>> = records.iter().map(of_one).collect();
        let are_rare =
            |(jumps, record): (&Vec<Jump>, &Prepared)| jumps.len() as f64 * APART_S <= record.duration();
        let has_any = jumps.iter().any(|jumps| !jumps.is_empty());
        (has_any && iter::zip(&jumps, records).all(are_rare)).then_some(Self(jumps))
    }

    /// When they come in each of their records, s after its first sample.
    pub(super) fn times(&self, records: &[Prepared]) -> Vec<Vec<f64>> {
        let of_one = |(jumps, record): (&Vec<Jump>, &Prepared)| {
            jumps.iter().map(|jump| (jump.sample as f64 - jump.share) * record.sample_period).collect()
        };
        iter::zip(&self.0, records).map(of_one).collect()
    }

    /// The records, their commands jumping at these times.
    fn in_records(&self, records: &[Prepared]) -> Vec<Prepared> {
        iter::zip(&self.0, records)
            .map(|(jumps, record)| {
                record.with_jumps_ahead(jumps.iter().map(|jump| (jump.sample, jump.share)))
            })
            .collect()
    }

    /// Fits the times of a case's jumps together with a model. Three kinds of starting points are compared, and the best is
    /// followed: all jumps equally late, at several places and with a fit at each; the times that suit the best of those
    /// fits; and the times that suit a fit to the samples outside the answers to jumps. `fitted` makes that last fit, and
    /// `moved` adapts it to other times.
    pub(super) fn timed(
        &self,
        case: &Case<'_>,
        fitted: impl Fn(&Case<'_>) -> Hypothesis,
        moved: impl Fn(&Hypothesis, &Case<'_>) -> Hypothesis + Sync,
    ) -> Timed {
        let answers = self.0[..case.fitted].iter().flatten().count() as f64 * ANSWER_S;
        let flown: f64 = case.train().iter().map(Prepared::duration).sum();
        let left_out = if answers < MOST_LEFT_OUT * flown { ANSWER_S } else { 0.0 };
        let rest: Vec<Prepared> = case.records.iter().map(|record| record.without_jumps(left_out)).collect();
        let without_answers = fitted(&Case { records: &self.in_records(&rest), ..*case });
        // All of them may be as late; or each may be, for itself.
        let places = self.places();
        let apart = |model: &Hypothesis| {
            self.each_at_best_of(&places, model, case).with(case, |case| model.refitted(case))
        };
        let at_place = |jumps: &Self| {
            let timed = jumps.clone().with(case, |case| moved(&without_answers, case));
            case.progress.fitted(Some(timed.model.train.misfit.mean_square().sqrt()));
            timed
        };
        case.progress.expect(places.len());
        let together: Vec<Timed> = places.par_iter().map(at_place).collect();
        let better = |best: Timed, other: Timed| {
            if hypothesis::lower(&other.model, &best.model).is_lt() { other } else { best }
        };
        let together = together.into_iter().reduce(better);
        let from_together = together.as_ref().map(|together| apart(&together.model));
        let looks = [together, from_together].into_iter().flatten();
        looks.fold(apart(&without_answers), better).settled(case)
    }

    /// Times them beside a model that was found in another reading of the records.
    pub(super) fn beside(&self, model: &Hypothesis, case: &Case<'_>) -> Timed {
        let rig = case.rig.with_spool_of(&model.rig);
        let moved = |_: &Hypothesis, case: &Case<'_>| model.moved_to(case);
        self.timed(&case.under(&rig), |case| model.refitted(case), moved)
    }

    /// May they be much of what a model leaves: do some of their times take a tenth of it away? `in_it` is the model in the
    /// reading of a case in which they jump.
    pub(super) fn may_explain(&self, in_it: &Hypothesis, case: &Case<'_>, model: &Hypothesis) -> bool {
        self.at_best_for(in_it, case).share_of(model) >= GROWING_SHARE
    }

    /// A model as it is, with each jump at the place that suits it best. Where it leaves noise of the fitted records, their
    /// values are taken: what fits the held-out ones as well makes up for the jumps.
    fn at_best_for(&self, model: &Hypothesis, case: &Case<'_>) -> Hypothesis {
        let of_fitted = within_noise(&model.train.misfit).then(|| model.as_fitted_have_it());
        let model = of_fitted.as_ref().unwrap_or(model);
        let jumps = self.each_at_best_of(&self.places(), model, case);
        jumps.with(case, |case| model.taken_to(case)).model
    }

    /// All of them at some places, as late as each other.
    fn places(&self) -> Vec<Self> {
        (0..LOOKS).map(|look| self.all_at((look as f64 + 0.5) / LOOKS as f64)).collect()
    }

    fn all_at(&self, share: f64) -> Self {
        Self(self.0.iter().map(|jumps| jumps.iter().map(|jump| Jump { share, ..*jump }).collect()).collect())
    }

    /// Each jump where its answer, until the next one comes, is predicted best by a model: at one of some places.
    fn each_at_best_of(&self, places: &[Self], model: &Hypothesis, case: &Case<'_>) -> Self {
        let rig = model.joint.applied(&model.rig, &model.ranges);
        let left =
            |jumps: &Self| jumps.answers(case.records, &fit::predict(&rig, &jumps.in_records(case.records)));
        let left: Vec<Vec<Vec<f64>>> = places.par_iter().map(left).collect();
        let mut best = self.clone();
        for (record, jumps) in best.0.iter_mut().enumerate() {
            for (index, jump) in jumps.iter_mut().enumerate() {
                let place = iter::zip(places, &left)
                    .min_by(|(_, a), (_, b)| a[record][index].total_cmp(&b[record][index]));
                if let Some((place, _)) = place {
                    *jump = place.0[record][index];
                }
            }
        }
        best
    }

    /// With a model that is fitted to the records of a case, which jump at these times.
    pub(super) fn with(self, case: &Case<'_>, fitted: impl Fn(&Case<'_>) -> Hypothesis) -> Timed {
        let records = self.in_records(case.records);
        let model = fitted(&Case { records: &records, ..*case });
        Timed { records, model, jumps: self }
    }

    /// Chi-square of what predictions of records leave of the answer to each jump.
    fn answers(&self, records: &[Prepared], predictions: &[Vec<Outputs<f64>>]) -> Vec<Vec<f64>> {
        let of_one = |((jumps, record), outputs): ((&Vec<Jump>, &Prepared), &Vec<Outputs<f64>>)| {
            let left = residual::in_noise(slice::from_ref(record), slice::from_ref(outputs));
            let ends = jumps.iter().skip(1).map(|jump| jump.sample).chain([record.len()]);
            let compared: Vec<usize> =
                (0..record.len()).filter(|&sample| record.is_compared(sample)).collect();
            let before = |end: usize| compared.partition_point(|&sample| sample < end);
            let answer = |(jump, end): (&Jump, usize)| {
                let answer = before(jump.sample)..before(end);
                let samples = left
                    .as_slice()
                    .chunks(compared.len().max(1))
                    .flat_map(|channel| &channel[answer.clone()]);
                samples.map(|left| left * left).sum()
            };
            jumps.iter().zip(ends).map(answer).collect()
        };
        iter::zip(&self.0, records).zip(predictions).map(of_one).collect()
    }

    /// What a fit of a rig leaves of the first records, and what would change it.
    fn slopes(&self, rig: &Rig, ranges: &[rig::Range], fit: &Polished, records: &[Prepared]) -> Slopes {
        let rig = fit.applied(rig, ranges);
        let residual =
            |rig: &Rig, records: &[Prepared]| residual::in_noise(records, &fit::predict(rig, records));
        let of_each: Vec<DVector<f64>> =
            records.par_iter().map(|record| residual(&rig, slice::from_ref(record))).collect();
        let left: DVector<f64> = of_each.iter().flatten().copied().collect::<Vec<_>>().into();
        let of_value = |(index, range): (usize, &rig::Range)| {
            let (value, width) = (fit.values[index], DIFFERENCE * fit.standard_error(index));
            if !width.is_finite() {
                return DVector::zeros(left.len());
            }
            let width = range.inward(value, width);
            let mut moved = rig.clone();
            moved.parameters.set(range.parameter, value + width);
            (residual(&moved, records) - &left) / width
        };
        let mut columns: Vec<DVector<f64>> = ranges.par_iter().enumerate().map(of_value).collect();
        let mut start = 0;
        for ((jumps, record), here) in iter::zip(&self.0, records).zip(&of_each) {
            let of_jump = |jump: &Jump| {
                let moved = record.with_jumps_ahead([(jump.sample, jump.share + jump.step())]);
                let mut column = DVector::zeros(left.len());
                let change = (residual(&rig, &[moved]) - here) / jump.step();
                column.rows_mut(start, here.len()).copy_from(&change);
                column
            };
            columns.par_extend(jumps.par_iter().map(of_jump));
            start += here.len();
        }
        Slopes { left, columns: DMatrix::from_columns(&columns), values: ranges.len() }
    }

    /// What it means for a fit of the first records, which jump at these times, that the times were fitted as well; none
    /// where the records do not tell what is free.
    pub(super) fn cost(
        &self,
        rig: &Rig,
        ranges: &[rig::Range],
        fit: &Polished,
        records: &[Prepared],
    ) -> Option<Cost> {
        let slopes = self.slopes(rig, ranges, fit, records);
        let (all, free) = (slopes.told(), slopes.values);
        let at_given_times = all.view((0, 0), (free, free)).into_owned().cholesky()?;
        let before = (all.nrows() - free) as f64 * KNOWN_BEFORE.ln();
        let told = all.cholesky()?;
        let price = told.ln_determinant() - at_given_times.ln_determinant() - before;
        let (variances, given) = (told.inverse().diagonal(), at_given_times.inverse().diagonal());
        let widening = (0..free).map(|index| (variances[index] / given[index]).sqrt()).collect();
        Some(Cost { price, widening })
    }
}

#[cfg(test)]
mod tests {
    use super::{Case, Cost, Hypothesis, Jump, Jumps, KNOWN_BEFORE};
    use crate::fit::{self, Polished, Prepared};
    use crate::record::Record;
    use crate::rig::{CommandPath, Rig};
    use eha_monitor::channel::Channel;
    use std::ops::Range;
    use std::{iter, slice};

    const PERIOD: f64 = 1e-3;
    const NOISE: [f64; 4] = [5e-6, f64::INFINITY, f64::INFINITY, f64::INFINITY];
    const STEP: usize = 300;
    const SHARE: f64 = 0.4;

    fn jumping(record: &Prepared, share: f64) -> Prepared {
        record.with_jumps_ahead([(STEP, share)])
    }

    /// A small sine with a step of 2 mm in it, a share of a sample before the sample that shows it, and the rig that flew it.
    fn flown() -> (Rig, Prepared) {
        let mut rig = Rig { command_path: CommandPath::Curve, ..Rig::load("eha").unwrap() };
        (rig.parameters.bkl, rig.parameters.fdj) = (2e-4, 800.0);
        let mut command: Vec<f64> = (0..1000).map(|k| 3e-4 * (f64::from(k) * PERIOD * 20.0).sin()).collect();
        command[STEP..].iter_mut().for_each(|position| *position += 2e-3);
        let prepared = |position: Vec<f64>| {
            let channels = vec![(Channel::Command, command.clone()), (Channel::UserPosition, position)];
            let record = Record::new("made".to_owned(), PERIOD, 0.0, channels).unwrap();
            fit::prepare_with(&rig, &record, NOISE)
        };
        let outputs = fit::predict(&rig, &[jumping(&prepared(command.clone()), SHARE)]).concat();
        let record = prepared(outputs.iter().map(|outputs| outputs.user).collect());
        assert_eq!(record.jumps(), [STEP]);
        (rig, record)
    }

    fn fitted(rig: &Rig, record: &Prepared, share: f64) -> Polished {
        let start = [rig.parameters.bkl, rig.parameters.fdj];
        fit::polish(rig, &rig.faults, &start, &[jumping(record, share)]).unwrap()
    }

    fn cost_of(rig: &Rig, record: &Prepared) -> Cost {
        let jumps = Jumps(vec![vec![Jump { sample: STEP, share: SHARE }]]);
        let fit = fitted(rig, record, SHARE);
        jumps.cost(rig, &rig.faults, &fit, &[jumping(record, SHARE)]).unwrap()
    }

    #[test]
    fn an_unknown_time_costs_and_widens_what_refits_beside_it_say() {
        let (rig, record) = flown();
        let Cost { price, widening } = cost_of(&rig, &record);
        // The same from fits with the step a little earlier and later: how much worse they are, and where they end.
        let off = 0.01;
        let [here, later, earlier] =
            [SHARE, SHARE - off, SHARE + off].map(|share| fitted(&rig, &record, share));
        let rise = 0.5 * (later.misfit.chi_square + earlier.misfit.chi_square) - here.misfit.chi_square;
        let told = rise / (off * off);
        assert!(((1.0 + told / KNOWN_BEFORE).ln() / price - 1.0).abs() < 0.02, "{price}, {told}");
        for (index, wider) in widening.iter().enumerate() {
            let slope = (earlier.values[index] - later.values[index]) / (2.0 * off);
            let more = slope.powi(2) / (told + KNOWN_BEFORE) / here.standard_error(index).powi(2);
            assert!(((wider * wider - 1.0) / more - 1.0).abs() < 0.05, "{wider}, {more}");
        }
        // Where friction leaves the actuator after a step is told by the time of the step as well.
        assert!(widening.iter().any(|&wider| wider > 1.2), "{widening:?}");
    }

    #[test]
    fn an_answer_is_what_is_compared_between_its_jump_and_the_next() {
        let (rig, record) = flown();
        // What it has not forgotten of a start off its command is not compared.
        let off: Vec<f64> = record.measured(0).iter().map(|position| position + 1e-4).collect();
        let channels = vec![(Channel::Command, record.command().to_vec()), (Channel::UserPosition, off)];
        let late = Record::new("late".to_owned(), PERIOD, 0.0, channels).unwrap();
        let late = fit::prepare_with(&rig, &late, NOISE);
        let skipped = (0..late.len()).filter(|&sample| !late.is_compared(sample)).count();
        assert!((1..STEP).contains(&skipped), "{skipped}");
        let jumps = Jumps(vec![[STEP, 600].map(|sample| Jump { sample, share: SHARE }).to_vec()]);
        let outputs = fit::predict(&rig, slice::from_ref(&late));
        let left = |samples: Range<usize>| -> f64 {
            samples.map(|k| ((late.measured(0)[k] - outputs[0][k].user) / NOISE[0]).powi(2)).sum()
        };
        let answers = jumps.answers(slice::from_ref(&late), &outputs).concat();
        for (answer, samples) in iter::zip(answers, [STEP..600, 600..late.len()]) {
            assert!((answer / left(samples) - 1.0).abs() < 1e-9, "{answer}");
        }
    }

    #[test]
    fn what_explains_the_fitted_records_times_the_jumps_of_others() {
        let (rig, record) = flown();
        let before_the_step =
            [(Channel::Command, record.command()), (Channel::UserPosition, record.measured(0))]
                .map(|(channel, values)| (channel, values[..STEP].to_vec()));
        let calm = Record::new("calm".to_owned(), PERIOD, 0.0, before_the_step.to_vec()).unwrap();
        let records = [fit::prepare_with(&rig, &calm, NOISE), record];
        let case = Case::new(&rig, &records, 1);
        let start = [rig.parameters.bkl, rig.parameters.fdj];
        let train = fit::polish(&rig, &rig.faults, &start, &records[..1]).unwrap();
        // All records were fitted with the step at its sample, for which the friction makes up.
        let joint = Polished { values: vec![rig.parameters.bkl, 2.0 * rig.parameters.fdj], ..train.clone() };
        let model = Hypothesis::of(&case, rig.clone(), rig.declared(), [train, joint], Vec::new());
        let found = Jumps::of(&records).unwrap().at_best_for(&model, &case);
        assert!(found.joint.misfit.mean_square() < 0.1, "{:?}", found.joint.misfit);
    }

    #[test]
    fn times_that_no_sample_shows_cost_nothing() {
        let (rig, record) = flown();
        let unseen = record.without_jumps(1.0);
        let Cost { price, widening } = cost_of(&rig, &unseen);
        assert!(price.abs() < 1e-9, "{price}");
        assert!(widening.iter().all(|wider| (wider - 1.0).abs() < 1e-9), "{widening:?}");
    }
}
