//! The program vlscan: where it is, what it takes, which instruments it knows. The service asks the program
//! itself, so that descriptions and results are of the same version.

use crate::config::ConfineArgs;
use crate::confine::Held;
use serde_json::Value;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;

/// Name of the program.
const NAME: &str = if cfg!(windows) { "vlscan.exe" } else { "vlscan" };

/// Option of the program for messages that the service reads.
pub(crate) const MESSAGES: &str = "--message-format=json";

/// Folder of the patterns of scanners, in that of the service, and the file that vlscan writes.
pub(crate) const PATTERNS: &str = "patterns";
pub(crate) const PATTERN: &str = "pattern.svg";

/// Prefix of references that vlscan resolves in its catalogue, whatever files exist.
pub const CATALOGUE: &str = "catalogue:";

/// Why vlscan cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ProgramError {
    /// There is none.
    #[error(
        "the program vlscan is neither beside vlscan-serve nor in a folder of PATH; name it with --program"
    )]
    Absent,
    /// It cannot be started, or fails.
    #[error("{program} {words}: {message}")]
    Failed {
        /// The program.
        program: PathBuf,
        /// Its arguments.
        words: String,
        /// Problem.
        message: String,
    },
}

/// The program and what it says of itself.
#[derive(Debug)]
pub struct Program {
    /// Its path.
    pub path: PathBuf,
    /// Its version.
    pub version: String,
    /// JSON Schema of pipeline files.
    pub pipeline: Value,
    /// JSON Schema of the options of commands, by command.
    pub commands: Value,
    /// Scanners and platforms, as `vlscan catalogue --json` lists them.
    pub catalogue: Value,
}

impl Program {
    /// Finds the program and asks what it takes.
    ///
    /// # Errors
    /// [`ProgramError`].
    pub fn find(named: Option<&Path>) -> Result<Program, ProgramError> {
        let path = match named {
            Some(path) => path.to_owned(),
            None => look().ok_or(ProgramError::Absent)?,
        };
        let path = path.canonicalize().unwrap_or(path);
        // A program of an earlier version fails here already, not in each job.
        let schemas = ask(&path, &[MESSAGES, "man", "--json-schema"])?;
        let catalogue = ask(&path, &["catalogue", "--json"])?;
        // The version is part of what determines results.
        let version = schemas["version"].as_str().map(str::to_owned);
        let version = version.ok_or_else(|| ProgramError::Failed {
            program: path.clone(),
            words: "man --json-schema".to_owned(),
            message: "no version in its answer".to_owned(),
        })?;
        Ok(Program {
            version,
            pipeline: schemas["pipeline"].clone(),
            commands: schemas["commands"].clone(),
            catalogue,
            path,
        })
    }

    /// The names of scanners or platforms (`kind`) and the catalogue's figures of each.
    pub fn entries(&self, kind: &str) -> impl Iterator<Item = (&str, &Value)> {
        let entries = self.catalogue[kind].as_array().into_iter().flatten();
        entries.filter_map(|entry| Some((entry["reference"].as_str()?, entry)))
    }

    /// The full references of all scanners and platforms of the catalogue.
    fn references(&self) -> impl Iterator<Item = &str> {
        let lists = self.catalogue.as_object().into_iter().flatten().filter_map(|(_, list)| list.as_array());
        lists.flatten().filter_map(|entry| entry["reference"].as_str())
    }

    /// True if a text is the full reference of a scanner or platform of the catalogue.
    pub fn is_reference(&self, text: &str) -> bool {
        self.references().any(|reference| reference == text)
    }

    /// The reference that no file of an upload replaces, for an id or full reference of the catalogue.
    pub fn in_catalogue(&self, text: &str) -> Option<String> {
        let is_id = |reference: &str| reference.split_once('#').is_some_and(|(_, id)| id == text);
        let is_named = self.references().any(|reference| reference == text || is_id(reference));
        is_named.then(|| format!("{CATALOGUE}{text}"))
    }

    /// True if the catalogue has a file of this name.
    pub fn has_file(&self, name: &str) -> bool {
        self.references().any(|reference| reference.split('#').next() == Some(name))
    }

    /// The pattern of a scanner of the catalogue as SVG, kept in `folder` and made at its first call, below
    /// the folder `scratch` of the same file system.
    ///
    /// # Errors
    /// [`ProgramError`].
    pub fn pattern(&self, reference: &str, folder: &Path, scratch: &Path) -> Result<Vec<u8>, ProgramError> {
        let failed = |e: std::io::Error| self.failed("catalogue show", &e.to_string());
        let name: String =
            reference.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
        let path = folder.join(format!("{name}-{}.svg", self.version));
        if let Ok(picture) = std::fs::read(&path) {
            return Ok(picture);
        }
        std::fs::create_dir_all(folder).map_err(failed)?;
        let scratch = tempfile::tempdir_in(scratch).map_err(failed)?;
        let made = scratch.path().join(PATTERN);
        run(
            &self.path,
            [
                OsStr::new("catalogue"),
                "show".as_ref(),
                reference.as_ref(),
                "--picture".as_ref(),
                made.as_os_str(),
            ],
        )?;
        std::fs::rename(&made, &path).map_err(failed)?;
        std::fs::read(&path).map_err(failed)
    }

