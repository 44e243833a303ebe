//! Computes a cell: its scene, its survey, its points and the table of its objects.

use super::CampaignEvent;
use super::labels::{Labels, objects};
use super::lines::{Requests, SceneSource, SurveySource};
use super::messages::{is_of_machine, near};
use crate::planning::plan_survey;
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use vlscan_base::Observer;
use vlscan_base::damage::panic_text;
use vlscan_base::diag::{Diagnostics, Notice, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileLog, FileWriter, Patched, Reads};
use vlscan_geom::Aabb;
use vlscan_options::{Options, ResolvedRun, Seed, Switch, read_survey};
use vlscan_session::output::{FileKind, PointFormat};
use vlscan_session::{LoadedScene, PartTable, Progress, Report, RunContext, Session};
use vlscan_tools::campaign::{Cell, FileRecord, Inputs, Record, checksum};
use vlscan_tools::generate::{SceneOptions, StandOptions, make_stand, write_scene};
use vlscan_warehouse::Stop;

/// Why a cell has failed.
pub struct Failure {
    pub error: Error,
    /// True if the same inputs give the same error again. It is not kept otherwise, so that the next start
    /// computes the cell.
    pub is_lasting: bool,
}

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        Failure { error, is_lasting: true }
    }
}

/// Computes the cells of a campaign one after the other.
pub struct CellRunner<'c> {
    pub requests: &'c Requests,
    pub format: PointFormat,
    pub threads: Option<usize>,
    /// The folder of the campaign's file, in which the process works.
    pub folder: PathBuf,
    pub stop: &'c Stop,
    /// Collects warnings, and passes other notices on.
    observer: Observer,
    warnings: Arc<Mutex<Diagnostics>>,
    /// The last scene from a file, which the next cell may scan, too.
    loaded: Option<(String, LoadedScene)>,
    /// Warnings that have been shown.
    warned: BTreeSet<String>,
    /// Files of the scene that the present cell shares with an earlier one.
    reused: Option<Reads>,
}

/// A scene that is ready to be scanned.
struct Site {
    /// As `--scene` takes it.
    name: String,
    /// True if other cells scan the same.
    is_shared: bool,
    labels: Labels,
}

