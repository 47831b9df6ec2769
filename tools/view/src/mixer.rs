//! What is on each light, and the lighting that this makes.

use std::borrow::Cow;
use std::collections::HashMap;
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
    /// The colour of the scene file.
    #[default]
    Scene,
    /// A linear Rec. 709 colour; its brightness does not count.
    Colour([f32; 3]),
    /// A black body, in kelvin.
    Kelvin(f32),
}

/// State of one light.
#[derive(Clone, Debug, PartialEq)]
pub struct LightMix {
    /// Whether it shines.
    pub on: bool,
    /// Whether it is soloed.
    pub solo: bool,
    /// Brightness against the scene's, in stops.
    pub stops: f32,
    /// Colour.
    pub tint: Tint,
    /// Factor of each texel; `None` for 1 everywhere.
    pub pattern: Option<Pattern>,
    /// The shape that made the pattern, as long as nothing else has changed it.
    pub shape: Option<Shape>,
    /// How far an environment is turned about the vertical, to the right, in radians.
    pub turn_radians: f32,
}

/// State of all lights and groups.
#[derive(Clone, Debug, PartialEq)]
pub struct Mix {
    /// One for each light of the basis.
    pub lights: Vec<LightMix>,
    /// The groups with what is on each.
    pub groups: Groups,
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

    /// Whether both are equal apart from solo.
    pub fn is_like(&self, other: &Self) -> bool {
        *self == Self { solo: self.solo, ..other.clone() }
    }
}

impl Mix {
    /// The scene's own lighting, in groups by name.
    pub fn of_scene(basis: &LightBasis) -> Self {
        Self::of_lighting(basis, &Lighting::of_scene(basis))
    }

    /// The state that gives this lighting: see [`LightMix::of_weights`]. Groups come from names.
    pub fn of_lighting(basis: &LightBasis, lighting: &Lighting) -> Self {
        let of_light = |light: &Light| {
            let columns = light.columns();
            LightMix::of_weights(light, &lighting.weights()[columns.start as usize..columns.end as usize])
        };
        Self { lights: basis.lights().iter().map(of_light).collect(), groups: Groups::of(basis) }
    }

    /// Whether any light or group is soloed.
    pub fn has_solo(&self) -> bool {
        self.lights.iter().any(|light| light.solo) || self.groups.list().iter().any(|group| group.solo)
    }

    /// Whether a light shines. If nothing is soloed, it and all groups around it must be on. Otherwise it, or a group
    /// around it, must be soloed, which overrides that it or its group is off; what is off inside a soloed group stays
    /// off.
    pub fn shines(&self, light: usize) -> bool {
        self.shines_among(light, self.has_solo())
    }

    fn shines_among(&self, light: usize, any_solo: bool) -> bool {
        let mix = &self.lights[light];
        if mix.solo {
            return true;
        }
        let mut on = mix.on;
        for group in self.groups.around(light).map(|group| self.groups.group(group)) {
            if group.solo {
                return on;
            }
            on &= group.on;
        }
        on && !any_solo
    }

    /// Stops of a light with those of all groups around it.
    pub fn stops(&self, light: usize) -> f32 {
        let of_groups: f32 = self.groups.around(light).map(|group| self.groups.group(group).stops).sum();
        self.lights[light].stops + of_groups
    }

    /// Solo on one light, alone among all; where it is that already, no solo at all. `add` leaves the others' as it is.
    pub fn toggle_solo(&mut self, light: usize, add: bool) {
        let was = self.lights[light].solo;
        let alone = self.solo_count() == 1;
        if !add {
            self.clear_solo();
        }
        self.lights[light].solo = if add { !was } else { !(was && alone) };
    }

    /// As [`toggle_solo`](Self::toggle_solo), for a group.
    pub fn toggle_group_solo(&mut self, group: usize, add: bool) {
        let was = self.groups.group(group).solo;
        let alone = self.solo_count() == 1;
        if !add {
            self.clear_solo();
        }
        self.groups.group_mut(group).solo = if add { !was } else { !(was && alone) };
    }

