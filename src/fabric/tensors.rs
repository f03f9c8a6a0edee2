//! All tables of a loaded fabric as named arrays, for hosts that evaluate it on machines of their own (GPUs,
//! differentiating compilers): `python/plywave/mitsuba` is one.
//!
//! With these arrays, the files of the ply models and the formulas of this folder, [`FabricModel`] can be
//! rebuilt. Arrays are flat, last index fastest; lengths in um.
//!
//! | name | shape | |
//! |---|---|---|
//! | `yarn` | `[2][15]` | of warp and weft: plies, R, circle D, half width, spacing, its inverse, reach R + d_cut, turns per um, slope of the plies, then of the axis' profile: step, amplitude, radius, arc, slope; whether plies scatter one by one |
//! | `turn` | `[2][7][2]` | cosine and sine of the plies' places |
//! | `draft` | `[picks][ends]` | 1 where the warp is on top |
//! | `scalars` | `[4]` | height above which nothing is near, length of a ply with one speckle pattern, step of the apertures' edges, L of `curve` |
//! | `options` | `[5]` | gaps diffracted, speckle, layers, shadowing, edges |
//! | `exit_shapes` | `[models][3][65][2]` | of each model how light lies across a ply where it leaves: mode and length over R, by kind and mean over R, 0 to 0.97 |
//! | `passed`, `passed_h_um` | `[models][16][65]`, `[models]` | of each model r_d of lines, summed over offsets from -h to h, over h; latitudes from 0 to a right angle |
//! | `stripes_warp`, `stripes_weft` | `[..]` | model of each yarn of one repeat |
//! | `threads_warp`, `threads_weft` | `[..]` | dye of each yarn of one repeat |
//! | `dye_rgb`, `dye_spectrum` | `[dyes][3]`, `[dyes][81]` | absorptions [1/um] of linear sRGB, and at 0.38 to 0.78 um |
//! | `curve` | `[..][2]` | v = 1 / (1 + sigma L) and the cloth's brightness |
//! | `shadow_free` | `[rows][18][16][8]` | shares that get out, 255 for 1.35 (`MAX_SHARE` of `shadow.rs`) |
//! | `shadow_patterns` | `[2][4][512]` or empty | rows by pattern |
//! | `between_caught` | `[2][4][3][8][168]` | by side, class, sent up, down and all, absorption: splines of the direction |
//! | `between_leaves` | `[2][4][2][2][64][8]` | by side, class, sent, leaves, pair of absorptions |
//! | `between_shape` | `[2][2][64][16]` | by side, leaves, pair |
//! | `far_phi_i`, `far_theta_i`, `far_sigma` | `[15]`, `[11]`, `[8]` | of the mean over the repeat: nodes of a view's azimuth on one side and latitude [degrees], and of absorption [1/um]; these and the next only of fabrics loaded with `FabricOptions::far` |
//! | `far_f` | `[2][330][24][17][8]` | by family and view, azimuth and latitude of the light, absorption |
//! | `far_chances` | `[2][330][2][384]` | sums of the energies up to a cell's end, of clear and dark fibers |
//! | `far_energy`, `far_first` | `[2][330][8]`, `[2][330][2][8]` | integral of f; energies that first plies scatter, of one layer and of two |
//! | `far_passing`, `far_apertures` | `[330]`, `[330][10]` | what passes; how many apertures stand for the repeat's, and of each of three the rows of `apertures` of its axes and by how much they are turned, in 256ths of a right angle |
//! | `apertures` | `[33][33][74]` | spectra by the distances of their two edges: the factor's eight numbers, g, 65 masses. A point's aperture has the factor of its own edges, and is sampled by the row nearest to them (`FabricModel::aperture`) |
//! | `slit_share` | `[2]` | of warp and weft: share of the forward light that slits between fibers take, 0 without slits |
//! | `slits` | `[2][2][74]` or empty | spectra of the slits across and along the ply, as those of `apertures`; empty where no yarn has slits |

use super::between::{CLASSES_A_KIND, FEW, PAIRS, SIGMAS, Side, TERMS};
use super::bsdf::FabricModel;
use super::shadow::{COLUMNS, LANES, ROWS};
use super::splines::{COUNT, Several};
use super::yarn::MAX_PLIES;
use super::{GapLight, YarnSet, far};
use crate::PlyModel;
use crate::color::SPECTRUM_NODES;
use crate::gap::{EDGES, SPECTRUM_CELLS, Slit};
use crate::ply::{EXIT_KINDS, ExitShape};
use crate::ply::{PASSED_COLUMNS, PASSED_ROWS};
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

