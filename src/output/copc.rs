//! COPC 1.0: LAZ whose chunks are the nodes of an octree, so that a reader fetches only the region and the detail that it
//! wants (copc.io, "Cloud Optimized Point Cloud Specification").
//!
//! Points wait in an unnamed temporary file until the last one has arrived, because only then the cube is known. Then each
//! node keeps the first point of every cell of a grid of 128³ and hands the others down; points go through temporary files
//! wherever they are many, so that memory holds one node and the edges of its children. What a node keeps depends on the
//! order of the points only, which is the same for any number of threads.

use super::blocks::Blocks;
use super::las::LasFormat;
use super::laz::{compress, laszip_builder};
use super::offload::Offload;
use super::stream::OutputStream;
use super::summary::Tally;
use crate::error::{Error, Result};
use crate::geom::DVec3;
use laz::LazVlr;
use laz::laszip::{ChunkTable, ChunkTableEntry};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{Read, Seek, Write};

/// Cells of a node's grid along each edge.
const GRID: u64 = 128;
/// Points that a node keeps without looking at them.
const LEAF: u64 = 50_000;
/// Fewer points than these make no node of their own.
const FEW: u64 = 200;
/// The finest level. The cube's edge is a multiple of 2 to this power, so that nodes have whole units for edges.
const DEEPEST: u32 = 16;
/// Bytes of a spill that stay in memory.
const KEPT: usize = 2 << 20;
/// Where the GPS time stands in a record of format 6.
const TIME: usize = 22;

/// Bytes of the record that describes the octree.
pub(super) const INFO: usize = 160;

/// What the header has to know of the octree.
pub(super) struct Octree {
    /// Contents of the record that describes it.
    pub info: [u8; INFO],
    /// Where the list of nodes stands.
    pub hierarchy_at: u64,
}

/// How the points are compressed: every chunk has a length of its own.
pub(super) fn laszip(format: &LasFormat) -> Result<LazVlr> {
    Ok(laszip_builder(format)?.with_variable_chunk_size().build())
}

/// The points of one file on their way into an octree.
pub(super) struct CopcStream {
    laszip: LazVlr,
    /// Where the offset of the chunk table stands.
    start: u64,
    points: Spill,
    times: Option<[f64; 2]>,
}

impl CopcStream {
    /// Begins after the header of a file.
    pub fn begin(laszip: LazVlr, record: u16, out: &mut OutputStream) -> Result<CopcStream> {
        let start = out.len();
        out.append(&(-1i64).to_le_bytes())?;
        Ok(CopcStream { laszip, start, points: Spill::new(usize::from(record)), times: None })
    }

    /// Takes packed points of format 6.
    pub fn append(&mut self, records: &[u8]) -> Result<()> {
        for record in records.chunks_exact(self.points.record) {
            let mut time = [0; 8];
            time.copy_from_slice(&record[TIME..TIME + 8]);
            let time = f64::from_le_bytes(time);
            let [first, last] = self.times.unwrap_or([time; 2]);
            self.times = Some([first.min(time), last.max(time)]);
        }
        self.points.append(records)
    }

    /// Builds the octree and writes its nodes, the chunk table and the list of nodes.
    pub fn finish(
        self,
        format: &LasFormat,
        tally: &Tally,
        out: &mut OutputStream,
        offload: &dyn Offload,
    ) -> Result<Octree> {
        let cube = Cube::around(tally);
        let items = self.laszip.clone();
        let how = move |points: &[u8], out| compress(points, out, &items).map_err(|e| e.to_string());
        let mut builder = Builder {
            cube,
            record: self.points.record,
            blocks: Blocks::new(how),
            nodes: Nodes { waiting: VecDeque::new(), table: ChunkTable::default(), entries: Vec::new() },
            out,
            offload,
        };
        builder.build(Key::ROOT, self.points)?;
        let Builder { mut blocks, mut nodes, out, .. } = builder;
        blocks.finish(|chunk| nodes.write(chunk, out))?;

        let offset = out.len();
        let mut table = Vec::new();
        nodes.table.write_to(&mut table, &self.laszip).map_err(|e| Error::Internal(format!("COPC: {e}")))?;
        out.append(&table)?;
        out.patch(self.start, &offset.to_le_bytes())?;

        if nodes.entries.is_empty() {
            // A root without points
            nodes.entries.extend([0; ENTRY]);
        }
        let hierarchy_at = out.len();
        let head = evlr_header(nodes.entries.len() as u64);
        out.append(&head)?;
        out.append(&nodes.entries)?;
        let at = hierarchy_at + head.len() as u64;
        let info = info(format, &cube, at, nodes.entries.len() as u64, self.times.unwrap_or_default());
        Ok(Octree { info, hierarchy_at })
    }
}

/// The cube of the root in units of the coordinates.
#[derive(Clone, Copy)]
struct Cube {
    min: [i64; 3],
    edge: u64,
}

