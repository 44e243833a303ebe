//! Files of a fitted flight: the pipeline file, its trajectory, its mirror's wander and its pulse times.

use super::FlightFit;
use super::mirror::Mirror;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use vlscan_base::error::Result;
use vlscan_base::files::reads::refuse_input_of;
use vlscan_base::files::{FileGroup, FileWriter, Patched, free_name, refuse_unwritable};
use vlscan_geom::{DVec3, degrees};

/// Maximum number of pulse times: a larger file is not written.
const MAX_TIMES: usize = 20_000_000;
/// Maximum number of poses per second.
const MAX_POSES_PER_S: f64 = 1000.0;
/// Bytes of pulse times that are written together.
const WRITTEN_BYTES: usize = 1 << 16;
/// Time from the last pulse to the last pose, s.
const LAST_POSE: f64 = 0.01;

/// The files of a flight.
#[derive(Clone, Debug)]
pub struct FlightFiles {
    /// The pipeline file.
    pub pipeline: PathBuf,
    /// Poses: text.
    pub trajectory: PathBuf,
    /// Deviation of the mirror from even motion: text; for cones.
    pub wander: Option<PathBuf>,
    /// Times of pulses: text; `None` for a constant rate.
    pub pulse_times: Option<PathBuf>,
    /// Output path of a run of the pipeline file.
    pub simulated: PathBuf,
}

/// Extensions of the files next to a pipeline file.
const TRAJECTORY: &str = "trajectory.csv";
const WANDER: &str = "wander.txt";
const PULSE_TIMES: &str = "pulses.txt";

impl FlightFiles {
    /// Checks that the pipeline file and any file that a fit may write next to it can be written. Call it
    /// before a fit, which takes long.
    ///
    /// # Errors
    /// [`vlscan_base::error::Error::Input`]: a file exists and `force` is not set, or is the recorded cloud.
    pub fn check(pipeline: &Path, cloud: &Path, force: bool) -> Result<()> {
        for path in FlightFiles::possible(pipeline) {
            refuse_unwritable(&path, force)?;
            refuse_input_of(&path, [cloud])?;
        }
        Ok(())
    }

    /// The pipeline file and all files that a fit may write next to it.
    fn possible(pipeline: &Path) -> [PathBuf; 4] {
        let beside = |extension: &str| pipeline.with_extension(extension);
        [pipeline.to_path_buf(), beside(TRAJECTORY), beside(WANDER), beside(PULSE_TIMES)]
    }

    /// All written files, the pipeline first.
    pub fn all(&self) -> impl Iterator<Item = &PathBuf> {
        [&self.pipeline, &self.trajectory].into_iter().chain(&self.wander).chain(&self.pulse_times)
    }
}

/// A file of times, s, a line each, which is written in parts.
fn written_times(path: &Path, force: bool, times: impl Iterator<Item = f64>) -> Result<FileWriter> {
    let mut file = FileWriter::create(path, force, Patched::Never)?;
    let mut text = String::new();
    for time in times {
        // Writing to a string does not fail.
        let _ = writeln!(text, "{time:.9}");
        if text.len() >= WRITTEN_BYTES {
            file.append(text.as_bytes())?;
            text.clear();
        }
    }
    file.append(text.as_bytes())?;
    Ok(file)
}

