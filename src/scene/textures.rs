//! Textures of a scene: each file read once for each way of using it.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use super::memory::MemoryBound;
use super::mtl::roughness_of_shininess;
use super::source::ImageSource;
use super::{Placing, Texels, Texture, TextureId};
use crate::error::{Error, Hint, Result, Warnings};
use crate::files::FileAccess;
use crate::image::{
    ImageFacts, RgbaImage, decode_srgb, embedded_facts, encode_srgb, image_facts, read_embedded, read_rgba,
};

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
    /// Opacity: the alpha channel, or the red one of an image without alpha.
    Opacity,
    /// Numbers that are no colours: roughness, metal, normals, heights.
    Numbers,
    /// Reflectance that is also a cut-out: alpha times the number with these bits.
    Masked(u32),
    /// Phong exponents over the number with these bits, kept as the roughness that they mean.
    Shininess(u32),
}

/// The textures read so far.
#[derive(Debug)]
pub(super) struct Textures {
    pub(super) list: Vec<Texture>,
    pub(super) memory: MemoryBound,
    reach: FileAccess,
    known: HashMap<(PathBuf, TextureUse, [u32; 5]), TextureId>,
    bytes: u64,
    /// Files that materials name and that are not there, with who names them first.
    missing: Vec<(PathBuf, String)>,
    /// The same of files that refine a surface: roughness, metal, normals.
    lacking: Vec<(PathBuf, String)>,
    /// Files whose names materials write in another way, with other upper and lower case or backslashes: as written, as found.
    respelled: Vec<(PathBuf, PathBuf)>,
    /// Files that lie elsewhere than materials write: as written, as found.
    moved: Vec<(PathBuf, PathBuf)>,
}

impl Textures {
    /// None yet; they and what reading them takes stay within `memory`, and their files within `reach`.
    pub(super) fn within(memory: MemoryBound, reach: FileAccess) -> Self {
        let (known, missing, respelled, moved) = (HashMap::new(), Vec::new(), Vec::new(), Vec::new());
        Self { list: Vec::new(), memory, reach, known, bytes: 0, missing, lacking: Vec::new(), respelled, moved }
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
        self.placed((folder, name), Placing::PLAIN, usage, asked_by, warnings)
    }

    /// As [`named`](Self::named), of a texture that lies otherwise.
    ///
    /// # Errors
    /// As [`named`](Self::named).
    pub(super) fn placed(
        &mut self,
        (folder, name): (&Path, &str),
        placing: Placing,
        usage: TextureUse,
        asked_by: &str,
        warnings: &mut Warnings,
    ) -> Result<Option<TextureId>> {
        let written = folder.join(name);
        let found = find_as_elsewhere(folder, name);
        let is_moved = found.is_none();
        let Some(found) = found.or_else(|| find_moved(folder, name)) else {
            self.miss(written, usage, asked_by);
            return Ok(None);
        };
        self.reach.admit(&found, asked_by)?;
        if is_moved && self.moved.iter().all(|(known, _)| *known != written) {
            self.moved.push((written, found.clone()));
        } else if !is_moved && found != written && self.respelled.iter().all(|(known, _)| *known != written) {
            self.respelled.push((written, found.clone()));
        }
        self.get(&found, placing, usage, warnings).map(Some)
    }

