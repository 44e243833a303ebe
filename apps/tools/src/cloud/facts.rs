//! Description of a point cloud: counts, density, extent, system, classes, returns, times, flight lines, in
//! one pass and in memory that does not grow with the number of points.

use super::facts_text::{ADJUSTED, likely_dates};
use super::occupancy::Occupancy;
use super::source::CloudSource;
use std::collections::{BTreeMap, HashSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::Result;
use vlscan_base::quantity::counted;
use vlscan_crs as crs;
use vlscan_formats::{Attribute, AttributeSet, FileFacts, PointRow, PointSink, StrayFinder};
use vlscan_geom::{Aabb, MAX_COORDINATE};

/// Most different objects that are counted.
const MAX_OBJECTS: usize = 1 << 20;

/// Seconds of a week.
pub(super) const WEEK_S: f64 = 604_800.0;

/// Smallest and largest of some values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// The smallest.
    pub min: f64,
    /// The largest.
    pub max: f64,
}

impl Span {
    fn with(span: Option<Span>, value: f64) -> Option<Span> {
        let Some(Span { min, max }) = span else { return Some(Span { min: value, max: value }) };
        Some(Span { min: min.min(value), max: max.max(value) })
    }

    fn union(self, other: Span) -> Span {
        Span { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// True if times, s, cannot be seconds of the GPS week. Some recordings continue past the end of the
    /// week.
    fn is_beyond_week(self) -> bool {
        self.min < 0.0 || self.max > 2.0 * WEEK_S
    }
}

/// The points of a flight line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LineFacts {
    /// Number of points.
    pub points: u64,
    /// Their times, s.
    pub time: Option<Span>,
}

/// Facts about the points of one file or of several.
#[derive(Clone, Debug, Default)]
pub struct CloudSummary {
    /// The files in order, with what they are.
    pub files: Vec<(PathBuf, Option<FileFacts>)>,
    /// Number of points, without those below.
    pub points: u64,
    /// Pulses without a return, which this program writes for `--misses`.
    pub misses: u64,
    /// Points of return 0 of 0: programs add such points, or merge them from photogrammetry.
    pub without_number: u64,
    /// Points without coordinates within ±[`MAX_COORDINATE`].
    pub skipped: u64,
    /// Box around the points, m.
    pub bounds: Option<Aabb>,
    /// System of the coordinates as WKT, of the first file that names one.
    pub crs: Option<String>,
    /// The attributes that points of at least one file have.
    attributes: Vec<Attribute>,
    /// Number of points by class.
    pub by_class: BTreeMap<u8, u64>,
    /// Number of points by return number.
    pub by_return: BTreeMap<u8, u64>,
    /// Number of first returns by the number of returns of their pulse.
    pub pulses_by_returns: BTreeMap<u8, u64>,
    /// Intensities.
    pub intensity: Option<Span>,
    intensities: (u64, f64),
    /// Scan angles, degrees.
    pub scan_angle: Option<Span>,
    /// Times, s.
    pub time: Option<Span>,
    /// Flight lines by point source id of LAS, or by leg in other formats.
    pub lines: BTreeMap<u16, LineFacts>,
    /// Number of points by channel.
    pub by_channel: BTreeMap<u16, u64>,
    objects: HashSet<u64>,
    cover: Occupancy,
    strays: StrayFinder,
    /// True if the file that is being read is LAS, and what its points have.
    is_las: bool,
    of_file: AttributeSet,
}

/// Describes the points of some clouds as if they were one. Returns also what there is to say of the clouds.
///
/// # Errors
/// [`Error::Io`](vlscan_base::Error::Io); [`Error::Input`](vlscan_base::Error::Input) when a file is of no
/// format that is read or damaged.
pub fn cloud_facts(clouds: &[CloudSource]) -> Result<(CloudSummary, Diagnostics)> {
    let (mut facts, mut all) = (CloudSummary::default(), Diagnostics::default());
    for cloud in clouds {
        let path = cloud.name();
        let (skipped, without_number) = (facts.skipped, facts.without_number);
        let mut found = Diagnostics::default();
        facts.files.push((path.to_path_buf(), None));
        facts.is_las = false;
        let (named, times_before) = (facts.crs.take(), facts.time.take());
        let mut sink = FileSink::new(&mut facts);
        cloud.read(&mut sink, &mut found)?;
        sink.finish();
        if let (Some(first), Some(this)) = (&named, &facts.crs)
            && crs::differ(first, this)
        {
            let message =
                format!("its system is {}, that of the files before {}", crs::name(this), crs::name(first));
            found.warn(Some(Place::of_file(path)), message);
        }
        facts.crs = named.or(facts.crs.take());
        if let Some((span, is_adjusted)) = facts.time.zip(facts.stated_times_of_last_file()) {
            let stated = match is_adjusted {
                true if !ADJUSTED.is_likely(span) => Some("adjusted standard GPS time".to_owned()),
                false if span.is_beyond_week() => {
                    Some(format!("seconds of the GPS week, which are 0 to {WEEK_S}"))
                }
                _ => None,
            };
            if let Some(stated) = stated {
                let (min, max, dates) = (span.min, span.max, likely_dates(span));
                let message =
                    format!("its header states {stated}, and times are {min:.3} to {max:.3}{dates}");
                found.warn(Some(Place::of_file(path)), message);
            }
        }
        facts.time = [times_before, facts.time].into_iter().flatten().reduce(Span::union);
        let left_out = facts.skipped - skipped;
        if left_out > 0 {
            let points = counted(left_out, "point");
            let message = format!("left out: {points} without coordinates within ±{MAX_COORDINATE:e} m");
            found.warn(Some(Place::of_file(path)), message);
        }
        let without_number = facts.without_number - without_number;
        if without_number > 0 {
            let message =
                format!("{without_number} points have no return number (0 of 0); they count as points");
            found.note(Some(Place::of_file(path)), message);
        }
        all.extend(found.finish(false)?);
    }
    let mut found = Diagnostics::default();
    let names: Vec<String> = clouds.iter().map(|cloud| cloud.name().display().to_string()).collect();
    facts.strays.strays().warn(Path::new(&names.join(", ")), "described like the rest", &mut found);
    all.extend(found);
    Ok((facts, all))
}

/// Counts the points of a file and adds them to the facts. Numbers are counted in tables, which are faster
/// than maps.
struct FileSink<'a> {
    facts: &'a mut CloudSummary,
    by_class: Box<[u64; 256]>,
    by_return: Box<[u64; 256]>,
    pulses_by_returns: Box<[u64; 256]>,
    by_channel: Vec<u64>,
    /// The flight line of the last points, whose counts are not yet among those of the facts.
    line: Option<(u16, LineFacts)>,
    /// The object of the last point.
    object: Option<u64>,
}

