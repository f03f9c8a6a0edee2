//! What a fabric is asked, and how it is shaded.

use super::dye::Channels;
use crate::PlyModel;
use crate::color::RGB_LAMBDA_UM;

/// What light through the gaps does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GapLight {
    /// It is diffracted by the aperture.
    #[default]
    Diffracted,
    /// It goes straight on, as rays do: for comparison. [`crate::Bsdf::straight`] is its energy.
    Straight,
}

/// Slits between the fibers of a yarn (Yu 2025, 7.3), [`Slit`], for those who want their colors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slits {
    /// Their width [um], above 0 and at most [`crate::gap::SLIT_MAX_UM`].
    pub width_um: f32,
    /// Share of a ply's forward light that goes through them, 0 to 1; [`crate::gap::SLIT_SHARE`] in the
    /// paper. At 0 there are none.
    pub share: f32,
}

impl Slits {
    /// No slits, whatever the spec has.
    pub const NONE: Slits = Slits { width_um: 1.0, share: 0.0 };
}

/// How a fabric is shaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FabricOptions {
    /// Light through the gaps.
    pub gaps: GapLight,
    /// One absorption [1/um] at every wavelength for all yarns, in place of their colors; 0 for a white
    /// furnace.
    pub sigma_per_um: Option<f32>,
    /// Speckle: every stretch of a ply as long as the beam's waist is wide has patterns of its own. Models
    /// without noise stay smooth.
    pub noise: bool,
    /// The layer below catches what a ply sends on. Without, as a single layer: for comparison (Yu 2025, Fig.
    /// 13).
    pub layers: bool,
    /// Yarns catch what their neighbors send back. Without, as the paper has it: for comparison.
    pub shadowing: bool,
    /// Light that passes beside a ply that the line meets is diffracted at its edge. Without, it goes
    /// straight on.
    pub edges: bool,
    /// Slits between the fibers of all yarns, in place of those that the spec gives each family. They
    /// diffract light where one layer of yarn lies, of points alone: the mean over the repeat does without.
    pub slits: Option<Slits>,
    /// The mean over the repeat is made ready, some seconds, for queries with a footprint
    /// ([`FabricQuery::footprint_um`]). Without, footprints count as points.
    pub far: bool,
}

impl FabricOptions {
    /// All parts but speckle; the colors of the spec.
    pub const SMOOTH: FabricOptions = FabricOptions {
        gaps: GapLight::Diffracted,
        sigma_per_um: None,
        noise: false,
        layers: true,
        shadowing: true,
        edges: true,
        slits: None,
        far: false,
    };
}

impl FabricOptions {
    /// Without diffraction, as ray optics has it: what a twin of explicit fibers traces.
    pub const RAYS: FabricOptions =
        FabricOptions { gaps: GapLight::Straight, edges: false, slits: Some(Slits::NONE), ..FabricOptions::SMOOTH };

    /// The slits of a yarn: these, or else its own; `None` where no light goes through any.
    pub fn slits_or(&self, own: Option<Slits>) -> Option<Slits> {
        self.slits.or(own).filter(|slits| slits.share != 0.0)
    }
}

impl Default for FabricOptions {
    /// [`FabricOptions::SMOOTH`].
    fn default() -> Self {
        FabricOptions::SMOOTH
    }
}

/// What fixes a shading point of a fabric, for N wavelengths or color channels. [`FabricQuery::new`] is the
/// fabric as its spec has it; a point's own color, turn or models are options to set:
/// `FabricQuery { turn_rad: 0.3, ..FabricQuery::new(..) }`.
///
/// ```
/// use plywave::FabricQuery;
///
/// let spectral = FabricQuery::new([120.0, 40.0], [0.0, 0.6, 0.8], [0.45, 0.55, 0.65]);
/// let turned = FabricQuery { turn_rad: 0.3, ..spectral };
/// let rgb = FabricQuery::rgb([120.0, 40.0], [0.0, 0.6, 0.8]);
/// # assert!(turned.turn_rad > rgb.turn_rad);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct FabricQuery<'a, const N: usize> {
    /// Point in the plane of the fabric [um]: x along the weft, y along the warp.
    pub position_um: [f32; 2],
    /// Direction towards the viewer, unit, in the frame of the surface: z is the normal of the fabric's face.
    pub wo: [f32; 3],
    /// Wavelengths [um].
    pub lambda_um: [f32; N],
    /// What the N numbers of a color are.
    pub channels: Channels,
    /// The point's own absorptions of warp and weft [1/um], for textures and prints, in place of those of the
    /// yarns' colors; a host gets them from
    /// [`FabricModel::sigma_of_reflectance`].
    pub sigma_per_um: [Option<[f32; N]>; 2],
    /// Angle by which the pattern is turned about the normal at the point [rad], from x towards y. The
    /// position is one of the turned pattern's plane, given in the surface's axes.
    pub turn_rad: f32,
    /// Ply models of warp and weft in place of the fabric's, made by [`PlyModel::of_lines`]; of the same ply
    /// radius and number of plies.
    pub models: [Option<&'a PlyModel>; 2],
    /// Diameter of the part of the cloth that the point stands for [um], as of a pixel: from half a repeat on
    /// the mean over the repeat takes part, and beyond a repeat it is all. 0 for a point. Fabrics loaded
    /// without [`FabricOptions::far`], and points with models of their own, do without.
    pub footprint_um: f32,
}

impl<const N: usize> FabricQuery<'_, N> {
    /// The fabric as its spec has it, at a point [um] seen from `wo`, at wavelengths [um].
    pub fn new(position_um: [f32; 2], wo: [f32; 3], lambda_um: [f32; N]) -> Self {
        FabricQuery {
            position_um,
            wo,
            lambda_um,
            channels: Channels::Wavelengths,
            sigma_per_um: [None; 2],
            turn_rad: 0.0,
            models: [None; 2],
            footprint_um: 0.0,
        }
    }
}

impl FabricQuery<'_, 3> {
    /// The fabric for a host that renders in linear sRGB: see [`Channels::LinearSrgb`].
    pub fn rgb(position_um: [f32; 2], wo: [f32; 3]) -> Self {
        FabricQuery { channels: Channels::LinearSrgb, ..FabricQuery::new(position_um, wo, RGB_LAMBDA_UM) }
    }
}
