//! BVH over a mesh or the segments of strands, of bounded depth, built in O(n log n) time for any input.
//!
//! Nodes are split in bins along the axis with the lowest cost by the surface area heuristic (Wald 2007);
//! nodes below [`HEURISTIC_LEVELS`] and nodes with equal centers are split at the median. The builder of
//! obvhs is not used: it clusters neighbors on the Morton curve and merges two that are each other's cheapest
//! partner. Among equal or nested boxes, such as a stack of sheets, each of its passes merges only one pair,
//! so that its time is quadratic, and its reinsertion of nodes is quadratic if all boxes overlap.
//!
//! If most boxes overlap, a ray hits most of them in any tree. Triangles are then covered by several tighter
//! boxes, the largest first, up to [`MAX_SPLITS`] boxes per triangle on average (Karras and Aila 2013).

use glam::Vec3A;
use obvhs::Boundable;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::splits::split_triangle;
use obvhs::triangle::Triangle;
use std::collections::BinaryHeap;

/// Largest number of levels that obvhs traverses: its stack has 32 entries.
const MAX_LEVELS: usize = 31;
/// Levels of a binary tree whose nodes are split by the heuristic.
const HEURISTIC_LEVELS: usize = 48;
/// Largest number of bins along an axis.
const BINS: usize = 16;
/// Triangles per leaf.
const LEAF: u32 = 3;

/// Mean number of nodes hit by a ray above which triangles are split; an ordinary mesh of a million triangles
/// stays below 100.
const CROWDED: f32 = 500.0;
/// Largest mean number of boxes per split triangle.
const MAX_SPLITS: usize = 4;
/// Largest area of a box's two halves, relative to the box, at which a split pays off.
const WORTH_SPLITTING: f32 = 0.8;

/// Builds a tree over `triangles`, at most [`MAX_LEVELS`] deep. The tree's indices contain split triangles
/// more than once.
pub fn build(triangles: &[Triangle]) -> CwBvh {
    let tree = binary(triangles);
    if nodes_hit(&tree) <= CROWDED {
        return wide(tree, || binary_by_medians(triangles));
    }
    let (boxes, of) = split_boxes(triangles);
    let mut tree = wide(binary(&boxes), || binary_by_medians(&boxes));
    tree.primitive_indices.iter_mut().for_each(|i| *i = of[*i as usize]);
    tree
}

/// Converts a binary tree to a wide one, or converts `shallower` if the first is too deep.
fn wide(tree: Bvh2, shallower: impl FnOnce() -> Bvh2) -> CwBvh {
    let convert = |tree: Bvh2| bvh2_to_cwbvh(&tree, LEAF, true, false);
    let tree = convert(tree);
    if levels(&tree) <= MAX_LEVELS { tree } else { convert(shallower()) }
}

/// Mean number of inner nodes that a ray through the tree's box hits.
fn nodes_hit(tree: &Bvh2) -> f32 {
    let area = |node: &Bvh2Node| node.aabb().half_area();
    let whole = tree.nodes.first().map_or(0.0, area).max(f32::MIN_POSITIVE);
    tree.nodes.iter().filter(|node| !node.is_leaf()).map(area).sum::<f32>() / whole
}

/// Boxes around parts of triangles, and the triangle of each box. The largest box is halved first.
fn split_boxes(triangles: &[Triangle]) -> (Vec<Aabb>, Vec<u32>) {
    let mut boxes: Vec<Aabb> = triangles.iter().map(Boundable::aabb).collect();
    let mut of: Vec<u32> = (0..triangles.len() as u32).collect();
    // Areas are positive, so their bit patterns have the same order.
    let entry = |boxes: &[Aabb], i: usize| (boxes[i].half_area().to_bits(), i);
    let mut open: BinaryHeap<(u32, usize)> = (0..boxes.len()).map(|i| entry(&boxes, i)).collect();
    while boxes.len() < MAX_SPLITS * triangles.len()
        && let Some((_, i)) = open.pop()
    {
        let (whole, t) = (boxes[i], triangles[of[i] as usize]);
        let axis = whole.largest_axis();
        let middle = whole.center()[axis];
        let (mut low, mut high) = (whole, whole);
        (low.max[axis], high.min[axis]) = (middle, middle);
        let (left, right) = split_triangle(axis as u32, middle, [t.v0, t.v1, t.v2, t.v0]);
        let (left, right) = (left.intersection(&low), right.intersection(&high));
        if left.half_area() + right.half_area() < WORTH_SPLITTING * whole.half_area() {
            boxes[i] = left;
            boxes.push(right);
            of.push(of[i]);
            open.extend([entry(&boxes, i), entry(&boxes, boxes.len() - 1)]);
        }
    }
    (boxes, of)
}

