//! Conversion of options to the settings of a session, with every choice resolved.

use super::outputs::check_companion;
use super::scanners::no_scanner;
use super::{Options, ScannerSurvey, read_scanners, read_survey, read_survey_text};
use std::path::{Path, PathBuf};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::machine;
use vlscan_lidar::pulse::{Corrections, PhysicsOptions, PhysicsProfile};
use vlscan_scene::TileOptions;
use vlscan_session::output::OutputRequest;
use vlscan_session::{DEFAULT_CHUNK_SIZE, DEFAULT_WAREHOUSE_FACTOR, Settings};
use vlscan_survey::{NavigationErrors, PlatformKind, Survey};
use vlscan_trace::BuildOptions;
use vlscan_warehouse::{MAX_THREADS, Policy, PolicyKind, Schedule};

/// Idle times that dynamic chunks ignore, in milliseconds.
const DEFAULT_IDLE_THRESHOLD_MS: f64 = 0.1;

/// A run with every choice resolved.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct ResolvedRun {
    /// Name of the scanner, in a pipeline with `[[scanner]]` tables.
    pub scanner: Option<String>,
    /// The settings of the session.
    pub settings: Settings,
    /// Outputs.
    pub output: OutputRequest,
    /// File for the activity of the schedule.
    pub schedule_log: Option<PathBuf>,
    /// File for the table of the scene's parts.
    pub part_table: Option<PathBuf>,
    /// True if the progress is shown as plain lines.
    pub progress_lines: bool,
}

impl ResolvedRun {
    /// Reads the survey or pipeline and resolves every choice: the command line takes precedence over the
    /// file, the file over the default.
    ///
    /// # Errors
    /// All problems of all files at once.
    pub fn resolve(file: &Path, typed: &Options) -> Result<(ResolvedRun, Diagnostics)> {
        let (survey, options, warnings) = read_survey(file, typed.clone())?;
        Ok((ResolvedRun::new(survey, &options)?, warnings))
    }

    /// Reads the survey or pipeline as [`ResolvedRun::resolve`] does, a pipeline with `[[scanner]]` tables as
    /// a run of each scanner, in their order.
    ///
    /// # Errors
    /// As for [`ResolvedRun::resolve`].
    pub fn resolve_all(file: &Path, typed: &Options) -> Result<(Vec<ResolvedRun>, Diagnostics)> {
        let (surveys, warnings) = read_scanners(file, typed.clone())?;
        let resolve = |read: ScannerSurvey| -> Result<ResolvedRun> {
            let run = ResolvedRun::new(read.survey, &read.options)?;
            Ok(ResolvedRun { scanner: read.scanner, ..run })
        };
        let mut runs = surveys.into_iter().map(resolve).collect::<Result<Vec<_>>>()?;
        if let [first, others @ ..] = &mut runs[..] {
            // Scanners share a clock, also one that starts now.
            let (gps_start_ns, day) = (first.settings.flight.gps_start_ns, first.output.cloud.creation);
            for other in others {
                other.settings.flight.gps_start_ns = gps_start_ns;
                other.output.cloud.creation = day;
            }
        }
        Ok((runs, warnings))
    }

    /// Reads a pipeline as [`ResolvedRun::resolve_all`] does, and returns the run of the scanner with a name.
    ///
    /// # Errors
    /// As for [`ResolvedRun::resolve`], and for a file without such a scanner.
    pub fn resolve_scanner(file: &Path, name: &str, typed: &Options) -> Result<(ResolvedRun, Diagnostics)> {
        let (runs, warnings) = ResolvedRun::resolve_all(file, typed)?;
        let names: Vec<String> = runs.iter().filter_map(|run| run.scanner.clone()).collect();
        match runs.into_iter().find(|run| run.scanner.as_deref() == Some(name)) {
            Some(run) => Ok((run, warnings)),
            None => Err(no_scanner(file, name, &names)),
        }
    }

    /// Reads a pipeline, or a survey in XML, in memory and resolves every choice, as [`ResolvedRun::resolve`]
    /// does for a file.
    ///
    /// # Errors
    /// As for [`ResolvedRun::resolve`].
    pub fn of_text(name: &Path, text: String, typed: &Options) -> Result<(ResolvedRun, Diagnostics)> {
        let (survey, options, warnings) = read_survey_text(name, text, typed.clone())?;
        Ok((ResolvedRun::new(survey, &options)?, warnings))
    }

