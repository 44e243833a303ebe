//! A session: a survey with its scene and tree, ready to run.

use super::crs;
use super::emit::Emission;
use super::scene::LoadedScene;
use super::settings::Settings;
use crate::output::OutputRequest;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use vlscan_base::diag::{Diagnostics, Notice};
use vlscan_base::error::{Error, Result};
use vlscan_lidar::flight::FlightPlan;
use vlscan_lidar::platform::PoseReader;
use vlscan_scene::{Fallback, GroundModel, MotionPlan, Scene};
use vlscan_survey::{PlatformKind, Survey};
use vlscan_trace::{BuildOptions, Tree};
use vlscan_warehouse::Stop;

pub(super) type Observer = Arc<dyn Fn(Notice) + Send + Sync>;

/// A survey over its scene, ready to run: it is flown ([`Session::run`]), a stream of pulses is traced
/// instead ([`Session::trace`]), or a sample of it is measured to estimate the cost of a run
/// ([`Session::dry_run`]). A session can run many times.
///
/// The scene is a [`LoadedScene`], which several sessions can share.
///
/// ```
/// use vlscan_session::output::{LasVersion, OutputRequest, PointFormat, Target};
/// use vlscan_session::{Progress, RunContext, Session, Settings};
/// use vlscan_survey::{ReadOptions, read_survey};
/// use vlscan_warehouse::Stop;
///
/// # fn main() -> vlscan_base::Result<()> {
/// # let folder = tempfile::tempdir().unwrap();
/// # let points = folder.path().join("room.laz");
/// let (survey, _) = read_survey("../../fixtures/room/survey.xml".as_ref(), &ReadOptions::default())?;
/// let mut session = Session::open(Settings::new(survey), |notice| eprintln!("{notice:?}"))?;
/// let mut outputs = OutputRequest::default();
/// outputs.sinks = vec![(Target::File(points), PointFormat::Laz)];
/// outputs.cloud.las.version = LasVersion::V10;
/// // Other threads may read the progress and request the end of the run.
/// let (progress, stop) = (Progress::default(), Stop::new());
/// let report = session.run(outputs, RunContext::new(&progress, &stop))?;
/// assert!(report.summary.points > 0 && !report.interrupted);
/// # Ok(())
/// # }
/// ```
pub struct Session {
    settings: Settings,
    observer: Observer,
    /// The scene of the current epoch, with the tree over its static parts.
    scene: LoadedScene,
    motion: Option<MotionPlan>,
    /// All warnings and notes so far.
    warnings: Arc<Mutex<Diagnostics>>,
}

/// An observer that keeps warnings and notes, and passes everything on.
fn keeping(observer: impl Fn(Notice) + Send + Sync + 'static) -> (Observer, Arc<Mutex<Diagnostics>>) {
    let warnings = Arc::<Mutex<Diagnostics>>::default();
    let kept = warnings.clone();
    let keep = move |notice: Notice| {
        if let Notice::Warnings(found) = &notice {
            kept.lock().unwrap_or_else(PoisonError::into_inner).extend(found.clone());
        }
        observer(notice);
    };
    let observer: Observer = Arc::new(keep);
    (observer, warnings)
}

impl Session {
    /// Loads the scene of the first epoch and builds the tree over it. `observer` receives all notices of the
    /// session.
    ///
    /// # Errors
    /// [`Error::Input`] for settings outside of their [limits](Settings::check), and for scenes that are
    /// invalid or exceed the memory limit; [`Error::Io`].
    pub fn open(settings: Settings, observer: impl Fn(Notice) + Send + Sync + 'static) -> Result<Session> {
        let (observer, warnings) = keeping(observer);
        let scene = LoadedScene::of(&settings, &*observer)?;
        let session = Session::watched(settings, scene, observer, warnings)?;
        session.settings.load.check_stop()?;
        session.tree()?;
        Ok(session)
    }

    /// A session for a flight whose pulses are not traced: the memory of a tree over the scene does not
    /// count.
    ///
    /// # Errors
    /// As for [`Session::open`].
    pub fn open_for_flight(
        settings: Settings,
        observer: impl Fn(Notice) + Send + Sync + 'static,
    ) -> Result<Session> {
        settings.check()?;
        let (observer, warnings) = keeping(observer);
        let Settings { survey, load, tree, strict, .. } = &settings;
        let scene = LoadedScene::load_without_tree(&survey.scene, load, tree, *strict, &*observer)?;
        Session::watched(settings, scene, observer, warnings)
    }

    /// A session over a loaded scene, which must match the settings. The tree is built when it is needed
    /// first.
    ///
    /// # Errors
    /// [`Error::Input`] if the scene does not [suit](LoadedScene::suits) the settings, and for coordinate
    /// reference systems that contradict one another.
    pub fn new(
        settings: Settings,
        scene: LoadedScene,
        observer: impl Fn(Notice) + Send + Sync + 'static,
    ) -> Result<Session> {
        let (observer, warnings) = keeping(observer);
        Session::watched(settings, scene, observer, warnings)
    }

