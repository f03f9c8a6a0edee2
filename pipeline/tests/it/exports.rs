//! Exports of a cloth, read again: energy, reciprocity, headers and counts.
//!
//! 1. Clear fibers lose nothing: R + T of every patch is 1.
//! 2. A matrix has, patch by patch, the R and T that samples of the cloth have.
//! 3. Files parsed again have their counts, and sums that are those of the matrix.
//! 4. What a format cannot hold is told with its energy; bad options are refused.

use plywave::cloth::ClothData;
use plywave_pipeline::exports::*;
use plywave_pipeline::{ClothRecipe, Run, model_library};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::sync::atomic::AtomicBool;

static ORGANZA: LazyLock<ClothData> = LazyLock::new(|| {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fabrics/cloths");
    let recipe = ClothRecipe::load(folder.join("organza.toml")).unwrap();
    let models = recipe.plies(&model_library()).unwrap().build(&Run::plain()).unwrap().models;
    let curves = recipe.curves(&Run::plain()).unwrap();
    recipe.make(&curves, &models, true, &Run::plain()).unwrap()
});

fn cloth(sigma: Option<f64>) -> MeanCloth {
    MeanCloth::new(&ORGANZA, sigma, BeyondVisible::default()).unwrap()
}

/// Of few directions a patch: the mean over the cell is a table.
fn coarse(cloth: &MeanCloth, basis: Basis) -> Matrix {
    Matrix::new(cloth, basis, Steps { incident: 2, outgoing: 2 }, &Run::plain()).unwrap()
}

fn exported(format: Format, name: &str, options: &ExportOptions) -> Exported {
    export(&ORGANZA, format, &[PathBuf::from(name)], options, &Run::plain()).unwrap()
}

#[test]
#[ignore = "slow: 10 s: energy of all patches"]
fn clear_cloths_lose_nothing_and_are_reciprocal() {
    let matrix = coarse(&cloth(Some(0.0)), Basis::Klems);
    let mut worst = 0.0f64;
    for side in 0..2 {
        for patch in 0..145 {
            let sum: f64 = (0..2).map(|half| matrix.energy(side, half, 0, patch)).sum();
            worst = worst.max((sum - 1.0).abs());
        }
    }
    println!("R + T is off by at most {worst}; {:?}", matrix.balanced);
    assert!(worst < 2e-3, "{worst}");
    // Balancing mends a quadrature, it does not make the light: without it patches were nearly right.
    assert!(matrix.balanced.energy_change < 0.03 && matrix.balanced.asymmetry < 0.05, "{:?}", matrix.balanced);
    // Of no absorption, visible and solar are one.
    assert!((matrix.hemispherical(0, 0, 0) - matrix.hemispherical(0, 0, 1)).abs() < 1e-6);
    assert!(matrix.asymmetry() < 1e-6, "{}", matrix.asymmetry());
}

/// The table of the mean beside samples at points, which share no code but the cloth.
#[test]
#[ignore = "slow: 10 s: a matrix beside samples"]
fn matrices_have_the_energy_of_samples() {
    let cloth = cloth(None);
    let (matrix, bands) = (coarse(&cloth, Basis::Klems), Bands::new());
    for (side, patch) in [(0, 0), (0, 20), (0, 60), (0, 110), (1, 5), (1, 90)] {
        let wo = |u: [f64; 2]| incident(Basis::Klems.disk(patch, u), side == 0);
        let batches = cloth.energies(&wo, 1 << 14, 7);
        for (half, name) in ["R", "T"].into_iter().enumerate() {
            let of = |e: &Energies| match half {
                0 => bands.visible(&e.reflected),
                _ => e.straight + bands.visible(&e.transmitted),
            };
            let want = Estimate::of(&batches.iter().map(of).collect::<Vec<_>>());
            let got = matrix.energy(side, half, 0, patch);
            // The table's own error beside five standard errors.
            let limit = 0.012 + 5.0 * want.se;
            assert!((got - want.value).abs() < limit, "side {side}, patch {patch}, {name}: {got}, {want:?}");
        }
    }
}

fn text(exported: &Exported) -> &str {
    std::str::from_utf8(&exported.files[0].1).unwrap()
}

