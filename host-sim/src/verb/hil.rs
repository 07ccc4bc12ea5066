//! `host-sim hil`: samples to the firmware's monitor over a line, its estimates as they come.

use super::assignment::Assignment;
use super::{DEFAULT_RIG, InputOptions, assignments, rig, set};
use crate::cli::Common;
use crate::emulator::Machine;
use crate::failure::Failure;
use crate::fit::TYPICAL_NOISE;
use crate::hil::line::Line;
use crate::hil::stream::{Growth, Simulated, of_record};
use crate::hil::{Outcome, STEPS_PER_SAMPLE, Session};
use crate::output::{self, counted, number, quantity};
use crate::rig::{CommandPath, Rig};
use eha_monitor::channel::Channel;
use eha_monitor::link::message::{FAULTS, FromMonitor, ReportMessage};
use eha_monitor::link::station::WINDOW;
use eha_monitor::monitor::config::{Config, Fault};
use eha_monitor::monitor::report::Verdict;
use eha_monitor::trial::SensorNoise;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::PathBuf;

/// Options of `hil`.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Record to stream; an actuator is simulated where none is given.
    #[arg(value_name = "REC.csv", conflicts_with_all = ["command", "seconds", "set", "grow"])]
    record: Option<PathBuf>,
    #[command(flatten)]
    input: InputOptions,
    /// Emulated board.
    #[arg(long, value_enum, default_value = "mps2-an500")]
    machine: Machine,
    /// Serial port in place of the emulated board.
    #[arg(long, value_name = "DEVICE", conflicts_with = "machine")]
    port: Option<PathBuf>,
    /// Speed of the serial port.
    #[arg(long, default_value_t = 921_600, allow_negative_numbers = true, requires = "port")]
    baud: u32,
    /// Command of the simulated actuator.
    #[arg(long, default_value = "mixed")]
    command: String,
    /// How long the simulated actuator runs, s.
    #[arg(long, default_value_t = 10.0, allow_hyphen_values = true, value_parser = seconds)]
    seconds: f64,
    /// Parameter of the simulated actuator: `fdj=800`.
    #[arg(long = "set", value_delimiter = ',', value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Parameter of the simulated actuator that grows within a second: `bkl=2e-4@4` from 4 s on.
    #[arg(long = "grow", value_delimiter = ',', value_name = "NAME=VALUE@SECONDS")]
    grow: Vec<String>,
    /// Fault to watch, with its healthy and its alarmed value: twice.
    #[arg(long = "watch", value_delimiter = ',', value_name = "NAME=HEALTHY..ALARM", default_values = ["bkl=1e-4..2e-4", "fdj=400..600"])]
    watch: Vec<String>,
    /// Chance that a byte of the samples is lost, damaged, repeated or reordered on its way.
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true, value_parser = rate)]
    damage: f64,
}

fn rate(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|rate| (0.0..=1.0).contains(rate)).ok_or_else(|| "expected 0 to 1".to_owned())
}

fn seconds(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|time| (0.1..=3600.0).contains(time))
        .ok_or_else(|| "expected 0.1 to 3600".to_owned())
}

/// Noise of user position, m, and current, mA, where the rig has none.
const NOISE: [f64; 2] = [TYPICAL_NOISE[0], TYPICAL_NOISE[2]];

/// Runs the verb.
///
/// # Errors
/// The rig or the record is refused, the line fails, or board and host do not agree.
pub fn run(common: &Common, options: &Options) -> Result<(), Failure> {
    let rig = rig(common, DEFAULT_RIG)?;
    let session = session(common, options, &rig)?;
    session.check()?;
    if rig.command_path == CommandPath::Curve {
        output::log(common, "the monitor joins the samples of a command by straight lines, not by a curve");
    }
    let (line, name) = if let Some(port) = &options.port {
        if let Some(feature) = session.image().feature() {
            output::log(
                common,
                &format!("this rig needs the image of the feature `{feature}` behind the port"),
            );
        }
        (Line::to_port(port, options.baud, &session)?, port.display().to_string())
    } else {
        output::log(common, &format!("{}: building and starting the firmware", options.machine.name()));
        (Line::to_emulator(options.machine, &[], &session)?, options.machine.name().to_owned())
    };
    let mut failed = None;
    if !common.json {
        output::print(&heading(&session.config))?;
    }
    let outcome = session.run(line, |report| {
        if !common.json && failed.is_none() {
            failed = output::print(&line_of(&session.config, report)).err();
        }
    })?;
    failed.map_or(Ok(()), Err)?;
    if common.json {
        output::print_json(&json_of(common, options, &session, &outcome, &name, &rig))?;
    } else {
        output::print(&summary(&session, &outcome))?;
    }
    if outcome.is_identical {
        Ok(())
    } else if outcome.status.is_none() {
        Err(Failure::other(format!(
            "the firmware fell silent after {} of {}",
            outcome.reports.len(),
            counted(outcome.twin.len(), "report")
        )))
    } else {
        Err(Failure::other(
            "the firmware's answer differs from that of the monitor in this program: if the sources have changed since it was \
             built, build it anew",
        ))
    }
}

