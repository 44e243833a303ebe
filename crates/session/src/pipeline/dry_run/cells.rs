//! Returns of a flight, summed in square cells.
//!
//! A measured pulse stands for those that are fired before and behind it, and for the pulses of the same
//! phase in the scan periods around it. Each of these has its returns at its own place: beside the measured
//! one, and by the way of the platform. Spread evenly over that way, returns would differ from those of the
//! run by up to a scan line per cell. Where the scene ends, returns beyond it do not count, and pulses that
//! miss it stand for those beside them that meet it. Sums are whole numbers, which do not depend on the order
//! in which threads add to them.

use super::beams::{Beam, Surroundings, below, is_of_surface, offsets};
use std::collections::HashMap;
use vlscan_base::error::Error;
use vlscan_geom::{DVec3, degrees};
use vlscan_lidar::pulse::Echo;

/// Units of a pulse in sums.
const PULSE: f64 = 4096.0;
/// Units of a degree in sums of angles.
const DEGREE: f64 = 1000.0;
/// Parts along the side of a cell, in which gaps are counted.
const PARTS: i64 = 4;
/// Magnitude from which on numbers have no fraction.
const MAX_FRACTION: f64 = (1u64 << 52) as f64;
/// Parts of a cell.
const PARTS_OF_CELL: u32 = (PARTS * PARTS) as u32;

/// The scan periods that a measured period stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Repeats {
    /// Number of scan periods before it and behind it; the last one of a leg can be a part of a period.
    pub around: [f64; 2],
    /// Horizontal way of the platform in a period, m.
    pub drift: [f64; 2],
}

impl Repeats {
    /// Number of scan periods, itself among them.
    pub fn periods(&self) -> f64 {
        1.0 + self.around[0] + self.around[1]
    }

    /// Way of the platform to the farthest of them, m.
    fn way(&self) -> f64 {
        let [x, y] = self.drift;
        x.hypot(y) * self.around[0].max(self.around[1]).ceil()
    }

    /// Periods that are complete: the number of the first and of the last one, counted from the measured one,
    /// and how often each is flown. A platform that stands has all periods at one place.
    fn complete(&self) -> ([f64; 2], f64) {
        match self.drift == [0.0; 2] {
            true => ([0.0; 2], self.periods()),
            false => ([-self.around[0].floor(), self.around[1].floor()], 1.0),
        }
    }

    /// Numbers of the incomplete periods, and how much of each is flown.
    fn incomplete(&self) -> impl Iterator<Item = (f64, f64)> {
        let is_moving = self.drift != [0.0; 2];
        let ends = [(-1.0, self.around[0]), (1.0, self.around[1])];
        let end = |(sign, count): (f64, f64)| (sign * (count.floor() + 1.0), count.fract());
        ends.into_iter().map(end).filter(move |(_, share)| is_moving && *share > 0.0)
    }
}

/// The returns of a cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CellSum {
    /// First returns.
    pulses: u64,
    /// All returns.
    points: u64,
    /// Angles of incidence of first returns.
    angles: u64,
    /// Pulses whose beams meet the ground here, or would if nothing stood above it.
    aimed: u64,
    /// Pulses among these that have no echo from the ground.
    blocked: u64,
    /// A bit for each part with a first return.
    parts: u16,
    /// Strips with first returns.
    strips: Vec<u32>,
}

impl CellSum {
    /// Number of pulses with returns.
    pub fn pulses(&self) -> f64 {
        self.pulses as f64 / PULSE
    }

    /// Number of returns.
    pub fn points(&self) -> f64 {
        self.points as f64 / PULSE
    }

    /// Number of strips with returns.
    pub fn strips(&self) -> usize {
        self.strips.len()
    }

    /// Share of the cell's parts without a first return.
    pub fn gaps(&self) -> f64 {
        1.0 - f64::from(self.parts.count_ones()) / f64::from(PARTS_OF_CELL)
    }

    /// Mean angle of incidence of first returns, degrees; NaN without returns.
    pub fn incidence_deg(&self) -> f64 {
        if self.pulses == 0 { f64::NAN } else { self.angles as f64 / (self.pulses as f64 * DEGREE) }
    }

