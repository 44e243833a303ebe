//! The files of a run, and the assignment of legs and devices to them (spec outputs §1).

use super::context::{OutputContext, OutputLeg};
use super::request::{OutputRequest, TableContent, TableRequest, Target, TrajectoryFormat};
use super::summary::FileKind;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use vlscan_base::files::{identity, is_special, is_stdout, with_suffix};
use vlscan_formats::{Destination, PointFormat};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Content {
    Points(PointFormat),
    Trajectory(TrajectoryFormat),
    Waveforms,
    Pulses,
    /// Batches of a shard of a run.
    Shard,
    /// A table in memory.
    Table(TableContent),
}

impl Content {
    pub fn kind(self) -> FileKind {
        match self {
            Content::Points(_) | Content::Table(TableContent::Points) => FileKind::Points,
            Content::Trajectory(_) | Content::Table(TableContent::Trajectory) => FileKind::Trajectory,
            Content::Waveforms | Content::Table(TableContent::Waveforms) => FileKind::Waveforms,
            Content::Pulses | Content::Table(TableContent::Pulses) => FileKind::Pulses,
            Content::Shard => FileKind::Shard,
        }
    }
}

/// Location of a file. The path of a run directory is known only once it has been created.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum OutputLocation {
    /// A stream or a named file.
    Fixed(Destination),
    /// A file in run directory `run` of [`OutputLayout::runs`].
    Run { run: usize, name: String },
    /// The table of this number in memory.
    Memory(usize),
}

impl fmt::Display for OutputLocation {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            OutputLocation::Fixed(Destination::Stdout) => f.write_str("standard output"),
            OutputLocation::Fixed(Destination::Path(path)) => path.display().fmt(f),
            OutputLocation::Run { name, .. } => write!(f, "{name} of the run directory"),
            OutputLocation::Memory(number) => write!(f, "table {number} in memory"),
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct FilePlan {
    pub location: OutputLocation,
    pub content: Content,
    /// True if the lines of the file are compressed.
    pub zipped: bool,
    /// Index of the last leg that writes to the file.
    pub last_leg: usize,
    /// Number of the sink that requested the file; two sinks must not share a file.
    pub sink: usize,
    /// True if it is one of the files of a divided folder.
    pub divided: bool,
}

/// The files of the points of a leg, by index in [`OutputLayout::files`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Slots {
    /// One file for all devices.
    One(u32),
    /// One file per device, by index of the device.
    PerDevice(Vec<u32>),
    /// One file per tile or object, see [`super::division`]; all legs share the list.
    Divided(Arc<[u32]>),
}

impl Slots {
    pub fn as_slice(&self) -> &[u32] {
        match self {
            Slots::One(slot) => std::slice::from_ref(slot),
            Slots::PerDevice(slots) => slots,
            Slots::Divided(slots) => slots,
        }
    }

    /// Returns the index, within these files, of the one with the points of a device.
    pub fn index_of(&self, device: u32) -> usize {
        match self {
            Slots::One(_) | Slots::Divided(_) => 0,
            Slots::PerDevice(_) => device as usize,
        }
    }
}

/// One product of a leg.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Route {
    pub content: Content,
    pub slots: Slots,
}

/// A run directory to be created: `output/<survey>/<time>`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct RunPlan {
    /// `output/<survey>`.
    pub parent: PathBuf,
}

#[derive(Debug, Default)]
pub(super) struct OutputLayout {
    pub files: Vec<FilePlan>,
    /// Products of each leg, by index of the leg.
    pub routes: Vec<Vec<Route>>,
    pub runs: Vec<RunPlan>,
    /// Directories that must exist before files are opened.
    pub directories: Vec<PathBuf>,
    /// Files requested by more than one sink.
    pub clashes: Vec<OutputLocation>,
    slots: BTreeMap<OutputLocation, u32>,
    /// True if waveforms and pulses are compressed.
    zip: bool,
}

enum Base {
    Stdout,
    /// A single file for all legs.
    Single(PathBuf),
    Folder(PathBuf),
    Run(usize),
}

