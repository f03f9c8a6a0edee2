//! The cloth spec (TOML): a weave, a knit or curves from a file, and its yarns. `rules.rs` lists the keys
//! with their ranges.

use crate::knit::spec::KnitSpec;
use crate::thermal::Thermal;
use crate::weave::draft::{Draft, YarnSet};
use crate::weave_spec::WeaveSpec;
use crate::yarn::YarnOfCloth;
use crate::yarn::hairs::Hairs;
use plywave::cloth::{ColorOf, YarnLook};
use serde::Deserialize;

/// A cloth spec, such as `fabrics/cloths/satin.toml`.
#[derive(Clone, Debug, PartialEq)]
pub struct ClothSpec {
    /// Name of the cloth, for the record.
    pub name: String,
    /// Sense in which colors are meant.
    pub color_of: ColorOf,
    /// Which yarn is on top at each crossing of a woven cloth.
    pub weave: Option<WeaveSpec>,
    /// Ends and picks per centimeter of a woven cloth; `None` for those of a WIF.
    pub per_cm: [Option<f64>; 2],
    /// Stitches of a knitted cloth.
    pub knit: Option<KnitSpec>,
    /// Curves from a file.
    pub curves: Option<SourceCurves>,
    /// Yarns along y of a woven cloth, or the first yarn of curves of two yarns.
    pub warp: Option<YarnOfCloth>,
    /// Yarns along x of a woven cloth, or the second yarn of curves of two yarns.
    pub weft: Option<YarnOfCloth>,
    /// The yarn of a knit, or of curves of one yarn.
    pub yarn: Option<YarnOfCloth>,
    /// Thickness to which finishing presses the cloth [um]; absent: it is not pressed.
    pub thickness_um: Option<f64>,
    /// Thermal properties, for files of window programs.
    pub thermal: Option<Thermal>,
}

/// Structure of a cloth, with its yarns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClothWeave<'a> {
    /// Woven from warp and weft.
    Woven(&'a WeaveSpec, [&'a YarnOfCloth; 2]),
    /// Knitted from one yarn.
    Knitted(&'a KnitSpec, &'a YarnOfCloth),
    /// Curves from a file, of one yarn, or of warp and weft.
    Curves(&'a SourceCurves, &'a YarnOfCloth, Option<&'a YarnOfCloth>),
}

/// Curves from a file.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct SourceCurves {
    /// Path relative to the spec: `.bcc`, `.tg3` or `.toml`.
    pub file: String,
    /// The two vectors by which the curves repeat [um]; absent: those of the file. A `.bcc` file has none.
    #[serde(default)]
    pub cell_um: Option<[[f64; 2]; 2]>,
    /// Micrometers per unit of the file; absent: 1, or the GeometryScale of a `.tg3`.
    #[serde(default)]
    pub um_per_unit: Option<f64>,
    /// Whether the curves are relaxed; otherwise they are used as they are.
    #[serde(default)]
    pub relax: bool,
}

impl ClothSpec {
    /// Structure of the cloth, with its yarns. `None` only for a spec that was not
    /// [parsed](ClothSpec::parse).
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

    /// The yarns, in the order of [`plywave::cloth::ClothYarn::kind`].
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

    /// Hairs of the yarns, in the order of [`plywave::cloth::ClothYarn::kind`].
    pub fn hairs(&self) -> Vec<Option<Hairs>> {
        self.yarns().into_iter().map(|yarn| yarn.hairs).collect()
    }

    /// What shading needs of the yarns beyond curves and plies, by kind.
    pub fn looks(&self) -> Vec<YarnLook> {
        self.yarns().into_iter().enumerate().map(|(kind, yarn)| yarn.look(self.kind_name(kind))).collect()
    }

    /// Distance of the yarns of a set [um]; `None` if the spec does not give it.
    pub fn spacing_um(&self, set: YarnSet) -> Option<f64> {
        self.per_cm[set as usize].map(|per_cm| 1e4 / per_cm)
    }

