//! What a cloth is asked, and how it is shaded.

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

/// How a cloth is shaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClothOptions {
    /// Light through the gaps.
    pub gaps: GapLight,
    /// One absorption [1/um] at every wavelength for all yarns, in place of their colors; 0 for a white
    /// furnace.
    pub sigma_per_um: Option<f32>,
    /// Speckle: f_refl and f_high of each ply have patterns, which change along its fibers and from fiber to
    /// fiber. Models without noise stay smooth.
    pub noise: bool,
    /// Plies show the fibers on their surface. Without, they are smooth tubes.
    pub relief: bool,
    /// The layer below catches what a ply sends on. Without, as a single layer: for comparison (Yu 2025, Fig.
    /// 13).
    pub layers: bool,
    /// Yarns catch what their neighbors send back. Without, as the paper has it: for comparison.
    pub shadowing: bool,
    /// Light that passes beside a ply that the line meets is diffracted at its edge. Without, it goes
    /// straight on.
    pub edges: bool,
    /// Slits between the fibers of all yarns, in place of those of the spec. They diffract light
    /// where a line hits yarns of one kind, of points alone: the mean over the cell does without.
    pub slits: Option<Slits>,
    /// Yarns are as uneven as the spec has them. Without, every repeat is as the next.
    pub uneven: bool,
    /// Queries with a footprint ([`ClothQuery::footprint_um`]) get the mean over the cell, if the cloth file
    /// has it. Without, footprints blur relief alone.
    pub far: bool,
}

impl ClothOptions {
    /// All parts but speckle; the colors of the spec.
    pub const SMOOTH: ClothOptions = ClothOptions {
        gaps: GapLight::Diffracted,
        sigma_per_um: None,
        noise: false,
        relief: true,
        layers: true,
        shadowing: true,
        edges: true,
        slits: None,
        uneven: true,
        far: false,
    };
}

impl ClothOptions {
    /// Even and without diffraction, as ray optics has it: what a twin of explicit fibers traces.
    pub const RAYS: ClothOptions = ClothOptions {
        gaps: GapLight::Straight,
        edges: false,
        slits: Some(Slits::NONE),
        uneven: false,
        relief: false,
        ..ClothOptions::SMOOTH
    };

    /// The slits of a yarn: these, or else its own; `None` where no light goes through any.
    pub fn slits_or(&self, own: Option<Slits>) -> Option<Slits> {
        self.slits.or(own).filter(|slits| slits.share != 0.0)
    }
}

impl Default for ClothOptions {
    /// [`ClothOptions::SMOOTH`].
    fn default() -> Self {
        ClothOptions::SMOOTH
    }
}

/// What fixes a shading point of a cloth, for N wavelengths or color channels. [`ClothQuery::new`] is the
/// cloth as its spec has it; a point's own color, turn or models are options to set:
/// `ClothQuery { turn_rad: 0.3, ..ClothQuery::new(..) }`.
///
/// ```
/// use plywave::ClothQuery;
///
/// let spectral = ClothQuery::new([120.0, 40.0], [0.0, 0.6, 0.8], [0.45, 0.55, 0.65]);
/// let turned = ClothQuery { turn_rad: 0.3, ..spectral };
/// let rgb = ClothQuery::rgb([120.0, 40.0], [0.0, 0.6, 0.8]);
/// # assert!(turned.turn_rad > rgb.turn_rad);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct ClothQuery<'a, const N: usize> {
    /// Point in the plane of the cloth [um]; x along the weft and y along the warp of a woven one.
    pub position_um: [f32; 2],
    /// Direction towards the viewer, unit, in the frame of the surface: z is the normal of the cloth's face.
    pub wo: [f32; 3],
    /// Wavelengths [um].
    pub lambda_um: [f32; N],
    /// What the N numbers of a color are.
    pub channels: Channels,
    /// The point's own absorptions of the kinds of yarns, warp and weft [1/um], for textures and prints, in
    /// place of those of the yarns' colors; a host gets them from
    /// [`crate::ClothModel::sigma_of_reflectance`].
    pub sigma_per_um: [Option<[f32; N]>; 2],
    /// Angle by which the pattern is turned about the normal at the point [rad], from x towards y. The
    /// position is one of the turned pattern's plane, given in the surface's axes.
    pub turn_rad: f32,
    /// Ply models of the kinds of yarns in place of the cloth's, made by [`PlyModel::of_lines`]; of the same
    /// ply radius.
    pub models: [Option<&'a PlyModel>; 2],
    /// Diameter of the part of the cloth that the point stands for [um], as of a pixel: from half a cell on
    /// the mean over the cell takes part, and beyond a cell it is all. 0 for a point. The mean needs
    /// [`ClothOptions::far`] when the cloth is loaded, which is off by default, and a file that has it:
    /// [`crate::ClothModel::has_far`] says so. Without, and at points with models of their own, a footprint
    /// blurs relief and speckle alone.
    pub footprint_um: f32,
}

