//! UART0 of the mps2 boards (Arm CMSDK APB UART).
#![allow(unsafe_code, reason = "says where the line's registers are")]

use super::registers::Registers;

/// Address of the registers.
const BASE: usize = 0x4000_4000;
/// Offsets of the registers, in words.
const DATA: u8 = 0;
const STATE: u8 = 1;
const CONTROL: u8 = 2;
const DIVIDER: u8 = 4;
/// Bits of the state: the send buffer is full, the receive buffer is full.
const SEND_FULL: u32 = 1 << 0;
const RECEIVE_FULL: u32 = 1 << 1;
/// Bits of the control: send and receive.
const ENABLE: u32 = 1 << 0 | 1 << 1;
/// Smallest divider of the clock: the emulated line has no speed.
const FASTEST: u32 = 16;

/// The line, which is this owner's.
pub(crate) struct Uart {
    registers: Registers,
}

impl Uart {
    /// Switches it on.
    pub(crate) fn new() -> Self {
        // SAFETY: the UART's block, which only this line uses.
        let mut registers = unsafe { Registers::at(BASE) };
        registers.set(DIVIDER, FASTEST);
        registers.set(CONTROL, ENABLE);
        Self { registers }
    }

    /// Waits for a byte.
    pub(crate) fn read(&mut self) -> u8 {
        while self.registers.get(STATE) & RECEIVE_FULL == 0 {}
        self.registers.get(DATA) as u8
    }

    /// Sends bytes.
    pub(crate) fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            while self.registers.get(STATE) & SEND_FULL != 0 {}
            self.registers.set(DATA, byte.into());
        }
    }
}
