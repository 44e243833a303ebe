//! Processing of the pairs of a pulse and a triangle from the blocks of some leaves, step by step: their
//! edges, the rays inside, planes, distances. Every step runs in a separate function, which has all registers
//! available, and fills a list for the next step without branching on the data.

use super::distance::{Heading, Plane, hit_merged};
use super::edges::{Edges, PulseExtent, by_axis};
use super::lanes::{PACKET_SIZE, PerPulse};
use super::packet::PacketFrustum;
use super::sides::Sides;
use super::spread::{Deviations, OriginOffsets};
use crate::RayGroup;
use crate::block::{BLOCK_SIZE, Block};
use crate::simd::{Simd, prefetch};
use vlscan_geom::DVec3;

/// Number of rays processed together.
pub(super) const SPAN: usize = 32;

/// Maximum number of pairs of a block.
pub(super) const MAX_BLOCK_PAIRS: usize = PACKET_SIZE * BLOCK_SIZE;

/// Number of blocks whose pairs are processed together. Every step waits for the one before; larger batches
/// reduce the number of waits.
pub(super) const MAX_PENDING_BLOCKS: usize = 2;

/// Minimum number of entries for pairs at which processing is worthwhile.
pub(super) const MIN_PENDING_PAIRS: usize = 32;

const MAX_PAIRS: usize = MIN_PENDING_PAIRS + MAX_BLOCK_PAIRS;

// Lengths of the lists: powers of two, so that an index is bounded by a mask.
const PAIRS_LEN: usize = (MAX_PAIRS + BLOCK_SIZE).next_power_of_two();
const SIDES_LEN: usize = (MAX_PAIRS / BLOCK_SIZE).next_power_of_two();
const PLANES_LEN: usize = (MAX_PAIRS + 1).next_power_of_two();
const CANDIDATES_LEN: usize = (MAX_PAIRS * SPAN / 8 + 1).next_power_of_two();
const _: () = assert!(MAX_PAIRS < 1 << 16);

/// Blocks whose pairs are pending.
pub(super) struct PendingBlocks<'a> {
    pub blocks: [Option<&'a Block>; MAX_PENDING_BLOCKS],
    /// Minimum depths of their triangles.
    pub near: [[f32; BLOCK_SIZE]; MAX_PENDING_BLOCKS],
    /// Maximum depths of their triangles.
    pub far: [[f32; BLOCK_SIZE]; MAX_PENDING_BLOCKS],
    pub count: usize,
}

impl PendingBlocks<'_> {
    pub const NONE: Self = PendingBlocks {
        blocks: [None; MAX_PENDING_BLOCKS],
        near: [[0.0; BLOCK_SIZE]; MAX_PENDING_BLOCKS],
        far: [[0.0; BLOCK_SIZE]; MAX_PENDING_BLOCKS],
        count: 0,
    };
}

/// The lists that the steps fill. A step may write one entry, or one register, beyond the entries that it
/// counts.
pub(super) struct CandidateLists {
    /// `block · 256 + pulse · 16 + lane`; the pairs of a block begin at a multiple of 16.
    pub pairs: [u32; PAIRS_LEN],
    /// Block and mask of each sixteen pairs.
    pub batches: [Batch; MAX_PAIRS / BLOCK_SIZE + 1],
    pub batch_count: usize,
    /// The edges of sixteen pairs each.
    sides: [Sides; SIDES_LEN],
    /// Indices in `pairs` of the pairs with all rays certainly inside.
    covered: [u32; PAIRS_LEN],
    covered_count: usize,
    /// Indices in `pairs` of the other pairs with possibly a ray inside.
    partial: [u32; PAIRS_LEN],
    partial_count: usize,
    /// Pairs with rays inside.
    pub inside: [Inside; PLANES_LEN],
    /// The planes of the pairs in `inside`.
    pub planes: [Plane; PLANES_LEN],
    pub candidates: [Candidates; CANDIDATES_LEN],
    /// Indices of pairs in `inside` that single precision leaves undecided, or of entries in `candidates` for
    /// which the fast distance is not valid.
    pub open: [u32; CANDIDATES_LEN],
}

