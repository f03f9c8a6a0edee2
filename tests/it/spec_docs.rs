//! docs/reference/spec.md and cloth_spec.md agree with the rules of the specs: the same keys, ranges and
//! defaults on both sides.

use plywave::cloth::{CLOTH_RULES, ClothSpec};
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

/// The two kinds of fibers of a blend have one section.
fn shared(section: &str) -> String {
    section.replace("`blend.fiber", "`fiber")
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
    compare_page("spec.md", ("yarn", &YARN_RULES), 60, &shared);
    // The yarn of a knit has the keys of warp and weft, its section is theirs.
    let shared_cloth = |section: &str| {
        let section = section.replace("`warp", "`yarn").replace("`weft", "`yarn");
        if section.contains("knit`, kind") && !section.contains("rib") && !section.contains("grid") {
            return "`knit`, other kinds".into();
        }
        section
    };
    compare_page("cloth_spec.md", ("cloth", &CLOTH_RULES), 40, &shared_cloth);
}

/// A page has the keys of these rules, each at least once, and no other. `shared` names the section of
/// several with the same keys.
fn compare_page(name: &str, (kind, rules): (&str, &Rules), least: usize, shared: &dyn Fn(&str) -> String) {
    let root = format!("Root of the {kind} spec");
    let (mut keys, mut sections) = page(name);
    let mut all = Vec::new();
    keys_of(&root, "", rules.keys, &mut all);
    assert!(all.len() > least, "{}", all.len());
    let mut seen = BTreeMap::new();
    for (section, key, expected, need) in all {
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
    let mut titles = Vec::new();
    sections_of("", rules.keys, &mut titles);
    let mut known: Vec<String> = [root].into_iter().chain(titles.iter().map(|title| shared(title))).collect();
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
    // Only defaults that are values, not those in words.
    assert_eq!(compare(&yarn, &YARN_RULES), 10, "defaults of a yarn");
    let yarn = "count = { tex = 20.0 }\ndensity_g_per_cm3 = 1.5\n";
    let knit = "kind = \"jersey\"\nwales_per_cm = 14.0\ncourses_per_cm = 20.0\nloop_mm = 2.7\n";
    let cloth = format!("name = \"c\"\n[knit]\n{knit}[yarn]\n{yarn}");
    let cloth = toml::Table::try_from(ClothSpec::parse(&cloth, "bare").unwrap()).unwrap();
    assert_eq!(compare(&cloth, &CLOTH_RULES), 9, "defaults of a cloth");
}

fn compare(spec: &toml::Table, rules: &Rules) -> usize {
    let values = |section: &Key| match section.kind {
        Kind::Table(keys) => Some((keys, spec.get(section.name)?.as_table()?)),
        _ => None,
    };
    let mut count = 0;
    for (keys, values) in rules.keys.iter().filter_map(values).chain([(rules.keys, spec)]) {
        for key in keys {
            let Need::Default(default) = key.need else { continue };
            let Ok(mut want) = toml::from_str::<toml::Table>(&format!("x = {default}")) else { continue };
            assert_eq!(values.get(key.name), want.remove("x").as_ref(), "{}", key.name);
            count += 1;
        }
    }
    count
}
