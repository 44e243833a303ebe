//! Instances: models that stand in many places but are stored once.
//!
//! A scene of instances has the primitives that copying every model to its places would give, and the exact test gets
//! exactly the corners that copying would store: [`Placement::place`] computes them from the model's when they are needed.
//! The models' own trees and the tree over the boxes of all instances are filters only: rays are taken into the model's
//! frame with a margin for all rounding on the way.

use super::Geometry;
use crate::geom::{Aabb, DVec3, Rotation};
use glam::DMat3;
use rayon::prelude::*;
use std::sync::Arc;

/// Covers what rounding does to a placed point and on the way back, relative to the largest number involved.
const ROUNDING: f64 = 1e-14;

/// Cells per axis of a model's outline.
const OUTLINE_CELLS: usize = 8;

/// Where an instance stands: `scale · R · p + offset`, then up by `raise`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// R.
    pub rotation: Rotation,
    /// Scale, may be negative.
    pub scale: f64,
    /// Offset, m.
    pub offset: DVec3,
    /// Added to z after all else, m; −0 leaves every z as it is, which +0 would not.
    pub raise: f64,
}

impl Placement {
    /// Leaves everything where it is.
    pub const IDENTITY: Placement =
        Placement { rotation: Rotation::IDENTITY, scale: 1.0, offset: DVec3::ZERO, raise: -0.0 };

    /// The image of a point of the model, less `shift`: computed as by a scene that stores the image.
    #[inline(always)]
    pub fn place(&self, p: DVec3, shift: DVec3) -> DVec3 {
        let p = self.rotation.apply(p) * self.scale + self.offset;
        DVec3::new(p.x, p.y, p.z + self.raise) - shift
    }

    /// The linear part of the placement.
    fn matrix(&self) -> DMat3 {
        let column = |v| self.rotation.apply(v) * self.scale;
        DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z))
    }

    /// A bound of the numbers that occur when a point with coordinates within `reach` is placed.
    pub fn magnitude(&self, shift: DVec3, reach: f64) -> f64 {
        let largest = |v: DVec3| v.abs().max_element();
        largest(self.offset) + largest(shift) + self.raise.abs() + 4.0 * self.scale.abs() * reach
    }
}

/// The map from the scene's frame into a model's.
#[derive(Clone, Copy, Debug)]
pub(super) struct WorldToInstance {
    matrix: DMat3,
    /// Where the model's origin is in the scene.
    anchor: DVec3,
    /// Bound of the numbers that occur when a point is placed.
    magnitude: f64,
    /// Bound of how much the matrix enlarges an error.
    stretch: f64,
}

impl WorldToInstance {
    /// The image of a point, and by how much it may be off on any axis.
    pub fn point(&self, p: DVec3) -> (DVec3, f64) {
        let error = ROUNDING * (self.magnitude + p.abs().max_element()) * self.stretch;
        (self.matrix * (p - self.anchor), error)
    }

    /// Maps directions; `t` along the image of a direction is what it is along the direction.
    pub fn matrix(&self) -> DMat3 {
        self.matrix
    }
}

/// A mesh that is placed.
#[derive(Clone, Debug)]
pub struct Model {
    /// Its triangles, in its own frame; no cubes.
    pub geometry: Geometry,
    /// Largest coordinate.
    reach: f64,
    /// Boxes that hold all vertices: rotated, several are a tighter bound than one.
    outline: Vec<Aabb>,
}

impl Model {
    /// A model of triangles.
    pub fn new(geometry: Geometry) -> Model {
        let bounds = Aabb::around(geometry.vertices.iter().copied().filter(|v| v.is_finite()));
        let reach = bounds.min.abs().max(bounds.max.abs()).max_element();
        let size = bounds.size();
        let mut cells = vec![Aabb::EMPTY; OUTLINE_CELLS.pow(3)];
        for v in geometry.vertices.iter().filter(|v| v.is_finite()) {
            let cell = ((*v - bounds.min) / size * OUTLINE_CELLS as f64).to_array();
            let at = cell.iter().fold(0, |at, c| at * OUTLINE_CELLS + (*c as usize).min(OUTLINE_CELLS - 1));
            cells[at] = cells[at].with(*v);
        }
        cells.retain(|c| !c.is_empty());
        Model { geometry, reach: if reach.is_finite() { reach } else { 0.0 }, outline: cells }
    }

