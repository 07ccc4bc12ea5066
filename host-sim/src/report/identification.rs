//! The report of `identify`.

use super::figures::{self, Compared};
use super::page::{Page, Tile, remarks, table};
use super::plot::Role;
use super::scale::shown;
use super::surface::Surface;
use crate::fit::{Estimate, Fit, NoiseSource, Prepared};
use crate::output;
use crate::record::Record;
use crate::rig::{Range, Rig};
use eha_monitor::channel::Channel;
use maud::{Markup, html};
use serde_json::Value;

/// What the report of a fit shows.
pub(crate) struct Identified<'a> {
    /// Kind of result.
    pub(crate) title: &'a str,
    /// The rig before the fit.
    pub(crate) rig: &'a Rig,
    /// What was free.
    pub(crate) ranges: &'a [Range],
    /// The records, and their names.
    pub(crate) records: &'a [Record],
    /// Names of the records.
    pub(crate) names: &'a [String],
    /// The records as they were fitted.
    pub(crate) prepared: &'a [Prepared],
    /// The fit.
    pub(crate) fit: &'a Fit,
    /// Where the noise of each channel comes from.
    pub(crate) noise_source: &'a [NoiseSource],
    /// Members of the population.
    pub(crate) population: usize,
    /// What the user should know.
    pub(crate) warnings: &'a [String],
    /// The resolved configuration.
    pub(crate) config: &'a Value,
}

/// The report of a fit, as an HTML file.
pub(crate) fn identification(result: &Identified<'_>) -> String {
    let fit = result.fit;
    let compared: Vec<Compared<'_>> = result
        .records
        .iter()
        .zip(result.prepared)
        .zip(result.names.iter().zip(&fit.predictions))
        .map(|((record, prepared), (name, outputs))| Compared {
            name: short_name(name),
            record,
            prepared,
            models: vec![(Role::Model, "model", outputs.as_slice())],
        })
        .collect();
    let mut tiles: Vec<Tile> = fit.estimates.iter().map(estimate_tile).collect();
    tiles.push(Tile::new(
        "residual of the position",
        shown(fit.position_rms(), "m"),
        format!("noise {}", shown(fit.noise[0], "m")),
    ));
    tiles.push(Tile::new(
        "search",
        format!("{} evaluations", fit.evaluations),
        format!(
            "{}, {:.2} ms each; {}; {:.3} s",
            output::counted(fit.generations as usize, "generation"),
            fit.seconds_per_generation * 1e3,
            output::end_words(fit),
            fit.seconds
        ),
    ));
    let estimates = html! {
        (estimate_table(&fit.estimates))
        (figures::estimates(&[(Role::Model, "estimate", fit.estimates.iter().collect())]))
        @if fit.estimates.len() > 1 { (figures::correlation_matrix(fit)) }
        (noise_table(fit, result.noise_source))
        @if !result.warnings.is_empty() { (remarks("Notes", result.warnings)) }
    };
    let samples: usize = result.prepared.iter().map(Prepared::len).sum();
    Page {
        title: result.title,
        badge: None,
        summary: format!(
            "{samples} samples in {} against the rig {}.",
            output::counted(result.records.len(), "record"),
            result.rig.name
        ),
        tiles,
        sections: vec![
            ("Estimates", estimates),
            ("Record against model", figures::records(&compared)),
            ("What is left", figures::residual_tests(&compared, 0, fit.noise[0])),
            ("Search", search(fit, result.rig, result.ranges, result.prepared, result.population)),
        ],
        config: result.config,
    }
    .render()
}

/// The search: convergence, and the cost over the first two parameters.
pub(super) fn search(
    fit: &Fit,
    rig: &Rig,
    ranges: &[Range],
    prepared: &[Prepared],
    population: usize,
) -> Markup {
    let pair: Option<([Range; 2], [&Estimate; 2])> = match (ranges, fit.estimates.as_slice()) {
        ([first, second, ..], [one, other, ..]) => Some(([*first, *second], [one, other])),
        _ => None,
    };
    let visits: Vec<[f64; 2]> =
        fit.visits.iter().filter_map(|visit| Some([*visit.values.first()?, *visit.values.get(1)?])).collect();
    let surfaces = pair.filter(|_| !fit.interrupted).and_then(|(ranges, estimates)| {
        let whole = Surface::over(ranges, rig, fit, prepared)?;
        let near = near(ranges, estimates).and_then(|near| Surface::over(near, rig, fit, prepared));
        Some((estimates, whole, near))
    });
    html! {
        (figures::convergence(&fit.visits, population, surfaces.is_some()))
        @if let Some((estimates, whole, near)) = &surfaces {
            (figures::whole_surface(whole, *estimates, &visits))
            @if let Some(near) = near {
                (figures::near_surface(near, *estimates, fit.correlation()[0][1], fit.inflation))
            }
        } @else if pair.is_some() {
            p.note { "The cost over the faults is not drawn: these records are too long for it, or the search was interrupted." }
        }
    }
}

/// Standard errors to each side that the near surface shows.
const NEAR: f64 = 4.5;

/// The ranges within a few standard errors; none where these are not known, or reach as far as the ranges.
fn near(ranges: [Range; 2], estimates: [&Estimate; 2]) -> Option<[Range; 2]> {
    let mut near = ranges;
    for (range, estimate) in near.iter_mut().zip(estimates) {
        let (info, reach) = (range.parameter.info(), NEAR * estimate.standard_error);
        // Neither is known where the standard error is not.
        let (lower, upper) = (estimate.value - reach, estimate.value + reach);
        if lower.is_nan() || lower >= upper {
            return None;
        }
        range.lower = lower.max(info.lower);
        range.upper = upper.min(info.upper);
    }
    Some(near)
}

pub(super) fn estimate_tile(estimate: &Estimate) -> Tile {
    let info = estimate.parameter.info();
    let q = |value| shown(value, info.unit);
    Tile::new(
        info.description,
        q(estimate.value),
        format!("95 %: {} to {}", q(estimate.ci95[0]), q(estimate.ci95[1])),
    )
}

pub(super) fn estimate_table(estimates: &[Estimate]) -> Markup {
    let rows: Vec<Vec<String>> = estimates
        .iter()
        .map(|estimate| {
            let info = estimate.parameter.info();
            let q = |value| shown(value, info.unit);
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

fn noise_table(fit: &Fit, source: &[NoiseSource]) -> Markup {
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

/// A record's name without its folder and ending, but with its segment.
pub(super) fn short_name(name: &str) -> String {
    let (file, segment) = name.rsplit_once('@').map_or((name, None), |(file, segment)| (file, Some(segment)));
    let path = std::path::Path::new(file);
    let stem = path.file_stem().map_or_else(|| file.into(), std::ffi::OsStr::to_string_lossy);
    segment.map_or_else(|| stem.to_string(), |segment| format!("{stem}@{segment}"))
}
