//! Textures of a scene: each file read once for each way of using it.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::memory::MemoryBound;
use super::source::ImageSource;
use super::{Texture, TextureId};
use crate::error::{Error, Hint, Result, Warnings};
use crate::files::FileAccess;
use crate::image::{ImageFacts, RgbaImage, embedded_facts, encode_srgb, image_facts, read_embedded, read_rgba};

/// Most memory that the textures of a scene may take, in bytes.
const BUDGET_BYTES: u64 = 2 << 30;

/// Memory of one texture above which a warning is given, in bytes.
const LARGE_BYTES: u64 = 256 << 20;

/// Entries of a folder that are looked at for the files of one that was moved.
const MAX_SEARCHED_ENTRIES: usize = 10_000;

/// The use that a texture is read for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum TextureUse {
    /// Reflectance: clamped to [0, 1].
    Reflectance,
    /// Emission: no upper bound.
    Emission,
    /// Cut-out: the alpha channel, or the red one of an image without alpha.
    CutOut,
    /// Reflectance that is also a cut-out: alpha times the number with these bits.
    Masked(u32),
}

/// The textures read so far.
#[derive(Debug)]
pub(super) struct Textures {
    pub(super) list: Vec<Texture>,
    pub(super) memory: MemoryBound,
    reach: FileAccess,
    known: HashMap<(PathBuf, TextureUse), TextureId>,
    bytes: u64,
    /// Files that materials name and that are not there, with who names them first.
    missing: Vec<(PathBuf, String)>,
    /// Files whose names materials write in another way, with other upper and lower case or backslashes: as written, as found.
    respelled: Vec<(PathBuf, PathBuf)>,
    /// Files that lie elsewhere than materials write: as written, as found.
    moved: Vec<(PathBuf, PathBuf)>,
}

impl Textures {
    /// None yet; they and what reading them takes stay within `memory`, and their files within `reach`.
    pub(super) fn within(memory: MemoryBound, reach: FileAccess) -> Self {
        let (known, missing, respelled, moved) = (HashMap::new(), Vec::new(), Vec::new(), Vec::new());
        Self { list: Vec::new(), memory, reach, known, bytes: 0, missing, respelled, moved }
    }

    /// The texture that a material names in a folder. First `name` as it is written is tried; then names that differ
    /// only in case or have `/` for `\`, as on other systems; then the last part of the name in the folder, for files
    /// that were moved together. `None` if there is no such file, which [`report`](Self::report) then tells.
    ///
    /// # Errors
    /// A file that is no image or may not be opened, or more textures than fit.
    pub(super) fn named(
        &mut self,
        folder: &Path,
        name: &str,
        usage: TextureUse,
        asked_by: &str,
        warnings: &mut Warnings,
    ) -> Result<Option<TextureId>> {
        let written = folder.join(name);
        let found = find_as_elsewhere(folder, name);
        let is_moved = found.is_none();
        let Some(found) = found.or_else(|| find_moved(folder, name)) else {
            self.miss(written, asked_by);
            return Ok(None);
        };
        self.reach.admit(&found, asked_by)?;
        if is_moved && self.moved.iter().all(|(known, _)| *known != written) {
            self.moved.push((written, found.clone()));
        } else if !is_moved && found != written && self.respelled.iter().all(|(known, _)| *known != written) {
            self.respelled.push((written, found.clone()));
        }
        self.get(&found, usage, warnings).map(Some)
    }

    fn miss(&mut self, written: PathBuf, asked_by: &str) {
        if self.missing.iter().all(|(path, _)| *path != written) {
            self.missing.push((written, asked_by.to_owned()));
        }
    }

