//! Host program around the `eha-monitor` core.
pub mod emulator;
pub mod record;
pub mod failure;
pub mod rig;
