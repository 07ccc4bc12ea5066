//! The source's twelve cases, and its figures of merit.

use crate::rig::Range;
use eha_monitor::parameter::Parameter;

/// One case of the source: what it put in, what it got out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// Its number.
    pub number: u32,
    /// Command.
    pub command: &'static str,
    /// Backlash put in, m.
    pub bkl: f64,
    /// Dry friction put in, N.
    pub fdj: f64,
    /// Backlash that the source got, m.
    pub source_bkl: f64,
    /// Dry friction that the source got, N.
    pub source_fdj: f64,
    /// Population of the source's search.
    pub population: usize,
    /// Bounds of the dry friction in our search, N. The source's are 200 to 4000 (case 7: 200 to 900); case 1 lies
    /// outside them and gets bounds that contain it.
    pub fdj_bounds: [f64; 2],
}

/// Bounds of the backlash in every case, m.
pub const BKL_BOUNDS: [f64; 2] = [0.0, 1.5e-3];

const WIDE: [f64; 2] = [200.0, 4000.0];
const NARROW: [f64; 2] = [200.0, 900.0];

/// The twelve cases.
pub const CASES: [Case; 12] = [
    case(1, "mixed", [1e-3, 6400.0], [4.6792e-3, 2885.5684], 20, [200.0, 8000.0]),
    case(2, "mixed", [2e-4, 800.0], [4.5249e-4, 1070.98], 20, WIDE),
    case(3, "chirp", [0.0, 400.0], [3.3477e-5, 554.223], 20, WIDE),
    case(4, "chirp", [0.0, 800.0], [8.5831e-6, 596.9125], 20, WIDE),
    case(5, "chirp", [0.0, 1600.0], [3.634e-5, 1799.0696], 20, WIDE),
    case(6, "chirp", [0.0, 3200.0], [3.0162e-5, 3567.2466], 20, WIDE),
    case(7, "chirp", [0.0, 400.0], [0.0, 421.8742], 20, NARROW),
    case(8, "chirp", [1e-4, 200.0], [1.0113e-4, 200.0], 20, WIDE),
    case(9, "chirp", [2e-4, 200.0], [2.0156e-4, 200.0], 20, WIDE),
    case(10, "chirp", [5e-4, 200.0], [5.0238e-4, 200.0], 20, WIDE),
    case(11, "chirp", [1e-3, 200.0], [1.0054e-3, 200.0], 20, WIDE),
    case(12, "chirp", [1e-4, 800.0], [1.0593e-4, 832.5374], 40, WIDE),
];

const fn case(
    number: u32,
    command: &'static str,
    input: [f64; 2],
    source: [f64; 2],
    population: usize,
    fdj_bounds: [f64; 2],
) -> Case {
    Case {
        number,
        command,
        bkl: input[0],
        fdj: input[1],
        source_bkl: source[0],
        source_fdj: source[1],
        population,
        fdj_bounds,
    }
}

/// The source's relative error of an output against its input, percent; 0 where the input is 0.
pub fn error_percent(input: f64, output: f64) -> f64 {
    if input == 0.0 { 0.0 } else { (input - output) / input * 100.0 }
}

impl Case {
    /// Ranges of the search.
    pub fn ranges(&self) -> Vec<Range> {
        vec![
            Range { parameter: Parameter::Backlash, lower: BKL_BOUNDS[0], upper: BKL_BOUNDS[1] },
            Range { parameter: Parameter::DryFriction, lower: self.fdj_bounds[0], upper: self.fdj_bounds[1] },
        ]
    }

    /// The source's figure of merit for an estimate: mean of the magnitudes of both relative errors, percent; an error
    /// counts as 0 where the input is 0.
    pub fn mean_error_percent(&self, bkl: f64, fdj: f64) -> f64 {
        let error = |input: f64, output: f64| error_percent(input, output).abs();
        f64::midpoint(error(self.bkl, bkl), error(self.fdj, fdj))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sources_own_errors_span_what_it_reports() {
        let errors: Vec<f64> =
            CASES.iter().map(|case| case.mean_error_percent(case.source_bkl, case.source_fdj)).collect();
        let (low, high) =
            errors.iter().fold((f64::MAX, 0.0_f64), |(low, high), &e| (low.min(e), high.max(e)));
        assert!((low - 0.24).abs() < 0.01 && (high - 211.4).abs() < 0.5, "{errors:?}");
    }

    #[test]
    fn every_case_lies_inside_its_bounds() {
        for case in CASES {
            assert!((BKL_BOUNDS[0]..=BKL_BOUNDS[1]).contains(&case.bkl));
            assert!((case.fdj_bounds[0]..=case.fdj_bounds[1]).contains(&case.fdj));
        }
    }
}
