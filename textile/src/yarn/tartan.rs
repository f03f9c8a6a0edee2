//! Tartans by their thread counts, as weavers and the Scottish Register of Tartans write them: a color code
//! and a number of threads for each stripe, such as `R8 K4 Y2`. With slashes, `R/8 K4 Y/2`, the first and the
//! last stripe are pivots, about which the order is mirrored: R8 K4 Y2 K4.

use crate::weave::draft::MAX_THREADS;
use crate::yarn::stripe::Stripe;
use plywave::color::srgb_of_text;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// A color of tartans.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ColorCode {
    /// Code, one or two letters.
    pub code: &'static str,
    /// Name.
    pub name: &'static str,
    /// Color [sRGB, 0 to 255].
    pub srgb: [u8; 3],
}

const fn code(code: &'static str, name: &'static str, srgb: u32) -> ColorCode {
    ColorCode { code, name, srgb: [(srgb >> 16) as u8, (srgb >> 8) as u8, srgb as u8] }
}

/// The codes of the Scottish Register of Tartans. It lists several shades for most of them ("Tartan Register
/// colours", Colour_shades.pdf); which one of these stands for a code is chosen: that of modern dyes where
/// there is one. A and C are older codes, with the Register's shades of these names.
pub const COLOR_CODES: &[ColorCode] = &[
    code("R", "red", 0xc8_002c),
    code("LR", "light red", 0xe8_7878),
    code("DR", "dark red", 0x88_0000),
    code("O", "orange", 0xec_8048),
    code("DO", "dark orange", 0xbe_7832),
    code("Y", "yellow", 0xe8_c000),
    code("LY", "light yellow", 0xf9_f5c8),
    code("DY", "dark yellow", 0xc8_9800),
    code("G", "green", 0x00_6818),
    code("LG", "light green", 0x86_c67c),
    code("DG", "dark green", 0x00_4028),
    code("B", "blue", 0x2c_4084),
    code("LB", "light blue", 0x98_c8e8),
    code("DB", "dark blue", 0x20_2060),
    code("P", "purple", 0x78_0078),
    code("LP", "light purple", 0xc4_9cd8),
    code("DP", "dark purple", 0x44_0044),
    code("W", "white", 0xf8_f8f8),
    code("N", "gray", 0xa0_a0a0),
    code("LN", "light gray", 0xe0_e0e0),
    code("DN", "dark gray", 0x55_5a64),
    code("K", "black", 0x10_1010),
    code("T", "brown", 0x60_4000),
    code("LT", "light brown", 0xa0_7c58),
    code("DT", "dark brown", 0x4c_3428),
    code("A", "azure", 0x5c_8ca8),
    code("C", "crimson", 0x90_1c38),
];

/// A thread count. It prints as a text that parses to the same count.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ThreadCount {
    /// Stripes as written: threads and color [sRGB, 0 to 255].
    written: Vec<(usize, [u8; 3])>,
    has_pivots: bool,
}

impl ThreadCount {
    /// Whether the order is mirrored about the first and the last stripe.
    pub fn has_pivots(&self) -> bool {
        self.has_pivots
    }

    /// Stripes of one repeat, in their order. Pivots are not doubled.
    pub fn stripes(&self) -> Vec<Stripe> {
        let back: &[_] = match self.has_pivots {
            true if self.written.len() > 2 => &self.written[1..self.written.len() - 1],
            _ => &[],
        };
        let all = self.written.iter().chain(back.iter().rev());
        all.map(|(count, srgb)| Stripe { count: *count, color: srgb.map(|v| f64::from(v) / 255.0) }).collect()
    }

    /// Number of threads of one repeat.
    pub fn threads(&self) -> usize {
        self.stripes().iter().map(|stripe| stripe.count).sum()
    }
}

/// The color of a code or of hexadecimal digits. The error tells what to write.
fn color(text: &str) -> Result<[u8; 3], String> {
    if text.starts_with('#') {
        let srgb = srgb_of_text(text).ok_or_else(|| format!("{text} is no color; write #rrggbb, as #b03060 8"))?;
        return Ok(srgb.map(|v| (v * 255.0).round() as u8));
    }
    let upper = text.to_uppercase();
    if let Some(known) = COLOR_CODES.iter().find(|known| known.code == upper) {
        return Ok(known.srgb);
    }
    // Of codes as near as each other, the one that ends as the text does: a last letter is the color.
    let last = upper.chars().last();
    let distance = |known: &&ColorCode| {
        let missing = known.code.chars().filter(|c| !upper.contains(*c)).count();
        let other = upper.chars().filter(|c| !known.code.contains(*c)).count();
        (missing + other, known.code.chars().last() != last, known.code.len())
    };
    let codes: Vec<&str> = COLOR_CODES.iter().map(|known| known.code).collect();
    let near = COLOR_CODES.iter().filter(|known| known.code.chars().any(|c| upper.contains(c))).min_by_key(distance);
    let named = text.to_lowercase();
    let by_name = COLOR_CODES.iter().find(|known| known.name == named);
    Err(match by_name.or(near) {
        Some(near) => format!(
            "{text:?} is no color code; did you mean {} ({})? Codes are {}, or write #rrggbb",
            near.code,
            near.name,
            codes.join(" ")
        ),
        None => format!("{text:?} is no color code; use {}, or write #rrggbb", codes.join(" ")),
    })
}