impl FlightFit {
    /// Writes the pipeline file at `path`, and next to it the trajectory and, if the pulse rate is not
    /// constant, the times of pulses. `command` is the command line that made it. With `force`, files of an
    /// earlier fit are replaced, and removed if this fit does not have them.
    ///
    /// # Errors
    /// [`vlscan_base::error::Error::Io`], after which none of the files is written; a file exists and `force`
    /// is not set.
    pub fn write(&self, path: &Path, command: &str, force: bool) -> Result<FlightFiles> {
        // Times of a file apply to all channels, but each channel was recorded at times of its own.
        let times = || self.rate.times(&self.solution, self.end());
        let has_times =
            self.has_pulse_times() && (2..=MAX_TIMES).contains(&times().take(MAX_TIMES + 1).count());
        let files = FlightFiles {
            pipeline: path.to_path_buf(),
            trajectory: path.with_extension(TRAJECTORY),
            wander: (self.solution.model.mirror == Mirror::Cone).then(|| path.with_extension(WANDER)),
            pulse_times: has_times.then(|| path.with_extension(PULSE_TIMES)),
            // The recording itself is often NAME.laz.
            simulated: free_name(&path.with_extension("laz"), "simulated", |path| path.exists()),
        };
        FlightFiles::check(path, &self.cloud, force)?;
        let mut group = FileGroup::default();
        group.write(&files.trajectory, force, self.trajectory().as_bytes())?;
        if let Some(path) = &files.wander {
            group.write(path, force, self.wander().as_bytes())?;
        }
        if let Some(path) = &files.pulse_times {
            group.add(written_times(path, force, times())?);
        }
        group.write(&files.pipeline, force, self.pipeline(&files, command).as_bytes())?;
        let is_old = |path: &PathBuf| force && files.all().all(|written| written != path);
        let possible = FlightFiles::possible(&files.pipeline);
        possible.iter().filter(|path| is_old(path)).for_each(|path| group.remove(path));
        group.commit()?;
        Ok(files)
    }

    /// True if the times of pulses depend on the mirror or the line, and may be written.
    pub(super) fn has_varying_rate(&self) -> bool {
        !self.rate.is_constant() && !self.solution.model.has_channels()
    }

    /// Time of the last pulse, s after the first.
    fn end(&self) -> f64 {
        self.recording.duration() + self.extend
    }

    /// Position of the platform, m; straight on after the recording.
    fn position(&self, time: f64) -> DVec3 {
        let model = &self.solution.model;
        let recorded = self.recording.duration().min(time);
        model.position(recorded) + (time - recorded) * model.parameters.velocity_at(recorded)
    }

    /// Deviation of a cone's mirror from even motion: seconds and degrees, a line each.
    fn wander(&self) -> String {
        let mut text = String::new();
        for (time, attitude) in self.solution.times.iter().zip(&self.solution.attitudes) {
            let _ = writeln!(text, "{time:.7} {:.7}", degrees(attitude.yaw));
        }
        if let Some(last) = self.solution.attitudes.last().filter(|_| self.extend > 0.0) {
            let _ = writeln!(text, "{:.7} {:.7}", self.end(), degrees(last.yaw));
        }
        text
    }

    /// Poses: GPS time, position, roll, pitch, heading (degrees), a line each.
    fn trajectory(&self) -> String {
        let (model, origin) = (&self.solution.model, self.recording.origin);
        let course = degrees(model.course());
        let is_cone = model.mirror == Mirror::Cone;
        let mut text = String::from("time,x,y,z,roll,pitch,heading\n");
        let mut times = vec![0.0];
        for time in self.solution.times.iter().copied().chain([self.recording.duration(), self.end()]) {
            if times.last().is_none_or(|last| time - last >= 1.0 / MAX_POSES_PER_S) {
                times.push(time);
            }
        }
        // The last pulse leaves before the last pose.
        times.push(self.end() + LAST_POSE);
        for time in times {
            let (place, attitude) = (self.position(time) + origin, self.solution.attitude(time));
            // The yaw of a cone is in the file of its mirror's wander.
            let yaw = if is_cone { 0.0 } else { attitude.yaw + model.parameters.mirror.yaw };
            let heading = (course + degrees(yaw)).rem_euclid(360.0);
            let angles = [degrees(attitude.roll), degrees(attitude.pitch), heading];
            let _ = writeln!(
                text,
                "{:.7},{:.4},{:.4},{:.4},{:.7},{:.7},{:.7}",
                self.recording.start + time,
                place.x,
                place.y,
                place.z,
                angles[0],
                angles[1],
                angles[2]
            );
        }
        text
    }
}
