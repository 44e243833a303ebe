//! `vlscan run --shard`, `vlscan index-shards` and `vlscan merge`: a run that is divided among processes.

use super::args::{IndexShardsArgs, MergeArgs, RunArgs};
use super::companions::Companions;
use super::rig::{SharedScene, resolve_all, resolve_outputs};
use super::run::{show_report, warn_of_few_points};
use super::shared_logs::SharedPaths;
use super::watch::during;
use super::{Console, interrupt, messages};
use std::path::{Path, PathBuf};
use std::time::Instant;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{is_taken, reads, refuse_unwritable};
use vlscan_base::quantity::{amount, amount_of, counted};
use vlscan_options::outputs::check_folder;
use vlscan_options::{OneOf, Options, ResolvedRun, schedule_of};
use vlscan_session::output::OutputRequest;
use vlscan_session::shards::{ShardSet, shard_path};
use vlscan_session::{
    LoadedScene, Session, Settings, join_segments, merge as merge_shards, merge_segment, merge_warnings,
    output_context,
};
use vlscan_warehouse::Schedule;

/// Runs `vlscan run --shard K/N`.
pub fn run_shard(args: &RunArgs, shard: OneOf, console: &Console) -> Result<()> {
    let mut started = Instant::now();
    let (folder, options) = folder_of_shards(&args.options)?;
    refuse_existing_shard(args, &folder, shard)?;
    let jobs = resolve_all(&args.file, &options, console)?;
    let mut scene = SharedScene::of(&jobs);
    let folders = folders_of(&folder, &jobs);
    folders.iter().try_for_each(|folder| refuse_existing_shard(args, folder, shard))?;
    for (job, folder) in jobs.into_iter().zip(folders) {
        compute_shard(args, (job, folder.as_path()), shard, (&mut scene, started), console)?;
        started = Instant::now();
    }
    Ok(())
}

/// The folder of the shards of each run within that of all: that folder itself for a single run.
fn folders_of(folder: &Path, jobs: &[ResolvedRun]) -> Vec<PathBuf> {
    match jobs {
        [_] => vec![folder.to_path_buf()],
        jobs => jobs.iter().map(|job| folder.join(job.scanner.as_deref().unwrap_or_default())).collect(),
    }
}

/// Refuses a shard that exists, unless it may be replaced or kept.
fn refuse_existing_shard(args: &RunArgs, folder: &Path, shard: OneOf) -> Result<()> {
    let path = shard_path(folder, shard);
    let (force, resumes) = (args.options.output.force.is_on(), args.shards.resume.is_some());
    if force || resumes || !is_taken(&path) {
        return Ok(());
    }
    Err(Error::input_with_help(
        format!("{} exists already", path.display()),
        "replace it with --force; --resume recomputes it only if it is damaged",
    ))
}

/// Computes the shard of a run in its folder.
fn compute_shard(
    args: &RunArgs,
    (job, folder): (ResolvedRun, &Path),
    shard: OneOf,
    (scene, started): (&mut SharedScene, Instant),
    console: &Console,
) -> Result<()> {
    let path = shard_path(folder, shard);
    let (force, resumes) = (args.options.output.force.is_on(), args.shards.resume.is_some());
    let ResolvedRun { mut settings, mut output, schedule_log, part_table, progress_lines, .. } = job;
    // A merge may write any format.
    settings.physics.record_scanner_axes = true;
    refuse_part_table(part_table.as_deref())?;
    let mut session = scene.open(settings, console, open_without_tree)?;
    if let Some(log) = &schedule_log {
        reads::refuse_input(log)?;
        // A shard that exists needs no log.
        refuse_unwritable(log, force || resumes)?;
    }
    let log = schedule_log.clone();
    let companions = Companions::of(schedule_log, None, &mut output);
    let legs = session.survey().legs.len();
    let mut shards = session.shards(folder, &output, force, &interrupt::STOP)?;
    if args.shards.part_points.is_some() {
        let text = "--part-points no longer has an effect: every output format can be made from a shard";
        console.caution(text, messages::warning(None, text.to_owned()));
    }
    if resumes && !force && shards.existing(shard)?.is_some() {
        let text = format!("{} exists and is complete", path.display());
        console.wrote(messages::written(&path, "shard"), text);
        return Ok(());
    }
    log.map_or(Ok(()), |log| refuse_unwritable(&log, force))?;
    let report = companions.run(console, progress_lines, legs, |control| shards.run(shard, control))?;
    show_report(console, &report, started)
}

