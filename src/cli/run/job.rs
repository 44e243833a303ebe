//! From arguments as typed and a file as written to a job with every choice made.

use super::speed::{schedule, tree};
use crate::cli::args::{CommonArgs, OutputArgs, PhysicsArgs, PhysicsProfile, RunArgs, SurveyArgs};
use crate::cli::inputs::read_survey;
use crate::cli::pack::sharing;
use crate::diag::Diagnostics;
use crate::error::{Error, Result};
use crate::flight::{self, FlightOptions};
use crate::output::{
    Column, LasSettings, LasVersion, OutputRequest, PacketPlace, PointFormat, Target, TrajectoryFormat,
};
use crate::pipeline::{DEFAULT_LATENCY, Settings};
use crate::pulse::{Corrections, PhysicsOptions};
use crate::scene::{LoadOptions, MaterialRules};
use crate::survey::{
    self, Grid, NavigationErrors, OutputSettings, PlatformKind, PoseChoices, ReadOptions, RunSettings, Survey,
};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Start of the GPS clock when nobody asks for another: a fixed one, so that equal runs give equal bytes.
const GPS_START: &str = "2024-01-01 00:00:00";

/// What a command is asked to do, with every choice made.
pub struct Job {
    pub settings: Settings,
    pub output: OutputRequest,
    pub schedule_log: Option<PathBuf>,
    pub progress_lines: bool,
}

impl Job {
    /// Reads the survey or pipeline and settles every choice: the command line first, then the file, then the default.
    pub fn resolve(args: &RunArgs) -> Result<(Job, Diagnostics)> {
        let SurveyArgs { file, flight, common: CommonArgs { input, .. } } = &args.survey;
        let trajectory = flight.poses.choices(flight.trajectory.clone())?;
        let reading = ReadOptions {
            assets: input.assets.clone(),
            strict: input.strict,
            scene: input.scene.clone(),
            trajectory: trajectory.clone(),
            max_memory: max_memory(args.survey.common.schedule.max_memory.as_deref())?,
        };
        let (mut survey, set, warnings) = read_survey(file, &reading)?;
        judge(&trajectory, &mut survey)?;
        Ok((Job::settle(args, survey, &set)?, warnings))
    }

    /// Settles every choice for a survey that has been read.
    pub fn settle(args: &RunArgs, mut survey: Survey, set: &RunSettings) -> Result<Job> {
        let CommonArgs { input, origin, schedule: speed } = &args.survey.common;
        let aloft = &args.survey.flight;
        let wanted = with_settings(&args.output, &set.output);
        if let Some(crs) = args.output.crs.as_deref().or(set.crs.as_deref()) {
            survey.crs_wkt = Some(wkt(crs)?);
        }
        let crs = survey.crs_wkt.as_deref();
        match &mut survey.platform.kind {
            PlatformKind::Stream(stream) => stream.grid = stream.grid.of_scene(crs),
            PlatformKind::Interpolated(files) => files.grid = files.grid.of_scene(crs),
            _ => {}
        }
        let seed = match origin.seed.as_deref() {
            Some(text) => survey::parse_seed(text).map_err(|e| Error::input(format!("--seed: {e}")))?,
            None => set.seed.or(survey.seed).unwrap_or(0),
        };
        let gps = origin.gps_start.clone().or(set.gps_start.clone()).unwrap_or_else(|| GPS_START.to_owned());
        // The reference takes the system's clock for an empty text.
        let gps = if gps == "now" || gps.trim().is_empty() { now() } else { gps };
        let threads = threads(speed.threads.or(set.threads));
        let physics = physics(&args.physics, &wanted, set, &survey, seed)?;
        let kinematics = physics.corrections.kinematics();
        let output = output(&wanted, args.trajectory_out.as_ref(), set, &survey, &gps)?;
        let settings = Settings {
            strict: input.strict || set.strict.unwrap_or(false),
            load: LoadOptions {
                wavelength_nm: survey.scanner.devices[0].beam.wavelength,
                seed,
                max_memory: max_memory(speed.max_memory.as_deref())?.or(set.max_memory),
                jobs: threads,
                sharing: sharing(args.tree.instances.as_deref()),
                rules: material_rules(&physics.corrections),
                drop_polygons: input.drop_polygons,
            },
            tree: tree(&args.tree, set, threads)?,
            flight: FlightOptions {
                seed,
                platform_noise: !aloft.no_platform_noise && set.platform_noise.unwrap_or(true),
                leg_noise: !aloft.no_leg_noise && set.leg_noise.unwrap_or(true),
                gps_start_ns: flight::gps_start(&gps, kinematics.leap_seconds)
                    .map_err(|e| Error::input(format!("GPS start: {e}")))?,
                kinematics,
                navigation: navigation(set.navigation, &aloft.navigation_error)?,
            },
            physics,
            schedule: schedule(speed, set, threads)?,
            max_latency: latency(aloft.latency.or(set.latency))?,
            survey,
        };
        Ok(Job { settings, output, schedule_log: speed.schedule_log.clone(), progress_lines: speed.progress })
    }
}

