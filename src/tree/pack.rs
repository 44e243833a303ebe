//! Serialisation of trees and instances as arrays of a file.

use super::block::Block;
use super::frame::Frame;
use super::index::{InstanceTree, Nodes};
use super::instances::{Instances, Model, Placement};
use super::node::{KdNode, WideChild, WideNode};
use super::options::Statistics;
use super::{Geometry, Hits, Tree};
use crate::error::{Error, Result};
use crate::geom::{Aabb, Rotation};
use crate::store::{ArrayFile, ArrayFileWriter, ByteReader, ByteWriter, UnexpectedEnd};
use std::sync::Arc;

/// The error for values that end too early.
fn cut(file: &ArrayFile) -> impl FnOnce(UnexpectedEnd) -> Error {
    |UnexpectedEnd| file.refuse("its contents end too early")
}

impl Geometry {
    /// Writes the arrays under names that begin with `name`.
    pub fn pack(&self, name: &str, out: &mut ArrayFileWriter) -> Result<()> {
        out.array(format!("{name}.vertices"), &self.vertices)?;
        out.array(format!("{name}.triangles"), &self.triangles)?;
        out.array(format!("{name}.cubes"), &self.cubes)
    }

    /// Reads the arrays written by [`Geometry::pack`].
    ///
    /// # Errors
    /// As for [`ArrayFile::array`].
    pub fn unpack(name: &str, file: &ArrayFile) -> Result<Geometry> {
        Ok(Geometry {
            vertices: file.array(&format!("{name}.vertices"))?,
            triangles: file.array(&format!("{name}.triangles"))?,
            cubes: file.array(&format!("{name}.cubes"))?,
        })
    }

    /// Whether all vertex numbers of triangles are valid.
    pub fn is_sound(&self) -> bool {
        let count = self.vertices.len();
        self.triangles.iter().flatten().all(|&v| (v as usize) < count)
    }
}

impl Tree {
    /// Writes the tree without its instances: arrays to `out` under names that begin with `name`, other values to
    /// `words`.
    pub fn pack(&self, name: &str, out: &mut ArrayFileWriter, words: &mut ByteWriter) -> Result<()> {
        words.vector(self.frame.origin);
        words.f64(self.frame.scale);
        self.bounds.as_flattened().iter().for_each(|x| words.f64(f64::from(*x)));
        let s = self.statistics();
        [s.primitives, s.references, s.interior, s.leaves, s.max_depth as usize, s.max_leaf, s.min_leaf]
            .into_iter()
            .for_each(|n| words.u64(n as u64));
        words.f64(s.root_area);
        words.f64(s.cost);
        words.option(s.booked_cost, ByteWriter::f64);
        words.flag(matches!(self.nodes, Nodes::Wide(_)));
        match &self.nodes {
            Nodes::Kd(nodes) => out.array(format!("{name}.nodes"), nodes)?,
            Nodes::Wide(nodes) => out.array(format!("{name}.nodes"), nodes)?,
        }
        out.array(format!("{name}.blocks"), &self.blocks)
    }

    /// Reads a tree written by [`Tree::pack`].
    ///
    /// # Errors
    /// As for [`ArrayFile::array`].
    pub fn unpack(name: &str, file: &ArrayFile, words: &mut ByteReader) -> Result<Tree> {
        let mut head = || {
            let frame = Frame { origin: words.vector()?, scale: words.f64()? };
            let mut bounds = [[0.0f32; 3]; 2];
            for x in bounds.as_flattened_mut() {
                *x = words.f64()? as f32;
            }
            let statistics = Statistics {
                primitives: words.size()?,
                references: words.size()?,
                interior: words.size()?,
                leaves: words.size()?,
                max_depth: words.u32()?,
                max_leaf: words.size()?,
                min_leaf: words.size()?,
                root_area: words.f64()?,
                cost: words.f64()?,
                booked_cost: words.option(ByteReader::f64)?,
            };
            Ok((frame, bounds, statistics, words.flag()?))
        };
        let (frame, bounds, statistics, is_wide) = head().map_err(cut(file))?;
        let nodes = format!("{name}.nodes");
        let nodes = match is_wide {
            true => Nodes::Wide(file.array::<WideNode>(&nodes)?),
            false => Nodes::Kd(file.array::<KdNode>(&nodes)?),
        };
        let blocks = file.array::<Block>(&format!("{name}.blocks"))?;
        Ok(Tree::of(frame, bounds, nodes, blocks, statistics))
    }

