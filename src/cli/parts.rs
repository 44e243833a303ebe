//! `vlscan run --part`, `vlscan plan-parts` and `vlscan merge`: a run that is divided among processes.

use super::args::{MergeArgs, PlanPartsArgs, RunArgs};
use super::companions::Companions;
use super::run::{Job, show_report, warn_of_few_points};
use super::watch::watched;
use super::{Console, interrupt};
use crate::options::{Options, PartNumber, PartPoints};
use crate::parts::{PartSet, part_path};
use crate::pipeline::{
    Control, Part, Progress, Session, join_segments, merge as merge_parts, merge_segment, merge_warnings,
    output_context, schedule_of,
};
use std::path::PathBuf;
use std::time::Instant;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads;
use vlscan_base::quantity::amount;

/// Runs `vlscan run --part K/N`.
pub fn run_part(args: &RunArgs, PartNumber { number, of }: PartNumber, console: &Console) -> Result<()> {
    let started = Instant::now();
    let (folder, options) = folder_of_parts(&args.options)?;
    let path = part_path(&folder, number, of);
    let (force, resumes) = (options.output.force, args.parts.resume.is_some());
    if path.exists() && !force && !resumes {
        let mut problems = Diagnostics::default();
        problems
            .error(None, format!("{} exists already", path.display()))
            .help("replace it with --force; --resume computes it again only where it is damaged");
        return Err(Error::Input(Box::new(problems)));
    }
    let (job, warnings) = Job::resolve(&args.file, &options)?;
    console.warnings(&warnings)?;
    let Job { mut settings, mut output, schedule_log, part_table, progress_lines } = job;
    // A merge may write any format.
    settings.physics.record_scanner_axes |= args.parts.part_points == PartPoints::Echoes;
    if part_table.is_some() {
        return Err(Error::input(
            "--parts counts the points of a whole run, and this is a part of one; vlscan scene info --json lists the parts \
             of the scene",
        ));
    }
    let mut session = Session::open_without_tree(settings, console.observer())?;
    schedule_log.as_deref().map_or(Ok(()), reads::refuse_input)?;
    let companions = Companions::of(schedule_log, None, &mut output);
    let legs = session.survey().legs.len();
    let mut parts = session.parts(&folder, output.creation, force, &interrupt::STOP)?;
    if args.parts.part_points == PartPoints::Las {
        parts.hold_las(&output)?;
    }
    let part = Part { number, of };
    if resumes && !force && parts.existing(part)?.is_some() {
        console.say(format!("{} exists and is complete", path.display()));
        return Ok(());
    }
    let progress = Progress::default();
    let control = companions.control(&progress);
    let report = watched(console, progress_lines, legs, &progress, || parts.run(part, control))?;
    companions.write(&report)?;
    show_report(console, &report, started)
}

/// Runs `vlscan plan-parts`.
pub fn plan(args: &PlanPartsArgs, console: &Console) -> Result<()> {
    let (folder, options) = folder_of_parts(&args.options)?;
    let (job, warnings) = Job::resolve(&args.file, &options)?;
    console.warnings(&warnings)?;
    let Job { settings, output, .. } = job;
    let mut session = Session::open_without_tree(settings, console.observer())?;
    let parts = session.parts(&folder, output.creation, options.output.force, &interrupt::STOP)?;
    console.say(format!(
        "{}  {} pulses, for any number of parts",
        crate::parts::Borders::path(&folder).display(),
        amount(parts.pulses() as f64)
    ));
    Ok(())
}

/// Runs `vlscan merge`.
pub fn merge(args: &MergeArgs, console: &Console) -> Result<()> {
    let started = Instant::now();
    if args.output.subrays {
        return Err(Error::input("--subrays says what parts hold: give it to vlscan run --part"));
    }
    let parts = PartSet::open(&args.folder)?;
    if args.check {
        parts.verify(&interrupt::STOP)?;
        if interrupt::STOP.is_requested() {
            return Err(Error::Interrupted);
        }
        console.say(format!(
            "{}  {} parts, {} pulses, {} echoes: complete",
            args.folder.display(),
            parts.head.of,
            amount(parts.head.total as f64),
            amount(parts.echoes as f64)
        ));
        return Ok(());
    }
    let mut options = Options {
        output: args.output.clone(),
        trajectory_out: args.trajectory_out.clone(),
        ..Options::default()
    };
    options.schedule.threads = args.threads;
    let outputs = options.output_request(parts.head.creation)?;
    console.warnings(&merge_warnings(&parts, &outputs)?)?;
    let progress = Progress::default();
    let control = Control::new(&progress, &interrupt::STOP);
    let legs = output_context(&parts)?.legs.len();
    let schedule = schedule_of(&options);
    let report = watched(console, args.progress, legs, &progress, || match args.part {
        Some(PartNumber { number, of }) => merge_segment(&parts, &outputs, (number, of), schedule, control),
        None if args.join => join_segments(&parts, &outputs, control),
        None => merge_parts(&parts, outputs, schedule, control),
    })?;
    if args.part.is_none() {
        warn_of_few_points(console, &report)?;
    }
    show_report(console, &report, started)
}

/// The folder that -o names, and the options without it.
fn folder_of_parts(options: &Options) -> Result<(PathBuf, Options)> {
    let mut options = options.clone();
    let named = std::mem::take(&mut options.output.out);
    let refuse = |message: &str| Err(Error::input(message));
    match named.as_slice() {
        [folder] if folder.as_os_str() == "-" => refuse("parts are files: name a folder with -o"),
        [folder] if folder.exists() && !folder.is_dir() => {
            Err(Error::input(format!("{} is a file, expected a folder for the parts", folder.display())))
        }
        [folder] => Ok((folder.clone(), options)),
        _ => refuse("expected one folder for the parts: -o DIR; formats are chosen by vlscan merge"),
    }
}
