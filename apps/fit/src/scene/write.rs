//! The files of a reconstructed scene.

use super::{PathSource, ReconstructedScene};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads;
use vlscan_geom::DVec3;
use vlscan_tools::generate::SceneFolder;

/// Reflectance of surfaces.
const REFLECTANCE: f64 = 0.3;
/// Mean cosine on leaves that face all directions alike: foliage returns as much as a surface that it hides.
const LEAF_COSINE: f64 = 2.0 / 3.0;
/// Material of surfaces of a class.
fn material(class: u8) -> String {
    format!("class_{class}")
}

/// Material of foliage of a class.
fn leaf_material(class: u8) -> String {
    format!("foliage_{class}")
}

pub(super) fn write(scene: &ReconstructedScene, folder: &Path, overwrite: bool) -> Result<PathBuf> {
    let files = SceneFolder::create(folder, overwrite)?;
    files.write("materials.mtl", materials(scene).as_bytes())?;
    files.write("terrain.obj", terrain(scene).as_bytes())?;
    let mut parts = vec![("terrain".to_owned(), mesh_filter("terrain.obj"))];
    if !scene.roofs.faces.is_empty() {
        files.write("roofs.obj", roofs(scene).as_bytes())?;
        parts.push(("roofs".to_owned(), mesh_filter("roofs.obj")));
    }
    for class in leaf_classes(scene) {
        let name = format!("foliage_{class}.vox");
        files.write(&name, voxels(scene, class).as_bytes())?;
        parts.push((format!("foliage {class}"), voxel_filter(&name, class)));
    }
    files.write("scene.xml", document(&parts).as_bytes())?;
    files.write("pulse.txt", pulse_shape(scene.receiver.resolution).as_bytes())?;
    files.write("trajectory.csv", trajectory(scene).as_bytes())?;
    let report = serde_json::to_string_pretty(&report(scene)).map_err(|e| Error::input(e.to_string()))?;
    files.write("report.json", (report + "\n").as_bytes())?;
    let pipeline = files.write("scene.toml", pipeline(scene).as_bytes())?;
    if overwrite {
        old_parts(folder, &parts)?.iter().for_each(|name| files.remove(name));
    }
    files.commit()?;
    Ok(pipeline)
}

/// The files of parts of an earlier scene that the new one does not have.
fn old_parts(folder: &Path, parts: &[(String, String)]) -> Result<Vec<String>> {
    let is_part = |name: &str| {
        let class = name.strip_prefix("foliage_").and_then(|name| name.strip_suffix(".vox"));
        name == "roofs.obj" || class.is_some_and(|class| class.parse::<u8>().is_ok())
    };
    let is_new = |name: &str| parts.iter().any(|(_, filter)| filter.contains(&format!("\"{name}\"")));
    let paths = reads::list(folder).map_err(|e| Error::io("read", folder, e))?;
    let names = paths.iter().filter_map(|path| path.file_name()?.to_str());
    Ok(names.filter(|name| is_part(name) && !is_new(name)).map(str::to_owned).collect())
}

fn leaf_classes(scene: &ReconstructedScene) -> BTreeSet<u8> {
    scene.foliage.voxels.iter().map(|v| v.class).collect()
}

fn materials(scene: &ReconstructedScene) -> String {
    let mut text = String::from(
        "# Materials by class. Reflectances are assumed; classes are those of the point cloud.\n",
    );
    let surfaces = scene.terrain.classes.iter().copied().chain(scene.roofs.faces.iter().map(|f| f.1));
    let mut add = |name: String, reflectance: f64, class: u8, more: &str| {
        let _ = writeln!(text, "newmtl {name}\nKd 1 1 1\nhelios_reflectance {reflectance}");
        let _ = writeln!(text, "helios_classification {class}\n{more}");
    };
    for class in surfaces.collect::<BTreeSet<u8>>() {
        let is_ground = matches!(class, 2 | 8..=11);
        add(material(class), REFLECTANCE, class, if is_ground { "helios_isGround true" } else { "" });
    }
    let size = format!("vlscan_element_size_m {:.4}", scene.receiver.element_size);
    for class in leaf_classes(scene) {
        add(leaf_material(class), REFLECTANCE / LEAF_COSINE, class, &size);
    }
    text
}

fn vertex(text: &mut String, p: DVec3) {
    let _ = writeln!(text, "v {:.3} {:.3} {:.4}", p.x, p.y, p.z);
}

fn terrain(scene: &ReconstructedScene) -> String {
    let t = &scene.terrain;
    let mut text = String::from("mtllib materials.mtl\n");
    for (i, z) in t.heights.iter().enumerate() {
        let (x, y) =
            ((i % t.nodes[0]) as f64 * t.spacing + t.min[0], (i / t.nodes[0]) as f64 * t.spacing + t.min[1]);
        vertex(&mut text, DVec3::new(x, y, *z));
    }
    let mut class = None;
    for j in 0..t.nodes[1] - 1 {
        for i in 0..t.nodes[0] - 1 {
            let a = j * t.nodes[0] + i;
            if class != Some(t.classes[a]) {
                class = Some(t.classes[a]);
                let _ = writeln!(text, "usemtl {}", material(t.classes[a]));
            }
            let (a, b, c, d) = (a + 1, a + 2, a + t.nodes[0] + 2, a + t.nodes[0] + 1);
            let _ = writeln!(text, "f {a} {b} {c}\nf {a} {c} {d}");
        }
    }
    text
}

