//! Reads a trajectory from a file, a named pipe or standard input: turns bytes, as they arrive, into blocks
//! of poses.

use super::decoder::PoseDecoder;
use super::fix::{Fix, FixPlace, Pose, RecordError, RecordPlace};
use super::georeference::Georeference;
use super::sequence::{Checked, SequenceChecks};
use crate::platform::layout::PoseLayout;
use std::collections::VecDeque;
use std::f64::consts::{FRAC_PI_2, PI};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use vlscan_base::diag::{Diagnostics, Notice};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::number;
use vlscan_geom::UtmZone;
use vlscan_survey::{PoseStream, ProjectionGrid};
use vlscan_tables::input::{InputStream, ReadEvent, is_stdin};

/// Outcome of polling a reader of poses.
#[derive(Clone, Debug, PartialEq)]
pub enum PollResult {
    /// Poses arrived.
    Poses(Vec<Pose>),
    /// None arrived before the timeout.
    TimedOut,
    /// The stream is over.
    End,
}

/// An event that the observer of a trajectory receives.
#[derive(Clone, Copy, Debug)]
pub enum PoseEvent {
    /// The next pose, and its angles as written in text that states no unit for them.
    Pose(Pose, Option<[f64; 3]>),
    /// No more poses will follow.
    End,
}

/// Reason that no more poses can be read. Unlike [`Error`] it can be returned repeatedly.
enum Failure {
    Input(Box<Diagnostics>),
    Io(std::io::ErrorKind, String),
}

/// Time between checks for a stop while the first pose is awaited.
const STOP_CHECK_INTERVAL: Duration = Duration::from_millis(50);

const MAX_BLOCK_POSES: usize = 1024;

/// Reads a trajectory in any format. Times must ascend.
pub struct PoseReader {
    input: InputStream,
    path: PathBuf,
    /// `None` while it decodes.
    decoder: Option<PoseDecoder>,
    georeference: Georeference,
    checks: SequenceChecks,
    /// True if the UTM zone is detected from the first pose.
    zone_is_detected: bool,
    /// Options that say how text is read.
    text_options: Vec<&'static str>,
    /// Options that say how latitude and longitude are projected.
    geographic_options: Vec<&'static str>,
    bytes: u64,
    poses: u64,
    /// Poses that have not been returned yet.
    pending: VecDeque<Pose>,
    failure: Option<Failure>,
    ended: bool,
    strict: bool,
    notify: Box<dyn FnMut(Notice) + Send>,
    observe: Box<dyn FnMut(PoseEvent) -> Diagnostics + Send>,
    max_latency: Duration,
}

