//! The smooth dielectric fiber agrees with the simulator's ray tables of a circle, all orders, clear and
//! dyed: the same fiber by paths through a traced section.

use plywave::Bsdf;
use plywave::frame::direction;
use plywave::spec::{FiberSpec, Shape, YarnSpec};
use plywave_fiber::FiberQuery;
use plywave_fiber::{DielectricFiber, DielectricParameters, RoughDielectricFiber, RoughDielectricParameters};
use plywave_runs::Run;
use plywave_wave::{Absorption, SingleFiber, TabulateOptions, tabulate_rays};
use std::f64::consts::TAU;

#[test]
#[ignore = "slow: 10 s: ray tables of a circle are the closed forms"]
fn ray_tables_of_a_circle_are_the_closed_forms() {
    let (radius_um, eta) = (8.0, 1.55);
    for sigma in [0.0, 0.05] {
        let shape = Shape::Circle { radius_um };
        let spec = FiberSpec { shape, eta, alpha_fiber: 0.0, ..YarnSpec::polyester().unwrap().fiber };
        let fiber = SingleFiber::of_spec(&spec, Absorption::Sigma(sigma));
        let options =
            TabulateOptions { lambdas: 1, thetas: 5, relative: 180, rays: 300_000, ..TabulateOptions::preview() };
        let table = tabulate_rays(&fiber, "spec", &options, Run::plain()).unwrap();
        let bins = table.phi_r_count();
        let model =
            DielectricParameters { eta: eta as f32, radius_um: radius_um as f32, orders: 8, ..Default::default() };
        let model = DielectricFiber::new(model).unwrap();
        for (t, theta) in table.theta_i.iter().enumerate() {
            let section = model.cross_section(theta.sin() as f32);
            let slice = &table.azimuthal[t * bins..][..bins];
            // Orders from 8 on, which the model spreads evenly: at grazing latitudes they are a percent.
            let gammas = (0..2000).map(|k| (f64::from(k) + 0.5) / 2000.0 * std::f64::consts::FRAC_PI_2);
            let beyond: f64 = gammas
                .map(|g| f64::from(section.path(g.sin() as f32).from_order(8, sigma as f32)) * g.cos() * TAU / 8000.0)
                .sum();
            let (mut worst, mut energy) = (0.0f64, 0.0);
            for (j, got) in slice.iter().enumerate() {
                let fine = 2000;
                let mut want = 0.0;
                for k in 0..fine {
                    let phi = (j as f64 - 0.5 + (f64::from(k) + 0.5) / f64::from(fine)) * TAU / bins as f64;
                    for order in 0..8 {
                        section.roots(order, phi as f32, |h, density| {
                            want += f64::from(density * section.path(h).attenuation(order, sigma as f32));
                        });
                    }
                }
                let cell = TAU / bins as f64;
                let (got, want) = (f64::from(*got) * cell, want / f64::from(fine) * cell + beyond / bins as f64);
                energy += want;
                // Five standard errors of a bin's count, whose weights are at most 1; a caustic by midpoints;
                // where orders beyond lie; the tracer's offsets.
                let tolerance = 5.0 * (want / 300_000.0).sqrt() + 0.01 * want + 5e-5;
                worst = worst.max((got - want).abs() / tolerance);
                let what = format!("sigma {sigma}, theta {theta}, bin {j}");
                assert!((got - want).abs() < tolerance, "{what}: rays {got}, closed form {want}");
            }
            let rays = table.slice_albedo(t);
            assert!((energy - rays).abs() < 2e-3, "sigma {sigma}, theta {theta}: rays {rays}, closed form {energy}");
            println!(
                "sigma {sigma}, theta {theta:.3}: worst bin at {worst:.2} of its tolerance, energies {rays:.4} {energy:.4}"
            );
        }
    }
}

/// An elliptical section by rays beside the first-order model (Zinke 2007, 8.2): where TRT is brightest, by
/// the azimuth of the light about the section, both blurred alike. The model turns the index of TRT alone; a
/// circle of the same index stays where it is.
#[test]
#[ignore = "slow: 5 s: oval sections move trt as rays say"]
fn oval_sections_move_trt_as_rays_say() {
    let (radius_um, eta, width) = (8.0f64, 1.55, 0.06f64);
    for (e, bound) in [(0.95, 5.0), (0.9, 6.5)] {
        let shape = Shape::Ellipse { a_um: radius_um * f64::sqrt(e), b_um: radius_um / f64::sqrt(e) };
        let spec = FiberSpec { shape, eta, alpha_fiber: 0.0, ..YarnSpec::polyester().unwrap().fiber };
        let fiber = SingleFiber::of_spec(&spec, Absorption::Sigma(0.0));
        let options = TabulateOptions {
            lambdas: 1,
            thetas: 15,
            azimuths: 5,
            relative: 360,
            rays: 60_000,
            ..TabulateOptions::preview()
        };
        let table = tabulate_rays(&fiber, "spec", &options, Run::plain()).unwrap();
        let (last, bins) = (table.phi_i.len() - 1, table.phi_r_count());
        // From one axis to the other.
        assert!(
            last > 0 && table.phi_i[0] == 0.0 && (table.phi_i[last] - 0.25 * TAU).abs() < 1e-9,
            "{:?}",
            table.phi_i
        );
        let azimuth = |j: i32| f64::from(j) * TAU / bins as f64;
        let parameters = RoughDielectricParameters {
            eta: eta as f32,
            radius_um: radius_um as f32,
            eccentricity: e as f32,
            shift: [0.0; 3],
            width_phi: [width as f32; 3],
            ..Default::default()
        };
        let oval = RoughDielectricFiber::new(parameters).unwrap();
        let bin = |j: i32| j.rem_euclid(bins as i32) as usize;
        // TRT's brightest azimuth on either side of where the light comes from, on the half that R alone
        // shares.
        let brightest = |f: &dyn Fn(i32) -> f64| {
            let side = |sign: i32| (0..bins as i32 / 5).max_by(|a, b| f(sign * a).total_cmp(&f(sign * b))).unwrap_or(0);
            [side(1), side(-1)].map(|j| azimuth(j).to_degrees())
        };
        let (mut off, mut by_rays) = (0.0f64, Vec::new());
        for (p, phi_i) in table.phi_i.iter().enumerate() {
            // The first latitude, 3 degrees.
            let slice = &table.azimuthal[p * bins..][..bins];
            let kernel = |d: i32| (-0.5 * (azimuth(d) / width).powi(2)).exp();
            let rays = |j: i32| (-20..=20).map(|d| kernel(d) * f64::from(slice[bin(j + d)])).sum::<f64>();
            let theta = table.theta_i[0] as f32;
            let at = oval.at(&FiberQuery::new(direction(theta, *phi_i as f32), [0.5]));
            let model = |j: i32| f64::from(at.eval(direction(-theta, (phi_i + azimuth(j)) as f32))[0]);
            let (a, b) = (brightest(&rays), brightest(&model));
            println!("e {e}, light at {:.0} degrees: rays {a:.1?}, model {b:.1?}", phi_i.to_degrees());
            for k in 0..2 {
                off = off.max((a[k] - b[k]).abs());
            }
            by_rays.push(a[0]);
        }
        assert!(off < bound, "e {e}: off by {off} degrees");
        // They move: from light along one axis to along the other by more than the error.
        assert!((by_rays[0] - by_rays[last]).abs() > 8.0, "e {e}: {by_rays:?}");
    }
}
