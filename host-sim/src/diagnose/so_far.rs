//! What a diagnosis has found so far: its answer where the user ends it.
//!
//! What is being done then is left where it is (see [`unless_interrupted`](crate::fit::unless_interrupted)), so that nothing
//! comes of it but what was kept here. The answer is put together of that, and claims nothing that was not looked at.

use super::case::Case;
use super::conclusion::{Open, conclude};
use super::diagnosis::{Diagnosis, Reached};
use super::hypothesis::Hypothesis;
use super::search::cheapest;
use super::weighing::Earned;
use crate::fit::{Fit, Reading};
use eha_monitor::fit::identify::StopReason;
use std::sync::{Mutex, PoisonError};

/// Where a diagnosis keeps what it has found.
pub(super) struct SoFar(Mutex<Kept>);

/// The most that was found.
enum Kept {
    /// The declared faults, fitted to the fitted records.
    Declared(Box<Fit>),
    /// Models of a reading of the records.
    Models(Box<Models>),
    /// An answer, before others were looked for in its place.
    Answer(Box<Diagnosis>),
}

/// What was found in a reading of the records.
struct Models {
    reading: Reading,
    /// The declared faults, and the model with these alone.
    declared: Fit,
    root: Hypothesis,
    /// All that was tried, in excerpts where the records are long.
    tried: Vec<Hypothesis>,
}

impl SoFar {
    /// With the declared faults, fitted to the fitted records of a case.
    pub(super) fn new(declared: Fit) -> Self {
        Self(Mutex::new(Kept::Declared(Box::new(declared))))
    }

    fn change(&self, change: impl FnOnce(&mut Kept)) {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// The answer to the case that it was kept for.
    pub(super) fn concluded(self, case: &Case<'_>) -> Diagnosis {
        match self.0.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Kept::Declared(fit) => of_declared(case, *fit),
            Kept::Models(models) => models.concluded(case),
            Kept::Answer(diagnosis) => diagnosis.interrupted(Reached::Answer),
        }
    }
}

impl Case<'_> {
    /// Keeps what is found in this reading of the records from now on, if that is kept of this case.
    pub(super) fn keep_reading(&self, declared: &Fit, root: &Hypothesis) {
        if let Some(so_far) = self.so_far {
            let reading = Reading { rig: self.rig.clone(), records: self.records.to_vec() };
            let (declared, root) = (declared.clone(), root.clone());
            let models = Models { reading, declared, root, tried: Vec::new() };
            so_far.change(|kept| *kept = Kept::Models(Box::new(models)));
        }
    }

    /// Keeps the models that were tried in the reading that is kept, if they are kept of this case.
    pub(super) fn keep_models<'a>(&self, models: impl IntoIterator<Item = &'a Hypothesis>) {
        if let Some(so_far) = self.so_far {
            so_far.change(|kept| {
                if let Kept::Models(kept) = kept {
                    kept.tried = models.into_iter().cloned().collect();
                }
            });
        }
    }

    /// Keeps an answer, if that is kept of this case.
    pub(super) fn keep_answer(&self, diagnosis: &Diagnosis) {
        if let Some(so_far) = self.so_far {
            so_far.change(|kept| *kept = Kept::Answer(Box::new(diagnosis.clone())));
        }
    }

    /// This case where nothing is kept of what is looked for in it.
    pub(super) fn unkept(&self) -> Self {
        Self { so_far: None, ..*self }
    }
}

/// The answer that a fit of the declared faults to the fitted records is: the held-out ones have no say in it.
fn of_declared(case: &Case<'_>, fit: Fit) -> Diagnosis {
    let fitted = Case { records: case.train(), ..*case };
    let (ranges, both) = (case.rig.declared(), [fit.polished(), fit.polished()]);
    let root = Hypothesis::of(&fitted, fit.applied(case.rig), ranges, both, Vec::new());
    let has_ended = !fit.interrupted || fit.stop == StopReason::NoiseReached;
    let reached = if has_ended { Reached::Declared } else { Reached::Search };
    let diagnosis = with_declared_alone(&fitted, fit, &root).interrupted(reached);
    Diagnosis { records: case.records.to_vec(), ..diagnosis }
}

/// The answer of the model with the declared faults alone, with the values and the intervals of their fit.
fn with_declared_alone(case: &Case<'_>, fit: Fit, root: &Hypothesis) -> Diagnosis {
    let estimates = fit.estimates.clone();
    let mut diagnosis = conclude(case, fit, root, &[], &Open::unasked(case, 0));
    let of_faults = diagnosis.faults.iter_mut().map(|fault| &mut fault.estimate);
    for (own, of_fit) in of_faults.chain(&mut diagnosis.free).zip(estimates) {
        *own = of_fit;
    }
    diagnosis
}

impl Models {
    /// The best model whose effects all earn their place, as far as that can be said without another fit, if these are a name
    /// for what is there: the held-out records have not said yet which terms help.
    fn concluded(self, case: &Case<'_>) -> Diagnosis {
        let case = &case.read_as(&self.reading, "");
        let Self { declared, root, .. } = &self;
        let named = self.accepted(case).filter(|(model, _)| model.is_name(case, &declared.applied(case.rig)));
        let diagnosis = match named {
            Some((model, earned)) => {
                let open = Open { named: true, ..Open::unasked(case, earned.len()) };
                conclude(case, declared.clone(), &model, &earned, &open)
            }
            None if root.leaves_noise(case) => {
                conclude(case, declared.clone(), root, &[], &Open::unasked(case, 0))
            }
            None => with_declared_alone(case, declared.clone(), root),
        };
        diagnosis.interrupted(Reached::Models)
    }

    /// That model, in the whole of the records, where it fits these better than the declared faults alone.
    fn accepted(&self, case: &Case<'_>) -> Option<(Hypothesis, Vec<Earned>)> {
        let excerpts = case.excerpts();
        let searched = case.searched(excerpts.as_deref());
        let is_weighed = |model: &&Hypothesis| {
            model.added.iter().all(|effect| model.known_without(effect, &self.tried).is_some())
        };
        let is_sound = |model: &&Hypothesis| is_weighed(model) && model.is_welcome(&searched, &self.tried);
        let best = cheapest(self.tried.iter().filter(is_sound)).filter(|best| !best.added.is_empty())?;
        let earned = best.weighed(&searched, &self.tried);
        let whole = if excerpts.is_some() { best.taken_to(case) } else { best.clone() };
        (whole.joint.misfit.chi_square < self.root.joint.misfit.chi_square).then_some((whole, earned))
    }
}
