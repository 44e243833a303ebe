//! The parts in a folder.

use super::borders::{self, Borders};
use super::file::{self, PartFile, PartHead};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::{Path, PathBuf};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads;
use vlscan_warehouse::Stop;

/// The file of part `number` of `of` in a folder.
pub fn part_path(folder: &Path, number: u32, of: u32) -> PathBuf {
    folder.join(format!("part-{number:06}-of-{of:06}.vlpart"))
}

/// Number of the part and number of parts in the name of a file.
fn parse_name(name: &str) -> Option<(u32, u32)> {
    let (number, of) = name.strip_prefix("part-")?.strip_suffix(".vlpart")?.split_once("-of-")?;
    let (number, of) = (number.parse().ok()?, of.parse().ok()?);
    (number < of).then_some((number, of))
}

/// Whether a file begins as every part does, whatever follows: one of another kind is not the program's own.
pub fn is_part(path: &Path) -> bool {
    begins_with(path, file::MAGIC)
}

/// Whether a file is one of a run in parts, by its name and by its first bytes: a part, or the borders between them.
pub fn is_file_of_parts(path: &Path) -> bool {
    let Some(name) = path.file_name() else { return false };
    let is_borders = || Borders::path(Path::new("")).file_name() == Some(name);
    match name.to_str().and_then(parse_name) {
        Some(_) => is_part(path),
        None => is_borders() && begins_with(path, borders::MAGIC),
    }
}

/// Whether the first bytes of a regular file are these.
fn begins_with(path: &Path, magic: &[u8; 8]) -> bool {
    let mut first = [0; 8];
    let read = reads::open_own(path).and_then(|mut file| file.read_exact(&mut first));
    read.is_ok() && first == *magic
}

/// Numbers as ranges: `3,17,40-44`, as array jobs take them.
pub fn array_list(numbers: impl IntoIterator<Item = u32>) -> String {
    let mut ranges: Vec<(u32, u32)> = Vec::new();
    for number in numbers {
        match ranges.last_mut() {
            Some((_, last)) if *last + 1 == number => *last = number,
            _ => ranges.push((number, number)),
        }
    }
    let texts = ranges.iter().map(|&(first, last)| match last - first {
        0 => first.to_string(),
        _ => format!("{first}-{last}"),
    });
    texts.collect::<Vec<_>>().join(",")
}

/// All parts of one run, complete and of one fingerprint.
#[derive(Debug)]
pub struct PartSet {
    folder: PathBuf,
    /// Head of the first part; those of the others differ in the number only.
    pub head: PartHead,
    pub echoes: u64,
}

/// Most problems of one kind that are listed.
const MAX_LISTED: usize = 20;

impl PartSet {
    /// Numbers of parts of which there are files in a folder, with the numbers of the parts that exist.
    ///
    /// # Errors
    /// [`Error::Io`] for a folder that cannot be read.
    pub fn list(folder: &Path) -> Result<BTreeMap<u32, BTreeSet<u32>>> {
        let failed = |e| Error::open(folder, e);
        let mut found: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
        for entry in std::fs::read_dir(folder).map_err(failed)? {
            let name = entry.map_err(failed)?.file_name();
            if let Some((number, of)) = name.to_str().and_then(parse_name) {
                found.entry(of).or_default().insert(number);
            }
        }
        Ok(found)
    }

