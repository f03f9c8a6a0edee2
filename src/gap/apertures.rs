//! Rectangular apertures between yarns, evaluated at a query.
//!
//! The spectra of one axis are tabulated once, for edges in equal steps about the center of a beam. An
//! aperture has the exact factor of its own edges and is sampled from the nearest tabulated spectrum.

use super::{Axis, GapBsdf, Spectrum};
use crate::frame::{to_pattern, to_surface};
use crate::spec::GaussianBeam;
use std::f32::consts::FRAC_PI_2;

/// Number of equal steps from the beam's center to d_cut at which edges are tabulated. Apertures with edges
/// between them are sampled from the nearest ones.
pub(crate) const EDGES: usize = 32;
/// Narrowest aperture [um], a fraction of a wavelength. Narrower ones use its pattern, which spreads light in
/// all directions.
const MIN_APERTURE_UM: f32 = 0.1;
/// Number of rotation steps of openings in a right angle.
const TURNS: f32 = 256.0;

/// An aperture in terms of the tabulated spectra: the indices of the spectra of its two axes, and the
/// rotation of the axes from x and y in steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Opening(pub [u16; 3]);

impl Opening {
    /// Checks numbers read from a file; `None` if an index is out of range.
    pub fn new(numbers: [u32; 3]) -> Option<Opening> {
        let [x, y, steps] = numbers;
        let spectra = ((EDGES + 1) * (EDGES + 1)) as u32;
        let is_one = x.max(y) < spectra && steps < TURNS as u32;
        is_one.then_some(Opening(numbers.map(|n| n as u16)))
    }
}

/// Tabulated spectra of apertures in a beam.
#[derive(Clone, Debug)]
pub(crate) struct Apertures {
    /// `[before][beyond]`, [`EDGES`] + 1 each: spectra by the distances of the two edges along one axis.
    pub spectra: Vec<Spectrum>,
    /// Step of the distance of an edge [um].
    pub step_um: f32,
}

impl Apertures {
    pub fn new(beam: &GaussianBeam) -> Apertures {
        let step = beam.d_cut_um / EDGES as f64;
        let spectrum = |i: usize| {
            let (low, high) = (i / (EDGES + 1), i % (EDGES + 1));
            Spectrum::new(-step * low as f64, step * high as f64, beam.w0_um)
        };
        Apertures { spectra: (0..(EDGES + 1) * (EDGES + 1)).map(spectrum).collect(), step_um: step as f32 }
    }

    /// Distance beyond which an edge has no effect [um].
    pub fn reach_um(&self) -> f32 {
        EDGES as f32 * self.step_um
    }

    /// Index of the nearest tabulated spectrum with a width above 0, and the axis of an aperture whose edges
    /// lie this far before and beyond the beam's center [um].
    #[inline]
    fn axis(&self, before_um: f32, beyond_um: f32) -> (u16, Axis<'_>) {
        let padding = 0.5 * (MIN_APERTURE_UM - before_um - beyond_um).max(0.0);
        let [before, beyond] = [before_um, beyond_um].map(|x| (x + padding).min(self.reach_um()));
        let node = |x: f32| ((x / self.step_um + 0.5) as usize).min(EDGES);
        let nodes = match [node(before), node(beyond)] {
            [0, 0] if before > beyond => [1, 0],
            [0, 0] => [0, 1],
            nodes => nodes,
        };
        let number = nodes[0] * (EDGES + 1) + nodes[1];
        (number as u16, Axis::near(&self.spectra[number], before, beyond))
    }

    /// Light through the aperture with edges at these distances from the beam's center [um]: before and
    /// beyond it along the axis `turn` (cosine and sine of its angle from x, in [0, pi/2)), then along the
    /// perpendicular axis. `None` if no light passes.
    pub fn at<const N: usize>(
        &self,
        [before, beyond, below, above]: [f32; 4],
        turn: [f32; 2],
        wo: [f32; 3],
        lambda_um: [f32; N],
    ) -> Option<(Opening, GapAt<'_, N>)> {
        let [(x, of_x), (y, of_y)] = [self.axis(before, beyond), self.axis(below, above)];
        let gap = GapBsdf::new(of_x, of_y, to_pattern(turn, wo), lambda_um);
        let steps = (turn[1].atan2(turn[0]) * (TURNS / FRAC_PI_2)).clamp(0.0, TURNS - 1.0);
        (!gap.is_dark()).then_some((Opening([x, y, steps as u16]), GapAt { gap, turn }))
    }

    /// Light through an opening, with the tabulated edges.
    pub fn through<const N: usize>(
        &self,
        Opening([x, y, steps]): Opening,
        wo: [f32; 3],
        lambda_um: [f32; N],
    ) -> GapAt<'_, N> {
        let (sin, cos) = ((f32::from(steps) + 0.5) * (FRAC_PI_2 / TURNS)).sin_cos();
        let turn = if steps == 0 { [1.0, 0.0] } else { [cos, sin] };
        let axis = |number: u16| Axis::new(&self.spectra[usize::from(number)]);
        GapAt { gap: GapBsdf::new(axis(x), axis(y), to_pattern(turn, wo), lambda_um), turn }
    }

    pub fn memory_bytes(&self) -> usize {
        size_of_val(self.spectra.as_slice())
    }
}

/// Light through an aperture, in the frame of the cloth.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GapAt<'a, const N: usize> {
    gap: GapBsdf<'a, N>,
    /// Cosine and sine of the angle from x to the aperture's first axis.
    turn: [f32; 2],
}

impl<const N: usize> GapAt<'_, N> {
    /// As [`GapBsdf::conserved`].
    #[inline]
    pub fn conserved(&self, b: [f32; 3]) -> ([f32; N], f32) {
        self.gap.conserved(to_pattern(self.turn, b))
    }

    /// As [`GapBsdf::conserved_sample`].
    #[inline]
    pub fn conserved_sample(&self, u: [f32; 3]) -> Option<[f32; 3]> {
        Some(to_surface(self.turn, self.gap.conserved_sample(u)?))
    }
}
