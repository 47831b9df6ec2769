//! How renderers name the layers of single lights, one row for each renderer.

/// The layers that a renderer writes for single lights.
#[derive(Clone, Copy, Debug)]
pub(super) struct Naming {
    /// Who writes them; for the test that has a file of each.
    #[cfg_attr(not(test), expect(dead_code, reason = "tests alone ask who writes what"))]
    pub(super) renderer: &'static str,
    /// What begins a light's layer, before the light's name.
    pub(super) prefixes: &'static [&'static str],
    /// Names of whole layers of lights, in lower case and without signs; `#` stands for a number.
    pub(super) whole: &'static [&'static str],
    /// The same, of layers that are lights where others of this naming are there.
    pub(super) beside: &'static [&'static str],
    /// The layer under all lights by a name that only this renderer gives it, in lower case. The naming counts only beside it.
    pub(super) sum: Option<&'static str>,
}

const fn by_prefix(renderer: &'static str, prefixes: &'static [&'static str]) -> Naming {
    Naming { renderer, prefixes, whole: &[], beside: &[], sum: None }
}

/// The namings, of which the first counts that a file has. Sources are the renderers' public documents:
///
/// - Blender: what 4.2 writes, `ViewLayer.Combined_<group>`.
/// - Arnold: *Light Group Manager* and *Light Path Expression AOVs*, `RGBA_<group>`, with `RGBA_default` of lights in no group.
/// - V-Ray and Corona: *Light Select*, and the elements of *LightMix* where there are none of single lights.
/// - LuxCore: `RADIANCE_GROUP`.
/// - Karma: *LPE Tag*, the beauty `C` split as `C_<tag>`.
/// - RenderMan: the display channel `Ci` with the light group behind it, `Ci_<group>`, as its bridge to Blender builds the name.
/// - Redshift: *Light Group AOVs*, `Beauty_<group>`, with `Beauty_other` of the rest.
/// - Octane: *Light Passes*, `Light pass 1` (later `Light ID 1`), `Ambient light`, `Sunlight`, beside which direct and indirect
///   light of each may stand.
pub(super) const NAMINGS: [Naming; 9] = [
    by_prefix("Blender", &["Combined_"]),
    by_prefix("Arnold", &["RGBA_"]),
    by_prefix("V-Ray, Corona", &["VRayLightSelect_", "LightSelect_", "lightSelect_", "CShading_LightSelect_"]),
    Naming {
        renderer: "V-Ray, Corona: LightMix",
        prefixes: &["LightMix_", "VRayLightMix_", "CShading_LightMix_"],
        whole: &[],
        beside: &["environment", "selfillumination", "rest", "restoflights"],
        sum: None,
    },
    by_prefix("LuxCore", &["RADIANCE_GROUP_", "RADIANCE_GROUP#"]),
    Naming { renderer: "Karma", prefixes: &["C_"], whole: &[], beside: &[], sum: Some("c") },
    Naming { renderer: "RenderMan", prefixes: &["Ci_"], whole: &[], beside: &[], sum: Some("ci") },
    by_prefix("Redshift", &["Beauty_"]),
    Naming {
        renderer: "Octane",
        prefixes: &[],
        whole: &["lightpass#", "lightid#"],
        beside: &["ambientlight", "ambient", "sunlight"],
        sum: None,
    },
];

/// Whether a name, in lower case and without signs, is one of these, in which `#` stands for a number.
pub(super) fn is_one_of(name: &str, names: &[&str]) -> bool {
    names.iter().any(|known| match known.strip_suffix('#') {
        Some(before) => name
            .strip_prefix(before)
            .is_some_and(|number| !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit())),
        None => name == *known,
    })
}
