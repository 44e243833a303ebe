//! Pictures of results, drawn when a page asks for them and kept beside the results.

use crate::beneath::Beneath;
use crate::execution::{alone, bytes_in, end};
use crate::names::relative_path;
use crate::processes::Process;
use crate::program::confined;
use crate::queue::Use;
use crate::records::Kind;
use crate::request::Prepared;
use crate::store::{Job, Result, ResultFile};
use crate::worker::Workshop;
use std::ffi::OsString;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

/// The picture from above and from the side.
pub const PICTURE: &str = "view.png";
/// Longest time of drawing, and most bytes of what is drawn.
const MAX_TIME: Duration = Duration::from_secs(120);
const MAX_DRAWN: u64 = 32 << 20;
const POLL: Duration = Duration::from_millis(10);

/// The result that a picture is made of, if there is one.
pub fn drawn_file(process: Option<Process>, files: &[ResultFile]) -> Option<&ResultFile> {
    let endings: &[&str] = match process {
        Some(Process::Run) => &[".laz", ".las", ".ply", ".xyz", ".pcd", ".e57", ".parquet"],
        Some(Process::Plan) => &[".toml"],
        _ => &[],
    };
    files.iter().find(|file| endings.iter().any(|end| file.path.ends_with(end)))
}

/// The folders in which the job has looked for files, as seen from its results.
fn asset_words(prepared: &Prepared) -> Vec<OsString> {
    let of_words = prepared.words.iter().filter_map(|word| word.strip_prefix("--assets=").map(str::to_owned));
    let table: Option<toml::Table> = prepared.document.as_ref().and_then(|(_, text)| text.parse().ok());
    let of_file = table.and_then(|table| table.get("assets")?.as_array().cloned()).unwrap_or_default();
    let of_file = of_file.iter().filter_map(|folder| folder.as_str().map(str::to_owned));
    let uploads = prepared.uses.iter().filter_map(|used| match used {
        Use::Upload { name, .. } => Some(name.clone()),
        Use::Job { .. } => None,
    });
    let all = of_words.chain(of_file).chain([".".to_owned()]).chain(uploads);
    all.map(|folder| format!("--assets=../in/{folder}").into()).collect()
}

impl Workshop {
    /// Draws a picture if there is none. Returns whether there is one in the folder `view` of the job.
    ///
    /// # Errors
    /// Errors of files.
    pub fn view(&self, job: &Job, name: &str) -> Result<bool> {
        let folder = self.store.job_folder(&job.folder);
        let is_there = || {
            let path = relative_path(name)?;
            Beneath::of(&folder.join("view")).and_then(|view| view.file(path)).ok()
        };
        if is_there().is_some() {
            return Ok(true);
        }
        if name != PICTURE {
            return Ok(false);
        }
        let files = job.result_files();
        let Some(file) = drawn_file(Process::named(&job.process), &files) else { return Ok(false) };
        // That of the job which computed the results.
        let prepared = fs::read(folder.join("prepared.json"))?;
        let prepared: Prepared = serde_json::from_slice(&prepared).map_err(std::io::Error::other)?;
        let mut words: Vec<OsString> = vec!["preview".into(), "--force".into()];
        words.push(format!("--out=../view/{name}").into());
        words.extend(["--width=1200", "--height=800"].map(OsString::from));
        words.extend(asset_words(&prepared));
        words.extend(["--".into(), file.path.clone().into()]);
        let _results = self.store.fetch(Kind::Results, &job.folder)?;
        self.draw(&folder, "out", &prepared, &words)?;
        if !self.store.has_bucket() {
            self.store.set_disk(&job.folder, bytes_in(&folder)?)?;
        }
        Ok(is_there().is_some())
    }

    /// Executes vlscan in a folder of a job, for a limited time, whatever comes of it.
    pub(crate) fn draw(
        &self,
        folder: &Path,
        within: &str,
        prepared: &Prepared,
        words: &[OsString],
    ) -> Result<()> {
        fs::create_dir_all(folder.join("tmp"))?;
        let _inputs = self.fetch(prepared)?;
        let mut restrictions = self.setting(folder, prepared).restrictions;
        restrictions.file_size = Some(MAX_DRAWN);
        let mut command = alone(confined(&restrictions, words)?);
        command.current_dir(folder.join(within)).env("TMPDIR", folder.join("tmp"));
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn()?;
        let start = Instant::now();
        while child.try_wait()?.is_none() {
            if start.elapsed() > MAX_TIME {
                end(&mut child, !self.limits.no_sandbox);
            }
            std::thread::sleep(POLL);
        }
        fs::remove_dir_all(folder.join("tmp"))?;
        // A picture is small; what else a hostile file has had drawn goes.
        let view = folder.join("view");
        if bytes_in(&view).is_ok_and(|bytes| bytes <= MAX_DRAWN) {
            return Ok(());
        }
        fs::remove_dir_all(&view)?;
        Ok(fs::create_dir(&view)?)
    }
}
