//! OpenEXR files that share the light groups of one rendering between them, as where memory holds only some of many at a time.

use std::path::{Path, PathBuf};

use regex_lite::Regex;

use super::layers::{self, Layers};
use super::{LayerMatch, LayerPattern, LayerRole, LightRow, LightSet, Source, TakeRow};
use crate::error::{Error, Result, Warnings};
use crate::files::{folder_of, natural_order};

/// One of the files.
#[derive(Clone, Debug)]
struct Share {
    layers: Layers,
    /// Number of its lights, which are its first images.
    lights: usize,
    /// Index in the whole set of its first light.
    first: usize,
}

/// The files of a set.
#[derive(Clone, Debug)]
pub(super) struct Several {
    shares: Vec<Share>,
    lights: usize,
}

/// Whether a path is a pattern for several files: it has a `*`, and there is no file of that name.
pub(super) fn is_pattern(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().contains('*')) && !path.exists()
}

/// The files that match a pattern, in natural order, without hidden ones.
///
/// # Errors
/// A folder that cannot be listed; no file.
pub(super) fn files(pattern: &Path) -> Result<Vec<PathBuf>> {
    let folder = folder_of(pattern);
    let name = pattern.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let parts: Vec<String> = name.split('*').map(regex_lite::escape).collect();
    let expression = Regex::new(&format!("^{}$", parts.join(".*"))).expect("it is escaped");
    let entries = std::fs::read_dir(folder).map_err(Error::io(folder, "list"))?;
    let mut names: Vec<_> = entries.filter_map(|entry| entry.ok()).map(|entry| entry.file_name()).collect();
    names.retain(|name| {
        let text = name.to_string_lossy();
        !text.starts_with('.') && expression.is_match(&text)
    });
    names.sort_by(|a, b| natural_order(&a.to_string_lossy(), &b.to_string_lossy()));
    if names.is_empty() {
        let hint = "write for example 'render-*.exr', in quotation marks";
        return Err(Error::input(pattern.display().to_string(), "no file matches", hint));
    }
    Ok(names.into_iter().map(|name| folder.join(name)).collect())
}

/// Inspects the files that match `pattern`. The image under all lights is that of the first file that has one: each shows the
/// whole scene.
pub(super) fn open(pattern: &Path, layers: Option<&LayerPattern>) -> Result<LightSet> {
    let paths = files(pattern)?;
    let (mut shares, mut lights, mut matches) = (Vec::new(), Vec::new(), Vec::new());
    let (mut warnings, mut size, mut has_sum) = (Warnings::new(), None, false);
    for path in &paths {
        let set = layers::open(path, layers)?;
        // A picture without light groups, which the pattern fits as well.
        if set.lights.is_empty() {
            matches.extend(set.matches.into_iter().map(|found| named(path, found)));
            continue;
        }
        let own = (set.width, set.height);
        let ((width, height), first) = *size.get_or_insert((own, path));
        if (width, height) != own {
            let problem = format!("has {} × {} pixels, {} {width} × {height}", own.0, own.1, first.display());
            return Err(Error::input(path.display().to_string(), problem, "give files of one rendering"));
        }
        for found in set.matches {
            let is_repeated = has_sum && found.role == LayerRole::Sum;
            let role = if is_repeated { LayerRole::Ignored } else { found.role };
            matches.push(named(path, LayerMatch { role, ..found }));
        }
        let Source::Layers(source) = set.source else { unreachable!("layers were opened") };
        shares.push(Share { layers: source, lights: set.lights.len(), first: lights.len() });
        lights.extend(set.lights);
        has_sum |= set.has_sum;
        set.warnings.iter().for_each(|warning| warnings.push(warning.clone()));
    }
    let (width, height) = size.map_or((0, 0), |(size, _)| size);
    let source = Source::Several(Several { shares, lights: lights.len() });
    Ok(LightSet { width, height, lights, has_sum, matches, warnings, source })
}

/// A match by the name of its file as well.
fn named(path: &Path, found: LayerMatch) -> LayerMatch {
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    LayerMatch { layer: format!("{file}: {}", found.layer), ..found }
}

impl Several {
    /// Bytes of the largest chunk of the files.
    pub(super) fn chunk_bytes(&self) -> u64 {
        self.shares.iter().map(|share| share.layers.chunk_bytes()).max().unwrap_or(0)
    }

    /// Reads one file after the other; of the images under all lights only the first.
    pub(super) fn read(&self, take: &mut TakeRow<'_>) -> Result<()> {
        let mut has_sum = false;
        for share in &self.shares {
            let mut sees_sum = false;
            share.layers.read(&mut |row: LightRow<'_>| {
                let is_light = row.image < share.lights;
                sees_sum |= !is_light;
                if !is_light && has_sum {
                    return Ok(());
                }
                let image = if is_light { share.first + row.image } else { self.lights };
                take(LightRow { image, ..row })
            })?;
            has_sum |= sees_sum;
        }
        Ok(())
    }
}
