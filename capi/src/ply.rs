//! Ply models: loading, queries and batches, layers and slits.

use crate::bsdf::{PLYWAVE_MAX_COUNT, PlywaveBsdf, PlywaveSample, padded, prepare, unprepare};
use crate::pointer::{
    disjoint, finite, numbers, optional, pointer, put, put_text, reference, slice, slice_mut, span, text,
};
use crate::queries::{
    Counted, by_count, count_of, eval_queries, first, hand_out, sample_queries, take_back, wavelengths,
};
use crate::status::{Checked, PlywaveError, PlywaveStatus, failure, guard};
use plywave::gap::Slit;
use plywave::io::ModelLibrary;
use plywave::ply::{Layer, PlyPlace, Queries};
use plywave::spec::YarnSpec;
use plywave::{Bsdf, PlyModel, PlyQuery};
use std::ffi::c_char;

/// A loaded ply model. It is immutable: any number of threads may use it at once.
pub struct PlywavePly(pub(crate) PlyModel);

/// A small gap between the fibers of a ply. It is immutable.
pub struct PlywaveSlit(Slit);

const _: () = {
    const fn is_send_sync<T: Send + Sync>() {}
    is_send_sync::<PlywavePly>();
    is_send_sync::<PlywaveSlit>();
};

/// A position on a ply, which determines its relief and its speckle.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlywavePlace {
    /// Number of the ply: plies of different numbers have different fibers.
    pub ply_id: u32,
    /// Azimuth of the viewer, the frame's y axis, relative to the fibers [rad]: about the ply's axis, from an
    /// axis that turns with the twist, counterclockwise as seen from the end of the z axis.
    pub azimuth: f32,
    /// Position along the ply's axis [um], from any origin that is the same for the whole ply.
    pub along_um: f32,
    /// Diameter of the part of the ply that the query represents [um]; 0 for a point.
    pub footprint_um: f32,
}

/// Layer factors of a yarn: how it scatters the light that hits its fibers; from `plywave_ply_layer`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlywaveLayer {
    /// Reflected fraction.
    pub reflected: [f32; PLYWAVE_MAX_COUNT],
    /// Transmitted fraction.
    pub transmitted: [f32; PLYWAVE_MAX_COUNT],
    /// Reflected fraction of diffuse light.
    pub reflected_diffuse: [f32; PLYWAVE_MAX_COUNT],
    /// Transmitted fraction of diffuse light.
    pub transmitted_diffuse: [f32; PLYWAVE_MAX_COUNT],
}

/// A query at a shading point of a ply. Start from zeroed memory: 0 and NULL mean the default.
///
/// The ply's frame: z along the ply, light from `(0, cos theta_i, sin theta_i)`, `h_um` the x coordinate of
/// the beam's center.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct PlywavePlyQuery {
    /// Incident latitude [rad].
    pub theta_i: f32,
    /// Offset of the beam's center [um].
    pub h_um: f32,
    /// Number of absorptions and wavelengths: 1, 3 or 4.
    pub count: i32,
    /// Absorptions of the fibers [1/um]: the host's color. Negative values count as 0.
    pub sigma_per_um: [f32; PLYWAVE_MAX_COUNT],
    /// Wavelengths [um]. All 0 with a count of 3: 0.612, 0.549 and 0.464, those of red, green and blue.
    pub lambda_um: [f32; PLYWAVE_MAX_COUNT],
    /// Not 0: light that passes beside the ply continues straight. 0: the ply's edge diffracts it, if the
    /// model has edge lobes.
    pub no_edge: i32,
    /// Not 0: every call interpolates the lobes again. 0: `plywave_ply_at` interpolates them once. Batches of
    /// queries interpolate them for each query in either case.
    pub uncached: i32,
    /// Not 0: no relief. 0: with a position, the fibers on the ply's surface are visible.
    pub no_relief: i32,
    /// Not 0: no speckle. 0: with a position, a model with noise has speckle.
    pub no_speckle: i32,
    /// Small gaps between the fibers, or NULL. Must outlive the query prepared with it.
    pub slit: *const PlywaveSlit,
    /// Position on the ply, for its relief and its speckle, or NULL for the smooth model. Read during the
    /// call only.
    pub place: *const PlywavePlace,
    /// A second layer below, or NULL. Read during the call only. It has no effect for a model without layer
    /// factors.
    pub below: *const PlywaveLayer,
}

