//! Resuming interrupted runs: a run is divided into shards, and existing shards are not computed again.

use super::merge::merge;
use super::pass::RunContext;
use super::progress::Progress;
use super::resume_folder::{ResumeFolder, RunId, State};
use super::run::Report;
use super::session::Session;
use super::shard::{Divisible, check_outputs, of_another_run};
use crate::output::{OutputContext, OutputRequest, OutputSummary, Target};
use crate::shards::{Borders, OneOf, ShardFile, ShardSet, shard_path};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use vlscan_base::diag::Notice;
use vlscan_base::error::{Error, Result};
use vlscan_lidar::flight::FlightPlan;

/// Maximum number of shards.
const MAX_SHARDS: u64 = 100_000;

/// Division of a run that can be resumed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResumeOptions {
    /// Folder of the shards, removed when the outputs are complete.
    pub folder: PathBuf,
    /// Pulses per shard; a folder with shards keeps their number.
    pub pulses_per_shard: u64,
    /// If set, the folder stays when the outputs are complete, with a mark by which a repeated run recognises
    /// them, until [`ResumeOptions::remove_folder`] removes it.
    pub keeps_mark: bool,
}

impl ResumeOptions {
    /// Shards next to the first output that is a file or a folder: `out.laz.shards`.
    ///
    /// # Errors
    /// [`Error::Input`] of the kind [`NotDivisible`](vlscan_base::diag::ProblemKind::NotDivisible) when all
    /// outputs are streams.
    pub fn next_to(outputs: &OutputRequest, pulses_per_shard: u64) -> Result<ResumeOptions> {
        let path = outputs.sinks.iter().find_map(|(target, _)| path_of(target)).ok_or_else(|| {
            Error::not_divisible(
                "--resume needs an output file or folder, beside which the shards are kept",
                "name one with -o PATH",
            )
        })?;
        let mut name = path.file_name().unwrap_or_default().to_os_string();
        name.push(".shards");
        Ok(ResumeOptions { folder: path.with_file_name(name), pulses_per_shard, keeps_mark: false })
    }

    /// Removes the folder of a run with complete outputs. Returns a note if it is kept because of files that
    /// no run has made.
    ///
    /// # Errors
    /// [`Error::Input`] while another run works in the folder, and for one that no run has made;
    /// [`Error::Io`].
    pub fn remove_folder(&self) -> Result<Option<Notice>> {
        match ResumeFolder::state_of(&self.folder)? {
            Some(state) => remove_shards(ResumeFolder::open(&self.folder, Some(&state))?, &self.folder),
            None => Ok(None),
        }
    }
}

/// Removes the shards of a run that is complete. Returns a note of the other files in their folder.
fn remove_shards(folder: ResumeFolder, path: &Path) -> Result<Option<Notice>> {
    Ok(folder.remove()?.first().map(|other| {
        Notice::Note(format!(
            "{} is kept: it contains files that the run has not made, such as {}",
            path.display(),
            other.display()
        ))
    }))
}

/// A run that can be resumed, and how far an earlier start of it came.
struct Resumption {
    flight: Divisible,
    run: RunId,
    /// State of the folder; `None` if there is no folder.
    known: Option<State>,
    /// True if outputs of this run may exist.
    is_resuming: bool,
}

impl Resumption {
    /// True if all outputs of this run are complete.
    fn is_complete(&self) -> bool {
        self.is_resuming && self.known.as_ref().is_some_and(State::is_complete)
    }
}

