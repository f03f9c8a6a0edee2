//! Scene of strands with a fiber's model and lights.

use super::{StrandHit, StrandShape, StrandTree, Strands};
use crate::light::Sources;
use crate::{Environment, Light, LightSampling, Prop, WAVELENGTHS};
use glam::{DVec3, Vec3};
use plywave::{FiberBsdf, FiberModel, FiberQuery};

/// Material of strands.
#[derive(Clone, Debug)]
pub struct StrandFiber {
    /// Scattering of one fiber.
    pub model: FiberModel,
    /// Absorption of its inside: wavelengths [um], ascending, and absorptions [1/um], linear in between and
    /// constant beyond; empty means 0. Tables ignore it.
    pub sigma: Vec<[f32; 2]>,
    /// Whether scattering depends on the ray's offset on the fiber; else each hit uses the mean over the
    /// offsets.
    pub near: bool,
}

impl StrandFiber {
    /// A clear fiber, or one with the table's color, without dependence on the offset.
    pub fn new(model: FiberModel) -> StrandFiber {
        StrandFiber { model, sigma: Vec::new(), near: false }
    }

    /// Radius of the model [um]: half the largest geometric width of a table's outline.
    pub fn radius_um(&self) -> f32 {
        match &self.model {
            FiberModel::Tabulated(fiber) => 0.5 * fiber.table().width_um.iter().copied().fold(0.0, f64::max) as f32,
            other => 0.5 * other.max_width_um(),
        }
    }

    /// Absorption at a wavelength [um].
    pub fn sigma_per_um(&self, lambda_um: f32) -> f32 {
        let next = self.sigma.partition_point(|node| node[0] < lambda_um);
        match (next.checked_sub(1).and_then(|k| self.sigma.get(k)), self.sigma.get(next)) {
            (Some(a), Some(b)) => a[1] + (b[1] - a[1]) * (lambda_um - a[0]) / (b[0] - a[0]).max(1e-9),
            (Some(only), None) | (None, Some(only)) => only[1],
            (None, None) => 0.0,
        }
    }
}

/// Strands of one kind of fiber, and their lights.
///
/// The strands' radius is the fiber's. If a table receives light over more than its geometric width (Xia
/// 2020, 6), strands are intersected with that larger width, and [`FiberBsdf::hit`] says, by wavelength,
/// whether a ray's offset is within the width C_e at its direction; else the ray passes. A strand whose
/// radius differs from the model's is the scaled model: the same shape of scattering, widths in proportion;
/// for analytic models the light's paths inside scale too.
pub struct StrandScene {
    tree: StrandTree,
    fiber: StrandFiber,
    /// Intersected width over the geometric one.
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
    /// Builds the BVH.
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

    /// Scene over a tree whose radii include the intersected width.
    pub fn over(tree: StrandTree, fiber: StrandFiber, lights: Vec<Light>, environment: Environment) -> StrandScene {
        let wider = wider(&fiber);
        let (props, sampling) = (Vec::new(), LightSampling::default());
        StrandScene { tree, fiber, wider, reference: Vec3::Z, lights, environment, props, sampling }
    }

    /// Lamps and sky.
    pub(super) fn sources(&self) -> Sources<'_> {
        Sources { lights: &self.lights, environment: &self.environment, sampling: self.sampling }
    }

    /// The strands, with their intersected width.
    pub fn tree(&self) -> &StrandTree {
        &self.tree
    }

    /// Their fiber.
    pub fn fiber(&self) -> &StrandFiber {
        &self.fiber
    }

    /// The fiber's scattering at a hit of a ray in `direction`, and whether each wavelength is hit.
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
        let met =
            if self.is_limited() { at.hit(hit.h_rel as f32 * self.wider * radius_um) } else { [true; WAVELENGTHS] };
        (at, met)
    }

    /// Whether each wavelength of a ray is hit at a hit.
    pub(super) fn met(&self, hit: &StrandHit, direction: DVec3, lambda_um: [f32; WAVELENGTHS]) -> [bool; WAVELENGTHS] {
        if !self.is_limited() {
            return [true; WAVELENGTHS];
        }
        self.at(hit, &hit.frame(self.reference), direction, lambda_um).1
    }

    /// Thickness, relative to the model's, of a strand of an intersected radius [mm].
    pub(super) fn larger(&self, radius_mm: f64) -> f32 {
        1000.0 * radius_mm as f32 / (self.wider * self.fiber.radius_um())
    }

    /// Absorption of the scaled model of a strand at a hit [1/um].
    pub(super) fn sigma(&self, hit: &StrandHit, lambda_um: [f32; WAVELENGTHS]) -> [f32; WAVELENGTHS] {
        let larger = self.larger(hit.radius_mm);
        lambda_um.map(|l| larger * self.fiber.sigma_per_um(l))
    }

    /// Whether rays may pass within the intersected width.
    pub(super) fn is_limited(&self) -> bool {
        matches!(self.fiber.model, FiberModel::Tabulated(_))
    }
}

/// Intersected width over the geometric one.
fn wider(fiber: &StrandFiber) -> f32 {
    0.5 * fiber.model.max_width_um() / fiber.radius_um()
}
