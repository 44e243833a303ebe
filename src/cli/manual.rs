//! Parts of the manual beyond the options: examples, files and exit statuses of every subcommand; and the
//! manual pages, which `vlscan man DIR` writes in the format of man(7).
//!
//! The pages in `man/` are checked in, and so is `python/vlscan/_options.py`, which `vlscan man --python DIR`
//! writes; `tests/whole/manual.rs` fails when they differ from the generated ones.

use super::Cli;
use super::args::{CompletionsArgs, ManArgs};
use super::console::Console;
use super::messages;
use clap::{Command, CommandFactory};
use clap_mangen::Man;
use clap_mangen::roff::{Roff, bold, roman};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileGroup, FileWriter, Patched, reads, write_stdout};
use vlscan_lidar::pulse::Corrections;
use vlscan_options::{command_schema, pipeline_keys, pipeline_schema, python_module};

/// Introduction below the short help, for new users.
const BEGIN: &str = "\
To begin:
  vlscan scene make forest -n 20k -o forest
  vlscan run forest/survey.xml -o forest.laz
  vlscan preview forest.laz -o forest.html";

/// The examples and files of every command.
const PAGES: &str = include_str!("manual/pages.md");

/// The manual's content on a command besides its options.
#[derive(Clone, Copy)]
struct Page {
    /// The command as typed: `vlscan scene make`.
    path: &'static str,
    /// Shell lines with comments; an empty line between examples.
    examples: &'static str,
    /// The list of files that are read or written.
    files: &'static str,
}

impl Page {
    /// Files with their descriptions.
    fn files(self) -> Vec<(&'static str, &'static str)> {
        self.files.lines().filter_map(|line| line.strip_prefix("- `")?.split_once("`: ")).collect()
    }
}

/// The pages of all commands.
fn pages() -> impl Iterator<Item = Page> {
    PAGES.split("\n## ").skip(1).filter_map(|page| {
        let (path, rest) = page.split_once("\n\n```sh\n")?;
        let (examples, files) = rest.split_once("\n```\n")?;
        Some(Page { path, examples, files })
    })
}

/// Exit statuses, common to all subcommands.
const EXIT_STATUS: &[(&str, &str)] = &[
    ("0", "Success. Also when the reader of stdout closes it, as head(1) does."),
    ("1", "A system error: a file could not be read or written, or the disk is full."),
    ("2", "The input or the command line is invalid; the message states where, and what was expected."),
    ("3", "A scan frequency is outside the scanner's limits."),
    (
        "4",
        "The run cannot be divided into shards (--shard, --resume), or not continued with the shards that \
         exist; without them it can be computed.",
    ),
    ("5", "Another process is using the folder of the shards; repeat the command when it has finished."),
    (
        "130",
        "Interrupted (Ctrl-C, SIGTERM): files and streams are valid, contain what was done so far, and are \
         marked as partial.",
    ),
];

/// Returns the command line with the examples of `manual/pages.md` and the exit statuses at the end of each
/// `--help`.
pub fn command() -> Command {
    let mut command = with_examples(Cli::definition(), "vlscan").after_help(BEGIN);
    // Passes global options to the subcommands, and sets the full names of all commands.
    command.build();
    command
}

/// Texts that every page of this program and the module of options contain.
const MARKS: [&str; 2] = [".TH VLSCAN", "`vlscan man --python`"];

/// Runs `vlscan man`: writes a page for every subcommand to a directory. Existing pages of this program are
/// replaced, other files are not.
pub fn run(args: &ManArgs, console: &Console) -> Result<()> {
    let Some(dir) = &args.dir else { return schemas() };
    let mut group = FileGroup::default();
    group.create_folder(dir)?;
    let pages = match args.python {
        true => vec![("_options.py".to_owned(), python_module()?.into_bytes())],
        false => manual()?,
    };
    for path in pages.iter().map(|(name, _)| dir.join(name)).filter(|path| path.exists()) {
        let text = reads::read_own(&path).map_err(|e| Error::open(&path, e))?;
        if !MARKS.iter().any(|mark| String::from_utf8_lossy(&text).contains(mark)) {
            return Err(Error::input(format!(
                "{} exists and is not a page of vlscan; choose another folder",
                path.display()
            )));
        }
    }
    for (name, text) in &pages {
        group.write(&dir.join(name), true, text)?;
    }
    group.commit()?;
    if !args.python {
        let page = dir.join("vlscan.1");
        let text =
            format!("{} pages in {}; view them with: man -l {}", pages.len(), dir.display(), page.display());
        console.wrote(messages::written(dir, "pages"), text);
    }
    Ok(())
}

/// Commands whose options `vlscan man --json-schema` describes.
const DESCRIBED: [&str; 8] = [
    "run",
    "plan airborne",
    "plan terrestrial",
    "plan mobile",
    "compare",
    "preview",
    "campaign",
    "scene stand",
];

