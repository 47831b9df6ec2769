//! The wide tree: eight children a node, eight triangles a leaf, both laid out lane by lane.

use super::BvhTriangle;
use super::binary::{BinaryTree, DEEPEST};
use super::collapse::Collapse;
use super::reinsert::reinserted;

/// Children of a node and triangles of a leaf.
pub(super) const LANES: usize = 8;
/// Marks a child that is a leaf; the other bits are the index of its packet.
pub(super) const LEAF: u32 = 1 << 31;
/// Marks a triangle that may let light through; the other bits are its index.
pub(super) const SEE_THROUGH: u32 = 1 << 31;
/// Cost of opening a node, in tests of a leaf. Both test eight lanes; a leaf's test is longer, a node's result is sorted.
pub(super) const NODE_COST: f32 = 1.0;
/// A walk keeps at most seven entries for each level above the one it is in.
pub(super) const STACK: usize = DEEPEST as usize * (LANES - 1) + LANES;

/// Bounds of eight children, `bounds[0..3]` their minima and `bounds[3..6]` their maxima by axis, and what they are.
/// Unused lanes have an empty box, which no ray enters.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug)]
pub(super) struct WideNode {
    pub(super) bounds: [[f32; LANES]; 6],
    pub(super) children: [u32; LANES],
}

/// Eight triangles as corner and two edges by axis. Unused lanes have no extent, so no ray hits them.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Packet {
    pub(super) corner: [[f32; LANES]; 3],
    pub(super) edge1: [[f32; LANES]; 3],
    pub(super) edge2: [[f32; LANES]; 3],
    pub(super) triangles: [u32; LANES],
}

/// Nodes and leaves. The root is node 0; there is none where there is no triangle.
#[derive(Debug)]
pub(super) struct WideTree {
    pub(super) nodes: Vec<WideNode>,
    pub(super) packets: Vec<Packet>,
}

const UNUSED_NODE: WideNode = WideNode {
    bounds: [
        [f32::INFINITY; LANES],
        [f32::INFINITY; LANES],
        [f32::INFINITY; LANES],
        [f32::NEG_INFINITY; LANES],
        [f32::NEG_INFINITY; LANES],
        [f32::NEG_INFINITY; LANES],
    ],
    children: [LEAF; LANES],
};

impl WideTree {
    pub(super) fn build(triangles: &[BvhTriangle]) -> Self {
        let binned = BinaryTree::build(triangles.iter().map(|t| t.corners));
        let binary = reinserted(&binned).unwrap_or(binned);
        let mut tree = Self { nodes: Vec::new(), packets: Vec::new() };
        if !binary.nodes.is_empty() {
            tree.add_node(&binary, &Collapse::new(&binary), triangles, 0);
        }
        tree
    }

    /// Makes a node of the binary node `root`, and all below it.
    fn add_node(&mut self, binary: &BinaryTree, collapse: &Collapse, triangles: &[BvhTriangle], root: u32) -> u32 {
        let mut parts = Vec::with_capacity(LANES);
        collapse.parts(binary, root, &mut parts);
        let index = self.nodes.len();
        self.nodes.push(UNUSED_NODE);
        for (lane, part) in parts.into_iter().enumerate() {
            let child = &binary.nodes[part.node as usize];
            let code = if part.is_leaf {
                let range = child.start as usize..(child.start + child.count) as usize;
                self.packets.push(Packet::new(&binary.order[range], triangles));
                LEAF | (self.packets.len() - 1) as u32
            } else {
                self.add_node(binary, collapse, triangles, part.node)
            };
            let wide = &mut self.nodes[index];
            for axis in 0..3 {
                wide.bounds[axis][lane] = child.bounds.min[axis];
                wide.bounds[3 + axis][lane] = child.bounds.max[axis];
            }
            wide.children[lane] = code;
        }
        index as u32
    }
}

impl Packet {
    pub(super) fn new(members: &[u32], triangles: &[BvhTriangle]) -> Self {
        let none = [[0.0; LANES]; 3];
        let mut packet = Self { corner: none, edge1: none, edge2: none, triangles: [u32::MAX; LANES] };
        for (lane, &member) in members.iter().enumerate() {
            let triangle = &triangles[member as usize];
            let [a, b, c] = triangle.corners;
            for axis in 0..3 {
                packet.corner[axis][lane] = a[axis];
                packet.edge1[axis][lane] = b[axis] - a[axis];
                packet.edge2[axis][lane] = c[axis] - a[axis];
            }
            packet.triangles[lane] = member | if triangle.see_through { SEE_THROUGH } else { 0 };
        }
        packet
    }

    /// A triangle as it lies in a lane: corner, edges, index and mark.
    pub(super) fn lane(&self, lane: usize) -> ([[f32; 3]; 3], u32) {
        let of = |field: &[[f32; LANES]; 3]| std::array::from_fn(|axis| field[axis][lane]);
        ([of(&self.corner), of(&self.edge1), of(&self.edge2)], self.triangles[lane])
    }
}
