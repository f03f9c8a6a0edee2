//! The geometry of cloths: relaxed yarns beside closed forms (Peirce's plain weave, touching helices), beside
//! measured cloths, and refusals.

use plywave::Error;
use plywave::cloth::{ClothCurves, Lattice};
use plywave::math::vec3::dot;
use plywave::spec::ply_circle_um;
use plywave_sim::SimError;
use plywave_sim::cloth::{ClothSolid, CurveFormat, Effort, MadeCloth, make_cloth, measure, write_curves};
use plywave_textile::ClothSpec;
use std::f64::consts::PI;

fn no_file(name: &str) -> Result<Vec<u8>, Error> {
    panic!("{name} is not to be read")
}

fn made(text: &str) -> Result<MadeCloth, SimError> {
    let spec = ClothSpec::parse(text, "cloth.toml")?;
    make_cloth(&spec, "cloth.toml", &mut |name| no_file(name), Effort::Full, &|_| true)
}

fn shipped(name: &str) -> String {
    let path = format!("{}/../fabrics/cloths/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    std::fs::read_to_string(path).unwrap()
}

/// Keys of a yarn of fibers of 1.5 g/cm3: a round one without twist, unless its own keys say otherwise.
fn yarn(own: &str) -> String {
    let has = |key: &str| own.lines().any(|line| line.starts_with(&format!("{key} = ")));
    let round = [("packing", "0.6"), ("bundles", "1"), ("twist", "\"none\"")];
    let round = round.iter().filter(|(key, _)| !has(key)).map(|(key, value)| format!("{key} = {value}\n"));
    format!("fiber = \"flax\"\n{}{own}\n", round.collect::<String>())
}

/// A woven spec of so many ends and picks a cm; `warp` and `weft` are the keys of their yarns.
fn woven(weave: &str, [ends, picks]: [f64; 2], warp: &str, weft: &str) -> String {
    format!(
        "name = \"x\"\n[weave]\n{weave}\nends_per_cm = {ends}\npicks_per_cm = {picks}\n[warp]\n{}[weft]\n{}",
        yarn(warp),
        yarn(weft)
    )
}

/// A woven spec whose ends and picks are alike.
fn alike(weave: &str, per_cm: f64, own: &str) -> String {
    woven(weave, [per_cm; 2], own, own)
}

/// Count of a single round yarn of this diameter at density 1.5 and packing 0.6 [tex].
fn tex(diameter_um: f64) -> f64 {
    0.25 * PI * diameter_um * diameter_um * 0.6 * 1.5 / 1000.0
}

/// Crimp of Peirce's plain weave of thin, limp, round yarns: l the length from crossing to crossing, theta
/// the steepest lean, D the sum of the diameters, p the spacing of the crossing yarns, h the crimp height.
///
///     p = (l - D theta) cos theta + D sin theta,   h = (l - D theta) sin theta + D (1 - cos theta)
fn peirce_crimp(spacing: f64, height: f64, diameters: f64) -> f64 {
    let [p, h, d] = [spacing, height, diameters];
    // The straight part is (p - D sin) / cos.
    let off = |theta: f64| (p - d * theta.sin()) * theta.tan() + d * (1.0 - theta.cos()) - h;
    let (mut low, mut high) = (0.0, (h / p).atan() * 2.0);
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        *(if off(middle) < 0.0 { &mut low } else { &mut high }) = middle;
    }
    let straight = (p - d * low.sin()) / low.cos();
    (straight + d * low) / p - 1.0
}

