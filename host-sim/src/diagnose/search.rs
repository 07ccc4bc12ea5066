//! From the model with the declared faults alone to the best that its records ask for.

use super::Case;
use super::hypothesis::{self, Hypothesis};
use super::weighing::{Earned, learn};
use crate::fit::{FitSettings, TOLD_APART};
use eha_monitor::effect::EffectInfo;
use eha_monitor::fit::identify::within_noise;
use rayon::prelude::*;
use std::iter;
use std::slice;

/// Most effects that are added.
pub(super) const MOST_EFFECTS: usize = 5;
/// Most of them where they leave noise.
const MOST_EXPLAINED: usize = 3;
/// Hypotheses that are grown further.
pub(super) const BEAM: usize = 3;
/// Share of the misfit beyond noise that another effect must take away for a further one to be tried beside it. What is
/// left is coloured; of one that swings some hundred times, the best of the catalogue takes a tenth by chance.
pub(super) const GROWING_SHARE: f64 = 0.1;

/// The model with the declared faults alone, and those with one effect that its records ask for: what a reading of them is
/// judged by before more is known.
#[derive(Clone)]
pub(super) struct FirstRound {
    root: Hypothesis,
    grown: Vec<Hypothesis>,
    /// Does the best of them leave noise?
    pub(super) leaves_noise: bool,
}

impl FirstRound {
    /// Grows the model with the declared faults alone by an effect.
    pub(super) fn of(case: &Case<'_>, mut root: Hypothesis) -> Self {
        case.progress.begin(&round(0), [0.05, 0.1]);
        let mut grown = root.grow(case, &[], true);
        for hidden in root.hidden(case) {
            learn(&mut grown, hidden);
        }
        Self::from_models(case, root, grown)
    }

    fn from_models(case: &Case<'_>, root: Hypothesis, grown: Vec<Hypothesis>) -> Self {
        let mut first = Self { root, grown, leaves_noise: false };
        first.leaves_noise = first.best().leaves_noise(case);
        first
    }

    /// The same models, fitted to a case that differs little from their own: the one with the declared faults alone may be in a
    /// better valley than a search for them found there.
    pub(super) fn moved_to(&self, case: &Case<'_>) -> Self {
        let moved = |model: &Hypothesis| model.moved_to(case);
        Self::from_models(case, moved(&self.root), self.grown.par_iter().map(moved).collect())
    }

    /// All of them.
    pub(super) fn models(&self) -> impl Iterator<Item = &Hypothesis> + Clone {
        iter::once(&self.root).chain(&self.grown)
    }

    /// The one of least cost.
    pub(super) fn best(&self) -> &Hypothesis {
        cheapest(self.models()).unwrap_or(&self.root)
    }
}

/// Mean square, in units of the noise, of the least that any of some models leaves.
pub(super) fn least_scale<'a>(models: impl Iterator<Item = &'a Hypothesis>) -> f64 {
    models.map(Hypothesis::scale).fold(f64::INFINITY, f64::min)
}

/// The model of least cost, in units of the least that any of them leaves.
pub(super) fn cheapest<'a>(models: impl Iterator<Item = &'a Hypothesis> + Clone) -> Option<&'a Hypothesis> {
    let scale = least_scale(models.clone());
    models.min_by(|a, b| a.cost(scale).total_cmp(&b.cost(scale)))
}

/// An explanation of the records that is known before a search.
#[derive(Clone, Copy)]
pub(super) struct Rival {
    /// Mean square, in units of the noise, of what it leaves; at least 1.
    pub(super) scale: f64,
    /// What it costs in units of that, and what it costs by the fitted records alone.
    pub(super) cost: f64,
    pub(super) cost_of_fitted: f64,
    /// Is what it leaves noise?
    pub(super) leaves_noise: bool,
    /// How many effects it has beside the times of jumps.
    pub(super) effects: usize,
}

impl Rival {
    /// Do all records speak for it against a model, and does it leave noise, or enough less than the model to be grown?
    pub(super) fn beats(&self, model: &Hypothesis) -> bool {
        let is_grown = self.scale - 1.0 < (1.0 - GROWING_SHARE) * (model.scale() - 1.0);
        model.cost(self.scale) > self.cost + TOLD_APART && (self.leaves_noise || is_grown)
    }

