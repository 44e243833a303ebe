//! `vlscan campaign`: a data set from a matrix of scenes, variants and seeds.

use super::args::CampaignArgs;
use super::{Console, Verbosity, interrupt, messages};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use vlscan_base::diag::listed;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::write_stdout;
use vlscan_base::quantity::{amount_of, counted, duration};
use vlscan_campaign::{Campaign, CampaignEvent, CampaignOptions, CampaignReport};

pub fn run(args: &CampaignArgs, console: &Console) -> Result<()> {
    let campaign = Campaign::read(&args.file)?;
    console.warnings(campaign.warnings())?;
    let options = CampaignOptions { strict: console.is_strict(), ..args.options.clone() };
    if args.list {
        let left = campaign.left(&options)?;
        return write_stdout(&left.iter().map(|cell| format!("{}\n", cell.name)).collect::<String>());
    }
    let (shown, failures) = (console.clone(), Arc::new(Mutex::new(Failures::default())));
    let (seen, cells) = (failures.clone(), AtomicU64::new(0));
    let report = campaign.run(&options, &interrupt::STOP, move |event| {
        if matches!(event, CampaignEvent::Completed { .. } | CampaignEvent::Failed { .. }) {
            let done = cells.fetch_add(1, Ordering::Relaxed) + 1;
            shown.progress(messages::progress_of_cells(done));
        }
        show(&shown, event, &seen);
    });
    for line in failures.lock().unwrap_or_else(PoisonError::into_inner).repeated() {
        console.say(line);
    }
    tell(&report?, args, console)
}

/// The reasons for which cells have failed, each with the cells after the first one.
#[derive(Default)]
struct Failures(Vec<(String, Vec<String>)>);

impl Failures {
    /// Adds a failure. Returns false if a cell has failed for the same reason before.
    fn add(&mut self, cell: String, reason: &str) -> bool {
        match self.0.iter_mut().find(|(known, _)| known == reason) {
            Some((_, cells)) => cells.push(cell),
            None => {
                self.0.push((reason.to_owned(), Vec::new()));
                return true;
            }
        }
        false
    }

    /// A line for each reason for which several cells have failed.
    fn repeated(&self) -> impl Iterator<Item = String> {
        self.0.iter().filter(|(_, cells)| !cells.is_empty()).map(|(reason, cells)| {
            let unit = if cells.len() == 1 { "cell has" } else { "cells have" };
            format!("{} more {unit} failed ({}): {reason}", cells.len(), listed(cells, 3))
        })
    }
}

fn show(console: &Console, event: CampaignEvent, failures: &Mutex<Failures>) {
    match event {
        // What the stages of a cell say is for --verbose; their warnings are shown once, with the first cell
        // that has them.
        CampaignEvent::Notice(notice) if console.shows(Verbosity::Verbose) => console.observer()(notice),
        CampaignEvent::Notice(_) => {}
        CampaignEvent::Warning { cell, text } if text.starts_with("note: ") => {
            console.say(format!("{cell}  {text}"));
        }
        CampaignEvent::Warning { cell, text } => {
            let warning = messages::warning(None, format!("cell {cell}: {}", without_severity(&text)));
            console.caution(format!("{cell}  {text}"), warning);
        }
        CampaignEvent::Damaged { cell, damage } => {
            let text = format!("{cell}  is computed again: {damage}");
            console.caution(&text, messages::warning(None, format!("cell {text}")));
        }
        CampaignEvent::Completed { cell, points, seconds } => {
            console.say(format!("{cell}  {}, {}", amount_of(points as f64, "point"), duration(seconds)));
        }
        CampaignEvent::Failed { cell, error } => {
            let reason = error.lines().next().unwrap_or_default();
            let mut failures = failures.lock().unwrap_or_else(PoisonError::into_inner);
            if failures.add(cell.clone(), reason) {
                let text = format!("{cell}  failed: {reason}");
                console.caution(&text, messages::warning(None, format!("cell {text}")));
            }
        }
    }
}

/// The text of a warning without the word that begins it.
fn without_severity(text: &str) -> &str {
    text.strip_prefix("warning: ").unwrap_or(text)
}