/// Limp round yarns of a plain weave lie as Peirce (1937) has them: crimp heights add up to the diameters,
/// and each yarn is as long as his.
#[test]
fn a_plain_weave_of_round_yarns_is_that_of_peirce() {
    for (diameters, per_cm, tension) in
        [([100.0, 100.0], [50.0, 50.0], 1.0), ([100.0, 100.0], [50.0, 40.0], 3.0), ([90.0, 130.0], [40.0, 36.0], 1.0)]
    {
        let yarn = |k: usize, tension: f64| {
            format!("count = \"{} tex\"\nstiffness = 0.0\ntension = {tension}", tex(diameters[k]))
        };
        let text = woven("kind = \"plain\"", per_cm, &yarn(0, 1.0), &yarn(1, tension));
        let cloth = made(&text).unwrap();
        let lattice = Lattice::new(cloth.curves.cell_um).unwrap();
        let sum = diameters[0] + diameters[1];
        let mut heights = 0.0;
        for (kind, curve) in cloth.curves.curves.iter().enumerate() {
            let z: Vec<f64> =
                (0..curve.control_um.len() * 8).map(|i| curve.at(&lattice, i as f64 / 8.0).point_um[2]).collect();
            let height = z.iter().fold(0.0f64, |m, z| m.max(*z)) - z.iter().fold(0.0f64, |m, z| m.min(*z));
            heights += height;
            let spacing = 1e4 / per_cm[1 - kind];
            let want = peirce_crimp(spacing, height, sum);
            let got = cloth.measures.yarns[kind].crimp;
            println!("{diameters:?} kind {kind}: height {height:.2} um, crimp {got:.5}, Peirce {want:.5}");
            assert!((got - want).abs() < 0.02 * want + 5e-4, "{got} {want}");
        }
        assert!((heights / sum - 1.0).abs() < 0.01, "{heights} {sum}");
    }
}

/// Plies of a yarn that nothing presses lie on touching helices: two and three on a circle of closed form,
/// four on a rhombus.
#[test]
fn twisted_plies_touch_as_helices() {
    for (plies, twist) in [(2, 900.0), (3, 700.0), (4, 500.0)] {
        let yarn =
            format!("count = \"{} tex\"\nplies = {plies}\nply_twist = \"Z {twist}/m\"\nstiffness = 0.1", tex(80.0));
        let cloth = made(&alike("kind = \"layers\"", 9.0, &yarn)).unwrap();
        let lattice = Lattice::new(cloth.curves.cell_um).unwrap();
        let warp: Vec<_> =
            cloth.curves.curves.iter().filter(|c| cloth.curves.yarns[c.yarn as usize].kind == 0).collect();
        let axis_of = |at: [f64; 3], direction: [f64; 2]| at[0] * direction[0] + at[1] * direction[1];
        let (mut sum, mut count) = (0.0, 0.0);
        let way = lattice.vector(warp[0].shift);
        let length = way[0].hypot(way[1]);
        let across = [way[1] / length, -way[0] / length];
        let points: Vec<[f64; 3]> =
            warp.iter().flat_map(|c| (0..c.control_um.len()).map(|i| c.at(&lattice, i as f64).point_um)).collect();
        let mean = |value: &dyn Fn(&[f64; 3]) -> f64| points.iter().map(value).sum::<f64>() / points.len() as f64;
        let center = [mean(&|p| axis_of(*p, across)), mean(&|p| p[2])];
        for p in &points {
            sum += (axis_of(*p, across) - center[0]).hypot(p[2] - center[1]);
            count += 1.0;
        }
        // The twist that the period allows.
        let turns =
            (length / warp[0].shift[1].max(1) as f64 * twist * 1e-6 * f64::from(plies)).round() / f64::from(plies);
        let pitch = length / warp[0].shift[1].max(1) as f64 / turns;
        // All rhombi of four touching circles have one sum of squared distances from the axis, and the length
        // of a helix is a concave function of the squared distance. So the square is the longest of them, and
        // at rest two plies touch in the middle: distances are R and sqrt 3 R.
        let want = match plies {
            4 => 0.5 * (1.0 + 3.0f64.sqrt()) * 40.0,
            _ => ply_circle_um(plies, 40.0, Some(pitch)).unwrap(),
        };
        println!("{plies} plies, pitch {pitch:.0} um: on a circle of {:.3} um, touching {want:.3}", sum / count);
        assert!((sum / count / want - 1.0).abs() < 0.01);
    }
}

