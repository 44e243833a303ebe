//! Resuming interrupted runs: a run is divided into shards, and existing shards are not computed again.

use super::merge::merge;
use super::pass::RunContext;
use super::progress::Progress;
use super::resume_folder::{ResumeFolder, RunId, State};
use super::run::Report;
use super::session::Session;
use super::shard::{Divisible, check_outputs};
use crate::output::{OutputContext, OutputRequest, OutputSummary, Target};
use crate::shards::{OneOf, ShardSet};
use std::path::{Path, PathBuf};
use vlscan_base::diag::Notice;
use vlscan_base::error::{Error, Result};

/// Maximum number of shards.
const MAX_SHARDS: u64 = 100_000;

/// Division of a run that can be resumed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResumeOptions {
    /// Folder of the shards, removed when the outputs are complete.
    pub folder: PathBuf,
    /// Pulses per shard; a folder with shards keeps their number.
    pub pulses_per_shard: u64,
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
        Ok(ResumeOptions { folder: path.with_file_name(name), pulses_per_shard })
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
        check_outputs(&outputs)?;
        let path = how.folder.as_path();
        let known = ResumeFolder::state_of(path)?;
        self.record_for(&outputs);
        let flight = self.divisible()?;
        let run = RunId::new(&flight.fingerprint, &outputs);
        let is_resuming = known.as_ref().is_some_and(|state| state.has_outputs_of(run));
        // The caller writes companions after the outputs.
        let needs_no_more = is_resuming && outputs.companions.is_empty();
        if needs_no_more && known.as_ref().is_some_and(State::is_complete) {
            self.notify(Notice::Note("the outputs are already complete".to_owned()));
            self.remove_shards(ResumeFolder::open(path, known.as_ref())?, path)?;
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
            self.remove_shards(folder, path)?;
        }
        Ok(Report { seconds: seconds + report.seconds, warnings: self.warnings(), ..report })
    }

    /// Removes the shards of a run that is complete.
    fn remove_shards(&self, folder: ResumeFolder, path: &Path) -> Result<()> {
        if let Some(other) = folder.remove()?.first() {
            self.notify(Notice::Note(format!(
                "{} is kept: it contains files that the run has not made, such as {}",
                path.display(),
                other.display()
            )));
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
            let how = ResumeOptions { folder: self.at("shards"), pulses_per_shard: 1000 };
            let (progress, stop) = (Progress::default(), Stop::new());
            session(seed).run_resumable(outputs, &how, RunContext::new(&progress, &stop))
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
        RunId::new(&session.divisible().unwrap().fingerprint, outputs)
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
