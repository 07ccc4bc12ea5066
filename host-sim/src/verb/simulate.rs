//! `simulate`: a record from the HF or the LF model.

use super::assignment::Assignment;
use super::files::Files;
use super::{assignments, check_delay, set};
use crate::cli::Common;
use crate::failure::Failure;
use crate::output;
use crate::plant::{self, Excitation, Sensing};
use crate::record::{self, ReadOptions, Record};
use crate::rig::{Rig, channel_named, effect_named, unknown};
use crate::table_file::table_path_or_stdout;
use clap::ValueEnum;
use eha_monitor::channel::{Channel, ChannelRole};
use eha_monitor::command::{COMMANDS, Command, CommandInfo, cosine_of_turns, sine_of_turns};
use eha_monitor::model::Drive;
use serde_json::{Map, Value, json};
use std::fmt::Write as _;
use std::path::PathBuf;

/// Which model makes the data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Fidelity {
    /// High fidelity: square-root metering.
    Hf,
    /// Low fidelity: the monitor's own model, linear fluid.
    Lf,
}

impl Fidelity {
    /// Its name, as it is typed.
    fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }
}

/// Options of `simulate`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Model.
    #[arg(long, value_enum, default_value_t = Fidelity::Hf)]
    model: Fidelity,
    /// Command (see `commands`), or a CSV file whose command, load and force are flown again.
    #[arg(long, default_value = "chirp", value_name = "NAME|FILE.csv")]
    command: String,
    /// Amplitude of the command in place of its own, m (ramp: m/s). A command takes those of these options that it has.
    #[arg(long, value_name = "M", allow_hyphen_values = true)]
    amplitude: Option<f64>,
    /// Frequency of the command in place of its own, Hz (chirp: at its start).
    #[arg(long, value_name = "HZ", allow_hyphen_values = true)]
    frequency: Option<f64>,
    /// Chirp: frequency at the end of the sweep, Hz.
    #[arg(long, value_name = "HZ", allow_hyphen_values = true)]
    end_frequency: Option<f64>,
    /// Chirp: duration of the sweep, s.
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    sweep: Option<f64>,
    /// Duration, s; 1 by default.
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    duration: Option<f64>,
    /// Sample period, s; 0.001 by default.
    #[arg(long, value_name = "S", allow_hyphen_values = true)]
    period: Option<f64>,
    /// Longest step of the integration, s; a whole number of steps makes a sample.
    #[arg(long, default_value_t = 1e-6, value_name = "S", allow_hyphen_values = true)]
    step: f64,
    /// Value of a parameter or fault: `bkl=2e-4`, `FDJ=800` (names and symbols as `rigs eha --json` lists them).
    #[arg(long = "set", value_delimiter = ',', value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Effect with the values of its parameters, in the order of `effects`: `spool-overlap=12e-6`, `step-load=300,0.4`.
    /// Those left out at the end keep the rig's.
    #[arg(long = "effect", value_name = "NAME=VALUE[,VALUE]")]
    effects: Vec<String>,
    /// External load on the jack, N: `constant:500`, `ramp:1000` (N/s), `sine:500:2` (amplitude, Hz), `cosine:500:2`.
    #[arg(long, value_name = "SHAPE:N[:HZ]")]
    load: Option<String>,
    /// Sensor noise (standard deviation) of a channel: `lvdt_m=5e-6`.
    #[arg(long, value_delimiter = ',', value_name = "CHANNEL=VALUE")]
    noise: Vec<String>,
    /// Step in which a channel is read: `lvdt_m=1e-6`.
    #[arg(long, value_delimiter = ',', value_name = "CHANNEL=VALUE")]
    quantum: Vec<String>,
    /// Chance that a sample of a measured channel is missing.
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    dropout: f64,
    /// Measured channels to write; all by default.
    #[arg(long, value_delimiter = ',', value_name = "CHANNEL")]
    channels: Vec<String>,
    /// Where to write the record (CSV, or Parquet if it ends so); `record.csv` in the directory of `--out` by default,
    /// else stdout (`-`).
    #[arg(long, short, value_name = "REC.csv|.parquet", value_parser = table_path_or_stdout())]
    output: Option<PathBuf>,
}

impl Options {
    /// The file whose command is flown, where it is no built-in one.
    fn flown(&self) -> Option<PathBuf> {
        self.command.to_ascii_lowercase().ends_with(".csv").then(|| PathBuf::from(&self.command))
    }
}

/// Most samples of a simulated record.
const MAX_SAMPLES: f64 = 1e7;

