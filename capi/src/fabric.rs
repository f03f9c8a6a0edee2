//! Woven fabrics.

use crate::bsdf::{PLYWAVE_MAX_COUNT, PlywaveBsdf, PlywaveSample, prepare, unprepare};
use crate::ply::PlywavePly;
use crate::pointer::{
    all_finite, disjoint, numbers, optional, pointer, put, put_text, reference, slice, slice_mut, span, text, unit,
    within,
};
use crate::queries::{Counted, by_count, count_of, eval_queries, hand_out, sample_queries, take_back, wavelengths};
use crate::status::{AtIndex, Checked, PlywaveError, PlywaveStatus, failure, guard, invalid};
use plywave::fabric::{
    Channels, ColorOf, FabricOptions, FabricSpec, GapLight, LoadedFabric, Slits, YarnColor, YarnSet,
};
use plywave::io::MemoryAssets;
use plywave::{Bsdf, FabricModel, FabricQuery, PlyModel};
use std::ffi::c_char;

/// A loaded fabric. It is immutable: any number of threads may use it at once.
pub struct PlywaveFabric {
    fabric: FabricModel,
    name: String,
    notes: String,
}

const _: () = {
    const fn is_send_sync<T: Send + Sync>() {}
    is_send_sync::<PlywaveFabric>();
};

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

/// Color of the yarns of warp or weft. Zeroed memory means clear fibers.
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

/// Options of a fabric's shading. Zeroed memory, or NULL in its place, is the whole model without speckle, in
/// the colors of the spec.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlywaveFabricOptions {
    /// Not 0: light goes straight through gaps, as a delta. 0: gaps diffract it.
    pub straight_gaps: i32,
    /// Not 0: light that passes beside a ply goes straight on. 0: it is diffracted at its edge.
    pub no_edges: i32,
    /// Not 0: adds speckle in models that have noise.
    pub noise: i32,
    /// Not 0: uses a single layer of yarn. For comparison.
    pub no_layers: i32,
    /// Not 0: turns off shadows of yarns on their neighbors. For comparison.
    pub no_shadowing: i32,
    /// Not 0: `sigma_per_um` overrides all colors.
    pub has_sigma: i32,
    /// One absorption [1/um] at every wavelength for all yarns; 0 for a white furnace.
    pub sigma_per_um: f32,
    /// Not 0: prepares the mean over the repeat, which takes some seconds, for queries with a footprint. 0:
    /// footprints count as points.
    pub far: i32,
    /// Not 0: all yarns have slits between their fibers by `slit_width_um` and `slit_share`, which override
    /// those of the spec.
    pub has_slits: i32,
    /// Width of the slits [um], above 0 and at most 5.
    pub slit_width_um: f32,
    /// Share of a ply's forward light that goes through the slits (0.25 in the paper); 0 for none.
    pub slit_share: f32,
}

/// A file in memory, for `plywave_fabric_from_memory`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct PlywaveAsset {
    /// Name as the spec has it, UTF-8.
    pub name: *const c_char,
    /// Content of the file.
    pub bytes: *const u8,
    /// Number of bytes.
    pub size: usize,
}

/// A query at a shading point of a fabric. Start from zeroed memory: 0 and NULL mean the default; `count` and
/// `wo` are required.
///
/// The surface's frame: x along the weft (along u), y along the warp (along v), z the normal of the face.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct PlywaveFabricQuery {
    /// Point in the plane of the fabric [um], each coordinate within 1e10 of 0: uv times the size of a unit
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
    /// `[count]` absorptions [1/um] of the warp at the point, for textures and prints, or NULL for the
    /// fabric's own. Read during the call only.
    pub sigma_warp_per_um: *const f32,
    /// The same for the weft.
    pub sigma_weft_per_um: *const f32,
    /// Models that override those of the warp and the weft, from `plywave_ply_of_lines`, of the same ply
    /// radius and number of plies, or NULL. They must outlive the query prepared with them.
    pub models: [*const PlywavePly; 2],
    /// Diameter of the area of cloth that the point represents [um], such as a pixel's footprint: beyond one
    /// repeat the mean over the repeat is used. 0 for a point; never negative. See `far` of the options.
    pub footprint_um: f32,
}

