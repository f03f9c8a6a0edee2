//! All tables of a cloth as named arrays, for hosts that evaluate it on other devices (GPUs, differentiating
//! compilers); `python/plywave/mitsuba` is one such host.
//!
//! With these arrays, the files of the ply models and the formulas of this folder, a [`ClothModel`] can be
//! rebuilt. Arrays are flat with the last index fastest; lengths are in um. Kinds are the one or two kinds of
//! the cloth's yarns, warp and weft.
//!
//! | name | shape | contents |
//! |---|---|---|
//! | `cell_um` | `[2][2]` | vectors of the cell [um], the shortest ones of its lattice |
//! | `scalars` | `[3]` | height above which there is no ply [um], largest radius [um], L of `curve` [um] |
//! | `options` | `[4]` | 1 or 0 for speckle, layers, shadowing, edges |
//! | `uneven`, `uneven_seed` | `[n][7]`, `[n]` | for each uneven kind of yarn: unit vector across it, distance between yarns, position of one yarn, length over which the values change, deviations of width and of displacement (`src/cloth/geometry/uneven.rs`); and the seed |
//! | `gap` | `[3]` | if gaps diffract light: height above which no line comes near a ply, step of the edges of `apertures`, reach of the beam [um] |
//! | `gap_counts`, `gap_voxel`, `gap_entry` | | as `counts`, `voxel` and `entry`, for lines that come within the beam's reach of a ply |
//! | `apertures` | `[33][33][74]` | spectra by the distances of their two edges: the factor's eight numbers, g, 65 masses. The aperture at a point has the factor of its own edges and is sampled from the nearest row (`src/gap/apertures.rs`) |
//! | `slit_share` | `[2]` | by kind: share of the forward light that passes through slits between fibers, 0 without slits |
//! | `slits` | `[2][2][74]` or empty | by kind, across and along the ply: spectra of the slits, in the layout of `apertures`; empty if no yarn has slits |
//! | `counts` | `[3]` | number of voxels along each vector of the cell and along z |
//! | `voxel` | `[voxels + 1]` | first entry of each voxel |
//! | `entry` | `[entries][3]` | index of the piece, and the cells by which it is translated, plus 2^15 |
//! | `piece` | `[pieces][16]` | coefficients of the powers 0 to 3 of u, for x, y and z each; radius; reach about the chord; parameter of the curve at u = 0 and its increase to u = 1 |
//! | `piece_curve` | `[pieces]` | index of the curve |
//! | `curve_of` | `[curves][8]` | kind; first place of its shadows and number of places; number of the yarn and its increase for each cell along the vectors, modulo 2^32; curve; number of knots |
//! | `places_per_knot` | `[curves]` | number of places per unit of the parameter |
//! | `twist` | `[curves]` | rotation of the fibers per unit of the parameter [rad] |
//! | `along` | `[curves, 3]` | arc length along the curve [um] per unit of the parameter, and per step along each vector of the cell |
//! | `relief` | `[kinds][6]` | for each model: number of fibers around, 0 if it shows none; radius of their ring; share that is free; radius of a fiber; widths of the bumps of f_refl and f_high (`src/ply/relief.rs`) |
//! | `kind` | `[kinds][2]` | 1 if the yarns run along y, 0 if along x; radius of the model's ply over that of the curves |
//! | `exit_shapes` | `[kinds][3][65][2]` | for each model, the distribution across a ply of the light that leaves it: mode and length over R, by kind of light and mean over R, 0 to 0.97 |
//! | `passed`, `passed_h_um` | `[kinds][16][65]`, `[kinds]` | for each model, r_d of lines summed over offsets from -h to h, by latitude from 0 to pi/2 and by h; and the last h |
//! | `dye_rgb`, `dye_spectrum` | `[dyes][3]`, `[dyes][81]` | absorptions [1/um] of the channels of linear sRGB, and at wavelengths from 0.38 to 0.78 um |
//! | `dyes_0`, `dyes_1` | `[yarns]` | for each kind, the dye of each yarn by its number, repeated periodically |
//! | `dye_mean` | `[kinds]` | the dye of the mean color of each kind's yarns |
//! | `curve` | `[..][2]` | v = 1 / (1 + sigma L), and the brightness of the cloth |
//! | `shadow_free` | `[tables][18][16][8]` | shares of light that escape, by table, row of both halves, column and offset; 255 represents 1.35 |
//! | `shadow_table` | `[places]` or empty | for each place, its table in `shadow_free`; empty if each place has its own |
//! | `inter_yarn_caught` | `[2][classes][3][8][168]` | by side, class, sent up, sent down or total, absorption: spline coefficients over the direction of the energies that other yarns intercept; 8 classes, 12 with hairs |
//! | `inter_yarn_leaves` | `[2][classes][2][2][64][8]` | by side, class, half it is sent to, half it leaves in, pair of absorptions: polynomial of the energy that leaves per energy that is intercepted |
//! | `inter_yarn_shape` | `[2][2][64][16]` | by side, half it leaves in, pair of absorptions: polynomial of the distribution of directions |
//! | `inter_yarn_parallel` | `[2][classes][2][2][8][8]` | by side, class, half it is sent to, half it leaves in, absorption: the part of `inter_yarn_leaves` that only yarns of one kind have scattered |
//! | `inter_yarn_cones` | `[2][2][2][50]` | by side, kind, half it leaves in: width, 16 terms of the energy, 33 norms (`src/cloth/light/cones.rs`) |
//! | `inter_yarn_places` | `[tables][8][2][2][4]` | by table in `shadow_free`, angle about the ply, side of the light, clear or dark fibers: ratio of inter-yarn light to its mean, coefficients of 1, x, y and z of the light (`src/cloth/light/lit_places.rs`) |
//! | `inter_yarn_place_means` | `[2][168][2][2][4]` | by side of the viewer: spline coefficients of the mean of these over the cell |
//! | `inter_yarn_shape_means` | `[2][2][64][4]` | by side, half it leaves in, pair of absorptions: means of 1, x, y and z over the directions of `inter_yarn_shape` |
//! | `hair_area` | `[2][2][8]` | only for cloths with hairs, by side, kind and cosine: projected area of the visible hairs per area of the cloth (`src/cloth/light/hair_layer.rs`) |
//! | `hair_scatter` | `[2][8][16][12][8]` | by kind, cosine of the viewer, cosine of the light, azimuth, absorption: density of the light that a hair scatters [1/sr] |
//! | `hair_field` | `[17]` | means of the four layers of the face's and of the back's hairs; fractions of their tile per um: of the first axis by x and y, then of the second; size of a texel [um]; height of the hairs of the face and of the back [um]; and the share of each that stands free (`src/cloth/light/hair_field.rs`) |
//! | `hair_cover` | `[2][1398101]` | by side, pyramid of 1024 x 1024 texels down to one: a byte for each layer, the share that hairs cover; 255 is 1 |
//! | `far_phi_i`, `far_theta_i`, `far_sigma` | `[15]`, `[11]`, `[8]` | nodes of the mean over the cell: azimuth of the viewer on one side and latitude [degrees], absorption [1/um]; this and the following tensors exist only for cloths loaded with `ClothOptions::far` |
//! | `far_f` | `[kinds][330][24][17][8]` | f times the cosine of the light's latitude, by kind and view, azimuth and latitude of the light, absorption |
//! | `far_chances` | `[kinds][330][2][384]` | cumulative sampling probabilities up to the end of each grid cell, for clear and for dark fibers |
//! | `far_energy`, `far_first` | `[kinds][330][2][8]`, `[kinds][330][4][8]` | on both sides of the cone, the integral of f divided by the angle from the cone to the axis; and the energies that first plies scatter, by class |
//! | `far_passing`, `far_apertures` | `[32][32]`, `[330][10]` | share of the beam that passes all plies, at the middles of equal steps of latitude and of azimuth over half a turn; number of apertures that represent those of the cell and, for each of three, the rows of `apertures` of its axes and its rotation, in 256ths of a right angle |

