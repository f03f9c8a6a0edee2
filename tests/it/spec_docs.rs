//! docs/reference/spec.md and cloth_spec.md agree with the rules of the specs: the same keys, ranges and
//! defaults on both sides.

use plywave::cloth::{CLOTH_RULES, ClothSpec};
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

/// Keys and sections of a page of docs/reference.
fn page(name: &str) -> (Keys, Vec<String>) {
    let text = std::fs::read_to_string(format!("{}/docs/reference/{name}", env!("CARGO_MANIFEST_DIR"))).unwrap();
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
    compare_page("spec.md", &[("yarn", &YARN_RULES), ("fabric", &FABRIC_RULES)], 70, &shared);
    // The yarn of a knit has the keys of warp and weft, its section is theirs; so are the weaves of fabrics.
    let shared_cloth = |section: &str| {
        let section = section.replace("warp", "yarn").replace("weft", "yarn").replace("`yarn`, `yarn`", "`yarn`");
        if section.contains("knit`, kind") && !section.contains("rib") && !section.contains("grid") {
            return "`knit`, other kinds".into();
        }
        section
    };
    compare_page("cloth_spec.md", &[("cloth", &CLOTH_RULES)], 40, &shared_cloth);
}

/// A page has the keys of these rules, each at least once, and no other. `shared` names the section of
/// several with the same keys.
fn compare_page(name: &str, rules: &[(&str, &Rules)], least: usize, shared: &dyn Fn(&str) -> String) {
    let root = |name: &str| format!("Root of the {name} spec");
    let (mut keys, mut sections) = page(name);
    let mut all = Vec::new();
    rules.iter().for_each(|(kind, rules)| keys_of(&root(kind), "", rules.keys, &mut all));
    assert!(all.len() > least, "{}", all.len());
    let mut seen = BTreeMap::new();
    for (section, key, expected, need) in all {
        // Weaves are those of fabric specs, which the page of these has.
        if name == "cloth_spec.md" && section.starts_with("`weave`") {
            continue;
        }
        let at = (shared(&section), key.clone());
        let expected = if name == "cloth_spec.md" {
            expected.replace("[warp.", "[yarn.").replace("[weft.", "[yarn.")
        } else {
            expected
        };
        let known = seen.insert(at.clone(), (expected.clone(), need));
        if let Some(before) = known {
            assert_eq!(before, (expected, need), "{at:?} differs between sections");
            continue;
        }
        let (range, default) =
            keys.remove(&at).unwrap_or_else(|| panic!("docs/reference/{name} lacks {key} under ### {}", at.0));
        assert_eq!(range, expected, "{at:?}");
        match need {
            Need::Required => assert_eq!(default, "required", "{at:?}"),
            // A default in TOML is the same on the page; one in words may be worded differently.
            Need::Default(toml) if is_toml(toml) => assert_eq!(default, format!("`{toml}`"), "{at:?}"),
            Need::Default(_) => assert_ne!(default, "required", "{at:?}"),
        }
    }
    assert!(keys.is_empty(), "docs/reference/{name} has keys that the program does not know: {keys:?}");
    let mut known: Vec<String> = rules.iter().map(|(kind, _)| root(kind)).collect();
    let mut titles = Vec::new();
    rules.iter().for_each(|(_, rules)| sections_of("", rules.keys, &mut titles));
    known.extend(titles.iter().map(|title| shared(title)));
    if name == "cloth_spec.md" {
        known.retain(|title| !title.starts_with("`weave`"));
    }
    for list in [&mut known, &mut sections] {
        list.sort();
        list.dedup();
    }
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
    let yarn = "count = { tex = 20.0 }\ndensity_g_per_cm3 = 1.5\n";
    let knit = "kind = \"jersey\"\nwales_per_cm = 14.0\ncourses_per_cm = 20.0\nloop_mm = 2.7\n";
    let cloth = format!("name = \"c\"\n[knit]\n{knit}[yarn]\n{yarn}");
    let cloth = toml::Table::try_from(ClothSpec::parse(&cloth, "bare").unwrap()).unwrap();
    assert_eq!(compare(&cloth, &CLOTH_RULES), 8, "defaults of a cloth");
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
