//! COPC 1.0: LAZ whose chunks are the nodes of an octree, so that a reader fetches only the region and the
//! detail it needs (copc.io, "Cloud Optimized Point Cloud Specification").
//!
//! Points are collected in a temporary file until the last one has arrived, because the root cube is known
//! only then. Each node keeps the first point of every cell of a grid of 128³ and passes the others to its
//! children, through temporary files where they are many, so that memory holds one node and the buffers of
//! its children. The points of a node depend only on the order of the points, which is the same for any
//! number of threads.

use super::laz::{compress, laszip_builder};
use super::write::LasFormat;
use crate::out::{BlockCompressor, BlockError, Offload, OutputStream};
use crate::record::Tally;
use ::laz::LazVlr;
use ::laz::laszip::{ChunkTable, ChunkTableEntry};
use std::collections::VecDeque;
use std::ops::Range;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::FileWriter;
use vlscan_geom::DVec3;

/// Grid cells of a node along each edge.
const GRID: u64 = 128;
/// Maximum number of points that a node keeps without dividing them.
const MAX_LEAF_POINTS: u64 = 50_000;
/// Minimum number of points of a child node. Fewer points stay in the parent, because small chunks cost more
/// than they save.
const MIN_NODE_POINTS: u64 = 200;
/// Deepest level.
const MAX_LEVEL: u32 = 16;
/// Cells of the grids of the deepest nodes along each edge of the root cube. Nodes and cells of every level
/// are unions of them.
const FINE_CELLS: u64 = GRID << MAX_LEVEL;
/// Maximum bytes of a spill without a file.
const MAX_MEMORY_BYTES: usize = 2 << 20;
/// Bytes per write to the file of a spill.
const WRITE_BYTES: usize = 64 << 10;
/// Offset of the GPS time in a record of format 6 or 7, in bytes.
const TIME_AT: usize = 22;
/// Bytes of red, green and blue in a record of format 7.
const COLOUR: Range<usize> = 30..36;

/// Bytes of the COPC info record.
const INFO_BYTES: usize = 160;

/// Values of the octree that the header refers to.
pub(super) struct Octree {
    /// Contents of the COPC info record.
    pub info: [u8; INFO_BYTES],
    /// Position of the hierarchy in the file.
    pub hierarchy_at: u64,
}

impl Octree {
    pub const EMPTY: Octree = Octree { info: [0; INFO_BYTES], hierarchy_at: 0 };
}

/// Returns the LASzip record for chunks of variable length.
pub(super) fn laszip(format: &LasFormat) -> Result<LazVlr> {
    Ok(laszip_builder(format)?.with_variable_chunk_size().build())
}

/// The points of one file that will become an octree.
pub(super) struct CopcStream {
    laszip: LazVlr,
    /// Position of the field that holds the offset of the chunk table.
    start: u64,
    points: Spill,
    times: Option<[f64; 2]>,
    /// The greatest component of colours so far, if they are widened to 16 bits where all have 8.
    max_colour: Option<u16>,
}

impl CopcStream {
    /// Begins after the header of a file.
    pub fn begin(laszip: LazVlr, format: &LasFormat, out: &mut OutputStream) -> Result<CopcStream> {
        let start = out.len();
        out.append(&(-1i64).to_le_bytes())?;
        let points = Spill::new(usize::from(format.record_length()));
        let max_colour = format.widens_colours.then_some(0);
        Ok(CopcStream { laszip, start, points, times: None, max_colour })
    }

    /// Appends encoded points of format 6 or 7.
    pub fn append(&mut self, records: &[u8]) -> Result<()> {
        for record in records.chunks_exact(self.points.record) {
            let mut time = [0; 8];
            time.copy_from_slice(&record[TIME_AT..TIME_AT + 8]);
            let time = f64::from_le_bytes(time);
            let [first, last] = self.times.unwrap_or([time; 2]);
            self.times = Some([first.min(time), last.max(time)]);
            if let Some(max) = &mut self.max_colour {
                let components = record[COLOUR].chunks_exact(2).map(|c| u16::from_le_bytes([c[0], c[1]]));
                *max = components.fold(*max, u16::max);
            }
        }
        self.points.append(records)
    }

