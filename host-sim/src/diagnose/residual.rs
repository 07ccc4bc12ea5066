//! What is left: is it noise, how coloured is it, where and when does it act?

use crate::fit::{self, Prepared, Steps};
use eha_monitor::channel::Channel;
use eha_monitor::model::state::Outputs;
use nalgebra::DVector;
use std::f64::consts::{SQRT_2, TAU};
use std::slice;

/// Channels that the model predicts.
pub const MEASURED: usize = Channel::MEASURED.len();

/// Blocks in which a gain is looked at: long against the residual's correlation, many enough for a spread.
const BLOCKS: usize = 64;

/// Lags of the whiteness test.
const LAGS: usize = 20;

/// The residual of one channel over all records.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelResidual {
    /// Root mean square, in the channel's unit.
    pub rms: f64,
    /// Root of what neighbouring samples share: the part that is not white noise, in the channel's unit.
    pub coloured_rms: f64,
    /// Root mean square of what goes to and fro within a few samples, as a hum does, so that they share nothing, in the
    /// channel's unit; 0 where nothing does.
    pub swinging_rms: f64,
    /// Ljung-Box statistic in standard deviations above its mean under white noise.
    pub colour_sigma: f64,
    /// Samples.
    pub count: usize,
}

/// Residual series of a channel, one for each record.
pub fn series(records: &[Prepared], predictions: &[Vec<Outputs<f64>>], channel: usize) -> Vec<Vec<f64>> {
    let records: Vec<_> = records.iter().map(Prepared::as_core).collect();
    fit::residual_series(&records, predictions, channel)
}

/// Residual series of a channel, one for each record, with the colour of the noise taken out: white where noise is all
/// there is, and the residual itself where that changes slowly.
fn whitened(records: &[Prepared], predictions: &[Vec<Outputs<f64>>], channel: usize) -> Vec<Vec<f64>> {
    let mut all = series(records, predictions, channel);
    for (series, record) in all.iter_mut().zip(records).filter(|(_, record)| record.colour[channel] > 0.0) {
        let (colour, mut before) = (record.colour[channel], f64::NAN);
        for value in series {
            before = std::mem::replace(value, (*value - colour * before) / (1.0 - colour));
        }
    }
    all
}

/// Residuals of all channels and records, one after the other, in units of their noise, over the samples that are
/// compared; 0 where one is missing.
pub fn in_noise(records: &[Prepared], predictions: &[Vec<Outputs<f64>>]) -> DVector<f64> {
    let mut all = Vec::new();
    for (record, outputs) in records.iter().zip(predictions) {
        for (channel, noise) in record.noise.into_iter().enumerate().filter(|(_, noise)| noise.is_finite()) {
            let series = whitened(slice::from_ref(record), slice::from_ref(outputs), channel).concat();
            all.extend(series.iter().map(|value| if value.is_finite() { value / noise } else { 0.0 }));
        }
    }
    all.into()
}

/// Chi-square beyond what noise makes of it, of all channels. One that shows less than its noise, as one without noise does,
/// makes up for no other.
pub fn excess(records: &[Prepared], predictions: &[Vec<Outputs<f64>>]) -> f64 {
    let of_channel = |channel: usize| -> f64 {
        let in_noise = |(index, record): (usize, &Prepared)| {
            let series = whitened(&records[index..=index], &predictions[index..=index], channel).concat();
            let noise = record.noise[channel];
            series.into_iter().filter(|left| left.is_finite()).map(move |left| (left / noise).powi(2) - 1.0)
        };
        records.iter().enumerate().flat_map(in_noise).sum()
    };
    (0..MEASURED).map(|channel| of_channel(channel).max(0.0)).sum()
}

/// Residual of each measured channel, the colour of its noise taken out.
pub fn of_channels(
    records: &[Prepared],
    predictions: &[Vec<Outputs<f64>>],
) -> [Option<ChannelResidual>; MEASURED] {
    std::array::from_fn(|channel| test(&whitened(records, predictions, channel)))
}

/// How many samples of what a model leaves say the same thing: the longest correlation time of a channel, in samples.
pub fn correlation_time(records: &[Prepared], predictions: &[Vec<Outputs<f64>>]) -> f64 {
    fit::longest_correlation_time(|channel| whitened(records, predictions, channel))
}