/// Longest step of the integration, s: a longer one is off by more than a sensor's noise.
const LONGEST_STEP: f64 = 1e-4;

/// Most steps in a sample, and in all: those take an hour.
const MAX_STEPS: [f64; 2] = [1e6, 1e10];

/// Runs the verb.
///
/// # Errors
/// Usage: an unknown name or a value out of range, or options that make no record (too short, or nothing moves).
pub fn run(common: &Common, options: &Options) -> Result<(), Failure> {
    let path = output::record_path(common, options.output.as_deref());
    let flown: Vec<PathBuf> = options.flown().into_iter().collect();
    Files::new(common).reads(&flown).writes(path.clone()).check()?;
    let mut rig = super::rig(common, super::DEFAULT_RIG)?;
    if options.model == Fidelity::Hf && rig.form.drive == Drive::Valve {
        rig.parameters.metering_blend = 1.0;
    }
    assignments(&mut rig.parameters, &options.set)?;
    for text in &options.effects {
        let sizes = Assignment::new(text, "NAME=VALUE[,VALUE], such as step-load=300,0.4")?;
        let effect = effect_named(sizes.name)?;
        let values: Vec<&str> = sizes.value.split(',').collect();
        if values.len() > effect.parameters.len() {
            let names: Vec<&str> = effect.parameters.iter().map(|parameter| parameter.info().name).collect();
            return Err(Failure::usage(format!(
                "effect `{}`: {} values, expected at most those of {}",
                effect.name,
                values.len(),
                names.join(",")
            )));
        }
        for (&parameter, value) in effect.parameters.iter().zip(values) {
            set(&mut rig.parameters, parameter, sizes.number(value)?)?;
        }
    }
    if !(0.0..1.0).contains(&options.dropout) {
        return Err(Failure::usage(format!("--dropout {}: expected 0 to below 1", options.dropout)));
    }
    let sensing = Sensing {
        noise: channel_values(&options.noise)?,
        quantum: channel_values(&options.quantum)?,
        dropout: options.dropout,
    };
    let wanted = options.channels.iter().map(|column| measured(column)).collect::<Result<Vec<_>, _>>()?;
    let Asked { mut excitation, command } = asked(options, &rig)?;
    let step = step(options.step, &excitation)?;
    check_delay(&rig, excitation.sample_period)?;
    let outputs = plant::run(&rig, &excitation, step);
    if let Some(law) = &rig.controller {
        excitation.drive = plant::asked(law, &excitation, &outputs);
    }
    let record = plant::record("simulation", rig.form, &excitation, &outputs, &sensing, common.seed)
        .map_err(|failure| Failure::usage(format!("these options make no record: {failure}")))?;
    let record = if wanted.is_empty() { record } else { keep(&record, &wanted)? };
    let mut comments = vec![
        format!("host-sim {} simulate, seed {}", env!("CARGO_PKG_VERSION"), common.seed),
        format!("rig {}, model {}, step {step} s, command {command}", rig.name, options.model.name()),
    ];
    for (parameter, value) in rig.changed() {
        comments.push(format!("{} = {value} {}", parameter.info().name, parameter.info().unit));
    }
    for (what, list) in [("noise", &sensing.noise), ("quantum", &sensing.quantum)] {
        for (channel, value) in list {
            comments.push(format!("{what} of {} = {value} {}", channel.info().column, channel.info().unit));
        }
    }
    if sensing.dropout > 0.0 {
        comments.push(format!("chance of a lost sample = {}", sensing.dropout));
    }
    if let Some(load) = &options.load {
        comments.push(format!("load {load}"));
    }
    let config = json!({
        "rig": rig.name,
        "model": options.model.name(),
        "parameters": rig.changed().into_iter().map(|(parameter, value)| (parameter.info().name.to_owned(), json!(value))).collect::<Map<_, _>>(),
        "command": command,
        "samples": excitation.command.len(),
        "sample_period_s": excitation.sample_period,
        "load": options.load,
        "step_s": step,
        "dropout": options.dropout,
        "channels": record.channels().map(|(channel, _)| channel.info().column).collect::<Vec<_>>(),
        "noise": channel_json(&sensing.noise),
        "quantum": channel_json(&sensing.quantum),
    });
    output::record(common, &record, &comments, path.as_deref(), config)
}

fn channel_json(list: &[(Channel, f64)]) -> Value {
    list.iter()
        .map(|(channel, value)| (channel.info().column.to_owned(), json!(value)))
        .collect::<Map<_, _>>()
        .into()
}

fn positive(name: &str, value: f64) -> Result<f64, Failure> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(Failure::usage(format!("--{name} {value}: expected a positive number")))
    }
}

