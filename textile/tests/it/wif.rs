//! WIF files: what they say is read, invalid ones are refused in one line that names section, key and hint,
//! and none panics.

use plywave::Error;
use plywave_textile::{Draft, Wif};
use proptest::prelude::*;

fn one_line<T>(result: &plywave::Result<T>) -> String {
    let message = result.as_ref().err().map(ToString::to_string).unwrap_or_default();
    assert!(!message.contains(['\n', '\r']), "{message:?}");
    message
}

/// A 2/2 twill of four ends and eight picks; ends 1 and 2 red, the others white, picks blue.
const TWILL: &str = "\u{feff}; a comment\r\n[WIF]\r\nVersion=1.1\r\nDate=April 20, 1997\r\nDevelopers=none\r\n\r\n\
[Contents]\r\nWEAVING=yes\r\nWARP=true\r\nWEFT=1\r\nTHREADING=on\r\nTIEUP=true\r\nTREADLING=true\r\nCOLOR TABLE=true\r\n\
[COLOR PALETTE]\r\nRange=0,999\r\n[COLOR TABLE]\r\n1=999,0,0\r\n2=999, 999, 999\r\n3=0,0,999\r\n\
[WEAVING]\r\nShafts=4\r\nTreadles=5\r\nRising Shed=true\r\n[WARP]\r\nThreads=4\r\nColor=2\r\n[WEFT]\r\nThreads=8\r\nColor=3 ; blue\r\n\
[WARP COLORS]\r\n1=1\r\n2=1,7,7\r\n[THREADING]\r\n1=1\r\n2=2\r\n3=3\r\n4=4\r\n\
[TIEUP]\r\n1=1,2\r\n2=2,3\r\n3=3,4\r\n4=1,4\r\n5=0\r\n[TREADLING]\r\n1=1\r\n2=2\r\n3=3\r\n4=4\r\n5=1\r\n6=2\r\n7=3,5\r\n8=4\r\n\
[NOTES]\r\n1=what = ever\r\n";

fn drawn(draft: &Draft) -> Vec<String> {
    let row = |pick: usize| (0..draft.ends()).map(|end| if draft.up(pick, end) { 'X' } else { '.' }).collect();
    (0..draft.picks()).map(row).collect()
}

#[test]
fn wifs_are_read() {
    let wif = Wif::parse(TWILL.as_bytes(), "t.wif").unwrap();
    let four = ["XX..", ".XX.", "..XX", "X..X"];
    assert_eq!(drawn(&wif.draft), [four, four].concat());
    let [red, white, blue] = [[1.0, 0.0, 0.0], [1.0; 3], [0.0, 0.0, 1.0]];
    assert_eq!((wif.warp_srgb, wif.weft_srgb), (vec![red, red, white, white], vec![blue; 8]));

    // A sinking shed lowers the tied shafts.
    let sinking = Wif::parse(TWILL.replace("Shed=true", "Shed=no").as_bytes(), "t.wif").unwrap();
    assert_eq!(drawn(&sinking.draft)[..4], ["..XX", "X..X", "XX..", ".XX."]);
    // A lift plan counts before treadles; several shafts to an end, several treadles to a pick.
    let plan =
        TWILL.replace("[NOTES]", "[LIFTPLAN]\r\n1=1,2,3\r\n2=4\r\n3=2\r\n4=1\r\n5=2\r\n6=3\r\n7=4\r\n8=4\r\n[NOTES]");
    assert_eq!(drawn(&Wif::parse(plan.as_bytes(), "t.wif").unwrap().draft)[..3], ["XXX.", "...X", ".X.."]);
    let two = TWILL
        .replace("\r\n2=2\r\n3=3\r\n4=4\r\n[TIEUP]", "\r\n2=2,3\r\n3=3\r\n4=4\r\n[TIEUP]")
        .replace("TREADLING]\r\n1=1", "TREADLING]\r\n1=1,3,5");
    let loose = Wif::parse(two.as_bytes(), "t.wif").unwrap();
    assert_eq!(
        (loose.draft.picks(), loose.notes[0].to_string().as_str()),
        (7, "pick 1 left out, loose below all ends")
    );
    let two = two.replace("1=1,3,5", "1=1,5");
    assert_eq!(drawn(&Wif::parse(two.as_bytes(), "t.wif").unwrap().draft)[..4], ["XX..", ".XX.", ".XXX", "X..X"]);
    // No colors, and bytes of another alphabet in a comment.
    let mut plain: Vec<u8> = TWILL.replace("[COLOR TABLE]", "[OTHER]").into_bytes();
    plain.extend_from_slice(b"; \xe9t\xe9\r\n");
    assert!(Wif::parse(&plain, "t.wif").is_ok_and(|w| w.warp_srgb.is_empty() && w.weft_srgb.is_empty()));
}

