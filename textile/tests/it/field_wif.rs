//! WIFs from the field that deviate from the format: read by value, crossing by crossing, with a note for
//! each kind of assumption. The files of a case are in `tests/data/field/`; the tests derive variants from
//! them. The expected values are from the format's text (WIF 1.1, 1997) by hand.

use plywave_textile::{Draft, Wif, WifNoteKind as Kind};
use proptest::prelude::*;

const CASES: [&str; 9] = [
    "wif_bits",
    "wif_color_zero",
    "wif_contents_lies",
    "wif_liftplan_and_tieup",
    "wif_shafts_undeclared",
    "wif_spare_colors",
    "wif_two_cloths",
    "wif_unthreaded_end",
    "wif_utf16",
];
const RED: [f32; 3] = [1.0, 0.0, 0.0];
const BLUE: [f32; 3] = [0.0, 0.0, 1.0];
/// Rows of pick 1, 2, ..: the 2/2 twill of most cases.
const TWILL: [&str; 4] = ["XX..", ".XX.", "..XX", "X..X"];

fn path(case: &str, name: &str) -> String {
    format!("{}/../tests/data/field/{case}/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn draft_of(case: &str) -> Vec<u8> {
    std::fs::read(path(case, "draft.wif")).unwrap()
}

fn text_of(case: &str) -> String {
    String::from_utf8(draft_of(case)).unwrap()
}

/// A 2/2 twill without fault.
fn twill() -> String {
    with("wif_contents_lies", "LIFTPLAN=true\n", "")
}

/// The text of a case with `old` replaced.
fn with(case: &str, old: &str, new: &str) -> String {
    let text = text_of(case);
    assert!(text.contains(old), "{case}: {old}");
    text.replace(old, new)
}

fn parse(bytes: impl AsRef<[u8]>) -> Wif {
    Wif::parse(bytes.as_ref(), "t.wif").unwrap_or_else(|e| panic!("{e}\n{}", String::from_utf8_lossy(bytes.as_ref())))
}

fn refused(text: &str) -> String {
    let message = Wif::parse(text.as_bytes(), "t.wif").expect_err(text).to_string();
    assert_eq!(message.lines().count(), 1, "{message}");
    message
}

fn drawn(draft: &Draft) -> Vec<String> {
    let row = |pick: usize| (0..draft.ends()).map(|end| if draft.up(pick, end) { 'X' } else { '.' }).collect();
    (0..draft.picks()).map(row).collect()
}

fn kinds(wif: &Wif) -> Vec<Kind> {
    wif.notes.iter().map(|note| note.kind).collect()
}

/// The only note of a file.
fn only(wif: &Wif, kind: Kind) -> &str {
    assert_eq!(kinds(wif), [kind], "{:?}", wif.notes);
    &wif.notes[0].text
}

#[test]
fn the_cases_are_read_with_a_note_each() {
    for case in CASES {
        let wif = parse(draft_of(case));
        let said: Vec<String> = wif.notes.iter().map(ToString::to_string).collect();
        assert_eq!(said.len(), usize::from(!["wif_color_zero", "wif_utf16"].contains(&case)), "{case}: {said:?}");
        assert!(said.iter().all(|note| !note.contains('\n')), "{said:?}");
    }
}

#[test]
fn contents_are_a_hint() {
    let wif = parse(draft_of("wif_contents_lies"));
    assert_eq!(drawn(&wif.draft), TWILL);
    assert_eq!(only(&wif, Kind::Contents), "[CONTENTS] announces LIFTPLAN, which the file lacks");
    // Sections that are present but not announced are read without a note, also if there is no list of
    // contents.
    for text in [twill().replace("TIEUP=true", "TIEUP=false"), with("wif_contents_lies", "[CONTENTS]", "[PRIVATE A B]")]
    {
        let wif = parse(text);
        assert_eq!((drawn(&wif.draft), kinds(&wif)), (TWILL.map(String::from).to_vec(), vec![]));
    }
    // A section that is empty or has only zeros counts as absent.
    for plan in ["[LIFTPLAN]\n", "[LIFTPLAN]\n1=0\n2=\n"] {
        let wif = parse(text_of("wif_contents_lies") + plan);
        assert_eq!((drawn(&wif.draft), kinds(&wif)), (TWILL.map(String::from).to_vec(), vec![]));
    }
    assert!(refused(&with("wif_contents_lies", "[THREADING]", "[T]")).contains("[THREADING] is missing"));
    assert!(refused(&with("wif_contents_lies", "[TIEUP]", "[T]")).contains("[TIEUP] is missing; give either"));
    let message = refused(&with("wif_contents_lies", "[TREADLING]", "[T]"));
    assert!(
        message.contains("[TREADLING] is missing; give either [LIFTPLAN], or [TIEUP] and [TREADLING]"),
        "{message}"
    );
}

#[test]
fn a_lift_plan_is_compared_with_the_tie_up() {
    let case = "wif_liftplan_and_tieup";
    let wif = parse(draft_of(case));
    assert_eq!(drawn(&wif.draft), ["X...", ".X..", "..X.", "...X"]);
    let note = only(&wif, Kind::LiftPlan);
    // Of 16 crossings the twills differ at one a pick.
    assert!(note.contains("at 25 % of the crossings: the lift plan is taken, with the warp on top at 25 %"), "{note}");
    assert!(note.ends_with("by the other it were 50 %"), "{note}");
    let equal = with(case, "[LIFTPLAN]\n1=1\n2=2\n3=3\n4=4", "[LIFTPLAN]\n1=1,2\n2=2,3\n3=3,4\n4=4,1");
    assert_eq!((drawn(&parse(&equal).draft), kinds(&parse(&equal))), (TWILL.map(String::from).to_vec(), vec![]));
    // One crossing of 4 x 4.
    let one = parse(equal.replace("1=1,2\n2=2,3\n3=3,4\n4=4,1", "1=1,2\n2=2,3\n3=3,4\n4=4,1,2"));
    assert!(only(&one, Kind::LiftPlan).contains("at 6.3 % of the crossings"), "{:?}", one.notes);
    // Half a tie-up counts as none.
    for section in ["[TIEUP]", "[TREADLING]"] {
        assert_eq!(kinds(&parse(with(case, section, "[T]"))), [Kind::Contents]);
    }
}

#[test]
fn shafts_and_treadles_beyond_the_loom_count() {
    let case = "wif_shafts_undeclared";
    let wif = parse(draft_of(case));
    assert_eq!(drawn(&wif.draft), ["XX.X", ".XX.", "X.XX", ".X.."]);
    let note = only(&wif, Kind::Loom);
    assert_eq!(note, "[WEAVING] Shafts = 4, but number 18 is used: the loom is taken to have 18");
    assert!(only(&parse(with(case, "Shafts=4\n", "")), Kind::Loom).starts_with("no Shafts in [WEAVING]: 18"));
    // Lift plans have no treadles, given as 0.
    assert_eq!(kinds(&parse(with(case, "Treadles=4\nShafts=4", "Treadles=0\nShafts=18"))), []);
    assert!(refused(&with(case, "3=18\n", "3=4097\n")).contains("[THREADING] 3 = 4097: shaft 4097 of a loom of 4;"));
    // A treadle 6 of a loom of 4, tied or not.
    let tied =
        twill().replace("4=1,4", "6=1,4").replace("[TREADLING]\n1=1\n2=2\n3=3\n4=4", "[TREADLING]\n1=1\n2=2\n3=3\n4=6");
    let wif = parse(&tied);
    assert_eq!(drawn(&wif.draft), TWILL);
    assert!(only(&wif, Kind::Loom).starts_with("[WEAVING] Treadles = 4, but number 6 is used"));
    let wif = parse(tied.replace("6=1,4", "5=1,4"));
    assert_eq!(
        (drawn(&wif.draft), kinds(&wif)),
        (TWILL[..3].iter().map(|r| r.to_string()).collect(), vec![Kind::Loom, Kind::EmptyPicks])
    );
    // A loom without numbers at all.
    let wif = parse(with("wif_contents_lies", "[WEAVING]", "[W]"));
    assert_eq!(
        (drawn(&wif.draft), kinds(&wif)),
        (TWILL.map(String::from).to_vec(), vec![Kind::Contents, Kind::Loom, Kind::Shed])
    );
}

/// The files of the case and its kin: lift plans, tie-ups, threadings and treadlings of ones and zeros.
#[test]
fn ones_and_zeros_name_shafts() {
    let case = "wif_bits";
    let plan = "1=1100\n2=0110\n3=0011\n4=1001";
    let twill = TWILL.map(String::from).to_vec();
    let wif = parse(draft_of(case));
    assert_eq!(drawn(&wif.draft), twill);
    let note = only(&wif, Kind::Bits);
    assert!(
        note.starts_with("[LIFTPLAN] has a one or a zero for each shaft")
            && note.ends_with("1 = 1100 is taken for 1,2"),
        "{note}"
    );
    let spread = with(case, plan, "1=1,1,0,0\n2=0,1,1,0\n3=0,0,1,1\n4=1,0,0,1");
    assert_eq!((drawn(&parse(&spread).draft), kinds(&parse(&spread))), (twill.clone(), vec![Kind::Bits]));
    // A loom that is not declared has the shafts of its ends.
    let undeclared = with(case, "Shafts=4\n", "");
    assert_eq!(drawn(&parse(&undeclared).draft), twill);
    // Treadles tied by bits and pressed by bits, ends threaded by bits.
    let (tied, threaded) = ("1=1100\n2=0110\n3=0011\n4=1001\n", "1=1000\n2=0100\n3=0010\n4=0001\n");
    let tie_up = twill_with_sections(tied, threaded, "1=1\n2=2\n3=3\n4=4\n");
    assert_eq!((drawn(&parse(&tie_up).draft), kinds(&parse(&tie_up))), (twill.clone(), vec![Kind::Bits]));
    let all = twill_with_sections(tied, threaded, threaded);
    assert_eq!(drawn(&parse(&all).draft), twill);
}

/// A draft of tie-up, treadling and threading.
fn twill_with_sections(tieup: &str, treadling: &str, threading: &str) -> String {
    format!(
        "[WIF]\nVersion=1.1\n[WEAVING]\nShafts=4\nTreadles=4\nRising Shed=true\n[WARP]\nThreads=4\n[WEFT]\nThreads=4\n\
         [TIEUP]\n{tieup}[TREADLING]\n{treadling}[THREADING]\n{threading}"
    )
}

/// Plans that can be several things: binary numbers whose order nobody tells, rows of another loom.
#[test]
fn plans_of_shafts_that_there_are_not_are_refused() {
    let plan = "1=1100\n2=0110\n3=0011\n4=1001";
    for (rows, want) in [
        (
            "1=3\n2=6\n3=12\n4=9",
            "[LIFTPLAN] 2 = 6: shaft 6 of a loom of 4; shafts are numbers with commas, such as 1,2",
        ),
        ("1=11000\n2=01100\n3=00110\n4=10010", "[LIFTPLAN] 1 = 11000: shaft 11000 of a loom of 4"),
        ("1=1100\n2=2,3\n3=3,4\n4=1,4", "[LIFTPLAN] 1 = 1100: shaft 1100 of a loom of 4"),
        ("1=1,2\n2=2,7\n3=3,4\n4=1,4", "[LIFTPLAN] 2 = 2,7: shaft 7 of a loom of 4"),
    ] {
        let message = refused(&with("wif_bits", plan, rows));
        assert!(message.contains(want), "{message}");
    }
    // Of a loom that is not declared, where the plan binds nothing.
    let undeclared = with("wif_bits", plan, "1=12\n2=9\n3=12\n4=9").replace("Shafts=4\n", "");
    let message = refused(&undeclared);
    assert!(message.contains("shaft 12 is named, and the ends are on 4"), "{message}");
}

/// Colors that cannot be read go, and the draft stays.
#[test]
fn colors_that_cannot_be_read_are_left_out() {
    for (old, new, want) in [
        ("1=255,0,0", "1=255,0", "[COLOR TABLE] 1 = 255,0 is no color"),
        ("1=255,0,0", "1=#ff0000", "[COLOR TABLE] 1 = #ff0000 is no color"),
        ("[WARP COLORS]\n1=1", "[WARP COLORS]\n1=red", "[WARP COLORS] 1 = red is no color"),
        ("Color=0", "Color=white", "[WARP] Color = white is no color"),
    ] {
        let wif = parse(with("wif_color_zero", old, new));
        assert_eq!(drawn(&wif.draft), drawn(&parse(draft_of("wif_color_zero")).draft));
        assert_eq!((wif.warp_srgb.len(), wif.weft_srgb.len()), (0, 0));
        let note = only(&wif, Kind::Colors);
        assert!(note.contains(want) && note.ends_with("the colors of the file are left out"), "{note}");
    }
}

#[test]
fn spare_lines_are_left_out() {
    let case = "wif_spare_colors";
    let wif = parse(draft_of(case));
    assert_eq!(drawn(&wif.draft), TWILL);
    assert_eq!(only(&wif, Kind::SpareLines), "lines 5 and 6 of [WARP COLORS] left out: there are 4 threads");
    assert_eq!((wif.warp_srgb, wif.weft_srgb), (vec![RED, BLUE, RED, BLUE], vec![BLUE; 4]));
    // Several sections, in one note.
    let more = with(case, "4=4\n\n[TIEUP]", "4=4\n5=1\n\n[TIEUP]")
        .replace("4=4\n\n[WARP COLORS]", "4=4\n7=1\n9=1\n\n[WARP COLORS]");
    let note = only(&parse(&more), Kind::SpareLines).to_string();
    for told in ["line 5 of [THREADING]", "lines 7 and 9 of [TREADLING]", "lines 5 and 6 of [WARP COLORS]"] {
        assert!(note.contains(told), "{note}");
    }
    assert_eq!(drawn(&parse(&more).draft), TWILL);
    // Lines whose key is no number.
    let named = parse(with(case, "[WARP COLORS]", "[WARP COLORS]\nPalette=yes"));
    assert!(only(&named, Kind::SpareLines).starts_with("[WARP COLORS] has lines whose key is no number"));
}

#[test]
fn colors_that_are_missing_are_taken_from_the_family() {
    let case = "wif_color_zero";
    let wif = parse(draft_of(case));
    assert_eq!((kinds(&wif), drawn(&wif.draft)), (vec![], TWILL.map(String::from).to_vec()));
    assert_eq!((wif.warp_srgb, wif.weft_srgb), (vec![RED, RED, RED, BLUE], vec![BLUE; 4]));
    // Ends without a color take that of the family, or else the first of the table.
    let sparse = with(case, "1=1\n2=1\n3=1\n4=2\n\n[COLOR P", "2=2\n3=0\n4=\n\n[COLOR P");
    let wif = parse(&sparse);
    assert_eq!(wif.warp_srgb, [RED, BLUE, RED, RED]);
    assert_eq!(only(&wif, Kind::Colors), "ends 1, 3 and 4 without color: the first color of [COLOR TABLE] is taken");
    let wif = parse(sparse.replace("Color=0", "Color=2"));
    assert_eq!((&wif.warp_srgb, kinds(&wif)), (&vec![BLUE; 4], vec![]));
    // A number that the table lacks; one that the palette does not count.
    let wif = parse(with(case, "4=2\n\n[COLOR P", "4=9\n\n[COLOR P").replace("Color=0", "Color=2"));
    assert_eq!(wif.warp_srgb, [RED, RED, RED, BLUE]);
    assert_eq!(only(&wif, Kind::Colors), "[COLOR TABLE] lacks the color of end 4: the Color of [WARP] is taken");
    let wif = parse(with(case, "Entries=2", "Entries=1"));
    assert!(only(&wif, Kind::Colors).contains("Entries = 1, but [COLOR TABLE] has a color 2: all are read"));
    let wif = parse(with(case, "Color=2", "Color=7"));
    assert_eq!(wif.weft_srgb, [RED; 4]);
    assert!(only(&wif, Kind::Colors).starts_with("[WEFT] Color = 7 is not in [COLOR TABLE]"));
    // No color of a family at all: none is invented.
    let wif = parse(with(case, "Color=2", "Color=0"));
    assert_eq!((wif.weft_srgb.len(), kinds(&wif)), (0, vec![]));
    // Index, red, green and blue, as of old: the index counts, and red, green and blue where there is no
    // table.
    let old = with(case, "Color=2", "Color=1,0,0,255").replace("4=2\n\n[COLOR P", "4=2,9,9,9\n\n[COLOR P");
    assert_eq!((parse(&old).warp_srgb[3], parse(&old).weft_srgb[0]), (BLUE, RED));
    let old = parse(old.replace("[COLOR TABLE]", "[C]").replace("[WARP COLORS]", "[W]"));
    assert_eq!((old.warp_srgb.len(), old.weft_srgb), (0, vec![BLUE; 4]));
}

#[test]
fn ranges_of_colors_hold_the_table() {
    let case = "wif_color_zero";
    let of = |range: &str, table: &str| {
        let text = with(case, "Range=0,255", range).replace("1=255,0,0\n2=0,0,255", table);
        let wif = parse(text);
        (wif.warp_srgb[0], wif.notes.iter().map(ToString::to_string).collect::<Vec<_>>())
    };
    let half = |low: f32, high: f32, v: f32| (v - low) / (high - low);
    for (range, table, red, noted) in [
        ("Range=0,999", "1=500,0,0\n2=0,0,999", half(0.0, 999.0, 500.0), false),
        ("Range=100,200", "1=150,100,100\n2=100,100,200", 0.5, false),
        ("Range=999", "1=500,0,0\n2=0,0,9", half(0.0, 999.0, 500.0), false),
        ("Range=0,1", "1=1,0,0\n2=0,0,1", 1.0, false),
        ("Range=\"0, 65535\"", "1=32768,0,0\n2=0,0,65535", half(0.0, 65535.0, 32768.0), false),
        ("Range=0,255 ; usual", "1=51,0,0 dark red\n2=0,0,255", 0.2, false),
        ("Range=255,0", "1=51,0,0\n2=0,0,255", 0.2, true),
        ("Range=RGB", "1=51,0,0\n2=0,0,255", 0.2, true),
        ("", "1=51,0,0\n2=0,0,255", 0.2, true),
        ("", "1=500,0,0\n2=0,0,1000", 0.5, true),
        ("Range=0,255", "1=500,0,0\n2=0,0,1000", 0.5, true),
        ("Range=10,255", "1=51,0,0\n2=0,0,255", 0.2, true),
        ("Range=0,0", "1=51,0,0\n2=0,0,255", 0.2, true),
    ] {
        let (got, notes) = of(range, table);
        assert!((got[0] - red).abs() < 1e-6 && got[1] == 0.0, "{range} {table}: {got:?}");
        assert_eq!(notes.len(), usize::from(noted), "{range} {table}: {notes:?}");
    }
}

#[test]
fn yarns_that_nothing_binds_are_left_out() {
    let case = "wif_unthreaded_end";
    let wif = parse(draft_of(case));
    assert_eq!(drawn(&wif.draft), ["XX.", ".X.", "..X", "X.X"]);
    assert_eq!(only(&wif, Kind::UnthreadedEnds), "end 3 left out: on no shaft, bound by no pick");
    for line in ["", "3=", "3= ; none", "3=0,0"] {
        assert_eq!(parse(with(case, "3=0", line)), wif, "{line:?}");
    }
    // Their colors go with them.
    let colored = with("wif_color_zero", "2=2\n3=3\n4=4\n\n[TIEUP]", "2=0\n3=3\n4=4\n\n[TIEUP]");
    assert_eq!(parse(&colored).warp_srgb, [RED, RED, BLUE]);
    // More ends are declared than threaded, as looms have heddles.
    let wide = parse(with(case, "[WARP]\nThreads=4", "[WARP]\nThreads=400").replace("3=0", "3=3"));
    assert_eq!(drawn(&wide.draft), TWILL);
    // Colors of omitted yarns have no note.
    let text = with("wif_color_zero", "[WARP]\nThreads=4", "[WARP]\nThreads=5");
    assert_eq!(kinds(&parse(text)), [Kind::UnthreadedEnds]);
    assert_eq!(only(&wide, Kind::UnthreadedEnds), "ends 5 to 400 left out: on no shaft, bound by no pick");
    // Picks without a treadle are unused in the same way.
    for line in ["3=0\n", "3=\n", ""] {
        let new = format!("[TREADLING]\n1=1\n2=2\n{line}4=4");
        let wif = parse(twill().replace("[TREADLING]\n1=1\n2=2\n3=3\n4=4", &new));
        assert_eq!(drawn(&wif.draft), ["XX..", ".XX.", "X..X"], "{line:?}");
        assert_eq!(only(&wif, Kind::EmptyPicks), "pick 3 left out: no shaft moves, bound by no end");
    }
    let plan = with("wif_shafts_undeclared", "Shafts=4", "Shafts=18");
    let wif = parse(plan.replace("4=2\n", "4=0\n5=2\n").replace("[WEFT]\nThreads=4", "[WEFT]\nThreads=5"));
    assert_eq!(drawn(&wif.draft), ["XX.X", ".XX.", "X.XX", ".X.."]);
    assert_eq!(only(&wif, Kind::EmptyPicks), "pick 4 left out: no shaft moves, bound by no end");
    // An end on a shaft that nothing lifts, and one that every pick lifts.
    let wif = parse(plan.replace("[THREADING]\n1=1\n2=2\n3=18\n4=1", "[THREADING]\n1=1\n2=2\n3=18\n4=7"));
    assert_eq!(drawn(&wif.draft), ["XX.", ".XX", "X.X", ".X."]);
    assert_eq!(only(&wif, Kind::LooseYarns), "end 4 left out, loose below all picks");
    let wif = parse(plan.replace("1=1\n2=2\n3=18\n4=1", "1=1\n2=2\n3=18\n4=1,2,18"));
    assert_eq!(only(&wif, Kind::LooseYarns), "end 4 left out, loose above all picks");
    // A yarn that is unbound once another is omitted: pick 3 passes above end 4 only.
    let wif = parse(plan.replace("4=1\n\n", "4=7\n\n").replace("3=1,18\n4=2", "3=1,2,18\n4=1"));
    assert_eq!(drawn(&wif.draft), ["XX.", ".XX", "X.."]);
    let note = only(&wif, Kind::LooseYarns);
    assert!(
        note.contains("end 4 left out, loose below all picks")
            && note.contains("pick 3 left out, loose below all ends"),
        "{note}"
    );
    // No yarn remains.
    let message = refused(&plan.replace("1=1,2\n2=2,18\n3=1,18\n4=2", "1=1,2,18\n2=1,2,18"));
    assert!(message.contains("[LIFTPLAN] 1 = a draft in which no yarn binds another"), "{message}");
    assert!(refused(&plan.replace("1=1\n2=2\n3=18\n4=1", "1=0")).contains("[THREADING] is empty"));
}

#[test]
fn threads_that_are_not_declared_are_counted() {
    let text = twill().replace("Threads=4\n", "");
    let wif = parse(&text);
    assert_eq!(drawn(&wif.draft), TWILL);
    assert_eq!(
        only(&wif, Kind::Threads),
        "no Threads in [WARP]: 4 ends, as the lines say; no Threads in [WEFT]: 4 picks, as the lines say"
    );
    // Lines from 0.
    let zero = |text: &str| {
        ["THREADING", "TREADLING"].iter().fold(text.to_string(), |text, section| {
            text.replace(&format!("[{section}]\n1=1\n2=2\n3=3\n4=4"), &format!("[{section}]\n0=1\n1=2\n2=3\n3=4"))
        })
    };
    let wif = parse(zero(&text));
    assert_eq!(
        (drawn(&wif.draft), kinds(&wif)),
        (TWILL.map(String::from).to_vec(), vec![Kind::Threads, Kind::Numbering])
    );
    let wif = parse(zero(&twill()));
    assert_eq!((drawn(&wif.draft), kinds(&wif)), (TWILL.map(String::from).to_vec(), vec![Kind::Numbering]));
    for count in ["4097", "99999999999999999999", "-1", "four"] {
        let message = refused(&with("wif_contents_lies", "[WARP]\nThreads=4", &format!("[WARP]\nThreads={count}")));
        assert!(message.contains(&format!("[WARP] Threads = {count}: use a whole number from 1 to 4096")), "{message}");
    }
    let message = refused(&text.replace("[THREADING]\n1=1", "[THREADING]\n1=1\n18446744073709551615=1"));
    assert!(message.contains("[WARP] Threads = (absent): the lines go to 18446744073709551615"), "{message}");
}

#[test]
fn a_sinking_shed_turns_the_cloth_over() {
    let rising = twill();
    let over: Vec<String> = TWILL.iter().map(|row| row.replace('X', "_").replace('.', "X").replace('_', ".")).collect();
    for word in ["false", "No", "0", "OFF ; counterbalance", "\"false\""] {
        let wif = parse(rising.replace("Shed=true", &format!("Shed={word}")));
        assert_eq!(drawn(&wif.draft), over, "{word}");
        assert!(only(&wif, Kind::Shed).starts_with("[WEAVING] Rising Shed = false: the shafts that are named sink"));
    }
    for word in ["TRUE", "yes", "1", "on", "-1", "true rising"] {
        let wif = parse(rising.replace("Shed=true", &format!("Shed={word}")));
        assert_eq!((drawn(&wif.draft), kinds(&wif)), (TWILL.map(String::from).to_vec(), vec![]), "{word}");
    }
    let wif = parse(rising.replace("Rising Shed=true\n", ""));
    assert_eq!((drawn(&wif.draft), kinds(&wif)), (TWILL.map(String::from).to_vec(), vec![Kind::Shed]));
    assert!(
        refused(&rising.replace("Shed=true", "Shed=perhaps")).contains("[WEAVING] Rising Shed = perhaps: use true")
    );
    // The lift plan has the shafts raised, if Rising Shed. An end on two shafts sinks with either.
    let plan = with("wif_shafts_undeclared", "Shafts=4", "Shafts=18").replace("Shed=true", "Shed=false");
    assert_eq!(drawn(&parse(&plan).draft), ["..X.", "X..X", ".X..", "X.XX"]);
    let two = parse(plan.replace("3=18\n4=1\n", "3=18\n4=1,2\n").replace("3=1,18", "3=18"));
    assert_eq!(drawn(&two.draft), ["..X.", "X...", "XX.X", "X.X."]);
}

#[test]
fn a_draft_that_falls_apart_is_told_of() {
    let case = "wif_two_cloths";
    let wif = parse(draft_of(case));
    assert_eq!(drawn(&wif.draft), ["X...", "XXX.", "..X.", "X.XX"]);
    let note = only(&wif, Kind::FallsApart);
    assert_eq!(
        note,
        "the draft falls apart into 2 cloths that no yarn joins (Clapham 1980), on top ends 1 and 3 with picks 1 and 3; all are shaded as one layer"
    );
    // Joined at one crossing: end 2 is lifted above a pick of the upper cloth.
    assert_eq!(kinds(&parse(with(case, "[TIEUP]\n1=1\n", "[TIEUP]\n1=1,2\n"))), []);
    // Turned over, the other is on top.
    let over = parse(with(case, "Shed=true", "Shed=false"));
    assert!(over.notes[1].text.contains("on top ends 2 and 4 with picks 2 and 4"), "{:?}", over.notes);
    // An omitted yarn changes no number: notes use the file's.
    let spare = with(case, "[THREADING]\n1=1\n2=2\n3=3\n4=4", "[THREADING]\n1=0\n2=1\n3=2\n4=3\n5=4")
        .replace("[WARP]\nThreads=4", "[WARP]\nThreads=5");
    let spare = parse(&spare);
    assert!(spare.notes[1].text.contains("on top ends 2 and 4 with picks 1 and 3"), "{:?}", spare.notes);
}

#[test]
fn encodings_and_line_ends_are_told_apart() {
    let want = parse(twill());
    assert_eq!(parse(draft_of("wif_utf16")), want);
    let text = twill();
    let wide = |text: &str, unit: fn(u16) -> [u8; 2]| text.encode_utf16().flat_map(unit).collect::<Vec<u8>>();
    for ends in ["\r", "\r\n", "\n\r", "\r\r\n"] {
        assert_eq!(parse(text.replace('\n', ends)), want, "{ends:?}");
        assert_eq!(parse(wide(&format!("\u{feff}{}", text.replace('\n', ends)), u16::to_be_bytes)), want, "{ends:?}");
    }
    // Line ends of three systems in one file.
    let mixed: String = text.lines().zip(["\r", "\n", "\r\n"].iter().cycle()).flat_map(|(l, end)| [l, end]).collect();
    assert_eq!(parse(mixed), want);
    assert_eq!(parse([b"\xef\xbb\xbf", text.as_bytes()].concat()), want);
    assert_eq!(parse(wide(&format!("\u{feff}{text}"), u16::to_le_bytes)), want);
    for unit in [u16::to_le_bytes, u16::to_be_bytes] {
        let wif = parse(wide(&text, unit));
        assert_eq!((drawn(&wif.draft), kinds(&wif)), (TWILL.map(String::from).to_vec(), vec![Kind::Encoding]));
    }
    // Names in Latin-1.
    let mut old = text.replace("[WEAVING]", "[TEXT]\nTitle=?\n[WEAVING]").into_bytes();
    let at = old.iter().position(|b| *b == b'?').unwrap();
    old[at] = 0xe9;
    assert_eq!(parse(&old), want);
}

#[test]
fn values_are_read_as_programs_write_them() {
    let text = twill();
    let want = parse(&text);
    for (old, new) in [
        ("[THREADING]\n1=1\n2=2\n3=3\n4=4", "[Threading]\n4 = 4\n 2=\t2\n3 =3 ; third\n1=1 first end"),
        ("[TIEUP]\n1=1,2", "[ tieup ] ; as tied\n1= 1 , 2 ,0"),
        ("[TIEUP]\n1=1,2", "[TIEUP]\n1=\"1,2\""),
        ("[TIEUP]\n1=1,2", "[TIEUP]\n01=2,1,1,"),
        ("Threads=4\nUnits=centimeters", "threads = 4 ends\nUNITS=Centimeters"),
        ("Rising Shed=true", "rising  shed = True"),
        ("[WEAVING]", "; comment\n\n[NOTES]\n1=what = ever\n2=\n[TEXT]\nTitle=A; B\n[WEAVING]"),
        ("[TREADLING]", "[PRIVATE A B]\n1=nothing\n[TREADLING]"),
    ] {
        assert!(text.contains(old), "{old}");
        assert_eq!(parse(text.replace(old, new)), want, "{new}");
    }
    let ragged: String = text.lines().map(|line| format!("  {line}\t \n")).collect();
    assert_eq!(parse(ragged + "\x1a"), want);
    for (new, told) in [("1=one", "1 = one"), ("1=1,x", "1 = 1,x"), ("1=-2", "1 = -2"), ("1=1-3", "1 = 1-3")] {
        let message = refused(&text.replace("[TIEUP]\n1=1,2", &format!("[TIEUP]\n{new}")));
        assert!(message.contains(&format!("[TIEUP] {told}: use whole numbers")), "{message}");
    }
}

/// The distances that a file with these lines of [WARP] and [WEFT] has, and where they are from.
fn spaced(warp: &str, weft: &str, sections: &str) -> [Option<(f64, String)>; 2] {
    let text = twill().replace("Units=centimeters\n", "");
    let text = text.replace("[WARP]\n", &format!("[WARP]\n{warp}\n")).replace("[WEFT]\n", &format!("[WEFT]\n{weft}\n"));
    parse(format!("{text}\n{sections}")).spacing.map(|spacing| spacing.map(|s| (s.um, s.source)))
}

#[test]
fn spacings_are_those_of_the_file() {
    for (warp, sections, um, source) in [
        ("Units=centimeters\nSpacing=0.05", "", 500.0, "[WARP] Spacing = 0.05 centimeters"),
        ("Units=Inches\nSpacing=.05\nThickness=1", "", 1270.0, "[WARP] Spacing = 0.05 inches"),
        ("Units=Decipoints\nSpacing=12", "", 12.0 * 25_400.0 / 720.0, "[WARP] Spacing = 12 decipoints"),
        ("Units=cm ; metric\nThickness=0,05", "", 500.0, "[WARP] Thickness = 0.05 centimeters"),
        ("Units=mm\nSpacing=\"0.4\"", "", 400.0, "[WARP] Spacing = 0.4 millimeters"),
        ("Spacing=0.04", "", 400.0, "[WARP] Spacing = 0.04 centimeters (no Units)"),
        ("Units=furlongs\nSpacing=0.04", "", 400.0, "[WARP] Spacing = 0.04 centimeters (unknown Units)"),
        (
            "Units=Inches\nSpacing=0",
            "[WARP THICKNESS]\n1=0.02\n2=0.02\n3=0.02\n4=0.02",
            508.0,
            "[WARP THICKNESS], 0.02 inches",
        ),
        (
            "Units=Inches\nSpacing=0.02",
            "[WARP SPACING]\n2=0.04\n3=0\n9=5",
            635.0,
            "the mean of [WARP SPACING], 0.02 to 0.04 inches",
        ),
        ("Units=Inches\nSpacing=0.02\nThickness=0.03", "[WARP SPACING]\n", 508.0, "[WARP] Spacing = 0.02 inches"),
    ] {
        let [found, weft] = spaced(warp, "Spacing=9", sections);
        let (found, from) = found.unwrap_or_else(|| panic!("{warp}: no spacing"));
        assert!((found - um).abs() < 1e-9 * um, "{warp}: {found} {um}");
        assert_eq!(from, source, "{warp}");
        assert!(weft.is_some_and(|(um, _)| (um - 90_000.0).abs() < 1e-6));
    }
    assert_eq!(spaced("", "Units=cm\nSpacing=wide", ""), [None, None]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Bytes, numbers and lines of a file from the field changed at several places: read or refused in one
    /// line; a read file gives a draft of bound yarns, with consistent colors and notes.
    #[test]
    fn damaged_files_are_read_or_refused(
        which in 0..CASES.len(),
        edits in prop::collection::vec((0.0..1.0f64, 0usize..12, "[-0-9,=;\\[\\]\n\r \"A-Z]{0,6}", any::<bool>(), any::<u8>()), 1..4),
    ) {
        let mut bytes = draft_of(CASES[which]);
        for (at, cut, new, raw, byte) in edits {
            let start = (at * bytes.len() as f64) as usize;
            let end = (start + cut).min(bytes.len());
            let new = if raw { vec![byte] } else { new.into_bytes() };
            bytes.splice(start..end, new);
        }
        match Wif::parse(&bytes, "t.wif") {
            Err(error) => prop_assert!(!error.to_string().contains(['\n', '\r'])),
            Ok(wif) => {
                prop_assert!(wif.draft.unbound().is_none());
                for (colors, threads) in [(&wif.warp_srgb, wif.draft.ends()), (&wif.weft_srgb, wif.draft.picks())] {
                    prop_assert!(colors.is_empty() || colors.len() == threads);
                    prop_assert!(colors.iter().flatten().all(|c| (0.0..=1.0).contains(c)));
                }
                let kinds = kinds(&wif);
                prop_assert!(kinds.windows(2).all(|w| w[0] < w[1]), "{kinds:?}");
                prop_assert!(wif.notes.iter().all(|n| !n.text.contains(['\n', '\r']) && n.text.chars().count() <= 600));
            }
        }
    }
}
