//! What shading needs of the yarns beyond their curves and plies: colors, slits, unevenness.

use crate::Result;
use crate::color::Undyed;
use crate::gap::{SLIT_MAX_UM, SLIT_SHARE};
use crate::io::Check;
use serde::{Deserialize, Serialize};

/// Look of the yarns of one kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct YarnLook {
    /// Name of the kind: `warp`, `weft` or `yarn`.
    pub name: String,
    /// Color of all yarns, or the colors of consecutive yarns by their number, repeated periodically. Several
    /// colors are all [`YarnColor::Srgb`].
    pub colors: Vec<YarnColor>,
    /// Slits between the fibers; `None` for a yarn without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slits: Option<Slits>,
    /// Variation along and across the yarns; `None` for even ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unevenness: Option<Unevenness>,
}

/// The color of a yarn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum YarnColor {
    /// Neither the spec nor a WIF gives a color: clear fibers, or opaque fibers in their own color.
    Undyed,
    /// A color [sRGB, 0 to 1].
    Srgb([f32; 3]),
    /// An absorption coefficient [1/um].
    Sigma(f32),
    /// The absorption of an undyed natural fiber.
    Natural(Undyed),
}

/// Slits between the fibers of a yarn, whose diffraction colors are optional (Yu 2025, 7.3): see
/// [`crate::gap::Slit`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Slits {
    /// Width of a slit [um], above 0 and at most [`SLIT_MAX_UM`].
    pub width_um: f32,
    /// Share of a ply's forward light that passes through the slits, 0 to 1; [`SLIT_SHARE`] in the paper. 0
    /// disables them.
    pub share: f32,
}

impl Slits {
    /// No slits, overriding the spec.
    pub const NONE: Slits = Slits { width_um: 1.0, share: 0.0 };

    /// Slits of this width [um] with the paper's share of the light.
    pub fn of_width(width_um: f32) -> Slits {
        Slits { width_um, share: SLIT_SHARE }
    }
}

/// Variation of the yarns of one kind.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Unevenness {
    /// Coefficient of variation of the count along a yarn.
    pub count_cv: f64,
    /// Standard deviation of the positions of the yarns over their spacing.
    pub spacing_cv: f64,
    /// Length over which both vary [mm].
    pub length_mm: f64,
}

impl YarnLook {
    /// A yarn of one color, even and without slits.
    pub fn of_color(name: &str, color: YarnColor) -> YarnLook {
        YarnLook { name: name.into(), colors: vec![color], slits: None, unevenness: None }
    }

    /// Checks the values of a file; `file` identifies it in errors.
    pub(crate) fn check(&self, file: &str) -> Result<()> {
        let c = Check(file);
        for color in &self.colors {
            match color {
                YarnColor::Undyed | YarnColor::Natural(_) => {}
                YarnColor::Srgb(srgb) => c.range_f32("looks (colors)", srgb, 0.0, 1.0)?,
                YarnColor::Sigma(sigma) => c.range_f32("looks (sigma)", &[*sigma], 0.0, 10.0)?,
            }
        }
        let are_srgb = self.colors.iter().all(|color| matches!(color, YarnColor::Srgb(_)));
        if self.colors.is_empty() || (self.colors.len() > 1 && !are_srgb) {
            let value = format!("{} colors", self.colors.len());
            return Err(crate::spec::rules::invalid(file, "looks", value, "expected one color, or several in sRGB"));
        }
        if let Some(slits) = self.slits {
            c.range_f32("looks (slit width)", &[slits.width_um], f32::MIN_POSITIVE, SLIT_MAX_UM)?;
            c.range_f32("looks (slit share)", &[slits.share], 0.0, 1.0)?;
        }
        if let Some(uneven) = self.unevenness {
            c.range("looks (count_cv)", &[uneven.count_cv], 0.0, 0.5)?;
            c.range("looks (spacing_cv)", &[uneven.spacing_cv], 0.0, 0.15)?;
            c.range("looks (length_mm)", &[uneven.length_mm], 0.1, 1e4)?;
        }
        Ok(())
    }
}
