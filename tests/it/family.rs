//! Families of plies: whole models and single incidences agree, energies are exact, slopes match differences,
//! files are refused in one line.
//!
//! The nodes are planted: the shipped polyester, with lobes and energies that change smoothly with the
//! parameters.

use plywave::Document;
use plywave::math::hash::SplitMix64;
use plywave::ply::asg::PARAMS;
use plywave::ply::{FamilyAxis, FamilyData, FamilyParam, FamilyParams, PlyData, PlyFamily};
use plywave::spec::POLYESTER;
use plywave::{Bsdf, BsdfSample, PlyModel, PlyQuery};
use std::sync::OnceLock;

fn spec() -> String {
    format!("{POLYESTER}\n[family]\nfiber_pitch_um = [300.0, 4000.0]\nalpha_fiber = [0.1, 0.4]\n")
}

/// A node at coordinates x, y from -1 to 1.
fn node(base: &PlyData, x: f64, y: f64) -> PlyData {
    let mut d = base.clone();
    d.noise = None;
    for (i, p) in d.high.chunks_exact_mut(PARAMS).enumerate() {
        let l = (i % base.lobes_high) as f64;
        p[0] += 0.1 * x * (l - 3.0) / 4.0;
        p[1] += 0.2 * x;
        p[2] += 0.15 * (x + y);
        p[3] = (p[3] - 0.3 * y).clamp(-1.5, 9.0);
        p[4] = (p[4] - 0.2 * y).clamp(-1.5, 9.0);
        p[5] *= 1.0 - 0.2 * y * (l - 3.5) / 4.0;
    }
    for p in d.refl.chunks_exact_mut(PARAMS) {
        p[0] += 0.05 * x;
        p[2] -= 0.1 * y;
        p[4] = (p[4] - 0.3 * y).clamp(-1.5, 9.0);
    }
    let j = d.path_um.len();
    for (refl, high) in d.energies.share_refl.iter_mut().zip(d.energies.share_high.chunks_exact_mut(j)) {
        let all = *refl + high.iter().sum::<f64>();
        let more = *refl * (1.0 + 0.1 * y);
        let gain = (all - more) / (all - *refl);
        *refl = more;
        high.iter_mut().for_each(|v| *v *= gain);
    }
    d.energies.miss.iter_mut().for_each(|v| *v = (*v * (1.0 - 0.05 * x)).clamp(0.0, 1.0));
    d.layers = None;
    let round = |values: &mut Vec<f64>| values.iter_mut().for_each(|v| *v = f64::from(*v as f32));
    [
        &mut d.high,
        &mut d.refl,
        &mut d.high_path,
        &mut d.energies.miss,
        &mut d.energies.share_refl,
        &mut d.energies.share_high,
    ]
    .into_iter()
    .for_each(round);
    d
}

fn planted() -> &'static PlyFamily {
    static FAMILY: OnceLock<PlyFamily> = OnceLock::new();
    FAMILY.get_or_init(|| {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/models/polyester.pwm");
        let base = PlyData::load(path).unwrap();
        let nodes = [-1.0, 0.2, 1.0].into_iter().flat_map(|x| [-1.0, 1.0].map(|y| node(&base, x, y))).collect();
        let axes = vec![
            FamilyAxis { param: FamilyParam::FiberPitch, values: vec![300.0, 900.0, 4000.0] },
            FamilyAxis { param: FamilyParam::Alpha, values: vec![0.1, 0.4] },
        ];
        let (program_version, preset) = (base.program_version.clone(), base.preset.clone());
        let data = FamilyData { spec_text: spec(), program_version, preset, seed: base.seed, axes, nodes };
        PlyFamily::from_data(data).unwrap()
    })
}

/// Random parameters and query, away from the rims, and a direction.
fn random(rng: &mut SplitMix64) -> (FamilyParams, f32, f32, [f32; 3]) {
    let f = planted();
    let pitch = 300.0 * (4000.0f64 / 300.0).powf(0.02 + 0.96 * rng.next_f64());
    let params = FamilyParams { fiber_pitch_um: pitch, alpha_fiber: 0.11 + 0.28 * rng.next_f64(), ..f.params() };
    let theta_i = (2.4 * rng.next_f64() - 1.2) as f32;
    let h_um = (110.0 * rng.next_f64() - 55.0) as f32;
    let (z, phi) = (2.0 * rng.next_f64() - 1.0, std::f64::consts::TAU * rng.next_f64());
    let r = (1.0 - z * z).sqrt();
    (params, theta_i, h_um, [(r * phi.cos()) as f32, (r * phi.sin()) as f32, z as f32])
}

