//! The layout of nuScenes (Caesar et al., 2020, nuScenes: a multimodal dataset for autonomous driving) with
//! the labels of nuScenes-lidarseg. Axes are x right, y forward, z up; every frame is a sample, and the frame
//! of the vehicle is that of the scanner.
//!
//! ```text
//! samples/LIDAR_TOP/vlscan__LIDAR_TOP__MICROSECONDS.pcd.bin   float32: x, y, z, intensity, ring
//! lidarseg/v1.0-vlscan/TOKEN_lidarseg.bin                     uint8: class
//! maps/none.png                                               a mask of one pixel: there is no map
//! v1.0-vlscan/*.json                                          the tables
//! ```
//!
//! The tables of annotations (attribute, instance, sample_annotation, visibility) are empty. There is no
//! table lidarseg: with it the devkit refuses classes that are not those of nuScenes. The token in the name
//! of labels is that of `sample_data`.

use super::placed::PlacedFrame;
use super::{FrameWriter, create, refuse_existing, write};
use crate::cloud::class_name;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileGroup, FileWriter, Patched};
use vlscan_geom::Rotation;
use xxhash_rust::xxh3::xxh3_128;

const VERSION: &str = "v1.0-vlscan";
const CHANNEL: &str = "LIDAR_TOP";

/// A row of a table for each frame.
struct Table {
    file: FileWriter,
    is_empty: bool,
}

/// Temporary folder in which the folders of the layout are filled.
struct Folders {
    tables: PathBuf,
    samples: PathBuf,
    labels: PathBuf,
    maps: PathBuf,
}

impl Table {
    fn begin(folders: &Folders, name: &str) -> Result<Table> {
        let path = folders.tables.join(name).with_extension("json");
        Ok(Table { file: FileWriter::create(&path, false, Patched::Never)?, is_empty: true })
    }

    fn row(&mut self, row: &Value) -> Result<()> {
        let before = if self.is_empty { "[\n" } else { ",\n" };
        self.is_empty = false;
        self.file.append(format!("{before}{row}").as_bytes())
    }

    fn finish(mut self) -> Result<()> {
        let end = if self.is_empty { "[]\n" } else { "\n]\n" };
        self.file.append(end.as_bytes())?;
        self.file.finish().map(drop)
    }
}

pub(super) struct Nuscenes {
    folders: Folders,
    frames: u64,
    classes: BTreeSet<u8>,
    poses: Table,
    samples: Table,
    data: Table,
    /// Microseconds of the last frame, whose rows are written when it is known whether one follows.
    waiting: Option<u64>,
}

/// The token of a row.
fn token(table: &str, number: u64) -> String {
    format!("{:032x}", xxh3_128(format!("{table} {number}").as_bytes()))
}

/// The token of a row before or after another; empty without one.
fn neighbour(table: &str, number: Option<u64>) -> String {
    number.map_or_else(String::new, |number| token(table, number))
}

/// The file of points of a frame in the folder `samples`.
fn points_name(microseconds: u64) -> String {
    format!("{CHANNEL}/vlscan__{CHANNEL}__{microseconds}.pcd.bin")
}

impl Nuscenes {
    /// Begins a data set in `folder`, whose folders get their names with `group`.
    pub fn begin(folder: &Path, group: &mut FileGroup) -> Result<Nuscenes> {
        for name in [VERSION, "samples", "lidarseg", "maps"] {
            refuse_existing(&folder.join(name))?;
        }
        group.create_folder(folder)?;
        let mut stage = |name: &str| group.stage_folder(&folder.join(name));
        let folders = Folders {
            tables: stage(VERSION)?,
            samples: stage("samples")?,
            labels: stage("lidarseg")?,
            maps: stage("maps")?,
        };
        create(&folders.samples.join(CHANNEL))?;
        create(&folders.labels.join(VERSION))?;
        let table = |name: &str| Table::begin(&folders, name);
        let (poses, samples, data) = (table("ego_pose")?, table("sample")?, table("sample_data")?);
        Ok(Nuscenes { folders, frames: 0, classes: BTreeSet::new(), poses, samples, data, waiting: None })
    }

    /// Writes the rows of the last frame.
    fn rows(&mut self, has_next: bool) -> Result<()> {
        let Some(microseconds) = self.waiting.take() else { return Ok(()) };
        let number = self.frames - 1;
        let (before, after) = (number.checked_sub(1), has_next.then_some(number + 1));
        self.samples.row(&json!({
            "token": token("sample", number), "timestamp": microseconds, "scene_token": token("scene", 0),
            "prev": neighbour("sample", before), "next": neighbour("sample", after),
        }))?;
        self.data.row(&json!({
            "token": token("sample_data", number), "sample_token": token("sample", number),
            "ego_pose_token": token("ego_pose", number),
            "calibrated_sensor_token": token("calibrated_sensor", 0),
            "timestamp": microseconds, "fileformat": "pcd", "is_key_frame": true, "height": 0, "width": 0,
            "filename": format!("samples/{}", points_name(microseconds)),
            "prev": neighbour("sample_data", before), "next": neighbour("sample_data", after),
        }))
    }

