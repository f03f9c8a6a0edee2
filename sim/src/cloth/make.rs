//! From a cloth spec to relaxed curves.

use super::files::{compare_counts, source_curves};
use super::knitted;
use super::measure::{ClothMeasures, measure};
use super::ready::Effort;
use super::relax::{Chain, Elements, MAX_OVERLAP, Relaxed, relax};
use super::woven::{MAX_NODES, Start, woven};
use crate::error::SimError;
use plywave::Error;
use plywave::cloth::{Buckets, ClothCurves, ClothSpec, ClothWeave, Lattice, PlyCurve, YarnOfCloth};
use plywave::cloth::{Draft, NamedWeave, WeaveSpec, Wif};

/// Largest unbalanced force of a cloth at rest, over the mean tension of a strand.
pub const MAX_FORCE: f64 = 0.05;
/// Largest overlap of two plies of a cloth over their mean radius: what relaxed yarns reach, and what light
/// does not show.
const MAX_SHARED: f64 = 0.05;
/// Factor by which the spacings of a cloth that is too dense grow until it goes, how often at most, and how
/// often the last step is halved.
const WIDER: f64 = 1.3;
const TRIES: i32 = 6;
const HALVINGS: usize = 4;

/// A cloth's curves, and what is known of them.
#[derive(Clone, Debug)]
pub struct MadeCloth {
    /// The curves.
    pub curves: ClothCurves,
    /// Measures.
    pub measures: ClothMeasures,
    /// How the relaxation ended; `None` for curves that were taken as they are.
    pub relaxed: Option<Relaxed>,
    /// What is to be said: of layers that no yarn joins, of twist that was rounded, of a WIF.
    pub notes: Vec<String>,
    /// By kind of yarn, colors [sRGB, 0 to 1] of the yarns by their number, from the stripes of the spec or
    /// the WIF; none where there are none.
    pub colors: [Vec<[f32; 3]>; 2],
}

impl MadeCloth {
    /// Of a cloth that did not come to rest, a line that says by how much and what to do; it is the first of
    /// the notes.
    pub fn unrest(&self) -> Option<String> {
        self.relaxed.filter(|relaxed| relaxed.force > MAX_FORCE).map(|relaxed| {
            format!(
                "the cloth did not come to rest: forces up to {:.2} of the tension are not balanced after {} steps, {MAX_FORCE} is the limit; \
                 give its yarns more room: wider spacings or stitches, finer yarns, a lower stiffness or a larger thickness_um",
                relaxed.force, relaxed.steps
            )
        })
    }
}

/// Spacings that are taken from a WIF [um]: programs that leave it to a default write all kinds of numbers.
const SPACING_UM: std::ops::RangeInclusive<f64> = 10.0..=1e5;

