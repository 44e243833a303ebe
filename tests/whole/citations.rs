//! Comments cite sections and traps of `docs/dev/spec` that exist; pages name source files that exist.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// The pages, each with another name that comments have for it (or the same).
const PAGES: [(&str, &str); 5] = [
    ("input-formats", "input-formats"),
    ("kinematics", "kinematics"),
    ("outputs", "outputs-and-cli"),
    ("pulse-physics", "pulse-physics"),
    ("tree-and-schedule", "kdtree-and-scheduling"),
];

/// Modules and the page that citations without a page mean there.
const HOMES: [(&str, &str); 10] = [
    ("src/cli", "outputs"),
    ("crates/lidar/src/flight", "kinematics"),
    ("crates/session/src/output", "outputs"),
    ("crates/lidar/src/platform", "kinematics"),
    ("crates/lidar/src/pulse", "pulse-physics"),
    ("crates/lidar/src/scanner", "kinematics"),
    ("crates/scene/src", "input-formats"),
    ("crates/warehouse/src", "tree-and-schedule"),
    ("crates/survey/src", "input-formats"),
    ("crates/trace/src", "tree-and-schedule"),
];

/// Characters around a word of a citation.
const AROUND: [char; 9] = ['(', ')', '[', ']', ',', ';', ':', '.', '`'];

/// A citation in a comment.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Citation {
    /// Line of the comment, from 1.
    line: usize,
    page: &'static str,
    /// `§2.3` or `trap 8`.
    target: String,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The page of that name.
fn page(name: &str) -> Option<&'static str> {
    PAGES.iter().find(|(page, other)| name == *page || name == *other).map(|(page, _)| *page)
}

