//! The size from which an effect can be seen at all.

use crate::cases::Case;
use eha_monitor::effect::{EFFECTS, EffectInfo};
use eha_monitor::parameter::Parameter;

/// Most steps of the search for the floor.
const STEPS: usize = 12;

/// Parameters of an effect at a size (of its first parameter).
pub(crate) fn values(effect: &EffectInfo, size: f64) -> Vec<(Parameter, f64)> {
    effect
        .parameters
        .iter()
        .map(|&parameter| {
            let info = parameter.info();
            let value = match parameter {
                Parameter::StepLoadTime => 0.5,
                Parameter::MountDamping => 0.1,
                Parameter::ThinningVelocity => 0.02,
                Parameter::CoggingPitch => 2e-3,
                Parameter::TorqueMotorGain | Parameter::SupplyRatio => info.default - size,
                _ => info.default + size,
            };
            (parameter, value.clamp(info.lower, info.upper))
        })
        .collect()
}

/// Size at which the effect, with the faults refitted, is expected to lower chi-square by what it costs to claim it,
/// and to change a channel by more than the model's own error.
pub(crate) fn of(effect: &EffectInfo, case: &Case) -> f64 {
    let info = effect.parameters[0].info();
    let most = 0.9 * (info.upper - info.default).max(info.default - info.lower);
    let mut size = effect.sizes[0];
    for _ in 0..STEPS {
        let factor = (1.0 / reach(effect, size, case)).clamp(0.1, 10.0);
        size = (size * factor).min(most);
        if (factor - 1.0).abs() < 0.03 {
            break;
        }
    }
    size
}

/// How far a size is above the floor: 1 at the floor, and proportional to the size where the effect is linear.
pub(crate) fn reach(effect: &EffectInfo, size: f64, case: &Case) -> f64 {
    let mut truth = case.truth();
    for (parameter, value) in values(effect, size) {
        truth.parameters.set(parameter, value);
    }
    let left = case.refit(&truth);
    let price =
        effect.parameters.len() as f64 * f64::from(left.count).ln() + 2.0 * (EFFECTS.len() as f64).ln();
    (left.chi_square.max(1e-6) / price).sqrt().min(left.largest.max(1e-3))
}
