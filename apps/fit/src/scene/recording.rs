//! A recorded point cloud as pulses: returns of one time and flight line, in their order.

use super::thinning::Thinning;
use crate::limit::PointLimit;
use std::ops::{ControlFlow, Range};
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_formats::{
    Attribute, AttributeSet, FileFacts, GroupedBy, PointRow, PointSink, PulseGroups, PulseGroupsError,
    PulseKey, Selection, StrayFinder, read_points,
};
use vlscan_geom::{Aabb, DVec3, MAX_COORDINATE};

/// Memory that a reconstruction takes for a point, bytes, about: its values and those of its pulse.
pub(super) const POINT_BYTES: u64 = 160;
/// Gap in time that ends a pass of the instrument over the place, s.
const MIN_PASS_GAP: f64 = 20.0;

/// Reflecting object of a return, by its class.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Target {
    /// Ground, water, roads and rails.
    Ground,
    /// Buildings and bridges.
    Roof,
    /// Anything else: plants, wires, vehicles.
    Foliage,
}

impl Target {
    /// The target of a class of the LAS specification 1.4, table 17; `None` for noise.
    fn of_class(class: u8) -> Option<Target> {
        match class {
            7 | 18 => None,
            2 | 8 | 9 | 10 | 11 => Some(Target::Ground),
            6 | 17 => Some(Target::Roof),
            _ => Some(Target::Foliage),
        }
    }
}

/// A return of a recorded pulse.
#[derive(Clone, Copy, Debug)]
pub(super) struct Return {
    /// World position, m.
    pub position: DVec3,
    /// Class of the file.
    pub class: u8,
    /// Number of the return, from 1.
    pub number: u8,
    /// Returns of its pulse, in the file or not.
    pub of: u8,
    /// Time of the pulse, s.
    pub time: f64,
    /// Scan angle, degrees.
    pub scan_angle: f64,
    source: u16,
    channel: u16,
    /// True for noise and for points far from all others.
    is_left_out: bool,
}

impl Return {
    pub fn target(&self) -> Target {
        // Noise is left out, whatever its target.
        Target::of_class(self.class).unwrap_or(Target::Foliage)
    }

    /// True if its pulse is in a sample.
    fn is_in(&self, sample: Thinning) -> bool {
        sample.has([self.time.to_bits(), self.source.into(), self.channel.into()], self.position)
    }

    /// The last return of a pulse with this number of returns.
    #[cfg(test)]
    pub fn last_of(of: u8, class: u8, position: DVec3) -> Return {
        Return {
            position,
            class,
            number: of,
            of,
            time: 0.0,
            scan_angle: 0.0,
            source: 1,
            channel: 0,
            is_left_out: false,
        }
    }
}

/// One pass of the instrument over the place.
#[derive(Clone, Debug)]
pub(super) struct Line {
    /// Point source id of LAS; of other formats the number of the leg, counted from 1.
    pub source: u16,
    /// The numbers of its pulses.
    pub pulses: Range<usize>,
}

/// A recorded point cloud.
#[derive(Clone, Debug, Default)]
pub(super) struct Recording {
    /// Returns by line, time and number.
    pub returns: Vec<Return>,
    /// For each pulse the end of its returns, which begin at that of the pulse before.
    pub(super) ends: Vec<usize>,
    /// In the order of source and time.
    pub lines: Vec<Line>,
    pub bounds: Aabb,
    /// Points of the noise classes 7 and 18, which are left out.
    pub noise: usize,
    pub has_scan_angles: bool,
    /// One of this many pulses of the file was read, or 0.
    pub one_of: u64,
    /// True for each pulse that is held out for validation: every fourth of the recording, so that a stray
    /// that is left out does not change the choice of other pulses.
    pub is_held_out: Vec<bool>,
}

/// Maximum share of the pulses of several returns that lack some where times do not tell pulses: returns of
/// successive pulses whose other returns are missing look like one pulse.
const MAX_INCOMPLETE: f64 = 0.3;
/// Every n-th pulse is held out for validation.
const FOLDS: usize = 4;

/// Maximum number of pulses of which one is read.
const MAX_ONE_OF: u64 = 1 << 20;

