//! The figures of records, residuals, searches and estimates, from what the fits leave behind.

use super::plot::{CLASSES, Layer, Plot, Role};
use super::rows::{Row, Rows, Shape};
use super::scale::{Axis, shown};
use super::statistics::{autocorrelation, cross_correlation, motion, present, spectrum};
use super::surface::Surface;
use crate::fit::{Estimate, Fit, Prepared, Visit};
use crate::record::Record;
use eha_monitor::channel::Channel;
use eha_monitor::model::state::Outputs;
use maud::{Markup, html};

/// A record with what a model, or two, say of it.
pub(super) struct Compared<'a> {
    /// Name of the record.
    pub(super) name: String,
    /// The record.
    pub(super) record: &'a Record,
    /// The record as it was fitted.
    pub(super) prepared: &'a Prepared,
    /// Models: their role, their name and what they predict.
    pub(super) models: Vec<(Role, &'static str, &'a [Outputs<f64>])>,
}

impl Compared<'_> {
    /// Measured minus predicted, one value a sample; NaN where nothing is compared.
    fn residual(&self, outputs: &[Outputs<f64>], channel: usize) -> Vec<f64> {
        let record = self.prepared.as_core();
        self.prepared
            .measured(channel)
            .iter()
            .zip(outputs)
            .enumerate()
            .map(
                |(sample, (value, output))| {
                    if record.is_compared(sample) { value - output.to_array()[channel] } else { f64::NAN }
                },
            )
            .collect()
    }

    fn time(&self, values: impl IntoIterator<Item = f64>) -> Vec<[f64; 2]> {
        values.into_iter().enumerate().map(|(sample, value)| [self.record.time_s(sample), value]).collect()
    }

    fn has(&self, channel: usize) -> bool {
        !self.prepared.measured(channel).is_empty()
    }

    fn time_axis(&self) -> Axis {
        Axis::between(
            "time",
            "s",
            self.record.time_s(0),
            self.record.time_s(self.record.len().saturating_sub(1)),
        )
    }
}

pub(super) fn heights(layers: &[Layer]) -> impl Iterator<Item = f64> {
    layers.iter().flat_map(|layer| match layer {
        Layer::Curve(_, points) | Layer::Dots(_, points) | Layer::Stems(_, points) => {
            points.iter().map(|point| point[1]).collect::<Vec<_>>()
        }
        Layer::Area(bounds) => bounds.iter().flat_map(|bound| [bound[1], bound[2]]).collect(),
        Layer::Level(level) => vec![*level],
        Layer::Cells { .. } | Layer::Outline(_) | Layer::Mark(_) => Vec::new(),
    })
}

/// A channel of a record against the last of its models, then what is left, of every model.
pub(super) fn record(compared: &Compared<'_>, channel: usize) -> Markup {
    let noise = compared.prepared.noise[channel];
    let info = Channel::MEASURED[channel].info();
    let what = info.description.split(',').next().unwrap_or(info.column);
    let mut layers = vec![Layer::Curve(
        Role::Measured,
        compared.time(compared.prepared.measured(channel).iter().copied()),
    )];
    let mut legend = vec![(Role::Measured, "measured".to_owned())];
    if let Some((role, name, outputs)) = compared.models.last() {
        layers.push(Layer::Curve(
            *role,
            compared.time(outputs.iter().map(|output| output.to_array()[channel])),
        ));
        legend.push((*role, (*name).to_owned()));
    }
    if channel == 0 {
        layers
            .push(Layer::Curve(Role::Reference, compared.time(compared.prepared.command().iter().copied())));
        legend.push((Role::Reference, "command".to_owned()));
    }
    let traces = Plot {
        title: format!("{}: {what}", compared.name),
        legend,
        ramp: None,
        note: String::new(),
        x: compared.time_axis(),
        y: Axis::around(what, info.unit, heights(&layers)),
        layers,
        wide: true,
    };
    let x = compared.time_axis();
    let ends = [compared.record.time_s(0), compared.record.time_s(compared.record.len().saturating_sub(1))];
    let mut layers = vec![Layer::Area(ends.map(|t| [t, -1.96 * noise, 1.96 * noise]).to_vec())];
    let mut legend = Vec::new();
    for (role, name, outputs) in &compared.models {
        layers.push(Layer::Curve(*role, compared.time(compared.residual(outputs, channel))));
        legend.push((*role, (*name).to_owned()));
    }
    // Again on top, where a long record hides the shading.
    layers.extend([-1.96, 1.96].map(|normal| Layer::Level(normal * noise)));
    let residual = Plot {
        title: format!("{}: residual of the {what}", compared.name),
        legend,
        ramp: None,
        note: format!(
            "Measured minus predicted. Shaded, between the dashed lines: 95 % of white noise of {}.",
            shown(noise, info.unit)
        ),
        x,
        y: Axis::around("residual", info.unit, heights(&layers)),
        layers,
        wide: true,
    };
    html! { (traces.figure()) (residual.figure()) }
}