fn roofs(scene: &ReconstructedScene) -> String {
    let mut text = String::from("mtllib materials.mtl\n");
    let mut class = None;
    for (number, (corners, of)) in scene.roofs.faces.iter().enumerate() {
        corners.iter().for_each(|p| vertex(&mut text, *p));
        if class != Some(of) {
            class = Some(of);
            let _ = writeln!(text, "usemtl {}", material(*of));
        }
        let n = 4 * number;
        // Corners of a roof need not lie in one plane, and those of a wall may coincide.
        for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
            if corners[a] != corners[b] && corners[b] != corners[c] && corners[a] != corners[c] {
                let _ = writeln!(text, "f {} {} {}", n + a + 1, n + b + 1, n + c + 1);
            }
        }
    }
    text
}

/// The voxels of a class as a file of AMAPVox.
fn voxels(scene: &ReconstructedScene, class: u8) -> String {
    let f = &scene.foliage;
    let max = f.min + DVec3::new(f.cells[0] as f64, f.cells[1] as f64, f.cells[2] as f64) * f.size;
    let of_class = || f.voxels.iter().filter(|v| v.class == class);
    let largest = of_class().map(|v| v.density).fold(0.0, f64::max);
    let mut text = String::from("VOXEL SPACE\n");
    let _ = writeln!(text, "#min_corner: {:.4} {:.4} {:.4}", f.min.x, f.min.y, f.min.z);
    let _ = writeln!(text, "#max_corner: {:.4} {:.4} {:.4}", max.x, max.y, max.z);
    let _ = writeln!(text, "#split: {} {} {}", f.cells[0], f.cells[1], f.cells[2]);
    let _ = writeln!(text, "#res: {:.6} #max_pad: {largest:.4}", f.size);
    text.push_str("i j k PadBVTotal\n");
    for v in of_class() {
        let _ = writeln!(text, "{} {} {} {:.4}", v.index[0], v.index[1], v.index[2], v.density);
    }
    text
}

fn mesh_filter(file: &str) -> String {
    format!("<filter type=\"objloader\"><param type=\"string\" key=\"filepath\" value=\"{file}\"/></filter>")
}

fn voxel_filter(file: &str, class: u8) -> String {
    let param = |key: &str, value: &str| format!("<param type=\"string\" key=\"{key}\" value=\"{value}\"/>");
    format!(
        "<filter type=\"detailedvoxels\">{}{}{}</filter>",
        param("filepath", file),
        param("matfile", "materials.mtl"),
        param("matname", &leaf_material(class))
    )
}

fn document(parts: &[(String, String)]) -> String {
    let mut text = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <document paths=\"beside\">\n  <scene id=\"reconstructed\">\n",
    );
    for (id, filter) in parts {
        let _ = writeln!(text, "    <part id=\"{id}\">\n      {filter}\n    </part>");
    }
    text.push_str("  </scene>\n</document>\n");
    text
}

/// Full width at half maximum of a pulse whose echoes are separate from that distance on, ns: two Gaussian
/// pulses of the standard deviation σ have two maxima from 2σ on.
fn pulse_width(resolution: f64) -> f64 {
    const NS_PER_M: f64 = 2.0 / 0.299_792_458;
    let sigma = 0.5 * resolution * NS_PER_M;
    2.0 * (2.0 * std::f64::consts::LN_2).sqrt() * sigma
}

/// A Gaussian pulse: its maximum does not move on slopes.
fn pulse_shape(resolution: f64) -> String {
    let width = pulse_width(resolution);
    let mut text = String::from("# ns, power: a Gaussian pulse as wide as returns lie apart at least\n");
    for i in -60..=60 {
        let t = f64::from(i) / 40.0;
        let power = libm::exp(-4.0 * std::f64::consts::LN_2 * t * t);
        let _ = writeln!(text, "{:.5} {power:.8}", (t + 1.5) * width);
    }
    text
}

/// The paths of all lines with the heading of their flight, by time.
fn trajectory(scene: &ReconstructedScene) -> String {
    let mut rows: BTreeMap<(u64, u16), String> = BTreeMap::new();
    for path in &scene.paths {
        let heading = libm::atan2(path.velocity.x, path.velocity.y).to_degrees();
        for time in path.times {
            let p = path.at(time);
            let row = format!("{time:.9},{:.3},{:.3},{:.3},0,0,{heading:.4},{}", p.x, p.y, p.z, path.source);
            rows.insert((time.max(0.0).to_bits(), path.source), row);
        }
    }
    let rows: Vec<String> = rows.into_values().collect();
    format!("time[s],x,y,z,roll[deg],pitch[deg],heading[deg],line\n{}\n", rows.join("\n"))
}

