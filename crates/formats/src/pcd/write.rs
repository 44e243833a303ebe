//! PCD 0.7 of the Point Cloud Library, binary. Coordinates are 32-bit floats there, so that points far from
//! the origin are written relative to a whole thousand metres, which a comment of the header names.

use crate::columnar::{Column, ColumnType, LightColumns};
use crate::encode::{Counted, FileBody, PointEncoder};
use crate::out::OutputStream;
use crate::record::{EncodedPoints, PointBatch, Tally};
use crate::settings::{CloudSettings, Rings, SOFTWARE};
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;
use vlscan_base::files::Patched;
use vlscan_geom::{Aabb, DVec3};

/// Bytes of a point.
const POINT_BYTES: usize = 32;

/// Distance from the origin up to which 32-bit floats resolve a millimetre, m.
const MAX_EXACT_M: f64 = 8192.0;

/// Names, bytes and kinds of the fields: metres, seconds of the GPS week.
const FIELDS: [(&str, u8, char); 9] = [
    ("x", 4, 'F'),
    ("y", 4, 'F'),
    ("z", 4, 'F'),
    ("intensity", 4, 'F'),
    ("time", 8, 'F'),
    ("ring", 2, 'U'),
    ("return_number", 1, 'U'),
    ("number_of_returns", 1, 'U'),
    ("label", 4, 'I'),
];
/// Red, green and blue in the bits of a number, blue in the lowest eight.
const COLOUR: (&str, u8, char) = ("rgb", 4, 'U');
/// Radial velocity, m/s, positive away from the sensor.
const VELOCITY: (&str, u8, char) = ("doppler", 4, 'F');

/// Fields that only some files have.
#[derive(Clone, Copy, Debug, Default)]
struct Optional {
    /// The colour of the surface.
    colours: bool,
    /// The radial velocity.
    velocities: bool,
    /// Labels of the way of light; positions are in the world.
    light: LightColumns,
}

/// The field of a label of the way of light.
fn label_field(label: Column) -> (&'static str, u8, char) {
    let kind = label.kind();
    let letter = if kind == ColumnType::F64 { 'F' } else { 'U' };
    (LightColumns::small_name(label), kind.width() as u8, letter)
}

/// The point that coordinates are relative to, for a scene with this box in the world.
fn offset(world: &Aabb) -> DVec3 {
    let reach = if world.is_empty() { 0.0 } else { world.min.abs().max(world.max.abs()).max_element() };
    if reach <= MAX_EXACT_M || !reach.is_finite() {
        return DVec3::ZERO;
    }
    // Adding 0 makes 0 of -0.
    DVec3::from(world.centre().to_array().map(|c| (c / 1000.0).round() * 1000.0 + 0.0))
}

/// Space in the header for the position of a static scanner, bytes.
const VIEWPOINT_BYTES: usize = 3 * 24;

/// Largest distance between beams of a scanner at rest, m: lasers lie next to each other in its head.
const MAX_HEAD_M: f64 = 1.0;

/// The position of a static scanner, from the box around the origins of its beams.
fn viewpoint(origins: &Aabb) -> Option<DVec3> {
    let size = origins.size();
    let stands = !origins.is_empty() && size.max_element() <= MAX_HEAD_M;
    // The micrometre.
    stands.then(|| DVec3::from(origins.centre().to_array().map(|c| (c * 1e6).round() / 1e6 + 0.0)))
}

/// Returns the header of a file with `count` points, whose length does not depend on the count. `viewpoint`
/// is the position of the scanner; `Some(None)` means that the scanner moves after all, and `None` reserves
/// no space for a position.
fn head(
    offset: DVec3,
    count: u64,
    state: &str,
    viewpoint: Option<Option<DVec3>>,
    optional: Optional,
) -> Vec<u8> {
    let more = [optional.colours.then_some(COLOUR), optional.velocities.then_some(VELOCITY)];
    let more = more.into_iter().flatten().chain(optional.light.iter().map(label_field));
    let fields: Vec<(&str, u8, char)> = FIELDS.into_iter().chain(more).collect();
    let list =
        |text: &dyn Fn(&(&str, u8, char)) -> String| fields.iter().map(text).collect::<Vec<_>>().join(" ");
    let count = count.to_string();
    let DVec3 { x, y, z } = viewpoint.flatten().unwrap_or(DVec3::ZERO);
    let place = format!("{x} {y} {z}");
    let room = if viewpoint.is_some() { VIEWPOINT_BYTES.saturating_sub(place.len()) } else { 0 };
    let padding = " ".repeat(2 * (20 - count.len()) + room);
    let DVec3 { x, y, z } = offset;
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\n# {SOFTWARE}; state {state:40}\n\
         # add {x} {y} {z} to x y z{padding}\n\
         VERSION 0.7\nFIELDS {}\nSIZE {}\nTYPE {}\nCOUNT {}\nWIDTH {count}\nHEIGHT 1\n\
         VIEWPOINT {place} 1 0 0 0\n\
         POINTS {count}\nDATA binary\n",
        list(&|f| f.0.to_owned()),
        list(&|f| f.1.to_string()),
        list(&|f| f.2.to_string()),
        list(&|_| "1".to_owned()),
    )
    .into_bytes()
}

