//! Woven fabrics.

use crate::bsdf::{PlywaveBsdf, PlywaveSample, unprepare};
use crate::ply::PlywavePly;
use crate::pointer::{optional, put, put_text, reference, slice, text};
use crate::queries::{hand_out, take_back};
use crate::status::{AtIndex, Checked, PlywaveError, PlywaveStatus, failure, guard};
use crate::surface::{
    self, PlywaveColorOf, PlywaveColorReach, PlywaveFabricQuery, PlywaveYarnColor, SurfaceHandle, absorption, at,
    eval_batch, put_colors, put_sigma, sample_batch, yarn_color,
};
use plywave::FabricModel;
use plywave::fabric::{ColorReach, FabricOptions, FabricSpec, GapLight, LoadedFabric, Slits, YarnSet};
use plywave::io::MemoryAssets;
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

impl SurfaceHandle for PlywaveFabric {
    type Surface = FabricModel;
    const ARGUMENT: &'static str = "fabric";

    fn surface(&self) -> &FabricModel {
        &self.fabric
    }

    fn colors(&self) -> Vec<ColorReach> {
        self.fabric.colors()
    }

    fn sigma_of_reflectance(&self, reflectance: f32) -> f32 {
        self.fabric.sigma_of_reflectance([reflectance])[0]
    }
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

fn handle_of(loaded: LoadedFabric, options: Option<&PlywaveFabricOptions>) -> Checked<PlywaveFabric> {
    let (name, notes) = (loaded.spec.name.clone(), loaded.notes().join("\n"));
    Ok(PlywaveFabric { fabric: FabricModel::new(loaded, &options_of(options)?)?, name, notes })
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
            color_of: f.color_of().into(),
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
        let colors = [yarn_color(warp)?, yarn_color(weft)?];
        let fabric = of.fabric.with_colors(colors, surface::color_of(color_of)?);
        // SAFETY: as above.
        unsafe { hand_out(out, PlywaveFabric { fabric, name: of.name.clone(), notes: of.notes.clone() }) }
    })
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
        unsafe { put_colors(fabric, colors, capacity, count) }
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
        unsafe { put_sigma(fabric, n, reflectance, sigma_per_um) }
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
        unsafe { at(fabric, query, bsdf) }
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
        unsafe { eval_batch(fabric, n, queries, w, f, pdf) }
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
        unsafe { sample_batch(fabric, n, queries, u, samples) }
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
