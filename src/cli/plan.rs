//! `vlscan plan`: surveys from an area, a plot or a line.

mod check;

use super::args::{AirborneArgs, CommonPlanArgs, MobileArgs, PlanArgs, PlanCommand, TerrestrialArgs};
use super::ground::GroundModel;
use super::{Console, info};
use crate::options::holds_survey;
use crate::pipeline::LoadedScene;
use std::path::{Path, PathBuf};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, Patched, write_stdout};
use vlscan_base::machine;
use vlscan_geom::DVec3;
use vlscan_lidar::pulse::PhysicsProfile;
use vlscan_scene::LoadOptions;
use vlscan_survey::{Platform, ReadOptions, SceneRecipe, catalogue, find_platform, find_scanner};
use vlscan_tools::plan::{self, AirborneOptions, Area, Arrangement, Document, Ground, Instrument};
use vlscan_tools::plan::{MobileOptions, TerrestrialOptions};
use vlscan_trace::{BuildOptions, Builder};

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
    let mut planner = Planner::new(&args.common, command, console)?;
    let area = planner.area(args.area.as_deref(), args.buffer.map(|distance| distance.0))?;
    let default = if args.height.0 < MAX_DRONE_HEIGHT { "copter_linearpath" } else { "sr22" };
    let (reference, platform) = planner.platform(default)?;
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
        mount: platform.mount,
        may_turn: args.common.platform.is_none(),
        turn_radius: args.turn_radius.map(|radius| radius.0),
        climb: args.follow_terrain.then(|| args.climb.unwrap_or(DEFAULT_CLIMB)),
    };
    let level = args.common.level();
    let height = |x: f64, y: f64| match &planner.site {
        Some(site) => site.ground.height(x, y),
        None => Some(level),
    };
    let ground = Ground { height: &height, level };
    let plan = plan::plan_airborne(&area, &planner.instrument, &options, &ground).map_err(Error::input)?;
    planner.finish(Document { platform: reference, ..plan }, Some(&area))
}

fn terrestrial(args: &TerrestrialArgs, command: &str, console: &Console) -> Result<()> {
    let mut planner = Planner::new(&args.common, command, console)?;
    let arrangement = match (args.around, args.spacing) {
        (Some(centre), _) => Arrangement::Around {
            centre,
            // The command line requires it.
            radius: args.radius.map_or(0.0, |radius| radius.0),
            count: args.positions.unwrap_or(DEFAULT_POSITIONS),
            at_centre: args.at_centre,
        },
        (None, spacing) => Arrangement::Grid {
            area: planner.area(args.area.as_deref(), None)?,
            spacing: spacing.map_or(f64::INFINITY, |spacing| spacing.0),
        },
    };
    let options = TerrestrialOptions {
        arrangement,
        resolution: args.resolution.0,
        pulse_rate: args.common.pulse_rate,
        level: args.common.level(),
        on_ground: planner.is_ground_used()?,
    };
    let plan = plan::plan_terrestrial(&planner.instrument, &options).map_err(Error::input)?;
    let (platform, _) = planner.platform("tripod")?;
    planner.finish(Document { platform, ..plan }, None)
}

fn mobile(args: &MobileArgs, command: &str, console: &Console) -> Result<()> {
    let mut planner = Planner::new(&args.common, command, console)?;
    let (line, warnings) = plan::read_line(&args.along, planner.crs())?;
    console.warnings(&warnings)?;
    let options = MobileOptions {
        speed: args.speed.0,
        scan_angle: args.scan_angle.map(|angle| angle.0),
        pulse_rate: args.common.pulse_rate,
        scan_freq: args.scan_freq.map(|freq| freq.0),
        step: args.step.0,
        level: args.common.level(),
        on_ground: planner.is_ground_used()?,
    };
    let plan = plan::plan_mobile(&line, &planner.instrument, &options).map_err(Error::input)?;
    let (platform, _) = planner.platform("vehicle_linearpath")?;
    planner.finish(Document { platform, ..plan }, None)
}