/// Sixteen pairs: their block, and a mask of the entries in use.
#[derive(Clone, Copy)]
pub(super) struct Batch {
    pub block: u32,
    pub used: u32,
    /// The edges are computed, and the pairs listed.
    pub has_sides: bool,
}

#[derive(Clone, Copy)]
pub(super) struct Inside {
    pub pair: u32,
    pub strictly: u32,
    pub maybe: u32,
}

/// Eight rays that may be inside a triangle: from the lowest bit on, their register in 32 bits, the plane in
/// 16, and the masks of rays certainly inside and possibly inside, 8 each.
#[derive(Clone, Copy)]
pub(super) struct Candidates(u64);

impl Candidates {
    #[inline(always)]
    fn new(register: usize, plane: usize, strictly: u32, maybe: u32) -> Candidates {
        let masks = u64::from(strictly) << 48 | u64::from(maybe) << 56;
        Candidates(register as u64 | (plane as u64) << 32 | masks)
    }

    #[inline(always)]
    pub fn register(self) -> usize {
        self.0 as u32 as usize
    }

    #[inline(always)]
    pub fn plane(self) -> usize {
        (self.0 >> 32) as u16 as usize % PLANES_LEN
    }

    #[inline(always)]
    fn strictly(self) -> u32 {
        (self.0 >> 48) as u32 & 255
    }

    #[inline(always)]
    pub fn maybe(self) -> u32 {
        (self.0 >> 56) as u32
    }
}

impl CandidateLists {
    pub const EMPTY: CandidateLists = CandidateLists {
        pairs: [0; PAIRS_LEN],
        batches: [Batch { block: 0, used: 0, has_sides: false }; MAX_PAIRS / BLOCK_SIZE + 1],
        batch_count: 0,
        sides: [Sides::ZERO; SIDES_LEN],
        covered: [0; PAIRS_LEN],
        covered_count: 0,
        partial: [0; PAIRS_LEN],
        partial_count: 0,
        inside: [Inside { pair: 0, strictly: 0, maybe: 0 }; PLANES_LEN],
        planes: [Plane::ZERO; PLANES_LEN],
        candidates: [Candidates(0); CANDIDATES_LEN],
        open: [0; CANDIDATES_LEN],
    };
}

impl CandidateLists {
    pub fn clear(&mut self) {
        (self.batch_count, self.partial_count, self.covered_count) = (0, 0, 0);
    }

    /// Computes the edges of all triangles of a block, the pending one of this number, for one pulse, and
    /// lists those of the triangles `within` its depths that it may hit. Returns false if there are none. For
    /// one pulse this takes less time than the test of slopes and the edges of the triangles that pass it.
    #[inline(always)]
    pub fn pair_pulse<S: Simd>(
        &mut self,
        frustum: &PacketFrustum<S>,
        block: &Block,
        (slot, p): (usize, usize),
        within: u32,
    ) -> bool {
        let (simd, batch) = (frustum.simd, self.batch_count);
        let [any, all] = self.sides[batch % SIDES_LEN].set_pulse(frustum, block, p);
        let met = any & within;
        if met == 0 {
            return false;
        }
        let first = batch * BLOCK_SIZE;
        if let Some(pairs) = self.pairs[first..].first_chunk_mut() {
            simd.write_lanes(0xffff, (slot * MAX_BLOCK_PAIRS + p * BLOCK_SIZE) as u32, pairs);
        }
        let (partial, covered) = (met & !all, met & all);
        if let Some(free) = self.partial[self.partial_count..].first_chunk_mut() {
            simd.write_lanes(partial, first as u32, free);
        }
        if let Some(free) = self.covered[self.covered_count..].first_chunk_mut() {
            simd.write_lanes(covered, first as u32, free);
        }
        self.partial_count += partial.count_ones() as usize;
        self.covered_count += covered.count_ones() as usize;
        self.batches[batch] = Batch { block: slot as u32, used: met, has_sides: true };
        self.batch_count += 1;
        true
    }