/// The count of a stripe, and whether a slash marks it as a pivot.
fn count(text: &str, of: &str) -> Result<(usize, bool), String> {
    let digits = text.strip_prefix('/').unwrap_or(text);
    if digits.is_empty() || !digits.bytes().all(|b| b.is_ascii_digit()) {
        return Err(format!("{of} has no number of threads; write the color and the number, as R8 or #b03060 8"));
    }
    match digits.parse::<usize>() {
        Ok(0) => Err(format!("{of} has 0 threads; leave it out or use 1 or more")),
        Ok(count) if count <= MAX_THREADS => Ok((count, text.len() > digits.len())),
        _ => Err(format!("{of} has {} threads; use {MAX_THREADS} or less", plywave::one_line(digits, 20))),
    }
}

impl FromStr for ThreadCount {
    type Err = String;

    /// Parses a thread count. The error tells what to write, as the end of a message.
    fn from_str(text: &str) -> Result<ThreadCount, String> {
        let plain = text.replace("...", " ").replace('\u{2026}', " ");
        let mut words = plain.split([' ', ',', '\t', '\n', '\r']).filter(|word| !word.is_empty());
        let (mut written, mut pivots) = (Vec::new(), Vec::new());
        let mut threads = 0usize;
        while let Some(word) = words.next() {
            let shown = plywave::one_line(word, 24);
            // The number stands after the letters, or apart.
            let at = match word.strip_prefix('#') {
                Some(_) => word.find('/'),
                None => word.find(|c: char| c == '/' || c.is_ascii_digit()),
            };
            let (name, number) = match at {
                Some(at) => word.split_at(at),
                None => (word, words.next().unwrap_or_default()),
            };
            if name.is_empty() {
                return Err(format!("{shown} has no color; write the color and the number, as R8"));
            }
            let srgb = color(&plywave::one_line(name, 24))?;
            let (count, is_pivot) = count(number, &shown)?;
            threads += count;
            if threads > 2 * MAX_THREADS {
                return Err(format!("more than {MAX_THREADS} threads; use a smaller repeat"));
            }
            written.push((count, srgb));
            pivots.push(is_pivot);
        }
        let (first, last) = (pivots.first() == Some(&true), pivots.last() == Some(&true));
        if written.is_empty() {
            return Err("no stripes; write colors and numbers of threads, as R8 K4 Y2".into());
        }
        if first != last || pivots.iter().filter(|pivot| **pivot).count() > 2 {
            return Err(
                "pivots are the first and the last stripe: mark both with a slash, as R/8 K4 Y/2, or none".into()
            );
        }
        if pivots[1..pivots.len().max(2) - 1].contains(&true) {
            return Err(
                "pivots are the first and the last stripe: mark both with a slash, as R/8 K4 Y/2, or none".into()
            );
        }
        let read = ThreadCount { written, has_pivots: first };
        match read.threads() {
            0..=MAX_THREADS => Ok(read),
            threads => Err(format!("a repeat of {threads} threads; use {MAX_THREADS} or less")),
        }
    }
}

impl fmt::Display for ThreadCount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, (count, srgb)) in self.written.iter().enumerate() {
            let slash = if self.has_pivots && (at == 0 || at + 1 == self.written.len()) { "/" } else { "" };
            let space = if at == 0 { "" } else { " " };
            match COLOR_CODES.iter().find(|known| known.srgb == *srgb) {
                Some(known) => write!(f, "{space}{}{slash}{count}", known.code)?,
                None if slash.is_empty() => write!(f, "{space}{} {count}", crate::picture::pixels::hex(*srgb))?,
                None => write!(f, "{space}{}/{count}", crate::picture::pixels::hex(*srgb))?,
            }
        }
        Ok(())
    }
}

impl TryFrom<String> for ThreadCount {
    type Error = String;

    fn try_from(text: String) -> Result<ThreadCount, String> {
        text.parse()
    }
}

