//! The report of `identify`.

use super::estimates::{correlation_matrix, estimate_table, estimate_tile, estimates, noise_table};
use super::page::{Page, Tile, remarks};
use super::plot::Role;
use super::records::{Compared, records, short_name};
use super::residual;
use super::scale::shown;
use super::search::search;
use crate::fit::{Fit, NoiseSource, Prepared};
use crate::output;
use crate::record::Record;
use crate::rig::{Range, Rig};
use maud::html;
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
        .zip(&fit.predictions)
        .enumerate()
        .map(|(index, ((record, prepared), outputs))| Compared {
            name: short_name(result.names, index),
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
    let found = html! {
        (estimate_table(&fit.estimates))
        (estimates(&[(Role::Model, "estimate", fit.estimates.iter().collect())]))
        @if fit.estimates.len() > 1 { (correlation_matrix("Correlation of the estimates", &fit.correlation())) }
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
            ("Estimates", found),
            ("Record against model", records(&compared)),
            ("What is left", residual::tests(&compared, &fit.noise)),
            ("Search", search(fit, result.rig, result.ranges, result.prepared, result.population)),
        ],
        config: result.config,
    }
    .render()
}
