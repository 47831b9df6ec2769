//! Writing what is seen: PNG as shown, EXR as radiance, an EXR for each light.

use std::path::{Path, PathBuf};

use eframe::egui::{self, Ui};

use super::document::Document;
use crate::error::{Error, Result};
use crate::image::write_exr;
use crate::relight::relight_streaming;

pub(super) fn export(ui: &mut Ui, document: &mut Document) {
    ui.horizontal(|ui| {
        ui.label("Name");
        let field = egui::TextEdit::singleline(&mut document.export_path).desired_width(ui.available_width());
        ui.add(field.id(path_id()));
    });
    ui.horizontal(|ui| {
        if ui.button("PNG").on_hover_text("The picture as it is shown (Ctrl+S)").clicked() {
            save_png(document);
        }
        if ui.button("EXR").on_hover_text("Linear radiance, 32 bits").clicked() {
            let path = target(document, "exr");
            let written = match &document.image {
                Some(image) => write_exr(&path, image),
                None => Ok(()),
            };
            tell(document, written, &path);
        }
        if ui.button("EXR per light").on_hover_text("What each shining light brings, in a folder").clicked() {
            let folder = PathBuf::from(format!("{}-lights", document.export_path.trim()));
            let written = per_light(document, &folder);
            tell(document, written, &folder);
        }
    });
}

/// Identity of the name's field.
pub(super) fn path_id() -> egui::Id {
    egui::Id::unique("export name")
}

/// Writes the picture as it is shown.
pub(super) fn save_png(document: &mut Document) {
    let path = target(document, "png");
    let written = match &document.image {
        Some(image) => {
            let shown = document.display.show(image);
            write_rgba(&path, shown.size, shown.rgba)
        }
        None => Ok(()),
    };
    tell(document, written, &path);
}

/// Writes opaque 8-bit pixels as a PNG. Errors: the system refuses.
pub(super) fn write_rgba(path: &Path, [width, height]: [usize; 2], rgba: Vec<u8>) -> Result<()> {
    let failed = |error: image::ImageError| Error::io(path, "write the image")(std::io::Error::other(error));
    let image = image::RgbaImage::from_raw(width as u32, height as u32, rgba)
        .ok_or_else(|| Error::input(path.display().to_string(), "there is no picture yet", ""))?;
    image::DynamicImage::from(image).to_rgb8().save_with_format(path, image::ImageFormat::Png).map_err(failed)
}

/// What each shining light brings, at its present setting: together they are the picture.
fn per_light(document: &Document, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(Error::io(folder, "create"))?;
    let basis = document.basis();
    for light in 0..basis.lights().len() {
        if !document.mix.shines(light, &document.groups) {
            continue;
        }
        let mut alone = document.mix.clone();
        alone.lights.iter_mut().enumerate().for_each(|(other, mix)| mix.solo = other == light);
        let lighting = alone.lighting(basis, &document.groups)?;
        let (image, _) = relight_streaming(&*document.session.container, &lighting)?;
        let name: String =
            basis.lights()[light].name.chars().map(|c| if "/\\:".contains(c) { '_' } else { c }).collect();
        write_exr(&folder.join(format!("{name}.exr")), &image)?;
    }
    Ok(())
}

/// The typed name with an ending, unless it has that ending.
fn target(document: &Document, ending: &str) -> PathBuf {
    let name = document.export_path.trim();
    let has = Path::new(name).extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    if has { name.into() } else { format!("{name}.{ending}").into() }
}

fn tell(document: &mut Document, written: Result<()>, path: &Path) {
    document.message = Some(match written {
        Ok(()) => (format!("Wrote {}", path.display()), false),
        Err(error) => (error.to_string(), true),
    });
}