/// Plain, 2/2 and 3/1 twill of 28.3 and 36.9 tex cotton, 45 ends and 20 to 27 picks a cm: .48, .53 and .50
/// mm thick, 221 to 249 g/m2 (measured, in print). Nothing is fitted: yarns have Peirce's specific volume,
/// a usual twist, and the cohesion and stiffness of a spec that says nothing.
#[test]
#[ignore = "slow: 20 s: cloths are as thick as measured ones"]
fn cloths_are_as_thick_as_measured_ones() {
    let yarn = |tex: f64| {
        let twist = 4000.0 / tex.sqrt();
        format!("count = \"{tex} tex\"\npacking = 0.77\nbundles = 7\ntwist = \"Z {twist}/m\"")
    };
    for (name, weave, picks, thickness_um) in [
        ("plain", "kind = \"plain\"", 20.0, 480.0),
        ("2/2 twill", "kind = \"twill 2/2\"", 24.0, 530.0),
        ("3/1 twill", "kind = \"twill 3/1\"", 24.0, 500.0),
    ] {
        let text = woven(weave, [45.0, picks], &yarn(28.3), &yarn(36.9));
        let m = made(&text).unwrap().measures;
        println!(
            "{name}: {:.0} um, {:.0} g/m2; measured {thickness_um} um, 221 to 249 g/m2",
            m.thickness_um, m.mass_g_per_m2
        );
        assert!((m.thickness_um / thickness_um - 1.0).abs() < 0.1, "{name}: {}", m.thickness_um);
        assert!((221.0 * 0.9..249.0 * 1.1).contains(&m.mass_g_per_m2), "{name}: {}", m.mass_g_per_m2);
    }
}

/// Every cloth that ships is at rest: plies overlap by 2 % of their radius at most, forces are balanced, none
/// bends more sharply than its own radius, and cloths that are closed are closed.
#[test]
#[ignore = "slow: 60 s: shipped cloths are at rest"]
fn shipped_cloths_are_at_rest() {
    let folder = format!("{}/../fabrics/cloths", env!("CARGO_MANIFEST_DIR"));
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "toml"))
        // Those of pictures are made of tiles, which are relaxed in tests of their own.
        .filter(|path| !path.with_extension("png").exists())
        .map(|path| path.file_stem().unwrap().to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert!(names.len() >= 9);
    for name in names {
        let cloth = made(&shipped(&name)).unwrap();
        let (m, relaxed) = (&cloth.measures, cloth.relaxed.unwrap());
        println!(
            "{name}: {:.0} um thick, {:.2} % open, {:.0} g/m2, overlap {:.4}, force {:.4}",
            m.thickness_um,
            100.0 * m.openness,
            m.mass_g_per_m2,
            m.overlap,
            relaxed.force
        );
        assert!(m.overlap < 0.02 && relaxed.force < 0.01, "{name}: {m:?} {relaxed:?}");
        assert!(m.yarns.iter().all(|yarn| yarn.least_bend > 1.0), "{name}: {m:?}");
        if ["satin", "denim", "gabardine"].contains(&name.as_str()) {
            assert!(m.openness < 0.005, "{name}: {}", m.openness);
        }
        // The curves are those of the file that they are written to.
        let text = String::from_utf8(write_curves(&cloth.curves, &name, CurveFormat::Toml)).unwrap();
        assert_eq!(ClothCurves::parse(&text, &name).unwrap(), cloth.curves);
    }
}

/// The same bits on any number of threads.
#[test]
fn threads_do_not_change_a_cloth() {
    let text = alike("kind = \"twill 2/1\"", 30.0, "count = \"20 tex\"\nbundles = 3\ntwist = \"Z 700/m\"");
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| made(&text).unwrap().curves)
    };
    assert_eq!(on(1), on(3));
}

