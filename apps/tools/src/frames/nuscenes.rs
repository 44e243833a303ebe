//! The layout of nuScenes (Caesar et al., 2020, nuScenes: a multimodal dataset for autonomous driving) with
//! the labels of nuScenes-lidarseg. Axes are x right, y forward, z up; every frame is a sample, and the frame
//! of the vehicle is that of the scanner.
//!
//! ```text
//! samples/LIDAR_TOP/vlscan__LIDAR_TOP__MICROSECONDS.pcd.bin   float32: x, y, z, intensity, ring
//! lidarseg/v1.0-vlscan/TOKEN_lidarseg.bin                     uint8: class
//! maps/none.png                                               a mask of one pixel: there is no map
//! v1.0-vlscan/*.json                                          the tables
//! v1.0-vlscan/boxes.csv                                       the table of boxes, if they are requested
//! ```
//!
//! Boxes of objects are in the tables of annotations (instance, sample_annotation, visibility), which are
//! empty without them, as is the table of attributes. There is no table lidarseg: with it the devkit rejects
//! classes other than those of nuScenes. The token in the name of labels is that of `sample_data`.

use super::boxes::FrameBox;
use super::categories::Names;
use super::placed::PlacedFrame;
use super::{FrameWriter, create, refuse_existing, write};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
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

/// Shares of an object that is seen, in percent, by the token of their row.
const VISIBILITIES: [(&str, f64, f64); 4] =
    [("1", 0.0, 40.0), ("2", 40.0, 60.0), ("3", 60.0, 80.0), ("4", 80.0, 100.0)];

/// An object with its annotations so far.
struct Instance {
    /// Its number among the instances.
    number: u64,
    class: u8,
    count: u64,
    /// Numbers of its first and its last annotation.
    first: u64,
    last: u64,
    /// The row of the last annotation, which is written when it is known whether one follows.
    waiting: Value,
}

/// Annotations of all frames.
struct Annotations {
    table: Table,
    count: u64,
    /// By the number of the object.
    instances: BTreeMap<i64, Instance>,
    are_requested: bool,
}

impl Annotations {
    /// Adds the boxes of a frame.
    fn frame(&mut self, frame: u64, boxes: &[FrameBox]) -> Result<()> {
        for one in boxes {
            let number = self.count;
            self.count += 1;
            let class = class_of(frame, one.track.class)?;
            let new = self.instances.len() as u64;
            let instance = self.instances.entry(one.number).or_insert_with(|| Instance {
                number: new,
                class,
                count: 0,
                first: number,
                last: number,
                waiting: Value::Null,
            });
            let mut row = annotation(frame, number, instance.number, one);
            if instance.count > 0 {
                instance.waiting["next"] = token("sample_annotation", number).into();
                row["prev"] = token("sample_annotation", instance.last).into();
                self.table.row(&instance.waiting)?;
            }
            (instance.waiting, instance.last) = (row, number);
            instance.count += 1;
        }
        Ok(())
    }

    /// Writes the last annotations and returns the rows of the instances.
    fn finish(mut self) -> Result<Vec<Value>> {
        let mut rows = Vec::new();
        for instance in self.instances.values() {
            self.table.row(&instance.waiting)?;
            rows.push(json!({
                "token": token("instance", instance.number),
                "category_token": token("category", u64::from(instance.class)),
                "nbr_annotations": instance.count,
                "first_annotation_token": token("sample_annotation", instance.first),
                "last_annotation_token": token("sample_annotation", instance.last),
            }));
        }
        self.table.finish()?;
        Ok(rows)
    }
}

/// The row of an annotation without neighbours.
fn annotation(frame: u64, number: u64, instance: u64, one: &FrameBox) -> Value {
    let (p, q, size) = (one.pose.centre, one.pose.rotation, one.track.size);
    json!({
        "token": token("sample_annotation", number),
        "sample_token": token("sample", frame),
        "instance_token": token("instance", instance),
        "visibility_token": visibility(one.visibility()),
        "attribute_tokens": [],
        "translation": [p.x, p.y, p.z],
        // Width, length and height.
        "size": [size.y, size.x, size.z],
        "rotation": [q.w, q.u.x, q.u.y, q.u.z],
        "prev": "", "next": "",
        "num_lidar_pts": one.points, "num_radar_pts": 0,
    })
}

/// The rows of visibility.
fn levels() -> Vec<Value> {
    let row = |(token, from, to): (&str, f64, f64)| {
        let description = format!("{from} to {to} % of the beams to the box reach the object");
        json!({ "token": token, "level": format!("v{from}-{to}"), "description": description })
    };
    VISIBILITIES.into_iter().map(row).collect()
}

/// The token of the row of visibility for a share.
fn visibility(share: f64) -> &'static str {
    let least = |(token, from, _): &(&'static str, f64, f64)| (100.0 * share >= *from).then_some(*token);
    VISIBILITIES.iter().rev().find_map(least).unwrap_or("1")
}

/// A class as lidarseg has it.
fn class_of(frame: u64, class: i64) -> Result<u8> {
    u8::try_from(class).map_err(|_| {
        Error::input_with_help(
            format!("frame {frame}: class {class} does not fit the 8 bits of lidarseg"),
            "use a class from 0 to 255, or --layout kitti, whose classes go up to 65535",
        )
    })
}

