// plywave for C11 and C++17: ply, cloth and fiber models for renderers. Made by capi/header.sh of capi/src; do not edit.
//
// Link with -lplywave (pkg-config: plywave). docs/howto/host_c.md of the project has an example and the link lines.
//
// - Units: um, 1/um, rad, 1/sr. Directions are unit vectors away from the surface, ply or fiber.
// - f is an energy density [1/sr]: the BSDF times the absolute cosine of the direction. `weight` of a sample is f / pdf.
// - A function returns a PlywaveStatus, PLYWAVE_STATUS_OK where it is done; its last argument, which may be NULL, takes code and message of an error.
// - Handles are made by load, from_bytes and the like, and released by the free of their kind. They never change: threads share them without locks.
// - A PlywaveBsdf is memory of the caller and is not released. Each thread has its own, or several read one.
// - Zeroed structs are fine starts: `PlywaveClothQuery query = {0};`


#ifndef PLYWAVE_H
#define PLYWAVE_H

#include <stddef.h>
#include <stdint.h>

// Version of this header's interface; it increases with every change that would break compiled programs
// without an error.
#define PLYWAVE_ABI_VERSION 1

// Largest number of wavelengths or channels of a query.
#define PLYWAVE_MAX_COUNT 4

// Size of a prepared query in 64-bit words, without its tag. With the tag it is 7 KB: the size of the
// largest prepared query, a cloth at four wavelengths.
#define PLYWAVE_BSDF_WORDS 928

// Bytes of a message, including its final 0.
#define PLYWAVE_MESSAGE_SIZE 496

// Index of an error that does not concern an entry of an array.
#define PLYWAVE_NO_INDEX UINT64_MAX

// Status of a call. Every function that can fail returns one; 0 is success.
enum PlywaveStatus
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // The call succeeded.
    PLYWAVE_STATUS_OK = 0,
    // A pointer that must not be null is null.
    PLYWAVE_STATUS_NULL_POINTER = 1,
    // An argument has a value that is not allowed: a number that is not finite or out of range, a direction
    // that is not a unit vector, a misaligned pointer, overlapping arrays.
    PLYWAVE_STATUS_INVALID_ARGUMENT = 2,
    // A `PlywaveBsdf` was not prepared, or its preparation failed.
    PLYWAVE_STATUS_NOT_PREPARED = 3,
    // The buffer is too small; the required length was written.
    PLYWAVE_STATUS_BUFFER_TOO_SMALL = 4,
    // The model does not have the requested part, such as layer factors.
    PLYWAVE_STATUS_MISSING = 5,
    // A file cannot be read.
    PLYWAVE_STATUS_IO = 6,
    // A file is not of the expected format or version, or is damaged.
    PLYWAVE_STATUS_FORMAT = 7,
    // A well-formed file contains a value that is not allowed.
    PLYWAVE_STATUS_INVALID_FILE = 8,
    // A defect of the library, caught at the boundary. The outputs of the call are undefined; handles stay
    // usable.
    PLYWAVE_STATUS_PANIC = 9,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum PlywaveStatus PlywaveStatus;
#else
typedef int32_t PlywaveStatus;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Kinds of models.
enum PlywaveKind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // A ply.
    PLYWAVE_KIND_PLY = 1,
    // A cloth.
    PLYWAVE_KIND_CLOTH = 2,
    // A fiber.
    PLYWAVE_KIND_FIBER = 3,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum PlywaveKind PlywaveKind;
#else
typedef int32_t PlywaveKind;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Quantity that a target color refers to.
enum PlywaveColorOf
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // The cloth under a uniform sky in all directions: reflected and transmitted light relative to the light
    // that hits fibers.
    PLYWAVE_COLOR_OF_EVEN_SKY = 0,
    // The cloth's face, lit from the viewer's side, with a dark background.
    PLYWAVE_COLOR_OF_REFLECTED = 1,
    // The cloth folded until opaque, as textile labs measure it (d/8).
    PLYWAVE_COLOR_OF_FOLDED = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum PlywaveColorOf PlywaveColorOf;
#else
typedef int32_t PlywaveColorOf;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Outcome of a sampled light path.
enum PlywaveOutcome
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // The path ends here: w, weight and pdf are 0.
    PLYWAVE_OUTCOME_ABSORBED = 0,
    // The light is scattered into the direction w.
    PLYWAVE_OUTCOME_SCATTERED = 1,
    // The light passes straight through as if there were no model: a delta. w is 0, pdf the probability of
    // this outcome.
    PLYWAVE_OUTCOME_STRAIGHT = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum PlywaveOutcome PlywaveOutcome;
