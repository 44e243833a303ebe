//! `vlscan trace`: pulses from a stream meet a scene, and their echoes go wherever those of `vlscan run` may go.

use crate::cli::args::{FlightArgs, RunArgs, SurveyArgs, TraceArgs};
use crate::cli::inputs::{holds_survey, read_survey};
use crate::cli::run::{Job, Stage, interrupted, judge, load_and_build, report, tell_rescued};
use crate::cli::slips;
use crate::cli::watch::watched;
use crate::cli::{Console, interrupt};
use crate::diag::Diagnostics;
use crate::error::{Error, Result};
use crate::output::{OutputContext, OutputPlan, OutputRequest, Target};
use crate::pipeline::{LegRule, Progress, PulseSource, TraceEnded, Tracing, trace};
use crate::pulse::Physics;
use crate::scene::{self, SceneFrame};
use crate::streams::PulseReader;
use crate::survey::{
    self, Leg, Mount, Platform, PlatformKind, PlatformNoise, PlatformSettings, ReadOptions, RunSettings,
    Scanner, ScannerSettings, SceneRecipe, Survey,
};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Runs `vlscan trace`.
pub fn run(args: &TraceArgs, console: &Console) -> Result<()> {
    interrupt::listen();
    let started = Instant::now();
    let (mut setting, warnings) = Setting::read(args)?;
    console.warnings(&warnings);
    setting.change_instrument(args)?;
    let known = setting.known;
    let mut job = Job::settle(&as_run(args), setting.survey, &setting.settings)?;
    job.survey.legs.iter_mut().for_each(|leg| leg.scanner.active = true);
    let apart = job.output.sinks.iter().any(|(t, _)| matches!(t, Target::Directory(_) | Target::Helios(_)));
    if apart && !known {
        return Err(Error::input(
            "one file per leg needs the legs: name the survey with --scanner, or a single file with -o",
        ));
    }
    let legs = LegRule { known, apart, streamed_divergence: args.instrument.divergence.is_none() };

    // Opened before the scene is loaded, so that a wrong name costs no wait.
    let reader = PulseReader::open(&args.stream, job.schedule.policy.size() as usize)?;
    let plays = scene::count_epochs(&job.survey.scene)?;
    let mut stage = load_and_build(&job, console, 0, None)?;
    let context = OutputContext { survey: &job.survey, scene: &stage.scene };
    let output = Arc::new(OutputPlan::new(OutputRequest { plays, ..job.output.clone() }, &context)?);
    let first = SceneFrame::of(&stage.scene);

    let progress = Progress::default();
    let mut source = PulseSource::new(reader);
    let (mut play, mut sinks) = (0, None);
    let (flying, summary) = loop {
        let took_off = Instant::now();
        let Stage { scene, tree, movers } = &stage;
        let physics = Physics::new(scene, tree, &job.survey, job.physics)?;
        let judge = judge(&job, &stage, console, (false, Arc::default()));
        let tracing = Tracing {
            survey: &job.survey,
            physics: &physics,
            options: job.physics,
            shift: scene.shift,
            movers: movers.as_ref().map(|movers| (movers, &job.tree)),
            legs,
            output: output.clone(),
            schedule: job.schedule,
            stop: &interrupt::STOP,
            progress: &progress,
            target: slips::target(&job.survey, scene),
            judge: Some(&judge),
        };
        let legs = job.survey.legs.len();
        let ended = watched(console, job.progress_lines, legs, &progress, || {
            trace(tracing, &mut source, play, sinks.take(), play + 1 == plays)
        });
        let ended = ended.inspect_err(|_| tell_rescued(console, &output.rescued()))?;
        match ended {
            TraceEnded::Whole(summary) => break (took_off.elapsed().as_secs_f64(), summary),
            TraceEnded::Play(open) => sinks = Some(open),
            TraceEnded::Cut(summary) => {
                let flying = took_off.elapsed().as_secs_f64();
                let pulses = progress.snapshot().pulses;
                report(console, &summary, pulses, flying, started.elapsed().as_secs_f64());
                return Err(interrupted(console, &summary));
            }
        }
        drop(judge);
        drop(stage);
        play += 1;
        stage = load_and_build(&job, console, play, Some(first))?;
    };
    if let Some(next) = source.next_play(&interrupt::STOP)? {
        return Err(Error::input(format!(
            "after play {play} comes a pulse of play {next}; plays ascend, and the scene has {plays}"
        )));
    }
    report(console, &summary, progress.snapshot().pulses, flying, started.elapsed().as_secs_f64());
    Ok(())
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
