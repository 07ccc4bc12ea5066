//! Samples that no sensor gave at their time: they repeat the one before them, or somebody put them on a line.

use super::runs;
use super::spikes::{STEPS, after, before, steps};
use crate::fit;
use std::ops::Range;

/// What nine in ten samples bend by at least where noise is alive, as a part of what half of them do: two thirds of what
/// it is where there is nothing else, 0.186.
const ALIVE: f64 = 0.124;
/// Step of a channel, in standard deviations of its noise, up to which the noise hides it.
const FINE: f64 = 0.05;
/// How far from a step a value is on none, in steps.
const OFF_STEP: f64 = 1e-3;
/// Chance that noise at rest repeats a sample, for each step in standard deviations of it, and that it puts one on the line
/// through its neighbours: the densities at 0 of the differences of two and of three.
const REPEATED: f64 = 0.282;
const ON_LINE: f64 = 0.163;
/// Standard deviations within which a channel that rests stays.
const AT_REST: f64 = 4.0;
/// Samples that are tried for one that is on a step.
const ORIGINS: usize = 8;
/// Rounding of numbers in a file, as a part of the largest of a channel.
const ROUNDING: f64 = 1e-12;
/// Chance of calling samples of a record filled in that are not.
const CHANCE: f64 = 1e-4;

/// Samples of a position that repeat the one before them, and then it jumps by more than `least` and than the steps
/// around: what moved on meanwhile. Something that stood still starts with a step like those that follow.
pub(super) fn repeating(values: &[f64], least: f64) -> Vec<usize> {
    let (mut found, mut start) = (Vec::new(), 0);
    for run in values.chunk_by(|a, b| a == b) {
        let run = start..start + run.len();
        let sides = [before(values, &run), after(values, &run)];
        let largest = sides.into_iter().flat_map(steps).fold(0.0, f64::max);
        let jump = values.get(run.end).map_or(0.0, |next| (next - values[start]).abs());
        if run.len() > 1 && jump > least.max(STEPS * largest) {
            found.extend(start + 1..run.end);
        }
        start = run.end;
    }
    found
}

/// Samples of a noisy channel that lie on a straight line, digit by digit, or between the steps in which it is read:
/// they were lost, and somebody filled the gap with the last value, or with a line. A limit of the channel is no such
/// line.
pub(super) fn filled(values: &[f64], model_error: f64) -> Vec<usize> {
    let quantum = fit::quantum(values);
    if !is_noisy(values, quantum.max(model_error)) {
        return between_steps(values, quantum);
    }
    let noise = fit::noise_of_series(values);
    let straight = runs(&straight(values));
    let count = values.len() as f64;
    let by_chance = straight.iter().filter(|run| run.end < values.len()).count() as f64 + 1.0;
    // Each is as likely as a run of them is, or as noise makes it at rest.
    let anywhere = by_chance / count;
    let at_rest = anywhere.max((REPEATED + ON_LINE) * quantum / noise);
    let rests = |run: &Range<usize>| {
        let [low, high] = fit::extent(&values[run.start.saturating_sub(1)..values.len().min(run.end + 1)]);
        high - low < AT_REST * noise
    };
    // So many in a row are in none of 10,000 records.
    let longest = |chance: f64| ((CHANCE / count).ln() / chance.ln()).max(2.0);
    let [low, high] = fit::extent(values);
    let is_limit = |value: f64| value == low || value == high;
    let is_filled = |run: &Range<usize>| {
        let [from, to] = [values[run.start], values[run.end - 1]];
        let chance = if rests(run) { at_rest } else { anywhere };
        run.len() as f64 >= longest(chance) && !(from == to && is_limit(from))
    };
    straight.into_iter().filter(is_filled).flatten().collect()
}

/// Samples that are not on the steps of a channel, where nine in ten are, and more go from one step to another.
fn between_steps(values: &[f64], quantum: f64) -> Vec<usize> {
    let is_off = |value: f64, origin: f64| {
        let steps = (value - origin) / quantum;
        (steps - steps.round()).abs() > OFF_STEP
    };
    let off = |origin: f64| -> Vec<usize> {
        (0..values.len()).filter(|&sample| is_off(values[sample], origin)).collect()
    };
    let origins = values.iter().step_by((values.len() / ORIGINS).max(1));
    let fewest = origins.map(|&origin| off(origin)).min_by_key(Vec::len);
    let whole = steps(values).filter(|&step| step > 0.0 && !is_off(step, 0.0)).count();
    let is_read_in_steps = |off: &Vec<usize>| 10 * off.len() < values.len() && off.len() < whole;
    fewest.filter(|off| quantum > rounding(values) && is_read_in_steps(off)).unwrap_or_default()
}

