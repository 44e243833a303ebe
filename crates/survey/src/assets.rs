//! The search path of input files (spec input-formats §8).
//!
//! The rule is the same for every kind of file: an absolute path is used unchanged; a relative one is
//! searched in the working directory, then in the asset folders in their order, then in `assets/`, then in
//! the folder of the file that refers to it. The built-in catalogue comes last. A name with `\` that denotes
//! no file is searched again with `/`, so that files written on Windows can be read elsewhere. Documents with
//! `paths="beside"`, as vlscan writes them, are exempt: their files are searched in their own folder first,
//! not in the working directory.

use super::shipped::{self, BuiltIn};
use super::toml::words::hint_for_name;
use regex_lite::Regex;
use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use vlscan_base::diag::nearest;
use vlscan_base::files::reads;

#[derive(Clone, Debug)]
pub(super) struct Assets {
    /// Working directory, asset folders, `assets/`; without duplicates.
    folders: Vec<PathBuf>,
    /// Folders of documents that name files next to them.
    preferred: RefCell<BTreeSet<PathBuf>>,
}

/// The target of a reference.
#[derive(Clone, Debug)]
pub(super) enum Found {
    File(PathBuf),
    /// A file of the built-in catalogue.
    BuiltIn(&'static BuiltIn),
}

/// Object that a name denotes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Located<T> {
    pub found: T,
    /// The spelling in the file system, if it differs from the requested one.
    pub respelled: Option<String>,
}

/// Reason why `efilepath` yields no files.
#[derive(Debug)]
pub(super) enum NoMatch {
    /// The regular expression is invalid.
    Expression(String),
    /// No file matches.
    Nothing,
}

impl Assets {
    /// The search path with the user's asset folders.
    pub fn new(user: &[PathBuf]) -> Assets {
        let mut assets = Assets { folders: vec![PathBuf::new()], preferred: RefCell::default() };
        user.iter().for_each(|folder| assets.add(folder));
        assets.add(Path::new("assets"));
        assets
    }

    fn add(&mut self, folder: &Path) {
        let same = |a: &Path| match (identity(a), identity(folder)) {
            (Some(a), Some(b)) => a == b,
            _ => a == folder,
        };
        if !self.folders.iter().any(|f| same(f)) {
            self.folders.push(folder.to_path_buf());
        }
    }

    /// The folders in search order; the folder of the referring file is the last. "." is the working
    /// directory.
    pub fn folders(&self, referring: &Path) -> Vec<PathBuf> {
        let mut all = self.clone();
        all.add(referring);
        all.folders
            .iter()
            .map(|f| if f.as_os_str().is_empty() { PathBuf::from(".") } else { f.clone() })
            .collect()
    }

    /// Searches `folder` first for the files that documents in it name.
    pub fn prefer_folder(&self, folder: &Path) {
        self.preferred.borrow_mut().insert(folder.to_path_buf());
    }

    fn is_preferred(&self, folder: &Path) -> bool {
        self.preferred.borrow().contains(folder)
    }

    /// The first existing file of that name in the search path.
    pub fn file(&self, name: &str, referring: &Path) -> Option<Located<PathBuf>> {
        located(name, |name| self.exact_file(name, referring))
    }

    fn exact_file(&self, name: &str, referring: &Path) -> Option<PathBuf> {
        if name.is_empty() {
            return None;
        }
        let first = self.is_preferred(referring).then_some(referring);
        let folders = first.into_iter().chain(self.folders.iter().map(PathBuf::as_path)).chain([referring]);
        // Joining an absolute path yields that path. Named pipes can be read like files (`<(command)` of a
        // shell).
        folders.map(|f| f.join(name)).find(|p| reads::is_file(p) || reads::is_pipe(p))
    }

    /// The first existing folder of that name in the search path.
    pub fn folder(&self, name: &str, referring: &Path) -> Option<PathBuf> {
        let is_named = |name: &str| !name.is_empty();
        let first = self.is_preferred(referring).then_some(referring);
        let folders =
            || first.into_iter().chain(self.folders.iter().map(PathBuf::as_path)).chain([referring]);
        let find = |name: &str| folders().map(|f| f.join(name)).find(|p| is_named(name) && p.is_dir());
        located(name, find).map(|located| located.found)
    }

