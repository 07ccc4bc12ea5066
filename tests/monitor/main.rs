//! The streaming monitor on actuators in flight.

mod bytes;
mod configuration;
mod detection;
mod flight;
mod pacing;
mod periods;
mod restart;
mod sensors;
mod starts;
mod station;
mod verdicts;
