//! Invariants of the code in ARCHITECTURE.md, checked in the sources: dependencies of crates, circles of
//! files and rooms, access to files, units, unsafe code.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Rust files below a folder, by their path from the root.
fn sources(folder: &str) -> Vec<String> {
    let mut open: Vec<PathBuf> = vec![root().join(folder)];
    let mut found = Vec::new();
    while let Some(at) = open.pop() {
        for entry in std::fs::read_dir(&at).unwrap_or_else(|e| panic!("{}: {e}", at.display())) {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                found.push(path.strip_prefix(root()).unwrap().to_string_lossy().replace('\\', "/"));
            }
        }
    }
    found.sort();
    assert!(!found.is_empty(), "{folder}: no source");
    found
}

/// Lines of a file without comments.
fn code(file: &str) -> Vec<String> {
    let text = std::fs::read_to_string(root().join(file)).unwrap();
    text.lines().map(|line| line.split("//").next().unwrap_or_default().to_owned()).collect()
}

/// Lines of a file before its tests, without comments.
fn production(file: &str) -> Vec<String> {
    if file.ends_with("tests.rs") {
        return Vec::new();
    }
    code(file).into_iter().take_while(|line| line != "mod tests {").collect()
}

/// Dependencies of a crate, without those of its tests.
fn dependencies(manifest: &str) -> BTreeSet<String> {
    let text = std::fs::read_to_string(root().join(manifest)).unwrap();
    let table: toml::Table = text.parse().unwrap();
    table["dependencies"].as_table().unwrap().keys().cloned().collect()
}

/// Crates of the workspace that another one depends on, and those that its tests do; without "plywave".
fn edges(manifest: &str) -> [BTreeSet<String>; 2] {
    let text = std::fs::read_to_string(root().join(manifest)).unwrap();
    let table: toml::Table = text.parse().unwrap();
    let targets = table.get("target").and_then(toml::Value::as_table);
    let tables: Vec<&toml::Table> = std::iter::once(&table)
        .chain(targets.into_iter().flat_map(|t| t.values()).filter_map(|t| t.as_table()))
        .collect();
    ["dependencies", "dev-dependencies"].map(|kind| {
        let all = tables.iter().filter_map(|t| t.get(kind).and_then(toml::Value::as_table));
        all.flat_map(|t| t.keys()).filter_map(|d| d.strip_prefix("plywave")).map(str::to_owned).collect()
    })
}

/// Of each crate those that it depends on, without "plywave"; then those that its tests add.
#[test]
fn crates_depend_on_those_below() {
    let expected: [(&str, &str, &str); 15] = [
        ("Cargo.toml", "", "-check -sim -fit -runs -tables -textile"),
        ("textile/Cargo.toml", " ", ""),
        ("fiber/Cargo.toml", " ", "-check"),
        ("conformance/Cargo.toml", " -fiber", ""),
        ("sim/runs/Cargo.toml", " ", ""),
        ("sim/tables/Cargo.toml", " ", ""),
        ("sim/Cargo.toml", " -runs -tables -textile", "-check"),
        ("sim/wave/Cargo.toml", " -fiber -runs -sim -tables -textile", "-check"),
        ("fit/Cargo.toml", " -fiber -tables", "-check -sim -textile"),
        ("render/Cargo.toml", " -fiber", "-sim -textile"),
        ("capi/Cargo.toml", " -check -fiber", "-sim -textile"),
        ("pipeline/Cargo.toml", " -fiber -fit -models -runs -sim -tables -textile -wave", ""),
        ("cli/Cargo.toml", " -check -fiber -fit -pipeline -render -runs -sim -tables -textile -wave", ""),
        ("python/Cargo.toml", " -check -fiber -fit -pipeline -runs -sim -tables -textile -wave", ""),
        ("viewer/weaver/Cargo.toml", " -models -sim -textile", ""),
    ];
    for (manifest, own, tests) in expected {
        let set = |list: &str| list.split(' ').filter(|d| !d.is_empty()).map(str::to_owned).collect::<BTreeSet<_>>();
        let [found_own, found_tests] = edges(manifest);
        let mut want = set(own);
        if !own.is_empty() {
            want.insert(String::new());
        }
        assert_eq!(found_own, want, "{manifest}");
        assert_eq!(found_tests, set(tests), "{manifest}: tests");
    }
}

/// Folders with sources of crates, and whether files of tests and programs of their own are in them.
const CRATES: [&str; 16] = [
    "src",
    "textile/src",
    "fiber/src",
    "conformance/src",
    "sim/src",
    "sim/runs/src",
    "sim/tables/src",
    "sim/wave/src",
    "fit/src",
    "render/src",
    "pipeline/src",
    "cli/src",
    "capi/src",
    "python/src",
    "viewer/wasm/src",
    "viewer/weaver/src",
];