impl Session {
    /// [`Session::run`] in shards: those that an earlier run has completed are not computed again. The
    /// outputs are written when all shards are complete, and are those of [`Session::run`], byte for byte.
    ///
    /// # Errors
    /// As for [`Session::run`]; [`Error::Input`] for flights that cannot be divided, and when the shards are
    /// of another run, unless outputs may be replaced.
    pub fn run_resumable(
        &mut self,
        outputs: OutputRequest,
        how: &ResumeOptions,
        control: RunContext<'_>,
    ) -> Result<Report> {
        let path = how.folder.as_path();
        let resumption = self.resumption(&outputs, how, Session::plan_flight)?;
        let is_complete = resumption.is_complete();
        let Resumption { flight, run, known, is_resuming } = resumption;
        // The caller writes companions after the outputs.
        if is_complete && outputs.companions.is_empty() {
            self.notify(Notice::Note("the outputs are already complete".to_owned()));
            self.close(ResumeFolder::open(path, known.as_ref())?, how)?;
            return Ok(Report {
                summary: OutputSummary::default(),
                pulses: 0,
                seconds: 0.0,
                interrupted: false,
                warnings: self.warnings(),
            });
        }
        let request = OutputRequest { is_resuming, ..outputs.clone() };
        // Outputs are merged from the shards, without the scene.
        let context = OutputContext { has_ground: false, ..self.output_context() };
        self.check_output(OutputRequest { epochs: self.epochs(), ..request.clone() }, &context)?;
        let mut folder = ResumeFolder::open(path, known.as_ref())?;
        if folder.state().is_complete() && !is_resuming {
            // Another run has completed its outputs, and was ended while it removed its shards.
            folder.remove_shards()?;
            folder.mark(State::Shards)?;
        }
        let Some(seconds) = self.complete_or_replace(&flight, &outputs, how, control, &mut folder)? else {
            let pulses = control.progress.snapshot().pulses;
            return Ok(Report {
                summary: OutputSummary::default(),
                pulses,
                seconds: 0.0,
                interrupted: true,
                warnings: self.warnings(),
            });
        };
        self.drop_tree();
        let progress = Progress::default();
        let shards = ShardSet::open(path)?;
        let schedule = self.settings().schedule;
        if *folder.state() != State::Merging(run) {
            folder.mark(State::Merging(run))?;
        }
        let report = merge(&shards, request, schedule, RunContext { progress: &progress, ..control })?;
        if !report.interrupted {
            // A run that is ended while it removes the shards must not compute them again.
            folder.mark(State::complete(run, &report.summary))?;
            self.close(folder, how)?;
        }
        Ok(Report { seconds: seconds + report.seconds, warnings: self.warnings(), ..report })
    }

    /// Checks outputs as [`Session::run_resumable`] does before the first pulse, and returns the files and
    /// folders that they fill, as [`Session::output_places`] does. Outputs of an earlier start of the same
    /// run may exist. Warnings are left to the run, unless they are errors.
    ///
    /// # Errors
    /// [`Error::Input`] for outputs that are impossible, for flights that cannot be divided, and for shards
    /// of another run, unless outputs may be replaced; [`Error::Io`].
    pub fn check_resumable(
        &mut self,
        outputs: &OutputRequest,
        how: &ResumeOptions,
    ) -> Result<BTreeSet<PathBuf>> {
        let plan = |session: &Session| session.plan_flight_quietly().map(|(flight, _)| flight);
        let Resumption { flight, known, is_resuming, .. } = self.resumption(outputs, how, plan)?;
        if !outputs.force && known.is_some_and(|state| !state.is_complete()) {
            check_shards(&flight, &how.folder)?;
        }
        let context = OutputContext { has_ground: false, ..self.output_context() };
        self.check_places(OutputRequest { is_resuming, ..outputs.clone() }, &context)
    }

    /// Finds out how far an earlier start of a run came, whose flight `plan` plans.
    fn resumption(
        &mut self,
        outputs: &OutputRequest,
        how: &ResumeOptions,
        plan: fn(&Session) -> Result<FlightPlan>,
    ) -> Result<Resumption> {
        check_outputs(outputs)?;
        let known = ResumeFolder::state_of(&how.folder)?;
        self.record_for(outputs);
        let flight = self.divisible(plan)?;
        let run = RunId::new(&flight.fingerprint, outputs);
        let is_resuming = known.as_ref().is_some_and(|state| state.has_outputs_of(run));
        Ok(Resumption { flight, run, known, is_resuming })
    }

    /// Removes the shards of a run that is complete, and its folder unless that keeps the mark.
    fn close(&self, folder: ResumeFolder, how: &ResumeOptions) -> Result<()> {
        if how.keeps_mark {
            return folder.remove_shards();
        }
        if let Some(note) = remove_shards(folder, &how.folder)? {
            self.notify(note);
        }
        Ok(())
    }

