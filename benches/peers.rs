//! The monitor beside what a user could pick instead, on the same records, in one run: `cargo xtask peers`.
//!
//! The records are made by the independent plant at 1 us. The peers are our own programs over well-known libraries,
//! each with the settings that suit it best: plain C with `NLopt`, vectorised C with Levenberg-Marquardt of its own,
//! numba with `SciPy`. All minimise the same sum of squares on one core.

#[path = "../tests/common/mod.rs"]
mod common;

use common::{PERIOD, Rig, Trace, command, rms};
use eha_monitor::channel::Channel;
use eha_monitor::fit::identify::{Identification, Settings};
use eha_monitor::fit::problem::{Free, Problem, Record, Start};
use eha_monitor::integrate::exact::Exact;
use eha_monitor::model::Form;
use eha_monitor::model::state::BASE_ORDER;
use eha_monitor::parameter::{Parameter, Parameters};
use reference_plant::add_noise;
use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// Records for each command.
const RECORDS: u32 = 20;
const SAMPLES: usize = 1000;
/// Step of the plant that makes the records, s.
const PLANT_STEP: f64 = 1e-6;
/// Noise of the current, mA.
const CURRENT_NOISE: f64 = 0.02;
const COMMANDS: [&str; 2] = ["chirp", "sine"];
/// Ranges of the search, the same for all.
const FREE: [Free<f64>; 2] = [
    Free { parameter: Parameter::Backlash, lower: 0.0, upper: 1.5e-3 },
    Free { parameter: Parameter::DryFriction, lower: 0.0, upper: 8000.0 },
];

type Stepper = Exact<f64, BASE_ORDER, 32>;

/// A record and what it was made with.
struct Case {
    faults: [f64; 2],
    noise: f64,
    command: Vec<f64>,
    clean: Trace,
    noisy: Trace,
}

/// What a program makes of the records of one command.
struct Outcome {
    /// Seconds for one simulation.
    simulation: f64,
    /// Its distance from the plant, um rms of the user position.
    distance: f64,
    answers: Vec<Answer>,
}

struct Answer {
    faults: [f64; 2],
    seconds: f64,
    evaluations: u32,
}

fn main() -> Result<(), Box<dyn Error>> {
    // `cargo test --benches` compiles this and runs it with `--test`: there is nothing to test.
    if !std::env::args().any(|argument| argument == "--bench") {
        return Ok(());
    }
    let peers = Peers::build(Path::new(env!("CARGO_TARGET_TMPDIR")))?;
    for name in COMMANDS {
        let cases: Vec<_> = (0..RECORDS).map(|index| case(name, index)).collect();
        let files = write(&peers.directory, name, &cases)?;
        let ours = ours(&cases);
        println!("\n{name}: {RECORDS} records of 1 s, position (1 to 5 um of noise) and current (0.02 mA)\n");
        println!(
            "| program                        | simulation us | ratio | from 1 us solution um | to the answer ms | ratio | evaluations | within 1 % |"
        );
        println!(
            "|--------------------------------|--------------:|------:|----------------------:|-----------------:|------:|------------:|-----------:|"
        );
        row("eha-monitor, f64, scalar", &ours, &ours, &cases);
        for (label, program) in &peers.programs {
            row(label, &run(program, &cases, &files)?, &ours, &cases);
        }
    }
    println!(
        "\nTimes are medians (a simulation: the shortest). Lanes: time for one of the candidates side by side."
    );
    Ok(())
}

/// One record: faults that differ from record to record, noise of 1 to 5 um.
fn case(name: &str, index: u32) -> Case {
    let spread = f64::from(index) / f64::from(RECORDS - 1);
    let faults = [1e-4 + 4e-4 * spread, 400.0 * 4.0_f64.powf(f64::from(index * 7 % RECORDS) / 19.0)];
    let noise = 1e-6 * f64::from(1 + index % 5);
    let command = command(name, SAMPLES);
    let clean = Rig::with(|p| (p.bkl, p.fdj) = (faults[0], faults[1])).plant_at(&command, PLANT_STEP);
    let mut noisy = clean.clone();
    add_noise(&mut noisy.user, noise, u64::from(index));
    add_noise(&mut noisy.current, CURRENT_NOISE, u64::from(index) + 1000);
    Case { faults, noise, command, clean, noisy }
}

/// Writes the records as the peers read them.
fn write(directory: &Path, name: &str, cases: &[Case]) -> std::io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for (index, case) in cases.iter().enumerate() {
        let mut text = format!("{:e} {CURRENT_NOISE:e}\n", case.noise);
        for ((command, user), current) in case.command.iter().zip(&case.noisy.user).zip(&case.noisy.current) {
            let _ = writeln!(text, "{command:e} {user:e} {current:e}");
        }
        let file = directory.join(format!("{name}-{index}.txt"));
        std::fs::write(&file, text)?;
        files.push(file);
    }
    Ok(files)
}

