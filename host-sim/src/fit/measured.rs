//! Places of the measured channels, in what has one entry for each.

use eha_monitor::channel::Channel;

/// User position.
pub const USER: usize = 0;
/// Ram position.
pub const RAM: usize = 1;
/// Servo-valve current.
pub const CURRENT: usize = 2;
/// Differential pressure of the jack.
pub const PRESSURE: usize = 3;

const _: () = {
    assert!(matches!(Channel::MEASURED[USER], Channel::UserPosition));
    assert!(matches!(Channel::MEASURED[RAM], Channel::RamPosition));
    assert!(matches!(Channel::MEASURED[CURRENT], Channel::Current));
    assert!(matches!(Channel::MEASURED[PRESSURE], Channel::Pressure));
};
