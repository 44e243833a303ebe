//! Variable length records.

use crate::columnar::{Column, ColumnType, LightColumns};
use crate::las::{ExtraDimensions, LasSettings, LasVersion};
use crate::settings::SOFTWARE;
use las::raw::Vlr;
use las::raw::vlr::RecordLength;
use vlscan_base::diag::Diagnostics;
use vlscan_crs::{EpsgKind, epsg};

/// Data types of extra bytes, as numbered by LAS.
const U8: u8 = 1;
const U16: u8 = 3;
const U32: u8 = 5;
const I32: u8 = 6;
const F32: u8 = 9;
const F64: u8 = 10;

/// Data type, bytes, name and description of an extra dimension.
type Dimension = (u8, u16, &'static str, &'static str);

/// The extra dimensions, in order.
const DIMENSIONS: [Dimension; 7] = [
    (F64, 8, "echo_width", "width of the echo, ns"),
    (I32, 4, "fullwaveIndex", "pulse number, low 32 bits"),
    (I32, 4, "hitObjectId", "scene part that was hit"),
    (F64, 8, "heliosAmplitude", "waveform amplitude at the peak"),
    (U16, 2, "device", "index of the device, from 0"),
    (F32, 4, "range", "measured range, m"),
    (F32, 4, "incidence_angle", "angle to the normal, degrees"),
];

const LABELS: [Dimension; 3] = [
    (U32, 4, "part", "index of the part in the scene"),
    (U32, 4, "primitive", "index of triangle or voxel"),
    (F32, 4, "true_range", "range without noise or bins, m"),
];

const DIRECTIONS: [Dimension; 3] = [
    (F32, 4, "BeamDirectionX", "unit vector of the beam"),
    (F32, 4, "BeamDirectionY", "unit vector of the beam"),
    (F32, 4, "BeamDirectionZ", "unit vector of the beam"),
];

const TRUE_POSITIONS: [Dimension; 3] = [
    (F64, 8, "TrueX", "position without navigation errors"),
    (F64, 8, "TrueY", "position without navigation errors"),
    (F64, 8, "TrueZ", "position without navigation errors"),
];

const HEIGHTS: [Dimension; 1] = [(F32, 4, "HeightAboveGround", "height above the ground, m")];

const VELOCITIES: [Dimension; 2] =
    [(F32, 4, "Doppler", "radial velocity, m/s"), (F32, 4, "DopplerWidth", "spread of Doppler, m/s")];

/// Optional groups of extra dimensions.
#[derive(Clone, Copy, Debug, Default)]
pub struct Groups {
    /// Part, primitive and true range: labels for machine learning.
    pub labels: bool,
    /// The beam's direction, which missed pulses have instead of a position.
    pub directions: bool,
    /// Position computed with the true pose, without navigation errors.
    pub true_positions: bool,
    /// Height above the ground.
    pub heights: bool,
    /// Radial velocity.
    pub velocities: bool,
    /// Labels of the way of light that no other group has.
    pub light: LightColumns,
}

/// The dimension of a label of the way of light.
fn light_dimension(label: Column) -> Dimension {
    let data_type = match label.kind() {
        ColumnType::U8 => U8,
        ColumnType::U32 => U32,
        _ => F64,
    };
    let (name, description) = match label {
        Column::Path => (label.name(), "way of the light, 2: ghost"),
        Column::PathOrder => (label.name(), "mirrors and panes on the way"),
        // As with other labels.
        Column::Primitive => ("primitive", "index of triangle or voxel"),
        _ => (label.name(), "true position of the surface"),
    };
    (data_type, label.kind().width() as u16, name, description)
}

fn dimensions(extra: ExtraDimensions, groups: Groups) -> impl Iterator<Item = Dimension> {
    let base = match extra {
        ExtraDimensions::All => &DIMENSIONS[..],
        ExtraDimensions::Helios => &DIMENSIONS[..4],
        ExtraDimensions::None => &[],
    };
    let all = extra == ExtraDimensions::All;
    let of = |is_included: bool, group: &'static [_]| if all && is_included { group } else { &[] };
    let labels = of(groups.labels, &LABELS);
    let directions = of(groups.directions, &DIRECTIONS);
    let positions = of(groups.true_positions, &TRUE_POSITIONS);
    let heights = of(groups.heights, &HEIGHTS);
    let velocities = of(groups.velocities, &VELOCITIES);
    let light = if all { groups.light } else { LightColumns::default() };
    let groups = base.iter().chain(labels).chain(directions).chain(positions).chain(heights);
    groups.chain(velocities).copied().chain(light.iter().map(light_dimension))
}

/// Total extra bytes of a point.
pub(super) fn extra_length(extra: ExtraDimensions, groups: Groups) -> u16 {
    dimensions(extra, groups).map(|d| d.1).sum()
}

/// Returns the Extra Bytes record, 192 bytes for each dimension.
pub(super) fn extra_bytes(extra: ExtraDimensions, groups: Groups) -> Vec<u8> {
    let mut data = Vec::new();
    for (data_type, _, name, description) in dimensions(extra, groups) {
        // reserved, data type, options
        data.extend([0, 0, data_type, 0]);
        data.extend(fixed_text::<32>(name));
        // unused, no data, min, max, scale, offset
        data.extend([0; 4 + 5 * 24]);
        data.extend(fixed_text::<32>(description));
    }
    record("LASF_Spec", 4, "extra bytes", &data)
}

