//! Where camera and lamps stood when a swatch was photographed: a small TOML file.

use plywave::spec::rules::{self, Custom, Key, KeyKind, Rules, invalid, number, optional};
use plywave::{Result, io};
use serde::{Deserialize, Serialize};
use std::path::Path;
use toml::Value;

/// Largest file [bytes].
const MAX_BYTES: u64 = 1 << 20;

/// The keys of a geometry file; `docs/howto/swatch.md` lists them.
#[doc(hidden)]
pub const GEOMETRY_RULES: Rules = Rules {
    keys: KEYS,
    units: &["_mm", "_deg", "_px"],
    example: "docs/howto/swatch.md",
    foreign: &[(&["weave", "warp", "weft", "name"], "this is a key of a cloth spec; give that as --spec")],
};

const KEYS: &[Key] = &[
    optional("camera_mm", KeyKind::Number(1.0, 1e5), "80"),
    optional("fov_deg", KeyKind::Number(0.5, 150.0), "53"),
    optional("front_lamp_mm", KeyKind::Custom(PLACE), "[0, 80, 80]"),
    optional("back_lamp_mm", KeyKind::Custom(PLACE), "[0, 0, -90]"),
    optional("lamp_radius_mm", KeyKind::Number(0.01, 1e3), "1.5"),
    optional("vignetting", KeyKind::Choice(&["cos4", "none"]), "\"cos4\""),
    optional("white_px", KeyKind::Custom(RECTANGLE), "none: exposure unknown"),
    optional("white_reflectance", KeyKind::Above(0.0, 1.0), "0.9"),
];
const PLACE: Custom = Custom {
    expected: "three numbers [x, y, z] from -100000 to 100000",
    check: |file, key, value| numbers(file, key, value, 3, -1e5),
};
const RECTANGLE: Custom = Custom {
    expected: "four numbers [left, top, right, bottom] from 0 to 100000",
    check: |file, key, value| numbers(file, key, value, 4, 0.0),
};

fn numbers(file: &str, key: &str, value: &Value, count: usize, least: f64) -> Result<()> {
    let list = value.as_array().map_or(&[][..], Vec::as_slice);
    let is_good = |v: &Value| number(v).is_some_and(|x| (least..=1e5).contains(&x));
    match list.len() == count && list.iter().all(is_good) {
        true => Ok(()),
        false if count == 3 => Err(invalid(file, key, value, format!("use {}", PLACE.expected))),
        false => Err(invalid(file, key, value, format!("use {}", RECTANGLE.expected))),
    }
}

/// Where camera and lamps stood. The cloth lies in the plane z = 0 with its face up, its middle in the middle
/// of the picture; x points to the right of the picture and y up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SwatchGeometry {
    /// Height of the camera above the middle of the cloth [mm].
    pub camera_mm: f64,
    /// Angle that the width of the picture spans [degrees].
    pub fov_deg: f64,
    /// The lamp of the front picture [mm].
    pub front_lamp_mm: [f64; 3],
    /// The lamp of the back-lit picture [mm]; its z is negative.
    pub back_lamp_mm: [f64; 3],
    /// Radius of both lamps [mm].
    pub lamp_radius_mm: f64,
    /// How the lens darkens its picture: `cos4` or `none`.
    pub vignetting: String,
    /// A patch of known reflectance in the front picture: left, top, right, bottom [pixels].
    pub white_px: Option<[f64; 4]>,
    /// Reflectance of that patch, which is matte.
    pub white_reflectance: f64,
}

impl Default for SwatchGeometry {
    /// That of Tang et al. 2024, "Woven Fabric Capture with a Reflection-Transmission Photo Pair".
    fn default() -> Self {
        SwatchGeometry {
            camera_mm: 80.0,
            fov_deg: 53.0,
            front_lamp_mm: [0.0, 80.0, 80.0],
            back_lamp_mm: [0.0, 0.0, -90.0],
            lamp_radius_mm: 1.5,
            vignetting: "cos4".into(),
            white_px: None,
            white_reflectance: 0.9,
        }
    }
}

impl SwatchGeometry {
    /// Reads a geometry file.
    ///
    /// # Errors
    /// Those of reading, and of [`SwatchGeometry::parse`].
    pub fn load(path: &Path) -> Result<SwatchGeometry> {
        SwatchGeometry::parse(&io::read_text(path, MAX_BYTES)?, &path.display().to_string())
    }

    /// Parses the text of a geometry file; `file` identifies it in errors.
    ///
    /// # Errors
    /// [`plywave::Error::Invalid`] for unknown keys, values out of range and lamps on the wrong side.
    pub fn parse(text: &str, file: &str) -> Result<SwatchGeometry> {
        let table = rules::parse(text, file, &GEOMETRY_RULES)?;
        let geometry: SwatchGeometry = rules::typed(table, file, &GEOMETRY_RULES)?;
        let [_, _, front] = geometry.front_lamp_mm;
        let [_, _, back] = geometry.back_lamp_mm;
        if front < 1.0 {
            let hint = "the front lamp is above the cloth: give a z of 1 or more";
            return Err(invalid(file, "front_lamp_mm", format!("{:?}", geometry.front_lamp_mm), hint));
        }
        if back > -1.0 {
            let hint = "the back lamp is below the cloth: give a z of -1 or less";
            return Err(invalid(file, "back_lamp_mm", format!("{:?}", geometry.back_lamp_mm), hint));
        }
        Ok(geometry)
    }

    /// Width of the part of the cloth that is seen [mm].
    pub fn seen_mm(&self) -> f64 {
        2.0 * self.camera_mm * (0.5 * self.fov_deg.to_radians()).tan()
    }

    /// The lamp of the front picture, or of the back-lit one [mm].
    pub fn lamp_mm(&self, is_back: bool) -> [f64; 3] {
        if is_back { self.back_lamp_mm } else { self.front_lamp_mm }
    }

    /// Unit direction from a point of the cloth [mm] to the camera.
    pub(super) fn to_camera(&self, [x, y]: [f64; 2]) -> [f32; 3] {
        unit([-x, -y, self.camera_mm])
    }

    /// How much of the light from that direction the lens keeps.
    pub(super) fn lens(&self, to_camera: [f32; 3]) -> f32 {
        if self.vignetting == "cos4" { to_camera[2].powi(4) } else { 1.0 }
    }
}

pub(super) fn unit(v: [f64; 3]) -> [f32; 3] {
    let length = v.iter().map(|v| v * v).sum::<f64>().sqrt();
    v.map(|v| (v / length) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn geometries_are_read_or_refused() {
        assert_eq!(SwatchGeometry::parse("", "g.toml").unwrap(), SwatchGeometry::default());
        let read = SwatchGeometry::parse("camera_mm = 300\nfront_lamp_mm = [0, 100, 250]\n", "g.toml").unwrap();
        assert_eq!((read.camera_mm, read.front_lamp_mm), (300.0, [0.0, 100.0, 250.0]));
        for (text, want) in [
            ("front_lamp_mm = [0, 1]", "g.toml: front_lamp_mm = [0, 1]: use three numbers"),
            ("back_lamp_mm = [0, 0, 90]", "below the cloth"),
            ("front_lamp_mm = [0, 0, -9]", "above the cloth"),
            ("lamp = 3", "unknown key"),
            ("fov_deg = 200", "use a number from 0.5 to 150"),
            ("white_px = [1, 2, 3]", "use four numbers"),
        ] {
            let got = SwatchGeometry::parse(text, "g.toml").unwrap_err().to_string();
            assert!(got.contains(want), "{text}: {got}");
        }
    }
}
