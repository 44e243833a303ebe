//! Turns the hits of subrays into reflections (spec pulse-physics §2).

use super::continuum::{FoliageContinuum, LeafResponse, MediumSegment, depth, intercept};
use super::foliage::{self, FreePaths, MediumEvent};
use super::instrument::Instrument;
use super::lanes::LANES;
use super::reflections::{LaneMask, Reflections};
use super::traced::{SubrayGains, TracedPulse};
use super::triangle_cache::TriangleCache;
use super::view::{Interaction, STEP_BEHIND, SceneView, SideOfBounds, distance};
use vlscan_base::corrections::Corrections;
use vlscan_geom::{DVec3, unit};
use vlscan_scene::{Material, Scene, Voxel};
use vlscan_trace::Hits;

#[derive(Clone, Debug, Default)]
pub(super) struct ReflectScratch {
    /// Position among the reflections and cross-section of voxels that follow their own radar equation.
    cross_sections: Vec<(usize, f64)>,
    continuum: FoliageContinuum,
    /// True if [`ReflectScratch::hits`] is needed.
    pub records_hits: bool,
    /// Subrays whose light foliage intercepts and returns from all along their paths, each where it is
    /// intercepted.
    intercepted: Reflections,
    /// Hit of each subray, in order, if the hits may differ from the reflections and are needed.
    pub hits: Option<Reflections>,
    pub triangles: TriangleCache,
}

impl<'a> SceneView<'a> {
    /// Replaces `out` by the reflections of a pulse's subrays, in their order.
    #[inline(always)]
    pub fn reflect(
        &self,
        instrument: &Instrument,
        pulse: (TracedPulse, SubrayGains),
        paths: &mut FreePaths,
        scratch: &mut ReflectScratch,
        out: &mut Reflections,
    ) {
        out.clear(instrument.subrays.len());
        scratch.hits = None;
        let around = match instrument.detector.corrections.adjacent_voxels {
            true => self.voxels_around(pulse.0.origin),
            false => Vec::new(),
        };
        let is_done = around.is_empty()
            && self.visible_bounds.is_none()
            && self.shade_triangles(instrument, pulse, &mut scratch.triangles, out);
        if !is_done {
            // Drops the partial result of [`SceneView::shade_triangles`].
            out.clear(instrument.subrays.len());
            self.reflect_each(instrument, pulse, &around, paths, scratch, out);
        }
    }

    /// [`SceneView::reflect`] for pulses that hit only opaque triangles, in blocks of subrays; `false` for
    /// any other pulse.
    #[inline(always)]
    fn shade_triangles(
        &self,
        instrument: &Instrument,
        (traced, gains): (TracedPulse, SubrayGains),
        triangles: &mut TriangleCache,
        out: &mut Reflections,
    ) -> bool {
        let mut left = traced.primitives.len();
        let [x, y, z] = traced.directions;
        let gain_blocks = gains.gains.as_chunks::<LANES>().0;
        let blocks = traced.primitive_blocks.iter().zip(gains.ranges.as_chunks::<LANES>().0).zip(gain_blocks);
        for (((primitives, range), gain), ((x, y), z)) in blocks.zip(x.iter().zip(y).zip(z)) {
            let (mut hits, mut seen) = ([0; LANES], [0; LANES]);
            for i in 0..LANES {
                hits[i] = u8::from((primitives[i] != Hits::MISS) & (i < left));
                let in_range =
                    (range[i] >= instrument.detector.range_min) & (range[i] <= instrument.detector.range_max);
                seen[i] = hits[i] & u8::from(in_range);
            }
            left = left.saturating_sub(LANES);
            if instrument.detector.corrections.see_through_near && hits != seen {
                return false;
            }
            let (mut cosine, mut intensity) = ([1.0; LANES], [0.0; LANES]);
            let mut unshaded = LaneMask::of(seen);
            // Neighbouring subrays mostly hit the same triangle, so there are few rounds.
            while let Some(first) = unshaded.first() {
                let Some(triangle) = triangles.look_up(self, primitives[first]) else { return false };
                let mut same = [0; LANES];
                for i in 0..LANES {
                    same[i] = u8::from(primitives[i] == primitives[first]);
                }
                if !self.fixed_incidence {
                    triangle.cosines([x, y, z], primitives, &mut cosine);
                }
                triangle.intensities(self, &cosine, gain, primitives, &mut intensity);
                unshaded = unshaded.without(LaneMask::of(same));
            }
            out.push_triangles(LaneMask::of(seen), range, &intensity, &cosine, primitives);
        }
        out.mark_opaque_only();
        true
    }

