//! Computes a cell: its scene, its survey, its points and the table of its objects.

use super::super::args::{Cli, Command, RunArgs, SceneArgs, SceneCommand};
use super::super::{Console, interrupt, plan, scene, stand};
use super::labels::{Labels, objects};
use super::{is_of_machine, near};
use crate::options::{Options, Seed, Switch, read_survey};
use crate::output::{FileKind, PointFormat};
use crate::pipeline::{LoadedScene, PartTable, Progress, Report, ResolvedRun, RunContext, Session};
use clap::{Parser, ValueEnum};
use std::any::Any;
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, Patched, Reads, Recording};
use vlscan_geom::Aabb;
use vlscan_tools::campaign::{Cell, File, FileRecord, Inputs, Record, SceneEntry, checksum, words};

/// Why a cell has failed.
pub struct Failure {
    pub error: Error,
    /// Whether the same inputs give the same error again. It is not kept otherwise, so that the next start computes the cell.
    pub is_lasting: bool,
}

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        Failure { error, is_lasting: true }
    }
}

/// Computes the cells of a campaign one after the other.
pub struct CellRunner<'c> {
    pub file: &'c File,
    format: PointFormat,
    threads: Option<usize>,
    console: &'c Console,
    /// The folder of the campaign's file, in which the process works.
    pub folder: PathBuf,
    /// The last scene from a file, which the next cell may scan, too.
    loaded: Option<(String, LoadedScene)>,
    /// Warnings that have been shown.
    warned: BTreeSet<String>,
    /// What was read of the scene that the present cell shares with an earlier one.
    reused: Option<Reads>,
}

/// A scene that is ready to be scanned.
struct Site {
    /// As `--scene` takes it.
    name: String,
    /// Whether other cells scan the same.
    is_shared: bool,
    labels: Labels,
}

