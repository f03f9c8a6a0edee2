//! Numbers of formulas that hosts evaluate themselves from tensors (GPUs, differentiating compilers). Each is
//! typed once, in the file of its formula.

use crate::cloth::shade::MEAN_Z;
use crate::math::{erf, faddeeva};
use crate::ply::LOBE_MEAN;

/// The numbers by name:
///
/// - `lobe_mean`: coefficients of the mean of a lobe, six rows of 11, 9, 7, 5, 3 and 1
///   (`ply/kernel/lobe.rs`);
/// - `faddeeva`: the scale of Weideman's series, then its coefficients (`math/faddeeva.rs`);
/// - `erf_over`, `erf_under`: coefficients of the error function (`math/erf.rs`);
/// - `shadow_mean_z`: cosines at the middles of the bands of an occlusion table
///   (`cloth/shade/shadow_table.rs`).
pub fn host_constants() -> [(&'static str, Vec<f32>); 5] {
    let (scale, series) = faddeeva::SINGLE;
    [
        ("lobe_mean", LOBE_MEAN.concat()),
        ("faddeeva", std::iter::once(scale).chain(series).collect()),
        ("erf_over", erf::OVER.to_vec()),
        ("erf_under", erf::UNDER.to_vec()),
        ("shadow_mean_z", MEAN_Z.to_vec()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_have_their_lengths() {
        let lengths = host_constants().map(|(_, values)| values.len());
        assert_eq!(lengths, [11 + 9 + 7 + 5 + 3 + 1, 17, 7, 5, 8]);
    }
}
