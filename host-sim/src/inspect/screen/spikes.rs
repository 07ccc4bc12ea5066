//! Spikes: samples that jump away from the motion, and the motion goes on without them.

use std::ops::Range;

/// Departure in those that are usual around it that makes a spike; both are asked for.
const UNUSUAL: f64 = 5.0;
/// Where a spike of a position lasts for several samples, or at an end of a record, where only one side is there: how
/// far it jumps, in the largest steps within and around it, and of the record but for one in a hundred. A corner of the
/// motion is as large as one step.
pub(super) const STEPS: f64 = 3.0;
/// Samples on each side that say what is usual.
const AROUND: usize = 10;
/// Samples on each side among which two give a line.
const REACH: usize = 5;
/// What the line through two neighbours makes of white noise in three samples, in its standard deviation: `sqrt(1 + 4 +
/// 1)`.
pub(super) const OF_THREE: f64 = 2.449_489_742_783_178;

/// Samples that lie off the lines on both sides by more than `least` on the same side; where the quantity cannot jump,
/// runs of them too, of at most `longest`, and those at an end.
pub(super) fn spikes(values: &[f64], least: f64, longest: Option<usize>) -> Vec<usize> {
    let mut large: Vec<f64> = steps(values).collect();
    large.sort_by(f64::total_cmp);
    let jump = least.max(STEPS * large.get(large.len() * 99 / 100).copied().unwrap_or(0.0));
    let mut left = values.to_vec();
    let mut found = Vec::new();
    // One may hide another beside it.
    loop {
        let before = found.len();
        for first in 0..left.len() {
            // Only what departs from the samples before it starts a jump, however long that is.
            let departs =
                || departure(&left, first, (0..first).rev()).is_none_or(|departure| departure.abs() > jump);
            let most = longest.filter(|_| departs()).unwrap_or(1);
            let ends = first..(first + most).min(left.len());
            let mut runs = ends.take_while(|&last| left[last].is_finite()).map(|last| first..last + 1);
            let is_spike = |run: &Range<usize>| {
                is_single_spike(&left, run, least) || longest.is_some() && is_jump(&left, run, jump)
            };
            if let Some(run) = runs.find(is_spike) {
                left[run.clone()].fill(f64::NAN);
                found.extend(run);
            }
        }
        if found.len() == before {
            found.sort_unstable();
            return found;
        }
    }
}

/// Does a run of a single sample lie off the lines on both sides, and off the cubic through both, by more than `least`
/// and than is usual around it?
fn is_single_spike(values: &[f64], run: &Range<usize>, least: f64) -> bool {
    let sides = [before(values, run), after(values, run)];
    let [Some(entry), Some(exit), Some(across)] = [
        departure(values, run.start, (0..run.start).rev()),
        departure(values, run.start, run.end..values.len()),
        from_cubic(values, run.start),
    ] else {
        return false;
    };
    let smallest = entry.abs().min(exit.abs()).min(across.abs());
    let is_one_sided = entry * exit > 0.0 && entry * across > 0.0;
    if run.len() > 1 || !is_one_sided || smallest <= least {
        return false;
    }
    let mut bends: Vec<f64> =
        sides.iter().flat_map(|side| side.windows(3)).map(bend).filter(|bend| bend.is_finite()).collect();
    bends.sort_by(f64::total_cmp);
    smallest > UNUSUAL * bends.get(bends.len() / 2).copied().unwrap_or(0.0)
}

/// Does a run lie off what is on both sides of it by more than `jump` and than the steps within and around it, and off
/// the lines there?
fn is_jump(values: &[f64], run: &Range<usize>, jump: f64) -> bool {
    let sides = [before(values, run), after(values, run)];
    let largest = sides.into_iter().chain([&values[run.clone()]]).flat_map(steps).fold(0.0, f64::max);
    let limit = jump.max(STEPS * largest);
    let is_present = |value: &&f64| value.is_finite();
    let beside = [sides[0].iter().rev().find(is_present), sides[1].iter().find(is_present)];
    let is_off = |value: &f64| beside.into_iter().flatten().all(|other| (value - other).abs() > limit);
    let ends = [
        departure(values, run.start, (0..run.start).rev()),
        departure(values, run.end - 1, run.end..values.len()),
    ];
    let departures = || ends.into_iter().flatten();
    departures().next().is_some()
        && (departures().all(|d| d > limit) || departures().all(|d| d < -limit))
        && values[run.clone()].iter().all(is_off)
}

/// Samples before a run.
pub(super) fn before<'a>(values: &'a [f64], run: &Range<usize>) -> &'a [f64] {
    &values[run.start.saturating_sub(AROUND)..run.start]
}

/// Samples after a run.
pub(super) fn after<'a>(values: &'a [f64], run: &Range<usize>) -> &'a [f64] {
    &values[run.end..(run.end + AROUND).min(values.len())]
}

/// Sizes of the steps from sample to sample.
pub(super) fn steps(values: &[f64]) -> impl Iterator<Item = f64> + '_ {
    values.windows(2).map(|pair| (pair[1] - pair[0]).abs()).filter(|step| step.is_finite())
}

/// How far a sample lies off the line through the nearest two of the samples on one side, in units in which white noise
/// has its own standard deviation; none where they are lost.
fn departure(values: &[f64], at: usize, side: impl Iterator<Item = usize>) -> Option<f64> {
    let mut present = side.take(REACH).filter(|&sample| values[sample].is_finite());
    let (near, far) = (present.next()?, present.next()?);
    let slope = near.abs_diff(at) as f64 / near.abs_diff(far) as f64;
    let off = values[at] - values[near] - slope * (values[near] - values[far]);
    Some(off / (1.0 + (1.0 + slope) * (1.0 + slope) + slope * slope).sqrt())
}

/// How far a sample lies off the cubic through the two samples on each side, in the same units: what bends does not;
/// none where one is lost.
fn from_cubic(values: &[f64], at: usize) -> Option<f64> {
    let around = values.get(at.checked_sub(2)?..at + 3)?;
    let foretold = (4.0 * (around[1] + around[3]) - around[0] - around[4]) / 6.0;
    Some((around[2] - foretold) / (1.0 + 34.0 / 36.0_f64).sqrt()).filter(|off| off.is_finite())
}

/// How far the middle one of three samples lies off the line through the others, in the same units.
fn bend(three: &[f64]) -> f64 {
    (three[0] - 2.0 * three[1] + three[2]).abs() / OF_THREE
}
