//! Curves in files: plywave's own TOML, Yuksel's `.bcc` and TexGen's `.tg3`.
//!
//! Every curve must be periodic: it ends a vector of the cell from its start. Flat sections of a `.tg3`
//! become round strands side by side. Sections of a file are compared with the counts of the spec's yarns.

use super::bcc::{Bcc, BccCurve};
use super::flat::{FLAT, Strands};
use super::measure::{strands_of, tex_of_strand};
use super::tg3::{Tg3, Tg3Yarn};
use super::{bcc, tg3};
use crate::error::SimError;
use plywave::Error;
use plywave::cloth::{ClothCurves, ClothYarn, CurvePoint, Lattice, PlyCurve};
use plywave::math::vec3::{cross, unit};
use plywave_textile::{SourceCurves, YarnOfCloth};
use std::f64::consts::PI;
use std::path::Path;

/// Maximum distance of a curve's end from its start translated by a vector of the cell, over the mean step
/// between its points.
const OFF: f64 = 1.5;
/// Minimum number of points of a period of a `.bcc`, and of a curve.
const MIN_POINTS: usize = 4;
/// Minimum number of knots of a period of a yarn that is laid out as several strands.
const FLAT_KNOTS: usize = 16;
/// Relative difference of two radii up to which no note is written.
const SAME_RADIUS: f64 = 0.02;

/// A file format for curves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CurveFormat {
    /// TOML of [`ClothCurves`].
    Toml,
    /// Binary curve collection of C. Yuksel.
    Bcc,
    /// TexGen model.
    Tg3,
}

impl CurveFormat {
    /// Format by a file name's extension; `None` if the extension is unknown.
    pub fn of(name: impl AsRef<Path>) -> Option<CurveFormat> {
        match name.as_ref().extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "toml" => Some(CurveFormat::Toml),
            "bcc" => Some(CurveFormat::Bcc),
            "tg3" => Some(CurveFormat::Tg3),
            _ => None,
        }
    }
}

/// Curves of a file with notes for the user.
#[derive(Debug)]
pub(super) struct Source {
    pub curves: ClothCurves,
    /// `[kind]`: area of the yarn's section in the file [um2]; `None` for a file without sections.
    pub section_um2: Vec<Option<f64>>,
    pub notes: Vec<String>,
}

/// Reads the curves of a file. `yarns` are the yarns of the spec, by kind.
pub(super) fn source_curves(source: &SourceCurves, yarns: &[&YarnOfCloth], bytes: &[u8]) -> Result<Source, SimError> {
    let file = &source.file;
    let refuse =
        |what: String, hint: &str| -> SimError { Error::Format { file: file.clone(), what, hint: hint.into() }.into() };
    let text = || {
        std::str::from_utf8(bytes).map_err(|_| refuse("it is not UTF-8 text".into(), "use the file as it was written"))
    };
    let read = match CurveFormat::of(file) {
        Some(CurveFormat::Toml) => from_toml(ClothCurves::parse(text()?, file)?),
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
            from_bcc(&bcc, cell_um, source.um_per_unit.unwrap_or(1.0), yarns)
                .map_err(|what| refuse(what, "use curves that repeat after vectors of cell_um"))?
        }
        Some(CurveFormat::Tg3) => {
            let tg3 = tg3::read(text()?).map_err(|what| refuse(what, "use a .tg3 file of TexGen"))?;
            let Some(um_per_unit) = source.um_per_unit.or(tg3.um_per_unit()) else {
                let what = format!("its GeometryScale is {:?}, a unit that is not known", tg3.scale);
                return Err(refuse(what, "use m, cm, mm, um, nm or in, or give curves.um_per_unit in the spec"));
            };
            from_tg3(&tg3, source.cell_um, um_per_unit, yarns)
                .map_err(|what| refuse(what, "use yarns with Repeat vectors in the plane"))?
        }
        None => return Err(refuse("its ending is not known".into(), "use .bcc, .tg3 or .toml")),
    };
    check_kinds(&read.curves, yarns.len()).map_err(|(what, hint)| refuse(what, hint))?;
    Ok(read)
}

/// Checks that the file has the kinds of yarns of the spec; the error is a description and a hint.
fn check_kinds(curves: &ClothCurves, wanted: usize) -> Result<(), (String, &'static str)> {
    let mut kinds: Vec<u32> = curves.yarns.iter().map(|yarn| yarn.kind).collect();
    kinds.sort_unstable();
    kinds.dedup();
    match (kinds.len(), wanted) {
        (2, 1) => Err((
            "it has yarns of two kinds, and the spec has one [yarn]".into(),
            "give [warp] and [weft] in place of [yarn]; kind 0 is the warp, kind 1 the weft",
        )),
        (1, 2) => Err((
            "its yarns are of one kind, and the spec has [warp] and [weft]".into(),
            "give [yarn] in place of [warp] and [weft]",
        )),
        _ if kinds.last().is_some_and(|last| *last as usize >= wanted) => Err((
            format!("it has yarns of the kinds {kinds:?}"),
            "use kind 0, for the warp or the yarn, and 1, for the weft",
        )),
        _ => Ok(()),
    }
}

