//! Drafts of pictures: crossing by crossing against the weaves, what is refused, and random pictures.

use super::*;
use crate::picture::pixels::tests::rgb;
use proptest::prelude::*;

fn weave(toml: &str) -> PictureWeave {
    toml::from_str(toml).unwrap_or_else(|e| panic!("{toml}: {e}"))
}

fn refused(toml: &str) -> String {
    toml::from_str::<PictureWeave>(toml).expect_err(toml).to_string()
}

/// A picture of letters: `.` white, `#` black, `r` red, `b` blue.
fn picture(rows: &[&str]) -> Vec<u8> {
    let color = |c: char| match c {
        '.' => [255; 3],
        'r' => [255, 0, 0],
        'b' => [0, 0, 255],
        _ => [0; 3],
    };
    let pixels: Vec<[u8; 3]> = rows.iter().flat_map(|row| row.chars().map(color)).collect();
    rgb(rows[0].len(), &pixels)
}

const DAMASK: &str = "picture = \"a.png\"\nweaves = { \"#fff\" = \"satin 5/2\", \"#000000\" = \"satin 5/2 weft\" }";

/// Each crossing is that of its area's weave, with phases that do not depend on the areas, and the last row
/// is the first pick. A satin of warp and one of weft, which join within the default limit, need no binding.
#[test]
fn areas_have_their_weaves() {
    let of = weave(DAMASK);
    let rows: Vec<String> = (0..40)
        .map(|row| {
            (0..40).map(|end| if (8..31).contains(&row) && (5..end + 15).contains(&row) { '#' } else { '.' }).collect()
        })
        .collect();
    let rows: Vec<&str> = rows.iter().map(String::as_str).collect();
    let made = of.draft("s.toml", &picture(&rows)).unwrap();
    assert_eq!((made.bound, made.wefts, &made.notes[..]), (0, 1, &[][..]));
    let satin = Draft::satin(5, 2).unwrap();
    for pick in 0..40 {
        for end in 0..40 {
            let is_warp = rows[39 - pick].as_bytes()[end] == b'.';
            let binds = !satin.up(pick % 5, end % 5);
            assert_eq!(made.draft.up(pick, end), binds != is_warp, "{pick} {end}");
        }
    }
    assert!(longest_floats(&made.draft).iter().all(|f| f.length <= 8));
}

/// One color alone is the weave itself.
#[test]
fn a_picture_of_one_color_is_its_weave() {
    for name in ["plain", "twill 2/2", "satin 8/3", "hopsack 2/2", "double plain"] {
        let of = weave(&format!("picture = \"a.png\"\nweaves = {{ \"#fff\" = \"{name}\" }}"));
        let made = of.draft("s.toml", &picture(&["................"; 16])).unwrap();
        let WovenUnit::Repeat(unit) = name.parse::<AreaWeave>().unwrap().unit() else { panic!() };
        assert_eq!(made.draft.reduced(), unit.reduced(), "{name}");
        assert_eq!((made.bound, made.notes.len()), (0, 0), "{name}");
    }
}

/// A weave that floats on in the next area is bound there, and the note says how often.
#[test]
fn floats_across_borders_are_bound() {
    let of = weave(
        "picture = \"a.png\"\nmax_float = 3\n\
         weaves = { \"#fff\" = \"twill 3/1\", \"#000\" = \"twill 1/3 S\", \"#f00\" = \"hopsack 3/3\" }",
    );
    let made = of.draft("s.toml", &picture(&["....####rrrr"; 12])).unwrap();
    assert!(made.bound > 0);
    assert!(longest_floats(&made.draft).iter().all(|f| f.length <= 3 && !f.is_endless));
    let note = made.notes.last().unwrap();
    assert!(note.starts_with("floats of more than 3 pixels, the longest over "), "{note}");
    assert!(note.ends_with(&format!("are bound at {} of 144 crossings", made.bound)), "{note}");
}

const BROCADE: &str = r##"
picture = "a.png"
max_float = 11
[weaves]
"#fff" = ["plain", "float back", "float back"]
"#f00" = ["plain", "satin 8/3 weft", "float back"]
"#00f" = ["plain", "float back", "float"]
"##;

