//! Rig files: TOML in and out.

use super::{
    BUILT_IN, Calibration, CommandPath, Range, Rig, channel_named, effect_named, parameter_named, unknown,
    with_nearest,
};
use crate::failure::Failure;
use crate::fit::MAX_FREE;
use crate::output::own_range;
use eha_monitor::channel::ChannelRole;
use eha_monitor::model::drive::Law;
use eha_monitor::model::{Drive, Feedback, Form, ValveForm};
use eha_monitor::parameter::{Parameter, ParameterInfo};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// What a rig file holds, as it is typed.
#[derive(Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct RigFile {
    /// Built-in rig that the file starts from; `eha` by default.
    base: Option<String>,
    name: Option<String>,
    #[serde(default)]
    model: ModelTable,
    controller: Option<ControllerTable>,
    #[serde(default)]
    parameters: BTreeMap<String, f64>,
    calibration: Option<CalibrationTable>,
    #[serde(default)]
    noise: BTreeMap<String, f64>,
    fault: Option<Vec<RangeTable>>,
    free: Option<Vec<RangeTable>>,
    effect: Option<Vec<EffectTable>>,
}

/// The lists of tables among the entries of a [`RigFile`].
const LISTS: [&str; 3] = ["fault", "free", "effect"];

#[derive(Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct ModelTable {
    valve: Option<ValveName>,
    feedback: Option<FeedbackName>,
    drive: Option<DriveName>,
    restart_s: Option<f64>,
    command_offset: Option<bool>,
    command_path: Option<CommandPath>,
    drive_holds: Option<bool>,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct ControllerTable {
    position_gain: f64,
    velocity_gain: f64,
    limit: f64,
    force_gain: f64,
}

/// The entries of a controller: name, unit, meaning.
const CONTROLLER: [(&str, &str, &str); 4] = [
    ("position-gain", "1/s", "velocity asked for per position error"),
    ("velocity-gain", "V s/m", "output per velocity error, the velocity taken over two samples"),
    ("limit", "V", "limit of the output"),
    ("force-gain", "N/V", "force per output, kept until the next sample"),
];

impl ControllerTable {
    const fn values(&self) -> [f64; 4] {
        [self.position_gain, self.velocity_gain, self.limit, self.force_gain]
    }

    /// The law after a check.
    fn law(&self, form: Form) -> Result<Law<f64>, Failure> {
        if form.drive != Drive::Force || form.feedback != Feedback::Ram {
            return Err(Failure::usage(
                "[controller]: expected `drive = \"force\"` and `feedback = \"ram\"` in [model]; the controller of a \
                 valve is set by `GAP`, `GAI`, `GAD` and `GAS` in [parameters]",
            ));
        }
        for ((name, unit, _), value) in CONTROLLER.into_iter().zip(self.values()) {
            if !value.is_finite() || value <= 0.0 {
                return Err(Failure::usage(format!(
                    "[controller] {name} = {value}: expected a positive number of {unit}"
                )));
            }
        }
        let [position_gain, velocity_gain, limit, force_gain] = self.values();
        Ok(Law { position_gain, velocity_gain, limit, force_gain })
    }
}

/// How well values are known: without a correlation, they hang together in nothing.
#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
struct CalibrationTable {
    parameters: Vec<String>,
    standard_errors: Vec<f64>,
    correlation: Option<Vec<Vec<f64>>>,
}

