//! Scans from a scene and an instrument, for programs that have no survey file.

use super::batches::Batches;
use super::pass::RunContext;
use super::progress::Progress;
use super::run::Report;
use super::scene::LoadedScene;
use super::session::{Observer, Session};
use super::settings::Settings;
use crate::output::{OutputRequest, PointFormat, TableRequest, Target};
use ::arrow_array::RecordBatch;
use std::f64::consts::{PI, TAU};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan_base::diag::{Diagnostics, Notice};
use vlscan_base::error::{Error, Result};
use vlscan_geom::DVec3;
use vlscan_lidar::pulse::{Corrections, PhysicsProfile};
use vlscan_survey::{
    Leg, Mount, Platform, PlatformKind, PlatformNoise, PlatformSettings, PoseStream, Scanner,
    ScannerSettings, SceneRecipe, Survey,
};
use vlscan_tables::input::arrow::encode_stream;
use vlscan_warehouse::Stop;

/// A scan of a scene with an instrument: where the instrument stands or moves, how it is set, what is
/// written. It becomes a [`Session`] by [`Scan::session`], or points by [`Scan::run`] and [`Scan::batches`].
///
/// The physics is the refined one unless [`Scan::physics`] says otherwise, and the seed is 0: the same scan
/// gives the same points.
///
/// ```
/// use vlscan_survey::{Mesh, ReadOptions, find_scanner};
/// use vlscan_geom::DVec3;
/// use vlscan_session::Scan;
///
/// # fn main() -> vlscan_base::Result<()> {
/// # let folder = tempfile::tempdir().unwrap();
/// # let points = folder.path().join("floor.laz");
/// let corners = [[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
/// let floor = Mesh::new(corners.into(), vec![[0, 1, 2], [0, 2, 3]], Vec::new(), Vec::new())?;
/// let (scanner, _) = find_scanner("vlp16", &ReadOptions::default())?;
/// let report = Scan::new(floor, scanner)
///     .station(DVec3::new(0.0, 0.0, 1.5))
///     .configure(|settings| {
///         (settings.head_rate, settings.head_stop) = (20.0 * std::f64::consts::PI, std::f64::consts::TAU);
///     })
///     .output(&points)?
///     .run()?;
/// assert!(report.summary.points > 4_000);
/// # Ok(())
/// # }
/// ```
#[derive(Clone)]
#[must_use = "a scan does nothing until it is run"]
pub struct Scan {
    scene: SceneRecipe,
    loaded: Option<LoadedScene>,
    scanner: Scanner,
    platform: Option<Platform>,
    waypoints: Vec<PlatformSettings>,
    poses: Option<PoseStream>,
    scanner_settings: ScannerSettings,
    corrections: Corrections,
    seed: u64,
    threads: Option<usize>,
    is_strict: bool,
    outputs: OutputRequest,
    observer: Observer,
    /// The reason why the scan cannot be run, if an earlier call has failed.
    problem: Option<String>,
}

/// Maximum number of turns of a head that is not suspected of being written in degrees.
const MAX_TURNS: f64 = 10.0;

impl Scan {
    /// A scan of a scene, which is a [`Mesh`](vlscan_survey::Mesh) in memory or what
    /// [`read_scene`](vlscan_survey::read_scene) returns, with a scanner, which is one of the catalogue
    /// ([`find_scanner`](vlscan_survey::find_scanner)) or a custom one ([`Scanner::new`]). Scanners of the
    /// catalogue have the figures of HELIOS++'s catalogue unless
    /// [`Device::take_stated_figures`](vlscan_survey::Device::take_stated_figures) replaces them.
    pub fn new(scene: impl Into<SceneRecipe>, scanner: Scanner) -> Scan {
        Scan {
            scene: scene.into(),
            loaded: None,
            platform: None,
            waypoints: Vec::new(),
            poses: None,
            scanner_settings: ScannerSettings { active: true, ..scanner.own_settings() },
            scanner,
            corrections: PhysicsProfile::OF_PIPELINES.corrections(),
            seed: 0,
            threads: None,
            is_strict: false,
            outputs: OutputRequest::default(),
            observer: Arc::new(|_| ()),
            problem: None,
        }
    }

    /// Takes the scene from memory instead of loading it: that of an earlier scan, which [`Session::loaded`]
    /// returns.
    pub fn over(self, loaded: LoadedScene) -> Scan {
        Scan { loaded: Some(loaded), ..self }
    }

    /// Adds a position from which the scanner measures, world coordinates, m. It does so until its head has
    /// turned from `head_start` to `head_stop`, or for `max_duration`; see [`Scan::configure`].
    pub fn station(self, position: DVec3) -> Scan {
        self.through([position], 0.0)
    }

    /// Adds positions through which the platform moves in straight lines, world coordinates, m, at a speed in
    /// m/s, above 0. It measures from the first one to the last.
    pub fn path(mut self, positions: impl IntoIterator<Item = DVec3>, speed: f64) -> Scan {
        if !(speed.is_finite() && speed > 0.0) {
            let problem = || format!("a path at {speed} m/s: expected a speed above 0");
            self.problem.get_or_insert_with(problem);
        }
        self.through(positions, speed)
    }