    /// Does it explain the records, and do they speak for it against all that a first round found?
    pub(super) fn settles(&self, first: &FirstRound) -> bool {
        self.leaves_noise && first.models().all(|model| self.beats(model))
    }

    /// Do the fitted records alone speak for it?
    fn beats_of_fitted(&self, model: &Hypothesis) -> bool {
        model.cost_of_fitted(self.scale) > self.cost_of_fitted + TOLD_APART
    }

    /// Do all records speak for it against a model, and the fitted ones as well?
    pub(super) fn beats_throughout(&self, model: &Hypothesis) -> bool {
        self.beats(model) && self.beats_of_fitted(model)
    }
}

/// Share of the misfit beyond noise that an effect must take away for any other to be looked for beside it.
const NEARLY_ALL: f64 = 0.9;

/// What is told while it is tested what was found.
const TESTING: &str = "testing what was found";

/// What is told of a round that adds an effect to so many.
fn round(added: usize) -> String {
    format!("trying effects, round {}", added + 1)
}

/// The place, among other readings of the records, of one that explains them where this one does not.
pub(super) struct ExplainedElsewhere(pub(super) usize);

/// What is known before a search.
pub(super) struct Known<'a> {
    /// A model that what is found is weighed against.
    pub(super) model: Option<Hypothesis>,
    /// One that is fitted to these records when as many effects are tried.
    pub(super) suggested: Option<Suggested<'a>>,
}

/// A model of other records, or of another reading of these.
#[derive(Clone, Copy)]
pub(super) struct Suggested<'a> {
    pub(super) model: &'a Hypothesis,
    /// What is known of it, if it explains these records in another reading.
    pub(super) explanation: Option<&'a Explanation>,
}

/// What is known of a model that explains records.
pub(super) struct Explanation {
    /// What could stand in for each of its effects.
    pub(super) classes: Vec<Class>,
    /// For each declared fault, the effects whose presence would leave it undetermined.
    pub(super) confounded: Vec<Vec<&'static EffectInfo>>,
}

/// An effect, and the models in which another one stands in for it, their newest.
pub(super) struct Class {
    pub(super) effect: &'static EffectInfo,
    pub(super) others: Vec<Hypothesis>,
}

/// Grows the model with the declared faults alone by more effects than the first, and drops what does not earn its place.
/// `elsewhere` is asked before each round, and after the last one, whether another reading explains the records better than
/// the best so far; it is told how many rounds there were.
///
/// # Errors
/// It does.
pub(super) fn search(
    case: &Case<'_>,
    first: FirstRound,
    known: Known<'_>,
    elsewhere: impl Fn(&Hypothesis, usize) -> Option<usize>,
    settings: &FitSettings,
) -> Result<Sound, ExplainedElsewhere> {
    if let Some(sound) = taken_over(case, &first, &known) {
        return Ok(sound);
    }
    let Known { model, suggested } = known;
    let mut growth = Growth::new(case, model.into_iter().collect(), suggested);
    let FirstRound { root, grown, .. } = first;
    let root = [root];
    let beam = growth.chosen(&root, grown);
    let mut rounds = 0;
    let mut place = cheapest(growth.tried.iter()).and_then(|best| elsewhere(best, rounds));
    if place.is_none() {
        let beam = growth.or_followed(beam, &root, settings, [0.05, 0.1]);
        growth.run_until(beam, [0.1, 0.55], |best| {
            rounds += 1;
            place = elsewhere(best, rounds);
            place.is_some()
        });
    }
    if let Some(place) = place {
        return Err(ExplainedElsewhere(place));
    }
    let suggested = growth.suggested.take();
    growth.tried.extend(suggested.map(|suggested| suggested.model.refitted(case)));
    growth.look_beside_the_first();
    growth.look_again();
    if case.searches_far {
        let singles = growth.singles();
        let beam = growth.or_followed(Vec::new(), &singles, settings, [0.6, 0.65]);
        growth.run(beam, [0.6, 0.65]);
        growth.look_again();
        growth.run_from_afar(settings);
    }
    let mut tried = growth.tried;
    case.progress.begin(TESTING, [0.9, 0.95]);
    let mut sound = Sound::of(case, &mut tried);
    sound.find_stand_ins(case, &tried, settings);
    for _ in 0..MOST_EFFECTS {
        let scale = sound.best.scale();
        let is_better = |other: &&Hypothesis| other.cost(scale) < sound.best.cost(scale) - TOLD_APART;
        let better: Vec<Hypothesis> = sound.stand_ins.iter().flatten().filter(is_better).cloned().collect();
        if better.is_empty() || case.is_over() {
            break;
        }
        tried.extend(better);
        let next = Sound::of(case, &mut tried);
        if next.is_as(&sound) {
            break;
        }
        sound = next;
        sound.find_stand_ins(case, &tried, settings);
    }
    case.progress.begin("looking for what is mixed up with a fault", [0.95, 1.0]);
    let confounded = sound.best.confounded(case);
    Ok(Sound { confounded, ..sound })
}

