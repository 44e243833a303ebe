//! Tracing many pulses: up to sixteen neighbours walk the tree together.
//!
//! A pulse alone is a handful of nodes and triangles, so that most of its time goes into mispredicted branches and
//! waiting for memory. A group shares every decision among some hundred rays: lanes are the children of a node, then the
//! pulses, then the triangles of a block, then pairs of a pulse and a triangle, and at last the rays of one pulse for one
//! triangle, where the verdicts fall. Pulses of few rays share that last place with their neighbours: packets of sixteen
//! rays, each with its own origin, stand in for pulses.
//!
//! | file | what it does |
//! |---|---|
//! | `lanes`, `spread` | sixteen pulses side by side, and how their rays spread |
//! | `walk`, `filter` | nodes and boxes against them |
//! | `leaf` | which pulse may meet which triangle of a block: pairs |
//! | `rows` | what becomes of the pairs, step by step |
//! | `sides`, `edges` | which rays are inside: from single precision, and from double where that leaves it open |
//! | `verdict` | distances |
//! | `placed` | instances: which of them a group meets, and their triangles in its frame |

mod edges;
mod filter;
mod lanes;
mod leaf;
mod placed;
mod rows;
mod sides;
mod spread;
mod verdict;
mod walk;

use super::rays::{Hits, RayGroup};
use super::simd::{Level, portable::Portable};
use super::{Geometry, Hit, RayBundle, Tree};
use crate::geom::DVec3;
use lanes::{Asides, Deviations, GROUP, Lanes, PerPulse};
use std::cell::RefCell;
use std::ops::Range;

thread_local! {
    /// A group of one pulse, and its hits.
    static PULSE: RefCell<(RayGroup, Hits)> = RefCell::default();
    /// Pulses of few rays as packets, the hits of these, and where those belong.
    static PACKETS: RefCell<(RayGroup, Hits, Vec<u32>)> = RefCell::default();
    static SCRATCH: RefCell<Box<Scratch>> = RefCell::new(Box::new(Scratch::EMPTY));
}

impl Tree {
    /// First hits of all rays of many pulses. Ray `r` of pulse `p` has its hit at `p · rays.stride() + r`; places between
    /// rows hold nothing of interest. `hits` is resized and overwritten.
    ///
    /// Runs of neighbouring pulses are traced together, by the widest instructions that the machine has. The hits are
    /// those of [`Tree::nearest`] for each ray, bit for bit.
    pub fn trace_group(&self, geometry: &Geometry, rays: &RayGroup, hits: &mut Hits) {
        self.trace_group_on(Level::best(), geometry, rays, hits);
        if let Some(placed) = &self.placed {
            placed.trace_group_on(Level::best(), geometry, rays, hits);
        }
    }

    /// First hits of all rays of a bundle; `hits` is resized and overwritten. For many pulses
    /// [`Tree::trace_group`] is several times faster.
    pub fn trace(&self, geometry: &Geometry, rays: &RayBundle, hits: &mut Hits) {
        PULSE.with_borrow_mut(|(pulse, _)| {
            pulse.clear(rays.len());
            pulse.push(rays.origin, |x, y, z| {
                x.copy_from_slice(&rays.x);
                y.copy_from_slice(&rays.y);
                z.copy_from_slice(&rays.z);
            });
            self.trace_group(geometry, pulse, hits);
        });
        hits.t.truncate(rays.len());
        hits.primitive.truncate(rays.len());
    }

    /// First hit of the ray `origin + t·direction`, t > 0 in units of `direction`. Directions are meant to be of about
    /// unit length; one shorter than 1e-100 hits nothing.
    pub fn nearest(&self, geometry: &Geometry, origin: DVec3, direction: DVec3) -> Option<Hit> {
        PULSE.with_borrow_mut(|(pulse, hits)| {
            pulse.clear(1);
            pulse.push(origin, |x, y, z| (x[0], y[0], z[0]) = (direction.x, direction.y, direction.z));
            self.trace_group(geometry, pulse, hits);
            let (t, primitive) = (*hits.t.first()?, *hits.primitive.first()?);
            (primitive != Hits::MISS).then_some(Hit { t, primitive })
        })
    }

