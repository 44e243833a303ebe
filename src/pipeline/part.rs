//! Parts of a run: [`PartRunner`] flies and measures shares of a survey's pulses, each of which becomes a file.

use super::chunk;
use super::crs;
use super::fly::fly;
use super::pass::Control;
use super::plausibility;
use super::session::{Epochs, Report, Session};
use super::settings::Settings;
use crate::output::{NoOffload, OutputContext, OutputPlan, OutputRequest, PartOutput};
use crate::parts::{
    Border, Borders, BordersBuilder, Fingerprint, PartFile, PartHead, PrivateFolder, Records, StoredBorders,
    is_part, part_path,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use vlscan_base::diag::{Diagnostics, Notice};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::NewFolder;
use vlscan_base::store::Checksum;
use vlscan_lidar::flight::{FlightPlan, FlightState};
use vlscan_lidar::platform::PoseReader;
use vlscan_survey::{PlatformKind, Survey};
use vlscan_warehouse::Stop;

/// A share of a run's pulses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Number of the part, from 0.
    pub number: u32,
    /// Number of parts.
    pub of: u32,
}

/// A flight that can be divided.
#[derive(Clone)]
pub(super) struct Divisible {
    flight: Arc<FlightPlan>,
    /// What the contents of its parts depend on.
    pub(super) fingerprint: Fingerprint,
}

/// A session whose flight is divided into parts.
pub struct PartRunner<'s> {
    session: &'s mut Session,
    flight: Arc<FlightPlan>,
    borders: Borders,
    context: OutputContext,
    /// Head of every part, but for its number.
    head: PartHead,
    /// The points of LAS whose records parts hold, if not echoes.
    las: Option<OutputRequest>,
    folder: PathBuf,
    is_checked: bool,
}

impl Session {
    /// Plans the flight, and computes what the contents of its parts depend on.
    ///
    /// # Errors
    /// [`Error::Input`] for flights that cannot be divided; [`Error::Io`].
    pub(super) fn divisible(&self) -> Result<Divisible> {
        check_platform(self.survey())?;
        let flight = Arc::new(self.plan_flight()?);
        let scene = vlscan_scene::fingerprint(self.scene(), &self.survey().scene)?;
        let fingerprint = fingerprint(self.settings(), scene, &flight)?;
        Ok(Divisible { flight, fingerprint })
    }

