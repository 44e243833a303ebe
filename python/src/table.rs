//! Tables of a run: columns as NumPy arrays and by the Arrow C data interface, without copies.

use crate::errors::{Notices, exception};
use crate::numbers::with_plain_numbers;
use crate::options::values;
use crate::watch::interruptible;
use arrow_array::cast::AsArray;
use arrow_array::ffi::{FFI_ArrowArray, FFI_ArrowSchema, to_ffi};
use arrow_array::ffi_stream::{FFI_ArrowArrayStream, RecordBatchStreamReader};
use arrow_array::types::{Float32Type, Float64Type};
use arrow_array::{
    Array, ArrayRef, Float32Array, Float64Array, Int8Array, Int16Array, Int32Array, Int64Array, RecordBatch,
    RecordBatchIterator, RecordBatchReader, StructArray, UInt8Array, UInt16Array, UInt32Array, UInt64Array,
};
use arrow_ipc::reader::StreamReader;
use arrow_schema::{DataType, Field, Schema, SchemaRef};
use arrow_select::concat::concat_batches;
use arrow_select::take::take_record_batch;
use pyo3::exceptions::{PyKeyError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyCapsule, PyDict};
use std::sync::Arc;
use vlscan::options::Crs;
use vlscan::tables::input::arrow::encode_stream;
use vlscan::{CloudFacts, Column as PointColumn, Error};

/// Columns of numbers in memory; of points also what files of them need beside their columns.
#[pyclass(frozen, module = "vlscan")]
pub struct Table {
    pub batch: RecordBatch,
    exact: Option<RecordBatch>,
    facts: Option<Arc<CloudFacts>>,
}

/// A column of a table, which NumPy takes without a copy: `numpy.asarray(column)`.
#[pyclass(frozen, module = "vlscan")]
pub struct Column(ArrayRef);

#[pymethods]
impl Table {
    fn __len__(&self) -> usize {
        self.batch.num_rows()
    }

