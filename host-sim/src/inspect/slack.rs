//! Does one position follow another with play?

use crate::fit;
use eha_monitor::model::play::play;
use nalgebra::{Matrix4, Matrix5, Vector5};

/// Widths of the play that are tried.
const WIDTHS: u32 = 16;
/// Time over which a speed is taken, s.
const SPEED_S: f64 = 0.01;

/// Mean square of what is left of a position if it follows another one with a play of the best width, or none, and a
/// sensor of any offset and gain; either sensor may lag.
pub(super) fn left_behind(follower: &[f64], leader: &[f64], period: f64) -> f64 {
    if follower.is_empty() || leader.is_empty() {
        return 0.0;
    }
    let apart: Vec<f64> = follower.iter().zip(leader).map(|(a, b)| a - b).collect();
    let [low, high] = fit::extent(&apart);
    let widest = 0.5 * (high - low);
    let reach = ((0.5 * SPEED_S / period).round() as usize).max(1);
    (0..=WIDTHS)
        .map(|step| {
            let led = behind(leader, widest * f64::from(step) / f64::from(WIDTHS));
            unexplained(follower, &led, reach)
        })
        .fold(f64::INFINITY, f64::min)
}

/// Where a play of that half width leads; no number where a sample is lost.
fn behind(leader: &[f64], half: f64) -> Vec<f64> {
    let mut output = leader.iter().copied().find(|value| value.is_finite()).unwrap_or_default();
    let follow = |&input: &f64| {
        if input.is_nan() {
            return f64::NAN;
        }
        output = play(input, output, half);
        output
    };
    leader.iter().map(follow).collect()
}

/// Mean square of what an offset, a gain and lags leave of a series that another one explains; `reach` is the number of
/// samples on either side that a speed is taken from. What lags shows its own speed, and what it follows that of the
/// other: with one of them alone, a lag would tell the two apart.
fn unexplained(series: &[f64], by: &[f64], reach: usize) -> f64 {
    let inner = reach..series.len().saturating_sub(reach);
    let [low, high] = fit::extent(by);
    let (middle, scale) = (0.5 * (low + high), (0.5 * (high - low)).max(f64::MIN_POSITIVE));
    let rows = inner.map(|sample| {
        let [own_speed, speed] = [series, by].map(|of| (of[sample + reach] - of[sample - reach]) / scale);
        let value = (by[sample] - middle) / scale;
        Vector5::new(1.0, value, speed, own_speed, (series[sample] - by[sample]) / scale)
    });
    // Normal equations of the first four, the series itself beside them: what is left is the last pivot.
    let mut squares = Matrix5::<f64>::zeros();
    let mut count = 0.0;
    for row in rows.filter(|row| row.iter().all(|value| value.is_finite())) {
        squares += row * row.transpose();
        count += 1.0;
    }
    let known = squares.fixed_view::<4, 4>(0, 0) + Matrix4::from_diagonal_element(1e-12 * count);
    let side = squares.fixed_view::<4, 1>(0, 4).into_owned();
    let explained = known.cholesky().map_or(0.0, |factor| side.dot(&factor.solve(&side)));
    scale * scale * (squares[(4, 4)] - explained).max(0.0) / f64::max(count, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 1e-3;

    /// A motion of some millimetres that turns at several heights, and noise of 5 um on it.
    fn motion(seed: f64, half: f64) -> Vec<f64> {
        let angle = |k: u32| std::f64::consts::TAU * f64::from(k) * PERIOD;
        let ram: Vec<f64> =
            (0..2000).map(|k| 4e-3 * (2.0 * angle(k)).sin() + 2e-3 * (3.1 * angle(k)).cos()).collect();
        let noise = |k: usize| 17e-6 * (((k as f64 + seed) * 12.9898).sin() * 43_758.545_3).fract() * 0.5;
        behind(&ram, half).iter().enumerate().map(|(k, value)| value + noise(k)).collect()
    }

    #[test]
    fn the_one_that_has_the_play_is_the_follower() {
        for half in [1e-4, 2.5e-5] {
            let [ram, user] = [motion(0.3, 0.0), motion(0.7, half)];
            let [right, wrong] = [left_behind(&user, &ram, PERIOD), left_behind(&ram, &user, PERIOD)];
            assert!(wrong > 2.0 * right, "{half}: {right:e} {wrong:e}");
        }
    }

    #[test]
    fn neither_follows_where_there_is_no_play() {
        let [one, other] = [motion(0.3, 0.0), motion(0.7, 0.0)];
        // A sensor with an offset and a gain of its own, which is two samples late.
        let other: Vec<f64> = (0..other.len()).map(|k| 1e-3 + 1.02 * other[k.saturating_sub(2)]).collect();
        let [there, back] = [left_behind(&one, &other, PERIOD), left_behind(&other, &one, PERIOD)];
        assert!((0.5..2.0).contains(&(there / back)), "{there:e} {back:e}");
    }

    #[test]
    fn a_sensor_that_lags_is_no_play() {
        let ram = motion(0.3, 0.0);
        for lag in [2e-3, 1e-2] {
            let mut state = ram[0];
            let noise = motion(0.7, 0.0).into_iter().zip(motion(0.9, 0.0)).map(|(a, b)| a - b);
            let follow = |&input: &f64| {
                state += (input - state) * PERIOD / lag;
                state
            };
            let user: Vec<f64> = ram.iter().map(follow).zip(noise).map(|(a, b)| a + b).collect();
            let [there, back] = [left_behind(&user, &ram, PERIOD), left_behind(&ram, &user, PERIOD)];
            assert!((0.5..2.0).contains(&(there / back)), "{lag}: {there:e} {back:e}");
        }
    }

    #[test]
    fn lost_samples_do_not_count() {
        let [mut ram, user] = [motion(0.3, 0.0), motion(0.7, 1e-4)];
        let whole = left_behind(&user, &ram, PERIOD);
        ram[700..705].fill(f64::NAN);
        assert!((left_behind(&user, &ram, PERIOD) / whole - 1.0).abs() < 0.2);
    }
}
