//! Instances: models with several placements that are stored once.
//!
//! A scene of instances has the primitives that copies of every model at its placements would have, and the
//! exact test uses exactly the corners that copies would store: [`Placement::place`] computes them from the
//! model's when they are needed. The models' trees and the tree over the boxes of all instances are filters
//! only: rays are transformed into the model's frame with a margin for all rounding of the transformation.

use super::Geometry;
use crate::memory::vec_bytes;
use glam::DMat3;
use rayon::prelude::*;
use std::sync::Arc;
use vlscan_geom::{Aabb, DVec3, Rotation};

/// Bound of the rounding error of a placed point and of the inverse transformation, relative to the largest
/// number involved.
const ROUNDING: f64 = 1e-14;

const OUTLINE_CELLS: usize = 8;

/// Transformation of a model into the scene: `scale · R · W · p + offset`, then up by `raise`. W multiplies x
/// and y by `widening`.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Placement {
    /// R.
    pub rotation: Rotation,
    /// Factor of x and y of the model beyond that of z, above 0.
    pub widening: f64,
    /// Scale, may be negative.
    pub scale: f64,
    /// Offset, m.
    pub offset: DVec3,
    /// Added to z last, m; −0 leaves every z unchanged, which +0 would not.
    pub raise: f64,
}

impl Placement {
    /// Leaves every point where it is.
    pub const IDENTITY: Placement = Placement {
        rotation: Rotation::IDENTITY,
        widening: 1.0,
        scale: 1.0,
        offset: DVec3::ZERO,
        raise: -0.0,
    };

    /// Returns the image of a point of the model, less `shift`, with the arithmetic of a scene that stores
    /// the image.
    #[inline(always)]
    pub fn place(&self, p: DVec3, shift: DVec3) -> DVec3 {
        let p = self.rotation.apply(self.widened(p)) * self.scale + self.offset;
        DVec3::new(p.x, p.y, p.z + self.raise) - shift
    }

    #[inline(always)]
    fn widened(&self, p: DVec3) -> DVec3 {
        DVec3::new(p.x * self.widening, p.y * self.widening, p.z)
    }

    fn matrix(&self) -> DMat3 {
        let column = |v| self.rotation.apply(self.widened(v)) * self.scale;
        DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z))
    }

    /// Bound of the numbers that occur when a point with coordinates within `reach` is placed.
    pub fn magnitude(&self, shift: DVec3, reach: f64) -> f64 {
        let largest = |v: DVec3| v.abs().max_element();
        let factor = self.scale.abs() * self.widening.abs().max(1.0);
        largest(self.offset) + largest(shift) + self.raise.abs() + 4.0 * factor * reach
    }
}

/// The map from the scene's frame into a model's.
#[derive(Clone, Copy, Debug)]
pub(super) struct WorldToInstance {
    matrix: DMat3,
    /// Image of the model's origin in the scene.
    anchor: DVec3,
    /// Bound of the numbers that occur when a point is placed.
    magnitude: f64,
    /// Bound of the factor by which the matrix enlarges an error.
    stretch: f64,
}

impl WorldToInstance {
    /// Returns the image of a point, and the bound of its error on any axis.
    pub fn point(&self, p: DVec3) -> (DVec3, f64) {
        (self.matrix * (p - self.anchor), self.error_at(p.abs().max_element()))
    }

    /// Bound of the error of the image of a point with coordinates within `reach`, on any axis.
    pub fn error_at(&self, reach: f64) -> f64 {
        ROUNDING * (self.magnitude + reach) * self.stretch
    }

    /// The matrix of directions; `t` along the image of a direction equals `t` along the direction.
    pub fn matrix(&self) -> DMat3 {
        self.matrix
    }

    /// The point whose image is the model's origin.
    pub fn anchor(&self) -> DVec3 {
        self.anchor
    }
}

/// A mesh that instances place in the scene.
#[derive(Clone, Debug)]
pub struct Model {
    /// Its triangles, in the model's frame; no cubes.
    pub geometry: Geometry,
    /// Largest absolute coordinate, m.
    reach: f64,
    /// Boxes that together contain all vertices: after rotation several boxes are a tighter bound than one.
    outline: Vec<Aabb>,
}

