//! The size from which an effect can be seen at all.

use crate::cases::Case;
use crate::common::Rig as Truth;
use eha_monitor::effect::{EFFECTS, EffectInfo};
use eha_monitor::parameter::Parameter;

/// Parameters of an effect at a size (of its first parameter).
pub(crate) fn values(effect: &EffectInfo, size: f64) -> Vec<(Parameter, f64)> {
    effect
        .parameters
        .iter()
        .map(|&parameter| {
            let value = match parameter {
                Parameter::StepLoadTime => 0.5,
                Parameter::MountDamping => 0.1,
                Parameter::TorqueMotorGain | Parameter::SupplyRatio => parameter.info().default - size,
                _ => parameter.info().default + size,
            };
            (parameter, value.clamp(parameter.info().lower, parameter.info().upper))
        })
        .collect()
}

/// Size at which the effect, with the faults refitted, is expected to lower chi-square by what it costs to claim it,
/// and to change a channel by more than the model's own error.
pub(crate) fn of(effect: &EffectInfo, case: &Case) -> f64 {
    let mut size = effect.sizes[0];
    for _ in 0..6 {
        let (chi_square, count, largest) = visible(effect, size, case);
        let price =
            effect.parameters.len() as f64 * f64::from(count).ln() + 2.0 * (EFFECTS.len() as f64).ln();
        let factor = (price / chi_square.max(1e-6)).sqrt().max(1.0 / largest.max(1e-3)).clamp(0.1, 10.0);
        size *= factor;
        let info = effect.parameters[0].info();
        size = size.min(0.9 * (info.upper - info.default).max(info.default - info.lower));
        if (factor - 1.0).abs() < 0.03 {
            break;
        }
    }
    size
}

fn visible(effect: &EffectInfo, size: f64, case: &Case) -> (f64, u32, f64) {
    let mut truth: Truth = case.truth();
    for (parameter, value) in values(effect, size) {
        truth.parameters.set(parameter, value);
    }
    case.refit(&truth)
}
