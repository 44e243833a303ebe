//! The plan of all outputs, computed and checked before anything is written.

use super::arrow::{About, schema};
use super::codec::LegFacts;
use super::columns::Column;
use super::context::OutputContext;
use super::division::{Divider, Ring};
use super::las::LasFormat;
use super::layout::{Content, FilePlan, OutputLayout, OutputLocation};
use super::mcap;
use super::memory::{TableContent, TableRequest};
use super::objects::ObjectIds;
use super::pcd;
use super::request::{OutputRequest, PacketPlace, PointFormat, Target};
use super::stream::Destination;
use super::summary::FileSummary;
use super::text;
use ::arrow_schema::SchemaRef;
use std::collections::BTreeSet;
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use vlscan_base::crs;
use vlscan_base::diag::{Diagnostics, ProblemKind};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileSet, NewFolder, identity, is_special, reads, remove_litter};
use vlscan_geom::{Aabb, DVec3};

/// All outputs of a run: files, contents and formats. Immutable and shared by the workers.
#[derive(Debug)]
pub struct OutputPlan {
    pub(super) layout: OutputLayout,
    pub(super) legs: Vec<LegFacts>,
    pub(super) shift: DVec3,
    /// Ids of the scene's parts as text fields.
    pub(super) part_names: Vec<Box<[u8]>>,
    /// Ids of the scene's parts as integers.
    pub(super) objects: ObjectIds,
    pub(super) las: LasFormat,
    /// What coordinates of PCD are relative to, m.
    pub(super) pcd_offset: DVec3,
    /// Duration of a frame of MCAP in each leg, ns.
    frames_ns: Vec<f64>,
    pub(super) columns: Vec<Column>,
    /// Whether the user chose the columns.
    pub(super) columns_chosen: bool,
    /// Arrow schema: the columns with their metadata.
    pub(super) schema: SchemaRef,
    /// Whether pulses without echoes are written.
    pub(super) misses: bool,
    /// Whether points are counted by part.
    pub(super) counts_parts: bool,
    /// Whether PLY has the labels part, primitive and true range.
    pub(super) labels: bool,
    /// Whether LAS and PLY have the height above the ground.
    pub(super) heights: bool,
    /// The division of points among the files of folders.
    pub(super) divider: Option<Divider>,
    /// Where points are kept.
    pub(super) clip: Option<Ring>,
    pub(super) live: bool,
    /// Name of the coordinate reference system: its EPSG code, if it has one.
    pub(super) crs_name: Option<String>,
    warnings: Diagnostics,
    pub(super) force: bool,
    /// Whether files that exist stay if they hold the same bytes.
    pub(super) goes_on: bool,
    pub(super) run_stamp: Option<String>,
    /// The head of a shard.
    pub(super) shard_head: Vec<u8>,
    pub(super) tables: Vec<TableRequest>,
    pub(super) epochs: u32,
    /// Partial files that a failed run left.
    pub(super) rescued: Mutex<Vec<FileSummary>>,
}

impl OutputPlan {
    /// Plans every file and performs all checks that are possible before the run: existing files, duplicate names,
    /// missing directories, binary formats on a terminal. All problems are reported together, and nothing is written.
    ///
    /// # Errors
    /// [`Error::Input`].
    pub fn new(request: OutputRequest, context: &OutputContext) -> Result<OutputPlan> {
        let mut problems = Diagnostics::default();
        let objects = ObjectIds::new(&context.parts);
        let divider = divider(&request, context, &objects, &mut problems);
        let layout = OutputLayout::new(&request, context, divider.as_ref().map(|d| &d.names[..]));
        check_requests(&request, context, &mut problems);
        let inputs = Inputs::of(&request);
        check_files(&layout, &request, &inputs, &mut problems);
        let mut las_problems = Diagnostics::default();
        let wkt = request.crs_wkt.as_deref().or(context.crs.as_deref());
        if let (Some(chosen), Some(named)) = (&request.crs_wkt, &context.crs)
            && crs::differ(chosen, named)
        {
            let message =
                format!("--crs says {}, what was measured is in {}", crs::name(chosen), crs::name(named));
            problems.warn(None, message).help("leave out --crs: nothing is projected");
        }
        let las = LasFormat::new(&request, context, wkt, &objects, &mut las_problems);
        if request.sinks.iter().any(|(_, format)| format.is_las()) {
            problems.extend(las_problems);
            if las.packet_place() == Some(PacketPlace::Beside) {
                check_packets(&layout, request.force || request.goes_on, &inputs, &mut problems);
            }
        }
        let warnings = problems.finish(false)?;
        let Aabb { min, max } = context.bounds;
        let world = Aabb { min: min + context.shift, max: max + context.shift };
        let columns = request.columns.clone().unwrap_or_else(|| {
            let mut columns = Column::default_columns(request.misses);
            columns.extend(request.heights.then_some(Column::HeightAboveGround));
            columns
        });
        let about = About { scanner: &context.scanner, crs: wkt, objects: &objects };
        let schema = schema(&columns, &about);
        Ok(OutputPlan {
            layout,
            legs: context.legs.iter().map(|leg| LegFacts::new(leg.number)).collect(),
            shift: context.shift,
            part_names: context.parts.iter().map(|part| text::label(part)).collect(),
            objects,
            las,
            pcd_offset: pcd::offset(&world),
            frames_ns: context
                .legs
                .iter()
                .map(|leg| request.frame_s.or(leg.revolution_s).unwrap_or(mcap::FRAME_S) * 1e9)
                .collect(),
            columns,
            columns_chosen: request.columns.is_some(),
            schema,
            misses: request.misses,
            counts_parts: request.counts_parts,
            labels: request.labels,
            heights: request.heights,
            divider,
            clip: request.clip,
            live: request.live,
            crs_name: wkt.map(crs::short_name),
            warnings,
            force: request.force,
            goes_on: request.goes_on,
            run_stamp: request.run_stamp,
            shard_head: request.shard.map(|shard| shard.head).unwrap_or_default(),
            tables: request.tables,
            epochs: request.epochs.max(1),
            rescued: Mutex::default(),
        })
    }

