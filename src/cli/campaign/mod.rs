//! `vlscan campaign`: a data set from a matrix of scenes, variants and seeds.
//!
//! | file | what it does |
//! |---|---|
//! | `cell` | computes a cell: scene, plan, run, tables |
//! | `labels` | the table of a cell's objects |

mod cell;
mod labels;

use super::args::CampaignArgs;
use super::{Console, Verbosity, interrupt};
use crate::campaign::{Cell, CellLock, Cells, File, Inputs, Outcome, Record, Store, words};
use crate::error::{Error, Result};
use crate::files::write_stdout;
use crate::options::PartNumber;
use crate::quantity::{amount, duration};
use cell::CellRunner;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Instant;

pub fn run(args: &CampaignArgs, console: &Console) -> Result<()> {
    let file = File::read(&args.file)?;
    // Paths in the file, also those within options, are relative to its folder.
    let folder = args.file.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder {
        std::env::set_current_dir(folder).map_err(|e| Error::open(folder, e))?;
    }
    let cells = Cells::of(&file)?.0;
    let mine = chosen(args, &cells)?;
    let out = std::path::absolute(&file.out).map_err(|e| Error::open(&file.out, e))?;
    let store = Store::create(&out, args.task.is_some())?;
    let mut inputs = Inputs::without(store.outputs());
    if args.list {
        let mut names = String::new();
        for cell in mine {
            if matches!(store.outcome(cell, &wanted(&file, cell, &mut inputs)?, &mut inputs), Outcome::Absent)
            {
                names.push_str(&cell.name);
                names.push('\n');
            }
        }
        return write_stdout(&names);
    }
    let quiet = Console::new(Verbosity::Errors);
    let inner = if console.shows(Verbosity::Verbose) { console } else { &quiet };
    let mut runner = CellRunner::new(&file, args.threads, inner)?;
    let (mut computed, started) = (0, Instant::now());
    for cell in &mine {
        let wanted = wanted(&file, cell, &mut inputs)?;
        let mut is_due = || match store.outcome(cell, &wanted, &mut inputs) {
            Outcome::Absent => true,
            Outcome::Failed(_) => args.retry,
            Outcome::Complete(_) => false,
        };
        if !is_due() {
            continue;
        }
        let Some(lock) = store.lock(cell)? else { continue };
        // Another process may have completed it in the meantime.
        if !is_due() {
            lock.release()?;
            continue;
        }
        computed += 1;
        compute(&store, &mut runner, cell, wanted, lock, &mut inputs, console)?;
    }
    if computed > 0 {
        console.say(format!("{computed} cells in {}", duration(started.elapsed().as_secs_f64())));
    }
    let is_reported = |cell: &Cell| args.cell.is_empty() || args.cell.contains(&cell.name);
    finish(&file, &store, &cells, is_reported, &mut inputs, console)
}

/// The cells that this process shall compute.
fn chosen<'c>(args: &CampaignArgs, cells: &'c [Cell]) -> Result<Vec<&'c Cell>> {
    if let Some(unknown) = args.cell.iter().find(|name| !cells.iter().any(|cell| cell.name == **name)) {
        return Err(Error::input(format!(
            "the campaign has no cell {unknown}; --list names those that are left"
        )));
    }
    let is_mine = |(index, cell): &(usize, &Cell)| match args.task {
        Some(PartNumber { number, of }) => index % of as usize == number as usize,
        None => args.cell.is_empty() || args.cell.contains(&cell.name),
    };
    Ok(cells.iter().enumerate().filter(is_mine).map(|(_, cell)| cell).collect())
}

/// The record of a cell as far as it is known before it is computed.
fn wanted(file: &File, cell: &Cell, inputs: &mut Inputs) -> Result<Record> {
    let (scene, variant) = (&cell.scene, &cell.variant);
    let lines =
        [&scene.make, &scene.stand, &variant.plan].into_iter().flatten().chain([&file.run, &variant.run]);
    let mut named: Vec<String> = Vec::new();
    for line in lines {
        named.extend(words(line).map_err(Error::input)?);
    }
    named.extend(scene.file.iter().cloned());
    named.extend(variant.survey.iter().map(|path| path.to_string_lossy().into_owned()));
    let area: Option<Vec<[f64; 2]>> = cell.area.as_ref().map(|area| area.corners().to_vec());
    Ok(Record {
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
            "run": file.run,
            "format": file.format,
            "area": area,
        }),
        inputs: inputs.named(named.iter().map(String::as_str)),
        ..Record::default()
    })
}

/// Computes a cell that this process has locked, and keeps what it gave or why it failed.
fn compute(
    store: &Store,
    runner: &mut CellRunner<'_>,
    cell: &Cell,
    mut record: Record,
    lock: CellLock,
    inputs: &mut Inputs,
    console: &Console,
) -> Result<()> {
    let started = Instant::now();
    match runner.compute(cell, &mut record, &lock.work, inputs) {
        Ok(()) => {
            store.complete(cell, lock, &record)?;
            let seconds = started.elapsed().as_secs_f64();
            store.note_time(cell, seconds, runner.threads());
            let points = amount(record.points as f64);
            console.say(format!("{}  {points} points, {}", cell.name, duration(seconds)));
            Ok(())
        }
        Err(Error::Interrupted) => Err(Error::Interrupted),
        Err(_) if interrupt::STOP.is_requested() => Err(Error::Interrupted),
        Err(error) => {
            let message = message_of(&error, &lock.work);
            console.say(format!("{}  failed: {}", cell.name, message.lines().next().unwrap_or_default()));
            record.error = Some(message);
            store.fail(cell, lock, &record)
        }
    }
}

/// The message of an error without the name of the folder that is removed next.
fn message_of(error: &Error, work: &Path) -> String {
    let message = match error {
        Error::Input(found) | Error::Limits(found) => found.render(false),
        other => other.to_string(),
    };
    let folder = format!("{}/", work.display());
    message.replace(&folder, "").trim_end().to_owned()
}

/// Writes the manifest if every cell is complete or has failed. Failures of the cells that `is_reported` are those of the command.
fn finish(
    file: &File,
    store: &Store,
    cells: &[Cell],
    is_reported: impl Fn(&Cell) -> bool,
    inputs: &mut Inputs,
    console: &Console,
) -> Result<()> {
    let mut records = Vec::with_capacity(cells.len());
    let (mut left, mut failed) = (0, Vec::new());
    for cell in cells {
        match store.outcome(cell, &wanted(file, cell, inputs)?, inputs) {
            Outcome::Complete(record) => records.push(*record),
            Outcome::Failed(record) => {
                if is_reported(cell) {
                    failed.push((cell.name.as_str(), record.error.clone().unwrap_or_default()));
                }
                records.push(*record);
            }
            Outcome::Absent => left += 1,
        }
    }
    if left > 0 {
        console.say(format!("{left} of {} cells are left; the same command goes on with them", cells.len()));
    } else {
        let path: PathBuf = store.write_manifest(&records)?;
        let points: u64 = records.iter().map(|record| record.points).sum();
        console.say(format!("{}  {} cells, {} points", path.display(), cells.len(), amount(points as f64)));
    }
    match failed.as_slice() {
        [] => Ok(()),
        [(name, error)] if cells.iter().filter(|cell| is_reported(cell)).count() == 1 => {
            Err(Error::input(format!("{name} has failed: {error}; --retry computes it again")))
        }
        [(first, _), ..] => Err(Error::input(format!(
            "{} of {} cells have failed, {first} among them; the manifest tells why, --retry computes them again",
            failed.len(),
            cells.iter().filter(|cell| is_reported(cell)).count()
        ))),
    }
}
