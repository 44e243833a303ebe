//! Random numbers and noise of generated scenes, as pure functions of the seed.

use vlscan_base::rng::{Purpose, Stream};
use vlscan_geom::DVec3;

/// Purposes of random numbers; the sequences of different topics are independent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum Topic {
    Relief = 0,
    // Octaves of a relief take the numbers from here on.
    Stand = 32,
    Tree = 33,
    Shrub = 34,
    House = 35,
    Boulder = 36,
    Stone = 37,
    Book = 38,
    Plant = 39,
    Crown = 40,
}

/// The sequence of random numbers of one item (`number`) of a topic.
pub(super) struct Random {
    stream: Stream,
    topic: Topic,
    number: u64,
    counter: u32,
    block: [u32; 4],
    left: usize,
}

impl Random {
    pub(super) fn new(seed: u64, topic: Topic, number: u64) -> Random {
        let stream = Stream::new(seed, Purpose::SceneMaking);
        Random { stream, topic, number, counter: 0, block: [0; 4], left: 0 }
    }

    /// Uniform in [0, 1) with 32 bits.
    pub(super) fn unit(&mut self) -> f64 {
        if self.left == 0 {
            self.block = self.stream.bits(self.topic as u32, self.number, self.counter);
            self.counter = self.counter.wrapping_add(1);
            self.left = 4;
        }
        self.left -= 1;
        f64::from(self.block[self.left]) * (1.0 / 4_294_967_296.0)
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Bell-shaped in (−1, 1), standard deviation 1/3.
    pub(super) fn bell(&mut self) -> f64 {
        (self.unit() + self.unit() + self.unit()) * (2.0 / 3.0) - 1.0
    }

    /// Uniform on the unit circle (rejection, no transcendental function).
    pub(super) fn heading(&mut self) -> (f64, f64) {
        loop {
            let (x, y) = (self.between(-1.0, 1.0), self.between(-1.0, 1.0));
            let square = x * x + y * y;
            if square <= 1.0 && square > 1e-6 {
                let scale = 1.0 / square.sqrt();
                return (x * scale, y * scale);
            }
        }
    }

    /// Uniform on the unit sphere (Marsaglia 1972, "Choosing a point from the surface of a sphere").
    pub(super) fn direction(&mut self) -> DVec3 {
        loop {
            let (x, y) = (self.between(-1.0, 1.0), self.between(-1.0, 1.0));
            let square = x * x + y * y;
            if square < 1.0 {
                let scale = 2.0 * (1.0 - square).sqrt();
                return DVec3::new(x * scale, y * scale, 1.0 - 2.0 * square);
            }
        }
    }
}

/// One octave of gradient noise: wavelength and amplitude in metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Octave {
    pub(super) wavelength: f64,
    pub(super) amplitude: f64,
}

/// A height above the plane: a sum of octaves of gradient noise (Perlin 2002, "Improving noise").
pub(super) struct Relief {
    stream: Stream,
    octaves: Vec<Octave>,
}

impl Relief {
    /// Selects the octaves that a mesh with cells of `cell` metres can resolve.
    pub(super) fn new(seed: u64, octaves: &[Octave], cell: f64) -> Relief {
        let octaves = octaves.iter().copied().filter(|o| o.wavelength >= 2.5 * cell).collect();
        Relief { stream: Stream::new(seed, Purpose::SceneMaking), octaves }
    }

    /// Height at (x, y), m.
    pub(super) fn height(&self, x: f64, y: f64) -> f64 {
        let octave = |(i, o): (usize, &Octave)| {
            o.amplitude * self.noise(i as u32, x / o.wavelength + 0.37, y / o.wavelength + 0.71)
        };
        self.octaves.iter().enumerate().map(octave).sum()
    }

    /// Gradient noise of lattice `layer`, roughly within ±1.
    fn noise(&self, layer: u32, x: f64, y: f64) -> f64 {
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let corner = |i: f64, j: f64| {
            let number = u64::from((x0 + i) as i32 as u32) << 32 | u64::from((y0 + j) as i32 as u32);
            let bits = self.stream.bits(Topic::Relief as u32 + layer, number, 0);
            let component = |b: u32| f64::from(b) * (2.0 / 4_294_967_296.0) - 1.0;
            component(bits[0]) * (fx - i) + component(bits[1]) * (fy - j)
        };
        let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
        let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
        let (u, v) = (fade(fx), fade(fy));
        1.6 * mix(mix(corner(0.0, 0.0), corner(1.0, 0.0), u), mix(corner(0.0, 1.0), corner(1.0, 1.0), u), v)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OCTAVES: [Octave; 2] =
        [Octave { wavelength: 40.0, amplitude: 5.0 }, Octave { wavelength: 3.0, amplitude: 0.3 }];

    #[test]
    fn dice_repeat_and_differ_by_topic_number_and_seed() {
        let first = |seed, topic, number| Random::new(seed, topic, number).unit();
        assert_eq!(first(1, Topic::Tree, 5), first(1, Topic::Tree, 5));
        assert_ne!(first(1, Topic::Tree, 5), first(1, Topic::Tree, 6));
        assert_ne!(first(1, Topic::Tree, 5), first(1, Topic::Shrub, 5));
        assert_ne!(first(1, Topic::Tree, 5), first(2, Topic::Tree, 5));
    }

    #[test]
    fn directions_are_unit_and_balanced() {
        let mut random = Random::new(3, Topic::Tree, 0);
        let mut sum = DVec3::ZERO;
        for _ in 0..20_000 {
            let d = random.direction();
            assert!((d.length() - 1.0).abs() < 1e-12);
            sum += d;
        }
        assert!(sum.length() / 20_000.0 < 0.02, "{sum}");
    }

    #[test]
    fn relief_is_continuous_and_uneven() {
        let relief = Relief::new(9, &OCTAVES, 0.5);
        let heights: Vec<f64> = (0..4000).map(|i| relief.height(f64::from(i) * 0.05 - 100.0, 12.3)).collect();
        let steepest = heights.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        let span = heights.iter().fold(f64::NEG_INFINITY, |a, &h| a.max(h))
            - heights.iter().fold(f64::INFINITY, |a, &h| a.min(h));
        assert!(steepest < 0.1, "a step of {steepest} m in 5 cm");
        assert!(span > 1.0, "only {span} m of relief");
    }

    #[test]
    fn a_coarse_mesh_leaves_fine_octaves_out() {
        assert_eq!(Relief::new(9, &OCTAVES, 5.0).octaves.len(), 1);
    }
}
