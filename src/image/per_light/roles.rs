//! Which layers of a file are lights: the conventions of renderers, and what tells a light from the other passes.

use crate::error::Hint;
use std::collections::{BTreeMap, BTreeSet};

use super::namings::{NAMINGS, Naming, is_one_of};
use super::{LayerPattern, LayerRole};

/// Names of the layer under all lights, in lower case: the first that is there. Blender's combined image is denoised where a
/// noisy one stands beside it, and lights add up to the noisy one.
const SUMS: [&str; 8] = ["noisy image", "", "combined", "rgba", "beauty", "rgb", "cshading_beauty", "vrayrgb"];

/// Endings of layers that are another one, denoised, or its variance.
const COPIES: [&str; 4] = ["denoise", "denoised", "variance", "mse"];

/// Names of passes that would be lights with a number behind.
const SHORT_PASSES: [&str; 5] = ["n", "p", "z", "st", "lightmix"];
/// Names of passes that are as likely lights: Mitsuba's surroundings, a world.
const LIGHTS_AND_PASSES: [&str; 2] = ["env", "world"];
/// Words that name what is no light's, in the singular. A layer all of whose words are among them is such a pass; `diffuser panel` is a light.
const PASS_WORDS: &str = " adaptive albedo alpha ambient ao asset atmosphere background bump catcher caustic clean coat col color colour \
     combined component composite count coverage crypto cryptoasset cryptomaterial cryptomatte cryptoobject debug denoise \
     denoised denoiser denoising depth diff diffuse dir direct dist distance effect emission emissive emit env environment \
     extra facing filter fog freestyle geometry gi global gloss glossiness glossy id illuminance illumination image \
     incidence ind index indirect info intensity level lighting lightmix lightpath lobe local luminance mask mat material \
     matte mist mix motion motionvector mse mtl noise noisy normal ob object objectid occlusion opacity option pass passes \
     position pref rate raw raycount re refl reflect reflection refr refract refraction render result roughness sample \
     sampler sampling scatter scattering select self shading shadow shadowing sheen single space spec specular sss stddev \
     subsurface texture time tint toon total trans translucency transmission transparency uv var variance vector velocity \
     volume volumetric vray weight weighted wire wirecolor world zdepth ";

/// A layer with colours.
#[derive(Clone, Copy, Debug)]
pub(super) struct Named<'a> {
    pub(super) name: &'a str,
    /// Name without that of its view.
    pub(super) stem: &'a str,
    pub(super) view: Option<&'a str>,
    /// Whether it has a single channel.
    pub(super) is_grey: bool,
}

/// What is wrong with a choice of layers, and what to do.
pub(super) type Refusal = (String, Hint);

/// The roles found.
#[derive(Debug)]
pub(super) struct Roles {
    /// One for each layer.
    pub(super) roles: Vec<LayerRole>,
    /// Whether lights are those that no name tells to be anything else.
    pub(super) is_by_elimination: bool,
}

