//! Stacks of nodes that wait to be visited.

use crate::block::BLOCK_SIZE;
use crate::frustum::DEPTH_MARGIN;

/// Removes nodes from a stack of single rays, each with its depth of entry, until there is one that the ray
/// enters up to the depth `limit`, and returns this one.
#[inline(always)]
pub(crate) fn pop_within<N: Copy>(stack: &[(N, f32)], height: &mut usize, limit: f32) -> Option<N> {
    while *height > 0 {
        *height -= 1;
        let (node, enter) = stack[*height];
        if enter > limit * DEPTH_MARGIN {
            continue;
        }
        return Some(node);
    }
    None
}

/// Adds the children of a node in the lanes of a mask, which the ray enters at these depths, to a stack of
/// single rays, the nearest on top.
#[inline(always)]
pub(crate) fn push_children<N: Copy>(
    stack: &mut [(N, f32)],
    height: &mut usize,
    (mut lanes, depths): (u32, &[f32; BLOCK_SIZE]),
    child: impl Fn(usize) -> N,
) {
    let floor = *height;
    while lanes != 0 {
        let lane = lanes.trailing_zeros() as usize;
        let visit = (child(lane), depths[lane]);
        *height = insert_by_depth(stack, (floor, *height), visit, |visit| visit.1);
        lanes &= lanes - 1;
    }
}

/// Inserts a node among the last ones of a stack, those from `floor` on, so that the one with the least depth
/// of entry is on top. Returns the new height of the stack.
#[inline(always)]
pub(crate) fn insert_by_depth<V: Copy>(
    stack: &mut [V],
    (floor, height): (usize, usize),
    visit: V,
    enter: impl Fn(&V) -> f32,
) -> usize {
    let (depth, mut at) = (enter(&visit), height);
    while at > floor && enter(&stack[at - 1]) < depth {
        stack[at] = stack[at - 1];
        at -= 1;
    }
    stack[at] = visit;
    height + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_behind_the_limit_are_removed() {
        let (mut stack, mut height) = ([('r', 0.0); 8], 1);
        assert_eq!(pop_within(&stack, &mut height, 5.0), Some('r'));
        let depths = std::array::from_fn(|lane| (BLOCK_SIZE - lane) as f32);
        push_children(&mut stack, &mut height, (0b1001_0000_0000_0001, &depths), |lane| {
            ['a', 'b', 'c'][lane / 6]
        });
        assert_eq!(height, 3);
        assert_eq!(pop_within(&stack, &mut height, 5.0), Some('c'), "lane 15 has the depth 1");
        assert_eq!(pop_within(&stack, &mut height, 5.0), Some('c'), "lane 12 has the depth 4");
        assert_eq!((pop_within(&stack, &mut height, 5.0), height), (None, 0), "lane 0 has the depth 16");
    }

    #[test]
    fn the_nearest_is_on_top_and_what_was_below_stays_there() {
        let (mut stack, mut height) = ([('a', 0.5); 8], 2);
        for visit in [('b', 2.0), ('c', 3.0), ('d', 1.0), ('e', 2.0)] {
            height = insert_by_depth(&mut stack, (2, height), visit, |v| v.1);
        }
        assert_eq!(height, 6);
        assert_eq!(stack[..height].iter().map(|v| v.0).collect::<String>(), "aacbed");
    }
}
