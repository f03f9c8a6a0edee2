//! Batches of queries, stored as one array for each quantity.

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

impl<'a, const N: usize> Queries<'a, N> {
    /// The same queries with the number of absorptions as a value instead of a type parameter.
    #[inline]
    pub(super) fn channels(&self) -> Channels<'a> {
        let Queries { theta_i, h_um, sigma_per_um, wo } = *self;
        Channels { theta_i, h_um, sigma: sigma_per_um.as_flattened(), count: N, wo }
    }
}

/// [`Queries`] with `count` absorptions each.
#[derive(Clone, Copy)]
pub(super) struct Channels<'a> {
    pub(super) theta_i: &'a [f32],
    pub(super) h_um: &'a [f32],
    /// `[query][absorption]`, flat.
    pub(super) sigma: &'a [f32],
    pub(super) count: usize,
    pub(super) wo: [&'a [f32]; 3],
}

impl<'a> Channels<'a> {
    /// Query `i`; `None` beyond the end of the shortest array.
    #[inline(always)]
    pub(super) fn get(&self, i: usize) -> Option<(f32, f32, &'a [f32], [f32; 3])> {
        let wo = [*self.wo[0].get(i)?, *self.wo[1].get(i)?, *self.wo[2].get(i)?];
        Some((*self.theta_i.get(i)?, *self.h_um.get(i)?, self.sigma(i)?, wo))
    }

    /// Absorptions of query `i`.
    #[inline(always)]
    pub(super) fn sigma(&self, i: usize) -> Option<&'a [f32]> {
        self.sigma.get(i * self.count..(i + 1) * self.count)
    }

    /// The queries from index `at` on.
    #[inline(always)]
    pub(super) fn from(&self, at: usize) -> Self {
        let after = |x: &'a [f32], at: usize| x.get(at..).unwrap_or(&[]);
        Channels {
            theta_i: after(self.theta_i, at),
            h_um: after(self.h_um, at),
            sigma: after(self.sigma, at * self.count),
            count: self.count,
            wo: self.wo.map(|x| after(x, at)),
        }
    }

    /// Whether the first `n` queries have the same incidence and absorptions.
    #[inline(always)]
    pub(super) fn one_incidence(&self, n: usize) -> bool {
        let same = |x: &[f32]| x.iter().take(n).all(|v| *v == x[0]);
        let sigma = self.sigma.get(..self.count).unwrap_or(&[]);
        same(self.theta_i)
            && same(self.h_um)
            && (sigma.is_empty() || self.sigma.chunks_exact(self.count).take(n).all(|s| s == sigma))
    }
}