    /// [`SceneView::reflect`] for any pulse; `around` are the voxels of foliage that contain its origin.
    #[inline(never)]
    fn reflect_each(
        &self,
        instrument: &Instrument,
        (traced, gains): (TracedPulse, SubrayGains),
        around: &[u32],
        paths: &mut FreePaths,
        scratch: &mut ReflectScratch,
        out: &mut Reflections,
    ) {
        let (rings, c) = (&instrument.subrays.ring, &instrument.detector.corrections);
        scratch.cross_sections.clear();
        let is_continuous = c.foliage_continuum && c.adjacent_voxels && c.leaf_table_law && rings.len() > 1;
        if is_continuous {
            scratch.continuum.clear(&instrument.detector);
            scratch.intercepted.clear(rings.len());
        }
        let may_be_occluded = !around.is_empty() || self.visible_bounds.is_some();
        let mut surface = ShadedSurface::none(self);
        let t = traced.t.as_flattened();
        let mut frame = None;
        for (i, (ring, range)) in rings.iter().zip(gains.ranges).enumerate() {
            let (primitive, direction) = (traced.primitives[i], traced.direction(i));
            if !may_be_occluded && self.is_triangle(primitive) && instrument.detector.is_in_range(*range) {
                surface.load(self, primitive);
                let cosine = if self.fixed_incidence { 1.0 } else { surface.plane_cosine(direction) };
                out.push((i as u32, *ring), (*range, *range), primitive, cosine, surface.factor(cosine));
            } else if primitive != Hits::MISS || !around.is_empty() {
                let ray = (traced.start(i), direction);
                let first =
                    Interaction { from: ray.0, t: t[i], primitive, range: *range, scatter_range: *range };
                let end = if is_continuous {
                    let frame = *frame.get_or_insert_with(|| FootprintFrame::new(traced.origin, direction));
                    self.scatter_continuously(
                        (instrument, i as u32, *ring),
                        (ray, frame),
                        first,
                        around,
                        (paths, scratch),
                    )
                } else if c.adjacent_voxels {
                    self.walk_medium(&instrument.detector, ray, first, around, paths)
                } else {
                    self.walk_voxels(instrument, ray, first, paths)
                };
                let Some(at) = end else { continue };
                surface.load(self, at.primitive);
                let LeafResponse { cosine, factor } =
                    surface.response(&at, direction, self.fixed_incidence, c);
                if let Some(sigma) = foliage::cross_section(surface.scene, c, surface.local, direction) {
                    scratch.cross_sections.push((out.count(), sigma));
                }
                let entry = if c.voxel_stop_point { at.scatter_range } else { at.range };
                out.push((i as u32, *ring), (at.scatter_range, entry), at.primitive, cosine, factor);
            }
        }
        out.apply_energy(&instrument.energy, &scratch.cross_sections);
        if is_continuous {
            if scratch.records_hits {
                scratch.intercepted.apply_energy(&instrument.energy, &[]);
                scratch.hits = Some(out.merged(&scratch.intercepted));
            }
            scratch.continuum.emit(out);
        }
    }

