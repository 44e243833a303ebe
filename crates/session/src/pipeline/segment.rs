//! Merges that many processes share: each writes a segment of the points, a separate LAS or LAZ file, and the
//! segments are joined by copying. The name of a segment has the checksum of the file, with which joining
//! compares the copied bytes.

use super::merge::{check_records, merge_echoes};
use super::pass::RunContext;
use super::run::Report;
use crate::output::{
    JOINED_POINTS, LasVersion, OutputRequest, OutputSummary, PointFormat, Segment, Target, join,
};
use crate::shards::{OneOf, PrivateFolder, ShardHead, ShardSet, array_list};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::NewFolder;
use vlscan_base::store::Checksum;
use vlscan_warehouse::Schedule;

/// The segments of an output.
struct Segments<'a> {
    shards: &'a ShardSet,
    out: PathBuf,
    folder: PathBuf,
    /// Tells segments of other shards and of other settings apart.
    digest: u64,
    extension: &'static str,
}

impl<'a> Segments<'a> {
    /// The segments of the one output of `request`.
    fn new(shards: &'a ShardSet, request: &OutputRequest) -> Result<Segments<'a>> {
        check_records(shards, request)?;
        let refuse = |what: &str| {
            Err(Error::input_with_help(
                format!("--segment and --join write one LAS or LAZ file, {what}"),
                "merge other outputs without --segment, if necessary each in its own process",
            ))
        };
        let (out, format) = match request.sinks.as_slice() {
            [(Target::File(path), format @ (PointFormat::Las | PointFormat::Laz))] => (path.clone(), *format),
            _ => return refuse("expected -o NAME.las or -o NAME.laz alone"),
        };
        let las = &request.cloud.las;
        let others = [
            (request.waveforms, "not waveforms"),
            (request.pulses, "not pulses"),
            (request.trajectory.is_some(), "not poses"),
            (request.split_by_channel, "not one per channel"),
            (request.cloud.misses, "without pulses that have no echoes"),
            (las.packets.is_some(), "without waveform packets"),
            (las.at_most.is_some(), "not a stream"),
            (las.version != LasVersion::V14, "of version 1.4"),
        ];
        if let Some((_, what)) = others.iter().find(|(is_set, _)| *is_set) {
            return refuse(what);
        }
        let (sinks, inputs, companions) = (Vec::new(), Vec::new(), Vec::new());
        let settings = OutputRequest { sinks, inputs, companions, force: false, ..request.clone() };
        let head = ShardHead { number: 0, ..shards.head.clone() };
        let mut sum = Checksum::default();
        sum.debug(&(head, settings, format));
        let mut folder = out.clone().into_os_string();
        folder.push(".segments");
        let extension = format.extension();
        Ok(Segments { shards, out, folder: folder.into(), digest: sum.finish(), extension })
    }

    /// The echoes of a segment. Each but the last one ends with a whole chunk of LAZ.
    fn range(&self, OneOf { number, of }: OneOf) -> Range<u64> {
        let total = self.shards.echoes;
        let at = |n: u32| match n {
            n if n >= of => total,
            n => {
                let even = (u128::from(total) * u128::from(n) / u128::from(of)) as u64;
                even / JOINED_POINTS * JOINED_POINTS
            }
        };
        at(number)..at(number + 1)
    }

    fn name(&self, number: u32, of: u32, sum: u64) -> String {
        format!("segment-{number:06}-of-{of:06}-{:016x}-{sum:016x}.{}", self.digest, self.extension)
    }

    /// Number of segment, number of segments and checksum in the name of a file.
    fn parse_name(&self, name: &str) -> Option<(u32, u32, u64)> {
        let (place, digests) = name.strip_prefix("segment-")?.split_at_checked("000000-of-000000".len())?;
        let (number, of) = place.split_once("-of-")?;
        let (number, of) = (number.parse().ok()?, of.parse().ok()?);
        let sum = digests.strip_prefix(&format!("-{:016x}-", self.digest))?.strip_suffix(self.extension)?;
        let sum = u64::from_str_radix(sum.strip_suffix('.')?, 16).ok()?;
        (number < of && self.name(number, of, sum) == name).then_some((number, of, sum))
    }

    /// Number of segment, number of segments and checksum of all segments in the folder.
    fn list(&self) -> Result<Vec<(u32, u32, u64)>> {
        let failed = |e| Error::open(&self.folder, e);
        let mut found = Vec::new();
        for entry in std::fs::read_dir(&self.folder).map_err(failed)? {
            let name = entry.map_err(failed)?.file_name();
            found.extend(name.to_str().and_then(|name| self.parse_name(name)));
        }
        Ok(found)
    }

    /// The files of all segments, in order.
    ///
    /// # Errors
    /// [`Error::Input`] when segments are missing, with their numbers.
    fn find(&self) -> Result<Vec<Segment>> {
        let mut found: BTreeMap<u32, BTreeMap<u32, u64>> = BTreeMap::new();
        for (number, of, sum) in self.list()? {
            found.entry(of).or_default().insert(number, sum);
        }
        let is_complete = |(of, sums): &(&u32, &BTreeMap<u32, u64>)| sums.len() as u64 == u64::from(**of);
        if let Some((&of, sums)) = found.iter().find(is_complete) {
            let segment = |(&number, &sum)| {
                let range = self.range(OneOf { number, of });
                let path = self.folder.join(self.name(number, of, sum));
                Segment { path, records: range.end - range.start, sum }
            };
            return Ok(sums.iter().map(segment).collect());
        }
        let folder = self.folder.display();
        let Some((&of, sums)) = found.iter().max_by_key(|(_, sums)| sums.len()) else {
            return Err(Error::input_with_help(
                format!("{folder} contains no segments of these shards and options"),
                "merge them first: vlscan merge … --segment K/M, with the same options",
            ));
        };
        let missing: Vec<u32> = (0..of).filter(|number| !sums.contains_key(number)).collect();
        let text = format!("{} of {of} segments are missing in {folder}", missing.len());
        Err(Error::input_with_help(text, merge_again(of, &missing)))
    }

    /// Moves the file of a segment from the folder of this process to the shared one, where it replaces
    /// earlier ones of its number.
    fn publish(&self, private: PrivateFolder, written: &str, OneOf { number, of }: OneOf) -> Result<PathBuf> {
        let mut sum = Checksum::default();
        let path = private.path(written);
        sum.file(&path).map_err(|e| Error::io("read", path, e))?;
        let sum = sum.finish();
        let path = private.publish_as(written, self.name(number, of, sum))?;
        for earlier in self.list()?.into_iter().filter(|found| (found.0, found.1) == (number, of)) {
            if earlier.2 != sum {
                let path = self.folder.join(self.name(number, of, earlier.2));
                std::fs::remove_file(&path).map_err(|e| Error::io("remove", path, e))?;
            }
        }
        Ok(path)
    }
}

/// How segments are written that are missing or damaged.
fn merge_again(of: u32, numbers: &[u32]) -> String {
    format!(
        "repeat this command with --segment {}/{of} instead of --join (as an array job: --array={}), then \
         with --join",
        numbers.first().unwrap_or(&0),
        array_list(numbers.iter().copied())
    )
}

/// Names the segments that do not match their checksums.
fn check_sums(segments: &[Segment]) -> Result<()> {
    let of = segments.len() as u32;
    let is_damaged = |segment: &Segment| {
        let mut sum = Checksum::default();
        sum.file(&segment.path).is_err() || sum.finish() != segment.sum
    };
    let damaged: Vec<u32> =
        (0..of).into_par_iter().filter(|&number| is_damaged(&segments[number as usize])).collect();
    let mut problems = Diagnostics::default();
    for (i, &number) in damaged.iter().enumerate() {
        let path = segments[number as usize].path.display();
        let problem = problems.error(None, format!("{path} is damaged: it does not match its checksum"));
        if i + 1 == damaged.len() {
            problem.help(merge_again(of, &damaged));
        }
    }
    problems.finish(false).map(drop)
}

/// Writes segment `number` of `of` of an output: `OUT.segments/segment-…`. An existing one is replaced.
///
/// # Errors
/// As for [`merge`](super::merge()); [`Error::Input`] for outputs that cannot be divided.
pub fn merge_segment(
    shards: &ShardSet,
    outputs: &OutputRequest,
    segment: OneOf,
    schedule: Schedule,
    control: RunContext<'_>,
) -> Result<Report> {
    let segments = Segments::new(shards, outputs)?;
    let folder = segments.folder.as_path();
    let made = NewFolder::create_all(folder).map_err(|e| Error::io("create", folder, e))?;
    let private = PrivateFolder::new(folder)?;
    let format = outputs.sinks[0].1;
    let written = format!("segment.{}", segments.extension);
    let request =
        OutputRequest { sinks: vec![(Target::File(private.path(&written)), format)], ..outputs.clone() };
    let mut report = merge_echoes(shards, request, segments.range(segment), schedule, control)?;
    if !report.interrupted {
        let path = segments.publish(private, &written, segment)?;
        report.summary.files.iter_mut().for_each(|file| file.path = Some(path.clone()));
        made.keep();
    }
    Ok(report)
}

/// Joins the segments of an output, which are kept.
///
/// # Errors
/// [`Error::Input`] when segments are missing, with their numbers, or damaged; [`Error::Io`],
/// [`Error::Interrupted`].
pub fn join_segments(shards: &ShardSet, outputs: &OutputRequest, control: RunContext<'_>) -> Result<Report> {
    let started = Instant::now();
    let segments = Segments::new(shards, outputs)?;
    let files = segments.find()?;
    check_out(&segments.out, outputs.force)?;
    let mut copied = 0;
    let joined = join(&files, &segments.out, outputs.force, |points| {
        copied += points;
        control.progress.add(0, points, 0, copied as f64 / shards.echoes.max(1) as f64);
        !control.stop.is_requested()
    });
    if let Err(Error::Input(_) | Error::Io { action: "read", .. }) = joined {
        check_sums(&files)?;
    }
    let file = joined?;
    let points = file.records;
    let summary = OutputSummary { files: vec![file], points, ..OutputSummary::default() };
    let seconds = started.elapsed().as_secs_f64();
    let warnings = Diagnostics::default();
    Ok(Report { summary, pulses: shards.head.total, seconds, interrupted: false, warnings })
}

fn check_out(out: &Path, force: bool) -> Result<()> {
    vlscan_base::files::refuse_unwritable(out, force)
}