/// What explains the records in another reading, with what is known of it there, if it explains them in this one as well, and
/// nothing that was found before the search is better.
fn taken_over(case: &Case<'_>, first: &FirstRound, known: &Known<'_>) -> Option<Sound> {
    let Suggested { model, explanation } = known.suggested?;
    let Explanation { classes, confounded } = explanation?;
    case.progress.begin(TESTING, [0.1, 0.95]);
    let here = |model: &Hypothesis| model.moved_to(case);
    let model = here(model);
    if !model.leaves_noise(case) {
        return None;
    }
    let others: Vec<Vec<Hypothesis>> =
        classes.par_iter().map(|class| class.others.iter().map(here).collect()).collect();
    let mut tried: Vec<Hypothesis> = known.model.iter().chain(first.models()).cloned().collect();
    for new in iter::once(&model).chain(others.iter().flatten()) {
        learn(&mut tried, new.clone());
    }
    let mut sound = Sound::of(case, &mut tried);
    if !sound.best.same_effects(&model) {
        return None;
    }
    let stand_ins = |earned: &Earned| {
        let found = classes.iter().zip(&others).find(|(class, _)| class.effect == earned.effect);
        let mut others = found.map_or_else(Vec::new, |(_, others)| others.clone());
        sound.best.keep_stand_ins(case, earned, &mut others);
        others
    };
    sound.stand_ins = sound.earned.iter().map(stand_ins).collect();
    Some(Sound { confounded: confounded.clone(), ..sound })
}

/// The best of a search that ends as soon as what is left of the fitted records may be noise, or with so many effects, and
/// looks for nothing to which no slope leads.
pub(super) fn sketch(case: &Case<'_>, FirstRound { root, grown, .. }: FirstRound, most: usize) -> Hypothesis {
    let case = &case.unkept();
    let mut growth = Growth::new(case, Vec::new(), None);
    let beam = growth.chosen(slice::from_ref(&root), grown);
    growth.run_until(beam, [0.1, 1.0], |best| best.added.len() >= most || within_noise(&best.train.misfit));
    cheapest(growth.tried.iter()).unwrap_or(&root).clone()
}

/// A beam search over effects.
struct Growth<'a> {
    case: &'a Case<'a>,
    /// All that was tried.
    tried: Vec<Hypothesis>,
    /// One that is fitted to these records when as many effects are tried.
    suggested: Option<Suggested<'a>>,
    /// Effects each of which was looked for beside the others.
    looked_again: Vec<Vec<&'static EffectInfo>>,
}

impl<'a> Growth<'a> {
    const fn new(case: &'a Case<'a>, tried: Vec<Hypothesis>, suggested: Option<Suggested<'a>>) -> Self {
        Self { case, tried, suggested, looked_again: Vec::new() }
    }

    /// Grows hypotheses as long as that helps, between two shares of the whole.
    fn run(&mut self, beam: Vec<Hypothesis>, shares: [f64; 2]) {
        self.run_until(beam, shares, |_| false);
    }