/// Builds a binary tree over `boxes`, one per leaf; it is empty without boxes and has at most ceil(log2(n))
/// levels more than [`HEURISTIC_LEVELS`].
pub fn binary<B: Boundable>(boxes: &[B]) -> Bvh2 {
    split(boxes, HEURISTIC_LEVELS)
}

/// Builds a binary tree by median splits alone, with ceil(log2(n)) levels below the root.
pub fn binary_by_medians<B: Boundable>(boxes: &[B]) -> Bvh2 {
    split(boxes, 0)
}

/// Builds a binary tree whose first levels are split by the heuristic.
fn split<B: Boundable>(primitives: &[B], heuristic_levels: usize) -> Bvh2 {
    let mut boxes: Vec<(Aabb, u32)> = primitives.iter().zip(0..).map(|(p, i)| (p.aabb(), i)).collect();
    let mut nodes = vec![Bvh2Node::default(); (2 * boxes.len()).saturating_sub(1)];
    let mut next = 1;
    // Stack of open nodes: index, range of `boxes`, level.
    let mut open = if boxes.is_empty() { Vec::new() } else { vec![(0, 0, boxes.len(), 0)] };
    while let Some((at, from, to, level)) = open.pop() {
        let range = &mut boxes[from..to];
        let (mut all, mut centers) = (Aabb::empty(), Aabb::empty());
        for (aabb, _) in range.iter() {
            all = all.union(aabb);
            centers.extend(aabb.center());
        }
        if let [_] = range {
            nodes[at] = Bvh2Node::new(all, 1, from as u32);
            continue;
        }
        let binned = if level < heuristic_levels { Bins::over(&centers, range.len()).split(range) } else { None };
        let middle = from + binned.unwrap_or_else(|| halve(range, centers.largest_axis()));
        nodes[at] = Bvh2Node::new(all, 0, next as u32);
        open.push((next, from, middle, level + 1));
        open.push((next + 1, middle, to, level + 1));
        next += 2;
    }
    Bvh2 { nodes, primitive_indices: boxes.iter().map(|(_, i)| *i).collect(), ..Bvh2::default() }
}

/// Moves the half of the boxes with the smaller centers along an axis to the front; returns its size. Boxes
/// with equal centers are ordered by index, so that the tree depends on the mesh alone.
fn halve(range: &mut [(Aabb, u32)], axis: usize) -> usize {
    let half = range.len() / 2;
    range.select_nth_unstable_by(half, |a, b| {
        let center = |aabb: &Aabb| aabb.center()[axis];
        center(&a.0).total_cmp(&center(&b.0)).then(a.1.cmp(&b.1))
    });
    half
}

/// Bins along each axis of a node, by the centers of its boxes.
struct Bins {
    count: usize,
    low: Vec3A,
    /// Bins per unit of length.
    scale: Vec3A,
    last: Vec3A,
}

impl Bins {
    fn over(centers: &Aabb, boxes: usize) -> Bins {
        let count = boxes.min(BINS);
        let scale = count as f32 / (centers.max - centers.min);
        // Along an axis without extent, all boxes fall into the first bin.
        let scale = Vec3A::select(scale.cmplt(Vec3A::INFINITY), scale, Vec3A::ZERO);
        Bins { count, low: centers.min, scale, last: Vec3A::splat(count as f32 - 1.0) }
    }

    fn of(&self, aabb: &Aabb) -> [usize; 3] {
        ((aabb.center() - self.low) * self.scale).min(self.last).to_array().map(|x| x as usize)
    }

