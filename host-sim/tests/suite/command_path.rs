//! Commands that were continuous functions of time, read from their samples.

use eha_monitor::channel::Channel;
use eha_monitor::effect::EffectInfo;
use host_sim::fit;
use host_sim::record::Record;
use host_sim::rig::{CommandPath, Rig};
use reference_plant::{Command, DEFAULT_STEP, Plant};

const SAMPLES: usize = 1501;
const PERIOD: f64 = 1e-3;
/// Largest distance of the user position, m rms, that a path may be off the plant that flew it: the design's bar.
const BAR: f64 = 0.3e-6;
/// The same of a curve, which is far closer.
const LIMIT: f64 = 0.1e-6;

/// How far the monitor's model with the right faults is off a plant that flies a command, m rms.
fn distance(plant: &Plant, command: &Command, path: CommandPath) -> f64 {
    distance_ahead(plant, command, path, 0.0)
}

/// The same where the jumps of the command are ahead of their samples by a share of one.
fn distance_ahead(plant: &Plant, command: &Command, path: CommandPath, ahead: f64) -> f64 {
    let rig = Rig { command_path: path, ..Rig::load("eha").unwrap() };
    distance_of(rig, plant, command, ahead)
}

/// The same of a rig that has what the plant has besides faults.
fn distance_of(mut rig: Rig, plant: &Plant, command: &Command, ahead: f64) -> f64 {
    let flown = plant.simulate(command, SAMPLES, DEFAULT_STEP);
    let channels =
        vec![(Channel::Command, flown.command.clone()), (Channel::UserPosition, flown.lvdt.clone())];
    let record = Record::new("flown", PERIOD, 0.0, channels).unwrap();
    rig.parameters.bkl = plant.parameters.backlash;
    rig.parameters.fdj = plant.parameters.jack_friction;
    let noise = 1e-6;
    let record = fit::prepare_with(&rig, &record, [noise; Channel::MEASURED.len()]);
    let records = [record.with_jumps_ahead(record.jumps().into_iter().map(|jump| (jump, ahead)))];
    let predicted = fit::predict(&rig, &records).concat();
    let squares: f64 =
        predicted.iter().zip(&flown.lvdt).map(|(ours, theirs)| (ours.user - theirs).powi(2)).sum();
    // A fit walks along a record in longer strides than a prediction does.
    let fitted = fit::misfit(&rig, &[], &[], &records).chi_square * noise.powi(2);
    assert!((fitted - squares).abs() < 1e-6 * squares + f64::EPSILON * noise, "{fitted} is not {squares}");
    (squares / SAMPLES as f64).sqrt()
}

#[test]
fn a_command_that_is_held_is_followed_where_the_rig_says_so() {
    let mut plant = Plant::default();
    (plant.parameters.backlash, plant.parameters.jack_friction) = (2e-4, 800.0);
    for (name, command) in Command::NAMED {
        let command = command.held(SAMPLES, PERIOD);
        let [lines, held] =
            [CommandPath::Lines, CommandPath::Held].map(|path| distance(&plant, &command, path));
        println!("{name:10} lines {:.3} um, held {:.3} um", 1e6 * lines, 1e6 * held);
        assert!(held < BAR, "{name}: {held} m");
        // What the limit guards against.
        assert!(lines > 5.0 * BAR, "{name}: {lines} m");
    }
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

/// Whatever a command does between two samples: corners are seen in the samples, the time of a jump must be told.
#[test]
fn corners_and_jumps_between_samples_are_followed() {
    let mut plant = Plant::default();
    (plant.parameters.backlash, plant.parameters.jack_friction) = (2e-4, 800.0);
    for (name, command) in Command::NAMED {
        let mut untold: f64 = 0.0;
        for later in [0.07, 0.5, 0.83] {
            let command = command.clone().later(later * PERIOD);
            let [told, at_samples] =
                [1.0 - later, 0.0].map(|ahead| distance_ahead(&plant, &command, CommandPath::Curve, ahead));
            println!(
                "{name:10} {later} later: told {:.3} um, at samples {:.3} um",
                1e6 * told,
                1e6 * at_samples
            );
            assert!(told < LIMIT, "{name}, {later}: {told} m");
            untold = untold.max(at_samples);
        }
        let has_jumps = matches!(command, Command::MixedStep | Command::Step { .. });
        // What the limit guards against.
        assert_eq!(untold > 10.0 * LIMIT, has_jumps, "{name}: {untold} m");
    }
}

/// Models that are not affine, and those with more states, go over a jump with steps of their own.
#[test]
fn a_jump_between_samples_is_followed_beside_effects() {
    let mut plant = Plant::default();
    (plant.parameters.backlash, plant.parameters.jack_friction) = (2e-4, 800.0);
    let rig = Rig { command_path: CommandPath::Curve, ..Rig::load("eha").unwrap() };
    let (mut turbulent, mut springy) = (rig.clone(), rig);
    turbulent.effects.push(EffectInfo::named("turbulent-metering").unwrap());
    turbulent.parameters.metering_blend = 1.0;
    springy.effects.push(EffectInfo::named("compressibility").unwrap());
    springy.parameters.oil_compliance = 1e-9;
    let (mut with_turbulence, mut with_springs) = (plant.clone(), plant);
    with_turbulence.effects.turbulent_metering = 1.0;
    with_springs.effects.bulk_modulus = Some(1e9);
    let later = 0.37;
    let command = Command::MixedStep.later(later * PERIOD);
    for (name, rig, plant) in [("turbulent", turbulent, with_turbulence), ("springy", springy, with_springs)]
    {
        let [told, at_samples] =
            [1.0 - later, 0.0].map(|ahead| distance_of(rig.clone(), &plant, &command, ahead));
        println!("{name:10} told {:.3} um, at samples {:.3} um", 1e6 * told, 1e6 * at_samples);
        assert!(told < BAR, "{name}: {told} m");
        // What the limit guards against.
        assert!(at_samples > 10.0 * BAR, "{name}: {at_samples} m");
    }
}
