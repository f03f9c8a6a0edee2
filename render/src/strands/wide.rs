//! A BVH over bundles of capsules: nodes of eight boxes of 8-bit coordinates, in two cache lines.
//!
//! obvhs builds the binary tree from which this tree is made.

use super::bundle::{BITS, Bundle, CAPSULES, Capsule, STEPS};
use crate::surface::bvh;
use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use plywave::math::simd::{fma, max, min};

/// Children of a node.
const WIDTH: usize = 8;
/// Marks a bundle; the other bits are its number.
const LEAF: u32 = 1 << 31;
/// Largest number of levels; each needs seven entries on the traversal's stack.
const MAX_LEVELS: usize = 31;
const STACK: usize = (WIDTH - 1) * MAX_LEVELS + WIDTH;
/// Number of bundles that wait until their memory has arrived.
const WAITING: usize = 2;
/// Factor that covers the roundings of the far end of a slab.
const ROOM: f32 = 1.0 + 4e-7;
/// Smallest magnitude of a component of a direction.
const MIN: f32 = 1e-12;
/// Margin by which boxes grow for the rounding of traversal, relative to the largest coordinate of the scene.
/// The error is some fifteen roundings of 6e-8 times up to 3.5 coordinates: those of the ray's origin, of the
/// difference, of the product, and of the 8-bit coordinates.
const PAD: f32 = 4e-6;

/// Eight boxes, and their children. Coordinates are `corner + step * n` for the 8-bit number n.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Node {
    corner: [f32; 3],
    step: [f32; 3],
    low: [[u8; WIDTH]; 3],
    high: [[u8; WIDTH]; 3],
    children: [u32; WIDTH],
    /// Bit mask of the children that exist.
    exist: u32,
}

/// The tree: its nodes, the root first, and the bundles.
#[derive(Clone, Debug)]
pub struct Wide {
    nodes: Vec<Node>,
    bundles: Vec<Bundle>,
    /// `[bundle][capsule]`: first control points of the segments.
    firsts: Vec<[u32; CAPSULES]>,
}

impl Wide {
    /// Builds a tree over at most 2^31 capsules, whose coordinates have a magnitude of at most `max`.
    pub fn new(capsules: &[Capsule], max: f32) -> Wide {
        // A tree by medians has at most 31 levels, which is within the limit.
        let tree = bvh::binary(&boxes(capsules));
        Wide::collapse(&tree, capsules, max).unwrap_or_else(|| Wide::by_medians(capsules, max))
    }

    /// Builds a tree of another form, split at medians.
    pub fn by_medians(capsules: &[Capsule], max: f32) -> Wide {
        let tree = bvh::binary_by_medians(&boxes(capsules));
        Wide::collapse(&tree, capsules, max).unwrap_or_else(Wide::empty)
    }

    fn empty() -> Wide {
        Wide { nodes: Vec::new(), bundles: Vec::new(), firsts: Vec::new() }
    }

    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Bytes of memory.
    pub fn memory_bytes(&self) -> usize {
        size_of_val(self.nodes.as_slice()) + size_of_val(self.bundles.as_slice()) + size_of_val(self.firsts.as_slice())
    }

    /// Converts a binary tree to nodes of eight; `None` if it is too deep.
    fn collapse(tree: &Bvh2, capsules: &[Capsule], max: f32) -> Option<Wide> {
        let mut wide = Wide::empty();
        if capsules.is_empty() {
            return Some(wide);
        }
        let counts = counts(tree);
        wide.nodes.push(Node::EMPTY);
        // Stack of open nodes: index in the binary tree, index in the wide tree, level.
        let (mut open, mut of_bundle) = (vec![(0usize, 0usize, 1usize)], Vec::new());
        while let Some((from, to, level)) = open.pop() {
            if level > MAX_LEVELS {
                return None;
            }
            let (children, count) = children(tree, &counts, from);
            let children = &children[..count];
            wide.nodes[to].bound(children.iter().map(|child| *tree.nodes[*child].aabb()), PAD * max);
            for (k, &child) in children.iter().enumerate() {
                wide.nodes[to].children[k] = if counts[child] as usize <= CAPSULES {
                    of_bundle.clear();
                    gather(tree, child, &mut of_bundle);
                    let of = of_bundle.iter().map(|i| capsules[*i as usize]);
                    wide.bundles.push(Bundle::new(of.clone()));
                    let mut firsts = [0; CAPSULES];
                    firsts.iter_mut().zip(of).for_each(|(first, capsule)| *first = capsule.first);
                    wide.firsts.push(firsts);
                    LEAF | (wide.bundles.len() as u32 - 1)
                } else {
                    wide.nodes.push(Node::EMPTY);
                    open.push((child, wide.nodes.len() - 1, level + 1));
                    wide.nodes.len() as u32 - 1
                };
            }
        }
        Some(wide)
    }

