//! What is left where nothing explains the records, in words: what it follows, when it acts, at which frequency.

use super::residual::left_at_each;
use crate::fit::{self, Prepared};
use eha_monitor::model::state::Outputs;

/// Correlation with a quantity of the motion from which on what is left is said to follow it.
const FOLLOWS: f64 = 0.5;
/// How many times as long as what is left a quantity may act for that to follow it: the end of a chirp is no drift.
const LONGER: usize = 2;
/// Share of the power in one frequency from which on it is said to be a tone.
const TONE: f64 = 0.4;

/// What an unexplained residual goes with.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// Which of the fitted records it is of.
    pub record: usize,
    /// Quantity of the motion that it follows best, and the correlation.
    pub follows: Option<(&'static str, f64)>,
    /// Interval, s from the start of the record, that holds half of its power in the shortest time.
    pub active: [f64; 2],
    /// Frequency with the most power, Hz, and its share of the power.
    pub tone: Option<(f64, f64)>,
}

/// Describes the position residual of the record of which most is left beyond noise; the first of as much.
pub fn describe(records: &[Prepared], predictions: &[Vec<Outputs<f64>>]) -> Option<Description> {
    let beyond_noise = |(record, outputs): (&Prepared, &Vec<Outputs<f64>>)| -> f64 {
        let left = left_at_each(record, outputs).into_iter().flatten();
        left.map(|left| (left / record.noise[0]).powi(2) - 1.0).sum()
    };
    let all = records.iter().zip(predictions).map(beyond_noise).enumerate();
    let (index, _) = all.reduce(|most, next| if next.1 > most.1 { next } else { most })?;
    let described = of_record(&records[index], &predictions[index]);
    Some(Description { record: index, ..described })
}

fn of_record(record: &Prepared, outputs: &[Outputs<f64>]) -> Description {
    let period = record.sample_period;
    let left: Vec<f64> =
        left_at_each(record, outputs).into_iter().map(|left| left.unwrap_or(f64::NAN)).collect();
    let ram: Vec<f64> = outputs.iter().map(|output| output.ram).collect();
    let [from, to] = active(&left);
    let acts_as_long = |quantity: &Quantity| {
        let [first, end] = active(&quantity.values);
        end - first <= LONGER * (to - from)
    };
    let follows = motion(&ram, period, &left)
        .into_iter()
        .filter(acts_as_long)
        .filter_map(|quantity| Some((quantity.in_words?, correlation(&left, &quantity.values))))
        .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
        .filter(|(_, correlation)| correlation.abs() > FOLLOWS);
    let tone = fit::strongest_tone(&left, period).filter(|(_, share)| *share > TONE);
    Description { record: 0, follows, active: [from, to].map(|sample| sample as f64 * period), tone }
}

/// A quantity of a motion that a residual may follow.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantity {
    /// Its name in a figure.
    pub name: &'static str,
    /// What it is called in a sentence; none where a figure alone shows it.
    pub in_words: Option<&'static str>,
    /// Its values; NaN where nothing is left to follow it.
    pub values: Vec<f64>,
}

/// Quantities of the motion of a ram, at the samples of a residual that are not NaN. Means are taken off all but a
/// constant and the time, since a drift begins with nothing; at rest the direction is neither of the two.
pub fn motion(ram: &[f64], sample_period: f64, left: &[f64]) -> Vec<Quantity> {
    let last = ram.len().saturating_sub(1);
    let slope = |series: &[f64]| -> Vec<f64> {
        (0..series.len())
            .map(|k| (series[(k + 1).min(last)] - series[k.saturating_sub(1)]) / (2.0 * sample_period))
            .collect()
    };
    let velocity = slope(ram);
    let acceleration = slope(&velocity);
    let direction = |v: &f64| if *v == 0.0 { 0.0 } else { v.signum() };
    let compared = |series: Vec<f64>| -> Vec<f64> {
        let shown = |(value, left): (f64, &f64)| if left.is_finite() { value } else { f64::NAN };
        series.into_iter().zip(left).map(shown).collect()
    };
    let centred = |series: Vec<f64>| -> Vec<f64> {
        let series = compared(series);
        let present = fit::present(&series);
        let mean = present.iter().sum::<f64>() / present.len().max(1) as f64;
        series.into_iter().map(|value| value - mean).collect()
    };
    let quantity = |name, in_words, values| Quantity { name, in_words, values };
    vec![
        quantity("a constant", Some("a constant"), compared(vec![1.0; ram.len()])),
        quantity("position", Some("the position"), centred(ram.to_vec())),
        quantity("velocity", Some("the velocity"), centred(velocity.clone())),
        quantity("speed", Some("the speed"), centred(velocity.iter().map(|v| v.abs()).collect())),
        quantity(
            "direction",
            Some("the direction of motion"),
            centred(velocity.iter().map(direction).collect()),
        ),
        // Of what swings it is the position, turned round.
        quantity("acceleration", None, centred(acceleration)),
        quantity("time", Some("time (a drift)"), compared((0..ram.len()).map(|k| k as f64).collect())),
    ]
}

/// Correlation of a residual with a quantity; NaN adds nothing.
fn correlation(left: &[f64], quantity: &[f64]) -> f64 {
    let sum = |a: &[f64], b: &[f64]| -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).filter(|product| product.is_finite()).sum()
    };
    let powers = sum(left, left) * sum(quantity, quantity);
    sum(left, quantity) / powers.sqrt().max(f64::MIN_POSITIVE)
}