#else
typedef int32_t PlywaveOutcome;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Meaning of the numbers of a color; the `channels` of a query.
enum PlywaveChannels
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // Light of the query's wavelengths: a spectral host.
    PLYWAVE_CHANNELS_WAVELENGTHS = 0,
    // Linear RGB of the primaries of sRGB. For a count of 3.
    PLYWAVE_CHANNELS_LINEAR_SRGB = 1,
    // Linear RGB of the wider primaries of BT.2020. For a count of 3.
    PLYWAVE_CHANNELS_LINEAR_REC2020 = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum PlywaveChannels PlywaveChannels;
#else
typedef int32_t PlywaveChannels;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// How a yarn is colored; the `kind` of a `PlywaveYarnColor`.
enum PlywaveYarnColorKind
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    // No color: non-absorbing fibers.
    PLYWAVE_YARN_COLOR_KIND_UNDYED = 0,
    // A color [sRGB, 0 to 1].
    PLYWAVE_YARN_COLOR_KIND_SRGB = 1,
    // An absorption coefficient of the fibers [1/um].
    PLYWAVE_YARN_COLOR_KIND_SIGMA = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum PlywaveYarnColorKind PlywaveYarnColorKind;
#else
typedef int32_t PlywaveYarnColorKind;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// A loaded cloth: woven, knitted or of curves. It is immutable: any number of threads may use it at once.
typedef struct PlywaveCloth PlywaveCloth;

// A loaded fiber model. It is immutable: any number of threads may use it at once.
typedef struct PlywaveFiber PlywaveFiber;

// A loaded ply model. It is immutable: any number of threads may use it at once.
typedef struct PlywavePly PlywavePly;

// A small gap between the fibers of a ply. It is immutable.
typedef struct PlywaveSlit PlywaveSlit;

// A model at a query. The caller provides the memory, usually on the stack; the library writes and reads its
// content. A prepared query owns no memory and needs no release; it may be copied, moved, and read by many
// threads. It is valid as long as the handles that it was prepared from: the model or cloth, and the slit
// and models of its query.
typedef struct PlywaveBsdf {
    // Identifies the prepared type.
    uint64_t tag;
    // Private to the library.
    uint64_t words[PLYWAVE_BSDF_WORDS];
} PlywaveBsdf;

// An error in the caller's memory: each call takes a pointer to one, or NULL. It is written only if the
// status is not `PLYWAVE_STATUS_OK`.
typedef struct PlywaveError {
    // The returned status: a `PlywaveStatus`.
    int32_t status;
    // Index of the first invalid entry of a batch, before which all entries are processed; else
    // `PLYWAVE_NO_INDEX`.
    uint64_t index;
    // One line in UTF-8 that names file, key or argument, value and allowed values; 0-terminated.
    char message[PLYWAVE_MESSAGE_SIZE];
} PlywaveError;

// A sampled light path.
typedef struct PlywaveSample {
    // The outcome: a `PlywaveOutcome`.
    int32_t outcome;
    // Direction of scattered light, a unit vector.
    float w[3];
    // f / pdf by wavelength, or the straight fraction divided by its probability; 0 beyond the count.
    float weight[PLYWAVE_MAX_COUNT];
    // Density of the direction [1/sr], including the probability of scattering; or the probability that the
    // light passes straight through.
    float pdf;
} PlywaveSample;

// Probabilities of the outcomes of sampling; they sum to 1.
typedef struct PlywaveOutcomes {
    // Probability of `PLYWAVE_OUTCOME_ABSORBED`.
    float absorbed;
    // Probability of `PLYWAVE_OUTCOME_SCATTERED`: the integral of the pdf.
    float scattered;
    // Probability of `PLYWAVE_OUTCOME_STRAIGHT`.
    float straight;
} PlywaveOutcomes;

// Description of a prepared query.
typedef struct PlywaveBsdfInfo {
    // Kind of its model.
    PlywaveKind kind;
    // Number of wavelengths or channels: 1, 3 or 4.
    int32_t count;
    // Whether a second layer of yarn lies below the point; for a cloth, whether the line hits both kinds of
    // yarns; 0 or 1.
    int32_t is_double;
    // For a cloth: whether the point lies in a gap, where the line hits no ply; 0 or 1.
    int32_t is_gap;
    // For a ply: the fraction of the beam that misses all fibers; else 0.
    float r_d;
    // For a fiber: the width over which it intercepts light [um], by wavelength; else 0.
    float width_um[PLYWAVE_MAX_COUNT];
} PlywaveBsdfInfo;

// Result of a check: the worst value over all incidences.
typedef struct PlywaveReport {
    // Largest |integral of eval - albedo|.
    double furnace_error;
    // Largest |integral of pdf - probability of scattering|, or |sum of the probabilities of all outcomes -
    // 1|.
    double pdf_error;
    // Largest |weight times pdf - eval| over the samples, relative to the largest eval.
    double weight_error;
    // Largest |mean weight - albedo| in standard errors.
    double sampled_furnace_se;
    // Smallest p-value of the samples against the pdf.
    double chi2_p;
    // Smallest p-value that passes.
    double chi2_threshold;
    // Largest |total energy - 1| at sigma = 0; 0 if it is not checked.
    double kept_error;
    // Whether every number with a limit is within it; 0 or 1.
    int32_t passed;
} PlywaveReport;

