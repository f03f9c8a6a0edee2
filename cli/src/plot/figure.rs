//! A figure: an SVG document that is drawn once, then written as it is or rasterized by resvg. Texts are the
//! outlines of their letters in the font that is compiled in, each with its words as `aria-label`, so that a
//! figure looks the same in every viewer, whatever fonts it finds. Images lie below all else; the rasterizer
//! gets them as pixels, so that resvg needs neither its image decoders nor its text shaping, which take
//! longer to compile than all else of it.

use super::color::Rgb;
use super::text::Text;
use base64::Engine;
use base64::engine::general_purpose::STANDARD as BASE64;
use image::RgbImage;
use resvg::{tiny_skia, usvg};
use svg::Node;
use svg::node::element::{Circle, Group, Image, Line, Path, Polygon, Polyline, Rectangle, SVG, Title};

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

/// Where a text's anchor lies along its line.
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
#[derive(Clone, Copy, Debug)]
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

/// An SVG document in the making. A unit is a pixel of the PNG.
pub struct Figure {
    width: i32,
    height: i32,
    title: String,
    images: Vec<([i32; 2], RgbImage)>,
    body: Group,
}

impl Figure {
    /// A white page.
    pub fn new(width: i32, height: i32) -> Self {
        let (width, height) = (width.max(1), height.max(1));
        Figure { width, height, title: String::new(), images: Vec::new(), body: Group::new() }
    }

    /// Figures one below the other.
    pub fn below(figures: Vec<Figure>) -> Figure {
        let width = figures.iter().map(|f| f.width).max().unwrap_or(1);
        let mut all = Figure::new(width, figures.iter().map(|f| f.height).sum());
        all.title = figures.first().map(|f| f.title.clone()).unwrap_or_default();
        let mut y = 0;
        for figure in figures {
            all.images.extend(figure.images.into_iter().map(|(at, image)| ([at[0], at[1] + y], image)));
            all.body.append(figure.body.set("transform", format!("translate(0 {y})")));
            y += figure.height;
        }
        all
    }

    /// Width and height [pixels].
    pub fn size(&self) -> (i32, i32) {
        (self.width, self.height)
    }

    /// Says what the figure shows, for readers that do not look at it.
    pub fn set_title(&mut self, markup: &str) {
        self.title = Text::parse(markup).plain();
    }

    /// Fills a rectangle.
    pub fn fill(&mut self, at: Panel, color: Rgb) {
        self.body.append(rectangle(at).set("fill", hex(color)));
    }

    /// Frame of one unit around a rectangle.
    pub fn frame(&mut self, at: Panel, color: Rgb) {
        let around = rectangle(Panel { w: at.w + 1, h: at.h + 1, ..at }).set("x", f64::from(at.x) - 0.5);
        let around = around.set("y", f64::from(at.y) - 0.5);
        self.body.append(around.set("fill", "none").set("stroke", hex(color)));
    }

    /// A straight line; dashed where `dash` is above 0.
    pub fn line(&mut self, a: [f64; 2], b: [f64; 2], color: Rgb, dash: f64) {
        let mut line = Line::new().set("x1", short(a[0])).set("y1", short(a[1]));
        line = line.set("x2", short(b[0])).set("y2", short(b[1])).set("stroke", hex(color));
        if dash > 0.0 {
            line = line.set("stroke-dasharray", dash);
        }
        self.body.append(line);
    }

    /// A curve through points; points that are no numbers are left out.
    pub fn curve(&mut self, points: impl IntoIterator<Item = [f64; 2]>, width: f64, color: Rgb) {
        let curve = Polyline::new().set("points", list(points)).set("fill", "none").set("stroke", hex(color));
        self.body.append(curve.set("stroke-width", short(width)).set("stroke-linejoin", "round"));
    }

    /// The area within points.
    pub fn area(&mut self, points: impl IntoIterator<Item = [f64; 2]>, color: Rgb, opacity: f64) {
        let area = Polygon::new().set("points", list(points)).set("fill", hex(color));
        self.body.append(area.set("fill-opacity", opacity));
    }

    /// A filled circle.
    pub fn dot(&mut self, center: [f64; 2], radius: f64, color: Rgb) {
        self.body.append(circle(center, radius).set("fill", hex(color)));
    }

    /// A circle's outline.
    pub fn ring(&mut self, center: [f64; 2], radius: f64, width: f64, color: Rgb) {
        let ring = circle(center, radius).set("fill", "none").set("stroke", hex(color));
        self.body.append(ring.set("stroke-width", width));
    }

    /// Fills a rectangle with an embedded image, one pixel a unit: `color(column, row)`, the first row at the
    /// top.
    pub fn pixels(&mut self, at: Panel, mut color: impl FnMut(i32, i32) -> Rgb) {
        let image = RgbImage::from_fn(at.w as u32, at.h as u32, |i, j| image::Rgb(color(i as i32, j as i32)));
        self.images.push(([at.x, at.y], image));
    }

