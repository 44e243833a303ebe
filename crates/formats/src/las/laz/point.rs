//! Point data record format 6, layer by layer.

use super::coder::{Coder, Integers, Model};
use std::array::from_fn;

/// Bytes of a point without extra bytes.
pub(super) const POINT: usize = 30;

#[inline(always)]
fn field<const N: usize>(record: &[u8; POINT], at: usize) -> [u8; N] {
    from_fn(|i| record[at + i])
}

/// The state of a point that the next point's coding depends on.
#[derive(Clone, Copy, Debug)]
struct Point {
    x: i32,
    y: i32,
    z: i32,
    intensity: u16,
    /// Return number, and number of returns.
    returns: u8,
    /// Classification flags, scan direction, edge of flight line.
    flags: u8,
    class: u8,
    user: u8,
    angle: i16,
    source: u16,
    time: f64,
}

impl Point {
    #[inline(always)]
    fn of(record: &[u8; POINT]) -> Point {
        Point {
            x: i32::from_le_bytes(field(record, 0)),
            y: i32::from_le_bytes(field(record, 4)),
            z: i32::from_le_bytes(field(record, 8)),
            intensity: u16::from_le_bytes(field(record, 12)),
            returns: record[14],
            // The scanner channel lies between these bits.
            flags: record[15] & 0x0F | (record[15] >> 6) << 4,
            class: record[16],
            user: record[17],
            angle: i16::from_le_bytes(field(record, 18)),
            source: u16::from_le_bytes(field(record, 20)),
            time: f64::from_le_bytes(field(record, 22)),
        }
    }

    fn number(&self) -> usize {
        usize::from(self.returns & 15)
    }

    fn count(&self) -> usize {
        usize::from(self.returns >> 4)
    }
}

pub(super) fn channel(record: &[u8]) -> u8 {
    record[15] >> 4 & 3
}

/// The layers of the points of a chunk, all of one scanner channel.
pub(super) struct Points {
    last: Point,
    /// True if the last point's time differs from the time before it.
    time_changed: bool,
    positions: Positions,
    heights: Layer,
    height: Integers,
    last_z: [i32; 8],
    classes: Layer,
    class: [Option<Model>; 64],
    flags: Rare,
    intensities: Layer,
    intensity: Integers,
    last_intensity: [u16; 8],
    angles: Layer,
    angle: Integers,
    users: Rare,
    sources: Layer,
    source: Integers,
    times: Layer,
    time: Times,
}

/// The bytes of a layer, and whether anything changed; an unchanged layer is left out.
struct Layer {
    coder: Coder,
    changed: bool,
}

impl Layer {
    fn new(capacity: usize) -> Layer {
        Layer { coder: Coder::new(capacity), changed: false }
    }

    fn finish(self) -> Vec<u8> {
        if self.changed { self.coder.finish() } else { Vec::new() }
    }
}

/// A layer of bytes that rarely change: unchanged bytes are only counted at first.
struct Rare {
    layer: Layer,
    unchanged: u32,
    symbols: u32,
    models: [Option<Model>; 64],
}

impl Rare {
    fn new(symbols: u32) -> Rare {
        Rare { layer: Layer::new(16), unchanged: 0, symbols, models: [const { None }; 64] }
    }

    /// Writes `value` with the model of `context`; the context must not change while the value does not.
    #[inline(always)]
    fn write(&mut self, context: usize, last: u8, value: u8) {
        if last == value && !self.layer.changed {
            self.unchanged += 1;
        } else {
            self.write_changed(context, last, value);
        }
    }

    #[cold]
    fn write_changed(&mut self, context: usize, last: u8, value: u8) {
        let model = self.models[context].get_or_insert_with(|| Model::new(self.symbols));
        for _ in 0..std::mem::take(&mut self.unchanged) {
            self.layer.coder.symbol(model, u32::from(last));
        }
        self.layer.changed |= last != value;
        self.layer.coder.symbol(model, u32::from(value));
    }
}