    /// Names of the columns.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.batch.schema().fields().iter().map(|field| field.name().clone()).collect()
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
        self.batch.schema().metadata().iter().try_for_each(|(key, value)| metadata.set_item(key, value))?;
        Ok(metadata)
    }

    /// A column by name.
    fn column(&self, name: &str) -> PyResult<Column> {
        match self.batch.column_by_name(name) {
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
        let start = start.min(self.batch.num_rows());
        let stop = stop.clamp(start, self.batch.num_rows());
        let rows = |batch: &RecordBatch| batch.slice(start, stop - start);
        let exact = self.exact.as_ref().map(rows);
        Table { batch: rows(&self.batch), exact, facts: self.facts.clone() }
    }

    /// The rows with these indices, bytes of unsigned 64-bit integers.
    fn take(&self, py: Python<'_>, indices: &[u8]) -> PyResult<Table> {
        let (indices, _) = indices.as_chunks();
        let indices = UInt64Array::from_iter_values(indices.iter().map(|index| u64::from_le_bytes(*index)));
        py.detach(|| {
            let rows = |batch: &RecordBatch| take_record_batch(batch, &indices).map_err(wrong);
            let exact = self.exact.as_ref().map(rows).transpose()?;
            Ok(Table { batch: rows(&self.batch)?, exact, facts: self.facts.clone() })
        })
    }

    /// The columns as an Arrow stream, those beside them, and what is known of the points: what
    /// [`Table::of_bytes`] takes.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Parts<Bound<'py, PyBytes>>> {
        let stream = |batch: &RecordBatch| {
            let bytes = py.detach(|| encode_stream(&batch.schema(), std::slice::from_ref(batch)));
            bytes.map(|bytes| PyBytes::new(py, &bytes)).map_err(|error| exception(py, error))
        };
        let facts = self.facts.as_ref().map(|facts| facts.to_bytes().map_err(|error| exception(py, error)));
        let facts = facts.transpose()?.map(|bytes| PyBytes::new(py, &bytes));
        Ok((stream(&self.batch)?, self.exact.as_ref().map(stream).transpose()?, facts))
    }

    /// A table of what [`Table::to_bytes`] returns.
    #[staticmethod]
    fn of_bytes(
        py: Python<'_>,
        columns: &[u8],
        exact: Option<&[u8]>,
        facts: Option<&[u8]>,
    ) -> PyResult<Table> {
        let facts = facts.map(|bytes| CloudFacts::from_bytes(bytes).map(Arc::new)).transpose();
        let facts = facts.map_err(|error| exception(py, error))?;
        let exact = exact.map(decode_stream).transpose()?;
        Ok(Table { batch: decode_stream(columns)?, exact, facts })
    }

    /// A table of the columns of another one; `crs` is the coordinate reference system, if it is not in the
    /// metadata.
    #[staticmethod]
    fn of_columns(py: Python<'_>, table: &Bound<'_, PyAny>, crs: Option<&str>) -> PyResult<Table> {
        let (schema, batches) = batches(table)?;
        let batch = without_nulls(concat_batches(&schema, &batches).map_err(wrong)?)?;
        let Some(crs) = crs else { return Ok(Table::new(batch)) };
        let mut metadata = schema.metadata().clone();
        metadata.insert("crs".to_owned(), wkt(crs).map_err(|error| exception(py, error))?);
        let schema = Arc::new(Schema::new_with_metadata(schema.fields().clone(), metadata));
        Ok(Table::new(RecordBatch::try_new(schema, batch.columns().to_vec()).map_err(wrong)?))
    }

    /// The rows of tables with the same columns, one after the other. What is known of the points beside
    /// their columns, and metadata, is kept where all tables agree.
    #[staticmethod]
    fn concat(py: Python<'_>, tables: Vec<Py<Table>>) -> PyResult<Table> {
        let all: Vec<&Table> = tables.iter().map(|table| table.get()).collect();
        let Some((first, others)) = all.split_first() else {
            return Err(PyValueError::new_err("there are no tables, expected at least one"));
        };
        let expected = first.kinds();
        if let Some(other) = others.iter().find(|other| other.kinds() != expected) {
            let message = format!("tables with different columns: {expected:?} and {:?}", other.kinds());
            return Err(PyValueError::new_err(message));
        }
        let mut metadata = first.batch.schema().metadata().clone();
        metadata.retain(|key, value| {
            others.iter().all(|other| other.batch.schema().metadata().get(key) == Some(&*value))
        });
        let schema = Arc::new(Schema::new_with_metadata(first.batch.schema().fields().clone(), metadata));
        let is_shared =
            |facts: &Arc<CloudFacts>| others.iter().all(|other| other.facts.as_ref() == Some(facts));
        let facts = first.facts.clone().filter(is_shared);
        py.detach(|| {
            let batch = concat_batches(&schema, all.iter().map(|table| &table.batch)).map_err(wrong)?;
            let beside: Option<Vec<&RecordBatch>> = all.iter().map(|table| table.exact.as_ref()).collect();
            let beside = beside.filter(|_| facts.is_some());
            let schema = first.exact.as_ref().map(RecordBatch::schema);
            let exact = match schema.zip(beside) {
                // A run without widths of echoes has fewer of them than shards of it.
                Some((schema, batches)) if batches.iter().all(|batch| batch.schema() == schema) => {
                    Some(concat_batches(&schema, batches).map_err(wrong)?)
                }
                _ => None,
            };
            Ok(Table { batch, exact, facts })
        })
    }

    /// Writes points to the file that the options name, and returns the number of points.
    fn write(&self, py: Python<'_>, options: &Bound<'_, PyDict>) -> PyResult<u64> {
        let options = values(options)?;
        let (batch, exact, facts) = (self.batch.clone(), self.exact.clone(), self.facts.clone());
        let written = interruptible(py, move |interruption| {
            interruption.begin_writing()?;
            let request = vlscan::Options::of_values(options)?.output_request((0, 0))?;
            let facts = match facts {
                Some(facts) => facts,
                None => {
                    let crs = batch.schema().metadata().get("crs").cloned();
                    Arc::new(CloudFacts::of_table(&batch, crs)?)
                }
            };
            vlscan::write_points(&batch, exact.as_ref(), &facts, &request)
        })?;
        let (tally, found) = written.map_err(|error| exception(py, error))?;
        let notices = Notices::default();
        notices.add(vlscan::Notice::Warnings(found));
        notices.issue(py)?;
        Ok(tally.records)
    }

    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_array__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyCapsule>, Bound<'py, PyCapsule>)> {
        let _ = requested_schema;
        let whole: ArrayRef = Arc::new(StructArray::from(self.batch.clone()));
        let (array, _) = to_ffi(&whole.to_data()).map_err(wrong)?;
        Ok((self.__arrow_c_schema__(py)?, PyCapsule::new_with_value(py, ArrayHolder(array), c"arrow_array")?))
    }

    fn __arrow_c_schema__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyCapsule>> {
        let schema = FFI_ArrowSchema::try_from(self.batch.schema().as_ref()).map_err(wrong)?;
        PyCapsule::new_with_value(py, SchemaHolder(schema), c"arrow_schema")
    }

    #[pyo3(signature = (requested_schema=None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        let _ = requested_schema;
        stream(py, self.batch.schema(), vec![self.batch.clone()])
    }
}