    /// Prepares parts in `folder`, which is created when it is missing. The borders of the flight are read from it or,
    /// when there are none, found by stepping once through the flight, and written to it. `creation` is the day for the
    /// headers of files. `force` replaces borders of another flight.
    ///
    /// # Errors
    /// [`Error::Input`] for flights that cannot be divided and for a folder of another flight, [`Error::Io`],
    /// [`Error::Interrupted`].
    pub(crate) fn parts(
        &mut self,
        folder: &Path,
        creation: (u16, u16),
        force: bool,
        stop: &Stop,
    ) -> Result<PartRunner<'_>> {
        let run = self.divisible()?;
        self.parts_of(run, folder, creation, force, stop)
    }

    /// [`Session::parts`] of a flight that is planned.
    pub(super) fn parts_of(
        &mut self,
        run: Divisible,
        folder: &Path,
        creation: (u16, u16),
        force: bool,
        stop: &Stop,
    ) -> Result<PartRunner<'_>> {
        let Divisible { flight, fingerprint } = run;
        let mut context = self.output_context();
        if context.crs.is_none() {
            let mut poses = match &self.survey().platform.kind {
                PlatformKind::Stream(stream) => Some(PoseReader::open(stream)?),
                _ => None,
            };
            context.crs = crs::of_flight(&flight, poses.as_mut(), stop);
        }
        let made = NewFolder::create_all(folder).map_err(|e| Error::io("create", folder, e))?;
        let stored = match Borders::load(folder, &fingerprint) {
            Err(Error::Input(_)) if force => StoredBorders::Missing,
            stored => stored?,
        };
        if let StoredBorders::Damaged = stored {
            let path = Borders::path(folder);
            self.notify(Notice::Note(format!("{} is damaged and made again", path.display())));
        }
        let borders = match stored {
            StoredBorders::Found(borders) => borders,
            _ => self.find_borders(&flight, &fingerprint, folder, stop)?,
        };
        made.keep();
        let encoded = postcard::to_stdvec(&context);
        let physics = &self.settings().physics;
        let head = PartHead {
            fingerprint,
            number: 0,
            of: 1,
            total: borders.total,
            epochs: self.epochs(),
            creation,
            records: Records {
                waveforms: physics.record_waveforms,
                pulses: physics.record_pulses,
                truth: physics.record_truth,
                scanner_axes: physics.record_scanner_axes,
                subrays: physics.record_subrays,
            },
            las: None,
            context: encoded.map_err(|e| Error::Internal(format!("facts for the outputs: {e}")))?,
        };
        let folder = folder.to_path_buf();
        Ok(PartRunner { session: self, flight, borders, context, head, las: None, folder, is_checked: false })
    }

    /// Steps once through the flight and writes the borders to `folder`.
    fn find_borders(
        &self,
        flight: &FlightPlan,
        fingerprint: &Fingerprint,
        folder: &Path,
        stop: &Stop,
    ) -> Result<Borders> {
        let started = std::time::Instant::now();
        let mut poses = self.open_poses()?;
        let mut builder = BordersBuilder::new(fingerprint.of_flight(), !flight.is_stream());
        let mut state = FlightState::start(flight);
        let mut pulses = 0;
        for epoch in 0..self.epochs() {
            if epoch > 0 {
                state.repeat(flight);
            }
            builder.begin_epoch(pulses);
            loop {
                let wanted = builder.next().saturating_sub(pulses);
                let skipped = chunk::skip(flight, &mut state, &mut poses, wanted, stop)?;
                pulses += skipped;
                if skipped < wanted {
                    break;
                }
                builder.add(pulses, &state)?;
            }
        }
        let borders = builder.finish(pulses);
        borders.save(folder)?;
        self.notify(Notice::Timing(format!(
            "flight: {pulses} pulses, {} stored states, {:.2} s",
            borders.states(),
            started.elapsed().as_secs_f64()
        )));
        Ok(borders)
    }
}

