//! Cloths that somebody measured, predicted from their labels.
//!
//!     cargo run --release -p plywave-studies --bin measured -- [NAME ..]
//!
//! `studies/measured.toml` has for each cloth what its label says, the ranges of what the label leaves open,
//! and the measurement. Thirty specs of a Latin hypercube over those ranges are woven and path traced
//! ([`TwinJob`]); the table has the median and the range of T, of the light that goes straight and of R
//! beside the measurement. No number is fitted to a T. Where the label says no color, R fixes the dye, and
//! only T and what is straight are predictions. In place of names
//!
//! - `trends` prints signs: grazing reflectance, oblique transmittance, layers and weaves;
//! - `layers` prints two layers of measured fabrics and of a cloth by adding one layer to another;
//! - `thick` prints the absorption of a fiber for the K/S of a thick pile.

use plywave::color::Undyed;
use plywave::spec::rules::invalid;
use plywave_runs::Run;
use plywave_sim::cloth::{Effort, MadeCloth, make_cloth};
use plywave_sim::twin::{TwinCurves, TwinJob, TwinMesh, TwinOptions, direction};
use plywave_tables::twin::{ClothTwin, SphereBins};
use plywave_textile::ClothSpec;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::time::Instant;
use toml::{Table, Value};

#[path = "../measured_trends.rs"]
mod trends;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// Specs of a hypercube.
const SPECS: usize = 30;
/// Specs that must have an answer.
const LEAST: usize = 8;
/// Paths of a view, and of each view of the sky.
const PATHS: u64 = 10_000;
const SKY_PATHS: u64 = 1500;
/// Steps of a bisection for the scattering that has a measured R.
const STEPS: usize = 4;
/// Absorptions among which that of a measured R is interpolated [1/um].
const SIGMAS: [f64; 10] = [0.0, 1e-4, 3e-4, 1e-3, 2e-3, 4e-3, 8e-3, 0.016, 0.05, 0.3];

/// R, T with what is straight, and what is straight; and the standard error of T.
#[derive(Clone, Copy, Debug, Default)]
struct Light {
    r: f64,
    t: f64,
    straight: f64,
    se: f64,
}

/// A value of each open number of a label.
type Draw = BTreeMap<String, Value>;

fn main() -> Outcome<()> {
    let names: Vec<String> = std::env::args().skip(1).collect();
    match names.first().map(String::as_str) {
        Some("trends") => return trends::trends(),
        Some("layers") => return trends::layers(),
        Some("thick") => return trends::thick(),
        _ => {}
    }
    let file: Table = include_str!("../../measured.toml").parse()?;
    let cloths = file.get("cloth").and_then(Value::as_array).ok_or("measured.toml: no [[cloth]]")?;
    println!("| cloth | quantity | measured | median | range | s.e. | inside |\n|---|---|---|---|---|---|---|");
    let (mut inside, mut total) = (0, 0);
    let begun = Instant::now();
    for cloth in cloths.iter().filter_map(Value::as_table) {
        let name = text(cloth, "name")?;
        if !names.is_empty() && !names.iter().any(|n| name.contains(n.as_str())) {
            continue;
        }
        let lights: Vec<Light> = hypercube(cloth)?
            .iter()
            .map(|draw| predicted(cloth, draw))
            .collect::<Outcome<Vec<_>>>()?
            .into_iter()
            .flatten()
            .collect();
        total += 1;
        inside += usize::from(tell(name, cloth, &lights)?);
    }
    println!("\n{inside} of {total} cloths have every measured value inside, {:.0} s", begun.elapsed().as_secs_f64());
    Ok(())
}

/// Prints the rows of a cloth; whether all its measured values are inside.
fn tell(name: &str, cloth: &Table, lights: &[Light]) -> Outcome<bool> {
    let measured = cloth.get("measured").and_then(Value::as_table).ok_or("no measured")?;
    // A range of fewer specs says little.
    let mut all = lights.len() >= LEAST;
    for (key, of) in [
        ("T", (|l: &Light| l.t) as fn(&Light) -> f64),
        ("T diffuse", |l| l.t - l.straight),
        ("straight", |l| l.straight),
        ("R", |l| l.r),
    ] {
        let Some(value) = measured.get(key).and_then(Value::as_float) else { continue };
        let mut values: Vec<f64> = lights.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        let (Some(low), Some(high)) = (values.first(), values.last()) else { continue };
        let se = lights.iter().map(|l| l.se).fold(0.0, f64::max);
        let is_dye = key == "R" && matches!(cloth.get("dye").and_then(Value::as_str), Some("R" | "scattering"));
        // Rays leave a standard error.
        let is_in = (*low - se..=*high + se).contains(&value);
        let verdict = if is_dye {
            "fixes the dye"
        } else if is_in {
            "yes"
        } else {
            "no"
        };
        all &= is_in || is_dye;
        let median = values[values.len() / 2];
        println!("| {name} | {key} | {value:.4} | {median:.4} | {low:.4} .. {high:.4} | {se:.4} | {verdict} |");
    }
    if lights.len() < SPECS {
        println!("| {name} | specs without an answer | | {} of {SPECS} | | | |", SPECS - lights.len());
    }
    Ok(all)
}

