//! Runs of a session: a flight or a stream of pulses is measured over one epoch after the other.

use super::collector::Ended;
use super::crs;
use super::fly::{fly, trace};
use super::load::describe_tiles;
use super::pass::{Pass, RunContext};
use super::plausibility::{self, PoseCheck, YieldCheck};
use super::prefetch::Prefetcher;
use super::session::Session;
use super::settings::Settings;
use super::stream::{LegRule, PulseSource, Tracing};
use crate::output::{
    CheckedOutputs, FileSummary, OutputContext, OutputPlan, OutputRequest, OutputSummary, TableContent,
    Target, Writer,
};
use crate::streams::PulseReader;
use std::collections::BTreeSet;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;
use vlscan_base::diag::{Diagnostics, Notice};
use vlscan_base::error::{Error, Result};
use vlscan_geom::HeightModel;
use vlscan_lidar::flight::{FlightPlan, FlightState};
use vlscan_lidar::pulse::{Physics, PhysicsOptions};
use vlscan_scene::Fallback;
use vlscan_survey::PlatformKind;
use vlscan_warehouse::Stop;

/// Result of a run.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Report {
    /// Summary of the outputs.
    pub summary: OutputSummary,
    /// Pulses emitted.
    pub pulses: u64,
    /// Time from the first pulse to the last point written, without the loading of later epochs, s.
    pub seconds: f64,
    /// True if the run was stopped: the outputs contain the points until then, and are marked as partial.
    pub interrupted: bool,
    /// All warnings of the session so far, with or without an observer: of loading its scene and of its runs.
    pub warnings: Diagnostics,
}

/// The epochs of a run, and how each is measured.
pub(super) struct Epochs {
    pub range: RangeInclusive<u32>,
    pub options: PhysicsOptions,
    /// True if too few points are reported.
    pub is_checked: bool,
    /// True if legs fire the pulses; false for pulses of the caller, which may be none.
    pub has_legs: bool,
}

impl Session {
    /// Flies and measures the survey, once per epoch.
    ///
    /// # Errors
    /// [`Error::Input`] for flights or outputs that are impossible, [`Error::Io`], [`Error::ClosedPipe`], and
    /// [`Error::Interrupted`] when a stop is requested before the first pulse or between two epochs.
    pub fn run(&mut self, outputs: OutputRequest, control: RunContext<'_>) -> Result<Report> {
        let (flight, is_doubted) = self.plan_checked_flight(control.stop)?;
        let is_reported = Arc::new(AtomicBool::new(is_doubted));
        let mut poses = self.open_poses()?;
        if let PlatformKind::Stream(stream) = &self.survey().platform.kind
            && !plausibility::is_recording(stream)
        {
            let bounds = self.scene().bounds.translated(self.scene().shift);
            let mut check = PoseCheck::new(stream, bounds, is_reported.clone());
            poses = poses.map(|poses| poses.on_pose(move |seen| check.add(seen)));
        }
        let outputs = self.complete(outputs);
        let mut context = self.output_context();
        let has_table = outputs.tables.iter().any(|table| table.content == TableContent::Points);
        let has_place = has_table || outputs.sinks.iter().any(|(_, format)| format.holds_crs());
        let has_crs = context.crs.is_none() && has_place;
        // Mistakes in the outputs are reported before the first pose is waited for.
        let is_early = has_crs || poses.is_some();
        let checked = is_early.then(|| outputs.clone().check(&context)).transpose()?;
        if has_crs {
            context.crs = crs::of_flight(&flight, poses.as_mut(), control.stop);
        }
        context.time_origin = crs::time_origin(self.settings(), poses.as_mut(), control.stop);
        let (output, epochs) = self.plan_outputs(outputs, checked, &context)?;
        let mut state = FlightState::start(&flight);
        self.run_epochs(output, epochs, control, &is_reported, |_, pass, epoch, writer| {
            if epoch > 0 {
                state.repeat(&flight);
            }
            fly(pass, &flight, &mut state, poses.take(), u64::MAX, writer)
        })
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
        control: RunContext<'_>,
    ) -> Result<Report> {
        let mut source = PulseSource::new(pulses);
        self.check_instrument()?;
        self.enter_epoch(0, control.stop)?;
        let (output, mut epochs) = self.plan_outputs(self.complete(outputs), None, &self.output_context())?;
        epochs.has_legs = false;
        let options = epochs.options;
        let is_reported = AtomicBool::new(false);
        self.run_epochs(output, epochs, control, &is_reported, |session, pass, epoch, writer| {
            let tracing = Tracing { survey: session.survey(), options, shift: session.scene().shift, legs };
            trace(pass, &tracing, &mut source, epoch, writer)
        })
    }

