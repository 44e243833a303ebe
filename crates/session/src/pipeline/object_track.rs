//! The moving objects of a scene over a flight: a table of their boxes, poses and velocities.

use super::chunk::wait_for_poses;
use super::plausibility::is_recording;
use super::session::Session;
use crate::output::ObjectIds;
use std::fmt::Write as _;
use std::path::Path;
use vlscan_base::columns::quoted;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, Patched};
use vlscan_geom::DVec3;
use vlscan_lidar::flight::{FlightPlan, FlightState, Step};
use vlscan_lidar::platform::PoseReader;
use vlscan_scene::{BodyBox, MotionPlan, MotionState, Scene};
use vlscan_survey::PlatformKind;
use vlscan_warehouse::Stop;

/// Names of the columns.
const HEADING: &str = "object,id,name,class,time,x,y,z,qw,qx,qy,qz,length,width,height,vx,vy,vz\n";

/// Maximum number of steps of a flight at once, between checks for a requested stop.
const MAX_STEPS: u64 = 1 << 16;

/// Time before its first pulse from which on a pose holds, ns: more than the rounding of times in files of
/// points, less than the time between two pulses.
const LEAD_NS: f64 = 500.0;

/// An object: one moving part, or several with the same id.
struct Object {
    /// Indices among the moving parts. The pose is that of the first one.
    parts: Vec<usize>,
    /// Number, id, name and class, as the first columns of a row.
    head: String,
    rest: BodyBox,
}

impl Session {
    /// Checks that the poses of the moving objects over the flight can be [written](Session::write_objects).
    ///
    /// # Errors
    /// [`Error::Input`] for scenes without moving parts, scenes with swapped parts, and live trajectories.
    pub fn check_objects(&self) -> Result<()> {
        if self.epochs() > 1 {
            return Err(Error::input_with_help(
                "--objects: the scene has swapped parts, so that its flights have the same times",
                "leave out --objects, or the <swap> elements of the scene",
            ));
        }
        if self.motion().is_none() {
            return Err(Error::input_with_help(
                "--objects: the scene has no moving parts",
                "leave out --objects, or add <dmotion> to a part of the scene",
            ));
        }
        match &self.survey().platform.kind {
            PlatformKind::Stream(stream) if !is_recording(stream) => Err(Error::input_with_help(
                "--objects: a live trajectory can be read only once",
                "record the trajectory in a file, and read this file",
            )),
            _ => Ok(()),
        }
    }

    /// Writes the boxes, poses and velocities of the moving objects over the flight as CSV: a row for each
    /// object before the first pulse, and one whenever rays hit it in another pose. Returns the number of
    /// rows. The file replaces an existing one only with `replace`.
    ///
    /// # Errors
    /// As for [`Session::check_objects`]; those of the flight; [`Error::Io`]; [`Error::Interrupted`].
    pub fn write_objects(&self, path: &Path, replace: bool, stop: &Stop) -> Result<u64> {
        self.check_objects()?;
        let Some(plan) = self.motion() else { return Ok(0) };
        let (settings, scene) = (self.settings(), self.scene());
        // The run has reported the warnings.
        let (flight, _) = self.plan_flight_quietly()?;
        let poses = match &settings.survey.platform.kind {
            PlatformKind::Stream(stream) => Some(PoseReader::open(stream)?),
            _ => None,
        };
        let rates = settings.survey.legs.iter().map(|leg| f64::from(leg.scanner.pulse_freq)).collect();
        let mut out = FileWriter::create(path, replace, Patched::Never)?;
        out.append(HEADING.as_bytes())?;
        let mut track = Track {
            flight: &flight,
            state: FlightState::start(&flight),
            poses,
            stop,
            rates,
            shift: scene.shift,
            objects: objects_of(scene, plan),
            out,
            rows: 0,
        };
        track.write(plan)?;
        track.out.finish()?;
        Ok(track.rows)
    }
}

