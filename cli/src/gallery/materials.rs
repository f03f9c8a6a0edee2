//! The models and fabrics of the gallery. Those that ship are copied into its folder, made whole where they lack edge lobes, layer factors or, of round fibers, speckle; the
//! others are built there from a yarn spec that ships, with one key changed.

use super::digest;
use crate::args::Cli;
use crate::commands::on_threads;
use crate::commands::runs::{failure, parts_of, pipeline_failure};
use crate::failure::{Failure, Outcome};
use crate::output;
use crate::progress::{self, PipelineBar};
use plywave::PlyModel;
use plywave::io::FileKind;
use plywave::ply::PlyData;
use plywave::spec::{Shape, YarnSpec};
use plywave_pipeline::{Quality, Recipe, Run, add_speckle, build, solve_speckle};
use plywave_sim::runs::{Found, PartsFolder};
use plywave_sim::wave::SpeckleOptions;
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
    pub fn new(fabric: &'static str, ply: Ply) -> Cloth {
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

/// Longest spec that is read [bytes].
const MAX_TEXT: u64 = 32 << 20;

fn read(path: &Path) -> Outcome<String> {
    plywave::io::read_text(path, MAX_TEXT).map_err(not_shipped)
}

/// Says where a file that ships is looked for.
fn not_shipped(error: plywave::Error) -> Failure {
    match error {
        plywave::Error::Io { file, source } if source.kind() == std::io::ErrorKind::NotFound => {
            Failure::Input(format!("{file}: no such file; give the folder of the fabrics that ship by --fabrics"))
        }
        other => other.into(),
    }
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
                let recipe = Recipe::changed(&file.display().to_string(), &read(&file)?, changes, Quality::Preview);
                let (paths, instances) = self.sizes();
                self.built(name, &Recipe { paths, instances, ..recipe.map_err(pipeline_failure)? })
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
        let bytes = plywave::io::read_file(&path, FileKind::Model.most_bytes()).map_err(not_shipped)?;
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
            let (text, file) = (data.spec_text.clone(), path.display().to_string());
            let patterns = self.staged(None, |run| solve_speckle(&spec, &text, &options, &file, run))?;
            add_speckle(&mut data, &patterns, &spec, &file).map_err(pipeline_failure)?;
        }
        self.keep(name, &data, &mark)
    }

    /// Runs a part of the pipeline with a bar, stoppable, on the threads that were asked for.
    fn staged<T: Send>(
        &self,
        parts: Option<&PartsFolder>,
        work: impl FnOnce(&Run<'_>) -> Result<T, plywave_pipeline::Error> + Send,
    ) -> Outcome<T> {
        progress::install_stop();
        let bar = PipelineBar::new(self.cli.quiet);
        let tell = |progress| bar.update(progress);
        let run = Run { parts, stop: Some(&progress::STOP), progress: Some(&tell), ..Run::plain() };
        let done = on_threads(self.cli, || work(&run));
        bar.finish();
        done?.map_err(pipeline_failure)
    }

    /// A model of a recipe at preview quality.
    fn built(&self, name: &str, recipe: &Recipe) -> Outcome<String> {
        let mark = format!("{} {:?} {:?}", digest(recipe.spec_text.as_bytes()), recipe.paths, recipe.instances);
        if self.is_made(name, &mark) {
            return Ok(name.into());
        }
        // Shards of other sizes have another folder.
        let parts = parts_of(&self.model_path(&format!("{name}-{}", digest(mark.as_bytes()))));
        let parts = PartsFolder::open(&parts, Found::Resume).map_err(|e| failure(e, &parts))?;
        let built = self.staged(Some(&parts), |run| build(recipe, run))?;
        parts.remove();
        self.keep(name, &built.model, &mark)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn built_plies_change_one_thing() {
        for (ply, seen) in [(Ply::kidneys(), "kidney"), (Ply::pitch(300.0), "300.0")] {
            let Ply::Built { from, changes, .. } = ply else { panic!() };
            let path = format!("{}/../fabrics/{from}.toml", env!("CARGO_MANIFEST_DIR"));
            let text = std::fs::read_to_string(path).unwrap();
            assert!(Recipe::changed(from, &text, &changes, Quality::Preview).unwrap().spec_text.contains(seen));
        }
    }
}
