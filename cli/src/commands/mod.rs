//! The commands, one per file, and their common parts: loading, incidences, threads.

pub mod check;
pub mod look;
pub mod make;
pub mod picture;
pub mod runs;
pub mod shell;
pub mod wave;

use crate::args::{Cli, IncidenceArgs};
use crate::failure::{Failure, Outcome};
use crate::report::number;
use plywave::Document;
use plywave::cloth::ClothData;
use plywave::io::FileKind;
use plywave::spec::YarnSpec;
use plywave::{PlyFamily, PlyModel};
use plywave_fiber::FiberTable;
use plywave_tables::speckle::SpecklePatterns;
use plywave_tables::table::Table;
use plywave_tables::twin::ClothTwin;
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

/// Loads a file of the kind that its header names, or a model by its name.
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

/// Data of an embedded spec that the commands use.
pub struct Yarn {
    /// The parsed spec.
    pub spec: YarnSpec,
    /// Ply radius R [um] that offsets are relative to.
    pub radius_um: f64,
}

impl Yarn {
    /// Parses the spec text of a table or model; the radius follows from the offsets, whose last one is R +
    /// d_cut.
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

/// Checks an incidence from the command line against a model; returns theta_i [rad] and h [um].
pub fn incidence(args: &IncidenceArgs, data: &plywave::ply::PlyData, radius_um: f64) -> Outcome<(f32, f32)> {
    let reach = data.h_um.last().copied().unwrap_or(0.0) / radius_um;
    latitude("--theta-i", args.theta_i)?;
    if !(0.0..=reach).contains(&args.h_rel.abs()) {
        let hint = format!("must be from -{0} to {0}, where the beam still hits the ply", number(reach));
        return Err(Failure::input("command line", "--h-rel", args.h_rel, &hint));
    }
    absorptions(&args.sigma)?;
    // Rounding of the product may exceed the last node.
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

/// Refuses absorptions that are negative or NaN.
pub fn absorptions(sigma: &[f64]) -> Outcome {
    match sigma.iter().find(|s| !(**s >= 0.0 && s.is_finite())) {
        None => Ok(()),
        Some(s) => Err(Failure::input("command line", "--sigma", s, "must be 0 or more, in 1/um")),
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
