//! Curves in files: our own TOML, Yuksel's `.bcc` and TexGen's `.tg3`.

use super::bcc::{Bcc, BccCurve};
use super::tg3::{Tg3, Tg3Yarn};
use super::{bcc, tg3};
use crate::error::SimError;
use plywave::Error;
use plywave::cloth::{ClothCurves, ClothYarn, Lattice, PlyCurve, SourceCurves, YarnOfCloth};
use std::path::Path;

/// How far the end of a curve may be off its start, moved by a vector of the cell, over the step between its
/// points.
const OFF: f64 = 1.5;

/// A kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CurveFormat {
    /// TOML of [`ClothCurves`].
    Toml,
    /// Binary curve collection.
    Bcc,
    /// TexGen model.
    Tg3,
}

impl CurveFormat {
    /// By the ending of a name.
    pub fn of(name: impl AsRef<Path>) -> Option<CurveFormat> {
        match name.as_ref().extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "toml" => Some(CurveFormat::Toml),
            "bcc" => Some(CurveFormat::Bcc),
            "tg3" => Some(CurveFormat::Tg3),
            _ => None,
        }
    }
}

/// Curves of a file.
pub(super) fn source_curves(source: &SourceCurves, yarn: &YarnOfCloth, bytes: &[u8]) -> Result<ClothCurves, SimError> {
    let file = &source.file;
    let refuse =
        |what: String, hint: &str| -> SimError { Error::Format { file: file.clone(), what, hint: hint.into() }.into() };
    let text = || {
        std::str::from_utf8(bytes).map_err(|_| refuse("it is not UTF-8 text".into(), "use the file as it was written"))
    };
    match CurveFormat::of(file) {
        Some(CurveFormat::Toml) => Ok(ClothCurves::parse(text()?, file)?),
        Some(CurveFormat::Bcc) => {
            let bcc = bcc::read(bytes).map_err(|what| refuse(what, "use a .bcc file of open curves"))?;
            let Some(cell_um) = source.cell_um else {
                return Err(Error::Invalid {
                    file: file.clone(),
                    key: "curves.cell_um".into(),
                    value: "(absent)".into(),
                    hint: "a .bcc has no cell: give the two vectors after which its curves repeat".into(),
                }
                .into());
            };
            from_bcc(&bcc, cell_um, source.um_per_unit.unwrap_or(1.0), yarn)
                .map_err(|what| refuse(what, "use curves that repeat after vectors of cell_um"))
        }
        Some(CurveFormat::Tg3) => {
            let tg3 = tg3::read(text()?).map_err(|what| refuse(what, "use a .tg3 file of TexGen"))?;
            from_tg3(&tg3, source.cell_um, source.um_per_unit.unwrap_or(1000.0), yarn)
                .map_err(|what| refuse(what, "use yarns with Repeat vectors in the plane"))
        }
        None => Err(refuse("its ending is not known".into(), "use .bcc, .tg3 or .toml")),
    }
}

/// The bytes of a file of curves. Lengths are in um, of a `.tg3` in mm.
pub fn write_curves(curves: &ClothCurves, name: &str, format: CurveFormat) -> Vec<u8> {
    match format {
        CurveFormat::Toml => curves.to_toml().into_bytes(),
        CurveFormat::Bcc => bcc::write(&to_bcc(curves)),
        CurveFormat::Tg3 => tg3::write(&to_tg3(curves, name)).into_bytes(),
    }
}

/// One period of every curve, open, its points on the curve; a point before and one after, as uniform
/// Catmull-Rom curves begin at their second point.
fn to_bcc(cloth: &ClothCurves) -> Bcc {
    let curves = match Lattice::new(cloth.cell_um) {
        None => Vec::new(),
        Some(lattice) => {
            let points = |curve: &PlyCurve| -> Vec<[f64; 3]> {
                (-1..=curve.control_um.len() as i64 + 1).map(|i| curve.at(&lattice, i as f64).point_um).collect()
            };
            cloth.curves.iter().map(|curve| BccCurve { points: points(curve), is_closed: false }).collect()
        }
    };
    Bcc { curves, is_polyline: false, up: 2 }
}

fn to_tg3(cloth: &ClothCurves, name: &str) -> Tg3 {
    let mm = |p: [f64; 3]| p.map(|v| 1e-3 * v);
    let repeats: Vec<[f64; 3]> = cloth.cell_um.iter().map(|v| mm([v[0], v[1], 0.0])).collect();
    let yarns = match Lattice::new(cloth.cell_um) {
        None => Vec::new(),
        Some(lattice) => cloth
            .curves
            .iter()
            .map(|curve| Tg3Yarn {
                nodes: (0..=curve.control_um.len()).map(|i| mm(curve.at(&lattice, i as f64).point_um)).collect(),
                repeats: repeats.clone(),
                width: 2e-3 * curve.radius_um,
                height: 2e-3 * curve.radius_um,
            })
            .collect(),
    };
    Tg3 { name: name.into(), yarns }
}