// Result of the check of a ply model.
typedef struct PlywavePlyReport {
    // Report on f_refl + f_high.
    struct PlywaveReport lobes;
    // Report on all terms, edge light included, where `has_whole`.
    struct PlywaveReport whole;
    // Report on a ply over a second layer, where `has_layers`.
    struct PlywaveReport layers;
    // Whether the model has edge lobes, so that `whole` is set; 0 or 1.
    int32_t has_whole;
    // Whether the model has layer factors, so that `layers` is set; 0 or 1.
    int32_t has_layers;
    // Largest difference between eval and the values stored in the file, relative to the largest of those
    // values.
    double reference_error;
    // Whether everything passed; 0 or 1.
    int32_t passed;
} PlywavePlyReport;

// Options of a cloth's shading. Zeroed memory, or NULL in its place, selects the complete model without
// speckle, in the colors of the file.
typedef struct PlywaveClothOptions {
    // Not 0: light passes straight through gaps, as a delta. 0: gaps diffract it.
    int32_t straight_gaps;
    // Not 0: light that passes beside a ply continues straight. 0: the ply's edge diffracts it.
    int32_t no_edges;
    // Not 0: adds speckle in models that have noise.
    int32_t noise;
    // Not 0: plies do not occlude light that others scatter down. For comparison.
    int32_t no_layers;
    // Not 0: plies do not occlude light that others scatter up. For comparison.
    int32_t no_shadowing;
    // Not 0: all repeats are identical. 0: yarns are as uneven as the spec states.
    int32_t no_uneven;
    // Not 0: plies are smooth tubes. 0: they show the fibers on their surface.
    int32_t no_relief;
    // Not 0: footprints only blur relief. 0: queries with a footprint use the mean over the cell, if the
    // file has it.
    int32_t no_far;
    // Not 0: `sigma_per_um` overrides all colors.
    int32_t has_sigma;
    // One absorption [1/um] at every wavelength for all yarns; 0 for a white furnace.
    float sigma_per_um;
    // Not 0: all yarns have slits between their fibers with `slit_width_um` and `slit_share`, which override
    // those of the spec.
    int32_t has_slits;
    // Width of the slits [um], above 0 and at most 5.
    float slit_width_um;
    // Share of a ply's forward light that goes through the slits (0.25 in the paper); 0 for none.
    float slit_share;
} PlywaveClothOptions;

// Description of a cloth.
typedef struct PlywaveClothInfo {
    // Two vectors in the plane of the cloth that span its repeating cell [um].
    double cell_um[2][2];
    // Largest distance of any fiber from the middle plane [um].
    float half_thickness_um;
    // Number of kinds of yarns: 2, warp and weft, for a woven cloth, else 1.
    int32_t kinds;
    // Quantity that its colors refer to.
    PlywaveColorOf color_of;
    // Whether queries with a footprint get the mean over the cell; 0 or 1.
    int32_t has_far;
    // Memory use, without its models.
    uint64_t memory_bytes;
} PlywaveClothInfo;

// Color of all yarns of one kind, such as warp or weft. Zeroed memory means non-absorbing fibers.
typedef struct PlywaveYarnColor {
    // A `PlywaveYarnColorKind`.
    int32_t kind;
    // The color for `PLYWAVE_YARN_COLOR_KIND_SRGB`, gamma encoded, 0 to 1.
    float srgb[3];
    // The absorption for `PLYWAVE_YARN_COLOR_KIND_SIGMA` [1/um], 0 or more.
    float sigma_per_um;
} PlywaveYarnColor;

// A target color and the color that the cloth reaches.
typedef struct PlywaveColorReach {
    // Target color [sRGB, 0 to 1].
    float asked[3];
    // Color of the cloth [sRGB; outside 0 to 1 if out of gamut].
    double comes_out[3];
    // CIEDE2000 between the two; about 1 is just visible.
    double delta_e;
    // Numbers of the 81 wavelengths at which the target was brighter than non-absorbing fibers, and darker
    // than black ones.
    uint32_t clamped[2];
} PlywaveColorReach;

