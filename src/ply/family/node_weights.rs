//! Interpolation of parameters in a family: the nodes around them, their weights, and the nodes that r_d is
//! read from.

use super::data::{FamilyAxis, FamilyData, FamilyParam, FamilyParams};
use super::num::Real;
use crate::math::axis;
use crate::ply::PlyEnergies;
use crate::ply::data::energies::coefficient;
use crate::spec::YarnSpec;
use std::f64::consts::TAU;

/// Maximum number of corners of a cell.
pub(super) const CORNERS: usize = 8;

/// The axes in the coordinates in which models are linear, and the spec's values of the parameters that are
/// not axes.
#[derive(Clone, Debug)]
pub(super) struct Axes {
    /// In the order of [`FamilyParam::ALL`]: nodes and their coordinates, both in ascending order of the
    /// parameter; empty for a parameter that is not an axis.
    values: [Vec<f64>; 3],
    coordinates: [Vec<f64>; 3],
    usual: [f64; 3],
    radius_um: f64,
}

/// Corners with their weights, and the two nodes along pitch.
pub(super) struct NodeWeights<T> {
    pub(super) corners: [(usize, T); CORNERS],
    pub(super) count: usize,
    pub(super) pitch: Pitch<T>,
}

/// The nodes of r_d: the indices of their models, their weights, and their pitches divided by the requested
/// pitch.
#[derive(Clone, Copy)]
pub(super) struct Pitch<T> {
    pub(super) nodes: [(usize, T, T); 2],
    pub(super) count: usize,
}

impl Axes {
    pub(super) fn new(data: &FamilyData, spec: &YarnSpec) -> Axes {
        let radius_um = spec.ply_ring().radius_um;
        let of = |p: FamilyParam| data.values(p).map(<[f64]>::to_vec).unwrap_or_default();
        let values = FamilyParam::ALL.map(of);
        let coordinates =
            std::array::from_fn(|i| values[i].iter().map(|v| coordinate(FamilyParam::ALL[i], *v, radius_um)).collect());
        let usual = FamilyParam::ALL.map(|p| FamilyParams::from_spec(spec).get(p));
        Axes { values, coordinates, usual, radius_um }
    }

    /// A parameter clamped to its range; the spec's value if it is not an axis or is NaN.
    pub(super) fn within(&self, i: usize, value: f64) -> f64 {
        match (self.values[i].first(), self.values[i].last()) {
            (Some(first), Some(last)) => {
                let value = if value.is_nan() { self.usual[i] } else { value };
                value.clamp(*first, *last)
            }
            _ => self.usual[i],
        }
    }

    /// The range of a parameter; `None` if it is not an axis.
    pub(super) fn range(&self, i: usize) -> Option<[f64; 2]> {
        Some([*self.values[i].first()?, *self.values[i].last()?])
    }

    /// The spec's value of a parameter, which is required if it is not an axis.
    pub(super) fn usual(&self, i: usize) -> f64 {
        self.usual[i]
    }

    /// Weights of the nodes around parameters within their ranges.
    pub(super) fn place<T: Real>(&self, params: [T; 3]) -> NodeWeights<T> {
        let mut corners = [(0, T::from_f64(0.0)); CORNERS];
        corners[0].1 = T::from_f64(1.0);
        let mut count = 1;
        let mut pitch = Pitch { nodes: [(0, T::from_f64(1.0), T::from_f64(1.0)); 2], count: 1 };
        for i in 0..3 {
            let (values, x) = (&self.values[i], &self.coordinates[i]);
            if values.is_empty() {
                continue;
            }
            let low = values.iter().rposition(|v| *v <= params[i].value()).unwrap_or(0).min(values.len() - 2);
            let at = coordinate_of(FamilyParam::ALL[i], params[i], self.radius_um);
            let t = ((at - T::from_f64(x[low])) / T::from_f64(x[low + 1] - x[low])).within(0.0, 1.0);
            let rest = T::from_f64(1.0) - t;
            if i == 0 {
                let share = |k: usize| T::from_f64(values[k]) / params[0];
                pitch = Pitch { nodes: [(low, rest, share(low)), (low + 1, t, share(low + 1))], count: 2 };
            }
            for c in (0..count).rev() {
                let (node, weight) = corners[c];
                let node = node * values.len() + low;
                corners[2 * c + 1] = (node + 1, weight * t);
                corners[2 * c] = (node, weight * rest);
            }
            count *= 2;
        }
        // A parameter that is not an axis has the stride 1. Pitch is the slowest axis, so the product of all
        // others separates its nodes.
        let stride: usize = self.values[1..].iter().map(|v| v.len().max(1)).product();
        pitch.nodes.iter_mut().for_each(|n| n.0 *= stride);
        NodeWeights { corners, count, pitch }
    }
}

/// The coordinate in which models are interpolated, generic over the number type.
fn coordinate_of<T: Real>(param: FamilyParam, value: T, radius_um: f64) -> T {
    match param {
        FamilyParam::FiberPitch => (T::from_f64(TAU * radius_um) / value).atan(),
        FamilyParam::Alpha | FamilyParam::Eta => value,
    }
}

/// The coordinate of a value of an axis.
pub(super) fn coordinate(param: FamilyParam, value: f64, radius_um: f64) -> f64 {
    coordinate_of(param, value, radius_um)
}

impl FamilyParam {
    /// The coordinate in which models of plies of this radius [um] are linear (see the module).
    pub fn coordinate(self, value: f64, radius_um: f64) -> f64 {
        coordinate(self, value, radius_um)
    }