impl Counted for PlywaveFabricQuery {
    fn count(&self) -> i32 {
        self.count
    }
}

/// Description of a fabric. Pairs are warp and weft.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlywaveFabricInfo {
    /// Size of one repeat along x and y [um].
    pub repeat_um: [f64; 2],
    /// Distance between the axes of neighboring yarns [um].
    pub spacing_um: [f64; 2],
    /// Width of a yarn [um].
    pub width_um: [f64; 2],
    /// Plies of a yarn.
    pub plies: [i32; 2],
    /// Ends and picks of one repeat of the draft.
    pub threads: [i32; 2],
    /// Greatest distance of any fiber from the middle plane [um].
    pub half_thickness_um: f32,
    /// Quantity that its colors refer to.
    pub color_of: PlywaveColorOf,
    /// Memory use, without its models.
    pub memory_bytes: u64,
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

fn options_of(of: Option<&PlywaveFabricOptions>) -> Checked<FabricOptions> {
    let Some(o) = of else { return Ok(FabricOptions::default()) };
    let sigma_per_um = (o.has_sigma != 0).then(|| absorption(o.sigma_per_um)).transpose()?;
    Ok(FabricOptions {
        gaps: if o.straight_gaps != 0 { GapLight::Straight } else { GapLight::Diffracted },
        sigma_per_um,
        noise: o.noise != 0,
        layers: o.no_layers == 0,
        shadowing: o.no_shadowing == 0,
        edges: o.no_edges == 0,
        slits: (o.has_slits != 0).then_some(Slits { width_um: o.slit_width_um, share: o.slit_share }),
        far: o.far != 0,
    })
}

/// An absorption that must be valid when a caller sets it.
fn absorption(sigma: f32) -> Checked<f32> {
    if (0.0..f32::INFINITY).contains(&sigma) {
        Ok(sigma)
    } else {
        Err(invalid("sigma_per_um", sigma, "0 or more, finite"))
    }
}

fn handle_of(loaded: LoadedFabric, options: Option<&PlywaveFabricOptions>) -> Checked<PlywaveFabric> {
    let (name, notes) = (loaded.spec.name.clone(), loaded.notes().join("\n"));
    Ok(PlywaveFabric { fabric: FabricModel::new(loaded, &options_of(options)?)?, name, notes })
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

/// Reads a fabric spec (TOML) and the models that it names, which lie in its folder or below. `path` is
/// UTF-8; `options` may be NULL. It takes a second or two, to trace inter-yarn scattering. On an error `*out`
/// is NULL. Release it with `plywave_fabric_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fabric_load(
    path: *const c_char,
    options: *const PlywaveFabricOptions,
    out: *mut *mut PlywaveFabric,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe {
            put(out, std::ptr::null_mut(), "out")?;
            let options = optional(options, "options")?;
            hand_out(out, handle_of(FabricSpec::load(text(path, "path")?)?, options)?)
        }
    })
}

/// Like `plywave_fabric_load`, but from the text of a spec and the files that it names, `assets` `[n]`;
/// `name` identifies the spec in messages.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fabric_from_memory(
    spec: *const c_char,
    name: *const c_char,
    assets: *const PlywaveAsset,
    n: usize,
    options: *const PlywaveFabricOptions,
    out: *mut *mut PlywaveFabric,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe {
            put(out, std::ptr::null_mut(), "out")?;
            let options = optional(options, "options")?;
            let mut files = MemoryAssets::new();
            for (i, asset) in slice(assets, n, "assets")?.iter().enumerate() {
                let name = text(asset.name, "name").at(i)?;
                files.insert(name, slice(asset.bytes, asset.size, "bytes").at(i)?);
            }
            let loaded = FabricSpec::load_from(text(spec, "spec")?, text(name, "name")?, &files)?;
            hand_out(out, handle_of(loaded, options)?)
        }
    })
}

/// Releases a fabric; NULL is allowed. No prepared query and no call may use it afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fabric_free(fabric: *mut PlywaveFabric) {
    guard(std::ptr::null_mut(), || {
        // SAFETY: the caller's handle, released once.
        unsafe { take_back(fabric) };
        Ok(())
    });
}