/// The step with which an excitation is flown: the longest that a sample is a whole number of, but for rounding.
fn step(asked: f64, excitation: &Excitation) -> Result<f64, Failure> {
    positive("step", asked)?;
    if asked > LONGEST_STEP {
        return Err(Failure::usage(format!("--step {asked}: expected at most {LONGEST_STEP} s")));
    }
    let (period, samples) = (excitation.sample_period, excitation.command.len() as f64);
    let [of_sample, in_all] = MAX_STEPS;
    let shortest = (period / of_sample).max(period * samples / in_all);
    // What is shorter by rounding is not meant so.
    if asked < shortest * (1.0 - 1e-9) {
        return Err(Failure::usage(format!(
            "--step {asked:e}: expected at least {shortest:e} s for {samples} samples every {period} s"
        )));
    }
    let used = plant::step(period, asked);
    Ok(if (used / asked - 1.0).abs() < 1e-9 { asked } else { used })
}

fn channel_values(list: &[String]) -> Result<Vec<(Channel, f64)>, Failure> {
    list.iter()
        .map(|text| {
            let of_channel = Assignment::new(text, "CHANNEL=VALUE, such as lvdt_m=5e-6")?;
            let value = of_channel.number(of_channel.value)?;
            if !value.is_finite() || value < 0.0 {
                return Err(Failure::usage(format!("`{text}`: expected a number that is not negative")));
            }
            Ok((measured(of_channel.name)?, value))
        })
        .collect()
}

fn measured(column: &str) -> Result<Channel, Failure> {
    let channel = channel_named(column)?;
    if channel.info().role == ChannelRole::Measured {
        Ok(channel)
    } else {
        Err(Failure::usage(format!("`{column}` is not a measured channel")))
    }
}

/// A record with the inputs, the user position and the channels that are wanted.
fn keep(record: &Record, wanted: &[Channel]) -> Result<Record, Failure> {
    let is_kept = |channel: Channel| {
        channel.info().role == ChannelRole::Input
            || channel == Channel::UserPosition
            || wanted.contains(&channel)
    };
    let channels = record
        .channels()
        .filter(|(channel, _)| is_kept(*channel))
        .map(|(channel, values)| (channel, values.to_vec()))
        .collect();
    Ok(Record::new(record.name(), record.sample_period_s(), record.start_time_s(), channels)?)
}

/// An option that shapes a command.
struct Shaping {
    /// Its name.
    option: &'static str,
    /// What is shaped, in words, and its unit.
    words: &'static str,
    unit: &'static str,
    /// What the user gives for it.
    given: fn(&Options) -> Option<f64>,
    /// The command's own value; 0 where it has none.
    own: fn(&CommandInfo) -> f64,
    /// Sets it.
    set: fn(&mut Command<f64>, f64),
}

/// The options that shape commands.
const SHAPING: [Shaping; 4] = [
    Shaping {
        option: "amplitude",
        words: "amplitude",
        unit: "",
        given: |options| options.amplitude,
        own: |info| info.amplitude,
        set: |command, value| command.amplitude = value,
    },
    Shaping {
        option: "frequency",
        words: "frequency",
        unit: " Hz",
        given: |options| options.frequency,
        own: |info| info.frequency,
        set: |command, value| command.frequency = value,
    },
    Shaping {
        option: "end-frequency",
        words: "end frequency",
        unit: " Hz",
        given: |options| options.end_frequency,
        own: |info| info.end_frequency,
        set: |command, value| command.end_frequency = value,
    },
    Shaping {
        option: "sweep",
        words: "sweep",
        unit: " s",
        given: |options| options.sweep,
        own: |info| info.sweep,
        set: |command, value| command.sweep = value,
    },
];

/// A command of the table with what the user gives for it, and in words.
///
/// # Errors
/// Usage: an option that the command does not have, or a sweep that takes no time.
fn shaped(info: &CommandInfo, options: &Options) -> Result<(Command<f64>, String), Failure> {
    let has = |shaping: &&Shaping| (shaping.own)(info) != 0.0;
    if let Some(foreign) = SHAPING.iter().find(|shaping| !has(shaping) && (shaping.given)(options).is_some())
    {
        let taken: Vec<String> =
            SHAPING.iter().filter(has).map(|shaping| format!("--{}", shaping.option)).collect();
        let taken = if taken.is_empty() { "none that shapes it".to_owned() } else { taken.join(", ") };
        return Err(Failure::usage(format!(
            "--{}: the command `{}` has no {}, expected {taken}",
            foreign.option, info.name, foreign.words
        )));
    }
    if let Some(sweep) = options.sweep {
        positive("sweep", sweep)?;
    }
    let mut command = Command::<f64>::new(info);
    let mut words = info.name.to_owned();
    for shaping in SHAPING.iter().filter(has) {
        let value = (shaping.given)(options).unwrap_or((shaping.own)(info));
        (shaping.set)(&mut command, value);
        let _ = write!(words, ", {} {value}{}", shaping.words, shaping.unit);
    }
    Ok((command, words))
}

