//! A real-time health monitor for the electro-hydraulic actuators of flight controls: from commands and LVDT samples to the
//! backlash of the linkage and the dry friction of the jack, each with its standard error, and to an alarm.
//!
//! `no_std`, without allocation, `unsafe` or a reachable panic. One source runs as `f32` on a Cortex-M and as `f64` on a
//! host. It has no clock, no files and no global state: memory, time and seeds are the caller's.
//!
//! # Flow of data
//!
//! ```text
//! interrupt --> Sample --> SampleQueue --> Monitor::poll --> screen --> window of samples --> search --> Report
//!                                               ^            what no       of a second        in steps   verdict, faults with
//! Config: model, noise, faults -----------------+            sensor gave                                 errors, alarms
//! ```
//!
//! # Use
//!
//! ```
//! use eha_monitor::integrate::exact::Exact;
//! use eha_monitor::model::{Form, state::BASE_ORDER};
//! use eha_monitor::monitor::config::{Config, ConfigError, Fault};
//! use eha_monitor::monitor::{Monitor, queue::SampleQueue, report::Verdict, sample::Sample};
//! use eha_monitor::parameter::{Parameter, Parameters};
//! use eha_monitor::trial::SensorNoise;
//!
//! let config = Config {
//!     form: Form::default(),
//!     parameters: Parameters::default(),
//!     sample_period: 1e-3,
//!     holds_command: false,
//!     noise: SensorNoise { user: 5e-6, current: 0.02 },
//!     faults: [
//!         Fault::new(Parameter::Backlash, [0.0, 1.5e-3], 1e-4, 2e-4),
//!         Fault::new(Parameter::DryFriction, [200.0, 4000.0], 400.0, 600.0),
//!     ],
//!     false_alarm_rate: Config::<2>::FALSE_ALARM_RATE,
//!     seed: 1,
//!     steps_per_sample: 100,
//! };
//! // Statics on a board: windows of 1000 samples, two faults, a population of 20, matrices of four modes.
//! let mut queue = SampleQueue::<16>::new();
//! let mut monitor = Monitor::<Exact<f32, BASE_ORDER, 4>, 1000, 2, 20>::idle(Exact::new());
//!
//! monitor.configure(&config)?;
//! let (mut inlet, mut outlet) = queue.split();
//! for tick in 0..1100 {
//!     // In the interrupt, a thousand times a second: an actuator that is not asked to move.
//!     assert!(inlet.push(Sample { tick, command: 0.0, user: 0.0, current: 0.0 }));
//!     // In the background: at most 100 steps of the model, then back.
//!     if let Some(report) = monitor.poll(&mut outlet, 100).report {
//!         assert_eq!(report.verdict, Verdict::Uninformative);
//!     }
//! }
//! assert_eq!(monitor.counters().windows, 1);
//! # Ok::<(), ConfigError>(())
//! ```
//!
//! `docs/guide-firmware.md` of the repository goes on from here, `tests/integrator` is a whole firmware.
//!
//! # Where things are
//!
//! | to | see |
//! |---|---|
//! | watch an actuator, sample after sample | [`monitor`]; behind a serial line [`link`] |
//! | find faults in samples that are all there | [`fit::problem`], [`fit::identify`]; the search [`ga`] |
//! | describe an actuator | [`parameter`], [`model`]; what it may have besides [`effect`] |
//! | move it | [`command`], [`simulate`], [`integrate`]; with sensor noise [`trial`], [`random`] |
//! | name what is measured | [`channel`] |
//! | run on another scalar | [`scalar`] |
//!
//! # Features
//!
//! None is for a user of the library: `firmware` and those that imply it build the repository's own images, with their
//! start-up, log and critical sections.
#![no_std]
#![forbid(unsafe_code)]

pub mod channel;
pub mod command;
pub mod effect;
pub mod fit;
pub mod ga;
pub mod integrate;
pub mod link;
pub mod model;
pub mod monitor;
pub mod parameter;
pub mod random;
pub mod scalar;
pub mod simulate;
pub mod trial;

/// The guide's code, compiled and run with the documentation's examples.
#[cfg(doctest)]
#[doc = include_str!("../docs/guide-firmware.md")]
pub struct FirmwareGuide;
