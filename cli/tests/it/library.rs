//! Models by name: those beside a spec, those of folders that are given, those that ship; and what is said
//! where a name or a path leads nowhere.

use crate::common::{json, plywave, refused, run, succeed, text};
use std::path::Path;

/// A cloth whose plies are as wide as those of the model of silk.
fn cloth(warp: &str, weft: &str) -> String {
    format!(
        "name = \"open\"\n[weave]\nkind = \"plain\"\nends_per_cm = 20\npicks_per_cm = 20\n[warp]\n\
         model = \"{warp}\"\nfiber = \"silk\"\ncount = \"5.115 tex\"\npacking = 0.6\nbundles = 1\n\
         [weft]\nas = \"warp\"\nmodel = \"{weft}\"\n"
    )
}

fn shipped(name: &str) -> String {
    format!("{}/../fabrics/models/{name}.pwm", env!("CARGO_MANIFEST_DIR"))
}

const SHIPPED: [&str; 13] = [
    "alpaca",
    "cotton",
    "cotton_2ply",
    "cotton_3ply",
    "cotton_4ply",
    "glass",
    "gold",
    "polyester",
    "polyester_3ply",
    "silk",
    "viscose",
    "wool",
    "wool_2ply",
];

#[test]
fn a_model_that_ships_is_the_file_that_ships() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    for name in SHIPPED {
        let (file, named) = (shipped(name), json(&succeed(dir, &["info", name, "--json"])));
        let mut of_file = json(&succeed(dir, &["info", &file, "--json"]));
        of_file["file"] = name.into();
        assert_eq!(named, of_file, "{name}");
    }
    let at = ["--theta-i", "30", "--h-rel", "0.2", "--sigma", "0,0.01"];
    let file = shipped("polyester");
    for args in [vec!["eval", "FILE", "--theta-o", "-30", "--phi-o", "270"], vec!["sample", "FILE", "-n", "3"]] {
        let of = |model: &str| {
            let args: Vec<&str> = args.iter().map(|a| if *a == "FILE" { model } else { *a }).collect();
            succeed(dir, &[&args[..], &at].concat())
        };
        assert_eq!(of("polyester"), of(&file), "{args:?}");
    }
    let color = |model: &str| succeed(dir, &["color", model, "--srgb", "0.8,0.1,0.2"]);
    assert_eq!(color("silk"), color(&shipped("silk")).replace(&shipped("silk"), "silk"));
    assert!(succeed(dir, &["diff", "wool", &shipped("wool")]).contains("energy  largest difference 0 "));
    succeed(dir, &["check", "polyester", "--incidences", "2"]);
    succeed(dir, &["plot", "glass", "-o", "glass.png"]);
}

/// A spec finds the model beside it, then that of the flag's folder, then of the variable's, then what ships.
#[test]
#[ignore = "slow: 10 s: names are looked up in order"]
fn names_are_looked_up_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let [flag, variable, beside] = ["flag", "variable", "beside"].map(|name| dir.join(name));
    for place in [&flag, &variable, &beside] {
        std::fs::create_dir(place).unwrap();
    }
    // Told apart by what they are models of.
    let put =
        |place: &Path, of: &str, name: &str| std::fs::copy(shipped(of), place.join(format!("{name}.pwm"))).unwrap();
    put(&variable, "cotton", "silk");
    put(&flag, "wool", "silk");
    put(&variable, "viscose", "mine");
    let name = |args: &[&str], variables: bool| {
        let mut command = plywave(dir, &[args, &["--json"]].concat());
        command.env_remove("PLYWAVE_MODELS");
        if variables {
            let paths = std::env::join_paths([dir.join("none"), variable.clone()]).unwrap();
            command.env("PLYWAVE_MODELS", paths);
        }
        let output = command.output().unwrap();
        assert!(output.status.success(), "{args:?}: {}", text(&output.stderr));
        json(&text(&output.stdout))["name"].as_str().unwrap().to_string()
    };
    assert_eq!(name(&["info", "silk"], false), "silk");
    assert_eq!(name(&["info", "silk"], true), "cotton");
    assert_eq!(name(&["info", "silk", "--models", "flag"], true), "wool");
    assert_eq!(name(&["info", "mine", "--models", "flag"], true), "viscose");
    // A file of the name itself, and one with the ending, come first.
    put(dir, "glass", "silk");
    assert_eq!(name(&["info", "silk", "--models", "flag"], true), "glass");
    std::fs::remove_file(dir.join("silk.pwm")).unwrap();

    // In a spec: the folder of the spec is the first.
    std::fs::write(beside.join("cloth.toml"), cloth("silk", "mine")).unwrap();
    let with = ["color", "beside/cloth.toml", "--srgb", "0.5,0.5,0.5"];
    refused(
        dir,
        &with,
        &[
            "beside/cloth.toml",
            "weft.model = mine",
            "no model of this name",
            "there are: alpaca",
            "wool_2ply",
            "NAME.pwm",
        ],
    );
    refused(dir, &[&with[..], &["--models", "nowhere"]].concat(), &["--models = nowhere", "not a folder"]);
    put(&beside, "silk", "mine");
    succeed(dir, &["weave", "beside/cloth.toml", "-q", "-o", "cloth.pwc"]);
    assert_eq!(json(&succeed(dir, &["info", "cloth.pwc", "--json"]))["plies"], serde_json::json!(["silk", "silk"]));
}