impl OutputLayout {
    /// Computes the layout of all requested outputs.
    ///
    /// `divided` are the names of files in folders, which replace the names by legs.
    pub fn new(request: &OutputRequest, context: &OutputContext, divided: Option<&[String]>) -> OutputLayout {
        let mut layout = OutputLayout {
            routes: vec![Vec::new(); context.legs.len()],
            zip: request.zip,
            ..OutputLayout::default()
        };
        if let Some(shard) = &request.shard {
            layout.product(0, &Base::Single(shard.path.clone()), Content::Shard, false, context);
            return layout;
        }
        let devices: Vec<String> = context.devices.iter().map(|d| file_name(&d.id)).collect();
        let split = if request.split_by_channel && devices.len() > 1 { &devices[..] } else { &[] };
        let mut companion = None;
        for (sink, (target, format)) in request.sinks.iter().enumerate() {
            let runs = layout.runs.len();
            let base = layout.base(target, context);
            match (&base, divided) {
                (Base::Folder(_), Some(names)) => layout.divided(sink, &base, *format, context, names),
                _ => layout.points(sink, &base, *format, context, split),
            }
            // Sinks with the same run directory share its trajectories.
            if layout.runs.len() > runs {
                let trajectory = Content::Trajectory(TrajectoryFormat::Helios);
                layout.product(sink, &base, trajectory, true, context);
            }
            if companion.is_none() && !matches!(base, Base::Stdout) {
                companion = Some((sink, base));
            }
        }
        if let Some((sink, base)) = &companion {
            if request.waveforms {
                layout.product(*sink, base, Content::Waveforms, true, context);
            }
            if request.pulses {
                layout.product(*sink, base, Content::Pulses, true, context);
            }
        }
        if let Some((target, format)) = &request.trajectory {
            let base = layout.base(target, context);
            layout.product(request.sinks.len(), &base, Content::Trajectory(*format), false, context);
        }
        layout.tables(request);
        layout
    }

    /// Adds the tables in memory, to which all legs contribute.
    fn tables(&mut self, request: &OutputRequest) {
        for (number, TableRequest { content, .. }) in request.tables.iter().enumerate() {
            // Without other outputs the points of the first table are counted in the summary.
            let sink = if request.sinks.is_empty() { number } else { request.sinks.len() + 1 + number };
            for leg in 0..self.routes.len() {
                let slot = self.slot(sink, OutputLocation::Memory(number), Content::Table(*content), leg);
                self.routes[leg].push(Route { content: Content::Table(*content), slots: Slots::One(slot) });
            }
        }
    }

    fn base(&mut self, target: &Target, context: &OutputContext) -> Base {
        match target {
            Target::Stdout => Base::Stdout,
            Target::File(path) if is_stdout(path) => Base::Stdout,
            Target::File(path) => Base::Single(path.clone()),
            Target::Directory(path) => {
                self.directories.push(path.clone());
                Base::Folder(path.clone())
            }
            Target::Helios(path) => {
                let run = RunPlan { parent: path.join(file_name(&context.survey)) };
                let known = self.runs.iter().position(|r| *r == run);
                Base::Run(known.unwrap_or_else(|| {
                    self.runs.push(run);
                    self.runs.len() - 1
                }))
            }
        }
    }

    fn points(
        &mut self,
        sink: usize,
        base: &Base,
        format: PointFormat,
        context: &OutputContext,
        split: &[String],
    ) {
        let content = Content::Points(format);
        for (index, leg) in base.legs(context) {
            let mut slot = |device: &str| {
                let location = match base {
                    Base::Single(path) => at_path(with_suffix(path, device, None)),
                    _ => base.inside(format!("{}_points{device}.{}", prefix(leg), format.extension())),
                };
                self.slot(sink, location, content, index)
            };
            let slots = match (base, split) {
                (Base::Stdout, _) | (_, []) => Slots::One(slot("")),
                (_, ids) => Slots::PerDevice(ids.iter().map(|id| slot(&format!("_dev{id}"))).collect()),
            };
            self.routes[index].push(Route { content, slots });
        }
    }

