//! From records and a rig to fitted parameters: the bridge to the core's search.

mod bounds;
mod closed_loop;
mod colour;
mod correlation;
pub mod engine;
mod limits;
mod noise;
mod periodogram;
mod polish;
mod prepare;
mod systematic;
mod valley;
mod visits;

pub use bounds::{Bounds, remarks};
pub use closed_loop::{LoopScore, loop_score};
pub use colour::{as_white, colour_of};
pub use correlation::Correlation;
pub use limits::{CLIPPED, at_ends, extent, share_at_ends};
pub use noise::{
    COARSE, LaggedProducts, MODEL_ERROR, NoiseSource, SMALLEST_NOISE, TYPICAL_NOISE, correlation_time,
    differences, fourth_differences, noise_of, noise_of_series, noise_source, pooled, present, quantum,
    residual_series, rms,
};
pub use periodogram::periodograms;
pub use polish::{Polished, approach, foresee, misfit, misfit_within, polish};
pub use prepare::{Prepared, prepare, prepare_with};
pub use systematic::standard_errors;
pub use valley::Valley;
pub use visits::Visit;

use crate::interrupt;
use crate::record::Record;
use crate::rig::{CommandPath, Range, Rig};
use eha_monitor::channel::Channel;
use eha_monitor::fit::identify::{self, Identification, Progress, StopReason};
use eha_monitor::fit::problem::{Free, Misfit, Problem};
use eha_monitor::integrate::Stepper;
use eha_monitor::model::state::Outputs;
use eha_monitor::parameter::{Parameter, Parameters};
use engine::{FIT_TOLERANCE, Job, LOOK_TOLERANCE, on_records};
use nalgebra::SMatrix;
use rayon::prelude::*;
use std::time::Instant;
use visits::{generations, note_visits};

/// Most parameters that one fit may free.
pub const MAX_FREE: usize = 16;
/// Most members of a population.
pub const MAX_POPULATION: usize = 64;

/// Standard errors to each side that hold the true value in 95 of 100 cases.
pub const OF_95: f64 = 1.96;

/// Fall of chi-square from which a valley is another one.
pub const BETTER_VALLEY: f64 = 1.0;

/// Twice the logarithm of the odds (100 to 1) below which two models of as many parameters are not told apart.
pub const TOLD_APART: f64 = 9.2;

/// Share of what one reading leaves beyond noise that another must undercut to be taken though it leaves more than noise
/// itself.
const SHARE_LEFT: f64 = 0.5;

/// Seeds from which records are searched where the first leaves more than noise.
const MORE_SEEDS: u64 = 4;

/// How a fit is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitSettings {
    /// Seed of all randomness.
    pub seed: u64,
    /// Members of the population.
    pub population: usize,
    /// Most evaluations of the model.
    pub budget: u32,
}

impl Default for FitSettings {
    fn default() -> Self {
        let search = identify::Settings::<f64>::default();
        Self { seed: 1, population: search.search.population, budget: search.budget }
    }
}

/// A fitted parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Which parameter.
    pub parameter: Parameter,
    /// Its value.
    pub value: f64,
    /// Its standard error; not finite where the records say nothing about it.
    pub standard_error: f64,
    /// Interval that holds the true value in 95 of 100 cases, cut to the range of the search.
    pub ci95: [f64; 2],
}

impl Estimate {
    /// An estimate with its interval.
    pub fn new(range: &Range, value: f64, standard_error: f64) -> Self {
        Self {
            parameter: range.parameter,
            value,
            standard_error,
            ci95: [
                (value - OF_95 * standard_error).max(range.lower),
                (value + OF_95 * standard_error).min(range.upper),
            ],
        }
    }

    /// The standard error that its interval speaks of, on its wider side.
    pub fn spread(&self) -> f64 {
        (self.ci95[1] - self.value).max(self.value - self.ci95[0]) / OF_95
    }