    /// A model whose reach and outline are known.
    pub(super) fn of(geometry: Geometry, reach: f64, outline: Vec<Aabb>) -> Model {
        Model { geometry, reach, outline }
    }

    /// Boxes that hold all vertices.
    pub(super) fn outline(&self) -> &[Aabb] {
        &self.outline
    }

    /// Largest coordinate of a vertex, m.
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// Bytes that it occupies.
    pub fn memory(&self) -> usize {
        self.geometry.vertices.memory()
            + self.geometry.triangles.memory()
            + self.outline.capacity() * size_of::<Aabb>()
    }
}

/// A model with its placement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Number of the model.
    pub model: u32,
    /// How many of the geometry's own triangles come before it, were it stored among them: decides between equal
    /// distances as storing it would.
    pub before: u32,
    /// Number of its first triangle.
    pub first: u32,
    /// Where the model stands.
    pub placement: Placement,
}

/// All instances of a scene. Their triangles are numbered on from the primitives of the scene's own geometry.
#[derive(Clone, Debug, Default)]
pub struct Instances {
    /// The models that are placed.
    pub models: Vec<Arc<Model>>,
    /// The instances; `first` and `before` ascend.
    pub all: Vec<Instance>,
    /// Subtracted from every placed point, m.
    pub shift: DVec3,
    /// Number of the first triangle of any instance: how many primitives the geometry has itself.
    pub(super) first: u32,
    /// Triangles of all instances.
    triangles: u32,
}

impl Instances {
    /// Places `models`: for each instance the model's number, how many triangles of the geometry come before it (these
    /// must ascend) and where it stands. `first` is the number of primitives in the geometry itself. `None` when the
    /// triangles cannot be numbered with 32 bits.
    pub fn new(
        models: Vec<Arc<Model>>,
        places: impl IntoIterator<Item = (u32, u32, Placement)>,
        first: usize,
    ) -> Option<Instances> {
        let first = u32::try_from(first).ok()?;
        let mut next = first;
        let mut all = Vec::new();
        for (model, before, placement) in places {
            all.push(Instance { model, before, first: next, placement });
            let count = u32::try_from(models.get(model as usize)?.geometry.triangles.len()).ok()?;
            next = next.checked_add(count).filter(|n| *n < u32::MAX)?;
        }
        Some(Instances { models, all, shift: DVec3::ZERO, first, triangles: next - first })
    }

    /// Triangles of all instances.
    pub fn triangles(&self) -> u32 {
        self.triangles
    }

    /// The model of an instance.
    #[inline]
    pub fn model(&self, instance: &Instance) -> &Model {
        &self.models[instance.model as usize]
    }

    /// Which instance triangle number `i` belongs to, and which triangle of the model it is. `None` for a primitive of
    /// the geometry itself.
    pub fn locate(&self, i: u32) -> Option<(usize, usize)> {
        let own = i < self.first || i - self.first >= self.triangles;
        let at = self.all.partition_point(|p| p.first <= i);
        (!own && at > 0).then(|| (at - 1, (i - self.all[at - 1].first) as usize))
    }

    /// The corners of triangle number `i`; `None` as for [`Instances::locate`].
    pub fn triangle(&self, i: u32) -> Option<[DVec3; 3]> {
        let (instance, triangle) = self.locate(i)?;
        Some(self.corners(&self.all[instance], triangle))
    }

    /// The corners of a triangle of an instance.
    #[inline(always)]
    pub fn corners(&self, instance: &Instance, triangle: usize) -> [DVec3; 3] {
        let corners = self.model(instance).geometry.triangle(triangle);
        corners.map(|p| instance.placement.place(p, self.shift))
    }

