//! The rows of a table of points as the records that formats write.

use ::arrow_array::cast::AsArray;
use ::arrow_array::types::{
    Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type, UInt8Type, UInt16Type, UInt32Type,
    UInt64Type,
};
use ::arrow_array::{Array, RecordBatch};
use ::arrow_schema::DataType;
use vlscan_base::error::{Error, Result};
use vlscan_formats::{Cause, Column, MISSES_KEY, ObjectIds, PointRecord, StoredFields};
use vlscan_geom::{DVec3, Rotation, degrees, radians};

/// The values of a column.
#[derive(Clone, Copy)]
enum Values<'t> {
    U8(&'t [u8]),
    U16(&'t [u16]),
    U32(&'t [u32]),
    U64(&'t [u64]),
    I8(&'t [i8]),
    I16(&'t [i16]),
    I32(&'t [i32]),
    I64(&'t [i64]),
    F32(&'t [f32]),
    F64(&'t [f64]),
}

impl<'t> Values<'t> {
    fn of(array: &'t dyn Array) -> Option<Values<'t>> {
        if array.null_count() > 0 {
            return None;
        }
        Some(match array.data_type() {
            DataType::UInt8 => Values::U8(array.as_primitive::<UInt8Type>().values()),
            DataType::UInt16 => Values::U16(array.as_primitive::<UInt16Type>().values()),
            DataType::UInt32 => Values::U32(array.as_primitive::<UInt32Type>().values()),
            DataType::UInt64 => Values::U64(array.as_primitive::<UInt64Type>().values()),
            DataType::Int8 => Values::I8(array.as_primitive::<Int8Type>().values()),
            DataType::Int16 => Values::I16(array.as_primitive::<Int16Type>().values()),
            DataType::Int32 => Values::I32(array.as_primitive::<Int32Type>().values()),
            DataType::Int64 => Values::I64(array.as_primitive::<Int64Type>().values()),
            DataType::Float32 => Values::F32(array.as_primitive::<Float32Type>().values()),
            DataType::Float64 => Values::F64(array.as_primitive::<Float64Type>().values()),
            _ => return None,
        })
    }

    fn number(self, row: usize) -> f64 {
        match self {
            Values::U8(values) => values[row].into(),
            Values::U16(values) => values[row].into(),
            Values::U32(values) => values[row].into(),
            Values::U64(values) => values[row] as f64,
            Values::I8(values) => values[row].into(),
            Values::I16(values) => values[row].into(),
            Values::I32(values) => values[row].into(),
            Values::I64(values) => values[row] as f64,
            Values::F32(values) => values[row].into(),
            Values::F64(values) => values[row],
        }
    }

    fn whole(self, row: usize) -> i64 {
        match self {
            Values::U64(values) => i64::try_from(values[row]).unwrap_or(i64::MAX),
            Values::I64(values) => values[row],
            // Saturates; NaN is 0.
            other => other.number(row) as i64,
        }
    }
}

/// Origin of the positions of records.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum PositionFrame {
    /// From the origin of the world.
    World,
    /// From [`PointTable::origin`].
    Scene,
}

/// A table of points.
pub(super) struct PointTable<'t> {
    columns: Vec<Option<Values<'t>>>,
    rows: usize,
    objects: &'t ObjectIds,
    /// World position of the origin of the scene, m.
    origin: DVec3,
    /// True if times count from the start of their frame and not from the beginning of the week.
    has_frames: bool,
    frame: PositionFrame,
    /// True if return 0 of 0 marks a pulse without a return, as in tables of this program.
    has_misses: bool,
}

impl<'t> PointTable<'t> {
    /// The columns of `table`, and those of `exact`.
    ///
    /// # Errors
    /// [`Error::Input`] for columns that are not numeric, have empty values or unknown names.
    pub fn new(
        [table, exact]: [Option<&'t RecordBatch>; 2],
        objects: &'t ObjectIds,
        origin: DVec3,
        (frame, has_frames): (PositionFrame, bool),
    ) -> Result<PointTable<'t>> {
        let mut columns = vec![None; Column::ALL.len() + Column::EXACT.len()];
        for batch in [table, exact].into_iter().flatten() {
            for (field, array) in batch.schema_ref().fields().iter().zip(batch.columns()) {
                let mut known = Column::ALL.iter().chain(Column::EXACT);
                let Some(column) = known.find(|column| column.name() == field.name()) else { continue };
                let values = Values::of(&**array).ok_or_else(|| {
                    let kind = array.data_type();
                    Error::input(format!(
                        "the column {} is of {kind}, expected numbers without gaps",
                        field.name()
                    ))
                })?;
                columns[*column as usize] = Some(values);
            }
        }
        let rows = table.map_or(0, RecordBatch::num_rows);
        let is_marked = table.is_some_and(|table| table.schema_ref().metadata().contains_key(MISSES_KEY));
        let mut of_table = [Column::PulseNumber, Column::BeamDirectionX].into_iter();
        let has_misses = is_marked || of_table.any(|column| columns[column as usize].is_some());
        Ok(PointTable { columns, rows, objects, origin, has_frames, frame, has_misses })
    }

    /// The table, in which return 0 of 0 marks a pulse without a return if `has_misses` is set.
    pub fn with_misses(self, has_misses: bool) -> PointTable<'t> {
        PointTable { has_misses: self.has_misses || has_misses, ..self }
    }

    pub fn rows(&self) -> usize {
        self.rows
    }

    pub fn has(&self, column: Column) -> bool {
        self.columns[column as usize].is_some()
    }

    fn number(&self, column: Column, row: usize, default: f64) -> f64 {
        self.columns[column as usize].map_or(default, |values| values.number(row))
    }

    fn whole<T: TryFrom<i64>>(&self, column: Column, row: usize, default: T) -> T {
        self.columns[column as usize]
            .and_then(|values| T::try_from(values.whole(row)).ok())
            .unwrap_or(default)
    }

    fn vector(&self, columns: [Column; 3], row: usize, default: f64) -> DVec3 {
        DVec3::from(columns.map(|column| self.number(column, row, default)))
    }

    /// A position of the world in the frame of the records.
    fn placed(&self, world: DVec3) -> DVec3 {
        match self.frame {
            PositionFrame::World => world,
            PositionFrame::Scene => world - self.origin,
        }
    }

    /// Number of the leg of a row as records have it.
    pub fn leg(&self, row: usize) -> u16 {
        self.whole(Column::PointSourceId, row, 1_u16).saturating_sub(1)
    }

    /// The record of a row.
    pub fn record(&self, row: usize) -> PointRecord {
        use Column::{
            Amplitude, AttitudeW, AttitudeX, AttitudeY, AttitudeZ, BeamDirectionX, BeamDirectionY,
            BeamDirectionZ, BeamOriginX, BeamOriginY, BeamOriginZ, Blue, Classification, Device, Doppler,
            DopplerWidth, EchoWidth, ExactEchoWidth, ExactScanAngle, FootprintFraction, Green,
            HeightAboveGround, IncidenceAngle, NormalX, NormalY, NormalZ, NumberOfReturns, ObjectId, Part,
            Path, PathOrder, Primitive, PulseNumber, Range, Red, RestX, RestY, RestZ, ReturnNumber,
            ScanAngle, ScannerX, ScannerY, ScannerZ, Subray, SurfaceClass, SurfaceX, SurfaceY, SurfaceZ,
            TrueRange, TrueX, TrueY, TrueZ, X, Y, Z,
        };
        let world = self.vector([X, Y, Z], row, f64::NAN);
        let rest = match self.frame {
            PositionFrame::World => DVec3::ZERO,
            PositionFrame::Scene => self.vector([RestX, RestY, RestZ], row, 0.0),
        };
        let attitude = self.number(AttitudeW, row, f64::NAN);
        let (time_ns, time_origin) = self.time(row);
        let part = self.whole(Part, row, u32::MAX);
        let class = self.whole(Classification, row, 0);
        // In tables of other programs 0 of 0 means that a point has no return number.
        let least = u32::from(!self.has_misses);
        PointRecord {
            position: self.placed(world) + rest,
            origin: self.placed(self.vector([BeamOriginX, BeamOriginY, BeamOriginZ], row, f64::NAN)),
            direction: self.vector([BeamDirectionX, BeamDirectionY, BeamDirectionZ], row, 0.0),
            in_scanner: self.vector([ScannerX, ScannerY, ScannerZ], row, f64::NAN),
            scanner: (!attitude.is_nan()).then(|| Rotation {
                w: attitude,
                u: self.vector([AttitudeX, AttitudeY, AttitudeZ], row, 0.0),
            }),
            true_position: self.placed(self.vector([TrueX, TrueY, TrueZ], row, f64::NAN)),
            cause: Cause {
                surface: self.placed(self.vector([SurfaceX, SurfaceY, SurfaceZ], row, f64::NAN)),
                normal: self.vector([NormalX, NormalY, NormalZ], row, f64::NAN),
                fraction: self.number(FootprintFraction, row, f64::NAN),
                subray: self.whole(Subray, row, u32::MAX),
                path: self.whole(Path, row, 0),
                order: self.whole(PathOrder, row, 0),
                colour: [Red, Green, Blue].map(|column| (self.whole(column, row, 0_u16) >> 8) as u8),
                velocity: [Doppler, DopplerWidth].map(|column| self.number(column, row, f64::NAN)),
            },
            range: self.number(Range, row, 0.0),
            true_range: self.number(TrueRange, row, 0.0),
            amplitude: match self.has(Amplitude) {
                true => self.number(Amplitude, row, 0.0),
                false => self.amplitude_of_intensity(row),
            },
            echo_width: self.number(ExactEchoWidth, row, self.number(EchoWidth, row, 0.0)),
            incidence_cosine: cosine_of(self.number(IncidenceAngle, row, 0.0) as f32),
            scan_angle: match self.has(ExactScanAngle) {
                true => self.number(ExactScanAngle, row, 0.0),
                false => radians(self.number(ScanAngle, row, 0.0)),
            },
            time_ns,
            time_origin,
            pulse_number: self.whole(PulseNumber, row, 0),
            height: self.number(HeightAboveGround, row, f64::NAN) as f32,
            return_number: self.whole(ReturnNumber, row, 1),
            number_of_returns: self.whole(NumberOfReturns, row, 1).max(least),
            device: self.whole(Device, row, 0),
            part,
            primitive: self.whole(Primitive, row, u32::MAX),
            object: self.whole(ObjectId, row, self.objects.of_part(part)),
            class: self.whole(SurfaceClass, row, class),
            wave: u32::MAX,
            leg: self.leg(row),
            stored: StoredFields::default(),
        }
    }

    /// Time, ns, and the second that it counts from.
    fn time(&self, row: usize) -> (f64, f64) {
        let time = self.number(Column::GpsTime, row, 0.0);
        match (self.has_frames, self.has(Column::ExactTime)) {
            // Without a time after the origin the sum of both is the time of the table, bit for bit.
            (false, _) => (0.0, time),
            (true, false) => (time * 1e9, 0.0),
            (true, true) => {
                let exact_ns = self.number(Column::ExactTime, row, 0.0);
                (exact_ns, (time - exact_ns / 1e9).round())
            }
        }
    }

    /// An amplitude whose intensity equals the table's.
    fn amplitude_of_intensity(&self, row: usize) -> f64 {
        match self.number(Column::Intensity, row, 0.0) {
            intensity if intensity > 0.0 => libm::exp10((intensity - 10_000.0) / 1000.0),
            _ => 0.0,
        }
    }
}

/// A cosine whose angle has these very degrees.
fn cosine_of(angle: f32) -> f64 {
    let near = libm::cos(radians(f64::from(angle))).clamp(-1.0, 1.0);
    let is_it = |cosine: f64| degrees(libm::acos(cosine.clamp(-1.0, 1.0))) as f32 == angle;
    if is_it(near) {
        return near;
    }
    let (mut below, mut above) = (near, near);
    // Near 0 and 180 degrees neighbouring cosines are far from each other as angles.
    for _ in 0..64 {
        (below, above) = (below.next_down(), above.next_up());
        match (is_it(below), is_it(above)) {
            (true, _) => return below,
            (_, true) => return above,
            _ => {}
        }
    }
    near
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cosines_keep_the_angles_of_tables() {
        let mut cosine = 1.0_f64;
        for step in 0..100_000_u32 {
            // Dense at both ends.
            let angle = degrees(libm::acos(cosine)) as f32;
            assert_eq!(degrees(libm::acos(cosine_of(angle))) as f32, angle, "{cosine:e}");
            cosine = if step < 50_000 { cosine.next_down() } else { (cosine - 4e-5).max(-1.0) };
        }
    }
}
