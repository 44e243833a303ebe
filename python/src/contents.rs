//! Contents of the files of surveys, as values.

use crate::errors::{Notices, exception};
use crate::run::Request;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use vlscan::geom::degrees;
use vlscan::survey::{
    Interpolated, Leg, LegTemplates, PlatformKind, RotationSpec, SceneRecipe, Survey, SurveySources,
};

/// Name of a survey; id and name of its scanner; id and type of its platform; ids of the parts that its scene
/// names; keys of its waveform settings; its legs with the keywords of `vlscan.Leg`. The next value is true
/// if these keywords hold all that the file has about legs. The last one has what XML refers to.
#[pyfunction]
#[allow(clippy::type_complexity, reason = "unpacked by the package")]
pub fn contents<'py>(
    py: Python<'py>,
    request: Py<Request>,
) -> PyResult<(
    String,
    (String, String),
    (String, &'static str),
    Vec<Option<String>>,
    Bound<'py, PyDict>,
    Vec<Bound<'py, PyDict>>,
    bool,
    Option<Bound<'py, PyDict>>,
)> {
    let notices = Notices::default();
    let read = py.detach(|| -> vlscan::Result<_> {
        let job = request.get().job(&notices)?;
        Ok((job, request.get().sources()?))
    });
    let (job, sources) = read.map_err(|error| exception(py, error))?;
    let survey = &job.settings.survey;
    let legs = survey.legs.iter().map(|leg| keywords(py, survey, leg)).collect::<PyResult<Vec<_>>>()?;
    if let Some(sources) = &sources {
        for (keys, templates) in legs.iter().zip(&sources.templates) {
            keys.set_item("templates", templates_of(py, survey, templates)?)?;
        }
    }
    let references = sources.map(|sources| references(py, survey, &sources)).transpose()?;
    let scanner = (survey.scanner.id.clone(), survey.scanner.name.clone());
    let platform = (survey.platform.id.clone(), survey.platform.kind.name());
    let parts = survey.scene.parts.iter().map(|part| part.id.clone()).collect();
    let is_simple = matches!(survey.platform.kind, PlatformKind::Static | PlatformKind::LinearPath);
    let is_whole = is_simple && survey.leg_offset.is_none() && survey.legs.iter().all(has_keywords_alone);
    Ok((survey.name.clone(), scanner, platform, parts, waveform(py, survey)?, legs, is_whole, references))
}

/// The fields of `vlscan.contents.References`.
fn references<'py>(
    py: Python<'py>,
    survey: &Survey,
    sources: &SurveySources,
) -> PyResult<Bound<'py, PyDict>> {
    let rotation = match &survey.platform.kind {
        PlatformKind::Interpolated(Interpolated { rotation_spec: RotationSpec::Arinc705, .. }) => {
            Some("ARINC 705")
        }
        PlatformKind::Interpolated(Interpolated { rotation_spec: RotationSpec::Canonical, .. }) => {
            Some("CANONICAL")
        }
        _ => None,
    };
    let SceneRecipe { path, id, .. } = &survey.scene;
    let file = std::path::absolute(path).unwrap_or_else(|_| path.clone()).display().to_string();
    let is_xml = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("xml"));
    let fields = PyDict::new(py);
    fields.set_item("scanner", &sources.scanner)?;
    fields.set_item("platform", &sources.platform)?;
    fields.set_item("scene", if is_xml && !id.is_empty() { format!("{file}#{id}") } else { file })?;
    fields.set_item("rotation_spec", rotation)?;
    fields.set_item("has_waveform", sources.has_waveform)?;
    Ok(fields)
}

/// Ids and keywords of the templates of a leg, by what their settings are of.
fn templates_of<'py>(
    py: Python<'py>,
    survey: &Survey,
    templates: &LegTemplates,
) -> PyResult<Bound<'py, PyDict>> {
    let found = PyDict::new(py);
    for (name, template) in [("scanner", &templates.scanner), ("platform", &templates.platform)] {
        if let Some((id, leg)) = template {
            let keys = keywords(py, survey, leg)?;
            let scanner = &leg.scanner;
            let divergence = scanner.written_divergence.unwrap_or(scanner.beam_divergence);
            keys.set_item("beam_divergence_rad", divergence)?;
            found.set_item(name, (id, keys))?;
        }
    }
    Ok(found)
}

/// Keys of the waveform settings of the first device.
fn waveform<'py>(py: Python<'py>, survey: &Survey) -> PyResult<Bound<'py, PyDict>> {
    let keys = PyDict::new(py);
    if let Some(device) = survey.scanner.devices.first() {
        keys.set_item("bin_ns", device.waveform.bin)?;
        keys.set_item("window_ns", device.waveform.window)?;
        keys.set_item("quality", device.waveform.quality)?;
        keys.set_item("max_range_ns", device.waveform.max_range)?;
    }
    Ok(keys)
}

/// True if nothing of a leg is lost in its keywords.
fn has_keywords_alone(leg: &Leg) -> bool {
    leg.scanner.pulse_times.is_none() && leg.platform.trajectory.is_none() && leg.platform.mount.is_none()
}

/// A leg as keywords; values that are the defaults are left out. `trajectory` is the part of a recorded
/// trajectory that it flies: start, end (s), and true if the platform jumps there.
fn keywords<'py>(py: Python<'py>, survey: &Survey, leg: &Leg) -> PyResult<Bound<'py, PyDict>> {
    let (place, scanner) = (&leg.platform, &leg.scanner);
    let keys = PyDict::new(py);
    keys.set_item("position", place.position.to_array())?;
    keys.set_item("on_ground", place.on_ground)?;
    keys.set_item("active", scanner.active)?;
    keys.set_item("speed_m_per_s", place.has_speed.then_some(place.speed))?;
    keys.set_item("strip", &leg.strip)?;
    let flown = place.trajectory.as_ref().map(|flown| (flown.start, flown.end, flown.teleport));
    keys.set_item("trajectory", flown)?;
    keys.set_item("pulse_freq_hz", scanner.pulse_freq)?;
    let usual = survey.scanner.devices.first().map(|device| device.beam.divergence);
    let divergence = scanner.written_divergence.unwrap_or(scanner.beam_divergence);
    let numbers = [
        ("scan_freq_hz", scanner.scan_freq, 0.0),
        ("scan_angle_deg", in_degrees(scanner.scan_angle), 0.0),
        ("head_rate_deg_per_s", in_degrees(scanner.head_rate), 0.0),
        ("head_start_deg", in_degrees(scanner.head_start), 0.0),
        ("head_stop_deg", in_degrees(scanner.head_stop), 0.0),
        ("trajectory_interval_s", scanner.trajectory_interval, 0.0),
        ("warmup_s", scanner.warmup, 0.0),
        ("beam_divergence_rad", divergence, usual.unwrap_or(divergence)),
    ];
    for (key, number, default) in numbers {
        if number != default {
            keys.set_item(key, number)?;
        }
    }
    let limits = [
        ("vertical_angle_min_deg", scanner.vertical_min.map(in_degrees)),
        ("vertical_angle_max_deg", scanner.vertical_max.map(in_degrees)),
        ("max_duration_s", scanner.max_duration),
    ];
    for (key, limit) in limits {
        if let Some(limit) = limit {
            keys.set_item(key, limit)?;
        }
    }
    Ok(keys)
}

/// An angle in degrees, without the last digits, which the conversion may have changed.
fn in_degrees(angle: f64) -> f64 {
    let degrees = degrees(angle);
    format!("{degrees:.12e}").parse().unwrap_or(degrees)
}
