//! The catalogue of physical effects: one entry an effect.
//!
//! An effect is a set of [`Parameter`]s that are zero (or at the source's value) where it is absent; the blocks of
//! [`crate::model`] hold its equation. Units and bounds are those of the parameters.

use crate::parameter::{Parameter, Parameters};
use crate::scalar::Real;

/// Where in the loop an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Port {
    /// Between the current and the spool.
    Valve,
    /// Between the spool and the pressure on the jack.
    Fluid,
    /// A force on the ram.
    Force,
    /// Between the drive that a record tells and the force on the ram.
    Drive,
    /// What the LVDT makes of the position, outside the loop.
    Sensor,
}

impl Port {
    /// Name for lists.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Valve => "valve",
            Self::Fluid => "fluid",
            Self::Force => "force",
            Self::Drive => "drive",
            Self::Sensor => "sensor",
        }
    }
}

/// An entry of the catalogue.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct EffectInfo {
    /// Name that users type and read.
    pub name: &'static str,
    /// Where it acts.
    pub port: Port,
    /// Its equation, in the symbols of the design.
    pub equation: &'static str,
    /// What it adds to the model.
    pub parameters: &'static [Parameter],
    /// Size of each parameter, as a change from its absence, that is plain to see in a second of motion: the unit of
    /// its search. Not a bound.
    pub sizes: &'static [f64],
}

const fn entry(
    name: &'static str,
    port: Port,
    equation: &'static str,
    parameters: &'static [Parameter],
    sizes: &'static [f64],
) -> EffectInfo {
    EffectInfo { name, port, equation, parameters, sizes }
}

