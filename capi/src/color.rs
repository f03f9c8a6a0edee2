//! Colors of cloths: the quantity that they refer to, target colors of yarns, and the colors that the cloth
//! reaches.

use crate::status::{Checked, invalid};
use plywave::cloth::{ColorOf, ColorReach, YarnColor};

/// Quantity that a target color refers to.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlywaveColorOf {
    /// The cloth under a uniform sky in all directions: reflected and transmitted light relative to the light
    /// that hits fibers.
    EvenSky = 0,
    /// The cloth's face, lit from the viewer's side, with a dark background.
    Reflected = 1,
    /// The cloth folded until opaque, as textile labs measure it (d/8).
    Folded = 2,
}

/// How a yarn is colored; the `kind` of a `PlywaveYarnColor`.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlywaveYarnColorKind {
    /// No color: non-absorbing fibers.
    Undyed = 0,
    /// A color [sRGB, 0 to 1].
    Srgb = 1,
    /// An absorption coefficient of the fibers [1/um].
    Sigma = 2,
}

/// Color of all yarns of one kind, such as warp or weft. Zeroed memory means non-absorbing fibers.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlywaveYarnColor {
    /// A `PlywaveYarnColorKind`.
    pub kind: i32,
    /// The color for `PLYWAVE_YARN_COLOR_KIND_SRGB`, gamma encoded, 0 to 1.
    pub srgb: [f32; 3],
    /// The absorption for `PLYWAVE_YARN_COLOR_KIND_SIGMA` [1/um], 0 or more.
    pub sigma_per_um: f32,
}

/// A target color and the color that the cloth reaches.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlywaveColorReach {
    /// Target color [sRGB, 0 to 1].
    pub asked: [f32; 3],
    /// Color of the cloth [sRGB; outside 0 to 1 if out of gamut].
    pub comes_out: [f64; 3],
    /// CIEDE2000 between the two; about 1 is just visible.
    pub delta_e: f64,
    /// Numbers of the 81 wavelengths at which the target was brighter than non-absorbing fibers, and darker
    /// than black ones.
    pub clamped: [u32; 2],
}

impl From<ColorReach> for PlywaveColorReach {
    fn from(c: ColorReach) -> PlywaveColorReach {
        let clamped = c.clamped.map(|n| n as u32);
        PlywaveColorReach { asked: c.asked, comes_out: c.comes_out, delta_e: c.delta_e, clamped }
    }
}

impl From<ColorOf> for PlywaveColorOf {
    fn from(of: ColorOf) -> PlywaveColorOf {
        match of {
            ColorOf::EvenSky => PlywaveColorOf::EvenSky,
            ColorOf::Reflected => PlywaveColorOf::Reflected,
            ColorOf::Folded => PlywaveColorOf::Folded,
        }
    }
}

/// A `PlywaveColorOf` in C's representation.
pub(crate) fn color_of(value: i32) -> Checked<ColorOf> {
    match value {
        0 => Ok(ColorOf::EvenSky),
        1 => Ok(ColorOf::Reflected),
        2 => Ok(ColorOf::Folded),
        other => Err(invalid("color_of", other, "a PlywaveColorOf, 0 to 2")),
    }
}

pub(crate) fn yarn_color(of: &PlywaveYarnColor) -> Checked<YarnColor> {
    match of.kind {
        0 => Ok(YarnColor::Undyed),
        1 if of.srgb.iter().all(|c| (0.0..=1.0).contains(c)) => Ok(YarnColor::Srgb(of.srgb)),
        1 => Err(invalid("srgb", of.srgb, "numbers in [0, 1]")),
        2 => Ok(YarnColor::Sigma(absorption(of.sigma_per_um)?)),
        other => Err(invalid("kind", other, "a PlywaveYarnColorKind, 0 to 2")),
    }
}

/// Checks an absorption that a caller sets.
pub(crate) fn absorption(sigma: f32) -> Checked<f32> {
    if (0.0..f32::INFINITY).contains(&sigma) {
        Ok(sigma)
    } else {
        Err(invalid("sigma_per_um", sigma, "0 or more, finite"))
    }
}
