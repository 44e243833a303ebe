//! The reference program's option names, which are matched without regard to case.

use std::ffi::OsString;

/// Option names of the reference program that `vlscan run` takes, and our name for each (spec outputs-and-cli §9.2).
const NAMES: &[(&str, &str)] = &[
    ("--assets", "--assets"),
    ("--output", "--output"),
    ("--seed", "--seed"),
    ("--gpsStartTime", "--gps-start"),
    ("--splitByChannel", "--split-by-channel"),
    ("--writeWaveform", "--waveforms"),
    ("--writePulse", "--pulses"),
    ("--calcEchowidth", "--echo-width"),
    ("--fullwaveNoise", "--waveform-noise"),
    ("--fixedIncidenceAngle", "--fixed-incidence"),
    ("--lasOutput", "--las-output"),
    ("--las10", "--las10"),
    ("--zipOutput", "--zip-output"),
    ("--lasScale", "--las-scale"),
    ("--njobs", "--threads"),
    ("--nthreads", "--threads"),
    ("--chunkSize", "--chunk-size"),
    ("--warehouseFactor", "--warehouse-factor"),
    ("--rebuildScene", "--rebuild-scene"),
    ("--noSceneWriting", "--no-scene-writing"),
    ("--disablePlatformNoise", "--no-platform-noise"),
    ("--disableLegNoise", "--no-leg-noise"),
    ("--legacyEnergyModel", "--legacy-energy"),
    ("--sahNodes", "--tree-bins"),
    ("--kdtJobs", "--tree-jobs"),
    ("--quiet", "--quiet"),
    ("--silent", "--silent"),
];

/// The arguments with the reference's option names replaced by ours; everything else is left as it is.
pub fn in_our_words(args: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let mut args: Vec<OsString> = args.into_iter().collect();
    if args.get(1).is_none_or(|command| command != "run") {
        return args;
    }
    for arg in args.iter_mut().skip(2) {
        let Some(text) = arg.to_str() else { continue };
        if text == "--" {
            break;
        }
        let translated = match text {
            "-v2" => Some("-vv"),
            _ => NAMES.iter().find(|(name, _)| name.eq_ignore_ascii_case(text)).map(|&(_, ours)| ours),
        };
        if let Some(ours) = translated {
            *arg = ours.into();
        }
    }
    args
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::{Cli, Command};
    use clap::Parser;

    #[test]
    fn a_reference_command_line_is_understood() {
        let line = "vlscan run s.xml --output out --assets a --assets b --SEED 43 --gpsStartTime 2022-01-01 \
                    --disablePlatformNoise --writeWaveform --lasoutput --zipOutput -j 2 -v2";
        let cli = Cli::try_parse_from(in_our_words(line.split(' ').map(OsString::from))).unwrap();
        let Command::Run(run) = cli.command else { panic!("not a run") };
        assert_eq!(run.seed.as_deref(), Some("43"));
        assert_eq!((run.assets.len(), run.threads), (2, Some(2)));
        assert!(run.no_platform_noise && run.waveforms && run.las_output && run.zip_output && !run.pulses);
    }

    #[test]
    fn every_name_leads_to_an_option_that_exists() {
        use clap::CommandFactory;
        let command = Cli::command();
        let run = command.find_subcommand("run").unwrap();
        let longs: Vec<String> = run
            .get_arguments()
            .chain(command.get_arguments())
            .filter_map(|a| a.get_long().map(|l| format!("--{l}")))
            .collect();
        for (theirs, ours) in NAMES {
            assert!(longs.iter().any(|l| l == ours), "{theirs} leads to {ours}, which is no option");
        }
    }
}