fn child<'a>(node: roxmltree::Node<'a, 'a>, name: &str) -> roxmltree::Node<'a, 'a> {
    node.descendants().find(|n| n.tag_name().name() == name).unwrap_or_else(|| panic!("no {name}"))
}

#[test]
#[ignore = "slow: 10 s: a whole file of Klems"]
fn klems_files_are_read_again() {
    let out = exported(Format::Klems, "o.xml", &ExportOptions::default());
    let document = roxmltree::Document::parse(text(&out)).unwrap();
    let root = document.root_element();
    assert_eq!(root.tag_name().name(), "WindowElement");
    assert_eq!(root.tag_name().namespace(), Some("http://windows.lbl.gov"));
    assert_eq!(child(root, "IncidentDataStructure").text(), Some("Columns"));
    let rings: Vec<usize> = root
        .descendants()
        .filter(|n| n.tag_name().name() == "nPhis")
        .map(|n| n.text().unwrap().parse().unwrap())
        .collect();
    assert_eq!(rings, [1, 8, 16, 20, 24, 24, 24, 16, 12]);
    let mut seen = Vec::new();
    for data in root.descendants().filter(|n| n.tag_name().name() == "WavelengthData") {
        let band = child(data, "Wavelength").text().unwrap().to_string();
        let direction = child(data, "WavelengthDataDirection").text().unwrap().to_string();
        let numbers: Vec<f64> = child(data, "ScatteringData")
            .text()
            .unwrap()
            .split(',')
            .filter(|s| !s.trim().is_empty())
            .map(|s| s.trim().parse().unwrap())
            .collect();
        assert_eq!(numbers.len(), 145 * 145, "{band} {direction}");
        assert!(numbers.iter().all(|v| (0.0..1e4).contains(v)));
        // Mean over incident light, by the sum over the file alone.
        let omega = |patch: usize| Basis::Klems.projected_solid_angle(patch);
        let mut sum = 0.0;
        for o in 0..145 {
            for i in 0..145 {
                sum += numbers[o * 145 + i] * omega(o) * omega(i) / PI;
            }
        }
        let name = match (band.as_str(), direction.as_str()) {
            ("Visible", "Reflection Front") => "front_visible_reflectance",
            ("Visible", "Transmission Front") => "front_visible_transmittance",
            ("Visible", "Reflection Back") => "back_visible_reflectance",
            ("Visible", "Transmission Back") => "back_visible_transmittance",
            ("Solar", "Reflection Front") => "front_solar_reflectance",
            ("Solar", "Transmission Front") => "front_solar_transmittance",
            _ => "",
        };
        if let Some((_, fact)) = out.facts.iter().find(|(fact, _)| *fact == name) {
            assert!((sum - fact).abs() < 1e-5, "{name}: {sum}, {fact}");
        }
        seen.push((band, direction));
    }
    seen.sort();
    seen.dedup();
    assert_eq!(seen.len(), 8);
    assert!(out.notes.iter().any(|note| note.contains("above 0.78 um (39.6 %)")), "{:?}", out.notes);
}

/// Values of a tensor tree, cube by cube: `(volume, value)`.
fn cubes<'a>(tokens: &mut impl Iterator<Item = &'a str>, volume: f64, out: &mut Vec<(f64, f64)>) {
    // After the brace of this node.
    let mut values: Vec<f64> = Vec::new();
    let mut parts = 0;
    loop {
        match tokens.next().expect("an open brace") {
            "{" => {
                parts += 1;
                cubes(tokens, volume / 16.0, out);
            }
            "}" => break,
            number => values.push(number.parse().unwrap()),
        }
    }
    match (parts, values.len()) {
        (0, 1 | 16) => {
            let share = volume / values.len() as f64;
            out.extend(values.iter().map(|v| (share, *v)));
        }
        (16, 0) => {}
        other => panic!("{other:?}"),
    }
}

