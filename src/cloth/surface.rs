//! What fabrics and cloths of curves have in common.

use crate::FabricQuery;
use crate::fabric::FabricBsdf;

/// A cloth as a surface that scatters light.
pub trait ClothSurface: Sync {
    /// The surface at a query.
    fn surface_at<'a, const N: usize>(&'a self, query: &FabricQuery<'a, N>) -> FabricBsdf<'a, N>;
}
