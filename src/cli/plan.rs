//! `vlscan plan`: surveys from an area, a plot or a line.

use super::args::{AirborneArgs, CommonPlanArgs, MobileArgs, PlanArgs, PlanCommand, TerrestrialArgs};
use super::ground::GroundModel;
use super::{Console, info};
use crate::diag::Diagnostics;
use crate::error::{Error, Result};
use crate::files::{FileWriter, Patched, write_stdout};
use crate::options::holds_survey;
use crate::plan::{self, AirborneOptions, Area, Arrangement, Document, Ground, Instrument};
use crate::plan::{MobileOptions, TerrestrialOptions};
use crate::survey::{Mount, ReadOptions, SceneRecipe, catalogue, find_scanner};
use std::path::{Path, PathBuf};

/// Height below which a flight is a drone's if no platform is named, m.
const MAX_DRONE_HEIGHT: f64 = 150.0;
/// Positions around a plot if no number is given.
const DEFAULT_POSITIONS: u32 = 4;
/// Steepest climb if none is given, degrees.
const DEFAULT_CLIMB: f64 = 10.0;

pub fn run(args: &PlanArgs, console: &Console) -> Result<()> {
    make(args, &command_line(), console)
}

/// Makes a plan that names `command` as what made it.
pub fn make(args: &PlanArgs, command: &str, console: &Console) -> Result<()> {
    match &args.command {
        PlanCommand::Airborne(args) => airborne(args, command, console),
        PlanCommand::Terrestrial(args) => terrestrial(args, command, console),
        PlanCommand::Mobile(args) => mobile(args, command, console),
    }
}

fn airborne(args: &AirborneArgs, command: &str, console: &Console) -> Result<()> {
    let site = Site::read(&args.common, console)?;
    let area = site.area(args.area.as_deref())?;
    let instrument = instrument(&args.common)?;
    let default = if args.height.0 < MAX_DRONE_HEIGHT { "copter_linearpath" } else { "sr22" };
    let (platform, mount) = platform(args.common.platform.as_deref().unwrap_or(default))?;
    let options = AirborneOptions {
        height: args.height.0,
        speed: args.speed.map(|speed| speed.0),
        overlap: args.overlap,
        density: args.density.map(|density| density.0),
        scan_angle: args.scan_angle.map(|angle| angle.0),
        pulse_rate: args.common.pulse_rate,
        scan_freq: args.scan_freq.map(|freq| freq.0),
        heading: args.heading,
        cross_lines: args.cross_lines,
        run_in: args.run_in.map(|length| length.0),
        look_back: mount.map_or(0.0, |mount| instrument.look_back(mount.rotation)),
        turn_radius: args.turn_radius.map(|radius| radius.0),
        climb: args.follow_terrain.then(|| args.climb.unwrap_or(DEFAULT_CLIMB)),
    };
    let level = args.common.ground;
    let height = |x: f64, y: f64| match &site.ground {
        Some(ground) => ground.height(x, y),
        None => Some(level),
    };
    let plan = plan::plan_airborne(&area, &instrument, &options, &Ground { height: &height, level });
    finish(plan.map_err(Error::input)?, platform, &args.common, &site, command, console)
}

fn terrestrial(args: &TerrestrialArgs, command: &str, console: &Console) -> Result<()> {
    let site = Site::read(&args.common, console)?;
    let arrangement = match (args.around, args.spacing) {
        (Some(centre), _) => Arrangement::Around {
            centre,
            // The command line requires it.
            radius: args.radius.map_or(0.0, |radius| radius.0),
            count: args.positions.unwrap_or(DEFAULT_POSITIONS),
            at_centre: args.at_centre,
        },
        (None, spacing) => Arrangement::Grid {
            area: site.area(args.area.as_deref())?,
            spacing: spacing.map_or(f64::INFINITY, |spacing| spacing.0),
        },
    };
    let options = TerrestrialOptions {
        arrangement,
        resolution: args.resolution.0,
        pulse_rate: args.common.pulse_rate,
        level: args.common.ground,
        on_ground: site.ground.is_some(),
    };
    let plan = plan::plan_terrestrial(&instrument(&args.common)?, &options).map_err(Error::input)?;
    let (platform, _) = platform(args.common.platform.as_deref().unwrap_or("tripod"))?;
    finish(plan, platform, &args.common, &site, command, console)
}

fn mobile(args: &MobileArgs, command: &str, console: &Console) -> Result<()> {
    let site = Site::read(&args.common, console)?;
    let line = plan::read_line(&args.along)?;
    let options = MobileOptions {
        speed: args.speed.0,
        scan_angle: args.scan_angle.map(|angle| angle.0),
        pulse_rate: args.common.pulse_rate,
        scan_freq: args.scan_freq.map(|freq| freq.0),
        step: args.step.0,
        level: args.common.ground,
        on_ground: site.ground.is_some(),
    };
    let plan = plan::plan_mobile(&line, &instrument(&args.common)?, &options).map_err(Error::input)?;
    let (platform, _) = platform(args.common.platform.as_deref().unwrap_or("vehicle_linearpath"))?;
    finish(plan, platform, &args.common, &site, command, console)
}

/// Where a survey takes place.
struct Site {
    recipe: Option<SceneRecipe>,
    ground: Option<GroundModel>,
}

