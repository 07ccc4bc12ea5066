//! What `diagnose` makes of every effect of the catalogue, alone and in pairs, and of what is not in it: records of the
//! independent plant, with the effect at half, once and twice the size from which statistics can see it.
//!
//! `docs/confusion.md` is the result. `cargo xtask confusion` makes it anew, which takes some twenty minutes; the tests make
//! a part of it and compare.

#[path = "../../../tests/common/mod.rs"]
mod common;

mod cases;
mod floor;
mod table;

use cases::{CHANNEL_SETS, Case};
use eha_monitor::effect::EFFECTS;
use std::path::PathBuf;
use table::Row;

/// Rows of single effects that the tests make.
const SAMPLE: usize = 4;

fn document() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/confusion.md")
}

#[test]
#[ignore = "the whole table takes some twenty minutes"]
fn write_the_table() {
    let sections = table::sections();
    let text = table::document(&sections);
    print!("{text}");
    std::fs::write(document(), text).unwrap();
}

#[test]
fn a_sample_of_the_table_is_as_documented() {
    let documented = std::fs::read_to_string(document()).unwrap();
    let clean = Row::clean(&CHANNEL_SETS[1]).line();
    assert!(documented.contains(&clean), "not in the document:\n{clean}");
    // What the comparison would do with a claim that is not made.
    assert!(!documented.contains(&clean.replacen("adequate", "unexplained", 1)));

    let singles: Vec<_> = documented.lines().filter_map(table::documented_single).collect();
    assert!(singles.len() >= SAMPLE, "{} rows of single effects", singles.len());
    for (line, effect, set) in singles.iter().step_by(singles.len().div_ceil(SAMPLE)) {
        assert_eq!(Row::single(effect, set).line(), *line);
    }
}

#[test]
fn an_effect_below_its_floor_is_hard_to_see() {
    // The floor is where the expected fall of chi-square is its price, or the model's own error is reached: half of it
    // falls short of both.
    let case = Case::new("constant-load", 0.5, &CHANNEL_SETS[1], 0);
    let effect = &EFFECTS[EFFECTS.iter().position(|effect| effect.name == "constant-load").unwrap()];
    let floor = floor::of(effect, &case);
    let (half, whole) = (floor::reach(effect, 0.5 * floor, &case), floor::reach(effect, floor, &case));
    assert!(half < 0.6 && (0.9..1.1).contains(&whole), "{half}, {whole}");
}
