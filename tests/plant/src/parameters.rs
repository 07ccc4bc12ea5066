//! What the plant is made of: the source's parameters, and the effects that its model leaves out.

/// The parameters of the source, in SI units (currents in mA). `Default` gives the source's values.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    /// `ErIM`, limit of the integral of the position error (m s).
    pub error_integral_limit: f64,
    /// `GAP`, proportional gain (mA/m).
    pub proportional_gain: f64,
    /// `GAI`, integral gain (mA/(m s)).
    pub integral_gain: f64,
    /// `GAD`, derivative gain (mA s/m).
    pub derivative_gain: f64,
    /// `GAS`, velocity feedback gain (mA s/m).
    pub velocity_gain: f64,
    /// `CorM`, current limit (mA).
    pub current_limit: f64,
    /// `His`, half width of the torque motor's hysteresis (mA).
    pub motor_hysteresis: f64,
    /// `GM`, torque motor gain (N/mA).
    pub motor_gain: f64,
    /// `Ofs`, valve offset (mA).
    pub valve_offset: f64,
    /// `KF`, flapper stiffness (N/m).
    pub flapper_stiffness: f64,
    /// `KSF`, spool to flapper feedback stiffness (N/m).
    pub feedback_stiffness: f64,
    /// `SNF`, natural frequency of the flapper (rad/s).
    pub flapper_frequency: f64,
    /// `ZF`, damping ratio of the flapper.
    pub flapper_damping: f64,
    /// `XFM`, flapper end stop (m).
    pub flapper_stop: f64,
    /// `gioco`, half width of the feedback spring's play on the spool (m).
    pub feedback_play: f64,
    /// `GPF`, pressure gain of the first stage (Pa/m).
    pub first_stage_pressure_gain: f64,
    /// `GQF`, flow gain of the first stage (m²/s).
    pub first_stage_flow_gain: f64,
    /// `Kint`, filter clogging: `GQF` is scaled by `1 - Kint`.
    pub filter_clogging: f64,
    /// `ASV`, spool area (m²).
    pub spool_area: f64,
    /// `CSV`, viscous coefficient of the spool (N s/m).
    pub spool_viscosity: f64,
    /// `FSS`, static friction of the spool (N).
    pub spool_friction: f64,
    /// `FSDS`, static over dynamic friction of the spool.
    pub spool_friction_ratio: f64,
    /// Does the spool stick as soon as `abs(ASV*PF) <= FSS`? Otherwise it slides until the force has fallen to its dynamic
    /// friction.
    pub spool_sticks_below_breakaway: bool,
    /// `XSM`, spool end stop (m).
    pub spool_stop: f64,
    /// `PSR`, supply minus return pressure (Pa). The effect `supply-pressure` is `k = PSR/PSR0`: it limits the
    /// first stage and the jack, scales `GP` by `k` and `GQ` by `sqrt(k)`.
    pub supply_pressure: f64,
    /// `PSR0`, the pressure at which the gains hold (Pa).
    pub nominal_supply_pressure: f64,
    /// `PRV`, return pressure (Pa).
    pub return_pressure: f64,
    /// `PVap`, vapour pressure (Pa).
    pub vapour_pressure: f64,
    /// `Clk`, leakage of the jack (m³/(s Pa)).
    pub leakage: f64,
    /// `GP`, pressure gain of the spool (Pa/m).
    pub pressure_gain: f64,
    /// `GQ`, flow gain of the spool (m²/s).
    pub flow_gain: f64,
    /// `AJ`, area of the jack (m²).
    pub jack_area: f64,
    /// `CJ`, viscous coefficient of the jack (N s/m).
    pub jack_viscosity: f64,
    /// `MJ`, mass of jack and load (kg).
    pub jack_mass: f64,
    /// `XJM`, jack end stop (m).
    pub jack_stop: f64,
    /// `FDJ`, dynamic friction of the jack (N).
    pub jack_friction: f64,
    /// `FSD`, static over dynamic friction of the jack, at least 1.
    pub jack_friction_ratio: f64,
    /// `BKL`, full width of the backlash between ram and user (m).
    pub backlash: f64,
    /// `Kaer`, stiffness of the aerodynamic load (N/m).
    pub load_stiffness: f64,
    /// Which position closes the loop.
    pub feedback: Feedback,
    /// How the servo valve is described.
    pub valve: Valve,
}

