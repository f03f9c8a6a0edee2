//! Signs of trends, and layers.

use super::{Outcome, SIGMAS, fibers, light, traced};
use plywave::cloth::{ClothCurves, ClothYarn, PlyCurve};
use plywave_sim::twin::{TwinCurves, direction};
use rayon::prelude::*;

/// Paths of a view of a trend.
const PATHS: u64 = 6_000;

fn woven(kind: &str, sett: f64, yarn: &str) -> String {
    format!(
        "name = \"c\"\n[weave]\nkind = \"{kind}\"\nends_per_cm = {sett}\npicks_per_cm = {sett}\n[warp]\n{yarn}\n[weft]\nas = \"warp\"\n"
    )
}

const COTTON: &str = "fiber = \"cotton\"\ncount = \"Ne 40\"\nbundles = 1";
const POLYESTER: &str = "fiber = \"polyester\"\ncount = \"150/48 den\"\nbundles = 1";

/// R and T of a cloth from a tilt, with the standard error of T.
fn seen(made: &TwinCurves, tilt_deg: f64, sigma: f64) -> Outcome<[f64; 3]> {
    // Off the axes of the yarns.
    let views = [20.0f64, 65.0].map(|a| direction(tilt_deg.to_radians(), a.to_radians())).to_vec();
    let twin = traced(made, views, &[sigma], PATHS)?;
    let [a, b] = [0, 1].map(|view| light(&twin, view, 0));
    Ok([0.5 * (a.r + b.r), 0.5 * (a.t + b.t), a.se / 2f64.sqrt()])
}

/// R and T of diffuse light: the mean over the flux.
fn diffuse(made: &TwinCurves, sigma: f64) -> Outcome<[f64; 2]> {
    let views: Vec<_> =
        (0..8).map(|k| direction((((k / 2) as f64 + 0.5) / 4.0).sqrt().acos(), 0.3 + 1.1 * k as f64)).collect();
    let twin = traced(made, views, &[sigma], PATHS / 4)?;
    Ok([0, 1].map(|which| (0..8).map(|v| light(&twin, v, 0)).map(|l| [l.r, l.t][which] / 8.0).sum()))
}

/// R and T of one layer before another, of diffuse light between them (Stokes 1862).
fn over([r1, t1]: [f64; 2], [r2, t2]: [f64; 2]) -> [f64; 2] {
    let between = 1.0 / (1.0 - r1 * r2);
    [r1 + t1 * t1 * r2 * between, t1 * t2 * between]
}

fn sign(what: &str, is: bool) {
    println!("  {}: {what}", if is { "as measured" } else { "AGAINST" });
}

/// Prints the trends.
pub(super) fn trends() -> Outcome<()> {
    println!("grazing reflectance, R at 75 degrees over 5 (measured 1.04 to 2.8, darker cloths more):");
    let cotton = fibers(&woven("plain", 36.0, COTTON))?;
    let ratios = [("light", SIGMAS[1]), ("medium", 4e-3), ("dark", 0.05)].map(|(name, sigma)| -> Outcome<f64> {
        let [near, far] = [seen(&cotton, 5.0, sigma)?, seen(&cotton, 75.0, sigma)?];
        println!("  {name}, sigma {sigma}: {:.3} to {:.3}, ratio {:.2}", near[0], far[0], far[0] / near[0]);
        Ok(far[0] / near[0])
    });
    let [light_ratio, medium, dark] = ratios;
    let [light_ratio, medium, dark] = [light_ratio?, medium?, dark?];
    sign("darker cloths rise more", light_ratio < medium && medium < dark);
    sign("by 1.04 to 2.8", [light_ratio, medium, dark].iter().all(|r| (1.04..=2.8).contains(r)));

    println!("oblique transmittance, normal and 60 degrees (dense less, open more; Yates 1989):");
    // Coated yarns nearly as close as they can be woven.
    let dense = fibers(&woven("plain", 18.0, "fiber = \"pvc coated\"\ncount = \"1200 den\""))?;
    let [a, b] = [seen(&dense, 0.0, 0.01)?, seen(&dense, 60.0, 0.01)?];
    println!("  dense, pvc coated: {:.4} to {:.4} (s.e. {:.4})", a[1], b[1], a[2]);
    sign("dense woven shade passes less", b[1] < a[1]);

    println!("weaves at one sett, T at the normal (satin least of three cottons; Dubrovski 2023):");
    let mut all = Vec::new();
    for kind in ["plain", "twill 2/2", "satin 5/2"] {
        let [r, t, se] = seen(&fibers(&woven(kind, 34.0, COTTON))?, 0.0, SIGMAS[1])?;
        println!("  {kind}: R {r:.4}, T {t:.4} (s.e. {se:.4})");
        all.push([r, t]);
    }
    sign("satin has the lowest T", all[2][1] < all[0][1].min(all[1][1]));

    println!("layers of polyester, R of 1, 2, 4, 8, 16 layers, R rises to 16, satin above plain (Akgun 2014):");
    let mut rows = Vec::new();
    for kind in ["plain", "satin 5/2"] {
        let one = diffuse(&fibers(&woven(kind, 36.0, POLYESTER))?, SIGMAS[1])?;
        let mut stack = one;
        let mut row = vec![one[0]];
        for _ in 0..4 {
            stack = over(stack, stack);
            row.push(stack[0]);
        }
        println!("  {kind}: {}", row.iter().map(|r| format!("{r:.3}")).collect::<Vec<_>>().join(" "));
        rows.push(row);
    }
    sign("R rises to 16 layers", rows.iter().all(|row| row.windows(2).all(|w| w[1] > w[0])));
    sign("satin above plain", rows[1][0] > rows[0][0]);
    sign("differences vanish", (rows[1][4] - rows[0][4]).abs() < 0.5 * (rows[1][0] - rows[0][0]).abs());
    Ok(())
}

