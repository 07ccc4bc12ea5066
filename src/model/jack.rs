//! The jack: `MJ v' = AJ P12 - CJ v - F_ext - Kaer x - friction - cogging(x)`, with stick-slip and end stops.
//!
//! Where the mount gives way, `x` and `v` are those of the ram in its cylinder, and the cylinder's body is a mass on a
//! spring and a damper that takes the reaction. Fluid and friction then drive the relative motion of two masses: the
//! same equation with the reduced mass, and with shares of the load and of the mount's reaction. A load whose inertia
//! follows only a share `sl` of the base's motion counts with that share of its mass in the reduced one: at 0 the ram moves
//! in its cylinder as on a rigid mount, and the reaction moves nothing but what the sensors see.

use super::state::State;
use crate::parameter::Parameters;
use crate::scalar::Real;

/// Constants of a mount that gives way.
#[derive(Clone, Copy, Debug)]
struct Mount<T> {
    stiffness: T,
    damping: T,
    load_mass: T,
    /// Mass that the mount carries: the base's and what of the load's follows it, kg.
    total_mass: T,
    /// `mb/(sl MJ + mb)`: share of the load in the relative motion; the rest is that of the mount's reaction.
    load_share: T,
}

impl<T: Real> Mount<T> {
    fn of(p: &Parameters<T>) -> Option<Self> {
        (p.mount_compliance > T::ZERO).then(|| {
            let stiffness = T::ONE / p.mount_compliance;
            let total_mass = p.load_follows_base * p.load_mass + p.base_mass;
            Self {
                stiffness,
                damping: p.mount_lag * stiffness,
                load_mass: p.load_mass,
                total_mass,
                load_share: p.base_mass / total_mass,
            }
        })
    }

    /// Force of the mount on the base, N, against its motion.
    #[inline(always)]
    fn reaction(&self, base: T, velocity: T) -> T {
        self.stiffness * base + self.damping * velocity
    }

    /// Reaction at the middle of a step in which the base keeps its velocity, N, and what each m/s^2 adds to it.
    #[inline(always)]
    fn at_middle(&self, z: &State<T>, half: T) -> (T, T) {
        (
            self.reaction(z.base + half * z.base_velocity, z.base_velocity),
            half * (self.damping + half * self.stiffness),
        )
    }
}

/// Viscous friction of a lubricant that thins as it is sheared (Cross's law of order one).
#[derive(Clone, Copy, Debug)]
struct Thinning<T> {
    /// At rest, N s/m.
    viscosity: T,
    /// Where half of it is left, m/s.
    velocity: T,
}

impl<T: Real> Thinning<T> {
    /// Its magnitude at a speed, N, and the slope of that, N s/m.
    #[inline]
    fn of(&self, speed: T) -> (T, T) {
        let left = self.velocity / (self.velocity + speed);
        (self.viscosity * left * speed, self.viscosity * left * left)
    }
}

/// A force that repeats along the way: poles of a motor, balls of a screw, teeth.
#[derive(Clone, Copy, Debug)]
struct Cogging<T> {
    /// Amplitudes against extension, N.
    cosine: T,
    sine: T,
    /// 1 over the pitch, 1/m.
    per_metre: T,
}

impl<T: Real> Cogging<T> {
    #[inline(always)]
    fn exists(&self) -> bool {
        self.cosine != T::ZERO || self.sine != T::ZERO
    }

    /// Force against extension, N.
    #[inline]
    fn force(&self, ram: T) -> T {
        let [cosine, sine] = (ram * self.per_metre).circle_of_turns();
        self.cosine * cosine + self.sine * sine
    }
}

/// Constants of the jack.
#[derive(Clone, Copy, Debug)]
pub struct Jack<T> {
    /// Area `AJ`, m^2.
    pub area: T,
    /// Mass that the relative motion moves, kg: the load's, or the reduced mass of load and base.
    mass: T,
    mount: Option<Mount<T>>,
    /// Viscous friction in extension and in retraction: mean, and half of the difference, N s/m.
    viscous: T,
    viscous_side: T,
    quadratic: T,
    spring: T,
    /// End stop `XJM`, m.
    pub stop: T,
    /// Sliding dry friction `FDJ`, N.
    sliding: T,
    /// Breakaway over sliding friction `FSD`.
    breakaway_ratio: T,
    asymmetry: T,
    stribeck_velocity: T,
    thinning: Thinning<T>,
    cogging: Cogging<T>,
    /// Load against extension that is always there, N.
    constant_load: T,
    /// Load against extension from its time on, N.
    step_load: T,
    /// When the step load starts, s.
    pub step_load_time: T,
}

