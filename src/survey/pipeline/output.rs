//! What a pipeline file wants to be written.

use super::super::context::Context;
use super::PipelineKeys;
use super::keys::Key;
use super::run::one_of;
use super::source::Source;
use std::path::PathBuf;
use toml::Value;

/// Names of the formats of points.
pub const FORMATS: &[&str] =
    &["xyz", "csv", "bin", "las", "laz", "copc", "ply", "ply-ascii", "arrow", "parquet"];

/// One output.
#[derive(Clone, Debug, PartialEq)]
pub struct SinkSetting {
    /// File or folder, relative to the working directory; `-` is standard output.
    pub path: PathBuf,
    /// `points` or `trajectory`.
    pub content: String,
    /// Its name as `--format` takes it.
    pub format: Option<String>,
    /// One file for each leg or strip.
    pub per_leg: Option<bool>,
    /// HELIOS++'s layout within a folder.
    pub helios: bool,
}

/// What is written of every echo and beside it: the options of the command line by the same names, see [`PipelineKeys`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OutputSettings {
    /// Write waveforms.
    pub waveforms: bool,
    /// Write pulses.
    pub pulses: bool,
    /// Names of columns, with commas between them.
    pub columns: Option<String>,
    /// Labels for learning.
    pub labels: bool,
    /// Positions without errors of navigation in LAS and LAZ.
    pub true_positions: bool,
    /// Subrays instead of points.
    pub subrays: bool,
    /// Pulses without echoes.
    pub misses: bool,
    /// Most points of LAS streams as typed.
    pub las_at_most: Option<String>,
    /// Metres per unit of LAS coordinates.
    pub las_scale: Option<f64>,
    /// LAS 1.0.
    pub las10: bool,
    /// `inside` or `beside`.
    pub wave_packets: Option<String>,
    /// One file per device.
    pub split_by_channel: bool,
    /// Compressed text.
    pub zip_output: bool,
    /// Files that exist are overwritten.
    pub force: bool,
}

pub(super) fn read_output(context: &Context, source: &Source, keys: &PipelineKeys) -> OutputSettings {
    let is = |key: Option<bool>| key.unwrap_or(false);
    OutputSettings {
        waveforms: is(keys.waveforms),
        pulses: is(keys.pulses),
        columns: read_names(context, source, &keys.columns),
        labels: is(keys.labels),
        true_positions: is(keys.true_positions),
        subrays: is(keys.subrays),
        misses: is(keys.misses),
        las_at_most: read_count(context, source, &keys.las_at_most),
        las_scale: keys.las_scale,
        las10: is(keys.las10),
        wave_packets: one_of(context, source, &keys.wave_packets, &["inside", "beside"]),
        split_by_channel: is(keys.split_by_channel),
        zip_output: is(keys.zip_output),
        force: is(keys.force),
    }
}

fn read_names(context: &Context, source: &Source, key: &Key<Value>) -> Option<String> {
    let key = key.as_ref()?;
    let names = match key.get_ref() {
        Value::String(names) => Some(names.clone()),
        Value::Array(names) => {
            names.iter().map(Value::as_str).collect::<Option<Vec<_>>>().map(|names| names.join(","))
        }
        _ => None,
    };
    if names.is_none() {
        context.error(source.place(key.span()), "expected names of columns such as [\"X\", \"Y\", \"Z\"]");
    }
    names
}

fn read_count(context: &Context, source: &Source, key: &Key<Value>) -> Option<String> {
    let key = key.as_ref()?;
    match key.get_ref() {
        Value::String(count) => Some(count.clone()),
        Value::Integer(count) => Some(count.to_string()),
        _ => {
            context.error(source.place(key.span()), "expected a number of points such as 250000 or \"250M\"");
            None
        }
    }
}

pub(super) fn read_sinks(context: &Context, source: &Source, keys: &PipelineKeys) -> Vec<SinkSetting> {
    let mut sinks = Vec::new();
    for output in &keys.output {
        let content = one_of(context, source, &output.content, &["points", "trajectory"]);
        let format = one_of(context, source, &output.format, FORMATS);
        let Some(path) = &output.path else {
            context.error_help(None, "an [[output]] needs the key `path`", "path = \"-\" is standard output");
            continue;
        };
        sinks.push(SinkSetting {
            path: path.get_ref().clone(),
            content: content.unwrap_or_else(|| "points".to_owned()),
            format,
            per_leg: output.per_leg,
            helios: output.helios.unwrap_or(false),
        });
    }
    sinks
}
