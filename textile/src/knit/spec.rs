//! `[knit]` of the cloth spec: its keys with their ranges, and what they say.

use crate::knit::chart::Chart;
use crate::knit::picture::{PictureChart, STITCHES_FORM, check_stitches, read_stitches};
use plywave::Result;
use plywave::spec::rules::{Custom, Key, KeyKind, invalid, number, optional, required};
use toml::{Table, Value};

/// A knit: its stitches and their size.
#[derive(Clone, Debug, PartialEq)]
pub struct KnitSpec {
    /// The stitches.
    pub kind: KnitKind,
    /// Wales per centimeter.
    pub wales_per_cm: f64,
    /// Courses per centimeter.
    pub courses_per_cm: f64,
    /// Length of yarn in a stitch [mm].
    pub loop_mm: f64,
}

/// Stitches of a knit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum KnitKind {
    /// Knit stitches alone.
    Jersey,
    /// Wales of knit and of purl stitches in turn.
    Rib {
        /// Number of knit wales.
        knit: usize,
        /// Number of purl wales.
        purl: usize,
    },
    /// Courses of knit and of purl stitches in turn.
    Garter,
    /// Knit and purl stitches as a checkerboard.
    Seed,
    /// Two 1 x 1 ribs, back to back.
    Interlock,
    /// A warp knit of one bar.
    Tricot,
    /// A chart from text.
    Chart(Chart),
    /// A chart from a picture.
    Picture(PictureChart),
}

const WALES: Key = required("wales_per_cm", KeyKind::Number(0.1, 200.0));
const COURSES: Key = required("courses_per_cm", KeyKind::Number(0.1, 200.0));
const LOOP: Key = required("loop_mm", KeyKind::Number(0.05, 200.0));
const CHART: Custom = Custom {
    expected: "rows of one length of stitches, such as [\"KKP\", \"KRl\"]",
    check: |file, key, value| read_chart(file, key, value).map(|_| ()),
};
const STITCHES: Custom = Custom { expected: STITCHES_FORM, check: check_stitches };
/// Keys of each `knit.kind`, in addition to `kind`.
pub(crate) const KNITS: &[(&str, &[Key])] = &[
    ("jersey", &[WALES, COURSES, LOOP]),
    (
        "rib",
        &[
            WALES,
            COURSES,
            LOOP,
            optional("knit", KeyKind::Integer(1, 32), "1"),
            optional("purl", KeyKind::Integer(1, 32), "1"),
        ],
    ),
    ("garter", &[WALES, COURSES, LOOP]),
    ("seed", &[WALES, COURSES, LOOP]),
    ("interlock", &[WALES, COURSES, LOOP]),
    ("tricot", &[WALES, COURSES, LOOP]),
    (
        "chart",
        &[
            WALES,
            COURSES,
            LOOP,
            optional("chart", KeyKind::Custom(CHART), "of a picture"),
            optional("picture", KeyKind::Text, "of chart"),
            optional("stitches", KeyKind::Custom(STITCHES), "of a picture"),
        ],
    ),
];

/// Reads a chart from the value of its key.
fn read_chart(file: &str, key: &str, value: &Value) -> Result<Chart> {
    let rows: Option<Vec<&str>> = value.as_array().and_then(|list| list.iter().map(Value::as_str).collect());
    let Some(rows) = rows else {
        return Err(invalid(file, key, value, "use rows of stitches, such as [\"KKP\", \"KRl\"]"));
    };
    Chart::from_rows(&rows).map_err(|error| {
        let key = error.row.map_or(key.to_string(), |row| format!("{key}[{row}]"));
        invalid(file, &key, error.value, error.hint)
    })
}

impl KnitSpec {
    /// Reads the keys of a knit, which passed their rules.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] for keys that do not go together.
    pub(crate) fn read(file: &str, keys: &Table) -> Result<KnitSpec> {
        let count = |key: &str| keys.get(key).and_then(Value::as_integer).map_or(1, |n| n.max(1) as usize);
        let size = |key: &str| keys.get(key).and_then(number).unwrap_or_default();
        let kind = match keys.get("kind").and_then(Value::as_str).unwrap_or_default() {
            "rib" => KnitKind::Rib { knit: count("knit"), purl: count("purl") },
            "garter" => KnitKind::Garter,
            "seed" => KnitKind::Seed,
            "interlock" => KnitKind::Interlock,
            "tricot" => KnitKind::Tricot,
            "chart" => chart(file, keys)?,
            _ => KnitKind::Jersey,
        };
        let [wales_per_cm, courses_per_cm, loop_mm] = ["wales_per_cm", "courses_per_cm", "loop_mm"].map(size);
        Ok(KnitSpec { kind, wales_per_cm, courses_per_cm, loop_mm })
    }
}

