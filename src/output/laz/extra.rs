//! Extra bytes: a layer for every byte, of its differences from point to point.

use super::coder::{Coder, Model};

/// Points whose bytes are taken from memory at a time.
const BLOCK: usize = 256;

/// The layer of one byte.
struct Column {
    coder: Coder,
    model: Model,
    last: u8,
    /// Points before the first that differs; then the layer is written.
    unchanged: u32,
    changed: bool,
}

impl Column {
    fn new(first: u8) -> Column {
        Column { coder: Coder::new(16), model: Model::new(256), last: first, unchanged: 0, changed: false }
    }

    /// Writes the differences `off` from byte to byte.
    #[inline(always)]
    fn write(&mut self, off: &[u8], room: usize) {
        if !self.changed {
            if off.iter().fold(0, |all, off| all | off) == 0 {
                self.unchanged += off.len() as u32;
                return;
            }
            self.changed = true;
            self.coder = Coder::new(room);
            for _ in 0..self.unchanged {
                self.coder.symbol(&mut self.model, 0);
            }
        }
        for off in off {
            self.coder.symbol(&mut self.model, u32::from(*off));
        }
    }
}

/// The layers of the bytes from `start` on in records of `length` bytes, each in full; empty where nothing changed.
pub(super) fn layers(records: &[u8], start: usize, length: usize) -> Vec<Vec<u8>> {
    let points = records.len() / length;
    let mut columns: Vec<Column> = records[start..length].iter().map(|byte| Column::new(*byte)).collect();
    let mut off = [0; BLOCK];
    for block in records[length..].chunks(BLOCK * length) {
        for (i, column) in columns.iter_mut().enumerate() {
            let count = block.len() / length;
            for (off, record) in off.iter_mut().zip(block.chunks_exact(length)) {
                let byte = record[start + i];
                *off = byte.wrapping_sub(column.last);
                column.last = byte;
            }
            column.write(&off[..count], points);
        }
    }
    columns.into_iter().map(|c| if c.changed { c.coder.finish() } else { Vec::new() }).collect()
}
