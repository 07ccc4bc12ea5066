//! The streaming monitor behind the serial line of an emulated board (`mps2-an500`, `mps2-an386`).
//!
//! All logic is in the library ([`Station`](eha_monitor::link::station::Station)): this binary moves bytes. At the end of
//! the run it reports what a window cost and how deep the stack was. On a host it says what it is for and ends.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
#[path = "firmware-monitor/mcu.rs"]
mod mcu;

#[cfg(not(target_os = "none"))]
fn main() {
    eprintln!("this is an image for a microcontroller: run `host-sim hil`");
}
