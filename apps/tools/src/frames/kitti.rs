//! The layout of KITTI odometry (Geiger, Lenz & Urtasun, 2012, Are we ready for autonomous driving?), with
//! labels as SemanticKITTI has them (Behley et al., 2019). Axes are x forward, y left, z up.
//!
//! ```text
//! sequences/00/velodyne/000000.bin   float32: x, y, z, intensity
//! sequences/00/labels/000000.label   uint32: class | instance << 16
//! sequences/00/poses.txt             3 × 4 rows per line: from the frame to the first frame
//! sequences/00/times.txt             seconds after the first frame
//! sequences/00/calib.txt             P0 to P3 and Tr: no cameras, the identity
//! sequences/00/world.txt             3 × 4 rows: from the first frame to the coordinates of the scene
//! ```

use super::placed::PlacedFrame;
use super::{FrameWriter, create, refuse_existing, write};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileGroup, FileWriter, Patched};
use vlscan_geom::{DVec3, Rotation};

/// Without cameras their matrices are the identity, and the poses are those of the scanner.
const CALIBRATION: &str = "\
P0: 1 0 0 0 0 1 0 0 0 0 1 0
P1: 1 0 0 0 0 1 0 0 0 0 1 0
P2: 1 0 0 0 0 1 0 0 0 0 1 0
P3: 1 0 0 0 0 1 0 0 0 0 1 0
Tr: 1 0 0 0 0 1 0 0 0 0 1 0
";

pub(super) struct Kitti {
    folder: PathBuf,
    frames: u32,
    /// Time, ns, position and rotation of the first frame.
    first: Option<(u64, DVec3, Rotation)>,
    poses: FileWriter,
    times: FileWriter,
}

impl Kitti {
    /// Begins a sequence in `folder`, which gets its name with `group`.
    pub fn begin(folder: &Path, sequence: u32, group: &mut FileGroup) -> Result<Kitti> {
        let sequences = folder.join("sequences");
        let folder = sequences.join(format!("{sequence:02}"));
        refuse_existing(&folder)?;
        group.create_folder(&sequences)?;
        let folder = group.stage_folder(&folder)?;
        create(&folder.join("velodyne"))?;
        create(&folder.join("labels"))?;
        let open = |name: &str| FileWriter::create(&folder.join(name), false, Patched::Never);
        let (poses, times) = (open("poses.txt")?, open("times.txt")?);
        Ok(Kitti { folder, frames: 0, first: None, poses, times })
    }
}

/// The rows of a pose, whose columns are the images of the axes of a frame and its origin.
fn rows(rotation: Rotation, position: DVec3) -> String {
    let columns = [rotation.apply(DVec3::X), rotation.apply(DVec3::Y), rotation.apply(DVec3::Z), position];
    let mut text = String::new();
    for axis in 0..3 {
        for column in columns {
            let blank = if text.is_empty() { "" } else { " " };
            let _ = write!(text, "{blank}{:e}", column[axis] + 0.0);
        }
    }
    text + "\n"
}

impl FrameWriter for Kitti {
    fn frame(&mut self, frame: &PlacedFrame) -> Result<()> {
        let pose = &frame.pose;
        let (time_ns, position, rotation) = match self.first {
            Some(first) => first,
            None => {
                self.first = Some((pose.time_ns, pose.position, pose.rotation));
                write(&self.folder.join("world.txt"), rows(pose.rotation, pose.position).as_bytes())?;
                write(&self.folder.join("calib.txt"), CALIBRATION.as_bytes())?;
                (pose.time_ns, pose.position, pose.rotation)
            }
        };
        let mut points = Vec::with_capacity(16 * frame.points.len());
        let mut labels = Vec::with_capacity(4 * frame.points.len());
        for point in &frame.points {
            for value in point.position.to_array() {
                points.extend((value as f32).to_le_bytes());
            }
            points.extend(point.intensity.to_le_bytes());
            let half = |value: i64, what: &str| {
                u16::try_from(value).map_err(|_| {
                    let message =
                        format!("frame {}: {what} {value} does not fit the 16 bits of labels", self.frames);
                    Error::input(message)
                })
            };
            let label =
                u32::from(half(point.class, "class")?) | u32::from(half(point.instance, "object")?) << 16;
            labels.extend(label.to_le_bytes());
        }
        let number = format!("{:06}", self.frames);
        write(&self.folder.join("velodyne").join(number.clone() + ".bin"), &points)?;
        write(&self.folder.join("labels").join(number + ".label"), &labels)?;
        // From the frame to the first one.
        let back = rotation.inverse();
        let relative = rows(back.after(pose.rotation), back.apply(pose.position - position));
        self.poses.append(relative.as_bytes())?;
        let seconds = (pose.time_ns as f64 - time_ns as f64) / 1e9;
        self.times.append(format!("{seconds:e}\n").as_bytes())?;
        self.frames += 1;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.poses.finish()?;
        self.times.finish().map(drop)
    }
}
