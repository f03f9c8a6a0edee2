//! Light that grazes an aperture. References: the incident light, 1, compared with the integral of `eval`
//! over the sphere by a rule that shares nothing with the code under test; and Yu 2025, Eq. 15 in f64, for
//! light that does not graze.

use plywave::Bsdf;
use plywave::gap::{Aperture, Gap};
use plywave::math::faddeeva::{diffraction_factor, power_between};
use plywave::spec::GaussianBeam;

const LAMBDA: [f32; 3] = [0.4, 0.55, 0.7];

/// The integral of f over all directions, in the variables (xi_x, angle about x), whose area element is that
/// of the sphere. Cells are as small as `finest` about the frequency 0 of either axis and grow in proportion
/// to the distance from it.
fn integral(gap: &Gap, xi_i: [f32; 3], finest: f64) -> [f64; 3] {
    let at = gap.at(xi_i, LAMBDA);
    let nodes = |center: f64, low: f64, high: f64| -> Vec<(f64, f64)> {
        let mut borders = vec![center.clamp(low, high)];
        for (end, sign) in [(high, 1.0), (low, -1.0)] {
            let mut x = borders[0];
            while (end - x) * sign > 0.0 {
                let step = finest.max(0.03 * (x - center).abs());
                x = if (end - x).abs() < 1.5 * step { end } else { x + sign * step };
                borders.push(x);
            }
        }
        borders.sort_by(f64::total_cmp);
        borders.windows(2).map(|w| (0.5 * (w[0] + w[1]), w[1] - w[0])).filter(|n| n.1 > 0.0).collect()
    };
    let half = 0.5 * std::f64::consts::PI;
    let mut sum = [0.0; 3];
    for (u, du) in nodes(-f64::from(xi_i[0]), -1.0, 1.0) {
        let reach = (1.0 - u * u).sqrt();
        // The angle at which the frequency along y is 0.
        let center = (f64::from(xi_i[1]) / reach).clamp(-1.0, 1.0).asin();
        for (psi, dpsi) in nodes(center, -half, half) {
            let (s, c) = psi.sin_cos();
            let f = at.eval([u, -reach * s, -reach * c].map(|x| x as f32));
            for k in 0..3 {
                sum[k] += f64::from(f[k]) * du * dpsi;
            }
        }
    }
    sum
}

/// Light at this cosine to the normal, at azimuth `phi`.
fn grazing(cosine: f32, phi: f32) -> [f32; 3] {
    let sine = (1.0 - cosine * cosine).sqrt();
    [sine * phi.cos(), sine * phi.sin(), cosine]
}

/// Apertures of 0.1 to 200 um, and their beams.
const CASES: [(f64, [f32; 2], [f32; 2]); 10] = [
    (10.0, [-0.05, 0.05], [-20.0, 20.0]),
    (10.0, [-1.0, 1.0], [-1.0, 1.0]),
    (10.0, [-1.0, 1.0], [-20.0, 20.0]),
    (10.0, [-5.0, 5.0], [-5.0, 5.0]),
    (10.0, [-12.0, 12.0], [-14.0, 14.0]),
    (10.0, [3.0, 20.0], [-20.0, 20.0]),
    (10.0, [-20.0, 20.0], [-20.0, 20.0]),
    (50.0, [-1.0, 1.0], [-100.0, 100.0]),
    (50.0, [-20.0, 20.0], [-20.0, 20.0]),
    (50.0, [-100.0, 100.0], [-100.0, 100.0]),
];

fn case((w0, x, y): (f64, [f32; 2], [f32; 2])) -> Gap {
    let beam = GaussianBeam { w0_um: w0, lambda_um: 0.55, d_cut_um: 2.0 * w0 };
    Gap::new(&Aperture::new(x, y).unwrap(), &beam)
}

