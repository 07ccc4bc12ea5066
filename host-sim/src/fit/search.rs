//! The search for what fits records best: genetic first, then Gauss-Newton.

use super::engine::{self, FIT_TOLERANCE, Job, on_records};
use super::estimate::{estimates, in_units};
use super::visits::{InAll, generations, note_visits};
use super::{BETTER_VALLEY, Fit, MAX_FREE, MAX_POPULATION, Prepared, Visit};
use super::{longest_correlation_time, noise, polish, pooled, residual_series, systematic};
use crate::interrupt;
use crate::rig::{Range, Rig};
use eha_monitor::fit::identify::{self, Identification, Progress, StopReason};
use eha_monitor::fit::problem::Problem;
use eha_monitor::integrate::Stepper;
use nalgebra::SMatrix;
use rayon::prelude::*;
use std::iter;
use std::time::Instant;

/// How a fit is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitSettings {
    /// Seed of all randomness.
    pub seed: u64,
    /// Members of the population.
    pub population: usize,
    /// Most evaluations of the model in one search; a finish that has begun is completed.
    pub budget: u32,
}

impl Default for FitSettings {
    fn default() -> Self {
        let search = identify::Settings::<f64>::default();
        Self { seed: 1, population: search.search.population, budget: search.budget }
    }
}

/// Where a fit stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing {
    /// Evaluations of the model so far.
    pub evaluations: u32,
    /// Most evaluations.
    pub budget: u32,
    /// Generations so far.
    pub generations: u32,
    /// Best cost so far: root of the mean square in units of the noise.
    pub best_sigma: f64,
}

/// Fits the ranges to the records.
///
/// At most [`MAX_FREE`] ranges are used.
pub fn fit(
    rig: &Rig,
    ranges: &[Range],
    records: &[Prepared],
    settings: &FitSettings,
    mut watch: impl FnMut(Standing),
) -> Fit {
    on_records(rig, ranges, records, FIT_TOLERANCE, Search { settings, near: None, watch: &mut watch })
}

/// Fits the ranges to the records; where that leaves more than noise, `seeds` fits that differ in their seed are made,
/// and the one with the deepest valley is it. `watch` is told where each of them stands.
pub fn fit_from_seeds(
    rig: &Rig,
    ranges: &[Range],
    records: &[Prepared],
    settings: &FitSettings,
    seeds: u64,
    watch: impl Fn(Standing) + Sync,
) -> Fit {
    let first = fit(rig, ranges, records, settings, &watch);
    or_from_seeds(first, rig, ranges, records, settings, seeds, watch).settled(rig, ranges, records)
}

/// A fit; where it leaves more than noise, the one with the deepest valley of it and those from more seeds, with the effort
/// of all of them. It is interrupted if one of them is.
pub(super) fn or_from_seeds(
    first: Fit,
    rig: &Rig,
    ranges: &[Range],
    records: &[Prepared],
    settings: &FitSettings,
    seeds: u64,
    watch: impl Fn(Standing) + Sync,
) -> Fit {
    if first.stop == StopReason::NoiseReached || first.interrupted {
        return first;
    }
    let started = Instant::now();
    let from = |seed| fit(rig, ranges, records, &FitSettings { seed, ..*settings }, &watch);
    let others = (1..seeds).into_par_iter().map(|more| from(settings.seed.wrapping_add(more))).collect();
    deepest(first, others, settings, started)
}

/// The one with the deepest valley of a fit and others of the same records, which were made side by side since a time, with
/// the effort of all of them.
pub(super) fn deepest(first: Fit, others: Vec<Fit>, settings: &FitSettings, since: Instant) -> Fit {
    let before = first.seconds;
    let mut all: Vec<Fit> = iter::once(first).chain(others).collect();
    let mut in_all = InAll::default();
    for (search, fit) in all.iter_mut().enumerate() {
        in_all.add(fit, |visit| Visit { search, ..visit });
    }
    let better = |best: Fit, other: Fit| {
        if other.misfit.chi_square < best.misfit.chi_square - BETTER_VALLEY { other } else { best }
    };
    let first = all.remove(0);
    let best = all.into_iter().fold(first, better);
    let InAll { visits, evaluations, interrupted } = in_all;
    Fit {
        generations: generations(&visits, settings.population),
        seconds: before + since.elapsed().as_secs_f64(),
        visits,
        evaluations,
        interrupted,
        ..best
    }
}