    /// Writes a table as a whole.
    fn table(&self, name: &str, rows: &[Value]) -> Result<()> {
        let mut table = Table::begin(&self.folders, name)?;
        rows.iter().try_for_each(|row| table.row(row))?;
        table.finish()
    }
}

impl FrameWriter for Nuscenes {
    fn frame(&mut self, frame: &PlacedFrame) -> Result<()> {
        self.rows(true)?;
        let pose = &frame.pose;
        let microseconds = pose.time_ns / 1000;
        let mut points = Vec::with_capacity(20 * frame.points.len());
        let mut labels = Vec::with_capacity(frame.points.len());
        for point in &frame.points {
            // x right, y forward.
            let [forward, left, up] = point.position.to_array().map(|c| c as f32);
            for value in [-left, forward, up, point.intensity, point.ring as f32] {
                points.extend(value.to_le_bytes());
            }
            let class = u8::try_from(point.class).map_err(|_| {
                let (frame, class) = (self.frames, point.class);
                Error::input(format!("frame {frame}: class {class} does not fit the 8 bits of lidarseg"))
            })?;
            self.classes.insert(class);
            labels.push(class);
        }
        write(&self.folders.samples.join(points_name(microseconds)), &points)?;
        let data_token = token("sample_data", self.frames);
        let labels_name = format!("{VERSION}/{data_token}_lidarseg.bin");
        write(&self.folders.labels.join(labels_name), &labels)?;
        let p = pose.position;
        let r = pose.rotation.after(Rotation::about_z(-std::f64::consts::FRAC_PI_2));
        self.poses.row(&json!({
            "token": token("ego_pose", self.frames), "timestamp": microseconds,
            "rotation": [r.w, r.u.x, r.u.y, r.u.z], "translation": [p.x, p.y, p.z],
        }))?;
        self.waiting = Some(microseconds);
        self.frames += 1;
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        self.rows(false)?;
        let category = |class: u8| {
            let name = class_name(class).map_or_else(|| format!("class {class}"), str::to_owned);
            json!({
                "token": token("category", u64::from(class)), "name": name, "description": "", "index": class,
            })
        };
        let categories: Vec<Value> = self.classes.iter().map(|class| category(*class)).collect();
        self.table("category", &categories)?;
        self.table(
            "sensor",
            &[json!({ "token": token("sensor", 0), "channel": CHANNEL, "modality": "lidar" })],
        )?;
        self.table(
            "calibrated_sensor",
            &[json!({
                "token": token("calibrated_sensor", 0),
                "sensor_token": token("sensor", 0),
                "translation": [0, 0, 0],
                "rotation": [1, 0, 0, 0], "camera_intrinsic": [],
            })],
        )?;
        self.table(
            "log",
            &[json!({
                "token": token("log", 0), "logfile": "vlscan", "vehicle": "vlscan", "date_captured": "",
                "location": "vlscan",
            })],
        )?;
        self.table(
            "map",
            &[json!({
                "token": token("map", 0), "log_tokens": [token("log", 0)], "category": "semantic_prior",
                "filename": "maps/none.png",
            })],
        )?;
        self.table(
            "scene",
            &[json!({
                "token": token("scene", 0),
                "log_token": token("log", 0),
                "name": "scene-0000",
                "description": "",
                "nbr_samples": self.frames, "first_sample_token": token("sample", 0),
                "last_sample_token": token("sample", self.frames.saturating_sub(1)),
            })],
        )?;
        for name in ["attribute", "instance", "sample_annotation", "visibility"] {
            self.table(name, &[])?;
        }
        write(&self.folders.maps.join("none.png"), &one_pixel()?)?;
        let Nuscenes { poses, samples, data, .. } = *self;
        [poses, samples, data].into_iter().try_for_each(Table::finish)
    }
}

/// A black picture of one pixel.
fn one_pixel() -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let failed = |e: png::EncodingError| Error::Internal(e.to_string());
    let mut encoder = png::Encoder::new(&mut bytes, 1, 1);
    encoder.set_color(png::ColorType::Grayscale);
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(&[0]).map_err(failed)?;
    writer.finish().map_err(failed)?;
    Ok(bytes)
}