    /// Whether all numbers in the trees are those of nodes, blocks and primitives that exist.
    pub fn is_sound(&self, geometry: &Geometry) -> bool {
        let Some(instances) = &self.instances else { return self.is_sound_over(geometry.len(), geometry) };
        let models = instances.models.iter().zip(&instances.instances.models);
        self.is_sound_over(geometry.len(), geometry)
            && models.into_iter().all(|(tree, m)| tree.is_sound_over(m.geometry.len(), &m.geometry))
            && instances.top.is_sound_over(instances.instances.all.len(), &Geometry::default())
    }

    fn is_sound_over(&self, primitives: usize, geometry: &Geometry) -> bool {
        let (blocks, vertices) = (self.blocks.len(), geometry.vertices.len());
        let is_child =
            |count: usize| move |c: &WideChild| c.number().map_or_else(|b| b < blocks, |n| n < count);
        let nodes = match &self.nodes {
            Nodes::Kd(nodes) => nodes.iter().all(|n| match n.axis() {
                Some(_) => n.child() + 1 < nodes.len(),
                None => n.blocks().end <= blocks,
            }),
            Nodes::Wide(nodes) => nodes.iter().flat_map(|n| &n.child).all(is_child(nodes.len())),
        };
        let is_primitive = |id: &u32| *id == Hits::MISS || (*id as usize) < primitives;
        let is_vertex = |v: &u32| *v == 0 || (*v as usize) < vertices;
        nodes
            && self.blocks.iter().all(|block| {
                block.id.iter().all(is_primitive) && block.vertex.as_flattened().iter().all(is_vertex)
            })
    }

    /// Writes the trees of instances, as arrays under names that begin with `name`.
    pub fn pack_instances(
        &self,
        name: &str,
        out: &mut ArrayFileWriter,
        words: &mut ByteWriter,
    ) -> Result<()> {
        let Some(trees) = &self.instances else { return Ok(()) };
        trees.top.pack(&format!("{name}top"), out, words)?;
        trees.models.iter().enumerate().try_for_each(|(i, m)| m.pack(&format!("{name}model {i}"), out, words))
    }

    /// Adds the trees written by [`Tree::pack_instances`].
    ///
    /// # Errors
    /// As for [`ArrayFile::array`].
    pub fn unpack_instances(
        mut self,
        name: &str,
        instances: &Arc<Instances>,
        file: &ArrayFile,
        words: &mut ByteReader,
    ) -> Result<Tree> {
        let top = Tree::unpack(&format!("{name}top"), file, words)?;
        let models =
            (0..instances.models.len()).map(|i| Tree::unpack(&format!("{name}model {i}"), file, words));
        let models = models.collect::<Result<_>>()?;
        self.instances = Some(Box::new(InstanceTree { instances: instances.clone(), models, top }));
        Ok(self)
    }
}

impl Instances {
    /// Writes models and placements, the models as arrays under names that begin with `name`.
    pub fn pack(&self, name: &str, out: &mut ArrayFileWriter, words: &mut ByteWriter) -> Result<()> {
        words.vector(self.shift);
        words.u64(u64::from(self.first));
        words.list(&self.models, |w, m| {
            w.f64(m.reach());
            w.list(m.outline(), |w, b| {
                w.vector(b.min);
                w.vector(b.max);
            });
        });
        words.list(&self.all, |w, i| {
            [i.model, i.before].into_iter().for_each(|n| w.u64(u64::from(n)));
            let p = &i.placement;
            [p.rotation.w, p.scale, p.raise].into_iter().for_each(|x| w.f64(x));
            w.vector(p.rotation.u);
            w.vector(p.offset);
        });
        self.models.iter().enumerate().try_for_each(|(i, m)| m.geometry.pack(&format!("{name}mesh {i}"), out))
    }

