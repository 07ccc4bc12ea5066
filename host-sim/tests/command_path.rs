//! Commands that were continuous functions of time, read from their samples.

use eha_monitor::channel::Channel;
use host_sim::fit;
use host_sim::record::Record;
use host_sim::rig::{CommandPath, Rig};
use reference_plant::{Command, DEFAULT_STEP, Plant};

const SAMPLES: usize = 1501;
const PERIOD: f64 = 1e-3;
/// Largest distance of the user position, m rms, that a path may be off the plant that flew the curve: the design's bar is
/// 0.3 um.
const LIMIT: f64 = 0.1e-6;

/// How far the monitor's model with the right faults is off a plant that flies a command, m rms.
fn distance(plant: &Plant, command: &Command, path: CommandPath) -> f64 {
    let flown = plant.simulate(command, SAMPLES, DEFAULT_STEP);
    let channels =
        vec![(Channel::Command, flown.command.clone()), (Channel::UserPosition, flown.lvdt.clone())];
    let record = Record::new("flown", PERIOD, 0.0, channels).unwrap();
    let mut rig = Rig { command_path: path, ..Rig::load("eha").unwrap() };
    rig.parameters.bkl = plant.parameters.backlash;
    rig.parameters.fdj = plant.parameters.jack_friction;
    let prepared = fit::prepare_with(&rig, &record, [1e-6; Channel::MEASURED.len()]);
    let predicted = fit::predict(&rig, &[prepared]).concat();
    let squares = predicted.iter().zip(&flown.lvdt).map(|(ours, theirs)| (ours.user - theirs).powi(2));
    (squares.sum::<f64>() / SAMPLES as f64).sqrt()
}

#[test]
fn a_curve_is_followed_through_smooth_parts_corners_and_jumps() {
    let mut plant = Plant::default();
    (plant.parameters.backlash, plant.parameters.jack_friction) = (2e-4, 800.0);
    let fast = Command::Sine { amplitude: 2e-3, frequency: 12.0 };
    let mut worst_of_lines: f64 = 0.0;
    for (name, command) in Command::NAMED.into_iter().chain([("fast sine", fast)]) {
        let [lines, curve] =
            [CommandPath::Lines, CommandPath::Curve].map(|path| distance(&plant, &command, path));
        println!("{name:10} lines {:.3} um, curve {:.3} um", 1e6 * lines, 1e6 * curve);
        assert!(curve < LIMIT, "{name}: {curve} m");
        worst_of_lines = worst_of_lines.max(lines);
    }
    // What the limit guards against.
    assert!(worst_of_lines > 100.0 * LIMIT, "{worst_of_lines} m");
}
