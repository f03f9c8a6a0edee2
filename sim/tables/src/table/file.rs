//! Table files: writing, reading, and checks of lengths, axes, ranges and energies
//! (`docs/reference/format/models.md`).

use super::{DISPLACEMENTS, ExitPositions, OutgoingGrid, Table, TableEnergies, energies};
use plywave::Result;
use plywave::io::{Axis, Check, Document, FileKind, Provenance, Reader, Summary, Writer, invalid};
use plywave::ply::{DRIFT_BINS, ENERGY_TOLERANCE as TOLERANCE};

const NAMES: [&str; 17] = [
    "theta_i",
    "h_um",
    "sigma_per_um",
    "r_d",
    "energy_refl",
    "energy_high",
    "energy_se",
    "energy_killed",
    "refl",
    "high",
    "noise_refl",
    "noise_high",
    "paths",
    "interactions",
    "exit",
    "met",
    "drift",
];

/// Keys of the JSON document besides the common ones.
#[derive(serde::Serialize, serde::Deserialize)]
pub struct TableKeys {
    #[serde(default = "one")]
    plies: u32,
    #[serde(default)]
    traced: bool,
}

fn one() -> u32 {
    1
}

impl Table {
    /// Checks that a table is valid, when read or written: lengths, axes, ranges and finiteness. `name`
    /// identifies the file in errors.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`].
    pub fn check(&self, name: &str) -> Result<()> {
        Document::check(self, name)
    }
}

impl Document for Table {
    const KIND: FileKind = FileKind::Table;
    type Keys = TableKeys;

