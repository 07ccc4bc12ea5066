//! Cases whose answer lies in a valley that no slope leads to.

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

/// Cases with the user position alone, the seed of their noise, and what is to be named.
fn cases() -> [(Case, &'static str); 3] {
    let case = |seed, bkl, fdj, position: f64, train: [(Command, usize); 2], held, effects| Case {
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
    };
    let chirp = |amplitude| Command::Chirp { amplitude };
    // One of many valleys of ringing oil, beside another effect.
    let ringing = Case {
        quantum: 5.1e-6,
        ..case(
            3056,
            1.51e-4,
            2650.0,
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
        2.35e-4,
        806.0,
        2.14e-6,
        [(chirp(3.03e-3), 2746), (Command::MixedStep, 2746)],
        (Command::CHIRP_LOW, 1182),
        vec![present("filter-clogging", 3.65, false, 1.43)],
    );
    // A loss of pressure gain that is a leak to every channel, a hundred thousand times the noise away from its start.
    let weak = Case {
        program: Program { path: CommandPath::Curve, rule: Rule::SemiImplicitEuler, ..Program::default() },
        ..case(
            4094,
            9.59e-4,
            1675.0,
            1.25e-6,
            [(chirp(3.49e-3), 1289), (Command::Mixed, 1289)],
            (Command::MixedStep, 1748),
            vec![present("pressure-gain", 2.21, true, 1.54)],
        )
    };
    [
        (ringing, "compressibility; torque-motor-gain"),
        (clogged, "filter-clogging"),
        (weak, "leakage or pressure-gain"),
    ]
}

#[test]
fn valleys_that_no_slope_leads_to_are_found() {
    cases().par_iter().for_each(|(case, expected)| {
        let diagnosis = case.diagnosed().diagnosis;
        assert_eq!(blind::found(&diagnosis), *expected);
        let asked = vec![true; case.effects.len()];
        assert!(matches!(case.outcome(&diagnosis, &asked), Outcome::Named(_)), "{expected}");
    });
}
