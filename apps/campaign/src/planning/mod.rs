//! Plans surveys: reads the inputs of a plan, makes it, and checks it by a dry run.
//!
//! | file | what it does |
//! |---|---|
//! | `check` | the checks of a plan and its files before they are written |
//! | `guarantee` | densities that a share of the cells of an area has |

mod check;
mod guarantee;

use crate::named_scene::NamedScene;
use guarantee::Guarantee;
use std::path::{Path, PathBuf};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::FileGroup;
use vlscan_base::quantity::number;
use vlscan_base::{Observer, machine};
use vlscan_crs::{differ, name as name_of_system};
use vlscan_geom::DVec3;
use vlscan_lidar::pulse::PhysicsProfile;
use vlscan_options::{Crs, holds_survey};
use vlscan_scene::{Fallback, GroundModel, LoadOptions};
use vlscan_session::{CoverageMap, LoadedScene};
use vlscan_survey::{
    CATALOGUE, Device, Platform, ReadOptions, SceneRecipe, catalogue, find_platform, find_scanner,
};
use vlscan_tools::plan::{
    self, AirborneOptions, AirborneRequest, Area, AreaSource, Carrier, LineFormat, MobileRequest, PlanError,
    PlanGround, PlanRequest, PlanSetup, PlannedSurvey, SwathModel, TerrestrialRequest,
};
use vlscan_trace::{BuildOptions, Builder};
use vlscan_warehouse::Stop;

/// Height below which a flight is a drone's if no platform is named, m.
const MAX_DRONE_HEIGHT: f64 = 150.0;

/// File of the catalogue's airborne scanners.
const AIRBORNE_SCANNERS: &str = "scanners_als.xml";

/// Plans a survey, checks it, and writes it to the file that the request names, if it names one. `command` is
/// what made the plan, in its first line.
///
/// ```
/// use vlscan_base::Observer;
/// use vlscan_campaign::plan_survey;
/// use vlscan_tools::plan::{AirborneOptions, AirborneRequest, Area, AreaSource, PlanRequest, PlanSetup};
/// use vlscan_warehouse::Stop;
///
/// # fn main() -> vlscan_base::error::Result<()> {
/// let request = PlanRequest::Airborne(Box::new(AirborneRequest {
///     area: Some(AreaSource::Given(Area::rectangle([0.0, 0.0], [400.0, 300.0]).unwrap())),
///     buffer: None,
///     follow_line: false,
///     common: PlanSetup { scanner: "riegl_vux-1uav".into(), ..PlanSetup::default() },
///     options: AirborneOptions { height: 60.0, density: Some(50.0), ..AirborneOptions::default() },
/// }));
/// let plan = plan_survey(&request, "my program", &Observer::default(), &Stop::new())?;
/// assert!(plan.length() > 400.0 && plan.text("my program").contains("riegl_vux-1uav"));
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// [`Error::Input`] for requests that contradict themselves, exceed the instrument, or result in surveys that
/// miss their specification or measure nothing; [`Error::Io`]; [`Error::Interrupted`].
pub fn plan_survey(
    request: &PlanRequest,
    command: &str,
    observer: &Observer,
    stop: &Stop,
) -> Result<PlannedSurvey> {
    check::check_files(request.common())?;
    let planner = Planner::new(request, observer)?;
    let (plan, area, reported) = match request {
        PlanRequest::Airborne(request) => planner.airborne(request, stop),
        PlanRequest::Terrestrial(request) => planner.terrestrial(request),
        PlanRequest::Mobile(request) => planner.mobile(request),
    }?;
    planner.finish(plan, area.as_ref(), &reported, command, stop)
}

/// Checks the instrument and platform of a request, which do not depend on the scene.
///
/// # Errors
/// [`Error::Input`] for instruments and platforms that are not found, and what the instrument cannot do;
/// [`Error::Io`].
pub(crate) fn check_instrument(request: &PlanRequest) -> Result<()> {
    let setup = request.common();
    let (mut scanner, _) = find_scanner(&scanner_of(request)?, &reading(setup))?;
    scanner.devices.iter_mut().for_each(Device::take_stated_figures);
    if let Some(platform) = &setup.platform {
        find_platform(platform, &reading(setup))?;
    }
    let instrument = SwathModel::new(setup.scanner.clone(), &scanner, setup.pulse_rate);
    match request {
        PlanRequest::Terrestrial(request) => plan::check_terrestrial(&instrument, &request.options),
        PlanRequest::Airborne(_) | PlanRequest::Mobile(_) => Ok(()),
    }
}

