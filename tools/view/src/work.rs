//! The work on the lights: the mix with its undo, and what of it stands in a file.

use std::path::{Path, PathBuf};

use super::history::History;
use super::mixer::Mix;

/// A mix as it came to be.
#[derive(Clone, Debug)]
pub struct Work {
    /// State of the lights.
    pub mix: Mix,
    /// The scene's own.
    pub scene: Mix,
    history: History<Mix>,
    /// What needs no saving: the scene's own mix, or that of the file, with the revision of the snapshots.
    kept: (Mix, u64),
    look: Option<PathBuf>,
    /// An animation that stood in the file.
    pub keys: Vec<(f32, String)>,
}

impl Work {
    /// Begins with the scene's own mix.
    pub fn new(scene: Mix) -> Self {
        Self {
            mix: scene.clone(),
            history: History::new(scene.clone()),
            kept: (scene.clone(), 0),
            scene,
            look: None,
            keys: Vec::new(),
        }
    }

    /// Looks at the mix once a frame; `held` while a drag is on, which is one step.
    pub fn observe(&mut self, held: bool) {
        self.history.observe(&self.mix, held);
    }

    /// Takes the place of the mix, as one step of its own, though a drag may be on.
    pub fn replace(&mut self, mix: Mix) {
        self.history.observe(&self.mix, false);
        self.mix = mix;
        self.history.observe(&self.mix, false);
    }

    /// One step back.
    pub fn undo(&mut self) {
        // What was done in this frame is a step too.
        self.history.observe(&self.mix, false);
        self.mix = self.history.undo().unwrap_or_else(|| self.mix.clone());
    }

    /// One step forth again.
    pub fn redo(&mut self) {
        self.mix = self.history.redo().unwrap_or_else(|| self.mix.clone());
    }

    /// Whether there is something to undo.
    pub fn can_undo(&self) -> bool {
        self.history.can_undo()
    }

    /// Whether there is something to redo.
    pub fn can_redo(&self) -> bool {
        self.history.can_redo()
    }

    /// Back to the scene's own lighting; groups stay.
    pub fn reset(&mut self) {
        let mut mix = self.mix.clone();
        mix.reset(&self.scene);
        self.replace(mix);
    }

    /// Whether something would be lost if this were: snapshots are at `revision`. The scene's own mix cannot be lost.
    pub fn is_modified(&self, revision: u64) -> bool {
        self.kept.1 != revision || (self.kept.0 != self.mix && self.mix != self.scene)
    }

    /// The lighting file that it was saved to or loaded from.
    pub fn look(&self) -> Option<&Path> {
        self.look.as_deref()
    }

    /// The file in which the present mix stands, if there is one.
    pub fn saved_in(&self) -> Option<&Path> {
        self.look().filter(|_| self.kept.0 == self.mix)
    }

    /// Says that this mix and the snapshots of `revision` stand in a file.
    pub fn is_kept(&mut self, path: PathBuf, mix: Mix, revision: u64) {
        (self.look, self.kept) = (Some(path), (mix, revision));
    }

    /// Takes further lights in: `scene` is the scene's own mix with them, `carry` brings a mix there. All steps can still be undone.
    pub fn grow(&mut self, scene: Mix, carry: impl Fn(&Mix) -> Mix) {
        // What was the scene's own still is, though its groups by name may be others.
        let before = std::mem::replace(&mut self.scene, scene);
        let carry = |mix: &Mix| if *mix == before { self.scene.clone() } else { carry(mix) };
        (self.mix, self.kept.0) = (carry(&self.mix), carry(&self.kept.0));
        self.history.map(carry);
    }

