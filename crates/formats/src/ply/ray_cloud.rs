//! Ray clouds: PLY whose vertices are the ends of rays, with the vector to the sensor in place of a normal,
//! as raycloudtools reads it (<https://github.com/csiro-robotics/raycloudtools>). `alpha` is 255, and 0 for a
//! pulse without echo, whose ray ends in free space.

use crate::encode::{Counted, FileBody, PointEncoder};
use crate::out::OutputStream;
use crate::record::{EncodedPoints, PointBatch};
use crate::settings::{CloudSettings, SOFTWARE};
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;
use vlscan_base::files::Patched;
use vlscan_geom::DVec3;

/// Length of the ray of a pulse without echo, m.
const MISS_M: f64 = 100.0;

/// Bytes of a vertex: position and time, the vector to the sensor, colour.
const VERTEX_BYTES: usize = 4 * 8 + 3 * 4 + 4;

/// Encoder of points as vertices. The grey of a vertex is its intensity as in LAS, in decibels.
#[derive(Debug)]
struct RayCloud {
    /// World position of the origin of points, m.
    origin: DVec3,
}

/// Ray clouds.
pub(crate) fn ray_cloud(settings: &CloudSettings, _: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    Ok(Arc::new(RayCloud { origin: settings.origin }))
}

impl PointEncoder for RayCloud {
    fn typical_bytes(&self) -> usize {
        VERTEX_BYTES
    }

    fn encode(&self, batch: &PointBatch, out: &mut EncodedPoints) {
        out.extend(batch.points, |out, point| {
            let (is_miss, origin) = (point.is_miss(), point.origin);
            let end = if is_miss { origin + point.direction * MISS_M } else { point.position };
            let position = end + self.origin;
            position.to_array().into_iter().for_each(|c| out.extend(c.to_le_bytes()));
            out.extend(point.seconds().to_le_bytes());
            (origin - end).to_array().into_iter().for_each(|c| out.extend((c as f32).to_le_bytes()));
            let grey = (point.digital_intensity() >> 8) as u8;
            out.extend([grey, grey, grey, if is_miss { 0 } else { 255 }]);
            Some(position)
        });
    }

    fn patched(&self) -> Patched {
        Patched::Always
    }

    fn begin(self: Arc<Self>, out: &mut OutputStream) -> Result<Box<dyn FileBody>> {
        Counted::begin(|tally, state| head(tally.records, state), out)
    }
}

/// Returns the header of a file with `count` vertices. A padded comment makes its length independent of the
/// count.
fn head(count: u64, state: &str) -> Vec<u8> {
    let count = count.to_string();
    let padding = " ".repeat(20 - count.len());
    let mut head = format!(
        "ply\nformat binary_little_endian 1.0\ncomment {SOFTWARE}\ncomment state {state:40}\n\
         comment .{padding}\n\
         element vertex {count}\n"
    );
    let properties = [("double", ["x", "y", "z", "time"].as_slice()), ("float", &["nx", "ny", "nz"])];
    let colours = [("uchar", ["red", "green", "blue", "alpha"].as_slice())];
    for (kind, names) in properties.iter().chain(&colours) {
        names.iter().for_each(|name| head.push_str(&format!("property {kind} {name}\n")));
    }
    head.push_str("end_header\n");
    head.into_bytes()
}
