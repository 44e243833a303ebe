//! A session: a survey with its scene and tree, ready to run.

use super::collector::Ended;
use super::crs;
use super::emit::Emission;
use super::fly::{fly, trace};
use super::heights::{Fallback, SceneGround};
use super::load::{build_tree, check_raster_memory, load_scene};
use super::pass::{Control, Pass};
use super::plausibility::{self, PoseCheck, YieldCheck};
use super::settings::Settings;
use super::stream::{LegRule, PulseSource, Tracing};
use crate::output::{FileSummary, Ground, OutputContext, OutputPlan, OutputRequest, Summary, Target, Writer};
use crate::streams::PulseReader;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;
use vlscan_base::diag::Notice;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{Reads, Recording};
use vlscan_base::machine;
use vlscan_lidar::flight::{FlightPlan, FlightState};
use vlscan_lidar::platform::PoseReader;
use vlscan_lidar::pulse::{Physics, PhysicsOptions};
use vlscan_scene::{Conditions, LoadOptions, MotionPlan, Scene, SceneFrame, Sharing};
use vlscan_survey::{PlatformKind, SceneRecipe, Survey};
use vlscan_trace::{BuildOptions, Tree};
use vlscan_warehouse::Stop;

pub(super) type Observer = Arc<dyn Fn(Notice) + Send + Sync>;

/// A survey with its scene.
///
/// ```
/// use vlscan::{Control, OutputRequest, PointFormat, Progress, ReadOptions, Session, Settings, Stop, Target, read_survey};
///
/// # fn main() -> vlscan::Result<()> {
/// # let folder = tempfile::tempdir().unwrap();
/// # let points = folder.path().join("room.laz");
/// let (survey, _) = read_survey("fixtures/room/survey.xml".as_ref(), &ReadOptions::default())?;
/// let mut session = Session::open(Settings::new(survey), |notice| eprintln!("{notice:?}"))?;
/// let outputs = OutputRequest { sinks: vec![(Target::File(points), PointFormat::Laz)], ..Default::default() };
/// let (progress, stop) = (Progress::default(), Stop::new());
/// let report = session.run(outputs, Control::new(&progress, &stop))?;
/// assert!(report.summary.points > 0 && !report.interrupted);
/// # Ok(())
/// # }
/// ```
pub struct Session {
    settings: Settings,
    observer: Observer,
    /// Number of epochs, and the epoch of `scene` and `tree`.
    epochs: u32,
    epoch: u32,
    /// The frame of the first epoch's scene.
    frame: SceneFrame,
    scene: Arc<Scene>,
    motion: Option<MotionPlan>,
    /// The tree over the static parts.
    tree: Option<Arc<Tree>>,
    /// The settings that the first epoch's scene depends on.
    conditions: Conditions,
    /// What was read when the first epoch's scene was loaded.
    reads: Arc<Reads>,
}

/// The scene of the first epoch and the tree over it, which further sessions can share.
#[derive(Clone)]
pub struct LoadedScene {
    scene: Arc<Scene>,
    tree: Arc<Tree>,
    conditions: Conditions,
    sharing: Sharing,
    trees: BuildOptions,
    epochs: u32,
    reads: Arc<Reads>,
}

impl LoadedScene {
    /// Loads the scene of the first epoch and builds the tree over it, before there is a survey of it; sessions with equal options
    /// are opened over it by [`Session::open_loaded`]. Warnings are errors if it `is_strict`.
    ///
    /// # Errors
    /// As for [`Session::open`].
    pub fn load(
        recipe: &SceneRecipe,
        options: &LoadOptions,
        trees: BuildOptions,
        is_strict: bool,
        notify: &dyn Fn(Notice),
    ) -> Result<LoadedScene> {
        check_raster_memory(recipe, trees.builder, options.max_memory, notify)?;
        let FirstScene { scene, conditions, epochs, reads } =
            FirstScene::load(recipe, options, is_strict, notify)?;
        let tree = build_tree(&trees, options.max_memory, &scene, notify)?;
        Ok(LoadedScene { scene, tree, conditions, sharing: options.sharing, trees, epochs, reads })
    }

