//! Translation of HELIOS++ command lines (spec outputs §9): its option names in any case, options before or
//! after the survey, values that begin with a minus, the first of repeated values, `SURVEY.xml` without
//! `run`.

use std::ffi::{OsStr, OsString};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};

/// Argument of a HELIOS++ option.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Takes {
    /// None; repetitions have no effect.
    Nothing,
    /// None, and every occurrence counts.
    NothingEachTime,
    /// None, and the option has no effect in this program.
    NothingIgnored,
    /// A value; the first occurrence wins.
    Value,
    /// A value; all occurrences count.
    Values,
    /// A value without effect on the points, which is ignored.
    ValueIgnored,
}
use Takes::{Nothing, NothingEachTime, NothingIgnored, Value, ValueIgnored, Values};

/// The option for the number of HELIOS++'s schedule, which [`name_schedule`] replaces.
const PARALLELIZATION: &str = "--parallelization";

/// HELIOS++ options that `vlscan run` accepts, and the name of each in this program (spec outputs §9.2).
const NAMES: &[(&str, &str, Takes)] = &[
    ("--assets", "--assets", Values),
    ("-a", "--assets", Values),
    ("--output", "--output", Value),
    ("--seed", "--seed", Value),
    ("--gpsStartTime", "--gps-start", Value),
    ("--splitByChannel", "--split-by-channel", Nothing),
    ("--writeWaveform", "--waveforms", Nothing),
    ("--writePulse", "--pulses", Nothing),
    ("--calcEchowidth", "--echo-width", Nothing),
    ("--fullwaveNoise", "--waveform-noise", Nothing),
    ("--fixedIncidenceAngle", "--fixed-incidence", Nothing),
    ("--lasOutput", "--las-output", Nothing),
    ("--las10", "--las10", Nothing),
    ("--zipOutput", "--zip-output", Nothing),
    ("--lasScale", "--las-scale", Value),
    ("-j", "--threads", Value),
    ("--njobs", "--threads", Value),
    ("--nthreads", "--threads", Value),
    ("--num-threads", "--threads", Value),
    ("--numThreads", "--threads", Value),
    ("--parallelization", PARALLELIZATION, Value),
    ("--chunkSize", "--chunk-size", Value),
    ("--warehouseFactor", "--warehouse-factor", Value),
    ("--dryrun", "--dry-run", Nothing),
    ("--rebuildScene", "", NothingIgnored),
    ("--noSceneWriting", "", NothingIgnored),
    ("--kdt", "--tree", Value),
    ("--kdtJobs", "--tree-jobs", Value),
    ("--kdtGeomJobs", "", ValueIgnored),
    ("--sahNodes", "", ValueIgnored),
    ("--disablePlatformNoise", "--no-platform-noise", Nothing),
    ("--disableLegNoise", "--no-leg-noise", Nothing),
    ("--legacyEnergyModel", "--legacy-energy", Nothing),
    ("--logFile", "--log-file", Nothing),
    ("--logFileOnly", "--log-file-only", Nothing),
    ("--silent", "--silent", Nothing),
    ("-q", "--quiet", Nothing),
    ("--quiet", "--quiet", Nothing),
    ("-vt", "--times", Nothing),
    ("--vt", "--times", Nothing),
    ("--v2", "-vv", NothingEachTime),
    ("-v", "--verbose", NothingEachTime),
    ("-v2", "-vv", NothingEachTime),
    ("-vv", "-vv", NothingEachTime),
    ("--help", "--help", Nothing),
];

/// Options that make sense only in builds of HELIOS++ with its tests and windows.
const REFUSED: &[(&str, &str)] = &[
    ("--test", "there are no built-in self tests; `cargo test` in the source folder runs them"),
    ("--testDir", "there are no built-in self tests; `cargo test` in the source folder runs them"),
    ("--demo", "there are no demonstrations; `vlscan scene make` makes a scene with a survey to try"),
    ("--demoSurvey", "there are no demonstrations; `vlscan scene make` makes a scene with a survey to try"),
    ("--demoAssets", "there are no demonstrations; `vlscan scene make` makes a scene with a survey to try"),
];

