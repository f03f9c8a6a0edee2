//! Kernels of 1, 3 and 4 absorptions, a wavelength, RGB and a spectral host's packet, compiled once with this
//! library: a crate that calls them compiles those of other numbers alone. Without it every program and every
//! test of a host compiles each kernel for each instruction set anew, a minute for all.

use crate::ply::Queries;
use std::any::Any;

/// A value of N absorptions as one of the number that N is. Costs nothing: types are compared when code is
/// generated.
#[inline(always)]
pub(crate) fn same<A: Copy + 'static, B: Copy + 'static>(value: A) -> B {
    match (&value as &dyn Any).downcast_ref() {
        Some(value) => *value,
        None => unreachable!("numbers of absorptions are compared before"),
    }
}

/// [`same`] of what is borrowed.
#[inline(always)]
pub(crate) fn same_ref<A: 'static, B: 'static>(value: &A) -> &B {
    match (value as &dyn Any).downcast_ref() {
        Some(value) => value,
        None => unreachable!("numbers of absorptions are compared before"),
    }
}

/// [`same`] of what is changed.
#[inline(always)]
pub(crate) fn same_mut<A: 'static, B: 'static>(value: &mut A) -> &mut B {
    match (value as &mut dyn Any).downcast_mut() {
        Some(value) => value,
        None => unreachable!("numbers of absorptions are compared before"),
    }
}

/// [`same`] of results.
#[inline(always)]
pub(crate) fn same_rows_mut<const N: usize, const M: usize>(rows: &mut [[f32; N]]) -> &mut [[f32; M]] {
    rows.as_flattened_mut().as_chunks_mut().0
}

/// [`same`] of many queries.
#[inline(always)]
pub(crate) fn same_queries<const N: usize, const M: usize>(queries: Queries<'_, N>) -> Queries<'_, M> {
    let Queries { theta_i, h_um, sigma_per_um, wo } = queries;
    Queries { theta_i, h_um, sigma_per_um: sigma_per_um.as_flattened().as_chunks().0, wo }
}

/// Declares `$name` of N absorptions, which is `$any`. An argument whose type has N says which of the
/// functions above makes it one of a number.
macro_rules! compiled {
    ($(#[$doc:meta])* $name:ident = $any:ident($($arg:ident: $type:ty $(as $how:ident)?),*) -> $out:ty) => {
        $(#[$doc])*
        #[inline]
        #[allow(unused_parens)]
        pub(in crate::ply) fn $name<const N: usize>($($arg: $type),*) -> $out {
            mod one {
                use super::*;
                const N: usize = 1;
                pub(in crate::ply) fn of($($arg: $type),*) -> $out {
                    $any($($arg),*)
                }
            }
            mod three {
                use super::*;
                const N: usize = 3;
                pub(in crate::ply) fn of($($arg: $type),*) -> $out {
                    $any($($arg),*)
                }
            }
            mod four {
                use super::*;
                const N: usize = 4;
                pub(in crate::ply) fn of($($arg: $type),*) -> $out {
                    $any($($arg),*)
                }
            }
            if const { N == 1 } {
                same(one::of($($($how)?($arg)),*))
            } else if const { N == 3 } {
                same(three::of($($($how)?($arg)),*))
            } else if const { N == 4 } {
                same(four::of($($($how)?($arg)),*))
            } else {
                $any($($arg),*)
            }
        }
    };
}
pub(crate) use compiled;
