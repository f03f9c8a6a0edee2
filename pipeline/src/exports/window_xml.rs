//! Writes BSDF files for LBNL WINDOW and Radiance: a matrix between the patches of Klems, or Radiance's
//! tensor tree.
//!
//! The schema is version 1.7 of `WindowElement`, with the cloth's face as the front. The values of a block
//! are the BSDF [1/sr]; columns of a matrix are incident patches, rows outgoing ones. A tensor tree orders
//! the coordinates of incident light before those of outgoing light: the first coordinate is the lowest bit
//! in the number of a branch, while among the values in one pair of braces the last coordinate is the
//! fastest. Cubes whose values agree within a tolerance are merged.

use super::basis::{Basis, KLEMS_RINGS};
use super::heat::Heat;
use super::matrix::{BAND_NAMES, Matrix};
use std::fmt::Write;

/// Data about the cloth for the file's header.
pub struct About<'a> {
    /// Name of the cloth.
    pub name: &'a str,
    /// Thermal quantities of the cloth.
    pub heat: &'a Heat,
    /// Notes on its origin and assumptions.
    pub notes: &'a [String],
}

/// Text with XML entities escaped.
pub fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// Names of the side of incidence, and of the halves.
const SIDES: [&str; 2] = ["Front", "Back"];
const HALVES: [(&str, &str); 2] = [("Reflection", "BRDF"), ("Transmission", "BTDF")];
/// Spectra of source and detector, by band.
const SPECTRA: [[&str; 2]; 2] = [["CIE Illuminant D65 1nm.ssp", "ASTM E308 1931 Y.dsp"], ["EN 410 Table 2", "None"]];

/// The XML file of a matrix. A tensor tree merges values that differ by less than `tolerance` of the largest
/// value around them.
pub fn xml(matrix: &Matrix, about: &About<'_>, tolerance: f64) -> String {
    let is_tree = matrix.basis != Basis::Klems;
    let mut out = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <WindowElement xmlns=\"http://windows.lbl.gov\" xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
         xsi:schemaLocation=\"http://windows.lbl.gov/BSDF-v1.7.xsd\">\n",
    );
    for note in about.notes {
        // Two hyphens would end an XML comment.
        let _ = writeln!(out, "<!-- {} -->", escaped(note).replace("--", "- -"));
    }
    let name = escaped(about.name);
    let _ = write!(
        out,
        "<WindowElementType>System</WindowElementType>\n<FileType>BSDF</FileType>\n<Optical>\n<Layer>\n<Material>\n\
         <Name>{name}</Name>\n<Manufacturer>plywave</Manufacturer>\n<Thickness unit=\"meter\">{:.9}</Thickness>\n\
         <Width unit=\"meter\">1.0</Width>\n<Height unit=\"meter\">1.0</Height>\n<DeviceType>Other</DeviceType>\n{}\
         </Material>\n<DataDefinition>\n<IncidentDataStructure>{}</IncidentDataStructure>\n",
        1e-6 * about.heat.thickness_um,
        thermal_fields(about.heat),
        if is_tree { "TensorTree4" } else { "Columns" }
    );
    if !is_tree {
        klems_basis(&mut out);
    }
    out.push_str("</DataDefinition>\n");
    for (band, name) in BAND_NAMES.into_iter().enumerate() {
        for (half, (direction, kind)) in HALVES.into_iter().enumerate().rev() {
            for (side, from) in SIDES.into_iter().enumerate() {
                let [source, detector] = SPECTRA[band];
                let _ = write!(
                    out,
                    "<WavelengthData>\n<LayerNumber>System</LayerNumber>\n<Wavelength unit=\"Integral\">{name}</Wavelength>\n\
                     <SourceSpectrum>{source}</SourceSpectrum>\n<DetectorSpectrum>{detector}</DetectorSpectrum>\n\
                     <WavelengthDataBlock>\n<WavelengthDataDirection>{direction} {from}</WavelengthDataDirection>\n"
                );
                out.push_str(match is_tree {
                    true => "<AngleBasis>LBNL/Shirley-Chiu</AngleBasis>\n",
                    false => {
                        "<ColumnAngleBasis>LBNL/Klems Full</ColumnAngleBasis>\n\
                         <RowAngleBasis>LBNL/Klems Full</RowAngleBasis>\n"
                    }
                });
                let _ = writeln!(out, "<ScatteringDataType>{kind}</ScatteringDataType>\n<ScatteringData>");
                let values = &matrix.blocks[side][half].values[band];
                match matrix.basis {
                    Basis::Klems => {
                        for row in values.chunks(matrix.basis.len()) {
                            let row: Vec<String> = row.iter().map(|v| format!("{v:.6e}")).collect();
                            let _ = writeln!(out, "{},", row.join(","));
                        }
                    }
                    Basis::Squares { side } => tree(&mut out, values, side, [0; 4], side, tolerance),
                }
                out.push_str("</ScatteringData>\n</WavelengthDataBlock>\n</WavelengthData>\n");
            }
        }
    }
    out.push_str("</Layer>\n</Optical>\n</WindowElement>\n");
    out
}