#[derive(Default)]
struct Sink {
    returns: Vec<Return>,
    attributes: AttributeSet,
    noise: usize,
    skipped: usize,
    is_las: bool,
    limit: PointLimit,
    thinning: Thinning,
    first_time: Option<f64>,
    has_times: bool,
    /// True if the limit allows hardly any points.
    is_too_large: bool,
}

impl Sink {
    fn add(&mut self, one: Return) {
        let first = *self.first_time.get_or_insert(one.time);
        self.has_times |= one.time != first;
        if !one.is_in(self.thinning) {
            return;
        }
        self.returns.push(one);
        while self.limit.is_exceeded(self.returns.len()) && !self.is_too_large {
            self.thinning = self.thinning.coarser(self.has_times);
            let thinning = self.thinning;
            self.returns.retain(|r| r.is_in(thinning));
            self.is_too_large = self.returns.is_empty() || self.thinning.one_of() > MAX_ONE_OF;
        }
    }
}

impl PointSink for Sink {
    fn start(&mut self, attributes: AttributeSet) {
        self.attributes = attributes;
    }

    fn file(&mut self, facts: &FileFacts) {
        self.is_las = facts.las.is_some();
    }

    fn selection(&self) -> Selection {
        use Attribute::{Channel, Class, Leg, NumberOfReturns, ReturnNumber, ScanAngle, Time};
        Selection::Attributes(AttributeSet::of(|attribute| {
            matches!(attribute, Channel | Class | Leg | NumberOfReturns | ReturnNumber | ScanAngle | Time)
        }))
    }

