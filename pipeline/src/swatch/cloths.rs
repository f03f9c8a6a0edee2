//! Cloths of a swatch: their specs, their curves and light, and the ply models of their yarns from a family.

use super::spectrum::WeaveGuess;
use crate::error::Error;
use plywave::cloth::{ClothData, ClothModel, ClothOptions};
use plywave::{FamilyParams, PlyFamily, PlyModel};
use plywave_sim::cloth::{ClothMeasures, Effort, make_cloth, precompute};
use plywave_textile::{ClothSpec, YarnOfCloth};
use std::f64::consts::TAU;
use std::fmt::Write;
use std::sync::Arc;

/// Name of the fitted cloth in messages.
const FILE: &str = "swatch";

/// The numbers of a swatch's cloth whose warp and weft are one yarn.
#[derive(Clone, Debug, PartialEq)]
pub struct SwatchNumbers {
    /// Linear density of the yarn [tex].
    pub tex: f64,
    /// Twist of the yarn, Z [turns/m].
    pub turns_per_m: f64,
    /// Tension of the warp over that of the weft.
    pub tension: f64,
    /// Roughness of the fibers' surface.
    pub alpha_fiber: f64,
    /// Color of the cloth under an even sky [sRGB]; `None` for clear fibers.
    pub srgb: Option<[f64; 3]>,
    /// Variation of the yarn's count, and of its place over the spacing, and the length over which both
    /// change [mm].
    pub uneven: Option<[f64; 3]>,
}

/// A fiber, with the family of its bundles.
#[derive(Clone, Debug)]
pub struct SwatchFiber {
    /// Name in a cloth spec.
    pub name: String,
    /// Its roughness in the library.
    pub alpha: f64,
    /// Usual twist factor [turns/m times the root of tex]; 0 for filament yarn.
    pub twist_factor: f64,
    family: Arc<PlyFamily>,
    /// Radius of the family's bundle [um].
    family_radius_um: f64,
    alphas: [f64; 2],
    pitches_um: [f64; 2],
}

/// A yarn of the fiber, as the language of specs reads it.
fn probe(fiber: &str, tex: f64) -> Result<YarnOfCloth, Error> {
    let text = format!(
        "name = \"x\"\n[weave]\nkind = \"plain\"\nends_per_cm = 10\npicks_per_cm = 10\n[warp]\nfiber = \"{fiber}\"\ncount = \"{tex} tex\"\n[weft]\nas = \"warp\"\n"
    );
    let spec = ClothSpec::parse(&text, FILE)?;
    spec.warp.ok_or_else(|| Error::Export { file: FILE.into(), what: "no warp".into() })
}

impl SwatchFiber {
    /// The fiber by its name in a spec.
    ///
    /// # Errors
    /// Those of the language of specs for unknown fibers, and for metals, which have no family.
    pub fn new(name: &str) -> Result<SwatchFiber, Error> {
        let yarn = probe(name, 30.0)?;
        let invalid = |hint: &str| {
            Error::Runtime(plywave::Error::Invalid {
                file: FILE.into(),
                key: "fiber".into(),
                value: name.into(),
                hint: hint.into(),
            })
        };
        if yarn.fiber.density_g_per_cm3 > 4.0 {
            return Err(invalid("a metal has no absorption to fit; give a textile fiber"));
        }
        let twist_factor = yarn.fiber_twist.1 * yarn.count.single_tex.sqrt();
        let family = if yarn.fiber.is_staple { "cotton_bundle" } else { "polyester_bundle" };
        let bytes = plywave_models::FAMILIES.iter().find(|(of, _)| *of == family).map(|(_, bytes)| *bytes);
        let family = PlyFamily::from_bytes(bytes.unwrap_or_default(), family)?;
        let spec = family.spec_at(&family.params());
        let ends = |param| {
            let values = family.data().values(param).unwrap_or(&[1.0]);
            [values[0], values[values.len() - 1]]
        };
        Ok(SwatchFiber {
            name: name.into(),
            alpha: yarn.fiber.spec.alpha_fiber,
            twist_factor,
            family_radius_um: spec.ply_radii_um()[0],
            alphas: ends(plywave::ply::FamilyParam::Alpha),
            pitches_um: ends(plywave::ply::FamilyParam::FiberPitch),
            family: Arc::new(family),
        })
    }

    /// Roughnesses that the family has.
    pub fn alphas(&self) -> [f64; 2] {
        self.alphas
    }

    /// Radius of a strand, and of the whole yarn [um], of a yarn of this count.
    pub fn radii_um(&self, tex: f64) -> Result<[f64; 2], Error> {
        let yarn = probe(&self.name, tex)?;
        Ok([yarn.strand_radius_um(), yarn.radius_um()])
    }

    /// The model of a strand: the family's bundle at another scale. Geometric optics has no scale, so that
    /// lengths grow with the radius and absorptions fall with it.
    fn strand(&self, yarn: &YarnOfCloth, name: &str, alpha: f64) -> Result<PlyModel, Error> {
        let spec = yarn.ply(FILE, name)?;
        let radius_um = spec.ply_radii_um()[0];
        let lean = spec.ply.twist().rad_per_um() * radius_um;
        let pitch_um =
            (TAU * self.family_radius_um / lean.abs().max(1e-9)).clamp(self.pitches_um[0], self.pitches_um[1]);
        let params = FamilyParams {
            fiber_pitch_um: pitch_um,
            alpha_fiber: alpha.clamp(self.alphas[0], self.alphas[1]),
            ..self.family.params()
        };
        let mut data = self.family.data_at(&params)?;
        let by = radius_um / self.family_radius_um;
        let scale = |all: &mut Vec<f64>, by: f64| all.iter_mut().for_each(|v| *v *= by);
        scale(&mut data.h_um, by);
        scale(&mut data.path_um, by);
        scale(&mut data.energies.miss_h_um, by);
        scale(&mut data.energies.share_h_um, by);
        scale(&mut data.sigma_per_um, 1.0 / by);
        data.edge = None;
        data.spec_text = spec.to_text(FILE)?;
        Ok(PlyModel::from_data(data)?.of_lines()?)
    }
}