/// Every effect that the model can have beyond its declared faults.
pub const EFFECTS: &[EffectInfo] = &[
    entry("valve-offset", Port::Valve, "F = GM (Cor + Ofs)", &[Parameter::CurrentOffset], &[0.1]),
    entry(
        "torque-motor-hysteresis",
        Port::Valve,
        "F = GM play(Cor, His)",
        &[Parameter::TorqueMotorHysteresis],
        &[0.05],
    ),
    entry(
        "torque-motor-gain",
        Port::Valve,
        "F = GM Cor, GM not the rated one",
        &[Parameter::TorqueMotorGain],
        &[1e-3],
    ),
    entry(
        "feedback-play",
        Port::Valve,
        "feedback spring force KSF play(XS, gioco)",
        &[Parameter::FeedbackPlay],
        &[2e-6],
    ),
    entry("filter-clogging", Port::Valve, "GQF (1 - Kint)", &[Parameter::FilterClogging], &[0.1]),
    entry(
        "spool-friction",
        Port::Valve,
        "friction of the spool FSS, sliding FSS/FSDS",
        &[Parameter::SpoolFriction],
        &[5.0],
    ),
    entry(
        "spool-overlap",
        Port::Fluid,
        "dead zone of half width OVL on XS",
        &[Parameter::SpoolOverlap],
        &[1e-5],
    ),
    entry(
        "flow-asymmetry",
        Port::Fluid,
        "XS (1 + af sgn(XS)) into the fluid",
        &[Parameter::FlowAsymmetry],
        &[0.02],
    ),
    entry(
        "turbulent-metering",
        Port::Fluid,
        "AJ v = GQ XS ((1-b) + b sqrt((PSR - sgn(XS) P12)/PSR0)) - (1/GPQ + Clk) P12",
        &[Parameter::MeteringBlend],
        &[0.2],
    ),
    entry("pressure-gain", Port::Fluid, "GP, with GQ kept", &[Parameter::PressureGain], &[2e10]),
    entry("leakage", Port::Fluid, "Clk P12", &[Parameter::Leakage], &[1e-12]),
    entry(
        "supply-pressure",
        Port::Fluid,
        "PSR = k PSR0: GP by k, GQ by sqrt(k)",
        &[Parameter::SupplyRatio],
        &[0.05],
    ),
    entry(
        "supply-sag",
        Port::Fluid,
        "k = 1 - s abs(v), lagged by ts, some 50 ms",
        &[Parameter::SupplySag, Parameter::SupplySagLag],
        &[0.3, 0.05],
    ),
    entry(
        "compressibility",
        Port::Fluid,
        "P12' = 4 beta/Vt (Q - AJ v - Clk P12), Vt = 2 AJ XJM",
        &[Parameter::OilCompliance],
        &[1e-9],
    ),
    entry(
        "stribeck",
        Port::Force,
        "FDJ + (FSD-1) FDJ exp(-abs(v)/vs)",
        &[Parameter::StribeckVelocity],
        &[5e-3],
    ),
    entry(
        "friction-asymmetry",
        Port::Force,
        "friction (1 + a sgn v)",
        &[Parameter::FrictionAsymmetry],
        &[0.2],
    ),
    entry("viscous-friction", Port::Force, "CJ v", &[Parameter::ViscousFriction], &[1000.0]),
    entry(
        "viscous-asymmetry",
        Port::Force,
        "CJ v, and cr v besides where v < 0",
        &[Parameter::RetractionViscosity],
        &[300.0],
    ),
    entry(
        "shear-thinning",
        Port::Force,
        "ct v/(1 + abs(v)/vt)",
        &[Parameter::ThinningViscosity, Parameter::ThinningVelocity],
        &[3000.0, 0.02],
    ),
    entry("quadratic-drag", Port::Force, "c2 v abs(v)", &[Parameter::QuadraticDrag], &[1e4]),
    entry("constant-load", Port::Force, "F", &[Parameter::ConstantLoad], &[100.0]),
    entry("spring-load", Port::Force, "Kaer x", &[Parameter::SpringLoad], &[5e3]),
    entry(
        "step-load",
        Port::Force,
        "F from time t1 on",
        &[Parameter::StepLoad, Parameter::StepLoadTime],
        &[100.0, 0.1],
    ),
    entry(
        "cogging",
        Port::Force,
        "Fc cos(2 pi x/p) + Fs sin(2 pi x/p)",
        &[Parameter::CoggingCosine, Parameter::CoggingSine, Parameter::CoggingPitch],
        &[100.0, 100.0, 1e-3],
    ),
    entry("load-mass", Port::Force, "MJ v'", &[Parameter::LoadMass], &[10.0]),
    entry(
        "mount-compliance",
        Port::Force,
        "mb xb'' + cb xb' + k xb = -(AJ P12 - CJ v - friction), MJ (v' + sl xb'') = -that - loads; x_user = play(x + sp xb) + (1 - sp) xb, the loop sees x + sb xb",
        &[
            Parameter::MountCompliance,
            Parameter::MountLag,
            Parameter::BaseMass,
            Parameter::LoadFollowsBase,
            Parameter::LoopSeesBase,
            Parameter::PlaySeesBase,
        ],
        &[2e-8, 5e-5, 5.0, 0.5, 0.5, 0.5],
    ),
    entry("drive-lag", Port::Drive, "tau F' + F = drive", &[Parameter::DriveLag], &[5e-4]),
    entry("sensor-offset", Port::Sensor, "lvdt = x_user + o", &[Parameter::SensorOffset], &[1e-5]),
    entry("sensor-gain", Port::Sensor, "lvdt = (1 + g) x_user", &[Parameter::SensorGain], &[2e-3]),
    entry("sensor-lag", Port::Sensor, "tau lvdt' + lvdt = x_user", &[Parameter::SensorLag], &[1e-4]),
    entry("sensor-delay", Port::Sensor, "lvdt(t) = x_user(t - d)", &[Parameter::SensorDelay], &[1e-4]),
    entry("sensor-cubic", Port::Sensor, "lvdt = x_user (1 + c x_user^2)", &[Parameter::SensorCubic], &[10.0]),
];

impl EffectInfo {
    /// The effect of a name.
    pub fn named(name: &str) -> Option<&'static Self> {
        EFFECTS.iter().find(|entry| entry.name == name)
    }

    /// The effect that cannot be told from this one whatever is measured, and the value of its one parameter that makes the
    /// model of `with`, this effect in it, from that of `without`. None where there is no such effect, or no such value.
    ///
    /// All that the fluid shows of a pressure gain and of a leak is `1/GPQ + Clk`, with `GPQ = GP sqrt(k)/GQ` at the supply
    /// ratio `k`.
    pub fn twin<T: Real>(&self, with: &Parameters<T>, without: &Parameters<T>) -> Option<(&'static Self, T)> {
        let per_gain = |p: &Parameters<T>| p.flow_gain / p.supply_ratio.root();
        let conductance = per_gain(with) / with.pressure_gain + with.leakage;
        let (name, value) = match self.parameters {
            [Parameter::PressureGain] => ("leakage", conductance - per_gain(without) / without.pressure_gain),
            [Parameter::Leakage] => ("pressure-gain", per_gain(without) / (conductance - without.leakage)),
            _ => return None,
        };
        let twin = Self::named(name)?;
        let info = twin.parameters[0].info();
        let possible = T::literal(info.lower)..=T::literal(info.upper);
        possible.contains(&value).then_some((twin, value))
    }
}
