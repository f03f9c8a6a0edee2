//! Tiles of a large draft: small cloths that together show each of its neighborhoods once.
//!
//! A tile is a rectangle of crossings with a margin on each side. It repeats by itself, so the crossings of
//! the margin have wrong neighbors; those inside have the right ones as far as the margin reaches.

use super::windows::Windows;
use plywave_textile::Draft;

/// Width of the margin in crossings: one more than windows reach, since its outermost crossings have wrong
/// neighbors.
pub const MARGIN: usize = 4;
/// Side of a tile in crossings, without its margin: larger tiles have less margin, but they take longer by
/// more than their area.
const SIDE: usize = 14;

/// A rectangle of a draft that is relaxed by itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tile {
    /// First end and first pick of the tile with its margin; they may lie before the first of the draft.
    pub from: [i64; 2],
    /// Number of ends and picks with the margin.
    pub size: [usize; 2],
}

impl Tile {
    /// The tile about `inner` ends and picks from `from`. Along a side that the margin would close, the tile
    /// is the whole draft and needs none.
    fn about(draft: &Draft, from: [usize; 2], inner: [usize; 2]) -> Tile {
        let all = [draft.ends(), draft.picks()];
        let is_whole = [0, 1].map(|k| inner[k] + 2 * MARGIN >= all[k]);
        Tile {
            from: [0, 1].map(|k| if is_whole[k] { 0 } else { from[k] as i64 - MARGIN as i64 }),
            size: [0, 1].map(|k| if is_whole[k] { all[k] } else { inner[k] + 2 * MARGIN }),
        }
    }

    /// The tile's own draft.
    pub fn draft(&self, whole: &Draft) -> Option<Draft> {
        let at = |k: usize, i: usize, count: usize| (self.from[k] + i as i64).rem_euclid(count as i64) as usize;
        let up = |pick: usize, end: usize| whole.up(at(1, pick, whole.picks()), at(0, end, whole.ends()));
        Draft::from_fn(self.size[1], self.size[0], up)
    }
}

/// Tiles of a draft, and for each window the crossing of a tile that shows it.
pub struct Cover {
    pub tiles: Vec<Tile>,
    /// `[window]`: tile, end and pick in it.
    pub shown: Vec<(usize, [usize; 2])>,
}

impl Cover {
    pub fn new(draft: &Draft, windows: &Windows) -> Cover {
        let mut cover = Cover { tiles: Vec::new(), shown: vec![(usize::MAX, [0; 2]); windows.count()] };
        let mut is_new = vec![true; windows.count()];
        for pick in (0..draft.picks()).step_by(SIDE) {
            for end in (0..draft.ends()).step_by(SIDE) {
                let to = [(end + SIDE).min(draft.ends()), (pick + SIDE).min(draft.picks())];
                cover.add(draft, windows, [end, pick], to, &mut is_new);
            }
        }
        cover
    }

    /// Adds a tile for the windows of a rectangle that no tile shows yet.
    fn add(&mut self, draft: &Draft, windows: &Windows, from: [usize; 2], to: [usize; 2], is_new: &mut [bool]) {
        let mut found: Vec<(usize, [usize; 2])> = Vec::new();
        for pick in from[1]..to[1] {
            for end in from[0]..to[0] {
                let window = windows.at(pick, end);
                if std::mem::take(&mut is_new[window]) {
                    found.push((window, [end, pick]));
                }
            }
        }
        if found.is_empty() {
            return;
        }
        let bound = |k: usize| {
            let of = found.iter().map(|(_, at)| at[k]);
            of.clone().min().zip(of.max()).map_or((0, 0), |(low, high)| (low, high))
        };
        let bounds = [bound(0), bound(1)];
        let tile = Tile::about(draft, bounds.map(|b| b.0), bounds.map(|b| b.1 - b.0 + 1));
        let all = [draft.ends() as i64, draft.picks() as i64];
        for (window, at) in found {
            let in_tile = [0, 1].map(|k| (at[k] as i64 - tile.from[k]).rem_euclid(all[k]) as usize);
            self.shown[window] = (self.tiles.len(), in_tile);
        }
        self.tiles.push(tile);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every window of a figured draft is shown by a crossing of a tile about which the tile's own draft is
    /// the same, as far as the margin reaches.
    #[test]
    fn tiles_show_every_window() {
        let satin = Draft::satin(5, 2).unwrap();
        let draft = Draft::from_fn(70, 45, |pick, end| {
            let is_figure = (pick as i64 - 35).pow(2) + (end as i64 - 20).pow(2) < 225;
            satin.up(pick % 5, end % 5) != is_figure
        });
        let draft = draft.unwrap();
        let windows = Windows::new(&draft, 3);
        let cover = Cover::new(&draft, &windows);
        for pick in 0..70i64 {
            for end in 0..45i64 {
                let (tile, at) = cover.shown[windows.at(pick as usize, end as usize)];
                let small = cover.tiles[tile].draft(&draft).unwrap();
                let [ends, picks] = cover.tiles[tile].size;
                assert_eq!([ends, picks], [small.ends(), small.picks()]);
                for i in -3i64..=3 {
                    for k in -3i64..=3 {
                        let of = |i: i64, count: usize| i.rem_euclid(count as i64) as usize;
                        let shown = small.up(of(at[1] as i64 + i, picks), of(at[0] as i64 + k, ends));
                        assert_eq!(shown, draft.up(of(pick + i, 70), of(end + k, 45)), "{pick} {end}");
                    }
                }
            }
        }
        let relaxed: usize = cover.tiles.iter().map(|tile| tile.size[0] * tile.size[1]).sum();
        println!("{} windows, {} tiles, {relaxed} crossings", windows.count(), cover.tiles.len());
    }
}
