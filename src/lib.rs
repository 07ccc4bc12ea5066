//! Embedded, fixed-step, real-time health monitor for electro-hydraulic flight-control actuators.
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
