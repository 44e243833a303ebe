//! Rays through foliage as a participating medium: the refined counterpart of spec pulse-physics §2.7.
//!
//! Voxels are visited in the order of their entries, and each draws one free path. The nearest scattering
//! point counts, provided that nothing opaque lies before it; or all foliage along the ray is listed (see
//! [`super::continuum`]). So neighbouring voxels are never skipped, voxels that overlap add their
//! extinctions, and a trunk within a voxel is visible through its leaves. A voxel does not own its upper
//! faces: a ray along a face belongs to only one of the neighbours.

use super::continuum::{MAX_DEPTH, MediumSegment, depth};
use super::detector_settings::DetectorSettings;
use super::foliage::{self, FreePaths, MediumEvent};
use super::view::{Interaction, STEP_BEHIND, SceneView, SideOfBounds, distance};
use vlscan_geom::DVec3;
use vlscan_scene::VoxelKind;
use vlscan_trace::Hits;

struct MediumWalk<'v, 'a> {
    view: &'v SceneView<'a>,
    detector: &'v DetectorSettings,
    origin: DVec3,
    direction: DVec3,
    nearest: Option<Interaction>,
    search: Search<'v>,
    /// Voxels entered shortly before the point from which the search continues, with their entry distances
    /// from the origin.
    passed: Vec<(u32, f64)>,
}

/// Values that the walk collects along the ray.
enum Search<'v> {
    /// The nearest of the scattering points, one of which is drawn per voxel.
    ScatterPoint(&'v mut FreePaths),
    /// All voxels, by ascending entry.
    Segments(&'v mut Vec<MediumSegment>),
}

/// Continuation of the walk after an interaction.
enum Step {
    /// Search on from this point.
    Continue(DVec3),
    End(Option<Interaction>),
}

impl SceneView<'_> {
    /// Follows a subray from its first interaction through foliage to the one that reflects it; `None` if
    /// there is none. `around` are the voxels of foliage that contain its origin.
    #[inline(never)]
    pub(super) fn walk_medium(
        &self,
        detector: &DetectorSettings,
        ray: (DVec3, DVec3),
        first: Interaction,
        around: &[u32],
        paths: &mut FreePaths,
    ) -> Option<Interaction> {
        self.run_walk(detector, ray, first, around, Search::ScatterPoint(paths))
    }

    /// Follows a subray through foliage to a solid surface, if any, and lists the foliage on its path by
    /// ascending entry.
    #[inline(never)]
    pub(super) fn collect_medium(
        &self,
        detector: &DetectorSettings,
        ray: (DVec3, DVec3),
        first: Interaction,
        around: &[u32],
        segments: &mut Vec<MediumSegment>,
    ) -> Option<Interaction> {
        segments.clear();
        self.run_walk(detector, ray, first, around, Search::Segments(segments))
    }

    fn run_walk(
        &self,
        detector: &DetectorSettings,
        (origin, direction): (DVec3, DVec3),
        first: Interaction,
        around: &[u32],
        search: Search,
    ) -> Option<Interaction> {
        let (nearest, passed) = (None, Vec::new());
        let mut walk = MediumWalk { view: self, detector, origin, direction, nearest, search, passed };
        for &voxel in around {
            walk.enter(Interaction {
                from: origin,
                t: 0.0,
                primitive: voxel,
                range: 0.0,
                scatter_range: 0.0,
            });
            walk.passed.push((voxel, 0.0));
        }
        let mut at = first;
        loop {
            match walk.visit(at) {
                Step::End(end) => return end,
                Step::Continue(from) => at = walk.next_interaction(from),
            }
        }
    }
}

impl MediumWalk<'_, '_> {
    fn visit(&mut self, at: Interaction) -> Step {
        let detector = self.detector;
        if at.primitive == Hits::MISS
            || !at.range.is_finite()
            || self.nearest.is_some_and(|s| s.scatter_range <= at.range)
            || self.is_extinguished(at.range)
        {
            return Step::End(self.measured_scatter());
        }
        match self.view.side_of_bounds(&at, self.direction) {
            SideOfBounds::Beyond => return Step::End(self.measured_scatter()),
            SideOfBounds::Before(entry) => return Step::Continue(entry),
            SideOfBounds::Inside => {}
        }
        let (scene, local) = self.view.locate(at.primitive);
        let kind = scene.voxel(local).map_or(VoxelKind::Opaque, |v| v.kind());
        let by_scatter_range = kind == VoxelKind::Transmittive && detector.corrections.voxel_stop_point;
        if at.range > detector.range_max {
            return Step::End(self.measured_scatter());
        }
        if at.range < detector.range_min && !by_scatter_range {
            // An object nearer than the minimum range occludes the rest, unless rays see through it.
            let behind = at.point(self.direction) + self.direction * STEP_BEHIND;
            let is_transparent = detector.corrections.see_through_near;
            return if is_transparent { Step::Continue(behind) } else { Step::End(None) };
        }
        if kind == VoxelKind::Opaque {
            return Step::End(Some(at));
        }
        self.enter(at);
        let entry = distance(at.point(self.direction) - self.origin);
        // From slightly before the entry, so that primitives that begin at the same place are visited, too.
        let from = (entry - STEP_BEHIND).max(distance(at.from - self.origin));
        self.passed.retain(|(_, entered)| *entered >= from - STEP_BEHIND);
        self.passed.push((at.primitive, entry));
        Step::Continue(self.origin + self.direction * from)
    }

    /// True if the listed foliage transmits nothing up to that range.
    fn is_extinguished(&self, range: f64) -> bool {
        let Search::Segments(segments) = &self.search else { return false };
        depth(segments, range) > MAX_DEPTH
    }

    /// Draws the free path of a voxel, or lists the voxel.
    fn enter(&mut self, at: Interaction) {
        let (scene, local) = self.view.locate(at.primitive);
        let (ray, c) = ((at.from, self.direction), &self.detector.corrections);
        if !foliage::is_within(scene, local, ray, at.t) {
            return;
        }
        let paths = match &mut self.search {
            Search::ScatterPoint(paths) => paths,
            Search::Segments(segments) => {
                if let Some((exit, sigma)) = foliage::leaf_extinction(scene, c, local, ray) {
                    let from = distance(at.point(self.direction) - self.origin);
                    let to = distance((at.from + self.direction * exit) - self.origin);
                    segments.push(MediumSegment { entry: at, from, to, sigma });
                }
                return;
            }
        };
        if let MediumEvent::Scatter(path) = foliage::medium_event(scene, c, local, ray, at.t, paths) {
            let scatter_range = distance((at.point(self.direction) + self.direction * path) - self.origin);
            if self.nearest.is_none_or(|s| scatter_range < s.scatter_range) {
                let range = if at.t == 0.0 { scatter_range } else { at.range };
                self.nearest = Some(Interaction { scatter_range, range, ..at });
            }
        }
    }

    fn measured_scatter(&self) -> Option<Interaction> {
        let by_scatter_range = |s: &Interaction| s.t == 0.0 || self.detector.corrections.voxel_stop_point;
        self.nearest.filter(|s| !by_scatter_range(s) || self.detector.is_in_range(s.scatter_range))
    }

    fn next_interaction(&self, from: DVec3) -> Interaction {
        let is_new = |i: u32| !self.passed.iter().any(|p| p.0 == i);
        self.view.nearest(from, self.direction, self.origin, is_new)
    }
}
