//! Description of a point cloud: counts, density, extent, system, classes, returns, times, flight lines, in
//! one pass and in memory that does not grow with the number of points.

use super::facts_part::{ExactSum, FactsPart, LineFacts, Span, WEEK_S};
use super::facts_text::{ADJUSTED, likely_dates};
use super::occupancy::Occupancy;
use super::source::CloudSource;
use std::any::Any;
use std::collections::{BTreeMap, HashSet};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::Result;
use vlscan_base::quantity::counted;
use vlscan_crs as crs;
use vlscan_formats::{
    Attribute, AttributeSet, FileFacts, NewPart, PointPart, PointRow, PointSink, Selection, StrayFinder,
};
use vlscan_geom::{Aabb, MAX_COORDINATE};

/// Maximum number of distinct objects that are counted.
const MAX_OBJECTS: usize = 1 << 20;

/// Number of points of a file that are counted together, unless the file has blocks.
const PART_POINTS: usize = if cfg!(test) { 1 << 5 } else { 1 << 12 };

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
    /// Points whose return number is larger than the number of returns of their pulse.
    pub beyond_number: u64,
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
    intensities: ExactSum,
    /// Scan angles, degrees.
    pub scan_angle: Option<Span>,
    /// Times, s.
    pub time: Option<Span>,
    /// Flight lines by point source id of LAS, or by leg in other formats.
    pub lines: BTreeMap<u16, LineFacts>,
    /// Number of points by the path of their light.
    pub by_path: BTreeMap<u8, u64>,
    /// Number of points by channel.
    pub by_channel: BTreeMap<u16, u64>,
    objects: HashSet<u64>,
    cover: Occupancy,
    strays: StrayFinder,
    /// True if the current file is LAS, and the attributes of its points.
    is_las: bool,
    of_file: AttributeSet,
}

/// Describes the points of some clouds as if they were one. Also returns messages about the clouds.
///
/// # Errors
/// [`Error::Io`](vlscan_base::Error::Io); [`Error::Input`](vlscan_base::Error::Input) when a file has no
/// supported format or is damaged.
pub fn cloud_facts(clouds: &[CloudSource]) -> Result<(CloudSummary, Diagnostics)> {
    let (mut facts, mut all) = (CloudSummary::default(), Diagnostics::default());
    let mut are_adjusted = None;
    for cloud in clouds {
        let path = cloud.name();
        let before = (facts.skipped, facts.without_number, facts.beyond_number);
        let mut found = Diagnostics::default();
        facts.files.push((path.to_path_buf(), None));
        facts.is_las = false;
        let (named, times_before) = (facts.crs.take(), facts.time.take());
        let mut sink = FileSink::new(&mut facts);
        cloud.read(&mut sink, &mut found)?;
        sink.add_points();
        if let (Some(first), Some(this)) = (&named, &facts.crs)
            && crs::differ(first, this)
        {
            let message =
                format!("its system is {}, that of the files before {}", crs::name(this), crs::name(first));
            found.warn(Some(Place::of_file(path)), message);
        }
        facts.crs = named.or(facts.crs.take());
        if let Some(message) = problem_of_times(&facts, &mut are_adjusted) {
            found.warn(Some(Place::of_file(path)), message);
        }
        facts.time = Span::of_both(times_before, facts.time);
        let left_out = facts.skipped - before.0;
        if left_out > 0 {
            let points = counted(left_out, "point");
            let message = format!("left out: {points} without coordinates within ±{MAX_COORDINATE:e} m");
            found.warn(Some(Place::of_file(path)), message);
        }
        let without_number = facts.without_number - before.1;
        if without_number > 0 {
            let message =
                format!("{without_number} points have no return number (0 of 0); they count as points");
            found.note(Some(Place::of_file(path)), message);
        }
        let beyond_number = facts.beyond_number - before.2;
        if beyond_number > 0 {
            let points = counted(beyond_number, "point");
            let message = format!("{points} with a return number beyond the number of returns of the pulse");
            found.warn(Some(Place::of_file(path)), message);
        }
        all.extend(found.finish(false)?);
    }
    let mut found = Diagnostics::default();
    let names: Vec<String> = clouds.iter().map(|cloud| cloud.name().display().to_string()).collect();
    facts.strays.strays().warn(Path::new(&names.join(", ")), "described like the rest", &mut found);
    all.extend(found);
    Ok((facts, all))
}

