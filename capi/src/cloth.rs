//! Cloths: loading from files, shading options, colors, queries and batches.

use crate::bsdf::{PlywaveBsdf, PlywaveSample, prepare, unprepare};
use crate::cloth_query::{PlywaveClothQuery, query_of};
use crate::color::{self, PlywaveColorOf, PlywaveColorReach, PlywaveYarnColor, absorption, yarn_color};
use crate::ply::PlywavePly;
use crate::pointer::{disjoint, optional, pointer, put, put_text, reference, slice, slice_mut, span, text};
use crate::queries::{by_count, count_of, eval_queries, hand_out, sample_queries, take_back};
use crate::status::{AtIndex, Checked, PlywaveError, PlywaveStatus, guard, invalid};
use plywave::Bsdf;
use plywave::Document;
use plywave::cloth::{ClothData, ClothModel, ClothOptions, GapLight, Slits};
use plywave::gap::SLIT_MAX_UM;
use std::ffi::c_char;

/// A loaded cloth: woven, knitted or of curves. It is immutable: any number of threads may use it at once.
pub struct PlywaveCloth {
    cloth: ClothModel,
    name: String,
    notes: String,
}

const _: () = {
    const fn is_send_sync<T: Send + Sync>() {}
    is_send_sync::<PlywaveCloth>();
};

/// Options of a cloth's shading. Zeroed memory, or NULL in its place, selects the complete model without
/// speckle, in the colors of the file.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlywaveClothOptions {
    /// Not 0: light passes straight through gaps, as a delta. 0: gaps diffract it.
    pub straight_gaps: i32,
    /// Not 0: light that passes beside a ply continues straight. 0: the ply's edge diffracts it.
    pub no_edges: i32,
    /// Not 0: adds speckle in models that have noise.
    pub noise: i32,
    /// Not 0: plies do not occlude light that others scatter down. For comparison.
    pub no_layers: i32,
    /// Not 0: plies do not occlude light that others scatter up. For comparison.
    pub no_shadowing: i32,
    /// Not 0: all repeats are identical. 0: yarns are as uneven as the spec states.
    pub no_uneven: i32,
    /// Not 0: plies are smooth tubes. 0: they show the fibers on their surface.
    pub no_relief: i32,
    /// Not 0: footprints only blur relief. 0: queries with a footprint use the mean over the cell, if the
    /// file has it.
    pub no_far: i32,
    /// Not 0: `sigma_per_um` overrides all colors.
    pub has_sigma: i32,
    /// One absorption [1/um] at every wavelength for all yarns; 0 for a white furnace.
    pub sigma_per_um: f32,
    /// Not 0: all yarns have slits between their fibers with `slit_width_um` and `slit_share`, which override
    /// those of the spec.
    pub has_slits: i32,
    /// Width of the slits [um], above 0 and at most 5.
    pub slit_width_um: f32,
    /// Share of a ply's forward light that goes through the slits (0.25 in the paper); 0 for none.
    pub slit_share: f32,
}

/// Description of a cloth.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlywaveClothInfo {
    /// Two vectors in the plane of the cloth that span its repeating cell [um].
    pub cell_um: [[f64; 2]; 2],
    /// Largest distance of any fiber from the middle plane [um].
    pub half_thickness_um: f32,
    /// Number of kinds of yarns: 2, warp and weft, for a woven cloth, else 1.
    pub kinds: i32,
    /// Quantity that its colors refer to.
    pub color_of: PlywaveColorOf,
    /// Whether queries with a footprint get the mean over the cell; 0 or 1.
    pub has_far: i32,
    /// Memory use, without its models.
    pub memory_bytes: u64,
}

/// Slits of the options.
fn slits(of: &PlywaveClothOptions) -> Checked<Slits> {
    let (width_um, share) = (of.slit_width_um, of.slit_share);
    if !(width_um > 0.0 && width_um <= SLIT_MAX_UM) {
        return Err(invalid("slit_width_um", width_um, "above 0 and at most 5"));
    }
    if !(0.0..=1.0).contains(&share) {
        return Err(invalid("slit_share", share, "from 0 to 1"));
    }
    Ok(Slits { width_um, share })
}

