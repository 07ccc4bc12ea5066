//! An alarm needs evidence over windows: a cumulative sum of log-likelihood ratios for each fault.
//!
//! An estimate with its standard error tells how much more likely the alarmed value is than the healthy one. The sum of
//! that, cut off at zero, is Page's test. Where a sum must reach `h`, the mean time between false alarms is at least
//! `exp(h)` windows (Lorden 1971), so that `h = ln(faults / rate)` keeps the rate of false alarms of all faults
//! together. Nothing is tuned. One window adds at most half of `h`: whatever happens in it, it is no alarm alone.
//!
//! What a window says that the model does not explain waits for the next one that tells of the fault. If the model
//! explains that, the actuator has changed within the first, and both count; if not, the first is dropped: what the
//! model lacks is no fault. Nothing bounds what such a window says of a healthy actuator. So both together add no more
//! than the explained one says by itself: the first lifts the limit of half of `h` for as much as it says, no more, and
//! the rate of false alarms is kept whatever the windows say that are not explained.

use super::config::{Config, Fault};

/// The test of one fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Evidence {
    /// The sum, 0 to the threshold.
    pub(super) sum: f32,
    /// Has it reached the threshold, and not been zero since?
    pub(super) alarmed: bool,
    /// What the last window said, if the model did not explain it.
    pub(super) waiting: f32,
}

/// What a sum must reach.
pub(super) fn threshold<const FAULTS: usize>(config: &Config<FAULTS>) -> f32 {
    // The quotient would be no number where the rate is next to none.
    libm::logf(FAULTS as f32) - libm::logf(config.false_alarm_rate)
}

/// How much more likely the alarmed value is than the healthy one, as a logarithm.
pub(super) fn log_likelihood_ratio(fault: &Fault, value: f32, standard_error: f32) -> f32 {
    let distance = fault.alarm - fault.healthy;
    let middle = 0.5 * (fault.alarm + fault.healthy);
    distance / standard_error * ((value - middle) / standard_error)
}

impl Evidence {
    /// None.
    pub(super) const NONE: Self = Self { sum: 0.0, alarmed: false, waiting: 0.0 };

    /// Takes the evidence of a window that the model explains.
    pub(super) fn take(&mut self, ratio: f32, threshold: f32) {
        let beyond = (ratio - 0.5 * threshold).max(0.0);
        // In this order what is no number stays so, and adds nothing.
        self.add(if self.waiting > beyond { beyond } else { self.waiting }, threshold);
        self.waiting = 0.0;
        self.add(ratio, threshold);
    }

    /// Keeps the evidence of a window that the model does not explain until the next that tells of the fault.
    pub(super) const fn wait(&mut self, ratio: f32) {
        self.waiting = ratio;
    }

    fn add(&mut self, ratio: f32, threshold: f32) {
        if ratio.is_nan() {
            return;
        }
        let added = ratio.max(-threshold).min(0.5 * threshold);
        self.sum = (self.sum + added).max(0.0).min(threshold);
        if self.sum >= threshold {
            self.alarmed = true;
        } else if self.sum == 0.0 {
            self.alarmed = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Form;
    use crate::parameter::{Parameter, Parameters};
    use crate::random::Random;
    use crate::trial::SensorNoise;

    fn two_faults() -> Config<2> {
        let fault = |parameter| Fault::new(parameter, [0.0, 3.0], 1.0, 2.0);
        Config {
            form: Form::default(),
            parameters: Parameters::default(),
            sample_period: 1e-3,
            holds_command: false,
            noise: SensorNoise { user: 5e-6, current: 0.02 },
            faults: [fault(Parameter::Backlash), fault(Parameter::DryFriction)],
            false_alarm_rate: 1e-6,
            seed: 1,
            steps_per_sample: 100,
        }
    }

    /// The worst healthy actuator, at its largest healthy value, with a standard error that lets one window say little.
    #[test]
    fn false_alarms_are_as_rare_as_stated() {
        let (rate, windows) = (1e-2_f32, 200_000_u32);
        let threshold = libm::logf(1.0 / rate);
        let mut random = Random::new(1);
        let mut alarms = 0;
        let mut evidence = Evidence::NONE;
        for _ in 0..windows {
            // Mean and variance of the ratio of two values that are one standard error apart.
            evidence.take(-0.5 + random.bell::<f32>(), threshold);
            if evidence.alarmed {
                alarms += 1;
                evidence = Evidence::NONE;
            }
        }
        assert!(alarms > 0, "a test that cannot alarm keeps any rate");
        assert!(f64::from(alarms) <= f64::from(rate) * f64::from(windows), "{alarms} alarms");
    }

    /// Whatever every second window says that the model does not explain: of a healthy actuator at its largest healthy value,
    /// in the other windows. From windows that tell next to nothing to those that tell it clearly.
    #[test]
    fn windows_that_are_not_explained_raise_no_false_alarms() {
        let (rate, windows) = (1e-3_f32, 400_000_u32);
        let threshold = libm::logf(1.0 / rate);
        for distance in [0.5_f32, 1.0, 2.0, 3.0, 3.7, 4.2] {
            for waiting in [1.0, 0.5 * threshold, f32::INFINITY] {
                let mut random = Random::new(2);
                let (mut alarms, mut evidence) = (0, Evidence::NONE);
                for _ in 0..windows / 2 {
                    evidence.wait(waiting);
                    evidence.take(distance * (random.bell::<f32>() - 0.5 * distance), threshold);
                    if evidence.alarmed {
                        alarms += 1;
                        evidence = Evidence::NONE;
                    }
                }
                let most = f64::from(rate) * f64::from(windows / 2);
                assert!(f64::from(alarms) <= most, "{alarms} alarms for {most} at {distance}, {waiting}");
            }
        }
    }

    #[test]
    fn the_rarest_alarm_has_a_threshold() {
        for rate in [f32::from_bits(1), 1e-39, 1e-20, 1e-6, 0.999_999_9] {
            let config = Config { false_alarm_rate: rate, ..two_faults() };
            let expected = (2.0 / f64::from(rate)).ln();
            let error = f64::from(threshold(&config)) - expected;
            assert!(error.abs() < 2e-7 * expected.max(1.0), "{rate:e}: {error:e}");
        }
    }

    #[test]
    fn one_window_is_never_enough_and_two_can_be() {
        let mut evidence = Evidence::NONE;
        evidence.take(f32::INFINITY, 14.0);
        assert!(!evidence.alarmed);
        evidence.take(f32::NAN, 14.0);
        assert!(!evidence.alarmed);
        evidence.take(1e9, 14.0);
        assert!(evidence.alarmed);
        evidence.take(-1.0, 14.0);
        assert!(evidence.alarmed, "an alarm lasts until the evidence is gone");
        evidence.take(f32::NEG_INFINITY, 14.0);
        assert!(!evidence.alarmed);
    }

    #[test]
    fn a_window_that_is_not_explained_counts_if_the_next_one_is() {
        let (mut change, mut mismatch) = (Evidence::NONE, Evidence::NONE);
        change.wait(1e3);
        change.take(1e3, 14.0);
        assert!(change.alarmed);
        for _ in 0..100 {
            mismatch.wait(1e3);
        }
        assert!(!mismatch.alarmed && mismatch.sum == 0.0);
    }
}
