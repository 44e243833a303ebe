//! Instances: a group walks the tree over their boxes once, and then, nearest first, the trees of the models that stand
//! where it passes. There the rays are those of the model's frame, and so are all decisions of single precision; what these
//! leave open, and all distances, come from the corners where they stand, as if they were stored.

use super::lanes::{GROUP, Lanes, neighbours};
use super::leaf::Lists;
use super::rows::{Inside, Rows, SPAN, block_of, lane_of, pulse_of};
use super::verdict::{Rays, ask};
use super::{Kernel, Scratch};
use crate::geom::DVec3;
use crate::tree::block::{Block, LANES};
use crate::tree::instances::{Instance, Inward};
use crate::tree::placed::Placed;
use crate::tree::simd::{Level, Simd, Step};
use crate::tree::{Geometry, Hits, RayGroup};
use std::cell::RefCell;
use std::ops::Range;

thread_local! {
    static SCRATCH: RefCell<Box<Scratches>> = RefCell::new(Box::new(Scratches {
        top: Scratch::EMPTY,
        model: Scratch::EMPTY,
        met: Vec::new(),
        inward: RayGroup::default(),
    }));
}

/// What walks through both levels need room for.
struct Scratches {
    top: Scratch,
    model: Scratch,
    met: Vec<Met>,
    inward: RayGroup,
}

/// An instance whose box pulses of a group meet, and the least depth of that.
#[derive(Clone, Copy)]
pub(super) struct Met {
    enter: f32,
    pulses: u32,
    instance: u32,
}

/// Where a model stands, and the rays as they are there.
pub(super) struct Standing<'a> {
    instance: &'a Instance,
    /// Of the model.
    vertices: &'a [DVec3],
    /// Moves the scene's frame.
    shift: DVec3,
    /// Directions of the pulses that the walk is about.
    directions: [&'a [[f64; 8]]; 3],
    registers: usize,
    /// Axis along which they run, and its sign.
    along: usize,
    forward: f64,
    /// Of each pulse.
    origins: [DVec3; GROUP],
    steepest: [f64; GROUP],
}