impl Model {
    /// Creates a model from its triangles and computes its reach and outline.
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

    /// A model whose reach and outline are known, see [`Model::reach`] and [`Model::outline`].
    pub fn from_parts(geometry: Geometry, reach: f64, outline: Vec<Aabb>) -> Model {
        Model { geometry, reach, outline }
    }

    /// Box around the model at a placement, less `shift`, widened for all rounding and by up to an eighth of
    /// its size.
    pub fn box_at(&self, placement: &Placement, shift: DVec3) -> Aabb {
        let matrix = placement.matrix();
        let spread = DMat3::from_cols(matrix.x_axis.abs(), matrix.y_axis.abs(), matrix.z_axis.abs());
        let around = self.outline.iter().fold(Aabb::EMPTY, |all, cell| {
            let (middle, half) = (placement.place(cell.centre(), shift), spread * (cell.size() * 0.5));
            all.union(Aabb { min: middle - half, max: middle + half })
        });
        let margin = DVec3::splat(ROUNDING * placement.magnitude(shift, self.reach) + f64::MIN_POSITIVE);
        Aabb { min: around.min - margin, max: around.max + margin }
    }

    /// Boxes that together contain all vertices.
    pub fn outline(&self) -> &[Aabb] {
        &self.outline
    }

    /// Largest absolute coordinate of a vertex, m.
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// Memory of vertices, triangles and outline, bytes.
    pub fn memory(&self) -> usize {
        vec_bytes(&self.geometry.vertices)
            + vec_bytes(&self.geometry.triangles)
            + self.outline.capacity() * size_of::<Aabb>()
    }
}

/// One placement of a model in the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Index of its model in [`Instances::models`].
    pub model: u32,
    /// Number of the geometry's own triangles that would precede this model if it were stored among them:
    /// decides between equal distances as storage would.
    pub before: u32,
    /// Number of its first triangle.
    pub first: u32,
    /// Transformation of the model into the scene.
    pub placement: Placement,
}

/// All instances of a scene. The numbers of their triangles follow those of the scene's own primitives.
#[derive(Clone, Debug, Default)]
pub struct Instances {
    /// The distinct models, each stored once.
    pub models: Vec<Arc<Model>>,
    /// The instances, with ascending `first` and `before`.
    pub all: Vec<Instance>,
    /// Subtracted from every placed point, m.
    pub shift: DVec3,
    /// Number of the first triangle of any instance, equal to the number of primitives of the geometry
    /// itself.
    pub(super) first: u32,
    /// Number of triangles of all instances.
    triangles: u32,
    index: InstanceIndex,
}

/// Finds the instance of a triangle without a search through all of them: the instances of equally long
/// ranges of triangle numbers.
#[derive(Clone, Debug, Default)]
struct InstanceIndex {
    /// Logarithm of the length of a range.
    shift: u32,
    /// The last instance that begins before each range or with it; one entry more than there are ranges.
    instances: Vec<u32>,
}

impl InstanceIndex {
    /// The index of instances whose triangles, `triangles` in all, begin at number `first`.
    fn new(all: &[Instance], first: u32, triangles: u32) -> InstanceIndex {
        // About two ranges per instance.
        let shift = (triangles as usize / (2 * all.len() + 1)).checked_ilog2().unwrap_or(0);
        let mut at = 0;
        let instance_at = |range: u64| {
            let number = u64::from(first) + (range << shift);
            at += all[at..].partition_point(|p| u64::from(p.first) <= number);
            at = at.saturating_sub(1);
            at as u32
        };
        InstanceIndex { shift, instances: (0..u64::from(triangles >> shift) + 2).map(instance_at).collect() }
    }

    /// The instances among which is that of the `n`-th triangle of all instances.
    #[inline(always)]
    fn around(&self, n: u32) -> Option<std::ops::Range<usize>> {
        let range = (n >> self.shift) as usize;
        let [from, to] = self.instances.get(range..range + 2)? else { return None };
        Some(*from as usize..*to as usize + 1)
    }
}

