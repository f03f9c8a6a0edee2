//! The bed of needles: a chart is knitted course by course, and each loop is followed from the stitch that
//! makes it to the one that holds it.
//!
//! Where loops come together on a needle, a loop that was moved there lies in front of the others, one moved
//! to the right before one moved to the left, as decreases of hand knitters lean (ssk, k2tog). The yarn of a
//! tuck lies behind the loops of a knit stitch and in front of those of a purl stitch, the side from which
//! the needle of that stitch catches it.

use plywave_textile::{Chart, MAX_HELD, Stitch};

/// A loop at the height of a course.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Its wale, which may lie in another repeat.
    pub wale: i64,
    /// Number of loops on its needle that lie before it.
    pub front: usize,
    /// Number of loops on its needle that lie behind it.
    pub back: usize,
    /// Number of loops on its needle that enclose it in the plane: those that came later.
    pub around: usize,
}

/// A loop.
#[derive(Clone, Debug, PartialEq)]
pub struct Loop {
    /// Course and wale in which it is made; the courses of the first repeat begin with 0.
    pub made: [i64; 2],
    /// Whether it is laid over an empty needle or over loops, and not drawn through any.
    pub is_open: bool,
    /// Side of the stitch that makes it: 1 for knit, -1 for purl. An open loop has that of its holder.
    pub own: f64,
    /// Side of the stitch that holds it; 0 if the knitting ends before.
    pub side: f64,
    /// The loops that it is drawn through, from front to back.
    pub holds: Vec<usize>,
    /// Where it is in the course that makes it and in each one after, up to that of its holder.
    pub places: Vec<Place>,
    /// By how many layers of yarn it is lifted as it moves between two places; absent: it does not move.
    pub lifts: Vec<Option<usize>>,
}

/// What a needle does in a course.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Cell {
    /// It makes a loop.
    Loop(usize),
    /// The yarn floats behind loops, each with the number of its place there.
    Float(Vec<(usize, usize)>),
}

/// A knitted repeat.
#[derive(Clone, Debug)]
pub struct Knitted {
    /// All loops, with those of the courses before and after the repeat.
    pub loops: Vec<Loop>,
    /// `[course][wale]` of the repeat.
    pub cells: Vec<Vec<Cell>>,
}

/// The loops of a needle.
#[derive(Clone, Debug, Default)]
struct Needle {
    /// From front to back.
    front: Vec<usize>,
    /// From the innermost, which came first, outwards.
    inner: Vec<usize>,
}

impl Needle {
    fn new(one: usize) -> Needle {
        Needle { front: vec![one], inner: vec![one] }
    }

    fn len(&self) -> usize {
        self.front.len()
    }

    /// Hangs the loops of another needle in front of its own and around them.
    fn receive(&mut self, other: &Needle) {
        self.front.splice(0..0, other.front.iter().copied());
        self.inner.extend(&other.inner);
    }
}

/// Knits a chart.
pub fn knit(chart: &Chart) -> Knitted {
    let courses = chart.courses();
    // After so many courses no loop is left that the bed began with.
    let held = MAX_HELD + 1;
    let before = (held + 1).div_ceil(courses) * courses;
    let mut bed = Bed::new(chart);
    let mut cells = Vec::with_capacity(courses);
    for course in 0..before + courses + held {
        let row = bed.course(course as i64 - before as i64);
        if (before..before + courses).contains(&course) {
            cells.push(row);
        }
    }
    Knitted { loops: bed.loops, cells }
}

/// The bed while it knits.
struct Bed<'a> {
    chart: &'a Chart,
    loops: Vec<Loop>,
    needles: Vec<Needle>,
}

