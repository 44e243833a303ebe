//! The lines of a campaign's file that hold options of commands, as typed requests. What a campaign decides
//! itself is refused, with its line in the file and what to write instead: an option that changes nothing
//! must not stand in the record of a cell.

use crate::planning::check_instrument;
use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches, Subcommand};
use std::path::PathBuf;
use toml::Spanned;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_options::{Options, with_negative_numbers};
use vlscan_tools::campaign::{File, text_of, words};
use vlscan_tools::generate::{SceneOptions, StandOptions};
use vlscan_tools::plan::PlanRequest;

/// The scene of a `[[scene]]`.
#[derive(Clone, Debug)]
pub enum SceneSource {
    /// A file.
    File(String),
    /// A generated scene.
    Make(Box<SceneOptions>),
    /// Trees of an inventory.
    Stand(Box<StandOptions>),
}

/// The survey of a `[[variant]]`.
#[derive(Clone, Debug)]
pub enum SurveySource {
    /// A file.
    File(PathBuf),
    /// A survey that is planned for each scene; `command` is what its first line names.
    Plan { request: PlanRequest, command: String },
}

/// Requests of the tables of a campaign's file.
#[derive(Clone, Debug)]
pub struct Requests {
    /// The scenes, in the order of the file.
    pub scenes: Vec<SceneSource>,
    /// The variants, in the order of the file, with the options of their runs.
    pub variants: Vec<(SurveySource, Options)>,
}

impl Requests {
    /// Reads all lines of a campaign.
    ///
    /// # Errors
    /// [`Error::Input`] with the place of every line that is not one of options that a campaign leaves to it.
    pub fn of(file: &File) -> Result<Requests> {
        let mut lines = Lines { file, problems: Diagnostics::default() };
        lines.read::<Options>("run", file.run.as_ref());
        let mut scenes = Vec::new();
        for scene in &file.scenes {
            let made = lines.read("make", scene.make.as_ref()).map(|it| SceneSource::Make(Box::new(it)));
            let stand = lines.read("stand", scene.stand.as_ref()).map(|it| SceneSource::Stand(Box::new(it)));
            let file = || SceneSource::File(scene.file.clone().unwrap_or_default());
            scenes.push(made.or(stand).unwrap_or_else(file));
        }
        let mut variants = Vec::new();
        for variant in &file.variants {
            lines.read::<Options>("run", variant.run.as_ref());
            let survey = match lines.read("plan", variant.plan.as_ref()) {
                Some(request) => {
                    lines.check_plan(&request, variant.plan.as_ref())?;
                    SurveySource::Plan { request, command: format!("vlscan plan {}", text_of(&variant.plan)) }
                }
                None => SurveySource::File(variant.survey.clone().unwrap_or_default()),
            };
            variants.push((survey, format!("{} {}", text_of(&file.run), text_of(&variant.run))));
        }
        lines.problems.finish(false)?;
        // The options of a variant in addition to those of all.
        let with_options = |(survey, run): (SurveySource, String)| {
            let options = words(&run).map_err(|e| Error::input(e.to_string())).and_then(Options::parse);
            let options = options.map_err(|error| Error::input(format!("run {run}: {error}")));
            options.map(|options| (survey, options))
        };
        Ok(Requests { scenes, variants: variants.into_iter().map(with_options).collect::<Result<_>>()? })
    }
}

/// The lines of a file, and their mistakes.
struct Lines<'f> {
    file: &'f File,
    problems: Diagnostics,
}

impl Lines<'_> {
    /// Finds before the first cell what every cell would fail for.
    fn check_plan(&mut self, request: &PlanRequest, line: Option<&Spanned<String>>) -> Result<()> {
        let Err(error) = check_instrument(request) else { return Ok(()) };
        let Error::Input(problems) = error else { return Err(error) };
        let place = line.and_then(|line| self.file.place(line));
        for problem in problems.items() {
            let message = format!("plan = \"…\": {}", problem.message);
            let mine = self.problems.error(place.clone(), message);
            mine.help = problem.help.clone();
        }
        Ok(())
    }

    /// Parses a line; `None` without one, and after problems.
    fn read<T: FromArgMatches>(&mut self, key: &'static str, line: Option<&Spanned<String>>) -> Option<T> {
        let line = line?;
        let place = self.file.place(line);
        let typed = match words(line.get_ref()) {
            Ok(typed) => typed,
            Err(unclosed) => {
                self.problems.error(place, unclosed.to_string());
                return None;
            }
        };
        let command = command(key);
        let decided = decided(&command, key, &typed);
        for (option, advice) in &decided {
            let message = format!("{key} = \"… {option} …\" cannot be used in a campaign");
            self.problems.error(place.clone(), message).help(*advice);
        }
        if !decided.is_empty() {
            return None;
        }
        // What the campaign adds, so that nothing that is required is missing.
        let added = if key == "plan" { &["--scene", "scene.xml"][..] } else { &[] };
        let all = typed.into_iter().chain(added.iter().map(|word| (*word).to_owned()));
        let parsed = command.try_get_matches_from(all).and_then(|matches| T::from_arg_matches(&matches));
        let parsed = parsed.map_err(|e| {
            let message = e.to_string();
            let lines = message.trim_start_matches("error: ").lines();
            let first: Vec<&str> = lines.take_while(|line| !line.is_empty()).map(str::trim).collect();
            self.problems.error(place, format!("{key} = \"…\": {}", first.join(" ")));
        });
        parsed.ok()
    }
}