fn text<'a>(table: &'a Table, key: &str) -> Outcome<&'a str> {
    table.get(key).and_then(Value::as_str).ok_or_else(|| format!("measured.toml: {key} is missing").into())
}

fn number(draw: &Draw, key: &str) -> Option<f64> {
    draw.get(key).and_then(|v| v.as_float().or(v.as_integer().map(|n| n as f64)))
}

/// The draws of a cloth: every range is cut into as many parts as there are draws, each of which one draw
/// has. A range over more than a factor of 5 is cut by the logarithm; a list of texts is a choice.
fn hypercube(cloth: &Table) -> Outcome<Vec<Draw>> {
    let mut rng =
        Pcg64Mcg::seed_from_u64(text(cloth, "name")?.bytes().fold(61, |h, b| h * 31 % 1_000_003 + u64::from(b)));
    let mut draws = vec![Draw::new(); SPECS];
    let open = cloth.get("open").and_then(Value::as_table).ok_or("no open")?;
    for (key, value) in open {
        let mut order: Vec<usize> = (0..SPECS).collect();
        order.shuffle(&mut rng);
        for (draw, part) in draws.iter_mut().zip(order) {
            let place = (part as f64 + rng.random::<f64>()) / SPECS as f64;
            let of = match value {
                Value::Array(ends) => {
                    match (ends.first().and_then(Value::as_float), ends.last().and_then(Value::as_float)) {
                        (Some(low), Some(high)) if low > 0.0 && high > 5.0 * low => {
                            Value::Float(low * (high / low).powf(place))
                        }
                        (Some(low), Some(high)) => Value::Float(low + place * (high - low)),
                        _ => ends[(place * ends.len() as f64) as usize].clone(),
                    }
                }
                fixed => fixed.clone(),
            };
            draw.insert(key.clone(), of);
        }
    }
    draws.iter_mut().for_each(derive);
    Ok(draws)
}

/// What follows from a draw: counts from a solid round yarn or from the mass of the cloth.
fn derive(draw: &mut Draw) {
    let of = |draw: &Draw, key: &str| number(draw, key);
    if let (Some(d), Some(density)) = (of(draw, "diameter_um"), of(draw, "density")) {
        let filled = of(draw, "packing").unwrap_or(1.0);
        draw.insert("tex".into(), Value::Float(1e-3 * density * filled * 0.25 * PI * d * d));
    }
    if let (Some(mass), Some(ends), Some(picks)) = (of(draw, "g_per_m2"), of(draw, "ends"), of(draw, "picks")) {
        let length_m = 100.0 * (ends + picks) * (1.0 + of(draw, "crimp").unwrap_or(0.0));
        draw.insert("tex".into(), Value::Float(1e3 * mass / length_m));
    }
}

/// The text of a spec with the draw's values in place of `{key}`.
fn filled(template: &str, draw: &Draw) -> String {
    draw.iter().fold(template.to_string(), |text, (key, value)| {
        let value = value.as_str().map_or_else(|| value.to_string(), str::to_string);
        text.replace(&format!("{{{key}}}"), &value)
    })
}

fn woven(spec: &ClothSpec, effort: Effort) -> Outcome<MadeCloth> {
    let mut read = |named: &str| Err(invalid("cloth", "file", named, "measured.toml names no files"));
    Ok(make_cloth(spec, "cloth", &mut read, effort, &|_| true)?)
}

