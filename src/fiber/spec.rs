//! Specs of analytic fibers in TOML, for the command line and for hosts: a name, `[filament]` with a model
//! and its parameters, and the color inside the fiber.
//!
//! ```toml
//! name = "brown hair"
//! sigma_per_um = [0.002, 0.005, 0.012]
//! lambda_um = [0.61, 0.55, 0.465]
//!
//! [filament]
//! kind = "rough_dielectric"
//! eta = 1.55
//! radius_um = 40
//! ```
//!
//! Absent parameters are those of the model's `Default`. Angles are in radians, as in every file.

use super::{
    DielectricFiber, DielectricParameters, FiberModel, KajiyaKayFiber, KajiyaKayParameters, KhungurnFiber,
    KhungurnParameters, Metal, Mirror, OpaqueFiber, OpaqueParameters, Reflectance, RoughDielectricFiber,
    RoughDielectricParameters,
};
use crate::io::read_text;
use crate::spec::rules::{self, Custom, Key, Kind, Rules, optional, required};
use crate::{Error, Result};
use std::f64::consts::PI;
use std::path::Path;
use toml::{Table, Value};

/// Largest spec that is read [bytes].
const MAX_BYTES: u64 = 1 << 20;

/// An analytic fiber from a file.
#[derive(Clone, Debug)]
pub struct FilamentSpec {
    /// Its name.
    pub name: String,
    /// The model.
    pub model: FiberModel,
    /// Three wavelengths [um].
    pub lambda_um: [f32; 3],
    /// Absorption inside the fiber at them [1/um].
    pub sigma_per_um: [f32; 3],
}

const fn three(expected: &'static str, check: fn(&str, &str, &Value) -> Result<()>) -> Kind {
    Kind::Custom(Custom { expected, check })
}

/// Refuses anything but three numbers that each pass.
fn each_of_three(file: &str, key: &str, value: &Value, hint: &str, holds: fn(f64) -> bool) -> Result<()> {
    let list = value.as_array().map_or(&[][..], Vec::as_slice);
    if list.len() == 3 && list.iter().all(|x| number(x).is_some_and(holds)) {
        return Ok(());
    }
    Err(rules::invalid(file, key, value, format!("use {hint}")))
}

const SHIFTS: Kind = three("three numbers from -1 to 1, of R, TT, TRT", |file, key, value| {
    each_of_three(file, key, value, "three numbers from -1 to 1, of R, TT, TRT", |x| (-1.0..=1.0).contains(&x))
});
const WIDTHS_M: Kind = three("three numbers from 0.001 to 2, of R, TT, TRT", |file, key, value| {
    each_of_three(file, key, value, "three numbers from 0.001 to 2, of R, TT, TRT", |x| (1e-3..=2.0).contains(&x))
});
const WIDTHS_THETA: Kind = three("three numbers from 0.005 to 1, of R, TT, TRT", |file, key, value| {
    each_of_three(file, key, value, "three numbers from 0.005 to 1, of R, TT, TRT", |x| (0.005..=1.0).contains(&x))
});
const WIDTHS_PHI: Kind = three("three numbers, 0 or 0.06 to 10, of R, TT, TRT", |file, key, value| {
    each_of_three(file, key, value, "three numbers, 0 or 0.06 to 10, of R, TT, TRT", |x| {
        x == 0.0 || (0.06..=10.0).contains(&x)
    })
});
const LAMBDAS: Kind = three("three wavelengths from 0.2 to 3", |file, key, value| {
    each_of_three(file, key, value, "three wavelengths from 0.2 to 3", |x| (0.2..=3.0).contains(&x))
});
const SIGMAS: Kind = three("three numbers from 0 to 1000", |file, key, value| {
    each_of_three(file, key, value, "three numbers from 0 to 1000", |x| (0.0..=1000.0).contains(&x))
});

const RADIUS: Kind = Kind::Number(0.01, 1e5);
const ETA: Kind = Kind::Number(1.01, 4.0);
const WIDTH_N: Kind = Kind::Number(1e-3, 10.0);

fn truth(file: &str, key: &str, value: &Value) -> Result<()> {
    match value {
        Value::Boolean(_) => Ok(()),
        _ => Err(rules::invalid(file, key, value, "use true or false")),
    }
}

