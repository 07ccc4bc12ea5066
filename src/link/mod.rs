//! The monitor behind a serial line: framed, checksummed packets in, reports out.
//!
//! ```text
//! bytes --> frame (COBS, CRC-32) --> message (postcard) --> Station --> Monitor --> message --> frame --> bytes
//! ```
//!
//! A [`station::Station`] is a function of the bytes that it receives, in order, and of nothing
//! else: the same bytes give the same answer, bit for bit, on a microcontroller and on a host. What is lost, damaged or
//! reordered on the way is dropped with its frame and counted.

pub mod frame;
pub mod message;
pub mod station;
