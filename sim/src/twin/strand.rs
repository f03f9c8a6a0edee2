//! Map from the coordinates of a straight yarn to the cloth: center line, helix of the plies, winding of the
//! fibers.
//!
//! A straight yarn has the coordinates (c, n, s): across, up, and the length along its axis. The curved yarn
//! is its image under `P(s) + c C + n N(s)`, C the horizontal across and N the normal of the center line P in
//! the vertical plane. N has minimal rotation, as the curve lies in a plane, and the map stretches lengths
//! along the yarn by `1 - kappa n`. While that is positive, points that are apart in the straight yarn are
//! apart in the cloth. The plies are tubes about helices in the straight yarn, their sections at right angles
//! to the helix. Fibers wind in these tubes as in the simulation of a single ply, by an angle relative to a
//! rotation-minimizing frame. Relative to the frame of the helix, which points away from the yarn's axis,
//! such a frame turns back by `cos(lean)` of every turn.

use plywave::fabric::{Fabric, YarnSet, YarnShape};
use plywave::spec::{Handedness, ply_circle_um};
use std::f64::consts::TAU;

/// A vector of three.
pub(super) type V3 = [f64; 3];

/// Step of the table of lengths [um].
const TABLE_STEP_UM: f64 = 1.0;

/// One yarn's center line with the length along it.
pub(super) struct Strand<'a> {
    fabric: &'a Fabric,
    family: YarnSet,
    yarn: i32,
    /// Length of the domain along the yarn [um].
    pub length_um: f64,
    /// Length along the center line up to each of equal steps of the domain [um].
    arc: Vec<f64>,
}

/// A point on a strand.
#[derive(Clone, Copy)]
pub(super) struct StrandPoint {
    point: V3,
    c: V3,
    n: V3,
    t: V3,
    curvature: f64,
}

impl StrandPoint {
    /// The image of the point (c, n) of the section here.
    pub fn image(&self, c: f64, n: f64) -> V3 {
        std::array::from_fn(|k| self.point[k] + c * self.c[k] + n * self.n[k])
    }

    /// The image of a small step (c, n, s) at the point of the section that lies `up` above the axis.
    pub fn step(&self, step: V3, up: f64) -> V3 {
        let along = step[2] * (1.0 - self.curvature * up);
        std::array::from_fn(|k| step[0] * self.c[k] + step[1] * self.n[k] + along * self.t[k])
    }
}

impl<'a> Strand<'a> {
    pub fn new(fabric: &'a Fabric, family: YarnSet, yarn: i32, length_um: f64) -> Strand<'a> {
        let steps = (length_um / TABLE_STEP_UM).ceil().max(1.0) as usize;
        let step = length_um / steps as f64;
        let mut strand = Strand { fabric, family, yarn, length_um, arc: vec![0.0] };
        // Simpson's rule over each step.
        for i in 0..steps {
            let at = |t: f64| strand.speed(step * (i as f64 + t));
            let next = strand.arc[i] + step / 6.0 * (at(0.0) + 4.0 * at(0.5) + at(1.0));
            strand.arc.push(next);
        }
        strand
    }

    /// Length along the center line by length along the axis of the yarn's family.
    pub fn speed(&self, along: f64) -> f64 {
        let t = self.fabric.center_line(self.family, self.yarn, along).tangent;
        1.0 / t[self.family.other() as usize].max(1e-6)
    }

    /// Bend by length along the axis of the yarn's family [rad/um].
    pub fn bend(&self, along: f64) -> f64 {
        self.fabric.center_line(self.family, self.yarn, along).curvature_per_um.abs() * self.speed(along)
    }

    /// Greatest sine of the lean of the center line.
    pub fn steepest(&self) -> f64 {
        let step = self.length_um / (self.arc.len() - 1) as f64;
        let lean = |i: usize| self.fabric.center_line(self.family, self.yarn, step * i as f64).tangent[2].abs();
        (0..self.arc.len()).map(lean).fold(0.0, f64::max)
    }

    /// Length of the whole center line [um].
    pub fn total(&self) -> f64 {
        self.arc[self.arc.len() - 1]
    }

    /// Length along the center line from 0 to `along`, which may lie beyond the domain.
    pub fn arc(&self, along: f64) -> f64 {
        let whole = (along / self.length_um).floor();
        let steps = self.arc.len() - 1;
        let x = (along / self.length_um - whole) * steps as f64;
        let i = (x as usize).min(steps - 1);
        whole * self.total() + self.arc[i] + (x - i as f64) * (self.arc[i + 1] - self.arc[i])
    }

    /// The point at the length `s` along the center line, near `along`.
    pub fn place_near(&self, s: f64, along: f64) -> StrandPoint {
        let mut at = along;
        // The length is nearly linear over a ply's radius.
        for _ in 0..3 {
            at += (s - self.arc(at)) / self.speed(at);
        }
        self.place(at)
    }

    pub fn place(&self, along: f64) -> StrandPoint {
        let center = self.fabric.center_line(self.family, self.yarn, along);
        let t = center.tangent;
        let (c, n) = match self.family {
            YarnSet::Warp => ([-1.0, 0.0, 0.0], [0.0, -t[2], t[1]]),
            YarnSet::Weft => ([0.0, 1.0, 0.0], [-t[2], 0.0, t[0]]),
        };
        StrandPoint { point: center.point_um, c, n, t, curvature: center.curvature_per_um }
    }
}

/// The helix of a yarn's plies over the domain.
#[derive(Clone, Copy, Debug)]
pub(super) struct Helix {
    /// Number of plies.
    pub plies: u32,
    /// Distance of the plies' axes from the yarn's [um].
    pub circle_um: f64,
    /// Turns over the domain, negative for S; whole.
    pub turns: f64,
    /// Pitch of the spec [um], where the plies are twisted.
    pub spec_pitch_um: Option<f64>,
    length_um: f64,
}

impl Helix {
    pub fn new(shape: &YarnShape, length_um: f64) -> Helix {
        let spec_pitch_um = shape.ply_pitch_um.filter(|_| shape.plies > 1);
        let hand = if shape.handedness == Handedness::Z { 1.0 } else { -1.0 };
        let turns = spec_pitch_um.map_or(0.0, |pitch| hand * (length_um / pitch).round());
        // If the changed pitch is too short for any circle, use that of parallel plies: its error exceeds
        // that of any accepted pitch.
        let pitch = (turns != 0.0).then(|| length_um / turns.abs());
        let circle_um = ply_circle_um(shape.plies, shape.ply_radius_um, pitch).unwrap_or_else(|| shape.circle_um());
        Helix { plies: shape.plies, circle_um, turns, spec_pitch_um, length_um }
    }