fn pipeline(scene: &ReconstructedScene) -> String {
    let (r, range) = (&scene.receiver, scene.mean_range);
    let pitch = scene.paths.iter().map(|p| p.times[1] - p.times[0]).sum::<f64>().max(1e-9);
    let rate = (scene.pulses as f64 * scene.one_of as f64 / pitch).clamp(1.0, 10e6).round();
    format!(
        "# The scene, and the instrument that recorded it as far as its returns tell. The same pulses \
         again:\n\
         #   vlscan trace --scanner scene.toml pulses.csv -o points.laz\n\
         scene = \"scene.xml\"\n\n\
         [scanner]\n\
         id = \"recorded\"\n\
         beam_divergence_rad = {}          # assumed\n\
         pulse_shape = \"pulse.txt\"                # returns lie {:.2} m apart at least\n\
         accuracy_m = {:.4}                       # what ground points scatter about the terrain\n\
         max_returns = {}\n\
         range_min_m = 1\n\
         range_max_m = {:.0}\n\
         pulse_energy_uj = 10                      # assumed; the threshold is relative to it\n\
         # a return needs {:.1} % of the light of a surface that reflects {REFLECTANCE}\n\
         max_range = {{ range_m = {range:.1}, reflectance = {:.5}, pulse_freq_hz = {rate} }}\n\
         # for `vlscan run`; the pattern of the recording's scanner is not known here\n\
         optics = \"rotating\"\n\
         pulse_freqs_hz = [{rate}]\n\
         scan_angle_max_deg = 30\n\
         scan_freq_min_hz = 1\n\
         scan_freq_max_hz = 1000\n\n\
         [settings]\n\
         pulse_freq_hz = {rate}\n\
         scan_freq_hz = 100\n\n\
         [platform]\n\
         kind = \"linear_path\"\n\
         mount = {{ rotate_deg = [{{ x = -90 }}, {{ z = 90 }}] }}\n\n\
         [trajectory]\n\
         path = \"trajectory.csv\"\n\n\
         [waveform]\n\
         quality = 4\n",
        scene.divergence,
        r.resolution,
        scene.terrain.spread,
        r.max_returns,
        2.0 * range + 100.0,
        100.0 * r.threshold,
        (r.threshold * REFLECTANCE).max(1e-5),
    )
}

/// Estimates, their sources and their quality.
pub(super) fn report(scene: &ReconstructedScene) -> serde_json::Value {
    let r = &scene.receiver;
    let by = |source: PathSource| match source {
        PathSource::Beams => "returns",
        PathSource::ScanAngles => "scan angles",
        PathSource::Nadir => "nadir",
    };
    let paths = scene.paths.iter().map(|p| {
        serde_json::json!({
            "line": p.source, "from_s": p.times[0], "to_s": p.times[1], "found_by": by(p.found_by),
            "position_m": p.position.to_array(), "velocity_m_per_s": p.velocity.to_array(),
            "direction_sigma_rad": p.direction_sigma,
        })
    });
    let shares = ["single", "double", "triple", "more", "first_from_foliage", "last_from_foliage"];
    let named = |values: [f64; 6]| -> BTreeMap<&str, f64> { shares.into_iter().zip(values).collect() };
    let mut report = serde_json::json!({
        "points": scene.points, "pulses": scene.pulses, "noise_points_left_out": scene.noise,
        "pulses_per_m2": scene.density, "mean_range_m": scene.mean_range,
        "lines": paths.collect::<Vec<_>>(),
        "terrain": {
            "spacing_m": scene.terrain.spacing,
            "nodes": scene.terrain.nodes,
            "spread_m": scene.terrain.spread,
        },
        "roofs": {
            "cell_m": scene.roofs.cell,
            "cells": scene.roofs.cells,
            "area_m2": scene.roofs.area,
        },
        "foliage": {
            "voxel_m": scene.foliage.size,
            "voxels": scene.foliage.voxels.len(),
            "prior_m": scene.prior,
            "along_canopy": scene.along_canopy,
            "leaf_area_m2": scene.foliage.leaf_area(),
        },
        "receiver": {
            "resolution_m": r.resolution, "pairs": r.pairs, "threshold_share": r.threshold,
            "element_size_m": r.element_size,
            "layers": r.layers.iter()
                .map(|l| serde_json::json!({ "top_m": l.top, "factor": l.factor }))
                .collect::<Vec<_>>(),
            "max_returns": r.max_returns,
            "pulses_through_foliage": r.samples,
            "recorded": named(r.recorded),
            "simulated": named(r.simulated),
        },
        "assumed": { "beam_divergence_rad": scene.divergence, "reflectance": REFLECTANCE },
    });
    if scene.one_of > 1 {
        report["one_pulse_of"] = scene.one_of.into();
    }
    report
}
