//! Arguments of `plywave farm`.

use clap::Args;
use std::path::PathBuf;

/// `plywave farm`.
#[derive(Debug, Args)]
pub struct FarmArgs {
    /// Library file: the yarns, fiber tables, speckle patterns and twins that are to be made
    /// (docs/howto/cluster.md).
    pub library: PathBuf,
    /// Where files and report.html go [default: the library's name].
    #[arg(long, short, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Where shards and files are kept, so that nothing is computed twice: a folder or a URL that fsspec
    /// knows [default: FOLDER/cache].
    #[arg(long, value_name = "FOLDER|URL")]
    pub cache: Option<String>,
    /// A Dask scheduler that runs.
    #[arg(long, value_name = "tcp://HOST:PORT", conflicts_with_all = ["local", "slurm"])]
    pub scheduler: Option<String>,
    /// So many processes of this machine [default: one a core].
    #[arg(long, value_name = "N", conflicts_with = "slurm", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub local: Option<u32>,
    /// Jobs of Slurm: queue, account, cores, processes, memory, walltime, python, ...
    #[arg(long, value_name = "KEY=VALUE,..")]
    pub slurm: Option<String>,
    /// Jobs that Slurm is asked for.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub jobs: Option<u32>,
    /// How long the scheduler may take to answer [s] [default: 10].
    #[arg(long, value_name = "SECONDS")]
    pub timeout: Option<f64>,
    /// How often a task may come back damaged before its file is given up [default: 5].
    #[arg(long, value_name = "N")]
    pub retries: Option<u32>,
    /// Price of a core for an hour: the page then has costs.
    #[arg(long, value_name = "PRICE")]
    pub price: Option<f64>,
}
