//! Ctrl-C, and what `timeout` sends: the signal itself, sent to a search that would go on for long.

use super::harness::{Bench, named, number};
use nix::pty::{Winsize, openpty};
use serde_json::Value;
use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

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

/// Reads its log up to a line that has some words; the rest of it is read meanwhile.
fn wait_for(child: &mut Child, words: &str) -> JoinHandle<String> {
    let mut log = BufReader::new(child.stderr.take().expect("a pipe"));
    let mut line = String::new();
    while !line.contains(words) {
        line.clear();
        assert!(log.read_line(&mut line).expect("a line") > 0, "`{words}` is told");
    }
    std::thread::spawn(move || {
        let mut rest = String::new();
        log.read_to_string(&mut rest).expect("text");
        rest
    })
}

/// Waits until the program watches for both signals, which it does before its work.
fn wait_until_it_watches(child: &Child) {
    // Bits of SIGINT and of SIGTERM, which comes last.
    let both = 1 << (2 - 1) | 1 << (15 - 1);
    let started = Instant::now();
    while started.elapsed() < Duration::from_mins(1) {
        let status =
            std::fs::read_to_string(format!("/proc/{}/status", child.id())).expect("it runs, on Linux");
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).expect("a mask");
        if u64::from_str_radix(caught.trim(), 16).expect("a mask") & both == both {
            return;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("the program does not watch for signals");
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
    wait_until_it_watches(&child);
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
    let mut child = start(&bench, &[&["identify"][..], &["long.csv"; 10], &options].concat());
    wait_for(&mut child, "samples in common");
    // As `timeout` does: to the program, and to all that it started.
    interrupt(&child, "-TERM");
    interrupt(&child, "-TERM");
    let result = result(child);
    assert_eq!(result["stop"], "interrupted", "{result}");
    assert!(result["warnings"].to_string().contains("interrupted"), "{result}");
    assert!(number(&result["evaluations"]) >= 1.0);
    // The best member so far, inside its range.
    assert!((200.0..=4000.0).contains(&number(&named(&result["faults"], "fdj")["value"])), "{result}");
    assert!(bench.path("found/report.html").exists() && bench.path("found/identify.json").exists());
}

/// Records of an actuator that no value of its faults explains, so that more seeds are searched from.
fn unexplained(bench: &Bench) -> Vec<&'static str> {
    let lacking = ["--effect", "sensor-lag=2e-3", "--effect", "constant-load=2000"];
    let options = ["--model", "lf", "--command", "sine", "--duration", "4", "--noise", "lvdt_m=1e-6"];
    bench.simulate("lacking.csv", &[&options[..], &lacking].concat());
    vec!["identify", "lacking.csv", "--json"]
}

#[test]
fn a_search_from_more_seeds_is_interrupted_like_any_other_and_counted() {
    let bench = Bench::new();
    let mut arguments = unexplained(&bench);
    let started = Instant::now();
    let run = bench.run(&arguments);
    let took = started.elapsed().as_secs_f64();
    let whole = run.json();
    assert_eq!((run.code, &whole["stop"]), (Some(0), &"settled".into()), "{whole}");
    assert!(run.stderr.contains("searching from 3 more seeds"), "{}", run.stderr);
    // Nearly all of its time is that of searches.
    let seconds = number(&whole["seconds"]);
    assert!(seconds <= took && seconds > 0.5 * took, "{seconds} of {took}");

    arguments.extend(["--out", "found"]);
    let mut child = start(&bench, &arguments);
    wait_for(&mut child, "searching from 3 more seeds");
    interrupt(&child, "-INT");
    let cut = result(child);
    assert_eq!(cut["stop"], "interrupted", "{cut}");
    assert!(cut["warnings"].to_string().contains("interrupted"), "{cut}");
    let evaluations = |result: &Value| number(&result["evaluations"]);
    assert!(evaluations(&cut) < evaluations(&whole), "{cut}");
    assert!(bench.path("found/identify.json").exists());
}

#[test]
fn a_diagnosis_rules_nothing_out_that_it_has_not_tried() {
    let bench = Bench::new();
    let mut child = start(&bench, &["demo", "--json", "--out", "demo"]);
    // The records are written first.
    let log = wait_for(&mut child, "mixed-step");
    interrupt(&child, "-TERM");
    let result = result(child);
    assert!(result["warnings"].to_string().contains("not ruled out"), "{result}");
    assert_eq!(result["interrupted"], true, "{result}");
    // The values of a search that has not ended are no rig.
    let log = log.join().expect("the log");
    assert!(log.contains("rig.toml is not written") && !bench.path("demo/rig.toml").exists(), "{log}");
    assert!(bench.path("demo/diagnose.json").exists() && bench.path("demo/mixed-step.csv").exists());
    let so_far = bench.read("demo/report.html").contains("so far (interrupted)");
    assert_eq!(so_far, result["verdict"] == "unexplained", "{result}");
}