/// Picks of the wefts follow in turn. In each area the ground weft is plain, the weft of the area lies on the
/// face, and the others on the back.
#[test]
fn extra_wefts_are_on_the_face_in_their_areas() {
    let of = weave(BROCADE);
    assert_eq!(of.wefts(), 3);
    let rows = ["................", "rrrrrrrr........", "........bbbbbbbb", "rrrrrrrrbbbbbbbb"].map(|row| [row; 6]);
    let made = of.draft("s.toml", &picture(rows.as_flattened())).unwrap();
    assert_eq!((made.draft.picks(), made.draft.ends(), made.wefts), (72, 16, 3));
    let [warp, weft] = longest_floats(&made.draft).map(|f| f.length);
    assert!(warp <= 5 && weft <= 11, "{warp} {weft}");
    let mut others = 0;
    for pick in 0..72 {
        let (row, weft) = (pick / 3, pick % 3);
        for end in 0..16 {
            let color = rows.as_flattened()[23 - row].as_bytes()[end];
            let want = match (weft, color) {
                (0, _) => (row + end).is_multiple_of(2),
                (1, b'r') => (end + 8 - row * 3 % 8).is_multiple_of(8),
                (2, b'b') => false,
                _ => true,
            };
            others += usize::from(made.draft.up(pick, end) != want);
        }
    }
    assert_eq!(others, made.bound);
    // The ground alone is a plain weave still: no point of it was needed to bind another weft.
    for pick in (0..72).step_by(3) {
        assert!((0..16).all(|end| made.draft.up(pick, end) == (pick / 3 + end).is_multiple_of(2)), "{pick}");
    }
    assert_eq!(of.rotation_note(3), None);
    assert_eq!(of.rotation_note(6), None);
    assert!(of.rotation_note(4).unwrap().contains("use weft.stripes of 3 picks"));
    assert!(of.rotation_note(0).is_some() && weave(DAMASK).rotation_note(0).is_none());
}

/// Where the cloths exchange they hold together, and one cloth above the other falls apart.
#[test]
fn double_cloths_are_joined_where_they_exchange() {
    let of =
        weave("picture = \"a.png\"\nweaves = { \"#fff\" = \"double plain\", \"#000\" = \"double plain exchanged\" }");
    let apart = of.draft("s.toml", &picture(&["........"; 8])).unwrap();
    assert_eq!(apart.draft.layers_apart().len(), 2);
    let joined = of.draft("s.toml", &picture(&["....####"; 8])).unwrap();
    assert_eq!(joined.draft.layers_apart().len(), 1);
    // Of the white area the face has ends 1, 3, ..., of the black area ends 2, 4, ...: over all picks of the
    // other cloth.
    for pick in 0..8 {
        for end in 0..8 {
            if pick % 2 != end % 2 {
                assert_eq!(joined.draft.up(pick, end), (end % 2 == 0) == (end < 4), "{pick} {end}");
            }
        }
    }
    assert_eq!(joined.bound, 0);
}

#[test]
fn specs_are_read_and_written() {
    let of = weave(BROCADE);
    assert_eq!(of.max_float, Some(11));
    assert_eq!(of.weaves.iter().map(|w| w.color).collect::<Vec<_>>(), [[0, 0, 255], [255, 0, 0], [255; 3]]);
    assert_eq!(weave(&toml::to_string(&of).unwrap()), of);
    assert_eq!(weave(DAMASK).max_float, None);
}

