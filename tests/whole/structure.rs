//! The structure within crates: no lower module imports a higher one, no more than two files import each
//! other in a circle, and the maps in the documentation of modules name the files that exist. Between crates
//! the compiler holds it.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::fs;
use std::path::Path;
use vlscan::survey::SURVEY_TABLES;

/// A file of a crate.
struct Source {
    /// Its path in the repository.
    path: String,
    /// The module that it is, as names from the crate's root.
    module: Vec<String>,
    /// Its text as written.
    text: String,
    /// Its text without comments and without its tests.
    code: String,
}

/// The folders of the sources of all crates, relative to the repository: the program's first.
fn crates() -> Vec<String> {
    let mut found = vec!["src".to_owned()];
    for folder in ["crates", "apps"] {
        for entry in fs::read_dir(root().join(folder)).unwrap() {
            found.push(format!("{folder}/{}/src", entry.unwrap().file_name().to_str().unwrap()));
        }
    }
    assert!(found.len() > 5, "{found:?}");
    found
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All files of a crate but those that hold tests only.
fn sources(of: &str) -> Vec<Source> {
    let src = root().join(of);
    let mut folders = vec![src.clone()];
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                if !path.ends_with("tests") {
                    folders.push(path);
                }
            } else if path.extension().is_some_and(|e| e == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                let path = path.strip_prefix(&src).unwrap().to_str().unwrap().replace('\\', "/");
                let mut module: Vec<String> =
                    path.trim_end_matches(".rs").split('/').map(str::to_owned).collect();
                if ["mod", "lib"].contains(&module.last().unwrap().as_str()) {
                    module.pop();
                }
                found.push(Source { path: format!("{of}/{path}"), module, code: code_of(&text), text });
            }
        }
    }
    let tests = test_modules(&found);
    found
        .retain(|file| !tests.iter().any(|test| file.module.starts_with(test)) && file.path != "src/main.rs");
    found.sort_by(|a, b| a.path.cmp(&b.path));
    found
}

/// Modules declared behind `#[cfg(test)]`.
fn test_modules(files: &[Source]) -> BTreeSet<Vec<String>> {
    let mut found = BTreeSet::new();
    for file in files {
        let mut lines = file.text.lines();
        while let Some(line) = lines.next() {
            if (line.trim().starts_with("#[cfg(test)]") || line.contains("feature = \"testkit\""))
                && let Some(name) = lines.clone().map(str::trim).find_map(declared_module)
                && lines.clone().map(str::trim).find(|l| !l.starts_with("#[")).and_then(declared_module)
                    == Some(name)
            {
                let mut module = file.module.clone();
                module.push(name.to_owned());
                found.insert(module);
            }
        }
    }
    found
}

/// The name in `mod name;`, with or without visibility.
fn declared_module(line: &str) -> Option<&str> {
    let name = line.strip_suffix(';')?;
    let (before, name) = name.rsplit_once(' ')?;
    let is_module =
        before == "mod" || before == "pub mod" || before.starts_with("pub(") && before.ends_with(" mod");
    is_module.then_some(name)
}

/// Text without comments, and without what follows the head of a module of tests in the file.
fn code_of(text: &str) -> String {
    let end = text.find("#[cfg(test)]\nmod tests {").unwrap_or(text.len());
    text[..end].lines().map(|line| line.split("//").next().unwrap()).collect::<Vec<_>>().join("\n")
}

/// Paths that the code imports or writes out, each with whether it is re-exported.
fn paths_of(code: &str) -> Vec<(Vec<String>, bool)> {
    let mut paths = Vec::new();
    let mut rest = code;
    let mut body = String::new();
    while let Some(at) = find_use(rest) {
        body.push_str(&rest[..at]);
        let line = rest[..at].rfind('\n').map_or(0, |n| n + 1);
        let is_public = rest[line..at].trim().starts_with("pub");
        let tree = &rest[at + 4..];
        let end = tree.find(';').unwrap_or(tree.len());
        expand(&[], &tree[..end], &mut |path| paths.push((path, is_public)));
        rest = &tree[end..];
    }
    body.push_str(rest);
    let word = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    for path in body.split(|c: char| !word(c)) {
        let names: Vec<String> = path.split("::").map(str::to_owned).collect();
        if names.len() > 1 && ["crate", "super", "self"].contains(&names[0].as_str()) {
            paths.push((names, false));
        }
    }
    paths
}

