//! Boxes of the moving objects that a frame shows, with their points.

use super::objects::{ObjectPose, ObjectTrack, Objects};
use super::placed::{PlacedFrame, PlacedPoint, time_after};
use std::collections::BTreeMap;
use std::path::Path;
use vlscan_base::columns::quoted;
use vlscan_base::error::Result;
use vlscan_base::files::{FileWriter, Patched};
use vlscan_geom::{Aabb, DVec3, Rotation};

/// Distance from a box up to which points are in it, m: more than the rounding of coordinates.
const TOLERANCE: f64 = 0.01;
/// Time before the first pose of an object, and after the end of its last one, from which on points are of
/// another run, ns: more than the rounding of times.
const TIME_TOLERANCE_NS: f64 = 1e6;

/// The box of an object at the mean time of its points in a frame.
#[derive(Clone, Debug)]
pub(super) struct FrameBox<'a> {
    /// Number of the object in the points.
    pub number: i64,
    pub track: &'a ObjectTrack,
    /// In the world, with the mean time of the points.
    pub pose: ObjectPose,
    /// Centre in the axes of the frame, m.
    pub centre: DVec3,
    /// From the axes of the box to those of the frame.
    pub rotation: Rotation,
    /// Number of points of the object.
    pub points: u64,
    /// Number of these that lie in the box.
    pub inside: u64,
    /// Number of these that were measured before the first pose of the object.
    pub early: u64,
    /// Number of these that were measured when its last pose no longer held.
    pub late: u64,
    /// Number of points of other surfaces in front of the box.
    pub in_front: u64,
}

impl FrameBox<'_> {
    /// Share of the beams to the box that reach the object: of the points in front of it and of its own.
    pub fn visibility(&self) -> f64 {
        self.points as f64 / (self.points + self.in_front).max(1) as f64
    }

    /// Counts the points of the frame that are in the box and in front of it.
    fn count(&mut self, points: &[PlacedPoint]) {
        let (back, half) = (self.rotation.inverse(), self.track.size * 0.5);
        let bounds = Aabb { min: -half, max: half };
        for point in points {
            let at = back.apply(point.position - self.centre);
            if point.instance == self.number {
                let beyond = (at.abs() - half).max_element();
                self.inside += u64::from(beyond <= TOLERANCE);
                continue;
            }
            // The beam would enter the box behind the point.
            let from = back.apply(point.origin - self.centre);
            let entry = bounds.slabs(from, at - from);
            self.in_front += u64::from(entry.is_some_and(|(near, _)| near >= 1.0));
        }
    }
}

/// The boxes of the objects of which a frame has points, by number. If the frame `is_deskewed`, points of
/// these objects are moved to where they are at the time of the box.
pub(super) fn boxes<'a>(
    frame: &mut PlacedFrame,
    objects: &'a Objects,
    is_deskewed: bool,
) -> Vec<FrameBox<'a>> {
    let mut found = seen(frame, objects);
    if is_deskewed {
        deskew(frame, &found);
    }
    found.values_mut().for_each(|one| one.count(&frame.points));
    found.into_values().collect()
}

/// The boxes of the objects of a frame, whose points are only counted.
fn seen<'a>(frame: &PlacedFrame, objects: &'a Objects) -> BTreeMap<i64, FrameBox<'a>> {
    let mut times: BTreeMap<i64, (u64, [u64; 2], f64)> = BTreeMap::new();
    for point in &frame.points {
        let Some(track) = objects.get(point.instance) else { continue };
        let time_s = f64::from(point.time_s);
        let time_ns = time_after(frame.time_ns, time_s);
        let is_early = time_ns < track.begin_ns() - TIME_TOLERANCE_NS;
        let is_late = time_ns > track.end_ns() + TIME_TOLERANCE_NS;
        let (count, [early, late], sum) = times.entry(point.instance).or_default();
        (*count, *sum) = (*count + 1, *sum + time_s);
        (*early, *late) = (*early + u64::from(is_early), *late + u64::from(is_late));
    }
    let back = frame.pose.rotation.inverse();
    let of = |(number, (points, [early, late], sum)): (i64, (u64, [u64; 2], f64))| {
        let track = objects.get(number)?;
        let time_ns = time_after(frame.time_ns, sum / points as f64);
        let pose = ObjectPose { time_ns, ..track.at(time_ns) };
        let centre = back.apply(pose.centre - frame.pose.position);
        let rotation = back.after(pose.rotation);
        let (inside, in_front) = (0, 0);
        let found = FrameBox { number, track, pose, centre, rotation, points, inside, early, late, in_front };
        Some((number, found))
    };
    times.into_iter().filter_map(of).collect()
}

