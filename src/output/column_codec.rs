//! Encoding of echoes as blocks of columns.

use super::codec::{LegFacts, byte, incidence_degrees, seconds};
use super::columns::Column;
use super::ground::{Ground, height_above};
use super::las::LasFormat;
use super::objects::ObjectIds;
use std::sync::Arc;
use vlscan_geom::{DVec3, degrees};
use vlscan_lidar::pulse::{Echo, EchoTruth};

pub(super) struct ColumnCodec<'a> {
    pub columns: &'a [Column],
    pub shift: DVec3,
    pub objects: &'a ObjectIds,
    pub las: &'a LasFormat,
    /// True causes of the echoes of the batch.
    pub truths: &'a [EchoTruth],
    pub ground: Option<&'a Arc<dyn Ground>>,
}

impl ColumnCodec<'_> {
    /// Bytes per row.
    pub fn width(&self) -> usize {
        self.columns.iter().map(|c| c.kind().width()).sum()
    }

    /// Appends all values of the first column, then all values of the second, and so on; little-endian.
    pub fn push(&self, out: &mut Vec<u8>, leg: &LegFacts, echoes: &[&Echo]) {
        out.reserve(self.width() * echoes.len());
        self.columns.iter().for_each(|&column| self.push_column(column, out, leg, echoes));
    }

    fn push_column(&self, column: Column, out: &mut Vec<u8>, leg: &LegFacts, echoes: &[&Echo]) {
        let (shift, truths) = (self.shift, self.truths);
        match column {
            Column::X => f64s(out, echoes, |e| e.position.x + shift.x),
            Column::Y => f64s(out, echoes, |e| e.position.y + shift.y),
            Column::Z => f64s(out, echoes, |e| e.position.z + shift.z),
            Column::Intensity => u16s(out, echoes, |e| self.las.digital_intensity(e.intensity)),
            Column::ReturnNumber => u8s(out, echoes, |e| byte(e.return_number)),
            Column::NumberOfReturns => u8s(out, echoes, |e| byte(e.number_of_returns)),
            Column::Classification => u8s(out, echoes, |e| u8::try_from(e.classification).unwrap_or(0)),
            Column::ScanAngle => f32s(out, echoes, |e| degrees(e.scan_angle) as f32),
            Column::PointSourceId => u16s(out, echoes, |_| leg.source_id),
            Column::GpsTime => f64s(out, echoes, |e| seconds(e.time_ns)),
            Column::Amplitude => f64s(out, echoes, |e| e.intensity),
            Column::EchoWidth => f32s(out, echoes, |e| e.echo_width as f32),
            Column::Range => f64s(out, echoes, |e| e.range),
            Column::TrueRange => f64s(out, echoes, |e| e.true_range),
            Column::IncidenceAngle => f32s(out, echoes, incidence_degrees),
            Column::PulseNumber => u64s(out, echoes, |e| e.pulse_number),
            Column::Device => u16s(out, echoes, |e| u16::try_from(e.device).unwrap_or(u16::MAX)),
            Column::ObjectId => i32s(out, echoes, |e| self.objects.of_part(e.part)),
            Column::Part => u32s(out, echoes, |e| e.part),
            Column::Primitive => u32s(out, echoes, |e| e.primitive),
            Column::SurfaceClass => i32s(out, echoes, |e| e.classification),
            Column::BeamOriginX => f64s(out, echoes, |e| e.origin.x + shift.x),
            Column::BeamOriginY => f64s(out, echoes, |e| e.origin.y + shift.y),
            Column::BeamOriginZ => f64s(out, echoes, |e| e.origin.z + shift.z),
            Column::BeamDirectionX => f64s(out, echoes, |e| e.direction.x),
            Column::BeamDirectionY => f64s(out, echoes, |e| e.direction.y),
            Column::BeamDirectionZ => f64s(out, echoes, |e| e.direction.z),
            Column::HeightAboveGround => f32s(out, echoes, |e| height_above(self.ground, e.position)),
            Column::TrueX => f64s(out, echoes, |e| e.true_position(truths).x + shift.x),
            Column::TrueY => f64s(out, echoes, |e| e.true_position(truths).y + shift.y),
            Column::TrueZ => f64s(out, echoes, |e| e.true_position(truths).z + shift.z),
            Column::SurfaceX => f64s(out, echoes, |e| e.truth(truths).surface.x + shift.x),
            Column::SurfaceY => f64s(out, echoes, |e| e.truth(truths).surface.y + shift.y),
            Column::SurfaceZ => f64s(out, echoes, |e| e.truth(truths).surface.z + shift.z),
            Column::NormalX => f32s(out, echoes, |e| e.truth(truths).normal.x as f32),
            Column::NormalY => f32s(out, echoes, |e| e.truth(truths).normal.y as f32),
            Column::NormalZ => f32s(out, echoes, |e| e.truth(truths).normal.z as f32),
            Column::FootprintFraction => f32s(out, echoes, |e| e.truth(truths).fraction as f32),
            Column::ScannerX => f64s(out, echoes, |e| e.position_in_scanner().x),
            Column::ScannerY => f64s(out, echoes, |e| e.position_in_scanner().y),
            Column::ScannerZ => f64s(out, echoes, |e| e.position_in_scanner().z),
            Column::Subray => u32s(out, echoes, |e| e.truth(truths).subray),
        }
    }
}

macro_rules! pushers {
    ($($name:ident $of:ty;)*) => {
        $(fn $name(out: &mut Vec<u8>, echoes: &[&Echo], value: impl Fn(&Echo) -> $of) {
            echoes.iter().for_each(|echo| out.extend(value(echo).to_le_bytes()));
        })*
    };
}

pushers! {
    u8s u8;
    u16s u16;
    u32s u32;
    u64s u64;
    i32s i32;
    f32s f32;
    f64s f64;
}
