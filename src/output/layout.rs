//! Which files a run writes, and which leg and device goes to which of them (spec outputs §1).

use super::request::{OutputRequest, PointFormat, Target, TrajectoryFormat};
use super::stream::Destination;
use super::summary::FileKind;
use crate::survey::{Leg, Survey};
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// What a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Content {
    Points(PointFormat),
    Trajectory(TrajectoryFormat),
    Waveforms,
    Pulses,
}

impl Content {
    pub fn kind(self) -> FileKind {
        match self {
            Content::Points(_) => FileKind::Points,
            Content::Trajectory(_) => FileKind::Trajectory,
            Content::Waveforms => FileKind::Waveforms,
            Content::Pulses => FileKind::Pulses,
        }
    }
}

/// Where a file belongs; the place of a run directory is known only when it has been made.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum OutputLocation {
    /// A stream or a named file.
    Fixed(Destination),
    /// A file in run directory `run` of [`Layout::runs`].
    Run { run: usize, name: String },
}

/// One file to be written.
#[derive(Clone, Debug)]
pub(super) struct FilePlan {
    pub location: OutputLocation,
    pub content: Content,
    /// Whether it is compressed text.
    pub zipped: bool,
    /// The last leg that writes into it.
    pub last_leg: usize,
    /// Number of the sink that asked for it; two sinks may not share a file.
    pub sink: usize,
}

/// Which files take the points of a leg.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Slots {
    /// One file for all devices.
    One(u32),
    /// One file for each device, by index.
    PerDevice(Vec<u32>),
}

impl Slots {
    /// The files.
    pub fn as_slice(&self) -> &[u32] {
        match self {
            Slots::One(slot) => std::slice::from_ref(slot),
            Slots::PerDevice(slots) => slots,
        }
    }

    /// Index among them of the file that takes the points of a device.
    pub fn index_of(&self, device: u32) -> usize {
        match self {
            Slots::One(_) => 0,
            Slots::PerDevice(_) => device as usize,
        }
    }
}

/// One product of a leg.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Route {
    Points(PointFormat, Slots),
    Trajectory(TrajectoryFormat, u32),
    Waveforms(u32),
    Pulses(u32),
}

impl Route {
    /// The files of the product.
    pub fn slots(&self) -> &[u32] {
        match self {
            Route::Points(_, slots) => slots.as_slice(),
            Route::Trajectory(_, slot) | Route::Waveforms(slot) | Route::Pulses(slot) => {
                std::slice::from_ref(slot)
            }
        }
    }
}

/// A run directory to be made: `output/<survey>/<time>`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct RunPlan {
    /// `output/<survey>`.
    pub parent: PathBuf,
}

/// All files and who writes into them.
#[derive(Debug, Default)]
pub(super) struct Layout {
    pub files: Vec<FilePlan>,
    /// Products of each leg, by index of the leg.
    pub routes: Vec<Vec<Route>>,
    pub runs: Vec<RunPlan>,
    /// Directories that must exist before files are opened.
    pub directories: Vec<PathBuf>,
    /// Files that more than one sink asks for.
    pub clashes: Vec<OutputLocation>,
    slots: BTreeMap<OutputLocation, u32>,
    /// Waveforms and pulses are compressed.
    zip: bool,
}

/// Where the files of one sink go.
enum Base {
    Stdout,
    /// A single file for all legs.
    Single(PathBuf),
    Folder(PathBuf),
    Run(usize),
}

