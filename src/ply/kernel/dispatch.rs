//! The kernels, each compiled once for any processor, once for AVX2 and FMA and once for AVX-512 with vectors
//! of 16 lanes; the first call chooses. Each of these functions holds one inlined copy of the arithmetic.
//! Models that exceed the fast tables use one portable copy. Absorptions and results are slices, so that one
//! copy serves any number of absorptions.

use super::absorption::LobeTransmittances;
use super::batch;
use super::cone_mixture::{self, ConeMixture, PreparedCones};
use super::energy::{self, Core, DrawnBy, Energies, Rest};
use super::layout::{FEW, Fast, Layout, MORE, Tables};
use super::mixture::{mixture, weights};
use super::prepared::PreparedLobes;
use crate::ply::kernel::slit::{SlitSample, SlitValues};
use crate::ply::queries::Channels;
use crate::ply::{MAX_LOBES, MAX_PATHS, Queries};
use multiversion::{multiversion, target::target_cfg_f};

type Large = Tables<MAX_LOBES, MAX_LOBES, MAX_PATHS>;
/// Lanes of a mixture for fast and for large tables, each a power of 2.
const LANES: usize = 16;
const LANES_LARGE: usize = 2 * MAX_LOBES;

/// Declares a kernel. `$name` chooses by the layout between `$fast`, compiled for several instruction sets,
/// `$large`, and the two for cones. In each, the body uses the tables and the constants FMA and L (lanes).
macro_rules! kernel {
    ($name:ident <$($life:lifetime)?> [$fast:ident, $large:ident, $cone:ident, $large_cone:ident],
     ($($arg:ident: $type:ty),*) -> $out:ty, |$t:ident, $fma:ident, $l:ident| $body:expr, $cone_body:expr) => {
        fn $name$(<$life>)?(layout: &Layout, $($arg: $type),*) -> $out {
            match layout {
                Layout::Few(tables) => $fast(tables, $($arg),*),
                Layout::More(tables) => $fast(tables, $($arg),*),
                Layout::Large(tables) => $large(tables, $($arg),*),
                Layout::Cone(tables) => $cone(tables, $($arg),*),
                Layout::LargeCone(tables) => $large_cone(tables, $($arg),*),
            }
        }

        #[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+bmi1+bmi2+fma", "x86_64+avx2+bmi1+bmi2+fma"))]
        fn $cone$(<$life>)?($t: &Fast<MORE>, $($arg: $type),*) -> $out {
            const $fma: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
            const $l: usize = LANES;
            $cone_body
        }

        #[cold]
        #[inline(never)]
        fn $large_cone$(<$life>)?($t: &Large, $($arg: $type),*) -> $out {
            const $fma: bool = false;
            const $l: usize = LANES_LARGE;
            $cone_body
        }

        #[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+bmi1+bmi2+fma", "x86_64+avx2+bmi1+bmi2+fma"))]
        fn $fast<$($life,)? const H: usize>($t: &Fast<H>, $($arg: $type),*) -> $out {
            const $fma: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
            const $l: usize = LANES;
            $body
        }

        #[cold]
        #[inline(never)]
        fn $large$(<$life>)?($t: &Large, $($arg: $type),*) -> $out {
            const $fma: bool = false;
            const $l: usize = LANES_LARGE;
            $body
        }
    };
}

