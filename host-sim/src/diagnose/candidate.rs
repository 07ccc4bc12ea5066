//! One effect of the catalogue as a hypothesis: its parameters added to the free ones, fitted together.

use super::place::{self, Place};
use super::signature::Signatures;
use crate::fit::{self, FitSettings, Polished, Prepared};
use crate::rig::{Range, Rig};
use eha_monitor::effect::EffectInfo;
use eha_monitor::fit::identify::within_noise;
use eha_monitor::model::{Drive, ValveForm};
use eha_monitor::parameter::Parameter;
use rayon::prelude::*;
use std::cmp::Ordering;

/// Factor by which a range is widened where a fit ends at its edge, and how often.
const WIDER: f64 = 10.0;
const MOST_WIDENED: usize = 3;
/// Multiples of its size at which an effect is looked for where one of many valleys may have caught it, and how often.
const OTHER_SIZES: [f64; 4] = [0.5, 0.7, 1.4, 2.0];
const MOST_RESIZED: usize = 3;

/// Can an effect act in a rig at all? An effect of the valve or the fluid needs them; one whose parameter is free
/// already is part of the model; beside too many others there is no place for its own.
pub(super) fn applies(effect: &EffectInfo, rig: &Rig, ranges: &[Range]) -> bool {
    use eha_monitor::effect::Port;
    let part_of_model =
        effect.parameters.iter().any(|&wanted| ranges.iter().any(|range| range.parameter == wanted));
    let pilot = matches!(
        effect.parameters[0],
        Parameter::FeedbackPlay | Parameter::FilterClogging | Parameter::SpoolFriction
    );
    let in_hydraulics = matches!(effect.port, Port::Valve | Port::Fluid);
    let out_of_place = (in_hydraulics && rig.form.drive == Drive::Force)
        || (pilot && rig.form.valve == ValveForm::FirstOrder);
    let no_drive = effect.port == Port::Drive && rig.form.drive == Drive::Valve;
    let too_many = ranges.len() + effect.parameters.len() > fit::MAX_FREE;
    !part_of_model && !out_of_place && !no_drive && !too_many
}

/// An effect as the linear model sees it, before anything is fitted.
#[derive(Clone, Debug)]
pub(super) struct Prospect {
    /// The effect.
    pub(super) effect: &'static EffectInfo,
    /// What the linear model foresees: values, misfit, covariance.
    pub(super) foreseen: Polished,
    /// The ranges in which it does.
    ranges: Vec<Range>,
    /// Where the effect was looked for.
    places: Vec<Place>,
}

/// Looks at an effect beside the parameters that are free already, whose present values are in the rig; `signatures` are
/// those around it. None where the records say nothing about the effect.
pub(super) fn look(
    effect: &'static EffectInfo,
    rig: &Rig,
    ranges: &[Range],
    records: &[Prepared],
    signatures: &Signatures<'_>,
) -> Option<Prospect> {
    let base = Place::of(rig, ranges);
    let is_first = ranges.len() == rig.declared().len();
    let places: Vec<Place> = place::places(effect, rig, records, signatures, is_first)
        .iter()
        .map(|place| base.with(place))
        .collect();
    let (ranges, foreseen) = places
        .iter()
        .filter_map(|place| Some((&place.ranges, fit::foresee(rig, &place.ranges, &place.values, records)?)))
        .min_by(|(_, a), (_, b)| a.misfit.chi_square.total_cmp(&b.misfit.chi_square))?;
    Some(Prospect { effect, foreseen, ranges: ranges.clone(), places })
}

/// An effect looked for in records beside the parameters that are free already, and fitted to the bottom after `steps`
/// rough ones.
pub(super) fn found(
    effect: &'static EffectInfo,
    rig: &Rig,
    ranges: &[Range],
    records: &[Prepared],
    steps: u32,
) -> Option<Candidate> {
    let signatures = Signatures::new(rig, ranges, records);
    let prospect = look(effect, rig, ranges, records, &signatures)?;
    prospect.approach(rig, records, &[], steps)?.or_ringing(rig, records, steps).finished(rig, records)
}