/// The columns of a table, those beside them, and what is known of its points, as bytes.
type Parts<T> = (T, Option<T>, Option<T>);

impl Table {
    /// A table whose rows are no points of a run.
    pub fn new(batch: RecordBatch) -> Table {
        Table { batch, exact: None, facts: None }
    }

    /// The points of a run, whose last columns may be those that are beside the others.
    pub fn of_points(batch: RecordBatch, facts: Option<CloudFacts>) -> PyResult<Table> {
        let is_exact = |name: &str| PointColumn::EXACT.iter().any(|column| column.name() == name);
        let schema = batch.schema();
        let (hidden, shown): (Vec<usize>, Vec<usize>) =
            (0..schema.fields().len()).partition(|index| is_exact(schema.field(*index).name()));
        let exact = if hidden.is_empty() { None } else { Some(batch.project(&hidden).map_err(wrong)?) };
        Ok(Table { batch: batch.project(&shown).map_err(wrong)?, exact, facts: facts.map(Arc::new) })
    }

    /// Names and types of the columns.
    fn kinds(&self) -> Vec<String> {
        let schema = self.batch.schema();
        schema.fields().iter().map(|field| format!("{} ({})", field.name(), field.data_type())).collect()
    }

    fn metadata_of<'py>(&self, py: Python<'py>, key: &str) -> PyResult<Bound<'py, PyDict>> {
        let found = PyDict::new(py);
        for field in self.batch.schema().fields() {
            if let Some(value) = field.metadata().get(key) {
                found.set_item(field.name(), value)?;
            }
        }
        Ok(found)
    }
}

impl Column {
    /// A column of numbers.
    pub fn new(array: ArrayRef) -> Column {
        Column(array)
    }
}

// The structures of the C data interface are the first and only fields, so that a pointer to a holder is one
// to the structure.
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
            DataType::Int8 => "|i1",
            DataType::Int16 => "<i2",
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

/// Numbers as an array of the type that NumPy calls `kind`.
fn numbers(kind: &str, bytes: &[u8]) -> PyResult<ArrayRef> {
    macro_rules! array {
        ($array:ident, $of:ty) => {
            Arc::new($array::from_iter_values(bytes.chunks_exact(size_of::<$of>()).map(|number| {
                let mut value = [0; size_of::<$of>()];
                value.copy_from_slice(number);
                <$of>::from_le_bytes(value)
            }))) as ArrayRef
        };
    }
    Ok(match kind {
        "|u1" => array!(UInt8Array, u8),
        "<u2" => array!(UInt16Array, u16),
        "<u4" => array!(UInt32Array, u32),
        "<u8" => array!(UInt64Array, u64),
        "|i1" => array!(Int8Array, i8),
        "<i2" => array!(Int16Array, i16),
        "<i4" => array!(Int32Array, i32),
        "<i8" => array!(Int64Array, i64),
        "<f4" => array!(Float32Array, f32),
        "<f8" => array!(Float64Array, f64),
        other => return Err(PyTypeError::new_err(format!("a column is of {other}, expected numbers"))),
    })
}