    fn point(&mut self, row: &PointRow, _: Option<&str>) -> Result<ControlFlow<()>> {
        let is_placed = row.position.is_finite() && row.position.abs().max_element() <= MAX_COORDINATE;
        match Target::of_class(row.class) {
            _ if row.is_miss => {}
            _ if !is_placed => self.skipped += 1,
            target => {
                self.noise += usize::from(target.is_none());
                let number = row.return_number.max(1);
                self.add(Return {
                    position: row.position,
                    class: row.class,
                    number,
                    of: row.number_of_returns.max(number),
                    time: row.time,
                    scan_angle: row.scan_angle,
                    source: row.flight_line(self.is_las),
                    channel: row.channel,
                    is_left_out: target.is_none(),
                });
            }
        }
        Ok(if self.is_too_large { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    }
}

/// Reads a point cloud; problems that do not prevent reading are added to `found`. If there are more points
/// than `limit` allows, one of two, four, eight … pulses is read.
///
/// # Errors
/// [`Error::Io`]; [`Error::Input`] for files that are no point cloud, without classes, without points of the
/// ground, or whose points exceed the limit in any case.
pub(super) fn read(path: &Path, limit: PointLimit, found: &mut Diagnostics) -> Result<Recording> {
    let mut sink = Sink { limit, ..Sink::default() };
    found.extend(read_points(path, &mut sink)?);
    if sink.is_too_large {
        return Err(limit.error(path));
    }
    let strays = StrayFinder::of(sink.returns.iter().filter(|r| !r.is_left_out).map(|r| r.position));
    strays.warn(path, "left out", found);
    sink.returns.iter_mut().for_each(|r| r.is_left_out |= strays.contains(r.position));
    let name = path.display();
    let has = |attribute| sink.attributes.has(attribute);
    let kept = || sink.returns.iter().filter(|r| !r.is_left_out);
    let Some(first) = kept().next() else {
        return Err(Error::input(format!("{name} has no points for a scene")));
    };
    check_ground(kept(), path)?;
    // The one time of returns without numbers is none.
    let has_times = has(Attribute::Time) && kept().any(|r| r.of > 1 || r.time != first.time);
    let mut warn = |message: &str| {
        found.warn(Some(Place::of_file(path)), message);
    };
    let one_of = sink.thinning.one_of();
    if one_of > 1 {
        warn(&format!(
            "its points need more memory than --max-memory {}: one of {one_of} pulses is used",
            limit.memory()
        ));
    }
    if sink.skipped > 0 {
        warn(&format!("{} points without coordinates are ignored", sink.skipped));
    }
    if !has_times {
        warn("the cloud has no times of pulses; each point counts as a separate pulse");
    }
    let has_numbers = has(Attribute::NumberOfReturns) && has(Attribute::ReturnNumber);
    if !has_numbers {
        warn(
            "the cloud has no return numbers and numbers of returns; each point counts as the only return \
             of its pulse",
        );
    }
    let has_scan_angles = has(Attribute::ScanAngle) && kept().any(|r| r.scan_angle != first.scan_angle);
    let noise = sink.noise;
    let (recording, by) = assemble(sink.returns, has_times).map_err(|problem| {
        Error::input_with_help(
            format!("{name}: {problem}"),
            "use the cloud as the instrument delivered it, with the time of each pulse and the numbers of \
             its returns",
        )
    })?;
    if by == GroupedBy::Order {
        let incomplete = recording.incomplete_share();
        if incomplete > MAX_INCOMPLETE {
            return Err(incomplete_pulses(path, incomplete));
        }
        warn(
            "GPS times are too coarse to tell pulses; returns are grouped into pulses by their order in the \
             file and their numbers",
        );
    }
    Ok(Recording { has_scan_angles, noise, one_of, ..recording })
}

/// The error for coarse times in a cloud from which many points have been removed.
fn incomplete_pulses(path: &Path, share: f64) -> Error {
    Error::input_with_help(
        format!(
            "{}: GPS times are too coarse to tell pulses, and {:.0} % of the pulses of several returns lack \
             some of them, so that their order in the file does not tell pulses either",
            path.display(),
            100.0 * share
        ),
        "use the cloud as the instrument delivered it, with all returns of its pulses",
    )
}

/// Checks that a cloud with these returns has enough points of the ground.
fn check_ground<'r>(returns: impl Iterator<Item = &'r Return>, path: &Path) -> Result<()> {
    let (count, name) = (returns.filter(|r| matches!(r.class, 2 | 8)).count(), path.display());
    if count >= 3 {
        return Ok(());
    }
    Err(Error::input(format!(
        "{name} has {count} points of class 2 (ground), and at least 3 are needed; classify the ground \
         first, for example: pdal translate {name} classified.laz smrf"
    )))
}

/// Orders returns into pulses and lines, in their memory. Each return is a pulse where there are no times.
///
/// # Errors
/// Times that several pulses share, in files whose returns are not in the order of pulses or have no numbers.
pub(super) fn assemble(
    mut returns: Vec<Return>,
    has_times: bool,
) -> std::result::Result<(Recording, GroupedBy), PulseGroupsError> {
    let key = |r: &Return| PulseKey {
        source: r.source,
        channel: r.channel,
        time: r.time,
        number: r.number,
        of: r.of,
    };
    let PulseGroups { order, pulses, by, .. } = match has_times {
        true => PulseGroups::of(&returns, key)?,
        false => PulseGroups::by_time(&returns, key),
    };
    put_in_order(&mut returns, order);
    let mut all = Recording {
        bounds: Aabb::EMPTY,
        ends: Vec::with_capacity(pulses.len()),
        is_held_out: Vec::with_capacity(pulses.len()),
        ..Recording::default()
    };
    // Numbers of pulses, including pulses that are left out.
    let mut number = 0;
    let mut kept = 0;
    for Range { mut start, end: last } in pulses {
        while start < last {
            let is_pulse = |end: &usize| has_times && returns[*end].number > returns[*end - 1].number;
            let end = (start + 1..last).find(|end| !is_pulse(end)).unwrap_or(last);
            let next = keep(&mut returns, start..end, kept);
            all.add_pulse(&returns, kept..next, number, has_times);
            (number, kept, start) = (number + 1, next, end);
        }
    }
    returns.truncate(kept);
    all.returns = returns;
    Ok((all, by))
}

/// Moves the values to the places of which `order` has their indices.
fn put_in_order<T: Copy>(values: &mut [T], mut order: Vec<usize>) {
    for first in 0..values.len() {
        let (value, mut place) = (values[first], first);
        loop {
            // A place that is filled is its own source.
            let source = std::mem::replace(&mut order[place], place);
            if source == first || source == place {
                values[place] = value;
                break;
            }
            values[place] = values[source];
            place = source;
        }
    }
}

/// Moves the returns of a range that are not left out to a place at or before it. Returns the end of that
/// place.
fn keep(returns: &mut [Return], range: Range<usize>, mut to: usize) -> usize {
    for from in range {
        let one = returns[from];
        if !one.is_left_out {
            returns[to] = one;
            to += 1;
        }
    }
    to
}

impl Recording {
    /// Adds a pulse with a range of returns, unless all are left out. `number` is that of the pulse in the
    /// file.
    fn add_pulse(&mut self, returns: &[Return], range: Range<usize>, number: usize, has_times: bool) {
        let Some(first) = returns[range.clone()].first() else { return };
        self.bounds = returns[range.clone()].iter().fold(self.bounds, |bounds, r| bounds.with(r.position));
        let pulse = self.ends.len();
        let goes_on = pulse.checked_sub(1).is_some_and(|before| {
            let before = &returns[self.range(before).start];
            before.source == first.source && (!has_times || first.time - before.time <= MIN_PASS_GAP)
        });
        match self.lines.last_mut().filter(|_| goes_on) {
            Some(line) => line.pulses.end = pulse + 1,
            None => self.lines.push(Line { source: first.source, pulses: pulse..pulse + 1 }),
        }
        self.ends.push(range.end);
        self.is_held_out.push(number.is_multiple_of(FOLDS));
    }