    fn miss(&mut self, written: PathBuf, usage: TextureUse, asked_by: &str) {
        let refines = matches!(usage, TextureUse::Numbers | TextureUse::Shininess(_));
        let list = if refines { &mut self.lacking } else { &mut self.missing };
        if list.iter().all(|(path, _)| *path != written) {
            list.push((written, asked_by.to_owned()));
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
        if let Some((path, by)) = self.lacking.first() {
            let (count, path) = (self.lacking.len(), path.display());
            warnings.push(format!(
                "{count} textures of roughness, metal or normals are missing and left out: the first, {path} ({by})"
            ));
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
    pub(super) fn get(
        &mut self,
        path: &Path,
        placing: Placing,
        usage: TextureUse,
        warnings: &mut Warnings,
    ) -> Result<TextureId> {
        if let Some(&id) = self.known.get(&(path.to_owned(), usage, bits_of(placing))) {
            return Ok(id);
        }
        let facts = image_facts(path)?;
        self.keep((path, placing), facts, usage, warnings, || read_rgba(path))
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
                if let Some(&id) = self.known.get(&(name.clone(), usage, bits_of(Placing::PLAIN))) {
                    return Ok(Some(id));
                }
                let facts = embedded_facts(name, bytes)?;
                let read = || read_embedded(name, bytes);
                self.keep((name, Placing::PLAIN), facts, usage, warnings, read).map(Some)
            }
            ImageSource::Colours(texture) => {
                let path = Path::new(&texture.name);
                let bytes = texture.texels.bytes();
                self.admit(path, bytes)?;
                self.memory.take(bytes, path)?;
                self.list.push(Texture::clone(texture));
                Ok(Some(TextureId(self.list.len() as u32 - 1)))
            }
        }
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
        (path, placing): (&Path, Placing),
        facts: ImageFacts,
        usage: TextureUse,
        warnings: &mut Warnings,
        read: impl FnOnce() -> Result<RgbaImage>,
    ) -> Result<TextureId> {
        let (width, height) = (facts.width, facts.height);
        warnings.extend(facts.notes.iter().map(|note| format!("{}: {note}", path.display())));
        // Eight bits a channel at least of what is encoded; what takes more is counted when that is known.
        let texel = if facts.is_encoded { size_of::<[u8; 4]>() } else { size_of::<[f32; 4]>() } as u64;
        let least = u64::from(width) * u64::from(height) * texel;
        self.admit(path, least)?;
        self.memory.check(facts.needs_bytes, path)?;
        let image = read()?;
        let (texels, mended) = texels_of(image, usage);
        let bytes = texels.bytes();
        self.admit(path, bytes - least)?;
        self.memory.take(bytes, path)?;
        if bytes > LARGE_BYTES {
            let name = path.display();
            warnings.push(format!("{name}: the texture has {width} × {height} pixels and takes {}", gib(bytes)));
        }
        if mended {
            warnings.push(format!("{}: values that no surface can have were clamped", path.display()));
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.list.push(Texture { name, width, height, texels, placing });
        let id = TextureId(self.list.len() as u32 - 1);
        self.known.insert((path.to_owned(), usage, bits_of(placing)), id);
        Ok(id)
    }
}

/// The placing as a key.
fn bits_of(Placing { scale, offset, is_clamped }: Placing) -> [u32; 5] {
    [scale.x.to_bits(), scale.y.to_bits(), offset.x.to_bits(), offset.y.to_bits(), is_clamped.into()]
}

/// The texels of an image for a use, and whether values were mended. Eight bits stay eight bits.
fn texels_of(mut image: RgbaImage, usage: TextureUse) -> (Texels, bool) {
    if let TextureUse::Shininess(most) = usage {
        // As numbers first.
        let (numbers, mended) = texels_of(image, TextureUse::Numbers);
        return (numbers.mapped(|share| roughness_of_shininess(share * f32::from_bits(most))), mended);
    }
    let has_alpha = image.has_alpha;
    if image.is_8_bit {
        let codes: [f32; 256] = std::array::from_fn(|code| decode_srgb(code as f32 / 255.0));
        let code = |v: f32| codes.partition_point(|&known| known < v - 1e-6).min(255) as u8;
        let number = |v: f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        let texel = |[r, g, b, a]: &[f32; 4]| {
            let alpha = match usage {
                TextureUse::Opacity if !has_alpha => code(*r),
                TextureUse::Masked(scale) => number(a * f32::from_bits(scale)),
                _ => number(*a),
            };
            [code(*r), code(*g), code(*b), alpha]
        };
        let texels = image.pixels.iter().map(texel).collect();
        let is_colour = !matches!(usage, TextureUse::Numbers);
        return (if is_colour { Texels::Colours8(texels) } else { Texels::Numbers8(texels) }, false);
    }
    let largest = if usage == TextureUse::Emission { f32::MAX } else { 1.0 };
    let mut mended = false;
    let mut mend = |v: f32| {
        let clamped = if v.is_finite() { v.clamp(0.0, largest) } else { 0.0 };
        mended |= clamped != v;
        clamped
    };
    let mut texel = |[r, g, b, a]: [f32; 4]| match usage {
        TextureUse::Opacity => [r, g, b, mend(if has_alpha { a } else { r })],
        TextureUse::Masked(scale) => [mend(r), mend(g), mend(b), a * f32::from_bits(scale)],
        // What was decoded from sRGB was no colour.
        TextureUse::Numbers if image.is_encoded => [r, g, b, a].map(encode_srgb),
        TextureUse::Reflectance | TextureUse::Emission | TextureUse::Numbers | TextureUse::Shininess(_) => {
            [mend(r), mend(g), mend(b), a]
        }
    };
    image.pixels.iter_mut().for_each(|pixel| *pixel = texel(*pixel));
    (Texels::Floats(image.pixels), mended)
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