    /// Plans the flight over the first epoch's scene, checks flight and instrument, and reports implausible
    /// inputs. Returns true if the flight is implausible.
    pub(super) fn plan_checked_flight(&mut self, stop: &Stop) -> Result<(FlightPlan, bool)> {
        self.enter_epoch(0, stop)?;
        let flight = self.plan_flight()?;
        if let Some(note) = plausibility::describe_idle_mirror(self.survey()) {
            self.notify(Notice::Note(note));
        }
        self.check_instrument()?;
        let is_doubted = self.check_flight(&flight, stop)?;
        Ok((flight, is_doubted))
    }

    /// Checks a flight over the scene of the first epoch and reports implausible inputs. Returns true if
    /// there are any.
    pub(super) fn check_flight(&self, flight: &FlightPlan, stop: &Stop) -> Result<bool> {
        let found = self.flight_warnings(flight, stop)?;
        let is_doubted = !found.is_empty();
        self.notify(Notice::Warnings(found));
        Ok(is_doubted)
    }

    /// Finds what is hardly intended of a flight over the scene of the first epoch.
    fn flight_warnings(&self, flight: &FlightPlan, stop: &Stop) -> Result<Diagnostics> {
        let (survey, scene, tree) = (self.survey(), self.scene(), self.tree()?);
        let mut found = plausibility::check_flight(survey, scene, tree, flight);
        found.extend(plausibility::check_recording(survey, scene, tree, flight, &|| stop.is_requested()));
        self.check_tiles()?;
        found.finish(self.settings().strict)
    }

    /// Checks flight and instrument as [`Session::run`] does before the first pulse, for a run that begins
    /// later. Warnings are left to the run, unless they are errors.
    ///
    /// # Errors
    /// As for [`Session::run`].
    pub fn check(&self, stop: &Stop) -> Result<()> {
        let (flight, _) = self.plan_flight_quietly()?;
        self.instrument_warnings()?;
        if self.settings().strict {
            self.flight_warnings(&flight, stop)?;
        }
        Ok(())
    }

    /// Context on which outputs depend.
    pub(super) fn output_context(&self) -> OutputContext {
        let two_way = self.settings().physics.corrections.two_way_time;
        OutputContext::new(self.survey(), self.scene()).with_times(two_way)
    }

    /// Warns of settings of the instrument that the physics passes over or replaces.
    pub(super) fn check_instrument(&self) -> Result<()> {
        self.notify(Notice::Warnings(self.instrument_warnings()?));
        Ok(())
    }

    /// Finds the settings of the instrument that the physics passes over or replaces.
    fn instrument_warnings(&self) -> Result<Diagnostics> {
        let Settings { survey, physics, flight, strict, .. } = self.settings();
        let mut found = plausibility::check_instrument(survey, &physics.corrections);
        let end = self.end_of_weather_flight();
        found.extend(plausibility::check_weather_times(survey, flight.gps_start_ns, end));
        if self.has_spectra() && !physics.corrections.channel_spectra {
            found.extend(plausibility::check_wavelengths(survey));
        }
        found.extend(plausibility::check_noise(survey, physics));
        found.extend(plausibility::check_energy_model(survey, physics));
        if physics.max_order > 0 {
            found.extend(plausibility::check_water(survey, self.scene()));
        }
        found.finish(*strict)
    }

