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
//!
//! With boxes of objects the files of KITTI object detection (Geiger, Lenz & Urtasun, 2012) are beside them.
//! Their boxes are in the axes of a camera at the scanner: x right, y down, z forward.
//!
//! ```text
//! sequences/00/label_2/000000.txt    type truncated occluded alpha bbox(4) h w l x y z rotation_y
//! sequences/00/calib/000000.txt      P0 to P3, R0_rect: the identity; Tr_velo_to_cam: the axes
//! sequences/00/boxes.csv             the table of boxes
//! ```

use super::boxes::FrameBox;
use super::categories::Names;
use super::placed::PlacedFrame;
use super::{FrameWriter, create, refuse_existing, write};
use std::f64::consts::{FRAC_PI_2, TAU};
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

/// The calibration of a frame with boxes.
const CAMERA: &str = "\
P0: 1 0 0 0 0 1 0 0 0 0 1 0
P1: 1 0 0 0 0 1 0 0 0 0 1 0
P2: 1 0 0 0 0 1 0 0 0 0 1 0
P3: 1 0 0 0 0 1 0 0 0 0 1 0
R0_rect: 1 0 0 0 1 0 0 0 1
Tr_velo_to_cam: 0 -1 0 0 0 0 -1 0 1 0 0 0
Tr_imu_to_velo: 1 0 0 0 0 1 0 0 0 0 1 0
";

/// Shares of an object that is seen from which on it is fully visible, and partly occluded.
const VISIBILITIES: [f64; 2] = [0.8, 0.4];

pub(super) struct Kitti {
    folder: PathBuf,
    names: Names,
    frames: u32,
    /// Time, ns, position and rotation of the first frame.
    first: Option<(u64, DVec3, Rotation)>,
    poses: FileWriter,
    times: FileWriter,
}

impl Kitti {
    /// Begins a sequence in `folder`, which gets its name with `group`.
    pub fn begin(folder: &Path, sequence: u32, names: Names, group: &mut FileGroup) -> Result<Kitti> {
        let sequences = folder.join("sequences");
        let folder = sequences.join(format!("{sequence:02}"));
        refuse_existing(&folder)?;
        group.create_folder(&sequences)?;
        let folder = group.stage_folder(&folder)?;
        create(&folder.join("velodyne"))?;
        create(&folder.join("labels"))?;
        let open = |name: &str| FileWriter::create(&folder.join(name), false, Patched::Never);
        let (poses, times) = (open("poses.txt")?, open("times.txt")?);
        Ok(Kitti { folder, names, frames: 0, first: None, poses, times })
    }

    /// Writes the labels of the boxes of a frame, and its calibration.
    fn boxes(&self, number: &str, boxes: &[FrameBox]) -> Result<()> {
        let text: String = boxes.iter().map(|one| label(one, &self.names.of(one.track.class))).collect();
        let [labels, calibration] = ["label_2", "calib"].map(|name| self.folder.join(name));
        if self.frames == 0 {
            create(&labels)?;
            create(&calibration)?;
        }
        write(&labels.join(format!("{number}.txt")), text.as_bytes())?;
        write(&calibration.join(format!("{number}.txt")), CAMERA.as_bytes())
    }
}

/// The line of a box. There is no image: nothing is truncated, and the box in it is empty.
fn label(one: &FrameBox, class: &str) -> String {
    let visibility = one.visibility();
    let occluded = VISIBILITIES.iter().filter(|least| visibility < **least).count();
    let size = one.track.size;
    // KITTI has the middle of the bottom, and angles about the downward axis, from x of the camera.
    let [forward, left, up] = (one.centre - DVec3::Z * (0.5 * size.z)).to_array();
    let (x, y, z) = (-left, -up, forward);
    let front = one.rotation.apply(DVec3::X);
    let turn = within_half_turn(-libm::atan2(front.y, front.x) - FRAC_PI_2);
    let alpha = within_half_turn(turn - libm::atan2(x, z));
    let kind = class.replace(char::is_whitespace, "_");
    let mut line = format!("{kind} 0 {occluded} {alpha:.6} 0 0 0 0");
    for value in [size.z, size.y, size.x, x, y, z] {
        let _ = write!(line, " {value:.4}");
    }
    let _ = writeln!(line, " {turn:.6}");
    line
}

