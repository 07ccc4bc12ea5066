//! How many steps the monitor's model takes for a second of motion: what a microcontroller pays for.

use eha_monitor::command::{COMMANDS, Command, CommandInfo};
use eha_monitor::integrate::Stepper as _;
use eha_monitor::integrate::exact::Exact;
use eha_monitor::model::state::{BASE_ORDER, Input, InputSegment};
use eha_monitor::model::{Form, Model};
use eha_monitor::parameter::Parameters;
use eha_monitor::simulate::Actuator;

const PERIOD: f64 = 1e-3;
/// Samples for which a command is held (0: joined by straight lines), and most steps in a second; a step of 1e-5 s would
/// take 100 000. Measured: 1156 to 2122, 1174 to 9271, 1174 to 4360.
const MOST_STEPS: [(u32, u32); 3] = [(0, 3000), (1, 10_000), (20, 5000)];

/// Steps and events of a second of a command that is held for a number of samples; 0: joined by straight lines.
fn effort(row: &CommandInfo, fdj: f64, held: u32) -> (u32, u32) {
    let parameters = Parameters { fdj, bkl: 2e-4, ..Parameters::default() };
    let actuator = Actuator::new(Model::new(Form::default(), &parameters), PERIOD);
    let mut stepper = Exact::<f64, BASE_ORDER, 32>::new();
    stepper.begin(PERIOD, false, true);
    let command = Command::<f64>::new(row);
    let at = |sample: u32| command.at(f64::from(sample - sample % held.max(1)) * PERIOD);
    let mut motion = actuator.at_rest(at(0), &Input { command: at(0), command_rate: 0.0, force: 0.0 });
    for sample in 0..1000 {
        let [before, here] = [at(sample), at(sample + 1)];
        let arriving = if held > 0 { before } else { here };
        let time = f64::from(sample) * PERIOD;
        let segment = InputSegment::between([before, arriving], [0.0; 2], time, 1.0 / PERIOD);
        actuator.advance(&mut stepper, &mut motion, &segment);
        if arriving != here {
            let from = Input { command: arriving, ..segment.start };
            let to = Input { command: here, ..from };
            actuator.jump(&mut stepper, &mut motion, &from, &to, time + PERIOD);
        }
    }
    (motion.run.steps, motion.run.events)
}

#[test]
fn a_second_of_motion_takes_few_steps() {
    for (held, most) in MOST_STEPS {
        for row in &COMMANDS {
            for fdj in [200.0, 800.0, 6400.0] {
                let (steps, events) = effort(row, fdj, held);
                println!("{:10} {fdj:6} N, held {held:2}: {steps} steps, {events} events", row.name);
                assert!(steps <= most, "{}, {fdj} N, held {held}: {steps} steps", row.name);
            }
        }
    }
}
