//! Time of a diagnosis, and of a batch of identifications with one thread and with two: `cargo bench --bench program`.
#![allow(missing_docs, reason = "the macros of the harness make public functions")]

use criterion::{Criterion, criterion_group, criterion_main};
use rayon::ThreadPoolBuilder;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Identifications in a batch.
const BATCH: usize = 32;

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

fn batch(criterion: &mut Criterion) {
    use eha_monitor::channel::Channel;
    use host_sim::fit::{FitSettings, fit, prepare_with};
    use host_sim::record::read_csv;
    use host_sim::rig::Rig;

    let directory = tempfile::tempdir().expect("a directory");
    let file = simulate(directory.path(), "record.csv", &["--model", "lf", "--command", "sine"]);
    let rig = Rig::load("eha").expect("a built-in rig");
    let record = read_csv(&file).expect("a record").record;
    assert!(record.channel(Channel::Current).is_some());
    let prepared = [prepare_with(&rig, &record, [5e-6, f64::INFINITY, 0.02, f64::INFINITY])];
    for threads in [1, 2] {
        let pool =
            ThreadPoolBuilder::new().num_threads(threads).stack_size(16 << 20).build().expect("threads");
        criterion.bench_function(&format!("{BATCH} identifications, threads: {threads}"), |bencher| {
            bencher.iter(|| {
                pool.install(|| {
                    let one = |seed: u64| {
                        let settings = FitSettings { seed, ..FitSettings::default() };
                        fit(&rig, &rig.faults, &prepared, &settings, |_| ()).misfit.chi_square
                    };
                    (0..BATCH as u64).into_par_iter().map(one).sum::<f64>()
                })
            });
        });
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10);
    targets = diagnosis, batch
}
criterion_main!(benches);