impl PartRunner<'_> {
    /// Pulses of the whole run.
    pub fn pulses(&self) -> u64 {
        self.borders.total
    }

    /// Has parts hold the points of `output` as records of LAS instead of echoes.
    ///
    /// # Errors
    /// [`Error::Input`] for points of LAS that need more than a part of the run.
    pub fn hold_las(&mut self, output: &OutputRequest) -> Result<()> {
        let mut problems = Diagnostics::default();
        let others = [
            (output.las.packets.is_some(), "waveform packets", "--wave-packets"),
            (output.heights, "heights above the ground", "--height-above-ground"),
        ];
        for (_, what, option) in others.iter().filter(|(is_wanted, ..)| *is_wanted) {
            problems
                .error(None, format!("parts with records of LAS hold no {what}"))
                .help(format!("leave out {option}, or --part-points"));
        }
        problems.finish(false)?;
        let request = OutputRequest {
            las: output.las.clone(),
            labels: output.labels,
            misses: output.misses,
            true_positions: output.true_positions,
            ..OutputRequest::default()
        };
        self.head.las = Some(OutputPlan::new(request.clone(), &self.context)?.las_facts());
        self.las = Some(request);
        Ok(())
    }

    /// The file of a part.
    pub fn path(&self, part: Part) -> PathBuf {
        part_path(&self.folder, part.number, part.of)
    }

    /// Opens the file of a part after comparing all its checksums; `None` if there is no such file, or only a damaged one,
    /// which the observer is told of.
    ///
    /// # Errors
    /// [`Error::Input`] for a part of another run, with what differs, and for a file of another kind.
    pub fn existing(&self, part: Part) -> Result<Option<PartFile>> {
        let path = self.path(part);
        if !path.exists() {
            return Ok(None);
        }
        let damaged = |reason: String| {
            let note = format!("{} {reason}; the part is computed again", path.display());
            self.session.notify(Notice::Note(note));
            Ok(None)
        };
        let file = match PartFile::open(&path) {
            Ok(file) => file,
            Err(reason) if is_part(&path) => return damaged(reason),
            Err(reason) => {
                let mut problems = Diagnostics::default();
                problems
                    .error(None, format!("{} {reason}, so it is not replaced", path.display()))
                    .help("move it to another folder, then repeat the command");
                return Err(Error::Input(Box::new(problems)));
            }
        };
        let expected = self.head_of(part);
        if file.head == expected {
            return match file.verify() {
                Ok(()) => Ok(Some(file)),
                Err(reason) => damaged(reason),
            };
        }
        let what = expected.difference(&file.head);
        let mut problems = Diagnostics::default();
        problems
            .error(None, format!("{} is of another run; they differ in {what}", path.display()))
            .help("remove the folder to begin anew, or repeat the command with the same options");
        Err(Error::Input(Box::new(problems)))
    }

    fn head_of(&self, part: Part) -> PartHead {
        PartHead { number: part.number, of: part.of, ..self.head.clone() }
    }

    /// Flies and measures a part and writes its file, which replaces an existing one.
    ///
    /// # Errors
    /// As for [`Session::run`]. The file is complete or absent.
    pub fn run(&mut self, part: Part, control: Control<'_>) -> Result<Report> {
        let path = self.path(part);
        let name = path.file_name().unwrap_or_default();
        let private = PrivateFolder::new(&self.folder)?;
        let mut report = self.compute(part, private.path(name), control)?;
        if !report.interrupted {
            private.publish(name)?;
            report.summary.files.iter_mut().for_each(|file| file.path = Some(path.clone()));
        }
        Ok(report)
    }

    fn compute(&mut self, part: Part, path: PathBuf, control: Control<'_>) -> Result<Report> {
        let head = self.head_of(part).bytes().map_err(|e| Error::Internal(format!("head of a part: {e}")))?;
        let request = OutputRequest {
            part: Some(PartOutput { path, head, as_las: self.las.is_some() }),
            epochs: self.session.epochs(),
            ..self.las.clone().unwrap_or_default()
        };
        let output = Arc::new(OutputPlan::new(request, &self.context)?);
        let range = self.borders.range(part.number, part.of);
        let is_last = part.number + 1 == part.of;
        if range.is_empty() && !is_last {
            let summary = output.open(Arc::new(NoOffload))?.finish()?;
            return Ok(Report { summary, pulses: 0, seconds: 0.0, interrupted: false });
        }
        let mut poses = self.session.open_poses()?;
        let Border { epoch: first, mut state, .. } = self.border(range.start, &mut poses, control.stop)?;
        self.check_once(first, control.stop)?;
        let mut left = if is_last { u64::MAX } else { range.end - range.start };
        let epochs = Epochs {
            range: first..=self.borders.last_epoch((!is_last).then_some(range.end)),
            options: self.session.settings().physics,
            is_checked: false,
        };
        let flight = &self.flight;
        let progress = control.progress;
        self.session.run_epochs(output, epochs, control, &AtomicBool::new(false), |_, pass, epoch, writer| {
            if epoch > first {
                state.repeat(flight);
            }
            let before = progress.snapshot().pulses;
            let ended = fly(pass, flight, &mut state, poses.take(), left, writer);
            left = left.saturating_sub(progress.snapshot().pulses - before);
            ended
        })
    }

    /// The state of the flight after the step that emits pulse number `pulses`, counted from 1.
    fn border(&self, pulses: u64, poses: &mut Option<PoseReader>, stop: &Stop) -> Result<Border> {
        let flight = &self.flight;
        let start = || Border { pulses: 0, epoch: 0, state: FlightState::start(flight) };
        let mut border = self.borders.nearest(pulses)?.unwrap_or_else(start);
        loop {
            border.pulses += chunk::skip(flight, &mut border.state, poses, pulses - border.pulses, stop)?;
            if border.pulses >= pulses || border.epoch + 1 >= self.borders.epochs() {
                return Ok(border);
            }
            border.epoch += 1;
            border.state.repeat(flight);
        }
    }

    /// Checks the flight over the scene of the first epoch before the first part in it.
    fn check_once(&mut self, epoch: u32, stop: &Stop) -> Result<()> {
        if epoch > 0 || std::mem::replace(&mut self.is_checked, true) {
            return Ok(());
        }
        self.session.check_instrument()?;
        self.session.enter_epoch(0, stop)?;
        let (settings, scene) = (self.session.settings(), self.session.scene());
        let found = plausibility::check_flight(&settings.survey, scene, self.session.tree()?, &self.flight);
        self.session.notify(Notice::Warnings(found.finish(settings.strict)?));
        Ok(())
    }
}

