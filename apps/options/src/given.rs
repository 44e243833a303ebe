//! Options from values, for programs: each value is deserialised into the field that the key of a pipeline
//! file sets, without a command line in between.

use super::groups::{EchoOptions, InputOptions, NoiseOptions, Options, OriginOptions, OutputOptions};
use super::groups::{ProfileOptions, ScheduleOptions, TreeOptions};
use super::precedence::Precedence;
use super::trajectory::TrajectoryOptions;
use super::values::NavigationError;
use super::words::{command, is_list};
use clap::{Arg, Args, Command};
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, from_value, json};
use std::collections::BTreeMap;
use std::sync::LazyLock;
use vlscan_base::error::{Error, Result};
use vlscan_survey::field_names;

/// Values of options by name, which is that of the command line with underscores.
pub type OptionValues = Map<String, Value>;

/// Sets an option to a value.
type Setter = fn(&mut Options, Value) -> serde_json::Result<()>;

/// Setting of an option.
struct Place {
    /// Sets fields of a group by a table of keys, or an option without a key by its value.
    set: Setter,
    /// Key in the table of the group.
    key: Option<&'static str>,
    /// True if the key has the opposite meaning.
    is_negated: bool,
    /// True if the option takes a list.
    is_list: bool,
    /// Character that separates the elements of a list in one text.
    delimiter: Option<char>,
    /// Names of options that contradict this one.
    conflicts: Vec<String>,
}

/// Options by name.
static PLACES: LazyLock<BTreeMap<String, Place>> = LazyLock::new(places);

/// Name of an option in a program.
fn name_of(option: &Arg) -> Option<String> {
    option.get_long().map(|long| long.replace('-', "_"))
}

/// Sets the keys of a group to the values of a table.
fn change<T: DeserializeOwned + Precedence + Default>(group: &mut T, keys: Value) -> serde_json::Result<()> {
    let given: T = from_value(keys)?;
    *group = given.over(std::mem::take(group));
    Ok(())
}

fn places() -> BTreeMap<String, Place> {
    let command = command();
    let mut places = BTreeMap::new();
    let all = &mut places;
    add::<OutputOptions>(all, &command, "", |options, keys| change(&mut options.output, keys));
    add::<InputOptions>(all, &command, "", |options, keys| change(&mut options.input, keys));
    add::<OriginOptions>(all, &command, "", |options, keys| change(&mut options.origin, keys));
    let trajectory: Setter = |options, keys| change(&mut options.trajectory, keys);
    add::<TrajectoryOptions>(all, &command, "trajectory.", trajectory);
    add::<NoiseOptions>(all, &command, "", |options, keys| change(&mut options.noise, keys));
    add::<ProfileOptions>(all, &command, "", |options, keys| change(&mut options.profile, keys));
    add::<EchoOptions>(all, &command, "", |options, keys| change(&mut options.echoes, keys));
    add::<ScheduleOptions>(all, &command, "", |options, keys| change(&mut options.schedule, keys));
    add::<TreeOptions>(all, &command, "", |options, keys| change(&mut options.tree, keys));
    for (name, set) in WITHOUT_KEY {
        let option = command.get_arguments().find(|option| name_of(option).as_deref() == Some(name));
        if let Some(option) = option {
            places.insert(name.to_owned(), place(&command, option, None, set));
        }
    }
    places
}

/// Options that are no keys of a pipeline file.
const WITHOUT_KEY: [(&str, Setter); 7] = [
    ("out", |options, value| from_value(value).map(|paths| options.output.out = paths)),
    ("output", |options, value| from_value(value).map(|path| options.output.output = Some(path))),
    ("format", |options, value| from_value(value).map(|format| options.output.format = Some(format))),
    ("scene", |options, value| from_value(value).map(|scene| options.input.scene = Some(scene))),
    ("trajectory_out", |options, value| from_value(value).map(|path| options.trajectory_out = Some(path))),
    ("parts", |options, value| from_value(value).map(|path| options.part_table = Some(path))),
    ("navigation_error", navigation_errors),
];

/// Sets errors of navigation from a table of numbers, or from texts of the form KEY=NUMBERS.
fn navigation_errors(options: &mut Options, value: Value) -> serde_json::Result<()> {
    let texts: Vec<String> = match value {
        Value::Object(keys) => {
            keys.iter().map(|(key, numbers)| format!("{key}={}", listed(numbers))).collect()
        }
        texts => from_value(texts)?,
    };
    for text in texts {
        let error = text.parse::<NavigationError>();
        options.navigation.errors.push(error.map_err(<serde_json::Error as serde::de::Error>::custom)?);
    }
    Ok(())
}

