//! Reader and writer of TexGen models (`.tg3`): XML with the yarns of a textile.
//!
//! The reader uses these elements: `Textile` (GeometryScale), `Interpolation` (type), `MasterNode` (Position,
//! Up), `Repeat` (value), and the sections of `YarnSection` (type, Width and Height). It ignores all others.
//! TexGen: L. P. Brown and A. C. Long, "Modelling the geometry of textile reinforcements for composites:
//! TexGen", in P. Boisse (ed.), Composite reinforcements for optimum performance, 2nd ed. (2021).

use roxmltree::{Document, Node, ParsingOptions};
use std::fmt::Write;

/// Maximum number of nodes over all yarns.
const MAX_NODES: usize = 1 << 20;

/// Units of length by their names in models, in um.
const UNITS: &[(&str, f64)] = &[
    ("mm", 1e3),
    ("m", 1e6),
    ("dm", 1e5),
    ("cm", 1e4),
    ("um", 1.0),
    ("\u{b5}m", 1.0),
    ("\u{3bc}m", 1.0),
    ("nm", 1e-3),
    ("in", 25_400.0),
    ("inch", 25_400.0),
];

/// A yarn.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tg3Yarn {
    /// Master nodes.
    pub nodes: Vec<[f64; 3]>,
    /// Direction that is up in the section of each node.
    pub ups: Vec<[f64; 3]>,
    /// Translation vectors by which the yarn repeats.
    pub repeats: Vec<[f64; 3]>,
    /// Mean width and height of its sections; 0 if the file has none.
    pub width: f64,
    pub height: f64,
    /// Whether all of its sections are ellipses.
    pub is_elliptical: bool,
    /// Whether its nodes are interpolated by cubic curves.
    pub is_cubic: bool,
}

/// A model with one textile.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tg3 {
    pub name: String,
    /// Name of the unit of its lengths.
    pub scale: String,
    pub yarns: Vec<Tg3Yarn>,
}

impl Tg3 {
    /// Its unit of length [um]; `None` if the name is unknown.
    pub fn um_per_unit(&self) -> Option<f64> {
        UNITS.iter().find(|(name, _)| self.scale.trim().eq_ignore_ascii_case(name)).map(|(_, um)| *um)
    }
}

