//! Frames on a byte stream: a message and its CRC-32, COBS-encoded, between zeros.

use super::message;
use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use serde::{Deserialize, Serialize};

/// Longest frame, bytes, its closing zero included.
pub const LONGEST: usize = 384;

const CHECKSUM: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// Encodes a message as a frame; the bytes of it in `frame`. None where it is too long.
pub fn encode<'a, M: Serialize>(message: &M, frame: &'a mut [u8; LONGEST]) -> Option<&'a [u8]> {
    let mut plain = [0; LONGEST];
    let length = postcard::to_slice(message, &mut plain).ok()?.len();
    let checksum = CHECKSUM.checksum(plain.get(..length)?).to_le_bytes();
    *plain.get_mut(length..)?.first_chunk_mut::<4>()? = checksum;
    let length = cobs::try_encode(plain.get(..length + 4)?, frame).ok()?;
    *frame.get_mut(length)? = 0;
    frame.get(..=length)
}

/// What came of the bytes so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Received {
    /// Bytes.
    pub bytes: u32,
    /// Frames that were whole.
    pub frames: u32,
    /// Frames that were damaged, too long, or no message.
    pub damaged: u32,
}

/// Finds frames in a stream of bytes.
#[derive(Clone, Debug)]
pub struct Decoder {
    buffer: [u8; LONGEST],
    length: usize,
    received: Received,
}

impl Decoder {
    /// A decoder that has seen nothing.
    pub const fn new() -> Self {
        Self { buffer: [0; LONGEST], length: 0, received: Received { bytes: 0, frames: 0, damaged: 0 } }
    }

    /// Takes a byte; the message that is complete with it.
    #[must_use = "a message is handed out once"]
    pub fn take<M: for<'a> Deserialize<'a>>(&mut self, byte: u8) -> Option<M> {
        if self.is_end(byte) { self.message() } else { None }
    }

    /// Takes a byte: does it end a frame?
    pub(super) fn is_end(&mut self, byte: u8) -> bool {
        self.received.bytes = self.received.bytes.wrapping_add(1);
        if byte == 0 {
            return true;
        }
        if let Some(place) = self.buffer.get_mut(self.length) {
            *place = byte;
        }
        // One past the end: too long.
        self.length = (self.length + 1).min(LONGEST + 1);
        false
    }

    /// The message of the frame that has ended.
    pub(super) fn message<M: for<'a> Deserialize<'a>>(&mut self) -> Option<M> {
        let length = core::mem::take(&mut self.length);
        if length == 0 {
            return None;
        }
        let message = self.buffer.get(..length).and_then(decode);
        let counter = if message.is_some() { &mut self.received.frames } else { &mut self.received.damaged };
        *counter = counter.wrapping_add(1);
        message
    }

    /// What came so far.
    pub const fn received(&self) -> Received {
        self.received
    }
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

/// The message of a frame without its closing zero. Not inlined: its buffer is not needed later.
#[inline(never)]
fn decode<M: for<'a> Deserialize<'a>>(frame: &[u8]) -> Option<M> {
    let mut plain = [0; LONGEST];
    let mut decoder = cobs::CobsDecoder::new(&mut plain);
    for &byte in frame {
        decoder.feed(byte).ok()?;
    }
    let length = decoder.feed(0).ok()??;
    let (content, checksum) = plain.get(..length)?.split_last_chunk::<4>()?;
    if CHECKSUM.checksum(content) != u32::from_le_bytes(*checksum) {
        return None;
    }
    postcard::from_bytes(content).ok()
}

/// Compile-time proof that the longest messages fit.
const _: () = assert!(message::LONGEST_PLAIN + 4 + 2 + 1 < LONGEST);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn receive(bytes: &[u8], decoder: &mut Decoder) -> Option<[u32; 8]> {
        bytes.iter().fold(None, |found, &byte| decoder.take(byte).or(found))
    }

    #[test]
    fn a_frame_comes_out_as_it_went_in() {
        let mut random = Random::new(1);
        let mut decoder = Decoder::new();
        for _ in 0..200 {
            let message: [u32; 8] = core::array::from_fn(|_| random.below(1 << 20) as u32 % 300);
            let mut frame = [0; LONGEST];
            assert_eq!(receive(encode(&message, &mut frame).unwrap(), &mut decoder), Some(message));
        }
        assert_eq!((decoder.received().frames, decoder.received().damaged), (200, 0));
    }

    #[test]
    fn damage_costs_its_frame_and_no_other() {
        let mut random = Random::new(2);
        let message = [7_u32; 8];
        for _ in 0..2000 {
            let mut decoder = Decoder::new();
            let mut frame = [0; LONGEST];
            let length = encode(&message, &mut frame).unwrap().len();
            let place = random.below(length);
            let before = frame;
            frame[place] ^= 1 << random.below(8);
            let damaged = receive(&frame[..length], &mut decoder);
            assert_eq!(damaged, None, "a damaged frame is never taken");
            // The next zero ends whatever is left of it.
            assert_eq!(decoder.take::<[u32; 8]>(0), None);
            assert_eq!(receive(&before[..length], &mut decoder), Some(message));
            assert!(decoder.received().damaged >= 1);
        }
    }

    #[test]
    fn what_is_too_long_or_no_frame_is_counted() {
        let mut decoder = Decoder::new();
        assert_eq!(receive(&[1; 1000], &mut decoder), None);
        assert_eq!(receive(&[0, 5, 0, 1, 1, 0, 0, 0], &mut decoder), None);
        assert_eq!(decoder.received(), Received { bytes: 1008, frames: 0, damaged: 3 });
        let mut frame = [0; LONGEST];
        assert_eq!(encode(&[u32::MAX; 32], &mut frame).map(<[u8]>::len), Some(166));
    }
}
