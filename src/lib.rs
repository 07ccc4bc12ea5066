//! Embedded, fixed-step, real-time health monitor for electro-hydraulic flight-control actuators.
#![no_std]
#![forbid(unsafe_code)]

pub mod channel;
