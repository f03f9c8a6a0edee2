//! The smooth dielectric fiber against the simulator's ray tables of a circle, all orders, clear and dyed: the same fiber by paths through a traced section.

use plywave::fiber::{DielectricFiber, DielectricParameters};
use plywave::spec::{FiberSpec, Shape, YarnSpec};
use plywave_sim::Run;
use plywave_sim::wave::{Absorption, SingleFiber, TabulateOptions, tabulate_rays};
use std::f64::consts::TAU;

#[test]
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
                // Five standard errors of a bin's count, whose weights are at most 1; a caustic by midpoints; where orders beyond lie; the tracer's offsets.
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
