//! What is on each light, and the lighting that this makes.

use std::ops::RangeInclusive;

use super::groups::Groups;
use super::pattern::{Pattern, Shape};
use ltm::error::Result;
use ltm::image::{KELVIN_RANGE, kelvin_to_linear, luminance};
use ltm::light::{Light, LightBasis, Lighting};

/// How far a light can be taken up or down, in stops.
pub const STOPS_RANGE: RangeInclusive<f32> = -8.0..=8.0;

/// Share of a colour's largest channel by which two colours that count as the same may differ.
const SAME_COLOUR: f32 = 1e-5;

/// Colour of a light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Tint {
    /// As the scene file lights it.
    #[default]
    Scene,
    /// A linear Rec. 709 colour; its brightness does not count.
    Colour([f32; 3]),
    /// A black body, in kelvin.
    Kelvin(f32),
}

/// What is on one light.
#[derive(Clone, Debug, PartialEq)]
pub struct LightMix {
    /// Whether it shines.
    pub on: bool,
    /// Whether it is among those heard alone.
    pub solo: bool,
    /// Brightness against the scene's, in stops.
    pub stops: f32,
    /// Colour.
    pub tint: Tint,
    /// What each texel is multiplied by; none: 1 everywhere.
    pub pattern: Option<Pattern>,
    /// The shape that made the pattern, as long as nothing else has changed it.
    pub shape: Option<Shape>,
    /// How far an environment is turned about the vertical, to the right, in radians.
    pub turn_radians: f32,
}

/// What is on a group of lights, on top of what is on each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroupMix {
    /// Whether its lights may shine.
    pub on: bool,
    /// Brightness of all its lights, in stops.
    pub stops: f32,
}

/// What is on all lights and groups.
#[derive(Clone, Debug, PartialEq)]
pub struct Mix {
    /// One for each light of the basis.
    pub lights: Vec<LightMix>,
    /// One for each group.
    pub groups: Vec<GroupMix>,
}

impl LightMix {
    /// As its emission in the scene file lights it: off if it has none. A map of its own is not in it: see
    /// [`Mix::of_scene`].
    pub fn of_scene(light: &Light) -> Self {
        let on = luminance(light.emission) != 0.0;
        Self { on, solo: false, stops: 0.0, tint: Tint::Scene, pattern: None, shape: None, turn_radians: 0.0 }
    }

    /// Weight of a texel with pattern 1, were the light on: the tint with the luminance of the scene's emission, which
    /// counts as 1 where there is none.
    pub fn colour(&self, light: &Light) -> [f32; 3] {
        let of_scene = if luminance(light.emission) == 0.0 { [1.0; 3] } else { light.emission };
        let bright = |colour: [f32; 3]| {
            let own = luminance(colour);
            if own <= 0.0 { [0.0; 3] } else { colour.map(|v| v / own * luminance(of_scene)) }
        };
        match self.tint {
            Tint::Scene => of_scene,
            Tint::Colour(colour) => bright(colour),
            Tint::Kelvin(kelvin) => bright(kelvin_to_linear(kelvin)),
        }
    }

    /// What gives a light these weights. One weight on all texels becomes stops and a tint, a black body's where one
    /// fits; other weights become a pattern.
    pub fn of_weights(light: &Light, weights: &[[f32; 3]]) -> Self {
        let of_scene = Self::of_scene(light);
        let Some(first) = weights.first().filter(|_| weights.iter().flatten().any(|v| *v != 0.0)) else {
            return Self { on: false, ..of_scene };
        };
        let mix = Self { on: true, ..of_scene };
        let base = mix.colour(light);
        if weights.iter().all(|weight| weight == first) {
            let stops = (luminance(*first) / luminance(base)).log2();
            let near = |colour: [f32; 3]| {
                let peak = first.iter().copied().fold(0.0, f32::max);
                let gain = stops.exp2();
                (0..3).all(|ch| (colour[ch] * gain - first[ch]).abs() <= SAME_COLOUR * peak)
            };
            let tints = [Tint::Scene, Tint::Kelvin(kelvin_of(*first).round()), Tint::Kelvin(kelvin_of(*first))];
            let positive = first.iter().all(|v| *v >= 0.0);
            let tint = tints.into_iter().find(|&tint| near(Self { tint, ..mix.clone() }.colour(light)));
            if positive && STOPS_RANGE.contains(&stops) {
                let peak = first.iter().copied().fold(0.0, f32::max);
                return Self { stops, tint: tint.unwrap_or(Tint::Colour(first.map(|v| v / peak))), ..mix };
            }
        }
        // A channel that the scene's colour lacks could not be multiplied up from it.
        let tint = if base.iter().all(|v| *v > 0.0) { Tint::Scene } else { Tint::Colour([1.0; 3]) };
        let mix = Self { tint, ..mix };
        let base = mix.colour(light);
        let mut pattern = Pattern::white(light.layout());
        for (texel, weight) in pattern.texels_mut().iter_mut().zip(weights) {
            *texel = [0, 1, 2].map(|ch: usize| weight[ch] / base[ch]);
        }
        Self { pattern: Some(pattern), ..mix }
    }

