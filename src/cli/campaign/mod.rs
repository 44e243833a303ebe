//! `vlscan campaign`: a data set from a matrix of scenes, variants and seeds.
//!
//! | file | what it does |
//! |---|---|
//! | `lines` | the options of commands in the campaign's file |
//! | `cell` | computes a cell: scene, plan, run, tables |
//! | `labels` | the table of a cell's objects |

mod cell;
mod labels;
mod lines;

use super::args::CampaignArgs;
use super::{Console, Verbosity, interrupt};
use crate::options::OneOf;
use cell::{CellRunner, Failure};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{MAIN_SEPARATOR, Path};
use std::time::Instant;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::write_stdout;
use vlscan_base::quantity::{amount, duration};
use vlscan_tools::campaign::{Cell, CellLock, Cells, File, Inputs, Outcome, Record, Store};

pub fn run(args: &CampaignArgs, console: &Console) -> Result<()> {
    let file = File::read(&args.file)?;
    lines::check(&file)?;
    // Paths in the file, also those within options, are relative to its folder.
    let folder = args.file.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder {
        std::env::set_current_dir(folder).map_err(|e| Error::open(folder, e))?;
    }
    let cells = Cells::of(&file)?;
    console.warnings(&cells.warnings(&file))?;
    let cells = cells.0;
    let mine = chosen(args, &cells)?;
    let out = std::path::absolute(&file.out).map_err(|e| Error::open(&file.out, e))?;
    let store = Store::create(&out, args.task.is_some(), args.verify)?;
    let mut inputs = Inputs::without(store.outputs());
    if args.list {
        let mut names = String::new();
        for cell in mine {
            if let Outcome::Absent(_) = store.outcome(cell, &wanted(&file, cell), &mut inputs) {
                names.push_str(&cell.name);
                names.push('\n');
            }
        }
        return write_stdout(&names);
    }
    // What the commands of a cell say is for --verbose; their warnings are shown once, with the first cell that has them.
    let is_verbose = console.shows(Verbosity::Verbose);
    let inner = if is_verbose {
        console.clone()
    } else {
        Console::new(Verbosity::Errors).strict(console.is_strict())
    }
    .collecting();
    let mut runner = CellRunner::new(&file, args.threads, &inner)?;
    let (mut computed, started) = (0, Instant::now());
    let mut unkept = BTreeMap::new();
    for cell in &mine {
        if interrupt::is_signalled() {
            return Err(Error::Interrupted);
        }
        let wanted = wanted(&file, cell);
        let mut damage = None;
        let mut is_due = || match store.outcome(cell, &wanted, &mut inputs) {
            Outcome::Absent(found) => {
                damage = found;
                true
            }
            Outcome::Failed(_) => args.retry,
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
            console.say(format!("{}  is computed again: {damage}", cell.name));
        }
        store.remove_manifest()?;
        computed += 1;
        if let Some(reason) = compute(&store, &mut runner, cell, wanted, lock, &mut inputs, console)? {
            unkept.insert(cell.name.clone(), reason);
        }
    }
    if computed > 0 {
        console.say(format!("{computed} cells in {}", duration(started.elapsed().as_secs_f64())));
    }
    finish(args, &runner, &store, &cells, &unkept, &mut inputs, console)
}

/// The cells that this process shall compute.
fn chosen<'c>(args: &CampaignArgs, cells: &'c [Cell]) -> Result<Vec<&'c Cell>> {
    if let Some(unknown) = args.cell.iter().find(|name| !cells.iter().any(|cell| cell.name == **name)) {
        return Err(Error::input(format!(
            "the campaign has no cell {unknown}; --list names those that are left"
        )));
    }
    let is_mine = |(index, cell): &(usize, &Cell)| match args.task {
        Some(OneOf { number, of }) => index % of as usize == number as usize,
        None => args.cell.is_empty() || args.cell.contains(&cell.name),
    };
    Ok(cells.iter().enumerate().filter(is_mine).map(|(_, cell)| cell).collect())
}