/// Returns the record of the coordinate reference system: WKT for LAS 1.4, GeoTIFF keys for LAS 1.0.
pub(super) fn crs(version: LasVersion, wkt: &str, problems: &mut Diagnostics) -> Option<Vec<u8>> {
    match version {
        LasVersion::V14 => {
            let mut data = wkt.trim_end_matches('\0').as_bytes().to_vec();
            data.push(0);
            if data.len() > usize::from(u16::MAX) {
                problems.error(
                    None,
                    "a coordinate reference system of more than 65 534 bytes does not fit into LAS",
                );
                return None;
            }
            Some(record("LASF_Projection", 2112, "OGC WKT", &data))
        }
        LasVersion::V10 => {
            let horizontal = epsg(wkt).filter(|(kind, _)| *kind != EpsgKind::Compound);
            let Some((kind, code)) = horizontal else {
                problems
                    .warn(
                        None,
                        "LAS 1.0 has room for an EPSG code only, and the coordinate reference system has \
                         none",
                    )
                    .help("write LAS 1.4 to keep it");
                return None;
            };
            // GeoTIFF: version 1.1.0, then key, location of the value (0: in place), count, value
            let (model, key) = match kind {
                EpsgKind::Geographic => (2, 2048),
                EpsgKind::Projected | EpsgKind::Compound => (1, 3072),
            };
            let keys: [u16; 16] = [1, 1, 0, 3, 1024, 0, 1, model, 1025, 0, 1, 1, key, 0, 1, code];
            let data: Vec<u8> = keys.iter().flat_map(|k| k.to_le_bytes()).collect();
            Some(record("LASF_Projection", 34735, "GeoTIFF keys", &data))
        }
    }
}

const PACKETS: &str = "Waveform packets: 16-bit samples, amplitude = digitizer offset + digitizer gain * \
     sample; samples behind the end of the waveform have the amplitude 0.\n\
     Parametric dx, dy, dz: point towards the scanner; sample i lies at point + (location - i * spacing) * \
     (dx, dy, dz).\n";

/// Returns the record of remarks: conventions of the dimensions.
pub(super) fn remarks(settings: &LasSettings) -> Vec<u8> {
    let packets = match settings.packets {
        None => "",
        Some(_) => PACKETS,
    };
    let text = format!(
        "Simulated with {SOFTWARE}.\nIntensity: 10000 + 1000 log10(amplitude), 0 where the amplitude is not \
         positive.\nPointSourceId: number of the leg plus one.\n\
         ScannerChannel: device modulo 4.\nScanAngle: of the beam from straight down across the track, \
         negative to the left; with physics of HELIOS++ the deflection on the scanner.\n\
         GpsTime: seconds of the GPS week or adjusted standard GPS time, as bit 0 of the global encoding \
         says.\n{packets}"
    );
    let mut data = text.into_bytes();
    data.push(0);
    record("LASF_Spec", 3, "remarks", &data)
}

/// Returns the record of fixed length that describes how the run ended.
pub(super) fn state(text: &str) -> Vec<u8> {
    record("vlscan", 2, "state of the run", &fixed_text::<40>(text))
}

/// Returns the names of objects whose id is not a number: lines of integer, tab, name, in as many records as
/// they need.
pub(super) fn object_names(names: &[(i32, String)]) -> Vec<Vec<u8>> {
    let mut records = Vec::new();
    let mut data = Vec::new();
    for (number, name) in names {
        let name: String = name.chars().map(|c| if c.is_control() { ' ' } else { c }).take(1000).collect();
        let line = format!("{number}\t{name}\n");
        if data.len() + line.len() > usize::from(u16::MAX) {
            records.push(record("vlscan", 1, "names of hitObjectId", &data));
            data.clear();
        }
        data.extend(line.into_bytes());
    }
    if !data.is_empty() {
        records.push(record("vlscan", 1, "names of hitObjectId", &data));
    }
    records
}

/// Returns the LASzip record.
pub(super) fn laszip(laszip: &::laz::LazVlr) -> Vec<u8> {
    let mut data = Vec::new();
    // Writing to a vector cannot fail.
    let _ = laszip.write_to(&mut data);
    record(::laz::LazVlr::USER_ID, ::laz::LazVlr::RECORD_ID, ::laz::LazVlr::DESCRIPTION, &data)
}

/// Returns a variable length record: header and data.
pub(super) fn record(user: &str, id: u16, description: &str, data: &[u8]) -> Vec<u8> {
    let mut user_id = [0; 16];
    // 16 characters without a NUL at the end are allowed.
    user_id.copy_from_slice(&fixed_text::<17>(user)[..16]);
    let record = Vlr {
        user_id,
        record_id: id,
        record_length_after_header: RecordLength::Vlr(data.len() as u16),
        description: fixed_text(description),
        data: data.to_vec(),
        ..Vlr::default()
    };
    let mut out = Vec::with_capacity(54 + data.len());
    // Writing to a vector cannot fail.
    let _ = record.write_to(&mut out);
    out
}

/// Returns a text of at most `N − 1` ASCII characters, padded with NUL.
pub(super) fn fixed_text<const N: usize>(text: &str) -> [u8; N] {
    let mut bytes = [0; N];
    for (byte, c) in bytes[..N - 1].iter_mut().zip(text.chars()) {
        *byte = if c.is_ascii() && !c.is_ascii_control() { c as u8 } else { b'?' };
    }
    bytes
}
