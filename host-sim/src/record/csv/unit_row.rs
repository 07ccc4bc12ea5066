//! A row of units under the header.

use csv::StringRecord;

use super::super::error::Problem;
use super::super::mapping::{Found, UnitFrom, option};
use super::super::units::{Unit, unit, units_of};

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
        let wrong =
            |expected: String| Err((column.source, Problem::WrongUnit { found: cell.to_owned(), expected }));
        match (column.unit, unit_of(cell)) {
            (UnitFrom::Mapping | UnitFrom::Row, _) | (UnitFrom::Name, None) => {}
            (UnitFrom::Name, Some(unit)) if unit.symbol == info.unit => column.unit = UnitFrom::Row,
            (UnitFrom::Name, Some(unit)) => {
                let hint = option(&format!("{}={name}[{}]", info.column, unit.symbol));
                return wrong(format!("{} as the name says; if it is that unit, {hint}", info.unit));
            }
            (UnitFrom::Nothing, Some(unit)) if unit.base == info.unit => {
                column.factor = unit.factor;
                column.unit = UnitFrom::Row;
                if unit.factor != 1.0 {
                    told.push(format!("`{name}` in {}", unit.symbol));
                }
            }
            (UnitFrom::Nothing, None) if cell.is_empty() || cell == "-" => {}
            (UnitFrom::Nothing, _) => {
                let known: Vec<&str> = units_of(info).map(|unit| unit.symbol).collect();
                return wrong(format!("one of {}", known.join(", ")));
            }
        }
    }
    Ok(told)
}

/// The unit that a cell names, in brackets or without.
fn unit_of(cell: &str) -> Option<&'static Unit> {
    unit(cell.trim_start_matches(['[', '(']).trim_end_matches([']', ')']))
}
