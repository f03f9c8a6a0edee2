//! The cloth spec (TOML): a weave, a knit or curves from a file, and its yarns in textile units.
//! Keys and ranges are in `rules.rs`.

use super::color_of::ColorOf;
use super::draft::Draft;
use super::hairs::Hairs;
use super::query::Slits;
use super::thermal::Thermal;
use super::units::{Count, fiber_area_um2, round_radius_um};
use super::weave::WeaveSpec;
use crate::gap::SLIT_SHARE;
use crate::spec::Handedness;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// A cloth spec, as `fabrics/cloths/satin.toml`. Unknown keys are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClothSpec {
    /// Name of the cloth, for the record.
    pub name: String,
    /// What the colors are colors of.
    #[serde(default)]
    pub color_of: ColorOf,
    /// Which yarn is on top where, of a woven cloth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weave: Option<WeaveSpec>,
    /// Stitches of a knitted cloth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub knit: Option<KnitSpec>,
    /// Curves from a file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curves: Option<SourceCurves>,
    /// Yarns along y of a woven cloth, or of curves of two yarns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub warp: Option<YarnOfCloth>,
    /// Yarns along x of a woven cloth, or of curves of two yarns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weft: Option<YarnOfCloth>,
    /// The yarn of a knit or of curves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub yarn: Option<YarnOfCloth>,
    /// Thickness to which the cloth is pressed in finishing [um]; absent: it is not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thickness_um: Option<f64>,
    /// Heat through it, for files of windows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub thermal: Option<Thermal>,
}

/// How the yarns of a cloth are laid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClothWeave<'a> {
    /// Woven, with the yarns of warp and weft.
    Woven(&'a WeaveSpec, [&'a YarnOfCloth; 2]),
    /// Knitted of one yarn.
    Knitted(&'a KnitSpec, &'a YarnOfCloth),
    /// Curves from a file, of one yarn, or of warp and weft.
    Curves(&'a SourceCurves, &'a YarnOfCloth, Option<&'a YarnOfCloth>),
}

/// Stitches.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnitSpec {
    /// `jersey`, `rib`, `garter`, `seed`, `interlock`, `tricot` or `grid`.
    pub kind: String,
    /// Knit wales of a rib.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub knit: Option<usize>,
    /// Purl wales of a rib.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub purl: Option<usize>,
    /// Rows of a grid: K for knit and P for purl as seen on the face, the last row the first course.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rows: Option<Vec<String>>,
    /// Wales a centimeter.
    pub wales_per_cm: f64,
    /// Courses a centimeter.
    pub courses_per_cm: f64,
    /// Length of yarn in a stitch [mm].
    pub loop_mm: f64,
}

/// Curves from a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourceCurves {
    /// Path relative to the spec: `.bcc`, `.tg3` or `.toml`.
    pub file: String,
    /// Two vectors after which the curves repeat [um]; absent: those of the file, which a `.bcc` has none of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell_um: Option<[[f64; 2]; 2]>,
    /// Micrometers to a unit of the file; absent: 1, of a `.tg3` by its GeometryScale.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub um_per_unit: Option<f64>,
    /// Whether the curves are relaxed, or taken as they are.
    #[serde(default)]
    pub relax: bool,
}

