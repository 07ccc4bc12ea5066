//! From the best hypothesis to the answer.

use super::case::Case;
use super::description;
use super::diagnosis::{Diagnosis, Fault, Found, Verdict, position_rms, score};
use super::hypothesis::Hypothesis;
use super::residual;
use super::search::GROWING_SHARE;
use super::side;
use super::weighing::Earned;
use crate::fit::{self, Correlation, Estimate, Fit, Prepared};
use crate::rig::{Calibration, Rig};
use eha_monitor::effect::EffectInfo;
use eha_monitor::fit::problem::Misfit;
use eha_monitor::model::state::Outputs;
use rayon::prelude::*;

/// An empirical term is there to predict. One that the fitted records say nothing of is dropped; as long as the held-out
/// records, or the fitted ones where none are held out, are predicted no better than without any, the weakest; and then each
/// without which they are predicted better. Where none is left, the model is the one that had none: without the last one
/// it may have ended elsewhere.
pub(super) fn helpful(
    case: &Case<'_>,
    before: &Fit,
    root: impl FnOnce() -> Hypothesis,
    mut model: Hypothesis,
    mut earned: Vec<Earned>,
) -> (Hypothesis, Vec<Earned>) {
    let without_any = Errors::of(case, &before.applied(case.rig));
    loop {
        let untold = earned.iter().position(|earned| !model.is_told(earned.effect));
        let weakest = || (0..earned.len()).min_by(|&a, &b| earned[a].evidence.total_cmp(&earned[b].evidence));
        let is_worse = || !Errors::of(case, &model.rig).are_less_than(&without_any);
        let Some(dropped) = untold.or_else(|| weakest().filter(|_| is_worse())) else { break };
        model = model.without(case, earned.remove(dropped).effect);
    }
    while !earned.is_empty() {
        let without = |index: usize| {
            let model = model.without(case, earned[index].effect);
            (Errors::of(case, &model.rig), index, model)
        };
        let with = Errors::of(case, &model.rig);
        let all = (0..earned.len()).into_par_iter().map(without);
        let better = all.filter(|(without, ..)| without.are_less_than(&with));
        let best = better.min_by(|(a, ..), (b, ..)| a.product().total_cmp(&b.product()));
        let Some((_, index, smaller)) = best else { break };
        model = smaller;
        earned.remove(index);
    }
    (if earned.is_empty() { root() } else { model }, earned)
}

/// What the whole of long records asks for beside the empirical terms that were found in excerpts: one term after the other,
/// as long as each takes away enough to be grown and earns its place, and the records that [`helpful`] looks at are predicted
/// better with it.
pub(super) fn helped_by_whole(
    case: &Case<'_>,
    mut model: Hypothesis,
    mut earned: Vec<Earned>,
) -> (Hypothesis, Vec<Earned>) {
    while !case.is_over() {
        case.progress.begin("looking for more in the whole of the records", [0.95, 1.0]);
        let mut without = model.clone();
        let grown = without.grow(case, &[], false);
        let before = Errors::of(case, &without.rig);
        let known = [without];
        let asked = grown
            .into_iter()
            .filter(|new| new.share_of(&known[0]) >= GROWING_SHARE && new.is_welcome(case, &known));
        let foretold = asked.map(|new| (Errors::of(case, &new.rig), new));
        let helps = foretold.filter(|(errors, _)| errors.are_less_than(&before));
        let best = helps.min_by(|(a, _), (b, _)| a.product().total_cmp(&b.product()));
        let Some((_, best)) = best else { break };
        earned.extend(best.weighed(case, &known));
        model = best;
    }
    (model, earned)
}

/// How far a model is off the records that its terms are judged by: the held-out ones, or the fitted ones where none are
/// held out.
struct Errors {
    /// Of the position, m.
    position: f64,
    /// Of the force that a known controller asks for, as a part of it. A spring moves an actuator in a closed loop as a sensor
    /// that shows too little says that it moves; but it takes a force.
    force: Option<f64>,
}

impl Errors {
    fn of(case: &Case<'_>, rig: &Rig) -> Self {
        let predicted = if case.holdout().is_empty() { case.train() } else { case.holdout() };
        let predictions = fit::predict(rig, predicted);
        Self {
            position: position_rms(predicted, &predictions),
            force: fit::force_error(predicted, &predictions),
        }
    }