impl PointSink for FileSink<'_> {
    fn start(&mut self, attributes: AttributeSet) {
        self.facts.of_file = attributes;
        self.facts.note_attributes();
    }

    fn file(&mut self, facts: &FileFacts) {
        self.facts.is_las = facts.las.is_some();
        if let Some((_, file)) = self.facts.files.last_mut() {
            *file = Some(facts.clone());
        }
    }

    fn crs(&mut self, wkt: &str) {
        self.facts.crs = Some(wkt.to_owned());
    }

    fn point(&mut self, row: &PointRow, object: Option<&str>) -> Result<ControlFlow<()>> {
        self.add(row, object);
        Ok(ControlFlow::Continue(()))
    }
}

impl FileSink<'_> {
    fn new(facts: &mut CloudSummary) -> FileSink<'_> {
        let none = || Box::new([0; 256]);
        FileSink {
            facts,
            by_class: none(),
            by_return: none(),
            pulses_by_returns: none(),
            by_channel: vec![0; 1 << 16],
            line: None,
            object: None,
        }
    }

    fn add(&mut self, row: &PointRow, object: Option<&str>) {
        let p = row.position;
        // Also false for NaN.
        if !(p.is_finite() && p.abs().max_element() <= MAX_COORDINATE) {
            self.facts.skipped += 1;
            return;
        }
        if row.is_miss {
            self.facts.misses += 1;
            return;
        }
        self.count(row, object);
    }

    fn count(&mut self, row: &PointRow, object: Option<&str>) {
        let p = row.position;
        let of_file = self.facts.of_file;
        let has = |attribute| of_file.has(attribute);
        let facts = &mut *self.facts;
        facts.points += 1;
        facts.bounds = Some(facts.bounds.unwrap_or(Aabb::EMPTY).with(p));
        facts.cover.mark(p.x, p.y);
        facts.strays.add(p);
        if has(Attribute::Class) {
            self.by_class[usize::from(row.class)] += 1;
        }
        if has(Attribute::ReturnNumber) {
            self.by_return[usize::from(row.return_number)] += 1;
            if row.return_number <= 1 && has(Attribute::NumberOfReturns) {
                self.pulses_by_returns[usize::from(row.number_of_returns)] += 1;
                facts.without_number += u64::from(row.return_number == 0 && row.number_of_returns == 0);
            }
        }
        if has(Attribute::Intensity) && !row.intensity.is_nan() {
            let value = f64::from(row.intensity);
            facts.intensity = Span::with(facts.intensity, value);
            facts.intensities = (facts.intensities.0 + 1, facts.intensities.1 + value);
        }
        if has(Attribute::ScanAngle) {
            facts.scan_angle = Span::with(facts.scan_angle, row.scan_angle);
        }
        let time = has(Attribute::Time).then_some(row.time);
        if let Some(time) = time {
            facts.time = Span::with(facts.time, time);
        }
        if has(Attribute::Channel) {
            self.by_channel[usize::from(row.channel)] += 1;
        }
        if has(Attribute::Leg) {
            self.count_of_line(if self.facts.is_las { row.point_source } else { row.leg }, time);
        }
        if has(Attribute::Object) {
            self.note_object(row, object);
        }
    }

    fn count_of_line(&mut self, number: u16, time: Option<f64>) {
        if self.line.is_none_or(|(current, _)| current != number) {
            self.end_line();
        }
        let (_, line) = self.line.get_or_insert((number, LineFacts::default()));
        line.points += 1;
        line.time = time.map_or(line.time, |time| Span::with(line.time, time));
    }

    /// Adds the counts of the flight line of the last points to the facts.
    fn end_line(&mut self) {
        if let Some((number, counted)) = self.line.take() {
            let line = self.facts.lines.entry(number).or_default();
            line.points += counted.points;
            line.time = [line.time, counted.time].into_iter().flatten().reduce(Span::union);
        }
    }

    fn note_object(&mut self, row: &PointRow, object: Option<&str>) {
        let object = match object {
            Some(name) => {
                let mut hasher = DefaultHasher::new();
                name.hash(&mut hasher);
                hasher.finish()
            }
            None => row.object as u64,
        };
        if self.object != Some(object) && self.facts.objects.len() < MAX_OBJECTS {
            self.facts.objects.insert(object);
            self.object = Some(object);
        }
    }

    /// Adds all counts to the facts.
    fn finish(mut self) {
        self.end_line();
        let facts = self.facts;
        for (counts, all) in [
            (&self.by_class, &mut facts.by_class),
            (&self.by_return, &mut facts.by_return),
            (&self.pulses_by_returns, &mut facts.pulses_by_returns),
        ] {
            for (number, count) in (0..=u8::MAX).zip(counts.iter()).filter(|(_, count)| **count > 0) {
                *all.entry(number).or_default() += count;
            }
        }
        for (number, count) in (0..=u16::MAX).zip(&self.by_channel).filter(|(_, count)| **count > 0) {
            *facts.by_channel.entry(number).or_default() += count;
        }
    }
}

