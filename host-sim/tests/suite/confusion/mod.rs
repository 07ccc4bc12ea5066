//! What `diagnose` makes of every effect of the catalogue, alone and in pairs, and of what is not in it: records of the
//! independent plant, with the effect at half, once and twice the size from which statistics can see it.
//!
//! `docs/confusion.md` is the result, `docs/blind.md` that of cases of which everything is drawn at random. `cargo xtask
//! confusion` and `cargo xtask blind` make them anew, which takes some twenty and thirty minutes; the tests make a part of
//! them and compare.

mod blind;
mod cases;
mod floor;
mod table;
mod written;

use cases::{CHANNEL_SETS, Case, Presence};
use std::path::PathBuf;
use table::Row;

/// Rows of single effects that the tests make.
const SAMPLE: usize = 2;
/// Drawn cases that the tests make.
const DRAWN: usize = 3;
/// The first of the clean ones of which all channels are measured, among the rows of the document.
const CLEAN: usize = 5;

fn document(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs").join(name)
}

#[test]
#[ignore = "the whole table takes some twenty minutes"]
fn write_the_table() {
    let sections = table::sections();
    let text = table::document(&sections);
    print!("{text}");
    std::fs::write(document("confusion.md"), text).unwrap();
}

#[test]
#[ignore = "the drawn cases take some thirty minutes"]
fn write_the_drawn_cases() {
    // Numbers of cases, separated by blanks, that are to be shown in place of the document, or saved to a folder.
    let chosen = std::env::var("BLIND_CASES").unwrap_or_default();
    let chosen: Vec<u64> = chosen.split_whitespace().map(|number| number.parse().unwrap()).collect();
    if let Some(folder) = std::env::var_os("BLIND_RECORDS") {
        blind::save(&chosen, folder.as_ref()).unwrap();
    } else if chosen.is_empty() {
        std::fs::write(document("blind.md"), blind::document()).unwrap();
    } else {
        blind::lines(&chosen);
    }
}

#[test]
fn a_sample_of_the_drawn_cases_is_as_documented() {
    let documented = std::fs::read_to_string(document("blind.md")).unwrap();
    let rows: Vec<(u64, &str)> =
        documented.lines().filter_map(|line| Some((blind::documented(line)?, line))).collect();
    assert!(rows.len() > DRAWN, "{} rows", rows.len());
    // An odd step: the channels take turns. From a clean one on: pairs, and what is outside the catalogue, take minutes.
    let sample: Vec<_> = rows.iter().skip(CLEAN).step_by((rows.len() / DRAWN) | 1).collect();
    let indices: Vec<u64> = sample.iter().map(|(index, _)| *index).collect();
    for (made, (_, row)) in blind::lines(&indices).iter().zip(sample) {
        assert_eq!(made, row);
    }
}

#[test]
fn a_sample_of_the_table_is_as_documented() {
    let documented = std::fs::read_to_string(document("confusion.md")).unwrap();
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
    let Presence { effect, shape, .. } = &case.effects[0];
    let floor = floor::of(effect, shape, &case);
    let [half, whole] = [0.5, 1.0].map(|part| floor::reach(effect, shape, part * floor, &case));
    assert!(half < 0.6 && (0.9..1.1).contains(&whole), "{half}, {whole}");
}