/// The draw with the sett at which its cloth is as open as it says, if it says so; setts too dense to weave
/// are not open.
fn with_sett(template: &str, draw: &Draw) -> Outcome<Draw> {
    let mut draw = draw.clone();
    // The yarns lie alike whatever they scatter.
    draw.entry("scattering".into()).or_insert(Value::Float(0.01));
    let (Some(open), Some(d)) = (number(&draw, "openness"), number(&draw, "diameter_um")) else { return Ok(draw) };
    let [mut low, mut high] = [0.6, 1.05].map(|cover| cover * 1e4 / d);
    for _ in 0..8 {
        for key in ["ends", "picks"] {
            draw.insert(key.into(), Value::Float(0.5 * (low + high)));
        }
        let made = ClothSpec::parse(&filled(template, &draw), "cloth")
            .map_err(Into::into)
            .and_then(|spec| woven(&spec, Effort::Draft));
        match made.is_ok_and(|made| made.measures.openness > open) {
            true => low = 0.5 * (low + high),
            false => high = 0.5 * (low + high),
        }
    }
    for key in ["ends", "picks"] {
        draw.insert(key.into(), Value::Float(low));
    }
    let made = woven(&ClothSpec::parse(&filled(template, &draw), "cloth")?, Effort::Draft)?;
    match made.measures.openness < 1.5 * open + 0.003 {
        true => Ok(draw),
        false => Err(format!("no sett is {open:.3} open, the densest {:.3}", made.measures.openness).into()),
    }
}

/// The explicit fibers of a spec.
fn fibers(spec: &str) -> Outcome<TwinCurves> {
    let spec = ClothSpec::parse(spec, "cloth")?;
    let made = woven(&spec, Effort::Full)?;
    let yarns = spec.yarns();
    let texts = yarns.iter().enumerate().map(|(kind, yarn)| yarn.ply("cloth", spec.kind_name(kind))?.to_text("cloth"));
    Ok(TwinCurves::new(&spec.name, made.curves, texts.collect::<Result<Vec<_>, _>>()?)?)
}

/// Their light from these directions with these absorptions.
fn traced(fibers: &TwinCurves, views: Vec<[f64; 3]>, sigmas: &[f64], paths: u64) -> Outcome<ClothTwin> {
    let mesh = TwinMesh { outline_points: 20, step_um: 40.0, ..TwinMesh::default() };
    let options = TwinOptions {
        views,
        sigma_per_um: sigmas.iter().map(|s| [*s; 2]).collect(),
        paths,
        shards: 8,
        bins: SphereBins { rows: 2, columns: 4 },
        image: 1,
        mesh,
        ..TwinOptions::default()
    };
    Ok(plywave_runs::run(&TwinJob::new(fibers.clone(), &options)?, Run::plain())?)
}

fn light(twin: &ClothTwin, view: usize, sigma: usize) -> Light {
    let (of, se) = (twin.light(view, sigma), twin.standard_errors(view, sigma));
    Light {
        r: of.reflected,
        t: of.transmitted + of.straight,
        straight: of.straight,
        se: se[1].hypot((of.straight * (1.0 - of.straight) / twin.paths[view] as f64).sqrt()),
    }
}

/// Absorption over scattering of a body whose thick layer reflects `y` of white light: Kubelka and Munk's
/// K/S below a surface that reflects `k1` from outside and 0.61 of diffuse light from inside (Saunderson
/// 1942), and K = 2 sigma, S = 3/4 scattering (isotropic).
fn absorption_over_scattering(y: f64, eta: f64) -> f64 {
    let (k1, k2) = (((eta - 1.0) / (eta + 1.0)).powi(2), 0.61);
    // Nothing comes from within a body as dark as its surface.
    let within = (y - k1).max(1e-3);
    let rho = within / ((1.0 - k1) * (1.0 - k2) + k2 * within);
    0.375 * (1.0 - rho).powi(2) / (2.0 * rho)
}