    /// Goes on with the work on another container's lights, whose own mix is `scene`, by `carry`, which brings a mix there.
    /// Where nothing changes on the way, its steps can still be undone.
    pub fn go_on(&mut self, old: Self, carry: impl Fn(&Mix) -> Mix) {
        let mix = carry(&old.mix);
        let (kept, scene) = (carry(&old.kept.0), carry(&old.scene));
        let same = mix == old.mix && kept == old.kept.0 && scene == old.scene;
        // What was the scene's own follows the scene.
        let was_scene = |mix: &Mix| *mix == old.scene;
        let scenes = |own: Mix, before: &Mix| if was_scene(before) { self.scene.clone() } else { own };
        (self.mix, self.kept) = (scenes(mix, &old.mix), (scenes(kept, &old.kept.0), old.kept.1));
        self.history = if same && self.scene == old.scene { old.history } else { History::new(self.mix.clone()) };
        (self.look, self.keys) = (old.look, old.keys);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ltm::light::{Light, LightBasis, LightKind};

    fn basis(emission: [f32; 3]) -> LightBasis {
        let mut basis = LightBasis::new();
        for name in ["a", "b"] {
            let light = Light { emission, ..Light::unplaced(name, LightKind::Lamp) };
            basis.push(light).unwrap();
        }
        basis
    }

    #[test]
    fn every_replacing_act_is_one_step_even_during_a_drag() {
        let mut work = Work::new(Mix::of_scene(&basis([1.0; 3])));
        work.mix.lights[0].stops = 1.0;
        work.observe(true);
        let mut loaded = work.scene.clone();
        loaded.lights[1].stops = -3.0;
        work.replace(loaded.clone());
        assert!(work.mix == loaded && work.is_modified(0));
        work.undo();
        assert_eq!((work.mix.lights[0].stops, work.mix.lights[1].stops), (1.0, 0.0));
        work.reset();
        assert!(work.mix == work.scene && !work.is_modified(0) && work.is_modified(1));
        work.undo();
        assert_eq!(work.mix.lights[0].stops, 1.0);
        work.undo();
        assert!(work.mix == work.scene && !work.can_undo());
    }

    #[test]
    fn work_takes_further_lights_in_and_loses_no_step() {
        let (few, mut all) = (basis([1.0; 3]), basis([1.0; 3]));
        ["a1", "c"].iter().for_each(|name| all.push(Light::unplaced(*name, LightKind::Lamp)).unwrap());
        let scene = Mix::of_scene(&all);
        let mut work = Work::new(Mix::of_scene(&few));
        work.mix.lights[0].stops = 1.0;
        work.observe(false);
        work.is_kept("a.toml".into(), work.mix.clone(), 0);
        work.grow(scene.clone(), |mix| mix.grown(&few, &all, &scene));
        assert_eq!((work.mix.lights.len(), work.mix.lights[0].stops), (4, 1.0));
        assert!(!work.is_modified(0) && work.saved_in().is_some());
        work.mix.lights[3].on = false;
        work.observe(false);
        work.undo();
        assert!(work.mix.lights[3].on && work.saved_in().is_some());
        work.undo();
        assert!(work.mix == scene && !work.is_modified(0) && !work.can_undo());
    }

    #[test]
    fn what_is_kept_is_not_modified_until_it_changes() {
        let mut work = Work::new(Mix::of_scene(&basis([1.0; 3])));
        work.mix.lights[0].stops = 1.0;
        work.is_kept("a.toml".into(), work.mix.clone(), 3);
        assert!(!work.is_modified(3) && work.saved_in() == Some(Path::new("a.toml")));
        work.mix.lights[0].on = false;
        assert!(work.is_modified(3) && work.saved_in().is_none() && work.look().is_some());
    }

    #[test]
    fn the_work_goes_on_over_a_container_made_again() {
        let (old, new) = (basis([1.0; 3]), basis([2.0; 3]));
        let mut before = Work::new(Mix::of_scene(&old));
        before.mix.lights[0].stops = 1.0;
        before.observe(false);
        let scene = Mix::of_scene(&new);
        let mut same = Work::new(Mix::of_scene(&old));
        same.go_on(before.clone(), |mix| mix.carried(&old, &old, &Mix::of_scene(&old)));
        assert!(same.mix == before.mix && same.can_undo() && same.is_modified(0));
        let mut other = Work::new(scene.clone());
        other.go_on(before, |mix| mix.carried(&old, &new, &scene));
        assert_eq!(other.mix.lights[0].stops, 1.0);
        assert!(other.is_modified(0));
    }
}
