//! Rules of scenes of strands.

use plywave::spec::rules::{self, Custom, Key, KeyKind, Rules, invalid, number, optional, required};
use plywave_fiber::FILAMENT_KINDS;
use toml::Value;

/// Largest length [mm].
const FAR: f64 = 1e6;
/// Most lamps.
const MAX_LAMPS: usize = 64;
/// Most nodes of a spectrum.
const MAX_NODES: usize = 256;

const LENGTH: KeyKind = KeyKind::Above(0.0, FAR);
const COUNT: KeyKind = KeyKind::Integer(1, 10_000_000);
const PLACE: KeyKind = KeyKind::Custom(Custom { expected: "three numbers, x, y, z", check: place });

const MADE: &[(&str, &[Key])] = &[
    ("single", &[required("length_mm", LENGTH)]),
    (
        "layer",
        &[
            required("count", COUNT),
            optional("layers", KeyKind::Integer(1, 10_000), "1"),
            required("spacing_mm", LENGTH),
            required("length_mm", LENGTH),
        ],
    ),
    (
        "ball",
        &[
            required("count", COUNT),
            required("ball_mm", LENGTH),
            required("length_mm", LENGTH),
            optional("curl_mm", KeyKind::Number(0.0, FAR), "0"),
        ],
    ),
    ("wisp", &[required("count", COUNT), required("width_mm", LENGTH), required("length_mm", LENGTH)]),
    ("fur", &[required("count", COUNT), required("size_mm", LENGTH), required("length_mm", LENGTH)]),
    (
        "loop",
        &[
            required("count", COUNT),
            optional("loops", KeyKind::Integer(1, 1000), "3"),
            required("width_mm", LENGTH),
            required("yarn_mm", LENGTH),
        ],
    ),
];

const TABLE: &[Key] =
    &[required("file", KeyKind::Text), optional("beta_m", KeyKind::Number(0.001, 2.0), "the table's")];

/// Tables, and the kinds of analytic fibers.
const MODELS: &[(&str, &[Key])] = &{
    let mut all = [("table", TABLE); 1 + FILAMENT_KINDS.len()];
    let mut k = 0;
    while k < FILAMENT_KINDS.len() {
        all[k + 1] = FILAMENT_KINDS[k];
        k += 1;
    }
    all
};

/// Keys of a scene of strands.
pub const RULES: Rules = Rules {
    keys: &[
        required("name", KeyKind::Text),
        required(
            "strands",
            KeyKind::Table(&[
                optional("file", KeyKind::Text, "none"),
                optional("make", KeyKind::Tagged("{ kind = \"single\", length_mm = 10 }", MADE), "none"),
                optional("radius_um", KeyKind::Number(0.01, 1e6), "the file's"),
                optional("segments", KeyKind::Integer(1, 60_000), "32"),
                optional("seed", KeyKind::Integer(0, i64::MAX), "1"),
                optional("basis", KeyKind::Choice(&["bspline", "linear"]), "bspline"),
                optional(
                    "whole",
                    KeyKind::Custom(Custom { expected: "true or false", check: truth }),
                    "true of .hair and .obj",
                ),
                optional("mm_per_unit", KeyKind::Number(1e-6, 1e6), "1"),
                optional("shape", KeyKind::Choice(&["tube", "band"]), "tube"),
            ]),
        ),
        required(
            "fiber",
            KeyKind::Table(&[
                required("model", KeyKind::Tagged("{ kind = \"dielectric\" }", MODELS)),
                optional(
                    "sigma_per_um",
                    KeyKind::Custom(Custom {
                        expected: "a number from 0 to 1e6, or pairs [lambda_um, sigma_per_um] of ascending wavelengths",
                        check: sigma,
                    }),
                    "0",
                ),
                optional("near", KeyKind::Custom(Custom { expected: "true or false", check: truth }), "false"),
            ]),
        ),
        required(
            "camera",
            KeyKind::Table(&[
                required("from_mm", PLACE),
                required("to_mm", PLACE),
                optional("up", PLACE, "[0, 0, 1]"),
                required("fov_deg", KeyKind::Number(1e-4, 170.0)),
            ]),
        ),
        optional("lamps", KeyKind::Custom(Custom { expected: "up to 64 tables, [[lamps]]", check: lamps }), "none"),
        optional("sky", KeyKind::Number(0.0, 1e6), "0"),
        optional(
            "floor",
            KeyKind::Table(&[
                required("height_mm", KeyKind::Number(-FAR, FAR)),
                required("albedo", KeyKind::Number(0.0, 1.0)),
            ]),
            "none",
        ),
        optional(
            "ball",
            KeyKind::Table(&[
                optional("center_mm", PLACE, "[0, 0, 0]"),
                required("radius_mm", LENGTH),
                required("albedo", KeyKind::Number(0.0, 1.0)),
            ]),
            "none",
        ),
    ],
    units: &["_per_um", "_um", "_mm", "_deg"],
    example: "fabrics/strands/hair_ball.toml",
    foreign: &[
        (&["weave", "warp", "weft"], "a key of cloth specs"),
        (&["ply", "absorption", "simulation"], "a key of yarn specs"),
    ],
};

const LAMP: &[Key] = &[
    required("from_mm", PLACE),
    optional("to_mm", PLACE, "[0, 0, 0]"),
    required("size_mm", LENGTH),
    required("radiance", KeyKind::Number(0.0, 1e9)),
];

fn place(file: &str, key: &str, value: &Value) -> plywave::Result<()> {
    let fine = |list: &Vec<Value>| list.len() == 3 && list.iter().all(|v| number(v).is_some_and(|v| v.abs() <= FAR));
    if value.as_array().is_some_and(fine) {
        return Ok(());
    }
    Err(invalid(file, key, value, "use three numbers, at most 1e6"))
}

fn truth(file: &str, key: &str, value: &Value) -> plywave::Result<()> {
    if value.is_bool() { Ok(()) } else { Err(invalid(file, key, value, "use true or false")) }
}

fn sigma(file: &str, key: &str, value: &Value) -> plywave::Result<()> {
    let within = |v: &Value| number(v).is_some_and(|v| (0.0..=1e6).contains(&v));
    let pair = |v: &Value| v.as_array().is_some_and(|p| p.len() == 2 && p.iter().all(within));
    let fine = match value.as_array() {
        None => within(value),
        Some(list) => {
            let lambda = |v: &Value| number(&v[0]).unwrap_or(0.0);
            (1..=MAX_NODES).contains(&list.len())
                && list.iter().all(pair)
                && list.windows(2).all(|w| lambda(&w[0]) < lambda(&w[1]))
        }
    };
    let hint = "use a number from 0 to 1e6, or pairs [lambda_um, sigma_per_um] of ascending wavelengths";
    if fine { Ok(()) } else { Err(invalid(file, key, value, hint)) }
}

fn lamps(file: &str, key: &str, value: &Value) -> plywave::Result<()> {
    let Some(list) = value.as_array().filter(|list| list.len() <= MAX_LAMPS && list.iter().all(Value::is_table)) else {
        return Err(invalid(file, key, value, "use up to 64 tables, [[lamps]]"));
    };
    let rules = Rules { keys: LAMP, ..RULES };
    for lamp in list.iter().filter_map(Value::as_table) {
        rules::check(&format!("{file}: {key}"), lamp, &rules)?;
    }
    Ok(())
}
