//! The matrices of the boundary equations ([`system`](crate::boundary::system)): every pair of nodes, reduced
//! by the symmetry of the walls.
//!
//! Quadrature: trapezoidal rule on periodic nodes. On walls between clear media the logarithm is that of
//! Kussmaul and Martensen (see [`kernel`](crate::boundary::kernel)); on others a special rule replaces the
//! nodes around the target ([`vicinity`](crate::boundary::vicinity)). Targets close to another wall use finer
//! nodes of it ([`close`](crate::boundary::close)).

use crate::boundary::close::{FINEST, close_row, closeness};
use crate::boundary::entries::{COMPONENTS, E, Entries, H, P, Pair, Q, Wavenumbers};
use crate::boundary::kernel::{Medium, MediumKernel, WallKernel, log_weights};
use crate::boundary::vicinity::{Vicinity, pairs_of};
use crate::boundary::walls::Wall;
use crate::scene::curve::CurvePoint;
use crate::scene::symmetry::Group;
use crate::{C64, Wave, WaveError};
use rayon::prelude::*;

/// Input of the matrices.
pub(crate) struct Assembly {
    pub wave: Wave,
    /// Media, the exterior first.
    pub media: Vec<Medium>,
    /// Walls, those that border on the exterior first.
    pub walls: Vec<Wall>,
    /// Nodes of all walls, in their order.
    pub nodes: Vec<CurvePoint>,
    pub group: Group,
    pub tolerance: f64,
}

/// Number of targets whose vicinity rows are held at once.
const TARGETS: usize = 64;

/// Interaction of nodes of one wall.
enum Own {
    /// Between clear media: weights of the logarithm, by the distance in nodes.
    Clear(Vec<f64>),
    Lossy(Vicinity),
}

/// Kernels between walls.
struct Kernels {
    wavenumbers: Wavenumbers,
    walls: Vec<WallKernel>,
    own: Vec<Own>,
    media: Vec<Option<MediumKernel>>,
}

impl Assembly {
    fn kernels(&self) -> Kernels {
        let reach = |walls: &[&Wall]| {
            let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
            for p in walls.iter().flat_map(|w| &w.curve.nodes) {
                for k in 0..2 {
                    low[k] = low[k].min(p.at[k]);
                    high[k] = high[k].max(p.at[k]);
                }
            }
            // Finer nodes of close walls may be a little outside of the box.
            1.02 * (high[0] - low[0]).hypot(high[1] - low[1])
        };
        let sides = |w: &Wall| [self.media[w.outside], self.media[w.inside]];
        let kernel = |w: &Wall| WallKernel::new(self.media[w.outside], self.media[w.inside], reach(&[w]));
        let walls = self.walls.iter().map(kernel).collect();
        let own = self.walls.iter().map(|w| {
            if sides(w).iter().all(|m| m.kappa.im == 0.0 && m.eps.im == 0.0) {
                Own::Clear(log_weights(w.curve.nodes.len()))
            } else {
                Own::Lossy(Vicinity::new(&w.curve, sides(w).map(|m| m.kappa), self.tolerance))
            }
        });
        let own = own.collect();
        let media = (0..self.media.len())
            .map(|m| {
                let around: Vec<&Wall> = self.walls.iter().filter(|w| w.outside == m || w.inside == m).collect();
                (around.len() > 1).then(|| MediumKernel::new(self.media[m], reach(&around)))
            })
            .collect();
        Kernels { wavenumbers: Wavenumbers { k0: self.wave.k0(), kz: self.wave.kz() }, walls, own, media }
    }

    /// The medium between targets on wall a and wall b, and the sign of b's layers in it.
    fn between(&self, a: usize, b: usize) -> Option<(usize, f64)> {
        let (a, b) = (&self.walls[a], &self.walls[b]);
        if b.outside == a.outside || b.outside == a.inside {
            Some((b.outside, 1.0))
        } else if b.inside == a.outside {
            Some((b.inside, -1.0))
        } else {
            None
        }
    }

    fn wall_of(&self, node: usize) -> usize {
        self.walls.partition_point(|w| w.first <= node) - 1
    }

