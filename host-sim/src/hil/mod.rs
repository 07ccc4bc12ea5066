//! Hardware in the loop: samples over a line to the firmware's monitor, its reports back, and the same on this host.
//!
//! A station's answer is a function of the bytes that reach it. So the host runs the same station on the same bytes,
//! damage included, and both answers must be the same bytes.

pub mod damage;
pub mod line;
pub mod stream;

use crate::emulator::{Binary, BuildOptions, Machine, RunLog};
use crate::failure::Failure;
use crate::rig::{BUILT_IN, Rig};
use damage::{Damage, Injected};
use eha_monitor::integrate::Stepper;
use eha_monitor::link::frame::{Decoder, LONGEST, encode};
use eha_monitor::link::message::{
    FAULTS, FromMonitor, Refusal, ReportMessage, SAMPLES, Setup, ToMonitor, VERSION,
};
use eha_monitor::link::station::{POPULATION, PlainSteps, Station, WINDOW, any_steps};
use eha_monitor::monitor::config::{Config, ConfigError, Fault};
use eha_monitor::parameter::Parameter;
use eha_monitor::trial::SensorNoise;
use line::Line;
use std::cell::Cell;
use std::io::{Read, Write};
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};
use stream::{Growth, Simulated};

/// Modes whose transition matrices the host's monitor keeps; results do not depend on it.
const SLOTS: usize = 8;
/// Steps of the model that the monitor may take for each sample: an eighth of the processor at 480 MHz.
pub const STEPS_PER_SAMPLE: u32 = 100;
/// The images of the firmware's monitor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Image {
    /// For piecewise affine rigs of five states.
    Plain,
    /// For every rig.
    AnyRig,
}

impl Image {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Plain, Self::AnyRig];

    /// Its name in results.
    pub fn name(self) -> &'static str {
        self.feature().unwrap_or("plain")
    }

    /// The feature of `eha-monitor` that it is built with.
    pub const fn feature(self) -> Option<&'static str> {
        match self {
            Self::Plain => None,
            Self::AnyRig => Some("any-rig"),
        }
    }
}

/// What goes over the line.
#[derive(Clone, Debug)]
pub struct Session {
    /// What the monitor is told.
    pub config: Config<FAULTS>,
    /// Command, user position and current of each sample.
    pub samples: Vec<[f32; 3]>,
    /// Chance that a byte of the samples is damaged on its way.
    pub damage: f64,
    /// Seed of the damage.
    pub seed: u64,
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Reports of the firmware, as they came.
    pub reports: Vec<ReportMessage>,
    /// Its counters at the end; none where they did not come.
    pub status: Option<FromMonitor>,
    /// Reports of the same monitor on this host.
    pub twin: Vec<ReportMessage>,
    /// Did both answer the same bytes?
    pub is_identical: bool,
    /// Bytes that were sent.
    pub bytes: usize,
    /// What happened to them.
    pub injected: Injected,
    /// What the firmware measured, where it can.
    pub log: Option<RunLog>,
}

/// One piece of what is sent, and when it is due, in samples.
struct Piece {
    bytes: Vec<u8>,
    due: usize,
}

impl Session {
    /// The flight that the budgets of an image are measured on: the second window has grown faults, the third knows them.
    /// Where the image takes every rig, the spool meters by the square root of the pressure drop.
    ///
    /// # Errors
    /// None, unless the built-in rig is broken.
    pub fn reference(image: Image) -> Result<Self, Failure> {
        Self::growing(image, "mixed", 4.2)
    }

    /// A flight of the dearest command of the table, whose faults grow: a sine at which the valve is at its limit.
    ///
    /// # Errors
    /// None, unless the built-in rig is broken.
    pub fn saturated() -> Result<Self, Failure> {
        Self::growing(Image::Plain, "sine", 2.2)
    }

