//! Frames of a scanner as data sets of driving: a file per frame, in the axes of the scanner, with poses and
//! labels.
//!
//! A frame's points are moved to where the scanner was at its first point, so that its pose takes all of them
//! to the world.
//!
//! | file | what it does |
//! |---|---|
//! | `placed` | frames at the pose of their first point |
//! | `objects` | moving objects over time, read from a table |
//! | `boxes` | boxes of the moving objects in a frame |
//! | `categories` | names of classes |
//! | `kitti` | the layout of KITTI odometry and SemanticKITTI |
//! | `nuscenes` | the layout of nuScenes with lidarseg |

mod boxes;
mod categories;
mod kitti;
mod nuscenes;
mod objects;
mod placed;

pub use categories::{Category, CategoryError};
pub use placed::ForwardAxis;

use boxes::{BoxTable, FrameBox, boxes};
use categories::Names;
use objects::Objects;
use placed::{PlacedFrame, PlacedPoint, place};
use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Path, PathBuf};
use vlscan_base::Observer;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileGroup, is_taken, write_file};
use vlscan_base::quantity::number;
use vlscan_formats::read_frames;

/// A layout of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum FrameLayout {
    /// KITTI odometry with labels as SemanticKITTI: sequences/00/velodyne, labels, poses.txt, times.txt,
    /// calib.txt.
    Kitti,
    /// nuScenes: samples/LIDAR_TOP, lidarseg and the tables of v1.0-vlscan.
    Nuscenes,
}

impl FrameLayout {
    /// Its name, and the largest intensity of its files; the least is 0.
    fn intensities(self) -> (&'static str, f32) {
        match self {
            FrameLayout::Kitti => ("KITTI", 1.0),
            FrameLayout::Nuscenes => ("nuScenes", 255.0),
        }
    }
}

/// How frames are written.
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct FrameOptions {
    /// The layout of the folder.
    #[arg(long, value_enum)]
    pub layout: FrameLayout,
    /// The axis of the scanner that points forward.
    #[arg(long, value_enum, default_value_t = ForwardAxis::X)]
    pub forward: ForwardAxis,
    /// Number of the sequence of KITTI.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(..100))]
    pub sequence: u32,
    /// Factor from the intensities of the instrument to those of the files, which are 0 to 1 in KITTI and 0
    /// to 255 in nuScenes.
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = crate::args::positive)]
    pub intensity_factor: f64,
    /// Boxes and classes of objects.
    #[command(flatten)]
    pub objects: ObjectOptions,
}

/// Boxes and classes of objects.
#[derive(Clone, Debug, Default, PartialEq, clap::Args)]
pub struct ObjectOptions {
    /// Write the boxes of the moving objects in this table, which vlscan run --objects has written for the
    /// same points: label_2 and calib in KITTI, sample_annotation and instance in nuScenes, and boxes.csv.
    #[arg(long, value_name = "FILE")]
    pub objects: Option<PathBuf>,
    /// Leave the points of moving objects where they were measured, smeared along their way. Without it they
    /// are moved to where they are at the time of the box, and lie in it.
    #[arg(long, requires = "objects")]
    pub skewed_objects: bool,
    /// Name of a class in label_2 and in the categories of nuScenes, such as 64=Car or 64=vehicle.car; may be
    /// given more than once. [default: the name of the LAS specification, or class 64]
    #[arg(long = "category", value_name = "CLASS=NAME")]
    pub categories: Vec<Category>,
}

/// Numbers of frames and points that were written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounts {
    /// Number of frames.
    pub frames: u64,
    /// Number of points.
    pub points: u64,
    /// Number of boxes of moving objects.
    pub boxes: u64,
}

/// A layout that is being written.
trait FrameWriter {
    /// Writes a frame, with the boxes of its moving objects if they are requested.
    fn frame(&mut self, frame: &PlacedFrame, boxes: Option<&[FrameBox]>) -> Result<()>;

    /// The folder of the table of boxes.
    fn table_folder(&self) -> &Path;

    /// Writes what follows the last frame.
    fn finish(self: Box<Self>) -> Result<()>;
}