    /// Moves the boxes on one side of the best split to the front; returns their number. `None` if all boxes
    /// are in one bin.
    fn split(&self, range: &mut [(Aabb, u32)]) -> Option<usize> {
        let mut bins = [[(Aabb::empty(), 0usize); BINS]; 3];
        for (aabb, _) in range.iter() {
            for (bins, k) in bins.iter_mut().zip(self.of(aabb)) {
                bins[k] = (bins[k].0.union(aabb), bins[k].1 + 1);
            }
        }
        // Cost of the best split, its axis, and the last bin in front of it.
        let mut best = (f32::INFINITY, None);
        for (axis, bins) in bins.iter().enumerate() {
            let add = |(all, n): (Aabb, usize), k: usize| (all.union(&bins[k].0), n + bins[k].1);
            let cost = |(all, n): (Aabb, usize)| n as f32 * all.half_area();
            let mut behind = [(Aabb::empty(), 0); BINS];
            for k in (1..self.count).rev() {
                behind[k - 1] = add(behind[k], k);
            }
            let mut front = (Aabb::empty(), 0);
            for k in 0..self.count - 1 {
                front = add(front, k);
                if front.1 > 0 && behind[k].1 > 0 {
                    let cost = cost(front) + cost(behind[k]);
                    if cost < best.0 {
                        best = (cost, Some((axis, k)));
                    }
                }
            }
        }
        let (axis, last) = best.1?;
        let mut front = 0;
        for k in 0..range.len() {
            if self.of(&range[k].0)[axis] <= last {
                range.swap(front, k);
                front += 1;
            }
        }
        Some(front)
    }
}

/// Number of levels of a tree.
fn levels(bvh: &CwBvh) -> usize {
    let mut deepest = 0;
    let mut open = vec![(0usize, 1usize)];
    while let Some((at, level)) = open.pop() {
        let Some(node) = bvh.nodes.get(at) else { continue };
        deepest = deepest.max(level);
        if deepest > MAX_LEVELS {
            break;
        }
        let first = node.child_base_idx as usize;
        open.extend((0..node.imask.count_ones() as usize).map(|k| (first + k, level + 1)));
    }
    deepest
}

#[cfg(test)]
mod tests {
    use super::*;
    use obvhs::ray::{Ray, RayHit};

    fn nearest(bvh: &CwBvh, triangles: &[Triangle], ray: Ray) -> f32 {
        let mut hit = RayHit::none();
        bvh.ray_traverse(ray, &mut hit, |ray, i| triangles[bvh.primitive_indices[i] as usize].intersect(ray));
        hit.t
    }

    /// Number of levels of a binary tree below its root.
    fn binary_levels(tree: &Bvh2) -> usize {
        let (mut deepest, mut open) = (0, vec![(0, 0)]);
        while let Some((at, level)) = open.pop() {
            let node = &tree.nodes[at];
            deepest = deepest.max(level);
            if !node.is_leaf() {
                open.extend([(node.first_index as usize, level + 1), (node.first_index as usize + 1, level + 1)]);
            }
        }
        deepest
    }

    /// `n` overlapping triangles, placed by a parameter from 0 to 1.
    fn heap(n: usize, place: impl Fn(f32) -> [[f32; 3]; 3]) -> Vec<Triangle> {
        (0..n)
            .map(|k| {
                let [v0, v1, v2] = place((k as f32 + 0.5) / n as f32).map(Vec3A::from_array);
                Triangle { v0, v1, v2 }
            })
            .collect()
    }

