//! All tables of a cloth as named arrays, for hosts that evaluate it on machines of their own (GPUs,
//! differentiating compilers): `python/plywave/mitsuba` is one.
//!
//! With these arrays, the files of the ply models and the formulas of this folder, [`ClothModel`] can be
//! rebuilt. Arrays are flat, last index fastest; lengths in um. Kinds are those of the
//! cloth's yarns, one or two.
//!
//! | name | shape | |
//! |---|---|---|
//! | `cell_um` | `[2][2]` | vectors of the cell, the shortest ones of its lattice |
//! | `scalars` | `[3]` | height above which there is no ply, greatest radius, L of `curve` |
//! | `options` | `[4]` | speckle, layers, shadowing, edges |
//! | `uneven`, `uneven_seed` | `[n][7]`, `[n]` | of each uneven kind of yarn: the unit vector across it, distance of two yarns, place of one, length over which it changes, deviations of width and of place (`src/cloth/uneven.rs`), seed |
//! | `gap` | `[3]` | of diffracted light: height above which no line comes near a ply, step of the edges of `apertures`, reach of the beam |
//! | `gap_counts`, `gap_voxel`, `gap_entry` | | as `counts`, `voxel` and `entry`, of lines that come within the beam's reach of a ply |
//! | `apertures` | `[33][33][74]` | spectra by the distances of their two edges: the factor's eight numbers, g, 65 masses. A point's aperture has the factor of its own edges, and is sampled by the row nearest to them (`src/gap/apertures.rs`) |
//! | `slit_share` | `[2]` | by kind, share of the forward light that slits between fibers take, 0 without slits |
//! | `slits` | `[2][2][74]` or empty | spectra of the slits across and along the ply, as those of `apertures`; empty where no yarn has slits |
//! | `counts` | `[3]` | voxels along each vector of the cell and along z |
//! | `voxel` | `[voxels + 1]` | first entry of each voxel |
//! | `entry` | `[entries][3]` | piece, and the cells by which it is moved, plus 2^15 |
//! | `piece` | `[pieces][16]` | coefficients of the powers of u from 0 to 3, of x, y and z each; radius; reach about the chord; parameter of the curve at u = 0 and its growth to u = 1 |
//! | `piece_curve` | `[pieces]` | curve |
//! | `curve_of` | `[curves][8]` | kind; first place in `shadow_free` and number of places; number of the yarn and what is added for each cell along the vectors, modulo 2^32; curve; knots |
//! | `places_per_knot` | `[curves]` | places for a step of 1 of the parameter |
//! | `twist` | `[curves]` | turn of the fibers for a step of 1 of the parameter [rad] |
//! | `along` | `[curves, 3]` | way along the curve for a step of 1 of the parameter, and of one vector of the cell and the other [um] |
//! | `relief` | `[kinds][6]` | of each model: number of fibers around, 0 where it shows none, radius of their ring, share that is free, radius of a fiber, widths of the bumps of f_refl and f_high (`src/ply/relief.rs`) |
//! | `kind` | `[kinds][2]` | 1 where yarns run along y, 0 along x; radius of the model's ply over that of the curves |
//! | `exit_shapes` | `[kinds][3][65][2]` | of each model how light lies across a ply where it leaves: mode and length over R, by kind of light and mean over R, 0 to 0.97 |
//! | `passed`, `passed_h_um` | `[kinds][16][65]`, `[kinds]` | of each model r_d of lines, summed over offsets from -h to h, over h; latitudes from 0 to a right angle |
//! | `dye_rgb`, `dye_spectrum` | `[dyes][3]`, `[dyes][81]` | absorptions [1/um] of linear sRGB, and at 0.38 to 0.78 um |
//! | `dyes_0`, `dyes_1` | `[yarns]` | of each kind, the dye of each yarn by its number, which repeats |
//! | `dye_mean` | `[kinds]` | the dye of the mean color of each kind's yarns |
//! | `curve` | `[..][2]` | v = 1 / (1 + sigma L) and the cloth's brightness |
//! | `shadow_free` | `[places][18][16][8]` | shares that get out, 255 for 1.35 |
//! | `between_caught` | `[2][classes][3][8][168]` | by side, class, sent up, down and all, absorption: splines of the direction; 8 classes, with hairs 12 |
//! | `between_leaves` | `[2][classes][2][2][64][8]` | by side, class, sent, leaves, pair of absorptions |
//! | `between_shape` | `[2][2][64][16]` | by side, leaves, pair |
//! | `between_parallel` | `[2][classes][2][2][8][8]` | by side, class, sent, leaves, absorption: of that, what one kind of yarns alone has scattered |
//! | `between_cones` | `[2][2][2][50]` | by side, kind, leaves: width, 16 terms of the energy, 33 norms |
//! | `hair_area` | `[2][2][8]` | of cloths with hairs: by side, kind and cosine, area of the hairs that are seen over that of the cloth (`src/cloth/hair_layer.rs`) |
//! | `hair_scatter` | `[2][8][16][12][8]` | by kind, cosine of the viewer and of the light, azimuth, absorption: density of the light that a hair scatters |
//! | `far_phi_i`, `far_theta_i`, `far_sigma` | `[15]`, `[11]`, `[8]` | of the mean over the cell: nodes of a view's azimuth on one side and latitude [degrees], and of absorption [1/um]; these and the next only of cloths loaded with `ClothOptions::far` |
//! | `far_f` | `[kinds][330][24][17][8]` | f times the cosine of the light's latitude, by kind and view, azimuth and latitude of the light, absorption |
//! | `far_chances` | `[kinds][330][2][384]` | sums of the energies up to a part's end, of clear and dark fibers |
//! | `far_energy`, `far_first` | `[kinds][330][2][8]`, `[kinds][330][4][8]` | on both sides of the cone, the integral of f over the angle from it to the axis; energies that first plies scatter, by class |
//! | `far_passing`, `far_apertures` | `[330]`, `[330][10]` | what passes; how many apertures stand for those of the cell, and of each of three the rows of `apertures` of its axes and by how much they are turned, in 256ths of a right angle |