    /// Follows subray `i` of `ring` through foliage to what reflects it: a solid surface or an element of
    /// foliage. `None` if there is none, or if foliage of small leaves intercepts the subray, whose light
    /// then joins the continuum.
    fn scatter_continuously(
        &self,
        (instrument, i, ring): (&Instrument, u32, u32),
        ((origin, direction), frame): ((DVec3, DVec3), FootprintFrame),
        first: Interaction,
        around: &[u32],
        (paths, scratch): (&mut FreePaths, &mut ReflectScratch),
    ) -> Option<Interaction> {
        let continuum = &mut scratch.continuum;
        let solid = self.collect_medium(
            &instrument.detector,
            (origin, direction),
            first,
            around,
            &mut continuum.segments,
        );
        if continuum.segments.is_empty() {
            return solid;
        }
        let end = solid.map_or(f64::INFINITY, |s| s.range);
        let foremost = continuum.segments[0];
        let (scene, local) = self.locate(foremost.entry.primitive);
        let size = scene.material_of(local).element_size;
        if size > 0.0 {
            let column = frame.column(origin + direction * foremost.from, size, paths.shift_of_columns());
            let found = intercept(&continuum.segments, paths.depth_of_column(column), end);
            let Some((segment, scatter_range)) = found else { return solid };
            return instrument
                .detector
                .is_in_range(scatter_range)
                .then_some(Interaction { scatter_range, ..segment.entry });
        }
        // The optical depth at which the subray is intercepted.
        let intercepted_at = paths.sample(1.0);
        if intercepted_at > depth(&continuum.segments, end) {
            return solid;
        }
        let response = |segment: &MediumSegment| {
            let mut surface = ShadedSurface::none(self);
            surface.load(self, segment.entry.primitive);
            surface.response(
                &segment.entry,
                direction,
                self.fixed_incidence,
                &instrument.detector.corrections,
            )
        };
        if scratch.records_hits
            && let Some((segment, range)) = intercept(&continuum.segments, intercepted_at, end)
            && instrument.detector.is_in_range(range)
        {
            let LeafResponse { cosine, factor } = response(&segment);
            let primitive = segment.entry.primitive;
            scratch.intercepted.push((i, ring), (range, range), primitive, cosine, factor);
        }
        continuum.scatter((&instrument.energy, &instrument.detector), ring, end, response);
        None
    }

    /// Follows a subray from its first interaction to the one that reflects it (spec pulse-physics §2.7), or
    /// `None`.
    #[inline(never)]
    fn walk_voxels(
        &self,
        instrument: &Instrument,
        (origin, direction): (DVec3, DVec3),
        mut at: Interaction,
        paths: &mut FreePaths,
    ) -> Option<Interaction> {
        let corrections = &instrument.detector.corrections;
        loop {
            if at.primitive == Hits::MISS || !at.range.is_finite() {
                return None;
            }
            let (scene, local) = self.locate(at.primitive);
            let by_scatter_range = corrections.voxel_stop_point && foliage::is_scattering(scene, local);
            let next = match self.side_of_bounds(&at, direction) {
                SideOfBounds::Beyond => return None,
                SideOfBounds::Before(entry) => entry,
                SideOfBounds::Inside if at.range > instrument.detector.range_max => return None,
                SideOfBounds::Inside if at.range < instrument.detector.range_min && !by_scatter_range => {
                    if !corrections.see_through_near {
                        return None;
                    }
                    at.point(direction) + direction * STEP_BEHIND
                }
                SideOfBounds::Inside => {
                    match foliage::medium_event(scene, corrections, local, (at.from, direction), at.t, paths)
                    {
                        MediumEvent::Scatter(0.0) => return Some(at),
                        MediumEvent::Scatter(path) => {
                            at.scatter_range = distance((at.point(direction) + direction * path) - origin);
                            let is_measured =
                                !by_scatter_range || instrument.detector.is_in_range(at.scatter_range);
                            return is_measured.then_some(at);
                        }
                        MediumEvent::Lost => return None,
                        MediumEvent::Exit(exit) => at.from + direction * exit + direction * STEP_BEHIND,
                    }
                }
            };
            if next == at.from {
                return None;
            }
            at = self.nearest(next, direction, origin, |_| true);
        }
    }
}

/// Axes across a beam in which the places of its subrays are told apart.
#[derive(Clone, Copy)]
struct FootprintFrame {
    origin: DVec3,
    axes: [DVec3; 2],
}

