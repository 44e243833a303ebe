//! Even samples of the pulses of a cloud.

use vlscan_geom::DVec3;

/// A sample of one pulse of 2ⁿ, with all its returns. Pulses are chosen by bits that are mixed from their
/// time and source, so that the sample is the same in any order of points and part of each larger one; where
/// there are no times, returns are chosen by their positions.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Thinning {
    /// n.
    shift: u32,
    by_position: bool,
}

impl Thinning {
    /// One of this many pulses is in the sample.
    pub fn one_of(self) -> u64 {
        1 << self.shift
    }

    /// Half of the sample. `has_times` is true if the points have times.
    pub fn coarser(self, has_times: bool) -> Thinning {
        let by_position = if self.shift == 0 { !has_times } else { self.by_position };
        Thinning { shift: (self.shift + 1).min(u64::BITS - 1), by_position }
    }

    /// True if the sample has a return at a position, m, of a pulse with these properties.
    pub fn has(self, pulse: [u64; 3], position: DVec3) -> bool {
        let bits = if self.by_position { position.to_array().map(f64::to_bits) } else { pulse };
        bits.into_iter().fold(0, |all, bits| mixed(all ^ bits)) & (self.one_of() - 1) == 0
    }
}

/// Mixes bits so that each depends on all (splitmix64).
fn mixed(bits: u64) -> u64 {
    let bits = bits.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_even_and_within_each_other() {
        let pulse = |i: u32| [f64::from(i).to_bits(), u64::from(i / 1000), 0];
        let mut sample = Thinning::default();
        let mut before = 4000;
        for n in 0..5 {
            let coarser = sample.coarser(true);
            let count = |sample: Thinning| (0..4000).filter(|i| sample.has(pulse(*i), DVec3::ZERO)).count();
            let both = (0..4000)
                .filter(|i| sample.has(pulse(*i), DVec3::ZERO) || !coarser.has(pulse(*i), DVec3::ZERO));
            assert_eq!((sample.one_of(), both.count()), (1 << n, 4000));
            assert!(
                n == 0 || (count(sample) as f64 / before as f64 - 0.5).abs() < 0.1,
                "{n}: {}",
                count(sample)
            );
            (before, sample) = (count(sample), coarser);
        }
        // By positions, which differ where times do not.
        let half = Thinning::default().coarser(false);
        let is_in = |i: &u32| half.has([0; 3], DVec3::new(f64::from(*i), 0.5, -3.0));
        assert!((1800..2200).contains(&(0..4000).filter(is_in).count()));
    }
}