    fn solo_count(&self) -> usize {
        let lights = self.lights.iter().filter(|light| light.solo).count();
        lights + self.groups.list().iter().filter(|group| group.solo).count()
    }

    /// Ends all solo.
    pub fn clear_solo(&mut self) {
        self.lights.iter_mut().for_each(|light| light.solo = false);
        self.groups.iter_mut().for_each(|group| group.solo = false);
    }

    /// Switches all lights; on also all groups.
    pub fn switch_all(&mut self, on: bool) {
        self.lights.iter_mut().for_each(|light| light.on = on);
        if on {
            self.groups.iter_mut().for_each(|group| group.on = true);
        }
    }

    /// Sets all lights to what they are in `scene`; groups stay, and change nothing.
    pub fn reset(&mut self, scene: &Self) {
        self.lights.clone_from(&scene.lights);
        for group in self.groups.iter_mut() {
            (group.on, group.solo, group.stops) = (true, false, 0.0);
        }
    }

    /// This mix over other lights: what lights of the same name and texels have, the rest as in `scene`; groups follow
    /// their lights.
    pub fn carried(&self, from: &LightBasis, to: &LightBasis, scene: &Self) -> Self {
        let of_old: HashMap<&str, usize> =
            from.lights().iter().enumerate().map(|(i, light)| (light.name.as_str(), i)).collect();
        let same = |light: &Light| {
            let old = *of_old.get(light.name.as_str())?;
            (from.lights()[old].layout() == light.layout()).then_some(old)
        };
        let olds: Vec<Option<usize>> = to.lights().iter().map(same).collect();
        let lights = olds.iter().zip(&scene.lights).map(|(old, own)| match old {
            Some(old) => self.lights[*old].clone(),
            None => own.clone(),
        });
        let parts = (0..self.groups.len()).map(|group| {
            let is_own = |old: &Option<usize>| old.is_some_and(|old| self.groups.of_light(old) == Some(group));
            let own = olds.iter().enumerate().filter(|(_, old)| is_own(old)).map(|(light, _)| light).collect();
            (self.groups.group(group).clone(), own)
        });
        Self { lights: lights.collect(), groups: Groups::from_parts(parts.collect(), to.lights().len()) }
    }

    /// This mix with further lights, which stand behind its own in `to`: they are as in `scene`, the mix of the scene there, in its groups.
    pub fn grown(&self, from: &LightBasis, to: &LightBasis, scene: &Self) -> Self {
        let mut grown = self.carried(from, to, scene);
        for light in from.lights().len()..to.lights().len() {
            let Some(group) = scene.groups.of_light(light).map(|group| scene.groups.group(group)) else { continue };
            match grown.groups.find(&group.name) {
                Some(group) => grown.groups.put(light, Some(group)),
                None => drop(grown.groups.make(&group.name, &[light])),
            }
        }
        grown
    }