/// Writes to stdout what commands and pipeline files take, as JSON Schema.
fn schemas() -> Result<()> {
    let root = Cli::command();
    let of = |path: &&str| {
        let command = path.split(' ').try_fold(&root, |command, name| command.find_subcommand(name));
        ((*path).to_owned(), command.map(command_schema).unwrap_or_default())
    };
    let commands: serde_json::Map<_, _> = DESCRIBED.iter().map(of).collect();
    let schemas = serde_json::json!({
        "version": env!("CARGO_PKG_VERSION"),
        "commands": commands,
        "pipeline": pipeline_schema(),
    });
    write_stdout(&format!("{schemas:#}\n"))
}

/// Runs `vlscan completions`: writes the script that completes the command line to stdout.
pub fn completions(args: &CompletionsArgs) -> Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command(), "vlscan", &mut script);
    FileWriter::stdout(Patched::Never)?.append(&script)
}

fn page(path: &str) -> Option<Page> {
    pages().find(|page| page.path == path)
}

fn with_examples(command: Command, path: &str) -> Command {
    let names: Vec<String> = command.get_subcommands().map(|sub| sub.get_name().to_owned()).collect();
    let command = names.iter().fold(command, |command, name| {
        command.mut_subcommand(name, |sub| with_examples(sub, &format!("{path} {name}")))
    });
    let examples = page(path).map(|page| {
        let lines: String = page.examples.lines().map(|line| format!("  {line}\n")).collect();
        format!("Examples:\n{}\n\n", lines.replace("  \n", "\n").trim_end())
    });
    let command = with_short_help(command, path);
    let corrections = takes_corrections(&command).then(corrections).unwrap_or_default();
    command
        .mut_args(taking_negative_numbers)
        .after_long_help(corrections + &examples.unwrap_or_default() + &exit_status())
}

/// An option that takes the number of `--speed -5` as its value, so that its own message rejects the number.
fn taking_negative_numbers(arg: clap::Arg) -> clap::Arg {
    let takes_values =
        arg.get_num_args().map_or(arg.get_action().takes_values(), |range| range.takes_values());
    if takes_values && !arg.is_positional() { arg.allow_negative_numbers(true) } else { arg }
}

/// The options that `-h` shows where a command has many; `--help` shows all.
const COMMON_OPTIONS: [&str; 13] = [
    "out",
    "format",
    "force",
    "crs",
    "scene",
    "strict",
    "trajectory.path",
    "seed",
    "profile",
    "threads",
    "folder",
    "scanner",
    "check",
];

/// Maximum number of options that `-h` shows all of.
const MAX_SHORT_OPTIONS: usize = 28;

/// Leaves all but the usual and the required options out of `-h` where there are many. `path` is the
/// command's full name.
fn with_short_help(command: Command, path: &str) -> Command {
    if command.get_arguments().filter(|arg| !arg.is_hide_set()).count() <= MAX_SHORT_OPTIONS {
        return command;
    }
    let is_common = |arg: &clap::Arg| {
        arg.is_positional() || arg.is_required_set() || COMMON_OPTIONS.contains(&arg.get_id().as_str())
    };
    command
        .mut_args(|arg| if is_common(&arg) { arg } else { arg.hide_short_help(true) })
        .after_help(format!("All options, in groups, with examples: {path} --help"))
}

fn takes_corrections(command: &Command) -> bool {
    command.get_arguments().any(|arg| arg.get_id() == "correct")
}

/// Returns, for every correction, its name as typed, whether the refined physics includes it, and its
/// meaning.
fn correction_entries() -> impl Iterator<Item = (String, String)> {
    let mut refined = Corrections::REFINED;
    Corrections::NAMES.iter().zip(Corrections::HELP).map(move |(name, help)| {
        let aside = if refined.by_name(name).is_some_and(|on| *on) { "" } else { " (not part of refined)" };
        (name.replace('_', "-") + aside, help.trim().to_owned())
    })
}

/// How the command line overrides a pipeline file.
const OPPOSITES: &str =
    "To undo a switch of a pipeline file, give its opposite: --no-misses, --platform-noise and so on.";

/// Formats the corrections for help.
fn corrections() -> String {
    let mut text = "Corrections (--correct NAME switches one on, --correct no-NAME off; --physics refined \
                    includes all that are not marked; those of the kinematics are always on in pipeline \
                    files):\n"
        .to_owned();
    for (name, help) in correction_entries() {
        text += &format!("  {name}\n{}\n", wrapped(&help, 90));
    }
    format!("{text}\n{OPPOSITES}\n\n")
}

/// Wraps a text to indented lines of at most `width` characters.
fn wrapped(text: &str, width: usize) -> String {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines.iter().map(|line| format!("      {line}")).collect::<Vec<_>>().join("\n")
}