    #[inline(always)]
    fn bundle(&self, at: u32) -> Option<(&Bundle, &[u32; CAPSULES])> {
        Some((self.bundles.get(at as usize)?, self.firsts.get(at as usize)?))
    }

    /// Calls `visit` for each bundle whose box the ray hits, with the first control points of its segments
    /// and the current largest distance, and at the end with `None`; `visit` returns the new largest
    /// distance. Returns the number of tested nodes.
    #[inline(always)]
    pub fn traverse<const FMA: bool>(
        &self,
        origin: Vec3,
        direction: Vec3,
        limit: f32,
        mut visit: impl FnMut(Option<(&Bundle, &[u32; CAPSULES])>, f32) -> f32,
    ) -> u64 {
        if self.nodes.is_empty() {
            return 0;
        }
        let (mut limit, mut tested) = (limit, 0);
        let inverse = direction.to_array().map(|d| 1.0 / if d.abs() < MIN { MIN.copysign(d) } else { d });
        let origin = origin.to_array();
        let mut stack = [(0.0f32, 0u32); STACK];
        let mut top = 1;
        let mut waiting = [(0.0f32, 0u32); WAITING];
        // Numbers of bundles that began and ended to wait.
        let (mut begun, mut ended) = (0, 0);
        loop {
            while top > 0 && begun < ended + WAITING {
                top -= 1;
                let (mut near, mut at) = stack[top];
                if near > limit {
                    continue;
                }
                while at & LEAF == 0 {
                    let node = &self.nodes[at as usize];
                    tested += 1;
                    let (from, mut hits) = node.hit::<FMA>(origin, inverse, limit);
                    if hits == 0 {
                        break;
                    }
                    // Continue with the nearest child; push the others with the nearest on top.
                    let first = hits.trailing_zeros() as usize % WIDTH;
                    hits &= hits - 1;
                    let mut nearest = (from[first], node.children[first]);
                    let bottom = top;
                    while hits != 0 {
                        let k = hits.trailing_zeros() as usize % WIDTH;
                        hits &= hits - 1;
                        let mut other = (from[k], node.children[k]);
                        if other.0 < nearest.0 {
                            std::mem::swap(&mut other, &mut nearest);
                        }
                        // Traversal mostly waits for memory, so later nodes are prefetched.
                        if other.1 & LEAF == 0 {
                            prefetch(&self.nodes, other.1 as usize);
                        } else {
                            prefetch(&self.bundles, (other.1 & !LEAF) as usize);
                        }
                        let mut place = top;
                        while place > bottom && stack[place - 1].0 < other.0 {
                            stack[place] = stack[place - 1];
                            place -= 1;
                        }
                        stack[place] = other;
                        top += 1;
                    }
                    (near, at) = nearest;
                }
                if at & LEAF != 0 {
                    // The bundle is tested a little later, when it has come from memory.
                    let at = at & !LEAF;
                    prefetch(&self.bundles, at as usize);
                    prefetch(&self.firsts, at as usize);
                    waiting[begun % WAITING] = (near, at);
                    begun += 1;
                }
            }
            let is_last = ended == begun;
            let mut bundle = None;
            if !is_last {
                let (near, at) = waiting[ended % WAITING];
                ended += 1;
                if near > limit {
                    continue;
                }
                bundle = self.bundle(at);
            }
            // One call alone, so that it is compiled in place.
            limit = visit(bundle, limit);
            if is_last {
                return tested;
            }
        }
    }
}

impl Node {
    const EMPTY: Node = Node {
        corner: [0.0; 3],
        step: [0.0; 3],
        low: [[0; WIDTH]; 3],
        high: [[0; WIDTH]; 3],
        children: [0; WIDTH],
        exist: 0,
    };

