//! From a cloth spec to relaxed curves.
//!
//! A weave or a knit is laid out on its cell and relaxed; curves of a file are taken as they are or relaxed.
//! The result is checked for overlapping plies and measured. For a weave that is too dense, a bisection over
//! its spacings finds the densest one that fits, which the error then names.

use super::files::{compare_counts, source_curves};
use super::knit::knitted;
use super::large::{self, LARGE};
use super::measure::{ClothMeasures, measure};
use super::precompute::Effort;
use super::relax::{Chain, Elements, MAX_OVERLAP, Relaxed, Rest, part, relax};
use super::woven::{ELEMENT, Start, max_nodes, minimal_cell, smooth, woven, woven_in};
use crate::error::SimError;
use plywave::Error;
use plywave::cloth::{Buckets, ClothCurves, Lattice, MAX_CURVE_POINTS, PlyCurve, YarnColor, YarnLook};
use plywave_textile::{
    ClothSpec, ClothWeave, Draft, KnitKind, NamedWeave, WeaveSpec, Wif, YarnOfCloth, YarnSet, check_floats,
};

/// Maximum unbalanced force of a cloth at rest, over the mean tension of a strand.
pub const MAX_FORCE: f64 = 0.05;
/// Maximum overlap of two plies of a cloth over their mean radius: relaxed yarns reach it, and it is not
/// visible in renderings.
const MAX_SHARED: f64 = 0.05;
/// Overlap over the radius above which the yarns of a draft are parted, and number of rounds.
const PARTED: f64 = 0.03;
const ROUNDS: usize = 20;
/// Search for spacings that fit a weave that is too dense: growth factor of a step, maximum number of steps,
/// and bisections of the last step.
const WIDER: f64 = 1.3;
const TRIES: i32 = 6;
const HALVINGS: usize = 4;

/// Curves of a cloth with their measures and notes.
#[derive(Clone, Debug)]
pub struct MadeCloth {
    /// The curves.
    pub curves: ClothCurves,
    /// Measures.
    pub measures: ClothMeasures,
    /// Result of the relaxation; `None` for curves that were taken as they are.
    pub relaxed: Option<Relaxed>,
    /// Notes for the user, such as layers that no yarn joins, a rounded twist, or remarks on a WIF.
    pub notes: Vec<String>,
    /// Looks of the yarns by kind, with the colors of the spec or else of its WIF.
    pub looks: Vec<YarnLook>,
}

impl MadeCloth {
    /// For a cloth that did not come to rest, one line with the unbalanced force and hints; it is also the
    /// first of the notes.
    pub fn unrest(&self) -> Option<String> {
        self.relaxed.filter(|relaxed| relaxed.force.is_nan() || relaxed.force > MAX_FORCE).map(|relaxed| {
            format!(
                "the cloth did not come to rest: forces up to {:.2} of the tension are not balanced after {} steps, {MAX_FORCE} is the limit; \
                 give its yarns more room: wider spacings or stitches, finer yarns, a lower stiffness or a larger thickness_um",
                relaxed.force, relaxed.steps
            )
        })
    }
}

/// Range of spacings that are accepted from a WIF [um]; some programs write arbitrary defaults.
const SPACING_UM: std::ops::RangeInclusive<f64> = 10.0..=1e5;