#[test]
fn paths_that_lead_nowhere_tell_the_way() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    std::fs::create_dir_all(dir.join("specs")).unwrap();
    std::fs::create_dir_all(dir.join("models")).unwrap();
    std::fs::copy(shipped("polyester"), dir.join("models/polyester.pwm")).unwrap();
    std::fs::copy(shipped("polyester"), dir.join("models/mine.pwm")).unwrap();
    let absolute = dir.join("models/mine.pwm").display().to_string();
    for (warp, weft, words) in [
        (
            "../models/polyester.pwm",
            "silk",
            vec!["warp.model = ../models/polyester.pwm", "leads out of the folder", "warp.model = \"polyester\""],
        ),
        (
            "silk",
            "../models/mine.pwm",
            vec!["weft.model = ../models/mine.pwm", "leads out of the folder", "PLYWAVE_MODELS"],
        ),
        ("silk", absolute.as_str(), vec!["weft.model = ", "mine.pwm", "leads out of the folder"]),
        ("polyester.pwm", "silk", vec!["warp.model = polyester.pwm", "no such file", "warp.model = \"polyester\""]),
        ("none.pwm", "silk", vec!["warp.model", "none.pwm", "no such file"]),
        ("polyster", "silk", vec!["warp.model = polyster", "no model of this name", "polyester, "]),
    ] {
        std::fs::write(dir.join("specs/cloth.toml"), cloth(warp, weft)).unwrap();
        for command in [
            &["weave", "specs/cloth.toml", "-o", "a.pwc"][..],
            &["render", "specs/cloth.toml", "-o", "a.png"],
            &["twin", "specs/cloth.toml"],
        ] {
            refused(dir, command, &[&["specs/cloth.toml"], &words[..]].concat());
        }
    }
    // A WIF is named by its path.
    let wif = cloth("silk", "silk").replacen("kind = \"plain\"", "kind = \"wif\"\nfile = \"../x.wif\"", 1);
    std::fs::write(dir.join("specs/cloth.toml"), wif).unwrap();
    refused(dir, &["weave", "specs/cloth.toml"], &["../x.wif", "leads out of the folder"]);
    for args in [
        &["info", "polyster"][..],
        &["check", "polyster"],
        &["color", "polyster", "--srgb", "1,0,0"],
        &["plot", "polyster"],
    ] {
        refused(dir, args, &["polyster: no such file and no model of this name", "polyester_3ply"]);
    }
}

/// A picture of named models is that of the same files, and a render goes on only with the same models.
#[test]
#[ignore = "slow: 5 s: a render of named models goes on"]
fn a_render_of_named_models_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    std::fs::write(dir.join("cloth.toml"), cloth("silk", "silk")).unwrap();
    let args = [
        "render",
        "cloth.toml",
        "-o",
        "a.png",
        "--width",
        "8",
        "--height",
        "8",
        "--samples",
        "1",
        "--depth",
        "2",
        "--quiet",
    ];
    succeed(dir, &args);
    let named = std::fs::read(dir.join("a.exr")).unwrap();
    std::fs::copy(shipped("silk"), dir.join("silk.pwm")).unwrap();
    succeed(dir, &[&args[..3], &["b.png"], &args[4..]].concat());
    assert_eq!(run(dir, &["info", "silk"]).status.code(), Some(0));
    let pixels = |bytes: &[u8]| image::load_from_memory(bytes).unwrap().to_rgb32f().into_raw();
    let [a, b] =
        [std::fs::read(dir.join("a.png")).unwrap(), std::fs::read(dir.join("b.png")).unwrap()].map(|b| pixels(&b));
    assert_eq!(a, b);
    assert!(!named.is_empty());
}
