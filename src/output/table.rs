//! Points as text with chosen columns: a line of names, then one line per point.

use super::columns::{Column, Kind, slices};
use super::number::{push_fixed, push_integer};

pub(super) fn header(columns: &[Column], separator: u8) -> Vec<u8> {
    let names: Vec<&str> = columns.iter().map(|c| c.name()).collect();
    let mut line = names.join(&char::from(separator).to_string()).into_bytes();
    line.push(b'\n');
    line
}

/// Appends the rows of a block written by [`ColumnCodec::push`](super::column_codec::ColumnCodec::push), one line
/// each.
pub(super) fn push_rows(out: &mut Vec<u8>, columns: &[Column], rows: usize, block: &[u8], separator: u8) {
    let slices: Vec<(Column, &[u8])> = columns
        .iter()
        .copied()
        .zip(slices(columns.iter().map(|column| column.kind()), rows, block))
        .collect();
    for row in 0..rows {
        for (at, (column, bytes)) in slices.iter().enumerate() {
            if at > 0 {
                out.push(separator);
            }
            let width = column.kind().width();
            push_value(out, *column, &bytes[row * width..(row + 1) * width]);
        }
        out.push(b'\n');
    }
}

fn push_value(out: &mut Vec<u8>, column: Column, bytes: &[u8]) {
    let mut wide = [0; 8];
    wide[..bytes.len()].copy_from_slice(bytes);
    let bits = u64::from_le_bytes(wide);
    match column.kind() {
        Kind::U8 | Kind::U16 | Kind::U32 | Kind::U64 => push_integer(out, bits),
        Kind::I32 => push_integer(out, bits as u32 as i32),
        Kind::F32 => push_decimals(out, column, f64::from(f32::from_bits(bits as u32))),
        Kind::F64 => push_decimals(out, column, f64::from_bits(bits)),
    }
}

fn push_decimals(out: &mut Vec<u8>, column: Column, value: f64) {
    match column.decimals() {
        9 => push_fixed::<9>(out, value),
        _ => push_fixed::<4>(out, value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_lines() {
        let columns = [Column::X, Column::ReturnNumber, Column::ObjectId];
        let mut block = Vec::new();
        [1.5f64, -2.0].iter().for_each(|x| block.extend(x.to_le_bytes()));
        block.extend([1u8, 255]);
        [-7i32, 8].iter().for_each(|id| block.extend(id.to_le_bytes()));
        let mut text = header(&columns, b',');
        push_rows(&mut text, &columns, 2, &block, b',');
        assert_eq!(String::from_utf8(text).unwrap(), "X,ReturnNumber,ObjectId\n1.5000,1,-7\n-2.0000,255,8\n");
    }
}