/// What plans of all kinds are made from.
struct Planner<'a> {
    args: &'a CommonPlanArgs,
    command: &'a str,
    console: &'a Console,
    instrument: Instrument,
    /// Where the survey takes place, if there is a scene.
    site: Option<Site>,
    /// The warnings about scanner and platform, which have been shown.
    told: Diagnostics,
}

/// A loaded scene.
struct Site {
    recipe: SceneRecipe,
    loaded: LoadedScene,
    ground: GroundModel,
}

impl Site {
    /// Loads the scene of the command line as surveys with this instrument do.
    fn load(name: &str, args: &CommonPlanArgs, instrument: &Instrument, console: &Console) -> Result<Site> {
        let (recipe, _, warnings) = info::SceneName { scene: name, assets: &args.assets }.recipe()?;
        console.warnings(&warnings)?;
        let options = LoadOptions {
            wavelength_nm: instrument.wavelength(),
            rules: PhysicsProfile::Refined.corrections(),
            max_memory: machine::memory(),
            ..LoadOptions::default()
        };
        let trees = BuildOptions::of(Builder::default());
        let observer = console.observer();
        let loaded = LoadedScene::load(&recipe, &options, &trees, console.is_strict(), &observer)?;
        let ground = GroundModel::over(&loaded, &observer)?;
        Ok(Site { recipe, loaded, ground })
    }
}

