//! The way of a ray through foliage as a medium: the refined counterpart of spec pulse-physics §2.7.
//!
//! Voxels are met in the order of their entries, and each draws one free path. The nearest stop of all of them counts, and
//! only when nothing opaque lies before it; or all foliage on the way is listed (see [`super::continuum`]). So neighbouring voxels are never skipped, voxels that overlap add their
//! extinctions, and a trunk within a voxel is seen through its leaves. A voxel does not own its upper faces: a ray that runs
//! along a face belongs to one neighbour only.

use super::continuum::{MAX_DEPTH, Stretch, depth};
use super::foliage::{self, FreePaths, Passage};
use super::instrument::Instrument;
use super::reflect::{Encounter, STEP_BEHIND, Standing, View, distance};
use crate::geom::DVec3;
use crate::scene::VoxelKind;
use crate::tree::Hits;

/// A ray in foliage.
struct Crossing<'v, 'a> {
    view: &'v View<'a>,
    instrument: &'v Instrument,
    origin: DVec3,
    direction: DVec3,
    /// The nearest stop so far.
    stop: Option<Encounter>,
    search: Search<'v>,
    /// Voxels whose entries lie close before where the search goes on, with the distance of these from the origin.
    passed: Vec<(u32, f64)>,
}

/// What is wanted of the foliage on the way.
enum Search<'v> {
    /// The nearest of the stops that are drawn for each voxel.
    Stop(&'v mut FreePaths),
    /// All of it, by ascending entry.
    Stretches(&'v mut Vec<Stretch>),
}

/// What is to be done after an encounter.
enum Next {
    /// Look on from here.
    From(DVec3),
    /// The way ends.
    End(Option<Encounter>),
}

impl View<'_> {
    /// Follows a subray from what it met first, through foliage, to what reflects it, or `None`. `around` are the voxels
    /// of foliage in which it begins.
    #[inline(never)]
    pub(super) fn cross(
        &self,
        instrument: &Instrument,
        origin: DVec3,
        direction: DVec3,
        first: Encounter,
        around: &[u32],
        paths: &mut FreePaths,
    ) -> Option<Encounter> {
        let (stop, search, passed) = (None, Search::Stop(paths), Vec::new());
        Crossing { view: self, instrument, origin, direction, stop, search, passed }.run(first, around)
    }

    /// Follows a subray through foliage to what is solid, or `None`, and lists the foliage on its way by ascending entry.
    #[inline(never)]
    pub(super) fn collect(
        &self,
        instrument: &Instrument,
        (origin, direction): (DVec3, DVec3),
        first: Encounter,
        around: &[u32],
        stretches: &mut Vec<Stretch>,
    ) -> Option<Encounter> {
        stretches.clear();
        let (stop, search, passed) = (None, Search::Stretches(stretches), Vec::new());
        Crossing { view: self, instrument, origin, direction, stop, search, passed }.run(first, around)
    }
}

impl Crossing<'_, '_> {
    fn run(mut self, first: Encounter, around: &[u32]) -> Option<Encounter> {
        for &voxel in around {
            self.enter(Encounter { from: self.origin, t: 0.0, primitive: voxel, range: 0.0, stop: 0.0 });
            self.passed.push((voxel, 0.0));
        }
        let mut at = first;
        loop {
            match self.meet(at) {
                Next::End(end) => return end,
                Next::From(from) => at = self.next(from),
            }
        }
    }

    fn meet(&mut self, at: Encounter) -> Next {
        let i = self.instrument;
        if at.primitive == Hits::MISS
            || !at.range.is_finite()
            || self.stop.is_some_and(|s| s.stop <= at.range)
            || self.is_dark(at.range)
        {
            return Next::End(self.stopped());
        }
        match self.view.standing(&at, self.direction) {
            Standing::Beyond => return Next::End(self.stopped()),
            Standing::Before(entry) => return Next::From(entry),
            Standing::Inside => {}
        }
        let (scene, local) = self.view.shown(at.primitive);
        let kind = scene.voxel(local).map_or(VoxelKind::Opaque, |v| v.kind());
        let by_stop = kind == VoxelKind::Transmittive && i.corrections.voxel_stop_point;
        if at.range > i.range_max {
            return Next::End(self.stopped());
        }
        if at.range < i.range_min && !by_stop {
            // What is too near is in the way, unless it may be looked through.
            let behind = at.point(self.direction) + self.direction * STEP_BEHIND;
            return if i.corrections.see_through_near { Next::From(behind) } else { Next::End(None) };
        }
        if kind == VoxelKind::Opaque {
            return Next::End(Some(at));
        }
        self.enter(at);
        let entry = distance(at.point(self.direction) - self.origin);
        // From a little before the entry, so that what begins at the same place is met, too.
        let from = (entry - STEP_BEHIND).max(distance(at.from - self.origin));
        self.passed.retain(|(_, entered)| *entered >= from - STEP_BEHIND);
        self.passed.push((at.primitive, entry));
        Next::From(self.origin + self.direction * from)
    }

    /// Whether the collected foliage lets nothing through to that range.
    fn is_dark(&self, range: f64) -> bool {
        let Search::Stretches(stretches) = &self.search else { return false };
        depth(stretches, range) > MAX_DEPTH
    }

    /// Draws the free path of a voxel, or lists it.
    fn enter(&mut self, at: Encounter) {
        let (scene, local) = self.view.shown(at.primitive);
        let (ray, c) = ((at.from, self.direction), &self.instrument.corrections);
        if !foliage::is_within(scene, local, ray, at.t) {
            return;
        }
        let paths = match &mut self.search {
            Search::Stop(paths) => paths,
            Search::Stretches(stretches) => {
                if let Some((exit, sigma)) = foliage::leaves(scene, c, local, ray) {
                    let from = distance(at.point(self.direction) - self.origin);
                    let to = distance((at.from + self.direction * exit) - self.origin);
                    stretches.push(Stretch { entry: at, from, to, sigma });
                }
                return;
            }
        };
        if let Passage::Stops(path) = foliage::pass(scene, c, local, ray, at.t, paths) {
            let stop = distance((at.point(self.direction) + self.direction * path) - self.origin);
            if self.stop.is_none_or(|s| stop < s.stop) {
                let inside = at.t == 0.0;
                self.stop = Some(Encounter { stop, range: if inside { stop } else { at.range }, ..at });
            }
        }
    }

    /// The reflection of the nearest stop, if it can be measured.
    fn stopped(&self) -> Option<Encounter> {
        let i = self.instrument;
        let by_stop = |s: &Encounter| s.t == 0.0 || i.corrections.voxel_stop_point;
        self.stop.filter(|s| !by_stop(s) || (s.stop >= i.range_min && s.stop <= i.range_max))
    }

    fn next(&self, from: DVec3) -> Encounter {
        let is_new = |i: u32| !self.passed.iter().any(|p| p.0 == i);
        self.view.first_behind(from, self.direction, self.origin, is_new)
    }
}
