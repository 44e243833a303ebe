//! The documentation of every key of a pipeline file: that of the options from the command line's, that of
//! the survey's keys from where they are defined.

use super::groups::{EchoOptions, InputOptions, NoiseOptions, OriginOptions, OutputOptions};
use super::groups::{ProfileOptions, ScheduleOptions, TreeOptions};
use super::outputs::OutputKeys;
use super::schema::option_types;
use super::trajectory::TrajectoryOptions;
use clap::{Args, Command};
use serde::Deserialize;
use serde_json::Value;
use vlscan_survey::{NavigationErrors, SURVEY_TABLES, field_names};

/// A table of a pipeline file, or the keys at its top.
#[derive(Clone, Debug, Default)]
pub struct PipelineTable {
    /// Its header; empty for the top of the file.
    pub name: String,
    /// Description of the table.
    pub about: String,
    /// Its keys.
    pub keys: Vec<PipelineKey>,
}

/// A key of a table.
#[derive(Clone, Debug)]
pub struct PipelineKey {
    /// Its name.
    pub name: String,
    /// Meaning of the key.
    pub help: String,
    /// The types of its values as JSON Schema, if it is an option.
    pub types: Option<Value>,
}

impl PipelineKey {
    fn new(name: &str, help: &str) -> PipelineKey {
        PipelineKey { name: name.to_owned(), help: help.to_owned(), types: None }
    }
}

impl PipelineTable {
    /// Adds the keys of a group of options, with the help of the command line.
    fn add<'de, T: Args + Deserialize<'de>>(&mut self) {
        let command = T::augment_args(Command::new("options"));
        let prefix = self.name.trim_matches(['[', ']']).to_owned();
        for key in field_names::<T>() {
            let own = format!("{prefix}.{key}");
            let Some(arg) = command.get_arguments().find(|arg| arg.get_id() == *key || *arg.get_id() == *own)
            else {
                continue;
            };
            let help = arg.get_long_help().or(arg.get_help()).map(ToString::to_string).unwrap_or_default();
            let option = arg.get_long().map_or(String::new(), |long| format!(" Option: --{long}."));
            let types = Some(option_types(arg));
            self.keys.push(PipelineKey { types, ..PipelineKey::new(key, &(help + &option)) });
        }
    }
}

/// All tables of a pipeline file.
pub fn pipeline_keys() -> Vec<PipelineTable> {
    let mut tables: Vec<PipelineTable> = SURVEY_TABLES
        .iter()
        .chain([&OutputKeys::TABLE])
        .map(|table| PipelineTable {
            name: table.name.to_owned(),
            about: paragraph(table.about),
            keys: table.keys.iter().map(|(key, help)| PipelineKey::new(key, &paragraph(help))).collect(),
        })
        .collect();
    let top = &mut tables[0];
    top.add::<OriginOptions>();
    top.add::<InputOptions>();
    top.add::<OutputOptions>();
    let mut add = |name: &str, about: &str, fill: &dyn Fn(&mut PipelineTable)| {
        let mut table = PipelineTable { name: name.to_owned(), about: about.to_owned(), keys: Vec::new() };
        fill(&mut table);
        tables.push(table);
    };
    add(
        "[trajectory]",
        "Poses that are flown along as they arrive.",
        &PipelineTable::add::<TrajectoryOptions>,
    );
    add(
        "[navigation_errors]",
        "Errors of the navigation system: the beam is traced from the true pose, points are georeferenced \
         with the reported one. Standard deviations belong to first-order Gauss-Markov processes, whose \
         correlation falls by a factor e in the correlation time. Every key but the correlation times takes \
         one number for all three components, or three.",
        &|table| {
            let keys = NavigationErrors::KEYS.iter();
            table.keys.extend(keys.map(|(key, help)| PipelineKey::new(key, help)));
        },
    );
    add("[physics]", "How echoes are computed. Noise is on unless its key is false.", &|table| {
        table.add::<ProfileOptions>();
        table.add::<EchoOptions>();
        table.add::<NoiseOptions>();
    });
    add("[schedule]", "How the work is done; does not change the points.", &|table| {
        table.add::<ScheduleOptions>();
        table.add::<TreeOptions>();
    });
    tables
}

/// A documentation comment without its line breaks.
fn paragraph(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_of_an_option_is_documented() {
        let tables = pipeline_keys();
        let has = |table: &str, key: &str| {
            let table = tables.iter().find(|t| t.name == table).unwrap();
            table.keys.iter().any(|known| known.name == key && !known.help.is_empty())
        };
        for (table, key) in [
            ("", "scene"),
            ("", "seed"),
            ("", "columns"),
            ("[trajectory]", "path"),
            ("[trajectory]", "height_offset_m"),
            ("[physics]", "platform_noise"),
            ("[schedule]", "policy"),
            ("[schedule]", "tree"),
            ("[navigation_errors]", "lever_arm_m"),
            ("[[output]]", "per_leg"),
        ] {
            assert!(has(table, key), "{table} {key}");
        }
    }
}