/// The record of a cell as far as it is known before it is computed.
fn wanted(file: &File, cell: &Cell) -> Record {
    let (scene, variant) = (&cell.scene, &cell.variant);
    let area: Option<Vec<[f64; 2]>> = cell.area.as_ref().map(|area| area.corners().to_vec());
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
            "run": file.run,
            "format": file.format,
            "area": area,
        }),
        ..Record::default()
    }
}

/// Computes a cell that this process has locked, and keeps what it gave or why it failed. Returns why it failed if that is not kept.
///
/// # Errors
/// [`Error::Interrupted`], and errors that are none of the cell's own, see [`is_of_machine`]: nothing is kept, and the next start
/// computes the cell again.
fn compute(
    store: &Store,
    runner: &mut CellRunner<'_>,
    cell: &Cell,
    mut record: Record,
    lock: CellLock,
    inputs: &mut Inputs,
    console: &Console,
) -> Result<Option<String>> {
    let started = Instant::now();
    let ended = runner.compute(cell, &mut record, &lock.work, inputs);
    if interrupt::is_signalled() && ended.is_err() {
        return Err(Error::Interrupted);
    }
    let work = lock.work.clone();
    for warning in runner.new_warnings(&work) {
        console.say(format!("{}  {warning}", cell.name));
    }
    let kept = match ended {
        Ok(()) => store.complete(cell, lock, &record),
        Err(Failure { error, .. }) if is_of_machine(&error) => return Err(error),
        Err(Failure { error, is_lasting }) => {
            runner.forget_scene();
            let message = near(&message_of(&error), &[&work, &runner.folder]);
            console.say(format!("{}  failed: {}", cell.name, message.lines().next().unwrap_or_default()));
            if !is_lasting {
                return store.forget(cell, lock).map(|()| Some(message));
            }
            record.error = Some(message);
            store.fail(cell, lock, &record)
        }
    };
    match kept {
        Ok(()) if record.error.is_none() => {
            let seconds = started.elapsed().as_secs_f64();
            store.note_time(cell, seconds, runner.threads());
            let points = amount(record.points as f64);
            console.say(format!("{}  {points} points, {}", cell.name, duration(seconds)));
            Ok(None)
        }
        Ok(()) => Ok(None),
        Err(error) if is_of_machine(&error) => Err(error),
        Err(error) => {
            let message = message_of(&error);
            console.say(format!("{}  failed: {}", cell.name, message.lines().next().unwrap_or_default()));
            Ok(Some(message))
        }
    }
}

/// Whether an error says something about the machine and nothing about the cell: a full disk, a file that cannot be written.
fn is_of_machine(error: &Error) -> bool {
    use std::io::ErrorKind as Kind;
    match error {
        Error::Io { action, source, .. } => {
            *action != "read"
                || matches!(source.kind(), Kind::StorageFull | Kind::QuotaExceeded | Kind::OutOfMemory)
        }
        _ => false,
    }
}

/// The message of an error.
fn message_of(error: &Error) -> String {
    let message = match error {
        Error::Input(found) | Error::Limits(found) => found.render(false),
        other => other.to_string(),
    };
    message.trim_end().to_owned()
}

/// A message in which paths in these folders are named from there, so that it does not depend on where a campaign is computed.
fn near(message: &str, folders: &[&Path]) -> String {
    let is_of_name = |c: char| c.is_alphanumeric() || "/\\.~_-+".contains(c);
    let mut message = message.to_owned();
    for folder in folders.iter().filter(|folder| folder.parent().is_some()) {
        let folder = folder.display().to_string();
        let (mut near, mut rest) = (String::new(), message.as_str());
        while let Some(at) = rest.find(&folder) {
            near.push_str(&rest[..at]);
            let is_whole = !near.ends_with(is_of_name);
            let after = &rest[at + folder.len()..];
            rest = match after.strip_prefix(MAIN_SEPARATOR) {
                Some(below) if is_whole => below,
                None if is_whole && !after.starts_with(is_of_name) => {
                    near.push('.');
                    after
                }
                _ => {
                    near.push_str(&folder);
                    after
                }
            };
        }
        near.push_str(rest);
        message = near;
    }
    message
}