    /// Says in one warning which names were found under another spelling, and names all files that are missing.
    ///
    /// # Errors
    /// Files are missing and that is not allowed. If it is, they become a warning.
    pub(super) fn report(&self, place: &str, allow_missing: bool, warnings: &mut Warnings) -> Result<()> {
        if let Some((written, found)) = self.respelled.first() {
            let (count, written, found) = (self.respelled.len(), written.display(), found.display());
            let (names, first) = if count == 1 { ("name differs", "") } else { ("names differ", "the first, ") };
            warnings.push(format!(
                "{count} texture {names} from the file's in upper and lower case or in \\ for /: {first}{written}, is {found}"
            ));
        }
        if let Some((written, found)) = self.moved.first() {
            let (count, written, found) = (self.moved.len(), written.display(), found.display());
            let are = if count == 1 {
                "texture is not where it is said to be"
            } else {
                "textures are not where they are said to be"
            };
            warnings.push(format!("{count} {are}: {written} is read from {found}"));
        }
        if self.missing.is_empty() {
            return Ok(());
        }
        let list: Vec<_> = self.missing.iter().map(|(path, by)| format!("{} ({by})", path.display())).collect();
        let problem = match list.len() {
            1 => format!("the texture {} is missing", list[0]),
            count => format!("{count} textures are missing: {}", list.join(", ")),
        };
        if allow_missing {
            warnings.push(format!("{problem}; rendered with the materials' colours"));
            return Ok(());
        }
        Err(Error::input(place, problem, Hint::AllowMissing))
    }

    /// The texture of a file.
    ///
    /// # Errors
    /// A file that cannot be read or is no image, or more textures than fit.
    pub(super) fn get(&mut self, path: &Path, usage: TextureUse, warnings: &mut Warnings) -> Result<TextureId> {
        if let Some(&id) = self.known.get(&(path.to_owned(), usage)) {
            return Ok(id);
        }
        let facts = image_facts(path)?;
        self.keep(path, facts, usage, warnings, || read_rgba(path))
    }

    /// The texture that a glTF file names; none where it is missing, as with [`named`](Self::named).
    ///
    /// # Errors
    /// What is no image, or more textures than fit.
    pub(super) fn source(
        &mut self,
        source: &ImageSource,
        usage: TextureUse,
        asked_by: &str,
        warnings: &mut Warnings,
    ) -> Result<Option<TextureId>> {
        match source {
            ImageSource::File(folder, name) => self.named(folder, name, usage, asked_by, warnings),
            ImageSource::Embedded(name, bytes) => {
                if let Some(&id) = self.known.get(&(name.clone(), usage)) {
                    return Ok(Some(id));
                }
                let facts = embedded_facts(name, bytes)?;
                self.keep(name, facts, usage, warnings, || read_embedded(name, bytes)).map(Some)
            }
            ImageSource::Colours(texture) => {
                let path = Path::new(&texture.name);
                let bytes = (texture.texels.len() * size_of::<[f32; 4]>()) as u64;
                self.admit(path, bytes)?;
                self.memory.take(bytes, path)?;
                self.list.push(Texture::clone(texture));
                Ok(Some(TextureId(self.list.len() as u32 - 1)))
            }
        }
    }

    /// The average of an image that holds numbers and no colours; none where it is missing.
    ///
    /// # Errors
    /// What is no image, or does not fit the memory.
    pub(super) fn average(&mut self, source: &ImageSource, asked_by: &str) -> Result<Option<[f32; 3]>> {
        let (facts, path, bytes) = match source {
            ImageSource::Embedded(name, bytes) => (embedded_facts(name, bytes)?, name.clone(), Some(bytes)),
            ImageSource::File(folder, name) => match find_as_elsewhere(folder, name) {
                Some(path) => {
                    self.reach.admit(&path, asked_by)?;
                    (image_facts(&path)?, path, None)
                }
                None => {
                    self.miss(folder.join(name), asked_by);
                    return Ok(None);
                }
            },
            ImageSource::Colours(_) => return Ok(None),
        };
        self.memory.check(facts.needs_bytes, &path)?;
        let image = bytes.map_or_else(|| read_rgba(&path), |bytes| read_embedded(&path, bytes))?;
        let mut sums = [0.0f64; 3];
        for pixel in &image.pixels {
            // What was decoded from sRGB was no colour.
            sums.iter_mut().zip(pixel).for_each(|(sum, v)| *sum += f64::from(encode_srgb(*v)));
        }
        Ok(Some(sums.map(|sum| (sum / image.pixels.len() as f64) as f32)))
    }

    /// Counts the bytes of a texture. Errors: more than a scene's textures may take.
    fn admit(&mut self, path: &Path, bytes: u64) -> Result<()> {
        self.bytes += bytes;
        if self.bytes > BUDGET_BYTES {
            return Err(Error::Resources {
                what: format!("reading the textures up to {}", path.display()),
                needed: gib(self.bytes),
                available: format!("a scene's textures may take {}", gib(BUDGET_BYTES)),
                hint: "scale the images down".into(),
            });
        }
        Ok(())
    }

