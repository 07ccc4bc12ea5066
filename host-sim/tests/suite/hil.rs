//! Hardware in the loop: the streaming monitor on both emulated boards and behind a serial port, against the same
//! monitor on this host.

use eha_monitor::integrate::Stepper;
use eha_monitor::link::frame::{Decoder, LONGEST, encode};
use eha_monitor::link::message::{FromMonitor, Refusal, ReportMessage, Setup, ToMonitor, VERSION};
use eha_monitor::link::station::{POPULATION, PlainSteps, Station, WINDOW, any_steps};
use eha_monitor::monitor::config::ConfigError;
use eha_monitor::monitor::report::Verdict;
use eha_monitor::parameter::Parameters;
use host_sim::emulator::Machine;
use host_sim::failure::Failure;
use host_sim::hil::line::Line;
use host_sim::hil::stream::Simulated;
use host_sim::hil::{Image, Outcome, Session};
use serde_json::Value;
use serialport::{SerialPort as _, TTYPort};
use std::io::{Read as _, Write as _};
use std::process::Command;
use std::thread;

/// Unwraps with the message for people, which says what to install.
fn expect<T>(result: Result<T, Failure>) -> T {
    result.unwrap_or_else(|failure| panic!("{failure}"))
}

fn on_board(session: &Session, machine: Machine) -> Outcome {
    let mut shown = 0;
    let outcome = expect(session.run(expect(Line::to_emulator(machine, &[], session)), |_| shown += 1));
    assert_eq!(shown, outcome.reports.len());
    outcome
}

fn verdicts(reports: &[ReportMessage]) -> Vec<Verdict> {
    reports.iter().map(|report| Verdict::ALL[usize::from(report.verdict)]).collect()
}

/// What the firmware counted: bytes, frames and damaged frames, then samples, windows and skipped windows.
fn counts(outcome: &Outcome) -> ([u32; 3], [u32; 3]) {
    match outcome.status {
        Some(FromMonitor::Status { received, monitor, .. }) => (received, monitor),
        other => panic!("no status: {other:?}"),
    }
}

#[test]
fn both_boards_give_the_bits_of_the_host() {
    let session = expect(Session::reference(Image::Plain));
    for machine in Machine::ALL {
        let outcome = on_board(&session, machine);
        assert!(outcome.is_identical, "{}", machine.name());
        assert_eq!(outcome.reports, outcome.twin);
        // A fault that grows within the first window, then is there.
        assert_eq!(
            verdicts(&outcome.reports)[1..],
            [Verdict::Fault; 3],
            "{}: {:?}",
            machine.name(),
            outcome.reports
        );
        assert!(outcome.reports[2].flags.iter().all(|[informative, alarmed]| *informative && *alarmed));
        let (received, monitor) = counts(&outcome);
        assert_eq!(received[2], 0);
        assert_eq!(monitor, [session.samples.len() as u32, 4, 0]);
    }
}

#[test]
fn damage_on_the_line_is_survived_and_counted() {
    let machine = Machine::Mps2An386;
    let session = Session { damage: 3e-4, seed: 3, ..expect(Session::reference(Image::Plain)) };
    let outcome = on_board(&session, machine);
    assert!(outcome.is_identical);
    let (received, monitor) = counts(&outcome);
    let injected = outcome.injected;
    assert!(injected.lost + injected.flipped + injected.repeated + injected.reordered >= 8, "{injected:?}");
    assert!(received[2] >= 6, "{received:?}");
    assert!((monitor[0] as usize) < session.samples.len(), "{monitor:?}");
    let good =
        outcome.reports.iter().filter(|report| Verdict::ALL[usize::from(report.verdict)] == Verdict::Fault);
    for report in good.clone() {
        for ([value, error, _], truth) in report.faults.iter().zip([4e-4, 800.0]) {
            assert!((value - truth).abs() < 5.0 * error, "{report:?}");
        }
    }
    assert!(good.count() >= 1, "{:?}", outcome.reports);
    // A line that passes next to nothing.
    let outcome = on_board(&Session { damage: 0.2, ..session }, machine);
    assert!(outcome.is_identical && counts(&outcome).0[2] > 100, "{:?}", outcome.status);
}

