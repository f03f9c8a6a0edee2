//! The commands, one a file, and what they share: loading, incidences, threads.

pub mod build;
pub mod check;
pub mod check_cloth;
pub mod check_filament;
pub mod check_traced;
mod cloth_file;
pub mod color;
pub mod compare;
pub mod diff;
pub mod diff_models;
pub mod diff_tables;
pub mod diffraction_view;
pub mod eval;
pub mod export;
pub mod family;
pub mod farm;
pub mod fiber_view;
mod fibers;
pub mod fit;
pub mod hairs;
pub mod info;
pub mod info_fiber;
pub mod merge;
pub mod new;
pub mod noise;
pub mod noise_view;
pub mod plot;
pub mod render;
mod render_strands;
pub mod runs;
pub mod sample;
pub mod shell;
pub mod simulate;
pub mod speckle_view;
pub mod twin;
pub mod view;
mod view_server;
pub mod wave_scatter;
pub mod wave_speckle;
pub mod wave_tabulate;
pub mod weave;

use crate::args::{Cli, IncidenceArgs};
use crate::failure::{Failure, Outcome};
use crate::report::number;
use plywave::cloth::ClothData;
use plywave::fiber::FiberTable;
use plywave::io::FileKind;
use plywave::spec::YarnSpec;
use plywave::speckle::SpecklePatterns;
use plywave::table::Table;
use plywave::twin::ClothTwin;
use plywave::{PlyFamily, PlyModel};
use std::path::Path;

/// A table, a model, a fiber, speckle patterns or the twin of a cloth.
pub enum Loaded {
    /// Simulated scattering.
    Table(Box<Table>),
    /// A fitted model.
    Model(Box<PlyModel>),
    /// A fiber's scattering.
    Fiber(Box<FiberTable>),
    /// Patterns of single fibers.
    Speckle(Box<SpecklePatterns>),
    /// The twin of a cloth.
    Twin(Box<ClothTwin>),
    /// A family of plies.
    Family(Box<PlyFamily>),
    /// A cloth.
    Cloth(Box<ClothData>),
}

/// Loads a file by what its header says it is, or a model by its name.
pub fn load_any(cli: &Cli, path: &Path) -> Outcome<Loaded> {
    if crate::kinds::is_named(path) {
        return Ok(Loaded::Model(Box::new(cli.library()?.load(path)?)));
    }
    Ok(match plywave::io::file_kind(path)? {
        FileKind::Table => Loaded::Table(Box::new(Table::load(path)?)),
        FileKind::Model => Loaded::Model(Box::new(PlyModel::load(path)?)),
        FileKind::Fiber => Loaded::Fiber(Box::new(FiberTable::load(path)?)),
        FileKind::Speckle => Loaded::Speckle(Box::new(SpecklePatterns::load(path)?)),
        FileKind::Twin => Loaded::Twin(Box::new(ClothTwin::load(path)?)),
        FileKind::Family => Loaded::Family(Box::new(PlyFamily::load(path)?)),
        FileKind::Cloth => Loaded::Cloth(Box::new(ClothData::load(path)?)),
    })
}

/// What the commands need of an embedded spec.
pub struct Yarn {
    /// The parsed spec.
    pub spec: YarnSpec,
    /// Ply radius R [um] that offsets are relative to.
    pub radius_um: f64,
}

impl Yarn {
    /// From the spec text and the offsets of a table or model: the last offset is R + d_cut.
    pub fn from_spec(file: &Path, spec_text: &str, h_um: &[f64]) -> Outcome<Self> {
        let spec = YarnSpec::parse(spec_text, &format!("{} (its spec)", file.display()))?;
        let reach = h_um.last().copied().unwrap_or(0.0);
        let radius_um = reach - spec.beam.beam().d_cut_um;
        if radius_um > 0.0 {
            Ok(Yarn { spec, radius_um })
        } else {
            let hint = "must exceed the beam's d_cut_um; write the file again from its spec";
            Err(Failure::input(file.display(), "largest h_um", reach, hint))
        }
    }
}

/// Checks an incidence of the command line against a model; gives theta_i [rad] and h [um].
pub fn incidence(args: &IncidenceArgs, data: &plywave::ply::PlyData, radius_um: f64) -> Outcome<(f32, f32)> {
    let reach = data.h_um.last().copied().unwrap_or(0.0) / radius_um;
    latitude("--theta-i", args.theta_i)?;
    if !(0.0..=reach).contains(&args.h_rel.abs()) {
        let hint = format!("must be from -{0} to {0}, where the beam still hits the ply", number(reach));
        return Err(Failure::input("command line", "--h-rel", args.h_rel, &hint));
    }
    absorptions(&args.sigma)?;
    // The product may leave the last node by a rounding.
    let last = data.h_um.last().copied().unwrap_or(0.0);
    Ok((args.theta_i.to_radians() as f32, (args.h_rel * radius_um).clamp(-last, last) as f32))
}

/// Refuses a latitude [degrees] beyond the poles.
pub fn latitude(flag: &str, degrees: f64) -> Outcome {
    if degrees.abs() <= 90.0 {
        return Ok(());
    }
    Err(Failure::input("command line", flag, degrees, "must be from -90 to 90 degrees"))
}

/// Refuses absorptions that are negative or not numbers.
pub fn absorptions(sigma: &[f64]) -> Outcome {
    match sigma.iter().find(|s| !(**s >= 0.0 && s.is_finite())) {
        None => Ok(()),
        Some(s) => Err(Failure::input("command line", "--sigma", s, "must be 0 or more, in 1/um")),
    }
}

/// Runs `work` on the number of threads that --threads gives.
pub fn on_threads<T: Send>(cli: &Cli, work: impl FnOnce() -> T + Send) -> Outcome<T> {
    match cli.threads {
        None => Ok(work()),
        Some(n) => match rayon::ThreadPoolBuilder::new().num_threads(n as usize).build() {
            Ok(pool) => Ok(pool.install(work)),
            Err(error) => Err(Failure::input("command line", "--threads", n, &format!("{error}; give fewer"))),
        },
    }
}

/// Calls `$f::<N>` with the absorptions as an array of their number, 1 to 4.
macro_rules! by_count {
    ($sigma:expr, $f:ident ( $($arg:expr),* )) => {{
        let s: Vec<f32> = $sigma.iter().map(|s| *s as f32).collect();
        match s.as_slice() {
            [a] => $f($($arg,)* [*a]),
            [a, b] => $f($($arg,)* [*a, *b]),
            [a, b, c] => $f($($arg,)* [*a, *b, *c]),
            [a, b, c, d] => $f($($arg,)* [*a, *b, *c, *d]),
            other => Err($crate::failure::Failure::input("command line", "--sigma", other.len(), "give one to four values")),
        }
    }};
}
pub(crate) use by_count;