fn numbers(node: Node<'_, '_>, name: &str) -> Result<[f64; 3], String> {
    let text = node.attribute(name).unwrap_or_default();
    let parts: Option<Vec<f64>> =
        text.split(',').map(|part| part.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    let parts = parts.and_then(|parts| <[f64; 3]>::try_from(parts).ok());
    parts.ok_or_else(|| {
        let what = node.tag_name().name();
        format!("{name} of a {what} is {:?}, not three numbers", text.chars().take(40).collect::<String>())
    })
}

fn number(node: Node<'_, '_>, name: &str) -> f64 {
    let value = node.attribute(name).and_then(|text| text.trim().parse().ok()).filter(|x: &f64| x.is_finite());
    value.unwrap_or(0.0).max(0.0)
}

/// Reads the first textile of a file. The error describes what is wrong with the file.
pub(super) fn read(text: &str) -> Result<Tg3, String> {
    let options = ParsingOptions { nodes_limit: 1 << 24, ..ParsingOptions::default() };
    let document = Document::parse_with_options(text, options).map_err(|e| {
        // The parser's message quotes the text and can be long.
        let what = plywave::one_line(&e.to_string(), 160);
        format!("it is not XML: {what}")
    })?;
    let textile = document.descendants().find(|node| node.has_tag_name("Textile"));
    let textile = textile.ok_or("it has no Textile")?;
    let mut yarns = Vec::new();
    let mut count = 0;
    for yarn in textile.children().filter(|node| node.has_tag_name("Yarn")) {
        let nodes = yarn.children().filter(|node| node.has_tag_name("MasterNode"));
        // A section without a direction stands upright.
        let up = |node: Node<'_, '_>| numbers(node, "Up").unwrap_or([0.0, 0.0, 1.0]);
        let (nodes, ups): (Vec<_>, Vec<_>) = nodes.map(|node| (numbers(node, "Position"), up(node))).unzip();
        let nodes = nodes.into_iter().collect::<Result<Vec<_>, _>>()?;
        let repeats = yarn.children().filter(|node| node.has_tag_name("Repeat"));
        let repeats = repeats.map(|node| numbers(node, "value")).collect::<Result<Vec<_>, _>>()?;
        // A section that changes along the yarn is replaced by its mean.
        let sections: Vec<Node<'_, '_>> = yarn.descendants().filter(|node| node.has_tag_name("Section")).collect();
        let count_of = sections.len().max(1) as f64;
        let [width, height] = ["Width", "Height"]
            .map(|name| sections.iter().map(|section| number(*section, name)).sum::<f64>() / count_of);
        let type_of = |node: Node<'_, '_>| node.attribute("type").unwrap_or_default().to_string();
        let is_elliptical = sections.iter().all(|section| type_of(*section) == "CSectionEllipse");
        let is_cubic = yarn
            .children()
            .filter(|node| node.has_tag_name("Interpolation"))
            .all(|node| type_of(node) == "CInterpolationCubic");
        count += nodes.len();
        if count > MAX_NODES {
            return Err(format!("it has more than {MAX_NODES} nodes"));
        }
        yarns.push(Tg3Yarn { nodes, ups, repeats, width, height, is_elliptical, is_cubic });
    }
    if yarns.is_empty() {
        let hint = "in TexGen save it with full output";
        return Err(format!("its Textile has no Yarn: {hint}"));
    }
    let scale = textile.attribute("GeometryScale").map_or("mm".into(), |text| plywave::one_line(text, 40));
    Ok(Tg3 { name: textile.attribute("name").unwrap_or_default().into(), scale, yarns })
}

/// Writes a file with constant elliptical sections, periodic cubic curves and a box of one period as domain.
/// TexGen 3.14 opens it.
pub(super) fn write(tg3: &Tg3) -> String {
    let name: String = tg3.name.chars().filter(|c| !"<>&\"'".contains(*c) && !c.is_control()).collect();
    let xyz = |p: &[f64; 3]| format!("{:?}, {:?}, {:?}", p[0], p[1], p[2]);
    let mut out = String::new();
    // Writing to a string does not fail.
    let mut line = |text: std::fmt::Arguments<'_>| {
        let _ = out.write_fmt(format_args!("{text}\n"));
    };
    line(format_args!("<?xml version=\"1.0\" ?>\n<TexGenModel version=\"3.13.2\">"));
    line(format_args!(
        "<Textile name=\"{name}\" GeometryScale=\"{}\" type=\"CTextile\" NeedsBuilding=\"0\">",
        tg3.scale
    ));
    line(format_args!("<Domain type=\"CDomainPlanes\">"));
    let [low, high] = domain(&tg3.yarns);
    for axis in 0..3 {
        for (sign, d) in [(1.0, low[axis]), (-1.0, -high[axis])] {
            let normal = std::array::from_fn(|k| if k == axis { sign } else { 0.0 });
            line(format_args!("<Plane Normal=\"{}\" d=\"{d:?}\" />", xyz(&normal)));
        }
    }
    line(format_args!("</Domain>"));
    for (index, yarn) in tg3.yarns.iter().enumerate() {
        // TexGen samples the whole center line at so many points.
        let samples = (6 * yarn.nodes.len()).clamp(20, 100_000);
        let points = format_args!("NumSlaveNodes=\"{samples}\" NumSectionPoints=\"40\"");
        line(format_args!("<Yarn index=\"{index}\" {points} NeedsBuilding=\"7\">"));
        line(format_args!("<Interpolation Periodic=\"1\" type=\"CInterpolationCubic\" />"));
        line(format_args!("<YarnSection type=\"CYarnSectionConstant\">"));
        let size = format_args!("Width=\"{:?}\" Height=\"{:?}\"", yarn.width, yarn.height);
        line(format_args!("<Section type=\"CSectionEllipse\" {size} />"));
        line(format_args!("</YarnSection>"));
        for repeat in &yarn.repeats {
            line(format_args!("<Repeat value=\"{}\" />", xyz(repeat)));
        }
        for (i, node) in yarn.nodes.iter().enumerate() {
            let up = yarn.ups.get(i).copied().unwrap_or([0.0, 0.0, 1.0]);
            let place = format_args!("index=\"{i}\" Position=\"{}\"", xyz(node));
            line(format_args!("<MasterNode {place} Tangent=\"0, 0, 0\" Up=\"{}\" />", xyz(&up)));
        }
        line(format_args!("</Yarn>"));
    }
    line(format_args!("</Textile>\n</TexGenModel>"));
    out
}