/// Samples of an actuator that has effects, sent to a monitor that is told of them and to one that is not.
fn with_and_without(lacking: &Parameters<f64>, image: Image, machine: Machine) {
    let reference = expect(Session::reference(Image::Plain));
    let simulated = Simulated {
        form: reference.config.form,
        parameters: Parameters { bkl: 1e-4, fdj: 400.0, ..*lacking },
        growths: Vec::new(),
        command: "mixed".to_owned(),
        seconds: 2.3,
        sample_period: 1e-3,
        holds_command: false,
        noise: [5e-6, 0.02],
        seed: 5,
    };
    let bare = Session { samples: expect(simulated.samples()), ..reference };
    let mut augmented = bare.clone();
    augmented.config.parameters = lacking.to_f32();
    assert_eq!(augmented.image(), image);
    let told = on_board(&augmented, machine);
    assert!(told.is_identical);
    assert_eq!(verdicts(&told.reports), [Verdict::Healthy; 2], "{:?}", told.reports);
    for report in &told.reports {
        for ([value, error, _], truth) in report.faults.iter().zip([1e-4, 400.0]) {
            assert!((value - truth).abs() < 4.0 * error && *error < 0.05 * truth, "{report:?}");
        }
    }
    // The control: without the effect the same samples are no healthy actuator.
    assert_eq!(bare.image(), Image::Plain);
    let untold = on_board(&bare, machine);
    assert!(untold.is_identical);
    assert!(!verdicts(&untold.reports).contains(&Verdict::Healthy), "{:?}", untold.reports);
}

#[test]
fn a_rig_with_an_added_effect_is_sent_the_same_way() {
    let plain = Parameters { spool_overlap: 1.5e-5, constant_load: 300.0, ..Parameters::default() };
    with_and_without(&plain, Image::Plain, Machine::Mps2An500);
}

#[test]
fn a_rig_whose_laws_are_not_affine_is_sent_the_same_way() {
    // What a high-fidelity actuator shows the model to lack.
    let metering = Parameters { metering_blend: 1.0, ..Parameters::default() };
    for machine in Machine::ALL {
        with_and_without(&metering, Image::AnyRig, machine);
    }
    let many = Parameters {
        torque_motor_hysteresis: 0.1,
        supply_sag: 0.5,
        stribeck_velocity: 0.01,
        ..Parameters::default()
    };
    with_and_without(&many, Image::AnyRig, Machine::Mps2An386);
}

#[test]
fn a_station_says_whether_it_takes_the_rig() {
    fn answer(steps: impl Stepper<f32>, session: &Session, version: u32) -> FromMonitor {
        let setup = Setup { version, ..Setup::of(&session.config).expect("a message") };
        let mut frame = [0; LONGEST];
        let bytes = encode(&ToMonitor::Setup(setup), &mut frame).expect("a frame");
        let mut station = Box::new(Station::<_, WINDOW, POPULATION>::new(steps));
        let (mut decoder, mut said) = (Decoder::new(), None);
        for &byte in bytes {
            station.receive(byte, &mut |answer| {
                said = answer.iter().fold(said, |said, &byte| decoder.take(byte).or(said));
            });
        }
        said.expect("an answer")
    }
    let [plain, metering] = Image::ALL.map(|image| expect(Session::reference(image)));
    let refused = FromMonitor::Refused;
    assert_eq!(answer(PlainSteps::<4>::new(), &plain, VERSION), FromMonitor::Ready);
    let no_steps = refused(Refusal::Config(ConfigError::Model));
    assert_eq!(answer(PlainSteps::<4>::new(), &metering, VERSION), no_steps);
    assert_eq!(answer(any_steps::<4>(), &plain, VERSION), FromMonitor::Ready);
    assert_eq!(answer(any_steps::<4>(), &metering, VERSION), FromMonitor::Ready);
    // Another table of parameters is another version.
    assert_eq!(answer(any_steps::<4>(), &plain, VERSION ^ 1), refused(Refusal::Version(VERSION)));
}

