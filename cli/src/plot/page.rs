//! A page: a heading, lines of particulars and a legend, with what it shows below.

use super::color::Rgb;
use super::figure::{Align, CAP, Figure, GRAY, INK, LINE, Panel};
use super::text;

/// Margin of a page.
const MARGIN: i32 = 28;
/// Smallest and largest width of a page whose content is narrower than its texts.
const WIDTHS: [i32; 2] = [640, 1100];
/// Space above a legend.
const GAP: i32 = 6;
/// Distance from a name of a legend to the next swatch.
pub const NEXT: i32 = 24;
/// Width of a swatch with the space after it.
pub const SWATCH: i32 = 28;

/// Texts above the content, all in markup.
#[derive(Clone, Debug, Default)]
pub struct Head {
    /// Heading.
    pub title: String,
    /// Lines below it; wrapped where they are longer than the page is wide.
    pub particulars: Vec<String>,
    /// Names of the legend, with their colors.
    pub legend: Vec<(String, Rgb)>,
}

/// A page whose content is `width` by `height` units; `draw` gets its upper left corner.
pub fn page(head: &Head, [width, height]: [i32; 2], draw: impl FnOnce(&mut Figure, i32, i32)) -> Figure {
    let texts = head.particulars.iter().map(|p| text::width(p)).chain([text::width(&head.title) * 3 / 2]);
    let available = texts.max().unwrap_or(0).clamp(WIDTHS[0], WIDTHS[1]).max(width);
    let lines: Vec<String> = head.particulars.iter().flat_map(|p| text::wrap(p, available)).collect();
    let rows = legend_rows(&head.legend, available);
    let top = MARGIN + (1 + (lines.len() + rows) as i32) * LINE + 24 + GAP;
    let mut figure = Figure::new(2 * MARGIN + available, top + height + MARGIN);
    figure.set_title(&head.title);
    figure.heading(MARGIN, MARGIN - 4, available, &head.title);
    let mut y = MARGIN + LINE + 4;
    for line in &lines {
        figure.text_within(MARGIN, y, available, line, Align::Left, GRAY);
        y += LINE;
    }
    legend(&mut figure, [MARGIN, y + GAP], &head.legend, available);
    draw(&mut figure, MARGIN, top);
    figure
}

/// Positions of a legend's entries in rows of at most `available` units.
fn legend_places(names: &[(String, Rgb)], available: i32) -> Vec<[i32; 2]> {
    let mut at = [0, 0];
    let place = |(name, _): &(String, Rgb)| {
        let width = SWATCH + text::width(name);
        if at[0] > 0 && at[0] + width > available {
            at = [0, at[1] + 1];
        }
        let here = at;
        at[0] += width + NEXT;
        here
    };
    names.iter().map(place).collect()
}

/// Number of rows of a legend.
pub fn legend_rows(names: &[(String, Rgb)], available: i32) -> usize {
    legend_places(names, available).last().map_or(0, |at| at[1] as usize + 1)
}

/// Draws a legend, its first row's top at `(x, y)`.
pub fn legend(figure: &mut Figure, [x, y]: [i32; 2], names: &[(String, Rgb)], available: i32) {
    for ([dx, row], (name, color)) in legend_places(names, available).into_iter().zip(names) {
        let (x, y) = (x + dx, y + row * LINE);
        figure.fill(Panel { x, y: y + 1, w: SWATCH - 8, h: CAP - 2 }, *color);
        figure.text_within(x + SWATCH, y, available - SWATCH, name, Align::Left, INK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Long titles and legends stay on the page, lines of particulars are wrapped.
    #[test]
    fn heads_stay_on_the_page() {
        let head = Head {
            title: "W".repeat(200),
            particulars: vec!["many words ".repeat(60)],
            legend: (0..40).map(|i| (format!("name {i}"), [0, 0, 0])).collect(),
        };
        let mut top = 0;
        let image = page(&head, [300, 50], |_, _, y| top = y).raster();
        assert_eq!(image.width() as i32, WIDTHS[1] + 2 * MARGIN);
        let edge = image.width() - MARGIN as u32 / 2;
        assert!(image.enumerate_pixels().all(|(x, _, p)| x < edge || p.0 == [255, 255, 255]));
        let places = legend_places(&head.legend, 500);
        let end = |k: usize| places[k][0] + SWATCH + text::width(&head.legend[k].0);
        assert!((0..40).all(|k| end(k) <= 500) && legend_rows(&head.legend, 500) > 5);
        assert!(top > MARGIN + 10 * LINE);
    }
}