/// A knit keeps the length of its loops, and its plies nearly touch.
#[test]
#[ignore = "slow: 33 s: knits keep the length of their loops"]
fn knits_keep_their_loops() {
    for (kind, stitches) in [
        ("jersey", 1.0),
        ("garter", 2.0),
        ("seed", 4.0),
        ("rib", 2.0),
        ("interlock", 4.0),
        ("tricot", 2.0),
        ("chart\"\nchart = [\"KKP\", \"KPK\"]\nx = \"", 6.0),
    ] {
        let keys = format!("kind = \"{kind}\"").replace("\nx = \"\"", "");
        let text = format!(
            "name = \"x\"\n[knit]\n{keys}\nwales_per_cm = 14\ncourses_per_cm = 20\nloop_mm = 2.9\n\
             [yarn]\n{}",
            yarn("count = \"16 tex\"")
        );
        let cloth = made(&text).unwrap_or_else(|e| panic!("{kind}: {e}"));
        let length: f64 = cloth.measures.yarns.iter().map(|yarn| yarn.length_um).sum();
        let of_loop = length / stitches / 1e3;
        println!("{kind}: loops of {of_loop:.3} mm, overlap {:.4}, {:?}", cloth.measures.overlap, cloth.relaxed);
        assert!((of_loop / 2.9 - 1.0).abs() < 0.02, "{kind}: {of_loop}");
        assert!(cloth.measures.overlap < 0.02);
    }
}

/// How far a wall may be off [um], of plies of 65 um.
const WALL_UM: f64 = 4.0;

/// What the numbers say of a cloth is what lines through it meet.
#[test]
fn measures_are_those_of_lines_and_points() {
    let cloth = made(&alike("kind = \"plain\"", 30.0, "count = \"12 tex\"")).unwrap();
    let solid = ClothSolid::new(&cloth.curves).unwrap();
    let lattice = Lattice::new(cloth.curves.cell_um).unwrap();
    let (mut open, mut highest) = (0, f64::NEG_INFINITY);
    let side = 150;
    for i in 0..side {
        for j in 0..side {
            let [s, t] = [i, j].map(|i| (f64::from(i) + 0.5) / f64::from(side));
            let [a, b] = lattice.cell_um;
            let at = [s * a[0] + t * b[0], s * a[1] + t * b[1]];
            match solid.top_at(at) {
                None => open += 1,
                Some((_, z, normal)) => {
                    highest = highest.max(z);
                    assert!((dot(normal, normal) - 1.0).abs() < 1e-6);
                    // Just within the wall is in a ply, just above in none. A line takes the ply as
                    // straight next to it, which moves the wall of a bend by some percent of the radius.
                    let [x, y, z] = std::array::from_fn(|k| [at[0], at[1], z][k] - WALL_UM * normal[k]);
                    assert!(solid.ply_at([x, y, z]).is_some());
                    assert!(solid.ply_at([at[0], at[1], z + 2.0 * WALL_UM]).is_none());
                }
            }
        }
    }
    let openness = f64::from(open) / f64::from(side * side);
    assert!((openness - cloth.measures.openness).abs() < 0.01, "{openness} {}", cloth.measures.openness);
    assert!((2.0 * highest / cloth.measures.thickness_um - 1.0).abs() < 0.02);
    // Mass: length of yarn in a cell times its count.
    let length: f64 = cloth.curves.curves.iter().map(|c| c.length_um(&lattice)).sum();
    let mass = 12.0 * 1e-3 * length * 1e6 / lattice.area_um2();
    assert!((cloth.measures.mass_g_per_m2 / mass - 1.0).abs() < 1e-9);
}

