//! What records do not say, and the fit of those in which they speak for it: the path of a command between its samples, and
//! when a spool sticks.

use super::search::{deepest, or_from_seeds};
use super::visits::{InAll, generations};
use super::{
    Fit, FitSettings, Prepared, Standing, TOLD_APART, Visit, fit, fit_near, prepare, widen_by_calibration,
};
use crate::record::Record;
use crate::rig::{CommandPath, Range, Rig};
use eha_monitor::fit::identify::{self, StopReason};
use eha_monitor::fit::problem::Misfit;
use rayon::prelude::*;
use std::iter;
use std::time::Instant;

/// Share of what one reading leaves beyond noise that another must undercut to be taken though it leaves more than noise
/// itself.
const SHARE_LEFT: f64 = 0.5;

/// Seeds from which records are searched where the first leaves more than noise.
const MORE_SEEDS: u64 = 4;

/// Records, and the rig that they are read with.
#[derive(Clone)]
pub struct Reading {
    /// The rig: it says what the command does between its samples, and when the spool sticks.
    pub rig: Rig,
    /// The records as that takes them.
    pub records: Vec<Prepared>,
}

impl Reading {
    /// The usual readings that a rig leaves open, its own first: a command that goes from sample to sample on straight lines
    /// or on a curve, and a spool that slides until its driving force has fallen to the sliding friction, or sticks as soon as
    /// that force would not set it going.
    pub fn all(rig: &Rig, records: &[Prepared]) -> Vec<Self> {
        let own = Self { rig: rig.clone(), records: records.to_vec() };
        Self::with_sticking_spool(iter::once(own).chain(on_path(rig, records, CommandPath::Curve)).collect())
    }

    /// Those in which a computer keeps the value of a sample until the next one, where the rig leaves the path open: half a
    /// sample of delay, which a sensor may have as well. To be asked where the others leave more than noise.
    pub fn held(rig: &Rig, records: &[Prepared]) -> Vec<Self> {
        Self::with_sticking_spool(on_path(rig, records, CommandPath::Held).into_iter().collect())
    }