    /// Files and folders that are filled; `-` is standard output. Pipes and devices, which many can write to,
    /// are left out.
    pub fn places(&self) -> BTreeSet<PathBuf> {
        let files = self.files.iter().filter_map(|file| match &file.location {
            OutputLocation::Fixed(Destination::Stdout) => Some(PathBuf::from("-")),
            OutputLocation::Fixed(Destination::Path(path)) if !is_special(path) => Some(identity(path)),
            _ => None,
        });
        let folders = self.directories.iter().chain(self.runs.iter().map(|run| &run.parent));
        files.chain(folders.map(|path| identity(path))).collect()
    }

    /// Adds the files of a folder whose points are divided, to which all legs contribute.
    fn divided(
        &mut self,
        sink: usize,
        base: &Base,
        format: PointFormat,
        context: &OutputContext,
        names: &[String],
    ) {
        let (content, last) = (Content::Points(format), context.legs.len().saturating_sub(1));
        let mut slots = Vec::with_capacity(names.len());
        for name in names {
            let location = base.inside(format!("{name}.{}", format.extension()));
            let slot = self.slot(sink, location, content, last);
            self.files[slot as usize].divided = true;
            slots.push(slot);
        }
        let slots: Arc<[u32]> = slots.into();
        for routes in &mut self.routes {
            routes.push(Route { content, slots: Slots::Divided(slots.clone()) });
        }
    }

    /// Adds a product other than points. With `companion`, its name derives from the point file. The names
    /// are the same as in HELIOS++.
    fn product(
        &mut self,
        sink: usize,
        base: &Base,
        content: Content,
        companion: bool,
        context: &OutputContext,
    ) {
        let (suffix, extension) = match content {
            Content::Waveforms => ("fullwave", if self.zip { "bin" } else { "txt" }),
            Content::Pulses => ("pulse", if self.zip { "bin" } else { "txt" }),
            Content::Trajectory(TrajectoryFormat::Csv) => ("trajectory", "csv"),
            _ => ("trajectory", "txt"),
        };
        for (index, leg) in base.legs(context) {
            let location = match base {
                Base::Single(path) if companion => {
                    at_path(with_suffix(path, &format!("_{suffix}"), Some(extension)))
                }
                _ => base.inside(format!("{}_{suffix}.{extension}", prefix(leg))),
            };
            let slot = self.slot(sink, location, content, index);
            self.routes[index].push(Route { content, slots: Slots::One(slot) });
        }
    }

    /// Returns the index of the file at `location`, shared by legs of one strip and by devices with the same
    /// id.
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
        let zipped = self.zip && matches!(content, Content::Waveforms | Content::Pulses);
        self.files.push(FilePlan {
            location: location.clone(),
            content,
            zipped,
            last_leg: leg,
            sink,
            divided: false,
        });
        self.slots.insert(location, slot);
        slot
    }
}

impl Base {
    /// Returns the legs that have files. A single file takes all legs, so that it exists even if no leg is
    /// active.
    fn legs<'c>(&self, context: &'c OutputContext) -> impl Iterator<Item = (usize, &'c OutputLeg)> + use<'c> {
        let all = matches!(self, Base::Stdout | Base::Single(_));
        context.legs.iter().enumerate().filter(move |(_, leg)| all || leg.active)
    }

    fn inside(&self, name: String) -> OutputLocation {
        match self {
            Base::Run(run) => OutputLocation::Run { run: *run, name },
            Base::Folder(folder) => at_path(folder.join(name)),
            Base::Single(path) => at_path(path.clone()),
            Base::Stdout => OutputLocation::Fixed(Destination::Stdout),
        }
    }
}

fn at_path(path: PathBuf) -> OutputLocation {
    OutputLocation::Fixed(Destination::Path(path))
}

/// Returns the file name prefix of a leg: `leg007` or `stripABC`.
fn prefix(leg: &OutputLeg) -> String {
    match &leg.strip {
        Some(strip) => format!("strip{:0>3}", file_name(strip)),
        None => format!("leg{:03}", leg.number),
    }
}

/// Escapes separators in a name from the input, for use in a file name.
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
