//! Chains of straight elements, the holds between and about them, and the list of their nodes.

use plywave::cloth::Lattice;

/// A strand of the cloth.
#[derive(Clone, Debug)]
pub struct Chain {
    /// Nodes over one period [um].
    pub points_um: Vec<[f64; 3]>,
    /// Period of the chain, in vectors of the cell.
    pub shift: [i32; 2],
    /// Radius [um].
    pub radius_um: f64,
    /// Tension, in any unit of force.
    pub tension: f64,
    /// Bending stiffness [that unit times um2].
    pub bending: f64,
    /// Held length of one period [um], instead of a tension that shortens it.
    pub length_um: Option<f64>,
}

/// The strands of a yarn at one place along it: chain, node, and the node's translation in cells.
pub type Station = Vec<(usize, usize, [i32; 2])>;

/// Friction that holds a yarn's axis at its line in the plane of the cloth.
#[derive(Clone, Copy, Debug)]
pub struct Hold {
    /// Unit vector across the line.
    pub across: [f64; 2],
    /// Place of the line along that vector [um].
    pub line_um: f64,
    /// Displacement at which the yarn slides [um].
    pub slip_um: f64,
    /// Maximum force on the yarn, over its length [force/um].
    pub force_per_um: f64,
}

impl Hold {
    /// Energy of a displacement over a length, with its first and second derivatives: a spring up to
    /// `slip_um`, a constant force beyond (Huber's function).
    pub fn energy(&self, off_um: f64, length_um: f64) -> [f64; 3] {
        let k = length_um * self.force_per_um / self.slip_um;
        if off_um.abs() <= self.slip_um {
            return [0.5 * k * off_um * off_um, k * off_um, k];
        }
        [k * self.slip_um * (off_um.abs() - 0.5 * self.slip_um), k * self.slip_um.copysign(off_um), 0.0]
    }
}

/// A yarn's section at one of its stations.
#[derive(Clone, Debug)]
pub struct Section {
    pub station: Station,
    /// Cohesion of its strands [force/um2].
    pub cohesion: f64,
    /// Length along the yarn [um].
    pub length_um: f64,
    pub hold: Option<Hold>,
}

/// A cloth to relax.
#[derive(Clone, Debug)]
pub struct Elements {
    pub lattice: Lattice,
    pub chains: Vec<Chain>,
    pub sections: Vec<Section>,
    /// Distance of the two planes about z = 0 between which the cloth is pressed [um].
    pub thickness_um: Option<f64>,
}

impl Elements {
    /// Coordinates of all nodes.
    pub fn coordinates(&self) -> Vec<f64> {
        self.chains.iter().flat_map(|c| c.points_um.as_flattened()).copied().collect()
    }
}

/// The nodes of all chains in one list.
pub struct Nodes {
    /// First node of each chain, and the number of nodes last.
    pub first: Vec<usize>,
    pub chain: Vec<u32>,
    /// Next node on the chain; the last node wraps to the first.
    pub next: Vec<u32>,
    pub period: Vec<[f64; 2]>,
    pub radius: Vec<f64>,
}

impl Nodes {
    pub fn new(cloth: &Elements) -> Nodes {
        let mut nodes = Nodes { first: vec![0], chain: vec![], next: vec![], period: vec![], radius: vec![] };
        for (c, chain) in cloth.chains.iter().enumerate() {
            let (first, n) = (nodes.chain.len(), chain.points_um.len());
            for i in 0..n {
                nodes.chain.push(c as u32);
                nodes.next.push((first + (i + 1) % n) as u32);
                nodes.radius.push(chain.radius_um);
            }
            nodes.period.push(cloth.lattice.vector(chain.shift));
            nodes.first.push(first + n);
        }
        nodes
    }

    pub fn len(&self) -> usize {
        self.chain.len()
    }

    pub fn at(x: &[f64], g: usize) -> [f64; 3] {
        [x[3 * g], x[3 * g + 1], x[3 * g + 2]]
    }

    /// End of the element that starts at node g.
    pub fn end(&self, x: &[f64], g: usize) -> [f64; 3] {
        let h = self.next[g] as usize;
        let mut p = Nodes::at(x, h);
        if h <= g {
            let period = self.period[self.chain[g] as usize];
            p[0] += period[0];
            p[1] += period[1];
        }
        p
    }
}