    /// Widens the interval to hold that of another estimate, which may be right as well.
    pub fn hold(&mut self, other: &Self) {
        self.ci95 = [self.ci95[0].min(other.ci95[0]), self.ci95[1].max(other.ci95[1])];
    }
}

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

    /// The fit at the bottom of its valley, and with the intervals that this leaves open, where it leaves noise.
    fn settled(self, rig: &Rig, ranges: &[Range], records: &[Prepared]) -> Self {
        if self.stop != StopReason::NoiseReached {
            return self;
        }
        let valley = Valley::around(rig, ranges, &self.polished(), records, ranges.len());
        let bottom = &valley.bottom;
        let mut settled = if bottom.misfit == self.misfit {
            self
        } else {
            on_records(rig, ranges, records, FIT_TOLERANCE, Moved { fit: self, bottom })
        };
        valley.widen(&mut settled.estimates);
        settled
    }

    /// What a fit without a search would have given there.
    pub fn polished(&self) -> Polished {
        Polished {
            values: self.estimates.iter().map(|estimate| estimate.value).collect(),
            misfit: self.misfit,
            covariance: self.covariance.clone(),
        }
    }

    /// Widens the intervals to hold those of another fit, which may be right as well; does one grow by more than its
    /// standard error?
    fn hold(&mut self, other: &Self) -> bool {
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

/// A fit; where it leaves more than noise, the one with the deepest valley of it and those from more seeds.
fn or_from_seeds(
    first: Fit,
    rig: &Rig,
    ranges: &[Range],
    records: &[Prepared],
    settings: &FitSettings,
    seeds: u64,
    watch: impl Fn(Standing) + Sync,
) -> Fit {
    if first.stop == StopReason::NoiseReached {
        return first;
    }
    let from = |seed| fit(rig, ranges, records, &FitSettings { seed, ..*settings }, &watch);
    let others: Vec<Fit> =
        (1..seeds).into_par_iter().map(|more| from(settings.seed.wrapping_add(more))).collect();
    let better = |best: Fit, other: Fit| {
        if other.misfit.chi_square < best.misfit.chi_square - BETTER_VALLEY { other } else { best }
    };
    others.into_iter().fold(first, better)
}

/// Fits the ranges to the records where some values, one for each range, are known to be good: the search has them from
/// the start.
pub fn fit_near(
    rig: &Rig,
    ranges: &[Range],
    values: &[f64],
    records: &[Prepared],
    settings: &FitSettings,
) -> Fit {
    let search = Search { settings, near: Some(values), watch: &mut |_| {} };
    on_records(rig, ranges, records, FIT_TOLERANCE, search)
}

/// Records, and the rig that they are read with.
#[derive(Clone)]
pub struct Reading {
    /// The rig: it says what the command does between its samples, and when the spool sticks.
    pub rig: Rig,
    /// The records as that takes them.
    pub records: Vec<Prepared>,
}

impl Reading {
    /// The readings that a rig leaves open, its own first: a command that goes from sample to sample on straight lines or
    /// on a curve, and a spool that slides until its driving force has fallen to the sliding friction, or sticks as soon as
    /// that force would not set it going.
    pub fn all(rig: &Rig, records: &[Prepared]) -> Vec<Self> {
        let mut all = vec![Self { rig: rig.clone(), records: records.to_vec() }];
        all.extend(curved(rig, records));
        let sticking = |reading: &Self| {
            let records = reading.records.clone();
            reading.rig.with_sticking_spool().map(|rig| Self { rig, records })
        };
        let others: Vec<Self> = all.iter().filter_map(sticking).collect();
        all.extend(others);
        all
    }
}

/// A fit of records in the reading that they speak for.
pub struct AsRead {
    /// The reading.
    pub reading: Reading,
    /// The fit, with the effort of all readings. Its intervals hold those of the others that may be it as well.
    pub fit: Fit,
    /// Did another reading do as well, and widen an interval by more than a standard error?
    pub is_open: bool,
}

/// Fits the ranges to records in every reading that the rig leaves open. Where that leaves more than noise in all of them,
/// each is fitted from more seeds: a search may have ended in a wrong valley.
pub fn fit_as_read(
    rig: &Rig,
    ranges: &[Range],
    records: &[Prepared],
    settings: &FitSettings,
    watch: impl Fn(Standing) + Sync,
) -> AsRead {
    let mut fitted: Vec<(Reading, Fit)> = Vec::new();
    for reading in Reading::all(rig, records) {
        if fitted.iter().any(|(_, fit)| fit.interrupted) {
            break;
        }
        let fit = fit(&reading.rig, ranges, &reading.records, settings, &watch);
        fitted.push((reading, fit));
    }
    let is_known = fitted.iter().any(|(_, fit)| fit.interrupted || fit.stop == StopReason::NoiseReached);
    let seeds = if is_known { 1 } else { MORE_SEEDS };
    let settled = |(reading, first): (Reading, Fit)| {
        let Reading { rig, records } = &reading;
        let fit = or_from_seeds(first, rig, ranges, records, settings, seeds, &watch);
        let fit = fit.settled(rig, ranges, records);
        (reading, fit)
    };
    let mut fitted: Vec<(Reading, Fit)> = fitted.into_iter().map(settled).collect();
    let misfits: Vec<Misfit<f64>> = fitted.iter().map(|(_, fit)| fit.misfit).collect();
    let mut chosen = speaks_for(&misfits);
    if fitted[chosen].1.interrupted {
        chosen = 0;
    }
    let mut visits: Vec<Visit> = Vec::new();
    let mut evaluations = 0;
    for (reading, (_, fit)) in fitted.iter_mut().enumerate() {
        let in_all = |visit: Visit| Visit { evaluations: evaluations + visit.evaluations, reading, ..visit };
        visits.extend(fit.visits.drain(..).map(in_all));
        evaluations += fit.evaluations;
    }
    let generations = generations(&visits, settings.population);
    let seconds = fitted.iter().map(|(_, fit)| fit.seconds).sum();
    let interrupted = fitted.iter().any(|(_, fit)| fit.interrupted);
    let (reading, fit) = fitted.swap_remove(chosen);
    let mut fit = Fit { evaluations, generations, seconds, interrupted, visits, reading: chosen, ..fit };
    let mut is_open = false;
    for (_, other) in &fitted {
        is_open |= gain_of(&fit.misfit, &other.misfit).abs() <= TOLD_APART && fit.hold(other);
    }
    AsRead { reading, fit, is_open }
}

/// Would the ranges fit the records down to the noise if their commands had been recorded one sample earlier? Then that is
/// what is wrong with them: no actuator answers a command that is still to come.
pub fn is_command_late(rig: &Rig, ranges: &[Range], records: &[Record], settings: &FitSettings) -> bool {
    let earlier: Vec<Prepared> =
        records.iter().map(|record| prepare(rig, &record.with_earlier_command())).collect();
    let moved = fit_as_read(rig, ranges, &earlier, settings, |_| {});
    moved.fit.stop == StopReason::NoiseReached
}

/// Of misfits of the same model in several readings, the place of the one that the records speak for: the first, unless
/// another is told apart from it, and leaves noise, or far less beyond it.
pub fn speaks_for(misfits: &[Misfit<f64>]) -> usize {
    let beyond_noise = |misfit: &Misfit<f64>| misfit.mean_square() - 1.0;
    let is_better = |now: &Misfit<f64>, other: &Misfit<f64>| {
        let leaves_less =
            identify::within_noise(other) || beyond_noise(other) < SHARE_LEFT * beyond_noise(now);
        leaves_less && gain_of(now, other) > TOLD_APART
    };
    let mut best = 0;
    for (place, misfit) in misfits.iter().enumerate().skip(1) {
        if is_better(&misfits[best], misfit) {
            best = place;
        }
    }
    best
}

/// Fall of chi-square from one reading to another, in units of the mean square that the better one leaves.
fn gain_of(one: &Misfit<f64>, other: &Misfit<f64>) -> f64 {
    let scale = one.mean_square().min(other.mean_square()).max(1.0);
    (one.chi_square - other.chi_square) / scale
}

/// The rig and its records with the command on a curve between its samples. None where the rig does not leave the path
/// open, and where the curve is no other than the straight lines.
pub fn curved(rig: &Rig, records: &[Prepared]) -> Option<Reading> {
    if rig.command_path != CommandPath::Open {
        return None;
    }
    let curved = Rig { command_path: CommandPath::Curve, ..rig.clone() };
    let other: Vec<Prepared> = records.iter().map(|record| record.along(&curved)).collect();
    let differs = other.iter().zip(records).any(|(curve, lines)| !curve.flies_as(lines));
    differs.then_some(Reading { rig: curved, records: other })
}

/// What a model with given parameters predicts for each record.
pub fn predict(rig: &Rig, records: &[Prepared]) -> Vec<Vec<Outputs<f64>>> {
    on_records(rig, &[], records, FIT_TOLERANCE, Trace)
}

/// What a model predicts for each record, roughly ([`LOOK_TOLERANCE`]).
pub fn glimpse(rig: &Rig, records: &[Prepared]) -> Vec<Vec<Outputs<f64>>> {
    on_records(rig, &[], records, LOOK_TOLERANCE, Trace)
}

struct Trace;

impl Job for Trace {
    type Output = Vec<Vec<Outputs<f64>>>;

    fn run<S: Stepper<f64>>(self, problem: &Problem<'_, f64>, steppers: &mut [S]) -> Self::Output {
        engine::trace(problem, &[], &mut steppers[0])
    }
}

struct Search<'a, W> {
    settings: &'a FitSettings,
    near: Option<&'a [f64]>,
    watch: &'a mut W,
}