    /// The same until the best that was tried will do.
    fn run_until(
        &mut self,
        mut beam: Vec<Hypothesis>,
        [from, to]: [f64; 2],
        mut will_do: impl FnMut(&Hypothesis) -> bool,
    ) {
        while !cheapest(self.tried.iter()).is_some_and(&mut will_do)
            && !beam.is_empty()
            && !self.case.is_over()
        {
            let stage = beam[0].added.len();
            if stage >= MOST_EFFECTS {
                break;
            }
            let label = round(stage);
            let mut grown: Vec<Hypothesis> = Vec::new();
            for (index, hypothesis) in beam.iter_mut().enumerate() {
                if self.case.is_over() {
                    break;
                }
                let share = |index: usize| {
                    from + (stage as f64 + index as f64 / BEAM as f64) / MOST_EFFECTS as f64 * (to - from)
                };
                self.case.progress.begin(&label, [share(index), share(index + 1)]);
                for new in hypothesis.grow(self.case, &self.tried, false) {
                    if !grown.iter().any(|known| known.same_effects(&new)) {
                        grown.push(new);
                    }
                }
            }
            beam = self.chosen(&beam, grown);
        }
    }

    /// Keeps a beam and what grew from it, and says what is grown next: nothing where that would not help.
    fn chosen(&mut self, beam: &[Hypothesis], mut grown: Vec<Hypothesis>) -> Vec<Hypothesis> {
        if let Some(suggested) =
            self.suggested.take_if(|known| known.model.added.len() == beam[0].added.len() + 1)
        {
            learn(&mut grown, suggested.model.refitted(self.case));
        }
        self.tried.retain(|known| !beam.iter().any(|moved| moved.same_effects(known)));
        self.tried.extend(beam.iter().chain(&grown).cloned());
        self.case.keep_models(&self.tried);
        if self.is_beaten() {
            return Vec::new();
        }
        let Self { case, tried, .. } = &*self;
        let scale = least_scale(tried.iter());
        grown.sort_by(|a, b| a.cost(scale).total_cmp(&b.cost(scale)));
        let best = grown.first().map_or(f64::INFINITY, |first| first.cost(scale));
        let settled = beam.iter().all(|parent| parent.cost(scale) <= best);
        grown.retain(|new| new.share_of(&beam[0]) >= GROWING_SHARE);
        if settled || grown.is_empty() {
            return Vec::new();
        }
        // Where the best leaves noise, a further effect can only be hidden in it.
        let is_explained = grown[0].leaves_noise(case);
        if is_explained && grown[0].added.len() >= MOST_EXPLAINED {
            return Vec::new();
        }
        // What does not earn its place is grown last. One effect may need another beside it; where no two of them earn
        // theirs, a third does not make up for it.
        let (mut next, unwelcome): (Vec<_>, Vec<_>) =
            grown.into_iter().partition(|new| new.is_welcome(case, tried));
        if next.is_empty() && unwelcome[0].added.len() > 1 {
            return next;
        }
        next.extend(unwelcome);
        next.truncate(if is_explained { 1 } else { BEAM });
        next
    }

    /// The best of one effect, the one that leaves least first.
    fn singles(&self) -> Vec<Hypothesis> {
        let mut singles: Vec<&Hypothesis> =
            self.tried.iter().filter(|known| known.added.len() == 1).collect();
        singles.sort_by(|a, b| hypothesis::lower(a, b));
        singles.into_iter().take(BEAM).cloned().collect()
    }

    /// Is there an explanation that all records like better than all that was tried? What the fitted ones ask for is looked
    /// for as long as that leaves more than noise of them, if they do not like it better too. Times of jumps make up for an
    /// effect as well as another effect does: what leaves more than noise with them is no better than one effect more is.
    fn is_beaten(&self) -> bool {
        self.case.rival.is_some_and(|rival| {
            let is_as_deep = || self.tried.iter().any(|known| known.added.len() > rival.effects);
            let settled = |asked: &Hypothesis| {
                rival.leaves_noise || within_noise(&asked.train.misfit) || rival.beats_of_fitted(asked)
            };
            (rival.leaves_noise || is_as_deep())
                && self.tried.iter().all(|known| rival.beats(known))
                && asked(&self.tried).is_none_or(settled)
        })
    }

