//! A BVH with four boxes per node in 32-bit floats: a node has two cache lines, and each end of the slabs
//! needs three subtractions and products of four-vectors.
//!
//! obvhs builds the binary tree from which this tree is made. Its own traversal of eight 8-bit boxes uses
//! less memory, but with SSE2 alone it unpacks the 48 bytes of a node one by one.
//! unpacks 48 bytes per node one by one.

use crate::surface::bvh;
use glam::{Vec3, Vec4};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;

/// Marks a leaf; two bits contain its number of primitives minus one, the lower ones its first primitive.
const LEAF: u32 = 1 << 31;
const COUNT_SHIFT: u32 = 29;
const INDEX: u32 = (1 << COUNT_SHIFT) - 1;
/// Largest number of primitives of a leaf.
const MAX_IN_LEAF: u32 = 4;
/// Cost of testing a node relative to that of testing a primitive.
const NODE_COST: f32 = 1.0;
/// Largest number of levels; each needs three entries on the traversal's stack.
const MAX_LEVELS: usize = 31;
const STACK: usize = 3 * MAX_LEVELS + 3;
/// Factor that covers two roundings of the far end of a slab.
const ROOM: f32 = 1.0 + 4e-7;
/// Smallest magnitude of a component of a direction.
const MIN: f32 = 1e-12;

/// Four boxes by axis, and their children. Absent boxes are inverted, so no ray hits them.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Node {
    low: [Vec4; 3],
    high: [Vec4; 3],
    children: [u32; 4],
}

/// The tree: its nodes, the root first, and the primitives in the order of its leaves.
#[derive(Clone, Debug)]
pub struct Wide {
    nodes: Vec<Node>,
    /// Indices of the input boxes in the order of the leaves.
    pub order: Vec<u32>,
}

impl Wide {
    /// Builds a tree over at most 2^29 boxes.
    pub fn new(boxes: &[Aabb]) -> Wide {
        Wide::collapse(&bvh::binary(boxes), boxes).unwrap_or_else(|| Wide::by_medians(boxes))
    }

    /// Builds a tree of another form, split at medians.
    pub fn by_medians(boxes: &[Aabb]) -> Wide {
        // It has at most 29 levels, which is within the limit.
        Wide::collapse(&bvh::binary_by_medians(boxes), boxes).unwrap_or(Wide { nodes: Vec::new(), order: Vec::new() })
    }

    /// Converts a binary tree to nodes of four; `None` if it is too deep.
    fn collapse(tree: &Bvh2, boxes: &[Aabb]) -> Option<Wide> {
        if boxes.is_empty() {
            return Some(Wide { nodes: Vec::new(), order: Vec::new() });
        }
        let plan = Plan::new(tree);
        let mut wide = Wide { nodes: vec![Node::EMPTY], order: Vec::with_capacity(boxes.len()) };
        // Stack of open nodes: index in the binary tree, index in the wide tree, level.
        let mut open = vec![(0usize, 0usize, 1usize)];
        while let Some((from, to, level)) = open.pop() {
            if level > MAX_LEVELS {
                return None;
            }
            let (children, count) = plan.children(tree, from);
            for (k, &child) in children[..count].iter().enumerate() {
                let aabb = tree.nodes[child].aabb();
                let link = if plan.is_leaf[child] {
                    let first = wide.order.len() as u32;
                    plan.gather(tree, child, &mut wide.order);
                    LEAF | (wide.order.len() as u32 - first - 1) << COUNT_SHIFT | first
                } else {
                    wide.nodes.push(Node::EMPTY);
                    open.push((child, wide.nodes.len() - 1, level + 1));
                    wide.nodes.len() as u32 - 1
                };
                let node = &mut wide.nodes[to];
                for axis in 0..3 {
                    node.low[axis][k] = aabb.min[axis];
                    node.high[axis][k] = aabb.max[axis];
                }
                node.children[k] = link;
            }
        }
        Some(wide)
    }

