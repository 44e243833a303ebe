//! Tables of a run: columns as NumPy arrays and by the Arrow C data interface, without copies.

use arrow_array::cast::AsArray;
use arrow_array::ffi::{FFI_ArrowArray, FFI_ArrowSchema, to_ffi};
use arrow_array::ffi_stream::{FFI_ArrowArrayStream, RecordBatchStreamReader};
use arrow_array::{
    Array, ArrayRef, Float64Array, RecordBatch, RecordBatchIterator, RecordBatchReader, StructArray,
};
use arrow_schema::{DataType, Field, Schema, SchemaRef};
use pyo3::exceptions::{PyKeyError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyCapsule, PyDict};
use std::sync::Arc;

/// Columns of numbers in memory.
#[pyclass(frozen, module = "vlscan")]
pub struct Table(pub RecordBatch);

/// A column of a table, which NumPy takes without a copy: `numpy.asarray(column)`.
#[pyclass(frozen, module = "vlscan")]
pub struct Column(ArrayRef);

#[pymethods]
impl Table {
    fn __len__(&self) -> usize {
        self.0.num_rows()
    }

    /// Names of the columns.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.0.schema().fields().iter().map(|field| field.name().clone()).collect()
    }

    /// Units of the columns by name; plain numbers have none.
    #[getter]
    fn units<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.metadata_of(py, "unit")
    }

    /// Meanings of the columns by name.
    #[getter]
    fn descriptions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.metadata_of(py, "description")
    }

    /// Metadata of the table: scanner, coordinate reference system, names of objects.
    #[getter]
    fn metadata<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let metadata = PyDict::new(py);
        self.0.schema().metadata().iter().try_for_each(|(key, value)| metadata.set_item(key, value))?;
        Ok(metadata)
    }

    /// A column by name.
    fn column(&self, name: &str) -> PyResult<Column> {
        match self.0.column_by_name(name) {
            Some(column) => Ok(Column(column.clone())),
            None => Err(PyKeyError::new_err(name.to_owned())),
        }
    }

    /// The values and the offsets of a column of lists.
    fn lists(&self, name: &str) -> PyResult<(Column, Column)> {
        let column = self.column(name)?.0;
        let list = column.as_list_opt::<i64>();
        let list = list.ok_or_else(|| PyTypeError::new_err(format!("{name} is not a column of lists")))?;
        let offsets = arrow_array::Int64Array::new(list.offsets().inner().clone(), None);
        Ok((Column(list.values().clone()), Column(Arc::new(offsets))))
    }

    /// Rows from `start` to `stop`, without a copy.
    fn slice(&self, start: usize, stop: usize) -> Table {
        let start = start.min(self.0.num_rows());
        let stop = stop.clamp(start, self.0.num_rows());
        Table(self.0.slice(start, stop - start))
    }

    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_array__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyCapsule>, Bound<'py, PyCapsule>)> {
        let _ = requested_schema;
        let whole: ArrayRef = Arc::new(StructArray::from(self.0.clone()));
        let (array, _) = to_ffi(&whole.to_data()).map_err(wrong)?;
        Ok((self.__arrow_c_schema__(py)?, PyCapsule::new_with_value(py, ArrayHolder(array), c"arrow_array")?))
    }

    fn __arrow_c_schema__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyCapsule>> {
        let schema = FFI_ArrowSchema::try_from(self.0.schema().as_ref()).map_err(wrong)?;
        PyCapsule::new_with_value(py, SchemaHolder(schema), c"arrow_schema")
    }

    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let _ = requested_schema;
        stream(py, self.0.schema(), vec![self.0.clone()])
    }
}

impl Table {
    fn metadata_of<'py>(&self, py: Python<'py>, key: &str) -> PyResult<Bound<'py, PyDict>> {
        let found = PyDict::new(py);
        for field in self.0.schema().fields() {
            if let Some(value) = field.metadata().get(key) {
                found.set_item(field.name(), value)?;
            }
        }
        Ok(found)
    }
}