/// Lower and upper corner of a box of one period.
fn domain(yarns: &[Tg3Yarn]) -> [[f64; 3]; 2] {
    let mut corners = [[0.0; 3]; 2];
    for axis in 0..3 {
        let repeats = yarns.iter().flat_map(|yarn| &yarn.repeats);
        let period = repeats.fold(0.0, |period: f64, repeat| period.max(repeat[axis].abs()));
        let reach = yarns.iter().map(|yarn| 0.55 * yarn.width.max(yarn.height)).fold(0.0, f64::max);
        let all = || yarns.iter().flat_map(|yarn| &yarn.nodes).map(|node| node[axis]);
        let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
        (corners[0][axis], corners[1][axis]) =
            if period > 0.0 { (low, low + period) } else { (low - reach, high + reach) };
    }
    corners
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Tg3 {
        let yarn = |y: f64| Tg3Yarn {
            nodes: (0..5).map(|i| [0.25 * f64::from(i), y, 0.1]).collect(),
            ups: vec![[0.0, 0.0, 1.0]; 5],
            repeats: vec![[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]],
            width: 0.5,
            height: 0.25,
            is_elliptical: true,
            is_cubic: true,
        };
        Tg3 { name: "plain".into(), scale: "mm".into(), yarns: vec![yarn(0.0), yarn(1.0)] }
    }

    #[test]
    fn lengths_have_the_unit_of_the_model() {
        for (scale, um) in [("m", 1e6), ("mm", 1e3), ("um", 1.0), ("\u{3bc}m", 1.0), ("nm", 1e-3), ("in", 25_400.0)] {
            let text = write(&sample()).replace("GeometryScale=\"mm\"", &format!("GeometryScale=\"{scale}\""));
            assert_eq!(read(&text).unwrap().um_per_unit(), Some(um), "{scale}");
        }
        let text = write(&sample());
        assert_eq!(read(&text.replace("GeometryScale=\"mm\" ", "")).unwrap().um_per_unit(), Some(1e3));
        assert_eq!(read(&text.replace("\"mm\"", "\"furlong\"")).unwrap().um_per_unit(), None);
    }

    #[test]
    fn files_come_back_and_damaged_ones_are_refused() {
        let text = write(&sample());
        assert_eq!(read(&text).unwrap(), sample());
        for end in (0..text.len() - 1).step_by(3) {
            let _ = read(&text[..end]);
        }
        for (from, to, want) in [
            ("</Yarn>", "", "not XML"),
            ("<Textile", "<Cloth", "not XML"),
            ("</Yarn>", "</Yarn\n=>", "not XML"),
            ("Position=\"0.25", "Position=\"nan", "not three numbers"),
            ("Position=\"0.25, ", "Position=\"", "not three numbers"),
            ("Repeat value", "Repeat other", "value of a Repeat"),
        ] {
            let message = read(&text.replacen(from, to, 1)).unwrap_err();
            assert!(message.contains(want) && message.lines().count() == 1, "{from}: {message}");
        }
        assert!(read("<TexGenModel/>").unwrap_err().contains("no Textile"));
        assert!(read("<TexGenModel><Textile/></TexGenModel>").unwrap_err().contains("full output"));
        let many = Tg3 { name: "<&\"".into(), ..sample() };
        assert_eq!(read(&write(&many)).unwrap().name, "");
    }
}
