//! The mean over the repeat at a query, and what its table sees of a fabric at a place.

use super::between::CLASSES;
use super::bsdf::FabricModel;
use super::far::{self, FarAt, Mixed, Places, Runs, Seen};
use super::query::{FabricQuery, GapLight};
use super::shadow::Toward;
use crate::gap::Opening;

impl FabricModel {
    /// The mean over the repeat where a query asks for it, seen from `wo` in the pattern's frame, and its
    /// share.
    pub(super) fn far_at<'a, const N: usize>(
        &'a self,
        query: &FabricQuery<'a, N>,
        wo: [f32; 3],
    ) -> Option<(FarAt<'a, N>, f32)> {
        let far = self.far.as_deref()?;
        let [x, y] = self.fabric.repeat_um();
        let share = far::share(query, wo, x.max(y))?;
        let mut sigma = [Mixed::NONE; 2];
        for (k, sigma) in sigma.iter_mut().enumerate() {
            match query.sigma_per_um[k] {
                Some(own) => sigma.add(1.0, own),
                None => self.color_shares[k].iter().for_each(|(color, share)| {
                    sigma.add(*share, self.dyes[*color as usize].at(query.lambda_um, query.channels));
                }),
            }
        }
        let plies = far.at(wo, [&sigma[0], &sigma[1]]);
        let firsts: [(usize, [f32; N]); CLASSES] = std::array::from_fn(|class| (class, plies.first[class]));
        let between = self.between.at(wo, &firsts, sigma.map(|s| s.sigma()), self.sent());
        let (passing, openings) = far.passing(wo);
        let is_diffracted = self.options.gaps == GapLight::Diffracted;
        let light = |opening: Opening| self.apertures.through(opening, wo, query.lambda_um);
        let gaps = openings.map(|opening| opening.filter(|_| is_diffracted).map(light));
        Some((FarAt::new(plies, between, passing, gaps), share))
    }
}

impl Places for FabricModel {
    fn kinds(&self) -> (usize, [Runs; 2]) {
        (2, far::WOVEN)
    }

    fn seen(&self, kind: usize, place: [f64; 2], turn: f64, wo: [f32; 3], lights: &[Toward]) -> Seen {
        let at = [0, 1].map(|k| {
            let repeat = self.fabric.repeat_um()[k];
            ((place[k] + (turn * (1.0 + 20_000.0 / repeat)).floor()) * repeat) as f32
        });
        let query =
            FabricQuery { sigma_per_um: [Some(far::SIGMA_PER_UM); 2], ..FabricQuery::new(at, wo, [0.55; far::SIGMAS]) };
        self.at(&query).seen(kind, lights)
    }
}