impl<'c> CellRunner<'c> {
    /// # Errors
    /// An unknown format.
    pub fn new(file: &'c File, threads: Option<usize>, console: &'c Console) -> Result<CellRunner<'c>> {
        let format = PointFormat::from_str(&file.format, true).map_err(|_| {
            Error::input(format!("no format is called {}; choose {}", file.format, PointFormat::names()))
        })?;
        let folder = std::env::current_dir().map_err(|e| Error::open(Path::new("."), e))?;
        Ok(CellRunner {
            file,
            format,
            threads,
            console,
            folder,
            loaded: None,
            warned: BTreeSet::new(),
            reused: None,
        })
    }

    /// Threads of this process.
    pub fn threads(&self) -> usize {
        let all = || std::thread::available_parallelism().map_or(1, usize::from);
        self.threads.filter(|threads| *threads > 0).unwrap_or_else(all)
    }

    /// The warnings and notes of the last cell that no cell before it had, each in a line; files are named from the campaign's
    /// folder, those in `work` from there.
    pub fn new_warnings(&mut self, work: &Path) -> Vec<String> {
        let mut found = Vec::new();
        for item in self.console.take_warnings().items() {
            let line = near(item.line().trim_end(), &[work, &self.folder]);
            if self.warned.insert(line.clone()) {
                found.push(line);
            }
        }
        found
    }

    /// Computes a cell into the folder `out` within `work` and completes its record.
    ///
    /// # Errors
    /// Those of the commands that the campaign names; [`Error::Internal`] for a panic; inputs that change meanwhile.
    pub fn compute(
        &mut self,
        cell: &Cell,
        record: &mut Record,
        work: &Path,
        inputs: &mut Inputs,
    ) -> Result<(), Failure> {
        let recording = Recording::start();
        let ended = catch_unwind(AssertUnwindSafe(|| self.make(cell, work)));
        let ended =
            ended.unwrap_or_else(|panic| Err(Error::Internal(format!("a panic: {}", text_of(&*panic)))));
        let mut reads = recording.reads();
        drop(recording);
        // The scene may have been read for an earlier cell.
        reads.extend(self.reused.take().unwrap_or_default());
        // What a cell that failed has read and looked for decides when it is computed again, too.
        let changed = inputs.note(&reads, record, work, &self.folder);
        if let Some(name) = changed.first() {
            return Err(Failure { error: changed_meanwhile(ended.err(), name), is_lasting: false });
        }
        let (report, files) = ended?;
        describe(cell, &report, record);
        record.files = files;
        Ok(())
    }

    /// Makes everything of a cell but its record.
    fn make(&mut self, cell: &Cell, work: &Path) -> Result<(Report, Vec<FileRecord>)> {
        let (site, report, table) = self.measure(cell, work)?;
        let out = work.join("out");
        let csv = objects(&table.csv(&report.summary.points_of_part), &site.labels, cell)?;
        let mut file = FileWriter::create(&out.join("objects.csv"), true, Patched::Never)?;
        file.append(csv.text.as_bytes())?;
        file.finish()?;
        let files = files(cell, &report, csv.rows, &out)?;
        Ok((report, files))
    }

    /// Makes the scene of a cell, unless it is a file.
    fn site(&self, cell: &Cell, work: &Path) -> Result<Site> {
        let SceneEntry { name, file, make, stand: placed, .. } = &*cell.scene;
        let margin_m = cell.scene.margin();
        let folder = work.join("scene");
        if let Some(line) = make {
            let options = ["-o".into(), text(&folder)?, "--seed".into(), cell.seed.to_string()];
            let args = scene_args(&["make"], line, &options)?;
            let SceneCommand::Make(made) = &args.command else { return Err(unexpected(name, "scene make")) };
            let id = made.kind.to_possible_value().map(|value| value.get_name().to_owned());
            let scene_file = format!("{}#{}", text(&folder.join("scene.xml"))?, id.unwrap_or_default());
            scene::run(&args, self.console)?;
            return Ok(Site { name: scene_file, is_shared: false, labels: Labels::default() });
        }
        if let Some(line) = placed {
            let options = ["-o".into(), text(&folder)?, "--seed".into(), cell.seed.to_string()];
            let args = scene_args(&["stand"], line, &options)?;
            let SceneCommand::Stand(args) = args.command else { return Err(unexpected(name, "scene stand")) };
            if args.epochs > 1 {
                return Err(Error::input(format!("scene {name}: a campaign scans one epoch of a stand")));
            }
            let stands = |[x, y]: [f64; 2]| match &cell.area {
                None => true,
                Some(area) => {
                    let (low, high) = area.bounds();
                    let reaches =
                        |v: f64, axis: usize| v >= low[axis] - margin_m && v <= high[axis] + margin_m;
                    reaches(x, 0) && reaches(y, 1)
                }
            };
            stand::make(&args, &stands, self.console)?;
            let labels = Labels::read(&folder.join("labels.csv"))?;
            let name = format!("{}#stand", text(&folder.join("stand.xml"))?);
            return Ok(Site { name, is_shared: false, labels });
        }
        let file = file.clone().unwrap_or_default();
        let (path, id) = file.split_once('#').map_or((file.as_str(), None), |(path, id)| (path, Some(id)));
        let path = text(&self.folder.join(path))?;
        let name = id.map_or(path.clone(), |id| format!("{path}#{id}"));
        Ok(Site { name, is_shared: true, labels: Labels::default() })
    }

    /// The survey of a cell: planned, or the variant's file.
    fn survey(&self, cell: &Cell, site: &Site, work: &Path) -> Result<PathBuf> {
        let Some(line) = &cell.variant.plan else {
            let path = cell.variant.survey.clone().unwrap_or_default();
            self.console.warnings(&decided_here(&path)?)?;
            return Ok(path);
        };
        let path = work.join("plan.toml");
        let mut options = vec!["--scene".to_owned(), site.name.clone(), "-o".to_owned(), text(&path)?];
        let typed = words(line).map_err(Error::input)?;
        let takes_area = typed.first().is_some_and(|kind| kind == "airborne" || kind == "terrestrial")
            && !typed.iter().any(|word| word.starts_with("--area") || word.starts_with("--around"));
        if let (Some(area), true) = (&cell.area, takes_area) {
            let corner = |[x, y]: &[f64; 2]| format!("{x} {y}");
            let corners: Vec<String> =
                area.corners().iter().chain(area.corners().first()).map(corner).collect();
            options.extend(["--area".to_owned(), format!("POLYGON (({}))", corners.join(", "))]);
        }
        let Command::Plan(args) = parsed(&["plan"], line, &options)? else {
            return Err(unexpected(&cell.variant.name, "plan"));
        };
        plan::make(&args, &format!("vlscan plan {line}"), self.console)?;
        Ok(path)
    }

    fn run_args(&self, cell: &Cell, site: &Site, survey: PathBuf, work: &Path) -> Result<RunArgs> {
        let line = format!("{} {}", self.file.run, cell.variant.run);
        let Command::Run(args) = parsed(&["run", &text(&survey)?], &line, &[])? else {
            return Err(unexpected(&cell.variant.name, "run"));
        };
        let mut run = *args;
        let output = &mut run.options.output;
        let is_divided = output.tile.is_some() || output.per_object.is_on();
        let out = work.join("out");
        output.out = vec![match is_divided {
            true => out.join("points"),
            false => out.join(format!("points.{}", self.format.extension())),
        }];
        output.format = Some(self.format);
        run.options.input.scene = Some(site.name.clone());
        if self.console.is_strict() {
            run.options.input.strict = Switch::On;
        }
        run.options.origin.seed = Some(Seed(cell.seed));
        if self.threads.is_some() {
            run.options.schedule.threads = self.threads;
        }
        Ok(run)
    }

    /// Makes the scene and the survey of a cell, and flies it.
    fn measure(&mut self, cell: &Cell, work: &Path) -> Result<(Site, Report, PartTable)> {
        let site = self.site(cell, work)?;
        let survey = self.survey(cell, &site, work)?;
        let run = self.run_args(cell, &site, survey, work)?;
        let (report, table) = self.fly(cell, &site, &run)?;
        Ok((site, report, table))
    }

    /// Flies the survey.
    fn fly(&mut self, cell: &Cell, site: &Site, run: &RunArgs) -> Result<(Report, PartTable)> {
        let (job, warnings) = ResolvedRun::resolve(&run.file, &run.options)?;
        self.console.warnings(&warnings)?;
        let ResolvedRun { settings, mut output, .. } = job;
        if output.trajectory.is_some() {
            return Err(Error::input(format!(
                "{}: its [[output]] of the trajectory names one file, which every cell would write; leave it out",
                run.file.display()
            )));
        }
        output.counts_parts = true;
        output.clip = cell.area.as_ref().map(|area| area.corners().to_vec());
        let is_same = |loaded: &LoadedScene| loaded.reads().are_unchanged();
        let known = self
            .loaded
            .as_ref()
            .filter(|(name, loaded)| site.is_shared && *name == site.name && is_same(loaded));
        if let Some((_, loaded)) = known {
            self.reused = Some(loaded.reads().clone());
        }
        let mut session = match known.filter(|(_, loaded)| loaded.suits(&settings)) {
            Some((_, loaded)) => Session::new(settings, loaded.clone(), self.console.observer())?,
            None => {
                self.loaded = None;
                Session::open(settings, self.console.observer())?
            }
        };
        if site.is_shared && self.loaded.is_none() {
            self.loaded = session.loaded().map(|loaded| (site.name.clone(), loaded));
        }
        let table = PartTable::new(session.scene());
        let progress = Progress::default();
        let report = session.run(output, RunContext::new(&progress, &interrupt::STOP))?;
        if report.interrupted {
            return Err(Error::Interrupted);
        }
        Ok((report, table))
    }

    /// Drops the scene that cells share, after a failure that may have to do with it.
    pub fn forget_scene(&mut self) {
        self.loaded = None;
    }
}