#[test]
fn tensor_trees_are_read_again() {
    let options = ExportOptions { squares: 8, ..ExportOptions::default() };
    let out = exported(Format::TensorTree, "o.xml", &options);
    let document = roxmltree::Document::parse(text(&out)).unwrap();
    let root = document.root_element();
    assert_eq!(child(root, "IncidentDataStructure").text(), Some("TensorTree4"));
    let mut blocks = 0;
    for data in root.descendants().filter(|n| n.tag_name().name() == "WavelengthData") {
        blocks += 1;
        assert_eq!(child(data, "AngleBasis").text(), Some("LBNL/Shirley-Chiu"));
        let spaced = child(data, "ScatteringData").text().unwrap().replace('{', " { ").replace('}', " } ");
        let mut tokens = spaced.split_whitespace();
        assert_eq!(tokens.next(), Some("{"));
        let mut all = Vec::new();
        cubes(&mut tokens, 1.0, &mut all);
        assert_eq!(tokens.next(), None);
        let volume: f64 = all.iter().map(|(volume, _)| volume).sum();
        assert!((volume - 1.0).abs() < 1e-9, "{volume}");
        let (band, direction) = (child(data, "Wavelength").text(), child(data, "WavelengthDataDirection").text());
        if (band, direction) == (Some("Visible"), Some("Transmission Front")) {
            // Squares have equal projected solid angles, of all pi.
            let mean = PI * all.iter().map(|(volume, value)| volume * value).sum::<f64>();
            let want = out.facts.iter().find(|(name, _)| *name == "front_visible_transmittance").unwrap().1;
            assert!((mean - want).abs() < 1e-4, "{mean} {want}");
        }
    }
    assert_eq!(blocks, 8);
}

/// A cloth of fibers that are alike, of another spec.
fn with_spec(of: impl Fn(&str) -> String) -> ClothData {
    ClothData { spec_text: of(&ORGANZA.spec_text), ..ORGANZA.clone() }
}

/// Thermal fields have the names that LBNL's readers know and, without keys in the spec, what follows from
/// the energies: fabrics of the pyWinCalc examples emit 0.894 and 0.898 of what does not go through.
#[test]
fn files_of_windows_have_heat() {
    let options = ExportOptions { squares: 8, ..ExportOptions::default() };
    let fields = |data: &ClothData| -> Vec<f64> {
        let out = export(data, Format::TensorTree, &[PathBuf::from("o.xml")], &options, &Run::plain()).unwrap();
        let document = roxmltree::Document::parse(text(&out)).unwrap();
        let material = child(document.root_element(), "Material");
        assert_eq!(child(material, "Thickness").attribute("unit"), Some("meter"));
        ["Thickness", "ThermalConductivity", "EmissivityFront", "EmissivityBack", "TIR", "PermeabilityFactor"]
            .map(|name| child(material, name).text().unwrap().parse().unwrap())
            .to_vec()
    };
    let usual = fields(&ORGANZA);
    let [thickness, conductivity, front, back, through, open] = usual[..] else { panic!("{usual:?}") };
    let half_um = f64::from(cloth(None).points().lines().half_thickness_um());
    assert!((thickness - 2e-6 * half_um).abs() < 1e-9 && conductivity == 0.15, "{usual:?}");
    // Samples of the cloth, which share no code with the patches and the lines.
    let cloth = cloth(None);
    let sampled = |wo: &(dyn Fn([f64; 2]) -> [f32; 3] + Sync), of: &dyn Fn(&Energies) -> f64| {
        Estimate::of(&cloth.energies(wo, 1 << 14, 3).iter().map(of).collect::<Vec<_>>())
    };
    let cosine = |u: [f64; 2]| {
        let (sin, cos) = (2.0 * PI * u[1]).sin_cos();
        [(u[0].sqrt() * cos) as f32, (u[0].sqrt() * sin) as f32, (1.0 - u[0]).max(1e-5).sqrt() as f32]
    };
    let want = sampled(&cosine, &|e| e.straight);
    assert!((through - want.value).abs() < 0.005 + 5.0 * want.se, "TIR {through}, {want:?}");
    let want = sampled(&|_| [0.0, 0.0, 1.0], &|e| e.open);
    assert!((open - want.value).abs() < 0.01 + 5.0 * want.se, "open {open}, {want:?}");
    for emitted in [front, back] {
        assert!((emitted / (1.0 - through) - 0.896).abs() < 0.01, "{emitted} of {}", 1.0 - through);
    }
    // Keys of the spec are taken as they are; what is given leaves no more for the rest.
    let given = "\n[thermal]\nthickness_um = 480.0\nconductivity_w_per_m_k = 0.12\nemissivity_front = 0.835\nemissivity_back = 0.8\nir_transmittance = 0.07\npermeability = 0.038528\n";
    assert_eq!(fields(&with_spec(|spec| format!("{spec}{given}"))), [0.00048, 0.12, 0.835, 0.8, 0.07, 0.038528]);
    let part = fields(&with_spec(|spec| format!("{spec}\n[thermal]\nemissivity_back = 0.95\n")));
    assert!(part[3] == 0.95 && (part[4] - 0.05).abs() < 1e-6 && part[2] > 0.85 * 0.95, "{part:?}");
}

