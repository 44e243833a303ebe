//! Scanners and platforms that ship with the program.

use std::path::Path;

/// A file of the built-in catalogue.
#[derive(Debug)]
pub(super) struct BuiltIn {
    /// The path by which surveys refer to it.
    pub path: &'static str,
    /// Its content.
    pub text: &'static str,
}

/// All files of the built-in catalogue.
pub(super) const FILES: [BuiltIn; 3] = [
    BuiltIn { path: "data/scanners_als.xml", text: include_str!("../catalogue/scanners_als.xml") },
    BuiltIn { path: "data/scanners_tls.xml", text: include_str!("../catalogue/scanners_tls.xml") },
    BuiltIn { path: "data/platforms.xml", text: include_str!("../catalogue/platforms.xml") },
];

/// The built-in file for a reference such as `data/platforms.xml` or `platforms.xml`.
pub(super) fn find(reference: &str) -> Option<&'static BuiltIn> {
    let path = Path::new(reference);
    FILES.iter().find(|f| {
        path == Path::new(f.path) || path.components().count() == 1 && Path::new(f.path).ends_with(path)
    })
}
