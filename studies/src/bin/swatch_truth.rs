//! Fits of photographs whose cloths are known: pictures of specs with known numbers, and how many of the
//! numbers that the fit finds are within two bars of them.
//!
//! `cargo run --release -p plywave-studies --bin swatch_truth -- COUNT SEED [FOLDER]`
//!
//! Each spec has a weave, sett, count, twist, roughness, color and unevenness drawn from the ranges below.
//! Its ply is simulated and its cloth precomputed as `plywave weave` does, with none of the families and
//! tables of the fit. Both pictures are rendered pixel by pixel with relief, diffraction, unevenness and the
//! lamp's size, blurred by a lens, given noise, exposed at random, and coded in 8 bits of sRGB. The fit is
//! told the fiber, and of every second cloth the mass. With FOLDER, pictures, specs and reports are written
//! there, and photographs that an earlier run left there are used.

use plywave::cloth::{ClothModel, ClothOptions};
use plywave_pipeline::swatch::{Photo, Shot, SwatchGeometry, SwatchInputs, SwatchKnown, blur, encode, fit_swatch, png};
use plywave_pipeline::{ClothRecipe, Run};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::path::Path;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

const SIZE: [usize; 2] = [512, 512];
/// Samples of a pixel.
const SAMPLES: u32 = 16;
/// Weaves with the covers of warp and weft, widths over spacing.
const WEAVES: [(&str, [f64; 2]); 6] = [
    ("plain", [0.62, 0.55]),
    ("twill 2/2", [0.95, 0.65]),
    ("twill 3/1", [0.92, 0.58]),
    ("twill 2/1 S", [0.85, 0.60]),
    ("twill 3/1 S", [0.95, 0.62]),
    ("satin 5/2", [1.10, 0.55]),
];

