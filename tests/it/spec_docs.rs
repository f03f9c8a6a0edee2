//! docs/reference/spec.md agrees with the rules of yarn specs: the same keys, ranges and defaults on both
//! sides. textile/tests/it/spec_docs.rs has the page of cloth specs.

use crate::spec_page::{compare_page, shared};
use plywave::spec::YARN_RULES;
use plywave::spec::rules::{Key, KeyKind, Need, Rules};
use plywave::spec::{POLYESTER, YarnSpec};

#[test]
fn the_page_and_the_rules_have_the_same_keys() {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/docs/reference/spec.md");
    compare_page(page, ("yarn", &YARN_RULES), 60, &shared);
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
}

fn compare(spec: &toml::Table, rules: &Rules) -> usize {
    let values = |section: &Key| match section.kind {
        KeyKind::Table(keys) => Some((keys, spec.get(section.name)?.as_table()?)),
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