    /// Share of the pulses aimed at the ground here that have no echo from it; NaN without such pulses.
    pub fn occlusion(&self) -> f64 {
        if self.aimed == 0 { f64::NAN } else { self.blocked as f64 / self.aimed as f64 }
    }

    /// Adds first returns in a part of the cell.
    fn add_first(&mut self, units: u64, angle: u64, part: u16, strip: u32) {
        self.pulses += units;
        self.angles += units * angle;
        self.parts |= part;
        self.see(strip);
    }

    fn see(&mut self, strip: u32) {
        if !self.strips.contains(&strip) {
            self.strips.push(strip);
        }
    }

    /// Adds the returns of another sum of the cell.
    pub fn join(&mut self, other: &CellSum) {
        self.pulses += other.pulses;
        self.points += other.points;
        self.angles += other.angles;
        self.aimed += other.aimed;
        self.blocked += other.blocked;
        self.parts |= other.parts;
        other.strips.iter().for_each(|strip| self.see(*strip));
    }
}

/// Sums in cells, whose corners are at multiples of their side in the world.
#[derive(Clone, Debug)]
pub struct CoverageCells {
    /// Side of a cell, m.
    side: f64,
    /// Origin of the scene frame in the world, m.
    shift: DVec3,
    /// Index of the sums of a cell by its column and row.
    places: HashMap<[i64; 2], usize>,
    sums: Vec<CellSum>,
    /// The last cell.
    last: Option<([i64; 2], usize)>,
}

impl CoverageCells {
    /// Cells without returns.
    pub fn new(side: f64, shift: DVec3) -> CoverageCells {
        CoverageCells { side, shift, places: HashMap::new(), sums: Vec::new(), last: None }
    }

    /// Number of cells with returns, or ground that pulses are aimed at.
    pub fn count(&self) -> usize {
        self.sums.len()
    }

    /// Columns and rows of the cells with their sums.
    pub fn iter(&self) -> impl Iterator<Item = ([i64; 2], &CellSum)> {
        self.places.iter().map(|(place, index)| (*place, &self.sums[*index]))
    }

    /// Sums of all cells in the order of their columns and rows.
    pub fn into_sums(mut self) -> Vec<([i64; 2], CellSum)> {
        let take = |(place, index): (&[i64; 2], &usize)| (*place, std::mem::take(&mut self.sums[*index]));
        let mut sums: Vec<([i64; 2], CellSum)> = self.places.iter().map(take).collect();
        sums.sort_unstable_by_key(|(place, _)| *place);
        sums
    }

    /// Adds the echoes of a pulse of a strip, by return number. `offsets` are the ways from its places to
    /// those of the pulses that it stands for, itself among them, m. Echoes of the air and of noise do not
    /// count.
    pub fn add(
        &mut self,
        echoes: &[Echo],
        strip: u32,
        (repeats, offsets): (&Repeats, &[[f64; 2]]),
        scene: &Surroundings,
    ) {
        let surfaces = || echoes.iter().filter(|echo| is_of_surface(echo));
        let first = surfaces().map(|echo| echo.return_number).min();
        let last = surfaces().max_by_key(|echo| echo.return_number);
        let aimed = last.filter(|_| scene.has_ground).and_then(|echo| below(echo, scene.heights));
        let seen = last.filter(|_| aimed.is_some_and(|(_, is_seen)| is_seen)).map(|echo| echo.return_number);
        for echo in surfaces() {
            let angle = angle_of(echo.incidence_cosine);
            let is_first = first == Some(echo.return_number);
            let is_aimed = seen == Some(echo.return_number);
            let own = [echo.position.x, echo.position.y];
            self.repeat((own, own), (repeats, offsets), scene, |cell, part, units| {
                cell.points += units;
                if is_first {
                    cell.add_first(units, angle, part, strip);
                }
                cell.aimed += if is_aimed { units } else { 0 };
            });
        }
        if let Some((place, false)) = aimed {
            let own = [place.x, place.y];
            self.repeat((own, own), (repeats, offsets), scene, |cell, _, units| {
                cell.aimed += units;
                cell.blocked += units;
            });
        }
    }