/// Start of the next `use` declaration.
fn find_use(code: &str) -> Option<usize> {
    let mut from = 0;
    while let Some(at) = code[from..].find("use ").map(|at| at + from) {
        let line = code[..at].rfind('\n').map_or(0, |n| n + 1);
        let before = code[line..at].trim();
        if before.is_empty() || before == "pub" || before.starts_with("pub(") && before.ends_with(')') {
            return Some(at);
        }
        from = at + 4;
    }
    None
}

/// The single paths of a tree of imports, such as `a::{b, c::{d, e}}`.
fn expand(prefix: &[String], tree: &str, found: &mut dyn FnMut(Vec<String>)) {
    let tree = tree.trim();
    let with = |path: &str| {
        let names = path.split("::").map(|n| n.trim().to_owned()).filter(|n| !n.is_empty());
        prefix.iter().cloned().chain(names).collect::<Vec<_>>()
    };
    let Some((head, inner)) = tree.split_once('{') else {
        if !tree.is_empty() {
            found(with(tree.split(" as ").next().unwrap()));
        }
        return;
    };
    let prefix = with(head);
    let inner = &inner[..inner.rfind('}').unwrap_or(inner.len())];
    let (mut depth, mut start) = (0, 0);
    for (at, c) in inner.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                expand(&prefix, &inner[start..at], found);
                start = at + 1;
            }
            _ => {}
        }
    }
    expand(&prefix, &inner[start..], found);
}

/// Names of the items that a file defines at its top level.
fn items_of(code: &str) -> BTreeSet<String> {
    const KINDS: [&str; 10] =
        ["struct", "enum", "union", "trait", "type", "const", "static", "fn", "macro_rules!", "mod"];
    let mut items = BTreeSet::new();
    for line in code.lines().filter(|line| !line.starts_with(' ')) {
        let mut words = line.split_whitespace().peekable();
        while words.peek().is_some_and(|w| w.starts_with("pub") || ["unsafe", "const", "async"].contains(w)) {
            let word = words.next().unwrap();
            // `const fn` is a function, `const NAME` a constant.
            if word == "const" && !words.peek().is_some_and(|w| ["fn", "unsafe"].contains(w)) {
                items.extend(words.peek().map(|name| identifier(name)));
            }
        }
        if words.next().is_some_and(|word| KINDS.contains(&word)) {
            items.extend(words.next().map(identifier));
        }
    }
    items
}

fn identifier(text: &str) -> String {
    text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
}

/// Files from which each file imports, re-exports followed to where an item is defined.
struct Imports<'a> {
    files: &'a [Source],
    by_module: BTreeMap<&'a [String], usize>,
    items: Vec<BTreeSet<String>>,
    paths: Vec<Vec<(Vec<String>, bool)>>,
}

impl Imports<'_> {
    fn new(files: &[Source]) -> Imports<'_> {
        Imports {
            files,
            by_module: files.iter().enumerate().map(|(i, f)| (f.module.as_slice(), i)).collect(),
            items: files.iter().map(|f| items_of(&f.code)).collect(),
            paths: files.iter().map(|f| paths_of(&f.code)).collect(),
        }
    }

    /// The file that defines what `path`, as written in file `from`, names; none for other crates.
    fn resolve(&self, from: usize, path: &[String], depth: usize) -> Option<usize> {
        let mut module = self.files[from].module.clone();
        let mut names = path;
        match names.first()?.as_str() {
            "crate" => (module, names) = (Vec::new(), &names[1..]),
            "self" => names = &names[1..],
            "super" => {
                while names.first().is_some_and(|name| name == "super") {
                    module.pop();
                    names = &names[1..];
                }
            }
            child => {
                module.push(child.to_owned());
                self.by_module.get(module.as_slice())?;
                module.pop();
            }
        }
        while let Some(name) = names.first() {
            module.push(name.clone());
            if !self.by_module.contains_key(module.as_slice()) {
                module.pop();
                break;
            }
            names = &names[1..];
        }
        let file = *self.by_module.get(module.as_slice())?;
        let Some(name) = names.first().filter(|name| *name != "self" && *name != "*") else {
            return Some(file);
        };
        if self.items[file].contains(name) || depth > 8 {
            return Some(file);
        }
        let exported = self.paths[file].iter().filter(|(_, is_public)| *is_public);
        let found = exported.filter_map(|(path, _)| match path.last() {
            Some(last) if last == name => self.resolve(file, path, depth + 1),
            Some(last) if last == "*" => {
                let mut path = path.clone();
                *path.last_mut().unwrap() = name.clone();
                self.resolve(file, &path, depth + 1).filter(|&f| self.items[f].contains(name))
            }
            _ => None,
        });
        found.reduce(|_, later| later).or(Some(file))
    }

    /// The files from which file `from` imports.
    fn of(&self, from: usize) -> BTreeSet<usize> {
        let uses = self.paths[from].iter().filter(|(_, is_public)| !is_public);
        uses.filter_map(|(path, _)| self.resolve(from, path, 0)).filter(|&to| to != from).collect()
    }
}

