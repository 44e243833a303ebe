//! Ray clouds: PLY whose vertices are the ends of rays, with the vector to the sensor in place of a normal, as raycloudtools
//! reads it (<https://github.com/csiro-robotics/raycloudtools>). `alpha` is 255, and 0 for a pulse without echo, whose ray ends
//! in free space.

use super::codec::{LegFacts, PointCodec, seconds};
use super::las::LasFormat;
use vlscan_geom::DVec3;
use vlscan_lidar::pulse::Echo;

/// Length of the ray of a pulse without echo, m.
const MISS_M: f64 = 100.0;

/// Bytes of a vertex: position and time, the vector to the sensor, colour.
const VERTEX_BYTES: usize = 4 * 8 + 3 * 4 + 4;

/// Returns the header of a file with `count` vertices. A padded comment makes its length independent of the count.
pub(super) fn head(count: u64, state: &str) -> Vec<u8> {
    let count = count.to_string();
    let padding = " ".repeat(20 - count.len());
    let mut head = format!(
        "ply\nformat binary_little_endian 1.0\ncomment vlscan {}\ncomment state {state:40}\ncomment .{padding}\n\
         element vertex {count}\n",
        env!("CARGO_PKG_VERSION")
    );
    let properties = [("double", ["x", "y", "z", "time"].as_slice()), ("float", &["nx", "ny", "nz"])];
    let colours = [("uchar", ["red", "green", "blue", "alpha"].as_slice())];
    for (kind, names) in properties.iter().chain(&colours) {
        names.iter().for_each(|name| head.push_str(&format!("property {kind} {name}\n")));
    }
    head.push_str("end_header\n");
    head.into_bytes()
}

/// Encoder of echoes as vertices. The grey of a vertex is its intensity as in LAS, in decibels.
pub(super) struct RayCloudCodec<'a> {
    pub shift: DVec3,
    pub las: &'a LasFormat,
}

impl PointCodec for RayCloudCodec<'_> {
    const TYPICAL_BYTES: usize = VERTEX_BYTES;

    fn push(&self, out: &mut Vec<u8>, _: &LegFacts, echo: &Echo) -> Option<DVec3> {
        let end = if echo.is_miss() { echo.origin + echo.direction * MISS_M } else { echo.position };
        let position = end + self.shift;
        position.to_array().into_iter().for_each(|c| out.extend(c.to_le_bytes()));
        out.extend(seconds(echo.time_ns).to_le_bytes());
        (echo.origin - end).to_array().into_iter().for_each(|c| out.extend((c as f32).to_le_bytes()));
        let grey = (self.las.digital_intensity(echo.intensity) >> 8) as u8;
        out.extend([grey, grey, grey, if echo.is_miss() { 0 } else { 255 }]);
        Some(position)
    }
}