    /// Resolves every choice for a survey that has been read.
    ///
    /// # Errors
    /// Options that contradict one another.
    pub fn new(mut survey: Survey, options: &Options) -> Result<ResolvedRun> {
        if let Some(crs) = &options.output.crs {
            survey.crs_wkt = Some(crs.wkt()?);
        }
        let seed = options.origin.seed.map(|seed| seed.0).or(survey.seed).unwrap_or(0);
        let threads = threads(options.schedule.threads, all_threads());
        let is_live = matches!(survey.platform.kind, PlatformKind::Stream(_));
        let mut settings = Settings::new(survey);
        settings.set_seed(seed);
        settings.set_threads(threads);
        settings.set_corrections(corrections(options, is_live)?);
        let profile = options.profile.profile.unwrap_or(PhysicsProfile::OF_SURVEYS);
        settings.set_flight_rules(options.has_own_flight, profile);
        settings.strict = options.input.strict.is_on();
        settings.load.max_memory = options.schedule.max_memory.map(|bytes| bytes.0).or_else(machine::memory);
        settings.load.sharing = options.tree.instances.unwrap_or_default();
        settings.load.drop_polygons = options.input.drop_polygons.is_on();
        settings.tree = tree(options, threads);
        settings.load.tiles = options.schedule.scene_memory.map(|bytes| TileOptions {
            memory: bytes.0,
            trees: BuildOptions { jobs: 0, ..settings.tree.clone() },
        });
        settings.schedule = schedule(options, threads);
        let gps_start = options.origin.gps_start.clone().unwrap_or_default();
        let (gps_start_ns, day) = gps_start.resolve(settings.flight.kinematics.leap_seconds)?;
        let flight = &mut settings.flight;
        flight.gps_start_ns = gps_start_ns;
        flight.platform_noise = !options.noise.no_platform_noise.is_on();
        flight.leg_noise = !options.noise.no_leg_noise.is_on();
        flight.navigation = navigation(options)?;
        let (echoes, physics) = (&options.echoes, &mut settings.physics);
        physics.legacy_energy = echoes.legacy_energy.is_on();
        physics.fixed_incidence = echoes.fixed_incidence.is_on();
        physics.max_order = echoes.max_order.map_or(PhysicsOptions::MAX_ORDER, |order| order.0);
        physics.echo_width = echoes.echo_width.is_on();
        physics.waveform_noise = echoes.waveform_noise.is_on();
        physics.record_subrays = options.output.subrays.is_on();
        if let Some(latency) = options.trajectory.latency {
            settings.max_latency = latency.0;
        }
        let mut output = options.output_request(day)?;
        output.live = is_live;
        settings.load.colours = output.records().colours;
        if physics.record_subrays && output.records().waveforms {
            return Err(Error::input(
                "subrays have no waveforms: leave out either --subrays or the waveforms",
            ));
        }
        settings.check()?;
        let speed = &options.schedule;
        for (option, path, content) in
            [("--schedule-log", &speed.schedule_log, "JSON"), ("--parts", &options.part_table, "CSV")]
        {
            path.as_deref().map_or(Ok(()), |path| check_companion(option, path, content))?;
        }
        Ok(ResolvedRun {
            scanner: None,
            settings,
            output,
            schedule_log: speed.schedule_log.clone(),
            part_table: options.part_table.clone(),
            progress_lines: speed.progress.is_on(),
        })
    }
}

/// Returns a schedule with those parameters that apply to it.
pub fn policy(kind: PolicyKind, size: u32, factor: usize, idle_threshold_ms: Option<f64>) -> Policy {
    let ms = idle_threshold_ms.unwrap_or(DEFAULT_IDLE_THRESHOLD_MS);
    match kind {
        PolicyKind::Warehouse => Policy::Warehouse { size, factor },
        PolicyKind::Dynamic => Policy::Dynamic { size, significant_ns: (ms * 1e6).round() as u64 },
        PolicyKind::Static => Policy::Static { size },
        PolicyKind::Single => Policy::Single,
    }
}

/// Returns the schedule that the options ask for.
pub fn schedule_of(options: &Options) -> Schedule {
    schedule(options, threads(options.schedule.threads, all_threads()))
}