    fn names() -> Vec<&'static str> {
        [&NAMES[..], &energies::NAMES].concat()
    }

    fn provenance(&self) -> Provenance {
        Provenance {
            program_version: self.program_version.clone(),
            preset: self.preset.clone(),
            seed: self.seed,
            spec: self.spec_text.clone(),
        }
    }

    fn keys(&self, _: &str) -> Result<TableKeys> {
        Ok(TableKeys { plies: self.plies, traced: self.traced })
    }

    fn summary(&self) -> (Vec<Axis>, serde_json::Value) {
        let (m, h, k) = (self.theta_i.len(), self.h_um.len(), self.sigma_per_um.len());
        let (t, p) = (self.grid.theta_o, self.grid.phi_o);
        let high = || self.energy_high.chunks_exact(k).map(|e| e[0]);
        let sum = self.r_d.iter().zip(&self.energy_refl).zip(high()).map(|((d, r), e)| d + r + e - 1.0);
        let axes = vec![
            Axis::new("theta_i", "rad", m),
            Axis::new("h_um", "um", h),
            Axis::new("sigma_per_um", "1/um", k),
            Axis::new("theta_o", "rad", t),
            Axis::new("phi_o", "rad", p),
        ];
        let statistics = serde_json::json!({
            "r_d": Summary::from_values(self.r_d.iter().copied()),
            "energy_refl": Summary::from_values(self.energy_refl.iter().copied()),
            "energy_high_sigma_0": Summary::from_values(high()),
            "energy_killed": Summary::from_values(self.energy_killed.iter().copied()),
            "energy_sum_minus_1": Summary::from_values(sum),
            "paths": self.paths.iter().fold(0u64, |a, b| a.saturating_add(*b)),
            "interactions": Summary::from_values(self.interactions.iter().copied()),
        });
        (axes, statistics)
    }

    fn tensors(&self, w: &mut Writer) {
        let (m, h, k) = (self.theta_i.len(), self.h_um.len(), self.sigma_per_um.len());
        let (t, p) = (self.grid.theta_o, self.grid.phi_o);
        w.f64("theta_i", &[m], &self.theta_i);
        w.f64("h_um", &[h], &self.h_um);
        w.f64("sigma_per_um", &[k], &self.sigma_per_um);
        w.f64("r_d", &[m, h], &self.r_d);
        w.f64("energy_refl", &[m, h], &self.energy_refl);
        w.f64("energy_high", &[m, h, k], &self.energy_high);
        w.f64("energy_se", &[m, h], &self.energy_se);
        w.f64("energy_killed", &[m, h], &self.energy_killed);
        w.f32("refl", &[m, h, t, p], self.refl.iter().copied());
        w.f32("high", &[m, h, k, t, p], self.high.iter().copied());
        w.f64("noise_refl", &[m, h], &self.noise_refl);
        w.f64("noise_high", &[m, h, k], &self.noise_high);
        w.u64("paths", &[m], &self.paths);
        w.f64("interactions", &[m], &self.interactions);
        if let Some(e) = &self.exit {
            w.f32("exit", &[m, h, 1 + k, e.azimuths, e.positions], e.shares.iter().copied());
            w.f32("met", &[m, e.met.len() / m], e.met.iter().copied());
            w.f32("drift", &[m, DRIFT_BINS, DISPLACEMENTS, k], e.drift.iter().copied());
        }
        if let Some(energies) = &self.energies {
            energies.write(w);
        }
    }

    fn read(r: &Reader<'_>, p: Provenance, keys: &TableKeys) -> Result<Table> {
        let (m, h, k) = (r.shape("theta_i", 1)?[0], r.shape("h_um", 1)?[0], r.shape("sigma_per_um", 1)?[0]);
        let bins = r.shape("refl", 4)?;
        let (theta_o, phi_o) = (bins[2], bins[3]);
        let exit = match r.has("exit") || r.has("met") {
            false => None,
            true => {
                let (shape, hit_shape) = (r.shape("exit", 5)?, r.shape("met", 2)?);
                let (azimuths, positions) = (shape[3], shape[4]);
                let shares = r.f32("exit", &[m, h, 1 + k, azimuths, positions])?;
                let met = r.f32("met", &[m, hit_shape[1]])?;
                let drift = r.f32("drift", &[m, DRIFT_BINS, DISPLACEMENTS, k])?;
                Some(ExitPositions { azimuths, positions, shares, met, drift })
            }
        };
        Ok(Table {
            spec_text: p.spec,
            program_version: p.program_version,
            preset: p.preset,
            seed: p.seed,
            plies: keys.plies,
            traced: keys.traced,
            theta_i: r.f64("theta_i", &[m])?,
            h_um: r.f64("h_um", &[h])?,
            sigma_per_um: r.f64("sigma_per_um", &[k])?,
            grid: OutgoingGrid { theta_o, phi_o },
            r_d: r.f64("r_d", &[m, h])?,
            energy_refl: r.f64("energy_refl", &[m, h])?,
            energy_high: r.f64("energy_high", &[m, h, k])?,
            energy_se: r.f64("energy_se", &[m, h])?,
            energy_killed: r.f64("energy_killed", &[m, h])?,
            refl: r.f32("refl", &[m, h, theta_o, phi_o])?,
            high: r.f32("high", &[m, h, k, theta_o, phi_o])?,
            noise_refl: r.f64("noise_refl", &[m, h])?,
            noise_high: r.f64("noise_high", &[m, h, k])?,
            paths: r.u64("paths", &[m])?,
            interactions: r.f64("interactions", &[m])?,
            exit,
            energies: TableEnergies::read(r, k)?,
        })
    }

    fn check(&self, name: &str) -> Result<()> {
        let c = Check(name);
        let (m, h, k) = (self.theta_i.len(), self.h_um.len(), self.sigma_per_um.len());
        let (t, p) = (self.grid.theta_o, self.grid.phi_o);
        for (axis, size) in [("theta_i", m), ("h_um", h), ("sigma_per_um", k), ("theta_o bins", t), ("phi_o bins", p)] {
            if size == 0 {
                return Err(invalid(name, axis, "0 values", "expected at least 1"));
            }
        }
        c.theta_axis(&self.theta_i)?;
        c.h_axis(&self.h_um)?;
        c.sigma_axis(&self.sigma_per_um)?;
        for (key, values, shape) in [
            ("r_d", &self.r_d, &[m, h][..]),
            ("energy_refl", &self.energy_refl, &[m, h]),
            ("energy_high", &self.energy_high, &[m, h, k]),
            ("energy_se", &self.energy_se, &[m, h]),
            ("energy_killed", &self.energy_killed, &[m, h]),
        ] {
            c.len(key, values.len(), shape)?;
            c.range(key, values, 0.0, 1.0 + TOLERANCE)?;
        }
        for (key, values, shape) in [
            ("noise_refl", &self.noise_refl, &[m, h][..]),
            ("noise_high", &self.noise_high, &[m, h, k]),
            ("interactions", &self.interactions, &[m]),
        ] {
            c.len(key, values.len(), shape)?;
            c.range(key, values, 0.0, f64::MAX)?;
        }
        c.len("paths", self.paths.len(), &[m])?;
        c.len("refl", self.refl.len(), &[m, h, t, p])?;
        c.len("high", self.high.len(), &[m, h, k, t, p])?;
        c.range_f32("refl", &self.refl, 0.0, f32::MAX)?;
        c.range_f32("high", &self.high, 0.0, f32::MAX)?;
        if !(1..=7).contains(&self.plies) {
            return Err(invalid(name, "plies", self.plies, "expected 1 to 7"));
        }
        if self.traced && self.plies == 1 {
            return Err(invalid(name, "traced", true, "expected false of one ply"));
        }
        if let Some(e) = &self.exit {
            let x = e.met.len() / m;
            if e.azimuths == 0 || e.positions == 0 || x < 2 {
                return Err(invalid(name, "exit", "an empty axis", "expected 1 azimuth, 1 position, 2 of met or more"));
            }
            c.len("exit", e.shares.len(), &[m, h, 1 + k, e.azimuths, e.positions])?;
            c.len("met", e.met.len(), &[m, x])?;
            c.range_f32("exit", &e.shares, 0.0, 1.001)?;
            c.range_f32("met", &e.met, 0.0, 1.0)?;
            c.len("drift", e.drift.len(), &[m, DRIFT_BINS, DISPLACEMENTS, k])?;
            c.range_f32("drift", &e.drift, 0.0, 1.001)?;
            for (i, shares) in e.shares.chunks_exact(e.positions).enumerate() {
                let sum: f32 = shares.iter().sum();
                if (sum - 1.0).abs() > 1e-3 {
                    return Err(invalid(name, &format!("exit, row {i}"), sum, "expected shares that add up to 1"));
                }
            }
        }
        if let Some(energies) = &self.energies {
            energies.check(&c, &self.theta_i, &self.h_um, k)?;
        }
        for (i, e) in self.energy_high.chunks_exact(k).enumerate() {
            let sum = self.r_d[i] + self.energy_refl[i] + e[0];
            if sum > 1.0 + TOLERANCE {
                let key = format!("r_d + energy_refl + energy_high at incidence {i}");
                return Err(invalid(name, &key, sum, &format!("expected at most {}", 1.0 + TOLERANCE)));
            }
        }
        Ok(())
    }
}