/// Formats beside each other share no file, and replace none but their own.
#[test]
fn files_of_another_origin_stay() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let mains: Vec<(Format, PathBuf)> =
        Format::ALL.into_iter().map(|format| (format, at(&format!("o.{}", format.endings()[0])))).collect();
    let mut all: Vec<PathBuf> = Vec::new();
    for (format, main) in mains.iter().filter(|(format, _)| ![Format::TensorTree, Format::Mitsuba].contains(format)) {
        all.extend(format.outputs(std::slice::from_ref(main)));
    }
    let count = all.len();
    all.sort();
    all.dedup();
    assert_eq!((all.len(), count), (4 + 9 + 10 + 9, 4 + 9 + 10 + 9), "{all:?}");
    assert_eq!(Format::Mitsuba.outputs(&[at("m.xml")]).len(), 6);
    // What two formats would both write is refused by the second.
    let options = ExportOptions { squares: 8, samples: 1024, pixels: 16, ..ExportOptions::default() };
    let views = vec![View { tilt_rad: 0.0, azimuth_rad: 0.0, is_face: true }];
    let options = ExportOptions { views, ..options };
    for (format, name) in [
        (Format::TensorTree, "o.xml"),
        (Format::Report, "o.md"),
        (Format::Report, "o.csv"),
        (Format::Report, "o.json"),
        (Format::Report, "o.html"),
    ] {
        let mains = [at(name)];
        format.check_outputs(&mains).unwrap();
        export(&ORGANZA, format, &mains, &options, &Run::plain()).unwrap().save().unwrap();
        format.check_outputs(&mains).unwrap();
        for other in Format::ALL.into_iter().filter(|other| *other != format) {
            let message = other.check_outputs(&mains).unwrap_err().to_string();
            assert!(message.contains(name) && message.contains("--force"), "{message}");
        }
    }
    std::fs::write(at("p.md"), "notes of mine").unwrap();
    assert!(Format::Report.check_outputs(&[at("q.md"), at("p.md")]).is_err());
}

fn number<const N: usize>(bytes: &[u8], at: &mut usize) -> u64 {
    let mut all = [0; 8];
    all[..N].copy_from_slice(&bytes[*at..*at + N]);
    *at += N;
    u64::from_le_bytes(all)
}

