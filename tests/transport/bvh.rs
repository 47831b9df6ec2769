//! Rays against the tree and against every triangle in turn.

use glam::Vec3;
use ltm::trace::bvh::{Bvh, BvhTriangle, Occlusion, Ray, Walk};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

fn any(random: &mut Pcg64Mcg, half: f32) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|_| random.random_range(-half..half)))
}

fn soup(count: usize, seed: u64) -> Vec<BvhTriangle> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    (0..count)
        .map(|i| {
            let (centre, size) = (any(&mut random, 1.0), if i % 50 == 0 { 0.8 } else { 0.05 });
            let corners = std::array::from_fn(|_| centre + any(&mut random, size));
            BvhTriangle { corners, see_through: i % 3 == 0 }
        })
        .collect()
}

/// Flat walls in regular tessellation, two of them twice in the same place, and some triangles without area.
fn walls() -> Vec<BvhTriangle> {
    let mut triangles = Vec::new();
    let sides = [(Vec3::ZERO, Vec3::X, Vec3::Y), (Vec3::Z, Vec3::Y, Vec3::X), (Vec3::ZERO, Vec3::Y, Vec3::Z)];
    for (origin, u, v) in sides.into_iter().chain([sides[0]]) {
        let n = 24;
        for i in 0..n * n {
            let at =
                |a: i32, b: i32| origin + u * ((i % n + a) as f32 / n as f32) + v * ((i / n + b) as f32 / n as f32);
            for corners in [[at(0, 0), at(1, 0), at(1, 1)], [at(0, 0), at(1, 1), at(0, 1)]] {
                triangles.push(BvhTriangle { corners, see_through: false });
            }
        }
    }
    triangles.extend((0..20).map(|_| BvhTriangle { corners: [Vec3::splat(0.5); 3], see_through: false }));
    triangles.push(BvhTriangle { corners: [Vec3::NAN, Vec3::X, Vec3::Y], see_through: false });
    triangles
}

fn rays(count: usize) -> Vec<Ray> {
    let mut random = Pcg64Mcg::seed_from_u64(8);
    let mut rays: Vec<Ray> = (0..count)
        .map(|i| {
            let direction = any(&mut random, 1.0);
            // Axis-parallel rays have infinite inverse components; rays of unusual length must not matter.
            let direction = match i % 8 {
                0 => Vec3::new(direction.x, 0.0, -0.0),
                1 => Vec3::new(0.0, direction.y, direction.z),
                2 => direction * 1e3,
                _ => direction,
            };
            Ray { origin: any(&mut random, 1.5), direction, t_max: if i % 3 == 0 { 0.7 } else { f32::INFINITY } }
        })
        .collect();
    // Along the walls' own edges.
    rays.extend((0..24).map(|i| Ray {
        origin: Vec3::new(i as f32 / 24.0, -1.0, 0.0),
        direction: Vec3::Y,
        t_max: f32::INFINITY,
    }));
    rays
}

/// Möller and Trumbore in double precision.
fn intersect(triangle: &BvhTriangle, ray: &Ray) -> Option<f64> {
    let [a, b, c] = triangle.corners.map(|v| v.as_dvec3());
    let (d, edge1, edge2) = (ray.direction.as_dvec3(), b - a, c - a);
    let p = d.cross(edge2);
    let inverse = 1.0 / edge1.dot(p);
    let s = ray.origin.as_dvec3() - a;
    let (u, q) = (s.dot(p) * inverse, s.cross(edge1));
    let (v, t) = (d.dot(q) * inverse, edge2.dot(q) * inverse);
    // Hits within f32 rounding of an edge may go either way.
    let inside = |slack: f64| u >= -slack && v >= -slack && u + v <= 1.0 + slack;
    (inside(-1e-5) && t > 1e-6 && t < f64::from(ray.t_max) * (1.0 - 1e-6)).then_some(t)
}

#[test]
fn the_tree_finds_what_testing_every_triangle_finds() {
    for triangles in [soup(3000, 1), walls(), soup(1, 2), soup(9, 3)] {
        let bvh = Bvh::build(&triangles);
        for ray in rays(3000) {
            let brute = triangles.iter().filter_map(|t| intersect(t, &ray)).min_by(f64::total_cmp);
            let found = bvh.closest(&ray);
            if let Some(t) = brute {
                let hit = found.unwrap_or_else(|| panic!("{ray:?} misses the hit at {t}"));
                // Nearer is possible within rounding of an edge, farther is not.
                assert!(f64::from(hit.t) <= t * (1.0 + 1e-4) + 1e-5, "{ray:?}: {} for {t}", hit.t);
                assert_ne!(bvh.occlusion(&ray), Occlusion::Clear);
            }
            if let Some(hit) = found {
                // What was found is on the triangle that is named.
                let [a, b, c] = triangles[hit.triangle as usize].corners;
                let point = a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v;
                let along = ray.origin + ray.direction * hit.t;
                assert!(point.distance(along) < 2e-4 * (1.0 + along.length()), "{ray:?}: {point} {along}");
                assert!(hit.t < ray.t_max);
                assert_ne!(bvh.occlusion(&ray), Occlusion::Clear);
            }
        }
    }
}

/// A tree over any triangles is sound, and its cost is that of a tree: far below testing every leaf.
#[test]
fn every_tree_is_sound() {
    for triangles in [soup(20_000, 7), walls(), soup(1, 2), Vec::new()] {
        let bvh = Bvh::build(&triangles);
        let quality = bvh.validate(&triangles).unwrap();
        assert_eq!(quality, bvh.quality());
        assert!(quality.cost() <= 2.0 + triangles.len() as f64 / 16.0, "{quality:?}");
        if !triangles.is_empty() {
            assert!(bvh.validate(&triangles[1..]).is_err());
        }
    }
}