/// The stitches of a chart from text or from a picture.
fn chart(file: &str, keys: &Table) -> Result<KnitKind> {
    let text = keys.get("picture").and_then(Value::as_str);
    match (keys.get("chart"), text, keys.get("stitches").and_then(Value::as_table)) {
        (Some(rows), None, None) => read_chart(file, "knit.chart", rows).map(KnitKind::Chart),
        (None, Some(picture), Some(stitches)) => {
            let stitches = read_stitches(file, "knit.stitches", stitches)?;
            Ok(KnitKind::Picture(PictureChart { picture: picture.into(), stitches }))
        }
        (Some(_), Some(picture), _) => {
            Err(invalid(file, "knit.picture", picture, "give either chart or picture, not both"))
        }
        (None, Some(_), None) => Err(invalid(file, "knit.stitches", "(absent)", format!("give {STITCHES_FORM}"))),
        (_, None, Some(_)) => {
            let hint = "leave it out, or give picture, the file of the picture";
            Err(invalid(file, "knit.stitches", "(given)", hint))
        }
        (None, None, None) => {
            let hint = "give rows of stitches, such as [\"KKP\", \"KRl\"], or a picture";
            Err(invalid(file, "knit.chart", "(absent)", hint))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ClothSpec;

    fn parse(keys: &str) -> Result<ClothSpec> {
        let text = format!(
            "name = \"k\"\n[knit]\nkind = \"chart\"\n{keys}\nwales_per_cm = 14\ncourses_per_cm = 20\nloop_mm = 2.7\n\
             [yarn]\nfiber = \"cotton\"\ncount = \"20 tex\"\n"
        );
        ClothSpec::parse(&text, "s.toml")
    }

    #[test]
    fn charts_are_text_or_pictures() {
        let text = parse("chart = [\"KT\", \"KK\"]").unwrap().knit.unwrap();
        assert_eq!(text.kind, KnitKind::Chart(Chart::from_rows(&["KT", "KK"]).unwrap()));
        let drawn = parse("picture = \"a.png\"\nstitches = { \"#fff\" = \"K\", \"#f00\" = \">\" }").unwrap();
        let stitches = vec![([255, 0, 0], '>'), ([255; 3], 'K')];
        let picture = PictureChart { picture: "a.png".into(), stitches };
        assert_eq!(drawn.knit.unwrap().kind, KnitKind::Picture(picture));
    }

    #[test]
    fn keys_that_do_not_go_together_are_refused() {
        for (keys, want) in [
            ("", "knit.chart = (absent): give rows of stitches, such as [\"KKP\", \"KRl\"], or a picture"),
            ("chart = \"KK\"", "knit.chart = \"KK\": use rows of stitches"),
            ("chart = [\"KK\", \"KX\"]", "knit.chart[1] = 'X' at wale 2: use K, P, T, M"),
            ("chart = [\"KM\"]", "knit.chart = wale 2 of M alone: the knit runs"),
            ("rows = [\"KP\"]", "knit.rows"),
            ("chart = [\"KP\"]\npicture = \"a.png\"", "knit.picture = a.png: give either chart or picture"),
            ("chart = [\"KP\"]\nstitches = { \"#fff\" = \"K\" }", "knit.stitches = (given): leave it out"),
            ("picture = \"a.png\"", "knit.stitches = (absent): give a stitch for each color"),
            ("picture = \"a.png\"\nstitches = \"K\"", "knit.stitches = \"K\": use a stitch for each color"),
            ("picture = \"a.png\"\nstitches = {}", "knit.stitches = no stitches: use a stitch"),
            ("picture = \"a.png\"\nstitches = { \"#fff\" = \"X\" }", "knit.stitches.\"#fff\" = \"X\": use one of K"),
            ("picture = \"a.png\"\nstitches = { \"#fff\" = \"KK\" }", "= \"KK\": use one of K"),
            ("picture = \"a.png\"\nstitches = { white = \"K\" }", "knit.stitches.\"white\" = (a color): use"),
            (
                "picture = \"a.png\"\nstitches = { \"#fff\" = \"K\", \"#ffffff\" = \"P\" }",
                "this color is \"#fff\" as well; give it once",
            ),
        ] {
            let error = parse(keys).expect_err(keys).to_string();
            assert!(error.contains(want) && error.lines().count() == 1, "{keys}: {error}\n{want}");
        }
    }
}