impl<const N: usize> ClothQuery<'_, N> {
    /// The cloth as its spec has it, at a point [um] seen from `wo`, at wavelengths [um].
    pub fn new(position_um: [f32; 2], wo: [f32; 3], lambda_um: [f32; N]) -> Self {
        ClothQuery {
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

impl ClothQuery<'_, 3> {
    /// The cloth for a host that renders in linear sRGB: see [`Channels::LinearSrgb`].
    pub fn rgb(position_um: [f32; 2], wo: [f32; 3]) -> Self {
        ClothQuery { channels: Channels::LinearSrgb, ..ClothQuery::new(position_um, wo, RGB_LAMBDA_UM) }
    }
}

/// Points beyond this distance from the origin count as at it [um]: 10 m, where single precision ends to tell
/// fibers apart.
const FAR_UM: f32 = 1e7;

/// A point of the plane. Not a number counts as 0, as far does.
pub(crate) fn position(x_um: f32, y_um: f32) -> [f32; 2] {
    [x_um, y_um].map(|p| if p.abs() <= FAR_UM { p } else { 0.0 })
}

/// A direction as it came, made unit; what is none counts as the face's normal.
pub(crate) fn unit(w: [f32; 3]) -> [f32; 3] {
    let squared = w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
    if (squared - 1.0).abs() < 1e-5 {
        return w;
    }
    if !(1e-12..1e12).contains(&squared) {
        return [0.0, 0.0, 1.0];
    }
    let scale = 1.0 / squared.sqrt();
    w.map(|v| v * scale)
}

/// A direction of the surface's frame in that of the pattern, turned by an angle of this cosine and sine.
pub(crate) fn to_pattern([c, s]: [f32; 2], w: [f32; 3]) -> [f32; 3] {
    [c * w[0] + s * w[1], c * w[1] - s * w[0], w[2]]
}

/// The inverse of [`to_pattern`].
pub(crate) fn to_surface([c, s]: [f32; 2], w: [f32; 3]) -> [f32; 3] {
    to_pattern([c, -s], w)
}

/// The turn of a query's pattern, its point [um] and its direction to the viewer in the frame of the pattern.
pub(crate) fn in_pattern<const N: usize>(query: &ClothQuery<'_, N>) -> ([f32; 2], [f32; 2], [f32; 3]) {
    let turned = query.turn_rad != 0.0 && query.turn_rad.is_finite();
    let turn = if turned { [query.turn_rad.cos(), query.turn_rad.sin()] } else { [1.0, 0.0] };
    let ([x, y], mut wo) = (query.position_um, unit(query.wo));
    let mut at = [x, y];
    if turned {
        let p = to_pattern(turn, [x, y, 0.0]);
        (at, wo) = ([p[0], p[1]], to_pattern(turn, wo));
    }
    (turn, position(at[0], at[1]), wo)
}
