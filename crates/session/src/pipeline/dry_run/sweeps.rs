//! Sweeps of beams of which few are measured, for scan patterns that turn steadily.
//!
//! Of a chunk, one step in a few is taken with its pulses, and those between are passed over. Where the
//! surfaces that two neighbouring beams meet continue each other, the pulses between them lie evenly between
//! their places: on walls and slopes, too. Elsewhere the beam half way between them is measured as well, and
//! so on, until the budget of the chunk is spent; the rest of the pulses take the surface of the nearer beam.

use super::super::chunk::Chunk;
use super::beams::{Beam, is_of_surface, moved};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;
use vlscan_base::error::Result;
use vlscan_geom::{DVec3, Rotation};
use vlscan_lidar::flight::{FlightPlan, FlightSink, FlightState, PoseSample, Pulse};
use vlscan_lidar::pulse::Echo;

/// Ratio to the usual turn of a beam from which on it does not continue the sweep.
const MAX_TURN: f64 = 2.0;
/// Distance of the places of two beams on one surface, as a multiple of their distance on a plane.
const MAX_STEP: f64 = 2.0;
/// Distance that does not count, m.
const TOLERANCE: f64 = 0.25;
/// Minimum cosine of the angle of incidence.
const MIN_COSINE: f64 = 0.05;

/// A measured beam.
#[derive(Clone, Debug)]
pub struct Node {
    pub pulse: Pulse,
    /// Its echoes from surfaces, by return number.
    pub echoes: Vec<Echo>,
}

impl Node {
    fn new(pulse: Pulse) -> Node {
        Node { pulse, echoes: Vec::new() }
    }

    /// The beam, scene frame.
    pub fn beam(&self) -> Beam {
        Beam { origin: self.pulse.origin, direction: self.pulse.attitude.forward() }
    }

    /// Place of the last echo.
    fn place(&self) -> Option<DVec3> {
        self.echoes.last().map(|echo| echo.position)
    }

    /// True if the last echoes of both beams can be from one surface.
    fn continues(&self, other: &Node) -> bool {
        let (Some(one), Some(two)) = (self.echoes.last(), other.echoes.last()) else { return false };
        let (from, to) = (self.beam(), other.beam());
        let range = (one.position - from.origin).length().max((two.position - to.origin).length());
        let cosine = one.incidence_cosine.abs().min(two.incidence_cosine.abs()).max(MIN_COSINE);
        let on_plane = (to.direction - from.direction).length() * range / cosine;
        let way = (to.origin - from.origin).length();
        (two.position - one.position).length() <= TOLERANCE + way + MAX_STEP * on_plane
    }
}

/// Beams of a device that turn steadily from one to the next.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// Measured beams by ascending numbers of their pulses; not empty.
    pub nodes: Vec<Node>,
    /// Numbers of the first and of the last pulse, which need not be measured.
    first: u64,
    last: u64,
}

impl Sweep {
    /// Numbers of the pulses that a measured beam stands for.
    fn pulses(&self, i: usize) -> RangeInclusive<u64> {
        let number = self.nodes[i].pulse.number;
        let middle = |a: u64, b: u64| a + b.saturating_sub(a) / 2;
        let before = i.checked_sub(1).map(|i| middle(self.nodes[i].pulse.number, number) + 1);
        let behind = self.nodes.get(i + 1).map(|next| middle(number, next.pulse.number));
        before.unwrap_or(self.first).min(number)..=behind.unwrap_or(self.last).max(number)
    }

    /// Horizontal ways, m, from a place of a measured beam to those of the pulses that it stands for, itself
    /// among them. The beam has an echo.
    pub fn offsets(&self, i: usize) -> Vec<[f64; 2]> {
        let node = &self.nodes[i];
        let Some(place) = node.place() else { return Vec::new() };
        let step_to = |other: Option<usize>| {
            let other = self.nodes.get(other?).filter(|other| node.continues(other))?;
            let pulses = distance(&node.pulse, &other.pulse);
            other.place().filter(|_| pulses != 0.0).map(|to| (to - place) / pulses)
        };
        let (back, ahead) = (step_to(i.checked_sub(1)), step_to(Some(i + 1)));
        let (beam, turn) = (node.beam(), self.turn(i));
        let offset = |number: u64| {
            let after = number as f64 - node.pulse.number as f64;
            let step = if after < 0.0 { back.or(ahead) } else { ahead.or(back) };
            match step {
                Some(step) => [step.x * after, step.y * after],
                None => {
                    let [x, y] = moved(&beam, place, turn * after);
                    [x - place.x, y - place.y]
                }
            }
        };
        self.pulses(i).map(offset).collect()
    }