/// A known number, and the name that the fit gives it.
struct Known(&'static str, f64);

fn main() -> Outcome<()> {
    let given: Vec<String> = std::env::args().skip(1).collect();
    let (count, seed, folder) = match given.as_slice() {
        [count, seed] => (count.parse::<u64>()?, seed.parse::<u64>()?, None),
        [count, seed, folder] => (count.parse::<u64>()?, seed.parse::<u64>()?, Some(Path::new(folder))),
        _ => return Err("COUNT SEED [FOLDER]".into()),
    };
    let (mut within, mut all, mut weaves) = (0, 0, 0);
    for number in seed..seed + count {
        let begun = std::time::Instant::now();
        let (spec, known, weave, fiber, mass) = draw(number)?;
        let photos = match folder.map(|folder| kept(folder, number, &spec)) {
            Some(Some(photos)) => photos,
            _ => photograph(&spec, number)?,
        };
        if let Some(folder) = folder {
            std::fs::create_dir_all(folder)?;
            std::fs::write(folder.join(format!("{number}.toml")), &spec)?;
            for (photo, light) in photos.iter().zip(["R", "T"]) {
                write(&folder.join(format!("{number}_{light}.png")), photo)?;
            }
        }
        let made = begun.elapsed().as_secs_f64();
        let inputs = SwatchInputs {
            photos,
            geometry: SwatchGeometry::default(),
            known: SwatchKnown {
                fiber: Some(fiber.into()),
                g_per_m2: (number % 2 == 0).then_some(mass),
                ..SwatchKnown::default()
            },
        };
        let fit = fit_swatch(&inputs, &Run::plain())?;
        // Names of a warp that runs up and of one that runs across.
        let names = if weave == "twill 2/2" { ["twill 2/2 Z", "twill 2/2 S"] } else { [weave; 2] };
        let is_right = fit.weaves.first().is_some_and(|w| {
            let is_named =
                |name: &str| w.weave == name || w.weave == format!("{name} Z") || w.weave == format!("{name} warp");
            is_named(names[usize::from(w.is_across)])
                && (weave.starts_with("twill 2/2") || weave == "plain" || !w.is_across)
        });
        weaves += u64::from(is_right);
        let found = fit.weaves.first().map(|w| (w.weave.clone(), w.probability));
        println!(
            "{number}: {weave} of {fiber}, {}; found {found:?}; left {:.3}, {made:.0} s to photograph, {:.0} s in all",
            if number % 2 == 0 { "mass given" } else { "no mass" },
            fit.rms,
            begun.elapsed().as_secs_f64()
        );
        // Plain weave and twill 2/2 of one yarn are the same cloths turned by a quarter.
        let is_turned = fit.is_across && (weave == "plain" || weave.starts_with("twill 2/2"));
        for Known(name, truth) in known {
            let looked_up = match name {
                "ends_per_cm" if is_turned => "picks_per_cm",
                "picks_per_cm" if is_turned => "ends_per_cm",
                _ => name,
            };
            let Some(number) = fit.number(looked_up) else { continue };
            let off = (number.value - truth) / number.sd;
            all += 1;
            within += u64::from(off.abs() <= 2.0);
            println!("  {name:<18} {truth:>10.4} found {:>10.4} +- {:<9.4} {off:>6.2} bars", number.value, number.sd);
        }
        if let Some(folder) = folder {
            std::fs::write(folder.join(format!("{number}_fit.toml")), &fit.spec)?;
            std::fs::write(folder.join(format!("{number}_fit.png")), &fit.picture)?;
        }
        println!("so far: {within} of {all} numbers within two bars, {weaves} weaves of {}", number - seed + 1);
    }
    Ok(())
}

/// The text of a spec, its numbers, weave, fiber and mass [g/m2].
fn draw(number: u64) -> Outcome<(String, Vec<Known>, &'static str, &'static str, f64)> {
    let mut rng = Pcg64Mcg::seed_from_u64(number);
    let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let (weave, covers) = WEAVES[number as usize % WEAVES.len()];
    let is_filament = weave.starts_with("satin");
    let fiber = if is_filament { "polyester bright" } else { "cotton" };
    let tex = if is_filament { between(8.0, 14.0) } else { between(20.0, 70.0) };
    let usual = if is_filament { 150.0 } else { 3827.0 / tex.sqrt() };
    let turns = (usual * between(0.8, 1.25)).round();
    let alpha = if is_filament { between(0.07, 0.2) } else { between(0.15, 0.38) };
    let color = [between(0.25, 0.8), between(0.25, 0.8), between(0.25, 0.8)];
    let (count_cv, spacing_cv, mm) = (between(0.05, 0.2), between(0.01, 0.05), between(8.0, 25.0));
    let text = |ends: f64, picks: f64| {
        format!(
            "name = \"truth {number}\"\n[weave]\nkind = \"{weave}\"\nends_per_cm = {ends:.2}\npicks_per_cm = {picks:.2}\n\
             [warp]\nfiber = {{ like = \"{fiber}\", alpha_fiber = {alpha:.3} }}\ncount = \"{tex:.2} tex\"\ntwist = \"Z {turns}/m\"\n\
             color = [{:.3}, {:.3}, {:.3}]\ncount_cv = {count_cv:.3}\nspacing_cv = {spacing_cv:.3}\nuneven_mm = {mm:.1}\n\
             [weft]\nas = \"warp\"\n",
            color[0], color[1], color[2]
        )
    };
    // The sett from covers, by the width that the language of specs gives the yarn.
    let probe = ClothRecipe::parse("truth.toml", text(20.0, 20.0), "")?;
    let diameter_cm = 2e-4 * probe.spec.yarns()[0].radius_um();
    let (a, b) = (between(0.92, 1.06), between(0.92, 1.06));
    let (ends, picks) = (covers[0] * a / diameter_cm, covers[1] * b / diameter_cm);
    let spec = text(ends, picks);
    let curves = ClothRecipe::parse("truth.toml", spec.clone(), "")?.curves(&Run::plain())?;
    let mass = curves.measures.mass_g_per_m2;
    let known = vec![
        Known("ends_per_cm", ends),
        Known("picks_per_cm", picks),
        Known("count_tex", tex),
        Known("twist_per_m", turns),
        Known("alpha_fiber", alpha),
        Known("color_red", color[0]),
        Known("color_green", color[1]),
        Known("color_blue", color[2]),
        Known("count_cv", count_cv),
        Known("spacing_cv", spacing_cv),
        Known("g_per_m2", mass),
    ];
    Ok((spec, known, weave, fiber, mass))
}

/// Both photographs of a spec.
fn photograph(spec: &str, number: u64) -> Outcome<[Photo; 2]> {
    let recipe = ClothRecipe::parse("truth.toml", spec, "")?;
    let run = Run::plain();
    let models = recipe.plies(&plywave_pipeline::model_library())?.build(&run)?.models;
    let curves = recipe.curves(&run)?;
    let data = recipe.make(&curves, &models, false, &run)?;
    let cloth = ClothModel::from_data(data, &ClothOptions::default())?;
    let geometry = SwatchGeometry::default();
    let mut rng = Pcg64Mcg::seed_from_u64(1000 + number);
    let mut photos = Vec::new();
    for is_back in [false, true] {
        let shot = Shot {
            cloth: &cloth,
            turn_rad: 0.0,
            geometry: &geometry,
            size: SIZE,
            part: [0, 0, SIZE[0], SIZE[1]],
            samples: SAMPLES,
            seed: number as u32,
        };
        let light = blur(SIZE, &shot.render(is_back), 0.6);
        // Exposed for the brightest channel.
        let mut all: Vec<f32> = light.iter().map(|rgb| rgb.iter().fold(0.0f32, |most, v| most.max(*v))).collect();
        all.sort_by(f32::total_cmp);
        let exposure = (0.15 + 0.15 * rng.random::<f32>()) / all[all.len() / 2];
        let mut normal = || (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0;
        let code = |v: f32, noise: f32| encode(exposure * v * (1.0 + 0.02 * noise) + 0.001 * noise);
        let codes: Vec<[u8; 3]> = light.iter().map(|rgb| rgb.map(|v| code(v, normal()))).collect();
        photos.push(Photo::from_png(&png(SIZE, &codes)?, "truth.png")?);
    }
    photos.try_into().map_err(|_| "two pictures".into())
}

/// Photographs of an earlier run of the same spec.
fn kept(folder: &Path, number: u64, spec: &str) -> Option<[Photo; 2]> {
    let same = std::fs::read_to_string(folder.join(format!("{number}.toml"))).ok()? == spec;
    let read = |light: &str| Photo::load(&folder.join(format!("{number}_{light}.png"))).ok();
    if same { Some([read("R")?, read("T")?]) } else { None }
}

fn write(path: &Path, photo: &Photo) -> Outcome<()> {
    let codes: Vec<[u8; 3]> = photo.rgb.iter().map(|rgb| rgb.map(encode)).collect();
    Ok(std::fs::write(path, png(SIZE, &codes)?)?)
}
