//! The pipeline file of a fitted flight, its trajectory and its pulse times.

use super::mirror::Mirror;
use super::rate::MAX_LOST_SHARE;
use super::recording::median;
use super::{Figure, FlightFit};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use vlscan_base::error::Result;
use vlscan_base::files::reads::refuse_input_of;
use vlscan_base::files::{FileGroup, free_name, refuse_existing};
use vlscan_crs::{epsg, short_name, unit_problem};
use vlscan_geom::{DVec3, degrees};

/// More pulse times than this are not written: the file would be larger than what it is worth.
const MAX_TIMES: usize = 20_000_000;
/// Poses are written at most so many times per second.
const MAX_POSES_PER_S: f64 = 1000.0;
/// Reflectance of the target that is assumed to be seen at [`ASSUMED_RANGE`] times the greatest recorded
/// range.
const ASSUMED_REFLECTANCE: f64 = 0.1;
const ASSUMED_RANGE: f64 = 1.5;

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

/// Extensions of the files beside a pipeline file.
const TRAJECTORY: &str = "trajectory.csv";
const WANDER: &str = "wander.txt";
const PULSE_TIMES: &str = "pulses.txt";

impl FlightFiles {
    /// Checks that the pipeline file and any file that a fit may write beside it can be written: before a
    /// fit, which takes long.
    ///
    /// # Errors
    /// [`vlscan_base::error::Error::Input`]: a file exists and `force` is not set, or is the recorded cloud.
    pub fn check(pipeline: &Path, cloud: &Path, force: bool) -> Result<()> {
        for path in FlightFiles::possible(pipeline) {
            refuse_existing(&path, force)?;
            refuse_input_of(&path, [cloud])?;
        }
        Ok(())
    }

    /// The pipeline file and all that a fit may write beside it.
    fn possible(pipeline: &Path) -> [PathBuf; 4] {
        let beside = |extension: &str| pipeline.with_extension(extension);
        [pipeline.to_path_buf(), beside(TRAJECTORY), beside(WANDER), beside(PULSE_TIMES)]
    }

    /// All files, the pipeline first.
    pub fn all(&self) -> impl Iterator<Item = &PathBuf> {
        [&self.pipeline, &self.trajectory].into_iter().chain(&self.wander).chain(&self.pulse_times)
    }
}

impl FlightFit {
    /// Writes the pipeline file at `path`, and beside it the trajectory and, if the pulse rate is not
    /// constant, the times of pulses. `command` is the command line that made it. With `force`, files of an
    /// earlier fit are replaced, and those that this one does not have are removed.
    ///
    /// # Errors
    /// [`vlscan_base::error::Error::Io`], after which none of the files is written; a file exists and `force`
    /// is not set.
    pub fn write(&self, path: &Path, command: &str, force: bool) -> Result<FlightFiles> {
        // All channels fire at the times of a file, which are not those of the recorded parts of each
        // channel.
        let has_times = !self.rate.is_constant() && self.solution.model.senses.len() == 1;
        let times = match has_times {
            true => self.rate.times(&self.solution, self.end(), MAX_TIMES),
            false => None,
        };
        let files = FlightFiles {
            pipeline: path.to_path_buf(),
            trajectory: path.with_extension(TRAJECTORY),
            wander: (self.solution.model.mirror == Mirror::Cone).then(|| path.with_extension(WANDER)),
            pulse_times: times.is_some().then(|| path.with_extension(PULSE_TIMES)),
            // The recording itself is often NAME.laz.
            simulated: free_name(&path.with_extension("laz"), "simulated", |path| path.exists()),
        };
        FlightFiles::check(path, &self.cloud, force)?;
        let mut group = FileGroup::default();
        group.write(&files.trajectory, force, self.trajectory().as_bytes())?;
        if let Some(path) = &files.wander {
            group.write(path, force, self.wander().as_bytes())?;
        }
        if let (Some(path), Some(times)) = (&files.pulse_times, &times) {
            let mut text = String::with_capacity(times.len() * 12);
            // Writing to a string does not fail.
            times.iter().for_each(|time| _ = writeln!(text, "{time:.9}"));
            group.write(path, force, text.as_bytes())?;
        }
        group.write(&files.pipeline, force, self.pipeline(&files, command).as_bytes())?;
        let is_old = |path: &PathBuf| force && files.all().all(|own| own != path);
        let possible = FlightFiles::possible(&files.pipeline);
        possible.iter().filter(|path| is_old(path)).for_each(|path| group.remove(path));
        group.commit()?;
        Ok(files)
    }

    /// When the last pulse leaves, s after the first.
    fn end(&self) -> f64 {
        self.recording.duration() + self.extend
    }

    /// Position of the platform, m: after the recording straight on.
    fn position(&self, time: f64) -> DVec3 {
        let p = &self.solution.model.parameters;
        let recorded = self.recording.duration().min(time);
        let velocity = DVec3::new(p[2] + p[4] * recorded, p[3] + p[5] * recorded, p[7]);
        self.solution.model.position(recorded) + (time - recorded) * velocity
    }

