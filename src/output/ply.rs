//! PLY: a header that counts the vertices, then one record per echo, binary (little-endian) or text.

use super::codec::{LegFacts, PointCodec, byte, incidence_degrees, seconds};
use super::ground::{Ground, height_above};
use super::number::{push_fixed, push_integer};
use super::objects::ObjectIds;
use super::request::PointFormat;
use std::sync::Arc;
use vlscan_geom::{DVec3, degrees};
use vlscan_lidar::pulse::Echo;

/// Types and names of the properties. Metres, nanoseconds (echo width), seconds of the GPS week, degrees. CloudCompare keeps
/// what its names call scalar; the rest of a name is that of the column in other formats.
const PROPERTIES: [(&str, &str); 16] = [
    ("double", "x"),
    ("double", "y"),
    ("double", "z"),
    ("float", "intensity"),
    ("float", "scalar_EchoWidth"),
    ("uchar", "scalar_ReturnNumber"),
    ("uchar", "scalar_NumberOfReturns"),
    ("int", "scalar_Classification"),
    ("double", "scalar_GpsTime"),
    ("float", "scalar_ScanAngle"),
    ("float", "scalar_Range"),
    ("float", "scalar_IncidenceAngle"),
    ("int", "scalar_ObjectId"),
    ("ushort", "scalar_Device"),
    ("ushort", "scalar_Leg"),
    ("uint", "scalar_PulseNumber"),
];

const LABELS: [(&str, &str); 3] =
    [("uint", "scalar_Part"), ("uint", "scalar_Primitive"), ("float", "scalar_TrueRange")];

const DIRECTIONS: [(&str, &str); 3] = [
    ("float", "scalar_BeamDirectionX"),
    ("float", "scalar_BeamDirectionY"),
    ("float", "scalar_BeamDirectionZ"),
];

const HEIGHTS: [(&str, &str); 1] = [("float", "scalar_HeightAboveGround")];

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PlyGroups {
    /// Part, primitive, true range: labels for machine learning.
    pub labels: bool,
    /// The beam's direction, which missed pulses have instead of a position.
    pub directions: bool,
    /// Height above the ground.
    pub heights: bool,
}

impl PlyGroups {
    fn properties(self) -> impl Iterator<Item = &'static (&'static str, &'static str)> {
        let labels = if self.labels { &LABELS[..] } else { &[] };
        let directions = if self.directions { &DIRECTIONS[..] } else { &[] };
        let heights = if self.heights { &HEIGHTS[..] } else { &[] };
        labels.iter().chain(directions).chain(heights)
    }
}

/// Returns the header of a file with `count` vertices. A padded comment makes its length independent of the count.
pub(super) fn head(
    format: PointFormat,
    crs: Option<&str>,
    objects: &ObjectIds,
    groups: PlyGroups,
    count: u64,
    state: &str,
) -> Vec<u8> {
    let encoding = if format == PointFormat::PlyAscii { "ascii" } else { "binary_little_endian" };
    let mut head = format!("ply\nformat {encoding} 1.0\ncomment vlscan {}\n", env!("CARGO_PKG_VERSION"));
    if let Some(crs) = crs {
        head.push_str(&format!("comment crs {}\n", comment(crs)));
    }
    for (number, name) in &objects.names {
        head.push_str(&format!("comment object {number} {}\n", comment(name)));
    }
    head.push_str(&format!("comment state {state:40}\n"));
    let count = count.to_string();
    let padding = " ".repeat(20 - count.len());
    head.push_str(&format!("comment .{padding}\nelement vertex {count}\n"));
    for (kind, name) in PROPERTIES.iter().chain(groups.properties()) {
        head.push_str(&format!("property {kind} {name}\n"));
    }
    head.push_str("end_header\n");
    head.into_bytes()
}

/// Returns a text without line breaks, cut to 200 characters: some readers limit the length of a line.
fn comment(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(200).collect()
}

/// Encoder of echoes as vertices; as text if `ASCII`, with four decimals, nine for times and directions.
pub(super) struct PlyCodec<'a, const ASCII: bool> {
    pub shift: DVec3,
    pub objects: &'a ObjectIds,
    pub groups: PlyGroups,
    pub ground: Option<&'a Arc<dyn Ground>>,
}

impl<const ASCII: bool> PointCodec for PlyCodec<'_, ASCII> {
    const TYPICAL_BYTES: usize = if ASCII { 128 } else { 70 };

    fn push(&self, out: &mut Vec<u8>, leg: &LegFacts, echo: &Echo) -> Option<DVec3> {
        let position = echo.position + self.shift;
        let mut vertex = Vertex::<ASCII> { out };
        position.to_array().into_iter().for_each(|c| vertex.double::<4>(c));
        vertex.float::<4>(echo.intensity);
        vertex.float::<4>(echo.echo_width);
        vertex.integer(byte(echo.return_number), &[byte(echo.return_number)]);
        vertex.integer(byte(echo.number_of_returns), &[byte(echo.number_of_returns)]);
        vertex.integer(echo.classification, &echo.classification.to_le_bytes());
        vertex.double::<9>(seconds(echo.time_ns));
        let reals = [degrees(echo.scan_angle) as f32, echo.range as f32, incidence_degrees(echo)];
        reals.into_iter().for_each(|real| vertex.float::<4>(f64::from(real)));
        let object = self.objects.of_part(echo.part);
        vertex.integer(object, &object.to_le_bytes());
        for number in [u16::try_from(echo.device).unwrap_or(u16::MAX), leg.number] {
            vertex.integer(number, &number.to_le_bytes());
        }
        let pulse = echo.pulse_number as u32;
        vertex.integer(pulse, &pulse.to_le_bytes());
        if self.groups.labels {
            [echo.part, echo.primitive].iter().for_each(|i| vertex.integer(*i, &i.to_le_bytes()));
            vertex.float::<4>(echo.true_range);
        }
        if self.groups.directions {
            echo.direction.to_array().into_iter().for_each(|d| vertex.float::<9>(d));
        }
        if self.groups.heights {
            vertex.float::<3>(f64::from(height_above(self.ground, echo.position)));
        }
        vertex.end();
        Some(position)
    }
}

/// Writer of the properties of one vertex.
struct Vertex<'a, const ASCII: bool> {
    out: &'a mut Vec<u8>,
}

impl<const ASCII: bool> Vertex<'_, ASCII> {
    fn double<const DECIMALS: u32>(&mut self, value: f64) {
        if !ASCII {
            return self.out.extend(value.to_le_bytes());
        }
        push_fixed::<DECIMALS>(self.out, value);
        self.out.push(b' ');
    }

    /// Appends a number that the binary encoding stores in 32 bits.
    fn float<const DECIMALS: u32>(&mut self, value: f64) {
        if !ASCII {
            return self.out.extend((value as f32).to_le_bytes());
        }
        self.double::<DECIMALS>(value);
    }

    fn integer(&mut self, value: impl itoa::Integer, bytes: &[u8]) {
        if !ASCII {
            return self.out.extend_from_slice(bytes);
        }
        push_integer(self.out, value);
        self.out.push(b' ');
    }

    /// Replaces the last separator by a line feed.
    fn end(self) {
        if let (true, Some(last)) = (ASCII, self.out.last_mut()) {
            *last = b'\n';
        }
    }
}