/// Makes the curves of a cloth. `read` returns the bytes of the file that the spec names, a WIF or curves.
/// `go_on` is called at every step of the relaxation with the estimated share that is done, from 0 to 1, and
/// stops it by returning `false`. With [`Effort::Draft`] forces are balanced less exactly, and yarns of a
/// large draft are laid out and parted where they overlap instead of relaxed.
///
/// # Errors
/// [`SimError::Stopped`], and [`Error::Invalid`] for a draft that leaves a yarn unbound, for yarns too thick
/// for their spacing, and for invalid files.
pub fn make_cloth(
    spec: &ClothSpec,
    file: &str,
    read: &mut dyn FnMut(&str) -> Result<Vec<u8>, Error>,
    effort: Effort,
    go_on: &(dyn Fn(f64) -> bool + Sync),
) -> Result<MadeCloth, SimError> {
    let mut notes = Vec::new();
    let rest = if effort == Effort::Draft { Rest::Near } else { Rest::Full };
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
                WeaveSpec::Picture(picture) => {
                    let made = picture.draft(file, &read(&picture.picture)?)?;
                    notes.extend(made.notes);
                    notes.extend(picture.rotation_note(yarns[1].colors().len()));
                    made.draft
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
            // The notes of a WIF already include it, with the thread numbers of the file.
            if draft != Draft::layers() && !matches!(weave, WeaveSpec::Wif { .. }) {
                notes.extend(draft.layers_note());
            }
            let mut spacing = [1.0; 2];
            for (k, key) in ["weave.ends_per_cm", "weave.picks_per_cm"].into_iter().enumerate() {
                spacing[k] = match (spec.spacing_um(YarnSet::EACH[k]), &spacings[k]) {
                    (Some(own), _) => own,
                    (None, Some(in_wif)) if SPACING_UM.contains(&in_wif.um) => {
                        notes.push(format!("{key} = {:.1} from {}", 1e4 / in_wif.um, in_wif.source));
                        in_wif.um
                    }
                    (None, in_wif) => {
                        let hint = match in_wif {
                            None => "give this key; the WIF has no Spacing and no Thickness for it".into(),
                            Some(spacing) => {
                                format!("give this key; {} in the WIF is {:.1} um", spacing.source, spacing.um)
                            }
                        };
                        return Err(invalid(key, "(absent)".into(), hint));
                    }
                };
            }
            check_floats(file, "weave", &draft, spacing)?;
            let loom = Loom { spec, file, draft, yarns, spacing_um: spacing, rest, go_on };
            let mut made = loom.weave(notes)?;
            for (look, colors) in made.looks.iter_mut().zip(in_wif) {
                if look.colors == [YarnColor::Undyed] && !colors.is_empty() {
                    look.colors = colors.into_iter().map(YarnColor::Srgb).collect();
                }
            }
            Ok(made)
        }
        ClothWeave::Knitted(knit, yarn) => {
            let read = match &knit.kind {
                KnitKind::Picture(picture) => KnitKind::Chart(picture.chart(file, &read(&picture.picture)?)?),
                other => other.clone(),
            };
            let start = knitted(knit, &read, yarn).map_err(|(key, value, hint)| invalid(key, value, hint))?;
            let (start, relaxed) = relaxed(start, spec.thickness_um, rest, go_on)?;
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
                let made = MadeCloth { curves, measures, relaxed: None, notes, looks: spec.looks() };
                check_shared(&made, spec).map_err(|(value, what)| {
                    let hint = format!("{what}; use relax = true, or curves that do not pass through each other");
                    invalid("curves.file", value, hint)
                })?;
                return Ok(made);
            }
            let nodes: f64 = curves.curves.iter().map(|curve| nodes_of(curve, &lattice) as f64).sum();
            let largest = curves.curves.iter().map(|curve| curve.radius_um).fold(0.0, f64::max);
            let most = max_nodes(&yarns);
            // Unevenly sampled curves have longer elements, hence the factor 8.
            if nodes > most || !Buckets::can_search(&lattice, nodes as usize, 8.0 * largest) {
                let hint = format!("its curves are too long to relax; use relax = false, or {most:.0e} nodes at most");
                return Err(invalid("curves.file", format!("{nodes:.1e} nodes"), hint));
            }
            let start = start_of(&curves, lattice, &yarns);
            let (start, relaxed) = relaxed(start, spec.thickness_um, rest, go_on)?;
            let made = finished(start, spec, Some(relaxed), notes)?;
            check_shared(&made, spec).map_err(|(value, what)| {
                let hint = format!("{what} after {} steps; use finer yarns or a wider cell", relaxed.steps);
                invalid("curves.file", value, hint)
            })?;
            Ok(made)
        }
    }
}

/// A draft with its yarns and their spacings, about to be woven.
struct Loom<'a> {
    spec: &'a ClothSpec,
    file: &'a str,
    draft: Draft,
    yarns: [&'a YarnOfCloth; 2],
    spacing_um: [f64; 2],
    rest: Rest,
    go_on: &'a (dyn Fn(f64) -> bool + Sync),
}