    /// Does something that was tried or is suggested leave noise, of effects that earn their place, is another explanation
    /// cheaper, or is the user in a hurry?
    fn is_done(&self) -> bool {
        let Self { case, tried, suggested, .. } = self;
        let explains = |known: &Hypothesis| known.leaves_noise(case) && known.is_welcome(case, tried);
        // What is suggested was found in other records.
        case.is_over()
            || self.is_beaten()
            || tried.iter().any(explains)
            || suggested.is_some_and(|known| explains(&known.model.taken_to(case)))
    }

    /// What is grown next: where nothing that was tried leaves noise, also what explains the first moments of the records
    /// beside the effects of some models.
    fn or_followed(
        &mut self,
        mut beam: Vec<Hypothesis>,
        bases: &[Hypothesis],
        settings: &FitSettings,
        [from, to]: [f64; 2],
    ) -> Vec<Hypothesis> {
        for (index, base) in bases.iter().enumerate() {
            if self.is_done() {
                break;
            }
            let share = |index: usize| from + index as f64 / bases.len() as f64 * (to - from);
            self.case.progress.begin("following the first moments", [share(index), share(index + 1)]);
            let found = base.followed(self.case, settings);
            if found.is_empty() {
                continue;
            }
            for new in found {
                learn(&mut beam, new);
            }
            self.tried.retain(|known| !beam.iter().any(|new| new.same_effects(known)));
            beam = self.chosen(slice::from_ref(base), beam);
        }
        beam
    }

    /// Where nothing that was tried leaves noise, but one effect takes away nearly all that there was: looks for any other
    /// beside it. The faults may be far off to make up for that one, so that the linear model says nothing of it.
    fn look_beside_the_first(&mut self) {
        if self.is_done() {
            return;
        }
        let Some((mut best, root)) = self.singles().into_iter().next().zip(root(&self.tried)) else { return };
        if best.share_of(root) < NEARLY_ALL {
            return;
        }
        self.case.progress.begin("looking for any effect beside the first", [0.6, 0.65]);
        let grown = best.grow(self.case, &self.tried, true);
        let beam = self.chosen(&[best], grown);
        self.run(beam, [0.6, 0.65]);
    }

    /// Where nothing that was tried leaves noise: looks for each effect of the best beside the others, since each was found
    /// beside fewer, and grows what is better for it, less what it is as good without. Once for the same effects.
    fn look_again(&mut self) {
        if self.is_done() {
            return;
        }
        let case = self.case;
        let several = self.tried.iter().filter(|known| known.added.len() > 1);
        let scale = least_scale(self.tried.iter());
        let best = several.min_by(|a, b| a.cost(scale).total_cmp(&b.cost(scale)));
        let Some(best) = best.filter(|best| !self.looked_again.iter().any(|known| best.is_of(known))) else {
            return;
        };
        self.looked_again.push(best.added.clone());
        case.progress.begin("looking again for what was found", [0.6, 0.65]);
        case.progress.expect(best.added.len());
        let anew = best.added.par_iter().filter_map(|effect| {
            let anew = best.again(case, effect);
            case.progress.fitted(anew.as_ref().map(|anew| anew.train.misfit.mean_square().sqrt()));
            anew
        });
        let anew = anew.min_by(|a, b| a.cost(scale).total_cmp(&b.cost(scale)));
        if let Some(better) = anew.filter(|anew| anew.cost(scale) < best.cost(scale) - TOLD_APART) {
            self.tried.retain(|known| !known.same_effects(&better));
            self.tried.push(better.clone());
            let better =
                if better.leaves_noise(case) { better.pruned(case, &mut self.tried).0 } else { better };
            self.run(vec![better], [0.6, 0.65]);
        }
    }

    /// Where nothing that was tried leaves noise: grows what a search from afar finds to be better than all of it.
    fn run_from_afar(&mut self, settings: &FitSettings) {
        if self.is_done() {
            return;
        }
        let Self { case, tried, .. } = &*self;
        case.progress.begin("searching from afar", [0.65, 0.75]);
        let Some(root) = root(tried).cloned() else { return };
        let found = root.searched(case, settings, tried);
        if found.is_empty() {
            return;
        }
        self.tried.retain(|known| !found.iter().any(|new| new.same_effects(known)));
        let beam = self.chosen(&[root], found);
        self.run(beam, [0.75, 0.9]);
    }
}

