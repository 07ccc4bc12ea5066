//! The channels of a record: what a column means, its unit, and whether the model reads or predicts it.
//!
//! One table serves the record reader and writer, the cost, the simulator and the command line.

/// What the model does with a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChannelRole {
    /// The time base.
    Time,
    /// Drives the model; linear between samples.
    Input,
    /// Predicted by the model and compared with the record.
    Measured,
}

/// A column of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
#[non_exhaustive]
pub enum Channel {
    /// Time, s.
    Time,
    /// Commanded position `com`, m.
    Command,
    /// External load on the jack `F_ext`, N, positive against extension.
    Load,
    /// Force on the jack in place of the hydraulic drive, N, positive in extension.
    Drive,
    /// Position of the user (behind the backlash) as the LVDT gives it, m.
    UserPosition,
    /// Position of the ram (before the backlash) `x`, m.
    RamPosition,
    /// Servo-valve current `Cor`, mA.
    Current,
    /// Differential pressure across the jack `P12`, Pa.
    Pressure,
}

/// What is known of a [`Channel`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct ChannelInfo {
    /// The channel.
    pub channel: Channel,
    /// Name of its column in a record.
    pub column: &'static str,
    /// SI unit (mA for currents).
    pub unit: &'static str,
    /// What the model does with it.
    pub role: ChannelRole,
    /// Must a record have it?
    pub required: bool,
    /// Largest magnitude that a real actuator of this class shows; above it the unit is suspect.
    pub plausible: f64,
    /// One line for the user.
    pub description: &'static str,
}

/// Every channel that a record can have, in the order of the columns.
pub const CHANNELS: [ChannelInfo; 8] = {
    const fn row(
        channel: Channel,
        column: &'static str,
        unit: &'static str,
        role: ChannelRole,
        required: bool,
        plausible: f64,
        description: &'static str,
    ) -> ChannelInfo {
        ChannelInfo { channel, column, unit, role, required, plausible, description }
    }
    use Channel::{Command, Current, Drive, Load, Pressure, RamPosition, Time, UserPosition};
    use ChannelRole::{Input, Measured};
    [
        row(Time, "t_s", "s", ChannelRole::Time, true, 1e7, "time, uniform"),
        row(Command, "command_m", "m", Input, true, 2.0, "commanded position"),
        row(UserPosition, "lvdt_m", "m", Measured, true, 2.0, "user position, LVDT"),
        row(RamPosition, "ram_m", "m", Measured, false, 2.0, "ram position"),
        row(Current, "current_mA", "mA", Measured, false, 1e3, "servo-valve current"),
        row(Pressure, "dp_Pa", "Pa", Measured, false, 1e9, "differential pressure of the jack"),
        row(Load, "load_N", "N", Input, false, 1e7, "external load, positive against extension"),
        row(
            Drive,
            "drive_N",
            "N",
            Input,
            false,
            1e7,
            "driving force in place of the valve, positive in extension",
        ),
    ]
};

impl Channel {
    /// The channels that the model predicts, in the order of its outputs.
    pub const MEASURED: [Self; 4] = [Self::UserPosition, Self::RamPosition, Self::Current, Self::Pressure];

    /// Those of them that are positions, which cannot jump.
    pub const POSITIONS: [Self; 2] = [Self::UserPosition, Self::RamPosition];

    /// The row of [`CHANNELS`] for this channel.
    pub fn info(self) -> &'static ChannelInfo {
        CHANNELS.iter().find(|row| row.channel == self).unwrap_or(&CHANNELS[0])
    }
}
