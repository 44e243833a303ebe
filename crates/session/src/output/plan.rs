//! The plan of all outputs, computed and checked before anything is written.

use super::context::{OutputContext, OutputLeg};
use super::division::Divider;
use super::formats::{Formats, TableFormat};
use super::layout::{Content, FilePlan, OutputLayout, OutputLocation};
use super::points::CloudFacts;
use super::request::{OutputRequest, Target};
use super::summary::FileSummary;
use super::unused::warn_of_unused;
use std::collections::{BTreeMap, BTreeSet};
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use vlscan_base::diag::{Diagnostics, ProblemKind};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{
    FileSet, NewFolder, identity, is_special, is_taken, reads, refuse_unwritable, remove_litter,
};
use vlscan_formats::{
    CloudSettings, Column, Destination, FrameNames, Needs, ObjectIds, PacketPlace, PointBatch, PointEncoder,
    PointFormat,
};
use vlscan_geom::DVec3;
use vlscan_lidar::pulse::Batch;

/// All outputs of a run: files, contents and formats. Immutable and shared by the workers.
#[derive(Debug)]
pub struct OutputPlan {
    pub(super) layout: OutputLayout,
    pub(super) request: OutputRequest,
    /// Facts about the points for the formats.
    pub(super) settings: CloudSettings,
    /// The time that times of records count from, s.
    time_origin: f64,
    /// Number of each leg in records, and duration of its frames, ns.
    legs: Vec<(u16, f64)>,
    /// The formats that points are written in.
    pub(super) encoders: BTreeMap<PointFormat, Arc<dyn PointEncoder>>,
    /// The format of points in tables whose columns differ from those of files.
    table: Option<TableFormat>,
    /// Needs of the formats and columns.
    pub(super) needs: Needs,
    /// The division of points among the files of folders.
    pub(super) divider: Option<Divider>,
    warnings: Diagnostics,
    /// Partial files that a failed run left.
    pub(super) partial_files: Mutex<Vec<FileSummary>>,
}

/// Outputs that passed the checks before the run: their files and formats.
#[derive(Debug)]
pub struct CheckedOutputs {
    request: OutputRequest,
    layout: OutputLayout,
    divider: Option<Divider>,
    formats: Formats,
    /// Warnings of formats; requests and files only cause errors.
    warnings: Diagnostics,
    /// Coordinate reference system and time origin of the context, on which formats depend.
    place: (Option<String>, f64),
}

impl OutputRequest {
    /// Performs all checks that are possible before the run: existing files, duplicate names, missing
    /// directories, binary formats on a terminal. All problems are reported together, and nothing is written.
    ///
    /// # Errors
    /// [`Error::Input`].
    pub fn check(mut self, context: &OutputContext) -> Result<CheckedOutputs> {
        self.epochs = self.epochs.max(1);
        let mut problems = Diagnostics::default();
        let objects = ObjectIds::new(&context.parts);
        let divider = divider(&self, context, &objects, &mut problems);
        let layout = OutputLayout::new(&self, context, divider.as_ref().map(|d| &d.names[..]));
        check_requests(&self, context, &mut problems);
        let inputs = Inputs::of(&self);
        check_files(&layout, &self, &inputs, &mut problems);
        let formats = Formats::new(&self, context, objects, &mut problems)?;
        if formats.encoders.values().any(|encoder| encoder.packets() == Some(PacketPlace::Beside)) {
            check_packets(&layout, self.force || self.is_resuming, &inputs, &mut problems);
        }
        let warnings = problems.finish(false)?;
        let place = (context.crs.clone(), context.time_origin);
        Ok(CheckedOutputs { request: self, layout, divider, formats, warnings, place })
    }
}

impl CheckedOutputs {
    /// Warnings about the request.
    pub fn warnings(&self) -> &Diagnostics {
        &self.warnings
    }

    /// Files and folders that the outputs fill; `-` is standard output. Runs that share one of them would
    /// overwrite or mix their outputs.
    pub fn places(&self) -> BTreeSet<PathBuf> {
        let mut places = self.layout.places();
        if self.formats.encoders.values().any(|encoder| encoder.packets() == Some(PacketPlace::Beside)) {
            let packets: Vec<PathBuf> = places.iter().map(|path| packets_path(path)).collect();
            places.extend(packets);
        }
        places
    }