fn session(common: &Common, options: &Options, rig: &Rig) -> Result<Session, Failure> {
    let mut noise = [Channel::UserPosition, Channel::Current].map(|channel| rig.noise_of(channel));
    let mut sample_period = 1e-3;
    let noise_or_default = [noise[0].unwrap_or(NOISE[0]), noise[1].unwrap_or(NOISE[1])];
    let samples = if let Some(path) = &options.record {
        let records = options.input.read(common, std::slice::from_ref(path))?;
        let record = records.first().ok_or_else(|| Failure::data("no record"))?;
        if record.channel(Channel::Load).is_some() {
            output::log(common, "warning: the monitor has no input for a load: load_N is not sent");
        }
        sample_period = record.sample_period_s();
        let estimated = crate::fit::noise_of(rig, record);
        noise[0] = noise[0].or(Some(estimated[0]));
        noise[1] = noise[1].or(Some(estimated[2]));
        of_record(record)?
    } else {
        noise = noise_or_default.map(Some);
        simulated(common, options, rig, noise_or_default)?.samples()?
    };
    let [user, current] = [noise[0].unwrap_or(NOISE[0]), noise[1].unwrap_or(f64::INFINITY)];
    let config = Config {
        form: rig.form,
        parameters: rig.parameters.to_f32(),
        sample_period: sample_period as f32,
        holds_command: rig.command_path == CommandPath::Held,
        noise: SensorNoise { user: user as f32, current: current as f32 },
        faults: watched(options, rig)?,
        false_alarm_rate: Config::<FAULTS>::FALSE_ALARM_RATE,
        seed: common.seed,
        steps_per_sample: STEPS_PER_SAMPLE,
    };
    Ok(Session { config, samples, damage: options.damage, seed: common.seed })
}

fn simulated(common: &Common, options: &Options, rig: &Rig, noise: [f64; 2]) -> Result<Simulated, Failure> {
    let mut parameters = rig.parameters;
    for watch in watched(options, rig)? {
        parameters.set(watch.free.parameter, f64::from(watch.healthy));
    }
    assignments(&mut parameters, &options.set)?;
    let growths = options.grow.iter().map(|text| {
        let growth = Assignment::new(text, "NAME=VALUE@SECONDS, such as bkl=2e-4@4")?;
        let (parameter, [value, start]) = (growth.parameter()?, growth.two_numbers("@")?);
        set(&mut parameters.clone(), parameter, value)?;
        Ok(Growth { parameter, value, start })
    });
    Ok(Simulated {
        form: rig.form,
        parameters,
        growths: growths.collect::<Result<_, Failure>>()?,
        command: options.command.clone(),
        seconds: options.seconds,
        sample_period: 1e-3,
        holds_command: rig.command_path == CommandPath::Held,
        noise,
        seed: common.seed,
    })
}

fn watched(options: &Options, rig: &Rig) -> Result<[Fault; FAULTS], Failure> {
    let faults = options.watch.iter().map(|text| {
        let watch = Assignment::new(text, "NAME=HEALTHY..ALARM, such as bkl=1e-4..2e-4")?;
        let parameter = watch.parameter()?;
        let [healthy, alarm] = watch.two_numbers("..")?.map(|level| level as f32);
        let info = parameter.info();
        let declared = rig.faults.iter().find(|range| range.parameter == parameter);
        let range = declared.map_or([info.lower, info.upper], |range| [range.lower, range.upper]);
        Ok(Fault::new(parameter, range.map(|end| end as f32), healthy, alarm))
    });
    let faults: Vec<Fault> = faults.collect::<Result<_, Failure>>()?;
    faults.try_into().map_err(|_| {
        Failure::usage(format!("the firmware's monitor watches {FAULTS} faults: give --watch twice"))
    })
}