    /// A flight of a command for a time, s, in whose first second both faults grow.
    fn growing(image: Image, command: &str, seconds: f64) -> Result<Self, Failure> {
        let mut rig = Rig::load(BUILT_IN[0].name)?;
        if image == Image::AnyRig {
            rig.parameters.metering_blend = 1.0;
        }
        let faults = [
            Fault::new(Parameter::Backlash, [0.0, 1.5e-3], 1e-4, 2e-4),
            Fault::new(Parameter::DryFriction, [200.0, 4000.0], 400.0, 600.0),
        ];
        let noise = SensorNoise::<f32>::TYPICAL;
        let mut parameters = rig.parameters;
        for fault in &faults {
            parameters.set(fault.free.parameter, fault.healthy.into());
        }
        let growth = |parameter, value| Growth { parameter, value, start: 0.0 };
        let simulated = Simulated {
            form: rig.form,
            parameters,
            growths: vec![growth(Parameter::Backlash, 4e-4), growth(Parameter::DryFriction, 800.0)],
            command: command.to_owned(),
            seconds,
            sample_period: 1e-3,
            holds_command: false,
            noise: [noise.user.into(), noise.current.into()],
            seed: 1,
        };
        let config = Config {
            form: rig.form,
            parameters: rig.parameters.to_f32(),
            sample_period: 1e-3,
            holds_command: false,
            noise,
            faults,
            false_alarm_rate: Config::<FAULTS>::FALSE_ALARM_RATE,
            seed: 1,
            steps_per_sample: STEPS_PER_SAMPLE,
        };
        Ok(Self { config, samples: simulated.samples()?, damage: 0.0, seed: 1 })
    }

    /// Windows that its samples fill, the last one perhaps not.
    fn windows(&self) -> usize {
        self.samples.len().div_ceil(WINDOW)
    }

    /// How long a window is.
    fn window_duration(&self) -> Duration {
        Duration::from_secs_f32(WINDOW as f32 * self.config.sample_period)
    }

    /// Looks whether the firmware can work with the configuration.
    ///
    /// # Errors
    /// Usage: it is refused.
    pub fn check(&self) -> Result<(), Failure> {
        let refused = |error| Failure::usage(format!("the firmware's monitor refuses this: {error}"));
        self.config.check().map_err(refused)
    }

    /// The image of the firmware that its rig needs: the smallest.
    pub fn image(&self) -> Image {
        if self.config.suits(&PlainSteps::<1>::new()) { Image::Plain } else { Image::AnyRig }
    }

    /// How that image is built for an emulated board, with further features.
    pub fn build_options(&self, machine: Machine, features: &[&str]) -> BuildOptions {
        let all: Vec<&str> = self.image().feature().into_iter().chain(features.iter().copied()).collect();
        BuildOptions::for_machine(machine).with(Binary::Monitor, &all)
    }

    /// Everything that is sent, as it arrives, but for what [`idle`](Self::idle) adds.
    fn pieces(&self) -> Result<(Vec<Piece>, Injected), Failure> {
        let mut damage = Damage::new(self.damage, self.seed);
        let too_long =
            || Failure::usage("the rig changes more parameters than a message to the firmware holds");
        let frame_of = |message: &ToMonitor| frame_of(message).ok_or_else(too_long);
        let setup = Setup::of(&self.config).ok_or_else(too_long)?;
        let mut pieces = vec![Piece { bytes: frame_of(&ToMonitor::Setup(setup))?, due: 0 }];
        for (index, chunk) in self.samples.chunks(SAMPLES).enumerate() {
            let first = index * SAMPLES;
            let samples = chunk.iter().copied().collect();
            let frame = frame_of(&ToMonitor::Samples(first as u32, samples))?;
            pieces.push(Piece { bytes: damage.pass(&frame), due: first + chunk.len() });
        }
        // A zero first: whatever is left of a damaged frame ends there.
        let mut last = vec![0];
        last.extend(frame_of(&ToMonitor::Status)?);
        pieces.push(Piece { bytes: last, due: self.samples.len() });
        Ok((pieces, damage.injected()))
    }