/// Everything that can be reached from `start`.
fn reachable(edges: &[BTreeSet<usize>], start: usize) -> BTreeSet<usize> {
    let mut seen = BTreeSet::new();
    let mut next = vec![start];
    while let Some(at) = next.pop() {
        next.extend(edges[at].iter().filter(|&&to| seen.insert(to)));
    }
    seen
}

#[test]
fn no_circle_of_imports_has_more_than_two_files() {
    let mut found = 0;
    for of in crates() {
        let files = sources(&of);
        let imports = Imports::new(&files);
        let edges: Vec<_> = (0..files.len()).map(|i| imports.of(i)).collect();
        found += edges.iter().map(BTreeSet::len).sum::<usize>();
        let reach: Vec<_> = (0..files.len()).map(|i| reachable(&edges, i)).collect();
        let reach_of = &reach;
        let circle =
            |i: usize| reach[i].iter().filter(move |&&j| reach_of[j].contains(&i)).map(|&j| &files[j].path);
        let circles: BTreeSet<Vec<_>> = (0..files.len()).map(|i| circle(i).collect()).collect();
        let large: Vec<_> = circles.iter().filter(|files| files.len() > 2).collect();
        assert!(large.is_empty(), "these files import one another: {large:#?}");
    }
    assert!(found > 1000, "{found} imports");
}

/// The rows of modules in the map of a crate, lower ones first.
fn layers(of: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(root().join(of).join("lib.rs")).unwrap();
    let rows = text.lines().filter_map(|line| line.strip_prefix("//! | "));
    let cells = rows.map(|row| row.split('|').next().unwrap());
    cells.map(|cell| cell.split('`').skip(1).step_by(2).map(str::to_owned).collect()).collect()
}