    /// The parameter's value at a coordinate.
    pub fn of_coordinate(self, x: f64, radius_um: f64) -> f64 {
        match self {
            FamilyParam::FiberPitch => TAU * radius_um / x.tan(),
            FamilyParam::Alpha | FamilyParam::Eta => x,
        }
    }
}

impl FamilyAxis {
    /// The nodes around a value within the axis: the index of the lower one, and the weight of the upper one.
    pub fn locate(&self, value: f64, radius_um: f64) -> (usize, f64) {
        let low = self.values.iter().rposition(|v| *v <= value).unwrap_or(0).min(self.values.len() - 2);
        let at = |v: f64| coordinate(self.param, v, radius_um);
        let (a, b) = (at(self.values[low]), at(self.values[low + 1]));
        (low, ((at(value) - a) / (b - a)).clamp(0.0, 1.0))
    }
}

/// Coefficient (m, n) of r_d at a pitch, from the energies `of(node)`. Rows are read where
/// `tan(theta) / pitch` is the same, by a Catmull-Rom cubic over the rows, and the result is clamped to [0,
/// 1]. m and n may be one before the first or one after the last.
pub(super) fn missed<'a, T: Real>(pitch: &Pitch<T>, of: &dyn Fn(usize) -> &'a PlyEnergies, m: isize, n: isize) -> T {
    let first = of(pitch.nodes[0].0);
    let sizes = [first.miss_theta_i.len(), first.miss_h_um.len()];
    // Beyond the ends the coefficients are extrapolated, as for any spline here.
    if m < 0 {
        return missed(pitch, of, -m, sizes[1] as isize - 1 - n);
    }
    if m as usize >= sizes[0] {
        let row = |m: usize| missed(pitch, of, m as isize, n);
        return T::from_f64(2.0) * row(sizes[0] - 1) - row(sizes[0] - 2);
    }
    let last = (sizes[0] - 1) as f64;
    let theta = first.miss_theta_i[m as usize];
    let row_of =
        |share: T| (T::from_f64(theta.tan()) * share).atan() * T::from_f64(last / first.miss_theta_i[sizes[0] - 1]);
    let mut sum = T::from_f64(0.0);
    // A node of a longer pitch may be read beyond its last latitude, a node of a shorter pitch never. Beyond
    // that latitude the shorter one replaces both. Nodes are in ascending order of pitch.
    let mut before = T::from_f64(0.0);
    for (i, &(node, weight, share)) in pitch.nodes[..pitch.count].iter().enumerate().rev() {
        let c = &of(node).miss;
        let at = |m: isize| coefficient(sizes, m, n, &|m, n| c[m * sizes[1] + n]);
        let row = row_of(share);
        let in_range = if i == 0 {
            T::from_f64(1.0)
        } else {
            (T::from_f64(1.0) - (row - T::from_f64(last)) / T::from_f64(HAND_OVER * last)).within(0.0, 1.0)
        };
        let weight = weight + before;
        before = weight * (T::from_f64(1.0) - in_range);
        let row = row.within(0.0, last);
        let low = (row.value() as usize).min(sizes[0] - 2);
        let f = row.value() - low as f64;
        let rows: [f64; 4] = std::array::from_fn(|i| at(low as isize + i as isize - 1));
        let value: f64 = catmull_rom(f).iter().zip(rows).map(|(w, r)| w * r).sum();
        let slope: f64 = catmull_rom_slope(f).iter().zip(rows).map(|(w, r)| w * r).sum();
        sum = sum + weight * in_range * row.chain(value, slope);
    }
    sum.within(0.0, 1.0)
}

/// Fraction of the latitudes, beyond the last, over which the weight of one node passes to the other.
const HAND_OVER: f64 = 0.02;

/// Catmull-Rom weights of nodes i-1..=i+2 at fraction `f` of cell `i`.
fn catmull_rom(f: f64) -> [f64; 4] {
    let (f2, f3) = (f * f, f * f * f);
    [0.5 * (2.0 * f2 - f3 - f), 0.5 * (3.0 * f3 - 5.0 * f2 + 2.0), 0.5 * (4.0 * f2 - 3.0 * f3 + f), 0.5 * (f3 - f2)]
}

/// Derivatives of [`catmull_rom`] by the fraction.
fn catmull_rom_slope(f: f64) -> [f64; 4] {
    let f2 = f * f;
    [
        0.5 * (-3.0 * f2 + 4.0 * f - 1.0),
        0.5 * (9.0 * f2 - 10.0 * f),
        0.5 * (-9.0 * f2 + 8.0 * f + 1.0),
        0.5 * (3.0 * f2 - 2.0 * f),
    ]
}

/// Nodes and weights of the Catmull-Rom cubic at `x` on an axis. A node beyond the end is extrapolated
/// linearly.
pub(super) fn cubic_taps(nodes: &[f64], x: f64) -> [(usize, f64); 4] {
    let (k, f) = axis::locate(x, nodes);
    let mut w = catmull_rom(f);
    let mut at = [k, k, k + 1, k + 1];
    if k == 0 {
        (w[1], w[2], w[0]) = (w[1] + 2.0 * w[0], w[2] - w[0], 0.0);
    } else {
        at[0] = k - 1;
    }
    if k + 2 >= nodes.len() {
        (w[2], w[1], w[3]) = (w[2] + 2.0 * w[3], w[1] - w[3], 0.0);
    } else {
        at[3] = k + 2;
    }
    [(at[0], w[0]), (at[1], w[1]), (at[2], w[2]), (at[3], w[3])]
}
