//! Several scanners on one platform: the runs of a pipeline with `[[scanner]]` tables, which share a scene.

use super::{Console, interrupt};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::number;
use vlscan_options::{Options, ResolvedRun};
use vlscan_session::output::leave_options_to_others;
use vlscan_session::{LoadedScene, Session, Settings};

/// Reads the survey or pipeline with the options of the command line, and shows the warnings about them.
/// Returns a run for each scanner.
///
/// # Errors
/// As for [`ResolvedRun::resolve_all`]; warnings, if they are errors.
pub fn resolve_all(file: &Path, options: &Options, console: &Console) -> Result<Vec<ResolvedRun>> {
    let (jobs, warnings) = ResolvedRun::resolve_all(file, options)?;
    console.warnings(&warnings)?;
    Ok(jobs)
}

/// [`resolve_all`] for runs that write points. Options that apply to the outputs of some scanners only are
/// left out for the others.
///
/// # Errors
/// As for [`resolve_all`].
pub fn resolve_outputs(file: &Path, options: &Options, console: &Console) -> Result<Vec<ResolvedRun>> {
    let mut jobs = resolve_all(file, options, console)?;
    leave_options_to_others(&mut jobs.iter_mut().map(|job| &mut job.output).collect::<Vec<_>>());
    Ok(jobs)
}

/// The file of one of several scanners, `NAME_SCANNER.EXT`, for an option that names the file `NAME.EXT`.
pub fn file_of(path: &Path, scanner: &str) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_os_string();
    name.push("_");
    name.push(scanner);
    if let Some(ending) = path.extension() {
        name.push(".");
        name.push(ending);
    }
    path.with_file_name(name)
}

/// The scene that the runs of several scanners share.
pub struct SharedScene {
    scene: Option<LoadedScene>,
    has_several: bool,
}

impl SharedScene {
    /// The scene of these runs, not loaded yet.
    pub fn of(jobs: &[ResolvedRun]) -> SharedScene {
        SharedScene { scene: None, has_several: jobs.len() > 1 }
    }

    /// True if several runs share the scene.
    pub fn has_several(&self) -> bool {
        self.has_several
    }

    /// Opens a session over the scene of the first run, or with `load` if that scene does not suit the
    /// settings: scanners of other wavelengths see other reflectances.
    ///
    /// # Errors
    /// The errors of [`Session::new`] and of `load`.
    pub fn open(
        &mut self,
        settings: Settings,
        console: &Console,
        load: impl FnOnce(Settings, &Console) -> Result<Session>,
    ) -> Result<Session> {
        let shared = self.scene.as_ref().filter(|scene| scene.suits(&settings)).cloned();
        let session = match shared {
            Some(scene) => Session::new(settings, scene, console.observer())?,
            None => load(settings, console)?,
        };
        // A single run frees its scene between epochs, which nothing else may hold then.
        if self.has_several && self.scene.is_none() {
            self.scene = session.loaded();
        }
        Ok(session)
    }
}

/// Difference of the times at which a leg begins for two scanners from which on there is a warning, s.
const MAX_APART_S: f64 = 1e-3;

/// Times of the flight of one of several scanners.
pub struct ScannerTimes {
    scanner: String,
    /// Time between updates of the scene, s.
    step: Option<f64>,
    /// Number of each leg and the time at which it begins, s.
    starts: Vec<(u32, f64)>,
}

impl ScannerTimes {
    /// The times of the flight of a scanner.
    ///
    /// # Errors
    /// The errors of [`Session::leg_starts`].
    pub fn of(scanner: &str, session: &Session) -> Result<ScannerTimes> {
        let (step, starts) = (session.scene_step_s(), session.leg_starts(&interrupt::STOP)?);
        Ok(ScannerTimes { scanner: scanner.to_owned(), step, starts })
    }
}

/// Warnings if the moving parts of the scene move, or legs begin, at different times for the scanners of the
/// pipeline `file`.
pub fn different_times(file: &Path, times: &[ScannerTimes]) -> Diagnostics {
    let mut found = different_steps(file, times);
    found.extend(different_starts(file, times));
    found
}

/// A warning if the moving parts of a scene move at different times for the scanners.
fn different_steps(file: &Path, times: &[ScannerTimes]) -> Diagnostics {
    let mut found = Diagnostics::default();
    let mut moving = times.iter().filter_map(|of| Some((&of.scanner, of.step?)));
    let Some((first, step)) = moving.next() else { return found };
    if let Some((other, other_step)) = moving.find(|(_, other)| (other - step).abs() > 1e-9 * step) {
        let [step, other_step] = [step, other_step].map(|step| number(step * 1e3));
        let message = format!(
            "the scene moves every {step} ms for the scanner `{first}` and every {other_step} ms for \
             `{other}`, which see its parts at different places"
        );
        found
            .warn(Some(Place::of_file(file)), message)
            .help("give the scene a `dynTimeStep` that is a whole number of pulse periods of each scanner");
    }
    found
}