impl<'c> CellRunner<'c> {
    pub fn new(
        requests: &'c Requests,
        format: PointFormat,
        threads: Option<usize>,
        is_strict: bool,
        stop: &'c Stop,
        notify: &Arc<dyn Fn(CampaignEvent) + Send + Sync>,
    ) -> Result<CellRunner<'c>> {
        let folder = std::env::current_dir().map_err(|e| Error::open(Path::new("."), e))?;
        let warnings = Arc::new(Mutex::new(Diagnostics::default()));
        let (collected, notify) = (warnings.clone(), notify.clone());
        let observer = Observer::new(is_strict, move |notice| match notice {
            Notice::Warnings(found) => {
                collected.lock().unwrap_or_else(PoisonError::into_inner).extend(found);
            }
            notice => notify(CampaignEvent::Notice(notice)),
        });
        Ok(CellRunner {
            requests,
            format,
            threads,
            folder,
            stop,
            observer,
            warnings,
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

    /// The warnings and notes of the last cell that no cell before it had, each in a line; files are named
    /// from the campaign's folder, those in `work` from there.
    pub fn new_warnings(&mut self, work: &Path) -> Vec<String> {
        let found = std::mem::take(&mut *self.warnings.lock().unwrap_or_else(PoisonError::into_inner));
        let lines = found.items().iter().map(|item| near(item.line().trim_end(), &[work, &self.folder]));
        lines.filter(|line| self.warned.insert(line.clone())).collect()
    }

    /// Computes a cell into the folder `out` within `work` and completes its record.
    ///
    /// # Errors
    /// The errors of the runs of the campaign; [`Error::Internal`] for a panic; inputs that change meanwhile.
    pub fn compute(
        &mut self,
        cell: &Cell,
        record: &mut Record,
        work: &Path,
        inputs: &mut Inputs,
    ) -> Result<(), Failure> {
        let log = FileLog::default();
        let ended = log.record(|| catch_unwind(AssertUnwindSafe(|| self.make(cell, work))));
        let ended =
            ended.unwrap_or_else(|panic| Err(Error::Internal(format!("a panic: {}", panic_text(&*panic)))));
        let mut reads = log.reads();
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
        let folder = work.join("scene");
        match &self.requests.scenes[cell.scene_index] {
            SceneSource::Make(options) => {
                let options = SceneOptions { seed: cell.seed, ..(**options).clone() };
                write_scene(&options, &folder)?;
                let name = format!("{}#{}", text(&folder.join("scene.xml"))?, options.kind.name());
                Ok(Site { name, is_shared: false, labels: Labels::default() })
            }
            SceneSource::Stand(options) => {
                let options = StandOptions { seed: cell.seed, ..(**options).clone() };
                let margin_m = cell.scene.margin();
                let bounds = cell.area.as_ref().map(|area| area.bounds());
                let stands = |place: [f64; 2]| {
                    bounds.is_none_or(|(low, high)| {
                        (0..2).all(|i| place[i] >= low[i] - margin_m && place[i] <= high[i] + margin_m)
                    })
                };
                make_stand(&options, &folder, &stands, &self.observer)?;
                let labels = Labels::read(&folder.join("labels.csv"))?;
                let name = format!("{}#stand", text(&folder.join("stand.xml"))?);
                Ok(Site { name, is_shared: false, labels })
            }
            SceneSource::File(file) => {
                let (path, id) =
                    file.split_once('#').map_or((file.as_str(), None), |(path, id)| (path, Some(id)));
                let path = text(&self.folder.join(path))?;
                let name = id.map_or(path.clone(), |id| format!("{path}#{id}"));
                Ok(Site { name, is_shared: true, labels: Labels::default() })
            }
        }
    }

    /// The survey of a cell: planned, or the variant's file.
    fn survey(&self, cell: &Cell, site: &Site, work: &Path) -> Result<PathBuf> {
        let (request, command) = match &self.requests.variants[cell.variant_index].0 {
            SurveySource::Plan { request, command } => (request, command),
            SurveySource::File(path) => {
                self.observer.warnings(decided_here(path)?)?;
                return Ok(path.clone());
            }
        };
        let path = work.join("plan.toml");
        let mut request = request.clone();
        let setup = request.common_mut();
        (setup.scene, setup.out) = (Some(site.name.clone()), Some(path.clone()));
        if let Some(area) = &cell.area {
            request.within(area);
        }
        let plan = plan_survey(&request, command, &self.observer, self.stop)?;
        plan.comments.into_iter().for_each(|comment| self.observer.note(comment));
        Ok(path)
    }

    /// The options of a cell's run.
    fn options(&self, cell: &Cell, site: &Site, work: &Path) -> Options {
        let mut options = self.requests.variants[cell.variant_index].1.clone();
        let output = &mut options.output;
        let is_divided = output.tile.is_some() || output.per_object.is_on();
        let out = work.join("out");
        output.out = vec![match is_divided {
            true => out.join("points"),
            false => out.join(format!("points.{}", self.format.extension())),
        }];
        output.format = Some(self.format);
        options.input.scene = Some(site.name.clone());
        if self.observer.is_strict() {
            options.input.strict = Switch::On;
        }
        options.origin.seed = Some(Seed(cell.seed));
        options.schedule.threads = self.threads.or(options.schedule.threads);
        options
    }

    /// Makes the scene and the survey of a cell, and flies it.
    fn measure(&mut self, cell: &Cell, work: &Path) -> Result<(Site, Report, PartTable)> {
        let site = self.site(cell, work)?;
        let survey = self.survey(cell, &site, work)?;
        let (report, table) = self.fly(cell, &site, &survey, &self.options(cell, &site, work))?;
        Ok((site, report, table))
    }

    /// Flies the survey.
    fn fly(
        &mut self,
        cell: &Cell,
        site: &Site,
        survey: &Path,
        options: &Options,
    ) -> Result<(Report, PartTable)> {
        let (job, warnings) = ResolvedRun::resolve(survey, options)?;
        self.observer.warnings(warnings)?;
        let ResolvedRun { settings, mut output, .. } = job;
        if output.trajectory.is_some() {
            return Err(Error::input(format!(
                "{}: its [[output]] of the trajectory names one file, which all cells would overwrite; leave \
                 it out",
                survey.display()
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
            Some((_, loaded)) => Session::new(settings, loaded.clone(), self.observer.callback())?,
            None => {
                self.loaded = None;
                Session::open(settings, self.observer.callback())?
            }
        };
        if site.is_shared && self.loaded.is_none() {
            self.loaded = session.loaded().map(|loaded| (site.name.clone(), loaded));
        }
        let table = PartTable::new(session.scene())?;
        let progress = Progress::default();
        let report = session.run(output, RunContext::new(&progress, self.stop))?;
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
    let text =
        format!("{name} changed while the cell was being computed; the next start computes the cell again");
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

/// Warns of values in a survey that a campaign overrides.
fn decided_here(path: &Path) -> Result<Diagnostics> {
    let (survey, options, _) = read_survey(path, Options::default())?;
    let mut found = Diagnostics::default();
    let place = || Some(Place::in_line(path, 0, "", 0..0));
    if let Some(seed) = options.origin.seed.map(|seed| seed.0).or(survey.seed) {
        let help = "set `seeds` at the top of the campaign's file";
        found
            .warn(place(), format!("its seed {seed} is not used: cells use the campaign's `seeds`"))
            .help(help);
    }
    if !options.outputs.is_empty() {
        let help = "set `format` at the top of the campaign's file";
        found.warn(place(), "its [[output]] is not used: the campaign names the files of a cell").help(help);
    }
    Ok(found)
}

/// A path as text.
fn text(path: &Path) -> Result<String> {
    let text = path.to_str().map(str::to_owned);
    text.ok_or_else(|| Error::input(format!("{}: its name is not UTF-8", path.display())))
}

/// Completes the counts of a record.
fn describe(cell: &Cell, report: &Report, record: &mut Record) {
    let is_points = |file: &&vlscan_session::output::FileSummary| file.kind == FileKind::Points;
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