pub(super) struct Nuscenes {
    folders: Folders,
    names: Names,
    annotations: Annotations,
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
    pub fn begin(folder: &Path, names: Names, group: &mut FileGroup) -> Result<Nuscenes> {
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
        let annotations = Annotations {
            table: table("sample_annotation")?,
            count: 0,
            instances: BTreeMap::new(),
            are_requested: false,
        };
        Ok(Nuscenes {
            folders,
            names,
            annotations,
            frames: 0,
            classes: BTreeSet::new(),
            poses,
            samples,
            data,
            waiting: None,
        })
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
    fn frame(&mut self, frame: &PlacedFrame, boxes: Option<&[FrameBox]>) -> Result<()> {
        self.rows(true)?;
        if let Some(boxes) = boxes {
            self.annotations.are_requested = true;
            self.annotations.frame(self.frames, boxes)?;
        }
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
            let class = class_of(self.frames, point.class)?;
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

    fn table_folder(&self) -> &Path {
        &self.folders.tables
    }

    fn finish(mut self: Box<Self>) -> Result<()> {
        self.rows(false)?;
        let category = |class: u8| {
            let name = self.names.of(i64::from(class));
            json!({
                "token": token("category", u64::from(class)), "name": name, "description": "", "index": class,
            })
        };
        let of_objects = self.annotations.instances.values().map(|instance| instance.class);
        let classes: BTreeSet<u8> = self.classes.iter().copied().chain(of_objects).collect();
        let categories: Vec<Value> = classes.into_iter().map(category).collect();
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
        self.table("attribute", &[])?;
        let levels = if self.annotations.are_requested { levels() } else { Vec::new() };
        self.table("visibility", &levels)?;
        write(&self.folders.maps.join("none.png"), &one_pixel()?)?;
        let Nuscenes { folders, annotations, poses, samples, data, .. } = *self;
        let mut instances = Table::begin(&folders, "instance")?;
        annotations.finish()?.iter().try_for_each(|row| instances.row(row))?;
        [instances, poses, samples, data].into_iter().try_for_each(Table::finish)
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

#[cfg(test)]
mod tests {
    use super::super::objects::Objects;
    use super::*;
    use vlscan_geom::DVec3;

    #[test]
    fn annotations_of_an_object_are_chained() {
        let heading = "object,id,name,class,time,x,y,z,qw,qx,qy,qz,length,width,height,vx,vy,vz";
        let rows = "3,car,car,64,0,1,2,3,0.6,0,0,0.8,4,2,1.5,10,0,0\n5,5,bus,300,0,0,0,0,1,0,0,0,9,3,3,0,0,0";
        let objects = Objects::parse(Path::new("objects.csv"), &format!("{heading}\n{rows}\n")).unwrap();
        let seen = |number, in_front| {
            let track = objects.get(number).unwrap();
            let (pose, points, inside) = (track.at(0.0), 10, 10);
            let (centre, rotation) = (DVec3::ZERO, Rotation::IDENTITY);
            FrameBox { number, track, pose, centre, rotation, points, inside, early: 0, late: 0, in_front }
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sample_annotation.json");
        let file = FileWriter::create(&path, false, Patched::Never).unwrap();
        let table = Table { file, is_empty: true };
        let mut all = Annotations { table, count: 0, instances: BTreeMap::new(), are_requested: true };
        all.frame(0, &[seen(3, 0)]).unwrap();
        all.frame(1, &[]).unwrap();
        all.frame(2, &[seen(3, 90)]).unwrap();
        let error = format!("{:?}", all.frame(3, &[seen(5, 0)]).unwrap_err());
        assert!(error.contains("class 300") && error.contains("--layout kitti"), "{error}");
        let instances = all.finish().unwrap();
        assert_eq!((instances.len(), &instances[0]["nbr_annotations"]), (1, &json!(2)));
        let rows: Vec<Value> = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        let [first, second] = &rows[..] else { panic!("{rows:?}") };
        assert_eq!((&first["prev"], &first["next"]), (&json!(""), &second["token"]));
        assert_eq!((&second["prev"], &second["next"]), (&first["token"], &json!("")));
        assert_eq!(instances[0]["first_annotation_token"], first["token"]);
        assert_eq!(instances[0]["last_annotation_token"], second["token"]);
        assert_eq!(first["size"], json!([2.0, 4.0, 1.5]));
        assert_eq!(first["translation"], json!([1.0, 2.0, 3.0]));
        let q: Vec<f64> = first["rotation"].as_array().unwrap().iter().filter_map(Value::as_f64).collect();
        assert!(q.iter().zip([0.6, 0.0, 0.0, 0.8]).all(|(f, e)| (f - e).abs() < 1e-12), "{q:?}");
        assert_eq!((&first["num_lidar_pts"], &first["visibility_token"]), (&json!(10), &json!("4")));
        assert_eq!(second["visibility_token"], json!("1"));
        let levels = [0.0, 0.39, 0.4, 0.6, 0.79, 0.8, 1.0].map(visibility);
        assert_eq!(levels, ["1", "1", "2", "3", "3", "4", "4"]);
    }
}
