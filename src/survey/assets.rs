//! The search path of input files (spec input-formats §8).
//!
//! The rule is the same for every kind of file: an absolute path is used as it is; a relative one is searched in the
//! working directory, then in the asset folders in their order, then in `assets/`, then in the folder of the file
//! that refers to it. The built-in catalogue comes last.

use super::shipped::{self, BuiltIn};
use regex_lite::Regex;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(Clone, Debug)]
pub(super) struct Assets {
    /// Working directory, asset folders, `assets/`; without duplicates.
    folders: Vec<PathBuf>,
}

/// The target of a reference.
#[derive(Clone, Debug)]
pub(super) enum Found {
    File(PathBuf),
    /// A file of the built-in catalogue.
    BuiltIn(&'static BuiltIn),
}

/// Why `efilepath` yields no files.
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
        let mut assets = Assets { folders: vec![PathBuf::new()] };
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

    /// The folders in search order; the folder of the referring file is the last. "." is the working directory.
    pub fn folders(&self, referring: &Path) -> Vec<PathBuf> {
        let mut all = self.clone();
        all.add(referring);
        all.folders
            .iter()
            .map(|f| if f.as_os_str().is_empty() { PathBuf::from(".") } else { f.clone() })
            .collect()
    }

    /// The first existing file of that name in the search path.
    pub fn file(&self, name: &str, referring: &Path) -> Option<PathBuf> {
        if name.is_empty() {
            return None;
        }
        let folders = self.folders.iter().map(PathBuf::as_path).chain([referring]);
        // joining an absolute path yields that path
        folders.map(|f| f.join(name)).find(|p| p.is_file() || is_pipe(p))
    }

    /// The first existing file of that name in the search path, else the built-in file of that name.
    pub fn document(&self, name: &str, referring: &Path) -> Option<Found> {
        let file = self.file(name, referring).map(Found::File);
        file.or_else(|| shipped::find(name).map(Found::BuiltIn))
    }

    /// All files whose names match the expression after the last `/` (`efilepath`), sorted by name without
    /// duplicates. A file in an earlier folder of the search path hides files of the same name in later ones; the
    /// referring file's folder is searched only when no other file matches.
    pub fn matching(&self, expression: &str, referring: &Path) -> Result<Vec<PathBuf>, NoMatch> {
        let (folder, pattern) = expression
            .rsplit_once('/')
            .map_or(("", expression), |(f, p)| (if f.is_empty() { "/" } else { f }, p));
        let pattern =
            Regex::new(&format!("^(?:{pattern})$")).map_err(|e| NoMatch::Expression(e.to_string()))?;
        let mut files = BTreeMap::new();
        for base in &self.folders {
            collect(&base.join(folder), &pattern, &mut files);
        }
        if files.is_empty() {
            collect(&referring.join(folder), &pattern, &mut files);
        }
        if files.is_empty() { Err(NoMatch::Nothing) } else { Ok(files.into_values().collect()) }
    }

    /// The folders that are searched for `name`, for messages.
    pub fn searched(&self, name: &str, referring: &Path) -> String {
        if let Some(folder) = self.folders(referring).iter().map(|f| f.join(name)).find(|path| path.is_dir())
        {
            let survey = folder.join("survey.xml");
            let file =
                if survey.is_file() { survey.display().to_string() } else { "a file in it".to_owned() };
            return format!("{} is a folder; name {file}", folder.display());
        }
        if Path::new(name).is_absolute() {
            return "an absolute path is not searched for elsewhere".to_owned();
        }
        let folders: Vec<String> = self.folders(referring).iter().map(|f| f.display().to_string()).collect();
        format!("searched in: {}", folders.join(", "))
    }
}

fn identity(folder: &Path) -> Option<PathBuf> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    folder.canonicalize().ok()
}

/// Named pipes can be read like files (`<(command)` of a shell).
#[cfg(unix)]
fn is_pipe(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt as _;
    path.metadata().is_ok_and(|m| m.file_type().is_fifo())
}

#[cfg(not(unix))]
fn is_pipe(_: &Path) -> bool {
    false
}

fn collect(folder: &Path, pattern: &Regex, files: &mut BTreeMap<String, PathBuf>) {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let Ok(entries) = folder.read_dir() else { return };
    for entry in entries.flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if pattern.is_match(&name) && entry.path().is_file() {
            files.entry(name).or_insert_with(|| entry.path());
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
        assert_eq!(assets.file("a.obj", &at("here")), Some(at("one/a.obj")));
        assert_eq!(assets.file("b.obj", &at("here")), Some(at("two/b.obj")));
        assert_eq!(assets.file("c.obj", &at("here")), Some(at("here/c.obj")));
        assert_eq!(assets.file("d.obj", &at("here")), None);
        assert_eq!(assets.file("", &at("here")), None);
        assert_eq!(assets.file(at("two/b.obj").to_str().unwrap(), &at("here")), Some(at("two/b.obj")));
        assert_eq!(assets.folders(&at("here")).len(), 5);
        assert!(matches!(assets.document("data/scanners_tls.xml", &at("here")), Some(Found::BuiltIn(_))));
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
        let found = assets.matching(r"trees/.*\.obj", Path::new("")).unwrap();
        let names: Vec<_> =
            found.iter().map(|p| p.strip_prefix(t.path()).unwrap().to_str().unwrap()).collect();
        assert_eq!(names, ["one/trees/a.obj", "one/trees/b.obj", "two/trees/c.obj"]);
        assert!(matches!(assets.matching("trees/(", Path::new("")), Err(NoMatch::Expression(_))));
        assert!(matches!(assets.matching("nowhere/x", Path::new("")), Err(NoMatch::Nothing)));
    }
}