kernel!(
    eval_into <> [eval_fast, eval_large, eval_cone, eval_large_cone],
    (theta_i: f32, h_um: f32, sigma: &[f32], wo: [f32; 3], high: &mut [f32]) -> Rest,
    |tables, FMA, L| match mixture::<FMA, _, _, L, _>(tables, theta_i, h_um, sigma) {
        Some((m, x)) => m.eval::<FMA, false>(&x, (sigma, None), wo, high),
        None => Rest::MISS,
    },
    match ConeMixture::<_, _, L, _>::new::<FMA>(tables, theta_i, h_um, sigma) {
        Some(m) => m.eval::<FMA, false>((sigma, None), wo, high),
        None => Rest::MISS,
    }
);
kernel!(
    eval_pdf_into <> [eval_pdf_fast, eval_pdf_large, eval_pdf_cone, eval_pdf_large_cone],
    (theta_i: f32, h_um: f32, sigma: &[f32], wo: [f32; 3], high: &mut [f32]) -> Rest,
    |tables, FMA, L| match mixture::<FMA, _, _, L, _>(tables, theta_i, h_um, sigma) {
        Some((m, x)) => m.eval::<FMA, true>(&x, (sigma, None), wo, high),
        None => Rest::MISS,
    },
    match ConeMixture::<_, _, L, _>::new::<FMA>(tables, theta_i, h_um, sigma) {
        Some(m) => m.eval::<FMA, true>((sigma, None), wo, high),
        None => Rest::MISS,
    }
);
kernel!(
    sample_into <> [sample_fast, sample_large, sample_cone, sample_large_cone],
    (theta_i: f32, h_um: f32, sigma: &[f32], u: [f32; 3], high: &mut [f32]) -> (Option<[f32; 3]>, Rest),
    |tables, FMA, L| match weights::<FMA, _, _, L, _>(tables, theta_i, h_um, sigma) {
        Some((mut m, params)) => {
            m.scale::<FMA>();
            m.sample::<FMA>(&params, tables.bandwidth, sigma, u, high)
        }
        None => (None, Rest::MISS),
    },
    match ConeMixture::<_, _, L, _>::new::<FMA>(tables, theta_i, h_um, sigma) {
        Some(m) => m.sample::<FMA>(sigma, u, high),
        None => (None, Rest::MISS),
    }
);
kernel!(
    batch_into <'a> [batch_fast, batch_large, batch_cone, batch_large_cone],
    (queries: &Channels<'a>, f: &mut [f32]) -> (),
    |tables, FMA, L| batch::eval::<FMA, _, _, L, _>(tables, queries, f),
    cone_mixture::eval_batch::<FMA, _, _, L, _>(tables, queries, f)
);
kernel!(
    energies_into <> [energies_fast, energies_large, energies_cone, energies_large_cone],
    (theta_i: f32, h_um: f32, sigma: &[f32], high: &mut [f32]) -> [f32; 2],
    |tables, FMA, _L| energy::energies::<FMA, _, _, _>(tables, theta_i, h_um, sigma, high),
    energy::energies::<FMA, _, _, _>(tables, theta_i, h_um, sigma, high)
);
kernel!(
    slit_eval_into <'a> [slit_eval_fast, slit_eval_large, slit_eval_cone, slit_eval_large_cone],
    (share: f32, theta_i: f32, h_um: f32, sigma: &[f32], wo: [f32; 3], values: SlitValues<'a>) -> (Rest, f32),
    |tables, FMA, L| match weights::<FMA, _, _, L, _>(tables, theta_i, h_um, sigma) {
        Some((mut m, params)) => {
            m.slit_eval_pdf::<FMA>(&params, tables.bandwidth, (share, theta_i), (sigma, wo), values)
        }
        None => (Rest::MISS, 0.0),
    },
    match ConeMixture::<_, _, L, _>::new::<FMA>(tables, theta_i, h_um, sigma) {
        Some(mut m) => m.slit_eval_pdf::<FMA>(share, sigma, wo, values),
        None => (Rest::MISS, 0.0),
    }
);
kernel!(
    slit_sample_of <> [slit_sample_fast, slit_sample_large, slit_sample_cone, slit_sample_large_cone],
    (share: f32, theta_i: f32, h_um: f32, sigma: &[f32], u: [f32; 3]) -> SlitSample,
    |tables, FMA, L| match weights::<FMA, _, _, L, _>(tables, theta_i, h_um, sigma) {
        Some((mut m, params)) => m.slit_sample::<FMA>(&params, tables.bandwidth, (share, theta_i), sigma, u),
        None => SlitSample::Missed(u[0]),
    },
    match ConeMixture::<_, _, L, _>::new::<FMA>(tables, theta_i, h_um, sigma) {
        Some(mut m) => m.slit_sample::<FMA>(share, sigma, u),
        None => SlitSample::Missed(u[0]),
    }
);

/// f_refl and f_high in an outgoing direction.
#[inline]
pub(in crate::ply) fn eval<const N: usize>(
    layout: &Layout,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32; N],
    wo: [f32; 3],
) -> Core<N> {
    let mut high = [0.0; N];
    eval_into(layout, theta_i, h_um, sigma, wo, &mut high).with(high)
}

/// [`eval`] with the density.
#[inline]
pub(in crate::ply) fn eval_pdf<const N: usize>(
    layout: &Layout,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32; N],
    wo: [f32; 3],
) -> Core<N> {
    let mut high = [0.0; N];
    eval_pdf_into(layout, theta_i, h_um, sigma, wo, &mut high).with(high)
}

