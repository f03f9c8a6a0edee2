//! The kernels, compiled for several instruction sets; the processor is detected at the first call.
//!
//! Each of these functions is one inlined copy of the arithmetic. Models that exceed the fast tables use one
//! portable copy.

use super::batch;
use super::compiled::{compiled, same, same_mut, same_queries, same_ref, same_rows_mut};
use super::cone_mixture::{self, ConeMixture, PreparedCones};
use super::energy::{Core, DrawnBy, Energies, energies, sum};
use super::layout::{FEW, Fast, Layout, MORE, Tables};
use super::mixture::{mixture, weights};
use super::prepared::PreparedLobes;
use crate::ply::slit::{Diffracted, SlitSample};
use crate::ply::{MAX_LOBES, MAX_PATHS, Queries};
use multiversion::{multiversion, target::target_cfg_f};

type Large = Tables<MAX_LOBES, MAX_LOBES, MAX_PATHS>;
/// Lanes of a mixture for fast and for large tables: a power of 2.
const LANES: usize = 16;
const LANES_LARGE: usize = 2 * MAX_LOBES;

/// Declares a kernel: `$name` is `$any`, which chooses between `$fast`, compiled for several instruction
/// sets, `$large`, and the two for cones. In each, the body uses the tables and the constants FMA and L
/// (lanes).
macro_rules! kernel {
    ($name:ident = $any:ident, [$fast:ident, $large:ident, $cone:ident, $large_cone:ident],
     ($($arg:ident: $type:ty $(as $how:ident)?),*) -> $out:ty, |$t:ident, $fma:ident, $l:ident| $body:expr, $cone_body:expr) => {
        compiled!($name = $any(layout: &Layout, $($arg: $type $(as $how)?),*) -> $out);

        #[inline]
        fn $any<const N: usize>(layout: &Layout, $($arg: $type),*) -> $out {
            match layout {
                Layout::Few(tables) => $fast(tables, $($arg),*),
                Layout::More(tables) => $fast(tables, $($arg),*),
                Layout::Large(tables) => $large(tables, $($arg),*),
                Layout::Cone(tables) => $cone(tables, $($arg),*),
                Layout::LargeCone(tables) => $large_cone(tables, $($arg),*),
            }
        }

        #[multiversion(targets(
            "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+avx2+bmi1+bmi2+fma",
            "x86_64+avx2+bmi1+bmi2+fma"
        ))]
        fn $cone<const N: usize>($t: &Fast<MORE>, $($arg: $type),*) -> $out {
            const $fma: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
            const $l: usize = LANES;
            $cone_body
        }

        #[cold]
        #[inline(never)]
        fn $large_cone<const N: usize>($t: &Large, $($arg: $type),*) -> $out {
            const $fma: bool = false;
            const $l: usize = LANES_LARGE;
            $cone_body
        }

        #[multiversion(targets(
            "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+avx2+bmi1+bmi2+fma",
            "x86_64+avx2+bmi1+bmi2+fma"
        ))]
        fn $fast<const H: usize, const N: usize>($t: &Fast<H>, $($arg: $type),*) -> $out {
            const $fma: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
            const $l: usize = LANES;
            $body
        }

        #[cold]
        #[inline(never)]
        fn $large<const N: usize>($t: &Large, $($arg: $type),*) -> $out {
            const $fma: bool = false;
            const $l: usize = LANES_LARGE;
            $body
        }
    };
}

