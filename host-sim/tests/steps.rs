//! How many steps the monitor's model takes for a second of motion: what a microcontroller pays for.

use eha_monitor::command::{COMMANDS, Command};
use eha_monitor::integrate::Stepper as _;
use eha_monitor::integrate::exact::Exact;
use eha_monitor::model::state::{BASE_ORDER, Input, InputSegment};
use eha_monitor::model::{Form, Model};
use eha_monitor::parameter::Parameters;
use eha_monitor::simulate::Actuator;

const PERIOD: f64 = 1e-3;
/// Most steps in a second; a step of 1e-5 s would take 100 000. Measured: 1208 to 2522.
const MOST_STEPS: u32 = 3000;

#[test]
fn a_second_of_motion_takes_few_steps() {
    for row in &COMMANDS {
        for fdj in [200.0, 800.0, 6400.0] {
            let parameters = Parameters { fdj, bkl: 2e-4, ..Parameters::default() };
            let actuator = Actuator::new(Model::new(Form::default(), &parameters), PERIOD);
            let mut stepper = Exact::<f64, BASE_ORDER, 32>::new();
            stepper.begin(PERIOD, false, true);
            let command = Command::<f64>::new(row);
            let at = |sample: u32| command.at(f64::from(sample) * PERIOD);
            let mut motion =
                actuator.at_rest(at(0), &Input { command: at(0), command_rate: 0.0, force: 0.0 });
            for sample in 0..1000 {
                let ends = [at(sample), at(sample + 1)];
                let time = f64::from(sample) * PERIOD;
                let segment = InputSegment::between(ends, [0.0; 2], time, 1.0 / PERIOD);
                actuator.advance(&mut stepper, &mut motion, &segment);
            }
            let (steps, events) = (motion.run.steps, motion.run.events);
            println!("{:10} {fdj:6} N: {steps} steps, {events} events", row.name);
            assert!(steps <= MOST_STEPS, "{}, {fdj} N: {steps} steps", row.name);
        }
    }
}