    /// Mask of the pulses of the pairs that have some rays inside, and perhaps not all.
    #[inline(always)]
    pub fn partial_pulses(&self) -> u32 {
        let pulse = |n: &u32| 1 << pulse_of(self.pairs[*n as usize % PAIRS_LEN]);
        self.partial[..self.partial_count].iter().fold(0, |all, n| all | pulse(n))
    }
}

/// Returns the block of a pair, by its index among the pending blocks.
#[inline(always)]
pub(super) fn block_of(pair: u32) -> usize {
    pair as usize / MAX_BLOCK_PAIRS % MAX_PENDING_BLOCKS
}

/// Returns the pulse of a pair, by its number in the packet.
#[inline(always)]
pub(super) fn pulse_of(pair: u32) -> usize {
    pair as usize / BLOCK_SIZE % PACKET_SIZE
}

/// Returns the triangle of a pair, by its lane in the block.
#[inline(always)]
pub(super) fn lane_of(pair: u32) -> usize {
    pair as usize % BLOCK_SIZE
}

/// The rays of each pulse that have certainly hit something, and the depth up to which they all have. Used
/// only for pulses of one span.
pub(super) struct Occlusion {
    pub rays: [u32; PACKET_SIZE],
    pub depth: PerPulse,
}

impl Occlusion {
    pub const NONE: Occlusion =
        Occlusion { rays: [0; PACKET_SIZE], depth: PerPulse([f32::NEG_INFINITY; PACKET_SIZE]) };

    /// Returns the rays that have hit something entirely in front of the triangle of a pair, and so cannot
    /// hit it first.
    #[inline(always)]
    fn occluded_rays(&self, blocks: &PendingBlocks, pair: u32) -> u32 {
        let (pulse, near) = (pulse_of(pair), blocks.near[block_of(pair)][lane_of(pair)]);
        self.rays[pulse] & all_if(near > self.depth.0[pulse])
    }

    /// Records that these rays of a pair hit its triangle, unless it is partly behind the pulse's origin.
    #[inline(always)]
    fn mark_occluded(&mut self, blocks: &PendingBlocks, start: &PerPulse, pair: u32, rays: u32) {
        let (block, pulse, lane) = (block_of(pair), pulse_of(pair), lane_of(pair));
        let sure = rays & all_if(blocks.near[block][lane] > start.0[pulse]);
        self.rays[pulse] |= sure;
        let far = f32::from_bits(blocks.far[block][lane].to_bits() & all_if(sure != 0));
        let depth = &mut self.depth.0[pulse];
        *depth = if far > *depth { far } else { *depth };
    }
}

/// Returns all ones or zero, without a branch that would be mispredicted.
#[inline(always)]
fn all_if(condition: bool) -> u32 {
    u32::from(condition).wrapping_neg()
}

#[derive(Clone, Copy)]
pub(super) struct StepInput<'k, S: Simd> {
    /// The pending blocks.
    pub blocks: [Option<&'k Block>; MAX_PENDING_BLOCKS],
    /// The depths of the pending blocks.
    pub pending: &'k PendingBlocks<'k>,
    pub frustum: &'k PacketFrustum<S>,
    /// The vertices that blocks refer to.
    pub vertices: &'k [DVec3],
    pub deviations: &'k [Deviations],
    /// Origins of the rays of merged pulses; empty for others.
    pub offsets: &'k [OriginOffsets],
    /// Number of registers of sixteen rays per pulse.
    pub wide: usize,
    /// Index of the span of rays that is processed.
    pub span: usize,
}