/// The error of a cell during which an input has changed, which may be the cause of its own error.
fn changed_meanwhile(own: Option<Error>, name: &str) -> Error {
    let text = format!(
        "{name} was written, touched or removed while the cell was computed; the next start computes the cell again"
    );
    match own {
        None => Error::input(text),
        Some(error) if is_of_machine(&error) => error,
        Some(Error::Input(mut found)) => {
            found.note(None, text);
            Error::Input(found)
        }
        Some(error) => Error::input(format!("{error}; {text}")),
    }
}

/// The message of a panic.
fn text_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "without a message".to_owned())
}

/// Warns of what a survey says and a campaign decides.
fn decided_here(path: &Path) -> Result<Diagnostics> {
    let (survey, options, _) = read_survey(path, Options::default())?;
    let mut found = Diagnostics::default();
    let place = || Some(Place::in_line(path, 0, "", 0..0));
    if let Some(seed) = options.origin.seed.map(|seed| seed.0).or(survey.seed) {
        let help = "`seeds` at the top of the campaign's file is what counts";
        found
            .warn(place(), format!("its seed {seed} is not used: a cell has one of the campaign's"))
            .help(help);
    }
    if !options.outputs.is_empty() {
        let help = "`format` at the top of the campaign's file names their format";
        found
            .warn(
                place(),
                "its [[output]] is not used: the files of a cell have their names from the campaign",
            )
            .help(help);
    }
    Ok(found)
}