/// No file uses one that uses it, at whatever distance, and no room (a folder, or a file with its folder) one
/// that uses the room.
#[test]
fn files_and_rooms_use_each_other_one_way() {
    for folder in CRATES {
        let uses = Uses::of(folder);
        let files = uses.edges.iter().map(|(from, to)| (from.join("::"), to.join("::")));
        assert_eq!(circle(files), None, "{folder}: files in a circle");
        for depth in 1..3 {
            let room = |module: &[String]| uses.room(module, depth);
            let rooms = uses.edges.iter().map(|(from, to)| (room(from), room(to)));
            assert_eq!(circle(rooms.filter(|(from, to)| from != to)), None, "{folder}: rooms in a circle");
        }
    }
}

/// Who comes new finds what there is in a room at a glance.
#[test]
fn rooms_have_twenty_files_at_most() {
    for folder in CRATES {
        let mut counts = BTreeMap::<String, usize>::new();
        for file in sources(folder) {
            *counts.entry(file.rsplit_once('/').unwrap().0.into()).or_default() += 1;
        }
        for (room, count) in counts {
            assert!(count <= 20, "{room}: {count} files");
        }
    }
}

/// Paths of `use` and of code in the modules of a crate, resolved to the modules that define what they name.
struct Uses {
    files: BTreeMap<Vec<String>, String>,
    edges: BTreeSet<(Vec<String>, Vec<String>)>,
}

impl Uses {
    fn of(folder: &str) -> Uses {
        let mut files = BTreeMap::new();
        for file in sources(folder) {
            let path = file.strip_prefix(folder).unwrap().trim_start_matches('/').trim_end_matches(".rs");
            let mut module: Vec<String> = path.split('/').map(str::to_owned).collect();
            if matches!(module.last().map(String::as_str), Some("mod" | "lib" | "main")) {
                module.pop();
            }
            files.insert(module, file);
        }
        let texts: BTreeMap<_, _> = files.iter().map(|(module, file)| (module.clone(), bare(file))).collect();
        let mut exports = BTreeMap::new();
        let mut paths = Vec::new();
        for (module, text) in &texts {
            for (statement, is_public) in use_statements(text) {
                for (path, name) in expanded(&statement) {
                    if is_public {
                        exports.insert((module.clone(), name), path.clone());
                    }
                    paths.push((module.clone(), path, is_public));
                }
            }
            paths.extend(paths_in_code(text).into_iter().map(|path| (module.clone(), path, false)));
        }
        let mut edges = BTreeSet::new();
        for (module, path, is_public) in paths {
            let Some(to) = resolved(&files, &exports, &module, &path, 0) else { continue };
            // What a module shows of its own submodules is theirs.
            if to != module && !(is_public && to.starts_with(&module)) {
                edges.insert((module, to));
            }
        }
        Uses { files, edges }
    }

    /// The folder, or the file and folder of one name, in which a module is.
    fn room(&self, module: &[String], depth: usize) -> String {
        let file = &self.files[module];
        let inside = module.len() + usize::from(file.ends_with("/mod.rs"));
        if module.is_empty() || inside <= depth { module.join("/") } else { module[..depth].join("/") }
    }
}

/// Text of a file without comments, texts in quotes and tests.
fn bare(file: &str) -> String {
    let lines = code(file).join("\n");
    let production = lines.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let mut text = String::new();
    let (mut quoted, mut escaped) = (false, false);
    for c in production.replace("'\"'", "' '").chars() {
        match (quoted, c) {
            (true, '\\') => escaped = !escaped,
            (_, '"') if !escaped => quoted = !quoted,
            (true, _) => escaped = false,
            (false, _) => text.push(c),
        }
    }
    // Declarations and imports of tests alone.
    let mut kept = String::new();
    let mut skips = false;
    for line in text.lines() {
        if line.trim() == "#[cfg(test)]" {
            skips = true;
        } else if !skips {
            kept.push_str(line);
            kept.push('\n');
        } else if line.trim_end().ends_with(';') || line.trim_end().ends_with('{') {
            skips = false;
        }
    }
    kept
}