fn text_of(page: &str) -> String {
    let path = root().join("docs/dev/spec").join(page).with_extension("md");
    fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// All Rust files below a folder.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// The words of each run of comment lines with the numbers of their lines.
fn comments(source: &str) -> Vec<Vec<(usize, &str)>> {
    let mut runs: Vec<Vec<(usize, &str)>> = vec![Vec::new()];
    for (i, line) in source.lines().enumerate() {
        let Some(text) = line.trim_start().strip_prefix("//") else {
            runs.push(Vec::new());
            continue;
        };
        let words = text.trim_start_matches(['/', '!']).split_whitespace();
        if let Some(run) = runs.last_mut() {
            run.extend(words.map(|word| (i + 1, word)));
        }
    }
    runs
}

/// The numbers of `§2.11` and `§2.11–2.12`.
fn sections(word: &str) -> impl Iterator<Item = String> {
    word.trim_start_matches('§').split(['–', '-']).filter_map(|part| {
        let end = part.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(part.len());
        let number = part[..end].trim_end_matches('.');
        (!number.is_empty()).then(|| format!("§{number}"))
    })
}

/// Citations in a run of comment lines. `home` is the page that `spec §1.8` means. Citations that neither
/// name a page nor begin with `spec` are left out: they may be those of a book.
fn citations(words: &[(usize, &str)], home: Option<&'static str>) -> Vec<Citation> {
    let mut found = Vec::new();
    let mut cited = None;
    for (i, &(line, word)) in words.iter().enumerate() {
        let plain = word.trim_matches(AROUND);
        let before = i.checked_sub(1).map_or("", |before| words[before].1.trim_matches(AROUND));
        let rest = &words[i + 1..];
        let is_spec = before.eq_ignore_ascii_case("spec");
        let is_trap = plain == "trap" || plain == "traps";
        if is_spec && (is_trap || plain.starts_with('§')) {
            cited = home;
        }
        match (page(plain), cited) {
            (Some(named), _) if is_spec => cited = Some(named),
            (Some(named), Some(_)) if rest.first().is_some_and(|next| next.1.starts_with('§')) => {
                cited = Some(named);
            }
            (None, Some(page)) if plain.starts_with('§') => {
                found.extend(sections(plain).map(|target| Citation { line, page, target }));
            }
            (None, Some(page)) if is_trap => {
                let numbers =
                    rest.iter().map(|next| next.1.trim_matches(AROUND)).filter(|next| *next != "and");
                let numbers = numbers.take_while(|next| next.parse::<u32>().is_ok());
                found.extend(numbers.map(|number| Citation { line, page, target: format!("trap {number}") }));
            }
            _ => {}
        }
        if word.ends_with('.') || word.trim_end_matches([',', ';', ':']).ends_with(')') {
            cited = None;
        }
    }
    found
}

/// Targets of citations on a page: `§2.3` for the heading `### 2.3 Linear path`, `trap 8` for the paragraph
/// `**Trap 8.** …`.
fn targets(text: &str) -> BTreeSet<String> {
    text.lines()
        .filter_map(|line| match line.strip_prefix("**Trap ") {
            Some(trap) => trap.split('.').next().map(|number| format!("trap {number}")),
            None => {
                let number = line.strip_prefix('#')?.trim_start_matches('#').split_whitespace().next()?;
                Some(format!("§{}", number.trim_end_matches('.')))
            }
        })
        .collect()
}

#[test]
fn every_citation_leads_somewhere() {
    let known = PAGES.map(|(page, _)| (page, targets(&text_of(page))));
    let mut files = Vec::new();
    ["crates", "src", "tests"].iter().for_each(|folder| sources(&root().join(folder), &mut files));
    files.sort();
    let (mut count, mut lost) = (0, Vec::new());
    for file in files {
        let name = file.strip_prefix(root()).unwrap();
        let home = HOMES.iter().find(|(module, _)| name.starts_with(module)).map(|(_, page)| *page);
        let source = fs::read_to_string(&file).unwrap();
        for citation in comments(&source).iter().flat_map(|words| citations(words, home)) {
            count += 1;
            let Citation { line, page, target } = citation;
            if !known.iter().any(|(known, targets)| *known == page && targets.contains(&target)) {
                lost.push(format!("{}:{line}: docs/dev/spec/{page}.md has no {target}", name.display()));
            }
        }
    }
    assert!(lost.is_empty(), "{}", lost.join("\n"));
    assert!(count > 100, "only {count} citations were found: are they read rightly?");
}

#[test]
fn the_pages_name_files_that_exist() {
    let pages = PAGES.map(|(page, _)| format!("docs/dev/spec/{page}.md"));
    for page in pages.iter().map(String::as_str).chain(["docs/dev/spec/README.md", "ARCHITECTURE.md"]) {
        let text = fs::read_to_string(root().join(page)).unwrap();
        let quoted: Vec<_> = text.split('`').skip(1).step_by(2).collect();
        let files =
            quoted.iter().filter(|n| ["src/", "crates/", "tests/"].iter().any(|top| n.starts_with(top)));
        for name in files.clone() {
            assert!(root().join(name).exists(), "{page}: there is no {name}");
        }
        assert!(files.count() > 0 || page.ends_with("README.md"), "{page} names no file");
    }
}

#[test]
fn citations_are_read_as_they_are_written() {
    let source = "\
        // A rule (spec kinematics §2.3–2.4, traps 17 and 18), and one of another page (spec\n\
        // outputs-and-cli §9.3). Not that of a book (RFC 4648 §4).\n\
        let x = 1; // not a comment of its own: spec kinematics §99\n\
        /// The sums of spec §1.12 and §1.16. Then nothing, §3.\n";
    let found: Vec<_> =
        comments(source).iter().flat_map(|words| citations(words, Some("tree-and-schedule"))).collect();
    let expected = [
        (1, "kinematics", "§2.3"),
        (1, "kinematics", "§2.4"),
        (1, "kinematics", "trap 17"),
        (1, "kinematics", "trap 18"),
        (2, "outputs", "§9.3"),
        (4, "tree-and-schedule", "§1.12"),
        (4, "tree-and-schedule", "§1.16"),
    ];
    let expected = expected.map(|(line, page, target)| Citation { line, page, target: target.to_owned() });
    assert_eq!(found, expected);
    let page = targets("# Page\n\n### 2.5 Multicopter\n\n#### 2.5.1 Parameters\n\n**Trap 8.** Overshoots.\n");
    assert!(["§2.5", "§2.5.1", "trap 8"].iter().all(|target| page.contains(*target)), "{page:?}");
}
