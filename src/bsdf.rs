//! The interface of every scattering model. A query fixes one direction and all other properties of a shading
//! point, and the model at that query is a [`Bsdf`].
//!
//! Directions are unit vectors that point away from the surface, ply or fiber. The query fixes one of the
//! two; the other is the argument `w` of each call:
//!
//! | | fixed by the query | `w` of `eval`, `pdf`, `sample` |
//! |---|---|---|
//! | ply, fiber, gap, as in the papers | `omega_i`: where the beam comes from | `omega_o`: where light goes |
//! | cloth in a path tracer from the camera | `wo`: towards the camera | `wi`: towards the light |
//!
//! docs/howto/host_rust.md lists the corresponding names in pbrt and Mitsuba.

/// A scattering function with its query fixed, for N absorptions or wavelengths at once.
///
/// `f` is an energy density [1/sr], the BSDF times the cosine of `w`; for a ply or fiber it is the papers'
/// energy density. Its integral over the sphere is the scattered fraction of the query's incident light. No
/// call fails, allocates or panics, for any input.
///
/// ```
/// use plywave::{Bsdf, BsdfSample};
///
/// /// One light path: what a path tracer does with any model.
/// fn bounce(bsdf: &impl Bsdf<3>, u: [f32; 3], throughput: &mut [f32; 3]) -> Option<[f32; 3]> {
///     match bsdf.sample(u) {
///         BsdfSample::Scattered(s) => {
///             (0..3).for_each(|k| throughput[k] *= s.weight[k]);
///             Some(s.w) // s.pdf weighs it against sampling the lights
///         }
///         BsdfSample::Straight { weight, .. } => {
///             (0..3).for_each(|k| throughput[k] *= weight[k]);
///             None // go on in the same direction
///         }
///         BsdfSample::Absorbed => {
///             *throughput = [0.0; 3];
///             None
///         }
///     }
/// }
/// ```
pub trait Bsdf<const N: usize> {
    /// f in direction `w` [1/sr]. Light that goes straight on is a delta function and is excluded.
    fn eval(&self, w: [f32; 3]) -> [f32; N];

    /// Density [1/sr] with which [`Bsdf::sample`] returns `w`; its integral is [`Outcomes::scattered`].
    fn pdf(&self, w: [f32; 3]) -> f32;

    /// [`Bsdf::eval`] and [`Bsdf::pdf`] in one call, for models that share their work.
    fn eval_pdf(&self, w: [f32; 3]) -> ([f32; N], f32) {
        (self.eval(w), self.pdf(w))
    }

    /// Samples the outcome of a light path from three independent uniform numbers in [0, 1).
    fn sample(&self, u: [f32; 3]) -> BsdfSample<N>;

    /// Integral of f over the sphere, one value for each absorption or wavelength.
    fn albedo(&self) -> [f32; N];

    /// Fraction of the light that goes straight on, unscattered, one value for each absorption or wavelength;
    /// 0 for most models.
    fn straight(&self) -> [f32; N] {
        [0.0; N]
    }

    /// Probabilities of the outcomes of [`Bsdf::sample`].
    fn outcomes(&self) -> Outcomes;

    /// [`Bsdf::eval`] and [`Bsdf::pdf`] in many directions. The shortest slice determines their number.
    fn eval_batch(&self, w: &[[f32; 3]], f: &mut [[f32; N]], pdf: &mut [f32]) {
        for ((w, f), pdf) in w.iter().zip(f).zip(pdf) {
            (*f, *pdf) = self.eval_pdf(*w);
        }
    }
}

/// Outcome of a sampled light path.
///
/// ```
/// use plywave::{Bsdf, BsdfSample, PlyModel, PlyQuery};
///
/// # fn main() -> plywave::Result<()> {
/// let model = PlyModel::load(concat!(env!("CARGO_MANIFEST_DIR"), "/fabrics/models/wool.pwm"))?;
/// // A beam that passes beside the ply, whose edge is left out, goes straight on.
/// let beside = model.at(&PlyQuery { edge: false, ..PlyQuery::new(0.0, 1e4, [0.01], [0.55]) });
/// assert_eq!(beside.sample([0.5; 3]), BsdfSample::Straight { weight: [1.0], probability: 1.0 });
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BsdfSample<const N: usize> {
    /// The light is scattered into a direction.
    Scattered(DirectionSample<N>),
    /// The light goes straight on, as if nothing were there: a delta function.
    Straight {
        /// [`Bsdf::straight`] divided by the probability, one value for each absorption or wavelength.
        weight: [f32; N],
        /// Probability of this outcome.
        probability: f32,
    },
    /// The path ends here.
    Absorbed,
}

/// A sampled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionSample<const N: usize> {
    /// Sampled direction, unit.
    pub w: [f32; 3],
    /// f / pdf, one value for each absorption or wavelength.
    pub weight: [f32; N],
    /// Density of the direction [1/sr], including the probability of being scattered.
    pub pdf: f32,
}

/// Probabilities of the variants of [`BsdfSample`]; they sum to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcomes {
    /// Probability of [`BsdfSample::Scattered`].
    pub scattered: f32,
    /// Probability of [`BsdfSample::Straight`].
    pub straight: f32,
    /// Probability of [`BsdfSample::Absorbed`].
    pub absorbed: f32,
}

impl Outcomes {
    /// All light is absorbed.
    pub const ABSORBED: Outcomes = Outcomes { scattered: 0.0, straight: 0.0, absorbed: 1.0 };
    /// All light is scattered.
    pub const SCATTERED: Outcomes = Outcomes { scattered: 1.0, straight: 0.0, absorbed: 0.0 };

    /// Probabilities of scattered and of straight light in proportion to these energies. If both are 0, the
    /// light is absorbed.
    pub fn in_proportion(scattered: f32, straight: f32) -> Outcomes {
        let total = scattered + straight;
        if total > 0.0 {
            let straight = straight / total;
            Outcomes { scattered: 1.0 - straight, straight, absorbed: 0.0 }
        } else {
            Outcomes::ABSORBED
        }
    }
}

impl<const N: usize> BsdfSample<N> {
    /// The direction of scattered light; `None` for other outcomes.
    pub fn direction(&self) -> Option<&DirectionSample<N>> {
        match self {
            BsdfSample::Scattered(sample) => Some(sample),
            _ => None,
        }
    }

    /// The sample of a direction with f and pdf there. If `pdf` is 0, the weight is 0.
    pub fn scattered(w: [f32; 3], f: [f32; N], pdf: f32) -> Self {
        let mut weight = [0.0; N];
        if pdf > 0.0 {
            for k in 0..N {
                weight[k] = f[k] / pdf;
            }
        }
        BsdfSample::Scattered(DirectionSample { w, weight, pdf })
    }

    /// The sample of straight light of this energy, chosen with this probability; absorbed if that is 0.
    pub fn straight(energy: [f32; N], probability: f32) -> Self {
        if probability > 0.0 {
            BsdfSample::Straight { weight: energy.map(|e| e / probability), probability }
        } else {
            BsdfSample::Absorbed
        }
    }
}