    /// Adds what a pulse without a return stands for: it misses the scene, but pulses around it may meet the
    /// ground at the edge. `swings` are the changes of direction to these pulses.
    pub fn add_around(
        &mut self,
        beam: &Beam,
        strip: u32,
        repeats: &Repeats,
        swings: &[DVec3],
        scene: &Surroundings,
    ) {
        let swing = swings.iter().map(|swing| swing.length()).fold(0.0, f64::max);
        let Some((place, own)) = scene.past_edge(beam, swing, repeats.way()) else { return };
        let angle = angle_of(beam.direction.z);
        let (offsets, place) = (offsets(beam, place, swings), [place.x, place.y]);
        self.repeat((place, own), (repeats, &offsets), scene, |cell, part, units| {
            cell.points += units;
            cell.add_first(units, angle, part, strip);
            cell.aimed += if scene.has_ground { units } else { 0 };
        });
    }

    /// Adds all sums of `other`, which has the same cells.
    pub fn join(&mut self, other: &CoverageCells) {
        for (place, sum) in other.iter() {
            self.cell(place).join(sum);
        }
    }

    /// Adds a return at each offset from `place`, scene frame, and at its repeats. Returns beyond the box of
    /// the scene do not count if the measured one, at `own`, lies within. `add` takes the cell, the bit of
    /// the part in it, and the units of the pulses there.
    fn repeat(
        &mut self,
        (place, own): ([f64; 2], [f64; 2]),
        (repeats, offsets): (&Repeats, &[[f64; 2]]),
        scene: &Surroundings,
        mut add: impl FnMut(&mut CellSum, u16, u64),
    ) {
        let drift = repeats.drift;
        let (complete, times) = repeats.complete();
        let is_cut = scene.has(own);
        let incomplete: Vec<(f64, f64)> = repeats.incomplete().collect();
        for offset in offsets {
            let start = [0, 1].map(|axis| place[axis] + offset[axis]);
            let range = if is_cut { scene.within(start, drift, complete) } else { complete };
            let mut add_some =
                |cell: &mut CellSum, part: u16, count: f64| add(cell, part, units(count * times));
            self.add_line(start, drift, range, &mut add_some);
            for (after, share) in incomplete.iter().copied() {
                let at = [0, 1].map(|axis| start[axis] + after * drift[axis]);
                if !is_cut || scene.has(at) {
                    let mut add_part = |cell: &mut CellSum, part: u16, _: f64| add(cell, part, units(share));
                    self.add_line(at, drift, [0.0; 2], &mut add_part);
                }
            }
        }
    }

    /// Passes the cells and parts of the places `start` + n·`step`, scene frame, for all whole numbers n of
    /// a range to `add`, with their number in each.
    fn add_line(
        &mut self,
        start: [f64; 2],
        step: [f64; 2],
        [low, high]: [f64; 2],
        add: &mut impl FnMut(&mut CellSum, u16, f64),
    ) {
        let side = self.side / PARTS as f64;
        let start = [start[0] + self.shift.x, start[1] + self.shift.y];
        let mut n = low;
        while n <= high {
            let parts = [0, 1].map(|axis| floor((start[axis] + n * step[axis]) / side) as i64);
            // The first number behind the part along an axis.
            let end = |axis: usize| match step[axis] {
                by if by > 0.0 => -floor((start[axis] - (parts[axis] + 1) as f64 * side) / by),
                by if by < 0.0 => floor((parts[axis] as f64 * side - start[axis]) / by) + 1.0,
                _ => f64::INFINITY,
            };
            let next = if n < high { end(0).min(end(1)).max(n + 1.0).min(high + 1.0) } else { high + 1.0 };
            let [column, row] = parts.map(|part| part.rem_euclid(PARTS));
            let cell = self.cell(parts.map(|part| part.div_euclid(PARTS)));
            add(cell, 1u16 << (row * PARTS + column), next - n);
            n = next;
        }
    }

