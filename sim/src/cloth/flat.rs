//! Flat yarns as strands side by side: round strands of one radius whose envelope is an ellipse.
//!
//! The strands form a chain that zigzags between the upper and the lower wall of the ellipse. Each touches a
//! previous one or keeps a radius of distance along x. The chain has the width and height of the ellipse and
//! no gap when viewed from above. The strands cover about 0.7 of its area, since circles do not fill it.

/// Minimum ratio of width and height of a flat section; below it a round strand of the same area differs by
/// at most 12 % in both.
pub(super) const FLAT: f64 = 1.25;
/// Maximum number of strands of a yarn.
const MAX_STRANDS: usize = 48;
/// Starting radius of a strand over half of the height, at most: strands of one wall then touch each other
/// and those of the other wall.
const LARGEST: f64 = 0.535_898_384_862_245_4;

/// Round strands of a section.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Strands {
    /// Radius of each [um].
    pub radius_um: f64,
    /// `[strand]`: position of its axis relative to that of the yarn, across it and up [um].
    pub places_um: Vec<[f64; 2]>,
}

impl Strands {
    /// Strands for an elliptical section of this width and height [um]; `None` if the section is too flat for
    /// [`MAX_STRANDS`] strands.
    pub fn of_section(width_um: f64, height_um: f64) -> Option<Strands> {
        let (long, short) = (width_um.max(height_um), width_um.min(height_um));
        if long < FLAT * short {
            return Some(Strands { radius_um: 0.5 * (long * short).sqrt(), places_um: vec![[0.0; 2]] });
        }
        let half = [0.5 * long, 0.5 * short];
        // With this radius the last strand fits in the tip of the ellipse.
        let [a, b] = half;
        let fine = (LARGEST * b).min(2.0 * a * b * b / (a * a + b * b));
        let count = (2..=MAX_STRANDS).take_while(|count| reach(half, fine, *count) <= a).last().unwrap_or(2);
        if reach(half, b, count) < a {
            return None;
        }
        let (mut low, mut high) = (fine, b);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            *(if reach(half, middle, count) > a { &mut high } else { &mut low }) = middle;
        }
        let chain = chain(half, low, count);
        let turned = |p: [f64; 2]| if width_um < height_um { [p[1], p[0]] } else { p };
        Some(Strands { radius_um: low, places_um: chain.into_iter().map(turned).collect() })
    }
}

/// Approximate height of the axis of a strand at x that touches the wall of the ellipse from inside.
fn wall([a, b]: [f64; 2], radius: f64, x: f64) -> f64 {
    (b * (1.0 - (x / a).powi(2)).max(0.0).sqrt() - radius).max(0.0)
}

/// The first strand with x of at least `low`, on the upper (`side` 1) or the lower wall (-1), that does not
/// overlap the strands that `others` returns for its x.
fn next<const N: usize>(
    half: [f64; 2],
    radius: f64,
    low: f64,
    side: f64,
    others: impl Fn(f64) -> [[f64; 2]; N],
) -> [f64; 2] {
    // Distances grow with x, which allows a bisection.
    let (mut low, mut high) = (low, low + 2.0 * radius);
    for _ in 0..60 {
        let x = 0.5 * (low + high);
        let z = side * wall(half, radius, x);
        let is_near = others(x).iter().any(|[p, q]| (x - p).hypot(z - q) < 2.0 * radius);
        *(if is_near { &mut low } else { &mut high }) = x;
    }
    [high, side * wall(half, radius, high)]
}

