//! Paths of SVG through places of a drawing.

use std::fmt::Write as _;

/// A closed path.
pub(super) fn outline(places: impl Iterator<Item = [f64; 2]>) -> String {
    let mut path = String::new();
    for [x, y] in places {
        let _ = write!(path, "{}{x:.1} {y:.1}", if path.is_empty() { 'M' } else { 'L' });
    }
    path.push('Z');
    path
}

/// The path through places. Where more than two fall on a pixel's width, it goes through the first, the lowest, the
/// highest and the last of them: the picture is the same, its size is bounded by its width.
pub(super) fn decimated(places: impl Iterator<Item = Option<[f64; 2]>>, width: f64, height: f64) -> String {
    let mut path = String::new();
    let mut pen_down = false;
    let mut column: Vec<[f64; 2]> = Vec::new();
    let mut flush = |column: &mut Vec<[f64; 2]>, pen_down: &mut bool| {
        for [x, y] in thinned(column) {
            // Far outside is as good as just outside, and keeps the numbers short.
            let y = y.clamp(-height, 2.0 * height);
            let _ = write!(path, "{}{x:.1} {y:.1}", if *pen_down { 'L' } else { 'M' });
            *pen_down = true;
        }
        column.clear();
    };
    for place in places {
        let Some(place) = place.filter(|[x, _]| (-1.0..=width + 1.0).contains(x)) else {
            flush(&mut column, &mut pen_down);
            pen_down = false;
            continue;
        };
        if column.first().is_some_and(|first| first[0].floor() != place[0].floor()) {
            flush(&mut column, &mut pen_down);
        }
        column.push(place);
    }
    flush(&mut column, &mut pen_down);
    path
}

/// First, extremes and last of the places in a pixel's width, in their order.
fn thinned(column: &[[f64; 2]]) -> Vec<[f64; 2]> {
    if column.len() <= 4 {
        return column.to_vec();
    }
    let by_height = |a: &usize, b: &usize| column[*a][1].total_cmp(&column[*b][1]);
    let last = column.len() - 1;
    let mut kept = vec![0, last];
    kept.extend((0..column.len()).min_by(by_height));
    kept.extend((0..column.len()).max_by(by_height));
    kept.sort_unstable();
    kept.dedup();
    kept.into_iter().map(|index| column[index]).collect()
}
