//! All tests of the host program from outside. They are one program: it is linked once, and a test that waits for one processor
//! leaves the other to the rest.

#[path = "../../../tests/common/mod.rs"]
mod common;

mod axis;
mod budget;
mod cli;
mod command_path;
mod confusion;
mod diagnose;
mod firmware;
mod hil;
mod intervals;
mod machine;
mod measured_data;
mod records;
mod steps;
