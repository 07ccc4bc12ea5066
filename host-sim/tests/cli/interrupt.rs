//! Ctrl-C, and what `timeout` sends: the signal itself, sent to a search that would go on for long.

use super::harness::{Bench, named, number};
use serde_json::Value;
use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// Exit code as the program's help states it.
const INTERRUPTED: i32 = 130;

fn start(bench: &Bench, arguments: &[&str]) -> Child {
    bench
        .command(arguments)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts")
}

fn interrupt(child: &Child, signal: &str) {
    let sent = Command::new("kill").args([signal, &child.id().to_string()]).status().expect("kill runs");
    assert!(sent.success(), "the program was still running");
}

/// The result that an interrupted program prints.
fn result(mut child: Child) -> Value {
    let mut text = String::new();
    child.stdout.take().expect("a pipe").read_to_string(&mut text).expect("text");
    let status = child.wait().expect("the program ends");
    assert_eq!(status.code(), Some(INTERRUPTED), "{text}");
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

#[test]
fn a_calibration_writes_what_it_has_found_but_no_rig() {
    let bench = Bench::new();
    bench.simulate(
        "long.csv",
        &["--model", "lf", "--command", "sine", "--duration", "20", "--noise", "lvdt_m=5e-6"],
    );
    bench.write("slow.toml", "[parameters]\nmetering_blend = 1.0\n");
    let options = ["--rig", "slow.toml", "--bounds", "fdj=200..4000", "--json", "--out", "found"];
    let mut child = start(&bench, &[&["calibrate"][..], &["long.csv"; 10], &options].concat());
    std::thread::sleep(Duration::from_millis(1500));
    interrupt(&child, "-INT");
    let mut log = child.stderr.take().expect("a pipe");
    let result = result(child);
    assert_eq!(result["stop"], "interrupted", "{result}");
    assert!(bench.path("found/report.html").exists() && bench.path("found/calibrate.json").exists());
    assert!(!bench.path("found/rig.toml").exists());
    let mut text = String::new();
    log.read_to_string(&mut text).expect("text");
    assert!(text.contains("rig.toml is not written"), "{text}");
}

#[test]
fn an_identification_gives_what_it_has_found() {
    let bench = Bench::new();
    bench.simulate(
        "long.csv",
        &["--model", "lf", "--command", "sine", "--duration", "20", "--noise", "lvdt_m=5e-6"],
    );
    // The square-root metering is stepped, not exact, and the record counts ten times: a search of many seconds.
    bench.write("slow.toml", "[parameters]\nmetering_blend = 1.0\n");
    let options = ["--rig", "slow.toml", "--json", "--out", "found"];
    let child = start(&bench, &[&["identify"][..], &["long.csv"; 10], &options].concat());
    std::thread::sleep(Duration::from_millis(1500));
    interrupt(&child, "-INT");
    let result = result(child);
    assert_eq!(result["stop"], "interrupted", "{result}");
    assert!(result["warnings"].to_string().contains("interrupted"), "{result}");
    assert!(number(&result["evaluations"]) >= 1.0);
    // The best member so far, inside its range.
    assert!((200.0..=4000.0).contains(&number(&named(&result["faults"], "fdj")["value"])), "{result}");
    assert!(bench.path("found/report.html").exists() && bench.path("found/identify.json").exists());
}

#[test]
fn a_diagnosis_rules_nothing_out_that_it_has_not_tried() {
    let bench = Bench::new();
    let mut child = start(&bench, &["demo", "--json", "--out", "demo"]);
    let mut log = BufReader::new(child.stderr.take().expect("a pipe"));
    let mut line = String::new();
    while !line.contains("mixed-step") {
        line.clear();
        assert!(log.read_line(&mut line).expect("a line") > 0, "the records are written first");
    }
    interrupt(&child, "-TERM");
    std::thread::spawn(move || std::io::copy(&mut log, &mut std::io::sink()));
    let result = result(child);
    assert!(result["warnings"].to_string().contains("not ruled out"), "{result}");
    assert_eq!(result["interrupted"], true, "{result}");
    let so_far = bench.read("demo/report.html").contains("so far (interrupted)");
    assert_eq!(so_far, result["verdict"] == "unexplained", "{result}");
}

#[test]
fn the_cases_of_a_loop_that_was_not_closed_claim_nothing_of_it() {
    let bench = Bench::new();
    let child = start(&bench, &["reproduce", "--json", "--out", "cases"]);
    std::thread::sleep(Duration::from_millis(300));
    interrupt(&child, "-INT");
    let result = result(child);
    assert_eq!(result["interrupted"], true, "{result}");
    assert!(result["warnings"].to_string().contains("interrupted: 0 of 12 cases"), "{result}");
    assert!(bench.read("cases/report.html").contains("interrupted: 0 of 12 cases"));
}
