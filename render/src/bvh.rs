//! The BVH over a mesh or the segments of strands, with a bound on the time to build it and on its depth.
//!
//! obvhs builds by locally ordered clustering: neighbors on the Morton curve merge when each is the other's cheapest partner, the later one among equals. Where many
//! boxes are equal, all partners cost the same, each triangle names the last of its window, and only the last pair of all agrees: one merge a pass. The build then
//! takes a time quadratic in the number of triangles, and the tree is a chain, deeper than the 32 entries of the traversal's stack. So [`build`] gives such meshes, and
//! any whose tree comes out too deep, a tree that is split at the median, which has ceil(log2(n)) levels.

use glam::Vec3A;
use obvhs::Boundable;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::ploc::PlocBuilder;
use std::collections::HashMap;

/// Most levels of a tree that obvhs traverses: its stack has 32 entries.
const MOST_LEVELS: usize = 31;
/// Most triangles with the same box, up to [`CELLS`] steps across the mesh, that the clustering is trusted with. It looks at 14 neighbors on either side.
const MOST_EQUAL: usize = 28;
/// Steps across the mesh within which boxes count as the same.
const CELLS: f32 = (1u32 << 20) as f32;
/// Triangles of a leaf.
const LEAF: u32 = 3;

/// A tree over `triangles`, at most [`MOST_LEVELS`] deep.
pub fn build<B: Boundable>(triangles: &[B]) -> CwBvh {
    if !crowded(triangles) {
        let bvh = clustered(triangles);
        if levels(&bvh) <= MOST_LEVELS {
            return bvh;
        }
    }
    by_medians(triangles)
}

/// obvhs' own tree at its medium effort. Its own function for that panics on a tree that is too deep where debug assertions are on, before anyone can look.
fn clustered<B: Boundable>(triangles: &[B]) -> CwBvh {
    bvh2_to_cwbvh(&clustered_binary(triangles), LEAF, true, false)
}

fn clustered_binary<B: Boundable>(triangles: &[B]) -> Bvh2 {
    let effort = BvhBuildParams::medium_build();
    let mut bvh2 = PlocBuilder::with_capacity(triangles.len()).build(
        effort.ploc_search_distance,
        triangles,
        (0..triangles.len() as u32).collect(),
        effort.sort_precision,
        effort.search_depth_threshold,
    );
    ReinsertionOptimizer::default().run(&mut bvh2, effort.reinsertion_batch_ratio, None);
    bvh2
}

/// A binary tree over `boxes`, one in a leaf; none of no boxes. It may be deep.
pub fn binary<B: Boundable>(boxes: &[B]) -> Bvh2 {
    if crowded(boxes) { binary_by_medians(boxes) } else { clustered_binary(boxes) }
}

/// Whether more than [`MOST_EQUAL`] triangles have nearly the same box.
fn crowded<B: Boundable>(triangles: &[B]) -> bool {
    let mut all = Aabb::empty();
    for t in triangles {
        all = all.union(&t.aabb());
    }
    let scale = CELLS / (all.max - all.min).max_element().max(f32::MIN_POSITIVE);
    let cell = |p: Vec3A| ((p - all.min) * scale).to_array().map(|x| x as u32);
    let mut counts: HashMap<[[u32; 3]; 2], usize> = HashMap::new();
    triangles.iter().any(|t| {
        let aabb = t.aabb();
        let count = counts.entry([cell(aabb.min), cell(aabb.max)]).or_insert(0);
        *count += 1;
        *count > MOST_EQUAL
    })
}

/// Levels of nodes of a tree.
fn levels(bvh: &CwBvh) -> usize {
    let mut deepest = 0;
    let mut open = vec![(0usize, 1usize)];
    while let Some((at, level)) = open.pop() {
        let Some(node) = bvh.nodes.get(at) else { continue };
        deepest = deepest.max(level);
        if deepest > MOST_LEVELS {
            break;
        }
        let first = node.child_base_idx as usize;
        open.extend((0..node.imask.count_ones() as usize).map(|k| (first + k, level + 1)));
    }
    deepest
}

/// A tree whose nodes are split at the median of their boxes' centers, along the longest axis of these.
fn by_medians<B: Boundable>(triangles: &[B]) -> CwBvh {
    bvh2_to_cwbvh(&binary_by_medians(triangles), LEAF, true, false)
}