/// An angle from −π to π.
fn within_half_turn(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
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
    fn frame(&mut self, frame: &PlacedFrame, boxes: Option<&[FrameBox]>) -> Result<()> {
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
        write(&self.folder.join("labels").join(number.clone() + ".label"), &labels)?;
        if let Some(boxes) = boxes {
            self.boxes(&number, boxes)?;
        }
        // From the frame to the first one.
        let back = rotation.inverse();
        let relative = rows(back.after(pose.rotation), back.apply(pose.position - position));
        self.poses.append(relative.as_bytes())?;
        let seconds = (pose.time_ns as f64 - time_ns as f64) / 1e9;
        self.times.append(format!("{seconds:e}\n").as_bytes())?;
        self.frames += 1;
        Ok(())
    }

    fn table_folder(&self) -> &Path {
        &self.folder
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.poses.finish()?;
        self.times.finish().map(drop)
    }
}

#[cfg(test)]
mod tests {
    use super::super::objects::Objects;
    use super::*;

    #[test]
    fn boxes_are_in_the_axes_of_the_camera() {
        let heading = "object,id,name,class,time,x,y,z,qw,qx,qy,qz,length,width,height,vx,vy,vz";
        let row = "3,car,car,64,0,0,0,0,1,0,0,0,4,2,1.5,10,0,0";
        let objects = Objects::parse(Path::new("objects.csv"), &format!("{heading}\n{row}\n")).unwrap();
        let track = objects.get(3).unwrap();
        let said = |centre: [f64; 3], angle: f64, in_front: u64| -> Vec<String> {
            let one = FrameBox {
                number: 3,
                track,
                pose: track.at(0.0),
                centre: DVec3::from(centre),
                rotation: Rotation::about_z(angle),
                points: 10,
                inside: 10,
                early: 0,
                late: 0,
                in_front,
            };
            label(&one, "big car").split_whitespace().map(str::to_owned).collect()
        };
        let numbers = |words: &[String]| -> Vec<f64> { words.iter().map(|w| w.parse().unwrap()).collect() };
        let close = |found: Vec<f64>, expected: &[f64]| {
            assert_eq!(found.len(), expected.len());
            assert!(found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 1e-5), "{found:?}");
        };
        // 20 m ahead, 3 m to the left, 1 m below the scanner, going away.
        let ahead = said([20.0, 3.0, -1.0], 0.0, 0);
        assert_eq!(ahead[..3], ["big_car", "0", "0"]);
        // Height, width, length; x right, y down to the bottom, z forward; a quarter turn to the left.
        close(numbers(&ahead[8..]), &[1.5, 2.0, 4.0, -3.0, 1.75, 20.0, -FRAC_PI_2]);
        close(numbers(&ahead[3..8]), &[-FRAC_PI_2 + libm::atan2(3.0, 20.0), 0.0, 0.0, 0.0, 0.0]);
        // To the right, and towards the scanner.
        close(numbers(&said([20.0, 0.0, 0.0], -FRAC_PI_2, 0)[14..]), &[0.0]);
        close(numbers(&said([20.0, 0.0, 0.0], FRAC_PI_2 * 2.0, 0)[14..]), &[FRAC_PI_2]);
        let occluded: Vec<String> =
            [2, 3, 15, 16].map(|front| said([20.0, 0.0, 0.0], 0.0, front)[2].clone()).to_vec();
        // Shares of 10/12, 10/13, 10/25 and 10/26.
        assert_eq!(occluded, ["0", "1", "1", "2"]);
    }
}
