//! Pages of docs/reference with tables of keys, compared with the rules of specs: the same keys, ranges and
//! defaults on both sides.

use plywave::spec::rules::{Key, KeyKind, Need, Rules};
use std::collections::BTreeMap;

/// Map from section and name of a key to its range and default.
type Keys = BTreeMap<(String, String), (String, String)>;

/// Collects all keys of the rules: section, name, accepted values, whether the key is required.
fn keys_of(section: &str, path: &str, keys: &[Key], all: &mut Vec<(String, String, String, Need)>) {
    for key in keys {
        let dotted = if path.is_empty() { key.name.to_string() } else { format!("{path}.{}", key.name) };
        all.push((section.to_string(), key.name.to_string(), key.kind.expected(&dotted), key.need));
        match key.kind {
            KeyKind::Table(keys) => keys_of(&format!("`{dotted}`"), &dotted, keys, all),
            KeyKind::Tagged(_, variants) => {
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
            KeyKind::Table(keys) => {
                all.push(shared(&format!("`{dotted}`")));
                sections_of(&dotted, keys, all);
            }
            KeyKind::Tagged(_, variants) => {
                all.extend(variants.iter().map(|(kind, _)| shared(&format!("`{dotted}`, kind `{kind}`"))))
            }
            _ => {}
        }
    }
}

/// The two kinds of fibers of a blend have one section.
pub fn shared(section: &str) -> String {
    section.replace("`blend.fiber", "`fiber")
}

/// Keys and sections of a page.
fn page(path: &str) -> (Keys, Vec<String>) {
    let text = std::fs::read_to_string(path).unwrap();
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

/// A page has the keys of these rules, each at least once, and no other. `shared` names the section of
/// several with the same keys, and texts of keys with it.
pub fn compare_page(path: &str, (kind, rules): (&str, &Rules), least: usize, shared: &dyn Fn(&str) -> String) {
    let root = format!("Root of the {kind} spec");
    let (mut keys, mut sections) = page(path);
    let mut all = Vec::new();
    keys_of(&root, "", rules.keys, &mut all);
    assert!(all.len() > least, "{}", all.len());
    let mut seen = BTreeMap::new();
    for (section, key, expected, need) in all {
        let at = (shared(&section), key.clone());
        let expected = expected.replace("[warp.", "[yarn.").replace("[weft.", "[yarn.");
        let known = seen.insert(at.clone(), (expected.clone(), need));
        if let Some(before) = known {
            assert_eq!(before, (expected, need), "{at:?} differs between sections");
            continue;
        }
        let (range, default) = keys.remove(&at).unwrap_or_else(|| panic!("{path} lacks {key} under ### {}", at.0));
        assert_eq!(range, expected, "{at:?}");
        match need {
            Need::Required => assert_eq!(default, "required", "{at:?}"),
            // A default in TOML is the same on the page; one in words may be worded differently.
            Need::Default(toml) if is_toml(toml) => assert_eq!(default, format!("`{toml}`"), "{at:?}"),
            Need::Default(_) => assert_ne!(default, "required", "{at:?}"),
        }
    }
    assert!(keys.is_empty(), "{path} has keys that the program does not know: {keys:?}");
    let mut titles = Vec::new();
    sections_of("", rules.keys, &mut titles);
    let mut known: Vec<String> = [root].into_iter().chain(titles.iter().map(|title| shared(title))).collect();
    for list in [&mut known, &mut sections] {
        list.sort();
        list.dedup();
    }
    assert_eq!(sections, known);
}

/// Whether a default is a value, not words.
pub fn is_toml(text: &str) -> bool {
    toml::from_str::<toml::Table>(&format!("x = {text}")).is_ok()
}
