//! `plywave info`: prints the contents of a yarn spec, a table, a model, a fiber or a file of speckle
//! patterns.

use crate::args::{Cli, InfoArgs};
use crate::commands::make::simulate::energy_balance;
use crate::commands::{Loaded, Yarn, load_any};
use crate::failure::{Failure, Outcome};
use crate::kinds::{self, InputKind};
use crate::output;
use crate::progress::Bar;
use crate::report::{self, Spread, number};
use crate::yarn_words::yarn_line;
use plywave::ply::{EnergiesAt, PlyData};
use plywave::spec::{Packing, YarnSpec};
use plywave_sim::PlySection;
use plywave_tables::table::Table;
use std::io::Write;
use std::path::Path;

/// Common data of tables and models.
#[derive(serde::Serialize)]
struct Head {
    file: String,
    kind: &'static str,
    bytes: u64,
    name: String,
    program_version: String,
    preset: String,
    seed: u64,
    ply_radius_um: f64,
    theta_i_deg: Vec<f64>,
    h_um: Vec<f64>,
    h_rel: Vec<f64>,
    sigma_per_um: Vec<f64>,
}

/// Energies over the incidences.
#[derive(serde::Serialize)]
struct Energies {
    r_d: Vec<Vec<f64>>,
    energy_refl: Vec<Vec<f64>>,
    energy_high: Vec<Vec<Vec<f64>>>,
}

/// A flat array `[rows][..]` as rows.
fn rows<T: Clone>(values: &[T], rows: usize) -> Vec<Vec<T>> {
    values.chunks((values.len() / rows.max(1)).max(1)).map(<[T]>::to_vec).collect()
}

/// Energies of a model at the nodes of its lobes: r_d and f_refl `[theta_i][h]`, f_high
/// `[theta_i][h][sigma]`.
pub struct NodeEnergies {
    pub r_d: Vec<f64>,
    pub refl: Vec<f64>,
    pub high: Vec<f64>,
}

impl NodeEnergies {
    pub fn from_data(data: &PlyData) -> NodeEnergies {
        let nodes = data.node_energies();
        let high = |e: &EnergiesAt| -> Vec<f64> {
            data.sigma_per_um.iter().map(|sigma| e.high_at(*sigma, &data.path_um)).collect()
        };
        NodeEnergies {
            r_d: nodes.iter().map(|e| e.r_d).collect(),
            refl: nodes.iter().map(|e| e.refl).collect(),
            high: nodes.iter().flat_map(high).collect(),
        }
    }
}

/// Offsets relative to R at which the probability to hit a fiber is printed.
const MET_AT: [f64; 8] = [0.0, 0.25, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0];
/// Number of plies of a spec that are packed for this probability, and number of rotations of each.
const MET_PLIES: u64 = 16;
const MET_TURNS: usize = 360;

/// Probability to hit a fiber as a function of h/R at normal incidence: of a line, or of a model's beam,
/// which blurs it.
#[derive(serde::Serialize)]
struct HitChance {
    h_rel: Vec<f64>,
    chance: Vec<f64>,
    of: &'static str,
}

impl HitChance {
    fn new(chance: impl Fn(f64) -> f64, of: &'static str) -> HitChance {
        HitChance { h_rel: MET_AT.to_vec(), chance: MET_AT.into_iter().map(chance).collect(), of }
    }

    /// Probability from a table's recorded lines, averaged over both sides.
    fn table(t: &Table, radius_um: f64) -> Option<HitChance> {
        let energies = t.energies.as_ref().filter(|e| !e.met.is_empty())?;
        let count = energies.met.len() / energies.miss_theta_i.len();
        let reach = energies.miss_h_um[energies.miss_h_um.len() - 1];
        let bin = |x: f64| (((x / reach + 1.0) * 0.5 * count as f64).max(0.0) as usize).min(count - 1);
        let at = |x: f64| f64::from(energies.met[bin(x)]);
        Some(HitChance::new(|h| 0.5 * (at(h * radius_um) + at(-h * radius_um)), "line"))
    }

    /// Probability of a model's beam.
    fn model(d: &PlyData, radius_um: f64) -> HitChance {
        HitChance::new(|h| 1.0 - d.energies.at(0.0, h * radius_um).r_d, "beam")
    }