    /// Changes of direction from a measured beam to those that it stands for, itself among them.
    pub fn swings(&self, i: usize) -> Vec<DVec3> {
        let turn = self.turn(i);
        let number = self.nodes[i].pulse.number as f64;
        self.pulses(i).map(|other| turn * (other as f64 - number)).collect()
    }

    /// Change of direction from pulse to pulse at a measured beam; 0 if it is alone.
    fn turn(&self, i: usize) -> DVec3 {
        let node = &self.nodes[i];
        let other = self.nodes.get(i + 1).or_else(|| self.nodes.get(i.checked_sub(1)?));
        let turn_to = |other: &Node| {
            let pulses = distance(&node.pulse, &other.pulse);
            let turn = other.beam().direction - node.beam().direction;
            if pulses == 0.0 { DVec3::ZERO } else { turn / pulses }
        };
        other.map_or(DVec3::ZERO, turn_to)
    }
}

/// A beam to be measured between two others.
pub struct Gap {
    /// Index of the sweep, and of the beam before it there.
    place: (usize, usize),
    /// Distance of the places of both beams, m; infinite if one has no echo.
    width: f64,
    /// The pulse.
    pub pulse: Pulse,
}

/// The beams half way between measured ones whose surfaces do not continue each other, in order: those of the
/// widest gaps, at most `limit`.
pub fn gaps(sweeps: &[Sweep], limit: usize) -> Vec<Gap> {
    let mut found = Vec::new();
    for (number, sweep) in sweeps.iter().enumerate() {
        for (i, pair) in sweep.nodes.windows(2).enumerate() {
            let (one, two) = (&pair[0], &pair[1]);
            let width = match (one.place(), two.place()) {
                (Some(from), Some(to)) => (to - from).length(),
                (None, None) => continue,
                _ => f64::INFINITY,
            };
            if two.pulse.number.saturating_sub(one.pulse.number) >= 2 && !one.continues(two) {
                found.push(Gap { place: (number, i), width, pulse: halfway(&one.pulse, &two.pulse) });
            }
        }
    }
    // A stable sort: gaps of equal width keep their order.
    found.sort_by(|a, b| b.width.total_cmp(&a.width));
    found.truncate(limit);
    found.sort_unstable_by_key(|gap| gap.place);
    found
}

/// Adds the beams of gaps, which have these echoes.
pub fn fill(sweeps: &mut [Sweep], gaps: Vec<Gap>, echoes: &[Echo]) {
    let mut nodes: Vec<Node> = gaps.iter().map(|gap| Node::new(gap.pulse)).collect();
    assign(nodes.iter_mut(), echoes);
    // From the last one on, so that the places of the others stay.
    for (gap, node) in gaps.into_iter().zip(nodes).rev() {
        let (sweep, before) = gap.place;
        sweeps[sweep].nodes.insert(before + 1, node);
    }
}

/// Gives beams, in the order in which they were measured, their echoes from surfaces.
pub fn assign<'n>(nodes: impl Iterator<Item = &'n mut Node>, echoes: &[Echo]) {
    let mut rest = echoes;
    for node in nodes {
        let (own, later) = split_echoes(&node.pulse, rest);
        node.echoes.extend(own.iter().filter(|echo| is_of_surface(echo)).copied());
        rest = later;
    }
}

/// Splits echoes after those of the pulse that comes first.
pub fn split_echoes<'e>(pulse: &Pulse, echoes: &'e [Echo]) -> (&'e [Echo], &'e [Echo]) {
    let is_own = |echo: &&Echo| (echo.device, echo.pulse_number) == (pulse.device, pulse.number);
    echoes.split_at(echoes.iter().take_while(is_own).count())
}

/// Number of pulses from one to another, negative if that is before it.
fn distance(one: &Pulse, other: &Pulse) -> f64 {
    other.number as f64 - one.number as f64
}