#[test]
fn files_come_back_bit_for_bit() {
    let bytes = planted().data().to_bytes().unwrap();
    let back = PlyFamily::from_bytes(&bytes, "planted").unwrap();
    // Errors are rounded when they are first written; a loaded file is written to the same bytes.
    let again = back.data().to_bytes().unwrap();
    let third = PlyFamily::from_bytes(&again, "planted").unwrap().data().to_bytes().unwrap();
    assert!(again == third, "a loaded family is written to other bytes");
    assert_eq!(back.data().axes, planted().data().axes);
    for (a, b) in back.data().nodes.iter().zip(&planted().data().nodes) {
        assert!(a.high == b.high && a.refl == b.refl && a.energies == b.energies, "lobes or energies changed");
    }
    println!("{} bytes for 6 nodes", bytes.len());
}

#[test]
fn a_whole_model_and_one_incidence_agree() {
    let f = planted();
    let mut rng = SplitMix64(1);
    for _ in 0..40 {
        let (params, theta_i, h_um, w) = random(&mut rng);
        let model = f.at(&params).unwrap();
        let query = PlyQuery::new(theta_i, h_um, [0.0, 0.004, 0.05], [0.61, 0.55, 0.46]);
        let (whole, one) = (model.at(&query), f.on(&params, &query));
        let peak = 0.01 + whole.eval(w).iter().fold(0.0f32, |a, b| a.max(*b));
        for (a, b) in whole.eval(w).iter().zip(one.eval(w)) {
            assert!((a - b).abs() < 2e-3 * peak, "{params:?} {theta_i} {h_um}: model {a}, incidence {b}");
        }
        assert!((whole.pdf(w) - one.pdf(w)).abs() < 2e-3 * (0.01 + whole.pdf(w)), "{} {}", whole.pdf(w), one.pdf(w));
        for (a, b) in whole.albedo().iter().zip(one.albedo()) {
            assert!((a - b).abs() < 1e-4, "albedo {a} {b}");
        }
    }
}

#[test]
fn a_node_is_its_own_model() {
    let f = planted();
    for (i, want) in f.data().nodes.iter().enumerate() {
        let params = f.data().params_of(i, &f.spec_at(&f.params()));
        let got = f.data_at(&params).unwrap();
        let close = |a: &[f64], b: &[f64], tolerance: f64| {
            a.iter().zip(b).for_each(|(a, b)| assert!((a - b).abs() <= tolerance, "node {i}: {a} {b}"));
        };
        close(&got.high, &want.high, 1e-12);
        close(&got.refl, &want.refl, 1e-12);
        close(&got.energies.share_high, &want.energies.share_high, 1e-12);
        close(&got.energies.miss, &want.energies.miss, 1e-9);
        assert!(got.spec_text.contains("alpha_fiber") && !got.spec_text.contains("family"));
    }
}

#[test]
fn energies_are_the_interpolated_ones() {
    let f = planted();
    let mut rng = SplitMix64(5);
    for _ in 0..20 {
        let (params, theta_i, h_um, _) = random(&mut rng);
        let data = f.data_at(&params).unwrap();
        let want = data.energies.at(f64::from(theta_i), f64::from(h_um));
        let ply = f.on(&params, &PlyQuery::lobes(theta_i, h_um, [0.0, 0.01]));
        for (k, sigma) in [0.0, 0.01].into_iter().enumerate() {
            let want = want.refl + want.high_at(sigma, &data.path_um);
            assert!((f64::from(ply.albedo()[k]) - want).abs() < 1e-6, "{} {want}", ply.albedo()[k]);
        }
        let kept = f64::from(ply.albedo()[0] + ply.r_d());
        assert!((kept - 1.0).abs() < 2e-3, "all light at sigma = 0: {kept}");
    }
}

#[test]
fn slopes_match_central_differences() {
    let f = planted();
    let mut rng = SplitMix64(9);
    let mut checked = 0;
    for _ in 0..60 {
        let (params, theta_i, h_um, w) = random(&mut rng);
        let sigma = [0.002f32, 0.02];
        let at = |params: &FamilyParams, sigma: [f32; 2]| {
            f.eval_gradient(params, &PlyQuery::lobes(theta_i, h_um, sigma), w).value
        };
        let g = f.eval_gradient(&params, &PlyQuery::lobes(theta_i, h_um, sigma), w);
        for (i, (param, step)) in [(FamilyParam::FiberPitch, 0.05), (FamilyParam::Alpha, 1e-5)].into_iter().enumerate()
        {
            let moved = |by: f64| {
                let mut p = params;
                p.set(param, params.get(param) + by);
                at(&p, sigma)
            };
            let (high, low) = (moved(step), moved(-step));
            for k in 0..2 {
                let want = (high[k] - low[k]) / (2.0 * step);
                // Relative to a change of the value by itself over the parameter.
                let scale = want.abs() + 1e-2 * g.value[k].abs() / params.get(param);
                assert!(
                    (g.by_params[i][k] - want).abs() <= 1e-2 * scale + 1e-12,
                    "{param:?}: got {}, want {want}",
                    g.by_params[i][k]
                );
                checked += 1;
            }
        }
        for k in 0..2 {
            let step = 0.02 * sigma[k];
            let moved = |by: f32| {
                let mut s = sigma;
                s[k] += by;
                (at(&params, s)[k], f64::from(s[k]))
            };
            let ((high, s1), (low, s0)) = (moved(step), moved(-step));
            let want = (high - low) / (s1 - s0);
            assert!(
                (g.by_sigma[k] - want).abs() <= 1e-2 * want.abs() + 1e-9,
                "sigma: got {}, want {want}",
                g.by_sigma[k]
            );
        }
        assert_eq!(g.by_params[2], [0.0; 2]);
    }
    assert_eq!(checked, 240);
}

