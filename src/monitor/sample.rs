//! One sample as the interrupt hands it over.

/// What the sensors showed at one tick of the sample clock. Any bits are allowed: a value that is no number, or none
/// that the actuator can reach, is excluded and counted, never used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Number of the sample, counted by its source from any start; it wraps. A step other than 1 is a gap or a sample
    /// out of order.
    pub tick: u32,
    /// Commanded position, m.
    pub command: f32,
    /// User position as the LVDT gives it, m.
    pub user: f32,
    /// Servo-valve current, mA.
    pub current: f32,
}