/// Reports the computed and the remaining cells.
///
/// # Errors
/// [`Error::Input`] if cells have failed, with `--cell` some of those that are named.
fn tell(report: &CampaignReport, args: &CampaignArgs, console: &Console) -> Result<()> {
    let CampaignReport { computed, cells, left, failed, reported, .. } = report;
    if *left == 0 {
        console.progress(messages::completed(messages::progress_of_cells(*cells as u64)));
    }
    if *computed > 0 {
        console.say(format!("{} in {}", counted(*computed, "cell"), duration(report.seconds)));
    }
    match &report.manifest {
        None => console.say(format!("{left} of {cells} cells are left; run the same command to continue")),
        Some(path) => {
            if report.is_manifest_replaced {
                console.say(format!("{} did not match the cells and was rewritten", path.display()));
            }
            let points = amount_of(report.points as f64, "point");
            let file = messages::written(path, "manifest");
            console.wrote(file, format!("{}  {}, {points}", path.display(), counted(*cells, "cell")));
            console.record(|result| result.points = Some(report.points));
        }
    }
    let Some(first) = failed.first() else { return Ok(()) };
    let (text, of, them) = match reported {
        1 => (format!("{} has failed: {}", first.cell, first.error), format!(" --cell {}", first.cell), "it"),
        _ => {
            let text = format!(
                "{} of {reported} cells have failed, {} among them; the manifest gives the reasons{}",
                failed.len(),
                first.cell,
                if *left > 0 { " when all cells are computed" } else { "" }
            );
            (text, String::new(), "them")
        }
    };
    if !failed.iter().any(|cell| cell.is_kept) {
        return Err(Error::input(text));
    }
    let file = args.file.display();
    Err(Error::input_with_help(text, format!("vlscan campaign {file}{of} --retry computes {them} again")))
}

#[cfg(test)]
mod tests {
    use crate::cli::Cli;
    use clap::{Arg, Command, CommandFactory};
    use vlscan_campaign::options_of_campaigns;

    /// Options of outputs that say how is measured and not where it is written.
    const ALLOWED: [&str; 20] = [
        "waveforms",
        "pulses",
        "columns",
        "labels",
        "true-positions",
        "height-above-ground",
        "frame-s",
        "world-frame",
        "sensor-frame",
        "tile",
        "per-object",
        "subrays",
        "misses",
        "las-at-most",
        "wave-packets",
        "split-by-channel",
        "crs",
        "las10",
        "zip-output",
        "las-scale",
    ];

    #[test]
    fn every_option_of_outputs_and_shards_is_decided() {
        let mut root = Cli::command();
        root.build();
        let at = |parent: &Command, name: &str| parent.find_subcommand(name).unwrap().clone();
        for argument in at(&root, "run").get_arguments() {
            let heading = argument.get_help_heading().unwrap_or_default();
            let Some(long) =
                argument.get_long().filter(|_| ["Output", "Shards", "Dry run"].contains(&heading))
            else {
                continue;
            };
            // A switch and its opposite alike.
            let name = long.strip_prefix("no-").unwrap_or(long);
            assert!(
                ALLOWED.contains(&name)
                    || long == "las-extra"
                    || options_of_campaigns().any(|decided| decided == ("run", name)),
                "decide whether a campaign's `run` may hold --{long}: DECIDED in campaign/lines.rs"
            );
        }
        // Every option of the table is one of the program.
        let (plan, scene) = (at(&root, "plan"), at(&root, "scene"));
        let commands = [
            ("run", at(&root, "run")),
            ("plan", at(&plan, "airborne")),
            ("make", at(&scene, "make")),
            ("stand", at(&scene, "stand")),
        ];
        for (key, name) in options_of_campaigns() {
            let (_, command) = commands.iter().find(|(known, _)| *known == key).unwrap();
            let has = |a: &Arg| {
                a.get_long() == Some(name) || a.get_all_aliases().is_some_and(|all| all.contains(&name))
            };
            assert!(command.get_arguments().any(has), "{key}: --{name}");
        }
    }
}
