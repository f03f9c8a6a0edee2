//! Validation rules of TOML specs: the keys, their ranges, and the messages of errors.
//!
//! The validator walks the parsed TOML, not a typed spec, so every error is one line that names the file, the
//! dotted key, the value and the accepted values. [`Rules`] are static data. `docs/reference` lists the keys
//! of yarn and cloth specs, and a test compares that list with the rules.

use crate::{Error, Result};
use toml::{Table, Value};

/// The rules of one kind of file.
#[derive(Clone, Copy, Debug)]
pub struct Rules {
    /// Keys of the root.
    pub keys: &'static [Key],
    /// Units that the names of keys end in, longest first. For a key with another unit, the hint names the
    /// right one.
    pub units: &'static [&'static str],
    /// An example file, which the hint names if a text is not TOML.
    pub example: &'static str,
    /// Root keys of other kinds of files, and the hints for them.
    pub foreign: &'static [(&'static [&'static str], &'static str)],
}

/// The rule of one key.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Name of the key, including its unit.
    pub name: &'static str,
    /// Kind of its value.
    pub kind: KeyKind,
    /// Whether it is required.
    pub need: Need,
}

/// Whether a key is required.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// Required.
    Required,
    /// Optional. The text is the default value, as TOML, or the meaning of the key's absence.
    Default(&'static str),
}

/// A check of a value beyond the common kinds: the accepted values, and the check, which is called with the
/// file, the dotted key and the value.
#[derive(Clone, Copy, Debug)]
pub struct Custom {
    /// The accepted values, as in "use ...".
    pub expected: &'static str,
    /// The check.
    pub check: fn(&str, &str, &Value) -> Result<()>,
}

/// Kind of a key's value. Ranges are closed unless stated otherwise.
#[derive(Clone, Copy, Debug)]
pub enum KeyKind {
    /// A number in a range.
    Number(f64, f64),
    /// A number above the first bound and up to the second.
    Above(f64, f64),
    /// An integer in a range.
    Integer(i64, i64),
    /// An odd integer in a range.
    Odd(i64, i64),
    /// A text that is not empty.
    Text,
    /// One of several words.
    Choice(&'static [&'static str]),
    /// Up to 32 ascending numbers, of which the first is 0, the second at least 1e-6, and the last at most
    /// this.
    Ascending(f64),
    /// Two numbers in a range.
    Pair(f64, f64),
    /// A color in a form of [`crate::color::SRGB_FORMS`].
    Srgb,
    /// At least 3 and at most this many `[x, y]` pairs [um], with coordinates within the bound.
    Points(usize, f64),
    /// Texts by name, where each name is one capital letter.
    Letters,
    /// A table of further keys.
    Table(&'static [Key]),
    /// A table whose keys depend on its key `kind`: an example of such a table, and the keys of each kind.
    Tagged(&'static str, &'static [(&'static str, &'static [Key])]),
    /// Any other kind, with its own check.
    Custom(Custom),
}

/// A required key.
pub const fn required(name: &'static str, kind: KeyKind) -> Key {
    Key { name, kind, need: Need::Required }
}

/// An optional key, with its default.
pub const fn optional(name: &'static str, kind: KeyKind, default: &'static str) -> Key {
    Key { name, kind, need: Need::Default(default) }
}

impl KeyKind {
    /// The accepted values, as in "use ..."; `key` is the dotted key, which the text for tables contains.
    pub fn expected(&self, key: &str) -> String {
        match self {
            KeyKind::Number(min, max) => format!("a number from {min} to {max}"),
            KeyKind::Above(min, max) => format!("a number above {min} and up to {max}"),
            KeyKind::Integer(min, max) => format!("an integer from {min} to {max}"),
            KeyKind::Odd(min, max) => format!("an odd integer from {min} to {max}"),
            KeyKind::Text => "a text in quotes".into(),
            KeyKind::Choice(words) => format!("one of \"{}\"", words.join("\", \"")),
            KeyKind::Ascending(max) => {
                format!("1 to 32 ascending numbers, the first 0, the next 1e-6 or more, the last up to {max}")
            }
            KeyKind::Pair(min, max) => format!("two numbers from {min} to {max}"),
            KeyKind::Srgb => crate::color::SRGB_FORMS.into(),
            KeyKind::Points(count, max) => format!("3 to {count} pairs [x, y] within {max} um of the origin"),
            KeyKind::Letters => "a table of texts by capital letters, such as { A = \"a.pwm\", B = \"b.pwm\" }".into(),
            KeyKind::Table(_) => format!("a table, [{key}]"),
            KeyKind::Tagged(example, _) => format!("a table such as {example}"),
            KeyKind::Custom(custom) => custom.expected.into(),
        }
    }

