//! Throughput of two threads on a batch of identifications, and the peak memory of the program: `cargo bench -p host-sim
//! --bench load`.
//!
//! One thread and two take turns, and the shortest time of each counts: what else runs on the machine then disturbs both
//! alike. The memory is what the kernel says of the program's verbs (Linux only).

use eha_monitor::channel::Channel;
use host_sim::fit::{FitSettings, Prepared, fit, prepare_with};
use host_sim::record::read_csv;
use host_sim::rig::Rig;
use rayon::ThreadPoolBuilder;
use rayon::prelude::*;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use std::{error::Error, fs, thread};

/// Identifications in a batch: a few tenths of a second.
const BATCH: u64 = 256;
/// Batches with each number of threads.
const ROUNDS: usize = 15;
/// Between two looks at a program's memory. Its peak never falls, so only what the last moment adds is missed.
const INTERVAL: Duration = Duration::from_millis(2);

type Failure = Box<dyn Error>;

fn main() -> Result<(), Failure> {
    // `cargo test --benches` compiles this and runs it with `--test`: there is nothing to test.
    if !std::env::args().any(|argument| argument == "--bench") {
        return Ok(());
    }
    let directory = tempfile::tempdir()?;
    throughput(directory.path())?;
    memory(directory.path())
}

fn throughput(directory: &Path) -> Result<(), Failure> {
    let file = directory.join("record.csv");
    let noise = ["--noise", "lvdt_m=5e-6,current_mA=0.02", "--channels", "lvdt_m,current_mA"];
    let faults = ["simulate", "--model", "lf", "--command", "chirp", "--set", "bkl=2e-4", "--set", "fdj=800"];
    peak(directory, &[&faults[..], &noise[..], &["-o", "record.csv"]].concat())?;
    let rig = Rig::load("eha")?;
    let record = read_csv(&file)?.record;
    assert!(record.channel(Channel::Current).is_some());
    let prepared = [prepare_with(&rig, &record, [5e-6, f64::INFINITY, 0.02, f64::INFINITY])];
    let pools = [1, 2].map(|threads| {
        ThreadPoolBuilder::new().num_threads(threads).stack_size(host_sim::WORKER_STACK).build()
    });
    let [one, two] = pools;
    let pools = [one?, two?];
    let mut shortest = [f64::INFINITY; 2];
    for _ in 0..ROUNDS {
        for (pool, shortest) in pools.iter().zip(&mut shortest) {
            let started = Instant::now();
            pool.install(|| batch(&rig, &prepared));
            *shortest = shortest.min(started.elapsed().as_secs_f64());
        }
    }
    let [one, two] = shortest.map(|seconds| BATCH as f64 / seconds);
    println!(
        "{BATCH} identifications of 1 s: {one:.0} a second with one thread, {two:.0} with two: {:.2} times",
        two / one
    );
    Ok(())
}

fn batch(rig: &Rig, prepared: &[Prepared]) -> f64 {
    let one = |seed: u64| {
        let settings = FitSettings { seed, ..FitSettings::default() };
        fit(rig, &rig.faults, prepared, &settings, |_| ()).misfit.chi_square
    };
    (0..BATCH).into_par_iter().map(one).sum()
}

fn memory(directory: &Path) -> Result<(), Failure> {
    for verb in [&["identify", "record.csv"][..], &["reproduce", "--lf-data", "--cases-only"], &["demo"]] {
        match peak(directory, verb)? {
            Some(bytes) => println!("{}: peak memory {:.1} MB", verb.join(" "), bytes as f64 / 1e6),
            None => println!("{}: peak memory not known here", verb.join(" ")),
        }
    }
    Ok(())
}

/// Runs the program, and says how many bytes of memory it had at most, where that can be known.
fn peak(directory: &Path, arguments: &[&str]) -> Result<Option<u64>, Failure> {
    let mut program = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args(["--quiet", "--threads", "2"])
        .args(arguments)
        .current_dir(directory)
        .stdout(Stdio::null())
        .spawn()?;
    let status = format!("/proc/{}/status", program.id());
    let mut most = None;
    loop {
        if let Some(exit) = program.try_wait()? {
            return if exit.success() { Ok(most) } else { Err(format!("{arguments:?} failed").into()) };
        }
        most = most.max(fs::read_to_string(&status).ok().as_deref().and_then(high_water_mark));
        thread::sleep(INTERVAL);
    }
}

/// Peak resident memory, bytes, in the kernel's words about a process.
fn high_water_mark(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.split_whitespace().next()?.parse().ok().map(|kilobytes: u64| kilobytes * 1024)
}