/// The same as a binary tree, of ceil(log2(n)) levels below the root.
pub fn binary_by_medians<B: Boundable>(triangles: &[B]) -> Bvh2 {
    let boxes: Vec<Aabb> = triangles.iter().map(|t| t.aabb()).collect();
    let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
    let mut nodes = vec![Bvh2Node::default(); (2 * triangles.len()).saturating_sub(1)];
    let mut next = 1;
    // Node, and the range of `order` that it holds.
    let mut open = if triangles.is_empty() { Vec::new() } else { vec![(0, 0, triangles.len())] };
    while let Some((at, from, to)) = open.pop() {
        let range = &mut order[from..to];
        let (mut all, mut centers) = (Aabb::empty(), Aabb::empty());
        for &i in range.iter() {
            all = all.union(&boxes[i as usize]);
            centers.extend(boxes[i as usize].center());
        }
        if let [_] = range {
            nodes[at] = Bvh2Node::new(all, 1, from as u32);
            continue;
        }
        let axis = centers.largest_axis();
        let half = range.len() / 2;
        // Equal centers are told apart by their number, so that the tree depends on the mesh alone.
        range.select_nth_unstable_by(half, |a, b| {
            let center = |i: u32| boxes[i as usize].center()[axis];
            center(*a).total_cmp(&center(*b)).then(a.cmp(b))
        });
        nodes[at] = Bvh2Node::new(all, 0, next as u32);
        open.push((next, from, from + half));
        open.push((next + 1, from + half, to));
        next += 2;
    }
    Bvh2 { nodes, primitive_indices: order, ..Bvh2::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use obvhs::ray::{Ray, RayHit};
    use obvhs::triangle::Triangle;

    fn nearest(bvh: &CwBvh, triangles: &[Triangle], ray: Ray) -> f32 {
        let mut hit = RayHit::none();
        bvh.ray_traverse(ray, &mut hit, |ray, i| triangles[bvh.primitive_indices[i] as usize].intersect(ray));
        hit.t
    }

    /// Triangles of one box, turned about its center by different corners; others beside them.
    fn crowd(n: usize) -> Vec<Triangle> {
        let v = |x: f32, y: f32, z: f32| Vec3A::new(x, y, z);
        (0..n)
            .map(|k| match k % 4 {
                // The same box, and planes that differ.
                0..=2 => {
                    let s = (k as f32 + 0.5) / n as f32;
                    Triangle { v0: v(0.0, 0.0, 0.0), v1: v(1.0, 1.0, s), v2: v(0.0, 1.0, 1.0) }
                }
                _ => Triangle { v0: v(k as f32, 2.0, 0.0), v1: v(k as f32 + 1.0, 2.0, 0.0), v2: v(k as f32, 3.0, 0.5) },
            })
            .collect()
    }

    #[test]
    fn trees_of_crowds_are_shallow_and_find_the_nearest() {
        let triangles = crowd(20_000);
        assert!(crowded(&triangles));
        let begun = std::time::Instant::now();
        let bvh = build(&triangles);
        assert!(begun.elapsed().as_secs() < 20, "{:?}", begun.elapsed());
        assert!(levels(&bvh) <= 15, "{}", levels(&bvh));
        for k in 0..50 {
            let (x, y) = (0.013 * k as f32, 0.3 + 0.011 * k as f32);
            let ray = || Ray::new(Vec3A::new(x, y, 5.0), Vec3A::new(0.01, -0.02, -1.0).normalize(), 0.0, f32::INFINITY);
            let want = triangles.iter().map(|t| t.intersect(&ray())).fold(f32::INFINITY, f32::min);
            let got = nearest(&bvh, &triangles, ray());
            assert!(got == want || (got - want).abs() < 1e-6, "{got} {want}");
        }
    }

    #[test]
    fn trees_that_come_out_too_deep_are_built_again() {
        // Each twice as large as the one before, all from one corner: the cheapest partner of the union of the first k is the next one.
        let triangles: Vec<Triangle> = (0..250)
            .map(|k| {
                let s = (0.5f32 * (k as f32 - 125.0)).exp2();
                Triangle { v0: Vec3A::ZERO, v1: Vec3A::new(s, 0.0, 0.3 * s), v2: Vec3A::new(0.0, s, 0.1 * s) }
            })
            .collect();
        assert!(levels(&clustered(&triangles)) > MOST_LEVELS, "{}", levels(&clustered(&triangles)));
        let bvh = build(&triangles);
        assert!(levels(&bvh) <= MOST_LEVELS);
        let ray = Ray::new(Vec3A::new(1e-3, 1e-3, -1.0), Vec3A::Z, 0.0, f32::INFINITY);
        let want = triangles.iter().map(|t| t.intersect(&ray)).fold(f32::INFINITY, f32::min);
        assert!((nearest(&bvh, &triangles, ray) - want).abs() < 1e-6);
        assert_eq!(levels(&build::<Triangle>(&[])), 0);
    }
}