impl Placed {
    /// Finds what a group hits among the instances, where that is not farther than the `hits` given.
    pub(in crate::tree) fn trace_nearer_on(
        &self,
        level: Level,
        geometry: &Geometry,
        rays: &RayGroup,
        hits: &mut Hits,
    ) {
        SCRATCH.with_borrow_mut(|scratch| match level {
            // SAFETY: plain Rust needs no target feature.
            Level::Portable => unsafe {
                trace::<crate::tree::simd::portable::Portable>(self, geometry, rays, hits, scratch);
            },
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
fn trace_avx2(
    placed: &Placed,
    geometry: &Geometry,
    rays: &RayGroup,
    hits: &mut Hits,
    scratch: &mut Scratches,
) {
    // SAFETY: this function carries the features.
    unsafe { trace::<crate::tree::simd::avx2::Avx2>(placed, geometry, rays, hits, scratch) }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq,avx2,popcnt,bmi1,bmi2,lzcnt")]
fn trace_avx512(
    placed: &Placed,
    geometry: &Geometry,
    rays: &RayGroup,
    hits: &mut Hits,
    scratch: &mut Scratches,
) {
    // SAFETY: this function carries the features.
    unsafe { trace::<crate::tree::simd::avx512::Avx512>(placed, geometry, rays, hits, scratch) }
}

/// # Safety
/// As for [`Simd`].
#[inline(always)]
unsafe fn trace<S: Simd>(
    placed: &Placed,
    geometry: &Geometry,
    rays: &RayGroup,
    hits: &mut Hits,
    scratch: &mut Scratches,
) {
    let wide = rays.stride().div_ceil(16);
    scratch.top.deviations.resize(GROUP * wide, [[0.0; 16]; 2]);
    scratch.model.deviations.resize(GROUP * wide, [[0.0; 16]; 2]);
    let mut first = 0;
    while first < rays.len() {
        let mut count = neighbours(rays, first);
        loop {
            let pulses = first..first + count;
            // SAFETY: the caller vouches for the instruction set.
            if unsafe { trace_together::<S>(placed, geometry, rays, pulses, hits, scratch) } {
                break;
            }
            if count == 1 {
                placed.trace_pulse(rays, first, hits);
                break;
            }
            // Perhaps the first alone has a dominant axis.
            count = 1;
        }
        first += count;
    }
}

/// Traces some pulses together, if they can be.
///
/// # Safety
/// As for [`Simd`].
#[inline(always)]
unsafe fn trace_together<S: Simd>(
    placed: &Placed,
    geometry: &Geometry,
    rays: &RayGroup,
    pulses: Range<usize>,
    hits: &mut Hits,
    scratch: &mut Scratches,
) -> bool {
    let Scratches { top, model, met, inward } = scratch;
    // SAFETY: the caller vouches for the instruction set.
    let Some(lanes) = (unsafe {
        Lanes::<S>::of(&placed.top.frame, rays, pulses.clone(), &mut top.deviations, &mut [], 0.0)
    }) else {
        return false;
    };
    met.clear();
    let all = (1u32 << pulses.len()) - 1;
    let mut kernel = Kernel::of(geometry, rays, pulses.start, hits.registers(), lanes, top);
    kernel.met = Some(met);
    // SAFETY: as above.
    unsafe {
        kernel.open(all);
        kernel.walk(&placed.top, all);
    }
    let Some(met) = kernel.met.take() else { return true };
    met.sort_unstable_by(|a, b| a.enter.total_cmp(&b.enter));
    for Met { enter, pulses, instance } in met.iter() {
        // SAFETY: as above.
        unsafe {
            let pulses = pulses & kernel.within_limit(*enter);
            if pulses != 0 {
                kernel.visit(placed, *instance, pulses, model, inward);
                kernel.lower_limits(pulses);
            }
        }
    }
    true
}

impl<'a, S: Simd> Kernel<'a, S> {
    /// Sets the limits of the `pulses` meant from what they have hit already.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn open(&mut self, pulses: u32) {
        // SAFETY: the caller vouches for the instruction set.
        unsafe { self.lower_limits(pulses) };
    }

    /// Brings an instance into the hits of the `pulses`.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn visit(
        &mut self,
        placed: &Placed,
        number: u32,
        pulses: u32,
        scratch: &mut Scratch,
        inward: &mut RayGroup,
    ) {
        let instance = &placed.instances.all[number as usize];
        let below = pulses.trailing_zeros() as usize;
        let span = below..GROUP.min(32 - pulses.leading_zeros() as usize);
        let pulses = pulses >> below;
        // SAFETY: the caller vouches for the instruction set.
        let entered = unsafe { self.enter(placed, instance, span.clone(), pulses, scratch, inward) };
        let mut rest = if entered { 0 } else { pulses };
        while rest != 0 {
            let pulse = self.first + span.start + rest.trailing_zeros() as usize;
            let row = pulse * self.registers..(pulse + 1) * self.registers;
            let (t, ids) = (self.t[row.clone()].as_flattened_mut(), self.ids[row].as_flattened_mut());
            placed.visit_pulse(instance, self.rays, pulse, t, ids);
            rest &= rest - 1;
        }
    }

    /// Walks the model's tree with those of the pulses in `span` that are in `pulses`, if they can be taken into its frame
    /// together.
    ///
    /// # Safety
    /// As for [`Simd`].
    #[inline(always)]
    unsafe fn enter(
        &mut self,
        placed: &Placed,
        instance: &Instance,
        span: Range<usize>,
        pulses: u32,
        scratch: &mut Scratch,
        inward: &mut RayGroup,
    ) -> bool {
        let Some(way) = placed.instances.inward(instance) else { return false };
        let tree = &placed.models[instance.model as usize];
        let (first, count) = (self.first + span.start, span.len());
        // SAFETY: the caller vouches for the instruction set.
        let Some(lanes) = (unsafe {
            let off =
                S::apart(TurnInward { inward, rays: self.rays, pulses: first..first + count, way: &way });
            Lanes::<S>::of(
                &tree.frame,
                inward,
                0..count,
                &mut scratch.deviations,
                &mut [],
                off * tree.frame.scale,
            )
        }) else {
            return false;
        };
        let (mut origins, mut steepest) = ([DVec3::ZERO; GROUP], [0.0; GROUP]);
        for p in 0..count {
            (origins[p], steepest[p]) = (self.rays.origin(first + p), self.lanes.steepest[span.start + p]);
        }
        let registers = self.registers;
        let rows = first * registers..(first + count) * registers;
        let (t, ids) = (&mut self.t[rows.clone()], &mut self.ids[rows.clone()]);
        let geometry = &placed.instances.model(instance).geometry;
        let mut kernel = Kernel::of(geometry, inward, 0, (t, ids), lanes, scratch);
        kernel.standing = Some(Standing {
            instance,
            vertices: &geometry.vertices,
            shift: placed.instances.shift,
            directions: self.directions.map(|d| &d[rows.clone()]),
            registers,
            along: self.lanes.axes[0],
            forward: f64::from(self.lanes.forward),
            origins,
            steepest,
        });
        // SAFETY: as above.
        unsafe {
            kernel.open(pulses);
            kernel.walk(tree, pulses);
        }
        true
    }
}

/// Takes rays into a model's frame; returns by how much they may be off there.
struct TurnInward<'k> {
    inward: &'k mut RayGroup,
    rays: &'k RayGroup,
    pulses: Range<usize>,
    way: &'k Inward,
}

impl<S: Simd> Step<S> for TurnInward<'_> {
    type Out = f64;

    #[inline(always)]
    unsafe fn run(self) -> f64 {
        let TurnInward { inward, rays, pulses, way } = self;
        let mut most = 0.0;
        inward.turn_from(rays, pulses, way.turn(), |origin| {
            let (origin, off) = way.point(origin);
            most = f64::max(most, off);
            origin
        });
        most
    }
}

/// Finds the distances of the first `count` pairs in `inside`; returns the pulses among them.
pub(super) struct HitPlaced<'k> {
    pub rows: &'k mut Rows,
    pub lists: &'k Lists<'k>,
    pub standing: &'k Standing<'k>,
    pub t: &'k mut [[f64; 8]],
    pub ids: &'k mut [[u32; 8]],
    pub span: usize,
    pub count: usize,
}

