//! The lights of several views of one scene, so that one mix lights them all.

use std::borrow::Cow;

use super::mixer::Mix;
use ltm::error::Result;
use ltm::light::{Light, LightBasis};

/// The lights of all views, those of the first in front.
#[derive(Clone, Debug, PartialEq)]
pub struct SharedLights {
    basis: LightBasis,
    /// How many views have each light.
    views: Vec<usize>,
}

/// The lights of one view among those of all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ViewLights(Vec<usize>);

impl SharedLights {
    /// Those of one view.
    pub fn of(basis: &LightBasis) -> (Self, ViewLights) {
        let count = basis.lights().len();
        (Self { basis: basis.clone(), views: vec![1; count] }, ViewLights((0..count).collect()))
    }

    /// All lights as one basis, in which indices stay when views are added.
    pub fn basis(&self) -> &LightBasis {
        &self.basis
    }

    /// All lights.
    pub fn lights(&self) -> &[Light] {
        self.basis.lights()
    }

    /// Adds the lights of a further view. A light is one that is there already if it has its name, its texels and its unit. Another of
    /// that name stands beside it, with the name of the view behind its own.
    ///
    /// Errors: together they have more columns than a matrix can have; nothing is added.
    pub fn add(&mut self, basis: &LightBasis, view: &str) -> Result<ViewLights> {
        let mut all = self.clone();
        let scene = basis.scene_weights();
        let mut own = Vec::new();
        for light in basis.lights() {
            let same = |other: &Light| other.layout() == light.layout() && other.unit == light.unit;
            let found = all.lights().iter().position(|other| other.name == light.name);
            let index = match found.filter(|&index| same(&all.lights()[index])) {
                Some(index) => index,
                None => {
                    let name = found.map_or_else(|| light.name.clone(), |_| all.free_name(&light.name, view));
                    all.basis.push(Light { name, ..light.clone() })?;
                    all.views.push(0);
                    let weights = &scene[light.first_column as usize..light.columns().end as usize];
                    let index = all.views.len() - 1;
                    if weights.iter().any(|weight| *weight != light.emission) {
                        all.basis.set_scene_weights(all.lights()[index].first_column, weights.to_vec())?;
                    }
                    index
                }
            };
            all.views[index] += 1;
            own.push(index);
        }
        *self = all;
        Ok(ViewLights(own))
    }

    /// Takes the lights of a view out. Those that no other has keep their places.
    pub fn remove(&mut self, view: &ViewLights) {
        view.0.iter().for_each(|&light| self.views[light] -= 1);
    }

    /// Lights that one of so many views has, and how many of them not all have.
    pub fn counts(&self, views: usize) -> (usize, usize) {
        let present = || self.views.iter().filter(|&&own| own > 0);
        (present().count(), present().filter(|&&own| own < views).count())
    }

    /// Whether another view has any light of this one.
    pub fn are_shared(&self, view: &ViewLights) -> bool {
        view.0.iter().any(|&light| self.views[light] > 1)
    }

    fn free_name(&self, name: &str, view: &str) -> String {
        let numbered = (2..).map(|number| format!("{name} ({view}, {number})"));
        let mut names = std::iter::once(format!("{name} ({view})")).chain(numbered);
        names.find(|name| self.basis.find(name).is_none()).unwrap_or_default()
    }
}

impl ViewLights {
    /// The place among all of each light of the view, in the view's order.
    pub fn places(&self) -> &[usize] {
        &self.0
    }

    /// The view's own index of one of all lights, if it has that.
    pub fn own(&self, light: usize) -> Option<usize> {
        // Lights of the first view stand where they stand in it.
        let as_it_stands = self.0.get(light).filter(|&&place| place == light).map(|_| light);
        as_it_stands.or_else(|| self.0.iter().position(|&place| place == light))
    }

    /// Whether the view has all lights, in their order.
    pub fn are_all(&self, shared: &SharedLights) -> bool {
        self.0.len() == shared.views.len() && self.0.iter().enumerate().all(|(own, &place)| own == place)
    }