    /// The request with the inputs and the epochs of the session.
    pub(super) fn complete(&self, outputs: OutputRequest) -> OutputRequest {
        let inputs = self.inputs().chain(outputs.inputs.iter().cloned()).collect();
        OutputRequest { epochs: self.epochs(), inputs, ..outputs }
    }

    /// Plans complete outputs of all epochs over the scene of the first, and reports warnings of them. Checks
    /// them unless that has been done.
    fn plan_outputs(
        &self,
        outputs: OutputRequest,
        checked: Option<CheckedOutputs>,
        context: &OutputContext,
    ) -> Result<(Arc<OutputPlan>, Epochs)> {
        let options = self.settings().physics_for(&outputs);
        if options.record_colours && !self.has_colours() {
            let help = "set `colours` of the settings for loading it";
            return Err(Error::input_with_help("the scene was loaded without colours", help));
        }
        let epochs = self.epochs();
        let is_joined = |target: &Target| !matches!(target, Target::Helios(_));
        if epochs > 1 && outputs.sinks.iter().any(|(target, _)| is_joined(target)) {
            self.notify(Notice::Note(format!(
                "the scene's swaps make {epochs} flights; their points are in the same files, with the same \
                 times; --output DIR writes one folder per flight"
            )));
        }
        if let Some(missing) = crs::without_crs(&outputs, context) {
            self.notify(Notice::Note(missing));
        }
        let checked = match checked {
            Some(checked) => checked,
            None => outputs.check(context)?,
        };
        let output = checked.plan(context)?;
        self.notify(Notice::Warnings(output.warnings().clone().finish(self.settings().strict)?));
        Ok((Arc::new(output), Epochs { range: 0..=epochs - 1, options, is_checked: true, has_legs: true }))
    }

    /// Checks outputs as [`Session::run`] does before the first pulse, and returns the files and folders that
    /// they fill, see [`CheckedOutputs::places`]. Warnings are left to the run, unless they are errors.
    ///
    /// # Errors
    /// [`Error::Input`] for outputs that are impossible.
    pub fn output_places(&self, outputs: &OutputRequest) -> Result<BTreeSet<PathBuf>> {
        self.check_places(outputs.clone(), &self.output_context())
    }

    /// The files and folders that outputs fill, which are checked in a context.
    pub(super) fn check_places(
        &self,
        outputs: OutputRequest,
        context: &OutputContext,
    ) -> Result<BTreeSet<PathBuf>> {
        let checked = self.complete(outputs).check(context)?;
        checked.warnings().clone().finish(self.settings().strict)?;
        Ok(checked.places())
    }

    /// Checks complete outputs and reports warnings of them.
    pub(super) fn check_output(&self, outputs: OutputRequest, context: &OutputContext) -> Result<()> {
        let checked = outputs.check(context)?;
        self.notify(Notice::Warnings(checked.warnings().clone().finish(self.settings().strict)?));
        Ok(())
    }

