//! Scenes that are made, and the catalogue of instruments with its figures.

use crate::errors::{Notices, exception};
use crate::tools::get;
use crate::watch::interruptible;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Value, json};
use std::path::PathBuf;
use vlscan::base::files::reads;
use vlscan::geom::degrees;
use vlscan::survey::{Device, ReadOptions, catalogue as shipped, find_platform, find_scanner};
use vlscan::tools::catalogue::{Pattern, PlatformFigures, ScannerFigures, Sources};
use vlscan::tools::chart::Theme;
use vlscan::tools::generate::{
    Development, SceneKind, SceneOptions, StandOptions, make_stand as place, write_scene,
};
use vlscan::{Error, Notice, Observer};

/// Makes a scene with a survey in a folder. Returns the survey and the numbers of triangles, voxels and
/// pulses.
#[pyfunction]
pub fn make_scene(
    py: Python<'_>,
    kind: &str,
    folder: PathBuf,
    fields: &Bound<'_, PyDict>,
) -> PyResult<(PathBuf, u64, u64, u64)> {
    let Some(kind) = SceneKind::ALL.into_iter().find(|known| known.name() == kind) else {
        let known = SceneKind::ALL.map(SceneKind::name).join(", ");
        return Err(PyValueError::new_err(format!("no kind of scene is called {kind:?}; there are {known}")));
    };
    let options = SceneOptions {
        kind,
        triangles: get(fields, "triangles")?,
        seed: get(fields, "seed")?,
        extent: get(fields, "extent")?,
        pulses: get(fields, "pulses")?,
        separate_trees: get(fields, "separate_trees")?,
        models: get(fields, "models")?,
        voxels: get(fields, "voxels")?,
        copies: get(fields, "copies")?,
        overwrite: get(fields, "force")?,
    };
    let made = interruptible(py, move |interruption| {
        interruption.begin_writing()?;
        write_scene(&options, &folder)
    })?;
    let made = made.map_err(|error| exception(py, error))?;
    Ok((made.survey, made.triangles, made.voxels, made.pulses))
}

/// Places tree models by an inventory. Returns the scene, the numbers of trees of each epoch and of models.
#[pyfunction]
pub fn make_stand(
    py: Python<'_>,
    inventory: PathBuf,
    trees: PathBuf,
    folder: PathBuf,
    fields: &Bound<'_, PyDict>,
) -> PyResult<(PathBuf, Vec<usize>, usize)> {
    let notices = Notices::default();
    let observer = Observer::new(false, notices.observer());
    let options = StandOptions {
        terrain: get(fields, "terrain")?,
        terrain_mtl: get(fields, "terrain_material")?,
        seed: get(fields, "seed")?,
        epochs: get(fields, "epochs")?,
        development: Development {
            growth: get(fields, "growth")?,
            thinning: get(fields, "thinning")?,
            storm: get(fields, "storm")?,
        },
        overwrite: get(fields, "force")?,
        ..StandOptions::new(inventory, trees)
    };
    let made = interruptible(py, move |interruption| {
        interruption.begin_writing()?;
        place(&options, &folder, &|_| true, &observer)
    })?;
    notices.issue(py)?;
    let made = made.map_err(|error| exception(py, error))?;
    Ok((made.scene, made.trees, made.models))
}

/// The figures of all scanners and platforms that ship, as JSON.
#[pyfunction]
pub fn figures(py: Python<'_>) -> PyResult<String> {
    let made = py.detach(|| {
        let (known, _) = shipped()?;
        let scanners =
            known.scanners.iter().map(|(reference, scanner)| ScannerFigures::of(reference, scanner));
        let scanners = scanners.collect::<vlscan::Result<Vec<_>>>()?;
        let platforms: Vec<_> =
            known.platforms.iter().map(|(name, platform)| PlatformFigures::of(name, platform)).collect();
        Ok(json!({ "scanners": scanners, "platforms": platforms }).to_string())
    });
    made.map_err(|error: Error| exception(py, error))
}

/// The figures of a scanner with their sources and the figures of its first device as JSON, and the drawing of
/// its scan pattern as SVG.
#[pyfunction]
pub fn scanner_figures(py: Python<'_>, reference: &str) -> PyResult<(String, String)> {
    let notices = Notices::default();
    let made = py.detach(|| {
        let (found, warnings) = find_scanner(reference, &ReadOptions::default())?;
        notices.add(Notice::Warnings(warnings));
        let figures = ScannerFigures::of(reference, &found)?;
        let device = found.devices.first().map(|device| device_figures(device, figures.range_max_m));
        let text = json!({ "figures": figures, "sources": Sources::of(&found), "device": device });
        Ok((text.to_string(), Pattern::of(&found)?.drawing(&found).file(Theme::Light)))
    });
    notices.issue(py)?;
    made.map_err(|error: Error| exception(py, error))
}

/// The fields of `vlscan.DeviceFigures`; the maximum range is `None` if it is unlimited.
fn device_figures(device: &Device, range_max: Option<f64>) -> Value {
    let Device { beam, detector, head, scan_freq: (scan_freq_min, scan_freq_max), .. } = device;
    json!({
        "average_power_w": beam.average_power,
        "divergence_rad": beam.divergence,
        "beam_quality": beam.quality,
        "optical_efficiency": beam.efficiency,
        "receiver_diameter_m": beam.receiver_diameter,
        "visibility_km": beam.visibility,
        "wavelength_nm": beam.wavelength,
        "pulse_length_ns": beam.pulse_length,
        "accuracy_m": detector.accuracy,
        "range_min_m": detector.range_min,
        "range_max_m": range_max,
        "head_rate_max_deg_per_s": degrees(head.max_rate),
        "scan_freq_min_hz": scan_freq_min,
        "scan_freq_max_hz": scan_freq_max,
        "scan_angle_max_deg": degrees(device.scan_angle_max),
    })
}

/// How a platform moves, by the name of its type in XML.
#[pyfunction]
pub fn platform_kind(py: Python<'_>, reference: &str) -> PyResult<&'static str> {
    let notices = Notices::default();
    let found = py.detach(|| {
        let (found, warnings) = find_platform(reference, &ReadOptions::default())?;
        notices.add(Notice::Warnings(warnings));
        Ok(found.kind.name())
    });
    notices.issue(py)?;
    found.map_err(|error: Error| exception(py, error))
}

/// Expands compressed text to a file. Returns the number of lines.
#[pyfunction]
pub fn unzip(py: Python<'_>, path: PathBuf, out: PathBuf, force: bool) -> PyResult<u64> {
    let done = interruptible(py, move |interruption| {
        interruption.begin_writing()?;
        let file = reads::open(&path).map_err(|e| Error::open(&path, e))?;
        vlscan::output::unzip(&path, std::io::BufReader::new(file), Some(&out), force)
    })?;
    done.map_err(|error| exception(py, error))
}