const OUTPUT: &str =
    "the campaign names the files of a cell: set `out` for the folder and `format` for the format";
const FORMAT: &str = "write `format = \"…\"` at the top of the campaign's file";
const SEED: &str = "the seed of a cell is one of `seeds`, at the top of the campaign's file";
const SCENE: &str = "the scene of a cell is that of its [[scene]]";
const SHARED: &str = "it names one file, which all cells would overwrite";
const PART_TABLE: &str =
    "it names one file, which all cells would overwrite; each cell has its parts in objects.csv";
const SHARDS: &str =
    "cells are not divided into shards; to use more processes start the same campaign more than once";
const CAMPAIGN: &str = "give it to vlscan campaign";
const FORCE: &str =
    "cells are computed again when their options or inputs change; --retry computes failed ones";
const DRY: &str = "a cell is a run; give it to vlscan run with the same survey and scene";
const EPOCHS: &str = "a campaign scans one epoch of a stand";
const MESSAGES: &str = "give -v, -q and others to vlscan campaign";

/// Options that a campaign sets itself: keys of lines, names of options in them, and what to write instead.
const DECIDED: [(&[&str], &[&str], &str); 15] = [
    (&["run", "plan", "make", "stand"], &["out"], OUTPUT),
    (&["run"], &["output", "trajectory-out"], OUTPUT),
    (&["run"], &["format", "las-output"], FORMAT),
    (&["run", "plan", "make", "stand"], &["force"], FORCE),
    (&["run"], &["parts"], PART_TABLE),
    (&["run"], &["schedule-log", "objects"], SHARED),
    (&["plan"], &["lines"], SHARED),
    (&["run", "plan"], &["scene"], SCENE),
    (&["run", "make", "stand"], &["seed"], SEED),
    (&["run"], &["threads", "progress"], CAMPAIGN),
    (&["plan", "make", "stand"], &["strict"], CAMPAIGN),
    (&["run"], &["shard", "part", "part-points", "resume"], SHARDS),
    (&["run"], &["dry-run", "json", "coverage", "coverage-cell"], DRY),
    (&["stand"], &["epochs"], EPOCHS),
    (
        &["run", "plan", "make", "stand"],
        &["quiet", "verbose", "silent", "times", "log-file", "log-file-only", "help", "version"],
        MESSAGES,
    ),
];

/// The options that a campaign sets itself, without hyphens, each behind the key of a line that must not have
/// it.
pub fn options_of_campaigns() -> impl Iterator<Item = (&'static str, &'static str)> {
    DECIDED.into_iter().flat_map(|(keys, names, _)| {
        keys.iter().flat_map(move |key| names.iter().map(move |name| (*key, *name)))
    })
}

/// Replacement for an option that a campaign sets itself; `None` for those that it leaves to the line.
fn advice(key: &str, option: &str) -> Option<&'static str> {
    // A switch and its opposite alike.
    let option = option.strip_prefix("no-").unwrap_or(option);
    let decided = DECIDED.iter().find(|(keys, names, _)| keys.contains(&key) && names.contains(&option));
    decided.map(|(.., advice)| *advice)
}

