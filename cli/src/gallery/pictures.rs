//! Which pictures there are, what is to be seen in each, and how they are rendered.

use super::materials::{Cloth, Ply};
use plywave::fabric::{FabricOptions, GapLight, Slits};
use plywave::gap::SLIT_SHARE;
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

const SMOOTH: FabricOptions = FabricOptions::SMOOTH;
const NOISED: FabricOptions = FabricOptions { noise: true, ..FabricOptions::SMOOTH };

/// A fabric that ships: width of the cloth of the close-up, of the flat view and of the view before a lamp [mm], stops of close-up and flat view, of the drape and before a
/// lamp, and what is to be seen in each.
struct Shown {
    name: &'static str,
    size_mm: [f32; 3],
    exposure: [f32; 3],
    captions: [&'static str; 4],
}

const FABRICS: [Shown; 5] = [
    Shown {
        name: "polyester_satin",
        size_mm: [2.2, 10.0, 16.0],
        exposure: [0.0, 0.3, -1.0],
        captions: [
            "Polyester satin, close: floats of the warp over four picks, and the points where a pick binds an end. Lamp of half a degree.",
            "Polyester satin: points of binding in five-end satin order, under a small lamp.",
            "Polyester satin over a ball, under a large lamp: highlights follow the folds across the warp.",
            "Polyester satin before a lamp: next to no gaps, and those so narrow that they throw the lamp's light far to the sides.",
        ],
    },
    Shown {
        name: "cotton_twill",
        size_mm: [4.5, 16.0, 20.0],
        exposure: [0.8, 0.8, 1.0],
        captions: [
            "Denim, close: indigo ends of three plies over three white picks of four.",
            "Denim: the diagonal of a 3/1 twill.",
            "Denim over a ball.",
            "Denim before a lamp: light comes through where picks show between ends.",
        ],
    },
    Shown {
        name: "silk_organza",
        size_mm: [1.6, 8.0, 16.0],
        exposure: [0.0, 0.5, -1.5],
        captions: [
            "Silk organza, close: plain weave of single filament yarns, open between them.",
            "Silk organza in front of the dark.",
            "Silk organza over a ball: sheer where one layer hangs, denser where folds overlap and toward grazing views.",
            "Silk organza before a lamp: yarns scatter across themselves and draw a cross, along warp and weft, about the blurred lamp.",
        ],
    },
    Shown {
        name: "wool_plain",
        size_mm: [5.0, 20.0, 20.0],
        exposure: [1.5, 1.5, 0.5],
        captions: [
            "Worsted, close: plain weave of two-ply wool, dyed charcoal.",
            "Worsted: plain weave of two-ply wool, dyed charcoal.",
            "Worsted over a ball.",
            "Worsted before a lamp: dark yarns, so that the gaps alone show.",
        ],
    },
    Shown {
        name: "cotton_plain",
        size_mm: [4.0, 16.0, 20.0],
        exposure: [0.0, 0.0, -1.0],
        captions: [
            "Bleached muslin, close: plain weave of two-ply cotton.",
            "Bleached muslin: bright and even, with small gaps.",
            "Bleached muslin over a ball.",
            "Bleached muslin before a lamp: the yarns glow as brightly as from the front.",
        ],
    },
];

fn panel(title: &str, cloth: Cloth, setup: Setup, size_mm: f32, options: FabricOptions) -> Panel {
    Panel { title: title.into(), cloth, setup, size_mm, options, exposure: 0.0, samples: 1 }
}

fn picture(name: impl Into<String>, caption: &str, panels: Vec<Panel>) -> Picture {
    Picture { name: name.into(), caption: caption.into(), panels }
}

/// Four pictures of a fabric that ships.
fn of_fabric(shown: &Shown) -> [Picture; 4] {
    let Shown { name, size_mm: [close, flat, before], exposure: [face, drape, back], captions } = shown;
    [
        ("close", Setup::Swatch, *close, *face, 1),
        ("front", Setup::Front, *flat, *face, 1),
        ("drape", Setup::Drape, 400.0, *drape, 1),
        ("back", Setup::Back, *before, *back, 2),
    ]
    .into_iter()
    .zip(captions)
    .map(|((view, setup, size_mm, exposure, samples), caption)| {
        let of = panel("", Cloth::shipped(name), setup, size_mm, NOISED);
        picture(format!("{name}_{view}"), caption, vec![Panel { exposure, samples, ..of }])
    })
    .collect::<Vec<_>>()
    .try_into()
    .unwrap_or_else(|_| unreachable!("four views"))
}

/// All pictures.
pub fn all() -> Vec<Picture> {
    let mut list: Vec<Picture> = FABRICS.iter().flat_map(of_fabric).collect();
    let grazing = |title, name, exposure| Panel {
        exposure,
        samples: 2,
        ..panel(title, Cloth::shipped(name), Setup::Grazing, 200.0, NOISED)
    };
    list.push(picture(
        "grazing",
        "Cloth seen from ten degrees above its plane, against the light: satin, denim, organza.",
        vec![
            grazing("satin", "polyester_satin", 0.0),
            grazing("denim", "cotton_twill", 1.0),
            grazing("organza", "silk_organza", 0.5),
        ],
    ));
    let part = |title, options| panel(title, Cloth::shipped("cotton_twill"), Setup::Swatch, 4.5, options);
    let parts = [
        part("all", SMOOTH),
        part("no layer below", FabricOptions { layers: false, ..SMOOTH }),
        part("no shadowing", FabricOptions { shadowing: false, ..SMOOTH }),
        part("neither", FabricOptions { layers: false, shadowing: false, ..SMOOTH }),
    ];
    list.push(picture(
        "layers",
        "Denim with and without what yarns take of each other's light (Yu 2025, Fig. 13): the layer below, and yarns beside. Without them, light that they would catch stays in the \
         picture, and the valleys between yarns are as bright as the crowns.",
        parts.map(|panel| Panel { exposure: 0.8, ..panel }).to_vec(),
    ));
    for (cloth, exposure, size) in [("silk_organza", -2.0, 16.0), ("polyester_satin", -1.0, 16.0)] {
        let gaps = |title, gaps| Panel {
            samples: 2,
            exposure,
            ..panel(title, Cloth::shipped(cloth), Setup::Back, size, FabricOptions { gaps, ..SMOOTH })
        };
        list.push(picture(
            format!("gaps_{cloth}"),
            "Before a lamp (Yu 2025, Fig. 14): light that goes straight on through the gaps shows the lamp's outline; diffracted, it spreads.",
            vec![gaps("straight", GapLight::Straight), gaps("diffracted", GapLight::Diffracted)],
        ));
    }
    let slits = |title, slits| Panel {
        samples: 2,
        exposure: -0.5,
        ..panel(title, Cloth::shipped("silk_organza"), Setup::Back, 16.0, FabricOptions { slits, ..SMOOTH })
    };
    list.push(picture(
        "slits",
        "Organza before a lamp, without and with slits of 3 um between the fibers of its yarns, through which a quarter of the forward light goes (Yu 2025, Fig. 16): the cross turns orange, purple, blue and green outwards.",
        vec![slits("no slits", None), slits("slits", Some(Slits { width_um: 3.0, share: SLIT_SHARE }))],
    ));
    for (name, cloth, setup, size_mm, exposure, caption) in [
        (
            "noise_close",
            "cotton_twill",
            Setup::Swatch,
            1.1,
            0.0,
            "A few yarns of the twill under a lamp of half a degree, without and with the speckle of single places on a ply (Yu 2025, Fig. 15). Polyester's clear round fibers have little of it.",
        ),
        (
            "noise_silk",
            "silk_organza",
            Setup::Swatch,
            0.8,
            0.0,
            "A few yarns of the organza under a lamp of half a degree, without and with speckle.",
        ),
    ] {
        let of = |title, options| Panel { exposure, ..panel(title, Cloth::shipped(cloth), setup, size_mm, options) };
        list.push(picture(name, caption, vec![of("smooth", SMOOTH), of("speckle", NOISED)]));
    }
    let even = FabricOptions { sigma_per_um: Some(0.003), ..SMOOTH };
    let satin = |title: &str, cloth, options| panel(title, cloth, Setup::Drape, 400.0, options);
    let of = |ply: Ply| Cloth::new("polyester_satin", ply);
    list.push(picture(
        "fiber_shapes",
        "One satin, one absorption of the fibers (0.003 per um): polyester, the same with fibers of cotton's outline, and cotton.",
        vec![
            satin("circles", of(Ply::Shipped("polyester")), even),
            satin("kidneys", of(Ply::kidneys()), even),
            satin("cotton", of(Ply::Shipped("cotton")), even),
        ],
    ));
    list.push(picture(
        "twist",
        "Satin of plies whose fibers are twisted more and less; pitch in um.",
        [300.0, 500.0, 1000.0, 4000.0]
            .map(|pitch| satin(&format!("{pitch} um"), of(Ply::pitch(pitch)), SMOOTH))
            .to_vec(),
    ));
    list.push(picture(
        "absorption",
        "Satin of fibers that absorb more and more; sigma per um.",
        [0.0, 0.001, 0.003, 0.01, 0.03]
            .map(|sigma| {
                let options = FabricOptions { sigma_per_um: Some(sigma), ..SMOOTH };
                satin(&format!("{sigma}"), Cloth::shipped("polyester_satin"), options)
            })
            .to_vec(),
    ));
    list
}