/// Describes a fabric.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fabric_info(
    fabric: *const PlywaveFabric,
    info: *mut PlywaveFabricInfo,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let f = unsafe { &reference(fabric, "fabric")?.fabric };
        let geometry = f.fabric();
        let shape = YarnSet::EACH.map(|family| geometry.shape(family));
        let value = PlywaveFabricInfo {
            repeat_um: geometry.repeat_um(),
            spacing_um: shape.map(|s| s.spacing_um),
            width_um: shape.map(|s| s.width_um()),
            plies: shape.map(|s| s.plies as i32),
            threads: YarnSet::EACH.map(|family| geometry.draft().threads(family) as i32),
            half_thickness_um: geometry.half_thickness_um(),
            color_of: match f.color_of() {
                ColorOf::EvenSky => PlywaveColorOf::EvenSky,
                ColorOf::Reflected => PlywaveColorOf::Reflected,
                ColorOf::Folded => PlywaveColorOf::Folded,
            },
            memory_bytes: f.memory_bytes() as u64,
        };
        // SAFETY: as above.
        unsafe { put(info, value, "info") }
    })
}

/// Name of a fabric, as its spec has it. The buffer works as in `plywave_ply_spec`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fabric_name(
    fabric: *const PlywaveFabric,
    buffer: *mut c_char,
    size: usize,
    length: *mut usize,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe { put_text(&reference(fabric, "fabric")?.name, buffer, size, length) }
    })
}

/// Notes on a fabric, one per line: assumptions where its WIF is silent or wrong, layers that no yarn joins,
/// and what a model does not contain. The buffer works as in `plywave_ply_spec`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fabric_notes(
    fabric: *const PlywaveFabric,
    buffer: *mut c_char,
    size: usize,
    length: *mut usize,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe { put_text(&reference(fabric, "fabric")?.notes, buffer, size, length) }
    })
}

/// The same fabric in other colors, as a new handle, without tracing again. `color_of` is a `PlywaveColorOf`;
/// if it differs from the fabric's, the call takes tenths of a second.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fabric_with_colors(
    fabric: *const PlywaveFabric,
    warp: *const PlywaveYarnColor,
    weft: *const PlywaveYarnColor,
    color_of: i32,
    out: *mut *mut PlywaveFabric,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (of, warp, weft) = unsafe {
            put(out, std::ptr::null_mut(), "out")?;
            (reference(fabric, "fabric")?, reference(warp, "warp")?, reference(weft, "weft")?)
        };
        let meaning = match color_of {
            0 => ColorOf::EvenSky,
            1 => ColorOf::Reflected,
            2 => ColorOf::Folded,
            other => return Err(invalid("color_of", other, "a PlywaveColorOf, 0 to 2")),
        };
        let colors = [yarn_color(warp)?, yarn_color(weft)?];
        let fabric = of.fabric.with_colors(colors, meaning);
        // SAFETY: as above.
        unsafe { hand_out(out, PlywaveFabric { fabric, name: of.name.clone(), notes: of.notes.clone() }) }
    })
}

fn yarn_color(of: &PlywaveYarnColor) -> Checked<YarnColor> {
    match of.kind {
        0 => Ok(YarnColor::Undyed),
        1 if of.srgb.iter().all(|c| (0.0..=1.0).contains(c)) => Ok(YarnColor::Srgb(of.srgb)),
        1 => Err(invalid("srgb", of.srgb, "numbers in [0, 1]")),
        2 => Ok(YarnColor::Sigma(absorption(of.sigma_per_um)?)),
        other => Err(invalid("kind", other, "a PlywaveYarnColorKind, 0 to 2")),
    }
}

/// The distinct colors of the fabric, each as target and result: the first `capacity` to `colors`, the total
/// number to `*count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fabric_colors(
    fabric: *const PlywaveFabric,
    colors: *mut PlywaveColorReach,
    capacity: usize,
    count: *mut usize,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (of, out) = unsafe { (reference(fabric, "fabric")?, slice_mut(colors, capacity, "colors")?) };
        let all = of.fabric.colors();
        for (out, c) in out.iter_mut().zip(&all) {
            let clamped = c.clamped.map(|n| n as u32);
            *out = PlywaveColorReach { asked: c.asked, comes_out: c.comes_out, delta_e: c.delta_e, clamped };
        }
        // SAFETY: as above.
        unsafe { put(count, all.len(), "count") }
    })
}

