//! The state of one run of a reader: options, opened documents, problems.

use super::assets::Assets;
use super::text::{decode, line_of_bytes};
use super::xml::XmlDocument;
use super::{PoseStream, SceneRecipe};
use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan_base::diag::{Diagnostic, Diagnostics, Place, ProblemKind};
use vlscan_base::error::{Error, Result};
use vlscan_tables::NumberTable;

/// Reads the columns of numbers of a Parquet file for whose names the function is true. The result also names
/// the other columns.
pub type NumberColumns = fn(&Path, &dyn Fn(&str) -> bool) -> Result<NumberTable>;

/// A scene that replaces the survey's.
#[derive(Clone, Debug)]
pub enum SceneChoice {
    /// A reference as [`super::read_scene`] reads it.
    Named(String),
    /// A scene in memory.
    Given(Arc<SceneRecipe>),
}

/// How input files are read.
#[derive(Clone, Debug, Default)]
pub struct ReadOptions {
    /// Folders that are searched for files, after the working directory (`--assets`).
    pub assets: Vec<PathBuf>,
    /// True if warnings are errors.
    pub strict: bool,
    /// Replaces the scene of the survey.
    pub scene: Option<SceneChoice>,
    /// Replaces the platform of the survey ([`super::Survey::follow`]) before the survey is checked.
    pub trajectory: Option<PoseStream>,
    /// Trajectories in memory, each with the name that legs in XML give as its file: bytes of an Arrow stream
    /// or of a file. They take precedence over files.
    pub named_trajectories: Vec<(String, Arc<[u8]>)>,
    /// True if the pulses come from a stream: the survey then needs no legs, and its legs need not be
    /// flyable.
    pub is_traced: bool,
    /// Maximum number of bytes that the survey and its scene may need. Files that certainly need more are
    /// rejected before they are read.
    pub max_memory: Option<u64>,
    /// Reader of Parquet files; `None` rejects them.
    pub number_columns: Option<NumberColumns>,
}

/// State of one run of a reader. Problems are collected so that all of them are reported at once.
#[derive(Debug)]
pub(super) struct Context {
    pub assets: Assets,
    /// Replaces the scene of the survey.
    pub scene: Option<SceneChoice>,
    trajectories: Vec<(String, Arc<[u8]>)>,
    strict: bool,
    pub(super) max_memory: Option<u64>,
    pub(super) number_columns: Option<NumberColumns>,
    pub(super) problems: RefCell<Diagnostics>,
    limits: RefCell<Diagnostics>,
    pub(super) failure: RefCell<Option<Error>>,
    pub(super) documents: RefCell<HashMap<PathBuf, Option<Arc<XmlDocument>>>>,
}

impl Context {
    pub fn new(options: &ReadOptions) -> Context {
        Context {
            assets: Assets::new(&options.assets),
            scene: options.scene.clone(),
            trajectories: options.named_trajectories.clone(),
            strict: options.strict,
            max_memory: options.max_memory,
            number_columns: options.number_columns,
            problems: RefCell::default(),
            limits: RefCell::default(),
            failure: RefCell::default(),
            documents: RefCell::default(),
        }
    }

    /// The trajectory in memory with this name.
    pub fn trajectory(&self, name: &str) -> Option<Arc<[u8]>> {
        self.trajectories.iter().find(|(known, _)| known == name).map(|(_, content)| content.clone())
    }

    /// Adds earlier problems.
    pub fn take(&self, problems: Diagnostics) {
        self.problems.borrow_mut().extend(problems);
    }

    /// Records a problem that ends the run.
    pub fn error(&self, place: Place, message: impl Into<String>) {
        self.problems.borrow_mut().error(Some(place), message);
    }

    /// Records a problem that ends the run, with a hint.
    pub fn error_help(
        &self,
        place: impl Into<Option<Place>>,
        message: impl Into<String>,
        help: impl Into<String>,
    ) {
        set_help(self.problems.borrow_mut().error(place.into(), message), help.into());
    }

    /// Records a file that does not exist, with a hint.
    pub fn not_found(
        &self,
        place: impl Into<Option<Place>>,
        message: impl Into<String>,
        help: impl Into<String>,
    ) {
        let mut problems = self.problems.borrow_mut();
        set_help(problems.error(place.into(), message).of_kind(ProblemKind::NotFound), help.into());
    }

    /// Records a file that cannot be read.
    pub fn unread(&self, place: impl Into<Option<Place>>, path: &Path, e: &std::io::Error) {
        let mut problems = self.problems.borrow_mut();
        problems.error(place.into(), format!("cannot read {}: {e}", path.display())).of_kind(e.into());
    }

    /// Decodes the bytes of a text file. Bytes that are not text are recorded with their line.
    pub fn text<'b>(&self, path: &Path, bytes: &'b [u8]) -> Option<Cow<'b, str>> {
        let decoded = match std::str::from_utf8(bytes) {
            Ok(text) if !text.starts_with('\u{feff}') => Ok(Cow::Borrowed(text)),
            _ => decode(bytes).map(Cow::Owned),
        };
        match decoded {
            Ok(text) => Some(text),
            Err(e) => {
                let (line, excerpt) = line_of_bytes(bytes, e.at);
                self.error(Place::in_line(path, line, &excerpt, 0..0), e.message);
                None
            }
        }
    }

    /// Records a value that is replaced or ignored.
    pub fn warn(&self, place: Place, message: impl Into<String>) {
        self.problems.borrow_mut().warn(Some(place), message);
    }

    /// Records a value that is replaced or ignored, with a hint.
    pub fn warn_help(
        &self,
        place: impl Into<Option<Place>>,
        message: impl Into<String>,
        help: impl Into<String>,
    ) {
        set_help(self.problems.borrow_mut().warn(place.into(), message), help.into());
    }

    /// Records a violated limit, which has a separate exit status.
    pub fn limit(&self, place: Option<Place>, message: impl Into<String>, help: impl Into<String>) {
        set_help(self.limits.borrow_mut().error(place, message), help.into());
    }

    /// True if errors have been recorded, so that dependent values need not be built.
    pub fn failed(&self) -> bool {
        self.failure.borrow().is_some() || self.problems.borrow().is_fatal(false)
    }

    /// The value with the warnings to be shown, or all problems as an error.
    pub fn finish<T>(self, value: Option<T>) -> Result<(T, Diagnostics)> {
        if let Some(failure) = self.failure.into_inner() {
            return Err(failure);
        }
        let (mut problems, limits) = (self.problems.into_inner(), self.limits.into_inner());
        if !limits.is_empty() {
            let only_limits = !problems.is_fatal(self.strict);
            problems.extend(limits);
            let problems = problems.finish(self.strict).err();
            return Err(match problems {
                Some(Error::Input(all)) if only_limits => Error::Limits(all),
                Some(error) => error,
                None => Error::Internal("violated limits were lost".to_owned()),
            });
        }
        let warnings = problems.finish(self.strict)?;
        match value {
            Some(value) => Ok((value, warnings)),
            None => Err(Error::Internal("the input was refused without a reason".to_owned())),
        }
    }
}

fn set_help(diagnostic: &mut Diagnostic, help: String) {
    if !help.is_empty() {
        diagnostic.help(help);
    }
}
