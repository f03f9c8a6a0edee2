//! The text of a WIF: encodings and line ends, sections and keys, and values as programs write them.
//!
//! The crate `configparser` parses the INI syntax. Section and key names are case-insensitive; `;` begins a
//! comment. Text after a number is a comment even without `;` (WIF 1.1, "Comments"), and values may be
//! quoted.

use super::note::{Notes, WifNoteKind};
use crate::weave::names::numbered;
use configparser::ini::IniDefault;
use plywave::spec::rules::line;
use plywave::{Error, Result};
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};

/// Decodes the bytes and converts all line ends to line feeds. A byte order mark determines the encoding;
/// characters of other alphabets, in names and notes of old files, are harmless.
fn decode<'a>(bytes: &'a [u8], notes: &mut Notes) -> Cow<'a, str> {
    // Latin text in UTF-16 has a zero in every pair of bytes.
    let head = &bytes[..bytes.len().min(256)];
    let zeros = |at: usize| head.iter().skip(at).step_by(2).filter(|b| **b == 0).count() * 4 > head.len();
    let wide: Option<fn([u8; 2]) -> u16> = match bytes {
        [0xff, 0xfe, ..] => Some(u16::from_le_bytes),
        [0xfe, 0xff, ..] => Some(u16::from_be_bytes),
        _ if zeros(1) => Some(u16::from_le_bytes),
        _ if zeros(0) => Some(u16::from_be_bytes),
        _ => None,
    };
    let text: Cow<'a, str> = match wide {
        None => String::from_utf8_lossy(bytes),
        Some(unit) => {
            if !matches!(bytes, [0xff, 0xfe, ..] | [0xfe, 0xff, ..]) {
                notes.add(WifNoteKind::Encoding, "no byte order mark: read as UTF-16 all the same".into());
            }
            let (pairs, _) = bytes.as_chunks::<2>();
            // Zeros that remain from UTF-32 are dropped.
            let units = pairs.iter().map(|pair| unit(*pair)).filter(|u| *u != 0);
            char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect::<String>().into()
        }
    };
    let text = match text.strip_prefix('\u{feff}') {
        Some(rest) => Cow::Owned(rest.to_string()),
        None => text,
    };
    if text.contains('\r') { text.replace("\r\n", "\n").replace('\r', "\n").into() } else { text }
}

/// Normalizes the name of a section or key: capitals, with single spaces between words.
fn name_of(value: &str) -> String {
    value.split_whitespace().collect::<Vec<_>>().join(" ").to_ascii_uppercase()
}

/// A value without its quotes.
fn bare(value: &str) -> &str {
    value.trim_matches(|c: char| c == '"' || c == '\'' || c.is_whitespace())
}

/// Sections and their keys, both normalized by [`name_of`], with values from [`bare`].
pub(crate) struct Ini<'a> {
    file: &'a str,
    sections: HashMap<String, HashMap<String, String>>,
}

