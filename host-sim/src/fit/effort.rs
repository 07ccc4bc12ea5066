//! How much is simulated: what a search costs, on whatever machine it runs.

use super::Prepared;
use crate::interrupt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The account of a record, of all that is made of it, and of others that share it.
#[derive(Clone, Debug, Default)]
pub(super) struct Effort(Arc<Account>);

#[derive(Debug, Default)]
struct Account {
    /// What was spent, ns of one core.
    ns: AtomicU64,
    /// Is what is done with these records left where the user interrupts it?
    may_be_left: AtomicBool,
}

/// Records that are fitted together share an account: what is spent on some of them counts whichever are asked.
pub fn share_account(records: &mut [Prepared]) {
    let account = Effort::default();
    for record in records {
        record.effort = account.clone();
    }
}

impl Effort {
    pub(super) fn add(&self, ns: u64) {
        self.0.ns.fetch_add(ns, Ordering::Relaxed);
    }

    /// Is what is done with its records to be left now?
    pub(super) fn is_to_be_left(&self) -> bool {
        interrupt::requested() && self.0.may_be_left.load(Ordering::Relaxed)
    }
}

/// What was spent on some records and on all that was made of them, s of one core of the machine that steps were timed on;
/// an account that they share counts once. Steps are counted, not time: it is the same on every machine, whenever the same
/// is done.
pub fn spent_s(records: &[Prepared]) -> f64 {
    let is_first = |(index, record): &(usize, &Prepared)| {
        !records[..*index].iter().any(|before| Arc::ptr_eq(&before.effort.0, &record.effort.0))
    };
    let ns = |(_, record): (usize, &Prepared)| record.effort.0.ns.load(Ordering::Relaxed) as f64;
    records.iter().enumerate().filter(is_first).map(|record| ns(record) * 1e-9).sum()
}

/// Does some work on records; none where the user interrupts it, which is seen where the simulation of a record begins, in
/// whichever thread.
pub fn unless_interrupted<T>(records: &[Prepared], work: impl FnOnce() -> T) -> Option<T> {
    let may_be_left = |may_be_left: bool| {
        for record in records {
            record.effort.0.may_be_left.store(may_be_left, Ordering::Relaxed);
        }
    };
    may_be_left(true);
    let done = interrupt::unless_left(work);
    may_be_left(false);
    done
}

#[cfg(test)]
mod tests {
    use super::{share_account, spent_s};
    use crate::fit::{self, Prepared};
    use crate::record::Record;
    use crate::rig::Rig;
    use eha_monitor::channel::Channel;

    #[test]
    fn what_is_spent_on_some_of_the_records_counts_without_these() {
        let rig = Rig::load("eha").unwrap();
        let swing: Vec<f64> = (0..200).map(|k| 1e-3 * (f64::from(k) * 0.05).sin()).collect();
        let channels = vec![(Channel::Command, swing.clone()), (Channel::UserPosition, swing)];
        let record = Record::new("made", 1e-3, 0.0, channels).unwrap();
        // What a prediction of all takes, as all of them and as the later ones see it.
        let spent = |is_shared: bool| {
            let mut records: Vec<Prepared> = (0..3).map(|_| fit::prepare(&rig, &record)).collect();
            if is_shared {
                share_account(&mut records);
            }
            let seen = || [spent_s(&records), spent_s(&[records[1].begin(50), records[2].clone()])];
            let before = seen();
            fit::predict(&rig, &records);
            std::array::from_fn(|who| seen()[who] - before[who])
        };
        let [all, later]: [f64; 2] = spent(true);
        assert!(all > 0.0 && later == all, "{all} {later}");
        // Each with an account of its own.
        let [all_alone, later_alone]: [f64; 2] = spent(false);
        assert!((all_alone / all - 1.0).abs() < 1e-9 && later_alone == 0.0, "{all_alone} {later_alone}");
    }
}
