//! Every quantity of the actuator that can be set, declared as faulty, or fitted: one table.
//!
//! A row gives the field, the symbol of the source, the unit, the default (appendix A of the source; zero or neutral
//! for what the source does not have), the range in which a value makes sense, and where the quantity acts. The
//! struct [`Parameters`], the list [`PARAMETERS`], the rig file, the bounds of a search, the effects and the
//! printed tables all derive from it.

use crate::scalar::Real;
use serde::{Deserialize, Serialize};

/// Where a parameter acts, which decides what must be made anew when its value changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reach {
    /// Output of the simulated motion only: the motion itself does not change.
    Output,
    /// Constant terms, switching limits and laws that are not affine: the transition matrices do not change.
    Constant,
    /// The transition matrices.
    Dynamics,
}

/// A row of the table of parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ParameterInfo {
    /// The parameter.
    pub parameter: Parameter,
    /// Name, as a rig file spells it.
    pub name: &'static str,
    /// Symbol of the source (empty where the source has none); a rig file accepts it as well.
    pub symbol: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Value of the source.
    pub default: f64,
    /// Smallest value that makes sense.
    pub lower: f64,
    /// Largest value that makes sense.
    pub upper: f64,
    /// Where it acts.
    pub reach: Reach,
    /// One line for the user.
    pub description: &'static str,
}