    /// What terms that predict both better are told apart by: so many per cent less of one are worth as many of the other.
    fn product(&self) -> f64 {
        self.position * self.force.unwrap_or(1.0)
    }

    /// Is the position predicted better, and the force no worse?
    fn are_less_than(&self, other: &Self) -> bool {
        self.position < other.position && self.force <= other.force
    }
}

/// What the records leave open.
pub(super) struct Open {
    /// Is what was found named?
    pub(super) named: bool,
    /// For each effect that was found, the hypotheses with another in its place that do as well.
    pub(super) stand_ins: Vec<Vec<Hypothesis>>,
    /// For each declared fault, the effects whose presence would leave it undetermined.
    pub(super) confounded: Vec<Vec<&'static EffectInfo>>,
}

impl Open {
    /// Nothing was asked of what so many effects leave open.
    pub(super) fn unasked(case: &Case<'_>, effects: usize) -> Self {
        Self {
            named: false,
            stand_ins: vec![Vec::new(); effects],
            confounded: vec![Vec::new(); case.rig.faults.len()],
        }
    }
}

/// Puts the answer together.
pub(super) fn conclude(
    case: &Case<'_>,
    before: Fit,
    best: &Hypothesis,
    earned: &[Earned],
    open: &Open,
) -> Diagnosis {
    let predictions = fit::predict(&best.rig, case.train());
    let noise_only = best.leaves_noise(case);
    let verdict = match (noise_only, earned.is_empty()) {
        (true, true) => Verdict::Adequate,
        (true, false) => Verdict::Explained,
        (false, _) => Verdict::Unexplained,
    };
    let inflation = (!noise_only).then(|| inflation(case.train(), &predictions, &best.train.misfit));
    // Once the held-out records have had their say, what they tell of the sizes counts as well.
    let estimates_of = |model: &Hypothesis| {
        inflation.map_or_else(|| model.estimates(case), |inflation| model.inflated_estimates(case, inflation))
    };
    let (fit, estimates) = if noise_only {
        let likeliest = best.likeliest(case);
        let estimates = best.estimates_at(case, &likeliest);
        (likeliest, estimates)
    } else {
        (best.train.clone(), estimates_of(best))
    };
    let found: Vec<Found> = earned
        .iter()
        .zip(&open.stand_ins)
        .map(|(earned, others)| Found {
            effect: earned.effect,
            class: class(earned.effect, others),
            evidence: earned.evidence,
            named: open.named,
            estimates: estimates
                .iter()
                .filter(|estimate| earned.effect.parameters.contains(&estimate.parameter))
                .copied()
                .collect(),
        })
        .collect();
    let others: Vec<Vec<Estimate>> = open.stand_ins.iter().flatten().map(estimates_of).collect();
    let faults = (0..case.rig.faults.len())
        .map(|index| {
            let mut estimate = estimates[index];
            // Whatever stands in for an effect has its own opinion of the faults: the interval holds them all.
            for other in &others {
                estimate.hold(&other[index]);
            }
            // Terms beside which more than noise is left move the faults, to the truth or away from it.
            if !noise_only {
                estimate.hold(&before.estimates[index]);
            }
            Fault { estimate, confounded_with: open.confounded[index].clone() }
        })
        .collect();
    let bare = before.applied(case.rig);
    let foretells = |rig: &Rig| case.is_noise_left_of(case.holdout(), &fit::predict(rig, case.holdout()));
    // A model of which nothing but the place was told by the held-out records foretells them.
    let is_open = noise_only && !(foretells(&best.rig) && (!earned.is_empty() || foretells(&bare)));
    let left = (!noise_only).then(|| description::describe(case.train(), &predictions)).flatten();
    let acts = (!noise_only).then(|| side::of(case, &best.rig, &predictions)).flatten();
    let scores = |records: &[Prepared]| [score(&bare, records), score(&best.rig, records)];
    let correlation = Correlation::new(best.ranges.iter().map(|range| range.parameter), &fit.covariance);
    let calibration = Calibration::of(&estimates, &correlation).after(&case.rig.calibration);
    Diagnosis {
        verdict,
        early: None,
        faults,
        free: estimates[case.rig.faults.len()..before.estimates.len()].to_vec(),
        correlation,
        found,
        noise: fit::pooled(case.train().iter().map(Prepared::noise_rms)),
        colour: case.train()[0].colour,
        train: scores(case.train()),
        holdout: (!case.holdout().is_empty()).then(|| scores(case.holdout())),
        left,
        acts,
        is_open,
        rig: Rig { calibration, ..fit.applied(&best.rig, &best.ranges) },
        foretelling: best.rig.clone(),
        predictions,
        before: before.likeliest(case.rig, &case.rig.declared(), case.train()),
        records: case.records.to_vec(),
        doubts: Vec::new(),
        jumps: None,
    }
}