use crate::PlyModel;
use crate::cloth::ClothModel;
use crate::cloth::file::pwc::{CONE_NUMBERS, cone_numbers};
use crate::cloth::geometry::grid::Entry;
use crate::cloth::geometry::lines::LineTables;
use crate::cloth::geometry::plies::{ClothPlies, Runs};
use crate::cloth::geometry::uneven::UnevenKind;
use crate::cloth::light::absorption::{SIGMA_PER_UM, SIGMAS};
use crate::cloth::light::far_grid;
use crate::cloth::light::hair_layer::{HAIR_AZIMUTHS, HAIR_COSINES};
use crate::cloth::light::inter_yarn::{CLASSES, CLASSES_A_KIND, PAIRS, PLY_CLASSES, Side};
use crate::cloth::light::lit_places::{ANGLES, FUNCTIONS, MAPS};
use crate::cloth::light::terms::{FEW, TERMS};
use crate::cloth::shade::shadow_table::{COLUMNS, LANES, ROWS};
use crate::cloth::shade::splines::{COUNT, Several};
use crate::color::SPECTRUM_NODES;
use crate::gap::{EDGES, SPECTRUM_CELLS, Slit, Spectrum};
use crate::ply::{EXIT_KINDS, ExitShape, PASSED_COLUMNS, PASSED_ROWS, Relief};
use std::sync::Arc;