/// With Kirchhoff's 1/c_i as printed, an aperture of 2 um would send out 2.5 times the incident light at a
/// cosine of 0.02, and 46 times at 0.001.
#[test]
#[ignore = "slow: 10 s: no aperture sends out more than arrives"]
fn no_aperture_sends_out_more_than_arrives() {
    let (mut most, mut least, mut apart) = (0.0f64, f64::INFINITY, 0.0f64);
    for (i, sizes) in CASES.into_iter().enumerate() {
        let gap = case(sizes);
        for cosine in [0.001, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0] {
            for phi in [0.0, 0.7] {
                let (at, sum) =
                    (gap.at(grazing(cosine, phi), LAMBDA), integral(&gap, grazing(cosine, phi), 0.002 / sizes.0));
                println!("{sizes:?} cosine {cosine}, azimuth {phi}: {sum:.4?}");
                for (sum, albedo) in sum.into_iter().zip(at.albedo()) {
                    assert!(sum <= 1.005, "{sizes:?}, cosine {cosine}, azimuth {phi}: sends out {sum} of 1");
                    most = most.max(sum);
                    apart = apart.max((sum - f64::from(albedo)).abs());
                    // A slit of a quarter of a wavelength sends most of its light into the plane and beyond.
                    if i > 0 {
                        least = least.min(sum);
                    }
                }
            }
        }
    }
    println!("least {least:.4}, most {most:.4}, apart from the albedo {apart:.1e}");
    // At grazing light Kirchhoff's approximation loses the part of an aperture's spectrum beyond the plane;
    // the bound removes no more.
    assert!(least > 0.55, "{least}");
    // The albedo is that of 64 cells per sign and axis: 0.003 in wide apertures, 0.012 in slits of 2 um.
    assert!(apart < 0.015, "{apart}");
}

/// Up to a tilt of 60 degrees f is the printed formula to the last digits of f32, in every direction.
#[test]
fn moderate_tilts_are_left_as_they_are() {
    let square = |k: [f64; 2]| k[0] * k[0] + k[1] * k[1];
    let mut worst = 0.0f64;
    // Without the slit of 0.1 um, whose K is a difference of nearly equal numbers in f32: 2e-4 of its peak.
    for (w0, x, y) in CASES.into_iter().skip(1) {
        let gap = case((w0, x, y));
        let [a, b] = [x, y].map(|edges| edges.map(f64::from));
        let power = power_between(a[0], a[1], w0) * power_between(b[0], b[1], w0);
        for cosine in [0.5, 0.6, 0.8, 1.0] {
            let xi = grazing(cosine, 0.7);
            let at = gap.at(xi, LAMBDA);
            let forward = at.eval(xi.map(|x| -x));
            for i in 0..400 {
                // Directions about the forward one, ever closer to it, and all around.
                let (r, phi) = (0.5f64.powf(0.02 * f64::from(i)), 2.4 * f64::from(i));
                let (u, v) = ((r * phi.cos()) as f32 - xi[0], (r * phi.sin()) as f32 - xi[1]);
                if u * u + v * v >= 0.999 {
                    continue;
                }
                let wo = [u, v, -(1.0 - u * u - v * v).sqrt()];
                let (got, [u, v, z]) = (at.eval(wo), wo.map(f64::from));
                for k in 0..3 {
                    let lambda = f64::from(LAMBDA[k]);
                    let kx = square(diffraction_factor(a[0], a[1], (f64::from(xi[0]) + u) / lambda, w0));
                    let ky = square(diffraction_factor(b[0], b[1], (f64::from(xi[1]) + v) / lambda, w0));
                    let c = f64::from(xi[2]);
                    let want = (c - z).powi(2) * kx * ky / (4.0 * power * c * lambda * lambda);
                    worst = worst.max((f64::from(got[k]) - want).abs() / f64::from(forward[k]).max(want));
                }
            }
        }
    }
    println!("f against the formula in f64, over its peak: {worst:.1e}");
    // As in `gap.rs`; the beam of 50 um is five times as narrow, so that the rounding of xi_i + wo is five
    // times as much of it.
    assert!(worst < 1e-4, "{worst}");
}