    fn through(mut self, positions: impl IntoIterator<Item = DVec3>, speed: f64) -> Scan {
        let settings =
            |position| PlatformSettings { speed, has_speed: true, ..PlatformSettings::at(position) };
        self.waypoints.extend(positions.into_iter().map(settings));
        self
    }

    /// Follows recorded poses, of a file or of a stream, instead of stations and paths.
    pub fn trajectory(self, poses: PoseStream) -> Scan {
        Scan { poses: Some(poses), ..self }
    }

    /// Follows the poses of a table instead of stations and paths: columns time (s), x, y, z (m), roll,
    /// pitch, yaw (degrees, of a heading), as `--trajectory` reads them.
    ///
    /// # Errors
    /// [`Error::Input`] for a table that Arrow cannot encode; missing columns are an error of the run.
    pub fn poses(self, table: &RecordBatch) -> Result<Scan> {
        let content = encode_stream(&table.schema(), std::slice::from_ref(table))?;
        Ok(self.trajectory(PoseStream { content: Some(content.into()), ..PoseStream::at("<poses>") }))
    }

    /// Sets the platform of the scanner: its motion, the scanner's mount, its noise; see
    /// [`find_platform`](vlscan_survey::find_platform). Otherwise the axes of the scanner are those of the
    /// world at stations, and those of the motion along paths and trajectories.
    pub fn platform(self, platform: Platform) -> Scan {
        Scan { platform: Some(platform), ..self }
    }

    /// Changes the settings of the scanner: scan rate, angles, rotation of the head, duration. They begin as
    /// [`Scanner::own_settings`]. Angles are radians; [`ScannerSettings::set_head_turn_deg`] and its
    /// neighbours take degrees.
    pub fn configure(mut self, change: impl FnOnce(&mut ScannerSettings)) -> Scan {
        change(&mut self.scanner_settings);
        self
    }

    /// Chooses the physics: refined, or that of HELIOS++.
    pub fn physics(self, profile: PhysicsProfile) -> Scan {
        self.corrections(profile.corrections())
    }

    /// Chooses each departure from the physics of HELIOS++.
    pub fn corrections(self, corrections: Corrections) -> Scan {
        Scan { corrections, ..self }
    }

    /// Sets the seed of every random draw.
    pub fn seed(self, seed: u64) -> Scan {
        Scan { seed, ..self }
    }

    /// Sets the number of threads, at least 1; default: all of the machine. Points do not depend on it.
    pub fn threads(self, threads: usize) -> Scan {
        Scan { threads: Some(threads), ..self }
    }

    /// Makes errors of warnings.
    pub fn strict(self) -> Scan {
        Scan { is_strict: true, ..self }
    }

    /// Passes warnings and notes to `observer` as they occur; they are also in the
    /// [report](Report::warnings).
    pub fn observer(self, observer: impl Fn(Notice) + Send + Sync + 'static) -> Scan {
        Scan { observer: Arc::new(observer), ..self }
    }

    /// Adds a file of points, whose extension names the format.
    ///
    /// # Errors
    /// [`Error::Input`] for an extension that names none.
    pub fn output(self, path: impl AsRef<Path>) -> Result<Scan> {
        let path = path.as_ref();
        let format = PointFormat::required(path);
        let format = format.map_err(|unknown| Error::input(format!("{}: {unknown}", path.display())))?;
        Ok(self.sink(Target::File(path.to_path_buf()), format))
    }

    /// Adds an output of points.
    pub fn sink(mut self, target: Target, format: PointFormat) -> Scan {
        self.outputs.sinks.push((target, format));
        self
    }

    /// Adds a table of points, poses, pulses or waveforms, which takes record batches while the scan runs.
    pub fn table(mut self, table: TableRequest) -> Scan {
        self.outputs.tables.push(table);
        self
    }

    /// Changes everything else about the outputs: columns, settings of LAS, waveforms, tiles, whether files
    /// are replaced.
    pub fn outputs(mut self, change: impl FnOnce(&mut OutputRequest)) -> Scan {
        change(&mut self.outputs);
        self
    }

