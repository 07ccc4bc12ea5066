//! A monitor that lives behind a line.

use super::frame::{Decoder, LONGEST, Received, encode};
use super::message::{self, FAULTS, FromMonitor, Refusal, ReportMessage, Setup, ToMonitor};
use crate::integrate::Stepper;
use crate::integrate::collocation::Collocation;
use crate::integrate::exact::Exact;
use crate::model::state::{BASE_ORDER, FULL_ORDER};
use crate::monitor::Monitor;
use crate::monitor::report::Report;
use crate::monitor::sample::Sample;
use heapless::Vec;

/// Samples in a window of the firmware's monitor, and of the host's twin of it: 1 s at 1 kHz.
pub const WINDOW: usize = 1000;
/// Members of the population of both.
pub const POPULATION: usize = 20;

/// Steps for most rigs: piecewise affine models of five states.
pub type PlainSteps<const SLOTS: usize> = Exact<f32, BASE_ORDER, SLOTS>;

/// Steps for every rig: its matrices take four times the memory.
pub type AnySteps<const SLOTS: usize> = Collocation<f32, FULL_ORDER, SLOTS>;

/// Steps for every rig, each of which may move the ram by as little in error as single precision tells apart: all zeros.
pub const fn any_steps<const SLOTS: usize>() -> AnySteps<SLOTS> {
    Collocation::new(0.0)
}

/// A monitor and its end of the line.
#[derive(Debug)]
pub struct Station<S, const SAMPLES: usize, const POPULATION: usize> {
    monitor: Monitor<S, SAMPLES, FAULTS, POPULATION>,
    decoder: Decoder,
}

/// What is to be done once a frame has ended.
enum Next {
    /// To wait for another message.
    Message,
    /// To work on samples: the tick of the first, and command, m, user position, m, and current, mA, of each.
    Samples(u32, Vec<[f32; 3], { message::SAMPLES }>),
    /// To end the run.
    End,
}

impl<S: Stepper<f32>, const SAMPLES: usize, const POPULATION: usize> Station<S, SAMPLES, POPULATION> {
    /// A station that waits for its configuration.
    pub const fn new(stepper: S) -> Self {
        Self { monitor: Monitor::idle(stepper), decoder: Decoder::new() }
    }

    /// Takes a byte from the line, works, and sends what there is to say. False where the other side has ended the run.
    pub fn receive(&mut self, byte: u8, send: &mut impl FnMut(&[u8])) -> bool {
        if !self.decoder.is_end(byte) {
            return true;
        }
        let (first, samples) = match self.answer(send) {
            Next::Samples(first, samples) => (first, samples),
            Next::Message => return true,
            Next::End => return false,
        };
        let steps = self.monitor.config().map_or(0, |config| config.steps_per_sample);
        let mut tick = first;
        for &[command, user, current] in &samples {
            self.monitor.take(&Sample { tick, command, user, current });
            tick = tick.wrapping_add(1);
            let (_, report) = self.monitor.work(steps);
            if let Some(report) = report {
                say(&report, send);
            }
        }
        true
    }

    /// Answers the message of a frame that has ended, but for samples: those are to be worked on. Not inlined: a message
    /// would lie on the stack below the whole simulation.
    #[inline(never)]
    fn answer(&mut self, send: &mut impl FnMut(&[u8])) -> Next {
        let Some(message) = self.decoder.message() else { return Next::Message };
        match message {
            ToMonitor::Setup(setup) => {
                let refusal = self.set_up(&setup).err();
                reply(&refusal.map_or(FromMonitor::Ready, FromMonitor::Refused), send);
            }
            ToMonitor::Samples(first, samples) => return Next::Samples(first, samples),
            ToMonitor::Status => reply(&self.status(), send),
            ToMonitor::End => return Next::End,
        }
        Next::Message
    }

    /// Configures the monitor. Not inlined: its stack is not needed later.
    #[inline(never)]
    fn set_up(&mut self, setup: &Setup) -> Result<(), Refusal> {
        self.monitor.configure(&setup.config()?).map_err(Refusal::Config)
    }

    /// What has come and what came of it.
    #[inline(never)]
    fn status(&self) -> FromMonitor {
        let Received { bytes, frames, damaged } = self.decoder.received();
        let counters = self.monitor.counters();
        FromMonitor::Status {
            received: [bytes, frames, damaged],
            monitor: [counters.samples, counters.windows, counters.skipped],
            exclusions: counters.exclusions.fields().map(|&count| count),
            alarms: self.monitor.alarms(),
        }
    }

    /// The monitor.
    pub const fn monitor(&self) -> &Monitor<S, SAMPLES, FAULTS, POPULATION> {
        &self.monitor
    }

    /// The monitor, to save its state or to restore it.
    pub const fn monitor_mut(&mut self) -> &mut Monitor<S, SAMPLES, FAULTS, POPULATION> {
        &mut self.monitor
    }
}

/// Sends a report.
#[inline(never)]
fn say(report: &Report<FAULTS>, send: &mut impl FnMut(&[u8])) {
    reply(&FromMonitor::Report(ReportMessage::of(report)), send);
}

/// Sends a message. Not inlined: its frame is not needed before.
#[inline(never)]
fn reply(message: &FromMonitor, send: &mut impl FnMut(&[u8])) {
    let mut frame = [0; LONGEST];
    if let Some(bytes) = encode(message, &mut frame) {
        send(bytes);
    }
}
