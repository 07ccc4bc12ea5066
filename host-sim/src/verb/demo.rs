//! `demo`: the main job on an embedded example.

use crate::cli::Common;
use crate::failure::Failure;

/// Options of `demo`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {}

/// Runs the verb.
///
/// # Errors
/// Stdout cannot be written.
pub fn run(common: &Common, _: &Options) -> Result<(), Failure> {
    let _ = common;
    Ok(())
}
