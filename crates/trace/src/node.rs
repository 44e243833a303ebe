//! Nodes: of the kd-tree, eight bytes each, and of the wide tree, with sixteen children each.

use super::block::BLOCK_SIZE;
use bytemuck::{Pod, Zeroable};

/// An interior node or a leaf. The two children of an interior node are adjacent in the array.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct KdNode {
    /// Interior: bits of the split position. Leaf: number of blocks.
    payload: u32,
    /// Low two bits: split axis, 3 for a leaf. Others: number of the lower child, or of the first block.
    link: u32,
}

const LEAF_TAG: u32 = 3;

impl KdNode {
    pub(crate) fn interior(axis: usize, position: f32, child: usize) -> KdNode {
        KdNode { payload: position.to_bits(), link: pack(child, axis as u32) }
    }

    /// Creates a leaf of `count` blocks from number `first` on.
    pub fn leaf(first: usize, count: usize) -> KdNode {
        KdNode { payload: count as u32, link: pack(first, LEAF_TAG) }
    }

    #[inline(always)]
    pub(crate) fn axis(self) -> Option<usize> {
        let axis = self.link & 3;
        (axis != LEAF_TAG).then_some(axis as usize)
    }

    #[inline(always)]
    pub(crate) fn position(self) -> f32 {
        f32::from_bits(self.payload)
    }

    /// Number of an interior node's lower child; the upper child has the next number.
    #[inline(always)]
    pub fn child(self) -> usize {
        (self.link >> 2) as usize
    }

    #[inline(always)]
    pub(crate) fn blocks(self) -> std::ops::Range<usize> {
        let first = (self.link >> 2) as usize;
        first..first + self.payload as usize
    }

    /// Returns the node with the numbers of nodes and blocks offset by these amounts. A leaf without blocks
    /// does not change.
    pub fn moved(self, nodes: usize, blocks: usize) -> KdNode {
        if self.axis().is_none() && self.payload == 0 {
            return self;
        }
        let by = if self.axis().is_some() { nodes } else { blocks };
        KdNode { payload: self.payload, link: pack((self.link >> 2) as usize + by, self.link & 3) }
    }
}

fn pack(number: usize, tag: u32) -> u32 {
    assert!(number < 1 << 30, "a tree of more than 2^30 nodes or blocks");
    (number as u32) << 2 | tag
}

/// A node of the wide tree: sixteen boxes side by side, in the tree's frame. Unused lanes hold an inside-out
/// box, which no ray hits.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct WideNode {
    /// Lower corners by axis and lane.
    pub lower: [[f32; BLOCK_SIZE]; 3],
    /// Upper corners by axis and lane.
    pub upper: [[f32; BLOCK_SIZE]; 3],
    /// Child node or block by lane.
    pub child: [WideChild; BLOCK_SIZE],
}

impl WideNode {
    pub(crate) const EMPTY: WideNode = WideNode {
        lower: [[f32::INFINITY; BLOCK_SIZE]; 3],
        upper: [[f32::NEG_INFINITY; BLOCK_SIZE]; 3],
        child: [WideChild(0); BLOCK_SIZE],
    };

    pub(crate) fn set(&mut self, lane: usize, lower: [f32; 3], upper: [f32; 3], child: WideChild) {
        for a in 0..3 {
            self.lower[a][lane] = lower[a];
            self.upper[a][lane] = upper[a];
        }
        self.child[lane] = child;
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct WideChild(u32);

const BLOCK_BIT: u32 = 1 << 31;

impl WideChild {
    pub const ROOT: WideChild = WideChild(0);

    pub fn node(n: usize) -> WideChild {
        assert!(n < BLOCK_BIT as usize, "a tree of more than 2^31 nodes");
        WideChild(n as u32)
    }

    pub fn block(n: usize) -> WideChild {
        assert!(n < BLOCK_BIT as usize, "a tree of more than 2^31 blocks");
        WideChild(n as u32 | BLOCK_BIT)
    }

    /// Returns `Ok` with the number of a node, or `Err` with the number of a block.
    #[inline(always)]
    pub fn number(self) -> Result<usize, usize> {
        let n = (self.0 & !BLOCK_BIT) as usize;
        if self.0 & BLOCK_BIT == 0 { Ok(n) } else { Err(n) }
    }

    /// Returns the child with the numbers of nodes and blocks offset by these amounts.
    pub fn moved(self, nodes: usize, blocks: usize) -> WideChild {
        match self.number() {
            Ok(n) => WideChild::node(n + nodes),
            Err(n) => WideChild::block(n + blocks),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_hold_what_was_put_in() {
        let n = KdNode::interior(2, -0.375, 12_345);
        assert_eq!((n.axis(), n.position(), n.child()), (Some(2), -0.375, 12_345));
        assert_eq!(n.moved(5, 1000).child(), 12_350);
        let l = KdNode::leaf(77, 3);
        assert_eq!((l.axis(), l.blocks()), (None, 77..80));
        assert_eq!(l.moved(5, 1000).blocks(), 1077..1080);
        assert_eq!(KdNode::leaf(0, 0).moved(5, 1000), KdNode::leaf(0, 0));
        assert_eq!(size_of::<KdNode>(), 8);
        assert_eq!(size_of::<WideNode>(), 448);
        assert_eq!(WideChild::node(4).moved(5, 1000).number(), Ok(9));
        assert_eq!(WideChild::block(4).moved(5, 1000).number(), Err(1004));
    }
}