    /// Distances at which a ray enters the boxes, and the bit mask of those that it hits before `limit`.
    #[inline(always)]
    fn hit<const FMA: bool>(&self, origin: [f32; 3], inverse: [f32; 3], limit: f32) -> ([f32; WIDTH], u32) {
        let (mut from, mut to) = ([0.0f32; WIDTH], [limit; WIDTH]);
        for k in 0..3 {
            let per = inverse[k];
            let (scale, shift) = (self.step[k] * per, (self.corner[k] - origin[k]) * per);
            let (near, far) = if per < 0.0 { (&self.high[k], &self.low[k]) } else { (&self.low[k], &self.high[k]) };
            let (near, far) = (floats(near), floats(far));
            for i in 0..WIDTH {
                from[i] = max(fma::<FMA>(near[i], scale, shift), from[i]);
            }
            for i in 0..WIDTH {
                to[i] = min(fma::<FMA>(far[i], scale, shift) * ROOM, to[i]);
            }
        }
        let mut bits = [0; WIDTH];
        for i in 0..WIDTH {
            bits[i] = if from[i] <= to[i] { BITS[i] } else { 0 };
        }
        let mut hits = 0;
        for bit in bits {
            hits |= bit;
        }
        (from, hits & self.exist)
    }

    /// Sets the boxes of the children.
    fn bound(&mut self, boxes: impl Iterator<Item = Aabb> + Clone, pad: f32) {
        let pad = Vec3A::splat(pad);
        let (mut low, mut high) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
        for aabb in boxes.clone() {
            low = low.min(aabb.min - pad);
            high = high.max(aabb.max + pad);
        }
        self.corner = low.to_array();
        // A step larger by a few roundings, so that 255 of them reach the other side.
        self.step = ((high - low) * ((1.0 + 1e-6) / STEPS)).max(Vec3A::splat(f32::MIN_POSITIVE)).to_array();
        for (i, aabb) in boxes.take(WIDTH).enumerate() {
            self.exist |= 1 << i;
            let (low, high) = ((aabb.min - pad).to_array(), (aabb.max + pad).to_array());
            for k in 0..3 {
                let at = |x: f32| (x - self.corner[k]) / self.step[k];
                self.low[k][i] = at(low[k]).floor().clamp(0.0, STEPS) as u8;
                self.high[k][i] = at(high[k]).ceil().clamp(0.0, STEPS) as u8;
            }
        }
    }
}

/// Numbers of eight bytes.
#[inline(always)]
fn floats(bytes: &[u8; WIDTH]) -> [f32; WIDTH] {
    let mut all = [0.0; WIDTH];
    for i in 0..WIDTH {
        all[i] = f32::from(bytes[i]);
    }
    all
}

/// Boxes of capsules.
fn boxes(capsules: &[Capsule]) -> Vec<Aabb> {
    capsules.iter().map(Capsule::aabb).collect()
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

/// Number of primitives below each node of a binary tree.
fn counts(tree: &Bvh2) -> Vec<u32> {
    let (mut order, mut open) = (Vec::with_capacity(tree.nodes.len()), vec![0usize]);
    while let Some(at) = open.pop() {
        order.push(at);
        let node = &tree.nodes[at];
        if !node.is_leaf() {
            open.extend([node.first_index as usize, node.first_index as usize + 1]);
        }
    }
    let mut counts = vec![0u32; tree.nodes.len()];
    // Children are visited before parents.
    for &at in order.iter().rev() {
        let node = &tree.nodes[at];
        let first = node.first_index as usize;
        counts[at] = if node.is_leaf() { node.prim_count } else { counts[first] + counts[first + 1] };
    }
    counts
}

/// Up to eight children of a node: the child with the largest area that has too many primitives for a bundle
/// is replaced by its children until there are eight. A bundle is its own only child.
fn children(tree: &Bvh2, counts: &[u32], at: usize) -> ([usize; WIDTH], usize) {
    let mut list = [at; WIDTH];
    let mut count = 1;
    while count < WIDTH {
        let area = |k: &usize| tree.nodes[list[*k]].aabb().half_area();
        let open = (0..count).filter(|k| counts[list[*k]] as usize > CAPSULES);
        let Some(k) = open.max_by(|a, b| area(a).total_cmp(&area(b))) else { break };
        let first = tree.nodes[list[k]].first_index as usize;
        list[k] = first;
        list[count] = first + 1;
        count += 1;
    }
    (list, count)
}

/// Appends the primitives below a node of a binary tree to `order`.
fn gather(tree: &Bvh2, at: usize, order: &mut Vec<u32>) {
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