/// Text of a cloth spec; `comments` stand after the numbers of their keys.
pub fn spec_text(
    guess: &WeaveGuess,
    fiber: &SwatchFiber,
    numbers: &SwatchNumbers,
    comments: &dyn Fn(&str) -> String,
) -> String {
    let mut text = String::new();
    let [red, green, blue] = numbers.srgb.unwrap_or_default();
    let head = comments("name");
    if !head.is_empty() {
        let _ = writeln!(text, "# {head}");
    }
    text += "name = \"swatch\"\n";
    let mut text_of = |head: &str, lines: &[(&str, String)]| {
        let _ = write!(text, "\n[{head}]\n");
        for (key, value) in lines {
            let comment = comments(key);
            if !comment.is_empty() {
                let _ = writeln!(text, "# {comment}");
            }
            let _ = writeln!(text, "{key} = {value}");
        }
    };
    text_of(
        "weave",
        &[
            ("kind", format!("\"{}\"", guess.weave)),
            ("ends_per_cm", format!("{:.2}", guess.per_cm[0])),
            ("picks_per_cm", format!("{:.2}", guess.per_cm[1])),
        ],
    );
    let mut warp = vec![
        ("fiber", format!("{{ like = \"{}\", alpha_fiber = {:.4} }}", fiber.name, numbers.alpha_fiber)),
        ("count", format!("\"{:.3} tex\"", numbers.tex)),
        ("twist", format!("\"Z {:.0}/m\"", numbers.turns_per_m.max(1.0))),
    ];
    if numbers.srgb.is_some() {
        warp.push(("color", format!("[{red:.4}, {green:.4}, {blue:.4}]")));
    }
    if let Some([count_cv, spacing_cv, mm]) = numbers.uneven {
        warp.push(("count_cv", format!("{count_cv:.4}")));
        warp.push(("spacing_cv", format!("{spacing_cv:.4}")));
        warp.push(("uneven_mm", format!("{mm:.2}")));
    }
    warp.push(("tension", format!("{:.3}", numbers.tension)));
    text_of("warp", &warp);
    text_of("weft", &[("as", "\"warp\"".into()), ("tension", "1.0".into())]);
    text
}

/// A cloth with what its light depends on.
pub struct SwatchCloth {
    /// The spec.
    pub spec: ClothSpec,
    /// Textile measures of its curves.
    pub measures: ClothMeasures,
    data: ClothData,
    fiber: SwatchFiber,
}

impl SwatchCloth {
    /// Weaves a cloth and follows light through it, with the effort of a draft.
    ///
    /// # Errors
    /// Those of the weaving, such as yarns too thick for their spacing.
    pub fn new(
        guess: &WeaveGuess,
        fiber: &SwatchFiber,
        numbers: &SwatchNumbers,
        go_on: &(dyn Fn() -> bool + Sync),
    ) -> Result<SwatchCloth, Error> {
        let text = spec_text(guess, fiber, numbers, &|_| String::new());
        let spec = ClothSpec::parse(&text, FILE)?;
        let fails = |e| Error::of_simulation(e, FILE);
        let mut read =
            |_: &str| Err(plywave::Error::Format { file: FILE.into(), what: "no file".into(), hint: String::new() });
        let made = make_cloth(&spec, FILE, &mut read, Effort::Draft, &|_| go_on()).map_err(fails)?;
        let models = strands(fiber, &spec, numbers.alpha_fiber)?;
        let mut data = precompute(&spec, &text, &made.curves, &models, Effort::Draft, &|_| go_on()).map_err(fails)?;
        data.looks = made.looks;
        Ok(SwatchCloth { spec, measures: made.measures, data, fiber: fiber.clone() })
    }

    /// The cloth for shading.
    pub fn model(&self, options: &ClothOptions) -> Result<ClothModel, Error> {
        Ok(ClothModel::from_data(self.data.clone(), options)?)
    }

    /// The cloth with other unevenness, for shading.
    pub fn uneven_model(&self, numbers: &SwatchNumbers, options: &ClothOptions) -> Result<ClothModel, Error> {
        let mut data = self.data.clone();
        for look in &mut data.looks {
            look.unevenness = numbers.uneven.map(|[count_cv, spacing_cv, length_mm]| plywave::cloth::Unevenness {
                count_cv,
                spacing_cv,
                length_mm,
            });
        }
        Ok(ClothModel::from_data(data, options)?)
    }

    /// The models of its strands with fibers of this roughness.
    pub fn strands(&self, alpha: f64) -> Result<Vec<Arc<PlyModel>>, Error> {
        strands(&self.fiber, &self.spec, alpha)
    }
}

fn strands(fiber: &SwatchFiber, spec: &ClothSpec, alpha: f64) -> Result<Vec<Arc<PlyModel>>, Error> {
    let each = spec.yarns().into_iter().enumerate();
    each.map(|(kind, yarn)| Ok(Arc::new(fiber.strand(yarn, spec.kind_name(kind), alpha)?))).collect()
}