impl Prospect {
    /// A rough fit, from what the linear model foresees and from each place where the effect was looked for: what was free
    /// before first follows it there, because it may have been far off to make up for the effect. `others` are more
    /// values of that to start from.
    pub(super) fn approach(
        &self,
        rig: &Rig,
        records: &[Prepared],
        others: &[Vec<f64>],
        steps: u32,
    ) -> Option<Candidate> {
        let before = self.ranges.len() - self.effect.parameters.len();
        let follow = |place: &Place| place.followed(self.effect, rig, records, steps);
        let followed: Vec<(f64, Place)> = self.places.par_iter().filter_map(follow).collect();
        let best = followed.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, place)| place);
        let elsewhere = others.iter().flat_map(|first| {
            self.places.iter().map(move |Place { ranges, values }| Place {
                ranges: ranges.clone(),
                values: [&first[..], &values[before..]].concat(),
            })
        });
        let foreseen = Place { ranges: self.ranges.clone(), values: self.foreseen.values.clone() };
        let starts: Vec<Place> = std::iter::once(foreseen).chain(best).chain(elsewhere).collect();
        let fits: Vec<Candidate> = starts
            .par_iter()
            .filter_map(|start| Candidate::rough(self.effect, start, rig, records, steps))
            .collect();
        fits.into_iter().min_by(lower)
    }
}

/// Which of two candidates has the lower chi-square.
pub(super) fn lower(a: &Candidate, b: &Candidate) -> Ordering {
    a.fit.misfit.chi_square.total_cmp(&b.fit.misfit.chi_square)
}

/// An effect that was fitted together with everything that was free before.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    /// The effect.
    pub(super) effect: &'static EffectInfo,
    /// The free parameters: those of before, then the effect's.
    pub(super) ranges: Vec<Range>,
    /// The fit, rough at first.
    pub(super) fit: Polished,
}

impl Candidate {
    /// A rough fit from a place.
    fn rough(
        effect: &'static EffectInfo,
        start: &Place,
        rig: &Rig,
        records: &[Prepared],
        steps: u32,
    ) -> Option<Self> {
        let fit = fit::approach(rig, &start.ranges, &start.values, records, steps)?;
        Some(Self { effect, ranges: start.ranges.clone(), fit })
    }

    /// Does it leave noise of the fitted records?
    pub(super) fn explains(&self) -> bool {
        within_noise(&self.fit.misfit)
    }

    /// Goes on by some rough steps.
    pub(super) fn further(self, rig: &Rig, records: &[Prepared], steps: u32) -> Option<Self> {
        let here = Place { ranges: self.ranges, values: self.fit.values };
        Some(Self::rough(self.effect, &here, rig, records, steps)?.or_ringing(rig, records, steps))
    }

    /// The same in another valley of what rings, where one is better; not where it leaves noise.
    pub(super) fn or_ringing(self, rig: &Rig, records: &[Prepared], steps: u32) -> Self {
        if self.explains() {
            return self;
        }
        let places = place::ringing(&self, rig, records);
        let ringing = places.iter().filter_map(|place| Self::rough(self.effect, place, rig, records, steps));
        let best = ringing.min_by(lower);
        best.filter(|best| lower(best, &self).is_lt()).unwrap_or(self)
    }

    /// The same with the effect of another size, where that is better; not where it leaves noise. A fault that makes up for
    /// a part of the effect leads into one of many valleys along the size.
    pub(super) fn or_of_another_size(self, rig: &Rig, records: &[Prepared], steps: u32) -> Self {
        let mut best = self;
        for _ in 0..MOST_RESIZED {
            if best.explains() {
                break;
            }
            let resized =
                OTHER_SIZES.par_iter().filter_map(|&factor| best.resized(factor, rig, records, steps));
            let Some(better) = resized.min_by(lower).filter(|other| lower(other, &best).is_lt()) else {
                break;
            };
            best = better;
        }
        best
    }

    /// A rough fit from where the effect's size is a multiple of what it is here, and what else is free has followed.
    fn resized(&self, factor: f64, rig: &Rig, records: &[Prepared], steps: u32) -> Option<Self> {
        let first = self.ranges.len() - self.effect.parameters.len();
        let Self { effect, mut ranges, fit: Polished { mut values, .. } } = self.clone();
        let absent = rig.parameters.get(ranges[first].parameter);
        values[first] = absent + factor * (values[first] - absent);
        ranges[first] = ranges[first].widened_to(values[first])?;
        let (_, start) = Place { ranges, values }.followed(effect, rig, records, steps)?;
        Self::rough(effect, &start, rig, records, steps)
    }

    /// Goes on to the bottom.
    pub(super) fn finished(self, rig: &Rig, records: &[Prepared]) -> Option<Self> {
        let (ranges, fit) = fitted(rig, self.ranges, &self.fit.values, records)?;
        Some(Self { ranges, fit, ..self })
    }

    /// The rig with the effect and the fitted values.
    pub(super) fn applied(&self, rig: &Rig) -> Rig {
        let mut rig = self.fit.applied(rig, &self.ranges);
        if !rig.effects.contains(&self.effect) {
            rig.effects.push(self.effect);
        }
        rig
    }
}

