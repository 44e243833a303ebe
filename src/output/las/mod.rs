//! LAS 1.4 with point data record format 6, or 9 with waveform packets, and LAS 1.0 with format 1 (spec outputs §4).
//!
//! | file | contents |
//! |---|---|
//! | `format` | version, scale, offset and extra bytes of all files of a run |
//! | `header`, `vlr` | the public header block; variable length records |
//! | `record` | point data records |
//! | `packets`, `encode` | waveform packets; points that refer to them |
//!
//! Conventions of the dimensions:
//! * coordinates: rounded to the scale, relative to an offset of integral metres near the scene's centre;
//! * `PointSourceId`: number of the leg plus one, because 0 means "unknown";
//! * `ScannerChannel` (format 6): device modulo 4; the extra dimension `device` holds the index itself;
//! * `ScanAngle`: deflection of the beam relative to the scanner, in 0.006° (format 6) or whole degrees (format 1);
//! * `Intensity`: see [`IntensityMapping`](super::request::IntensityMapping);
//! * `Classification`: 0 where the material's class exceeds 255 (31 in format 1) or is negative;
//! * return numbers above 15 (format 1: 7) are stored as 15 (7), and counted as such in the header.

mod encode;
mod format;
mod header;
mod packets;
mod record;
mod vlr;

pub(super) use encode::{encode_with_packets, place_packets};
pub(super) use format::LasFormat;
pub(super) use packets::{PACKETS_HEADER_BYTES, packets_header};
pub(super) use record::LasCodec;
