//! Options and pipeline files as JSON Schema, in the subset that OpenAPI 3.0 takes: for programs that offer
//! forms or check requests.

use super::keys::{PipelineTable, pipeline_keys};
use super::python::value_types;
use super::words::is_list;
use clap::{Arg, Command};
use serde_json::{Map, Value, json};

/// Schema of a command: an object with a property for every option, by its long name with underscores, and
/// for every operand. `x-option` is what is typed, `x-operand` the place of an operand, from 0.
pub fn command_schema(command: &Command) -> Value {
    let mut properties = Map::new();
    let mut required = Vec::new();
    let mut operands = 0;
    for arg in command.get_arguments().filter(|arg| !arg.is_hide_set() && !arg.is_global_set()) {
        let Some(name) = arg.get_long().or(arg.is_positional().then(|| arg.get_id().as_str())) else {
            continue;
        };
        if matches!(name, "help" | "version") {
            continue;
        }
        let key = name.replace('-', "_");
        let mut schema = option_schema(arg);
        match arg.get_long() {
            Some(long) => schema["x-option"] = json!(format!("--{long}")),
            None => {
                schema["x-operand"] = json!(operands);
                operands += 1;
            }
        }
        if arg.is_required_set() {
            required.push(key.clone());
        }
        properties.insert(key, schema);
    }
    let about = command.get_about().map(ToString::to_string).unwrap_or_default();
    object(&about, properties, required)
}

/// Schema of a pipeline file. Keys that are options have the types of their values, tables their keys.
pub fn pipeline_schema() -> Value {
    let tables = pipeline_keys();
    let mut top = table_schema(&tables[0], &tables);
    let is_placed = |table: &&PipelineTable| table.name.starts_with('[') && table.name != SEVERAL;
    for table in tables.iter().skip(1).filter(is_placed) {
        let is_list = table.name.starts_with("[[");
        let path: Vec<&str> = table.name.trim_matches(['[', ']']).split('.').collect();
        let schema = table_schema(table, &tables);
        let mut schema = if is_list { list_of(&schema) } else { schema };
        schema["description"] = json!(table.about);
        let mut place = &mut top;
        let (last, parents) = path.split_last().unwrap_or((&"", &[]));
        for name in parents {
            place = &mut place["properties"][*name];
            if place["items"].is_object() {
                place = &mut place["items"];
            }
        }
        place["properties"][*last] = schema;
    }
    // A channel has the keys of the instrument.
    let mut channel = top["properties"]["scanner"].clone();
    channel["description"] = json!("A channel, which changes the keys of the instrument that it names.");
    let channels = &mut top["properties"]["scanner"]["properties"]["channel"];
    *channels = list_of(&channel);
    channels["description"] = channel["description"].clone();
    let settings = top["properties"]["settings"].clone();
    top["properties"]["leg"]["items"]["properties"]["settings"] = settings;
    add_several(&mut top, &tables);
    top
}

/// Header of the tables of several scanners.
const SEVERAL: &str = "[[scanner]]";

/// Lets `scanner` be a list: each scanner has the keys of a single one and those of [`SEVERAL`].
fn add_several(top: &mut Value, tables: &[PipelineTable]) {
    let keys = &top["properties"];
    let one = keys["scanner"].clone();
    let path = json!({ "type": "string" });
    let paths = list_of(&json!({ "anyOf": [path, keys["output"]["items"]] }));
    let types = [
        ("mount", keys["platform"]["properties"]["mount"].clone()),
        ("output", json!({ "anyOf": [path, paths] })),
        ("settings", keys["settings"].clone()),
    ];
    let mut each = one.clone();
    for table in tables.iter().filter(|table| table.name == SEVERAL) {
        each["description"] = json!(table.about);
        for key in &table.keys {
            let known = types.iter().find(|(name, _)| *name == key.name);
            let mut schema = known.map_or_else(|| path.clone(), |(_, schema)| schema.clone());
            schema["description"] = json!(key.help);
            each["properties"][&key.name] = schema;
        }
        each["required"] = json!(["name", "output"]);
    }
    let description = one["description"].clone();
    top["properties"]["scanner"] = json!({ "anyOf": [one, list_of(&each)], "description": description });
}

