//! The figures and claims of Zinke and Weber 2007 in numbers:
//! `cargo run --release -p plywave-studies --bin filaments [FOLDER]`; with a folder, curves as CSV too.
//! docs/explain/filaments.md has the results.

use plywave::Bsdf;
use plywave::frame::direction;
use plywave::optics::Metal;
use plywave_fiber::opaque::{lambertian, lambertian_by_zinke};
use plywave_fiber::{FiberModel, FiberQuery};
use plywave_fiber::{
    KajiyaKayFiber, KajiyaKayParameters, Mirror, OpaqueFiber, OpaqueParameters, RoughDielectricFiber,
    RoughDielectricParameters,
};
use std::f32::consts::PI;
use std::hint::black_box;
use std::path::PathBuf;
use std::time::Instant;

const LAMBDA_UM: [f32; 3] = [0.61, 0.55, 0.465];
/// Offsets of a mean over the width.
const OFFSETS: usize = 512;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

fn rough(p: RoughDielectricParameters) -> Result<FiberModel> {
    Ok(RoughDielectricFiber::new(p)?.into())
}

fn opaque(mirror: Mirror, diffuse: f32) -> Result<FiberModel> {
    Ok(OpaqueFiber::new(OpaqueParameters { mirror, diffuse, beta_m: 0.1, beta_n: 0.1, ..Default::default() })?.into())
}

/// Offsets evenly over the width.
fn offsets() -> impl Iterator<Item = f32> {
    (0..OFFSETS).map(|k| (2 * k + 1) as f32 / OFFSETS as f32 - 1.0)
}

/// Least time of a call over many runs [ns].
fn time(mut run: impl FnMut(usize)) -> f64 {
    let calls = 512;
    let mut least = f64::INFINITY;
    for _ in 0..200 {
        let start = Instant::now();
        (0..calls).for_each(&mut run);
        least = least.min(start.elapsed().as_secs_f64() / calls as f64 * 1e9);
    }
    least
}

