//! A recorded point cloud as pulses: returns of one time and flight line, in their order.

use std::ops::{ControlFlow, Range};
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_formats::{Attribute, AttributeSet, PointRow, PointSink, StrayFinder, read_points};
use vlscan_geom::{Aabb, DVec3, MAX_COORDINATE};

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
    pub target: Target,
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

/// One pass of the instrument over the place.
#[derive(Clone, Debug)]
pub(super) struct Line {
    /// Point source id of LAS; of other formats the number of the leg, counted from 1.
    pub source: u16,
    /// Its pulses, as numbers in [`Recording::pulses`].
    pub pulses: Range<usize>,
}

/// A recorded point cloud.
#[derive(Clone, Debug, Default)]
pub(super) struct Recording {
    /// Returns by line, time and number.
    pub returns: Vec<Return>,
    /// Returns of each pulse.
    pub pulses: Vec<Range<usize>>,
    /// In the order of source and time.
    pub lines: Vec<Line>,
    pub bounds: Aabb,
    /// Points of the noise classes 7 and 18, which are left out.
    pub noise: usize,
    pub has_scan_angles: bool,
    /// True for each pulse that is held out for validation: every fourth of the recording, so that a stray
    /// that is left out does not change the choice of other pulses.
    pub is_held_out: Vec<bool>,
}

/// Every n-th pulse is held out for validation.
const FOLDS: usize = 4;

struct Sink {
    returns: Vec<Return>,
    attributes: AttributeSet,
    noise: usize,
    skipped: usize,
}

impl PointSink for Sink {
    fn start(&mut self, attributes: AttributeSet) {
        self.attributes = attributes;
    }

    fn point(&mut self, row: &PointRow, _: Option<&str>) -> Result<ControlFlow<()>> {
        let is_placed = row.position.is_finite() && row.position.abs().max_element() <= MAX_COORDINATE;
        match Target::of_class(row.class) {
            _ if row.is_miss => {}
            _ if !is_placed => self.skipped += 1,
            target => {
                self.noise += usize::from(target.is_none());
                let number = row.return_number.max(1);
                self.returns.push(Return {
                    position: row.position,
                    class: row.class,
                    // Noise is left out, whatever its target.
                    target: target.unwrap_or(Target::Foliage),
                    number,
                    of: row.number_of_returns.max(number),
                    time: row.time,
                    scan_angle: row.scan_angle,
                    // Readers count legs from 0, and files point sources from 1.
                    source: row.leg.saturating_add(1),
                    channel: row.channel,
                    is_left_out: target.is_none(),
                });
            }
        }
        Ok(ControlFlow::Continue(()))
    }
}

/// Reads a point cloud; problems that do not prevent reading are added to `found`.
///
/// # Errors
/// [`Error::Io`]; [`Error::Input`] for files that are no point cloud, without classes, or without points of
/// the ground.
pub(super) fn read(path: &Path, found: &mut Diagnostics) -> Result<Recording> {
    let attributes = AttributeSet::default();
    let mut sink = Sink { returns: Vec::new(), attributes, noise: 0, skipped: 0 };
    found.extend(read_points(path, &mut sink)?);
    let strays = StrayFinder::of(sink.returns.iter().filter(|r| !r.is_left_out).map(|r| r.position));
    strays.warn(path, "left out", found);
    sink.returns.iter_mut().for_each(|r| r.is_left_out |= strays.contains(r.position));
    let name = path.display();
    let has = |attribute| sink.attributes.has(attribute);
    let kept = || sink.returns.iter().filter(|r| !r.is_left_out);
    let Some(first) = kept().next() else {
        return Err(Error::input(format!("{name} has no points for a scene")));
    };
    let count = kept().filter(|r| matches!(r.class, 2 | 8)).count();
    if count < 3 {
        return Err(Error::input(format!(
            "{name} has {count} points of class 2 (ground), and at least 3 are needed; classify the ground \
             first, for example: pdal translate {name} classified.laz smrf"
        )));
    }
    let mut warn = |message: &str| {
        found.warn(Some(Place::of_file(path)), message);
    };
    if sink.skipped > 0 {
        warn(&format!("{} points without coordinates are ignored", sink.skipped));
    }
    if !has(Attribute::Time) {
        warn("the cloud has no times of pulses; each point counts as a separate pulse");
    }
    if !has(Attribute::NumberOfReturns) || !has(Attribute::ReturnNumber) {
        warn(
            "the cloud has no return numbers and numbers of returns; each point counts as the only return \
             of its pulse",
        );
    }
    let has_times = has(Attribute::Time);
    let has_scan_angles = has(Attribute::ScanAngle) && kept().any(|r| r.scan_angle != first.scan_angle);
    let noise = sink.noise;
    Ok(Recording { has_scan_angles, noise, ..assemble(sink.returns, has_times) })
}

/// Orders returns into pulses and lines.
pub(super) fn assemble(mut returns: Vec<Return>, has_times: bool) -> Recording {
    let key = |r: &Return| (r.source, r.time, r.channel);
    returns.sort_by(|a, b| {
        let by_time = a.source.cmp(&b.source).then(a.time.total_cmp(&b.time));
        by_time.then(a.channel.cmp(&b.channel)).then(a.number.cmp(&b.number))
    });
    let ends_pulse = |r: &Return, next: Option<&Return>| {
        next.is_none_or(|next| !has_times || key(next) != key(r) || next.number <= r.number)
    };
    // Numbers of pulses, including pulses that are left out.
    let mut numbers = Vec::with_capacity(returns.len());
    let mut number = 0usize;
    for (i, r) in returns.iter().enumerate() {
        if !r.is_left_out {
            numbers.push(number);
        }
        number += usize::from(ends_pulse(r, returns.get(i + 1)));
    }
    returns.retain(|r| !r.is_left_out);
    let mut all = Recording { bounds: Aabb::EMPTY, ..Recording::default() };
    let mut start = 0;
    for i in 0..returns.len() {
        all.bounds = all.bounds.with(returns[i].position);
        if !ends_pulse(&returns[i], returns.get(i + 1)) {
            continue;
        }
        let first = &returns[start];
        let pulse = all.pulses.len();
        let goes_on = pulse > 0 && {
            let before = &returns[all.pulses[pulse - 1].start];
            before.source == first.source && (!has_times || first.time - before.time <= MIN_PASS_GAP)
        };
        match all.lines.last_mut().filter(|_| goes_on) {
            Some(line) => line.pulses.end = pulse + 1,
            None => all.lines.push(Line { source: first.source, pulses: pulse..pulse + 1 }),
        }
        all.pulses.push(start..i + 1);
        all.is_held_out.push(numbers[start].is_multiple_of(FOLDS));
        start = i + 1;
    }
    all.returns = returns;
    all
}

impl Recording {
    /// Returns of a pulse, nearest first.
    pub fn of_pulse(&self, pulse: usize) -> &[Return] {
        &self.returns[self.pulses[pulse].clone()]
    }

    /// Pulses per square metre of the box around the points.
    pub fn density(&self) -> f64 {
        let size = self.bounds.max - self.bounds.min;
        self.pulses.len() as f64 / (size.x * size.y).max(1e-9)
    }
}
