//! Rays against triangles: a binary tree by the surface area heuristic, improved by reinsertion, collapsed to eight
//! children a node and eight triangles a leaf, walked by AVX2 where the processor has it and by plain loops with the
//! same arithmetic where not.
//!
//! Both walks do the same operations in the same order (no fused multiply–add, the same handling of NaN), so they give
//! the same hits to the last bit, and a matrix does not depend on the machine that traced it. Nor does it depend on the
//! shape of the tree: of triangles at the same distance the one with the lowest index is hit.
//!
//! # Which builder
//!
//! Measured in one run (`benches/trace.rs`'s meshes, AVX2 walk, two busy cores; rays a second relative to the binned tree
//! alone, primary / bounce / shadow, and seconds to build):
//!
//! | tree | walls and spheres, 104 k | the same, 496 k | Conference Room, 331 k |
//! |---|---|---|---|
//! | binned | 1 / 1 / 1, 0.3 s | 1 / 1 / 1, 1.9 s | 1 / 1 / 1, 1.6 s |
//! | **binned, then reinsertion** | 1.02 / 0.97 / 0.98, 0.4 s | 0.99 / 1.03 / 1.02, 2.7 s | **1.22 / 1.13 / 1.38**, 2.1 s |
//! | obvhs's slowest preset without splitting | 0.60 / 0.66 / 0.88, 0.8 s | 0.52 / 0.59 / 0.81, 4.7 s | 1.20 / 1.07 / 1.41, 3.4 s |
//!
//! The preset loses on flat, regularly tessellated walls, its quick ones by far more: they sort along a space-filling
//! curve, where such triangles share their codes.
//!
//! # Why rays are traced one at a time
//!
//! One ray against eight boxes fills AVX2's lanes as eight rays against one box do, so what a packet could save is the walk itself: nodes
//! fetched, a stack, an order. Measured by tracing a kind of ray twice (CPU time of a render more; the second walk finds its nodes in
//! the cache, as a packet would): primary rays 2 to 6 %, the four shadow rays of the first vertex 4 to 10 %, shadow rays of later
//! vertices 3 to 6 %, in the Conference Room, the classroom and a room with water. A packet of free rays would gain no more. Eight pixels
//! traced in turns, so that one waits while another computes, took 1.00 to 1.06 of the time; to work out the four light samples of the
//! first vertex before any of their rays is traced, 1.00 to 1.04.

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

/// Where a ray first meets a triangle.
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

/// What stands between two points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occlusion {
    /// Nothing.
    Clear,
    /// Only triangles that may let light through: walk them one by one.
    Perhaps,
    /// Something opaque.
    Opaque,
}

/// How the tree is walked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Walk {
    /// Plain loops, on every machine.
    Scalar,
    /// Eight lanes at a time; only where the processor has AVX2.
    Avx2,
}

/// A triangle as the tree takes it.
#[derive(Clone, Copy, Debug)]
pub struct BvhTriangle {
    /// Corners.
    pub corners: [Vec3; 3],
    /// Whether it may let light through, see [`Occlusion::Perhaps`].
    pub see_through: bool,
}

/// The tree over all triangles of a scene.
#[derive(Debug)]
pub struct Bvh {
    tree: wide::WideTree,
    walk: Walk,
}

impl Walk {
    /// The fastest way that this processor has.
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            return Self::Avx2;
        }
        Self::Scalar
    }
}

impl Bvh {
    /// Builds the tree. Triangles with corners that are not finite are left out; so are none for being degenerate,
    /// which no ray ever hits.
    pub fn build(triangles: &[BvhTriangle]) -> Self {
        Self { tree: wide::WideTree::build(triangles), walk: Walk::detect() }
    }

    /// The same tree walked in another way; a way that the processor lacks falls back to the scalar one.
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

    /// Whether anything stands on a segment.
    #[inline(always)]
    pub fn occlusion(&self, ray: &Ray) -> Occlusion {
        match self.walk {
            #[cfg(target_arch = "x86_64")]
            Walk::Avx2 => avx2::occlusion(&self.tree, ray),
            _ => scalar::occlusion(&self.tree, ray),
        }
    }

    /// Checks that every triangle with finite corners is in exactly one leaf, as it is, that every box contains what is
    /// below it, and that a walk has room for the deepest path. `triangles` are those that the tree was built over.
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
