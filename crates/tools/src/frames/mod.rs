//! Frames of a scanner as data sets of driving: a file per frame, in the axes of the scanner, with poses and labels.
//!
//! A frame's points are moved to where the scanner was at its first point, so that its pose takes all of them to the world.
//!
//! | file | what it does |
//! |---|---|
//! | `placed` | frames at the pose of their first point |
//! | `kitti` | the layout of KITTI odometry and SemanticKITTI |
//! | `nuscenes` | the layout of nuScenes with lidarseg |

mod kitti;
mod nuscenes;
mod placed;

use placed::{PlacedFrame, place};
use std::io::Read;
use std::path::Path;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::write_file;
use vlscan_formats::read_frames;

/// A layout of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum FrameLayout {
    /// KITTI odometry with labels as SemanticKITTI: sequences/00/velodyne, labels, poses.txt, times.txt, calib.txt.
    Kitti,
    /// nuScenes: samples/LIDAR_TOP, lidarseg and the tables of v1.0-vlscan.
    Nuscenes,
}

/// An axis of the scanner that points forward.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ForwardAxis {
    /// x, with y to the left: the vehicles of the catalogue.
    X,
    /// y, with x to the right.
    Y,
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
    /// Factor from the intensities of the instrument to those of the files, which are 0 to 1 in KITTI and 0 to 255 in nuScenes.
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = crate::args::positive)]
    pub intensity_factor: f64,
}

/// What was written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounts {
    /// Number of frames.
    pub frames: u64,
    /// Number of points.
    pub points: u64,
}

/// A layout that is being written.
trait FrameWriter {
    /// Writes a frame.
    fn frame(&mut self, frame: &PlacedFrame) -> Result<()>;

    /// Writes what follows the last frame.
    fn finish(self: Box<Self>) -> Result<()>;
}

/// Writes the frames of an MCAP file to a folder; `name` is that of the source in messages. One frame is in memory at a time.
///
/// # Errors
/// [`Error::Io`]; [`Error::Input`] for a source that is no MCAP with points and poses, for numbers that the files cannot hold, and for
/// folders of the layout that exist.
pub fn write_frames(
    source: &mut dyn Read,
    name: &Path,
    folder: &Path,
    options: &FrameOptions,
) -> Result<FrameCounts> {
    let mut writer: Box<dyn FrameWriter> = match options.layout {
        FrameLayout::Kitti => Box::new(kitti::Kitti::begin(folder, options.sequence)?),
        FrameLayout::Nuscenes => Box::new(nuscenes::Nuscenes::begin(folder)?),
    };
    let mut counts = FrameCounts::default();
    read_frames(source, name, &mut |frame| {
        let placed = place(&frame, options.forward, options.intensity_factor).ok_or_else(|| {
            let message = format!("{}: it has points without poses of their frame (/tf)", name.display());
            Error::input_with_help(message, "write it with vlscan run -o points.mcap, whose poses are on /tf")
        })?;
        counts.frames += 1;
        counts.points += placed.points.len() as u64;
        writer.frame(&placed)
    })?;
    if counts.frames == 0 {
        return Err(Error::input(format!("{}: it has no messages of points", name.display())));
    }
    writer.finish()?;
    Ok(counts)
}

/// Writes a new file of a layout.
fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_file(path, false, bytes)
}

/// Refuses a folder of a layout that exists: frames of another run would be among those that are written.
fn refuse_existing(folder: &Path) -> Result<()> {
    if folder.exists() {
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
