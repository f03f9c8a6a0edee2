//! Specs of analytic fibers in TOML, for the command line and for hosts: a name, a table `[filament]` with a
//! model and its parameters, and the color inside the fiber.
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
//! Absent parameters have the values of the model's `Default`. Angles are in radians, as in every file.

use crate::{
    DielectricFiber, DielectricParameters, FiberModel, KajiyaKayFiber, KajiyaKayParameters, KhungurnFiber,
    KhungurnParameters, Mirror, OpaqueFiber, OpaqueParameters, Reflectance, RoughDielectricFiber,
    RoughDielectricParameters,
};
use plywave::io::read_text;
use plywave::optics::Metal;
use plywave::spec::rules::{self, Custom, Key, KeyKind, Rules, optional, required};
use plywave::{Error, Result};
use std::f64::consts::PI;
use std::path::Path;
use toml::{Table, Value};

/// Maximum size of a spec [bytes].
const MAX_BYTES: u64 = 1 << 20;

/// An analytic fiber from a file.
#[derive(Clone, Debug)]
pub struct FilamentSpec {
    /// Name of the fiber.
    pub name: String,
    /// The model.
    pub model: FiberModel,
    /// Three wavelengths [um].
    pub lambda_um: [f32; 3],
    /// Absorption inside the fiber at these wavelengths [1/um].
    pub sigma_per_um: [f32; 3],
}

const fn three(expected: &'static str, check: fn(&str, &str, &Value) -> Result<()>) -> KeyKind {
    KeyKind::Custom(Custom { expected, check })
}

/// Returns an error unless the value is a list of three numbers that each satisfy `holds`.
fn each_of_three(file: &str, key: &str, value: &Value, hint: &str, holds: fn(f64) -> bool) -> Result<()> {
    let list = value.as_array().map_or(&[][..], Vec::as_slice);
    if list.len() == 3 && list.iter().all(|x| number(x).is_some_and(holds)) {
        return Ok(());
    }
    Err(rules::invalid(file, key, value, format!("use {hint}")))
}

const SHIFTS: KeyKind = three("three numbers from -1 to 1, of R, TT, TRT", |file, key, value| {
    each_of_three(file, key, value, "three numbers from -1 to 1, of R, TT, TRT", |x| (-1.0..=1.0).contains(&x))
});
const WIDTHS_M: KeyKind = three("three numbers from 0.001 to 2, of R, TT, TRT", |file, key, value| {
    each_of_three(file, key, value, "three numbers from 0.001 to 2, of R, TT, TRT", |x| (1e-3..=2.0).contains(&x))
});
const WIDTHS_THETA: KeyKind = three("three numbers from 0.005 to 1, of R, TT, TRT", |file, key, value| {
    each_of_three(file, key, value, "three numbers from 0.005 to 1, of R, TT, TRT", |x| (0.005..=1.0).contains(&x))
});
const WIDTHS_PHI: KeyKind = three("three numbers, 0 or 0.06 to 10, of R, TT, TRT", |file, key, value| {
    each_of_three(file, key, value, "three numbers, 0 or 0.06 to 10, of R, TT, TRT", |x| {
        x == 0.0 || (0.06..=10.0).contains(&x)
    })
});
const LAMBDAS: KeyKind = three("three wavelengths from 0.2 to 3", |file, key, value| {
    each_of_three(file, key, value, "three wavelengths from 0.2 to 3", |x| (0.2..=3.0).contains(&x))
});
const SIGMAS: KeyKind = three("three numbers from 0 to 1000", |file, key, value| {
    each_of_three(file, key, value, "three numbers from 0 to 1000", |x| (0.0..=1000.0).contains(&x))
});

const RADIUS: KeyKind = KeyKind::Number(0.01, 1e5);
const ETA: KeyKind = KeyKind::Number(1.01, 4.0);
const WIDTH_N: KeyKind = KeyKind::Number(1e-3, 10.0);

fn truth(file: &str, key: &str, value: &Value) -> Result<()> {
    match value {
        Value::Boolean(_) => Ok(()),
        _ => Err(rules::invalid(file, key, value, "use true or false")),
    }
}

