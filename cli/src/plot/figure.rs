//! A figure: shapes on a white page, written as an SVG document or as pixels. Every shape is a path, filled
//! or stroked, so that both outputs draw the same outlines. Texts are the outlines of their letters in the
//! font that is compiled in, each with its words as `aria-label`: a figure looks the same in every viewer,
//! whatever fonts it finds. Images lie below all shapes.

use super::color::Rgb;
use super::path::{Path, Transform};
use super::text::Text;
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use image::RgbImage;
use svg::Node;
use svg::node::element::{Image, Rectangle, SVG, Title};
use tiny_skia::{FillRule, LineJoin, Mask, Paint, PathBuilder, Pixmap, Rect, Stroke, StrokeDash};

/// Paper of every figure.
pub const WHITE: Rgb = [255, 255, 255];
/// Text and frames.
pub const INK: Rgb = [32, 32, 38];
/// Secondary text and ticks.
pub const GRAY: Rgb = [96, 96, 104];
/// Height of a line of capitals.
pub const CAP: i32 = 11;
/// From one line of text to the next.
pub const LINE: i32 = 20;
/// Size of headings over that of other text.
const HEADING: f64 = 1.3;

/// Position of a text's anchor along its line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Align {
    /// At its start.
    Left,
    /// In its middle.
    Center,
    /// At its end.
    Right,
}

/// A rectangle of `w` by `h` units with its upper left corner at `(x, y)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Panel {
    /// Left edge.
    pub x: i32,
    /// Upper edge.
    pub y: i32,
    /// Width.
    pub w: i32,
    /// Height.
    pub h: i32,
}

impl Panel {
    /// Its outline, grown by `out` on each side.
    fn outline(self, out: f64) -> Path {
        let [x, y, w, h] = [self.x, self.y, self.w, self.h].map(f64::from);
        Path::rectangle([x - out, y - out], [x + w + out, y + h + out])
    }
}

/// Paint of a path.
#[derive(Clone, Copy, Debug)]
enum Style {
    /// Fills the interior.
    Fill { opacity: f64 },
    /// Strokes the outline; dashed if `dash` is positive.
    Stroke { width: f64, dash: f64 },
}

/// A path with its paint.
#[derive(Clone, Debug)]
struct Shape {
    path: Path,
    style: Style,
    color: Rgb,
    /// The words of a text.
    label: Option<String>,
    /// Clipping rectangle.
    clip: Option<Panel>,
}

/// A figure under construction. A unit is a pixel of the PNG.
pub struct Figure {
    width: i32,
    height: i32,
    title: String,
    images: Vec<([i32; 2], RgbImage)>,
    shapes: Vec<Shape>,
}

impl Figure {
    /// A white page.
    pub fn new(width: i32, height: i32) -> Self {
        let (width, height) = (width.max(1), height.max(1));
        Figure { width, height, title: String::new(), images: Vec::new(), shapes: Vec::new() }
    }

    /// Stacks figures vertically.
    pub fn below(figures: Vec<Figure>) -> Figure {
        let width = figures.iter().map(|f| f.width).max().unwrap_or(1);
        let mut all = Figure::new(width, figures.iter().map(|f| f.height).sum());
        all.title = figures.first().map(|f| f.title.clone()).unwrap_or_default();
        let mut y = 0;
        for figure in figures {
            all.images.extend(figure.images.into_iter().map(|(at, image)| ([at[0], at[1] + y], image)));
            let down = Transform { shift: [0.0, f64::from(y)], ..Transform::NONE };
            all.shapes.extend(figure.shapes.into_iter().map(|shape| Shape {
                path: shape.path.transformed(&down),
                clip: shape.clip.map(|clip| Panel { y: clip.y + y, ..clip }),
                ..shape
            }));
            y += figure.height;
        }
        all
    }

    /// Width and height [pixels].
    pub fn size(&self) -> (i32, i32) {
        (self.width, self.height)
    }

    /// Sets the description for readers that cannot see the figure.
    pub fn set_title(&mut self, markup: &str) {
        self.title = Text::parse(markup).plain();
    }