/// What is flown.
struct Asked {
    excitation: Excitation,
    /// The command in words.
    command: String,
}

/// The command of a name or of a record, the load, and for a rig that is driven by a force without a known controller
/// the force.
fn asked(options: &Options, rig: &Rig) -> Result<Asked, Failure> {
    let (mut excitation, command) = match (CommandInfo::named(&options.command), options.flown()) {
        (Some(info), _) => {
            let period = positive("period", options.period.unwrap_or(1e-3))?;
            let duration = positive("duration", options.duration.unwrap_or(1.0))?;
            let samples = (duration / period).round() + 1.0;
            if samples > MAX_SAMPLES {
                return Err(Failure::usage(format!(
                    "--duration {duration} at --period {period}: {samples:e} samples, expected at most {MAX_SAMPLES:e}"
                )));
            }
            let (command, words) = shaped(info, options)?;
            let excitation = Excitation {
                sample_period: period,
                command: (0..samples as usize).map(|sample| command.at(sample as f64 * period)).collect(),
                load: Vec::new(),
                drive: Vec::new(),
            };
            (excitation, words)
        }
        (None, Some(path)) => {
            let shapes = SHAPING.iter().map(|shaping| (shaping.option, (shaping.given)(options)));
            let times = [("duration", options.duration), ("period", options.period)];
            if let Some((name, _)) = shapes.chain(times).find(|(_, value)| value.is_some()) {
                return Err(Failure::usage(format!(
                    "--{name} shapes a built-in command: {} is flown as it is",
                    options.command
                )));
            }
            let record =
                record::read(&path, &ReadOptions { inputs_only: true, ..ReadOptions::default() })?.record;
            let values = |channel| record.channel(channel).map(<[f64]>::to_vec).unwrap_or_default();
            let excitation = Excitation {
                sample_period: record.sample_period_s(),
                command: values(Channel::Command),
                load: values(Channel::Load),
                drive: values(Channel::Drive),
            };
            (excitation, format!("of {}", options.command))
        }
        (None, None) => {
            return Err(Failure::usage(unknown(
                "command",
                &options.command,
                COMMANDS.iter().map(|row| row.name),
            )));
        }
    };
    if rig.form.drive == Drive::Valve || rig.controller.is_some() {
        excitation.drive.clear();
    } else if excitation.drive.is_empty() {
        return Err(Failure::usage(
            "a rig that is driven by a force needs --command FILE.csv with drive_N, or a [controller]",
        ));
    }
    if let Some(text) = &options.load {
        let period = excitation.sample_period;
        excitation.load = load(text, excitation.command.len(), period)?;
    }
    for (channel, series) in [(Channel::Command, &excitation.command), (Channel::Load, &excitation.load)] {
        if !series.iter().all(|value| value.is_finite()) {
            return Err(Failure::usage(format!(
                "these options make a {} that is not finite",
                channel.info().column
            )));
        }
    }
    Ok(Asked { excitation, command })
}

fn load(text: &str, samples: usize, period: f64) -> Result<Vec<f64>, Failure> {
    let wrong = || {
        Failure::usage(format!("--load `{text}`: expected constant:N, ramp:N/s, sine:N:HZ or cosine:N:HZ"))
    };
    let mut fields = text.split(':');
    let shape = fields.next().unwrap_or_default();
    let mut value = || fields.next().and_then(|field| field.parse::<f64>().ok()).ok_or_else(wrong);
    let size = value()?;
    let profile: Box<dyn Fn(f64) -> f64> = match shape {
        "constant" => Box::new(move |_| size),
        "ramp" => Box::new(move |t| size * t),
        "sine" => {
            let frequency = value()?;
            Box::new(move |t| size * sine_of_turns(frequency * t))
        }
        "cosine" => {
            let frequency = value()?;
            Box::new(move |t| size * cosine_of_turns(frequency * t))
        }
        _ => return Err(wrong()),
    };
    if fields.next().is_some() {
        return Err(wrong());
    }
    Ok((0..samples).map(|sample| profile(sample as f64 * period)).collect())
}
