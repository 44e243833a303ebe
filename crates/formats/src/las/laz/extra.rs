//! Extra bytes: one layer per byte, coded as differences from point to point.

use super::coder::{Coder, Model};

/// Points whose bytes are gathered at a time.
const BLOCK_POINTS: usize = 256;

/// The layer of one byte.
struct Column {
    coder: Coder,
    model: Model,
    /// Points before the first one that differs; the layer is written from there on.
    unchanged: u32,
    changed: bool,
}

impl Column {
    fn new() -> Column {
        Column { coder: Coder::new(16), model: Model::new(256), unchanged: 0, changed: false }
    }

    /// Takes the byte differences of the next points. Returns whether they are to be written.
    #[inline(always)]
    fn begin(&mut self, off: &[u8], capacity: usize) -> bool {
        if !self.changed {
            if off.iter().fold(0, |all, off| all | off) == 0 {
                self.unchanged += off.len() as u32;
                return false;
            }
            self.changed = true;
            self.coder = Coder::new(capacity);
            for _ in 0..self.unchanged {
                self.coder.symbol(&mut self.model, 0);
            }
        }
        true
    }
}

/// Writes the differences of several columns interleaved: a symbol depends only on its predecessor in the
/// same layer.
#[inline(always)]
fn write<const N: usize>(columns: [&mut Column; N], off: [&[u8]; N]) {
    let count = off.iter().fold(BLOCK_POINTS, |count, off| count.min(off.len()));
    let off = off.map(|off| &off[..count]);
    let mut models = columns.map(|column| (std::mem::take(&mut column.coder), column));
    for i in 0..count {
        for ((coder, column), off) in models.iter_mut().zip(off) {
            coder.symbol(&mut column.model, u32::from(off[i]));
        }
    }
    for (coder, column) in models {
        column.coder = coder;
    }
}

/// Returns the layers of the bytes from `start` on in records of `length` bytes; a layer is empty where
/// nothing changed.
pub(super) fn layers(records: &[u8], start: usize, length: usize) -> Vec<Vec<u8>> {
    let points = records.len() / length;
    let mut columns: Vec<Column> = (start..length).map(|_| Column::new()).collect();
    let (mut off, mut changes) = (vec![[0; BLOCK_POINTS]; columns.len()], vec![0; columns.len()]);
    for first in (1..points).step_by(BLOCK_POINTS) {
        let count = BLOCK_POINTS.min(points - first);
        // Includes the preceding point.
        let block = &records[(first - 1) * length..(first + count) * length];
        find_changes(block, start, length, &mut changes);
        for (i, (off, changes)) in off.iter_mut().zip(&changes).enumerate() {
            if *changes == 0 {
                off.fill(0);
            } else {
                take_column(block, start + i, length, off);
            }
        }
        let begun = columns.iter_mut().zip(&off).filter_map(|(column, off)| {
            let off = &off[..count];
            column.begin(off, points).then_some((column, off))
        });
        write_all(begun);
    }
    columns.into_iter().map(|c| if c.changed { c.coder.finish() } else { Vec::new() }).collect()
}

/// Computes the bits in which each byte from `start` on changes from point to point.
#[inline(always)]
fn find_changes(block: &[u8], start: usize, length: usize, changes: &mut [u8]) {
    changes.fill(0);
    let bytes = || block.chunks_exact(length).map(|record| &record[start..]);
    for (last, next) in bytes().zip(bytes().skip(1)) {
        for ((changes, last), next) in changes.iter_mut().zip(last).zip(next) {
            *changes |= last ^ next;
        }
    }
}

/// Computes the differences of byte `at` from point to point.
#[inline(always)]
fn take_column(block: &[u8], at: usize, length: usize, off: &mut [u8; BLOCK_POINTS]) {
    let mut last = block[at];
    for (off, record) in off.iter_mut().zip(block.chunks_exact(length).skip(1)) {
        let byte = record[at];
        *off = byte.wrapping_sub(last);
        last = byte;
    }
}

/// Writes the differences of all columns, several of them interleaved.
fn write_all<'a>(mut columns: impl Iterator<Item = (&'a mut Column, &'a [u8])>) {
    while let Some((a, of_a)) = columns.next() {
        match columns.next() {
            Some((b, of_b)) => write([a, b], [of_a, of_b]),
            None => write([a], [of_a]),
        }
    }
}
