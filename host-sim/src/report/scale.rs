//! Axes: from a quantity to its place, ticks at round numbers, units that read well.

use crate::fit::Estimate;
use crate::output::{in_digits_of, quantity};

/// How values are spread along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scale {
    /// Evenly.
    Linear,
    /// By their logarithm.
    Log,
}

/// An axis of a plot. Data are given in the unit of the quantity; the axis shows them in one that reads well.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    /// Quantity with the unit that is shown.
    pub(super) title: String,
    /// Shown unit per unit of the quantity.
    factor: f64,
    scale: Scale,
    /// Ends, in the unit that is shown.
    low: f64,
    high: f64,
}

/// The unit in which a quantity of this size is shown, and how many of it make one of the quantity's own.
pub(super) fn shown_unit(unit: &str, largest: f64) -> (f64, &str) {
    match unit {
        "m" if largest >= 1e-3 => (1e3, "mm"),
        "m" => (1e6, "µm"),
        "Pa" if largest >= 1e5 => (1e-6, "MPa"),
        "Pa" => (1e-3, "kPa"),
        "N" if largest >= 2e4 => (1e-3, "kN"),
        "m/√Hz" => (1e6, "µm/√Hz"),
        "1" => (1.0, ""),
        other => (1.0, other),
    }
}

/// What is seen to both sides of a constant 0, in a unit.
fn least_margin(unit: &str) -> f64 {
    match unit {
        "m" => 1e-6,
        "Pa" => 1e3,
        _ => 0.1,
    }
}

/// A quantity in words, as the tables of the terminal have it, in the typography of a page.
pub(super) fn shown(value: f64, unit: &str) -> String {
    typeset(&quantity(value, unit))
}

/// Values of an estimate's parameter likewise, with as many digits as its standard error asks for.
pub(super) fn shown_by(estimate: &Estimate) -> impl Fn(f64) -> String {
    let words = in_digits_of(estimate);
    move |value| typeset(&words(value))
}

fn typeset(words: &str) -> String {
    words.replace(" um", " µm").replace('-', "−")
}

impl Axis {
    /// An evenly spread axis around values; those that are not finite do not count.
    pub(super) fn around(name: &str, unit: &str, values: impl Iterator<Item = f64>) -> Self {
        let (low, high) = extent(values);
        let size = low.abs().max(high.abs());
        // Digits that are lost to rounding are no motion.
        let is_constant = high - low <= 1e-9 * size;
        let margin = if is_constant { (0.05 * size).max(least_margin(unit)) } else { 0.05 * (high - low) };
        Self::between(name, unit, low - margin, high + margin)
    }

    /// An evenly spread axis from 0 to a little beyond the largest value.
    pub(super) fn from_zero(name: &str, unit: &str, values: impl Iterator<Item = f64>) -> Self {
        let (_, high) = extent(values);
        Self::between(name, unit, 0.0, if high > 0.0 { 1.08 * high } else { 1.0 })
    }

    /// An evenly spread axis with given ends, in the unit of the quantity.
    pub(super) fn between(name: &str, unit: &str, low: f64, high: f64) -> Self {
        let (factor, shown) = shown_unit(unit, low.abs().max(high.abs()));
        Self {
            title: title(name, shown),
            factor,
            scale: Scale::Linear,
            low: low * factor,
            high: high * factor,
        }
    }

    /// A logarithmic axis around values; those that are not positive do not count. Spans a decade at least.
    pub(super) fn decades(name: &str, unit: &str, values: impl Iterator<Item = f64>) -> Self {
        let (low, high) = extent(values.filter(|value| *value > 0.0));
        let (low, high) = if low > 0.0 { (low, high) } else { (0.1, 1.0) };
        let (factor, shown) = shown_unit(unit, high);
        let (low, high) = (low * factor / 1.15, high * factor * 1.15);
        let widen = (10.0 / (high / low)).max(1.0).sqrt();
        Self { title: title(name, shown), factor, scale: Scale::Log, low: low / widen, high: high * widen }
    }

    /// Place of a value between the ends, 0 to 1, not cut; none where it has no place.
    pub(super) fn place(&self, value: f64) -> Option<f64> {
        let shown = value * self.factor;
        let place = match self.scale {
            Scale::Linear => (shown - self.low) / (self.high - self.low),
            Scale::Log if shown > 0.0 => (shown / self.low).ln() / (self.high / self.low).ln(),
            Scale::Log => return None,
        };
        place.is_finite().then_some(place)
    }

    /// Ticks: place and label, `count` of them or a few less, but two at least where both find a place.
    pub(super) fn ticks(&self, count: usize) -> Vec<(f64, String)> {
        let values = match self.scale {
            // One alone says nothing of the others.
            Scale::Linear => (count..2 * count)
                .map(|count| linear_ticks(self.low, self.high, count))
                .find(|ticks| ticks.len() > 1)
                .unwrap_or_default(),
            Scale::Log => log_ticks(self.low, self.high, count),
        };
        values
            .into_iter()
            .filter_map(|(value, label)| Some((self.place(value / self.factor)?, label)))
            .collect()
    }
}

fn title(name: &str, unit: &str) -> String {
    if unit.is_empty() { name.to_owned() } else { format!("{name}, {unit}") }
}