    /// Probability of plies packed according to a spec.
    fn spec(cli: &Cli, spec: &YarnSpec, file: &str) -> Outcome<HitChance> {
        let bar = Bar::new("pack", "plies", cli.quiet);
        bar.begin("pack", MET_PLIES);
        let h_um: Vec<f64> = MET_AT.iter().map(|h| h * spec.ply_radii_um()[0]).collect();
        let mut chance = vec![0.0; h_um.len()];
        for seed in 0..MET_PLIES {
            let ply = PlySection::generate(spec, seed).map_err(|e| Failure::Input(format!("{file}: {e}")))?;
            for (sum, hit_chance) in chance.iter_mut().zip(ply.chance_to_meet(&h_um, MET_TURNS)) {
                *sum += hit_chance / MET_PLIES as f64;
            }
            bar.advance(1);
        }
        Ok(HitChance { h_rel: MET_AT.to_vec(), chance, of: "line" })
    }

    fn text(&self, out: &mut dyn Write) -> std::io::Result<()> {
        let list = |values: &[f64]| values.iter().map(|v| format!("{v:>6.3}")).collect::<Vec<_>>().join(" ");
        writeln!(out, "  hits         h/R {}", list(&self.h_rel))?;
        writeln!(out, "               {}  of the {}s at h hit a fiber", list(&self.chance), self.of)
    }
}

/// Prints a yarn spec: its yarn, the packing fraction of its ply, and the probability to hit a fiber.
fn spec(cli: &Cli, path: &Path) -> Outcome {
    let (spec, _) = plywave_textile::load_yarn_file(path)?;
    let file = path.display().to_string();
    let hit_chance = HitChance::spec(cli, &spec, &file)?;
    let packing = match spec.ply.packing {
        Packing::Falling => "falling",
        Packing::Lined => "lined",
    };
    if cli.json {
        return output::print_json(&serde_json::json!({
            "file": file, "kind": "yarn spec", "name": spec.name, "ply_radius_um": spec.ply_radii_um()[0],
            "packing": packing, "packing_fraction": spec.packing_fraction(), "chance_to_meet": hit_chance,
        }));
    }
    output::print(|out| {
        writeln!(out, "{file}: yarn spec of {}", crate::failure::one_line(&spec.name))?;
        writeln!(out, "  yarn         {}", yarn_line(&spec))?;
        writeln!(out, "  packing      {packing}, fibers fill {:.3} of the ply", spec.packing_fraction())?;
        hit_chance.text(out)
    })
}

/// Runs the command.
pub fn run(cli: &Cli, args: &InfoArgs) -> Outcome {
    if kinds::kind_of(&args.file) == Some(InputKind::Yarn) {
        return spec(cli, &args.file);
    }
    let bytes = match kinds::is_named(&args.file) {
        true => cli.library()?.read(&args.file)?.1.len() as u64,
        false => std::fs::metadata(&args.file).map_or(0, |m| m.len()),
    };
    let file = args.file.display().to_string();
    match load_any(cli, &args.file)? {
        Loaded::Table(t) => {
            let yarn = Yarn::from_spec(&args.file, &t.spec_text, &t.h_um)?;
            let head = Head {
                file,
                kind: "table",
                bytes,
                name: yarn.spec.name.clone(),
                program_version: t.program_version.clone(),
                preset: t.preset.clone(),
                seed: t.seed,
                ply_radius_um: yarn.radius_um,
                theta_i_deg: t.theta_i.iter().map(|v| v.to_degrees()).collect(),
                h_rel: t.h_um.iter().map(|h| h / yarn.radius_um).collect(),
                h_um: t.h_um.clone(),
                sigma_per_um: t.sigma_per_um.clone(),
            };
            let hit_chance = HitChance::table(&t, yarn.radius_um);
            if cli.json { table_json(&head, &t, hit_chance) } else { table_text(&head, &yarn.spec, &t, hit_chance) }
        }
        Loaded::Model(m) => {
            let d = m.data();
            let yarn = Yarn::from_spec(&args.file, &d.spec_text, &d.h_um)?;
            let head = Head {
                file,
                kind: "model",
                bytes,
                name: yarn.spec.name.clone(),
                program_version: d.program_version.clone(),
                preset: d.preset.clone(),
                seed: d.seed,
                ply_radius_um: yarn.radius_um,
                theta_i_deg: d.theta_i.iter().map(|v| v.to_degrees()).collect(),
                h_rel: d.h_um.iter().map(|h| h / yarn.radius_um).collect(),
                h_um: d.h_um.clone(),
                sigma_per_um: d.sigma_per_um.clone(),
            };
            let hit_chance = HitChance::model(d, yarn.radius_um);
            if cli.json { model_json(&head, d, hit_chance) } else { model_text(&head, &yarn.spec, d, hit_chance) }
        }
        Loaded::Fiber(t) => crate::commands::look::info_fiber::run(cli, &file, bytes, &t),
        Loaded::Speckle(p) => crate::commands::wave::speckle_view::info(cli, &file, bytes, &p),
        Loaded::Family(family) => crate::commands::make::family::info(cli, &args.file, bytes, &family),
        Loaded::Cloth(cloth) => crate::commands::make::cloth_file::info(cli, &args.file, bytes, *cloth),
        Loaded::Twin(twin) => crate::commands::make::twin::info(cli, &args.file, bytes, &twin),
    }
}

