//! The key `stripes`: colors of consecutive yarns, as a list or as a tartan.

use crate::yarn::stripe::Stripe;
use crate::yarn::tartan::ThreadCount;
use plywave::Result;
use plywave::color::srgb_of_value;
use plywave::spec::rules::{Custom, invalid};
use toml::Value;

/// Largest number of yarns in a repeat of stripes.
pub(crate) const MAX_STRIPES: usize = 4096;
const HINT: &str =
    "use stripes such as [{ count = 12, color = \"#1a3380\" }, { count = 4, color = \"#e6e6e6\" }], 4096 yarns at most";

/// The rule of the key.
pub(crate) const STRIPES: Custom = Custom {
    expected: "stripes, each a count of yarns and a color, or the thread count of a tartan, such as \"R/32 K4 Y/2\"",
    check: |file, key, value| read(file, key, value).map(|_| ()),
};

/// Reads the value of a key `stripes`.
pub(crate) fn read(file: &str, key: &str, value: &Value) -> Result<Vec<Stripe>> {
    if let Value::String(text) = value {
        let count = text.parse::<ThreadCount>().map_err(|hint| invalid(file, key, value, hint))?;
        return Ok(count.stripes());
    }
    let one = |value: &Value| {
        let table = value.as_table().filter(|table| table.len() == 2)?;
        let count =
            usize::try_from(table.get("count")?.as_integer()?).ok().filter(|n| (1..=MAX_STRIPES).contains(n))?;
        Some(Stripe { count, color: srgb_of_value(table.get("color")?)? })
    };
    let all: Option<Vec<Stripe>> = value.as_array().and_then(|all| all.iter().map(one).collect());
    match all {
        Some(all) if (1..=MAX_STRIPES).contains(&all.iter().map(|stripe| stripe.count).sum()) => Ok(all),
        _ => Err(invalid(file, key, value, HINT)),
    }
}