kernel!(
    run_eval = any_eval, [eval_fast, eval_large, eval_cone, eval_large_cone],
    (theta_i: f32, h_um: f32, sigma: [f32; N] as same, wo: [f32; 3]) -> Core<N>,
    |tables, FMA, L| match mixture::<FMA, _, _, L, _, N>(tables, theta_i, h_um, &sigma) {
        Some((m, x)) => {
            let (refl, high) = m.eval::<FMA>(&x, wo);
            m.core(refl, high, 0.0)
        }
        None => Core::MISS,
    },
    match ConeMixture::<_, _, L, _, N>::new::<FMA>(tables, theta_i, h_um, &sigma) {
        Some(m) => {
            let (refl, high) = m.eval::<FMA>(wo);
            m.core((refl, high, 0.0))
        }
        None => Core::MISS,
    }
);
kernel!(
    run_eval_pdf = any_eval_pdf, [eval_pdf_fast, eval_pdf_large, eval_pdf_cone, eval_pdf_large_cone],
    (theta_i: f32, h_um: f32, sigma: [f32; N] as same, wo: [f32; 3]) -> Core<N>,
    |tables, FMA, L| match mixture::<FMA, _, _, L, _, N>(tables, theta_i, h_um, &sigma) {
        Some((m, x)) => {
            let (refl, high, pdf) = m.eval_pdf::<FMA>(&x, &m.mean::<FMA>(), wo);
            m.core(refl, high, pdf)
        }
        None => Core::MISS,
    },
    match ConeMixture::<_, _, L, _, N>::new::<FMA>(tables, theta_i, h_um, &sigma) {
        Some(m) => m.core(m.eval_pdf::<FMA>(&m.mean::<FMA>(), wo)),
        None => Core::MISS,
    }
);
kernel!(
    run_sample = any_sample, [sample_fast, sample_large, sample_cone, sample_large_cone],
    (theta_i: f32, h_um: f32, sigma: [f32; N] as same, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>),
    |tables, FMA, L| match weights::<FMA, _, _, L, _, N>(tables, theta_i, h_um, &sigma) {
        Some((mut m, params)) => match m.sample::<FMA>(&params, tables.bandwidth, u) {
            Some((wo, (refl, high, pdf))) => (Some(wo), m.core(refl, high, pdf)),
            None => (None, m.core(0.0, [0.0; N], 0.0)),
        },
        None => (None, Core::MISS),
    },
    match ConeMixture::<_, _, L, _, N>::new::<FMA>(tables, theta_i, h_um, &sigma) {
        Some(m) => m.sample::<FMA>(u),
        None => (None, Core::MISS),
    }
);
kernel!(
    run_directions = any_directions, [directions_fast, directions_large, directions_cone, directions_large_cone],
    (theta_i: f32, h_um: f32, sigma: [f32; N] as same, wo: &[[f32; 3]], f: &mut [[f32; N]] as same_rows_mut, pdf: &mut [f32]) -> (),
    |tables, FMA, L| match mixture::<FMA, _, _, L, _, N>(tables, theta_i, h_um, &sigma) {
        Some((m, x)) => {
            let mean = m.mean::<FMA>();
            for ((wo, f), pdf) in wo.iter().zip(f).zip(pdf) {
                let (refl, high, p) = m.eval_pdf::<FMA>(&x, &mean, *wo);
                (*f, *pdf) = (sum(refl, high), p);
            }
        }
        None => wo.iter().zip(f).zip(pdf).for_each(|((_, f), pdf)| (*f, *pdf) = ([0.0; N], 0.0)),
    },
    match ConeMixture::<_, _, L, _, N>::new::<FMA>(tables, theta_i, h_um, &sigma) {
        Some(m) => {
            let mean = m.mean::<FMA>();
            for ((wo, f), pdf) in wo.iter().zip(f).zip(pdf) {
                let (refl, high, p) = m.eval_pdf::<FMA>(&mean, *wo);
                (*f, *pdf) = (sum(refl, high), p);
            }
        }
        None => wo.iter().zip(f).zip(pdf).for_each(|((_, f), pdf)| (*f, *pdf) = ([0.0; N], 0.0)),
    }
);
kernel!(
    run_batch = any_batch, [batch_fast, batch_large, batch_cone, batch_large_cone],
    (queries: Queries<'_, N> as same_queries, f: &mut [[f32; N]] as same_rows_mut) -> (),
    |tables, FMA, L| batch::eval::<FMA, _, _, L, _, N>(tables, &queries, f),
    cone_mixture::eval_batch::<FMA, _, _, L, _, N>(tables, &queries, f)
);
kernel!(
    run_energies = any_energies, [energies_fast, energies_large, energies_cone, energies_large_cone],
    (theta_i: f32, h_um: f32, sigma: [f32; N] as same) -> Energies<N>,
    |tables, FMA, _L| match energies::<FMA, _, _, _, N>(tables, theta_i, h_um, &sigma) {
        Some(e) => e,
        None => Energies::MISS,
    },
    match energies::<FMA, _, _, _, N>(tables, theta_i, h_um, &sigma) {
        Some(e) => e,
        None => Energies::MISS,
    }
);
kernel!(
    run_slit_eval = any_slit_eval, [slit_eval_fast, slit_eval_large, slit_eval_cone, slit_eval_large_cone],
    (share: f32, theta_i: f32, h_um: f32, sigma: [f32; N] as same, wo: [f32; 3]) -> (Core<N>, Diffracted<N>),
    |tables, FMA, L| match weights::<FMA, _, _, L, _, N>(tables, theta_i, h_um, &sigma) {
        Some((mut m, params)) => m.slit_eval_pdf::<FMA>(&params, tables.bandwidth, (share, theta_i), wo),
        None => (Core::MISS, Diffracted { energy: [0.0; N], chance: 0.0 }),
    },
    match ConeMixture::<_, _, L, _, N>::new::<FMA>(tables, theta_i, h_um, &sigma) {
        Some(mut m) => m.slit_eval_pdf::<FMA>(share, wo),
        None => (Core::MISS, Diffracted { energy: [0.0; N], chance: 0.0 }),
    }
);
kernel!(
    run_slit_sample = any_slit_sample, [slit_sample_fast, slit_sample_large, slit_sample_cone, slit_sample_large_cone],
    (share: f32, theta_i: f32, h_um: f32, sigma: [f32; N] as same, u: [f32; 3]) -> SlitSample,
    |tables, FMA, L| match weights::<FMA, _, _, L, _, N>(tables, theta_i, h_um, &sigma) {
        Some((mut m, params)) => m.slit_sample::<FMA>(&params, tables.bandwidth, (share, theta_i), u),
        None => SlitSample::Missed(u[0]),
    },
    match ConeMixture::<_, _, L, _, N>::new::<FMA>(tables, theta_i, h_um, &sigma) {
        Some(mut m) => m.slit_sample::<FMA>(share, u),
        None => SlitSample::Missed(u[0]),
    }
);

/// Lobes of fast tables.
type FastLobes<const H: usize, const N: usize> = PreparedLobes<H, LANES, N>;
type FastCones<const N: usize> = PreparedCones<MORE, LANES, N>;

/// Prepared lobes of an incidence. They live on the stack of a host's query: a box would allocate.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug)]
pub(crate) enum Prepared<const N: usize> {
    Few(FastLobes<FEW, N>),
    More(FastLobes<MORE, N>),
    Cone(FastCones<N>),
    /// The beam misses, or the tables are large.
    Nothing,
}

compiled!(
    /// Prepares the lobes at an incidence, in place.
    run_prepare = any_prepare(
        layout: &Layout, theta_i: f32, h_um: f32, sigma: &[f32; N] as same_ref, drawn_by: DrawnBy, prepared: &mut Prepared<N> as same_mut
    ) -> ()
);
compiled!(
    /// f_refl and f_high of prepared lobes; those of a beam that misses if there are none.
    kept_eval = any_kept_eval(kept: &Prepared<N> as same_ref, wo: [f32; 3]) -> Core<N>
);
compiled!(
    /// [`kept_eval`] with the density.
    kept_eval_pdf = any_kept_eval_pdf(kept: &Prepared<N> as same_ref, wo: [f32; 3]) -> Core<N>
);
compiled!(
    /// A direction sampled from prepared lobes, with [`kept_eval_pdf`] there.
    kept_sample = any_kept_sample(kept: &Prepared<N> as same_ref, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>)
);

#[inline]
fn any_prepare<const N: usize>(
    layout: &Layout,
    theta_i: f32,
    h_um: f32,
    sigma: &[f32; N],
    drawn_by: DrawnBy,
    prepared: &mut Prepared<N>,
) {
    match layout {
        Layout::Few(tables) => prepare_few(tables, theta_i, h_um, sigma, drawn_by, prepared),
        Layout::More(tables) => prepare_more(tables, theta_i, h_um, sigma, drawn_by, prepared),
        Layout::Cone(tables) => prepare_cone(tables, theta_i, h_um, sigma, drawn_by, prepared),
        Layout::Large(_) | Layout::LargeCone(_) => (),
    }
}

#[inline]
fn any_kept_eval<const N: usize>(kept: &Prepared<N>, wo: [f32; 3]) -> Core<N> {
    match kept {
        Prepared::Few(x) => prepared_eval(x, wo),
        Prepared::More(x) => prepared_eval(x, wo),
        Prepared::Cone(x) => cone_eval_pdf(x, wo),
        Prepared::Nothing => Core::MISS,
    }
}

#[inline]
fn any_kept_eval_pdf<const N: usize>(kept: &Prepared<N>, wo: [f32; 3]) -> Core<N> {
    match kept {
        Prepared::Few(x) => prepared_eval_pdf(x, wo),
        Prepared::More(x) => prepared_eval_pdf(x, wo),
        Prepared::Cone(x) => cone_eval_pdf(x, wo),
        Prepared::Nothing => Core::MISS,
    }
}

#[inline]
fn any_kept_sample<const N: usize>(kept: &Prepared<N>, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>) {
    match kept {
        Prepared::Few(x) => prepared_sample(x, u),
        Prepared::More(x) => prepared_sample(x, u),
        Prepared::Cone(x) => cone_sample(x, u),
        Prepared::Nothing => (None, Core::MISS),
    }
}

/// Declares a kernel of prepared lobes, compiled for several instruction sets.
macro_rules! prepared {
    ($name:ident <$($h:ident)?>, ($($arg:ident: $type:ty),*) -> $out:ty, |$fma:ident| $body:expr) => {
        #[multiversion(targets(
            "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+avx2+bmi1+bmi2+fma",
            "x86_64+avx2+bmi1+bmi2+fma"
        ))]
        fn $name<$(const $h: usize,)? const N: usize>($($arg: $type),*) -> $out {
            const $fma: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
            $body
        }
    };
}