fn options_of(of: Option<&PlywaveClothOptions>) -> Checked<ClothOptions> {
    let Some(o) = of else { return Ok(ClothOptions { far: true, ..ClothOptions::default() }) };
    Ok(ClothOptions {
        gaps: if o.straight_gaps != 0 { GapLight::Straight } else { GapLight::Diffracted },
        sigma_per_um: (o.has_sigma != 0).then(|| absorption(o.sigma_per_um)).transpose()?,
        noise: o.noise != 0,
        layers: o.no_layers == 0,
        shadowing: o.no_shadowing == 0,
        edges: o.no_edges == 0,
        slits: (o.has_slits != 0).then(|| slits(o)).transpose()?,
        uneven: o.no_uneven == 0,
        relief: o.no_relief == 0,
        far: o.no_far == 0,
    })
}

fn handle_of(data: ClothData, options: Option<&PlywaveClothOptions>) -> Checked<PlywaveCloth> {
    let options = options_of(options)?;
    let (name, notes) = (data.name.clone(), data.notes(&options).join("\n"));
    Ok(PlywaveCloth { cloth: ClothModel::from_data(data, &options)?, name, notes })
}

/// Reads a cloth file (.pwc), which `plywave weave` writes from a cloth spec, in about 10 ms. `path` is
/// UTF-8; `options` may be NULL. On an error `*out` is NULL. Release the cloth with `plywave_cloth_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_cloth_load(
    path: *const c_char,
    options: *const PlywaveClothOptions,
    out: *mut *mut PlywaveCloth,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe {
            put(out, std::ptr::null_mut(), "out")?;
            let options = optional(options, "options")?;
            hand_out(out, handle_of(ClothData::load(text(path, "path")?)?, options)?)
        }
    })
}

/// Like `plywave_cloth_load`, but from the bytes of a file; `name` identifies it in messages.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_cloth_from_memory(
    bytes: *const u8,
    size: usize,
    name: *const c_char,
    options: *const PlywaveClothOptions,
    out: *mut *mut PlywaveCloth,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe {
            put(out, std::ptr::null_mut(), "out")?;
            let options = optional(options, "options")?;
            let data = ClothData::from_bytes(slice(bytes, size, "bytes")?, text(name, "name")?)?;
            hand_out(out, handle_of(data, options)?)
        }
    })
}

/// Releases a cloth; NULL is allowed. No prepared query and no call may use it afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_cloth_free(cloth: *mut PlywaveCloth) {
    guard(std::ptr::null_mut(), || {
        // SAFETY: the caller's handle, released once.
        unsafe { take_back(cloth) };
        Ok(())
    });
}

/// Describes a cloth.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_cloth_info(
    cloth: *const PlywaveCloth,
    info: *mut PlywaveClothInfo,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let c = unsafe { &reference(cloth, "cloth")?.cloth };
        let value = PlywaveClothInfo {
            cell_um: c.cell_um(),
            half_thickness_um: c.lines().half_thickness_um(),
            kinds: c.kinds() as i32,
            color_of: c.color_of().into(),
            has_far: i32::from(c.has_far()),
            memory_bytes: c.memory_bytes() as u64,
        };
        // SAFETY: as above.
        unsafe { put(info, value, "info") }
    })
}

/// Name of a cloth, from its spec. The buffer works as in `plywave_ply_spec`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_cloth_name(
    cloth: *const PlywaveCloth,
    buffer: *mut c_char,
    size: usize,
    length: *mut usize,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe { put_text(&reference(cloth, "cloth")?.name, buffer, size, length) }
    })
}

/// Notes on a cloth, one per line: effects that the options request but the file does not contain. The buffer
/// works as in `plywave_ply_spec`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_cloth_notes(
    cloth: *const PlywaveCloth,
    buffer: *mut c_char,
    size: usize,
    length: *mut usize,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe { put_text(&reference(cloth, "cloth")?.notes, buffer, size, length) }
    })
}

/// The same cloth in other colors, as a new handle, without a new precomputation: `colors` `[n]`, one for
/// each kind of yarn. `color_of` is a `PlywaveColorOf`; if it differs from the cloth's, the call takes tenths
/// of a second.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_cloth_with_colors(
    cloth: *const PlywaveCloth,
    colors: *const PlywaveYarnColor,
    n: usize,
    color_of: i32,
    out: *mut *mut PlywaveCloth,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (of, colors) = unsafe {
            put(out, std::ptr::null_mut(), "out")?;
            (reference(cloth, "cloth")?, slice(colors, n, "colors")?)
        };
        let colors = match (colors, of.cloth.kinds()) {
            ([all], 1) => [yarn_color(all).at(0)?; 2],
            ([warp, weft], 2) => [yarn_color(warp).at(0)?, yarn_color(weft).at(1)?],
            (_, kinds) => return Err(invalid("n", n, &format!("{kinds}, one color for each kind of yarn"))),
        };
        let cloth = of.cloth.with_colors(colors, color::color_of(color_of)?);
        // SAFETY: as above.
        unsafe { hand_out(out, PlywaveCloth { cloth, name: of.name.clone(), notes: of.notes.clone() }) }
    })
}