fn from_toml(curves: ClothCurves) -> Source {
    let kinds = curves.yarns.iter().map(|yarn| yarn.kind as usize + 1).max().unwrap_or(0).min(2);
    let section = |kind: usize| {
        let index = curves.yarns.iter().position(|yarn| yarn.kind as usize == kind)?;
        let of = curves.curves.iter().filter(|curve| curve.yarn as usize == index);
        Some(of.map(|curve| curve.turns(&curves.yarns[index]) as f64 * PI * curve.radius_um.powi(2)).sum())
    };
    Source { section_um2: (0..kinds).map(section).collect(), curves, notes: Vec::new() }
}

/// Compares the section of each kind of yarn with the one that follows from its count. Returns notes; the
/// error is key, value and hint of a count whose fibers do not fit in the section.
pub(super) fn compare_counts(
    source: &Source,
    yarns: &[&YarnOfCloth],
    names: &[&str],
) -> Result<Vec<String>, (String, String, String)> {
    let mut notes = Vec::new();
    for (kind, (yarn, name)) in yarns.iter().zip(names).enumerate() {
        let Some(section_um2) = source.section_um2.get(kind).copied().flatten() else { continue };
        let Some(index) = source.curves.yarns.iter().position(|of| of.kind as usize == kind) else { continue };
        let strands = strands_of(&source.curves, index);
        let tex = strands as f64 * tex_of_strand(yarn, strands);
        let fibers_um2 = 1000.0 * tex / yarn.fiber.density_g_per_cm3;
        let radius = |area: f64| (area / PI).sqrt();
        let (own, in_file) = (radius(fibers_um2 / yarn.packing), radius(section_um2));
        if (own / in_file - 1.0).abs() <= SAME_RADIUS {
            continue;
        }
        let packing = fibers_um2 / section_um2;
        let goes = tex * yarn.packing / packing;
        let found = format!(
            "{tex:.1} tex at packing {} is a round section of R {own:.1} um, and that of the file has R {in_file:.1} um",
            yarn.packing
        );
        let count = format!("a count of {goes:.1} tex");
        if packing > 1.0 {
            let hint =
                format!("{found}, which its fibers do not fit in; use {count}, which goes with it at that packing");
            return Err((format!("{name}.count"), format!("{:.1} tex", yarn.tex()), hint));
        }
        notes.push(format!("{name}: {found}; {count}, or packing = {packing:.2}, goes with it"));
    }
    Ok(notes)
}

/// The bytes of a file of curves. Lengths are in um, in a `.tg3` in mm.
pub fn write_curves(curves: &ClothCurves, name: &str, format: CurveFormat) -> Vec<u8> {
    match format {
        CurveFormat::Toml => curves.to_toml().into_bytes(),
        CurveFormat::Bcc => bcc::write(&to_bcc(curves)),
        CurveFormat::Tg3 => tg3::write(&to_tg3(curves, name)).into_bytes(),
    }
}

/// One period of every curve as an open curve through points on it. One more point at each end serves uniform
/// Catmull-Rom curves, which begin at their second point.
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
            .map(|curve| {
                let places: Vec<CurvePoint> =
                    (0..=curve.control_um.len()).map(|i| curve.at(&lattice, i as f64)).collect();
                Tg3Yarn {
                    nodes: places.iter().map(|at| mm(at.point_um)).collect(),
                    ups: places.iter().map(|at| up_across(at.d_um)).collect(),
                    repeats: repeats.clone(),
                    width: 2e-3 * curve.radius_um,
                    height: 2e-3 * curve.radius_um,
                    is_elliptical: true,
                    is_cubic: true,
                }
            })
            .collect(),
    };
    Tg3 { name: name.into(), scale: "mm".into(), yarns }
}

/// The direction z, or y for a yarn that runs nearly along z.
fn up_across([x, y, z]: [f64; 3]) -> [f64; 3] {
    if z.abs() > 7.0 * x.hypot(y) { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] }
}

/// Number of points of one period of an open curve, and the period in cells. The last point is the first one
/// translated by a vector of the cell, or one step before that; `None` for any other curve.
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
    // A repeated first point counts once.
    Some((if off < 0.5 * step { points.len() - 1 } else { points.len() }, cells))
}