/// Makes the curves of a cloth. `read` gives the bytes of the file that a spec names, of a WIF or of curves;
/// `go_on` is asked at every step of the relaxation and may stop it. A draft is relaxed in fewer steps.
///
/// # Errors
/// [`SimError::Stopped`], and [`Error::Invalid`] for a draft that leaves a yarn unbound, yarns too thick for
/// their spacing, and files that do not hold what they should.
pub fn make_cloth(
    spec: &ClothSpec,
    file: &str,
    read: &mut dyn FnMut(&str) -> Result<Vec<u8>, Error>,
    effort: Effort,
    go_on: &(dyn Fn() -> bool + Sync),
) -> Result<MadeCloth, SimError> {
    let mut notes = Vec::new();
    let invalid = |key: &str, value: String, hint: String| -> SimError {
        Error::Invalid { file: file.into(), key: key.into(), value, hint }.into()
    };
    let Some(made) = spec.made() else {
        return Err(invalid("weave", "(absent)".into(), "give one of [weave], [knit] and [curves]".into()));
    };
    match made {
        ClothWeave::Woven(weave, yarns) => {
            let (mut in_wif, mut spacings) = (<[Vec<[f32; 3]>; 2]>::default(), [None, None]);
            let draft = match weave {
                WeaveSpec::Wif { file: wif } => {
                    let wif = Wif::parse(&read(wif)?, wif)?;
                    notes.extend(wif.notes.iter().map(ToString::to_string));
                    (in_wif, spacings) = ([wif.warp_srgb, wif.weft_srgb], wif.spacing);
                    // Colors need not repeat as the weave does.
                    wif.draft.reduced()
                }
                _ => weave
                    .draft()
                    .ok_or_else(|| invalid("weave.kind", "a weave without draft".into(), "use another".into()))?,
            };
            if let Some((set, thread, up)) = draft.unbound() {
                let side = if up { "above" } else { "below" };
                let value = format!("{} {} lies {side} all others", set.name(), thread + 1);
                return Err(invalid("weave", value, "it cannot be woven: bind every yarn".into()));
            }
            // Notes of a WIF have it, by the file's numbers of threads.
            if draft != Draft::layers() && !matches!(weave, WeaveSpec::Wif { .. }) {
                notes.extend(draft.layers_note());
            }
            let mut spacing = [1.0; 2];
            for (k, key) in ["warp.ends_per_cm", "weft.picks_per_cm"].into_iter().enumerate() {
                spacing[k] = match (yarns[k].spacing_um(), &spacings[k]) {
                    (Some(own), _) => own,
                    (None, Some(given)) if SPACING_UM.contains(&given.um) => {
                        notes.push(format!("{key} = {:.1} from {}", 1e4 / given.um, given.source));
                        given.um
                    }
                    (None, given) => {
                        let hint = match given {
                            None => "give this key; the WIF has no Spacing and no Thickness for it".into(),
                            Some(given) => format!("give this key; {} in the WIF is {:.1} um", given.source, given.um),
                        };
                        return Err(invalid(key, "(absent)".into(), hint));
                    }
                };
            }
            let nodes = super::woven::nodes(&draft, yarns, spacing);
            if nodes > MAX_NODES {
                let value = format!("{nodes:.1e} nodes");
                let hint = format!(
                    "the repeat is too large to relax; use fewer ends, picks or bundles, {MAX_NODES:.0e} nodes at most"
                );
                return Err(invalid("weave", value, hint));
            }
            let at = |scale: f64| {
                let start = woven(&draft, yarns, spacing.map(|s| s * scale));
                start.ok_or_else(|| invalid("weave", "(spacing)".into(), "use spacings above 0".into()))
            };
            let (start, relaxed) = relaxed(at(1.0)?, spec.thickness_um, effort, go_on)?;
            if relaxed.overlap <= MAX_OVERLAP {
                let mut made = finished(start, spec, Some(relaxed), notes)?;
                check_shared(&made, spec).map_err(|(value, what)| invalid("weave", value, what))?;
                for (own, colors) in made.colors.iter_mut().zip(in_wif) {
                    if own.is_empty() {
                        *own = colors;
                    }
                }
                return Ok(made);
            }
            // Too dense: by how much, and what would go.
            let overlap_um = relaxed.overlap * 0.5 * (yarns[0].strand_radius_um() + yarns[1].strand_radius_um());
            let goes = |scale: f64| -> Result<bool, SimError> {
                Ok(self::relaxed(at(scale)?, spec.thickness_um, effort, go_on)?.1.overlap <= MAX_OVERLAP)
            };
            let (mut low, mut high) = (1.0, None);
            for step in 1..=TRIES {
                let scale = WIDER.powi(step);
                if goes(scale)? {
                    high = Some(scale);
                    break;
                }
                low = scale;
            }
            let Some(mut high) = high else {
                let hint = format!(
                    "the yarns are too thick: they overlap by {overlap_um:.1} um, and with spacings {low:.1} times as wide \
                     still; use finer yarns{}",
                    if spec.thickness_um.is_some() { " or a larger thickness_um" } else { "" }
                );
                return Err(invalid("warp.count", format!("{:.2} tex", yarns[0].count.tex()), hint));
            };
            for _ in 0..HALVINGS {
                let middle = 0.5 * (low + high);
                *(if goes(middle)? { &mut high } else { &mut low }) = middle;
            }
            // Rounded so that the next one is not denser.
            let per_cm = spacing.map(|s| (1e5 / (s * high)).floor() / 10.0);
            let hint = format!(
                "the yarns are too thick: they overlap by {overlap_um:.1} um; at most {} ends and {} picks a cm go",
                per_cm[0], per_cm[1]
            );
            Err(invalid("warp.ends_per_cm", yarns[0].ends_per_cm.unwrap_or_default().to_string(), hint))
        }
        ClothWeave::Knitted(knit, yarn) => {
            let start = knitted::knitted(knit, yarn).map_err(|(key, value, hint)| invalid(key, value, hint))?;
            let (start, relaxed) = relaxed(start, spec.thickness_um, effort, go_on)?;
            check_overlap(&relaxed, yarn).map_err(|(value, hint)| invalid("yarn.count", value, hint))?;
            let made = finished(start, spec, Some(relaxed), notes)?;
            check_shared(&made, spec).map_err(|(value, what)| invalid("knit", value, what))?;
            Ok(made)
        }
        ClothWeave::Curves(source, ..) => {
            let yarns = spec.yarns();
            let read = source_curves(source, &yarns, &read(&source.file)?)?;
            let names: Vec<&str> = (0..yarns.len()).map(|kind| spec.kind_name(kind)).collect();
            notes.extend(read.notes.iter().cloned());
            notes.extend(
                compare_counts(&read, &yarns, &names).map_err(|(key, value, hint)| invalid(&key, value, hint))?,
            );
            let curves = read.curves;
            let lattice = curves.lattice(&source.file)?;
            if !source.relax {
                let measures = measure(&curves, &lattice, &yarns)?;
                let colors = colors_of(spec);
                let made = MadeCloth { curves, measures, relaxed: None, notes, colors };
                check_shared(&made, spec).map_err(|(value, what)| {
                    let hint = format!("{what}; use relax = true, or curves that do not pass through each other");
                    invalid("curves.file", value, hint)
                })?;
                return Ok(made);
            }
            let nodes: f64 = curves.curves.iter().map(|curve| nodes_of(curve, &lattice) as f64).sum();
            let largest = curves.curves.iter().map(|curve| curve.radius_um).fold(0.0, f64::max);
            // Elements are longer where a curve was sampled unevenly.
            if nodes > MAX_NODES || !Buckets::can_search(&lattice, nodes as usize, 8.0 * largest) {
                let hint =
                    format!("its curves are too long to relax; use relax = false, or {MAX_NODES:.0e} nodes at most");
                return Err(invalid("curves.file", format!("{nodes:.1e} nodes"), hint));
            }
            let start = start_of(&curves, lattice, &yarns);
            let (start, relaxed) = relaxed(start, spec.thickness_um, effort, go_on)?;
            let made = finished(start, spec, Some(relaxed), notes)?;
            check_shared(&made, spec).map_err(|(value, what)| {
                let hint = format!("{what} after {} steps; use finer yarns or a wider cell", relaxed.steps);
                invalid("curves.file", value, hint)
            })?;
            Ok(made)
        }
    }
}