/// The problem of the times of the last file: they contradict its header, or are of another kind than those
/// of the files before. `are_adjusted` is true if the files before have adjusted standard GPS time.
fn problem_of_times(facts: &CloudSummary, are_adjusted: &mut Option<bool>) -> Option<String> {
    let (span, is_adjusted) = facts.time.zip(facts.stated_times_of_last_file())?;
    let name = |is_adjusted: bool| match is_adjusted {
        true => "adjusted standard GPS time",
        false => "seconds of the GPS week",
    };
    let stated = name(is_adjusted);
    let is_wrong = if is_adjusted { !ADJUSTED.is_likely(span) } else { span.is_beyond_week() };
    if is_wrong {
        let limits = if is_adjusted { String::new() } else { format!(", which are 0 to {WEEK_S}") };
        let (min, max, dates) = (span.min, span.max, likely_dates(span));
        return Some(format!(
            "its header states {stated}{limits}, and times are {min:.3} to {max:.3}{dates}"
        ));
    }
    let before = *are_adjusted.get_or_insert(is_adjusted);
    (before != is_adjusted)
        .then(|| format!("its times are {stated}, those of the files before {}", name(before)))
}

/// Counts the points of a file and adds them to the facts.
struct FileSink<'a> {
    facts: &'a mut CloudSummary,
    /// Points that are not yet among the facts.
    part: FactsPart,
}

impl PointSink for FileSink<'_> {
    fn start(&mut self, attributes: AttributeSet) {
        self.facts.of_file = attributes;
        self.facts.note_attributes();
        self.part = FactsPart::new(attributes, self.facts.is_las);
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

    fn selection(&self) -> Selection {
        // Without colours, which are not counted.
        Selection::Attributes(AttributeSet::of(|_| true))
    }

    fn parts(&self) -> Option<NewPart> {
        let (attributes, is_las) = (self.facts.of_file, self.facts.is_las);
        Some(Box::new(move || -> Box<dyn PointPart> { Box::new(FactsPart::new(attributes, is_las)) }))
    }

    fn add_part(&mut self, part: &mut (dyn PointPart + 'static)) -> Result<ControlFlow<()>> {
        self.add_points();
        let part: &mut dyn Any = part;
        if let Some(part) = part.downcast_ref::<FactsPart>() {
            self.facts.append(part);
        }
        Ok(ControlFlow::Continue(()))
    }

    fn point(&mut self, row: &PointRow, object: Option<&str>) -> Result<ControlFlow<()>> {
        self.part.add_named(row, object);
        if self.part.positions.len() >= PART_POINTS {
            self.add_points();
        }
        Ok(ControlFlow::Continue(()))
    }
}

impl FileSink<'_> {
    fn new(facts: &mut CloudSummary) -> FileSink<'_> {
        FileSink { facts, part: FactsPart::new(AttributeSet::default(), false) }
    }

    /// Adds the points so far to the facts.
    fn add_points(&mut self) {
        self.facts.append(&self.part);
        self.part.clear();
    }
}