impl Counted for PlywavePlyQuery {
    fn count(&self) -> i32 {
        self.count
    }
}

/// Description of a ply model.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlywavePlyInfo {
    /// Larger radius R of a ply [um].
    pub radius_um: f64,
    /// Largest offset |h| at which a beam can hit fibers [um].
    pub h_limit_um: f64,
    /// Largest latitude of the nodes [rad]; beyond it, the last node is used.
    pub theta_limit: f64,
    /// Largest simulated absorption [1/um]; the model remains valid beyond it.
    pub sigma_limit_per_um: f64,
    /// Waist w0 of the beam [um].
    pub w0_um: f64,
    /// Distance from the beam's center beyond which the beam counts as dark [um].
    pub d_cut_um: f64,
    /// Largest difference of eval on this machine from the values stored in the file, relative to the largest
    /// of them; values up to 1e-3 are fine.
    pub reference_error: f64,
    /// Number of plies of the modeled yarn.
    pub plies: i32,
    /// Number of f_refl lobes.
    pub lobes_refl: i32,
    /// Number of f_high lobes.
    pub lobes_high: i32,
    /// Whether the model has edge lobes; 0 or 1.
    pub has_edge: i32,
    /// Whether it has layer factors; 0 or 1.
    pub has_layers: i32,
    /// Whether it has speckle noise; 0 or 1.
    pub has_noise: i32,
}

/// Converts the query to the Rust type.
///
/// # Safety
/// Its pointers are NULL or point to live memory.
#[inline(always)]
unsafe fn query_of<'a, const N: usize>(q: &PlywavePlyQuery, cached: bool) -> Checked<PlyQuery<'a, N>> {
    finite(q.theta_i, "theta_i")?;
    finite(q.h_um, "h_um")?;
    let (sigma_per_um, lambda_um) = (first(&q.sigma_per_um, "sigma_per_um")?, wavelengths(&q.lambda_um)?);
    // SAFETY: the caller's pointers, as documented.
    let (slit, place, below) =
        unsafe { (optional(q.slit, "slit")?, optional(q.place, "place")?, optional(q.below, "below")?) };
    let place = place.map(|&PlywavePlace { ply_id: ply, azimuth, along_um, footprint_um }| PlyPlace {
        ply,
        azimuth,
        along_um,
        footprint_um,
    });
    let below = below.map(layer_of).transpose()?;
    Ok(PlyQuery {
        edge: q.no_edge == 0,
        slit: slit.map(|slit| &slit.0),
        place,
        relief: q.no_relief == 0,
        speckle: q.no_speckle == 0,
        below,
        cached,
        ..PlyQuery::new(q.theta_i, q.h_um, sigma_per_um, lambda_um)
    })
}

fn layer_of<const N: usize>(of: &PlywaveLayer) -> Checked<Layer<N>> {
    Ok(Layer {
        reflected: first(&of.reflected, "below.reflected")?,
        transmitted: first(&of.transmitted, "below.transmitted")?,
        reflected_diffuse: first(&of.reflected_diffuse, "below.reflected_diffuse")?,
        transmitted_diffuse: first(&of.transmitted_diffuse, "below.transmitted_diffuse")?,
    })
}

/// Reads and checks a ply model (.pwm). A name without folder and ending, NAME for NAME.pwm, is found in the
/// folders of the variable PLYWAVE_MODELS. `path` is UTF-8. On an error `*out` is NULL. Release it with
/// `plywave_ply_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_ply_load(
    path: *const c_char,
    out: *mut *mut PlywavePly,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe {
            put(out, std::ptr::null_mut(), "out")?;
            hand_out(out, PlywavePly(ModelLibrary::usual().load(text(path, "path")?)?))
        }
    })
}

/// Like `plywave_ply_load`, but from the `size` bytes of a file; `name` identifies it in messages.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_ply_from_bytes(
    bytes: *const u8,
    size: usize,
    name: *const c_char,
    out: *mut *mut PlywavePly,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe {
            put(out, std::ptr::null_mut(), "out")?;
            let model = PlyModel::from_bytes(slice(bytes, size, "bytes")?, text(name, "name")?)?;
            hand_out(out, PlywavePly(model))
        }
    })
}