fn schedule(options: &Options, threads: usize) -> Schedule {
    let speed = &options.schedule;
    let size = speed.chunk_size.map_or(DEFAULT_CHUNK_SIZE, |size| size.0);
    let factor = speed.warehouse_factor.map_or(DEFAULT_WAREHOUSE_FACTOR, |factor| factor.0);
    let idle_threshold = speed.idle_threshold.map(|ms| ms.0);
    let policy = policy(speed.policy.unwrap_or_default(), size, factor, idle_threshold);
    Schedule { threads, policy, leg_barrier: speed.leg_barrier.is_on() }
}

fn tree(options: &Options, all: usize) -> BuildOptions {
    let jobs = threads(options.tree.tree_jobs, all);
    BuildOptions { jobs, geometry_jobs: jobs, ..BuildOptions::of(options.tree.tree.unwrap_or_default()) }
}

/// Returns the requested number of threads; 0 and `None` mean `all`. A request above [`MAX_THREADS`] is not
/// lowered: it is an error of the schedule.
fn threads(requested: Option<usize>, all: usize) -> usize {
    requested.filter(|&n| n > 0).unwrap_or(all.min(MAX_THREADS))
}

fn all_threads() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// The corrections that the options ask for, along a live trajectory or not.
fn corrections(options: &Options, is_live: bool) -> Result<Corrections> {
    let mut in_any = if options.has_own_flight { Corrections::MOTION } else { Corrections::NONE };
    in_any.mount_offsets_turn |= is_live;
    options.profile.corrections(in_any)
}

fn navigation(options: &Options) -> Result<NavigationErrors> {
    let mut errors = NavigationErrors::NONE;
    for error in &options.navigation.errors {
        let outcome = errors.set(&error.key, &error.numbers);
        outcome.map_err(|message| Error::input(format!("--navigation-error: {message}")))?;
    }
    Ok(errors)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Precedence;
    use vlscan_trace::Builder;

    fn options(line: &str) -> Options {
        parsed(line).unwrap()
    }

    fn parsed(line: &str) -> Result<Options> {
        Options::parse(line.split_whitespace().map(str::to_owned))
    }

    #[test]
    fn the_command_line_comes_before_the_file() {
        let file =
            options("--tree axis-sah --schedule dynamic --leg-barrier --navigation-error position_m=1");
        let builder = |line: &str| tree(&options(line).over(file.clone()), 8);
        assert_eq!(tree(&options(""), 8).builder, BuildOptions::default().builder);
        assert_eq!(
            (builder("").builder, builder("--tree median").builder),
            (Builder::AxisSah, Builder::Median)
        );
        assert_eq!((builder("").jobs, builder("--tree-jobs 3").geometry_jobs), (8, 3));
        let found = schedule(&options("").over(file.clone()), 2);
        assert!(matches!(found.policy, Policy::Dynamic { size: 1024, .. }) && found.leg_barrier);
        let typed = options("--navigation-error position_m=0.1,0.2,0.3 --navigation-error boresight_deg=90");
        let both = navigation(&typed.over(file)).unwrap();
        assert_eq!((both.position, both.boresight), ([0.1, 0.2, 0.3], [std::f64::consts::FRAC_PI_2; 3]));
    }

    #[test]
    fn schedules_have_their_parameters() {
        let policy = |line: &str| schedule(&options(line), 2).policy;
        for (line, expected) in [
            ("", Policy::Warehouse { size: 1024, factor: 4 }),
            ("--chunk-size 32 --warehouse-factor 8", Policy::Warehouse { size: 32, factor: 8 }),
            ("--schedule dynamic --chunk-size 64", Policy::Dynamic { size: 64, significant_ns: 100_000 }),
            (
                "--schedule dynamic --idle-threshold 0.01",
                Policy::Dynamic { size: 1024, significant_ns: 10_000 },
            ),
            ("--schedule static", Policy::Static { size: 1024 }),
            ("--schedule single --chunk-size 64", Policy::Single),
        ] {
            assert_eq!(policy(line), expected, "{line}");
        }
        for line in
            ["--chunk-size 0", "--warehouse-factor 0", "--warehouse-factor 65537", "--idle-threshold=-1"]
        {
            assert!(parsed(line).is_err(), "{line}");
        }
    }

    #[test]
    fn requests_for_too_many_threads_are_errors() {
        let survey = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/room/survey.xml");
        for (line, expected) in [
            ("--threads 1025", "--threads 1025: expected at most 1024"),
            ("--tree-jobs 1025", "--tree-jobs 1025: expected at most 1024"),
        ] {
            let error = ResolvedRun::resolve(&survey, &options(line)).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
    }
}
