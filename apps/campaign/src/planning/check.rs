//! The checks of a plan before it is written: its files are writable, its own survey is read as `vlscan run`
//! reads it, a sample of a flight's pulses is flown over flat ground and compared with the plan's promises,
//! and a dry run tells whether the instrument measures what surrounds it.

use super::{extent_of, shown};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use vlscan_base::Observer;
use vlscan_base::diag::{Diagnostics, Notice};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{identity, refuse_unwritable};
use vlscan_base::quantity::number;
use vlscan_geom::DVec3;
use vlscan_lidar::pulse::PhysicsProfile;
use vlscan_options::outputs::check_content;
use vlscan_options::{InputOptions, Options, ProfileOptions, ResolvedRun};
use vlscan_session::output::OutputRequest;
use vlscan_session::{CoverageMap, DryRunReport, LoadedScene, Progress, RunContext, Session, Settings};
use vlscan_survey::{MaterialDefinition, Mesh, PlatformKind, SceneRecipe};
use vlscan_tools::plan::{Area, LineFormat, PlanSetup, PlannedSurvey, Promise, fly_sample};
use vlscan_warehouse::Stop;

/// Share of the pulses that meet flat ground within range and return, below which the plan of a flight is
/// refused.
const MIN_FLAT_SHARE: f64 = 0.95;
/// Share of the pulses that point at the scene and return, below which a plan warns.
const MIN_SCENE_SHARE: f64 = 0.5;
/// Share of the pulses that meet something nearer than the instrument measures, above which a drive or
/// positions are refused.
const MAX_NEAR_SHARE: f64 = 0.9;
/// Space around the waypoints that flat ground has, m.
const MARGIN: f64 = 1000.0;

/// Checks that the files of a plan can be written.
///
/// # Errors
/// [`Error::Input`] for files that exist, two of one name, missing folders, names of point files, and lines
/// in no known format.
pub fn check_files(setup: &PlanSetup) -> Result<()> {
    let mut all: Vec<&Path> = setup.file().into_iter().collect();
    all.iter().try_for_each(|path| check_content("-o", path, "TOML"))?;
    for path in &setup.lines {
        LineFormat::of(path)?;
        if all.iter().any(|other| identity(other) == identity(path)) {
            return Err(Error::input(format!("{}: two outputs have the same name", path.display())));
        }
        all.push(path);
    }
    all.iter().try_for_each(|path| refuse_unwritable(path, setup.overwrite))
}

/// A plan and what its check needs.
pub struct Check<'c> {
    pub plan: &'c PlannedSurvey,
    /// The area of a flight.
    pub area: Option<&'c Area>,
    pub setup: &'c PlanSetup,
    /// The scene, if there is one.
    pub scene: Option<(&'c SceneRecipe, &'c LoadedScene)>,
    /// Warnings that have been shown.
    pub reported: &'c Diagnostics,
    pub observer: &'c Observer,
    pub stop: &'c Stop,
}

/// Surroundings of a drive or of positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Around {
    FlatGround,
    Scene,
}

