//! PLY: a header that counts the vertices, then one record per echo, binary (little-endian) or text.

use super::encode::PointCodec;
use super::las::ObjectIds;
use super::number::{push_fixed, push_integer};
use super::plan::LegFacts;
use super::request::PointFormat;
use super::text::seconds;
use crate::geom::{DVec3, degrees};
use crate::output::las::incidence_degrees;
use crate::pulse::Echo;

/// Type and name of the properties. Metres, nanoseconds (echo width), seconds of the GPS week, degrees.
const PROPERTIES: [(&str, &str); 16] = [
    ("double", "x"),
    ("double", "y"),
    ("double", "z"),
    ("float", "intensity"),
    ("float", "echo_width"),
    ("uchar", "return_number"),
    ("uchar", "number_of_returns"),
    ("int", "classification"),
    ("double", "gps_time"),
    ("float", "scan_angle"),
    ("float", "range"),
    ("float", "incidence_angle"),
    ("int", "object_id"),
    ("ushort", "device"),
    ("ushort", "leg"),
    ("uint", "pulse_number"),
];

/// Labels for learning.
const LABELS: [(&str, &str); 3] = [("uint", "part"), ("uint", "primitive"), ("float", "true_range")];

/// Where the beam went, of missed pulses above all.
const DIRECTIONS: [(&str, &str); 3] =
    [("float", "beam_direction_x"), ("float", "beam_direction_y"), ("float", "beam_direction_z")];

/// What vertices hold beyond the usual.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PlyMore {
    /// Part, primitive, true range.
    pub labels: bool,
    /// The beam's direction.
    pub directions: bool,
}

impl PlyMore {
    fn properties(self) -> impl Iterator<Item = &'static (&'static str, &'static str)> {
        let labels = if self.labels { &LABELS[..] } else { &[] };
        let directions = if self.directions { &DIRECTIONS[..] } else { &[] };
        labels.iter().chain(directions)
    }
}

/// The header of a file with `count` vertices. Its length does not depend on the count: a comment gives way.
pub(super) fn head(
    format: PointFormat,
    epsg: Option<u16>,
    objects: &ObjectIds,
    more: PlyMore,
    count: u64,
    state: &str,
) -> Vec<u8> {
    let encoding = if format == PointFormat::PlyAscii { "ascii" } else { "binary_little_endian" };
    let mut head = format!("ply\nformat {encoding} 1.0\ncomment vlscan {}\n", env!("CARGO_PKG_VERSION"));
    if let Some(code) = epsg {
        head.push_str(&format!("comment crs EPSG:{code}\n"));
    }
    for (number, name) in &objects.names {
        // Readers have short lines.
        let name: String = name.chars().map(|c| if c.is_control() { ' ' } else { c }).take(200).collect();
        head.push_str(&format!("comment object {number} {name}\n"));
    }
    head.push_str(&format!("comment state {state:40}\n"));
    let count = count.to_string();
    let padding = " ".repeat(20 - count.len());
    head.push_str(&format!("comment .{padding}\nelement vertex {count}\n"));
    for (kind, name) in PROPERTIES.iter().chain(more.properties()) {
        head.push_str(&format!("property {kind} {name}\n"));
    }
    head.push_str("end_header\n");
    head.into_bytes()
}

/// The fields of a vertex as they are stored.
struct Vertex {
    position: DVec3,
    /// Intensity and echo width.
    strength: [f32; 2],
    /// Return number and number of returns.
    returns: [u8; 2],
    classification: i32,
    gps_time: f64,
    /// Scan angle, range, incidence angle.
    geometry: [f32; 3],
    object: i32,
    /// Device and leg.
    source: [u16; 2],
    pulse: u32,
}

/// What both encodings need.
pub(super) struct PlyFields<'a> {
    pub shift: DVec3,
    pub objects: &'a ObjectIds,
    pub more: PlyMore,
}