    /// Whether a value is of this kind. Only [`check`] looks inside tables.
    fn holds(&self, value: &Value) -> bool {
        let within = |v: &Value, min: f64, max: f64| number(v).is_some_and(|x| (min..=max).contains(&x));
        let integer = |min: i64, max: i64| value.as_integer().filter(|i| (min..=max).contains(i));
        let list = || value.as_array().map_or(&[][..], Vec::as_slice);
        match self {
            KeyKind::Number(min, max) => within(value, *min, *max),
            KeyKind::Above(min, max) => within(value, *min, *max) && number(value) != Some(*min),
            KeyKind::Integer(min, max) => integer(*min, *max).is_some(),
            KeyKind::Odd(min, max) => integer(*min, *max).is_some_and(|i| i % 2 == 1),
            KeyKind::Text => text(value),
            KeyKind::Choice(words) => value.as_str().is_some_and(|s| words.contains(&s)),
            KeyKind::Ascending(max) => {
                let x: Vec<f64> = list().iter().filter_map(number).collect();
                (1..=32).contains(&list().len())
                    && x.len() == list().len()
                    && x[0] == 0.0
                    && x.get(1).is_none_or(|x| *x >= 1e-6)
                    && x.windows(2).all(|w| w[0] < w[1])
                    && x[x.len() - 1] <= *max
            }
            KeyKind::Pair(min, max) => list().len() == 2 && list().iter().all(|x| within(x, *min, *max)),
            KeyKind::Srgb => crate::color::srgb_of_value(value).is_some(),
            KeyKind::Points(count, max) => {
                let pair =
                    |v: &Value| v.as_array().is_some_and(|v| v.len() == 2 && v.iter().all(|x| within(x, -max, *max)));
                (3..=*count).contains(&list().len()) && list().iter().all(pair)
            }
            KeyKind::Letters => value.as_table().is_some_and(|table| {
                let letter = |name: &str| name.len() == 1 && name.as_bytes()[0].is_ascii_uppercase();
                !table.is_empty() && table.iter().all(|(name, value)| letter(name) && text(value))
            }),
            KeyKind::Table(_) | KeyKind::Tagged(..) => value.is_table(),
            KeyKind::Custom(_) => true,
        }
    }
}

/// Parses TOML and checks it by `rules`.
///
/// # Errors
/// [`Error::Format`] with the line number if the text is not TOML, and those of [`check`].
pub fn parse(text: &str, file: &str, rules: &Rules) -> Result<Table> {
    let table = read(text, file, rules)?;
    check(file, &table, rules)?;
    Ok(table)
}

/// Parses TOML without checking its keys.
///
/// # Errors
/// [`Error::Format`] with the line number if the text is not TOML.
pub fn read(text: &str, file: &str, rules: &Rules) -> Result<Table> {
    toml::from_str(text).map_err(|e| {
        let at = e.span().and_then(|span| text.as_bytes().get(..span.start)).map(|head| {
            let line = 1 + head.iter().filter(|&&byte| byte == b'\n').count();
            format!("line {line}: ")
        });
        format_error(file, at.unwrap_or_default() + e.message(), rules)
    })
}

/// Converts a table that passed [`check`] into a typed spec.
///
/// # Errors
/// [`Error::Format`] if the type is stricter than the rules.
pub fn typed<T: serde::de::DeserializeOwned>(table: Table, file: &str, rules: &Rules) -> Result<T> {
    table.try_into().map_err(|e: toml::de::Error| format_error(file, e.message().to_string(), rules))
}