/// A key `normalize` that a kind refuses, and why.
macro_rules! not_normalized {
    ($why:literal) => {
        optional(
            "normalize",
            Kind::Custom(Custom {
                expected: "false",
                check: |file, key, value| match value {
                    Value::Boolean(false) => Ok(()),
                    _ => Err(rules::invalid(file, key, value, concat!("leave it out: ", $why))),
                },
            }),
            "false",
        )
    };
}

const DIELECTRIC: &[Key] = &[
    optional("eta", ETA, "1.55"),
    optional("radius_um", RADIUS, "10.0"),
    optional("beta_m", WIDTHS_M, "[0.1, 0.1, 0.1]"),
    optional("shift", SHIFTS, "[0.0, 0.0, 0.0]"),
    optional("beta_n", WIDTH_N, "0.1"),
    optional("orders", Kind::Integer(1, 8), "5"),
    not_normalized!("a dielectric fiber without absorption has the albedo 1 as it is"),
];
const ROUGH: &[Key] = &[
    optional("eta", ETA, "1.55"),
    optional("radius_um", RADIUS, "40.0"),
    optional("eccentricity", Kind::Number(0.8, 1.25), "1.0"),
    optional("shift", SHIFTS, "[-0.1, 0.05, 0.15]"),
    optional("width_theta", WIDTHS_THETA, "[0.1, 0.05, 0.2]"),
    optional("width_phi", WIDTHS_PHI, "[0.1, 0.1, 0.2]"),
    optional("k_d", Kind::Number(0.0, 0.5 / (PI * PI)), "0.0"),
    optional("normalize", Kind::Custom(Custom { expected: "true or false", check: truth }), "false"),
];
const OPAQUE: &[Key] = &[
    optional("radius_um", RADIUS, "10.0"),
    optional("metal", Kind::Choice(&["gold", "silver", "aluminium", "aluminum", "copper"]), "no metal"),
    optional("eta", Kind::Number(0.01, 20.0), "no mirror; with kappa a conductor's, alone a dielectric's"),
    optional("kappa", Kind::Number(0.0, 50.0), "a dielectric"),
    optional("diffuse", Kind::Number(0.0, 1.0), "0.0"),
    optional("beta_m", Kind::Number(1e-3, 2.0), "0.1"),
    optional("beta_n", WIDTH_N, "0.1"),
    not_normalized!("what an opaque fiber does not reflect it absorbs"),
];
const KAJIYA_KAY: &[Key] = &[
    optional("radius_um", RADIUS, "10.0"),
    optional("phong", Kind::Number(0.0, 10.0), "0.1"),
    optional("exponent", Kind::Number(1.0, 1e4), "50.0"),
    optional("diffuse", Kind::Number(0.0, 1.0 / (PI * PI)), "0.03"),
    not_normalized!("the albedo is what phong and diffuse say"),
];

const SHARE: Kind = Kind::Custom(Custom {
    expected: "a number from 0 to 1, or three of a color in sRGB",
    check: |file, key, value| {
        let hint = "a number from 0 to 1, or three of a color in sRGB";
        match number(value) {
            Some(x) if (0.0..=1.0).contains(&x) => Ok(()),
            Some(_) => Err(rules::invalid(file, key, value, format!("use {hint}"))),
            None => each_of_three(file, key, value, hint, |x| (0.0..=1.0).contains(&x)),
        }
    },
});
const KHUNGURN: &[Key] = &[
    optional("radius_um", RADIUS, "10.0"),
    optional("c_r", SHARE, "0.05"),
    optional("c_tt", SHARE, "0.9"),
    optional("beta_r", Kind::Number(0.005, 10.0), "0.1"),
    optional("beta_tt", Kind::Number(0.005, 10.0), "0.2"),
    optional("gamma_tt", Kind::Number(0.01, 1000.0), "0.4"),
    not_normalized!("the albedo is what c_r and c_tt say, 1 with c_tt = 1"),
];

