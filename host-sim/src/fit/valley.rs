//! The valley around a fit that leaves noise: its bottom, and how far the records leave each value open.
//!
//! A standard error is the curvature at the bottom of a valley. Where a ram stops and starts, chi-square has many small
//! bottoms along a long valley, each far more curved than the valley is. The curvature of one tells nothing of how far the
//! records leave a value open, and a search that ends in the first that leaves noise may be far from the lowest.

use super::{BETTER_VALLEY, Estimate, OF_95, Polished, Prepared, polish};
use crate::interrupt;
use crate::rig::{Range, Rig};
use rayon::prelude::*;
use std::iter;

/// Rise of chi-square at the ends of an interval that holds the true value in 95 of 100 cases.
const RISE: f64 = 3.84;
/// Each place is further out than the one before by this factor, the first than the end of the interval of the curvature.
const FURTHER: f64 = 1.4;
/// Places in sequence that the records must speak against for the valley to have ended.
const CLOSED: usize = 3;
/// Most places on a side: the valley can be 80 times as wide as its curvature says.
const MOST_PLACES: usize = 13;
/// How often the distance between the last place that is open and the next is halved then.
const HALVED: usize = 2;
/// How often it is walked along its values from a bottom, and a lower place that this shows gone to.
const MOST_WALKS: usize = 5;

/// The valley around a fit that leaves noise.
#[derive(Clone)]
pub struct Valley {
    /// Its bottom.
    pub bottom: Polished,
    /// Evaluations of the model that this took.
    pub evaluations: u32,
    places: Vec<Place>,
}

/// A place in the valley.
#[derive(Clone)]
struct Place {
    /// All values there.
    values: Vec<f64>,
    chi_square: f64,
    /// Evaluations of the model that led there.
    evaluations: u32,
}

impl Valley {
    /// Walks from a fit along each of its first values, so many, and goes to where that leads down.
    pub fn around(rig: &Rig, ranges: &[Range], fit: &Polished, records: &[Prepared], values: usize) -> Self {
        let mut valley = Self { bottom: fit.clone(), evaluations: 0, places: Vec::new() };
        for _ in 0..MOST_WALKS {
            let fit = &valley.bottom;
            let walks = (0..values).flat_map(|index| [-1.0, 1.0].map(|side| (index, side)));
            let walks: Vec<_> =
                walks.map(|(index, side)| Walk { rig, ranges, fit, records, index, side }).collect();
            let seen: Vec<Place> = walks.par_iter().flat_map_iter(Walk::places).collect();
            let lowest = seen.iter().min_by(|a, b| a.chi_square.total_cmp(&b.chi_square));
            let lower = lowest
                .filter(|lowest| lowest.chi_square < fit.misfit.chi_square - BETTER_VALLEY)
                .and_then(|lowest| polish(rig, ranges, &lowest.values, records));
            let walked: u32 = seen.iter().map(|place| place.evaluations).sum();
            valley.evaluations += walked + lower.as_ref().map_or(0, |lower| lower.evaluations);
            let lower = lower.filter(|lower| lower.misfit.chi_square < fit.misfit.chi_square - BETTER_VALLEY);
            let (values, chi_square) = (fit.values.clone(), fit.misfit.chi_square);
            valley.places.push(Place { values, chi_square, evaluations: 0 });
            valley.places.extend(seen);
            let Some(lower) = lower else { break };
            valley.bottom = lower;
        }
        valley
    }

    /// Widens the intervals of the first values to hold every place that is not above the lowest by more than noise makes of
    /// it.
    pub fn widen(&self, estimates: &mut [Estimate]) {
        let bottom = self.bottom.misfit.chi_square;
        let least = self.places.iter().map(|place| place.chi_square).fold(bottom, f64::min);
        for place in self.places.iter().filter(|place| place.chi_square - least <= RISE) {
            for (estimate, &value) in iter::zip(&mut *estimates, &place.values) {
                let [low, high] = estimate.ci95;
                estimate.ci95 = [low.min(value), high.max(value)];
            }
        }
    }
}

/// The way from a fit along one of its values, to one side.
struct Walk<'a> {
    rig: &'a Rig,
    ranges: &'a [Range],
    fit: &'a Polished,
    records: &'a [Prepared],
    /// Which value.
    index: usize,
    side: f64,
}

impl Walk<'_> {
    /// Places on it outside the interval of the curvature, until the records speak against them.
    fn places(&self) -> Vec<Place> {
        let (range, value) = (self.ranges[self.index], self.fit.values[self.index]);
        let covariance = &self.fit.covariance[self.index];
        let mut slopes: Vec<f64> = covariance.iter().map(|shared| shared / covariance[self.index]).collect();
        let mut places = Vec::new();
        let mut least = self.fit.misfit.chi_square;
        // Offsets of the last place that is open and of the first behind it that is not.
        let (mut open, mut shut) = (None, 0.0);
        let mut closed = 0;
        let mut offset = self.side * OF_95 * self.fit.standard_error(self.index);
        while closed < CLOSED && places.len() < MOST_PLACES && !interrupt::requested() {
            offset *= FURTHER;
            if !(range.lower..=range.upper).contains(&(value + offset)) {
                break;
            }
            let place = self.place(offset, &slopes);
            least = least.min(place.chi_square);
            if place.chi_square - least > RISE {
                shut = if closed == 0 { offset } else { shut };
                closed += 1;
            } else {
                closed = 0;
                open = Some(offset);
                slopes = self.slopes_to(&place, offset);
            }
            places.push(place);
        }
        for _ in 0..HALVED {
            let Some(inside) = open.filter(|_| closed > 0 && !interrupt::requested()) else { break };
            let between = 0.5 * (inside + shut);
            let place = self.place(between, &slopes);
            if place.chi_square - least > RISE {
                shut = between;
            } else {
                open = Some(between);
            }
            places.push(place);
        }
        places
    }

    /// How much each value changes with this one on the way to a place.
    fn slopes_to(&self, place: &Place, offset: f64) -> Vec<f64> {
        iter::zip(&place.values, &self.fit.values).map(|(there, here)| (there - here) / offset).collect()
    }

    /// The lowest place where the value is off by so much; the others are looked for from where slopes lead.
    fn place(&self, offset: f64, slopes: &[f64]) -> Place {
        let start: Vec<f64> =
            iter::zip(&self.fit.values, slopes).map(|(value, slope)| value + slope * offset).collect();
        let mut rig = self.rig.clone();
        rig.parameters.set(self.ranges[self.index].parameter, start[self.index]);
        let others = |all: &[f64]| [&all[..self.index], &all[self.index + 1..]].concat();
        let ranges = [&self.ranges[..self.index], &self.ranges[self.index + 1..]].concat();
        let there = polish(&rig, &ranges, &others(&start), self.records);
        let chi_square = there.as_ref().map_or(f64::INFINITY, |there| there.misfit.chi_square);
        let evaluations = there.as_ref().map_or(0, |there| there.evaluations);
        let mut values = there.map_or_else(|| others(&start), |there| there.values);
        values.insert(self.index, start[self.index]);
        Place { values, chi_square, evaluations }
    }
}