impl Loom<'_> {
    fn invalid(&self, key: &str, value: String, hint: String) -> SimError {
        Error::Invalid { file: self.file.into(), key: key.into(), value, hint }.into()
    }

    /// The curves of the draft.
    fn weave(&self, notes: Vec<String>) -> Result<MadeCloth, SimError> {
        let [i, _, k] = minimal_cell(&self.draft);
        let made = match (i * k < LARGE, self.rest) {
            (true, _) => self.weave_whole(notes)?,
            (false, Rest::Full) => self.weave_tiles(notes)?,
            (false, Rest::Near) => return self.sketch(notes),
        };
        check_shared(&made, self.spec).map_err(|(value, what)| self.invalid("weave", value, what))?;
        Ok(made)
    }

    /// Lays the yarns of a large draft out and parts them where they overlap, without forces.
    fn sketch(&self, mut notes: Vec<String>) -> Result<MadeCloth, SimError> {
        let draft = self.draft.reduced();
        self.check_size(&draft)?;
        let cell = [draft.ends(), 0, draft.picks()];
        let element_um = self.yarns.map(|yarn| ELEMENT[1] * yarn.strand_radius_um());
        let start = woven_in(cell, &draft, self.yarns, self.spacing_um, element_um);
        let mut start = start.ok_or_else(|| self.no_cell())?;
        start.elements.thickness_um = self.spec.thickness_um;
        part(&mut start.elements, PARTED, ROUNDS);
        if !(self.go_on)(1.0) {
            return Err(SimError::Stopped);
        }
        notes.push("a draft: yarns are laid out and parted, not relaxed".into());
        finished(start, self.spec, None, notes)
    }

    fn no_cell(&self) -> SimError {
        self.invalid("weave", "(spacing)".into(), "use spacings above 0".into())
    }

    /// Refuses a draft whose yarns need more points than a cloth may have.
    fn check_size(&self, draft: &Draft) -> Result<(), SimError> {
        let points = large::points(draft, self.yarns, self.spacing_um) as f64;
        let most = MAX_CURVE_POINTS as f64;
        if points <= most {
            return Ok(());
        }
        let hint = format!(
            "the repeat is too large: its yarns need {points:.1e} points, {most:.1e} at most; \
             use fewer ends, picks, plies or bundles"
        );
        Err(self.invalid("weave", format!("{} x {} threads", draft.ends(), draft.picks()), hint))
    }

    /// Relaxes all crossings of the smallest cell together.
    fn weave_whole(&self, notes: Vec<String>) -> Result<MadeCloth, SimError> {
        let nodes = super::woven::nodes(&self.draft, self.yarns, self.spacing_um);
        let most = max_nodes(&self.yarns);
        if nodes > most {
            let hint =
                format!("the repeat is too large to relax; use fewer ends, picks or bundles, {most:.0e} nodes at most");
            return Err(self.invalid("weave", format!("{nodes:.1e} nodes"), hint));
        }
        let start = self.start(&self.draft, self.spacing_um)?;
        let (start, relaxed) = relaxed(start, self.spec.thickness_um, self.rest, self.go_on)?;
        if relaxed.overlap > MAX_OVERLAP {
            return Err(self.too_dense(&self.draft, relaxed.overlap)?);
        }
        finished(start, self.spec, Some(relaxed), notes)
    }

    /// Lays out a large draft from tiles that are relaxed by themselves.
    fn weave_tiles(&self, mut notes: Vec<String>) -> Result<MadeCloth, SimError> {
        let draft = self.draft.reduced();
        self.check_size(&draft)?;
        let large = large::large(&draft, self.yarns, self.spacing_um, self.spec.thickness_um, self.go_on);
        let large = large.ok_or(SimError::Stopped)?;
        if large.relaxed.overlap > MAX_OVERLAP {
            return Err(self.too_dense(&large.densest, large.relaxed.overlap)?);
        }
        let [crossings, windows, relaxed] = large.counts;
        notes.push(format!(
            "{windows} of {crossings} crossings have neighborhoods of their own; {relaxed} were relaxed in tiles"
        ));
        let curves = large::curves(&large);
        finished_curves(&large.start, curves, self.spec, Some(large.relaxed), notes)
    }

    fn start(&self, draft: &Draft, spacing_um: [f64; 2]) -> Result<Start, SimError> {
        let start = woven(draft, self.yarns, spacing_um);
        start.ok_or_else(|| self.no_cell())
    }

    /// The error for a draft whose yarns overlap by this share of their radius, with the spacings that go.
    fn too_dense(&self, draft: &Draft, overlap: f64) -> Result<SimError, SimError> {
        let thickness_um = self.spec.thickness_um;
        let overlap_um = overlap * 0.5 * (self.yarns[0].strand_radius_um() + self.yarns[1].strand_radius_um());
        // A draft is near enough; the rest of its overlap stays below the limit.
        let goes = |scale: f64| -> Result<bool, SimError> {
            let start = self.start(draft, self.spacing_um.map(|s| s * scale))?;
            let tried = relaxed(start, thickness_um, Rest::Near, &|_| (self.go_on)(1.0))?.1;
            Ok(tried.overlap <= 0.95 * MAX_OVERLAP)
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
                if thickness_um.is_some() { " or a larger thickness_um" } else { "" }
            );
            return Ok(self.invalid("warp.count", format!("{:.2} tex", self.yarns[0].tex()), hint));
        };
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            *(if goes(middle)? { &mut high } else { &mut low }) = middle;
        }
        // What is told goes at full effort, too.
        let mut per_cm = self.spacing_um.map(|s| (1e5 / (s * high)).floor() / 10.0);
        for _ in 0..TRIES {
            let start = self.start(draft, per_cm.map(|per_cm| 1e4 / per_cm))?;
            let told = relaxed(start, thickness_um, Rest::Full, &|_| (self.go_on)(1.0))?.1;
            if told.overlap <= MAX_OVERLAP {
                break;
            }
            per_cm = per_cm.map(|per_cm| (9.8 * per_cm).floor() / 10.0);
        }
        let hint = format!(
            "the yarns are too thick: they overlap by {overlap_um:.1} um; at most {} ends and {} picks a cm go",
            per_cm[0], per_cm[1]
        );
        Ok(self.invalid("weave.ends_per_cm", self.spec.per_cm[0].unwrap_or_default().to_string(), hint))
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
    Err((format!("{:.2} tex", yarn.tex()), hint))
}