/// Replaces HELIOS++ options in the arguments, where they are for `run` or for no subcommand; other arguments
/// are unchanged. Later values of options that have only one are recorded in `found`.
///
/// # Errors
/// [`Error::Input`] for options without a counterpart, with a remedy.
pub fn translate_helios_args(
    args: impl IntoIterator<Item = OsString>,
    found: &mut Diagnostics,
) -> Result<Vec<OsString>> {
    let args: Vec<OsString> = args.into_iter().collect();
    let Some((program, words)) = args.split_first() else { return Ok(args) };
    let subject = words.get(subject(words)).map(OsString::as_os_str);
    let is_run = subject.is_some_and(|word| word == "run");
    let is_survey = subject.is_some_and(is_xml);
    let is_ours = subject.is_some() && !is_run && !is_survey;
    // Refused options of developer builds take values that look like subcommands or files.
    let checked = if is_ours { &words[..1] } else { words };
    if let Some((name, why)) = checked.iter().find_map(|word| named(REFUSED, word, |entry| entry.0)) {
        return Err(Error::input(format!("{name}: {why}")));
    }
    if is_ours {
        return Ok(args);
    }
    if words.iter().any(|word| is(word, "--version")) {
        return Ok(vec![program.clone(), "--version".into()]);
    }
    if let Some(at) = words.iter().position(|word| is(word, "--unzip")) {
        let files = words[at + 1..].iter().take(2).cloned();
        return Ok([program.clone(), "unzip".into(), "--force".into()].into_iter().chain(files).collect());
    }
    if !is_run && !is_survey {
        return Ok(args);
    }
    let mut ours = vec![program.clone(), "run".into()];
    ours.extend(translated(words, is_run, found));
    Ok(ours)
}

/// Returns the words with this program's option names; the first `run` is left out if there is one. Warns of
/// later values that differ from the first one.
fn translated(words: &[OsString], mut skip_run: bool, found: &mut Diagnostics) -> Vec<OsString> {
    let mut ours: Vec<OsString> = Vec::with_capacity(words.len());
    let mut seen: Vec<(&str, OsString)> = Vec::new();
    let mut rest = words.iter();
    while let Some(word) = rest.next() {
        if word == "--" {
            ours.push(word.clone());
            ours.extend(rest.cloned());
            break;
        }
        if skip_run && word == "run" {
            skip_run = false;
            continue;
        }
        let Some(&(_, name, takes)) = named(NAMES, word, |entry| entry.0) else {
            ours.push(word.clone());
            continue;
        };
        if matches!(takes, NothingIgnored | ValueIgnored) {
            if takes == ValueIgnored && rest.next().is_none() {
                ours.push(word.clone());
            }
            continue;
        }
        let mut option = OsString::from(name);
        if matches!(takes, Value | Values)
            && let Some(value) = rest.next()
        {
            option.push("=");
            option.push(value);
        }
        match seen.iter().find(|(earlier, _)| *earlier == name) {
            Some((_, first)) if !matches!(takes, NothingEachTime | Values) => {
                if *first != option {
                    let (first, option) = (first.to_string_lossy(), option.to_string_lossy());
                    found.warn(None, format!("{option} has no effect after {first}, as in HELIOS++"));
                }
            }
            _ => {
                ours.push(option.clone());
                seen.push((name, option));
            }
        }
    }
    name_schedule(&mut ours);
    ours
}

/// Replaces the number of HELIOS++'s schedule by the schedule's name. HELIOS++ marks dynamic chunks by the
/// sign of their first size; its warehouse uses the absolute value.
fn name_schedule(words: &mut [OsString]) {
    let value =
        |word: &OsString, name: &str| word.to_str()?.strip_prefix(name)?.strip_prefix('=').map(str::to_owned);
    let mut negative = false;
    for word in words.iter_mut() {
        if let Some(size) =
            value(word, "--chunk-size").and_then(|size| Some(size.strip_prefix('-')?.to_owned()))
        {
            negative = true;
            *word = format!("--chunk-size={size}").into();
        }
    }
    for word in words {
        if let Some(number) = value(word, PARALLELIZATION) {
            let name = match number.as_str() {
                "0" if negative => "dynamic",
                "0" => "static",
                "1" => "warehouse",
                other => other,
            };
            *word = format!("--schedule={name}").into();
        }
    }
}