    /// The ground of the scene; `fallback` is what counts where no material is ground.
    pub fn ground(&self, fallback: Fallback) -> SceneGround {
        SceneGround::new(self.scene.clone(), self.tree.clone(), fallback)
    }

    /// What was read when the scene was loaded.
    pub fn reads(&self) -> &Reads {
        &self.reads
    }

    pub(super) fn scene(&self) -> &Scene {
        &self.scene
    }

    pub(super) fn tree(&self) -> &Tree {
        &self.tree
    }
}

impl std::fmt::Debug for LoadedScene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LoadedScene").field("epochs", &self.epochs).finish_non_exhaustive()
    }
}

/// The scene of the first epoch without a tree, and what it was loaded from.
struct FirstScene {
    scene: Arc<Scene>,
    conditions: Conditions,
    epochs: u32,
    reads: Arc<Reads>,
}

impl FirstScene {
    fn load(
        recipe: &SceneRecipe,
        options: &LoadOptions,
        is_strict: bool,
        notify: &dyn Fn(Notice),
    ) -> Result<FirstScene> {
        machine::start_pool()?;
        let recording = Recording::start();
        let epochs = vlscan_scene::count_epochs(recipe)?;
        let scene = Arc::new(load_scene(recipe, options, is_strict, (0, None), notify)?);
        let reads = Arc::new(recording.reads());
        let mut conditions = Conditions::of(recipe, options);
        conditions.add(&scene);
        Ok(FirstScene { scene, conditions, epochs, reads })
    }
}

/// Result of a run.
#[derive(Clone, Debug)]
pub struct Report {
    /// Summary of the outputs.
    pub summary: Summary,
    /// Pulses emitted.
    pub pulses: u64,
    /// Time from the first pulse to the last point written, without the loading of later epochs, s.
    pub seconds: f64,
    /// Whether the run was stopped: the outputs contain what was measured until then, and say so.
    pub interrupted: bool,
}

/// The epochs of a run, and how each is measured.
pub(super) struct Epochs {
    pub range: RangeInclusive<u32>,
    pub options: PhysicsOptions,
    /// Whether too few points are reported.
    pub is_checked: bool,
}

impl Session {
    /// Loads the scene of the first epoch and builds the tree over it. `observer` receives all notices of the
    /// session.
    ///
    /// # Errors
    /// [`Error::Input`] for scenes that are invalid or exceed the memory limit; [`Error::Io`].
    pub fn open(settings: Settings, observer: impl Fn(Notice) + Send + Sync + 'static) -> Result<Session> {
        let mut session = Session::open_without_tree(settings, observer)?;
        session.settings.load.check_stop()?;
        session.tree = Some(session.build_tree(&session.settings.tree)?);
        Ok(session)
    }

    /// As [`Session::open`]; the tree is built when it is needed first.
    ///
    /// # Errors
    /// As for [`Session::open`].
    pub fn open_without_tree(
        settings: Settings,
        observer: impl Fn(Notice) + Send + Sync + 'static,
    ) -> Result<Session> {
        let Settings { survey, tree, load, .. } = &settings;
        check_raster_memory(&survey.scene, tree.builder, load.max_memory, &observer)?;
        Session::open_scene(settings, observer)
    }

    /// Loads the scene of the first epoch without building a tree: for flights without tracing, and for other kinds
    /// of trees.
    ///
    /// # Errors
    /// As for [`Session::open`].
    pub fn open_scene(
        settings: Settings,
        observer: impl Fn(Notice) + Send + Sync + 'static,
    ) -> Result<Session> {
        let FirstScene { scene, conditions, epochs, reads } =
            FirstScene::load(&settings.survey.scene, &settings.load, settings.strict, &observer)?;
        Session::over(settings, Arc::new(observer), epochs, (scene, None), conditions, reads)
    }