/// The rules by which materials and leaf angle tables are read under some corrections.
pub fn material_rules(corrections: &Corrections) -> MaterialRules {
    MaterialRules {
        specular_shares: corrections.specular_shares,
        reflectance_fraction: corrections.reflectance_fraction,
        specular_lobe: corrections.specular_lobe,
        lambert_default: corrections.lambert_default,
        leaf_table_scale: corrections.leaf_table_scale,
        leaf_table_mirror: corrections.leaf_table_mirror,
    }
}

/// What is said of a trajectory needs one.
fn judge(said: &PoseChoices, survey: &mut Survey) -> Result<()> {
    let zone = PoseChoices { utm_zone: said.utm_zone, ..PoseChoices::default() };
    match &mut survey.platform.kind {
        PlatformKind::Stream(_) => Ok(()),
        PlatformKind::Interpolated(files) if *said == zone => {
            files.grid = said.utm_zone.map_or(files.grid, Grid::Utm);
            Ok(())
        }
        _ if *said == PoseChoices::default() => Ok(()),
        _ => Err(Error::input(
            "options under \"Trajectory\" tell how a trajectory is read, and there is none; name it with --trajectory",
        )),
    }
}

fn threads(wanted: Option<usize>) -> usize {
    match wanted {
        Some(n) if n > 0 => n.min(1024),
        _ => std::thread::available_parallelism().map_or(1, usize::from),
    }
}

fn latency(seconds: Option<f64>) -> Result<Duration> {
    let Some(seconds) = seconds else { return Ok(DEFAULT_LATENCY) };
    match Duration::try_from_secs_f64(seconds) {
        Ok(latency) if seconds <= 3600.0 => Ok(latency),
        _ => Err(Error::input(format!("--latency: expected seconds from 0 to 3600, found {seconds}"))),
    }
}

fn physics(
    args: &PhysicsArgs,
    output: &OutputArgs,
    set: &RunSettings,
    survey: &Survey,
    seed: u64,
) -> Result<PhysicsOptions> {
    let refined = match (args.profile.physics, set.physics.as_deref()) {
        (Some(profile), _) => profile == PhysicsProfile::Refined,
        (None, Some("refined")) => true,
        (None, None | Some("helios")) => false,
        (None, Some(other)) => {
            return Err(Error::input(format!(
                "physics: expected \"helios\" or \"refined\", found {other:?}"
            )));
        }
    };
    let profile = if refined { PhysicsOptions::refined() } else { PhysicsOptions::helios() };
    let mut corrections = profile.corrections;
    if set.pipeline {
        corrections = corrections.or(Corrections::kinematic());
    }
    corrections.mount_offsets_turn |= matches!(survey.platform.kind, PlatformKind::Stream(_));
    for name in &args.profile.correct {
        correct(&mut corrections, name)?;
    }
    if output.subrays && (output.waveforms || output.wave_packets.is_some()) {
        return Err(Error::input("subrays have no waveforms: leave out either --subrays or the waveforms"));
    }
    // Light from all along a way belongs to no place of a subray.
    corrections.foliage_continuum &= !output.subrays;
    let flag = |typed: bool, written: Option<bool>| typed || written.unwrap_or(false);
    Ok(PhysicsOptions {
        seed,
        legacy_energy: flag(args.legacy_energy, set.legacy_energy),
        fixed_incidence: flag(args.fixed_incidence, set.fixed_incidence),
        echo_width: flag(args.echo_width, set.echo_width),
        waveform_noise: flag(args.waveform_noise, set.waveform_noise),
        record_waveforms: output.waveforms || output.wave_packets.is_some(),
        record_pulses: output.pulses || output.misses,
        record_truth: has_truth_columns(output),
        record_subrays: output.subrays,
        corrections,
    })
}

/// The errors of navigation that a file names, with those of the command line over them.
fn navigation(mut errors: NavigationErrors, typed: &[String]) -> Result<NavigationErrors> {
    for text in typed {
        let expected = || format!("expected KEY=NUMBERS such as position_m=0.02,0.02,0.05, found {text:?}");
        let numbers =
            |list: &str| list.split(',').map(|n| n.trim().parse().ok()).collect::<Option<Vec<f64>>>();
        let outcome = match text.split_once('=').map(|(key, list)| (key.trim(), numbers(list))) {
            Some((key, Some(numbers))) => errors.set(key, &numbers),
            _ => Err(expected()),
        };
        outcome.map_err(|message| Error::input(format!("--navigation-error: {message}")))?;
    }
    Ok(errors)
}

