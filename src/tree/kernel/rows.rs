//! What becomes of the pairs of some blocks, step by step: their edges, the rays inside, planes, distances. Every step is a
//! function of its own, which has the registers to itself, and fills a list for the next without branching on what it
//! finds.

use super::edges::{Edges, by_axis};
use super::lanes::{Asides, Deviations, GROUP, Lanes, PerPulse};
use super::leaf::Lists;
use super::sides::Sides;
use super::verdict::{Plane, hit_apart};
use crate::geom::DVec3;
use crate::tree::block::LANES;
use crate::tree::simd::{Simd, Step, prefetch};
use crate::tree::{Geometry, RayGroup};

/// Rays that are looked at together.
pub(super) const SPAN: usize = 32;

/// Most pairs of a block.
pub(super) const PAIRS: usize = GROUP * LANES;

/// Blocks whose pairs are looked at together, and the places for pairs with which that is worth while. Every step waits
/// for the one before; the more pairs take it at once, the less often.
pub(super) const TOGETHER: usize = 2;
pub(super) const ENOUGH: usize = 32;

/// Places for pairs.
const PLACES: usize = ENOUGH + PAIRS;

/// Places for planes and for registers of rays; a power of two is quick to stay within.
const PAIR_ROOM: usize = (PLACES + LANES).next_power_of_two();
const SIDES: usize = (PLACES / LANES).next_power_of_two();
const PLANES: usize = (PLACES + 1).next_power_of_two();
const ASKED: usize = (PLACES * SPAN / 8 + 1).next_power_of_two();

/// Memory of the lists. Writers may go one place beyond, or one register.
pub(super) struct Rows {
    /// `block · 256 + pulse · 16 + lane`, those of a block from a multiple of 16 on.
    pub pairs: [u32; PAIR_ROOM],
    /// The block of each sixteen pairs, and which of them are meant.
    pub batches: [Batch; PLACES / LANES + 1],
    pub batch_count: usize,
    /// The edges of sixteen pairs each.
    pub sides: [Sides; SIDES],
    /// Places in `pairs` of those of which surely all rays are inside; the first `whole_count` are meant.
    pub whole: [u32; PAIR_ROOM],
    pub whole_count: usize,
    /// The same of the others of which any ray may be inside.
    pub kept: [u32; PAIR_ROOM],
    pub kept_count: usize,
    /// Pairs of which rays are inside.
    pub inside: [Inside; PLANES],
    /// Their planes.
    pub planes: [Plane; PLANES],
    /// Registers of rays that are asked for their distances.
    pub asked: [Asked; ASKED],
    /// Places in `inside` or in `asked` of what single precision, or the quick distance, leaves open.
    pub unsure: [u32; ASKED],
}

#[derive(Clone, Copy)]
pub(super) struct Batch {
    pub block: u32,
    pub meant: u32,
}

/// Eight rays that may be inside a triangle: from the lowest bit on the register that they are in, 32 bits, the plane, 16,
/// and which are surely and which may be inside, 8 each.
#[derive(Clone, Copy)]
pub(super) struct Asked(pub u64);
const _: () = assert!(PLACES < 1 << 16);

/// The rays of a span that pass within a triangle.
#[derive(Clone, Copy)]
pub(super) struct Inside {
    pub pair: u32,
    pub strictly: u32,
    pub maybe: u32,
}

impl Rows {
    pub const EMPTY: Rows = Rows {
        pairs: [0; PAIR_ROOM],
        batches: [Batch { block: 0, meant: 0 }; PLACES / LANES + 1],
        batch_count: 0,
        sides: [Sides::NONE; SIDES],
        whole: [0; PAIR_ROOM],
        whole_count: 0,
        kept: [0; PAIR_ROOM],
        kept_count: 0,
        inside: [Inside { pair: 0, strictly: 0, maybe: 0 }; PLANES],
        planes: [Plane::NONE; PLANES],
        asked: [Asked(0); ASKED],
        unsure: [0; ASKED],
    };
}

