//! What is read and written beside the worker, so that the window never waits for a disk.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::chooser::Purpose;
use super::document::Document;
use crate::animation::{self, frames};
use crate::display::Display;
use crate::export::{self, with_ending};
use crate::file_watch::FileChange;
use crate::looks::{self, Saved};
use crate::meter::csv;
use crate::mixer::{LightMix, Mix};
use crate::pattern::Pattern;
use crate::pdf::{self, Table};
use crate::photometry::{mean_weight, quantities};
use crate::sheet::contact_sheet;
use crate::unsaved::LeftBehind;
use crate::worker::Brought;
use ltm::error::{Error, Result};
use ltm::image::{LinearImage, read_image};
use ltm::light::Lighting;
use ltm::relight::relight_streaming;

/// Files of a document, and what is said of them.
pub(super) struct Errands {
    /// The message in the status line, and whether it is an error.
    pub(super) message: Option<(String, bool)>,
    /// Works beside the worker that are not done yet.
    pub(super) beside: usize,
    under_way: UnderWay,
    /// Name for exported files, without ending.
    pub(super) export_base: PathBuf,
    /// Purpose of the file to choose.
    pub(super) wanted: Option<Purpose>,
    /// What has become of the container's file since it was opened.
    pub(super) changed: Option<FileChange>,
    /// The file that was written for a command line, with what stands in it.
    command_look: Option<(PathBuf, Mix)>,
}

impl Errands {
    pub(super) fn new(container: &Path, under_way: UnderWay) -> Self {
        let container = std::path::absolute(container).unwrap_or_else(|_| container.to_owned());
        Self {
            message: None,
            beside: 0,
            under_way,
            export_base: container.with_extension(""),
            wanted: None,
            changed: None,
            command_look: None,
        }
    }

    pub(super) fn go_on(&mut self, old: Self) {
        (self.export_base, self.command_look) = (old.export_base, old.command_look);
    }
}

/// How many errands run, those of containers that were open before included.
#[derive(Clone, Default)]
pub(super) struct UnderWay(Arc<AtomicUsize>);

/// A running job; it counts until it is dropped.
struct Running(UnderWay);

impl UnderWay {
    pub(super) fn is_any(&self) -> bool {
        self.0.load(Ordering::Relaxed) > 0
    }

