//! Packs points for a page: in blocks along a space-filling curve, as differences, in planes of bytes,
//! deflated.
//!
//! Neighbours on the curve are neighbours in space, so differences are small and their upper bytes are nearly
//! all zero; a forest takes 5 to 7 bytes per point.

use super::super::colour::Colouring;
use crate::cloud::Points;
use base64::prelude::{BASE64_STANDARD, Engine};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use rayon::prelude::*;
use std::io::{self, Write};
use vlscan_formats::Attribute;

/// Number of points per block: small enough that the page stays responsive while it unpacks one.
const BLOCK: usize = 65_536;
/// Steps of the position grid along the longest side.
const STEPS: f64 = ((1u32 << 21) - 1) as f64;

/// The attributes that are stored as bytes of their place in a scale of colours.
#[derive(Default)]
pub(super) struct Scales<'a> {
    pub(super) intensity: Option<&'a Colouring>,
    pub(super) time: Option<&'a Colouring>,
}

pub(super) struct Packed {
    /// Step of the position grid, m.
    pub(super) step: f64,
    /// Typical distance of neighbouring points on a surface, m.
    pub(super) spacing: f64,
    blocks: Vec<(usize, Vec<u8>)>,
}

/// Selects at most `max` of `total` points: a random one from each of `max` equal runs, so that regular
/// patterns in the order of the points (returns, scan lines) do not show.
pub(super) fn sample(total: usize, max: usize) -> Vec<u32> {
    let total = total.min(u32::MAX as usize) as u64;
    let max = (max as u64).min(total);
    (0..max)
        .map(|i| {
            let (from, to) = (i * total / max, (i + 1) * total / max);
            (from + mixed_bits(i) % (to - from).max(1)) as u32
        })
        .collect()
}

/// Hashes a number (the finaliser of SplitMix64, Steele 2014).
fn mixed_bits(i: u64) -> u64 {
    let mut z = i.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

pub(super) fn pack(points: &Points, chosen: &[u32], scales: &Scales) -> Packed {
    let grid = Grid::of(points);
    let mut order: Vec<(u64, u32)> =
        chosen.par_iter().map(|&i| (curve(grid.cell(&points.offset(i as usize))), i)).collect();
    order.par_sort_unstable();
    let spacing = spacing(&grid, &order);
    let packed = |block: &[(u64, u32)]| (block.len(), planes(points, block, &grid, scales));
    Packed { step: grid.step, spacing, blocks: order.par_chunks(BLOCK).map(packed).collect() }
}

impl Packed {
    /// Writes the script elements that the page unpacks.
    pub(super) fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        for (count, bytes) in &self.blocks {
            write!(out, "<script type=\"text/plain\" class=\"block\" data-count=\"{count}\">")?;
            out.write_all(BASE64_STANDARD.encode(bytes).as_bytes())?;
            out.write_all(b"</script>\n")?;
        }
        Ok(())
    }
}

/// The grid to which positions are rounded.
struct Grid {
    step: f64,
    /// Lowest corner relative to the points' origin, m.
    low: [f64; 3],
}

impl Grid {
    fn of(points: &Points) -> Grid {
        if points.is_empty() {
            return Grid { step: 1.0, low: [0.0; 3] };
        }
        let bounds = points.bounds();
        let longest = bounds.size().max_element();
        // One millimetre, or finer for small clouds.
        let step = (longest / STEPS).max((longest / 4096.0).min(0.001)).max(1e-9);
        Grid { step, low: (bounds.min - points.origin()).to_array() }
    }

    fn cell(&self, offset: &[f32; 3]) -> [u32; 3] {
        std::array::from_fn(|a| {
            (((f64::from(offset[a]) - self.low[a]) / self.step).round().clamp(0.0, STEPS)) as u32
        })
    }
}

/// Position on the Z-order curve (Morton 1966): the interleaved bits of three coordinates.
fn curve(cell: [u32; 3]) -> u64 {
    let spread = |v: u32| {
        let mut v = u64::from(v) & 0x1f_ffff;
        v = (v | v << 32) & 0x001f_0000_0000_ffff;
        v = (v | v << 16) & 0x001f_0000_ff00_00ff;
        v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
        v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
        (v | v << 2) & 0x1249_2492_4924_9249
    };
    spread(cell[0]) | spread(cell[1]) << 1 | spread(cell[2]) << 2
}

/// Typical distance of neighbouring points, m: half the edge of the cubes, found by halving, that contain at
/// most four points on average.
fn spacing(grid: &Grid, order: &[(u64, u32)]) -> f64 {
    for level in (0..=21u32).rev() {
        let occupied =
            1 + order.windows(2).filter(|w| w[0].0 >> (3 * level) != w[1].0 >> (3 * level)).count();
        if order.len() < 4 * occupied && level > 0 {
            // The mean crosses four between this level and the next coarser one.
            let filled = order.len() as f64 / occupied as f64;
            let edge = grid.step * f64::from(1u32 << level);
            if level < 21 {
                return edge / filled.max(1.0).sqrt();
            }
            return edge;
        }
    }
    grid.step
}