    /// [`Tree::trace_group`] on a given instruction set.
    pub(super) fn trace_group_on(&self, level: Level, geometry: &Geometry, rays: &RayGroup, hits: &mut Hits) {
        hits.make_room(rays.len() * rays.stride());
        if rays.rays() == 0 {
            return;
        }
        if rays.rays() <= RayGroup::FEW && !rays.is_packed() {
            PACKETS.with_borrow_mut(|(packets, packed, places)| {
                packets.pack(rays, places);
                self.trace_group_on(level, geometry, packets, packed);
                hits.unpack(packed, places);
            });
            return;
        }
        SCRATCH.with_borrow_mut(|scratch| match level {
            // SAFETY: plain Rust needs no target feature.
            Level::Portable => unsafe { Kernel::<Portable>::trace(self, geometry, rays, hits, scratch) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the level is available only where the features are.
            Level::Avx2 => unsafe { trace_avx2(self, geometry, rays, hits, scratch) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Level::Avx512 => unsafe { trace_avx512(self, geometry, rays, hits, scratch) },
        });
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,popcnt,bmi1,bmi2,lzcnt")]
fn trace_avx2(tree: &Tree, geometry: &Geometry, rays: &RayGroup, hits: &mut Hits, scratch: &mut Scratch) {
    // SAFETY: this function carries the features.
    unsafe { Kernel::<super::simd::avx2::Avx2>::trace(tree, geometry, rays, hits, scratch) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,avx2,popcnt,bmi1,bmi2,lzcnt")]
fn trace_avx512(tree: &Tree, geometry: &Geometry, rays: &RayGroup, hits: &mut Hits, scratch: &mut Scratch) {
    // SAFETY: this function carries the features.
    unsafe { Kernel::<super::simd::avx512::Avx512>::trace(tree, geometry, rays, hits, scratch) }
}

/// A group of pulses on its way through the tree.
struct Kernel<'a, S: super::simd::Simd> {
    geometry: &'a Geometry,
    rays: &'a RayGroup,
    directions: [&'a [[f64; 8]]; 3],
    t: &'a mut [[f64; 8]],
    ids: &'a mut [[u32; 8]],
    /// Registers of eight rays per pulse, of sixteen, and spans.
    registers: usize,
    wide: usize,
    spans: usize,
    /// Number of the group's first pulse.
    first: usize,
    lanes: Lanes<S>,
    deviations: &'a [Deviations],
    /// Where the rays of packets start; nothing else has any.
    asides: &'a [Asides],
    /// Depth beyond which nothing can be nearer than what each pulse has hit.
    limit: PerPulse,
    settled: rows::Settled,
    stacks: &'a mut walk::Stacks,
    /// Blocks whose pairs wait to be looked at.
    lists: leaf::Lists<'a>,
    rows: &'a mut rows::Rows,
    /// In a tree over instances: those that have been met.
    met: Option<&'a mut Vec<placed::Met>>,
    /// In the tree of a model: the instance.
    standing: Option<placed::Standing<'a>>,
}

/// What a walk needs room for; cleared by nobody.
struct Scratch {
    deviations: Vec<Deviations>,
    asides: Vec<Asides>,
    stacks: walk::Stacks,
    rows: rows::Rows,
}

impl Scratch {
    const EMPTY: Scratch = Scratch {
        deviations: Vec::new(),
        asides: Vec::new(),
        stacks: walk::Stacks::EMPTY,
        rows: rows::Rows::EMPTY,
    };
}

impl<S: super::simd::Simd> Kernel<'_, S> {
    /// # Safety
    /// As for [`Simd`](super::simd::Simd).
    #[inline(always)]
    unsafe fn trace(
        tree: &Tree,
        geometry: &Geometry,
        rays: &RayGroup,
        hits: &mut Hits,
        scratch: &mut Scratch,
    ) {
        let wide = rays.stride().div_ceil(16);
        scratch.deviations.resize(GROUP * wide, [[0.0; 16]; 2]);
        scratch.asides.resize(if rays.is_packed() { GROUP * wide } else { 0 }, [[0.0; 16]; 3]);
        let mut first = 0;
        while first < rays.len() {
            let mut count = lanes::neighbours(rays, first);
            hits.clear(first * rays.stride()..(first + count) * rays.stride());
            loop {
                // SAFETY: the caller vouches for the instruction set.
                if unsafe {
                    Kernel::<S>::trace_together(tree, geometry, rays, first..first + count, hits, scratch)
                } {
                    break;
                }
                if count == 1 {
                    trace_apart(tree, geometry, rays, first, hits);
                    break;
                }
                // Perhaps the first alone has a dominant axis.
                count = 1;
            }
            first += count;
        }
    }

    /// A walk of the pulses from `first` on, which are in `lanes`; no limit allows them to meet anything yet.
    #[inline(always)]
    fn of<'a>(
        geometry: &'a Geometry,
        rays: &'a RayGroup,
        first: usize,
        (t, ids): (&'a mut [[f64; 8]], &'a mut [[u32; 8]]),
        lanes: Lanes<S>,
        scratch: &'a mut Scratch,
    ) -> Kernel<'a, S> {
        Kernel {
            geometry,
            rays,
            directions: [0, 1, 2].map(|a| rays.lanes(a)),
            t,
            ids,
            registers: rays.stride() / RayGroup::LANES,
            wide: rays.stride().div_ceil(16),
            spans: rays.stride().div_ceil(32),
            first,
            lanes,
            deviations: &scratch.deviations,
            asides: if rays.is_packed() { &scratch.asides } else { &[] },
            limit: PerPulse([f32::NEG_INFINITY; GROUP]),
            settled: rows::Settled { rays: [0; GROUP], depth: PerPulse([f32::NEG_INFINITY; GROUP]) },
            stacks: &mut scratch.stacks,
            lists: leaf::Lists::EMPTY,
            rows: &mut scratch.rows,
            met: None,
            standing: None,
        }
    }

    /// Traces some pulses together, if they can be.
    ///
    /// # Safety
    /// As for [`Simd`](super::simd::Simd).
    #[inline(always)]
    unsafe fn trace_together(
        tree: &Tree,
        geometry: &Geometry,
        rays: &RayGroup,
        pulses: Range<usize>,
        hits: &mut Hits,
        scratch: &mut Scratch,
    ) -> bool {
        let (deviations, asides) = (&mut scratch.deviations, &mut scratch.asides);
        // SAFETY: the caller vouches for the instruction set.
        let Some(lanes) =
            (unsafe { Lanes::<S>::of(&tree.frame, rays, pulses.clone(), deviations, asides, 0.0) })
        else {
            return false;
        };
        let mut kernel = Kernel::of(geometry, rays, pulses.start, hits.registers(), lanes, scratch);
        kernel.limit.0[..pulses.len()].fill(f32::INFINITY);
        // SAFETY: as above.
        unsafe { kernel.walk(tree, (1 << pulses.len()) - 1) };
        true
    }
}

/// Traces one pulse ray by ray.
#[cold]
fn trace_apart(tree: &Tree, geometry: &Geometry, rays: &RayGroup, pulse: usize, hits: &mut Hits) {
    for r in 0..rays.rays() {
        if let Some(hit) =
            tree.nearest_where(geometry, rays.origin_of(pulse, r), rays.direction(pulse, r), |_| true)
        {
            let at = pulse * rays.stride() + r;
            (hits.t[at], hits.primitive[at]) = (hit.t, hit.primitive);
        }
    }
}
