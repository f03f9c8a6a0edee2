//! The models and fabrics of the gallery. Those that ship are copied into its folder, made whole where they lack edge lobes, layer factors or, of round fibers, speckle; the
//! others are built there from a yarn spec that ships, with one key changed.

use super::digest;
use crate::args::{Cli, Preset, RunArgs};
use crate::commands::{fit, on_threads, simulate};
use crate::failure::{Failure, Outcome};
use crate::progress::{self, Bar};
use crate::{commands, output};
use plywave::{PlyData, PlyModel, Shape, YarnSpec};
use plywave_fit::speckle::NoiseOptions;
use plywave_sim::Run;
use plywave_sim::wave::{SpeckleOptions, speckle};
use std::path::{Path, PathBuf};

/// A model.
#[derive(Clone, Debug, PartialEq)]
pub enum Ply {
    /// Of `fabrics/models/NAME.pwm`.
    Shipped(&'static str),
    /// Built at preview quality from the spec of a yarn that ships, with other values of some keys.
    Built {
        /// Name of the file.
        name: String,
        /// The spec.
        from: &'static str,
        /// Keys of it and their values.
        changes: Vec<(&'static str, String)>,
    },
}

impl Ply {
    /// Polyester whose fibers have the outline of cotton's: kidneys, of the size at which as many of them still pack into the ply.
    pub fn kidneys() -> Ply {
        let shape = "{ kind = \"kidney\", a_um = 9.6, b_um = 5.1, dent = 0.35, lumen = 0.5 }";
        Ply::Built { name: "polyester_kidneys".into(), from: "polyester", changes: vec![("shape", shape.into())] }
    }

    /// Polyester of another pitch of the fibers [um].
    pub fn pitch(pitch_um: f64) -> Ply {
        let changes = vec![("fiber_pitch_um", format!("{pitch_um:.1}"))];
        Ply::Built { name: format!("polyester_pitch_{pitch_um:.0}"), from: "polyester", changes }
    }

    fn name(&self) -> &str {
        match self {
            Ply::Shipped(name) => name,
            Ply::Built { name, .. } => name,
        }
    }
}

/// A fabric that ships, of its own models or of another for warp and weft.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloth {
    fabric: &'static str,
    ply: Option<Ply>,
}

impl Cloth {
    /// As it ships.
    pub fn shipped(fabric: &'static str) -> Cloth {
        Cloth { fabric, ply: None }
    }

    /// Of another ply.
    pub fn of(fabric: &'static str, ply: Ply) -> Cloth {
        Cloth { fabric, ply: Some(ply) }
    }

    /// Name of its file.
    pub fn name(&self) -> String {
        match &self.ply {
            None => self.fabric.into(),
            Some(ply) => format!("{}_of_{}", self.fabric, ply.name()),
        }
    }
}

/// Where materials come from and go.
pub struct Workshop<'a> {
    /// The command line.
    pub cli: &'a Cli,
    /// Specs and models that ship.
    pub from: &'a Path,
    /// The gallery's folder.
    pub to: &'a Path,
    /// Whether models are made with few paths.
    pub quick: bool,
}

/// A TOML text with the values of some keys changed; `None` where one is not there.
fn with_keys(text: &str, changes: &[(&str, String)]) -> Option<String> {
    let mut changed = vec![false; changes.len()];
    let lines = text.lines().map(|line| {
        let key = line.split('=').next().unwrap_or("").trim();
        match changes.iter().position(|(name, _)| *name == key && line.contains('=')) {
            Some(at) => {
                changed[at] = true;
                format!("{key} = {}\n", changes[at].1)
            }
            None => format!("{line}\n"),
        }
    });
    let text: String = lines.collect();
    changed.iter().all(|c| *c).then_some(text)
}

fn read(path: &Path) -> Outcome<String> {
    let bad = |e: std::io::Error| match e.kind() {
        std::io::ErrorKind::NotFound => Failure::Input(format!(
            "{}: no such file; give the folder of the fabrics that ship by --fabrics",
            path.display()
        )),
        _ => Failure::Input(format!("{}: {e}", path.display())),
    };
    std::fs::read_to_string(path).map_err(bad)
}

