//! The progress bar on a real terminal: a pseudo-terminal of a known size.

use super::harness::Bench;
use nix::pty::{Winsize, openpty};
use std::fs::File;
use std::io::Read as _;
use std::process::Stdio;
use std::thread;

/// What a run shows on a terminal of 120 columns that its log goes to.
fn shown(bench: &Bench, arguments: &[&str]) -> String {
    shown_in(120, bench, arguments)
}

fn shown_in(columns: u16, bench: &Bench, arguments: &[&str]) -> String {
    let size = Winsize { ws_row: 40, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 };
    let terminal = openpty(&size, None).expect("a pseudo-terminal");
    let mut child = bench
        .command(arguments)
        .env("TERM", "xterm-256color")
        .env_remove("NO_COLOR")
        .stdout(Stdio::null())
        .stderr(terminal.slave)
        .spawn()
        .expect("the program starts");
    let mut master = File::from(terminal.master);
    let reader = thread::spawn(move || {
        let mut bytes = Vec::new();
        // Ends with an error where the last writer has closed its end.
        let _ = master.read_to_end(&mut bytes);
        String::from_utf8_lossy(&bytes).into_owned()
    });
    assert!(child.wait().expect("the program ends").success());
    reader.join().expect("what it wrote")
}

/// A search of a second or two: the square-root metering is stepped, and the position alone tells little.
fn slow_record(bench: &Bench) {
    bench.simulate(
        "slow.csv",
        &["--model", "hf", "--duration", "6", "--command", "sine", "--noise", "lvdt_m=5e-6"],
    );
    bench.write("slow.toml", "[parameters]\nmetering_blend = 1.0\n");
}

const SEARCH: [&str; 4] = ["identify", "slow.csv", "--rig", "slow.toml"];

#[test]
fn a_terminal_shows_generations_best_cost_and_time_left() {
    let bench = Bench::new();
    slow_record(&bench);
    let shown = shown(&bench, &SEARCH);
    for part in ["identifying", "generation ", "best ", " times the noise", " left", "/400"] {
        assert!(shown.contains(part), "{part}: {shown}");
    }
    // Drawn over itself, and gone at the end.
    assert!(shown.contains("\u{1b}[2K"), "{shown:?}");
    assert!(!shown.trim_end().ends_with("left"), "{shown:?}");
}

#[test]
fn a_diagnosis_shows_its_rounds_its_fits_and_the_best() {
    let bench = Bench::new();
    bench.simulate("lag.csv", &["--model", "lf", "--effect", "sensor-lag=5e-4", "--noise", "lvdt_m=5e-6"]);
    let shown = shown(&bench, &["diagnose", "lag.csv"]);
    for part in [
        "diagnosing",
        "fitting the declared faults",
        "trying effects, round 1, ",
        " of ",
        "testing what was found",
    ] {
        assert!(shown.contains(part), "{part}: {shown}");
    }
    assert!(shown.contains("; best ") && shown.contains(" times the noise"), "{shown}");
    // Nobody knows what will have to be done.
    assert!(shown.contains("/100 after ") && !shown.contains(" left"), "{shown}");
}

#[test]
fn a_bar_is_one_line_of_a_narrow_terminal() {
    let bench = Bench::new();
    slow_record(&bench);
    let shown = shown_in(80, &bench, &SEARCH);
    let frames = shown.split(['\r', '\n']).flat_map(|line| line.split("\u{1b}[2K"));
    let drawn: Vec<&str> = frames.filter(|frame| frame.contains("identifying")).collect();
    assert!(!drawn.is_empty(), "{shown:?}");
    for frame in drawn {
        assert!(frame.contains('░') || frame.contains('█'), "no bar: {frame:?}");
        assert!(frame.chars().count() <= 80, "{} columns: {frame:?}", frame.chars().count());
    }
}

#[test]
fn quiet_shows_nothing_on_a_terminal() {
    let bench = Bench::new();
    slow_record(&bench);
    assert_eq!(shown(&bench, &[&SEARCH[..], &["--quiet"]].concat()), "");
}

#[test]
fn a_warning_is_coloured_on_a_terminal_only() {
    let bench = Bench::new();
    bench.simulate("lost.csv", &["--model", "lf", "--dropout", "0.02"]);
    let arguments = ["import", "lost.csv", "-o", "again.csv"];
    let (terminal, pipe) = (shown(&bench, &arguments), bench.run(&arguments).done().stderr);
    assert!(terminal.contains("\u{1b}[1m\u{1b}[33mwarning:\u{1b}[0m"), "{terminal:?}");
    assert!(pipe.contains("warning:") && !pipe.contains('\u{1b}'), "{pipe:?}");
}