/// Refuses the table of parts, which shards cannot give.
fn refuse_part_table(path: Option<&Path>) -> Result<()> {
    match path {
        None => Ok(()),
        Some(_) => Err(Error::not_divisible(
            "--parts needs the points of the whole run and cannot be used with --shard",
            "vlscan scene info --json lists the parts of the scene",
        )),
    }
}

/// A session whose tree is built when a shard is computed: shards that exist need none.
pub fn open_without_tree(settings: Settings, console: &Console) -> Result<Session> {
    let load = || LoadedScene::of(&settings, &console.observer());
    let scene = during(console, "reading the survey", load)?;
    Session::new(settings, scene, console.observer())
}

/// Runs `vlscan index-shards`.
pub fn index(args: &IndexShardsArgs, console: &Console) -> Result<()> {
    let (folder, options) = folder_of_shards(&args.options)?;
    let jobs = resolve_all(&args.file, &options, console)?;
    let mut scene = SharedScene::of(&jobs);
    let folders = folders_of(&folder, &jobs);
    for (ResolvedRun { settings, output, .. }, folder) in jobs.into_iter().zip(folders) {
        let mut session = scene.open(settings, console, open_without_tree)?;
        let shards = during(console, "counting pulses", || {
            session.shards(&folder, &output, options.output.force.is_on(), &interrupt::STOP)
        })?;
        let path = vlscan_session::shards::Borders::path(&folder);
        let pulses = amount_of(shards.pulses() as f64, "pulse");
        let text = format!("{}  {pulses}, for any number of shards", path.display());
        console.wrote(messages::written(&path, "index"), text);
    }
    Ok(())
}

/// Runs `vlscan merge`.
pub fn merge(args: &MergeArgs, console: &Console) -> Result<()> {
    let mut started = Instant::now();
    if args.output.subrays.is_on() {
        return Err(Error::input("--subrays determines what shards contain: give it to vlscan run --shard"));
    }
    if args.check {
        return verify(&args.folder, console);
    }
    let mut options = Options {
        output: args.output.clone(),
        trajectory_out: args.trajectory_out.clone(),
        ..Options::default()
    };
    options.schedule.threads = args.threads;
    let merges = match &args.pipeline {
        None => {
            let shards = ShardSet::open(&args.folder)?;
            let mut found = Diagnostics::default();
            options.warn_of_unused_formats(&mut found)?;
            console.warnings(&found)?;
            let outputs = options.output_request(shards.head.creation)?;
            let (schedule, companions) = (schedule_of(&options), Companions::default());
            vec![Merge { scanner: None, shards, outputs, schedule, companions }]
        }
        Some(file) => merges_of(args, file, &options, console)?,
    };
    for Merge { shards, outputs, .. } in &merges {
        console.warnings(&merge_warnings(shards, outputs)?)?;
    }
    for merge in merges {
        merge.run(args, started, console)?;
        started = Instant::now();
    }
    Ok(())
}

/// Verifies the checksums of all shards of a folder.
fn verify(folder: &Path, console: &Console) -> Result<()> {
    let shards = ShardSet::open(folder)?;
    shards.verify(&interrupt::STOP)?;
    if interrupt::STOP.is_requested() {
        return Err(Error::Interrupted);
    }
    console.say(format!(
        "{}  {}, {}, {} echoes: complete",
        folder.display(),
        counted(shards.head.of, "shard"),
        amount_of(shards.head.total as f64, "pulse"),
        amount(shards.echoes as f64)
    ));
    Ok(())
}

/// The shards of a run, and the outputs to be made from them.
struct Merge {
    /// Name of the scanner, if shards of several scanners are merged.
    scanner: Option<String>,
    shards: ShardSet,
    outputs: OutputRequest,
    schedule: Schedule,
    companions: Companions,
}

