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

/// The shells that the program is tested in.
const SHELLS: [&str; 3] = ["bash", "zsh", "fish"];

/// Does this machine have the shell? Bash it must have; a test passes over others, and says so.
fn is_installed(shell: &str) -> bool {
    let is_there = Command::new(shell).arg("--version").output().is_ok();
    assert!(is_there || shell != "bash", "bash is not installed");
    if !is_there {
        eprintln!("skipped: no {shell}; `cargo xtask setup` installs it where it may");
    }
    is_there
}

/// Asks bash's function what it offers for the last of the words; where that is nothing, bash goes on to files.
const ASK_BASH: &str = r#"source _host-sim; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
    function_name=$(complete -p host-sim); function_name=${function_name#*-F }; function_name=${function_name%% *}
    compopt() { [[ $2 == plusdirs ]] && more=-d; }; more=
    $function_name host-sim "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
    [[ -z ${COMPREPLY[*]} && -z $more && $(complete -p host-sim) == *"-o default"* ]] && more=-f
    [[ -n $more ]] && mapfile -t COMPREPLY < <(compgen $more -- "${COMP_WORDS[COMP_CWORD]}")
    printf '%s\n' "${COMPREPLY[@]}""#;

/// Types the words into a zsh of its own, which has to have a terminal, and a tab behind the last one.
const ASK_ZSH: &str = r#"zmodload zsh/zpty
    wait_for() { repeat 600; do [[ -e $1 ]] && return; sleep 0.05; done; print -u2 "no $1"; exit 1 }
    rm -f ready done; : > offered
    zpty shell zsh -d -i
    wait_for ready; zpty -w -n shell "$*"$'\t'; wait_for done
    zpty -d shell; cat offered"#;

/// How that zsh tells what it offers.
const ZSHRC: &str = r#"fpath=($PWD $fpath); autoload -U compinit; compinit -u -D
    compadd() {
        if [[ ${@[1,(i)(-|--)]} == *-(O|A|D)\ * ]]; then builtin compadd "$@"; return; fi
        local -a hits; builtin compadd -A hits "$@"
        (( $#hits )) && print -rl -- $hits >> offered
        builtin compadd "$@"
    }
    tell() { : > done }; comppostfuncs=(tell)
    zle-line-init() { : > ready }; zle -N zle-line-init"#;

/// Asks fish the same.
const ASK_FISH: &str = r#"source _host-sim; complete -C "$argv""#;

/// What a shell offers for the last of some words, by the program's script, in the directory of the bench.
fn offered(bench: &Bench, shell: &str, words: &[&str]) -> Vec<String> {
    bench.write("_host-sim", &bench.run(&["completions", shell]).done().stdout);
    bench.write(".zshrc", ZSHRC);
    let mut asked = Command::new(shell);
    match shell {
        "bash" => asked.args(["--norc", "-c", ASK_BASH, "bash"]),
        "zsh" => asked.args(["-f", "-c", ASK_ZSH, "zsh"]),
        _ => asked.args(["-c", ASK_FISH]),
    };
    let home = bench.path(".");
    asked.arg("host-sim").args(words).current_dir(&home).env("HOME", &home).env("ZDOTDIR", &home);
    let output = asked.output().expect("the shell runs");
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout);
    // Fish adds what a name means, and a slash to a directory.
    let names =
        text.lines().filter_map(|line| line.split('\t').next()).map(|name| name.trim_end_matches('/'));
    let mut names: Vec<String> = names.filter(|name| !name.is_empty()).map(str::to_owned).collect();
    names.sort();
    names.dedup();
    names
}

#[test]
fn every_shell_completes_verbs_options_and_names() {
    let bench = Bench::new();
    for shell in SHELLS.into_iter().filter(|shell| is_installed(shell)) {
        for (words, expected) in [
            (&["ide"][..], &["identify"][..]),
            (&["--json", "ide"], &["identify"]),
            (&["identify", "--po"], &["--population"]),
            (&["diagnose", "record.csv", "--hold"], &["--holdout"]),
            (&["--rig", "servo"], &["servo-hydraulic"]),
            (&["identify", "--rig", "e"], &["eha"]),
            (&["rigs", "force"], &["force-axis"]),
            (&["simulate", "--command", "chirp"], &["chirp", "chirp-low"]),
            (&["hil", "--command", "st"], &["step"]),
            (&["simulate", "--effect", "spool-o"], &["spool-overlap="]),
            (&["identify", "--bounds", "bk"], &["bkl="]),
            (&["simulate", "--noise", "cur"], &["current_mA="]),
            (&["simulate", "--channels", "ram"], &["ram_m"]),
            (&["completions", "ba"], &["bash"]),
            (&["man", "ide"], &["identify"]),
            (&["simulate", "--model", "no-such"], &[]),
        ] {
            assert_eq!(offered(&bench, shell, words), expected, "{shell} {words:?}");
        }
    }
}

#[test]
fn every_shell_completes_files_where_files_are_meant() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("fleet")).expect("a directory");
    bench.write("fleet.csv", "");
    for shell in SHELLS.into_iter().filter(|shell| is_installed(shell)) {
        for (words, expected) in [
            (&["identify", "fle"][..], &["fleet", "fleet.csv"][..]),
            (&["identify", "--rig", "fle"], &["fleet", "fleet.csv"]),
            (&["rigs", "fle"], &["fleet", "fleet.csv"]),
            (&["simulate", "--command", "fle"], &["fleet", "fleet.csv"]),
            (&["identify", "--out", "fle"], &["fleet"]),
            (&["identify", "fleet.csv", "--rig", "fle"], &["fleet", "fleet.csv"]),
        ] {
            assert_eq!(offered(&bench, shell, words), expected, "{shell} {words:?}");
        }
        // Bash takes a file for anything that it does not know.
        for words in [&["effects", "fle"][..], &["hil", "--command", "fle"], &["man", "fle"]] {
            assert!(shell == "bash" || offered(&bench, shell, words).is_empty(), "{shell} {words:?}");
        }
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
        for shell in SHELLS.into_iter().filter(|shell| is_installed(shell)) {
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
