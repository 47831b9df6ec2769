//! Improves the binary tree by reinsertion: subtrees are removed and inserted where the surface area heuristic is
//! lowest (Meister and Bittner 2018, *Parallel reinsertion for bounding volume hierarchy optimization*; the crate
//! obvhs). Binning works top down and cannot see that a large triangle belongs elsewhere; reinsertion can.

use std::collections::VecDeque;

use obvhs::aabb::Aabb;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};

use super::binary::{BinaryNode, BinaryTree, DEEPEST, NodeBounds};

/// Share of the nodes examined in the first round; round `k` examines `1 / (2 k − 1)` of that.
const FIRST_ROUND: f32 = 0.1;
const ROUNDS: u32 = 8;

/// A better tree over the same triangles; `None` if there is nothing to reinsert or the tree would become too deep.
pub(super) fn reinserted(tree: &BinaryTree) -> Option<BinaryTree> {
    if tree.nodes.len() < 4 {
        return None;
    }
    let mut bvh = breadth_first(tree);
    let mut optimizer = ReinsertionOptimizer::default();
    for round in 0..ROUNDS {
        let count = (FIRST_ROUND * bvh.nodes.len() as f32 / (2 * round + 1) as f32) as usize;
        let candidates = candidates(&bvh, count.max(1));
        optimizer.run_with_candidates(&mut bvh, &candidates, 1);
        // The search of a round uses a stack that a deeper tree might overflow.
        if is_too_deep(&bvh) {
            return None;
        }
    }
    let mut better = BinaryTree { nodes: Vec::with_capacity(tree.nodes.len()), order: Vec::new() };
    append_depth_first(&bvh, 0, tree, &mut better);
    Some(better)
}

/// Converts the tree to obvhs' layout: siblings are adjacent, and nodes nearest to the root come first, where obvhs
/// looks for candidates. A leaf's index is that of its node in `tree`.
fn breadth_first(tree: &BinaryTree) -> Bvh2 {
    // Areas of the largest coordinates would overflow. The scale is a power of two, so that nothing is rounded.
    let largest = tree.nodes[0].bounds.min.abs().max(tree.nodes[0].bounds.max.abs()).max_element();
    let scale = if largest > 1e15 { 2f32.powi(-80) } else { 1.0 };
    let node_of = |node: &BinaryNode, index: u32| {
        let bounds = Aabb { min: (node.bounds.min * scale).into(), max: (node.bounds.max * scale).into() };
        Bvh2Node::new(bounds, u32::from(node.second == 0), index)
    };
    let mut nodes = Vec::with_capacity(tree.nodes.len());
    nodes.push(node_of(&tree.nodes[0], 0));
    let mut waiting = VecDeque::from([(0, 0)]);
    while let Some((from, to)) = waiting.pop_front() {
        let BinaryNode { second, .. } = tree.nodes[from as usize];
        if second == 0 {
            continue;
        }
        let at = nodes.len() as u32;
        let place: &mut Bvh2Node = &mut nodes[to as usize];
        place.first_index = at;
        for (child, place) in [(from + 1, at), (second, at + 1)] {
            nodes.push(node_of(&tree.nodes[child as usize], child));
            waiting.push_back((child, place));
        }
    }
    Bvh2 { nodes, ..Bvh2::default() }
}

/// The largest of the nodes nearest to the root, without the root.
fn candidates(bvh: &Bvh2, count: usize) -> Vec<u32> {
    let mut nodes: Vec<u32> = (1..bvh.nodes.len().min(2 * count + 2) as u32).collect();
    let area = |node: &u32| bvh.nodes[*node as usize].aabb().half_area();
    nodes.sort_unstable_by(|a, b| area(b).total_cmp(&area(a)).then(a.cmp(b)));
    nodes.truncate(count);
    nodes
}

