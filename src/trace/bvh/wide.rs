//! The wide tree: eight children for each node, eight triangles for each leaf, both in structure-of-arrays layout.

use glam::{DVec3, Vec3};

use super::binary::{BinaryTree, DEEPEST, NodeBounds};
use super::collapse::Collapse;
use super::reinsert::reinserted;
use super::{BvhTriangle, LANES};

/// Marks a child that is a leaf; the other bits are the index of its packet.
pub(super) const LEAF: u32 = 1 << 31;
/// Marks a triangle that may let light through; the other bits are its index.
pub(super) const SEE_THROUGH: u32 = 1 << 31;
/// The stack holds at most seven entries for each level above the current one.
pub(super) const STACK: usize = DEEPEST as usize * (LANES - 1) + LANES;

/// Bounds of eight children, `bounds[0..3]` their minima and `bounds[3..6]` their maxima by axis, and references to
/// them. Unused lanes have an empty box, which no ray enters.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug)]
pub(super) struct WideNode {
    pub(super) bounds: [[f32; LANES]; 6],
    pub(super) children: [u32; LANES],
}

/// Relative padding of boxes, in units of the largest coordinate. A triangle's edges are exact to some roundings of its
/// corners, and a ray that the triangle's test accepts must have entered its box.
const PADDING: f32 = 4.0e-7;

/// Least double area of a triangle over the square of its longest edge. Below it the triangle is a line, whose plane is
/// rounding.
const THINNEST: f64 = 1e-8;

/// Eight triangles as corners and planes by axis. Unused lanes have no plane, so no ray hits them.
#[repr(C, align(32))]
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Packet {
    pub(super) corners: [[[f32; LANES]; 3]; 3],
    /// Unit normal of the plane, computed in f64 so that thin triangles have as exact a one as others. Zero without a
    /// plane.
    pub(super) normal: [[f32; LANES]; 3],
    /// Plane constant: the product of the normal with any point of the plane.
    pub(super) height: [f32; LANES],
    pub(super) triangles: [u32; LANES],
}

/// Nodes and leaves. The root is node 0; without triangles there is none.
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
            let (wide, bounds) = (&mut self.nodes[index], padded(child.bounds));
            for axis in 0..3 {
                wide.bounds[axis][lane] = bounds.min[axis];
                wide.bounds[3 + axis][lane] = bounds.max[axis];
            }
            wide.children[lane] = code;
        }
        index as u32
    }
}

/// A box with its padding. What lies inside another box does so with both padded.
fn padded(bounds: NodeBounds) -> NodeBounds {
    let most = PADDING * bounds.min.abs().max(bounds.max.abs()).max_element();
    NodeBounds { min: bounds.min - most, max: bounds.max + most }
}

/// The plane of a triangle: unit normal and plane constant; zero for a triangle that is a line.
fn plane(corners: [Vec3; 3]) -> (Vec3, f32) {
    let [a, b, c] = corners.map(|corner| corner.as_dvec3());
    let normal = (b - a).cross(c - a);
    let longest = (b - a).length_squared().max((c - a).length_squared()).max((c - b).length_squared());
    let normal = if normal.length() > THINNEST * longest { normal.normalize_or_zero() } else { DVec3::ZERO };
    (normal.as_vec3(), normal.dot(a) as f32)
}

impl Packet {
    pub(super) fn new(members: &[u32], triangles: &[BvhTriangle]) -> Self {
        let (none, nothing) = ([0.0; LANES], [[0.0; LANES]; 3]);
        let mut packet = Self { corners: [nothing; 3], normal: nothing, height: none, triangles: [u32::MAX; LANES] };
        for (lane, &member) in members.iter().enumerate() {
            let triangle = &triangles[member as usize];
            let (normal, height) = plane(triangle.corners);
            for axis in 0..3 {
                for (of_corner, corner) in packet.corners.iter_mut().zip(triangle.corners) {
                    of_corner[axis][lane] = corner[axis];
                }
                packet.normal[axis][lane] = normal[axis];
            }
            packet.height[lane] = height;
            packet.triangles[lane] = member | if triangle.see_through { SEE_THROUGH } else { 0 };
        }
        packet
    }

    /// A triangle as it lies in a lane: corners, plane, index and mark.
    pub(super) fn lane(&self, lane: usize) -> ([[f32; 3]; 3], [f32; 3], f32, u32) {
        let of = |field: &[[f32; LANES]; 3]| std::array::from_fn(|axis| field[axis][lane]);
        (self.corners.each_ref().map(of), of(&self.normal), self.height[lane], self.triangles[lane])
    }
}
