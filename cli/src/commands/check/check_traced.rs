//! Compares the model of a yarn, and the table of its fit, with the path-traced yarn, the brute-force
//! reference (`plywave check --traced`).

use crate::args::Cli;
use crate::commands::Yarn;
use crate::commands::look::diff_tables::{root, rows_json, write_rows};
use crate::failure::{Failure, Outcome};
use crate::report::number;
use crate::threads::on_threads;
use plywave::ply::PlyData;
use plywave_fit::{TableDistance, model_distance, table_distance};
use plywave_tables::table::Table;
use std::io::Write;
use std::path::Path;

/// Largest incident latitude [degrees] and |h/R| that are compared.
const MAX_THETA_DEG: f64 = 40.0;
const MAX_H_REL: f64 = 0.9;
/// Absorptions [1/um] that are compared, and the largest relative L2 distance of f_high that passes at each.
const HELD: [(f64, f64); 2] = [(0.0, 0.10), (0.01, 0.15)];
/// Largest difference of an energy that passes.
const ENERGY: f64 = 0.01;

/// Distances of a model or table from the traced yarn.
struct Distance {
    /// Name of the compared object.
    what: &'static str,
    /// Names of its lines in the report.
    names: [&'static str; 3],
    d: TableDistance,
    /// Incidences of `d` that are compared.
    incidences: Vec<usize>,
}

impl Distance {
    /// Largest distance of f_high at each compared absorption, then of the energies; NaN if noise hides all.
    fn worst(&self) -> [f64; 3] {
        let sigmas = self.d.sigma_per_um.len();
        let high = HELD.map(|(sigma, _)| {
            let k = at_sigma(&self.d.sigma_per_um, sigma);
            let figures = self.incidences.iter().filter_map(|&i| root(self.d.high2[i * sigmas + k?]));
            figures.reduce(f64::max).unwrap_or(f64::NAN)
        });
        let energies = self.incidences.iter().flat_map(|&i| {
            let high = &self.d.energy_high[i * sigmas..(i + 1) * sigmas];
            high.iter().copied().chain([self.d.energy_refl[i], self.d.r_d[i]])
        });
        [high[0], high[1], energies.fold(0.0, |a: f64, e| a.max(e.abs()))]
    }
}

/// The comparison with a traced yarn.
pub struct TracedCheck {
    distances: Vec<Distance>,
    radius_um: f64,
    file: String,
}

fn at_sigma(sigmas: &[f64], sigma: f64) -> Option<usize> {
    sigmas.iter().position(|s| (s - sigma).abs() <= 1e-9 * (1.0 + sigma))
}

/// Compares the model and, if given, the table of its fit with `traced`.
pub fn measure(
    cli: &Cli,
    (model_file, data, yarn): (&Path, &PlyData, &Yarn),
    (traced_file, traced): (&Path, &Table),
    table: Option<(&Path, &Table)>,
) -> Outcome<TracedCheck> {
    let plies = yarn.spec.yarn.plies;
    if plies == 1 {
        let hint = "one ply has no traced yarn: leave it out";
        return Err(Failure::input(model_file.display(), "yarn.plies", plies, hint));
    }
    if !traced.traced {
        let hint = "must be true; make it with plywave simulate SPEC --plies traced";
        return Err(Failure::input(traced_file.display(), "traced", traced.traced, hint));
    }
    let other = Yarn::from_spec(traced_file, &traced.spec_text, &traced.h_um)?.spec;
    let same = [
        ("fiber", other.fiber == yarn.spec.fiber),
        ("ply", other.ply == yarn.spec.ply),
        ("yarn", other.yarn == yarn.spec.yarn),
        ("beam", other.beam == yarn.spec.beam),
    ];
    if let Some((key, _)) = same.iter().find(|(_, same)| !same) {
        let hint = format!("must be as in the spec of {}: it is of another yarn", model_file.display());
        return Err(Failure::input(traced_file.display(), key, "other values", &hint));
    }
    let refused = |e: plywave_fit::FitError| Failure::Input(format!("{}: {e}", traced_file.display()));
    let (theta_i, h_um) = (MAX_THETA_DEG.to_radians(), MAX_H_REL * yarn.radius_um);
    let mut all = vec![(
        "model",
        ["traced_high_sigma_0", "traced_high_sigma_0.01", "traced_energy"],
        on_threads(cli, || model_distance(data, traced, theta_i, h_um))?.map_err(refused)?,
    )];
    if let Some((file, table)) = table {
        let d = on_threads(cli, || table_distance(table, traced))?.map_err(refused)?;
        if table.plies != traced.plies {
            return Err(Failure::input(
                file.display(),
                "plies",
                table.plies,
                "must be those of the traced yarn; see fit --yarn-table",
            ));
        }
        all.push(("table", ["table_traced_sigma_0", "table_traced_sigma_0.01", "table_traced_energy"], d));
    }
    let mut distances = Vec::new();
    for (what, names, d) in all {
        let columns = d.h_um.len();
        let held = |i: &usize| {
            let (theta, h) = (d.theta_i[i / columns], d.h_um[i % columns].abs());
            theta <= theta_i * (1.0 + 1e-9) && h <= h_um * (1.0 + 1e-9)
        };
        let incidences: Vec<usize> = (0..d.refl2.len()).filter(held).collect();
        if incidences.is_empty() {
            let hint = "has no incidence up to 40 degrees and |h/R| 0.9 in common with the table";
            return Err(Failure::input(traced_file.display(), "theta_i, h_um", "other nodes", hint));
        }
        if let Some((sigma, _)) = HELD.iter().find(|s| at_sigma(&d.sigma_per_um, s.0).is_none()) {
            let values = d.sigma_per_um.iter().map(|s| number(*s)).collect::<Vec<_>>().join(", ");
            let hint = format!(
                "needs {sigma}; put 0 and 0.01 into absorption.sigma_per_um of the {what}'s spec and the traced yarn's"
            );
            return Err(Failure::input(traced_file.display(), "sigma_per_um", format!("[{values}]"), &hint));
        }
        distances.push(Distance { what, names, d, incidences });
    }
    Ok(TracedCheck { distances, radius_um: yarn.radius_um, file: traced_file.display().to_string() })
}

impl TracedCheck {
    /// Lines of the report: name, value, limit, meaning.
    pub fn lines(&self) -> Vec<(&'static str, f64, f64, &'static str)> {
        let mut out = Vec::new();
        for distance in &self.distances {
            let [a, b, energy] = distance.worst();
            let (l2, of_energy) = match distance.what {
                "model" => (
                    "f_high of the model, largest relative L2 distance to the traced yarn",
                    "energies and r_d of the model less those of the traced yarn",
                ),
                _ => (
                    "f_high of the table, largest relative L2 distance to the traced yarn",
                    "energies and r_d of the table less those of the traced yarn",
                ),
            };
            out.push((distance.names[0], a, HELD[0].1, l2));
            out.push((distance.names[1], b, HELD[1].1, l2));
            out.push((distance.names[2], energy, ENERGY, of_energy));
        }
        out
    }

    pub fn json(&self) -> serde_json::Value {
        let parts = self.distances.iter().map(|p| {
            let rows = rows_json(&p.d, &p.incidences, self.radius_um);
            (p.what.to_string(), serde_json::json!({ "sigma_per_um": p.d.sigma_per_um, "slices": rows }))
        });
        let mut object: serde_json::Map<_, _> = parts.collect();
        object.insert("file".into(), self.file.clone().into());
        serde_json::Value::Object(object)
    }

    pub fn write(&self, out: &mut dyn Write) -> std::io::Result<()> {
        for part in &self.distances {
            writeln!(out, "{} against the traced yarn", part.what)?;
            write_rows(out, &part.d, &part.incidences, self.radius_um)?;
        }
        Ok(())
    }
}
