//! Keys of the language of before, each with the line that says how to write it now.

use plywave::Result;
use plywave::spec::rules::invalid;
use toml::{Table, Value};

/// Refuses a yarn with keys of before; `key` is its name.
pub(crate) fn check(file: &str, key: &str, yarn: &Table) -> Result<()> {
    let refuse = |name: &str, value: &Value, hint: String| Err(invalid(file, &format!("{key}.{name}"), value, hint));
    for (name, value) in yarn {
        let hint = match (name.as_str(), value) {
            ("count", Value::Table(units)) => {
                let (unit, number) = units
                    .iter()
                    .find(|(unit, _)| *unit != "filaments")
                    .map_or(("Ne", "40".into()), |(u, n)| (&**u, n.to_string()));
                let unit = match unit {
                    "ne" => "Ne",
                    "nm" => "Nm",
                    other => other,
                };
                let filaments = units.get("filaments").map(|n| format!(" f {n}")).unwrap_or_default();
                format!("write it as on a label: count = \"{number} {unit}{filaments}\"")
            }
            ("density_g_per_cm3", _) => {
                "write the fiber instead, such as fiber = \"cotton\" or \"wool 19.5 um\"; it has the density".into()
            }
            ("twist_per_m" | "handedness", _) => {
                let turns = yarn.get("twist_per_m").map_or("1000".into(), ToString::to_string);
                let hand = yarn.get("handedness").and_then(Value::as_str).unwrap_or("Z");
                let of = if yarn.get("plies").is_some() { "ply_twist" } else { "twist" };
                format!("write direction and turns in one key: {of} = \"{hand} {turns}/m\"")
            }
            ("ends_per_cm" | "picks_per_cm", _) => {
                format!("write it in the table of the weave: [weave] {name} = {value}")
            }
            ("srgb", _) => format!("write color = {value}"),
            _ => continue,
        };
        return refuse(name, value, hint);
    }
    Ok(())
}