    /// The first existing file of that name in the search path, else the built-in file of that name.
    pub fn document(&self, name: &str, referring: &Path) -> Option<Located<Found>> {
        located(name, |name| {
            let file = self.exact_file(name, referring).map(Found::File);
            file.or_else(|| shipped::find(name).map(Found::BuiltIn))
        })
    }

    /// All files whose names match the expression after the last `/` (`efilepath`), sorted by name without
    /// duplicates. A file in an earlier folder of the search path hides files of the same name in later ones;
    /// the referring file's folder is searched only when no other file matches.
    pub fn matching(&self, expression: &str, referring: &Path) -> Result<Located<Vec<PathBuf>>, NoMatch> {
        let problem = match self.exactly_matching(expression, referring) {
            Ok(found) => return Ok(Located { found, respelled: None }),
            Err(problem) => problem,
        };
        // A `\` of an expression separates folders or escapes a character: the longest folder with matching
        // files is used.
        let mut separators = expression.match_indices('\\').map(|(at, _)| at).rev();
        separators
            .find_map(|at| {
                let spelling = format!("{}/{}", slashes(&expression[..at]), &expression[at + 1..]);
                let found = self.exactly_matching(&spelling, referring).ok()?;
                Some(Located { found, respelled: Some(spelling) })
            })
            .ok_or(problem)
    }

    fn exactly_matching(&self, expression: &str, referring: &Path) -> Result<Vec<PathBuf>, NoMatch> {
        let (folder, pattern) = expression
            .rsplit_once('/')
            .map_or(("", expression), |(f, p)| (if f.is_empty() { "/" } else { f }, p));
        let pattern =
            Regex::new(&format!("^(?:{pattern})$")).map_err(|e| NoMatch::Expression(e.to_string()))?;
        let mut files = BTreeMap::new();
        if self.is_preferred(referring) {
            collect(&referring.join(folder), &pattern, &mut files);
        }
        for base in &self.folders {
            collect(&base.join(folder), &pattern, &mut files);
        }
        if files.is_empty() {
            collect(&referring.join(folder), &pattern, &mut files);
        }
        if files.is_empty() { Err(NoMatch::Nothing) } else { Ok(files.into_values().collect()) }
    }

    /// The likely intended name if `name` matches no file: trimmed, in another case, or the nearest name in
    /// the same folder.
    fn meant(&self, name: &str, referring: &Path) -> Option<String> {
        let spelling = slashes(name.trim());
        if spelling != name && self.exact_file(&spelling, referring).is_some() {
            return Some(spelling.into_owned());
        }
        let bases = || self.folders.iter().map(PathBuf::as_path).chain([referring]);
        let in_other_case = bases().find_map(|base| in_any_case(base, Path::new(&*spelling)));
        in_other_case.or_else(|| bases().find_map(|base| near_name(base, Path::new(&*spelling))))
    }

    /// The help for a name that matches no file: how to write Windows paths, the likely intended name, and
    /// the searched folders.
    pub fn help_for_missing(&self, name: &str, referring: &Path) -> String {
        let hint = hint_for_name(name);
        if hint.is_empty() { self.searched(name, referring) } else { hint }
    }

    /// The likely intended name and the folders searched for `name`, for messages.
    pub fn searched(&self, name: &str, referring: &Path) -> String {
        let searched = self.searched_folders(name, referring);
        match self.meant(name, referring) {
            Some(meant) => format!("did you mean `{meant}`? ({searched})"),
            None => searched,
        }
    }

    fn searched_folders(&self, name: &str, referring: &Path) -> String {
        if let Some(folder) = self.folders(referring).iter().map(|f| f.join(name)).find(|path| path.is_dir())
        {
            let survey = folder.join("survey.xml");
            let file =
                if survey.is_file() { survey.display().to_string() } else { "a file in it".to_owned() };
            return format!("{} is a folder; name {file}", folder.display());
        }
        if Path::new(name).is_absolute() {
            return "absolute paths are not searched for in other folders".to_owned();
        }
        let folders: Vec<String> = self.folders(referring).iter().map(|f| f.display().to_string()).collect();
        format!("searched in: {}", folders.join(", "))
    }
}

