//! The head of shared data: what the picture is, its lights, the author's looks, and where the layers lie; as JSON.

use super::level::Level;
use crate::decimal;
use crate::light::{Job, Light, Lighting};

/// A lighting of the author's.
#[derive(Clone, Debug, PartialEq)]
pub struct SharedLook {
    /// Text of its button.
    pub name: String,
    /// The light.
    pub lighting: Lighting,
}

/// Metadata of the image beside its factors.
#[derive(Clone, Debug)]
pub struct SharedPicture<'a> {
    /// Title of the page.
    pub title: &'a str,
    /// The job of the matrix.
    pub job: &'a Job,
    /// The author's looks; the scene's own lighting is always offered before them.
    pub looks: &'a [SharedLook],
    /// Groups of lights: name, and indices into the basis. A light is in one at most.
    pub groups: &'a [(String, Vec<usize>)],
    /// Pixels of the picture for one of the preview, across and down.
    pub shrink: u32,
    /// Exposure that the page begins with, in stops.
    pub exposure_stops: f32,
    /// What makes luminances cd/m²; none where the picture has no unit.
    pub lumens_per_watt: Option<f32>,
    /// Whether it is a panorama of all directions; none where nothing says how its camera stood.
    pub is_panorama: Option<bool>,
}

/// The head as JSON. Offsets of layers count from the end of the head.
pub fn head_json(picture: &SharedPicture<'_>, preview: &Level<'_>, whole: &Level<'_>) -> String {
    let job = picture.job;
    let scene = Lighting::of_scene(&job.basis);
    let mut json = String::from("{\"title\":");
    text(&mut json, picture.title);
    json += ",\"program\":";
    text(&mut json, concat!("ltm ", env!("CARGO_PKG_VERSION")));
    json += &format!(",\"columns\":{},\"shrink\":{},\"exposure\":", job.shape.columns(), picture.shrink);
    number(&mut json, picture.exposure_stops);
    json += ",\"lumensPerWatt\":";
    match picture.lumens_per_watt {
        Some(lumens) => number(&mut json, lumens),
        None => json += "null",
    }
    json += ",\"panorama\":";
    json += picture.is_panorama.map_or("null", |is_panorama| if is_panorama { "true" } else { "false" });
    json += ",\"lights\":";
    let scales = job.basis.column_scales();
    list(&mut json, job.basis.lights(), |json, light| {
        let scale = scales.get(light.first_column as usize).copied().unwrap_or(1.0);
        light_json(json, light, weights_of(&scene, light), scale);
    });
    json += ",\"groups\":";
    list(&mut json, picture.groups, |json, (name, lights)| {
        *json += "{\"name\":";
        text(json, name);
        *json += ",\"lights\":";
        list(json, lights, |json, index| *json += &index.to_string());
        json.push('}');
    });
    json += ",\"looks\":";
    list(&mut json, picture.looks, |json, look| {
        *json += "{\"name\":";
        text(json, &look.name);
        *json += ",\"lights\":";
        list(json, job.basis.lights(), |json, light| {
            let weights = weights_of(&look.lighting, light);
            if weights == weights_of(&scene, light) { *json += "null" } else { weights_json(json, weights) }
        });
        json.push('}');
    });
    json += ",\"levels\":";
    let mut offset = 0;
    list(&mut json, &[preview, whole], |json, level| level_json(json, level, &mut offset));
    json.push('}');
    json
}

fn weights_of<'a>(lighting: &'a Lighting, light: &Light) -> &'a [[f32; 3]] {
    let columns = light.columns();
    &lighting.weights()[columns.start as usize..columns.end as usize]
}

fn light_json(json: &mut String, light: &Light, scene: &[[f32; 3]], scale: f32) {
    let (across, down) = light.layout();
    *json += "{\"name\":";
    text(json, &light.name);
    *json += &format!(",\"kind\":\"{}\",\"unit\":", light.kind.name());
    text(json, &light.unit.to_string());
    *json += &format!(",\"across\":{across},\"down\":{down},\"emission\":");
    colour(json, &light.emission);
    *json += ",\"scene\":";
    weights_json(json, scene);
    *json += ",\"scale\":";
    number(json, scale);
    json.push('}');
}

/// One colour where all weights are the same, else a list of them.
fn weights_json(json: &mut String, weights: &[[f32; 3]]) {
    match weights.first().filter(|first| weights.iter().all(|weight| weight == *first)) {
        Some(first) => list(json, &[*first], colour),
        None => list(json, weights, colour),
    }
}

fn level_json(json: &mut String, level: &Level<'_>, offset: &mut u64) {
    let shape = level.shape();
    let (width, height, side) = (shape.width(), shape.height(), shape.block_side());
    *json += &format!("{{\"width\":{width},\"height\":{height},\"side\":{side},\"ranks\":");
    list(json, level.counts(), |json, (rank, _)| *json += &rank.to_string());
    *json += ",\"sparse\":";
    list(json, level.counts(), |json, (_, sparse)| *json += &sparse.to_string());
    *json += ",\"layers\":";
    list(json, level.layers(), |json, layer| {
        let (index_bytes, crc) = (layer.index.len(), crc32fast::hash(&layer.index));
        *json += &format!(
            "{{\"offset\":{offset},\"indexBytes\":{index_bytes},\"indexCrc\":{crc},\"chunkBytes\":{}}}",
            layer.chunk_bytes
        );
        *offset += index_bytes as u64 + layer.chunk_bytes;
    });
    json.push('}');
}

fn list<T>(json: &mut String, items: &[T], mut one: impl FnMut(&mut String, &T)) {
    json.push('[');
    for (i, item) in items.iter().enumerate() {
        if i > 0 {
            json.push(',');
        }
        one(json, item);
    }
    json.push(']');
}

fn colour(json: &mut String, colour: &[f32; 3]) {
    list(json, colour, |json, value| number(json, *value));
}

/// The shortest decimal that gives the same f32 back. Nothing here is infinite or not a number; if it were, it were 0.
fn number(json: &mut String, value: f32) {
    let value = if value.is_finite() { value } else { 0.0 };
    *json += &decimal::of_f32(value);
}

fn text(json: &mut String, text: &str) {
    json.push('"');
    for sign in text.chars() {
        match sign {
            '"' | '\\' => json.extend(['\\', sign]),
            sign if (sign as u32) < 0x20 => *json += &format!("\\u{:04x}", sign as u32),
            sign => json.push(sign),
        }
    }
    json.push('"');
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_and_numbers_are_json() {
        let mut json = String::new();
        text(&mut json, "a \"b\" \\ \n Küche");
        assert_eq!(json, "\"a \\\"b\\\" \\\\ \\u000a Küche\"");
        let mut json = String::new();
        list(&mut json, &[0.1, -2.0, 1e-20, f32::NAN], |json, v| number(json, *v));
        assert_eq!(json, "[0.1,-2.0,1e-20,0.0]");
    }
}