impl Check<'_> {
    /// Checks the plan. Returns remarks for the user.
    ///
    /// # Errors
    /// [`Error::Input`] for plans that miss their specification or measure nothing, and those of a dry run.
    pub fn run(&self) -> Result<Vec<String>> {
        let settings = self.settings()?;
        let mut warnings = Vec::new();
        if let (Some(area), Some(promise)) = (self.area, self.plan.promise) {
            let mut flat = over_flat_ground(settings.clone())?;
            match flat.survey().platform.kind {
                PlatformKind::LinearPath => self.check_flight(&mut flat, area, &promise)?,
                _ => {
                    // What cannot be flown is refused here.
                    flat.plan_flight()?;
                    warnings.push(format!(
                        "{} turns and brakes; density and strips are computed for straight flight at \
                         constant speed",
                        self.plan.platform
                    ));
                }
            }
            if let Some((recipe, loaded)) = self.scene {
                warnings.extend(self.check_below(&mut self.over_scene(settings, recipe, loaded)?)?);
            }
            return Ok(warnings);
        }
        let (mut session, around) = match self.scene {
            Some((recipe, loaded)) => (self.over_scene(settings, recipe, loaded)?, Around::Scene),
            None => (over_flat_ground(settings)?, Around::FlatGround),
        };
        warnings.extend(self.check_around(&mut session, around)?);
        Ok(warnings)
    }

    /// Coverage of the flight over the scene or, without one, over flat ground, in cells of `side` m.
    ///
    /// # Errors
    /// As for [`Session::coverage`].
    pub fn coverage(&self, side: f64) -> Result<CoverageMap> {
        let settings = self.settings()?;
        let mut session = match self.scene {
            Some((recipe, loaded)) => self.over_scene(settings, recipe, loaded)?,
            None => over_flat_ground(settings)?,
        };
        session.coverage(side, RunContext::new(&Progress::default(), self.stop))
    }

    /// The plan as `vlscan run` reads it, over flat ground.
    fn settings(&self) -> Result<Settings> {
        let name = self.setup.file().map_or_else(|| PathBuf::from("plan.toml"), Path::to_path_buf);
        let input = InputOptions { assets: self.setup.assets.clone(), ..InputOptions::default() };
        let profile = ProfileOptions { profile: Some(PhysicsProfile::Refined), ..ProfileOptions::default() };
        let options =
            Options { input, profile, scene: Some(Arc::new(self.flat_ground()?)), ..Options::default() };
        let (job, warnings) = ResolvedRun::of_text(&name, self.plan.text("vlscan plan"), &options)?;
        self.observer.warnings(warnings.without(self.reported))?;
        Ok(job.settings)
    }

    fn over_scene(
        &self,
        mut settings: Settings,
        recipe: &SceneRecipe,
        loaded: &LoadedScene,
    ) -> Result<Session> {
        settings.survey.scene = recipe.clone();
        settings.strict = self.observer.is_strict();
        let observer = self.observer.clone();
        Session::new(settings, loaded.clone(), move |notice| {
            if matches!(notice, Notice::Warnings(_)) {
                observer.notify(notice);
            }
        })
    }

    /// Flies a sample over flat ground.
    fn check_flight(&self, flat: &mut Session, area: &Area, promise: &Promise) -> Result<()> {
        let flight = flat.plan_flight()?;
        let flown = fly_sample(&flight, self.plan, area, flat.scene().shift)?;
        flown.check(promise)?;
        // Lines that follow the ground are at no one height above a plane; the dry run over the scene counts.
        let z = self.plan.waypoints.iter().map(|waypoint| waypoint.position.z);
        let (low, high) = z.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), z| (l.min(z), h.max(z)));
        if high - low > 0.01 * promise.height {
            return Ok(());
        }
        // In a short sample, which may point at the sky, the beams are more informative.
        let forecast = self.dry_run(flat)?;
        let share = ((1.0 - forecast.missed.pulses) / flown.measured).max(returned(&forecast));
        if share < MIN_FLAT_SHARE {
            return Err(Error::input(format!(
                "the instrument detects echoes of only {:.0} % of the pulses that meet flat ground {} m \
                 below, if it reflects one half; the other echoes are too weak: fly lower with --height, or \
                 lower the pulse rate with --pulse-rate",
                100.0 * share,
                number(promise.height)
            )));
        }
        Ok(())
    }

    /// Flat ground below a flight, or around positions and drives.
    fn flat_ground(&self) -> Result<SceneRecipe> {
        let height = self.plan.promise.map_or(0.0, |promise| promise.height);
        let places = self.plan.waypoints.iter().map(|waypoint| waypoint.position);
        let far = DVec3::splat(f64::INFINITY);
        let (low, high) = places.fold((far, -far), |(low, high), p| (low.min(p), high.max(p)));
        let (low, high) = (low - MARGIN - 5.0 * height, high + MARGIN + 5.0 * height);
        let z = self.plan.waypoints.iter().map(|waypoint| waypoint.position.z).fold(f64::INFINITY, f64::min)
            - height;
        let corner = |x: f64, y: f64| DVec3::new(x, y, z);
        let corners =
            vec![corner(low.x, low.y), corner(high.x, low.y), corner(high.x, high.y), corner(low.x, high.y)];
        let ground = MaterialDefinition {
            is_ground: true,
            reflectance: Some(0.5),
            ..MaterialDefinition::new("ground")
        };
        let mesh = Mesh::new(corners, vec![[0, 1, 2], [0, 2, 3]], vec![ground], Vec::new())?;
        Ok(SceneRecipe { id: "flat".to_owned(), path: PathBuf::new(), ..mesh.into() })
    }

    /// Measures a sample of a flight over the scene. Returns remarks for the user.
    fn check_below(&self, session: &mut Session) -> Result<Option<String>> {
        let forecast = self.dry_run(session)?;
        if misses_scene(&forecast) {
            self.check_area(&forecast)?;
        }
        check_echoes(&forecast)?;
        let share = returned(&forecast);
        Ok((share < MIN_SCENE_SHARE).then(|| {
            format!(
                "only {:.0} % of the pulses that point at the scene within the instrument's ranges have an \
                 echo: the others pass between its objects, or their echoes are too weak",
                100.0 * share
            )
        }))
    }

    /// Refuses an area that reaches beyond the scene, none of whose sampled pulses meets it.
    fn check_area(&self, forecast: &DryRunReport) -> Result<()> {
        let (Some(area), Some((_, loaded))) = (self.area, self.scene) else { return Ok(()) };
        let (scene, (low, high)) = (extent_of(loaded), area.bounds());
        let size = |[low, high]: [[f64; 2]; 2]| (high[0] - low[0]) * (high[1] - low[1]);
        if forecast.points.value > 0.0
            || [0, 1].into_iter().all(|axis| low[axis] >= scene[0][axis] && high[axis] <= scene[1][axis])
        {
            return Ok(());
        }
        let how = if size([low, high]) > size(scene) { "is larger than" } else { "reaches beyond" };
        let message = format!(
            "the area, {}, {how} the scene, {}: none of {} sampled pulses meets the scene",
            shown([low, high]),
            shown(scene),
            forecast.sampled_pulses
        );
        let help = "draw the area within the scene, or leave out --area to fly over all of the scene";
        Err(Error::input_with_help(message, help))
    }

    /// Measures a sample of a drive or of positions. Returns remarks for the user.
    fn check_around(&self, session: &mut Session, around: Around) -> Result<Option<String>> {
        let forecast = self.dry_run(session)?;
        let (echoes, towards) = (1.0 - forecast.missed.pulses, 1.0 - forecast.missed.beside_scene);
        if forecast.sampled_pulses <= 0.0 || echoes > 0.0 && echoes >= MIN_SCENE_SHARE * towards {
            return Ok(None);
        }
        let scanner = &session.survey().scanner;
        let name = scanner.name.clone();
        let least = scanner.devices.iter().map(|device| device.detector.range_min).fold(0.0, f64::max);
        let near = if least > 0.0 { self.share_too_near(session, echoes)? } else { 0.0 };
        let (least, percent) = (number(least), (100.0 * near).floor());
        let what = if around == Around::Scene { "the scene" } else { "flat ground around it" };
        if near > MAX_NEAR_SHARE {
            return Err(Error::input(format!(
                "{name} measures from {least} m on, and {percent} % of the pulses of this plan that meet \
                 {what} meet it nearer than that; choose a scanner that measures nearer with --scanner \
                 (`vlscan catalogue` lists them with their ranges)"
            )));
        }
        if around == Around::Scene {
            check_echoes(&forecast)?;
        }
        Ok(match around {
            _ if near > MIN_SCENE_SHARE => Some(format!(
                "{name} measures from {least} m on, and {percent} % of the pulses that meet {what} meet it \
                 nearer than that"
            )),
            Around::FlatGround if echoes <= 0.0 => {
                Some(format!("no pulse of this plan has an echo from {what}"))
            }
            Around::FlatGround => None,
            Around::Scene => Some(format!(
                "only {:.0} % of the pulses that point at the scene have an echo: the others pass between \
                 its objects, meet it out of the instrument's ranges, or their echoes are too weak",
                100.0 * echoes / towards
            )),
        })
    }

    /// The share of the pulses that meet something which meet it nearer than the instrument measures.
    /// `echoes` is the share of all pulses that have an echo.
    fn share_too_near(&self, session: &Session, echoes: f64) -> Result<f64> {
        let mut settings = session.settings().clone();
        settings.strict = false;
        for device in &mut settings.survey.scanner.devices {
            device.detector.range_min = 0.0;
        }
        let loaded = session.loaded().ok_or_else(other_scene)?;
        let mut unlimited = Session::new(settings, loaded, |_| ())?;
        let met = 1.0 - self.dry_run(&mut unlimited)?.missed.pulses;
        Ok(if met > 0.0 { (1.0 - echoes / met).max(0.0) } else { 0.0 })
    }

    /// Measures a sample of the survey.
    fn dry_run(&self, session: &mut Session) -> Result<DryRunReport> {
        let progress = Progress::default();
        session.dry_run(&OutputRequest::default(), Instant::now(), RunContext::new(&progress, self.stop))
    }
}