/// Parts of the number of a pair.
#[inline(always)]
pub(super) fn block_of(pair: u32) -> usize {
    pair as usize / PAIRS % TOGETHER
}

#[inline(always)]
pub(super) fn pulse_of(pair: u32) -> usize {
    pair as usize / LANES % GROUP
}

#[inline(always)]
pub(super) fn lane_of(pair: u32) -> usize {
    pair as usize % LANES
}

/// Computes the edges of all pairs; keeps the pairs whose pulse does not pass beside the triangle, and asks for the corners
/// of these.
pub(super) struct FindSides<'k, S: Simd, const PACKED: bool> {
    pub rows: &'k mut Rows,
    pub lists: &'k Lists<'k>,
    pub lanes: &'k Lanes<S>,
    pub vertices: &'k [DVec3],
}

impl<S: Simd, const PACKED: bool> Step<S> for FindSides<'_, S, PACKED> {
    type Out = ();

    #[inline(always)]
    unsafe fn run(self) {
        let FindSides { rows, lists, lanes, vertices } = self;
        let batches = rows.batches[..rows.batch_count].iter().zip(rows.pairs.as_chunks::<LANES>().0);
        let (mut kept_count, mut whole_count) = (0, 0);
        for ((first, (batch, pairs)), sides) in (0..).step_by(LANES).zip(batches).zip(&mut rows.sides) {
            let Some(block) = lists.blocks[batch.block as usize % TOGETHER] else { continue };
            // SAFETY: the caller vouches for the instruction set.
            unsafe {
                let [any, whole] = Sides::of::<S, PACKED>(sides, lanes, block, pairs);
                let (kept, whole) = (batch.meant & any & !whole, batch.meant & whole);
                if let Some(room) = rows.kept[kept_count..].first_chunk_mut() {
                    S::compress(kept, first, room);
                }
                kept_count += kept.count_ones() as usize;
                if let Some(room) = rows.whole[whole_count..].first_chunk_mut() {
                    S::compress(whole, first, room);
                }
                whole_count += whole.count_ones() as usize;
            }
        }
        (rows.kept_count, rows.whole_count) = (kept_count, whole_count);
        for n in rows.whole[..whole_count].iter().chain(&rows.kept[..kept_count]) {
            let pair = rows.pairs[*n as usize % PAIR_ROOM];
            let Some(block) = lists.blocks[block_of(pair)] else { continue };
            for corner in &block.vertex {
                prefetch(vertices.as_ptr().wrapping_add(corner[lane_of(pair)] as usize));
            }
        }
    }
}

/// Rays of each pulse that have surely hit something, and the depth up to which they all have. Kept for pulses of one span
/// only.
pub(super) struct Settled {
    pub rays: [u32; GROUP],
    pub depth: PerPulse,
}

impl Settled {
    /// The rays that have hit something wholly in front of the triangle of a pair, which they do not see.
    #[inline(always)]
    fn hidden(&self, lists: &Lists, pair: u32) -> u32 {
        let (pulse, near) = (pulse_of(pair), lists.near[block_of(pair)][lane_of(pair)]);
        self.rays[pulse] & all_if(near > self.depth.0[pulse])
    }

    /// Takes down that these rays of a pair hit its triangle, unless that is partly behind the pulse's origin.
    #[inline(always)]
    fn settle<S: Simd>(&mut self, lists: &Lists, lanes: &Lanes<S>, pair: u32, rays: u32) {
        let (block, pulse, lane) = (block_of(pair), pulse_of(pair), lane_of(pair));
        let sure = rays & all_if(lists.near[block][lane] > lanes.start.0[pulse]);
        self.rays[pulse] |= sure;
        let far = f32::from_bits(lists.far[block][lane].to_bits() & all_if(sure != 0));
        let depth = &mut self.depth.0[pulse];
        *depth = if far > *depth { far } else { *depth };
    }
}

/// All ones or none, without a branch that nobody could foresee.
#[inline(always)]
fn all_if(condition: bool) -> u32 {
    u32::from(condition).wrapping_neg()
}

