//! Shards of a run: [`ShardRunner`] flies and measures shares of a survey's pulses, each of which becomes a
//! file.

use super::chunk;
use super::crs;
use super::fly::fly;
use super::pass::RunContext;
use super::run::{Epochs, Report};
use super::session::Session;
use super::settings::Settings;
use crate::output::{NoOffload, OutputContext, OutputPlan, OutputRequest, ShardOutput};
use crate::shards::{
    Border, Borders, BordersBuilder, Fingerprint, OneOf, PrivateFolder, Records, ShardFile, ShardFileError,
    ShardHead, StoredBorders, is_shard, shard_path,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use vlscan_base::diag::Notice;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::NewFolder;
use vlscan_base::store::Checksum;
use vlscan_lidar::flight::{FlightPlan, FlightState};
use vlscan_lidar::platform::PoseReader;
use vlscan_survey::{PlatformKind, Survey, TrajectoryFile};
use vlscan_warehouse::Stop;

/// A flight that can be divided.
#[derive(Clone)]
pub(super) struct Divisible {
    flight: Arc<FlightPlan>,
    /// Everything on which the contents of its shards depend.
    pub(super) fingerprint: Fingerprint,
}

/// A session whose flight is divided into shards.
pub struct ShardRunner<'s> {
    session: &'s mut Session,
    flight: Arc<FlightPlan>,
    borders: Borders,
    context: OutputContext,
    /// Head of every shard, but for its number.
    head: ShardHead,
    folder: PathBuf,
    is_checked: bool,
}

impl Session {
    /// Plans the flight with `plan`, and collects everything that the contents of its shards depend on.
    ///
    /// # Errors
    /// [`Error::Input`] for flights that cannot be divided; [`Error::Io`].
    pub(super) fn divisible(&self, plan: fn(&Session) -> Result<FlightPlan>) -> Result<Divisible> {
        check_platform(self.survey())?;
        let flight = Arc::new(plan(self)?);
        let scene = vlscan_scene::fingerprint(self.scene(), &self.survey().scene)?;
        let fingerprint = fingerprint(self.settings(), scene, &flight)?;
        Ok(Divisible { flight, fingerprint })
    }