    /// Traced pitch [um].
    pub fn pitch_um(&self) -> f64 {
        self.length_um / self.turns.abs()
    }

    /// Turn of the plies by length along the axis of the yarn's family [rad/um].
    pub fn rate(&self) -> f64 {
        TAU * self.turns / self.length_um
    }

    /// Length of a ply by length along the axis of the yarn's family, where the center line has the given
    /// speed.
    fn speed(&self, speed: f64) -> f64 {
        speed.hypot(self.circle_um * self.rate())
    }
}

/// The winding of the fibers of a ply: their angle relative to the frame of the helix.
#[derive(Clone, Copy, Debug)]
pub(super) struct Winding {
    /// Turn of the fibers per length of the ply [rad/um], changed to give whole turns.
    twist: f64,
    /// Mean cosine of the plies' lean.
    back: f64,
    ply_length: f64,
    /// Ratio of the center line's length to the ply's.
    stretch: f64,
    rate: f64,
}

impl Winding {
    /// Winding of fibers with `twist_per_um` in the spec, positive for Z.
    pub fn new(strand: &Strand<'_>, helix: &Helix, twist_per_um: f64) -> Winding {
        let steps = 512;
        let mean = (0..steps)
            .map(|i| helix.speed(strand.speed(strand.length_um * (f64::from(i) + 0.5) / f64::from(steps))))
            .sum::<f64>()
            / f64::from(steps);
        let ply_length = mean * strand.length_um;
        let stretch = ply_length / strand.total();
        let back = 1.0 / stretch;
        let angle = twist_per_um * ply_length - back * TAU * helix.turns;
        let whole = TAU * (angle / TAU).round();
        let twist = (whole + back * TAU * helix.turns) / ply_length;
        Winding { twist, back, ply_length, stretch, rate: helix.rate() }
    }

    /// Traced pitch [um].
    pub fn pitch_um(&self) -> f64 {
        // Rounding of the sum does not count as a turn.
        if (self.twist * self.ply_length).abs() < 1e-9 { f64::INFINITY } else { TAU / self.twist.abs() }
    }

    /// Turn of the fibers per length of the ply [rad/um].
    pub fn twist(&self) -> f64 {
        self.twist
    }

    /// Length of the ply over the domain [um].
    pub fn total(&self) -> f64 {
        self.ply_length
    }

    /// Angle of a rotation-minimizing frame relative to the frame of the helix.
    pub fn back(&self, along: f64) -> f64 {
        -self.back * self.rate * along
    }

    /// Angle of the fibers relative to the frame of the helix at the length `arc` of the center line.
    pub fn angle(&self, along: f64, arc: f64) -> f64 {
        self.twist * self.stretch * arc - self.back * self.rate * along
    }
}