/// A session over the flat ground of the settings, which the user does not know: what it has to say is not
/// shown.
fn over_flat_ground(settings: Settings) -> Result<Session> {
    Session::open(settings, |_| ())
}

fn other_scene() -> Error {
    Error::Internal("the scene of the plan was loaded for another survey".to_owned())
}

/// True if all pulses, but for rounding, miss the scene.
fn misses_scene(forecast: &DryRunReport) -> bool {
    1.0 - forecast.missed.beside_scene < 0.01
}

/// Refuses a survey that measures nothing of the scene.
fn check_echoes(forecast: &DryRunReport) -> Result<()> {
    if forecast.points.value > 0.0 || forecast.sampled_pulses <= 0.0 {
        return Ok(());
    }
    let missed = &forecast.missed;
    let towards = 1.0 - missed.beside_scene;
    let why = if misses_scene(forecast) {
        "all beams miss the scene"
    } else if missed.out_of_range > 0.9 * towards {
        "the scene is outside the instrument's range"
    } else {
        "the echoes are too weak, or the beams pass between the parts of the scene"
    };
    Err(Error::input(format!(
        "the dry run of this plan gives no points: none of {} pulses has an echo; {why}",
        forecast.sampled_pulses
    )))
}

/// The share of the pulses with an echo among those that point at the scene's box within the instrument's
/// ranges.
fn returned(forecast: &DryRunReport) -> f64 {
    let missed = &forecast.missed;
    let within = 1.0 - missed.beside_scene - missed.out_of_range;
    if within > 0.0 { (1.0 - missed.pulses) / within } else { 1.0 }
}