    /// Samples of which the monitor sees nothing but their command, to work on while it waits: as many as still fit into the
    /// window that the last ones began. None where the line damages what is sent, so that the window may be any.
    fn idle(&self) -> Vec<Piece> {
        let sent = self.samples.len();
        let Some([command, ..]) = self.samples.last().filter(|_| self.damage == 0.0) else {
            return Vec::new();
        };
        let ticks: Vec<usize> = (sent..(sent / WINDOW + 1) * WINDOW - 1).collect();
        let piece = |ticks: &[usize]| {
            let samples = ticks.iter().map(|_| [*command, f32::NAN, f32::NAN]).collect();
            let bytes = frame_of(&ToMonitor::Samples(ticks[0] as u32, samples))?;
            Some(Piece { bytes, due: ticks[0] + ticks.len() })
        };
        ticks.chunks(SAMPLES).filter_map(piece).collect()
    }

    /// What a station on this host answers to the same bytes. Where the last window is not done with by then, idle samples
    /// are added to what is sent.
    fn answer_of_twin(&self, pieces: &mut Vec<Piece>) -> Vec<u8> {
        match self.image() {
            Image::Plain => self.answer_of(PlainSteps::<SLOTS>::new(), pieces),
            Image::AnyRig => self.answer_of(any_steps::<SLOTS>(), pieces),
        }
    }

    fn answer_of(&self, steps: impl Stepper<f32>, pieces: &mut Vec<Piece>) -> Vec<u8> {
        let mut station = Box::new(Station::<_, WINDOW, POPULATION>::new(steps));
        let mut answer = Vec::new();
        for piece in &*pieces {
            receive(&mut station, piece, &mut answer);
        }
        // A monitor keeps a sample back until it knows the next one: the last window may be full but for that.
        let mut is_kept_back = self.samples.len().is_multiple_of(WINDOW);
        for piece in self.idle() {
            let counters = station.monitor().counters();
            if counters.windows <= counters.skipped + messages(&answer).len() as u32 && !is_kept_back {
                break;
            }
            is_kept_back = false;
            receive(&mut station, &piece, &mut answer);
            pieces.push(piece);
        }
        answer
    }

    /// Sends everything over a line; `show` gets each report of the firmware as it comes.
    ///
    /// # Errors
    /// The rig is refused, or the line fails.
    pub fn run(&self, mut line: Line, mut show: impl FnMut(&ReportMessage)) -> Result<Outcome, Failure> {
        self.check()?;
        let (mut pieces, injected) = self.pieces()?;
        let expected = self.answer_of_twin(&mut pieces);
        let twin = messages(&expected);
        let (sender, receiver) = mpsc::channel::<Vec<u8>>();
        let mut reader = std::mem::replace(&mut line.reader, Box::new(std::io::empty()));
        let length = expected.len();
        let reading = thread::spawn(move || {
            let mut buffer = [0; 1024];
            let mut read = 0;
            // All that the twin said, and on until the other side closes or falls silent.
            while let Ok(count) = reader.read(&mut buffer)
                && count > 0
                && sender.send(buffer[..count].to_vec()).is_ok()
            {
                read += count;
                if read >= length {
                    break;
                }
            }
        });
        let (mut answer, mut decoder, mut reports, mut status) =
            (Vec::new(), Decoder::new(), Vec::new(), None);
        let refusal = Cell::new(None);
        let is_taken = || refusal.get().map_or(Ok(()), |reason| Err(refused(reason)));
        let mut hear = |bytes: Vec<u8>| {
            for &byte in &bytes {
                match decoder.take::<FromMonitor>(byte) {
                    Some(FromMonitor::Report(report)) => {
                        show(&report);
                        reports.push(report);
                    }
                    Some(message @ FromMonitor::Status { .. }) => status = Some(message),
                    Some(FromMonitor::Refused(reason)) => refusal.set(Some(reason)),
                    Some(FromMonitor::Ready) | None => {}
                }
            }
            answer.extend(bytes);
        };
        let start = Instant::now();
        let mut sent = 0;
        for Piece { bytes, due } in &pieces {
            if line.is_real_time {
                let time = Duration::from_secs_f32(*due as f32 * self.config.sample_period);
                thread::sleep(time.saturating_sub(start.elapsed()));
            }
            line.writer.write_all(bytes).map_err(Failure::other)?;
            sent += bytes.len();
            while let Ok(bytes) = receiver.try_recv() {
                hear(bytes);
            }
            is_taken()?;
        }
        line.writer.flush().map_err(Failure::other)?;
        for bytes in &receiver {
            hear(bytes);
        }
        // Its thread has dropped the sender.
        let _ = reading.join();
        if !line.is_real_time {
            let mut frame = [0; LONGEST];
            let end = encode(&ToMonitor::End, &mut frame).unwrap_or_default();
            line.writer.write_all(end).and_then(|()| line.writer.flush()).map_err(Failure::other)?;
        }
        let log = line.end()?;
        is_taken()?;
        let is_identical = answer == expected;
        Ok(Outcome { reports, status, twin, is_identical, bytes: sent, injected, log })
    }
}