/// The light of a draw; `None` where it cannot have the measured R, or its yarns do not fit.
fn predicted(cloth: &Table, draw: &Draw) -> Outcome<Option<Light>> {
    let template = text(cloth, "spec")?;
    let measured_r = cloth.get("measured").and_then(|m| m.get("R")).and_then(Value::as_float);
    let sun = number(draw, "sun_elevation_deg").is_some();
    let dye = text(cloth, "dye").ok();
    let made = with_sett(template, draw).and_then(|draw| {
        let solved = dye == Some("scattering");
        Ok((if solved { None } else { Some(fibers(&filled(template, &draw))?) }, draw))
    });
    let (made, draw) = match made {
        Ok((Some(made), draw)) => (made, draw),
        Ok((None, draw)) => return white(template, &draw, measured_r.ok_or("no R")?),
        Err(error) => {
            eprintln!("{}: {error}", text(cloth, "name")?);
            return Ok(None);
        }
    };
    let draw = &draw;
    if sun {
        return sunlit(&made, draw).map(Some);
    }
    let sigmas = match number(draw, "y_thick") {
        Some(y) => vec![absorption_over_scattering(y, 1.54) * number(draw, "scattering").unwrap_or(0.0)],
        None if number(draw, "undyed_um").is_some() => {
            vec![number(draw, "undyed_um").map_or(0.0, |l| Undyed::Cellulose.sigma_per_um(l))]
        }
        None if measured_r.is_some() => SIGMAS.to_vec(),
        None => vec![number(draw, "sigma").unwrap_or(0.0)],
    };
    let twin = traced(&made, vec![direction(0.0, 0.0)], &sigmas, PATHS)?;
    let mut lights: Vec<Light> = (0..sigmas.len()).map(|k| light(&twin, 0, k)).collect();
    if let Some(backing) = number(draw, "backing") {
        // What is behind the cloth returns light.
        lights.iter_mut().for_each(|l| l.r += l.t * l.t * backing / (1.0 - l.r * backing));
    }
    let (Some(r), true) = (measured_r, lights.len() > 1) else { return Ok(lights.first().copied()) };
    // R falls with the absorption.
    Ok(lights.windows(2).find(|w| (w[1].r..=w[0].r).contains(&r)).map(|w| {
        let part = (w[0].r - r) / (w[0].r - w[1].r).max(1e-12);
        let mix = |a: f64, b: f64| a + part * (b - a);
        Light { r, t: mix(w[0].t, w[1].t), straight: w[0].straight, se: w[0].se }
    }))
}

/// A white body whose scattering gives the cloth a measured R, and whose absorption that of a thick layer;
/// `None` if none does.
fn white(template: &str, draw: &Draw, r: f64) -> Outcome<Option<Light>> {
    let over = absorption_over_scattering(number(draw, "y_thick").ok_or("no y_thick")?, 1.54);
    let of = |scattering: f64, paths: u64| -> Outcome<Light> {
        let mut draw = draw.clone();
        draw.insert("scattering".into(), Value::Float(scattering));
        let made = fibers(&filled(template, &draw))?;
        Ok(light(&traced(&made, vec![direction(0.0, 0.0)], &[over * scattering], paths)?, 0, 0))
    };
    let (mut low, mut high) = (5e-3f64, 0.08f64);
    if of(high, PATHS / 4)?.r < r {
        return Ok(None);
    }
    for _ in 0..STEPS {
        let middle = (low * high).sqrt();
        if of(middle, PATHS / 4)?.r < r { low = middle } else { high = middle }
    }
    of((low * high).sqrt(), PATHS).map(Some)
}

/// T of sunlight and of an even sky over ground that reflects, 400 to 700 nm. An amber net is black up to
/// its edge and clear above.
fn sunlit(made: &TwinCurves, draw: &Draw) -> Outcome<Light> {
    let of = |key: &str| number(draw, key);
    let zenith = (90.0 - of("sun_elevation_deg").unwrap_or(90.0)).to_radians();
    let sun = direction(zenith, of("sun_azimuth_deg").unwrap_or(0.0).to_radians());
    // Cosines at the middles of three parts of the flux.
    let sky: Vec<[f64; 3]> =
        (0..6).map(|k| direction(((k / 2) as f64 / 3.0 + 1.0 / 6.0f64).sqrt().acos(), 0.4 + 1.3 * k as f64)).collect();
    let clear = of("sigma").unwrap_or(0.0);
    let sigmas = [clear, 0.1];
    let direct = traced(made, vec![sun], &sigmas, PATHS)?;
    let diffuse = traced(made, sky, &sigmas, SKY_PATHS)?;
    let share = of("sky").unwrap_or(0.15);
    let ground = of("ground").unwrap_or(0.0);
    let dark = of("edge_um").map_or(0.0, |edge| (edge - 0.4) / 0.3);
    let mut sum = Light::default();
    for (sigma, weight) in [(0, 1.0 - dark), (1, dark)] {
        let back = (0..6).map(|view| light(&diffuse, view, sigma).r / 6.0).sum::<f64>();
        // Light goes to and fro between the ground and the net.
        let weight = weight / (1.0 - ground * back);
        let mut add = |l: Light, w: f64| {
            sum.r += w * l.r;
            sum.t += w * l.t;
            sum.straight += w * l.straight;
            sum.se = sum.se.hypot(w * l.se);
        };
        add(light(&direct, 0, sigma), weight * (1.0 - share));
        (0..6).for_each(|view| add(light(&diffuse, view, sigma), weight * share / 6.0));
    }
    Ok(sum)
}
