//! From what a look file says to weights on columns.

use std::cell::RefCell;
use std::collections::HashMap;
use std::f32::consts::PI;
use std::path::Path;

use super::file::{Base, Color, LookFile, Rule};
use super::pattern::{image_mask, shape_mask};
use super::{Look, MAX_IMAGE_BYTES, MAX_LIGHTING_BYTES};
use crate::error::{Error, Result};
use crate::files::FileAccess;
use crate::image::{KELVIN_RANGE, LinearImage, decode_srgb, image_facts, kelvin_to_linear, luminance, read_image};
use crate::light::names::{fits, suggest};
use crate::light::{Light, LightBasis, LightKind, Lighting};

/// Applies a file's rules to a basis. `folder` is the file's own, where its images are looked for within `reach`.
pub(super) fn resolve(
    place: &str,
    folder: &Path,
    reach: &FileAccess,
    file: &LookFile,
    basis: &LightBasis,
) -> Result<Look> {
    let resolver = Resolver { place, folder, reach, file, basis, notes: RefCell::default() };
    let bytes = (file.look.len() as u64 + 2).saturating_mul(basis.column_count() as u64 * 12);
    if bytes > MAX_LIGHTING_BYTES {
        return Err(Error::Resources {
            what: place.to_owned(),
            needed: format!("{bytes} bytes for its {} looks over {} columns", file.look.len(), basis.column_count()),
            available: format!("a file's lightings may take {MAX_LIGHTING_BYTES}"),
            hint: "split it into files of fewer looks".into(),
        });
    }
    let mut indices = HashMap::new();
    let mut base = match file.base {
        Base::Scene => Lighting::of_scene(basis).weights().to_vec(),
        Base::Off => vec![[0.0; 3]; basis.column_count()],
    };
    resolver.apply(&file.light, &mut base)?;
    let mut look = Look {
        place: place.to_owned(),
        lighting: Lighting::new(base.clone())?,
        named: Vec::new(),
        keys: Vec::new(),
        groups: resolver.groups()?,
        notes: Vec::new(),
    };
    for named in &file.look {
        let mut weights = base.clone();
        resolver.apply(&named.light, &mut weights)?;
        if indices.insert(named.name.as_str(), look.named.len()).is_some() {
            return Err(Error::input(place, format!("look '{}' stands there twice", named.name), "rename one"));
        }
        look.named.push((named.name.clone(), Lighting::new(weights)?));
    }
    look.notes = resolver.notes.take();
    for key in &file.key {
        let rising = look.keys.last().is_none_or(|(last, _)| *last < key.time_secs);
        if !key.time_secs.is_finite() || !rising {
            let problem = format!("the key at {} s does not come after the one before", key.time_secs);
            return Err(Error::input(place, problem, "put keys in order of time"));
        }
        match indices.get(key.look.as_str()) {
            Some(&index) => look.keys.push((key.time_secs, index)),
            // Says which names are near.
            None => return Err(look.named(&key.look).expect_err("no look has the name")),
        }
    }
    Ok(look)
}

struct Resolver<'a> {
    place: &'a str,
    folder: &'a Path,
    reach: &'a FileAccess,
    file: &'a LookFile,
    basis: &'a LightBasis,
    /// On the images that were read, each once.
    notes: RefCell<Vec<String>>,
}