impl Instances {
    /// Creates instances of `models`: for each instance the model's number, the number of the geometry's
    /// triangles before it (ascending) and its placement. `first` is the number of primitives in the geometry
    /// itself. Returns `None` when the triangles cannot be numbered with 32 bits.
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
        let index = InstanceIndex::new(&all, first, next - first);
        Some(Instances { models, all, shift: DVec3::ZERO, first, triangles: next - first, index })
    }

    /// Number of the first triangle of any instance, equal to the number of primitives of the geometry
    /// itself.
    pub fn first(&self) -> u32 {
        self.first
    }

    /// Number of triangles of all instances.
    pub fn triangles(&self) -> u32 {
        self.triangles
    }

    /// Returns the model of an instance.
    #[inline]
    pub fn model(&self, instance: &Instance) -> &Model {
        &self.models[instance.model as usize]
    }

    /// Returns the instance that triangle number `i` belongs to, and the number of the triangle in its model.
    /// `None` for a primitive of the geometry itself.
    #[inline]
    pub fn locate(&self, i: u32) -> Option<(usize, usize)> {
        let n = i.checked_sub(self.first).filter(|n| *n < self.triangles)?;
        let some = self.index.around(n)?;
        let at = some.start + self.all[some.start + 1..some.end].partition_point(|p| p.first <= i);
        Some((at, (i - self.all[at].first) as usize))
    }

    /// Returns the corners of triangle number `i`; `None` for a primitive of the geometry itself.
    pub fn triangle(&self, i: u32) -> Option<[DVec3; 3]> {
        let (instance, triangle) = self.locate(i)?;
        Some(self.corners(&self.all[instance], triangle))
    }

    /// Returns the corners, in the scene, m, of the triangle that has this number in the instance's model.
    #[inline(always)]
    pub fn corners(&self, instance: &Instance, triangle: usize) -> [DVec3; 3] {
        let corners = self.model(instance).geometry.triangle(triangle);
        corners.map(|p| instance.placement.place(p, self.shift))
    }

    /// Returns the number that primitive `i` would have if all instances were stored: in the order of parts,
    /// cubes last; and that of the first triangle of its model, or `i` itself, among the geometry's own.
    pub fn number_when_stored(&self, i: u32, own_triangles: usize) -> (u32, u32) {
        if let Some((instance, _)) = self.locate(i) {
            let before = self.all[instance].before;
            return (i - self.first + before, before);
        }
        if i as usize >= own_triangles {
            return (i + self.triangles, i);
        }
        let at = self.all.partition_point(|p| p.before <= i);
        (i + self.all.get(at).map_or(self.triangles, |p| p.first - self.first), i)
    }

    /// True if triangle `new` of an instance, preceded by `before` own triangles, wins against `old` at the
    /// same distance.
    #[inline(always)]
    pub(super) fn comes_first(&self, new: u32, before: u32, old: u32) -> bool {
        if old < self.first { old >= before } else { new < old }
    }

    /// Boxes around the instances, widened for all rounding.
    pub fn boxes(&self) -> Vec<Aabb> {
        self.all.par_iter().with_min_len(64).map(|i| self.bounds_of(i)).collect()
    }

    /// Box around an instance, widened for all rounding.
    pub fn bounds_of(&self, instance: &Instance) -> Aabb {
        self.model(instance).box_at(&instance.placement, self.shift)
    }

    /// Exact box around the placed vertices of an instance; takes time proportional to their number.
    pub fn exact_bounds_of(&self, instance: &Instance) -> Aabb {
        let place = |v: &DVec3| instance.placement.place(*v, self.shift);
        let vertices = self.model(instance).geometry.vertices.par_iter().with_min_len(1 << 14);
        vertices.fold(|| Aabb::EMPTY, |b, v| b.with(place(v))).reduce(|| Aabb::EMPTY, Aabb::union)
    }

    /// Exact box around `known` and all instances. Computes only the vertices of instances that may extend
    /// it.
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

    /// Returns the map into the model's frame; `None` for a scale that cannot be inverted.
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

    /// Memory of models and placements in bytes.
    pub fn memory(&self) -> usize {
        self.models.iter().map(|m| m.memory()).sum::<usize>()
            + self.all.capacity() * size_of::<Instance>()
            + vec_bytes(&self.index.instances)
            + size_of::<Instances>()
    }
}