impl FabricModel {
    /// The models, in the order of `stripes_warp` and `stripes_weft`.
    pub fn models(&self) -> &[Arc<PlyModel>] {
        &self.models
    }

    /// The tables of the fabric, each described in the head of src/fabric/tensors.rs; those of its models are
    /// in their files, [`crate::ply::PlyData::to_bytes`].
    pub fn tensors(&self) -> Vec<Tensor> {
        let mut all = Vec::new();
        let mut f32s = |name, shape: &[usize], values: Vec<f32>| {
            all.push(Tensor { name, shape: shape.to_vec(), values: Values::F32(values) });
        };
        let f = &self.fabric;
        let yarns = f.yarns.iter().flat_map(|y| {
            let p = &y.profile;
            let shape = [y.plies as f32, y.radius, y.circle, y.half_width, y.spacing, y.per_spacing, y.reach];
            let one_by_one = f32::from(u8::from(y.one_by_one));
            let rest = [y.turns_per_um, y.slope, p.step, p.amplitude, p.radius, p.arc, p.slope, one_by_one];
            shape.into_iter().chain(rest)
        });
        f32s("yarn", &[2, 15], yarns.collect());
        let turns = f.yarns.iter().flat_map(|y| y.turn.as_flattened().iter().copied());
        f32s("turn", &[2, MAX_PLIES, 2], turns.collect());
        let (length_um, curve) = self.curve.nodes().unwrap_or((1.0, &[]));
        f32s("scalars", &[4], vec![f.top_um(), self.grain_um, self.apertures.step_um, length_um as f32]);
        let o = &self.options;
        let options = [o.gaps == GapLight::Diffracted, o.noise, o.layers, o.shadowing, o.edges];
        f32s("options", &[5], options.map(|on| f32::from(u8::from(on))).to_vec());
        let dyes: Vec<_> = self.dyes.iter().map(super::dye::Dye::numbers).collect();
        f32s("dye_rgb", &[dyes.len(), 3], dyes.iter().flat_map(|d| d.0).collect());
        f32s("dye_spectrum", &[dyes.len(), SPECTRUM_NODES], dyes.iter().flat_map(|d| d.1).collect());
        f32s("curve", &[curve.len(), 2], curve.iter().flat_map(|(v, value)| [*v as f32, *value as f32]).collect());
        let of = |values: &dyn Fn(&Side) -> Vec<f32>| self.between.sides.iter().flat_map(values).collect::<Vec<f32>>();
        // Of each family two of its classes: one layer and two.
        let classes = [0, 1, CLASSES_A_KIND, CLASSES_A_KIND + 1];
        let by_node = |of: &Several<SIGMAS>| (0..SIGMAS).flat_map(|node| of.map(|c| c[node])).collect::<Vec<_>>();
        let caught = |s: &Side| classes.map(|c| s.caught[3 * c..][..3].iter().flat_map(by_node).collect::<Vec<_>>());
        let leaves = |s: &Side| classes.map(|c| s.leaves[4 * PAIRS * c..][..4 * PAIRS].as_flattened().to_vec());
        f32s("between_caught", &[2, classes.len(), 3, SIGMAS, COUNT], of(&|s| caught(s).concat()));
        f32s("between_leaves", &[2, classes.len(), 2, 2, PAIRS, FEW], of(&|s| leaves(s).concat()));
        f32s("between_shape", &[2, 2, PAIRS, TERMS], of(&|s| s.shape.as_flattened().to_vec()));
        if let Some(far) = &self.far {
            let ([of_plies, chances, energy, first, passing], _) = far.numbers(2);
            f32s("far_phi_i", &[far::PHI_I_DEG.len()], far::PHI_I_DEG.to_vec());
            f32s("far_theta_i", &[far::THETA_I_DEG.len()], far::THETA_I_DEG.to_vec());
            f32s("far_sigma", &[far::SIGMAS], far::SIGMA_PER_UM.to_vec());
            f32s("far_f", &[2, far::VIEWS, far::COLUMNS, far::NODES, far::SIGMAS], of_plies);
            f32s("far_chances", &[2, far::VIEWS, 2, far::CELLS], chances);
            f32s("far_energy", &[2, far::VIEWS, far::SIGMAS], energy);
            f32s("far_first", &[2, far::VIEWS, 2, far::SIGMAS], first);
            f32s("far_passing", &[far::VIEWS], passing);
        }
        let shapes = self.models.iter().flat_map(|m| m.exit_shapes());
        let [means, two] = ExitShape::usual()[0].numbers().1;
        let numbers = shapes.flat_map(|shape| shape.numbers().0.iter().copied()).collect();
        f32s("exit_shapes", &[self.models.len(), EXIT_KINDS, means, two], numbers);
        let passed: Vec<_> =
            self.models.iter().filter_map(|m| m.passed_lines()).map(|passed| passed.numbers()).collect();
        let shape = [passed.len(), PASSED_ROWS, PASSED_COLUMNS];
        f32s("passed", &shape, passed.iter().flat_map(|(sums, _)| sums.iter().copied()).collect());
        f32s("passed_h_um", &shape[..1], passed.iter().map(|(_, last_h_um)| *last_h_um).collect());
        let apertures = self.apertures.spectra.iter().flat_map(crate::gap::Spectrum::numbers);
        f32s("apertures", &[EDGES + 1, EDGES + 1, 10 + SPECTRUM_CELLS], apertures.collect());
        let (shares, slits) = slit_numbers(&self.slits);
        f32s("slit_share", &[2], shares);
        f32s("slits", &[slits.len() / (2 * (10 + SPECTRUM_CELLS)), 2, 10 + SPECTRUM_CELLS], slits);

        if let Some(far) = &self.far {
            let shape = vec![far::VIEWS, far::OPENING_NUMBERS];
            all.push(Tensor { name: "far_apertures", shape, values: Values::U32(far.numbers(2).1) });
        }
        let lists = [("stripes_warp", &self.stripes[0]), ("stripes_weft", &self.stripes[1])];
        let threads = [("threads_warp", &self.threads[0]), ("threads_weft", &self.threads[1])];
        for (name, list) in lists.into_iter().chain(threads).chain([("shadow_patterns", &self.shadows.patterns)]) {
            all.push(Tensor { name, shape: vec![list.len()], values: Values::U32(list.clone()) });
        }
        let draft = f.draft();
        let (picks, ends) = (draft.threads(YarnSet::Weft), draft.threads(YarnSet::Warp));
        let up = (0..picks).flat_map(|pick| (0..ends).map(move |end| u8::from(draft.up(pick, end))));
        all.push(Tensor { name: "draft", shape: vec![picks, ends], values: Values::U8(up.collect()) });
        let rows = self.shadows.free.len() / (2 * ROWS * COLUMNS * LANES);
        let shape = vec![rows, 2 * ROWS, COLUMNS, LANES];
        all.push(Tensor { name: "shadow_free", shape, values: Values::U8(self.shadows.free.clone()) });
        all
    }
}

