//! The equations: rates of change and everything that follows from the state without delay.

use std::f64::consts::TAU;

use crate::{Command, Effects, Feedback, Parameters, Valve};

/// Backlash operator of half width `h`: the state stays, unless the input pushes it along.
pub fn play(input: f64, state: f64, h: f64) -> f64 {
    state.max(input - h).min(input + h)
}

/// Limits to `[-bound, bound]`.
pub(crate) fn sat(x: f64, bound: f64) -> f64 {
    x.max(-bound).min(bound)
}

/// Solves `q = a*((1-b) + b*sqrt(max(0, (ps - s*p)/p0))) - k*p` for the pressure difference `p`, where `a` is the
/// opening in units of flow and `s` its sign. The linear part may have an opening of its own, `linear`.
pub fn blended_pressure(q: f64, linear: f64, turbulent: f64, b: f64, ps: f64, p0: f64, k: f64) -> f64 {
    let sign = if turbulent < 0.0 { -1.0 } else { 1.0 };
    // In the frame where the opening is positive: w = l + t*y - k*p, with y = sqrt((ps - p)/p0).
    let (w, l, t) = (sign * q, sign * linear * (1.0 - b), sign * turbulent * b);
    let beyond = (l - w) / k;
    if beyond >= ps || t == 0.0 {
        return sign * beyond;
    }
    // p = ps - p0*y², so k*p0*y² + t*y - (w - l + k*ps) = 0, of which y is the positive root.
    let c = w - l + k * ps;
    let y = 2.0 * c / (t + (t * t + 4.0 * k * p0 * c).sqrt());
    sign * (ps - p0 * y * y)
}

/// The continuous state.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct State {
    /// Integral of the position error.
    pub(crate) integral: f64,
    /// `XF`.
    pub(crate) flapper: f64,
    /// `XF'`.
    pub(crate) flapper_rate: f64,
    /// `XS`.
    pub(crate) spool: f64,
    /// `x`, the ram in its cylinder.
    pub(crate) ram: f64,
    /// `v`.
    pub(crate) ram_rate: f64,
    /// `P12` of a compressible fluid.
    pub(crate) pressure: f64,
    /// `abs(v)` behind the lag of the supply.
    pub(crate) flow: f64,
    /// Position of the cylinder's body.
    pub(crate) body: f64,
    /// Velocity of the cylinder's body.
    pub(crate) body_rate: f64,
    /// Output of the sensor's lag.
    pub(crate) sensed: f64,
}

impl State {
    /// The state after `h` at constant rates.
    pub(crate) fn moved(&self, rate: &Self, h: f64) -> Self {
        Self {
            integral: self.integral + h * rate.integral,
            flapper: self.flapper + h * rate.flapper,
            flapper_rate: self.flapper_rate + h * rate.flapper_rate,
            spool: self.spool + h * rate.spool,
            ram: self.ram + h * rate.ram,
            ram_rate: self.ram_rate + h * rate.ram_rate,
            pressure: self.pressure + h * rate.pressure,
            flow: self.flow + h * rate.flow,
            body: self.body + h * rate.body,
            body_rate: self.body_rate + h * rate.body_rate,
            sensed: self.sensed + h * rate.sensed,
        }
    }
}

/// What changes only by contact: plays, the flapper's stop and dry friction.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Contacts {
    /// Play of the torque motor (mA).
    pub(crate) current: f64,
    /// Play of the feedback spring (m).
    pub(crate) spool: f64,
    /// Backlash: the position of the user (m).
    pub(crate) user: f64,
    /// Side of the stop at which the flapper rests; 0 when it is free.
    pub(crate) flapper_stop: f64,
    /// Direction in which the spool slides; 0 when it sticks.
    pub(crate) spool_slide: f64,
    /// Direction in which the jack slides; 0 when it sticks.
    pub(crate) jack_slide: f64,
}

/// What follows from the state without delay.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Signals {
    pub(crate) command: f64,
    /// `Cor`.
    pub(crate) current: f64,
    /// `P12`.
    pub(crate) pressure: f64,
    pub(crate) load: f64,
    /// The ram over ground.
    pub(crate) ram: f64,
    /// What the lag of the sensor passes on.
    pub(crate) sensed: f64,
    /// Force on a flapper at rest.
    pub(crate) flapper_push: f64,
    /// Driving force of the spool, `ASV*PF`.
    pub(crate) spool_drive: f64,
    /// Friction that would hold the jack at rest.
    pub(crate) jack_hold: f64,
    /// The plays after the input of this instant.
    pub(crate) contacts: Contacts,
}

/// The plant under a command.
pub(crate) struct Equations<'a> {
    pub(crate) p: &'a Parameters,
    pub(crate) e: &'a Effects,
    pub(crate) command: &'a Command,
}

