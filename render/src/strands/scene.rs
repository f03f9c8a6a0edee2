//! A scene of strands: one kind of fiber on a tree of strands, lamps, sky and props.

use super::{StrandHit, StrandShape, StrandTree, Strands};
use crate::light::Sources;
use crate::{Environment, Light, LightSampling, Prop, WAVELENGTHS};
use glam::{DVec3, Vec3};
use plywave_fiber::{FiberBsdf, FiberModel, FiberQuery};

/// Material of strands.
#[derive(Clone, Debug)]
pub struct StrandFiber {
    /// Scattering model of one fiber.
    pub model: FiberModel,
    /// Absorption of the fiber's interior: pairs of wavelength [um], ascending, and absorption [1/um], linear
    /// in between and constant beyond; empty means 0. Fiber tables ignore it.
    pub sigma: Vec<[f32; 2]>,
    /// Whether scattering depends on the ray's offset on the fiber; otherwise each hit uses the mean over
    /// offsets.
    pub near: bool,
}

impl StrandFiber {
    /// A fiber without absorption, or with a table's own, whose hits use the mean over offsets.
    pub fn new(model: FiberModel) -> StrandFiber {
        StrandFiber { model, sigma: Vec::new(), near: false }
    }

    /// Radius of the model [um]; for a table, half the largest geometric width of its outline.
    pub fn radius_um(&self) -> f32 {
        match &self.model {
            FiberModel::Tabulated(fiber) => 0.5 * fiber.table().width_um.iter().copied().fold(0.0, f64::max) as f32,
            other => 0.5 * other.max_width_um(),
        }
    }

    /// Absorption [1/um] at a wavelength [um].
    pub fn sigma_per_um(&self, lambda_um: f32) -> f32 {
        let next = self.sigma.partition_point(|node| node[0] < lambda_um);
        match (next.checked_sub(1).and_then(|k| self.sigma.get(k)), self.sigma.get(next)) {
            (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * (lambda_um - a[0]) / (b[0] - a[0]).max(1e-9),
            (Some(only), None) | (None, Some(only)) => only[1],
            (None, None) => 0.0,
        }
    }
}

/// Strands of one kind of fiber, and their light sources.
///
/// The strands' radius is that of the fiber. If a table receives light over more than its geometric width
/// (Xia 2020, 6), strands are intersected with that larger width, and [`FiberBsdf::hit`] tells, by
/// wavelength, whether the ray's offset is within the width C_e at its direction; otherwise the ray passes. A
/// strand whose radius differs from the model's is a scaled copy: it has the same angular scattering and
/// proportional widths; for analytic models the path lengths inside scale too.
pub struct StrandScene {
    tree: StrandTree,
    fiber: StrandFiber,
    /// Ratio of the intersected width to the geometric width.
    wider: f32,
    /// Reference axis across the fiber for the orientation of outlines.
    pub reference: Vec3,
    /// Rectangular lamps.
    pub lights: Vec<Light>,
    /// Light from infinitely far.
    pub environment: Environment,
    /// Matte props beside the strands.
    pub props: Vec<Prop>,
    /// Sampling of light.
    pub sampling: LightSampling,
}

impl StrandScene {
    /// Builds the BVH over the strands.
    pub fn new(
        mut strands: Strands,
        shape: StrandShape,
        fiber: StrandFiber,
        lights: Vec<Light>,
        environment: Environment,
    ) -> StrandScene {
        let wider = wider(&fiber);
        strands.scale_radii(wider);
        StrandScene::over(StrandTree::new(strands, shape), fiber, lights, environment)
    }

    /// A scene over a tree whose radii already include the intersected width.
    pub fn over(tree: StrandTree, fiber: StrandFiber, lights: Vec<Light>, environment: Environment) -> StrandScene {
        let wider = wider(&fiber);
        let (props, sampling) = (Vec::new(), LightSampling::default());
        StrandScene { tree, fiber, wider, reference: Vec3::Z, lights, environment, props, sampling }
    }

    /// Lamps and sky as light sources.
    pub(super) fn sources(&self) -> Sources<'_> {
        Sources { lights: &self.lights, environment: &self.environment, sampling: self.sampling }
    }

    /// The strands, with their intersected radii.
    pub fn tree(&self) -> &StrandTree {
        &self.tree
    }

    /// The fiber of all strands.
    pub fn fiber(&self) -> &StrandFiber {
        &self.fiber
    }

    /// The fiber's scattering function at a hit of a ray in `direction`, and whether the ray hits at each
    /// wavelength.
    pub(super) fn at(
        &self,
        hit: &StrandHit,
        frame: &[DVec3; 3],
        direction: DVec3,
        lambda_um: [f32; WAVELENGTHS],
    ) -> (FiberBsdf<'_, WAVELENGTHS>, [bool; WAVELENGTHS]) {
        let radius_um = self.fiber.radius_um();
        let query = FiberQuery {
            omega_i: frame.map(|axis| -axis.dot(direction) as f32),
            h_rel: self.fiber.near.then_some(hit.h_rel as f32),
            lambda_um,
            sigma_per_um: self.sigma(hit, lambda_um),
        };
        let at = self.fiber.model.at(&query);
        let hits =
            if self.is_limited() { at.hit(hit.h_rel as f32 * self.wider * radius_um) } else { [true; WAVELENGTHS] };
        (at, hits)
    }

    /// Whether a ray hits the strand at each wavelength.
    pub(super) fn is_hit(
        &self,
        hit: &StrandHit,
        direction: DVec3,
        lambda_um: [f32; WAVELENGTHS],
    ) -> [bool; WAVELENGTHS] {
        if !self.is_limited() {
            return [true; WAVELENGTHS];
        }
        self.at(hit, &hit.frame(self.reference), direction, lambda_um).1
    }

    /// Thickness relative to the model's of a strand with an intersected radius [mm].
    pub(super) fn larger(&self, radius_mm: f64) -> f32 {
        1000.0 * radius_mm as f32 / (self.wider * self.fiber.radius_um())
    }

    /// Absorption of the scaled model at a hit [1/um], by wavelength.
    pub(super) fn sigma(&self, hit: &StrandHit, lambda_um: [f32; WAVELENGTHS]) -> [f32; WAVELENGTHS] {
        let larger = self.larger(hit.radius_mm);
        lambda_um.map(|l| larger * self.fiber.sigma_per_um(l))
    }

    /// Whether rays may pass through the intersected width at some wavelengths.
    pub(super) fn is_limited(&self) -> bool {
        matches!(self.fiber.model, FiberModel::Tabulated(_))
    }
}

/// Ratio of the intersected width to the geometric width.
fn wider(fiber: &StrandFiber) -> f32 {
    0.5 * fiber.model.max_width_um() / fiber.radius_um()
}