impl<T: Real> Jack<T> {
    /// The jack of a set of parameters.
    pub fn new(p: &Parameters<T>) -> Self {
        let mount = Mount::of(p);
        let retraction = (p.viscous_friction + p.retraction_viscosity).larger(T::ZERO);
        let viscous_side = if p.retraction_viscosity == T::ZERO {
            T::ZERO
        } else {
            (p.viscous_friction - retraction) * T::literal(0.5)
        };
        Self {
            area: p.jack_area,
            mass: mount.map_or(p.load_mass, |mount| p.load_mass * mount.load_share),
            mount,
            viscous: p.viscous_friction - viscous_side,
            viscous_side,
            quadratic: p.quadratic_drag,
            spring: p.spring_load,
            stop: p.jack_stop,
            sliding: p.fdj,
            breakaway_ratio: p.breakaway_ratio,
            asymmetry: p.friction_asymmetry,
            stribeck_velocity: p.stribeck_velocity,
            thinning: Thinning { viscosity: p.thinning_viscosity, velocity: p.thinning_velocity },
            cogging: Cogging {
                cosine: p.cogging_cosine,
                sine: p.cogging_sine,
                per_metre: T::ONE / p.cogging_pitch,
            },
            constant_load: p.constant_load,
            step_load: p.step_load,
            step_load_time: p.step_load_time,
        }
    }

    /// Are all of its laws piecewise affine?
    pub fn is_affine(&self) -> bool {
        self.quadratic == T::ZERO
            && self.stribeck_velocity == T::ZERO
            && self.thinning.viscosity == T::ZERO
            && !self.cogging.exists()
    }

    /// Is its damping another one in each direction?
    #[inline(always)]
    pub fn has_sides(&self) -> bool {
        self.viscous_side != T::ZERO
    }

    /// Viscous friction, N s/m, of the ram that slides in a direction.
    #[inline(always)]
    fn viscous(&self, direction: T) -> T {
        self.viscous + direction * self.viscous_side
    }

    /// Force of the cogging on the ram, N, positive in extension, at a position in the cylinder.
    #[inline(always)]
    pub fn cogging(&self, ram: T) -> T {
        if self.cogging.exists() { -self.cogging.force(ram) } else { T::ZERO }
    }

    /// Does a step load exist?
    #[inline(always)]
    pub fn has_step_load(&self) -> bool {
        self.step_load != T::ZERO
    }

    /// Does a load grow with the position?
    pub fn has_spring(&self) -> bool {
        self.spring != T::ZERO
    }

    /// Does the mount give way, so that the base moves?
    #[inline(always)]
    pub fn is_mounted(&self) -> bool {
        self.mount.is_some()
    }

    /// Force on the ram from outside the jack, N, positive in extension.
    #[inline(always)]
    fn outer_force(&self, ground: T, force: T, step_load_on: bool, one: T) -> T {
        let load = if step_load_on { self.constant_load + self.step_load } else { self.constant_load };
        force - load * one - self.spring * ground
    }

    /// Force on the ram other than damping and friction, N, positive in extension. On a mount that gives way: the
    /// force that friction would have to balance to hold the ram in its cylinder.
    #[inline(always)]
    pub fn drive(&self, pressure: T, z: &State<T>, force: T, step_load_on: bool, one: T) -> T {
        let outer = self.outer_force(z.ground(), force, step_load_on, one);
        let outer = self.mount.map_or(outer, |mount| {
            let reaction = mount.reaction(z.base, z.base_velocity);
            outer * mount.load_share + reaction * (T::ONE - mount.load_share)
        });
        self.area * pressure + outer
    }

    /// Acceleration of the base, m/s^2, from that of the ram in its cylinder: the momentum of both changes by what
    /// load and mount do.
    #[inline(always)]
    pub fn base_acceleration(
        &self,
        z: &State<T>,
        force: T,
        step_load_on: bool,
        ram_acceleration: T,
        one: T,
    ) -> T {
        self.mount.map_or(T::ZERO, |mount| {
            let outer = self.outer_force(z.ground(), force, step_load_on, one);
            let reaction = mount.reaction(z.base, z.base_velocity);
            (outer - reaction - mount.load_mass * ram_acceleration) / mount.total_mass
        })
    }