    /// The matrices of all parts, `[part][block]`, each column after column: parts as in `components`, a
    /// block for each character of the symmetry group.
    ///
    /// # Errors
    /// [`WaveError::Overlap`] for walls that almost touch.
    pub fn matrices(&self, components: &[&'static [usize]]) -> Result<Vec<Vec<Vec<C64>>>, WaveError> {
        let kernels = &self.kernels();
        let orbits = &self.group.orbits;
        let (n, order) = (orbits.len(), self.group.order());
        // Orbits are ascending, so those of a wall are consecutive.
        let runs: Vec<(usize, usize)> = self
            .walls
            .iter()
            .map(|w| {
                let end = w.first + w.curve.nodes.len();
                (orbits.partition_point(|&j| (j as usize) < w.first), orbits.partition_point(|&j| (j as usize) < end))
            })
            .collect();
        let mut matrices: Vec<Vec<Vec<C64>>> =
            components.iter().map(|c| (0..order).map(|_| vec![C64::ZERO; (c.len() * n).pow(2)]).collect()).collect();
        // Columns of one source orbit, in every matrix.
        let mut slabs: Vec<Vec<Vec<&mut [C64]>>> = (0..n).map(|_| Vec::new()).collect();
        for (part, c) in matrices.iter_mut().zip(components) {
            for slab in &mut slabs {
                slab.push(Vec::with_capacity(order));
            }
            for matrix in part {
                for (slab, columns) in slabs.iter_mut().zip(matrix.chunks_mut(c.len() * c.len() * n)) {
                    slab.last_mut().expect("pushed above").push(columns);
                }
            }
        }
        slabs.into_par_iter().enumerate().for_each(|(column, mut slab)| {
            for (gamma, element) in self.group.elements.iter().enumerate() {
                let source = element.image[orbits[column] as usize] as usize;
                let b = self.wall_of(source);
                for (a, &(start, end)) in runs.iter().enumerate() {
                    for row in start..end {
                        let target = orbits[row] as usize;
                        let Some(entries) = self.pair(kernels, a, target, b, source) else { break };
                        self.scatter_entries(&mut slab, components, gamma, n, row, &entries);
                    }
                }
            }
        });
        self.add_vicinities(kernels, components, &runs, &mut matrices);
        self.refine_close(kernels, components, &runs, &mut matrices)?;
        Ok(matrices)
    }

    /// Adds the kernel of one image of the source to the columns of its orbit.
    #[inline(always)]
    fn scatter_entries(
        &self,
        slab: &mut [Vec<&mut [C64]>],
        components: &[&'static [usize]],
        gamma: usize,
        n: usize,
        row: usize,
        entries: &Entries,
    ) {
        let mirror = self.group.elements[gamma].mirror;
        for (part, c) in slab.iter_mut().zip(components) {
            let size = c.len() * n;
            for (chi, columns) in part.iter_mut().enumerate() {
                let factor = self.group.characters[chi][gamma].conj();
                for (b, &from) in c.iter().enumerate() {
                    let factor = if mirror && from >= H { -factor } else { factor };
                    let at = b * size + row * c.len();
                    for (out, &to) in columns[at..at + c.len()].iter_mut().zip(c.iter()) {
                        *out += factor * entries[to][from];
                    }
                }
            }
        }
    }

    /// The matrix entries of one pair of nodes; `None` if the walls share no medium.
    #[inline(always)]
    fn pair(&self, kernels: &Kernels, a: usize, target: usize, b: usize, source: usize) -> Option<Entries> {
        let (x, y) = (&self.nodes[target], &self.nodes[source]);
        let wall = &self.walls[b];
        let h = wall.curve.step();
        if a != b {
            let (medium, sign) = self.between(a, b)?;
            let pair = Pair::new(x, y);
            let radial = kernels.media[medium].as_ref()?.radial(pair.r, sign * h * y.speed);
            return Some(kernels.wavenumbers.regular(&radial, &pair));
        }
        let kernel = &kernels.walls[b];
        let apart = target.abs_diff(source);
        if target != source {
            let pair = Pair::new(x, y);
            let radial = match &kernels.own[b] {
                Own::Clear(logs) => kernel.weighted(pair.r, h * y.speed, logs[apart] * y.speed),
                Own::Lossy(vicinity) => {
                    let mut radial = kernel.without_pole(pair.r, h * y.speed * vicinity.outside[apart]);
                    radial.ed += kernel.pole() * (h * y.speed / (pair.r * pair.r));
                    radial
                }
            };
            return Some(kernels.wavenumbers.regular(&radial, &pair));
        }
        let mut entries = [[C64::ZERO; COMPONENTS]; COMPONENTS];
        if let Own::Clear(logs) = &kernels.own[b] {
            let pair = Pair { r: 0.0, rn: 0.0, rt: 0.0, rns: 0.0, rts: 0.0, nn: 1.0, tn: 0.0 };
            let radial = kernel.diagonal(y.speed, h * y.speed, logs[0] * y.speed);
            entries = kernels.wavenumbers.entries(&radial, &pair, 1.0);
        }
        // r.n'/R^2 tends to -curvature/2, r.n/R^2 to the opposite.
        let bend = kernel.pole() * (0.5 * y.curvature * h * y.speed);
        let mean = 0.5 * (self.media[wall.outside].eps + self.media[wall.inside].eps);
        entries[E][E] += mean - bend;
        entries[P][P] += 1.0;
        entries[H][H] += 1.0;
        entries[Q][Q] += mean + bend;
        Some(entries)
    }

    /// Adds the vicinities of targets on walls beside lossy media.
    fn add_vicinities(
        &self,
        kernels: &Kernels,
        components: &[&'static [usize]],
        runs: &[(usize, usize)],
        matrices: &mut [Vec<Vec<C64>>],
    ) {
        let (orbits, pairs) = (&self.group.orbits, pairs_of(components));
        for (b, wall) in self.walls.iter().enumerate() {
            let Own::Lossy(vicinity) = &kernels.own[b] else { continue };
            let (first, last) = runs[b];
            let n = wall.curve.nodes.len();
            for start in (first..last).step_by(TARGETS) {
                let targets: Vec<usize> =
                    (start..last.min(start + TARGETS)).map(|row| orbits[row] as usize - wall.first).collect();
                let rows = vicinity.rows(&kernels.wavenumbers, &kernels.walls[b], &wall.curve, &targets, &pairs);
                let mut before = 0;
                for (part, c) in matrices.iter_mut().zip(components) {
                    let (c, size) = (*c, c.len() * orbits.len());
                    for (chi, matrix) in part.iter_mut().enumerate() {
                        let columns = matrix.par_chunks_mut(c.len() * size).enumerate();
                        columns.skip(first).take(last - first).for_each(|(column, columns)| {
                            for (gamma, element) in self.group.elements.iter().enumerate() {
                                let source = element.image[orbits[column] as usize] as usize - wall.first;
                                let factor = self.group.characters[chi][gamma].conj();
                                for (k, &target) in targets.iter().enumerate() {
                                    let ahead = (source + n - target) % n;
                                    for (from_at, &from) in c.iter().enumerate() {
                                        let factor = if element.mirror && from >= H { -factor } else { factor };
                                        for to_at in 0..c.len() {
                                            let pair = before + to_at * c.len() + from_at;
                                            let at = 2 * (k * pairs.len() + pair) * n + ahead;
                                            columns[from_at * size + (start + k) * c.len() + to_at] +=
                                                factor * C64::new(rows[at], rows[at + n]);
                                        }
                                    }
                                }
                            }
                        });
                    }
                    before += c.len() * c.len();
                }
            }
        }
    }

    /// Replaces the rows of targets so close to another wall that its nodes do not resolve the kernel.
    fn refine_close(
        &self,
        kernels: &Kernels,
        components: &[&'static [usize]],
        runs: &[(usize, usize)],
        matrices: &mut [Vec<Vec<C64>>],
    ) -> Result<(), WaveError> {
        let n = self.group.orbits.len();
        for (b, wall) in self.walls.iter().enumerate() {
            for (a, &(start, end)) in runs.iter().enumerate() {
                let Some((medium, sign)) = self.between(a, b).filter(|_| a != b) else { continue };
                let Some(kernel) = kernels.media[medium].as_ref() else { continue };
                let rows: Vec<Option<(usize, Vec<Entries>)>> = (start..end)
                    .into_par_iter()
                    .map(|row| {
                        let target = &self.nodes[self.group.orbits[row] as usize];
                        let Some((nearest, refinement)) = closeness(target, &wall.curve, self.tolerance) else {
                            return Ok(None);
                        };
                        if refinement > FINEST {
                            return Err(WaveError::Overlap {
                                first: self.walls[a].name.clone(),
                                second: wall.name.clone(),
                            });
                        }
                        let row_entries =
                            close_row(&kernels.wavenumbers, kernel, sign, target, &wall.curve, nearest, refinement);
                        Ok(Some((row, row_entries)))
                    })
                    .collect::<Result<_, WaveError>>()?;
                let (first, last) = runs[b];
                for (row, entries) in rows.into_iter().flatten() {
                    for (part, c) in matrices.iter_mut().zip(components) {
                        let size = c.len() * n;
                        for (chi, matrix) in part.iter_mut().enumerate() {
                            for column in first..last {
                                for (from_at, &from) in c.iter().enumerate() {
                                    for (to_at, &to) in c.iter().enumerate() {
                                        let mut sum = C64::ZERO;
                                        for (gamma, element) in self.group.elements.iter().enumerate() {
                                            let source = element.image[self.group.orbits[column] as usize] as usize;
                                            let value = entries[source - wall.first][to][from];
                                            let factor = self.group.characters[chi][gamma].conj();
                                            sum += if element.mirror && from >= H { -factor } else { factor } * value;
                                        }
                                        matrix[(column * c.len() + from_at) * size + row * c.len() + to_at] = sum;
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
        Ok(())
    }
}