/// The layer of change flags, returns, x and y.
struct Positions {
    coder: Coder,
    changed: [Model; 8],
    counts: [Option<Model>; 16],
    numbers: [Option<Model>; 16],
    numbers_same_time: Model,
    x: Integers,
    y: Integers,
    x_steps: [Median; 12],
    y_steps: [Median; 12],
}

fn even(k: u32) -> u32 {
    k & !1
}

impl Points {
    /// Creates the layers of a chunk of `points` points that begins with `first`.
    pub fn new(first: &[u8; POINT], points: usize) -> Points {
        let p = Point::of(first);
        Points {
            last: p,
            time_changed: false,
            positions: Positions {
                coder: Coder::new(points * 6),
                changed: from_fn(|_| Model::new(128)),
                counts: [const { None }; 16],
                numbers: [const { None }; 16],
                numbers_same_time: Model::new(13),
                x: Integers::new(32, 2),
                y: Integers::new(32, 22),
                x_steps: [Median::NEW; 12],
                y_steps: [Median::NEW; 12],
            },
            heights: Layer { coder: Coder::new(points * 3), changed: true },
            height: Integers::new(32, 20),
            last_z: [p.z; 8],
            classes: Layer::new(points),
            class: [const { None }; 64],
            flags: Rare::new(64),
            intensities: Layer::new(points * 2),
            intensity: Integers::new(16, 4),
            last_intensity: [p.intensity; 8],
            angles: Layer::new(points),
            angle: Integers::new(16, 2),
            users: Rare::new(256),
            sources: Layer::new(16),
            source: Integers::new(16, 1),
            times: Layer::new(points),
            time: Times::new(p.time),
        }
    }

    #[inline(always)]
    pub fn write(&mut self, record: &[u8; POINT]) {
        let (last, p) = (self.last, Point::of(record));
        let time_changed = last.time != p.time;
        let (number, count) = (p.number(), p.count());
        self.positions.write(&last, self.time_changed, &p, time_changed);

        let magnitude = (self.positions.x.magnitude + self.positions.y.magnitude) / 2;
        let context = u32::from(count == 1) + even(magnitude.min(18));
        let level = count.abs_diff(number).min(7);
        self.height.write(&mut self.heights.coder, self.last_z[level], p.z, context as usize);
        self.last_z[level] = p.z;

        let rank = 2 * usize::from(number == 1) + usize::from(number >= count);
        let context = usize::from(last.class & 0x1F) << 1 | usize::from(rank == 3);
        self.classes.changed |= p.class != last.class;
        let model = self.class[context].get_or_insert_with(|| Model::new(256));
        self.classes.coder.symbol(model, u32::from(p.class));

        self.flags.write(usize::from(last.flags), last.flags, p.flags);

        self.intensities.changed |= p.intensity != last.intensity;
        let before = &mut self.last_intensity[rank << 1 | usize::from(time_changed)];
        self.intensity.write(&mut self.intensities.coder, i32::from(*before), i32::from(p.intensity), rank);
        *before = p.intensity;

        if p.angle != last.angle {
            self.angles.changed = true;
            let (from, to) = (i32::from(last.angle), i32::from(p.angle));
            self.angle.write(&mut self.angles.coder, from, to, usize::from(time_changed));
        }
        self.users.write(usize::from(last.user / 4), last.user, p.user);
        if p.source != last.source {
            self.sources.changed = true;
            self.source.write(&mut self.sources.coder, i32::from(last.source), i32::from(p.source), 0);
        }
        if time_changed {
            self.times.changed = true;
            self.time.write(&mut self.times.coder, p.time.to_bits() as i64);
        }
        (self.last, self.time_changed) = (p, time_changed);
    }

    /// Returns all layers in their order in a chunk; empty where nothing changed.
    pub fn finish(self) -> [Vec<u8>; 9] {
        [
            self.positions.coder.finish(),
            self.heights.finish(),
            self.classes.finish(),
            self.flags.layer.finish(),
            self.intensities.finish(),
            self.angles.finish(),
            self.users.layer.finish(),
            self.sources.finish(),
            self.times.finish(),
        ]
    }
}