    /// Drive without the pressure's force and inertia of the relative motion over a step from `z`, the base taken at
    /// the middle of the step implicitly; `middle` has the ram's position there.
    #[inline(always)]
    pub fn midpoint_drive(
        &self,
        z: &State<T>,
        middle: &State<T>,
        force: T,
        step_load_on: bool,
        half: T,
    ) -> (T, T) {
        let outer = self.outer_force(middle.ground(), force, step_load_on, T::ONE);
        self.mount.map_or((outer, self.mass), |mount| {
            // The reaction is `start + gain * b''` with `b'' = (outer - reaction - MJ a)/(sl MJ + mb)`: solved for `a`.
            let (start, gain) = mount.at_middle(z, half);
            let weight = T::ONE / (mount.total_mass + gain);
            let share = T::ONE - mount.load_share;
            let reaction = (mount.total_mass * start + gain * outer) * weight;
            let inertia = self.mass + share * gain * mount.load_mass * weight;
            (outer * mount.load_share + share * reaction, inertia)
        })
    }

    /// Moves the base over a step that has given `end` its ram velocity.
    #[inline(always)]
    pub fn move_base(
        &self,
        z: &State<T>,
        middle: &State<T>,
        end: &mut State<T>,
        force: T,
        step_load_on: bool,
        half: T,
    ) {
        if let Some(mount) = self.mount {
            let outer = self.outer_force(middle.ground(), force, step_load_on, T::ONE);
            let (start, gain) = mount.at_middle(z, half);
            let ram_change = (end.ram_velocity - z.ram_velocity) * T::literal(0.5);
            let change = (half * (outer - start) - mount.load_mass * ram_change) / (mount.total_mass + gain);
            end.base_velocity = z.base_velocity + change + change;
            end.base = z.base + (half + half) * (z.base_velocity + change);
        }
    }

    /// Magnitude of the friction that is to be overcome at rest, N, in a direction (-1 or 1).
    #[inline(always)]
    pub fn breakaway(&self, direction: T) -> T {
        self.sliding * self.breakaway_ratio * (T::ONE + self.asymmetry * direction)
    }

    /// Friction of the sliding ram, N, positive in extension: Coulomb's, opposite to `direction`.
    #[inline(always)]
    pub fn coulomb(&self, direction: T) -> T {
        -direction * self.sliding * (T::ONE + self.asymmetry * direction)
    }

    /// Acceleration of the sliding ram by the affine laws, m/s^2.
    #[inline(always)]
    pub fn affine_acceleration(&self, drive: T, velocity: T, direction: T, one: T) -> T {
        (drive + self.coulomb(direction) * one - self.viscous(direction) * velocity) / self.mass
    }

    /// Forces that are not affine in velocity and position (Stribeck, quadratic drag, thinning, cogging), N, positive
    /// in extension, and their slope with the velocity, N s/m.
    #[inline]
    pub fn curved_force(&self, ram: T, velocity: T, direction: T) -> (T, T) {
        let speed = (velocity * direction).larger(T::ZERO);
        let drag = self.quadratic * speed;
        let mut force = -direction * drag * speed;
        let mut slope = -T::literal(2.0) * drag;
        if self.stribeck_velocity > T::ZERO {
            let rest = self.coulomb(direction)
                * (self.breakaway_ratio - T::ONE)
                * (speed / self.stribeck_velocity).exp_negative();
            force += rest;
            slope += -direction * rest / self.stribeck_velocity;
        }
        if self.thinning.viscosity != T::ZERO {
            let (thinned, by_speed) = self.thinning.of(speed);
            force += -direction * thinned;
            slope += -by_speed;
        }
        (force + self.cogging(ram), slope)
    }

    /// The line on which velocity and pressure lie at the middle of a step:
    /// `v_mid = velocity + compliance * P12` (implicit midpoint), from everything but the pressure's force.
    #[inline(always)]
    pub fn midpoint_line(
        &self,
        force_without_pressure: T,
        mass: T,
        velocity: T,
        direction: T,
        half: T,
    ) -> (T, T) {
        let viscous = self.viscous(direction);
        let inertia = mass + half * viscous;
        (
            velocity + half * (force_without_pressure - viscous * velocity) / inertia,
            half * self.area / inertia,
        )
    }
}
