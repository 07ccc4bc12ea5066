//! Torque motor, flapper and first stage: from the current to the pressure on the spool.

use super::ValveForm;
use crate::parameter::Parameters;
use crate::scalar::Real;

/// Constants of torque motor, flapper and first stage.
#[derive(Clone, Copy, Debug)]
pub struct PilotStage<T> {
    /// Force of the torque motor per current `GM`, N/mA.
    torque_motor_gain: T,
    /// Offset of the torque motor `Ofs`, mA.
    offset: T,
    /// Half width of the torque motor's hysteresis `His`, mA.
    pub hysteresis: T,
    /// `KSF`, N/m.
    feedback_stiffness: T,
    /// `KF + KSF`, N/m.
    stiffness: T,
    /// `MF = (KSF + KF)/SNF^2`, kg.
    mass: T,
    /// `CF = 2 ZF sqrt(MF (KSF + KF))`, N s/m.
    damping: T,
    /// Flapper end stop `XFM`, m.
    pub stop: T,
    /// First-stage pressure gain `GPF`, Pa/m.
    pub pressure_gain: T,
    /// Half width of the play of the feedback spring `gioco`, m.
    pub feedback_play: T,
}

impl<T: Real> PilotStage<T> {
    /// The pilot stage of a set of parameters.
    pub fn new(p: &Parameters<T>) -> Self {
        let stiffness = p.flapper_stiffness + p.feedback_stiffness;
        // MF = K/SNF^2, hence CF = 2 ZF sqrt(MF K) = 2 ZF K/SNF: no root needed.
        Self {
            torque_motor_gain: p.torque_motor_gain,
            offset: p.current_offset,
            hysteresis: p.torque_motor_hysteresis,
            feedback_stiffness: p.feedback_stiffness,
            stiffness,
            mass: stiffness / (p.flapper_frequency * p.flapper_frequency),
            damping: T::literal(2.0) * p.flapper_damping * stiffness / p.flapper_frequency,
            stop: p.flapper_stop,
            pressure_gain: p.first_stage_pressure_gain,
            feedback_play: p.feedback_play,
        }
    }

    /// Force of the torque motor, N, from the current behind its hysteresis.
    #[inline(always)]
    pub fn torque_motor_force(&self, current: T, one: T) -> T {
        self.torque_motor_gain * (current + self.offset * one)
    }

    /// Force on the flapper at rest at a position, N, positive outwards.
    #[inline(always)]
    pub fn static_force(&self, motor_force: T, sensed_spool: T, flapper: T) -> T {
        motor_force - self.feedback_stiffness * sensed_spool - self.stiffness * flapper
    }

    /// Acceleration of the flapper, m/s^2.
    #[inline(always)]
    pub fn acceleration(&self, static_force: T, velocity: T) -> T {
        (static_force - self.damping * velocity) / self.mass
    }

    /// Acceleration of the flapper over a step, its damping taken at the middle of the step.
    #[inline(always)]
    pub fn mean_acceleration(&self, static_force: T, velocity: T, step: T) -> T {
        (static_force - self.damping * velocity) / (self.mass + self.damping * step * T::literal(0.5))
    }

    /// Position at which the flapper is in balance, m: its static form.
    #[inline(always)]
    pub fn balanced_position(&self, motor_force: T, sensed_spool: T) -> T {
        (motor_force - self.feedback_stiffness * sensed_spool) / self.stiffness
    }

    /// Spool position that balances the torque motor when the flapper is centred, m.
    #[inline(always)]
    pub fn balanced_spool(&self, motor_force: T) -> T {
        motor_force / self.feedback_stiffness
    }
}

/// Constants of the spool.
#[derive(Clone, Copy, Debug)]
pub struct Spool<T> {
    /// End area `ASV`, m^2.
    pub area: T,
    /// `1/(CSV + ASV^2 GPF/GQF)`, m/(N s).
    mobility: T,
    /// Breakaway friction `FSS`, N.
    pub breakaway: T,
    /// Sliding friction `FSS/FSDS`, N.
    pub sliding: T,
    /// Driving force at which it comes to rest, N: its sliding friction where it sticks and slides as the jack does, its
    /// breakaway friction where it sticks as soon as the force would not set it going.
    pub rest: T,
    /// End stop `XSM`, m.
    pub stop: T,
    /// Half width of the dead zone, m.
    pub overlap: T,
    /// The opening counts `1 + asymmetry` times on the positive side, `1 - asymmetry` times on the other.
    pub asymmetry: T,
    /// First-order valve: bandwidth, rad/s.
    pub bandwidth: T,
    /// First-order valve: rate limit, m/s.
    pub rate_limit: T,
}

impl<T: Real> Spool<T> {
    /// The spool of a set of parameters.
    pub fn new(p: &Parameters<T>) -> Self {
        let flow_gain = p.first_stage_flow_gain * (T::ONE - p.filter_clogging);
        let resistance =
            p.spool_viscosity + p.spool_area * p.spool_area * (p.first_stage_pressure_gain / flow_gain);
        let sliding = p.spool_friction / p.spool_friction_ratio;
        Self {
            area: p.spool_area,
            mobility: T::ONE / resistance,
            breakaway: p.spool_friction,
            sliding,
            rest: (sliding * p.spool_rest_ratio).smaller(p.spool_friction),
            stop: p.spool_stop,
            overlap: p.spool_overlap,
            asymmetry: p.flow_asymmetry,
            bandwidth: p.valve_bandwidth,
            rate_limit: p.valve_rate_limit,
        }
    }

    /// Velocity of the sliding spool, m/s; `direction` is -1 or 1.
    #[inline(always)]
    pub fn velocity(&self, first_stage_pressure: T, direction: T, one: T) -> T {
        (self.area * first_stage_pressure - direction * self.sliding * one) * self.mobility
    }

    /// Is the law of the opening another one on each side of the centre?
    #[inline(always)]
    pub fn has_sides(&self) -> bool {
        self.overlap != T::ZERO || self.asymmetry != T::ZERO
    }

    /// Opening past the dead zone, m, on a side of it (0 inside).
    #[inline(always)]
    pub fn opening(&self, spool: T, side: T, one: T) -> T {
        if !self.has_sides() {
            spool
        } else if side == T::ZERO {
            T::ZERO
        } else {
            (spool - side * self.overlap * one) * (T::ONE + side * self.asymmetry)
        }
    }
}

impl ValveForm {
    /// Does the flapper have a state of its own?
    pub const fn has_flapper_state(self) -> bool {
        matches!(self, Self::TwoStage)
    }
}