impl<'a> Ini<'a> {
    pub fn read(bytes: &[u8], file: &'a str, notes: &mut Notes) -> Result<Ini<'a>> {
        let mut syntax = IniDefault::default();
        (syntax.comment_symbols, syntax.delimiters) = (vec![';'], vec!['=']);
        let parsed = configparser::ini::Ini::new_from_defaults(syntax).read(decode(bytes, notes).into_owned());
        let parsed = parsed.map_err(|what| Error::Format {
            file: line(file),
            what: line(&what),
            hint: "write sections as [NAME] and keys as name=value".into(),
        })?;
        let mut sections: HashMap<String, HashMap<String, String>> = HashMap::new();
        for (name, keys) in parsed {
            let keys = keys.into_iter().filter_map(|(key, value)| Some((name_of(&key), bare(&value?).to_string())));
            // An empty value counts as absent.
            sections.entry(name_of(&name)).or_default().extend(keys.filter(|(_, value)| !value.is_empty()));
        }
        if !sections.contains_key("WIF") {
            let hint = "use a Weaving Information File, which begins with the section [WIF]".into();
            return Err(Error::Format { file: line(file), what: "no section [WIF]".into(), hint });
        }
        Ok(Ini { file, sections })
    }

    pub fn has(&self, section: &str) -> bool {
        self.sections.contains_key(section)
    }

    /// The value of a key.
    pub fn text(&self, section: &str, key: &str) -> Option<&str> {
        self.sections.get(section)?.get(&key.to_ascii_uppercase()).map(String::as_str)
    }

    /// An error for the value of a key.
    pub fn invalid(&self, section: &str, key: &str, value: impl std::fmt::Display, hint: String) -> Error {
        let key = line(&format!("[{section}] {key}"));
        Error::Invalid { file: line(self.file), key, value: line(&value.to_string()), hint }
    }

    /// A number from 1 to `max`; `None` if the key is absent or 0, which means none.
    pub fn count(&self, section: &str, key: &str, max: usize) -> Result<Option<usize>> {
        let Some(value) = self.text(section, key) else { return Ok(None) };
        match numbers(value).as_deref() {
            Some([0]) => Ok(None),
            Some([n]) if *n <= max as u64 => Ok(Some(*n as usize)),
            _ => Err(self.invalid(section, key, value, format!("use a whole number from 1 to {max}"))),
        }
    }

    /// The boolean value of a key; `None` if it is absent.
    pub fn truth(&self, section: &str, key: &str) -> Result<Option<bool>> {
        let Some(value) = self.text(section, key) else { return Ok(None) };
        let word = value.split_whitespace().next().unwrap_or_default().to_ascii_lowercase();
        match word.as_str() {
            "true" | "yes" | "on" | "1" | "t" | "y" | "-1" => Ok(Some(true)),
            "false" | "no" | "off" | "0" | "f" | "n" => Ok(Some(false)),
            _ => Err(self.invalid(section, key, value, "use true or false".into())),
        }
    }

    /// Numbered lines of a section, each with a list of whole numbers; empty if the section is absent. Lines
    /// whose key is not a number are left out.
    pub fn rows(&self, section: &'static str, notes: &mut Notes) -> Result<Rows> {
        let mut rows = Rows { section, lines: BTreeMap::new() };
        for (number, value) in self.lines(section, notes) {
            let Some(list) = numbers(value) else {
                let hint = "use whole numbers with commas between them".into();
                return Err(self.invalid(section, &number.to_string(), value, hint));
            };
            rows.lines.insert(number, list);
        }
        Ok(rows)
    }

    /// As [`Ini::rows`], for shafts or treadles: numbers from 1 to `max`. The number 0 means none; it is left
    /// out, and so are lines without other numbers. `of` tells what is numbered and, if known, how many there
    /// are: lines with that many ones and zeros name the positions of the ones.
    pub fn loom_rows(&self, section: &'static str, max: usize, of: Loom, notes: &mut Notes) -> Result<Rows> {
        let bits = of.count.and_then(|count| bits(&self.lines(section, notes), count));
        let mut rows = match bits {
            Some(lines) => {
                let (first, list) = lines.first_key_value().map_or((0, &[][..]), |(n, list)| (*n, list));
                let value = line(self.text(section, &first.to_string()).unwrap_or_default());
                let numbers: Vec<String> = list.iter().map(u64::to_string).collect();
                let numbers = if numbers.is_empty() { "none".into() } else { numbers.join(",") };
                let finding = format!(
                    "[{section}] has a one or a zero for each {}, the first on the left: {first} = {value} is taken for {numbers}",
                    of.name
                );
                notes.add(WifNoteKind::Bits, finding);
                Rows { section, lines }
            }
            None => self.rows(section, notes)?,
        };
        for (number, list) in &mut rows.lines {
            list.retain(|n| *n != 0);
            if list.iter().any(|n| *n > max as u64) {
                return Err(self.beyond(section, *number, list, of.name, of.count.unwrap_or(max)));
            }
        }
        rows.lines.retain(|_, list| !list.is_empty());
        Ok(rows)
    }

    /// An error for a line with a number that the loom does not have.
    pub fn beyond(&self, section: &str, line: usize, list: &[u64], name: &str, count: usize) -> Error {
        let value = self.text(section, &line.to_string()).unwrap_or("(too large)");
        let greatest = list.iter().max().copied().unwrap_or(0);
        let hint = format!("{name} {greatest} of a loom of {count}; {name}s are numbers with commas, such as 1,2");
        self.invalid(section, &line.to_string(), value, hint)
    }

    /// Positive numbers by the numbered lines of a section; other lines are left out.
    pub fn reals(&self, section: &'static str, notes: &mut Notes) -> BTreeMap<usize, f64> {
        self.lines(section, notes).into_iter().filter_map(|(number, value)| Some((number, real(value)?))).collect()
    }

    /// Numbered lines of a section in order, so that the same file always gives the same message.
    fn lines(&self, section: &'static str, notes: &mut Notes) -> BTreeMap<usize, &str> {
        let mut lines = BTreeMap::new();
        for (key, value) in self.sections.get(section).into_iter().flatten() {
            match key.parse::<usize>() {
                Ok(number) => {
                    lines.insert(number, value.as_str());
                }
                Err(_) => notes.add(
                    WifNoteKind::SpareLines,
                    format!("[{section}] has lines whose key is no number; they are left out"),
                ),
            }
        }
        lines
    }
}

/// What the lists of a section number, shafts or treadles, and how many there are.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Loom {
    pub name: &'static str,
    pub count: Option<usize>,
}