#[test]
fn no_lower_module_imports_a_higher_one() {
    let mut wrong = BTreeSet::new();
    const MAPPED: [&str; 5] =
        ["apps/campaign/src", "apps/tools/src", "crates/base/src", "crates/lidar/src", "crates/session/src"];
    for of in MAPPED {
        let layers = layers(of);
        let rank = |module: &String| layers.iter().position(|row| row.contains(module));
        for file in sources(of).iter().filter(|file| !file.module.is_empty()) {
            let own = &file.module[0];
            let own_rank = rank(own).unwrap_or_else(|| panic!("the map of {of} does not name {own}"));
            for (path, _) in paths_of(&file.code) {
                if path[0] == "crate"
                    && let Some(other) = path.get(1)
                    && let Some(other_rank) = rank(other)
                    && other_rank > own_rank
                {
                    wrong.insert(format!("{} imports {other}", file.path));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "the maps of the crates have these the other way round: {wrong:#?}");
}

#[test]
fn maps_name_the_files_that_exist() {
    let (mut maps, mut wrong) = (0, String::new());
    for of in crates() {
        let files = sources(&of);
        for file in &files {
            let children: BTreeSet<&str> = files
                .iter()
                .filter(|f| f.module.len() == file.module.len() + 1 && f.module.starts_with(&file.module))
                .map(|f| f.module.last().unwrap().as_str())
                .collect();
            let rows = file.text.lines().filter_map(|line| line.strip_prefix("//! | "));
            let cells = rows.map(|row| row.split('|').next().unwrap());
            let named: BTreeSet<&str> = cells.flat_map(|cell| cell.split('`').skip(1).step_by(2)).collect();
            let is_root = ["/mod.rs", "/lib.rs"].iter().any(|name| file.path.ends_with(name));
            if children.len() < 5 || (named.is_empty() && !is_root) {
                continue;
            }
            maps += 1;
            let missing: Vec<_> = children.difference(&named).collect();
            let gone: Vec<_> = named.difference(&children).collect();
            if !missing.is_empty() || !gone.is_empty() {
                wrong += &format!("{}: not named {missing:?}, not there {gone:?}\n", file.path);
            }
        }
    }
    assert!(wrong.is_empty(), "maps and files differ:\n{wrong}");
    assert!(maps >= 10, "{maps} maps");
}

/// Calls of code outside of `allowed` files or folders.
fn calls(patterns: &[&str], allowed: &[&str]) -> Vec<String> {
    let is_allowed = |file: &Source| allowed.iter().any(|prefix| file.path.starts_with(prefix));
    let mut found = Vec::new();
    for file in crates().iter().flat_map(|of| sources(of)).filter(|file| !is_allowed(file)) {
        let code = file.code.split("mod tests {").next().unwrap();
        for (number, line) in (1..).zip(code.lines()) {
            if patterns.iter().any(|pattern| line.contains(pattern)) {
                found.push(format!("{}:{number}: {}", file.path, line.trim()));
            }
        }
    }
    found
}

#[test]
fn functions_of_other_files_return_no_text_as_their_error() {
    let (mut count, mut found) = (0, Vec::new());
    for file in crates().iter().flat_map(|of| sources(of)) {
        for (at, _) in file.code.match_indices("fn ") {
            let before = file.code[..at].rsplit('\n').next().unwrap_or_default();
            let signature = file.code[at..].split(['{', ';']).next().unwrap_or_default();
            let Some((_, returned)) = signature.rsplit_once("-> ") else { continue };
            let returned = returned.split("where").next().unwrap_or_default();
            if !before.trim().starts_with("pub") || !returned.contains("Result<") {
                continue;
            }
            count += 1;
            let returned = returned.trim().trim_end_matches('>');
            if [", String", ", &str", ", &'static str"].iter().any(|error| returned.ends_with(error)) {
                found.push(format!("{}: {}", file.path, signature.lines().next().unwrap_or_default()));
            }
        }
    }
    assert!(count > 100, "{count} functions");
    assert!(found.is_empty(), "give these a type of error, with variants: {found:#?}");
}

/// A correction is a row of the table, a use of the field of its name elsewhere, and a row in the
/// documentation.
#[test]
fn every_correction_is_used_and_described() {
    const TABLE: &str = "crates/base/src/corrections.rs";
    let sources: Vec<Source> = crates().iter().flat_map(|of| sources(of)).collect();
    let table = &sources.iter().find(|source| source.path == TABLE).unwrap().code;
    let rows = table.split_once("corrections! {").unwrap().1.split_once("\n}").unwrap().0;
    let physics = fs::read_to_string(root().join("docs/dev/physics.md")).unwrap();
    let names: Vec<&str> = rows.lines().filter_map(|row| row.trim().split([' ', ':']).nth(1)).collect();
    assert!(names.len() > 50, "{names:?}");
    for name in names {
        let is_name = |word: &str| word == name;
        let is_used = |source: &Source| {
            let mut words = source.code.split(|c: char| !(c.is_alphanumeric() || c == '_'));
            source.path != TABLE && words.any(is_name)
        };
        assert!(sources.iter().any(is_used), "{name} changes nothing");
        assert!(
            physics.contains(&format!("`{}`", name.replace('_', "-"))),
            "docs/dev/physics.md lacks {name}"
        );
    }
}

/// Checks that the documentation, not only the manual page, describes every key of pipeline files.
#[test]
fn every_key_of_pipeline_files_is_described() {
    let folder = root().join("docs");
    let pages: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "md"))
        .map(|path| fs::read_to_string(path).unwrap())
        .collect();
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    let words: HashSet<&str> = pages.iter().flat_map(|page| page.split(|c: char| !is_part(c))).collect();
    let mut count = 0;
    for table in SURVEY_TABLES {
        for (key, _) in table.keys {
            assert!(words.contains(key), "no page of docs/ has the key `{key}` of {}", table.name);
            count += 1;
        }
    }
    assert!(count > 150, "{count}");
}

#[test]
fn every_input_is_opened_where_it_is_noted() {
    let opening =
        [" File::open(", "(File::open(", "::File::open(", "fs::read(", "fs::read_to_string(", "read_dir("];
    // The system's own files, and folders and state that the program writes itself.
    let own = [
        "crates/base/src/files/",
        "apps/tools/src/campaign/",
        // The service has a folder of its own.
        "apps/serve/src/",
        "crates/base/src/machine.rs",
        "apps/schedules/src/measure.rs",
        "src/cli/bench/measure.rs",
        "crates/session/src/output/plan.rs",
        "crates/session/src/shards/",
        "crates/session/src/pipeline/resume_folder.rs",
        "crates/session/src/pipeline/segment.rs",
    ];
    let found = calls(&opening, &own);
    assert!(
        found.is_empty(),
        "use vlscan_base::files::reads, so that no output replaces these inputs: {found:#?}"
    );
}

#[test]
fn warnings_about_files_have_a_place() {
    // Options and what follows from several inputs have none.
    let of_options = [
        "crates/formats/src/columnar/",
        "crates/formats/src/las/write/",
        "apps/campaign/src/planning/",
        "apps/options/src/outputs.rs",
        "src/cli/helios.rs",
        "src/cli/raster.rs",
        "src/cli/run.rs",
        "crates/session/src/output/",
        "crates/session/src/pipeline/crs.rs",
        "crates/session/src/pipeline/scan.rs",
    ];
    let found = calls(&["warn(None"], &of_options);
    assert!(found.is_empty(), "name the file and the line, or Place::of_file: {found:#?}");
}

#[test]
fn files_are_removed_and_renamed_only_where_they_are_known_to_be_own() {
    let removing = ["remove_dir_all(", "remove_file(", "fs::rename("];
    let own = [
        "crates/base/src/files/group.rs",
        "crates/base/src/files/temporary.rs",
        "crates/base/src/files/undo.rs",
        "apps/serve/src/",
        "apps/tools/src/campaign/made.rs",
        "apps/tools/src/campaign/store.rs",
        "crates/session/src/shards/private.rs",
        "crates/session/src/pipeline/resume_folder.rs",
        // Names of segments hold checksums of their run and of their contents.
        "crates/session/src/pipeline/segment.rs",
    ];
    let found = calls(&removing, &own);
    assert!(found.is_empty(), "a file of the user may be lost: {found:#?}");
    let creating = [" File::create(", "(File::create(", "::File::create(", "fs::write(", ".truncate(true)"];
    let found = calls(&creating, &["apps/serve/src/"]);
    assert!(
        found.is_empty(),
        "use vlscan_base::files::FileWriter, which replaces no file unasked: {found:#?}"
    );
}

#[test]
fn imports_are_read() {
    let code = "use crate::a::{b, c::{D, self}};\npub use super::e::F as G;\nlet x = crate::h::i(j);\n";
    let paths: Vec<_> = paths_of(code).into_iter().map(|(path, public)| (path.join("::"), public)).collect();
    let expected = [("crate::a::b", false), ("crate::a::c::D", false), ("crate::a::c::self", false)];
    assert_eq!(paths[..3], expected.map(|(path, public)| (path.to_owned(), public)));
    assert_eq!(paths[3..], [("super::e::F".to_owned(), true), ("crate::h::i".to_owned(), false)]);
    assert_eq!(declared_module("pub(crate) mod a;"), Some("a"));
    assert_eq!(declared_module("model;"), None);
}

/// Names that act like people: a field or variable has the name of its content.
const UNCLEAR_NAMES: [&str; 11] =
    ["Aim", "Over", "asked", "beside", "goes_on", "heed", "judged", "rescued", "told", "unheeded", "wanted"];

/// The words of [`UNCLEAR_NAMES`] among the identifiers of `code`; words of texts do not count.
fn unclear_names(code: &str) -> BTreeSet<&str> {
    let mut found = BTreeSet::new();
    let mut is_continued = false;
    for line in code.lines() {
        // Every other part is a text: the second one, or the first one if the line before ends within a text.
        for part in line.split('"').skip(usize::from(is_continued)).step_by(2) {
            let words = part.split(|c: char| !(c.is_alphanumeric() || c == '_'));
            found.extend(words.filter(|word| UNCLEAR_NAMES.contains(word)));
        }
        is_continued = line.ends_with('\\');
    }
    found
}

#[test]
fn names_say_what_they_hold() {
    let code = "let told = 1;\nlet (retold, b) = (\"told, asked \\\n heed\", wanted(told));\n";
    assert_eq!(unclear_names(code), BTreeSet::from(["told", "wanted"]));
    let checked = ["src", "apps/campaign/", "apps/options/", "crates/"];
    let own = crates().into_iter().filter(|of| checked.iter().any(|start| of.starts_with(start)));
    let mut found = Vec::new();
    for file in own.flat_map(|of| sources(&of)) {
        found.extend(unclear_names(&file.code).into_iter().map(|name| format!("{}: {name}", file.path)));
    }
    assert!(found.is_empty(), "name the content or the condition: {found:#?}");
}

/// The first words with which no paragraph of a comment of an item begins: it names the item, says what it
/// does, or when it is true.
const RIDDLES: [&str; 7] = ["Whether", "What", "Those", "So", "Nobody", "Which", "Where"];

/// Width of a line of code and comments, characters.
const LINE_WIDTH: usize = 110;

/// Files with wide code: a row of a table, of markup or of JSON stays on one line.
const WIDE_CODE: [&str; 5] = [
    "apps/serve/src/",
    "crates/formats/src/columnar/mod.rs",
    "crates/survey/src/keys/tables.rs",
    "crates/tables/src/vocabulary.rs",
    // The text of a Python module.
    "apps/options/src/python.rs",
];

/// The lines of a file that are wider than [`LINE_WIDTH`], without code of tests and rows of tables.
fn wide_lines(path: &str, text: &str) -> Vec<usize> {
    let is_table = WIDE_CODE.iter().any(|prefix| path.starts_with(prefix));
    let tests = text.find("#[cfg(test)]\nmod tests {").map_or(usize::MAX, |at| text[..at].lines().count());
    let is_wide = |(number, line): &(usize, &str)| {
        let is_comment = line.trim_start().starts_with("//");
        let is_row = line.contains("//! |") || line.contains("/// |");
        let is_checked = if is_comment { !is_row } else { !is_table && *number <= tests };
        is_checked && line.chars().count() > LINE_WIDTH
    };
    (1..).zip(text.lines()).filter(is_wide).map(|(number, _)| number).collect()
}

#[test]
fn lines_fit_into_their_width() {
    let wide = "a".repeat(LINE_WIDTH + 1);
    let text = format!("/// {wide}\n//! | {wide}\n{wide}\n#[cfg(test)]\nmod tests {{\n{wide}\n");
    assert_eq!(wide_lines("src/a.rs", &text), [1, 3]);
    assert_eq!(wide_lines("apps/serve/src/a.rs", &text), [1]);
    let mut found = Vec::new();
    for file in crates().iter().flat_map(|of| sources(of)) {
        let lines = wide_lines(&file.path, &file.text);
        found.extend(lines.into_iter().map(|line| format!("{}:{line}", file.path)));
    }
    assert!(found.is_empty(), "wrap these at {LINE_WIDTH} characters: {found:#?}");
}

/// The marker and the words of a line of a comment of an item or a module.
fn comment_of(line: &str) -> Option<(&'static str, &str)> {
    let line = line.trim_start();
    ["///", "//!"].into_iter().find_map(|marker| Some((marker, line.strip_prefix(marker)?.trim())))
}

/// The lines of `text` that begin a paragraph in the comment of an item or a module with one of [`RIDDLES`].
fn riddles(text: &str) -> Vec<usize> {
    let mut found = Vec::new();
    let mut before = None;
    for (number, line) in (1..).zip(text.lines()) {
        let this = comment_of(line);
        if let Some((marker, words)) = this {
            // A paragraph follows on code, the other kind of comment, an empty line or a heading.
            let continues = |(other, words): (&str, &str)| {
                other == marker && !words.is_empty() && !words.starts_with('#')
            };
            let word = words.split_whitespace().next();
            if !before.is_some_and(continues) && word.is_some_and(|word| RIDDLES.contains(&word)) {
                found.push(number);
            }
        }
        before = this;
    }
    found
}

#[test]
fn comments_of_items_begin_with_what_the_item_is_or_does() {
    assert_eq!(riddles("/// What it is.\n/// Where it lies.\n\n//! Places.\n    /// Which one.\n"), [1, 5]);
    assert_eq!(riddles("/// Opens it.\n///\n/// # Errors\n/// Those of it.\n///\n/// So be it.\n"), [4, 6]);
    let found: Vec<String> = crates()
        .iter()
        .flat_map(|of| sources(of))
        .flat_map(|file| riddles(&file.text).into_iter().map(move |line| format!("{}:{line}", file.path)))
        .collect();
    assert!(found.is_empty(), "begin with a noun, a verb or \"True if\": {found:#?}");
}
