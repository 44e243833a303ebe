//! Campaigns: computes the cells of a data set, see [`vlscan_tools::campaign`].
//!
//! | file | what it does |
//! |---|---|
//! | `lines` | the options of commands in the campaign's file, as typed requests |
//! | `cell` | computes a cell: scene, plan, run, tables |
//! | `labels` | the table of a cell's objects |
//! | `messages` | messages of cells |
//! | `folder` | the working directory while a campaign is read or computed |

mod cell;
mod folder;
mod labels;
mod lines;
mod messages;

pub use lines::options_of_campaigns;

use cell::{CellRunner, Failure};
use folder::WorkingFolder;
use lines::Requests;
use messages::{is_of_machine, message_of, near};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use vlscan_base::diag::{Diagnostics, Notice};
use vlscan_base::error::{Error, Result};
use vlscan_choice::Choice as _;
use vlscan_options::OneOf;
use vlscan_session::output::PointFormat;
use vlscan_tools::campaign::{Cell, CellLock, Cells, File, Inputs, Outcome, Record, Store, text_of};
use vlscan_warehouse::Stop;

/// A data set from a matrix of scenes, variants and seeds: a run for each of its cells.
///
/// Any number of processes can compute the same campaign, on one machine or many that share its folder; each
/// takes cells that no other has taken. What is complete stays.
///
/// Paths in a campaign's file, also those within options, are relative to its folder. While a campaign is
/// read or computed, that folder is the working directory of the process, and another campaign of the process
/// is refused meanwhile.
#[derive(Clone, Debug)]
pub struct Campaign {
    file: File,
    folder: PathBuf,
    requests: Requests,
    format: PointFormat,
    cells: Vec<Cell>,
    warnings: Diagnostics,
}

/// Selection of the cells of a campaign, and how they are computed.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct CampaignOptions {
    /// Compute every N-th cell only, from cell K on, with K from 0 to N-1: for array jobs, and for file
    /// systems without locks.
    #[arg(long, value_name = "K/N")]
    pub task: Option<OneOf>,
    /// Compute this cell only; may be given more than once.
    #[arg(long = "cell", value_name = "NAME", conflicts_with = "task")]
    pub cells: Vec<String>,
    /// Compute failed cells again.
    #[arg(long)]
    pub retry: bool,
    /// Compare the checksums of all files of complete cells, not only sizes and times. Cells with damaged
    /// files are computed again.
    #[arg(long)]
    pub verify: bool,
    /// Threads of this process; 0 = all, the default.
    #[arg(short = 'j', long, value_name = "N")]
    pub threads: Option<usize>,
    /// True if warnings are errors.
    #[arg(skip)]
    pub strict: bool,
}

impl CampaignOptions {
    fn has(&self, cell: &Cell) -> bool {
        self.cells.is_empty() || self.cells.contains(&cell.name)
    }
}

/// Event while a campaign is computed.
#[derive(Clone, Debug)]
pub enum CampaignEvent {
    /// Notice of a stage of a cell, except warnings.
    Notice(Notice),
    /// A warning or a note of a cell that no cell before it had.
    Warning {
        /// Name of the cell.
        cell: String,
        /// The warning in a line.
        text: String,
    },
    /// A cell is computed again, since its files are damaged.
    Damaged {
        /// Name of the cell.
        cell: String,
        /// Damage to its files.
        damage: String,
    },
    /// A cell is complete.
    Completed {
        /// Name of the cell.
        cell: String,
        /// Number of its points.
        points: u64,
        /// How long it took, s.
        seconds: f64,
    },
    /// A cell has failed.
    Failed {
        /// Name of the cell.
        cell: String,
        /// Why.
        error: String,
    },
}

/// A cell that has failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FailedCell {
    /// Name of the cell.
    pub cell: String,
    /// Why it has failed.
    pub error: String,
    /// True if the failure is kept, so that the cell is computed again only with [`CampaignOptions::retry`].
    pub is_kept: bool,
}

/// The state of a campaign's data set.
#[derive(Clone, Debug)]
pub struct CampaignReport {
    /// Number of cells that this call has computed.
    pub computed: usize,
    /// How long it took, s.
    pub seconds: f64,
    /// Number of cells of the campaign.
    pub cells: usize,
    /// Number of cells that are neither complete nor failed.
    pub left: usize,
    /// The manifest, which is written when no cell is left.
    pub manifest: Option<PathBuf>,
    /// True if an existing manifest did not match the cells.
    pub is_manifest_replaced: bool,
    /// Number of points of all cells.
    pub points: u64,
    /// Number of cells that are reported: with [`CampaignOptions::cells`] those that are named.
    pub reported: usize,
    /// Cells that have failed.
    pub failed: Vec<FailedCell>,
}

type Notify = Arc<dyn Fn(CampaignEvent) + Send + Sync>;

impl Campaign {
    /// Reads a campaign.
    ///
    /// # Errors
    /// [`Error::Input`] with the place of everything that is wrong; [`Error::Io`].
    pub fn read(path: &Path) -> Result<Campaign> {
        Campaign::new(path, File::read(path)?)
    }

