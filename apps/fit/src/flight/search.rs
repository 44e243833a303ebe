//! Medians and other order statistics of very many values, which are computed again in each pass and not
//! kept. A pass counts values by the next 16 bits of their order, until few are left.

/// Bits by which values are counted in a pass.
const PASS_BITS: u32 = 16;
/// Number of values that are kept in the last pass.
const MAX_KEPT: u64 = if cfg!(test) { 50 } else { 1 << 19 };

/// The ranks of one or two values, from 0, by the number of values.
type Ranks = fn(u64) -> [u64; 2];

/// A search for a value of a rank, or for the mean of two values of successive ranks.
pub(super) struct OrderSearch {
    ranks: Ranks,
    /// The ranks among the values that begin with the known bits.
    sought: [u64; 2],
    /// The known bits of the values, and their number.
    prefix: u64,
    known: u32,
    pass: Pass,
}

/// The use of the values of a pass.
enum Pass {
    /// Counts them by their next bits.
    Count(Vec<u64>),
    /// Finds the largest value with the first prefix and the smallest one with the second, one bit pattern
    /// each, whose ranks are sought.
    Ends { prefixes: [u64; 2], keys: [u64; 2] },
    /// Keeps those with the known bits.
    Keep(Vec<u64>),
    /// Needs none: the result is known.
    Done(Option<f64>),
}

impl OrderSearch {
    /// A search for the median, see [`vlscan_geom::median`].
    pub fn median() -> OrderSearch {
        OrderSearch::of(|count| [(count - 1) / 2, count / 2])
    }

    /// A search for the values of these ranks, which are below the number of values, itself at least 1.
    pub fn of(ranks: Ranks) -> OrderSearch {
        let pass = Pass::Count(vec![0; 1 << PASS_BITS]);
        OrderSearch { ranks, sought: [0; 2], prefix: 0, known: 0, pass }
    }

    /// The result, `Some(None)` without values; `None` if another pass over the values is needed.
    pub fn result(&self) -> Option<Option<f64>> {
        match self.pass {
            Pass::Done(result) => Some(result),
            _ => None,
        }
    }

    /// Adds a value of the pass. Each pass has the same values, in any order.
    pub fn add(&mut self, value: f64) {
        let key = key_of(value);
        let (known, prefix) = (self.known, self.prefix);
        match &mut self.pass {
            Pass::Count(counts) if first_bits(key, known) == prefix => {
                let next = first_bits(key, known + PASS_BITS) & ((1 << PASS_BITS) - 1);
                counts[next as usize] += 1;
            }
            Pass::Ends { prefixes, keys } => {
                let first = first_bits(key, known);
                if first == prefixes[0] {
                    keys[0] = keys[0].max(key);
                } else if first == prefixes[1] {
                    keys[1] = keys[1].min(key);
                }
            }
            Pass::Keep(kept) if first_bits(key, known) == prefix => kept.push(key),
            Pass::Count(_) | Pass::Keep(_) | Pass::Done(_) => {}
        }
    }

    /// Ends a pass over all values.
    pub fn end_pass(&mut self) {
        let next = match &mut self.pass {
            Pass::Count(counts) => {
                let counts = std::mem::take(counts);
                self.narrow(counts)
            }
            Pass::Ends { keys, .. } => Pass::Done(Some(mean(*keys))),
            Pass::Keep(kept) => {
                kept.sort_unstable();
                let key = |rank: u64| kept.get(rank as usize).copied();
                let [lower, upper] = self.sought.map(key);
                Pass::Done(lower.zip(upper).map(|(lower, upper)| self.value([lower, upper])))
            }
            Pass::Done(result) => Pass::Done(*result),
        };
        self.pass = next;
    }

    /// The next pass, after one that has counted the values by their next bits.
    fn narrow(&mut self, mut counts: Vec<u64>) -> Pass {
        if self.known == 0 {
            let count = counts.iter().sum();
            if count == 0 {
                return Pass::Done(None);
            }
            self.sought = (self.ranks)(count);
        }
        self.known += PASS_BITS;
        let [lower, upper] = self.sought.map(|rank| bucket_of(&counts, rank));
        let prefix = |bucket: Bucket| self.prefix << PASS_BITS | bucket.index;
        if lower.index != upper.index {
            return Pass::Ends { prefixes: [lower, upper].map(prefix), keys: [0, u64::MAX] };
        }
        self.prefix = prefix(lower);
        self.sought = self.sought.map(|rank| rank - lower.below);
        if self.known == u64::BITS {
            return Pass::Done(Some(self.value([self.prefix; 2])));
        }
        if counts[lower.index as usize] <= MAX_KEPT {
            return Pass::Keep(Vec::with_capacity(counts[lower.index as usize] as usize));
        }
        counts.fill(0);
        Pass::Count(counts)
    }