    /// The mix of some of the lights, by their indices, in another basis that has these alone. Each shines as it does among all: if only
    /// others are soloed, none does.
    pub fn picked(&self, lights: &[usize]) -> Cow<'_, Self> {
        if lights.len() == self.lights.len() && lights.iter().enumerate().all(|(own, &light)| own == light) {
            return Cow::Borrowed(self);
        }
        let parts = (0..self.groups.len()).map(|group| {
            let is_own = |own: &usize| self.groups.of_light(lights[*own]) == Some(group);
            (self.groups.group(group).clone(), (0..lights.len()).filter(is_own).collect())
        });
        let groups = Groups::from_parts(parts.collect(), lights.len());
        let mut picked = Self { lights: lights.iter().map(|&light| self.lights[light].clone()).collect(), groups };
        if self.has_solo() && !picked.has_solo() {
            picked.switch_all(false);
        }
        Cow::Owned(picked)
    }

    /// The lighting over the basis.
    ///
    /// Errors: weights that overflow.
    pub fn lighting(&self, basis: &LightBasis) -> Result<Lighting> {
        let mut weights = vec![[0.0; 3]; basis.column_count()];
        let any_solo = self.has_solo();
        for (index, (light, mix)) in basis.lights().iter().zip(&self.lights).enumerate() {
            if !self.shines_among(index, any_solo) {
                continue;
            }
            let gain = self.stops(index).exp2();
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
        let basis = basis();
        let mix = Mix::of_scene(&basis);
        assert_eq!(mix.lighting(&basis).unwrap(), Lighting::of_scene(&basis));
    }

    #[test]
    fn a_stop_doubles_and_a_tint_keeps_the_luminance() {
        let basis = basis();
        let mut mix = Mix::of_scene(&basis);
        mix.lights[0].stops = 1.0;
        assert_eq!(mix.lighting(&basis).unwrap().weights()[0], [4.0, 2.0, 1.0]);
        for tint in [Tint::Kelvin(2700.0), Tint::Colour([0.1, 0.0, 0.4])] {
            mix.lights[0].tint = tint;
            let weight = mix.lighting(&basis).unwrap().weights()[0];
            assert!((luminance(weight) / luminance([4.0, 2.0, 1.0]) - 1.0).abs() < 1e-5);
        }
        mix.lights[0].tint = Tint::Colour([0.0; 3]);
        assert_eq!(mix.lighting(&basis).unwrap().weights()[0], [0.0; 3]);
    }

    #[test]
    fn a_groups_stops_add_to_its_lights() {
        let basis = basis();
        let mut mix = Mix::of_scene(&basis);
        assert_eq!(mix.groups.len(), 1);
        mix.groups.group_mut(0).stops = -1.0;
        mix.lights[1].stops = 3.0;
        let weights = mix.lighting(&basis).unwrap();
        assert_eq!(weights.weights()[..2], [[1.0, 0.5, 0.25], [4.0; 3]]);
        mix.groups.group_mut(0).on = false;
        let weights = mix.lighting(&basis).unwrap();
        assert_eq!(weights.weights()[..3], [[0.0; 3], [0.0; 3], [3.0; 3]]);
    }

    #[test]
    fn solo_silences_the_others_and_a_second_time_brings_them_back() {
        let basis = basis();
        let mut mix = Mix::of_scene(&basis);
        let shining = |mix: &Mix| (0..4).filter(|&i| mix.shines(i)).collect::<Vec<_>>();
        mix.toggle_solo(1, false);
        assert_eq!(shining(&mix), [1]);
        mix.toggle_solo(2, true);
        assert_eq!(shining(&mix), [1, 2]);
        mix.toggle_solo(2, false);
        assert_eq!(shining(&mix), [2]);
        mix.toggle_solo(2, false);
        assert_eq!(shining(&mix), [0, 1, 2]);
        let weights = mix.lighting(&basis).unwrap();
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
        let basis = basis();
        let mut mix = Mix::of_scene(&basis);
        let mut pattern = Pattern::white((2, 2));
        pattern.texels_mut()[3] = [0.5, 0.0, 2.0];
        mix.lights[2].pattern = Some(pattern);
        let lighting = mix.lighting(&basis).unwrap();
        assert_eq!(lighting.weights()[2..6], [[3.0; 3], [3.0; 3], [3.0; 3], [1.5, 0.0, 6.0]]);
    }

    #[test]
    fn a_soloed_light_shines_though_it_is_off_and_a_soloed_group_leaves_off_what_is_off() {
        let basis = basis();
        let mut mix = Mix::of_scene(&basis);
        let shining = |mix: &Mix| (0..4).filter(|&i| mix.shines(i)).collect::<Vec<_>>();
        mix.lights[0].on = false;
        mix.groups.group_mut(0).on = false;
        mix.toggle_solo(0, false);
        assert_eq!(shining(&mix), [0]);
        mix.toggle_group_solo(0, false);
        assert_eq!(shining(&mix), [1], "the group counts as on, what is off in it does not");
        mix.toggle_solo(2, true);
        assert_eq!(shining(&mix), [1, 2]);
        mix.toggle_group_solo(0, true);
        assert_eq!(shining(&mix), [2]);
        // A group around the soloed one, off, does not darken it.
        mix.clear_solo();
        let inner = mix.groups.make("inner", &[1]).unwrap();
        mix.toggle_group_solo(inner, false);
        assert_eq!(shining(&mix), [1]);
        assert_eq!(mix.lighting(&basis).unwrap().weights()[0], [0.0; 3]);
        mix.reset(&Mix::of_scene(&basis));
        assert_eq!((shining(&mix), mix.groups.len()), (vec![0, 1, 2], 2));
        mix.switch_all(false);
        assert!(shining(&mix).is_empty());
        mix.switch_all(true);
        assert_eq!(shining(&mix), [0, 1, 2, 3]);
    }

    #[test]
    fn a_mix_is_carried_to_the_lights_of_the_same_name() {
        let (old, mut new) = (basis(), LightBasis::new());
        for (name, kind) in [
            ("door", LightKind::Lamp),
            ("lamp.2", LightKind::Lamp),
            ("panel", LightKind::AreaTexels { across: 3, down: 2 }),
            ("lamp.1", LightKind::Lamp),
        ] {
            new.push(Light::unplaced(name, kind)).unwrap();
        }
        let mut mix = Mix::of_scene(&old);
        mix.groups.group_mut(0).stops = -2.0;
        mix.lights[0].stops = 1.0;
        mix.lights[2].stops = 3.0;
        let carried = mix.carried(&old, &new, &Mix::of_scene(&new));
        assert_eq!(carried.lights.iter().map(|light| light.stops).collect::<Vec<_>>(), [0.0, 0.0, 0.0, 1.0]);
        assert_eq!((carried.groups.lights(0), carried.groups.group(0).stops), (vec![1, 3], -2.0));
        assert_eq!(mix.carried(&old, &old, &Mix::of_scene(&old)), mix);
    }

    #[test]
    fn a_mix_grows_by_lights_and_some_of_them_shine_as_they_do_among_all() {
        let few = basis();
        let mut all = basis();
        for name in ["lamp.3", "bar/1", "bar/2"] {
            all.push(Light::unplaced(name, LightKind::Lamp)).unwrap();
        }
        let scene = Mix::of_scene(&all);
        let mut mix = Mix::of_scene(&few);
        mix.lights[1].stops = 2.0;
        mix.groups.group_mut(0).stops = -1.0;
        let mut grown = mix.grown(&few, &all, &scene);
        assert_eq!(grown.lights[..4], mix.lights);
        assert_eq!(grown.groups.lights(0), [0, 1, 4], "lamp.3 joins the lamps");
        assert_eq!(grown.groups.find("bar").map(|bar| grown.groups.lights(bar)), Some(vec![5, 6]));
        assert_eq!(*grown.picked(&[0, 1, 2, 3]), mix);
        assert!(matches!(grown.picked(&[0, 1, 2, 3, 4, 5, 6]), Cow::Borrowed(_)));
        // In another order, with a light left out.
        let mut own = LightBasis::new();
        [5, 1].iter().for_each(|&light| own.push(all.lights()[light].clone()).unwrap());
        let weights = |mix: &Mix| mix.picked(&[5, 1]).lighting(&own).unwrap().weights().to_vec();
        assert_eq!(weights(&grown), [[1.0; 3], [2.0; 3]], "two stops up, and one down with its group");
        grown.lights[6].solo = true;
        assert_eq!(weights(&grown), [[0.0; 3]; 2], "another is soloed");
        grown.toggle_group_solo(0, true);
        assert_eq!(weights(&grown), [[0.0; 3], [2.0; 3]]);
    }
}