    fn cell(&mut self, place: [i64; 2]) -> &mut CellSum {
        let index = match self.last {
            Some((last, index)) if last == place => index,
            _ => {
                let next = self.sums.len();
                let index = *self.places.entry(place).or_insert(next);
                if index == next {
                    self.sums.push(CellSum::default());
                }
                self.last = Some((place, index));
                index
            }
        };
        &mut self.sums[index]
    }
}

/// The error for more cells of a side, m, than a map can have.
pub fn too_many_cells(side: f64) -> Error {
    Error::input_with_help(
        format!("the coverage of this survey has too many cells of {side} m"),
        "give larger ones with --coverage-cell",
    )
}

/// The largest whole number that is not above a value. `f64::floor` is a call of a function on processors
/// without SSE 4.1, for which programs are built, and took a tenth of the measurement.
fn floor(value: f64) -> f64 {
    if value.abs() >= MAX_FRACTION {
        return value;
    }
    let whole = value as i64 as f64;
    if whole > value { whole - 1.0 } else { whole }
}

/// Pulses in units of sums.
fn units(pulses: f64) -> u64 {
    (pulses * PULSE).round() as u64
}

/// Angle of incidence in units of sums.
fn angle_of(cosine: f64) -> u64 {
    (degrees(libm::acos(cosine.abs().clamp(0.0, 1.0))) * DEGREE).round() as u64
}

#[cfg(test)]
mod tests {
    use super::super::beams::ITSELF;
    use super::*;
    use vlscan_geom::Aabb;

