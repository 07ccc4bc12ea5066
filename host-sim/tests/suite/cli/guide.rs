//! The guides in `docs`: every command in them is run, in the order of the page. And the README: what it shows of the demo is
//! what the demo prints. And the page on records: its columns are those of the table of channels. And the one on rig files:
//! what it shows is read, and has everything that a rig file may have.

use super::harness::{Bench, USAGE};
use eha_monitor::channel::CHANNELS;
use eha_monitor::parameter::Parameter;
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The blocks of a page that are fenced as a language.
fn blocks(page: &str, language: &str) -> Vec<String> {
    let text = std::fs::read_to_string(root().join("docs").join(page)).expect("a guide");
    let fence = format!("```{language}");
    let mut blocks = Vec::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        if line == fence {
            let block: Vec<&str> = lines.by_ref().take_while(|line| *line != "```").collect();
            blocks.push(block.join("\n"));
        }
    }
    blocks
}

/// Runs the shell blocks of a page one after the other in one directory, with the program on the path.
fn run(page: &str, directory: &Path) -> Vec<String> {
    let program = Path::new(env!("CARGO_BIN_EXE_host-sim")).parent().expect("a directory");
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap_or_default());
    blocks(page, "sh")
        .into_iter()
        .map(|block| {
            let output = Command::new("bash")
                .args(["-euo", "pipefail", "-c", &block])
                .current_dir(directory)
                .env("PATH", &path)
                .output()
                .expect("bash runs");
            let (out, log) =
                (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
            assert!(output.status.success(), "{page}:\n{block}\n{out}\n{log}");
            out.into_owned()
        })
        .collect()
}

#[test]
fn the_guide_for_prognostics_names_the_effect() {
    let bench = Bench::new();
    let outputs = run("guide-prognostics.md", &bench.path("."));
    assert!(outputs.len() >= 6, "{} blocks", outputs.len());
    let all = outputs.join("\n");
    for part in ["verdict: explained", "effect: turbulent-metering", "fault-parameter check"] {
        assert!(all.contains(part), "{part}: {all}");
    }
    for folder in ["worth", "faults", "diagnosis"] {
        assert!(bench.path(folder).join("report.html").exists(), "{folder}");
    }
}

#[test]
fn the_guide_for_firmware_ends_with_reports_from_the_board() {
    // Its commands are cargo's, for the repository, and write nothing beside the builds.
    let outputs = run("guide-firmware.md", &root());
    assert_eq!(outputs.len(), 5);
    for (output, parts) in [
        (&outputs[2], &["gives the same bytes", "    bkl\n", "\"verdict\": \"healthy\""][..]),
        (&outputs[3], &["mps2-an500 (cortex-m7)", "mps2-an386 (cortex-m4)", "instructions_per_lf_step"]),
        (&outputs[4], &["effect: turbulent-metering", "gives the same bytes", "    bkl\n"]),
    ] {
        for part in parts {
            assert!(output.contains(part), "{part}: {output}");
        }
    }
}

#[test]
fn the_readme_shows_what_the_demo_prints() {
    let bench = Bench::new();
    bench.run(&["demo", "--out", "demo"]).done();
    let printed = bench.read("demo/report.txt");
    let shown: Vec<String> =
        blocks("../README.md", "text").into_iter().filter(|block| block.starts_with("verdict: ")).collect();
    assert_eq!(shown.len(), 1);
    assert!(printed.contains(&shown[0]), "README:\n{}\n\ndemo:\n{printed}", shown[0]);
    // Another value would not go unnoticed.
    assert!(!printed.contains(&shown[0].replacen("explained", "adequate", 1)));
}

#[test]
fn the_page_on_records_has_the_columns_of_every_channel() {
    let page = std::fs::read_to_string(root().join("docs/records.md")).expect("the page");
    let rows: Vec<&str> = page.lines().filter(|line| line.starts_with("| `")).collect();
    assert_eq!(rows.len(), CHANNELS.len());
    for (row, channel) in rows.iter().zip(&CHANNELS) {
        let wanted = format!("| `{}` | {} | {} |", channel.column, channel.unit, channel.description);
        assert!(row.starts_with(&wanted), "{row}\n{wanted}");
    }
}

#[test]
fn the_page_on_rig_files_shows_every_entry_and_is_read() {
    let bench = Bench::new();
    let shown = blocks("rigs.md", "toml");
    assert_eq!(shown.len(), 2);
    // All that a rig is printed with is on the page, and nothing on it is unknown.
    for block in &shown {
        bench.write("shown.toml", block);
        let printed = bench.run(&["rigs", "shown.toml"]).done().stdout;
        let keys = printed.lines().filter_map(|line| line.split(['=', '#']).next().map(str::trim));
        let entries: Vec<&str> =
            keys.filter(|key| !key.is_empty() && Parameter::named(key).is_none()).collect();
        assert!(entries.len() > 20, "{printed}");
        for entry in entries {
            assert!(shown.iter().any(|block| block.contains(entry)), "{entry}");
        }
    }
    bench.write("wrong.toml", &shown[0].replacen("command-offset", "command-offsets", 1));
    bench.run(&["rigs", "wrong.toml"]).refused(USAGE, &["command-offsets"]);
}