/// The objects of a scene that move, in the order of their first parts.
fn objects_of(scene: &Scene, plan: &MotionPlan) -> Vec<Object> {
    let ids: Vec<String> = scene.parts.iter().map(|part| part.id.clone()).collect();
    let numbers = ObjectIds::new(&ids);
    let mut grouped: Vec<(i32, Vec<usize>)> = Vec::new();
    for (index, moving) in scene.moving_parts.iter().enumerate() {
        let number = numbers.of_part(moving.part);
        match grouped.iter_mut().find(|(known, _)| *known == number) {
            Some((_, parts)) => parts.push(index),
            None => grouped.push((number, vec![index])),
        }
    }
    let object = |(number, parts): (i32, Vec<usize>)| {
        let (rest, first) = (plan.body_box(&parts)?, *parts.first()?);
        let part = scene.parts.get(scene.moving_parts.get(first)?.part as usize)?;
        let text = |text: &str| quoted(&text.replace(char::is_control, "_"));
        let (id, name) = (text(&part.id), text(&part.name));
        let head = format!("{number},{id},{name},{}", plan.class_of(first));
        Some(Object { parts, head, rest })
    };
    grouped.into_iter().filter_map(object).collect()
}

/// A table that is being written.
struct Track<'a> {
    flight: &'a FlightPlan,
    state: FlightState,
    /// Poses of a recorded trajectory that is read like a stream.
    poses: Option<PoseReader>,
    stop: &'a Stop,
    /// Pulse rates of the legs, Hz.
    rates: Vec<f64>,
    /// World position of the scene's origin, m.
    shift: DVec3,
    objects: Vec<Object>,
    out: FileWriter,
    rows: u64,
}

impl Track<'_> {
    /// Writes the rows of the whole flight.
    fn write(&mut self, plan: &MotionPlan) -> Result<()> {
        if self.flight.is_stream() {
            // The flight has no time before its first pose.
            self.wait()?;
        }
        let mut motion = MotionState::start(plan);
        let begin = self.state.time_ns();
        for object in 0..self.objects.len() {
            self.row(object, plan, &motion, begin)?;
        }
        loop {
            let steps = motion.steps_to_update();
            if !self.take(steps - 1)? {
                return Ok(());
            }
            let before = self.state.time_ns();
            if !self.take(1)? {
                return Ok(());
            }
            let after = self.state.time_ns();
            (1..steps).for_each(|_| motion.step(plan, |_, _| ()));
            let mut moved = Vec::new();
            motion.step(plan, |part, _| moved.push(part));
            let time = after - (0.5 * (after - before)).clamp(0.0, LEAD_NS);
            for object in 0..self.objects.len() {
                if self.objects[object].parts.first().is_some_and(|first| moved.contains(first)) {
                    self.row(object, plan, &motion, time)?;
                }
            }
        }
    }

    /// Takes a number of steps of the flight; `false` at its end.
    fn take(&mut self, steps: u64) -> Result<bool> {
        let mut left = steps;
        while left > 0 {
            if self.stop.is_requested() {
                return Err(Error::Interrupted);
            }
            let skipped = self.state.skip(self.flight, u32::MAX, left.min(MAX_STEPS) as u32)?;
            left -= u64::from(skipped.steps);
            match skipped.last {
                Step::Advanced | Step::LegChanged => {}
                Step::NeedsPoses => self.wait()?,
                Step::Ended => return Ok(false),
            }
        }
        Ok(true)
    }

    fn wait(&mut self) -> Result<()> {
        let stop = self.stop;
        wait_for_poses(self.flight, &mut self.poses, &mut self.state, &|| stop.is_requested())
    }

    /// Writes the row of an object whose pose holds from a time on, ns.
    fn row(&mut self, object: usize, plan: &MotionPlan, motion: &MotionState, time_ns: f64) -> Result<()> {
        let Object { parts, head, rest } = &self.objects[object];
        let Some(&first) = parts.first() else { return Ok(()) };
        let pose = motion.body_pose(plan, first, rest);
        let rate = self.rates.get(self.state.leg_index()).copied().unwrap_or(0.0);
        let (centre, q, v) = (pose.centre + self.shift, pose.rotation, pose.velocity * rate);
        let seconds = self.state.time_origin(self.flight) + time_ns / 1e9;
        let mut line = format!("{head},{seconds:.9}");
        for value in centre.to_array() {
            let _ = write!(line, ",{value:.6}");
        }
        for value in [q.w, q.u.x, q.u.y, q.u.z] {
            let _ = write!(line, ",{value:.12}");
        }
        for value in rest.size.to_array().into_iter().chain(v.to_array()) {
            let _ = write!(line, ",{value:.6}");
        }
        line.push('\n');
        self.out.append(line.as_bytes())?;
        self.rows += 1;
        Ok(())
    }
}