// A query at a shading point of a cloth. Start from zeroed memory: 0 and NULL mean the default;
// `count` and `wo` are required.
//
// The surface's frame: x along the weft (along u), y along the warp (along v), z the normal of the face; for
// a knit, x along the courses and y along the wales. Warp and weft are the first and the second kind of yarn
// of a cloth; for a cloth with one kind, the values of the weft have no effect.
typedef struct PlywaveClothQuery {
    // Point in the plane of the cloth [um], each coordinate within 1e10 of 0: uv times the size of one unit
    // of uv. Beyond 1e7 (10 m), consecutive f32 values are at least 1 um apart.
    float position_um[2];
    // Direction towards the viewer, unit.
    float wo[3];
    // Number of wavelengths or channels: 1, 3 or 4.
    int32_t count;
    // Wavelengths [um]. All 0 with a count of 3: 0.612, 0.549 and 0.464, those of red, green and blue. RGB
    // channels need them too, for diffraction and speckle.
    float lambda_um[PLYWAVE_MAX_COUNT];
    // A `PlywaveChannels`.
    int32_t channels;
    // Rotation of the pattern about the normal at the point [rad], within 1e6 of 0, from x towards y. The
    // position lies in the plane of the rotated pattern, in the surface's axes.
    float turn_rad;
    // `[count]` absorptions [1/um] of the warp at the point, for textures and prints, or NULL for the
    // cloth's own. Read during the call only.
    const float *sigma_warp_per_um;
    // The same for the weft.
    const float *sigma_weft_per_um;
    // Models that override those of the warp and the weft, from `plywave_ply_of_lines`, of the same ply
    // radius and number of plies, or NULL. They must outlive the query prepared with them.
    const struct PlywavePly *models[2];
    // Diameter of the area of cloth that the query represents [um], such as a pixel's footprint. Beyond the
    // size of the cell, the mean over the cell is used if the file has it (see `no_far` of the options). 0
    // for a point; never negative.
    float footprint_um;
} PlywaveClothQuery;

// A query at a shading point of a fiber. Start from zeroed memory; `count` and `omega_i` are required.
//
// The fiber's frame: z along the fiber, x and y the axes of its outline.
typedef struct PlywaveFiberQuery {
    // Direction that light comes from, unit.
    float omega_i[3];
    // Number of wavelengths: 1, 3 or 4.
    int32_t count;
    // Wavelengths [um]. All 0 with a count of 3: 0.612, 0.549 and 0.464, those of red, green and blue.
    float lambda_um[PLYWAVE_MAX_COUNT];
    // Offset of the ray from the center line relative to half the fiber's width, -1 to 1, or NULL for the
    // mean over all offsets. Tables contain only that mean. Read during the call only.
    const float *h_rel;
    // Absorption inside the fiber [1/um], by wavelength: the color of an analytic fiber. Tables ignore it,
    // because they contain their own.
    float sigma_per_um[PLYWAVE_MAX_COUNT];
} PlywaveFiberQuery;

// Description of a ply model.
typedef struct PlywavePlyInfo {
    // Larger radius R of a ply [um].
    double radius_um;
    // Largest offset |h| at which a beam can hit fibers [um].
    double h_limit_um;
    // Largest latitude of the nodes [rad]; beyond it, the last node is used.
    double theta_limit;
    // Largest simulated absorption [1/um]; the model remains valid beyond it.
    double sigma_limit_per_um;
    // Waist w0 of the beam [um].
    double w0_um;
    // Distance from the beam's center beyond which the beam counts as dark [um].
    double d_cut_um;
    // Largest difference of eval on this machine from the values stored in the file, relative to the largest
    // of them; values up to 1e-3 are fine.
    double reference_error;
    // Number of plies of the modeled yarn.
    int32_t plies;
    // Number of f_refl lobes.
    int32_t lobes_refl;
    // Number of f_high lobes.
    int32_t lobes_high;
    // Whether the model has edge lobes; 0 or 1.
    int32_t has_edge;
    // Whether it has layer factors; 0 or 1.
    int32_t has_layers;
    // Whether it has speckle noise; 0 or 1.
    int32_t has_noise;
} PlywavePlyInfo;

// Layer factors of a yarn: how it scatters the light that hits its fibers; from `plywave_ply_layer`.
typedef struct PlywaveLayer {
    // Reflected fraction.
    float reflected[PLYWAVE_MAX_COUNT];
    // Transmitted fraction.
    float transmitted[PLYWAVE_MAX_COUNT];
    // Reflected fraction of diffuse light.
    float reflected_diffuse[PLYWAVE_MAX_COUNT];
    // Transmitted fraction of diffuse light.
    float transmitted_diffuse[PLYWAVE_MAX_COUNT];
} PlywaveLayer;

// A position on a ply, which determines its relief and its speckle.
typedef struct PlywavePlace {
    // Number of the ply: plies of different numbers have different fibers.
    uint32_t ply_id;
    // Azimuth of the viewer, the frame's y axis, relative to the fibers [rad]: about the ply's axis, from an
    // axis that turns with the twist, counterclockwise as seen from the end of the z axis.
    float azimuth;
    // Position along the ply's axis [um], from any origin that is the same for the whole ply.
    float along_um;
    // Diameter of the part of the ply that the query represents [um]; 0 for a point.
    float footprint_um;
} PlywavePlace;

