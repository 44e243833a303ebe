//! Counter-based random numbers: pure functions of seed, purpose and counters.
//!
//! Every draw is Philox4x32-10 (Salmon et al. 2011, "Parallel random numbers: as easy as 1, 2, 3"). The key
//! is the survey's seed; the plain text holds the [`Purpose`], the emitting device, the pulse number and a
//! counter. There is no state, so no draw depends on threads, chunks or previous draws.

mod normals;

pub use normals::NORMALS_PER_BLOCK;

use libm::{cos, log, sin};

/// Consecutive multiples of the golden ratio, without their integers, are evenly distributed and repeat
/// nowhere.
pub const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// The purpose of a draw. Streams of different purposes are independent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Purpose {
    /// Range noise of an echo.
    Range = 1,
    /// Noise on a waveform's samples.
    Waveform = 2,
    /// Free path in a transmittive voxel.
    FreePath = 3,
    /// Platform position noise along x, y, z.
    PositionX = 4,
    /// See [`Purpose::PositionX`].
    PositionY = 5,
    /// See [`Purpose::PositionX`].
    PositionZ = 6,
    /// Attitude noise about the beam frame's x, y, z.
    AttitudeX = 7,
    /// See [`Purpose::AttitudeX`].
    AttitudeY = 8,
    /// See [`Purpose::AttitudeX`].
    AttitudeZ = 9,
    /// Random offset of a leg's position.
    LegOffset = 10,
    /// Random displacement of scaled voxels.
    VoxelShift = 11,
    /// Random variants of materials.
    Material = 12,
    /// Procedural scenes.
    SceneMaking = 13,
    /// Rotation of the pattern of subrays about the beam's axis.
    PatternTurn = 14,
    /// Noise of the receiver on a waveform sample.
    ReceiverNoise = 15,
    /// False alarms: returns that noise alone causes.
    FalseAlarm = 16,
    /// Halves of a recording that are compared with each other.
    Halves = 17,
    /// Number of photoelectrons of an echo, and whether it is lost.
    PhotonCount = 20,
    /// Large numbers of photoelectrons of an echo.
    LargePhotonCount = 21,
    /// Slopes of the facets of rough mirrors.
    FacetSlope = 22,
    /// Raindrops and snowflakes in the beam.
    WeatherDrop = 23,
    /// Afterpulses of a photon counter.
    Afterpulse = 24,
    /// Jitter of the times of photons.
    PhotonJitter = 25,
    /// Navigation errors: position, attitude, boresight and lever arm.
    Navigation = 32,
}

/// A stream of draws for one seed and purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stream {
    key: [u32; 2],
    purpose: u32,
}

impl Stream {
    /// The stream of `purpose` under `seed`.
    pub fn new(seed: u64, purpose: Purpose) -> Stream {
        Stream { key: [seed as u32, (seed >> 32) as u32], purpose: purpose as u32 }
    }

    /// 128 random bits for (`group`, `number`, `counter`): device, pulse number, draw within the pulse. Only
    /// the low 24 bits of `group` are used; the purpose takes the other 8 bits of its word.
    pub fn bits(&self, group: u32, number: u64, counter: u32) -> [u32; 4] {
        let plain = [number as u32, (number >> 32) as u32, counter, group.wrapping_shl(8) ^ self.purpose];
        philox4x32_10(plain, self.key)
    }

    /// Uniform in [0, 1), with a resolution of 53 bits.
    pub fn uniform(&self, group: u32, number: u64, counter: u32) -> f64 {
        let b = self.bits(group, number, counter);
        unit_interval(b[0], b[1])
    }

    /// Standard normal (Box–Muller on one Philox block).
    pub fn normal(&self, group: u32, number: u64, counter: u32) -> f64 {
        let b = self.bits(group, number, counter);
        // 1 − u lies in (0, 1], so the logarithm is finite.
        let radius = (-2.0 * log(1.0 - unit_interval(b[0], b[1]))).sqrt();
        let angle = std::f64::consts::TAU * unit_interval(b[2], b[3]);
        // One of the two values of the pair is chosen at random.
        if b[3] & 1 == 0 { radius * cos(angle) } else { radius * sin(angle) }
    }
}

/// Uniform in (0, 1], with a resolution of 53 bits from two words, so that its logarithm is finite.
pub fn open_unit(high: u32, low: u32) -> f64 {
    1.0 - unit_interval(high, low)
}

#[inline(always)]
fn unit_interval(high: u32, low: u32) -> f64 {
    let bits = (u64::from(high) << 21) | u64::from(low >> 11);
    bits as f64 * (1.0 / (1u64 << 53) as f64)
}

fn philox4x32_10(mut c: [u32; 4], mut k: [u32; 2]) -> [u32; 4] {
    for _ in 0..10 {
        let p0 = u64::from(c[0]) * 0xD251_1F53;
        let p1 = u64::from(c[2]) * 0xCD9E_8D57;
        c = [(p1 >> 32) as u32 ^ c[1] ^ k[0], p1 as u32, (p0 >> 32) as u32 ^ c[3] ^ k[1], p0 as u32];
        k = [k[0].wrapping_add(0x9E37_79B9), k[1].wrapping_add(0xBB67_AE85)];
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_answers() {
        // Vectors published with the Random123 paper.
        assert_eq!(philox4x32_10([0; 4], [0; 2]), [0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8]);
        assert_eq!(philox4x32_10([!0; 4], [!0; 2]), [0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd]);
        assert_eq!(
            philox4x32_10([0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344], [0xa4093822, 0x299f31d0]),
            [0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1]
        );
    }

    #[test]
    fn normal_draws_have_unit_variance_and_no_skew() {
        let s = Stream::new(7, Purpose::Range);
        let n = 100_000;
        let draws: Vec<f64> = (0..n).map(|i| s.normal(0, i, 0)).collect();
        let moment = |p: i32| draws.iter().map(|d| d.powi(p)).sum::<f64>() / n as f64;
        assert!(moment(1).abs() < 0.015, "mean {}", moment(1));
        assert!((moment(2) - 1.0).abs() < 0.02, "variance {}", moment(2));
        assert!(moment(3).abs() < 0.04, "third moment {}", moment(3));
        assert!((moment(4) - 3.0).abs() < 0.12, "fourth moment {}", moment(4));
    }

    #[test]
    fn purposes_devices_and_counters_are_different_streams() {
        let a = Stream::new(1, Purpose::PositionX);
        let b = Stream::new(1, Purpose::PositionY);
        assert_ne!(a.uniform(0, 1, 0), b.uniform(0, 1, 0));
        assert_ne!(a.uniform(0, 1, 0), a.uniform(1, 1, 0));
        assert_ne!(a.uniform(0, 1, 0), a.uniform(0, 1, 1));
        assert_eq!(a.uniform(3, 9, 2), Stream::new(1, Purpose::PositionX).uniform(3, 9, 2));
    }
}
