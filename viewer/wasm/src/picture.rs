//! Progressive pictures of cloths.

use crate::{Cloth, failed};
use glam::Vec3;
use plywave::ClothModel;
use plywave_render::{Camera, Film, FilmView, MAX_SCATTERINGS, RenderOptions, Scene, Setup, render};
use std::rc::Rc;
use std::sync::atomic::AtomicBool;
use wasm_bindgen::prelude::{JsError, wasm_bindgen};

/// Largest number of samples in a pass.
const LARGEST_PASS: u32 = 16;
/// Largest width and height.
const MAX_SIDE: u32 = 4096;

/// A picture of a cloth in a scene of `plywave render`, path traced in passes, or one of several parts of it;
/// the parts add up pixel by pixel.
#[wasm_bindgen]
pub struct Picture {
    cloth: Rc<ClothModel>,
    scene: Scene,
    camera: Camera,
    film: Film,
    seed: u64,
}

fn setup(name: &str) -> Option<Setup> {
    Some(match name {
        "front" => Setup::Front,
        "back" => Setup::Back,
        "drape" => Setup::Drape,
        "curtain" => Setup::Curtain,
        "folded" => Setup::Folded,
        "ball" => Setup::Ball,
        "folds" => Setup::Folds,
        "swatch" => Setup::Swatch,
        "grazing" => Setup::Grazing,
        "furnace" => Setup::Furnace,
        _ => return None,
    })
}

#[wasm_bindgen]
impl Picture {
    /// A black picture, or part `part` of `parts`. `scene` is a name of `plywave render --setup`; the cloth
    /// is `size_mm` wide, 0 for the scene's own width.
    ///
    /// # Errors
    /// An unknown scene; a size that is not allowed.
    #[wasm_bindgen(constructor)]
    pub fn new(
        cloth: &Cloth,
        scene: &str,
        width: u32,
        height: u32,
        size_mm: f32,
        seed: u32,
        part: u32,
        parts: u32,
    ) -> Result<Picture, JsError> {
        let Some(setup) = setup(scene) else {
            return Err(JsError::new(&format!("{scene}: not a scene")));
        };
        if width.min(height) == 0 || width.max(height) > MAX_SIDE {
            return Err(JsError::new(&format!("{width} x {height}: a picture has 1 to {MAX_SIDE} pixels a side")));
        }
        let size = if size_mm > 0.0 { size_mm } else { setup.size_mm() };
        let (scene, camera) = setup.scene(size, None, None);
        let film = Film::new_part(width, height, part, parts).map_err(failed)?;
        Ok(Picture { cloth: Rc::clone(&cloth.model), scene, camera, film, seed: seed.into() })
    }

    /// Replaces the cloth in the same scene and restarts at the first sample.
    #[wasm_bindgen(js_name = setCloth)]
    pub fn set_cloth(&mut self, cloth: &Cloth) {
        self.cloth = Rc::clone(&cloth.model);
        self.film.clear();
    }

    /// Moves the camera to a point that looks at another [mm], with z up, and restarts at the first sample.
    ///
    /// # Errors
    /// Points that coincide or are not three numbers.
    pub fn look(&mut self, from_mm: &[f32], to_mm: &[f32]) -> Result<(), JsError> {
        let (Ok(from), Ok(to)) = (<[f32; 3]>::try_from(from_mm), <[f32; 3]>::try_from(to_mm)) else {
            return Err(JsError::new("a point is three numbers"));
        };
        let (from, to) = (Vec3::from(from), Vec3::from(to));
        let Some(forward) = (to - from).try_normalize() else {
            return Err(JsError::new("the camera is at the point that it looks at"));
        };
        let up = if forward.cross(Vec3::Z).length() < 1e-3 { Vec3::Y } else { Vec3::Z };
        self.camera = Camera::new(from, to, up, self.camera.view().fov_rad);
        self.film.clear();
        Ok(())
    }

    /// Position of the camera and its target [mm]: three numbers each.
    pub fn view(&self) -> Vec<f32> {
        let view = self.camera.view();
        [view.from.to_array(), view.to.to_array()].concat()
    }

    /// Adds a pass of at most `max` samples to each pixel; for 16, the passes are those of `plywave render`.
    /// Returns the number of samples of each pixel.
    ///
    /// # Errors
    /// An interrupted pass, which cannot occur in a worker.
    pub fn pass(&mut self, max: u32) -> Result<u32, JsError> {
        let done = self.film.samples();
        let samples = done + (done / 2).clamp(1, max.clamp(1, LARGEST_PASS));
        let options = RenderOptions { samples, depth: MAX_SCATTERINGS, seed: self.seed };
        let never = AtomicBool::new(false);
        render(&self.scene, &self.camera, &*self.cloth, &mut self.film, &options, &never, &mut |_| Ok(()))
            .map_err(failed)?;
        Ok(samples)
    }

    /// Number of samples of each pixel.
    #[wasm_bindgen(getter)]
    pub fn samples(&self) -> u32 {
        self.film.samples()
    }

    /// Linear sRGB, three numbers per pixel, row by row from the top; 0 for a pixel of another part.
    pub fn linear(&self) -> Vec<f32> {
        let mut out = Vec::with_capacity(3 * self.film.width() as usize * self.film.height() as usize);
        for y in 0..self.film.height() {
            for x in 0..self.film.width() {
                out.extend(self.film.linear(FilmView::Light, x, y));
            }
        }
        out
    }
}
