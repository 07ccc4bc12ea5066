//! A row of units under the header.

use csv::StringRecord;

use super::super::error::Problem;
use super::super::mapping::{Found, UnitFrom, option};
use super::super::units::{Unit, unit, unit_in_words, units_of};
use super::cells::shown;

/// Is a row one of units? No cell that is read holds a number, and at least one a unit that is known.
pub(super) fn is_one(columns: &[Found<usize>], row: &StringRecord) -> bool {
    let cells = || columns.iter().filter_map(|column| row.get(column.source));
    cells().all(|cell| cell.parse::<f64>().is_err()) && cells().any(|cell| unit_of(cell).is_some())
}

/// Takes the units of a row for the columns of which nothing else says one; names those whose values they change.
///
/// # Errors
/// The place of a column whose unit is not known, measures something else, or is not the one in its name.
pub(super) fn apply(
    columns: &mut [Found<usize>],
    names: &[String],
    row: &StringRecord,
) -> Result<Vec<String>, (usize, Problem)> {
    let mut told = Vec::new();
    for column in columns {
        let info = column.channel.info();
        let cell = row.get(column.source).unwrap_or_default();
        let name = &names[column.source];
        let says = |scaling: &str| option(&format!("{}={name}{scaling}", info.column));
        let wrong =
            |expected: String| Err((column.source, Problem::WrongUnit { found: shown(cell), expected }));
        let unit = unit_of(cell);
        match column.unit {
            UnitFrom::Mapping | UnitFrom::Row => {}
            UnitFrom::Name | UnitFrom::Nothing if is_none(cell) => {}
            UnitFrom::Name => match unit {
                Some(unit) if unit.symbol == info.unit => column.unit = UnitFrom::Row,
                Some(unit) if unit.base == info.unit => {
                    let hint = says(&format!("[{}]", unit.symbol));
                    return wrong(format!("{} as the name says; if it is that unit, {hint}", info.unit));
                }
                _ => {
                    return wrong(format!(
                        "{0} as the name says; if it is {0}, {1}; else give the scale in {0} per unit, as in {2}",
                        info.unit,
                        says(&format!("[{}]", info.unit)),
                        says("*1.5e-5")
                    ));
                }
            },
            UnitFrom::Nothing => match unit {
                Some(unit) if unit.base == info.unit => {
                    column.factor = unit.factor;
                    column.unit = UnitFrom::Row;
                    if unit.factor != 1.0 {
                        told.push(format!("`{name}` in {}", unit.symbol));
                    }
                }
                _ => {
                    let known: Vec<&str> = units_of(info).map(|unit| unit.symbol).collect();
                    return wrong(format!(
                        "one of {}; say which, as in {}, or give the scale in {} per unit, as in {}",
                        known.join(", "),
                        says(&format!("[{}]", info.unit)),
                        info.unit,
                        says("*1.5e-5")
                    ));
                }
            },
        }
    }
    Ok(told)
}

/// A cell without the brackets around it.
fn bare(cell: &str) -> &str {
    cell.trim_start_matches(['[', '(']).trim_end_matches([']', ')']).trim()
}

/// Does a cell name no unit?
fn is_none(cell: &str) -> bool {
    matches!(bare(cell), "" | "-")
}

/// The unit that a cell names, by its symbol or in words.
fn unit_of(cell: &str) -> Option<&'static Unit> {
    unit(bare(cell)).or_else(|| unit_in_words(bare(cell)))
}