/// Inputs of plans of all kinds.
struct Planner<'a> {
    setup: &'a PlanSetup,
    observer: &'a Observer,
    instrument: SwathModel,
    /// Site of the survey, if there is a scene.
    site: Option<Site>,
    /// The system that the request names, as WKT and as a pipeline file names it.
    crs: Option<(String, String)>,
    /// The warnings about the scanner, which have been shown.
    reported: Diagnostics,
}

/// A loaded scene.
struct Site {
    recipe: SceneRecipe,
    loaded: LoadedScene,
    ground: GroundModel,
}

impl Site {
    /// Loads the scene of a request as surveys with this instrument do.
    fn load(name: &str, setup: &PlanSetup, instrument: &SwathModel, observer: &Observer) -> Result<Site> {
        let (recipe, _, warnings) = NamedScene { name, assets: &setup.assets }.recipe()?;
        observer.warnings(warnings)?;
        let options = LoadOptions {
            rules: PhysicsProfile::Refined.corrections(),
            max_memory: machine::memory(),
            ..LoadOptions::default()
        }
        .with_wavelengths_of(instrument.scanner());
        let trees = BuildOptions::of(Builder::default());
        let notify = observer.callback();
        let loaded = LoadedScene::load(&recipe, &options, &trees, observer.is_strict(), &notify)?;
        let ground = loaded.ground(Fallback::Highest, &notify)?;
        Ok(Site { recipe, loaded, ground })
    }
}

/// A line, and the distance to both sides of it that is covered, m.
type Corridor = (Vec<[f64; 2]>, f64);

/// A plan, the area of a flight, and the warnings that have been shown.
type Planned = (PlannedSurvey, Option<Area>, Diagnostics);

