//! Host program around the `eha-monitor` core.
pub mod record;