impl Equations<'_> {
    /// Static friction of the jack against a force of this direction, at a time.
    pub(crate) fn breakaway(&self, t: f64, direction: f64) -> f64 {
        self.dry(t, direction) * self.p.jack_friction_ratio
    }

    /// Dynamic friction of the jack in this direction, at a time.
    fn dry(&self, t: f64, direction: f64) -> f64 {
        let e = self.e;
        self.p.jack_friction * (1.0 + e.friction_asymmetry * direction) * (1.0 + e.friction_growth * t)
    }

    /// Viscous friction of the jack, thinned by its speed, and drag, at a time.
    fn damping(&self, t: f64, v: f64) -> f64 {
        let (p, e) = (self.p, self.e);
        let thinned = match e.thinning_viscosity {
            0.0 => 0.0,
            at_rest => at_rest / (1.0 + v.abs() / e.thinning_velocity),
        };
        let one_sided = if v < 0.0 { e.retraction_viscosity } else { 0.0 };
        let viscosity = p.jack_viscosity + one_sided + e.viscosity_growth * t;
        (viscosity.max(0.0) + thinned + e.quadratic_drag * v.abs()) * v
    }

    /// Relative supply pressure.
    fn supply(&self, s: &State) -> f64 {
        self.p.supply_pressure / self.p.nominal_supply_pressure * (1.0 - self.e.supply_sag * s.flow).max(0.0)
    }

    /// Bound of `P12`: the supply for the linear fluid, vapour pressure in a chamber for the metering fluid.
    pub(crate) fn pressure_bound(&self, s: &State) -> f64 {
        self.supply(s) * self.p.nominal_supply_pressure
            + self.e.turbulent_metering * 2.0 * (self.p.return_pressure - self.p.vapour_pressure)
    }

    fn jack_friction(&self, t: f64, v: f64, direction: f64) -> f64 {
        let (p, e) = (self.p, self.e);
        let stribeck = match e.stribeck_velocity {
            0.0 => 0.0,
            vs => (p.jack_friction_ratio - 1.0) * (-v.abs() / vs).exp(),
        };
        direction * self.dry(t, direction) * (1.0 + stribeck)
    }

    fn load(&self, t: f64, ram_over_ground: f64) -> f64 {
        let e = self.e;
        let step = if t >= e.step_load_time { e.step_load } else { 0.0 };
        let spring = self.p.load_stiffness * ram_over_ground + e.hardening_spring * ram_over_ground.powi(3);
        let gust = if (e.gust.start..e.gust.end).contains(&t) { e.gust.force } else { 0.0 };
        gust + e.constant_load + e.ramp_load * t + e.sine_load.at(t) + step + spring + e.disturbance.at(t)
    }

    /// Returns `P12` and its rate; the rate is zero for an incompressible fluid, where `P12` follows at once.
    fn fluid(&self, s: &State) -> (f64, f64) {
        let (p, e) = (self.p, self.e);
        let k = self.supply(s);
        let spool = sat(s.spool, p.spool_stop);
        let past = spool - sat(spool, e.spool_overlap);
        let opening = past * (1.0 + e.flow_asymmetry * past.signum());
        // The root of the metering form holds the supply already; its flow gain is the nominal one.
        let (linear, turbulent) = (p.flow_gain * k.sqrt() * opening, p.flow_gain * opening);
        let total_leakage = p.flow_gain / p.pressure_gain / k.sqrt() + p.leakage;
        let (b, ps, p0) = (e.turbulent_metering, k * p.nominal_supply_pressure, p.nominal_supply_pressure);
        let swept = p.jack_area * s.ram_rate;
        let Some(beta) = e.bulk_modulus else {
            let free = blended_pressure(swept, linear, turbulent, b, ps, p0, total_leakage);
            return (sat(free, self.pressure_bound(s)), 0.0);
        };
        let root = ((ps - opening.signum() * s.pressure) / p0).max(0.0).sqrt();
        let flow = (1.0 - b) * linear + b * root * turbulent;
        let volume = 2.0 * p.jack_area * p.jack_stop;
        (s.pressure, 4.0 * beta / volume * (flow - swept - total_leakage * s.pressure))
    }

    /// Velocity of the ram, as the controller sees it.
    fn ram_rate(&self, s: &State) -> f64 {
        s.ram_rate + if self.over_ground() { s.body_rate } else { 0.0 }
    }

    /// Velocity of the feedback position: that of the user is zero inside the backlash.
    fn feedback_rate(&self, s: &State, contacts: &Contacts) -> f64 {
        if self.p.feedback == Feedback::Ram {
            return self.ram_rate(s);
        }
        let carried = self.play_share();
        let (pushing, rate) = (s.ram + carried * s.body, s.ram_rate + carried * s.body_rate);
        let half = 0.5 * self.p.backlash;
        let pushes = (pushing - contacts.user) * rate.signum() >= half * (1.0 - 1e-9);
        (1.0 - carried) * s.body_rate + if pushes { rate } else { 0.0 }
    }

    /// Share of the body's motion in front of the backlash; the rest is behind it.
    fn play_share(&self) -> f64 {
        if self.e.mount.is_none_or(|m| m.play_over_ground) { 1.0 } else { 0.0 }
    }

    fn over_ground(&self) -> bool {
        self.e.mount.is_some_and(|m| m.in_loop)
    }

    /// Rates of change, and all that follows from the state. `command_rate` is the rate of the command.
    pub(crate) fn rates(&self, t: f64, s: &State, before: &Contacts, command_rate: f64) -> (State, Signals) {
        let (p, e) = (self.p, self.e);
        let mut rate = State::default();
        let mut contacts = *before;

        // Sensors.
        let ram = s.ram + s.body;
        let carried = self.play_share() * s.body;
        contacts.user = play(s.ram + carried, before.user, 0.5 * p.backlash);
        let user = contacts.user + (s.body - carried);
        if e.sensor_lag > 0.0 {
            rate.sensed = (user - s.sensed) / e.sensor_lag;
        }
        let sensed = if e.sensor_lag > 0.0 { s.sensed } else { user };

        // Controller.
        let command = self.command.value(t);
        let feedback = match p.feedback {
            Feedback::User => user,
            Feedback::Ram if self.over_ground() => ram,
            Feedback::Ram => s.ram,
        };
        let error = command - feedback;
        let feedback_rate = self.feedback_rate(s, &contacts);
        let full = s.integral * error.signum() >= p.error_integral_limit;
        rate.integral = if full { 0.0 } else { error };
        let current = sat(
            p.proportional_gain * error
                + p.integral_gain * sat(s.integral, p.error_integral_limit)
                + p.derivative_gain * (command_rate - feedback_rate)
                - p.velocity_gain * self.ram_rate(s),
            p.current_limit,
        );

        // Torque motor and flapper.
        contacts.current = play(current, before.current, p.motor_hysteresis);
        // Half a step may overshoot the spool's stop.
        contacts.spool = play(sat(s.spool, p.spool_stop), before.spool, p.feedback_play);
        let force = p.motor_gain * (contacts.current + p.valve_offset);
        let stiffness = p.flapper_stiffness + p.feedback_stiffness;
        let bending = force - p.feedback_stiffness * contacts.spool;
        let mut flapper = bending / stiffness;
        let flapper_push = bending - stiffness * s.flapper;
        if p.valve == Valve::SecondOrderFlapper {
            flapper = s.flapper;
            let mass = stiffness / p.flapper_frequency.powi(2);
            let damping = 2.0 * p.flapper_damping * (mass * stiffness).sqrt();
            if before.flapper_stop == 0.0 {
                rate.flapper = s.flapper_rate;
                rate.flapper_rate = (flapper_push - damping * s.flapper_rate) / mass;
            }
        }

        // Spool.
        let first_stage = p.first_stage_pressure_gain * sat(flapper, p.flapper_stop);
        let spool_drive = p.spool_area * sat(first_stage, self.supply(s) * p.nominal_supply_pressure);
        let clean = p.first_stage_flow_gain * (1.0 - p.filter_clogging);
        let viscosity = p.spool_viscosity + p.spool_area.powi(2) * p.first_stage_pressure_gain / clean;
        let slide = before.spool_slide;
        rate.spool = match p.valve {
            Valve::FirstOrder { bandwidth, rate_limit } => {
                sat(bandwidth * (force / p.feedback_stiffness - s.spool), rate_limit)
            }
            _ if slide == 0.0 => 0.0,
            _ => (spool_drive - slide * p.spool_friction / p.spool_friction_ratio) / viscosity,
        };

        // Fluid.
        let (pressure, pressure_rate) = self.fluid(s);
        rate.pressure = pressure_rate;
        if e.supply_sag != 0.0 {
            rate.flow = (s.ram_rate.abs() - s.flow) / e.supply_sag_lag;
        }

        // Jack, and the body of its cylinder. `drive` is what the cylinder does to the ram, dry friction apart.
        let v = s.ram_rate;
        let load = self.load(t, ram);
        let detent = match e.detent_force {
            0.0 => 0.0,
            force => force * (TAU * s.ram / e.detent_pitch + e.detent_phase).sin(),
        };
        let drive = p.jack_area * pressure - self.damping(t, v) - detent;
        let (ram_mobility, body_mobility) = (1.0 / p.jack_mass, e.mount.map_or(0.0, |m| 1.0 / m.mass));
        let mount = e.mount.map_or(0.0, |m| m.stiffness * s.body + m.damping * s.body_rate);
        let dragged_mobility = if e.mount.is_some_and(|m| m.load_follows) { body_mobility } else { 0.0 };
        let acceleration = (drive - load) * ram_mobility + (drive + mount) * dragged_mobility;
        let jack_hold = acceleration / (ram_mobility + dragged_mobility);
        let sticks = before.jack_slide == 0.0;
        let friction = if sticks { jack_hold } else { self.jack_friction(t, v, before.jack_slide) };
        if !sticks {
            rate.ram = v;
            rate.ram_rate = (jack_hold - friction) * (ram_mobility + dragged_mobility);
        }
        rate.body = s.body_rate;
        rate.body_rate = (friction - drive - mount) * body_mobility;

        (
            rate,
            Signals {
                command,
                current,
                pressure,
                load,
                ram,
                sensed,
                flapper_push,
                spool_drive,
                jack_hold,
                contacts,
            },
        )
    }
}