impl Resolver<'_> {
    fn apply(&self, rules: &[Rule], weights: &mut [[f32; 3]]) -> Result<()> {
        for rule in rules {
            let lights = self.lights(&rule.name)?;
            let suns = lights.iter().all(|light| light.kind == LightKind::Sun);
            let lit = match rule.sun {
                Some(direction) if suns => vec![self.choose_sun(rule, &lights, direction, weights)?],
                _ => lights,
            };
            for light in lit {
                let columns = light.columns();
                self.apply_to(rule, light, &mut weights[columns.start as usize..columns.end as usize])?;
            }
        }
        Ok(())
    }

    /// The lights that a name, a glob or a group means, each once: at least one.
    fn lights(&self, name: &str) -> Result<Vec<&Light>> {
        let alone = [name.to_owned()];
        let patterns = match self.file.groups.get(name) {
            Some(group) if self.basis.find(name).is_none() => group.as_slice(),
            _ => &alone,
        };
        let mut found: Vec<&Light> = Vec::new();
        for pattern in patterns {
            // A light's own name comes before its reading as a glob.
            let exact = self.basis.find(pattern);
            let meant = |light: &&Light| exact.map_or_else(|| fits(pattern, &light.name), |e| e.name == light.name);
            let mut fitting = self.basis.lights().iter().filter(meant).peekable();
            if fitting.peek().is_some() {
                let is_new = |light: &&Light| found.iter().all(|other| other.first_column != light.first_column);
                let more: Vec<_> = fitting.filter(is_new).collect();
                found.extend(more);
            } else {
                if self.file.groups.contains_key(pattern) {
                    let problem = format!("the group '{name}' names '{pattern}', a group");
                    return Err(Error::input(self.place, problem, "a group holds lights; name those of the other"));
                }
                let known = self.basis.lights().iter().map(|light| light.name.as_str());
                let hint = suggest(pattern, known.chain(self.file.groups.keys().map(String::as_str)));
                return Err(Error::input(self.place, format!("no light is called '{pattern}'"), hint));
            }
        }
        Ok(found)
    }

    fn apply_to(&self, rule: &Rule, light: &Light, weights: &mut [[f32; 3]]) -> Result<()> {
        let refuse = |problem: String| Error::input(format!("{}, light '{}'", self.place, light.name), problem, "");
        if rule.on == Some(true) && weights.iter().flatten().all(|v| *v == 0.0) {
            let columns = light.columns();
            weights.copy_from_slice(&self.basis.scene_weights()[columns.start as usize..columns.end as usize]);
        }
        if let Some(environment) = &rule.environment {
            let mapping = light.kind.environment();
            let mapping = mapping.ok_or_else(|| refuse("is no environment; give it an image or a colour".into()))?;
            let map = self.read(&environment.file)?;
            let gain = finite(environment.stops.exp2()).ok_or_else(|| refuse("has stops out of range".into()))?;
            let turn_radians = environment.rotation_degrees.to_radians();
            let shown = mapping.resample((map.width, map.height), &map.pixels, turn_radians);
            // A split sky has each texel twice.
            let texels = shown.iter().cycle();
            weights.iter_mut().zip(texels).for_each(|(weight, value)| *weight = value.map(|v| v * gain));
        }
        if rule.color.is_some() || rule.intensity.is_some() {
            let chroma = rule.color.as_ref().map(chromaticity).transpose().map_err(&refuse)?;
            if rule.intensity.is_some_and(|v| !(v.is_finite() && v >= 0.0)) {
                return Err(refuse("has an intensity that is not zero or more".into()));
            }
            for weight in weights.iter_mut() {
                let has = luminance(*weight);
                let own = if has > 0.0 { weight.map(|v| v / has) } else { [1.0; 3] };
                let (chroma, level) = (chroma.unwrap_or(own), rule.intensity.unwrap_or(has));
                *weight = chroma.map(|v| v * level);
            }
        }
        if let Some(direction) = rule.sun.filter(|_| light.kind != LightKind::Sun) {
            self.put_sun(light, direction, weights).map_err(&refuse)?;
        }
        let mut multiply = |mask: Vec<[f32; 3]>| {
            for (weight, mask) in weights.iter_mut().zip(mask) {
                (0..3).for_each(|ch| weight[ch] *= mask[ch]);
            }
        };
        if let Some(shape) = rule.shape {
            multiply(shape_mask(light.layout(), shape));
        }
        if let Some(picture) = &rule.image {
            let [left, top, right, bottom] = picture.place;
            if !(left < right && top < bottom) {
                return Err(refuse("has an image whose place is not (left, top, right, bottom)".into()));
            }
            multiply(image_mask(light.layout(), picture, &self.read(&picture.file)?));
        }
        if let Some(stops) = rule.stops {
            let gain = finite(stops.exp2()).ok_or_else(|| refuse("has stops out of range".into()))?;
            weights.iter_mut().flatten().for_each(|v| *v *= gain);
        }
        if rule.on == Some(false) {
            weights.fill([0.0; 3]);
        }
        if !weights.iter().flatten().all(|v| v.is_finite()) {
            return Err(refuse("gets a weight that is not finite".into()));
        }
        Ok(())
    }

    /// The columns of each group, without those of groups before it.
    fn groups(&self) -> Result<Vec<(String, Vec<u32>)>> {
        let mut taken = vec![false; self.basis.column_count()];
        let columns = |name: &String| {
            let columns = self.lights(name)?.into_iter().flat_map(Light::columns);
            Ok((
                name.clone(),
                columns.filter(|&column| !std::mem::replace(&mut taken[column as usize], true)).collect(),
            ))
        };
        self.file.groups.keys().map(columns).collect()
    }

    /// Of several suns, leaves only the one nearest to a direction on, and gives it; one that was off shines as in the scene.
    fn choose_sun<'a>(
        &self,
        rule: &Rule,
        suns: &[&'a Light],
        direction: [f32; 3],
        weights: &mut [[f32; 3]],
    ) -> Result<&'a Light> {
        let direction = unit(direction)
            .map_err(|problem| Error::input(format!("{}, light '{}'", self.place, rule.name), problem, ""))?;
        let nearness = |sun: &Light| (0..3).map(|i| sun.places[0][i] * direction[i]).sum::<f32>();
        let sun =
            suns.iter().max_by(|a, b| nearness(a).total_cmp(&nearness(b))).expect("a rule means a light at least");
        let nearest = sun.first_column as usize;
        if weights[nearest] == [0.0; 3] {
            weights[nearest] = self.basis.scene_weights()[nearest];
        }
        suns.iter().map(|sun| sun.first_column as usize).filter(|&c| c != nearest).for_each(|c| weights[c] = [0.0; 3]);
        Ok(*sun)
    }

    /// Gathers the light's irradiance on the column nearest to a direction.
    fn put_sun(&self, light: &Light, direction: [f32; 3], weights: &mut [[f32; 3]]) -> Result<(), String> {
        if !light.kind.is_environment() {
            return Err("has no directions to put a sun in; name an environment, or suns".into());
        }
        // A split sky has each texel twice.
        let texels = light.kind.environment().map_or(weights.len(), |mapping| mapping.texel_count() as usize);
        let texel = light.nearest_texel(unit(direction)?) % texels;
        for weights in weights.chunks_exact_mut(texels) {
            let total = [0, 1, 2].map(|ch: usize| {
                weights.iter().zip(&light.extents).map(|(weight, extent)| weight[ch] * extent).sum::<f32>()
            });
            let extent = light.extents[texel].max(4.0 * PI * 1e-9);
            weights.fill([0.0; 3]);
            weights[texel] = total.map(|v| v / extent);
        }
        Ok(())
    }

    fn read(&self, file: &str) -> Result<LinearImage> {
        let path = self.folder.join(file);
        if !path.exists() {
            let problem = format!("the image {} is missing", path.display());
            return Err(Error::input(self.place, problem, "put it beside the look file"));
        }
        self.reach.admit(&path, self.place)?;
        let facts = image_facts(&path)?;
        let needed = facts.needs_bytes;
        if needed > MAX_IMAGE_BYTES {
            return Err(Error::Resources {
                what: format!("reading {}", path.display()),
                needed: format!("{needed} bytes of memory"),
                available: format!("a look's image may take {MAX_IMAGE_BYTES}"),
                hint: "scale it down".into(),
            });
        }
        for note in facts.notes {
            let note = format!("{}: {note}", path.display());
            if !self.notes.borrow().contains(&note) {
                self.notes.borrow_mut().push(note);
            }
        }
        let image = read_image(&path)?;
        if image.pixels.is_empty() || !image.values().iter().all(|v| v.is_finite()) {
            return Err(Error::input(path.display().to_string(), "has no pixels, or some that are not finite", ""));
        }
        Ok(image)
    }
}

