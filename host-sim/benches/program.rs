//! Time of a diagnosis, and of a look at a record of a fast logger: `cargo bench -p host-sim --bench program`.
#![allow(missing_docs, reason = "the macros of the harness make public functions")]

use criterion::{Criterion, criterion_group, criterion_main};
use std::path::{Path, PathBuf};
use std::process::Command;

fn host_sim(arguments: &[&str], files: &[PathBuf]) {
    let output =
        Command::new(env!("CARGO_BIN_EXE_host-sim")).arg("--quiet").args(arguments).args(files).output();
    let output = output.expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

fn simulate(directory: &Path, name: &str, arguments: &[&str]) -> PathBuf {
    let file = directory.join(name);
    let noise = ["--noise", "lvdt_m=5e-6,current_mA=0.02", "--channels", "lvdt_m,current_mA", "-o"];
    let faults = ["simulate", "--set", "bkl=2e-4", "--set", "fdj=800"];
    host_sim(&[&faults[..], arguments, &noise[..]].concat(), std::slice::from_ref(&file));
    file
}

fn diagnosis(criterion: &mut Criterion) {
    let directory = tempfile::tempdir().expect("a directory");
    for model in ["lf", "hf"] {
        let record = |command: &str, seed: &str| {
            let name = format!("{model}-{command}.csv");
            simulate(directory.path(), &name, &["--model", model, "--command", command, "--seed", seed])
        };
        let mut files = vec![record("chirp", "1"), record("mixed", "2")];
        files.extend([PathBuf::from("--holdout"), record("mixed-step", "3")]);
        criterion.bench_function(&format!("diagnosis of {model} records, whole program"), |bencher| {
            bencher.iter(|| host_sim(&["diagnose"], &files));
        });
    }
}

/// As many samples at 1 kHz and at 10 kHz, where a time is ten times as many of them: both are to take about as long.
fn fast_record(criterion: &mut Criterion) {
    let directory = tempfile::tempdir().expect("a directory");
    for (rate, period, duration) in [("1 kHz", "1e-3", "600"), ("10 kHz", "1e-4", "60")] {
        let sine = ["--model", "lf", "--command", "sine", "--frequency", "0.7", "--period", period];
        let file = simulate(directory.path(), "fast.csv", &[&sine[..], &["--duration", duration]].concat());
        criterion.bench_function(&format!("check of 600,000 samples at {rate}, whole program"), |bencher| {
            bencher.iter(|| host_sim(&["check"], std::slice::from_ref(&file)));
        });
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10);
    targets = diagnosis, fast_record
}
criterion_main!(benches);