/// Switches one correction on, or off where `no-` stands before its name. A name that itself begins with `no-` switches
/// that correction on.
fn correct(corrections: &mut Corrections, name: &str) -> Result<()> {
    let field = |name: &str| name.replace('-', "_");
    let exact = Corrections::NAMES.contains(&field(name).as_str());
    let bare = name.strip_prefix("no-").filter(|_| !exact).unwrap_or(name);
    match corrections.by_name(&field(bare)) {
        Some(correction) => *correction = bare == name,
        None => {
            let known: Vec<String> = Corrections::NAMES.iter().map(|n| n.replace('_', "-")).collect();
            let known = known.join(", ");
            return Err(Error::input(format!(
                "--correct: no correction is called {bare:?}; there are {known}"
            )));
        }
    }
    Ok(())
}

/// Whether columns are chosen that need the truth of echoes. Wrong names are reported elsewhere.
fn has_truth_columns(output: &OutputArgs) -> bool {
    let chosen = output.columns.as_deref().map(Column::list);
    chosen.is_some_and(|columns| columns.is_ok_and(|c| c.iter().any(|c| c.is_truth())))
}

/// What is typed together with what the pipeline file says.
fn with_settings(args: &OutputArgs, set: &OutputSettings) -> OutputArgs {
    OutputArgs {
        waveforms: args.waveforms || set.waveforms,
        pulses: args.pulses || set.pulses,
        columns: args.columns.clone().or(set.columns.clone()),
        labels: args.labels || set.labels,
        true_positions: args.true_positions || set.true_positions,
        subrays: args.subrays || set.subrays,
        misses: args.misses || set.misses,
        las_at_most: args.las_at_most.clone().or(set.las_at_most.clone()),
        las_scale: args.las_scale.or(set.las_scale),
        las10: args.las10 || set.las10,
        wave_packets: args.wave_packets.clone().or(set.wave_packets.clone()),
        split_by_channel: args.split_by_channel || set.split_by_channel,
        zip_output: args.zip_output || set.zip_output,
        force: args.force || set.force,
        ..args.clone()
    }
}

fn output(
    args: &OutputArgs,
    poses: Option<&PathBuf>,
    set: &RunSettings,
    survey: &Survey,
    gps: &str,
) -> Result<OutputRequest> {
    let mut sinks = Vec::new();
    let usual = helios_format(args);
    if let Some(folder) = &args.output {
        sinks.push((Target::Helios(folder.clone()), usual));
    } else if !args.out.is_empty() {
        for path in &args.out {
            sinks.push(sink(path, args.format.as_deref(), usual)?);
        }
    } else {
        for s in set.sinks.iter().filter(|s| s.content == "points") {
            let (target, format) = sink(&s.path, args.format.as_deref().or(s.format.as_deref()), usual)?;
            let target = if s.helios { Target::Helios(s.path.clone()) } else { per_leg(target, s.per_leg) };
            sinks.push((target, format));
        }
        if sinks.is_empty() {
            sinks.push((Target::Helios(PathBuf::from("output")), usual));
        }
    }
    let trajectory = match poses {
        Some(path) => Some((path, None)),
        None => set.sinks.iter().find(|s| s.content == "trajectory").map(|s| (&s.path, s.per_leg)),
    };
    let trajectory = trajectory.map(|(path, apart)| {
        let target = if is_stdout(path) { Target::Stdout } else { Target::File(path.clone()) };
        (per_leg(target, apart), TrajectoryFormat::Csv)
    });
    // Columns that the file chooses are for its own outputs, which others may have replaced.
    let has_columns = sinks.iter().any(|(_, format)| format.has_columns());
    let columns = args.columns.as_deref().filter(|_| has_columns || args.columns != set.output.columns);
    Ok(OutputRequest {
        sinks,
        waveforms: args.waveforms,
        pulses: args.pulses,
        zip: args.zip_output,
        split_by_channel: args.split_by_channel,
        trajectory,
        columns: match columns.map(Column::list) {
            Some(Err(message)) => return Err(Error::input(format!("--columns: {message}"))),
            Some(Ok(columns)) => Some(columns),
            None => None,
        },
        misses: args.misses,
        labels: args.labels,
        true_positions: args.true_positions,
        live: matches!(survey.platform.kind, PlatformKind::Stream(_)),
        las: LasSettings {
            version: if args.las10 { LasVersion::V10 } else { LasVersion::V14 },
            scale: args.las_scale,
            at_most: match args.las_at_most.as_deref() {
                Some(text) => Some(count(text).filter(|&n| n > 0).ok_or_else(|| {
                    Error::input(format!(
                        "--las-at-most: expected a number of points such as 250M, found {text:?}"
                    ))
                })?),
                None => None,
            },
            packets: args.wave_packets.as_deref().map(|place| match place {
                "inside" => PacketPlace::Inside,
                _ => PacketPlace::Beside,
            }),
            ..LasSettings::default()
        },
        force: args.force,
        crs_wkt: survey.crs_wkt.clone(),
        creation: flight::calendar_day(gps).map_err(|e| Error::input(format!("GPS start: {e}")))?,
        ..OutputRequest::default()
    })
}

