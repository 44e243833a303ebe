//! Adaptive arithmetic coder of LAZ: 32-bit intervals, carries that propagate into written bytes, and models
//! of symbol frequencies that are updated at growing intervals.

/// Bits of a symbol's probability.
const PROBABILITY_BITS: u32 = 15;
/// Sum of counts at which all counts are halved.
const MAX_COUNTS: u32 = 1 << PROBABILITY_BITS;
/// Bits of a probability in models of one bit.
const BIT_PROBABILITY_BITS: u32 = 13;
/// Minimum length of the interval.
const MIN_LENGTH: u32 = 1 << 24;

/// Arithmetic coder: writes symbols as one long binary fraction.
#[derive(Debug, Default)]
pub(super) struct Coder {
    base: u32,
    length: u32,
    written: Written,
}

/// The written bytes and spare capacity, kept apart from the interval so that the interval stays in
/// registers.
#[derive(Debug, Default)]
struct Written {
    out: Vec<u8>,
    at: usize,
}

impl Coder {
    /// Creates a coder with capacity for `capacity` bytes.
    pub fn new(capacity: usize) -> Coder {
        Coder { base: 0, length: u32::MAX, written: Written { out: vec![0; capacity.max(16)], at: 0 } }
    }

    /// Writes `symbol` with its probability in `model`, and counts it in the model.
    #[inline(always)]
    pub fn symbol(&mut self, model: &mut Model, symbol: u32) {
        let s = symbol as usize;
        let unit = self.length >> PROBABILITY_BITS;
        // There is one slot more than there are symbols.
        let next = u32::from(model.slots[s + 1].before);
        let slot = &mut model.slots[s];
        let low = u32::from(slot.before) * unit;
        // The last symbol takes the part of the interval that rounding leaves over.
        let high = if symbol == model.last { self.length } else { next * unit };
        slot.count += 1;
        self.narrow(low, high - low);
        model.until_update -= 1;
        if model.until_update == 0 {
            model.update();
        }
    }

    #[inline(always)]
    pub fn bit(&mut self, model: &mut BitModel, bit: bool) {
        let zero = model.zero * (self.length >> BIT_PROBABILITY_BITS);
        if bit {
            self.narrow(zero, self.length - zero);
        } else {
            model.zeros += 1;
            self.narrow(0, zero);
        }
        model.until_update -= 1;
        if model.until_update == 0 {
            model.update();
        }
    }

    /// Writes the low `bits` bits of `value` (at most 32) without a model; the other bits must be 0.
    #[inline(always)]
    pub fn raw(&mut self, mut bits: u32, mut value: u32) {
        if bits > 19 {
            let unit = self.length >> 16;
            self.narrow((value & 0xFFFF) * unit, unit);
            (bits, value) = (bits - 16, value >> 16);
        }
        let unit = self.length >> bits;
        self.narrow(value * unit, unit);
    }

    pub fn word(&mut self, value: u32) {
        for half in [value & 0xFFFF, value >> 16] {
            let unit = self.length >> 16;
            self.narrow(half * unit, unit);
        }
    }

    /// Narrows the interval to a part of it.
    #[inline(always)]
    fn narrow(&mut self, low: u32, length: u32) {
        let (base, carry) = self.base.overflowing_add(low);
        if carry {
            self.written.carry();
        }
        // Number of leading bits that no later symbol changes except by a carry, in whole bytes, often 0. A
        // branch on it would be mispredicted, so four bytes are always written, and the position advances by
        // the final ones.
        let bits = length.leading_zeros() & !7;
        let Written { out, at } = &mut self.written;
        if *at + 4 > out.len() {
            grow(out);
        }
        if let Some(bytes) = out.get_mut(*at..*at + 4) {
            bytes.copy_from_slice(&base.to_be_bytes());
        }
        *at += (bits / 8) as usize;
        self.base = base << bits;
        self.length = length << bits;
    }

    /// Writes the end of the fraction and returns all bytes.
    pub fn finish(mut self) -> Vec<u8> {
        let is_long = self.length > 2 * MIN_LENGTH;
        let (low, length) =
            if is_long { (MIN_LENGTH, MIN_LENGTH >> 1) } else { (MIN_LENGTH >> 1, MIN_LENGTH >> 9) };
        self.narrow(low, length);
        let Written { mut out, at } = self.written;
        out.truncate(at);
        out.extend(&[0, 0, 0][..if is_long { 3 } else { 2 }]);
        out
    }
}

impl Written {
    #[cold]
    fn carry(&mut self) {
        for byte in self.out[..self.at].iter_mut().rev() {
            *byte = byte.wrapping_add(1);
            if *byte != 0 {
                break;
            }
        }
    }
}

#[cold]
fn grow(out: &mut Vec<u8>) {
    out.resize(out.len() * 2, 0);
}