/// A yarn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct YarnOfCloth {
    /// Path of the model of a ply or bundle, relative to the spec, or its name in a library.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Count of the single yarn.
    pub count: Count,
    /// Density of the fibers [g/cm3].
    pub density_g_per_cm3: f64,
    /// Share of a ply's, or a bundle's, round section that fibers fill.
    #[serde(default = "usual_packing")]
    pub packing: f64,
    /// Singles that are twisted together.
    #[serde(default = "one")]
    pub plies: u32,
    /// Round bundles that a single consists of; they move past each other, so that its section flattens.
    #[serde(default = "one")]
    pub bundles: u32,
    /// Twist of the plies about each other, or of the bundles [turns/m].
    #[serde(default)]
    pub twist_per_m: f64,
    /// Hand of that twist.
    #[serde(default)]
    pub handedness: Handedness,
    /// Ends a centimeter, of the warp.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ends_per_cm: Option<f64>,
    /// Picks a centimeter, of the weft.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub picks_per_cm: Option<f64>,
    /// Tension in the cloth, relative to that of the other yarns: the tighter yarn bends less.
    #[serde(default = "unit")]
    pub tension: f64,
    /// Length of the yarn over that of the cloth, less 1 [percent], in place of the tension.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crimp_percent: Option<f64>,
    /// Bending stiffness of a ply or bundle over its tension times the square of its radius.
    #[serde(default = "usual_stiffness")]
    pub stiffness: f64,
    /// What holds the bundles of a yarn together, twist aside: force a length that draws a bundle at the rim
    /// inwards, over its tension over the yarn's radius.
    #[serde(default = "usual_cohesion")]
    pub cohesion: f64,
    /// Coefficient of variation of its count along it; absent: it is even.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub count_cv: Option<f64>,
    /// Standard deviation of the places of its yarns over their distance; absent: they are even.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spacing_cv: Option<f64>,
    /// Length over which both change [mm]; absent: 10.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uneven_mm: Option<f64>,
    /// Color of the yarn [sRGB, 0 to 1].
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "crate::color::optional_srgb")]
    pub srgb: Option<[f64; 3]>,
    /// Colors of the yarns one after the other, which repeat, in place of a color of all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stripes: Vec<Stripe>,
    /// Absorption coefficient of the fibers [1/um], in place of a color.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma_per_um: Option<f64>,
    /// Width of slits between the fibers [um] (Yu 2025, 7.3); absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slit_um: Option<f64>,
    /// Share of the forward light that goes through them, of yarns with slits; absent: [`SLIT_SHARE`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slit_share: Option<f64>,
    /// Ends and loops of fibers that stand out of it; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hairs: Option<Hairs>,
}

/// Neighboring yarns of one color.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stripe {
    /// Number of yarns.
    pub count: usize,
    /// Their color [sRGB, 0 to 1].
    #[serde(deserialize_with = "crate::color::srgb")]
    pub srgb: [f64; 3],
}

fn usual_packing() -> f64 {
    0.6
}

fn one() -> u32 {
    1
}

fn unit() -> f64 {
    1.0
}

fn usual_stiffness() -> f64 {
    0.5
}

fn usual_cohesion() -> f64 {
    0.02
}

impl ClothSpec {
    /// How the cloth is made. `None` only for a spec that was not [parsed](ClothSpec::parse).
    pub fn made(&self) -> Option<ClothWeave<'_>> {
        match (&self.weave, &self.knit, &self.curves) {
            (Some(weave), None, None) => Some(ClothWeave::Woven(weave, [self.warp.as_ref()?, self.weft.as_ref()?])),
            (None, Some(knit), None) => Some(ClothWeave::Knitted(knit, self.yarn.as_ref()?)),
            (None, None, Some(curves)) => {
                let first = self.warp.as_ref().or(self.yarn.as_ref())?;
                Some(ClothWeave::Curves(curves, first, self.weft.as_ref()))
            }
            _ => None,
        }
    }

    /// The yarns, in the order of [`super::ClothYarn::kind`].
    pub fn yarns(&self) -> Vec<&YarnOfCloth> {
        match self.made() {
            Some(ClothWeave::Woven(_, yarns)) => yarns.to_vec(),
            Some(ClothWeave::Knitted(_, yarn)) => vec![yarn],
            Some(ClothWeave::Curves(_, first, second)) => std::iter::once(first).chain(second).collect(),
            None => Vec::new(),
        }
    }

    /// Name of a kind of yarn: warp, weft or yarn.
    pub fn kind_name(&self, kind: usize) -> &'static str {
        match (self.warp.is_some(), kind) {
            (true, 0) => "warp",
            (true, _) => "weft",
            _ => "yarn",
        }
    }

    /// Hairs of the yarns, in the order of [`super::ClothYarn::kind`].
    pub fn hairs(&self) -> Vec<Option<Hairs>> {
        self.yarns().into_iter().map(|yarn| yarn.hairs).collect()
    }

    /// Draft of a woven cloth; `None` for a WIF, whose draft is in its file, and for other cloths.
    pub fn draft(&self) -> Option<Draft> {
        self.weave.as_ref().and_then(WeaveSpec::draft)
    }
}