fn table_json(head: &Head, t: &Table, hit_chance: Option<HitChance>) -> Outcome {
    let m = t.theta_i.len();
    let sigmas = t.sigma_per_um.len();
    output::print_json(&serde_json::json!({
        "file": head.file, "kind": head.kind, "bytes": head.bytes, "name": head.name,
        "program_version": head.program_version, "preset": head.preset, "seed": head.seed,
        "plies": t.plies, "traced": t.traced, "exit_positions": t.exit.is_some(),
        "ply_radius_um": head.ply_radius_um,
        "theta_i_deg": head.theta_i_deg, "h_um": head.h_um, "h_rel": head.h_rel, "sigma_per_um": head.sigma_per_um,
        "theta_o_bins": t.grid.theta_o, "phi_o_bins": t.grid.phi_o,
        "paths": t.paths, "interactions_per_path": t.interactions,
        "energies": Energies {
            r_d: rows(&t.r_d, m),
            energy_refl: rows(&t.energy_refl, m),
            energy_high: rows(&rows(&t.energy_high, t.energy_high.len() / sigmas.max(1)), m),
        },
        "chance_to_meet": hit_chance,
        "energy_balance_max_standard_errors": energy_balance(t),
        "energy_killed_max": t.energy_killed.iter().copied().fold(0.0, f64::max),
        "spec": t.spec_text,
    }))
}

fn model_json(head: &Head, d: &PlyData, hit_chance: HitChance) -> Outcome {
    let m = d.theta_i.len();
    let sigmas = d.sigma_per_um.len();
    let NodeEnergies { r_d, refl, high } = NodeEnergies::from_data(d);
    output::print_json(&serde_json::json!({
        "file": head.file, "kind": head.kind, "bytes": head.bytes, "name": head.name,
        "program_version": head.program_version, "preset": head.preset, "seed": head.seed,
        "ply_radius_um": head.ply_radius_um,
        "theta_i_deg": head.theta_i_deg, "h_um": head.h_um, "h_rel": head.h_rel, "sigma_per_um": head.sigma_per_um,
        "path_um": d.path_um, "lobes_refl": d.lobes_refl, "lobes_high": d.lobes_high,
        "energies": Energies {
            r_d: rows(&r_d, m),
            energy_refl: rows(&refl, m),
            energy_high: rows(&rows(&high, high.len() / sigmas.max(1)), m),
        },
        "chance_to_meet": hit_chance,
        "fit_error_refl": rows(&d.error_refl, m),
        "fit_error_high": rows(&rows(&d.error_high, d.error_high.len() / sigmas.max(1)), m),
        "spec": d.spec_text,
    }))
}

fn head_text(out: &mut dyn Write, head: &Head, spec: &YarnSpec) -> std::io::Result<()> {
    // Names and versions come from the file, so control characters are removed.
    let clean = crate::failure::one_line;
    writeln!(out, "{}: {} of {}, {}", head.file, head.kind, clean(&head.name), report::bytes(head.bytes))?;
    writeln!(
        out,
        "  written by   plywave {}, preset {}, seed {}",
        clean(&head.program_version),
        clean(&head.preset),
        head.seed
    )?;
    writeln!(out, "  yarn         {}", yarn_line(spec))?;
    if spec.fiber.is_opaque() {
        let own = [0.45, 0.55, 0.65].map(|l| format!("{:.5} at {}", spec.own_sigma_per_um(l), number(l)));
        writeln!(out, "  own color    sigma {} um [1/um]", own.join(", "))?;
    }
    let last = |v: &[f64]| v.last().copied().unwrap_or(0.0);
    writeln!(
        out,
        "  incidence    {} theta_i from 0 to {} degrees, {} h from {} to {} um ({} R)",
        head.theta_i_deg.len(),
        number(last(&head.theta_i_deg)),
        head.h_um.len(),
        number(head.h_um.first().copied().unwrap_or(0.0)),
        number(last(&head.h_um)),
        number(last(&head.h_rel))
    )?;
    let sigma: Vec<String> = head.sigma_per_um.iter().map(|s| number(*s)).collect();
    writeln!(out, "  absorption   sigma {} per um", sigma.join(", "))
}