/// Formats the exit statuses for help.
fn exit_status() -> String {
    let lines: Vec<String> =
        EXIT_STATUS.iter().map(|(status, meaning)| format!("  {status:<3}  {meaning}")).collect();
    format!("Exit status:\n{}", lines.join("\n"))
}

/// Returns file name and text of all pages.
fn manual() -> Result<Vec<(String, Vec<u8>)>> {
    let mut pages = Vec::new();
    let mut root = Cli::command().disable_help_subcommand(true);
    root.build();
    collect(&root, "vlscan", &[], &mut pages)?;
    pages.push(("vlscan-pipeline.5".to_owned(), pipeline_page()));
    pages.sort();
    Ok(pages)
}

fn collect(command: &Command, path: &str, kin: &[String], pages: &mut Vec<(String, Vec<u8>)>) -> Result<()> {
    let visible = || command.get_subcommands().filter(|sub| !sub.is_hide_set());
    let below: Vec<String> = visible().map(|sub| format!("{path} {}", sub.get_name())).collect();
    for (sub, path) in visible().zip(&below) {
        let kin: Vec<String> = below.iter().filter(|other| *other != path).cloned().collect();
        collect(sub, path, &kin, pages)?;
    }
    let related: Vec<String> = match path.rsplit_once(' ') {
        None => below,
        Some((parent, _)) => {
            [parent.to_owned()].into_iter().chain(below).chain(kin.iter().cloned()).collect()
        }
    };
    let failed = |e: std::io::Error| Error::Internal(format!("manual page of {path}: {e}"));
    pages.push((format!("{}.1", path.replace(' ', "-")), written(command, path, &related).map_err(failed)?));
    Ok(())
}

fn written(command: &Command, path: &str, related: &[String]) -> std::io::Result<Vec<u8>> {
    let mut short = command.clone();
    let usage = short.render_usage().to_string();
    // A synopsis of sixty options is not informative.
    let short = short.override_usage(usage.trim_start_matches("Usage:").trim().to_owned());
    let man = Man::new(short)
        .title(path.replace(' ', "-").to_uppercase())
        .source(format!("vlscan {}", env!("CARGO_PKG_VERSION")))
        .manual("vlscan manual");
    let mut text = Vec::new();
    man.render_title(&mut text)?;
    man.render_name_section(&mut text)?;
    man.render_synopsis_section(&mut text)?;
    man.render_description_section(&mut text)?;
    man.render_options_section(&mut text)?;
    if command.get_subcommands().any(|sub| !sub.is_hide_set()) {
        man.render_subcommands_section(&mut text)?;
    }
    let mut ours = Roff::new();
    if let Some(page) = page(path) {
        verbatim(&mut ours, "EXAMPLES", page.examples);
        let files = page.files();
        if !files.is_empty() {
            ours.control("SH", ["FILES"]);
            entries(&mut ours, files);
        }
    }
    if takes_corrections(command) {
        ours.control("SH", ["CORRECTIONS"]);
        entries(&mut ours, correction_entries());
        ours.control("SH", ["SWITCHES"]);
        ours.text([roman(OPPOSITES)]);
    }
    ours.control("SH", ["EXIT STATUS"]);
    entries(&mut ours, EXIT_STATUS.iter().copied());
    ours.control("SH", ["SEE ALSO"]);
    ours.text([roman(
        related.iter().map(|p| format!("{}(1)", p.replace(' ', "-"))).collect::<Vec<_>>().join(", "),
    )]);
    ours.to_writer(&mut text)?;
    Ok(in_ascii(&String::from_utf8_lossy(&text)).into_bytes())
}

/// Returns the page on pipeline files, from the definitions of their keys.
fn pipeline_page() -> Vec<u8> {
    let version = format!("vlscan {}", env!("CARGO_PKG_VERSION"));
    let mut page = Roff::new();
    page.control("TH", ["VLSCAN-PIPELINE", "5", "", &version, "vlscan manual"]);
    page.control("SH", ["NAME"]);
    page.text([roman("vlscan-pipeline - files that describe a run of vlscan(1)")]);
    verbatim(&mut page, "SYNOPSIS", PIPELINE_EXAMPLE);
    for table in pipeline_keys() {
        page.control("SH", [if table.name.is_empty() { "KEYS AT THE TOP" } else { &table.name }]);
        page.text([roman(table.about)]);
        entries(&mut page, table.keys.into_iter().map(|key| (key.name, key.help)));
    }
    page.control("SH", ["SEE ALSO"]);
    page.text([roman("vlscan(1), vlscan-run(1)")]);
    in_ascii(&page.render()).into_bytes()
}

const PIPELINE_EXAMPLE: &str = r#"scene = "forest.xml#forest"

[trajectory]
path = "-"

[scanner]
catalogue = "data/scanners_als.xml#riegl_vux-1uav"