    /// Opens a session over a scene that is loaded already. `None` if the settings ask for another one: for spectra at
    /// another wavelength, other random materials, another tree. The scene that the settings describe must be the loaded
    /// one.
    ///
    /// # Errors
    /// [`Error::Input`] for coordinate reference systems that contradict one another.
    pub fn open_loaded(
        settings: Settings,
        loaded: &LoadedScene,
        observer: impl Fn(Notice) + Send + Sync + 'static,
    ) -> Result<Option<Session>> {
        let LoadedScene { scene, tree, conditions, sharing, trees, epochs, reads } = loaded;
        let jobs = (settings.tree.jobs, settings.tree.geometry_jobs);
        let trees = BuildOptions { jobs: jobs.0, geometry_jobs: jobs.1, ..*trees };
        if conditions.check(&settings.load).is_err()
            || *sharing != settings.load.sharing
            || trees != settings.tree
        {
            return Ok(None);
        }
        let scene = (scene.clone(), Some(tree.clone()));
        let (observer, reads) = (Arc::new(observer), reads.clone());
        Session::over(settings, observer, *epochs, scene, conditions.clone(), reads).map(Some)
    }

    fn over(
        mut settings: Settings,
        observer: Observer,
        epochs: u32,
        (scene, tree): (Arc<Scene>, Option<Arc<Tree>>),
        conditions: Conditions,
        reads: Arc<Reads>,
    ) -> Result<Session> {
        let (found, note) = crs::adopt(&mut settings, &scene);
        observer(Notice::Warnings(found.finish(settings.strict)?));
        note.into_iter().for_each(|note| observer(Notice::Note(note)));
        let frame = SceneFrame::of(&scene);
        let motion = plan_motion(&settings, &scene);
        let rate = first_pulse_rate(&settings);
        let found = vlscan_scene::check_time_step(&scene, &settings.survey.scene.path, rate);
        observer(Notice::Warnings(found.finish(settings.strict)?));
        Ok(Session { settings, observer, epochs, epoch: 0, frame, scene, motion, tree, conditions, reads })
    }

    /// The scene and its tree, for further sessions; `None` before the tree is built and in later epochs.
    pub fn loaded(&self) -> Option<LoadedScene> {
        let tree = self.tree.as_ref().filter(|_| self.epoch == 0)?;
        Some(LoadedScene {
            scene: self.scene.clone(),
            tree: tree.clone(),
            conditions: self.conditions.clone(),
            sharing: self.settings.load.sharing,
            trees: self.settings.tree.clone(),
            epochs: self.epochs,
            reads: self.reads.clone(),
        })
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
        &self.scene
    }

    /// The moving parts of the scene, if there are any.
    pub fn motion(&self) -> Option<&MotionPlan> {
        self.motion.as_ref()
    }

    /// Number of epochs: the survey is flown once for every state of the scene's swapped parts.
    pub fn epochs(&self) -> u32 {
        self.epochs
    }

    /// Passes a notice to the observer.
    pub(super) fn notify(&self, notice: Notice) {
        (self.observer)(notice);
    }

    /// Records everything that the outputs need.
    pub(super) fn record_for(&mut self, outputs: &OutputRequest) {
        self.settings.physics = self.settings.physics_for(outputs);
    }

    /// Frees the tree, which is built again when it is needed.
    pub(super) fn drop_tree(&mut self) {
        self.tree = None;
    }

    /// Builds a tree over the current scene.
    ///
    /// # Errors
    /// [`Error::Input`] when it would exceed the memory limit.
    pub fn build_tree(&self, options: &BuildOptions) -> Result<Arc<Tree>> {
        build_tree(options, self.settings.load.max_memory, &self.scene, &*self.observer)
    }

    /// Plans the flight over the current scene.
    ///
    /// # Errors
    /// [`Error::Input`] and [`Error::Limits`] for legs and trajectories that cannot be flown.
    pub fn plan_flight(&self) -> Result<FlightPlan> {
        let Session { settings, scene, .. } = self;
        let ground = |x, y| scene.ground_height(x, y);
        let (flight, found) = FlightPlan::new(&settings.survey, scene.shift, &ground, &settings.flight)?;
        (self.observer)(Notice::Warnings(found.finish(settings.strict)?));
        Ok(flight)
    }