/// Value and hint where a yarn overlaps itself.
fn check_overlap(relaxed: &Relaxed, yarn: &YarnOfCloth) -> Result<(), (String, String)> {
    if relaxed.overlap <= MAX_OVERLAP {
        return Ok(());
    }
    let overlap_um = relaxed.overlap * yarn.strand_radius_um();
    let hint = format!(
        "the yarn is too thick: it overlaps itself by {overlap_um:.1} um; use a finer yarn, a longer loop or fewer stitches a cm"
    );
    Err((format!("{:.2} tex", yarn.count.tex()), hint))
}

/// Value and words where plies share more room than those of a cloth do: the yarns, by their names.
fn check_shared(made: &MadeCloth, spec: &ClothSpec) -> Result<(), (String, String)> {
    let m = &made.measures;
    if m.overlap <= MAX_SHARED {
        return Ok(());
    }
    let name = |index: u32| {
        let yarn = &made.curves.yarns[index as usize];
        format!("{} {}", spec.kind_name(yarn.kind as usize), yarn.number + 1)
    };
    let [a, b] = m.overlap_yarns;
    let which = match a == b {
        true => format!("{} overlaps itself or its image in the next cell", name(a)),
        false => format!("{} and {} overlap", name(a), name(b)),
    };
    let limit = 100.0 * MAX_SHARED;
    Err((format!("an overlap of {:.1} % of R", 100.0 * m.overlap), format!("{which}, by more than {limit} % of R")))
}

fn colors_of(spec: &ClothSpec) -> [Vec<[f32; 3]>; 2] {
    let mut colors = <[Vec<[f32; 3]>; 2]>::default();
    colors.iter_mut().zip(spec.yarns()).for_each(|(colors, yarn)| *colors = yarn.colors());
    colors
}