/// Intensities that are written.
#[derive(Clone, Copy, Debug)]
struct Intensities {
    min: f32,
    max: f32,
    /// Points whose intensity the layout does not have.
    beyond: u64,
}

impl Intensities {
    /// Adds the intensities of a frame, of which those up to `most` are in the layout.
    fn add(&mut self, points: &[PlacedPoint], most: f32) {
        for intensity in points.iter().map(|point| point.intensity) {
            (self.min, self.max) = (self.min.min(intensity), self.max.max(intensity));
            // Also of NaN.
            self.beyond += u64::from(!(0.0..=most).contains(&intensity));
        }
    }

    /// A warning if points have intensities that the layout does not have.
    fn doubts(&self, name: &Path, options: &FrameOptions) -> Diagnostics {
        let mut found = Diagnostics::default();
        let (layout, most) = options.layout.intensities();
        if self.beyond == 0 {
            return found;
        }
        let [min, max] = [self.min, self.max].map(|value| number(f64::from(value)));
        let (count, lie) = (self.beyond, if self.beyond == 1 { "point lies" } else { "points lie" });
        let message = format!(
            "intensities are {min} to {max}, those of {layout} are 0 to {most}: {count} {lie} beyond"
        );
        let problem = found.warn(Some(Place::of_file(name)), message);
        if self.max > most && self.max.is_finite() {
            let factor = options.intensity_factor * f64::from(most) / f64::from(self.max);
            problem
                .help(format!("scale them into this range with --intensity-factor {}", rounded_down(factor)));
        }
        found
    }
}

/// Classes whose names are written.
#[derive(Debug, Default)]
struct NamedClasses(BTreeSet<i64>);

impl NamedClasses {
    /// Adds those of a frame: of its boxes, in nuScenes also of its points.
    fn add(&mut self, frame: &PlacedFrame, boxes: Option<&[FrameBox]>, layout: FrameLayout) {
        self.0.extend(boxes.into_iter().flatten().map(|one| one.track.class));
        if layout == FrameLayout::Nuscenes {
            self.0.extend(frame.points.iter().map(|point| point.class));
        }
    }

    /// A warning if names are chosen for other classes.
    fn doubts(&self, name: &Path, options: &FrameOptions) -> Diagnostics {
        let mut found = Diagnostics::default();
        let ObjectOptions { objects, categories, .. } = &options.objects;
        let unused = categories.iter().filter(|category| !self.0.contains(&i64::from(category.class)));
        let unused: Vec<String> =
            unused.map(|category| format!("{}={}", category.class, category.name)).collect();
        if unused.is_empty() {
            return found;
        }
        let (why, help) = match (options.layout, objects) {
            (FrameLayout::Kitti, None) => {
                ("KITTI names the classes of boxes only", "add boxes with --objects objects.csv".to_owned())
            }
            (FrameLayout::Kitti, Some(_)) => ("no box is of such a class", classes_help(name)),
            (FrameLayout::Nuscenes, _) => ("no point is of such a class", classes_help(name)),
        };
        let message = format!("--category {} has no effect: {why}", unused.join(", "));
        found.warn(Some(Place::of_file(name)), message).help(help);
        found
    }
}

fn classes_help(name: &Path) -> String {
    format!("`vlscan info {}` lists the classes of the points", name.display())
}

/// A warning if a number of a sequence is chosen for a layout without such numbers; `name` is that of the
/// source.
fn unused_sequence(name: &Path, options: &FrameOptions) -> Diagnostics {
    let mut found = Diagnostics::default();
    if options.layout == FrameLayout::Nuscenes && options.sequence != 0 {
        let message = format!("--sequence {} has no effect: nuScenes has no sequences", options.sequence);
        found.warn(Some(Place::of_file(name)), message).help("leave it out, or use --layout kitti");
    }
    found
}