impl CloudSummary {
    /// Adds some points of the file that is being read.
    fn append(&mut self, part: &FactsPart) {
        let FactsPart { positions, cells, skipped, misses, without_number, beyond_number, .. } = part;
        self.skipped += skipped;
        self.misses += misses;
        self.without_number += without_number;
        self.beyond_number += beyond_number;
        if positions.is_empty() {
            return;
        }
        self.points += positions.len() as u64;
        let bounds = Aabb::around(positions.iter().copied());
        self.bounds = Some(self.bounds.unwrap_or(Aabb::EMPTY).union(bounds));
        self.strays.add_all(positions);
        cells.iter().for_each(|cell| self.cover.mark(*cell));
        for (counts, all) in [
            (&part.by_class, &mut self.by_class),
            (&part.by_return, &mut self.by_return),
            (&part.pulses_by_returns, &mut self.pulses_by_returns),
            (&part.by_path, &mut self.by_path),
        ] {
            for (number, count) in (0..=u8::MAX).zip(counts.iter()).filter(|(_, count)| **count > 0) {
                *all.entry(number).or_default() += count;
            }
        }
        let channels = (0..).zip(part.by_channel.iter()).filter(|(_, count)| **count > 0);
        for (number, count) in channels.chain(part.by_high_channel.iter().map(|(number, n)| (*number, n))) {
            *self.by_channel.entry(number).or_default() += count;
        }
        self.intensity = Span::of_both(self.intensity, part.intensity);
        self.intensities.append(&part.intensities);
        self.scan_angle = Span::of_both(self.scan_angle, part.scan_angle);
        self.time = Span::of_both(self.time, part.time);
        for (number, line) in &part.lines {
            self.lines.entry(*number).or_default().append(line);
        }
        for object in &part.objects {
            if self.objects.len() < MAX_OBJECTS {
                self.objects.insert(*object);
            }
        }
    }

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
            Attribute::Path,
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
        self.intensities.mean()
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

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::DVec3;

    /// The facts of points that are added one by one, or in blocks of a length.
    fn facts_of(rows: &[PointRow], block: Option<usize>) -> CloudSummary {
        let mut facts = CloudSummary::default();
        let mut sink = FileSink::new(&mut facts);
        sink.start(AttributeSet::of(|_| true));
        match block {
            None => rows.iter().for_each(|row| assert!(sink.point(row, None).unwrap().is_continue())),
            Some(length) => {
                let mut part = sink.parts().unwrap()();
                for block in rows.chunks(length) {
                    part.clear();
                    block.iter().for_each(|row| part.add(row));
                    assert!(sink.add_part(part.as_mut()).unwrap().is_continue());
                }
            }
        }
        sink.add_points();
        facts
    }

    #[test]
    fn facts_do_not_depend_on_where_blocks_end() {
        let row = |i: u32| PointRow {
            position: DVec3::new(f64::from(i % 97) * 0.3, f64::from(i / 97) * 0.2, f64::from(i % 13)),
            intensity: 0.1 * (i % 101) as f32,
            class: (i % 5) as u8,
            return_number: (i % 4 + 1) as u8,
            number_of_returns: 3,
            scan_angle: f64::from(i % 30) - 15.0,
            leg: (i / 900) as u16,
            channel: (i % 300) as u16,
            time: f64::from(i) * 1e-5,
            object: i64::from(i % 40),
            path: (i % 9) as u8,
            is_miss: i.is_multiple_of(50),
            ..PointRow::default()
        };
        let rows: Vec<PointRow> = (0..5000).map(row).collect();
        let expected = facts_of(&rows, None);
        assert_eq!((expected.points, expected.misses, expected.by_channel.len()), (4900, 100, 294));
        assert_eq!((expected.by_path.len(), expected.by_path.values().sum::<u64>()), (9, 4900));
        // A quarter of the numbers is 4 of 3.
        assert_eq!(expected.beyond_number, 1250);
        for length in [1, 7, 1000, 5000] {
            let facts = facts_of(&rows, Some(length));
            assert_eq!(facts.json(), expected.json(), "{length}");
            assert_eq!(facts.beyond_number, expected.beyond_number, "{length}");
            assert_eq!(facts.mean_intensity(), expected.mean_intensity(), "{length}");
        }
    }
}