    /// Plans the outputs. `context` is that of the check, except for coordinate reference system and time
    /// origin, which may be known only after the first pose of a flight.
    ///
    /// # Errors
    /// [`Error::Input`] for formats that cannot be written in this coordinate reference system.
    pub fn plan(self, context: &OutputContext) -> Result<OutputPlan> {
        let CheckedOutputs { request, layout, divider, mut formats, mut warnings, place } = self;
        if place != (context.crs.clone(), context.time_origin) {
            let mut problems = Diagnostics::default();
            let objects = std::mem::take(&mut formats.settings.objects);
            formats = Formats::new(&request, context, objects, &mut problems)?;
            warnings = problems.finish(false)?;
        }
        let leg = |leg: &OutputLeg| {
            let frame_ns = request.frame_s.or(leg.revolution_s).map_or(PointBatch::FRAME_NS, |s| s * 1e9);
            (saturated(leg.number), frame_ns)
        };
        Ok(OutputPlan {
            layout,
            legs: context.legs.iter().map(leg).collect(),
            time_origin: context.time_origin,
            encoders: formats.encoders,
            table: formats.table,
            needs: request.needs(),
            divider,
            warnings,
            partial_files: Mutex::default(),
            settings: formats.settings,
            request,
        })
    }
}

impl OutputPlan {
    /// Plans every file after all checks of [`OutputRequest::check`].
    ///
    /// # Errors
    /// The errors of [`OutputRequest::check`].
    pub fn new(request: OutputRequest, context: &OutputContext) -> Result<OutputPlan> {
        request.check(context)?.plan(context)
    }

    /// Origin of the positions and times of records.
    pub(super) fn frame(&self) -> WorldFrame {
        WorldFrame { origin: self.settings.origin, time: self.time_origin }
    }

    /// Facts about the points of tables in addition to their columns.
    pub(super) fn table_facts(&self) -> CloudFacts {
        CloudFacts::new(self.table_settings().clone(), self.legs.clone())
    }

    /// Facts about the points of tables for their format.
    pub(super) fn table_settings(&self) -> &CloudSettings {
        self.table.as_ref().map_or(&self.settings, |table| &table.settings)
    }

    /// The format of points in tables.
    pub(super) fn table_encoder(&self) -> Option<&Arc<dyn PointEncoder>> {
        match &self.table {
            Some(table) => Some(&table.encoder),
            None => self.encoders.get(&PointFormat::Arrow),
        }
    }

    /// True if points have their height above the ground.
    pub fn has_heights(&self) -> bool {
        self.needs.height
    }

    /// Number of the leg of a batch in records, and duration of its frames, ns.
    pub(super) fn leg_of(&self, batch: &Batch) -> (u16, f64) {
        let known = self.legs.get(batch.leg as usize).copied();
        let (number, frame_ns) = known.unwrap_or((saturated(batch.leg), PointBatch::FRAME_NS));
        (batch.leg_number.map_or(number, saturated), frame_ns)
    }

    /// Warnings about the request.
    pub fn warnings(&self) -> &Diagnostics {
        &self.warnings
    }