fn unit(direction: [f32; 3]) -> Result<[f32; 3], String> {
    let length = direction.iter().map(|v| v * v).sum::<f32>().sqrt();
    if length > 0.0 && length.is_finite() {
        Ok(direction.map(|v| v / length))
    } else {
        Err("has a sun without direction".into())
    }
}

fn finite(value: f32) -> Option<f32> {
    Some(value).filter(|v| v.is_finite())
}

/// A colour scaled to luminance 1.
fn chromaticity(color: &Color) -> Result<[f32; 3], String> {
    let linear = match color {
        Color::Kelvin(kelvin) if KELVIN_RANGE.contains(kelvin) => kelvin_to_linear(*kelvin),
        Color::Kelvin(kelvin) => {
            let (least, most) = (KELVIN_RANGE.start(), KELVIN_RANGE.end());
            return Err(format!("has a colour of {kelvin} K; give {least} to {most}"));
        }
        Color::Linear(linear) => *linear,
        Color::Srgb(text) => {
            let digits = text.strip_prefix('#').unwrap_or(text);
            let number = u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 6);
            let number = number.ok_or_else(|| format!("has the colour '{text}'; write it as \"#ffcc88\""))?;
            [16, 8, 0].map(|shift| decode_srgb(((number >> shift) & 255) as f32 / 255.0))
        }
    };
    let level = luminance(linear);
    if linear.iter().all(|v| v.is_finite() && *v >= 0.0) && level > 0.0 {
        Ok(linear.map(|v| v / level))
    } else {
        Err("has a colour that is black, negative or not finite; switch it off with on = false".into())
    }
}
