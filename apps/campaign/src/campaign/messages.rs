//! Messages of cells, which do not depend on where a campaign is computed.

use std::path::{MAIN_SEPARATOR, Path};
use vlscan_base::error::Error;
use vlscan_render::Render as _;

/// True if an error says something about the machine and nothing about the cell: a full disk, a file that
/// cannot be written.
pub fn is_of_machine(error: &Error) -> bool {
    use std::io::ErrorKind as Kind;
    match error {
        Error::Io { action, source, .. } => {
            *action != "read"
                || matches!(source.kind(), Kind::StorageFull | Kind::QuotaExceeded | Kind::OutOfMemory)
        }
        _ => false,
    }
}

/// The message of an error.
pub fn message_of(error: &Error) -> String {
    let message = match error {
        Error::Input(found) | Error::Limits(found) => found.render(false),
        other => other.to_string(),
    };
    message.trim_end().to_owned()
}

/// A message in which paths in these folders are named from there, so that it does not depend on where a
/// campaign is computed.
pub fn near(message: &str, folders: &[&Path]) -> String {
    let is_of_name = |c: char| c.is_alphanumeric() || "/\\.~_-+".contains(c);
    let mut message = message.to_owned();
    for folder in folders.iter().filter(|folder| folder.parent().is_some()) {
        let folder = folder.display().to_string();
        let (mut near, mut rest) = (String::new(), message.as_str());
        while let Some(at) = rest.find(&folder) {
            near.push_str(&rest[..at]);
            let is_whole = !near.ends_with(is_of_name);
            let after = &rest[at + folder.len()..];
            rest = match after.strip_prefix(MAIN_SEPARATOR) {
                Some(below) if is_whole => below,
                None if is_whole && !after.starts_with(is_of_name) => {
                    near.push('.');
                    after
                }
                _ => {
                    near.push_str(&folder);
                    after
                }
            };
        }
        near.push_str(rest);
        message = near;
    }
    message
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_in_messages_are_named_from_their_folder() {
        let folders: [&Path; 2] = [Path::new("/c/set/.campaign/a.work"), Path::new("/c")];
        for (message, expected) in [
            ("cannot read\n--> /c/bad.stl", "cannot read\n--> bad.stl"),
            ("/c/set/.campaign/a.work/scene/scene.xml:3: no", "scene/scene.xml:3: no"),
            ("`/c/trees/a.obj` and (/c/trees/b.obj)", "`trees/a.obj` and (trees/b.obj)"),
            ("/c holds no models, nor does \"/c\"", ". holds no models, nor does \".\""),
            ("/home/c/a.obj, /cd/a.obj, /c.old/a.obj", "/home/c/a.obj, /cd/a.obj, /c.old/a.obj"),
            ("", ""),
        ] {
            assert_eq!(near(message, &folders), expected);
        }
        assert_eq!(near("/c/a.obj", &[Path::new("/")]), "/c/a.obj");
    }
}