#[test]
fn rgl_files_are_read_again() {
    let options = ExportOptions { samples: 4096, ..ExportOptions::default() };
    for is_spectral in [false, true] {
        let out = exported(Format::Rgl, "o.bsdf", &ExportOptions { is_spectral, ..options.clone() });
        let bytes = &out.files[0].1;
        assert!(bytes.starts_with(b"tensor_file\0\x01\x00"));
        let mut at = 14;
        let mut fields = std::collections::BTreeMap::new();
        for _ in 0..number::<4>(bytes, &mut at) {
            let length = number::<2>(bytes, &mut at) as usize;
            let name = String::from_utf8(bytes[at..at + length].to_vec()).unwrap();
            at += length;
            let axes = number::<2>(bytes, &mut at) as usize;
            let kind = number::<1>(bytes, &mut at);
            let offset = number::<8>(bytes, &mut at) as usize;
            let shape: Vec<usize> = (0..axes).map(|_| number::<8>(bytes, &mut at) as usize).collect();
            let size = if kind == 10 { 4 } else { 1 };
            assert!(
                offset.is_multiple_of(8) && offset + size * shape.iter().product::<usize>() <= bytes.len(),
                "{name}"
            );
            fields.insert(name, (offset, shape));
        }
        let (rgb, spectra) = (fields.contains_key("rgb"), fields.contains_key("spectra"));
        assert_eq!((rgb, spectra), (!is_spectral, is_spectral));
        let floats = |name: &str| -> Vec<f32> {
            let (offset, shape) = &fields[name];
            let count = shape.iter().product::<usize>();
            bytes[*offset..*offset + 4 * count].as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
        };
        let (phi, theta) = (floats("phi_i"), floats("theta_i"));
        assert!(theta[0] == 0.0 && (f64::from(phi[phi.len() - 1] - phi[0]) - 2.0 * PI).abs() < 1e-5);
        let luminance = floats("luminance");
        assert!(luminance.iter().all(|v| v.is_finite() && *v >= 0.0));
        // By the half vectors of light along the normal, its reflectance: the sum of f times solid angle.
        let shape = &fields["luminance"].1;
        let (rows, columns) = (shape[2], shape[3]);
        let view = &luminance[..rows * columns];
        let step = 1.0 / ((rows - 1) * (columns - 1)) as f64;
        let mut sum = 0.0;
        for y in 0..rows - 1 {
            for x in 0..columns - 1 {
                let corners = [y * columns + x, y * columns + x + 1, (y + 1) * columns + x, (y + 1) * columns + x + 1];
                sum += 0.25 * step * corners.iter().map(|at| f64::from(view[*at])).sum::<f64>();
            }
        }
        let bands = Bands::new();
        let batches = cloth(None).energies(&|_| [0.0, 0.0, 1.0], 1 << 14, 5);
        let want = Estimate::of(&batches.iter().map(|e| bands.visible(&e.reflected)).collect::<Vec<_>>());
        println!("R along the normal {sum}, {want:?}");
        assert!((sum - want.value).abs() < 0.02 * want.value + 5.0 * want.se, "{sum}, {want:?}");
        let left: f64 = out.facts.iter().filter(|(name, _)| name.ends_with("left_out")).map(|(_, v)| v).sum();
        assert!(left > 0.3 && out.notes[0].contains("are left out"), "{left}: {:?}", out.notes);
    }
}

#[test]
fn reports_have_standard_errors_and_say_what_they_assume() {
    let views = vec![View { tilt_rad: 0.5, azimuth_rad: 0.3, is_face: true }];
    let options = ExportOptions { samples: 4096, views, ..ExportOptions::default() };
    let out = exported(Format::Report, "o.json", &options);
    let report: serde_json::Value = serde_json::from_str(text(&out)).unwrap();
    let row = &report["rows"][0];
    let of = |name: &str| (row[name]["value"].as_f64().unwrap(), row[name]["se"].as_f64().unwrap());
    let sum = of("solar_reflected").0 + of("solar_transmitted").0 + of("solar_absorbed").0;
    assert!((sum - 1.0).abs() < 1e-9, "{sum}");
    assert!(of("reflected").1 > 0.0 && of("reflected").1 < 0.02 && of("straight").0 >= of("openness").0);
    assert!(of("into_cone").0 >= of("straight").0 && of("transmitted").0 >= of("into_cone").0);
    assert!(report["upf"].is_null() && out.notes.iter().any(|note| note.starts_with("UPF is not computed")));
    // An absorption of the ultraviolet gives one, of light that black fibers block: 1 over the rest.
    let beyond = BeyondVisible { uv_per_um: Some(10.0), ir_per_um: Some(0.0) };
    let with = exported(Format::Report, "o.json", &ExportOptions { beyond, ..options.clone() });
    let with: serde_json::Value = serde_json::from_str(text(&with)).unwrap();
    let (upf, open) =
        (with["upf"]["value"].as_f64().unwrap(), with["normal"][0]["straight"]["value"].as_f64().unwrap());
    assert!(upf > 1.0 && upf <= 1.0 / open + 1e-9, "{upf} {open}");
    // Clear in the infrared, more of the sun is scattered.
    let solar = |report: &serde_json::Value| report["normal"][0]["solar_absorbed"]["value"].as_f64().unwrap();
    assert!(solar(&with) < solar(&report));
    // Several files of one report.
    let mains = ["o.csv", "a/o.md", "o.html", "o.json"].map(PathBuf::from);
    let all = export(&ORGANZA, Format::Report, &mains, &options, &Run::plain()).unwrap();
    let paths: Vec<&PathBuf> = all.files.iter().map(|(path, _)| path).collect();
    assert_eq!(paths, mains.iter().collect::<Vec<_>>());
    for (_, bytes) in &all.files[..3] {
        let text = std::str::from_utf8(bytes).unwrap();
        assert!(text.contains("28.648") && text.lines().count() > 3, "{text}");
    }
    assert_eq!(all.files[3].1, out.files[0].1, "as the one file is");
    let columns: Vec<usize> = text(&all).lines().map(|line| line.split(',').count()).collect();
    assert!(columns.iter().all(|n| *n == columns[0]), "{columns:?}");
}

