//! Samples in which nothing happens are gone over several at a time: that must miss nothing.

mod common;

use common::{PERIOD, command};
use eha_monitor::command::COMMANDS;
use eha_monitor::fit::problem::{Record, Start};
use eha_monitor::fit::walk::Walk;
use eha_monitor::integrate::Stepper;
use eha_monitor::integrate::exact::Exact;
use eha_monitor::model::state::BASE_ORDER;
use eha_monitor::model::{Form, Model};
use eha_monitor::parameter::Parameters;
use eha_monitor::random::Random;

const SAMPLES: usize = 1000;
/// Largest difference of the ram, m: rounding, amplified by a loop that sticks and slides.
const ROUNDING: f64 = 1e-11;
/// The same where a command is so rough that the flapper turns within a sample, and what it did in the samples before does
/// not tell of it: a tenth of what the model is held to. One of 128 runs needs it.
const ROUGHNESS: f64 = 3e-8;

/// The ram, m, by both ways: sample by sample, and as a fit goes.
fn both_ways(command: &[f64], fdj: f64) -> [Vec<f64>; 2] {
    let parameters = Parameters { fdj, bkl: 2e-4, ..Parameters::default() };
    let model = Model::new(Form::default(), &parameters);
    let start = Start { time: 0.0, ram: command[0], velocity: 0.0 };
    let record = Record::new(PERIOD, command, &start);
    let begun = || {
        let mut stepper = Exact::<f64, BASE_ORDER, 32>::new();
        stepper.begin(PERIOD, false, true);
        (Walk::new(&model, &record), stepper)
    };
    let (mut walk, mut stepper) = begun();
    let one_by_one =
        std::iter::from_fn(|| walk.next(&record, &mut stepper)).map(|(_, outputs)| outputs.ram).collect();
    let (mut walk, mut stepper) = begun();
    let mut gliding = Vec::new();
    walk.lead_on(&record, &mut stepper, &mut [], SAMPLES, |_, outputs, _| gliding.push(outputs.ram));
    [one_by_one, gliding]
}

fn check(name: &str, command: &[f64], most: f64) {
    for fdj in [0.0, 200.0, 800.0, 3200.0] {
        let [one_by_one, gliding] = both_ways(command, fdj);
        let differences = one_by_one.iter().zip(&gliding).map(|(one, other)| (one - other).abs());
        let largest = differences.fold(0.0, f64::max);
        assert_eq!(one_by_one.len(), gliding.len());
        assert!(largest < most, "{name}, {fdj} N: {largest:e} m");
    }
}

#[test]
fn built_in_commands() {
    for row in COMMANDS {
        check(row.name, &command(row.name, SAMPLES), ROUNDING);
    }
}

/// A smooth command says little: what is rough within a few samples may reach a limit and be back before the next look.
#[test]
fn rough_commands() {
    let smooth = command("chirp", SAMPLES);
    for (seed, roughness) in
        (0..8).flat_map(|seed| [1e-7, 1e-6, 1e-5, 1e-4].map(|roughness| (seed, roughness)))
    {
        let mut random = Random::new(seed);
        let rough: Vec<f64> = smooth.iter().map(|value| value + roughness * random.bell::<f64>()).collect();
        check(&format!("chirp with {roughness} m of noise, seed {seed}"), &rough, ROUGHNESS);
    }
    for height in [-2e-3, -2e-4, -5e-5, 5e-5, 2e-4, 2e-3] {
        for width in [1, 2, 4] {
            let mut pulses = smooth.clone();
            for start in (50..SAMPLES - 5).step_by(37) {
                pulses[start..start + width].iter_mut().for_each(|value| *value += height);
            }
            check(&format!("chirp with pulses of {height} m and {width} samples"), &pulses, ROUNDING);
        }
    }
}
