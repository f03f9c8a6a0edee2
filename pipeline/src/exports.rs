//! Exports of a cloth to other programs: reports, BSDF files, materials.
//!
//! [`export`] builds the files of a [`Format`] in memory; [`Exported::save`] writes all of them or none. All
//! formats describe the same mean over the cell ([`MeanCloth`]), or maps of the same cloth over its repeat.

mod basis;
mod blender;
mod gltf;
mod heat;
mod lobes;
mod maps;
mod material;
mod matrix;
mod mean;
mod mitsuba;
mod openpbr;
mod outputs;
mod pictures;
mod report;
mod rgl;
mod tensor_file;
mod textures;
mod usd;
mod window_xml;

pub use basis::{Basis, KLEMS_RINGS, incident, outgoing};
pub use heat::Heat;
pub use lobes::{Engine, Shape};
pub use maps::{Maps, Point, Texel, rectangle};
pub use material::{Bound, Fit, Material};
pub use matrix::{BAND_NAMES, BANDS, Matrix, MatrixBlock, Steps};
pub use mean::{Bands, BeyondVisible, CONE_RAD, Energies, Estimate, MeanCloth, NODES, Spectrum, lambda_um};
pub use report::{Report, Row, View};

use crate::error::Error;
use crate::run::{Progress, Run, Stage};
use plywave::cloth::ClothData;
use std::path::{Path, PathBuf};

/// Formats of exports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Report of measured quantities with standard errors: JSON, CSV, Markdown or HTML, by the ending of the
    /// file.
    Report,
    /// LBNL WINDOW and Radiance: matrix between the patches of the Klems basis.
    Klems,
    /// Radiance: tensor tree.
    TensorTree,
    /// The RGL's tensor file for measured materials: reflection of the face.
    Rgl,
    /// OpenPBR as MaterialX, with textures.
    OpenPbr,
    /// A swatch as GLB.
    Gltf,
    /// A swatch as USD, with MaterialX and a preview surface.
    Usd,
    /// A Python file that makes a node group for Cycles and a swatch in Blender.
    Blender,
    /// A material for scenes of Mitsuba 3.
    Mitsuba,
}

impl Format {
    /// All formats.
    pub const ALL: [Format; 9] = [
        Format::Report,
        Format::Klems,
        Format::TensorTree,
        Format::Rgl,
        Format::OpenPbr,
        Format::Gltf,
        Format::Usd,
        Format::Blender,
        Format::Mitsuba,
    ];

    /// Name of the format on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Format::Report => "report",
            Format::Klems => "klems",
            Format::TensorTree => "tensortree",
            Format::Rgl => "rgl",
            Format::OpenPbr => "openpbr",
            Format::Gltf => "gltf",
            Format::Usd => "usd",
            Format::Blender => "blender",
            Format::Mitsuba => "mitsuba",
        }
    }

    /// Text by which each file of the format names its origin.
    fn mark(self) -> String {
        format!("plywave export: {}", self.name())
    }

    /// The format with this name.
    pub fn named(name: &str) -> Option<Format> {
        Format::ALL.into_iter().find(|format| format.name() == name)
    }

    /// Endings of the main file, the usual one first.
    pub fn endings(self) -> &'static [&'static str] {
        match self {
            Format::Report => &["md", "html", "json", "csv"],
            Format::Klems | Format::TensorTree | Format::Mitsuba => &["xml"],
            Format::Rgl => &["bsdf"],
            Format::OpenPbr => &["mtlx"],
            Format::Gltf => &["glb"],
            Format::Usd => &["usda"],
            Format::Blender => &["py"],
        }
    }
}