    /// Number of pulses.
    pub fn pulses(&self) -> usize {
        self.ends.len()
    }

    /// The returns of a pulse, as a range of [`Recording::returns`].
    pub fn range(&self, pulse: usize) -> Range<usize> {
        let start = pulse.checked_sub(1).map_or(0, |before| self.ends[before]);
        start..self.ends[pulse]
    }

    /// Returns of a pulse, nearest first.
    pub fn of_pulse(&self, pulse: usize) -> &[Return] {
        &self.returns[self.range(pulse)]
    }

    /// Share of the pulses of several returns that lack some of them.
    fn incomplete_share(&self) -> f64 {
        let (mut several, mut incomplete) = (0usize, 0usize);
        for returns in (0..self.pulses()).map(|pulse| self.of_pulse(pulse)) {
            let of = usize::from(returns[0].of);
            several += usize::from(of > 1);
            incomplete += usize::from(of > returns.len());
        }
        incomplete as f64 / several.max(1) as f64
    }

    /// Pulses per square metre of the box around the points.
    pub fn density(&self) -> f64 {
        let size = self.bounds.max - self.bounds.min;
        self.pulses() as f64 / (size.x * size.y).max(1e-9)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns of pulses of one and two returns, 10 µs apart, with times in these steps, s.
    fn returns(step: f64) -> Vec<Return> {
        let pulse = |pulse: u32| {
            let of = 1 + (pulse % 2) as u8;
            let time = libm::floor(f64::from(pulse) * 1e-5 / step) * step;
            (1..=of).map(move |number| Return {
                position: DVec3::new(f64::from(pulse), 0.0, -f64::from(number)),
                class: 5,
                number,
                of,
                time,
                scan_angle: 0.0,
                source: 706,
                channel: 0,
                is_left_out: pulse == 7,
            })
        };
        (0..2000).flat_map(pulse).collect()
    }

    #[test]
    fn coarse_times_do_not_mix_pulses() {
        let (fine, by_time) = assemble(returns(1e-7), true).unwrap();
        let (coarse, by_order) = assemble(returns(5e-3), true).unwrap();
        assert_eq!((by_time, by_order), (GroupedBy::Time, GroupedBy::Order));
        assert_eq!((fine.pulses(), fine.returns.len(), fine.lines.len()), (1999, 2998, 1));
        assert_eq!((&fine.ends, &fine.is_held_out), (&coarse.ends, &coarse.is_held_out));
        let places = |recording: &Recording| recording.returns.iter().map(|r| r.position).collect::<Vec<_>>();
        assert_eq!(places(&fine), places(&coarse));
        assert_eq!(fine.lines[0].source, 706);
    }

    #[test]
    fn pulses_that_lack_returns_are_counted() {
        let all = returns(5e-3);
        let (complete, _) = assemble(all.clone(), true).unwrap();
        assert_eq!(complete.incomplete_share(), 0.0);
        // The second returns of every fourth pulse of two.
        let is_kept = |r: &Return| r.number == 1 || (r.position.x as u32) % 8 != 1;
        let thinned: Vec<Return> = all.into_iter().filter(is_kept).collect();
        let (incomplete, by) = assemble(thinned, true).unwrap();
        assert_eq!(by, GroupedBy::Order);
        // Pulse 7 is left out.
        assert!((incomplete.incomplete_share() - 250.0 / 999.0).abs() < 1e-12);
    }

    #[test]
    fn each_return_is_a_pulse_where_there_are_no_times() {
        let (all, _) = assemble(returns(1.0), false).unwrap();
        assert!((0..all.pulses()).all(|pulse| all.range(pulse).len() == 1) && all.pulses() == 2998);
    }

    #[test]
    fn the_order_of_the_file_does_not_matter_where_times_are_fine() {
        let (expected, _) = assemble(returns(1e-7), true).unwrap();
        let mut shuffled = returns(1e-7);
        shuffled.sort_by_key(|r| r.position.x as u64 * 7919 % 2003 + u64::from(r.number));
        let (all, by) = assemble(shuffled, true).unwrap();
        assert_eq!(
            (by, &all.ends, &all.is_held_out),
            (GroupedBy::Time, &expected.ends, &expected.is_held_out)
        );
        let places = |recording: &Recording| recording.returns.iter().map(|r| r.position).collect::<Vec<_>>();
        assert_eq!(places(&all), places(&expected));
        assert_eq!((all.bounds.min, all.bounds.max), (expected.bounds.min, expected.bounds.max));
        assert_eq!((all.of_pulse(8).len(), all.of_pulse(8)[0].position.x), (2, 9.0));
    }

    #[test]
    fn a_sample_of_pulses_has_all_their_returns_and_does_not_depend_on_their_order() {
        let all = returns(1e-7);
        let read = |returns: &[Return], most: u64| {
            let mut sink =
                Sink { limit: PointLimit::new(Some(POINT_BYTES * most), POINT_BYTES), ..Sink::default() };
            returns.iter().for_each(|r| sink.add(*r));
            (assemble(sink.returns, true).unwrap().0, sink.thinning.one_of(), sink.is_too_large)
        };
        let (whole, one_of, _) = read(&all, 3000);
        assert_eq!((whole.returns.len(), one_of), (2998, 1));
        let (some, one_of, _) = read(&all, 1000);
        // Half of 3000 returns are more than 1000, a quarter are not.
        assert!(one_of == 4 && (600..900).contains(&some.returns.len()), "{one_of} {}", some.returns.len());
        assert!(
            (0..some.pulses())
                .all(|pulse| some.of_pulse(pulse).len() == usize::from(some.of_pulse(pulse)[0].of))
        );
        let reversed: Vec<Return> = all.iter().rev().copied().collect();
        let (other, ..) = read(&reversed, 1000);
        let places = |recording: &Recording| recording.returns.iter().map(|r| r.position).collect::<Vec<_>>();
        assert_eq!(places(&some), places(&other));
        assert!(read(&all, 0).2, "no memory");
        // Returns that share a time are chosen by their positions.
        let timeless: Vec<Return> = all.iter().map(|r| Return { time: 0.0, ..*r }).collect();
        let mut sink =
            Sink { limit: PointLimit::new(Some(POINT_BYTES * 1000), POINT_BYTES), ..Sink::default() };
        timeless.iter().for_each(|r| sink.add(*r));
        assert!((600..900).contains(&sink.returns.len()), "{}", sink.returns.len());
    }

    #[test]
    fn values_are_put_in_any_order_in_their_memory() {
        for order in [vec![], vec![0], vec![1, 0], vec![3, 1, 4, 0, 2], vec![4, 0, 1, 2, 3], vec![0, 1, 2]] {
            let mut values: Vec<usize> = (0..order.len()).map(|i| 10 * i).collect();
            put_in_order(&mut values, order.clone());
            assert_eq!(values, order.iter().map(|i| 10 * i).collect::<Vec<usize>>());
        }
    }
}