/// What a houndstooth without its colors is.
fn houndstooth_note(spec: &ClothSpec) -> Option<String> {
    let has_teeth = |yarn: &&YarnOfCloth| {
        let stripes: Vec<usize> = yarn.stripes.iter().map(|stripe| stripe.count).collect();
        stripes == [4, 4]
    };
    let is_one = matches!(spec.weave, Some(WeaveSpec::Named(NamedWeave::Houndstooth)));
    (is_one && !spec.yarns().iter().all(has_teeth)).then(|| {
        "a houndstooth is a 2/2 twill of four dark and four light yarns in turn: give warp and weft stripes of 4 and 4".into()
    })
}

/// What is to be said of twists that a periodic cloth cannot have.
fn twist_notes(start: &Start, spec: &ClothSpec) -> Vec<String> {
    let mut notes = Vec::new();
    for (kind, yarn) in spec.yarns().iter().enumerate() {
        let name = spec.kind_name(kind);
        let Some((_, used)) = start.twists.iter().find(|(of, _)| *of as usize == kind) else { continue };
        let (used, wanted) = (1e6 * used.abs(), yarn.twist_per_m);
        if (used - wanted).abs() > 0.02 * wanted {
            notes.push(format!("{name}: {used:.0} turns a meter in place of {wanted:.0}, so that the cloth repeats"));
        }
    }
    notes
}

fn relaxed(
    mut start: Start,
    thickness_um: Option<f64>,
    effort: Effort,
    go_on: &(dyn Fn() -> bool + Sync),
) -> Result<(Start, Relaxed), SimError> {
    start.elements.thickness_um = thickness_um;
    let relaxed = relax(&mut start.elements, effort, go_on).ok_or(SimError::Stopped)?;
    Ok((start, relaxed))
}

fn finished(
    start: Start,
    spec: &ClothSpec,
    relaxed: Option<Relaxed>,
    mut notes: Vec<String>,
) -> Result<MadeCloth, SimError> {
    notes.splice(0..0, twist_notes(&start, spec));
    notes.extend(houndstooth_note(spec));
    let lattice = start.elements.lattice;
    let curves =
        start.elements.chains.iter().zip(&start.of_chain).map(|(chain, yarn)| smooth(chain, *yarn, &lattice)).collect();
    let curves = ClothCurves { cell_um: lattice.cell_um, yarns: start.yarns, curves };
    let measures = measure(&curves, &lattice, &spec.yarns())?;
    let mut made = MadeCloth { curves, measures, relaxed, notes, colors: colors_of(spec) };
    made.notes.splice(0..0, made.unrest());
    Ok(made)
}

/// The curve of a chain, which lies at the mean height of its elements: they are chords, by l^2 kappa / 12
/// within the arc through their nodes. A spline through nodes lies on that arc, one that has them as
/// control points l^2 kappa / 6 within it.
fn smooth(chain: &Chain, yarn: u32, lattice: &Lattice) -> PlyCurve {
    let mut curve = PlyCurve::through(yarn, chain.radius_um, chain.shift, &chain.points_um, lattice);
    for (control, node) in curve.control_um.iter_mut().zip(&chain.points_um) {
        *control = std::array::from_fn(|k| 0.5 * (control[k] + node[k]));
    }
    curve
}

/// Chains of curves that were read.
fn start_of(curves: &ClothCurves, lattice: Lattice, yarns: &[&YarnOfCloth]) -> Start {
    let chains = curves
        .curves
        .iter()
        .map(|curve| {
            // The kinds of the file are those of the spec.
            let yarn = yarns[curves.yarns[curve.yarn as usize].kind as usize];
            let nodes = nodes_of(curve, &lattice);
            let knots = curve.control_um.len() as f64;
            let points_um = (0..nodes).map(|i| curve.at(&lattice, i as f64 * knots / nodes as f64).point_um).collect();
            Chain {
                points_um,
                shift: curve.shift,
                radius_um: curve.radius_um,
                tension: yarn.tension,
                bending: yarn.stiffness * yarn.tension * curve.radius_um * curve.radius_um,
                // Curves of other programs keep the length of their yarn.
                length_um: Some(curve.length_um(&lattice)),
            }
        })
        .collect();
    let elements = Elements { lattice, chains, stations: Vec::new(), thickness_um: None };
    let of_chain = curves.curves.iter().map(|c| c.yarn).collect();
    Start { elements, yarns: curves.yarns.clone(), of_chain, twists: Vec::new() }
}

/// Nodes of a curve that was read.
fn nodes_of(curve: &PlyCurve, lattice: &Lattice) -> usize {
    ((curve.length_um(lattice) / (super::woven::ELEMENT[0] * curve.radius_um)).ceil().min(1e9) as usize).max(8)
}