    fn begin(&self) -> Running {
        self.0.fetch_add(1, Ordering::Relaxed);
        Running(self.clone())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.0.0.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Document {
    /// Puts what was brought where it belongs; what to say about it.
    pub(super) fn take(&mut self, brought: Brought) -> Result<String> {
        match brought {
            Brought::Message(message) => Ok(message),
            Brought::Wrote { path, saved, revision, message } => {
                self.work.is_kept(path, saved.mix, revision);
                Ok(message)
            }
            Brought::Look { path, saved } => {
                let message = format!("Loaded {}", path.display());
                let mix = saved.mix.clone();
                self.take_look(*saved);
                self.work.is_kept(path, mix, self.compare.snapshots.revision());
                Ok(message)
            }
            Brought::Recovered { saved, left } => {
                self.take_look(*saved);
                self.autosave.recovered = Some(left);
                Ok("Recovered unsaved work; save it to keep it".to_owned())
            }
            Brought::Image { path, light: None, image } => self.add_reference(&path, image),
            Brought::Image { path, light: Some(index), image } => {
                self.lay_image(index, &image);
                Ok(format!("{} is on {} now", name_of(&path), self.basis().lights()[index].name))
            }
            // They are no errands of the window's.
            Brought::Unsaved(outcome) => outcome.map(|()| String::new()),
            Brought::SnapshotImage { name, .. } => Ok(name),
            Brought::Surfaces(_) | Brought::Difference(..) => Ok(String::new()),
        }
    }

    /// Takes a lighting file's content instead of the mix, as one step, and of the snapshots.
    fn take_look(&mut self, saved: Saved) {
        let Saved { mix, snapshots, display, keys } = saved;
        self.work.replace(mix);
        if !snapshots.is_empty() || !self.compare.snapshots.mixes().is_empty() {
            self.compare.snapshots.read(snapshots);
            self.compare.forget_thumbnails();
        }
        self.work.keys = keys;
        if let Some(display) = display {
            self.view.set_display(display);
        }
    }

    /// Lays an image over a light: a picture multiplies an area light, a map becomes what an environment sends.
    fn lay_image(&mut self, index: usize, image: &LinearImage) {
        let light = &self.session.basis().lights()[index];
        let mut pattern = Pattern::of_image(light.kind, image);
        let mut mix = self.work.mix.clone();
        let own = &mut mix.lights[index];
        if light.kind.is_environment() {
            *own = LightMix { solo: own.solo, ..LightMix::of_weights(light, pattern.texels()) };
        } else {
            // A picture brighter than white would be no picture of this light.
            let peak = pattern.texels().iter().flatten().copied().fold(1.0, f32::max);
            pattern.texels_mut().iter_mut().flatten().for_each(|v| *v /= peak);
            (own.pattern, own.shape) = (Some(pattern), None);
        }
        self.work.replace(mix);
    }

    /// Does something that takes long beside the worker.
    pub(super) fn beside(&mut self, work: impl FnOnce() -> Result<Brought> + Send + 'static) {
        self.files.beside += 1;
        let running = self.files.under_way.begin();
        self.session.worker.beside(move || {
            let _running = running;
            work()
        });
    }

    /// Reads an image for a light, or as a reference.
    pub(super) fn read_image(&mut self, path: PathBuf, light: Option<usize>) {
        self.beside(move || Ok(Brought::Image { image: read_image(&path)?, path, light }));
    }

    /// Reads a lighting file.
    pub(super) fn read_look(&mut self, path: PathBuf) {
        let container = self.session.container.clone();
        let read = move || looks::load(&path, &container.job().basis).map(|saved| (Box::new(saved), path));
        self.beside(move || read().map(|(saved, path)| Brought::Look { path, saved }));
    }

    /// Goes on with work that an earlier window left behind.
    pub(super) fn recover(&mut self, left: LeftBehind) {
        let container = self.session.container.clone();
        // Where it cannot be read it stays for another time.
        self.beside(move || {
            let saved = Box::new(looks::load(&left.look(), &container.job().basis)?);
            Ok(Brought::Recovered { saved, left })
        });
    }

    /// Writes the lighting.
    pub(super) fn write_look(&mut self, path: PathBuf) {
        let message = format!("Saved {}", path.display());
        let (container, saved) = (self.session.container.clone(), Box::new(self.saved()));
        let revision = self.compare.snapshots.revision();
        self.beside(move || {
            looks::save(&path, &container.job().basis, &saved, true)?;
            Ok(Brought::Wrote { path, saved, revision, message })
        });
    }

    /// Writes the picture as it is shown.
    pub(super) fn write_png(&mut self, path: PathBuf) {
        if let Some(shown) = self.features.shown().or(self.meter.overlay()).cloned() {
            return self.beside(move || export::write_rgba(&path, shown.size, &shown.rgba).map(|()| wrote(&path)));
        }
        let (Some(image), display) = (self.shown.image.clone(), self.view.display) else { return };
        self.beside(move || export::write_png(&path, &image, &display).map(|()| wrote(&path)));
    }

    /// Writes the radiance.
    pub(super) fn write_exr(&mut self, path: PathBuf) {
        let Some(image) = self.shown.image.clone() else { return };
        self.beside(move || export::write_radiance(&path, &image).map(|()| wrote(&path)));
    }

    /// Writes the numbers: lights and measured area.
    pub(super) fn write_report(&mut self, path: PathBuf) {
        let tables = self.report();
        if !is_pdf(&path) {
            let text = csv(&tables.concat());
            return self.beside(move || ltm::files::write_file(&path, true, text.as_bytes()).map(|()| wrote(&path)));
        }
        let (overlay, legend) = (self.meter.overlay().cloned(), self.meter.legend_in_words());
        let (image, display, title) = (self.shown.image.clone(), self.view.display, name_of(&self.session.path));
        self.beside(move || {
            let shown = overlay.or_else(|| image.map(|image| display.show(&image)));
            let about = legend.unwrap_or_else(|| "As shown in the window".to_owned());
            let pages = pdf::report(&title, shown.as_ref().map(|shown| (shown, about.as_str())), &tables)?;
            ltm::files::write_file(&path, true, &pages).map(|()| wrote(&path))
        });
    }

    /// The tables of a report: the files, the lights, and what was measured.
    fn report(&self) -> Vec<Table> {
        let text = |texts: &[&str]| texts.iter().map(|text| (*text).to_owned()).collect::<Vec<String>>();
        let container = self.session.path.display().to_string();
        let look = self.work.saved_in().map_or_else(|| "not saved".to_owned(), |path| path.display().to_string());
        let mut tables = vec![vec![text(&["container", &container]), text(&["look", &look])]];
        let mut rows =
            vec![text(&["light", "kind", "group", "shines", "EV", "share of the picture's light, %", "value", "unit"])];
        let metres = self.metres_per_unit();
        let all: f32 = self.list.contributions.iter().map(|v| v.max(0.0)).sum();
        for (index, light) in self.basis().lights().iter().enumerate() {
            let mix = &self.work.mix;
            let group = mix.groups.of_light(index).map_or("", |group| mix.groups.group(group).name.as_str());
            let share = self.list.contributions.get(index).map_or(0.0, |v| v.max(0.0) / all.max(f32::MIN_POSITIVE));
            let mut row = text(&[&light.name, light.kind.name(), group]);
            row.push(if mix.shines(index) { "yes" } else { "no" }.to_owned());
            row.extend([format!("{:.3}", mix.stops(index)), format!("{:.2}", share * 100.0)]);
            let weight = mean_weight(self.basis(), mix, index);
            for (quantity, at_one) in quantities(light, metres) {
                row.extend([format!("{:.4}", at_one * weight), quantity.unit().to_owned()]);
            }
            rows.push(row);
        }
        tables.push(rows);
        if let Some(figures) = &self.meter.figures {
            let unit = self.meter.measured().unit();
            let kind = if self.meter.is_least() { "at least: surfaces taken for white" } else { "" };
            let head = text(&["area", "average", "minimum", "maximum", "uniformity U0", "points", "unit", "remark"]);
            let corners: Vec<String> = self.meter.area.corners.iter().map(|[x, y]| format!("{x:.1} {y:.1}")).collect();
            let mut row = vec![corners.join("; ")];
            row.extend([figures.average, figures.least, figures.most].map(|value| format!("{value:.3}")));
            row.extend([format!("{:.3}", figures.uniformity()), figures.count.to_string()]);
            row.extend(text(&[unit, kind]));
            tables.push(vec![head, row]);
        }
        tables
    }

    /// Writes a layer for each light.
    pub(super) fn write_layers(&mut self, path: PathBuf) {
        let (container, relighter) = (self.session.container.clone(), self.shown.relighter.clone());
        let mix = self.work.mix.clone();
        self.beside(move || {
            export::write_layers(&path, &container, relighter.as_deref(), &mix)?;
            Ok(wrote(&path))
        });
    }

    /// Writes all snapshots on one sheet, each as it is shown.
    pub(super) fn write_sheet(&mut self, path: PathBuf) {
        let display = self.view.display;
        let pictures: Vec<_> = self
            .compare
            .snapshots
            .list()
            .iter()
            .filter_map(|s| Some((s.name.clone(), s.image.clone()?, s.is_displayed)))
            .collect();
        self.beside(move || {
            let shown = pictures.into_iter().map(|(name, image, is_displayed)| {
                let own = if is_displayed { Display::default() } else { display };
                (name, own.show(&image))
            });
            let shown: Vec<_> = shown.collect();
            if is_pdf(&path) {
                return ltm::files::write_file(&path, true, &pdf::sheet(&shown)?).map(|()| wrote(&path));
            }
            let sheet = contact_sheet(&shown)?;
            export::write_rgba(&path, sheet.size, &sheet.rgba).map(|()| wrote(&path))
        });
    }

    /// Writes an animation from snapshot to snapshot, as numbered pictures or a video: by the times of the look's file, else evenly.
    pub(super) fn write_animation(&mut self, path: PathBuf) {
        let mixes = self.compare.snapshots.mixes();
        let mix_of = |name: &String| mixes.iter().find(|(own, _)| own == name).map(|(_, mix)| mix);
        let by_file: Vec<(f32, &Mix)> =
            self.work.keys.iter().filter_map(|(time, name)| Some((*time, mix_of(name)?))).collect();
        let step_secs = self.compare.step_secs;
        let evenly = mixes.iter().enumerate().map(|(index, (_, mix))| (index as f32 * step_secs, mix));
        let timed: Vec<(f32, &Mix)> = if by_file.len() > 1 { by_file } else { evenly.collect() };
        let basis = self.session.basis();
        let looks = timed.into_iter().map(|(time, mix)| Ok((time, mix.lighting(basis)?))).collect::<Result<Vec<_>>>();
        let (container, relighter) = (self.session.container.clone(), self.shown.relighter.clone());
        let (display, per_sec) = (self.view.display, self.compare.frames_per_sec);
        self.beside(move || {
            let looks = looks?;
            let frames = frames(&looks, per_sec)?;
            let relight = |lighting: &Lighting| match &relighter {
                Some(relighter) => relighter.relight(lighting),
                None => relight_streaming(&*container, lighting).map(|(image, _)| image),
            };
            animation::write(&path, &frames, per_sec, &display, relight).map(Brought::Message)
        });
    }

    /// The command that makes this picture. The lighting is written for it, into a new file of its own, unless it stands in
    /// one already.
    pub(super) fn command_line(&mut self) -> String {
        let own = self.files.command_look.as_ref().filter(|(path, mix)| *mix == self.work.mix && path.is_file());
        let saved = self.work.saved_in().or(own.map(|(path, _)| path.as_path())).map(Path::to_owned);
        let look = saved.clone().unwrap_or_else(|| free_look(&self.files.export_base));
        let png = with_ending(&self.files.export_base, "png");
        let line =
            export::command_line(&self.session.path, &look, &png, &self.view.display, self.lumens_per_watt().ok());
        if saved.is_some() {
            self.files.message = Some((format!("Copied: {line}"), false));
            return line;
        }
        let message = format!("Wrote {} and copied: {line}", name_of(&look));
        self.files.command_look = Some((look.clone(), self.work.mix.clone()));
        let (container, saved) = (self.session.container.clone(), Saved::of(self.work.mix.clone()));
        self.beside(move || {
            looks::save(&look, &container.job().basis, &saved, false)?;
            Ok(Brought::Message(message))
        });
        line
    }

    /// Adds an image of the picture's size to compare with.
    fn add_reference(&mut self, path: &Path, image: LinearImage) -> Result<String> {
        let [width, height] = self.size();
        if [image.width, image.height] != [width, height] {
            let problem =
                format!("is {} × {} pixels, and the picture is {width} × {height}", image.width, image.height);
            return Err(Error::input(path.display().to_string(), problem, "choose an image of the picture's size"));
        }
        // What is linear is kept in EXR, HDR and PFM; all else was made for a display.
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
        let is_displayed = !["exr", "hdr", "pfm"].contains(&ending.as_str());
        let name = name_of(path);
        let index = self.compare.snapshots.add_reference(&name, Arc::new(image), is_displayed);
        self.compare.forget_thumbnail(&name);
        if self.compare.snapshots.compared() != Some(index) {
            self.compare.snapshots.toggle_compare(index);
        }
        let how = if is_displayed { ", shown as it is" } else { "" };
        Ok(format!("Comparing with {name}{how}"))
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

fn is_pdf(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("pdf"))
}

fn wrote(path: &Path) -> Brought {
    Brought::Message(format!("Wrote {}", path.display()))
}

/// A name for a lighting file that none has yet, nor patterns of one.
fn free_look(base: &Path) -> PathBuf {
    let folder = base.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let names: Vec<String> = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .collect();
    let stem = base.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let free = |stem: &String| {
        let toml = format!("{stem}.toml");
        let dashed = format!("{stem}-");
        !names.iter().any(|name| *name == toml || name.starts_with(&dashed))
    };
    let mut stems = (1..).map(|number| format!("{stem}-command{number}"));
    base.with_file_name(format!("{}.toml", stems.find(free).unwrap_or(stem)))
}
