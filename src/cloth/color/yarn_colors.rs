//! The absorptions of a cloth's yarns: one dye for each distinct color of a kind, and the dye of the mean
//! color.

use crate::cloth::color::dye::Dye;
use crate::cloth::yarn_look::YarnColor;
use crate::color::{AlbedoCurve, srgb_decode, srgb_encode};
use crate::optics::Reflections;

/// The colors of a cloth's yarns as absorptions.
#[derive(Clone, Debug)]
pub(crate) struct Dyes {
    all: Vec<Dye>,
    /// `[kind]`: index of the dye of each yarn by its number, repeated periodically.
    yarns: [Vec<u32>; 2],
    /// `[kind]`: index of each dye of its yarns, and its share of the yarns.
    shares: [Vec<(u32, f32)>; 2],
    /// `[kind]`: index of the dye of the mean color.
    means: [u32; 2],
}

impl Dyes {
    /// Computes the dyes from the colors of each kind's yarns, in the order of their numbers. Undyed metal
    /// fibers get the color of their metal.
    pub fn new(colors: &[Vec<YarnColor>; 2], metals: &[Option<Reflections>; 2], curve: &AlbedoCurve) -> Dyes {
        let mut dyes = Dyes { all: Vec::new(), yarns: Default::default(), shares: Default::default(), means: [0; 2] };
        for kind in 0..2 {
            let mut known: Vec<(YarnColor, u32)> = Vec::new();
            for color in &colors[kind] {
                let dye = known.iter().find(|(c, _)| c == color).map_or(dyes.all.len() as u32, |(_, dye)| *dye);
                if dye as usize == dyes.all.len() {
                    known.push((*color, dye));
                    dyes.all.push(match &metals[kind] {
                        Some(metal) if *color == YarnColor::Undyed => Dye::of_metal(metal, curve),
                        _ => Dye::new(*color, curve),
                    });
                }
                dyes.yarns[kind].push(dye);
            }
            let count = colors[kind].len().max(1) as f32;
            let of = |dye: u32| dyes.yarns[kind].iter().filter(|d| **d == dye).count() as f32 / count;
            dyes.shares[kind] = known.iter().map(|(_, dye)| (*dye, of(*dye))).collect();
            dyes.means[kind] = match known[..] {
                [(_, dye)] => dye,
                _ => {
                    let mut mean = [0.0; 3];
                    for ((color, _), (_, share)) in known.iter().zip(&dyes.shares[kind]) {
                        if let YarnColor::Srgb(srgb) = color {
                            (0..3).for_each(|k| mean[k] += f64::from(*share) * srgb_decode(f64::from(srgb[k])));
                        }
                    }
                    dyes.all.push(Dye::new(YarnColor::Srgb(mean.map(|v| srgb_encode(v) as f32)), curve));
                    dyes.all.len() as u32 - 1
                }
            };
        }
        dyes
    }

    /// Dye of the yarn with this number.
    #[inline]
    pub fn of(&self, kind: usize, number: i32) -> &Dye {
        let yarns = &self.yarns[kind];
        &self.all[yarns[number.rem_euclid(yarns.len() as i32) as usize] as usize]
    }

    /// Dye of the mean color of a kind.
    #[inline]
    pub fn mean(&self, kind: usize) -> &Dye {
        &self.all[self.means[kind] as usize]
    }

    /// Whether the yarns of a kind have several colors.
    #[inline]
    pub fn several(&self, kind: usize) -> bool {
        self.yarns[kind].len() > 1
    }

    /// Calls `each` for every dye of a kind with its share of the yarns.
    pub fn each(&self, kind: usize, mut each: impl FnMut(&Dye, f32)) {
        self.shares[kind].iter().for_each(|(dye, share)| each(&self.all[*dye as usize], *share));
    }

    /// All dyes; `[kind]`, the indices of the yarns' dyes by number; and `[kind]`, the index of the mean dye.
    pub fn tables(&self) -> (&[Dye], &[Vec<u32>; 2], [u32; 2]) {
        (&self.all, &self.yarns, self.means)
    }

    pub fn memory_bytes(&self) -> usize {
        size_of_val(self.all.as_slice())
            + self.all.iter().map(Dye::memory_bytes).sum::<usize>()
            + self.yarns.iter().map(|yarns| size_of_val(yarns.as_slice())).sum::<usize>()
            + self.shares.iter().map(|shares| size_of_val(shares.as_slice())).sum::<usize>()
    }
}
