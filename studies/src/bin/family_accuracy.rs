//! Accuracy of a family for held-out yarns: comparison with new simulations at random parameters.
//!
//! ```text
//! cargo run --release -p plywave-studies --bin family_accuracy -- FAMILY.pwfam [POINTS] [QUALITY] [PATHS]
//! ```
//!
//! At each point the yarn is simulated twice, with the family's seed and with another. A direct fit of the
//! first table and the family's model at the point are both compared with the held-out second table. The
//! output has the excess errors of f_high and f_refl (rms over all slices, noise removed), their ratios, and
//! the differences of the energies from the second table, for the family and for the direct fit, which has
//! the noise of two tables. PATHS are per incident latitude; the default is that of the quality.

use plywave::ply::{FamilyParam, PlyFamily};
use plywave::spec::YarnSpec;
use plywave_fit::errors;
use plywave_pipeline::{Quality, Recipe, Run, Speckle, energies_off, fit_model, member, simulate};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let path = args.next().ok_or("give FAMILY.pwfam [POINTS] [QUALITY] [PATHS]")?;
    let points: usize = args.next().map_or(Ok(10), |n| n.parse())?;
    let family = PlyFamily::load(&path)?;
    let data = family.data();
    let quality = Quality::of_preset(&args.next().unwrap_or_else(|| data.preset.clone()));
    let spec = YarnSpec::parse(&data.spec_text, &path)?;
    let paths: Option<u64> = args.next().map(|n| n.parse()).transpose()?;
    let recipe = Recipe {
        paths,
        seed: data.seed,
        speckle: Speckle::None,
        ..Recipe::new(path, spec.clone(), data.spec_text.clone(), quality)
    };
    let radius = spec.ply_ring().radius_um;
    let mut random = plywave::math::hash::SplitMix64(20_261_123);
    println!(
        "{:>9} {:>6} {:>6}  {:>8} {:>8} {:>5}  {:>8} {:>8} {:>5}  {:>7} {:>7} {:>7}",
        "pitch", "alpha", "eta", "high", "direct", "ratio", "refl", "direct", "ratio", "dr_d", "drefl", "dhigh"
    );
    let (mut ratios, mut worst, mut noise) = (Vec::new(), [0.0f64; 3], [0.0f64; 3]);
    for _ in 0..points {
        let mut params = family.params();
        for param in FamilyParam::ALL {
            if let Some([low, .., high]) = data.values(param) {
                // Even in the coordinate of the family.
                let (x, y) = (param.coordinate(*low, radius), param.coordinate(*high, radius));
                params.set(param, param.of_coordinate(x + (y - x) * random.next_f64(), radius).clamp(*low, *high));
            }
        }
        let own = member(&recipe, &params)?;
        let table = simulate(&own, &Run::plain())?;
        let fresh = simulate(&Recipe { seed: own.seed + 1000, ..own.clone() }, &Run::plain())?;
        let direct = fit_model(&table, &own.spec, &quality.fit(), &own.file, &Run::plain())?;
        let model = family.data_at(&params)?;
        let (got, want) = (errors(&model, &fresh)?, errors(&direct, &fresh)?);
        let (off, direct_off) = (energies_off(&model, &fresh, &got), energies_off(&direct, &fresh, &want));
        for i in 0..3 {
            (worst[i], noise[i]) = (worst[i].max(off[i]), noise[i].max(direct_off[i]));
        }
        let ratio = got.rms_high[0] / want.rms_high[0];
        ratios.push(ratio);
        println!(
            "{:>9.1} {:>6.3} {:>6.3}  {:>8.4} {:>8.4} {:>5.2}  {:>8.4} {:>8.4} {:>5.2}  {:>7.4} {:>7.4} {:>7.4}",
            params.fiber_pitch_um,
            params.alpha_fiber,
            params.eta,
            got.rms_high[0],
            want.rms_high[0],
            ratio,
            got.rms_refl,
            want.rms_refl,
            got.rms_refl / want.rms_refl,
            off[0],
            off[1],
            off[2]
        );
    }
    let greatest = ratios.iter().fold(0.0f64, |a, b| a.max(*b));
    println!("f_high: ratio of excess errors {greatest:.3} at most (asked: 1.3)");
    println!(
        "energies: r_d off by {:.4}, f_refl by {:.4}, f_high by {:.4} at most (asked: 0.005); direct fits {:.4}, {:.4}, {:.4}",
        worst[0], worst[1], worst[2], noise[0], noise[1], noise[2]
    );
    Ok(())
}
