//! `calibrate`: the free parameters of a rig from records.

use super::{FitOptions, converged, fit_records, identify, log_no_rig};
use crate::cli::Common;
use crate::failure::Failure;
use crate::output;
use crate::report::REPORT_FILE;
use crate::rig;

/// Rig that is calibrated unless the user names one.
const DEFAULT_RIG: &str = "servo-hydraulic";

/// Names of the result and of the rig in the directory of `--out`.
const RESULT_FILE: &str = "calibrate.json";
const RIG_FILE: &str = "rig.toml";

/// Options of `calibrate`.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    fit: FitOptions,
}

/// Runs the verb.
///
/// # Errors
/// Usage, bad data, or no convergence; with the latter, or interrupted, no rig is written.
pub fn run(common: &Common, options: &Options) -> Result<(), Failure> {
    let writes = [RESULT_FILE, REPORT_FILE, RIG_FILE];
    let fitted = fit_records(common, &options.fit, DEFAULT_RIG, &writes, |rig| rig.free.clone())?;
    let result = identify::json(common, &fitted, "parameters");
    let saved = identify::save(common, &fitted, &result, RESULT_FILE, "Calibration");
    if common.json {
        output::print_json(&result)?;
    } else {
        identify::print(common, &fitted)?;
    }
    saved?;
    converged(&fitted).inspect_err(|_| log_no_rig(common, RIG_FILE))?;
    output::save(common, RIG_FILE, || {
        let calibrated = fitted.fit.calibrated(&fitted.rig);
        let comments = [
            format!("calibrated on {} by host-sim {}", fitted.names.join(", "), env!("CARGO_PKG_VERSION")),
            format!(
                "residual {} rms, seed {}",
                output::quantity(fitted.fit.position_rms(), "m"),
                common.seed
            ),
        ];
        Ok(rig::write(&calibrated, &comments))
    })
}