fn table_schema(table: &PipelineTable, tables: &[PipelineTable]) -> Value {
    let mut properties = Map::new();
    for key in &table.keys {
        let mut schema = key.types.clone().unwrap_or_else(|| json!({}));
        // Tables within lines are named by the key that takes them.
        if let Some(inner) = tables.iter().find(|table| table.name == key.name && !table.name.is_empty()) {
            let inner = table_schema(inner, &[]);
            schema = if key.name == "prisms" {
                list_of(&inner)
            } else {
                json!({ "anyOf": [inner, { "type": "string" }] })
            };
        }
        schema["description"] = json!(key.help);
        properties.insert(key.name.clone(), schema);
    }
    object(&table.about, properties, Vec::new())
}

fn object(about: &str, properties: Map<String, Value>, required: Vec<String>) -> Value {
    let mut schema = json!({
        "type": "object", "description": about, "properties": properties, "additionalProperties": false
    });
    if !required.is_empty() {
        schema["required"] = json!(required);
    }
    schema
}

fn list_of(schema: &Value) -> Value {
    json!({ "type": "array", "items": schema })
}

/// The values of an option, with its help and default.
fn option_schema(option: &Arg) -> Value {
    let mut schema = option_types(option);
    let help = option.get_long_help().or(option.get_help()).map(ToString::to_string).unwrap_or_default();
    schema["description"] = json!(help);
    if let [default] = option.get_default_values() {
        schema["description"] = json!(format!("{help} [default: {}]", default.to_string_lossy()));
    }
    schema
}

/// The types of the values of an option.
pub(super) fn option_types(option: &Arg) -> Value {
    if !option.get_action().takes_values() {
        return json!({ "type": "boolean" });
    }
    let parser = option.get_value_parser();
    let one = match parser.possible_values() {
        Some(values) => {
            let names: Vec<String> = values.map(|value| value.get_name().to_owned()).collect();
            json!({ "type": "string", "enum": names })
        }
        None => any_of(value_types(parser)),
    };
    if is_list(option) { json!({ "anyOf": [one, list_of(&one)] }) } else { one }
}

/// A value of any of these types.
fn any_of(types: &[&str]) -> Value {
    let of = |kind: &&str| match *kind {
        "array" => {
            json!({ "type": "array", "items": { "anyOf": [{ "type": "number" }, { "type": "string" }] } })
        }
        kind => json!({ "type": kind }),
    };
    match types {
        [one] => of(one),
        types => json!({ "anyOf": types.iter().map(of).collect::<Vec<_>>() }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pipeline_has_the_types_of_its_options_and_the_keys_of_its_tables() {
        let schema = pipeline_schema();
        let keys = &schema["properties"];
        assert_eq!(keys["misses"]["type"], "boolean");
        assert_eq!(keys["seed"]["anyOf"][0]["type"], "integer");
        assert_eq!(keys["part"]["items"]["properties"]["material"]["items"]["properties"]["of"], {
            json!({ "description": keys["part"]["items"]["properties"]["material"]["items"]["properties"]["of"]["description"] })
        });
        let [one, several] = [&keys["scanner"]["anyOf"][0], &keys["scanner"]["anyOf"][1]["items"]];
        for scanner in [one, several] {
            let channel = &scanner["properties"]["channel"]["items"];
            assert!(channel["properties"]["wavelength_nm"].is_object());
        }
        assert!(one["properties"]["output"].is_null() && several["properties"]["mount"].is_object());
        assert_eq!(several["properties"]["name"]["type"], "string");
        assert_eq!(several["required"], json!(["name", "output"]));
        let output = &several["properties"]["output"]["anyOf"][1]["items"]["anyOf"];
        assert!(output[1]["properties"]["path"].is_object());
        assert_eq!(keys["physics"]["additionalProperties"], false);
        assert_eq!(keys["trajectory"]["properties"]["format"]["type"], "string");
        assert!(keys["output"]["items"]["properties"]["path"].is_object());
    }

    #[test]
    fn a_command_has_operands_options_and_what_is_required() {
        let command = Command::new("compare")
            .arg(Arg::new("first").required(true))
            .arg(Arg::new("cell").long("cell").value_parser(clap::value_parser!(f64)))
            .arg(Arg::new("how").long("how-so").value_parser(["a", "b"]));
        let schema = command_schema(&command);
        assert_eq!(schema["required"], json!(["first"]));
        assert_eq!(schema["properties"]["first"]["x-operand"], 0);
        assert_eq!(schema["properties"]["cell"]["type"], "number");
        assert_eq!(schema["properties"]["how_so"]["enum"], json!(["a", "b"]));
        assert_eq!(schema["properties"]["how_so"]["x-option"], "--how-so");
    }
}
