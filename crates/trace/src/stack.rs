//! Stacks of nodes that wait to be visited.

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
    fn the_nearest_is_on_top_and_what_was_below_stays_there() {
        let (mut stack, mut height) = ([('a', 0.5); 8], 2);
        for visit in [('b', 2.0), ('c', 3.0), ('d', 1.0), ('e', 2.0)] {
            height = insert_by_depth(&mut stack, (2, height), visit, |v| v.1);
        }
        assert_eq!(height, 6);
        assert_eq!(stack[..height].iter().map(|v| v.0).collect::<String>(), "aacbed");
    }
}
