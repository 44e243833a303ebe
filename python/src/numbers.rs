//! Numbers of other libraries whose types the engine does not read, as numbers that it reads.

use arrow_array::cast::AsArray;
use arrow_array::types::{
    Decimal32Type, Decimal64Type, Decimal128Type, Decimal256Type, DecimalType, Float16Type,
};
use arrow_array::{Array, ArrayRef, Float32Array, Float64Array, PrimitiveArray, RecordBatch, UInt8Array};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef};
use arrow_select::take::{TakeOptions, take};
use std::sync::Arc;

/// The batches of a table with other columns of numbers: truth values become 0 and 1, half-precision numbers
/// have single precision, decimal numbers double precision, and numbers in a dictionary are plain ones.
/// Columns of other types stay as they are.
///
/// # Errors
/// For a dictionary that lacks a value.
pub fn with_plain_numbers(
    schema: SchemaRef,
    batches: Vec<RecordBatch>,
) -> Result<(SchemaRef, Vec<RecordBatch>), ArrowError> {
    if schema.fields().iter().all(|field| plain_type(field.data_type()).is_none()) {
        return Ok((schema, batches));
    }
    let plain = |field: &Arc<Field>| match plain_type(field.data_type()) {
        Some(kind) => Arc::new(field.as_ref().clone().with_data_type(kind)),
        None => field.clone(),
    };
    let fields: Vec<Arc<Field>> = schema.fields().iter().map(plain).collect();
    let schema = Arc::new(Schema::new_with_metadata(fields, schema.metadata().clone()));
    let converted = batches.iter().map(|batch| {
        let columns = batch.columns().iter().map(plain_column).collect::<Result<Vec<_>, _>>()?;
        RecordBatch::try_new(schema.clone(), columns)
    });
    let converted = converted.collect::<Result<Vec<_>, _>>()?;
    Ok((schema, converted))
}

/// The type that numbers of a type become; `None` for types that stay.
fn plain_type(kind: &DataType) -> Option<DataType> {
    match kind {
        DataType::Boolean => Some(DataType::UInt8),
        DataType::Float16 => Some(DataType::Float32),
        DataType::Decimal32(..)
        | DataType::Decimal64(..)
        | DataType::Decimal128(..)
        | DataType::Decimal256(..) => Some(DataType::Float64),
        DataType::Dictionary(_, values) => {
            plain_type(values).or_else(|| values.is_numeric().then(|| values.as_ref().clone()))
        }
        _ => None,
    }
}

/// A column as its [`plain_type`]; missing values stay missing.
fn plain_column(column: &ArrayRef) -> Result<ArrayRef, ArrowError> {
    let plain: ArrayRef = match column.data_type() {
        DataType::Boolean => {
            Arc::new(column.as_boolean().iter().map(|value| value.map(u8::from)).collect::<UInt8Array>())
        }
        DataType::Float16 => {
            let values = column.as_primitive::<Float16Type>().iter();
            Arc::new(values.map(|value| value.map(|number| number.to_f32())).collect::<Float32Array>())
        }
        DataType::Decimal32(..) => doubles(column.as_primitive::<Decimal32Type>()),
        DataType::Decimal64(..) => doubles(column.as_primitive::<Decimal64Type>()),
        DataType::Decimal128(..) => doubles(column.as_primitive::<Decimal128Type>()),
        DataType::Decimal256(..) => doubles(column.as_primitive::<Decimal256Type>()),
        kind @ DataType::Dictionary(..) if plain_type(kind).is_some() => {
            let dictionary = column.as_any_dictionary();
            let options = TakeOptions { check_bounds: true };
            plain_column(&take(dictionary.values(), dictionary.keys(), Some(options))?)?
        }
        _ => column.clone(),
    };
    Ok(plain)
}

/// The doubles that are nearest to decimal numbers.
fn doubles<T: DecimalType>(column: &PrimitiveArray<T>) -> ArrayRef {
    let value = |row: usize| match column.is_null(row) {
        true => None,
        false => column.value_as_string(row).parse::<f64>().ok(),
    };
    Arc::new((0..column.len()).map(value).collect::<Float64Array>())
}