/// Parses the words of a command as the command line does.
fn parsed(before: &[&str], line: &str, after: &[String]) -> Result<Command> {
    let typed = words(line).map_err(Error::input)?;
    let all = ["vlscan"].into_iter().chain(before.iter().copied()).map(str::to_owned);
    let all = all.chain(typed).chain(after.iter().cloned());
    let cli = Cli::try_parse_from(all).map_err(|e| {
        let message = e.to_string();
        let first = message.trim_start_matches("error: ").lines().take_while(|l| !l.is_empty());
        Error::input(format!("{} {line}: {}", before[0], first.collect::<Vec<_>>().join(" ")))
    })?;
    Ok(cli.command)
}

fn scene_args(kind: &[&str], line: &str, after: &[String]) -> Result<SceneArgs> {
    let before: Vec<&str> = ["scene"].into_iter().chain(kind.iter().copied()).collect();
    match parsed(&before, line, after)? {
        Command::Scene(args) => Ok(args),
        _ => Err(unexpected(line, "scene")),
    }
}

fn unexpected(name: &str, command: &str) -> Error {
    Error::input(format!("{name}: expected the options of vlscan {command}"))
}

/// A path in words.
fn text(path: &Path) -> Result<String> {
    let text = path.to_str().map(str::to_owned);
    text.ok_or_else(|| Error::input(format!("{}: its name is not UTF-8", path.display())))
}

/// Completes the counts of a record.
fn describe(cell: &Cell, report: &Report, record: &mut Record) {
    let is_points = |file: &&crate::output::FileSummary| file.kind == FileKind::Points;
    let of_points = report.summary.files.iter().filter(is_points);
    let bounds = of_points.fold(Aabb::EMPTY, |all, file| all.union(file.bounds));
    record.pulses = report.pulses;
    record.points = report.summary.points;
    let size = bounds.size();
    if record.points > 0 {
        record.bounds = Some([bounds.min.to_array(), bounds.max.to_array()]);
        record.area_m2 = size.x * size.y;
    }
    if let Some(area) = &cell.area {
        record.area_m2 = area.square_metres();
    }
    if record.area_m2 > 0.0 {
        record.points_per_m2 = record.points as f64 / record.area_m2;
    }
}

/// The files of a cell with their checksums, in order of their names.
fn files(cell: &Cell, report: &Report, rows: u64, out: &Path) -> Result<Vec<FileRecord>> {
    let mut all = Vec::new();
    let mut add = |path: &Path, records: u64| -> Result<()> {
        let near = path.strip_prefix(out).unwrap_or(path);
        let bytes = std::fs::metadata(path).map_err(|e| Error::open(path, e))?.len();
        let path = format!("cells/{}/{}", cell.name, near.display());
        all.push(FileRecord { path, records, bytes, sum: checksum(&out.join(near))? });
        Ok(())
    };
    for file in &report.summary.files {
        if let Some(path) = &file.path {
            add(path, file.records)?;
        }
    }
    add(&out.join("objects.csv"), rows)?;
    all.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(all)
}