impl Planner<'_> {
    fn new<'a>(args: &'a CommonPlanArgs, command: &'a str, console: &'a Console) -> Result<Planner<'a>> {
        let (scanner, told) = find_scanner(&args.scanner, &reading(args))?;
        console.warnings(&told)?;
        let (known, _) = catalogue()?;
        let reference = in_catalogue(&args.scanner, known.scanners.iter().map(|(name, _)| name));
        let instrument = Instrument::new(reference, &scanner);
        let scene = args.scene.as_deref();
        let site = scene.map(|name| Site::load(name, args, &instrument, console)).transpose()?;
        Ok(Planner { args, command, console, instrument, site, told })
    }

    /// The platform of the command line, or the one that suits, with its reference.
    fn platform(&mut self, suiting: &str) -> Result<(String, Platform)> {
        let name = self.args.platform.as_deref().unwrap_or(suiting);
        let (platform, warnings) = find_platform(name, &reading(self.args))?;
        self.console.warnings(&warnings)?;
        self.told.extend(warnings);
        let (known, _) = catalogue()?;
        Ok((in_catalogue(name, known.platforms.iter().map(|(name, _)| name)), platform))
    }

    /// The system of the scene's coordinates as WKT, if its files name one.
    fn crs(&self) -> Option<&str> {
        self.site.as_ref().and_then(|site| site.ground.crs())
    }

    /// Whether waypoints are set on the scene's ground. They are not where the command line has its height.
    fn is_ground_used(&self) -> Result<bool> {
        let (Some(site), Some(name)) = (&self.site, &self.args.scene) else { return Ok(false) };
        if !site.ground.has_ground() && self.args.ground.is_none() {
            let mut problems = Diagnostics::default();
            problems.error(None, format!("--scene {name}: none of its materials is ground")).help(
                "give the terrain's material `helios_isGround true` (in its MTL file or materials.csv; `vlscan scene stand \
                 --terrain` does), or tell the height of level ground with --ground",
            );
            return Err(Error::Input(Box::new(problems)));
        }
        Ok(self.args.ground.is_none())
    }

    /// Refuses waypoints that are to stand on ground where there is none.
    fn check_ground(&self, plan: &Document) -> Result<()> {
        let Some(site) = &self.site else { return Ok(()) };
        let is_missing = |p: &DVec3| !site.ground.is_under(p.x, p.y);
        let on_ground = plan.waypoints.iter().filter(|w| w.on_ground).map(|w| w.position);
        let missing: Vec<DVec3> = on_ground.filter(is_missing).collect();
        let Some(first) = missing.first() else { return Ok(()) };
        let mut problems = Diagnostics::default();
        let message = format!(
            "the scene has no ground below {} of {} positions, the first at x {:.3} y {:.3}",
            missing.len(),
            plan.waypoints.len(),
            first.x,
            first.y
        );
        problems.error(None, message).help(
            "keep --area, --around or --along within the terrain whose material has `helios_isGround true`, or tell the height \
             of level ground with --ground",
        );
        Err(Error::Input(Box::new(problems)))
    }

    /// The named area, or the box of the scene's ground.
    fn area(&self, named: Option<&str>, buffer: Option<f64>) -> Result<Area> {
        match (named, &self.site) {
            (Some(name), _) => {
                let (area, warnings) = plan::read_area(name, self.crs(), buffer)?;
                self.console.warnings(&warnings)?;
                Ok(area)
            }
            (None, Some(site)) => {
                let [low, high] = site.ground.extent();
                Area::rectangle(low, high).map_err(Error::input)
            }
            (None, None) => Err(Error::input("give --area, or --scene, whose ground is then the area")),
        }
    }

    /// The scene as a plan in the file `out` names it: relative references are relative to that file.
    fn reference(&self) -> Result<Option<String>> {
        let (Some(site), Some(name)) = (&self.site, &self.args.scene) else { return Ok(None) };
        let (path, id) = match (holds_survey(Path::new(name)), name.split_once('#')) {
            (true, _) => (site.recipe.path.clone(), Some(site.recipe.id.as_str())),
            (false, Some((path, id))) => (PathBuf::from(path), Some(id)),
            (false, None) => (PathBuf::from(name), None),
        };
        let folder = self.args.out.as_deref().and_then(Path::parent);
        let beside = folder.is_none_or(|folder| folder.as_os_str().is_empty());
        let path = match beside || !path.exists() {
            true => path,
            false => std::path::absolute(&path).map_err(|e| Error::open(&path, e))?,
        };
        let path = path.to_str().ok_or_else(|| {
            Error::input(format!("{}: its name is not UTF-8, which a pipeline file needs", path.display()))
        })?;
        Ok(Some(id.map_or(path.to_owned(), |id| format!("{path}#{id}"))))
    }

    /// Completes the plan, checks it by its own dry run, writes it and says what it promises. `area` is that of a flight.
    fn finish(&self, mut plan: Document, area: Option<&Area>) -> Result<()> {
        let Planner { args, console, .. } = *self;
        plan.scene = self.reference()?;
        self.check_ground(&plan)?;
        if let Some(path) = args.out.as_ref().filter(|path| path.exists() && !args.force) {
            return Err(Error::input(format!("{} exists; --force overwrites it", path.display())));
        }
        warn(&plan.warnings, console)?;
        let scene = self.site.as_ref().map(|site| (&site.recipe, &site.loaded));
        let check = check::Check { plan: &plan, area, args, scene, told: &self.told, console };
        let found = check.run()?;
        warn(&found, console)?;
        plan.warnings.extend(found);
        let text = plan.text(self.command);
        let Some(path) = &args.out else { return write_stdout(&text) };
        let mut file = FileWriter::create(path, args.force, Patched::Never)?;
        file.append(text.as_bytes())?;
        file.finish()?;
        for comment in &plan.comments {
            console.say(comment);
        }
        console.say(format!("{}; fly it with: vlscan run {0} -o points.laz", path.display()));
        Ok(())
    }
}

fn reading(args: &CommonPlanArgs) -> ReadOptions {
    ReadOptions { assets: args.assets.clone(), ..ReadOptions::default() }
}

/// The full reference of an id in the catalogue; other names as they are.
fn in_catalogue<'n>(name: &str, references: impl Iterator<Item = &'n String>) -> String {
    let is_named = |reference: &&String| reference.split_once('#').is_some_and(|(_, id)| id == name);
    let mut references = references;
    references.find(is_named).cloned().unwrap_or_else(|| name.to_owned())
}

fn warn(texts: &[String], console: &Console) -> Result<()> {
    let mut warnings = Diagnostics::default();
    for text in texts {
        warnings.warn(None, text.clone());
    }
    console.warnings(&warnings)
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
