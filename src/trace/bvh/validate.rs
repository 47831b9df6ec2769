//! Quality and validity of a tree.

use glam::Vec3;

use super::BvhTriangle;
use super::binary::{DEEPEST, NodeBounds};
use super::wide::{LEAF, Packet, SEE_THROUGH, WideNode, WideTree};
use super::{LANES, NODE_COST};

/// Expected work of a random ray that meets the scene's box: nodes opened and leaves tested, by the surface area
/// heuristic (the ratio of areas is the chance to meet a box inside another).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TreeQuality {
    /// Expected nodes opened.
    pub nodes: f64,
    /// Expected leaves tested.
    pub leaves: f64,
    /// Triangles in a leaf on average, of eight.
    pub leaf_fill: f64,
}

impl TreeQuality {
    /// Cost by the surface area heuristic, in tests of a leaf.
    pub fn cost(&self) -> f64 {
        f64::from(NODE_COST) * self.nodes + self.leaves
    }
}

/// Why a tree is invalid.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TreeFault {
    /// A node or leaf that a child refers to does not exist, is referred to twice, or is not referred to at all.
    #[error("the tree does not reach each node and leaf exactly once")]
    Structure,
    /// More levels than the traversal stack has room for.
    #[error("the tree is deeper than a walk has room for")]
    TooDeep,
    /// A leaf holds another triangle than the one it names.
    #[error("a leaf's copy of triangle {0} differs from the triangle")]
    WrongTriangle(u32),
    /// A triangle in no leaf, or in more than one.
    #[error("triangle {0} is not in exactly one leaf")]
    NotOnce(u32),
    /// A child's box that does not contain what is below it.
    #[error("a child's box does not contain what is below it (node {node}, child {child})")]
    NotContained {
        /// Index of the node.
        node: u32,
        /// Which of its children.
        child: u32,
    },
}

fn lane_bounds(node: &WideNode, lane: usize) -> NodeBounds {
    let corner = |at: usize| Vec3::from_array(std::array::from_fn(|axis| node.bounds[at + axis][lane]));
    NodeBounds { min: corner(0), max: corner(3) }
}

fn node_bounds(node: &WideNode) -> NodeBounds {
    (0..LANES).fold(NodeBounds::EMPTY, |bounds, lane| bounds.union(lane_bounds(node, lane)))
}

fn is_used(node: &WideNode, lane: usize) -> bool {
    let bounds = lane_bounds(node, lane);
    bounds.min.cmple(bounds.max).all()
}

/// The triangles of a leaf, without unused lanes and marks.
fn members(packet: &Packet) -> impl Iterator<Item = u32> {
    packet.triangles.into_iter().filter(|&t| t != u32::MAX).map(|t| t & !SEE_THROUGH)
}

impl WideTree {
    /// Checks the tree over `triangles`, those it was built over, and returns its quality.
    pub(super) fn validate(&self, triangles: &[BvhTriangle]) -> Result<TreeQuality, TreeFault> {
        let (mut nodes_seen, mut leaves_seen) = (vec![false; self.nodes.len()], vec![false; self.packets.len()]);
        let mut times = vec![0u32; triangles.len()];
        let visit = |seen: &mut Vec<bool>, index: u32| match seen.get_mut(index as usize) {
            Some(seen) if !*seen => {
                *seen = true;
                Ok(())
            }
            _ => Err(TreeFault::Structure),
        };
        let mut waiting = Vec::new();
        if !self.nodes.is_empty() {
            nodes_seen[0] = true;
            waiting.push((0u32, 1));
        }
        while let Some((index, depth)) = waiting.pop() {
            if depth > DEEPEST {
                return Err(TreeFault::TooDeep);
            }
            let node = &self.nodes[index as usize];
            for lane in (0..LANES).filter(|&lane| is_used(node, lane)) {
                let code = node.children[lane];
                let content = if code & LEAF == 0 {
                    visit(&mut nodes_seen, code)?;
                    waiting.push((code, depth + 1));
                    node_bounds(&self.nodes[code as usize])
                } else {
                    visit(&mut leaves_seen, code & !LEAF)?;
                    let packet = &self.packets[(code & !LEAF) as usize];
                    check_leaf(packet, triangles, &mut times)?;
                    let corners = members(packet).flat_map(|t| triangles[t as usize].corners);
                    corners.fold(NodeBounds::EMPTY, |bounds, c| bounds.union(NodeBounds { min: c, max: c }))
                };
                let bounds = lane_bounds(node, lane);
                if !(bounds.min.cmple(content.min).all() && content.max.cmple(bounds.max).all()) {
                    return Err(TreeFault::NotContained { node: index, child: lane as u32 });
                }
            }
        }
        if !nodes_seen.into_iter().chain(leaves_seen).all(|seen| seen) {
            return Err(TreeFault::Structure);
        }
        let expected = |t: &BvhTriangle| u32::from(t.corners.iter().all(|c| c.is_finite()));
        match times.iter().zip(triangles).position(|(&times, t)| times != expected(t)) {
            Some(triangle) => Err(TreeFault::NotOnce(triangle as u32)),
            None => Ok(self.quality()),
        }
    }