impl YarnOfCloth {
    /// Colors of the yarns by number, which repeat; none where one is of all.
    pub fn colors(&self) -> Vec<[f32; 3]> {
        self.stripes.iter().flat_map(|s| std::iter::repeat_n(s.srgb.map(|v| v as f32), s.count)).collect()
    }

    /// The slits between its fibers.
    pub fn slits(&self) -> Option<Slits> {
        let width_um = self.slit_um? as f32;
        Some(Slits { width_um, share: self.slit_share.map_or(SLIT_SHARE, |share| share as f32) })
    }

    /// Number of round strands, plies or bundles, in the yarn.
    pub fn strands(&self) -> usize {
        (self.plies * self.bundles) as usize
    }

    /// Grams a kilometer of one strand.
    pub fn strand_tex(&self) -> f64 {
        self.count.tex() / f64::from(self.bundles)
    }

    /// Radius of a strand [um], from count, density and packing.
    pub fn strand_radius_um(&self) -> f64 {
        round_radius_um(fiber_area_um2(self.strand_tex(), self.density_g_per_cm3), self.packing)
    }

    /// Distance to the next yarn [um], of warp and weft.
    pub fn spacing_um(&self) -> Option<f64> {
        self.ends_per_cm.or(self.picks_per_cm).map(|per_cm| 1e4 / per_cm)
    }

    /// Turns a micrometer, positive for Z, which is right-handed.
    pub fn twist_per_um(&self) -> f64 {
        let turns = self.twist_per_m * 1e-6;
        match self.handedness {
            Handedness::Z => turns,
            Handedness::S => -turns,
        }
    }

    /// Places of the strands in the section of the round yarn: offsets from its axis over the strand's
    /// radius.
    pub fn section(&self) -> Vec<[f64; 2]> {
        if self.bundles > 1 {
            return hexagonal(self.bundles as usize);
        }
        let count = self.plies as usize;
        if count == 1 {
            return vec![[0.0; 2]];
        }
        let circle = 1.0 / (PI / count as f64).sin();
        (0..count)
            .map(|k| {
                let (sin, cos) = (2.0 * PI * k as f64 / count as f64).sin_cos();
                [circle * cos, circle * sin]
            })
            .collect()
    }

    /// Turns by which the section comes back to itself.
    pub fn symmetry(&self) -> u32 {
        match (self.bundles, self.plies) {
            (1, plies) => plies,
            (3, _) => 3,
            (7 | 19, _) => 6,
            _ => 1,
        }
    }

    /// Radius of the round yarn [um].
    pub fn radius_um(&self) -> f64 {
        let reach = self.section().iter().map(|p| p[0].hypot(p[1])).fold(0.0, f64::max);
        self.strand_radius_um() * (1.0 + reach)
    }
}