impl Cube {
    fn around(tally: &Tally) -> Cube {
        let unit = 1u64 << DEEPEST;
        if tally.bounds.is_empty() {
            return Cube { min: [0; 3], edge: unit };
        }
        let min = tally.bounds.min.to_array().map(|c| c as i64);
        let extent = (tally.bounds.max - tally.bounds.min).max_element() as u64 + 1;
        Cube { min, edge: extent.next_multiple_of(unit) }
    }

    /// Where a point lies, from the cube's corner.
    fn within(&self, record: &[u8]) -> [u64; 3] {
        [0, 1, 2].map(|axis| {
            let mut coordinate = [0; 4];
            coordinate.copy_from_slice(&record[4 * axis..4 * axis + 4]);
            (i64::from(i32::from_le_bytes(coordinate)) - self.min[axis]).clamp(0, self.edge as i64 - 1) as u64
        })
    }
}

/// Which node of the octree.
#[derive(Clone, Copy)]
struct Key {
    level: u32,
    at: [u64; 3],
}

impl Key {
    const ROOT: Key = Key { level: 0, at: [0; 3] };

    fn child(self, octant: usize) -> Key {
        let at = [0, 1, 2].map(|axis| 2 * self.at[axis] + (octant >> axis & 1) as u64);
        Key { level: self.level + 1, at }
    }
}

/// Bytes of an entry in the list of nodes.
const ENTRY: usize = 32;

/// The nodes that have been written, and those that are being compressed.
struct Nodes {
    /// Key and number of points.
    waiting: VecDeque<(Key, u64)>,
    table: ChunkTable,
    entries: Vec<u8>,
}

impl Nodes {
    /// Writes the chunk of the node that has waited longest.
    fn write(&mut self, chunk: &[u8], out: &mut OutputStream) -> Result<()> {
        let Some((key, points)) = self.waiting.pop_front() else {
            return Err(Error::Internal("a chunk without a node".to_owned()));
        };
        let too_many = || Error::input("COPC: more points in one place than a node holds; write LAZ");
        for number in [u64::from(key.level), key.at[0], key.at[1], key.at[2]] {
            self.entries.extend((number as i32).to_le_bytes());
        }
        self.entries.extend(out.len().to_le_bytes());
        for number in [chunk.len() as u64, points] {
            self.entries.extend(i32::try_from(number).map_err(|_| too_many())?.to_le_bytes());
        }
        self.table.push(ChunkTableEntry { point_count: points, byte_count: chunk.len() as u64 });
        out.append(chunk)
    }
}

struct Builder<'a> {
    cube: Cube,
    record: usize,
    blocks: Blocks,
    nodes: Nodes,
    out: &'a mut OutputStream,
    offload: &'a dyn Offload,
}

impl Builder<'_> {
    /// Writes a node and everything below it.
    fn build(&mut self, key: Key, points: Spill) -> Result<()> {
        match points.count() {
            0 => return Ok(()),
            count if count <= LEAF || key.level == DEEPEST => return self.submit(key, points.into_bytes()?),
            _ => {}
        }
        let edge = self.cube.edge >> key.level;
        let mut taken = Bits::new(GRID.pow(3));
        let mut kept = Vec::new();
        let mut children: [Spill; 8] = std::array::from_fn(|_| Spill::new(self.record));
        let (cube, record) = (self.cube, self.record);
        points.each_block(|block| {
            for point in block.chunks_exact(record) {
                let within = cube.within(point).map(|c| c % edge);
                let [x, y, z] = within.map(|c| c * GRID / edge);
                if taken.set((z * GRID + y) * GRID + x) {
                    kept.extend_from_slice(point);
                    continue;
                }
                let octant: usize = (0..3).map(|axis| usize::from(within[axis] >= edge / 2) << axis).sum();
                children[octant].append(point)?;
            }
            Ok(())
        })?;
        // Chunks of a few points cost more than they tell.
        for child in &mut children {
            if child.count() < FEW {
                kept.extend(std::mem::replace(child, Spill::new(record)).into_bytes()?);
            }
        }
        drop(taken);
        self.submit(key, kept)?;
        for (octant, child) in children.into_iter().enumerate() {
            self.build(key.child(octant), child)?;
        }
        Ok(())
    }

    /// Gives the points of a node away for compression.
    fn submit(&mut self, key: Key, mut points: Vec<u8>) -> Result<()> {
        let Builder { blocks, nodes, out, offload, record, .. } = self;
        nodes.waiting.push_back((key, (points.len() / *record) as u64));
        blocks.submit(&mut points, *offload, |chunk| nodes.write(chunk, out))
    }
}

/// Which cells are taken.
struct Bits(Vec<u64>);

impl Bits {
    fn new(count: u64) -> Bits {
        Bits(vec![0; count.div_ceil(64) as usize])
    }