/// Checks a typed spec by `rules`.
///
/// # Errors
/// Those of [`check`].
pub fn check_typed(spec: &impl serde::Serialize, file: &str, rules: &Rules) -> Result<()> {
    let table = Table::try_from(spec).map_err(|e| format_error(file, e.to_string(), rules))?;
    check(file, &table, rules)
}

/// Checks every key of `table`, and then that no required key is absent.
///
/// # Errors
/// [`Error::Invalid`] for a key that is unknown, absent or out of range.
pub fn check(file: &str, table: &Table, rules: &Rules) -> Result<()> {
    check_table(file, "", table, rules.keys, rules)
}

/// An error about the value of a key. Each part becomes one line.
pub fn invalid(file: &str, key: &str, value: impl std::fmt::Display, hint: impl Into<String>) -> Error {
    Error::Invalid { file: line(file), key: line(key), value: line(&value.to_string()), hint: hint.into() }
}

/// An error about the whole text.
fn format_error(file: &str, what: String, rules: &Rules) -> Error {
    let what = what.split_whitespace().collect::<Vec<_>>().join(" ");
    Error::Format { file: line(file), what, hint: format!("use TOML with the keys of {}", rules.example) }
}

/// Text as one line of at most 80 characters.
pub fn line(text: &str) -> String {
    crate::one_line(text, 80)
}

fn dotted(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_string() } else { format!("{path}.{key}") }
}

/// A finite TOML number, whole or not.
pub fn number(value: &Value) -> Option<f64> {
    let x = match value {
        Value::Float(x) => *x,
        Value::Integer(i) => *i as f64,
        _ => return None,
    };
    x.is_finite().then_some(x)
}

fn text(value: &Value) -> bool {
    value.as_str().is_some_and(|s| !s.trim().is_empty())
}

fn check_table(file: &str, path: &str, table: &Table, keys: &[Key], rules: &Rules) -> Result<()> {
    for (name, value) in table {
        let Some(key) = keys.iter().find(|key| key.name == name) else {
            return Err(invalid(file, &dotted(path, name), value, unknown(path, name, keys, rules)));
        };
        check_value(file, &dotted(path, name), value, &key.kind, rules)?;
    }
    match keys.iter().find(|key| key.need == Need::Required && !table.contains_key(key.name)) {
        None => Ok(()),
        Some(key) => Err(invalid(file, &dotted(path, key.name), "(absent)", "this key must be given")),
    }
}

/// Hint for an unknown key: a known key with another unit, another kind of file, or the list of all keys.
fn unknown(path: &str, name: &str, keys: &[Key], rules: &Rules) -> String {
    for key in keys {
        let Some(stem) = rules.units.iter().find_map(|unit| key.name.strip_suffix(unit)) else { continue };
        if name == stem || name.strip_prefix(stem).is_some_and(|rest| rest.starts_with('_')) {
            return format!("unknown unit: use {}", key.name);
        }
    }
    if let Some((_, hint)) = rules.foreign.iter().find(|(names, _)| path.is_empty() && names.contains(&name)) {
        return (*hint).to_string();
    }
    let names: Vec<&str> = keys.iter().map(|key| key.name).collect();
    if names.is_empty() {
        return "unknown key: this kind has none".into();
    }
    format!("unknown key: use one of {}", names.join(", "))
}