/// Computes the edges of all pairs that have none yet, keeps the pairs whose pulse does not pass entirely
/// beside the triangle, and prefetches the corners of these triangles.
#[inline(always)]
pub(super) fn find_sides<S: Simd, const MERGED: bool>(
    simd: S,
    lists: &mut CandidateLists,
    input: StepInput<S>,
) {
    let StepInput { blocks, frustum, vertices, .. } = input;
    let batches = lists.batches[..lists.batch_count].iter().zip(lists.pairs.as_chunks::<BLOCK_SIZE>().0);
    let (mut partial_count, mut covered_count) = (lists.partial_count, lists.covered_count);
    for ((first, (batch, pairs)), sides) in (0..).step_by(BLOCK_SIZE).zip(batches).zip(&mut lists.sides) {
        if batch.has_sides {
            continue;
        }
        let Some(block) = blocks[batch.block as usize % MAX_PENDING_BLOCKS] else { continue };
        let [any, all] = sides.set::<S, MERGED>(frustum, block, pairs);
        let (partial, covered) = (batch.used & any & !all, batch.used & all);
        if let Some(free) = lists.partial[partial_count..].first_chunk_mut() {
            simd.write_lanes(partial, first, free);
        }
        partial_count += partial.count_ones() as usize;
        if let Some(free) = lists.covered[covered_count..].first_chunk_mut() {
            simd.write_lanes(covered, first, free);
        }
        covered_count += covered.count_ones() as usize;
    }
    (lists.partial_count, lists.covered_count) = (partial_count, covered_count);
    for n in lists.covered[..covered_count].iter().chain(&lists.partial[..partial_count]) {
        let pair = lists.pairs[*n as usize % PAIRS_LEN];
        let Some(block) = blocks[block_of(pair)] else { continue };
        for corner in &block.vertex {
            prefetch(vertices.as_ptr().wrapping_add(corner[lane_of(pair)] as usize));
        }
    }
}

/// Finds the rays of a span that pass within the triangles of the pairs. `valid` are the rays of the span,
/// including padding that repeats the last ray; without the padding no limit would ever be lowered. Returns
/// the number of pairs with such rays, and the number of these pairs that single precision leaves undecided.
#[inline(always)]
pub(super) fn find_inside<S: Simd, const MERGED: bool>(
    simd: S,
    lists: &mut CandidateLists,
    input: StepInput<S>,
    occlusion: &mut Occlusion,
    valid: u32,
) -> (usize, usize) {
    let StepInput { pending, frustum, deviations, offsets, wide, span, .. } = input;
    let (first, is_single) = (2 * span, wide <= 2);
    let (mut count, mut open_count) = (0, 0);
    let CandidateLists { pairs, sides, covered, covered_count, partial, partial_count, inside, open, .. } =
        lists;
    // Pulses entirely inside come first, because they occlude most of the others.
    for n in &covered[..*covered_count] {
        let pair = pairs[*n as usize % PAIRS_LEN];
        let rays = valid & !occlusion.occluded_rays(pending, pair);
        if is_single {
            occlusion.mark_occluded(pending, &frustum.start, pair, rays);
        }
        inside[count % PLANES_LEN] = Inside { pair, strictly: rays, maybe: rays };
        count += usize::from(rays != 0);
    }
    let mut left = 0;
    for n in 0..*partial_count {
        let index = partial[n];
        let occluded = occlusion.occluded_rays(pending, pairs[index as usize % PAIRS_LEN]);
        partial[left] = index;
        left += usize::from(valid & !occluded != 0);
    }
    for n in &partial[..left] {
        let n = *n as usize;
        let pair = pairs[n % PAIRS_LEN];
        let (sides, lane) = (&sides[n / BLOCK_SIZE % SIDES_LEN], n % BLOCK_SIZE);
        let row = pulse_of(pair) * wide + first;
        let (mut strictly, mut maybe) =
            sides.inside::<S, MERGED>(simd, lane, &deviations[row], offsets.get(row));
        if first + 1 < wide {
            let (s, m) = sides.inside::<S, MERGED>(simd, lane, &deviations[row + 1], offsets.get(row + 1));
            (strictly, maybe) = (strictly | s << 16, maybe | m << 16);
        }
        let valid = valid & !occlusion.occluded_rays(pending, pair);
        (strictly, maybe) = (strictly & valid, maybe & valid);
        if is_single {
            occlusion.mark_occluded(pending, &frustum.start, pair, strictly);
        }
        inside[count % PLANES_LEN] = Inside { pair, strictly, maybe };
        open[open_count % CANDIDATES_LEN] = count as u32;
        open_count += usize::from(strictly != maybe);
        count += usize::from(maybe != 0);
    }
    (count, open_count)
}

