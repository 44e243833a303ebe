//! Merges that many processes share: each writes a segment of the points, a LAS or LAZ file of its own, and the segments are
//! joined by copying.

use super::merge::{check_records, merge_echoes};
use super::pass::Control;
use super::session::Report;
use crate::diag::Diagnostics;
use crate::error::{Error, Result};
use crate::files::NewFolder;
use crate::output::{JOINED_POINTS, LasVersion, OutputRequest, PointFormat, Summary, Target, join};
use crate::parts::{PartHead, PartSet, PrivateFolder, array_list};
use crate::schedule::Schedule;
use crate::store::Checksum;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// The segments of an output.
struct Segments<'a> {
    parts: &'a PartSet,
    out: PathBuf,
    folder: PathBuf,
    /// Tells segments of other parts and of other settings apart.
    digest: u64,
    extension: &'static str,
}

impl<'a> Segments<'a> {
    /// The segments of the one output of `request`.
    fn new(parts: &'a PartSet, request: &OutputRequest) -> Result<Segments<'a>> {
        check_records(parts, request)?;
        let refuse = |what: &str| {
            let mut problems = Diagnostics::default();
            problems
                .error(None, format!("a merge in parts writes one LAS or LAZ file, {what}"))
                .help("merge other outputs without --part, one process for each if it takes long");
            Err(Error::Input(Box::new(problems)))
        };
        let (out, format) = match request.sinks.as_slice() {
            [(Target::File(path), format @ (PointFormat::Las | PointFormat::Laz))] => (path.clone(), *format),
            _ => return refuse("expected -o NAME.las or -o NAME.laz alone"),
        };
        let las = &request.las;
        let others = [
            (request.waveforms, "not waveforms"),
            (request.pulses, "not pulses"),
            (request.trajectory.is_some(), "not poses"),
            (request.split_by_channel, "not one per channel"),
            (request.misses, "without pulses that have no echoes"),
            (las.packets.is_some(), "without waveform packets"),
            (las.at_most.is_some(), "not a stream"),
            (las.version != LasVersion::V14, "of version 1.4"),
        ];
        if let Some((_, what)) = others.iter().find(|(is_wanted, _)| *is_wanted) {
            return refuse(what);
        }
        let (sinks, inputs, companions) = (Vec::new(), Vec::new(), Vec::new());
        let settings = OutputRequest { sinks, inputs, companions, force: false, ..request.clone() };
        let head = PartHead { number: 0, ..parts.head.clone() };
        let mut sum = Checksum::default();
        sum.debug(&(head, settings, format));
        let mut folder = out.clone().into_os_string();
        folder.push(".segments");
        let extension = format.extension();
        Ok(Segments { parts, out, folder: folder.into(), digest: sum.finish(), extension })
    }

    /// The echoes of a segment. Each but the last one ends with a whole chunk of LAZ.
    fn range(&self, number: u32, of: u32) -> Range<u64> {
        let total = self.parts.echoes;
        let at = |n: u32| match n {
            n if n >= of => total,
            n => {
                let even = (u128::from(total) * u128::from(n) / u128::from(of)) as u64;
                even / JOINED_POINTS * JOINED_POINTS
            }
        };
        at(number)..at(number + 1)
    }

    fn name(&self, number: u32, of: u32) -> String {
        format!("segment-{number:06}-of-{of:06}-{:016x}.{}", self.digest, self.extension)
    }

    /// Number of segment and number of segments in the name of a file.
    fn parse_name(&self, name: &str) -> Option<(u32, u32)> {
        let end = format!("-{:016x}.{}", self.digest, self.extension);
        let (number, of) = name.strip_prefix("segment-")?.strip_suffix(&end)?.split_once("-of-")?;
        let (number, of) = (number.parse().ok()?, of.parse().ok()?);
        (number < of).then_some((number, of))
    }

    /// The number of segments into which the output is divided.
    ///
    /// # Errors
    /// [`Error::Input`] when segments are missing, with their numbers.
    fn count(&self) -> Result<u32> {
        let mut found: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
        let failed = |e| Error::open(&self.folder, e);
        for entry in std::fs::read_dir(&self.folder).map_err(failed)? {
            if let Some((number, of)) =
                entry.map_err(failed)?.file_name().to_str().and_then(|n| self.parse_name(n))
            {
                found.entry(of).or_default().insert(number);
            }
        }
        let is_complete = |(of, numbers): &(&u32, &BTreeSet<u32>)| numbers.len() as u64 == u64::from(**of);
        if let Some((&of, _)) = found.iter().find(is_complete) {
            return Ok(of);
        }
        let mut problems = Diagnostics::default();
        match found.iter().max_by_key(|(_, numbers)| numbers.len()) {
            Some((&of, numbers)) => {
                let missing: Vec<u32> = (0..of).filter(|number| !numbers.contains(number)).collect();
                let text =
                    format!("{} of {of} segments are missing in {}", missing.len(), self.folder.display());
                problems.error(None, text).help(format!("merge them: --array={}", array_list(missing)));
            }
            None => {
                let text = format!("{} holds no segments of these parts and options", self.folder.display());
                problems
                    .error(None, text)
                    .help("merge them first: vlscan merge … --part K/M, with the same options");
            }
        }
        Err(Error::Input(Box::new(problems)))
    }
}

/// Writes segment `number` of `of` of an output: `OUT.segments/segment-…`. An existing one is replaced.
///
/// # Errors
/// As for [`merge`](super::merge()); [`Error::Input`] for outputs that cannot be divided.
pub fn merge_segment(
    parts: &PartSet,
    outputs: &OutputRequest,
    (number, of): (u32, u32),
    schedule: Schedule,
    control: Control<'_>,
) -> Result<Report> {
    let segments = Segments::new(parts, outputs)?;
    let folder = segments.folder.as_path();
    let made = NewFolder::create_all(folder).map_err(|e| Error::io("create", folder, e))?;
    let private = PrivateFolder::new(folder)?;
    let name = segments.name(number, of);
    let format = outputs.sinks[0].1;
    let request =
        OutputRequest { sinks: vec![(Target::File(private.path(&name)), format)], ..outputs.clone() };
    let mut report = merge_echoes(parts, request, segments.range(number, of), schedule, control)?;
    if !report.interrupted {
        let path = private.publish(&name)?;
        report.summary.files.iter_mut().for_each(|file| file.path = Some(path.clone()));
        made.keep();
    }
    Ok(report)
}

/// Joins the segments of an output, which stay as they are.
///
/// # Errors
/// [`Error::Input`] when segments are missing, with their numbers, or damaged; [`Error::Io`], [`Error::Interrupted`].
pub fn join_segments(parts: &PartSet, outputs: &OutputRequest, control: Control<'_>) -> Result<Report> {
    let started = Instant::now();
    let segments = Segments::new(parts, outputs)?;
    let of = segments.count()?;
    let files: Vec<(PathBuf, u64)> = (0..of)
        .map(|number| {
            let range = segments.range(number, of);
            (segments.folder.join(segments.name(number, of)), range.end - range.start)
        })
        .collect();
    check_out(&segments.out, outputs.force)?;
    let mut copied = 0;
    let file = join(&files, &segments.out, outputs.force, |points| {
        copied += points;
        control.progress.add(0, points, 0, copied as f64 / parts.echoes.max(1) as f64);
        !control.stop.is_requested()
    })?;
    let points = file.records;
    let summary = Summary { files: vec![file], points, ..Summary::default() };
    let seconds = started.elapsed().as_secs_f64();
    Ok(Report { summary, pulses: parts.head.total, seconds, interrupted: false })
}

fn check_out(out: &Path, force: bool) -> Result<()> {
    if out.exists() && !force && !crate::files::is_special(out) {
        return Err(Error::input(format!("{} exists; --force replaces it", out.display())));
    }
    Ok(())
}
