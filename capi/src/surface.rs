//! What fabrics and cloths share: queries, colors, calls.

use crate::bsdf::{PLYWAVE_MAX_COUNT, PlywaveBsdf, PlywaveSample, prepare};
use crate::ply::PlywavePly;
use crate::pointer::{
    all_finite, disjoint, numbers, optional, pointer, put, reference, slice, slice_mut, span, unit, within,
};
use crate::queries::{Counted, by_count, count_of, eval_queries, sample_queries, wavelengths};
use crate::status::{AtIndex, Checked, invalid};
use plywave::cloth::ClothSurface;
use plywave::fabric::{Channels, ColorOf, ColorReach, YarnColor};
use plywave::{Bsdf, FabricQuery, PlyModel};

/// Meaning of the numbers of a color; the `channels` of a query.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlywaveChannels {
    /// Light of the query's wavelengths: a spectral host.
    Wavelengths = 0,
    /// Linear RGB of the primaries of sRGB. For a count of 3.
    LinearSrgb = 1,
    /// Linear RGB of the wider primaries of BT.2020. For a count of 3.
    LinearRec2020 = 2,
}

/// Quantity that a target color refers to.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlywaveColorOf {
    /// The cloth under a uniform sky all around: reflected and transmitted light over the light that hits
    /// fibers.
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
    /// No color: clear fibers.
    Undyed = 0,
    /// A color [sRGB, 0 to 1].
    Srgb = 1,
    /// An absorption coefficient of the fibers [1/um].
    Sigma = 2,
}

/// Color of the yarns of a kind, such as warp or weft. Zeroed memory means clear fibers.
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

/// A query at a shading point of a fabric or a cloth. Start from zeroed memory: 0 and NULL mean the default;
/// `count` and `wo` are required.
///
/// The surface's frame: x along the weft (along u), y along the warp (along v), z the normal of the face; of
/// a knit x along the courses, y along the wales. Warp and weft are the first and the second kind of yarn of
/// a cloth; of a cloth with one kind, the weft's have no effect.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct PlywaveFabricQuery {
    /// Point in the plane of the cloth [um], each coordinate within 1e10 of 0: uv times the size of a unit
    /// of uv. Beyond 1e7, 10 m, consecutive f32 values are 1 um apart and more.
    pub position_um: [f32; 2],
    /// Direction towards the viewer, unit.
    pub wo: [f32; 3],
    /// Number of wavelengths or channels: 1, 3 or 4.
    pub count: i32,
    /// Wavelengths [um]. All 0 with a count of 3: 0.612, 0.549 and 0.464, those of red, green and blue. RGB
    /// channels need them too, for diffraction and speckle.
    pub lambda_um: [f32; PLYWAVE_MAX_COUNT],
    /// A `PlywaveChannels`.
    pub channels: i32,
    /// Angle by which the pattern is turned about the normal at the point [rad], within 1e6 of 0, from x
    /// towards y. The position lies in the turned pattern's plane, in the surface's axes.
    pub turn_rad: f32,
    /// `[count]` absorptions [1/um] of the warp at the point, for textures and prints, or NULL for its
    /// own. Read during the call only.
    pub sigma_warp_per_um: *const f32,
    /// The same for the weft.
    pub sigma_weft_per_um: *const f32,
    /// Models that override those of the warp and the weft, from `plywave_ply_of_lines`, of the same ply
    /// radius and number of plies, or NULL. They must outlive the query prepared with them.
    pub models: [*const PlywavePly; 2],
    /// Diameter of the area of cloth that the point represents [um], such as a pixel's footprint: beyond one
    /// repeat the mean over the repeat is used, if the handle has it: see `far` and `no_far` of the options.
    /// 0 for a point; never negative.
    pub footprint_um: f32,
}

impl Counted for PlywaveFabricQuery {
    fn count(&self) -> i32 {
        self.count
    }
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
    /// Number of the 81 wavelengths at which the target was brighter than clear fibers, and darker than black
    /// ones.
    pub clamped: [u32; 2],
}

