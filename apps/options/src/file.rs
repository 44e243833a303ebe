//! Surveys and pipeline files, read together with the options that they hold.

use super::groups::Options;
use super::outputs::OutputKeys;
use super::precedence::Precedence;
use super::scanners::{ScannerSurvey, check_several, refuse_several};
use super::trajectory::TrajectoryOptions;
use super::values::{ColumnList, Crs, GpsStart, NavigationError, Vector};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity;
use vlscan_formats::{Column, PointFormat, read_number_columns};
use vlscan_lidar::pulse::PhysicsProfile;
use vlscan_survey::{
    MAX_DOCUMENT_BYTES, NavigationErrors, PlatformKind, ProjectionGrid, ReadOptions, SceneChoice, Source,
    Survey, Tables,
};
use vlscan_tables::input::{is_stdin, read_file};

/// Reads a survey (.xml) or a pipeline (.toml). The options returned are those typed over those of the file;
/// the last value holds warnings to be shown.
///
/// # Errors
/// All problems of all files at once; options of trajectories where there is none.
pub fn read_survey(path: &Path, typed: Options) -> Result<(Survey, Options, Diagnostics)> {
    if is_pipeline(path) {
        return read_source(&Source::read(path)?, typed);
    }
    read_xml(path, typed)
}

/// Reads a survey in XML.
fn read_xml(path: &Path, typed: Options) -> Result<(Survey, Options, Diagnostics)> {
    let read = vlscan_survey::read_survey(path, &typed.read_options())?;
    finish_xml(read, typed)
}

/// Completes a survey that was read in XML.
fn finish_xml(read: (Survey, Diagnostics), typed: Options) -> Result<(Survey, Options, Diagnostics)> {
    let (mut survey, mut warnings) = read;
    let chosen = typed.trajectory.clone();
    warnings.extend(doubts(&chosen, &chosen, [const { None }; OFFSETS.len()]));
    warn_of_fraction(&typed, None, &mut warnings);
    warn_of_unused_trajectories(&typed, &survey, &mut warnings);
    typed.warn_of_unused_formats(&mut warnings)?;
    let warnings = warnings.finish(typed.input.strict.is_on())?;
    check_trajectory_options(chosen, &mut survey)?;
    Ok((survey, typed, warnings))
}

/// Reads a pipeline, or a survey in XML, in memory; `name` is its name in messages, and its folder the one
/// that names of files are relative to.
///
/// # Errors
/// As for [`read_survey`].
pub fn read_survey_text(name: &Path, text: String, typed: Options) -> Result<(Survey, Options, Diagnostics)> {
    if text.trim_start().starts_with('<') {
        let read = vlscan_survey::read_survey_text(name, &text, &typed.read_options())?;
        return finish_xml(read, typed);
    }
    read_source(&Source::of_text(name, text), typed)
}

fn read_source(source: &Source, typed: Options) -> Result<(Survey, Options, Diagnostics)> {
    let tables = source.tables()?;
    let count = tables.scanners();
    if count > 1 {
        return Err(refuse_several(source, count));
    }
    let (read, warnings) = read_pipeline(source, tables, typed, (count == 1).then_some(0))?;
    Ok((read.survey, read.options, warnings))
}