    /// Computes all shards that do not exist. Shards of another run are replaced if outputs may be. Returns
    /// the time that it took, s; `None` if the run was interrupted.
    fn complete_or_replace(
        &mut self,
        flight: &Divisible,
        outputs: &OutputRequest,
        how: &ResumeOptions,
        control: RunContext<'_>,
        folder: &mut ResumeFolder,
    ) -> Result<Option<f64>> {
        let path = how.folder.as_path();
        let has_begun = !ShardSet::list(path)?.is_empty();
        let computed = match self.complete_shards(flight, outputs, how, control) {
            Err(Error::Input(found)) if outputs.force && has_begun => {
                self.notify(Notice::Note(format!(
                    "the shards in {} are replaced: {}",
                    path.display(),
                    found.headline()
                )));
                folder.mark(State::Shards)?;
                folder.remove_shards()?;
                self.complete_shards(flight, outputs, how, control)
            }
            computed => computed,
        };
        match computed {
            Err(Error::Interrupted) => {
                self.notify(Notice::Note(format!(
                    "complete shards are kept in {}; run the same command to continue",
                    path.display()
                )));
                Ok(None)
            }
            computed => computed.map(Some),
        }
    }

    /// Computes all shards that do not exist. Returns the time that it took, s.
    fn complete_shards(
        &mut self,
        flight: &Divisible,
        outputs: &OutputRequest,
        how: &ResumeOptions,
        control: RunContext<'_>,
    ) -> Result<f64> {
        let known = ShardSet::list(&how.folder)?;
        let mut runner =
            self.shards_of(flight.clone(), &how.folder, outputs.cloud.creation, false, control.stop)?;
        let needed = runner.pulses().div_ceil(how.pulses_per_shard.max(1)).clamp(1, MAX_SHARDS) as u32;
        let of = known.keys().next().copied().unwrap_or(needed);
        let mut seconds = 0.0;
        for number in 0..of {
            let shard = OneOf { number, of };
            if let Some(file) = runner.existing(shard)? {
                let leg = file.block(file.blocks().saturating_sub(1)).map_or(0, |block| block.leg);
                let done = f64::from(number + 1) / f64::from(of);
                control.progress.add(file.pulses, file.echoes, leg, done);
                continue;
            }
            let report = runner.run(shard, control)?;
            seconds += report.seconds;
            if report.interrupted {
                return Err(Error::Interrupted);
            }
        }
        Ok(seconds)
    }
}

/// Refuses a folder whose borders, or whose first shard, are of another run.
fn check_shards(flight: &Divisible, folder: &Path) -> Result<()> {
    Borders::load(folder, &flight.fingerprint)?;
    let first = ShardSet::list(folder)?.into_iter().find_map(|(of, numbers)| {
        let number = *numbers.first()?;
        Some(OneOf { number, of })
    });
    let Some(shard) = first else { return Ok(()) };
    let path = shard_path(folder, shard);
    // Damaged shards are computed again.
    let Ok(file) = ShardFile::open(&path) else { return Ok(()) };
    match flight.fingerprint.difference(&file.head.fingerprint) {
        Some(what) => Err(of_another_run(&path, &what)),
        None => Ok(()),
    }
}

/// The file or folder of an output; `None` for a stream.
fn path_of(target: &Target) -> Option<&Path> {
    match target {
        Target::Stdout => None,
        Target::File(path) | Target::Directory(path) | Target::Helios(path) => Some(path),
    }
}

#[cfg(test)]
mod tests {
    use super::super::settings::Settings;
    use super::*;
    use crate::output::PointFormat;
    use std::fs;
    use vlscan_survey::{ReadOptions, read_survey};
    use vlscan_warehouse::Stop;

    /// The folder of a run and its shards.
    struct Place(tempfile::TempDir);

    impl Place {
        fn at(&self, name: &str) -> PathBuf {
            self.0.path().join(name)
        }

        fn read(&self, name: &str) -> Vec<u8> {
            fs::read(self.at(name)).unwrap()
        }