    fn draw(&mut self, path: Path, style: Style, color: Rgb) {
        self.shapes.push(Shape { path, style, color, label: None, clip: None });
    }

    /// Fills a rectangle.
    pub fn fill(&mut self, at: Panel, color: Rgb) {
        self.draw(at.outline(0.0), Style::Fill { opacity: 1.0 }, color);
    }

    /// Frame of one unit around a rectangle.
    pub fn frame(&mut self, at: Panel, color: Rgb) {
        self.draw(at.outline(0.5), Style::Stroke { width: 1.0, dash: 0.0 }, color);
    }

    /// Draws a straight line; dashed if `dash` is positive.
    pub fn line(&mut self, a: [f64; 2], b: [f64; 2], color: Rgb, dash: f64) {
        self.draw(Path::lines([a, b]), Style::Stroke { width: 1.0, dash }, color);
    }

    /// Draws a curve through points; NaN points are skipped.
    pub fn curve(&mut self, points: impl IntoIterator<Item = [f64; 2]>, width: f64, color: Rgb) {
        self.draw(Path::lines(points), Style::Stroke { width, dash: 0.0 }, color);
    }

    /// Fills the polygon of points.
    pub fn area(&mut self, points: impl IntoIterator<Item = [f64; 2]>, color: Rgb, opacity: f64) {
        self.draw(Path::lines(points).closed(), Style::Fill { opacity }, color);
    }

    /// A filled circle.
    pub fn dot(&mut self, center: [f64; 2], radius: f64, color: Rgb) {
        self.draw(Path::circle(center, radius), Style::Fill { opacity: 1.0 }, color);
    }

    /// A circle's outline.
    pub fn ring(&mut self, center: [f64; 2], radius: f64, width: f64, color: Rgb) {
        self.draw(Path::circle(center, radius), Style::Stroke { width, dash: 0.0 }, color);
    }

    /// Fills a rectangle with an embedded image, one pixel a unit: `color(column, row)`, the first row at the
    /// top.
    pub fn pixels(&mut self, at: Panel, mut color: impl FnMut(i32, i32) -> Rgb) {
        let image = RgbImage::from_fn(at.w as u32, at.h as u32, |i, j| image::Rgb(color(i as i32, j as i32)));
        self.images.push(([at.x, at.y], image));
    }

    /// Draws shapes clipped to `at`. Coordinates stay the page's; images cannot be clipped.
    pub fn clipped(&mut self, at: Panel, draw: impl FnOnce(&mut Figure)) {
        let mut inner = Figure::new(self.width, self.height);
        draw(&mut inner);
        self.shapes.extend(inner.shapes.into_iter().map(|shape| Shape { clip: Some(at), ..shape }));
    }

    /// Writes a line of text, the top of its capitals at `y`.
    pub fn text(&mut self, x: i32, y: i32, markup: &str, align: Align, color: Rgb) {
        self.text_within(x, y, i32::MAX, markup, align, color);
    }

    /// Writes text like [`Self::text`], shortened to `available` units.
    pub fn text_within(&mut self, x: i32, y: i32, available: i32, markup: &str, align: Align, color: Rgb) {
        let text = Text::parse(markup).shortened(f64::from(available));
        self.write(&text, [x, y + CAP], Transform::NONE, align, color);
    }

    /// Writes a heading, shortened to `available` units.
    pub fn heading(&mut self, x: i32, y: i32, available: i32, markup: &str) {
        let text = Text::parse(markup).shortened(f64::from(available) / HEADING);
        self.write(&text, [x, y + CAP], Transform { scale: HEADING, ..Transform::NONE }, Align::Left, INK);
    }

    /// Writes text that runs upwards, centered at `y`, with capitals extending from `x` to the right,
    /// shortened to `available` units.
    pub fn text_up(&mut self, x: i32, y: i32, available: i32, markup: &str) {
        let text = Text::parse(markup).shortened(f64::from(available));
        self.write(&text, [x + CAP, y], Transform { upwards: true, ..Transform::NONE }, Align::Center, INK);
    }