#[test]
fn wifs_are_refused_by_section_and_key() {
    let cut = |from: &str, to: &str| {
        let (a, b) = (TWILL.find(from).unwrap(), TWILL.find(to).unwrap());
        format!("{}{}", &TWILL[..a], &TWILL[b..])
    };
    let with = |old: &str, new: &str| {
        assert!(TWILL.contains(old), "{old}");
        TWILL.replacen(old, new, 1)
    };
    for (text, expected) in [
        (cut("[WIF]", "[Contents]"), "no section [WIF]"),
        (String::new(), "no section [WIF]"),
        (cut("[THREADING]", "[TIEUP]"), "[THREADING] 1 = (absent): the section [THREADING] is missing"),
        (with("Shafts=4", "Shafts=99999"), "[WEAVING] Shafts = 99999: use a whole number from 1 to 4096"),
        (with("Shed=true", "Shed=perhaps"), "[WEAVING] Rising Shed = perhaps: use true or false"),
        (
            with("[WARP]\r\nThreads=4", "[WARP]\r\nThreads=18446744073709551615"),
            "[WARP] Threads = 18446744073709551615: use a whole number from 1 to 4096",
        ),
        (
            with("2=2\r\n3=3\r\n4=4\r\n[TIEUP]", "2=-2\r\n3=3\r\n4=4\r\n[TIEUP]"),
            "[THREADING] 2 = -2: use whole numbers",
        ),
        (with("4=1,4\r\n5=0", "4=1,9999\r\n5=0"), "[TIEUP] 4 = 1,9999: shaft 9999 of a loom of 4; shafts are numbers"),
        (
            cut("[TIEUP]", "[NOTES]"),
            "[TREADLING] 1 = (absent): the section [TREADLING] is missing; give either [LIFTPLAN]",
        ),
    ] {
        let result = Wif::parse(text.as_bytes(), "t.wif");
        let message = one_line(&result);
        assert!(message.starts_with("t.wif: ") && message.contains(expected), "got {message}\nwant {expected}");
        assert!(matches!(result, Err(Error::Invalid { .. } | Error::Format { .. })));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_wifs_are_read_or_refused(at in 0.0..1.0f64, cut in 0usize..40, new in prop::collection::vec(any::<u8>(), 0..8), digits in "[0-9,=\\[\\]\n]{0,9}", which in any::<bool>()) {
        let bytes = TWILL.as_bytes();
        let start = (at * bytes.len() as f64) as usize;
        let end = (start + cut).min(bytes.len());
        let new = if which { new } else { digits.into_bytes() };
        let damaged = [&bytes[..start], &new[..], &bytes[end..]].concat();
        let result = Wif::parse(&damaged, "t.wif");
        one_line(&result);
        if let Ok(wif) = result {
            prop_assert!(wif.draft.unbound().is_none());
        }
    }

    #[test]
    fn any_bytes_are_a_wif_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        one_line(&Wif::parse(&bytes, "t.wif"));
        one_line(&Wif::parse(&[b"[WIF]\n[WARP]\nThreads=3\n[WEFT]\nThreads=3\n[WEAVING]\nShafts=3\n[THREADING]\n", &bytes[..]].concat(), "t.wif"));
    }
}