/// An effect and those that could stand in for it, each once.
fn class(effect: &'static EffectInfo, others: &[Hypothesis]) -> Vec<&'static EffectInfo> {
    let mut class = vec![effect];
    for other in others.iter().filter_map(Hypothesis::newest) {
        if !class.iter().any(|known| known.name == other.name) {
            class.push(other);
        }
    }
    class
}

/// How much larger than white noise of the stated size what a model leaves counts: mean square times correlation time.
fn inflation(records: &[Prepared], predictions: &[Vec<Outputs<f64>>], misfit: &Misfit<f64>) -> f64 {
    misfit.mean_square().max(1.0) * residual::correlation_time(records, predictions)
}

#[cfg(test)]
mod tests {
    use super::super::readings::Declared;
    use super::super::signature::tests::with;
    use super::{Case, Errors, helped_by_whole};
    use crate::fit::{self, FitSettings, Prepared};
    use crate::record::Record;
    use crate::rig::Rig;
    use eha_monitor::channel::Channel;
    use eha_monitor::model::drive::Law;
    use eha_monitor::parameter::Parameter;

    const LAW: Law<f64> = Law { position_gain: 160.0, velocity_gain: 243.0, limit: 10.0, force_gain: 35.0 };
    const PERIOD: f64 = 1e-3;
    const NOISE: [f64; 4] = [1e-7, f64::INFINITY, f64::INFINITY, f64::INFINITY];

    /// Two seconds of an axis that its controller takes to and fro, with the force that this takes, noise-free.
    fn flown(rig: &Rig, rad_per_s: f64) -> Prepared {
        let command: Vec<f64> =
            (0..2000).map(|k| 0.1 * (1.0 - (rad_per_s * PERIOD * f64::from(k)).cos())).collect();
        let prepared = |position: &[f64], force: Vec<f64>| {
            let channels = vec![
                (Channel::Command, command.clone()),
                (Channel::UserPosition, position.to_vec()),
                (Channel::Drive, force),
            ];
            fit::prepare_with(rig, &Record::new("flown", PERIOD, 0.0, channels).unwrap(), NOISE)
        };
        let outputs = fit::predict(rig, &[prepared(&command, vec![0.0; command.len()])]).concat();
        let ram: Vec<f64> = outputs.iter().map(|outputs| outputs.ram).collect();
        let force = |k: usize| LAW.force(command[k], ram[k], ram[k.saturating_sub(2)], 1.0 / PERIOD);
        prepared(&ram, (0..ram.len()).map(force).collect())
    }

    #[test]
    fn the_force_of_a_controller_has_a_say_in_what_helps() {
        let axis = Rig {
            controller: Some(LAW),
            drive_holds: true,
            faults: Vec::new(),
            free: Vec::new(),
            ..Rig::load("force-axis").unwrap()
        };
        let spring = with(&axis, Parameter::SpringLoad, 10.0);
        let records = [flown(&spring, 3.0), flown(&spring, 4.0)];
        let case = Case::new(&axis, &records, 1);
        let root = Declared::of(&case, &FitSettings::default()).root;
        let (found, earned) = helped_by_whole(&case, root.clone(), Vec::new());
        let names: Vec<&str> = earned.iter().map(|earned| earned.effect.name).collect();
        assert_eq!(names, ["spring-load"]);
        // By the position alone, a gain of the sensor would be as good.
        let gain = root.clone().grow(&case, &[], true);
        let gain = gain.iter().find(|new| new.newest().is_some_and(|effect| effect.name == "sensor-gain"));
        let [none, by_gain, by_spring] =
            [&root, gain.unwrap(), &found].map(|model| Errors::of(&case, &model.rig));
        assert!(by_gain.position < 0.1 * none.position && by_gain.force >= none.force);
        assert!(by_spring.are_less_than(&none) && by_spring.product() < by_gain.product());
    }
}