    fn write(&mut self, text: &Text, at: [i32; 2], turn: Transform, align: Align, color: Rgb) {
        let words = text.plain();
        if words.trim().is_empty() {
            return;
        }
        let back = match align {
            Align::Left => 0.0,
            Align::Center => 0.5,
            Align::Right => 1.0,
        };
        let path = text.outline(-back * text.width()).transformed(&Transform { shift: at.map(f64::from), ..turn });
        self.shapes.push(Shape { path, style: Style::Fill { opacity: 1.0 }, color, label: Some(words), clip: None });
    }

    /// The figure as an SVG document.
    pub fn svg(&self) -> String {
        let page = Rectangle::new().set("width", self.width).set("height", self.height).set("fill", hex(WHITE));
        let document = SVG::new().set("width", self.width).set("height", self.height);
        let document = document.set("viewBox", (0, 0, self.width, self.height));
        let document = document.add(Title::new(self.title.clone())).add(page);
        let mut document =
            self.images.iter().fold(document, |document, (at, image)| document.add(embedded(*at, image)));
        for shapes in self.shapes.chunk_by(|a, b| a.clip == b.clip) {
            let elements = shapes.iter().map(Shape::element);
            match shapes[0].clip {
                None => elements.for_each(|element| document.append(element)),
                Some(at) => {
                    let window = SVG::new().set("x", at.x).set("y", at.y).set("width", at.w).set("height", at.h);
                    let window = window.set("viewBox", (at.x, at.y, at.w, at.h));
                    document.append(elements.fold(window, SVG::add));
                }
            }
        }
        document.to_string()
    }

    /// The figure as pixels, sRGB.
    pub fn raster(&self) -> RgbImage {
        let (width, height) = (self.width as u32, self.height as u32);
        let mut page = RgbImage::from_pixel(width, height, image::Rgb(WHITE));
        for ([x, y], image) in &self.images {
            image::imageops::replace(&mut page, image, i64::from(*x), i64::from(*y));
        }
        let opaque: Vec<u8> = page.pixels().flat_map(|p| [p[0], p[1], p[2], 255]).collect();
        let size = tiny_skia::IntSize::from_wh(width, height);
        let Some(mut pixmap) = size.and_then(|size| Pixmap::from_vec(opaque, size)) else {
            unreachable!("a figure has a size");
        };
        for shapes in self.shapes.chunk_by(|a, b| a.clip == b.clip) {
            let mask = shapes[0].clip.map(|clip| window(clip, width, height));
            shapes.iter().for_each(|shape| shape.paint(&mut pixmap, mask.as_ref()));
        }
        // The page is opaque, so that nothing is premultiplied.
        for (to, from) in page.pixels_mut().zip(pixmap.pixels()) {
            to.0 = [from.red(), from.green(), from.blue()];
        }
        page
    }
}

impl Shape {
    /// The shape as an element of SVG.
    fn element(&self) -> svg::node::element::Path {
        let element = svg::node::element::Path::new().set("d", self.path.data());
        let element = match self.style {
            Style::Fill { opacity: 1.0 } => element.set("fill", hex(self.color)),
            Style::Fill { opacity } => element.set("fill", hex(self.color)).set("fill-opacity", opacity),
            Style::Stroke { width, dash } => {
                let line = element.set("fill", "none").set("stroke", hex(self.color)).set("stroke-width", width);
                let line = line.set("stroke-linejoin", "round");
                if dash > 0.0 { line.set("stroke-dasharray", dash) } else { line }
            }
        };
        match &self.label {
            Some(words) => element.set("role", "img").set("aria-label", words.clone()),
            None => element,
        }
    }

    /// Paints the shape. A path without extent paints nothing.
    fn paint(&self, pixmap: &mut Pixmap, mask: Option<&Mask>) {
        let Some(path) = self.path.outline() else { return };
        let mut paint = Paint::default();
        let opacity = match self.style {
            Style::Fill { opacity } => opacity,
            Style::Stroke { .. } => 1.0,
        };
        let [r, g, b] = self.color;
        paint.set_color_rgba8(r, g, b, (255.0 * opacity).round() as u8);
        match self.style {
            Style::Fill { .. } => {
                pixmap.fill_path(&path, &paint, FillRule::Winding, tiny_skia::Transform::identity(), mask);
            }
            Style::Stroke { width, dash } => {
                let dash = (dash > 0.0).then(|| StrokeDash::new(vec![dash as f32; 2], 0.0)).flatten();
                let stroke = Stroke { width: width as f32, line_join: LineJoin::Round, dash, ..Stroke::default() };
                pixmap.stroke_path(&path, &paint, &stroke, tiny_skia::Transform::identity(), mask);
            }
        }
    }
}

