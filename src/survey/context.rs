//! What one run of a reader knows: options, documents already opened, problems met so far.

use super::PoseChoices;
use super::assets::{Assets, Found};
use super::fields::Fields;
use super::xml::{Document, Element};
use crate::diag::{Diagnostic, Diagnostics, Place, nearest};
use crate::error::{Error, Result};
use std::cell::RefCell;
use std::collections::HashMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Bytes of memory that a byte of a scene's description takes at least, as XML or as a table of instances.
const PER_BYTE: u64 = 8;

/// How input files are read.
#[derive(Clone, Debug, Default)]
pub struct ReadOptions {
    /// Folders in which files are looked for, after the working directory (`--assets`).
    pub assets: Vec<PathBuf>,
    /// Warnings are errors.
    pub strict: bool,
    /// Replaces the scene of the survey.
    pub scene: Option<String>,
    /// Replaces the platform of the survey ([`super::Survey::fly`]) before the survey is checked as a whole, or changes
    /// the trajectory of a pipeline.
    pub trajectory: PoseChoices,
    /// Most bytes that the survey and its scene may need. Files of which it is certain that they need more are refused
    /// before they are read.
    pub max_memory: Option<u64>,
}

/// State of one run of a reader. Problems are collected so that all of them are reported at once.
#[derive(Debug)]
pub(super) struct Context {
    pub assets: Assets,
    /// The scene that replaces that of the survey.
    pub scene: Option<String>,
    strict: bool,
    max_memory: Option<u64>,
    problems: RefCell<Diagnostics>,
    limits: RefCell<Diagnostics>,
    failure: RefCell<Option<Error>>,
    documents: RefCell<HashMap<PathBuf, Option<Rc<Document>>>>,
}

impl Context {
    pub fn new(options: &ReadOptions) -> Context {
        Context {
            assets: Assets::new(&options.assets),
            scene: options.scene.clone(),
            strict: options.strict,
            max_memory: options.max_memory,
            problems: RefCell::default(),
            limits: RefCell::default(),
            failure: RefCell::default(),
            documents: RefCell::default(),
        }
    }

    /// Takes over problems met before.
    pub fn take(&self, problems: Diagnostics) {
        self.problems.borrow_mut().extend(problems);
    }

    /// Records a problem that ends the run.
    pub fn error(&self, place: Place, message: impl Into<String>) {
        self.problems.borrow_mut().error(Some(place), message);
    }

    /// Records a problem that ends the run, with what can be done about it.
    pub fn error_help(
        &self,
        place: impl Into<Option<Place>>,
        message: impl Into<String>,
        help: impl Into<String>,
    ) {
        set_help(self.problems.borrow_mut().error(place.into(), message), help.into());
    }

    /// Records a value that is replaced or ignored.
    pub fn warn(&self, place: Place, message: impl Into<String>) {
        self.problems.borrow_mut().warn(Some(place), message);
    }

    /// Records a value that is replaced or ignored, with what can be done about it.
    pub fn warn_help(&self, place: Place, message: impl Into<String>, help: impl Into<String>) {
        set_help(self.problems.borrow_mut().warn(Some(place), message), help.into());
    }

    /// Records a violated limit, which has its own exit status.
    pub fn limit(&self, place: Option<Place>, message: impl Into<String>, help: impl Into<String>) {
        set_help(self.limits.borrow_mut().error(place, message), help.into());
    }

    /// Whether errors have been recorded, so that what is built on the values may be left out.
    pub fn failed(&self) -> bool {
        self.failure.borrow().is_some() || self.problems.borrow().is_fatal(false)
    }

    /// The value that was read with the warnings to be shown, or all problems.
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

    /// The bytes of a description, unless what is in them would take more memory than is allowed.
    pub fn read(&self, path: &Path) -> std::io::Result<Vec<u8>> {
        let mut file = std::fs::File::open(path)?;
        let about = file.metadata()?;
        let need = if about.is_file() { about.len().saturating_mul(PER_BYTE) } else { 0 };
        match self.max_memory {
            Some(limit) if need > limit => {
                let message = format!(
                    "its {} bytes need about {need} bytes of memory once they are read; the limit is {limit}",
                    about.len()
                );
                Err(std::io::Error::new(std::io::ErrorKind::OutOfMemory, message))
            }
            _ => {
                let mut bytes = Vec::new();
                file.read_to_end(&mut bytes).map(|_| bytes)
            }
        }
    }