    /// Opens all parts of a folder once.
    ///
    /// # Errors
    /// [`Error::Input`] that names all parts that are missing, damaged, or of another run.
    pub fn open(folder: &Path) -> Result<PartSet> {
        let listed = PartSet::list(folder)?;
        let mut problems = Diagnostics::default();
        if listed.len() > 1 {
            let counts: Vec<String> =
                listed.iter().map(|(of, numbers)| format!("{} of {of}", numbers.len())).collect();
            problems
                .error(
                    None,
                    format!("{} holds parts of different runs: {}", folder.display(), counts.join(", ")),
                )
                .help("a run is divided into one number of parts; remove the files of the others");
            return Err(Error::Input(Box::new(problems)));
        }
        let Some((of, present)) = listed.into_iter().next() else {
            return Err(Error::input(format!("{} holds no parts (part-…-of-….vlpart)", folder.display())));
        };
        let mut damaged = BTreeMap::new();
        let mut runs = Runs::default();
        let (mut pulses, mut echoes) = (0u64, 0u64);
        for &number in &present {
            match PartFile::open(&part_path(folder, number, of)) {
                Ok(part) if (part.head.number, part.head.of) != (number, of) => {
                    let reason = format!("is part {} of {}", part.head.number, part.head.of);
                    damaged.insert(number, reason);
                }
                Ok(part) => {
                    (pulses, echoes) = (pulses + part.pulses, echoes + part.echoes);
                    runs.add(part.head);
                }
                Err(reason) => {
                    damaged.insert(number, reason);
                }
            }
        }
        report_damaged(folder, of, &damaged, &mut problems);
        runs.report(folder, &mut problems);
        let missing: Vec<u32> = (0..of).filter(|number| !present.contains(number)).collect();
        if !missing.is_empty() {
            problems
                .error(None, format!("{} of {of} parts are missing in {}", missing.len(), folder.display()))
                .help(compute_again(folder, of, missing));
        }
        problems.finish(false)?;
        let head = runs.0.into_iter().next().map(|(head, _)| head);
        let head = head.ok_or_else(|| Error::Internal("a folder of parts without parts".to_owned()))?;
        if pulses != head.total {
            return Err(Error::input(format!(
                "the parts in {} hold {pulses} pulses together instead of {}",
                folder.display(),
                head.total
            )));
        }
        Ok(PartSet { folder: folder.to_path_buf(), head, echoes })
    }

    /// Opens one of the parts.
    ///
    /// # Errors
    /// [`Error::Input`] for a part that has been changed or removed meanwhile.
    pub fn part(&self, number: u32) -> Result<PartFile> {
        let path = part_path(&self.folder, number, self.head.of);
        PartFile::open(&path).map_err(|reason| {
            let mut problems = Diagnostics::default();
            report_damaged(&self.folder, self.head.of, &BTreeMap::from([(number, reason)]), &mut problems);
            Error::Input(Box::new(problems))
        })
    }

    /// Reads all parts and names those that are damaged.
    ///
    /// # Errors
    /// [`Error::Input`] with all damaged parts.
    pub fn verify(&self, stop: &Stop) -> Result<()> {
        let mut damaged = BTreeMap::new();
        for number in (0..self.head.of).take_while(|_| !stop.is_requested()) {
            let path = part_path(&self.folder, number, self.head.of);
            if let Err(reason) = PartFile::open(&path).and_then(|part| part.verify()) {
                damaged.insert(number, reason);
            }
        }
        let mut problems = Diagnostics::default();
        report_damaged(&self.folder, self.head.of, &damaged, &mut problems);
        problems.finish(false).map(drop)
    }
}

/// How parts are computed that are missing or damaged.
fn compute_again(folder: &Path, of: u32, numbers: impl IntoIterator<Item = u32> + Clone) -> String {
    let first = numbers.clone().into_iter().next().unwrap_or(0);
    format!(
        "compute them as before, with --resume, which replaces damaged parts: vlscan run … -o {} --part {first}/{of} --resume \
         (as an array job: --array={}); or repeat the command if it was one vlscan run --resume",
        folder.display(),
        array_list(numbers)
    )
}

fn report_damaged(folder: &Path, of: u32, damaged: &BTreeMap<u32, String>, problems: &mut Diagnostics) {
    let again = compute_again(folder, of, damaged.keys().copied());
    for (i, (&number, reason)) in damaged.iter().take(MAX_LISTED).enumerate() {
        let path = part_path(folder, number, of);
        let problem = problems.error(None, format!("{} {reason}", path.display()));
        if i + 1 == damaged.len().min(MAX_LISTED) {
            problem.help(again.clone());
        }
    }
}

/// The runs that parts are parts of: the head of a part of each, and the numbers of all.
#[derive(Default)]
struct Runs(Vec<(PartHead, Vec<u32>)>);

impl Runs {
    fn add(&mut self, head: PartHead) {
        let number = head.number;
        let is_its = |known: &PartHead| PartHead { number: known.number, ..head.clone() } == *known;
        match self.0.iter_mut().find(|(known, _)| is_its(known)) {
            Some((_, numbers)) => numbers.push(number),
            None => self.0.push((head, vec![number])),
        }
    }