impl CalibrationTable {
    /// The same after a check.
    fn checked(self) -> Result<Calibration, Failure> {
        let in_table = |message: String| Err(Failure::usage(format!("[calibration] {message}")));
        let parameters: Vec<Parameter> =
            self.parameters.iter().map(|name| parameter_named(name)).collect::<Result<_, _>>()?;
        let count = parameters.len();
        for (index, parameter) in parameters.iter().enumerate() {
            if parameters[..index].contains(parameter) {
                return in_table(format!("`{}` is there twice", self.parameters[index]));
            }
        }
        let errors = self.standard_errors;
        if errors.len() != count || errors.iter().any(|error| !error.is_finite() || *error < 0.0) {
            return in_table(format!("standard-errors: expected {count} numbers, none of them negative"));
        }
        let of_itself = |row: usize| (0..count).map(|column| f64::from(u8::from(row == column))).collect();
        let correlation = self.correlation.unwrap_or_else(|| (0..count).map(of_itself).collect());
        let is_square = correlation.len() == count && correlation.iter().all(|row| row.len() == count);
        let is_valid = |row: usize, column: usize| {
            let (here, there) = (correlation[row][column], correlation[column][row]);
            if row == column { here == 1.0 } else { here == there && here.abs() <= 1.0 }
        };
        if !is_square || !(0..count).all(|row| (0..count).all(|column| is_valid(row, column))) {
            return in_table(format!(
                "correlation: expected {count} rows of as many numbers from -1 to 1, the same in rows and columns, \
                 1 on the diagonal"
            ));
        }
        Ok(Calibration { parameters, standard_errors: errors, correlation })
    }
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct RangeTable {
    name: String,
    lower: f64,
    upper: f64,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct EffectTable {
    name: String,
}

macro_rules! named {
    ($name:ident for $core:ident { $($variant:ident),* }) => {
        #[derive(Clone, Copy, Debug, Deserialize, Serialize)]
        #[serde(rename_all = "kebab-case")]
        enum $name { $($variant),* }

        impl From<$name> for $core {
            fn from(name: $name) -> Self {
                match name { $($name::$variant => Self::$variant),* }
            }
        }

        impl From<$core> for $name {
            fn from(value: $core) -> Self {
                match value { $($core::$variant => Self::$variant),* }
            }
        }
    };
}

named!(ValveName for ValveForm { TwoStage, StaticFlapper, FirstOrder });
named!(FeedbackName for Feedback { Ram, User });
named!(DriveName for Drive { Valve, Force });

/// Reads a rig file.
///
/// # Errors
/// Usage: the file cannot be read, is not TOML, or holds a name, value or range that is wrong; the message names the
/// file and the entry.
pub fn read(path: &Path) -> Result<Rig, Failure> {
    let in_file = |message: String| Failure::usage(format!("{}: {message}", path.display()));
    let text = std::fs::read_to_string(path).map_err(|error| {
        let names = || BUILT_IN.iter().map(|built_in| built_in.name);
        let name = path.to_string_lossy();
        let expected = format!(
            "expected a rig file or one of the built-in rigs {}",
            names().collect::<Vec<_>>().join(", ")
        );
        // A word that is no path is most likely a built-in name mistyped.
        if name.contains(['/', '\\', '.']) {
            in_file(format!("cannot read this rig file ({error}), {expected}"))
        } else {
            Failure::usage(with_nearest(format!("unknown rig `{name}`, {expected}"), &name, names()))
        }
    })?;
    parse(&text).map_err(|failure| in_file(failure.to_string()))
}

fn parse(text: &str) -> Result<Rig, Failure> {
    let file: RigFile = toml::from_str(text)
        .map_err(|error| Failure::usage(list_as_table(text).unwrap_or_else(|| error.to_string())))?;
    let base = file.base.as_deref().unwrap_or(BUILT_IN[0].name);
    let Some(built_in) = BUILT_IN.iter().find(|built_in| built_in.name == base) else {
        return Err(Failure::usage(unknown("base rig", base, BUILT_IN.iter().map(|built_in| built_in.name))));
    };
    let mut rig = (built_in.make)();
    if let Some(name) = file.name {
        rig.name = name;
    }
    let model = file.model;
    rig.form = Form {
        valve: model.valve.map_or(rig.form.valve, Into::into),
        feedback: model.feedback.map_or(rig.form.feedback, Into::into),
        drive: model.drive.map_or(rig.form.drive, Into::into),
    };
    rig.command_offset = model.command_offset.unwrap_or(rig.command_offset);
    rig.command_path = model.command_path.unwrap_or(rig.command_path);
    if let Some(restart) = model.restart_s {
        if restart.is_nan() || restart < 0.0 {
            return Err(Failure::usage(format!("restart-s = {restart}: expected seconds, 0 for never")));
        }
        rig.restart_s = (restart > 0.0).then_some(restart);
    }
    if let Some(controller) = file.controller {
        rig.controller = Some(controller.law(rig.form)?);
        rig.drive_holds = true;
    }
    rig.drive_holds = model.drive_holds.unwrap_or(rig.drive_holds);
    let mut given: BTreeMap<&str, String> = BTreeMap::new();
    for (name, value) in file.parameters {
        let parameter = parameter_named(&name)?;
        let info = parameter.info();
        if !(info.lower..=info.upper).contains(&value) {
            let expected = own_range(info);
            return Err(Failure::usage(format!("parameter `{name}` = {value}: expected {expected}")));
        }
        if let Some(before) = given.insert(info.name, name.clone()) {
            return Err(Failure::usage(format!(
                "[parameters] `{before}` and `{name}` are the same parameter, expected it once"
            )));
        }
        rig.parameters.set(parameter, value);
    }
    if let Some(table) = file.calibration {
        rig.calibration = table.checked()?;
    }
    for (column, noise) in file.noise {
        let channel = channel_named(&column)?;
        if channel.info().role != ChannelRole::Measured || !noise.is_finite() || noise <= 0.0 {
            return Err(Failure::usage(format!(
                "noise of `{column}` = {noise}: expected a measured channel and a positive {}",
                channel.info().unit
            )));
        }
        rig.noise.retain(|(known, _)| *known != channel);
        rig.noise.push((channel, noise));
    }
    if let Some(tables) = file.fault {
        rig.faults = ranges(tables)?;
    }
    if let Some(tables) = file.free {
        rig.free = ranges(tables)?;
    }
    for table in file.effect.into_iter().flatten() {
        let effect = effect_named(&table.name)?;
        if rig.effects.contains(&effect) {
            return Err(Failure::usage(format!("[[effect]] `{}` is there twice", effect.name)));
        }
        rig.effects.push(effect);
    }
    let declared = rig.declared().len();
    if declared > MAX_FREE {
        return Err(Failure::usage(format!(
            "{declared} faults and free parameters: expected at most {MAX_FREE}"
        )));
    }
    Ok(rig)
}

/// Says of a list that is headed as a single table how it is headed; none where each is.
fn list_as_table(text: &str) -> Option<String> {
    LISTS.into_iter().find_map(|name| {
        let head = format!("[{name}]");
        let is_head = |line: &str| line.split('#').next().is_some_and(|line| line.trim() == head);
        let line = 1 + text.lines().position(is_head)?;
        Some(format!("line {line}: found {head}, expected [{head}] above each of them"))
    })
}

fn ranges(tables: Vec<RangeTable>) -> Result<Vec<Range>, Failure> {
    let mut ranges: Vec<Range> = Vec::new();
    for table in tables {
        let range = Range::new(parameter_named(&table.name)?, table.lower, table.upper)?;
        if ranges.iter().any(|known| known.parameter == range.parameter) {
            return Err(Failure::usage(format!("`{}` is declared twice", table.name)));
        }
        ranges.push(range);
    }
    Ok(ranges)
}

/// A name as a rig file spells it.
fn word(name: impl Serialize) -> String {
    let value = toml::Value::try_from(name).ok();
    value.as_ref().and_then(toml::Value::as_str).unwrap_or_default().to_owned()
}

/// Valve, feedback and drive of a model as a rig file spells them.
pub fn spelled(form: Form) -> (String, String, String) {
    (
        word(ValveName::from(form.valve)),
        word(FeedbackName::from(form.feedback)),
        word(DriveName::from(form.drive)),
    )
}

/// The text of a rig file that [`read`] turns into the same rig, with each parameter's meaning beside it.
pub fn write(rig: &Rig, comments: &[String]) -> String {
    with_parameters(rig, comments, |_| None)
}

/// The same text to start from: the parameters that have the source's values are comments in it.
pub fn write_whole(rig: &Rig, comments: &[String]) -> String {
    with_parameters(rig, comments, |row| Some(format!("# {row}")))
}

/// The text of a rig file; `unchanged` makes a line of the row of a parameter that has the source's value, or leaves it out.
fn with_parameters(rig: &Rig, comments: &[String], unchanged: fn(String) -> Option<String>) -> String {
    let mut text = String::new();
    for comment in comments {
        let _ = writeln!(text, "# {comment}");
    }
    let quoted = |value: String| toml::Value::String(value).to_string();
    let _ = writeln!(text, "name = {}", quoted(rig.name.clone()));
    let _ = writeln!(text, "base = \"eha\"");
    for (table, ranges) in [("fault", &rig.faults), ("free", &rig.free)] {
        if ranges.is_empty() {
            let _ = writeln!(text, "{table} = []");
        }
    }
    let _ = writeln!(text, "\n[model]");
    let (valve, feedback, drive) = spelled(rig.form);
    let _ = writeln!(text, "valve = {}", quoted(valve));
    let _ = writeln!(text, "feedback = {}", quoted(feedback));
    let _ = writeln!(text, "drive = {}", quoted(drive));
    let _ = writeln!(text, "command-offset = {}", rig.command_offset);
    let _ = writeln!(text, "command-path = {}", quoted(word(rig.command_path)));
    let _ = writeln!(text, "drive-holds = {}", rig.drive_holds);
    if let Some(restart) = rig.restart_s {
        let _ = writeln!(text, "restart-s = {restart:?}");
    }
    if let Some(Law { position_gain, velocity_gain, limit, force_gain }) = rig.controller {
        let _ = writeln!(text, "\n[controller]");
        let values = [position_gain, velocity_gain, limit, force_gain];
        for ((name, unit, meaning), value) in CONTROLLER.into_iter().zip(values) {
            let _ = writeln!(text, "{name} = {value:?} # {unit}, {meaning}");
        }
    }
    let _ = writeln!(text, "\n[parameters]");
    for parameter in Parameter::all() {
        let (info, value) = (parameter.info(), rig.parameters.get(parameter));
        let ParameterInfo { name, symbol, description, .. } = info;
        let symbol = if symbol.is_empty() { String::new() } else { format!("{symbol}, ") };
        let row = format!("{name} = {value:?} # {symbol}{}, {description}", own_range(info));
        let line = if value == info.default { unchanged(row) } else { Some(row) };
        if let Some(line) = line {
            let _ = writeln!(text, "{line}");
        }
    }
    if !rig.calibration.is_empty() {
        let Calibration { parameters, standard_errors, correlation } = &rig.calibration;
        let names: Vec<&str> = parameters.iter().map(|parameter| parameter.info().name).collect();
        let _ = writeln!(text, "\n[calibration] # how well these values are known");
        let _ = writeln!(text, "parameters = {names:?}");
        let listed = |numbers: &[f64], number: fn(&f64) -> String| {
            format!("[{}]", numbers.iter().map(number).collect::<Vec<_>>().join(", "))
        };
        let _ =
            writeln!(text, "standard-errors = {}", listed(standard_errors, |error| format!("{error:.3e}")));
        let rows: Vec<String> =
            correlation.iter().map(|row| listed(row, |shared| format!("{shared:.6}"))).collect();
        let _ = writeln!(text, "correlation = [{}]", rows.join(", "));
    }
    if !rig.noise.is_empty() {
        let _ = writeln!(text, "\n[noise]");
    }
    for (channel, noise) in &rig.noise {
        let _ = writeln!(text, "{} = {noise:?} # {}", channel.info().column, channel.info().unit);
    }
    for (table, ranges) in [("fault", &rig.faults), ("free", &rig.free)] {
        for range in ranges {
            let info = range.parameter.info();
            let _ = writeln!(
                text,
                "\n[[{table}]]\nname = \"{}\" # {}, {}\nlower = {:?}\nupper = {:?}",
                info.name, info.unit, info.description, range.lower, range.upper
            );
        }
    }
    for effect in &rig.effects {
        let _ = writeln!(text, "\n[[effect]]\nname = \"{}\" # {}", effect.name, effect.equation);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use eha_monitor::effect::EFFECTS;
    use eha_monitor::parameter::PARAMETERS;

    #[test]
    fn every_built_in_rig_survives_the_round_trip() {
        for built_in in &BUILT_IN {
            let mut rig = (built_in.make)();
            rig.noise = vec![(eha_monitor::channel::Channel::UserPosition, 5e-6)];
            rig.effects = vec![&EFFECTS[0]];
            rig.calibration = Calibration {
                parameters: vec![Parameter::SupplyRatio, Parameter::Leakage],
                standard_errors: vec![1e-3, 2.5e-15],
                correlation: vec![vec![1.0, -0.3], vec![-0.3, 1.0]],
            };
            if built_in.name == "force-axis" {
                rig.faults.clear();
                rig.controller = Some(Law {
                    position_gain: 160.18,
                    velocity_gain: 243.45,
                    limit: 10.0,
                    force_gain: 35.15,
                });
                // Not what a controller implies.
                rig.drive_holds = false;
            }
            let comments = ["a comment".to_owned()];
            let (text, whole) = (write(&rig, &comments), write_whole(&rig, &comments));
            for text in [&text, &whole] {
                assert_eq!(parse(text).unwrap(), rig, "{text}");
            }
            for info in PARAMETERS {
                let is_there = |text: &str, start: &str| {
                    text.lines().any(|line| line.starts_with(&format!("{start}{} = ", info.name)))
                };
                let is_changed = rig.parameters.get(info.parameter) != info.default;
                assert_eq!(
                    [is_there(&text, ""), is_there(&text, "# ")],
                    [is_changed, false],
                    "{}",
                    info.name
                );
                assert_eq!(
                    [is_there(&whole, ""), is_there(&whole, "# ")],
                    [is_changed, !is_changed],
                    "{}",
                    info.name
                );
            }
        }
    }

    #[test]
    fn more_than_a_fit_can_free_is_refused() {
        let free = |count: usize| -> String {
            let tables = PARAMETERS[..count].iter();
            let table = |info: &ParameterInfo| {
                format!(
                    "[[free]]\nname = \"{}\"\nlower = {:?}\nupper = {:?}\n",
                    info.name, info.lower, info.upper
                )
            };
            format!("fault = []\n{}", tables.map(table).collect::<String>())
        };
        assert_eq!(parse(&free(MAX_FREE)).unwrap().declared().len(), MAX_FREE);
        let message = parse(&free(MAX_FREE + 1)).unwrap_err().to_string();
        let expected = format!("{} faults and free parameters: expected at most {MAX_FREE}", MAX_FREE + 1);
        assert!(message.contains(&expected), "{message}");
    }

    #[test]
    fn wrong_entries_name_themselves() {
        for (text, expected) in [
            ("[parameters]\nGMM = 1.0", "unknown parameter `GMM`; did you mean `GM`?"),
            ("[parameters]\nGM = -1.0", "parameter `GM` = -1: expected 0.0001 to 1 N/mA"),
            ("base = \"ehb\"", "unknown base rig `ehb`; did you mean `eha`?"),
            ("[[fault]]\nname = \"fdj\"\nlower = 10.0\nupper = 1.0", "range 10 to 1 of `fdj`"),
            ("[noise]\nlvdt_m = 0.0", "noise of `lvdt_m` = 0"),
            (
                "[[fault]]\nname = \"fdj\"\nlower = 1.0\nupper = 9.0\n[[fault]]\nname = \"FDJ\"\nlower = 1.0\nupper = 9.0",
                "`FDJ` is declared twice",
            ),
            (
                "[[effect]]\nname = \"leakage\"\n[[effect]]\nname = \"leakage\"",
                "[[effect]] `leakage` is there twice",
            ),
            (
                "base = \"force-axis\"\n[controller]\nposition-gain = 160.0\nvelocity-gain = -243.0\nlimit = 10.0\nforce-gain = 35.0",
                "[controller] velocity-gain = -243: expected a positive number of V s/m",
            ),
            (
                "base = \"force-axis\"\n[controller]\nposition-gain = 160.0\nlimit = 10.0\nforce-gain = 35.0",
                "missing field `velocity-gain`",
            ),
            (
                "[controller]\nposition-gain = 160.0\nvelocity-gain = 243.0\nlimit = 10.0\nforce-gain = 35.0",
                "[controller]: expected `drive = \"force\"`",
            ),
            (
                "[parameters]\nfdj = 600.0\nFDJ = 500.0",
                "[parameters] `FDJ` and `fdj` are the same parameter, expected it once",
            ),
            ("[noise]\ncommand_m = 1.0", "noise of `command_m` = 1"),
            ("[[effect]]\nname = \"sensor-of\"", "did you mean `sensor-offset`?"),
            ("[model]\nvalve = \"third-order\"", "unknown variant `third-order`"),
            ("[modle]\n", "unknown field `modle`"),
            (
                "[model]\n[fault] # worn\nname = \"fdj\"\nlower = 1.0\nupper = 9.0",
                "line 2: found [fault], expected [[fault]] above each of them",
            ),
            (
                "[free]\nname = \"GM\"\n[free]\nname = \"fdj\"",
                "line 1: found [free], expected [[free]] above each of them",
            ),
            ("[effect]\nname = \"leakage\"", "line 1: found [effect], expected [[effect]]"),
            (
                "[calibration]\nparameters = [\"GM\"]\nstandard-errors = [1.0, 2.0]",
                "[calibration] standard-errors: expected 1 numbers, none of them negative",
            ),
            (
                "[calibration]\nparameters = [\"GM\", \"torque_motor_gain\"]\nstandard-errors = [1.0, 2.0]",
                "[calibration] `torque_motor_gain` is there twice",
            ),
            (
                "[calibration]\nparameters = [\"GM\", \"Clk\"]\nstandard-errors = [1.0, 2.0]\ncorrelation = [[1.0, 0.5], [0.4, 1.0]]",
                "[calibration] correlation: expected 2 rows",
            ),
        ] {
            let message = parse(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{text}: {message}");
        }
    }
}