/// Points of one period and the period of an open curve: its last point is the first one moved by a vector of
/// the cell, or one step before that.
fn period_of(points: &[[f64; 3]], lattice: &Lattice) -> Option<(usize, [i32; 2])> {
    let (first, last) = (points.first()?, points.last()?);
    let steps = points.windows(2).map(|p| (0..3).map(|k| (p[1][k] - p[0][k]).powi(2)).sum::<f64>().sqrt());
    let step = steps.sum::<f64>() / (points.len() as f64 - 1.0).max(1.0);
    let f = lattice.fractions(last[0] - first[0], last[1] - first[1]);
    let cells = f.map(|f| f.round() as i32);
    let v = lattice.vector(cells);
    let off = [first[0] + v[0] - last[0], first[1] + v[1] - last[1], first[2] - last[2]];
    let off = (off[0] * off[0] + off[1] * off[1] + off[2] * off[2]).sqrt();
    if cells == [0, 0] || off > OFF * step {
        return None;
    }
    // A point that is repeated counts once.
    Some((if off < 0.5 * step { points.len() - 1 } else { points.len() }, cells))
}

/// As [`period_of`], also of a curve with a point more at both ends: first point and number of points.
fn range_of(points: &[[f64; 3]], lattice: &Lattice) -> Option<(usize, usize, [i32; 2])> {
    let whole = period_of(points, lattice).map(|(count, shift)| (0, count, shift));
    whole.or_else(|| {
        let inner = points.get(1..points.len().checked_sub(1)?)?;
        period_of(inner, lattice).map(|(count, shift)| (1, count, shift))
    })
}

fn curves_of(all: &[(Vec<[f64; 3]>, f64)], cell_um: [[f64; 2]; 2]) -> Result<ClothCurves, String> {
    let lattice = Lattice::new(cell_um).ok_or("the vectors of its cell are parallel")?;
    let (mut yarns, mut curves) = (Vec::new(), Vec::new());
    for (number, (points, radius_um)) in all.iter().enumerate() {
        let Some((first, count, shift)) = range_of(points, &lattice).filter(|(_, count, _)| *count >= 4) else {
            return Err(format!(
                "curve {} is not periodic: it does not end a vector of the cell from its start",
                number + 1
            ));
        };
        yarns.push(ClothYarn { kind: 0, number: number as i32, step: [0, 0], period: shift });
        curves.push(PlyCurve::through(number as u32, *radius_um, shift, &points[first..first + count], &lattice));
    }
    let cloth = ClothCurves { cell_um, yarns, curves };
    cloth.check("curves").map_err(|e| e.to_string())?;
    Ok(cloth)
}

/// Curves of a `.bcc`, with the radius of the yarn.
fn from_bcc(bcc: &Bcc, cell_um: [[f64; 2]; 2], um_per_unit: f64, yarn: &YarnOfCloth) -> Result<ClothCurves, String> {
    if let Some(at) = bcc.curves.iter().position(|curve| curve.is_closed) {
        return Err(format!("curve {} is closed in itself", at + 1));
    }
    // The axis that points up becomes z; the others keep their hand.
    let turned = |p: &[f64; 3]| match bcc.up {
        0 => [p[1], p[2], p[0]],
        1 => [p[2], p[0], p[1]],
        _ => *p,
    };
    let of = |curve: &BccCurve| {
        let points = curve.points.iter().map(|p| turned(p).map(|v| v * um_per_unit)).collect();
        (points, yarn.strand_radius_um())
    };
    curves_of(&bcc.curves.iter().map(of).collect::<Vec<_>>(), cell_um)
}

/// Curves of a `.tg3`; the radius of a yarn is that of a circle of the area of its section.
fn from_tg3(
    tg3: &Tg3,
    cell_um: Option<[[f64; 2]; 2]>,
    um_per_unit: f64,
    yarn: &YarnOfCloth,
) -> Result<ClothCurves, String> {
    let repeats = tg3.yarns.first().map_or(&[][..], |yarn| &yarn.repeats);
    let cell_um = match (cell_um, repeats) {
        (Some(cell), _) => cell,
        (None, [a, b, ..]) => [a, b].map(|v| [v[0] * um_per_unit, v[1] * um_per_unit]),
        (None, _) => return Err("its yarns have no two Repeat vectors".into()),
    };
    let of = |tg3: &Tg3Yarn| {
        let points: Vec<[f64; 3]> = tg3.nodes.iter().map(|p| p.map(|v| v * um_per_unit)).collect();
        let radius_um = 0.5 * (tg3.width * tg3.height).sqrt() * um_per_unit;
        (points, if radius_um > 0.0 { radius_um } else { yarn.strand_radius_um() })
    };
    curves_of(&tg3.yarns.iter().map(of).collect::<Vec<_>>(), cell_um)
}
