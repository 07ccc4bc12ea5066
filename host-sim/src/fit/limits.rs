//! Samples at the end of what a sensor shows.

/// Samples in a row that make a rest.
const IN_A_ROW: usize = 3;
/// Share of its samples at its ends from which on a series is called clipped.
pub const CLIPPED: f64 = 0.01;

/// Smallest and largest of the values that are not missing.
pub fn extent(values: &[f64]) -> [f64; 2] {
    values
        .iter()
        .filter(|value| value.is_finite())
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &value| [low.min(value), high.max(value)])
}

/// Does a sample rest at the smallest or largest value of its series? One is always at each; a limit shows as a run of
/// equal values.
pub fn at_ends(values: &[f64]) -> Vec<bool> {
    let [low, high] = extent(values);
    values
        .chunk_by(|a, b| a == b)
        .flat_map(|run| {
            let rests = run.len() >= IN_A_ROW && (run[0] == low || run[0] == high);
            std::iter::repeat_n(rests, run.len())
        })
        .collect()
}

/// Share of the samples of a series that rest at its ends.
pub fn share_at_ends(values: &[f64]) -> f64 {
    share(&at_ends(values))
}

/// The longest rest of a series at its smallest or largest value, and the longest at any other, in samples that count.
pub fn longest_rests(values: &[f64], counts: impl Fn(usize) -> bool) -> [usize; 2] {
    let [low, high] = extent(values);
    let mut longest = [0; 2];
    let mut start = 0;
    for run in values.chunk_by(|a, b| a == b) {
        let end = start + run.len();
        let rests = &mut longest[usize::from(run[0] != low && run[0] != high)];
        *rests = (*rests).max((start..end).filter(|&sample| counts(sample)).count());
        start = end;
    }
    longest
}

fn share(resting: &[bool]) -> f64 {
    resting.iter().filter(|&&rests| rests).count() as f64 / resting.len().max(1) as f64
}

/// The series without what is clipped, as long as that leaves half of it: what does not move shows no noise.
pub(super) fn unclipped(values: &[f64]) -> Vec<f64> {
    let resting = at_ends(values);
    if !(CLIPPED..0.5).contains(&share(&resting)) {
        return values.to_vec();
    }
    let keep = |(&value, rests): (&f64, bool)| if rests { f64::NAN } else { value };
    values.iter().zip(resting).map(keep).collect()
}

#[cfg(test)]
mod tests {
    use super::longest_rests;

    #[test]
    fn rests_at_the_ends_are_told_from_those_elsewhere() {
        let values = [1.0, 2.0, 2.0, 2.0, 1.0, 1.5, 1.5, 1.0, 1.0];
        assert_eq!(longest_rests(&values, |_| true), [3, 2]);
        assert_eq!(longest_rests(&values, |sample| sample > 2), [2, 2]);
        assert_eq!(longest_rests(&[], |_| true), [0, 0]);
    }
}