/// First point, number of points and period of a curve like in [`period_of`], or of one with an additional
/// point at each end.
fn range_of(points: &[[f64; 3]], lattice: &Lattice) -> Option<(usize, usize, [i32; 2])> {
    let whole = period_of(points, lattice).map(|(count, shift)| (0, count, shift));
    whole.or_else(|| {
        let inner = points.get(1..points.len().checked_sub(1)?)?;
        period_of(inner, lattice).map(|(count, shift)| (1, count, shift))
    })
}

/// A curve of a file, with its section.
struct Line {
    points_um: Vec<[f64; 3]>,
    /// Strands of its section.
    strands: Strands,
    /// Direction that is up in the section at each point.
    ups: Vec<[f64; 3]>,
    section_um2: Option<f64>,
}

/// Periodic curves from lines of at least `min_points` different points per period. With two `kinds`, yarns
/// along y belong to the first, the warp.
fn curves_of(lines: &[Line], cell_um: [[f64; 2]; 2], min_points: usize, kinds: usize) -> Result<Source, String> {
    let lattice = Lattice::new(cell_um).ok_or("the vectors of its cell are parallel")?;
    let mut source = Source {
        curves: ClothCurves { cell_um, yarns: Vec::new(), curves: Vec::new() },
        section_um2: vec![None; kinds],
        notes: Vec::new(),
    };
    let mut numbers = [0; 2];
    for (index, line) in lines.iter().enumerate() {
        let Some((first, count, shift)) = range_of(&line.points_um, &lattice) else {
            return Err(format!(
                "curve {} is not periodic: it does not end a vector of the cell from its start",
                index + 1
            ));
        };
        if count < min_points {
            let curve = index + 1;
            return Err(format!(
                "curve {curve} has {count} different points a period, and needs {min_points} at least"
            ));
        }
        let [x, y] = lattice.vector(shift);
        let kind = usize::from(kinds == 2 && x.abs() >= y.abs());
        let number = numbers[kind];
        numbers[kind] += 1;
        source.section_um2[kind] = source.section_um2[kind].or(line.section_um2);
        source.curves.yarns.push(ClothYarn { kind: kind as u32, number, step: [0, 0], period: shift });
        let axis = PlyCurve::through(
            index as u32,
            line.strands.radius_um,
            shift,
            &line.points_um[first..first + count],
            &lattice,
        );
        source.curves.curves.extend(strands_along(axis, line, first, count, &lattice));
    }
    source.curves.check("curves").map_err(|e| e.to_string())?;
    Ok(source)
}

/// The strands of a yarn about its axis; a period has `count` points of the line, the first one at `first`.
fn strands_along(mut axis: PlyCurve, line: &Line, first: usize, count: usize, lattice: &Lattice) -> Vec<PlyCurve> {
    let places = &line.strands.places_um;
    let min_knots = if places.len() > 1 { FLAT_KNOTS } else { MIN_POINTS };
    while axis.control_um.len() < min_knots {
        axis = axis.refined(lattice);
    }
    if places.len() == 1 {
        return vec![axis];
    }
    let knots = axis.control_um.len();
    let frame = |knot: usize| {
        let at = axis.at(lattice, knot as f64);
        let along = unit(at.d_um);
        let up = up_at(line, first as f64 + knot as f64 * count as f64 / knots as f64);
        let across = unit(cross(up, along));
        (at.point_um, across, cross(along, across))
    };
    let frames: Vec<_> = (0..knots).map(frame).collect();
    let strand = |place: &[f64; 2]| {
        let point = |(p, across, up): &([f64; 3], [f64; 3], [f64; 3])| {
            std::array::from_fn(|k| p[k] + place[0] * across[k] + place[1] * up[k])
        };
        let points: Vec<[f64; 3]> = frames.iter().map(point).collect();
        PlyCurve::through(axis.yarn, axis.radius_um, axis.shift, &points, lattice)
    };
    places.iter().map(strand).collect()
}

/// Direction that is up in the section at the fractional index `at`, interpolated between two points.
fn up_at(line: &Line, at: f64) -> [f64; 3] {
    let i = at.floor() as usize;
    let up = |i: usize| line.ups.get(i).or(line.ups.last()).copied().unwrap_or([0.0, 0.0, 1.0]);
    let (a, b, t) = (up(i), up(i + 1), at - at.floor());
    unit(std::array::from_fn(|k| (1.0 - t) * a[k] + t * b[k]))
}

fn strand_of(radius_um: f64) -> Strands {
    Strands { radius_um, places_um: vec![[0.0; 2]] }
}