fn check_value(file: &str, key: &str, value: &Value, kind: &KeyKind, rules: &Rules) -> Result<()> {
    if !kind.holds(value) {
        return Err(invalid(file, key, value, format!("use {}", kind.expected(key))));
    }
    match (kind, value) {
        (KeyKind::Table(keys), Value::Table(table)) => check_table(file, key, table, keys, rules),
        (KeyKind::Tagged(_, variants), Value::Table(table)) => {
            let names: Vec<&str> = variants.iter().map(|(name, _)| *name).collect();
            let tag = dotted(key, "kind");
            let hint = || format!("use one of \"{}\"", names.join("\", \""));
            let tag_value = table.get("kind").ok_or_else(|| invalid(file, &tag, "(absent)", hint()))?;
            let Some((_, keys)) = variants.iter().find(|(name, _)| tag_value.as_str() == Some(name)) else {
                return Err(invalid(file, &tag, tag_value, hint()));
            };
            let mut rest = table.clone();
            rest.remove("kind");
            check_table(file, key, &rest, keys, rules)
        }
        (KeyKind::Custom(custom), _) => (custom.check)(file, key, value),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULES: Rules = Rules {
        keys: &[
            required("name", KeyKind::Text),
            optional("size_um", KeyKind::Number(0.5, 2.0), "1.0"),
            optional("odd", KeyKind::Odd(3, 9), "3"),
            optional("letters", KeyKind::Letters, "none"),
            optional("srgb", KeyKind::Srgb, "clear"),
            optional("sub", KeyKind::Table(&[required("above", KeyKind::Above(1.0, 4.0))]), "none"),
            optional(
                "tagged",
                KeyKind::Tagged("{ kind = \"a\" }", &[("a", &[]), ("b", &[required("n", KeyKind::Integer(1, 5))])]),
                "none",
            ),
        ],
        units: &["_um"],
        example: "some/file.toml",
        foreign: &[(&["ply"], "a key of another file")],
    };

    #[test]
    fn refusals_name_file_key_value_and_hint() {
        for (text, expected) in [
            ("name = \"x\"\nsize_um = 3", "f.toml: size_um = 3: use a number from 0.5 to 2"),
            ("name = \"x\"\nsize_um = nan", "f.toml: size_um = nan: use a number from 0.5 to 2"),
            ("name = \"x\"\nsize_mm = 1", "f.toml: size_mm = 1: unknown unit: use size_um"),
            ("name = \"x\"\nsize = 1", "f.toml: size = 1: unknown unit: use size_um"),
            ("name = \"x\"\nply = 1", "f.toml: ply = 1: a key of another file"),
            ("odd = 3", "f.toml: name = (absent): this key must be given"),
            ("name = \" \"", "f.toml: name = \" \": use a text in quotes"),
            ("name = \"x\"\nodd = 4", "f.toml: odd = 4: use an odd integer from 3 to 9"),
            ("name = \"x\"\nletters = { a = \"b\" }", "letters = { a = \"b\" }: use a table of texts by capital"),
            ("name = \"x\"\nletters = {}", "letters = {}: use a table of texts"),
            ("name = \"x\"\nsrgb = [0, 1]", "srgb = [0, 1]: use three numbers"),
            ("name = \"x\"\nsub = { above = 1 }", "sub.above = 1: use a number above 1 and up to 4"),
            ("name = \"x\"\nsub = 1", "sub = 1: use a table, [sub]"),
            ("name = \"x\"\ntagged = { kind = \"c\" }", "tagged.kind = \"c\": use one of \"a\", \"b\""),
            ("name = \"x\"\ntagged = { kind = \"a\", n = 1 }", "tagged.n = 1: unknown key: this kind has none"),
            ("name = \"x\"\ntagged = { kind = \"b\" }", "tagged.n = (absent): this key must be given"),
            ("name = \"x\"\n\nsize_um = [", "f.toml: line 3: "),
        ] {
            let message = parse(text, "f.toml", &RULES).unwrap_err().to_string();
            assert!(message.contains(expected), "got {message}\nwant {expected}");
            assert_eq!(message.lines().count(), 1, "{message}");
        }
        let good = "name = \"x\"\nsize_um = 2\nodd = 9\nletters = { A = \"a\", Z = \"z\" }\nsrgb = [0, 0.5, 1]\nsub = { above = 4 }\n";
        parse(&format!("{good}tagged = {{ kind = \"b\", n = 5 }}"), "f.toml", &RULES).unwrap();
        let message = parse("[", "f.toml", &RULES).unwrap_err().to_string();
        assert!(message.ends_with("use TOML with the keys of some/file.toml"), "{message}");
    }
}
