//! Documents, and resolution of references to assets and files.

use super::assets::{Found, Located, SPELLING_HELP, spelling_message};
use super::context::Context;
use super::fields::Fields;
use super::keys::Key;
use super::shipped::{self, BuiltIn, FILES};
use super::xml::{BUILT_IN, Element, XmlDocument};
use super::xml_limits::MAX_DOCUMENT_BYTES;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan_base::diag::{Place, ProblemKind, nearest};
use vlscan_base::error::Error;
use vlscan_base::files::reads;
use vlscan_base::recognise::{Expected, foreign};
use vlscan_tables::input::read_file;

/// Minimum memory that one byte of a scene's description takes, bytes, as XML or as a table of instances.
const MIN_MEMORY_PER_BYTE: u64 = 8;

/// The ids of the built-in scanners or platforms, with their files.
pub(super) fn built_in_ids(context: &Context, kind: &str) -> Vec<(&'static BuiltIn, String)> {
    let mut ids = Vec::new();
    for file in &FILES {
        let Some(root) = context.open(&Found::BuiltIn(file)) else { continue };
        ids.extend(root.named(kind).filter_map(|element| Some((file, element.value("id")?.to_owned()))));
    }
    ids
}

/// The full reference of the built-in scanner or platform that `id` probably means, for messages.
fn like_built_in(context: &Context, kind: &str, id: &str) -> Option<String> {
    let ids = built_in_ids(context, kind);
    let near = nearest(id, ids.iter().map(|(_, own)| own.as_str()))?;
    let (file, _) = ids.iter().find(|(_, own)| own == near)?;
    Some(format!("{}#{near}", file.path))
}

impl Context {
    /// The bytes of a description of at most `max_bytes`; an error if its contents would need more memory
    /// than the limit.
    pub fn read(&self, path: &Path, max_bytes: u64) -> std::io::Result<Vec<u8>> {
        let about = std::fs::metadata(path);
        reads::note_opened(path, &about);
        let about = about?;
        let need = if about.is_file() { about.len().saturating_mul(MIN_MEMORY_PER_BYTE) } else { 0 };
        match self.max_memory {
            Some(limit) if need > limit => {
                let message = format!(
                    "its {} bytes need about {need} bytes of memory once they are read; the limit is {limit}",
                    about.len()
                );
                Err(std::io::Error::new(std::io::ErrorKind::OutOfMemory, message))
            }
            _ => read_file(path, max_bytes),
        }
    }

    /// The root of a document, which must be a `<document>`. Problems are recorded once per document.
    pub fn open(&self, found: &Found) -> Option<Element> {
        let path = match found {
            Found::File(path) => path.clone(),
            Found::BuiltIn(file) => Path::new(BUILT_IN).join(file.path),
        };
        if let Some(known) = self.documents.borrow().get(&path) {
            return known.as_ref().map(XmlDocument::root);
        }
        let document = match found {
            Found::BuiltIn(file) => shipped::document(file).and_then(|document| self.checked(document)),
            Found::File(path) => match self.read(path, MAX_DOCUMENT_BYTES) {
                Ok(bytes) => self.parse(path, &bytes),
                Err(e) => {
                    let failure = match e.kind() {
                        std::io::ErrorKind::OutOfMemory => {
                            let message = format!("cannot read {}: {e}", path.display());
                            Error::input_of(ProblemKind::TooLarge, message)
                        }
                        _ => Error::open(path, e),
                    };
                    self.failure.borrow_mut().get_or_insert(failure);
                    None
                }
            },
        };
        self.documents.borrow_mut().insert(path, document.clone());
        document.map(|d| d.root())
    }

    /// The root of a document in memory; `name` is its name in messages.
    pub fn open_text(&self, name: &Path, text: &str) -> Option<Element> {
        let document = self.parse(name, text.as_bytes());
        self.documents.borrow_mut().insert(name.to_path_buf(), document.clone());
        document.map(|d| d.root())
    }

    fn parse(&self, path: &Path, bytes: &[u8]) -> Option<Arc<XmlDocument>> {
        if let Some(found) = foreign(path, bytes, &Expected::DOCUMENT) {
            found.report(path, &mut self.problems.borrow_mut());
            return None;
        }
        let document = XmlDocument::parse(path, bytes, &mut self.problems.borrow_mut())?;
        self.checked(document)
    }