impl Bed<'_> {
    /// A bed with a loop on each needle.
    fn new(chart: &Chart) -> Bed<'_> {
        let mut bed = Bed { chart, loops: Vec::new(), needles: Vec::new() };
        for wale in 0..chart.wales() {
            let id = bed.add([i64::MIN, wale as i64], false, 1.0);
            bed.needles.push(Needle::new(id));
            bed.loops[id].places.push(Place { wale: wale as i64, front: 0, back: 0, around: 0 });
        }
        bed
    }

    fn add(&mut self, made: [i64; 2], is_open: bool, own: f64) -> usize {
        let (holds, places, lifts) = (Vec::new(), Vec::new(), Vec::new());
        self.loops.push(Loop { made, is_open, own, side: 0.0, holds, places, lifts });
        self.loops.len() - 1
    }

    /// Knits a course.
    fn course(&mut self, course: i64) -> Vec<Cell> {
        self.transfer(course);
        let mut cells = Vec::with_capacity(self.needles.len());
        for wale in 0..self.needles.len() {
            let place = [course, wale as i64];
            let stitch = self.chart.stitch(course, place[1]);
            let is_empty = self.needles[wale].front.is_empty();
            let cell = match stitch {
                Stitch::Miss => None,
                Stitch::Tuck => {
                    let id = self.add(place, true, 0.0);
                    let at = if self.side_of(place) > 0.0 { self.needles[wale].len() } else { 0 };
                    self.needles[wale].front.insert(at, id);
                    self.needles[wale].inner.push(id);
                    Some(id)
                }
                _ => Some(self.draw(place, is_empty, if stitch == Stitch::Purl { -1.0 } else { 1.0 })),
            };
            self.record(wale, cell);
            cells.push(match cell {
                Some(id) => Cell::Loop(id),
                None => {
                    let of = |id: &usize| (*id, self.loops[*id].places.len() - 1);
                    Cell::Float(self.needles[wale].front.iter().map(of).collect())
                }
            });
        }
        cells
    }

    /// Draws a loop through those of its needle; on an empty needle it is open.
    fn draw(&mut self, [course, wale]: [i64; 2], is_open: bool, own: f64) -> usize {
        let id = self.add([course, wale], is_open, own);
        let needle = std::mem::replace(&mut self.needles[wale as usize], Needle::new(id));
        self.hang(&needle);
        for held in &needle.front {
            let held = &mut self.loops[*held];
            held.side = own;
            if held.is_open {
                held.own = own;
            }
        }
        self.loops[id].holds = needle.front;
        id
    }

    /// Records where the loops of a needle are after a course.
    fn record(&mut self, wale: usize, made: Option<usize>) {
        if let Some(id) = made {
            let wale = self.loops[id].made[1];
            self.loops[id].places.push(Place { wale, front: 0, back: 0, around: 0 });
        }
        let needle = std::mem::take(&mut self.needles[wale]);
        self.hang(&needle);
        self.needles[wale] = needle;
    }

    /// Sets the order of loops on a needle at their last places.
    fn hang(&mut self, needle: &Needle) {
        for (front, id) in needle.front.iter().enumerate() {
            let around = needle.inner.iter().rev().position(|other| other == id).unwrap_or(0);
            if let Some(place) = self.loops[*id].places.last_mut() {
                *place = Place { front, back: needle.len() - 1 - front, around, ..*place };
            }
        }
    }

    /// Moves loops before a course, and brings all loops to its height.
    fn transfer(&mut self, course: i64) {
        let count = self.needles.len();
        let old = std::mem::take(&mut self.needles);
        let stitch = |wale: usize| self.chart.stitch(course, wale as i64);
        let mut lifts: Vec<Option<usize>> = vec![None; count];
        for wale in 0..count {
            let (before, after) = ((wale + count - 1) % count, (wale + 1) % count);
            let mut needle = Needle::default();
            if stitch(wale).shift() == 0 {
                needle = old[wale].clone();
            }
            // Layers of loops over which those that come pass.
            let mut layers = needle.len().max(1);
            if stitch(after) == Stitch::Move(-1) {
                needle.receive(&old[after]);
                lifts[after] = Some(layers);
                layers += old[after].len();
            }
            if stitch(before) == Stitch::Move(1) {
                needle.receive(&old[before]);
                lifts[before] = Some(layers);
            }
            if let Stitch::Cable { .. } = stitch(wale) {
                // A cable does not pass the edge of the repeat.
                let from = (0..count).find(|from| match stitch(*from) {
                    Stitch::Cable { by, .. } => *from as i64 + i64::from(by) == wale as i64,
                    _ => false,
                });
                needle = from.map_or(needle, |from| old[from].clone());
            }
            self.needles.push(needle);
        }
        for (wale, lift) in lifts.iter_mut().enumerate() {
            if let Stitch::Cable { by, is_front } = stitch(wale) {
                // The loops in front pass over the layers of those behind, which lie within this distance.
                let near = |other: &usize| match stitch(*other) {
                    Stitch::Cable { by: of, .. } => {
                        let [a, b] = [(wale, by), (*other, of)].map(|(at, by)| (at as i64, at as i64 + i64::from(by)));
                        (a.0 < b.0) != (a.1 < b.1)
                    }
                    _ => false,
                };
                let layers = (0..count).filter(near).map(|other| old[other].len()).max().unwrap_or(1);
                *lift = Some(if is_front { layers } else { 0 });
            }
        }
        for (wale, needle) in old.iter().enumerate() {
            let by = i64::from(self.chart.stitch(course, wale as i64).shift());
            for id in &needle.front {
                let of = &mut self.loops[*id];
                let last = of.places.last().copied();
                of.places.extend(last.map(|place| Place { wale: place.wale + by, ..place }));
                of.lifts.push(lifts[wale]);
            }
        }
    }

    /// Side of the stitch that will hold the loops of a needle after a course.
    fn side_of(&self, [course, mut wale]: [i64; 2]) -> f64 {
        for at in course + 1..=course + MAX_HELD as i64 + 1 {
            wale += i64::from(self.chart.stitch(at, wale).shift());
            match self.chart.stitch(at, wale) {
                Stitch::Tuck | Stitch::Miss => {}
                Stitch::Purl => return -1.0,
                _ => return 1.0,
            }
        }
        1.0
    }
}