/// Absorptions [1/um] with which the cloth has `n` given reflectances, 0 to 1, at wavelengths or in linear
/// RGB: `sigma_per_um` may be `reflectance`. Values out of reach are clamped to clear or black fibers.
/// Convert a texture once, not at every hit. If an entry is invalid, nothing is written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fabric_sigma_of_reflectance(
    fabric: *const PlywaveFabric,
    n: usize,
    reflectance: *const f32,
    sigma_per_um: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let of = unsafe {
            // One by one through pointers: the two may be the same array, and then slices of both must not
            // exist.
            for (i, r) in slice(reflectance, n, "reflectance")?.iter().enumerate() {
                if !(0.0..=1.0).contains(r) {
                    return Err(invalid("reflectance", r, "a number in [0, 1]")).at(i);
                }
            }
            reference(fabric, "fabric")?
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
                let [sigma] = of.fabric.sigma_of_reflectance([reflectance.add(i).read()]);
                sigma_per_um.add(i).write(sigma);
            }
        }
        Ok(())
    })
}

/// Prepares the fabric at a query for any number of directions. On an error `bsdf` is not prepared, whatever
/// it held before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fabric_at(
    fabric: *const PlywaveFabric,
    query: *const PlywaveFabricQuery,
    bsdf: *mut PlywaveBsdf,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    let status = guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (f, q) = unsafe { (&reference(fabric, "fabric")?.fabric, reference(query, "query")?) };
        by_count!(q.count, N => {
            // SAFETY: as above.
            unsafe {
                let query = query_of::<N>(q)?;
                prepare(bsdf, || f.at(&query))
            }
        })
    });
    if status != PlywaveStatus::Ok {
        // SAFETY: as above.
        unsafe { unprepare(bsdf) };
    }
    status
}

/// f and pdf of `n` queries, one direction each: from `queries` `[n]` and `w` `[n][3]` to `f` `[n][count]`
/// and `pdf` `[n]`. All queries have the count of the first.
///
/// If an entry is invalid, the status is that of the first such entry, `error` has its index, and all entries
/// before it are written. `n` = 0 does nothing.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fabric_eval_batch(
    fabric: *const PlywaveFabric,
    n: usize,
    queries: *const PlywaveFabricQuery,
    w: *const f32,
    f: *mut f32,
    pdf: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (of, queries) = unsafe { (&reference(fabric, "fabric")?.fabric, slice(queries, n, "queries")?) };
        by_count!(count_of(queries)?, N => {
            // SAFETY: as above.
            unsafe { eval_queries::<_, N>(queries, w, f, pdf, |q, w| Ok(of.at(&query_of(q)?).eval_pdf(w))) }
        })
    })
}

/// Samples `n` queries once each: from `queries` `[n]` and `u` `[n][3]` to `samples` `[n]`. Errors are as in
/// `plywave_fabric_eval_batch`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fabric_sample_batch(
    fabric: *const PlywaveFabric,
    n: usize,
    queries: *const PlywaveFabricQuery,
    u: *const f32,
    samples: *mut PlywaveSample,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (of, queries) = unsafe { (&reference(fabric, "fabric")?.fabric, slice(queries, n, "queries")?) };
        by_count!(count_of(queries)?, N => {
            // SAFETY: as above.
            unsafe { sample_queries::<_, N>(queries, u, samples, |q, u| Ok(of.at(&query_of(q)?).sample(u))) }
        })
    })
}

/// The ply model of yarn `thread` of the warp (`family` 0) or the weft (1), as its own handle, for its info,
/// spec and check. Release it with `plywave_ply_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_fabric_model(
    fabric: *const PlywaveFabric,
    family: i32,
    thread: i32,
    out: *mut *mut PlywavePly,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let of = unsafe {
            put(out, std::ptr::null_mut(), "out")?;
            reference(fabric, "fabric")?
        };
        let family = usize::try_from(family).ok().and_then(|i| YarnSet::EACH.get(i).copied());
        let family =
            family.ok_or_else(|| failure(PlywaveStatus::InvalidArgument, "family: expected 0 (warp) or 1 (weft)"))?;
        // SAFETY: as above.
        unsafe { hand_out(out, PlywavePly(of.fabric.model_of(family, thread).clone())) }
    })
}