/// The names of options that are given.
fn given(options: &[(bool, &'static str)]) -> Vec<&'static str> {
    options.iter().filter(|(is_given, _)| *is_given).map(|(_, name)| *name).collect()
}

impl std::fmt::Debug for PoseReader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut debug = f.debug_struct("PoseReader");
        debug.field("path", &self.path).field("poses", &self.poses).finish_non_exhaustive()
    }
}

impl PoseReader {
    /// Opens the file, named pipe or (`-`) standard input of `settings`.
    ///
    /// # Errors
    /// The file cannot be opened, or the chosen columns are invalid.
    pub fn open(settings: &PoseStream) -> Result<PoseReader> {
        if let Some(Err(error)) = settings.columns.as_deref().map(PoseLayout::chosen) {
            return Err(Error::caused_by(format!("columns of the trajectory: {error}"), error));
        }
        let input = match &settings.content {
            Some(bytes) => InputStream::from_reader(std::io::Cursor::new(bytes.clone())),
            None => InputStream::open(&settings.path).map_err(|e| Error::open(&settings.path, e))?,
        };
        Ok(PoseReader::new(input, settings))
    }

    /// `settings.path` is the name of `input` in messages.
    pub fn new(input: InputStream, settings: &PoseStream) -> PoseReader {
        let stdin = is_stdin(&settings.path);
        let path = if stdin { PathBuf::from("<stdin>") } else { settings.path.clone() };
        PoseReader {
            input,
            decoder: Some(PoseDecoder::new(&path, settings)),
            path,
            georeference: Georeference::new(settings),
            checks: SequenceChecks::new(settings.max_gap),
            zone_is_detected: settings.grid == ProjectionGrid::FirstFix,
            text_options: given(&[
                (settings.columns.is_some(), "the columns of the trajectory"),
                (settings.separator.is_some(), "its separator"),
                (!settings.degrees, "the unit of its angles"),
                (settings.rotation.is_some(), "the meaning of its angles"),
            ]),
            geographic_options: given(&[(matches!(settings.grid, ProjectionGrid::Utm(_)), "the UTM zone")]),
            bytes: 0,
            poses: 0,
            pending: VecDeque::new(),
            failure: None,
            ended: false,
            strict: false,
            notify: Box::new(|_| ()),
            observe: Box::new(|_| Diagnostics::default()),
            max_latency: Duration::ZERO,
        }
    }

    /// This reader with a limit of the time that pulses may wait for further poses.
    pub fn with_max_latency(self, max_latency: Duration) -> PoseReader {
        PoseReader { max_latency, ..self }
    }

    /// This reader with `notify` called with every warning and note. With `strict` a warning is an error.
    pub fn on_notice(self, strict: bool, notify: impl FnMut(Notice) + Send + 'static) -> PoseReader {
        PoseReader { strict, notify: Box::new(notify), ..self }
    }

    /// This reader with `observe` called with every pose; the diagnostics that it returns are reported.
    pub fn on_pose(self, observe: impl FnMut(PoseEvent) -> Diagnostics + Send + 'static) -> PoseReader {
        PoseReader { observe: Box::new(observe), ..self }
    }

    /// How long pulses may wait for further poses.
    pub fn max_latency(&self) -> Duration {
        self.max_latency
    }

    /// Waits up to `timeout` for poses and returns those that have arrived, at most 1024.
    ///
    /// # Errors
    /// An invalid line or record, or a time that does not ascend, with its number; a trajectory that cannot
    /// be read or is empty. Poses before the error are returned first. Every later call returns the error
    /// again.
    pub fn poll(&mut self, timeout: Duration) -> Result<PollResult> {
        let until = Instant::now() + timeout;
        while self.pending.is_empty() && self.failure.is_none() && !self.ended {
            if !self.receive(until.saturating_duration_since(Instant::now())) {
                return Ok(PollResult::TimedOut);
            }
        }
        if !self.pending.is_empty() {
            let count = self.pending.len().min(MAX_BLOCK_POSES);
            return Ok(PollResult::Poses(self.pending.drain(..count).collect()));
        }
        self.ended = true;
        match &self.failure {
            Some(Failure::Input(problems)) => Err(Error::Input(problems.clone())),
            Some(Failure::Io(kind, text)) => {
                Err(Error::io("read", &self.path, std::io::Error::new(*kind, text.clone())))
            }
            None => Ok(PollResult::End),
        }
    }

    /// Waits for the first pose, unless `is_stopped`, and returns the UTM zone that it was projected to.
    pub fn first_zone(&mut self, is_stopped: &dyn Fn() -> bool) -> Option<UtmZone> {
        self.await_first(is_stopped);
        self.georeference.projected_zone()
    }

    /// Waits for the first pose, unless `is_stopped`, and returns its time in the trajectory's own scale, s.
    /// No pose may have been returned before.
    pub fn first_time(&mut self, is_stopped: &dyn Fn() -> bool) -> Option<f64> {
        self.await_first(is_stopped);
        self.pending.front().map(|pose| pose.time)
    }

    fn await_first(&mut self, is_stopped: &dyn Fn() -> bool) {
        while self.poses == 0 && self.failure.is_none() && !self.ended && !is_stopped() {
            self.receive(STOP_CHECK_INTERVAL);
        }
    }

    /// Processes the bytes of one read; returns `false` if none arrived before the timeout.
    fn receive(&mut self, timeout: Duration) -> bool {
        let Some(mut decoder) = self.decoder.take() else { return false };
        let mut has_arrived = true;
        match self.input.next(Some(timeout)) {
            ReadEvent::Bytes(read) => {
                self.bytes += read.len() as u64;
                decoder.feed(&read);
            }
            ReadEvent::Timeout => has_arrived = false,
            ReadEvent::End => self.ended = true,
            ReadEvent::Error(e) => self.failure = Some(Failure::Io(e.kind(), e.to_string())),
        }
        if has_arrived && self.failure.is_none() {
            let decoded = decoder.decode(self.ended, &mut |format, fix, place| {
                if let Err(error) = self.accept(format, &fix, &place) {
                    self.fail(&place, error);
                }
                if self.failure.is_none() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            });
            let remarks = decoder.take_remarks();
            if self.strict && remarks.is_fatal(true) {
                self.pending.clear();
            }
            self.report_found(remarks);
            self.keep_failure(decoded);
        }
        self.decoder = Some(decoder);
        if has_arrived && self.ended && self.failure.is_none() {
            self.finish();
        }
        has_arrived
    }

    fn keep_failure(&mut self, result: Result<()>) {
        if let Err(Error::Input(problems)) = result {
            self.failure = Some(Failure::Input(problems));
        }
    }

    fn accept(&mut self, format: &str, fix: &Fix, place: &RecordPlace) -> Result<(), RecordError> {
        let checked = self.checks.check(fix);
        let Checked { is_repeated, warning } =
            checked.map_err(|error| RecordError { is_of_time: true, ..error })?;
        if let Some(warning) = warning {
            self.warn(place, warning);
        }
        if is_repeated || self.failure.is_some() {
            return Ok(());
        }
        let pose = self.georeference.pose(fix)?;
        if self.poses == 0 {
            if let Some(warning) = radians_as_degrees(fix) {
                self.warn(place, warning);
            }
            if let Some(warning) = beyond_utm(fix) {
                self.warn(place, warning);
            }
            let is_geographic = matches!(fix.place, FixPlace::Geographic(_));
            self.warn_of_unused_options(format, place, is_geographic);
            self.describe_first(format, &pose, is_geographic);
        }
        if let Some(note) = self.checks.compare_heading(&pose) {
            (self.notify)(Notice::Note(format!("{}: {note}", self.path.display())));
        }
        self.report(PoseEvent::Pose(pose, fix.unitless_angles));
        self.poses += 1;
        self.pending.push_back(pose);
        Ok(())
    }

    /// Warns of options that have no effect on the format that was found.
    fn warn_of_unused_options(&mut self, format: &str, place: &RecordPlace, is_geographic: bool) {
        let is_text = matches!(place, RecordPlace::Row(..));
        let format = format!("in {format}, which states it by itself");
        let unused = [
            (std::mem::take(&mut self.text_options), is_text, format),
            (
                std::mem::take(&mut self.geographic_options),
                is_geographic,
                "on poses that have x and y: they are taken as they are".to_owned(),
            ),
        ];
        for (options, is_used, why) in unused {
            if !(options.is_empty() || is_used) {
                self.warn(place, RecordError::new(format!("without effect {why}: {}", options.join(", "))));
            }
        }
    }

    /// Reports how the first pose was interpreted.
    fn describe_first(&mut self, format: &str, pose: &Pose, geographic: bool) {
        let (path, p) = (self.path.display(), pose.position);
        if let Some(zone) = self.georeference.zone().filter(|_| self.zone_is_detected) {
            (self.notify)(Notice::Note(format!(
                "{path}: poses are projected to UTM zone {zone}, that of the first one; --utm-zone names \
                 another"
            )));
        }
        if geographic && self.georeference.height_offset() == 0.0 {
            (self.notify)(Notice::Note(format!(
                "{path}: heights are taken as they are, the first is {:.1} m; if they are ellipsoidal and \
                 the scene's are above a geoid, --height-offset shifts them",
                p.z
            )));
        }
        let heading = libm::atan2(pose.attitude.forward().x, pose.attitude.forward().y).to_degrees();
        (self.notify)(Notice::Detail(format!(
            "{path}: {format}; first pose at time {}, x {:.3}, y {:.3}, z {:.3}, heading {:.2}°",
            number(pose.time),
            p.x,
            p.y,
            p.z,
            heading.rem_euclid(360.0)
        )));
    }

    /// Calls the observer and reports the diagnostics that it returns.
    fn report(&mut self, event: PoseEvent) {
        let found = (self.observe)(event);
        self.report_found(found);
    }

    fn report_found(&mut self, found: Diagnostics) {
        if found.is_empty() {
            return;
        }
        match found.finish(self.strict) {
            Ok(warnings) => (self.notify)(Notice::Warnings(warnings)),
            failed => self.keep_failure(failed.map(drop)),
        }
    }

    fn finish(&mut self) {
        self.report(PoseEvent::End);
        if self.poses > 0 {
            let (poses, path) = (self.poses, self.path.display());
            return (self.notify)(Notice::Detail(format!("{path}: {poses} poses")));
        }
        let file = RecordPlace::File;
        if self.bytes == 0 {
            self.fail(&file, RecordError::new("the trajectory is empty, expected poses"));
        } else {
            self.warn(&file, RecordError::new("the trajectory holds 0 poses: nothing is flown"));
        }
    }

    fn warn(&mut self, place: &RecordPlace, error: RecordError) {
        if self.strict {
            self.fail(place, error);
        } else {
            (self.notify)(Notice::Warnings(place.warning(&self.path, error)));
        }
    }

    fn fail(&mut self, place: &RecordPlace, error: RecordError) {
        self.keep_failure(Err(place.error(&self.path, error)));
    }
}

/// Latitudes that UTM covers, degrees.
const UTM_LATITUDES: std::ops::RangeInclusive<f64> = -80.0..=84.0;

/// Warns of a place near a pole, where UTM is not defined.
fn beyond_utm(fix: &Fix) -> Option<RecordError> {
    let FixPlace::Geographic([latitude, ..]) = fix.place else { return None };
    let lat = latitude.to_degrees();
    (!UTM_LATITUDES.contains(&lat)).then(|| {
        RecordError::new(format!("latitude {lat}° is projected to UTM, which ends at 80° S and 84° N"))
            .help("project the trajectory to a polar system such as UPS, the scene's, and give x and y")
    })
}

/// Returns a warning for latitude and longitude of text that have no unit and look like radians. In degrees
/// they would lie in the Gulf of Guinea.
fn radians_as_degrees(fix: &Fix) -> Option<RecordError> {
    let FixPlace::Geographic([latitude, longitude, _]) = fix.place else { return None };
    let (lat, lon) = (latitude.to_degrees(), longitude.to_degrees());
    let looks_so = fix.unitless_angles.is_some() && lat.abs() <= FRAC_PI_2 && lon.abs() <= PI;
    looks_so.then(|| {
        RecordError::new(format!(
            "latitude {lat:.6} and longitude {lon:.6} are read as degrees but look like radians"
        ))
        .help("name their unit in the heading: lat[rad],lon[rad], or lat[deg],lon[deg] if they are degrees")
    })
}
