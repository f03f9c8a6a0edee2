//! The kernels compiled for several instruction sets; the processor chooses at the first call.
//!
//! Each of these functions is one inlined copy of the arithmetic. Models beyond the small form (8 lobes of each kind, 8 path
//! lengths) take one portable copy.

use super::Queries;
use super::kernel::{Energies, energies, mixture};
use super::layout::{LARGE, Layout, SMALL};
use multiversion::{multiversion, target::target_cfg_f};

/// Declares a kernel: `$name` chooses between `$small`, compiled for several instruction sets, and `$large`.
macro_rules! kernel {
    ($name:ident, $small:ident, $large:ident, ($($arg:ident: $type:ty),*) -> $out:ty, $miss:expr, |$m:ident, $fma:ident| $body:expr) => {
        #[inline]
        pub(super) fn $name<const N: usize>(layout: &Layout, theta_i: f32, h_um: f32, sigma: [f32; N], $($arg: $type),*) -> $out {
            if layout.small {
                $small(layout, theta_i, h_um, sigma, $($arg),*)
            } else {
                $large(layout, theta_i, h_um, sigma, $($arg),*)
            }
        }

        #[multiversion(targets(
            "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+avx2+bmi1+bmi2+fma",
            "x86_64+avx2+bmi1+bmi2+fma"
        ))]
        fn $small<const N: usize>(layout: &Layout, theta_i: f32, h_um: f32, sigma: [f32; N], $($arg: $type),*) -> $out {
            const $fma: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
            match mixture::<$fma, { SMALL.high }, { SMALL.refl }, { SMALL.high + SMALL.refl }, { SMALL.paths }, N>(layout, theta_i, h_um, &sigma) {
                Some($m) => $body,
                None => $miss,
            }
        }

        #[cold]
        #[inline(never)]
        fn $large<const N: usize>(layout: &Layout, theta_i: f32, h_um: f32, sigma: [f32; N], $($arg: $type),*) -> $out {
            const $fma: bool = false;
            match mixture::<$fma, { LARGE.high }, { LARGE.refl }, { LARGE.high + LARGE.refl }, { LARGE.paths }, N>(layout, theta_i, h_um, &sigma) {
                Some($m) => $body,
                None => $miss,
            }
        }
    };
}

kernel!(run_eval, eval_small, eval_large, (wo: [f32; 3]) -> (f32, [f32; N]), (0.0, [0.0; N]), |m, FMA| m.eval::<FMA>(wo));
kernel!(run_pdf, pdf_small, pdf_large, (wo: [f32; 3]) -> f32, 0.0, |m, FMA| m.pdf::<FMA>(wo));
kernel!(run_sample, sample_small, sample_large, (u: [f32; 3]) -> Option<([f32; 3], [f32; N], f32)>, None, |m, FMA| m.sample::<FMA>(u));
kernel!(
    run_directions,
    directions_small,
    directions_large,
    (wo: &[[f32; 3]], f: &mut [[f32; N]], pdf: &mut [f32]) -> (),
    wo.iter().zip(f).zip(pdf).for_each(|((_, f), pdf)| (*f, *pdf) = ([0.0; N], 0.0)),
    |m, FMA| {
        for ((wo, f), pdf) in wo.iter().zip(f).zip(pdf) {
            let (refl, high, p) = m.eval_pdf::<FMA>(*wo);
            (*f, *pdf) = (high.map(|f| refl + f), p);
        }
    }
);

/// Exact energies at an incidence.
#[multiversion(targets("x86_64+avx2+bmi1+bmi2+fma"))]
pub(super) fn run_energies<const N: usize>(layout: &Layout, theta_i: f32, h_um: f32, sigma: [f32; N]) -> Energies<N> {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    let energies = if layout.small {
        energies::<FMA, { SMALL.paths }, N>(layout, theta_i, h_um, &sigma)
    } else {
        energies::<FMA, { LARGE.paths }, N>(layout, theta_i, h_um, &sigma)
    };
    energies.unwrap_or(Energies::MISS)
}

/// f at many queries. Vectors run over the lobes here, too: over queries they would gather every parameter of every lobe.
pub(super) fn run_batch<const N: usize>(layout: &Layout, queries: &Queries<'_, N>, f: &mut [[f32; N]]) {
    if layout.small {
        batch_small(layout, queries, f);
    } else {
        for (i, f) in f.iter_mut().enumerate() {
            *f = queries.get(i).map_or([0.0; N], |(theta_i, h_um, sigma, wo)| {
                let (refl, high) = eval_large(layout, theta_i, h_um, sigma, wo);
                high.map(|f| refl + f)
            });
        }
    }
}

#[multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512cd+avx512dq+avx512vl+avx2+bmi1+bmi2+fma",
    "x86_64+avx2+bmi1+bmi2+fma"
))]
fn batch_small<const N: usize>(layout: &Layout, queries: &Queries<'_, N>, f: &mut [[f32; N]]) {
    const FMA: bool = target_cfg_f!(target_feature = "fma") || cfg!(target_arch = "aarch64");
    for (i, f) in f.iter_mut().enumerate() {
        *f = [0.0; N];
        let Some((theta_i, h_um, sigma, wo)) = queries.get(i) else { continue };
        let mixture = mixture::<FMA, { SMALL.high }, { SMALL.refl }, { SMALL.high + SMALL.refl }, { SMALL.paths }, N>(
            layout, theta_i, h_um, &sigma,
        );
        if let Some(m) = mixture {
            let (refl, high) = m.eval::<FMA>(wo);
            *f = high.map(|f| refl + f);
        }
    }
}