/// Finds the rays of a span that pass within the triangles of the pairs; returns how many pairs have any, and how many of
/// these single precision leaves open.
pub(super) struct FindInside<'k, S: Simd, const PACKED: bool> {
    pub rows: &'k mut Rows,
    pub lists: &'k Lists<'k>,
    pub lanes: &'k Lanes<S>,
    pub deviations: &'k [Deviations],
    pub asides: &'k [Asides],
    pub settled: &'k mut Settled,
    pub span: usize,
    /// Registers of sixteen rays per pulse.
    pub wide: usize,
    /// Rays of the span; those that repeat the last count, or no limit would ever be lowered.
    pub valid: u32,
}

impl<S: Simd, const PACKED: bool> Step<S> for FindInside<'_, S, PACKED> {
    type Out = (usize, usize);

    #[inline(always)]
    unsafe fn run(self) -> (usize, usize) {
        let FindInside { rows, lists, lanes, deviations, asides, settled, span, wide, valid } = self;
        let (first, single) = (2 * span, wide <= 2);
        let (mut count, mut unsure) = (0, 0);
        let Rows { pairs, sides, whole, whole_count, kept, kept_count, inside, unsure: open, .. } = rows;
        // Pulses that are inside as a whole first: they hide most of the others.
        for n in &whole[..*whole_count] {
            let pair = pairs[*n as usize % PAIR_ROOM];
            let rays = valid & !settled.hidden(lists, pair);
            if single {
                settled.settle(lists, lanes, pair, rays);
            }
            inside[count % PLANES] = Inside { pair, strictly: rays, maybe: rays };
            count += usize::from(rays != 0);
        }
        let mut left = 0;
        for n in 0..*kept_count {
            let place = kept[n];
            let hidden = settled.hidden(lists, pairs[place as usize % PAIR_ROOM]);
            kept[left] = place;
            left += usize::from(valid & !hidden != 0);
        }
        for n in &kept[..left] {
            let n = *n as usize;
            let pair = pairs[n % PAIR_ROOM];
            let (sides, row) = (&sides[n / LANES % SIDES], pulse_of(pair) * wide + first);
            // SAFETY: the caller vouches for the instruction set.
            let (mut strictly, mut maybe) =
                unsafe { sides.inside::<S, PACKED>(n % LANES, &deviations[row], asides.get(row)) };
            if first + 1 < wide {
                // SAFETY: as above.
                let (s, m) = unsafe {
                    sides.inside::<S, PACKED>(n % LANES, &deviations[row + 1], asides.get(row + 1))
                };
                (strictly, maybe) = (strictly | s << 16, maybe | m << 16);
            }
            let valid = valid & !settled.hidden(lists, pair);
            (strictly, maybe) = (strictly & valid, maybe & valid);
            if single {
                settled.settle(lists, lanes, pair, strictly);
            }
            inside[count % PLANES] = Inside { pair, strictly, maybe };
            open[unsure % ASKED] = count as u32;
            unsure += usize::from(strictly != maybe);
            count += usize::from(maybe != 0);
        }
        (count, unsure)
    }
}

/// Decides from double precision about the first `unsure` pairs that single precision leaves open.
pub(super) struct LookClosely<'k, S: Simd, const PACKED: bool> {
    pub rows: &'k mut Rows,
    pub lists: &'k Lists<'k>,
    pub lanes: &'k Lanes<S>,
    pub deviations: &'k [Deviations],
    pub asides: &'k [Asides],
    pub geometry: &'k Geometry,
    pub span: usize,
    pub wide: usize,
    pub unsure: usize,
}