    /// Builds the octree and writes its nodes, the chunk table and the hierarchy.
    pub fn finish(
        self,
        format: &LasFormat,
        tally: &Tally,
        out: &mut OutputStream,
        offload: &dyn Offload,
    ) -> Result<Octree> {
        let cube = Cube::around(tally);
        let items = self.laszip.clone();
        let how = move |points: &[u8], out| compress(points, out, &items).map_err(BlockError::from);
        let mut builder = Builder {
            cube,
            record: self.points.record,
            widens_colours: self.max_colour.is_some_and(|max| max <= u16::from(u8::MAX)),
            blocks: BlockCompressor::new(how),
            nodes: Nodes { pending: VecDeque::new(), table: ChunkTable::default(), entries: Vec::new() },
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
            // An empty root node.
            nodes.entries.extend([0; ENTRY_BYTES]);
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

/// The root cube, in units of the stored coordinates: from the lower corner of the box around the points, as
/// wide as the box along its longest side, as readers take it from the header.
#[derive(Clone, Copy)]
struct Cube {
    min: [i64; 3],
    /// At least 1.
    edge: u64,
}

impl Cube {
    fn around(tally: &Tally) -> Cube {
        if tally.bounds.is_empty() {
            return Cube { min: [0; 3], edge: 1 };
        }
        let min = tally.bounds.min.to_array().map(|c| c as i64);
        let span = (tally.bounds.max - tally.bounds.min).max_element() as u64;
        Cube { min, edge: span.max(1) }
    }

    /// Returns the fine cell of a point along each axis, of [`FINE_CELLS`]. The upper faces of the cube
    /// belong to the last cells.
    fn fine_cell(&self, record: &[u8]) -> [u64; 3] {
        [0, 1, 2].map(|axis| {
            let mut coordinate = [0; 4];
            coordinate.copy_from_slice(&record[4 * axis..4 * axis + 4]);
            let within = (i64::from(i32::from_le_bytes(coordinate)) - self.min[axis]).max(0) as u64;
            // At most 2³³ · 2²³.
            (within.min(self.edge) * FINE_CELLS / self.edge).min(FINE_CELLS - 1)
        })
    }
}

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

/// Bytes of an entry of the hierarchy.
const ENTRY_BYTES: usize = 32;

/// Nodes: those already written, and those being compressed.
struct Nodes {
    /// Keys and numbers of points of the nodes being compressed, in order.
    pending: VecDeque<(Key, u64)>,
    table: ChunkTable,
    entries: Vec<u8>,
}

impl Nodes {
    fn write(&mut self, chunk: &[u8], out: &mut OutputStream) -> Result<()> {
        let Some((key, points)) = self.pending.pop_front() else {
            return Err(Error::Internal("a chunk without a node".to_owned()));
        };
        let too_many = || Error::input("COPC: too many points at one position for a node; write LAZ");
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
    /// True if all colours have 8 bits and are to have 16.
    widens_colours: bool,
    blocks: BlockCompressor,
    nodes: Nodes,
    out: &'a mut OutputStream,
    offload: &'a dyn Offload,
}

impl Builder<'_> {
    fn build(&mut self, key: Key, points: Spill) -> Result<()> {
        match points.count() {
            0 => return Ok(()),
            count if count <= MAX_LEAF_POINTS || key.level == MAX_LEVEL => {
                return self.submit(key, points.into_bytes()?);
            }
            _ => {}
        }
        // Bits of a fine cell below those of a node's cell.
        let below = MAX_LEVEL - key.level;
        let mut taken = CellSet::new(GRID.pow(3));
        let mut kept = Vec::new();
        let mut children: [Spill; 8] = std::array::from_fn(|_| Spill::new(self.record));
        let (cube, record) = (self.cube, self.record);
        points.each_block(|block| {
            for point in block.chunks_exact(record) {
                let cell = cube.fine_cell(point).map(|c| (c >> below) % GRID);
                let [x, y, z] = cell;
                if taken.insert((z * GRID + y) * GRID + x) {
                    kept.extend_from_slice(point);
                    continue;
                }
                let octant: usize = (0..3).map(|axis| usize::from(cell[axis] >= GRID / 2) << axis).sum();
                children[octant].append(point)?;
            }
            Ok(())
        })?;
        for child in &mut children {
            if child.count() < MIN_NODE_POINTS {
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

    fn submit(&mut self, key: Key, mut points: Vec<u8>) -> Result<()> {
        let Builder { blocks, nodes, out, offload, record, widens_colours, .. } = self;
        if *widens_colours {
            points.chunks_exact_mut(*record).for_each(widen_colour);
        }
        nodes.pending.push_back((key, (points.len() / *record) as u64));
        blocks.submit(&mut points, *offload, |chunk| nodes.write(chunk, out))
    }
}

/// Multiplies the components of a colour of 8 bits by 256: exchanges their bytes, of which the upper one is
/// 0.
fn widen_colour(record: &mut [u8]) {
    record[COLOUR].chunks_exact_mut(2).for_each(<[u8]>::reverse);
}

struct CellSet(Vec<u64>);

impl CellSet {
    fn new(count: u64) -> CellSet {
        CellSet(vec![0; count.div_ceil(64) as usize])
    }

    /// Occupies a cell. Returns `false` if it was occupied already.
    fn insert(&mut self, cell: u64) -> bool {
        let (word, bit) = (&mut self.0[(cell / 64) as usize], 1 << (cell % 64));
        let free = *word & bit == 0;
        *word |= bit;
        free
    }
}

/// Records set aside: few in memory, many in an unnamed temporary file.
struct Spill {
    record: usize,
    bytes: u64,
    /// Records that are not in the file.
    memory: Vec<u8>,
    file: Option<FileWriter>,
}

impl Spill {
    fn new(record: usize) -> Spill {
        Spill { record, bytes: 0, memory: Vec::new(), file: None }
    }

    fn count(&self) -> u64 {
        self.bytes / self.record as u64
    }

    fn append(&mut self, records: &[u8]) -> Result<()> {
        self.bytes += records.len() as u64;
        self.memory.extend_from_slice(records);
        let max = if self.file.is_none() { MAX_MEMORY_BYTES } else { WRITE_BYTES };
        if self.memory.len() <= max {
            return Ok(());
        }
        let file = match &mut self.file {
            Some(file) => file,
            none => none.insert(FileWriter::scratch()?),
        };
        file.append(&self.memory)?;
        // Frees memory that was needed before there was a file.
        self.memory = Vec::with_capacity(WRITE_BYTES);
        Ok(())
    }

    /// Passes all records in order to `read`, in blocks of complete records.
    fn each_block(self, mut read: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let record = self.record;
        let mut rest = Vec::new();
        if let Some(file) = self.file {
            file.copy_to(|bytes| {
                rest.extend_from_slice(bytes);
                let complete = rest.len() / record * record;
                read(&rest[..complete])?;
                rest.drain(..complete);
                Ok(())
            })?;
        }
        rest.extend_from_slice(&self.memory);
        read(&rest)
    }

    fn into_bytes(self) -> Result<Vec<u8>> {
        let mut bytes = Vec::with_capacity(usize::try_from(self.bytes).unwrap_or(0));
        self.each_block(|block| {
            bytes.extend_from_slice(block);
            Ok(())
        })?;
        Ok(bytes)
    }
}

/// Returns the contents of the COPC info record.
fn info(format: &LasFormat, cube: &Cube, hierarchy_at: u64, bytes: u64, times: [f64; 2]) -> [u8; INFO_BYTES] {
    let half = cube.edge as f64 / 2.0;
    let min = DVec3::from(cube.min.map(|c| c as f64));
    let centre = (min + DVec3::splat(half)) * format.scale + format.offset;
    let half = half * format.scale;
    let mut info = [0; INFO_BYTES];
    let numbers = [centre.x, centre.y, centre.z, half, 2.0 * half / GRID as f64].map(f64::to_le_bytes);
    let places = [hierarchy_at, bytes].map(u64::to_le_bytes);
    let times = times.map(f64::to_le_bytes);
    for (field, value) in info.chunks_exact_mut(8).zip(numbers.iter().chain(&places).chain(&times)) {
        field.copy_from_slice(value);
    }
    info
}

/// Returns the header of the extended variable length record of the hierarchy.
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
    fn a_spill_returns_its_records_from_memory_and_file() {
        let mut spill = Spill::new(7);
        let all: Vec<u8> = (0..7 * 900_000u32).map(|i| (i % 251) as u8).collect();
        all.chunks(7 * 1234).for_each(|records| spill.append(records).unwrap());
        assert!(spill.file.is_some());
        assert_eq!(spill.count(), 900_000);
        assert!(spill.into_bytes().unwrap() == all);
    }

    #[test]
    fn colours_of_8_bits_are_widened_where_they_are() {
        let mut record: Vec<u8> = (0..40).collect();
        record[COLOUR].copy_from_slice(&[255, 0, 7, 0, 0, 0]);
        widen_colour(&mut record);
        assert_eq!(record[COLOUR], [0, 255, 0, 7, 0, 0]);
        assert!(record[..COLOUR.start].iter().copied().eq(0..30) && record[COLOUR.end..] == [36, 37, 38, 39]);
    }

    #[test]
    fn keys_of_children_follow_the_octants() {
        let cube = Cube { min: [-5, 0, 7], edge: 1000 };
        let record: Vec<u8> = [495, 3, 1007].into_iter().flat_map(|c: i32| c.to_le_bytes()).collect();
        assert_eq!(cube.fine_cell(&record), [FINE_CELLS / 2, 3 * FINE_CELLS / 1000, FINE_CELLS - 1]);
        let key = Key::ROOT.child(0b101);
        assert_eq!((key.level, key.at), (1, [1, 0, 1]));
    }

    #[test]
    fn the_header_of_the_node_list_has_its_length() {
        assert_eq!(evlr_header(0).len(), 60);
        assert_eq!(&evlr_header(5)[20..28], &5u64.to_le_bytes());
    }
}