/// Moves the points of objects to where they are at the time of their boxes.
fn deskew(frame: &mut PlacedFrame, boxes: &BTreeMap<i64, FrameBox>) {
    let (position, rotation) = (frame.pose.position, frame.pose.rotation);
    let back = rotation.inverse();
    let begin = frame.time_ns;
    for point in &mut frame.points {
        let Some(one) = boxes.get(&point.instance) else { continue };
        let then = one.track.at(time_after(begin, f64::from(point.time_s)));
        let world = rotation.apply(point.position) + position;
        let on_object = then.rotation.inverse().apply(world - then.centre);
        let moved = one.pose.rotation.apply(on_object) + one.pose.centre;
        point.position = back.apply(moved - position);
    }
}

/// Table of the boxes of all frames.
pub(super) struct BoxTable {
    out: FileWriter,
    frames: u64,
}

/// Names of the columns.
const HEADING: &str = "frame,time,object,id,name,class,x,y,z,qw,qx,qy,qz,length,width,height,vx,vy,vz,\
                       points,inside,visibility\n";

impl BoxTable {
    /// Begins the table `boxes.csv` in a folder.
    pub fn begin(folder: &Path) -> Result<BoxTable> {
        let mut out = FileWriter::create(&folder.join("boxes.csv"), false, Patched::Never)?;
        out.append(HEADING.as_bytes())?;
        Ok(BoxTable { out, frames: 0 })
    }

    /// Adds the boxes of the next frame.
    pub fn frame(&mut self, boxes: &[FrameBox]) -> Result<()> {
        for one in boxes {
            let FrameBox { number, track, pose, points, inside, .. } = one;
            let (id, name) = (quoted(&track.id), quoted(&track.name));
            let seconds = pose.time_ns / 1e9;
            let mut line = format!("{},{seconds:.9},{number},{id},{name},{}", self.frames, track.class);
            let q = pose.rotation;
            let values = pose.centre.to_array().into_iter().chain([q.w]).chain(q.u.to_array());
            for value in values.chain(track.size.to_array()).chain(pose.velocity.to_array()) {
                line.push_str(&format!(",{value:.6}"));
            }
            line.push_str(&format!(",{points},{inside},{:.4}\n", one.visibility()));
            self.out.append(line.as_bytes())?;
        }
        self.frames += 1;
        Ok(())
    }

