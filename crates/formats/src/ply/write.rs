//! PLY: a header that counts the vertices, then one record per point, binary (little-endian) or text.

use crate::columnar::{Column, ColumnType, LightColumns};
use crate::encode::{Counted, FileBody, PointEncoder};
use crate::number::{push_fixed, push_integer};
use crate::out::OutputStream;
use crate::record::{EncodedPoints, PointBatch, PointRecord};
use crate::settings::{CloudSettings, SOFTWARE};
use std::slice;
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;
use vlscan_base::files::Patched;
use vlscan_crs as crs;
use vlscan_geom::{DVec3, degrees};

/// Types and names of the properties. Metres, nanoseconds (echo width), seconds of the GPS week, degrees.
/// CloudCompare keeps properties whose names begin with scalar; the rest of a name is the name of the column
/// in other formats.
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

const COLOURS: [(&str, &str); 3] = [("uchar", "red"), ("uchar", "green"), ("uchar", "blue")];
const HEIGHTS: [(&str, &str); 1] = [("float", "scalar_HeightAboveGround")];

/// Encoder of points as vertices; as text if `ASCII`, with four decimals, nine for times and directions.
#[derive(Debug)]
struct Ply<const ASCII: bool> {
    /// World position of the origin of points, m.
    origin: DVec3,
    /// Part, primitive, true range: labels for machine learning.
    labels: bool,
    /// The beam's direction, which missed pulses have instead of a position.
    directions: bool,
    /// Height above the ground.
    heights: bool,
    /// Red, green and blue of the surface.
    colours: bool,
    /// Labels of the way of light.
    light: LightColumns,
    /// The header before the state and the count.
    head: String,
}

/// PLY, little-endian.
pub(crate) fn binary(settings: &CloudSettings, _: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    Ok(Arc::new(Ply::<false>::new(settings)))
}

/// PLY as text.
pub(crate) fn ascii(settings: &CloudSettings, _: &mut Diagnostics) -> Result<Arc<dyn PointEncoder>> {
    Ok(Arc::new(Ply::<true>::new(settings)))
}

impl<const ASCII: bool> Ply<ASCII> {
    fn new(settings: &CloudSettings) -> Ply<ASCII> {
        let encoding = if ASCII { "ascii" } else { "binary_little_endian" };
        let mut head = format!("ply\nformat {encoding} 1.0\ncomment {SOFTWARE}\n");
        if let Some(wkt) = &settings.crs {
            head.push_str(&format!("comment crs {}\n", comment(&crs::short_name(wkt))));
        }
        for (number, name) in &settings.objects.names {
            head.push_str(&format!("comment object {number} {}\n", comment(name)));
        }
        let CloudSettings { origin, labels, misses, heights, .. } = *settings;
        let light = LightColumns::of(settings.columns.as_deref()).without_primitive_if(labels);
        Ply { origin, labels, directions: misses, heights, colours: settings.has_colours(), light, head }
    }

    /// Returns the header of a file with `count` vertices. A padded comment makes its length independent of
    /// the count.
    fn head(&self, count: u64, state: &str) -> Vec<u8> {
        let count = count.to_string();
        let padding = " ".repeat(20 - count.len());
        let mut head =
            format!("{}comment state {state:40}\ncomment .{padding}\nelement vertex {count}\n", self.head);
        let labels = if self.labels { &LABELS[..] } else { &[] };
        let directions = if self.directions { &DIRECTIONS[..] } else { &[] };
        let heights = if self.heights { &HEIGHTS[..] } else { &[] };
        let colours = if self.colours { &COLOURS[..] } else { &[] };
        for (kind, name) in PROPERTIES.iter().chain(labels).chain(directions).chain(heights).chain(colours) {
            head.push_str(&format!("property {kind} {name}\n"));
        }
        for label in self.light.iter() {
            let kind = match label.kind() {
                ColumnType::U8 => "uchar",
                ColumnType::U32 => "uint",
                _ => "double",
            };
            head.push_str(&format!("property {kind} scalar_{}\n", label.name()));
        }
        head.push_str("end_header\n");
        head.into_bytes()
    }

    fn push(&self, out: &mut Vec<u8>, point: &PointRecord) -> DVec3 {
        let position = point.position + self.origin;
        let mut vertex = Vertex::<ASCII> { out };
        position.to_array().into_iter().for_each(|c| vertex.double::<4>(c));
        vertex.float::<4>(point.amplitude);
        vertex.float::<4>(point.echo_width);
        point.returns().into_iter().for_each(|count| vertex.integer(count, &[count]));
        vertex.integer(point.class, &point.class.to_le_bytes());
        vertex.double::<9>(point.seconds());
        let reals = [degrees(point.scan_angle) as f32, point.range as f32, point.incidence_degrees()];
        reals.into_iter().for_each(|real| vertex.float::<4>(f64::from(real)));
        vertex.integer(point.object, &point.object.to_le_bytes());
        for number in [point.device_u16(), point.leg] {
            vertex.integer(number, &number.to_le_bytes());
        }
        let pulse = point.pulse_number as u32;
        vertex.integer(pulse, &pulse.to_le_bytes());
        if self.labels {
            [point.part, point.primitive].iter().for_each(|i| vertex.integer(*i, &i.to_le_bytes()));
            vertex.float::<4>(point.true_range);
        }
        if self.directions {
            point.direction.to_array().into_iter().for_each(|d| vertex.float::<9>(d));
        }
        if self.heights {
            vertex.float::<3>(f64::from(point.height));
        }
        if self.colours {
            point.cause.colour.iter().for_each(|component| vertex.integer(*component, &[*component]));
        }
        self.light.iter().for_each(|label| vertex.column(label, point, self.origin));
        vertex.end();
        position
    }
}

impl<const ASCII: bool> PointEncoder for Ply<ASCII> {
    fn typical_bytes(&self) -> usize {
        if ASCII { 128 } else { 70 }
    }

    fn encode(&self, batch: &PointBatch, out: &mut EncodedPoints) {
        out.extend(batch.points, |bytes, point| Some(self.push(bytes, point)));
    }

    fn patched(&self) -> Patched {
        Patched::Always
    }

    fn begin(self: Arc<Self>, out: &mut OutputStream) -> Result<Box<dyn FileBody>> {
        Counted::begin(move |tally, state| self.head(tally.records, state), out)
    }
}

/// Returns a text without line breaks, cut to 200 characters: some readers limit the length of a line.
fn comment(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(200).collect()
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

    fn column(&mut self, column: Column, point: &PointRecord, origin: DVec3) {
        if !ASCII {
            return column.push_bytes(self.out, slice::from_ref(point), origin);
        }
        column.push_text(self.out, point, origin);
        self.out.push(b' ');
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