/// The pulse half way between two of a sweep, without the noise of attitudes and origins of its own.
fn halfway(one: &Pulse, two: &Pulse) -> Pulse {
    let pulses = two.number.saturating_sub(one.number);
    let number = one.number + pulses / 2;
    let share = (pulses / 2) as f64 / pulses.max(1) as f64;
    let between = |a: f64, b: f64| a + (b - a) * share;
    let turn = |a: Rotation, b: Rotation| turned(a, b, share);
    Pulse {
        origin: one.origin.lerp(two.origin, share),
        attitude: turn(one.attitude, two.attitude),
        exact_attitude: turn(one.exact_attitude, two.exact_attitude),
        reported_attitude: turn(one.reported_attitude, two.reported_attitude),
        scanner_attitude: turn(one.scanner_attitude, two.scanner_attitude),
        origin_error: one.origin_error.lerp(two.origin_error, share),
        time_ns: between(one.time_ns, two.time_ns),
        number,
        device: one.device,
        scan_angle: between(one.scan_angle, two.scan_angle),
        range_error: between(one.range_error, two.range_error),
        velocity: one.velocity.zip(two.velocity).map(|(a, b)| a.lerp(b, share)),
    }
}

/// The rotation at a share of the way between two near ones.
fn turned(a: Rotation, b: Rotation, share: f64) -> Rotation {
    // Quaternions of opposite sign are the same rotation.
    let sign = if a.w * b.w + a.u.dot(b.u) < 0.0 { -1.0 } else { 1.0 };
    let (w, u) = (a.w + (b.w * sign - a.w) * share, a.u + (b.u * sign - a.u) * share);
    let length = (w * w + u.dot(u)).sqrt();
    if length > 0.0 { Rotation { w: w / length, u: u / length } } else { a }
}

/// A step that is taken with its pulses, as one device sees it.
struct Seen {
    /// Number of the step in the chunk.
    step: u32,
    pulse: Option<Pulse>,
    /// Number of pulses up to and with this step.
    emitted: u64,
}

/// Takes one in `every` steps of a chunk, from number `phase` on, and returns the sweeps of all devices,
/// whose beams have no echoes yet. `None` if a device has pulses between these steps only.
///
/// # Errors
/// Errors of the flight.
pub fn take(
    flight: &FlightPlan,
    chunk: &Chunk,
    (every, phase): (u32, u32),
    has_velocities: bool,
) -> Result<Option<Vec<Sweep>>> {
    let mut state = chunk.start.clone();
    let mut sink = Pulses { pulses: Vec::new(), has_velocities };
    let first: Vec<u64> = state.emitted().map(|emitted| emitted + 1).collect();
    let mut tracks: Vec<Vec<Seen>> = first.iter().map(|_| Vec::new()).collect();
    let mut taken = 0;
    for step in (phase..chunk.steps).step_by(every.max(1) as usize) {
        skip(flight, &mut state, step - taken)?;
        state.step(flight, &mut sink)?;
        taken = step + 1;
        let mut pulses = sink.pulses.drain(..).peekable();
        for (device, (track, emitted)) in tracks.iter_mut().zip(state.emitted()).enumerate() {
            let pulse = pulses.next_if(|pulse| pulse.device as usize == device);
            track.push(Seen { step, pulse, emitted });
        }
    }
    skip(flight, &mut state, chunk.steps - taken)?;
    let last: Vec<u64> = state.emitted().collect();
    let turns: Vec<f64> = tracks.iter().map(|track| MAX_TURN * usual_turn(track, every) + 1e-9).collect();
    // Intervals of steps in which a sweep ends.
    let ends: BTreeSet<u32> = tracks
        .iter()
        .zip(&turns)
        .flat_map(|(track, turn)| track.windows(2).filter(move |pair| is_end(pair, every, *turn)))
        .map(|pair| pair[0].step)
        .collect();
    let looked = look(flight, chunk, &ends, every, has_velocities)?;
    let mut sweeps = Vec::new();
    for (device, (track, turn)) in tracks.iter().zip(turns).enumerate() {
        let own = split(track, (first[device], last[device]), (every, turn), &looked);
        if own.is_empty() && last[device] >= first[device] {
            return Ok(None);
        }
        sweeps.extend(own);
    }
    Ok(Some(sweeps))
}

/// The median turn of a device from one step with a pulse to the next.
fn usual_turn(track: &[Seen], every: u32) -> f64 {
    let turn = |pair: &[Seen]| {
        let (one, two) = (pair[0].pulse.as_ref()?, pair[1].pulse.as_ref()?);
        (two.number - one.number == u64::from(every)).then(|| angle(one, two))
    };
    let mut turns: Vec<f64> = track.windows(2).filter_map(turn).collect();
    turns.sort_unstable_by(f64::total_cmp);
    turns.get(turns.len() / 2).copied().unwrap_or(0.0)
}

