//! The numbers in the cells of a text file.

use super::super::error::{Problem, printable};

/// Longest part of a cell that a message repeats.
const QUOTED_CHARACTERS: usize = 40;

/// What programs write where a sample is missing, in any case: numeric ones, data bases, spreadsheets, run-time libraries of C.
const LOST: [&str; 13] = [
    "nan",
    "-nan",
    "na",
    "n/a",
    "<na>",
    "null",
    "none",
    "#n/a",
    "#nv",
    "nan(ind)",
    "-nan(ind)",
    "1.#qnan",
    "-1.#ind",
];

/// Line and column, from 0, of a cell.
pub(super) type Place = (u64, usize);

/// Reads the cells of a file, with decimal points or decimal commas, the same throughout.
pub(super) struct Cells {
    /// May a comma be within a cell?
    takes_commas: bool,
    has_points: bool,
    /// The first cell with a comma, and the text.
    comma: Option<(Place, String)>,
    /// Can the commas be nothing but decimal ones?
    is_decimal: bool,
}

impl Cells {
    /// The cells between separators of this kind.
    pub(super) const fn new(separator: u8) -> Self {
        Self { takes_commas: separator != b',', has_points: false, comma: None, is_decimal: false }
    }

    /// The value of a cell; NaN where the sample is missing.
    pub(super) fn number(&mut self, cell: &str, place: Place) -> Result<f64, Problem> {
        if is_blank(cell) {
            return Ok(f64::NAN);
        }
        let comma = with_point(cell);
        self.has_points |= comma.is_none() && cell.contains('.');
        let value = match &comma {
            None => cell.parse::<f64>(),
            Some(_) if !self.takes_commas => return Err(Problem::DecimalComma(shown(cell))),
            Some(text) => {
                self.is_decimal |= !is_group(cell);
                self.comma.get_or_insert_with(|| (place, shown(cell)));
                text.parse::<f64>()
            }
        };
        match value {
            Ok(_) if self.has_points && self.comma.is_some() => Err(Problem::MixedDecimals(shown(cell))),
            Ok(value) if value.is_finite() => Ok(value),
            Ok(_) => Err(Problem::NotFinite(shown(cell))),
            Err(_) => Err(Problem::NotANumber(shown(cell))),
        }
    }

    /// Once all are read: commas that may all set thousands apart are not taken for decimal ones.
    pub(super) fn check(self) -> Result<(), (Place, Problem)> {
        match self.comma {
            Some((place, text)) if !self.is_decimal => Err((place, Problem::OpenComma(text))),
            _ => Ok(()),
        }
    }
}

/// Does a cell say that a sample is missing?
pub(super) fn is_blank(cell: &str) -> bool {
    cell.is_empty() || LOST.iter().any(|lost| cell.eq_ignore_ascii_case(lost))
}

/// As much of a cell as a message repeats.
pub(super) fn shown(cell: &str) -> String {
    printable(cell, QUOTED_CHARACTERS)
}

/// The cell with a point in place of its comma, if that makes it a number.
pub(super) fn with_point(cell: &str) -> Option<String> {
    let (whole, fraction) = cell.split_once(',')?;
    let text = format!("{whole}.{fraction}");
    text.parse::<f64>().is_ok().then_some(text)
}

/// May the comma of a cell set thousands apart, as in `1,234`?
fn is_group(cell: &str) -> bool {
    let digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    cell.trim_start_matches(['+', '-']).split_once(',').is_some_and(|(whole, fraction)| {
        digits(whole)
            && digits(fraction)
            && fraction.len() == 3
            && (1..=3).contains(&whole.len())
            && !whole.starts_with('0')
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The values of cells between semicolons, or the message of what is wrong, with the number of the cell.
    fn read(cells: &[&str]) -> Result<Vec<f64>, String> {
        let mut all = Cells::new(b';');
        let values = cells.iter().enumerate().map(|(column, cell)| all.number(cell, (1, column)));
        let values = values.collect::<Result<_, _>>().map_err(|problem| problem.to_string())?;
        all.check().map_err(|((_, column), problem)| format!("{column}: {problem}"))?;
        Ok(values)
    }

    #[test]
    fn commas_are_decimal_where_they_can_be_nothing_else() {
        assert_eq!(read(&["1,5", "-0,25e-1", "3", ",5", "1,234"]), Ok(vec![1.5, -0.025, 3.0, 0.5, 1.234]));
        assert_eq!(read(&["1.5", "2", "-3e2"]), Ok(vec![1.5, 2.0, -300.0]));
        assert_eq!(read(&["0,001"]), Ok(vec![0.001]));
        let open =
            "1: found `1,234`, which is 1.234 or 1234, expected decimal points or commas that leave no doubt";
        assert_eq!(read(&["7", "1,234", "-12,500"]), Err(open.to_owned()));
    }

    #[test]
    fn one_file_has_one_decimal_sign() {
        let mixed =
            |text: &str| Err(format!("found `{text}`, expected decimal points or decimal commas, not both"));
        assert_eq!(read(&["1,5", "1.5"]), mixed("1.5"));
        assert_eq!(read(&["1.5", "1,5"]), mixed("1,5"));
        for neither in ["1.234,5", "1,234,567", "1,5x"] {
            assert_eq!(read(&[neither]), Err(format!("found `{neither}`, expected a number")));
        }
    }
}