/// Converts lines with a one or a zero for each of `count` to lists of numbers: `1100`, `1,1,0,0` or
/// `1 1 0 0` give 1 and 2. `None` if the lines are valid lists of numbers: no number is above `count`, and
/// none is repeated or follows a zero.
fn bits(lines: &BTreeMap<usize, &str>, count: usize) -> Option<BTreeMap<usize, Vec<u64>>> {
    let row = |value: &str| -> Option<Vec<bool>> {
        let is_bit = |c: char| c == '0' || c == '1';
        let digits: Vec<char> = value.chars().filter(|c| !(c.is_whitespace() || *c == ',')).collect();
        let is_packed = digits.len() == value.len();
        // Separators enclose one digit each.
        let is_spread = value.split([',', ' ', '\t']).all(|word| word.trim().len() <= 1);
        let fits = digits.len() == count && digits.iter().all(|c| is_bit(*c)) && (is_packed || is_spread);
        fits.then(|| digits.into_iter().map(|c| c == '1').collect())
    };
    let rows: Option<BTreeMap<usize, Vec<bool>>> =
        lines.iter().map(|(number, value)| Some((*number, row(value)?))).collect();
    let is_no_list = |value: &&str| match numbers(value).as_deref() {
        // A number of a hundred digits does not parse.
        None => true,
        Some([one]) => *one > count as u64,
        Some(list) => list.iter().filter(|n| **n == 1).count() > 1 || list.windows(2).any(|w| w == [0, 1]),
    };
    let rows = rows.filter(|_| count > 1 && lines.values().any(is_no_list))?;
    let ones = |row: Vec<bool>| (1..).zip(row).filter(|(_, is)| *is).map(|(n, _)| n).collect();
    Some(rows.into_iter().map(|(number, row)| (number, ones(row))).collect())
}

/// Numbered lines of a section.
pub(crate) struct Rows {
    pub section: &'static str,
    pub lines: BTreeMap<usize, Vec<u64>>,
}

impl Rows {
    /// Number of lines that the section is made for, if the file does not declare it: its largest line
    /// number, plus one if it counts from 0.
    pub fn count(&self) -> usize {
        let from_zero = usize::from(self.lines.contains_key(&0));
        self.lines.keys().next_back().map_or(0, |last| last.saturating_add(from_zero))
    }

    /// The largest number in any list.
    pub fn greatest(&self) -> usize {
        self.lines.values().flatten().max().map_or(0, |n| *n as usize)
    }

    /// Lists for `count` threads; threads without a line have empty lists, and lines beyond are left out. A
    /// file with a line 0 and no line for the last thread counts from 0.
    pub fn fit(mut self, count: usize, notes: &mut Notes) -> Vec<Vec<u64>> {
        let section = self.section;
        if self.lines.contains_key(&0) && !self.lines.contains_key(&count) {
            notes.add(
                WifNoteKind::Numbering,
                format!("the lines of [{section}] count from 0: each is taken for the next"),
            );
            self.lines = self.lines.into_iter().map(|(number, list)| (number.saturating_add(1), list)).collect();
        }
        let mut lists = vec![Vec::new(); count];
        let mut spare = Vec::new();
        for (number, list) in self.lines {
            match number.checked_sub(1).and_then(|at| lists.get_mut(at)) {
                Some(place) => *place = list,
                None => spare.push(number),
            }
        }
        if !spare.is_empty() {
            let lines = numbered(["line", "lines"], &spare);
            notes.add(WifNoteKind::SpareLines, format!("{lines} of [{section}] left out: there are {count} threads"));
        }
        lists
    }
}

/// Parses whole numbers separated by commas or blanks; `None` if there is anything else in place of a number.
/// Words after a number are a comment.
pub(crate) fn numbers(value: &str) -> Option<Vec<u64>> {
    let whole = |word: &str| {
        word.parse::<u64>().ok().or_else(|| {
            let x: f64 = word.parse().ok()?;
            (x.fract() == 0.0 && (0.0..1e15).contains(&x)).then_some(x as u64)
        })
    };
    let mut list = Vec::new();
    for part in value.split(',') {
        for (k, word) in part.split_whitespace().enumerate() {
            match (whole(bare(word)), k) {
                (Some(n), _) => list.push(n),
                (None, 0) => return None,
                (None, _) => return Some(list),
            }
        }
    }
    Some(list)
}