    /// Takes a cell; `false` if it was taken already.
    fn set(&mut self, cell: u64) -> bool {
        let (word, bit) = (&mut self.0[(cell / 64) as usize], 1 << (cell % 64));
        let free = *word & bit == 0;
        *word |= bit;
        free
    }
}

/// Records that are set aside: the first and the last of them in memory, the others in an unnamed temporary file.
struct Spill {
    record: usize,
    waiting: Vec<u8>,
    file: Option<File>,
    stored: u64,
}

impl Spill {
    fn new(record: usize) -> Spill {
        Spill { record, waiting: Vec::new(), file: None, stored: 0 }
    }

    fn count(&self) -> u64 {
        (self.stored + self.waiting.len() as u64) / self.record as u64
    }

    fn append(&mut self, records: &[u8]) -> Result<()> {
        self.waiting.extend_from_slice(records);
        if self.waiting.len() < KEPT {
            return Ok(());
        }
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(tempfile::tempfile().map_err(|e| failed("create", e))?),
        };
        file.write_all(&self.waiting).map_err(|e| failed("write", e))?;
        self.stored += self.waiting.len() as u64;
        self.waiting.clear();
        Ok(())
    }

    /// Shows all records in their order, as blocks of whole ones.
    fn each_block(mut self, mut show: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        if let Some(file) = &mut self.file {
            file.rewind().map_err(|e| failed("read", e))?;
            let mut block = vec![0; KEPT / self.record * self.record];
            let mut left = self.stored;
            while left > 0 {
                let now = block.len().min(usize::try_from(left).unwrap_or(usize::MAX));
                file.read_exact(&mut block[..now]).map_err(|e| failed("read", e))?;
                show(&block[..now])?;
                left -= now as u64;
            }
        }
        show(&self.waiting)
    }

    fn into_bytes(self) -> Result<Vec<u8>> {
        let mut bytes = Vec::with_capacity(usize::try_from(self.stored).unwrap_or(0) + self.waiting.len());
        self.each_block(|block| {
            bytes.extend_from_slice(block);
            Ok(())
        })?;
        Ok(bytes)
    }
}

fn failed(action: &'static str, e: std::io::Error) -> Error {
    Error::io(action, std::env::temp_dir(), e)
}

/// The record that describes the octree.
fn info(format: &LasFormat, cube: &Cube, hierarchy_at: u64, bytes: u64, times: [f64; 2]) -> [u8; INFO] {
    let half = cube.edge as f64 / 2.0;
    let min = DVec3::from(cube.min.map(|c| c as f64));
    let centre = (min + DVec3::splat(half)) * format.scale + format.offset;
    let half = half * format.scale;
    let mut info = [0; INFO];
    let numbers = [centre.x, centre.y, centre.z, half, 2.0 * half / GRID as f64].map(f64::to_le_bytes);
    let places = [hierarchy_at, bytes].map(u64::to_le_bytes);
    let times = times.map(f64::to_le_bytes);
    for (field, value) in info.chunks_exact_mut(8).zip(numbers.iter().chain(&places).chain(&times)) {
        field.copy_from_slice(value);
    }
    info
}

/// Header of the extended variable length record that lists the nodes.
fn evlr_header(bytes: u64) -> Vec<u8> {
    let mut out = vec![0; 2];
    let text = |text: &str, width: usize, out: &mut Vec<u8>| {
        let end = out.len() + width;
        out.extend_from_slice(text.as_bytes());
        out.resize(end, 0);
    };
    text("copc", 16, &mut out);
    out.extend(1000u16.to_le_bytes());
    out.extend(bytes.to_le_bytes());
    text("octree", 32, &mut out);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spill_gives_back_what_it_took() {
        let mut spill = Spill::new(7);
        let all: Vec<u8> = (0..7 * 900_000u32).map(|i| (i % 251) as u8).collect();
        all.chunks(7 * 1234).for_each(|records| spill.append(records).unwrap());
        assert!(spill.file.is_some() && !spill.waiting.is_empty());
        assert_eq!(spill.count(), 900_000);
        assert!(spill.into_bytes().unwrap() == all);
    }

    #[test]
    fn children_lie_where_their_points_are() {
        let cube = Cube { min: [-5, 0, 7], edge: 1 << DEEPEST };
        let half = 1i32 << (DEEPEST - 1);
        let record: Vec<u8> =
            [half - 5, 3, half + 7].into_iter().flat_map(|c: i32| c.to_le_bytes()).collect();
        let within = cube.within(&record);
        assert_eq!(within, [half as u64, 3, half as u64]);
        let key = Key::ROOT.child(0b101);
        assert_eq!((key.level, key.at), (1, [1, 0, 1]));
    }

    #[test]
    fn records_have_their_lengths() {
        assert_eq!(evlr_header(0).len(), 60);
        assert_eq!(&evlr_header(5)[20..28], &5u64.to_le_bytes());
    }
}
