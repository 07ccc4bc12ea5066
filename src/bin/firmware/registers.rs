//! Registers of a peripheral of the mps2 boards.
#![allow(
    unsafe_code,
    reason = "memory-mapped registers: each access is one volatile word inside the peripheral's block"
)]

use core::ptr::{read_volatile, without_provenance_mut, write_volatile};

/// A block of 32-bit registers, which is this owner's.
pub(crate) struct Registers {
    /// Its address.
    block: usize,
}

impl Registers {
    /// The registers from an address on.
    ///
    /// # Safety
    /// The address is that of a peripheral's block, which is longer than every offset that is read or written, and the
    /// caller owns it.
    pub(crate) const unsafe fn at(block: usize) -> Self {
        Self { block }
    }

    /// Reads a register, by its offset in words.
    pub(crate) fn get(&self, register: u8) -> u32 {
        // SAFETY: the register is a word of the block, which is always there and aligned.
        unsafe { read_volatile(self.word(register)) }
    }

    /// Writes a register, by its offset in words.
    pub(crate) fn set(&mut self, register: u8, value: u32) {
        // SAFETY: as above; only this owner writes.
        unsafe { write_volatile(self.word(register), value) }
    }

    fn word(&self, register: u8) -> *mut u32 {
        without_provenance_mut::<u32>(self.block).wrapping_add(register.into())
    }
}