/// The best hypothesis whose effects all earn their place.
pub(super) struct Sound {
    /// The model with the declared faults alone.
    pub(super) root: Hypothesis,
    pub(super) best: Hypothesis,
    /// What the fitted records alone speak for.
    pub(super) asked: Hypothesis,
    /// All that was tried with one effect at most.
    pub(super) simple: Vec<Hypothesis>,
    pub(super) earned: Vec<Earned>,
    /// For each of its effects, the hypotheses with another in its place (their newest) that do as well, where effects are a
    /// name.
    pub(super) stand_ins: Vec<Vec<Hypothesis>>,
    /// For each declared fault, the effects whose presence would leave it undetermined.
    pub(super) confounded: Vec<Vec<&'static EffectInfo>>,
}

impl Sound {
    fn of(case: &Case<'_>, tried: &mut Vec<Hypothesis>) -> Self {
        let (best, earned) = soundest(case, tried);
        let root = root(tried).unwrap_or(&best).clone();
        let asked = asked(tried).unwrap_or(&best).clone();
        let simple = tried.iter().filter(|known| known.added.len() <= 1).cloned().collect();
        Self { root, best, asked, simple, earned, stand_ins: Vec::new(), confounded: Vec::new() }
    }

    fn find_stand_ins(&mut self, case: &Case<'_>, tried: &[Hypothesis], settings: &FitSettings) {
        let Self { root, best, earned, .. } = &*self;
        let named = best.is_name(case, &root.rig);
        let stand_ins =
            |earned| if named { best.stand_ins(case, tried, earned, settings) } else { Vec::new() };
        let explains = named && best.leaves_noise(case);
        self.stand_ins = earned.iter().map(stand_ins).collect();
        if explains {
            self.find_stand_ins_for_both(case, tried, settings);
        }
    }

    /// Where two effects leave noise: looks for two others that do as well. The way there is a model that shares one effect
    /// with them and leaves noise, though it may be less likely: what stands in for the shared one, stands in for one of the
    /// two, and what the model has beside it for the other.
    fn find_stand_ins_for_both(&mut self, case: &Case<'_>, tried: &[Hypothesis], settings: &FitSettings) {
        let [first, second] = &self.earned[..] else { return };
        let pair = [first.effect, second.effect];
        let best = &self.best;
        let is_way = |known: &&Hypothesis| {
            known.added.len() == 2 && known.leaves_noise(case) && !known.same_effects(best)
        };
        let ways: Vec<&Hypothesis> =
            tried.iter().chain(self.stand_ins.iter().flatten()).filter(is_way).collect();
        let beyond = |shared: &'static EffectInfo| -> Vec<Hypothesis> {
            let ways = ways.iter().filter(|way| way.has(shared));
            let Some(way) = ways.min_by(|a, b| hypothesis::lower(a, b)) else { return Vec::new() };
            let mut found = way.followed_without(case, shared, settings);
            found.retain(|new| !pair.iter().any(|effect| new.has(effect)) && !best.is_likelier(new));
            found
        };
        let found = pair.map(beyond);
        for (shared, found) in found.into_iter().enumerate() {
            self.stand_ins[1 - shared].extend(found.iter().cloned().map(Hypothesis::reversed));
            self.stand_ins[shared].extend(found);
        }
    }

    /// Are it and the models that it was weighed against the same as those of another one?
    fn is_as(&self, other: &Self) -> bool {
        let fits = |sound: &Self| -> Vec<f64> {
            let without = sound.earned.iter().map(|earned| &earned.without);
            [&sound.root, &sound.best]
                .into_iter()
                .chain(without)
                .map(|fit| fit.joint.misfit.chi_square)
                .collect()
        };
        self.best.same_effects(&other.best) && fits(self) == fits(other)
    }
}