/// Encoder of points. `ring` is the row of the channel by elevation, `label` the class.
#[derive(Debug)]
struct Pcd {
    /// Origin of the coordinates in the file, m, world.
    offset: DVec3,
    /// Origin of points in the frame of the file, m.
    origin: DVec3,
    /// World position of the origin of points, m.
    world: DVec3,
    rings: Rings,
    /// True if the scanner is static, so that files may have one viewpoint.
    stands: bool,
    optional: Optional,
}

/// PCD files.
pub(crate) fn pcd(settings: &CloudSettings, _: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    let offset = offset(&settings.world_bounds());
    let origin = settings.origin - offset;
    let (rings, stands) = (settings.rows(), settings.stands);
    let optional = Optional {
        colours: settings.has_colours(),
        velocities: settings.has_velocities(),
        light: LightColumns::of(settings.columns.as_deref()),
    };
    Ok(Arc::new(Pcd { offset, origin, world: settings.origin, rings, stands, optional }))
}

impl PointEncoder for Pcd {
    fn typical_bytes(&self) -> usize {
        POINT_BYTES
    }

    fn encode(&self, batch: &PointBatch, out: &mut EncodedPoints) {
        out.extend(batch.points, |out, point| {
            let position = point.position + self.origin;
            position.to_array().into_iter().for_each(|c| out.extend((c as f32).to_le_bytes()));
            out.extend((point.amplitude as f32).to_le_bytes());
            out.extend(point.seconds().to_le_bytes());
            out.extend(self.rings.of(point).to_le_bytes());
            out.extend(point.returns());
            out.extend(point.class.to_le_bytes());
            if self.optional.colours {
                let [red, green, blue] = point.cause.colour;
                out.extend([blue, green, red, 0]);
            }
            if self.optional.velocities {
                out.extend((point.cause.velocity[0] as f32).to_le_bytes());
            }
            self.optional.light.push_bytes(out, point, self.world);
            Some(position)
        });
    }

    fn patched(&self) -> Patched {
        Patched::Always
    }

    fn begin(self: Arc<Self>, out: &mut OutputStream) -> Result<Box<dyn FileBody>> {
        let header = move |tally: &Tally, state: &str| {
            let place = || viewpoint(&tally.origins).map(|place| place + self.origin);
            head(self.offset, tally.records, state, self.stands.then(place), self.optional)
        };
        Counted::begin(header, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_have_one_length_and_offsets_keep_millimetres() {
        let near = Aabb { min: DVec3::splat(-100.0), max: DVec3::splat(8000.0) };
        assert_eq!(offset(&near), DVec3::ZERO);
        let far = Aabb {
            min: DVec3::new(476_000.0, 5_429_400.0, 90.0),
            max: DVec3::new(477_500.0, 5_430_000.0, 200.0),
        };
        assert_eq!(offset(&far), DVec3::new(477_000.0, 5_430_000.0, 0.0));
        assert_eq!(offset(&Aabb::EMPTY), DVec3::ZERO);
        let west = Aabb { min: DVec3::splat(-9000.0), max: DVec3::splat(8900.0) };
        let text = String::from_utf8(head(offset(&west), 0, "complete", None, Optional::default())).unwrap();
        assert!(text.contains("# add 0 0 0 to x y z"), "{text}");
        let length = head(offset(&far), 0, "complete", None, Optional::default()).len();
        assert_eq!(head(offset(&far), u64::MAX, "partial", None, Optional::default()).len(), length);
        let sizes: usize = FIELDS.iter().map(|f| usize::from(f.1)).sum();
        assert_eq!(sizes, POINT_BYTES);
    }

    #[test]
    fn a_scanner_that_stands_is_the_viewpoint() {
        let at = |x: f64| DVec3::new(x, -2.5, 1.0e-9);
        let around = |a: DVec3, b: DVec3| Aabb::EMPTY.with(a).with(b);
        assert_eq!(viewpoint(&around(at(3.0), at(3.2))), Some(DVec3::new(3.1, -2.5, 0.0)));
        assert_eq!(viewpoint(&around(at(3.0), at(5.0))), None);
        assert_eq!(viewpoint(&around(DVec3::NEG_INFINITY, DVec3::INFINITY)), None);
        assert_eq!(viewpoint(&Aabb::EMPTY), None);
        let of =
            |place| String::from_utf8(head(DVec3::ZERO, 7, "complete", place, Optional::default())).unwrap();
        let (blank, found) = (of(Some(None)), of(Some(Some(DVec3::new(3.1, -1_234.567_891, 0.25)))));
        assert!(found.contains("\nVIEWPOINT 3.1 -1234.567891 0.25 1 0 0 0\n"), "{found}");
        assert!(blank.contains("\nVIEWPOINT 0 0 0 1 0 0 0\n") && blank.len() == found.len(), "{blank}");
        assert!(of(None).contains("\nVIEWPOINT 0 0 0 1 0 0 0\n"));
    }
}
