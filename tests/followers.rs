//! Candidates that differ in their output only follow one motion, bit for bit as if each had its own.

mod common;

use common::{PERIOD, Rig, command};
use eha_monitor::fit::problem::{Record, Start};
use eha_monitor::fit::walk::Walk;
use eha_monitor::integrate::Stepper as _;
use eha_monitor::integrate::exact::Exact;
use eha_monitor::model::Model;
use eha_monitor::model::state::BASE_ORDER;
use eha_monitor::parameter::Parameters;
use eha_monitor::simulate::Follower;

type Stepper = Exact<f64, BASE_ORDER, 32>;

fn model(change: impl FnOnce(&mut Parameters<f64>)) -> Model<f64> {
    let rig = Rig::with(change);
    Model::new(rig.form, &rig.parameters)
}

#[test]
fn a_follower_shows_what_its_own_simulation_would() {
    let samples = command("mixed-step", 700);
    let starts =
        [Start { time: 0.0, ram: 0.0, velocity: 0.0 }, Start { time: 0.4, ram: 1e-3, velocity: 0.02 }];
    let mut record = Record::new(PERIOD, &samples, &starts[0]);
    (record.stretch, record.starts) = (400, &starts);
    let base = model(|p| (p.fdj, p.bkl) = (800.0, 2e-4));
    let other = model(|p| {
        (p.fdj, p.bkl) = (800.0, 3e-4);
        (p.sensor_lag, p.sensor_gain, p.sensor_delay) = (2e-3, 0.01, 1.5e-3);
    });
    let mut steppers = vec![Stepper::new(); 2];
    for stepper in &mut steppers {
        stepper.begin(PERIOD, false, true);
    }
    let (mut leader, mut alone) = (Walk::new(&base, &record), Walk::new(&other, &record));
    let mut follower = [Some(Follower::of(&other, PERIOD))];
    let mut differences = 0;
    while let Some((sample, own)) = alone.next(&record, &mut steppers[0]) {
        let (_, led) = leader.lead(&record, &mut steppers[1], &mut follower).expect("as many samples");
        let shown = follower[0].as_mut().map(Follower::shown);
        assert_eq!(shown, Some(own.user), "sample {sample}");
        differences += u32::from(own.user != led.user);
    }
    assert!(differences > 300, "the two outputs differ, or the test shows nothing: {differences}");
}
