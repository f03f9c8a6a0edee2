//! Cloths whose drafts are pictures.

/// Two jacquard cloths: their pictures are drafts that hang together, with few crossings bound, and a brocade
/// whose wefts are on the face where they are drawn.
#[test]
fn jacquard_cloths_are_woven() {
    let read = |name: &str| {
        let folder = if name.starts_with("damask") { "../fabrics/cloths" } else { "tests/data" };
        let path = format!("{}/{folder}/{name}", env!("CARGO_MANIFEST_DIR"));
        std::fs::read(&path).unwrap_or_else(|e| panic!("{path}: {e}"))
    };
    let woven = |name: &str| {
        let text = String::from_utf8(read(&format!("{name}.toml"))).unwrap();
        let cloth = plywave_textile::ClothSpec::parse(&text, name).unwrap();
        let Some(plywave_textile::WeaveSpec::Picture(picture)) = &cloth.weave else { panic!("{name}: no picture") };
        assert_eq!(picture.rotation_note(cloth.yarns()[1].colors().len().max(1)), None, "{name}");
        let made = picture.draft(name, &read(&picture.picture)).unwrap();
        let spacing = plywave_textile::YarnSet::EACH.map(|set| cloth.spacing_um(set).unwrap());
        plywave_textile::check_floats(name, "weave", &made.draft, spacing).unwrap();
        made
    };
    let damask = woven("damask");
    assert_eq!((damask.draft.ends(), damask.draft.picks(), damask.draft.layers_apart().len()), (240, 200, 1));
    assert!(damask.bound < 240, "{}", damask.bound);
    let share = damask.draft.warp_share();
    assert!((0.4..0.65).contains(&share), "{share}");
    let brocade = woven("brocade");
    assert_eq!((brocade.draft.ends(), brocade.draft.picks(), brocade.wefts), (128, 288, 3));
    assert!(brocade.notes.iter().all(|note| note.starts_with("floats of more than")), "{:?}", brocade.notes);
}
