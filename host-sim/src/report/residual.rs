//! What a residual has to say: its spectrum, what it is correlated with.

use super::estimates::signed;
use super::plot::{Layer, Plot, Role, heights};
use super::records::{Compared, quantity_of};
use super::rows::{Row, Rows, Shape};
use super::scale::Axis;
use super::statistics::{autocorrelation, cross_correlation, present, spectrum};
use crate::diagnose::description::{Quantity, motion};
use crate::diagnose::residual::MEASURED;
use crate::fit::OF_95;
use eha_monitor::channel::Channel;
use eha_monitor::model::state::Outputs;
use maud::{Markup, html};

/// Lags of the correlations, samples.
const LAGS: usize = 60;

/// Residuals of a channel, of every model, and how they are shown.
struct Residuals<'a> {
    /// Which residuals they are.
    of: String,
    models: &'a [(Role, &'static str, &'a [Outputs<f64>])],
    /// For each model a series for each record.
    all: Vec<Vec<Vec<f64>>>,
    /// Quantities of the motion, for each record.
    motions: Vec<Vec<Quantity>>,
    period: f64,
}

/// Spectrum and correlations of the residual of every channel that was fitted, of every model: those of the first at once,
/// those of the others where the reader asks for them.
pub(super) fn tests(all: &[Compared<'_>], noise: &[f64; MEASURED]) -> Markup {
    let is_fitted = |&channel: &usize| noise[channel].is_finite() && all.iter().any(|one| one.has(channel));
    let mut fitted = (0..MEASURED).filter(is_fitted);
    html! {
        @if let Some(first) = fitted.next() { (tests_of(all, first, noise[first])) }
        @for channel in fitted {
            details.wide {
                summary { (format!("The same of the {}", quantity_of(Channel::MEASURED[channel]))) }
                div.grid { (tests_of(all, channel, noise[channel])) }
            }
        }
    }
}

/// Spectrum and correlations of the residual of a channel, of every model.
fn tests_of(all: &[Compared<'_>], channel: usize, noise: f64) -> Markup {
    let mut alike: Vec<&Compared<'_>> = all.iter().filter(|one| one.has(channel)).collect();
    let Some(first) = alike.first().copied() else { return html! {} };
    let period = first.record.sample_period_s();
    alike.retain(|one| one.record.sample_period_s() == period);
    let series = |model: usize| -> Vec<Vec<f64>> {
        alike.iter().map(|one| one.residual(one.models[model].2, channel)).collect()
    };
    let motion_of = |one: &&Compared<'_>| {
        let outputs = one.models.last().map_or(&[][..], |model| model.2);
        let ram: Vec<f64> = outputs.iter().map(|output| output.ram).collect();
        motion(&ram, period, &one.residual(outputs, channel))
    };
    let name = match alike.as_slice() {
        [one] => one.name.clone(),
        several => format!("{} records", several.len()),
    };
    let residuals = Residuals {
        of: format!("{name}, residual of the {}", quantity_of(Channel::MEASURED[channel])),
        models: &first.models,
        all: (0..first.models.len()).map(series).collect(),
        motions: alike.iter().map(motion_of).collect(),
        period,
    };
    html! {
        (residuals.spectra(noise, Channel::MEASURED[channel].info().unit))
        (residuals.autocorrelations())
        (residuals.velocity_lags())
        (residuals.correlations())
    }
}

impl Residuals<'_> {
    fn legend(&self) -> Vec<(Role, String)> {
        self.models.iter().map(|(role, name, _)| (*role, (*name).to_owned())).collect()
    }

    /// The residuals of each model, with its colour.
    fn of_models(&self) -> impl Iterator<Item = (&[Vec<f64>], Role)> {
        self.all.iter().map(Vec::as_slice).zip(self.models.iter().map(|(role, ..)| *role))
    }

    /// Largest correlation of white residuals in 95 of 100 cases.
    fn band(&self) -> f64 {
        OF_95 / (self.all.first().map_or(1, |all| present(all)).max(1) as f64).sqrt()
    }

    fn spectra(&self, noise: f64, unit: &str) -> Markup {
        let found: Vec<_> = self
            .of_models()
            .filter_map(|(all, role)| Some((spectrum(all, self.period, noise)?, role)))
            .collect();
        let Some([low, high]) = found.first().map(|(spectrum, _)| spectrum.white) else { return html! {} };
        let ends = [1e-9, 1e9];
        let mut layers = vec![Layer::Area(ends.map(|frequency| [frequency, low, high]).to_vec())];
        for (spectrum, role) in &found {
            layers.push(Layer::Curve(*role, spectrum.points.clone()));
        }
        let frequencies = found.iter().flat_map(|(spectrum, _)| spectrum.points.iter().map(|point| point[0]));
        Plot {
            title: format!("{}: spectrum", self.of),
            legend: self.legend(),
            ramp: None,
            note: "Amplitude density (Welch). Shaded: 95 % band of white noise of the stated size."
                .to_owned(),
            x: Axis::decades("frequency", "Hz", frequencies),
            y: Axis::decades("density", &format!("{unit}/√Hz"), heights(&layers)),
            layers,
            wide: false,
        }
        .figure()
    }

    fn autocorrelations(&self) -> Markup {
        let stems = |(all, role): (&[Vec<f64>], Role)| {
            let points = autocorrelation(all, LAGS).into_iter().enumerate();
            let at = |(lag, correlation)| [(lag + 1) as f64 * self.period * 1e3, correlation];
            Layer::Stems(role, points.map(at).collect())
        };
        self.over_lags("autocorrelation", "lag", self.of_models().map(stems).collect())
    }

    fn velocity_lags(&self) -> Markup {
        let velocities: Vec<Vec<f64>> = self.motions.iter().map(|motion| motion[2].values.clone()).collect();
        let curve = |(all, role): (&[Vec<f64>], Role)| {
            let points = cross_correlation(all, &velocities, 2 * LAGS).into_iter();
            Layer::Curve(role, points.map(|[lag, value]| [lag * self.period * 1e3, value]).collect())
        };
        let curves = self.of_models().map(curve).collect();
        self.over_lags("cross-correlation with the velocity", "delay behind the velocity", curves)
    }

    fn over_lags(&self, what: &str, axis: &str, mut layers: Vec<Layer>) -> Markup {
        let band = self.band();
        let times: Vec<f64> = layers
            .iter()
            .flat_map(|layer| match layer {
                Layer::Curve(_, points) | Layer::Stems(_, points) => points.iter().map(|p| p[0]).collect(),
                _ => Vec::new(),
            })
            .collect();
        layers.insert(0, Layer::Area([-1e9, 1e9].map(|lag| [lag, -band, band]).to_vec()));
        layers.push(Layer::Level(0.0));
        Plot {
            title: format!("{}: {what}", self.of),
            legend: self.legend(),
            ramp: None,
            note: "Shaded: 95 % band of a white residual.".to_owned(),
            x: Axis::around(axis, "ms", times.into_iter()),
            y: Axis::around("correlation", "1", heights(&layers)),
            layers,
            wide: false,
        }
        .figure()
    }

    fn correlations(&self) -> Markup {
        let names = self.motions.first().into_iter().flatten().map(|quantity| quantity.name).enumerate();
        let rows = |(index, name): (usize, &str)| -> Vec<Row> {
            let quantity: Vec<Vec<f64>> =
                self.motions.iter().map(|motion| motion[index].values.clone()).collect();
            let row = |(place, (all, role)): (usize, (&[Vec<f64>], Role))| {
                let value = cross_correlation(all, &quantity, 0)[0][1];
                Row {
                    name: if place == 0 { name.to_owned() } else { String::new() },
                    role,
                    shape: Shape::Point(value, [value - self.band(), value + self.band()]),
                    text: signed(value),
                }
            };
            self.of_models().enumerate().map(row).collect()
        };
        Rows {
            title: format!("{}: correlation with the motion", self.of),
            legend: self.legend(),
            note: "With quantities of the model's motion; whiskers: the 95 % band of a white residual."
                .to_owned(),
            axis: Axis::between("correlation", "1", -1.0, 1.0),
            entries: names.flat_map(rows).collect(),
            wide: false,
        }
        .figure()
    }
}