/// What there is to say where the monitor at the other end does not take the rig.
fn refused(reason: Refusal) -> Failure {
    Failure::other(match reason {
        Refusal::Version(other) => format!(
            "the monitor at the other end speaks another version of the messages ({other:08x}, here {VERSION:08x}): build both \
             from the same source"
        ),
        Refusal::Unknown => "the monitor at the other end does not know the form of this rig or one of its parameters".to_owned(),
        Refusal::Config(ConfigError::Model) => {
            "the monitor at the other end does not take this rig: one that is not piecewise affine needs the image for every \
             rig (`any-rig`)"
                .to_owned()
        }
        Refusal::Config(error) => format!("the monitor at the other end does not take this rig: {error}"),
    })
}

/// A message as it goes over the line; none where a frame does not hold it.
fn frame_of(message: &ToMonitor) -> Option<Vec<u8>> {
    let mut frame = [0; LONGEST];
    encode(message, &mut frame).map(<[u8]>::to_vec)
}

/// What a station answers to a piece.
fn receive(
    station: &mut Station<impl Stepper<f32>, WINDOW, POPULATION>,
    piece: &Piece,
    answer: &mut Vec<u8>,
) {
    for &byte in &piece.bytes {
        station.receive(byte, &mut |bytes| answer.extend_from_slice(bytes));
    }
}

/// The reports in an answer.
fn messages(answer: &[u8]) -> Vec<ReportMessage> {
    let mut decoder = Decoder::new();
    let reports = answer.iter().filter_map(|&byte| match decoder.take::<FromMonitor>(byte) {
        Some(FromMonitor::Report(report)) => Some(report),
        _ => None,
    });
    reports.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The reports of the first samples of the reference flight, and how many idle samples were sent for them.
    fn reports_of(samples: usize, damage: f64) -> (usize, usize) {
        let mut session = Session { damage, ..Session::reference(Image::Plain).expect("a rig") };
        session.samples.truncate(samples);
        let (mut pieces, _) = session.pieces().expect("messages");
        let before = pieces.len();
        let answer = session.answer_of_twin(&mut pieces);
        (messages(&answer).len(), pieces.len() - before)
    }

    #[test]
    fn the_last_window_that_is_full_is_reported() {
        let (reports, idle) = reports_of(1001, 0.0);
        assert_eq!(reports, 1);
        assert!((1..100).contains(&idle), "{idle}");
        assert_eq!(reports_of(2000, 0.0).0, 2);
        // The controls: none that is full, none that is left, and a line of which nobody knows what comes through.
        assert_eq!(reports_of(999, 0.0), (0, 0));
        assert_eq!(reports_of(1900, 0.0), (1, 0));
        assert_eq!(reports_of(1001, 1e-12), (0, 0));
    }
}