impl CloudSummary {
    fn note_attributes(&mut self) {
        for attribute in [
            Attribute::Class,
            Attribute::ReturnNumber,
            Attribute::NumberOfReturns,
            Attribute::Intensity,
            Attribute::ScanAngle,
            Attribute::Time,
            Attribute::Leg,
            Attribute::Channel,
            Attribute::Object,
        ] {
            if self.of_file.has(attribute) && !self.attributes.contains(&attribute) {
                self.attributes.push(attribute);
            }
        }
    }

    /// True if points of at least one file have an attribute.
    pub fn has(&self, attribute: Attribute) -> bool {
        self.attributes.contains(&attribute)
    }

    /// Mean of the intensities.
    pub fn mean_intensity(&self) -> Option<f64> {
        let (count, sum) = self.intensities;
        (count > 0).then(|| sum / count as f64)
    }

    /// Number of pulses with a return: that of first returns; `None` of points without return numbers.
    pub fn pulses(&self) -> Option<u64> {
        let firsts = self.by_return.range(..=1).map(|(_, count)| count).sum();
        self.has(Attribute::ReturnNumber).then_some(firsts)
    }

    /// The area that the points cover, m², and the side of the cells by which it is measured, m.
    pub fn area(&self) -> Option<(f64, f64)> {
        self.cover.area(self.points)
    }

    /// Number of different objects, and whether there are more, which are not counted.
    pub fn objects(&self) -> Option<(usize, bool)> {
        self.has(Attribute::Object).then_some((self.objects.len(), self.objects.len() >= MAX_OBJECTS))
    }

    /// True if times are adjusted standard GPS time, by the headers of LAS; `None` of other formats, where
    /// files differ, and where times cannot be seconds of the GPS week, as the headers state.
    pub fn has_adjusted_times(&self) -> Option<bool> {
        self.stated_times().filter(|is_adjusted| *is_adjusted || !self.has_times_beyond_the_week())
    }

    /// True if times are adjusted standard GPS time, as the headers of LAS state; `None` of other formats and
    /// where files differ.
    fn stated_times(&self) -> Option<bool> {
        let mut kinds =
            self.files.iter().map(|(_, file)| Some(file.as_ref()?.las.as_ref()?.has_adjusted_times));
        let first = kinds.next()??;
        kinds.all(|kind| kind == Some(first)).then_some(first)
    }

    /// True if times are adjusted standard GPS time, as the header of the last file states; `None` unless it
    /// is LAS.
    fn stated_times_of_last_file(&self) -> Option<bool> {
        let file = self.files.last().and_then(|(_, file)| file.as_ref()?.las.as_ref());
        file.map(|las| las.has_adjusted_times)
    }

    fn has_times_beyond_the_week(&self) -> bool {
        self.time.is_some_and(Span::is_beyond_week)
    }

    /// True if the headers state seconds of the GPS week, and the times are none.
    pub(super) fn has_wrong_times(&self) -> bool {
        self.stated_times() == Some(false) && self.has_times_beyond_the_week()
    }

    /// True if classes have the meanings that point formats 0 to 5 of LAS give them.
    pub(super) fn has_old_classes(&self) -> bool {
        let mut formats = self.files.iter().filter_map(|(_, file)| file.as_ref()?.las.as_ref());
        formats.any(|las| las.point_format < 6)
    }

    /// True if flight lines are point source ids of LAS; otherwise they are legs.
    pub fn lines_are_sources(&self) -> bool {
        self.files.iter().all(|(_, file)| file.as_ref().is_some_and(|file| file.las.is_some()))
    }
}
