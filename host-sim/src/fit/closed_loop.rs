//! How well a model reproduces an axis whose controller is known: the force that the controller asks for, in closed
//! loop, and the position in open loop over windows that start anew.

use super::{Prepared, predict, prepare, residual_series, rms};
use crate::record::Record;
use crate::rig::Rig;
use eha_monitor::model::state::Outputs;

/// The two errors of a model on records.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoopScore {
    /// Root mean square of simulated minus recorded drive over that of the recorded drive, in closed loop.
    pub force_error: f64,
    /// Root mean square of the position's error over the rig's windows in open loop, m; none where the rig has none.
    pub open_loop_rms: Option<f64>,
}

/// The errors of a rig on records; none where its controller is not known or no record has the drive.
pub fn loop_score(rig: &Rig, records: &[Record]) -> Option<LoopScore> {
    rig.controller?;
    let prepare_all = |rig: &Rig| records.iter().map(|record| prepare(rig, record)).collect::<Vec<_>>();
    let closed = prepare_all(rig);
    let force_error = force_error(&closed, &predict(rig, &closed))?;
    let open_loop_rms = rig.restart_s.map(|_| {
        let rig = rig.opened();
        let open = prepare_all(&rig);
        let cores: Vec<_> = open.iter().map(Prepared::as_core).collect();
        rms(residual_series(&cores, &predict(&rig, &open), 0).into_iter().flatten())
    });
    Some(LoopScore { force_error, open_loop_rms })
}

/// Root mean square of simulated minus recorded drive over that of the recorded drive, over the samples that are compared of
/// records in closed loop; none where a record is not in one, or has no drive.
pub fn force_error(records: &[Prepared], predictions: &[Vec<Outputs<f64>>]) -> Option<f64> {
    let (mut error, mut power) = (0.0, 0.0);
    for (record, outputs) in records.iter().zip(predictions) {
        let law = record.law()?;
        for sample in (2..outputs.len()).filter(|&sample| record.is_compared(sample)) {
            let Some(measured) = record.drive().get(sample) else { continue };
            let command = record.command()[sample];
            let rate = 1.0 / record.sample_period;
            let force = law.force(command, outputs[sample].ram, outputs[sample - 2].ram, rate);
            error += (force - measured) * (force - measured);
            power += measured * measured;
        }
    }
    (power > 0.0).then(|| (error / power).sqrt())
}