    /// The survey that the scan is.
    ///
    /// # Errors
    /// [`Error::Input`] without a station, a path or a trajectory, and for speeds and durations that are not
    /// above 0.
    pub fn survey(&self) -> Result<Survey> {
        if let Some(problem) = &self.problem {
            return Err(Error::input(problem.clone()));
        }
        if let Some(seconds) = self.scanner_settings.max_duration.filter(|s| s.is_nan() || *s <= 0.0) {
            return Err(Error::input(format!("max_duration is {seconds} s: expected more than 0")));
        }
        if self.waypoints.is_empty() && self.poses.is_none() {
            return Err(Error::input("a scan needs a station, a path or a trajectory"));
        }
        let is_moving = self.waypoints.iter().any(|waypoint| waypoint.speed > 0.0);
        let platform = self.platform.clone().unwrap_or_else(|| Platform {
            id: "platform".to_owned(),
            kind: if is_moving { PlatformKind::LinearPath } else { PlatformKind::Static },
            mount: Mount::IDENTITY,
            noise: PlatformNoise::default(),
        });
        let is_path = !matches!(platform.kind, PlatformKind::Static);
        let count = self.waypoints.len();
        let leg = |(number, platform): (usize, &PlatformSettings)| Leg {
            number: number as u32,
            strip: None,
            platform: platform.clone(),
            scanner: ScannerSettings {
                // A path ends at its last position.
                active: self.scanner_settings.active && !(is_path && number + 1 == count),
                ..self.scanner_settings.clone()
            },
            place: None,
        };
        let mut survey = Survey {
            name: "scan".to_owned(),
            path: PathBuf::new(),
            seed: Some(self.seed),
            platform,
            scanner: self.scanner.clone(),
            scene: self.scene.clone(),
            legs: self.waypoints.iter().enumerate().map(leg).collect(),
            leg_offset: None,
            crs_wkt: None,
        };
        if let Some(poses) = &self.poses {
            survey.legs = vec![Leg { scanner: self.scanner_settings.clone(), ..self.scanner.leg() }];
            survey.follow(poses.clone());
        }
        Ok(survey)
    }

    /// The settings of a session for the scan.
    ///
    /// # Errors
    /// As for [`Scan::survey`].
    pub fn settings(&self) -> Result<Settings> {
        let mut settings = Settings::new(self.survey()?);
        settings.set_seed(self.seed);
        settings.set_corrections(self.corrections);
        settings.set_flight_rules(true, PhysicsProfile::OF_PIPELINES);
        settings.strict = self.is_strict;
        settings.load.colours = self.outputs.records().colours;
        if let Some(threads) = self.threads {
            settings.set_threads(threads);
        }
        Ok(settings)
    }

    /// Angles that were hardly meant as radians.
    fn doubts(&self) -> Diagnostics {
        let mut found = Diagnostics::default();
        let ScannerSettings { head_rate, head_start, head_stop, scan_angle, .. } = self.scanner_settings;
        let turns = (head_stop - head_start).abs() / TAU;
        // Ten turns in degrees are a little more in radians.
        if head_rate != 0.0 && turns > MAX_TURNS * (1.0 + 1e-9) {
            let message = format!("head_stop is {head_stop} rad: the head makes {turns:.1} turns");
            found.warn(None, message).help("set_head_turn_deg takes degrees");
        }
        if scan_angle.abs() > PI {
            let message = format!("scan_angle is {scan_angle} rad, more than half a turn to each side");
            found.warn(None, message).help("set_scan_angle_deg takes degrees");
        }
        found
    }

    /// A session of the scan, and the outputs to run it with: for progress, for requests to stop, for several
    /// runs.
    ///
    /// # Errors
    /// As for [`Session::open`] and [`Scan::survey`].
    pub fn session(self) -> Result<(Session, OutputRequest)> {
        let settings = self.settings()?;
        let doubts = self.doubts().finish(self.is_strict)?;
        let Scan { loaded, poses, outputs, observer, .. } = self;
        let outputs = OutputRequest { live: poses.is_some(), ..outputs };
        let observer = move |notice| observer(notice);
        let session = match loaded {
            Some(loaded) => Session::new(settings, loaded, observer)?,
            None => Session::open(settings, observer)?,
        };
        if !doubts.is_empty() {
            session.notify(Notice::Warnings(doubts));
        }
        Ok((session, outputs))
    }

    /// Runs the scan.
    ///
    /// # Errors
    /// As for [`Scan::session`] and [`Session::run`]; [`Error::Input`] without an output.
    pub fn run(self) -> Result<Report> {
        self.survey()?;
        let OutputRequest { sinks, tables, trajectory, shard, .. } = &self.outputs;
        if sinks.is_empty() && tables.is_empty() && trajectory.is_none() && shard.is_none() {
            return Err(Error::input_with_help(
                "the scan has no output, so its points would be lost",
                "add one with Scan::output, Scan::sink or Scan::table, or take Scan::batches",
            ));
        }
        let (mut session, outputs) = self.session()?;
        session.run(outputs, RunContext::new(&Progress::default(), &Stop::new()))
    }

    /// Runs the scan on another thread and returns its points, `rows` at a time, while it runs.
    ///
    /// # Errors
    /// As for [`Scan::session`]; [`Error::Input`] for batches of 0 rows. Errors of the run are items of the
    /// iterator.
    pub fn batches(self, rows: usize) -> Result<Batches> {
        if rows == 0 {
            return Err(Error::input("batches of 0 rows: expected at least 1"));
        }
        let (session, outputs) = self.session()?;
        Ok(session.into_batches(outputs, rows))
    }
}

impl fmt::Debug for Scan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Scan")
            .field("scene", &self.scene.path)
            .field("scanner", &self.scanner.id)
            .field("waypoints", &self.waypoints.len())
            .field("outputs", &self.outputs)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests;