/// Decides in double precision the first `open` pairs that single precision leaves undecided.
#[inline(always)]
pub(super) fn refine_inside<S: Simd, const MERGED: bool>(
    simd: S,
    lists: &mut CandidateLists,
    input: StepInput<S>,
    open: usize,
) {
    let StepInput { blocks, frustum, vertices, deviations, offsets, wide, span, .. } = input;
    for n in &lists.open[..open] {
        let inside = &mut lists.inside[*n as usize % PLANES_LEN];
        let (pair, pulse) = (inside.pair, pulse_of(inside.pair));
        let Some(block) = blocks[block_of(pair)] else { continue };
        let corners = [0, 1, 2].map(|c| vertices[block.vertex[c][lane_of(pair)] as usize]);
        let extent = PulseExtent {
            width: f64::from(frustum.lane_shears.width.0[pulse]),
            reach: f64::from(frustum.lane_shears.reach.0[pulse]),
            origin_spread: frustum.origin_spread,
            scale: frustum.scale,
        };
        let row = pulse * wide + 2 * span;
        let shear = &frustum.shears[pulse];
        let edges = Edges::of::<S, MERGED>(simd, frustum.axes, shear, &extent, &by_axis(corners));
        let (mut strictly, mut maybe) = edges.inside::<S, MERGED>(simd, &deviations[row], offsets.get(row));
        if 2 * span + 1 < wide {
            let (s, m) = edges.inside::<S, MERGED>(simd, &deviations[row + 1], offsets.get(row + 1));
            (strictly, maybe) = (strictly | s << 16, maybe | m << 16);
        }
        inside.strictly = (inside.strictly | strictly) & inside.maybe;
        inside.maybe &= maybe;
    }
}

/// Computes the planes of the first `count` pairs in `inside` and the list of candidates. `first` is the
/// first register of eight rays of the first pulse's span, `stride` the number of registers per pulse.
/// Returns the length of the list and a mask of the pulses in it.
#[inline(always)]
pub(super) fn find_planes<S: Simd>(
    simd: S,
    lists: &mut CandidateLists,
    input: StepInput<S>,
    count: usize,
    (first, stride): (usize, usize),
) -> (usize, u32) {
    let StepInput { blocks, frustum, vertices, .. } = input;
    let (axis, forward) = (frustum.axes[0], f64::from(frustum.forward));
    let (mut listed, mut touched) = (0, 0);
    let CandidateLists { inside, planes, candidates, .. } = lists;
    for (n, (Inside { pair, strictly, maybe }, plane)) in inside[..count].iter().zip(planes).enumerate() {
        let (pulse, lane) = (pulse_of(*pair), lane_of(*pair));
        let Some(block) = blocks[block_of(*pair)] else { continue };
        let vertex = [block.vertex[0][lane], block.vertex[1][lane], block.vertex[2][lane]];
        let corners = vertex.map(|v| vertices[v as usize].as_ref());
        touched |= 1 << pulse;
        (plane.id, plane.vertex, plane.pulse) = (block.id[lane], vertex, pulse as u32);
        let heading = Heading { axis, forward, max_along: frustum.max_along[pulse] };
        plane.set(simd, corners, &frustum.shears[pulse].origin, heading);
        // Always all registers of a span, so that no branch depends on which rays hit.
        for register in 0..SPAN / 8 {
            let [sure, any] = [strictly, maybe].map(|m| m >> (8 * register) & 255);
            candidates[listed % CANDIDATES_LEN] =
                Candidates::new(first + pulse * stride + register, n, sure, any);
            listed += usize::from(any != 0);
        }
    }
    (listed, touched)
}