/// A warning if a leg begins at different times for the scanners.
fn different_starts(file: &Path, times: &[ScannerTimes]) -> Diagnostics {
    let mut found = Diagnostics::default();
    let mut flights = times.iter().filter(|of| !of.starts.is_empty());
    let Some(first) = flights.next() else { return found };
    let apart = flights.find_map(|other| {
        let mut legs = first.starts.iter().zip(&other.starts);
        let (leg, other_leg) = legs.find(|(leg, other_leg)| (leg.1 - other_leg.1).abs() > MAX_APART_S)?;
        Some((leg.0, leg.1, other_leg.1, &other.scanner))
    });
    if let Some((leg, start, other_start, other)) = apart {
        let ([start, other_start], first) = ([start, other_start].map(number), &first.scanner);
        let message = format!(
            "leg {leg} begins after {start} s for the scanner `{first}` and after {other_start} s for \
             `{other}`, which are at different places from then on"
        );
        found.warn(Some(Place::of_file(file)), message).help(
            "a leg lasts until the platform arrives and the head is at `head_stop_deg`, in whole pulse \
             periods: leave `head_stop_deg` out, choose one that the head reaches before the platform \
             arrives, or fly a `[trajectory]`, whose times hold for all scanners",
        );
    }
    found
}

/// Files and folders that the scanners of a platform fill, each with the name of its scanner.
#[derive(Default)]
pub struct OutputPlaces(BTreeMap<PathBuf, String>);

impl OutputPlaces {
    /// Adds the places of a scanner.
    ///
    /// # Errors
    /// A place of an earlier scanner.
    pub fn add(&mut self, scanner: &str, places: BTreeSet<PathBuf>) -> Result<()> {
        for place in places {
            let shown = match place.as_os_str() == "-" {
                true => "standard output".to_owned(),
                false => place.display().to_string(),
            };
            if let Some(other) = self.0.insert(place, scanner.to_owned()) {
                return Err(Error::input_with_help(
                    format!("the scanners `{other}` and `{scanner}` would both write to {shown}"),
                    "give each [[scanner]] an `output` of its own",
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The warnings about scanners with these steps and times at which their legs begin.
    fn warning(flights: [(Option<f64>, &[f64]); 3]) -> String {
        let times =
            ["front", "rear", "top"].into_iter().zip(flights).map(|(name, (step, starts))| ScannerTimes {
                scanner: name.to_owned(),
                step,
                starts: (0..).zip(starts.iter().copied()).collect(),
            });
        different_times(Path::new("rig.toml"), &times.collect::<Vec<_>>()).text()
    }

    #[test]
    fn scanners_that_see_a_scene_at_different_steps_are_named() {
        const NO_LEGS: &[f64] = &[];
        let steps = |steps: [Option<f64>; 3]| warning(steps.map(|step| (step, NO_LEGS)));
        assert_eq!(steps([None; 3]), "");
        assert_eq!(steps([Some(0.02), Some(0.02 * (1.0 + 1e-12)), Some(0.02)]), "");
        let found = steps([Some(0.02), Some(0.02), Some(0.019995)]);
        let expected = "every 20 ms for the scanner `front` and every 19.995 ms for `top`";
        assert!(found.contains(expected) && found.contains("dynTimeStep"), "{found}");
    }

    #[test]
    fn scanners_whose_legs_begin_at_different_times_are_named() {
        let starts = |starts: [&[f64]; 3]| warning(starts.map(|starts| (None, starts)));
        assert_eq!(starts([&[0.0, 2.0], &[0.0, 2.0005], &[0.0, 1.9995]]), "");
        assert_eq!(starts([&[], &[0.0, 2.0], &[]]), "");
        let found = starts([&[0.0, 2.0, 3.0], &[0.0, 2.0, 3.0], &[0.0, 2.0, 3.5]]);
        let expected = "leg 2 begins after 3 s for the scanner `front` and after 3.5 s for `top`";
        assert!(found.contains(expected) && found.contains("head_stop_deg"), "{found}");
    }

    #[test]
    fn files_of_scanners_have_their_names_before_the_extension() {
        for (path, expected) in [
            ("a/objects.csv", "a/objects_roof.csv"),
            ("b.c/objects", "b.c/objects_roof"),
            ("c.cog.tif", "c.cog_roof.tif"),
        ] {
            assert_eq!(file_of(Path::new(path), "roof"), Path::new(expected));
        }
    }

    #[test]
    fn two_scanners_cannot_fill_one_place() {
        let places = |names: &[&str]| names.iter().map(PathBuf::from).collect::<BTreeSet<_>>();
        let mut all = OutputPlaces::default();
        all.add("front", places(&["a.laz", "-"])).unwrap();
        all.add("rear", places(&["b.laz"])).unwrap();
        let error = all.add("top", places(&["c.laz", "b.laz"])).unwrap_err().to_string();
        assert_eq!(error, "the scanners `rear` and `top` would both write to b.laz");
        let error = all.add("down", places(&["-"])).unwrap_err().to_string();
        assert_eq!(error, "the scanners `front` and `down` would both write to standard output");
    }
}