    /// The number that primitive `i` would have if all instances were stored: by parts in their order, cubes last.
    pub fn number_when_stored(&self, i: u32, own_triangles: usize) -> u32 {
        if let Some((instance, _)) = self.locate(i) {
            return i - self.first + self.all[instance].before;
        }
        if i as usize >= own_triangles {
            return i + self.triangles;
        }
        let at = self.all.partition_point(|p| p.before <= i);
        i + self.all.get(at).map_or(self.triangles, |p| p.first - self.first)
    }

    /// Whether triangle `new` of an instance that stands after `before` triangles wins against `old` at the same distance.
    #[inline(always)]
    pub(super) fn comes_first(&self, new: u32, before: u32, old: u32) -> bool {
        if old < self.first { old >= before } else { new < old }
    }

    /// A box around each instance, wide enough for all rounding.
    pub fn boxes(&self) -> Vec<Aabb> {
        self.all.par_iter().with_min_len(64).map(|i| self.bounds_of(i)).collect()
    }

    /// A box around an instance, wide enough for all rounding.
    pub fn bounds_of(&self, instance: &Instance) -> Aabb {
        let (p, model) = (&instance.placement, self.model(instance));
        let matrix = p.matrix();
        let spread = DMat3::from_cols(matrix.x_axis.abs(), matrix.y_axis.abs(), matrix.z_axis.abs());
        let around = model.outline.iter().fold(Aabb::EMPTY, |all, cell| {
            let (middle, half) = (p.place(cell.centre(), self.shift), spread * (cell.size() * 0.5));
            all.union(Aabb { min: middle - half, max: middle + half })
        });
        let margin = DVec3::splat(ROUNDING * p.magnitude(self.shift, model.reach) + f64::MIN_POSITIVE);
        Aabb { min: around.min - margin, max: around.max + margin }
    }

    /// The exact box around an instance.
    pub fn exact_bounds_of(&self, instance: &Instance) -> Aabb {
        let place = |v: &DVec3| instance.placement.place(*v, self.shift);
        let vertices = self.model(instance).geometry.vertices.par_iter().with_min_len(1 << 14);
        vertices.fold(|| Aabb::EMPTY, |b, v| b.with(place(v))).reduce(|| Aabb::EMPTY, Aabb::union)
    }

    /// The exact box around `known` and all instances. Only the vertices of instances that may reach beyond are computed.
    pub fn exact_bounds(&self, known: Aabb) -> Aabb {
        let boxes = self.boxes();
        let mut exact = known;
        let mut order: Vec<usize> = (0..boxes.len()).collect();
        for axis in 0..3 {
            for upper in [false, true] {
                let reach = |b: &Aabb| if upper { b.max[axis] } else { -b.min[axis] };
                order.sort_unstable_by(|&a, &b| reach(&boxes[b]).total_cmp(&reach(&boxes[a])));
                for &i in &order {
                    if reach(&boxes[i]) <= reach(&exact) {
                        break;
                    }
                    exact = exact.union(self.exact_bounds_of(&self.all[i]));
                }
            }
        }
        exact
    }

    /// The map into the model's frame; `None` for a scale that cannot be inverted.
    pub(super) fn world_to_instance(&self, instance: &Instance) -> Option<WorldToInstance> {
        let p = &instance.placement;
        let matrix = p.matrix().inverse();
        let stretch = matrix.x_axis.length() + matrix.y_axis.length() + matrix.z_axis.length();
        let magnitude = p.magnitude(self.shift, self.model(instance).reach);
        let anchor = p.place(DVec3::ZERO, self.shift);
        (stretch.is_finite() && stretch > 0.0).then_some(WorldToInstance {
            matrix,
            anchor,
            magnitude,
            stretch,
        })
    }

    /// Bytes that models and places occupy.
    pub fn memory(&self) -> usize {
        self.models.iter().map(|m| m.memory()).sum::<usize>()
            + self.all.capacity() * size_of::<Instance>()
            + size_of::<Instances>()
    }
}