use super::ClothModel;
use super::between::{CLASSES, CLASSES_A_KIND, PAIRS, PLY_CLASSES, SIGMAS, Side};
use super::far;
use super::file::{CONE_NUMBERS, cone_numbers};
use super::grid::Entry;
use super::hair_layer::{HAIR_AZIMUTHS, HAIR_COSINES};
use super::lines::LineTables;
use super::plies::{ClothPlies, Runs};
use super::shadow::{COLUMNS, LANES, ROWS};
use super::splines::{COUNT, Several};
use super::terms::{FEW, TERMS};
use super::uneven::UnevenKind;
use crate::PlyModel;
use crate::color::SPECTRUM_NODES;
use crate::gap::{EDGES, SPECTRUM_CELLS, Slit, Spectrum};
use crate::ply::{EXIT_KINDS, ExitShape, PASSED_COLUMNS, PASSED_ROWS, Relief};
use std::sync::Arc;

/// Numbers of a [`Tensor`].
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Single precision.
    F32(Vec<f32>),
    /// Indices.
    U32(Vec<u32>),
    /// Bytes.
    U8(Vec<u8>),
}

/// A named array.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Name.
    pub name: &'static str,
    /// Its sizes, last index fastest.
    pub shape: Vec<usize>,
    /// Its numbers.
    pub values: Values,
}

impl ClothModel {
    /// The models of the kinds of yarns.
    pub fn models(&self) -> &[Arc<PlyModel>] {
        &self.plies.models
    }