/// Samples an outgoing direction and evaluates [`eval_pdf`] there.
#[inline]
pub(in crate::ply) fn sample<const N: usize>(
    layout: &Layout,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32; N],
    u: [f32; 3],
) -> (Option<[f32; 3]>, Core<N>) {
    let mut high = [0.0; N];
    let (wo, rest) = sample_into(layout, theta_i, h_um, sigma, u, &mut high);
    (wo, rest.with(high))
}

/// f at many queries; 0 beyond their shortest array.
#[inline]
pub(in crate::ply) fn batch<const N: usize>(layout: &Layout, queries: &Queries<'_, N>, f: &mut [[f32; N]]) {
    batch_into(layout, &queries.channels(), f.as_flattened_mut());
}

/// The energies that the lobes are scaled to.
#[inline]
pub(in crate::ply) fn energies<const N: usize>(
    layout: &Layout,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32; N],
) -> Energies<N> {
    let mut high = [0.0; N];
    let [r_d, refl] = energies_into(layout, theta_i, h_um, sigma, &mut high);
    Energies { r_d, refl, high }
}

/// The share of f_high that a slit diffracts: its energies, and the probability that a sample belongs to it.
#[derive(Clone, Copy)]
pub(in crate::ply) struct Diffracted<const N: usize> {
    pub(in crate::ply) energy: [f32; N],
    pub(in crate::ply) chance: f32,
}

/// [`eval_pdf`] without the share of a slit, and that share.
#[inline]
pub(in crate::ply) fn slit_eval_pdf<const N: usize>(
    layout: &Layout,
    share: f32,
    (theta_i, h_um): (f32, f32),
    sigma: &[f32; N],
    wo: [f32; 3],
) -> (Core<N>, Diffracted<N>) {
    let (mut high, mut energy) = ([0.0; N], [0.0; N]);
    let values = SlitValues { high: &mut high, diffracted: &mut energy };
    let (rest, chance) = slit_eval_into(layout, share, theta_i, h_um, sigma, wo, values);
    (rest.with(high), Diffracted { energy, chance })
}

/// Samples the kind of light, if a slit diffracts its share.
#[inline]
pub(in crate::ply) fn slit_sample<const N: usize>(
    layout: &Layout,
    share: f32,
    (theta_i, h_um): (f32, f32),
    sigma: &[f32; N],
    u: [f32; 3],
) -> SlitSample {
    slit_sample_of(layout, share, theta_i, h_um, sigma, u)
}

/// Prepared lobes from fast tables.
type FastLobes<const H: usize> = PreparedLobes<H, LANES>;
type FastCones = PreparedCones<MORE, LANES>;

/// Prepared lobes of any kind at an incidence. They are stored in a host's query on the stack, because a box
/// would allocate.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug)]
enum AnyLobes {
    Few(FastLobes<FEW>),
    More(FastLobes<MORE>),
    Cone(FastCones),
    /// The beam misses, or the tables are too large.
    Nothing,
}

/// Lobes at one incidence, prepared for many directions and N absorptions. It is empty if the beam misses or
/// the tables are too large.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prepared<const N: usize> {
    lobes: AnyLobes,
    absorbed: Option<Absorbed<N>>,
}

#[derive(Clone, Copy, Debug)]
struct Absorbed<const N: usize> {
    /// Transmittances of the lobes of f_high at each absorption, scaled to the simulated energy,
    /// `[lobe][absorption]`.
    transmittance: [[f32; N]; MORE],
    energies: Energies<N>,
}

impl<const N: usize> Prepared<N> {
    pub(crate) const NOTHING: Self = Self::nothing();

    /// An empty value, constructed in place: copying [`Prepared::NOTHING`] would copy the memory of all
    /// lobes.
    #[inline(always)]
    pub(crate) const fn nothing() -> Self {
        Prepared { lobes: AnyLobes::Nothing, absorbed: None }
    }

    /// The energies that the lobes are scaled to; `None` if empty.
    #[inline(always)]
    pub(in crate::ply) fn energies(&self) -> Option<&Energies<N>> {
        self.absorbed.as_ref().map(|absorbed| &absorbed.energies)
    }

