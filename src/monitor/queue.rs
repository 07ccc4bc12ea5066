//! From the interrupt to the background: a queue with one producer and one consumer that never blocks.

use super::sample::Sample;
use core::sync::atomic::{AtomicU32, Ordering};
use heapless::spsc;

/// Room for `CAPACITY - 1` samples; a power of two is fastest.
#[derive(Debug)]
pub struct SampleQueue<const CAPACITY: usize> {
    samples: spsc::Queue<Sample, CAPACITY>,
    overruns: AtomicU32,
}

impl<const CAPACITY: usize> SampleQueue<CAPACITY> {
    /// An empty queue.
    pub const fn new() -> Self {
        Self { samples: spsc::Queue::new(), overruns: AtomicU32::new(0) }
    }

    /// Its two ends: one for the interrupt, one for the background.
    pub fn split(&mut self) -> (Inlet<'_>, Outlet<'_>) {
        let (producer, consumer) = self.samples.split();
        (Inlet { producer, overruns: &self.overruns }, Outlet { consumer, overruns: &self.overruns })
    }
}

impl<const CAPACITY: usize> Default for SampleQueue<CAPACITY> {
    fn default() -> Self {
        Self::new()
    }
}

/// Has a ring of this capacity any places? It has, as its type says; the queue divides by their number, and only where
/// that is said in sight of the division does it leave no panic behind.
#[inline(always)]
const fn has_places(capacity: usize) -> bool {
    capacity != 0_usize.wrapping_sub(1)
}

/// The interrupt's end.
pub struct Inlet<'a> {
    producer: spsc::Producer<'a, Sample>,
    overruns: &'a AtomicU32,
}

impl Inlet<'_> {
    /// Hands a sample over, in constant time (at most 150 instructions) and without waiting. A sample that finds no
    /// room is lost and counted; the background sees the gap in the ticks. True if there was room.
    #[must_use = "a sample that found no room is lost"]
    pub fn push(&mut self, sample: Sample) -> bool {
        let has_room = has_places(self.producer.capacity()) && self.producer.enqueue(sample).is_ok();
        if !has_room {
            // The interrupt is the only one that writes: no read-modify-write, which some parts do not have.
            let count = self.overruns.load(Ordering::Relaxed);
            self.overruns.store(count.saturating_add(1), Ordering::Relaxed);
        }
        has_room
    }
}

/// The background's end.
pub struct Outlet<'a> {
    consumer: spsc::Consumer<'a, Sample>,
    overruns: &'a AtomicU32,
}

impl Outlet<'_> {
    /// The oldest sample, if there is one.
    #[must_use = "a sample that was taken is not in the queue any more"]
    pub fn pop(&mut self) -> Option<Sample> {
        if has_places(self.consumer.capacity()) { self.consumer.dequeue() } else { None }
    }

    /// Samples that wait.
    pub fn len(&self) -> usize {
        if has_places(self.consumer.capacity()) { self.consumer.len() } else { 0 }
    }

    /// Does none wait?
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Samples that found no room since the queue was made.
    pub fn overruns(&self) -> u32 {
        self.overruns.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(tick: u32) -> Sample {
        Sample { tick, command: 0.0, user: 0.0, current: 0.0 }
    }

    #[test]
    fn samples_come_out_in_order_and_overruns_are_counted() {
        let mut queue = SampleQueue::<8>::new();
        let (mut inlet, mut outlet) = queue.split();
        for round in 0..5 {
            for tick in 0..7 {
                assert!(inlet.push(sample(tick)));
            }
            assert!(!inlet.push(sample(7)));
            assert_eq!((outlet.len(), outlet.overruns()), (7, round + 1));
            for tick in 0..7 {
                assert_eq!(outlet.pop(), Some(sample(tick)));
            }
            assert!(outlet.is_empty());
        }
    }
}