    pub(super) fn quality(&self) -> TreeQuality {
        let Some(root) = self.nodes.first() else { return TreeQuality { nodes: 0.0, leaves: 0.0, leaf_fill: 0.0 } };
        let area = |bounds: NodeBounds| f64::from(bounds.half_area());
        let whole = area(node_bounds(root)).max(f64::MIN_POSITIVE);
        let mut quality = TreeQuality { nodes: 1.0, leaves: 0.0, leaf_fill: 0.0 };
        for node in &self.nodes {
            for lane in 0..LANES {
                let chance = area(lane_bounds(node, lane)) / whole;
                if node.children[lane] & LEAF == 0 { quality.nodes += chance } else { quality.leaves += chance }
            }
        }
        let triangles: usize = self.packets.iter().map(|packet| members(packet).count()).sum();
        quality.leaf_fill = triangles as f64 / self.packets.len() as f64;
        quality
    }
}

/// Counts the triangles of a leaf in `times`, and compares its copies of them with the originals.
fn check_leaf(packet: &Packet, triangles: &[BvhTriangle], times: &mut [u32]) -> Result<(), TreeFault> {
    for lane in (0..LANES).filter(|&lane| packet.triangles[lane] != u32::MAX) {
        let triangle = packet.triangles[lane] & !SEE_THROUGH;
        match times.get_mut(triangle as usize) {
            Some(times) if packet.lane(lane) == Packet::new(&[triangle], triangles).lane(0) => *times += 1,
            _ => return Err(TreeFault::WrongTriangle(triangle)),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangles() -> Vec<BvhTriangle> {
        let at = |i: u32| Vec3::new((i % 11) as f32, (i / 11 % 7) as f32, (i / 77) as f32);
        let of = |i: u32| BvhTriangle {
            corners: [at(i), at(i) + Vec3::X, at(i) + Vec3::Y],
            see_through: i.is_multiple_of(3),
        };
        let mut triangles: Vec<BvhTriangle> = (0..500).map(of).collect();
        triangles[7].corners[1] = Vec3::NAN;
        triangles
    }

    /// The fault found after a change of a valid tree.
    fn fault(change: impl FnOnce(&mut WideTree)) -> TreeFault {
        let mut tree = WideTree::build(&triangles());
        assert!(tree.nodes.len() > 3 && tree.packets.len() > 20);
        change(&mut tree);
        tree.validate(&triangles()).unwrap_err()
    }

    #[test]
    fn a_sound_tree_has_a_cost_and_every_fault_is_found() {
        let tree = WideTree::build(&triangles());
        let quality = tree.validate(&triangles()).unwrap();
        assert!(quality.cost() > 1.0 && quality.leaf_fill > 1.0 && quality.leaf_fill <= 8.0, "{quality:?}");

        assert_eq!(fault(|tree| tree.nodes[0].children[0] = 0), TreeFault::Structure);
        assert_eq!(fault(|tree| tree.nodes[0].children[1] = tree.nodes[0].children[0]), TreeFault::Structure);
        assert_eq!(fault(|tree| tree.nodes[0].children[0] = 1 << 30), TreeFault::Structure);
        assert_eq!(fault(|tree| tree.packets.push(tree.packets[0])), TreeFault::Structure);
        let shrunk = fault(|tree| tree.nodes[0].bounds[3][1] -= 0.5);
        assert_eq!(shrunk, TreeFault::NotContained { node: 0, child: 1 });
        let (copied, member) = (tree.packets[0], tree.packets[0].triangles[0] & !SEE_THROUGH);
        assert_eq!(fault(|tree| tree.packets[0].corners[1][2][0] += 0.5), TreeFault::WrongTriangle(member));
        assert_eq!(fault(|tree| tree.packets[0].triangles[0] ^= SEE_THROUGH), TreeFault::WrongTriangle(member));
        assert_eq!(fault(|tree| tree.packets[0].triangles[0] = u32::MAX), TreeFault::NotOnce(member));
        let other = fault(|tree| tree.packets[1] = copied);
        assert!(matches!(other, TreeFault::NotContained { .. } | TreeFault::NotOnce(_)), "{other:?}");
    }
}
