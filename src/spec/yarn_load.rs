//! Reading and checking of yarn specs.

use super::rules;
use super::yarn::{Shape, YarnSpec};
use super::yarn_rules::{YARN_RULES, check_relations};
use crate::Result;
use crate::io::{AssetSource, Folder, of_key, read_text, text_of};
use std::path::Path;

/// Maximum size of a spec or point file [bytes].
const MAX_BYTES: u64 = 4 << 20;

/// Text of the polyester spec that ships with the program, `fabrics/polyester.toml`.
pub const POLYESTER: &str = include_str!("../../fabrics/polyester.toml");

impl YarnSpec {
    /// The spec of the polyester that ships with the program, [`POLYESTER`].
    ///
    /// # Errors
    /// None in a build whose tests pass.
    pub fn polyester() -> Result<YarnSpec> {
        YarnSpec::parse(POLYESTER, "fabrics/polyester.toml")
    }

    /// Reads a spec from its text; `file` is only used in messages. A polygon must contain its points.
    ///
    /// # Errors
    /// [`crate::Error::Format`] if the text is not TOML; [`crate::Error::Invalid`] if a key is unknown,
    /// absent or out of range.
    pub fn parse(text: &str, file: &str) -> Result<YarnSpec> {
        parse_near(text, file, None)
    }

    /// Reads a spec from a file. Returns the spec and the text to embed in tables and models, which
    /// [`YarnSpec::parse`] parses to the same spec. It is the file's own text, except for a polygon from a
    /// file, whose points are then written into the text. The polygon's file must lie in the spec's folder or
    /// below; [`YarnSpec::load_from`] with [`Folder::anywhere`] allows other places.
    ///
    /// # Errors
    /// Those of [`YarnSpec::parse`], and [`crate::Error::Io`] if a file cannot be read.
    pub fn load(path: impl AsRef<Path>) -> Result<(YarnSpec, String)> {
        let path = path.as_ref();
        YarnSpec::load_from(&read_text(path, MAX_BYTES)?, &path.display().to_string(), &Folder::of_file(path))
    }

    /// Like [`YarnSpec::load`], but from the spec's text and a source of the file that it may name; `file` is
    /// used in messages.
    ///
    /// # Errors
    /// Those of [`YarnSpec::load`].
    pub fn load_from(text: &str, file: &str, assets: &dyn AssetSource) -> Result<(YarnSpec, String)> {
        let spec = parse_near(text, file, Some(assets))?;
        if YarnSpec::parse(text, file).is_ok() {
            return Ok((spec, text.to_string()));
        }
        let text = spec.to_text(file)?;
        Ok((spec, text))
    }

    /// The spec as TOML, which [`YarnSpec::parse`] parses to the same spec; `file` identifies it in errors.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`] for values that TOML cannot represent.
    pub fn to_text(&self, file: &str) -> Result<String> {
        toml::to_string(self).map_err(|e| rules::invalid(file, "spec", e, "use values that TOML can hold"))
    }

    /// Checks a spec that was created or changed in code by the same rules as a parsed one.
    ///
    /// # Errors
    /// [`crate::Error::Invalid`], with the name `file`.
    pub fn check(&self, file: &str) -> Result<()> {
        rules::check_typed(self, file, &YARN_RULES)?;
        check_relations(file, self)
    }
}

/// Parses and checks a spec; a polygon's file is read from `assets`.
fn parse_near(text: &str, file: &str, assets: Option<&dyn AssetSource>) -> Result<YarnSpec> {
    let mut spec: YarnSpec = rules::typed(rules::parse(text, file, &YARN_RULES)?, file, &YARN_RULES)?;
    let blended = spec.blend.as_mut().map(|blend| ("blend.fiber.shape.file", &mut blend.fiber));
    let fibers = std::iter::once(("fiber.shape.file", &mut spec.fiber)).chain(blended);
    for (key, fiber) in fibers {
        if let (Shape::Polygon { file: points_file, points_um, .. }, Some(assets)) = (&mut fiber.shape, assets)
            && points_um.is_empty()
            && !points_file.is_empty()
        {
            let text = text_of(assets, points_file, MAX_BYTES);
            let text = text.map_err(|error| of_key(file, key, points_file, error, ""))?;
            *points_um = read_points(&text, &assets.display(points_file))?;
            points_file.clear();
        }
    }
    check_relations(file, &spec)?;
    Ok(spec)
}

/// Points of a polygon: one `x y` per line [um]; blank lines and `#` comments are skipped. Errors do not
/// quote the file, because its path may come from another file.
fn read_points(text: &str, file: &str) -> Result<Vec<[f64; 2]>> {
    let mut points = Vec::new();
    for (i, row) in text.lines().enumerate() {
        let row = row.split('#').next().unwrap_or_default().trim();
        if row.is_empty() {
            continue;
        }
        let parts = || row.split([' ', '\t', ',']).filter(|s| !s.is_empty());
        let numbers: Vec<f64> = parts().flat_map(str::parse).collect();
        match numbers[..] {
            [x, y] if parts().count() == 2 && x.abs() <= 1e4 && y.abs() <= 1e4 && points.len() < 2000 => {
                points.push([x, y]);
            }
            _ => {
                let hint = "use two numbers `x y` [um] within 10000 of the origin, 2000 lines at most";
                return Err(rules::invalid(file, &format!("line {}", i + 1), "(no such point)", hint));
            }
        }
    }
    if points.len() < 3 {
        return Err(rules::invalid(file, "points", points.len(), "use 3 or more lines `x y` [um]"));
    }
    Ok(points)
}
