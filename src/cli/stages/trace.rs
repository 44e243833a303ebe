//! `vlscan trace`: pulses from a stream meet a scene, and their echoes go wherever those of `vlscan run` may go.

use crate::cli::args::{FlightArgs, RunArgs, SurveyArgs, TraceArgs};
use crate::cli::inputs::{holds_survey, read_survey};
use crate::cli::run::{Job, show_report};
use crate::cli::watch::watched;
use crate::cli::{Console, interrupt};
use crate::diag::Diagnostics;
use crate::error::{Error, Result};
use crate::output::Target;
use crate::pipeline::{Control, LegRule, Progress, Session};
use crate::streams::PulseReader;
use crate::survey::{
    self, Leg, Mount, Platform, PlatformKind, PlatformNoise, PlatformSettings, ReadOptions, RunSettings,
    Scanner, ScannerSettings, SceneRecipe, Survey,
};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Runs `vlscan trace`.
pub fn run(args: &TraceArgs, console: &Console) -> Result<()> {
    interrupt::listen();
    let started = Instant::now();
    let (mut setting, warnings) = Setting::read(args)?;
    console.warnings(&warnings);
    setting.change_instrument(args)?;
    let known = setting.known;
    let job = Job::settle(&as_run(args), setting.survey, &setting.settings)?;
    let Job { mut settings, output, progress_lines, .. } = job;
    settings.survey.legs.iter_mut().for_each(|leg| leg.scanner.active = true);
    let has_folder = |(t, _): &(Target, _)| matches!(t, Target::Directory(_) | Target::Helios(_));
    let separate_files = output.sinks.iter().any(has_folder);
    if separate_files && !known {
        return Err(Error::input(
            "one file per leg needs the legs: name the survey with --scanner, or a single file with -o",
        ));
    }
    let streamed_divergence = args.instrument.divergence.is_none();
    let legs = LegRule { known, separate_files, streamed_divergence };
    // Opened before the scene is loaded, so that a wrong name costs no wait.
    let pulses = PulseReader::open(&args.stream, settings.schedule.policy.size() as usize)?;
    let mut session = Session::open(settings, console.observer())?;
    let progress = Progress::default();
    let control = Control::new(&progress, &interrupt::STOP);
    let leg_count = session.survey().legs.len();
    let report = watched(console, progress_lines, leg_count, &progress, || {
        session.trace(pulses, legs, output, control)
    })?;
    show_report(console, &report, started)
}

/// What the pulses meet and what receives their echoes.
struct Setting {
    survey: Survey,
    settings: RunSettings,
    /// The survey is one that a file describes.
    known: bool,
}

impl Setting {
    fn read(args: &TraceArgs) -> Result<(Setting, Diagnostics)> {
        let reading = ReadOptions {
            assets: args.common.input.assets.clone(),
            strict: args.common.input.strict,
            ..ReadOptions::default()
        };
        let path = Path::new(&args.scanner);
        if holds_survey(path) {
            let (mut survey, settings, mut warnings) = read_survey(path, &reading)?;
            if let Some(name) = &args.common.input.scene {
                let (scene, found) = scene_of(name, &reading)?;
                survey.scene = scene;
                warnings.extend(found);
            }
            return Ok((Setting { survey, settings, known: true }, warnings));
        }
        let (scanner, mut warnings) = survey::find_scanner(&args.scanner, &reading)?;
        let Some(name) = &args.common.input.scene else {
            return Err(Error::input(
                "--scene is missing: what do the pulses meet? (only a survey as --scanner brings its own)",
            ));
        };
        let (scene, found) = scene_of(name, &reading)?;
        warnings.extend(found);
        let survey = bare_survey(scanner, scene);
        Ok((Setting { survey, settings: RunSettings::default(), known: false }, warnings))
    }

    /// Changes the instrument as the command line asks.
    fn change_instrument(&mut self, args: &TraceArgs) -> Result<()> {
        let i = &args.instrument;
        let not_negative = |name: &str, value: Option<f64>| match value {
            Some(v) if !(v.is_finite() && v >= 0.0) => {
                Err(Error::input(format!("{name}: expected a number of at least 0, found {v}")))
            }
            other => Ok(other),
        };
        let divergence = not_negative("--divergence", i.divergence)?;
        let pulse_length = not_negative("--pulse-length", i.pulse_length)?;
        let accuracy = not_negative("--accuracy", i.accuracy)?;
        let range_min = not_negative("--range-min", i.range_min)?;
        let range_max = not_negative("--range-max", i.range_max)?;
        let bin = not_negative("--bin", i.bin)?;
        let window = not_negative("--window", i.window)?;
        for device in &mut self.survey.scanner.devices {
            let set = |target: &mut f64, value: Option<f64>| *target = value.unwrap_or(*target);
            set(&mut device.beam.divergence, divergence);
            set(&mut device.beam.pulse_length, pulse_length);
            set(&mut device.detector.accuracy, accuracy);
            set(&mut device.detector.range_min, range_min);
            set(&mut device.detector.range_max, range_max);
            set(&mut device.waveform.bin, bin);
            set(&mut device.waveform.window, window);
            device.waveform.quality = i.beam_quality.unwrap_or(device.waveform.quality);
            device.detector.max_returns = i.max_returns.unwrap_or(device.detector.max_returns);
        }
        for leg in &mut self.survey.legs {
            if let Some(divergence) = divergence {
                (leg.scanner.beam_divergence, leg.scanner.written_divergence) = (divergence, None);
            }
            leg.scanner.pulse_freq = i.pulse_rate.unwrap_or(leg.scanner.pulse_freq);
        }
        Ok(())
    }
}

/// The scene of a survey, or of whatever else names one.
fn scene_of(name: &str, reading: &ReadOptions) -> Result<(SceneRecipe, Diagnostics)> {
    if holds_survey(Path::new(name)) {
        let (survey, _, warnings) = read_survey(Path::new(name), reading)?;
        return Ok((survey.scene, warnings));
    }
    survey::read_scene(name, reading)
}

/// A survey of one leg that is nowhere.
fn bare_survey(scanner: Scanner, scene: SceneRecipe) -> Survey {
    let settings = ScannerSettings { active: true, ..scanner.own_settings() };
    let leg = Leg {
        number: 0,
        strip: None,
        platform: PlatformSettings::at(crate::geom::DVec3::ZERO),
        scanner: settings,
        place: None,
    };
    Survey {
        name: "trace".to_owned(),
        path: PathBuf::from("trace"),
        seed: None,
        platform: Platform {
            id: "pulses".to_owned(),
            kind: PlatformKind::Static,
            mount: Mount::IDENTITY,
            noise: PlatformNoise::default(),
        },
        scanner,
        scene,
        legs: vec![leg],
        leg_offset: None,
        crs_wkt: None,
    }
}

/// The same choices as those of a run; points go to stdout unless told otherwise.
fn as_run(args: &TraceArgs) -> RunArgs {
    let mut output = args.output.clone();
    if output.out.is_empty() && output.output.is_none() {
        output.out.push(PathBuf::from("-"));
    }
    let survey =
        SurveyArgs { file: args.stream.clone(), flight: FlightArgs::default(), common: args.common.clone() };
    RunArgs { output, survey, physics: args.physics.clone(), tree: args.tree.clone(), trajectory_out: None }
}