// A query at a shading point of a ply. Start from zeroed memory: 0 and NULL mean the default.
//
// The ply's frame: z along the ply, light from `(0, cos theta_i, sin theta_i)`, `h_um` the x coordinate of
// the beam's center.
typedef struct PlywavePlyQuery {
    // Incident latitude [rad].
    float theta_i;
    // Offset of the beam's center [um].
    float h_um;
    // Number of absorptions and wavelengths: 1, 3 or 4.
    int32_t count;
    // Absorptions of the fibers [1/um]: the host's color. Negative values count as 0.
    float sigma_per_um[PLYWAVE_MAX_COUNT];
    // Wavelengths [um]. All 0 with a count of 3: 0.612, 0.549 and 0.464, those of red, green and blue.
    float lambda_um[PLYWAVE_MAX_COUNT];
    // Not 0: light that passes beside the ply continues straight. 0: the ply's edge diffracts it, if the
    // model has edge lobes.
    int32_t no_edge;
    // Not 0: every call interpolates the lobes again. 0: `plywave_ply_at` interpolates them once. Batches of
    // queries interpolate them for each query in either case.
    int32_t uncached;
    // Not 0: no relief. 0: with a position, the fibers on the ply's surface are visible.
    int32_t no_relief;
    // Not 0: no speckle. 0: with a position, a model with noise has speckle.
    int32_t no_speckle;
    // Small gaps between the fibers, or NULL. Must outlive the query prepared with it.
    const struct PlywaveSlit *slit;
    // Position on the ply, for its relief and its speckle, or NULL for the smooth model. Read during the
    // call only.
    const struct PlywavePlace *place;
    // A second layer below, or NULL. Read during the call only. It has no effect for a model without layer
    // factors.
    const struct PlywaveLayer *below;
} PlywavePlyQuery;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// `PLYWAVE_ABI_VERSION` of the library at run time: a program compiled with another value must not continue.
uint32_t plywave_abi_version(void);

// Version of the library, such as `"0.1.0"`. Never NULL.
const char *plywave_version(void);

// f in direction `w` [1/sr], including the cosine, to the `count` numbers of `f`. Straight light is not
// included.
//
// `w`: 3 numbers, a unit vector. On an error nothing is written.
PlywaveStatus plywave_bsdf_eval(const struct PlywaveBsdf *bsdf, const float *w, float *f, struct PlywaveError *error);

// Density [1/sr] with which `plywave_bsdf_sample` returns the direction `w`, to the one number of `pdf`.
PlywaveStatus plywave_bsdf_pdf(const struct PlywaveBsdf *bsdf, const float *w, float *pdf, struct PlywaveError *error);

// `plywave_bsdf_eval` and `plywave_bsdf_pdf` in one call, which share their work.
PlywaveStatus plywave_bsdf_eval_pdf(const struct PlywaveBsdf *bsdf,
                                    const float *w,
                                    float *f,
                                    float *pdf,
                                    struct PlywaveError *error);

// Samples the outcome of a light path from three independent uniform random numbers `u` in [0, 1).
PlywaveStatus plywave_bsdf_sample(const struct PlywaveBsdf *bsdf,
                                  const float *u,
                                  struct PlywaveSample *sample,
                                  struct PlywaveError *error);

// Integral of f over the sphere, to the `count` numbers of `albedo`. For a cloth it takes shadows at their
// mean over directions.
PlywaveStatus plywave_bsdf_albedo(const struct PlywaveBsdf *bsdf, float *albedo, struct PlywaveError *error);

// Fraction of the light that goes straight on, unscattered, to the `count` numbers of `straight`; 0 for most
// models.
PlywaveStatus plywave_bsdf_straight(const struct PlywaveBsdf *bsdf, float *straight, struct PlywaveError *error);

// Chances of the outcomes of `plywave_bsdf_sample`.
PlywaveStatus plywave_bsdf_outcomes(const struct PlywaveBsdf *bsdf,
                                    struct PlywaveOutcomes *outcomes,
                                    struct PlywaveError *error);

// f and pdf in `n` directions at one query: from `w` `[n][3]` to `f` `[n][count]` and `pdf` `[n]`. This is
// the fastest way to evaluate many directions.
//
// If a direction is invalid, the status is that of the first such entry, `error` has its index, and nothing
// is written. `n` = 0 does nothing.
PlywaveStatus plywave_bsdf_eval_batch(const struct PlywaveBsdf *bsdf,
                                      size_t n,
                                      const float *w,
                                      float *f,
                                      float *pdf,
                                      struct PlywaveError *error);

// Samples `n` times at one query: from `u` `[n][3]` to `samples` `[n]`. Errors are as in
// `plywave_bsdf_eval_batch`.
PlywaveStatus plywave_bsdf_sample_batch(const struct PlywaveBsdf *bsdf,
                                        size_t n,
                                        const float *u,
                                        struct PlywaveSample *samples,
                                        struct PlywaveError *error);

