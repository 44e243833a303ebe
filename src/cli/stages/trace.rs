//! `vlscan trace`: traces pulses from a stream through a scene; outputs are those of `vlscan run`.

use crate::cli::Console;
use crate::cli::args::{InstrumentArgs, TraceArgs};
use crate::cli::companions::{Companions, open};
use crate::cli::run::show_report;
use std::path::{Path, PathBuf};
use std::time::Instant;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::number;
use vlscan_lidar::pulse::PhysicsProfile;
use vlscan_options::{InputOptions, NotNegative, Options, ResolvedRun, Switch, holds_survey, read_survey};
use vlscan_session::LegRule;
use vlscan_session::output::Target;
use vlscan_session::streams::PulseReader;
use vlscan_survey::{
    Device, Mount, Platform, PlatformKind, PlatformNoise, PulseTimes, ReadOptions, Scanner, SceneRecipe,
    Survey,
};

pub fn run(args: &TraceArgs, console: &Console) -> Result<()> {
    let started = Instant::now();
    refuse_shards(args)?;
    let (mut setting, warnings) = Setting::read(args)?;
    console.warnings(&warnings)?;
    change_instrument(&mut setting.survey, &args.instrument);
    check_ranges(&setting.survey, &args.instrument)?;
    let known = setting.known;
    let ResolvedRun { mut settings, mut output, schedule_log, part_table, progress_lines, .. } =
        ResolvedRun::new(setting.survey, &setting.options)?;
    output.inputs.push(args.stream.clone());
    let mut companions = Companions::of(schedule_log, part_table, &mut output);
    settings.survey.legs.iter_mut().for_each(|leg| leg.scanner.active = true);
    let has_folder = |(t, _): &(Target, _)| matches!(t, Target::Directory(_) | Target::Helios(_));
    let separate_files = output.sinks.iter().any(has_folder);
    if separate_files && !known {
        return Err(Error::input(
            "one file per leg needs a survey as --scanner; or name a single file with -o",
        ));
    }
    let streamed_divergence = args.instrument.divergence.is_none();
    let legs = LegRule { known, separate_files, streamed_divergence };
    // Opened before the scene is loaded, so that a wrong name is reported without delay.
    let pulses = PulseReader::open(&args.stream, settings.schedule.policy.size() as usize)?;
    let mut session = open(settings, console)?;
    companions.describe(session.scene())?;
    let leg_count = session.survey().legs.len();
    let report = companions
        .run(console, progress_lines, leg_count, |control| session.trace(pulses, legs, output, control))?;
    show_report(console, &report, started)
}

/// A stream has no shards.
fn refuse_shards(args: &TraceArgs) -> Result<()> {
    let options = [("--shard", args.shard.is_some()), ("--resume", args.resume.is_some())];
    let Some((option, _)) = options.iter().find(|(_, is_given)| *is_given) else { return Ok(()) };
    Err(Error::input_with_help(
        format!("{option} cannot be used with vlscan trace: the length of a stream of pulses is not known"),
        "run the survey in shards instead (vlscan run --shard), or divide the pulses into files and trace \
         each",
    ))
}

/// The scene that is traced, and the instrument that receives the echoes.
struct Setting {
    survey: Survey,
    options: Options,
    /// True if the survey is described by a file.
    known: bool,
}