fn is_too_deep(bvh: &Bvh2) -> bool {
    let mut waiting = vec![(0, 1)];
    while let Some((node, depth)) = waiting.pop() {
        if depth > DEEPEST {
            return true;
        }
        let node = &bvh.nodes[node as usize];
        if !node.is_leaf() {
            waiting.extend([(node.first_index, depth + 1), (node.first_index + 1, depth + 1)]);
        }
    }
    false
}

/// Appends the subtree of `node`, with bounds recomputed from its leaves; returns its index.
fn append_depth_first(bvh: &Bvh2, node: u32, leaves: &BinaryTree, tree: &mut BinaryTree) -> u32 {
    let index = tree.nodes.len();
    let start = tree.order.len() as u32;
    let node = &bvh.nodes[node as usize];
    let (bounds, second) = if node.is_leaf() {
        let leaf = &leaves.nodes[node.first_index as usize];
        tree.nodes.push(BinaryNode { start, ..*leaf });
        tree.order.push(leaves.order[leaf.start as usize]);
        (leaf.bounds, 0)
    } else {
        tree.nodes.push(BinaryNode { bounds: NodeBounds::EMPTY, start, count: 0, second: 0 });
        append_depth_first(bvh, node.first_index, leaves, tree);
        let second = append_depth_first(bvh, node.first_index + 1, leaves, tree);
        (tree.nodes[index + 1].bounds.union(tree.nodes[second as usize].bounds), second)
    };
    tree.nodes[index] = BinaryNode { bounds, start, count: tree.order.len() as u32 - start, second };
    index as u32
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn tree_of(triangles: impl Iterator<Item = [Vec3; 3]>) -> BinaryTree {
        BinaryTree::build(triangles)
    }

    /// Cost by the surface area heuristic of a binary tree, not divided by the root's area.
    fn cost(tree: &BinaryTree) -> f64 {
        tree.nodes.iter().map(|node| f64::from(node.bounds.half_area())).sum()
    }

    /// Many small triangles and one in a hundred that is as long as the scene.
    fn uneven(count: usize, scale: f32) -> impl Iterator<Item = [Vec3; 3]> {
        let mut state = 1u32;
        let mut next = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1u32 << 24) as f32
        };
        (0..count).map(move |i| {
            let corner = Vec3::new(next(), next(), next());
            let size = if i % 100 == 0 { 1.0 } else { 0.02 };
            std::array::from_fn(|_| scale * (corner + size * Vec3::new(next(), next(), next())))
        })
    }

    #[test]
    fn reinsertion_keeps_every_triangle_and_lowers_the_cost() {
        let tree = tree_of(uneven(5000, 1.0));
        let better = reinserted(&tree).expect("there is something to reinsert");
        let sorted = |tree: &BinaryTree| {
            let mut order = tree.order.clone();
            order.sort_unstable();
            order
        };
        assert_eq!(sorted(&better), sorted(&tree));
        assert_eq!(better.nodes.len(), tree.nodes.len());
        assert!(cost(&better) < 0.97 * cost(&tree), "{} of {}", cost(&better), cost(&tree));
    }

    #[test]
    fn coordinates_whose_areas_overflow_are_reinserted_like_others() {
        let (small, large) = (tree_of(uneven(500, 1.0)), tree_of(uneven(500, 2f32.powi(126))));
        let order = |tree: &BinaryTree| reinserted(tree).expect("there is something to reinsert").order;
        assert_eq!(order(&large).len(), order(&small).len());
    }

    /// Triangles each half as far away as the one before: the deepest tree that the builder makes.
    #[test]
    fn a_tree_never_gets_too_deep_to_be_walked() {
        let along = (0..240).map(|i| {
            let at = 2f32.powi(120 - i);
            [Vec3::splat(at), Vec3::new(at, 1.5 * at, at), Vec3::new(at, at, 1.5 * at)]
        });
        let tree = tree_of(along);
        let better = reinserted(&tree).unwrap_or(tree);
        assert!(!is_too_deep(&breadth_first(&better)));
    }
}