/// The hypothesis of the lowest cost whose effects all earn their place.
fn soundest(case: &Case<'_>, tried: &mut Vec<Hypothesis>) -> (Hypothesis, Vec<Earned>) {
    let scale = least_scale(tried.iter());
    let cost = |(hypothesis, _): &(Hypothesis, Option<Vec<Earned>>)| hypothesis.cost(scale);
    let mut open: Vec<_> = tried.iter().cloned().map(|hypothesis| (hypothesis, None)).collect();
    loop {
        open.sort_by(|a, b| cost(b).total_cmp(&cost(a)));
        let Some((hypothesis, earned)) = open.pop() else { unreachable!("what is popped is pushed again") };
        if let Some(earned) = earned {
            return (hypothesis, earned);
        }
        let (sound, earned) = hypothesis.pruned(case, tried);
        open.push((sound, Some(earned)));
    }
}

/// The model with the declared faults alone.
fn root(tried: &[Hypothesis]) -> Option<&Hypothesis> {
    tried.iter().find(|known| known.added.is_empty())
}

/// The hypothesis that the fitted records alone speak for.
fn asked(tried: &[Hypothesis]) -> Option<&Hypothesis> {
    let scales = tried.iter().map(|known| known.train.misfit.mean_square());
    let scale = scales.fold(f64::INFINITY, f64::min).max(1.0);
    tried.iter().min_by(|a, b| a.cost_of_fitted(scale).total_cmp(&b.cost_of_fitted(scale)))
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::readings::Declared;
    use super::super::signature::tests::{record, sine_and_stairs, with};
    use super::{Case, Growth, Hypothesis, Rival, Suggested, cheapest};
    use crate::fit::{self, FitSettings};
    use crate::rig::{Range, Rig};
    use eha_monitor::effect::EffectInfo;
    use eha_monitor::parameter::Parameter;

    /// A rig with its faults fitted to the records of a case, and some effects in it.
    pub(in super::super) fn model(case: &Case<'_>, rig: &Rig, added: &[&str]) -> Hypothesis {
        let start = [rig.parameters.bkl, rig.parameters.fdj];
        let fit = fit::polish(rig, &rig.faults, &start, case.records).unwrap();
        let added = added.iter().map(|name| EffectInfo::named(name).unwrap()).collect();
        Hypothesis::of(case, rig.clone(), rig.declared(), [fit.clone(), fit], added)
    }

    #[test]
    fn a_rival_with_something_left_is_no_better_than_one_more_effect() {
        let rig = Rig::load("eha").unwrap();
        let records = [record(&with(&rig, Parameter::ConstantLoad, 500.0))];
        let is_beaten = |tried: &[&str], rival: Rival| {
            let case = Case { rival: Some(rival), ..Case::new(&rig, &records, 1) };
            let known = model(&case, &rig, tried);
            Growth::new(&case, vec![known], None).is_beaten()
        };
        let rival = Rival { scale: 2.0, cost: 0.0, cost_of_fitted: 0.0, leaves_noise: false, effects: 1 };
        assert!(!is_beaten(&[], rival));
        assert!(!is_beaten(&["leakage"], rival));
        assert!(is_beaten(&["leakage", "stribeck"], rival));
        assert!(is_beaten(&["leakage"], Rival { leaves_noise: true, ..rival }));
        assert!(!is_beaten(&["leakage", "stribeck"], Rival { cost: f64::INFINITY, ..rival }));
    }

    #[test]
    fn where_held_out_records_speak_against_what_explains_the_fitted_ones_all_are_searched_from_afar() {
        let rig = Rig::load("eha").unwrap();
        let mut truth = with(&rig, Parameter::SpoolOverlap, 30e-6);
        (truth.parameters.bkl, truth.parameters.fdj) = (2e-4, 700.0);
        let records = sine_and_stairs(&truth);
        let case = Case::new(&rig, &records, 1);
        let settings = FitSettings { budget: 100, ..FitSettings::default() };
        let mut root = Declared::from_seeds(&case, &settings, 1).root;
        assert!(root.is_in_doubt());
        // The fitted records alone cannot like anything better.
        root.train.misfit.chi_square = 0.0;
        let known = [root];
        let found = known[0].searched(&case, &settings, &known);
        let best = cheapest(found.iter()).unwrap();
        assert_eq!(best.newest().unwrap().name, "spool-overlap");
        assert!(best.leaves_noise(&case));
    }

    #[test]
    fn what_is_suggested_is_judged_by_the_records_that_are_searched() {
        let rig = Rig::load("eha").unwrap();
        let [light, heavy] = [500.0, 1000.0].map(|load| with(&rig, Parameter::ConstantLoad, load));
        let [whole, other] = [&light, &heavy].map(|truth| [record(truth)]);
        let begin = [whole[0].begin(500)];
        let mut found = model(&Case::new(&rig, &whole, 1), &light, &["constant-load"]);
        // What it predicts for the records in which it was found is another thing.
        found.predictions[0].reverse();
        let is_done = |records: &[fit::Prepared], suggested: Option<&Hypothesis>| {
            let suggested = suggested.map(|model| Suggested { model, explanation: None });
            let case = Case::new(&rig, records, 1);
            let tried = vec![model(&case, &rig, &[])];
            Growth::new(&case, tried, suggested).is_done()
        };
        assert!(!is_done(&begin, None));
        assert!(is_done(&begin, Some(&found)));
        assert!(is_done(&whole, Some(&found)));
        assert!(!is_done(&other, Some(&found)));
    }

    #[test]
    fn what_is_found_again_is_kept_without_what_it_is_as_good_without() {
        let rig = Rig::load("eha").unwrap();
        let truth = with(&with(&rig, Parameter::StepLoad, -1400.0), Parameter::StepLoadTime, 0.3);
        let records = [record(&truth)];
        let case = Case::new(&rig, &records, 1);
        // The load is caught where another jerk of the record is, with a leak beside it that makes up for a part of that.
        let added = ["leakage", "step-load"].map(|name| EffectInfo::named(name).unwrap());
        let late = Range { parameter: Parameter::StepLoadTime, lower: 0.7, upper: 0.9 };
        let [leak, load] = [(Parameter::Leakage, 1e-11), (Parameter::StepLoad, 1e3)]
            .map(|(parameter, size)| Range::around(parameter, 0.0, size));
        let ranges = [&rig.faults[..], &[leak, load, late]].concat();
        let with_both = Rig { effects: added.to_vec(), ..rig.clone() };
        let fit = fit::approach(&with_both, &ranges, &[0.0, 400.0, 1e-12, -500.0, 0.8], &records, 4).unwrap();
        let caught = Hypothesis::of(
            &case,
            fit.applied(&with_both, &ranges),
            ranges,
            [fit.clone(), fit],
            added.to_vec(),
        );
        let mut growth = Growth::new(&case, vec![model(&case, &rig, &[]), caught.clone()], None);
        growth.look_again();
        assert!(growth.is_done());
        let best = cheapest(growth.tried.iter()).unwrap();
        assert!(best.is_of(&added[1..]), "{:?}", best.added);
        let time = best.rig.parameters.get(Parameter::StepLoadTime);
        assert!((time - 0.3).abs() < 1e-3, "{time}");
        // The same effects are looked for once.
        growth.tried = vec![model(&case, &rig, &[]), caught];
        let before = fit::spent_s(&records);
        growth.look_again();
        assert!(!growth.is_done());
        assert!(fit::spent_s(&records) - before < 1e-3);
    }

    #[test]
    fn what_is_suggested_is_grown_when_as_many_effects_are() {
        let rig = Rig::load("eha").unwrap();
        let truth = with(&rig, Parameter::ConstantLoad, 500.0);
        let records = [record(&truth)];
        let case = Case::new(&rig, &records, 1);
        let root = model(&case, &rig, &[]);
        let [one, other] =
            [&["constant-load"][..], &["constant-load", "leakage"]].map(|added| model(&case, &truth, added));
        let names = |suggested: Option<&Hypothesis>| -> Vec<&str> {
            let suggested = suggested.map(|model| Suggested { model, explanation: None });
            let mut growth = Growth::new(&case, Vec::new(), suggested);
            let beam = growth.chosen(std::slice::from_ref(&root), Vec::new());
            assert_eq!(growth.suggested.is_some(), beam.is_empty() && suggested.is_some());
            beam.iter().flat_map(|model| &model.added).map(|effect| effect.name).collect()
        };
        assert_eq!(names(Some(&one)), ["constant-load"]);
        assert_eq!(names(Some(&other)), [""; 0]);
        assert_eq!(names(None), [""; 0]);
    }
}
