//! The lines of a campaign's file that hold options of commands. What a campaign decides itself is refused, with its line in the file
//! and what to write instead: an option that changes nothing must not stand in the record of a cell.

use super::super::args::Cli;
use clap::parser::ValueSource;
use clap::{ArgMatches, Command, CommandFactory};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;
use vlscan_tools::campaign::{File, Line, words};

/// Whether an option may stand in a line; the text says what to write instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Use {
    Allowed,
    Refused(&'static str),
}

use Use::{Allowed, Refused};

const OUTPUT: Use = Refused(
    "the files of a cell have their names from the campaign: `out` names the folder, `format` the format",
);
const FORMAT: Use = Refused("write `format = \"…\"` at the top of the campaign's file");
const SEED: Use = Refused("the seed of a cell is one of `seeds`, at the top of the campaign's file");
const SCENE: Use = Refused("the scene of a cell is that of its [[scene]]");
const SHARED: Use = Refused("it names one file, which every cell would write");
const PART_TABLE: Use = Refused(
    "it names one file, which every cell would write; objects.csv of each cell has the parts of its scene",
);
const SHARDS: Use =
    Refused("a cell is computed at once; processes share the cells: start the same campaign more than once");
const THREADS: Use = Refused("give it to vlscan campaign");
const FORCE: Use =
    Refused("cells are computed again when their options or inputs change; --retry computes failed ones");
const DRY: Use = Refused("a cell is a run; give it to vlscan run with the same survey and scene");
const EPOCHS: Use = Refused("a campaign scans one epoch of a stand");
const MESSAGES: Use = Refused("give -v, -q and others to vlscan campaign");

/// Every option of the commands in lines, by the name of its argument. A test holds that none is missing.
fn use_of(command: &str, id: &str) -> Option<Use> {
    let global = match id {
        "help" | "version" | "quiet" | "verbose" | "silent" | "times" | "logfile" | "logfileonly" => {
            Some(MESSAGES)
        }
        _ => None,
    };
    let strict = if command == "run" { Allowed } else { Refused("give it to vlscan campaign") };
    global.or_else(|| (id == "strict").then_some(strict)).or_else(|| match command {
        "run" => use_in_run(id),
        "plan" => use_in_plan(id),
        _ => use_in_scene(id),
    })
}

/// Headings of options of `vlscan run` under which every option is decided here; options under other headings say how is measured, and
/// are allowed unless they are named here.
#[cfg(test)]
const DECIDED_HEADINGS: [&str; 3] = ["Output", "Shards", "Dry run"];

fn use_in_run(id: &str) -> Option<Use> {
    Some(match id {
        "out" | "output" | "trajectory_out" => OUTPUT,
        "format" | "las_output" => FORMAT,
        "force" => FORCE,
        "part_table" => PART_TABLE,
        "schedule_log" => SHARED,
        "scene" => SCENE,
        "seed" => SEED,
        "threads" | "progress" => THREADS,
        "shard" | "part_points" | "resume" => SHARDS,
        "dry_run" | "json" => DRY,
        "waveforms"
        | "pulses"
        | "columns"
        | "labels"
        | "true_positions"
        | "height_above_ground"
        | "frame_s"
        | "tile"
        | "per_object"
        | "subrays"
        | "misses"
        | "las_at_most"
        | "wave_packets"
        | "split_by_channel"
        | "crs"
        | "las10"
        | "zip_output"
        | "las_scale"
        | "las_extra" => Allowed,
        _ => return None,
    })
}

fn use_in_plan(id: &str) -> Option<Use> {
    Some(match id {
        "out" => OUTPUT,
        "scene" => SCENE,
        "force" => FORCE,
        _ => return None,
    })
}

fn use_in_scene(id: &str) -> Option<Use> {
    Some(match id {
        "out" => OUTPUT,
        "seed" => SEED,
        "epochs" => EPOCHS,
        "force" => FORCE,
        _ => return None,
    })
}

/// Checks all lines of a campaign.
///
/// # Errors
/// [`crate::Error::Input`] with the place of every line that is not one of options that a campaign leaves to it.
pub fn check(file: &File) -> Result<()> {
    let mut problems = Diagnostics::default();
    let mut root = Cli::command();
    root.build();
    for line in &file.lines {
        check_line(&root, line, &mut problems);
    }
    problems.finish(false).map(drop)
}