/// Planes of bytes: the lower, middle and upper bytes of the zigzag-coded differences of x, y and z; then the
/// other attributes of the points.
fn planes(points: &Points, block: &[(u64, u32)], grid: &Grid, scales: &Scales) -> Vec<u8> {
    let cells: Vec<[u32; 3]> = block.iter().map(|&(_, i)| grid.cell(&points.offset(i as usize))).collect();
    let mut bytes = Vec::with_capacity(block.len() * 14);
    for axis in 0..3 {
        let differences: Vec<u32> = cells
            .iter()
            .scan(0i32, |last, cell| {
                let now = cell[axis] as i32;
                let difference = now - std::mem::replace(last, now);
                Some(((difference << 1) ^ (difference >> 31)) as u32)
            })
            .collect();
        for shift in [0, 8, 16] {
            bytes.extend(differences.iter().map(|d| (d >> shift) as u8));
        }
    }
    let mut plane = |byte: &dyn Fn(usize) -> u8| bytes.extend(block.iter().map(|&(_, i)| byte(i as usize)));
    if points.has(Attribute::Intensity) {
        plane(&|i| shade(scales.intensity, points, i));
    }
    for values in [&points.class, &points.return_number].into_iter().filter(|values| !values.is_empty()) {
        plane(&|i| values.at(i));
    }
    if points.has(Attribute::Object) {
        plane(&|i| points.object.at(i) as u8);
        plane(&|i| (points.object.at(i) >> 8) as u8);
    }
    if points.has(Attribute::Leg) {
        plane(&|i| points.leg.at(i).min(255) as u8);
    }
    if points.has(Attribute::Channel) {
        plane(&|i| points.channel.at(i));
    }
    if points.has(Attribute::Time) {
        plane(&|i| shade(scales.time, points, i));
    }
    if points.has_colours() {
        // Five, six and five bits of red, green and blue.
        let packed = |i: usize| {
            let [red, green, blue] = points.colour_of(i).map(u16::from);
            red >> 3 | green >> 2 << 5 | blue >> 3 << 11
        };
        plane(&|i| packed(i) as u8);
        plane(&|i| (packed(i) >> 8) as u8);
    }
    let mut encoder = ZlibEncoder::new(Vec::with_capacity(bytes.len() / 2), Compression::default());
    // Writing to memory does not fail.
    let packed = encoder.write_all(&bytes).and_then(|()| encoder.finish());
    packed.unwrap_or_default()
}

/// Place of a value in its scale, as a byte.
fn shade(scale: Option<&Colouring>, points: &Points, i: usize) -> u8 {
    scale.map_or(0, |colouring| (colouring.fraction(points, i) * 255.0).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;
    use vlscan_formats::{AttributeSet, PointRow};
    use vlscan_geom::DVec3;

    #[test]
    fn a_sample_takes_one_of_each_run() {
        assert_eq!(sample(5, 10), [0, 1, 2, 3, 4]);
        let chosen = sample(1_000_003, 1000);
        assert_eq!(chosen.len(), 1000);
        assert!(chosen.windows(2).all(|w| w[0] < w[1] && w[1] - w[0] < 2002));
        // Every second point is a second return: so are about half of the sample.
        let second = chosen.iter().filter(|&&i| i % 2 == 1).count();
        assert!((430..570).contains(&second), "{second}");
        assert!(sample(0, 10).is_empty());
    }

    #[test]
    fn positions_and_attributes_come_back() {
        let mut points = Points::new(AttributeSet::of(|a| matches!(a, Attribute::Class | Attribute::Object)));
        for i in 0..3000u32 {
            let t = f64::from(i);
            let object = (i % 700).to_string();
            let position =
                DVec3::new(5e5 + 40.0 * (t * 0.37).sin(), 5e6 + 0.01 * t, 100.0 + (t * 0.11).cos());
            points.push(&PointRow { position, class: (i % 7) as u8, ..PointRow::default() }, Some(&object));
        }
        let chosen = sample(points.len(), usize::MAX);
        let packed = pack(&points, &chosen, &Scales::default());
        assert_eq!((packed.step, packed.blocks.len()), (0.001, 1));
        let (count, deflated) = &packed.blocks[0];
        let mut bytes = Vec::new();
        flate2::read::ZlibDecoder::new(&deflated[..]).read_to_end(&mut bytes).unwrap();
        assert_eq!(bytes.len(), count * 12);
        let byte = |plane: usize, i: usize| u32::from(bytes[plane * count + i]);
        let mut found: Vec<([i64; 3], u32, u32)> = Vec::new();
        let mut last = [0i64; 3];
        for i in 0..*count {
            for (axis, value) in last.iter_mut().enumerate() {
                let zigzag = byte(3 * axis, i) | byte(3 * axis + 1, i) << 8 | byte(3 * axis + 2, i) << 16;
                *value += i64::from(zigzag >> 1) ^ -i64::from(zigzag & 1);
            }
            found.push((last, byte(9, i), byte(10, i) | byte(11, i) << 8));
        }
        let low = points.bounds().min;
        let mut wanted: Vec<([i64; 3], u32, u32)> = (0..points.len())
            .map(|i| {
                let [x, y, z] = points.offset(i).map(f64::from);
                let at = DVec3::new(x, y, z) + points.origin() - low;
                (
                    at.to_array().map(|v| (v / 0.001).round() as i64),
                    u32::from(points.class.at(i)),
                    u32::from(points.object.at(i)),
                )
            })
            .collect();
        found.sort_unstable();
        wanted.sort_unstable();
        assert!(found == wanted);
    }

    #[test]
    fn the_spacing_is_that_of_a_surface() {
        let mut points = Points::default();
        for i in 0..40_000u32 {
            let (x, y) = (f64::from(i % 200) * 0.1, f64::from(i / 200) * 0.1);
            points.push(&PointRow { position: DVec3::new(x, y, 0.3 * x), ..PointRow::default() }, None);
        }
        let packed = pack(&points, &sample(40_000, usize::MAX), &Scales::default());
        assert!((0.05..0.2).contains(&packed.spacing), "{}", packed.spacing);
    }
}