impl<S: Simd> Step<S> for HitPlaced<'_> {
    type Out = u32;

    #[inline(always)]
    unsafe fn run(self) -> u32 {
        let HitPlaced { rows, lists, standing, t, ids, span, count } = self;
        let Standing { instance, vertices, shift, along, forward, registers, .. } = *standing;
        let Rows { inside, planes, .. } = rows;
        let plane = &mut planes[0];
        let mut touched = 0;
        for Inside { pair, strictly, maybe } in &inside[..count] {
            let (pulse, lane) = (pulse_of(*pair), lane_of(*pair));
            let Some(block) = lists.blocks[block_of(*pair)] else { continue };
            touched |= 1 << pulse;
            let origin = standing.origins[pulse];
            let vertex = |c: usize| vertices[block.vertex[c][lane] as usize];
            let corners = [vertex(0), vertex(1), vertex(2)].map(|v| instance.placement.place(v, shift));
            let [a, b, c] = &corners;
            plane.id = instance.first + block.id[lane];
            // SAFETY: the caller vouches for the instruction set.
            unsafe {
                let corners = [a.as_ref(), b.as_ref(), c.as_ref()];
                plane.set::<S>(corners, origin.as_ref(), along, forward, standing.steepest[pulse]);
            }
            for n in 0..SPAN / 8 {
                let [sure, any] = [strictly, maybe].map(|m| m >> (8 * n) & 255);
                let register = pulse * registers + span * (SPAN / 8) + n;
                if any == 0 || register >= t.len() {
                    continue;
                }
                let directions = standing.directions.map(|d| &d[register]);
                let (t, id) = (&mut t[register], &mut ids[register]);
                // SAFETY: as above.
                let sound = unsafe { plane.hit::<S>(sure, directions, directions[along], t, id) };
                let open = any & !sound;
                if open != 0 {
                    ask(open, plane.id, &mut Rays { directions, t, id }, corners, |_| origin);
                }
            }
        }
        touched
    }
}

/// Notes the instances in a block that pulse `p` meets at these depths.
///
/// # Safety
/// As for [`Simd`].
#[inline(always)]
pub(super) unsafe fn meet<S: Simd>(list: &mut Vec<Met>, block: &Block, p: usize, mut met: u32, enter: S::F) {
    let mut depths = [0.0; LANES];
    // SAFETY: the caller vouches for the instruction set.
    unsafe { S::store(&mut depths, enter) };
    while met != 0 {
        let lane = met.trailing_zeros() as usize % LANES;
        let (instance, enter) = (block.id[lane], depths[lane]);
        // All pulses meet a block one after the other.
        let known = list.iter_mut().rev().take(LANES).find(|m| m.instance == instance);
        match known {
            Some(known) => {
                known.pulses |= 1 << p;
                known.enter = known.enter.min(enter);
            }
            None => list.push(Met { enter, pulses: 1 << p, instance }),
        }
        met &= met - 1;
    }
}