/// Refuses poses that cannot be read more than once.
fn check_platform(survey: &Survey) -> Result<()> {
    let PlatformKind::Stream(stream) = &survey.platform.kind else { return Ok(()) };
    if stream.path.is_file() {
        return Ok(());
    }
    let mut problems = Diagnostics::default();
    problems
        .error(
            None,
            "poses from standard input or a pipe pass only once, and every part needs those before it",
        )
        .help("save them to a file, and name it with --trajectory");
    Err(Error::Input(Box::new(problems)))
}

/// Collects what the contents of parts depend on. `scene` is the scene's checksum.
fn fingerprint(settings: &Settings, scene: u64, plan: &FlightPlan) -> Result<Fingerprint> {
    let (flight, physics) = (&settings.flight, &settings.physics);
    let mut all = Fingerprint::default();
    all.flight("version of vlscan", env!("CARGO_PKG_VERSION"));
    all.flight("survey", format!("{:016x}", survey_sum(&settings.survey)?));
    all.flight("scene", format!("{scene:016x}"));
    all.flight("seed", flight.seed);
    all.flight("start of the clock", format!("{:?} ns", flight.gps_start_ns));
    all.flight("flight", format!("{:?}", (flight.platform_noise, flight.leg_noise)));
    all.flight("kinematics", format!("{:?}", flight.kinematics));
    all.flight("errors of navigation", format!("{:?}", flight.navigation));
    if !plan.is_stream() {
        // Also tells programs apart whose states have other contents.
        let start = postcard::to_stdvec(&FlightState::start(plan));
        let start = start.map_err(|e| Error::Internal(format!("a state of the flight: {e}")))?;
        let mut sum = Checksum::default();
        sum.array(&start);
        all.flight("start of the flight", format!("{:016x}", sum.finish()));
    }
    all.measurement("physics", format!("{physics:?}"));
    Ok(all)
}

/// Checksum of everything in a survey but its scene and the names of files.
fn survey_sum(survey: &Survey) -> Result<u64> {
    let mut sum = Checksum::default();
    let mut add_file = |path: &mut PathBuf| {
        let path = std::mem::take(path);
        sum.file(&path).map_err(|e| Error::io("read", path, e))
    };
    let mut kind = survey.platform.kind.clone();
    match &mut kind {
        PlatformKind::Interpolated(table) => {
            table.files.iter_mut().try_for_each(|file| add_file(&mut file.path))?
        }
        PlatformKind::Stream(stream) => add_file(&mut stream.path)?,
        PlatformKind::Static
        | PlatformKind::LinearPath
        | PlatformKind::GroundVehicle { .. }
        | PlatformKind::Multicopter(_) => {}
    }
    let Survey { name, path: _, seed: _, platform, scanner, scene: _, legs, leg_offset, crs_wkt } = survey;
    sum.debug(&(name, kind, &platform.id, platform.mount, &platform.noise, scanner, leg_offset, crs_wkt));
    for leg in legs {
        sum.debug(&(leg.number, &leg.strip, &leg.platform, &leg.scanner));
    }
    Ok(sum.finish())
}