impl Planner<'_> {
    fn new<'a>(request: &'a PlanRequest, observer: &'a Observer) -> Result<Planner<'a>> {
        let (setup, name) = (request.common(), scanner_of(request)?);
        let (mut scanner, reported) = find_scanner(&name, &reading(setup))?;
        // The plan is a pipeline.
        scanner.devices.iter_mut().for_each(Device::take_stated_figures);
        observer.warnings(reported.clone())?;
        let (known, _) = catalogue()?;
        let reference = in_catalogue(&name, known.scanners.iter().map(|(name, _)| name));
        let instrument = SwathModel::new(reference, &scanner, setup.pulse_rate);
        let scene = setup.scene.as_deref();
        let site = scene.map(|name| Site::load(name, setup, &instrument, observer)).transpose()?;
        let crs = setup.crs.as_deref().map(named_system).transpose()?;
        let of_scene = site.as_ref().and_then(|site| site.ground.crs());
        if let (Some((wkt, name)), Some(of_scene)) = (&crs, of_scene)
            && differ(wkt, of_scene)
        {
            let of_scene = name_of_system(of_scene);
            return Err(Error::input(format!(
                "--crs is {name}, but the files of the scene are in {of_scene}"
            )));
        }
        Ok(Planner { setup, observer, instrument, site, crs, reported })
    }

    fn airborne(&self, request: &AirborneRequest, stop: &Stop) -> Result<Planned> {
        let options = &request.options;
        options.check()?;
        let (area, line) = self.flight_area(request)?;
        self.check_area(&area)?;
        let default = if options.height < MAX_DRONE_HEIGHT { "copter_linearpath" } else { "sr22" };
        let (reference, platform, reported) = self.platform(default)?;
        let level = self.setup.level();
        let model = self.site.as_ref().map(|site| &site.ground);
        let height = |x: f64, y: f64| model.map_or(Some(level), |ground| ground.height(x, y));
        let ground = PlanGround { heights: &height, level };
        let carrier = self.carrier(&platform);
        let plan = |options: &AirborneOptions| -> Result<PlannedSurvey> {
            let instrument = &self.instrument;
            let plan = match &line {
                None => plan::plan_airborne(&area, instrument, &carrier, options, &ground),
                Some((line, buffer)) => {
                    plan::plan_corridor(line, *buffer, &area, instrument, &carrier, options, &ground)
                }
            };
            Ok(PlannedSurvey { platform: reference.clone(), ..plan? })
        };
        let survey = match Guarantee::of(options) {
            None => plan(options)?,
            Some(guarantee) => {
                let of_density = |density| plan(&guarantee::mean(options, density));
                let measure =
                    |survey: &PlannedSurvey| self.coverage(survey, &area, &reported, guarantee.side, stop);
                guarantee.reach(&area, &of_density, &measure)?
            }
        };
        Ok((survey, Some(area), reported))
    }

    /// The area of a flight, and the corridor whose line its lines follow, if they do.
    fn flight_area(&self, request: &AirborneRequest) -> Result<(Area, Option<Corridor>)> {
        if !request.follow_line {
            return Ok((self.area(request.area.as_ref(), request.buffer)?, None));
        }
        if request.options.heading.is_some() || request.options.cross_lines > 0 {
            return Err(Error::input("--follow-line: --heading and --cross-lines are for straight lines"));
        }
        match (&request.area, request.buffer) {
            (Some(AreaSource::Named(name)), Some(buffer)) => {
                let (line, area, warnings) = plan::read_corridor(name, self.crs(), buffer)?;
                self.observer.warnings(warnings)?;
                Ok((area, Some((line, buffer))))
            }
            _ => Err(Error::input("--follow-line: give the line with --area, and --buffer")),
        }
    }

    /// Coverage of a flight in cells of `side` m. Warnings about the flight are given when the plan is
    /// checked.
    fn coverage(
        &self,
        plan: &PlannedSurvey,
        area: &Area,
        reported: &Diagnostics,
        side: f64,
        stop: &Stop,
    ) -> Result<CoverageMap> {
        let quiet = Observer::default();
        let (setup, observer) = (self.setup, &quiet);
        let scene = self.site.as_ref().map(|site| (&site.recipe, &site.loaded));
        check::Check { plan, area: Some(area), setup, scene, reported, observer, stop }.coverage(side)
    }

    fn terrestrial(&self, request: &TerrestrialRequest) -> Result<Planned> {
        let options = &request.options;
        let area = match options.around.is_some() || !options.at.is_empty() {
            true => None,
            false => Some(self.area(request.area.as_ref(), None)?),
        };
        let on_ground = self.is_ground_used()?;
        if let Some(area) = area.as_ref().filter(|_| on_ground) {
            self.check_area(area)?;
        }
        let (area, level) = (area.as_ref(), self.setup.level());
        let plan = plan::plan_terrestrial(area, &self.instrument, options, level, on_ground)?;
        let (platform, _, reported) = self.platform("tripod")?;
        Ok((PlannedSurvey { platform, ..plan }, None, reported))
    }

    fn mobile(&self, request: &MobileRequest) -> Result<Planned> {
        let (line, warnings) = plan::read_line(&request.along, self.crs())?;
        self.observer.warnings(warnings)?;
        let on_ground = self.is_ground_used()?;
        let (reference, platform, reported) = self.platform("vehicle_linearpath")?;
        let carrier = self.carrier(&platform);
        let (options, level) = (&request.options, self.setup.level());
        let plan = plan::plan_mobile(&line, &self.instrument, &carrier, options, level, on_ground)?;
        Ok((PlannedSurvey { platform: reference, ..plan }, None, reported))
    }

    /// How the platform carries the scanner. A plan turns the mount of a default platform only.
    fn carrier(&self, platform: &Platform) -> Carrier {
        Carrier { mount: platform.mount, may_turn: self.setup.platform.is_none() }
    }

    /// The platform of the request, or the one that suits, with its reference, and all warnings that have
    /// been shown.
    fn platform(&self, suiting: &str) -> Result<(String, Platform, Diagnostics)> {
        // The default is that of the catalogue if the scanner is.
        let prefix = if self.setup.scanner.starts_with(CATALOGUE) { CATALOGUE } else { "" };
        let default = format!("{prefix}{suiting}");
        let name = self.setup.platform.as_deref().unwrap_or(&default);
        let (platform, warnings) = find_platform(name, &reading(self.setup))?;
        self.observer.warnings(warnings.clone())?;
        let mut reported = self.reported.clone();
        reported.extend(warnings);
        let (known, _) = catalogue()?;
        Ok((in_catalogue(name, known.platforms.iter().map(|(name, _)| name)), platform, reported))
    }

    /// The system of the plan's coordinates as WKT: that of the scene, if its files name one, or of the
    /// request.
    fn crs(&self) -> Option<&str> {
        let of_scene = self.site.as_ref().and_then(|site| site.ground.crs());
        of_scene.or(self.crs.as_ref().map(|(wkt, _)| wkt.as_str()))
    }

    /// True if waypoints are set on the scene's ground. They are not where the request has its height.
    fn is_ground_used(&self) -> Result<bool> {
        let (Some(site), Some(name)) = (&self.site, &self.setup.scene) else { return Ok(false) };
        if !site.ground.has_ground() && self.setup.ground.is_none() {
            return Err(Error::input_with_help(
                format!("--scene {name}: none of its materials is ground"),
                "give the terrain's material `helios_isGround true` (in its MTL file or materials.csv; \
                 `vlscan scene stand --terrain` does), or give the height of level ground with --ground",
            ));
        }
        Ok(self.setup.ground.is_none())
    }

    /// Refuses waypoints that are to stand on ground where there is none.
    fn check_ground(&self, plan: &PlannedSurvey) -> Result<()> {
        let Some(site) = &self.site else { return Ok(()) };
        let is_missing = |p: &DVec3| !site.ground.is_under(p.x, p.y);
        let on_ground = plan.waypoints.iter().filter(|w| w.on_ground).map(|w| w.position);
        let missing: Vec<DVec3> = on_ground.filter(is_missing).collect();
        let Some(first) = missing.first() else { return Ok(()) };
        Err(Error::input_with_help(
            format!(
                "the scene has no ground below {} of {} positions, the first at x {:.3} y {:.3}",
                missing.len(),
                plan.waypoints.len(),
                first.x,
                first.y
            ),
            "keep --area, --around or --along within the terrain whose material has `helios_isGround true`, \
             or give the height of level ground with --ground",
        ))
    }

    /// The area of the request, or the box of the scene's ground.
    fn area(&self, source: Option<&AreaSource>, buffer: Option<f64>) -> Result<Area> {
        if buffer.is_some() && !matches!(source, Some(AreaSource::Named(_))) {
            return Err(PlanError::Without("--buffer", "a line as --area").into());
        }
        match (source, &self.site) {
            (Some(AreaSource::Named(name)), _) => {
                let (area, warnings) = plan::read_area(name, self.crs(), buffer)?;
                self.observer.warnings(warnings)?;
                Ok(area)
            }
            (Some(AreaSource::Given(area)), _) => Ok(area.clone()),
            (None, Some(site)) => {
                let [low, high] = site.ground.extent();
                Area::rectangle(low, high).map_err(|e| Error::input(e.to_string()))
            }
            (None, None) => Err(Error::input("give --area, or --scene, whose ground is then the area")),
        }
    }

    /// Refuses an area outside of the scene.
    fn check_area(&self, area: &Area) -> Result<()> {
        let Some(site) = &self.site else { return Ok(()) };
        let scene = extent_of(&site.loaded);
        let (low, high) = area.bounds();
        if [0, 1].into_iter().all(|axis| high[axis] >= scene[0][axis] && low[axis] <= scene[1][axis]) {
            return Ok(());
        }
        let message =
            format!("the area, {}, lies outside of the scene, {}", shown([low, high]), shown(scene));
        let is_like_degrees = area.corners().iter().all(|[x, y]| x.abs() <= 180.0 && y.abs() <= 90.0);
        let help = match is_like_degrees {
            true => {
                "give the area in the scene's coordinates, in metres; if its coordinates are longitude and \
                 latitude, write SRID=4326; before well-known text, or give it as KML"
            }
            false => "give the area in the scene's coordinates; `vlscan scene info` shows where a scene is",
        };
        Err(Error::input_with_help(message, help))
    }

    /// The scene as a plan in the file of the request names it: relative references are relative to that
    /// file.
    fn reference(&self) -> Result<Option<String>> {
        let (Some(site), Some(name)) = (&self.site, &self.setup.scene) else { return Ok(None) };
        let (path, id) = match (holds_survey(Path::new(name)), name.split_once('#')) {
            (true, _) => (site.recipe.path.clone(), Some(site.recipe.id.as_str())),
            (false, Some((path, id))) => (PathBuf::from(path), Some(id)),
            (false, None) => (PathBuf::from(name), None),
        };
        let folder = self.setup.file().and_then(Path::parent);
        let is_local = folder.is_none_or(|folder| folder.as_os_str().is_empty());
        let path = match is_local || !path.exists() {
            true => path,
            false => std::path::absolute(&path).map_err(|e| Error::open(&path, e))?,
        };
        let path = path.to_str().ok_or_else(|| {
            Error::input(format!("{}: its name is not UTF-8, which a pipeline file needs", path.display()))
        })?;
        Ok(Some(id.map_or(path.to_owned(), |id| format!("{path}#{id}"))))
    }

    /// Completes the plan, checks it by a dry run and writes it. `area` is that of a flight, `reported` are
    /// the warnings that have been shown.
    fn finish(
        &self,
        mut plan: PlannedSurvey,
        area: Option<&Area>,
        reported: &Diagnostics,
        command: &str,
        stop: &Stop,
    ) -> Result<PlannedSurvey> {
        let Planner { setup, observer, .. } = *self;
        plan.scene = self.reference()?;
        plan.crs = self.crs.as_ref().map(|(_, name)| name.clone());
        self.check_ground(&plan)?;
        let height = |x: f64, y: f64| self.site.as_ref().and_then(|site| site.ground.height(x, y));
        plan.lines = plan::lines_of(&plan.waypoints, &height);
        plan.wkt = self.crs().map(str::to_owned);
        let lines = self.lines(&plan)?;
        warn(&plan.warnings, observer)?;
        let scene = self.site.as_ref().map(|site| (&site.recipe, &site.loaded));
        let found = check::Check { plan: &plan, area, setup, scene, reported, observer, stop }.run()?;
        warn(&found, observer)?;
        plan.warnings.extend(found);
        let mut group = FileGroup::default();
        if let Some(path) = setup.file() {
            group.write(path, setup.overwrite, plan.text(command).as_bytes())?;
        }
        for (path, text) in lines {
            group.write(path, setup.overwrite, text.as_bytes())?;
        }
        group.commit()?;
        Ok(plan)
    }

    /// The files of lines with their texts.
    fn lines(&self, plan: &PlannedSurvey) -> Result<Vec<(&Path, String)>> {
        let setup = self.setup;
        let carriers = [plan.platform.as_str(), plan.scanner.as_str()];
        let text = |path: &Path| -> Result<String> {
            plan::plan_lines(&plan.lines, carriers, LineFormat::of(path)?, self.crs())
        };
        setup.lines.iter().map(|path| Ok((path.as_path(), text(path)?))).collect()
    }
}

