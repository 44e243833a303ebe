//! Files that the surveys and scenes of an upload name and that are neither in it nor in the catalogue: what
//! its owner has forgotten.

use crate::names::{DATA, relative_path};
use crate::program::Program;
use crate::records::Kind;
use crate::store::{FileKind, Result, Store, UploadFile};
use std::collections::BTreeSet;

/// Largest XML file that is looked into, bytes, and most of them.
const MAX_BYTES: u64 = 1 << 20;
const MAX_DOCUMENTS: usize = 50;
/// Most names that are listed.
const MAX_LISTED: usize = 100;
/// Attributes that name files, before the `#` of an id.
const ATTRIBUTES: [&str; 5] = ["scene", "scanner", "platform", "trajectory", "value"];

/// The files that surveys and scenes of an upload name and that are not there, at most some.
///
/// # Errors
/// Errors of the store.
pub fn missing(store: &Store, program: &Program, id: &str, files: &[UploadFile]) -> Result<Vec<String>> {
    let known: BTreeSet<&str> = files.iter().map(|file| file.path.as_str()).collect();
    let is_document = |file: &&UploadFile| file.kind != FileKind::Other && file.bytes <= MAX_BYTES;
    let mut found = BTreeSet::new();
    for file in files.iter().filter(is_document).take(MAX_DOCUMENTS) {
        let Some(bytes) = store.read(Kind::Upload, id, &file.path, MAX_BYTES)? else { continue };
        let text = String::from_utf8_lossy(&bytes);
        let folder = file.path.rsplit_once('/').map_or("", |(folder, _)| folder);
        for name in named_files(&text) {
            let is_of_catalogue = name.starts_with(&format!("{DATA}/")) && program.has_file(&name);
            if !is_of_catalogue && !is_there(&name, folder, &known) {
                found.insert(name);
            }
            if found.len() >= MAX_LISTED {
                return Ok(found.into_iter().collect());
            }
        }
    }
    Ok(found.into_iter().collect())
}

/// True if a name leads to a file in the folder of the document or in one above it.
fn is_there(name: &str, folder: &str, known: &BTreeSet<&str>) -> bool {
    // What leads elsewhere cannot be judged here.
    let Some(path) = relative_path(name) else { return true };
    let path = path.to_string_lossy().replace('\\', "/");
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    loop {
        let whole = parts.iter().copied().chain([path.as_str()]).collect::<Vec<_>>().join("/");
        if known.contains(whole.as_str()) {
            return true;
        }
        if parts.pop().is_none() {
            return false;
        }
    }
}

/// The names of files in the attributes of an XML document, without comments.
fn named_files(text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for element in without_comments(text).split('<') {
        let element = element.split('>').next().unwrap_or_default();
        let attributes = attributes(element);
        // Parameters of filters have other values, too; `efilepath` is an expression for several files.
        let is_path = attributes.iter().any(|(name, value)| *name == "key" && *value == "filepath");
        for (name, value) in attributes.iter().filter(|(name, _)| ATTRIBUTES.contains(name)) {
            let path = value.split('#').next().unwrap_or_default().trim();
            let is_file = path.rsplit_once('.').is_some_and(|(stem, ending)| {
                !stem.is_empty() && ending.len() <= 8 && ending.chars().all(char::is_alphanumeric)
            });
            if is_file && (*name != "value" || is_path) && !path.contains(['*', '|', '(']) {
                let path = path.replace('\\', "/").replace("&amp;", "&");
                found.insert(path.trim_start_matches("./").to_owned());
            }
        }
    }
    found
}

fn without_comments(text: &str) -> String {
    let mut parts = text.split("<!--");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |text, part| text + part.split_once("-->").map_or("", |(_, rest)| rest))
}

/// The attributes of an element: names and values.
fn attributes(element: &str) -> Vec<(&str, &str)> {
    let mut found = Vec::new();
    let mut rest = element;
    while let Some((before, after)) = rest.split_once('=') {
        let name = before.trim_end().rsplit(|c: char| c.is_whitespace()).next().unwrap_or_default();
        let after = after.trim_start();
        let Some(quote) = after.chars().next().filter(|c| matches!(c, '"' | '\'')) else { break };
        let Some((value, behind)) = after[1..].split_once(quote) else { break };
        found.push((name, value));
        rest = behind;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_are_found_in_attributes() {
        let text = r#"<document><!-- <part scene="old.xml"/> -->
            <survey name="v1.2" scene="data/scenes/a.xml#a" scanner = 'data/scanners_als.xml#x' platform="p.xml#y">
            <param type="string" key="filepath" value="data\sceneparts\a&amp;b.obj" /><param key="efilepath" value="b.*\.obj"/>
            <param type="double" key="scale" value="1.25"/><leg trajectory='./t.csv'/></survey"#;
        let expected =
            ["data/scanners_als.xml", "data/sceneparts/a&b.obj", "data/scenes/a.xml", "p.xml", "t.csv"];
        assert_eq!(named_files(text).into_iter().collect::<Vec<_>>(), expected);
        for damaged in ["", "<", "<a b", "<a b=", "<a b='", "<a =''", "<!--", "=\"", "<a b=\"ä"] {
            named_files(damaged);
        }
    }

    #[test]
    fn files_are_found_in_folders_above_the_document() {
        let known = BTreeSet::from(["a/data/scenes/x.xml", "a/data/surveys/y.csv", "z.obj"]);
        let is_there = |name: &str| is_there(name, "a/data/surveys", &known);
        for name in ["data/scenes/x.xml", "y.csv", "z.obj", "scenes/x.xml", "/etc/passwd", "../x"] {
            assert!(is_there(name), "{name}");
        }
        for name in ["x.xml", "data/scenes/y.xml", "a/z.obj"] {
            assert!(!is_there(name), "{name}");
        }
    }
}