impl From<ThreadCount> for String {
    fn from(count: ThreadCount) -> String {
        count.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn of(text: &str) -> Vec<(usize, String)> {
        let count: ThreadCount = text.parse().unwrap_or_else(|e| panic!("{text}: {e}"));
        assert_eq!(count.to_string().parse(), Ok(count.clone()), "{text}");
        let code = |srgb: [f64; 3]| {
            let bytes = srgb.map(|v| (v * 255.0).round() as u8);
            let known = COLOR_CODES.iter().find(|known| known.srgb == bytes);
            known.map_or(crate::picture::pixels::hex(bytes), |known| known.code.into())
        };
        count.stripes().iter().map(|stripe| (stripe.count, code(stripe.color))).collect()
    }

    fn list(stripes: &[(usize, &str)]) -> Vec<(usize, String)> {
        stripes.iter().map(|(count, code)| (*count, (*code).into())).collect()
    }

    #[test]
    fn counts_repeat_or_turn_at_their_pivots() {
        assert_eq!(of("R8 K4 Y2"), list(&[(8, "R"), (4, "K"), (2, "Y")]));
        assert_eq!(of("R/8 K4 Y/2"), list(&[(8, "R"), (4, "K"), (2, "Y"), (4, "K")]));
        assert_eq!(of("r8,k4 , y2"), of("R8 K4 Y2"));
        assert_eq!(of("...R8 K4 Y2..."), of("R8 K4 Y2"));
        assert_eq!(of("DB24 LG2 #b03060 8"), list(&[(24, "DB"), (2, "LG"), (8, "#b03060")]));
        assert_eq!(of("#b03060/8 K4 #fff/2"), list(&[(8, "#b03060"), (4, "K"), (2, "#ffffff"), (4, "K")]));
        assert_eq!(of("R 8 K 4"), of("R8 K4"));
        assert_eq!(of("R/8"), list(&[(8, "R")]));
        assert_eq!(of("R/8 K/4"), list(&[(8, "R"), (4, "K")]));
        assert_eq!(of("K4096"), list(&[(4096, "K")]));
    }

    /// Fraser of Boblainy, eighteenth century: 4 blue, 56 red, 28 green, 28 blue, 4 red, and back (Scottish
    /// Tartans Authority, "Understanding Thread Counts").
    #[test]
    fn a_sett_of_the_eighteenth_century_is_whole() {
        let sett: ThreadCount = "B/4 R56 G28 B28 R/4".parse().unwrap();
        let counts: Vec<usize> = sett.stripes().iter().map(|s| s.count).collect();
        assert_eq!(counts, [4, 56, 28, 28, 4, 28, 28, 56]);
        assert_eq!(sett.threads(), 232);
        assert!(sett.has_pivots());
    }

    #[test]
    fn codes_are_distinct() {
        for (at, one) in COLOR_CODES.iter().enumerate() {
            for other in &COLOR_CODES[at + 1..] {
                assert!(one.code != other.code && one.srgb != other.srgb, "{one:?} {other:?}");
            }
        }
        assert_eq!(COLOR_CODES[0].srgb, [200, 0, 44]);
    }

    #[test]
    fn what_is_no_thread_count_is_refused_with_what_to_write() {
        for (text, want) in [
            ("", "no stripes; write colors"),
            ("R8 X4", "\"X\" is no color code; use R LR"),
            ("RD8", "did you mean DR (dark red)?"),
            ("BL4", "did you mean LB (light blue)?"),
            ("red8", "did you mean R (red)?"),
            ("LX8", "is no color code; did you mean L"),
            ("R0 K4", "R0 has 0 threads; leave it out"),
            ("R-8", "\"R-\" is no color code; did you mean R (red)?"),
            ("R", "R has no number of threads"),
            ("R8 #12345 8", "#12345 is no color; write #rrggbb"),
            ("R8 #123456", "#123456 has no number of threads"),
            ("8 K4", "8 has no color"),
            ("R/8 K4 Y2", "mark both with a slash"),
            ("R8 K4 Y/2", "mark both with a slash"),
            ("R/8 K/4 Y/2", "mark both with a slash"),
            ("R8 K/4 Y2", "mark both with a slash"),
            ("R99999", "R99999 has 99999 threads; use 4096"),
            ("R99999999999999999999999999", "threads; use 4096 or less"),
            ("R4000 K97", "a repeat of 4097 threads"),
            ("R/8 K2100 Y/2", "a repeat of 4210 threads"),
            ("R8.5", "R8.5 has no number of threads"),
        ] {
            let got = text.parse::<ThreadCount>().expect_err(text);
            assert!(got.contains(want), "{text}: {got}");
        }
        let long = "R2 K2 ".repeat(100_000);
        assert!(long.parse::<ThreadCount>().unwrap_err().contains("more than 4096 threads"));
    }

    proptest! {
        #[test]
        fn texts_do_not_panic(text in "\\PC{0,40}") {
            let _ = text.parse::<ThreadCount>();
        }

        #[test]
        fn near_misses_do_not_panic(text in "[RKYGBDLN#/0-9a-f ,.]{0,40}") {
            if let Ok(count) = text.parse::<ThreadCount>() {
                prop_assert_eq!(count.to_string().parse::<ThreadCount>(), Ok(count.clone()));
                prop_assert!(count.threads() <= MAX_THREADS);
            }
        }
    }
}