/// Options of an export.
#[derive(Clone, Debug, PartialEq)]
pub struct ExportOptions {
    /// One absorption [1/um] for all yarns at every wavelength, which overrides their colors.
    pub sigma_per_um: Option<f64>,
    /// Absorptions outside the visible range.
    pub beyond: BeyondVisible,
    /// Number of samples for each row of a report.
    pub samples: usize,
    /// Seed of these samples.
    pub seed: u32,
    /// Views of a report; an empty list selects the default views.
    pub views: Vec<View>,
    /// Number of squares along an edge of the hemisphere in a tensor tree, a power of two.
    pub squares: usize,
    /// Whether an RGL file has spectra instead of linear sRGB.
    pub is_spectral: bool,
    /// Number of pixels of textures along the longer side of the repeat.
    pub pixels: usize,
    /// Length of cloth per unit of a surface's texture coordinates [mm], for MaterialX, Blender and Mitsuba.
    pub mm_per_uv: f64,
}

impl Default for ExportOptions {
    fn default() -> Self {
        ExportOptions {
            sigma_per_um: None,
            beyond: BeyondVisible::default(),
            samples: 1 << 14,
            seed: 1,
            views: Vec::new(),
            squares: 16,
            is_spectral: false,
            pixels: 256,
            mm_per_uv: 100.0,
        }
    }
}