    /// Reads the text of a campaign; `path` is the file that it stands for.
    ///
    /// # Errors
    /// As for [`Campaign::read`].
    pub fn parse(path: &Path, text: String) -> Result<Campaign> {
        Campaign::new(path, File::parse(path, text)?)
    }

    fn new(path: &Path, file: File) -> Result<Campaign> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let folder = std::path::absolute(Path::new(".").join(folder)).map_err(|e| Error::open(folder, e))?;
        let _within = WorkingFolder::enter(&folder)?;
        let requests = Requests::of(&file)?;
        let format = PointFormat::named(&file.format).ok_or_else(|| {
            Error::input(format!("no format is called {}; choose {}", file.format, PointFormat::names()))
        })?;
        let cells = Cells::of(&file)?;
        let warnings = cells.warnings(&file);
        Ok(Campaign { file, folder, requests, format, cells: cells.0, warnings })
    }

    /// All cells: scenes × seeds × variants.
    pub fn cells(&self) -> &[Cell] {
        &self.cells
    }

    /// Suspicious contents of the campaign's file and of those of its areas.
    pub fn warnings(&self) -> &Diagnostics {
        &self.warnings
    }

    /// The cells among those of the options that are neither complete nor failed.
    ///
    /// # Errors
    /// [`Error::Input`] for unknown cells, and if the folder of the data set holds other files of its names;
    /// [`Error::Io`].
    pub fn left(&self, options: &CampaignOptions) -> Result<Vec<&Cell>> {
        let _within = WorkingFolder::enter(&self.folder)?;
        let mut chosen = self.chosen(options)?;
        let (store, mut inputs) = self.open(options)?;
        chosen.retain(|cell| {
            matches!(store.outcome(cell, &self.expected_record(cell), &mut inputs), Outcome::Absent(_))
        });
        Ok(chosen)
    }

    /// Computes the cells of the options that are left, and writes the manifest if no cell of the campaign is
    /// left then. A cell that fails stops no other.
    ///
    /// # Errors
    /// [`Error::Input`] as for [`Campaign::left`], [`Error::Interrupted`] when the stop is requested, and
    /// errors that are none of a cell's own, such as those of a full disk: the next call computes that cell
    /// again.
    pub fn run(
        &self,
        options: &CampaignOptions,
        stop: &Stop,
        notify: impl Fn(CampaignEvent) + Send + Sync + 'static,
    ) -> Result<CampaignReport> {
        let _within = WorkingFolder::enter(&self.folder)?;
        let chosen = self.chosen(options)?;
        let (store, mut inputs) = self.open(options)?;
        let notify: Notify = Arc::new(notify);
        let CampaignOptions { threads, strict, .. } = *options;
        let mut runner = CellRunner::new(&self.requests, self.format, threads, strict, stop, &notify)?;
        let (mut computed, started) = (0, Instant::now());
        let mut unkept = BTreeMap::new();
        for cell in chosen {
            if stop.is_requested() {
                return Err(Error::Interrupted);
            }
            let expected_record = self.expected_record(cell);
            let mut damage = None;
            let mut is_due = || match store.outcome(cell, &expected_record, &mut inputs) {
                Outcome::Absent(found) => {
                    damage = found;
                    true
                }
                Outcome::Failed(_) => options.retry,
                Outcome::Complete(_) | Outcome::Obstructed(_) => false,
            };
            if !is_due() {
                continue;
            }
            let Some(lock) = store.lock(cell)? else { continue };
            // Another process may have completed it in the meantime.
            if !is_due() {
                continue;
            }
            if let Some(damage) = damage {
                notify(CampaignEvent::Damaged { cell: cell.name.clone(), damage });
            }
            store.remove_manifest()?;
            computed += 1;
            if let Some(error) =
                compute(&store, &mut runner, cell, expected_record, lock, &mut inputs, &*notify)?
            {
                unkept.insert(cell.name.as_str(), error);
            }
        }
        let seconds = started.elapsed().as_secs_f64();
        let report = self.report(options, &store, &runner.folder, &unkept, &mut inputs)?;
        Ok(CampaignReport { computed, seconds, ..report })
    }

    /// The folder of the data set, and what cells depend on.
    fn open(&self, options: &CampaignOptions) -> Result<(Store, Inputs)> {
        let out = std::path::absolute(&self.file.out).map_err(|e| Error::open(&self.file.out, e))?;
        let store = Store::create(&out, options.task.is_some(), options.verify)?;
        let inputs = Inputs::without(store.outputs());
        Ok((store, inputs))
    }

    /// The cells of the options.
    fn chosen(&self, options: &CampaignOptions) -> Result<Vec<&Cell>> {
        let is_known = |name: &&String| self.cells.iter().any(|cell| cell.name == **name);
        if let Some(unknown) = options.cells.iter().find(|name| !is_known(name)) {
            return Err(Error::input(format!(
                "the campaign has no cell {unknown}; --list shows the remaining ones"
            )));
        }
        let is_chosen = |(index, cell): &(usize, &Cell)| match options.task {
            Some(OneOf { number, of }) => index % of.max(1) as usize == number as usize,
            None => options.has(cell),
        };
        Ok(self.cells.iter().enumerate().filter(is_chosen).map(|(_, cell)| cell).collect())
    }

    /// The record of a cell as far as it is known before it is computed.
    fn expected_record(&self, cell: &Cell) -> Record {
        let Cell { scene, variant, .. } = cell;
        Record {
            cell: cell.name.clone(),
            scene: cell.scene_name.clone(),
            variant: variant.name.clone(),
            seed: cell.seed,
            group: cell.group.clone(),
            split: cell.split.to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            options: json!({
                "scene": **scene,
                "variant": **variant,
                "run": text_of(&self.file.run),
                "format": self.file.format,
                "area": cell.area.as_ref().map(|area| area.corners()),
            }),
            ..Record::default()
        }
    }

    /// Looks at all cells, and writes the manifest if every one is complete or has failed.
    fn report(
        &self,
        options: &CampaignOptions,
        store: &Store,
        folder: &Path,
        unkept: &BTreeMap<&str, String>,
        inputs: &mut Inputs,
    ) -> Result<CampaignReport> {
        let mut records = Vec::with_capacity(self.cells.len());
        let (mut left, mut failed) = (0, Vec::new());
        for cell in &self.cells {
            let expected_record = self.expected_record(cell);
            let (record, failure) = match store.outcome(cell, &expected_record, inputs) {
                Outcome::Complete(record) => (*record, None),
                Outcome::Failed(record) => {
                    let error = record.error.clone().unwrap_or_default();
                    (*record, Some((error, true)))
                }
                Outcome::Obstructed(reason) => (expected_record, Some((reason, false))),
                Outcome::Absent(_) => match unkept.get(cell.name.as_str()) {
                    Some(error) => (expected_record, Some((error.clone(), false))),
                    None => {
                        left += 1;
                        continue;
                    }
                },
            };
            let error = failure.as_ref().map(|(error, _)| near(error, &[folder]));
            records.push(Record { error, ..record });
            if let (Some((error, is_kept)), true) = (failure, options.has(cell)) {
                failed.push(FailedCell { cell: cell.name.clone(), error, is_kept });
            }
        }
        let manifest = if left == 0 { Some(store.write_manifest(&records)?) } else { None };
        Ok(CampaignReport {
            computed: 0,
            seconds: 0.0,
            cells: self.cells.len(),
            left,
            is_manifest_replaced: manifest.as_ref().is_some_and(|(_, is_replaced)| *is_replaced),
            manifest: manifest.map(|(path, _)| path),
            points: records.iter().map(|record| record.points).sum(),
            reported: self.cells.iter().filter(|cell| options.has(cell)).count(),
            failed,
        })
    }
}