/// A number, or numbers with commas between them.
fn listed(value: &Value) -> String {
    match value {
        Value::Array(items) => items.iter().map(listed).collect::<Vec<_>>().join(","),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// Adds the options of a group. `prefix` is that of its ids.
fn add<T: Args + DeserializeOwned>(
    places: &mut BTreeMap<String, Place>,
    command: &Command,
    prefix: &str,
    set: Setter,
) {
    for key in field_names::<T>() {
        let with_prefix = format!("{prefix}{key}");
        let of_group = T::augment_args(Command::new("options"));
        let is_of_key = |option: &&Arg| option.get_id() == *key || *option.get_id() == *with_prefix;
        let Some(id) = of_group.get_arguments().find(is_of_key).map(|option| option.get_id().clone()) else {
            continue;
        };
        let option = command.get_arguments().find(|option| *option.get_id() == id);
        if let Some((option, name)) = option.and_then(|option| Some((option, name_of(option)?))) {
            places.insert(name, place(command, option, Some(key), set));
        }
    }
}

fn place(command: &Command, option: &Arg, key: Option<&'static str>, set: Setter) -> Place {
    let is_negative = option.get_long().is_some_and(|long| long.starts_with("no-"));
    let conflicts = command.get_arg_conflicts_with(option);
    Place {
        set,
        key,
        is_negated: is_negative && !option.get_action().takes_values(),
        is_list: is_list(option),
        delimiter: option.get_value_delimiter(),
        conflicts: conflicts.into_iter().filter_map(name_of).collect(),
    }
}

/// The error of an invalid value, with types as users know them.
fn invalid(name: &str, error: &serde_json::Error) -> Error {
    let text = error.to_string();
    let (problem, expected) = text.rsplit_once(", expected ").unwrap_or((&text, ""));
    let expected = match expected {
        "usize" | "u32" | "u64" => ", expected a whole number of at least 0".to_owned(),
        "f64" => ", expected a number".to_owned(),
        "path string" => ", expected a path".to_owned(),
        "" => String::new(),
        other => format!(", expected {other}"),
    };
    Error::input(format!("{name}: {problem}{expected}"))
}

impl Place {
    fn set(&self, options: &mut Options, value: Value) -> serde_json::Result<()> {
        let value = match value {
            Value::Bool(is_on) if self.is_negated => Value::Bool(!is_on),
            Value::String(text) if self.is_list => match self.delimiter {
                Some(delimiter) => text.split(delimiter).collect(),
                None => json!([text]),
            },
            value => value,
        };
        match self.key {
            Some(key) => (self.set)(options, json!({ key: value })),
            None => (self.set)(options, value),
        }
    }
}

impl Options {
    /// Options of a run from values by name: `{"seed": 1, "misses": true, "columns": ["X", "Y"]}`.
    ///
    /// # Errors
    /// [`Error::Input`] for unknown options, invalid values, and options that contradict one another.
    pub fn of_values(values: OptionValues) -> Result<Options> {
        let mut options = Options::default();
        let is_chosen = |value: &Value| !matches!(value, Value::Bool(false) | Value::Null);
        for (name, value) in &values {
            let Some(place) = PLACES.get(name) else {
                return Err(Error::input(format!("no option of a run is called {name}")));
            };
            let is_other = |other: &&String| values.get(*other).is_some_and(is_chosen);
            if let (true, Some(other)) = (is_chosen(value), place.conflicts.iter().find(is_other)) {
                return Err(Error::input(format!("{name} cannot be used with {other}")));
            }
        }
        for (name, value) in values {
            if let (Some(place), false) = (PLACES.get(&name), value.is_null()) {
                place.set(&mut options, value).map_err(|e| invalid(&name, &e))?;
            }
        }
        Ok(options)
    }
}

#[cfg(test)]
mod tests {
    use super::super::switch::Switch;
    use super::*;

    fn of(values: Value) -> Result<Options> {
        Options::of_values(from_value(values).unwrap())
    }

    #[test]
    fn every_option_takes_a_value() {
        for option in Options::names() {
            let name = option.long.replace('-', "_");
            assert!(PLACES.contains_key(&name), "{name}");
        }
    }

    #[test]
    fn values_become_the_options_of_the_same_words() {
        let values = json!({
            "threads": 3, "misses": true, "labels": false, "columns": ["X", "Y"], "seed": 1.5, "tile": 20,
            "no_leg_noise": true, "physics": "refined", "correct": "a,b", "assets": ["x", "y,z"],
            "lever_arm": [1, 2.5, -3], "navigation_error": { "position_m": [1, 2, 3] }, "crs": 25832,
            "las_scale": 1, "format": "laz", "out": ["a.laz"], "schedule": "dynamic", "trajectory_separator": null,
            "trajectory_columns": "time,x,y",
        });
        let words = "--threads=3 --misses --no-labels --columns=X,Y --seed=1.5 --tile=20 --no-leg-noise \
                     --physics=refined --correct=a,b --assets=x --assets=y,z --lever-arm=1,2.5,-3 \
                     --navigation-error=position_m=1,2,3 --crs=25832 --las-scale=1 --format=laz --out=a.laz \
                     --schedule=dynamic --trajectory-columns=time,x,y";
        let parsed = Options::parse(words.split_whitespace().map(str::to_owned)).unwrap();
        assert_eq!(format!("{:?}", of(values).unwrap()), format!("{parsed:?}"));
    }

    #[test]
    fn a_switch_that_is_false_is_undone() {
        let options = of(json!({ "misses": false, "no_leg_noise": false })).unwrap();
        assert_eq!((options.output.misses, options.noise.no_leg_noise), (Switch::Off, Switch::Off));
    }

    #[test]
    fn messages_name_the_keyword() {
        for (values, expected) in [
            (
                json!({ "threads": -1 }),
                "threads: invalid value: integer `-1`, expected a whole number of at least 0",
            ),
            (json!({ "columns": "Q" }), "columns: no column is called"),
            (json!({ "chunk_size": 0 }), "chunk_size: expected 1 to"),
            (json!({ "tile": 5, "per_object": true }), "tile cannot be used with per_object"),
            (json!({ "thread": 5 }), "no option of a run is called thread"),
            (json!({ "navigation_error": { "position": 1 } }), "navigation_error: "),
        ] {
            let error = of(values).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        assert!(of(json!({ "tile": 5, "per_object": false })).is_ok());
    }
}