/// Result of `find` for the name as written, or else with `/` in place of `\`.
fn located<T>(name: &str, find: impl Fn(&str) -> Option<T>) -> Option<Located<T>> {
    if let Some(found) = find(name) {
        return Some(Located { found, respelled: None });
    }
    let spelling = slashes(name);
    let found = if spelling == name { None } else { find(&spelling) };
    found.map(|found| Located { found, respelled: Some(spelling.into_owned()) })
}

/// Help for a name with backslashes.
pub(super) const SPELLING_HELP: &str = "write / between folders; every system reads it";

/// The warning of a name that is read in another spelling.
pub(super) fn spelling_message(name: &str, spelling: &str) -> String {
    format!("there is no file `{name}`; `{spelling}` is read")
}

/// A path with `/` between its folders.
pub(super) fn slashes(name: &str) -> Cow<'_, str> {
    if name.contains('\\') { Cow::Owned(name.replace('\\', "/")) } else { Cow::Borrowed(name) }
}

/// The name of an existing file in `base` that equals `name` except for case.
fn in_any_case(base: &Path, name: &Path) -> Option<String> {
    let mut path = PathBuf::new();
    for component in name.components() {
        let requested = component.as_os_str();
        if base.join(&path).join(requested).exists() {
            path.push(requested);
            continue;
        }
        let requested = requested.to_string_lossy().to_lowercase();
        let found = names_in(&base.join(&path)).into_iter().find(|own| own.to_lowercase() == requested)?;
        path.push(found);
    }
    base.join(&path).is_file().then(|| path.to_string_lossy().into_owned())
}

/// The name of an existing file in the folder of `name` that is similar and has the same extension.
fn near_name(base: &Path, name: &Path) -> Option<String> {
    let folder = name.parent()?;
    let parts = |name: &Path| {
        let text = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
        (text(name.file_stem()), text(name.extension()).to_lowercase())
    };
    let (stem, ending) = parts(name);
    let names = names_in(&base.join(folder));
    let alike: Vec<(String, &String)> = names
        .iter()
        .map(|own| (parts(Path::new(own)), own))
        .filter(|(own, _)| own.1 == ending)
        .map(|(own, name)| (own.0, name))
        .collect();
    let near = nearest(&stem, alike.iter().map(|(stem, _)| stem.as_str()))?;
    let found = folder.join(alike.iter().find(|(stem, _)| stem == near)?.1);
    base.join(&found).is_file().then(|| found.to_string_lossy().into_owned())
}

/// The sorted names in a folder; empty if the folder cannot be read.
fn names_in(folder: &Path) -> Vec<String> {
    let paths = reads::list(folder).unwrap_or_default().into_iter().take(MAX_LISTED_NAMES);
    paths.map(|path| path.file_name().unwrap_or_default().to_string_lossy().into_owned()).collect()
}

/// Maximum number of names in a folder that are searched for a similar one.
const MAX_LISTED_NAMES: usize = 10_000;

fn identity(folder: &Path) -> Option<PathBuf> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    folder.canonicalize().ok()
}