/// Curves of a `.bcc`, with the radius of the spec's yarn, since the file has none.
fn from_bcc(bcc: &Bcc, cell_um: [[f64; 2]; 2], um_per_unit: f64, yarns: &[&YarnOfCloth]) -> Result<Source, String> {
    if let Some(at) = bcc.curves.iter().position(|curve| curve.is_closed) {
        return Err(format!("curve {} is closed in itself", at + 1));
    }
    // The axis that points up becomes z; the rotation preserves handedness.
    let turned = |p: &[f64; 3]| match bcc.up {
        0 => [p[1], p[2], p[0]],
        1 => [p[2], p[0], p[1]],
        _ => *p,
    };
    let of = |curve: &BccCurve| Line {
        points_um: curve.points.iter().map(|p| turned(p).map(|v| v * um_per_unit)).collect(),
        strands: strand_of(yarns[0].strand_radius_um()),
        ups: Vec::new(),
        section_um2: None,
    };
    let lines: Vec<Line> = bcc.curves.iter().map(of).collect();
    let mut source = curves_of(&lines, cell_um, MIN_POINTS, yarns.len())?;
    // The direction of a curve has given its kind of yarn.
    for curve in &mut source.curves.curves {
        curve.radius_um = yarns[source.curves.yarns[curve.yarn as usize].kind as usize].strand_radius_um();
    }
    Ok(source)
}

/// Curves of a `.tg3`: one round strand for each yarn, or several side by side for a flat section.
fn from_tg3(
    tg3: &Tg3,
    cell_um: Option<[[f64; 2]; 2]>,
    um_per_unit: f64,
    yarns: &[&YarnOfCloth],
) -> Result<Source, String> {
    let repeats = tg3.yarns.first().map_or(&[][..], |yarn| &yarn.repeats);
    let cell_um = match (cell_um, repeats) {
        (Some(cell), _) => cell,
        (None, [a, b, ..]) => [a, b].map(|v| [v[0] * um_per_unit, v[1] * um_per_unit]),
        (None, _) => return Err("its yarns have no two Repeat vectors".into()),
    };
    let of = |(index, tg3): (usize, &Tg3Yarn)| -> Result<Line, String> {
        let [width_um, height_um] = [tg3.width, tg3.height].map(|v| v * um_per_unit);
        let has_section = width_um > 0.0 && height_um > 0.0;
        let strands = match has_section {
            false => Some(strand_of(yarns[0].strand_radius_um())),
            true => Strands::of_section(width_um, height_um),
        };
        let what = || {
            format!(
                "the section of yarn {} is {width_um:.0} x {height_um:.0} um, too flat for strands side by side",
                index + 1
            )
        };
        Ok(Line {
            points_um: tg3.nodes.iter().map(|p| p.map(|v| v * um_per_unit)).collect(),
            strands: strands.ok_or_else(what)?,
            ups: tg3.ups.clone(),
            section_um2: has_section.then_some(0.25 * PI * width_um * height_um),
        })
    };
    let lines = tg3.yarns.iter().enumerate().map(of).collect::<Result<Vec<_>, _>>()?;
    let mut source = curves_of(&lines, cell_um, 1, yarns.len())?;
    source.notes = tg3_notes(tg3, &lines, um_per_unit);
    Ok(source)
}

/// Notes on features of a `.tg3` that are approximated.
fn tg3_notes(tg3: &Tg3, lines: &[Line], um_per_unit: f64) -> Vec<String> {
    let mut notes = Vec::new();
    let count = |is: &dyn Fn(&Tg3Yarn) -> bool| tg3.yarns.iter().filter(|yarn| is(yarn)).count();
    let flat = lines.iter().zip(&tg3.yarns).filter(|(line, _)| line.strands.places_um.len() > 1);
    if let Some((Line { strands, section_um2, .. }, yarn)) = flat.clone().next() {
        let several = strands.places_um.len();
        let share = several as f64 * PI * strands.radius_um.powi(2) / section_um2.unwrap_or(f64::INFINITY);
        notes.push(format!(
            "flat sections of {} of {} yarns are laid as strands side by side: {:.0} x {:.0} um as {several} of R {:.2} um, as wide and high, \
             of {:.0} % of the area",
            flat.count(),
            tg3.yarns.len(),
            yarn.width * um_per_unit,
            yarn.height * um_per_unit,
            strands.radius_um,
            100.0 * share
        ));
    }
    let slightly =
        count(&|yarn| yarn.width != yarn.height && yarn.width.max(yarn.height) < FLAT * yarn.width.min(yarn.height));
    if slightly > 0 {
        notes.push(format!(
            "slightly flat sections of {slightly} of {} yarns are taken as round ones of their area",
            tg3.yarns.len()
        ));
    }
    let other = count(&|yarn| !yarn.is_elliptical);
    if other > 0 {
        notes.push(format!(
            "sections of {other} of {} yarns that are no ellipses are taken as ellipses of their width and height",
            tg3.yarns.len()
        ));
    }
    let other = count(&|yarn| !yarn.is_cubic);
    if other > 0 {
        notes.push(format!(
            "{other} of {} yarns that are not interpolated by CInterpolationCubic are taken so",
            tg3.yarns.len()
        ));
    }
    notes
}