impl<S: Simd, const PACKED: bool> Step<S> for LookClosely<'_, S, PACKED> {
    type Out = ();

    #[inline(always)]
    unsafe fn run(self) {
        let LookClosely { rows, lists, lanes, deviations, asides, geometry, span, wide, unsure } = self;
        for n in &rows.unsure[..unsure] {
            let inside = &mut rows.inside[*n as usize % PLANES];
            let (pair, pulse) = (inside.pair, pulse_of(inside.pair));
            let Some(block) = lists.blocks[block_of(pair)] else { continue };
            let corners = [0, 1, 2].map(|c| geometry.vertices[block.vertex[c][lane_of(pair)] as usize]);
            let width = f64::from(lanes.view.width.0[pulse]);
            let row = pulse * wide + 2 * span;
            // SAFETY: the caller vouches for the instruction set.
            unsafe {
                let start = (f64::from(lanes.view.reach.0[pulse]), lanes.spread, lanes.scale);
                let edges =
                    Edges::of::<S, PACKED>(lanes.axes, &lanes.eyes[pulse], width, start, &by_axis(corners));
                let (mut strictly, mut maybe) = edges.inside::<S, PACKED>(&deviations[row], asides.get(row));
                if 2 * span + 1 < wide {
                    let (s, m) = edges.inside::<S, PACKED>(&deviations[row + 1], asides.get(row + 1));
                    (strictly, maybe) = (strictly | s << 16, maybe | m << 16);
                }
                inside.strictly = (inside.strictly | strictly) & inside.maybe;
                inside.maybe &= maybe;
            }
        }
    }
}

/// Computes the planes of the first `count` pairs in `inside` and the list of registers to ask; returns the length of that
/// list and the pulses that are in it.
pub(super) struct FindPlanes<'k, S: Simd> {
    pub rows: &'k mut Rows,
    pub lists: &'k Lists<'k>,
    pub lanes: &'k Lanes<S>,
    pub geometry: &'k Geometry,
    pub count: usize,
    /// The first register of eight rays of the first pulse's span, and how many registers a pulse has.
    pub first: usize,
    pub stride: usize,
}

impl<S: Simd> Step<S> for FindPlanes<'_, S> {
    type Out = (usize, u32);

    #[inline(always)]
    unsafe fn run(self) -> (usize, u32) {
        let FindPlanes { rows, lists, lanes, geometry, count, first, stride } = self;
        let (k, forward) = (lanes.axes[0], f64::from(lanes.forward));
        let (mut asked, mut touched) = (0, 0);
        let Rows { inside, planes, asked: list, .. } = rows;
        for (n, (Inside { pair, strictly, maybe }, plane)) in
            inside[..count].iter().zip(&mut *planes).enumerate()
        {
            let (pulse, lane) = (pulse_of(*pair), lane_of(*pair));
            let Some(block) = lists.blocks[block_of(*pair)] else { continue };
            let vertex = [block.vertex[0][lane], block.vertex[1][lane], block.vertex[2][lane]];
            let [a, b, c] = vertex.map(|v| geometry.vertices[v as usize].as_ref());
            touched |= 1 << pulse;
            (plane.id, plane.vertex, plane.pulse) = (block.id[lane], vertex, pulse as u32);
            let origin = &lanes.eyes[pulse].origin;
            // SAFETY: the caller vouches for the instruction set.
            unsafe { plane.set::<S>([a, b, c], origin, k, forward, lanes.steepest[pulse]) };
            let common = (first + pulse * stride) as u64 | (n as u64) << 32;
            // Always all registers of a span, so that no branch depends on who hits what.
            for register in 0..SPAN / 8 {
                let [sure, any] = [strictly, maybe].map(|m| u64::from(m >> (8 * register) & 255));
                list[asked % ASKED] = Asked((common + register as u64) | sure << 48 | any << 56);
                asked += usize::from(any != 0);
            }
        }
        (asked, touched)
    }
}

/// Finds the distances of the first `count` registers asked for; returns how many have rays for which that was too quick.
pub(super) struct FindDistances<'k> {
    pub rows: &'k mut Rows,
    pub directions: [&'k [[f64; 8]]; 3],
    pub along: &'k [[f64; 8]],
    pub t: &'k mut [[f64; 8]],
    pub ids: &'k mut [[u32; 8]],
    pub count: usize,
}