/// True if a device fires in all steps between two and turns by at most `turn`.
fn is_steady(one: &Pulse, two: &Pulse, every: u32, turn: f64) -> bool {
    two.number.saturating_sub(one.number) == u64::from(every) && angle(one, two) <= turn
}

/// True if a sweep ends between two steps that both have pulses, and others are between them.
fn is_end(pair: &[Seen], every: u32, turn: f64) -> bool {
    let (Some(one), Some(two)) = (&pair[0].pulse, &pair[1].pulse) else { return false };
    !is_steady(one, two, every, turn) && two.number.saturating_sub(one.number) >= 2
}

fn angle(one: &Pulse, two: &Pulse) -> f64 {
    (two.attitude.forward() - one.attitude.forward()).length()
}

/// Divides the pulses of a device, from number `first` to `last`, into sweeps. `looked` are the pulses of all
/// devices between steps, by the first of these steps.
fn split(
    track: &[Seen],
    (first, last): (u64, u64),
    (every, turn): (u32, f64),
    looked: &BTreeMap<u32, Vec<Pulse>>,
) -> Vec<Sweep> {
    let (mut sweeps, mut nodes, mut begin): (Vec<Sweep>, Vec<Node>, u64) = (Vec::new(), Vec::new(), first);
    for (i, seen) in track.iter().enumerate() {
        let Some(pulse) = seen.pulse else { continue };
        nodes.push(Node::new(pulse));
        let end = match track.get(i + 1) {
            None => last,
            Some(Seen { pulse: None, emitted, .. }) => *emitted,
            Some(Seen { pulse: Some(next), .. }) if is_steady(&pulse, next, every, turn) => continue,
            Some(Seen { pulse: Some(next), .. }) => {
                end_between(&pulse, next, looked.get(&seen.step).map(Vec::as_slice).unwrap_or_default())
            }
        };
        let end = end.max(pulse.number);
        sweeps.push(Sweep { nodes: std::mem::take(&mut nodes), first: begin, last: end });
        begin = end + 1;
    }
    // Pulses behind the last beam belong to its sweep.
    if let Some(sweep) = sweeps.last_mut() {
        sweep.last = sweep.last.max(last);
    }
    sweeps
}

/// The number of the last pulse of the first of two sweeps, of which a beam each is given: the beam turns
/// most behind it.
fn end_between(one: &Pulse, two: &Pulse, between: &[Pulse]) -> u64 {
    let (mut before, mut end, mut widest) = (*one, one.number, -1.0);
    for pulse in between.iter().filter(|pulse| pulse.device == one.device).chain([two]) {
        let turn = angle(&before, pulse);
        if turn > widest {
            (end, widest) = (before.number, turn);
        }
        before = *pulse;
    }
    end.min(two.number.saturating_sub(1))
}

/// The pulses of the steps behind each of some steps, up to the next one that was taken.
fn look(
    flight: &FlightPlan,
    chunk: &Chunk,
    steps: &BTreeSet<u32>,
    every: u32,
    has_velocities: bool,
) -> Result<BTreeMap<u32, Vec<Pulse>>> {
    let mut found = BTreeMap::new();
    let mut state = chunk.start.clone();
    let mut taken = 0;
    for from in steps {
        let end = from.saturating_add(every).min(chunk.steps);
        skip(flight, &mut state, from + 1 - taken)?;
        let mut sink = Pulses { pulses: Vec::new(), has_velocities };
        for _ in from + 1..end {
            state.step(flight, &mut sink)?;
        }
        taken = end;
        found.insert(*from, sink.pulses);
    }
    Ok(found)
}

/// Passes over steps of a chunk.
fn skip(flight: &FlightPlan, state: &mut FlightState, steps: u32) -> Result<()> {
    let mut left = steps;
    while left > 0 {
        let skipped = state.skip(flight, u32::MAX, left)?;
        if skipped.steps == 0 {
            break;
        }
        left -= skipped.steps;
    }
    Ok(())
}

/// Collects pulses.
struct Pulses {
    pulses: Vec<Pulse>,
    has_velocities: bool,
}

impl FlightSink for Pulses {
    fn pulse(&mut self, pulse: impl FnOnce() -> Pulse) {
        self.pulses.push(pulse());
    }

    fn records_velocities(&self) -> bool {
        self.has_velocities
    }

    fn pose(&mut self, _: impl FnOnce() -> PoseSample) {}
}

#[cfg(test)]
mod tests;
