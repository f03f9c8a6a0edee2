//! Flags of making models: simulate, fit, build.

use clap::{Args, ValueEnum};
use plywave_pipeline::{FitQuality, Quality};
use std::path::{Path, PathBuf};

/// Quality of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// A quick look: under a minute for polyester.
    Preview,
    /// For use: minutes.
    Standard,
    /// For comparison: hours.
    Reference,
}

impl Preset {
    /// As the pipeline has it.
    pub fn quality(self) -> Quality {
        match self {
            Preset::Preview => Quality::Preview,
            Preset::Standard => Quality::Standard,
            Preset::Reference => Quality::Reference,
        }
    }
}

/// Flags about the finished shards of an earlier run.
#[derive(Clone, Copy, Debug, Default, Args)]
pub struct ResumeArgs {
    /// Continue a stopped run; the result has the same bits as that of an uninterrupted run.
    #[arg(long)]
    pub resume: bool,
    /// Delete the finished shards of a stopped run and start over.
    #[arg(long, conflicts_with = "resume")]
    pub fresh: bool,
}

/// Flags of a share of a run.
#[derive(Clone, Debug, Default, Args)]
pub struct ShardArgs {
    /// Run only part K of N and write a part file; `plywave merge` joins all parts, from any machines, into
    /// the same bits as a single run.
    #[arg(long, value_name = "K/N", value_parser = share)]
    pub shards: Option<(usize, usize)>,
    /// Print the shards of the run and its identity; run nothing.
    #[arg(long, conflicts_with = "shards")]
    pub plan: bool,
}

impl ShardArgs {
    /// Where the output, or the part, goes when no `-o` is given.
    pub fn default_output(&self, input: &Path, extension: &str) -> PathBuf {
        match self.shards {
            Some((index, count)) => crate::output::default_output(input, &format!("{index}-of-{count}.pwp")),
            None => crate::output::default_output(input, extension),
        }
    }
}

/// `plywave merge`.
#[derive(Debug, Args)]
pub struct MergeArgs {
    /// Parts written with --shards (.pwp), all of one run, in any order.
    #[arg(required = true)]
    pub parts: Vec<PathBuf>,
    /// Output of the run: a table (.pwt), a fiber (.pwf), patterns (.pws), the twin of a cloth (.pwx), the
    /// folder of a comparison, or a JSON file of a scene.
    #[arg(long, short, value_name = "OUTPUT")]
    pub output: PathBuf,
}

/// Flags of a simulation.
#[derive(Clone, Debug, Args)]
pub struct RunArgs {
    /// Quality [default: standard; preview when no spec is given].
    #[arg(long, value_enum)]
    pub preset: Option<Preset>,
    /// Seed of the random numbers.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// What to do with shards of an earlier run.
    #[command(flatten)]
    pub resume: ResumeArgs,
    /// Paths per incident latitude, instead of the spec's or the preset's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000_000_000))]
    pub paths: Option<u64>,
    /// Geometry instances in the ensemble, instead of the spec's or the preset's.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub instances: Option<u32>,
}

/// What a simulation traces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Plies {
    /// One ply, as every model needs it.
    One,
    /// All plies of the yarn, traced together: the brute-force reference of the yarn's model.
    Traced,
}

/// `plywave simulate`.
#[derive(Debug, Args)]
pub struct SimulateArgs {
    /// Yarn spec (TOML).
    pub spec: PathBuf,
    /// Table to write [default: SPEC's name with .pwt, in this folder].
    #[arg(long, short, value_name = "TABLE")]
    pub output: Option<PathBuf>,
    /// What to trace, where the spec's yarn has several plies.
    #[arg(long, value_enum, default_value_t = Plies::One)]
    pub plies: Plies,
    /// How to run.
    #[command(flatten)]
    pub run: RunArgs,
    /// A share of the run.
    #[command(flatten)]
    pub shards: ShardArgs,
}

/// `plywave fit`.
#[derive(Debug, Args)]
pub struct FitArgs {
    /// Table to fit (.pwt).
    pub table: PathBuf,
    /// Model to write [default: TABLE's name with .pwm, in this folder].
    #[arg(long, short, value_name = "MODEL")]
    pub output: Option<PathBuf>,
    /// Quality of the fit [default: the table's].
    #[arg(long, value_enum)]
    pub preset: Option<Preset>,
    /// Fit the yarn of this spec instead of the table's. The yarn may have another number of plies; its
    /// fibers and plies must be those of the table.
    #[arg(long, value_name = "SPEC")]
    pub spec: Option<PathBuf>,
    /// Also write the table of the yarn, computed from that of one ply; the yarn must have several plies.
    #[arg(long, value_name = "TABLE")]
    pub yarn_table: Option<PathBuf>,
}

/// `plywave build`.
#[derive(Debug, Args)]
pub struct BuildArgs {
    /// Yarn spec (TOML) [default: polyester, compiled in].
    pub spec: Option<PathBuf>,
    /// Model to write [default: SPEC's name with .pwm, in this folder].
    #[arg(long, short, value_name = "MODEL")]
    pub output: Option<PathBuf>,
    /// Keep the simulated table too, under the model's name with .pwt.
    #[arg(long)]
    pub keep_table: bool,
    /// Leave speckle out; preview quality has none.
    #[arg(long, conflicts_with = "speckle")]
    pub smooth: bool,
    /// Make the noise from these speckle patterns (.pws) instead of solving for 200 fibers.
    #[arg(long, value_name = "PATTERNS")]
    pub speckle: Option<PathBuf>,
    /// Limit of the fit error of an f_refl slice; beyond it the exit code is 1, and the model is written all
    /// the same.
    #[arg(long, value_name = "ERROR", default_value_t = FitQuality::good().refl)]
    pub max_error_refl: f64,
    /// Limit of the fit error of an f_high slice, as a share of its light at sigma = 0.
    #[arg(long, value_name = "ERROR", default_value_t = FitQuality::good().high)]
    pub max_error_high: f64,
    /// How to run.
    #[command(flatten)]
    pub run: RunArgs,
}

/// Reads `K/N` of `--shards`.
fn share(text: &str) -> Result<(usize, usize), String> {
    let read = |part: &str| part.parse::<usize>().ok();
    match text.split_once('/').map(|(k, n)| (read(k), read(n))) {
        Some((Some(k), Some(n))) if (1..=n).contains(&k) => Ok((k, n)),
        _ => Err("give K/N, part K of N, with 1 <= K <= N".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_read() {
        assert_eq!(share("3/16"), Ok((3, 16)));
        for bad in ["0/3", "4/3", "3", "a/b", "1/", "-1/2", "1/2/3"] {
            assert!(share(bad).is_err(), "{bad}");
        }
    }
}