    /// Draft of a woven cloth; `None` for a WIF, whose draft is in its file, and for cloths that are not
    /// woven.
    pub fn draft(&self) -> Option<Draft> {
        self.weave.as_ref().and_then(WeaveSpec::draft)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    const SATIN: &str = "name = \"satin\"\n[weave]\nkind = \"satin 5/2\"\nends_per_cm = 100\npicks_per_cm = 40\n\
        [warp]\nfiber = \"polyester\"\ncount = \"75/36 den\"\n[weft]\nas = \"warp\"\n";

    /// Numbers of a satin lining: fibers of 6040 um2, in a circle of radius 109 um, 36 filaments in seven
    /// bundles.
    #[test]
    fn sizes_follow_from_the_count() {
        let spec = ClothSpec::parse(SATIN, "satin.toml").unwrap();
        let warp = spec.warp.clone().unwrap();
        let area = 7.0 * PI * warp.strand_radius_um().powi(2);
        assert!((area - 6039.0 / 0.65).abs() < 5.0, "{area}");
        assert!((warp.radius_um() / warp.strand_radius_um() - 3.0).abs() < 1e-9);
        assert_eq!((spec.spacing_um(YarnSet::Warp), warp.strands(), warp.symmetry()), (Some(100.0), 7, 6));
        assert_eq!((warp.fibers, spec.weft), (5, Some(warp)));
    }

    #[test]
    fn sections_do_not_overlap() {
        let mut yarn = ClothSpec::parse(SATIN, "satin.toml").unwrap().warp.unwrap();
        for (plies, bundles) in [(1, 1), (2, 1), (3, 1), (7, 1), (1, 3), (1, 4), (1, 7), (1, 12), (2, 7), (1, 19)] {
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
            ("ends_per_cm = 100\n", "", "weave.ends_per_cm = (absent)"),
            ("75/36 den", "75 den tex", "two units"),
            ("75/36 den", "36 f", "warp.count = \"36 f\": write the number of filaments after f"),
            (
                "[weave]",
                "[knit]\nkind = \"jersey\"\nwales_per_cm = 14\ncourses_per_cm = 20\nloop_mm = 2.7\n[weave]",
                "give one of",
            ),
            ("[weft]", "crimp_percent = 5\ntension = 2.0\n[weft]", "warp.tension = 2.0: give either"),
            ("[weft]\nas = \"warp\"", "[weft]\nas = \"weft\"", "weft.as = \"weft\": name the other yarn"),
            ("[weft]", "bundles = 4\ntwist = \"Z 100/m\"\n[weft]", "warp.bundles = 4"),
            ("[weft]", "packing = 1.5\n[weft]", "warp.packing = 1.5"),
            ("[weft]", "diameter_um = 60\n[weft]", "would fill 2.14 of a yarn this wide; use 105 to 314 um"),
            ("[weft]", "diameter_um = 110\npacking = 0.5\n[weft]", "give either packing or diameter_um"),
            ("[weft]", "twist = \"Z 4000/m\"\n[weft]", "would lean by 57 degrees, which no yarn holds; use 2581"),
            ("[weft]", "ply_twist = \"S 400/m\"\n[weft]", "a single yarn has none"),
            ("\"polyester\"", "\"polyster\"", "polyster is no known fiber; did you mean polyester?"),
            ("\"polyester\"", "\"asbestos\"", "asbestos is no known fiber; use one of cotton"),
            (
                "\"polyester\"",
                "\"polyester 6 den\"",
                "its 36 filaments have 2.31 dtex each, but polyester 6 den has 6.67",
            ),
            ("5/2", "5/5", "weave.kind = \"satin 5/5\""),
            ("\"75/36 den\"", "{ den = 75, filaments = 36 }", "write it as on a label: count = \"75 den f 36\""),
            ("[weft]", "ends_per_cm = 100\n[weft]", "write it in the table of the weave: [weave] ends_per_cm = 100"),
            ("[weft]", "srgb = \"#fff\"\n[weft]", "warp.srgb = \"#fff\": write color = \"#fff\""),
            ("[weft]", "twist_per_m = 300\n[weft]", "write direction and turns in one key: twist = \"Z 300/m\""),
        ] {
            assert!(SATIN.contains(from), "{from}");
            let got = ClothSpec::parse(&SATIN.replacen(from, to, 1), "s.toml");
            let message = got.expect_err(to).to_string();
            assert!(message.contains(want) && message.lines().count() == 1, "{message}\n{want}");
        }
    }
}