/// The distinct colors of the cloth, each as target and reached color: writes the first `capacity` of them to
/// `colors` and their total number to `*count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_cloth_colors(
    cloth: *const PlywaveCloth,
    colors: *mut PlywaveColorReach,
    capacity: usize,
    count: *mut usize,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (of, out) = unsafe { (&reference(cloth, "cloth")?.cloth, slice_mut(colors, capacity, "colors")?) };
        let all = of.colors();
        let found = all.len();
        out.iter_mut().zip(all).for_each(|(out, reach)| *out = reach.into());
        // SAFETY: as above.
        unsafe { put(count, found, "count") }
    })
}

/// Absorptions [1/um] with which the cloth has `n` given reflectances, 0 to 1, at wavelengths or in linear
/// RGB: `sigma_per_um` may be `reflectance`. Values out of reach are clamped to clear or black fibers.
/// Convert a texture once, not at every hit. If an entry is invalid, nothing is written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_cloth_sigma_of_reflectance(
    cloth: *const PlywaveCloth,
    n: usize,
    reflectance: *const f32,
    sigma_per_um: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let of = unsafe {
            // The elements are accessed one by one through pointers: both arrays may be the same, and then
            // slices of both must not exist.
            for (i, r) in slice(reflectance, n, "reflectance")?.iter().enumerate() {
                if !(0.0..=1.0).contains(r) {
                    return Err(invalid("reflectance", r, "a number in [0, 1]")).at(i);
                }
            }
            &reference(cloth, "cloth")?.cloth
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
                let [sigma] = of.sigma_of_reflectance([reflectance.add(i).read()]);
                sigma_per_um.add(i).write(sigma);
            }
        }
        Ok(())
    })
}

/// Prepares the cloth at a query for any number of directions. On an error `bsdf` is not prepared, whatever
/// it held before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_cloth_at(
    cloth: *const PlywaveCloth,
    query: *const PlywaveClothQuery,
    bsdf: *mut PlywaveBsdf,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    let status = guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (of, q) = unsafe { (&reference(cloth, "cloth")?.cloth, reference(query, "query")?) };
        by_count!(q.count, N => {
            // SAFETY: as above.
            unsafe {
                let query = query_of::<N>(q)?;
                prepare(bsdf, || of.at(&query))
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
pub unsafe extern "C" fn plywave_cloth_eval_batch(
    cloth: *const PlywaveCloth,
    n: usize,
    queries: *const PlywaveClothQuery,
    w: *const f32,
    f: *mut f32,
    pdf: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (of, queries) = unsafe { (&reference(cloth, "cloth")?.cloth, slice(queries, n, "queries")?) };
        by_count!(count_of(queries)?, N => {
            // SAFETY: as above.
            unsafe { eval_queries::<_, N>(queries, w, f, pdf, |q, w| Ok(of.at(&query_of(q)?).eval_pdf(w))) }
        })
    })
}

/// Samples `n` queries once each: from `queries` `[n]` and `u` `[n][3]` to `samples` `[n]`. Errors are as in
/// `plywave_cloth_eval_batch`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_cloth_sample_batch(
    cloth: *const PlywaveCloth,
    n: usize,
    queries: *const PlywaveClothQuery,
    u: *const f32,
    samples: *mut PlywaveSample,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (of, queries) = unsafe { (&reference(cloth, "cloth")?.cloth, slice(queries, n, "queries")?) };
        by_count!(count_of(queries)?, N => {
            // SAFETY: as above.
            unsafe { sample_queries::<_, N>(queries, u, samples, |q, u| Ok(of.at(&query_of(q)?).sample(u))) }
        })
    })
}

/// The ply model of a kind of yarn, 0 or 1, as its own handle, for its info, spec and check. Release it with
/// `plywave_ply_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_cloth_model(
    cloth: *const PlywaveCloth,
    kind: i32,
    out: *mut *mut PlywavePly,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let of = unsafe {
            put(out, std::ptr::null_mut(), "out")?;
            reference(cloth, "cloth")?
        };
        let model = usize::try_from(kind).ok().and_then(|kind| of.cloth.model_of(kind));
        let model = model.ok_or_else(|| invalid("kind", kind, "a kind of yarn that the cloth has, from 0"))?;
        // SAFETY: as above.
        unsafe { hand_out(out, PlywavePly(model.clone())) }
    })
}