/// Energies at the offset nearest to the center, one line per latitude.
fn energies_text(
    out: &mut dyn Write,
    head: &Head,
    refl: &[f64],
    high: &[f64],
    r_d: &[f64],
    error: Option<(&[f64], &[f64])>,
) -> std::io::Result<()> {
    let (columns, sigmas) = (head.h_um.len(), head.sigma_per_um.len());
    let errors = if error.is_some() { "   error refl   error high" } else { "" };
    writeln!(out, "  at h = 0     theta_i     refl   high   r_d      sum   high at largest sigma{errors}")?;
    for (m, theta) in head.theta_i_deg.iter().enumerate() {
        let at = m * columns + columns / 2;
        let (first, last) = (high[at * sigmas], high[at * sigmas + sigmas - 1]);
        write!(
            out,
            "               {:>5} deg {:>8.4} {first:>6.4} {:>6.4} {:>7.4}   {last:>6.4}",
            number((theta * 10.0).round() / 10.0),
            refl[at],
            r_d[at],
            refl[at] + first + r_d[at]
        )?;
        match error {
            Some((error_refl, error_high)) => {
                let known = |v: f64| if v > 0.0 { format!("{v:.4}") } else { "-".into() };
                let (refl, high) = (known(error_refl[at]), known(error_high[at * sigmas]));
                writeln!(out, "                  {refl:>10}   {high:>10}")?;
            }
            None => writeln!(out)?,
        }
    }
    Ok(())
}

fn table_text(head: &Head, spec: &YarnSpec, t: &Table, hit_chance: Option<HitChance>) -> Outcome {
    output::print(|out| {
        head_text(out, head, spec)?;
        let scatters = match (t.plies, t.traced) {
            (1, _) => "one ply".to_string(),
            (plies, false) => format!("the yarn of {plies} plies"),
            (plies, true) => format!("the yarn of {plies} plies, traced together"),
        };
        writeln!(out, "  scatters     {scatters}")?;
        writeln!(out, "  outgoing     {} x {} bins (theta_o, phi_o)", t.grid.theta_o, t.grid.phi_o)?;
        let paths = t.paths.iter().sum::<u64>() as f64;
        let interactions = Spread::from_values(t.interactions.iter().copied());
        writeln!(
            out,
            "  paths        {} in all, {:.1} to {:.1} interactions a path",
            report::count(paths),
            interactions.min,
            interactions.max
        )?;
        writeln!(
            out,
            "  energy       refl + high + r_d = 1 within {:.1} standard errors, at most {} stopped at the interaction limit",
            energy_balance(t),
            number(t.energy_killed.iter().copied().fold(0.0, f64::max))
        )?;
        if let Some(hit_chance) = &hit_chance {
            hit_chance.text(out)?;
        }
        energies_text(out, head, &t.energy_refl, &t.energy_high, &t.r_d, None)
    })
}

fn model_text(head: &Head, spec: &YarnSpec, d: &PlyData, hit_chance: HitChance) -> Outcome {
    let sigmas = d.sigma_per_um.len();
    output::print(|out| {
        head_text(out, head, spec)?;
        writeln!(
            out,
            "  lobes        {}: {} of f_refl an incidence, {} of f_high a block corner",
            d.family.name(),
            d.lobes_refl,
            d.lobes_high
        )?;
        writeln!(
            out,
            "  spectra      {} path lengths from {} to {} um",
            d.path_um.len(),
            number(d.path_um.first().copied().unwrap_or(0.0)),
            number(d.path_um.last().copied().unwrap_or(0.0))
        )?;
        writeln!(out, "  fit error    f_refl {}", Spread::of_errors(d.error_refl.iter().copied()))?;
        for (k, sigma) in d.sigma_per_um.iter().enumerate() {
            let error = Spread::of_errors(d.error_high.iter().copied().skip(k).step_by(sigmas));
            writeln!(out, "               f_high {error} at sigma {}", number(*sigma))?;
        }
        hit_chance.text(out)?;
        let e = NodeEnergies::from_data(d);
        energies_text(out, head, &e.refl, &e.high, &e.r_d, Some((&d.error_refl, &d.error_high)))
    })
}