fn verdict_name(report: &ReportMessage) -> &'static str {
    Verdict::ALL.get(usize::from(report.verdict)).map_or("unknown", |verdict| verdict.name())
}

fn heading(config: &Config<FAULTS>) -> String {
    let mut text = format!("{:>6} {:>16}", "window", "verdict");
    for fault in &config.faults {
        let _ = write!(text, " {:>26} {:>8}", fault.free.parameter.info().name, "evidence");
    }
    text + &format!(" {:>12} {:>8} {:>7} {:>6}", "residual", "excluded", "latency", "alarm")
}

fn line_of(config: &Config<FAULTS>, report: &ReportMessage) -> String {
    let mut text = format!("{:>6} {:>16}", report.counts[0], verdict_name(report));
    for (fault, ([value, error, evidence], [informative, _])) in
        config.faults.iter().zip(report.faults.iter().zip(report.flags))
    {
        let unit = fault.free.parameter.info().unit;
        let error = if informative { quantity(f64::from(*error), unit) } else { "-".to_owned() };
        let value = quantity(f64::from(*value), unit);
        let _ = write!(text, " {value:>13} +- {error:>9} {:>7.0}%", evidence * 100.0);
    }
    let alarms = alarmed(config, report.flags.map(|[_, alarmed]| alarmed));
    let excluded: u32 = report.exclusions.iter().sum();
    text + &format!(
        " {:>12} {excluded:>8} {:>7} {:>6}",
        quantity(f64::from(report.residual[0][0]), "m"),
        report.counts[2],
        if alarms.is_empty() { "-".to_owned() } else { alarms.join(",") }
    )
}

/// Names of the faults that are alarmed.
fn alarmed(config: &Config<FAULTS>, alarms: [bool; FAULTS]) -> Vec<&'static str> {
    let faults = config.faults.iter().zip(alarms).filter(|(_, alarmed)| *alarmed);
    faults.map(|(fault, _)| fault.free.parameter.info().name).collect()
}

fn summary(session: &Session, outcome: &Outcome) -> String {
    let mut text = format!(
        "{}; the host's own run of the monitor {}",
        counted(outcome.reports.len(), "report"),
        if outcome.is_identical { "gives the same bytes" } else { "DIFFERS" }
    );
    if outcome.twin.is_empty()
        && let Some(FromMonitor::Status { monitor, .. }) = outcome.status
    {
        let _ = write!(text, "\nno report: {}", why_none(session.samples.len(), monitor));
    }
    let injected = outcome.injected;
    let _ = write!(
        text,
        "\n{} bytes sent; on the way {} were lost, {} damaged, {} repeated, {} reordered",
        outcome.bytes, injected.lost, injected.flipped, injected.repeated, injected.reordered
    );
    if let Some(FromMonitor::Status {
        received: [bytes, frames, damaged],
        monitor: [samples, _, skipped],
        ..
    }) = outcome.status
    {
        let _ = write!(
            text,
            "\nreceived: {bytes} bytes, {frames} frames whole, {damaged} damaged; {samples} samples, {} skipped",
            counted(skipped as usize, "window")
        );
    }
    if let Some(log) = &outcome.log {
        for (name, value) in &log.measures {
            let _ = write!(text, "\nmeasured: {name} = {value}");
        }
    }
    text
}

/// Why a monitor that has counted samples, windows and skipped windows reports none.
fn why_none(sent: usize, [samples, windows, skipped]: [u32; 3]) -> String {
    let [sent, received] = [sent, samples as usize].map(|count| counted(count, "sample"));
    if samples == 0 {
        format!("of {sent} none was received")
    } else if windows == 0 {
        format!(
            "{sent} sent, {received} received, and a window, which is reported when it is whole, takes {WINDOW}"
        )
    } else {
        let skipped = if skipped == 0 { String::new() } else { format!("; {skipped} of them skipped") };
        format!(
            "the analysis of the last window was not finished when the samples ended ({} filled{skipped}): send more \
             of them",
            counted(windows as usize, "window")
        )
    }
}

