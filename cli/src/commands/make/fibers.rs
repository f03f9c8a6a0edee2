//! The explicit fibers of a cloth for the reference host.

use crate::args::Cli;
use crate::commands::runs;
use crate::failure::Outcome;
use crate::threads::on_threads;
use plywave::ClothModel;
use plywave::cloth::ClothData;
use plywave_render::{Exit, ExplicitFibers, Lamps, PathNumbers, WAVELENGTHS};
use plywave_sim::twin::{ClothTracer, LightsOfFibers, ThreadOfFiber, TwinCurves, TwinMesh};
use plywave_textile::ClothSpec;
use std::path::Path;

/// The explicit fibers of a cloth, periodic in its plane, with the absorption of its yarns. For uneven yarns,
/// a path hits the even fibers that appear at its point.
pub struct Fibers {
    pub tracer: ClothTracer,
    pub cloth: ClothModel,
}

/// The fibers of some repeats of a cloth.
pub fn tracer(cli: &Cli, data: &ClothData, file: &Path, seed: u64) -> Outcome<ClothTracer> {
    let specs = data.models.iter().map(|model| model.data().spec_text.clone()).collect();
    let made = on_threads(cli, || {
        let hairs = ClothSpec::parse(&data.spec_text, &file.display().to_string())?.hairs();
        let cloth = TwinCurves::new(&data.name, data.curves.clone(), specs)?.with_hairs(hairs);
        ClothTracer::of_cloth(&cloth, None, &TwinMesh::default(), seed)
    })?;
    made.map_err(|error| runs::failure(error, file))
}

/// The lamps of the scene for a path among fibers, and the absorption along the path.
struct Lit<'a, 'b> {
    cloth: &'a ClothModel,
    lambda_um: [f32; WAVELENGTHS],
    lamps: &'a mut Lamps<'b>,
    /// Optical depth so far.
    depth: [f32; WAVELENGTHS],
}

impl Lit<'_, '_> {
    /// Optical depth after a further length in a fiber.
    fn with(&self, thread: &ThreadOfFiber, length_um: f32) -> [f32; WAVELENGTHS] {
        if length_um <= 0.0 {
            return self.depth;
        }
        let sigma = self.cloth.yarn_sigma_per_um(thread.family as usize, thread.number, self.lambda_um);
        std::array::from_fn(|k| self.depth[k] + length_um * sigma[k])
    }
}

impl LightsOfFibers<PathNumbers> for Lit<'_, '_> {
    fn passes(&mut self, thread: &ThreadOfFiber, inside_um: f32) {
        self.depth = self.with(thread, inside_um);
    }

    fn draw(&mut self, place_um: [f32; 3], rng: &mut PathNumbers) -> Option<[f32; 3]> {
        self.lamps.draw(place_um, rng)
    }

    fn reached(&mut self, thread: &ThreadOfFiber, left_um: [f32; 3], density: f32, length_um: f32) {
        self.lamps.add(left_um, self.with(thread, length_um).map(|depth| density * (-depth).exp()));
    }
}

impl ExplicitFibers for Fibers {
    fn follow(
        &self,
        uv_um: [f32; 2],
        w: [f32; 3],
        lambda_um: [f32; WAVELENGTHS],
        rng: &mut PathNumbers,
        lamps: &mut Lamps<'_>,
    ) -> Option<Exit> {
        let mut lit = Lit { cloth: &self.cloth, lambda_um, lamps, depth: [0.0; WAVELENGTHS] };
        let left = self.tracer.follow(self.cloth.even_place(uv_um), w, rng, &mut lit)?;
        let weight = lit.depth.map(|depth| (-depth).exp());
        Some(Exit { offset_um: left.offset_um, w: left.w, weight, was_drawn: left.is_rough })
    }
}