/// Walls that stand twice in the same place, in any order: of equally near triangles the one with the lowest index is
/// hit, whatever tree the order leads to.
#[test]
fn hits_do_not_depend_on_the_tree() {
    let triangles = walls();
    let backwards: Vec<_> = triangles.iter().rev().copied().collect();
    let (bvh, reversed) = (Bvh::build(&triangles), Bvh::build(&backwards));
    let same_place = |a: u32, b: u32| triangles[a as usize].corners == triangles[b as usize].corners;
    let (mut hits, mut twice) = (0, 0);
    for ray in rays(20_000) {
        let (Some(hit), Some(other)) = (bvh.closest(&ray), reversed.closest(&ray)) else { continue };
        assert_eq!(hit.t, other.t);
        let first = triangles.iter().position(|t| t.corners == triangles[hit.triangle as usize].corners);
        assert_eq!(first, Some(hit.triangle as usize), "{ray:?}");
        let unreversed = triangles.len() as u32 - 1 - other.triangle;
        hits += 1;
        twice += usize::from(unreversed != hit.triangle && same_place(unreversed, hit.triangle));
    }
    assert!(hits > 1000 && twice > 300, "{hits} hits, {twice} of them on triangles that stand twice");
}

#[test]
fn occlusion_tells_opaque_from_see_through() {
    let triangles = soup(2000, 5);
    let bvh = Bvh::build(&triangles);
    let mut seen = [0; 3];
    for ray in rays(4000) {
        let hit = |opaque: bool| triangles.iter().any(|t| t.see_through != opaque && intersect(t, &ray).is_some());
        let found = bvh.occlusion(&ray);
        match (hit(true), hit(false)) {
            (true, _) => assert_eq!(found, Occlusion::Opaque),
            (false, true) => assert_ne!(found, Occlusion::Clear),
            (false, false) => {}
        }
        seen[found as usize] += 1;
    }
    assert!(seen.iter().all(|&n| n > 20), "every answer must come up: {seen:?}");
}

#[test]
fn every_walk_gives_the_same_hits_to_the_last_bit() {
    // Where a machine has the plain walk alone, it is compared with itself, and the count of hits below is what is tested.
    for triangles in [soup(20_000, 7), walls()] {
        let (fast, plain) = (Bvh::build(&triangles), Bvh::build(&triangles).with_walk(Walk::Scalar));
        let mut hits = 0;
        for ray in rays(20_000) {
            let (a, b) = (fast.closest(&ray), plain.closest(&ray));
            assert_eq!(a, b, "{ray:?}");
            assert_eq!(fast.occlusion(&ray), plain.occlusion(&ray), "{ray:?}");
            hits += usize::from(a.is_some());
        }
        assert!(hits > 1000);
    }
}

#[test]
fn odd_input_neither_panics_nor_hits() {
    let ray = Ray { origin: Vec3::ZERO, direction: Vec3::Z, t_max: f32::INFINITY };
    assert_eq!(Bvh::build(&[]).closest(&ray), None);
    assert_eq!(Bvh::build(&[]).occlusion(&ray), Occlusion::Clear);
    let bvh = Bvh::build(&walls());
    for bad in [Vec3::NAN, Vec3::ZERO, Vec3::INFINITY] {
        assert_eq!(bvh.closest(&Ray { direction: bad, ..ray }), None);
    }
    let same = BvhTriangle { corners: [Vec3::Z, Vec3::Z + Vec3::X, Vec3::Z + Vec3::Y], see_through: false };
    let mut pile = vec![same; 5000];
    pile.iter_mut().for_each(|t| t.corners = t.corners.map(|c| c - Vec3::new(0.1, 0.1, 0.0)));
    assert!(Bvh::build(&pile).closest(&ray).is_some_and(|hit| hit.t == 1.0));
}

/// A closed, finely tessellated sphere seen from inside: a ray that gets out has found a crack.
#[test]
fn no_ray_slips_between_the_triangles_of_a_closed_surface() {
    let n = 64;
    let at = |i: i32, j: i32| {
        let (st, ct) = (std::f32::consts::PI * i as f32 / n as f32).sin_cos();
        let (sp, cp) = (std::f32::consts::PI * (j % (2 * n)) as f32 / n as f32).sin_cos();
        if i == 0 || i == n { Vec3::Y * ct.signum() } else { Vec3::new(st * cp, ct, st * sp) }
    };
    let mut triangles = Vec::new();
    for i in 0..n {
        for j in 0..2 * n {
            for corners in [[at(i, j), at(i, j + 1), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i + 1, j)]] {
                triangles.push(BvhTriangle { corners, see_through: false });
            }
        }
    }
    let bvh = Bvh::build(&triangles);
    let mut random = Pcg64Mcg::seed_from_u64(6);
    let lost = (0..300_000)
        .filter(|_| {
            let ray = Ray { origin: any(&mut random, 0.4), direction: any(&mut random, 1.0), t_max: f32::INFINITY };
            bvh.closest(&ray).is_none()
        })
        .count();
    // The edge test is not exact: each of two triangles may round a ray out. Light lost stays below one part in 10⁴.
    assert!(lost <= 30, "{lost} of 300,000 rays got out");
}