fn main() -> Result<()> {
    let folder = std::env::args().nth(1).map(PathBuf::from);
    let write = |name: &str, text: String| -> Result<()> {
        if let Some(folder) = &folder {
            std::fs::create_dir_all(folder)?;
            std::fs::write(folder.join(name), text)?;
        }
        Ok(())
    };
    let hair = RoughDielectricParameters::default();
    let near = rough(hair)?;
    let brown = [0.004, 0.009, 0.018];

    // Figure 8: light that leaves a ribbon, by the offset of entry.
    let mut csv = String::from("h,phi_deg,red,green,blue\n");
    for h in offsets().step_by(8) {
        let query =
            FiberQuery { h_rel: Some(h), sigma_per_um: brown, ..FiberQuery::new(direction(0.2, 0.0), LAMBDA_UM) };
        let at = near.at(&query);
        for k in -90..90 {
            let [r, g, b] = at.eval(direction(-0.2, 2.0 * k as f32 * PI / 180.0));
            csv += &format!("{h},{},{r},{g},{b}\n", 2 * k);
        }
    }
    write("figure_8.csv", csv)?;

    // Figures 9 and 13: three hairs, the light that each keeps.
    println!("figures 9 and 13: albedo of a hair of 80 um across, light at 10 degrees, far field");
    for (name, sigma_per_um) in
        [("brown", brown), ("blond", [0.0006, 0.0012, 0.003]), ("dark red", [0.003, 0.02, 0.03])]
    {
        let query = FiberQuery { sigma_per_um, ..FiberQuery::new(direction(0.17, 0.0), LAMBDA_UM) };
        let [r, g, b] = near.at(&query).albedo();
        println!("  {name:<9} {r:.3} {g:.3} {b:.3}");
    }

    // Figure 10 and 11: pictures with the far field are those with the near field, from fewer eye rays.
    println!("figures 10 and 11: far field beside the mean of the near field; eye rays for the same noise");
    println!("  a pixel half covered by the fiber; relative variance of one eye ray, near over far field");
    let kajiya = |phong: f32, diffuse: f32| -> Result<FiberModel> {
        Ok(KajiyaKayFiber::new(KajiyaKayParameters { phong, exponent: 50.0, diffuse, ..Default::default() })?.into())
    };
    let materials = [
        ("Lambert", opaque(Mirror::None, 0.6)?, Some(0.0)),
        ("plastic", opaque(Mirror::Dielectric(1.5), 0.6)?, Some(0.5)),
        ("aluminium", opaque(Mirror::Metal(Metal::Aluminium), 0.0)?, Some(1.0)),
        ("gold", opaque(Mirror::Metal(Metal::Gold), 0.0)?, Some(1.0)),
        ("hair", near.clone(), None),
    ];
    let mut csv = String::from("material,phi_deg,far_green,kajiya_kay\n");
    for (name, model, share) in &materials {
        let (mut worst, mut difference, mut energy) = (0.0f64, 0.0, 0.0);
        let (mut ratios, mut kk_off, mut kk_sum) = (Vec::new(), 0.0, 0.0);
        let base = FiberQuery { sigma_per_um: brown, ..FiberQuery::new(direction(0.3, 0.0), LAMBDA_UM) };
        let far = model.at(&base);
        // The phenomenological model of the same energy: all in its highlight, all diffuse, or half and half.
        let matched = match share {
            Some(share) => {
                let unit = kajiya(0.1, 0.0)?.at(&base).albedo()[1] / 0.1;
                let albedo = far.albedo()[1];
                Some(kajiya((share * albedo / unit).min(10.0), ((1.0 - share) * albedo / (PI * PI)).min(0.1))?)
            }
            None => None,
        };
        for k in 0..90 {
            let phi = (4 * k) as f32 * PI / 180.0 - PI;
            let w = direction(-0.25, phi);
            let f = f64::from(far.eval(w)[1]);
            let values: Vec<f64> =
                offsets().map(|h| f64::from(model.at(&FiberQuery { h_rel: Some(h), ..base }).eval(w)[1])).collect();
            let mean = values.iter().sum::<f64>() / OFFSETS as f64;
            let square = values.iter().map(|v| v * v).sum::<f64>() / OFFSETS as f64;
            difference += (f - mean).abs();
            energy += mean;
            worst = worst.max((f - mean).abs());
            if mean > 1e-3 {
                // Hits are half of the rays: variances over the mean's square, (<f^2>/c - c^0 <f>^2)/<f>^2
                // with c = 1/2.
                ratios.push(2.0 * square / (mean * mean) - 1.0);
            }
            if let Some(kk) = &matched {
                let kk = f64::from(kk.at(&base).eval(w)[1]);
                kk_off += (kk - f).abs();
                kk_sum += f;
                csv += &format!("{name},{},{f},{kk}\n", 4 * k - 180);
            }
        }
        ratios.sort_by(f64::total_cmp);
        let median = ratios[ratios.len() / 2];
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        print!(
            "  {name:<10} far - near {:.2} % of the light; eye rays x {median:.1} (median of azimuths), {mean:.1} (mean), {:.1} to {:.1}",
            100.0 * difference / energy,
            ratios[0],
            ratios[ratios.len() - 1]
        );
        if kk_sum > 0.0 {
            print!("; Kajiya-Kay off by {:.0} %", 100.0 * kk_off / kk_sum);
        }
        println!();
    }
    write("figure_11.csv", csv)?;
    let mut csv = String::from("phi_deg,exact,polynomial\n");
    let mut least = (0.0f32, 0);
    for degrees in 0..=180 {
        let phi = (degrees as f32).to_radians();
        let (exact, printed) = (lambertian(1.0, phi), lambertian_by_zinke(1.0, phi));
        csv += &format!("{degrees},{exact},{printed}\n");
        if degrees <= 170 && (printed / exact - 1.0).abs() > least.0.abs() {
            least = (printed / exact - 1.0, degrees);
        }
    }
    write("equation_51.csv", csv)?;
    println!(
        "equation 51: off by {:.1} % at 0 degrees, {:.0} % at {} degrees; the paper says less than 5 %",
        100.0 * (lambertian_by_zinke(1.0, 0.0) / lambertian(1.0, 0.0) - 1.0),
        100.0 * least.0,
        least.1
    );

    // Section 9.2: the near field against Marschner's far field, a call each: query and eval.
    let marschner = rough(RoughDielectricParameters::marschner(1.55, 40.0, hair.shift, hair.width_theta))?;
    let query = |k: usize, h_rel: Option<f32>| {
        let x = k as f32 / 512.0;
        let light = direction(1.2 * (7.0 * x).sin(), 40.0 * x);
        let toward = direction(-1.2 * (7.0 * x).sin() + 0.1 * (31.0 * x).cos(), 23.0 * x);
        (FiberQuery { h_rel, sigma_per_um: brown, ..FiberQuery::new(light, LAMBDA_UM) }, toward)
    };
    let of = |model: &FiberModel, k: usize, h: Option<f32>| {
        let (query, w) = query(k, h);
        black_box(model.at(&query).eval(w));
    };
    let h = |k: usize| Some(1.98 * (k as f32 / 512.0) - 0.99);
    let near_ns = time(|k| of(&near, k, h(k)));
    let exact_ns = time(|k| of(&marschner, k, None));
    let table_ns = time(|k| of(&near, k, None));
    println!(
        "section 9.2: near field {near_ns:.0} ns, Marschner's far field by roots {exact_ns:.0} ns: {:.2} times as fast (paper: more than 2)",
        exact_ns / near_ns
    );
    println!("  far field by table {table_ns:.0} ns: {:.2} times as fast as by roots", exact_ns / table_ns);

    // Figure 14: an oval of rough plastic; positions of the caustics of TRT as it turns.
    println!("figure 14: an oval of e = 0.85: TRT's brightest azimuth by the oval's turn, of a circle beside it");
    let wide = RoughDielectricParameters { eta: 1.49, width_phi: [0.06; 3], ..hair };
    let oval = rough(RoughDielectricParameters { eccentricity: 0.85, ..wide })?;
    let circle = rough(wide)?;
    let mut csv = String::from("turn_deg,phi_deg,oval,circle\n");
    for turn in [0, 30, 60, 90] {
        let phi_i = (turn as f32).to_radians();
        let query = FiberQuery::new(direction(0.0, phi_i), LAMBDA_UM);
        let (a, b) = (oval.at(&query), circle.at(&query));
        // Behind TRT's own latitude R and TT are weak: shifts apart.
        let brightest =
            |at: &dyn Fn(f32) -> f32| (0..70).map(|k| k as f32).max_by(|p, q| at(*p).total_cmp(&at(*q))).unwrap_or(0.0);
        let f = |at: &plywave_fiber::FiberBsdf<'_, 3>, degrees: f32| {
            at.eval(direction(0.25, phi_i + degrees.to_radians()))[1]
        };
        println!(
            "  turned by {turn:>2} degrees: {:>2.0} degrees, circle {:>2.0}",
            brightest(&|d| f(&a, d)),
            brightest(&|d| f(&b, d))
        );
        for d in -90..90 {
            csv += &format!("{turn},{},{},{}\n", 2 * d, f(&a, 2.0 * d as f32), f(&b, 2.0 * d as f32));
        }
    }
    write("figure_14.csv", csv)?;
    Ok(())
}
