//! Recipes of models: a spec, a quality, a seed and overrides.

use crate::error::Error;
use plywave::spec::YarnSpec;
use plywave_fit::FitOptions;
use plywave_sim::SimOptions;
use plywave_tables::speckle::SpecklePatterns;
use plywave_textile::{load_yarn, load_yarn_file};
use plywave_wave::TabulateOptions;
use std::path::Path;

/// Quality of a run: it selects the preset of each stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quality {
    /// For a first look: under a minute for polyester.
    Preview,
    /// For use: minutes.
    Standard,
    /// For comparison: hours.
    Reference,
}

impl Quality {
    /// Name of the quality in files.
    pub fn name(self) -> &'static str {
        match self {
            Quality::Preview => "preview",
            Quality::Standard => "standard",
            Quality::Reference => "reference",
        }
    }

    /// The quality of a preset's name in a file; unknown presets count as standard.
    pub fn of_preset(name: &str) -> Quality {
        match name {
            "preview" => Quality::Preview,
            "reference" => Quality::Reference,
            _ => Quality::Standard,
        }
    }

    /// Sizes of a simulation.
    pub fn simulation(self) -> SimOptions {
        match self {
            Quality::Preview => SimOptions::preview(),
            Quality::Standard => SimOptions::standard(),
            Quality::Reference => SimOptions::reference(),
        }
    }

    /// Effort of a fit.
    pub fn fit(self) -> FitOptions {
        match self {
            Quality::Preview => FitOptions::preview(),
            Quality::Standard => FitOptions::standard(),
            Quality::Reference => FitOptions::reference(),
        }
    }

    /// Sizes of a fiber table.
    pub fn tabulate(self) -> TabulateOptions {
        match self {
            Quality::Preview => TabulateOptions::preview(),
            Quality::Standard => TabulateOptions::standard(),
            Quality::Reference => TabulateOptions::reference(),
        }
    }
}

/// Source of a model's speckle.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Speckle {
    /// No speckle: a smooth model.
    None,
    /// The patterns of the spec's fiber are solved, except at preview quality.
    #[default]
    Usual,
    /// The patterns of this many instances of the spec's fiber are solved, at any quality.
    Solve(u32),
    /// The patterns come from a file with this name.
    Patterns(Box<SpecklePatterns>, String),
}

/// Recipe of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct Recipe {
    /// Name of the spec in messages.
    pub file: String,
    /// The yarn.
    pub spec: YarnSpec,
    /// Text of the spec, which table and model contain.
    pub spec_text: String,
    /// Quality of all stages.
    pub quality: Quality,
    /// Seed of all stages.
    pub seed: u64,
    /// Paths per incident latitude; overrides spec and quality.
    pub paths: Option<u64>,
    /// Instances of the ply; overrides spec and quality.
    pub instances: Option<u32>,
    /// Whether all plies of the yarn are traced together, as a reference for models; such a table cannot be
    /// fitted.
    pub traced_plies: bool,
    /// Source of the speckle.
    pub speckle: Speckle,
}

impl Recipe {
    /// Recipe for a parsed spec with the text `spec_text`, with seed 1 and no overrides.
    pub fn new(file: impl Into<String>, spec: YarnSpec, spec_text: impl Into<String>, quality: Quality) -> Recipe {
        Recipe {
            file: file.into(),
            spec,
            spec_text: spec_text.into(),
            quality,
            seed: 1,
            paths: None,
            instances: None,
            traced_plies: false,
            speckle: Speckle::Usual,
        }
    }

    /// Recipe for the file of a spec.
    ///
    /// # Errors
    /// Those of the file and of [`load_yarn`].
    pub fn load(path: impl AsRef<Path>, quality: Quality) -> Result<Recipe, Error> {
        let (spec, text) = load_yarn_file(&path)?;
        Ok(Recipe::new(path.as_ref().display().to_string(), spec, text, quality))
    }

    /// Recipe for the text of a spec in which some keys are overridden; `file` identifies the text in
    /// messages.
    ///
    /// # Errors
    /// [`Error::NoSuchKey`] for a key that the text does not contain, and those of [`load_yarn`] for
    /// the changed text.
    pub fn changed(file: &str, text: &str, changes: &[(&str, String)], quality: Quality) -> Result<Recipe, Error> {
        let text = with_keys(text, changes).map_err(|key| Error::NoSuchKey { file: file.into(), key: key.into() })?;
        let none = plywave::io::MemoryAssets::default();
        let (spec, text) = load_yarn(&text, &format!("{file} (changed)"), &none)?;
        Ok(Recipe::new(file, spec, text, quality))
    }

    /// Number of fiber instances whose speckle is solved: `None` if no speckle is solved, `Some(None)` for
    /// the default number.
    pub fn solved_speckle(&self) -> Option<Option<u32>> {
        match &self.speckle {
            Speckle::Usual if self.quality != Quality::Preview => Some(None),
            Speckle::Solve(instances) => Some(Some(*instances)),
            _ => None,
        }
    }

    /// Sizes of the simulation: those of the quality, overridden by the spec and then by the recipe.
    pub fn simulation(&self) -> SimOptions {
        let mut options = self.quality.simulation().overridden_by(&self.spec.simulation);
        options.seed = self.seed;
        options.paths_per_theta = self.paths.unwrap_or(options.paths_per_theta);
        options.instances = self.instances.unwrap_or(options.instances);
        options.traced_plies = self.traced_plies;
        options
    }
}

/// A TOML text with the values of some keys changed, in any table.
///
/// # Errors
/// The first key that the text does not contain.
pub fn with_keys<'a>(text: &str, changes: &'a [(&'a str, String)]) -> Result<String, &'a str> {
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
    match changed.iter().position(|changed| !changed) {
        None => Ok(text),
        Some(at) => Err(changes[at].0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_changed_where_they_are() {
        let text = "# pitch = 2\n[ply]\npitch = 1\nother = 3\n";
        let changed = with_keys(text, &[("pitch", "7".to_string())]).map_err(str::to_string);
        assert_eq!(changed, Ok("# pitch = 2\n[ply]\npitch = 7\nother = 3\n".into()));
        assert_eq!(with_keys(text, &[("none", "7".into())]), Err("none"));
    }

    #[test]
    fn overrides_take_precedence() {
        let text = format!("{}\n[simulation]\ninstances = 5\npaths_per_theta = 70\n", plywave::spec::POLYESTER);
        let spec = YarnSpec::parse(&text, "p.toml").unwrap();
        let recipe = Recipe { seed: 9, paths: Some(90), ..Recipe::new("p.toml", spec, text, Quality::Preview) };
        let options = recipe.simulation();
        assert_eq!((options.seed, options.paths_per_theta, options.instances), (9, 90, 5));
        assert_eq!(options.theta_i_nodes, SimOptions::preview().theta_i_nodes);
        for quality in [Quality::Preview, Quality::Standard, Quality::Reference] {
            assert_eq!(Quality::of_preset(quality.name()), quality);
            assert_eq!(SimOptions::preset(quality.name()), Some(quality.simulation()));
            assert_eq!(TabulateOptions::preset(quality.name()), Some(quality.tabulate()));
        }
    }
}
