//! Where a residual repeats along the way, not in time: the pitches at which cogging is worth a fit.

use super::residual;
use crate::fit::Prepared;
use eha_monitor::model::state::Outputs;
use rayon::prelude::*;

/// Share by which a fit may move a pitch away from where it was seen.
pub(super) const PITCH_REACH: f64 = 0.02;
/// Pitches that are handed to the fit.
const MOST_PITCHES: usize = 3;
/// Most periods along the way that are looked for.
const MOST_PERIODS: f64 = 400.0;
/// Fewest: fewer are a bend, not a ripple.
const FEWEST_PERIODS: f64 = 3.0;
/// Parts of a period over the whole way by which neighbours of the search differ.
const PARTS: f64 = 2.0;
/// Places into which the way is divided for a period of the shortest pitch.
const PLACES: f64 = 8.0;

/// The strongest pitches, m, of what a model leaves of the position, the strongest first.
///
/// The residual answers a force with some integrals of it, which differ from machine to machine: its rate is used, in
/// which a slow drift is small and a ripple large. It is averaged over places along the way, each direction for itself,
/// because the answer to a force has another delay there.
pub(super) fn pitches(records: &[Prepared], predictions: &[Vec<Outputs<f64>>]) -> Vec<f64> {
    let travel = |pick: fn(f64, f64) -> f64, start: f64| {
        records
            .iter()
            .flat_map(|record| record.measured(0))
            .copied()
            .filter(|x| x.is_finite())
            .fold(start, pick)
    };
    let (low, high) = (travel(f64::min, f64::INFINITY), travel(f64::max, f64::NEG_INFINITY));
    let way = high - low;
    if !way.is_finite() || way <= 0.0 {
        return Vec::new();
    }
    let count = (MOST_PERIODS * PLACES) as usize;
    let mut places = [vec![0.0; count], vec![0.0; count]];
    for (index, record) in records.iter().enumerate() {
        let one = residual::series(&records[index..=index], &predictions[index..=index], 0).concat();
        let compared: Vec<f64> =
            (0..record.len()).filter(|&k| record.is_compared(k)).map(|k| record.measured(0)[k]).collect();
        for (x, r) in compared.windows(2).zip(one.windows(2)) {
            let (motion, change) = (x[1] - x[0], r[1] - r[0]);
            if motion != 0.0 && change.is_finite() && motion.is_finite() {
                let place = (((x[0] - low) / way * count as f64) as usize).min(count - 1);
                places[usize::from(motion < 0.0)][place] += change;
            }
        }
    }
    let periods = |index: usize| FEWEST_PERIODS + index as f64 / PARTS;
    let lines = ((MOST_PERIODS - FEWEST_PERIODS) * PARTS) as usize;
    let power: Vec<f64> = (0..lines)
        .into_par_iter()
        .map(|line| {
            let turn = std::f64::consts::TAU * periods(line) / count as f64;
            let of = |values: &[f64]| {
                let (mut cosine, mut sine) = (0.0, 0.0);
                for (place, value) in values.iter().enumerate() {
                    let (s, c) = (turn * place as f64).sin_cos();
                    cosine += value * c;
                    sine += value * s;
                }
                cosine * cosine + sine * sine
            };
            places.iter().map(|values| of(values)).sum()
        })
        .collect();
    let peak = |&line: &usize| line > 0 && power[line] > power[line - 1] && power[line] >= power[line + 1];
    let mut peaks: Vec<usize> = (1..lines.saturating_sub(1)).filter(peak).collect();
    peaks.sort_by(|&a, &b| power[b].total_cmp(&power[a]));
    peaks.into_iter().take(MOST_PITCHES).map(|line| way / periods(line)).collect()
}