    #[inline(always)]
    pub(in crate::ply) fn is_nothing(&self) -> bool {
        self.absorbed.is_none()
    }

    /// Interpolates the lobes at an incidence, in place.
    #[inline]
    pub(in crate::ply) fn set(&mut self, layout: &Layout, theta_i: f32, h_um: f32, sigma: &[f32; N], by: DrawnBy) {
        let energies = Energies { r_d: 1.0, refl: 0.0, high: [0.0; N] };
        let to = self.absorbed.insert(Absorbed { transmittance: [[0.0; N]; MORE], energies });
        let transmittance =
            LobeTransmittances { energy: &mut to.energies.high, lobes: to.transmittance.as_flattened_mut() };
        match prepare(layout, theta_i, h_um, (sigma, by), transmittance, &mut self.lobes) {
            Some(energies) => [to.energies.r_d, to.energies.refl] = energies,
            None => self.absorbed = None,
        }
    }

    /// f_refl and f_high in a direction. Cone lobes also yield the density. An empty value yields those of a
    /// beam that misses.
    #[inline]
    pub(in crate::ply) fn eval(&self, wo: [f32; 3]) -> Core<N> {
        let mut high = [0.0; N];
        let Some(Absorbed { transmittance, .. }) = &self.absorbed else { return Rest::MISS.with(high) };
        eval_prepared(&self.lobes, transmittance.as_flattened(), wo, &mut high).with(high)
    }

    /// [`Prepared::eval`] with the density.
    #[inline]
    pub(in crate::ply) fn eval_pdf(&self, wo: [f32; 3]) -> Core<N> {
        let mut high = [0.0; N];
        let Some(Absorbed { transmittance, .. }) = &self.absorbed else { return Rest::MISS.with(high) };
        eval_pdf_prepared(&self.lobes, transmittance.as_flattened(), wo, &mut high).with(high)
    }

    /// Samples a direction and evaluates [`Prepared::eval_pdf`] there.
    #[inline]
    pub(in crate::ply) fn sample(&self, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>) {
        let mut high = [0.0; N];
        let Some(Absorbed { transmittance, .. }) = &self.absorbed else { return (None, Rest::MISS.with(high)) };
        let (wo, rest) = sample_prepared(&self.lobes, transmittance.as_flattened(), u, &mut high);
        (wo, rest.with(high))
    }
}

fn eval_prepared(lobes: &AnyLobes, transmittance: &[f32], wo: [f32; 3], high: &mut [f32]) -> Rest {
    match lobes {
        AnyLobes::Few(x) => prepared_eval(x, transmittance, wo, high),
        AnyLobes::More(x) => prepared_eval(x, transmittance, wo, high),
        AnyLobes::Cone(x) => cone_eval_pdf(x, transmittance, wo, high),
        AnyLobes::Nothing => Rest::MISS,
    }
}

fn eval_pdf_prepared(lobes: &AnyLobes, transmittance: &[f32], wo: [f32; 3], high: &mut [f32]) -> Rest {
    match lobes {
        AnyLobes::Few(x) => prepared_eval_pdf(x, transmittance, wo, high),
        AnyLobes::More(x) => prepared_eval_pdf(x, transmittance, wo, high),
        AnyLobes::Cone(x) => cone_eval_pdf(x, transmittance, wo, high),
        AnyLobes::Nothing => Rest::MISS,
    }
}

fn sample_prepared(lobes: &AnyLobes, transmittance: &[f32], u: [f32; 3], high: &mut [f32]) -> (Option<[f32; 3]>, Rest) {
    match lobes {
        AnyLobes::Few(x) => prepared_sample(x, transmittance, u, high),
        AnyLobes::More(x) => prepared_sample(x, transmittance, u, high),
        AnyLobes::Cone(x) => cone_sample(x, transmittance, u, high),
        AnyLobes::Nothing => (None, Rest::MISS),
    }
}