/// The key `normalize` of a kind that does not support it; the message says why.
macro_rules! not_normalized {
    ($why:literal) => {
        optional(
            "normalize",
            KeyKind::Custom(Custom {
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
    optional("orders", KeyKind::Integer(1, 8), "5"),
    not_normalized!("a dielectric fiber without absorption has the albedo 1 as it is"),
];
const ROUGH: &[Key] = &[
    optional("eta", ETA, "1.55"),
    optional("radius_um", RADIUS, "40.0"),
    optional("eccentricity", KeyKind::Number(0.8, 1.25), "1.0"),
    optional("shift", SHIFTS, "[-0.1, 0.05, 0.15]"),
    optional("width_theta", WIDTHS_THETA, "[0.1, 0.05, 0.2]"),
    optional("width_phi", WIDTHS_PHI, "[0.1, 0.1, 0.2]"),
    optional("k_d", KeyKind::Number(0.0, 0.5 / (PI * PI)), "0.0"),
    optional("normalize", KeyKind::Custom(Custom { expected: "true or false", check: truth }), "false"),
];
const OPAQUE: &[Key] = &[
    optional("radius_um", RADIUS, "10.0"),
    optional("metal", KeyKind::Choice(&["gold", "silver", "aluminium", "aluminum", "copper"]), "no metal"),
    optional("eta", KeyKind::Number(0.01, 20.0), "no mirror; with kappa a conductor's, alone a dielectric's"),
    optional("kappa", KeyKind::Number(0.0, 50.0), "a dielectric"),
    optional("diffuse", KeyKind::Number(0.0, 1.0), "0.0"),
    optional("beta_m", KeyKind::Number(1e-3, 2.0), "0.1"),
    optional("beta_n", WIDTH_N, "0.1"),
    not_normalized!("what an opaque fiber does not reflect it absorbs"),
];
const KAJIYA_KAY: &[Key] = &[
    optional("radius_um", RADIUS, "10.0"),
    optional("phong", KeyKind::Number(0.0, 10.0), "0.1"),
    optional("exponent", KeyKind::Number(1.0, 1e4), "50.0"),
    optional("diffuse", KeyKind::Number(0.0, 1.0 / (PI * PI)), "0.03"),
    not_normalized!("the albedo is what phong and diffuse say"),
];

const SHARE: KeyKind = KeyKind::Custom(Custom {
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
    optional("beta_r", KeyKind::Number(0.005, 10.0), "0.1"),
    optional("beta_tt", KeyKind::Number(0.005, 10.0), "0.2"),
    optional("gamma_tt", KeyKind::Number(0.01, 1000.0), "0.4"),
    not_normalized!("the albedo is what c_r and c_tt say, 1 with c_tt = 1"),
];

/// Kinds of analytic fibers and their keys, for all files that contain a fiber.
pub const FILAMENT_KINDS: &[(&str, &[Key])] = &[
    ("dielectric", DIELECTRIC),
    ("rough_dielectric", ROUGH),
    ("opaque", OPAQUE),
    ("kajiya_kay", KAJIYA_KAY),
    ("khungurn", KHUNGURN),
];

/// The validation rules of these specs.
pub const FILAMENT_RULES: Rules = Rules {
    keys: &[
        required("name", KeyKind::Text),
        optional("lambda_um", LAMBDAS, "[0.61, 0.55, 0.465]"),
        optional("sigma_per_um", SIGMAS, "[0.0, 0.0, 0.0]"),
        required("filament", KeyKind::Tagged("{ kind = \"rough_dielectric\" }", FILAMENT_KINDS)),
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

/// Typed access to the values of a table that passed its rules.
struct Values<'a>(&'a Table);

impl Values<'_> {
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
    /// Reads a spec from its text; `file` names it in messages.
    ///
    /// # Errors
    /// [`Error::Format`] if the text is not TOML; [`Error::Invalid`] if a key is unknown, absent or out of
    /// range.
    ///
    /// ```
    /// use plywave_fiber::FilamentSpec;
    ///
    /// let line = FilamentSpec::parse("name = \"x\"\n[filament]\nkind = \"dielectric\"\neta = 0.9", "x.toml").unwrap_err().to_string();
    /// assert_eq!(line, "x.toml: filament.eta = 0.9: use a number from 1.01 to 4");
    /// ```
    pub fn parse(text: &str, file: &str) -> Result<FilamentSpec> {
        let table = rules::parse(text, file, &FILAMENT_RULES)?;
        let root = Values(&table);
        let empty = Table::new();
        let filament = table.get("filament").and_then(Value::as_table).unwrap_or(&empty);
        Ok(FilamentSpec {
            name: table.get("name").and_then(Value::as_str).unwrap_or_default().to_string(),
            model: filament_of(filament, file, "filament")?,
            lambda_um: root.three("lambda_um", [0.61, 0.55, 0.465]),
            sigma_per_um: root.three("sigma_per_um", [0.0; 3]),
        })
    }

    /// Reads an analytic fiber from a file's bytes, if its name ends in `.toml`; `None` for other names.
    ///
    /// # Errors
    /// Those of [`FilamentSpec::parse`].
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
    /// Those of [`FilamentSpec::parse`], and [`Error::Io`] if the file cannot be read.
    pub fn load(path: impl AsRef<Path>) -> Result<FilamentSpec> {
        let path = path.as_ref();
        FilamentSpec::parse(&read_text(path, MAX_BYTES)?, &path.display().to_string())
    }
}

/// Builds the model from a table of one of [`FILAMENT_KINDS`] that passed its rules. `at` is the table's key
/// in `file`, for messages.
///
/// # Errors
/// [`Error::Invalid`] if values are incompatible.
pub fn filament_of(table: &Table, file: &str, at: &str) -> Result<FiberModel> {
    let values = Values(table);
    let model = match table.get("kind").and_then(Value::as_str).unwrap_or_default() {
        "dielectric" => {
            let d = DielectricParameters::default();
            let orders = table.get("orders").and_then(Value::as_integer).map_or(d.orders, |o| o as usize);
            DielectricFiber::new(DielectricParameters {
                eta: values.one("eta", d.eta),
                radius_um: values.one("radius_um", d.radius_um),
                beta_m: values.three("beta_m", d.beta_m),
                shift: values.three("shift", d.shift),
                beta_n: values.one("beta_n", d.beta_n),
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
                (None, Some(_), None) => Mirror::Dielectric(values.one("eta", 1.5)),
                (None, Some(_), Some(_)) => Mirror::Conductor([values.one("eta", 1.0), values.one("kappa", 0.0)]),
                (None, None, Some(value)) => {
                    return Err(rules::invalid(file, &format!("{at}.kappa"), value, "give eta with it"));
                }
            };
            OpaqueFiber::new(OpaqueParameters {
                radius_um: values.one("radius_um", d.radius_um),
                mirror,
                diffuse: values.one("diffuse", d.diffuse),
                beta_m: values.one("beta_m", d.beta_m),
                beta_n: values.one("beta_n", d.beta_n),
            })
            .map(FiberModel::from)
        }
        "kajiya_kay" => {
            let d = KajiyaKayParameters::default();
            KajiyaKayFiber::new(KajiyaKayParameters {
                radius_um: values.one("radius_um", d.radius_um),
                phong: values.one("phong", d.phong),
                exponent: values.one("exponent", d.exponent),
                diffuse: values.one("diffuse", d.diffuse),
            })
            .map(FiberModel::from)
        }
        "khungurn" => {
            let d = KhungurnParameters::default();
            KhungurnFiber::new(KhungurnParameters {
                radius_um: values.one("radius_um", d.radius_um),
                c_r: values.share("c_r", d.c_r),
                c_tt: values.share("c_tt", d.c_tt),
                beta_r: values.one("beta_r", d.beta_r),
                beta_tt: values.one("beta_tt", d.beta_tt),
                gamma_tt: values.one("gamma_tt", d.gamma_tt),
            })
            .map(FiberModel::from)
        }
        _ => {
            let d = RoughDielectricParameters::default();
            RoughDielectricFiber::new(RoughDielectricParameters {
                eta: values.one("eta", d.eta),
                radius_um: values.one("radius_um", d.radius_um),
                eccentricity: values.one("eccentricity", d.eccentricity),
                shift: values.three("shift", d.shift),
                width_theta: values.three("width_theta", d.width_theta),
                width_phi: values.three("width_phi", d.width_phi),
                k_d: values.one("k_d", d.k_d).min((0.5 / (PI * PI)) as f32),
                normalize: table.get("normalize").and_then(Value::as_bool).unwrap_or(d.normalize),
            })
            .map(FiberModel::from)
        }
    };
    model.map_err(|error| match error {
        Error::Invalid { key, value, hint, .. } => rules::invalid(file, &format!("{at}.{key}"), value, hint),
        other => other,
    })
}