    /// The tables of the cloth, each described in the head of src/cloth/tensors.rs; those of its models are
    /// in their files, [`crate::ply::PlyData::to_bytes`].
    pub fn tensors(&self) -> Vec<Tensor> {
        let mut all = Vec::new();
        let mut add = |name, shape: &[usize], values| all.push(Tensor { name, shape: shape.to_vec(), values });
        curves(&self.plies, &mut add);
        let mut f32s = |name, shape: &[usize], values| add(name, shape, Values::F32(values));
        let (length_um, curve) = self.curve.nodes().unwrap_or((1.0, &[]));
        let scalars = [self.lines().half_thickness_um(), self.lines().largest_um(), length_um as f32];
        f32s("scalars", &[3], scalars.to_vec());
        let o = &self.options;
        f32s("options", &[4], [o.noise, o.layers, o.shadowing, o.edges].map(|on| f32::from(u8::from(on))).to_vec());
        let uneven = &self.uneven.kinds;
        let numbers = uneven.iter().flat_map(UnevenKind::numbers).collect();
        f32s("uneven", &[uneven.len(), 7], numbers);
        let kinds = self.plies.kinds;
        let (dyes, of_yarns, means) = self.dyes.tables();
        let dyes: Vec<_> = dyes.iter().map(|dye| dye.numbers()).collect();
        let reliefs = self.plies.models.iter().flat_map(|model| model.relief().map_or([0.0; 6], Relief::numbers));
        f32s("relief", &[kinds, 6], reliefs.collect());
        f32s("twist", &[self.plies.twist.len()], self.plies.twist.clone());
        // The vectors of the tables in those of the plies' cell.
        let vectors = self.lines().cell().1;
        let along = self.plies.along_um.iter().flat_map(|[step, a, b]| {
            let [first, second] = vectors.map(|[i, j]| i as f32 * a + j as f32 * b);
            [*step, first, second]
        });
        f32s("along", &[self.plies.along_um.len(), 3], along.collect());
        f32s("dye_rgb", &[dyes.len(), 3], dyes.iter().flat_map(|d| d.0).collect());
        f32s("dye_spectrum", &[dyes.len(), SPECTRUM_NODES], dyes.iter().flat_map(|d| d.1).collect());
        f32s("curve", &[curve.len(), 2], curve.iter().flat_map(|(v, value)| [*v as f32, *value as f32]).collect());
        let of = |values: &dyn Fn(&Side) -> Vec<f32>| self.between.sides.iter().flat_map(values).collect::<Vec<f32>>();
        let by_node = |of: &Several<SIGMAS>| (0..SIGMAS).flat_map(|node| of.map(|c| c[node])).collect::<Vec<_>>();
        // Without hairs, their classes are left out.
        let a_kind = if self.hairs.is_some() { CLASSES_A_KIND } else { PLY_CLASSES };
        let classes: Vec<usize> = (0..CLASSES).filter(|class| class % CLASSES_A_KIND < a_kind).collect();
        let count = classes.len();
        let caught = |s: &Side| -> Vec<f32> {
            classes.iter().flat_map(|class| s.caught[3 * class..3 * class + 3].iter().flat_map(by_node)).collect()
        };
        f32s("between_caught", &[2, count, 3, SIGMAS, COUNT], of(&caught));
        let leaves = |s: &Side| -> Vec<f32> {
            let of = 4 * PAIRS;
            classes.iter().flat_map(|class| s.leaves[of * class..of * class + of].as_flattened().to_vec()).collect()
        };
        f32s("between_leaves", &[2, count, 2, 2, PAIRS, FEW], of(&leaves));
        f32s("between_shape", &[2, 2, PAIRS, TERMS], of(&|s| s.shape.as_flattened().to_vec()));
        let parallel = |s: &Side| -> Vec<f32> {
            let of = |class: &usize| s.parallel[4 * class..4 * class + 4].as_flattened().as_flattened().to_vec();
            classes.iter().flat_map(of).collect()
        };
        f32s("between_parallel", &[2, count, 2, 2, SIGMAS, FEW], of(&parallel));
        f32s("between_cones", &[2, 2, 2, CONE_NUMBERS], of(&|s| cone_numbers(s)));
        if let Some(hairs) = &self.hairs {
            f32s("hair_area", &[2, 2, HAIR_COSINES], hairs.area.as_flattened().as_flattened().to_vec());
            let shape = [2, HAIR_COSINES, 2 * HAIR_COSINES, HAIR_AZIMUTHS, SIGMAS];
            f32s("hair_scatter", &shape, hairs.scatter.as_flattened().to_vec());
        }
        if let Some(far) = &self.far {
            let ([f, chances, energy, first, passing], _) = far.numbers();
            f32s("far_phi_i", &[far::PHI_I_DEG.len()], far::PHI_I_DEG.to_vec());
            f32s("far_theta_i", &[far::THETA_I_DEG.len()], far::THETA_I_DEG.to_vec());
            f32s("far_sigma", &[far::SIGMAS], far::SIGMA_PER_UM.to_vec());
            f32s("far_f", &[kinds, far::VIEWS, far::COLUMNS, far::NODES, far::SIGMAS], f);
            f32s("far_chances", &[kinds, far::VIEWS, 2, far::CELLS], chances);
            f32s("far_energy", &[kinds, far::VIEWS, 2, far::SIGMAS], energy);
            f32s("far_first", &[kinds, far::VIEWS, PLY_CLASSES, far::SIGMAS], first);
            f32s("far_passing", &[far::VIEWS], passing);
            let openings = far.numbers().1;
            add("far_apertures", &[far::VIEWS, far::OPENING_NUMBERS], Values::U32(openings));
        }
        for (name, dyes) in ["dyes_0", "dyes_1"].into_iter().zip(of_yarns).take(kinds) {
            add(name, &[dyes.len()], Values::U32(dyes.clone()));
        }
        add("uneven_seed", &[uneven.len()], Values::U32(uneven.iter().map(|kind| kind.seed).collect()));
        add("dye_mean", &[kinds], Values::U32(means[..kinds].to_vec()));
        let (shares, numbers) = slit_numbers(&self.slits);
        add("slit_share", &[2], Values::F32(shares));
        add("slits", &[numbers.len() / (2 * (10 + SPECTRUM_CELLS)), 2, 10 + SPECTRUM_CELLS], Values::F32(numbers));
        if let Some(gaps) = &self.gaps {
            let (spectra, step_um) = (gaps.apertures(), gaps.apertures().step_um);
            let numbers = [gaps.grid().half_thickness_um, step_um, spectra.reach_um()];
            add("gap", &[3], Values::F32(numbers.to_vec()));
            let numbers = spectra.spectra.iter().flat_map(Spectrum::numbers).collect();
            add("apertures", &[EDGES + 1, EDGES + 1, 10 + SPECTRUM_CELLS], Values::F32(numbers));
            let (first, entries, _) = gaps.grid().tables();
            add("gap_counts", &[3], Values::U32(gaps.grid().counts.map(|n| n as u32).to_vec()));
            add("gap_voxel", &[first.len()], Values::U32(first));
            add("gap_entry", &[entries.len(), 3], Values::U32(words(&entries)));
        }
        let shadows = self.shadows.free();
        let shape = [shadows.len() / (2 * ROWS * COLUMNS * LANES), 2 * ROWS, COLUMNS, LANES];
        add("shadow_free", &shape, Values::U8(shadows.to_vec()));
        let mut first = 0;
        let (mut of, mut per_knot) = (Vec::new(), Vec::new());
        for (curve, places) in self.shadows.counts().enumerate() {
            let knots = self.lines().knots(curve);
            let yarn = &self.plies.yarns[self.plies.of_curve[curve] as usize];
            let kind = self.plies.kind_of[curve] as u32;
            let [a, b] =
                vectors.map(|by| yarn.step[0].wrapping_mul(by[0]).wrapping_add(yarn.step[1].wrapping_mul(by[1])));
            let [number, a, b] = [yarn.number, a, b].map(|n| n as u32);
            of.extend([kind, first, places, number, a, b, curve as u32, knots as u32]);
            per_knot.push(places as f32 / knots as f32);
            first += places;
        }
        add("curve_of", &[per_knot.len(), 8], Values::U32(of));
        add("places_per_knot", &[per_knot.len()], Values::F32(per_knot));
        all
    }
}