    /// Flies and measures the survey, once per epoch.
    ///
    /// # Errors
    /// [`Error::Input`] for flights or outputs that are impossible, [`Error::Io`], [`Error::ClosedPipe`], and
    /// [`Error::Interrupted`] when a stop is requested before the first pulse or between two epochs.
    pub fn run(&mut self, outputs: OutputRequest, control: Control<'_>) -> Result<Report> {
        control.stop.begin_run();
        self.fly(outputs, control)
    }

    fn fly(&mut self, outputs: OutputRequest, control: Control<'_>) -> Result<Report> {
        self.enter_epoch(0, control.stop)?;
        let flight = self.plan_flight()?;
        let Session { settings, scene, .. } = &*self;
        if let Some(note) = plausibility::describe_idle_mirror(&settings.survey) {
            (self.observer)(Notice::Note(note));
        }
        self.check_instrument()?;
        let found = plausibility::check_flight(&settings.survey, scene, self.tree()?, &flight);
        let found = found.finish(settings.strict)?;
        let is_reported = Arc::new(AtomicBool::new(!found.is_empty()));
        (self.observer)(Notice::Warnings(found));
        let mut poses = self.open_poses()?;
        if let PlatformKind::Stream(stream) = &settings.survey.platform.kind {
            let bounds = scene.bounds.translated(scene.shift);
            let mut check = PoseCheck::new(stream, bounds, is_reported.clone());
            poses = poses.map(|poses| poses.on_pose(move |seen| check.add(seen)));
        }
        let mut state = FlightState::start(&flight);
        let mut context = self.output_context();
        if context.crs.is_none() && outputs.sinks.iter().any(|(_, format)| format.holds_crs()) {
            // Mistakes in the outputs are reported before the first pose is waited for.
            OutputPlan::new(OutputRequest { epochs: self.epochs, ..outputs.clone() }, &context)?;
            context.crs = crs::of_flight(&flight, poses.as_mut(), control.stop);
        }
        let (output, epochs) = self.plan_outputs(outputs, &context)?;
        self.run_epochs(output, epochs, control, &is_reported, |_, pass, epoch, writer| {
            if epoch > 0 {
                state.repeat(&flight);
            }
            fly(pass, &flight, &mut state, poses.take(), u64::MAX, writer)
        })
    }

    /// What outputs depend on.
    pub(super) fn output_context(&self) -> OutputContext {
        let two_way = self.settings.physics.corrections.two_way_time;
        OutputContext::new(self.survey(), self.scene()).with_times(two_way)
    }

    /// Warns of settings of the instrument that the physics passes over or replaces.
    pub(super) fn check_instrument(&self) -> Result<()> {
        let Settings { survey, physics, strict, .. } = &self.settings;
        let mut found = plausibility::check_instrument(survey, &physics.corrections);
        if self.conditions.has_spectra {
            found.extend(plausibility::check_wavelengths(survey));
        }
        (self.observer)(Notice::Warnings(found.finish(*strict)?));
        Ok(())
    }

    /// Traces a stream of pulses through the scene instead of flying the survey.
    ///
    /// # Errors
    /// As for [`Session::run`]; [`Error::Input`] for malformed rows, with their line.
    pub fn trace(
        &mut self,
        pulses: PulseReader,
        legs: LegRule,
        outputs: OutputRequest,
        control: Control<'_>,
    ) -> Result<Report> {
        control.stop.begin_run();
        self.trace_stream(pulses, legs, outputs, control)
    }

    fn trace_stream(
        &mut self,
        pulses: PulseReader,
        legs: LegRule,
        outputs: OutputRequest,
        control: Control<'_>,
    ) -> Result<Report> {
        let mut source = PulseSource::new(pulses);
        self.check_instrument()?;
        self.enter_epoch(0, control.stop)?;
        let context = self.output_context();
        let (output, epochs) = self.plan_outputs(outputs, &context)?;
        let options = epochs.options;
        let is_reported = AtomicBool::new(false);
        self.run_epochs(output, epochs, control, &is_reported, |session, pass, epoch, writer| {
            let tracing = Tracing { survey: session.survey(), options, shift: session.scene.shift, legs };
            trace(pass, &tracing, &mut source, epoch, writer)
        })
    }