/// The record batches of an object: of anything with `__arrow_c_stream__`, whose numbers become plain ones, or
/// of a dictionary of columns as bytes of doubles, or as types of NumPy with bytes.
pub fn batches(object: &Bound<'_, PyAny>) -> PyResult<(SchemaRef, Vec<RecordBatch>)> {
    if let Ok(columns) = object.cast::<PyDict>() {
        let mut fields = Vec::new();
        let mut arrays: Vec<ArrayRef> = Vec::new();
        for (name, values) in columns {
            let array = match values.cast::<PyBytes>() {
                Ok(values) => numbers("<f8", values.as_bytes())?,
                Err(_) => {
                    let (kind, values): (String, Bound<'_, PyBytes>) = values.extract()?;
                    numbers(&kind, values.as_bytes())?
                }
            };
            fields.push(Field::new(name.extract::<String>()?, array.data_type().clone(), false));
            arrays.push(array);
        }
        let schema = Arc::new(Schema::new(fields));
        let batch = RecordBatch::try_new(schema.clone(), arrays).map_err(wrong)?;
        return Ok((schema, vec![batch]));
    }
    let capsule = object.call_method0("__arrow_c_stream__")?.cast_into::<PyCapsule>()?;
    let pointer = capsule.pointer_checked(Some(c"arrow_array_stream"))?;
    // SAFETY: a capsule of this name holds an array stream (Arrow PyCapsule interface); the reader moves it
    // out and marks it as released, so that the capsule does not release it again.
    let reader = unsafe { RecordBatchStreamReader::from_raw(pointer.as_ptr().cast()) };
    let reader = reader.map_err(wrong)?;
    let schema = reader.schema();
    let batches: Result<Vec<RecordBatch>, _> = reader.collect();
    with_plain_numbers(schema, batches.map_err(wrong)?).map_err(wrong)
}

/// A batch whose columns of numbers have no missing values, for which NumPy has no place: NaN stands for
/// those of floating-point numbers, and those of whole numbers are an error.
fn without_nulls(batch: RecordBatch) -> PyResult<RecordBatch> {
    if batch.columns().iter().all(|column| column.null_count() == 0) {
        return Ok(batch);
    }
    let schema = batch.schema();
    let columns = schema.fields().iter().zip(batch.columns());
    let columns: PyResult<Vec<ArrayRef>> =
        columns.map(|(field, column)| filled(field.name(), column)).collect();
    RecordBatch::try_new(schema, columns?).map_err(wrong)
}

/// A column of [`without_nulls`].
fn filled(name: &str, column: &ArrayRef) -> PyResult<ArrayRef> {
    let missing = column.null_count();
    if missing == 0 {
        return Ok(column.clone());
    }
    if let Some(values) = column.as_primitive_opt::<Float64Type>() {
        let values = values.iter().map(|value| value.unwrap_or(f64::NAN));
        return Ok(Arc::new(Float64Array::from_iter_values(values)));
    }
    if let Some(values) = column.as_primitive_opt::<Float32Type>() {
        let values = values.iter().map(|value| value.unwrap_or(f32::NAN));
        return Ok(Arc::new(Float32Array::from_iter_values(values)));
    }
    if column.data_type().is_numeric() {
        let message =
            format!("column {name} has {missing} missing values; fill them, or leave these rows out");
        return Err(PyValueError::new_err(message));
    }
    Ok(column.clone())
}

/// The rows of an Arrow stream in memory.
pub fn decode_stream(bytes: &[u8]) -> PyResult<RecordBatch> {
    let reader = StreamReader::try_new(bytes, None).map_err(wrong)?;
    let schema = reader.schema();
    let batches: Result<Vec<RecordBatch>, _> = reader.collect();
    concat_batches(&schema, &batches.map_err(wrong)?).map_err(wrong)
}

/// Well-known text of a coordinate reference system: of a code, or of a text or a file that contains it.
pub fn wkt(system: &str) -> vlscan::Result<String> {
    let crs: Crs = system.parse().map_err(|problem| Error::input(format!("crs: {problem}")))?;
    crs.wkt()
}

pub fn wrong(error: arrow_schema::ArrowError) -> PyErr {
    PyValueError::new_err(error.to_string())
}
