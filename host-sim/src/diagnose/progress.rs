//! Where a diagnosis stands, for who waits for it.

use crate::fit::Standing;
use std::sync::{Mutex, PoisonError};

/// What is told of a diagnosis that runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// What is being done.
    pub doing: String,
    /// How much of the whole is done, 0 to 1: it never falls. What will have to be done is not known ahead.
    pub share: f64,
    /// How many of how many fits it has made; 0 of 0 where they are not counted.
    pub fits: [usize; 2],
    /// Least that a model has left of the fitted records so far, rms in units of their noise; infinite before the first.
    pub best_sigma: f64,
}

/// Who is told.
pub type Watch<'a> = &'a (dyn Fn(&Stage) + Sync);

/// Keeps where a diagnosis stands. It changes nothing about what is found.
pub(super) struct Log<'a> {
    watch: Watch<'a>,
    /// The stage, and between which shares of the whole it is.
    now: Mutex<(Stage, [f64; 2])>,
}

impl<'a> Log<'a> {
    pub(super) const fn new(watch: Watch<'a>) -> Self {
        let stage = Stage { doing: String::new(), share: 0.0, fits: [0; 2], best_sigma: f64::INFINITY };
        Self { watch, now: Mutex::new((stage, [0.0, 1.0])) }
    }

    /// Changes the stage, and tells it; `share` says how much of it is done then.
    fn change(&self, change: impl FnOnce(&mut Stage, &mut [f64; 2]) -> f64) {
        let mut now = self.now.lock().unwrap_or_else(PoisonError::into_inner);
        let (stage, range) = &mut *now;
        let share = change(stage, range).clamp(0.0, 1.0);
        stage.share = stage.share.max(range[0] + share * (range[1] - range[0]));
        (self.watch)(stage);
    }
}

/// A part of a diagnosis that tells where it stands.
#[derive(Clone, Copy)]
pub(super) struct Progress<'a> {
    log: Option<&'a Log<'a>>,
    /// Between which shares of the whole it is.
    range: [f64; 2],
    /// How it takes the records.
    reading: &'static str,
}

impl<'a> Progress<'a> {
    /// Of what nobody waits for.
    pub(super) const SILENT: Self = Self { log: None, range: [0.0, 1.0], reading: "" };

    pub(super) const fn of(log: &'a Log<'a>) -> Self {
        Self { log: Some(log), ..Self::SILENT }
    }

    /// A part of this part, which takes the records in some way.
    pub(super) fn part(self, range: [f64; 2], reading: &'static str) -> Self {
        let reading = if reading.is_empty() { self.reading } else { reading };
        Self { range: self.shares(range), reading, ..self }
    }

    /// Some shares of this part as shares of the whole.
    fn shares(self, of_part: [f64; 2]) -> [f64; 2] {
        let [from, to] = self.range;
        of_part.map(|share| from + share * (to - from))
    }

    /// Something is begun that takes the diagnosis from one share of this part to another.
    pub(super) fn begin(self, what: &str, range: [f64; 2]) {
        let Some(log) = self.log else { return };
        let range = self.shares(range);
        let best_sigma = log.now.lock().unwrap_or_else(PoisonError::into_inner).0.best_sigma;
        let doing = format!("{what}{}", self.reading);
        log.change(|stage, of_whole| {
            *stage = Stage { doing, fits: [0; 2], best_sigma, share: stage.share };
            *of_whole = range;
            0.0
        });
    }

    /// What was begun makes so many fits next.
    pub(super) fn expect(self, fits: usize) {
        let Some(log) = self.log else { return };
        log.change(|stage, _| {
            stage.fits = [0, fits];
            0.0
        });
    }

    /// A fit was made that leaves so much of the fitted records, rms in units of their noise, if it leads anywhere.
    pub(super) fn fitted(self, sigma: Option<f64>) {
        let Some(log) = self.log else { return };
        log.change(|stage, _| {
            stage.best_sigma = stage.best_sigma.min(sigma.unwrap_or(f64::INFINITY));
            stage.fits[0] = (stage.fits[0] + 1).min(stage.fits[1]);
            stage.fits[0] as f64 / stage.fits[1].max(1) as f64
        });
    }

    /// A genetic search stands somewhere.
    pub(super) fn searched(self, standing: Standing) {
        let Some(log) = self.log else { return };
        log.change(|stage, _| {
            stage.best_sigma = stage.best_sigma.min(standing.best_sigma);
            f64::from(standing.evaluations) / f64::from(standing.budget.max(1))
        });
    }
}

#[cfg(test)]
mod tests {
    use super::{Log, Progress, Stage};
    use crate::fit::Standing;
    use std::sync::Mutex;

    #[test]
    fn what_is_told_counts_up_keeps_the_best_and_never_falls() {
        let told: Mutex<Vec<Stage>> = Mutex::new(Vec::new());
        let watch = |stage: &Stage| told.lock().unwrap().push(stage.clone());
        let log = Log::new(&watch);
        let half = Progress::of(&log).part([0.0, 0.5], ", on lines");
        half.begin("fitting", [0.0, 0.5]);
        half.searched(Standing { evaluations: 100, budget: 400, generations: 5, best_sigma: 3.0 });
        half.begin("trying", [0.5, 1.0]);
        half.expect(4);
        half.fitted(Some(4.0));
        half.fitted(None);
        // Another round of the same: what is done is not undone.
        half.expect(2);
        half.fitted(Some(1.5));
        half.fitted(Some(2.0));
        half.fitted(Some(2.0));
        let told = told.into_inner().unwrap();
        let shares: Vec<f64> = told.iter().map(|stage| stage.share).collect();
        assert_eq!(shares, [0.0, 0.0625, 0.25, 0.25, 0.3125, 0.375, 0.375, 0.375, 0.5, 0.5]);
        let best: Vec<f64> = told.iter().map(|stage| stage.best_sigma).collect();
        assert_eq!(best[1..], [3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 1.5, 1.5, 1.5]);
        let fits: Vec<[usize; 2]> = told.iter().map(|stage| stage.fits).collect();
        assert_eq!(fits[3..], [[0, 4], [1, 4], [2, 4], [0, 2], [1, 2], [2, 2], [2, 2]]);
        assert_eq!([told[1].doing.as_str(), &told[4].doing], ["fitting, on lines", "trying, on lines"]);
        // Of what nobody waits for, nothing is told.
        Progress::SILENT.begin("fitting", [0.0, 1.0]);
    }
}