impl PlyFields<'_> {
    fn vertex(&self, leg: &LegFacts, echo: &Echo) -> Vertex {
        let byte = |count: u32| u8::try_from(count).unwrap_or(u8::MAX);
        Vertex {
            position: echo.position + self.shift,
            strength: [echo.intensity as f32, echo.echo_width as f32],
            returns: [byte(echo.return_number), byte(echo.number_of_returns)],
            classification: echo.classification,
            gps_time: seconds(echo.time_ns),
            geometry: [degrees(echo.scan_angle) as f32, echo.range as f32, incidence_degrees(echo)],
            object: self.objects.ids.get(echo.part as usize).copied().unwrap_or(0),
            source: [u16::try_from(echo.device).unwrap_or(u16::MAX), leg.number],
            pulse: echo.pulse_number as u32,
        }
    }
}

/// The binary encoding.
pub(super) struct PlyBinaryCodec<'a>(pub PlyFields<'a>);

impl PointCodec for PlyBinaryCodec<'_> {
    const SIZE: usize = 70;

    fn push(&self, out: &mut Vec<u8>, leg: &LegFacts, echo: &Echo) -> Option<DVec3> {
        let v = self.0.vertex(leg, echo);
        v.position.to_array().iter().for_each(|c| out.extend(c.to_le_bytes()));
        v.strength.iter().for_each(|s| out.extend(s.to_le_bytes()));
        out.extend(v.returns);
        out.extend(v.classification.to_le_bytes());
        out.extend(v.gps_time.to_le_bytes());
        v.geometry.iter().for_each(|g| out.extend(g.to_le_bytes()));
        out.extend(v.object.to_le_bytes());
        v.source.iter().for_each(|s| out.extend(s.to_le_bytes()));
        out.extend(v.pulse.to_le_bytes());
        let PlyMore { labels, directions } = self.0.more;
        if labels {
            out.extend(echo.part.to_le_bytes());
            out.extend(echo.primitive.to_le_bytes());
            out.extend((echo.true_range as f32).to_le_bytes());
        }
        if directions {
            echo.direction.to_array().iter().for_each(|&d| out.extend((d as f32).to_le_bytes()));
        }
        Some(v.position)
    }
}

/// The text encoding: four decimals, nine for the time.
pub(super) struct PlyAsciiCodec<'a>(pub PlyFields<'a>);

impl PointCodec for PlyAsciiCodec<'_> {
    const SIZE: usize = 128;

    fn push(&self, out: &mut Vec<u8>, leg: &LegFacts, echo: &Echo) -> Option<DVec3> {
        let v = self.0.vertex(leg, echo);
        let decimals = |out: &mut Vec<u8>, value: f64| {
            push_fixed::<4>(out, value);
            out.push(b' ');
        };
        v.position.to_array().into_iter().for_each(|c| decimals(out, c));
        decimals(out, echo.intensity);
        decimals(out, echo.echo_width);
        for count in v.returns {
            push_integer(out, count);
            out.push(b' ');
        }
        push_integer(out, v.classification);
        out.push(b' ');
        push_fixed::<9>(out, v.gps_time);
        out.push(b' ');
        v.geometry.into_iter().for_each(|g| decimals(out, f64::from(g)));
        push_integer(out, v.object);
        for number in v.source {
            out.push(b' ');
            push_integer(out, number);
        }
        out.push(b' ');
        push_integer(out, v.pulse);
        let PlyMore { labels, directions } = self.0.more;
        if labels {
            for index in [echo.part, echo.primitive] {
                out.push(b' ');
                push_integer(out, index);
            }
            out.push(b' ');
            push_fixed::<4>(out, echo.true_range);
        }
        if directions {
            for d in echo.direction.to_array() {
                out.push(b' ');
                push_fixed::<9>(out, d);
            }
        }
        out.push(b'\n');
        Some(v.position)
    }
}
