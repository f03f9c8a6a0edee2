//! Tests of knits, from the bed of needles to the relaxed cloth.

mod crossings;
mod needles;
mod plain;
mod relaxed;

use plywave_textile::Chart;

/// Random numbers (SplitMix64).
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % n as u64) as usize
    }

    /// Rows of a chart that can be knitted, and the chart.
    fn chart(&mut self, most: usize) -> (Vec<String>, Chart) {
        loop {
            let (wales, courses) = (1 + self.below(most), 1 + self.below(most));
            // Some charts have few other stitches than plain ones, others many.
            let share = 1 + self.below(8);
            let rows: Vec<String> = (0..courses).map(|_| self.row(wales, share)).collect();
            if let Ok(chart) = Chart::from_rows(&rows) {
                return (rows, chart);
            }
        }
    }

    fn row(&mut self, wales: usize, share: usize) -> String {
        let mut row = String::new();
        while row.len() < wales {
            if self.below(10) < 10 - share {
                row.push(['K', 'P'][self.below(2)]);
                continue;
            }
            match self.below(5) {
                0 => row.push('T'),
                1 => row.push('M'),
                2 => row.push('>'),
                3 => row.push('<'),
                _ => {
                    let [right, left] = [1 + self.below(3), 1 + self.below(3)];
                    if row.len() + right + left <= wales {
                        let letters = if self.below(2) == 0 { ["R", "l"] } else { ["r", "L"] };
                        row += &(letters[0].repeat(right) + &letters[1].repeat(left));
                    }
                }
            }
        }
        row
    }
}