/// The position that closes the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feedback {
    /// The ram: the backlash is outside the loop.
    Ram,
    /// The user: the backlash is inside the loop.
    User,
}

/// Description of the servo valve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Valve {
    /// Flapper with mass and damping, massless spool with dry friction.
    SecondOrderFlapper,
    /// Flapper in static balance, massless spool with dry friction.
    StaticFlapper,
    /// Spool follows `F/KSF` as one first-order lag.
    FirstOrder {
        /// Bandwidth (rad/s).
        bandwidth: f64,
        /// Largest spool speed (m/s).
        rate_limit: f64,
    },
}

impl Default for Parameters {
    fn default() -> Self {
        Self {
            error_integral_limit: 1e-3,
            proportional_gain: 1e4,
            integral_gain: 0.0,
            derivative_gain: 0.0,
            velocity_gain: 0.0,
            current_limit: 10.0,
            motor_hysteresis: 0.0,
            motor_gain: 0.01,
            valve_offset: 0.0,
            flapper_stiffness: 40.0,
            feedback_stiffness: 160.0,
            flapper_frequency: 2513.0,
            flapper_damping: 0.6,
            flapper_stop: 1e-4,
            feedback_play: 0.0,
            first_stage_pressure_gain: 1e11,
            first_stage_flow_gain: 0.014,
            filter_clogging: 0.0,
            spool_area: 0.7e-4,
            spool_viscosity: 1000.0,
            spool_friction: 7.0,
            spool_friction_ratio: 1.2,
            spool_sticks_below_breakaway: false,
            spool_stop: 0.6e-3,
            supply_pressure: 2e7,
            nominal_supply_pressure: 2e7,
            return_pressure: 1e6,
            vapour_pressure: 1e3,
            leakage: 1e-13,
            pressure_gain: 1e11,
            flow_gain: 0.2,
            jack_area: 8e-4,
            jack_viscosity: 50.0,
            jack_mass: 20.0,
            jack_stop: 0.2,
            jack_friction: 200.0,
            jack_friction_ratio: 2.0,
            backlash: 0.0,
            load_stiffness: 0.0,
            feedback: Feedback::Ram,
            valve: Valve::SecondOrderFlapper,
        }
    }
}

