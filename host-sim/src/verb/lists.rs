//! `effects`, `commands`, `rigs`: what is known, from the tables that the program runs on.

use crate::cli::Common;
use crate::failure::Failure;
use crate::output::{self, SCHEMA};
use crate::rig::{self, BUILT_IN, Rig};
use eha_monitor::command::{COMMANDS, Shape};
use eha_monitor::effect::{EFFECTS, EffectInfo};
use eha_monitor::parameter::{Parameter, ParameterInfo};
use serde_json::{Value, json};

fn parameter_json(info: &ParameterInfo) -> Value {
    json!({
        "name": info.name, "symbol": info.symbol, "unit": info.unit, "default": info.default,
        "lower": info.lower, "upper": info.upper, "description": info.description,
    })
}

/// Prints names with what they stand for.
fn print_described<'a>(
    header: [&str; 2],
    described: impl Iterator<Item = [&'a str; 2]>,
) -> Result<(), Failure> {
    let mut table = output::table(header);
    table.add_rows(described);
    for column in table.column_iter_mut() {
        column.set_cell_alignment(comfy_table::CellAlignment::Left);
    }
    output::print(&table.to_string())
}

/// Lists the effects.
///
/// # Errors
/// Stdout cannot be written.
pub fn effects(common: &Common) -> Result<(), Failure> {
    if common.json {
        let list: Vec<Value> = EFFECTS
            .iter()
            .map(|effect| {
                let parameters: Vec<Value> =
                    effect.parameters.iter().map(|parameter| parameter_json(parameter.info())).collect();
                json!({
                    "name": effect.name, "port": effect.port.name(), "equation": effect.equation,
                    "parameters": parameters,
                })
            })
            .collect();
        return output::print_json(&json!({ "schema": SCHEMA, "effects": list }));
    }
    let parameters = || EFFECTS.iter().flat_map(|effect| effect.parameters).map(|parameter| parameter.info());
    let width = parameters().map(|info| info.name.len()).max().unwrap_or(0);
    let row = |parameter: &Parameter| {
        let info = parameter.info();
        let (range, absent) = (output::own_range(info), output::plain(info.default));
        format!("\n    {:width$}  {range}, {absent} where it is absent", info.name)
    };
    let entry = |effect: &EffectInfo| {
        let rows: String = effect.parameters.iter().map(row).collect();
        format!("{} ({}): {}{rows}", effect.name, effect.port.name(), effect.equation)
    };
    let entries: Vec<String> = EFFECTS.iter().map(entry).collect();
    output::print(&entries.join("\n"))
}

/// Lists the commands.
///
/// # Errors
/// Stdout cannot be written.
pub fn commands(common: &Common) -> Result<(), Failure> {
    if common.json {
        let list: Vec<Value> = COMMANDS
            .iter()
            .map(|command| {
                json!({
                    "name": command.name, "description": command.description,
                    "amplitude": { "value": command.amplitude, "unit": if command.shape == Shape::Ramp { "m/s" } else { "m" } },
                    "frequency_Hz": command.frequency, "end_frequency_Hz": command.end_frequency,
                    "sweep_s": command.sweep,
                })
            })
            .collect();
        return output::print_json(&json!({ "schema": SCHEMA, "commands": list }));
    }
    print_described(
        ["command", "what it does"],
        COMMANDS.iter().map(|command| [command.name, command.description]),
    )
}

/// Options of `rigs`.
#[derive(Clone, Debug, clap::Args)]
pub struct RigsOptions {
    /// A built-in rig or a rig file to show whole, as a rig file.
    #[arg(id = "rig-to-show", value_name = "NAME|FILE.toml")]
    name: Option<String>,
}

/// Lists the rigs, or shows one.
///
/// # Errors
/// Usage: no such rig.
pub fn rigs(common: &Common, options: &RigsOptions) -> Result<(), Failure> {
    if let Some(name) = &options.name {
        let rig = Rig::load(name)?;
        if common.json {
            let parameters: Vec<Value> = Parameter::all()
                .map(|parameter| {
                    let mut row = parameter_json(parameter.info());
                    row["value"] = json!(rig.parameters.get(parameter));
                    row
                })
                .collect();
            return output::print_json(&json!({
                "schema": SCHEMA, "config": output::config_json(common, &rig, &rig.free, &[]), "parameters": parameters,
            }));
        }
        return output::print(rig::write_whole(&rig, &[format!("rig `{name}`")]).trim_end());
    }
    if common.json {
        let list: Vec<Value> = BUILT_IN
            .iter()
            .map(|built_in| json!({ "name": built_in.name, "description": built_in.description }))
            .collect();
        return output::print_json(&json!({ "schema": SCHEMA, "rigs": list }));
    }
    print_described(
        ["rig", "what it is"],
        BUILT_IN.iter().map(|built_in| [built_in.name, built_in.description]),
    )
}
