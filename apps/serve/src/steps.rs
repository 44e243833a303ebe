//! Steps that compute the results of a job: one step, or parts that any number of processes compute and a
//! last step.

use crate::execution::{End, Setting};
use crate::opening::names_in;
use crate::processes::Process;
use crate::request::Prepared;
use crate::store::Result;
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::fs;
use std::path::Path;

/// The words behind `vlscan` of all steps.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Steps {
    /// The number of parts; 1 if the last step computes everything.
    pub parts: u32,
    part: Option<Part>,
    last: Vec<String>,
    /// The step that computes everything if the run cannot be divided.
    whole: Option<Vec<String>>,
    earlier: Earlier,
}

/// The words of a part, before and after its number.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Part {
    before: Vec<String>,
    /// `--shard` or `--task`.
    option: String,
    after: Vec<String>,
}

/// Treatment of results that an earlier process has left, by the last step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
enum Earlier {
    /// They are removed.
    Removed,
    /// They are removed unless there are shards, with which the run goes on.
    ShardsContinued,
    /// It goes on with them.
    Continued,
}

impl Steps {
    /// The steps of a job, in `parts` parts if its process can be divided; `threads` is 0 for all.
    pub fn of(process: Option<Process>, prepared: &Prepared, threads: usize, parts: u32) -> Steps {
        let mut words = prepared.words.clone();
        let threads = (threads > 0).then(|| format!("--threads={threads}"));
        if matches!(process, Some(Process::Run | Process::DryRun | Process::Campaign)) {
            words.extend(threads.clone());
        }
        let with = |more: &[&str]| {
            let more = more.iter().map(|word| (*word).to_owned());
            words.iter().cloned().chain(more).collect::<Vec<String>>()
        };
        match process {
            Some(Process::Run) if parts > 1 => {
                let shards = format!("../tmp/shards-{parts}");
                let after = ["-o", &shards, "--resume", "--progress"].map(str::to_owned).to_vec();
                let merge = ["merge", &shards, "--pipeline", "../in/job.toml", "--force", "--progress"];
                Steps {
                    parts,
                    part: Some(Part { before: words.clone(), option: "--shard".to_owned(), after }),
                    last: merge.map(str::to_owned).into_iter().chain(threads).collect(),
                    whole: Some(with(&["--progress"])),
                    earlier: Earlier::Removed,
                }
            }
            Some(Process::Run) => Steps {
                parts: 1,
                part: None,
                last: with(&["--resume", "--progress"]),
                whole: Some(with(&["--progress"])),
                earlier: Earlier::ShardsContinued,
            },
            Some(Process::Campaign) => Steps {
                parts: parts.max(1),
                part: (parts > 1).then(|| Part {
                    before: words.clone(),
                    option: "--task".to_owned(),
                    after: Vec::new(),
                }),
                last: words,
                whole: None,
                earlier: Earlier::Continued,
            },
            _ => Steps { parts: 1, part: None, last: words, whole: None, earlier: Earlier::Removed },
        }
    }

    /// Computes part `number`, from 0; does nothing if there are no parts.
    ///
    /// # Errors
    /// As for [`Setting::execute`].
    pub fn compute_part(
        &self,
        number: u32,
        setting: &Setting,
        log: &Path,
        goes_on: &mut dyn FnMut() -> Result<bool>,
    ) -> Result<End> {
        let Some(part) = &self.part else { return Ok(End::Success) };
        let own = format!("{}={number}/{}", part.option, self.parts);
        let words = part.before.iter().chain([&own]).chain(&part.after).map(OsString::from);
        setting.execute(&words.collect::<Vec<_>>(), log, None, &mut || Ok(()), goes_on)
    }

    /// Computes the last step.
    ///
    /// # Errors
    /// As for [`Setting::execute`].
    pub fn compute_last(
        &self,
        setting: &Setting,
        log: &Path,
        stdout: Option<&Path>,
        goes_on: &mut dyn FnMut() -> Result<bool>,
    ) -> Result<End> {
        let out = setting.folder.join("out");
        let mut prepare = || match self.earlier {
            Earlier::Removed => empty(&out),
            Earlier::ShardsContinued if !has_shards(&out)? => empty(&out),
            Earlier::ShardsContinued | Earlier::Continued => Ok(()),
        };
        let is_begun = self.earlier == Earlier::ShardsContinued && has_shards(&out)?;
        let mut end = setting.execute(&words(&self.last), log, stdout, &mut prepare, goes_on)?;
        if is_begun && matches!(end, End::NotDivisible(_)) {
            // Shards of another version of vlscan, perhaps.
            empty(&out)?;
            end = setting.execute(&words(&self.last), log, stdout, &mut prepare, goes_on)?;
        }
        match end {
            End::NotDivisible(_) if self.whole.is_some() => self.compute_whole(setting, log, goes_on),
            end => Ok(end),
        }
    }

    /// Computes everything in one step, if the run cannot be divided.
    ///
    /// # Errors
    /// As for [`Setting::execute`].
    pub fn compute_whole(
        &self,
        setting: &Setting,
        log: &Path,
        goes_on: &mut dyn FnMut() -> Result<bool>,
    ) -> Result<End> {
        let words = words(self.whole.as_ref().unwrap_or(&self.last));
        setting.execute(&words, log, None, &mut || empty(&setting.folder.join("out")), goes_on)
    }
}

fn words(texts: &[String]) -> Vec<OsString> {
    texts.iter().map(OsString::from).collect()
}

/// Removes everything in a folder.
pub(crate) fn empty(folder: &Path) -> Result<()> {
    fs::remove_dir_all(folder)?;
    Ok(fs::create_dir(folder)?)
}

/// True if an earlier worker has left shards of a run, which is then continued. An empty folder of shards is
/// what a complete run leaves if it is ended before its last step, which removes the folder.
fn has_shards(out: &Path) -> Result<bool> {
    for name in names_in(out)?.iter().filter(|name| name.ends_with(".shards")) {
        let path = out.join(name);
        if path.symlink_metadata()?.is_dir() && !names_in(&path)?.is_empty() {
            return Ok(true);
        }
    }
    Ok(false)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_folder_of_shards_is_that_of_a_run_that_was_complete() {
        let out = tempfile::tempdir().unwrap();
        fs::write(out.path().join("points.laz"), "").unwrap();
        fs::write(out.path().join("other.shards"), "an output of this name").unwrap();
        assert!(!has_shards(out.path()).unwrap());
        let shards = out.path().join("points.laz.shards");
        fs::create_dir(&shards).unwrap();
        assert!(!has_shards(out.path()).unwrap());
        fs::write(shards.join("vlscan-resume.json"), "").unwrap();
        assert!(has_shards(out.path()).unwrap());
    }
}