fn check_line(root: &Command, line: &Line, problems: &mut Diagnostics) {
    let typed = match words(&line.text) {
        Ok(typed) => typed,
        Err(message) => {
            problems.error(Some(line.place.clone()), message);
            return;
        }
    };
    let mut found = false;
    for (option, advice) in refused(root, line.key, &typed) {
        found = true;
        problems
            .error(Some(line.place.clone()), format!("{} = \"…\": {option} is not for campaigns", line.key))
            .help(advice);
    }
    if found {
        return;
    }
    // What the campaign adds, so that nothing that is required is missing.
    let (before, after): (&[&str], &[&str]) = match line.key {
        "run" => (&["run", "survey.xml"], &[]),
        "plan" => (&["plan"], &["--scene", "scene.xml", "-o", "plan.toml"]),
        "make" => (&["scene", "make"], &["-o", "scene", "--seed", "1"]),
        _ => (&["scene", "stand"], &["-o", "scene", "--seed", "1"]),
    };
    let all = ["vlscan"].iter().chain(before).map(|word| (*word).to_owned());
    let all = all.chain(typed).chain(after.iter().map(|word| (*word).to_owned()));
    if let Err(e) = root.clone().try_get_matches_from(all) {
        let message = e.to_string();
        let lines = message.trim_start_matches("error: ").lines();
        let first: Vec<&str> = lines.take_while(|line| !line.is_empty()).map(str::trim).collect();
        problems.error(Some(line.place.clone()), format!("{} = \"…\": {}", line.key, first.join(" ")));
    }
}

/// The options among `typed` that a campaign decides itself, with what to write instead.
fn refused(root: &Command, command: &str, typed: &[String]) -> Vec<(String, &'static str)> {
    let at = |parent: &Command, name: &str| parent.find_subcommand(name).cloned();
    let found = match command {
        "run" | "plan" => at(root, command),
        _ => at(root, "scene").and_then(|scene| at(&scene, command)),
    };
    let Some(found) = found else { return Vec::new() };
    let reader = found.clone().ignore_errors(true).no_binary_name(true).disable_help_flag(true);
    let Ok(matches) = reader.disable_version_flag(true).try_get_matches_from(typed) else {
        return Vec::new();
    };
    let mut all = Vec::new();
    collect(&found, &matches, command, &mut all);
    all
}

fn collect(command: &Command, matches: &ArgMatches, of: &str, all: &mut Vec<(String, &'static str)>) {
    for argument in command.get_arguments() {
        let id = argument.get_id().as_str();
        let is_typed = matches.ids().any(|known| known.as_str() == id)
            && matches.value_source(id) == Some(ValueSource::CommandLine);
        if let (true, Some(Refused(advice))) = (is_typed, use_of(of, id)) {
            let name = argument.get_long().map_or_else(|| id.to_owned(), |long| format!("--{long}"));
            let name = argument.get_short().map_or(name.clone(), |short| format!("-{short} ({name})"));
            all.push((name, advice));
        }
    }
    if let Some((name, inner)) = matches.subcommand()
        && let Some(command) = command.find_subcommand(name)
    {
        collect(command, inner, of, all);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn root() -> Command {
        let mut root = Cli::command();
        root.build();
        root
    }

    fn refusals(command: &str, line: &str) -> Vec<String> {
        refused(&root(), command, &words(line).unwrap()).into_iter().map(|(option, _)| option).collect()
    }

    #[test]
    fn every_option_of_outputs_and_shards_is_decided() {
        let root = root();
        let run = root.find_subcommand("run").unwrap();
        for argument in run.get_arguments() {
            let heading = argument.get_help_heading().unwrap_or_default();
            if DECIDED_HEADINGS.contains(&heading) {
                let id = argument.get_id().as_str();
                assert!(
                    use_in_run(id).is_some(),
                    "decide whether a campaign's `run` may hold {id}: `use_in_run`"
                );
            }
        }
        let has = |command: &Command, id: &str| command.get_arguments().any(|a| a.get_id().as_str() == id);
        for id in
            ["out", "format", "scene", "seed", "threads", "schedule_log", "part_table", "dry_run", "resume"]
        {
            assert!(has(run, id), "{id}");
        }
        let scene = root.find_subcommand("scene").unwrap();
        for kind in root.find_subcommand("plan").unwrap().get_subcommands().filter(|c| c.get_name() != "help")
        {
            assert!(["out", "scene", "force"].iter().all(|id| has(kind, id)), "{}", kind.get_name());
        }
        for kind in ["make", "stand"] {
            assert!(["out", "seed", "force"].iter().all(|id| has(scene.find_subcommand(kind).unwrap(), id)));
        }
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
        let Err(crate::Error::Input(found)) = check(&file) else { panic!() };
        let report = found.render(false);
        for part in
            ["c.toml:2", "--nonsense", "c.toml:5", "`seeds`", "c.toml:8", "--height", "c.toml:9", "quote"]
        {
            assert!(report.contains(part), "{part}: {report}");
        }
    }
}
