//! Host program around the `eha-monitor` core.
pub mod emulator;
pub mod failure;
pub mod record;
pub mod rig;