/// The best that the genetic search finds for an effect beside the parameters that are free already, in some spans of it;
/// none where chi-square is not below a bound there.
pub(super) fn searched(
    effect: &'static EffectInfo,
    rig: &Rig,
    free: &[Range],
    records: &[Prepared],
    settings: &FitSettings,
    bound: f64,
) -> Option<Candidate> {
    let search = |span: Vec<Range>| {
        let ranges = [free, &span].concat();
        let found = fit::fit(rig, &ranges, records, settings, |_| {});
        (ranges, found)
    };
    let (ranges, found) = place::spans(effect, rig, records)
        .into_par_iter()
        .map(search)
        .filter(|(_, found)| found.misfit.chi_square < bound)
        .min_by(|(_, a), (_, b)| a.misfit.chi_square.total_cmp(&b.misfit.chi_square))?;
    let values: Vec<f64> = found.estimates.iter().map(|estimate| estimate.value).collect();
    let (ranges, fit) = fitted(rig, ranges, &values, records)?;
    Some(Candidate { effect, ranges, fit })
}

/// Fits the ranges from a start, those of effects wider where the fit ends at their edge; none where the records hold
/// nothing to compare.
pub(super) fn fitted(
    rig: &Rig,
    mut ranges: Vec<Range>,
    start: &[f64],
    records: &[Prepared],
) -> Option<(Vec<Range>, Polished)> {
    let mut fit = fit::polish(rig, &ranges, start, records)?;
    for _ in 0..MOST_WIDENED {
        let wider = widened(rig, &ranges, &fit.values);
        if wider == ranges {
            break;
        }
        ranges = wider;
        fit = fit::polish(rig, &ranges, &fit.values, records)?;
    }
    Some((ranges, fit))
}

/// The ranges, but those that the rig does not declare wider where a value is at their edge and inside what is possible.
fn widened(rig: &Rig, ranges: &[Range], values: &[f64]) -> Vec<Range> {
    let is_given = |parameter| {
        rig.declares(parameter) || matches!(parameter, Parameter::StepLoadTime | Parameter::CoggingPitch)
    };
    let widen = |(range, &value): (&Range, &f64)| {
        let info = range.parameter.info();
        if range.may_be_beyond(value) == [false; 2] || is_given(range.parameter) {
            return *range;
        }
        let more = (WIDER - 1.0) / 2.0 * (range.upper - range.lower);
        Range {
            lower: (range.lower - more).max(info.lower),
            upper: (range.upper + more).min(info.upper),
            ..*range
        }
    };
    ranges.iter().zip(values).map(widen).collect()
}

#[cfg(test)]
mod tests {
    use super::super::signature::tests::{record, with};
    use super::{Candidate, widened};
    use crate::fit;
    use crate::rig::{Range, Rig};
    use eha_monitor::effect::EffectInfo;
    use eha_monitor::parameter::Parameter;

    #[test]
    fn a_pitch_is_not_followed_to_where_a_ripple_is_a_bend() {
        let rig = Rig::load("eha").unwrap();
        let amplitude = Range::around(Parameter::CoggingSine, 0.0, 100.0);
        let pitch = Range { parameter: Parameter::CoggingPitch, lower: 4e-3, upper: 5e-3 };
        let wider = widened(&rig, &[amplitude, pitch], &[amplitude.upper, pitch.upper]);
        assert!(wider[0].upper > amplitude.upper);
        assert_eq!(wider[1], pitch);
    }

    #[test]
    fn an_effect_that_is_caught_at_half_its_size_is_found_at_its_own() {
        let mut rig = Rig::load("eha").unwrap();
        (rig.parameters.bkl, rig.parameters.fdj) = (2e-4, 600.0);
        let leak = 1e-11;
        let records = [record(&with(&rig, Parameter::Leakage, leak - rig.parameters.leakage))];
        let effect = EffectInfo::named("leakage").unwrap();
        let caught = |size: f64| {
            let ranges = [&rig.faults[..], &[Range::around(Parameter::Leakage, size, size)]].concat();
            let values = vec![2e-4, 600.0, size];
            let fit = fit::approach(&rig, &ranges, &values, &records, 0).unwrap();
            Candidate { effect, ranges, fit }
        };
        let half = caught(0.5 * leak);
        assert!(!half.explains());
        let found = half.or_of_another_size(&rig, &records, 12);
        assert!(found.explains());
        assert!((found.fit.values[2] / leak - 1.0).abs() < 0.02, "{:?}", found.fit.values);
        let whole = caught(leak);
        assert_eq!(whole.clone().or_of_another_size(&rig, &records, 12).fit.values, whole.fit.values);
    }
}