macro_rules! parameters {
    ($( $field:ident $variant:ident $symbol:literal $unit:literal $default:literal [$lower:literal, $upper:literal]
        $reach:ident $description:literal; )*) => {
        /// A value for every parameter of the actuator, in the units of the table.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Parameters<T> {
            $( #[doc = concat!($description, " (`", $symbol, "`), ", $unit, ".")] pub $field: T, )*
        }

        /// Names one field of [`Parameters`].
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        #[serde(into = "u8", try_from = "u8")]
        #[repr(u8)]
        #[non_exhaustive]
        pub enum Parameter {
            $( #[doc = concat!($description, ".")] $variant, )*
        }

        /// The table, in the order of [`Parameter`].
        pub const PARAMETERS: &[ParameterInfo] = &[
            $( ParameterInfo {
                parameter: Parameter::$variant, name: stringify!($field), symbol: $symbol, unit: $unit,
                default: $default, lower: $lower, upper: $upper, reach: Reach::$reach, description: $description,
            }, )*
        ];

        impl<T: Real> Default for Parameters<T> {
            /// The values of the source.
            fn default() -> Self {
                Self { $( $field: T::literal($default), )* }
            }
        }

        impl<T: Copy> Parameters<T> {
            /// The value of one parameter.
            pub const fn get(&self, parameter: Parameter) -> T {
                match parameter { $( Parameter::$variant => self.$field, )* }
            }

            /// Sets one parameter; no check (see [`ParameterInfo::lower`] and [`ParameterInfo::upper`]).
            pub const fn set(&mut self, parameter: Parameter, value: T) {
                match parameter { $( Parameter::$variant => self.$field = value, )* }
            }
        }

        impl Parameters<f64> {
            /// The same values in single precision, as the MCU holds them.
            pub const fn to_f32(&self) -> Parameters<f32> {
                Parameters { $( $field: self.$field as f32, )* }
            }
        }

        // What a microcontroller asks of a row, without the words of the table: those would be half of its constants.
        impl Parameter {
            /// Every parameter, in the order of the table.
            const ALL: &[Self] = &[$( Self::$variant, )*];

            /// Where the parameter acts.
            pub const fn reach(self) -> Reach {
                match self { $( Self::$variant => Reach::$reach, )* }
            }

            /// Smallest and largest value that make sense.
            pub fn range<T: Real>(self) -> [T; 2] {
                match self { $( Self::$variant => [T::literal($lower), T::literal($upper)], )* }
            }
        }
    };
}

parameters! {
    proportional_gain ProportionalGain "GAP" "mA/m" 1e4 [1.0, 1e7] Dynamics "position gain of the controller";
    integral_gain IntegralGain "GAI" "mA/(m s)" 0.0 [0.0, 1e7] Dynamics "integral gain of the controller";
    derivative_gain DerivativeGain "GAD" "mA s/m" 0.0 [-1e4, 1e4] Dynamics "gain on the rate of the position error";
    velocity_gain VelocityGain "GAS" "mA s/m" 0.0 [-1e4, 1e4] Dynamics "gain on the velocity of the ram";
    integral_limit IntegralLimit "ErIM" "m s" 1e-3 [0.0, 1.0] Constant "limit of the integrated error";
    current_limit CurrentLimit "CorM" "mA" 10.0 [1e-3, 1e4] Constant "limit of the servo-valve current";
    torque_motor_hysteresis TorqueMotorHysteresis "His" "mA" 0.0 [0.0, 5.0] Constant "half width of the torque motor's hysteresis";
    torque_motor_gain TorqueMotorGain "GM" "N/mA" 0.01 [1e-4, 1.0] Dynamics "force of the torque motor per current";
    current_offset CurrentOffset "Ofs" "mA" 0.0 [-5.0, 5.0] Constant "offset of the torque motor, as a current";
    flapper_stiffness FlapperStiffness "KF" "N/m" 40.0 [0.0, 1e5] Dynamics "stiffness of the flapper's flexure";
    feedback_stiffness FeedbackStiffness "KSF" "N/m" 160.0 [1e-3, 1e5] Dynamics "stiffness of the feedback spring";
    flapper_frequency FlapperFrequency "SNF" "rad/s" 2513.0 [100.0, 1e5] Dynamics "undamped natural frequency of the flapper";
    flapper_damping FlapperDamping "ZF" "1" 0.6 [0.05, 5.0] Dynamics "damping ratio of the flapper";
    flapper_stop FlapperStop "XFM" "m" 1e-4 [1e-6, 1e-2] Constant "end stop of the flapper";
    feedback_play FeedbackPlay "gioco" "m" 0.0 [0.0, 1e-4] Constant "half width of the play of the feedback spring's ball on the spool";
    first_stage_pressure_gain FirstStagePressureGain "GPF" "Pa/m" 1e11 [1e8, 1e14] Dynamics "pressure gain of the first stage";
    first_stage_flow_gain FirstStageFlowGain "GQF" "m^2/s" 0.014 [1e-5, 10.0] Dynamics "flow gain of the first stage";
    filter_clogging FilterClogging "Kint" "1" 0.0 [0.0, 0.95] Dynamics "clogging of the filter: the first stage's flow gain falls to 1 - Kint of itself";
    spool_area SpoolArea "ASV" "m^2" 0.7e-4 [1e-6, 1e-2] Dynamics "end area of the spool";
    spool_viscosity SpoolViscosity "CSV" "N s/m" 1000.0 [0.0, 1e6] Dynamics "viscous friction of the spool";
    spool_friction SpoolFriction "FSS" "N" 7.0 [0.0, 500.0] Constant "breakaway friction of the spool";
    spool_friction_ratio SpoolFrictionRatio "FSDS" "1" 1.2 [1.0, 10.0] Constant "breakaway over sliding friction of the spool";
    spool_rest_ratio SpoolRestRatio "" "1" 1.0 [1.0, 10.0] Constant "driving force at which the sliding spool comes to rest over its sliding friction, at most the breakaway friction";
    spool_stop SpoolStop "XSM" "m" 0.6e-3 [1e-5, 0.1] Constant "end stop of the spool";
    flow_asymmetry FlowAsymmetry "af" "1" 0.0 [-0.5, 0.5] Dynamics "opening of the spool times 1 + af sgn(XS)";
    spool_overlap SpoolOverlap "OVL" "m" 0.0 [0.0, 3e-4] Constant "half width of the spool's dead zone";
    valve_bandwidth ValveBandwidth "" "rad/s" 155.0 [1.0, 1e4] Dynamics "first-order valve: 1 over its lag";
    valve_rate_limit ValveRateLimit "" "m/s" 19.4e-3 [1e-4, 1e3] Constant "first-order valve: slew rate of the spool";
    supply_pressure SupplyPressure "PSR0" "Pa" 2e7 [1e5, 1e9] Dynamics "rated supply pressure over return";
    supply_ratio SupplyRatio "k" "1" 1.0 [0.1, 2.0] Dynamics "supply pressure over its rated value, PSR/PSR0";
    supply_sag SupplySag "s" "s/m" 0.0 [0.0, 5.0] Dynamics "fall of the supply ratio per ram velocity";
    supply_sag_lag SupplySagLag "ts" "s" 0.05 [1e-3, 1.0] Dynamics "first-order lag of that fall behind the velocity";
    return_pressure ReturnPressure "PRV" "Pa" 1e6 [0.0, 1e8] Constant "return pressure";
    vapour_pressure VapourPressure "PVap" "Pa" 1e3 [0.0, 1e6] Constant "vapour pressure";
    pressure_gain PressureGain "GP" "Pa/m" 1e11 [1e8, 1e14] Dynamics "pressure gain of the second stage";
    flow_gain FlowGain "GQ" "m^2/s" 0.2 [1e-4, 1e3] Dynamics "flow gain of the second stage";
    leakage Leakage "Clk" "m^3/(s Pa)" 1e-13 [0.0, 1e-9] Dynamics "leakage of the jack";
    metering_blend MeteringBlend "" "1" 0.0 [0.0, 1.0] Constant "fluid form: 0 linear, 1 square-root metering";
    oil_compliance OilCompliance "1/beta" "1/Pa" 0.0 [0.0, 1e-7] Dynamics "1 over the bulk modulus of the oil";
    jack_area JackArea "AJ" "m^2" 8e-4 [1e-6, 1.0] Dynamics "area of the jack";
    viscous_friction ViscousFriction "CJ" "N s/m" 50.0 [0.0, 1e7] Dynamics "viscous friction of the jack";
    load_mass LoadMass "MJ" "kg" 20.0 [1.0, 1e5] Dynamics "mass of jack and load";
    jack_stop JackStop "XJM" "m" 0.2 [1e-4, 10.0] Constant "end stop of the jack";
    fdj DryFriction "FDJ" "N" 200.0 [0.0, 1e5] Constant "sliding dry friction of the jack";
    breakaway_ratio BreakawayRatio "FSD" "1" 2.0 [1.0, 10.0] Constant "breakaway over sliding friction of the jack";
    friction_asymmetry FrictionAsymmetry "a" "1" 0.0 [-0.9, 0.9] Constant "friction times 1 + a sgn(v)";
    stribeck_velocity StribeckVelocity "vs" "m/s" 0.0 [0.0, 1.0] Constant "velocity over which friction falls from breakaway to sliding";
    retraction_viscosity RetractionViscosity "cr" "N s/m" 0.0 [-1e6, 1e6] Dynamics "viscous friction that retraction has beyond CJ; the sum is not below 0";
    thinning_viscosity ThinningViscosity "ct" "N s/m" 0.0 [0.0, 1e6] Constant "viscous friction at low speed that shearing takes away";
    thinning_velocity ThinningVelocity "vt" "m/s" 0.02 [1e-4, 1.0] Constant "velocity at which shearing has taken half of it";
    cogging_cosine CoggingCosine "Fc" "N" 0.0 [-1e5, 1e5] Constant "cogging: amplitude of the part that goes with the cosine";
    cogging_sine CoggingSine "Fs" "N" 0.0 [-1e5, 1e5] Constant "cogging: amplitude of the part that goes with the sine";
    cogging_pitch CoggingPitch "p" "m" 1e-2 [1e-5, 1.0] Constant "cogging: way after which it repeats";
    drive_lag DriveLag "" "s" 0.0 [0.0, 0.1] Constant "first-order lag of the force behind the drive";
    quadratic_drag QuadraticDrag "c2" "N s^2/m^2" 0.0 [0.0, 1e7] Constant "drag c2 v abs(v)";
    constant_load ConstantLoad "F" "N" 0.0 [-1e5, 1e5] Constant "constant load against extension";
    spring_load SpringLoad "Kaer" "N/m" 0.0 [0.0, 1e7] Dynamics "aerodynamic stiffness";
    step_load StepLoad "" "N" 0.0 [-1e5, 1e5] Constant "load against extension from step_load_time on";
    step_load_time StepLoadTime "t1" "s" 0.0 [0.0, 1e6] Constant "start of the step load";
    mount_compliance MountCompliance "1/k" "m/N" 0.0 [0.0, 1e-5] Dynamics "compliance of the mount: 1 over its stiffness";
    mount_lag MountLag "cb/k" "s" 5e-5 [0.0, 0.1] Dynamics "lag of the mount: its damping over its stiffness";
    base_mass BaseMass "mb" "kg" 5.0 [1e-3, 1e5] Dynamics "mass of the base, the cylinder's body, on its mount";
    load_follows_base LoadFollowsBase "sl" "1" 1.0 [0.0, 1.0] Dynamics "share of the base's motion that the load's inertia follows: 1 moves with it, 0 stays in the cylinder's frame";
    loop_sees_base LoopSeesBase "sb" "1" 1.0 [0.0, 1.0] Dynamics "share of the base's motion that a loop on the ram sees: 1 regulates its position over ground, 0 that in the cylinder";
    play_sees_base PlaySeesBase "sp" "1" 1.0 [0.0, 1.0] Dynamics "share of the base's motion that the backlash passes on: 1 where the user hangs on the ram over ground, 0 where all of it is added behind the backlash";
    bkl Backlash "BKL" "m" 0.0 [0.0, 0.05] Output "full width of the backlash between ram and user";
    sensor_offset SensorOffset "" "m" 0.0 [-0.1, 0.1] Output "offset of the LVDT";
    sensor_gain SensorGain "" "1" 0.0 [-0.5, 1.0] Output "relative gain error of the LVDT";
    sensor_lag SensorLag "" "s" 0.0 [0.0, 0.1] Output "first-order lag of the LVDT";
    sensor_delay SensorDelay "" "s" 0.0 [0.0, 0.1] Output "transport delay of the LVDT";
    sensor_cubic SensorCubic "" "1/m^2" 0.0 [-1e4, 1e4] Output "cubic non-linearity of the LVDT: position times 1 + c x^2";
}

/// The place in the table.
impl From<Parameter> for u8 {
    fn from(parameter: Parameter) -> Self {
        parameter as Self
    }
}

impl TryFrom<u8> for Parameter {
    type Error = &'static str;

    fn try_from(place: u8) -> Result<Self, Self::Error> {
        Self::at(place.into()).ok_or("no place in the table of parameters")
    }
}

impl Parameter {
    /// Every parameter, in the order of the table.
    pub fn all() -> impl Iterator<Item = Self> {
        Self::ALL.iter().copied()
    }

    /// The parameter at a place in the table.
    pub fn at(place: usize) -> Option<Self> {
        Self::ALL.get(place).copied()
    }

    /// The row of the table.
    pub fn info(self) -> &'static ParameterInfo {
        &PARAMETERS[self as usize]
    }

    /// The parameter of a name or of a symbol of the source.
    pub fn named(name: &str) -> Option<Self> {
        PARAMETERS
            .iter()
            .find(|row| row.name == name || (row.symbol == name && !name.is_empty()))
            .map(|row| row.parameter)
    }
}
