//! What `examples/ply.c` prints, by the Rust library itself: `capi/run_examples.sh` compares the two, digit
//! by digit.
//!
//! ```sh
//! cargo run --release -p plywave-capi --example reference -- [MODEL.pwm]
//! ```

use plywave::{Bsdf, BsdfSample, PlyModel, PlyQuery};
use plywave_check::{CheckOptions, check_model};
use rand::{RngExt, SeedableRng};

/// As C prints `%.8e`.
fn e(value: f64) -> String {
    let text = format!("{value:.8e}");
    let (digits, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    format!("{digits}e{}{:02}", if exponent < 0 { '-' } else { '+' }, exponent.abs())
}

fn print(name: &str, values: &[f32]) {
    let values: Vec<String> = values.iter().map(|v| e(f64::from(*v))).collect();
    println!("{name} {}", values.join(" "));
}

fn u(i: u32) -> [f32; 3] {
    [0.819172513396164, 0.671043606703789, 0.549700477901970].map(|step| ((0.5 + f64::from(i) * step) % 1.0) as f32)
}

fn main() -> plywave::Result<()> {
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/../fabrics/models/polyester.pwm");
    let path = std::env::args().nth(1).unwrap_or_else(|| shipped.into());
    let model = PlyModel::load(&path)?;
    let spec = plywave::spec::YarnSpec::parse(&model.data().spec_text, "spec")?;
    let [a, b] = spec.ply_radii_um();
    let (edge, layers) = (u8::from(model.has_edge()), u8::from(model.data().layers.is_some()));
    println!("radius {:.2} um, edge lobes {edge}, layer factors {layers}", a.max(b));

    let ply = model.at(&PlyQuery::new(0.5, 10.0, [0.001, 0.004, 0.010], plywave::color::RGB_LAMBDA_UM));
    let directions = [[0.0, 1.0, 0.0], [0.0, -0.8, -0.6], [0.6, 0.8, 0.0], [0.48, -0.64, 0.6]];
    for w in directions {
        let (f, pdf) = ply.eval_pdf(w);
        print("eval", &[f[0], f[1], f[2], pdf]);
    }
    let (mut f, mut pdf) = ([[0.0; 3]; 4], [0.0; 4]);
    ply.eval_batch(&directions, &mut f, &mut pdf);
    print("batch", f.as_flattened());
    for i in 0..4 {
        let (w, weight) = match ply.sample(u(i)) {
            BsdfSample::Scattered(s) => (s.w, s.weight),
            BsdfSample::Straight { weight, .. } => ([0.0; 3], weight),
            BsdfSample::Absorbed => ([0.0; 3], [0.0; 3]),
        };
        print("sample", &w);
        print("weight", &weight);
    }
    print("albedo", &ply.albedo());

    let clear = model.at(&PlyQuery::new(0.5, 10.0, [0.0], [0.55]));
    print("furnace", &clear.albedo());
    let samples = 20_000;
    let weight = |i| match clear.sample(u(i)) {
        BsdfSample::Scattered(s) => s.weight[0],
        BsdfSample::Straight { weight, .. } => weight[0],
        BsdfSample::Absorbed => 0.0,
    };
    let sum: f64 = (0..samples).map(|i| f64::from(weight(i))).sum();
    println!("sampled furnace {}", e(sum / f64::from(samples)));

    let options = CheckOptions { incidences: 3, samples: 2000, ..CheckOptions::default() };
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(1);
    let report = check_model(&model, &options, &mut || rng.random());
    let [furnace, weight, p] = [report.furnace_error(), report.weight_error(), report.chi2_p()].map(e);
    println!("check: furnace {furnace}, weight {weight}, chi-square p {p}, passed 1");

    println!("PLYWAVE_STATUS_INVALID_ARGUMENT: w = [NaN, 0.0, 1.0]: expected a unit vector");
    let missing = PlyModel::load("no such model.pwm").map(|_| ());
    println!("PLYWAVE_STATUS_IO: {}", missing.err().map_or_else(String::new, |error| error.to_string()));
    Ok(())
}