/// Kinds of analytic fibers and their keys, for all files that contain one.
pub const FILAMENT_KINDS: &[(&str, &[Key])] = &[
    ("dielectric", DIELECTRIC),
    ("rough_dielectric", ROUGH),
    ("opaque", OPAQUE),
    ("kajiya_kay", KAJIYA_KAY),
    ("khungurn", KHUNGURN),
];

/// The rules of these specs.
pub const FILAMENT_RULES: Rules = Rules {
    keys: &[
        required("name", Kind::Text),
        optional("lambda_um", LAMBDAS, "[0.61, 0.55, 0.465]"),
        optional("sigma_per_um", SIGMAS, "[0.0, 0.0, 0.0]"),
        required("filament", Kind::Tagged("{ kind = \"rough_dielectric\" }", FILAMENT_KINDS)),
    ],
    units: &["_per_um", "_um"],
    example: "docs/explain/filaments.md",
    foreign: &[(&["fiber", "ply", "absorption"], "this is a key of a yarn spec")],
};

fn number(value: &Value) -> Option<f64> {
    let x = match value {
        Value::Float(x) => *x,
        Value::Integer(i) => *i as f64,
        _ => return None,
    };
    x.is_finite().then_some(x)
}

/// Numbers of a checked table.
struct Given<'a>(&'a Table);

impl Given<'_> {
    fn one(&self, key: &str, default: f32) -> f32 {
        self.0.get(key).and_then(number).map_or(default, |x| x as f32)
    }

    fn three(&self, key: &str, default: [f32; 3]) -> [f32; 3] {
        let Some(list) = self.0.get(key).and_then(Value::as_array) else { return default };
        std::array::from_fn(|k| list.get(k).and_then(number).map_or(default[k], |x| x as f32))
    }

    fn share(&self, key: &str, default: Reflectance) -> Reflectance {
        match self.0.get(key) {
            None => default,
            Some(Value::Array(_)) => Reflectance::of_srgb(self.three(key, [0.0; 3]).map(f64::from)),
            Some(_) => Reflectance::Gray(self.one(key, 0.0)),
        }
    }
}

impl FilamentSpec {
    /// Reads a spec from its text; `file` is for messages.
    ///
    /// # Errors
    /// [`Error::Format`] if the text is not TOML, [`Error::Invalid`] for a key that is unknown, absent or out
    /// of range.
    ///
    /// ```
    /// use plywave::fiber::FilamentSpec;
    ///
    /// let line = FilamentSpec::parse("name = \"x\"\n[filament]\nkind = \"dielectric\"\neta = 0.9", "x.toml").unwrap_err().to_string();
    /// assert_eq!(line, "x.toml: filament.eta = 0.9: use a number from 1.01 to 4");
    /// ```
    pub fn parse(text: &str, file: &str) -> Result<FilamentSpec> {
        let table = rules::parse(text, file, &FILAMENT_RULES)?;
        let root = Given(&table);
        let empty = Table::new();
        let filament = table.get("filament").and_then(Value::as_table).unwrap_or(&empty);
        Ok(FilamentSpec {
            name: table.get("name").and_then(Value::as_str).unwrap_or_default().to_string(),
            model: filament_of(filament, file, "filament")?,
            lambda_um: root.three("lambda_um", [0.61, 0.55, 0.465]),
            sigma_per_um: root.three("sigma_per_um", [0.0; 3]),
        })
    }

    /// An analytic fiber from a file's bytes if its name ends in `.toml`; none for other names.
    ///
    /// # Errors
    /// As [`FilamentSpec::parse`].
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<Option<FilamentSpec>> {
        if !name.ends_with(".toml") {
            return Ok(None);
        }
        let not_text = |e| Error::Format {
            file: name.into(),
            what: format!("not UTF-8: {e}"),
            hint: "write the spec as text".into(),
        };
        let text = std::str::from_utf8(bytes).map_err(not_text)?;
        FilamentSpec::parse(text, name).map(Some)
    }

    /// Reads a spec from a file.
    ///
    /// # Errors
    /// As [`FilamentSpec::parse`], and [`Error::Io`] if the file cannot be read.
    pub fn load(path: impl AsRef<Path>) -> Result<FilamentSpec> {
        let path = path.as_ref();
        FilamentSpec::parse(&read_text(path, MAX_BYTES)?, &path.display().to_string())
    }
}