#[test]
fn bad_specs_are_refused_with_key_and_hint() {
    for (toml, want) in [
        ("picture = \"a.png\"", "missing field `weaves`"),
        ("weaves = { \"#fff\" = \"plain\" }", "missing field `picture`"),
        ("picture = \"a.png\"\nweaves = {}", "weave.weaves = no weaves: use a weave for each color"),
        ("picture = \"a.png\"\nfloat = 3\nweaves = { \"#fff\" = \"plain\" }", "unknown field `float`"),
        (
            "picture = \"a.png\"\nweaves = { \"white\" = \"plain\" }",
            "weave.weaves.\"white\" = (a color): use \"#rrggbb\"",
        ),
        (
            "picture = \"a.png\"\nweaves = { \"#fff\" = \"satn 5/2\" }",
            "weave.weaves.\"#fff\" = satn 5/2: \"satn\" is no weave; did you mean satin?",
        ),
        (
            "picture = \"a.png\"\nweaves = { \"#f00\" = [\"plain\", \"satin 6/2\"] }",
            "weave.weaves.\"#f00\"[1] = satin 6/2: no satin has 6 ends",
        ),
        (
            "picture = \"a.png\"\nweaves = { \"#fff\" = \"plain\", \"#ffffff\" = \"plain\" }",
            "weave.weaves.\"#ffffff\" = #ffffff: this color is \"#fff\" as well; give it once",
        ),
        (
            "picture = \"a.png\"\nweaves = { \"#000\" = [\"plain\", \"float\"], \"#fff\" = \"plain\" }",
            "weave.weaves.\"#fff\" = 1 weaves: use 2, as for \"#000\"",
        ),
        ("picture = \"a.png\"\nweaves = { \"#fff\" = [] }", "weave.weaves.\"#fff\" = 0 weaves: use 1 to 4"),
        (
            "picture = \"a.png\"\nmax_float = 1\nweaves = { \"#fff\" = \"plain\" }",
            "weave.max_float = 1: use 2 to 4096 pixels",
        ),
    ] {
        let got = refused(toml);
        assert!(got.contains(want), "{toml}: {got}");
    }
    // The check before parsing says the same, as an error of the runtime.
    let value: Value = toml::from_str("\"#f00\" = [\"plain\", \"velvet\"]").unwrap();
    let error = check_weaves("s.toml", "weave.weaves", &value).unwrap_err().to_string();
    assert!(error.starts_with("s.toml: weave.weaves.\"#f00\"[1] = velvet: \"velvet\" is no weave; use"), "{error}");
    for (text, want) in [
        ("\"#f00\" = 3", "weave.weaves.\"#f00\" = 3: use a weave for each color"),
        ("\"#f00\" = [3]", "weave.weaves.\"#f00\" = [3]: use a weave for each color"),
    ] {
        let error = check_weaves("s.toml", "weave.weaves", &toml::from_str(text).unwrap()).unwrap_err().to_string();
        assert!(error.contains(want), "{error}");
    }
    assert!(check_weaves("s.toml", "weave.weaves", &Value::Integer(3)).is_err());
    assert!(check_weaves("s.toml", "weave.weaves", &toml::from_str("\"#f00\" = \"plain\"").unwrap()).is_ok());
}

#[test]
fn pictures_that_do_not_go_with_their_weaves_are_refused() {
    let error = |toml: &str, rows: &[&str]| weave(toml).draft("s.toml", &picture(rows)).unwrap_err().to_string();
    assert_eq!(
        error(DAMASK, &[".....r....", "..........", "###rr#####"]),
        "s.toml: weave.weaves = #ff0000 without a weave, 3 pixels of a.png: give \"#ff0000\" a weave, or draw it as \
         #000000, the nearest that has one (without antialiasing)"
    );
    let got = error(DAMASK, &["..r..", "bb..."]);
    assert!(got.contains("#0000ff and 1 other color without a weave, 2 pixels"), "{got}");
    assert!(error(DAMASK, &["....."]).contains("weave.picture = 5 x 1 pixels: use a picture of 2 x 2"));
    let short = DAMASK.replace("weaves", "max_float = 3\nweaves");
    assert_eq!(
        error(&short, &["..", "##"]),
        "s.toml: weave.max_float = 3: satin 5/2 warp alone floats over 4; use 4 or more, or another weave"
    );
    let endless = "picture = \"a.png\"\nweaves = { \"#fff\" = [\"plain\", \"float back\"] }";
    assert_eq!(
        error(endless, &["..", ".."]),
        "s.toml: weave.max_float = (absent): give the number of pixels at which plain with float back is \
         bound, such as 15"
    );
    let tall = vec![[255u8; 3]; 2 * 2049];
    let many = weave("picture = \"a.png\"\nmax_float = 9\nweaves = { \"#fff\" = [\"plain\", \"float back\"] }");
    let got = many.draft("s.toml", &rgb(2, &tall)).unwrap_err().to_string();
    assert!(got.contains("weave.picture = 2 x 2049 pixels: 2 wefts make 4098 picks; use 2048 rows"), "{got}");
    assert!(weave(DAMASK).draft("s.toml", b"no picture").unwrap_err().to_string().starts_with("a.png: no PNG file"));
}