/// A diagnosis of many seconds on a terminal, interrupted as soon as that shows some words: its result, and what the terminal
/// shows from then on.
fn interrupted_at(words: &str) -> (Value, String) {
    let bench = Bench::new();
    let records = [("chirp", "a.csv"), ("mixed", "b.csv"), ("sine", "c.csv")];
    for (command, file) in records {
        let options = ["--model", "hf", "--command", command, "--set", "bkl=2e-4", "--set", "fdj=800"];
        bench.simulate(file, &[&options[..], &["--noise", "lvdt_m=5e-6", "--channels", "lvdt_m"]].concat());
    }
    let size = Winsize { ws_row: 40, ws_col: 120, ws_xpixel: 0, ws_ypixel: 0 };
    let terminal = openpty(&size, None).expect("a pseudo-terminal");
    let child = bench
        .command(&["diagnose", "a.csv", "b.csv", "--holdout", "c.csv", "--json"])
        .env("TERM", "xterm-256color")
        .stdout(Stdio::piped())
        .stderr(terminal.slave)
        .spawn()
        .expect("the program starts");
    let mut master = File::from(terminal.master);
    let mut shown = String::new();
    let mut read = || {
        let mut bytes = [0; 4096];
        // An error, where the last writer has closed its end.
        let length = master.read(&mut bytes).unwrap_or(0);
        String::from_utf8_lossy(&bytes[..length]).into_owned()
    };
    while !shown.contains(words) {
        let more = read();
        assert!(!more.is_empty(), "`{words}` is shown: {shown}");
        shown.push_str(&more);
    }
    interrupt(&child, "-INT");
    let rest = std::thread::spawn(move || {
        let mut bytes = Vec::new();
        let _ = master.read_to_end(&mut bytes);
        String::from_utf8_lossy(&bytes).into_owned()
    });
    let result = result(child);
    assert_eq!(result["interrupted"], true, "{result}");
    (result, rest.join().expect("what it wrote"))
}

/// Is there anything in a result that was not looked at?
fn claims_too_much(result: &Value) -> bool {
    let warnings = result["warnings"].to_string();
    let is_claimed = |words: &str| warnings.contains(words);
    is_claimed("say nothing about") || is_claimed("no effect explains") || result["next_experiment"] != ""
}

#[test]
fn a_diagnosis_that_was_trying_effects_keeps_the_fit_of_the_declared_faults() {
    let (result, _) = interrupted_at("trying effects, round 1");
    assert!(!claims_too_much(&result), "{result}");
    let warnings = result["warnings"].to_string();
    assert!(
        warnings.contains("not ruled out") && warnings.contains("could stand in for an effect"),
        "{result}"
    );
    let [before, after] = ["faults_before", "faults"].map(|when| {
        let bkl = named(&result[when], "bkl");
        [number(&bkl["value"]), number(&bkl["ci95"][0]), number(&bkl["ci95"][1])]
    });
    let [value, lower, upper] = after;
    assert!(after == before && lower < value && value < upper && upper < 4e-4, "{result}");
    assert!(result["error"]["holdout"].is_object(), "{result}");
}

#[test]
fn a_diagnosis_that_was_fitting_the_declared_faults_gives_the_best_of_its_search() {
    let (result, _) = interrupted_at("fitting the declared faults");
    assert!(!claims_too_much(&result), "{result}");
    assert!(result["warnings"].to_string().contains("had no say"), "{result}");
    assert!(result["error"]["holdout"].is_null(), "{result}");
    assert_eq!(result["verdict"], "unexplained", "{result}");
}

#[test]
fn a_diagnosis_begins_nothing_once_it_is_interrupted() {
    let (_, shown) = interrupted_at("trying effects, round 1");
    let frames = shown.split(['\r', '\n']).filter(|frame| frame.contains("/100 after "));
    let other: Vec<&str> = frames.filter(|frame| !frame.contains("trying effects, round 1")).collect();
    assert!(other.is_empty(), "{other:?}");
}

#[test]
fn a_terminal_is_told_once_that_an_interrupted_program_is_ending() {
    let (_, shown) = interrupted_at("trying effects, round 1");
    assert_eq!(shown.matches("another Ctrl-C ends it at once").count(), 1, "{shown:?}");
}

#[test]
fn the_cases_of_a_loop_that_was_not_closed_claim_nothing_of_it() {
    let bench = Bench::new();
    let child = start(&bench, &["reproduce", "--json", "--out", "cases"]);
    wait_until_it_watches(&child);
    interrupt(&child, "-INT");
    let result = result(child);
    assert_eq!(result["interrupted"], true, "{result}");
    assert!(result["warnings"].to_string().contains("interrupted: 0 of 12 cases"), "{result}");
    assert!(bench.read("cases/report.html").contains("interrupted: 0 of 12 cases"));
}