/// The right half of the chain from the middle outwards, with the middle strand if the count is odd.
fn right_half(half: [f64; 2], radius: f64, count: usize) -> Vec<[f64; 2]> {
    let wall_at = |x: f64| wall(half, radius, x);
    let mut chain = if count.is_multiple_of(2) {
        // The first strand and the next one keep clear of the first one's image under half a turn.
        let first = next(half, radius, 0.5 * radius, 1.0, |x| [[-x, -wall_at(x)]]);
        let image = first.map(|v| -v);
        vec![first, next(half, radius, first[0] + radius, -1.0, |_| [first, image])]
    } else {
        // The second strand keeps clear of its mirror image.
        let first = [0.0, wall_at(0.0)];
        vec![first, next(half, radius, radius, -1.0, |x| [first, [-x, -wall_at(x)]])]
    };
    while chain.len() < count.div_ceil(2) {
        let [before, last] = [chain[chain.len() - 2], chain[chain.len() - 1]];
        let side = if chain.len().is_multiple_of(2) { 1.0 } else { -1.0 };
        chain.push(next(half, radius, last[0] + radius, side, |_| [before, last]));
    }
    chain.truncate(count.div_ceil(2));
    chain
}

/// Distance from the middle to the end of a chain.
fn reach(half: [f64; 2], radius: f64, count: usize) -> f64 {
    right_half(half, radius, count).last().map_or(0.0, |p| p[0] + radius)
}

/// The whole chain from left to right, scaled to the height of the ellipse.
fn chain(half: [f64; 2], radius: f64, count: usize) -> Vec<[f64; 2]> {
    let right = right_half(half, radius, count);
    let odd = count % 2;
    // An even chain is its own image under half a turn, an odd one its mirror image.
    let sign = if odd == 1 { 1.0 } else { -1.0 };
    let mirrored = right[odd..].iter().rev().map(|[x, z]| [-x, sign * z]);
    let all: Vec<[f64; 2]> = mirrored.chain(right.iter().copied()).collect();
    let low = all.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
    let high = all.iter().map(|p| p[1]).fold(f64::NEG_INFINITY, f64::max);
    let scale = if high > low { 2.0 * (half[1] - radius) / (high - low) } else { 1.0 };
    all.into_iter().map(|[x, z]| [x, scale * (z - 0.5 * (low + high))]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Width and height of the strands are those of the section; strands do not overlap and leave no gap when
    /// viewed from above.
    #[test]
    fn strands_are_as_wide_and_high_as_the_section_and_do_not_overlap() {
        for (width, height) in
            [(180.0, 40.0), (100.0, 75.0), (60.0, 40.0), (40.0, 180.0), (500.0, 50.0), (200.0, 100.0)]
        {
            let Strands { radius_um, places_um } = Strands::of_section(width, height).unwrap();
            let extent = |k: usize| {
                let all = || places_um.iter().map(|p| p[k]);
                all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min) + 2.0 * radius_um
            };
            let area = places_um.len() as f64 * 4.0 * radius_um * radius_um / (width * height);
            println!("{width} x {height}: {} of R {radius_um:.2}, {area:.3} of the area", places_um.len());
            assert!((extent(0) / width - 1.0).abs() < 0.01, "{width} x {height}: {} wide", extent(0));
            assert!((extent(1) / height - 1.0).abs() < 0.01, "{width} x {height}: {} high", extent(1));
            assert!((0.6..0.95).contains(&area), "{width} x {height}: {area} of the area");
            let long = usize::from(width < height);
            for (i, p) in places_um.iter().enumerate() {
                for q in &places_um[..i] {
                    let apart = (p[0] - q[0]).hypot(p[1] - q[1]);
                    assert!(apart > 1.98 * radius_um, "{width} x {height}: {p:?} {q:?}");
                }
                if i > 0 {
                    let step = p[long] - places_um[i - 1][long];
                    assert!(step > 0.0 && step <= 2.001 * radius_um, "{width} x {height}: a gap at {p:?}");
                }
            }
        }
    }

    #[test]
    fn round_sections_stay_one_strand_and_tapes_are_refused() {
        let round = Strands::of_section(100.0, 100.0).unwrap();
        assert_eq!((round.radius_um, round.places_um.len()), (50.0, 1));
        assert_eq!(Strands::of_section(110.0, 100.0).unwrap().places_um.len(), 1);
        assert_eq!(Strands::of_section(5000.0, 100.0), None);
    }
}