impl Positions {
    #[inline(always)]
    fn write(&mut self, last: &Point, last_time_changed: bool, p: &Point, time_changed: bool) {
        let (last_number, last_count) = (last.number(), last.count());
        let (number, count) = (p.number(), p.count());
        // The return number: unchanged, incremented, decremented, or any other.
        let step = match (number + 16 - last_number) % 16 {
            0 => 0,
            1 => 1,
            15 => 2,
            _ => 3,
        };
        let changed = u32::from(last.source != p.source) << 5
            | u32::from(time_changed) << 4
            | u32::from(last.angle != p.angle) << 3
            | u32::from(last_count != count) << 2
            | step;
        let context = usize::from(last_number == 1)
            | usize::from(last_number >= last_count) << 1
            | usize::from(last_time_changed) << 2;
        self.coder.symbol(&mut self.changed[context], changed);
        if last_count != count {
            let model = self.counts[last_count].get_or_insert_with(|| Model::new(16));
            self.coder.symbol(model, count as u32);
        }
        if step == 3 {
            if time_changed {
                let model = self.numbers[last_number].get_or_insert_with(|| Model::new(16));
                self.coder.symbol(model, number as u32);
            } else {
                let symbol = (number + 16 - last_number) % 16 - 2;
                self.coder.symbol(&mut self.numbers_same_time, symbol as u32);
            }
        }

        let kind = usize::from(KINDS[count][number]) << 1 | usize::from(time_changed);
        let single = usize::from(count == 1);
        let dx = p.x.wrapping_sub(last.x);
        self.x.write(&mut self.coder, self.x_steps[kind].middle(), dx, single);
        self.x_steps[kind].add(dx);
        let dy = p.y.wrapping_sub(last.y);
        let context = single + even(self.x.magnitude.min(20)) as usize;
        self.y.write(&mut self.coder, self.y_steps[kind].middle(), dy, context);
        self.y_steps[kind].add(dy);
    }
}

/// Class of a return by number of returns and return number (single, first of two, last of two and so on), as
/// fixed by the format.
const KINDS: [[u8; 16]; 16] = [
    [0, 1, 2, 3, 4, 5, 3, 4, 4, 5, 5, 5, 5, 5, 5, 5],
    [1, 0, 1, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3],
    [2, 1, 2, 4, 4, 4, 4, 4, 4, 4, 4, 3, 3, 3, 3, 3],
    [3, 3, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [3, 3, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4, 4],
    [4, 3, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4, 4],
    [5, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 4, 4, 4, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 4, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 4],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5],
    [5, 3, 3, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5],
];

/// Streaming median of five numbers: new numbers replace the largest and the smallest in turn.
#[derive(Clone, Copy, Debug)]
struct Median {
    sorted: [i32; 5],
    /// True if the largest is replaced next.
    high: bool,
}

impl Median {
    const NEW: Median = Median { sorted: [0; 5], high: true };

    #[inline(always)]
    fn middle(&self) -> i32 {
        self.sorted[2]
    }

    #[inline(always)]
    fn add(&mut self, v: i32) {
        let s = self.sorted;
        if self.high {
            self.high = v < s[2];
            self.sorted = if v < s[0] {
                [v, s[0], s[1], s[2], s[3]]
            } else if v < s[1] {
                [s[0], v, s[1], s[2], s[3]]
            } else if v < s[2] {
                [s[0], s[1], v, s[2], s[3]]
            } else if v < s[3] {
                [s[0], s[1], s[2], v, s[3]]
            } else {
                [s[0], s[1], s[2], s[3], v]
            };
        } else {
            self.high = v <= s[2];
            self.sorted = if v > s[4] {
                [s[1], s[2], s[3], s[4], v]
            } else if v > s[3] {
                [s[1], s[2], s[3], v, s[4]]
            } else if v > s[2] {
                [s[1], s[2], v, s[3], s[4]]
            } else if v > s[1] {
                [s[1], v, s[2], s[3], s[4]]
            } else {
                [v, s[1], s[2], s[3], s[4]]
            };
        }
    }
}