#[test]
fn what_is_odd_is_noted() {
    let made = weave(DAMASK).draft("s.toml", &picture(&["......."; 5])).unwrap();
    assert_eq!(
        made.notes[..2],
        [
            "weave.weaves: no pixel of a.png is #000000",
            "a.png is 7 pixels wide, and its weaves repeat over 5 ends: they are cut where it repeats; 5 and 10 fit"
        ]
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Any picture with any weaves gives a bound draft without long floats, in which all crossings but the
    /// counted ones are those of the weaves; or a message.
    #[test]
    fn random_pictures_make_drafts(
        width in 1usize..24,
        height in 1usize..24,
        wefts in 1usize..5,
        names in prop::collection::vec(0usize..14, 12),
        max_float in prop::option::of(2usize..20),
        seed: u64,
        patch in 1usize..6,
    ) {
        const NAMES: [&str; 14] = [
            "plain", "twill 2/2", "twill 3/1 S", "satin 5/2", "satin 5/2 weft", "satin 8/3", "sateen 16/7", "hopsack 2/3",
            "rib 3/1", "double plain", "double plain exchanged", "double twill 1/2", "float", "float back",
        ];
        let colors = [[255u8; 3], [0; 3], [9, 200, 31]];
        let weaves: Vec<ColorWeaves> = colors
            .iter()
            .enumerate()
            .map(|(k, color)| {
                let wefts = (0..wefts).map(|w| NAMES[names[4 * k + w]].parse().unwrap()).collect();
                ColorWeaves { color: *color, wefts }
            })
            .collect();
        let of = PictureWeave { picture: "a.png".into(), weaves, max_float };
        let pixel = |at: usize| {
            let (x, y) = (at % width / patch, at / width / patch);
            let hash = (seed ^ (x * 31 + y) as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            colors[(hash >> 40) as usize % 3]
        };
        let pixels: Vec<[u8; 3]> = (0..width * height).map(pixel).collect();
        match of.draft("s.toml", &rgb(width, &pixels)) {
            Err(error) => prop_assert!(matches!(error, Error::Invalid { .. }), "{}", error),
            Ok(made) => {
                prop_assert_eq!(made.draft.unbound(), None);
                prop_assert_eq!((made.draft.picks(), made.draft.ends()), (height * wefts, width));
                let used: Vec<&ColorWeaves> = of.weaves.iter().filter(|w| pixels.contains(&w.color)).collect();
                let own = used.iter().filter_map(|w| w.longest_float()).max().unwrap_or(0);
                let limit = max_float.unwrap_or(2 * own).max(2);
                let [warp, weft] = longest_floats(&made.draft).map(|f| f.length);
                prop_assert!(warp < (limit + 1) * wefts && weft <= limit);
                let mut differ = 0;
                for pick in 0..height * wefts {
                    for end in 0..width {
                        let row = pick / wefts;
                        let color = pixels[(height - 1 - row) * width + end];
                        let area = of.weaves.iter().find(|w| w.color == color).unwrap();
                        let name: &AreaWeave = &area.wefts[pick % wefts];
                        differ += usize::from(name.unit().up(row, end) != made.draft.up(pick, end));
                    }
                }
                prop_assert_eq!(differ, made.bound);
                // The same picture gives the same draft.
                prop_assert_eq!(of.draft("s.toml", &rgb(width, &pixels)).unwrap(), made);
            }
        }
    }
}

/// The largest picture takes seconds at most.
#[test]
fn the_largest_picture_is_made() {
    let size = MAX_THREADS;
    let pixels: Vec<[u8; 3]> =
        (0..size * size).map(|at| [255 * u8::from((at / size / 64 + at % size / 64).is_multiple_of(2)); 3]).collect();
    let of = weave("picture = \"a.png\"\nweaves = { \"#fff\" = \"twill 3/1\", \"#000\" = \"satin 8/3 weft\" }");
    let made = of.draft("s.toml", &rgb(size, &pixels)).unwrap();
    assert_eq!((made.draft.ends(), made.draft.picks()), (size, size));
}
