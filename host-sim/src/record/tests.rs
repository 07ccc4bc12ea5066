//! Tests of [`Record`](super::Record) made in memory.

use super::*;

/// A sine of 1 mm that both the command and the position follow.
fn motion(samples: usize) -> Vec<f64> {
    (0..samples).map(|k| 1e-3 * (k as f64 * 0.1).sin()).collect()
}

fn record(channels: Vec<(Channel, Vec<f64>)>) -> Result<Record, RecordError> {
    Record::new("made", 1e-3, 2.0, channels)
}

fn message(channels: Vec<(Channel, Vec<f64>)>) -> String {
    record(channels).expect_err("must be refused").to_string()
}

fn pair(samples: usize) -> Vec<(Channel, Vec<f64>)> {
    vec![(Channel::UserPosition, motion(samples)), (Channel::Command, motion(samples))]
}

#[test]
fn channels_are_in_the_order_of_the_table() -> Result<(), RecordError> {
    let record = record(pair(60))?;
    let order: Vec<Channel> = record.channels().map(|(channel, _)| channel).collect();
    assert_eq!(order, [Channel::Command, Channel::UserPosition]);
    assert_eq!((record.name(), record.len()), ("made", 60));
    assert_eq!(record.channel(Channel::Current), None);
    assert_eq!(record.missing_count(Channel::Current), 0);
    Ok(())
}

#[test]
fn times_are_the_nearest_to_the_decimal_number() -> Result<(), RecordError> {
    let record = Record::new("made", 1e-3, 0.0, pair(60))?;
    assert_eq!(record.time_s(9), 0.009);
    assert_eq!(record.time_s(57), 0.057);
    Ok(())
}

#[test]
fn missing_samples_are_counted_where_they_may_be() -> Result<(), RecordError> {
    let mut channels = pair(60);
    channels[0].1[7] = f64::NAN;
    assert_eq!(record(channels.clone())?.missing_count(Channel::UserPosition), 1);
    channels[1].1[7] = f64::NAN;
    assert!(
        message(channels).starts_with("made: channel `command_m`, sample 8: found `NaN`, expected a finite")
    );
    Ok(())
}

#[test]
fn every_rule_is_checked() {
    let with = |channel, values| {
        let mut channels = pair(60);
        channels.retain(|(other, _)| *other != channel);
        channels.push((channel, values));
        message(channels)
    };
    assert_eq!(message(vec![(Channel::Command, motion(60))]), "made: `lvdt_m` is missing: found `command_m`");
    assert_eq!(message(pair(49)), "made: found 49 samples, expected at least 50");
    assert_eq!(
        with(Channel::RamPosition, motion(59)),
        "made: channel `ram_m`: found 59 values, expected 60 as in the first series"
    );
    assert_eq!(
        with(Channel::UserPosition, vec![0.25; 60]),
        "made: channel `lvdt_m`: found the same value 0.25 in every sample, expected a position that moves"
    );
    assert_eq!(
        with(Channel::Current, vec![f64::NAN; 60]),
        "made: channel `current_mA`: found no value in 60 of 60 samples, expected at least 50 values"
    );
    assert!(with(Channel::Load, vec![f64::INFINITY; 60]).contains("sample 1: found `inf`"));
    let mut twice = pair(60);
    twice.push((Channel::Command, motion(60)));
    assert!(message(twice).starts_with("made: channel `command_m`: found the name a second time"));
    for period in [0.0, -1e-3, f64::NAN, f64::INFINITY] {
        let error = Record::new("made", period, 0.0, pair(60)).expect_err("period");
        assert!(matches!(error.problem(), Problem::BadPeriod(_)), "{error}");
    }
    assert!(Record::new("made", 1e-3, f64::NAN, pair(60)).is_err());
}