/// Prints layers beside measured ones and beside the twin of two cloths.
pub(super) fn layers() -> Outcome<()> {
    println!("diffuse R and T of two layers, added beside measured:");
    for (name, a, b, measured) in [
        ("white nonwoven", [0.544, 0.447], [0.544, 0.447], [0.712, 0.269]),
        ("inner and outer", [0.461, 0.480], [0.494, 0.453], [0.657, 0.309]),
    ] {
        let [r, t] = over(a, b);
        println!("  {name}: R {r:.3} beside {:.3}, T {t:.3} beside {:.3}", measured[0], measured[1]);
    }
    let one = fibers(&woven("plain", 30.0, COTTON))?;
    let two = doubled(&one)?;
    for sigma in [0.0, 4e-3] {
        let [r, t] = diffuse(&one, sigma)?;
        let [rr, tt] = over([r, t], [r, t]);
        let [r2, t2] = diffuse(&two, sigma)?;
        println!("  plain cotton, sigma {sigma}: one {r:.3} {t:.3}; two added {rr:.3} {tt:.3}, traced {r2:.3} {t2:.3}");
    }
    Ok(())
}

/// Prints what absorption a thick pile of undyed cloth has for its K/S (Kubelka and Munk 1931), by cloths of
/// three fibers.
pub(super) fn thick() -> Outcome<()> {
    println!("absorption [1/um] over K/S of a thick pile:");
    for yarn in [
        COTTON,
        "fiber = \"wool\"\ncount = \"Nm 60\"\nbundles = 1",
        "fiber = \"silk\"\ncount = \"60/40 den\"\nbundles = 1",
    ] {
        let sett = if yarn.contains("silk") { 60.0 } else { 26.0 };
        let made = fibers(&woven("plain", sett, yarn))?;
        for sigma in [1e-4, 1e-3, 4e-3] {
            let [r, t] = diffuse(&made, sigma)?;
            let a = (1.0 + r * r - t * t) / (2.0 * r);
            let pile = a - (a * a - 1.0).sqrt();
            let over = (1.0 - pile).powi(2) / (2.0 * pile);
            let name = yarn.split('"').nth(1).unwrap_or_default();
            println!(
                "  {name}, sigma {sigma}: a layer {r:.4} {t:.4}, a pile {pile:.4}, sigma / (K/S) {:.4}",
                sigma / over
            );
        }
    }
    Ok(())
}

/// The cloth and another of it below, half a cell aside.
fn doubled(one: &TwinCurves) -> Outcome<TwinCurves> {
    let ClothCurves { cell_um, yarns, curves } = one.curves.clone();
    let heights: Vec<f64> = curves
        .iter()
        .flat_map(|c| c.control_um.iter().flat_map(|p| [p[2] - c.radius_um, p[2] + c.radius_um]))
        .collect();
    let thick = heights.par_iter().copied().reduce(|| f64::MIN, f64::max)
        - heights.par_iter().copied().reduce(|| f64::MAX, f64::min);
    let count = yarns.len() as u32;
    let aside = [0, 1].map(|k| 0.25 * (cell_um[0][k] + cell_um[1][k]));
    let below: Vec<PlyCurve> = curves
        .iter()
        .map(|c| PlyCurve {
            yarn: c.yarn + count,
            control_um: c.control_um.iter().map(|p| [p[0] + aside[0], p[1] + aside[1], p[2] - 1.01 * thick]).collect(),
            ..c.clone()
        })
        .collect();
    let more: Vec<ClothYarn> = yarns.clone();
    let curves = ClothCurves { cell_um, yarns: [yarns, more].concat(), curves: [curves, below].concat() };
    let texts = one.yarns.iter().map(|yarn| yarn.to_text("cloth")).collect::<Result<Vec<_>, _>>()?;
    Ok(TwinCurves::new("two", curves, texts)?)
}