/// The model from a table of one of [`FILAMENT_KINDS`] that passed their rules. `at` is the table's key in
/// `file`, for messages.
///
/// # Errors
/// [`Error::Invalid`] for values that are incompatible.
pub fn filament_of(table: &Table, file: &str, at: &str) -> Result<FiberModel> {
    let given = Given(table);
    let made = match table.get("kind").and_then(Value::as_str).unwrap_or_default() {
        "dielectric" => {
            let d = DielectricParameters::default();
            let orders = table.get("orders").and_then(Value::as_integer).map_or(d.orders, |o| o as usize);
            DielectricFiber::new(DielectricParameters {
                eta: given.one("eta", d.eta),
                radius_um: given.one("radius_um", d.radius_um),
                beta_m: given.three("beta_m", d.beta_m),
                shift: given.three("shift", d.shift),
                beta_n: given.one("beta_n", d.beta_n),
                orders,
            })
            .map(FiberModel::from)
        }
        "opaque" => {
            let d = OpaqueParameters::default();
            let metal = table.get("metal").and_then(Value::as_str).and_then(Metal::named);
            let (eta, kappa) = (table.get("eta"), table.get("kappa"));
            if let (Some(_), Some(value)) = (metal, eta.or(kappa)) {
                let key = if eta.is_some() { "eta" } else { "kappa" };
                return Err(rules::invalid(
                    file,
                    &format!("{at}.{key}"),
                    value,
                    "a named metal has its own: leave one out",
                ));
            }
            let mirror = match (metal, eta, kappa) {
                (Some(metal), ..) => Mirror::Metal(metal),
                (None, None, None) => Mirror::None,
                (None, Some(_), None) => Mirror::Dielectric(given.one("eta", 1.5)),
                (None, Some(_), Some(_)) => Mirror::Conductor([given.one("eta", 1.0), given.one("kappa", 0.0)]),
                (None, None, Some(value)) => {
                    return Err(rules::invalid(file, &format!("{at}.kappa"), value, "give eta with it"));
                }
            };
            OpaqueFiber::new(OpaqueParameters {
                radius_um: given.one("radius_um", d.radius_um),
                mirror,
                diffuse: given.one("diffuse", d.diffuse),
                beta_m: given.one("beta_m", d.beta_m),
                beta_n: given.one("beta_n", d.beta_n),
            })
            .map(FiberModel::from)
        }
        "kajiya_kay" => {
            let d = KajiyaKayParameters::default();
            KajiyaKayFiber::new(KajiyaKayParameters {
                radius_um: given.one("radius_um", d.radius_um),
                phong: given.one("phong", d.phong),
                exponent: given.one("exponent", d.exponent),
                diffuse: given.one("diffuse", d.diffuse),
            })
            .map(FiberModel::from)
        }
        "khungurn" => {
            let d = KhungurnParameters::default();
            KhungurnFiber::new(KhungurnParameters {
                radius_um: given.one("radius_um", d.radius_um),
                c_r: given.share("c_r", d.c_r),
                c_tt: given.share("c_tt", d.c_tt),
                beta_r: given.one("beta_r", d.beta_r),
                beta_tt: given.one("beta_tt", d.beta_tt),
                gamma_tt: given.one("gamma_tt", d.gamma_tt),
            })
            .map(FiberModel::from)
        }
        _ => {
            let d = RoughDielectricParameters::default();
            RoughDielectricFiber::new(RoughDielectricParameters {
                eta: given.one("eta", d.eta),
                radius_um: given.one("radius_um", d.radius_um),
                eccentricity: given.one("eccentricity", d.eccentricity),
                shift: given.three("shift", d.shift),
                width_theta: given.three("width_theta", d.width_theta),
                width_phi: given.three("width_phi", d.width_phi),
                k_d: given.one("k_d", d.k_d).min((0.5 / (PI * PI)) as f32),
                normalize: table.get("normalize").and_then(Value::as_bool).unwrap_or(d.normalize),
            })
            .map(FiberModel::from)
        }
    };
    made.map_err(|error| match error {
        Error::Invalid { key, value, hint, .. } => rules::invalid(file, &format!("{at}.{key}"), value, hint),
        other => other,
    })
}
