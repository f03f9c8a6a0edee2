//! The inputs of one shading point of a cloth, and the options with which a cloth is loaded.
//!
//! A [`ClothQuery`] holds the point in the plane of the cloth [um], the direction towards the viewer, the
//! wavelengths or color channels and the footprint. [`ClothOptions`] switches effects on and off. The
//! functions below clean the inputs: they never fail, and replace values that are not finite.

use crate::PlyModel;
use crate::cloth::color::dye::Channels;
use crate::cloth::yarn_look::Slits;
use crate::color::RGB_LAMBDA_UM;
use crate::frame::to_pattern;

/// Propagation of the light through the gaps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GapLight {
    /// The aperture diffracts it.
    #[default]
    Diffracted,
    /// It goes straight on, as in ray optics, for comparison; [`crate::Bsdf::straight`] returns its energy.
    Straight,
}

/// Options of shading, fixed when the cloth is loaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClothOptions {
    /// Propagation of the light through the gaps.
    pub gaps: GapLight,
    /// One absorption [1/um] for all yarns at every wavelength, in place of their colors; 0 for a white
    /// furnace.
    pub sigma_per_um: Option<f32>,
    /// Speckle: f_refl and f_high of each ply have patterns that change along its fibers and from fiber to
    /// fiber. Models without noise tables stay smooth.
    pub noise: bool,
    /// Plies show the fibers on their surface. If false, they are smooth tubes.
    pub relief: bool,
    /// The layer below intercepts light that a ply sends downwards. If false, the cloth is shaded as a single
    /// layer, for comparison (Yu 2025, Fig. 13).
    pub layers: bool,
    /// Neighboring yarns intercept light that a ply sends back. If false, they do not, as in the paper, for
    /// comparison.
    pub shadowing: bool,
    /// Light that passes beside the ply that the line hits is diffracted at the ply's edge. If false, it goes
    /// straight on.
    pub edges: bool,
    /// Slits between the fibers of all yarns; they override those of the spec. They diffract light where a
    /// line hits yarns of one kind, and only in point queries: the mean over the cell leaves them out.
    pub slits: Option<Slits>,
    /// Yarns are as uneven as the spec says. If false, all repeats are equal.
    pub uneven: bool,
    /// Queries with a footprint ([`ClothQuery::footprint_um`]) use the mean over the cell, if the cloth file
    /// has it. If false, footprints only blur relief.
    pub far: bool,
}

impl ClothOptions {
    /// All effects except speckle, with the colors of the spec.
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
    /// Even and without diffraction, as in ray optics: the configuration of the explicit-fiber twin.
    pub const RAYS: ClothOptions = ClothOptions {
        gaps: GapLight::Straight,
        edges: false,
        slits: Some(Slits::NONE),
        uneven: false,
        relief: false,
        ..ClothOptions::SMOOTH
    };

    /// The slits of a yarn: those of the options, or else its own; `None` if no light passes through them.
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

/// The inputs of one shading point of a cloth, for N wavelengths or color channels. [`ClothQuery::new`] is
/// the cloth as its spec describes it; a color, a rotation or models of the point's own are set by struct
/// update: `ClothQuery { turn_rad: 0.3, ..ClothQuery::new(..) }`.
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
    /// Point in the plane of the cloth [um]; x runs along the weft and y along the warp of a woven cloth.
    pub position_um: [f32; 2],
    /// Unit direction towards the viewer in the frame of the surface; z is the normal of the cloth's face.
    pub wo: [f32; 3],
    /// Wavelengths [um].
    pub lambda_um: [f32; N],
    /// Meaning of the N numbers of a color.
    pub channels: Channels,
    /// The point's own absorptions [1/um] of the kinds of yarns, warp and weft, for textures and prints; they
    /// override the colors of the yarns. A host converts colors with
    /// [`crate::ClothModel::sigma_of_reflectance`].
    pub sigma_per_um: [Option<[f32; N]>; 2],
    /// Rotation of the pattern about the normal at the point [rad], from x towards y. The position is a point
    /// in the plane of the rotated pattern, given in the surface's axes. A value that is not finite counts as
    /// 0.
    pub turn_rad: f32,
    /// Ply models that replace the cloth's own, by kind of yarn; made by [`PlyModel::of_lines`] for the same
    /// ply radius.
    pub models: [Option<&'a PlyModel>; 2],
    /// Diameter of the part of the cloth that the point represents [um], for example a pixel's; 0 for a
    /// point. The mean over the cell is blended in from half a cell on and is the whole answer beyond one
    /// cell. It needs [`ClothOptions::far`], which is off by default, and a file that has the tables;
    /// [`crate::ClothModel::has_far`] tells. Otherwise, and at points with models of their own, the footprint
    /// only blurs relief and speckle. A NaN footprint gets no mean.
    pub footprint_um: f32,
}

impl<const N: usize> ClothQuery<'_, N> {
    /// The cloth as its spec describes it, at a point [um] seen from the viewer `wo`, at wavelengths [um].
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
    /// The same query for a host that renders in linear sRGB: see [`Channels::LinearSrgb`].
    pub fn rgb(position_um: [f32; 2], wo: [f32; 3]) -> Self {
        ClothQuery { channels: Channels::LinearSrgb, ..ClothQuery::new(position_um, wo, RGB_LAMBDA_UM) }
    }
}

/// Largest coordinate of a point [um], 10 m. Beyond it single precision cannot tell fibers apart.
const FAR_UM: f32 = 1e7;

/// Returns the point with each coordinate that is NaN or beyond [`FAR_UM`] replaced by 0.
pub(crate) fn position(x_um: f32, y_um: f32) -> [f32; 2] {
    [x_um, y_um].map(|p| if p.abs() <= FAR_UM { p } else { 0.0 })
}

/// Normalizes a direction. A direction that is already unit is returned unchanged; NaN and lengths outside of
/// 1e-6 to 1e6 give the normal of the face, [0, 0, 1].
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

/// Transforms a query into the frame of its pattern: cosine and sine of the rotation, the point [um], and the
/// direction towards the viewer.
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
