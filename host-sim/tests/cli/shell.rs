//! Completions and manual pages, from the command line itself.

use super::harness::{Bench, USAGE};

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