/// The files of an export.
#[derive(Clone, Debug)]
pub struct Exported {
    /// The main files, then the files to which they refer: paths and bytes.
    pub files: Vec<(PathBuf, Vec<u8>)>,
    /// Notes for the user, one per line: assumptions, and properties that the format cannot express.
    pub notes: Vec<String>,
    /// Named numbers about the export.
    pub facts: Vec<(&'static str, f64)>,
}

impl Exported {
    /// Writes all files or none, the main ones last; returns their paths.
    ///
    /// # Errors
    /// [`plywave::Error::Io`].
    pub fn save(&self) -> Result<Vec<PathBuf>, Error> {
        let files: Vec<(&Path, &[u8])> =
            self.files.iter().rev().map(|(path, bytes)| (path.as_path(), bytes.as_slice())).collect();
        plywave::io::write_files(&files)?;
        Ok(self.files.iter().map(|(path, _)| path.clone()).collect())
    }
}

/// Notes on assumptions about light outside the visible range.
fn beyond_note(beyond: BeyondVisible) -> Vec<String> {
    let bands = Bands::new();
    let [uv, ir] = bands.solar_ends.map(|share| format!("{:.1} %", 100.0 * share));
    let end = |absorption: Option<f64>, end: &str| match absorption {
        Some(sigma) => format!("{sigma} per um"),
        None => format!("what it is at {end} um"),
    };
    vec![format!(
        "Solar numbers assume an absorption where the colors of the yarns are not known: below 0.38 um ({uv} of the sun's energy) {}, above 0.78 um ({ir}) {}.",
        end(beyond.uv_per_um, "0.38"),
        end(beyond.ir_per_um, "0.78")
    )]
}

/// Refuses options that are out of range for a format.
fn check(options: &ExportOptions, format: Format) -> Result<(), Error> {
    let refuse = |key: &str, value: String, hint: &str| {
        let (file, key) = ("export".into(), key.into());
        Err(Error::Runtime(plywave::Error::Invalid { file, key, value, hint: hint.into() }))
    };
    for (key, sigma) in [
        ("sigma_per_um", options.sigma_per_um),
        ("sigma_uv_per_um", options.beyond.uv_per_um),
        ("sigma_ir_per_um", options.beyond.ir_per_um),
    ] {
        if let Some(sigma) = sigma.filter(|s| !(0.0..=1e6).contains(s)) {
            return refuse(key, sigma.to_string(), "must be 0 to 1e6, in 1/um");
        }
    }
    if !(BATCHES_MIN..=1 << 20).contains(&options.samples) {
        return refuse("samples", options.samples.to_string(), "must be 256 to 1048576");
    }
    if format == Format::TensorTree && ![8, 16, 32].contains(&options.squares) {
        return refuse("squares", options.squares.to_string(), "must be 8, 16 or 32");
    }
    if !(16..=4096).contains(&options.pixels) {
        return refuse("pixels", options.pixels.to_string(), "must be 16 to 4096");
    }
    if !(1e-3..=1e6).contains(&options.mm_per_uv) {
        return refuse("mm_per_uv", options.mm_per_uv.to_string(), "must be 0.001 to 1000000, in mm");
    }
    for view in &options.views {
        if !(0.0..1.57).contains(&view.tilt_rad) || !view.azimuth_rad.is_finite() {
            let value = format!("{:.3} rad", view.tilt_rad);
            return refuse("views", value, "tilts must be from 0 to less than a right angle");
        }
    }
    Ok(())
}

/// Smallest number of samples for a row of a report.
const BATCHES_MIN: usize = 256;
/// Number of directions along a side of a patch.
const KLEMS_STEPS: Steps = Steps { incident: 3, outgoing: 3 };
const TREE_STEPS: Steps = Steps { incident: 2, outgoing: 2 };
/// Relative difference of values below which a tensor tree merges them.
const TREE_TOLERANCE: f64 = 0.02;
/// Numbers of nodes in the RGL's file.
const RGL_SIZE: rgl::RglSize = rgl::RglSize { phi_i: 17, theta_i: 12, half: [64, 64] };

/// Refuses main files whose number or endings do not fit the format; a report has one or more, any other
/// format exactly one.
fn check_mains(format: Format, mains: &[PathBuf]) -> Result<(), Error> {
    let refuse = |main: &Path, key: &str, value: String, hint: String| {
        let (file, key) = (main.display().to_string(), key.into());
        Err(Error::Runtime(plywave::Error::Invalid { file, key, value, hint }))
    };
    for (k, main) in mains.iter().enumerate() {
        let ending = outputs::ending(main);
        if !format.endings().contains(&ending.as_str()) {
            let endings: Vec<String> = format.endings().iter().map(|e| format!(".{e}")).collect();
            let value = if ending.is_empty() { "(none)".into() } else { format!(".{ending}") };
            return refuse(main, "ending", value, format!("name a {}", endings.join(", ")));
        }
        if mains[..k].contains(main) {
            return refuse(main, "output", "given twice".into(), "give each file a name of its own".into());
        }
    }
    match mains {
        [] => refuse(Path::new("export"), "output", "(absent)".into(), "name a file".into()),
        [_] => Ok(()),
        [_, next, ..] if format != Format::Report => {
            let hint = "only a report is written to several files; export once for each file";
            refuse(next, "output", "a second file".into(), hint.into())
        }
        _ => Ok(()),
    }
}

/// Builds the files of a cloth in a format; `mains` are the paths of the main file, or of all files of a
/// report.
///
/// # Errors
/// [`Error::Runtime`] for options out of range and for an ending that the format does not have,
/// [`Error::Interrupted`] if the run was stopped.
pub fn export(
    data: &ClothData,
    format: Format,
    mains: &[PathBuf],
    options: &ExportOptions,
    run: &Run<'_>,
) -> Result<Exported, Error> {
    check(options, format)?;
    check_mains(format, mains)?;
    let main = mains[0].as_path();
    let name = main.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let cloth = MeanCloth::new(data, options.sigma_per_um, options.beyond)?;
    let tell = |done: u64, total: u64| run.report(Progress { stage: Stage::Export, done, total });
    match format {
        Format::Report => {
            let views = if options.views.is_empty() { View::usual() } else { options.views.clone() };
            let total = views.len() + 4;
            let mut each = |done: usize| {
                tell(done as u64, total as u64);
                run.check_stop()
            };
            let report = Report::new(&cloth, &data.name, &views, options.samples, options.seed, &mut each)?;
            let [face, _] = &report.normal;
            let facts = vec![
                ("largest_total", checked_total(report.largest_total())?),
                ("solar_transmittance", face.solar_transmitted.value),
                ("solar_reflectance", face.solar_reflected.value),
                ("solar_absorptance", face.solar_absorbed.value),
                ("visible_normal_hemispherical_transmittance", face.transmitted.value),
                ("visible_normal_normal_transmittance", face.into_cone.value),
                ("openness", face.openness.value),
            ];
            let file = |main: &PathBuf| (main.clone(), report.text(&outputs::ending(main)).into_bytes());
            Ok(Exported { files: mains.iter().map(file).collect(), notes: report.notes, facts })
        }
        Format::Klems | Format::TensorTree => {
            tell(0, 1);
            let (basis, steps) = match format {
                Format::Klems => (Basis::Klems, KLEMS_STEPS),
                _ => (Basis::Squares { side: options.squares }, TREE_STEPS),
            };
            let matrix = Matrix::new(&cloth, basis, steps, run)?;
            let largest_total = checked_total(matrix.largest_total())?;
            let heat = Heat::new(data, &cloth, &matrix)?;
            let mut notes = vec![
                "The front is the face of the cloth; its warp points up.".to_string(),
                "Light that passes between the fibers keeps its direction: the file has it as transmission into the patch opposite the one that it comes from.".to_string(),
            ];
            notes.extend(beyond_note(options.beyond));
            notes.push(heat.note.clone());
            let mut in_file = vec![made_by(format)];
            in_file.extend(notes.iter().cloned());
            let text = window_xml::xml(
                &matrix,
                &window_xml::About { name: &data.name, heat: &heat, notes: &in_file },
                TREE_TOLERANCE,
            );
            notes.push(ASYMMETRY_NOTE.into());
            let mut facts = vec![
                ("front_visible_reflectance", matrix.hemispherical(0, 0, 0)),
                ("front_visible_transmittance", matrix.hemispherical(0, 1, 0)),
                ("back_visible_reflectance", matrix.hemispherical(1, 0, 0)),
                ("back_visible_transmittance", matrix.hemispherical(1, 1, 0)),
                ("front_solar_reflectance", matrix.hemispherical(0, 0, 1)),
                ("front_solar_transmittance", matrix.hemispherical(0, 1, 1)),
                ("largest_total", largest_total),
                ("asymmetry", matrix.balanced.asymmetry),
                ("energy_change", matrix.balanced.energy_change),
            ];
            facts.extend(heat.facts());
            Ok(Exported { files: vec![(main.into(), text.into_bytes())], notes, facts })
        }
        Format::Rgl => {
            tell(0, 1);
            let rgl = rgl::rgl(&cloth, &data.name, RGL_SIZE, options.is_spectral, run)?;
            let (mut facts, note) = left_out(&cloth, options);
            facts.push(("largest_total", checked_total(rgl.largest_total)?));
            facts.push(("energy_change", rgl.energy_change));
            let notes = vec![
                note,
                match options.is_spectral {
                    true => "The file has spectra at nine wavelengths from 380 to 780 nm, for spectral renderers.".into(),
                    false => "The file has linear sRGB under D65, for renderers that work in RGB. A color that sRGB cannot show is paler, with the same luminance.".into(),
                },
            ];
            Ok(Exported { files: vec![(main.into(), rgl.bytes)], notes, facts })
        }
        Format::OpenPbr | Format::Gltf | Format::Usd | Format::Blender | Format::Mitsuba => {
            tell(0, 1);
            swatch(&cloth, data, format, (main, &name), options)
        }
    }
}

/// Text by which a file names its origin.
fn made_by(format: Format) -> String {
    format!("Made by {}, version {}.", format.mark(), env!("CARGO_PKG_VERSION"))
}

/// Note on the effect of balancing a matrix.
const ASYMMETRY_NOTE: &str = "The file is reciprocal: a value is the mean of both directions of light, scaled so that the light of every incident patch adds up to what the cloth sends out. The asymmetry says how far apart both directions were before: the root mean square difference between a value and the value with light and viewer exchanged, over that of the values. The energy change is the largest one of a patch's light.";

/// Largest fraction of incident light that a file may return.
const MAX_TOTAL: f64 = 1.005;

/// Checks the largest sum of reflected and transmitted light over all directions, relative to the incident
/// light.
///
/// # Errors
/// [`plywave::Error::Invalid`] if that sum exceeds 1 by more than the numerical error: programs that multiply
/// layers would gain energy at each pass.
fn checked_total(total: f64) -> Result<f64, Error> {
    if total <= MAX_TOTAL {
        return Ok(total);
    }
    Err(Error::Runtime(plywave::Error::Invalid {
        file: "export".into(),
        key: "largest_total".into(),
        value: format!("{total:.4}"),
        hint: "the file would give back more light than it gets; make the cloth anew with `plywave weave`".into(),
    }))
}

/// Minimum size of a swatch, which consists of whole repeats [um].
const SWATCH_UM: f64 = 1e4;

/// Builds a material and its textures in the files of a format.
fn swatch(
    cloth: &MeanCloth,
    data: &ClothData,
    format: Format,
    (main, name): (&Path, &str),
    options: &ExportOptions,
) -> Result<Exported, Error> {
    let engine = match format {
        Format::Gltf => Engine::Gltf,
        Format::Blender => Engine::Cycles,
        Format::Mitsuba => Engine::Mitsuba,
        _ => Engine::OpenPbr,
    };
    let maps = Maps::new(cloth, name, options.pixels)?;
    let material = Material::fit(engine, data, cloth, &maps, name)?;
    let textures = textures::Textures::new(&maps, &material);
    let fit = &material.fit;
    let percent = |v: f64| format!("{:.1} %", 100.0 * v);
    let mut notes = vec![
        format!(
            "The material is fitted to pictures of a sphere and of folds of the cloth, by the formulas of {}. Mean colors of spheres are off by up to {} with light in front, and by up to {} with light behind.",
            match engine {
                Engine::OpenPbr => "OpenPBR 1.1.1 in MaterialX 1.39.5",
                Engine::Gltf => "glTF's extensions in three.js r187",
                Engine::Cycles => "closures in Cycles 5.0",
                Engine::Mitsuba => "principled and principledthin in Mitsuba 3.9",
            },
            percent(fit.mean_color[0]),
            percent(fit.mean_color[1])
        ),
        format!(
            "The opacity is the share of the area that fibers cover, seen along the normal: {} on average. A renderer uses it at every angle, although a cloth is more opaque when it is seen at a slant.",
            percent(material.presence)
        ),
    ];
    if format == Format::Gltf && textures.mix > 0.01 {
        notes.push(format!(
            "Light through the cloth is in KHR_materials_diffuse_transmission. Programs that do not read it show none, and diffuse light that is {} too bright.",
            percent(1.0 / (1.0 - textures.mix) - 1.0)
        ));
    }
    if textures.cut > 1e-3 {
        notes.push(format!(
            "Textures hold colors up to 1. Brighter ones are cut off, and with them {} of the light.",
            percent(textures.cut)
        ));
    }
    notes.extend(material.at_bounds.iter().map(bound_note));
    let [warp, weft] = material.shape.widths;
    let [gloss_warp, gloss_weft] = material.gloss.map(luminance);
    let facts = vec![
        ("largest_total", checked_total(fit.largest_total)?),
        ("mean_color_off_in_front", fit.mean_color[0]),
        ("mean_color_off_behind", fit.mean_color[1]),
        ("streak_place_off_deg", fit.streak_place_rad.to_degrees()),
        ("streak_width_off", fit.streak_width),
        ("error_reflected", fit.error[0]),
        ("error_transmitted", fit.error[1]),
        ("reflectance_of_the_cloth", fit.energy[0][0]),
        ("reflectance_of_the_material", fit.energy[1][0]),
        ("transmittance_of_the_cloth", fit.energy[0][1]),
        ("transmittance_of_the_material", fit.energy[1][1]),
        ("warp_width_across", warp[0]),
        ("warp_width_along", warp[1]),
        ("weft_width_across", weft[0]),
        ("weft_width_along", weft[1]),
        ("warp_gloss", gloss_warp),
        ("weft_gloss", gloss_weft),
        ("ior", material.ior),
        ("level", material.shape.level),
        ("fuzz", luminance(material.fuzz)),
        ("fuzz_roughness", material.shape.fuzz_roughness),
        ("diffuse", luminance(material.diffuse[0])),
    ];
    let repeats = maps.size_um.map(|um| (SWATCH_UM / um).ceil().clamp(1.0, 1e4) as u32);
    if format == Format::Gltf {
        let glb = gltf::glb(&data.name, &maps, &material, &textures, repeats, &notes)?;
        return Ok(Exported { files: vec![(main.into(), glb)], notes, facts });
    }
    let mut in_file = vec![made_by(format)];
    in_file.extend(notes.iter().cloned());
    let stem = outputs::stem_beside(format, main);
    if matches!(format, Format::Blender | Format::Mitsuba) {
        let (name, mm) = (&data.name, options.mm_per_uv);
        let made = match format {
            Format::Blender => blender::blender(name, &stem, &maps, &material, &textures, (repeats, mm), &notes)?,
            _ => mitsuba::mitsuba(name, &stem, &maps, &material, &textures, mm, &notes)?,
        };
        let at = |name: String| if name.is_empty() { main.to_path_buf() } else { main.with_file_name(name) };
        let files = made.into_iter().map(|(name, bytes)| (at(name), bytes)).collect();
        return Ok(Exported { files, notes, facts });
    }
    let made_by = format.mark();
    let made = openpbr::TextureFiles::new(openpbr::texture_names(&stem), &made_by, &maps, &material, &textures)?;
    // On a USD swatch, texture coordinates count repeats.
    let mm_per_uv = if format == Format::Usd { None } else { Some(options.mm_per_uv) };
    let text = openpbr::mtlx(&data.name, &maps, &material, &textures, &made, mm_per_uv, &in_file);
    let mut files = Vec::new();
    if format == Format::Usd {
        let mtlx = format!("{stem}.mtlx");
        let usda = usd::usda(&data.name, &mtlx, &maps, &material, textures.mix, &made, repeats, &in_file);
        files.push((main.to_path_buf(), usda.into_bytes()));
        files.push((main.with_file_name(mtlx), text.into_bytes()));
    } else {
        files.push((main.to_path_buf(), text.into_bytes()));
    }
    files.extend(made.files.into_iter().map(|(name, bytes)| (main.with_file_name(name), bytes)));
    Ok(Exported { files, notes, facts })
}

fn luminance(c: [f64; 3]) -> f64 {
    plywave::color::xyz_of_linear_srgb(c)[1]
}

/// Note on a parameter at a bound of the fit.
fn bound_note(bound: &Bound) -> String {
    let limit = if bound.is_upper { "largest" } else { "smallest" };
    format!(
        "{} ended at {:.2}, the {limit} value that the fit allows: it shows what the material cannot do rather than what the cloth is, and the errors above contain what is missing.",
        bound.parameter, bound.value
    )
}

/// Light under a uniform sky over the face that a reflection-only format leaves out, as facts and as text.
fn left_out(cloth: &MeanCloth, options: &ExportOptions) -> (Vec<(&'static str, f64)>, String) {
    let bands = Bands::new();
    let batches = cloth.energies(&|u| mean::diffuse(true, u), options.samples, options.seed);
    let of = |number: &dyn Fn(&Energies) -> f64| batches.iter().map(number).sum::<f64>() / batches.len() as f64;
    let reflected = of(&|e| bands.visible(&e.reflected));
    let transmitted = of(&|e| bands.visible(&e.transmitted));
    let straight = of(&|e| e.straight);
    let facts = vec![
        ("diffuse_visible_reflectance", reflected),
        ("transmitted_left_out", transmitted),
        ("straight_left_out", straight),
    ];
    let note = format!(
        "The file has only the light that the face reflects. Under light from all directions this is {:.1} % of the light on the face; {:.1} % that is scattered through the cloth and {:.1} % that passes straight through gaps are left out, as is all light on the back.",
        100.0 * reflected,
        100.0 * transmitted,
        100.0 * straight
    );
    (facts, note)
}
