//! How much is simulated: what a search costs, on whatever machine it runs.

use super::Prepared;
use eha_monitor::integrate::observed::Observer;
use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// What was spent on a record and on all that is made of it, ns of one core.
#[derive(Clone, Debug, Default)]
pub(super) struct Effort(Arc<AtomicU64>);

impl Effort {
    pub(super) fn add(&self, ns: u64) {
        self.0.fetch_add(ns, Ordering::Relaxed);
    }
}

/// What was spent on some records and on all that was made of them, s of one core of the machine that steps were timed on.
/// Steps are counted, not time: it is the same on every machine, whenever the same is done.
pub fn spent_s(records: &[Prepared]) -> f64 {
    let ns = |record: &Prepared| record.effort.0.load(Ordering::Relaxed) as f64;
    records.iter().map(|record| ns(record) * 1e-9).sum()
}

/// How many steps a stepper took.
#[derive(Default)]
pub(super) struct StepCount(Cell<u64>);

impl StepCount {
    pub(super) const fn get(&self) -> u64 {
        self.0.get()
    }
}

impl Observer for StepCount {
    #[inline(always)]
    fn took(&self, steps: u32) {
        self.0.set(self.0.get() + u64::from(steps));
    }
}
