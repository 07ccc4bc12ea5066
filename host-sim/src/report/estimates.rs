//! Estimates: with their intervals, and how they hang together.

use super::page::{Tile, table};
use super::plot::Role;
use super::rows::{Row, Rows, Shape};
use super::scale::{Axis, shown, shown_by};
use crate::fit::{Correlation, Estimate, Fit, NoiseSource};
use eha_monitor::channel::Channel;
use maud::{Markup, html};

/// An estimate as a headline figure.
pub(super) fn estimate_tile(estimate: &Estimate) -> Tile {
    let info = estimate.parameter.info();
    let q = shown_by(estimate);
    Tile::new(
        info.description,
        q(estimate.value),
        format!("95 %: {} to {}", q(estimate.ci95[0]), q(estimate.ci95[1])),
    )
}

/// Estimates as a table.
pub(super) fn estimate_table(estimates: &[Estimate]) -> Markup {
    let rows: Vec<Vec<String>> = estimates
        .iter()
        .map(|estimate| {
            let info = estimate.parameter.info();
            let q = shown_by(estimate);
            vec![
                info.name.to_owned(),
                info.symbol.to_owned(),
                q(estimate.value),
                format!("{} to {}", q(estimate.ci95[0]), q(estimate.ci95[1])),
                q(estimate.standard_error),
            ]
        })
        .collect();
    table("Estimates", "", &["parameter", "symbol", "value", "95 % interval", "standard error"], &rows, true)
}

/// Residual and noise of each channel.
pub(super) fn noise_table(fit: &Fit, source: &[NoiseSource]) -> Markup {
    let rows: Vec<Vec<String>> = Channel::MEASURED
        .into_iter()
        .enumerate()
        .filter_map(|(index, channel)| {
            let (rms, info) = (fit.residual_rms[index]?, channel.info());
            let from = if source.get(index) == Some(&NoiseSource::Rig) { "rig" } else { "record" };
            Some(vec![
                info.column.to_owned(),
                shown(rms, info.unit),
                shown(fit.noise[index], info.unit),
                from.to_owned(),
            ])
        })
        .collect();
    table("Residual and noise", "", &["channel", "residual rms", "noise", "noise from"], &rows, false)
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
pub(super) fn signed(correlation: f64) -> String {
    let text = format!("{correlation:+.3}").replace('-', "−");
    if text.ends_with("0.000") { "0.000".to_owned() } else { text }
}

/// Estimates up to which their matrix has room beside another card.
const FEW: usize = 4;

/// How estimates of some parameters hang together, as a coloured matrix.
pub(super) fn correlation_matrix(title: &str, correlation: &Correlation) -> Markup {
    let names: Vec<&str> = correlation.parameters.iter().map(|parameter| parameter.info().name).collect();
    html! {
        figure.card .wide[names.len() > FEW] {
            figcaption { span.title { (title) } }
            div.scroll { table.matrix {
                thead { tr { th {} @for name in &names { th { (breakable(name)) } } } }
                tbody { @for (name, row) in names.iter().zip(&correlation.matrix) { tr {
                    th { (breakable(name)) }
                    @for value in row {
                        @let strength = if value.is_finite() { (value.abs() * 60.0).round() } else { 0.0 };
                        @let colour = if *value < 0.0 { "before" } else { "model" };
                        td { span style=(format!("background: color-mix(in srgb, var(--{colour}) {strength}%, transparent)")) {
                            (if value.is_finite() { signed(*value) } else { "-".to_owned() })
                        } }
                    }
                } } }
            } }
            p.note { "Near +1 or −1, the records hardly separate the two." }
        }
    }
}

/// A name that may go on in the next line after each of its words.
fn breakable(name: &str) -> Markup {
    html! { @for (place, word) in name.split('_').enumerate() { @if place > 0 { "_" wbr; } (word) } }
}
