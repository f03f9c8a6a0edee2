//! The command line. Angles are in degrees here and nowhere else; offsets are relative to the ply radius.

mod build;
mod export;
mod family;
mod farm;
mod hairs;
mod model;
mod new;
mod plot;
mod render;
mod shell;
mod swatch;
mod twin;
mod view;
mod wave;

pub use build::*;
pub use export::*;
pub use family::*;
pub use farm::*;
pub use hairs::*;
pub use model::*;
pub use new::*;
pub use plot::*;
pub use render::*;
pub use shell::*;
pub use swatch::*;
pub use twin::*;
pub use view::*;
pub use wave::*;

use crate::failure::{Failure, Outcome};
use clap::{Parser, Subcommand};
use plywave::io::ModelLibrary;
use std::path::PathBuf;

/// Simulates how a ply of fibers scatters light, fits a compact model to it, and inspects, checks, compares
/// and plots models.
#[derive(Debug, Parser)]
#[command(name = "plywave", version, max_term_width = 110)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Print only results and errors.
    #[arg(long, short, global = true)]
    pub quiet: bool,
    /// Print results as JSON.
    #[arg(long, global = true)]
    pub json: bool,
    /// Number of threads; results do not depend on it [default: one per core].
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: Option<u32>,
    /// Look up models given by name in this folder first (NAME stands for NAME.pwm), then in the folders of
    /// the variable PLYWAVE_MODELS and among the models that ship.
    #[arg(long, global = true, value_name = "DIR")]
    pub models: Option<PathBuf>,
}

impl Cli {
    /// The models that go by name.
    pub fn library(&self) -> Outcome<ModelLibrary> {
        let library = plywave_pipeline::model_library();
        match &self.models {
            None => Ok(library),
            Some(folder) if folder.is_dir() => Ok(library.with_folder(folder)),
            Some(folder) => Err(Failure::input(
                "command line",
                "--models",
                folder.display(),
                "is not a folder; give a folder of .pwm files",
            )),
        }
    }
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Simulate the scattering of a yarn's ply: spec (TOML) in, table (.pwt) out.
    Simulate(SimulateArgs),
    /// Fit a ply model to a table: table (.pwt) in, model (.pwm) out.
    Fit(FitArgs),
    /// Simulate and fit in one go. Without a spec: polyester, compiled in, at preview quality.
    Build(BuildArgs),
    /// Make a continuous family of yarns from a spec with ranges: spec (TOML) in, family (.pwfam) out; or
    /// extract a model (.pwm) from a family.
    Family(FamilyArgs),
    /// Print the contents of a yarn spec, a table, a model, a fiber or a file of speckle patterns.
    Info(InfoArgs),
    /// Evaluate a model at one incidence and one outgoing direction.
    Eval(EvalArgs),
    /// Sample outgoing directions of a model at one incidence, as CSV lines.
    Sample(SampleArgs),
    /// Check a model: furnace, eval against weight times pdf, chi-square of sampling, fit error of every
    /// slice. Exit code 1 when one fails.
    Check(CheckArgs),
    /// Compare two models, or two tables, slice by slice. Exit code 1 beyond the tolerance.
    Diff(DiffArgs),
    /// Draw a table or a model as PNG or SVG: false-color maps, energy budget, fit errors; for
    /// speckle patterns, curves and covariances.
    Plot(PlotArgs),
    /// Join the parts of a run that was divided with --shards: parts (.pwp) in, the run's output out.
    Merge(MergeArgs),
    /// Add speckle noise to a model: patterns (.pws) and a model (.pwm) in, the model with noise out.
    Noise(NoiseArgs),
    /// Find the absorption of a model's fibers for a color or a reflectance, by inverting its albedo.
    Color(ColorArgs),
    /// Write a cloth or yarn spec that ships with all that it needs into a folder: a name in, files out.
    /// Without a name: list them.
    New(NewArgs),
    /// Weave or knit a cloth: cloth spec (TOML) in, its measures, and a cloth (.pwc) or its curves out.
    Weave(WeaveArgs),
    /// Fit a cloth to photographs of a swatch, from the front and with a lamp behind: pictures (PNG) in, a
    /// cloth spec (TOML) with error bars out.
    Swatch(SwatchArgs),
    /// Write the hairs of a cloth as curves: cloth spec (TOML) or cloth (.pwc) in, and a mesh (OBJ) to put
    /// them on; Mitsuba's text of curves out.
    Hairs(HairsArgs),
    /// Path trace the explicit fibers of a cloth, without a model: cloth spec (TOML) in, its twin (.pwx)
    /// out. `check` compares the cloth with its twin.
    Twin(TwinArgs),
    /// Make the files of a library on many machines with Dask: library file (TOML) in; models, tables, twins
    /// and a report page out.
    Farm(FarmArgs),
    /// Wave optics of parallel fibers.
    Wave(WaveArgs),
    /// Compare wave and ray optics over instances of a ply's cross section: spec (TOML) in, folder with
    /// report.json and compare.png out.
    Compare(CompareArgs),
    /// Render a cloth in a ready-made scene: cloth (.pwc) or cloth spec (TOML) in, PNG and EXR out.
    Render(RenderArgs),
    /// Write a cloth for other programs: cloth (.pwc) or cloth spec (TOML) in; a report, a BSDF file or a
    /// material out.
    Export(ExportArgs),
    /// Show a model in the browser: ply model (.pwm), cloth (.pwc) or cloth spec (TOML) in; an address of
    /// this machine out.
    View(ViewArgs),
    /// Print completions for a shell: bash, elvish, fish, powershell or zsh.
    Completions(CompletionsArgs),
    /// Print the manual page, or write the pages of all commands into a folder.
    Man(ManArgs),
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;
    use std::collections::BTreeSet;

    /// What clap itself checks in builds without optimization alone: no two flags of a command are the same.
    /// Each also says what it does.
    fn check(command: &clap::Command) {
        let mut flags = BTreeSet::new();
        for argument in command.get_arguments() {
            let long = argument.get_long().map(|l| format!("--{l}"));
            let short = argument.get_short().map(|s| format!("-{s}"));
            for flag in long.into_iter().chain(short) {
                assert!(flags.insert(flag.clone()), "{}: {flag} twice", command.get_name());
            }
            assert!(argument.get_help().is_some(), "{}: {} has no help", command.get_name(), argument.get_id());
        }
        let names: BTreeSet<_> = command.get_subcommands().map(clap::Command::get_name).collect();
        assert_eq!(names.len(), command.get_subcommands().count(), "{}", command.get_name());
        command.get_subcommands().for_each(check);
    }

    #[test]
    fn command_line_is_well_formed() {
        let mut command = super::Cli::command();
        command.build();
        check(&command);
        assert!(command.get_subcommands().count() > 10);
    }
}