// The structures of the C data interface are the first and only fields, so that a pointer to a holder is one to the structure.
#[repr(transparent)]
struct ArrayHolder(#[allow(dead_code, reason = "read by the consumer of the capsule")] FFI_ArrowArray);
#[repr(transparent)]
struct SchemaHolder(#[allow(dead_code, reason = "read by the consumer of the capsule")] FFI_ArrowSchema);
#[repr(transparent)]
struct StreamHolder(#[allow(dead_code, reason = "read by the consumer of the capsule")] FFI_ArrowArrayStream);

/// The batches as a stream of the C data interface.
fn stream<'py>(
    py: Python<'py>,
    schema: SchemaRef,
    batches: Vec<RecordBatch>,
) -> PyResult<Bound<'py, PyCapsule>> {
    let reader = RecordBatchIterator::new(batches.into_iter().map(Ok), schema);
    let stream = FFI_ArrowArrayStream::new(Box::new(reader));
    PyCapsule::new_with_value(py, StreamHolder(stream), c"arrow_array_stream")
}

#[pymethods]
impl Column {
    fn __len__(&self) -> usize {
        self.0.len()
    }

    /// The array interface of NumPy, version 3. The array that is made of it keeps the column.
    #[getter]
    fn __array_interface__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let kind = match self.0.data_type() {
            DataType::UInt8 => "|u1",
            DataType::UInt16 => "<u2",
            DataType::UInt32 => "<u4",
            DataType::UInt64 => "<u8",
            DataType::Int32 => "<i4",
            DataType::Int64 => "<i8",
            DataType::Float32 => "<f4",
            DataType::Float64 => "<f8",
            other => return Err(PyTypeError::new_err(format!("NumPy has no array of {other}"))),
        };
        let data = self.0.to_data();
        let width = self.0.data_type().primitive_width().unwrap_or(1);
        let address = data.buffers().first().map_or(0, |buffer| buffer.as_ptr() as usize);
        let interface = PyDict::new(py);
        interface.set_item("version", 3)?;
        interface.set_item("shape", (self.0.len(),))?;
        interface.set_item("typestr", kind)?;
        // Arrow arrays are immutable, and others may share them.
        interface.set_item("data", (address + data.offset() * width, true))?;
        Ok(interface)
    }
}

/// The record batches of an object: of anything with `__arrow_c_stream__`, or of a dictionary of columns as bytes of
/// doubles.
pub fn batches(object: &Bound<'_, PyAny>) -> PyResult<(SchemaRef, Vec<RecordBatch>)> {
    if let Ok(columns) = object.cast::<PyDict>() {
        let mut fields = Vec::new();
        let mut arrays: Vec<ArrayRef> = Vec::new();
        for (name, values) in columns {
            let values = values.cast_into::<PyBytes>()?;
            let (numbers, _) = values.as_bytes().as_chunks();
            let numbers =
                Float64Array::from_iter_values(numbers.iter().map(|number| f64::from_le_bytes(*number)));
            fields.push(Field::new(name.extract::<String>()?, DataType::Float64, false));
            arrays.push(Arc::new(numbers));
        }
        let schema = Arc::new(Schema::new(fields));
        let batch = RecordBatch::try_new(schema.clone(), arrays).map_err(wrong)?;
        return Ok((schema, vec![batch]));
    }
    let capsule = object.call_method0("__arrow_c_stream__")?.cast_into::<PyCapsule>()?;
    let pointer = capsule.pointer_checked(Some(c"arrow_array_stream"))?;
    // SAFETY: a capsule of this name holds an array stream (Arrow PyCapsule interface); the reader moves it out and marks it as
    // released, so that the capsule does not release it again.
    let reader = unsafe { RecordBatchStreamReader::from_raw(pointer.as_ptr().cast()) };
    let reader = reader.map_err(wrong)?;
    let schema = reader.schema();
    let batches: Result<Vec<RecordBatch>, _> = reader.collect();
    Ok((schema, batches.map_err(wrong)?))
}

fn wrong(error: arrow_schema::ArrowError) -> PyErr {
    PyValueError::new_err(error.to_string())
}