/// Computes a cell that this process has locked, and keeps its result or the reason of its failure. Returns
/// why it failed if that is not kept.
///
/// # Errors
/// [`Error::Interrupted`], and errors that are none of the cell's own, see [`is_of_machine`]: nothing is
/// kept, and the next start computes the cell again.
fn compute(
    store: &Store,
    runner: &mut CellRunner<'_>,
    cell: &Cell,
    mut record: Record,
    lock: CellLock,
    inputs: &mut Inputs,
    notify: &dyn Fn(CampaignEvent),
) -> Result<Option<String>> {
    let started = Instant::now();
    let name = || cell.name.clone();
    let ended = runner.compute(cell, &mut record, &lock.work, inputs);
    if runner.stop.is_requested() && ended.is_err() {
        return Err(Error::Interrupted);
    }
    let work = lock.work.clone();
    for text in runner.new_warnings(&work) {
        notify(CampaignEvent::Warning { cell: name(), text });
    }
    let kept = match ended {
        Ok(()) => store.complete(cell, lock, &record),
        Err(Failure { error, .. }) if is_of_machine(&error) => return Err(error),
        Err(Failure { error, is_lasting }) => {
            runner.forget_scene();
            let error = near(&message_of(&error), &[&work, &runner.folder]);
            notify(CampaignEvent::Failed { cell: name(), error: error.clone() });
            if !is_lasting {
                return store.forget(cell, lock).map(|()| Some(error));
            }
            record.error = Some(error);
            store.fail(cell, lock, &record)
        }
    };
    match kept {
        Ok(()) => {
            if record.error.is_none() {
                let seconds = started.elapsed().as_secs_f64();
                store.note_time(cell, seconds, runner.threads());
                notify(CampaignEvent::Completed { cell: name(), points: record.points, seconds });
            }
            Ok(None)
        }
        Err(error) if is_of_machine(&error) => Err(error),
        Err(error) => {
            let error = message_of(&error);
            notify(CampaignEvent::Failed { cell: name(), error: error.clone() });
            Ok(Some(error))
        }
    }
}
