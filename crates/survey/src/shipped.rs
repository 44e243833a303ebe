//! The files of the built-in catalogue.

use super::xml::{BUILT_IN, XmlDocument};
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, OnceLock};
use vlscan_base::diag::Diagnostics;

#[derive(Debug)]
pub(super) struct BuiltIn {
    /// The path by which surveys refer to the file.
    pub path: &'static str,
    pub text: &'static str,
}

pub(super) const FILES: [BuiltIn; 3] = [
    BuiltIn { path: "data/scanners_als.xml", text: include_str!("../catalogue/scanners_als.xml") },
    BuiltIn { path: "data/scanners_tls.xml", text: include_str!("../catalogue/scanners_tls.xml") },
    BuiltIn { path: "data/platforms.xml", text: include_str!("../catalogue/platforms.xml") },
];

/// The documents of [`FILES`] that were needed so far.
static DOCUMENTS: [OnceLock<Option<Arc<XmlDocument>>>; FILES.len()] =
    [const { OnceLock::new() }; FILES.len()];

/// The document of a built-in file, which a program parses once: small runs would take as long as the file.
pub(super) fn document(file: &BuiltIn) -> Option<Arc<XmlDocument>> {
    let index = FILES.iter().position(|known| known.path == file.path)?;
    let path = Path::new(BUILT_IN).join(file.path);
    let parse = || XmlDocument::parse(&path, file.text.as_bytes(), &mut Diagnostics::default());
    DOCUMENTS[index].get_or_init(parse).clone()
}

/// The built-in file for a reference such as `data/platforms.xml` or `platforms.xml`.
pub(super) fn find(reference: &str) -> Option<&'static BuiltIn> {
    // a leading "./" is not part of the path
    let path: PathBuf = Path::new(reference).components().filter(|c| *c != Component::CurDir).collect();
    let only_name = path.components().count() == 1;
    FILES.iter().find(|f| path == Path::new(f.path) || only_name && Path::new(f.path).ends_with(&path))
}