/// Every channel of every record, with its noise.
pub(super) fn records(all: &[Compared<'_>]) -> Markup {
    html! {
        @for compared in all.iter().take(MOST_RECORDS) {
            @for channel in (0..Channel::MEASURED.len()).filter(|&channel| compared.has(channel)) {
                (record(compared, channel))
            }
        }
        @if all.len() > MOST_RECORDS {
            p.note.wide { "The first " (MOST_RECORDS) " of " (all.len()) " records are shown; every figure below counts all." }
        }
    }
}

/// Records that are drawn.
const MOST_RECORDS: usize = 6;
/// Lags of the correlations, samples.
const LAGS: usize = 60;

/// Spectrum and correlations of the residual of a channel, of every model.
pub(super) fn residual_tests(all: &[Compared<'_>], channel: usize, noise: f64) -> Markup {
    let Some(first) = all.first() else { return html! {} };
    let period = first.record.sample_period_s();
    let alike: Vec<&Compared<'_>> =
        all.iter().filter(|one| one.has(channel) && one.record.sample_period_s() == period).collect();
    let info = Channel::MEASURED[channel].info();
    let models = &first.models;
    let series = |model: usize| -> Vec<Vec<f64>> {
        alike.iter().map(|one| one.residual(one.models[model].2, channel)).collect()
    };
    let legend: Vec<(Role, String)> =
        models.iter().map(|(role, name, _)| (*role, (*name).to_owned())).collect();
    let residuals: Vec<Vec<Vec<f64>>> = (0..models.len()).map(series).collect();
    let motions: Vec<Vec<(&str, Vec<f64>)>> = alike
        .iter()
        .map(|one| {
            motion(&one.models.last().map_or(Vec::new(), |m| m.2.iter().map(|o| o.ram).collect()), period)
        })
        .collect();
    html! {
        (spectra(&residuals, models, period, noise, info.unit, &legend))
        (autocorrelations(&residuals, models, period, &legend))
        (velocity_lags(&residuals, models, &motions, period, &legend))
        (follows(&residuals, models, &motions, &legend))
    }
}

type Models<'a> = [(Role, &'static str, &'a [Outputs<f64>])];
type All = [Vec<Vec<f64>>];

fn spectra(
    residuals: &All,
    models: &Models<'_>,
    period: f64,
    noise: f64,
    unit: &str,
    legend: &[(Role, String)],
) -> Markup {
    let found: Vec<_> = residuals.iter().filter_map(|all| spectrum(all, period, noise)).collect();
    let Some([low, high]) = found.first().map(|spectrum| spectrum.white) else { return html! {} };
    let ends = [1e-9, 1e9];
    let mut layers = vec![Layer::Area(ends.map(|frequency| [frequency, low, high]).to_vec())];
    for (spectrum, (role, ..)) in found.iter().zip(models) {
        layers.push(Layer::Curve(*role, spectrum.points.clone()));
    }
    let frequencies = found.iter().flat_map(|spectrum| spectrum.points.iter().map(|point| point[0]));
    Plot {
        title: "Residual: spectrum".to_owned(),
        legend: legend.to_vec(),
        ramp: None,
        note: "Amplitude density (Welch). Shaded: 95 % band of white noise of the stated size.".to_owned(),
        x: Axis::decades("frequency", "Hz", frequencies),
        y: Axis::decades("density", &format!("{unit}/√Hz"), heights(&layers)),
        layers,
        wide: false,
    }
    .figure()
}

fn autocorrelations(residuals: &All, models: &Models<'_>, period: f64, legend: &[(Role, String)]) -> Markup {
    let mut layers = Vec::new();
    for (all, (role, ..)) in residuals.iter().zip(models) {
        let points = autocorrelation(all, LAGS)
            .into_iter()
            .enumerate()
            .map(|(lag, correlation)| [(lag + 1) as f64 * period * 1e3, correlation]);
        layers.push(Layer::Stems(*role, points.collect()));
    }
    let count = residuals.first().map_or(1, |all| present(all)).max(1) as f64;
    correlation_plot("Residual: correlation with itself", "lag", layers, count, legend)
}

fn velocity_lags(
    residuals: &All,
    models: &Models<'_>,
    motions: &[Vec<(&str, Vec<f64>)>],
    period: f64,
    legend: &[(Role, String)],
) -> Markup {
    let velocities: Vec<Vec<f64>> = motions.iter().map(|motion| motion[2].1.clone()).collect();
    let mut layers = Vec::new();
    for (all, (role, ..)) in residuals.iter().zip(models) {
        let points = cross_correlation(all, &velocities, 2 * LAGS);
        layers.push(Layer::Curve(
            *role,
            points.into_iter().map(|[lag, correlation]| [lag * period * 1e3, correlation]).collect(),
        ));
    }
    let count = residuals.first().map_or(1, |all| present(all)).max(1) as f64;
    correlation_plot(
        "Residual: correlation with the velocity before it",
        "delay of the residual",
        layers,
        count,
        legend,
    )
}

fn correlation_plot(
    title: &str,
    axis: &str,
    mut layers: Vec<Layer>,
    count: f64,
    legend: &[(Role, String)],
) -> Markup {
    let band = 1.96 / count.sqrt();
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
        title: title.to_owned(),
        legend: legend.to_vec(),
        ramp: None,
        note: "Shaded: 95 % band of a white residual.".to_owned(),
        x: Axis::around(axis, "ms", times.into_iter()),
        y: Axis::around("correlation", "1", heights(&layers)),
        layers,
        wide: false,
    }
    .figure()
}

fn follows(
    residuals: &All,
    models: &Models<'_>,
    motions: &[Vec<(&str, Vec<f64>)>],
    legend: &[(Role, String)],
) -> Markup {
    let mut rows = Vec::new();
    let names: Vec<&str> = motions.first().map_or(Vec::new(), |motion| motion.iter().map(|m| m.0).collect());
    for (index, name) in names.iter().enumerate() {
        let quantity: Vec<Vec<f64>> = motions.iter().map(|motion| motion[index].1.clone()).collect();
        for (place, (all, (role, ..))) in residuals.iter().zip(models).enumerate() {
            let value = cross_correlation(all, &quantity, 0)[0][1];
            let band = 1.96 / (present(all).max(1) as f64).sqrt();
            rows.push(Row {
                name: if place == 0 { (*name).to_owned() } else { String::new() },
                role: *role,
                shape: Shape::Point(value, [value - band, value + band]),
                text: signed(value),
            });
        }
    }
    Rows {
        title: "Residual: what it goes with".to_owned(),
        legend: legend.to_vec(),
        note: "Correlation with the motion of the model, with the 95 % band of a white residual.".to_owned(),
        axis: Axis::between("correlation", "1", -1.0, 1.0),
        entries: rows,
        wide: false,
    }
    .figure()
}

/// Best and worst of the population over the generations, and what the finishes made of it.
pub(super) fn convergence(visits: &[Visit], population: usize, wide: bool) -> Markup {
    let children = || visits.iter().filter(|visit| !visit.finish);
    let mut evaluation = 0.0;
    let (mut best, mut area, mut finishes) = (Vec::new(), Vec::new(), Vec::new());
    for visit in visits {
        let generation = evaluation / population.max(1) as f64;
        if visit.finish {
            finishes.push([generation, visit.best.sqrt()]);
        } else {
            evaluation += 1.0;
            area.push([generation, visit.best.sqrt(), visit.worst.sqrt()]);
        }
        best.push([generation, visit.best.sqrt()]);
    }
    let layers =
        vec![Layer::Area(area), Layer::Curve(Role::Model, best), Layer::Dots(Role::Before, finishes)];
    let last = children().count() as f64 / population.max(1) as f64;
    Plot {
        title: "Search: cost over the generations".to_owned(),
        legend: vec![(Role::Model, "best".to_owned()), (Role::Before, "Gauss-Newton finish".to_owned())],
        ramp: None,
        note: "Shaded: best to worst of the population. 1 is a residual that is just the noise.".to_owned(),
        x: Axis::between("generation", "1", 0.0, 1.02 * last.max(1.0)),
        y: Axis::decades("residual over noise, rms", "1", heights(&layers)),
        layers,
        wide,
    }
    .figure()
}

/// The cost over the whole ranges of two parameters, with the places that the search visited.
pub(super) fn whole_surface(surface: &Surface, pair: [&Estimate; 2], visits: &[[f64; 2]]) -> Markup {
    let rms = |chi_square: f64| (chi_square / f64::from(surface.count.max(1))).sqrt();
    let [low, high] = surface.extent().map(rms);
    let class = |chi_square: f64| {
        let share = (rms(chi_square) / low).ln() / (high / low).ln().max(1e-9);
        (share * CLASSES as f64).clamp(0.0, CLASSES as f64 - 1.0) as usize
    };
    let layers = vec![
        cells(surface, class),
        Layer::Dots(Role::Measured, visits.to_vec()),
        Layer::Mark([pair[0].value, pair[1].value]),
    ];
    let times = |value: f64| if value >= 10.0 { format!("{value:.0}") } else { format!("{value:.1}") };
    Plot {
        title: "Cost over the whole range".to_owned(),
        legend: Vec::new(),
        ramp: Some([times(low), format!("{} times the noise", times(high))]),
        note: "Circles: what the search visited. Cross: the estimate.".to_owned(),
        x: axis_of(pair[0], &surface.columns),
        y: axis_of(pair[1], &surface.rows),
        layers,
        wide: false,
    }
    .figure()
}

/// The cost near the estimate, in standard errors, with the region that holds both values in 95 of 100 cases.
pub(super) fn near_surface(
    surface: &Surface,
    pair: [&Estimate; 2],
    correlation: f64,
    inflation: f64,
) -> Markup {
    let [low, _] = surface.extent();
    let class = |chi_square: f64| {
        let away = ((chi_square - low) / inflation).max(0.0).sqrt();
        (2.0 * away).clamp(0.0, CLASSES as f64 - 1.0) as usize
    };
    // Chi-square of two degrees of freedom is below 5.99 in 95 of 100 cases.
    let radius = 5.99_f64.sqrt();
    let ellipse: Vec<[f64; 2]> = (0..72)
        .map(|k| {
            let (sine, cosine) = (std::f64::consts::TAU * f64::from(k) / 72.0).sin_cos();
            let second = correlation * cosine + (1.0 - correlation * correlation).max(0.0).sqrt() * sine;
            [
                pair[0].value + radius * pair[0].standard_error * cosine,
                pair[1].value + radius * pair[1].standard_error * second,
            ]
        })
        .collect();
    Plot {
        title: "Cost near the estimate".to_owned(),
        legend: Vec::new(),
        ramp: Some(["0".to_owned(), "8 standard errors and more".to_owned()]),
        note: format!(
            "Outline: 95 % region of both, from the covariance. Correlation of the estimates {}.",
            format!("{correlation:.3}").replace('-', "−")
        ),
        x: axis_of(pair[0], &surface.columns),
        y: axis_of(pair[1], &surface.rows),
        layers: vec![
            cells(surface, class),
            Layer::Outline(ellipse),
            Layer::Mark([pair[0].value, pair[1].value]),
        ],
        wide: false,
    }
    .figure()
}

fn cells(surface: &Surface, class: impl Fn(f64) -> usize) -> Layer {
    Layer::Cells {
        columns: surface.columns.clone(),
        rows: surface.rows.clone(),
        classes: surface
            .chi_square
            .iter()
            .map(|row| row.iter().map(|&value| class(value)).collect())
            .collect(),
    }
}

fn axis_of(estimate: &Estimate, edges: &[f64]) -> Axis {
    let info = estimate.parameter.info();
    let (low, high) = (edges.first().copied().unwrap_or(0.0), edges.last().copied().unwrap_or(1.0));
    Axis::between(info.name, info.unit, low, high)
}

/// One figure for each parameter: its estimate with interval, in each of the named fits.
pub(super) fn estimates(fits: &[(Role, &str, Vec<&Estimate>)]) -> Markup {
    let first = fits.first().map(|(.., estimates)| estimates.as_slice()).unwrap_or_default();
    html! { @for estimate in first {
        @let info = estimate.parameter.info();
        @let rows: Vec<Row> = fits
            .iter()
            .filter_map(|(role, name, estimates)| {
                let found = estimates.iter().find(|other| other.parameter == estimate.parameter)?;
                Some(Row {
                    name: (*name).to_owned(),
                    role: *role,
                    shape: Shape::Point(found.value, found.ci95),
                    text: shown(found.value, info.unit),
                })
            })
            .collect();
        @let ends = rows.iter().flat_map(|row| match row.shape {
            Shape::Bar(value) => [value; 2],
            Shape::Point(value, ci95) => [value.min(ci95[0]), value.max(ci95[1])],
        });
        (Rows {
            title: format!("{}: {}", info.name, info.description),
            legend: Vec::new(),
            note: String::new(),
            axis: Axis::around(info.name, info.unit, ends),
            entries: rows.clone(),
            wide: false,
        }.figure())
    } }
}

/// A correlation with its sign; one that is too small to show has none.
fn signed(correlation: f64) -> String {
    let text = format!("{correlation:+.3}").replace('-', "−");
    if text.ends_with("0.000") { "0.000".to_owned() } else { text }
}

/// How the estimates of a fit hang together, as a coloured matrix.
pub(super) fn correlation_matrix(fit: &Fit) -> Markup {
    let names: Vec<&str> = fit.estimates.iter().map(|estimate| estimate.parameter.info().name).collect();
    html! {
        figure.card {
            figcaption { span.title { "Correlation of the estimates" } }
            div.scroll { table.matrix {
                thead { tr { th {} @for name in &names { th { (name) } } } }
                tbody { @for (name, row) in names.iter().zip(fit.correlation()) { tr {
                    th { (name) }
                    @for value in row {
                        @let strength = if value.is_finite() { (value.abs() * 60.0).round() } else { 0.0 };
                        @let colour = if value < 0.0 { "before" } else { "model" };
                        td { span style=(format!("background: color-mix(in srgb, var(--{colour}) {strength}%, transparent)")) {
                            (if value.is_finite() { signed(value) } else { "-".to_owned() })
                        } }
                    }
                } } }
            } }
            p.note { "Near +1 or −1, the records tell the two apart badly." }
        }
    }
}