    /// Partial files that a failed run left, see [`Writer`](super::Writer).
    pub fn partial_files(&self) -> Vec<FileSummary> {
        self.partial_files.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Origin of the positions and times of records.
#[derive(Clone, Copy, Debug)]
pub(super) struct WorldFrame {
    /// World position, m.
    pub origin: DVec3,
    /// s; 0 for times of the week.
    pub time: f64,
}

impl WorldFrame {
    /// The time of a record in files, s.
    pub fn seconds(self, time_ns: f64) -> f64 {
        self.time + time_ns / 1e9
    }
}

/// The number of a leg in records, saturated.
fn saturated(leg: u32) -> u16 {
    u16::try_from(leg).unwrap_or(u16::MAX)
}

/// Plans the division of points, which takes folders and whole points.
fn divider(
    request: &OutputRequest,
    context: &OutputContext,
    objects: &ObjectIds,
    problems: &mut Diagnostics,
) -> Option<Divider> {
    let division = request.division.as_ref()?;
    if !request.has_folder() {
        problems
            .error(None, "--tile and --per-object need a directory as output")
            .help("-o DIR, with --format");
        return None;
    }
    if request.cloud.las.packets.is_some() || request.split_by_channel || request.cloud.misses {
        problems.error(
            None,
            "--tile and --per-object cannot be combined with --wave-packets, --split-by-channel or --misses",
        );
        return None;
    }
    let made = Divider::new(division, &context.bounds, context.shift, objects);
    made.map_err(|error| problems.error(None, error.to_string())).ok()
}

fn check_requests(request: &OutputRequest, context: &OutputContext, problems: &mut Diagnostics) {
    let streams = |target: &Target| *target == Target::Stdout;
    for (is_requested, what) in [(request.waveforms, "waveforms"), (request.pulses, "pulses")] {
        if is_requested && request.sinks.iter().all(|(target, _)| streams(target)) {
            problems
                .error(
                    None,
                    format!("{what} are written beside a file of points, but no such file is written"),
                )
                .help("name a file or a directory for the points");
        }
    }
    if matches!(request.trajectory, Some((Target::Helios(_), _))) {
        problems
            .error(None, "--output writes the trajectories itself; name a file or a directory for others");
    }
    if request.wants_heights() && !context.has_ground {
        problems.error(
            None,
            "--height-above-ground needs the scene, which `vlscan merge` and streams do not have",
        );
    }
    if request.tables.iter().any(|table| table.batch_rows == 0) {
        problems.error(None, "batches of 0 rows: expected at least 1");
    }
    let columns = request.table_columns.as_ref().or(request.cloud.columns.as_ref());
    let has_no_time = columns.is_some_and(|columns| !columns.contains(&Column::GpsTime));
    for seconds in request.tables.iter().filter_map(|table| table.batch_seconds) {
        if has_no_time {
            problems.error(None, "batches by interval of time need the column GpsTime");
        }
        if !(seconds.is_finite() && seconds > 0.0) {
            problems.error(None, format!("an interval of time is {seconds} s, expected more than 0"));
        }
    }
    if request.cloud.columns.is_some() && !request.uses_columns() {
        problems
            .error(
                None,
                "--columns applies to xyz, csv, arrow, parquet and geoparquet, but none of them is written",
            )
            .help("-o points.csv, .xyz, .arrow or .parquet");
    }
    warn_of_unused(request, problems);
    check_frames(request, problems);
    if request.split_by_channel
        && context.devices.len() > 1
        && request.sinks.iter().any(|(target, _)| streams(target))
    {
        problems.error(None, "--split-by-channel needs files: points go to standard output");
    }
    let binary = |(target, format): &(Target, PointFormat)| streams(target) && !format.is_text();
    if request.sinks.iter().any(binary) && !request.force && std::io::stdout().is_terminal() {
        problems
            .error(None, "binary points would go to the terminal")
            .help("redirect standard output, or use --force");
    }
}

/// Reports problems of the frames of MCAP.
fn check_frames(request: &OutputRequest, problems: &mut Diagnostics) {
    let has_frames = request.has_frames();
    if request.frame_s.is_some() && !has_frames && request.shard.is_none() {
        problems.error(None, "--frame-s applies to MCAP output only").help("-o points.mcap");
    }
    let names = &request.cloud.frame_names;
    if *names != FrameNames::default() && !has_frames && request.shard.is_none() {
        problems
            .error(None, "--world-frame and --sensor-frame apply to MCAP output only")
            .help("-o points.mcap");
    }
    for (option, name) in [("--world-frame", &names.world), ("--sensor-frame", &names.sensor)] {
        if name.trim().is_empty() {
            problems.error(None, format!("{option}: the name of the frame is empty")).help("map, lidar");
        }
    }
    if names.world == names.sensor {
        let message = format!("--world-frame and --sensor-frame are both \"{}\"", names.world);
        problems.error(None, message);
    }
}

/// The input files of a run, which no output may replace.
struct Inputs(FileSet);

impl Inputs {
    fn of(request: &OutputRequest) -> Inputs {
        Inputs(FileSet::of(&request.inputs))
    }

    fn contain(&self, path: &Path) -> bool {
        self.0.contains(path) || reads::is_input(path)
    }
}

fn check_files(layout: &OutputLayout, request: &OutputRequest, inputs: &Inputs, problems: &mut Diagnostics) {
    for clash in &layout.clashes {
        let message = match clash {
            OutputLocation::Fixed(Destination::Stdout) => {
                "only one output can go to standard output".to_owned()
            }
            location => format!("two outputs would be written to {location}"),
        };
        problems.error(None, message);
    }
    let folders = layout.directories.iter().chain(layout.runs.iter().map(|run| &run.parent));
    for folder in folders.filter(|f| f.exists() && !f.is_dir()) {
        problems.error(None, format!("{} is a file, expected a directory", folder.display()));
    }
    let mut taken = BTreeSet::new();
    let planned = layout.files.iter().filter_map(|FilePlan { location, content, .. }| match location {
        OutputLocation::Fixed(Destination::Path(path)) if *content != Content::Shard => Some(path),
        _ => None,
    });
    let may_exist = request.force || request.is_resuming;
    let planned = planned.map(|path| (path, may_exist));
    for (path, may_exist) in planned.chain(request.companions.iter().map(|path| (path, request.force))) {
        check_path(path, &layout.directories, may_exist, inputs, problems);
        if !is_special(path) && !taken.insert(identity(path)) {
            problems.error(None, format!("two outputs would be written to {}", path.display()));
        }
    }
}

/// Reports problems of the separate files of waveform packets.
fn check_packets(layout: &OutputLayout, may_exist: bool, inputs: &Inputs, problems: &mut Diagnostics) {
    let mut taken = BTreeSet::new();
    for file in &layout.files {
        if !matches!(file.content, Content::Points(format) if format.is_las()) {
            continue;
        }
        let location = match &file.location {
            OutputLocation::Fixed(Destination::Stdout) => {
                problems
                    .error(None, "--wave-packets beside needs a file of points: they go to standard output")
                    .help("--wave-packets inside");
                continue;
            }
            OutputLocation::Fixed(Destination::Path(path)) => {
                let path = packets_path(path);
                check_path(&path, &layout.directories, may_exist, inputs, problems);
                OutputLocation::Fixed(Destination::Path(path))
            }
            // Tables hold no LAS.
            OutputLocation::Memory(_) => continue,
            OutputLocation::Run { run, name } => {
                let path = packets_path(Path::new(name));
                OutputLocation::Run { run: *run, name: path.to_string_lossy().into_owned() }
            }
        };
        let own = match &location {
            OutputLocation::Fixed(Destination::Path(path)) => {
                OutputLocation::Fixed(Destination::Path(identity(path)))
            }
            other => other.clone(),
        };
        if !taken.insert(own) {
            problems
                .error(None, format!("the waveform packets of two outputs would be written to {location}"));
        }
    }
}

/// Returns the path of the packet file that belongs to a LAS file.
pub(super) fn packets_path(las: &Path) -> PathBuf {
    las.with_extension("wdp")
}

fn check_path(path: &Path, made: &[PathBuf], may_exist: bool, inputs: &Inputs, problems: &mut Diagnostics) {
    if inputs.contain(path) {
        problems.error(None, reads::is_read(path));
        return;
    }
    let is_made = |folder: &Path| !folder.is_dir() && made.iter().any(|made| made == folder);
    if path.parent().is_some_and(is_made) {
        return;
    }
    if let Err(Error::Input(found)) = refuse_unwritable(path, true) {
        return problems.extend(*found);
    }
    if !may_exist && is_taken(path) {
        let message = format!("{} exists already", path.display());
        let problem = problems.error(None, message).of_kind(ProblemKind::Exists);
        problem.help("overwrite it with --force");
    }
}

/// Returns the name of a run directory created now: local time, to the second.
pub(super) fn stamp() -> String {
    chrono::Local::now().format("%Y-%m-%d_%H-%M-%S").to_string()
}

/// Creates `parent/stamp`, or the first of `parent/stamp_2` … `parent/stamp_99` that does not exist. Returns
/// its path and the folders that were created, inner ones first. Run directories of killed runs lose their
/// temporary files.
pub(super) fn create_run_directory(parent: &Path, stamp: &str) -> Result<(PathBuf, [NewFolder; 2])> {
    let made = NewFolder::create_all(parent).map_err(|e| Error::io("create", parent, e))?;
    for earlier in std::fs::read_dir(parent).into_iter().flatten().flatten() {
        remove_litter(&earlier.path());
    }
    for number in 1..=99 {
        let path = parent.join(if number == 1 { stamp.to_owned() } else { format!("{stamp}_{number}") });
        match NewFolder::create(&path) {
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {}
            Err(e) => return Err(Error::io("create", path, e)),
            Ok(run) => return Ok((path, [run, made])),
        }
    }
    Err(Error::input(format!("{}/{stamp} and its copies up to _99 exist already", parent.display())))
}