/// What stands between `use` and `;`, and whether it is shown to others.
fn use_statements(text: &str) -> Vec<(String, bool)> {
    let mut found = Vec::new();
    for part in text.split(';') {
        let is_use = |line: &str| {
            let line = line.trim_start();
            line.starts_with("use ") || line.starts_with("pub") && line.contains(" use ")
        };
        let Some(line) = part.lines().collect::<Vec<_>>().iter().rposition(|line| is_use(line)) else { continue };
        let statement: String = part.lines().skip(line).map(str::trim).collect::<Vec<_>>().join(" ");
        let Some((before, path)) = statement.split_once("use ") else { continue };
        found.push((path.trim().into(), before.starts_with("pub")));
    }
    found
}

/// The paths of a statement with braces, and the names that they go by.
fn expanded(statement: &str) -> Vec<(Vec<String>, String)> {
    let Some((head, rest)) = statement.split_once('{') else {
        let (path, name) = statement.split_once(" as ").unwrap_or((statement, ""));
        let path: Vec<String> = path.split("::").map(|s| s.trim().to_owned()).collect();
        let name = if name.is_empty() { path.last().cloned().unwrap_or_default() } else { name.trim().into() };
        return vec![(path, name)];
    };
    let rest = rest.rsplit_once('}').map_or(rest, |(inner, _)| inner);
    let (mut depth, mut items, mut item) = (0, Vec::new(), String::new());
    for c in rest.chars() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        match (c, depth) {
            (',', 0) => items.push(std::mem::take(&mut item)),
            _ => item.push(c),
        }
    }
    items.push(item);
    let items = items.iter().map(|item| item.trim()).filter(|item| !item.is_empty());
    items.flat_map(|item| expanded(&format!("{head}{item}"))).collect()
}

/// Paths that begin with `crate`, `super`, `self` or a crate of the runtime or of specs, outside of `use`.
fn paths_in_code(text: &str) -> Vec<Vec<String>> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    text.split(|c| !is_word(c))
        .filter(|word| {
            ["crate::", "super::", "self::", "plywave::", "plywave_textile::"]
                .iter()
                .any(|start| word.starts_with(start))
        })
        .map(|word| word.split("::").filter(|part| !part.is_empty()).map(str::to_owned).collect())
        .collect()
}

type Exports = BTreeMap<(Vec<String>, String), Vec<String>>;

/// The module that defines what a path names, in this crate; `None` in another one.
fn resolved(
    files: &BTreeMap<Vec<String>, String>,
    exports: &Exports,
    module: &[String],
    path: &[String],
    depth: usize,
) -> Option<Vec<String>> {
    let mut at = module.to_vec();
    let mut rest = path;
    match path.first()?.as_str() {
        "crate" => (at, rest) = (Vec::new(), &path[1..]),
        "self" => rest = &path[1..],
        "super" => {}
        name if files.contains_key(&[module, &[name.to_owned()]].concat()) => {}
        _ => return None,
    }
    while rest.first().is_some_and(|part| part == "super") {
        at.pop();
        rest = &rest[1..];
    }
    for (i, part) in rest.iter().enumerate() {
        if part == "self" {
            break;
        }
        let deeper = [&at[..], std::slice::from_ref(part)].concat();
        if files.contains_key(&deeper) {
            at = deeper;
        } else {
            let shown = exports.get(&(at.clone(), part.clone())).filter(|_| depth < 8);
            let onward = shown.map(|shown| [&shown[..], &rest[i + 1..]].concat());
            return onward.and_then(|path| resolved(files, exports, &at, &path, depth + 1)).or(Some(at));
        }
    }
    Some(at)
}

/// A circle among edges, if there is one.
fn circle(edges: impl Iterator<Item = (String, String)>) -> Option<Vec<String>> {
    let mut left: BTreeSet<(String, String)> = edges.collect();
    // Whoever uses none, or is used by none, is in no circle.
    loop {
        let (from, to): (BTreeSet<_>, BTreeSet<_>) = left.iter().cloned().unzip();
        let count = left.len();
        left.retain(|(a, b)| to.contains(a) && from.contains(b));
        if left.len() == count {
            break;
        }
    }
    let all: BTreeSet<String> = left.into_iter().flat_map(|(a, b)| [a, b]).collect();
    (!all.is_empty()).then(|| all.into_iter().collect())
}