/// Reads a survey or a pipeline as [`read_survey`] does; a pipeline with `[[scanner]]` tables is read once
/// for each of them, in their order, and its scene only once.
///
/// # Errors
/// As for [`read_survey`].
pub fn read_scanners(path: &Path, mut typed: Options) -> Result<(Vec<ScannerSurvey>, Diagnostics)> {
    if !is_pipeline(path) {
        let (survey, options, warnings) = read_xml(path, typed)?;
        return Ok((vec![ScannerSurvey { scanner: None, survey, options }], warnings));
    }
    let source = Source::read(path)?;
    let tables = source.tables()?;
    let count = tables.scanners();
    if count == 0 {
        let (read, warnings) = read_pipeline(&source, tables, typed, None)?;
        return Ok((vec![read], warnings));
    }
    let (mut found, mut problems, mut is_refused) = (Vec::new(), Diagnostics::default(), false);
    for index in 0..count {
        let more = match read_pipeline(&source, source.tables()?, typed.clone(), Some(index)) {
            Ok((read, warnings)) => {
                typed.scene.get_or_insert_with(|| Arc::new(read.survey.scene.clone()));
                found.push(read);
                warnings
            }
            Err(Error::Input(refused)) => {
                is_refused = true;
                *refused
            }
            Err(error) => return Err(error),
        };
        let new = more.without(&problems);
        problems.extend(new);
    }
    if is_refused { Err(Error::Input(Box::new(problems))) } else { Ok((found, problems)) }
}

/// True if the file is a pipeline, or an XML file with a survey in it; one that is too large to be read is
/// neither.
pub fn holds_survey(path: &Path) -> bool {
    let is_xml = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("xml"));
    is_pipeline(path)
        || is_xml
            && read_file(path, MAX_DOCUMENT_BYTES)
                .is_ok_and(|bytes| memchr::memmem::find(&bytes, b"<survey").is_some())
}

fn is_pipeline(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"))
}

/// True if columns are chosen and one of them is of those that files of this format have beside their own:
/// colours and labels of the way of light.
fn has_column_of(format: PointFormat, columns: &Option<ColumnList>) -> bool {
    let has = |column: &Column| {
        (column.needs().colour && format.has_colours())
            || (column.is_light_label() && format.has_light_labels())
    };
    columns.iter().flat_map(|columns| &columns.0).any(has)
}

impl Options {
    /// How the survey's files are read.
    pub fn read_options(&self) -> ReadOptions {
        ReadOptions {
            assets: self.input.assets.clone(),
            strict: self.input.strict.is_on(),
            scene: match &self.scene {
                Some(recipe) => Some(SceneChoice::Given(recipe.clone())),
                None => self.input.scene.clone().map(SceneChoice::Named),
            },
            trajectory: self.trajectory.stream(),
            named_trajectories: self.named_trajectories.clone(),
            is_traced: self.is_traced,
            max_memory: self.schedule.max_memory.map(|bytes| bytes.0),
            number_columns: Some(read_number_columns),
        }
    }
}

/// The `[[output]]` tables.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Outputs {
    output: Vec<OutputKeys>,
}