/// Fields of a material in the schema's order; all values except the conductivity [W/(m K)] are fractions of
/// 1.
fn thermal_fields(heat: &Heat) -> String {
    let [front, back] = heat.emissivity;
    [
        ("ThermalConductivity", heat.conductivity),
        ("EmissivityFront", front),
        ("EmissivityBack", back),
        ("TIR", heat.ir_transmittance),
        ("PermeabilityFactor", heat.permeability),
    ]
    .map(|(name, value)| format!("<{name}>{value:.6}</{name}>\n"))
    .concat()
}

fn klems_basis(out: &mut String) {
    out.push_str("<AngleBasis>\n<AngleBasisName>LBNL/Klems Full</AngleBasisName>\n");
    let mut low = 0.0;
    for (ring, (high, count)) in KLEMS_RINGS.into_iter().enumerate() {
        let theta = if ring == 0 { 0.0 } else { 0.5 * (low + high) };
        let _ = write!(
            out,
            "<AngleBasisBlock>\n<Theta>{theta}</Theta>\n<nPhis>{count}</nPhis>\n<ThetaBounds>\n\
             <LowerTheta>{low}</LowerTheta>\n<UpperTheta>{high}</UpperTheta>\n</ThetaBounds>\n</AngleBasisBlock>\n"
        );
        low = high;
    }
    out.push_str("</AngleBasis>\n");
}

/// Writes the cube of `size` squares along each axis that starts at `first`: one value if it is uniform, else
/// its sixteen parts; single squares are written together.
fn tree(out: &mut String, values: &[f64], side: usize, first: [usize; 4], size: usize, tolerance: f64) {
    let n = side * side;
    let at = |i: [usize; 4]| values[(i[3] * side + i[2]) * n + i[1] * side + i[0]];
    let corner = |k: usize, step: usize| std::array::from_fn(|d| first[d] + step * (k >> d & 1));
    let (mut sum, mut low, mut high) = (0.0, f64::INFINITY, 0.0f64);
    for k in 0..size.pow(4) {
        let mut rest = k;
        let value = at(first.map(|f| {
            let i = f + rest % size;
            rest /= size;
            i
        }));
        (sum, low, high) = (sum + value, low.min(value), high.max(value));
    }
    if size == 1 || high - low <= tolerance * high {
        let _ = writeln!(out, "{{ {:.5e} }}", sum / size.pow(4) as f64);
    } else if size == 2 {
        out.push('{');
        for k in 0..16 {
            // The last coordinate is the fastest within one pair of braces.
            let _ = write!(out, " {:.5e}", at(corner((k as u8).reverse_bits() as usize >> 4, 1)));
        }
        out.push_str(" }\n");
    } else {
        out.push_str("{\n");
        (0..16).for_each(|k| tree(out, values, side, corner(k, size / 2), size / 2, tolerance));
        out.push_str("}\n");
    }
}
