//! A search: how its cost fell, and the cost over two of the parameters.

use super::plot::{CLASSES, Layer, Plot, Role, heights};
use super::scale::Axis;
use super::surface::Surface;
use crate::fit::{Estimate, Fit, Prepared, Visit};
use crate::rig::{Range, Rig};
use maud::{Markup, html};

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
    let visits: Vec<[f64; 2]> = fit
        .visits
        .iter()
        .filter(|visit| visit.reading == fit.reading)
        .filter_map(|visit| Some([*visit.values.first()?, *visit.values.get(1)?]))
        .collect();
    let surfaces = pair.filter(|_| !fit.interrupted).and_then(|(ranges, estimates)| {
        let whole = Surface::over(ranges, rig, fit, prepared)?;
        let near = near(ranges, estimates).and_then(|near| Surface::over(near, rig, fit, prepared));
        Some((estimates, whole, near))
    });
    html! {
        (convergence(fit, population, surfaces.is_some()))
        @if let Some((estimates, whole, near)) = &surfaces {
            (whole_surface(whole, *estimates, &visits))
            @if let Some(near) = near {
                (near_surface(near, *estimates, fit.correlation().matrix[0][1], fit.inflation))
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

/// Best and worst of the population over the generations, and what the finishes made of it, of one reading of the records
/// after the other.
fn convergence(fit: &Fit, population: usize, wide: bool) -> Markup {
    let mut children = 0.0;
    let (mut areas, mut best, mut finishes) = (Vec::new(), Vec::new(), Vec::new());
    let searches: Vec<&[Visit]> = fit.visits.chunk_by(Visit::is_of_search_of).collect();
    for visits in &searches {
        let mut area = Vec::new();
        for visit in *visits {
            children += f64::from(u8::from(!visit.finish));
            let generation = children / population.max(1) as f64;
            if visit.finish {
                finishes.push([generation, visit.best.sqrt()]);
            } else {
                area.push([generation, visit.best.sqrt(), visit.worst.sqrt()]);
            }
            best.push([generation, visit.best.sqrt()]);
        }
        areas.push(Layer::Area(area));
        // The next one starts anew.
        best.push([f64::NAN; 2]);
    }
    let layers = [areas, vec![Layer::Curve(Role::Model, best), Layer::Dots(Role::Before, finishes)]].concat();
    let readings = searches.iter().filter_map(|visits| visits.last()).map(|last| last.reading + 1).max();
    let several = match readings {
        Some(readings @ 2..) => format!(
            " {readings} readings of the records were searched, one after the other; number {} was taken.",
            fit.reading + 1
        ),
        _ => String::new(),
    };
    Plot {
        title: "Search: cost over the generations".to_owned(),
        legend: vec![(Role::Model, "best".to_owned()), (Role::Before, "Gauss-Newton finish".to_owned())],
        ramp: None,
        note: format!(
            "Shaded: best to worst of the population. 1 is a residual that is just the noise. A generation is as many \
             children as the population has members.{several}"
        ),
        x: Axis::between("generation", "1", 0.0, 1.02 * (children / population.max(1) as f64).max(1.0)),
        y: Axis::decades("residual over noise, rms", "1", heights(&layers)),
        layers,
        wide,
    }
    .figure()
}

/// The cost over the whole ranges of two parameters, with the places that the search visited.
fn whole_surface(surface: &Surface, pair: [&Estimate; 2], visits: &[[f64; 2]]) -> Markup {
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
fn near_surface(surface: &Surface, pair: [&Estimate; 2], correlation: f64, inflation: f64) -> Markup {
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
