//! The catalogue of physical effects: one entry an effect.
//!
//! An effect is a set of [`Parameter`]s that are zero (or at the source's value) where it is absent; the blocks of
//! [`crate::model`] hold its equation. Units and bounds are those of the parameters.

use crate::parameter::Parameter;

/// Where in the loop an effect acts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Port {
    /// Between the current and the spool.
    Valve,
    /// Between the spool and the pressure on the jack.
    Fluid,
    /// A force on the ram.
    Force,
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
            Self::Sensor => "sensor",
        }
    }
}

/// An entry of the catalogue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffectInfo {
    /// Name that users type and read.
    pub name: &'static str,
    /// Where it acts.
    pub port: Port,
    /// Its equation, in the symbols of the design.
    pub equation: &'static str,
    /// What it adds to the model.
    pub parameters: &'static [Parameter],
}

const fn entry(
    name: &'static str,
    port: Port,
    equation: &'static str,
    parameters: &'static [Parameter],
) -> EffectInfo {
    EffectInfo { name, port, equation, parameters }
}

/// Every effect that the model can have beyond its declared faults.
pub const EFFECTS: &[EffectInfo] = &[
    entry("valve-offset", Port::Valve, "F = GM (Cor + Ofs)", &[Parameter::CurrentOffset]),
    entry(
        "torque-motor-hysteresis",
        Port::Valve,
        "F = GM play(Cor, His)",
        &[Parameter::TorqueMotorHysteresis],
    ),
    entry(
        "torque-motor-gain",
        Port::Valve,
        "F = GM Cor, GM not the rated one",
        &[Parameter::TorqueMotorGain],
    ),
    entry(
        "feedback-play",
        Port::Valve,
        "feedback spring force KSF play(XS, gioco)",
        &[Parameter::FeedbackPlay],
    ),
    entry("filter-clogging", Port::Valve, "GQF (1 - Kint)", &[Parameter::FilterClogging]),
    entry(
        "spool-friction",
        Port::Valve,
        "friction of the spool FSS, sliding FSS/FSDS",
        &[Parameter::SpoolFriction],
    ),
    entry("spool-overlap", Port::Fluid, "dead zone of half width OVL on XS", &[Parameter::SpoolOverlap]),
    entry(
        "turbulent-metering",
        Port::Fluid,
        "AJ v = GQ XS ((1-b) + b sqrt((PSR - sgn(XS) P12)/PSR0)) - (1/GPQ + Clk) P12",
        &[Parameter::MeteringBlend],
    ),
    entry("pressure-gain", Port::Fluid, "GP, with GQ kept", &[Parameter::PressureGain]),
    entry("leakage", Port::Fluid, "Clk P12", &[Parameter::Leakage]),
    entry("supply-pressure", Port::Fluid, "PSR = k PSR0: GP by k, GQ by sqrt(k)", &[Parameter::SupplyRatio]),
    entry("supply-sag", Port::Fluid, "k = 1 - s abs(v), lagged by 50 ms", &[Parameter::SupplySag]),
    entry(
        "compressibility",
        Port::Fluid,
        "P12' = 4 beta/Vt (Q - AJ v - Clk P12), Vt = 2 AJ XJM",
        &[Parameter::OilCompliance],
    ),
    entry("stribeck", Port::Force, "FDJ + (FSD-1) FDJ exp(-abs(v)/vs)", &[Parameter::StribeckVelocity]),
    entry("friction-asymmetry", Port::Force, "friction (1 + a sgn v)", &[Parameter::FrictionAsymmetry]),
    entry("viscous-friction", Port::Force, "CJ v", &[Parameter::ViscousFriction]),
    entry("quadratic-drag", Port::Force, "c2 v abs(v)", &[Parameter::QuadraticDrag]),
    entry("constant-load", Port::Force, "F", &[Parameter::ConstantLoad]),
    entry("spring-load", Port::Force, "Kaer x", &[Parameter::SpringLoad]),
    entry("step-load", Port::Force, "F from time t1 on", &[Parameter::StepLoad, Parameter::StepLoadTime]),
    entry("load-mass", Port::Force, "MJ v'", &[Parameter::LoadMass]),
    entry("sensor-offset", Port::Sensor, "lvdt = x_user + o", &[Parameter::SensorOffset]),
    entry("sensor-gain", Port::Sensor, "lvdt = (1 + g) x_user", &[Parameter::SensorGain]),
    entry("sensor-lag", Port::Sensor, "tau lvdt' + lvdt = x_user", &[Parameter::SensorLag]),
    entry("sensor-delay", Port::Sensor, "lvdt(t) = x_user(t - d)", &[Parameter::SensorDelay]),
    entry("sensor-cubic", Port::Sensor, "lvdt = x_user (1 + c x_user^2)", &[Parameter::SensorCubic]),
];

impl EffectInfo {
    /// The effect of a name.
    pub fn named(name: &str) -> Option<&'static Self> {
        EFFECTS.iter().find(|entry| entry.name == name)
    }
}