#[test]
fn parameters_out_of_range() {
    let f = planted();
    for (params, key) in [
        (FamilyParams { fiber_pitch_um: 299.0, ..f.params() }, "fiber_pitch_um = 299"),
        (FamilyParams { alpha_fiber: f64::NAN, ..f.params() }, "alpha_fiber = NaN"),
        (FamilyParams { eta: 1.7, ..f.params() }, "eta = 1.7"),
    ] {
        let error = f.at(&params).unwrap_err().to_string();
        assert!(error.contains(key) && !error.contains('\n'), "{error}");
    }
    // A texture's numbers are kept within the ranges.
    let query = PlyQuery::lobes(0.4, 10.0, [0.01]);
    let (out, end) = (FamilyParams { alpha_fiber: 9.0, ..f.params() }, FamilyParams { alpha_fiber: 0.4, ..f.params() });
    let w = [0.0, -0.8, -0.6];
    assert_eq!(f.on(&out, &query).eval(w), f.on(&end, &query).eval(w));
    assert_eq!(f.eval_gradient(&out, &query, w).by_params[1], [0.0]);
    let odd = FamilyParams { fiber_pitch_um: f64::NAN, alpha_fiber: f64::NEG_INFINITY, eta: f64::NAN };
    for theta_i in [f32::NAN, f32::INFINITY, -1e9, 0.0] {
        let ply = f.on(&odd, &PlyQuery::new(theta_i, 5.0, [f32::NAN, f32::INFINITY], [0.5; 2]));
        for w in [[f32::NAN; 3], [0.0; 3], [f32::INFINITY, 0.0, 0.0], [0.0, 0.0, 1.0]] {
            assert!(ply.eval(w).iter().all(|v| v.is_finite() && *v >= 0.0) && ply.pdf(w).is_finite());
        }
        ply.sample([f32::NAN, 0.5, 1.0]);
    }
}

/// The sampler of one incidence: its densities integrate to 1, and its samples have weight times density =
/// value.
#[test]
fn samples_have_the_density_that_is_told() {
    let f = planted();
    let mut rng = SplitMix64(3);
    for edge in [false, true] {
        for _ in 0..4 {
            let (params, theta_i, h_um, _) = random(&mut rng);
            let query = PlyQuery { edge, ..PlyQuery::new(theta_i, h_um, [0.0, 0.01], [0.6, 0.5]) };
            let ply = f.on(&params, &query);
            let (mut sums, mut scattered) = ([0.0f64; 2], 0.0);
            let n = 40_000;
            for _ in 0..n {
                let u = std::array::from_fn(|_| rng.next_f64() as f32);
                if let BsdfSample::Scattered(s) = ply.sample(u) {
                    scattered += 1.0;
                    let f = ply.eval(s.w);
                    for k in 0..2 {
                        sums[k] += f64::from(s.weight[k]);
                        assert!(
                            (s.weight[k] * s.pdf - f[k]).abs() <= 1e-3 * (f[k] + 1e-3),
                            "{} {}",
                            s.weight[k] * s.pdf,
                            f[k]
                        );
                    }
                }
            }
            let share = scattered / f64::from(n);
            let chance = f64::from(ply.outcomes().scattered);
            assert!(
                (share - chance).abs() < 5.0 * (chance * (1.0 - chance) / f64::from(n)).sqrt() + 1e-3,
                "{share} {chance}"
            );
            for k in 0..2 {
                let (got, want) = (sums[k] / f64::from(n), f64::from(ply.albedo()[k]));
                assert!((got - want).abs() < 0.02, "albedo sampled {got}, told {want}");
            }
        }
    }
}