[settings]
scan_freq_hz = 100

[[output]]
path = "points.laz""#;

/// Replaces non-ASCII letters by their code points, which groff(7) accepts without knowing the encoding.
fn in_ascii(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut plain, c| {
        if c.is_ascii() {
            plain.push(c);
        } else {
            plain.push_str(&format!("\\[u{:04X}]", u32::from(c)));
        }
        plain
    })
}

/// Writes shell lines or a file verbatim: no filling, no typographic hyphens.
fn verbatim(page: &mut Roff, heading: &str, text: &str) {
    page.control("SH", [heading]);
    page.control("EX", []);
    for line in text.lines() {
        page.text([roman(line)]);
    }
    page.control("EE", []);
}

/// Writes terms, each with its meaning.
fn entries<T: Into<String>>(page: &mut Roff, entries: impl IntoIterator<Item = (T, T)>) {
    for (term, meaning) in entries {
        page.control("TP", []);
        page.text([bold(term.into())]);
        page.text([roman(meaning.into())]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn visit(command: &Command, path: &str, see: &mut impl FnMut(&Command, &str)) {
        see(command, path);
        for sub in command.get_subcommands().filter(|sub| !sub.is_hide_set() && sub.get_name() != "help") {
            visit(sub, &format!("{path} {}", sub.get_name()), see);
        }
    }

    #[test]
    fn every_subcommand_has_examples() {
        let mut seen = Vec::new();
        visit(&command(), "vlscan", &mut |command, path| {
            seen.push(path.to_owned());
            assert!(page(path).is_some(), "`{path}` has no examples: add it to src/cli/manual/pages.md");
            let help = command.clone().render_long_help().to_string();
            assert!(help.contains("Examples:\n  "), "{path}:\n{help}");
            assert!(
                help.contains("Exit status:\n  0    Success") && help.contains("\n  130  "),
                "{path}:\n{help}"
            );
        });
        assert_eq!(pages().count(), PAGES.matches("\n## ").count(), "a section of pages.md has no examples");
        for Page { path, .. } in pages() {
            assert!(seen.iter().any(|known| known == path), "pages.md has {path}, which is no command");
        }
    }

    #[test]
    fn short_help_names_commands_that_exist_and_what_they_need() {
        let root = command();
        visit(&root, "vlscan", &mut |command, path| {
            let help = command.clone().render_help().to_string();
            for name in
                command.get_arguments().filter(|arg| arg.is_required_set()).filter_map(clap::Arg::get_long)
            {
                assert!(help.contains(&format!("--{name}")), "{path} -h hides --{name}:\n{help}");
            }
            if let Some((_, named)) = help.split_once("with examples: ") {
                assert_eq!(named.trim(), format!("{path} --help"));
            }
        });
        let plan = root.find_subcommand("plan").unwrap().find_subcommand("airborne").unwrap();
        let help = plan.clone().render_help().to_string();
        for option in ["--height", "--area", "--density", "--speed", "--overlap"] {
            assert!(help.contains(option), "{help}");
        }
    }

    #[test]
    fn help_lists_every_correction() {
        let mut root = command();
        for name in ["run", "trace", "pulses", "trajectory"] {
            let help = root.find_subcommand_mut(name).unwrap().render_long_help().to_string();
            for (term, meaning) in correction_entries() {
                let start: Vec<&str> = meaning.split_whitespace().take(5).collect();
                assert!(
                    help.contains(&format!("\n  {term}\n      {}", start.join(" "))),
                    "{name}: {term}\n{help}"
                );
            }
        }
        assert!(wrapped("one two three", 7) == "      one two\n      three");
    }

    #[test]
    fn letters_beyond_ascii_are_numbered() {
        assert_eq!(in_ascii("3 × 4 … ok"), "3 \\[u00D7] 4 \\[u2026] ok");
    }

    #[test]
    fn the_definition_of_the_command_line_holds_together() {
        Cli::command().debug_assert();
    }

    #[test]
    fn a_page_has_its_sections_and_no_hyphens_of_typography() {
        let pages = manual().unwrap();
        let (_, text) = pages.iter().find(|(name, _)| name == "vlscan-scene-make.1").unwrap();
        let text = String::from_utf8(text.clone()).unwrap();
        let mut rest = text.as_str();
        for section in ["NAME", "SYNOPSIS", "DESCRIPTION", "OPTIONS", "EXAMPLES", "EXIT STATUS", "SEE ALSO"] {
            let quoted =
                if section.contains(' ') { format!(".SH \"{section}\"") } else { format!(".SH {section}") };
            let (_, after) = rest.split_once(&quoted).unwrap_or_else(|| panic!("no {section} in:\n{text}"));
            rest = after;
        }
        assert!(text.contains("vlscan scene make forest \\-n"), "{text}");
    }
}