impl FootprintFrame {
    /// The frame of a beam from `origin`; `direction` is that of one of its subrays.
    fn new(origin: DVec3, direction: DVec3) -> FootprintFrame {
        let aside = if direction.z.abs() < 0.9 { DVec3::Z } else { DVec3::X };
        let u = unit(direction.cross(aside));
        FootprintFrame { origin, axes: [u, direction.cross(u)] }
    }

    /// The column, `size` m wide, of the footprint that holds a point; `shift` moves the columns, in shares
    /// of their size.
    fn column(&self, point: DVec3, size: f64, shift: [f64; 2]) -> [i32; 2] {
        [0, 1].map(|i| ((point - self.origin).dot(self.axes[i]) / size + shift[i]).floor() as i32)
    }
}

/// Reflection properties of the primitive of the last interaction: neighbouring subrays mostly hit the same
/// one.
pub(super) struct ShadedSurface<'a> {
    primitive: u32,
    /// The scene that holds it in its current position, and its index there.
    scene: &'a Scene,
    local: u32,
    material: Option<&'a Material>,
    /// Unit normal of a triangle or of a cube that has one.
    pub normal: Option<DVec3>,
    /// See [`SceneView::wavelength`].
    wavelength: usize,
}

impl<'a> ShadedSurface<'a> {
    /// No surface yet.
    pub fn none(view: &SceneView<'a>) -> ShadedSurface<'a> {
        ShadedSurface {
            primitive: Hits::MISS,
            scene: view.scene,
            local: Hits::MISS,
            material: None,
            normal: None,
            wavelength: view.wavelength,
        }
    }

    /// Looks the primitive up unless it is the last one.
    pub fn load(&mut self, view: &SceneView<'a>, primitive: u32) {
        if self.primitive == primitive {
            return;
        }
        let (scene, local) = view.locate(primitive);
        let normal = match scene.triangle(local) {
            Some([a, b, c]) => Some(unit((b - a).cross(c - a))),
            None => scene.voxel(local).as_ref().and_then(Voxel::normal),
        };
        let material = Some(scene.material_of(local));
        *self = ShadedSurface { primitive, scene, local, material, normal, wavelength: self.wavelength };
    }

    /// Cosine of the incidence angle (spec pulse-physics §2.4).
    fn cosine(&self, at: &Interaction, direction: DVec3) -> f64 {
        if self.normal.is_some() {
            return self.plane_cosine(direction);
        }
        let Some(cube) = self.scene.geometry.cube_of(self.local) else { return 1.0 };
        face_of_cube(at.point(direction) - cube.centre, cube.half).dot(direction).abs().min(1.0)
    }

    /// Cosine of the incidence angle on a primitive that has a normal.
    fn plane_cosine(&self, direction: DVec3) -> f64 {
        self.normal.map_or(1.0, |n| n.dot(direction).abs().min(1.0))
    }

    /// How the surface or its foliage reflects a ray that hits it at `at`.
    pub fn response(
        &self,
        at: &Interaction,
        direction: DVec3,
        fixed_incidence: bool,
        c: &Corrections,
    ) -> LeafResponse {
        if !fixed_incidence && c.foliage_incidence && foliage::is_scattering(self.scene, self.local) {
            let cosine = foliage::mean_cosine(self.scene, c, self.local, direction);
            return LeafResponse {
                cosine,
                factor: self.material.map_or(0.0, |m| m.leaf_factor(self.wavelength, cosine)),
            };
        }
        let cosine = if fixed_incidence { 1.0 } else { self.cosine(at, direction) };
        LeafResponse { cosine, factor: self.factor(cosine) }
    }

    fn factor(&self, cosine: f64) -> f64 {
        self.material.map_or(0.0, |m| m.factor(self.wavelength, cosine))
    }
}

/// Normal of the cube's face whose centre is nearest to `p` (relative to the cube's centre); of equally near
/// faces the first in the order +x, −x, +y, −y, +z, −z.
fn face_of_cube(p: DVec3, half: f64) -> DVec3 {
    let faces = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    let mut best = (f64::INFINITY, DVec3::X);
    for normal in faces {
        let d = (p - normal * half).length_squared();
        if d < best.0 {
            best = (d, normal);
        }
    }
    best.1
}

#[cfg(test)]
mod tests;
