//! Points that are read from a file, as a table.

use arrow_array::{
    Array, ArrayRef, Float32Array, Float64Array, Int32Array, Int64Array, RecordBatch, UInt8Array,
    UInt16Array, UInt32Array, UInt64Array,
};
use arrow_schema::{ArrowError, Field, Schema};
use std::collections::{BTreeMap, HashMap};
use std::ops::ControlFlow;
use std::sync::Arc;
use vlscan::Column;
use vlscan::formats::{
    Attribute, AttributeSet, CloudFormat, ColumnType, FileFacts, MISSES_KEY, OBJECT_NAMES, ObjectIds,
    PointRecord, PointRow, PointSink,
};

/// Column of PLY files of this program with the number of the leg, from 0.
const LEG_OF_PLY: &str = "scalar_Leg";

/// Collects the points of a file.
#[derive(Default)]
pub struct ReadPoints {
    attributes: AttributeSet,
    format: Option<CloudFormat>,
    metadata: BTreeMap<String, String>,
    position: [Vec<f64>; 3],
    intensity: Vec<f32>,
    return_number: Vec<u8>,
    number_of_returns: Vec<u8>,
    class: Vec<u8>,
    scan_angle: Vec<f32>,
    source: Vec<u16>,
    time: Vec<f64>,
    device: Vec<u16>,
    path: Vec<u8>,
    colour: Vec<[u16; 3]>,
    objects: Objects,
    /// Columns of the file by their names.
    named: Vec<Named>,
    has_misses: bool,
}

/// A column of the file that has the name of one of this program.
struct Named {
    column: Column,
    /// Added to the values of the file.
    shift: f64,
    values: Vec<f64>,
}

/// The objects of points.
#[derive(Default)]
struct Objects {
    /// True for a file with indices of parts instead of objects.
    are_parts: bool,
    /// Numbers of objects; in text, indices of `names`.
    numbers: Vec<i64>,
    names: Vec<String>,
    indices: HashMap<String, i64>,
}

/// True for columns that are attributes of points in all formats, or are made of them.
fn is_attribute(column: Column) -> bool {
    use Column::{
        Blue, Device, GpsTime, Green, NumberOfReturns, ObjectId, Red, ReturnNumber, ScanAngle, X, Y, Z,
    };
    let position = matches!(column, X | Y | Z);
    let others = matches!(column, ReturnNumber | NumberOfReturns | ScanAngle | GpsTime | Device | ObjectId);
    position || others || matches!(column, Red | Green | Blue)
}

impl PointSink for ReadPoints {
    fn start(&mut self, attributes: AttributeSet) {
        self.attributes = attributes;
    }

    fn file(&mut self, facts: &FileFacts) {
        self.format = Some(facts.format);
    }

    fn crs(&mut self, wkt: &str) {
        self.metadata.insert("crs".to_owned(), wkt.to_owned());
    }

    fn takes_columns(&self) -> bool {
        true
    }

    fn metadata(&mut self, key: &str, text: &str) {
        if matches!(key, "crs" | OBJECT_NAMES) {
            self.metadata.insert(key.to_owned(), text.to_owned());
        }
    }

    fn choose(&mut self, names: &[&str]) -> Vec<usize> {
        let known = |name: &str| match name {
            LEG_OF_PLY => Some((Column::PointSourceId, 1.0)),
            name => Some((Column::stored_as(name)?, 0.0)),
        };
        let found: Vec<(usize, Column, f64)> = names
            .iter()
            .copied()
            .enumerate()
            .filter_map(|(index, name)| known(name).map(|(column, shift)| (index, column, shift)))
            .collect();
        let has = |wanted: Column| found.iter().any(|(_, column, _)| *column == wanted);
        self.objects.are_parts = has(Column::Part) && !has(Column::ObjectId);
        // The intensity of a file without amplitudes is the attribute.
        let has_amplitude = has(Column::Amplitude);
        let mut chosen = Vec::new();
        for &(index, column, shift) in &found {
            let is_twice = self.named.iter().any(|named| named.column == column);
            if !is_twice && !is_attribute(column) && (has_amplitude || column != Column::Intensity) {
                chosen.push(index);
                self.named.push(Named { column, shift, values: Vec::new() });
            }
        }
        chosen
    }

    fn values(&mut self, values: &[f64]) {
        for (named, value) in self.named.iter_mut().zip(values) {
            // LAS has the low 32 bits of numbers of pulses as signed numbers.
            let is_signed = named.column == Column::PulseNumber && *value < 0.0;
            named.values.push(value + if is_signed { 2f64.powi(32) } else { named.shift });
        }
    }