    /// A mix of all lights as one of the view's own.
    pub fn mix<'a>(&self, all: &'a Mix) -> Cow<'a, Mix> {
        all.picked(&self.0)
    }

    /// Values of the view's lights as values of all, zero for those that it lacks.
    pub fn spread(&self, own: &[f32], shared: &SharedLights) -> Vec<f32> {
        let mut values = vec![0.0; shared.views.len()];
        self.0.iter().zip(own).for_each(|(&place, &value)| values[place] = value);
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ltm::light::{LightKind, Lighting};

    fn basis(lights: &[(&str, LightKind)]) -> LightBasis {
        let mut basis = LightBasis::new();
        for (name, kind) in lights {
            basis.push(Light::unplaced(*name, *kind)).unwrap();
        }
        basis
    }

    fn panel(across: u32) -> LightKind {
        LightKind::AreaTexels { across, down: 1 }
    }

    fn names(shared: &SharedLights) -> Vec<&str> {
        shared.lights().iter().map(|light| light.name.as_str()).collect()
    }

    #[test]
    fn lights_are_one_by_name_and_texels_and_others_stand_behind() {
        let lobby = basis(&[("desk", LightKind::Lamp), ("panel", panel(2)), ("door", LightKind::Lamp)]);
        let mut bar = basis(&[("bottles", LightKind::Lamp), ("panel", panel(3)), ("desk", LightKind::Lamp)]);
        bar.set_scene_weights(1, vec![[0.0; 3], [5.0; 3], [1.0; 3]]).unwrap();
        let (mut shared, first) = SharedLights::of(&lobby);
        assert!(first.are_all(&shared) && shared.counts(1) == (3, 0));
        let second = shared.add(&bar, "bar").unwrap();
        assert_eq!(names(&shared), ["desk", "panel", "door", "bottles", "panel (bar)"]);
        assert_eq!(second.places(), [3, 4, 0]);
        assert_eq!([second.own(0), second.own(1), second.own(4)], [Some(2), None, Some(1)]);
        assert_eq!(shared.counts(2), (5, 4));
        assert!(shared.are_shared(&second) && !first.are_all(&shared));
        // The scene's own lighting of each view is that of all, seen from there.
        let all = Mix::of_scene(shared.basis());
        for (view, basis) in [(&first, &lobby), (&second, &bar)] {
            assert_eq!(view.mix(&all).lighting(basis).unwrap(), Lighting::of_scene(basis));
        }
        assert_eq!(second.spread(&[3.0, 4.0, 5.0], &shared), [5.0, 0.0, 0.0, 3.0, 4.0]);
        // The same view once more adds nothing.
        let again = shared.add(&lobby, "lobby").unwrap();
        assert_eq!((again, shared.counts(3)), (first.clone(), (5, 4)));
        shared.remove(&first);
        shared.remove(&second);
        assert_eq!((shared.counts(1), names(&shared).len()), ((3, 0), 5));
    }

    #[test]
    fn one_mix_lights_views_whose_lights_stand_in_another_order() {
        let lobby = basis(&[("a", LightKind::Lamp), ("b", panel(2))]);
        let stairs = basis(&[("b", panel(2)), ("a", LightKind::Lamp)]);
        let (mut shared, first) = SharedLights::of(&lobby);
        let second = shared.add(&stairs, "stairs").unwrap();
        let mut mix = Mix::of_scene(shared.basis());
        mix.lights[0].stops = 1.0;
        mix.lights[1].on = false;
        assert_eq!(first.mix(&mix).lighting(&lobby).unwrap().weights(), [[2.0; 3], [0.0; 3], [0.0; 3]]);
        assert_eq!(second.mix(&mix).lighting(&stairs).unwrap().weights(), [[0.0; 3], [0.0; 3], [2.0; 3]]);
        assert!(!shared.are_shared(&ViewLights(Vec::new())));
    }

    #[test]
    fn lights_of_other_scenes_share_nothing() {
        let (mut shared, room) = SharedLights::of(&basis(&[("a", LightKind::Lamp)]));
        let other = shared.add(&basis(&[("b", LightKind::Lamp)]), "other").unwrap();
        assert!(!shared.are_shared(&room) && !shared.are_shared(&other));
        assert_eq!(shared.counts(2), (2, 2));
    }
}
