//! The wide tree: eight children a node, eight triangles a leaf, both laid out lane by lane.

use glam::Vec3;

use super::BvhTriangle;
use super::binary::{BinaryTree, Bounds};
use super::collapse::Collapse;

/// Children of a node and triangles of a leaf.
pub(super) const LANES: usize = 8;
/// Marks a child that is a leaf; the other bits are the index of its packet.
pub(super) const LEAF: u32 = 1 << 31;
/// Marks a triangle that may let light through; the other bits are its index.
pub(super) const SEE_THROUGH: u32 = 1 << 31;
/// A walk keeps at most seven entries for each level above the one it is in; the binary tree is at most 80 deep.
pub(super) const STACK: usize = 80 * (LANES - 1) + LANES;

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
#[derive(Clone, Copy, Debug)]
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
        let binary = BinaryTree::build(triangles.iter().map(|t| t.corners));
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

    pub(super) fn quality(&self) -> TreeQuality {
        let lane_area = |node: &WideNode, lane: usize| {
            let corner = |at: usize| Vec3::from_array(std::array::from_fn(|axis| node.bounds[at + axis][lane]));
            f64::from(Bounds { min: corner(0), max: corner(3) }.half_area())
        };
        let Some(root) = self.nodes.first() else { return TreeQuality { nodes: 0.0, leaves: 0.0, leaf_fill: 0.0 } };
        let whole = (0..LANES).fold(Bounds::EMPTY, |b, lane| {
            let corner = |at: usize| Vec3::from_array(std::array::from_fn(|axis| root.bounds[at + axis][lane]));
            b.union(Bounds { min: corner(0), max: corner(3) })
        });
        let whole = f64::from(whole.half_area()).max(f64::MIN_POSITIVE);
        let mut quality = TreeQuality { nodes: 1.0, leaves: 0.0, leaf_fill: 0.0 };
        for node in &self.nodes {
            for lane in 0..LANES {
                let chance = lane_area(node, lane) / whole;
                if node.children[lane] & LEAF == 0 { quality.nodes += chance } else { quality.leaves += chance }
            }
        }
        let used = |p: &Packet| p.triangles.iter().filter(|&&t| t != u32::MAX).count();
        let triangles: usize = self.packets.iter().map(used).sum();
        quality.leaf_fill = triangles as f64 / self.packets.len() as f64;
        quality
    }
}

impl Packet {
    fn new(members: &[u32], triangles: &[BvhTriangle]) -> Self {
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
}
