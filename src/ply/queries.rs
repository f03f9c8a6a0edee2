//! Batches of queries, as arrays.

/// A batch of queries, as arrays of equal lengths.
#[derive(Clone, Copy, Debug)]
pub struct Queries<'a, const N: usize> {
    /// Incident latitudes [rad].
    pub theta_i: &'a [f32],
    /// Beam offsets [um].
    pub h_um: &'a [f32],
    /// Absorptions [1/um].
    pub sigma_per_um: &'a [[f32; N]],
    /// Components x, y, z of the outgoing directions, unit.
    pub wo: [&'a [f32]; 3],
}

impl<const N: usize> Queries<'_, N> {
    /// Query `i`; `None` beyond the shortest array.
    #[inline(always)]
    pub(super) fn get(&self, i: usize) -> Option<(f32, f32, [f32; N], [f32; 3])> {
        let wo = [*self.wo[0].get(i)?, *self.wo[1].get(i)?, *self.wo[2].get(i)?];
        Some((*self.theta_i.get(i)?, *self.h_um.get(i)?, *self.sigma_per_um.get(i)?, wo))
    }

    /// The queries from `at` on.
    #[inline(always)]
    pub(super) fn from(&self, at: usize) -> Self {
        let [x, y, z] = self.wo;
        Queries {
            theta_i: self.theta_i.get(at..).unwrap_or(&[]),
            h_um: self.h_um.get(at..).unwrap_or(&[]),
            sigma_per_um: self.sigma_per_um.get(at..).unwrap_or(&[]),
            wo: [x.get(at..).unwrap_or(&[]), y.get(at..).unwrap_or(&[]), z.get(at..).unwrap_or(&[])],
        }
    }

    /// Whether the first `n` queries have the same incidence and absorptions.
    #[inline(always)]
    pub(super) fn one_incidence(&self, n: usize) -> bool {
        fn same<T: PartialEq>(x: &[T], n: usize) -> bool {
            x.iter().take(n).all(|v| *v == x[0])
        }
        same(self.theta_i, n) && same(self.h_um, n) && same(self.sigma_per_um, n)
    }
}
