//! The size from which an effect can be seen at all.

use super::cases::Case;
use eha_monitor::effect::{EFFECTS, EffectInfo};
use eha_monitor::parameter::Parameter;

/// Most steps of the search for the floor.
const STEPS: usize = 12;

/// What is free about an effect besides its size.
#[derive(Clone, Copy)]
pub(crate) struct Shape {
    /// Is its first parameter on the unusual side of its absence, where it can be on either?
    pub(crate) reversed: bool,
    /// Factor by which its other parameters are not the usual ones.
    pub(crate) stretch: f64,
}

impl Shape {
    /// The shape that the table is made of.
    pub(crate) const USUAL: Self = Self { reversed: false, stretch: 1.0 };

    /// Largest size that makes sense.
    pub(crate) fn most(self, effect: &EffectInfo) -> f64 {
        let info = effect.parameters[0].info();
        0.9 * if self.lowers(effect) { info.default - info.lower } else { info.upper - info.default }
    }

    /// Is the first parameter below its value in absence?
    fn lowers(self, effect: &EffectInfo) -> bool {
        let info = effect.parameters[0].info();
        match info.parameter {
            Parameter::TorqueMotorGain | Parameter::SupplyRatio => !self.reversed,
            // No friction helps the motion, and there is little without it.
            Parameter::RetractionViscosity => false,
            _ => self.reversed && info.lower < info.default,
        }
    }

    /// Parameters of an effect at a size (of its first parameter).
    pub(crate) fn values(self, effect: &EffectInfo, size: f64) -> Vec<(Parameter, f64)> {
        effect
            .parameters
            .iter()
            .map(|&parameter| {
                let info = parameter.info();
                let value = match parameter {
                    Parameter::StepLoadTime => 0.5 * self.stretch,
                    Parameter::MountLag => 1e-4 * self.stretch,
                    Parameter::BaseMass
                    | Parameter::LoadFollowsBase
                    | Parameter::LoopSeesBase
                    | Parameter::PlaySeesBase => info.default,
                    Parameter::SupplySagLag => info.default * self.stretch,
                    Parameter::ThinningVelocity => 0.02 * self.stretch,
                    Parameter::CoggingPitch => 2e-3 * self.stretch,
                    _ if parameter == effect.parameters[0] && self.lowers(effect) => info.default - size,
                    _ => info.default + size,
                };
                (parameter, value.clamp(info.lower, info.upper))
            })
            .collect()
    }
}

/// Size at which the effect, with the faults refitted, is expected to lower chi-square by what it costs to claim it,
/// and to change a channel by more than the model's own error.
pub(crate) fn of(effect: &EffectInfo, shape: &Shape, case: &Case) -> f64 {
    let most = shape.most(effect);
    let mut size = effect.sizes[0];
    for _ in 0..STEPS {
        let factor = (1.0 / reach(effect, shape, size, case)).clamp(0.1, 10.0);
        size = (size * factor).min(most);
        if (factor - 1.0).abs() < 0.03 {
            break;
        }
    }
    size
}

/// What it costs to claim an effect, in chi-square of so many samples.
pub(crate) fn price(effect: &EffectInfo, count: u32) -> f64 {
    effect.parameters.len() as f64 * f64::from(count).ln() + 2.0 * (EFFECTS.len() as f64).ln()
}

/// How far a size is above the floor: 1 at the floor, and proportional to the size where the effect is linear.
pub(crate) fn reach(effect: &EffectInfo, shape: &Shape, size: f64, case: &Case) -> f64 {
    let mut truth = case.truth();
    for (parameter, value) in shape.values(effect, size) {
        truth.parameters.set(parameter, value);
    }
    let left = case.refit(&truth);
    (left.chi_square.max(1e-6) / price(effect, left.count)).sqrt().min(left.largest.max(1e-3))
}