/// Writes the manifest if every cell is complete or has failed.
///
/// # Errors
/// [`Error::Input`] if cells have failed, with `--cell` some of those that are named; [`Error::Io`].
fn finish(
    args: &CampaignArgs,
    runner: &CellRunner<'_>,
    store: &Store,
    cells: &[Cell],
    unkept: &BTreeMap<String, String>,
    inputs: &mut Inputs,
    console: &Console,
) -> Result<()> {
    let is_reported = |cell: &Cell| args.cell.is_empty() || args.cell.contains(&cell.name);
    let mut records = Vec::with_capacity(cells.len());
    let (mut left, mut failed) = (0, Vec::new());
    for cell in cells {
        let wanted = wanted(runner.file, cell);
        let (record, reason) = match store.outcome(cell, &wanted, inputs) {
            Outcome::Complete(record) => (*record, None),
            Outcome::Failed(record) => {
                let reason = record.error.clone().unwrap_or_default();
                (*record, Some((reason, true)))
            }
            Outcome::Obstructed(reason) => (wanted, Some((reason, false))),
            Outcome::Absent(_) => match unkept.get(&cell.name) {
                Some(reason) => (wanted, Some((reason.clone(), false))),
                None => {
                    left += 1;
                    continue;
                }
            },
        };
        let error = reason.as_ref().map(|(reason, _)| near(reason, &[&runner.folder]));
        records.push(Record { error, ..record });
        if let (Some((reason, is_kept)), true) = (reason, is_reported(cell)) {
            failed.push((cell.name.as_str(), reason, is_kept));
        }
    }
    if left > 0 {
        console.say(format!("{left} of {} cells are left; the same command goes on with them", cells.len()));
    } else {
        let (path, is_replaced) = store.write_manifest(&records)?;
        if is_replaced {
            console.say(format!("{} was not that of the cells, and is written again", path.display()));
        }
        let points: u64 = records.iter().map(|record| record.points).sum();
        console.say(format!("{}  {} cells, {} points", path.display(), cells.len(), amount(points as f64)));
    }
    let Some((first, reason, _)) = failed.first() else { return Ok(()) };
    let reported = cells.iter().filter(|cell| is_reported(cell)).count();
    let (text, of, them) = match reported {
        1 => (format!("{first} has failed: {reason}"), format!(" --cell {first}"), "it"),
        _ => {
            let text = format!(
                "{} of {reported} cells have failed, {first} among them; the manifest says why{}",
                failed.len(),
                if left > 0 { " when all cells are computed" } else { "" }
            );
            (text, String::new(), "them")
        }
    };
    let mut problems = Diagnostics::default();
    let problem = problems.error(None, text);
    if failed.iter().any(|(.., is_kept)| *is_kept) {
        let file = args.file.display();
        problem.help(format!("vlscan campaign {file}{of} --retry computes {them} again"));
    }
    Err(Error::Input(Box::new(problems)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_in_messages_are_named_from_their_folder() {
        let folders: [&Path; 2] = [Path::new("/c/set/.campaign/a.work"), Path::new("/c")];
        for (message, expected) in [
            ("cannot read\n--> /c/bad.stl", "cannot read\n--> bad.stl"),
            ("/c/set/.campaign/a.work/scene/scene.xml:3: no", "scene/scene.xml:3: no"),
            ("`/c/trees/a.obj` and (/c/trees/b.obj)", "`trees/a.obj` and (trees/b.obj)"),
            ("/c holds no models, nor does \"/c\"", ". holds no models, nor does \".\""),
            ("/home/c/a.obj, /cd/a.obj, /c.old/a.obj", "/home/c/a.obj, /cd/a.obj, /c.old/a.obj"),
            ("", ""),
        ] {
            assert_eq!(near(message, &folders), expected);
        }
        assert_eq!(near("/c/a.obj", &[Path::new("/")]), "/c/a.obj");
    }
}
