//! The shards in a folder.

use super::borders::{self, Borders};
use super::file::{self, ShardFile, ShardFileError, ShardHead};
use super::share::OneOf;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::path::{Path, PathBuf};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads;
use vlscan_base::recognise::{Expected, foreign_file};
use vlscan_warehouse::Stop;

/// The file of a shard in a folder.
pub fn shard_path(folder: &Path, OneOf { number, of }: OneOf) -> PathBuf {
    folder.join(format!("shard-{number:06}-of-{of:06}.vlshard"))
}

/// Number of the shard and number of shards in the name of a file.
fn parse_name(name: &str) -> Option<(u32, u32)> {
    let (number, of) = name.strip_prefix("shard-")?.strip_suffix(".vlshard")?.split_once("-of-")?;
    let (number, of) = (number.parse().ok()?, of.parse().ok()?);
    (number < of).then_some((number, of))
}

/// The error of a folder without shards, which may contain the folders of several scanners.
fn no_shards(folder: &Path) -> Error {
    let message = format!("{} contains no shards (shard-…-of-….vlshard)", folder.display());
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut inside: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    inside.retain(|path| ShardSet::list(path).is_ok_and(|shards| !shards.is_empty()));
    inside.sort();
    match inside.first() {
        Some(first) => {
            let help =
                format!("merge the shards of each scanner on their own: vlscan merge {} …", first.display());
            Error::input_with_help(message, help)
        }
        None => Error::input(message),
    }
}

/// True if a file begins as every shard does: a file of another kind does not belong to the program.
pub fn is_shard(path: &Path) -> bool {
    begins_with(path, file::MAGIC)
}

/// True if a file belongs to a run in shards, by its name and by its first bytes: a shard, or the borders
/// between them.
pub fn is_file_of_shards(path: &Path) -> bool {
    let Some(name) = path.file_name() else { return false };
    let is_borders = || Borders::path(Path::new("")).file_name() == Some(name);
    match name.to_str().and_then(parse_name) {
        Some(_) => is_shard(path),
        None => is_borders() && begins_with(path, borders::MAGIC),
    }
}

/// True if the first bytes of a regular file are these.
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

/// All shards of one run, complete and of one fingerprint.
#[derive(Debug)]
pub struct ShardSet {
    folder: PathBuf,
    /// Head of the first shard; the heads of the others differ in the number only.
    pub head: ShardHead,
    /// Echoes of all shards.
    pub echoes: u64,
}

/// Maximum number of problems of one kind that are listed.
const MAX_LISTED: usize = 20;

