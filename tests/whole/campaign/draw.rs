//! Random numbers as a function of a seed and of how many were drawn before.

/// A sequence of random numbers.
pub struct Draw {
    seed: u64,
    drawn: u64,
}

impl Draw {
    pub fn new(seed: u64) -> Draw {
        Draw { seed, drawn: 0 }
    }

    /// SplitMix64 of the seed and the number of draws (Steele, Lea, Flood 2014).
    fn bits(&mut self) -> u64 {
        self.drawn += 1;
        let mix = |x: u64| {
            let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            x ^ (x >> 31)
        };
        mix(mix(self.seed.wrapping_add(0x9e37_79b9_7f4a_7c15))
            .wrapping_add(self.drawn.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
    }

    /// A whole number below `end`.
    pub fn below(&mut self, end: u64) -> u64 {
        self.bits() % end
    }

    /// A whole number from `first` to `last`.
    pub fn between(&mut self, first: u64, last: u64) -> u64 {
        first + self.below(last - first + 1)
    }

    /// A number from `low` to `high`, with at most three decimals.
    pub fn number(&mut self, low: f64, high: f64) -> f64 {
        let fraction = (self.bits() >> 11) as f64 / (1u64 << 53) as f64;
        ((low + (high - low) * fraction) * 1000.0).round() / 1000.0
    }

    pub fn chance(&mut self, probability: f64) -> bool {
        ((self.bits() >> 11) as f64) < probability * (1u64 << 53) as f64
    }

    pub fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len() as u64) as usize]
    }
}

#[test]
fn numbers_are_functions_of_the_seed() {
    let numbers = |seed: u64| {
        let mut draw = Draw::new(seed);
        (0..1000).map(|_| draw.between(3, 7)).collect::<Vec<_>>()
    };
    assert_eq!(numbers(1), numbers(1));
    assert_ne!(numbers(1), numbers(2));
    let counts = (3..=7).map(|n| numbers(1).iter().filter(|m| **m == n).count());
    // Five standard deviations of 200 among 1000.
    assert!(counts.clone().all(|c| (137..263).contains(&c)), "{:?}", counts.collect::<Vec<_>>());
}