    /// Converts the session to the flight alone, for [`emit`](super::emit()). The scene, whose frame and ground the
    /// flight needs, is dropped.
    ///
    /// # Errors
    /// As for [`Session::plan_flight`]; a trajectory that cannot be opened.
    pub fn into_emission(self) -> Result<Emission> {
        let flight = self.plan_flight()?;
        let poses = self.open_poses()?;
        let Session { settings, epochs, scene, .. } = self;
        Ok(Emission {
            flight,
            shift: scene.shift,
            epochs,
            poses,
            schedule: settings.schedule,
            survey: settings.survey,
        })
    }

    /// Plans the outputs of all epochs over the scene of the first.
    fn plan_outputs(
        &self,
        outputs: OutputRequest,
        context: &OutputContext,
    ) -> Result<(Arc<OutputPlan>, Epochs)> {
        let options = self.settings.physics_for(&outputs);
        let inputs = self.inputs().chain(outputs.inputs.iter().cloned()).collect();
        let is_joined = |target: &Target| !matches!(target, Target::Helios(_));
        if self.epochs > 1 && outputs.sinks.iter().any(|(target, _)| is_joined(target)) {
            self.notify(Notice::Note(format!(
                "the scene's swaps make {} flights, whose points follow each other in the same files, each from the same time on; \
                 --output DIR writes a folder for each",
                self.epochs
            )));
        }
        if let Some(lack) = crs::lack_of_crs(&outputs, context) {
            self.notify(Notice::Note(lack));
        }
        let output = OutputPlan::new(OutputRequest { epochs: self.epochs, inputs, ..outputs }, context)?;
        self.notify(Notice::Warnings(output.warnings().clone().finish(self.settings.strict)?));
        Ok((Arc::new(output), Epochs { range: 0..=self.epochs - 1, options, is_checked: true }))
    }

    /// The files of survey and scene.
    pub fn inputs(&self) -> impl Iterator<Item = PathBuf> {
        let Survey { path, scene, platform, .. } = &self.settings.survey;
        let poses: Vec<&PathBuf> = match &platform.kind {
            PlatformKind::Interpolated(recorded) => recorded.files.iter().map(|file| &file.path).collect(),
            PlatformKind::Stream(stream) => vec![&stream.path],
            _ => Vec::new(),
        };
        [path, &scene.path]
            .into_iter()
            .chain(&self.scene.sources)
            .chain(self.reads.files.keys())
            .chain(poses)
            .cloned()
    }