    /// Runs epochs; outputs continue from one to the next. `is_reported` records whether the cause of too few
    /// points has been reported.
    pub(super) fn run_epochs(
        &mut self,
        output: Arc<OutputPlan>,
        epochs: Epochs,
        control: RunContext<'_>,
        is_reported: &AtomicBool,
        pass_over: impl FnMut(&Session, &Pass<'_>, u32, Option<Box<Writer>>) -> Result<Ended>,
    ) -> Result<Report> {
        let ended = self.pass_epochs(&output, epochs, control, is_reported, pass_over);
        ended.map_err(|e| self.with_partial_files(e, &output.partial_files()))
    }

    fn pass_epochs(
        &mut self,
        output: &Arc<OutputPlan>,
        epochs: Epochs,
        control: RunContext<'_>,
        is_reported: &AtomicBool,
        mut pass_over: impl FnMut(&Session, &Pass<'_>, u32, Option<Box<Writer>>) -> Result<Ended>,
    ) -> Result<Report> {
        let Epochs { range, options, is_checked, has_legs } = epochs;
        let open_outputs = control.stop.outputs();
        let (mut epoch, mut seconds, mut writer) = (*range.start(), 0.0, None);
        let (summary, interrupted) = loop {
            self.enter_epoch(epoch, control.stop)?;
            let (settings, scene, tree) = (self.settings(), self.scene(), self.tree()?);
            let ground = || -> Result<Arc<dyn HeightModel>> {
                let model = self.ground(Fallback::Lowest)?;
                Ok(Arc::new(move |x, y| model.local_height(x, y)))
            };
            let physics = Physics::new(scene, tree, &settings.survey, options)?;
            control.progress.set_tiles(scene.tiles.as_ref());
            let started = Instant::now();
            let mut measure = |prefetcher: Option<&Prefetcher>| {
                let pass = Pass {
                    physics: &physics,
                    motion: self.motion(),
                    tiles: scene.tiles.as_deref().zip(prefetcher),
                    trees: &settings.tree,
                    output: output.clone(),
                    ground: output.has_heights().then(ground).transpose()?,
                    schedule: settings.schedule,
                    control,
                    open_outputs: &open_outputs,
                    target: plausibility::target(&settings.survey, scene),
                    check: is_checked.then_some(YieldCheck {
                        settings,
                        scene,
                        tree,
                        has_legs,
                        is_reported,
                        observer: self.observer(),
                    }),
                    epoch,
                    is_last: epoch == *range.end(),
                };
                pass_over(self, &pass, epoch, writer.take()).and_then(|ended| match ended {
                    Ended::Complete(summary) => Ok(Ok((summary, false))),
                    Ended::Interrupted(writer) => Ok(Ok((writer.finish_partial()?, true))),
                    Ended::NextEpoch(writer) => Ok(Err(writer)),
                })
            };
            let ended = match &scene.tiles {
                Some(tiles) => Prefetcher::run(tiles, |prefetcher| measure(Some(prefetcher))),
                None => measure(None),
            };
            seconds += started.elapsed().as_secs_f64();
            if let Some(tiles) = &scene.tiles {
                self.notify(Notice::Timing(describe_tiles(&tiles.statistics())));
            }
            match ended? {
                Ok(complete) => break complete,
                Err(open) => writer = Some(open),
            }
            epoch += 1;
            self.notify(Notice::Detail(format!("epoch {} of {}", epoch + 1, self.epochs())));
        };
        for file in summary.files.iter().filter(|file| file.earlier.is_some()) {
            self.notify(Notice::Note(what_is_kept(file)));
        }
        let pulses = control.progress.snapshot().pulses;
        Ok(Report { summary, pulses, seconds, interrupted, warnings: self.warnings() })
    }

    /// Adds to the error of a failed run where its partial outputs are.
    fn with_partial_files(&self, mut error: Error, files: &[FileSummary]) -> Error {
        for file in files.iter().filter(|file| file.path.is_some()) {
            let kept = what_is_kept(file);
            match &mut error {
                Error::Input(problems) | Error::Limits(problems) => {
                    problems.note(None, kept);
                }
                _ => self.notify(Notice::Note(kept)),
            }
        }
        error
    }
}

/// Describes where a partial output is, and that it did not replace the file of an earlier run.
fn what_is_kept(file: &FileSummary) -> String {
    let path = file.path.as_deref().unwrap_or(Path::new("standard output"));
    let new = format!("what was measured so far is in {}", path.display());
    match &file.earlier {
        Some(old) => format!("{} is unchanged; {new}", old.display()),
        None => new,
    }
}