/// Numbers of a [`Tensor`].
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Single precision.
    F32(Vec<f32>),
    /// Indices and counts.
    U32(Vec<u32>),
    /// Bytes.
    U8(Vec<u8>),
}

/// A named array.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// Name.
    pub name: &'static str,
    /// Sizes of the dimensions; the last index is fastest.
    pub shape: Vec<usize>,
    /// The numbers, flat.
    pub values: Values,
}

impl ClothModel {
    /// The ply models, by kind of yarn.
    pub fn models(&self) -> &[Arc<PlyModel>] {
        &self.plies.models
    }

    /// The tables of the cloth, as described in the head of src/cloth/tensors.rs. The tables of its ply
    /// models are in their files, [`crate::ply::PlyData::to_bytes`].
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
        // Vectors of the tables' cell, as multiples of the vectors of the plies' cell.
        let vectors = self.lines().cell().1;
        let along = self.plies.along_um.iter().flat_map(|[step, a, b]| {
            let [first, second] = vectors.map(|[i, j]| i as f32 * a + j as f32 * b);
            [*step, first, second]
        });
        f32s("along", &[self.plies.along_um.len(), 3], along.collect());
        f32s("dye_rgb", &[dyes.len(), 3], dyes.iter().flat_map(|d| d.0).collect());
        f32s("dye_spectrum", &[dyes.len(), SPECTRUM_NODES], dyes.iter().flat_map(|d| d.1).collect());
        f32s("curve", &[curve.len(), 2], curve.iter().flat_map(|(v, value)| [*v as f32, *value as f32]).collect());
        let of =
            |values: &dyn Fn(&Side) -> Vec<f32>| self.inter_yarn.sides.iter().flat_map(values).collect::<Vec<f32>>();
        let by_node = |of: &Several<SIGMAS>| (0..SIGMAS).flat_map(|node| of.map(|c| c[node])).collect::<Vec<_>>();
        // The classes of hairs are left out for cloths without hairs.
        let a_kind = if self.hairs.is_some() { CLASSES_A_KIND } else { PLY_CLASSES };
        let classes: Vec<usize> = (0..CLASSES).filter(|class| class % CLASSES_A_KIND < a_kind).collect();
        let count = classes.len();
        let caught = |s: &Side| -> Vec<f32> {
            classes.iter().flat_map(|class| s.caught[3 * class..3 * class + 3].iter().flat_map(by_node)).collect()
        };
        f32s("inter_yarn_caught", &[2, count, 3, SIGMAS, COUNT], of(&caught));
        let leaves = |s: &Side| -> Vec<f32> {
            let of = 4 * PAIRS;
            classes.iter().flat_map(|class| s.leaves[of * class..of * class + of].as_flattened().to_vec()).collect()
        };
        f32s("inter_yarn_leaves", &[2, count, 2, 2, PAIRS, FEW], of(&leaves));
        f32s("inter_yarn_shape", &[2, 2, PAIRS, TERMS], of(&|s| s.shape.as_flattened().to_vec()));
        let parallel = |s: &Side| -> Vec<f32> {
            let of = |class: &usize| s.parallel[4 * class..4 * class + 4].as_flattened().as_flattened().to_vec();
            classes.iter().flat_map(of).collect()
        };
        f32s("inter_yarn_parallel", &[2, count, 2, 2, SIGMAS, FEW], of(&parallel));
        f32s("inter_yarn_cones", &[2, 2, 2, CONE_NUMBERS], of(&|s| cone_numbers(s)));
        let places = &self.inter_yarn.places;
        let map = places.map.as_flattened().as_flattened().as_flattened().as_flattened();
        f32s("inter_yarn_places", &[places.map.len(), ANGLES, 2, MAPS, FUNCTIONS], map.to_vec());
        let mean = places.mean.as_flattened().as_flattened().to_vec();
        f32s("inter_yarn_place_means", &[places.mean.len(), COUNT, 2, MAPS, FUNCTIONS], mean);
        f32s("inter_yarn_shape_means", &[2, 2, PAIRS, FUNCTIONS], self.inter_yarn.means().as_flattened().to_vec());
        if let Some(hairs) = &self.hairs {
            f32s("hair_area", &[2, 2, HAIR_COSINES], hairs.area.as_flattened().as_flattened().to_vec());
            let shape = [2, HAIR_COSINES, 2 * HAIR_COSINES, HAIR_AZIMUTHS, SIGMAS];
            f32s("hair_scatter", &shape, hairs.scatter.as_flattened().to_vec());
            if let Some(field) = &hairs.field {
                let numbers = field.tables().1;
                f32s("hair_field", &[numbers.len()], numbers);
            }
        }
        if let Some(far) = &self.far {
            let ([f, chances, energy, first, passing], _) = far.numbers();
            f32s("far_phi_i", &[far_grid::PHI_I_DEG.len()], far_grid::PHI_I_DEG.to_vec());
            f32s("far_theta_i", &[far_grid::THETA_I_DEG.len()], far_grid::THETA_I_DEG.to_vec());
            f32s("far_sigma", &[SIGMAS], SIGMA_PER_UM.to_vec());
            f32s("far_f", &[kinds, far_grid::VIEWS, far_grid::COLUMNS, far_grid::NODES, SIGMAS], f);
            f32s("far_chances", &[kinds, far_grid::VIEWS, 2, far_grid::CELLS], chances);
            f32s("far_energy", &[kinds, far_grid::VIEWS, 2, SIGMAS], energy);
            f32s("far_first", &[kinds, far_grid::VIEWS, PLY_CLASSES, SIGMAS], first);
            f32s("far_passing", &far_grid::PASSING, passing);
            let openings = far.numbers().1;
            add("far_apertures", &[far_grid::VIEWS, far_grid::OPENING_NUMBERS], Values::U32(openings));
        }
        if let Some(field) = self.hairs.as_ref().and_then(|hairs| hairs.field.as_ref()) {
            let texels = field.tables().0;
            add("hair_cover", &[texels.len()], Values::U32(texels.to_vec()));
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
        let tables = self.shadows.tables();
        add("shadow_table", &[tables.len()], Values::U32(tables.to_vec()));
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

/// Encodes the entries of voxels as unsigned words.
fn words(entries: &[Entry]) -> Vec<u32> {
    let numbers = entries.iter().flat_map(|(piece, cells)| {
        let [i, j] = cells.map(|c| (i32::from(c) + (1 << 15)) as u32);
        [*piece, i, j]
    });
    numbers.collect()
}

/// Adds the curves in the voxels of their grid, and the tables of ply models that evaluation needs.
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

/// Shares of light that pass the slits of two kinds of yarns, and the slits' spectra; empty if no yarn has
/// slits.
fn slit_numbers(slits: &[Option<Slit>; 2]) -> (Vec<f32>, Vec<f32>) {
    let shares = slits.iter().map(|slit| slit.map_or(0.0, |slit| slit.share())).collect();
    // Yarns without slits repeat the numbers of the other kind; their share of 0 disables them.
    let spectra = slits.iter().filter_map(|slit| slit.or(slits[0]).or(slits[1]));
    (shares, spectra.flat_map(|slit| slit.numbers().collect::<Vec<_>>()).collect())
}