    /// Whether both are the same, solo aside.
    pub fn is_like(&self, other: &Self) -> bool {
        *self == Self { solo: self.solo, ..other.clone() }
    }
}

impl Default for GroupMix {
    fn default() -> Self {
        Self { on: true, stops: 0.0 }
    }
}

impl Mix {
    /// The scene's own lighting.
    pub fn of_scene(basis: &LightBasis, groups: &Groups) -> Self {
        Self::of_lighting(basis, groups, &Lighting::of_scene(basis))
    }

    /// What gives this lighting: see [`LightMix::of_weights`].
    pub fn of_lighting(basis: &LightBasis, groups: &Groups, lighting: &Lighting) -> Self {
        let of_light = |light: &Light| {
            let columns = light.columns();
            LightMix::of_weights(light, &lighting.weights()[columns.start as usize..columns.end as usize])
        };
        let groups = vec![GroupMix::default(); groups.len()];
        Self { lights: basis.lights().iter().map(of_light).collect(), groups }
    }

    /// Whether any light is heard alone.
    pub fn has_solo(&self) -> bool {
        self.lights.iter().any(|light| light.solo)
    }

    /// Whether a light shines: on, its group on, and solo if any light is.
    pub fn shines(&self, light: usize, groups: &Groups) -> bool {
        let mix = &self.lights[light];
        let group = groups.of_light(light).is_none_or(|group| self.groups[group].on);
        mix.on && group && (mix.solo || !self.has_solo())
    }

    /// Solo on one light, alone among all; where it is that already, no solo at all. `add` leaves the others' as it is.
    pub fn toggle_solo(&mut self, light: usize, add: bool) {
        let was = self.lights[light].solo;
        let others = self.lights.iter().enumerate().any(|(i, mix)| mix.solo && i != light);
        if !add {
            self.lights.iter_mut().for_each(|mix| mix.solo = false);
        }
        self.lights[light].solo = if add { !was } else { !was || others };
    }

    /// The lighting over the basis.
    ///
    /// Errors: weights that overflow.
    pub fn lighting(&self, basis: &LightBasis, groups: &Groups) -> Result<Lighting> {
        let mut weights = vec![[0.0; 3]; basis.column_count()];
        let any_solo = self.has_solo();
        for (index, (light, mix)) in basis.lights().iter().zip(&self.lights).enumerate() {
            let group = groups.of_light(index).map_or(GroupMix::default(), |group| self.groups[group]);
            if !(mix.on && group.on && (mix.solo || !any_solo)) {
                continue;
            }
            let gain = (mix.stops + group.stops).exp2();
            let colour = mix.colour(light).map(|v| v * gain);
            let own = &mut weights[light.columns().start as usize..light.columns().end as usize];
            match &mix.pattern {
                None => own.fill(colour),
                Some(pattern) => {
                    let turned = pattern.turned(light.kind, mix.turn_radians);
                    for (weight, texel) in own.iter_mut().zip(turned.texels()) {
                        *weight = [0, 1, 2].map(|ch| colour[ch] * texel[ch]);
                    }
                }
            }
        }
        Lighting::new(weights)
    }
}

