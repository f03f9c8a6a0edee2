//! Queries of cloths in C's layout, and their conversion.

use crate::bsdf::PLYWAVE_MAX_COUNT;
use crate::ply::PlywavePly;
use crate::pointer::{all_finite, numbers, optional, unit, within};
use crate::queries::{Counted, wavelengths};
use crate::status::{Checked, invalid};
use plywave::cloth::Channels;
use plywave::{ClothQuery, PlyModel};

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

/// A query at a shading point of a cloth. Start from zeroed memory: 0 and NULL mean the default;
/// `count` and `wo` are required.
///
/// The surface's frame: x along the weft (along u), y along the warp (along v), z the normal of the face; for
/// a knit, x along the courses and y along the wales. Warp and weft are the first and the second kind of yarn
/// of a cloth; for a cloth with one kind, the values of the weft have no effect.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct PlywaveClothQuery {
    /// Point in the plane of the cloth [um], each coordinate within 1e10 of 0: uv times the size of one unit
    /// of uv. Beyond 1e7 (10 m), consecutive f32 values are at least 1 um apart.
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
    /// Rotation of the pattern about the normal at the point [rad], within 1e6 of 0, from x towards y. The
    /// position lies in the plane of the rotated pattern, in the surface's axes.
    pub turn_rad: f32,
    /// `[count]` absorptions [1/um] of the warp at the point, for textures and prints, or NULL for the
    /// cloth's own. Read during the call only.
    pub sigma_warp_per_um: *const f32,
    /// The same for the weft.
    pub sigma_weft_per_um: *const f32,
    /// Models that override those of the warp and the weft, from `plywave_ply_of_lines`, of the same ply
    /// radius and number of plies, or NULL. They must outlive the query prepared with them.
    pub models: [*const PlywavePly; 2],
    /// Diameter of the area of cloth that the query represents [um], such as a pixel's footprint. Beyond the
    /// size of the cell, the mean over the cell is used if the file has it (see `no_far` of the options). 0
    /// for a point; never negative.
    pub footprint_um: f32,
}

impl Counted for PlywaveClothQuery {
    fn count(&self) -> i32 {
        self.count
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
/// Largest rotation [rad], where consecutive f32 values are 0.06 apart.
const MAX_RAD: f32 = 1e6;

/// Converts the query to the Rust type.
///
/// # Safety
/// Its pointers are NULL or point to live memory.
#[inline(always)]
pub(crate) unsafe fn query_of<'a, const N: usize>(q: &PlywaveClothQuery) -> Checked<ClothQuery<'a, N>> {
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
    Ok(ClothQuery {
        channels: channels_of(q.channels, N)?,
        sigma_per_um: [
            sigma(q.sigma_warp_per_um, "sigma_warp_per_um")?,
            sigma(q.sigma_weft_per_um, "sigma_weft_per_um")?,
        ],
        turn_rad: q.turn_rad,
        footprint_um: q.footprint_um,
        models: [model(q.models[0])?, model(q.models[1])?],
        ..ClothQuery::new(q.position_um, q.wo, wavelengths(&q.lambda_um)?)
    })
}