    fn point(&mut self, row: &PointRow, object: Option<&str>) -> vlscan::Result<ControlFlow<()>> {
        self.has_misses |= row.is_miss;
        self.position.iter_mut().zip(row.position.to_array()).for_each(|(axis, value)| axis.push(value));
        let has = |attribute| self.attributes.has(attribute);
        if has(Attribute::Intensity) {
            self.intensity.push(row.intensity);
        }
        if has(Attribute::ReturnNumber) {
            self.return_number.push(row.return_number);
        }
        if has(Attribute::NumberOfReturns) {
            self.number_of_returns.push(row.number_of_returns);
        }
        if has(Attribute::Class) {
            self.class.push(row.class);
        }
        if has(Attribute::ScanAngle) {
            self.scan_angle.push(row.scan_angle as f32);
        }
        if has(Attribute::Leg) {
            let is_las = self.format == Some(CloudFormat::Las);
            self.source.push(if is_las { row.point_source } else { row.leg });
        }
        if has(Attribute::Time) {
            self.time.push(row.time);
        }
        if has(Attribute::Channel) {
            self.device.push(row.channel);
        }
        if has(Attribute::Path) {
            self.path.push(row.path);
        }
        if has(Attribute::Object) && !self.objects.are_parts {
            match self.format {
                Some(CloudFormat::Text) => self.objects.push_name(object.unwrap_or_default()),
                _ => self.objects.numbers.push(row.object),
            }
        }
        if self.attributes.has_colours() {
            self.colour.push(row.colour.unwrap_or_default());
        }
        Ok(ControlFlow::Continue(()))
    }
}

impl Objects {
    fn push_name(&mut self, name: &str) {
        let index = self.indices.get(name).copied().unwrap_or_else(|| {
            let next = self.names.len() as i64;
            self.indices.insert(name.to_owned(), next);
            // Text has no empty names.
            self.names.push(if name == "-" { String::new() } else { name.to_owned() });
            next
        });
        self.numbers.push(index);
    }

    /// The column of objects, and their names by number in JSON if the file has names.
    fn column(self) -> (ArrayRef, Option<String>) {
        let Objects { numbers, names, .. } = self;
        if !names.is_empty() {
            let ids = ObjectIds::new(&names);
            let numbers = numbers.iter().map(|index| ids.of_part(u32::try_from(*index).unwrap_or(u32::MAX)));
            let array: ArrayRef = Arc::new(Int32Array::from_iter_values(numbers));
            return (array, ids.names_as_json());
        }
        let short: Option<Vec<i32>> = numbers.iter().map(|number| i32::try_from(*number).ok()).collect();
        match short {
            Some(short) => (Arc::new(Int32Array::from(short)), None),
            None => (Arc::new(Int64Array::from(numbers)), None),
        }
    }
}

/// Values as an array of the type of a column; `None` if a value does not fit.
fn typed(kind: ColumnType, values: &[f64]) -> Option<ArrayRef> {
    macro_rules! whole {
        ($array:ident, $of:ty) => {{
            let range = <$of>::MIN as f64..=<$of>::MAX as f64;
            let fits = values.iter().all(|value| range.contains(value) && value.fract() == 0.0);
            let array = || $array::from_iter_values(values.iter().map(|value| *value as $of));
            fits.then(|| Arc::new(array()) as ArrayRef)
        }};
    }
    match kind {
        ColumnType::U8 => whole!(UInt8Array, u8),
        ColumnType::U16 => whole!(UInt16Array, u16),
        ColumnType::U32 => whole!(UInt32Array, u32),
        ColumnType::U64 => whole!(UInt64Array, u64),
        ColumnType::I32 => whole!(Int32Array, i32),
        ColumnType::F32 => {
            Some(Arc::new(Float32Array::from_iter_values(values.iter().map(|value| *value as f32))))
        }
        ColumnType::F64 => Some(Arc::new(Float64Array::from(values.to_vec()))),
    }
}

