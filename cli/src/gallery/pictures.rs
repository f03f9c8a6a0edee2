//! Which pictures there are, what is to be seen in each, and how they are rendered.

use super::materials::{Cloth, Ply};
use plywave::fabric::{FabricOptions, GapLight};
use plywave_render::Setup;

/// One render of a picture.
#[derive(Clone, Debug)]
pub struct Panel {
    /// Below it, where a picture has several.
    pub title: String,
    /// What is rendered.
    pub cloth: Cloth,
    /// In which scene.
    pub setup: Setup,
    /// Width of the cloth [mm].
    pub size_mm: f32,
    /// How it is shaded.
    pub options: FabricOptions,
    /// Stops by which it is brighter.
    pub exposure: f32,
    /// Samples a pixel over the gallery's usual.
    pub samples: u32,
}

/// A picture: panels side by side.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Name of the files.
    pub name: String,
    /// What is to be seen, a sentence or two.
    pub caption: String,
    /// From left to right.
    pub panels: Vec<Panel>,
}

const SMOOTH: FabricOptions = FabricOptions { gaps: GapLight::Diffracted, sigma_per_um: None, noise: false };
const NOISED: FabricOptions = FabricOptions { gaps: GapLight::Diffracted, sigma_per_um: None, noise: true };

/// The fabrics that ship: name, width of the cloth from the front [mm], stops from the front and from the back, what is to be seen from the front and from the back.
const FABRICS: [(&str, f32, [f32; 2], [&str; 2]); 5] = [
    (
        "polyester_satin",
        12.0,
        [0.0, -1.0],
        [
            "Polyester satin: long floats of the warp, which shine where they lean toward the lamp.",
            "The same before a lamp: next to no gaps, and those so narrow that they throw the lamp's light far to the sides.",
        ],
    ),
    (
        "cotton_twill",
        8.0,
        [0.8, -1.0],
        [
            "Cotton twill in the colors of denim: indigo warp over three picks, the white weft in diagonals.",
            "The same before a lamp: light passes between the picks, which lie wider apart than the ends.",
        ],
    ),
    (
        "silk_organza",
        12.0,
        [0.0, -1.5],
        [
            "Silk organza: three tenths of it are open.",
            "The same before a lamp: yarns scatter across themselves and draw a cross, along warp and weft, about the blurred lamp.",
        ],
    ),
    (
        "wool_plain",
        16.0,
        [1.0, -1.5],
        [
            "Worsted wool in plain weave, dyed charcoal.",
            "The same before a lamp: dark yarns, so that the gaps alone show.",
        ],
    ),
    (
        "cotton_plain",
        14.0,
        [0.8, -1.0],
        [
            "Bleached cotton percale: bright and even.",
            "The same before a lamp: the yarns glow as brightly as from the front.",
        ],
    ),
];

fn panel(title: &str, cloth: Cloth, setup: Setup, size_mm: f32, options: FabricOptions) -> Panel {
    Panel { title: title.into(), cloth, setup, size_mm, options, exposure: 0.0, samples: 1 }
}

/// All pictures.
pub fn all() -> Vec<Picture> {
    let mut list = Vec::new();
    for (name, size, [front, back], captions) in FABRICS {
        let sides = [(Setup::Front, "front", size, 1, front), (Setup::Back, "back", 20.0, 2, back)];
        for ((setup, side, size_mm, samples, exposure), caption) in sides.into_iter().zip(captions) {
            list.push(Picture {
                name: format!("{name}_{side}"),
                caption: caption.into(),
                panels: vec![Panel { exposure, samples, ..panel("", Cloth::shipped(name), setup, size_mm, NOISED) }],
            });
        }
    }
    for (name, setup, size_mm, caption) in [
        (
            "noise_close",
            Setup::Swatch,
            3.0,
            "A few yarns of the satin, without and with the speckle of single stretches of a ply.",
        ),
        ("noise", Setup::Front, 6.0, "The satin from the front, without and with speckle."),
    ] {
        let of = |title, options| panel(title, Cloth::shipped("polyester_satin"), setup, size_mm, options);
        list.push(Picture {
            name: name.into(),
            caption: caption.into(),
            panels: vec![of("smooth", SMOOTH), of("noise", NOISED)],
        });
    }
    let gaps = |title, gaps| Panel {
        samples: 2,
        exposure: -1.5,
        ..panel(title, Cloth::shipped("silk_organza"), Setup::Back, 20.0, FabricOptions { gaps, ..SMOOTH })
    };
    list.push(Picture {
        name: "gaps".into(),
        caption: "Organza before a lamp. Light that goes straight on through the gaps shows the lamp's outline; diffracted, it does not.".into(),
        panels: vec![
            gaps("straight", GapLight::Straight),
            gaps("diffracted", GapLight::Diffracted),
        ],
    });
    let even = FabricOptions { sigma_per_um: Some(0.003), ..SMOOTH };
    let satin = |title: &str, cloth, options| panel(title, cloth, Setup::Drape, 90.0, options);
    let of = |ply: Ply| Cloth::of("polyester_satin", ply);
    list.push(Picture {
        name: "fiber_shapes".into(),
        caption: "One satin, one absorption of the fibers (0.003 per um): polyester, the same with fibers of cotton's outline, and cotton.".into(),
        panels: vec![
            satin("circles", of(Ply::Shipped("polyester")), even),
            satin("kidneys", of(Ply::kidneys()), even),
            satin("cotton", of(Ply::Shipped("cotton")), even),
        ],
    });
    list.push(Picture {
        name: "twist".into(),
        caption: "Satin of plies whose fibers are twisted more and less; pitch in um.".into(),
        panels: [300.0, 500.0, 1000.0, 4000.0]
            .map(|pitch| satin(&format!("{pitch} um"), of(Ply::pitch(pitch)), SMOOTH))
            .to_vec(),
    });
    list.push(Picture {
        name: "absorption".into(),
        caption: "Satin of fibers that absorb more and more; sigma per um.".into(),
        panels: [0.0, 0.001, 0.003, 0.01, 0.03]
            .map(|sigma| {
                let options = FabricOptions { sigma_per_um: Some(sigma), ..SMOOTH };
                satin(&format!("{sigma}"), Cloth::shipped("polyester_satin"), options)
            })
            .to_vec(),
    });
    for (name, caption) in [
        ("polyester_satin", "Polyester satin over a ball: the highlight stretches across the warp."),
        ("silk_organza", "Silk organza over a ball."),
    ] {
        list.push(Picture {
            name: format!("{name}_drape"),
            caption: caption.into(),
            panels: vec![panel("", Cloth::shipped(name), Setup::Drape, 90.0, NOISED)],
        });
    }
    list
}