/// A warning if a table of objects is of another run than the points of `name`, of which there are `boxes`,
/// and points before the first poses and after the last ones.
fn table_doubts(table: &Path, name: &Path, boxes: u64, [early, late]: [u64; 2]) -> Diagnostics {
    let mut found = Diagnostics::default();
    let name = name.display();
    let message = match (boxes, early, late) {
        (0, ..) => format!("no point of {name} is of an object of this table"),
        (_, 0, 0) => return found,
        (_, 0, late) => {
            format!("{late} points of objects of {name} are newer than the last poses of this table")
        }
        (_, early, _) => {
            format!("{early} points of objects of {name} are older than the first poses of this table")
        }
    };
    found
        .warn(Some(Place::of_file(table)), message)
        .help("write the table with the points: vlscan run -o points.mcap --objects objects.csv");
    found
}

/// A positive number with two digits, not above it.
fn rounded_down(value: f64) -> String {
    let unit = libm::exp10(libm::floor(libm::log10(value)) - 1.0);
    format!("{:.1e}", (value / unit * (1.0 - 1e-9)).floor() * unit)
}

/// Writes the frames of an MCAP file to a folder; `name` is that of the source in messages. One frame is in
/// memory at a time. The data set appears when it is complete. Intensities that the layout does not have,
/// names of classes that are not written, and a table of objects of which there are no points, or points of
/// other times, are reported to `observer`.
///
/// # Errors
/// [`Error::Io`]; [`Error::Input`] for a source that is not an MCAP file with points and poses, for a
/// malformed table of objects, for numbers that the files cannot hold, for folders of the layout that exist,
/// and for warnings of a strict observer.
pub fn write_frames(
    source: &mut dyn Read,
    name: &Path,
    folder: &Path,
    options: &FrameOptions,
    observer: &Observer,
) -> Result<FrameCounts> {
    let requested = &options.objects;
    let objects = requested.objects.as_deref().map(Objects::read).transpose()?;
    let names = Names::new(&requested.categories)?;
    let mut group = FileGroup::default();
    let mut writer: Box<dyn FrameWriter> = match options.layout {
        FrameLayout::Kitti => Box::new(kitti::Kitti::begin(folder, options.sequence, names, &mut group)?),
        FrameLayout::Nuscenes => Box::new(nuscenes::Nuscenes::begin(folder, names, &mut group)?),
    };
    let mut table = objects.as_ref().map(|_| BoxTable::begin(writer.table_folder())).transpose()?;
    let (mut counts, mut early, mut late) = (FrameCounts::default(), 0, 0);
    let mut intensities = Intensities { min: f32::INFINITY, max: f32::NEG_INFINITY, beyond: 0 };
    let mut named = NamedClasses::default();
    let (_, most) = options.layout.intensities();
    read_frames(source, name, &mut |frame| {
        let mut placed = place(&frame, options.forward, options.intensity_factor).ok_or_else(|| {
            let message = format!("{}: it contains points whose frame has no poses (/tf)", name.display());
            Error::input_with_help(message, "write it with vlscan run -o points.mcap, whose poses are on /tf")
        })?;
        counts.frames += 1;
        counts.points += placed.points.len() as u64;
        intensities.add(&placed.points, most);
        let found = objects.as_ref().map(|objects| boxes(&mut placed, objects, !requested.skewed_objects));
        if let (Some(table), Some(found)) = (&mut table, &found) {
            table.frame(found)?;
            counts.boxes += found.len() as u64;
            early += found.iter().map(|one| one.early).sum::<u64>();
            late += found.iter().map(|one| one.late).sum::<u64>();
        }
        if !requested.categories.is_empty() {
            named.add(&placed, found.as_deref(), options.layout);
        }
        writer.frame(&placed, found.as_deref())
    })?;
    if counts.frames == 0 {
        return Err(Error::input(format!("{}: it contains no point messages", name.display())));
    }
    let mut found = intensities.doubts(name, options);
    found.extend(named.doubts(name, options));
    found.extend(unused_sequence(name, options));
    if let Some(path) = &requested.objects {
        found.extend(table_doubts(path, name, counts.boxes, [early, late]));
    }
    observer.warnings(found)?;
    table.map_or(Ok(()), BoxTable::finish)?;
    writer.finish()?;
    group.commit()?;
    Ok(counts)
}

/// Writes a new file of a layout.
fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_file(path, false, bytes)
}