/// Reads a pipeline from its tables, of `[[scanner]]` tables that with the index `scanner`.
fn read_pipeline(
    source: &Source,
    mut tables: Tables,
    typed: Options,
    scanner: Option<usize>,
) -> Result<(ScannerSurvey, Diagnostics)> {
    let mut file = take_options(&mut tables);
    let has_several = tables.scanners() > 1;
    let scanner = scanner.map(|index| choose_scanner(&mut tables, index, &mut file));
    // The folders of the command line are searched first, then that of the file and those that it names.
    let folder = source.folder();
    let mut assets = typed.input.assets.clone();
    assets.push(folder.to_path_buf());
    assets.extend(file.input.assets.iter().map(|dir| folder.join(dir)));

    let replaces_outputs = !typed.output.out.is_empty() || typed.output.output.is_some();
    let (typed_crs, typed_columns) = (typed.output.crs.is_some(), typed.output.columns.is_some());
    let replaces_trajectory = typed.trajectory.path.is_some();
    let chosen = typed.trajectory.clone();
    let typed_output = replaces_outputs.then(|| typed.output.clone());
    let mut options = typed.over(file);
    options.input.assets = assets;
    if has_several {
        check_several(&options)?;
    }
    // Columns that the file chooses are for its own outputs.
    let sinks = options.sinks()?;
    let columns = &options.output.columns;
    let has_columns = |format: PointFormat| format.has_columns() || has_column_of(format, columns);
    let has_columns = sinks.iter().any(|(_, format)| has_columns(*format));
    if replaces_outputs && !typed_columns && !has_columns {
        options.output.columns = None;
    }
    if let Some(typed) = &typed_output {
        options.output.leave_unused(typed, &sinks);
    }
    let mut reading = ReadOptions { trajectory: None, ..options.read_options() };
    if let (Some(Crs::File(name)), false) = (&options.output.crs, typed_crs) {
        let place = tables.place("", "crs");
        options.output.crs = tables.find_file(name, place, &reading).map(Crs::File);
    }
    if !replaces_trajectory {
        find_trajectory(&mut options, source, &mut tables, &reading);
    }
    reading.trajectory = options.trajectory.stream();
    let gps_place = tables.place("", "gps_start");
    let places = OFFSETS.map(|(key, ..)| tables.place("trajectory", key));
    let (read, mut warnings) = vlscan_survey::read_pipeline_survey(tables, &reading)?;
    warnings.extend(doubts(&options.trajectory, &chosen, places));
    warn_of_fraction(&options, gps_place, &mut warnings);
    warn_of_unused_trajectories(&options, &read.survey, &mut warnings);
    options.warn_of_unused_formats(&mut warnings)?;
    options.has_own_flight = read.has_own_flight && !options.is_traced;
    if !read.is_of_survey {
        options.profile.profile.get_or_insert(PhysicsProfile::OF_PIPELINES);
    }
    let warnings = warnings.finish(reading.strict)?;
    let mut read = ScannerSurvey { scanner, survey: read.survey, options };
    check_trajectory_options(chosen, &mut read.survey)?;
    if read.scanner.is_some() {
        read.check(has_several)?;
    }
    Ok((read, warnings))
}

/// Finds the file of the trajectory that a pipeline names. Problems are recorded.
fn find_trajectory(options: &mut Options, source: &Source, tables: &mut Tables, reading: &ReadOptions) {
    if let Some(name) = &options.trajectory.path {
        let place = tables.place("trajectory", "path");
        let found = match is_stdin(name) {
            true => Some(PathBuf::from("-")),
            false => tables.find_file(name, place, reading),
        };
        options.trajectory.path = Some(found.unwrap_or_default());
    } else if tables.has("trajectory") {
        let place = Some(source.place(0..0));
        tables.error(place, "[trajectory] needs the key `path`").help("path = \"-\" is standard input");
    }
}

/// Chooses one of the `[[scanner]]` tables, whose outputs become those of the file. Returns its name.
fn choose_scanner(tables: &mut Tables, index: usize, file: &mut Options) -> String {
    if !file.outputs.is_empty() {
        let place = tables.place("", "output");
        let message = "[[output]] tables have no scanner beside [[scanner]] tables";
        tables.error(place, message).help("give each [[scanner]] its `output`");
    }
    let chosen = tables.choose_scanner(index, OutputKeys::of_path);
    file.outputs = chosen.outputs;
    chosen.name
}

/// Warns of a fraction of a second in the start of GPS time.
fn warn_of_fraction(options: &Options, place: Option<Place>, warnings: &mut Diagnostics) {
    if options.origin.gps_start.as_ref().is_some_and(GpsStart::has_fraction) {
        warnings.warn(place, "the fraction of a second of the GPS start is ignored, as in HELIOS++");
    }
}

/// Warns of trajectories in memory that no leg names.
fn warn_of_unused_trajectories(options: &Options, survey: &Survey, warnings: &mut Diagnostics) {
    let files = match &survey.platform.kind {
        PlatformKind::Interpolated(recorded) => recorded.files.as_slice(),
        _ => &[],
    };
    for (name, _) in &options.named_trajectories {
        if !files.iter().any(|file| file.content.is_some() && file.path == Path::new(name)) {
            let message = "the trajectory in memory is not used: no leg names it";
            warnings
                .warn(Some(Place::of_file(Path::new(name))), message)
                .help(format!("give legs the attribute trajectory=\"{name}\""));
        }
    }
}