    /// The value of a key, or the mean of two whose ranks differ.
    fn value(&self, keys: [u64; 2]) -> f64 {
        let [lower, upper] = self.sought;
        if lower == upper { value_of(keys[0]) } else { mean(keys) }
    }
}

/// The median of the values that `values` computes, the same ones in each call. Equal to
/// [`vlscan_geom::median`], which keeps them.
pub(super) fn median_of<V: Iterator<Item = f64>>(values: impl Fn() -> V) -> Option<f64> {
    search(OrderSearch::median(), values)
}

/// The result of a search among the values that `values` computes, the same ones in each call.
pub(super) fn search<V: Iterator<Item = f64>>(
    mut search: OrderSearch,
    values: impl Fn() -> V,
) -> Option<f64> {
    loop {
        if let Some(result) = search.result() {
            return result;
        }
        values().for_each(|value| search.add(value));
        search.end_pass();
    }
}

/// Values with the same next bits.
#[derive(Clone, Copy)]
struct Bucket {
    /// The bits.
    index: u64,
    /// Number of values with smaller ones.
    below: u64,
}

/// The bucket with the value of a rank; the last one for a rank beyond all values.
fn bucket_of(counts: &[u64], rank: u64) -> Bucket {
    let mut below = 0;
    for (index, count) in (0..).zip(counts) {
        if rank < below + count {
            return Bucket { index, below };
        }
        below += count;
    }
    Bucket { index: counts.len() as u64 - 1, below: rank }
}

/// Bits of a value whose order as numbers is that of [`f64::total_cmp`].
fn key_of(value: f64) -> u64 {
    let bits = value.to_bits();
    if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }
}

/// The value of a key.
fn value_of(key: u64) -> f64 {
    f64::from_bits(if key >> 63 == 1 { key & !(1 << 63) } else { !key })
}

fn mean([lower, upper]: [u64; 2]) -> f64 {
    0.5 * (value_of(lower) + value_of(upper))
}

/// The first bits of a key.
fn first_bits(key: u64, bits: u32) -> u64 {
    key.checked_shr(u64::BITS - bits).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checks medians and another rank of values against those of sorted ones.
    fn check(values: &[f64]) {
        let each = || values.iter().copied();
        let bits = |value: Option<f64>| value.map(f64::to_bits);
        assert_eq!(bits(median_of(each)), bits(vlscan_geom::median(each())), "{} values", values.len());
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let found = search(OrderSearch::of(|count| [count * 19 / 20; 2]), each);
        assert_eq!(bits(found), bits(sorted.get(values.len() * 19 / 20).copied()), "{} values", values.len());
    }

    #[test]
    fn results_are_those_of_sorted_values() {
        let mixed = |k: u64| k.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11;
        for count in [0, 1, 2, 3, 49, 50, 51, 52, 1000, 1001] {
            let random = |k: u64| mixed(k + 1) as f64 / (1u64 << 53) as f64;
            let values = |of: &dyn Fn(u64) -> f64| (0..count).map(of).collect::<Vec<f64>>();
            check(&values(&random));
            // Of both signs and all sizes.
            check(&values(&|k| (random(k) - 0.5) * 10f64.powi(mixed(k) as i32 % 200 - 100)));
            // Nearly equal, equal, and of two values.
            check(&values(&|k| 5e-6 + 1e-13 * random(k)));
            check(&values(&|_| -3.25));
            check(&values(&|k| if k % 2 == 0 { 1.0 } else { -7e9 }));
            check(&values(&|k| if k % 3 == 0 { 0.0 } else { -0.0 }));
        }
    }

    #[test]
    fn the_two_values_in_the_middle_may_be_far_apart() {
        let values: Vec<f64> = (0..600).map(|k| if k < 300 { 1e-3 * f64::from(k) } else { 1e9 }).collect();
        check(&values);
        let halves: Vec<f64> = (0..600).map(|k| f64::from(u8::from(k < 300))).collect();
        check(&halves);
    }

    #[test]
    fn keys_have_the_order_of_values() {
        let values = [f64::NEG_INFINITY, -2.0, -1e-300, -0.0, 0.0, 1e-300, 1.5, f64::INFINITY, f64::NAN];
        assert!(values.windows(2).all(|pair| key_of(pair[0]) < key_of(pair[1])));
        assert!(values.iter().all(|value| value_of(key_of(*value)).to_bits() == value.to_bits()));
    }
}
