//! Point clouds of files as tables.

use crate::errors::{Notices, exception};
use crate::table::{Table, wrong};
use arrow_array::{Array, ArrayRef, Float32Array, Float64Array, RecordBatch, UInt8Array, UInt16Array};
use arrow_schema::{Field, Schema};
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use vlscan::formats::{Attribute, AttributeSet, PointRecord, PointRow, PointSink};
use vlscan::{Column, Diagnostics, Notice};

/// Collects the points of a file.
#[derive(Default)]
struct Columns {
    attributes: AttributeSet,
    crs: Option<String>,
    position: [Vec<f64>; 3],
    intensity: Vec<f32>,
    return_number: Vec<u8>,
    number_of_returns: Vec<u8>,
    class: Vec<u8>,
    scan_angle: Vec<f32>,
    source: Vec<u16>,
    time: Vec<f64>,
    device: Vec<u16>,
}

impl PointSink for Columns {
    fn start(&mut self, attributes: AttributeSet) {
        self.attributes = attributes;
    }

    fn crs(&mut self, wkt: &str) {
        self.crs = Some(wkt.to_owned());
    }

    fn point(&mut self, row: &PointRow, _: Option<&str>) -> ControlFlow<()> {
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
            self.source.push(row.leg);
        }
        if has(Attribute::Time) {
            self.time.push(row.time);
        }
        if has(Attribute::Channel) {
            self.device.push(row.channel);
        }
        ControlFlow::Continue(())
    }
}

impl Columns {
    fn table(self) -> Result<RecordBatch, arrow_schema::ArrowError> {
        let [x, y, z] = self.position;
        let count = x.len();
        // Whole numbers are those of sensors; amplitudes, as files of this program have them, are not.
        let are_amplitudes = self.intensity.iter().any(|value| value.fract() != 0.0);
        let amplitude: Vec<f64> = self.intensity.iter().map(|value| f64::from(*value)).collect();
        let digital =
            amplitude.iter().map(|amplitude| PointRecord { amplitude: *amplitude, ..PointRecord::default() });
        let intensity: ArrayRef = match are_amplitudes {
            true => Arc::new(UInt16Array::from_iter_values(digital.map(|point| point.digital_intensity()))),
            false => Arc::new(Float32Array::from(self.intensity)),
        };
        let amplitude = if are_amplitudes { amplitude } else { Vec::new() };
        let columns: Vec<(Column, ArrayRef)> = vec![
            (Column::X, Arc::new(Float64Array::from(x))),
            (Column::Y, Arc::new(Float64Array::from(y))),
            (Column::Z, Arc::new(Float64Array::from(z))),
            (Column::Intensity, intensity),
            (Column::ReturnNumber, Arc::new(UInt8Array::from(self.return_number))),
            (Column::NumberOfReturns, Arc::new(UInt8Array::from(self.number_of_returns))),
            (Column::Classification, Arc::new(UInt8Array::from(self.class))),
            (Column::ScanAngle, Arc::new(Float32Array::from(self.scan_angle))),
            (Column::PointSourceId, Arc::new(UInt16Array::from(self.source))),
            (Column::GpsTime, Arc::new(Float64Array::from(self.time))),
            (Column::Amplitude, Arc::new(Float64Array::from(amplitude))),
            (Column::Device, Arc::new(UInt16Array::from(self.device))),
        ];
        let is_there = |column: Column, values: &ArrayRef| {
            let is_position = matches!(column, Column::X | Column::Y | Column::Z);
            is_position || (count > 0 && values.len() == count)
        };
        let mut fields = Vec::new();
        let mut arrays = Vec::new();
        for (column, values) in columns.into_iter().filter(|(column, values)| is_there(*column, values)) {
            let about = [("unit", column.unit()), ("description", column.meaning())];
            let about = about.into_iter().filter(|(_, text)| !text.is_empty());
            let about: BTreeMap<String, String> =
                about.map(|(key, text)| (key.to_owned(), text.to_owned())).collect();
            let field = Field::new(column.name(), values.data_type().clone(), false);
            fields.push(field.with_metadata(about));
            arrays.push(values);
        }
        let metadata: BTreeMap<String, String> =
            self.crs.map(|wkt| ("crs".to_owned(), wkt)).into_iter().collect();
        RecordBatch::try_new(Arc::new(Schema::new_with_metadata(fields, metadata)), arrays)
    }
}

/// The points of a file in any format that is read, with the attributes that it has.
#[pyfunction]
pub fn read_points(py: Python<'_>, path: PathBuf) -> PyResult<Table> {
    let notices = Notices::default();
    let read = py.detach(|| {
        let (mut columns, mut found) = (Columns::default(), Diagnostics::default());
        vlscan::formats::read_points(&path, &mut columns, &mut found)?;
        notices.add(Notice::Warnings(found.finish(false)?));
        Ok(columns)
    });
    notices.issue(py)?;
    let columns = read.map_err(|error| exception(py, error))?;
    columns.table().map(Table::new).map_err(wrong)
}