impl Setting {
    fn read(args: &TraceArgs) -> Result<(Setting, Diagnostics)> {
        let mut options = args.options();
        let scene = options.input.scene.take();
        let reading = options.read_options();
        let path = Path::new(&args.scanner);
        if holds_survey(path) {
            let (mut survey, options, mut warnings) = read_survey(path, options)?;
            if let Some(name) = &scene {
                let (scene, found) = scene_of(name, &reading)?;
                survey.scene = scene;
                warnings.extend(found);
            }
            // The times of a pattern are not written in the file of the survey.
            let own = &survey.scanner.pulse_times;
            let has_times = |times: &Option<PulseTimes>| times.is_some() && times != own;
            if let Some(leg) = survey.legs.iter().find(|leg| has_times(&leg.scanner.pulse_times)) {
                let message = "`pulse_times` and `pulse_intervals_us` have no effect: pulses leave at the \
                               times in their stream";
                warnings.warn(leg.place.clone(), message);
            }
            return Ok((Setting { survey, options, known: true }, warnings));
        }
        let profile = *options.profile.profile.get_or_insert(PhysicsProfile::OF_PIPELINES);
        let (mut scanner, mut warnings) = vlscan_survey::find_scanner(&args.scanner, &reading)?;
        if profile == PhysicsProfile::Refined {
            // As in pipelines. The physics of HELIOS++ has the figures of its catalogue.
            scanner.devices.iter_mut().for_each(Device::take_stated_figures);
        }
        let Some(name) = &scene else {
            return Err(Error::input(
                "--scene is required, unless --scanner names a survey, which has its own scene",
            ));
        };
        let (scene, found) = scene_of(name, &reading)?;
        warnings.extend(found);
        options.warn_of_unused_formats(&mut warnings)?;
        Ok((Setting { survey: bare_survey(scanner, scene), options, known: false }, warnings))
    }
}

/// Applies the instrument options of the command line.
fn change_instrument(survey: &mut Survey, args: &InstrumentArgs) {
    let set = |target: &mut f64, value: Option<NotNegative>| *target = value.map_or(*target, |value| value.0);
    for device in &mut survey.scanner.devices {
        device.beam.divergence = args.divergence.map_or(device.beam.divergence, |divergence| divergence.0);
        set(&mut device.beam.pulse_length, args.pulse_length);
        device.beam.stated_width = device.beam.stated_width.filter(|_| args.pulse_length.is_none());
        set(&mut device.detector.accuracy, args.accuracy);
        set(&mut device.detector.range_min, args.range_min);
        set(&mut device.detector.range_max, args.range_max);
        set(&mut device.waveform.bin, args.bin);
        set(&mut device.waveform.window, args.window);
        device.waveform.quality = args.beam_quality.unwrap_or(device.waveform.quality);
        device.detector.max_returns = args.max_returns.unwrap_or(device.detector.max_returns);
    }
    for leg in &mut survey.legs {
        if let Some(divergence) = args.divergence {
            (leg.scanner.beam_divergence, leg.scanner.written_divergence) = (divergence.0, None);
        }
        leg.scanner.pulse_freq = args.pulse_rate.unwrap_or(leg.scanner.pulse_freq);
    }
}

/// Refuses ranges of the command line between which there is none.
fn check_ranges(survey: &Survey, args: &InstrumentArgs) -> Result<()> {
    if args.range_min.is_none() && args.range_max.is_none() {
        return Ok(());
    }
    let mut detectors = survey.scanner.devices.iter().map(|device| &device.detector);
    let Some(detector) = detectors.find(|detector| detector.range_min > detector.range_max) else {
        return Ok(());
    };
    Err(Error::input_with_help(
        format!(
            "the nearest range, {} m, is beyond the farthest, {} m",
            number(detector.range_min),
            number(detector.range_max)
        ),
        "--range-min and --range-max",
    ))
}

/// Returns the scene of a survey, or of another file that refers to one.
fn scene_of(name: &str, reading: &ReadOptions) -> Result<(SceneRecipe, Diagnostics)> {
    if holds_survey(Path::new(name)) {
        let input = InputOptions {
            assets: reading.assets.clone(),
            strict: Switch::given(reading.strict),
            ..InputOptions::default()
        };
        let (survey, _, warnings) = read_survey(Path::new(name), Options { input, ..Options::default() })?;
        return Ok((survey.scene, warnings));
    }
    vlscan_survey::read_scene(name, reading)
}

/// Returns a survey of one leg without a position.
fn bare_survey(scanner: Scanner, scene: SceneRecipe) -> Survey {
    let leg = scanner.leg();
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
