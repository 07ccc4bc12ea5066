//! The workload's platform on a host: result lines on the standard output, no measurement.

use crate::Platform;

/// The host.
pub(crate) struct Host;

impl Platform for Host {
    fn result_f32(&mut self, group: &str, name: &str, value: f32) {
        println!("result {group}.{name}={:#010x}", value.to_bits());
    }

    fn result_count(&mut self, group: &str, name: &str, value: u64) {
        println!("result {group}.{name}={value}");
    }

    /// A host's instruction count says nothing of the microcontroller's: runs `work` and reports nothing.
    fn measure<T>(&mut self, _group: &str, _name: &str, work: impl FnOnce() -> T) -> T {
        work()
    }

    fn measure_worst(
        &mut self,
        _group: &str,
        _name: &str,
        rounds: u32,
        mut prepare: impl FnMut(u32),
        mut work: impl FnMut(u32),
    ) {
        for round in 0..rounds {
            prepare(round);
            work(round);
        }
    }
}