/// Fall of chi-square from one model's predictions to another's, in each of some 64 blocks of the records.
pub fn gains(records: &[Prepared], before: &[Vec<Outputs<f64>>], after: &[Vec<Outputs<f64>>]) -> Vec<f64> {
    let total: usize = records.iter().map(Prepared::len).sum();
    let length = total.div_ceil(BLOCKS).max(1);
    let mut gains = Vec::new();
    for index in 0..records.len() {
        let one = &records[index..=index];
        let mut blocks = vec![0.0; one[0].len().div_ceil(length)];
        for (channel, noise) in one[0].noise.into_iter().enumerate() {
            let before = whitened(one, &before[index..=index], channel).concat();
            let after = whitened(one, &after[index..=index], channel).concat();
            for (sample, (before, after)) in before.iter().zip(&after).enumerate() {
                let gain = (before * before - after * after) / (noise * noise);
                if gain.is_finite() {
                    blocks[sample / length] += gain;
                }
            }
        }
        gains.extend(blocks);
    }
    gains
}

/// What the steps in which sensors are read may make of the way from one model's predictions to another's: the part of it
/// that they err by along it.
///
/// What is read in steps errs by a saw tooth of the position, of which the noise leaves the first harmonic. Where it is
/// zero is not known, only that it is in the same place for all records: it is where that errs most.
pub fn share_of_steps(
    records: &[Prepared],
    steps: &[Option<Steps>; MEASURED],
    before: &[Vec<Outputs<f64>>],
    after: &[Vec<Outputs<f64>>],
) -> f64 {
    if steps.iter().all(Option::is_none) {
        return 0.0;
    }
    let (mut way, mut error) = (0.0, 0.0);
    for (channel, steps) in steps.iter().enumerate() {
        let mut phases = [0.0; 2];
        for (record, (before, after)) in records.iter().zip(before.iter().zip(after)) {
            let weight = record.noise[channel].powi(-2);
            let changes = fit::differences(after, before, channel).zip(after);
            for (sample, (value, (change, after))) in record.measured(channel).iter().zip(changes).enumerate()
            {
                if !(record.is_compared(sample) && value.is_finite()) {
                    continue;
                }
                way += weight * change * change;
                if let Some(steps) = steps {
                    let (sine, cosine) = (TAU * after.to_array()[channel] / steps.step).sin_cos();
                    let amplitude = weight * SQRT_2 * steps.error * change;
                    phases[0] += amplitude * sine;
                    phases[1] += amplitude * cosine;
                }
            }
        }
        error += phases[0].hypot(phases[1]);
    }
    if way > 0.0 { error / way } else { 0.0 }
}

/// Tests the residual of a channel; none where no record has it. A short one is tested on as many lags as a quarter of
/// its samples. What is missing is passed over: lags count the samples that are there.
pub fn test(all: &[Vec<f64>]) -> Option<ChannelResidual> {
    let all: Vec<Vec<f64>> = all.iter().map(|one| fit::present(one)).collect();
    let power: f64 = all.iter().map(|one| one.iter().map(|value| value * value).sum::<f64>()).sum();
    let count: usize = all.iter().map(Vec::len).sum();
    let mut products = fit::LaggedProducts::new(&all);
    let lags = LAGS.min(count / 4);
    if lags == 0 {
        return None;
    }
    let mean_square = power / count as f64;
    let mut statistic = 0.0;
    let [mut shared, mut apart] = [0.0; 2];
    for lag in 1..=lags {
        let pairs: usize = all.iter().map(|one| one.len().saturating_sub(lag)).sum();
        let covariance = products.at(lag) / pairs.max(1) as f64;
        let correlation = if mean_square > 0.0 { covariance / mean_square } else { 0.0 };
        statistic += correlation * correlation * pairs as f64;
        if lag <= 3 {
            shared += covariance / 3.0;
            apart += covariance.abs() / 3.0;
        }
    }
    // What goes to and fro cancels in the sum, and not in the squares of the correlations, beyond those of white noise.
    let beyond = (statistic - lags as f64).max(0.0) / count as f64;
    let swinging = if apart > 2.0 * shared { mean_square * (beyond / lags as f64).sqrt() } else { 0.0 };
    Some(ChannelResidual {
        rms: mean_square.sqrt(),
        coloured_rms: shared.max(0.0).sqrt(),
        swinging_rms: swinging.sqrt(),
        // Chi-square with as many degrees of freedom as lags: that is its mean, and half of its variance.
        colour_sigma: (statistic - lags as f64) / (2.0 * lags as f64).sqrt(),
        count,
    })
}