impl ReadPoints {
    /// The points with the columns that the file has, in the order of a run's columns.
    pub fn table(mut self) -> Result<RecordBatch, ArrowError> {
        let count = self.position[0].len();
        let mut columns = self.intensities();
        self.add_colours(&mut columns);
        let (object, names) = std::mem::take(&mut self.objects).column();
        if let Some(names) = names {
            self.metadata.insert(OBJECT_NAMES.to_owned(), names);
        }
        let attributes: [(Column, ArrayRef); 12] = [
            (Column::X, Arc::new(Float64Array::from(std::mem::take(&mut self.position[0])))),
            (Column::Y, Arc::new(Float64Array::from(std::mem::take(&mut self.position[1])))),
            (Column::Z, Arc::new(Float64Array::from(std::mem::take(&mut self.position[2])))),
            (Column::ReturnNumber, Arc::new(UInt8Array::from(self.return_number))),
            (Column::NumberOfReturns, Arc::new(UInt8Array::from(self.number_of_returns))),
            (Column::Classification, Arc::new(UInt8Array::from(self.class))),
            (Column::ScanAngle, Arc::new(Float32Array::from(self.scan_angle))),
            (Column::PointSourceId, Arc::new(UInt16Array::from(self.source))),
            (Column::GpsTime, Arc::new(Float64Array::from(self.time))),
            (Column::Device, Arc::new(UInt16Array::from(self.device))),
            (Column::ObjectId, object),
            (Column::Path, Arc::new(UInt8Array::from(self.path))),
        ];
        columns.extend(attributes);
        columns.retain(|_, values| values.len() == count);
        for Named { column, values, .. } in self.named {
            // Of values that do not fit, those of the attribute remain.
            if let Some(array) = typed(column.kind(), &values) {
                columns.insert(column, array);
            } else {
                columns.entry(column).or_insert_with(|| Arc::new(Float64Array::from(values)));
            }
        }
        if self.has_misses {
            let text = "pulses without a return have 0 returns";
            self.metadata.insert(MISSES_KEY.to_owned(), text.to_owned());
        }
        columns.retain(|column, _| count > 0 || matches!(column, Column::X | Column::Y | Column::Z));
        let (fields, arrays): (Vec<Field>, Vec<ArrayRef>) =
            columns.into_iter().map(|(column, values)| (field(column, &values), values)).unzip();
        RecordBatch::try_new(Arc::new(Schema::new_with_metadata(fields, self.metadata)), arrays)
    }

    /// Intensities and amplitudes.
    fn intensities(&mut self) -> BTreeMap<Column, ArrayRef> {
        let intensity = std::mem::take(&mut self.intensity);
        let is_exact = |named: &&Named| {
            let mut pairs = named.values.iter().zip(&intensity);
            named.column == Column::Amplitude && pairs.all(|(exact, rounded)| *exact as f32 == *rounded)
        };
        let exact = self.named.iter().find(is_exact).map(|named| named.values.clone());
        let widened: Vec<f64> = intensity.iter().map(|value| f64::from(*value)).collect();
        // Whole numbers are those of sensors; amplitudes, as files of this program have them, are not.
        let are_amplitudes = exact.is_some() || intensity.iter().any(|value| value.fract() != 0.0);
        if !are_amplitudes {
            let short = typed(ColumnType::U16, &widened);
            return BTreeMap::from([(
                Column::Intensity,
                short.unwrap_or_else(|| Arc::new(Float32Array::from(intensity))),
            )]);
        }
        let amplitude = exact.unwrap_or(widened);
        let digital =
            amplitude.iter().map(|amplitude| PointRecord { amplitude: *amplitude, ..PointRecord::default() });
        let digital = UInt16Array::from_iter_values(digital.map(|point| point.digital_intensity()));
        BTreeMap::from([
            (Column::Intensity, Arc::new(digital) as ArrayRef),
            (Column::Amplitude, Arc::new(Float64Array::from(amplitude)) as ArrayRef),
        ])
    }

    /// Adds columns of colours: of 16 bits, as those of a run.
    fn add_colours(&mut self, columns: &mut BTreeMap<Column, ArrayRef>) {
        let colour = std::mem::take(&mut self.colour);
        let are_bytes = colour.iter().flatten().all(|component| *component <= 255);
        let factor = if are_bytes && self.format != Some(CloudFormat::Las) { 256 } else { 1 };
        for (component, column) in [Column::Red, Column::Green, Column::Blue].into_iter().enumerate() {
            let values = colour.iter().map(|colour| colour[component] * factor);
            columns.insert(column, Arc::new(UInt16Array::from_iter_values(values)));
        }
    }
}

/// The field of a column with its unit and meaning.
fn field(column: Column, values: &ArrayRef) -> Field {
    let about = [("unit", column.unit()), ("description", column.meaning())];
    let about = about.into_iter().filter(|(_, text)| !text.is_empty());
    let about: BTreeMap<String, String> =
        about.map(|(key, text)| (key.to_owned(), text.to_owned())).collect();
    Field::new(column.name(), values.data_type().clone(), false).with_metadata(about)
}
