//! Trees as plain arrays and numbers, for programs that store them.

use crate::block::Block;
use crate::frame::Frame;
use crate::heights::FieldBoxes;
use crate::index::{InstanceTree, Nodes};
use crate::node::{KdNode, WideChild, WideNode};
use crate::options::Statistics;
use crate::{Geometry, Hits, Instances, Tree};
use std::borrow::Cow;
use std::sync::Arc;

/// The nodes of a tree.
#[derive(Clone, Debug)]
pub enum NodeArray<'a> {
    /// Nodes of a kd-tree.
    Kd(Cow<'a, [KdNode]>),
    /// Nodes of a hierarchy of boxes.
    Wide(Cow<'a, [WideNode]>),
}

/// A tree without its instances, in a form for files. Nodes and blocks are plain memory ([`bytemuck::Pod`])
/// in the byte order of the machine.
#[derive(Clone, Debug)]
pub struct TreeParts<'a> {
    /// The frame of nodes and blocks.
    pub frame: Frame,
    /// Lower and upper corner of everything, in the frame.
    pub bounds: [[f32; 3]; 2],
    /// Size, depth and expected cost.
    pub statistics: Statistics,
    /// Interior nodes and leaves.
    pub nodes: NodeArray<'a>,
    /// Blocks of the leaves.
    pub blocks: Cow<'a, [Block]>,
}

impl Tree {
    /// The tree as plain arrays and numbers, without its instances.
    pub fn parts(&self) -> TreeParts<'_> {
        TreeParts {
            frame: self.frame,
            bounds: self.bounds,
            statistics: *self.statistics(),
            nodes: match &self.nodes {
                Nodes::Kd(nodes) => NodeArray::Kd(Cow::Borrowed(nodes)),
                Nodes::Wide(nodes) => NodeArray::Wide(Cow::Borrowed(nodes)),
            },
            blocks: Cow::Borrowed(&self.blocks),
        }
    }

    /// The tree of these parts, which was built over `geometry`, without instances. Parts of unknown origin
    /// must be checked by [`Tree::is_sound`] before the tree is used.
    pub fn from_parts(parts: TreeParts, geometry: &Geometry) -> Tree {
        let nodes = match parts.nodes {
            NodeArray::Kd(nodes) => Nodes::Kd(nodes.into_owned()),
            NodeArray::Wide(nodes) => Nodes::Wide(nodes.into_owned()),
        };
        let fields = FieldBoxes::over(&geometry.fields, &parts.frame);
        Tree::of(parts.frame, parts.bounds, nodes, (parts.blocks.into_owned(), fields), parts.statistics)
    }

    /// The tree over the boxes of the instances, and the tree of each model; `None` without instances.
    pub fn instance_trees(&self) -> Option<(&Tree, &[Tree])> {
        self.instances.as_ref().map(|i| (&i.top, &i.models[..]))
    }

    /// Adds instances and their trees, as [`Tree::instance_trees`] returned them.
    pub fn with_instance_trees(mut self, instances: &Arc<Instances>, top: Tree, models: Vec<Tree>) -> Tree {
        self.instances = Some(Box::new(InstanceTree { instances: instances.clone(), models, top }));
        self
    }

    /// True if all indices of nodes, blocks and primitives in the trees are in range.
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
}

impl Geometry {
    /// True if all vertex numbers of triangles are valid.
    pub fn is_sound(&self) -> bool {
        let count = self.vertices.len();
        self.triangles.iter().flatten().all(|&v| (v as usize) < count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Cube;

    #[test]
    fn the_layout_of_arrays_is_that_of_files() {
        // A change of these layouts changes what files of trees hold: increment the version of the file.
        let sizes = (size_of::<Block>(), size_of::<WideNode>(), size_of::<KdNode>(), size_of::<Cube>());
        assert_eq!(sizes, (832, 448, 8, 32));
    }
}