/// Checks the overlap of plies; the error is the value and a sentence with the names of the yarns.
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

/// Note for a houndstooth whose stripes are not those of the pattern.
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

/// Notes on twists that were rounded because the cloth is periodic.
fn twist_notes(start: &Start, spec: &ClothSpec) -> Vec<String> {
    let mut notes = Vec::new();
    for (kind, yarn) in spec.yarns().iter().enumerate() {
        let name = spec.kind_name(kind);
        let Some((_, used)) = start.twists.iter().find(|(of, _)| *of as usize == kind) else { continue };
        let (used, wanted) = (1e6 * used.abs(), yarn.strand_twist.1);
        if (used - wanted).abs() > 0.02 * wanted {
            notes.push(format!("{name}: {used:.0} turns a meter in place of {wanted:.0}, so that the cloth repeats"));
        }
    }
    notes
}

fn relaxed(
    mut start: Start,
    thickness_um: Option<f64>,
    rest: Rest,
    go_on: &(dyn Fn(f64) -> bool + Sync),
) -> Result<(Start, Relaxed), SimError> {
    start.elements.thickness_um = thickness_um;
    let relaxed = relax(&mut start.elements, rest, go_on).ok_or(SimError::Stopped)?;
    Ok((start, relaxed))
}

fn finished(
    start: Start,
    spec: &ClothSpec,
    relaxed: Option<Relaxed>,
    notes: Vec<String>,
) -> Result<MadeCloth, SimError> {
    let lattice = start.elements.lattice;
    let curves =
        start.elements.chains.iter().zip(&start.of_chain).map(|(chain, yarn)| smooth(chain, *yarn, &lattice)).collect();
    finished_curves(&start, curves, spec, relaxed, notes)
}

/// The cloth of these curves of its chains.
fn finished_curves(
    start: &Start,
    curves: Vec<PlyCurve>,
    spec: &ClothSpec,
    relaxed: Option<Relaxed>,
    mut notes: Vec<String>,
) -> Result<MadeCloth, SimError> {
    notes.splice(0..0, twist_notes(start, spec));
    notes.extend(houndstooth_note(spec));
    let lattice = start.elements.lattice;
    let curves = ClothCurves { cell_um: lattice.cell_um, yarns: start.yarns.clone(), curves };
    let measures = measure(&curves, &lattice, &spec.yarns())?;
    let mut made = MadeCloth { curves, measures, relaxed, notes, looks: spec.looks() };
    made.notes.splice(0..0, made.unrest());
    Ok(made)
}

/// The starting chains of curves from a file.
fn start_of(curves: &ClothCurves, lattice: Lattice, yarns: &[&YarnOfCloth]) -> Start {
    let chains = curves
        .curves
        .iter()
        .map(|curve| {
            // `check_kinds` has ensured that the spec has this kind.
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
                // Curves of other programs keep the length of their yarns.
                length_um: Some(curve.length_um(&lattice)),
            }
        })
        .collect();
    let elements = Elements { lattice, chains, sections: Vec::new(), thickness_um: None };
    let of_chain = curves.curves.iter().map(|c| c.yarn).collect();
    Start { elements, yarns: curves.yarns.clone(), of_chain, twists: Vec::new() }
}

/// Number of nodes for a curve from a file.
fn nodes_of(curve: &PlyCurve, lattice: &Lattice) -> usize {
    ((curve.length_um(lattice) / (super::woven::ELEMENT[0] * curve.radius_um)).ceil().min(1e9) as usize).max(8)
}
