//! Where a residual repeats along the way, not in time: the ripples at which a fit of cogging starts.
//!
//! A force that ripples with the ram's position is seen through the answer of the whole loop to a force. That answer is
//! taken from the model (a small step of the load, at several times), so a pitch can be judged by what its force would
//! do to each measured channel.

use super::residual::MEASURED;
use crate::fit::{self, Prepared};
use crate::rig::{Range, Rig};
use eha_monitor::model::state::Outputs;
use eha_monitor::parameter::Parameter;
use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;

/// Least share by which a fit may move a pitch away from where it was seen; the next one that was looked at is farther away
/// where there are few periods along the way. It may not go on from there: what has no whole periods is a bend.
const PITCH_REACH: f64 = 0.02;
/// Ripples that are handed on: an actuator that sticks now and then is not the linear one that they are judged by.
const MOST_RIPPLES: usize = 12;
/// Pitches that are judged by what their force would do.
const MOST_JUDGED: usize = 24;
/// Most periods along the way that are looked for.
const MOST_PERIODS: f64 = 400.0;
/// Fewest: fewer are a bend, not a ripple.
const FEWEST_PERIODS: f64 = 2.0;
/// Fewest samples in a period, at the speed that half of the moving ones do not exceed: with fewer, samples tell a ripple
/// from a coarser one no more, and a simulation that follows it takes minutes.
const FEWEST_SAMPLES: f64 = 2.0;
/// Parts of a period over the whole way by which neighbours of the search differ.
const PARTS: f64 = 4.0;
/// Places of a record at which the load is stepped.
const STEPS: usize = 6;
/// Size of that step, N: small, so that the answer is that of the linear model.
const STEP: f64 = 1.0;
/// Length of an answer, s: a closed loop has forgotten a force by then.
const ANSWER_S: f64 = 0.1;

/// A force that ripples along the way, as far as the linear model knows it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ripple {
    /// Length of a period, m.
    pub(super) pitch: f64,
    /// How far a fit may move it, m.
    reach: f64,
    /// Amplitudes of its cosine and sine, N, against the motion where they are positive.
    amplitudes: [f64; 2],
    /// Fall of chi-square that it promises.
    gain: f64,
}

impl Ripple {
    /// Amplitude, N.
    pub(super) fn amplitude(&self) -> f64 {
        self.amplitudes[0].hypot(self.amplitudes[1])
    }

    /// Where a fit may move the pitch.
    pub(super) fn pitch_range(&self) -> Range {
        let info = Parameter::CoggingPitch.info();
        let (lower, upper) = (self.pitch - self.reach, self.pitch + self.reach);
        Range {
            parameter: Parameter::CoggingPitch,
            lower: lower.max(info.lower),
            upper: upper.min(info.upper),
        }
    }
}

/// The strongest ripples in what a model leaves of the measured channels, the strongest first.
pub(super) fn ripples(rig: &Rig, records: &[Prepared]) -> Vec<Ripple> {
    let predictions = fit::predict(rig, records);
    let ram = || predictions.iter().flatten().map(|outputs| outputs.ram);
    let way = ram().fold(f64::NEG_INFINITY, f64::max) - ram().fold(f64::INFINITY, f64::min);
    if !way.is_finite() || way <= 0.0 {
        return Vec::new();
    }
    let traces: Vec<Trace<'_>> =
        records.iter().zip(&predictions).map(|(record, outputs)| Trace::new(rig, record, outputs)).collect();
    let pitch = |line: usize| way / (FEWEST_PERIODS + line as f64 / PARTS);
    let most_periods = MOST_PERIODS.min(way / (FEWEST_SAMPLES * usual_move(&predictions)));
    let lines = ((most_periods - FEWEST_PERIODS).max(0.0) * PARTS) as usize;
    let pulls: Vec<f64> =
        (0..lines).into_par_iter().map(|line| pull(&traces, pitch(line)).norm_squared()).collect();
    let peak = |&line: &usize| pulls[line] > pulls[line - 1] && pulls[line] >= pulls[line + 1];
    let mut peaks: Vec<usize> = (1..lines.saturating_sub(1)).filter(peak).collect();
    peaks.sort_by(|&a, &b| pulls[b].total_cmp(&pulls[a]));
    peaks.truncate(MOST_JUDGED);
    let mut judged: Vec<Ripple> =
        peaks.into_par_iter().filter_map(|line| judged(&traces, pitch(line), way)).collect();
    judged.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    judged.truncate(MOST_RIPPLES);
    judged
}