/// Returns the index of the first word that is neither a HELIOS++ option nor its value, nor looks like an
/// option.
fn subject(words: &[OsString]) -> usize {
    let mut at = 0;
    while let Some(word) = words.get(at) {
        at += match named(NAMES, word, |entry| entry.0) {
            Some((_, _, Value | Values | ValueIgnored)) => 2,
            Some(_) => 1,
            None if is(word, "--unzip") => 3,
            None if is(word, "--message-format") => 2,
            None if word.as_encoded_bytes().starts_with(b"-") => 1,
            None => return at,
        };
    }
    words.len()
}

fn named<'t, T>(table: &'t [T], word: &OsStr, name: impl Fn(&T) -> &str) -> Option<&'t T> {
    table.iter().find(|entry| is(word, name(entry)))
}

fn is(word: &OsStr, name: &str) -> bool {
    // `-V` requests the version everywhere else in this program, too.
    word.eq_ignore_ascii_case(name) && word != "-V"
}

fn is_xml(word: &OsStr) -> bool {
    std::path::Path::new(word).extension().is_some_and(|e| e.eq_ignore_ascii_case("xml"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::{Cli, Command};
    use clap::Parser;
    use vlscan_options::{ChunkSize, Seed};
    use vlscan_trace::Builder;

    fn words(line: &str) -> Vec<OsString> {
        line.split_whitespace().map(OsString::from).collect()
    }

    fn translated_words(line: &str) -> Result<Vec<OsString>> {
        translate_helios_args(words(line), &mut Diagnostics::default())
    }

    fn ours(line: &str) -> String {
        let ours = translated_words(line).unwrap();
        ours.iter().map(|w| w.to_str().unwrap()).collect::<Vec<_>>().join(" ")
    }

    fn run(line: &str) -> crate::cli::args::RunArgs {
        let cli =
            Cli::try_parse_from(translated_words(line).unwrap()).unwrap_or_else(|e| panic!("{line}: {e}"));
        let Command::Run(run) = cli.command else { panic!("not a run: {line}") };
        *run
    }

    #[test]
    fn a_reference_command_line_is_understood() {
        let line = "s.xml --output out --assets a --assets b --SEED 43 --gpsStartTime 1640995200 \
                    --disablePlatformNoise --writeWaveform --lasoutput --zipOutput -j 2 -v2";
        for line in [format!("vlscan run {line}"), format!("vlscan {line}")] {
            let run = run(&line);
            assert_eq!((run.options.origin.seed, run.file.to_str()), (Some(Seed(43)), Some("s.xml")));
            assert_eq!((run.options.input.assets.len(), run.options.schedule.threads), (2, Some(2)));
            assert!(
                run.options.noise.no_platform_noise.is_on()
                    && run.options.output.waveforms.is_on()
                    && run.options.output.las_output.is_on()
                    && run.options.output.zip_output.is_on()
                    && !run.options.output.pulses.is_on()
            );
        }
    }

    #[test]
    fn options_stand_before_or_after_the_survey() {
        for line in [
            "vlscan --njobs 3 --kdt 2 s.xml --writePulse",
            "vlscan -J 3 --writepulse run --KDT 2 s.xml",
            "vlscan run s.xml --writePulse --kdt 2 --nThreads 3",
            "vlscan s.xml --writePulse --kdt 2 --num-threads 3",
        ] {
            let run = run(line);
            assert_eq!(
                (run.options.schedule.threads, run.options.tree.tree, run.options.output.pulses.is_on()),
                (Some(3), Some(Builder::Sah), true),
                "{line}"
            );
        }
    }

    #[test]
    fn the_first_value_wins_and_flags_may_be_repeated() {
        let run =
            run("vlscan s.xml --seed 1 --seed 2 -j 3 --njobs 4 --writePulse --writePulse --chunkSize -32");
        assert_eq!(
            (run.options.origin.seed, run.options.schedule.threads, run.options.schedule.chunk_size),
            (Some(Seed(1)), Some(3), Some(ChunkSize(32)))
        );
        let mut found = Diagnostics::default();
        let line =
            "vlscan s.xml --seed 1 --seed 1 --SEED 2 -v -v --assets a --assets b --writePulse --writePulse";
        translate_helios_args(words(line), &mut found).unwrap();
        let messages: Vec<&str> = found.items().iter().map(|item| item.message.as_str()).collect();
        assert_eq!(messages, ["--seed=2 has no effect after --seed=1, as in HELIOS++"]);
        assert_eq!(
            ours("vlscan s.xml --assets a -a b --vt"),
            "vlscan run s.xml --assets=a --assets=b --times"
        );
    }

    #[test]
    fn schedules_are_named() {
        for (theirs, expected) in [
            ("--parallelization 0", "--schedule=static"),
            ("--parallelization 0 --chunkSize 64", "--schedule=static --chunk-size=64"),
            ("--chunkSize -64 --parallelization 0", "--chunk-size=64 --schedule=dynamic"),
            ("--parallelization 1 --chunkSize -32", "--schedule=warehouse --chunk-size=32"),
            ("--sahNodes 8 --kdtGeomJobs 2 --rebuildScene -j 2", "--threads=2"),
        ] {
            assert_eq!(ours(&format!("vlscan s.xml {theirs}")), format!("vlscan run s.xml {expected}"));
        }
    }

    #[test]
    fn a_missing_value_is_an_error() {
        for line in ["vlscan s.xml --seed", "vlscan run s.xml --kdt"] {
            assert!(Cli::try_parse_from(translated_words(line).unwrap()).is_err(), "{line}");
        }
    }

    #[test]
    fn other_subcommands_keep_their_words() {
        for line in [
            "vlscan preview --output x.xml",
            "vlscan scene make forest --seed 1 --seed 2",
            "vlscan",
            "vlscan -V",
        ] {
            assert_eq!(ours(line), line);
        }
    }

    #[test]
    fn unzip_and_version_come_before_the_run() {
        assert_eq!(ours("vlscan --unzip a.bin a.xyz"), "vlscan unzip --force a.bin a.xyz");
        assert_eq!(ours("vlscan s.xml --UNZIP a.bin a.xyz"), "vlscan unzip --force a.bin a.xyz");
        assert_eq!(ours("vlscan s.xml --Version --seed 1"), "vlscan --version");
    }

    #[test]
    fn what_has_no_counterpart_is_refused_with_advice() {
        for (line, advice) in [
            ("vlscan --test", "cargo test"),
            ("vlscan run s.xml --TestDir d", "cargo test"),
            ("vlscan --demo box", "scene make"),
            ("vlscan s.xml --demoSurvey d", "scene make"),
        ] {
            let message = translated_words(line).unwrap_err().to_string();
            assert!(message.contains(advice), "{line}: {message}");
        }
    }

    #[test]
    fn every_name_leads_to_an_option_that_exists() {
        use clap::CommandFactory;
        let command = Cli::command();
        let run = command.find_subcommand("run").unwrap();
        let mut longs: Vec<String> = run
            .get_arguments()
            .chain(command.get_arguments())
            .filter_map(|a| a.get_long().map(|l| format!("--{l}")))
            .collect();
        longs.extend(["-vv", "--help"].map(str::to_owned));
        for (theirs, ours, _) in NAMES.iter().filter(|name| !["", PARALLELIZATION].contains(&name.1)) {
            assert!(longs.iter().any(|l| l == ours), "{theirs} leads to {ours}, which is no option");
        }
    }
}
