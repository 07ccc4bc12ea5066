//! Commands that jump between two samples of their record.
//!
//! The record of a step shows after which sample it came, not how much. The model takes it to the end of that sample;
//! what half a millisecond does to the answer of an actuator is ten times the noise of a good sensor. The answer to a jump
//! that came a part of a sample earlier is, some ten milliseconds later, that part of the way to the answer to one that
//! came a whole sample earlier: the part is found by least squares, for each jump alone, and its share taken out.

use super::residual::MEASURED;
use crate::fit::{self, Prepared};
use crate::rig::Rig;
use std::iter;

/// Time after a jump for which the answer is no straight line in its time, s: it is not compared.
const BENT_S: f64 = 0.01;

/// Share of a record that may not be compared because its command jumps: one that goes in stairs is not of this kind.
const MOST: f64 = 0.25;

/// The records as they would be had each jump of their commands come at the end of its sample, as far as a model can
/// tell; none where no command jumps, or one does so all the time. Their commands are on a curve.
pub(super) fn at_their_samples(rig: &Rig, records: &[Prepared]) -> Option<Vec<Prepared>> {
    let jumps: Vec<Vec<usize>> = records.iter().map(Prepared::jumps).collect();
    let is_rare = |(jumps, record): (&Vec<usize>, &Prepared)| {
        jumps.len() as f64 * BENT_S <= MOST * record.len() as f64 * record.sample_period
    };
    if jumps.iter().all(Vec::is_empty) || !iter::zip(&jumps, records).all(is_rare) {
        return None;
    }
    let earlier: Vec<Prepared> = records.iter().map(Prepared::with_earlier_jumps).collect();
    let [here, earlier] = [records, &earlier].map(|records| fit::predict(rig, records));
    let moved = (0..records.len()).map(|index| {
        let (record, jumps) = (&records[index], &jumps[index]);
        let [here, earlier] = [&here[index], &earlier[index]];
        let bent = (BENT_S / record.sample_period) as usize;
        // The next jump, moved, is one sample earlier.
        let ends = jumps.iter().skip(1).map(|next| next - 1).chain([record.len()]);
        let mut by = vec![[0.0; MEASURED]; record.len()];
        for (&jump, end) in jumps.iter().zip(ends) {
            let answer = (jump + bent).min(end)..end;
            let (mut product, mut square) = (0.0, 0.0);
            for sample in answer.clone() {
                let [here, earlier] = [here, earlier].map(|outputs| outputs[sample].to_array());
                for channel in (0..MEASURED).filter(|&channel| record.noise[channel].is_finite()) {
                    let change = (earlier[channel] - here[channel]) / record.noise[channel];
                    let left = (record.measured(channel)[sample] - here[channel]) / record.noise[channel];
                    if left.is_finite() && record.is_compared(sample) {
                        product += left * change;
                        square += change * change;
                    }
                }
            }
            let part = if square > 0.0 { (product / square).clamp(0.0, 1.0) } else { 0.0 };
            for sample in answer {
                let [here, earlier] = [here, earlier].map(|outputs| outputs[sample].to_array());
                by[sample] = std::array::from_fn(|channel| part * (earlier[channel] - here[channel]));
            }
            by[jump - 1..(jump + bent).min(end)].fill([f64::NAN; MEASURED]);
        }
        record.moved(&by)
    });
    Some(moved.collect())
}
