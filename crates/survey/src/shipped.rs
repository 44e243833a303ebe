//! The files of the built-in catalogue.

use std::path::{Component, Path, PathBuf};

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

/// The built-in file for a reference such as `data/platforms.xml` or `platforms.xml`.
pub(super) fn find(reference: &str) -> Option<&'static BuiltIn> {
    // a leading "./" is not part of the path
    let path: PathBuf = Path::new(reference).components().filter(|c| *c != Component::CurDir).collect();
    let only_name = path.components().count() == 1;
    FILES.iter().find(|f| path == Path::new(f.path) || only_name && Path::new(f.path).ends_with(&path))
}