/// The role of each layer: the lights, and their sum if there is one.
///
/// # Errors
/// Lights of several view layers or of several views: added up they would show the scene twice.
pub(super) fn roles(layers: &[Named<'_>], pattern: Option<&LayerPattern>) -> Result<Roles, Refusal> {
    let (mut is_by_elimination, mut own_sum) = (false, None);
    let lights = match pattern {
        Some(pattern) => layers.iter().map(|layer| Some((String::new(), pattern.light(layer.name)?))).collect(),
        None => match by_convention(layers) {
            Some((naming, lights)) => {
                own_sum = naming.sum;
                lights
            }
            None => {
                is_by_elimination = true;
                by_elimination(layers)
            }
        },
    };
    let views: BTreeSet<Option<&str>> =
        layers.iter().zip(&lights).filter(|(_, light)| light.is_some()).map(|(layer, _)| layer.view).collect();
    if views.len() > 1 {
        return Err(several_views(layers, &lights, &views));
    }
    let sum = sum_of(layers, &lights, own_sum)?;
    let mut owners: BTreeMap<&str, &str> = BTreeMap::new();
    for (layer, (owner, _)) in layers.iter().zip(&lights).filter_map(|(layer, light)| Some((layer, light.as_ref()?))) {
        owners.entry(owner).or_insert(layer.name);
    }
    if let [first, second, ..] = owners.values().collect::<Vec<_>>()[..] {
        let problem = format!("'{first}' and '{second}' are lights of two view layers");
        return Err((problem, Hint::OneViewLayer));
    }
    let role = |(index, light): (usize, Option<(String, String)>)| match light {
        Some((_, light)) => LayerRole::Light(light),
        None if sum == Some(index) => LayerRole::Sum,
        None => LayerRole::Ignored,
    };
    Ok(Roles { roles: lights.into_iter().enumerate().map(role).collect(), is_by_elimination })
}

/// For each layer, where it is a light: the path of names before it, and the light's name.
type Lights = Vec<Option<(String, String)>>;

/// Lights by the names that a renderer gives their layers; none where no layer has such a name.
fn by_convention(layers: &[Named<'_>]) -> Option<(&'static Naming, Lights)> {
    let mut lights: Lights = vec![None; layers.len()];
    let is_beside = |naming: &Naming| {
        naming.sum.is_none_or(|sum| layers.iter().any(|layer| last(layer.stem).to_lowercase() == sum))
    };
    let naming = NAMINGS.iter().find(|naming| {
        for (layer, light) in layers.iter().zip(&mut lights) {
            let whole = is_one_of(&plain(last(layer.stem)), naming.whole);
            *light = if whole { Some(by_whole_name(layer.stem)) } else { after_prefix(layer.stem, naming.prefixes) };
        }
        lights.iter().any(Option::is_some) && is_beside(naming)
    })?;
    let stems: BTreeSet<String> = layers.iter().map(|layer| layer.stem.to_lowercase()).collect();
    let has_sum = layers.iter().any(|layer| sum_rank(layer.stem, naming.sum).is_some());
    for (layer, light) in layers.iter().zip(&mut lights) {
        let named_copy = light.as_ref().is_some_and(|(_, name)| COPIES.contains(&name.to_lowercase().as_str()));
        if is_copy(layer.stem, &stems) || (named_copy && has_sum) {
            *light = None;
        } else if light.is_none() && is_one_of(&plain(last(layer.stem)), naming.beside) {
            *light = Some(by_whole_name(layer.stem));
        }
    }
    Some((naming, lights))
}

/// What stands before a layer's own name, and that name as a light's.
fn by_whole_name(stem: &str) -> (String, String) {
    (path(stem).to_owned(), last(stem).to_owned())
}

/// Every layer of colours that is neither under all lights nor another pass.
fn by_elimination(layers: &[Named<'_>]) -> Lights {
    let stems: BTreeSet<String> = layers.iter().map(|layer| layer.stem.to_lowercase()).collect();
    let is_light = |layer: &Named<'_>| {
        sum_rank(layer.stem, None).is_none() && !is_pass(layer.stem) && !is_copy(layer.stem, &stems)
    };
    // One channel for three is data, unless all lights are so.
    let has_colours = layers.iter().any(|layer| !layer.is_grey && is_light(layer));
    let light = |layer: &Named<'_>| {
        (is_light(layer) && layer.is_grey != has_colours).then(|| (String::new(), layer.stem.to_owned()))
    };
    layers.iter().map(light).collect()
}

/// What stands before and behind the first of the prefixes that begins a name, or a part of it after a dot: a light's own name
/// may hold dots.
fn after_prefix(stem: &str, prefixes: &[&str]) -> Option<(String, String)> {
    let starts = std::iter::once(0).chain(stem.match_indices('.').map(|(at, _)| at + 1));
    let light = |at: usize| prefixes.iter().find_map(|prefix| Some((at, stem[at..].strip_prefix(prefix)?)));
    let (at, light) = starts.filter_map(light).next()?;
    (!light.is_empty()).then(|| (stem[..at].trim_end_matches('.').to_owned(), light.to_owned()))
}

/// Whether the layer is another one that is there too, denoised or as its variance.
fn is_copy(stem: &str, stems: &BTreeSet<String>) -> bool {
    let lower = stem.to_lowercase();
    COPIES.iter().any(|copy| {
        let before = lower.strip_suffix(copy).and_then(|s| s.strip_suffix(['_', '.', ' ', '-']));
        let behind = lower.strip_prefix(copy).and_then(|s| s.strip_prefix(['_', '.', ' ', '-']));
        before.or(behind).is_some_and(|other| stems.contains(other))
    })
}

/// Whether a layer is a pass that is no light's, by its words.
fn is_pass(stem: &str) -> bool {
    let own = last(stem);
    if LIGHTS_AND_PASSES.contains(&own.to_lowercase().as_str()) {
        return false;
    }
    let begins = |prefix: &&str| own.strip_prefix(*prefix).is_some_and(|rest| rest.starts_with(char::is_uppercase));
    let own = own.strip_prefix("VRay").filter(|rest| rest.starts_with(char::is_uppercase)).unwrap_or(own);
    ["CShading_", "CGeometry_", "CMasking_", "CTexmap_"].iter().any(begins)
        || SHORT_PASSES.contains(&plain(own).as_str())
        || words(own).iter().all(|word| is_made_of_passes(word))
}

/// Whether a word is one that names passes, in the singular or plural, or several of them one after the other: `directdiffuse`.
fn is_made_of_passes(word: &str) -> bool {
    let is_known = |word: &str| PASS_WORDS.contains(&format!(" {word} "));
    let singular = word.strip_suffix('s').unwrap_or(word);
    if is_known(word) || is_known(singular) {
        return true;
    }
    // Short ones would make words of any letters.
    let cuts = word.char_indices().map(|(at, _)| at).filter(|at| *at >= 4 && at + 4 <= word.len());
    cuts.into_iter().any(|at| is_known(&word[..at]) && is_made_of_passes(&word[at..]))
}

/// The words of a name in lower case: cut at signs, before capitals, and without numbers.
fn words(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut was_lower = false;
    for letter in name.chars() {
        let is_capital = letter.is_uppercase();
        if !letter.is_alphabetic() || (is_capital && was_lower) {
            words.push(String::new());
        }
        if letter.is_alphabetic() {
            words.last_mut().expect("there is one").extend(letter.to_lowercase());
        }
        was_lower = letter.is_lowercase();
    }
    words.retain(|word| !word.is_empty());
    // A name of numbers alone is a light's.
    if words.is_empty() { vec!["0".into()] } else { words }
}

/// A name in lower case without the signs between its words.
fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

/// The part of a name after Blender's view layer.
fn last(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(_, last)| last)
}

