//! The most likely values where a sensor is read in steps.
//!
//! Least squares takes what is rounded away for noise. Where the noise of the sensor itself does not hide the steps, rounding
//! errs by the same wherever the motion comes by, and most of all where it rests or turns, which is where backlash and friction
//! show: no number of samples averages that out. The likelihood of the readings knows better. Scoring (Fisher 1925) leads to
//! where it is largest.

mod likelihood;

use super::noise::{MODEL_ERROR, SMALLEST_NOISE, present, residual_series};
use super::{Polished, Prepared, misfit, predict};
use crate::rig::{Range, Rig};
use eha_monitor::fit::problem::MEASURED;
use likelihood::{Score, Sensor};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::iter;

/// Width of the difference that shows what a value changes, in its standard errors.
const DIFFERENCE: f64 = 0.3;
/// Most steps to the largest likelihood, and the rise of twice its logarithm that is not worth one.
const STEPS: usize = 8;
const WORTH_A_STEP: f64 = 0.02;
/// How often a step that leads down is halved.
const HALVED: usize = 4;

/// A fit of records that leaves noise, at the most likely values. None where least squares gives these: where no channel is read
/// in steps, or noise leaves less of their error than is believed of a channel; and where noise is coloured, an offset unknown,
/// or values trade off without end.
pub fn most_likely(rig: &Rig, ranges: &[Range], fit: &Polished, records: &[Prepared]) -> Option<Polished> {
    let shows_steps = |record: &Prepared| {
        iter::zip(record.steps, SMALLEST_NOISE)
            .any(|(steps, smallest)| steps.is_some_and(|steps| steps.error > smallest))
    };
    let is_white = |record: &Prepared| record.colour == [0.0; MEASURED] && !record.offset_unknown();
    let is_rounded = records.iter().any(shows_steps) && records.iter().all(is_white);
    is_rounded.then(|| Search { rig, ranges, fit, records }.most_likely()).flatten()
}

/// The way from a fit to the most likely values.
struct Search<'a> {
    rig: &'a Rig,
    ranges: &'a [Range],
    fit: &'a Polished,
    records: &'a [Prepared],
}

/// A place on it.
struct Place {
    values: Vec<f64>,
    /// What is read minus what is predicted, for each channel of each record; without missing samples.
    off: Vec<Vec<f64>>,
    /// Their sensors, with their most likely noise.
    sensors: Vec<Sensor>,
    /// Logarithm of the likelihood.
    likelihood: f64,
}

impl Search<'_> {
    /// None where values trade off without end.
    fn most_likely(&self) -> Option<Polished> {
        let mut here = self.place(self.fit.values.clone());
        let mut covariance = None;
        for _ in 0..STEPS {
            let (gradient, information) = self.scored(&here);
            let shared = information.try_inverse()?;
            let step = &shared * &gradient;
            covariance = Some(shared);
            if gradient.dot(&step) < WORTH_A_STEP {
                break;
            }
            let shares = iter::successors(Some(1.0), |share| Some(0.5 * share)).take(1 + HALVED);
            let higher = shares
                .map(|share| self.place(self.moved(&here.values, &(share * &step))))
                .find(|there| there.likelihood > here.likelihood);
            let Some(higher) = higher else { break };
            here = higher;
        }
        let covariance = covariance?;
        let of_two = |row: usize, column: usize| {
            let are_told = self.is_told(row) && self.is_told(column);
            if are_told { covariance[(row, column)] } else { self.fit.covariance[row][column] }
        };
        let count = self.ranges.len();
        Some(Polished {
            misfit: misfit(self.rig, self.ranges, &here.values, self.records),
            covariance: (0..count)
                .map(|row| (0..count).map(|column| of_two(row, column)).collect())
                .collect(),
            values: here.values,
            evaluations: self.fit.evaluations,
        })
    }

    /// Do the records say anything of a value?
    fn is_told(&self, index: usize) -> bool {
        self.fit.standard_error(index).is_finite()
    }

    /// Some values after a step, inside their ranges.
    fn moved(&self, values: &[f64], step: &DVector<f64>) -> Vec<f64> {
        let moved = iter::zip(values, step.iter()).map(|(value, step)| value + step);
        iter::zip(moved, self.ranges).map(|(value, range)| value.clamp(range.lower, range.upper)).collect()
    }

    /// What is read minus what values predict, for each channel of each record.
    fn off(&self, values: &[f64]) -> Vec<Vec<f64>> {
        let predictions = predict(&self.rig.with_values(self.ranges, values), self.records);
        let series: Vec<_> = self.records.iter().map(Prepared::as_core).collect();
        let of_channel = |channel| residual_series(&series, &predictions, channel);
        (0..MEASURED).flat_map(of_channel).map(|off| present(&off)).collect()
    }

    fn place(&self, values: Vec<f64>) -> Place {
        let off = self.off(&values);
        let channels =
            (0..MEASURED).flat_map(|channel| self.records.iter().map(move |record| (record, channel)));
        let sensor = |((record, channel), off): ((&Prepared, usize), &Vec<f64>)| {
            let noise = record.noise[channel];
            record.steps[channel].map_or(Sensor::without_steps(noise), |steps| {
                Sensor::of_steps(steps.step, off, MODEL_ERROR[channel])
            })
        };
        let sensors: Vec<Sensor> = channels.zip(&off).map(sensor).collect();
        let likelihood = iter::zip(&sensors, &off).map(|(sensor, off)| sensor.likelihood(off)).sum();
        Place { values, off, sensors, likelihood }
    }

    /// Slope of the logarithm of the likelihood along the values, and its curvature there: what the records tell of them. A
    /// value of which they say nothing is told to stay.
    fn scored(&self, here: &Place) -> (DVector<f64>, DMatrix<f64>) {
        let count = self.ranges.len();
        let slopes: Vec<Vec<f64>> = (0..count).into_par_iter().map(|index| self.slope(here, index)).collect();
        let scored = iter::zip(&here.sensors, &here.off);
        let scores: Vec<Score> = scored.flat_map(|(sensor, off)| sensor.scores(off)).collect();
        let along = |slope: &Vec<f64>| -> f64 {
            iter::zip(slope, &scores).map(|(slope, score)| slope * score.slope).sum()
        };
        let told = |row: usize, column: usize| -> f64 {
            let both = iter::zip(&slopes[row], &slopes[column]);
            both.zip(&scores).map(|((row, column), score)| row * column * score.told).sum()
        };
        let gradient = DVector::from_iterator(count, slopes.iter().map(along));
        let mut information = DMatrix::from_fn(count, count, told);
        for index in (0..count).filter(|&index| !self.is_told(index)) {
            information[(index, index)] = 1.0;
        }
        (gradient, information)
    }

    /// What a value changes in the predictions, sample after sample; nothing where the records do not tell of it.
    fn slope(&self, here: &Place, index: usize) -> Vec<f64> {
        let here_off = here.off.iter().flatten();
        if !self.is_told(index) {
            return here_off.map(|_| 0.0).collect();
        }
        let width = DIFFERENCE * self.fit.standard_error(index);
        let width = self.ranges[index].inward(here.values[index], width);
        let mut values = here.values.clone();
        values[index] += width;
        let off = self.off(&values);
        iter::zip(here_off, off.iter().flatten()).map(|(here, there)| (here - there) / width).collect()
    }
}
