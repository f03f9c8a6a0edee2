//! docs/reference/spec.md agrees with the rules of the specs: the same keys, ranges and defaults on both
//! sides.

use plywave::fabric::{FABRIC_RULES, FabricSpec};
use plywave::spec::YARN_RULES;
use plywave::spec::rules::{Key, Kind, Need, Rules};
use plywave::spec::{POLYESTER, YarnSpec};
use std::collections::BTreeMap;

/// Map from section and name of a key to its range and default.
type Keys = BTreeMap<(String, String), (String, String)>;

/// Collects all keys of the rules: section, name, accepted values, whether the key is required.
fn keys_of(section: &str, path: &str, keys: &[Key], all: &mut Vec<(String, String, String, Need)>) {
    for key in keys {
        let dotted = if path.is_empty() { key.name.to_string() } else { format!("{path}.{}", key.name) };
        all.push((section.to_string(), key.name.to_string(), key.kind.expected(&dotted), key.need));
        match key.kind {
            Kind::Table(keys) => keys_of(&format!("`{dotted}`"), &dotted, keys, all),
            Kind::Tagged(_, variants) => {
                for (kind, keys) in variants {
                    keys_of(&format!("`{dotted}`, kind `{kind}`"), &dotted, keys, all);
                }
            }
            _ => {}
        }
    }
}

/// Titles of the tables and kinds, those without keys too.
fn sections_of(path: &str, keys: &[Key], all: &mut Vec<String>) {
    for key in keys {
        let dotted = if path.is_empty() { key.name.to_string() } else { format!("{path}.{}", key.name) };
        match key.kind {
            Kind::Table(keys) => {
                all.push(shared(&format!("`{dotted}`")));
                sections_of(&dotted, keys, all);
            }
            Kind::Tagged(_, variants) => {
                all.extend(variants.iter().map(|(kind, _)| shared(&format!("`{dotted}`, kind `{kind}`"))))
            }
            _ => {}
        }
    }
}

/// Warp and weft have one section, and so have the two kinds of fibers of a blend.
fn shared(section: &str) -> String {
    let section = section.replace("`blend.fiber", "`fiber");
    if section == "`warp`" || section == "`weft`" { "`warp`, `weft`".into() } else { section }
}

fn page() -> (Keys, Vec<String>) {
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/reference/spec.md")).unwrap();
    let (mut keys, mut sections, mut section) = (Keys::new(), Vec::new(), String::new());
    for line in text.lines() {
        if let Some(title) = line.strip_prefix("### ") {
            section = title.to_string();
            sections.push(section.clone());
        } else if let Some(row) = line.strip_prefix("| `") {
            let cells: Vec<&str> = row.split(" | ").collect();
            assert_eq!(cells.len(), 4, "{line}");
            assert!(cells[3].len() > 4, "{line}: no meaning");
            let name = cells[0].trim_end_matches('`').to_string();
            let new = keys.insert((section.clone(), name), (cells[1].to_string(), cells[2].to_string()));
            assert!(new.is_none(), "twice: {line}");
        }
    }
    (keys, sections)
}

#[test]
fn the_page_and_the_rules_have_the_same_keys() {
    let (mut keys, sections) = page();
    let root = |name: &str| format!("Root of the {name} spec");
    let mut all = Vec::new();
    keys_of(&root("yarn"), "", YARN_RULES.keys, &mut all);
    keys_of(&root("fabric"), "", FABRIC_RULES.keys, &mut all);
    assert!(all.len() > 70, "{}", all.len());
    let mut seen = BTreeMap::new();
    for (section, name, expected, need) in all {
        let at = (shared(&section), name.clone());
        let known = seen.insert(at.clone(), (expected.clone(), need));
        if let Some(before) = known {
            assert_eq!(before, (expected, need), "{at:?} differs between warp and weft");
            continue;
        }
        let (range, default) =
            keys.remove(&at).unwrap_or_else(|| panic!("docs/reference/spec.md lacks {name} under ### {}", at.0));
        assert_eq!(range, expected, "{at:?}");
        match need {
            Need::Required => assert_eq!(default, "required", "{at:?}"),
            // A default in TOML is the same on the page; one in words may be worded differently.
            Need::Default(toml) if is_toml(toml) => assert_eq!(default, format!("`{toml}`"), "{at:?}"),
            Need::Default(_) => assert_ne!(default, "required", "{at:?}"),
        }
    }
    assert!(keys.is_empty(), "docs/reference/spec.md has keys that the program does not know: {keys:?}");
    let mut known = vec![root("yarn"), root("fabric")];
    sections_of("", YARN_RULES.keys, &mut known);
    sections_of("", FABRIC_RULES.keys, &mut known);
    known.sort();
    known.dedup();
    let mut sections = sections;
    sections.sort();
    assert_eq!(sections, known);
}

fn is_toml(text: &str) -> bool {
    toml::from_str::<toml::Table>(&format!("x = {text}")).is_ok()
}

/// The rules' defaults are those of the types: a spec without the key has the value.
#[test]
fn defaults_are_those_of_the_program() {
    let yarn = POLYESTER.split("\n[").map(|part| part.to_string()).collect::<Vec<_>>();
    let bare =
        yarn.iter().filter(|p| !["yarn]", "beam]", "absorption]", "simulation]"].iter().any(|s| p.starts_with(s)));
    let bare = bare.cloned().collect::<Vec<_>>().join("\n[");
    let bare: String = bare
        .lines()
        .filter(|l| !["size_jitter", "shape_jitter", "min_gap", "handedness"].iter().any(|k| l.starts_with(k)))
        .map(|l| format!("{l}\n"))
        .collect();
    let yarn = toml::Table::try_from(YarnSpec::parse(&bare, "bare").unwrap()).unwrap();
    let family = "model = \"a.pwm\"\nspacing_um = 100.0\n";
    let fabric = format!("name = \"f\"\n[weave]\nkind = \"plain\"\n[warp]\n{family}[weft]\n{family}");
    let fabric = toml::Table::try_from(FabricSpec::parse(&fabric, "bare").unwrap()).unwrap();
    let count = compare(&yarn, &YARN_RULES) + compare(&fabric, &FABRIC_RULES);
    // Only defaults that are values: the default crimps of warp and weft are in words.
    assert_eq!(count, 14, "defaults compared");
}

fn compare(spec: &toml::Table, rules: &Rules) -> usize {
    let mut count = 0;
    for section in rules.keys {
        let (Kind::Table(keys), Some(values)) = (section.kind, spec.get(section.name)) else { continue };
        for key in keys {
            let Need::Default(default) = key.need else { continue };
            let Ok(mut want) = toml::from_str::<toml::Table>(&format!("x = {default}")) else { continue };
            assert_eq!(values.get(key.name), want.remove("x").as_ref(), "{}.{}", section.name, key.name);
            count += 1;
        }
    }
    count
}