/// Shares of light of the slits of two kinds of yarns, and their spectra; none where no yarn has slits.
pub(crate) fn slit_numbers(slits: &[Option<Slit>; 2]) -> (Vec<f32>, Vec<f32>) {
    let shares = slits.iter().map(|slit| slit.map_or(0.0, |slit| slit.share())).collect();
    // Yarns without slits have the numbers of the others', which their share leaves out.
    let spectra = slits.iter().filter_map(|slit| slit.or(slits[0]).or(slits[1]));
    (shares, spectra.flat_map(|slit| slit.numbers().collect::<Vec<_>>()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fabric::FabricOptions;

    /// Shapes are those of the values, names are unique, and what the module text says of some holds.
    #[test]
    fn tensors_are_whole() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/polyester_satin.toml");
        let fabric = FabricModel::load(path, &FabricOptions::default()).unwrap();
        let all = fabric.tensors();
        for (i, t) in all.iter().enumerate() {
            let len = match &t.values {
                Values::F32(v) => v.len(),
                Values::U32(v) => v.len(),
                Values::U8(v) => v.len(),
            };
            assert_eq!(len, t.shape.iter().product::<usize>(), "{}", t.name);
            assert!(all[..i].iter().all(|other| other.name != t.name), "{}", t.name);
        }
        let of = |name: &str| all.iter().find(|t| t.name == name).unwrap();
        assert_eq!(of("draft").shape, [5, 5]);
        assert_eq!(of("yarn").values, {
            let Values::F32(v) = &of("yarn").values else { panic!() };
            assert!(v[4] == 102.0 && v[15 + 4] == 250.0 && v[0] == 1.0);
            Values::F32(v.clone())
        });
        assert!(matches!(&of("shadow_free").values, Values::U8(v) if v.iter().any(|f| *f > 0)));
    }
}
