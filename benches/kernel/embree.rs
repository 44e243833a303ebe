//! Embree on the same rays; see `embree.c`.

use crate::Tracer;
use std::os::raw::c_void;
use vlscan::trace::{Geometry, RayGroup};

/// The device and scene of `embree.c`.
#[repr(C)]
pub struct Embree {
    device: *mut c_void,
    scene: *mut c_void,
}

#[repr(C)]
struct Rays {
    origin: [*const f32; 3],
    direction: [*const f32; 3],
    count: usize,
}

unsafe extern "C" {
    fn embree_build(to: *mut Embree, v: *const f32, nv: usize, t: *const u32, nt: usize) -> i32;
    fn embree_free(embree: *mut Embree);
    fn embree_single(embree: *const Embree, rays: *const Rays, t: *mut f32, ids: *mut u32);
    fn embree_coherent(embree: *const Embree, rays: *const Rays, t: *mut f32, ids: *mut u32);
}

/// Embree entry point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// `rtcIntersect1`.
    Single,
    /// `rtcIntersect16` with the coherent flag.
    Coherent,
}

impl Mode {
    pub const BOTH: [Mode; 2] = [Mode::Single, Mode::Coherent];

    pub fn name(self) -> &'static str {
        match self {
            Mode::Single => "single",
            Mode::Coherent => "coherent",
        }
    }
}

/// The rays of a batch in single precision, one after the other.
#[derive(Clone, Default)]
pub struct Packed {
    origin: [Vec<f32>; 3],
    direction: [Vec<f32>; 3],
    /// Number of rays; the last is repeated up to a multiple of 16.
    count: usize,
}

impl Packed {
    pub fn of(batch: &RayGroup) -> Packed {
        let mut packed = Packed::default();
        for p in 0..batch.len() {
            for r in 0..batch.rays() {
                let (o, d) = (batch.origin(p).to_array(), batch.direction(p, r).to_array());
                for a in 0..3 {
                    packed.origin[a].push(o[a] as f32);
                    packed.direction[a].push(d[a] as f32);
                }
            }
        }
        packed.count = packed.origin[0].len();
        for list in packed.origin.iter_mut().chain(&mut packed.direction) {
            let last = list.last().copied().unwrap_or_default();
            list.resize(packed.count.next_multiple_of(16), last);
        }
        packed
    }
}

pub struct EmbreeTracer<'a> {
    embree: &'a Embree,
    mode: Mode,
    batches: &'a [Packed],
    rays: Packed,
    t: Vec<f32>,
    ids: Vec<u32>,
}

impl<'a> EmbreeTracer<'a> {
    pub fn new(embree: &'a Embree, mode: Mode, batches: &'a [Packed]) -> EmbreeTracer<'a> {
        EmbreeTracer { embree, mode, batches, rays: Packed::default(), t: Vec::new(), ids: Vec::new() }
    }
}

impl Tracer for EmbreeTracer<'_> {
    fn load(&mut self, batch: usize) {
        self.rays.clone_from(&self.batches[batch]);
        self.t.resize(self.rays.origin[0].len(), 0.0);
        self.ids.resize(self.rays.origin[0].len(), 0);
    }

    fn trace(&mut self) {
        self.embree.trace(self.mode, &self.rays, &mut self.t, &mut self.ids);
        std::hint::black_box((&self.t, &self.ids));
    }
}

impl Embree {
    /// Builds Embree's acceleration structure over the triangles.
    pub fn build(geometry: &Geometry) -> Embree {
        let vertices: Vec<[f32; 3]> =
            geometry.vertices.iter().map(|v| v.to_array().map(|x| x as f32)).collect();
        let mut embree = Embree { device: std::ptr::null_mut(), scene: std::ptr::null_mut() };
        // SAFETY: pointers and counts are those of live slices, which are copied.
        let built = unsafe {
            embree_build(
                &mut embree,
                vertices.as_ptr().cast(),
                vertices.len(),
                geometry.triangles.as_ptr().cast(),
                geometry.triangles.len(),
            )
        };
        assert!(built != 0, "Embree could not build its scene");
        embree
    }

    /// Distance and triangle of every ray; infinite and `u32::MAX` for misses.
    pub fn hits(&self, mode: Mode, batches: &[Packed]) -> Vec<(f64, u32)> {
        let mut tracer = EmbreeTracer::new(self, mode, batches);
        let mut hits = Vec::new();
        for (batch, rays) in batches.iter().enumerate() {
            tracer.load(batch);
            tracer.trace();
            let all = tracer.t.iter().zip(&tracer.ids).map(|(t, id)| (f64::from(*t), *id));
            hits.extend(all.take(rays.count));
        }
        hits
    }

    fn trace(&self, mode: Mode, rays: &Packed, t: &mut [f32], ids: &mut [u32]) {
        let count = rays.origin[0].len();
        assert!(t.len() == count && ids.len() == count);
        let rays = Rays {
            origin: rays.origin.each_ref().map(|x| x.as_ptr()),
            direction: rays.direction.each_ref().map(|x| x.as_ptr()),
            count,
        };
        // SAFETY: all arrays hold `count` numbers, a multiple of sixteen.
        unsafe {
            match mode {
                Mode::Single => embree_single(self, &rays, t.as_mut_ptr(), ids.as_mut_ptr()),
                Mode::Coherent => embree_coherent(self, &rays, t.as_mut_ptr(), ids.as_mut_ptr()),
            }
        }
    }
}

impl Drop for Embree {
    fn drop(&mut self) {
        // SAFETY: both were made by `embree_build` and are freed once.
        unsafe { embree_free(self) }
    }
}