/// Materials are as near to the cloth's pictures as each renderer's formulas allow, with no number at a
/// bound, and the index of the fibers; Cycles has a closure for light that goes on forward, others do not.
#[test]
#[ignore = "slow: 25 s: four fits"]
fn materials_look_like_the_cloth() {
    let options = ExportOptions { pixels: 16, ..ExportOptions::default() };
    for (format, name, front, behind) in [
        (Format::OpenPbr, "o.mtlx", 0.15, 0.55),
        (Format::Gltf, "o.glb", 0.07, 0.55),
        (Format::Mitsuba, "o.xml", 0.07, 0.55),
        (Format::Blender, "o.py", 0.07, 0.1),
    ] {
        let out = exported(format, name, &options);
        let fact = |name: &str| out.facts.iter().find(|(fact, _)| *fact == name).unwrap().1;
        assert!(fact("mean_color_off_in_front") < front, "{format:?}: {:?}", out.facts);
        assert!(fact("mean_color_off_behind") < behind, "{format:?}: {:?}", out.facts);
        let ratio = |what: &str| fact(&format!("{what}_of_the_material")) / fact(&format!("{what}_of_the_cloth"));
        assert!((0.75..1.1).contains(&ratio("reflectance")), "{format:?}: {:?}", out.facts);
        assert!((0.9..1.2).contains(&ratio("transmittance")), "{format:?}: {:?}", out.facts);
        assert!((fact("ior") - 1.556).abs() < 1e-3, "{format:?}: {}", fact("ior"));
        assert!(!out.notes.iter().any(|note| note.contains(" ended at ")), "{format:?}: {:?}", out.notes);
        if format == Format::Blender {
            let code = text(&out);
            assert!(code.contains("CLOTH = {") && code.contains("\"sheen_roughness\"") && code.contains("def build"));
        }
        if format == Format::Mitsuba {
            let document = roxmltree::Document::parse(text(&out)).unwrap();
            assert!(child(document.root_element(), "bsdf").attribute("id").is_some());
        }
        let main = [PathBuf::from(name)];
        let names: Vec<&PathBuf> = out.files.iter().map(|(path, _)| path).collect();
        assert_eq!(names, format.outputs(&main).iter().collect::<Vec<_>>(), "{format:?}");
    }
}