        fn outputs(&self, names: &[&str]) -> OutputRequest {
            let sink = |name: &&str| (Target::File(self.at(name)), PointFormat::Las);
            OutputRequest { sinks: names.iter().map(sink).collect(), ..OutputRequest::default() }
        }

        fn run(&self, seed: u64, outputs: OutputRequest) -> Result<Report> {
            self.run_with(seed, outputs, &self.how(false))
        }

        fn run_with(&self, seed: u64, outputs: OutputRequest, how: &ResumeOptions) -> Result<Report> {
            let (progress, stop) = (Progress::default(), Stop::new());
            session(seed).run_resumable(outputs, how, RunContext::new(&progress, &stop))
        }

        fn how(&self, keeps_mark: bool) -> ResumeOptions {
            ResumeOptions { folder: self.at("shards"), pulses_per_shard: 1000, keeps_mark }
        }

        /// Leaves the folder of shards as a run that was ended.
        fn mark(&self, state: State) {
            let path = self.at("shards");
            let _ = fs::remove_dir_all(&path);
            ResumeFolder::open(&path, None).unwrap().mark(state).unwrap();
        }
    }

    fn session(seed: u64) -> Session {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/moving/survey.xml");
        let (survey, _) = read_survey(&path, &ReadOptions::default()).unwrap();
        let mut settings = Settings::new(survey);
        (settings.flight.seed, settings.physics.seed) = (seed, seed);
        Session::open(settings, |_| {}).unwrap()
    }

    fn id(seed: u64, outputs: &OutputRequest) -> RunId {
        let mut session = session(seed);
        session.record_for(outputs);
        RunId::new(&session.divisible(Session::plan_flight).unwrap().fingerprint, outputs)
    }

    #[test]
    fn a_mark_of_complete_outputs_is_that_of_one_run() {
        let place = Place(tempfile::tempdir().unwrap());
        let outputs = place.outputs(&["a.las"]);
        let summary = place.run(1, outputs.clone()).unwrap().summary;
        let (first, state) = (place.read("a.las"), State::complete(id(1, &outputs), &summary));
        place.mark(state.clone());
        assert_eq!(place.run(1, outputs.clone()).unwrap().pulses, 0);
        assert!(place.read("a.las") == first && !place.at("shards").exists());
        // What the caller writes besides is not there yet.
        place.mark(state.clone());
        let companions = vec![place.at("shards.csv")];
        let report = place.run(1, OutputRequest { companions, ..outputs.clone() }).unwrap();
        assert!(report.pulses > 0 && place.read("a.las") == first && !place.at("shards").exists());
        // Other contents, and other outputs.
        place.mark(state.clone());
        let refused = place.run(2, outputs.clone()).unwrap_err();
        assert!(refused.to_string().contains("exists already"), "{refused}");
        assert!(place.read("a.las") == first);
        let both = OutputRequest { force: true, ..place.outputs(&["a.las", "b.las"]) };
        place.run(1, both).unwrap();
        assert!(place.read("a.las") == first && place.read("b.las") == first && !place.at("shards").exists());
        let state = State::complete(id(1, &outputs), &summary);
        place.mark(state);
        assert!(place.run(2, OutputRequest { force: true, ..outputs }).unwrap().pulses > 0);
        place.run(2, place.outputs(&["c.las"])).unwrap();
        assert!(place.read("a.las") != first && place.read("a.las") == place.read("c.las"));
        assert!(!place.at("shards").exists());
    }

