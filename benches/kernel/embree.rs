//! Embree on the same rays; see `embree.c`.

use crate::Tracer;
use std::os::raw::c_void;
use vlscan::internals::{Geometry, RayGroup};

/// What `embree.c` calls a tracer.
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

/// How Embree is asked.
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

/// The rays of a volley in single precision, one after the other.
#[derive(Clone, Default)]
pub struct Packed {
    origin: [Vec<f32>; 3],
    direction: [Vec<f32>; 3],
    /// How many are meant; the last is repeated up to a multiple of 16.
    count: usize,
}

impl Packed {
    /// All rays of a volley.
    pub fn of(volley: &RayGroup) -> Packed {
        let mut packed = Packed::default();
        for p in 0..volley.len() {
            for r in 0..volley.rays() {
                let (o, d) = (volley.origin(p).to_array(), volley.direction(p, r).to_array());
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

/// Embree in one of its modes.
pub struct Theirs<'a> {
    embree: &'a Embree,
    mode: Mode,
    volleys: &'a [Packed],
    rays: Packed,
    t: Vec<f32>,
    ids: Vec<u32>,
}

impl<'a> Theirs<'a> {
    pub fn new(embree: &'a Embree, mode: Mode, volleys: &'a [Packed]) -> Theirs<'a> {
        Theirs { embree, mode, volleys, rays: Packed::default(), t: Vec::new(), ids: Vec::new() }
    }
}

impl Tracer for Theirs<'_> {
    fn load(&mut self, volley: usize) {
        self.rays.clone_from(&self.volleys[volley]);
        self.t.resize(self.rays.origin[0].len(), 0.0);
        self.ids.resize(self.rays.origin[0].len(), 0);
    }

    fn trace(&mut self) {
        self.embree.trace(self.mode, &self.rays, &mut self.t, &mut self.ids);
        std::hint::black_box((&self.t, &self.ids));
    }
}

impl Embree {
    /// Embree's own structure over the triangles.
    pub fn build(geometry: &Geometry) -> Embree {
        let vertices: Vec<[f32; 3]> =
            geometry.vertices.iter().map(|v| v.to_array().map(|x| x as f32)).collect();
        let mut embree = Embree { device: std::ptr::null_mut(), scene: std::ptr::null_mut() };
        // SAFETY: the pointers and counts are those of live slices, which are copied.
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
    pub fn hits(&self, mode: Mode, volleys: &[Packed]) -> Vec<(f64, u32)> {
        let mut theirs = Theirs::new(self, mode, volleys);
        let mut hits = Vec::new();
        for (volley, rays) in volleys.iter().enumerate() {
            theirs.load(volley);
            theirs.trace();
            let all = theirs.t.iter().zip(&theirs.ids).map(|(t, id)| (f64::from(*t), *id));
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