#[test]
#[ignore = "slow: 20 s: two fits"]
fn materials_are_whole_and_near_the_cloth() {
    let options = ExportOptions { pixels: 32, ..ExportOptions::default() };
    let out = exported(Format::Usd, "o.usda", &options);
    let names: Vec<&str> = out.files.iter().map(|(name, _)| name.to_str().unwrap()).collect();
    assert_eq!(&names[..3], ["o.usda", "o_usd.mtlx", "o_usd_maps/base_color.png"]);
    let mtlx = std::str::from_utf8(&out.files[1].1).unwrap();
    let document = roxmltree::Document::parse(mtlx).unwrap();
    let root = document.root_element();
    assert_eq!((root.tag_name().name(), root.attribute("version")), ("materialx", Some("1.39")));
    // Every file that is named is there, and a PNG of the repeat's proportions.
    let mut images = 0;
    for input in root.descendants().filter(|n| n.attribute("type") == Some("filename")) {
        let file = input.attribute("value").unwrap();
        let (_, bytes) = out.files.iter().find(|(name, _)| name == Path::new(file)).unwrap();
        let reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        assert_eq!((reader.info().width, reader.info().height), (32, 32), "{file}");
        images += 1;
    }
    assert_eq!(images, 8);
    for node in root.descendants().filter(|n| n.has_attribute("nodename")) {
        let name = node.attribute("nodename").unwrap();
        assert!(root.descendants().any(|n| n.attribute("name") == Some(name)), "{name}");
    }
    let fact = |name: &str| out.facts.iter().find(|(fact, _)| *fact == name).unwrap().1;
    let off =
        |what: &str| (fact(&format!("{what}_of_the_material")) / fact(&format!("{what}_of_the_cloth")) - 1.0).abs();
    assert!(off("reflectance") < 0.15 && off("transmittance") < 0.15, "{:?}", out.facts);
    assert!(out.notes.iter().any(|note| note.contains("fitted to pictures")), "{:?}", out.notes);

    // All of them are known again as this format's, and of no other.
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in &out.files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    let mains = [folder.path().join("o.usda")];
    let files = Format::Usd.outputs(&mains);
    assert!(files.len() == 10 && files.iter().all(|file| file.is_file()), "{files:?}");
    Format::Usd.check_outputs(&mains).unwrap();
    for file in files {
        assert!(Format::OpenPbr.check_outputs(std::slice::from_ref(&file)).is_err(), "{}", file.display());
    }

    let out = exported(Format::Gltf, "o.glb", &options);
    let bytes = &out.files[0].1;
    let mut at = 4;
    assert!(bytes.starts_with(b"glTF") && number::<4>(bytes, &mut at) == 2);
    assert_eq!(number::<4>(bytes, &mut at) as usize, bytes.len());
    let length = number::<4>(bytes, &mut at) as usize;
    let json: serde_json::Value = serde_json::from_slice(&bytes[at + 4..at + 4 + length]).unwrap();
    let material = &json["materials"][0];
    for name in json["extensionsUsed"].as_array().unwrap() {
        assert!(material["extensions"].get(name.as_str().unwrap()).is_some(), "{name}");
    }
    let binary = json["buffers"][0]["byteLength"].as_u64().unwrap() as usize;
    for view in json["bufferViews"].as_array().unwrap() {
        let end = view["byteOffset"].as_u64().unwrap() + view["byteLength"].as_u64().unwrap();
        assert!(end as usize <= binary);
    }
}

#[test]
fn bad_exports_are_refused_and_stopped() {
    let refused = |format: Format, name: &str, options: ExportOptions| {
        export(&ORGANZA, format, &[PathBuf::from(name)], &options, &Run::plain()).unwrap_err().to_string()
    };
    let usual = ExportOptions::default;
    assert!(refused(Format::Klems, "o.bsdf", usual()).contains("name a .xml"));
    assert!(refused(Format::Rgl, "o", usual()).contains("(none)"));
    let options = ExportOptions { squares: 12, ..usual() };
    assert!(refused(Format::TensorTree, "o.xml", options).contains("must be 8, 16 or 32"));
    let options = ExportOptions { sigma_per_um: Some(f64::NAN), ..usual() };
    assert!(refused(Format::Report, "o.md", options).contains("sigma_per_um"));
    let options = ExportOptions { samples: 3, ..usual() };
    assert!(refused(Format::Report, "o.md", options).contains("samples"));
    let stop = AtomicBool::new(true);
    let run = Run { stop: Some(&stop), ..Run::plain() };
    for (format, name) in [(Format::Klems, "o.xml"), (Format::Report, "o.md"), (Format::Rgl, "o.bsdf")] {
        let stopped = export(&ORGANZA, format, &[PathBuf::from(name)], &usual(), &run);
        assert!(matches!(stopped, Err(plywave_pipeline::Error::Interrupted { .. })), "{format:?}");
    }
}
