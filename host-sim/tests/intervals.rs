//! What the intervals of the faults hold besides noise: records of a program that steps as the source does.

use eha_monitor::channel::Channel;
use host_sim::fit::{self, Prepared};
use host_sim::record::Record;
use host_sim::rig::Rig;
use reference_plant::{Command, Plant, Rule, SAMPLE_PERIOD};

const NOISE: f64 = 1.5e-6;
const TRUTH: [f64; 2] = [4e-4, 250.0];
/// Where the fits start: not at the truth, which would be found by staying there.
const START: [f64; 2] = [3.9e-4, 260.0];
const FDJ: usize = 1;

/// The position of an actuator over a long chirp, whose fast end tells its friction to a tenth of a newton: without
/// noise, so that nothing but the steps is off, but said to have some.
fn flown(rig: &Rig, rule: Rule) -> Prepared {
    let mut plant = Plant { rule, ..Plant::default() };
    [plant.parameters.backlash, plant.parameters.jack_friction] = TRUTH;
    let data = plant.record(&Command::Chirp { amplitude: 4.3e-3 }, 4300);
    let channels = vec![(Channel::Command, data.command), (Channel::UserPosition, data.lvdt)];
    let record = Record::new("flown", SAMPLE_PERIOD, 0.0, channels).unwrap();
    fit::prepare_with(rig, &record, [NOISE; Channel::MEASURED.len()])
}

#[test]
fn intervals_hold_what_the_steps_of_the_source_look_like() {
    let rig = Rig::load("eha").unwrap();
    let ranges = rig.declared();
    let [(own_error, own_noise, _), (error, by_noise, by_all)] = [Rule::Midpoint, Rule::SemiImplicitEuler]
        .map(|rule| {
            let records = [flown(&rig, rule)];
            let fit = fit::polish(&rig, &ranges, &START, &records).unwrap();
            let error = (fit.values[FDJ] - TRUTH[FDJ]).abs();
            let by_noise = fit.standard_error(FDJ);
            let by_all = fit::standard_errors(&rig, &ranges, &fit, &records)[FDJ];
            println!("{rule:?}: off by {error:.3} N, {by_noise:.3} N by noise, {by_all:.3} N by all");
            (error, by_noise, by_all)
        });
    assert!(error < 1.96 * by_all, "{error} N");
    // What noise alone would have said, and steps that are no error.
    assert!(error > 1.96 * by_noise, "{error} N");
    assert!(own_error < 0.5 * own_noise, "{own_error} N");
}