// Describes a prepared query: its kind, count, and facts about the point.
PlywaveStatus plywave_bsdf_info(const struct PlywaveBsdf *bsdf,
                                struct PlywaveBsdfInfo *info,
                                struct PlywaveError *error);

// Checks a model at `incidences` incidences (100 in `plywave check`), with `samples` samples each (20000
// there) and random numbers of `seed` (1 there). The checks and numbers are those of `plywave check` that
// need no table. It takes about 0.1 s per incidence.
PlywaveStatus plywave_ply_check(const struct PlywavePly *ply,
                                size_t incidences,
                                size_t samples,
                                uint64_t seed,
                                struct PlywavePlyReport *found,
                                struct PlywaveError *error);

// Checks a prepared query with `samples` samples and random numbers of `seed`. The steps of the integrals
// resolve features of width `sd_rad` (0.001 to 1) along latitude and azimuth; 0.01 suits most models. The
// check passes if weight times pdf equals eval within 1e-3 and the p-value is 1e-4 or more; for plies and
// fibers, furnace and integral of the pdf must also be within 1e-3. For a single point of a cloth the
// furnace is reported without a limit, because the point's shadows differ from their mean.
PlywaveStatus plywave_bsdf_check(const struct PlywaveBsdf *bsdf,
                                 double sd_rad,
                                 size_t samples,
                                 uint64_t seed,
                                 struct PlywaveReport *found,
                                 struct PlywaveError *error);

// Reads a cloth file (.pwc), which `plywave weave` writes from a cloth spec, in about 10 ms. `path` is
// UTF-8; `options` may be NULL. On an error `*out` is NULL. Release the cloth with `plywave_cloth_free`.
PlywaveStatus plywave_cloth_load(const char *path,
                                 const struct PlywaveClothOptions *options,
                                 struct PlywaveCloth **out,
                                 struct PlywaveError *error);

// Like `plywave_cloth_load`, but from the bytes of a file; `name` identifies it in messages.
PlywaveStatus plywave_cloth_from_memory(const uint8_t *bytes,
                                        size_t size,
                                        const char *name,
                                        const struct PlywaveClothOptions *options,
                                        struct PlywaveCloth **out,
                                        struct PlywaveError *error);

// Releases a cloth; NULL is allowed. No prepared query and no call may use it afterwards.
void plywave_cloth_free(struct PlywaveCloth *cloth);

// Describes a cloth.
PlywaveStatus plywave_cloth_info(const struct PlywaveCloth *cloth,
                                 struct PlywaveClothInfo *info,
                                 struct PlywaveError *error);

// Name of a cloth, from its spec. The buffer works as in `plywave_ply_spec`.
PlywaveStatus plywave_cloth_name(const struct PlywaveCloth *cloth,
                                 char *buffer,
                                 size_t size,
                                 size_t *length,
                                 struct PlywaveError *error);

// Notes on a cloth, one per line: effects that the options request but the file does not contain. The buffer
// works as in `plywave_ply_spec`.
PlywaveStatus plywave_cloth_notes(const struct PlywaveCloth *cloth,
                                  char *buffer,
                                  size_t size,
                                  size_t *length,
                                  struct PlywaveError *error);

// The same cloth in other colors, as a new handle, without a new precomputation: `colors` `[n]`, one for
// each kind of yarn. `color_of` is a `PlywaveColorOf`; if it differs from the cloth's, the call takes tenths
// of a second.
PlywaveStatus plywave_cloth_with_colors(const struct PlywaveCloth *cloth,
                                        const struct PlywaveYarnColor *colors,
                                        size_t n,
                                        int32_t color_of,
                                        struct PlywaveCloth **out,
                                        struct PlywaveError *error);

// The distinct colors of the cloth, each as target and reached color: writes the first `capacity` of them to
// `colors` and their total number to `*count`.
PlywaveStatus plywave_cloth_colors(const struct PlywaveCloth *cloth,
                                   struct PlywaveColorReach *colors,
                                   size_t capacity,
                                   size_t *count,
                                   struct PlywaveError *error);

// Absorptions [1/um] with which the cloth has `n` given reflectances, 0 to 1, at wavelengths or in linear
// RGB: `sigma_per_um` may be `reflectance`. Values out of reach are clamped to clear or black fibers.
// Convert a texture once, not at every hit. If an entry is invalid, nothing is written.
PlywaveStatus plywave_cloth_sigma_of_reflectance(const struct PlywaveCloth *cloth,
                                                 size_t n,
                                                 const float *reflectance,
                                                 float *sigma_per_um,
                                                 struct PlywaveError *error);