/// Coder of times as sequences of steps, up to four of them interleaved.
struct Times {
    first_step: Model,
    multiple: Model,
    steps: Integers,
    last: usize,
    newest: usize,
    times: [i64; 4],
    /// The typical step of each sequence; 0 while there is none.
    step: [i32; 4],
    /// Consecutive atypical steps.
    atypical: [u32; 4],
}

/// Largest multiple of the typical step that has a symbol.
const MAX_MULTIPLE: i32 = 500;
/// Smallest multiple that has a symbol.
const MIN_MULTIPLE: i32 = -10;
/// Symbol that begins a new sequence; the symbols after it switch to another existing one.
const NEW_SEQUENCE: i32 = MAX_MULTIPLE - MIN_MULTIPLE + 1;

impl Times {
    fn new(first: f64) -> Times {
        Times {
            first_step: Model::new(5),
            multiple: Model::new((NEW_SEQUENCE + 4) as u32),
            steps: Integers::new(32, 9),
            last: 0,
            newest: 0,
            times: [first.to_bits() as i64, 0, 0, 0],
            step: [0; 4],
            atypical: [0; 4],
        }
    }

    #[inline(always)]
    fn write(&mut self, coder: &mut Coder, time: i64) {
        let step = time.wrapping_sub(self.times[self.last]);
        match i32::try_from(step) {
            Ok(step) => self.write_step(coder, step),
            Err(_) => self.leave_sequence(coder, time),
        }
        self.times[self.last] = time;
    }

    #[inline(always)]
    fn write_step(&mut self, coder: &mut Coder, step: i32) {
        let now = self.last;
        let typical = self.step[now];
        if typical == 0 {
            coder.symbol(&mut self.first_step, 0);
            self.steps.write(coder, 0, step, 0);
            (self.step[now], self.atypical[now]) = (step, 0);
            return;
        }
        let ratio = step as f32 / typical as f32;
        let multiple = (if ratio >= 0.0 { ratio + 0.5 } else { ratio - 0.5 }) as i32;
        let (symbol, predicted, context) = match multiple {
            1 => {
                self.atypical[now] = 0;
                coder.symbol(&mut self.multiple, 1);
                return self.steps.write(coder, typical, step, 1);
            }
            0 => (0, 0, 7),
            2..MAX_MULTIPLE => (multiple, multiple.wrapping_mul(typical), if multiple < 10 { 2 } else { 3 }),
            MAX_MULTIPLE.. => (MAX_MULTIPLE, MAX_MULTIPLE.wrapping_mul(typical), 4),
            ..=MIN_MULTIPLE => (MAX_MULTIPLE - MIN_MULTIPLE, MIN_MULTIPLE.wrapping_mul(typical), 6),
            _ => (MAX_MULTIPLE - multiple, multiple.wrapping_mul(typical), 5),
        };
        coder.symbol(&mut self.multiple, symbol as u32);
        self.steps.write(coder, predicted, step, context);
        if matches!(context, 4 | 6 | 7) {
            self.atypical[now] += 1;
            if self.atypical[now] > 3 {
                (self.step[now], self.atypical[now]) = (step, 0);
            }
        }
    }

    /// Continues another sequence or begins a new one, because the step exceeds 32 bits.
    #[cold]
    fn leave_sequence(&mut self, coder: &mut Coder, time: i64) {
        let now = self.last;
        let (model, new_sequence) = if self.step[now] == 0 {
            (&mut self.first_step, 1)
        } else {
            (&mut self.multiple, NEW_SEQUENCE as u32)
        };
        let other = (1..4).find_map(|i| {
            let of_other = i32::try_from(time.wrapping_sub(self.times[(now + i) & 3]));
            of_other.ok().map(|step| (i, step))
        });
        if let Some((i, step)) = other {
            coder.symbol(model, new_sequence + i as u32);
            self.last = (now + i) & 3;
            return self.write_step(coder, step);
        }
        coder.symbol(model, new_sequence);
        self.steps.write(coder, (self.times[now] >> 32) as i32, (time >> 32) as i32, 8);
        coder.word(time as u32);
        self.newest = (self.newest + 1) & 3;
        self.last = self.newest;
        (self.step[self.last], self.atypical[self.last]) = (0, 0);
    }
}
