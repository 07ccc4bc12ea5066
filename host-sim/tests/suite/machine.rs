//! A servo-hydraulic testing machine whose model is fitted to one record and foretells others, which go faster and pull
//! harder. Skipped, with a message, where the measured data are not there.

use crate::measured_data;
use eha_monitor::parameter::Parameter as P;
use host_sim::diagnose::score;
use host_sim::fit::{self, Prepared};
use host_sim::record::{self, ReadOptions, Record};
use host_sim::rig::{Range, Rig};

/// The record that is fitted, and those that are foretold.
const RECORDS: [&str; 3] = ["chirp15_0A", "chirp20_0A", "chirp20_1A"];
/// Largest residual of each, m rms (measured: 9.9, 30.6 and 23.6 um).
const BARS: [f64; 3] = [10e-6, 32e-6, 27e-6];
/// The same of the bare model, at least (measured: 21.0, 42.8 and 39.5 um).
const BARE: [f64; 3] = [20e-6, 40e-6, 37e-6];

const fn range(parameter: P, lower: f64, upper: f64) -> Range {
    Range { parameter, lower, upper }
}

/// What is free from the start.
const PLAIN: [Range; 4] = [
    range(P::ProportionalGain, 1000.0, 6000.0),
    range(P::ValveBandwidth, 20.0, 2000.0),
    range(P::Backlash, 0.0, 2e-4),
    range(P::DryFriction, 0.0, 4000.0),
];

/// What `diagnose` adds.
const EFFECTS: [Range; 4] = [
    range(P::FlowAsymmetry, -0.2, 0.2),
    range(P::SensorDelay, 0.0, 6e-3),
    range(P::SpoolOverlap, 0.0, 5e-5),
    range(P::SensorGain, -0.1, 0.1),
];

/// Rough values of all of them.
const ROUGH: [(P, f64); 8] = [
    (P::ProportionalGain, 2700.0),
    (P::ValveBandwidth, 400.0),
    (P::Backlash, 1e-5),
    (P::DryFriction, 10.0),
    (P::FlowAsymmetry, 0.03),
    (P::SensorDelay, 2e-3),
    (P::SpoolOverlap, 4e-6),
    (P::SensorGain, 0.005),
];

fn measured() -> Option<[Record; 3]> {
    let read = |name| {
        let path = measured_data::file(&format!("mts/{name}.csv"))?;
        Some(record::read(&path, &ReadOptions::default()).unwrap().record)
    };
    let [first, second, third] = RECORDS.map(read);
    Some([first?, second?, third?])
}

/// Residuals of all records after a fit to the first, of ranges and from values.
fn errors(rig: &Rig, ranges: &[Range], values: &[(P, f64)], records: &[Record]) -> [f64; 3] {
    let mut rig = rig.clone();
    for &(parameter, value) in values {
        rig.parameters.set(parameter, value);
    }
    let prepared: Vec<Prepared> = records.iter().map(|record| fit::prepare(&rig, record)).collect();
    let start: Vec<f64> = ranges.iter().map(|range| rig.parameters.get(range.parameter)).collect();
    let fitted = fit::polish(&rig, ranges, &start, &prepared[..1]).unwrap().applied(&rig, ranges);
    let errors = [0, 1, 2].map(|index| score(&fitted, &prepared[index..=index]).position_rms());
    println!("{:?} {errors:?}", ranges.iter().map(|range| range.parameter).collect::<Vec<_>>());
    errors
}

#[test]
fn one_record_of_the_machine_foretells_the_others() {
    let Some(records) = measured() else { return };
    let rig = Rig::load("servo-hydraulic").unwrap();
    let all = [&PLAIN[..], &EFFECTS].concat();
    let bare = errors(&rig, &PLAIN, &ROUGH[..4], &records);
    let after = errors(&rig, &all, &ROUGH, &records);
    for (((after, bar), bare), least) in after.iter().zip(BARS).zip(bare).zip(BARE) {
        assert!(*after <= bar, "{after} m rms, at most {bar}");
        assert!(bare >= least, "{bare} m rms, at least {least}");
    }
    // Negative controls: with any of the effects left out every record is explained less well.
    for left_out in EFFECTS.map(|range| range.parameter) {
        let ranges: Vec<Range> = all.iter().filter(|range| range.parameter != left_out).copied().collect();
        let values: Vec<_> = ROUGH.iter().filter(|(parameter, _)| *parameter != left_out).copied().collect();
        let worse = errors(&rig, &ranges, &values, &records);
        assert!(worse.iter().zip(after).all(|(worse, after)| *worse > after), "no {left_out:?}: {worse:?}");
    }
}