#[test]
fn a_command_that_is_held_is_sent_the_same_way() {
    let reference = expect(Session::reference(Image::Plain));
    let simulated = Simulated {
        form: reference.config.form,
        parameters: Parameters { bkl: 1e-4, fdj: 400.0, ..Parameters::default() },
        growths: Vec::new(),
        command: "mixed".to_owned(),
        seconds: 2.6,
        sample_period: 1e-3,
        holds_command: true,
        noise: [5e-6, 0.02],
        seed: 5,
    };
    let mut session = Session { samples: expect(simulated.samples()), ..reference };
    session.config.holds_command = true;
    let held = on_board(&session, Machine::Mps2An500);
    assert!(held.is_identical);
    assert_eq!(verdicts(&held.reports), [Verdict::Healthy; 2], "{:?}", held.reports);
    // The control: joined by straight lines, the same samples are no healthy actuator.
    session.config.holds_command = false;
    let joined = on_board(&session, Machine::Mps2An386);
    assert!(joined.is_identical);
    assert!(!verdicts(&joined.reports).contains(&Verdict::Healthy), "{:?}", joined.reports);
}

/// A board behind a real serial port: here the other end of a pseudo-terminal.
#[test]
fn a_serial_port_is_served_in_real_time() {
    let (mut board, port) = TTYPort::pair().expect("a pseudo-terminal");
    let name = port.name().expect("its name");
    board.set_timeout(std::time::Duration::from_secs(4)).expect("a time limit");
    let station = thread::spawn(move || {
        let mut station = Box::new(Station::<_, WINDOW, POPULATION>::new(PlainSteps::<8>::new()));
        let mut buffer = [0; 256];
        while let Ok(count) = board.read(&mut buffer) {
            for &byte in &buffer[..count] {
                let mut answer = Vec::new();
                station.receive(byte, &mut |bytes| answer.extend_from_slice(bytes));
                if board.write_all(&answer).is_err() {
                    return;
                }
            }
        }
    });
    let mut session = expect(Session::reference(Image::Plain));
    session.samples.truncate(1800);
    let outcome = expect(session.run(expect(Line::to_port(name.as_ref(), 921_600, &session)), |_| {}));
    assert!(outcome.is_identical, "{:?}", outcome.reports);
    assert_eq!(outcome.reports.len(), 1);
    drop(port);
    station.join().expect("a station that ends");
}

#[test]
fn the_verb_prints_one_object() {
    let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
        .args([
            "hil",
            "--json",
            "--quiet",
            "--seconds",
            "3.3",
            "--grow",
            "fdj=700@0.5",
            "--machine",
            "mps2-an386",
        ])
        .output()
        .expect("the program runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let result: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(result["identical_to_host"], true);
    assert_eq!(result["image"], "plain");
    let reports = result["reports"].as_array().expect("a list");
    assert_eq!(reports.len(), 3);
    assert_eq!(reports[2]["verdict"], "fault");
    assert_eq!(reports[2]["faults"][1]["name"], "fdj");
    assert!(reports[2]["latency_s"].as_f64().is_some_and(|latency| latency < 1.0));
}

#[test]
fn wrong_options_are_refused() {
    for (arguments, message) in [
        (["--watch", "bkl=1e-4"], "expected NAME=HEALTHY..ALARM"),
        (["--damage", "2"], "expected 0 to 1"),
        (["--grow", "bkl=1e-3"], "expected NAME=VALUE@SECONDS"),
        (["--command", "mixd"], "did you mean `mixed`"),
        (["--set", "fdj=1e9"], "`fdj` = 1e9: expected 0 to"),
        (["--grow", "bkl=-1@2"], "`bkl` = -1: expected 0 to"),
        (["--watch", "pressure_gain=1e11..2e11"], "give --watch twice"),
        (["--rig", "force-axis"], "the model is driven by a force"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_host-sim"))
            .arg("hil")
            .args(arguments)
            .output()
            .expect("it runs");
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert!(stderr.contains(message), "{stderr}");
    }
}
