//! The monitor behind a line.

use crate::flight::{Flight, Flown, HEALTHY, Steps, WINDOW, config};
use eha_monitor::link::frame::{Decoder, LONGEST, encode};
use eha_monitor::link::message::{FromMonitor, Refusal, Setup, ToMonitor};
use eha_monitor::link::station::Station;
use eha_monitor::monitor::config::{Config, ConfigError, Fault};
use eha_monitor::parameter::Parameter;

/// A station, and what it has said.
struct Line {
    station: Box<Station<Steps, WINDOW, 20>>,
    decoder: Decoder,
}

impl Line {
    fn send(&mut self, message: &ToMonitor) -> Vec<FromMonitor> {
        let mut frame = [0; LONGEST];
        let mut said = Vec::new();
        for &byte in encode(message, &mut frame).expect("a frame holds it") {
            self.station.receive(byte, &mut |bytes| {
                said.extend(bytes.iter().filter_map(|&byte| self.decoder.take::<FromMonitor>(byte)));
            });
        }
        said
    }

    fn set_up(&mut self, config: &Config<2>) -> Result<(), Refusal> {
        let said = self.send(&ToMonitor::Setup(Setup::of(config).expect("few changes")));
        match said[..] {
            [FromMonitor::Ready] => Ok(()),
            [FromMonitor::Refused(reason)] => Err(reason),
            _ => panic!("{said:?}"),
        }
    }
}

#[test]
fn a_setup_that_is_refused_leaves_the_monitor_at_work() {
    let mut line = Line { station: Box::new(Station::new(Steps::new())), decoder: Decoder::new() };
    let refused = |error| Err(Refusal::Config(error));
    let without_steps = Config { seed: 2, steps_per_sample: 0, ..config() };
    assert_eq!(line.set_up(&without_steps), refused(ConfigError::Steps), "it would never come to a report");
    assert_eq!(line.station.monitor().config(), None);
    assert_eq!(line.set_up(&Config { steps_per_sample: 1, ..config() }), Ok(()));
    assert_eq!(line.set_up(&config()), Ok(()));
    let mut gain = config();
    gain.faults[0] = Fault::new(Parameter::PressureGain, [1e10, 1e12], 2e10, 3e10);
    assert_eq!(line.set_up(&gain), refused(ConfigError::Reach(Parameter::PressureGain)));
    assert_eq!(line.set_up(&without_steps), refused(ConfigError::Steps));
    assert_eq!(line.station.monitor().config(), Some(&config()));
    let flown = Flown::new(51);
    let mut flight = Flight::new(|sample| flown.at(sample), 51);
    let mut reports = 0;
    for first in (0..2 * WINDOW as u32 + 200).step_by(10) {
        let samples = (0..10).map(|_| {
            let sample = flight.next(HEALTHY);
            [sample.command, sample.user, sample.current]
        });
        reports += line.send(&ToMonitor::Samples(first, samples.collect())).len();
    }
    assert_eq!(reports, 2);
}