impl Workshop<'_> {
    /// Paths and instances of a model that is built; the preset's where there are none.
    fn sizes(&self) -> (Option<u64>, Option<u32>) {
        if self.quick { (Some(60_000), Some(4)) } else { (None, None) }
    }

    /// Fibers whose speckle is solved.
    fn speckle_fibers(&self) -> u32 {
        if self.quick { 16 } else { 100 }
    }

    /// Whether the specs of a fabric are there.
    pub fn check(&self, cloth: &Cloth) -> Outcome {
        read(&self.from.join(format!("{}.toml", cloth.fabric)))?;
        match &cloth.ply {
            Some(Ply::Built { from, .. }) => read(&self.from.join(format!("{from}.toml"))).map(|_| ()),
            _ => Ok(()),
        }
    }

    /// Makes the fabric's file and its models, where they are not there yet; gives its path.
    pub fn cloth(&self, cloth: &Cloth) -> Outcome<PathBuf> {
        let source = self.from.join(format!("{}.toml", cloth.fabric));
        let text = read(&source)?;
        let mut lines = String::new();
        for line in text.lines() {
            let Some(name) = line.trim().strip_prefix("model = \"models/").and_then(|l| l.strip_suffix(".pwm\""))
            else {
                lines += &format!("{line}\n");
                continue;
            };
            let file = match &cloth.ply {
                Some(ply) => self.ply(ply)?,
                None => self.shipped(name)?,
            };
            lines += &format!("model = \"models/{file}.pwm\"\n");
        }
        let path = self.to.join("fabrics").join(format!("{}.toml", cloth.name()));
        if std::fs::read_to_string(&path).ok().as_deref() != Some(&lines) {
            output::write_whole(&path, lines.as_bytes())?;
        }
        Ok(path)
    }

    fn ply(&self, ply: &Ply) -> Outcome<String> {
        match ply {
            Ply::Shipped(name) => self.shipped(name),
            Ply::Built { name, from, changes } => {
                let file = self.from.join(format!("{from}.toml"));
                let text = with_keys(&read(&file)?, changes).ok_or_else(|| {
                    let keys: Vec<&str> = changes.iter().map(|c| c.0).collect();
                    Failure::input(file.display(), &keys.join(", "), "(absent)", "use the spec that ships")
                })?;
                self.built(name, &text, &file)
            }
        }
    }

    fn model_path(&self, name: &str) -> PathBuf {
        self.to.join("fabrics/models").join(format!("{name}.pwm"))
    }

    /// Whether a model was made from the same source before.
    fn is_made(&self, name: &str, mark: &str) -> bool {
        let path = self.model_path(name);
        path.is_file() && std::fs::read_to_string(path.with_extension("made_from")).is_ok_and(|m| m == mark)
    }

    fn keep(&self, name: &str, data: &PlyData, mark: &str) -> Outcome<String> {
        let path = self.model_path(name);
        data.save(&path)?;
        output::write_whole(&path.with_extension("made_from"), mark.as_bytes())?;
        Ok(name.into())
    }

    /// A model that ships, made whole.
    fn shipped(&self, name: &str) -> Outcome<String> {
        let path = self.from.join("models").join(format!("{name}.pwm"));
        let bytes = std::fs::read(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => {
                let hint = "no such file; give the folder of the fabrics that ship by --fabrics";
                Failure::Input(format!("{}: {hint}", path.display()))
            }
            _ => Failure::Input(format!("{}: {e}", path.display())),
        })?;
        let fibers = self.speckle_fibers();
        let mark = format!("{} {fibers}", digest(&bytes));
        if self.is_made(name, &mark) {
            return Ok(name.into());
        }
        let mut data = PlyModel::load(&path)?.data().clone();
        let spec = YarnSpec::parse(&data.spec_text, &format!("{} (its spec)", path.display()))?;
        if data.edge.is_none() {
            data.edge = Some(plywave_fit::fit_edge(&spec, &plywave_fit::EdgeOptions::default()).lobes);
        }
        if data.layers.is_none() {
            data.layers = Some(on_threads(self.cli, || plywave_fit::layer_factors(&data))?);
        }
        // Circles are solved in moments; other outlines take minutes a model (`plywave build`, `plywave noise`).
        if data.noise.is_none() && matches!(spec.fiber.shape, Shape::Circle { .. }) {
            let options = SpeckleOptions { instances: fibers, seed: data.seed, ..SpeckleOptions::default() };
            progress::install_stop();
            let bar = Bar::new("speckle", "fibers", self.cli.quiet);
            bar.begin("speckle", u64::from(fibers));
            let advance = |fibers: u64| bar.advance(fibers);
            let run = Run { parts: None, resume: false, stop: Some(&progress::STOP), progress: Some(&advance) };
            let text = data.spec_text.clone();
            let work = progress::stoppable(|| on_threads(self.cli, || speckle(&spec, &text, &options, run)));
            bar.finish();
            let patterns = work?.map_err(|error| commands::compare::refuse(error, &path))?;
            let options = NoiseOptions { seed: data.seed, w0_um: spec.beam.beam().w0_um, ..NoiseOptions::default() };
            data.noise = Some(plywave_fit::speckle::noise_tiles(&patterns, &options, &path.display().to_string())?.0);
        }
        self.keep(name, &data, &mark)
    }

    /// A model of a spec, at preview quality.
    fn built(&self, name: &str, text: &str, file: &Path) -> Outcome<String> {
        let (paths, instances) = self.sizes();
        let mark = format!("{} {paths:?} {instances:?}", digest(text.as_bytes()));
        if self.is_made(name, &mark) {
            return Ok(name.into());
        }
        let spec = YarnSpec::parse(text, &format!("{} ({name})", file.display()))?;
        let run = RunArgs { preset: Some(Preset::Preview), seed: 1, resume: true, paths, instances };
        let job = simulate::Job::of(file.into(), spec, text.into(), &run);
        // Shards of other sizes are not taken up.
        let parts = simulate::parts_of(&self.model_path(&format!("{name}-{}", digest(mark.as_bytes()))));
        let (table, _) = job.simulate(self.cli, &parts, true)?;
        let (data, _) = fit::fit_table(self.cli, file, &table, run.preset)?;
        simulate::remove_parts(&parts);
        self.keep(name, &data, &mark)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_changed_where_they_are() {
        let text = "# pitch = 2\n[ply]\npitch = 1\nother = 3\n";
        assert_eq!(with_keys(text, &[("pitch", "7".into())]).unwrap(), "# pitch = 2\n[ply]\npitch = 7\nother = 3\n");
        assert_eq!(with_keys(text, &[("none", "7".into())]), None);
    }

    #[test]
    fn built_plies_change_one_thing() {
        for (ply, seen) in [(Ply::kidneys(), "kidney"), (Ply::pitch(300.0), "300.0")] {
            let Ply::Built { from, changes, .. } = ply else { panic!() };
            let path = format!("{}/../fabrics/{from}.toml", env!("CARGO_MANIFEST_DIR"));
            let text = with_keys(&std::fs::read_to_string(path).unwrap(), &changes).unwrap();
            assert!(text.contains(seen));
            YarnSpec::parse(&text, "changed").unwrap();
        }
    }
}