impl Layout {
    /// Lays out everything that is asked for.
    pub fn new(request: &OutputRequest, survey: &Survey) -> Layout {
        let mut layout =
            Layout { routes: vec![Vec::new(); survey.legs.len()], zip: request.zip, ..Layout::default() };
        let devices: Vec<String> = survey.scanner.devices.iter().map(|d| file_name(&d.id)).collect();
        let split = if request.split_by_channel && devices.len() > 1 { &devices[..] } else { &[] };
        let mut beside = None;
        for (sink, (target, format)) in request.sinks.iter().enumerate() {
            let runs = layout.runs.len();
            let base = layout.base(target, survey);
            layout.points(sink, &base, *format, survey, split);
            // Sinks that share a run directory share its trajectories.
            if layout.runs.len() > runs {
                layout.product(sink, &base, Content::Trajectory(TrajectoryFormat::Helios), survey);
            }
            if beside.is_none() && !matches!(base, Base::Stdout) {
                beside = Some((sink, base));
            }
        }
        if let Some((sink, base)) = &beside {
            let wanted = [(request.waveforms, Content::Waveforms), (request.pulses, Content::Pulses)];
            wanted
                .iter()
                .filter(|(asked, _)| *asked)
                .for_each(|(_, c)| layout.product(*sink, base, *c, survey));
        }
        if let Some((target, format)) = &request.trajectory {
            let base = layout.base(target, survey);
            layout.trajectory(request.sinks.len(), &base, *format, survey);
        }
        layout
    }

    fn base(&mut self, target: &Target, survey: &Survey) -> Base {
        match target {
            Target::Stdout => Base::Stdout,
            Target::File(path) if is_stdout(path) => Base::Stdout,
            Target::File(path) => Base::Single(path.clone()),
            Target::Directory(path) => {
                self.directories.push(path.clone());
                Base::Folder(path.clone())
            }
            Target::Helios(path) => {
                let run = RunPlan { parent: path.join(survey_name(survey)) };
                let known = self.runs.iter().position(|r| *r == run);
                Base::Run(known.unwrap_or_else(|| {
                    self.runs.push(run);
                    self.runs.len() - 1
                }))
            }
        }
    }

    fn points(&mut self, sink: usize, base: &Base, format: PointFormat, survey: &Survey, split: &[String]) {
        let content = Content::Points(format);
        for (index, leg) in base.legs(survey) {
            let mut slot = |device: &str| {
                let location = match base {
                    Base::Stdout => OutputLocation::Fixed(Destination::Stdout),
                    Base::Single(path) => {
                        OutputLocation::Fixed(Destination::Path(with_suffix(path, device, None)))
                    }
                    _ => base.inside(format!("{}_points{device}.{}", prefix(leg), format.extension())),
                };
                self.slot(sink, location, content, index)
            };
            let slots = match (base, split) {
                (Base::Stdout, _) | (_, []) => Slots::One(slot("")),
                (_, ids) => Slots::PerDevice(ids.iter().map(|id| slot(&format!("_dev{id}"))).collect()),
            };
            self.routes[index].push(Route::Points(format, slots));
        }
    }

    /// A product beside the points, with the reference's file names.
    fn product(&mut self, sink: usize, base: &Base, content: Content, survey: &Survey) {
        let extension = if self.zips(content) { "bin" } else { "txt" };
        let suffix = match content {
            Content::Waveforms => "fullwave",
            Content::Pulses => "pulse",
            _ => "trajectory",
        };
        for (index, leg) in base.legs(survey) {
            let location = match base {
                Base::Stdout => OutputLocation::Fixed(Destination::Stdout),
                Base::Single(path) => OutputLocation::Fixed(Destination::Path(with_suffix(
                    path,
                    &format!("_{suffix}"),
                    Some(extension),
                ))),
                _ => base.inside(format!("{}_{suffix}.{extension}", prefix(leg))),
            };
            self.route(sink, location, content, index);
        }
    }

    /// Whether files of that content are compressed text.
    fn zips(&self, content: Content) -> bool {
        match content {
            Content::Points(format) => format == PointFormat::Bin,
            Content::Waveforms | Content::Pulses => self.zip,
            Content::Trajectory(_) => false,
        }
    }

    fn trajectory(&mut self, sink: usize, base: &Base, format: TrajectoryFormat, survey: &Survey) {
        let extension = match format {
            TrajectoryFormat::Helios => "txt",
            TrajectoryFormat::Csv => "csv",
        };
        for (index, leg) in base.legs(survey) {
            let location = match base {
                Base::Stdout => OutputLocation::Fixed(Destination::Stdout),
                Base::Single(path) => OutputLocation::Fixed(Destination::Path(path.clone())),
                _ => base.inside(format!("{}_trajectory.{extension}", prefix(leg))),
            };
            self.route(sink, location, Content::Trajectory(format), index);
        }
    }