    /// A document whose root and ids have been checked.
    fn checked(&self, document: Arc<XmlDocument>) -> Option<Arc<XmlDocument>> {
        let root = document.root();
        if root.name() != "document" {
            let message = format!("the root element is `{}`, expected `document`", root.name());
            self.error_help(root.place(), message, "put everything into one <document> element");
            return None;
        }
        let mut fields = Fields::new(self, &root);
        fields.ignore(&["schemaLocation", "noNamespaceSchemaLocation"]);
        if fields.choice("paths", &[("beside", ())], None).is_some() {
            self.assets.prefer_folder(root.folder());
        }
        fields.done(&["survey", "scene", "scanner", "platform", "scannerSettings", "platformSettings"]);
        let mut ids = HashSet::new();
        for element in root.children() {
            let Some(id) = element.value("id") else { continue };
            if !ids.insert((element.name().to_owned(), id.to_owned())) {
                let message =
                    format!("a second <{}> has the id `{id}`; the first one is used", element.name());
                self.warn(element.value_place("id"), message);
            }
        }
        Some(document)
    }

    /// The asset that an attribute refers to: `file.xml#id`, `id` or `#id` in the same document, or
    /// `file.xml` for the first asset of that kind in the file (spec input-formats §1.2).
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
                let message = format!("`{reference}` is not a valid reference: it has more than one `#`");
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

    /// The document named `file`, searched from `folder`.
    pub fn referred_document(&self, file: &str, folder: &Path, place: Option<Place>) -> Option<Element> {
        match self.assets.document(file, folder) {
            Some(Located { found, respelled }) => {
                self.warn_of_spelling(file, respelled.as_deref(), place.clone());
                if let Found::File(path) = &found {
                    self.warn_of_hidden(path, file, folder, place);
                }
                self.open(&found)
            }
            None => {
                let message = format!("cannot find the file `{file}`");
                self.not_found(place, message, self.assets.help_for_missing(file, folder));
                None
            }
        }
    }

    /// The asset of a kind in a document: by its id, or the first one without an id.
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
            let own = id.and_then(|id| {
                nearest(id, ids.iter().map(String::as_str)).map(|near| format!("did you mean `{near}`?"))
            });
            let is_instrument = matches!(kind, "scanner" | "platform");
            let shipped = || {
                let near = like_built_in(self, kind, id.filter(|_| is_instrument)?)?;
                Some(format!("did you mean `{near}` of the catalogue?"))
            };
            let help = match own.or_else(shipped) {
                Some(near) => near,
                None if ids.is_empty() => format!("the file holds no <{kind}> at all"),
                None => format!("the file holds: {}", shortened(&ids)),
            };
            let message = format!("there is {what} in {}", root.path().display());
            self.problems.borrow_mut().error(place, message).of_kind(ProblemKind::MissingEntry).help(help);
        }
        found
    }

    /// As [`Context::file`], for names in tables of instances, whose files are next to the table.
    pub fn sibling_file(&self, name: &str, folder: &Path, place: Place) -> Option<PathBuf> {
        let sibling = folder.join(name);
        if reads::is_file(&sibling) { Some(sibling) } else { self.file(name, folder, place) }
    }

    /// Warns of a file of the working directory that is read in place of a file next to the referring one.
    pub(super) fn warn_of_hidden(&self, found: &Path, name: &str, folder: &Path, place: Option<Place>) {
        let sibling = folder.join(name);
        if found == Path::new(name) && found.is_relative() && sibling.is_file() && !same_file(found, &sibling)
        {
            let message = format!("`{name}` of the working directory is read, not {}", sibling.display());
            self.warn_help(place, message, "rename one of them, or run vlscan in another directory");
        }
    }

    /// The existing file of a name, which may have no place. A missing file is an error that lists the
    /// searched folders; a file in the working directory that hides a file next to the referring one causes a
    /// warning.
    pub fn file(&self, name: &str, folder: &Path, place: impl Into<Option<Place>>) -> Option<PathBuf> {
        let place = place.into();
        let Some(Located { found, respelled }) = self.assets.file(name, folder) else {
            let help = self.assets.help_for_missing(name, folder);
            self.not_found(place, format!("cannot find the file `{name}`"), help);
            return None;
        };
        self.warn_of_spelling(name, respelled.as_deref(), place.clone());
        self.warn_of_hidden(&found, name, folder, place);
        Some(found)
    }

    /// Warns of a name that is read in another spelling.
    pub(super) fn warn_of_spelling(&self, name: &str, respelled: Option<&str>, place: Option<Place>) {
        if let Some(spelling) = respelled {
            self.warn_help(place, spelling_message(name, spelling), SPELLING_HELP);
        }
    }
}

