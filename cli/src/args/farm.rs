//! Arguments of `plywave farm`.

use clap::Args;
use std::path::PathBuf;

/// `plywave farm`.
#[derive(Debug, Args)]
pub struct FarmArgs {
    /// Library file: the yarns, fiber tables, speckle patterns and twins to make (docs/howto/cluster.md).
    pub library: PathBuf,
    /// Folder for the files and report.html [default: the library's name].
    #[arg(long, short, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Cache of shards and files, so that nothing is computed twice: a folder or a URL that fsspec knows
    /// [default: FOLDER/cache].
    #[arg(long, value_name = "FOLDER|URL")]
    pub cache: Option<String>,
    /// Address of a running Dask scheduler.
    #[arg(long, value_name = "tcp://HOST:PORT", conflicts_with_all = ["local", "slurm"])]
    pub scheduler: Option<String>,
    /// Number of processes on this machine [default: one per core].
    #[arg(long, value_name = "N", conflicts_with = "slurm", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub local: Option<u32>,
    /// Run Slurm jobs with these options: queue, account, cores, processes, memory, walltime, python, ...
    #[arg(long, value_name = "KEY=VALUE,..")]
    pub slurm: Option<String>,
    /// Number of Slurm jobs.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub jobs: Option<u32>,
    /// Longest time to wait for the scheduler's answer [s] [default: 10].
    #[arg(long, value_name = "SECONDS")]
    pub timeout: Option<f64>,
    /// How often to repeat a task whose result is damaged before its file fails [default: 5].
    #[arg(long, value_name = "N")]
    pub retries: Option<u32>,
    /// Price of a core for an hour; the report then shows costs.
    #[arg(long, value_name = "PRICE")]
    pub price: Option<f64>,
}
