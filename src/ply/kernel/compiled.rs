//! Kernels for 1, 3 and 4 absorptions (a wavelength, RGB and a spectral host's packet), compiled once with
//! this library: a crate that calls them compiles only kernels for other numbers. Otherwise every program and
//! every test of a host would compile each kernel for each instruction set again, a minute in total.

use crate::ply::Queries;
use std::any::Any;

/// Converts a value for N absorptions to the type with the literal number. Costs nothing: types are compared
/// when code is generated.
#[inline(always)]
pub(crate) fn same<A: Copy + 'static, B: Copy + 'static>(value: A) -> B {
    match (&value as &dyn Any).downcast_ref() {
        Some(value) => *value,
        None => unreachable!("numbers of absorptions are compared before"),
    }
}

/// [`same`] for a reference.
#[inline(always)]
pub(crate) fn same_ref<A: 'static, B: 'static>(value: &A) -> &B {
    match (value as &dyn Any).downcast_ref() {
        Some(value) => value,
        None => unreachable!("numbers of absorptions are compared before"),
    }
}

/// [`same`] for a mutable reference.
#[inline(always)]
pub(crate) fn same_mut<A: 'static, B: 'static>(value: &mut A) -> &mut B {
    match (value as &mut dyn Any).downcast_mut() {
        Some(value) => value,
        None => unreachable!("numbers of absorptions are compared before"),
    }
}

/// [`same`] for results.
#[inline(always)]
pub(crate) fn same_rows_mut<const N: usize, const M: usize>(rows: &mut [[f32; N]]) -> &mut [[f32; M]] {
    rows.as_flattened_mut().as_chunks_mut().0
}

/// [`same`] for batches of queries.
#[inline(always)]
pub(crate) fn same_queries<const N: usize, const M: usize>(queries: Queries<'_, N>) -> Queries<'_, M> {
    let Queries { theta_i, h_um, sigma_per_um, wo } = queries;
    Queries { theta_i, h_um, sigma_per_um: sigma_per_um.as_flattened().as_chunks().0, wo }
}

/// Declares `$name` for N absorptions, equal to `$any`. An argument whose type has N names the function above
/// that converts it to the literal number.
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