    /// Clustering takes quadratic time or makes a chain for these heaps of triangles. Here the build time
    /// stays O(n log n), the tree is shallow, and rays find the nearest hit.
    #[test]
    fn heaps_take_no_longer_than_their_size_and_are_traversed() {
        let n = 20_000;
        let turn = |s: f32| (10.0 * std::f32::consts::TAU * s).sin_cos();
        let heaps: [(&str, Vec<Triangle>); 7] = [
            ("one box", heap(n, |s| [[0.0; 3], [1.0, 1.0, s], [0.0, 1.0, 1.0]])),
            ("one place", heap(n, |_| [[0.0; 3], [1.0, 0.0, 0.3], [0.0, 1.0, 0.1]])),
            ("nested at a corner", heap(n, |s| [[0.0; 3], [1.0 + s, 0.0, 0.3 + 0.3 * s], [0.0, 1.0 + s, 0.1]])),
            ("nested about a center", heap(n, |s| [[-1.0 - s; 3], [1.0 + s, -1.0 - s, 1.0 + s], [0.0, 1.0 + s, 0.0]])),
            (
                "nested over 60 octaves",
                heap(n, |s| {
                    let r = (-60.0 * s).exp2();
                    [[0.0; 3], [r, 0.0, 0.3 * r], [0.0, r, 0.1 * r]]
                }),
            ),
            ("a stack", heap(n, |s| [[0.0, 0.0, s], [1.0, 0.0, s], [0.0, 1.0, s]])),
            (
                "slivers that cross",
                heap(n, |s| {
                    let (y, x) = turn(s);
                    [[x, y, s - 0.5], [-x, -y, 0.5 - s], [-x, 1e-4 - y, 0.5 - s]]
                }),
            ),
        ];
        for (name, triangles) in heaps {
            let begun = std::time::Instant::now();
            let bvh = build(&triangles);
            let time = begun.elapsed().as_secs_f64();
            assert!(time < 5.0, "{name}: {time} s");
            assert!(levels(&bvh) <= MAX_LEVELS, "{name}: {}", levels(&bvh));
            for k in 0..20 {
                let (x, y) = (0.023 * k as f32, 0.02 + 0.017 * k as f32);
                let ray =
                    || Ray::new(Vec3A::new(x, y, 5.0), Vec3A::new(0.01, -0.02, -1.0).normalize(), 0.0, f32::INFINITY);
                let want = triangles.iter().map(|t| t.intersect(&ray())).fold(f32::INFINITY, f32::min);
                let got = nearest(&bvh, &triangles, ray());
                assert!(got == want || (got - want).abs() < 1e-6, "{name}: {got} {want}");
            }
        }
    }

    /// Slivers that cross at one point are covered by several tighter boxes within the limit; a sheet is not
    /// split.
    #[test]
    fn crowds_are_split_and_sheets_are_not() {
        let n = 2000;
        let needles = heap(n, |s| {
            let ((y, x), z) = ((200.0 * std::f32::consts::TAU * s).sin_cos(), 2.0 * s - 1.0);
            let [x, y] = [x, y].map(|v| v * (1.0 - z * z).sqrt());
            [[x, y, z], [-x, -y, -z], [-x, -y, 1e-4 - z]]
        });
        let (boxes, of) = split_boxes(&needles);
        assert!(boxes.len() > n && boxes.len() <= MAX_SPLITS * n && boxes.len() == of.len());
        let area = |boxes: &[Aabb]| boxes.iter().map(Aabb::half_area).sum::<f32>();
        let whole: Vec<Aabb> = needles.iter().map(Boundable::aabb).collect();
        assert!(area(&boxes) < 0.4 * area(&whole), "{} of {}", area(&boxes), area(&whole));
        assert!(boxes.iter().zip(&of).all(|(b, i)| {
            let (b, whole) = (*b, whole[*i as usize]);
            b.min.cmpge(whole.min).all() && b.max.cmple(whole.max).all()
        }));
        assert!(build(&needles).primitive_indices.len() > n);
        let sheet = heap(n, |s| [[s, 0.0, 0.0], [s + 5e-4, 0.0, 0.0], [s, 0.3, 0.1]]);
        assert_eq!(build(&sheet).primitive_indices.len(), n);
    }

    #[test]
    fn depth_is_bounded() {
        // Each triangle is twice as large as the one before, all from one corner, so each heuristic split
        // separates only a few.
        let triangles = heap(250, |s| {
            let r = (250.0 * (s - 0.5)).exp2();
            [[0.0; 3], [r, 0.0, 0.3 * r], [0.0, r, 0.1 * r]]
        });
        let tree = binary(&triangles);
        assert!((30..=HEURISTIC_LEVELS + 8).contains(&binary_levels(&tree)), "{}", binary_levels(&tree));
        assert_eq!(binary_levels(&binary_by_medians(&triangles)), 8);
        let bvh = build(&triangles);
        assert!(levels(&bvh) <= MAX_LEVELS);
        let ray = Ray::new(Vec3A::new(1e-3, 1e-3, -1.0), Vec3A::Z, 0.0, f32::INFINITY);
        let want = triangles.iter().map(|t| t.intersect(&ray)).fold(f32::INFINITY, f32::min);
        assert!((nearest(&bvh, &triangles, ray) - want).abs() < 1e-6);
        assert_eq!(levels(&build(&[])), 0);
        assert_eq!(binary(&triangles[..1]).nodes.len(), 1);
    }
}
