//! State, mode and input of the actuator: what moves, which piece of each non-linearity is active, what drives it.

use crate::scalar::Real;

/// The continuous state. The first five entries are the base model; the others move only with the effect that needs
/// them, and stay at zero otherwise. [`Form::order`](super::Form) says how many an integrator must carry.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct State<T> {
    /// Flapper position `XF`, m.
    pub flapper: T,
    /// Flapper velocity `XF'`, m/s.
    pub flapper_velocity: T,
    /// Spool position `XS`, m.
    pub spool: T,
    /// Ram position in its cylinder `x`, m.
    pub ram: T,
    /// Ram velocity in its cylinder `v`, m/s.
    pub ram_velocity: T,
    /// Integrated position error, m s.
    pub integral: T,
    /// Current behind the torque motor's hysteresis, mA.
    pub held_current: T,
    /// Spool position that the feedback spring feels, behind its play, m.
    pub sensed_spool: T,
    /// User minus ram (over ground) where the user is fed back (behind the backlash), m: a difference, so that `f32`
    /// loses nothing.
    pub user_gap: T,
    /// Differential pressure `P12` where the oil is compressible, Pa.
    pub pressure: T,
    /// Supply ratio `k` minus 1, lagged, where the supply sags.
    pub sag: T,
    /// Position of the base where the mount gives way, m: the ram is at `ram + base` over ground.
    pub base: T,
    /// Velocity of the base, m/s.
    pub base_velocity: T,
    /// What rounding has cut off the ram position, m: the ram is at `ram + ram_rest`. While the spool sticks the loop
    /// is open, and in `f32` the rounding of thousands of small steps would move the ram by tenths of a micrometre.
    pub ram_rest: T,
    /// What rounding has cut off the spool position, m: at its rate limit the spool adds the same increment, and the
    /// same rounding, step after step.
    pub spool_rest: T,
}

/// Number of states of the base model.
pub const BASE_ORDER: usize = 5;
/// Place of the flapper position in the vector.
pub const FLAPPER: usize = 0;
/// Place of the spool position in the vector.
pub const SPOOL: usize = 2;
/// Place of the ram position in the vector.
pub const RAM: usize = 3;
/// Place of the ram velocity in the vector.
pub const RAM_VELOCITY: usize = 4;
/// Place of the pressure of compressible oil in the vector.
pub const PRESSURE: usize = 9;
/// Number of states with every effect.
pub const FULL_ORDER: usize = 13;
/// Number of states that only an effect moves.
const EXTRAS: usize = FULL_ORDER - BASE_ORDER;

/// The order in which an integrator carries the entries of a state: the base model, then those that effects move. So it
/// carries no more of them than move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Places in the state of what follows the base model; behind that, places that no state has.
    extras: [u8; EXTRAS],
}

impl Layout {
    /// No layout yet: all zeros.
    pub const NONE: Self = Self { extras: [0; EXTRAS] };
    /// Every entry, as the state has them.
    pub const NATURAL: Self = Self { extras: [5, 6, 7, 8, 9, 10, 11, 12] };

    /// The layout of a model that moves some of the entries behind the base model: a bit for each, the first the
    /// lowest.
    #[inline(never)]
    pub fn of(moving: u8) -> Self {
        let mut layout = Self { extras: [FULL_ORDER as u8; EXTRAS] };
        let mut carried = 0;
        for (bit, &place) in Self::NATURAL.extras.iter().enumerate() {
            if moving >> bit & 1 != 0
                && let Some(extra) = layout.extras.get_mut(carried)
            {
                *extra = place;
                carried += 1;
            }
        }
        layout
    }

    /// Place in the state of what an integrator carries at an index; `FULL_ORDER` where that is nothing.
    #[inline(always)]
    pub fn place(&self, index: usize) -> usize {
        let extra = index.checked_sub(BASE_ORDER).and_then(|extra| self.extras.get(extra));
        extra.map_or(index, |&place| place.into())
    }

    /// Index at which an integrator carries a place of the state behind the base model; none where it does not move.
    pub fn index(&self, place: usize) -> Option<usize> {
        self.extras.iter().position(|&there| usize::from(there) == place).map(|extra| BASE_ORDER + extra)
    }
}

impl<T: Real> State<T> {
    /// The state as a vector, the base model first.
    #[inline(always)]
    pub const fn to_array(&self) -> [T; FULL_ORDER] {
        [
            self.flapper,
            self.flapper_velocity,
            self.spool,
            self.ram,
            self.ram_velocity,
            self.integral,
            self.held_current,
            self.sensed_spool,
            self.user_gap,
            self.pressure,
            self.sag,
            self.base,
            self.base_velocity,
        ]
    }