/// A cloth comes back from the files of other programs.
#[test]
fn curves_come_back_from_files() {
    let plied = "count = \"20 tex\"\nplies = 2\nply_twist = \"Z 600/m\"";
    let cloth = made(&alike("kind = \"twill 2/1\"", 18.0, plied)).unwrap();
    let [a, b] = cloth.curves.cell_um;
    for (ending, cell) in
        [("bcc", format!("cell_um = [{a:?}, {b:?}]\n")), ("tg3", String::new()), ("toml", String::new())]
    {
        let file = format!("x.{ending}");
        let bytes = write_curves(&cloth.curves, "x", CurveFormat::of(&file).unwrap());
        // Our own format tells the kinds of yarns, those of others do not.
        let yarns = if ending == "toml" { ["warp", "weft"].as_slice() } else { &["yarn"] };
        let yarns: String = yarns.iter().map(|name| format!("[{name}]\n{}", yarn("count = \"20 tex\""))).collect();
        let text = |relax: &str| format!("name = \"x\"\n[curves]\nfile = \"{file}\"\n{cell}{relax}{yarns}");
        let spec = ClothSpec::parse(&text(""), "cloth.toml").unwrap();
        let back = make_cloth(&spec, "cloth.toml", &mut |_| Ok(bytes.clone()), Effort::Full, &|_| true).unwrap();
        let (lattice, other) =
            (Lattice::new(cloth.curves.cell_um).unwrap(), Lattice::new(back.curves.cell_um).unwrap());
        assert_eq!(back.curves.curves.len(), cloth.curves.curves.len());
        for (x, y) in cloth.curves.curves.iter().zip(&back.curves.curves) {
            assert_eq!(x.shift, y.shift);
            assert!((x.radius_um / y.radius_um - 1.0).abs() < 1e-4);
            for i in 0..x.control_um.len() {
                let (p, q) = (x.at(&lattice, i as f64 + 0.3).point_um, y.at(&other, i as f64 + 0.3).point_um);
                assert!((0..3).all(|k| (p[k] - q[k]).abs() < 0.02), "{ending}: {p:?} {q:?}");
            }
        }
        // As they came, the plies touch as before.
        assert!((back.measures.overlap - cloth.measures.overlap).abs() < 2e-3);
        // Relaxed they stay in place but for the bending, and keep their lengths.
        let spec = ClothSpec::parse(&text("relax = true\n"), "cloth.toml").unwrap();
        let again = make_cloth(&spec, "cloth.toml", &mut |_| Ok(bytes.clone()), Effort::Full, &|_| true).unwrap();
        assert!(again.measures.overlap < 0.02 && again.relaxed.is_some());
        assert!((again.measures.thickness_um / cloth.measures.thickness_um - 1.0).abs() < 0.05);
    }
}

/// What cannot be woven is refused in one line that says what could.
#[test]
fn impossible_cloths_are_refused() {
    const COUNT: &str = "count = \"30 tex\"";
    let plain = |ends: f64, picks: f64| woven("kind = \"plain\"", [ends, picks], COUNT, COUNT);
    let message = made(&plain(70.0, 70.0)).unwrap_err().to_string();
    println!("{message}");
    assert!(message.contains("too thick") && message.lines().count() == 1, "{message}");
    // The density that it names goes.
    let number = |after: &str| -> f64 {
        let rest = &message[message.find(after).unwrap() + after.len()..];
        rest.split_whitespace().next().unwrap().parse().unwrap()
    };
    let (ends, picks) = (number("at most "), number(" ends and "));
    assert!(made(&plain(ends, picks)).is_ok(), "{ends} {picks}");
    for (weave, want) in [
        ("kind = \"draft\"\nrows = [\"XX\", \".X\"]", "every row and every column"),
        ("kind = \"draft\"\nrows = [\"X.\", \"X.\"]", "bind every yarn"),
    ] {
        let message = made(&alike(weave, 10.0, COUNT)).unwrap_err().to_string();
        assert!(message.contains(want) && message.lines().count() == 1, "{message}");
    }
    // A draft without end is no work for a machine of two cores.
    let row = |shift: usize| -> String {
        let up = |end: usize| (end + shift * shift * 7 + (end * shift) % 11) % 5 < 2;
        (0..1500).map(|end| if up(end) { 'X' } else { '.' }).collect()
    };
    let rows: Vec<String> = (0..1501).map(|pick| format!("\"{}\"", row(pick))).collect();
    let large = format!("kind = \"draft\"\nrows = [{}]", rows.join(", "));
    // So fine that its floats are short.
    let message = made(&alike(&large, 100.0, COUNT)).unwrap_err().to_string();
    assert!(message.contains("the repeat is too large: ") && message.lines().count() == 1, "{message}");
    // Two cloths that no yarn joins are told, and lie one above the other.
    let rows = "kind = \"draft\"\nrows = [\"X.XX\", \"..X.\", \"XXX.\", \"X...\"]";
    let double = made(&alike(rows, 28.0, COUNT)).unwrap();
    assert!(double.notes.iter().any(|note| note.contains("falls apart into 2 cloths")), "{:?}", double.notes);
    let height = |end: i32| {
        let index = double.curves.yarns.iter().position(|y| (y.kind, y.number) == (0, end)).unwrap() as u32;
        let curve = double.curves.curves.iter().find(|c| c.yarn == index).unwrap();
        curve.control_um.iter().map(|p| p[2]).sum::<f64>() / curve.control_um.len() as f64
    };
    assert!(height(0) > height(1) + 150.0, "{} {}", height(0), height(1));
    let curves = |points: &str| {
        let text = format!("name = \"x\"\n[curves]\nfile = \"x.tg3\"\n[yarn]\n{}", yarn("count = \"20 tex\""));
        let spec = ClothSpec::parse(&text, "cloth.toml").unwrap();
        let nodes: String = points.split(';').map(|p| format!("<MasterNode Position=\"{p}\"/>")).collect();
        let repeats = "<Repeat value=\"1, 0, 0\"/><Repeat value=\"0, 1, 0\"/>";
        let yarns =
            format!("<Yarn><YarnSection><Section Width=\"0.2\" Height=\"0.2\"/></YarnSection>{repeats}{nodes}</Yarn>");
        let file = format!("<TexGenModel><Textile>{yarns}{yarns}</Textile></TexGenModel>");
        make_cloth(&spec, "cloth.toml", &mut |_| Ok(file.clone().into_bytes()), Effort::Full, &|_| true)
            .unwrap_err()
            .to_string()
    };
    let message = curves("0, 0, 0;0.25, 0, 0;0.5, 0.2, 0;0.75, 0.5, 0;0.8, 0.6, 0");
    assert!(message.contains("curve 1 is not periodic"), "{message}");
    let message = curves("0, 0, 0;0.25, 0, 0;0.5, 0, 0;0.75, 0, 0;1, 0, 0");
    assert!(message.contains("yarn 1 and yarn 2 overlap"), "{message}");
}

