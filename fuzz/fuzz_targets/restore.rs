//! Bytes in place of a snapshot.
#![no_main]

#[path = "../entry.rs"]
#[allow(dead_code, reason = "each target uses one of the entry points")]
mod entry;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| entry::restore(bytes));