    fn failed(&self, words: &str, message: &str) -> ProgramError {
        ProgramError::Failed {
            program: self.path.clone(),
            words: words.to_owned(),
            message: message.to_owned(),
        }
    }
}

/// Beside this program, else in the folders of PATH.
fn look() -> Option<PathBuf> {
    let own = std::env::current_exe().ok();
    let beside = own.as_deref().and_then(Path::parent).map(Path::to_path_buf);
    let path = std::env::var_os("PATH").unwrap_or_default();
    beside
        .into_iter()
        .chain(std::env::split_paths(&path))
        .map(|folder| folder.join(NAME))
        .find(|path| path.is_file())
}

fn run<W: AsRef<OsStr>>(program: &Path, words: impl IntoIterator<Item = W>) -> Result<Vec<u8>, ProgramError> {
    let words: Vec<OsString> = words.into_iter().map(|word| word.as_ref().to_owned()).collect();
    let failed = |message: String| ProgramError::Failed {
        program: program.to_owned(),
        words: words.iter().map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" "),
        message,
    };
    let done = Command::new(program).args(&words).stdin(Stdio::null()).env("NO_COLOR", "1").output();
    let done = done.map_err(|e| failed(e.to_string()))?;
    match done.status.success() {
        true => Ok(done.stdout),
        false => Err(failed(String::from_utf8_lossy(&done.stderr).trim().to_owned())),
    }
}

fn ask(program: &Path, words: &[&str]) -> Result<Value, ProgramError> {
    let answer = run(program, words)?;
    serde_json::from_slice(&answer).map_err(|e| ProgramError::Failed {
        program: program.to_owned(),
        words: words.join(" "),
        message: format!("its answer is no JSON ({e}); vlscan and vlscan-serve must be of the same version"),
    })
}

/// A command that executes a program under the restrictions of `args`, with an environment of its own.
///
/// # Errors
/// When this program does not know where it is.
pub fn confined(args: &ConfineArgs, words: &[OsString]) -> std::io::Result<Command> {
    let mut command = Command::new(own_program()?);
    command.env_clear().env("NO_COLOR", "1").env("MALLOC_ARENA_MAX", "2").env("LC_ALL", "C.UTF-8");
    command.env("VLSCAN_PARENT", std::process::id().to_string()).stdin(Stdio::null()).arg("confine");
    for path in &args.read {
        command.arg("--read").arg(path);
    }
    for path in &args.write {
        command.arg("--write").arg(path);
    }
    for (option, limit) in [("--memory", args.memory), ("--time", args.time), ("--file-size", args.file_size)]
    {
        if let Some(limit) = limit {
            command.arg(option).arg(limit.to_string());
        }
    }
    if args.no_sandbox {
        command.arg("--no-sandbox");
    }
    command.arg("--").args(&args.program).args(words);
    Ok(command)
}

/// Path of this executable, which is the launcher of the sandbox. The path is that of the start, so that a
/// file that replaces the executable is used from then on.
///
/// # Errors
/// When this program does not know where it is.
pub fn own_program() -> std::io::Result<PathBuf> {
    static PATH: OnceLock<PathBuf> = OnceLock::new();
    match PATH.get() {
        Some(path) => Ok(path.clone()),
        None => {
            let path = std::env::current_exe()?;
            Ok(PATH.get_or_init(|| path).clone())
        }
    }
}

/// Sandbox features that this system allows. A program is started in the sandbox only if it is found to be
/// complete.
///
/// # Errors
/// If the sandbox fails, or the program does not start in it.
pub fn sandbox(program: &Path) -> std::io::Result<Held> {
    let failed = |done: &Output| {
        let message = String::from_utf8_lossy(&done.stderr).trim().to_owned();
        std::io::Error::other(format!("the sandbox of jobs fails ({}): {message}", done.status))
    };
    let done = confined(&ConfineArgs::default(), &[])?.output()?;
    if !done.status.success() {
        return Err(failed(&done));
    }
    let held: Held = serde_json::from_slice(&done.stdout).map_err(std::io::Error::other)?;
    if held.files && held.calls {
        let args = ConfineArgs { program: vec![program.into()], ..ConfineArgs::default() };
        let done = confined(&args, &["--version".into()])?.output()?;
        if matches!(done.status.code(), Some(NOT_CONFINED | NOT_LOADED)) {
            return Err(failed(&done));
        }
    }
    Ok(held)
}

/// Exit statuses of a program that was not started: those of `confine` and of the system's loader.
const NOT_CONFINED: i32 = 2;
const NOT_LOADED: i32 = 127;