#[test]
fn a_model_takes_less_than_5_ms() {
    let f = planted();
    let params = FamilyParams { fiber_pitch_um: 777.0, alpha_fiber: 0.3, ..f.params() };
    let time = |work: &dyn Fn()| {
        let of = |_| {
            let begun = std::time::Instant::now();
            work();
            begun.elapsed().as_secs_f64()
        };
        (0..30).map(of).fold(f64::INFINITY, f64::min)
    };
    let whole = time(&|| drop(std::hint::black_box(f.at(&params).unwrap())));
    let query = PlyQuery::lobes(0.4, 10.0, [0.001, 0.004, 0.01]);
    let w = [0.1f32, -0.7, -0.7];
    let model = f.at(&params).unwrap();
    let one = time(&|| {
        (0..100).for_each(|_| {
            std::hint::black_box(f.on(&params, &query).eval(w));
        })
    }) / 100.0;
    let slope = time(&|| {
        (0..100).for_each(|_| {
            std::hint::black_box(f.eval_gradient(&params, &query, w));
        })
    }) / 100.0;
    let asked = PlyQuery { cached: false, ..query };
    let plain = time(&|| {
        (0..100).for_each(|_| {
            std::hint::black_box(model.at(&asked).eval(w));
        })
    }) / 100.0;
    println!(
        "at {:.2} ms; on + eval {:.2} us, gradient {:.2} us, a model's own eval {:.2} us",
        whole * 1e3,
        one * 1e6,
        slope * 1e6,
        plain * 1e6
    );
    assert!(cfg!(debug_assertions) || whole < 5e-3, "{whole} s");
}

#[test]
fn bad_files_are_refused_in_one_line() {
    let bytes = planted().data().to_bytes().unwrap();
    let one_line = |bytes: &[u8]| match PlyFamily::from_bytes(bytes, "bad.pwfam") {
        Ok(_) => String::new(),
        Err(error) => {
            let text = error.to_string();
            assert!(text.contains("bad.pwfam") && !text.contains('\n'), "{text}");
            text
        }
    };
    for len in [0, 7, 8, 100, 5000, bytes.len() / 2, bytes.len() - 1] {
        assert!(!one_line(&bytes[..len]).is_empty(), "{len} bytes");
    }
    let model = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/models/polyester.pwm")).unwrap();
    assert!(one_line(&model).contains("plywave family"), "{}", one_line(&model));
    assert!(PlyModel::from_bytes(&bytes, "bad.pwm").is_err());
    // Flipped bytes: refused or read, never a panic.
    let mut rng = SplitMix64(11);
    for _ in 0..60 {
        let mut bad = bytes.clone();
        let most = if rng.next_u64().is_multiple_of(2) { 4000 } else { bad.len() };
        for _ in 0..3 {
            let at = rng.next_u64() as usize % most;
            bad[at] ^= 1 << (rng.next_u64() % 8);
        }
        if let Ok(family) = PlyFamily::from_bytes(&bad, "bad.pwfam") {
            let _ = family.at(&family.params());
        }
    }
    let newer = String::from_utf8_lossy(&bytes[..200]).into_owned();
    assert!(newer.contains("plywave-family"));
    let data = planted().data();
    let refused = |change: &dyn Fn(&mut FamilyData), what: &str| {
        let mut d = data.clone();
        change(&mut d);
        let error = PlyFamily::from_data(d).unwrap_err().to_string();
        assert!(error.contains(what) && !error.contains('\n'), "{error}");
    };
    refused(&|d| d.axes[0].values.swap(0, 1), "fiber_pitch_um");
    refused(&|d| d.axes.clear(), "axes");
    refused(&|d| drop(d.nodes.pop()), "nodes");
    refused(&|d| d.nodes[3].path_um[1] += 1.0, "path_um of node 3");
    refused(&|d| d.nodes[1].energies.miss[0] *= 0.5, "miss of node 1");
    refused(&|d| d.nodes[4].high[5] = 7.0, "of node 4");
}

#[test]
fn ranges_of_specs_are_checked() {
    use plywave::spec::YarnSpec;
    let refused = |family: &str, what: &str| {
        let text = format!("{POLYESTER}\n[family]\n{family}\n");
        let error = YarnSpec::parse(&text, "p.toml").unwrap_err().to_string();
        assert!(error.contains(what) && !error.contains('\n'), "{error}");
    };
    refused("", "family = (empty)");
    refused("fiber_pitch_um = [900.0, 4000.0]", "own fiber_pitch_um = 800");
    refused("alpha_fiber = [0.4, 0.1]", "family.alpha_fiber");
    refused("fiber_pitch_um = [20.0, 4000.0]", "radius");
    refused("twist = [1.0, 2.0]", "family.twist");
    assert!(YarnSpec::parse(&spec(), "p.toml").unwrap().family.is_some());
}
