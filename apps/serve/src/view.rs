//! Pictures of results, drawn when a page asks for them and kept beside the results.

use crate::beneath::Beneath;
use crate::execution::bytes_in;
use crate::job_folder;
use crate::names::relative_path;
use crate::processes::Process;
use crate::queue::Use;
use crate::request::{Prepared, name_of};
use crate::store::{Job, Result, ResultFile};
use crate::worker::Workshop;
use std::ffi::OsString;
use std::fs;
use std::path::Path;

/// The picture from above and from the side.
pub const PICTURE: &str = "view.png";
/// The folder of pictures, in that of a job.
pub(crate) const VIEW: &str = "view";
/// Maximum time of drawing, seconds, and maximum size of what is drawn, bytes.
const MAX_TIME: u64 = 120;
const MAX_DRAWN: u64 = 32 << 20;
/// Maximum disk space of a drawing while it is made, bytes: it counts for no owner.
const MAX_DRAWING: u64 = 4 * MAX_DRAWN;

/// The result that a picture is made of, if there is one.
pub fn drawn_file(process: Option<Process>, files: &[ResultFile]) -> Option<&ResultFile> {
    let endings: &[&str] = match process {
        Some(Process::Run) => &[".laz", ".las", ".ply", ".xyz", ".pcd", ".e57", ".parquet"],
        Some(Process::Plan) => &[".toml"],
        _ => &[],
    };
    files.iter().find(|file| endings.iter().any(|end| file.path.ends_with(end)))
}

/// The folders in which the job has looked for files, as seen from its inputs.
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
    all.map(|folder| format!("--assets={folder}").into()).collect()
}

impl Workshop {
    /// True if the picture of a job's results has been drawn.
    pub fn has_view(&self, job: &Job, name: &str) -> bool {
        let Some(path) = relative_path(name) else { return false };
        let view = Beneath::of(&self.store.job_folder(&job.folder).join(VIEW));
        view.and_then(|view| view.file(path)).is_ok()
    }

    /// Draws a picture if there is none. Returns true if there is one in the folder `view` of the job.
    ///
    /// # Errors
    /// Errors of files.
    pub fn view(&self, job: &Job, name: &str) -> Result<bool> {
        if self.has_view(job, name) || name != PICTURE {
            return Ok(self.has_view(job, name));
        }
        let folder = self.store.job_folder(&job.folder);
        let files = job.result_files();
        let Some(file) = drawn_file(Process::named(&job.process), &files) else { return Ok(false) };
        // That of the job which computed the results.
        let prepared = fs::read(folder.join("prepared.json"))?;
        let mut prepared: Prepared = serde_json::from_slice(&prepared).map_err(std::io::Error::other)?;
        let results = Use::Job { id: job.folder.clone(), folder: job.folder.clone() };
        let mut words: Vec<OsString> = vec!["preview".into(), format!("--out=../{VIEW}/{PICTURE}").into()];
        words.extend(["--width=1200", "--height=800"].map(OsString::from));
        words.extend(asset_words(&prepared));
        // The picture has the name of the file as its title.
        let path = format!("{}/{}", name_of(&results), file.path);
        let own = file.path.rsplit('/').next().unwrap_or(&file.path);
        let title = if prepared.uses.iter().any(|used| name_of(used) == own) { path.as_str() } else { own };
        words.extend(["--".into(), title.into()]);
        prepared.uses.insert(results);
        let drawn = self.draw(&prepared, &words, Some((&path, title)))?;
        let view = drawn.path().join(VIEW);
        if Beneath::of(&view)?.file(PICTURE).is_ok() {
            // Not the folder of the job itself, which may have been dismissed meanwhile.
            match fs::create_dir(folder.join(VIEW)) {
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(false),
                Err(e) if e.kind() != std::io::ErrorKind::AlreadyExists => return Err(e.into()),
                _ => {}
            }
            fs::rename(view.join(PICTURE), folder.join(VIEW).join(PICTURE))?;
        }
        if !self.store.has_bucket() {
            self.store.set_disk(&job.folder, bytes_in(&folder)?)?;
        }
        Ok(self.has_view(job, name))
    }

    /// Executes vlscan in the folder of inputs of a new folder, for a limited time; its result is ignored. An
    /// input can have a second name. The pictures are in the folder [`VIEW`]. Everything is removed with the
    /// returned folder.
    pub(crate) fn draw(
        &self,
        prepared: &Prepared,
        words: &[OsString],
        renamed: Option<(&str, &str)>,
    ) -> Result<tempfile::TempDir> {
        let folder = tempfile::tempdir_in(self.store.incoming())?;
        job_folder::make(&self.store, folder.path(), prepared)?;
        if let Some((path, name)) = renamed.filter(|(path, name)| path != name) {
            job_folder::link(Path::new(path), &folder.path().join("in").join(name))?;
        }
        let _inputs = self.fetch(prepared)?;
        let mut setting = self.setting(folder.path(), prepared);
        setting.restrictions.write = [VIEW, "tmp"].map(|name| folder.path().join(name)).to_vec();
        setting.restrictions.file_size = Some(MAX_DRAWN);
        setting.within_inputs = true;
        setting.max_time = setting.max_time.min(MAX_TIME);
        setting.max_disk = setting.max_disk.min(MAX_DRAWING);
        let log = folder.path().join("log");
        setting.execute(words, &log, None, &mut || Ok(()), &mut || Ok(!self.is_ending()))?;
        // A picture is small; what else a hostile file has had drawn goes.
        let view = folder.path().join(VIEW);
        if bytes_in(&view).is_ok_and(|bytes| bytes <= MAX_DRAWN) {
            return Ok(folder);
        }
        fs::remove_dir_all(&view)?;
        fs::create_dir(&view)?;
        Ok(folder)
    }
}
