//! Nodes of the kd-tree, eight bytes each.

/// An interior node or a leaf. The two children of an interior node are neighbours in the array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct KdNode {
    /// Interior: bits of the split position. Leaf: number of blocks.
    payload: u32,
    /// Low two bits: split axis, 3 for a leaf. Others: number of the lower child, or of the first block.
    link: u32,
}

const LEAF: u32 = 3;

impl KdNode {
    /// A node split at `position` on `axis`, whose lower child has number `child`.
    pub fn interior(axis: usize, position: f32, child: usize) -> KdNode {
        KdNode { payload: position.to_bits(), link: pack(child, axis as u32) }
    }

    /// A leaf of `count` blocks from number `first` on.
    pub fn leaf(first: usize, count: usize) -> KdNode {
        KdNode { payload: count as u32, link: pack(first, LEAF) }
    }

    /// Split axis; `None` for a leaf.
    #[inline(always)]
    pub fn axis(self) -> Option<usize> {
        let axis = self.link & 3;
        (axis != LEAF).then_some(axis as usize)
    }

    /// Split position of an interior node.
    #[inline(always)]
    pub fn position(self) -> f32 {
        f32::from_bits(self.payload)
    }

    /// Number of an interior node's lower child; the upper one follows it.
    #[inline(always)]
    pub fn child(self) -> usize {
        (self.link >> 2) as usize
    }

    /// The blocks of a leaf.
    #[inline(always)]
    pub fn blocks(self) -> std::ops::Range<usize> {
        let first = (self.link >> 2) as usize;
        first..first + self.payload as usize
    }

    /// The same node in an array where nodes and blocks are numbered from these offsets on.
    pub fn moved(self, nodes: usize, blocks: usize) -> KdNode {
        let by = if self.axis().is_some() { nodes } else { blocks };
        KdNode { payload: self.payload, link: pack((self.link >> 2) as usize + by, self.link & 3) }
    }
}

fn pack(number: usize, tag: u32) -> u32 {
    assert!(number < 1 << 30, "a tree of more than 2^30 nodes or blocks");
    (number as u32) << 2 | tag
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
        assert_eq!(size_of::<KdNode>(), 8);
    }
}