impl Site {
    fn read(args: &CommonPlanArgs, console: &Console) -> Result<Site> {
        let Some(name) = &args.scene else { return Ok(Site { recipe: None, ground: None }) };
        let name = info::SceneName { scene: name, assets: &args.assets };
        let (recipe, scanning, warnings) = name.recipe()?;
        console.warnings(&warnings);
        let (ground, warnings) = GroundModel::load(&recipe, &info::options(&recipe, &scanning, false)?)?;
        console.warnings(&warnings);
        Ok(Site { recipe: Some(recipe), ground: Some(ground) })
    }

    /// The named area, or the scene's box.
    fn area(&self, named: Option<&str>) -> Result<Area> {
        match (named, &self.ground) {
            (Some(name), _) => plan::read_area(name),
            (None, Some(ground)) => {
                let [low, high] = ground.extent();
                Area::rectangle(low, high).map_err(Error::input)
            }
            (None, None) => Err(Error::input("which area? --area, or --scene, whose box it is, is needed")),
        }
    }

    /// The scene as a plan in the file `out` names it: relative references are relative to that file.
    fn reference(&self, args: &CommonPlanArgs) -> Result<Option<String>> {
        let (Some(recipe), Some(name)) = (&self.recipe, &args.scene) else { return Ok(None) };
        let (path, id) = match (holds_survey(Path::new(name)), name.split_once('#')) {
            (true, _) => (recipe.path.clone(), Some(recipe.id.as_str())),
            (false, Some((path, id))) => (PathBuf::from(path), Some(id)),
            (false, None) => (PathBuf::from(name), None),
        };
        let beside =
            args.out.as_deref().and_then(Path::parent).is_none_or(|folder| folder.as_os_str().is_empty());
        let path = match beside || !path.exists() {
            true => path,
            false => std::path::absolute(&path).map_err(|e| Error::open(&path, e))?,
        };
        let path = path.to_str().ok_or_else(|| {
            Error::input(format!("{}: its name is not UTF-8, which a pipeline file needs", path.display()))
        })?;
        Ok(Some(id.map_or(path.to_owned(), |id| format!("{path}#{id}"))))
    }
}

/// The scanner of the command line.
fn instrument(args: &CommonPlanArgs) -> Result<Instrument> {
    let reading = ReadOptions { assets: args.assets.clone(), ..ReadOptions::default() };
    let (scanner, _) = find_scanner(&args.scanner, &reading)?;
    let (known, _) = catalogue()?;
    Ok(Instrument::new(in_catalogue(&args.scanner, known.scanners.iter().map(|(name, _)| name)), &scanner))
}

/// The reference of a platform, and the scanner's mount on it if it is one of the catalogue's.
fn platform(name: &str) -> Result<(String, Option<Mount>)> {
    let (known, _) = catalogue()?;
    let reference = in_catalogue(name, known.platforms.iter().map(|(name, _)| name));
    if !reference.contains('#') {
        let names: Vec<&str> =
            known.platforms.iter().filter_map(|(name, _)| Some(name.split_once('#')?.1)).collect();
        return Err(Error::input(format!(
            "no platform is called `{name}`; there are {}, and file.xml#id",
            names.join(", ")
        )));
    }
    let mount = known.platforms.iter().find(|(name, _)| *name == reference).map(|(_, found)| found.mount);
    Ok((reference, mount))
}

/// The full reference of an id in the catalogue; other names as they are.
fn in_catalogue<'n>(name: &str, references: impl Iterator<Item = &'n String>) -> String {
    let is_named = |reference: &&String| reference.split_once('#').is_some_and(|(_, id)| id == name);
    let mut references = references;
    references.find(is_named).cloned().unwrap_or_else(|| name.to_owned())
}

/// Completes the plan, writes it and says what it promises.
fn finish(
    mut plan: Document,
    platform: String,
    args: &CommonPlanArgs,
    site: &Site,
    command: &str,
    console: &Console,
) -> Result<()> {
    plan.platform = platform;
    plan.scene = site.reference(args)?;
    let mut warnings = Diagnostics::default();
    for warning in &plan.warnings {
        warnings.warn(None, warning.clone());
    }
    console.warnings(&warnings);
    let text = plan.text(command);
    let Some(path) = &args.out else { return write_stdout(&text) };
    if path.exists() && !args.force {
        return Err(Error::input(format!("{} exists; --force overwrites it", path.display())));
    }
    let mut file = FileWriter::create(path, args.force, Patched::Never)?;
    file.append(text.as_bytes())?;
    file.finish()?;
    for comment in &plan.comments {
        console.say(comment);
    }
    console.say(format!("{}; fly it with: vlscan run {0} -o points.laz", path.display()));
    Ok(())
}

/// The command line as typed, with quotes where a shell needs them.
fn command_line() -> String {
    let words = std::env::args_os().skip(1).map(|word| {
        let word = word.to_string_lossy().into_owned();
        let is_plain = word.chars().all(|c| c.is_alphanumeric() || "-_./=,:#+%".contains(c));
        if is_plain && !word.is_empty() { word } else { format!("'{}'", word.replace('\'', r"'\''")) }
    });
    std::iter::once("vlscan".to_owned()).chain(words).collect::<Vec<_>>().join(" ")
}
