//! UART0 of the mps2 boards (Arm CMSDK APB UART).
#![allow(
    unsafe_code,
    reason = "memory-mapped registers: each access is one volatile word inside the UART's block"
)]

use core::ptr::{read_volatile, without_provenance_mut, write_volatile};

/// Address of the registers.
const BASE: usize = 0x4000_4000;
/// Offsets of the registers, in words.
const DATA: usize = 0;
const STATE: usize = 1;
const CONTROL: usize = 2;
const DIVIDER: usize = 4;
/// Bits of the state: the send buffer is full, the receive buffer is full.
const SEND_FULL: u32 = 1 << 0;
const RECEIVE_FULL: u32 = 1 << 1;
/// Bits of the control: send and receive.
const ENABLE: u32 = 1 << 0 | 1 << 1;
/// Smallest divider of the clock: the emulated line has no speed.
const FASTEST: u32 = 16;

/// The line, which is this owner's.
pub(crate) struct Uart {
    /// Address of its registers.
    block: usize,
}

impl Uart {
    /// Switches it on.
    pub(crate) fn new() -> Self {
        let mut uart = Self { block: BASE };
        uart.set(DIVIDER, FASTEST);
        uart.set(CONTROL, ENABLE);
        uart
    }

    /// Waits for a byte.
    pub(crate) fn read(&mut self) -> u8 {
        while self.get(STATE) & RECEIVE_FULL == 0 {}
        self.get(DATA) as u8
    }

    /// Sends bytes.
    pub(crate) fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            while self.get(STATE) & SEND_FULL != 0 {}
            self.set(DATA, byte.into());
        }
    }

    fn get(&self, register: usize) -> u32 {
        // SAFETY: the register is a word of the UART's block, which is always there and aligned.
        unsafe { read_volatile(without_provenance_mut::<u32>(self.block).wrapping_add(register)) }
    }

    fn set(&mut self, register: usize, value: u32) {
        // SAFETY: as above; only this owner writes.
        unsafe { write_volatile(without_provenance_mut::<u32>(self.block).wrapping_add(register), value) }
    }
}