fn path(name: &str) -> &str {
    name.rsplit_once('.').map_or("", |(path, _)| path)
}

/// Place among the names of layers under all lights, of which the renderer's own comes first.
fn sum_rank(stem: &str, own: Option<&str>) -> Option<usize> {
    let lower = last(stem).to_lowercase();
    own.iter().chain(&SUMS).position(|sum| *sum == lower)
}

/// Of the layers that show all lights, the one that shows the lights found: a file may have a view layer of them, a composite
/// and others beside it. Each light belongs to the sum with the longest path of names before it.
fn sum_of(layers: &[Named<'_>], lights: &Lights, own: Option<&str>) -> Result<Option<usize>, Refusal> {
    let view = layers.iter().zip(lights).find(|(_, light)| light.is_some()).and_then(|(layer, _)| layer.view);
    let ranked =
        layers.iter().zip(lights).enumerate().filter(|(_, (layer, light))| light.is_none() && layer.view == view);
    let mut sums: Vec<(usize, &Named<'_>, usize)> =
        ranked.filter_map(|(index, (layer, _))| Some((index, layer, sum_rank(layer.stem, own)?))).collect();
    sums.sort_by_key(|(_, _, rank)| *rank);
    let owns = |sum: &Named<'_>, light: &str| {
        let path = path(sum.stem);
        path.is_empty() || light.strip_prefix(path).is_some_and(|rest| rest.starts_with('.'))
    };
    let mut chosen: Option<(usize, &Named<'_>)> = None;
    for (layer, _) in layers.iter().zip(lights).filter(|(_, light)| light.is_some()) {
        // Of equally long paths the first, by rank.
        let owning = sums.iter().filter(|(_, sum, _)| owns(sum, layer.stem)).rev();
        let owner = owning.max_by_key(|(_, sum, _)| path(sum.stem).len()).map(|(index, sum, _)| (*index, *sum));
        match (chosen, owner) {
            (Some((_, first)), Some((_, second))) if path(first.stem) != path(second.stem) => {
                let problem =
                    format!("'{}' and '{}' are each the image under some of the lights", first.name, second.name);
                return Err((problem, Hint::OneViewLayer));
            }
            (None, Some(_)) => chosen = owner,
            _ => {}
        }
    }
    Ok(chosen.map(|(index, _)| index))
}

/// Lights as several eyes see them.
fn several_views(layers: &[Named<'_>], lights: &Lights, views: &BTreeSet<Option<&str>>) -> Refusal {
    let quoted: Vec<String> = views.iter().map(|view| format!("'{}'", view.unwrap_or("main"))).collect();
    let problem = format!("its lights are seen in the views {}, which do not add up", quoted.join(" and "));
    let of_view =
        |view: &str| layers.iter().zip(lights).find(|(layer, light)| light.is_some() && layer.view == Some(view));
    let named = views.iter().flatten().find_map(|view| Some((*view, of_view(view)?)));
    let example = named.and_then(|(_, (layer, light))| {
        let before = layer.stem.strip_suffix(light.as_ref()?.1.as_str())?;
        let after = layer.name.strip_prefix(layer.stem)?;
        Some(format!("^{}(.+){}$", regex_lite::escape(before), regex_lite::escape(after)))
    });
    (problem, Hint::OneView { pattern: example.unwrap_or_else(|| "(.+)".into()) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named<'a>(layers: &[&'a str]) -> Vec<Named<'a>> {
        layers.iter().map(|&name| Named { name, stem: name, view: None, is_grey: false }).collect()
    }

    fn lights(layers: &[&str], pattern: Option<&str>) -> Vec<String> {
        let pattern = pattern.map(|pattern| pattern.parse().unwrap());
        let roles = roles(&named(layers), pattern.as_ref()).unwrap().roles;
        let mut lights: Vec<String> =
            roles.into_iter().filter_map(|r| if let LayerRole::Light(name) = r { Some(name) } else { None }).collect();
        lights.sort();
        lights
    }

    #[test]
    fn the_conventions_of_renderers_are_known() {
        let blender =
            ["ViewLayer.Combined", "ViewLayer.Combined_key", "ViewLayer.Combined_ceiling lamp", "ViewLayer.DiffDir"];
        assert_eq!(lights(&blender, None), ["ceiling lamp", "key"]);
        assert_eq!(lights(&["RGBA", "RGBA_key", "RGBA_fill", "albedo"], None), ["fill", "key"]);
        assert_eq!(lights(&["", "LightSelect_sun", "diffuseFilter"], None), ["sun"]);
        assert_eq!(lights(&["", "RADIANCE_GROUP_0", "RADIANCE_GROUP_1"], None), ["0", "1"]);
        assert_eq!(lights(&["", "env", "spot", "albedo"], None), ["env", "spot"]);
        assert_eq!(lights(&["V.Combined_Combined_", "V.Combined_RGBA_x"], None), ["Combined_", "RGBA_x"]);
        assert_eq!(lights(&["", "LightMix", "LightMix_Key", "Environment", "VRayLightSelect_Fill"], None), ["Fill"]);
        assert_eq!(lights(&["", "LightMix", "LightMix_Key", "Environment"], None), ["Environment", "Key"]);
    }

    /// A file of each renderer in the table: its layers, the lights in them, and the layer under all of them.
    #[test]
    fn each_renderer_of_the_table_is_read() {
        let files: [(&str, &[&str], &[&str], &str); NAMINGS.len()] = [
            (
                "Blender",
                &[
                    "V.Combined",
                    "V.Combined_a.b",
                    "V.Combined_key",
                    "V.CryptoObject00",
                    "V.Denoising Albedo",
                    "V.DiffCol",
                ],
                &["a.b", "key"],
                "V.Combined",
            ),
            (
                "Arnold",
                &[
                    "RGBA",
                    "RGBA_default",
                    "RGBA_key",
                    "diffuse_direct_key",
                    "specular_key",
                    "albedo",
                    "crypto_asset00",
                    "N",
                ],
                &["default", "key"],
                "RGBA",
            ),
            (
                "V-Ray, Corona",
                &["", "VRayLightSelect_Key", "LightMix", "LightMix_Key", "VRayDiffuseFilter"],
                &["Key"],
                "",
            ),
            (
                "V-Ray, Corona: LightMix",
                &["", "LightMix", "LightMix_Key", "Environment", "Self_Illumination", "VRayZDepth"],
                &["Environment", "Key", "Self_Illumination"],
                "",
            ),
            ("LuxCore", &["RGB", "RADIANCE_GROUP_0", "RADIANCE_GROUP_1", "ALBEDO"], &["0", "1"], "RGB"),
            (
                "Karma",
                &[
                    "C",
                    "C_Key",
                    "C_Rim_2",
                    "directdiffuse",
                    "directdiffuse_Key",
                    "beautyunshadowed",
                    "CryptoMaterial00",
                    "N",
                ],
                &["Key", "Rim_2"],
                "C",
            ),
            (
                "RenderMan",
                &["Ci", "Ci_key", "Ci_fill", "directDiffuse_key", "albedo", "normal"],
                &["fill", "key"],
                "Ci",
            ),
            (
                "Redshift",
                &["", "Beauty_key", "Beauty_other", "GI_key", "DiffuseLighting_key", "Cryptomatte00", "Z"],
                &["key", "other"],
                "",
            ),
            (
                "Octane",
                &[
                    "Beauty",
                    "Light pass 1",
                    "Light pass 12",
                    "Light pass 1 direct",
                    "Light pass 1 indirect",
                    "Ambient light",
                    "Ambient light direct",
                    "Sunlight",
                    "Sunlight indirect",
                    "Denoised beauty",
                ],
                &["Ambient light", "Light pass 1", "Light pass 12", "Sunlight"],
                "Beauty",
            ),
        ];
        for (naming, (renderer, layers, wanted, whole)) in NAMINGS.iter().zip(files) {
            assert_eq!(naming.renderer, renderer);
            assert_eq!(lights(layers, None), wanted, "{renderer}");
            assert_eq!(sum(layers), Ok(Some(whole.to_owned())), "{renderer}");
        }
        // Names that only look so: without its beauty beside it, `C_` is a name like any other.
        assert_eq!(lights(&["", "C_key", "C_fill"], None), ["C_fill", "C_key"]);
        assert_eq!(lights(&["A", "B", "C"], None), ["A", "B", "C"]);
    }

    #[test]
    fn a_light_may_have_the_name_of_a_pass_in_its_own() {
        let names = [
            "Kaori",
            "P1",
            "VRayLight001",
            "world",
            "UV strip",
            "chaos_key",
            "diffuser panel",
            "emitter",
            "env_dome",
            "shadowbox",
            "照明",
            "7",
        ];
        let mut wanted = names.map(str::to_owned);
        wanted.sort();
        assert_eq!(lights(&names, None), wanted);
        for pass in [
            "N",
            "albedo",
            "ao",
            "diffuse_direct",
            "DiffDir",
            "DenoisingAlbedo",
            "Denoising Normal",
            "VRayReflection",
            "VRayZDepth",
            "Crypto Material02",
            "CryptoObject00",
            "ViewLayer.GlossCol",
            "specular_indirect",
            "LightMix",
            "CGeometry_ZDepth",
            "Self_Illumination",
            "environment pass",
            "Shadow Catcher",
            "MotionVectors",
            "uv",
            "transmission_albedo",
            "albedo_var",
            "Reflections",
            "directdiffuse",
            "VRayMtlSelect",
            "VRaySSS2",
            "ObjectSpacePositions",
        ] {
            assert_eq!(lights(&["", "a lamp", pass], None), ["a lamp"], "{pass}");
        }
    }

    #[test]
    fn copies_of_layers_are_no_lights() {
        let arnold = ["", "RGBA_key", "RGBA_key_denoise", "RGBA_denoise", "RGBA_key_variance", "variance"];
        assert_eq!(lights(&arnold, None), ["key"]);
        assert_eq!(lights(&["", "RGBA_key_denoise"], None), ["key_denoise"], "the only one there is");
        assert_eq!(lights(&["beauty", "beauty_denoised", "sun", "denoised_sun"], None), ["sun"]);
    }

    fn sum(layers: &[&str]) -> Result<Option<String>, String> {
        let roles = roles(&named(layers), None).map_err(|(problem, _)| problem)?.roles;
        let sum = roles.iter().position(|role| *role == LayerRole::Sum);
        Ok(sum.map(|index| layers[index].to_owned()))
    }

    #[test]
    fn the_image_under_all_lights_is_that_of_their_view_layer() {
        let composite = ["Composite.Combined", "View.Combined", "View.Combined_a.b", "View.Combined_c"];
        assert_eq!(sum(&composite), Ok(Some("View.Combined".into())));
        assert_eq!(sum(&["Z.Combined", "View.Combined", "View.Combined_a"]), Ok(Some("View.Combined".into())));
        assert_eq!(sum(&["RGBA", "RGBA_key", "RGBA_fill"]), Ok(Some("RGBA".into())));
        assert_eq!(sum(&["RGBA_key"]), Ok(None));
        assert_eq!(sum(&["Composite.Combined", "View.Combined_a"]), Ok(None), "a composite is no sum");
        let noisy = ["V.Combined", "V.Combined_a", "V.Noisy Image"];
        assert_eq!(sum(&noisy), Ok(Some("V.Noisy Image".into())));
        for two in [
            &["A.Combined", "A.Combined_a", "B.Combined", "B.Combined_b"][..],
            &["A.Combined_a", "B.Combined_b"],
            &["A.Combined_a", "A.Combined", "A.001.Combined_b"],
        ] {
            assert!(sum(two).unwrap_err().contains("'A.Combined"), "{two:?}");
        }
    }

    #[test]
    fn expressions_find_lights() {
        assert_eq!(lights(&["a.x", "b.x", "c"], Some(r"^(.)\.x$")), ["a", "b"]);
        assert_eq!(lights(&["main.L_key_x", "main.L_fill_x"], Some("L_(?<light>[a-z]+)_(x)")), ["fill", "key"]);
        assert_eq!(lights(&["key", "fill", "RGBA"], Some("key|fill")), ["fill", "key"], "no group: all of the match");
    }

    #[test]
    fn views_are_one_by_name_or_refused() {
        let layer = |name, stem, view| Named { name, stem, view: Some(view), is_grey: false };
        let eyes = [
            layer("V.Combined.left", "V.Combined", "left"),
            layer("V.Combined.right", "V.Combined", "right"),
            layer("V.Combined_key.left", "V.Combined_key", "left"),
            layer("V.Combined_key.right", "V.Combined_key", "right"),
        ];
        let (problem, hint) = roles(&eyes, None).unwrap_err();
        assert!(problem.contains("'left' and 'right'"), "{problem}");
        let Hint::OneView { pattern } = hint else { panic!("{hint:?}") };
        assert_eq!(pattern, r"^V\.Combined_(.+)\.left$");
        let found = roles(&eyes, Some(&pattern.parse().unwrap())).unwrap().roles;
        assert_eq!(found, [LayerRole::Sum, LayerRole::Ignored, LayerRole::Light("key".into()), LayerRole::Ignored]);
        assert!(roles(&eyes, Some(&"Combined_(.+)$".parse().unwrap())).is_err());
    }

    #[test]
    fn one_channel_is_data_unless_all_lights_are_so() {
        let grey = |name| Named { name, stem: name, view: None, is_grey: true };
        let lit = |layers: &[Named<'_>]| {
            let roles = roles(layers, None).unwrap().roles;
            roles.iter().filter(|role| matches!(role, LayerRole::Light(_))).count()
        };
        assert_eq!(lit(&[grey("key"), grey("fill"), grey("ao")]), 2);
        assert_eq!(lit(&[grey("matte 7"), named(&["key"])[0]]), 1);
    }
}
