//! The rigs that come with the program.

use super::{Calibration, CommandPath, Range, Rig};
use eha_monitor::model::{Drive, Feedback, Form, ValveForm};
use eha_monitor::parameter::{Parameter, Parameters};

/// A rig that comes with the program.
#[derive(Clone, Copy, Debug)]
pub struct BuiltIn {
    /// Name that users type.
    pub name: &'static str,
    /// One line for the user.
    pub description: &'static str,
    /// Makes it.
    pub make: fn() -> Rig,
}

/// Every built-in rig; the first is the default.
pub const BUILT_IN: [BuiltIn; 3] = [
    BuiltIn {
        name: "eha",
        description: "the source's electro-hydraulic actuator: two-stage valve, position loop",
        make: eha,
    },
    BuiltIn {
        name: "servo-hydraulic",
        description: "a servo-hydraulic machine in a position loop: first-order valve; loop gain and valve lag free",
        make: servo_hydraulic,
    },
    BuiltIn {
        name: "force-axis",
        description: "an axis driven by a known force: mass, viscous and dry friction, offset free",
        make: force_axis,
    },
];

const fn range(parameter: Parameter, lower: f64, upper: f64) -> Range {
    Range { parameter, lower, upper }
}

fn eha() -> Rig {
    Rig {
        name: "eha".to_owned(),
        form: Form::default(),
        parameters: Parameters::default(),
        calibration: Calibration::default(),
        noise: Vec::new(),
        // The source's bounds.
        faults: vec![range(Parameter::Backlash, 0.0, 1.5e-3), range(Parameter::DryFriction, 200.0, 4000.0)],
        free: Vec::new(),
        effects: Vec::new(),
        command_offset: false,
        command_path: CommandPath::default(),
        restart_s: None,
        controller: None,
        drive_holds: false,
    }
}

fn servo_hydraulic() -> Rig {
    let parameters = Parameters {
        // A machine of unknown size: limits out of the way, a jack so stiff that only loop gain and lag remain.
        proportional_gain: 2500.0,
        current_limit: 1e4,
        valve_bandwidth: 200.0,
        valve_rate_limit: 1e3,
        spool_stop: 0.1,
        pressure_gain: 1e13,
        leakage: 0.0,
        supply_pressure: 1e9,
        viscous_friction: 0.0,
        fdj: 0.0,
        jack_stop: 1.0,
        ..Parameters::default()
    };
    Rig {
        name: "servo-hydraulic".to_owned(),
        form: Form { valve: ValveForm::FirstOrder, feedback: Feedback::Ram, drive: Drive::Valve },
        parameters,
        calibration: Calibration::default(),
        noise: Vec::new(),
        faults: vec![range(Parameter::Backlash, 0.0, 1.5e-3), range(Parameter::DryFriction, 0.0, 4000.0)],
        free: vec![
            range(Parameter::ProportionalGain, 100.0, 50_000.0),
            range(Parameter::ValveBandwidth, 20.0, 2000.0),
        ],
        effects: Vec::new(),
        command_offset: true,
        command_path: CommandPath::default(),
        restart_s: None,
        controller: None,
        drive_holds: false,
    }
}

fn force_axis() -> Rig {
    let parameters = Parameters {
        load_mass: 100.0,
        viscous_friction: 200.0,
        fdj: 20.0,
        breakaway_ratio: 1.0,
        jack_stop: 10.0,
        ..Parameters::default()
    };
    Rig {
        name: "force-axis".to_owned(),
        form: Form { drive: Drive::Force, ..Form::default() },
        parameters,
        calibration: Calibration::default(),
        noise: Vec::new(),
        faults: vec![range(Parameter::Backlash, 0.0, 1.5e-3), range(Parameter::DryFriction, 0.0, 500.0)],
        free: vec![
            range(Parameter::LoadMass, 1.0, 1000.0),
            range(Parameter::ViscousFriction, 0.0, 5000.0),
            range(Parameter::DryFriction, 0.0, 500.0),
            range(Parameter::ConstantLoad, -200.0, 200.0),
        ],
        effects: Vec::new(),
        command_offset: false,
        command_path: CommandPath::default(),
        restart_s: Some(1.0),
        controller: None,
        drive_holds: false,
    }
}
