//! Completions and manual pages, from the command line itself.

use super::harness::{BAD_DATA, Bench, USAGE};
use std::process::Command;

#[test]
fn completions_know_verbs_and_options() {
    let bench = Bench::new();
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let text = bench.run(&["completions", shell]).done().stdout;
        for part in ["identify", "diagnose", "check", "holdout"] {
            assert!(text.contains(part), "{shell} lacks {part}");
        }
    }
    bench.run(&["completions", "bahs"]).refused(USAGE, &["bash"]);
}

/// What bash offers for the last of some words, by the program's script.
fn offered(bench: &Bench, words: &[&str]) -> Vec<String> {
    let script = r#"source "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); function_name=$(complete -p host-sim)
        function_name=${function_name#*-F }; function_name=${function_name%% *}
        compopt() { :; }; $function_name host-sim "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
        printf '%s\n' "${COMPREPLY[@]}""#;
    let output = Command::new("bash")
        .args(["--norc", "-c", script, "bash", "completions", "host-sim"])
        .args(words)
        .current_dir(bench.path("."))
        .output()
        .expect("bash runs");
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout);
    text.lines().filter(|line| !line.is_empty()).map(str::to_owned).collect()
}

#[test]
fn bash_completes_verbs_options_and_names() {
    let bench = Bench::new();
    bench.write("completions", &bench.run(&["completions", "bash"]).done().stdout);
    for (words, expected) in [
        (&["ide"][..], &["identify"][..]),
        (&["--json", "ide"], &["identify"]),
        (&["identify", "--po"], &["--population"]),
        (&["diagnose", "record.csv", "--hold"], &["--holdout"]),
        (&["identify", "--rig", "e"], &["eha"]),
        (&["rigs", "force"], &["force-axis"]),
        (&["simulate", "--command", "chirp"], &["chirp", "chirp-low"]),
        (&["hil", "--command", "st"], &["step"]),
        (&["simulate", "--effect", "spool-o"], &["spool-overlap="]),
        (&["identify", "--bounds", "bk"], &["bkl="]),
        (&["simulate", "--noise", "cur"], &["current_mA="]),
        (&["simulate", "--channels", "ram"], &["ram_m"]),
        // No built-in rig: bash itself offers files then.
        (&["identify", "--rig", "machine/"], &[]),
    ] {
        assert_eq!(offered(&bench, words), expected, "{words:?}");
    }
}

#[test]
fn every_verb_has_a_manual_page() {
    let bench = Bench::new();
    let page = bench.run(&["man"]).done().stdout;
    assert!(page.contains(".TH host-sim 1") && page.contains("Exit codes"), "{page}");
    let page = bench.run(&["man", "identify"]).done().stdout;
    assert!(page.contains("\\-\\-bounds") && page.contains("host\\-sim"), "{page}");
    bench.run(&["man", "identfy"]).refused(USAGE, &["did you mean `identify`"]);
    bench.run(&["man", "--out", "man"]).done();
    let count = std::fs::read_dir(bench.path("man")).expect("a directory").count();
    assert!(count >= 14, "{count} pages");
}

/// Does this machine have the shell? Bash it must have; a test passes over others, and says so.
fn is_installed(shell: &str) -> bool {
    let is_there = Command::new(shell).arg("--version").output().is_ok();
    assert!(is_there || shell != "bash", "bash is not installed");
    if !is_there {
        println!("skipped: {shell} is not installed");
    }
    is_there
}

#[test]
fn a_hint_can_be_pasted_into_every_shell() {
    let bench = Bench::new();
    bench.simulate("record.csv", &["--model", "lf", "--duration", "0.2"]);
    let record = bench.read("record.csv");
    // Each with the shells that take it for something else without its quotes.
    for (name, needed_by) in [
        ("LVDT[m]", &["zsh"][..]),
        ("$LVDT", &["bash", "zsh", "fish"]),
        ("lvdt's [m]", &["bash", "zsh", "fish"]),
        ("~lvdt", &[]),
    ] {
        bench.write("foreign.csv", &record.replacen("lvdt_m", name, 1));
        let run = bench.run(&["import", "foreign.csv", "-o", "new.csv"]).refused(BAD_DATA, &[]);
        let option = run.stderr.split('`').find(|part| part.starts_with("--columns ")).expect("a hint");
        for shell in ["bash", "zsh", "fish"].into_iter().filter(|shell| is_installed(shell)) {
            let pasted = |option: &str| {
                let line = format!("'{}' import foreign.csv -o - {option}", env!("CARGO_BIN_EXE_host-sim"));
                let run = Command::new(shell).args(["-c", &line]).current_dir(bench.path(".")).output();
                run.expect("the shell runs").status.success()
            };
            assert!(pasted(option), "{shell} takes {option} for something else");
            let bare = option.replace(['\'', '"'], "");
            assert_eq!(pasted(&bare), !needed_by.contains(&shell), "{shell} and {bare}");
        }
    }
}