    /// Draws with everything cut off that leaves `at`. Coordinates stay the page's; images are not for here.
    pub fn clipped(&mut self, at: Panel, draw: impl FnOnce(&mut Figure)) {
        let mut inner = Figure::new(self.width, self.height);
        draw(&mut inner);
        let window = SVG::new().set("x", at.x).set("y", at.y).set("width", at.w).set("height", at.h);
        self.body.append(window.set("viewBox", (at.x, at.y, at.w, at.h)).add(inner.body));
    }

    /// Writes a line of text, the top of its capitals at `y`.
    pub fn text(&mut self, x: i32, y: i32, markup: &str, align: Align, color: Rgb) {
        self.text_within(x, y, i32::MAX, markup, align, color);
    }

    /// As [`Self::text`], shortened to `room` units.
    pub fn text_within(&mut self, x: i32, y: i32, room: i32, markup: &str, align: Align, color: Rgb) {
        let text = Text::parse(markup).shortened(f64::from(room));
        self.write(&text, &format!("translate({x} {})", y + CAP), align, color);
    }

    /// A heading, shortened to `room` units.
    pub fn heading(&mut self, x: i32, y: i32, room: i32, markup: &str) {
        let text = Text::parse(markup).shortened(f64::from(room) / HEADING);
        self.write(&text, &format!("translate({x} {}) scale({HEADING})", y + CAP), Align::Left, INK);
    }

    /// Text that runs upwards and is centered at `y`, its capitals reaching from `x` to the right, shortened
    /// to `room` units.
    pub fn text_up(&mut self, x: i32, y: i32, room: i32, markup: &str) {
        let text = Text::parse(markup).shortened(f64::from(room));
        self.write(&text, &format!("translate({} {y}) rotate(-90)", x + CAP), Align::Center, INK);
    }

    fn write(&mut self, text: &Text, place: &str, align: Align, color: Rgb) {
        let words = text.plain();
        if words.trim().is_empty() {
            return;
        }
        let back = match align {
            Align::Left => 0.0,
            Align::Center => 0.5,
            Align::Right => 1.0,
        };
        let outline = Path::new().set("d", text.outline(-back * text.width())).set("fill", hex(color));
        self.body.append(outline.set("transform", place).set("role", "img").set("aria-label", words));
    }

    /// The document.
    pub fn svg(&self) -> String {
        let page = Rectangle::new().set("width", self.width).set("height", self.height).set("fill", hex(WHITE));
        let document = self.document().add(Title::new(self.title.clone())).add(page);
        let document = self.images.iter().fold(document, |document, (at, image)| document.add(embedded(*at, image)));
        document.add(self.body.clone()).to_string()
    }

    fn document(&self) -> SVG {
        let document = SVG::new().set("width", self.width).set("height", self.height);
        document.set("viewBox", (0, 0, self.width, self.height))
    }

    /// The document as pixels, sRGB.
    pub fn raster(&self) -> RgbImage {
        let (width, height) = (self.width as u32, self.height as u32);
        let mut page = RgbImage::from_pixel(width, height, image::Rgb(WHITE));
        for ([x, y], image) in &self.images {
            image::imageops::replace(&mut page, image, i64::from(*x), i64::from(*y));
        }
        let document = self.document().add(self.body.clone());
        let tree = usvg::Tree::from_str(&document.to_string(), &usvg::Options::default());
        let opaque: Vec<u8> = page.pixels().flat_map(|p| [p[0], p[1], p[2], 255]).collect();
        let pixmap = tiny_skia::IntSize::from_wh(width, height).and_then(|s| tiny_skia::Pixmap::from_vec(opaque, s));
        let (Ok(tree), Some(mut pixmap)) = (tree, pixmap) else {
            unreachable!("a figure is a well-formed document of some size");
        };
        resvg::render(&tree, tiny_skia::Transform::identity(), &mut pixmap.as_mut());
        // The page is opaque, so that nothing is premultiplied.
        for (to, from) in page.pixels_mut().zip(pixmap.pixels()) {
            to.0 = [from.red(), from.green(), from.blue()];
        }
        page
    }
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

fn rectangle(at: Panel) -> Rectangle {
    Rectangle::new().set("x", at.x).set("y", at.y).set("width", at.w).set("height", at.h)
}

fn circle(center: [f64; 2], radius: f64) -> Circle {
    Circle::new().set("cx", short(center[0])).set("cy", short(center[1])).set("r", short(radius))
}

fn hex([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// A coordinate in hundredths.
fn short(value: f64) -> f64 {
    (100.0 * value).round() / 100.0
}

fn list(points: impl IntoIterator<Item = [f64; 2]>) -> String {
    let finite = points.into_iter().filter(|p| p.iter().all(|v| v.is_finite()));
    finite.map(|[x, y]| format!("{},{}", short(x), short(y))).collect::<Vec<_>>().join(" ")
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
