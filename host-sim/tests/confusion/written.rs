//! Cases that were hard once, written down: with the user position alone, and with what is to be found.

use crate::blind;
use crate::cases::{CHANNEL_SETS, Case, Outcome, Presence, Program};
use crate::floor::Shape;
use eha_monitor::effect::EffectInfo;
use host_sim::rig::CommandPath;
use rayon::prelude::*;
use reference_plant::{Command, Rule};

fn present(name: &str, floors: f64, reversed: bool, stretch: f64) -> Presence {
    Presence { effect: EffectInfo::named(name).unwrap(), floors, shape: Shape { reversed, stretch } }
}

/// A case with a seed of its noise, faults, the noise of the position, commands and effects.
fn case(
    seed: u64,
    [bkl, fdj]: [f64; 2],
    position: f64,
    train: [(Command, usize); 2],
    held: (Command, usize),
    effects: Vec<Presence>,
) -> Case {
    Case {
        effects,
        outside: None,
        set: &CHANNEL_SETS[0],
        seed,
        bkl,
        fdj,
        noise: [position, position, 0.02, 5e4],
        quantum: 0.0,
        train,
        held,
        program: Program::default(),
    }
}

fn chirp(amplitude: f64) -> Command {
    Command::Chirp { amplitude }
}

/// Euler steps, the command a curve.
fn other_program() -> Program {
    Program { path: CommandPath::Curve, rule: Rule::SemiImplicitEuler, ..Program::default() }
}

fn are_found(cases: &[(Case, &str)]) {
    cases.par_iter().for_each(|(case, expected)| {
        let diagnosis = case.diagnosed().diagnosis;
        assert_eq!(blind::found(&diagnosis), *expected);
        let asked = vec![true; case.effects.len()];
        let outcome = case.outcome(&diagnosis, &asked);
        let is_right = match case.effects[..] {
            [] => outcome == Outcome::Adequate,
            _ => matches!(outcome, Outcome::Named(_)),
        };
        assert!(is_right, "{expected}");
    });
}

#[test]
fn valleys_that_no_slope_leads_to_are_found() {
    // One of many valleys of ringing oil, beside another effect.
    let ringing = Case {
        quantum: 5.1e-6,
        ..case(
            3056,
            [1.51e-4, 2650.0],
            3.48e-6,
            [(chirp(8.6e-3), 3302), (Command::MixedStep, 3302)],
            (Command::Mixed, 1279),
            vec![
                present("compressibility", 7.14, true, 0.709),
                present("torque-motor-gain", 3.48, true, 1.61),
            ],
        )
    };
    // A friction that is read a quarter too high, whose own valley is narrower.
    let clogged = case(
        4050,
        [2.35e-4, 806.0],
        2.14e-6,
        [(chirp(3.03e-3), 2746), (Command::MixedStep, 2746)],
        (Command::CHIRP_LOW, 1182),
        vec![present("filter-clogging", 3.65, false, 1.43)],
    );
    // A loss of pressure gain that is a leak to every channel, a hundred thousand times the noise away from its start.
    let weak = Case {
        program: other_program(),
        ..case(
            4094,
            [9.59e-4, 1675.0],
            1.25e-6,
            [(chirp(3.49e-3), 1289), (Command::Mixed, 1289)],
            (Command::MixedStep, 1748),
            vec![present("pressure-gain", 2.21, true, 1.54)],
        )
    };
    // One of many valleys of ringing oil, which effects of no size beside it show to a fit.
    let alone = Case {
        program: Program { rule: Rule::SemiImplicitEuler, later: 5.58e-4, ..Program::default() },
        ..case(
            12046,
            [8.41e-4, 730.0],
            3.86e-6,
            [(chirp(9.75e-3), 2984), (Command::MixedStep, 2984)],
            (Command::CHIRP_LOW, 1870),
            vec![present("compressibility", 5.19, true, 1.81)],
        )
    };
    are_found(&[
        (ringing, "compressibility; torque-motor-gain"),
        (clogged, "filter-clogging"),
        (weak, "leakage or pressure-gain"),
        (alone, "compressibility"),
    ]);
}

#[test]
fn coarse_steps_hide_no_more_than_the_record_with_most_noise_says() {
    // Held out is a chirp that rests on its steps: nothing of the noise is seen there.
    let shifted = Case {
        quantum: 2e-5,
        ..case(
            12019,
            [1.17e-4, 201.0],
            4.77e-6,
            [(chirp(7.19e-3), 3925), (Command::MixedStep, 3925)],
            (Command::CHIRP_LOW, 1428),
            vec![present("sensor-offset", 8.1, false, 1.54)],
        )
    };
    // What another program's steps do to long records is more than chance, and less than is believed of a channel.
    let clean = Case {
        quantum: 1.127e-6,
        program: other_program(),
        ..case(
            11_916_522_795_004_649_584,
            [5.945e-4, 842.7],
            1.03e-6,
            [(chirp(6.06e-3), 4495), (Command::MixedStep, 4495)],
            (Command::Mixed, 1781),
            Vec::new(),
        )
    };
    are_found(&[(shifted, "sensor-offset"), (clean, "nothing")]);
}