impl<W: FnMut(Standing)> Job for Search<'_, W> {
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
    watch: &mut impl FnMut(Standing),
) -> Fit {
    let started = Instant::now();
    let mut core_settings = identify::Settings { budget: settings.budget, ..identify::Settings::default() };
    core_settings.search.population = settings.population;
    let mut identification =
        Identification::<f64, MAX_FREE, MAX_POPULATION>::new(problem, core_settings, settings.seed);
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
    let covariance = identification.result().and_then(|finish| finish.normal.covariance()).unwrap_or(unknown);
    let misfit = match identification.result() {
        Some(finish) => finish.normal.misfit,
        None => problem.misfit(&genes, &mut steppers[0]),
    };
    let predictions = engine::trace(problem, &genes, &mut steppers[0]);
    let (inflation, systematic) = if stop == StopReason::NoiseReached {
        (1.0, systematic::of_genes(problem, &genes, &covariance, steppers))
    } else {
        let repeats = correlation_time(&residual_series(problem.records, &predictions, 0));
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

/// A fit that leaves noise, moved to the bottom of its valley.
struct Moved<'a> {
    fit: Fit,
    bottom: &'a Polished,
}

impl Job for Moved<'_> {
    type Output = Fit;

    fn run<S: Stepper<f64>>(self, problem: &Problem<'_, f64>, steppers: &mut [S]) -> Fit {
        let Polished { values, misfit, covariance } = self.bottom;
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

/// Covariance of the free parameters, in the product of their units, from that of their genes for white noise.
fn in_units(
    problem: &Problem<'_, f64>,
    of_genes: &SMatrix<f64, MAX_FREE, MAX_FREE>,
    inflation: f64,
) -> Vec<Vec<f64>> {
    let range = |gene: usize| problem.free[gene].range();
    let entry =
        |row: usize, column: usize| of_genes[(row, column)] * inflation * (range(row) * range(column));
    let count = problem.free.len();
    (0..count).map(|row| (0..count).map(|column| entry(row, column)).collect()).collect()
}

/// Estimates of the free parameters, with what noise and systematic errors, in genes, make of them.
fn estimates(
    problem: &Problem<'_, f64>,
    genes: &[f64; MAX_FREE],
    covariance: &[Vec<f64>],
    systematic: &[f64; MAX_FREE],
) -> Vec<Estimate> {
    let estimate = |(gene, free): (usize, &Free<f64>)| {
        let standard_error = covariance[gene][gene].sqrt().hypot(systematic[gene] * free.range());
        let range = Range { parameter: free.parameter, lower: free.lower, upper: free.upper };
        Estimate::new(&range, free.value(genes[gene]), standard_error)
    };
    problem.free.iter().enumerate().map(estimate).collect()
}
