//! Ray–triangle intersection: a binary tree by the surface area heuristic, improved by reinsertion, collapsed to a wide
//! BVH of eight children for each node and eight triangles for each leaf. It is traversed with AVX2 if the processor
//! has it, and otherwise by plain loops with the same arithmetic.
//!
//! Both traversals do the same operations in the same order (no fused multiply–add, the same handling of NaN). They
//! give the same hits to the last bit, and a matrix does not depend on the machine that traced it. It does not depend
//! on the shape of the tree either: of triangles at the same distance the one with the lowest index is hit.
//!
//! The builder was chosen in decision 1. Rays are traced one at a time and not in packets: decision 2.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod binary;
mod collapse;
mod reinsert;
mod scalar;
mod validate;
mod wide;

use glam::Vec3;

pub use validate::{TreeFault, TreeQuality};

/// Children of a node and triangles of a leaf.
const LANES: usize = 8;
/// Cost of opening a node, in tests of a leaf. Both test eight lanes. A leaf's test is longer, but a node's result is
/// sorted.
const NODE_COST: f32 = 1.0;

/// A ray or segment: points `origin + t · direction`, `0 < t < t_max`.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Start.
    pub origin: Vec3,
    /// Direction; `t` counts in its length.
    pub direction: Vec3,
    /// End of the segment, exclusive.
    pub t_max: f32,
}

/// The nearest intersection of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in lengths of the ray's direction.
    pub t: f32,
    /// Index of the triangle.
    pub triangle: u32,
    /// Barycentric weight of its second corner.
    pub u: f32,
    /// Barycentric weight of its third corner.
    pub v: f32,
}

/// Occlusion between two points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occlusion {
    /// Unoccluded.
    Clear,
    /// Only triangles that may let light through: they must be visited one by one.
    Perhaps,
    /// Occluded by something opaque.
    Opaque,
}

/// How the tree is traversed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Walk {
    /// Plain loops, on every machine.
    Scalar,
    /// Eight lanes at a time; only where the processor has AVX2.
    Avx2,
}

/// A triangle as input of the builder.
#[derive(Clone, Copy, Debug)]
pub struct BvhTriangle {
    /// Corners.
    pub corners: [Vec3; 3],
    /// Whether it may let light through, see [`Occlusion::Perhaps`].
    pub see_through: bool,
}

/// The BVH over all triangles of a scene.
#[derive(Debug)]
pub struct Bvh {
    tree: wide::WideTree,
    walk: Walk,
}

impl Walk {
    /// The fastest traversal that this processor supports.
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            return Self::Avx2;
        }
        Self::Scalar
    }
}

impl Bvh {
    /// Builds the tree. Triangles with corners that are not finite are left out. Degenerate ones are kept, but no ray
    /// hits them.
    pub fn build(triangles: &[BvhTriangle]) -> Self {
        Self { tree: wide::WideTree::build(triangles), walk: Walk::detect() }
    }

    /// The same tree with another traversal; scalar if the processor lacks it.
    #[must_use]
    pub fn with_walk(self, walk: Walk) -> Self {
        Self { walk: if walk == Walk::detect() { walk } else { Walk::Scalar }, ..self }
    }

    /// The nearest hit of a ray, if any.
    #[inline(always)]
    pub fn closest(&self, ray: &Ray) -> Option<Hit> {
        match self.walk {
            #[cfg(target_arch = "x86_64")]
            Walk::Avx2 => avx2::closest(&self.tree, ray),
            _ => scalar::closest(&self.tree, ray),
        }
    }

    /// Whether anything occludes a segment.
    #[inline(always)]
    pub fn occlusion(&self, ray: &Ray) -> Occlusion {
        match self.walk {
            #[cfg(target_arch = "x86_64")]
            Walk::Avx2 => avx2::occlusion(&self.tree, ray),
            _ => scalar::occlusion(&self.tree, ray),
        }
    }

    /// Checks that every triangle with finite corners is in exactly one leaf, unchanged; that every box contains what
    /// is below it; and that the traversal stack fits the deepest path. `triangles` are those that the tree was built
    /// over.
    ///
    /// # Errors
    /// The first fault found.
    pub fn validate(&self, triangles: &[BvhTriangle]) -> Result<TreeQuality, TreeFault> {
        self.tree.validate(triangles)
    }

    /// Expected work of a random ray, see [`TreeQuality`].
    pub fn quality(&self) -> TreeQuality {
        self.tree.quality()
    }
}
