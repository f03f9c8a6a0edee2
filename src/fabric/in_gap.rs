//! Where a line meets no ply (Yu 2025, 7.1, case c): the light that the plies beside it catch, and the light through the aperture between them.

use crate::bsdf::Outcomes;
use crate::gap::GapBsdf;
use crate::math::clamp_unit;
use crate::ply::{LobeSample, UncachedPly};
use crate::{Bsdf, BsdfSample};

/// What light through the gaps does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GapLight {
    /// It is diffracted by the aperture.
    #[default]
    Diffracted,
    /// It goes straight on, as rays do: for comparison. [`Bsdf::straight`] is its energy.
    Straight,
}

/// A direction of the fabric's frame in that of a ply.
pub(super) fn to_ply(frame: &[[f32; 3]; 3], w: [f32; 3]) -> [f32; 3] {
    frame.map(|a| a[0] * w[0] + a[1] * w[1] + a[2] * w[2])
}

/// A direction of a ply's frame in that of the fabric.
pub(super) fn to_fabric(frame: &[[f32; 3]; 3], w: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|k| frame[0][k] * w[0] + frame[1][k] * w[1] + frame[2][k] * w[2])
}

/// A direction of the surface's frame in that of the pattern, turned by an angle of this cosine and sine.
pub(super) fn to_pattern([c, s]: [f32; 2], w: [f32; 3]) -> [f32; 3] {
    [c * w[0] + s * w[1], c * w[1] - s * w[0], w[2]]
}

/// The inverse of [`to_pattern`].
pub(super) fn to_surface([c, s]: [f32; 2], w: [f32; 3]) -> [f32; 3] {
    to_pattern([c, -s], w)
}

/// A ply beside a gap: what its fibers scatter of the beam.
#[derive(Clone, Copy, Debug)]
pub(super) struct Near<'a, const N: usize> {
    ply: UncachedPly<'a, N>,
    frame: [[f32; 3]; 3],
    /// 1 - r_d.
    caught: f32,
    energy: [f32; N],
    mean: f32,
    /// Chance that the ply's lobes give a direction.
    hit: f32,
}

impl<'a, const N: usize> Near<'a, N> {
    pub(super) fn new(ply: UncachedPly<'a, N>, frame: [[f32; 3]; 3]) -> Self {
        let (energy, r_d) = ply.albedo_r_d();
        let mean = energy.iter().sum::<f32>() / N.max(1) as f32;
        let hit = if mean > 0.0 { mean / (mean + r_d) } else { 0.0 };
        Near { ply, frame, caught: (1.0 - r_d).max(0.0), energy, mean, hit }
    }

    fn eval(&self, wo: [f32; 3]) -> [f32; N] {
        self.ply.eval_lobes(to_ply(&self.frame, wo))
    }

    /// Density of the lobes alone.
    fn pdf(&self, wo: [f32; 3]) -> f32 {
        if self.hit > 0.0 { self.ply.pdf_lobes(to_ply(&self.frame, wo)) / self.hit } else { 0.0 }
    }

    /// f and the density of the lobes alone.
    fn eval_pdf(&self, wo: [f32; 3]) -> ([f32; N], f32) {
        let (f, pdf) = self.ply.eval_pdf_lobes(to_ply(&self.frame, wo));
        (f, if self.hit > 0.0 { pdf / self.hit } else { 0.0 })
    }

    /// A direction of the lobes alone, with [`Near::eval_pdf`] there.
    fn sample(&self, u: [f32; 3]) -> Option<LobeSample<N>> {
        let first = (u[0] * self.hit).min(self.hit * (1.0 - 1e-6));
        let (wo, (f, pdf)) = self.ply.sample_lobes([first, u[1], u[2]])?;
        Some((to_fabric(&self.frame, wo), (f, pdf / self.hit)))
    }
}

/// In a gap.
#[derive(Clone, Copy, Debug)]
pub(super) struct InGap<'a, const N: usize> {
    near: [Option<Near<'a, N>>; 4],
    /// Factor on the plies' light.
    scale: f32,
    /// Energy that goes through the aperture.
    through: f32,
    gap: GapBsdf<'a, N>,
    /// Cosine and sine of the pattern's turn: the aperture's frame in the surface's.
    turn: [f32; 2],
    straight: bool,
    /// Chances of the four plies and of the aperture; the rest of 1 goes straight on.
    chances: [f32; 5],
}

