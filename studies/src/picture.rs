//! Pictures of `plywave render`, as studies read them.

use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};

pub type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// The green of a picture, and its variance.
pub struct Picture {
    pub width: usize,
    pub height: usize,
    pub green: Vec<f64>,
    pub variance: Vec<f64>,
}

impl Picture {
    /// Reads an EXR of `plywave render`.
    pub fn load(file: &str) -> Outcome<Picture> {
        let image = read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .from_file(file)?;
        let size = image.layer_data.size;
        let channel = |name: &str| -> Outcome<Vec<f64>> {
            let found = image.layer_data.channel_data.list.iter().find(|c| c.name.to_string() == name);
            match found.map(|c| &c.sample_data) {
                Some(FlatSamples::F32(values)) => Ok(values.iter().map(|v| f64::from(*v)).collect()),
                _ => Err(format!("{file}: no channel {name}").into()),
            }
        };
        let (green, variance) = (channel("G")?, channel("variance.G")?);
        Ok(Picture { width: size.0, height: size.1, green, variance })
    }
}