/// Fits the ranges to the records where some values, one for each range, are known to be good: the search has them from
/// the start. `watch` is told where it stands.
pub fn fit_near(
    rig: &Rig,
    ranges: &[Range],
    values: &[f64],
    records: &[Prepared],
    settings: &FitSettings,
    mut watch: impl FnMut(Standing),
) -> Fit {
    let search = Search { settings, near: Some(values), watch: &mut watch };
    on_records(rig, ranges, records, FIT_TOLERANCE, search)
}

/// Whom it is told is not a type of its own: the search is compiled once for each integrator, not for each listener as well.
struct Search<'a> {
    settings: &'a FitSettings,
    near: Option<&'a [f64]>,
    watch: &'a mut dyn FnMut(Standing),
}

impl Job for Search<'_> {
    type Output = Fit;

    fn run<S: Stepper<f64>>(self, problem: &Problem<'_, f64>, steppers: &mut [S]) -> Fit {
        search(problem, self.settings, self.near, steppers, self.watch)
    }
}

fn search<S: Stepper<f64>>(
    problem: &Problem<'_, f64>,
    settings: &FitSettings,
    near: Option<&[f64]>,
    steppers: &mut [S],
    watch: &mut dyn FnMut(Standing),
) -> Fit {
    let started = Instant::now();
    let mut core_settings = identify::Settings { budget: settings.budget, ..identify::Settings::default() };
    core_settings.search.population = settings.population;
    let mut identification =
        Identification::<f64, MAX_FREE, MAX_POPULATION>::new(problem, core_settings, settings.seed)
            .expect("what is free is counted where a problem is made");
    if let Some(values) = near {
        identification.suggest(problem, &polish::genes_of(problem, values), &mut steppers[0]);
    }
    let mut visits = Vec::new();
    let mut searching = 0.0;
    let mut interrupted = false;
    let stop = loop {
        if interrupt::requested() && !visits.is_empty() {
            interrupted = true;
            break StopReason::Budget;
        }
        let before = started.elapsed().as_secs_f64();
        let progress = identification.advance(problem, steppers);
        let best = identification.search().best().map_or(f64::INFINITY, |(_, cost)| cost);
        match progress {
            Progress::Done(reason) => break reason,
            Progress::Filled | Progress::Child(_) => searching += started.elapsed().as_secs_f64() - before,
            Progress::Finished => {}
        }
        note_visits(&mut visits, problem, &identification, progress);
        watch(Standing {
            evaluations: identification.evaluations(),
            budget: settings.budget,
            generations: generations(&visits, settings.population),
            best_sigma: best.sqrt(),
        });
    };
    let best = identification.search().best().map_or([0.0; MAX_FREE], |(genes, _)| *genes);
    let genes = identification.result().map_or(best, |finish| finish.genes);
    let unknown = SMatrix::from_element(f64::NAN);
    let covariance = identification.result().map_or(unknown, |finish| polish::covariance_of(&finish.normal));
    let misfit = match identification.result() {
        Some(finish) => finish.normal.misfit,
        None => problem.misfit(&genes, &mut steppers[0]),
    };
    let predictions = engine::trace(problem, &genes, &mut steppers[0]);
    let (inflation, systematic) = if stop == StopReason::NoiseReached {
        (1.0, systematic::of_genes(problem, &genes, &covariance, steppers))
    } else {
        let left = |channel| residual_series(problem.records, &predictions, channel);
        let repeats = longest_correlation_time(left);
        (misfit.mean_square().max(1.0) * repeats, [0.0; MAX_FREE])
    };
    let covariance = in_units(problem, &covariance, inflation);
    let estimates = estimates(problem, &genes, &covariance, &systematic);
    let children = identification.counters().evaluations.max(1);
    Fit {
        estimates,
        covariance,
        parameters: problem.parameters_of(&genes),
        misfit,
        residual_rms: noise::residual_rms(problem.records, &predictions),
        predictions,
        noise: pooled(problem.records.iter().map(|record| record.noise)),
        evaluations: identification.evaluations(),
        generations: generations(&visits, settings.population),
        seconds: started.elapsed().as_secs_f64(),
        seconds_per_generation: searching / f64::from(children) * settings.population as f64,
        stop,
        interrupted,
        visits,
        reading: 0,
        inflation,
    }
}