/// The pixels of a rectangle, of a page of this size.
fn window(at: Panel, width: u32, height: u32) -> Mask {
    let (Some(mut mask), Some(rectangle)) =
        (Mask::new(width, height), Rect::from_xywh(at.x as f32, at.y as f32, at.w.max(0) as f32, at.h.max(0) as f32))
    else {
        unreachable!("a figure has a size, and so has a panel");
    };
    let path = PathBuilder::from_rect(rectangle);
    mask.fill_path(&path, FillRule::Winding, false, tiny_skia::Transform::identity());
    mask
}

/// An image as an element, its pixels as PNG.
fn embedded([x, y]: [i32; 2], image: &RgbImage) -> Image {
    let mut png = Vec::new();
    // Writing to memory fails for sizes alone that no panel has.
    let _ = image.write_to(&mut std::io::Cursor::new(&mut png), image::ImageFormat::Png);
    let element = Image::new().set("x", x).set("y", y).set("width", image.width()).set("height", image.height());
    let href = format!("data:image/png;base64,{}", BASE64.encode(&png));
    element.set("image-rendering", "optimizeSpeed").set("href", href)
}

fn hex([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The document can be read and says its texts, also those that mean something in XML; shapes and images
    /// lie where they belong.
    #[test]
    fn documents_say_their_texts() {
        let mut figure = Figure::new(300, 80);
        figure.set_title("Ångström, Żółw & 絹 <f_{high}>");
        figure.text(10, 10, "\"Żółw\" & θ_i", Align::Left, INK);
        figure.clipped(Panel { x: 100, y: 40, w: 20, h: 20 }, |inner| {
            inner.fill(Panel { x: 0, y: 0, w: 300, h: 80 }, [200, 0, 0]);
        });
        figure.pixels(Panel { x: 200, y: 40, w: 2, h: 2 }, |i, j| [[10, 20, 30], [40, 50, 60]][usize::from(i == j)]);
        let text = figure.svg();
        let document = roxmltree::Document::parse(&text).unwrap_or_else(|e| panic!("{e}"));
        let title = document.descendants().find(|n| n.tag_name().name() == "title").and_then(|n| n.text());
        assert_eq!(title, Some("Ångström, Żółw & 絹 <fhigh>"));
        let label = document.descendants().find_map(|n| n.attribute("aria-label"));
        assert_eq!(label, Some("\"Żółw\" & θi"));
        let image = figure.raster();
        assert_eq!(image.dimensions(), (300, 80));
        let red = image.enumerate_pixels().filter(|(_, _, p)| p.0 == [200, 0, 0]);
        assert_eq!(red.map(|(x, y, _)| (x, y)).max(), Some((119, 59)));
        assert_eq!(image.pixels().filter(|p| p.0 == [200, 0, 0]).count(), 400);
        let at = |x, y| image.get_pixel(x, y).0;
        assert_eq!([at(200, 40), at(201, 40), at(200, 41)], [[40, 50, 60], [10, 20, 30], [10, 20, 30]]);
    }

    /// Letters of all that the font has leave ink of their own; what it lacks shows as a box.
    #[test]
    fn letters_are_drawn() {
        let ink = |text: &str| {
            let mut figure = Figure::new(60, 30);
            figure.text(10, 10, text, Align::Left, [0, 0, 0]);
            figure.raster().into_raw()
        };
        let blank = Figure::new(60, 30).raster().into_raw();
        let missing = ink("絹");
        assert_ne!(missing, blank);
        for text in ["A", "Å", "ż", "ß", "θ", "Σ", "Ж", "ї", "½", "−", "≥"] {
            assert!(ink(text) != blank && ink(text) != missing, "{text}");
        }
    }
}