    fn route(&mut self, sink: usize, location: OutputLocation, content: Content, leg: usize) {
        let slot = self.slot(sink, location, content, leg);
        let route = match content {
            Content::Points(format) => Route::Points(format, Slots::One(slot)),
            Content::Trajectory(format) => Route::Trajectory(format, slot),
            Content::Waveforms => Route::Waveforms(slot),
            Content::Pulses => Route::Pulses(slot),
        };
        self.routes[leg].push(route);
    }

    /// The file at `location`, which legs of one strip and devices with one id share.
    fn slot(&mut self, sink: usize, location: OutputLocation, content: Content, leg: usize) -> u32 {
        if let Some(&slot) = self.slots.get(&location) {
            let file = &mut self.files[slot as usize];
            file.last_leg = file.last_leg.max(leg);
            if (file.sink, file.content) != (sink, content) && !self.clashes.contains(&location) {
                self.clashes.push(location);
            }
            return slot;
        }
        let slot = self.files.len() as u32;
        let zipped = self.zips(content);
        self.files.push(FilePlan { location: location.clone(), content, zipped, last_leg: leg, sink });
        self.slots.insert(location, slot);
        slot
    }
}

impl Base {
    /// The legs that have files there: a single file takes every leg, so that it exists even if none is active.
    fn legs<'s>(&self, survey: &'s Survey) -> impl Iterator<Item = (usize, &'s Leg)> + use<'s> {
        let all = matches!(self, Base::Stdout | Base::Single(_));
        survey.legs.iter().enumerate().filter(move |(_, leg)| all || leg.scanner.active)
    }

    fn inside(&self, name: String) -> OutputLocation {
        match self {
            Base::Run(run) => OutputLocation::Run { run: *run, name },
            Base::Folder(folder) => OutputLocation::Fixed(Destination::Path(folder.join(name))),
            Base::Single(path) => OutputLocation::Fixed(Destination::Path(path.clone())),
            Base::Stdout => OutputLocation::Fixed(Destination::Stdout),
        }
    }
}

/// `leg007` or `stripABC`: what the files of a leg begin with.
fn prefix(leg: &Leg) -> String {
    match &leg.strip {
        Some(strip) => format!("strip{:0>3}", file_name(strip)),
        None => format!("leg{:03}", leg.number),
    }
}

/// The folder of a survey's runs.
fn survey_name(survey: &Survey) -> String {
    if survey.name.is_empty() {
        return file_name(&survey.path.file_name().unwrap_or_default().to_string_lossy());
    }
    file_name(&survey.name)
}

/// A name from the input as part of a file name, which never leaves its folder.
fn file_name(name: &str) -> String {
    if name.is_empty() || name.chars().all(|c| c == '.') {
        return format!("_{name}");
    }
    let mut clean = String::with_capacity(name.len());
    for c in name.chars() {
        if matches!(c, '/' | '\\') || c.is_control() {
            clean.push_str(&format!("%{:02X}", u32::from(c)));
        } else {
            clean.push(c);
        }
    }
    clean
}

/// `dir/stem.ext` with `suffix` after the stem, and another extension if given.
fn with_suffix(path: &Path, suffix: &str, extension: Option<&str>) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default();
    // Two extensions that belong together
    if let Some(stem) = stem.to_str().and_then(|stem| stem.strip_suffix(".copc"))
        && path.extension() == Some(OsStr::new("laz"))
    {
        let extension = extension.unwrap_or("copc.laz");
        return path.with_file_name(format!("{stem}{suffix}.{extension}"));
    }
    let mut name = stem.to_os_string();
    name.push(suffix);
    if let Some(extension) = extension.map(OsStr::new).or(path.extension()) {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

/// Names of standard output that cannot be written under another name first.
fn is_stdout(path: &Path) -> bool {
    ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"].iter().any(|name| path == Path::new(name))
}