    /// Prepares shards in `folder`, which is created when it is missing. The borders of the flight are read
    /// from it or, when there are none, found by stepping once through the flight, and written to it.
    /// `outputs` are those of the merge. `force` replaces borders of another flight.
    ///
    /// # Errors
    /// [`Error::Input`] for flights and outputs that cannot be divided and for a folder of another flight,
    /// [`Error::Io`], [`Error::Interrupted`].
    pub fn shards(
        &mut self,
        folder: &Path,
        outputs: &OutputRequest,
        force: bool,
        stop: &Stop,
    ) -> Result<ShardRunner<'_>> {
        check_outputs(outputs)?;
        self.record_for(outputs);
        let run = self.divisible(Session::plan_flight)?;
        self.shards_of(run, folder, outputs.cloud.creation, force, stop)
    }

    /// [`Session::shards`] of a planned flight. `creation` is the day for the headers of files.
    pub(super) fn shards_of(
        &mut self,
        run: Divisible,
        folder: &Path,
        creation: (u16, u16),
        force: bool,
        stop: &Stop,
    ) -> Result<ShardRunner<'_>> {
        let Divisible { flight, fingerprint } = run;
        let mut context = self.output_context();
        let mut poses = match &self.survey().platform.kind {
            PlatformKind::Stream(stream) => Some(PoseReader::open(stream)?),
            _ => None,
        };
        if context.crs.is_none() {
            context.crs = crs::of_flight(&flight, poses.as_mut(), stop);
        }
        context.time_origin = crs::time_origin(self.settings(), poses.as_mut(), stop);
        let made = NewFolder::create_all(folder).map_err(|e| Error::io("create", folder, e))?;
        let stored = match Borders::load(folder, &fingerprint) {
            Err(Error::Input(_)) if force => StoredBorders::Missing,
            stored => stored?,
        };
        if let StoredBorders::Damaged = stored {
            let path = Borders::path(folder);
            self.notify(Notice::Note(format!("{} is damaged and is computed again", path.display())));
        }
        let borders = match stored {
            StoredBorders::Found(borders) => borders,
            _ => self.find_borders(&flight, &fingerprint, folder, stop)?,
        };
        made.keep();
        let encoded = postcard::to_stdvec(&context);
        let head = ShardHead {
            fingerprint,
            number: 0,
            of: 1,
            total: borders.total,
            epochs: self.epochs(),
            creation,
            records: Records::of(&self.settings().physics),
            context: encoded.map_err(|e| Error::Internal(format!("facts for the outputs: {e}")))?,
        };
        let folder = folder.to_path_buf();
        Ok(ShardRunner { session: self, flight, borders, context, head, folder, is_checked: false })
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
                let needed = builder.next().saturating_sub(pulses);
                let skipped = chunk::skip(flight, &mut state, &mut poses, needed, stop)?;
                pulses += skipped;
                if skipped < needed {
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

impl ShardRunner<'_> {
    /// Pulses of the whole run.
    pub fn pulses(&self) -> u64 {
        self.borders.total
    }

    /// The file of a shard.
    pub fn path(&self, shard: OneOf) -> PathBuf {
        shard_path(&self.folder, shard)
    }

    /// Opens the file of a shard after comparing all its checksums; `None` if there is no such file, or only
    /// a damaged one, which is reported to the observer.
    ///
    /// # Errors
    /// [`Error::Input`] for a shard of another run, with the difference, and for a file of another kind.
    pub fn existing(&self, shard: OneOf) -> Result<Option<ShardFile>> {
        let path = self.path(shard);
        if !path.exists() {
            return Ok(None);
        }
        let damaged = |reason: ShardFileError| {
            let note = format!("{} {reason}; the shard is computed again", path.display());
            self.session.notify(Notice::Note(note));
            Ok(None)
        };
        let file = match ShardFile::open(&path) {
            Ok(file) => file,
            Err(reason) if is_shard(&path) => return damaged(reason),
            Err(reason) => {
                return Err(Error::input_with_help(
                    format!("{} {reason}, so it is not replaced", path.display()),
                    "move it to another folder, then repeat the command",
                ));
            }
        };
        let expected = self.head_of(shard);
        if file.head == expected {
            return match file.verify() {
                Ok(()) => Ok(Some(file)),
                Err(reason) => damaged(reason),
            };
        }
        Err(of_another_run(&path, &expected.difference(&file.head)))
    }

    fn head_of(&self, shard: OneOf) -> ShardHead {
        ShardHead { number: shard.number, of: shard.of, ..self.head.clone() }
    }

    /// Flies and measures a shard and writes its file, which replaces an existing one.
    ///
    /// # Errors
    /// As for [`Session::run`]. The file is complete or absent.
    pub fn run(&mut self, shard: OneOf, control: RunContext<'_>) -> Result<Report> {
        let path = self.path(shard);
        let name = path.file_name().unwrap_or_default();
        let private = PrivateFolder::new(&self.folder)?;
        let mut report = self.compute(shard, private.path(name), control)?;
        if !report.interrupted {
            private.publish(name)?;
            report.summary.files.iter_mut().for_each(|file| file.path = Some(path.clone()));
        }
        Ok(report)
    }

    fn compute(&mut self, shard: OneOf, path: PathBuf, control: RunContext<'_>) -> Result<Report> {
        let head = self.head_of(shard).bytes()?;
        let request = OutputRequest {
            shard: Some(ShardOutput { path, head }),
            epochs: self.session.epochs(),
            ..OutputRequest::default()
        };
        let output = Arc::new(OutputPlan::new(request, &self.context)?);
        let range = self.borders.range(shard);
        let is_last = shard.number + 1 == shard.of;
        let mut poses = self.session.open_poses()?;
        let border = match range.is_empty() && !is_last {
            true => None,
            false => Some(self.border(range.start, &mut poses, control.stop)?),
        };
        // A firing of many beams is not divided: it belongs to the shard that its first pulse is in, which
        // may then begin after its range.
        let Some(Border { epoch: first, mut state, pulses: begin }) =
            border.filter(|border| is_last || border.pulses < range.end)
        else {
            let summary = output.open(Arc::new(NoOffload))?.finish()?;
            let warnings = self.session.warnings();
            return Ok(Report { summary, pulses: 0, seconds: 0.0, interrupted: false, warnings });
        };
        self.check_once(first, control.stop)?;
        let mut left = if is_last { u64::MAX } else { range.end - begin };
        let epochs = Epochs {
            range: first..=self.borders.last_epoch((!is_last).then_some(range.end)),
            options: self.session.settings().physics,
            is_checked: false,
            has_legs: true,
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

    /// Checks the flight over the scene of the first epoch before the first shard in it.
    fn check_once(&mut self, epoch: u32, stop: &Stop) -> Result<()> {
        if epoch > 0 || std::mem::replace(&mut self.is_checked, true) {
            return Ok(());
        }
        self.session.check_instrument()?;
        self.session.enter_epoch(0, stop)?;
        self.session.check_flight(&self.flight, stop)?;
        Ok(())
    }
}

/// The error of a shard of another run; `what` is the difference.
pub(super) fn of_another_run(shard: &Path, what: &str) -> Error {
    Error::not_divisible(
        format!("{} is of another run; they differ in {what}", shard.display()),
        "remove the folder to start again, or repeat the command with the same options",
    )
}

/// Rejects heights above ground, for which a merge has no scene.
pub(super) fn check_outputs(outputs: &OutputRequest) -> Result<()> {
    if !outputs.wants_heights() {
        return Ok(());
    }
    Err(Error::not_divisible(
        "heights above ground need the scene, which shards do not have, and cannot be used with --shard or \
         --resume",
        "leave out --height-above-ground and the column HeightAboveGround, or run without --shard and \
         --resume",
    ))
}

/// Rejects poses that cannot be read more than once.
fn check_platform(survey: &Survey) -> Result<()> {
    let PlatformKind::Stream(stream) = &survey.platform.kind else { return Ok(()) };
    if stream.path.is_file() {
        return Ok(());
    }
    Err(Error::not_divisible(
        "every shard needs all poses before it, but poses from standard input or a pipe can be read only \
         once",
        "save them to a file, and name it with --trajectory",
    ))
}

/// Collects everything that the contents of shards depend on. `scene` is the scene's checksum.
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
        // Also distinguishes programs whose states have other contents.
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
    let mut add_file = |path: &mut PathBuf, content: Option<Arc<[u8]>>| {
        let path = std::mem::take(path);
        match content {
            Some(bytes) => {
                sum.bytes(&bytes);
                Ok(())
            }
            None => sum.file(&path).map_err(|e| Error::io("read", path, e)),
        }
    };
    let mut kind = survey.platform.kind.clone();
    match &mut kind {
        PlatformKind::Interpolated(table) => {
            let add = |file: &mut TrajectoryFile| add_file(&mut file.path, file.content.take());
            table.files.iter_mut().try_for_each(add)?;
        }
        PlatformKind::Stream(stream) => add_file(&mut stream.path, None)?,
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