/// Offsets of trajectories that are compared with typical values: key of `[trajectory]`, option, bounds.
const OFFSETS: [(&str, &str, quantity::Bounds); 3] = [
    ("lever_arm_m", "--lever-arm", quantity::LEVER_ARM),
    ("boresight_deg", "--boresight", quantity::BORESIGHT),
    ("height_offset_m", "--height-offset", quantity::HEIGHT_OFFSET),
];

/// Warns of [`OFFSETS`] of a trajectory beyond typical values. `places` are those of the keys in a file, over
/// which `typed` options go.
fn doubts(
    options: &TrajectoryOptions,
    typed: &TrajectoryOptions,
    places: [Option<Place>; OFFSETS.len()],
) -> Diagnostics {
    let mut found = Diagnostics::default();
    let numbers = |options: &TrajectoryOptions| {
        let vector = |v: Vector| v.0.to_vec();
        let height = options.height_offset.map(|height| vec![height.0]);
        [options.lever_arm.map(vector), options.boresight.map(vector), height]
    };
    let values = numbers(options).into_iter().zip(numbers(typed)).zip(places).zip(OFFSETS);
    for (((numbers, typed), place), (_, option, bounds)) in values {
        let doubt = numbers.iter().flatten().find_map(|number| bounds.doubt(*number));
        if let Some((doubt, hint)) = doubt {
            let place = place.filter(|_| typed.is_none());
            found.warn(place, format!("a number of {option} {doubt}")).help(hint);
        }
    }
    found
}

/// Takes all options from a pipeline file.
fn take_options(tables: &mut Tables) -> Options {
    let mut options = Options {
        output: tables.take(""),
        input: tables.take(""),
        origin: tables.take(""),
        outputs: tables.take::<Outputs>("").output,
        trajectory: tables.take("trajectory"),
        noise: tables.take("physics"),
        profile: tables.take("physics"),
        echoes: tables.take("physics"),
        schedule: tables.take("schedule"),
        tree: tables.take("schedule"),
        ..Options::default()
    };
    if options.trajectory.angles.is_some() && options.trajectory.degrees.is_some() {
        let place = tables.place("trajectory", "angles");
        tables.error(place, "give either `angles` or `degrees`");
    }
    for (key, _) in NavigationErrors::KEYS {
        let Some(numbers) = tables.take_key::<OneOrMore>("navigation_errors", key) else { continue };
        let numbers = numbers.into_vec();
        match NavigationErrors::default().set(key, &numbers) {
            Ok(()) => options.navigation.errors.push(NavigationError { key: (*key).to_owned(), numbers }),
            Err(error) => {
                let place = tables.place("navigation_errors", key);
                tables.error(place, error.to_string());
            }
        }
    }
    options
}

/// A number, or a list of numbers.
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected one number or three")]
enum OneOrMore {
    One(f64),
    More(Vec<f64>),
}

impl OneOrMore {
    fn into_vec(self) -> Vec<f64> {
        match self {
            OneOrMore::One(number) => vec![number],
            OneOrMore::More(numbers) => numbers,
        }
    }
}

/// Rejects options for reading a trajectory if there is none. The UTM zone is for trajectory files of
/// surveys, too.
fn check_trajectory_options(typed: TrajectoryOptions, survey: &mut Survey) -> Result<()> {
    let typed = TrajectoryOptions { latency: None, ..typed };
    let without_zone = TrajectoryOptions { utm_zone: None, ..typed.clone() };
    match &mut survey.platform.kind {
        PlatformKind::Stream(_) => Ok(()),
        PlatformKind::Interpolated(files) if without_zone == TrajectoryOptions::default() => {
            files.grid = typed.utm_zone.map_or(files.grid, |zone| ProjectionGrid::Utm(zone.0));
            Ok(())
        }
        _ if typed == TrajectoryOptions::default() => Ok(()),
        _ => Err(Error::input(
            "options under \"Trajectory\" describe how a trajectory is read: give one with --trajectory",
        )),
    }
}