fn report_json(config: &Config<FAULTS>, report: &ReportMessage) -> Value {
    let faults = config.faults.iter().zip(report.faults.iter().zip(report.flags));
    let faults = faults.map(|(fault, ([value, error, evidence], [informative, alarmed]))| {
        let info = fault.free.parameter.info();
        json!({
            "name": info.name, "unit": info.unit, "value": number(f64::from(*value)),
            "standard_error": number(f64::from(*error)), "informative": informative,
            "evidence": number(f64::from(*evidence)), "alarmed": alarmed,
        })
    });
    let [window, first_tick, latency, steps, evaluations, reversals, skipped] = report.counts;
    let [rms, noise, offset] = report.residual.map(|pair| pair.map(|value| number(f64::from(value))));
    json!({
        "window": window, "first_tick": first_tick, "verdict": verdict_name(report),
        "faults": faults.collect::<Vec<_>>(),
        "residual_rms": {"lvdt_m": rms[0], "current_mA": rms[1]},
        "noise": {"lvdt_m": noise[0], "current_mA": noise[1]},
        "offset": {"lvdt_m": offset[0], "current_mA": offset[1]},
        "latency_samples": latency,
        "latency_s": number(f64::from(latency) * f64::from(config.sample_period)),
        "steps": steps, "evaluations": evaluations, "reversals": reversals, "skipped": skipped,
        "travel_m": number(f64::from(report.travel)), "excluded": exclusions_json(&report.exclusions),
    })
}

fn exclusions_json(counts: &[u32; 7]) -> Value {
    let [lost, out_of_order, bad_command, not_a_number, out_of_range, spikes, stuck] = counts;
    json!({
        "lost": lost, "out_of_order": out_of_order, "bad_command": bad_command, "not_a_number": not_a_number,
        "out_of_range": out_of_range, "spikes": spikes, "stuck": stuck,
    })
}

/// The configuration that a result was made with, resolved.
fn config_json(common: &Common, options: &Options, rig: &Rig) -> Value {
    let names: Vec<String> = options.record.iter().map(|path| path.display().to_string()).collect();
    let mut config = output::config_json(common, rig, &rig.faults, &names);
    config["watch"] = json!(options.watch);
    config["damage"] = json!(options.damage);
    config["simulated"] = if options.record.is_some() {
        Value::Null
    } else {
        json!({
            "command": options.command, "seconds": options.seconds, "set": options.set, "grow": options.grow,
        })
    };
    config
}

fn json_of(
    common: &Common,
    options: &Options,
    session: &Session,
    outcome: &Outcome,
    line: &str,
    rig: &Rig,
) -> Value {
    let status = match outcome.status {
        Some(FromMonitor::Status { received, monitor, exclusions, alarms }) => json!({
            "bytes": received[0], "frames": received[1], "damaged_frames": received[2],
            "samples": monitor[0], "windows": monitor[1], "skipped": monitor[2],
            "excluded": exclusions_json(&exclusions), "alarmed": alarmed(&session.config, alarms),
        }),
        _ => Value::Null,
    };
    let injected = outcome.injected;
    let reports: Vec<Value> =
        outcome.reports.iter().map(|report| report_json(&session.config, report)).collect();
    json!({
        "schema": output::SCHEMA,
        "line": line,
        "image": session.image().name(),
        "identical_to_host": outcome.is_identical,
        "reports": reports,
        "status": status,
        "sent": {
            "bytes": outcome.bytes, "lost": injected.lost, "damaged": injected.flipped,
            "repeated": injected.repeated, "reordered": injected.reordered,
        },
        "measures": outcome.log.as_ref().map(|log| &log.measures),
        "seed": common.seed,
        "config": config_json(common, options, rig),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reason_for_no_report_is_named() {
        assert_eq!(why_none(5000, [0, 0, 0]), "of 5000 samples none was received");
        let short = why_none(1200, [900, 0, 0]);
        assert!(short.starts_with("1200 samples sent, 900 samples received, and a window"), "{short}");
        let busy = why_none(2501, [2501, 2, 1]);
        assert!(busy.starts_with("the analysis of the last window was not finished"), "{busy}");
        assert!(busy.contains("2 windows filled; 1 of them skipped"), "{busy}");
    }
}
