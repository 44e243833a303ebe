//! How a pipeline file wants to be run.

use super::super::context::Context;
use super::super::{NavigationErrors, parse_seed};
use super::PipelineKeys;
use super::keys::Key;
use super::output::{OutputSettings, SinkSetting, read_output, read_sinks};
use super::source::Source;
use crate::diag::nearest;
use toml::{Spanned, Value};

/// What a pipeline file says about the run; everything may be missing and be set by the command line. The meanings are
/// those of the keys of [`PipelineKeys`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunSettings {
    /// They come from a pipeline file with a flight of its own, whose kinematics are always the corrected ones.
    pub pipeline: bool,
    /// Seed.
    pub seed: Option<u64>,
    /// GPS time of the first pulse as text.
    pub gps_start: Option<String>,
    /// Number of threads; 0 = one per core.
    pub threads: Option<usize>,
    /// `warehouse`, `dynamic`, `static` or `single`.
    pub policy: Option<String>,
    /// Legs are kept apart.
    pub leg_barrier: Option<bool>,
    /// Pulses per chunk, at least 1.
    pub chunk_size: Option<usize>,
    /// Chunks per thread in the warehouse, at least 1.
    pub warehouse_factor: Option<usize>,
    /// `fsah`, `sah`, `axis-sah`, `median` or `bvh`.
    pub tree: Option<String>,
    /// `helios` or `refined`.
    pub physics: Option<String>,
    /// The older energy model.
    pub legacy_energy: Option<bool>,
    /// Incidence angle 0 everywhere.
    pub fixed_incidence: Option<bool>,
    /// Fit the echo width.
    pub echo_width: Option<bool>,
    /// Noise on written waveforms.
    pub waveform_noise: Option<bool>,
    /// Noise of the platform's pose.
    pub platform_noise: Option<bool>,
    /// Random offsets of legs.
    pub leg_noise: Option<bool>,
    /// How long points of a live trajectory may wait for others, s.
    pub latency: Option<f64>,
    /// What is written, in the file's order.
    pub sinks: Vec<SinkSetting>,
    /// Coordinate reference system as WKT; also in [`crate::survey::Survey::crs_wkt`].
    pub crs: Option<String>,
    /// Warnings are errors.
    pub strict: Option<bool>,
    /// What is written of every echo and beside it.
    pub output: OutputSettings,
    /// Most memory for the scene, bytes.
    pub max_memory: Option<u64>,
    /// What the navigation system gets wrong.
    pub navigation: NavigationErrors,
}

/// Reads everything that is not the survey itself.
pub(super) fn read_settings(context: &Context, source: &Source, keys: &PipelineKeys) -> RunSettings {
    let physics = keys.physics.clone().unwrap_or_default();
    let schedule = keys.schedule.clone().unwrap_or_default();
    let one_of = |key: &Key<String>, known: &[&str]| one_of(context, source, key, known);
    let at_least_1 = |key: &Key<usize>| {
        let key = key.as_ref()?;
        if *key.get_ref() == 0 {
            context.error(source.place(key.span()), "expected a whole number above 0");
        }
        Some(*key.get_ref())
    };
    RunSettings {
        pipeline: keys.survey.is_none() || !keys.leg.is_empty(),
        seed: read_seed(context, source, &keys.seed),
        gps_start: keys.gps_start.clone(),
        threads: schedule.threads,
        policy: one_of(&schedule.policy, &["warehouse", "dynamic", "static", "single"]),
        leg_barrier: schedule.leg_barrier,
        chunk_size: at_least_1(&schedule.chunk_size),
        warehouse_factor: at_least_1(&schedule.warehouse_factor),
        tree: one_of(&schedule.tree, &["fsah", "sah", "axis-sah", "median", "bvh"]),
        physics: one_of(&physics.profile, &["helios", "refined"]),
        legacy_energy: physics.legacy_energy,
        fixed_incidence: physics.fixed_incidence,
        echo_width: physics.echo_width,
        waveform_noise: physics.waveform_noise,
        platform_noise: physics.platform_noise,
        leg_noise: physics.leg_noise,
        latency: keys.trajectory.as_ref().and_then(|t| Some(*t.latency_s.as_ref()?.get_ref())),
        sinks: read_sinks(context, source, keys),
        crs: read_crs(context, source, &keys.crs),
        strict: keys.strict,
        output: read_output(context, source, keys),
        max_memory: read_memory(context, source, &schedule.max_memory),
        navigation: read_navigation(context, source, keys),
    }
}