/// A pressed cloth is as thick as it is told, and its yarns are wider.
#[test]
fn pressing_flattens_yarns() {
    let text = alike("kind = \"plain\"", 20.0, "count = \"20 tex\"\nbundles = 7\npacking = 0.77");
    let [loose, pressed] =
        [text.clone(), text.replace("[weave]", "thickness_um = 190\n[weave]")].map(|t| made(&t).unwrap());
    let (l, p) = (&loose.measures, &pressed.measures);
    println!("{l:?}\n{p:?}");
    assert!(l.thickness_um > 210.0 && (p.thickness_um - 190.0).abs() < 3.0, "{} {}", l.thickness_um, p.thickness_um);
    let width = |m: &plywave_sim::cloth::ClothMeasures| m.yarns.iter().map(|y| y.width_um).sum::<f64>();
    assert!(width(p) > width(l) + 5.0);
    let lattice = Lattice::new(pressed.curves.cell_um).unwrap();
    assert!(measure(&pressed.curves, &lattice, &[]).unwrap().mass_g_per_m2 == 0.0);
}

/// A cloth whose forces are above the limit is told of, with the force, the limit and what helps.
#[test]
fn a_cloth_that_does_not_come_to_rest_is_told_of() {
    let yarn = "fiber = \"flax\"\ncount = \"20 tex\"\nbundles = 1\n";
    let text = format!(
        "name = \"x\"\n[weave]\nkind = \"plain\"\nends_per_cm = 20\npicks_per_cm = 20\n[warp]\n{yarn}[weft]\nas = \"warp\"\n"
    );
    let mut cloth = made(&text).unwrap();
    assert_eq!(cloth.unrest(), None);
    for (force, is_told) in [(0.049, false), (0.06, true), (f64::NAN, true)] {
        cloth.relaxed.as_mut().unwrap().force = force;
        let told = cloth.unrest();
        assert_eq!(told.is_some(), is_told, "{force}: {told:?}");
        for words in [&format!("{force:.2} of the tension")[..], "0.05 is the limit", "wider spacings or stitches"] {
            assert!(told.iter().all(|line| line.contains(words)), "{told:?}: {words}");
        }
    }
}