    /// The root of the document that was found, which must be a `<document>`. Problems are recorded once.
    pub fn open(&self, found: &Found) -> Option<Element> {
        let path = match found {
            Found::File(path) => path.clone(),
            Found::BuiltIn(file) => Path::new("<built in>").join(file.path),
        };
        if let Some(known) = self.documents.borrow().get(&path) {
            return known.as_ref().map(Document::root);
        }
        let document = match found {
            Found::BuiltIn(file) => self.parse(&path, file.text.as_bytes()),
            Found::File(path) => match self.read(path) {
                Ok(bytes) => self.parse(path, &bytes),
                Err(e) => {
                    let failure = match e.kind() {
                        std::io::ErrorKind::OutOfMemory => {
                            Error::input(format!("cannot read {}: {e}", path.display()))
                        }
                        _ => Error::io("read", path, e),
                    };
                    self.failure.borrow_mut().get_or_insert(failure);
                    None
                }
            },
        };
        self.documents.borrow_mut().insert(path, document.clone());
        document.map(|d| d.root())
    }

    fn parse(&self, path: &Path, bytes: &[u8]) -> Option<Rc<Document>> {
        let document = Document::parse(path, bytes, &mut self.problems.borrow_mut())?;
        let root = document.root();
        if root.name() != "document" {
            let message = format!("the root element is `{}`, expected `document`", root.name());
            self.error_help(root.place(), message, "put everything into one <document> element");
            return None;
        }
        let mut fields = Fields::new(self, &root);
        fields.ignore(&["schemaLocation", "noNamespaceSchemaLocation"]);
        fields.done(&["survey", "scene", "scanner", "platform", "scannerSettings", "platformSettings"]);
        Some(document)
    }

    /// The asset that an attribute refers to: `file.xml#id`, `id` or `#id` in the same document, or `file.xml` for the
    /// first asset of that kind in it (spec input-formats §1.2).
    pub fn asset(&self, kind: &str, from: &Element, attribute: &str) -> Option<Element> {
        let reference = from.value(attribute)?;
        let place = || from.value_place(attribute);
        let (file, id) = match reference.matches('#').count() {
            0 if find(&from.root(), kind, reference).is_some() => (None, Some(reference)),
            0 if looks_like_file(reference) => (Some(reference), None),
            0 => (None, Some(reference)),
            1 => {
                let (file, id) = reference.split_once('#').unwrap_or((reference, ""));
                ((!file.is_empty()).then_some(file), Some(id))
            }
            _ => {
                let message = format!("`{reference}` is no reference: it has more than one `#`");
                self.error_help(place(), message, "write file.xml#id");
                return None;
            }
        };
        let root = match file {
            None => from.root(),
            Some(file) => self.referred_document(file, from.folder(), Some(place()))?,
        };
        self.pick(&root, kind, id, Some(place()))
    }

    /// The document that `file` names, looked for from `folder`.
    pub fn referred_document(&self, file: &str, folder: &Path, place: Option<Place>) -> Option<Element> {
        match self.assets.document(file, folder) {
            Some(found) => self.open(&found),
            None => {
                let message = format!("cannot find the file `{file}`");
                self.error_help(place, message, self.assets.searched(file, folder));
                None
            }
        }
    }

    /// The asset of a kind in a document: that with the id, or the first one.
    pub fn pick(
        &self,
        root: &Element,
        kind: &str,
        id: Option<&str>,
        place: Option<Place>,
    ) -> Option<Element> {
        let found = match id {
            Some(id) => find(root, kind, id),
            None => root.child(kind),
        };
        if found.is_none() {
            let what = id.map_or(format!("no <{kind}>"), |id| format!("no <{kind}> with the id `{id}`"));
            let ids: Vec<String> =
                root.named(kind).filter_map(|e| e.value("id").map(str::to_owned)).collect();
            let help = match id.and_then(|id| nearest(id, ids.iter().map(String::as_str))) {
                Some(near) => format!("did you mean `{near}`?"),
                None if ids.is_empty() => format!("the file holds no <{kind}> at all"),
                None => format!("the file holds: {}", shortened(&ids)),
            };
            self.error_help(place, format!("there is {what} in {}", root.path().display()), help);
        }
        found
    }

    /// The existing file that an attribute names; a missing one is an error that lists the folders searched.
    pub fn file(&self, name: &str, folder: &Path, place: Place) -> Option<PathBuf> {
        let found = self.assets.file(name, folder);
        if found.is_none() {
            self.error_help(
                place,
                format!("cannot find the file `{name}`"),
                self.assets.searched(name, folder),
            );
        }
        found
    }
}

fn set_help(diagnostic: &mut Diagnostic, help: String) {
    if !help.is_empty() {
        diagnostic.help(help);
    }
}

fn find(root: &Element, kind: &str, id: &str) -> Option<Element> {
    root.named(kind).find(|e| e.value("id") == Some(id))
}

fn looks_like_file(reference: &str) -> bool {
    reference.contains('/') || reference.to_ascii_lowercase().ends_with(".xml")
}

fn shortened(ids: &[String]) -> String {
    const MANY: usize = 12;
    let mut list = ids.iter().take(MANY).map(|i| format!("`{i}`")).collect::<Vec<_>>().join(", ");
    if ids.len() > MANY {
        list.push_str(&format!(" and {} more", ids.len() - MANY));
    }
    list
}