    /// Reports the parts whose run is not that of most parts.
    fn report(&mut self, folder: &Path, problems: &mut Diagnostics) {
        self.0.sort_by_key(|(_, numbers)| std::cmp::Reverse(numbers.len()));
        let Some(((most, _), others)) = self.0.split_first() else { return };
        for (head, numbers) in others {
            let what = most.difference(head);
            problems
                .error(
                    None,
                    format!(
                        "parts {} in {} are of another run than the others; they differ in {what}",
                        array_list(numbers.iter().copied()),
                        folder.display()
                    ),
                )
                .help("compute all parts with the same survey, scene, options and version");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::file::tests::{head, part};
    use super::*;
    use std::fs;

    #[test]
    fn numbers_are_listed_as_array_jobs_take_them() {
        assert_eq!(array_list([3, 17, 40, 41, 42, 43, 44]), "3,17,40-44");
        assert_eq!((array_list([]), array_list([0, 1])), (String::new(), "0-1".to_owned()));
    }

    #[test]
    fn names_hold_number_and_count() {
        assert_eq!(part_path(Path::new("d"), 3, 256), Path::new("d/part-000003-of-000256.vlpart"));
        assert_eq!(parse_name("part-000003-of-000256.vlpart"), Some((3, 256)));
        for name in
            ["part-000007-of-000007.vlpart", "part-1-of-2.vlpart.x.part", "part-a-of-2.vlpart", "plan"]
        {
            assert_eq!(parse_name(name), None, "{name}");
        }
    }

    #[test]
    fn names_alone_make_no_file_one_of_parts() {
        let dir = tempfile::tempdir().unwrap();
        let (numbered, plan) = (part_path(dir.path(), 0, 2), Borders::path(dir.path()));
        for path in [&numbered, &plan] {
            assert!(!is_file_of_parts(path));
            fs::write(path, "precious").unwrap();
            assert!(!is_file_of_parts(path) && !is_part(path));
        }
        fs::write(&numbered, &part(&head(0, 2))[..9]).unwrap();
        fs::write(&plan, borders::MAGIC).unwrap();
        assert!(is_file_of_parts(&numbered) && is_part(&numbered) && is_file_of_parts(&plan));
        let other = dir.path().join("notes.txt");
        fs::copy(&numbered, &other).unwrap();
        assert!(!is_file_of_parts(&other));
    }

    #[test]
    fn everything_wrong_with_a_folder_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let refused = || PartSet::open(dir.path()).unwrap_err();
        let shown = |error: Error| match error {
            Error::Input(found) => found.render(false),
            other => other.to_string(),
        };
        assert!(shown(refused()).contains("holds no parts"));
        let put =
            |head: &PartHead| fs::write(part_path(dir.path(), head.number, head.of), part(head)).unwrap();
        [0, 1, 2, 4, 5, 6].into_iter().for_each(|number| put(&head(number, 8)));
        assert!(shown(refused()).contains("--array=3,7"), "{}", shown(refused()));
        put(&head(3, 8));
        put(&head(7, 8));
        let set = PartSet::open(dir.path()).unwrap();
        assert_eq!((set.head.of, set.echoes), (8, 8 * 520));
        set.verify(&Stop::new()).unwrap();
        // Another seed in two parts.
        let mut other = head(1, 8);
        other.fingerprint = Default::default();
        other.fingerprint.flight("seed", 12);
        put(&other);
        put(&PartHead { number: 2, ..other });
        let text = shown(refused());
        assert!(text.contains("parts 1-2 in") && text.contains("seed (11, 12)"), "{text}");
        [1, 2].into_iter().for_each(|number| put(&head(number, 8)));
        // Damage in a block is found by reading, damage of the length by opening.
        let path = part_path(dir.path(), 5, 8);
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(&path, &bytes).unwrap();
        let text = shown(PartSet::open(dir.path()).unwrap().verify(&Stop::new()).unwrap_err());
        assert!(text.contains("part-000005-of-000008.vlpart") && text.contains("--array=5"), "{text}");
        fs::write(&path, &bytes[..middle]).unwrap();
        assert!(shown(refused()).contains("cut short"));
        put(&head(0, 3));
        assert!(shown(refused()).contains("1 of 3, 8 of 8"));
    }
}
