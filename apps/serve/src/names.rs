//! Names that others choose: of uploads, of files within them, and of files that requests name. A name that
//! passes here leads to no place outside of the folder that it is joined to.

use std::path::{Component, PathBuf};

/// Longest part of a path, bytes.
const MAX_PART_BYTES: usize = 120;
/// Most parts of a path.
pub(crate) const MAX_DEPTH: usize = 16;
/// The folder name under which results of jobs are named in requests.
pub const JOBS: &str = "jobs";

/// The folder by whose name files of HELIOS++ name others, and references of the catalogue begin.
pub const DATA: &str = "data";

/// Names in the folder of a job's inputs that are not those of uploads, and that of the catalogue's folder.
const RESERVED: [&str; 8] =
    [JOBS, DATA, "job.toml", "campaign.toml", "area.geojson", "along.geojson", "area.wkt", "along.wkt"];

/// True if a text can be the name of an upload: one part of a path without blanks that means nothing else.
pub fn is_upload_name(name: &str) -> bool {
    is_part(name)
        && !RESERVED.contains(&name)
        && name.chars().all(|c| c.is_alphanumeric() || "._-+".contains(c))
}

/// A name for an upload from the name of a file or folder.
pub fn upload_name_from(text: &str) -> String {
    let last = text.rsplit(['/', '\\']).find(|part| !part.is_empty()).unwrap_or_default();
    let stem = match last.rsplit_once('.') {
        Some((stem, ending)) if !stem.is_empty() && ending.len() <= 8 => stem,
        _ => last,
    };
    let plain = |c: char| if c.is_alphanumeric() || "._-+".contains(c) { c } else { '-' };
    let name: String = stem.chars().map(plain).take(40).collect();
    let name = name.trim_matches(['.', '-']).to_owned();
    if is_upload_name(&name) { name } else { "upload".to_owned() }
}

/// The path of a file within an upload or the results of a job: parts joined by `/`, none of which leads
/// elsewhere. Backslashes of other systems separate parts, too.
pub fn relative_path(name: &str) -> Option<PathBuf> {
    let name = name.replace('\\', "/");
    let parts: Vec<&str> = name.split('/').collect();
    if parts.is_empty() || parts.len() > MAX_DEPTH || !parts.iter().all(|part| is_part(part)) {
        return None;
    }
    let path: PathBuf = parts.iter().collect();
    path.components().all(|part| matches!(part, Component::Normal(_))).then_some(path)
}

fn is_part(part: &str) -> bool {
    !part.is_empty()
        && part.len() <= MAX_PART_BYTES
        && !part.starts_with(['.', ' ', '-', '~'])
        && !part.ends_with(['.', ' '])
        && !part.chars().any(|c| c.is_control() || "/\\:*?\"<>|".contains(c))
}

/// The words of a text of a request that may be names of files: the text itself, and what stands between
/// blanks, quotes and the signs that separate options from their values.
pub fn words(text: &str) -> impl Iterator<Item = &str> {
    let parts = text.split([' ', '\t', '\n', '\r', '"', '\'', '=', ',', ';', '(', ')', '[', ']']);
    std::iter::once(text).chain(parts).filter(|word| !word.is_empty())
}

/// The word of a text that leads out of the folder of a job: an absolute path, a home folder, a URL, or a
/// path with `..`.
pub fn leads_out(text: &str) -> Option<&str> {
    words(text).find(|word| {
        let slashes = word.replace('\\', "/");
        slashes.starts_with(['/', '~'])
            || slashes.contains("://")
            || slashes.split(['/', '#', ':']).any(|part| part == "..")
            || has_drive(&slashes)
    })
}

/// `C:/…` of Windows.
fn has_drive(path: &str) -> bool {
    let mut letters = path.chars();
    let drive = letters.next().is_some_and(|c| c.is_ascii_alphabetic());
    drive && letters.next() == Some(':') && letters.next() == Some('/')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_in_their_folder() {
        for name in ["a.obj", "a/b.obj", "Bäume/Buche 7.obj", "a\\b.obj"] {
            assert!(relative_path(name).is_some(), "{name}");
        }
        let long = "x".repeat(121);
        let deep = "a/".repeat(16) + "a";
        for name in [
            "",
            ".",
            "..",
            "../a",
            "a/../b",
            "/a",
            "a//b",
            "a/",
            ".hidden",
            "a/.b",
            "a\0b",
            "a\nb",
            "C:\\a",
            "\\\\host\\a",
            "-o",
            "~/a",
            &long,
            &deep,
        ] {
            assert!(relative_path(name).is_none(), "{name:?}");
        }
        assert!(
            is_upload_name("forest-2")
                && !is_upload_name("jobs")
                && !is_upload_name("data")
                && !is_upload_name("a b")
                && !is_upload_name("..")
        );
    }

    #[test]
    fn uploads_are_named_after_their_files() {
        for (from, name) in [
            ("forest.zip", "forest"),
            ("my forest/scene.xml", "scene"),
            ("dem.tar.gz", "dem.tar"),
            ("…", "upload"),
            ("jobs", "upload"),
            ("data/surveys/a.xml", "a"),
            ("data", "upload"),
            ("../..", "upload"),
        ] {
            assert_eq!(upload_name_from(from), name);
        }
    }

    #[test]
    fn texts_that_lead_out_are_found() {
        for text in [
            "/etc/passwd",
            "../x",
            "a/../../x",
            "~/x",
            "--assets /etc",
            "--assets=/etc",
            "a=../b",
            "'/etc'",
            "file:///etc/passwd",
            "https://a/b",
            "..\\x",
            "C:\\x",
            "scene.xml#../x",
            "x,/etc",
            "[/etc]",
        ] {
            assert!(leads_out(text).is_some(), "{text}");
        }
        for text in [
            "forest/scene.xml#forest",
            "POLYGON ((-50 -50, 50 -50))",
            "SRID=25833;POLYGON ((0 0))",
            "data/scanners_tls.xml#x",
            "n/2",
            "EPSG:25832",
            "2024-01-01 00:00:00",
            "a..b",
            "UNIT[\"m/s\",1]",
        ] {
            assert!(leads_out(text).is_none(), "{text}");
        }
    }
}