/// The command whose options a line holds, and those that a campaign decides, too.
fn command(key: &'static str) -> Command {
    let empty = Command::new(key).no_binary_name(true).disable_help_flag(true).disable_version_flag(true);
    let command = match key {
        "run" => Options::augment_args(empty),
        "plan" => {
            PlanRequest::augment_subcommands(empty.subcommand_required(true).disable_help_subcommand(true))
        }
        "make" => SceneOptions::augment_args(empty),
        _ => StandOptions::augment_args(empty),
    };
    let is_there =
        |command: &Command, name: &str| command.get_arguments().any(|a| a.get_long() == Some(name));
    let names = DECIDED.iter().filter(|(keys, ..)| keys.contains(&key)).flat_map(|(_, names, _)| *names);
    let command = names.fold(command, |command, name| {
        let missing = |command: &Command| {
            let option = Arg::new(*name).long(*name).hide(true).num_args(0..=1);
            let short = match *name {
                "out" => Some('o'),
                "quiet" | "verbose" | "help" => name.chars().next(),
                "version" => Some('V'),
                _ => None,
            };
            let is_free = |c: &char| command.get_arguments().all(|a| a.get_short() != Some(*c));
            match short.filter(is_free) {
                Some(short) => option.short(short),
                None => option,
            }
        };
        match key {
            "plan" => command.mut_subcommands(|kind| match is_there(&kind, name) {
                true => kind,
                false => {
                    let option = missing(&kind);
                    kind.disable_help_flag(true).disable_version_flag(true).arg(option)
                }
            }),
            _ if is_there(&command, name) => command,
            _ => {
                let option = missing(&command);
                command.arg(option)
            }
        }
    });
    with_negative_numbers(command)
}

/// The options among `typed` that a campaign decides itself, with what to write instead.
fn decided(command: &Command, key: &str, typed: &[String]) -> Vec<(String, &'static str)> {
    let Ok(matches) = command.clone().ignore_errors(true).try_get_matches_from(typed) else {
        return Vec::new();
    };
    let mut all = Vec::new();
    collect(command, &matches, key, &mut all);
    all
}

fn collect(command: &Command, matches: &ArgMatches, key: &str, all: &mut Vec<(String, &'static str)>) {
    for argument in command.get_arguments() {
        let id = argument.get_id().as_str();
        let is_typed = matches.ids().any(|known| known.as_str() == id)
            && matches.value_source(id) == Some(ValueSource::CommandLine);
        let Some(long) = argument.get_long().filter(|_| is_typed) else { continue };
        if let Some(advice) = advice(key, long) {
            let name = argument
                .get_short()
                .map_or_else(|| format!("--{long}"), |short| format!("-{short} (--{long})"));
            all.push((name, advice));
        }
    }
    if let Some((name, inner)) = matches.subcommand()
        && let Some(command) = command.find_subcommand(name)
    {
        collect(command, inner, key, all);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusals(key: &'static str, line: &str) -> Vec<String> {
        decided(&command(key), key, &words(line).unwrap()).into_iter().map(|(option, _)| option).collect()
    }

    #[test]
    fn what_a_campaign_decides_itself_is_refused() {
        assert_eq!(refusals("run", "--seed 7 --labels --format xyz"), ["--format", "--seed"]);
        assert_eq!(
            refusals("run", "-o a.laz --scene s.xml -j 3"),
            ["-o (--out)", "--scene", "-j (--threads)"]
        );
        assert_eq!(refusals("run", "-q --resume --shard 0/2"), ["--shard", "--resume", "-q (--quiet)"]);
        assert_eq!(refusals("plan", "airborne --scanner x --height 9 -o a.toml"), ["-o (--out)"]);
        assert_eq!(refusals("stand", "i.csv --trees m --seed 3 --epochs 4"), ["--seed", "--epochs"]);
        assert_eq!(refusals("make", "forest --seed=3"), ["--seed"]);
        for allowed in ["--tile 10 --labels --assets x --physics refined --strict", ""] {
            assert!(refusals("run", allowed).is_empty(), "{allowed}");
        }
    }

    #[test]
    fn lines_that_cannot_be_read_are_refused_with_their_place() {
        let text = "out = \"o\"\nrun = \"--nonsense\"\n[[scene]]\nname = \"s\"\nmake = \"forest --seed 3\"\n\
            [[variant]]\nname = \"v\"\nplan = \"airborne --scanner x\"\nrun = \"'x\"\n";
        let file = File::parse(std::path::Path::new("c.toml"), text.to_owned()).unwrap();
        let Err(Error::Input(found)) = Requests::of(&file) else { panic!() };
        let report = found.text();
        for part in
            ["c.toml:2", "--nonsense", "c.toml:5", "`seeds`", "c.toml:8", "--height", "c.toml:9", "quote"]
        {
            assert!(report.contains(part), "{part}: {report}");
        }
    }
}
