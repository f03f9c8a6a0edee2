//! Keys of a yarn in a spec, with their ranges.

use crate::yarn::count::Count;
use crate::yarn::fibers;
use crate::yarn::finish::Finish;
use crate::yarn::stripes::STRIPES;
use crate::yarn::twist::YarnTwist;
use plywave::gap::SLIT_MAX_UM;
use plywave::spec::rules::{Custom, Key, KeyKind, invalid, optional, required};
use toml::Value;

/// Keys of a yarn.
pub(crate) const YARN: &[Key] = &[
    optional("as", KeyKind::Choice(&["warp", "weft"]), "every key of its own"),
    required("fiber", KeyKind::Custom(fibers::RULE)),
    required("count", KeyKind::Custom(COUNT)),
    optional("twist", KeyKind::Custom(TWIST), "usual for the fiber; filaments: none"),
    optional("plies", KeyKind::Integer(1, 7), "the count's, 1"),
    optional("ply_twist", KeyKind::Custom(TWIST), "balances the singles"),
    optional("finish", KeyKind::Custom(FINISH), "even, without hairs"),
    optional("color", KeyKind::Custom(COLOR), "clear fibers"),
    optional("stripes", KeyKind::Custom(STRIPES), "one color"),
    optional("bundles", KeyKind::Integer(1, 19), "7 for close single yarns of a weave"),
    optional("fibers", KeyKind::Integer(1, 200), "by count and fiber"),
    optional("packing", KeyKind::Number(0.1, 0.9), "usual for the fiber"),
    optional("diameter_um", KeyKind::Number(1.0, 1e4), "by count and packing"),
    optional("model", KeyKind::Text, "found or built"),
    optional("tension", KeyKind::Number(0.01, 100.0), "1.0"),
    optional("crimp_percent", KeyKind::Number(0.0, 200.0), "by tension"),
    optional("stiffness", KeyKind::Number(0.0, 100.0), "0.5"),
    optional("cohesion", KeyKind::Number(0.0, 100.0), "0.02"),
    optional("count_cv", KeyKind::Number(0.0, 0.5), "by finish"),
    optional("spacing_cv", KeyKind::Number(0.0, 0.15), "by finish"),
    optional("uneven_mm", KeyKind::Number(0.1, 1e4), "by finish; 10"),
    optional("sigma_per_um", KeyKind::Number(0.0, 10.0), "color"),
    optional("slit_um", KeyKind::Above(0.0, SLIT_MAX_UM as f64), "no slits"),
    optional("slit_share", KeyKind::Number(0.0, 1.0), "a quarter, with slit_um"),
    optional("hairs", KeyKind::Table(HAIRS), "by finish"),
];

const HAIRS: &[Key] = &[
    required("per_mm", KeyKind::Number(0.0, 100.0)),
    required("length_mm", KeyKind::Number(0.02, 10.0)),
    optional("curl_mm", KeyKind::Number(0.05, 100.0), "0.5"),
    optional("rise", KeyKind::Number(0.05, 0.95), "0.5"),
    optional("loops", KeyKind::Number(0.0, 1.0), "0.0"),
];

const COUNT: Custom = Custom {
    expected: "a count such as \"Ne 40\", \"Nm 60/2\", \"20 tex x 2\" or \"75/36 den\"",
    check: |file, key, value| of_text::<Count>(file, key, value, "\"Ne 40\""),
};
const TWIST: Custom = Custom {
    expected: "a twist such as \"Z 1000/m\", \"S 12/inch\", \"Z alpha_e 4\" or \"none\"",
    check: |file, key, value| of_text::<YarnTwist>(file, key, value, "\"Z 1000/m\""),
};
const FINISH: Custom = Custom {
    expected: "carded, combed, worsted or wet-spun, raised or milled, separated by a comma",
    check: |file, key, value| match value.as_str() {
        Some(text) => Finish::parse(text).map(|_| ()).map_err(|hint| invalid(file, key, value, hint)),
        None => Err(invalid(file, key, value, "use a text in quotes, such as \"combed\"")),
    },
};

const COLOR: Custom = Custom {
    expected: "three numbers from 0 to 1, or three whole numbers up to 255, red, green and blue, or \"#rrggbb\" or \"#rgb\", or \"undyed\"",
    check: |file, key, value| match value.as_str() == Some(UNDYED) || plywave::color::srgb_of_value(value).is_some() {
        true => Ok(()),
        false => Err(invalid(file, key, value, format!("use {}", COLOR.expected))),
    },
};
/// The color of natural fibers without dye.
pub(crate) const UNDYED: &str = "undyed";

fn of_text<T: std::str::FromStr<Err = String>>(
    file: &str,
    key: &str,
    value: &Value,
    example: &str,
) -> plywave::Result<()> {
    match value.as_str() {
        Some(text) => text.parse::<T>().map(|_| ()).map_err(|hint| invalid(file, key, value, hint)),
        None => Err(invalid(file, key, value, format!("use a text in quotes, such as {example}"))),
    }
}