fn is_stdout(path: &Path) -> bool {
    ["-", "STDOUT", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"]
        .iter()
        .any(|name| path.as_os_str() == *name)
}

fn per_leg(target: Target, wanted: Option<bool>) -> Target {
    match target {
        Target::File(path) if wanted == Some(true) => Target::Directory(path),
        other => other,
    }
}

fn helios_format(args: &OutputArgs) -> PointFormat {
    match (args.las_output || args.las10, args.zip_output) {
        (true, true) => PointFormat::Laz,
        (true, false) => PointFormat::Las,
        (false, zip) => match args.format.as_deref().and_then(point_format) {
            Some(format) => format,
            None if zip => PointFormat::Bin,
            None => PointFormat::Xyz,
        },
    }
}

/// Where a path leads, and its format: the one that its extension tells, else the one asked for, else `usual`.
fn sink(path: &Path, format: Option<&str>, usual: PointFormat) -> Result<(Target, PointFormat)> {
    let stream = is_stdout(path);
    let extension = extension(path).filter(|_| !stream && !path.is_dir());
    let told = match (extension.and_then(point_format), format) {
        // One extension has two formats.
        (Some(PointFormat::PlyBinary), Some("ply-ascii")) => Some("ply-ascii"),
        (Some(PointFormat::Laz), Some("copc")) => Some("copc"),
        (Some(_), _) => extension,
        (None, asked) => asked.or(extension),
    };
    let known = told.map(|name| {
        point_format(name).ok_or_else(|| {
            Error::input(format!(
                "{}: no format is called {name:?}; choose xyz, csv, bin, las, laz, copc, ply, ply-ascii, arrow or parquet",
                path.display()
            ))
        })
    });
    let target = match (stream, extension) {
        (true, _) => Target::Stdout,
        (false, Some(_)) => Target::File(path.to_path_buf()),
        // A named pipe, or what the shell makes of >(...)
        (false, None) if path.exists() && !path.is_dir() && !path.is_file() => {
            Target::File(path.to_path_buf())
        }
        _ => Target::Directory(path.to_path_buf()),
    };
    match known {
        Some(format) => Ok((target, format?)),
        None => Ok((target, usual)),
    }
}

/// What stands behind the last dot of a name, or `copc.laz`.
fn extension(path: &Path) -> Option<&str> {
    let name = path.file_name()?.to_str()?;
    match name.len().checked_sub(".copc.laz".len()).and_then(|at| name.get(at..)) {
        Some(end) if end.eq_ignore_ascii_case(".copc.laz") => Some("copc.laz"),
        _ => path.extension()?.to_str(),
    }
}

fn point_format(name: &str) -> Option<PointFormat> {
    Some(match name.to_ascii_lowercase().as_str() {
        "xyz" | "txt" => PointFormat::Xyz,
        "bin" => PointFormat::Bin,
        "las" => PointFormat::Las,
        "laz" => PointFormat::Laz,
        "copc" | "copc.laz" => PointFormat::Copc,
        "ply" => PointFormat::PlyBinary,
        "ply-ascii" => PointFormat::PlyAscii,
        "csv" => PointFormat::Csv,
        "arrow" | "arrows" => PointFormat::Arrow,
        "parquet" => PointFormat::Parquet,
        _ => return None,
    })
}

fn wkt(text: &str) -> Result<String> {
    let path = Path::new(text);
    let wkt = if path.is_file() {
        std::fs::read_to_string(path).map_err(|e| Error::io("read", path, e))?
    } else {
        text.to_owned()
    };
    if wkt.trim_start().starts_with(|c: char| c.is_ascii_alphabetic()) && wkt.contains('[') {
        Ok(wkt.trim().to_owned())
    } else {
        Err(Error::input(format!(
            "--crs: expected WKT such as PROJCRS[...] or a file that holds it, found {text:?}"
        )))
    }
}

fn max_memory(text: Option<&str>) -> Result<Option<u64>> {
    text.map(|t| {
        count(t.trim_end_matches(['b', 'B']).trim_end_matches('i'))
            .ok_or_else(|| Error::input(format!("--max-memory: expected a size such as 4G, found {t:?}")))
    })
    .transpose()
}

/// A whole number with an optional unit prefix: 250k, 1.5M, 4G.
pub fn count(text: &str) -> Option<u64> {
    let text = text.trim();
    let (digits, factor) = match text.char_indices().last()? {
        (at, 'k' | 'K') => (&text[..at], 1e3),
        (at, 'm' | 'M') => (&text[..at], 1e6),
        (at, 'g' | 'G') => (&text[..at], 1e9),
        _ => (text, 1.0),
    };
    let n = digits.trim().parse::<f64>().ok()? * factor;
    (n.is_finite() && (0.0..1e18).contains(&n)).then_some(n.round() as u64)
}

fn now() -> String {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    since.map_or(0, |d| d.as_secs()).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_take_unit_prefixes() {
        assert_eq!(count("250k"), Some(250_000));
        assert_eq!(count("1.5M"), Some(1_500_000));
        assert_eq!(count("12"), Some(12));
        assert_eq!(count("-3"), None);
        assert_eq!(count("k"), None);
        assert_eq!(count(""), None);
        assert_eq!(max_memory(Some("4GiB")).unwrap(), Some(4_000_000_000));
    }

    #[test]
    fn errors_of_navigation_are_typed_over_those_of_the_file() {
        let mut file = NavigationErrors::NONE;
        file.set("position_m", &[1.0]).unwrap();
        let typed = ["position_m=0.1, 0.2,0.3".to_owned(), "boresight_deg=90".to_owned()];
        let both = navigation(file, &typed).unwrap();
        assert_eq!((both.position, both.boresight), ([0.1, 0.2, 0.3], [std::f64::consts::FRAC_PI_2; 3]));
        for wrong in ["position_m", "position_m=", "position_m=a", "position_m=1,2", "position=1"] {
            assert!(navigation(file, &[wrong.to_owned()]).is_err(), "{wrong}");
        }
    }

    #[test]
    fn corrections_go_by_name() {
        let mut c = Corrections::NONE;
        correct(&mut c, "sum-equal-ranges").unwrap();
        assert_eq!(c, Corrections { sum_equal_ranges: true, ..Corrections::NONE });
        correct(&mut c, "no-sum-equal-ranges").unwrap();
        assert_eq!(c, Corrections::NONE);
        // Exact names come before the prefix.
        correct(&mut c, "no-axis-gate").unwrap();
        assert_eq!(c, Corrections { no_axis_gate: true, ..Corrections::NONE });
        correct(&mut c, "no-no-axis-gate").unwrap();
        assert_eq!(c, Corrections::NONE);
        let unknown = correct(&mut c, "sum").unwrap_err().to_string();
        assert!(unknown.contains("sum-equal-ranges"), "{unknown}");
    }

    #[test]
    fn a_sink_is_a_stream_a_file_or_a_folder() {
        assert!(matches!(
            sink(Path::new("-"), Some("laz"), PointFormat::Xyz).unwrap(),
            (Target::Stdout, PointFormat::Laz)
        ));
        assert!(matches!(
            sink(Path::new("a/b.PLY"), None, PointFormat::Xyz).unwrap(),
            (Target::File(_), PointFormat::PlyBinary)
        ));
        assert!(matches!(
            sink(Path::new("folder"), Some("las"), PointFormat::Xyz).unwrap(),
            (Target::Directory(_), PointFormat::Las)
        ));
        assert!(matches!(sink(Path::new("folder"), None, PointFormat::Las).unwrap(), (_, PointFormat::Las)));
        assert!(sink(Path::new("a.e57"), None, PointFormat::Xyz).is_err());
        let named = |path: &str, format| sink(Path::new(path), Some(format), PointFormat::Xyz).unwrap().1;
        assert_eq!(named("a.laz", "xyz"), PointFormat::Laz, "a name never lies");
        assert_eq!(named("a.ply", "ply-ascii"), PointFormat::PlyAscii);
        assert_eq!(named("a.copc.laz", "xyz"), PointFormat::Copc);
        assert_eq!(named("a.laz", "copc"), PointFormat::Copc, "an octree is LAZ, too");
        assert_eq!(named("a.dat", "las"), PointFormat::Las);
    }
}
