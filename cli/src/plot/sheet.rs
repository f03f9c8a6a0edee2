//! Pages of a table or a model: maps, energy budgets and grids of numbers in sections one below the other.
//! Sections are measured first and drawn after.

use super::axes::{self, BELOW, LEFT, LogScale};
use super::budget::{self, Budget};
use super::figure::{Figure, LINE, Panel};
use super::grid::{self, Numbers};
use super::map::{self, Coloring, Field};
use super::page::{Head, page as with_head};
use plywave::ply::asg::Lobe;

const GAP: i32 = 14;

/// One map of a block.
pub struct Cell {
    /// Its values.
    pub field: Field,
    /// True for a signed difference.
    pub residual: bool,
    /// Lobes to draw over it.
    pub lobes: Vec<Lobe>,
    /// Incident latitude [rad], for the mark of the forward direction.
    pub theta_i: f64,
}

/// A grid of maps on one scale.
pub struct SheetBlock {
    /// Heading.
    pub title: String,
    /// Name of the density on the color bar.
    pub quantity: String,
    /// One title a column.
    pub columns: Vec<String>,
    /// One title a row, in one or two lines.
    pub rows: Vec<[String; 2]>,
    /// `cells[row][column]`.
    pub cells: Vec<Vec<Cell>>,
    /// Width of a map [pixels]; it is half as high.
    pub map_width: i32,
    /// Decades of the scale.
    pub decades: f64,
}

impl SheetBlock {
    fn has_residual(&self) -> bool {
        self.cells.iter().flatten().any(|c| c.residual)
    }

    fn width(&self) -> i32 {
        let n = self.columns.len() as i32;
        let bars = axes::BAR * (1 + self.has_residual() as i32);
        2 * LINE + LEFT + n * self.map_width + (n - 1) * GAP + 2 * GAP + bars
    }

    fn height(&self) -> i32 {
        let n = self.rows.len() as i32;
        2 * LINE + 6 + n * (self.map_width / 2) + (n - 1) * GAP + BELOW
    }

    /// The scale of the block: the densities' own top, table and fit alike.
    pub fn scale(&self) -> LogScale {
        let top = self.cells.iter().flatten().filter(|c| !c.residual).map(|c| c.field.top()).fold(0.0, f64::max);
        LogScale::above(top, self.decades)
    }

    fn draw(&self, figure: &mut Figure, x: i32, y: i32) {
        let scale = self.scale();
        let (w, h) = (self.map_width, self.map_width / 2);
        let left = x + 2 * LINE + LEFT;
        let top = y + 2 * LINE + 6;
        figure.heading(left, y, self.width() - 2 * LINE - LEFT, &self.title);
        for (c, title) in self.columns.iter().enumerate() {
            axes::above(figure, Panel { x: left + c as i32 * (w + GAP), y: top, w, h }, title);
        }
        for (r, row) in self.cells.iter().enumerate() {
            let panel_y = top + r as i32 * (h + GAP);
            for (k, title) in self.rows[r].iter().enumerate() {
                figure.text_up(x + k as i32 * LINE, panel_y + h / 2, h, title);
            }
            for (c, cell) in row.iter().enumerate() {
                let at = Panel { x: left + c as i32 * (w + GAP), y: panel_y, w, h };
                let coloring = if cell.residual { Coloring::Residual(scale) } else { Coloring::Density(scale) };
                map::draw(figure, at, &cell.field, coloring);
                if !cell.residual {
                    map::mark_forward(figure, at, cell.theta_i);
                }
                map::draw_lobes(figure, at, &cell.lobes);
                let below = (r + 1 == self.cells.len()).then_some(c == row.len() / 2);
                let at_left = (c == 0).then_some(r == self.cells.len() / 2);
                map::label(figure, at, below, at_left);
            }
        }
        let bars = left + self.columns.len() as i32 * (w + GAP) + GAP;
        let tall = (self.rows.len() as i32 * (h + GAP) - GAP).min(420);
        axes::density_bar(figure, [bars, top, tall], scale, &self.quantity);
        if self.has_residual() {
            axes::residual_bar(figure, [bars + axes::BAR, top, tall], scale, "fit - table [1/sr]");
        }
    }
}