/// The places of a hexagonal lattice of circles of radius 1 that lie nearest to its middle: 3 about a hole, 7
/// and 19 about a circle, other numbers about their own mean.
fn hexagonal(count: usize) -> Vec<[f64; 2]> {
    let center = if count == 3 { [1.0, 1.0 / 3f64.sqrt()] } else { [0.0; 2] };
    let mut all: Vec<[f64; 2]> = (-6i32..=6)
        .flat_map(|i| (-6i32..=6).map(move |j| [2.0 * (f64::from(i) + 0.5 * f64::from(j)), 3f64.sqrt() * f64::from(j)]))
        .map(|p| [p[0] - center[0], p[1] - center[1]])
        .collect();
    // By rings; within a ring by angle.
    let order = |p: &[f64; 2]| ((p[0].hypot(p[1]) * 1e6).round(), p[1].atan2(p[0]));
    all.sort_by(|a, b| order(a).partial_cmp(&order(b)).unwrap_or(std::cmp::Ordering::Equal));
    all.truncate(count);
    let mean = [0, 1].map(|k| all.iter().map(|p| p[k]).sum::<f64>() / count as f64);
    all.iter().map(|p| [p[0] - mean[0], p[1] - mean[1]]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SATIN: &str = "name = \"satin\"\n[weave]\nkind = \"satin 5/2\"\n[warp]\nmodel = \"m.pwm\"\n\
        count = { den = 75, filaments = 36 }\ndensity_g_per_cm3 = 1.38\npacking = 0.65\nbundles = 7\nends_per_cm = 100\n\
        [weft]\nmodel = \"m.pwm\"\ncount = { den = 75, filaments = 36 }\ndensity_g_per_cm3 = 1.38\npacking = 0.65\n\
        bundles = 7\npicks_per_cm = 40\n";

    /// Numbers of a satin lining: fibers of 6040 um2, 109 um round.
    #[test]
    fn sizes_follow_from_the_count() {
        let spec = ClothSpec::parse(SATIN, "satin.toml").unwrap();
        let warp = spec.warp.unwrap();
        let area = 7.0 * PI * warp.strand_radius_um().powi(2);
        assert!((area - 6039.0 / 0.65).abs() < 5.0, "{area}");
        assert!((warp.radius_um() / warp.strand_radius_um() - 3.0).abs() < 1e-9);
        assert_eq!((warp.spacing_um(), warp.strands(), warp.symmetry()), (Some(100.0), 7, 6));
    }

    #[test]
    fn sections_do_not_overlap() {
        let mut yarn = ClothSpec::parse(SATIN, "satin.toml").unwrap().warp.unwrap();
        for (plies, bundles) in [(1, 1), (2, 1), (3, 1), (7, 1), (1, 3), (1, 4), (1, 7), (1, 12), (1, 19)] {
            (yarn.plies, yarn.bundles) = (plies, bundles);
            let section = yarn.section();
            assert_eq!(section.len(), yarn.strands());
            let turn = 2.0 * PI / f64::from(yarn.symmetry());
            for (i, p) in section.iter().enumerate() {
                for q in &section[..i] {
                    assert!((p[0] - q[0]).hypot(p[1] - q[1]) > 2.0 - 1e-9, "{plies} {bundles}");
                }
                let turned = [p[0] * turn.cos() - p[1] * turn.sin(), p[0] * turn.sin() + p[1] * turn.cos()];
                assert!(section.iter().any(|q| (turned[0] - q[0]).hypot(turned[1] - q[1]) < 1e-6), "{plies} {bundles}");
            }
        }
    }

    #[test]
    fn specs_that_contradict_themselves_are_refused() {
        for (from, to, want) in [
            ("ends_per_cm = 100\n", "", "warp.ends_per_cm = (absent)"),
            ("den = 75", "den = 75, tex = 8", "warp.count"),
            (
                "count = { den = 75, filaments = 36 }",
                "count = { filaments = 36 }",
                "give one of tex, dtex, den, ne, nm",
            ),
            (
                "[weave]",
                "[knit]\nkind = \"jersey\"\nwales_per_cm = 14\ncourses_per_cm = 20\nloop_mm = 2.7\n[weave]",
                "give one of",
            ),
            ("bundles = 7\nends", "bundles = 7\nplies = 2\nends", "warp.bundles = 7"),
            ("ends_per_cm = 100", "ends_per_cm = 100\ncrimp_percent = 5\ntension = 2.0", "warp.tension"),
            ("ends_per_cm = 100", "picks_per_cm = 100", "warp.picks_per_cm"),
            ("bundles = 7\nends", "bundles = 4\ntwist_per_m = 100\nends", "warp.twist_per_m"),
            ("packing = 0.65", "packing = 1.5", "warp.packing = 1.5"),
            ("5/2", "5/5", "weave.kind = \"satin 5/5\""),
        ] {
            assert!(SATIN.contains(from), "{from}");
            let message = ClothSpec::parse(&SATIN.replacen(from, to, 1), "s.toml").unwrap_err().to_string();
            assert!(message.contains(want) && message.lines().count() == 1, "{message}\n{want}");
        }
    }
}