/// Adaptive model of symbol frequencies.
#[derive(Clone, Debug)]
pub(super) struct Model {
    /// One slot per symbol, and one more.
    slots: Box<[Slot]>,
    last: u32,
    until_update: u32,
    cycle: u32,
    total: u32,
}

#[derive(Clone, Copy, Debug)]
struct Slot {
    /// Cumulative probability of all smaller symbols.
    before: u16,
    /// Number of occurrences.
    count: u16,
}

impl Model {
    /// Creates a model of `symbols` symbols (at least 2) with equal probabilities.
    pub fn new(symbols: u32) -> Model {
        let slots = vec![Slot { before: 0, count: 1 }; symbols as usize + 1].into_boxed_slice();
        let mut model = Model { slots, last: symbols - 1, until_update: 0, cycle: symbols, total: 0 };
        model.update();
        model.cycle = (symbols + 6) >> 1;
        model.until_update = model.cycle;
        model
    }

    #[cold]
    #[inline(never)]
    fn update(&mut self) {
        let symbols = self.last as usize + 1;
        let slots = &mut self.slots[..symbols];
        self.total += self.cycle;
        if self.total > MAX_COUNTS {
            self.total = 0;
            for slot in slots.iter_mut() {
                slot.count = slot.count.div_ceil(2);
                self.total += u32::from(slot.count);
            }
        }
        let scale = (1 << 31) / self.total;
        let mut sum = 0;
        for slot in slots.iter_mut() {
            slot.before = ((scale * sum) >> (31 - PROBABILITY_BITS)) as u16;
            sum += u32::from(slot.count);
        }
        self.cycle = (5 * self.cycle / 4).min((symbols as u32 + 6) << 3);
        self.until_update = self.cycle;
    }
}

/// Adaptive model of one bit.
#[derive(Clone, Copy, Debug)]
pub(super) struct BitModel {
    zeros: u32,
    total: u32,
    /// Probability of 0.
    zero: u32,
    until_update: u32,
    cycle: u32,
}

impl BitModel {
    /// Both values are equally likely.
    pub const EVEN: BitModel =
        BitModel { zeros: 1, total: 2, zero: 1 << (BIT_PROBABILITY_BITS - 1), until_update: 4, cycle: 4 };

    #[cold]
    fn update(&mut self) {
        self.total += self.cycle;
        if self.total > 1 << BIT_PROBABILITY_BITS {
            self.total = (self.total + 1) >> 1;
            self.zeros = (self.zeros + 1) >> 1;
            if self.zeros == self.total {
                self.total += 1;
            }
        }
        let scale = (1 << 31) / self.total;
        self.zero = (self.zeros * scale) >> (31 - BIT_PROBABILITY_BITS);
        self.cycle = (5 * self.cycle / 4).min(64);
        self.until_update = self.cycle;
    }
}

/// Coder of integers as differences from a prediction: the magnitude as one symbol, the upper bits below it
/// as another, the lower bits without a model.
#[derive(Debug)]
pub(super) struct Integers {
    /// Binary magnitude of the last difference.
    pub magnitude: u32,
    bits: u32,
    magnitudes: Vec<Model>,
    small: BitModel,
    /// Models of the upper bits by magnitude; `None` until the magnitude occurs.
    upper: [Option<Model>; 31],
}

/// Number of bits of a difference that are modelled.
const MODELLED_BITS: u32 = 8;

impl Integers {
    /// Creates a coder of integers of 16 or 32 `bits`, whose magnitudes depend on `contexts` contexts.
    pub fn new(bits: u32, contexts: usize) -> Integers {
        Integers {
            magnitude: 0,
            bits,
            magnitudes: vec![Model::new(bits + 1); contexts],
            small: BitModel::EVEN,
            upper: [const { None }; 31],
        }
    }

    /// Writes the integer `real`.
    #[inline(always)]
    pub fn write(&mut self, coder: &mut Coder, predicted: i32, real: i32, context: usize) {
        let mut off = real.wrapping_sub(predicted);
        if self.bits == 16 {
            off = i32::from(off as i16);
        }
        // The smallest k with −2^k < off ≤ 2^k.
        let beyond = if off <= 0 { off.wrapping_neg() } else { off - 1 } as u32;
        let k = 32 - beyond.leading_zeros();
        self.magnitude = k;
        coder.symbol(&mut self.magnitudes[context], k);
        if k == 0 {
            coder.bit(&mut self.small, off == 1);
        } else if k < 32 {
            // Index among the 2^k differences of this magnitude.
            let place = if off > 0 { off - 1 } else { off + ((1u32 << k) - 1) as i32 } as u32;
            let upper =
                self.upper[k as usize - 1].get_or_insert_with(|| Model::new(1 << k.min(MODELLED_BITS)));
            if k <= MODELLED_BITS {
                coder.symbol(upper, place);
            } else {
                let lower = k - MODELLED_BITS;
                coder.symbol(upper, place >> lower);
                coder.raw(lower, place & ((1 << lower) - 1));
            }
        }
    }
}