/// The ply of a model illuminated along single lines instead of a beam, for `PlywaveClothQuery.models`: its
/// missed light is the probability that a line misses all fibers, not the mean over a beam. Release it with
/// `plywave_ply_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_ply_of_lines(
    ply: *const PlywavePly,
    out: *mut *mut PlywavePly,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe {
            put(out, std::ptr::null_mut(), "out")?;
            hand_out(out, PlywavePly(reference(ply, "ply")?.0.of_lines()?))
        }
    })
}

/// Releases a model; NULL is allowed. No prepared query and no call may use it afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_ply_free(ply: *mut PlywavePly) {
    guard(std::ptr::null_mut(), || {
        // SAFETY: the caller's handle, given back once.
        unsafe { take_back(ply) };
        Ok(())
    });
}

/// Describes a model.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_ply_info(
    ply: *const PlywavePly,
    info: *mut PlywavePlyInfo,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let model = unsafe { &reference(ply, "ply")?.0 };
        let data = model.data();
        let spec = YarnSpec::parse(&data.spec_text, "spec of the model")?;
        let ([a, b], beam) = (spec.ply_radii_um(), spec.beam.beam());
        let last = |axis: &[f64]| axis.last().copied().unwrap_or(0.0);
        let value = PlywavePlyInfo {
            radius_um: a.max(b),
            h_limit_um: last(&data.h_um),
            theta_limit: last(&data.theta_i),
            sigma_limit_per_um: last(&data.sigma_per_um),
            w0_um: beam.w0_um,
            d_cut_um: beam.d_cut_um,
            reference_error: model.reference_error().into(),
            plies: spec.yarn.plies as i32,
            lobes_refl: data.lobes_refl as i32,
            lobes_high: data.lobes_high as i32,
            has_edge: data.edge.is_some().into(),
            has_layers: data.layers.is_some().into(),
            has_noise: data.noise.is_some().into(),
        };
        // SAFETY: the caller's pointer, as documented.
        unsafe { put(info, value, "info") }
    })
}

/// Copies the text of the yarn spec that a model was made from, with a final 0, to a buffer of `size` bytes;
/// its length without that 0 goes to `*length`, which may be NULL. `PLYWAVE_STATUS_BUFFER_TOO_SMALL`, which a
/// NULL buffer of size 0 returns too, means that `*length` + 1 bytes are needed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_ply_spec(
    ply: *const PlywavePly,
    buffer: *mut c_char,
    size: usize,
    length: *mut usize,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        unsafe { put_text(&reference(ply, "ply")?.0.data().spec_text, buffer, size, length) }
    })
}

/// A layer of this ply's yarns at a latitude [rad], for `count` absorptions [1/um], for use below another
/// ply. The status is `PLYWAVE_STATUS_MISSING` for a model without layer factors.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_ply_layer(
    ply: *const PlywavePly,
    theta_i: f32,
    count: i32,
    sigma_per_um: *const f32,
    layer: *mut PlywaveLayer,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let model = unsafe { &reference(ply, "ply")?.0 };
        finite(theta_i, "theta_i")?;
        by_count!(count, N => {
            // SAFETY: as above.
            let sigma: [f32; N] = unsafe { numbers(sigma_per_um, "sigma_per_um") }?;
            crate::pointer::all_finite(&sigma, "sigma_per_um")?;
            let missing = || failure(PlywaveStatus::Missing, "the model has no layer factors");
            let of = model.layer(theta_i, sigma).ok_or_else(missing)?;
            let value = PlywaveLayer {
                reflected: padded(of.reflected),
                transmitted: padded(of.transmitted),
                reflected_diffuse: padded(of.reflected_diffuse),
                transmitted_diffuse: padded(of.transmitted_diffuse),
            };
            // SAFETY: as above.
            unsafe { put(layer, value, "layer") }
        })
    })
}

/// A slit between the fibers of a model's ply, `width_um` wide (above 0, at most 5), through which `share` of
/// the forward light goes (0.25 in the paper). Release it with `plywave_slit_free`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_slit_new(
    ply: *const PlywavePly,
    width_um: f32,
    share: f32,
    out: *mut *mut PlywaveSlit,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let model = unsafe {
            put(out, std::ptr::null_mut(), "out")?;
            &reference(ply, "ply")?.0
        };
        let beam = YarnSpec::parse(&model.data().spec_text, "spec of the model")?.beam.beam();
        let slit = Slit::new(width_um, share, &beam)
            .map_err(|error| failure(PlywaveStatus::InvalidArgument, error.to_string()))?;
        // SAFETY: as above.
        unsafe { hand_out(out, PlywaveSlit(slit)) }
    })
}