#[test]
fn circles_are_found() {
    let edges = |list: &[(&str, &str)]| circle(list.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())));
    assert_eq!(edges(&[("a", "b"), ("b", "c"), ("a", "c")]), None);
    let found = edges(&[("a", "b"), ("b", "c"), ("c", "b"), ("c", "d")]);
    assert_eq!(found, Some(vec!["b".into(), "c".into()]));
    let paths = expanded("a::{b, c::{d as e, f}}");
    let paths: Vec<_> = paths.iter().map(|(path, name)| (path.join("::"), name.as_str())).collect();
    assert_eq!(paths, [("a::b".to_string(), "b"), ("a::c::d".into(), "e"), ("a::c::f".into(), "f")]);
    let uses = Uses::of("src");
    let has = |from: &str, to: &str| {
        let path = |text: &str| text.split("::").map(str::to_owned).collect::<Vec<_>>();
        uses.edges.contains(&(path(from), path(to)))
    };
    // By `use`, and through what a room shows.
    assert!(has("cloth::bsdf", "cloth::light::far") && has("cloth::model", "ply::model"));
    assert!(uses.edges.len() > 300, "{} edges", uses.edges.len());
}

/// The runtime that a host links has no simulator, optimizer, thread pool or random numbers.
#[test]
fn the_runtime_is_light() {
    let allowed = ["arrayvec", "multiversion", "safetensors", "serde", "serde_json", "thiserror", "toml"];
    assert_eq!(dependencies("Cargo.toml").into_iter().collect::<Vec<_>>(), allowed);
}

/// Random numbers come in as arguments, and whoever calls decides on threads.
#[test]
fn the_runtime_starts_no_thread_and_draws_no_number() {
    for file in sources("src").iter().filter(|f| *f != "src/math/hash.rs") {
        let mut in_tests = false;
        for (i, line) in code(file).iter().enumerate() {
            in_tests |= line.contains("#[cfg(test)]");
            let found = ["std::thread", "thread::", "rayon", "rand::", "rand_pcg", "SplitMix64"];
            let found = found.iter().find(|word| line.contains(**word));
            assert!(in_tests || found.is_none(), "{file}:{}: {line}", i + 1);
        }
    }
}

/// Hosts without a file system hand in bytes by name.
#[test]
fn the_runtime_touches_files_in_io_alone() {
    for file in sources("src").iter().filter(|f| !f.starts_with("src/io/")) {
        for (i, line) in code(file).iter().enumerate() {
            let touches = ["std::fs", "fs::", "File::"].iter().any(|word| line.contains(word));
            assert!(!touches, "{file}:{}: {line}: go through plywave::io", i + 1);
        }
    }
}

/// Files come through `plywave::io`, whose readers refuse what is no regular file and have a limit; others
/// state theirs.
#[test]
fn files_are_read_with_a_limit() {
    // `/proc` of this process; the folder of the viewer's page, which is read up to a limit of its own.
    let allowed = ["sim/runs/src/memory.rs", "render/src/memory_limit.rs", "cli/src/commands/look/view.rs"];
    for folder in CRATES {
        for file in sources(folder).iter().filter(|f| !f.starts_with("src/io/") && !allowed.contains(&f.as_str())) {
            for (i, line) in production(file).iter().enumerate() {
                let reads =
                    ["fs::read(", "fs::read_to_string(", "File::open("].iter().find(|word| line.contains(**word));
                assert!(reads.is_none_or(|word| line.contains(&format!("Part{word}"))), "{file}:{}: {line}", i + 1);
            }
        }
    }
}

/// Degrees are of texts that people write and read: the command line, scenes, reports, plots, exported files.
/// Names say so by `deg`.
#[test]
fn degrees_are_where_people_read_them() {
    let people = [
        "cli/src",
        "pipeline/src/exports",
        "pipeline/src/swatch/geometry.rs",
        "pipeline/src/swatch/report.rs",
        "sim/wave/src/scene",
        "sim/wave/src/jobs",
        "sim/wave/src/error.rs",
        "sim/wave/src/cylinders/mie.rs",
        "sim/src/options.rs",
        "sim/src/twin/options.rs",
        "conformance/src/fiber.rs",
        "python/src",
        "viewer/",
        "render/src/strands/pbrt",
        // The lean of fibers in a refusal.
        "textile/src/yarn/resolve.rs",
        // Formulas and tables in degrees.
        "src/color",
        "fiber/src/models/normalized.rs",
        "src/gap/apertures.rs",
        "src/cloth/light/far",
        "src/cloth/tensors.rs",
    ];
    for folder in CRATES {
        for file in sources(folder).iter().filter(|f| !people.iter().any(|start| f.starts_with(start))) {
            for (i, line) in production(file).iter().enumerate() {
                let line = line.to_lowercase();
                let has = ["_deg", "to_degrees", "to_radians"].iter().any(|word| line.contains(word));
                assert!(!has, "{file}:{}: {line}", i + 1);
            }
        }
    }
}