/// The rays and hits of a group, in registers of eight.
pub(super) struct RayRegisters<'k> {
    pub directions: [&'k [[f64; 8]]; 3],
    pub t: &'k mut [[f64; 8]],
    pub ids: &'k mut [[u32; 8]],
}

/// Computes the distances of the first `count` candidates. Returns the number of registers with rays for
/// which the fast arithmetic is not valid. `axis` is the dominant axis.
#[inline(always)]
pub(super) fn find_distances<S: Simd>(
    simd: S,
    lists: &mut CandidateLists,
    rays: RayRegisters,
    axis: usize,
    count: usize,
) -> usize {
    let RayRegisters { directions, t, ids } = rays;
    let along = directions[axis];
    let registers = along.len();
    // Equal lengths let the compiler check the index once for all slices.
    let [x, y, z] = directions.map(|d| &d[..registers]);
    let (t, ids) = (&mut t[..registers], &mut ids[..registers]);
    let CandidateLists { planes, candidates, open, .. } = lists;
    let mut open_count = 0;
    for (n, candidate) in candidates[..count].iter().enumerate() {
        let register = candidate.register();
        if register >= registers {
            continue;
        }
        let d = [&x[register], &y[register], &z[register]];
        let hits = (&mut t[register], &mut ids[register]);
        let plane = &planes[candidate.plane()];
        let sound = plane.hit(simd, candidate.strictly(), d, &along[register], hits);
        open[open_count % CANDIDATES_LEN] = n as u32;
        open_count += usize::from(candidate.maybe() & !sound != 0);
    }
    open_count
}

/// Computes the distances of merged pulses, the first `count` pairs in `inside`. `first` is the first
/// register of eight rays of the first pulse. Returns the number of registers with rays for which the fast
/// arithmetic is not valid, and a mask of the pulses that were tested.
#[inline(always)]
pub(super) fn find_merged_distances<S: Simd>(
    simd: S,
    lists: &mut CandidateLists,
    input: StepInput<S>,
    (rays, origins): (RayRegisters, [&[[f64; 8]]; 3]),
    (first, count): (usize, usize),
) -> (usize, u32) {
    const REGISTERS: usize = RayGroup::MERGED_RAYS / RayGroup::WIDTH;
    let StepInput { blocks, frustum, vertices, .. } = input;
    let RayRegisters { directions, t, ids } = rays;
    let (axis, forward) = (frustum.axes[0], f64::from(frustum.forward));
    let (mut open_count, mut touched) = (0, 0);
    let CandidateLists { inside, planes, candidates, open, .. } = lists;
    for (n, Inside { pair, strictly, maybe }) in inside[..count].iter().enumerate() {
        let (pulse, lane) = (pulse_of(*pair), lane_of(*pair));
        let Some(block) = blocks[block_of(*pair)] else { continue };
        let vertex = [block.vertex[0][lane], block.vertex[1][lane], block.vertex[2][lane]];
        let corners = vertex.map(|v| &vertices[v as usize]);
        touched |= 1 << pulse;
        let heading = Heading { axis, forward, max_along: frustum.max_along[pulse] };
        let plane = &mut planes[n % PLANES_LEN];
        (plane.id, plane.vertex, plane.pulse) = (block.id[lane], vertex, pulse as u32);
        for part in 0..REGISTERS {
            let register = first + pulse * REGISTERS + part;
            let [sure, any] = [strictly, maybe].map(|m| m >> (8 * part) & 255);
            if any == 0 || register >= t.len() {
                continue;
            }
            let (d, o) = (directions.map(|d| &d[register]), origins.map(|o| &o[register]));
            let hits = (&mut t[register], &mut ids[register], plane.id);
            let sound = hit_merged(simd, sure, corners, (d, o), heading, hits);
            candidates[open_count % CANDIDATES_LEN] = Candidates::new(register, n, sure, any);
            open[open_count % CANDIDATES_LEN] = open_count as u32;
            open_count += usize::from(any & !sound != 0);
        }
    }
    (open_count, touched)
}
