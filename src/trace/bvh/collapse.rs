//! Which nodes of the binary tree become nodes and leaves of the wide one: the cheapest choice by the surface area
//! heuristic, found bottom up (Ylitie, Karras and Laine 2017, *Efficient incoherent ray traversal on GPUs through
//! compressed wide BVHs*, §3.2).
//!
//! `C(n, j)` is the least cost of showing the subtree of `n` as at most `j` wide nodes or leaves side by side.

use super::binary::BinaryTree;
use super::{LANES, NODE_COST};

/// How a subtree is represented by at most `j` parts.
#[derive(Clone, Copy, Debug, PartialEq)]
enum ChildCut {
    /// One wide leaf.
    Leaf,
    /// One wide node.
    Node,
    /// As with `j − 1` parts: one more part costs no less.
    Fewer,
    /// Both children, the first of them with this many parts.
    Split(u8),
}

/// The choices for every node of a binary tree.
pub(super) struct Collapse {
    choices: Vec<[ChildCut; LANES]>,
}

/// A child of a wide node.
#[derive(Clone, Copy, Debug)]
pub(super) struct WideChild {
    /// Index in the binary tree.
    pub(super) node: u32,
    pub(super) is_leaf: bool,
}

impl Collapse {
    pub(super) fn new(binary: &BinaryTree) -> Self {
        let mut choices = vec![[ChildCut::Leaf; LANES]; binary.nodes.len()];
        let mut costs = vec![[0.0f32; LANES]; binary.nodes.len()];
        // Children come after their parents.
        for (i, node) in binary.nodes.iter().enumerate().rev() {
            let area = node.bounds.half_area();
            if node.second == 0 {
                (costs[i], choices[i]) = ([area; LANES], [ChildCut::Fewer; LANES]);
                choices[i][0] = ChildCut::Leaf;
                continue;
            }
            let (first, second) = (costs[i + 1], costs[node.second as usize]);
            let mut split = [(f32::INFINITY, ChildCut::Leaf); LANES];
            for parts in 2..=LANES {
                for k in 1..parts {
                    let cost = first[k - 1] + second[parts - k - 1];
                    if cost < split[parts - 1].0 {
                        split[parts - 1] = (cost, ChildCut::Split(k as u8));
                    }
                }
            }
            let leaf = if node.count as usize <= LANES { area } else { f32::INFINITY };
            let open = split[LANES - 1].0 + NODE_COST * area;
            (costs[i][0], choices[i][0]) = if leaf <= open { (leaf, ChildCut::Leaf) } else { (open, ChildCut::Node) };
            for j in 1..LANES {
                let fewer = (costs[i][j - 1], ChildCut::Fewer);
                (costs[i][j], choices[i][j]) = if split[j].0 < fewer.0 { split[j] } else { fewer };
            }
        }
        Self { choices }
    }

    /// Whether the whole tree is one leaf.
    pub(super) fn is_leaf(&self, node: u32) -> bool {
        self.choices[node as usize][0] == ChildCut::Leaf
    }

    /// The parts of a wide node over `node`, at most eight; `node` itself where it is a leaf.
    pub(super) fn parts(&self, binary: &BinaryTree, node: u32, parts: &mut Vec<WideChild>) {
        if self.is_leaf(node) {
            parts.push(WideChild { node, is_leaf: true });
            return;
        }
        // Its best split into eight was what made it a node.
        self.show(binary, node, LANES, true, parts);
    }

    fn show(&self, binary: &BinaryTree, node: u32, mut count: usize, open: bool, parts: &mut Vec<WideChild>) {
        let choices = &self.choices[node as usize];
        while choices[count - 1] == ChildCut::Fewer && count > 1 {
            count -= 1;
        }
        match choices[count - 1] {
            ChildCut::Split(first) => {
                let second = binary.nodes[node as usize].second;
                self.show(binary, node + 1, usize::from(first), false, parts);
                self.show(binary, second, count - usize::from(first), false, parts);
            }
            // A node to be opened whose cheapest representation is itself: use its children.
            ChildCut::Node if open => {
                let second = binary.nodes[node as usize].second;
                self.show(binary, node + 1, 1, false, parts);
                self.show(binary, second, 1, false, parts);
            }
            choice => parts.push(WideChild { node, is_leaf: choice == ChildCut::Leaf }),
        }
    }
}