    const ONCE: Repeats = Repeats { around: [0.0; 2], drift: [0.0; 2] };
    /// A scene without edges and without ground.
    const WIDE: Surroundings<'static> = Surroundings {
        heights: &no_height,
        has_ground: false,
        bounds: Aabb { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY },
    };

    fn no_height(_: f64, _: f64) -> Option<f64> {
        None
    }

    fn echo(position: DVec3, pulse_number: u64, return_number: u32) -> Echo {
        Echo {
            position,
            origin: position + DVec3::Z * 100.0,
            direction: -DVec3::Z,
            scanner: Echo::NO_ATTITUDE,
            range: 100.0,
            true_range: 100.0,
            intensity: 1.0,
            echo_width: 0.0,
            return_number,
            number_of_returns: return_number,
            pulse_number,
            device: 0,
            part: 0,
            primitive: 0,
            classification: 0,
            incidence_cosine: 0.5,
            scan_angle: 0.0,
            time_ns: 0.0,
            truth_index: Echo::NO_TRUTH,
        }
    }

    /// Adds the echoes of pulses that stand for themselves only.
    fn add(cells: &mut CoverageCells, echoes: &[Echo], strip: u32, repeats: &Repeats, scene: &Surroundings) {
        for pulse in echoes.chunk_by(|a, b| a.pulse_number == b.pulse_number) {
            cells.add(pulse, strip, (repeats, &[[0.0; 2]]), scene);
        }
    }

    fn cell(cells: &CoverageCells, place: [i64; 2]) -> CellSum {
        cells.iter().find(|(at, _)| *at == place).map(|(_, sum)| sum.clone()).unwrap_or_default()
    }

    #[test]
    fn whole_numbers_are_those_of_the_library() {
        for value in [0.0, 0.5, -0.5, -3.0, 7.0, 4e15, -4e15 - 0.5, 1e300, f64::NEG_INFINITY] {
            assert_eq!(floor(value), value.floor(), "{value}");
        }
    }

    #[test]
    fn a_return_counts_where_its_repeats_are() {
        let mut cells = CoverageCells::new(10.0, DVec3::new(1000.0, 0.0, 0.0));
        // x = 6, 11, 16, 21, 26, 31, 36 and 30 % of a period at 41 m.
        let repeats = Repeats { around: [2.0, 4.3], drift: [5.0, 0.0] };
        add(&mut cells, &[echo(DVec3::new(16.0, 5.0, 0.0), 1, 1)], 7, &repeats, &WIDE);
        let pulses: Vec<f64> = (100..105).map(|column| cell(&cells, [column, 0]).pulses()).collect();
        assert_eq!(pulses[..4], [1.0, 2.0, 2.0, 2.0]);
        assert!((pulses[4] - 0.3).abs() < 1e-3, "{pulses:?}");
        assert_eq!((cells.count(), cell(&cells, [101, 0]).strips()), (5, 1));
        // Two of four parts in one row.
        assert_eq!(cell(&cells, [101, 0]).gaps(), 0.875);
        assert!((cell(&cells, [101, 0]).incidence_deg() - 60.0).abs() < 1e-3);
        // A platform that stands measures the same place in all periods.
        let mut cells = CoverageCells::new(10.0, DVec3::ZERO);
        let repeats = Repeats { around: [2.0, 4.5], drift: [0.0; 2] };
        add(&mut cells, &[echo(DVec3::new(15.0, 5.0, 0.0), 1, 1)], 7, &repeats, &WIDE);
        assert_eq!((cells.count(), cell(&cells, [1, 0]).pulses()), (1, 7.5));
    }

    #[test]
    fn scan_lines_are_counted_as_in_the_run() {
        // Lines every 0.7 m, of which one in nine is measured: 10 m have 14 or 15 lines, not 14.29.
        let repeats = Repeats { around: [4.0, 4.0], drift: [0.7, 0.0] };
        let mut cells = CoverageCells::new(10.0, DVec3::ZERO);
        let x = |line: u32| 0.35 + 0.7 * f64::from(line);
        for line in (4..900).step_by(9) {
            let line_echo = echo(DVec3::new(x(line), 5.0, 0.0), u64::from(line), 1);
            add(&mut cells, &[line_echo], 0, &repeats, &WIDE);
        }
        for column in 0..63 {
            let lines = (0..900).filter(|line| (x(*line) / 10.0).floor() as i64 == column).count();
            assert_eq!(cell(&cells, [column, 0]).pulses(), lines as f64, "{column}");
        }
    }

    #[test]
    fn a_return_counts_for_the_pulses_beside_it() {
        // Straight down from 100 m, and beams 2 m south, 1 m north and 2 m north of it.
        let swings = [-0.02, 0.0, 0.01, 0.02].map(|y| DVec3::new(0.0, y, 0.0));
        let beside = echo(DVec3::new(2.5, 5.0, 0.0), 1, 1);
        let beside =
            offsets(&Beam { origin: beside.origin, direction: beside.direction }, beside.position, &swings);
        let mut cells = CoverageCells::new(5.0, DVec3::ZERO);
        let at = DVec3::new(2.5, 5.0, 0.0);
        cells.add(&[echo(at, 1, 1)], 0, (&ONCE, &beside), &WIDE);
        assert_eq!((cell(&cells, [0, 0]).pulses(), cell(&cells, [0, 1]).pulses()), (1.0, 3.0));
    }

    #[test]
    fn returns_end_with_the_scene() {
        let heights = |x: f64, _: f64| (0.0..=40.0).contains(&x).then_some(0.0);
        let bounds = Aabb { min: DVec3::new(0.0, -50.0, 0.0), max: DVec3::new(40.0, 50.0, 0.0) };
        let scene = Surroundings { heights: &heights, has_ground: true, bounds };
        let mut cells = CoverageCells::new(10.0, DVec3::ZERO);
        let repeats = Repeats { around: [2.0; 2], drift: [1.0, 0.0] };
        // x = 36.5 to 40.5, of which the last is beyond the edge.
        add(&mut cells, &[echo(DVec3::new(38.5, 5.0, 0.0), 1, 1)], 0, &repeats, &scene);
        assert_eq!((cells.count(), cell(&cells, [3, 0]).pulses()), (1, 4.0));
        // x = 39.5 to 43.5, of which the first is not. Others are too far, or within the scene.
        for x in [41.5, 45.0, 20.0] {
            let beam = Beam { origin: DVec3::new(x, 5.0, 100.0), direction: DVec3::NEG_Z };
            cells.add_around(&beam, 0, &repeats, ITSELF, &scene);
        }
        let found = cell(&cells, [3, 0]);
        assert_eq!((cells.count(), found.pulses(), found.points(), found.occlusion()), (1, 5.0, 5.0, 0.0));
    }

    #[test]
    fn drops_do_not_count() {
        let mut cells = CoverageCells::new(10.0, DVec3::ZERO);
        let at = |z: f64, number| echo(DVec3::new(5.0, 5.0, z), number, 1);
        let drop = |number| Echo { part: u32::MAX, ..at(30.0, number) };
        let behind = Echo { return_number: 2, ..at(0.0, 1) };
        add(&mut cells, &[drop(1), behind, drop(2), at(0.0, 3)], 0, &ONCE, &WIDE);
        let found = cell(&cells, [0, 0]);
        assert_eq!((cells.count(), found.pulses(), found.points()), (1, 2.0, 2.0));
    }

    #[test]
    fn sums_do_not_depend_on_the_order() {
        let echoes: Vec<Echo> = (0..200u32)
            .map(|i| echo(DVec3::new(f64::from(i) * 0.37, f64::from(i % 17), 0.0), u64::from(i), 1))
            .collect();
        let repeats = Repeats { around: [1.0, 1.3], drift: [0.7, -1.9] };
        let sum = |parts: &[&[Echo]]| {
            let mut all = CoverageCells::new(5.0, DVec3::ZERO);
            for part in parts {
                let mut cells = CoverageCells::new(5.0, DVec3::ZERO);
                add(&mut cells, part, u32::from(part[0].pulse_number >= 100), &repeats, &WIDE);
                all.join(&cells);
            }
            let mut found: Vec<_> =
                all.iter().map(|(place, sum)| (place, sum.pulses, sum.strips())).collect();
            found.sort_unstable();
            found
        };
        let (one, two) = echoes.split_at(100);
        assert_eq!(sum(&[one, two]), sum(&[two, one]));
    }

    #[test]
    fn what_stands_above_the_ground_hides_it() {
        let ground = |x: f64, _: f64| (x >= 0.0).then_some(0.1 * x);
        let scene = Surroundings { heights: &ground, has_ground: true, ..WIDE };
        let slanted =
            |position, number| Echo { direction: DVec3::new(0.6, 0.0, -0.8), ..echo(position, number, 1) };
        let mut cells = CoverageCells::new(10.0, DVec3::ZERO);
        // A beam that ends 10 m above x = 14 would meet the ground 10 / (4/3 + 0.1) = 7 m farther on.
        add(&mut cells, &[slanted(DVec3::new(14.0, 5.0, 11.4), 1)], 0, &ONCE, &scene);
        assert_eq!(cell(&cells, [1, 0]).pulses(), 1.0);
        assert!(cell(&cells, [1, 0]).occlusion().is_nan());
        assert_eq!(cell(&cells, [2, 0]).occlusion(), 1.0);
        // One that reaches the ground in the cell.
        let mut cells = CoverageCells::new(10.0, DVec3::ZERO);
        add(&mut cells, &[slanted(DVec3::new(3.0, 5.0, 0.3), 1)], 0, &ONCE, &scene);
        assert_eq!(cell(&cells, [0, 0]).occlusion(), 0.0);
        // Two pulses, of which one has a second echo from the ground.
        let mut cells = CoverageCells::new(10.0, DVec3::ZERO);
        let at = |z| DVec3::new(5.0, 5.0, z);
        let both = [echo(at(8.0), 1, 1), echo(at(0.5), 1, 2), echo(at(8.0), 2, 1)];
        add(&mut cells, &both, 0, &ONCE, &scene);
        let found = cell(&cells, [0, 0]);
        assert_eq!((found.occlusion(), found.pulses(), found.points()), (0.5, 2.0, 3.0));
        // Without ground, and for beams that rise, nothing is hidden.
        let mut cells = CoverageCells::new(10.0, DVec3::ZERO);
        add(&mut cells, &[echo(DVec3::new(-5.0, 5.0, 3.0), 1, 1)], 0, &ONCE, &scene);
        let up = Echo { direction: DVec3::Z, ..echo(at(9.0), 1, 1) };
        add(&mut cells, &[up], 0, &ONCE, &scene);
        assert!(cells.iter().all(|(_, sum)| sum.occlusion().is_nan()));
    }
}