/// What the source's model leaves out. `Default` is neutral: every effect absent.
///
/// Effects that are a parameter of the source (`valve-offset`, `leakage`, `supply-pressure`, `load-mass`, ...)
/// are set in [`Parameters`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Effects {
    /// `spool-overlap`: half width of the dead zone on the spool position (m).
    pub spool_overlap: f64,
    /// `flow-asymmetry`: the opening of the spool counts `1 + a` times for positive, `1 - a` times for negative ones.
    pub flow_asymmetry: f64,
    /// `turbulent-metering`: 0 linear fluid, 1 square-root fluid.
    pub turbulent_metering: f64,
    /// `supply-sag`: loss of relative pressure per velocity (s/m).
    pub supply_sag: f64,
    /// Lag of the supply's sag behind the velocity (s).
    pub supply_sag_lag: f64,
    /// `compressibility`: bulk modulus `beta` (Pa); `None` is an incompressible fluid.
    pub bulk_modulus: Option<f64>,
    /// `stribeck`: velocity `vs` over which static friction decays to dynamic friction (m/s).
    pub stribeck_velocity: f64,
    /// `friction-asymmetry`: friction (static and dynamic) times `1 + a*sgn(v)`.
    pub friction_asymmetry: f64,
    /// `quadratic-drag`: coefficient of `v*abs(v)` (N s²/m²).
    pub quadratic_drag: f64,
    /// `constant-load` (N), against positive motion as all loads.
    pub constant_load: f64,
    /// Load that grows with time (N/s).
    pub ramp_load: f64,
    /// Sinusoidal load.
    pub sine_load: Tone,
    /// `step-load`: size (N).
    pub step_load: f64,
    /// `step-load`: time of the step (s).
    pub step_load_time: f64,
    /// `mount-compliance`; `None` is a rigid mount.
    pub mount: Option<Mount>,
    /// `sensor-offset` (m).
    pub sensor_offset: f64,
    /// `sensor-gain`: relative error of the gain.
    pub sensor_gain: f64,
    /// `sensor-lag`: time constant (s).
    pub sensor_lag: f64,
    /// `sensor-delay`: pure delay (s).
    pub sensor_delay: f64,
    /// `sensor-cubic`: coefficient of `x³` (1/m²).
    pub sensor_cubic: f64,
    /// Outside the catalogue: periodic disturbance force on the ram, a load that no rig declares.
    pub disturbance: Tone,
    /// Outside the catalogue: drift of the sensor (m/s).
    pub sensor_drift: f64,
    /// Outside the catalogue: hum of the sensor (m).
    pub sensor_hum: Tone,
    /// Outside the catalogue: load that grows with the cube of the position (N/m³).
    pub hardening_spring: f64,
    /// Outside the catalogue: viscous friction that grows with time, as the oil cools (N s/m for each s).
    pub viscosity_growth: f64,
    /// Outside the catalogue: dry friction, static and dynamic, that grows with time (relative, for each s).
    pub friction_growth: f64,
    /// Outside the catalogue: a load that comes and goes, as of a gust.
    pub gust: Gust,
    /// Outside the catalogue: an error of the sensor that repeats with the position, amplitude (m).
    pub sensor_ripple: f64,
    /// Pitch of `sensor_ripple` (m); must be set with it.
    pub sensor_ripple_pitch: f64,
    /// `viscous-asymmetry`: viscous friction of retraction beyond that of extension (N s/m).
    pub retraction_viscosity: f64,
    /// `shear-thinning`: viscous friction at rest that shearing takes away (N s/m).
    pub thinning_viscosity: f64,
    /// `shear-thinning`: velocity at which half of it is left (m/s); must be set with `thinning_viscosity`.
    pub thinning_velocity: f64,
    /// `cogging`: amplitude of a detent, a force that depends on the position in the cylinder (N).
    pub detent_force: f64,
    /// `cogging`: pitch of the detent (m); must be set with `detent_force`.
    pub detent_pitch: f64,
    /// `cogging`: phase of the detent at zero (rad).
    pub detent_phase: f64,
}

/// A force between two times.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Gust {
    /// Force (N), against positive motion.
    pub force: f64,
    /// When it begins (s).
    pub start: f64,
    /// When it ends (s).
    pub end: f64,
}

/// A sinusoidal force or hum, `amplitude * sin(2*pi*frequency*t + phase)`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Tone {
    /// Amplitude (N, m).
    pub amplitude: f64,
    /// Frequency (Hz).
    pub frequency: f64,
    /// Phase at the start (rad).
    pub phase: f64,
}

impl Tone {
    /// Its value at a time (s).
    pub(crate) fn at(self, t: f64) -> f64 {
        match self.amplitude {
            0.0 => 0.0,
            amplitude => amplitude * (std::f64::consts::TAU * self.frequency * t + self.phase).sin(),
        }
    }
}

/// The cylinder's body as a mass on a spring and a damper. A massless body would close an algebraic loop through
/// the fluid and the dry friction; a small mass tends to it. `x` and `v` stay those of the ram in the cylinder;
/// loads act on, and outer sensors see, the ram's position over ground, `x + body`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mount {
    /// Stiffness (N/m).
    pub stiffness: f64,
    /// Damping (N s/m).
    pub damping: f64,
    /// Mass of the body (kg); resolved by the default step from about 1 kg on.
    pub mass: f64,
    /// Whether the transducer of the loop also measures over ground. If not, it sits in the cylinder.
    pub in_loop: bool,
    /// Whether the load's inertia follows the body, as that of a load over ground does. If not, the ram moves in its
    /// cylinder as on a rigid mount, and the body moves only what is measured.
    pub load_follows: bool,
    /// Whether the backlash lies between the ram over ground and the user. If not, it lies in the cylinder's frame, and
    /// the body's motion is added to what is behind it.
    pub play_over_ground: bool,
}

impl Default for Mount {
    /// A stiff one under a light body: everything else is over ground.
    fn default() -> Self {
        Self {
            stiffness: 2e7,
            damping: 2e3,
            mass: 5.0,
            in_loop: true,
            load_follows: true,
            play_over_ground: true,
        }
    }
}