/// Entries of voxels as words.
fn words(entries: &[Entry]) -> Vec<u32> {
    let numbers = entries.iter().flat_map(|(piece, cells)| {
        let [i, j] = cells.map(|c| (i32::from(c) + (1 << 15)) as u32);
        [*piece, i, j]
    });
    numbers.collect()
}

/// The curves in the voxels of their grid, and the models of their plies.
fn curves(plies: &ClothPlies, add: &mut impl FnMut(&'static str, &[usize], Values)) {
    add("cell_um", &[2, 2], Values::F32(plies.lines.cell().0.as_flattened().to_vec()));
    let LineTables { counts, first, entries, pieces } = plies.lines.tables();
    add("counts", &[3], Values::U32(counts.to_vec()));
    add("voxel", &[first.len()], Values::U32(first));
    add("entry", &[entries.len(), 3], Values::U32(words(&entries)));
    add("piece_curve", &[pieces.len()], Values::U32(pieces.iter().map(|p| p.0).collect()));
    add("piece", &[pieces.len(), 16], Values::F32(pieces.iter().flat_map(|p| p.1).collect()));
    let runs = |kind: usize| f32::from(u8::from(plies.runs[kind] == Runs::AlongY));
    let kinds = (0..plies.kinds).flat_map(|kind| [runs(kind), plies.scale[kind]]);
    add("kind", &[plies.kinds, 2], Values::F32(kinds.collect()));
    let models = &plies.models;
    let [means, two] = ExitShape::usual()[0].numbers().1;
    let shapes = models.iter().flat_map(|m| m.exit_shapes());
    let numbers = shapes.flat_map(|shape| shape.numbers().0.iter().copied()).collect();
    add("exit_shapes", &[models.len(), EXIT_KINDS, means, two], Values::F32(numbers));
    let passed: Vec<_> = models.iter().filter_map(|m| m.passed_lines()).map(|passed| passed.numbers()).collect();
    let sums = passed.iter().flat_map(|(sums, _)| sums.iter().copied()).collect();
    add("passed", &[passed.len(), PASSED_ROWS, PASSED_COLUMNS], Values::F32(sums));
    add("passed_h_um", &[passed.len()], Values::F32(passed.iter().map(|(_, last_h_um)| *last_h_um).collect()));
}

/// Shares of light of the slits of two kinds of yarns, and their spectra; none where no yarn has slits.
fn slit_numbers(slits: &[Option<Slit>; 2]) -> (Vec<f32>, Vec<f32>) {
    let shares = slits.iter().map(|slit| slit.map_or(0.0, |slit| slit.share())).collect();
    // Yarns without slits have the numbers of the others', which their share leaves out.
    let spectra = slits.iter().filter_map(|slit| slit.or(slits[0]).or(slits[1]));
    (shares, spectra.flat_map(|slit| slit.numbers().collect::<Vec<_>>()).collect())
}