// Prepares the cloth at a query for any number of directions. On an error `bsdf` is not prepared, whatever
// it held before.
PlywaveStatus plywave_cloth_at(const struct PlywaveCloth *cloth,
                               const struct PlywaveClothQuery *query,
                               struct PlywaveBsdf *bsdf,
                               struct PlywaveError *error);

// f and pdf of `n` queries, one direction each: from `queries` `[n]` and `w` `[n][3]` to `f` `[n][count]`
// and `pdf` `[n]`. All queries have the count of the first.
//
// If an entry is invalid, the status is that of the first such entry, `error` has its index, and all entries
// before it are written. `n` = 0 does nothing.
PlywaveStatus plywave_cloth_eval_batch(const struct PlywaveCloth *cloth,
                                       size_t n,
                                       const struct PlywaveClothQuery *queries,
                                       const float *w,
                                       float *f,
                                       float *pdf,
                                       struct PlywaveError *error);

// Samples `n` queries once each: from `queries` `[n]` and `u` `[n][3]` to `samples` `[n]`. Errors are as in
// `plywave_cloth_eval_batch`.
PlywaveStatus plywave_cloth_sample_batch(const struct PlywaveCloth *cloth,
                                         size_t n,
                                         const struct PlywaveClothQuery *queries,
                                         const float *u,
                                         struct PlywaveSample *samples,
                                         struct PlywaveError *error);

// The ply model of a kind of yarn, 0 or 1, as its own handle, for its info, spec and check. Release it with
// `plywave_ply_free`.
PlywaveStatus plywave_cloth_model(const struct PlywaveCloth *cloth,
                                  int32_t kind,
                                  struct PlywavePly **out,
                                  struct PlywaveError *error);

// Reads and checks a fiber table (.pwf), or the spec of an analytic fiber (.toml). `path` is UTF-8. On an
// error `*out` is NULL. Release it with `plywave_fiber_free`.
PlywaveStatus plywave_fiber_load(const char *path, struct PlywaveFiber **out, struct PlywaveError *error);

// Like `plywave_fiber_load`, but from the `size` bytes of a file; `name` identifies the file in messages and
// ends in `.toml` for a spec.
PlywaveStatus plywave_fiber_from_bytes(const uint8_t *bytes,
                                       size_t size,
                                       const char *name,
                                       struct PlywaveFiber **out,
                                       struct PlywaveError *error);

// Releases a fiber; NULL is allowed. No prepared query and no call may use it afterwards.
void plywave_fiber_free(struct PlywaveFiber *fiber);

// Diameter [um] of the cylinder that contains all rays which the fiber scatters, over all directions and
// wavelengths.
PlywaveStatus plywave_fiber_max_width(const struct PlywaveFiber *fiber,
                                      float *max_width_um,
                                      struct PlywaveError *error);

// Color of an analytic fiber from its spec, in the form of a query: writes three wavelengths [um] to
// `lambda_um` `[3]` and the absorptions at these [1/um] to `sigma_per_um` `[3]`. All are 0 for a table,
// which contains its own absorption.
PlywaveStatus plywave_fiber_color(const struct PlywaveFiber *fiber,
                                  float *lambda_um,
                                  float *sigma_per_um,
                                  struct PlywaveError *error);

// Prepares the fiber at a query for any number of directions. On an error `bsdf` is not prepared, whatever
// it held before. `plywave_bsdf_info` returns the widths over which the fiber intercepts light.
PlywaveStatus plywave_fiber_at(const struct PlywaveFiber *fiber,
                               const struct PlywaveFiberQuery *query,
                               struct PlywaveBsdf *bsdf,
                               struct PlywaveError *error);

// f and pdf of `n` queries, one direction each: from `queries` `[n]` and `w` `[n][3]` to `f` `[n][count]`
// and `pdf` `[n]`. All queries have the count of the first.
//
// If an entry is invalid, the status is that of the first such entry, `error` has its index, and all entries
// before it are written. `n` = 0 does nothing.
PlywaveStatus plywave_fiber_eval_batch(const struct PlywaveFiber *fiber,
                                       size_t n,
                                       const struct PlywaveFiberQuery *queries,
                                       const float *w,
                                       float *f,
                                       float *pdf,
                                       struct PlywaveError *error);

// Samples `n` queries once each: from `queries` `[n]` and `u` `[n][3]` to `samples` `[n]`. Errors are as in
// `plywave_fiber_eval_batch`.
PlywaveStatus plywave_fiber_sample_batch(const struct PlywaveFiber *fiber,
                                         size_t n,
                                         const struct PlywaveFiberQuery *queries,
                                         const float *u,
                                         struct PlywaveSample *samples,
                                         struct PlywaveError *error);

// Reads and checks a ply model (.pwm). A name without folder and ending, NAME for NAME.pwm, is found in the
// folders of the variable PLYWAVE_MODELS. `path` is UTF-8. On an error `*out` is NULL. Release it with
// `plywave_ply_free`.
PlywaveStatus plywave_ply_load(const char *path, struct PlywavePly **out, struct PlywaveError *error);