    #[test]
    fn outputs_that_were_merged_are_those_of_one_run() {
        let place = Place(tempfile::tempdir().unwrap());
        let outputs = place.outputs(&["a.las", "b.las"]);
        place.run(1, outputs.clone()).unwrap();
        let complete = place.read("a.las");
        // Of an ended merge some outputs have their names.
        let merging = || place.mark(State::Merging(id(1, &outputs)));
        fs::remove_file(place.at("b.las")).unwrap();
        merging();
        place.run(1, outputs.clone()).unwrap();
        assert!(place.read("a.las") == complete && place.read("b.las") == complete);
        assert!(!place.at("shards").exists());
        // Files of the user with the names of the outputs, of this run and of another one.
        fs::write(place.at("a.las"), "precious").unwrap();
        merging();
        let refused = place.run(1, outputs.clone()).unwrap_err();
        assert!(refused.to_string().contains("a.new.las"), "{refused}");
        assert_eq!(place.read("a.las"), b"precious");
        assert!(place.read("a.new.las") == complete);
        for (seed, names) in [(1, &["a.las"][..]), (2, &["a.las", "b.las"])] {
            merging();
            let refused = place.run(seed, place.outputs(names)).unwrap_err();
            assert!(refused.to_string().contains("a.las exists already"), "{refused}");
            assert_eq!(place.read("a.las"), b"precious");
        }
    }

    #[test]
    fn complete_outputs_are_recognised_while_their_mark_is_kept() {
        let place = Place(tempfile::tempdir().unwrap());
        let (outputs, how) = (place.outputs(&["a.las"]), place.how(true));
        let check = |seed: u64| session(seed).check_resumable(&outputs, &how).map_err(|e| e.to_string());
        let expected = session(1).output_places(&outputs).unwrap();
        assert_eq!(check(1).unwrap(), expected);
        assert!(!place.at("shards").exists(), "a check writes nothing");
        assert!(place.run_with(1, outputs.clone(), &how).unwrap().pulses > 0);
        let shards = ShardSet::list(&place.at("shards")).unwrap();
        assert!(shards.is_empty(), "{shards:?}");
        assert_eq!(check(1).unwrap(), expected);
        assert_eq!(place.run_with(1, outputs.clone(), &how).unwrap().pulses, 0);
        assert!(check(2).unwrap_err().contains("a.las exists already"));
        assert!(how.remove_folder().unwrap().is_none());
        assert!(!place.at("shards").exists() && place.at("a.las").exists());
        assert!(check(1).unwrap_err().contains("a.las exists already"));
        assert!(how.remove_folder().unwrap().is_none());
    }

    #[test]
    fn shards_of_another_run_are_refused_before_the_first_pulse() {
        let place = Place(tempfile::tempdir().unwrap());
        let (outputs, how) = (place.outputs(&["a.las"]), place.how(false));
        place.mark(State::Shards);
        let stop = Stop::new();
        let check = |seed: u64, force: bool| {
            let outputs = OutputRequest { force, ..outputs.clone() };
            session(seed).check_resumable(&outputs, &how).map(drop)
        };
        session(1).shards(&how.folder, &outputs, false, &stop).unwrap();
        check(1, false).unwrap();
        let refused = check(2, false).unwrap_err().to_string();
        assert!(
            refused.contains("belongs to another flight") && refused.contains("seed (1, 2)"),
            "{refused}"
        );
        check(2, true).unwrap();
        // Without the borders, a shard is compared.
        let progress = Progress::default();
        let mut session = session(1);
        let mut runner = session.shards(&how.folder, &outputs, false, &stop).unwrap();
        runner.run(OneOf { number: 1, of: 2 }, RunContext::new(&progress, &stop)).unwrap();
        fs::remove_file(Borders::path(&how.folder)).unwrap();
        check(1, false).unwrap();
        let refused = check(2, false).unwrap_err().to_string();
        assert!(refused.contains("-000002.vlshard is of another run"), "{refused}");
        check(2, true).unwrap();
    }

    #[test]
    fn a_file_of_the_user_with_the_name_of_a_part_is_kept() {
        let place = Place(tempfile::tempdir().unwrap());
        place.mark(State::Shards);
        let name = "shards/shard-000000-of-000005.vlshard";
        fs::write(place.at(name), "precious").unwrap();
        for force in [false, true] {
            let outputs = OutputRequest { force, ..place.outputs(&["a.las"]) };
            let refused = place.run(1, outputs).unwrap_err();
            assert!(refused.to_string().contains("so it is not replaced"), "{refused}");
            assert_eq!(place.read(name), b"precious");
        }
        fs::remove_file(place.at(name)).unwrap();
        place.run(1, place.outputs(&["a.las"])).unwrap();
        assert!(!place.at("shards").exists());
    }
}