    /// Whether points have their height above the ground.
    pub fn has_heights(&self) -> bool {
        self.heights || self.columns.contains(&Column::HeightAboveGround)
    }

    /// Duration of a frame of MCAP, ns.
    pub(super) fn frame_ns(&self, leg: u32) -> f64 {
        self.frames_ns.get(leg as usize).copied().unwrap_or(mcap::FRAME_S * 1e9)
    }

    /// Warnings about the request.
    pub fn warnings(&self) -> &Diagnostics {
        &self.warnings
    }

    /// Partial files that a failed run left, see [`Writer`](super::Writer).
    pub fn rescued(&self) -> Vec<FileSummary> {
        self.rescued.lock().map(|files| files.clone()).unwrap_or_default()
    }
}

/// Plans the division of points, which takes folders and whole points.
fn divider(
    request: &OutputRequest,
    context: &OutputContext,
    objects: &ObjectIds,
    problems: &mut Diagnostics,
) -> Option<Divider> {
    let division = request.division.as_ref()?;
    if !request.sinks.iter().any(|(target, _)| matches!(target, Target::Directory(_))) {
        problems
            .error(None, "points are divided among the files of a folder, and there is none")
            .help("-o DIR, with --format");
        return None;
    }
    if request.las.packets.is_some() || request.split_by_channel || request.misses {
        problems.error(
            None,
            "divided points have neither waveform packets nor files per channel, and missed pulses have no place",
        );
        return None;
    }
    let made = Divider::new(division, &context.bounds, context.shift, objects);
    made.map_err(|message| problems.error(None, message)).ok()
}

fn check_requests(request: &OutputRequest, context: &OutputContext, problems: &mut Diagnostics) {
    let streams = |target: &Target| *target == Target::Stdout;
    for (asked, what) in [(request.waveforms, "waveforms"), (request.pulses, "pulses")] {
        if asked && request.sinks.iter().all(|(target, _)| streams(target)) {
            problems
                .error(None, format!("{what} are written beside a point file, and there is none"))
                .help("name a file or a directory for the points");
        }
    }
    if matches!(request.trajectory, Some((Target::Helios(_), _))) {
        problems.error(
            None,
            "a run directory has its trajectories already; name a file or a directory for others",
        );
    }
    let wants_heights = request.heights
        || request.columns.iter().flatten().any(|column| *column == Column::HeightAboveGround);
    if wants_heights && !context.has_ground {
        problems.error(None, "heights above the ground need the scene: merges and streams have none");
    }
    let has_no_time = request.columns.as_ref().is_some_and(|columns| !columns.contains(&Column::GpsTime));
    for seconds in request.tables.iter().filter_map(|table| table.batch_seconds) {
        if has_no_time {
            problems.error(None, "batches that end with intervals of time need the column GpsTime");
        }
        if !(seconds.is_finite() && seconds > 0.0) {
            problems.error(None, format!("an interval of time is {seconds} s, expected more than 0"));
        }
    }
    let has_table = request.tables.iter().any(|table| table.content == TableContent::Points);
    let has_columns = has_table || request.sinks.iter().any(|(_, format)| format.has_columns());
    if request.columns.is_some() && !has_columns {
        problems
            .error(
                None,
                "columns can be chosen for text, CSV, Arrow and Parquet, and none of them is written",
            )
            .help("-o points.csv, .xyz, .arrow or .parquet");
    }
    let has_frames = request.sinks.iter().any(|(_, format)| *format == PointFormat::Mcap);
    if request.frame_s.is_some() && !has_frames && request.shard.is_none() {
        problems.error(None, "frames have a duration in MCAP, and none is written").help("-o points.mcap");
    }
    if request.split_by_channel
        && context.devices.len() > 1
        && request.sinks.iter().any(|(target, _)| streams(target))
    {
        problems.error(None, "points on standard output cannot be split by channel");
    }
    let binary = |(target, format): &(Target, PointFormat)| streams(target) && !format.is_text();
    if request.sinks.iter().any(binary) && !request.force && std::io::stdout().is_terminal() {
        problems
            .error(None, "binary points would go to the terminal")
            .help("redirect standard output, or insist with --force");
    }
}

/// The files that a run reads, none of which an output may replace.
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
    let may_exist = request.force || request.goes_on;
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
                    .error(None, "waveform packets cannot be written beside standard output")
                    .help("write them inside: --wave-packets inside");
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
    if is_special(path) {
        return;
    }
    let shown = path.display();
    if path.is_dir() {
        problems.error(None, format!("{shown} is a directory, expected a file"));
        return;
    }
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() && !made.iter().any(|d| d == folder) {
        problems
            .error(None, format!("{} is not a directory, so {shown} cannot be written", folder.display()));
    }
    if !may_exist && path.exists() {
        let problem = problems.error(None, format!("{shown} exists already")).of_kind(ProblemKind::Exists);
        problem.help("overwrite it with --force");
    }
}

/// Returns the name of a run directory created now: local time, to the second.
pub(super) fn stamp() -> String {
    chrono::Local::now().format("%Y-%m-%d_%H-%M-%S").to_string()
}

/// Creates `parent/stamp`, or the first of `parent/stamp_2` … `parent/stamp_99` that does not exist. Returns its path
/// and the folders that were created, inner ones first. Run directories of killed runs lose their temporary files.
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