/// The corners of the box of a scene, world coordinates, m.
fn extent_of(loaded: &LoadedScene) -> [[f64; 2]; 2] {
    let scene = loaded.scene();
    [scene.bounds.min, scene.bounds.max].map(|corner| {
        let corner = scene.to_world(corner);
        [corner.x, corner.y]
    })
}

/// A box, for messages.
fn shown([low, high]: [[f64; 2]; 2]) -> String {
    let axis = |i: usize| format!("{} to {} m", number(low[i]), number(high[i]));
    format!("x {}, y {}", axis(0), axis(1))
}

/// A system as typed: its WKT, and how a pipeline file names it.
fn named_system(text: &str) -> Result<(String, String)> {
    let crs: Crs = text.parse().map_err(|problem| Error::input(format!("--crs: {problem}")))?;
    let wkt = crs.wkt()?;
    let name = match crs {
        Crs::Epsg(code) => format!("EPSG:{code}"),
        Crs::Wkt(_) | Crs::File(_) => wkt.clone(),
    };
    Ok((wkt, name))
}

fn reading(setup: &PlanSetup) -> ReadOptions {
    ReadOptions { assets: setup.assets.clone(), ..ReadOptions::default() }
}

/// The name of the scanner of a request. An id that both files of the catalogue have is that of the airborne
/// scanners for a flight, and that of the others on the ground.
fn scanner_of(request: &PlanRequest) -> Result<String> {
    let name = &request.common().scanner;
    let (prefix, own) = name.split_at(if name.starts_with(CATALOGUE) { CATALOGUE.len() } else { 0 });
    let (known, _) = catalogue()?;
    let is_named = |reference: &&String| reference.split_once('#').is_some_and(|(_, id)| id == own);
    let alike: Vec<&String> =
        known.scanners.iter().map(|(reference, _)| reference).filter(is_named).collect();
    let is_airborne = matches!(request, PlanRequest::Airborne(_));
    let fitting = alike.iter().find(|reference| reference.contains(AIRBORNE_SCANNERS) == is_airborne);
    Ok(match fitting.filter(|_| alike.len() > 1) {
        Some(reference) => format!("{prefix}{reference}"),
        None => name.clone(),
    })
}

/// The full reference of an id in the catalogue; other names unchanged. A prefix `catalogue:` is kept.
fn in_catalogue<'n>(name: &str, mut references: impl Iterator<Item = &'n String>) -> String {
    let (prefix, own) = name.split_at(if name.starts_with(CATALOGUE) { CATALOGUE.len() } else { 0 });
    let is_named = |reference: &&String| reference.split_once('#').is_some_and(|(_, id)| id == own);
    references.find(is_named).map_or_else(|| name.to_owned(), |reference| format!("{prefix}{reference}"))
}

fn warn(texts: &[String], observer: &Observer) -> Result<()> {
    let mut warnings = Diagnostics::default();
    for text in texts {
        warnings.warn(None, text.clone());
    }
    observer.warnings(warnings)
}
