//! Twin files: writing, reading, and checks of lengths, axes, ranges and energies
//! (`docs/reference/format/cloth.md`).

use super::{CLASSES, ClothTwin, SphereBins};
use plywave::Result;
use plywave::io::{Axis, Check, Document, FileKind, Provenance, Reader, Summary, Writer, invalid};

const NAMES: [&str; 15] = [
    "views",
    "sigma_per_um",
    "paths",
    "straight",
    "killed",
    "interactions",
    "reflected",
    "transmitted",
    "reflected_se",
    "transmitted_se",
    "by_yarns",
    "by_plies",
    "density",
    "variance",
    "image",
];

/// Keys of the JSON document besides the common ones.
#[derive(serde::Serialize, serde::Deserialize)]
pub struct TwinKeys {
    repeat_um: [f64; 2],
    repeats: [u32; 2],
}

/// Maximum excess of a sum of fractions over 1, for rounding.
const ROUNDING: f64 = 1e-6;

impl Document for ClothTwin {
    const KIND: FileKind = FileKind::Twin;
    type Keys = TwinKeys;

    fn names() -> Vec<&'static str> {
        NAMES.to_vec()
    }

    fn provenance(&self) -> Provenance {
        Provenance {
            program_version: self.program_version.clone(),
            preset: self.name.clone(),
            seed: self.seed,
            spec: self.spec_text.clone(),
        }
    }

    fn keys(&self, _: &str) -> Result<TwinKeys> {
        Ok(TwinKeys { repeat_um: self.repeat_um, repeats: self.repeats })
    }

    fn summary(&self) -> (Vec<Axis>, serde_json::Value) {
        let axes = vec![
            Axis::new("view", "direction", self.view_count()),
            Axis::new("sigma_per_um", "1/um", self.sigma_count()),
            Axis::new("z", "1", self.bins.rows),
            Axis::new("azimuth", "rad", self.bins.columns),
        ];
        let statistics = serde_json::json!({
            "straight": Summary::from_values(self.straight.iter().copied()),
            "reflected": Summary::from_values(self.reflected.iter().copied()),
            "transmitted": Summary::from_values(self.transmitted.iter().copied()),
            "killed": Summary::from_values(self.killed.iter().copied()),
            "interactions": Summary::from_values(self.interactions.iter().copied()),
            "paths": self.paths.iter().fold(0u64, |a, b| a.saturating_add(*b)),
        });
        (axes, statistics)
    }

    fn tensors(&self, w: &mut Writer) {
        let (v, k) = (self.view_count(), self.sigma_count());
        let SphereBins { rows, columns } = self.bins;
        let [x, y] = self.image_size;
        w.f64("views", &[v, 3], &self.views);
        w.f64("sigma_per_um", &[k, 2], &self.sigma_per_um);
        w.u64("paths", &[v], &self.paths);
        w.f64("straight", &[v], &self.straight);
        w.f64("killed", &[v], &self.killed);
        w.f64("interactions", &[v], &self.interactions);
        w.f64("reflected", &[v, k], &self.reflected);
        w.f64("transmitted", &[v, k], &self.transmitted);
        w.f64("reflected_se", &[v, k], &self.reflected_se);
        w.f64("transmitted_se", &[v, k], &self.transmitted_se);
        w.f64("by_yarns", &[v, k, 2, CLASSES], &self.by_yarns);
        w.f64("by_plies", &[v, k, 2, CLASSES], &self.by_plies);
        w.f32("density", &[v, k, rows, columns], self.density.iter().copied());
        w.f32("variance", &[v, k, rows, columns], self.variance.iter().copied());
        w.f32("image", &[v, k, y, x], self.image.iter().copied());
    }

    fn read(r: &Reader<'_>, p: Provenance, keys: &TwinKeys) -> Result<ClothTwin> {
        let (v, k) = (r.shape("views", 2)?[0], r.shape("sigma_per_um", 2)?[0]);
        let (bins, image) = (r.shape("density", 4)?, r.shape("image", 4)?);
        let (rows, columns) = (bins[2], bins[3]);
        let (y, x) = (image[2], image[3]);
        Ok(ClothTwin {
            spec_text: p.spec,
            program_version: p.program_version,
            name: p.preset,
            seed: p.seed,
            repeat_um: keys.repeat_um,
            repeats: keys.repeats,
            views: r.f64("views", &[v, 3])?,
            sigma_per_um: r.f64("sigma_per_um", &[k, 2])?,
            bins: SphereBins { rows, columns },
            paths: r.u64("paths", &[v])?,
            straight: r.f64("straight", &[v])?,
            killed: r.f64("killed", &[v])?,
            interactions: r.f64("interactions", &[v])?,
            reflected: r.f64("reflected", &[v, k])?,
            transmitted: r.f64("transmitted", &[v, k])?,
            reflected_se: r.f64("reflected_se", &[v, k])?,
            transmitted_se: r.f64("transmitted_se", &[v, k])?,
            by_yarns: r.f64("by_yarns", &[v, k, 2, CLASSES])?,
            by_plies: r.f64("by_plies", &[v, k, 2, CLASSES])?,
            density: r.f32("density", &[v, k, rows, columns])?,
            variance: r.f32("variance", &[v, k, rows, columns])?,
            image: r.f32("image", &[v, k, y, x])?,
            image_size: [x, y],
        })
    }

    fn check(&self, name: &str) -> Result<()> {
        let c = Check(name);
        let (v, k) = (self.view_count(), self.sigma_count());
        let SphereBins { rows, columns } = self.bins;
        let [x, y] = self.image_size;
        if rows == 0 || rows % 2 == 1 {
            return Err(invalid(name, "density", format!("{rows} rows of z"), "expected an even number, 2 or more"));
        }
        for (axis, size) in [("views", v), ("sigma_per_um", k), ("azimuths", columns), ("image", x), ("image", y)] {
            if size == 0 {
                return Err(invalid(name, axis, "0 values", "expected at least 1"));
            }
        }
        c.len("views", self.views.len(), &[v, 3])?;
        c.len("sigma_per_um", self.sigma_per_um.len(), &[k, 2])?;
        c.range("views", &self.views, -1.0, 1.0)?;
        c.range("sigma_per_um", &self.sigma_per_um, 0.0, 1e6)?;
        c.range("repeat_um", &self.repeat_um, f64::MIN_POSITIVE, f64::MAX)?;
        for view in 0..v {
            let [x, y, z] = self.view(view);
            if ((x * x + y * y + z * z) - 1.0).abs() > 1e-6 || z == 0.0 {
                let value = format!("[{x}, {y}, {z}]");
                return Err(invalid(name, &format!("views[{view}]"), value, "expected a unit vector out of the plane"));
            }
        }
        for (key, values) in
            [("straight", &self.straight), ("killed", &self.killed), ("interactions", &self.interactions)]
        {
            c.len(key, values.len(), &[v])?;
            c.range(key, values, 0.0, if key == "interactions" { f64::MAX } else { 1.0 + ROUNDING })?;
        }
        for (key, values) in [
            ("reflected", &self.reflected),
            ("transmitted", &self.transmitted),
            ("reflected_se", &self.reflected_se),
            ("transmitted_se", &self.transmitted_se),
        ] {
            c.len(key, values.len(), &[v, k])?;
            c.range(key, values, 0.0, 1.0 + ROUNDING)?;
        }
        for (key, values) in [("by_yarns", &self.by_yarns), ("by_plies", &self.by_plies)] {
            c.len(key, values.len(), &[v, k, 2, CLASSES])?;
            c.range(key, values, 0.0, 1.0 + ROUNDING)?;
        }
        c.len("paths", self.paths.len(), &[v])?;
        c.len("density", self.density.len(), &[v, k, rows, columns])?;
        c.len("variance", self.variance.len(), &[v, k, rows, columns])?;
        c.len("image", self.image.len(), &[v, k, y, x])?;
        c.range_f32("density", &self.density, 0.0, f32::MAX)?;
        c.range_f32("variance", &self.variance, 0.0, f32::MAX)?;
        c.range_f32("image", &self.image, 0.0, 1.0 + ROUNDING as f32)?;
        for at in 0..v * k {
            let sum = self.reflected[at] + self.transmitted[at] + self.straight[at / k] + self.killed[at / k];
            if sum > 1.0 + ROUNDING {
                let key = format!("reflected + transmitted + straight + killed of view {}", at / k);
                return Err(invalid(name, &key, sum, "expected at most 1"));
            }
        }
        Ok(())
    }
}