    /// Some readings, and then the same with the other law of the spool, where the rig leaves that open.
    fn with_sticking_spool(mut all: Vec<Self>) -> Vec<Self> {
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
    /// The fit, with the effort of all readings and seeds. Its intervals hold those of the others that may be it as well.
    pub fit: Fit,
    /// Did another reading do as well, and widen an interval by more than a standard error?
    pub is_open: bool,
}

/// Fits the ranges to records in every reading that the rig leaves open. Where that leaves more than noise in all of them, the
/// one that leaves least is fitted from more seeds, as a search may have ended in a wrong valley, and the others where that
/// led to. `watch` is told where each search stands, and `tell` of those from more seeds.
pub fn fit_as_read(
    rig: &Rig,
    ranges: &[Range],
    records: &[Prepared],
    settings: &FitSettings,
    watch: impl Fn(Standing) + Sync,
    tell: impl FnOnce(&str),
) -> AsRead {
    let started = Instant::now();
    let mut fitted: Vec<(Reading, Fit)> = Vec::new();
    let is_interrupted = |fitted: &[(Reading, Fit)]| fitted.iter().any(|(_, fit)| fit.interrupted);
    let is_known = |fitted: &[(Reading, Fit)]| {
        is_interrupted(fitted) || fitted.iter().any(|(_, fit)| fit.stop == StopReason::NoiseReached)
    };
    for readings in [Reading::all, Reading::held] {
        if is_known(&fitted) {
            break;
        }
        for reading in readings(rig, records) {
            if is_interrupted(&fitted) {
                break;
            }
            let fit = fit(&reading.rig, ranges, &reading.records, settings, &watch);
            fitted.push((reading, fit));
        }
    }
    // What was cut short says nothing against what was not.
    let are_whole: Vec<bool> = fitted.iter().map(|(_, fit)| !fit.interrupted).collect();
    if !is_known(&fitted) {
        tell(&format!("more than noise is left: searching from {} more seeds", MORE_SEEDS - 1));
        search_further(&mut fitted, ranges, settings, &watch);
    }
    let settled = |(reading, fit): (Reading, Fit)| {
        let fit = fit.settled(&reading.rig, ranges, &reading.records);
        (reading, fit)
    };
    let mut fitted: Vec<(Reading, Fit)> = fitted.into_iter().map(settled).collect();
    let misfits: Vec<Misfit<f64>> = fitted.iter().map(|(_, fit)| fit.misfit).collect();
    let likeliest = |(reading, fit): (Reading, Fit)| {
        let fit = fit.likeliest(&reading.rig, ranges, &reading.records);
        (reading, fit)
    };
    fitted = fitted.into_iter().map(likeliest).collect();
    let mut chosen = speaks_for(&misfits);
    if !are_whole[chosen] {
        chosen = 0;
    }
    let mut in_all = InAll::default();
    for (reading, (_, fit)) in fitted.iter_mut().enumerate() {
        in_all.add(fit, |visit| Visit { reading, ..visit });
    }
    let InAll { visits, evaluations, interrupted } = in_all;
    let generations = generations(&visits, settings.population);
    let seconds = started.elapsed().as_secs_f64();
    let (reading, fit) = fitted.swap_remove(chosen);
    let mut fit = Fit { evaluations, generations, seconds, interrupted, visits, reading: chosen, ..fit };
    let mut is_open = false;
    for (_, other) in &fitted {
        is_open |= gain_of(&fit.misfit, &other.misfit).abs() <= TOLD_APART && fit.hold(other);
    }
    widen_by_calibration(&reading.rig, ranges, &mut fit.estimates, &reading.records);
    AsRead { reading, fit, is_open }
}

/// Fits from more seeds in the reading that leaves least, and then in each other one near what that found.
fn search_further(
    fitted: &mut [(Reading, Fit)],
    ranges: &[Range],
    settings: &FitSettings,
    watch: &(impl Fn(Standing) + Sync),
) {
    let left = |place: &usize| fitted[*place].1.misfit.chi_square;
    let Some(least) = (0..fitted.len()).min_by(|a, b| left(a).total_cmp(&left(b))) else { return };
    let (Reading { rig, records }, fit) = &mut fitted[least];
    *fit = or_from_seeds(fit.clone(), rig, ranges, records, settings, MORE_SEEDS, watch);
    let found = fit.polished().values;
    fitted.par_iter_mut().enumerate().filter(|(place, _)| *place != least).for_each(|(_, (reading, fit))| {
        let started = Instant::now();
        let near = fit_near(&reading.rig, ranges, &found, &reading.records, settings, watch);
        *fit = deepest(fit.clone(), vec![near], settings, started);
    });
}

/// Would the ranges fit the records down to the noise, in one of their readings, if their commands had been recorded one
/// sample earlier? Then that is what is wrong with them: no actuator answers a command that is still to come. `asking` is a
/// fit of them as they are, near which it is looked for; the effort of that is added to it.
pub fn is_command_late(
    rig: &Rig,
    ranges: &[Range],
    records: &[Record],
    settings: &FitSettings,
    asking: &mut Fit,
) -> bool {
    let earlier: Vec<Prepared> =
        records.iter().map(|record| prepare(rig, &record.with_earlier_command())).collect();
    let started = Instant::now();
    let found = asking.polished().values;
    let readings = [Reading::all, Reading::held].into_par_iter().flat_map(|readings| readings(rig, &earlier));
    let moved: Vec<Fit> = readings
        .map(|Reading { rig, records }| fit_near(&rig, ranges, &found, &records, settings, |_| {}))
        .collect();
    asking.evaluations += moved.iter().map(|fit| fit.evaluations).sum::<u32>();
    asking.seconds += started.elapsed().as_secs_f64();
    asking.interrupted |= moved.iter().any(|fit| fit.interrupted);
    moved.iter().any(|fit| fit.stop == StopReason::NoiseReached)
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

/// The rig and its records with the command on a path between its samples. None where the rig does not leave the path open,
/// and where that path is no other than the straight lines.
pub fn on_path(rig: &Rig, records: &[Prepared], command_path: CommandPath) -> Option<Reading> {
    if rig.command_path != CommandPath::Open {
        return None;
    }
    let rig = Rig { command_path, ..rig.clone() };
    let other: Vec<Prepared> = records.iter().map(|record| record.along(&rig)).collect();
    let differs = other.iter().zip(records).any(|(path, lines)| !path.flies_as(lines));
    differs.then_some(Reading { rig, records: other })
}
