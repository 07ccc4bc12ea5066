//! The monitor behind a line.

use crate::flight::{Flight, Flown, HEALTHY, Steps, WINDOW, config};
use eha_monitor::link::frame::{Decoder, LONGEST, encode};
use eha_monitor::link::message::{FromMonitor, Setup, ToMonitor};
use eha_monitor::link::station::Station;
use eha_monitor::monitor::config::Config;

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

    fn set_up(&mut self, config: &Config<2>) -> bool {
        let setup = Setup::of(config).expect("few changes");
        let said = self.send(&ToMonitor::Setup(setup));
        assert!(matches!(said[..], [FromMonitor::Ready(_)]), "{said:?}");
        said[0] == FromMonitor::Ready(true)
    }
}

#[test]
fn a_setup_that_is_refused_leaves_the_monitor_at_work() {
    let mut line = Line { station: Box::new(Station::new(Steps::new())), decoder: Decoder::new() };
    assert!(!line.set_up(&Config { steps_per_sample: 0, ..config() }), "it would never come to a report");
    assert_eq!(line.station.monitor().config(), None);
    assert!(line.set_up(&Config { steps_per_sample: 1, ..config() }));
    assert!(line.set_up(&config()));
    assert!(!line.set_up(&Config { sample_period: 1.0, ..config() }));
    assert!(!line.set_up(&Config { seed: 2, steps_per_sample: 0, ..config() }));
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