impl<S: Simd> Step<S> for FindDistances<'_> {
    type Out = usize;

    #[inline(always)]
    unsafe fn run(self) -> usize {
        let FindDistances { rows, directions: [x, y, z], along, t, ids, count } = self;
        let registers = along.len();
        assert!([x.len(), y.len(), z.len(), t.len(), ids.len()] == [registers; 5]);
        let Rows { planes, asked, unsure: open, .. } = rows;
        let mut unsure = 0;
        for (n, Asked(asked)) in asked[..count].iter().enumerate() {
            let (register, plane) = (*asked as u32 as usize, (asked >> 32) as u16 as usize);
            let (strictly, maybe) = ((asked >> 48) as u32 & 255, (asked >> 56) as u32);
            if register >= registers {
                continue;
            }
            let plane = &planes[plane % PLANES];
            // SAFETY: the register is within all of them, which are of one length; the caller vouches for the
            // instruction set.
            let sound = unsafe {
                let d = [x.get_unchecked(register), y.get_unchecked(register), z.get_unchecked(register)];
                let (t, ids) = (t.get_unchecked_mut(register), ids.get_unchecked_mut(register));
                plane.hit::<S>(strictly, d, along.get_unchecked(register), t, ids)
            };
            open[unsure % ASKED] = n as u32;
            unsure += usize::from(maybe & !sound != 0);
        }
        unsure
    }
}

/// Finds the distances of packets, the first `count` pairs in `inside`; returns how many registers have rays for which that
/// was too quick, and the pulses that were asked.
pub(super) struct FindFromPackets<'k, S: Simd> {
    pub rows: &'k mut Rows,
    pub lists: &'k Lists<'k>,
    pub lanes: &'k Lanes<S>,
    pub geometry: &'k Geometry,
    pub directions: [&'k [[f64; 8]]; 3],
    pub origins: [&'k [[f64; 8]]; 3],
    pub t: &'k mut [[f64; 8]],
    pub ids: &'k mut [[u32; 8]],
    pub count: usize,
    /// The first register of eight rays of the first packet.
    pub first: usize,
}

impl<S: Simd> Step<S> for FindFromPackets<'_, S> {
    type Out = (usize, u32);

    #[inline(always)]
    unsafe fn run(self) -> (usize, u32) {
        let FindFromPackets { rows, lists, lanes, geometry, directions, origins, t, ids, count, first } =
            self;
        let ([k, ..], forward) = (lanes.axes, f64::from(lanes.forward));
        let (mut unsure, mut touched) = (0, 0);
        let Rows { inside, planes, asked: list, unsure: open, .. } = rows;
        for (n, Inside { pair, strictly, maybe }) in inside[..count].iter().enumerate() {
            let (pulse, lane) = (pulse_of(*pair), lane_of(*pair));
            let Some(block) = lists.blocks[block_of(*pair)] else { continue };
            let vertex = [block.vertex[0][lane], block.vertex[1][lane], block.vertex[2][lane]];
            let corners = vertex.map(|v| &geometry.vertices[v as usize]);
            touched |= 1 << pulse;
            let plane = &mut planes[n % PLANES];
            (plane.id, plane.vertex, plane.pulse) = (block.id[lane], vertex, pulse as u32);
            for part in 0..RayGroup::PACKET / RayGroup::LANES {
                let register = first + pulse * (RayGroup::PACKET / RayGroup::LANES) + part;
                let [sure, any] = [strictly, maybe].map(|m| m >> (8 * part) & 255);
                if any == 0 || register >= t.len() {
                    continue;
                }
                let (d, o) = (directions.map(|d| &d[register]), origins.map(|o| &o[register]));
                // SAFETY: the caller vouches for the instruction set.
                let sound = unsafe {
                    let towards = (k, forward, lanes.steepest[pulse]);
                    let (t, ids) = (&mut t[register], &mut ids[register]);
                    hit_apart::<S>(sure, corners, (d, o), towards, (t, ids, plane.id))
                };
                let asked =
                    (register as u64) | (n as u64) << 32 | u64::from(sure) << 48 | u64::from(any) << 56;
                (list[unsure % ASKED], open[unsure % ASKED]) = (Asked(asked), unsure as u32);
                unsure += usize::from(any & !sound != 0);
            }
        }
        (unsure, touched)
    }
}