/// Interpolates the lobes at an incidence, in place. Returns r_d and the energy of f_refl; `None` if the beam
/// misses or the tables are too large.
fn prepare(
    layout: &Layout,
    theta_i: f32,
    h_um: f32,
    sigma: (&[f32], DrawnBy),
    transmittance: LobeTransmittances<'_>,
    lobes: &mut AnyLobes,
) -> Option<[f32; 2]> {
    match layout {
        Layout::Few(tables) => prepare_few(tables, theta_i, h_um, sigma, transmittance, lobes),
        Layout::More(tables) => prepare_more(tables, theta_i, h_um, sigma, transmittance, lobes),
        Layout::Cone(tables) => prepare_cone(tables, theta_i, h_um, sigma, transmittance, lobes),
        Layout::Large(_) | Layout::LargeCone(_) => None,
    }
}

/// Declares a kernel of prepared lobes, compiled for several instruction sets.
macro_rules! prepared {
    ($name:ident <$($life:lifetime)? $($h:ident)?>, ($($arg:ident: $type:ty),*) -> $out:ty, |$fma:ident| $body:expr) => {
        #[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+bmi1+bmi2+fma", "x86_64+avx2+bmi1+bmi2+fma"))]
        fn $name<$($life,)? $(const $h: usize)?>($($arg: $type),*) -> $out {
            const $fma: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
            $body
        }
    };
}

prepared!(prepare_few<'a>, (tables: &Fast<FEW>, theta_i: f32, h_um: f32, sigma: (&[f32], DrawnBy), transmittance: LobeTransmittances<'a>, lobes: &mut AnyLobes) -> Option<[f32; 2]>, |FMA| {
    match mixture::<FMA, _, _, LANES, _>(tables, theta_i, h_um, sigma.0) {
        Some((m, shapes)) => {
            let drawing = m.drawing_by(sigma.0, sigma.1, transmittance);
            *lobes = AnyLobes::Few(PreparedLobes::new::<FMA, _, _>(&m, &shapes, &drawing));
            Some([m.r_d, m.refl])
        }
        None => None,
    }
});
prepared!(prepare_more<'a>, (tables: &Fast<MORE>, theta_i: f32, h_um: f32, sigma: (&[f32], DrawnBy), transmittance: LobeTransmittances<'a>, lobes: &mut AnyLobes) -> Option<[f32; 2]>, |FMA| {
    match mixture::<FMA, _, _, LANES, _>(tables, theta_i, h_um, sigma.0) {
        Some((m, shapes)) => {
            let drawing = m.drawing_by(sigma.0, sigma.1, transmittance);
            *lobes = AnyLobes::More(PreparedLobes::new::<FMA, _, _>(&m, &shapes, &drawing));
            Some([m.r_d, m.refl])
        }
        None => None,
    }
});
prepared!(prepare_cone<'a>, (tables: &Fast<MORE>, theta_i: f32, h_um: f32, sigma: (&[f32], DrawnBy), transmittance: LobeTransmittances<'a>, lobes: &mut AnyLobes) -> Option<[f32; 2]>, |FMA| {
    match ConeMixture::<_, _, LANES, _>::new::<FMA>(tables, theta_i, h_um, sigma.0) {
        Some(m) => {
            let drawing = m.weights.drawing_by(sigma.0, sigma.1, transmittance);
            *lobes = AnyLobes::Cone(PreparedCones::new::<FMA, _, _>(&m, &drawing));
            Some([m.weights.r_d, m.weights.refl])
        }
        None => None,
    }
});
prepared!(cone_eval_pdf<>, (x: &FastCones, transmittance: &[f32], wo: [f32; 3], high: &mut [f32]) -> Rest, |FMA| x.eval_pdf::<FMA>(transmittance, wo, high));
prepared!(cone_sample<>, (x: &FastCones, transmittance: &[f32], u: [f32; 3], high: &mut [f32]) -> (Option<[f32; 3]>, Rest), |FMA| x.sample::<FMA>(transmittance, u, high));
prepared!(prepared_eval<H>, (x: &FastLobes<H>, transmittance: &[f32], wo: [f32; 3], high: &mut [f32]) -> Rest, |FMA| x.eval::<FMA, false>(transmittance, wo, high));
prepared!(prepared_eval_pdf<H>, (x: &FastLobes<H>, transmittance: &[f32], wo: [f32; 3], high: &mut [f32]) -> Rest, |FMA| x.eval::<FMA, true>(transmittance, wo, high));
prepared!(prepared_sample<H>, (x: &FastLobes<H>, transmittance: &[f32], u: [f32; 3], high: &mut [f32]) -> (Option<[f32; 3]>, Rest), |FMA| x.sample::<FMA>(transmittance, u, high));