    /// Reads instances written by [`Instances::pack`].
    ///
    /// # Errors
    /// As for [`ArrayFile::array`].
    pub fn unpack(name: &str, file: &ArrayFile, words: &mut ByteReader) -> Result<Instances> {
        let mut head = || {
            let (shift, first) = (words.vector()?, words.u32()?);
            let models = words.list(|r| {
                let reach = r.f64()?;
                Ok((reach, r.list(|r| Ok(Aabb { min: r.vector()?, max: r.vector()? }))?))
            })?;
            let places = words.list(|r| {
                let (model, before) = (r.u32()?, r.u32()?);
                let (w, scale, raise) = (r.f64()?, r.f64()?, r.f64()?);
                let rotation = Rotation { w, u: r.vector()? };
                Ok((model, before, Placement { rotation, scale, offset: r.vector()?, raise }))
            })?;
            Ok((shift, first, models, places))
        };
        let (shift, first, outlines, places) = head().map_err(cut(file))?;
        let mut models = Vec::with_capacity(outlines.len());
        for (i, (reach, outline)) in outlines.into_iter().enumerate() {
            let geometry = Geometry::unpack(&format!("{name}mesh {i}"), file)?;
            models.push(Arc::new(Model::of(geometry, reach, outline)));
        }
        let instances = Instances::new(models, places, first as usize);
        let mut instances = instances.ok_or_else(|| file.refuse("its instances cannot be numbered"))?;
        instances.shift = shift;
        Ok(instances)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{DVec3, unit};
    use crate::rng::{Purpose, Stream};
    use crate::tree::{BuildOptions, Builder, Cube};

    #[test]
    fn the_layout_of_arrays_is_that_of_the_file_s_version() {
        // A change of these layouts changes the content of packed scenes: increment the version of the file.
        let sizes = (size_of::<Block>(), size_of::<WideNode>(), size_of::<KdNode>(), size_of::<Cube>());
        assert_eq!(sizes, (832, 448, 8, 32));
    }

    #[test]
    fn trees_and_instances_from_a_file_hit_the_same() {
        let random = Stream::new(5, Purpose::Range);
        let point = |i: u32, k: u32| 10.0 * random.uniform(k, u64::from(i), 0) - 5.0;
        let mesh = |n: u32| Geometry {
            vertices: (0..3 * n).map(|i| DVec3::new(point(i, 1), point(i, 77), point(i, 5))).collect(),
            triangles: (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            cubes: vec![Cube { centre: DVec3::splat(3.0), half: 0.5 }; usize::from(n > 50)],
        };
        let (own, model) = (mesh(100), mesh(40));
        let place = |x: f64| Placement { offset: DVec3::X * x, scale: 0.5, ..Placement::IDENTITY };
        let places = [(0, 10, place(9.0)), (0, 20, place(-9.0))];
        let mut instances = Instances::new(vec![Arc::new(Model::new(model))], places, own.len()).unwrap();
        instances.shift = DVec3::splat(0.25);
        let instances = Arc::new(instances);
        for builder in [Builder::Bvh, Builder::Fsah] {
            let options = BuildOptions::of(builder);
            let tree = Tree::build(&own, &options).with_instances(&instances, &options);
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("t.vlscene");
            let (mut out, mut words) = (ArrayFileWriter::create(&path).unwrap(), ByteWriter::default());
            own.pack("own", &mut out).unwrap();
            tree.pack("tree", &mut out, &mut words).unwrap();
            instances.pack("a ", &mut out, &mut words).unwrap();
            tree.pack_instances("a ", &mut out, &mut words).unwrap();
            out.finish().unwrap();
            let file = ArrayFile::open(&path).unwrap();
            let mut reader = ByteReader(words.bytes());
            let again = Geometry::unpack("own", &file).unwrap();
            assert!(again.is_sound());
            let read = Tree::unpack("tree", &file, &mut reader).unwrap();
            let placed = Arc::new(Instances::unpack("a ", &file, &mut reader).unwrap());
            let read = read.unpack_instances("a ", &placed, &file, &mut reader).unwrap();
            assert!(read.is_sound(&again) && !read.is_sound(&Geometry::default()));
            assert_eq!(placed.all, instances.all);
            assert_eq!(placed.shift, instances.shift);
            let mut found = 0;
            for i in 0..500 {
                let origin = DVec3::new(point(i, 3) * 3.0, -20.0, point(i, 9));
                let d = unit(DVec3::new(point(i, 11) * 0.1, 1.0, point(i, 13) * 0.1));
                let hit = tree.nearest_where(&own, origin, d, |_| true);
                found += usize::from(hit.is_some());
                assert_eq!(read.nearest_where(&again, origin, d, |_| true), hit);
            }
            assert!(found > 100, "{found}");
            assert_eq!(read.statistics(), tree.statistics());
        }
    }
}
