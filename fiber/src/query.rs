//! The query of a fiber: incident direction, offset, wavelengths and absorptions.

/// A query at a shading point of a fiber, for N wavelengths.
///
/// ```
/// use plywave_fiber::FiberQuery;
/// use plywave::frame::direction;
///
/// let query = FiberQuery::new(direction(0.4, 1.1), [0.65, 0.55, 0.45]);
/// # assert!(query.h_rel.is_none());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FiberQuery<const N: usize> {
    /// Direction that light comes from (omega_i of the papers), unit, in the fiber's frame: z points along
    /// the fiber, x and y along the axes of the outline.
    pub omega_i: [f32; 3],
    /// Offset of the ray from the center line in units of half the fiber's width, -1 to 1, for models that
    /// resolve it. `None` is the mean over all offsets. Tables hold only that mean and return it at every
    /// offset.
    pub h_rel: Option<f32>,
    /// Wavelengths [um].
    pub lambda_um: [f32; N],
    /// Absorption inside the fiber [1/um] at each wavelength, which is its color. Tables ignore it, since
    /// theirs is built in.
    pub sigma_per_um: [f32; N],
}

impl<const N: usize> FiberQuery<N> {
    /// A query of light from `omega_i`, averaged over the offsets, on a fiber without absorption.
    pub fn new(omega_i: [f32; 3], lambda_um: [f32; N]) -> Self {
        FiberQuery { omega_i, h_rel: None, lambda_um, sigma_per_um: [0.0; N] }
    }
}