/// Releases a slit; NULL is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_slit_free(slit: *mut PlywaveSlit) {
    guard(std::ptr::null_mut(), || {
        // SAFETY: the caller's handle, given back once.
        unsafe { take_back(slit) };
        Ok(())
    });
}

/// Prepares the model at a query for any number of directions. On an error `bsdf` is not prepared, whatever
/// it held before.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_ply_at(
    ply: *const PlywavePly,
    query: *const PlywavePlyQuery,
    bsdf: *mut PlywaveBsdf,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    let status = guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (model, q) = unsafe { (&reference(ply, "ply")?.0, reference(query, "query")?) };
        by_count!(q.count, N => {
            // SAFETY: as above.
            unsafe {
                let query = query_of::<N>(q, q.uncached == 0)?;
                prepare(bsdf, || model.at(&query))
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
pub unsafe extern "C" fn plywave_ply_eval_batch(
    ply: *const PlywavePly,
    n: usize,
    queries: *const PlywavePlyQuery,
    w: *const f32,
    f: *mut f32,
    pdf: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (model, queries) = unsafe { (&reference(ply, "ply")?.0, slice(queries, n, "queries")?) };
        by_count!(count_of(queries)?, N => {
            // SAFETY: as above.
            unsafe { eval_queries::<_, N>(queries, w, f, pdf, |q, w| Ok(model.at(&query_of(q, false)?).eval_pdf(w))) }
        })
    })
}

/// Samples `n` queries once each: from `queries` `[n]` and `u` `[n][3]` to `samples` `[n]`. Errors are as in
/// `plywave_ply_eval_batch`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_ply_sample_batch(
    ply: *const PlywavePly,
    n: usize,
    queries: *const PlywavePlyQuery,
    u: *const f32,
    samples: *mut PlywaveSample,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented.
        let (model, queries) = unsafe { (&reference(ply, "ply")?.0, slice(queries, n, "queries")?) };
        by_count!(count_of(queries)?, N => {
            // SAFETY: as above.
            unsafe { sample_queries::<_, N>(queries, u, samples, |q, u| Ok(model.at(&query_of(q, false)?).sample(u))) }
        })
    })
}

/// f_refl + f_high alone, without edge light, of `n` queries as arrays: `theta_i` `[n]` [rad], `h_um` `[n]`,
/// `sigma_per_um` `[n][count]`, components of the directions `x`, `y`, `z` `[n]`, to `f` `[n][count]` [1/sr].
/// This is the fastest way to evaluate many queries: it processes 16 at a time. Entries are not checked: an
/// infinite number or NaN gives f = 0, the value for a missed ply.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plywave_ply_lobes_batch(
    ply: *const PlywavePly,
    n: usize,
    count: i32,
    theta_i: *const f32,
    h_um: *const f32,
    sigma_per_um: *const f32,
    x: *const f32,
    y: *const f32,
    z: *const f32,
    f: *mut f32,
    error: *mut PlywaveError,
) -> PlywaveStatus {
    guard(error, || {
        // SAFETY: the caller's pointers, as documented; lengths are checked there.
        unsafe {
            let model = &reference(ply, "ply")?.0;
            by_count!(count, N => {
                let queries = Queries {
                    theta_i: slice(theta_i, n, "theta_i")?,
                    h_um: slice(h_um, n, "h_um")?,
                    sigma_per_um: slice(sigma_per_um.cast::<[f32; N]>(), n, "sigma_per_um")?,
                    wo: [slice(x, n, "x")?, slice(y, n, "y")?, slice(z, n, "z")?],
                };
                let f = f.cast::<[f32; N]>();
                if n > 0 {
                    pointer(f, "f")?;
                    let inputs = [theta_i, h_um, x, y, z].map(|p| span(p, n));
                    disjoint(span(f, n), &inputs, "f")?;
                    disjoint(span(f, n), &[span(sigma_per_um, n.saturating_mul(N))], "f")?;
                }
                model.eval_batch(&queries, slice_mut(f, n, "f")?);
                Ok(())
            })
        }
    })
}