fn read_navigation(context: &Context, source: &Source, keys: &PipelineKeys) -> NavigationErrors {
    let mut errors = NavigationErrors::NONE;
    let Some(table) = &keys.navigation_errors else { return errors };
    let number = |value: &Value| match value {
        Value::Integer(i) => Some(*i as f64),
        Value::Float(f) => Some(*f),
        _ => None,
    };
    for (name, key) in table.entries() {
        let Some(key) = key else { continue };
        let numbers: Option<Vec<f64>> = match key.get_ref() {
            Value::Array(values) => values.iter().map(number).collect(),
            value => number(value).map(|n| vec![n]),
        };
        let outcome = match numbers {
            Some(numbers) => errors.set(name, &numbers),
            None => Err(format!("{name}: expected one number or three")),
        };
        if let Err(message) = outcome {
            context.error(source.place(key.span()), message);
        }
    }
    errors
}

/// A text that must be among those known.
pub(super) fn one_of(
    context: &Context,
    source: &Source,
    key: &Key<String>,
    known: &[&str],
) -> Option<String> {
    let key = key.as_ref()?;
    let text = key.get_ref();
    if !known.contains(&text.as_str()) {
        let help = nearest(text, known.iter().copied())
            .map_or(String::new(), |near| format!("did you mean `{near}`?"));
        let message = format!("expected {}, found `{text}`", known.join(", "));
        context.error_help(source.place(key.span()), message, help);
        return None;
    }
    Some(text.clone())
}

fn read_seed(context: &Context, source: &Source, key: &Key<Value>) -> Option<u64> {
    let key = key.as_ref()?;
    let text = match key.get_ref() {
        Value::String(text) => text.clone(),
        Value::Integer(_) | Value::Float(_) => key.get_ref().to_string(),
        _ => "this".to_owned(),
    };
    match parse_seed(&text) {
        Ok(seed) => Some(seed),
        Err(message) => {
            context.error(source.place(key.span()), message);
            None
        }
    }
}

/// WKT as it stands, or the content of a file.
fn read_crs(context: &Context, source: &Source, key: &Key<String>) -> Option<String> {
    let key: &Spanned<String> = key.as_ref()?;
    let text = key.get_ref().trim();
    if text.contains('[') {
        return Some(text.to_owned());
    }
    let place = source.place(key.span());
    if !text.ends_with(".wkt") && !text.ends_with(".prj") {
        let help = "give WKT text or the path of a .wkt or .prj file";
        context.error_help(place, format!("`{text}` is no coordinate reference system"), help);
        return None;
    }
    let path = context.file(text, source.folder(), place.clone())?;
    match std::fs::read_to_string(&path) {
        Ok(wkt) if wkt.contains('[') => Some(wkt.trim().to_owned()),
        Ok(_) => {
            context.error(place, format!("{} holds no WKT", path.display()));
            None
        }
        Err(e) => {
            context.error(place, format!("cannot read {}: {e}", path.display()));
            None
        }
    }
}

fn read_memory(context: &Context, source: &Source, key: &Key<Value>) -> Option<u64> {
    let key = key.as_ref()?;
    let bytes = as_bytes(key.get_ref());
    if bytes.is_none() {
        context.error(source.place(key.span()), "expected a number of bytes such as 8000000000 or \"8G\"");
    }
    bytes
}

/// The limit of a file that need not be sound.
pub(super) fn max_memory(keys: &PipelineKeys) -> Option<u64> {
    as_bytes(keys.schedule.as_ref()?.max_memory.as_ref()?.get_ref())
}

fn as_bytes(value: &Value) -> Option<u64> {
    match value {
        Value::Integer(bytes) => u64::try_from(*bytes).ok(),
        Value::String(text) => parse_bytes(text),
        _ => None,
    }
}

/// A number of bytes with an optional unit K, M, G or T (powers of 1024).
fn parse_bytes(text: &str) -> Option<u64> {
    let text = text.trim();
    let digits = text.bytes().take_while(|b| b.is_ascii_digit() || *b == b'.').count();
    let unit = match text[digits..].trim() {
        "" | "B" => 0,
        "K" | "k" | "KiB" => 10,
        "M" | "MiB" => 20,
        "G" | "GiB" => 30,
        "T" | "TiB" => 40,
        _ => return None,
    };
    let bytes = text[..digits].parse::<f64>().ok()? * (1u64 << unit) as f64;
    (bytes < 1e19).then_some(bytes as u64)
}