    /// [`Session::new`] with an observer that adds to `warnings`.
    fn watched(
        mut settings: Settings,
        scene: LoadedScene,
        observer: Observer,
        warnings: Arc<Mutex<Diagnostics>>,
    ) -> Result<Session> {
        settings.check()?;
        scene.check(&settings)?;
        let (found, note) = crs::adopt(&mut settings, scene.scene());
        observer(Notice::Warnings(found.finish(settings.strict)?));
        note.into_iter().for_each(|note| observer(Notice::Note(note)));
        let motion = plan_motion(&settings, scene.scene());
        if motion.is_some() {
            check_pulse_rate(&settings.survey)?;
        }
        let rate = first_pulse_rate(&settings);
        let found = vlscan_scene::check_time_step(scene.scene(), &settings.survey.scene.path, rate);
        observer(Notice::Warnings(found.finish(settings.strict)?));
        Ok(Session { settings, observer, scene, motion, warnings })
    }

    /// The scene and its tree, for further sessions; `None` in later epochs.
    pub fn loaded(&self) -> Option<LoadedScene> {
        (self.scene.epoch() == 0).then(|| self.scene.clone())
    }

    /// The survey.
    pub fn survey(&self) -> &Survey {
        &self.settings.survey
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The scene of the current epoch.
    pub fn scene(&self) -> &Scene {
        self.scene.scene()
    }

    /// The moving parts of the scene, if there are any.
    pub fn motion(&self) -> Option<&MotionPlan> {
        self.motion.as_ref()
    }

    /// Number of epochs: the survey is flown once for every state of the scene's swapped parts.
    pub fn epochs(&self) -> u32 {
        self.scene.epochs()
    }

    /// True if the scene reads files of spectra.
    pub(super) fn has_spectra(&self) -> bool {
        self.scene.conditions.has_spectra
    }

    /// The ground of the current epoch's scene.
    pub(super) fn ground(&self, fallback: Fallback) -> Result<GroundModel> {
        self.scene.ground(fallback, &*self.observer)
    }

    pub(super) fn observer(&self) -> &(dyn Fn(Notice) + Send + Sync) {
        &*self.observer
    }

    /// All warnings and notes so far.
    pub(super) fn warnings(&self) -> Diagnostics {
        self.warnings.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Time between updates of the moving scene, s: a number of pulse periods of the first leg. `None` for a
    /// scene without moving parts.
    pub fn scene_step_s(&self) -> Option<f64> {
        let steps = self.motion()?.update_interval();
        Some(steps as f64 / first_pulse_rate(&self.settings))
    }

    /// Passes a notice to the observer.
    pub(super) fn notify(&self, notice: Notice) {
        (self.observer)(notice);
    }

    /// Records everything that the outputs of a run in shards need, in addition to the settings.
    pub(super) fn record_for(&mut self, outputs: &OutputRequest) {
        self.settings.physics = self.settings.physics_for(outputs);
    }

    /// See [`LoadedScene::has_colours`].
    pub(super) fn has_colours(&self) -> bool {
        self.scene.has_colours()
    }

    /// Frees the tree, which is built again when it is needed.
    pub(super) fn drop_tree(&mut self) {
        self.scene.drop_tree();
    }

    /// Builds a tree over the current scene.
    ///
    /// # Errors
    /// [`Error::Input`] when it would exceed the memory limit.
    pub fn build_tree(&self, options: &BuildOptions) -> Result<Arc<Tree>> {
        self.scene.build_tree(options, &*self.observer)
    }

    /// Plans the flight over the current scene.
    ///
    /// # Errors
    /// [`Error::Input`] and [`Error::Limits`] for legs and trajectories that cannot be flown.
    pub fn plan_flight(&self) -> Result<FlightPlan> {
        let (flight, found) = self.plan_flight_quietly()?;
        (self.observer)(Notice::Warnings(found));
        Ok(flight)
    }

    /// [`Session::plan_flight`] with the warnings.
    pub(super) fn plan_flight_quietly(&self) -> Result<(FlightPlan, Diagnostics)> {
        let (settings, scene) = (&self.settings, self.scene());
        let ground = |x, y| scene.ground_height(x, y);
        let planned = FlightPlan::new(&settings.survey, scene.shift, &ground, &settings.flight);
        self.check_tiles()?;
        let (mut flight, found) = planned?;
        if self.epochs() == 1 {
            flight.leave_out_rest();
        }
        Ok((flight, found.finish(settings.strict)?))
    }

    /// Fails if the height of the ground, or a distance, is not known because a tile of the scene could not
    /// be loaded.
    pub(super) fn check_tiles(&self) -> Result<()> {
        self.scene().tiles.as_ref().map_or(Ok(()), |tiles| tiles.check())
    }

    /// Converts the session to the flight alone, for [`emit`](super::emit()). The scene, whose frame and
    /// ground the flight needs, is dropped.
    ///
    /// # Errors
    /// As for [`Session::plan_flight`]; a trajectory that cannot be opened.
    pub fn into_emission(self) -> Result<Emission> {
        let flight = self.plan_flight()?;
        let poses = self.open_poses()?;
        let Session { settings, scene, .. } = self;
        Ok(Emission {
            flight,
            shift: scene.scene().shift,
            epochs: scene.epochs(),
            poses,
            schedule: settings.schedule,
            survey: settings.survey,
        })
    }

    /// The files of survey and scene.
    pub fn inputs(&self) -> impl Iterator<Item = PathBuf> {
        let Survey { path, scene, platform, .. } = &self.settings.survey;
        let poses: Vec<&PathBuf> = match &platform.kind {
            PlatformKind::Interpolated(recorded) => {
                let files = recorded.files.iter().filter(|file| file.content.is_none());
                files.map(|file| &file.path).collect()
            }
            PlatformKind::Stream(stream) => vec![&stream.path],
            _ => Vec::new(),
        };
        [path, &scene.path]
            .into_iter()
            .chain(&self.scene().sources)
            .chain(self.scene.reads().files.keys())
            .chain(poses)
            .cloned()
    }

    /// Loads the scene of an epoch and builds its tree, unless they are loaded. Only one scene is in memory
    /// at a time.
    pub(super) fn enter_epoch(&mut self, epoch: u32, stop: &Stop) -> Result<()> {
        if epoch != self.scene.epoch() {
            self.scene.load_epoch(epoch, &self.settings, &*self.observer)?;
            self.motion = plan_motion(&self.settings, self.scene.scene());
        }
        self.tree()?;
        if stop.is_requested() { Err(Error::Interrupted) } else { Ok(()) }
    }

    /// The tree over the current scene, which is built when it is needed first.
    pub(super) fn tree(&self) -> Result<&Arc<Tree>> {
        self.scene.tree(&*self.observer)
    }

    /// Opens the live trajectory that the platform follows, if there is one.
    pub(super) fn open_poses(&self) -> Result<Option<PoseReader>> {
        let PlatformKind::Stream(stream) = &self.settings.survey.platform.kind else { return Ok(None) };
        if self.epochs() > 1 {
            return Err(Error::input(format!(
                "the scene's swaps need {} flights, but a stream of poses can be read only once",
                self.epochs()
            )));
        }
        let (observer, strict) = (self.observer.clone(), self.settings.strict);
        let reader = PoseReader::open(stream)?.with_max_latency(self.settings.max_latency);
        Ok(Some(reader.on_notice(strict, move |notice| observer(notice))))
    }
}

/// Plans the motions of a scene. Time steps count in pulse periods of the first leg.
fn plan_motion(settings: &Settings, scene: &Scene) -> Option<MotionPlan> {
    MotionPlan::new(scene, first_pulse_rate(settings))
}

/// Pulse rate of the first leg, Hz.
fn first_pulse_rate(settings: &Settings) -> f64 {
    settings.survey.legs.first().map_or(0.0, |leg| f64::from(leg.scanner.pulse_freq))
}

/// Moving parts need legs without pulse times.
fn check_pulse_rate(survey: &Survey) -> Result<()> {
    let mut timed = survey.legs.iter().filter_map(|leg| leg.scanner.pulse_times.as_ref());
    let Some(times) = timed.next() else { return Ok(()) };
    if survey.scanner.pulse_times.as_ref() == Some(times) {
        return Err(Error::input_with_help(
            format!(
                "moving parts of a scene need a constant pulse rate, but the pattern of the scanner `{}` has \
                 the times of its pulses",
                survey.scanner.id
            ),
            "give pulse_freq_hz in the settings of the scanner (each pulse takes the next row), or the scene \
             no moving parts",
        ));
    }
    Err(Error::input_with_help(
        "moving parts of a scene need a constant pulse rate, but a leg has pulse times",
        "give the legs pulse_freq_hz in place of pulse_times and pulse_intervals_us, or the scene no moving \
         parts",
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_survey::{PulseTimes, testkit};

    #[test]
    fn the_error_of_pulse_times_beside_moving_parts_names_their_source() {
        let mut survey = testkit::survey(vec![testkit::device()]);
        survey.legs = vec![testkit::leg(0, testkit::scanner_settings(1000))];
        assert!(check_pulse_rate(&survey).is_ok());
        let shown = |survey: &Survey| match check_pulse_rate(survey) {
            Err(Error::Input(found)) => found.text(),
            other => panic!("{other:?}"),
        };
        let times = PulseTimes::of_intervals(&[1e-3, 2e-3]);
        survey.legs[0].scanner.pulse_times = Some(times.clone());
        assert!(shown(&survey).contains("a leg has pulse times"), "{}", shown(&survey));
        survey.scanner.pulse_times = Some(times);
        assert!(shown(&survey).contains("the pattern of the scanner `"), "{}", shown(&survey));
        assert!(shown(&survey).contains("pulse_freq_hz in the settings"), "{}", shown(&survey));
    }
}