    /// Deviation of a cone's mirror from even motion: seconds and degrees, a line each.
    fn wander(&self) -> String {
        let mut text = String::new();
        for (time, attitude) in self.solution.times.iter().zip(&self.solution.attitudes) {
            let _ = writeln!(text, "{time:.7} {:.7}", degrees(attitude[2]));
        }
        if let Some(last) = self.solution.attitudes.last().filter(|_| self.extend > 0.0) {
            let _ = writeln!(text, "{:.7} {:.7}", self.end(), degrees(last[2]));
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
        times.push(self.end() + 0.01);
        for time in times {
            let (place, attitude) = (self.position(time) + origin, self.solution.attitude(time));
            // A cone turns by its mirror, whose wander is a file of its own; lines are turned by the
            // platform.
            let yaw = if is_cone { 0.0 } else { attitude[2] + model.of_mirror()[3] };
            let heading = (course + degrees(yaw)).rem_euclid(360.0);
            let angles = [degrees(attitude[0]), degrees(attitude[1]), heading];
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

    fn pipeline(&self, files: &FlightFiles, command: &str) -> String {
        let model = &self.solution.model;
        let p = model.of_mirror();
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut out = String::new();
        let mut line = |text: String| _ = writeln!(out, "{text}");
        line(format!("# {}", command.replace(['\n', '\r'], " ")));
        line("#".to_owned());
        line("# Estimated, with standard deviations:".to_owned());
        for figure in self.figures() {
            line(format!("#   {}: {}", figure.name, Figure::text(&figure)));
        }
        line("#".to_owned());
        if files.wander.is_some() {
            line(
                "# A turn of the platform and one of the mirror look alike to a cone: both are in the \
                 mirror's wander."
                    .to_owned(),
            );
        }
        line(
            "# Not to be told from the points, and left to you: divergence, pulse length, energy, range \
             limits."
                .to_owned(),
        );
        line(String::new());
        line("# scene = \"scene.xml\"         # what is scanned; or vlscan run --scene".to_owned());
        if let Some(wkt) = &self.recording.wkt {
            let crs = epsg(wkt).map_or_else(|| wkt.clone(), |(_, code)| format!("EPSG:{code}"));
            match unit_problem(wkt) {
                None => line(format!("crs = {}", quoted(&crs))),
                // Readers convert lengths to metres.
                Some(problem) => {
                    line(format!("# no crs: that of the cloud is {}, but {problem}", short_name(wkt)))
                }
            }
        }
        line(format!("\n[trajectory]\npath = {}", quoted(&name(&files.trajectory))));
        line("\n[platform]\nkind = \"linear_path\"".to_owned());
        let (roll, pitch) = (degrees(model.parameters[8]), degrees(model.parameters[9]));
        let has_channels = model.senses.len() > 1;
        // Channels have tilts of their own: those of the scanner are in its mount.
        let of_scanner = match has_channels {
            true => format!(", {{ y = {roll:.6} }}, {{ x = {pitch:.6} }}"),
            false => String::new(),
        };
        line("# looking down, and across the flight".to_owned());
        line(format!(
            "mount = {{ offset_m = [0, 0, 0], rotate_deg = [{{ x = -90 }}, {{ z = -90 }}{of_scanner}] }}"
        ));
        line(format!("\n[scanner]\nid = \"fitted\"\noptics = \"{}\"", model.mirror.optics()));
        let rate = p[1].abs();
        let angle = match model.mirror {
            Mirror::Polygon => 0.5 * p[0].abs(),
            Mirror::Oscillating => self.half_angle(),
            Mirror::Cone | Mirror::EllipticCone => p[0].abs(),
        };
        line(format!("scan_angle_max_deg = {:.6}", degrees(angle)));
        if model.mirror == Mirror::EllipticCone {
            line(format!("scan_angle_along_max_deg = {:.6}", degrees(p[4].abs())));
        }
        line(format!("scan_freq_max_hz = {:.6}", rate.max(1.0)));
        if !has_channels {
            self.motion(0).into_iter().for_each(&mut line);
            // Roll and pitch of the scanner; the attitude of the trajectory is what changes.
            line(format!("scan_axis_tilt_deg = [{:.6}, {:.6}]", -roll, pitch));
        }
        if let Some(path) = &files.wander {
            line(format!("scan_wander = {}", quoted(&name(path))));
        }
        line(format!("pulse_freqs_hz = [{:.0}]", self.rate.mean));
        if let Some(noise) = self.noise {
            line("# with the roughness of the ground, which adds to it".to_owned());
            line(format!("accuracy_m = {noise:.4}"));
        }
        let farthest = self.farthest();
        line(format!(
            "# assumed: a target of this reflectance is seen from {ASSUMED_RANGE} times the largest recorded \
             distance, so that no pulse is lost"
        ));
        line(format!(
            "max_range = {{ range_m = {:.0}, reflectance = {ASSUMED_REFLECTANCE} }}",
            ASSUMED_RANGE * farthest
        ));
        line(format!("max_returns = {}", self.recording.pulses.iter().map(|p| p.returns).max().unwrap_or(1)));
        if self.rate.lost > 0.0 && self.rate.lost < MAX_LOST_SHARE {
            line(
                "# pulses without a point, between others; what reflects too little of a scene is not known"
                    .to_owned(),
            );
            line(format!("dropout_rate = {:.5}", self.rate.lost));
        }
        for number in (0..model.senses.len()).filter(|_| has_channels) {
            let channel = model.channel(number);
            line(format!("\n[[scanner.channel]]\nid = \"channel {}\"", number + 1));
            line("# forward or back, then about the vertical".to_owned());
            line(format!(
                "beam_origin = {{ rotate_deg = [{{ z = {:.6} }}, {{ y = {:.6} }}] }}",
                degrees(channel.pitch),
                degrees(channel.yaw)
            ));
            self.motion(number).into_iter().for_each(&mut line);
        }
        line(format!("\n[settings]\nscan_freq_hz = {rate:.6}"));
        if model.mirror == Mirror::Oscillating {
            line(format!("scan_angle_deg = {:.6}", degrees(angle)));
        }
        line(format!("pulse_freq_hz = {:.0}", self.rate.mean));
        if let Some(path) = &files.pulse_times {
            line(
                "# the rate changes with the place of the mirror, and from line to line; pulses elsewhere \
                 are not known"
                    .to_owned(),
            );
            line(format!("pulse_times = {}", quoted(&name(path))));
        } else if !self.rate.dither.is_empty() {
            line("# intervals that repeat".to_owned());
            let intervals =
                self.rate.dither.iter().map(|factor| format!("{:.6}", 1e6 * factor / self.rate.mean));
            line(format!("pulse_intervals_us = [{}]", intervals.collect::<Vec<_>>().join(", ")));
        }
        line(format!("\n[[output]]\npath = {}", quoted(&name(&files.simulated))));
        out
    }

    /// Keys of phase and sense of a channel's mirror.
    fn motion(&self, number: usize) -> Vec<String> {
        let model = &self.solution.model;
        let (p, channel) = (model.of_mirror(), model.channel(number));
        let phase = degrees(channel.phase);
        let angle = p[0] * channel.sense;
        let (phase, is_reversed) = match model.mirror {
            Mirror::EllipticCone => {
                // Of negative angles: turned by half a revolution, or the other way.
                let (across, phase) = if p[4] < 0.0 { (-p[0], phase + 180.0) } else { (p[0], phase) };
                let is_mirrored = across < 0.0;
                (if is_mirrored { -phase } else { phase } - 90.0, (p[1] < 0.0) != is_mirrored)
            }
            // The phase of a cone counts from the right, turned by the mount.
            Mirror::Cone => (phase - 90.0, p[1] < 0.0),
            // The phase of a polygon mirror is 0 in the middle of a line.
            Mirror::Polygon if angle < 0.0 => (180.0 - phase, true),
            Mirror::Polygon => (phase - 180.0, false),
            Mirror::Oscillating if angle < 0.0 => (phase + 180.0, false),
            Mirror::Oscillating => (phase, false),
        };
        let mut keys = vec![format!("scan_phase_deg = {:.5}", phase.rem_euclid(360.0))];
        if is_reversed {
            keys.push("scan_reverse = true".to_owned());
        }
        let tilts = model.facet_tilts();
        if !tilts.is_empty() {
            // The first pulse is of facet 0, whatever its number here.
            let turns = ((phase.rem_euclid(360.0) - phase) / 360.0).round() as i64;
            let count = tilts.len() as i64;
            let of = |facet: i64| if is_reversed { turns - facet } else { facet - turns };
            // Their tilts count towards the back, by the mount.
            let tilts = (0..count).map(|facet| {
                let tilt = -degrees(tilts[of(facet).rem_euclid(count) as usize]);
                format!("{tilt:.6}")
            });
            keys.push(format!("facet_tilts_deg = [{}]", tilts.collect::<Vec<_>>().join(", ")));
        }
        keys
    }

    /// Half angle of an oscillating mirror, rad. Between its turns, which take 50 pulses each and at most
    /// half of a sweep, it moves as evenly as one that turns at once would, but faster than that one with the
    /// same angle (docs/physics.md, kinematics).
    pub(super) fn half_angle(&self) -> f64 {
        const TURN: f64 = 50.0;
        let p = self.solution.model.of_mirror();
        let pulses_of_sweep = self.rate.mean / (2.0 * p[1].abs());
        p[0].abs() * (1.0 - (TURN / pulses_of_sweep).min(0.5))
    }

    /// Distance from the platform to the farthest points, m.
    fn farthest(&self) -> f64 {
        let pulses = &self.recording.pulses;
        let step = pulses.len().div_ceil(10_000).max(1);
        let distance = |i: usize| self.solution.model.position(pulses[i].time).distance(pulses[i].position);
        let distances: Vec<f64> = (0..pulses.len()).step_by(step).map(distance).collect();
        distances.iter().copied().fold(median(distances.clone()), f64::max)
    }
}

/// A string of TOML.
fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}
