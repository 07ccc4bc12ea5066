//! What a fault trades with: an effect that the fault could make up for, so that records leave both open.
//!
//! The linear model at a fit tells it where the two can hardly be told apart already. Where they can be in part, they may go
//! on to trade as far as a fault of eight times the size: a jack that rests where its friction holds it tells friction over
//! pressure gain. So it is walked along the fault, with the effect free to follow.

use super::Case;
use super::candidate::{self, Candidate, Prospect};
use super::hypothesis::{self, Hypothesis};
use super::place::{self, Place};
use crate::fit::{self, Estimate, FitSettings, Polished, Valley};
use eha_monitor::effect::{EFFECTS, EffectInfo};
use rayon::prelude::*;

/// A fault whose standard error grows by this factor when an effect is fitted beside it is confounded with the effect.
const CONFOUNDED: f64 = 5.0;
/// Where it grows by this factor, the errors of the two are correlated by 0.6: it may trade with the effect.
const TRADES: f64 = 1.25;

/// An effect that a fault may trade with, fitted beside all that is free.
#[derive(Clone)]
pub(super) struct Trade {
    /// The effect, at the bottom of the valley.
    candidate: Candidate,
    valley: Valley,
}

impl Hypothesis {
    /// Would an effect leave a declared fault undetermined, as the linear model has it?
    pub(super) fn confuses(&self, case: &Case<'_>, prospect: &Prospect) -> bool {
        self.widens(case, &prospect.foreseen, CONFOUNDED)
    }

    /// Is the standard error of a declared fault larger by more than a factor in a fit with an effect beside it?
    fn widens(&self, case: &Case<'_>, with: &Polished, factor: f64) -> bool {
        (0..case.rig.faults.len())
            .any(|fault| with.standard_error(fault) > factor * self.train.standard_error(fault))
    }

    /// For each declared fault, the effects whose presence would leave it undetermined.
    pub(super) fn confounded(&self, case: &Case<'_>) -> Vec<Vec<&'static EffectInfo>> {
        let is_noise = self.leaves_noise(case);
        let own = self.faults(case, &self.train, is_noise.then(|| self.valley(case)));
        let mut confounded: Vec<Vec<&EffectInfo>> = vec![Vec::new(); own.len()];
        for prospect in self.prospects(case) {
            let traded = self.trades(case).iter().find(|trade| trade.candidate.effect == prospect.effect);
            let traded = traded.map(|trade| self.faults(case, &trade.candidate.fit, Some(&trade.valley)));
            for (fault, estimate) in own.iter().enumerate() {
                let error = CONFOUNDED * estimate.spread();
                let is_open = traded.as_ref().is_some_and(|traded| traded[fault].spread() > error);
                if is_open || prospect.foreseen.standard_error(fault) > error {
                    confounded[fault].push(prospect.effect);
                }
            }
        }
        confounded
    }

    /// The declared faults of a fit of this model, or of one with more in it, as far as the fitted records leave them open.
    fn faults(&self, case: &Case<'_>, fit: &Polished, valley: Option<&Valley>) -> Vec<Estimate> {
        let own = |(fault, range)| Estimate::new(range, fit.values[fault], fit.standard_error(fault));
        let mut faults: Vec<Estimate> =
            self.ranges[..case.rig.faults.len()].iter().enumerate().map(own).collect();
        if let Some(valley) = valley {
            valley.widen(&mut faults);
        }
        faults
    }

    /// The effects that a declared fault may trade with; of a model that leaves noise; the fitted records are those that
    /// it was made with.
    pub(super) fn trades(&self, case: &Case<'_>) -> &[Trade] {
        self.trades.get_or_init(|| {
            if !self.leaves_noise(case) {
                return Vec::new();
            }
            let is_simple = |effect: &&'static EffectInfo| {
                effect.parameters.len() == 1 && candidate::applies(effect, &self.rig, &self.ranges)
            };
            EFFECTS.par_iter().filter(is_simple).filter_map(|effect| self.trade(case, effect)).collect()
        })
    }

    /// The valley of the declared faults with an effect beside them; none where they do not trade with it, or it takes long.
    fn trade(&self, case: &Case<'_>, effect: &'static EffectInfo) -> Option<Trade> {
        let rig = &self.rig;
        let ranges = [&self.ranges[..], &place::widest(effect, rig)].concat();
        let Place { ranges, values } = Place::of(rig, &ranges);
        if !fit::is_affine(rig, &ranges) {
            return None;
        }
        let foreseen = fit::foresee(rig, &ranges, &values, case.train())?;
        if !self.widens(case, &foreseen, TRADES) {
            return None;
        }
        let fit = fit::polish(rig, &ranges, &values, case.train())?;
        let valley = Valley::around(rig, &ranges, &fit, case.train(), case.rig.faults.len());
        let candidate = Candidate { effect, ranges, fit: valley.bottom.clone() };
        Some(Trade { candidate, valley })
    }

    /// The best model with one of the effects that a declared fault trades with in another reading of its records, where it
    /// costs less there than a bound: what was read so may be what makes up for the effect, as the fault does.
    pub(super) fn traded(
        &self,
        here: &Case<'_>,
        there: &Case<'_>,
        settings: &FitSettings,
        bound: impl Fn(f64) -> f64,
    ) -> Option<Self> {
        let effects: Vec<_> = self.trades(here).iter().map(|trade| trade.candidate.effect).collect();
        let base = self.refitted(there);
        let found = base.searched_in_all(there, &effects, settings, base.joint.misfit.chi_square);
        let best = found.into_iter().min_by(hypothesis::lower)?;
        let scale = best.scale();
        (best.cost(scale) < bound(scale)).then_some(best)
    }

    /// The effects that a declared fault trades with and that gain more than their price.
    pub(super) fn hidden(&self, case: &Case<'_>) -> Vec<Self> {
        let base = self.train.misfit.chi_square;
        let gains = |trade: &&Trade| {
            base - trade.candidate.fit.misfit.chi_square > self.price(trade.candidate.effect, self.scale())
        };
        let hidden = self.trades(case).iter().filter(gains).map(|trade| trade.candidate.clone()).collect();
        self.with(case, hidden)
    }
}
