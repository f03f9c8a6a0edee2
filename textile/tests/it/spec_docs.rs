//! docs/reference/cloth_spec.md agrees with the rules of cloth specs: the same keys, ranges and defaults on
//! both sides, and the defaults are those of the program.

use crate::spec_page::{compare_page, is_toml};
use plywave::spec::rules::{Key, KeyKind, Need};
use plywave_textile::{CLOTH_RULES, ClothSpec};

#[test]
fn the_page_and_the_rules_have_the_same_keys() {
    // The yarn of a knit has the keys of warp and weft, its section is theirs.
    let shared = |section: &str| {
        let section = section.replace("`warp", "`yarn").replace("`weft", "`yarn");
        if section.contains("knit`, kind") && !section.contains("rib") && !section.contains("chart") {
            return "`knit`, other kinds".into();
        }
        section
    };
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/reference/cloth_spec.md");
    compare_page(page, ("cloth", &CLOTH_RULES), 40, &shared);
}

const YARN: &str = "[yarn]\nfiber = \"cotton\"\ncount = \"20 tex\"\n";
const SIZES: &str = "wales_per_cm = 14\ncourses_per_cm = 20\nloop_mm = 2.7\n";

/// A spec in which a table can have one more key.
fn spec_with(table: &str, key: &str) -> ClothSpec {
    let at = |name: &str| if table == name { key } else { "" };
    let made = match table {
        "curves" => format!("[curves]\nfile = \"x.toml\"\n{key}\n"),
        _ => format!("[knit]\nkind = \"jersey\"\n{SIZES}"),
    };
    let hairs = format!("[yarn.hairs]\nper_mm = 3\nlength_mm = 1\n{}\n", at("hairs"));
    let text = format!("name = \"c\"\n{}\n{made}{YARN}{}\n{hairs}", at(""), at("yarn"));
    ClothSpec::parse(&text, "c.toml").unwrap_or_else(|e| panic!("{e}\n{text}"))
}

/// A spec with a key that has its default, as the rules tell it, is the spec without the key.
#[test]
fn defaults_are_those_of_the_program() {
    let table = |keys: &'static [Key], name: &str| -> &'static [Key] {
        let found = keys.iter().find(|key| key.name == name).unwrap();
        match found.kind {
            KeyKind::Table(keys) => keys,
            _ => panic!("{name} is no table"),
        }
    };
    let (root, yarn) = (CLOTH_RULES.keys, table(CLOTH_RULES.keys, "yarn"));
    let tables = [("", root), ("yarn", yarn), ("hairs", table(yarn, "hairs")), ("curves", table(root, "curves"))];
    let mut count = 0;
    for (name, keys) in tables {
        for key in keys {
            // Only defaults that are values, not those in words.
            let Need::Default(default) = key.need else { continue };
            if !is_toml(default) {
                continue;
            }
            assert_eq!(spec_with(name, &format!("{} = {default}", key.name)), spec_with(name, ""), "{}", key.name);
            count += 1;
        }
    }
    assert_eq!(count, 8, "defaults of a cloth");
}