/// Smallest and largest finite value; 0 and 1 where there is none.
fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values
        .filter(|value| value.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
    if low <= high { (low, high) } else { (0.0, 1.0) }
}

/// 1, 2 or 5 times a power of ten: the smallest such step that gives at most `count` ticks.
fn round_step(span: f64, count: usize) -> f64 {
    let least = span / count.max(1) as f64;
    let power = 10_f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|&step| step >= least * 0.999).unwrap_or(least)
}

fn linear_ticks(low: f64, high: f64, count: usize) -> Vec<(f64, String)> {
    let step = round_step(high - low, count);
    let decimals = (-step.log10().floor()).clamp(0.0, 12.0) as usize;
    let (first, last) = ((low / step).ceil() as i64, (high / step).floor() as i64);
    (first..=last)
        .map(|index| {
            let value = index as f64 * step;
            (value, if index == 0 { "0".to_owned() } else { format!("{value:.decimals$}").replace('-', "−") })
        })
        .collect()
}

fn log_ticks(low: f64, high: f64, count: usize) -> Vec<(f64, String)> {
    let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    let inside = |value: &f64| (low..=high).contains(value);
    let with = |multiples: &[f64]| -> Vec<f64> {
        (first..=last)
            .flat_map(|power| multiples.iter().map(move |multiple| multiple * 10_f64.powi(power)))
            .filter(inside)
            .collect()
    };
    let dense = [&[1.0, 2.0, 5.0][..], &[1.0, 3.0]].into_iter().map(with).find(|ticks| ticks.len() <= count);
    let values = dense.unwrap_or_else(|| {
        let decades = with(&[1.0]);
        let every = decades.len().div_ceil(count.max(1)).max(1);
        decades.into_iter().step_by(every).collect()
    });
    // All in one notation: plain from 0.0001 to 100000, else as multiples of powers of ten.
    let is_plain = values.iter().all(|value| (1e-4..1.001e5).contains(value));
    values.into_iter().map(|value| (value, if is_plain { plain(value) } else { of_ten(value) })).collect()
}

/// A round number without noise digits.
fn plain(value: f64) -> String {
    let decimals = (-value.log10().floor()).max(0.0) as usize;
    format!("{value:.decimals$}")
}

/// A round number as a multiple of a power of ten.
fn of_ten(value: f64) -> String {
    format!("{value:.0e}").replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis, count: usize) -> Vec<String> {
        axis.ticks(count).into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_stand_at_round_numbers() {
        assert_eq!(labels(&Axis::between("t", "s", 0.0, 1.0), 5), ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels(&Axis::between("x", "m", -4e-3, 4.1e-3), 5), ["−4", "−2", "0", "2", "4"]);
        assert_eq!(labels(&Axis::decades("e", "1", [0.02, 300.0].into_iter()), 5), ["0.1", "1", "10", "100"]);
        assert_eq!(labels(&Axis::decades("e", "1", [1.0, 9.0].into_iter()), 5), ["1", "2", "5", "10"]);
    }

    #[test]
    fn an_axis_has_one_notation() {
        let wide = Axis::decades("density", "1", [2e3, 5e5].into_iter());
        assert_eq!(labels(&wide, 9), ["2e3", "5e3", "1e4", "2e4", "5e4", "1e5", "2e5", "5e5"]);
        let small = Axis::decades("density", "1", [3e-6, 0.5].into_iter());
        assert_eq!(labels(&small, 6), ["1e−5", "1e−4", "1e−3", "1e−2", "1e−1"]);
    }

    #[test]
    fn a_constant_is_seen_in_a_range_that_means_something() {
        assert_eq!(
            labels(&Axis::around("x", "m", [0.0; 3].into_iter()), 5),
            ["−1.0", "−0.5", "0", "0.5", "1.0"]
        );
        let rounded = Axis::around("x", "m", [5e-3, 5e-3 + 1e-18].into_iter());
        assert_eq!(labels(&rounded, 5), ["4.8", "4.9", "5.0", "5.1", "5.2"]);
    }

    #[test]
    fn a_unit_suits_the_size() {
        assert_eq!(Axis::between("position", "m", 0.0, 4e-3).title, "position, mm");
        assert_eq!(Axis::between("residual", "m", -4e-6, 4e-6).title, "residual, µm");
        assert_eq!(Axis::between("gain", "1", 0.0, 1.0).title, "gain");
    }

    #[test]
    fn an_axis_survives_values_that_say_nothing() {
        for axis in [
            Axis::around("x", "m", [f64::NAN].into_iter()),
            Axis::around("x", "m", [0.0].into_iter()),
            Axis::around("x", "m", [5.0, 5.0].into_iter()),
            Axis::from_zero("x", "m", std::iter::empty()),
            Axis::decades("x", "m", [0.0, -1.0, f64::INFINITY].into_iter()),
        ] {
            let ticks = axis.ticks(5);
            assert!(!ticks.is_empty() && ticks.len() < 12, "{axis:?}: {ticks:?}");
            assert!(
                ticks.iter().all(|(place, _)| (-1e-6..=1.000_001).contains(place)),
                "{axis:?}: {ticks:?}"
            );
        }
    }
}