/// Parses a positive number, with a decimal point or comma.
pub(crate) fn real(value: &str) -> Option<f64> {
    let word = value.split_whitespace().next()?;
    let word = if word.contains('.') { word.into() } else { word.replacen(',', ".", 1) };
    word.parse().ok().filter(|x: &f64| x.is_finite() && *x > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_as_programs_write_them() {
        assert_eq!(numbers("1,2").as_deref(), Some(&[1, 2][..]));
        assert_eq!(numbers(" 1 , 2,, 3, ").as_deref(), Some(&[1, 2, 3][..]));
        assert_eq!(numbers("1\t2").as_deref(), Some(&[1, 2][..]));
        assert_eq!(numbers("1,5 both shafts 3").as_deref(), Some(&[1, 5][..]));
        assert_eq!(numbers("2.0, 007").as_deref(), Some(&[2, 7][..]));
        assert_eq!(numbers("").as_deref(), Some(&[][..]));
        assert!(["x", "1,x", "-1", "1;", "2.5", "nan", "1e99", "0x1", "1-4"].iter().all(|t| numbers(t).is_none()));
        assert_eq!([real("0.212"), real("0,212"), real(".5 cm"), real("2e-1")], [0.212, 0.212, 0.5, 0.2].map(Some));
        assert!(["", "0", "-1", "nan", "inf", "x", "1.000,5"].iter().all(|t| real(t).is_none()));
    }

    /// Rows of a plan of four shafts.
    #[test]
    fn ones_and_zeros_are_told_from_numbers() {
        let of = |value: &[&str]| {
            let lines = value.iter().enumerate().map(|(k, value)| (k + 1, *value)).collect();
            bits(&lines, 4).map(|rows| rows.into_values().collect::<Vec<_>>())
        };
        let twill = Some(vec![vec![1, 2], vec![2, 3], vec![3, 4], vec![1, 4]]);
        assert_eq!(of(&["1100", "0110", "0011", "1001"]), twill);
        assert_eq!(of(&["1,1,0,0", "0,1,1,0", "0, 0, 1, 1", "1,0,0,1"]), twill);
        assert_eq!(of(&["1 1 0 0", "0 1 1 0", "0 0 1 1", "1 0 0 1"]), twill);
        assert_eq!(of(&["1000", "0000"]), Some(vec![vec![1], vec![]]));
        // Numbers with leading zeros, lists padded with zeros, and rows of another length.
        for numbers in [&["0001", "0001"][..], &["1,0,0,0"], &["1", "0"], &["1,2", "0"], &["110", "011"], &["11000"]] {
            assert_eq!(of(numbers), None, "{numbers:?}");
        }
        assert_eq!(of(&["1100", "2"]), None);
    }

    #[test]
    fn bytes_are_decoded() {
        let text = "[WIF]\nVersion=1.1\n[TEXT]\nAuthor=M\u{fc}ller \u{1f9f6}\n";
        let wide = |unit: fn(u16) -> [u8; 2]| -> Vec<u8> { text.encode_utf16().flat_map(unit).collect() };
        let (little, big) = (wide(u16::to_le_bytes), wide(u16::to_be_bytes));
        let of = |bytes: &[u8]| {
            let mut notes = Notes::default();
            let text = decode(bytes, &mut notes).into_owned();
            (text, notes.finish().len())
        };
        assert_eq!(of(text.as_bytes()), (text.into(), 0));
        assert_eq!(of(&[b"\xef\xbb\xbf", text.as_bytes()].concat()), (text.into(), 0));
        assert_eq!(of(&[b"\xff\xfe", &little[..]].concat()), (text.into(), 0));
        assert_eq!(of(&[b"\xfe\xff", &big[..]].concat()), (text.into(), 0));
        assert_eq!((of(&little), of(&big)), ((text.into(), 1), (text.into(), 1)));
        // An odd byte at the end, UTF-32, and empty input.
        assert_eq!(of(&[b"\xff\xfe", &little[..], b"x"].concat()), (text.into(), 0));
        let four: Vec<u8> = text.chars().flat_map(|c| u32::from(c).to_le_bytes()).take(4 * 20).collect();
        assert_eq!(of(&[b"\xff\xfe\0\0", &four[..]].concat()).0, text[..20]);
        assert_eq!(of(b""), (String::new(), 0));
        assert_eq!(of(b"a\rb\r\nc\nd\r\r").0, "a\nb\nc\nd\n\n");
        assert!(of(b"[TEXT]\nAuthor=M\xfcller\n").0.contains("ller\n"));
    }
}