fn ours(cases: &[Case]) -> Outcome {
    let start = Start { time: 0.0, ram: 0.0, velocity: 0.0 };
    let mut outcome = Outcome { simulation: f64::INFINITY, distance: 0.0, answers: Vec::new() };
    for (index, case) in cases.iter().enumerate() {
        let record = [Record::new(PERIOD, &case.command, &start)
            .with(Channel::UserPosition, &case.noisy.user, case.noise)
            .with(Channel::Current, &case.noisy.current, CURRENT_NOISE)];
        let problem = Problem {
            form: Form::default(),
            parameters: Parameters::default(),
            free: &FREE,
            records: &record,
        };
        if index == 0 {
            let rig = Rig::with(|p| (p.bkl, p.fdj) = (case.faults[0], case.faults[1]));
            outcome.distance = 1e6 * rms(&rig.exact(&case.command).user, &case.clean.user);
            let genes = [FREE[0].gene(case.faults[0]), FREE[1].gene(case.faults[1])];
            let mut stepper = Stepper::new();
            for _ in 0..50 {
                let started = Instant::now();
                std::hint::black_box(problem.misfit(&genes, &mut stepper));
                outcome.simulation = outcome.simulation.min(started.elapsed().as_secs_f64());
            }
        }
        let started = Instant::now();
        let mut steppers = vec![Stepper::new()];
        let mut identification =
            Identification::<f64, 2, 20>::new(&problem, Settings::default(), index as u64)
                .expect("two are free");
        identification.run(&problem, &mut steppers);
        let seconds = started.elapsed().as_secs_f64();
        let genes = identification.result().map_or([0.0; 2], |finish| finish.genes);
        outcome.answers.push(Answer {
            faults: [FREE[0].value(genes[0]), FREE[1].value(genes[1])],
            seconds,
            evaluations: identification.evaluations(),
        });
    }
    outcome
}

/// Runs a peer: the faults of the first record, then the files of all.
fn run(program: &[String], cases: &[Case], files: &[PathBuf]) -> Result<Outcome, Box<dyn Error>> {
    let [bkl, fdj] = cases[0].faults.map(|value| value.to_string());
    let output = Command::new(&program[0]).args(&program[1..]).args([bkl, fdj]).args(files).output()?;
    if !output.status.success() {
        return Err(format!("{program:?}: {}", String::from_utf8_lossy(&output.stderr)).into());
    }
    let mut outcome = Outcome { simulation: f64::NAN, distance: 0.0, answers: Vec::new() };
    let mut user = Vec::new();
    for line in String::from_utf8(output.stdout)?.lines() {
        let mut words = line.split_whitespace();
        let kind = words.next().unwrap_or_default();
        let values = words.map(str::parse).collect::<Result<Vec<f64>, _>>()?;
        match (kind, values.as_slice()) {
            ("simulation", &[seconds]) => outcome.simulation = seconds,
            ("sample", &[position]) => user.push(position),
            ("answer", &[bkl, fdj, seconds, evaluations]) => {
                outcome.answers.push(Answer { faults: [bkl, fdj], seconds, evaluations: evaluations as u32 });
            }
            _ => return Err(format!("{program:?} printed `{line}`").into()),
        }
    }
    outcome.distance = 1e6 * rms(&user, &cases[0].clean.user);
    Ok(outcome)
}

fn row(label: &str, outcome: &Outcome, ours: &Outcome, cases: &[Case]) {
    let within = outcome.answers.iter().zip(cases).filter(|(answer, case)| {
        answer.faults.iter().zip(&case.faults).all(|(value, truth)| (value - truth).abs() <= 0.01 * truth)
    });
    let seconds = |outcome: &Outcome| median(outcome.answers.iter().map(|answer| answer.seconds));
    println!(
        "| {label:30} | {:13.1} | {:5.1} | {:21.4} | {:16.2} | {:5.1} | {:11.0} | {:>7} of {} |",
        1e6 * outcome.simulation,
        outcome.simulation / ours.simulation,
        outcome.distance,
        1e3 * seconds(outcome),
        seconds(outcome) / seconds(ours),
        median(outcome.answers.iter().map(|answer| f64::from(answer.evaluations))),
        within.count(),
        cases.len(),
    );
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<_> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// The peers, compiled.
struct Peers {
    directory: PathBuf,
    programs: Vec<(&'static str, Vec<String>)>,
}

impl Peers {
    fn build(directory: &Path) -> Result<Self, Box<dyn Error>> {
        let directory = directory.join("peers");
        std::fs::create_dir_all(&directory)?;
        let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/peers");
        let compile = |compiler: &str, source: &str, name: &str, flags: &[&str]| {
            let program = directory.join(name);
            let status = Command::new(compiler)
                .args(["-O3", "-march=native", "-o"])
                .arg(&program)
                .args(if compiler == "g++" { &["-x", "c++"][..] } else { &[] })
                .arg(sources.join(source))
                .args(["-x", "none"])
                .args(flags)
                .status()
                .map_err(|error| {
                    format!("{compiler}: {error}; run `cargo xtask peers`, which installs it")
                })?;
            if status.success() {
                Ok(vec![program.display().to_string()])
            } else {
                Err(format!("{compiler} cannot compile {source}; `cargo xtask peers` installs what it needs"))
            }
        };
        // `?:` between vectors is C++ in this compiler.
        let single = ["-DREAL=float", "-DINTEGER=int32_t", "-lm"];
        let python = std::env::var("PEERS_PYTHON").unwrap_or_else(|_| "python3".to_owned());
        let programs = vec![
            ("C, NLopt DIRECT-L then SBPLX", compile("gcc", "nlopt.c", "nlopt", &["-lnlopt", "-lm"])?),
            ("C lanes, f64, Levenberg-M.", compile("g++", "lanes.c", "lanes64", &["-lm"])?),
            ("C lanes, f32, Levenberg-M.", compile("g++", "lanes.c", "lanes32", &single)?),
            ("numba, SciPy least_squares", vec![python, sources.join("fit.py").display().to_string()]),
        ];
        Ok(Self { directory, programs })
    }
}