fn collect(folder: &Path, pattern: &Regex, files: &mut BTreeMap<String, PathBuf>) {
    for path in reads::list(folder).into_iter().flatten() {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if pattern.is_match(&name) && path.is_file() {
            files.entry(name).or_insert(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree(files: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for file in files {
            let path = folder.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, file).unwrap();
        }
        folder
    }

    #[test]
    fn folders_are_searched_in_order() {
        let t = tree(&["one/a.obj", "two/a.obj", "two/b.obj", "here/c.obj"]);
        let at = |p: &str| t.path().join(p);
        let assets = Assets::new(&[at("one"), at("two"), at("one")]);
        let found = |name: &str| assets.file(name, &at("here")).map(|located| located.found);
        assert_eq!(found("a.obj"), Some(at("one/a.obj")));
        assert_eq!(found("b.obj"), Some(at("two/b.obj")));
        assert_eq!(found("c.obj"), Some(at("here/c.obj")));
        assert_eq!((found("d.obj"), found("")), (None, None));
        assert_eq!(found(at("two/b.obj").to_str().unwrap()), Some(at("two/b.obj")));
        assert_eq!(assets.folders(&at("here")).len(), 5);
        for name in ["data/scanners_tls.xml", r"data\scanners_tls.xml", r".\data\scanners_tls.xml"] {
            let located = assets.document(name, &at("here")).unwrap();
            assert!(matches!(located.found, Found::BuiltIn(_)));
            assert_eq!(located.respelled.is_some(), name.contains('\\'), "{name}");
        }
    }

    #[test]
    fn backslashes_separate_folders_where_nothing_has_them_in_its_name() {
        let t = tree(&["my data/parts/a.obj", "my data/parts/b.obj", r"my data\own.obj"]);
        let assets = Assets::new(&[t.path().to_path_buf()]);
        let here = Path::new("");
        for name in [r"my data\parts\a.obj", r".\my data\parts\a.obj", r"my data/parts\a.obj"] {
            let located = assets.file(name, here).unwrap();
            assert!(located.found.ends_with("my data/parts/a.obj"), "{located:?}");
            assert_eq!(located.respelled.as_deref(), Some(&*name.replace('\\', "/")));
        }
        let own = assets.file(r"my data\own.obj", here).unwrap();
        assert_eq!((own.found.is_file(), own.respelled), (true, None));
        // Invalid as an expression: Unicode classes are not supported.
        let named = assets.matching(r"my data\parts\[a].obj", here).unwrap();
        assert_eq!((named.found.len(), named.respelled.as_deref()), (1, Some("my data/parts/[a].obj")));
        let all = assets.matching(r"my data\parts\.*\.obj", here).unwrap();
        assert_eq!((all.found.len(), all.respelled.as_deref()), (2, Some(r"my data/parts/.*\.obj")));
        assert_eq!(assets.matching(r"my data/parts/a\.obj", here).unwrap().respelled, None);
    }

    #[test]
    fn a_file_that_is_not_found_may_have_a_name_like_it() {
        let t = tree(&["Parts/Ground.obj", "Parts/cube.obj"]);
        let assets = Assets::new(&[t.path().to_path_buf()]);
        for (name, meant) in [
            ("parts/ground.obj", Some("Parts/Ground.obj")),
            (r"PARTS\ground.OBJ", Some("Parts/Ground.obj")),
            (" Parts/cube.obj\u{a0}", Some("Parts/cube.obj")),
            ("Parts/cubes.obj", Some("Parts/cube.obj")),
            ("Parts/house.obj", None),
        ] {
            assert_eq!(assets.meant(name, Path::new("")).as_deref(), meant, "{name}");
        }
    }

    #[test]
    fn documents_of_ours_name_files_beside_them() {
        let t = tree(&["one/a.obj", "here/a.obj", "one/trees/a.obj", "here/trees/a.obj", "one/b.obj"]);
        let at = |p: &str| t.path().join(p);
        let assets = Assets::new(&[at("one")]);
        assets.prefer_folder(&at("here"));
        let found = |name: &str, folder: &str| assets.file(name, &at(folder)).map(|located| located.found);
        assert_eq!(found("a.obj", "here"), Some(at("here/a.obj")));
        assert_eq!(found("b.obj", "here"), Some(at("one/b.obj")));
        assert_eq!(found("a.obj", "two"), Some(at("one/a.obj")), "other folders are as they were");
        assert_eq!(assets.matching(r"trees/.*", &at("here")).unwrap().found, [at("here/trees/a.obj")]);
    }

    #[test]
    fn expressions_give_sorted_files_once() {
        let t = tree(&[
            "one/trees/b.obj",
            "one/trees/a.obj",
            "one/trees/a.obj.txt",
            "two/trees/a.obj",
            "two/trees/c.obj",
        ]);
        let assets = Assets::new(&[t.path().join("one"), t.path().join("two")]);
        let found = assets.matching(r"trees/.*\.obj", Path::new("")).unwrap().found;
        let names: Vec<_> =
            found.iter().map(|p| p.strip_prefix(t.path()).unwrap().to_str().unwrap()).collect();
        assert_eq!(names, ["one/trees/a.obj", "one/trees/b.obj", "two/trees/c.obj"]);
        assert!(matches!(assets.matching("trees/(", Path::new("")), Err(NoMatch::Expression(_))));
        assert!(matches!(assets.matching("nowhere/x", Path::new("")), Err(NoMatch::Nothing)));
    }
}