    /// The state from its vector.
    #[inline(always)]
    pub const fn from_array(values: [T; FULL_ORDER]) -> Self {
        let [
            flapper,
            flapper_velocity,
            spool,
            ram,
            ram_velocity,
            integral,
            held_current,
            sensed_spool,
            user_gap,
            pressure,
            sag,
            base,
            base_velocity,
        ] = values;
        Self {
            flapper,
            flapper_velocity,
            spool,
            ram,
            ram_velocity,
            integral,
            held_current,
            sensed_spool,
            user_gap,
            pressure,
            sag,
            base,
            base_velocity,
            ram_rest: T::ZERO,
            spool_rest: T::ZERO,
        }
    }

    /// Position of the ram over ground, m.
    #[inline(always)]
    pub fn ground(&self) -> T {
        self.ram + self.base
    }

    /// Moves the ram, m, and keeps what rounding cuts off.
    #[inline(always)]
    pub fn move_ram(&mut self, change: T) {
        (self.ram, self.ram_rest) = compensated(self.ram, self.ram_rest, change);
    }

    /// Moves the spool, m, and keeps what rounding cuts off.
    #[inline(always)]
    pub fn move_spool(&mut self, change: T) {
        (self.spool, self.spool_rest) = compensated(self.spool, self.spool_rest, change);
    }

    /// The state after a change of every entry.
    #[inline(always)]
    pub fn changed(&self, change: &[T; FULL_ORDER]) -> Self {
        self.moved(change, &Layout::NATURAL)
    }

    /// The state after a change of the first `N` entries of a layout.
    #[inline(always)]
    pub fn moved<const N: usize>(&self, change: &[T; N], layout: &Layout) -> Self {
        let mut all = self.to_array();
        for (value, by) in all.iter_mut().zip(change).take(BASE_ORDER) {
            *value += *by;
        }
        for (&place, by) in layout.extras.iter().zip(change.iter().skip(BASE_ORDER)) {
            if let Some(value) = all.get_mut(usize::from(place)) {
                *value += *by;
            }
        }
        let mut next = Self::from_array(all);
        (next.spool, next.spool_rest) = compensated(self.spool, self.spool_rest, change[SPOOL]);
        (next.ram, next.ram_rest) = compensated(self.ram, self.ram_rest, change[RAM]);
        next
    }

    /// Takes over the entries of the base model.
    #[inline(always)]
    pub fn take_base(&mut self, next: &Self) {
        self.flapper = next.flapper;
        self.flapper_velocity = next.flapper_velocity;
        (self.spool, self.spool_rest) = (next.spool, next.spool_rest);
        (self.ram, self.ram_rest) = (next.ram, next.ram_rest);
        self.ram_velocity = next.ram_velocity;
    }

    /// What has been added to an earlier state.
    pub fn since(&self, earlier: &Self) -> Self {
        let mut change = self.to_array();
        for (now, then) in change.iter_mut().zip(earlier.to_array()) {
            *now -= then;
        }
        let mut change = Self::from_array(change);
        change.ram += self.ram_rest - earlier.ram_rest;
        change.spool += self.spool_rest - earlier.spool_rest;
        change
    }

    /// Every entry times a factor.
    pub fn scaled(&self, factor: T) -> Self {
        Self::from_array(self.to_array().map(|value| value * factor))
    }

    /// The first `N` entries of a layout.
    #[inline(always)]
    pub fn leading<const N: usize>(&self, layout: &Layout) -> [T; N] {
        let all = self.to_array();
        let mut first = [T::ZERO; N];
        for (to, from) in first.iter_mut().zip(&all).take(BASE_ORDER) {
            *to = *from;
        }
        for (to, &place) in first.iter_mut().skip(BASE_ORDER).zip(&layout.extras) {
            if let Some(from) = all.get(usize::from(place)) {
                *to = *from;
            }
        }
        first
    }
}

/// A sum and what rounding cut off it (Kahan).
#[inline(always)]
fn compensated<T: Real>(sum: T, rest: T, change: T) -> (T, T) {
    let due = change + rest;
    let next = sum + due;
    (next, due - (next - sum))
}