impl<'a, const N: usize> InGap<'a, N> {
    pub(super) fn new(near: [Option<Near<'a, N>>; 4], gap: GapBsdf<'a, N>, gaps: GapLight, turn: [f32; 2]) -> Self {
        let caught: f32 = near.iter().flatten().map(|n| n.caught).sum();
        let (scale, through) = (if caught > 1.0 { 1.0 / caught } else { 1.0 }, (1.0 - caught).max(0.0));
        // An aperture that is closed at the precision of the spectra lets its light pass straight on too.
        let straight = gaps == GapLight::Straight || gap.is_dark();
        let mut chances = [0.0; 5];
        for (chance, ply) in chances.iter_mut().zip(&near) {
            *chance = ply.map_or(0.0, |p| scale * p.mean);
        }
        let total: f32 = chances.iter().sum::<f32>() + through;
        chances[4] = if straight { 0.0 } else { through };
        if total > 0.0 {
            chances.iter_mut().for_each(|c| *c /= total);
        }
        InGap { near, scale, through, gap, turn, straight, chances }
    }

    /// The light of the aperture.
    fn aperture(&self, wo: [f32; 3]) -> [f32; N] {
        if self.straight { [0.0; N] } else { self.gap.eval(to_pattern(self.turn, wo)).map(|g| self.through * g) }
    }

    /// The density of the aperture's samples, with their chance.
    fn aperture_pdf(&self, wo: [f32; 3]) -> f32 {
        if self.chances[4] > 0.0 { self.chances[4] * self.gap.pdf(to_pattern(self.turn, wo)) } else { 0.0 }
    }

    fn sum(&self, wo: [f32; 3]) -> [f32; N] {
        let mut f = self.aperture(wo);
        for ply in self.near.iter().flatten() {
            let part = ply.eval(wo);
            for k in 0..N {
                f[k] += self.scale * part[k];
            }
        }
        f
    }

    fn density(&self, wo: [f32; 3]) -> f32 {
        let mut pdf = self.aperture_pdf(wo);
        for (ply, chance) in self.near.iter().zip(&self.chances) {
            if let Some(ply) = ply {
                pdf += chance * ply.pdf(wo);
            }
        }
        pdf
    }

    /// f and density; those of a ply that is known by its number need not be asked for.
    fn sum_density(&self, wo: [f32; 3], known: Option<(usize, ([f32; N], f32))>) -> ([f32; N], f32) {
        let (mut f, mut pdf) = (self.aperture(wo), self.aperture_pdf(wo));
        for (i, (ply, chance)) in self.near.iter().zip(&self.chances).enumerate() {
            if let Some(ply) = ply {
                let (part, density) = match known {
                    Some((known, drawn)) if known == i => drawn,
                    _ => ply.eval_pdf(wo),
                };
                for k in 0..N {
                    f[k] += self.scale * part[k];
                }
                pdf += chance * density;
            }
        }
        (f, pdf)
    }

    /// A direction, f and density there.
    fn draw(&self, u: [f32; 3]) -> Option<LobeSample<N>> {
        let mut remaining = u[0];
        for (i, (ply, chance)) in self.near.iter().zip(&self.chances).enumerate() {
            if let Some(ply) = ply {
                if remaining < *chance {
                    let (wo, drawn) = ply.sample([remaining / chance, u[1], u[2]])?;
                    return Some((wo, self.sum_density(wo, Some((i, drawn)))));
                }
                remaining -= chance;
            }
        }
        let chance = self.chances[4];
        if remaining < chance {
            let wo = to_surface(self.turn, self.gap.direction([remaining / chance, u[1], u[2]])?);
            Some((wo, self.sum_density(wo, None)))
        } else {
            None
        }
    }
}

impl<const N: usize> Bsdf<N> for InGap<'_, N> {
    fn eval(&self, w: [f32; 3]) -> [f32; N] {
        self.sum(w)
    }

    fn pdf(&self, w: [f32; 3]) -> f32 {
        self.density(w)
    }

    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        self.sum_density(w, None)
    }

    fn sample(&self, u: [f32; 3]) -> BsdfSample<N> {
        let u = u.map(clamp_unit);
        match self.draw(u) {
            Some((w, (f, pdf))) => BsdfSample::scattered(w, f, pdf),
            None => BsdfSample::straight(self.straight(), self.outcomes().straight),
        }
    }

    /// The light that the plies scatter or that the aperture diffracts. Of the latter all is counted: its integral is 1 to 2 % from 10 um on and to tilts of
    /// 1 rad, less in narrower apertures and where light grazes (0.6 at least from 2 um on), and never above 1.005.
    fn albedo(&self) -> [f32; N] {
        let mut albedo = if self.straight { [0.0; N] } else { [self.through; N] };
        for ply in self.near.iter().flatten() {
            for k in 0..N {
                albedo[k] += self.scale * ply.energy[k];
            }
        }
        albedo
    }

    fn straight(&self) -> [f32; N] {
        if self.straight { [self.through; N] } else { [0.0; N] }
    }

    fn outcomes(&self) -> Outcomes {
        let scattered = self.chances.iter().sum::<f32>();
        if scattered <= 0.0 && self.through <= 0.0 {
            return Outcomes::ABSORBED;
        }
        let rest = (1.0 - scattered).max(0.0);
        let (straight, absorbed) = if self.straight { (rest, 0.0) } else { (0.0, rest) };
        Outcomes { scattered, straight, absorbed }
    }
}