fn same_file(one: &Path, other: &Path) -> bool {
    matches!((one.canonicalize(), other.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

fn find(root: &Element, kind: &str, id: &str) -> Option<Element> {
    root.named(kind).find(|e| e.value("id") == Some(id))
}

fn looks_like_file(reference: &str) -> bool {
    reference.contains(['/', '\\']) || reference.to_ascii_lowercase().ends_with(".xml")
}

fn shortened(ids: &[String]) -> String {
    const MAX_LISTED: usize = 12;
    let mut list = ids.iter().take(MAX_LISTED).map(|i| format!("`{i}`")).collect::<Vec<_>>().join(", ");
    if ids.len() > MAX_LISTED {
        list.push_str(&format!(" and {} more", ids.len() - MAX_LISTED));
    }
    list
}

/// Prefix of references that are always resolved in the built-in catalogue.
pub const CATALOGUE: &str = "catalogue:";

/// The element of a scanner or a platform: `file.xml#id`, `file.xml` for its first one, or the id of a
/// built-in one; `catalogue:` before a reference skips all files but the built-in ones. Files are searched
/// from `folder`; `place` is the place of the reference.
pub(super) fn find_asset(
    context: &Context,
    kind: &str,
    reference: &str,
    folder: &Path,
    place: Option<Place>,
) -> Option<Element> {
    if let Some(reference) = reference.strip_prefix(CATALOGUE) {
        return in_catalogue(context, kind, reference, place);
    }
    let is_file = looks_like_file(reference);
    let (file, id) = match reference.split_once('#') {
        Some((file, id)) => (file, Some(id)),
        None if is_file || context.assets.file(reference, folder).is_some() => (reference, None),
        None => return built_in(context, kind, reference, place),
    };
    let root = context.referred_document(file, folder, place.clone())?;
    context.pick(&root, kind, id, place)
}

/// The built-in scanner or platform of a reference: an id, or `file.xml#id`.
fn in_catalogue(context: &Context, kind: &str, reference: &str, place: Option<Place>) -> Option<Element> {
    let Some((name, id)) = reference.split_once('#') else {
        return built_in(context, kind, reference, place);
    };
    match shipped::find(name) {
        Some(file) => context.pick(&context.open(&Found::BuiltIn(file))?, kind, Some(id), place),
        None => {
            let names: Vec<&str> = FILES.iter().map(|file| file.path).collect();
            let message = format!("the catalogue has no file `{name}`");
            context.not_found(place, message, format!("it has {}", names.join(", ")));
            None
        }
    }
}

/// The built-in scanner or platform with that id, which must not be in two files of the catalogue.
fn built_in(context: &Context, kind: &str, id: &str, place: Option<Place>) -> Option<Element> {
    let ids = built_in_ids(context, kind);
    let files: Vec<_> = ids.iter().filter(|(_, own)| own == id).map(|(file, _)| *file).collect();
    if let [file] = files[..] {
        let root = context.open(&Found::BuiltIn(file))?;
        return context.pick(&root, kind, Some(id), place);
    }
    if !files.is_empty() {
        let all: Vec<String> = files.iter().map(|file| format!("{}#{id}", file.path)).collect();
        let message = format!("{} {kind}s of the catalogue have the id `{id}`", all.len());
        context.error_help(place, message, format!("write one of them in full: {}", all.join(" or ")));
        return None;
    }
    let other = if kind == "platform" { "scanner" } else { "platform" };
    let is_other = built_in_ids(context, other).iter().any(|(_, own)| own == id);
    let help = match nearest(id, ids.iter().map(|(_, own)| own.as_str())) {
        _ if is_other => format!("`{id}` is a {other}; `vlscan catalogue` lists scanners and platforms"),
        Some(near) => format!("did you mean `{near}`?"),
        None if kind == "platform" => {
            let all: Vec<&str> = ids.iter().map(|(_, own)| own.as_str()).collect();
            format!("there are {}, and file.xml#id", all.join(", "))
        }
        None => {
            "`vlscan catalogue` lists the built-in ones; refer to your own file as file.xml#id".to_owned()
        }
    };
    context.error_help(place, format!("the catalogue has no {kind} with the id `{id}`"), help);
    None
}

/// The element of a scanner or a platform that a key of TOML refers to.
pub(super) fn named_asset(fields: &mut Fields, key: Key, kind: &str) -> Option<Element> {
    let name = fields.near_name(key)?;
    find_asset(fields.context, kind, &name, fields.folder(), Some(fields.place(key)))
}