    /// Completes the table.
    pub fn finish(self) -> Result<()> {
        self.out.finish().map(drop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_formats::FramePose;

    /// A car of 4 m × 2 m × 1 m that goes along x at 10 m/s, from (20, 0, 0) at 100 s on, in steps of 10 ms.
    fn car() -> Objects {
        let row = |i: u32| {
            let (time, x) = (100.0 + f64::from(i) * 0.01, 20.0 + f64::from(i) * 0.1);
            format!("3,car,car,64,{time:.9},{x:.6},0,0,1,0,0,0,4,2,1,10,0,0\n")
        };
        let rows: String = (0..20).map(row).collect();
        let heading = "object,id,name,class,time,x,y,z,qw,qx,qy,qz,length,width,height,vx,vy,vz";
        Objects::parse(Path::new("objects.csv"), &format!("{heading}\n{rows}")).unwrap()
    }

    fn point(position: [f64; 3], time_s: f32, instance: i64) -> PlacedPoint {
        let position = DVec3::from(position);
        PlacedPoint { position, origin: DVec3::ZERO, intensity: 1.0, time_s, ring: 0, class: 0, instance }
    }

    fn frame(points: Vec<PlacedPoint>, position: DVec3, rotation: Rotation) -> PlacedFrame {
        let pose = FramePose { time_ns: 100_000_000_000, position, rotation };
        PlacedFrame { time_ns: 100_000_000_000, pose, points }
    }

    #[test]
    fn a_box_along_x_is_where_its_points_are_on_average() {
        // The rear of the car at the middle of each step, while the car goes 1 m.
        let rear = |i: u32| {
            let time = 0.005 + 0.01 * i as f32;
            point([18.0 + 0.1 * f64::from(i), 0.5, 0.0], time, 3)
        };
        let points: Vec<PlacedPoint> = (0..11).map(rear).collect();
        let objects = car();
        let mut skewed = frame(points.clone(), DVec3::ZERO, Rotation::IDENTITY);
        let found = boxes(&mut skewed, &objects, false);
        assert_eq!(found.len(), 1);
        let one = &found[0];
        // On average at 0.055 s, the sixth pose.
        assert!((one.pose.time_ns - 100.055e9).abs() < 1e3, "{}", one.pose.time_ns);
        assert!((one.centre - DVec3::new(20.5, 0.0, 0.0)).length() < 1e-5, "{}", one.centre);
        assert_eq!(one.pose.velocity, DVec3::X * 10.0);
        // Five points are behind the rear of the box.
        assert_eq!((one.points, one.inside, one.in_front), (11, 6, 0));
        let places = |points: &[PlacedPoint]| points.iter().map(|p| p.position).collect::<Vec<DVec3>>();
        assert_eq!(places(&skewed.points), places(&points));
        let mut still = frame(points, DVec3::ZERO, Rotation::IDENTITY);
        let found = boxes(&mut still, &objects, true);
        assert_eq!(found.len(), 1);
        let one = &found[0];
        assert_eq!((one.points, one.inside), (11, 11));
        for point in &still.points {
            assert!((point.position - DVec3::new(18.5, 0.5, 0.0)).length() < 1e-5, "{}", point.position);
        }
    }

    #[test]
    fn boxes_are_in_the_axes_of_the_frame() {
        // The scanner stands at (20, -10, 1) and looks along y: the car is 10 m ahead and goes to the right.
        let turn = Rotation::about_z(std::f64::consts::FRAC_PI_2);
        let mut ahead = frame(vec![point([9.0, 0.0, -1.0], 0.0, 3)], DVec3::new(20.0, -10.0, 1.0), turn);
        let objects = car();
        let found = boxes(&mut ahead, &objects, false);
        assert_eq!(found.len(), 1);
        let one = &found[0];
        assert!((one.centre - DVec3::new(10.0, 0.0, -1.0)).length() < 1e-9, "{}", one.centre);
        assert!((one.rotation.apply(DVec3::X) + DVec3::Y).length() < 1e-9);
        assert_eq!((one.points, one.inside), (1, 1));
    }

    #[test]
    fn visibility_is_the_share_of_beams_that_reach_the_object() {
        let points = vec![
            point([18.0, 0.0, 0.0], 0.0, 3),
            point([18.0, 0.5, 0.0], 0.0, 3),
            point([18.0, 0.8, 0.0], 0.0, 3),
            // Half way to the car; half way beside it; behind the car; in the opposite direction.
            point([9.0, -0.2, 0.0], 0.0, 0),
            point([9.0, 2.0, 0.0], 0.0, 0),
            point([30.0, 0.0, 0.0], 0.0, 0),
            point([-9.0, 0.0, 0.0], 0.0, 5),
        ];
        let objects = car();
        let mut all = frame(points, DVec3::ZERO, Rotation::IDENTITY);
        let found = boxes(&mut all, &objects, false);
        assert_eq!(found.len(), 1);
        let one = &found[0];
        assert_eq!((one.points, one.in_front), (3, 1));
        assert_eq!(one.visibility(), 0.75);
        // The table begins 2 s after the points: it is that of another run.
        assert_eq!((one.early, one.late), (0, 0));
        all.time_ns -= 2_000_000_000;
        let found = boxes(&mut all, &objects, false);
        assert_eq!((found[0].points, found[0].early, found[0].late), (3, 3, 0));
        // It ends 1.8 s before the points.
        all.time_ns += 4_000_000_000;
        let found = boxes(&mut all, &objects, false);
        assert_eq!((found[0].points, found[0].early, found[0].late), (3, 0, 3));
        // An object without points has no box.
        let mut none = frame(vec![point([18.0, 0.0, 0.0], 0.0, 0)], DVec3::ZERO, Rotation::IDENTITY);
        assert!(boxes(&mut none, &objects, false).is_empty());
    }
}