// Like `plywave_ply_load`, but from the `size` bytes of a file; `name` identifies it in messages.
PlywaveStatus plywave_ply_from_bytes(const uint8_t *bytes,
                                     size_t size,
                                     const char *name,
                                     struct PlywavePly **out,
                                     struct PlywaveError *error);

// The ply of a model illuminated along single lines instead of a beam, for `PlywaveClothQuery.models`: its
// missed light is the probability that a line misses all fibers, not the mean over a beam. Release it with
// `plywave_ply_free`.
PlywaveStatus plywave_ply_of_lines(const struct PlywavePly *ply, struct PlywavePly **out, struct PlywaveError *error);

// Releases a model; NULL is allowed. No prepared query and no call may use it afterwards.
void plywave_ply_free(struct PlywavePly *ply);

// Describes a model.
PlywaveStatus plywave_ply_info(const struct PlywavePly *ply, struct PlywavePlyInfo *info, struct PlywaveError *error);

// Copies the text of the yarn spec that a model was made from, with a final 0, to a buffer of `size` bytes;
// its length without that 0 goes to `*length`, which may be NULL. `PLYWAVE_STATUS_BUFFER_TOO_SMALL`, which a
// NULL buffer of size 0 returns too, means that `*length` + 1 bytes are needed.
PlywaveStatus plywave_ply_spec(const struct PlywavePly *ply,
                               char *buffer,
                               size_t size,
                               size_t *length,
                               struct PlywaveError *error);

// A layer of this ply's yarns at a latitude [rad], for `count` absorptions [1/um], for use below another
// ply. The status is `PLYWAVE_STATUS_MISSING` for a model without layer factors.
PlywaveStatus plywave_ply_layer(const struct PlywavePly *ply,
                                float theta_i,
                                int32_t count,
                                const float *sigma_per_um,
                                struct PlywaveLayer *layer,
                                struct PlywaveError *error);

// A slit between the fibers of a model's ply, `width_um` wide (above 0, at most 5), through which `share` of
// the forward light goes (0.25 in the paper). Release it with `plywave_slit_free`.
PlywaveStatus plywave_slit_new(const struct PlywavePly *ply,
                               float width_um,
                               float share,
                               struct PlywaveSlit **out,
                               struct PlywaveError *error);

// Releases a slit; NULL is allowed.
void plywave_slit_free(struct PlywaveSlit *slit);

// Prepares the model at a query for any number of directions. On an error `bsdf` is not prepared, whatever
// it held before.
PlywaveStatus plywave_ply_at(const struct PlywavePly *ply,
                             const struct PlywavePlyQuery *query,
                             struct PlywaveBsdf *bsdf,
                             struct PlywaveError *error);

// f and pdf of `n` queries, one direction each: from `queries` `[n]` and `w` `[n][3]` to `f` `[n][count]`
// and `pdf` `[n]`. All queries have the count of the first.
//
// If an entry is invalid, the status is that of the first such entry, `error` has its index, and all entries
// before it are written. `n` = 0 does nothing.
PlywaveStatus plywave_ply_eval_batch(const struct PlywavePly *ply,
                                     size_t n,
                                     const struct PlywavePlyQuery *queries,
                                     const float *w,
                                     float *f,
                                     float *pdf,
                                     struct PlywaveError *error);

// Samples `n` queries once each: from `queries` `[n]` and `u` `[n][3]` to `samples` `[n]`. Errors are as in
// `plywave_ply_eval_batch`.
PlywaveStatus plywave_ply_sample_batch(const struct PlywavePly *ply,
                                       size_t n,
                                       const struct PlywavePlyQuery *queries,
                                       const float *u,
                                       struct PlywaveSample *samples,
                                       struct PlywaveError *error);

// f_refl + f_high alone, without edge light, of `n` queries as arrays: `theta_i` `[n]` [rad], `h_um` `[n]`,
// `sigma_per_um` `[n][count]`, components of the directions `x`, `y`, `z` `[n]`, to `f` `[n][count]` [1/sr].
// This is the fastest way to evaluate many queries: it processes 16 at a time. Entries are not checked: an
// infinite number or NaN gives f = 0, the value for a missed ply.
PlywaveStatus plywave_ply_lobes_batch(const struct PlywavePly *ply,
                                      size_t n,
                                      int32_t count,
                                      const float *theta_i,
                                      const float *h_um,
                                      const float *sigma_per_um,
                                      const float *x,
                                      const float *y,
                                      const float *z,
                                      float *f,
                                      struct PlywaveError *error);

// Name of a status as in C, such as `"PLYWAVE_STATUS_NULL_POINTER"`; `"unknown status"` for other numbers.
// Never NULL.
const char *plywave_status_name(int32_t status);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* PLYWAVE_H */