prepared!(prepare_few<>, (tables: &Fast<FEW>, theta_i: f32, h_um: f32, sigma: &[f32; N], drawn_by: DrawnBy, prepared: &mut Prepared<N>) -> (), |FMA| {
    if let Some((mixture, shapes)) = mixture::<FMA, _, _, LANES, _, N>(tables, theta_i, h_um, sigma) {
        *prepared = Prepared::Few(PreparedLobes::new::<FMA, _, _>(&mixture, &shapes, drawn_by));
    }
});
prepared!(prepare_more<>, (tables: &Fast<MORE>, theta_i: f32, h_um: f32, sigma: &[f32; N], drawn_by: DrawnBy, prepared: &mut Prepared<N>) -> (), |FMA| {
    if let Some((mixture, shapes)) = mixture::<FMA, _, _, LANES, _, N>(tables, theta_i, h_um, sigma) {
        *prepared = Prepared::More(PreparedLobes::new::<FMA, _, _>(&mixture, &shapes, drawn_by));
    }
});
prepared!(prepare_cone<>, (tables: &Fast<MORE>, theta_i: f32, h_um: f32, sigma: &[f32; N], drawn_by: DrawnBy, prepared: &mut Prepared<N>) -> (), |FMA| {
    if let Some(mixture) = ConeMixture::<_, _, LANES, _, N>::new::<FMA>(tables, theta_i, h_um, sigma) {
        *prepared = Prepared::Cone(PreparedCones::new::<FMA, _, _>(&mixture, drawn_by));
    }
});
prepared!(cone_eval_pdf<>, (x: &FastCones<N>, wo: [f32; 3]) -> Core<N>, |FMA| x.eval_pdf::<FMA>(wo));
prepared!(cone_sample<>, (x: &FastCones<N>, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>), |FMA| x.sample::<FMA>(u));
prepared!(prepared_eval<H>, (x: &FastLobes<H, N>, wo: [f32; 3]) -> Core<N>, |FMA| x.eval::<FMA>(wo));
prepared!(prepared_eval_pdf<H>, (x: &FastLobes<H, N>, wo: [f32; 3]) -> Core<N>, |FMA| x.eval_pdf::<FMA>(wo));
prepared!(prepared_sample<H>, (x: &FastLobes<H, N>, u: [f32; 3]) -> (Option<[f32; 3]>, Core<N>), |FMA| x.sample::<FMA>(u));