macro_rules! mode {
    ($(#[$attribute:meta])* { $( $(#[$meaning:meta])* $field:ident $farthest:literal, )* }) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct Mode { $( $(#[$meaning])* pub $field: i8, )* }

        impl Mode {
            /// Every law in its interior.
            pub const INTERIOR: Self = Self { $( $field: 0 ),* };
            /// How far the pieces of each law go from its middle one.
            pub(crate) const FARTHEST: [i8; Self::LAWS] = [$( $farthest ),*];
            /// Number of laws.
            pub const LAWS: usize = [$( stringify!($field) ),*].len();

            /// The pieces of all laws.
            #[inline(always)]
            pub const fn to_array(&self) -> [i8; Self::LAWS] {
                [$( self.$field ),*]
            }

            /// The pieces of all laws, to be changed.
            pub const fn fields_mut(&mut self) -> [&mut i8; Self::LAWS] {
                [$( &mut self.$field ),*]
            }
        }
    };
}

mode! {
    /// The active piece of each piecewise law.
    ///
    /// `0` is the interior (unsaturated, in the gap of a play, stuck); `1` and `-1` the side that is active (saturated,
    /// in contact, sliding in that direction); `2` and `-2` an end stop.
    {
        /// Current at its limit.
        current 1,
        /// Flapper at its stop (first-order valve: spool at its rate limit).
        flapper 1,
        /// First-stage pressure at its limit.
        first_stage 1,
        /// Spool sliding, stuck (0) or at its stop.
        spool 2,
        /// Net pressure at its limit.
        pressure 1,
        /// Jack sliding, stuck (0) or at its stop.
        jack 2,
        /// Spool outside its dead zone.
        overlap 1,
        /// Integrated error at its limit.
        integral 1,
        /// Contact of the torque motor's hysteresis.
        hysteresis 1,
        /// Contact of the feedback spring's play.
        feedback_play 1,
        /// Contact of the backlash where the user position is fed back.
        user_play 1,
        /// The step load is on (1) or not yet (0).
        step_load 1,
        /// Direction in which what pushes the backlash moves, where the mount gives way.
        play_input 1,
    }
}

impl Mode {
    /// A number for each mode: its laws, with two added to each, as digits to the base of five.
    pub fn number(&self) -> u32 {
        self.to_array().iter().fold(0, |number, &law| 5 * number + (law as u32).wrapping_add(2))
    }

    /// Identifies the transition matrices of this mode: modes that differ in a direction only share them, unless
    /// directions matter (a supply that sags with the speed of the ram).
    #[inline]
    pub const fn key(&self, directed: bool) -> u16 {
        (self.current != 0) as u16
            | ((self.flapper != 0) as u16) << 1
            | ((self.first_stage != 0) as u16) << 2
            | (self.spool_slides() as u16) << 3
            | ((self.pressure != 0) as u16) << 4
            | (self.jack_slides() as u16) << 5
            | ((self.overlap != 0) as u16) << 6
            | ((self.integral != 0) as u16) << 7
            | ((self.hysteresis != 0) as u16) << 8
            | ((self.feedback_play != 0) as u16) << 9
            | ((self.user_play != 0) as u16) << 10
            | ((directed && self.jack < 0) as u16) << 11
            | ((directed && self.first_stage < 0) as u16) << 12
            | ((directed && self.overlap < 0) as u16) << 13
    }

    /// Does the spool move?
    #[inline(always)]
    pub const fn spool_slides(&self) -> bool {
        self.spool == 1 || self.spool == -1
    }

    /// Does the ram move?
    #[inline(always)]
    pub const fn jack_slides(&self) -> bool {
        self.jack == 1 || self.jack == -1
    }
}

/// The sign of a mode as a scalar: -1, 0 or 1.
#[inline(always)]
pub fn side<T: Real>(mode: i8) -> T {
    match mode {
        0 => T::ZERO,
        i8::MIN..=-1 => -T::ONE,
        _ => T::ONE,
    }
}

/// What drives the actuator at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Input<T> {
    /// Commanded position `com`, m.
    pub command: T,
    /// Rate of the command, m/s.
    pub command_rate: T,
    /// Force on the jack from outside, N, positive in extension: driving force minus external load.
    pub force: T,
}

/// The input over one sample: both lines run from the value at its start to the value at its end.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct InputSegment<T> {
    /// Input at the start of the sample.
    pub start: Input<T>,
    /// Rate of the force, N/s.
    pub force_rate: T,
    /// Time of the start of the sample since the start of the record, s.
    pub time: T,
}

impl<T: Real> InputSegment<T> {
    /// The line between two samples of command and force.
    #[inline]
    pub fn between(command: [T; 2], force: [T; 2], time: T, sample_rate: T) -> Self {
        Self {
            start: Input {
                command: command[0],
                command_rate: (command[1] - command[0]) * sample_rate,
                force: force[0],
            },
            force_rate: (force[1] - force[0]) * sample_rate,
            time,
        }
    }

    /// The input a time after the start of the sample.
    #[inline(always)]
    pub fn at(&self, elapsed: T) -> Input<T> {
        Input {
            command: self.start.command + self.start.command_rate * elapsed,
            command_rate: self.start.command_rate,
            force: self.start.force + self.force_rate * elapsed,
        }
    }
}

/// What the model predicts at a sample, in the order of [`Channel::MEASURED`](crate::channel::Channel::MEASURED).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outputs<T> {
    /// User position as the LVDT gives it, m.
    pub user: T,
    /// Ram position, m.
    pub ram: T,
    /// Servo-valve current, mA.
    pub current: T,
    /// Differential pressure, Pa.
    pub pressure: T,
}

impl<T: Real> Outputs<T> {
    /// The outputs as a vector.
    #[inline(always)]
    pub const fn to_array(&self) -> [T; 4] {
        [self.user, self.ram, self.current, self.pressure]
    }
}
