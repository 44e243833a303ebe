//! Files that the surveys and scenes of an upload name and that are neither in it nor in the catalogue: what
//! its owner has forgotten.

use crate::names::{DATA, relative_path};
use crate::program::Program;
use crate::records::Kind;
use crate::store::{FileKind, Result, Store, UploadFile};
use std::collections::BTreeSet;

/// Maximum size of an XML file that is looked into, bytes, and maximum number of files and of attributes of
/// an element.
const MAX_BYTES: u64 = 1 << 20;
const MAX_DOCUMENTS: usize = 50;
const MAX_ATTRIBUTES: usize = 250;
/// Most names that are listed.
const MAX_LISTED: usize = 100;
/// Attributes that name files, before the `#` of an id.
const ATTRIBUTES: [&str; 5] = ["scene", "scanner", "platform", "trajectory", "value"];

/// The files that surveys and scenes of an upload name and that are not there, at most some. Looks for them
/// once, since uploads do not change.
///
/// # Errors
/// Errors of the store.
pub fn missing(store: &Store, program: &Program, id: &str, files: &[UploadFile]) -> Result<Vec<String>> {
    if let Some(known) = store.missing(id)? {
        return Ok(known);
    }
    let found = look(store, program, id, files)?;
    store.set_missing(id, &found)?;
    Ok(found)
}

fn look(store: &Store, program: &Program, id: &str, files: &[UploadFile]) -> Result<Vec<String>> {
    let known: BTreeSet<&str> = files.iter().map(|file| file.path.as_str()).collect();
    let is_described = |kind| matches!(kind, FileKind::Survey | FileKind::Scene);
    let is_document = |file: &&UploadFile| is_described(file.kind) && file.bytes <= MAX_BYTES;
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

/// The names of files in the attributes of an XML document; none of one that is malformed or has entities of
/// its own, which vlscan reports.
fn named_files(text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    // The parser compares each attribute of an element with all others.
    if text.split('<').any(|element| element.matches('=').count() > MAX_ATTRIBUTES) {
        return found;
    }
    let Ok(document) = roxmltree::Document::parse(text) else { return found };
    for element in document.descendants().filter(roxmltree::Node::is_element) {
        // Parameters of filters have other values, too; `efilepath` is an expression for several files.
        let is_path = element.attribute("key") == Some("filepath");
        for attribute in element.attributes().filter(|attribute| ATTRIBUTES.contains(&attribute.name())) {
            let path = attribute.value().split('#').next().unwrap_or_default().trim();
            let is_file = path.rsplit_once('.').is_some_and(|(stem, ending)| {
                !stem.is_empty() && ending.len() <= 8 && ending.chars().all(char::is_alphanumeric)
            });
            if is_file && (attribute.name() != "value" || is_path) && !path.contains(['*', '|', '(']) {
                found.insert(path.replace('\\', "/").trim_start_matches("./").to_owned());
            }
        }
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
            <param type="double" key="scale" value="1.25"/><leg trajectory='./t.csv'/>
            <part name="a > b" scene='b&#46;xml'/><![CDATA[<part scene="text.xml"/>]]></survey></document>"#;
        let expected = [
            "b.xml",
            "data/scanners_als.xml",
            "data/sceneparts/a&b.obj",
            "data/scenes/a.xml",
            "p.xml",
            "t.csv",
        ];
        assert_eq!(named_files(text).into_iter().collect::<Vec<_>>(), expected);
        let many: String = (0..100_000).map(|number| format!(" a{number}='x'")).collect();
        let deep = "<a scene='x.xml'>".repeat(50_000);
        let entities = "<!DOCTYPE a [<!ENTITY b 'x.xml'>]><a scene='&b;'/>";
        for damaged in ["", "<", "<a b", "<a scene='x.xml'", "<!--", "=\"", entities, &deep] {
            assert!(named_files(damaged).is_empty());
        }
        assert!(named_files(&format!("<a scene='x.xml'{many}/>")).is_empty());
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
