//! What `diagnose` makes of every effect of the catalogue: records of the independent plant, with the effect at half,
//! once and several times the size from which statistics can see it.

mod cases;
#[path = "../../../tests/common/mod.rs"]
mod common;
mod floor;

use cases::{CHANNEL_SETS, Case, Outcome};
use eha_monitor::effect::EFFECTS;
use rayon::prelude::*;
use std::io::Write as _;

/// Development: `EFFECTS=a,b SIZES=1,2 SETS=0,1,2 SEEDS=2 cargo test --release ... -- --ignored --nocapture`.
#[test]
#[ignore = "a study that takes long"]
fn study() {
    let list = |name: &str, default: &str| -> Vec<String> {
        std::env::var(name).unwrap_or_else(|_| default.to_owned()).split(',').map(str::to_owned).collect()
    };
    let names = list("EFFECTS", "");
    let all: Vec<&str> = EFFECTS.iter().map(|effect| effect.name).chain(["clean"]).collect();
    let mut cases = Vec::new();
    for name in if names[0].is_empty() { all.iter().map(|s| (*s).to_owned()).collect() } else { names } {
        for set in list("SETS", "0,1,2") {
            for size in list("SIZES", "2") {
                for seed in 0..list("SEEDS", "1")[0].parse::<u64>().unwrap() {
                    cases.push(Case::new(
                        &name,
                        size.parse().unwrap(),
                        &CHANNEL_SETS[set.parse::<usize>().unwrap()],
                        seed,
                    ));
                }
            }
        }
    }
    let outcomes: Vec<Outcome> = cases
        .par_iter()
        .map(|case| {
            let outcome = case.diagnose();
            let mut out = std::io::stderr().lock();
            writeln!(out, "{}", outcome.line(case)).unwrap();
            outcome
        })
        .collect();
    let good = outcomes.iter().filter(|outcome| outcome.right).count();
    eprintln!("{good} of {} right", outcomes.len());
}