/// How far the ram goes in a sample in which it moves: the median, m.
fn usual_move(predictions: &[Vec<Outputs<f64>>]) -> f64 {
    let moves = predictions.iter().flat_map(|outputs| outputs.windows(2));
    let moves = moves.map(|pair| (pair[1].ram - pair[0].ram).abs()).filter(|&moved| moved > 0.0);
    let mut moves: Vec<f64> = moves.collect();
    let middle = moves.len() / 2;
    if moves.is_empty() { f64::INFINITY } else { *moves.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// A record as a force on the ram sees it.
struct Trace<'a> {
    record: &'a Prepared,
    outputs: &'a [Outputs<f64>],
    /// What each channel that is used does in the samples after a force of 1 N that lasts for one, in units of its
    /// noise.
    answers: Vec<Vec<f64>>,
    /// Slope of half of chi-square over a force in each sample, 1/N.
    pull: Vec<f64>,
}

impl<'a> Trace<'a> {
    fn new(rig: &Rig, record: &'a Prepared, outputs: &'a [Outputs<f64>]) -> Self {
        let mut trace = Self { record, outputs, answers: Vec::new(), pull: vec![0.0; record.len()] };
        for (channel, mut answer) in answers(rig, record, outputs).into_iter().enumerate() {
            let noise = record.noise[channel];
            if noise.is_finite() {
                for value in &mut answer {
                    *value /= noise;
                }
                trace.listen(channel, &answer);
                trace.answers.push(answer);
            }
        }
        trace
    }

    /// Adds what a channel's residual says of a force in each sample before.
    fn listen(&mut self, channel: usize, answer: &[f64]) {
        let record = self.record;
        for (sample, (value, outputs)) in record.measured(channel).iter().zip(self.outputs).enumerate() {
            let residual = (value - outputs.to_array()[channel]) / record.noise[channel];
            if record.is_compared(sample) && residual.is_finite() {
                for (lag, answer) in answer.iter().enumerate().take(record.since_start(sample)) {
                    self.pull[sample - lag - 1] += answer * residual;
                }
            }
        }
    }

    /// Cosine and sine of a pitch at each sample.
    fn ripple(&self, pitch: f64) -> impl Iterator<Item = Vector2<f64>> {
        self.outputs.iter().map(move |outputs| {
            let (sine, cosine) = (std::f64::consts::TAU * outputs.ram / pitch).sin_cos();
            Vector2::new(cosine, sine)
        })
    }
}

/// Slope of half of chi-square over the amplitudes, in N, of a ripple's cosine and sine.
fn pull(traces: &[Trace<'_>], pitch: f64) -> Vector2<f64> {
    traces
        .iter()
        .flat_map(|trace| trace.ripple(pitch).zip(&trace.pull).map(|(ripple, pull)| ripple * *pull))
        .sum()
}

/// The ripple of a pitch, along a whole way, that explains most; none where it shows nowhere.
fn judged(traces: &[Trace<'_>], pitch: f64, way: f64) -> Option<Ripple> {
    let mut curvature = Matrix2::zeros();
    for trace in traces {
        let ripple: Vec<Vector2<f64>> = trace.ripple(pitch).collect();
        for sample in (0..ripple.len()).filter(|&sample| trace.record.is_compared(sample)) {
            for answer in &trace.answers {
                let past = answer.iter().take(trace.record.since_start(sample)).enumerate();
                let shown: Vector2<f64> = past.map(|(lag, answer)| ripple[sample - lag - 1] * *answer).sum();
                curvature += shown * shown.transpose();
            }
        }
    }
    let pull = pull(traces, pitch);
    let amplitudes = curvature.cholesky()?.solve(&pull);
    let reach = (PITCH_REACH * pitch).max(pitch * pitch / (PARTS * way));
    Some(Ripple { pitch, reach, amplitudes: amplitudes.into(), gain: amplitudes.dot(&pull) })
}

/// What each measured channel does in the samples after a force of 1 N that lasts for one, in its unit.
fn answers(rig: &Rig, record: &Prepared, outputs: &[Outputs<f64>]) -> [Vec<f64>; MEASURED] {
    let length = (ANSWER_S / record.sample_period) as usize;
    let mut sums = [(); MEASURED].map(|()| vec![0.0; length + 1]);
    let mut counts = vec![0_usize; length + 1];
    // A step that the model has already is not moved in time for that.
    let mut calm = rig.clone();
    calm.parameters.set(Parameter::StepLoad, 0.0);
    let has_step = rig.parameters.get(Parameter::StepLoad) != 0.0;
    let calm_outputs = has_step.then(|| fit::predict(&calm, std::slice::from_ref(record)).concat());
    let outputs = calm_outputs.as_deref().unwrap_or(outputs);
    for step in 0..STEPS {
        let at = (2 * step + 1) * record.len() / (2 * STEPS);
        let mut stepped = calm.clone();
        stepped.parameters.set(Parameter::StepLoad, STEP);
        stepped.parameters.set(Parameter::StepLoadTime, record.time(at));
        let after = fit::predict(&stepped, std::slice::from_ref(record)).concat();
        for (lag, (with, without)) in after.iter().zip(outputs).skip(at).enumerate().take(length + 1) {
            if record.since_start(at + lag) < lag {
                break;
            }
            for (channel, sum) in sums.iter_mut().enumerate() {
                sum[lag] += (with.to_array()[channel] - without.to_array()[channel]) / STEP;
            }
            counts[lag] += 1;
        }
    }
    sums.map(|sums| {
        let step: Vec<f64> =
            sums.iter().zip(&counts).map(|(sum, &count)| sum / count.max(1) as f64).collect();
        step.windows(2).map(|pair| pair[1] - pair[0]).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::{FEWEST_SAMPLES, MOST_PERIODS, ripples, usual_move};
    use crate::fit::{self, Prepared};
    use crate::record::Record;
    use crate::rig::Rig;
    use eha_monitor::channel::Channel;
    use std::f64::consts::TAU;

    const PERIOD: f64 = 1e-3;

    /// A sine of 5 mm, and what a sensor with noise of 5 um shows of its answer.
    fn flown(rig: &Rig, frequency: f64) -> Prepared {
        let command: Vec<f64> =
            (0..2000).map(|k| 5e-3 * (TAU * frequency * f64::from(k) * PERIOD).sin()).collect();
        let prepared = |position: Vec<f64>| {
            let channels = vec![(Channel::Command, command.clone()), (Channel::UserPosition, position)];
            let record = Record::new("made".to_owned(), PERIOD, 0.0, channels).unwrap();
            fit::prepare_with(rig, &record, [5e-6, f64::INFINITY, f64::INFINITY, f64::INFINITY])
        };
        let outputs = fit::predict(rig, &[prepared(command.clone())]).concat();
        let noise = |k: usize| 17e-6 * ((k as f64 * 12.9898).sin() * 43_758.545_3).fract() * 0.5;
        prepared(outputs.iter().enumerate().map(|(k, outputs)| outputs.user + noise(k)).collect())
    }

    #[test]
    fn no_ripple_is_finer_than_the_samples_tell() {
        let rig = Rig::load("eha").unwrap();
        let finest = |frequency: f64| {
            let record = [flown(&rig, frequency)];
            let usual = usual_move(&fit::predict(&rig, &record));
            let pitches = ripples(&rig, &record).into_iter().map(|ripple| ripple.pitch);
            (pitches.fold(f64::INFINITY, f64::min), FEWEST_SAMPLES * usual)
        };
        let coarsest_of_all = 10e-3 / MOST_PERIODS;
        // Fast: it is the samples that end the search.
        let (fast, told) = finest(4.0);
        assert!(told > 2.0 * coarsest_of_all && fast.is_finite() && fast >= told, "{fast:e} {told:e}");
        // Slow: finer ones are told, and found in what is left.
        let (slow, told_slowly) = finest(0.4);
        assert!(told_slowly < coarsest_of_all && slow < told, "{slow:e} {told:e}");
    }
}