/// Samples that were lost with those of other sensors, whose runs are given: those of a straight run that is about the
/// same. It may be longer by chance where the channel has a coarse step.
pub(super) fn filled_as_well(values: &[f64], stuck: &[Range<usize>]) -> Vec<usize> {
    let is_same = |run: &Range<usize>, other: &Range<usize>| {
        run.start.abs_diff(other.start) + run.end.abs_diff(other.end) <= 1 + other.len() / 4
    };
    let is_lost = |run: &Range<usize>| run.len() > 1 && stuck.iter().any(|other| is_same(run, other));
    runs(&straight(values)).into_iter().filter(is_lost).flatten().collect()
}

/// Samples on the line through their neighbours, but for the rounding of their channel, or the same as the one before
/// them. A line on a coarse step is not told from noise.
fn straight(values: &[f64]) -> Vec<usize> {
    let quantum = fit::quantum(values);
    let is_fine = quantum < FINE * fit::noise_of_series(values);
    let rounding = rounding(values).max(if is_fine { 1.01 * quantum } else { 0.0 });
    let is_straight = |&sample: &usize| {
        let repeats = sample > 0 && values[sample] == values[sample - 1];
        let around = sample.checked_sub(1).and_then(|before| values.get(before..sample + 2));
        repeats || around.is_some_and(|w| (w[0] - 2.0 * w[1] + w[2]).abs() <= rounding)
    };
    (0..values.len()).filter(is_straight).collect()
}

/// Rounding of the numbers of a channel.
fn rounding(values: &[f64]) -> f64 {
    ROUNDING * values.iter().fold(0.0, |most: f64, value| most.max(value.abs()))
}

/// Chance of a sample of a channel to be the one before it, digit by digit, at rest: 1 where noise does not tell, such as
/// what a program's steps make of a motion, which is far below what a model is wrong by.
pub(super) fn chance_of_repeat(values: &[f64], model_error: f64) -> f64 {
    let quantum = fit::quantum(values);
    if !is_noisy(values, quantum.max(model_error)) {
        return 1.0;
    }
    (REPEATED * quantum / fit::noise_of_series(values)).min(1.0)
}

/// Has a channel more noise than `least`, and at all times? What moves without noise bends now and then.
fn is_noisy(values: &[f64], least: f64) -> bool {
    let mut bends: Vec<f64> = fit::fourth_differences(values).collect();
    bends.sort_by(f64::total_cmp);
    let quantile = |share: f64| bends.get((share * bends.len() as f64) as usize).copied().unwrap_or(0.0);
    fit::noise_of_series(values) > least && quantile(0.1) > ALIVE * quantile(0.5)
}

#[cfg(test)]
mod tests {
    use super::filled;
    use rand_distr::{Distribution, Normal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    #[test]
    fn what_rests_on_a_step_that_is_no_larger_than_its_noise_is_not_filled_in() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
        let normal = Normal::new(0.0, 1.6e-6).unwrap();
        // A ram that rests for a fifth of the time, and moves faster than its noise in between.
        let path = |k: u32| 2e-3 * (f64::from(k) * 6.3e-3).sin().clamp(-0.95, 0.95);
        let mut read = |lost: std::ops::Range<usize>| -> Vec<f64> {
            let step = 1.2e-6;
            let mut values: Vec<f64> =
                (0..1000).map(|k| ((path(k) + normal.sample(&mut random)) / step).round() * step).collect();
            let word = values[lost.start];
            values[lost].fill(word);
            values
        };
        let called = (0..600).filter(|_| !filled(&read(0..0), 0.3e-6).is_empty()).count();
        assert_eq!(called, 0);
        // In motion, half as many are enough as at rest.
        assert_eq!(filled(&read(500..512), 0.3e-6), (501..512).collect::<Vec<_>>());
        let rests = 240..262;
        let found = filled(&read(rests.clone()), 0.3e-6);
        assert!(rests.skip(1).all(|sample| found.contains(&sample)), "{found:?}");
    }
}