/// A section of a page.
pub enum Section {
    /// Blocks of maps side by side.
    Maps(Vec<SheetBlock>),
    /// The energy budget, one panel a theta_i.
    Budgets {
        /// Panels.
        panels: Vec<Budget>,
        /// Absorption [1/um] that the absorbed part is shown at.
        sigma_per_um: f64,
    },
    /// Grids of numbers side by side on one color scale, each with its title.
    Grids(Vec<(String, Numbers)>),
}

const BUDGET_W: i32 = 250;
const BUDGET_H: i32 = 220;
const BUDGET_LEFT: i32 = 2 * LINE + LEFT;
const GRID_H: i32 = 260;

/// Width of a grid of numbers: room for a number in each column where that stays on the page.
fn grid_width(numbers: &Numbers) -> i32 {
    (42 * numbers.h_rel.len() as i32).clamp(300, 900)
}

impl Section {
    fn size(&self) -> (i32, i32) {
        match self {
            Section::Maps(blocks) => (
                blocks.iter().map(|b| b.width() + 2 * GAP).sum::<i32>() - 2 * GAP,
                blocks.iter().map(SheetBlock::height).max().unwrap_or(0),
            ),
            Section::Budgets { panels, .. } => {
                let n = panels.len() as i32;
                (BUDGET_LEFT + n * (BUDGET_W + GAP) + 40, 3 * LINE + 14 + BUDGET_H + BELOW)
            }
            Section::Grids(grids) => (
                grids.iter().map(|(_, n)| BUDGET_LEFT + grid_width(n) + axes::BAR + GAP).sum(),
                2 * LINE + GRID_H + BELOW,
            ),
        }
    }

    fn draw(&self, figure: &mut Figure, x: i32, y: i32) {
        match self {
            Section::Maps(blocks) => {
                let mut at = x;
                for block in blocks {
                    block.draw(figure, at, y);
                    at += block.width() + 2 * GAP;
                }
            }
            Section::Budgets { panels, sigma_per_um } => {
                let left = x + BUDGET_LEFT;
                figure.heading(left, y, i32::MAX, "Energy budget over h, share of the beam's power");
                budget::legend(figure, left, y + LINE + 6, *sigma_per_um);
                for (i, panel) in panels.iter().enumerate() {
                    let frame =
                        Panel { x: left + i as i32 * (BUDGET_W + GAP), y: y + 3 * LINE + 14, w: BUDGET_W, h: BUDGET_H };
                    budget::draw(figure, frame, panel, i == 0);
                }
            }
            Section::Grids(grids) => {
                let max = grids.iter().map(|(_, n)| n.max()).fold(0.0, f64::max).max(1e-9);
                let mut at = x;
                for (title, numbers) in grids {
                    let w = grid_width(numbers);
                    let frame = Panel { x: at + BUDGET_LEFT, y: y + 2 * LINE, w, h: GRID_H };
                    grid::draw(figure, frame, numbers, max, title);
                    at += BUDGET_LEFT + w + axes::BAR + GAP;
                }
            }
        }
    }
}

/// What the marks on the maps mean.
const MARKS: &str = "light from φ_o = 90°; ring: exact forward, ticks: the cone θ_o = -θ_i; dots: axes of lobes, larger with energy, arcs: half a standard deviation";

/// A page of sections; maps are accompanied by an explanation of their marks.
pub fn page(title: &str, particulars: &str, sections: &[Section]) -> Figure {
    let maps = sections.iter().any(|s| matches!(s, Section::Maps(_)));
    let mut head = Head { title: title.into(), particulars: vec![particulars.into()], ..Head::default() };
    head.particulars.extend(maps.then(|| MARKS.to_string()));
    let width = sections.iter().map(|s| s.size().0).max().unwrap_or(0);
    let height = sections.iter().map(|s| s.size().1 + 30).sum();
    with_head(&head, [width, height], |figure, x, mut y| {
        for section in sections {
            section.draw(figure, x, y);
            y += section.size().1 + 30;
        }
    })
}