impl ChannelResidual {
    /// Is it just noise: white (within `limit` standard deviations of the test), or coloured by less than the model's
    /// `error`, and no larger than the noise where the noise is known? To and fro, a sensor that is read in steps errs by more
    /// than the model, by `swing` at most.
    pub fn is_noise(&self, [error, swing]: [f64; 2], known_noise: Option<f64>, limit: f64) -> bool {
        let is_small = self.coloured_rms <= error && self.swinging_rms <= swing;
        let white = self.colour_sigma <= limit || is_small;
        let small = known_noise.is_none_or(|noise| {
            let excess = (self.rms / noise).powi(2) - 1.0;
            let tolerance = limit * (2.0 / self.count as f64).sqrt();
            excess <= tolerance || (self.rms * self.rms - noise * noise).max(0.0).sqrt() <= error
        });
        white && small
    }
}

/// Position residual of a record at each sample, m; none where a sample is lost or not compared.
pub(super) fn left_at_each(record: &Prepared, outputs: &[Outputs<f64>]) -> Vec<Option<f64>> {
    let left = |(sample, output): (usize, &Outputs<f64>)| {
        let left = record.measured(0)[sample] - output.user;
        (record.is_compared(sample) && left.is_finite()).then_some(left)
    };
    outputs.iter().enumerate().map(left).collect()
}

