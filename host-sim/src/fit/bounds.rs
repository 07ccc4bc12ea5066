//! What the bounds of a search have to do with its estimates.

use super::Estimate;
use crate::output::quantity;
use crate::rig::Range;

/// Where the bounds of a search are from: there they can be moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bounds {
    /// The rig or `--bounds`, which the verb takes.
    Option,
    /// The rig alone.
    Rig,
    /// The source.
    Source,
}

/// Share of its range from which on an interval says nothing.
const ALL: f64 = 0.9;

/// What the user should know of estimates that their ranges, in the same order, had a hand in: one that sits on a bound
/// might be beyond it, unless nothing is; one whose interval is nearly all of its range is no estimate.
pub fn remarks<'a>(
    estimates: impl IntoIterator<Item = &'a Estimate>,
    ranges: &[Range],
    bounds: Bounds,
) -> Vec<String> {
    estimates
        .into_iter()
        .zip(ranges)
        .filter_map(|(estimate, range)| remark(estimate, range, bounds))
        .collect()
}

/// Do records say anything of a parameter: is its interval more than its range told before?
pub fn is_told(estimate: &Estimate, range: &Range) -> bool {
    let width = range.upper - range.lower;
    estimate.ci95[1] - estimate.ci95[0] < ALL * width && estimate.standard_error.is_finite()
}

fn remark(estimate: &Estimate, range: &Range, bounds: Bounds) -> Option<String> {
    let (info, width) = (range.parameter.info(), range.upper - range.lower);
    let name = info.name;
    if !is_told(estimate, range) {
        return Some(format!(
            "these records say nothing about {name}: its interval is all of its range, or nearly"
        ));
    }
    let (end, bound, wider) = match range.may_be_beyond(estimate.value) {
        [true, _] => ("lower", range.lower, [(range.lower - width).max(info.lower), range.upper]),
        [_, true] => ("upper", range.upper, [range.lower, (range.upper + width).min(info.upper)]),
        [false, false] => return None,
    };
    let advice = match bounds {
        Bounds::Option => format!(": widen its range with `--bounds {name}={}..{}`", wider[0], wider[1]),
        Bounds::Rig => ": widen its range in the rig file".to_owned(),
        Bounds::Source => String::new(),
    };
    Some(format!("{name} is at its {end} bound ({}){advice}", quantity(bound, info.unit)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use eha_monitor::parameter::Parameter;

    fn said(parameter: Parameter, [lower, upper]: [f64; 2], value: f64, error: f64) -> Vec<String> {
        let range = Range { parameter, lower, upper };
        remarks(&[Estimate::new(&range, value, error)], &[range], Bounds::Option)
    }

    #[test]
    fn an_estimate_on_a_bound_might_be_beyond_it() {
        let fdj = |value, error| said(Parameter::DryFriction, [200.0, 4000.0], value, error);
        assert_eq!(
            fdj(4000.0, 20.0),
            ["fdj is at its upper bound (4000.000 N): widen its range with `--bounds fdj=200..7800`"]
        );
        assert_eq!(
            fdj(200.0, 20.0),
            ["fdj is at its lower bound (200.000 N): widen its range with `--bounds fdj=0..4000`"]
        );
        assert_eq!(fdj(3999.0, 20.0), [""; 0]);
        // There is no backlash below none.
        assert_eq!(said(Parameter::Backlash, [0.0, 1e-3], 0.0, 1e-6), [""; 0]);
    }

    #[test]
    fn an_interval_of_all_of_the_range_is_no_estimate() {
        let nothing = ["these records say nothing about fdj: its interval is all of its range, or nearly"];
        for error in [1e4, f64::INFINITY, f64::NAN] {
            assert_eq!(said(Parameter::DryFriction, [200.0, 4000.0], 4000.0, error), nothing);
        }
        assert_eq!(said(Parameter::DryFriction, [200.0, 4000.0], 2000.0, 300.0), [""; 0]);
    }
}