    /// Reads an image and keeps it as a texture.
    fn keep(
        &mut self,
        path: &Path,
        facts: ImageFacts,
        usage: TextureUse,
        warnings: &mut Warnings,
        read: impl FnOnce() -> Result<RgbaImage>,
    ) -> Result<TextureId> {
        let (width, height) = (facts.width, facts.height);
        warnings.extend(facts.notes.iter().map(|note| format!("{}: {note}", path.display())));
        let bytes = u64::from(width) * u64::from(height) * size_of::<[f32; 4]>() as u64;
        self.admit(path, bytes)?;
        if bytes > LARGE_BYTES {
            let name = path.display();
            warnings.push(format!("{name}: the texture has {width} × {height} pixels and takes {}", gib(bytes)));
        }
        // The image as it is read, and the texels that are made of it.
        self.memory.check(facts.needs_bytes, path)?;
        let mut image = read()?;
        self.memory.take(bytes, path)?;
        let largest = if usage == TextureUse::Emission { f32::MAX } else { 1.0 };
        let has_alpha = image.has_alpha;
        let mut mended = false;
        let mut mend = |v: f32| {
            let clamped = if v.is_finite() { v.clamp(0.0, largest) } else { 0.0 };
            mended |= clamped != v;
            clamped
        };
        let mut texel = |[r, g, b, a]: [f32; 4]| match usage {
            TextureUse::CutOut => [r, g, b, if has_alpha { a } else { r }],
            TextureUse::Masked(scale) => [mend(r), mend(g), mend(b), a * f32::from_bits(scale)],
            TextureUse::Reflectance | TextureUse::Emission => [mend(r), mend(g), mend(b), a],
        };
        image.pixels.iter_mut().for_each(|pixel| *pixel = texel(*pixel));
        if mended {
            warnings.push(format!("{}: values that no surface can have were clamped", path.display()));
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.list.push(Texture { name, width: image.width, height: image.height, texels: image.pixels });
        let id = TextureId(self.list.len() as u32 - 1);
        self.known.insert((path.to_owned(), usage), id);
        Ok(id)
    }
}

/// The file of this name in a folder. Each part is matched exactly if possible, otherwise in any case; backslashes may
/// separate parts.
pub(super) fn find_as_elsewhere(folder: &Path, name: &str) -> Option<PathBuf> {
    let written = folder.join(name);
    if written.is_file() {
        return Some(written);
    }
    let name = name.replace('\\', "/");
    let mut path = if Path::new(&name).is_absolute() { PathBuf::from("/") } else { folder.to_owned() };
    for part in name.split('/').filter(|part| !part.is_empty() && *part != ".") {
        let next = path.join(part);
        if part == ".." || next.exists() {
            path = next;
            continue;
        }
        let alike = |entry: &PathBuf| {
            let found = entry.file_name().and_then(|found| found.to_str());
            found.is_some_and(|found| found.to_lowercase() == part.to_lowercase())
        };
        let here = if path.as_os_str().is_empty() { Path::new(".") } else { &path };
        let entries = std::fs::read_dir(here).ok()?.filter_map(|entry| Some(path.join(entry.ok()?.file_name())));
        // The first by name, so that the same folder gives the same file.
        path = entries.filter(alike).min()?;
    }
    path.is_file().then_some(path)
}

/// A file that was moved to a folder or into a subfolder, matched by as many of the last parts of its name as possible,
/// at least one.
pub(super) fn find_moved(folder: &Path, name: &str) -> Option<PathBuf> {
    let name = name.replace('\\', "/");
    let parts: Vec<&str> = name.split('/').filter(|part| !matches!(*part, "" | "." | "..")).collect();
    let ends = || (0..parts.len()).map(|first| parts[first..].join("/"));
    if let Some(found) = ends().find_map(|end| find_as_elsewhere(folder, &end)) {
        return Some(found);
    }
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let last = parts.last()?;
    let within = std::fs::read_dir(here)
        .ok()?
        .take(MAX_SEARCHED_ENTRIES)
        .filter_map(|entry| Some(folder.join(entry.ok()?.file_name())));
    within.filter(|path| path.is_dir()).filter_map(|inner| find_as_elsewhere(&inner, last)).min()
}

fn gib(bytes: u64) -> String {
    format!("{:.1} GiB", bytes as f64 / (1u64 << 30) as f64)
}