impl ShardSet {
    /// Total numbers of shards by the files in a folder, with the numbers of the existing shards.
    ///
    /// # Errors
    /// [`Error::Io`] for a folder that cannot be read.
    pub fn list(folder: &Path) -> Result<BTreeMap<u32, BTreeSet<u32>>> {
        if let Some(found) = foreign_file(folder, &Expected::SHARDS) {
            return Err(found.error(folder));
        }
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

    /// Opens all shards of a folder once.
    ///
    /// # Errors
    /// [`Error::Input`] that names all shards that are missing, damaged, or of another run.
    pub fn open(folder: &Path) -> Result<ShardSet> {
        let listed = ShardSet::list(folder)?;
        let mut problems = Diagnostics::default();
        if listed.len() > 1 {
            let counts: Vec<String> =
                listed.iter().map(|(of, numbers)| format!("{} of {of}", numbers.len())).collect();
            return Err(Error::input_with_help(
                format!("{} contains shards of different runs: {}", folder.display(), counts.join(", ")),
                "all shards of a run have the same N in --shard K/N; remove the files of the others",
            ));
        }
        let Some((of, present)) = listed.into_iter().next() else {
            return Err(no_shards(folder));
        };
        let mut damaged = BTreeMap::new();
        let mut runs = Runs::default();
        let (mut pulses, mut echoes) = (0u64, 0u64);
        for &number in &present {
            match ShardFile::open(&shard_path(folder, OneOf { number, of })) {
                Ok(shard) if (shard.head.number, shard.head.of) != (number, of) => {
                    let ShardHead { number: stated, of, .. } = shard.head;
                    damaged.insert(number, ShardFileError::Other { number: stated, of });
                }
                Ok(shard) => {
                    (pulses, echoes) = (pulses + shard.pulses, echoes + shard.echoes);
                    runs.add(shard.head);
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
                .error(None, format!("{} of {of} shards are missing in {}", missing.len(), folder.display()))
                .help(compute_again(folder, of, missing));
        }
        problems.finish(false)?;
        let head = runs.0.into_iter().next().map(|(head, _)| head);
        let head = head.ok_or_else(|| Error::Internal("a folder of shards without shards".to_owned()))?;
        if pulses != head.total {
            return Err(Error::input(format!(
                "the shards in {} contain {pulses} pulses in total instead of {}",
                folder.display(),
                head.total
            )));
        }
        Ok(ShardSet { folder: folder.to_path_buf(), head, echoes })
    }

    /// Opens one of the shards.
    ///
    /// # Errors
    /// [`Error::Input`] for a shard that has been changed or removed meanwhile.
    pub fn shard(&self, number: u32) -> Result<ShardFile> {
        let path = shard_path(&self.folder, OneOf { number, of: self.head.of });
        ShardFile::open(&path).map_err(|reason| {
            let mut problems = Diagnostics::default();
            report_damaged(&self.folder, self.head.of, &BTreeMap::from([(number, reason)]), &mut problems);
            Error::Input(Box::new(problems))
        })
    }

    /// Reads all shards and names those that are damaged.
    ///
    /// # Errors
    /// [`Error::Input`] with all damaged shards.
    pub fn verify(&self, stop: &Stop) -> Result<()> {
        let mut damaged = BTreeMap::new();
        for number in (0..self.head.of).take_while(|_| !stop.is_requested()) {
            let path = shard_path(&self.folder, OneOf { number, of: self.head.of });
            if let Err(reason) = ShardFile::open(&path).and_then(|shard| shard.verify()) {
                damaged.insert(number, reason);
            }
        }
        let mut problems = Diagnostics::default();
        report_damaged(&self.folder, self.head.of, &damaged, &mut problems);
        problems.finish(false).map(drop)
    }
}

/// How shards are computed that are missing or damaged.
fn compute_again(folder: &Path, of: u32, numbers: impl IntoIterator<Item = u32> + Clone) -> String {
    let first = numbers.clone().into_iter().next().unwrap_or(0);
    let several = folder_of_scanners(folder, of)
        .map_or_else(String::new, |run| format!("with several scanners -o {}; ", run.display()));
    format!(
        "compute them again with --resume, which replaces damaged shards: `vlscan run … -o {} --shard \
         {first}/{of} --resume` ({several}as an array job: --array={}); or repeat the command if it was one \
         `vlscan run --resume`",
        folder.display(),
        array_list(numbers)
    )
}

/// The folder above, if other folders in it have as many shards: those of several scanners are written by one
/// command.
fn folder_of_scanners(folder: &Path, of: u32) -> Option<&Path> {
    let run = folder.parent()?;
    let run = if run.as_os_str().is_empty() { Path::new(".") } else { run };
    let entries = std::fs::read_dir(run).ok()?;
    let mut others = entries.flatten().filter(|entry| Some(&*entry.file_name()) != folder.file_name());
    let has_shards =
        |path: PathBuf| path.is_dir() && ShardSet::list(&path).is_ok_and(|shards| shards.contains_key(&of));
    others.any(|entry| has_shards(entry.path())).then_some(run)
}

fn report_damaged(
    folder: &Path,
    of: u32,
    damaged: &BTreeMap<u32, ShardFileError>,
    problems: &mut Diagnostics,
) {
    let again = compute_again(folder, of, damaged.keys().copied());
    for (i, (&number, reason)) in damaged.iter().take(MAX_LISTED).enumerate() {
        let path = shard_path(folder, OneOf { number, of });
        let problem = problems.error(None, format!("{} {reason}", path.display()));
        if i + 1 == damaged.len().min(MAX_LISTED) {
            problem.help(again.clone());
        }
    }
}

/// The runs that shards belong to: the head of a shard of each, and the numbers of all.
#[derive(Default)]
struct Runs(Vec<(ShardHead, Vec<u32>)>);

impl Runs {
    fn add(&mut self, head: ShardHead) {
        let number = head.number;
        let is_its = |known: &ShardHead| ShardHead { number: known.number, ..head.clone() } == *known;
        match self.0.iter_mut().find(|(known, _)| is_its(known)) {
            Some((_, numbers)) => numbers.push(number),
            None => self.0.push((head, vec![number])),
        }
    }

    /// Reports the shards whose run differs from the run of most shards.
    fn report(&mut self, folder: &Path, problems: &mut Diagnostics) {
        self.0.sort_by_key(|(_, numbers)| std::cmp::Reverse(numbers.len()));
        let Some(((most, _), others)) = self.0.split_first() else { return };
        for (head, numbers) in others {
            let what = most.difference(head);
            problems
                .error(
                    None,
                    format!(
                        "shards {} in {} belong to another run; they differ in {what}",
                        array_list(numbers.iter().copied()),
                        folder.display()
                    ),
                )
                .help("compute all shards with the same survey, scene, options and version");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::file::tests::{head, shard};
    use super::*;
    use std::fs;

    #[test]
    fn numbers_are_listed_as_array_jobs_take_them() {
        assert_eq!(array_list([3, 17, 40, 41, 42, 43, 44]), "3,17,40-44");
        assert_eq!((array_list([]), array_list([0, 1])), (String::new(), "0-1".to_owned()));
    }

    #[test]
    fn names_hold_number_and_count() {
        assert_eq!(
            shard_path(Path::new("d"), OneOf { number: 3, of: 256 }),
            Path::new("d/shard-000003-of-000256.vlshard")
        );
        assert_eq!(parse_name("shard-000003-of-000256.vlshard"), Some((3, 256)));
        for name in
            ["shard-000007-of-000007.vlshard", "shard-1-of-2.vlshard.x.part", "shard-a-of-2.vlshard", "index"]
        {
            assert_eq!(parse_name(name), None, "{name}");
        }
    }

    #[test]
    fn names_alone_make_no_file_one_of_parts() {
        let dir = tempfile::tempdir().unwrap();
        let (numbered, plan) =
            (shard_path(dir.path(), OneOf { number: 0, of: 2 }), Borders::path(dir.path()));
        for path in [&numbered, &plan] {
            assert!(!is_file_of_shards(path));
            fs::write(path, "precious").unwrap();
            assert!(!is_file_of_shards(path) && !is_shard(path));
        }
        fs::write(&numbered, &shard(&head(0, 2))[..9]).unwrap();
        fs::write(&plan, borders::MAGIC).unwrap();
        assert!(is_file_of_shards(&numbered) && is_shard(&numbered) && is_file_of_shards(&plan));
        let other = dir.path().join("notes.txt");
        fs::copy(&numbered, &other).unwrap();
        assert!(!is_file_of_shards(&other));
    }

    #[test]
    fn missing_shards_of_several_scanners_are_computed_by_one_command() {
        let dir = tempfile::tempdir().unwrap();
        let put = |scanner: &str, number: u32| {
            let folder = dir.path().join(scanner);
            fs::create_dir_all(&folder).unwrap();
            fs::write(shard_path(&folder, OneOf { number, of: 3 }), shard(&head(number, 3))).unwrap();
            folder
        };
        let roof = put("roof", 1);
        let advice = || compute_again(&roof, 3, [0, 2]);
        assert!(advice().contains("--resume` (as an array job: --array=0,2)"), "{}", advice());
        put("front", 1);
        let expected = format!("(with several scanners -o {}; as an array", dir.path().display());
        assert!(advice().contains(&expected), "{}", advice());
    }

    #[test]
    fn everything_wrong_with_a_folder_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let refused = || ShardSet::open(dir.path()).unwrap_err();
        let shown = |error: Error| match error {
            Error::Input(found) => found.text(),
            other => other.to_string(),
        };
        assert!(shown(refused()).contains("contains no shards"));
        assert!(!shown(refused()).contains("vlscan merge"));
        // The shards of a scanner of several.
        let roof = dir.path().join("roof");
        fs::create_dir(&roof).unwrap();
        assert!(!shown(refused()).contains("vlscan merge"));
        fs::write(shard_path(&roof, OneOf { number: 0, of: 8 }), shard(&head(0, 8))).unwrap();
        let advice = format!("vlscan merge {}", roof.display());
        assert!(shown(refused()).contains(&advice), "{}", shown(refused()));
        fs::remove_dir_all(&roof).unwrap();
        let put = |head: &ShardHead| {
            fs::write(shard_path(dir.path(), OneOf { number: head.number, of: head.of }), shard(head))
                .unwrap()
        };
        [0, 1, 2, 4, 5, 6].into_iter().for_each(|number| put(&head(number, 8)));
        assert!(shown(refused()).contains("--array=3,7"), "{}", shown(refused()));
        put(&head(3, 8));
        put(&head(7, 8));
        let set = ShardSet::open(dir.path()).unwrap();
        assert_eq!((set.head.of, set.echoes), (8, 8 * 520));
        set.verify(&Stop::new()).unwrap();
        // Another seed in two shards.
        let mut other = head(1, 8);
        other.fingerprint = Default::default();
        other.fingerprint.flight("seed", 12);
        put(&other);
        put(&ShardHead { number: 2, ..other });
        let text = shown(refused());
        assert!(text.contains("shards 1-2 in") && text.contains("seed (11, 12)"), "{text}");
        [1, 2].into_iter().for_each(|number| put(&head(number, 8)));
        // Damage in a block is found by reading, damage of the length by opening.
        let path = shard_path(dir.path(), OneOf { number: 5, of: 8 });
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(&path, &bytes).unwrap();
        let text = shown(ShardSet::open(dir.path()).unwrap().verify(&Stop::new()).unwrap_err());
        assert!(text.contains("shard-000005-of-000008.vlshard") && text.contains("--array=5"), "{text}");
        fs::write(&path, &bytes[..middle]).unwrap();
        assert!(shown(refused()).contains("truncated"));
        put(&head(0, 3));
        assert!(shown(refused()).contains("1 of 3, 8 of 8"));
    }
}