    /// Calls `visit` for each primitive whose box the ray hits, with the primitive's index in the tree's
    /// order and the current largest distance; `visit` returns the new largest distance. `ahead` is called
    /// earlier with the first primitive of a leaf, for a prefetch. Returns the number of tested nodes.
    #[inline(always)]
    pub fn traverse(
        &self,
        origin: Vec3,
        direction: Vec3,
        limit: f32,
        ahead: impl Fn(usize),
        mut visit: impl FnMut(usize, f32) -> f32,
    ) -> u64 {
        if self.nodes.is_empty() {
            return 0;
        }
        let inverse = direction.to_array().map(|d| 1.0 / if d.abs() < MIN { MIN.copysign(d) } else { d });
        let (origin, mut limit, mut tested) = (origin.to_array(), limit, 0);
        let mut stack = [(0.0f32, 0u32); STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (near, mut at) = stack[top];
            if near > limit {
                continue;
            }
            while at & LEAF == 0 {
                let node = &self.nodes[at as usize];
                tested += 1;
                let slab = |k: usize| {
                    let (from, to) =
                        if inverse[k] < 0.0 { (node.high[k], node.low[k]) } else { (node.low[k], node.high[k]) };
                    let (o, i) = (Vec4::splat(origin[k]), Vec4::splat(inverse[k]));
                    ((from - o) * i, (to - o) * i)
                };
                let ((x0, x1), (y0, y1), (z0, z1)) = (slab(0), slab(1), slab(2));
                let from = x0.max(y0).max(z0.max(Vec4::ZERO));
                let to = (x1.min(y1).min(z1) * ROOM).min(Vec4::splat(limit));
                let mut hits = from.cmple(to).bitmask();
                if hits == 0 {
                    break;
                }
                let from = from.to_array();
                // Continue with the nearest child; push the others with the nearest on top.
                let first = hits.trailing_zeros() as usize;
                hits &= hits - 1;
                let mut nearest = (from[first], node.children[first]);
                let bottom = top;
                while hits != 0 {
                    let k = hits.trailing_zeros() as usize;
                    hits &= hits - 1;
                    let mut other = (from[k], node.children[k]);
                    if other.0 < nearest.0 {
                        std::mem::swap(&mut other, &mut nearest);
                    }
                    // Traversal mostly waits for memory, so later nodes are prefetched.
                    if other.1 & LEAF == 0 {
                        prefetch(&self.nodes, other.1 as usize);
                    } else {
                        ahead((other.1 & INDEX) as usize);
                    }
                    let mut place = top;
                    while place > bottom && stack[place - 1].0 < other.0 {
                        stack[place] = stack[place - 1];
                        place -= 1;
                    }
                    stack[place] = other;
                    top += 1;
                }
                at = nearest.1;
            }
            if at & LEAF != 0 {
                let first = (at & INDEX) as usize;
                let count = ((at & !LEAF) >> COUNT_SHIFT) as usize + 1;
                for i in first..first + count {
                    limit = visit(i, limit);
                }
            }
        }
        tested
    }
}

impl Node {
    const EMPTY: Node = Node { low: [Vec4::INFINITY; 3], high: [Vec4::NEG_INFINITY; 3], children: [0; 4] };
}

/// Prefetches the first and the last cache line of an element; does nothing if the element does not exist or
/// the processor has no such instruction.
#[inline(always)]
pub fn prefetch<T>(of: &[T], at: usize) {
    #[cfg(target_arch = "x86_64")]
    if let Some(x) = of.get(at) {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let first: *const i8 = std::ptr::from_ref(x).cast();
        let last = first.wrapping_add(size_of::<T>().saturating_sub(1));
        // SAFETY: a prefetch neither changes nor reads memory, and both addresses are within the element.
        #[allow(unsafe_code)]
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(first);
            _mm_prefetch::<_MM_HINT_T0>(last);
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (of, at);
}

/// Choice of the nodes of a binary tree that become leaves, by the surface area heuristic.
struct Plan {
    is_leaf: Vec<bool>,
}

impl Plan {
    fn new(tree: &Bvh2) -> Plan {
        let n = tree.nodes.len();
        // Children are visited before parents.
        let (mut order, mut open) = (Vec::with_capacity(n), vec![0usize]);
        while let Some(at) = open.pop() {
            order.push(at);
            let node = &tree.nodes[at];
            if !node.is_leaf() {
                open.extend([node.first_index as usize, node.first_index as usize + 1]);
            }
        }
        let (mut is_leaf, mut count, mut cost) = (vec![false; n], vec![0u32; n], vec![0.0f32; n]);
        for &at in order.iter().rev() {
            let node = &tree.nodes[at];
            let area = node.aabb().half_area();
            let (all, split) = if node.is_leaf() {
                (node.prim_count, f32::INFINITY)
            } else {
                let [a, b] = [node.first_index as usize, node.first_index as usize + 1];
                // A third of the binary tree's nodes become nodes of four.
                (count[a] + count[b], cost[a] + cost[b] + NODE_COST / 3.0 * area)
            };
            let whole = if all <= MAX_IN_LEAF { area * all as f32 } else { f32::INFINITY };
            (count[at], cost[at], is_leaf[at]) = (all, whole.min(split), whole <= split);
        }
        Plan { is_leaf }
    }

    /// Up to four children of a node: the inner child with the largest area is replaced by its children until
    /// there are four. A leaf is its own only child.
    fn children(&self, tree: &Bvh2, at: usize) -> ([usize; 4], usize) {
        let mut list = [at; 4];
        let mut count = 1;
        while count < 4 {
            let area = |k: &usize| tree.nodes[list[*k]].aabb().half_area();
            let open = (0..count).filter(|k| !self.is_leaf[list[*k]]);
            let Some(k) = open.max_by(|a, b| area(a).total_cmp(&area(b))) else { break };
            let first = tree.nodes[list[k]].first_index as usize;
            list[k] = first;
            list[count] = first + 1;
            count += 1;
        }
        (list, count)
    }

    /// Appends the primitives below a node to `order`.
    fn gather(&self, tree: &Bvh2, at: usize, order: &mut Vec<u32>) {
        let mut open = vec![at];
        while let Some(at) = open.pop() {
            let node = &tree.nodes[at];
            let first = node.first_index as usize;
            if node.is_leaf() {
                order.extend_from_slice(&tree.primitive_indices[first..first + node.prim_count as usize]);
            } else {
                open.extend([first + 1, first]);
            }
        }
    }
}