/// Temperature, in kelvin, of the black body that has the same ratio of red to blue.
fn kelvin_of([red, _, blue]: [f32; 3]) -> f32 {
    let (mut low, mut high) = (*KELVIN_RANGE.start(), *KELVIN_RANGE.end());
    // Red falls against blue all the way up; f32 is exhausted before the steps are.
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        let [r, _, b] = kelvin_to_linear(middle);
        if r * blue > b * red { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ltm::light::LightKind;

    fn basis() -> LightBasis {
        let mut basis = LightBasis::new();
        for (name, kind, emission) in [
            ("lamp.1", LightKind::Lamp, [2.0, 1.0, 0.5]),
            ("lamp.2", LightKind::Lamp, [1.0; 3]),
            ("panel", LightKind::AreaTexels { across: 2, down: 2 }, [3.0; 3]),
            ("spare", LightKind::Point, [0.0; 3]),
        ] {
            let light = Light { emission, ..Light::unplaced(name, kind) };
            basis.push(light).unwrap();
        }
        basis
    }

    #[test]
    fn untouched_it_is_the_scenes_own_lighting() {
        let (basis, groups) = (basis(), Groups::of(&basis()));
        let mix = Mix::of_scene(&basis, &groups);
        assert_eq!(mix.lighting(&basis, &groups).unwrap(), Lighting::of_scene(&basis));
    }

    #[test]
    fn a_stop_doubles_and_a_tint_keeps_the_luminance() {
        let (basis, groups) = (basis(), Groups::of(&basis()));
        let mut mix = Mix::of_scene(&basis, &groups);
        mix.lights[0].stops = 1.0;
        assert_eq!(mix.lighting(&basis, &groups).unwrap().weights()[0], [4.0, 2.0, 1.0]);
        for tint in [Tint::Kelvin(2700.0), Tint::Colour([0.1, 0.0, 0.4])] {
            mix.lights[0].tint = tint;
            let weight = mix.lighting(&basis, &groups).unwrap().weights()[0];
            assert!((luminance(weight) / luminance([4.0, 2.0, 1.0]) - 1.0).abs() < 1e-5);
        }
        mix.lights[0].tint = Tint::Colour([0.0; 3]);
        assert_eq!(mix.lighting(&basis, &groups).unwrap().weights()[0], [0.0; 3]);
    }

    #[test]
    fn a_groups_stops_add_to_its_lights() {
        let (basis, groups) = (basis(), Groups::of(&basis()));
        assert_eq!(groups.len(), 1);
        let mut mix = Mix::of_scene(&basis, &groups);
        mix.groups[0].stops = -1.0;
        mix.lights[1].stops = 3.0;
        let weights = mix.lighting(&basis, &groups).unwrap();
        assert_eq!(weights.weights()[..2], [[1.0, 0.5, 0.25], [4.0; 3]]);
        mix.groups[0].on = false;
        let weights = mix.lighting(&basis, &groups).unwrap();
        assert_eq!(weights.weights()[..3], [[0.0; 3], [0.0; 3], [3.0; 3]]);
    }

    #[test]
    fn solo_silences_the_others_and_a_second_time_brings_them_back() {
        let (basis, groups) = (basis(), Groups::of(&basis()));
        let mut mix = Mix::of_scene(&basis, &groups);
        let shining = |mix: &Mix| (0..4).filter(|&i| mix.shines(i, &groups)).collect::<Vec<_>>();
        mix.toggle_solo(1, false);
        assert_eq!(shining(&mix), [1]);
        mix.toggle_solo(2, true);
        assert_eq!(shining(&mix), [1, 2]);
        mix.toggle_solo(2, false);
        assert_eq!(shining(&mix), [2]);
        mix.toggle_solo(2, false);
        assert_eq!(shining(&mix), [0, 1, 2]);
        let weights = mix.lighting(&basis, &groups).unwrap();
        assert_eq!(weights.weights()[6], [0.0; 3], "a light that the scene leaves dark starts switched off");
    }

    #[test]
    fn weights_are_understood_as_stops_tints_and_patterns() {
        let basis = basis();
        let lamp = &basis.lights()[0];
        let read = |weight: [f32; 3]| LightMix::of_weights(lamp, &[weight]);
        assert_eq!(read([2.0, 1.0, 0.5]), LightMix::of_scene(lamp));
        assert_eq!(read([8.0, 4.0, 2.0]).stops, 2.0);
        assert_eq!(read([0.0; 3]), LightMix { on: false, ..LightMix::of_scene(lamp) });
        let warm = LightMix { tint: Tint::Kelvin(2700.0), ..LightMix::of_scene(lamp) }.colour(lamp);
        assert_eq!(read(warm.map(|v| v * 0.25)).tint, Tint::Kelvin(2700.0));
        let green = read([0.0, 3.0, 0.0]);
        assert_eq!(green.tint, Tint::Colour([0.0, 1.0, 0.0]));
        assert!((luminance(green.colour(lamp)) * green.stops.exp2() / luminance([0.0, 3.0, 0.0]) - 1.0).abs() < 1e-5);
        let far = read([2e6, 1e6, 5e5]);
        assert_eq!((far.stops, far.pattern.unwrap().texels()), (0.0, &[[1e6; 3]][..]));
        let panel = LightMix::of_weights(&basis.lights()[2], &[[0.0; 3], [3.0; 3], [6.0; 3], [3.0, 0.0, 0.0]]);
        assert_eq!(panel.pattern.unwrap().texels(), [[0.0; 3], [1.0; 3], [2.0; 3], [1.0, 0.0, 0.0]]);
    }

    #[test]
    fn a_pattern_multiplies_texel_by_texel() {
        let (basis, groups) = (basis(), Groups::of(&basis()));
        let mut mix = Mix::of_scene(&basis, &groups);
        let mut pattern = Pattern::white((2, 2));
        pattern.texels_mut()[3] = [0.5, 0.0, 2.0];
        mix.lights[2].pattern = Some(pattern);
        let lighting = mix.lighting(&basis, &groups).unwrap();
        assert_eq!(lighting.weights()[2..6], [[3.0; 3], [3.0; 3], [3.0; 3], [1.5, 0.0, 6.0]]);
    }
}