/// First sample, and the one after the last, of the shortest run that holds half of the power.
fn active(left: &[f64]) -> [usize; 2] {
    let power = |value: f64| if value.is_finite() { value * value } else { 0.0 };
    let total: f64 = left.iter().map(|&value| power(value)).sum();
    let (mut best, mut low, mut held) = ([0, left.len()], 0, 0.0);
    for (high, &value) in left.iter().enumerate() {
        held += power(value);
        while low < high && held - power(left[low]) >= total / 2.0 {
            held -= power(left[low]);
            low += 1;
        }
        if held >= total / 2.0 && high + 1 - low < best[1] - best[0] {
            best = [low, high + 1];
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Record;
    use crate::rig::BUILT_IN;
    use eha_monitor::channel::Channel;
    use std::f64::consts::TAU;

    /// A sine, and what a model without more in it leaves of some records of it.
    fn described(count: usize, left: &[&dyn Fn(usize) -> f64]) -> Description {
        let rig = (BUILT_IN[0].make)();
        let wave = |k: usize| 4e-3 * (31.4e-3 * k as f64).sin();
        let outputs: Vec<Outputs<f64>> =
            (0..count).map(|k| Outputs { user: wave(k), ram: wave(k), ..Outputs::default() }).collect();
        let record = |left: &&dyn Fn(usize) -> f64| {
            let channels = vec![
                (Channel::Command, (0..count).map(wave).collect()),
                (Channel::UserPosition, (0..count).map(|k| wave(k) + left(k)).collect()),
            ];
            let record = Record::new("made", 1e-3, 0.0, channels).unwrap();
            fit::prepare_with(&rig, &record, [1e-6, f64::INFINITY, f64::INFINITY, f64::INFINITY])
        };
        let records: Vec<Prepared> = left.iter().map(record).collect();
        describe(&records, &vec![outputs; records.len()]).unwrap()
    }

    #[test]
    fn what_is_left_is_described_although_samples_are_lost() {
        let hum = |k: usize| if k < 400 { 0.0 } else { 1e-5 * (0.3 * k as f64).sin() };
        let with_gaps = |k: usize| if k % 50 == 7 { f64::NAN } else { hum(k) };
        for Description { follows, active, tone, .. } in
            [described(2000, &[&hum]), described(2000, &[&with_gaps])]
        {
            assert_eq!(follows, None);
            assert!(active[0] >= 0.4 && (active[1] - active[0] - 0.8).abs() < 0.03, "{active:?}");
            let (frequency, share) = tone.unwrap();
            assert!((frequency - 0.3e3 / TAU).abs() < 1.0 && share > 0.4, "{tone:?}");
        }
    }

    #[test]
    fn a_hum_is_a_tone_of_its_frequency_up_to_half_of_the_sampling_rate() {
        for hertz in [3.0, 50.0, 200.0, 499.0] {
            let hum = |k: usize| 1e-5 * (TAU * hertz * 1e-3 * k as f64 + 0.4).sin();
            let (frequency, share) = described(20_000, &[&hum]).tone.unwrap();
            assert!((frequency - hertz).abs() < 0.03 && share > 0.9, "{hertz}: {frequency} {share}");
        }
        // As strong, and no tone.
        let scattered = |k: usize| 1e-5 * (k as f64 * k as f64 * 0.618).sin();
        assert_eq!(described(20_000, &[&scattered]).tone, None);
    }

    #[test]
    fn what_is_left_at_the_end_alone_is_no_drift() {
        let drift = |k: usize| 1e-8 * (k as f64 - 1000.0);
        let end = |k: usize| if k < 1700 { 0.0 } else { 1e-5 };
        let follows = |left: &dyn Fn(usize) -> f64| described(2000, &[left]).follows.map(|(name, _)| name);
        assert_eq!(follows(&drift), Some("time (a drift)"));
        assert_eq!(follows(&end), None);
        // It would by its correlation.
        let left: Vec<f64> = (0..2000).map(end).collect();
        let time = motion(&[0.0; 2000], 1e-3, &left).pop().unwrap();
        assert!(correlation(&left, &time.values) > FOLLOWS);
    }

    #[test]
    fn the_record_of_which_most_is_left_is_described() {
        let clean = |_: usize| 1e-7;
        let pushed = |k: usize| if k < 1000 { 0.0 } else { 1e-5 };
        let found = described(2000, &[&clean, &pushed, &clean]);
        assert!(found.record == 1 && found.active[0] >= 1.0, "{found:?}");
        assert_eq!(described(2000, &[&clean, &clean]).record, 0);
    }

    #[test]
    fn a_rest_is_no_direction_and_an_offset_no_position() {
        // It goes out, rests there twice as long, and comes back.
        let ram: Vec<f64> = (0..400_u32).map(|k| f64::from(k.min(100).min(400 - k))).collect();
        let direction: Vec<f64> = (0..400)
            .map(|k| {
                if k < 100 {
                    1.0
                } else if k >= 300 {
                    -1.0
                } else {
                    0.0
                }
            })
            .collect();
        let found = |left: &[f64], name: &str| {
            let all = motion(&ram, 1e-3, left);
            let quantity = all.into_iter().find(|quantity| quantity.name == name).unwrap();
            correlation(left, &quantity.values)
        };
        assert!(found(&direction, "direction") > 0.99, "{}", found(&direction, "direction"));
        // What is as large at rest as going out is no direction.
        let held: Vec<f64> = direction.iter().map(|&way| if way < 0.0 { -1.0 } else { 1.0 }).collect();
        assert!(found(&held, "direction") < 0.8);
        assert!(found(&[1.0; 400], "position").abs() < 1e-9 && found(&[1.0; 400], "a constant") > 0.99);
        // Nor is there any where nothing is compared.
        assert_eq!(found(&[f64::NAN; 400], "position"), 0.0);
    }
}