    /// Runs epochs; outputs continue from one to the next. `is_reported` records whether the cause of too few points has
    /// been reported.
    pub(super) fn run_epochs(
        &mut self,
        output: Arc<OutputPlan>,
        epochs: Epochs,
        control: Control<'_>,
        is_reported: &AtomicBool,
        pass_over: impl FnMut(&Session, &Pass<'_>, u32, Option<Box<Writer>>) -> Result<Ended>,
    ) -> Result<Report> {
        let ended = self.pass_epochs(&output, epochs, control, is_reported, pass_over);
        ended.map_err(|e| self.with_rescued(e, &output.rescued()))
    }

    fn pass_epochs(
        &mut self,
        output: &Arc<OutputPlan>,
        epochs: Epochs,
        control: Control<'_>,
        is_reported: &AtomicBool,
        mut pass_over: impl FnMut(&Session, &Pass<'_>, u32, Option<Box<Writer>>) -> Result<Ended>,
    ) -> Result<Report> {
        let Epochs { range, options, is_checked } = epochs;
        let (mut epoch, mut seconds, mut writer) = (*range.start(), 0.0, None);
        let (summary, interrupted) = loop {
            self.enter_epoch(epoch, control.stop)?;
            let Session { settings, observer, scene, motion, .. } = &*self;
            let tree = self.shared_tree()?;
            let physics = Physics::new(scene, tree, &settings.survey, options)?;
            let pass = Pass {
                physics: &physics,
                motion: motion.as_ref(),
                trees: &settings.tree,
                output: output.clone(),
                ground: output.has_heights().then(|| {
                    let (scene, tree) = (scene.clone(), tree.clone());
                    Arc::new(SceneGround::new(scene, tree, Fallback::Lowest)) as Arc<dyn Ground>
                }),
                schedule: settings.schedule,
                control,
                target: plausibility::target(&settings.survey, scene),
                check: is_checked.then_some(YieldCheck {
                    settings,
                    scene,
                    tree,
                    is_reported,
                    observer: &**observer,
                }),
                epoch,
                is_last: epoch == *range.end(),
            };
            let started = Instant::now();
            let ended = pass_over(self, &pass, epoch, writer.take()).and_then(|ended| match ended {
                Ended::Complete(summary) => Ok(Ok((summary, false))),
                Ended::Interrupted(writer) => Ok(Ok((writer.finish_partial()?, true))),
                Ended::NextEpoch(writer) => Ok(Err(writer)),
            });
            seconds += started.elapsed().as_secs_f64();
            match ended? {
                Ok(complete) => break complete,
                Err(open) => writer = Some(open),
            }
            epoch += 1;
            (self.observer)(Notice::Detail(format!("epoch {} of {}", epoch + 1, self.epochs)));
        };
        for file in summary.files.iter().filter(|file| file.beside.is_some()) {
            (self.observer)(Notice::Note(what_is_kept(file)));
        }
        let pulses = control.progress.snapshot().pulses;
        Ok(Report { summary, pulses, seconds, interrupted })
    }

    /// Loads the scene of an epoch and builds its tree, unless they are loaded. Only one scene is in memory at a
    /// time.
    pub(super) fn enter_epoch(&mut self, epoch: u32, stop: &Stop) -> Result<()> {
        if epoch != self.epoch {
            self.tree = None;
            self.scene = Arc::default();
            let Settings { survey, load, strict, .. } = &self.settings;
            let later = (epoch, Some(self.frame));
            self.scene = Arc::new(load_scene(&survey.scene, load, *strict, later, &*self.observer)?);
            self.motion = plan_motion(&self.settings, &self.scene);
            self.epoch = epoch;
        }
        if self.tree.is_none() {
            self.tree = Some(self.build_tree(&self.settings.tree)?);
        }
        if stop.is_requested() { Err(Error::Interrupted) } else { Ok(()) }
    }

    pub(super) fn tree(&self) -> Result<&Tree> {
        self.shared_tree().map(|tree| &**tree)
    }

    fn shared_tree(&self) -> Result<&Arc<Tree>> {
        self.tree.as_ref().ok_or_else(|| Error::Internal("there is no tree over the scene".to_owned()))
    }

    /// Opens the live trajectory that the platform follows, if there is one.
    pub(super) fn open_poses(&self) -> Result<Option<PoseReader>> {
        let PlatformKind::Stream(stream) = &self.settings.survey.platform.kind else { return Ok(None) };
        if self.epochs > 1 {
            return Err(Error::input(format!(
                "the scene's swaps ask for {} flights, and a stream of poses passes only once",
                self.epochs
            )));
        }
        let (observer, strict) = (self.observer.clone(), self.settings.strict);
        let reader = PoseReader::open(stream)?.with_max_latency(self.settings.max_latency);
        Ok(Some(reader.on_notice(strict, move |notice| observer(notice))))
    }

    /// Adds to the error of a failed run where its partial outputs are.
    fn with_rescued(&self, mut error: Error, files: &[FileSummary]) -> Error {
        for file in files.iter().filter(|file| file.path.is_some()) {
            let kept = what_is_kept(file);
            match &mut error {
                Error::Input(problems) | Error::Limits(problems) => {
                    problems.note(None, kept);
                }
                _ => (self.observer)(Notice::Note(kept)),
            }
        }
        error
    }
}

/// Describes where a partial output is, and that it did not replace the file of an earlier run.
fn what_is_kept(file: &FileSummary) -> String {
    let path = file.path.as_deref().unwrap_or(Path::new("standard output"));
    let new = format!("what was measured until then is in {}", path.display());
    match &file.beside {
        Some(old) => format!("{} is kept as it was; {new}", old.display()),
        None => new,
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