impl Merge {
    /// Writes the outputs, and shows the summary with the time since `started`.
    fn run(self, args: &MergeArgs, started: Instant, console: &Console) -> Result<()> {
        let Merge { scanner, shards, outputs, schedule, companions } = self;
        if let Some(name) = scanner {
            console.say(format!("scanner {name}"));
        }
        let legs = output_context(&shards)?.legs.len();
        let report = companions.run(console, args.progress, legs, |control| match args.segment {
            Some(segment) => merge_segment(&shards, &outputs, segment, schedule, control),
            None if args.join => join_segments(&shards, &outputs, control),
            None => merge_shards(&shards, outputs, schedule, control),
        })?;
        if args.segment.is_none() {
            warn_of_few_points(console, &report)?;
        }
        show_report(console, &report, started)
    }
}

/// The outputs of a pipeline file or survey. Those of several scanners are made from the folder of each
/// scanner within that of the shards, or of one scanner from its folder.
fn merges_of(args: &MergeArgs, file: &Path, options: &Options, console: &Console) -> Result<Vec<Merge>> {
    let mut jobs = resolve_outputs(file, options, console)?;
    let mut folders = folders_of(&args.folder, &jobs);
    let has_several = jobs.len() > 1;
    if has_several && SharedPaths::of(jobs.iter().map(|job| &job.output)).any() {
        return Err(Error::input_with_help(
            "scanners that share an MCAP file cannot be merged from shards",
            "give each [[scanner]] an `output` of its own",
        ));
    }
    if has_several && !folders.iter().any(|folder| folder.is_dir()) {
        let name = args.folder.file_name().unwrap_or_default();
        jobs.retain(|job| job.scanner.as_deref().is_some_and(|scanner| name == scanner));
        folders = vec![args.folder.clone()];
    }
    if jobs.is_empty() {
        return Err(Error::input_with_help(
            format!("{} has the shards of no scanner of {}", args.folder.display(), file.display()),
            "name the folder of `vlscan run --shard`, or the folder of a scanner in it",
        ));
    }
    let merge = |(job, folder): (ResolvedRun, PathBuf)| -> Result<Merge> {
        let ResolvedRun { scanner, settings, mut output, schedule_log, part_table, .. } = job;
        refuse_part_table(part_table.as_deref())?;
        output.inputs.push(file.to_path_buf());
        let companions = Companions::of(schedule_log, None, &mut output);
        let (shards, scanner) = (ShardSet::open(&folder)?, scanner.filter(|_| has_several));
        let expected = &settings.survey.scanner.name;
        console.warnings(&other_scanner(&output_context(&shards)?.scanner, &folder, expected, file))?;
        Ok(Merge { scanner, shards, outputs: output, schedule: settings.schedule, companions })
    };
    jobs.into_iter().zip(folders).map(merge).collect()
}

/// A warning if the shards in `folder` are of another scanner than that of the pipeline `file`, whose outputs
/// they would get.
fn other_scanner(scanner: &str, folder: &Path, expected: &str, file: &Path) -> Diagnostics {
    let mut found = Diagnostics::default();
    if scanner != expected {
        let folder = folder.display();
        let message = format!("the shards in {folder} are of the scanner `{scanner}`, not of `{expected}`");
        found
            .warn(Some(Place::of_file(file)), message)
            .help("--pipeline names the file of the run whose shards are merged");
    }
    found
}

/// The folder that -o names, and the options without it.
fn folder_of_shards(options: &Options) -> Result<(PathBuf, Options)> {
    let mut options = options.clone();
    let named = std::mem::take(&mut options.output.out);
    let refuse = |message: &str| Err(Error::input(message));
    match named.as_slice() {
        [folder] if folder.as_os_str() == "-" => refuse("shards are written to a folder: -o DIR"),
        [folder] if folder.exists() && !folder.is_dir() => {
            Err(Error::input(format!("{} is a file, expected a folder for the shards", folder.display())))
        }
        [folder] => check_folder("-o", folder).map(|()| (folder.clone(), options)),
        _ => refuse("expected one folder for the shards: -o DIR; choose formats with vlscan merge"),
    }
}