/// A handle of a fabric or a cloth.
pub(crate) trait SurfaceHandle {
    /// Its surface.
    type Surface: ClothSurface;
    /// Name of the argument in messages.
    const ARGUMENT: &'static str;

    fn surface(&self) -> &Self::Surface;

    /// Its different colors in sRGB.
    fn colors(&self) -> Vec<ColorReach>;

    /// The absorption [1/um] that gives it a reflectance.
    fn sigma_of_reflectance(&self, reflectance: f32) -> f32;
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

/// A `PlywaveColorOf` as C passes it.
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

/// An absorption that must be valid when a caller sets it.
pub(crate) fn absorption(sigma: f32) -> Checked<f32> {
    if (0.0..f32::INFINITY).contains(&sigma) {
        Ok(sigma)
    } else {
        Err(invalid("sigma_per_um", sigma, "0 or more, finite"))
    }
}

#[inline(always)]
fn channels_of(channels: i32, count: usize) -> Checked<Channels> {
    match (channels, count) {
        (0, _) => Ok(Channels::Wavelengths),
        (1, 3) => Ok(Channels::LinearSrgb),
        (2, 3) => Ok(Channels::LinearRec2020),
        (1 | 2, _) => Err(invalid("count", count, "3 channels of RGB")),
        _ => Err(invalid("channels", channels, "a PlywaveChannels, 0 to 2")),
    }
}

/// Farthest position [um]: 10 km, where consecutive f32 values are 1 mm apart.
const MAX_UM: f32 = 1e10;
/// Greatest turn [rad], where consecutive f32 values are 0.06 apart.
const MAX_RAD: f32 = 1e6;

/// The query as a Rust type.
///
/// # Safety
/// Its pointers are NULL or point to live memory.
#[inline(always)]
unsafe fn query_of<'a, const N: usize>(q: &PlywaveFabricQuery) -> Checked<FabricQuery<'a, N>> {
    for position in q.position_um {
        within(position, -MAX_UM, MAX_UM, "position_um")?;
    }
    unit(q.wo, "wo")?;
    within(q.turn_rad, -MAX_RAD, MAX_RAD, "turn_rad")?;
    within(q.footprint_um, 0.0, f32::MAX, "footprint_um")?;
    let sigma = |p: *const f32, name: &str| -> Checked<Option<[f32; N]>> {
        if p.is_null() {
            return Ok(None);
        }
        // SAFETY: the caller's pointer, as documented; it has N numbers.
        let sigma = unsafe { numbers(p, name) }?;
        all_finite(&sigma, name)?;
        Ok(Some(sigma))
    };
    let model = |p: *const PlywavePly| -> Checked<Option<&'a PlyModel>> {
        // SAFETY: the caller's pointer, as documented.
        Ok(unsafe { optional(p, "models") }?.map(|ply| &ply.0))
    };
    Ok(FabricQuery {
        channels: channels_of(q.channels, N)?,
        sigma_per_um: [
            sigma(q.sigma_warp_per_um, "sigma_warp_per_um")?,
            sigma(q.sigma_weft_per_um, "sigma_weft_per_um")?,
        ],
        turn_rad: q.turn_rad,
        footprint_um: q.footprint_um,
        models: [model(q.models[0])?, model(q.models[1])?],
        ..FabricQuery::new(q.position_um, q.wo, wavelengths(&q.lambda_um)?)
    })
}

/// Prepares the surface at a query.
///
/// # Safety
/// The caller's pointers, as documented.
#[inline(always)]
pub(crate) unsafe fn at<H: SurfaceHandle>(
    handle: *const H,
    query: *const PlywaveFabricQuery,
    bsdf: *mut PlywaveBsdf,
) -> Checked {
    // SAFETY: the caller's pointers, as documented.
    let (of, q) = unsafe { (reference(handle, H::ARGUMENT)?.surface(), reference(query, "query")?) };
    by_count!(q.count, N => {
        // SAFETY: as above.
        unsafe {
            let query = query_of::<N>(q)?;
            prepare(bsdf, || of.surface_at(&query))
        }
    })
}