/// Rejects a folder of a layout that exists: frames of another run would be among those that are written.
fn refuse_existing(folder: &Path) -> Result<()> {
    if is_taken(folder) {
        return Err(Error::input_with_help(
            format!("{} exists", folder.display()),
            "name another folder, or remove this one",
        ));
    }
    Ok(())
}

/// Creates a folder of a layout.
fn create(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io("create", folder, e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::DVec3;

    #[test]
    fn intensities_beyond_those_of_the_layout_are_told_with_the_factor_to_type() {
        let (position, origin) = (DVec3::ZERO, DVec3::ZERO);
        let point = |intensity| PlacedPoint {
            position,
            origin,
            intensity,
            time_s: 0.0,
            ring: 0,
            class: 0,
            instance: 0,
        };
        let said = |layout, values: &[f32], intensity_factor| {
            let (forward, objects) = (ForwardAxis::X, ObjectOptions::default());
            let options = FrameOptions { layout, forward, sequence: 0, intensity_factor, objects };
            let mut all = Intensities { min: f32::INFINITY, max: f32::NEG_INFINITY, beyond: 0 };
            let points: Vec<PlacedPoint> = values.iter().map(|value| point(*value)).collect();
            all.add(&points, layout.intensities().1);
            all.doubts(Path::new("a.mcap"), &options).text()
        };
        let (kitti, nuscenes) = (FrameLayout::Kitti, FrameLayout::Nuscenes);
        let found = said(kitti, &[890.0, 0.5, 617_421.0], 1.0);
        assert!(found.contains("0.5 to 617421, those of KITTI are 0 to 1: 2 points"), "{found}");
        assert!(found.contains("--intensity-factor 1.6e-6"), "{found}");
        // With this factor they are within.
        assert_eq!(said(kitti, &[890.0 * 1.6e-6, 617_421.0 * 1.6e-6], 1.6e-6), "");
        assert!(said(kitti, &[2.0], 0.5).contains("--intensity-factor 2.4e-1"));
        assert_eq!(said(nuscenes, &[0.0, 255.0], 1.0), "");
        assert!(said(nuscenes, &[510.0], 1.0).contains("--intensity-factor 4.9e-1"));
        assert!(said(nuscenes, &[-1.0], 1.0).contains("1 point lies beyond"));
        assert!(said(kitti, &[f32::NAN], 1.0).contains("1 point lies"));
    }

    #[test]
    fn names_of_classes_and_sequences_that_are_not_written_are_told() {
        let said = |layout, objects: Option<&str>, classes: &[i64]| {
            let categories: Vec<Category> = ["64=Car", "65=Van"].map(|text| text.parse().unwrap()).to_vec();
            let objects = objects.map(PathBuf::from);
            let objects = ObjectOptions { objects, skewed_objects: false, categories };
            let options =
                FrameOptions { layout, forward: ForwardAxis::X, sequence: 0, intensity_factor: 1.0, objects };
            let named = NamedClasses(classes.iter().copied().collect());
            named.doubts(Path::new("a.mcap"), &options).text()
        };
        let (kitti, nuscenes) = (FrameLayout::Kitti, FrameLayout::Nuscenes);
        assert_eq!(said(nuscenes, None, &[64, 65, 6]), "");
        assert!(said(nuscenes, None, &[65]).contains("--category 64=Car has no effect: no point"));
        assert!(said(kitti, Some("o.csv"), &[64]).contains("--category 65=Van has no effect: no box"));
        let sequence = |layout, sequence| {
            let (forward, objects) = (ForwardAxis::X, ObjectOptions::default());
            let options = FrameOptions { layout, forward, sequence, intensity_factor: 1.0, objects };
            unused_sequence(Path::new("a.mcap"), &options).text()
        };
        assert!(sequence(nuscenes, 3).contains("--sequence 3 has no effect"));
        assert_eq!((sequence(kitti, 3), sequence(nuscenes, 0)), (String::new(), String::new()));
        let both = said(kitti, None, &[]);
        assert!(both.contains("64=Car, 65=Van has no effect") && both.contains("--objects"), "{both}");
    }
}