/// The twin of a cloth shares its curves, its hairs and the specs of its fibers with the cloth model, and no
/// part of the shading.
#[test]
fn twins_share_curves_and_specs_with_the_model() {
    let shared = ["ClothCurves", "ClothYarn", "Lattice", "PlyCurve"];
    for file in sources("sim/src/twin") {
        let text = production(&file).join("\n");
        let used =
            use_statements(&text).into_iter().flat_map(|(statement, _)| expanded(&statement)).map(|(path, _)| path);
        let code: Vec<String> = production(&file).into_iter().filter(|l| !l.trim_start().starts_with("use ")).collect();
        for path in used.chain(paths_in_code(&code.join("\n"))) {
            let path: Vec<&str> = path.iter().map(String::as_str).collect();
            let is_shared = match path[..] {
                ["plywave", "cloth", item, ..] => shared.contains(&item),
                ["plywave", of, ..] => matches!(of, "Error" | "Result" | "math" | "optics" | "spec"),
                ["plywave_textile", item, ..] => ["Hairs", "YarnSet"].contains(&item),
                // Hairs are curves too; what is found for shading is not shared.
                ["crate", "cloth", item, ..] => ["Hair", "HairKind", "HairRoots"].contains(&item),
                ["super", "super", ..] => false,
                _ => true,
            };
            assert!(is_shared, "{file}: {}", path.join("::"));
        }
    }
}

#[test]
fn unsafe_code_is_where_architecture_says() {
    let allowed = ["render/src/strands/wide.rs"];
    for folder in CRATES.into_iter().filter(|folder| !["capi/src", "python/src"].contains(folder)) {
        for file in sources(folder).iter().filter(|f| !allowed.contains(&f.as_str())) {
            for (i, line) in code(file).iter().enumerate() {
                let is_unsafe = line.contains("unsafe {") || line.contains("unsafe fn") || line.contains("unsafe impl");
                assert!(!is_unsafe, "{file}:{}: {line}", i + 1);
            }
        }
    }
}

/// Production code does not use reference implementations, which are in `conformance/`.
#[test]
fn reference_implementations_are_for_tests() {
    for folder in CRATES.into_iter().filter(|folder| *folder != "conformance/src") {
        for file in sources(folder) {
            let mut in_tests = false;
            for (i, line) in code(&file).iter().enumerate() {
                in_tests |= line.contains("#[cfg(test)]");
                assert!(in_tests || !line.contains("plywave_check::reference"), "{file}:{}: {line}", i + 1);
            }
        }
    }
}

/// Numbers of more than three digits in some text, however they are written.
fn long_numbers(text: &str) -> BTreeSet<String> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '-');
    let words = text.split(|c| !is_part(c)).map(|word| word.replace('_', "")).collect::<Vec<_>>();
    let numbers = words.iter().map(|word| word.trim_start_matches('-')).filter_map(|word| {
        let digits: String = word.split(['e', 'E']).next()?.chars().filter(char::is_ascii_digit).collect();
        let value: f64 = word.parse().ok()?;
        (digits.trim_matches('0').len() > 3).then(|| format!("{value:e}"))
    });
    numbers.collect()
}

/// No number is typed twice: what the plugins of Mitsuba share with the library comes by
/// `plywave::host_constants`.
#[test]
fn plugins_type_no_number_of_the_library() {
    let mut ours = BTreeMap::new();
    for folder in ["src", "fiber/src"] {
        for file in sources(folder) {
            for number in long_numbers(&production(&file).join("\n")) {
                ours.entry(number).or_insert(file.clone());
            }
        }
    }
    assert!(ours.len() > 500, "{} numbers", ours.len());
    assert_eq!(long_numbers("x = [0.564_189_6, 1e-5, 0x9E37, 123, -1.2345e-3]").len(), 2);
    for entry in std::fs::read_dir(root().join("python/plywave/mitsuba")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "py") {
            continue;
        }
        let text = std::fs::read_to_string(&path).unwrap();
        // Texts between three quotes are every second part.
        let text: Vec<&str> = text.split("\"\"\"").step_by(2).collect();
        let code: Vec<&str> = text.iter().flat_map(|t| t.lines()).map(|l| l.split('#').next().unwrap()).collect();
        for number in long_numbers(&code.join("\n")) {
            assert!(!ours.contains_key(&number), "{}: {number} of {}", path.display(), ours[&number]);
        }
    }
}

/// Absorption and wavelength are the host's at evaluation: no ply kernel knows a wavelength.
#[test]
fn ply_kernels_know_no_wavelength() {
    for file in sources("src/ply/kernel") {
        for (i, line) in code(&file).iter().enumerate() {
            assert!(!line.contains("lambda"), "{file}:{}: {line}", i + 1);
        }
    }
}
