//! What is read and written beside the worker, so that the window never waits for a disk.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::document::Document;
use crate::export;
use crate::looks;
use crate::mixer::LightMix;
use crate::pattern::Pattern;
use crate::worker::Brought;
use ltm::error::{Error, Result};
use ltm::image::{LinearImage, read_image};

impl Document {
    /// Puts what was brought where it belongs; what to say about it.
    pub(super) fn take(&mut self, brought: Brought) -> Result<String> {
        match brought {
            Brought::Message(message) => Ok(message),
            Brought::Wrote { path, mix, message } => {
                self.look = Some((path, mix));
                Ok(message)
            }
            Brought::Look { path, mix } => {
                self.mix = mix.clone();
                let message = format!("Lit by {}", path.display());
                self.look = Some((path, mix));
                Ok(message)
            }
            Brought::Image { path, light: None, image } => self.add_reference(&path, image),
            Brought::Image { path, light: Some(index), image } => {
                self.lay_image(index, &image);
                Ok(format!("{} lies on {}", path.display(), self.basis().lights()[index].name))
            }
        }
    }

    /// Lays an image over a light: a picture multiplies an area light, a map becomes what an environment sends.
    fn lay_image(&mut self, index: usize, image: &LinearImage) {
        let light = &self.session.basis().lights()[index];
        let mut pattern = Pattern::of_image(light.kind, image);
        let mix = &mut self.mix.lights[index];
        if light.kind.is_environment() {
            *mix = LightMix { solo: mix.solo, ..LightMix::of_weights(light, pattern.texels()) };
        } else {
            // A picture brighter than white would be no picture of this light.
            let peak = pattern.texels().iter().flatten().copied().fold(1.0, f32::max);
            pattern.texels_mut().iter_mut().flatten().for_each(|v| *v /= peak);
            (mix.pattern, mix.shape) = (Some(pattern), None);
        }
    }

    /// Does something that takes long beside the worker.
    fn beside(&mut self, work: impl FnOnce() -> Result<Brought> + Send + 'static) {
        self.beside += 1;
        self.session.worker.beside(work);
    }

    /// Reads an image for a light, or as a reference.
    pub(super) fn read_image(&mut self, path: PathBuf, light: Option<usize>) {
        self.beside(move || Ok(Brought::Image { image: read_image(&path)?, path, light }));
    }

    /// Reads a lighting file.
    pub(super) fn read_look(&mut self, path: PathBuf) {
        let (container, groups) = (self.session.container.clone(), self.groups.clone());
        self.beside(move || Ok(Brought::Look { mix: looks::load(&path, &container.job().basis, &groups)?, path }));
    }

    /// Writes the lighting.
    pub(super) fn write_look(&mut self, path: PathBuf) {
        let wrote = format!("Wrote {}", path.display());
        self.write_look_and_say(path, wrote);
    }

    fn write_look_and_say(&mut self, path: PathBuf, message: String) {
        let (container, groups, mix) = (self.session.container.clone(), self.groups.clone(), self.mix.clone());
        self.beside(move || {
            looks::save(&path, &container.job().basis, &groups, &mix)?;
            Ok(Brought::Wrote { path, mix, message })
        });
    }

    /// Writes the picture as it is shown.
    pub(super) fn write_png(&mut self, path: PathBuf) {
        let (Some(image), display) = (self.image.clone(), self.display) else { return };
        self.beside(move || export::write_png(&path, &image, &display).map(|()| wrote(&path)));
    }

    /// Writes the radiance.
    pub(super) fn write_exr(&mut self, path: PathBuf) {
        let Some(image) = self.image.clone() else { return };
        self.beside(move || export::write_radiance(&path, &image).map(|()| wrote(&path)));
    }

    /// Writes a layer for each light.
    pub(super) fn write_layers(&mut self, path: PathBuf) {
        let (container, relighter) = (self.session.container.clone(), self.relighter.clone());
        let (groups, mix) = (self.groups.clone(), self.mix.clone());
        self.beside(move || {
            export::write_layers(&path, &container, relighter.as_deref(), &groups, &mix)?;
            Ok(wrote(&path))
        });
    }

    /// The command that makes this picture; the lighting is written for it unless it stands in a file already.
    pub(super) fn command_line(&mut self) -> String {
        let saved = self.look.as_ref().filter(|(_, mix)| *mix == self.mix).map(|(path, _)| path.clone());
        let look = saved.clone().unwrap_or_else(|| export::with_ending(&self.export_base, "toml"));
        let png = export::with_ending(&self.export_base, "png");
        let line = export::command_line(&self.session.path, &look, &png, &self.display, self.lumens_per_watt());
        let message = format!("Copied: {line}");
        match saved {
            Some(_) => self.message = Some((message, false)),
            None => self.write_look_and_say(look, message),
        }
        line
    }

    /// Adds an image of the picture's size to compare with.
    fn add_reference(&mut self, path: &Path, image: LinearImage) -> Result<String> {
        let [width, height] = self.size();
        if [image.width, image.height] != [width, height] {
            let problem = format!("is {} × {} pixels, the picture {width} × {height}", image.width, image.height);
            return Err(Error::input(path.display().to_string(), problem, "give one of the same size"));
        }
        let name = path.file_name().map_or("reference".into(), |name| name.to_string_lossy().into_owned());
        let index = self.snapshots.add_reference(&name, Arc::new(image));
        self.thumbnails.remove(&name);
        if self.snapshots.compared() != Some(index) {
            self.snapshots.toggle_compare(index);
        }
        Ok(format!("Comparing with {name}"))
    }
}

fn wrote(path: &Path) -> Brought {
    Brought::Message(format!("Wrote {}", path.display()))
}