/// Root mean square of the position residual of a record in each of some equal parts of its time, m; none in a part of which
/// nothing is compared.
pub fn over_time(record: &Prepared, outputs: &[Outputs<f64>], parts: usize) -> Vec<Option<f64>> {
    let left = left_at_each(record, outputs);
    let in_part = |part: usize| {
        let left = &left[part * left.len() / parts..(part + 1) * left.len() / parts];
        left.iter().any(Option::is_some).then(|| fit::rms(left.iter().flatten().copied()))
    };
    (0..parts).map(in_part).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::prepare;
    use crate::record::Record;
    use crate::rig::BUILT_IN;
    use eha_monitor::channel::Channel;
    use rand_distr::{Distribution, Normal};
    use rand_xoshiro::rand_core::SeedableRng;

    #[test]
    fn no_hum_of_any_frequency_is_noise_and_noise_is() {
        let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(11);
        let normal = Normal::new(0.0, 5e-6).unwrap();
        let mut noise = |hum: f64, cycles: f64| -> Vec<f64> {
            let wave = |k: usize| hum * (TAU * cycles * k as f64 + 0.3).sin();
            (0..2000).map(|k| wave(k) + normal.sample(&mut random)).collect()
        };
        let is_noise = |values: Vec<f64>| test(&[values]).unwrap().is_noise([0.3e-6; 2], None, 5.0);
        assert!((0..20).all(|_| is_noise(noise(0.0, 0.0))));
        for hundredths in 1..50 {
            let cycles = 0.01 * f64::from(hundredths);
            assert!(!is_noise(noise(4e-6, cycles)), "{cycles} cycles a sample");
            // A model whose own error is as large.
            let by_error = test(&[noise(4e-6, cycles)]).unwrap().is_noise([4e-6; 2], None, 5.0);
            assert!(by_error, "{cycles} cycles a sample");
        }
    }

    #[test]
    fn what_is_left_is_shown_when_it_is_left() {
        let rig = (BUILT_IN[0].make)();
        let wave: Vec<f64> = (-100..300).map(|k| 4e-3 * (31.4e-3 * f64::from(k.max(0))).sin()).collect();
        let off = |k: usize| if (100..200).contains(&k) { 1e-5 } else { 0.0 };
        let lvdt = wave.iter().enumerate().map(|(k, x)| if k < 380 { x + off(k) } else { f64::NAN });
        let channels = vec![(Channel::Command, wave.clone()), (Channel::UserPosition, lvdt.collect())];
        let record = prepare(&rig, &Record::new("off", 1e-3, 0.0, channels).unwrap());
        let outputs: Vec<Outputs<f64>> =
            wave.iter().map(|&user| Outputs { user, ..Outputs::default() }).collect();
        let left = over_time(&record, &outputs, 20);
        let is_as = |left: Option<f64>, wanted: f64| left.is_some_and(|left| (left - wanted).abs() < 1e-12);
        for (part, left) in left[..19].iter().enumerate() {
            assert!(is_as(*left, off(20 * part)), "{part}: {left:?}");
        }
        assert_eq!(left[19], None);
        // More parts than samples.
        assert_eq!(over_time(&record, &outputs[..2], 4).iter().flatten().count(), 2);
    }

    #[test]
    fn a_fit_and_a_diagnosis_say_alike_how_often_what_is_left_repeats_itself() {
        let rig = (BUILT_IN[0].make)();
        let fitted = |drift: f64| {
            let mut random = rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(7);
            let mut noise = |sigma: f64| Normal::new(0.0, sigma).unwrap().sample(&mut random);
            let command: Vec<f64> = (0..500).map(|k| 1e-3 * (f64::from(k) * 0.02).sin()).collect();
            let noises = [5e-6, f64::INFINITY, 0.02, f64::INFINITY];
            let prepared = |position: &[f64], current: &[f64]| {
                let channels = [Channel::Command, Channel::UserPosition, Channel::Current];
                let values = [&command[..], position, current].map(<[f64]>::to_vec);
                let channels = channels.into_iter().zip(values).collect();
                fit::prepare_with(&rig, &Record::new("two", 1e-3, 0.0, channels).unwrap(), noises)
            };
            let outputs = fit::predict(&rig, &[prepared(&command, &command)]).concat();
            // Twice the noise in the position, white; what is missing shows in the current.
            let position: Vec<f64> = outputs.iter().map(|output| output.user + noise(1e-5)).collect();
            let current: Vec<f64> = (0..500)
                .map(|k| outputs[k].current + noise(0.02) + drift * (k as f64 * 0.01).sin())
                .collect();
            let records = [prepared(&position, &current)];
            let settings = fit::FitSettings { budget: 60, ..fit::FitSettings::default() };
            let fit = fit::fit(&rig, &rig.faults, &records, &settings, |_| {});
            let scale = fit.misfit.mean_square().max(1.0);
            let both = correlation_time(&records, &fit.predictions);
            assert!((fit.inflation / scale / both - 1.0).abs() < 1e-12, "{} {both}", fit.inflation / scale);
            // What is handed on is as of white noise.
            let handed_on = fit.polished();
            let there = fit::polish(&rig, &rig.faults, &handed_on.values, &records).unwrap();
            for fault in 0..2 {
                let ratio = handed_on.standard_error(fault) / there.standard_error(fault);
                assert!((ratio - 1.0).abs() < 0.05, "{fault}: {ratio}");
            }
            (both, fit::correlation_time(&series(&records, &fit.predictions, 0)))
        };
        let (both, of_position) = fitted(0.1);
        assert!(both > 30.0 && of_position < 3.0, "{both} {of_position}");
        assert!(fitted(0.0).0 < 3.0);
    }

    #[test]
    fn a_channel_without_noise_hides_no_misfit_of_another() {
        let rig = (BUILT_IN[0].make)();
        let position: Vec<f64> = (0..1000).map(|k| 1e-3 * (f64::from(k) * 5e-3).sin()).collect();
        let channels = [Channel::Command, Channel::UserPosition, Channel::RamPosition]
            .map(|name| (name, position.clone()));
        let record = Record::new("exact", 1e-3, 0.0, channels.to_vec()).unwrap();
        let noise = [5e-6, 1e-7, f64::INFINITY, f64::INFINITY];
        let records = [fit::prepare_with(&rig, &record, noise)];
        let compared = (0..1000).filter(|&sample| records[0].is_compared(sample)).count() as f64;
        let beyond = |of_user: f64, of_ram: f64| {
            let off = |&x: &f64| Outputs { user: x + of_user, ram: x + of_ram, ..Outputs::default() };
            excess(&records, &[position.iter().map(off).collect()])
        };
        let is_near = |found: f64, wanted: f64| (found - wanted).abs() < 1e-6 * compared;
        assert!(is_near(beyond(7e-6, 0.0), (1.4 * 1.4 - 1.0) * compared));
        assert!(is_near(beyond(7e-6, 3e-7), (1.4 * 1.4 - 1.0 + 8.0) * compared));
        // As large as noise, or smaller.
        assert!(is_near(beyond(5e-6, 0.0), 0.0) && is_near(beyond(2e-6, 1e-7), 0.0));
    }

    #[test]
    fn steps_of_a_sensor_make_what_looks_like_them() {
        let rig = (BUILT_IN[0].make)();
        let position: Vec<f64> = (0..2000).map(|k| 1e-3 * (f64::from(k) * 5e-3).sin()).collect();
        let channels = vec![(Channel::Command, position.clone()), (Channel::UserPosition, position.clone())];
        let record = Record::new("made".to_owned(), 1e-3, 0.0, channels).unwrap();
        let noise = [5e-6, f64::INFINITY, f64::INFINITY, f64::INFINITY];
        let records = [fit::prepare_with(&rig, &record, noise)];
        let shown = |user: f64| Outputs { user, ..Outputs::default() };
        let after = vec![position.iter().map(|&user| shown(user)).collect::<Vec<_>>()];
        let (step, error) = (2e-5, 3e-6);
        let share_of = |change: &dyn Fn(f64) -> f64| {
            let before = position.iter().map(|&user| shown(user - change(user))).collect();
            share_of_steps(&records, &[Some(Steps { step, error }), None, None, None], &[before], &after)
        };
        // Of the saw tooth, twice as large, they make a half; the same wherever it is zero.
        for phase in [0.0, 1.0, 2.0] {
            let share = share_of(&|user| 2.0 * SQRT_2 * error * (TAU * user / step + phase).sin());
            assert!((share - 0.5).abs() < 0.02, "{phase}: {share}");
        }
        // Of an offset as large as they err by, next to nothing.
        let share = share_of(&|_| error);
        assert!(share < 0.05, "{share}");
    }

    #[test]
    fn what_is_not_compared_is_no_part_of_the_way_that_steps_make() {
        let rig = (BUILT_IN[0].make)();
        let position: Vec<f64> = (0..2000).map(|k| 1e-3 * (f64::from(k) * 5e-3).sin()).collect();
        let noise = [5e-6, f64::INFINITY, f64::INFINITY, f64::INFINITY];
        let shown = |user: f64| Outputs { user, ..Outputs::default() };
        let (step, error) = (2e-5, 3e-6);
        // At its command, the record is compared from its start on; beside it, not before that is forgotten.
        let share_of = |offset: f64| {
            let measured: Vec<f64> = position.iter().map(|user| user + offset).collect();
            let channels = vec![(Channel::Command, position.clone()), (Channel::UserPosition, measured)];
            let record = Record::new("beside".to_owned(), 1e-3, 0.0, channels).unwrap();
            let records = [fit::prepare_with(&rig, &record, noise)];
            let settling = (0..2000).filter(|&sample| !records[0].is_compared(sample)).count();
            let after: Vec<_> = position.iter().map(|&user| shown(user)).collect();
            let change = |(sample, user): (usize, &f64)| {
                let tooth = 2.0 * SQRT_2 * error * (TAU * user / step).sin();
                shown(user - if sample < settling { 1e-3 } else { tooth })
            };
            let before = position.iter().enumerate().map(change).collect();
            let steps = [Some(Steps { step, error }), None, None, None];
            (settling, share_of_steps(&records, &steps, &[before], &[after]))
        };
        for (offset, settles) in [(0.0, false), (1e-3, true)] {
            let (settling, share) = share_of(offset);
            assert!((settling > 0) == settles && (share - 0.5).abs() < 0.03, "{settling}: {share}");
        }
    }
}