/// f and pdf of `n` queries, one direction each.
///
/// # Safety
/// The caller's pointers, as documented.
#[inline(always)]
pub(crate) unsafe fn eval_batch<H: SurfaceHandle>(
    handle: *const H,
    n: usize,
    queries: *const PlywaveFabricQuery,
    w: *const f32,
    f: *mut f32,
    pdf: *mut f32,
) -> Checked {
    // SAFETY: the caller's pointers, as documented.
    let (of, queries) = unsafe { (reference(handle, H::ARGUMENT)?.surface(), slice(queries, n, "queries")?) };
    by_count!(count_of(queries)?, N => {
        // SAFETY: as above.
        unsafe { eval_queries::<_, N>(queries, w, f, pdf, |q, w| Ok(of.surface_at(&query_of(q)?).eval_pdf(w))) }
    })
}

/// Samples of `n` queries, one each.
///
/// # Safety
/// The caller's pointers, as documented.
#[inline(always)]
pub(crate) unsafe fn sample_batch<H: SurfaceHandle>(
    handle: *const H,
    n: usize,
    queries: *const PlywaveFabricQuery,
    u: *const f32,
    samples: *mut PlywaveSample,
) -> Checked {
    // SAFETY: the caller's pointers, as documented.
    let (of, queries) = unsafe { (reference(handle, H::ARGUMENT)?.surface(), slice(queries, n, "queries")?) };
    by_count!(count_of(queries)?, N => {
        // SAFETY: as above.
        unsafe { sample_queries::<_, N>(queries, u, samples, |q, u| Ok(of.surface_at(&query_of(q)?).sample(u))) }
    })
}

/// The first `capacity` colors to `colors`, their number to `*count`.
///
/// # Safety
/// The caller's pointers, as documented.
pub(crate) unsafe fn put_colors<H: SurfaceHandle>(
    handle: *const H,
    colors: *mut PlywaveColorReach,
    capacity: usize,
    count: *mut usize,
) -> Checked {
    // SAFETY: the caller's pointers, as documented.
    let (of, out) = unsafe { (reference(handle, H::ARGUMENT)?, slice_mut(colors, capacity, "colors")?) };
    let all = of.colors();
    for (out, c) in out.iter_mut().zip(&all) {
        let clamped = c.clamped.map(|n| n as u32);
        *out = PlywaveColorReach { asked: c.asked, comes_out: c.comes_out, delta_e: c.delta_e, clamped };
    }
    // SAFETY: as above.
    unsafe { put(count, all.len(), "count") }
}

/// Absorptions of `n` reflectances, which may be the same array.
///
/// # Safety
/// The caller's pointers, as documented.
pub(crate) unsafe fn put_sigma<H: SurfaceHandle>(
    handle: *const H,
    n: usize,
    reflectance: *const f32,
    sigma_per_um: *mut f32,
) -> Checked {
    // SAFETY: the caller's pointers, as documented.
    let of = unsafe {
        // One by one through pointers: the two may be the same array, and then slices of both must not
        // exist.
        for (i, r) in slice(reflectance, n, "reflectance")?.iter().enumerate() {
            if !(0.0..=1.0).contains(r) {
                return Err(invalid("reflectance", r, "a number in [0, 1]")).at(i);
            }
        }
        reference(handle, H::ARGUMENT)?
    };
    if n == 0 {
        return Ok(());
    }
    pointer(sigma_per_um, "sigma_per_um")?;
    if sigma_per_um.addr() != reflectance.addr() {
        disjoint(span(sigma_per_um, n), &[span(reflectance, n)], "sigma_per_um")?;
    }
    for i in 0..n {
        // SAFETY: both have n entries; entry i is read before it is written.
        unsafe {
            let sigma = of.sigma_of_reflectance(reflectance.add(i).read());
            sigma_per_um.add(i).write(sigma);
        }
    }
    Ok(())
}
